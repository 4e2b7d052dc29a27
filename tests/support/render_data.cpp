// SPDX-License-Identifier: Apache-2.0
#include "tests/support/render_data.h"

#include "tests/support/folders.h"

#include <OpenImageIO/imageio.h>

#include <array>
#include <cstdio>
#include <cstdlib>

namespace rayloom::test
{

std::optional<std::filesystem::path> large_data()
{
    if (const char* folder = std::getenv("RAYLOOM_DATA"); folder && *folder) return folder;
    const std::filesystem::path source = test::source_folder();
    for (const char* above : {"../shared/data", "../../shared/data"})
        if (std::filesystem::is_directory(source / above)) return source / above;
    return std::nullopt;
}

TestImage read_render(const std::filesystem::path& file, const std::string& layer)
{
    const auto in = OIIO::ImageInput::open(file.string());
    if (!in) throw InputError(OIIO::geterror());
    const OIIO::ImageSpec& spec = in->spec();
    TestImage image;
    image.desc.data = {spec.x, spec.y, spec.x + spec.width, spec.y + spec.height};
    image.desc.display = {spec.full_x, spec.full_y, spec.full_x + spec.full_width,
                          spec.full_y + spec.full_height};
    std::vector<int> kept;
    for (int c = 0; c < spec.nchannels; ++c) {
        const std::string& name = spec.channelnames[static_cast<std::size_t>(c)];
        const auto dot = name.rfind('.');
        if (!layer.empty() && (dot == std::string::npos || name.substr(0, dot) != layer)) continue;
        kept.push_back(c);
        image.desc.channels.push_back(dot == std::string::npos ? name : name.substr(dot + 1));
    }
    if (kept.empty()) throw InputError(file.string() + " has no layer " + layer);
    image.pixels = ImageBuffer(image.desc.data, image.desc.channel_count());
    std::vector<float> row(static_cast<std::size_t>(spec.width * spec.nchannels));
    for (int y = 0; y < spec.height; ++y) {
        if (!in->read_scanlines(0, 0, spec.y + y, spec.y + y + 1, 0, 0, spec.nchannels,
                                OIIO::TypeDesc::FLOAT, row.data()))
            throw InputError(in->geterror());
        for (std::size_t k = 0; k < kept.size(); ++k)
            for (int x = 0; x < spec.width; ++x)
                image.view().at(static_cast<int>(k), spec.x + x, spec.y + y) =
                    row[static_cast<std::size_t>(x * spec.nchannels + kept[k])];
    }
    return image;
}

std::vector<TestImage> read_stack(const std::filesystem::path& folder, int count)
{
    std::vector<TestImage> stack;
    for (int i = 1; i <= count; ++i) {
        std::array<char, 16> name{};
        std::snprintf(name.data(), name.size(), "s%02d.exr", i);
        stack.push_back(read_render(folder / "stack" / name.data(), "ViewLayer.Combined"));
    }
    return stack;
}

} // namespace rayloom::test
