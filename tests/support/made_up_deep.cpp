// SPDX-License-Identifier: Apache-2.0
#include "tests/support/made_up_deep.h"

#include "rayloom/image/deep_rows.h"

#include <OpenImageIO/deepdata.h>
#include <OpenImageIO/imageio.h>

#include <bit>
#include <cmath>
#include <random>
#include <sstream>
#include <stdexcept>

namespace rayloom::test
{

MemoryDeep make_deep(const Region& window, std::vector<std::string> channels,
                     const std::function<int(int, int)>& samples,
                     const std::function<float(int, int, int, int)>& value)
{
    MemoryDeep deep;
    deep.desc.data = window;
    // Overscan on one side, cut off on the other.
    deep.desc.display = window.shifted(3, -2);
    deep.desc.channels = std::move(channels);
    for (int y = window.y0; y < window.y1; ++y) {
        DeepRow row;
        row.first.push_back(0);
        row.samples.resize(deep.desc.channels.size());
        for (int x = window.x0; x < window.x1; ++x) {
            const int n = samples(x, y);
            row.first.push_back(row.first.back() + static_cast<std::uint32_t>(n));
            for (std::size_t c = 0; c < row.samples.size(); ++c)
                for (int s = 0; s < n; ++s)
                    row.samples[c].push_back(value(static_cast<int>(c), x, y, s));
        }
        deep.rows.push_back(std::make_shared<const DeepRow>(std::move(row)));
    }
    return deep;
}

MemoryDeep made_up_deep(const Region& window, unsigned seed)
{
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> share(0.0f, 1.0f);
    std::exponential_distribution<float> light(1.0f);
    return make_deep(
        window, {"R", "G", "B", "A", "Z"},
        [&](int x, int y) { return static_cast<int>((x * 5u + y * 3u) % 7u); },
        [&](int c, int, int, int) {
            const float v = share(random);
            if (c == 4) return 1.0f + 9.0f * v;
            if (c == 3) return v < 0.1f ? 0.0f : v > 0.9f ? 1.0f : v;
            return v < 0.2f ? 0.0f : light(random);
        });
}

MemoryDeep with_values(const MemoryDeep& deep,
                       const std::function<float(int, int, int, float)>& value)
{
    MemoryDeep out;
    out.desc = deep.desc;
    const Region& r = deep.desc.data;
    for (int y = r.y0; y < r.y1; ++y) {
        DeepRow row = *deep.rows[static_cast<std::size_t>(y - r.y0)];
        for (int c = 0; c < deep.desc.channel_count(); ++c)
            for (int x = r.x0; x < r.x1; ++x) {
                const auto i = static_cast<std::size_t>(x - r.x0);
                for (std::uint32_t s = row.first[i]; s < row.first[i + 1]; ++s) {
                    float& v = row.samples[static_cast<std::size_t>(c)][s];
                    v = value(c, x, y, v);
                }
            }
        out.rows.push_back(std::make_shared<const DeepRow>(std::move(row)));
    }
    return out;
}

MemoryDeep cropped(const MemoryDeep& deep, const Region& window)
{
    MemoryDeep out;
    out.desc = deep.desc;
    const Region& r = deep.desc.data;
    out.desc.data = r.intersect(window);
    for (int y = out.desc.data.y0; y < out.desc.data.y1; ++y)
        out.rows.push_back(std::make_shared<const DeepRow>(
            deep_columns(*deep.rows[static_cast<std::size_t>(y - r.y0)], out.desc.data.x0 - r.x0,
                         out.desc.data.x1 - r.x0)));
    return out;
}

::testing::AssertionResult same_samples(const MemoryDeep& a, const MemoryDeep& b)
{
    const auto no = [] { return ::testing::AssertionFailure(); };
    if (a.desc.data != b.desc.data)
        return no() << "windows " << a.desc.data.text() << " and " << b.desc.data.text();
    if (a.desc.channels != b.desc.channels) return no() << "other channels";
    if (a.rows.size() != b.rows.size()) return no() << "other number of rows";
    for (std::size_t y = 0; y < a.rows.size(); ++y) {
        if (a.rows[y]->first != b.rows[y]->first) return no() << "other samples in row " << y;
        if (a.rows[y]->samples.size() != b.rows[y]->samples.size())
            return no() << "other channels in row " << y;
        for (std::size_t c = 0; c < a.rows[y]->samples.size(); ++c)
            for (std::size_t s = 0; s < a.rows[y]->samples[c].size(); ++s) {
                const float u = a.rows[y]->samples[c][s], v = b.rows[y]->samples[c][s];
                if (std::bit_cast<std::uint32_t>(u) != std::bit_cast<std::uint32_t>(v) &&
                    !(std::isnan(u) && std::isnan(v)))
                    return no() << "row " << y << " channel " << c << " sample " << s << ": " << u
                                << " and " << v;
            }
    }
    return ::testing::AssertionSuccess();
}

::testing::AssertionResult all_finite(const MemoryDeep& deep)
{
    for (std::size_t y = 0; y < deep.rows.size(); ++y)
        for (std::size_t c = 0; c < deep.rows[y]->samples.size(); ++c)
            for (const float v : deep.rows[y]->samples[c])
                if (!std::isfinite(v))
                    return ::testing::AssertionFailure()
                           << "row " << y << " channel " << c << " holds " << v;
    return ::testing::AssertionSuccess();
}

std::vector<float> samples_at(const MemoryDeep& deep, int channel, int x, int y)
{
    const Region& r = deep.desc.data;
    const auto values = deep.rows.at(static_cast<std::size_t>(y - r.y0))->pixel(channel, x - r.x0);
    return {values.begin(), values.end()};
}

std::vector<oracle::DeepSample> samples_of(const MemoryDeep& deep, int channel, int x, int y)
{
    const auto values = samples_at(deep, channel, x, y), alpha = samples_at(deep, 3, x, y),
               depth = samples_at(deep, 4, x, y);
    std::vector<oracle::DeepSample> samples;
    for (std::size_t s = 0; s < values.size(); ++s)
        samples.push_back({values[s], alpha[s], depth[s]});
    return samples;
}

void write_deep_exr(const std::string& path, const MemoryDeep& deep,
                    const std::vector<std::string>& types, bool tiled,
                    const std::function<std::uint32_t(int, int, int)>& ids)
{
    const Region &d = deep.desc.data, &w = deep.desc.display;
    OIIO::ImageSpec spec(d.width(), d.height(), deep.desc.channel_count(), OIIO::TypeFloat);
    spec.x = d.x0;
    spec.y = d.y0;
    spec.full_x = w.x0;
    spec.full_y = w.y0;
    spec.full_width = w.width();
    spec.full_height = w.height();
    spec.channelnames = deep.desc.channels;
    for (const std::string& type : types)
        spec.channelformats.push_back(type == "uint" ? OIIO::TypeUInt : OIIO::TypeDesc(type));
    if (tiled) spec.tile_width = spec.tile_height = 8;
    spec.deep = true;
    spec.attribute("compression", "zips");
    spec.attribute("Software", "made up");
    spec.attribute("rayloom:note", "kept");
    OIIO::DeepData data(spec);
    const auto each_pixel = [&](const auto& visit) {
        std::int64_t pixel = 0;
        for (int y = d.y0; y < d.y1; ++y)
            for (int x = d.x0; x < d.x1; ++x) visit(pixel++, x, y);
    };
    // Every number of samples before the first sample: afterwards each would move all that follow.
    each_pixel([&](std::int64_t pixel, int x, int y) {
        data.set_samples(pixel, static_cast<int>(samples_at(deep, 0, x, y).size()));
    });
    each_pixel([&](std::int64_t pixel, int x, int y) {
        for (int c = 0; c < spec.nchannels; ++c) {
            const std::vector<float> values = samples_at(deep, c, x, y);
            for (int s = 0; s < data.samples(pixel); ++s)
                if (types[static_cast<std::size_t>(c)] == "uint")
                    data.set_deep_value(pixel, c, s, ids(x, y, s));
                else
                    data.set_deep_value(pixel, c, s, values[static_cast<std::size_t>(s)]);
        }
    });
    const auto out = OIIO::ImageOutput::create(path);
    if (!out || !out->open(path, spec) || !out->write_deep_image(data) || !out->close())
        throw std::runtime_error(path + ": " + (out ? out->geterror() : OIIO::geterror()));
}

std::string deep_exr_text(const std::string& path)
{
    const auto in = OIIO::ImageInput::open(path);
    if (!in) throw std::runtime_error(path + ": " + OIIO::geterror());
    const OIIO::ImageSpec spec = in->spec();
    OIIO::DeepData data;
    if (!in->read_native_deep_image(0, 0, data)) throw std::runtime_error(in->geterror());
    std::ostringstream text;
    text << spec.x << ' ' << spec.y << ' ' << spec.width << ' ' << spec.height << ' ' << spec.full_x
         << ' ' << spec.full_y << ' ' << spec.full_width << ' ' << spec.full_height << '\n';
    for (int c = 0; c < spec.nchannels; ++c)
        text << spec.channelnames[static_cast<std::size_t>(c)] << ' '
             << spec.channelformat(c).c_str() << '\n';
    for (std::int64_t p = 0; p < data.pixels(); ++p) {
        text << data.samples(p) << ':';
        for (int c = 0; c < data.channels(); ++c)
            for (int s = 0; s < data.samples(p); ++s) {
                const bool id = data.channeltype(c).basetype == OIIO::TypeDesc::UINT32;
                text << ' ' << std::hex
                     << (id ? data.deep_value_uint(p, c, s)
                            : std::bit_cast<std::uint32_t>(data.deep_value(p, c, s)))
                     << std::dec;
            }
        text << '\n';
    }
    return text.str();
}

} // namespace rayloom::test
