// SPDX-License-Identifier: Apache-2.0
// Proto: figures only.
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"

#include <OpenImageIO/imagebuf.h>
#include <OpenImageIO/imageio.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <cstdlib>
#include <sstream>

using namespace rayloom;

using Image = std::shared_ptr<MemoryImage>;

Image make(const Region& w)
{
    auto m = std::make_shared<MemoryImage>();
    m->desc.data = m->desc.display = w;
    m->desc.channels = {"R", "G", "B"};
    m->pixels = ImageBuffer(w, 3);
    return m;
}
Image read(const std::string& path, const std::string& pass)
{
    OIIO::ImageBuf b(path);
    b.read(0, 0, true, OIIO::TypeFloat);
    if (b.has_error()) { std::fprintf(stderr, "%s\n", b.geterror().c_str()); std::exit(1); }
    const auto& s = b.spec();
    Image m = make({0, 0, s.width, s.height});
    const char* rgb[] = {"R", "G", "B"};
    for (int c = 0; c < 3; ++c) {
        const int k = s.channelindex("ViewLayer." + pass + "." + rgb[c]);
        if (k < 0) { std::fprintf(stderr, "%s: no %s\n", path.c_str(), pass.c_str()); std::exit(1); }
        for (int y = 0; y < s.height; ++y)
            for (int x = 0; x < s.width; ++x) m->pixels.view().at(c, x, y) = b.getchannel(x, y, 0, k);
    }
    return m;
}
template <class F>
Image map(const Image& a, const Image& b, F f)
{
    Image m = make(a->desc.data);
    for (int y = 0; y < a->desc.data.y1; ++y)
        for (int c = 0; c < 3; ++c)
            for (int x = 0; x < a->desc.data.x1; ++x)
                m->pixels.view().at(c, x, y) = f(a->pixels.view().at(c, x, y), b->pixels.view().at(c, x, y));
    return m;
}
float mul(float a, float b) { return a * b; }
float quotient(float a, float b) { return b > 0 ? a / b : 0; }
double rmse(const Image& a, const Image& b, double trim = 0)
{
    std::vector<double> e;
    for (int y = 0; y < a->desc.data.y1; ++y)
        for (int x = 0; x < a->desc.data.x1; ++x) {
            double s = 0;
            for (int c = 0; c < 3; ++c) { double d = a->pixels.view().at(c, x, y) - b->pixels.view().at(c, x, y); s += d * d / 3; }
            e.push_back(s);
        }
    std::sort(e.begin(), e.end());
    e.resize(static_cast<std::size_t>(static_cast<double>(e.size()) * (1 - trim)));
    double s = 0;
    for (double v : e) s += v;
    return std::sqrt(s / static_cast<double>(e.size()));
}
double mean(const Image& a)
{
    double s = 0;
    for (int y = 0; y < a->desc.data.y1; ++y)
        for (int c = 0; c < 3; ++c)
            for (int x = 0; x < a->desc.data.x1; ++x) s += a->pixels.view().at(c, x, y);
    return s / (3.0 * static_cast<double>(a->desc.data.pixels()));
}
void write(const Image& a, const std::string& path) { to_image_buf(*a).write(path, OIIO::TypeFloat); }

struct Config {
    double epsilon = 1e-4;
    bool opponent = true, first = false, automatic = true, halves = true;
    double s = 0.19, p = 1.5;
    int levels = 3, scale = 3;
};
bool verbose = false;
Image run(const Config& c, const Image& image, const Image& a, const Image& b)
{
    std::ostringstream g;
    const bool halves = c.halves && a && c.automatic;
    const std::string log = ", epsilon: " + std::to_string(c.epsilon) + ", opponent: " + (c.opponent ? "true" : "false");
    g << "rayloom: 1\nname: study\ninputs:\n  image: image\n";
    if (halves) g << "  a: half\n  b: half\n";
    g << "nodes:\n";
    g << "  log: {op: transform.log, image: image" << log << "}\n";
    g << "  bands: {op: multiscale.steerable, image: log.log, levels: " << c.levels << "}\n";
    if (halves) {
        for (const char* h : {"a", "b"}) {
            g << "  log_" << h << ": {op: transform.log, image: " << h << ", figures: log.figures" << log << "}\n";
            g << "  bands_" << h << ": {op: multiscale.steerable, image: log_" << h << ".log, levels: " << c.levels << "}\n";
        }
    }
    g << "  noise: {op: fit.noise, band: bands, noise: " << (c.automatic ? "auto" : "given") << ", s: " << c.s << ", p: " << c.p;
    if (halves) g << ", a: bands_a, b: bands_b}\n";
    else g << ", high: 'bands[0]'}\n";
    g << "  fit: {op: fit.laplacian, band: bands, noise: noise.figures}\n";
    g << "  cored: {op: threshold.coring, band: bands, fit: fit.figures, channels: " << (c.first ? "first" : "all") << "}\n";
    g << "  joined: {op: multiscale.steerable_inverse, bands: cored.band}\n";
    g << "  linear: {op: transform.exp, image: joined, figures: log.figures, opponent: " << (c.opponent ? "true" : "false") << "}\n";
    g << "  clean: {op: transform.restore_mean, image: linear, reference: image, scale: " << c.scale << "}\n";
    g << "outputs:\n  image: clean\n  fit: fit.figures\n  figures: log.figures\n";
    const Graph graph = parse_graph(g.str(), "study.yaml");
    RunRequest request;
    request.inputs["image"].images = {image};
    if (halves) { request.inputs["a"].images = {a}; request.inputs["b"].images = {b}; }
    RunReport r = run_graph(graph, request, {});
    if (verbose) {
        std::printf("%s\n", r.tables.at("figures")[0].json().c_str());
        for (const Table& t : r.tables.at("fit"))
            for (const auto& row : t.rows) {
                for (const auto& cell : row) {
                    if (auto* d = std::get_if<double>(&cell)) std::printf("%9.4f ", *d);
                    else std::printf("%-14s", std::get<std::string>(cell).c_str());
                }
                std::printf("\n");
            }
    }
    auto m = std::make_shared<MemoryImage>(std::move(r.images.at("image").front()));
    return m;
}

int main(int argc, char** argv)
{
    const std::string data = argv[1];
    verbose = argc > 2 && std::strcmp(argv[2], "-v") == 0;
    for (const std::string scene : {"cornell", "interior"}) {
        const std::string folder = data + "/" + scene + "/";
        const Image ref_ind = read(folder + "ref.exr", "DiffInd"), ref_col = read(folder + "ref.exr", "DiffCol");
        const Image ref_rad = map(ref_ind, ref_col, mul);
        struct Set { std::string name; Image col, ind, rad, ha, hb, ra, rb; };
        std::vector<Set> sets;
        {
            Set s; s.name = "8x1";
            std::vector<Image> cols, rads;
            for (int k = 1; k <= 8; ++k) {
                const std::string f = folder + "stack_passes/s0" + std::to_string(k) + ".exr";
                cols.push_back(read(f, "DiffCol"));
                rads.push_back(map(cols.back(), read(f, "DiffInd"), mul));
            }
            auto avg = [&](const std::vector<Image>& v, int from, int step) {
                Image t = make(v[0]->desc.data);
                t->pixels.fill(0);
                int n = 0;
                for (std::size_t k = static_cast<std::size_t>(from); k < v.size(); k += static_cast<std::size_t>(step)) { t = map(t, v[k], [](float x, float y) { return x + y; }); ++n; }
                return map(t, t, [n](float x, float) { return x / static_cast<float>(n); });
            };
            s.col = avg(cols, 0, 1); s.rad = avg(rads, 0, 1); s.ra = avg(rads, 0, 2); s.rb = avg(rads, 1, 2);
            s.ind = map(s.rad, s.col, quotient);
            s.ha = map(s.ra, avg(cols, 0, 2), quotient); s.hb = map(s.rb, avg(cols, 1, 2), quotient);
            sets.push_back(s);
        }
        for (const char* n : {"16", "64"}) {
            Set s; s.name = n;
            const std::string f = folder + "noisy_" + n + ".exr";
            s.col = read(f, "DiffCol"); s.ind = read(f, "DiffInd"); s.rad = map(s.col, s.ind, mul);
            sets.push_back(s);
        }
        for (const Set& s : sets) {
            std::printf("== %s %s: noisy rmse radiance %.5f (trim %.5f), illum %.5f; mean %.5f ref %.5f\n", scene.c_str(), s.name.c_str(), rmse(s.rad, ref_rad), rmse(s.rad, ref_rad, .001), rmse(s.ind, ref_ind), mean(s.rad), mean(ref_rad));
            auto one = [&](const char* what, const Config& c) {
                const Image fi = run(c, s.ind, s.ha, s.hb);
                const bool v = verbose; verbose = false;
                const Image out_i = map(fi, s.col, mul);
                const Image out_r = run(c, s.rad, s.ra, s.rb);
                verbose = v;
                std::printf("%-28s illum: %.5f x%.2f (trim x%.2f, illum-domain x%.2f) mean %+.3f%% | radiance: %.5f x%.2f (trim x%.2f) mean %+.3f%%\n", what, rmse(out_i, ref_rad), rmse(s.rad, ref_rad) / rmse(out_i, ref_rad), rmse(s.rad, ref_rad, .001) / rmse(out_i, ref_rad, .001), rmse(s.ind, ref_ind) / rmse(fi, ref_ind), 100 * (mean(fi) / mean(s.ind) - 1), rmse(out_r, ref_rad), rmse(s.rad, ref_rad) / rmse(out_r, ref_rad), rmse(s.rad, ref_rad, .001) / rmse(out_r, ref_rad, .001), 100 * (mean(out_r) / mean(s.rad) - 1));
                std::fflush(stdout);
                write(out_i, "/tmp/wv/" + scene + "_" + s.name + "_" + what + ".exr");
            };
            write(s.rad, "/tmp/wv/" + scene + "_" + s.name + "_noisy.exr");
            write(ref_rad, "/tmp/wv/" + scene + "_ref.exr");
            Config base;
            one("auto", base);
            const bool v = verbose; verbose = false;
            Config c = base; c.opponent = false; one("rgb", c);
            c.epsilon = 1e-3; one("rgb_1e-3", c);
            c.epsilon = 1e-2; one("rgb_1e-2", c);
            c.scale = 4; one("rgb_1e-2_s4", c);
            c = base; c.automatic = false; c.s = .6; one("fixed.6", c);
            if (s.name == "8x1") { c = base; c.halves = false; one("blind", c); c.opponent = false; one("blindrgb", c); }
            verbose = v;
        }
    }
}
