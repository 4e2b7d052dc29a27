// SPDX-License-Identifier: Apache-2.0
// Damaged EXR files behind every way a graph reads them: layers, histograms, covariances, deep
// samples. Whole fields of the header and whole pixel values are changed, not only bits, so that
// most files are still read.
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "rayloom/image/exr_reader.h"
#include "tests/fuzz/target.h"

#include <unistd.h>

#include <array>
#include <cstring>
#include <fstream>
#include <random>
#include <string>
#include <vector>

namespace
{

using rayloom::Graph;

constexpr std::size_t most_pixels = std::size_t{1} << 14;

struct Graphs {
    Graph flat = rayloom::parse_graph("rayloom: 1\nname: flat\ninputs: {a: {channels: any}}\n"
                                      "nodes: {n: {op: threshold.sanitize, image: a}}\n"
                                      "outputs: {image: n}\n",
                                      "flat");
    Graph histogram =
        rayloom::parse_graph("rayloom: 1\nname: histogram\ninputs: {h: {channels: any}}\n"
                             "nodes: {n: {op: fuse.histogram, image: h, histogram: h, window: 3}}\n"
                             "outputs: {image: n}\n",
                             "histogram");
    // A renderer's covariance stands where a variance does.
    Graph covariance = rayloom::parse_graph(
        "rayloom: 1\nname: covariance\ninputs: {c: {channels: any}}\n"
        "nodes:\n  i: {op: threshold.interval, mean: c, variance: c, samples: 16}\n"
        "  r: {op: fuse.residual, image: i.low, original: i.high, variance: i.variance}\n"
        "outputs: {image: r}\n",
        "covariance");
    Graph deep = rayloom::parse_graph("rayloom: 1\nname: deep\ninputs: {d: {kind: deep}}\n"
                                      "nodes:\n  h: {op: transform.histogram, deep: d, bins: 4}\n"
                                      "  s: {op: transform.statistics, deep: d}\n"
                                      "outputs: {h: h, mean: s.mean, variance: s.variance}\n",
                                      "deep");
    Graph recolor = rayloom::parse_graph("rayloom: 1\nname: recolor\ninputs: {d: {kind: deep}}\n"
                                         "nodes:\n  f: {op: transform.deep_flatten, deep: d}\n"
                                         "  r: {op: transform.deep_recolor, deep: d, color: f}\n"
                                         "outputs: {deep: r, flat: f}\n",
                                         "recolor");
};

void run(const Graph& graph, const std::string& input, const std::string& path,
         const std::string& layer)
{
    rayloom::RunRequest request;
    request.inputs[input].files.push_back({path, layer});
    rayloom::RunOptions options;
    options.threads = 1;
    options.memory = std::size_t{256} << 20;
    rayloom::fuzz::answer([&] { rayloom::run_graph(graph, request, options); });
}

/// A place of the file's headers: name, type and value of an attribute.
struct Attribute {
    std::string name, type;
    std::size_t begin = 0, size = 0;
};

std::vector<Attribute> attributes(const std::uint8_t* data, std::size_t size)
{
    std::vector<Attribute> list;
    std::size_t at = 8; // magic and version
    const auto word = [&](std::string& text) {
        while (at < size && data[at] != 0 && text.size() < 256)
            text += static_cast<char>(data[at++]);
        return at++ < size;
    };
    const bool parts = size > 5 && (data[5] & 0x10) != 0; // a header each, and an empty one
    bool within = false;
    while (at < size) {
        Attribute a;
        if (!word(a.name)) break;
        if (a.name.empty()) {
            if (!parts || !within) break;
            within = false;
            continue;
        }
        within = true;
        if (!word(a.type) || at + 4 > size) break;
        std::uint32_t bytes = 0;
        std::memcpy(&bytes, data + at, 4);
        a.begin = at + 4;
        a.size = bytes;
        if (a.size > size - a.begin) break;
        at = a.begin + a.size;
        list.push_back(a);
    }
    return list;
}

template <class T>
void put(std::uint8_t* data, std::size_t size, std::size_t at, T value)
{
    if (at + sizeof(T) <= size) std::memcpy(data + at, &value, sizeof(T));
}

/// The first byte after the name of each channel of a list: type, linearity, sampling.
std::vector<std::size_t> channels_of(const std::uint8_t* data, const Attribute& list)
{
    constexpr std::size_t fields = 16;
    std::vector<std::size_t> found;
    std::size_t at = list.begin;
    const std::size_t end = list.begin + list.size;
    while (at < end && data[at] != 0) {
        while (at < end && data[at] != 0) ++at;
        if (at + 1 + fields > end) break;
        found.push_back(at + 1);
        at += 1 + fields;
    }
    return found;
}

} // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size)
{
    static const Graphs graphs;
    static const std::string path = "/tmp/rayloom-fuzz-" + std::to_string(::getpid()) + ".exr";
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
    rayloom::fuzz::answer([&] {
        const auto file = rayloom::ImageFile::open(path);
        for (const rayloom::PartInfo& part : file->parts())
            if (part.data.pixels() > most_pixels || part.spec->nchannels > 256) return;
        for (const rayloom::PartInfo& part : file->parts()) {
            const std::string name = file->parts().size() > 1 ? part.name : "";
            if (part.deep) {
                run(graphs.deep, "d", path, name);
                run(graphs.recolor, "d", path, name);
            } else {
                run(graphs.flat, "a", path, name);
                run(graphs.histogram, "h", path, name);
                run(graphs.covariance, "c", path, name);
            }
        }
    });
    ::unlink(path.c_str());
    return 0;
}

std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                    unsigned seed)
{
    std::minstd_rand random(seed);
    const auto below = [&](std::size_t n) { return n == 0 ? 0 : random() % n; };
    constexpr std::array<std::int32_t, 12> whole{0,  1,    -1,    2,       127,        255,
                                                 64, 4096, 65536, 1 << 30, -(1 << 30), 0x7fffffff};
    constexpr std::array<std::uint32_t, 9> real{0x7fc00000u, 0x7f800000u, 0xff800000u,
                                                0x00000001u, 0x80000000u, 0x7f7fffffu,
                                                0x3f800000u, 0xbf800000u, 0x501502f9u};
    const std::vector<Attribute> header = attributes(data, size);
    const std::size_t pixels =
        header.empty() ? 0 : std::min(size, header.back().begin + header.back().size + 1);
    if (LLVMFuzzerMutate && below(8) == 0) return LLVMFuzzerMutate(data, size, max_size);
    for (std::size_t n = 1 + below(3); n > 0 && size > 8; --n) switch (below(9)) {
        case 0: // a field of the header, as what it is
        case 1: {
            if (header.empty()) break;
            const Attribute& a = header[below(header.size())];
            if (a.size == 0) break;
            if (a.type == "box2i" || a.type == "int" || a.type == "v2f" || a.type == "float")
                put(data, size, a.begin + 4 * below(a.size / 4), whole[below(whole.size())]);
            else
                data[a.begin + below(a.size)] = static_cast<std::uint8_t>(below(256));
            break;
        }
        case 2: // the size of a field
            if (header.empty()) break;
            put(data, size, header[below(header.size())].begin - 4, whole[below(whole.size())]);
            break;
        case 3: // a pixel, or what stands before a row
        case 4:
            if (pixels < size)
                put(data, size, pixels + (below(size - pixels) & ~std::size_t{3}),
                    real[below(real.size())]);
            break;
        case 5: // how a channel is stored: its type, its sampling, the end of its name
            for (const Attribute& a : header) {
                if (a.type != "chlist" || below(2) == 0) continue;
                const std::vector<std::size_t> list = channels_of(data, a);
                if (list.empty()) break;
                const std::size_t at = list[below(list.size())];
                if (below(3) == 0)
                    put(data, size, at, static_cast<std::int32_t>(below(4)));
                else if (below(2) == 0)
                    put(data, size, at + 8 + 4 * below(2), whole[below(whole.size())]);
                else
                    data[at - 2] = static_cast<std::uint8_t>("RGBAYZ019_."[below(11)]);
            }
            break;
        case 6: // compression, order of lines, what kind of file it is
            for (const Attribute& a : header)
                if ((a.type == "compression" || a.type == "lineOrder") && below(2) == 0)
                    data[a.begin] = static_cast<std::uint8_t>(below(11));
            if (below(4) == 0) data[5] ^= static_cast<std::uint8_t>(2u << below(4));
            break;
        case 7: // where a row or tile begins, or how long it says it is
            if (pixels < size)
                put(data, size, pixels + 4 * below(std::min<std::size_t>(64, (size - pixels) / 4)),
                    whole[below(whole.size())]);
            break;
        default: data[below(size)] ^= static_cast<std::uint8_t>(1u << below(8));
        }
    // Now and then the end is missing.
    return below(40) == 0 ? below(size) : std::min(size, max_size);
}
