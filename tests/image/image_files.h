// SPDX-License-Identifier: Apache-2.0
/// \file
/// Small image files made by tests in a folder of their own.
#pragma once

#include "rayloom/core/error.h"
#include "tests/support/temporary_folder.h"

#include <OpenImageIO/deepdata.h>
#include <OpenImageIO/imagebuf.h>
#include <OpenImageIO/imageio.h>

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <string>
#include <vector>

namespace rayloom::test
{

struct Channel {
    std::string name;
    OIIO::TypeDesc type = OIIO::TypeHalf;
};

struct Part {
    std::string name;
    std::vector<Channel> channels;
    int x = 0, y = 0, width = 20, height = 37;
    int full_x = 0, full_y = 0, full_width = 0, full_height = 0; ///< 0: the data window
    int tile_width = 0, tile_height = 0;
    std::string compression = "zip";
    std::function<void(OIIO::ImageSpec&)> header = {};
};

/// The bits stored at a pixel: any pattern that differs everywhere, for half including NaNs,
/// infinities and subnormals.
inline std::uint32_t pattern(int part, int channel, int x, int y)
{
    std::uint32_t h = static_cast<std::uint32_t>(x) * 73856093u ^
                      static_cast<std::uint32_t>(y) * 19349663u ^
                      static_cast<std::uint32_t>(part * 64 + channel + 1) * 83492791u;
    h ^= h >> 15;
    h *= 0x2c1b3c6du;
    return h ^ (h >> 12);
}

inline OIIO::ImageSpec spec_of(const Part& part)
{
    OIIO::ImageSpec spec(part.width, part.height, static_cast<int>(part.channels.size()),
                         part.channels.front().type);
    spec.x = part.x;
    spec.y = part.y;
    spec.full_x = part.full_width != 0 ? part.full_x : part.x;
    spec.full_y = part.full_width != 0 ? part.full_y : part.y;
    spec.full_width = part.full_width != 0 ? part.full_width : part.width;
    spec.full_height = part.full_width != 0 ? part.full_height : part.height;
    spec.tile_width = part.tile_width;
    spec.tile_height = part.tile_height;
    spec.channelnames.clear();
    for (const Channel& c : part.channels) {
        spec.channelnames.push_back(c.name);
        spec.channelformats.push_back(c.type);
    }
    spec.attribute("compression", part.compression);
    if (!part.name.empty()) spec.attribute("oiio:subimagename", part.name);
    if (part.header) part.header(spec);
    return spec;
}

/// Bytes of a part's pixels, channels interleaved in their own types. Half and float patterns are
/// kept finite unless asked otherwise, so that lossy checks make sense.
inline std::vector<std::byte> pixels_of(const Part& part, int index, bool any_bits)
{
    std::vector<std::byte> out;
    for (int y = part.y; y < part.y + part.height; ++y)
        for (int x = part.x; x < part.x + part.width; ++x)
            for (std::size_t c = 0; c < part.channels.size(); ++c) {
                std::uint32_t bits = pattern(index, static_cast<int>(c), x, y);
                const OIIO::TypeDesc type = part.channels[c].type;
                if (type == OIIO::TypeHalf && !any_bits) bits &= 0x3bffu;
                if (type == OIIO::TypeFloat && !any_bits) bits &= 0x3fffffffu;
                const auto* bytes = reinterpret_cast<const std::byte*>(&bits);
                out.insert(out.end(), bytes, bytes + type.size());
            }
    return out;
}

/// Writes the parts as one EXR; EXPECTs that it worked.
inline void write_exr(const std::string& path, const std::vector<Part>& parts,
                      bool any_bits = false)
{
    std::vector<OIIO::ImageSpec> specs;
    specs.reserve(parts.size());
    for (const Part& part : parts) specs.push_back(spec_of(part));
    auto out = OIIO::ImageOutput::create(path);
    ASSERT_TRUE(out);
    ASSERT_TRUE(out->open(path, static_cast<int>(specs.size()), specs.data())) << out->geterror();
    for (std::size_t i = 0; i < parts.size(); ++i) {
        if (i > 0) {
            ASSERT_TRUE(out->open(path, specs[i], OIIO::ImageOutput::AppendSubimage))
                << out->geterror();
        }
        const auto pixels = pixels_of(parts[i], static_cast<int>(i), any_bits);
        ASSERT_TRUE(out->write_image(OIIO::TypeUnknown, pixels.data())) << out->geterror();
    }
    ASSERT_TRUE(out->close()) << out->geterror();
}

/// A float image of one part, filled by `value(x, y, channel)`.
inline void write_float(const std::string& path, int width, int height,
                        const std::vector<std::string>& channels,
                        const std::function<float(int, int, int)>& value, int x0 = 0, int y0 = 0)
{
    OIIO::ImageSpec spec(width, height, static_cast<int>(channels.size()), OIIO::TypeFloat);
    spec.x = x0;
    spec.y = y0;
    spec.channelnames = channels;
    std::vector<float> pixels;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < spec.nchannels; ++c) pixels.push_back(value(x + x0, y + y0, c));
    auto out = OIIO::ImageOutput::create(path);
    ASSERT_TRUE(out && out->open(path, spec));
    ASSERT_TRUE(out->write_image(OIIO::TypeFloat, pixels.data()));
    ASSERT_TRUE(out->close());
}

inline std::vector<char> bytes_of(const std::string& path)
{
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

/// Message of the rayloom error a call throws; empty when it throws none.
template <class Call>
std::string message_of(const Call& call)
{
    try {
        call();
    } catch (const Error& e) {
        return e.what();
    }
    return "";
}

} // namespace rayloom::test
