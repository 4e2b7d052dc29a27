// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/engine_nodes.h"

#include "rayloom/core/error.h"
#include "rayloom/core/parallel.h"
#include "rayloom/image/deep_rows.h"

#include <OpenImageIO/hash.h>
#include <OpenImageIO/imagebufalgo.h>

#include <algorithm>
#include <cstdint>
#include <vector>

namespace rayloom
{

MemoryImage to_memory_image(const OIIO::ImageBuf& buffer)
{
    if (buffer.has_error()) throw InputError(buffer.geterror());
    if (!buffer.initialized() || buffer.deep())
        throw InputError("an image in memory holds no pixels");
    const OIIO::ImageSpec& spec = buffer.spec();
    MemoryImage image;
    image.desc.data = {spec.x, spec.y, spec.x + spec.width, spec.y + spec.height};
    image.desc.display = {spec.full_x, spec.full_y, spec.full_x + spec.full_width,
                          spec.full_y + spec.full_height};
    image.desc.channels = spec.channelnames;
    image.desc.header = std::make_shared<const OIIO::ImageSpec>(buffer.nativespec());
    image.pixels = ImageBuffer(image.desc.data, spec.nchannels);
    std::vector<float> row(static_cast<std::size_t>(spec.width) *
                           static_cast<std::size_t>(spec.nchannels));
    for (int y = image.desc.data.y0; y < image.desc.data.y1; ++y) {
        const OIIO::ROI roi(spec.x, spec.x + spec.width, y, y + 1, 0, 1, 0, spec.nchannels);
        if (!buffer.get_pixels(roi, OIIO::TypeFloat, row.data()))
            throw InputError(buffer.geterror());
        for (int c = 0; c < spec.nchannels; ++c) {
            float* to = image.pixels.view().row(c, y);
            for (int x = 0; x < spec.width; ++x)
                to[x] = row[static_cast<std::size_t>(x * spec.nchannels + c)];
        }
    }
    return image;
}

OIIO::ImageBuf to_image_buf(const MemoryImage& image)
{
    OIIO::ImageSpec spec = image.desc.header ? *image.desc.header : OIIO::ImageSpec();
    const Region &data = image.desc.data, &display = image.desc.display;
    spec.x = data.x0;
    spec.y = data.y0;
    spec.z = 0;
    spec.width = data.width();
    spec.height = data.height();
    spec.depth = 1;
    spec.full_x = display.x0;
    spec.full_y = display.y0;
    spec.full_width = display.width();
    spec.full_height = display.height();
    spec.tile_width = spec.tile_height = 0;
    spec.nchannels = image.desc.channel_count();
    spec.channelnames = image.desc.channels;
    spec.channelformats.clear();
    spec.alpha_channel = image.desc.alpha();
    spec.deep = false;
    spec.set_format(OIIO::TypeFloat);
    OIIO::ImageBuf buffer(spec);
    std::vector<float> row(static_cast<std::size_t>(spec.width) *
                           static_cast<std::size_t>(spec.nchannels));
    for (int y = data.y0; y < data.y1; ++y) {
        for (int c = 0; c < spec.nchannels; ++c) {
            const float* from = image.pixels.view().row(c, y);
            for (int x = 0; x < spec.width; ++x)
                row[static_cast<std::size_t>(x * spec.nchannels + c)] = from[x];
        }
        buffer.set_pixels(OIIO::ROI(data.x0, data.x1, y, y + 1, 0, 1, 0, spec.nchannels),
                          OIIO::TypeFloat, row.data());
    }
    return buffer;
}

void MemorySource::plan(PlanContext& context)
{
    if (m_image->pixels.region() != m_image->desc.data ||
        m_image->pixels.channels() != m_image->desc.channel_count())
        throw NodeError("the pixels of an image in memory do not fit its description");
    context.output("image", m_image->desc);
    context.cheap();
}

void MemorySource::compute(const TileContext& context) const
{
    copy_pixels(m_image->pixels.view(), context.output("image"));
}

std::string MemorySource::content_key(bool thorough) const
{
    const ConstImageView view = m_image->pixels.view();
    // During a run the same place is the same pixels.
    if (!thorough)
        return std::to_string(reinterpret_cast<std::uintptr_t>(view.data())) +
               m_image->desc.data.text();
    std::uint64_t hash = 0;
    for (int y = view.region().y0; y < view.region().y1; ++y)
        for (int c = 0; c < view.channels(); ++c)
            hash = OIIO::xxhash::XXH64(view.row(c, y), view.row_span(c, y).size_bytes(), hash);
    return std::to_string(hash) + m_image->desc.data.text();
}

void MemorySink::plan(PlanContext& context)
{
    const ImageDesc& desc = context.input("image");
    context.sink(desc.data);
    m_image = std::make_shared<MemoryImage>();
    m_image->desc = desc;
}

void MemorySink::compute(const TileContext& context) const
{
    if (m_image->pixels.region() != m_image->desc.data)
        m_image->pixels = ImageBuffer(m_image->desc.data, m_image->desc.channel_count());
    // A strip comes on one thread; as others wait for it, they take part.
    const ConstImageView from = context.input("image");
    const Region& strip = context.region();
    constexpr int rows = 32;
    parallel_for<int>(0, (strip.height() + rows - 1) / rows, 1, [&](int i) {
        Region part = strip;
        part.y0 = strip.y0 + i * rows;
        part.y1 = std::min(strip.y1, part.y0 + rows);
        copy_pixels(from, m_image->pixels.view().crop(part));
    });
}

void MemoryDeepSource::plan(PlanContext& context)
{
    const ImageDesc& desc = m_deep->desc;
    bool fits = m_deep->rows.size() == static_cast<std::size_t>(desc.data.height());
    for (const auto& row : m_deep->rows) {
        fits = fits && row && deep_row_fits(*row, desc.data.width(), desc.channel_count());
        if (fits) m_row_samples = std::max<std::size_t>(m_row_samples, row->first.back());
    }
    if (!fits) throw NodeError("the rows of a deep image in memory do not fit its description");
    context.output("deep", desc);
    context.access(Access::rows);
    context.cheap();
}

std::string MemoryDeepSource::content_key(bool) const
{
    std::uint64_t hash = 0;
    const auto add = [&](const auto& values) {
        hash = OIIO::xxhash::XXH64(values.data(), std::span(values).size_bytes(), hash);
    };
    for (const auto& row : m_deep->rows) {
        add(row->first);
        for (const auto& channel : row->samples) add(channel);
    }
    return std::to_string(hash) + m_deep->desc.data.text();
}

void MemoryDeepSink::plan(PlanContext& context)
{
    const ImageDesc& desc = context.input("deep");
    context.sink(desc.data);
    m_deep = std::make_shared<MemoryDeep>();
    m_deep->desc = desc;
}

void MemoryDeepSink::compute(const TileContext& context) const
{
    const DeepView deep = context.deep("deep");
    const Region& wanted = context.region();
    for (int y = wanted.y0; y < wanted.y1; ++y) {
        const auto& row = deep.rows[static_cast<std::size_t>(y - deep.region.y0)];
        const int x0 = wanted.x0 - deep.region.x0, x1 = wanted.x1 - deep.region.x0;
        m_deep->rows.push_back(wanted.width() == deep.region.width()
                                   ? row
                                   : std::make_shared<const DeepRow>(deep_columns(*row, x0, x1)));
    }
}

void ConstantNode::compute(const TileContext& context) const
{
    const ImageView out = context.output("image");
    for (int y = out.region().y0; y < out.region().y1; ++y)
        for (int c = 0; c < out.channels(); ++c) std::ranges::fill(out.row_span(c, y), m_value);
}

} // namespace rayloom
