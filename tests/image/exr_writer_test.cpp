// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/exr_writer.h"

#include "rayloom/image/exr_reader.h"
#include "tests/image/image_files.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfDeepFrameBuffer.h>
#include <OpenEXR/ImfDeepScanLineOutputPart.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfTiledOutputPart.h>

#include <cmath>
#include <csignal>
#include <limits>
#include <sys/resource.h>
#include <sys/stat.h>

namespace rayloom
{
namespace
{
using namespace test;

bool contains(const std::string& text, const std::string& part)
{
    return text.find(part) != std::string::npos;
}

// An image with the layer's windows, header and channels, filled with a ramp.
struct Image {
    ImageDesc desc;
    ImageBuffer pixels;
};
float ramp(int x, int y, int c)
{
    return 0.25f * static_cast<float>(x) + 0.5f * static_cast<float>(y) + static_cast<float>(c);
}
Image ramp_image(ImageDesc desc)
{
    Image image{desc, ImageBuffer(desc.data, desc.channel_count())};
    for (int y = desc.data.y0; y < desc.data.y1; ++y)
        for (int c = 0; c < desc.channel_count(); ++c)
            for (int x = desc.data.x0; x < desc.data.x1; ++x)
                image.pixels.view().at(c, x, y) = ramp(x, y, c);
    return image;
}
Image ramp_image(const Region& data, std::vector<std::string> channels)
{
    ImageDesc desc;
    desc.data = desc.display = data;
    desc.channels = std::move(channels);
    return ramp_image(desc);
}

void write_in_bands(ImageWriter& writer, const Image& image, int rows)
{
    const Region& d = image.desc.data;
    for (int y = d.y0; y < d.y1; y += rows)
        writer.write(image.pixels.view().crop({d.x0, y, d.x1, std::min(d.y1, y + rows)}));
}

ImageDesc layer_desc(const std::string& path, const char* layer, const char* channels = "any")
{
    const auto file = ImageFile::open(path);
    return file->desc(file->narrow(file->select(layer), channels));
}

// Bits of one channel of a flat part, whatever its type.
std::vector<std::byte> channel_bits(const std::string& path, int part, const std::string& channel)
{
    auto in = OIIO::ImageInput::open(path);
    if (!in || !in->seek_subimage(part, 0)) return {};
    const OIIO::ImageSpec spec = in->spec();
    const int c = spec.channelindex(channel);
    if (c < 0) return {};
    std::vector<std::byte> bits(spec.image_pixels() * spec.channelformat(c).size());
    const bool ok =
        spec.tile_width > 0
            ? in->read_tiles(part, 0, spec.x, spec.x + spec.width, spec.y, spec.y + spec.height, 0,
                             1, c, c + 1, spec.channelformat(c), bits.data())
            : in->read_native_scanlines(part, 0, spec.y, spec.y + spec.height, 0, c, c + 1,
                                        bits.data());
    if (!ok) bits.clear();
    return bits;
}

TEST(ImageWriter, KeepsWindowsTypesAndMetadata)
{
    const TemporaryFolder folder;
    Part part{"", {{"L.R"}, {"L.G"}, {"L.B", OIIO::TypeFloat}}, -3, -4, 21, 37, -1, -2, 15, 30};
    part.compression = "piz";
    part.header = [](OIIO::ImageSpec& spec) {
        spec.attribute("note", "someone");
        spec.attribute("samples", 16);
        spec.attribute("cryptomatte/abc/name", "CryptoObject");
    };
    write_exr(folder.file("in.exr"), {part});
    const Image image = ramp_image(layer_desc(folder.file("in.exr"), "L"));
    ImageWriter writer(image.desc, {folder.file("out.exr"), "", "", "New.Layer", ""});
    write_in_bands(writer, image, 5);
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"in.exr"}))
        << "no name before it is complete";
    writer.commit();
    const auto file = ImageFile::open(folder.file("out.exr"));
    const PartInfo& out = file->parts().at(0);
    EXPECT_EQ(out.data, (Region{-3, -4, 18, 33}));
    EXPECT_EQ(out.display, (Region{-1, -2, 14, 28}));
    EXPECT_EQ(out.spec->get_string_attribute("note"), "someone");
    EXPECT_EQ(out.spec->get_int_attribute("samples"), 16);
    EXPECT_EQ(out.spec->get_string_attribute("compression"), "piz");
    EXPECT_EQ(out.spec->find_attribute("cryptomatte/abc/name"), nullptr)
        << "its layers are not here";
    const ChannelSelection s = file->select("New.Layer");
    EXPECT_EQ(s.names, (std::vector<std::string>{"R", "G", "B"}));
    EXPECT_EQ(out.spec->channelformat(0), OIIO::TypeHalf);
    EXPECT_EQ(out.spec->channelformat(2), OIIO::TypeFloat);
    ImageBuffer back(out.data, 3);
    ImageReader(file, s).read(back.view());
    for (int c = 0; c < 3; ++c) EXPECT_EQ(back.view().at(c, 7, 32), ramp(7, 32, c));
}

TEST(ImageWriter, TheSameBytesWhateverTheBands)
{
    const TemporaryFolder folder;
    // Without a date of its own a file has that of its writing.
    Part part{"", {{"R"}, {"G"}, {"B"}}, 0, 0, 40, 71, 0, 0, 40, 71};
    part.header = [](OIIO::ImageSpec& spec) { spec.attribute("DateTime", "2026:02:03 04:05:06"); };
    write_exr(folder.file("in.exr"), {part});
    const Image image = ramp_image(layer_desc(folder.file("in.exr"), ""));
    std::vector<char> first;
    for (const int rows : {71, 1, 16, 33}) {
        ImageWriter writer(image.desc, {folder.file("a.exr"), "float", "zip", "", ""});
        write_in_bands(writer, image, rows);
        writer.commit();
        const std::vector<char> bytes = bytes_of(folder.file("a.exr"));
        if (first.empty()) first = bytes;
        EXPECT_EQ(bytes.size(), first.size()) << rows;
        EXPECT_EQ(channel_bits(folder.file("a.exr"), 0, "G").size(), 40u * 71u * 4u);
        EXPECT_TRUE(bytes == first) << rows;
    }
}

TEST(ImageWriter, CountsWhatHalfCannotHold)
{
    const TemporaryFolder folder;
    Image image = ramp_image({0, 0, 8, 8}, {"R", "G", "B"});
    image.pixels.view().at(0, 1, 1) = 1e6f;
    image.pixels.view().at(1, 2, 2) = -70000.0f;
    image.pixels.view().at(2, 3, 3) = std::numeric_limits<float>::quiet_NaN();
    ImageWriter writer(image.desc, {folder.file("a.exr"), "half", "", "", ""});
    write_in_bands(writer, image, 8);
    writer.commit();
    EXPECT_EQ(writer.counts().half_overflows, 2u);
    EXPECT_EQ(writer.counts().non_finite, 1u);
    const auto file = ImageFile::open(folder.file("a.exr"));
    ImageBuffer back(image.desc.data, 3);
    ImageReader(file, file->select("")).read(back.view());
    EXPECT_EQ(back.view().at(0, 1, 1), 65504.0f);
    EXPECT_EQ(back.view().at(1, 2, 2), -65504.0f);
    EXPECT_TRUE(std::isnan(back.view().at(2, 3, 3)));
}

const std::vector<Channel> render_channels = {{"V.Combined.R"},
                                              {"V.Combined.G"},
                                              {"V.Combined.B"},
                                              {"V.Combined.A"},
                                              {"V.Denoising Normal.X", OIIO::TypeFloat},
                                              {"V.Crypto00.r", OIIO::TypeFloat},
                                              {"V.Crypto00.g", OIIO::TypeFloat},
                                              {"V.IndexOB.X", OIIO::TypeUInt32},
                                              {"V.AO.R"}};

// The promise of the template: all but the written layer is bit for bit what it was, NaNs included.
TEST(ImageWriter, TemplateKeepsEveryOtherBit)
{
    const TemporaryFolder folder;
    for (const int tile : {0, 16})
        for (const char* compression : {"zip", "dwaa", "none"}) {
            Part a{"main", render_channels, -5, 3, 50, 70};
            Part b{"aux", {{"x.R"}, {"x.id", OIIO::TypeUInt32}}, -5, 3, 50, 70};
            a.tile_width = a.tile_height = b.tile_width = b.tile_height = tile;
            a.compression = compression;
            a.header = [](OIIO::ImageSpec& spec) {
                spec.attribute("cryptomatte/abc/name", "V.Crypto");
                spec.attribute("cycles.V.samples", "16");
                const float white[] = {0.1f, 0.2f};
                spec.attribute("whitePoint", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 2), white);
            };
            write_exr(folder.file("in.exr"), {b, a}, std::string(compression) != "dwaa");
            const Image image = ramp_image(layer_desc(folder.file("in.exr"), "Combined", "R,G,B"));
            ImageWriter writer(image.desc,
                               {folder.file("out.exr"), "", "", "Combined", folder.file("in.exr")});
            write_in_bands(writer, image, 16);
            writer.commit();
            const auto in = ImageFile::open(folder.file("in.exr"));
            const auto out = ImageFile::open(folder.file("out.exr"));
            ASSERT_EQ(out->parts().size(), 2u);
            for (int p = 0; p < 2; ++p) {
                const auto& old = *in->parts()[static_cast<std::size_t>(p)].spec;
                const auto& now = *out->parts()[static_cast<std::size_t>(p)].spec;
                EXPECT_EQ(old.channelnames, now.channelnames);
                EXPECT_EQ(old.channelformats, now.channelformats);
                EXPECT_EQ(old.tile_width, now.tile_width);
                for (const auto& attribute : old.extra_attribs)
                    if (attribute.name() != "compression" &&
                        attribute.name() != "openexr:chunkCount" &&
                        !contains(attribute.name().string(), "dwa")) {
                        const auto* kept = now.find_attribute(attribute.name());
                        ASSERT_NE(kept, nullptr) << attribute.name();
                        EXPECT_EQ(kept->get_string(), attribute.get_string());
                    }
                for (const std::string& channel : old.channelnames) {
                    const auto was = channel_bits(folder.file("in.exr"), p, channel);
                    const auto is = channel_bits(folder.file("out.exr"), p, channel);
                    ASSERT_FALSE(was.empty());
                    const bool written = contains(channel, "Combined") && channel.back() != 'A';
                    EXPECT_EQ(was == is, !written) << channel << " " << compression << tile;
                }
            }
            ImageBuffer back(image.desc.data, 3);
            ImageReader(out, out->narrow(out->select("Combined"), "R,G,B")).read(back.view());
            EXPECT_EQ(back.view().at(1, 0, 40), ramp(0, 40, 1));
        }
}

TEST(ImageWriter, TemplateAddsALayerAndOverwritesItself)
{
    const TemporaryFolder folder;
    write_exr(folder.file("a.exr"), {{"", render_channels}});
    const auto before = channel_bits(folder.file("a.exr"), 0, "V.AO.R");
    const Image image = ramp_image({0, 0, 20, 37}, {"R", "G", "B"});
    ImageWriter writer(image.desc,
                       {folder.file("a.exr"), "", "", "Filtered", folder.file("a.exr")});
    write_in_bands(writer, image, 7);
    writer.commit();
    EXPECT_EQ(channel_bits(folder.file("a.exr"), 0, "V.AO.R"), before);
    EXPECT_EQ(ImageFile::open(folder.file("a.exr"))->select("Filtered").names.size(), 3u);
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"a.exr"}));
}

TEST(ImageWriter, TemplateIsCroppedToTheImage)
{
    const TemporaryFolder folder;
    write_exr(folder.file("in.exr"), {{"", render_channels, -5, 3, 50, 70}}, true);
    ImageDesc desc = layer_desc(folder.file("in.exr"), "Combined", "R,G,B");
    desc.data = {2, 10, 12, 40};
    const Image image = ramp_image(desc);
    ImageWriter writer(image.desc,
                       {folder.file("out.exr"), "", "", "Combined", folder.file("in.exr")});
    write_in_bands(writer, image, 4);
    writer.commit();
    const auto all = channel_bits(folder.file("in.exr"), 0, "V.IndexOB.X");
    const auto crop = channel_bits(folder.file("out.exr"), 0, "V.IndexOB.X");
    ASSERT_EQ(crop.size(), 10u * 30u * 4u);
    for (int y = 0; y < 30; ++y)
        EXPECT_EQ(std::memcmp(crop.data() + y * 40, all.data() + ((y + 7) * 50 + 7) * 4, 40), 0);
    desc.data = {-9, 10, 12, 40};
    EXPECT_TRUE(contains(
        message_of([&] {
            ImageWriter(desc, {folder.file("out.exr"), "", "", "Combined", folder.file("in.exr")});
        }),
        "data window"));
}

// Scanlines, tiles and deep samples in one file: structure OpenImageIO itself does not write.
TEST(ImageWriter, TemplateKeepsDeepAndTiledParts)
{
    const TemporaryFolder folder;
    const std::string path = folder.file("in.exr");
    {
        Imf::Header flat(20, 30), tiled(20, 30), deep(20, 30);
        flat.setName("beauty");
        flat.setType(Imf::SCANLINEIMAGE);
        tiled.setName("tiles");
        tiled.setType(Imf::TILEDIMAGE);
        tiled.setTileDescription(Imf::TileDescription(8, 8));
        deep.setName("deep");
        deep.setType(Imf::DEEPSCANLINE);
        deep.compression() = Imf::ZIPS_COMPRESSION;
        for (const char* c : {"R", "G", "B"}) flat.channels().insert(c, Imf::Channel(Imf::HALF));
        tiled.channels().insert("Y", Imf::Channel(Imf::FLOAT));
        deep.channels().insert("Z", Imf::Channel(Imf::FLOAT));
        const std::vector<Imf::Header> headers = {flat, tiled, deep};
        Imf::MultiPartOutputFile out(path.c_str(), headers.data(), 3);
        std::vector<std::uint16_t> halves(600, 0x3c00);
        std::vector<float> floats(600, 0.75f);
        Imf::FrameBuffer f;
        for (const char* c : {"R", "G", "B"})
            f.insert(c, Imf::Slice(Imf::HALF, reinterpret_cast<char*>(halves.data()), 2, 40));
        Imf::OutputPart flat_out(out, 0);
        flat_out.setFrameBuffer(f);
        flat_out.writePixels(30);
        Imf::FrameBuffer t;
        t.insert("Y", Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(floats.data()), 4, 80));
        Imf::TiledOutputPart tiled_out(out, 1);
        tiled_out.setFrameBuffer(t);
        tiled_out.writeTiles(0, tiled_out.numXTiles() - 1, 0, tiled_out.numYTiles() - 1);
        std::vector<unsigned> samples(600, 2);
        std::vector<std::array<float, 2>> values(600);
        std::vector<float*> pointers(600);
        for (std::size_t i = 0; i < 600; ++i) {
            values[i] = {static_cast<float>(i), static_cast<float>(i) + 0.5f};
            pointers[i] = values[i].data();
        }
        Imf::DeepFrameBuffer d;
        d.insertSampleCountSlice(
            Imf::Slice(Imf::UINT, reinterpret_cast<char*>(samples.data()), 4, 80));
        d.insert("Z", Imf::DeepSlice(Imf::FLOAT, reinterpret_cast<char*>(pointers.data()),
                                     sizeof(float*), sizeof(float*) * 20, sizeof(float)));
        Imf::DeepScanLineOutputPart deep_out(out, 2);
        deep_out.setFrameBuffer(d);
        deep_out.writePixels(30);
    }
    const Image image = ramp_image(layer_desc(path, "beauty"));
    ImageWriter writer(image.desc, {folder.file("out.exr"), "", "", "beauty", path});
    write_in_bands(writer, image, 16);
    writer.commit();
    const auto file = ImageFile::open(folder.file("out.exr"));
    ASSERT_EQ(file->parts().size(), 3u);
    EXPECT_TRUE(file->parts()[2].deep);
    EXPECT_EQ(file->parts()[1].spec->tile_width, 8);
    const ImageReader deep(file, file->select("deep"));
    EXPECT_EQ(deep.read_deep_row(29).pixel(0, 19)[1], 599.5f);
    ImageBuffer tiles(file->parts()[1].data, 1);
    ImageReader(file, file->select("tiles")).read(tiles.view());
    EXPECT_EQ(tiles.view().at(0, 19, 29), 0.75f);
    ImageBuffer flat(file->parts()[0].data, 3);
    ImageReader(file, file->select("beauty")).read(flat.view());
    EXPECT_EQ(flat.view().at(2, 3, 29), ramp(3, 29, 2));
    EXPECT_TRUE(contains(message_of([&] {
                             ImageWriter(image.desc, {folder.file("o.exr"), "", "", "deep", path});
                         }),
                         "deep"));
}

TEST(ImageWriter, NothingIsLeftUnlessCommitted)
{
    const TemporaryFolder folder;
    std::ofstream(folder.file("a.exr")) << "earlier";
    const Image image = ramp_image({0, 0, 64, 64}, {"R"});
    {
        ImageWriter writer(image.desc, {folder.file("a.exr"), "", "", "", ""});
        write_in_bands(writer, image, 16);
        writer.abandon();
    }
    {
        ImageWriter destroyed(image.desc, {folder.file("a.exr"), "", "", "", ""});
        write_in_bands(destroyed, image, 64);
    }
    {
        ImageWriter half_way(image.desc, {folder.file("a.exr"), "", "", "", ""});
        half_way.write(image.pixels.view().crop({0, 0, 64, 32}));
        EXPECT_THROW(half_way.commit(), OutputError);
    }
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"a.exr"}));
    const std::vector<char> bytes = bytes_of(folder.file("a.exr"));
    EXPECT_EQ(std::string(bytes.begin(), bytes.end()), "earlier");
}

TEST(ImageWriter, PlacesThatCannotBeWritten)
{
    const TemporaryFolder folder;
    std::ofstream(folder.file("file")) << "x";
    std::filesystem::create_directory(folder.file("dir.exr"));
    const ImageDesc desc = ramp_image({0, 0, 4, 4}, {"R"}).desc;
    const auto refused = [&](const std::string& path) {
        return message_of([&] { ImageWriter(desc, {path, "", "", "", ""}); });
    };
    EXPECT_TRUE(contains(refused(folder.file("file/a.exr")), "file/a.exr"));
    EXPECT_TRUE(contains(refused(folder.file("none/a.exr")), "No such file"));
    EXPECT_TRUE(contains(refused(folder.file("dir.exr")), "folder"));
    EXPECT_TRUE(contains(refused(folder.file("a.nothing")), "'.nothing'"));
    EXPECT_TRUE(contains(refused("/dev/null"), "no file"));
    EXPECT_TRUE(contains(message_of([&] {
                             ImageWriter(desc, {folder.file("a.exr"), "halff", "", "", ""});
                         }),
                         "did you mean 'half'"));
    // The folder goes away while the file is being written.
    std::filesystem::create_directory(folder.file("gone"));
    const Image image = ramp_image({0, 0, 4, 4}, {"R"});
    ImageWriter writer(image.desc, {folder.file("gone/a.exr"), "", "", "", ""});
    write_in_bands(writer, image, 4);
    std::filesystem::remove_all(folder.file("gone"));
    EXPECT_THROW(writer.commit(), OutputError);
}

// OpenEXR cuts names at 255 bytes: channels of one long layer would become one.
TEST(ImageWriter, NamesAnExrCannotHoldAreRefused)
{
    const TemporaryFolder folder;
    const auto refused = [&](std::vector<std::string> channels, const std::string& layer,
                             const char* file) {
        const ImageDesc desc = ramp_image({0, 0, 4, 4}, std::move(channels)).desc;
        const std::string path = folder.file(file);
        return message_of([&] { ImageWriter(desc, {path, "", "", layer, ""}); });
    };
    EXPECT_EQ(refused({"R", "G"}, std::string(253, 'l'), "a.exr"), "");
    EXPECT_TRUE(contains(refused({"R", "G"}, std::string(254, 'l'), "a.exr"), "256 bytes"));
    EXPECT_TRUE(contains(refused({"R", "G", "R"}, "", "a.exr"), "two channels named 'R'"));
    EXPECT_TRUE(contains(refused({"R", "G", "B"}, "l", "a.png"), "'l' can be written to EXR"));
    // In the place of another layer, too.
    write_exr(folder.file("whole.exr"), {{"", {{"R"}, {"G"}}, 0, 0, 4, 4}});
    const ImageDesc desc = ramp_image({0, 0, 4, 4}, {"R", "G"}).desc;
    const std::string whole = folder.file("whole.exr");
    const std::string message = message_of([&] {
        ImageWriter(desc, {folder.file("b.exr"), "", "", std::string(254, 'l'), whole});
    });
    EXPECT_TRUE(contains(message, "256 bytes")) << message;
}

TEST(ImageWriter, LevelsOfCompression)
{
    const TemporaryFolder folder;
    write_exr(folder.file("whole.exr"), {{"", {{"R"}, {"G"}}, 0, 0, 40, 40}});
    Image image = ramp_image({0, 0, 40, 40}, {"R", "G"});
    const auto bytes = [&](const std::string& compression, const char* whole) {
        const std::string path = folder.file("a.exr");
        ImageWriter writer(image.desc,
                           {path, "", compression, "", *whole != 0 ? folder.file(whole) : ""});
        write_in_bands(writer, image, 40);
        writer.commit();
        return bytes_of(path);
    };
    const auto refused = [&](const std::string& compression) {
        return message_of([&] {
            ImageWriter(image.desc, {folder.file("a.exr"), "", compression, "", ""});
        });
    };
    for (const char* whole : {"", "whole.exr"})
        EXPECT_LT(bytes("dwaa:5000", whole).size(), bytes("dwaa:1", whole).size()) << whole;
    for (const char* good : {"zip:9", "zips:1", "dwab:0.5", "piz"}) EXPECT_EQ(refused(good), "");
    for (const char* bad :
         {"zip:999", "zip:0", "zip:2.5", "zips:", "dwaa:-5", "dwaa:1e30", "dwab:nan", "dwab:much"})
        EXPECT_TRUE(contains(refused(bad), "is no level of compression")) << bad;
    EXPECT_TRUE(contains(refused("piz:3"), "has no levels"));
}

// A limit on file size stands in for a full disk: writes fail the same way.
class SmallDisk
{
public:
    explicit SmallDisk(rlim_t bytes)
    {
        std::signal(SIGXFSZ, SIG_IGN);
        ::getrlimit(RLIMIT_FSIZE, &m_before);
        const rlimit small{bytes, m_before.rlim_max};
        ::setrlimit(RLIMIT_FSIZE, &small);
    }
    ~SmallDisk() { ::setrlimit(RLIMIT_FSIZE, &m_before); }
    SmallDisk(const SmallDisk&) = delete;
    SmallDisk& operator=(const SmallDisk&) = delete;

private:
    rlimit m_before{};
};

TEST(ImageWriter, DiskFull)
{
    const TemporaryFolder folder;
    write_exr(folder.file("in.exr"), {{"", {{"R"}, {"G"}}, 0, 0, 500, 700}}, true);
    const Image image = ramp_image({0, 0, 500, 700}, {"R"});
    for (const char* name : {"a.exr", "a.tif", "a.png", "merged.exr"}) {
        std::ofstream(folder.file(name)) << "earlier";
        const bool merged = std::string(name) == "merged.exr";
        std::string message;
        {
            const SmallDisk disk(1000);
            message = message_of([&] {
                ImageWriter writer(image.desc, {folder.file(name), "", "none", merged ? "R" : "",
                                                merged ? folder.file("in.exr") : ""});
                write_in_bands(writer, image, 100);
                writer.commit();
            });
        }
        EXPECT_TRUE(contains(message, name)) << message;
        EXPECT_TRUE(contains(message, "File too large")) << message;
        EXPECT_EQ(bytes_of(folder.file(name)).size(), 7u) << "the earlier file stays";
    }
    EXPECT_EQ(folder.names().size(), 5u);
}

TEST(ImageWriter, OtherFormatsKeepValues)
{
    const TemporaryFolder folder;
    Image image = ramp_image({0, 0, 10, 10}, {"R", "G", "B", "A"});
    for (int c = 0; c < 4; ++c)
        for (int y = 0; y < 10; ++y)
            for (int x = 0; x < 10; ++x) image.pixels.view().at(c, x, y) = c == 3 ? 1.0f : 0.5f;
    for (const char* name : {"a.png", "a.tif", "a.jpg", "a.bmp", "a.hdr", "a.tga", "a.webp"}) {
        ImageWriter writer(image.desc, {folder.file(name), "", "", "", ""});
        write_in_bands(writer, image, 3);
        writer.commit();
        const auto file = ImageFile::open(folder.file(name));
        ImageBuffer back(file->parts()[0].data, 1);
        ImageReader(file, file->narrow(file->select(""), "R")).read(back.view());
        EXPECT_NEAR(back.view().at(0, 5, 5), 0.5f, 0.01f) << name;
    }
    EXPECT_EQ(ImageFile::open(folder.file("a.tif"))->parts()[0].spec->format, OIIO::TypeFloat);
    EXPECT_EQ(ImageFile::open(folder.file("a.png"))->parts()[0].spec->format, OIIO::TypeUInt8);
    EXPECT_EQ(folder.names().size(), 7u);
}

TEST(ImageWriter, LinksAndPermissionsStay)
{
    const TemporaryFolder folder;
    std::ofstream(folder.file("real.exr")) << "earlier";
    ::chmod(folder.file("real.exr").c_str(), 0640);
    std::filesystem::create_symlink("real.exr", folder.file("link.exr"));
    const Image image = ramp_image({0, 0, 4, 4}, {"R"});
    ImageWriter writer(image.desc, {folder.file("link.exr"), "", "", "", ""});
    write_in_bands(writer, image, 4);
    writer.commit();
    EXPECT_TRUE(std::filesystem::is_symlink(folder.file("link.exr")));
    struct stat status {
    };
    ASSERT_EQ(::stat(folder.file("real.exr").c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777u, 0640u);
    EXPECT_EQ(ImageFile::open(folder.file("real.exr"))->parts().size(), 1u);
}

} // namespace
} // namespace rayloom
