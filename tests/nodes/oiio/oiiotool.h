// SPDX-License-Identifier: Apache-2.0
/// \file
/// The same operation by the oiiotool command, for comparison.
#pragma once

#include "tests/support/temporary_folder.h"
#include "tests/support/tiled_node.h"

#include <OpenImageIO/imagebuf.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace rayloom::node_test
{

inline bool have_oiiotool()
{
    static const bool yes = std::system("oiiotool --version > /dev/null 2>&1") == 0;
    return yes;
}

inline void write_exr(const TestImage& image, const std::string& path)
{
    OIIO::ImageSpec spec(image.desc.data.width(), image.desc.data.height(),
                         image.desc.channel_count(), OIIO::TypeDesc::FLOAT);
    spec.x = image.desc.data.x0;
    spec.y = image.desc.data.y0;
    spec.full_x = image.desc.display.x0;
    spec.full_y = image.desc.display.y0;
    spec.full_width = image.desc.display.width();
    spec.full_height = image.desc.display.height();
    spec.channelnames = image.desc.channels;
    spec.alpha_channel = image.desc.alpha();
    OIIO::ImageBuf buffer(spec);
    std::vector<float> pixel(image.desc.channels.size());
    for (int y = image.desc.data.y0; y < image.desc.data.y1; ++y)
        for (int x = image.desc.data.x0; x < image.desc.data.x1; ++x) {
            for (std::size_t c = 0; c < pixel.size(); ++c)
                pixel[c] = image.pixels.view().at(static_cast<int>(c), x, y);
            buffer.setpixel(x, y, 0, pixel.data());
        }
    if (!buffer.write(path)) throw std::runtime_error(buffer.geterror());
}

inline TestImagePtr read_exr(const std::string& path)
{
    OIIO::ImageBuf buffer(path);
    if (!buffer.read(0, 0, true, OIIO::TypeDesc::FLOAT))
        throw std::runtime_error(buffer.geterror());
    auto image = std::make_shared<TestImage>();
    const OIIO::ROI data = buffer.roi(), full = buffer.roi_full();
    image->desc.data = {data.xbegin, data.ybegin, data.xend, data.yend};
    image->desc.display = {full.xbegin, full.ybegin, full.xend, full.yend};
    image->desc.channels = buffer.spec().channelnames;
    image->pixels = ImageBuffer(image->desc.data, image->desc.channel_count());
    for (OIIO::ImageBuf::ConstIterator<float> p(buffer); !p.done(); ++p)
        for (int c = 0; c < image->desc.channel_count(); ++c)
            image->pixels.view().at(c, p.x(), p.y()) = p[c];
    return image;
}

/// Runs oiiotool on images; `%name` in the command stands for the image of that name.
inline TestImagePtr oiiotool(const std::string& command,
                             const std::map<std::string, TestImagePtr>& images)
{
    const test::TemporaryFolder folder;
    std::string line = command;
    for (const auto& [name, image] : images) {
        const std::string path = folder.file(name + ".exr");
        bool used = false;
        for (std::size_t at; (at = line.find("%" + name)) != std::string::npos; used = true)
            line.replace(at, name.size() + 1, path);
        if (used) write_exr(*image, path);
    }
    const std::string out = folder.file("out.exr"), log = folder.file("log.txt");
    const std::string all =
        "env -u OCIO oiiotool " + line + " -d float -o " + out + " > " + log + " 2>&1";
    if (std::system(all.c_str()) != 0 || !std::filesystem::exists(out)) {
        std::stringstream text;
        text << std::ifstream(log).rdbuf();
        throw std::runtime_error(all + "\n" + text.str());
    }
    return read_exr(out);
}

} // namespace rayloom::node_test
