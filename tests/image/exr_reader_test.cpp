// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/exr_reader.h"

#include "rayloom/core/parallel.h"
#include "rayloom/image/half.h"
#include "tests/image/image_files.h"

#include <bit>
#include <fstream>
#include <sys/stat.h>
#include <tuple>

namespace rayloom
{
namespace
{
using namespace test;

bool contains(const std::string& text, const std::string& part)
{
    return text.find(part) != std::string::npos;
}

const std::vector<Channel> cycles_channels = {
    {"ViewLayer.Combined.R"},
    {"ViewLayer.Combined.G"},
    {"ViewLayer.Combined.B"},
    {"ViewLayer.Combined.A"},
    {"ViewLayer.Denoising Albedo.R"},
    {"ViewLayer.Denoising Albedo.G"},
    {"ViewLayer.Denoising Albedo.B"},
    {"ViewLayer.Denoising Depth.Z", OIIO::TypeFloat},
    {"ViewLayer.CryptoObject00.r", OIIO::TypeFloat},
    {"ViewLayer.IndexOB.X", OIIO::TypeUInt32},
};

ChannelSelection find(const ImageFile& file, const char* layer, const char* channels = "any",
                      const char* part = "")
{
    return file.narrow(file.select(layer, part), channels);
}

// What the pattern of image_files.h reads as.
float expected(const Part& part, int index, int channel, int x, int y)
{
    const std::uint32_t bits = pattern(index, channel, x, y);
    const OIIO::TypeDesc type = part.channels[static_cast<std::size_t>(channel)].type;
    if (type == OIIO::TypeUInt32) return static_cast<float>(bits);
    if (type == OIIO::TypeFloat) return std::bit_cast<float>(bits & 0x3fffffffu);
    const auto half = static_cast<std::uint16_t>(bits & 0x3bffu);
    float value = 0;
    half_to_float(&half, &value, 1);
    return value;
}

TEST(ImageFile, LayersWithSpacesAndSeveralDots)
{
    const TemporaryFolder folder;
    write_exr(folder.file("a.exr"), {{"", cycles_channels}});
    const auto file = ImageFile::open(folder.file("a.exr"));
    ASSERT_EQ(file->layers().size(), 5u);
    EXPECT_EQ(find(*file, "ViewLayer.Denoising Albedo").names,
              (std::vector<std::string>{"R", "G", "B"}));
    EXPECT_EQ(find(*file, "Denoising Albedo").layer, "ViewLayer.Denoising Albedo");
    EXPECT_EQ(find(*file, "combined").layer, "ViewLayer.Combined") << "case is forgiven";
    EXPECT_EQ(find(*file, "ViewLayer.Combined.A").names, (std::vector<std::string>{"A"}));
    EXPECT_EQ(find(*file, "Combined", "B,R").names, (std::vector<std::string>{"B", "R"}));
    EXPECT_EQ(find(*file, "Combined", "RGB").names, (std::vector<std::string>{"R", "G", "B", "A"}));
    EXPECT_EQ(find(*file, "").names.size(), cycles_channels.size());
    EXPECT_EQ(find(*file, "ViewLayer").names.front(), "Combined.R");
    const std::string missing = message_of([&] { find(*file, "Combinde"); });
    EXPECT_TRUE(contains(missing, "a.exr")) << missing;
    EXPECT_TRUE(contains(missing, "'Combinde'")) << missing;
    EXPECT_TRUE(contains(missing, "ViewLayer.Combined")) << missing;
    EXPECT_TRUE(contains(message_of([&] { find(*file, "Combined", "R,Q"); }), "'Q'"));
    EXPECT_TRUE(contains(message_of([&] { find(*file, "", "RGB"); }), "name a layer"));
}

TEST(ImageFile, PartNamesArePartOfTheAddress)
{
    const TemporaryFolder folder;
    const std::vector<Channel> rgb = {{"R"}, {"G"}, {"B"}};
    write_exr(folder.file("a.exr"), {{"beauty", rgb},
                                     {"spec", rgb},
                                     {"aov", {{"a.R"}, {"b.R"}}},
                                     {"other", {{"a.R"}, {"c.R"}}},
                                     {"N", {{"N.X", OIIO::TypeFloat}}}});
    const auto file = ImageFile::open(folder.file("a.exr"));
    ASSERT_EQ(file->parts().size(), 5u);
    EXPECT_EQ(find(*file, "spec").part, 1);
    EXPECT_EQ(find(*file, "").part, 0);
    EXPECT_EQ(find(*file, "other.a").part, 3);
    EXPECT_EQ(find(*file, "a", "any", "other").part, 3);
    EXPECT_EQ(find(*file, "c").part, 3);
    EXPECT_EQ(find(*file, "spec.G").channels, (std::vector<int>{1}));
    EXPECT_EQ(find(*file, "other").names, (std::vector<std::string>{"a.R", "c.R"}));
    EXPECT_EQ(find(*file, "N").layer, "N");
    const std::string both = message_of([&] { find(*file, "a"); });
    EXPECT_TRUE(contains(both, "aov.a") && contains(both, "other.a")) << both;
    EXPECT_TRUE(contains(message_of([&] { find(*file, "a", "any", "none"); }), "no part 'none'"));
}

TEST(ImageFile, ViewsAreNotPasses)
{
    const TemporaryFolder folder;
    Part part{"", {{"R"}, {"diffuse.R"}, {"diffuse.right.R"}, {"right.R"}}};
    part.header = [](OIIO::ImageSpec& spec) {
        const OIIO::ustring views[] = {OIIO::ustring("left"), OIIO::ustring("right")};
        spec.attribute("multiView", OIIO::TypeDesc(OIIO::TypeDesc::STRING, 2), views);
    };
    write_exr(folder.file("a.exr"), {part});
    const auto file = ImageFile::open(folder.file("a.exr"));
    for (const LayerInfo& l : file->layers()) {
        EXPECT_EQ(l.view, contains(l.name, "right") ? "right" : "left") << l.name;
        EXPECT_EQ(l.pass, contains(l.name, "diffuse") ? "diffuse" : "") << l.name;
    }
    EXPECT_EQ(find(*file, "diffuse.right").layer, "diffuse.right");
}

TEST(ImageReader, MixedTypesNegativeOriginsEveryCompression)
{
    const TemporaryFolder folder;
    for (const char* compression : {"none", "rle", "zips", "zip", "piz"})
        for (const bool tiled : {false, true}) {
            Part part{"", cycles_channels, -7, -11, 45, 83, -2, -3, 30, 40};
            part.compression = compression;
            if (tiled) part.tile_width = part.tile_height = 16;
            write_exr(folder.file("a.exr"), {part});
            const auto file = ImageFile::open(folder.file("a.exr"));
            ImageReader reader(file, find(*file, "", "any"));
            EXPECT_EQ(reader.desc().data, (Region{-7, -11, 38, 72}));
            EXPECT_EQ(reader.desc().display, (Region{-2, -3, 28, 37}));
            // Whole, row by row, and a crop, read the same.
            const std::vector<Region> bands = {
                {-7, -11, 38, 72}, {-7, -11, 38, -10}, {-7, -10, 38, 9}, {-3, 5, 20, 6},
                {9, 6, 38, 23},    {-7, 71, 38, 72},   {0, 0, 1, 1}};
            for (const Region& band : bands) {
                ImageBuffer pixels(band, static_cast<int>(cycles_channels.size()));
                reader.read(pixels.view());
                std::size_t wrong = 0;
                for (int c = 0; c < pixels.channels(); ++c) {
                    // Channels come in OpenImageIO's order, which need not be the writer's.
                    const std::string& name = reader.desc().channels[static_cast<std::size_t>(c)];
                    int written = 0;
                    while (cycles_channels[static_cast<std::size_t>(written)].name !=
                               "ViewLayer." + name &&
                           cycles_channels[static_cast<std::size_t>(written)].name != name)
                        ++written;
                    for (int y = band.y0; y < band.y1; ++y)
                        for (int x = band.x0; x < band.x1; ++x)
                            wrong += pixels.view().at(c, x, y) != expected(part, 0, written, x, y);
                }
                EXPECT_EQ(wrong, 0u) << compression << tiled << " " << band.text();
            }
        }
}

TEST(ImageReader, ThreadsTakeTurns)
{
    const TemporaryFolder folder;
    const Part part{"", {{"R"}, {"G"}, {"B"}}, 0, 0, 64, 200};
    write_exr(folder.file("a.exr"), {part});
    const auto file = ImageFile::open(folder.file("a.exr"));
    const ImageReader reader(file, find(*file, ""));
    std::atomic<int> wrong = 0;
    parallel_for(0, 400, 1, [&](int i) {
        const int y = i * 37 % 199;
        ImageBuffer pixels(Region{3, y, 40, y + 2}, 3);
        reader.read(pixels.view());
        for (int x = 3; x < 40; ++x)
            if (pixels.view().at(1, x, y + 1) != expected(part, 0, 1, x, y + 1)) ++wrong;
    });
    EXPECT_EQ(wrong, 0);
}

std::size_t differing(const ImageBuffer& a, const ImageBuffer& b)
{
    std::size_t n = 0;
    const Region& r = a.region();
    for (int c = 0; c < a.channels(); ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x)
                n += std::bit_cast<std::uint32_t>(a.view().at(c, x, y)) !=
                     std::bit_cast<std::uint32_t>(b.view().at(c, x, y));
    return n;
}

// Rows that several readers had unpacked, in all.
std::size_t unpacked(std::span<const ImageReader* const> readers)
{
    std::size_t rows = 0;
    for (const ImageReader* reader : readers) rows += reader->rows_decoded();
    return rows;
}

TEST(ImageReader, ReadersThatShareRowsReadTheSameAndUnpackOnce)
{
    const TemporaryFolder folder;
    for (const char* compression : {"none", "zips", "zip", "piz"})
        for (const bool tiled : {false, true}) {
            Part part{"", cycles_channels, -7, -11, 45, 83};
            part.compression = compression;
            if (tiled) part.tile_width = part.tile_height = 16;
            write_exr(folder.file("a.exr"), {part});
            const auto file = ImageFile::open(folder.file("a.exr"));
            std::vector<ImageReader> alone, shared;
            for (const char* layer : {"Denoising Albedo", "Combined", "CryptoObject00", "IndexOB"})
                for (std::vector<ImageReader>* readers : {&alone, &shared})
                    readers->emplace_back(file, find(*file, layer));
            std::vector<const ImageReader*> together;
            for (const ImageReader& reader : shared) {
                EXPECT_TRUE(reader.may_share(shared.front()));
                together.push_back(&reader);
            }
            const std::vector<const ImageReader*> all = together;
            ImageReader::share_rows(together);
            for (int time = 1; time <= 2; ++time) {
                for (int y = -11; y < 72; y += 32)
                    for (std::size_t i = 0; i < shared.size(); ++i) {
                        const Region band{-7, y, 38, std::min(72, y + 32)};
                        const int channels = shared[i].desc().channel_count();
                        ImageBuffer one(band, channels), other(band, channels);
                        alone[i].read(one.view());
                        shared[i].read(other.view());
                        EXPECT_EQ(differing(one, other), 0u) << compression << tiled << " " << i;
                        shared[i].trim();
                    }
                const std::size_t rows = tiled ? 96 : 83; // whole tiles
                EXPECT_EQ(unpacked(all), time * rows) << compression << tiled;
                for (const ImageReader& reader : shared) reader.release();
            }
            // Asked for again they stay together; others part them.
            ImageReader::share_rows(together);
            ImageBuffer some(Region{-7, 0, 38, 1}, shared.front().desc().channel_count());
            shared.front().read(some.view());
            const std::size_t before = unpacked(all);
            ImageReader::share_rows(together);
            shared.front().read(some.view());
            EXPECT_EQ(unpacked(all), before);
            together.pop_back();
            ImageReader::share_rows(together);
            shared.front().read(some.view());
            EXPECT_GT(unpacked(all), before);
            const Region rows{-7, 60, 38, 72};
            ImageBuffer last(rows, 1), expected(rows, 1);
            shared.back().read(last.view());
            alone.back().read(expected.view());
            EXPECT_EQ(differing(last, expected), 0u) << compression << tiled;
        }
}

TEST(ImageReader, SharedRowsAreFreedWhenAskedThoughOneReaderWantsFewer)
{
    const TemporaryFolder folder;
    Part part{"", cycles_channels, 0, 0, 32, 64};
    part.compression = "zips";
    write_exr(folder.file("a.exr"), {part});
    const auto file = ImageFile::open(folder.file("a.exr"));
    const ImageReader colour(file, find(*file, "Combined")),
        depth(file, find(*file, "Denoising Depth"));
    const ImageReader* const both[] = {&colour, &depth};
    const auto read = [](const ImageReader& reader, int y0, int y1) {
        ImageBuffer pixels({0, y0, 32, y1}, reader.desc().channel_count());
        reader.read(pixels.view());
        reader.trim();
    };
    ImageReader::share_rows(both);
    read(colour, 0, 40);
    read(depth, 0, 30);
    EXPECT_EQ(unpacked(both), 40u);
    read(depth, 30, 40);
    EXPECT_EQ(unpacked(both), 40u) << "rows one has not read yet are there";
    read(colour, 40, 60);
    read(depth, 40, 50);
    colour.rows_end();
    read(depth, 50, 60);
    EXPECT_EQ(unpacked(both), 70u) << "nobody was to want them";
}

TEST(ImageReader, OnlyReadersOfOnePartOfOneFileShareRows)
{
    const TemporaryFolder folder;
    const std::vector<Channel> rgb = {{"R"}, {"G"}, {"B"}};
    write_exr(folder.file("a.exr"), {{"beauty", rgb}, {"spec", rgb}});
    write_exr(folder.file("b.exr"), {{"beauty", rgb}});
    const auto a = ImageFile::open(folder.file("a.exr")), b = ImageFile::open(folder.file("b.exr"));
    const ImageReader beauty(a, find(*a, "beauty")), red(a, find(*a, "beauty.R"));
    EXPECT_TRUE(beauty.may_share(red));
    EXPECT_FALSE(beauty.may_share(ImageReader(a, find(*a, "spec"))));
    EXPECT_FALSE(beauty.may_share(ImageReader(b, find(*b, "beauty"))));
    // The same name, another picture.
    write_exr(folder.file("a.exr"), {{"beauty", rgb, 0, 0, 30, 30}});
    const auto replaced = ImageFile::open(folder.file("a.exr"));
    EXPECT_FALSE(beauty.may_share(ImageReader(replaced, find(*replaced, "beauty"))));
}

TEST(ImageReader, AlphaZeroKeepsItsColour)
{
    const TemporaryFolder folder;
    write_float(folder.file("a.exr"), 4, 4, {"R", "G", "B", "A"},
                [](int, int, int c) { return c == 3 ? 0.0f : 2.5f; });
    const auto file = ImageFile::open(folder.file("a.exr"));
    const ImageReader reader(file, find(*file, "", "RGB"));
    ImageBuffer pixels(reader.desc().data, 4);
    reader.read(pixels.view());
    EXPECT_EQ(pixels.view().at(0, 2, 2), 2.5f);
    EXPECT_EQ(pixels.view().at(3, 2, 2), 0.0f);
}

// A file of any format, through OpenImageIO.
void write_plain(const std::string& path, const OIIO::ImageSpec& spec,
                 const std::vector<float>& pixels)
{
    auto out = OIIO::ImageOutput::create(path);
    ASSERT_TRUE(out && out->open(path, spec)) << path;
    ASSERT_TRUE(out->write_image(OIIO::TypeFloat, pixels.data())) << out->geterror();
    ASSERT_TRUE(out->close()) << path;
}

TEST(ImageReader, OtherFormats)
{
    const TemporaryFolder folder;
    for (const char* name : {"a.tif", "a.png", "a.ppm"}) {
        const std::string path = folder.file(name);
        OIIO::ImageSpec spec(9, 7, 3, OIIO::TypeUInt16);
        write_plain(path, spec, std::vector<float>(9 * 7 * 3, 0.25f));
        const auto file = ImageFile::open(path);
        const ImageReader reader(file, find(*file, "", "RGB"));
        ImageBuffer pixels(reader.desc().data, 3);
        reader.read(pixels.view());
        EXPECT_NEAR(pixels.view().at(2, 8, 6), 0.25f, 2e-3f) << name << " (8 bits in one)";
    }
}

// Readers of TIFF and JPEG fill in what is missing and say that all went well.
TEST(ImageReader, OtherFormatsCutShortAreErrors)
{
    const TemporaryFolder folder;
    const Region all{0, 0, 90, 70};
    const auto read = [&](const std::string& path) {
        return message_of([&] {
            const auto file = ImageFile::open(path);
            const ImageReader reader(file, find(*file, "", "RGB"));
            ImageBuffer pixels(reader.desc().data, 3);
            ASSERT_EQ(reader.desc().data, all);
            reader.read(pixels.view());
        });
    };
    std::vector<float> noise(all.pixels() * 3);
    for (std::size_t i = 0; i < noise.size(); ++i)
        noise[i] = static_cast<float>(pattern(0, 0, static_cast<int>(i), 3) & 0xffffu) / 65536.0f;
    for (const auto& [name, compression, tile] : {std::tuple{"a.tif", "none", 0},
                                                  {"a.tif", "zip", 0},
                                                  {"a.tif", "lzw", 32},
                                                  {"a.tif", "packbits", 0},
                                                  {"a.jpg", "jpeg:95", 0},
                                                  {"a.png", "", 0},
                                                  {"a.bmp", "", 0},
                                                  {"a.hdr", "", 0}}) {
        const std::string path = folder.file(name), cut = folder.file(std::string("cut_") + name);
        OIIO::ImageSpec spec(all.width(), all.height(), 3, OIIO::TypeUInt8);
        spec.attribute("compression", compression);
        spec.tile_width = spec.tile_height = tile;
        write_plain(path, spec, noise);
        EXPECT_EQ(read(path), "") << name << compression;
        const std::vector<char> whole = bytes_of(path);
        for (const std::size_t percent : {5u, 30u, 60u, 95u}) {
            std::ofstream(cut, std::ios::binary)
                .write(whole.data(), static_cast<std::streamsize>(whole.size() * percent / 100));
            EXPECT_TRUE(contains(read(cut), cut)) << name << compression << percent;
        }
    }
}

// FITS names fewer channels than it has.
TEST(ImageReader, ChannelsWithoutNamesGetThem)
{
    const TemporaryFolder folder;
    const std::string path = folder.file("a.fits");
    OIIO::ImageSpec spec(9, 7, 3, OIIO::TypeFloat);
    write_plain(path, spec, std::vector<float>(9 * 7 * 3, 0.25f));
    const auto file = ImageFile::open(path);
    const ImageReader reader(file, find(*file, "", "RGB"));
    ImageBuffer pixels(reader.desc().data, 3);
    reader.read(pixels.view());
    EXPECT_EQ(pixels.view().at(2, 8, 6), 0.25f);
}

// Whoever opened it would wait for a writer.
TEST(ImageReader, PipesAndDevicesAreRefused)
{
    const TemporaryFolder folder;
    const std::string pipe = folder.file("pipe.exr");
    ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
    for (const std::string& path : {pipe, std::string("/dev/zero")})
        EXPECT_TRUE(contains(message_of([&] { ImageFile::open(path); }), "a pipe or a device"));
}

TEST(ImageReader, TruncatedAnywhereIsAnErrorNeverACrash)
{
    const TemporaryFolder folder;
    Part tiled{"t", {{"R"}, {"G"}}, 0, 0, 60, 90};
    tiled.tile_width = tiled.tile_height = 16;
    for (const std::vector<Part>& parts :
         {std::vector<Part>{{"s", cycles_channels, 0, 0, 60, 90}, {"u", {{"R"}}, 0, 0, 60, 90}},
          {tiled}}) {
        write_exr(folder.file("whole.exr"), parts);
        const std::vector<char> whole = bytes_of(folder.file("whole.exr"));
        for (std::size_t keep = 0; keep < whole.size(); keep += 1 + whole.size() / 97) {
            std::ofstream(folder.file("cut.exr"), std::ios::binary)
                .write(whole.data(), static_cast<std::streamsize>(keep));
            const std::string message = message_of([&] {
                const auto file = ImageFile::open(folder.file("cut.exr"));
                for (const PartInfo& part : file->parts()) {
                    const ImageReader reader(file, find(*file, "", "any", part.name.c_str()));
                    ImageBuffer pixels(reader.desc().data, reader.desc().channel_count());
                    reader.read(pixels.view());
                }
            });
            EXPECT_TRUE(contains(message, "cut.exr")) << keep << ": " << message;
        }
    }
}

// Headers with single bytes changed: an error or an image, never a crash or a huge allocation.
TEST(ImageReader, DamagedHeaders)
{
    const TemporaryFolder folder;
    write_exr(folder.file("whole.exr"), {{"", {{"R"}, {"G"}}, 0, 0, 20, 20}});
    const std::vector<char> whole = bytes_of(folder.file("whole.exr"));
    std::size_t refused = 0;
    for (std::size_t at = 0; at < std::min<std::size_t>(whole.size(), 420); ++at)
        for (const char value : {at % 2 == 0 ? '\x7f' : '\xff'}) {
            std::vector<char> bytes = whole;
            bytes[at] = value;
            std::ofstream(folder.file("bad.exr"), std::ios::binary)
                .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
            refused += !message_of([&] {
                            const auto file = ImageFile::open(folder.file("bad.exr"));
                            const ImageReader reader(file, find(*file, ""));
                            if (reader.desc().data.pixels() > 1'000'000) return;
                            ImageBuffer pixels(reader.desc().data, reader.desc().channel_count());
                            reader.read(pixels.view());
                        }).empty();
        }
    EXPECT_GT(refused, 50u);
}

TEST(ImageReader, MissingFilesAndOtherThings)
{
    const TemporaryFolder folder;
    const auto open = [&](const std::string& name) {
        return message_of([&] { ImageFile::open(folder.file(name)); });
    };
    EXPECT_TRUE(contains(open("none.exr"), "No such file"));
    EXPECT_TRUE(contains(open("."), "folder"));
    std::ofstream(folder.file("text.exr")) << "hello";
    EXPECT_TRUE(contains(open("text.exr"), "not an image"));
    std::ofstream(folder.file("empty.exr")).close();
    EXPECT_TRUE(contains(open("empty.exr"), "not an image"));
}

TEST(ImageReader, FileReplacedBetweenPlanAndRead)
{
    const TemporaryFolder folder;
    write_exr(folder.file("a.exr"), {{"", {{"R"}}}});
    const auto file = ImageFile::open(folder.file("a.exr"));
    const ImageReader reader(file, find(*file, ""));
    write_exr(folder.file("a.exr"), {{"", {{"R"}}, 0, 0, 5, 5}});
    ImageBuffer pixels(reader.desc().data, 1);
    EXPECT_TRUE(contains(message_of([&] { reader.read(pixels.view()); }), "changed"));
}

TEST(ImageReader, DeepRows)
{
    const TemporaryFolder folder;
    for (const int tile : {0, 16}) {
        OIIO::ImageSpec spec(21, 35, 3, OIIO::TypeFloat);
        spec.channelnames = {"A", "Z", "id"};
        spec.channelformats = {OIIO::TypeHalf, OIIO::TypeFloat, OIIO::TypeUInt32};
        spec.x = -4;
        spec.y = -9;
        spec.deep = true;
        spec.tile_width = spec.tile_height = tile;
        OIIO::DeepData deep(spec);
        for (int p = 0; p < 21 * 35; ++p) {
            deep.set_samples(p, p % 4);
            for (int s = 0; s < p % 4; ++s) {
                deep.set_deep_value(p, 0, s, 0.5f);
                deep.set_deep_value(p, 1, s, static_cast<float>(p) + 0.25f * static_cast<float>(s));
                deep.set_deep_value(p, 2, s, static_cast<std::uint32_t>(p * 10 + s));
            }
        }
        const std::string path = folder.file("deep.exr");
        auto out = OIIO::ImageOutput::create(path);
        ASSERT_TRUE(out && out->open(path, spec)) << out->geterror();
        ASSERT_TRUE(out->write_deep_image(deep)) << out->geterror();
        ASSERT_TRUE(out->close());
        const auto file = ImageFile::open(path);
        ASSERT_TRUE(file->parts()[0].deep);
        const ImageReader reader(file, file->narrow(file->select(""), "Z,id"));
        for (const int y : {-9, 25, 3, 4}) {
            const DeepRow row = reader.read_deep_row(y);
            for (int i = 0; i < 21; ++i) {
                const int p = (y + 9) * 21 + i;
                ASSERT_EQ(row.pixel(0, i).size(), static_cast<std::size_t>(p % 4));
                for (int s = 0; s < p % 4; ++s) {
                    EXPECT_EQ(row.pixel(0, i)[static_cast<std::size_t>(s)],
                              static_cast<float>(p) + 0.25f * static_cast<float>(s));
                    EXPECT_EQ(row.pixel(1, i)[static_cast<std::size_t>(s)],
                              static_cast<float>(p * 10 + s));
                }
            }
        }
        ImageBuffer flat(reader.desc().data, 2);
        EXPECT_TRUE(contains(message_of([&] { reader.read(flat.view()); }), "deep"));
        EXPECT_THROW(reader.read_deep_row(26), InputError);
    }
}

// OpenEXR would ask for memory for whole tiles, several of them, when the file is opened.
TEST(ImageReader, TilesFarLargerThanThePictureAreRefused)
{
    const TemporaryFolder folder;
    const std::string path = folder.file("tiled.exr");
    const OIIO::TypeDesc type = OIIO::TypeFloat;
    Part part{"tiled", {{"R", type}, {"G", type}, {"B", type}, {"A", type}}};
    part.compression = "none";
    const auto open_tiled = [&](int width, int height, int side) {
        part.width = width;
        part.height = height;
        part.tile_width = part.tile_height = side;
        Part first{"first", {{"R"}}, 0, 0, width, height};
        first.tile_width = first.tile_height = 64;
        std::string messages;
        for (const auto& parts : {std::vector{part}, std::vector{first, part}}) {
            write_exr(path, parts);
            messages += message_of([&] {
                const auto file = ImageFile::open(path);
                const ImageReader reader(file, find(*file, "", "any", "tiled"));
                ImageBuffer pixels(reader.desc().data, 4);
                reader.read(pixels.view());
            });
        }
        return messages;
    };
    for (const int side : {64, 2048}) EXPECT_EQ(open_tiled(20, 37, side), "") << side;
    EXPECT_EQ(open_tiled(1030, 1030, 2050), ""); // not four times the picture
    const std::string refused = open_tiled(20, 37, 2050),
                      why = "tiles of 2050x2050 pixels for an image of 20x37";
    EXPECT_TRUE(contains(refused, why)) << refused;
    EXPECT_NE(refused.find(why), refused.rfind(why)) << refused; // one part or several
}

// OpenEXR would make room for a text of that length first, and clear it.
TEST(ImageReader, FieldsLongerThanTheFileAreRefused)
{
    const TemporaryFolder folder;
    const std::string path = folder.file("a.exr");
    const Part one{"one", {{"R"}}, 0, 0, 20, 20}, two{"two", {{"Y"}}, 0, 0, 20, 20};
    for (const auto& parts : {std::vector{one}, std::vector{one, two}}) {
        write_exr(path, parts);
        std::string bytes;
        for (const char c : bytes_of(path)) bytes += c;
        for (const std::string& field :
             {std::string("lineOrder\0lineOrder\0", 20), std::string("name\0string\0", 12)}) {
            const std::size_t at = bytes.rfind(field); // that of the last part
            if (at == std::string::npos) continue;     // one part has no name
            for (const std::uint32_t size : {0x7fffffffu, 0x80000000u, 0xffffffffu}) {
                std::string changed = bytes;
                for (std::size_t i = 0; i < 4; ++i)
                    changed[at + field.size() + i] = static_cast<char>(size >> 8 * i);
                std::ofstream(path, std::ios::binary).write(changed.data(), std::ssize(changed));
                const std::string message = message_of([&] { ImageFile::open(path); });
                EXPECT_TRUE(contains(message, "promises " + std::to_string(size) + " bytes of '" +
                                                  field.substr(0, field.find('\0')) + "'"))
                    << message;
            }
        }
    }
}

// OpenEXR reads a value by its type and takes what comes next for the next field.
TEST(ImageReader, FieldsOfAnotherSizeThanTheirValueAreRefused)
{
    const TemporaryFolder folder;
    const std::string path = folder.file("a.exr");
    Part part{"", {{"R"}, {"G"}}, 0, 0, 20, 20};
    part.header = [](OIIO::ImageSpec& spec) {
        const char* views[] = {"left", "right"};
        spec.attribute("multiView", OIIO::TypeDesc(OIIO::TypeDesc::STRING, 2), views);
        spec.attribute("weights", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 7),
                       std::vector<float>(7, 1.0f).data());
    };
    write_exr(path, {part});
    std::string bytes;
    for (const char c : bytes_of(path)) bytes += c;
    const auto opened = [&] {
        std::ofstream(path, std::ios::binary).write(bytes.data(), std::ssize(bytes));
        return message_of([&] { ImageFile::open(path); });
    };
    EXPECT_EQ(opened(), "");
    for (const std::string& field :
         {std::string("channels\0chlist\0", 16), std::string("dataWindow\0box2i\0", 17),
          std::string("multiView\0stringvector\0", 23),
          std::string("screenWindowWidth\0float\0", 24)}) {
        const std::size_t at = bytes.find(field);
        ASSERT_NE(at, std::string::npos) << field;
        char& size = bytes[at + field.size()];
        for (const int by : {1, -1}) {
            size = static_cast<char>(size + by);
            const std::string message = opened();
            EXPECT_TRUE(contains(message, "which is not what is in it")) << field << message;
            size = static_cast<char>(size - by);
        }
    }
    EXPECT_EQ(opened(), "");
}

// OpenEXR checks nothing else in their header, and OpenImageIO ends the process at a channel whose
// type it does not know.
TEST(ImageReader, PartsOfAnUnknownTypeAreRefused)
{
    const TemporaryFolder folder;
    const std::string path = folder.file("parts.exr");
    write_exr(path, {{"first", {{"R"}}, 0, 0, 20, 20}, {"second", {{"Y"}}, 0, 0, 20, 20}});
    std::string bytes;
    for (const char c : bytes_of(path)) bytes += c;
    const auto opened = [&] {
        std::ofstream(path, std::ios::binary).write(bytes.data(), std::ssize(bytes));
        return message_of([&] { ImageFile::open(path); });
    };
    EXPECT_EQ(opened(), "");
    bytes.replace(bytes.rfind("scanlineimage"), 13, "scanlineimagE");
    const std::string why = "part 1 is neither scanlines nor tiles";
    EXPECT_TRUE(contains(opened(), why));
    bytes[bytes.rfind(std::string("\0Y\0", 3)) + 3] = 3; // there are types 0 to 2
    EXPECT_TRUE(contains(opened(), why));
}

// OpenImageIO keeps the stack of each thread its pool loses.
TEST(ImageReader, RunsOnManyAndFewThreadsInTurnKeepTheAddressSpace)
{
    const auto pages = [] {
        std::size_t number = 0;
        std::ifstream("/proc/self/statm") >> number;
        return number;
    };
    set_image_threads(8);
    set_image_threads(1);
    const std::size_t before = pages();
    for (int i = 0; i < 40; ++i) {
        set_image_threads(8);
        set_image_threads(1);
    }
    set_image_threads(0);
    EXPECT_LT(pages(), before + 200'000); // 800 MB; stacks were 1.6 GB
}

TEST(ImageReader, ContentKeyFollowsTheBytes)
{
    const TemporaryFolder folder;
    std::ofstream(folder.file("a")) << "one";
    std::ofstream(folder.file("b")) << "one";
    std::ofstream(folder.file("c")) << "two";
    EXPECT_EQ(file_content_key(folder.file("a"), true), file_content_key(folder.file("b"), true));
    EXPECT_NE(file_content_key(folder.file("a"), true), file_content_key(folder.file("c"), true));
    EXPECT_NE(file_content_key(folder.file("a"), false), file_content_key(folder.file("b"), false));
    EXPECT_THROW(file_content_key(folder.file("d"), true), InputError);
}

} // namespace
} // namespace rayloom
