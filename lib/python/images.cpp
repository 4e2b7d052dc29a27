// SPDX-License-Identifier: Apache-2.0
#include "rayloom/python/images.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"
#include "rayloom/engine/load_image.h"
#include "rayloom/python/values.h"
#include "rayloom/stats/compare.h"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

namespace rayloom::python
{

namespace py = pybind11;

namespace
{

using Array = py::array_t<float, py::array::forcecast>;

std::vector<std::string> usual_names(py::ssize_t channels, const std::string& what)
{
    if (channels == 1) return {"Y"};
    if (channels == 3) return {"R", "G", "B"};
    if (channels == 4) return {"R", "G", "B", "A"};
    throw UsageError(what + ": " + std::to_string(channels) +
                     " channels have no usual names; make it a rayloom.Image(array, channels=[…])");
}

std::shared_ptr<MemoryImage> from_array(const py::handle& value, const std::string& what,
                                        std::vector<std::string> names)
{
    const Array array = Array::ensure(value);
    if (!array) {
        PyErr_Clear();
        throw UsageError(what + ": this is no array of numbers");
    }
    if (array.ndim() != 2 && array.ndim() != 3)
        throw UsageError(what + ": an array of height × width × channels is wanted, this one has " +
                         std::to_string(array.ndim()) + " dimensions");
    const py::ssize_t height = array.shape(0), width = array.shape(1);
    const py::ssize_t channels = array.ndim() == 3 ? array.shape(2) : 1;
    if (height == 0 || width == 0 || channels == 0) throw UsageError(what + ": the array is empty");
    if (names.empty()) names = usual_names(channels, what);
    if (static_cast<py::ssize_t>(names.size()) != channels)
        throw UsageError(what + ": " + std::to_string(names.size()) + " channel names for " +
                         std::to_string(channels) + " channels");
    auto image = std::make_shared<MemoryImage>();
    image->desc.data = image->desc.display =
        Region{0, 0, static_cast<int>(width), static_cast<int>(height)};
    image->desc.channels = std::move(names);
    image->pixels = ImageBuffer(image->desc.data, static_cast<int>(channels));
    const auto* from = reinterpret_cast<const char*>(array.data());
    const py::ssize_t step = array.ndim() == 3 ? array.strides(2) : 0;
    const ImageView to = image->pixels.view();
    for (py::ssize_t y = 0; y < height; ++y)
        for (py::ssize_t c = 0; c < channels; ++c) {
            float* row = to.row(static_cast<int>(c), static_cast<int>(y));
            const char* at = from + y * array.strides(0) + c * step;
            for (py::ssize_t x = 0; x < width; ++x)
                row[x] = *reinterpret_cast<const float*>(at + x * array.strides(1));
        }
    return image;
}

/// The rows in memory as [y][x][channel], without a copy.
py::array pixels_of(const py::object& self)
{
    const MemoryImage& image = *self.cast<const Image&>().image;
    const ConstImageView view = image.pixels.view();
    constexpr auto size = static_cast<py::ssize_t>(sizeof(float));
    const Region& r = view.region();
    return py::array(py::dtype::of<float>(),
                     {static_cast<py::ssize_t>(r.height()), static_cast<py::ssize_t>(r.width()),
                      static_cast<py::ssize_t>(view.channels())},
                     {static_cast<py::ssize_t>(view.row_stride()) * size, size,
                      static_cast<py::ssize_t>(view.channel_stride()) * size},
                     view.ptr(0, r.x0, r.y0), self);
}

/// Alpha does not count as colour.
MemoryImage colour_of(const std::shared_ptr<MemoryImage>& image, const std::string& what)
{
    const std::vector<int> colour = image->desc.colour();
    if (colour.size() != 1 && colour.size() != 3)
        throw UsageError(what + ": one or three colour channels are compared, not " +
                         std::to_string(colour.size()));
    MemoryImage picked;
    picked.desc = image->desc;
    picked.desc.channels.clear();
    picked.pixels = ImageBuffer(image->desc.data, static_cast<int>(colour.size()));
    for (std::size_t c = 0; c < colour.size(); ++c) {
        picked.desc.channels.push_back(image->desc.channels[static_cast<std::size_t>(colour[c])]);
        copy_pixels(std::as_const(image->pixels).view().channel_range(colour[c], 1),
                    picked.pixels.view().channel_range(static_cast<int>(c), 1));
    }
    return picked;
}

std::shared_ptr<MemoryImage> read(const std::string& path, const std::string& layer,
                                  const std::string& channels)
{
    const py::gil_scoped_release free;
    return std::make_shared<MemoryImage>(load_image(path, layer, channels));
}

py::dict compare(const py::object& image, const py::object& reference, bool ssim, bool flip,
                 bool hdr_flip)
{
    const auto open = [](const py::object& value, const std::string& what) {
        const auto read_or_shared =
            is_path(value) ? read(to_path(value, what), "", "any") : to_memory(value, what);
        return colour_of(read_or_shared, what);
    };
    const MemoryImage a = open(image, "image"), b = open(reference, "reference");
    ErrorOptions options;
    options.ssim = ssim;
    options.flip = flip;
    options.hdr_flip = hdr_flip;
    ErrorMeasures measures;
    {
        const py::gil_scoped_release free;
        measures = compare_images(a.pixels.view(), b.pixels.view(), options).a;
    }
    return from_table(measures.table());
}

} // namespace

std::shared_ptr<MemoryImage> to_memory(py::handle value, const std::string& what)
{
    if (py::isinstance<Image>(value)) return value.cast<const Image&>().image;
    return from_array(value, what, {});
}

void add_images(py::module_& module)
{
    py::class_<Image>(module, "Image",
                      "Linear float32 pixels with channel names and windows. Windows are "
                      "(x, y, width, height).")
        .def(py::init([](const py::object& array, std::vector<std::string> channels,
                         const py::object& data_window, const py::object& display_window) {
                 auto image = from_array(array, "Image", std::move(channels));
                 if (!data_window.is_none()) {
                     const Region window = to_region(data_window, "data_window");
                     if (window.width() != image->desc.data.width() ||
                         window.height() != image->desc.data.height())
                         throw UsageError("data_window has another size than the array");
                     // The same pixels under other coordinates.
                     MemoryImage moved;
                     moved.desc = image->desc;
                     moved.desc.data = moved.desc.display = window;
                     moved.pixels = ImageBuffer(window, image->desc.channel_count());
                     for (int y = 0; y < window.height(); ++y)
                         for (int c = 0; c < moved.desc.channel_count(); ++c)
                             std::copy_n(image->pixels.view().row(c, y), window.width(),
                                         moved.pixels.view().row(c, window.y0 + y));
                     *image = std::move(moved);
                 }
                 if (!display_window.is_none())
                     image->desc.display = to_region(display_window, "display_window");
                 return Image{image};
             }),
             py::arg("array"), py::arg("channels") = std::vector<std::string>{},
             py::arg("data_window") = py::none(), py::arg("display_window") = py::none(),
             "Copies an array of height × width (× channels) numbers. Without names one channel is "
             "Y, three are R, G, B, four R, G, B, A.")
        .def_property_readonly("pixels", &pixels_of,
                               "The pixels as a height × width × channels array that shares the "
                               "image's memory.")
        .def(
            "__array__",
            [](const py::object& self, const py::args& args, const py::kwargs& more) -> py::object {
                return args.empty() && more.empty() ? py::object(pixels_of(self))
                                                    : pixels_of(self).attr("astype")(*args);
            })
        .def(
            "__getitem__",
            [](const py::object& self, const std::string& name) {
                const ImageDesc& desc = self.cast<const Image&>().image->desc;
                const int c = desc.channel(name);
                if (c < 0)
                    throw py::key_error("no channel '" + name + "'; there is " +
                                        join_names(desc.channels, true));
                return py::object(pixels_of(self)[py::make_tuple(py::ellipsis(), c)]);
            },
            "One channel by name, as a height × width array that shares the image's memory.")
        .def_property_readonly("channels", [](const Image& i) { return i.image->desc.channels; })
        .def_property_readonly("data_window",
                               [](const Image& i) { return from_region(i.image->desc.data); })
        .def_property_readonly("display_window",
                               [](const Image& i) { return from_region(i.image->desc.display); })
        .def("__repr__", [](const Image& i) {
            const ImageDesc& d = i.image->desc;
            return "<rayloom.Image " + d.data.text() + " " + join_names(d.channels, true) + ">";
        });

    module.def(
        "read",
        [](const py::object& path, const std::string& layer, const std::string& channels) {
            return Image{read(to_path(path, "read"), layer, channels)};
        },
        py::arg("path"), py::arg("layer") = "", py::arg("channels") = "any",
        "Reads a layer of a file (without a name: the beauty, whichever renderer wrote it).");
    module.def("compare", &compare, py::arg("image"), py::arg("reference"), py::kw_only(),
               py::arg("ssim") = true, py::arg("flip") = true, py::arg("hdr_flip") = false,
               "All error measures of an image against a reference (files, images or arrays), as a "
               "dict; docs/measures.md defines them.");
}

} // namespace rayloom::python
