// SPDX-License-Identifier: Apache-2.0
#include "tests/support/engine_nodes_for_tests.h"

#include "rayloom/core/registry.h"
#include "rayloom/graph/reader.h"

#include <cstring>
#include <mutex>
#include <random>

namespace rayloom::test
{

namespace
{

struct NoParams {
};

/// Sets every value of a view to value(channel, x, y).
template <class Value>
void fill(const ImageView& out, const Value& value)
{
    const Region& r = out.region();
    for (int y = r.y0; y < r.y1; ++y)
        for (int ch = 0; ch < out.channels(); ++ch)
            for (int x = r.x0; x < r.x1; ++x) out.at(ch, x, y) = value(ch, x, y);
}

/// Sum of the pixels of a region.
float sum_of(const ConstImageView& in, int channel, const Region& r)
{
    float sum = 0.0f;
    for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x) sum += in.at(channel, x, y);
    return sum;
}

class Gain final : public Node
{
public:
    struct Params {
        float factor = 1.0f;
    };
    static void describe(Declaration<Params>& d)
    {
        d.name("engine.gain").summary("Scales an image.");
        d.input("image", "Any image.");
        d.output("image", "Scaled.");
        d.param("factor", &Params::factor, "Factor.");
    }
    explicit Gain(const Params& p) : m(p) {}
    void plan(PlanContext& c) override
    {
        c.output("image", c.input("image"));
        if (m.factor == 1.0f) c.pass_through("image", "image");
    }
    void compute(const TileContext& c) const override
    {
        const ConstImageView in = c.input("image");
        fill(c.output("image"), [&](int ch, int x, int y) { return in.at(ch, x, y) * m.factor; });
    }

private:
    Params m;
};

class Box final : public Node
{
public:
    struct Params {
        int radius = 2;
    };
    static void describe(Declaration<Params>& d)
    {
        d.name("engine.box").summary("Mean over a window.");
        d.input("image", "Any image.");
        d.output("image", "Smoothed.");
        d.param("radius", &Params::radius, "Radius.").unit("px");
    }
    explicit Box(const Params& p) : m(p) {}
    void plan(PlanContext& c) override
    {
        m_window = c.input("image").data;
        c.output("image", c.input("image"));
        c.needs("image", Halo::all(m.radius));
    }
    void compute(const TileContext& c) const override
    {
        fill(c.output("image"), [&](int ch, int x, int y) {
            const Region w =
                Region{x, y, x + 1, y + 1}.grown(Halo::all(m.radius)).intersect(m_window);
            return sum_of(c.input("image"), ch, w) / static_cast<float>(w.pixels());
        });
    }

private:
    Params m;
    Region m_window;
};

class Halve final : public Node
{
public:
    struct Params {
        int scales = 3;
    };
    static void describe(Declaration<Params>& d)
    {
        d.name("engine.halve").summary("Levels of half the size each.");
        d.input("image", "Any image.");
        d.output("levels", "Level 0 first.").list();
        d.param("scales", &Params::scales, "Levels.");
    }
    explicit Halve(const Params& p) : m(p) {}
    void plan(PlanContext& c) override
    {
        m_window = c.input("image").data;
        std::vector<ImageDesc> levels;
        for (int s = 0; s < m.scales; ++s) {
            levels.push_back(c.input("image"));
            levels.back().data = {0, 0, (m_window.width() + (1 << s) - 1) >> s,
                                  (m_window.height() + (1 << s) - 1) >> s};
        }
        levels[0].data = m_window;
        c.output_list("levels", levels);
        c.pass_through("levels", "image");
        c.needs("image", [this](const Need& n) {
            return source(n.region, static_cast<int>(n.output_element));
        });
    }
    void compute(const TileContext& c) const override
    {
        fill(c.output("levels"), [&](int ch, int x, int y) {
            const Region w =
                source({x, y, x + 1, y + 1}, static_cast<int>(c.element())).intersect(m_window);
            return sum_of(c.input("image"), ch, w) / static_cast<float>(w.pixels());
        });
    }

private:
    Region source(const Region& r, int s) const
    {
        if (s == 0) return r;
        return Region{r.x0 << s, r.y0 << s, r.x1 << s, r.y1 << s}.shifted(m_window.x0, m_window.y0);
    }
    Params m;
    Region m_window;
};

class Total final : public Node
{
public:
    using Params = NoParams;
    static void describe(Declaration<Params>& d)
    {
        d.name("engine.total").summary("Sum of an image, and the image without its mean.");
        d.input("image", "Any image.");
        d.output("figures", "Column sum.").table();
        d.output("image", "Without its mean.");
    }
    explicit Total(const Params&) {}
    void plan(PlanContext& c) override
    {
        m_window = c.input("image").data;
        c.output("image", c.input("image"));
        c.reduce(m_window, 1);
        c.reduce_needs("image");
    }
    void reduce(const TileContext& c, std::span<double> sums) const override
    {
        for (int y = c.region().y0; y < c.region().y1; ++y)
            for (int ch = 0; ch < c.input("image").channels(); ++ch)
                for (int x = c.region().x0; x < c.region().x1; ++x)
                    sums[0] += static_cast<double>(c.input("image").at(ch, x, y));
    }
    std::map<std::string, Table, std::less<>> finish(std::span<const double> totals,
                                                     std::span<const TileContext::Input>) override
    {
        m_sum = totals[0];
        Table t;
        t.set("sum", m_sum);
        return {{"figures", t}};
    }
    void compute(const TileContext& c) const override
    {
        const ImageView out = c.output("image");
        const auto mean = static_cast<float>(
            m_sum /
            static_cast<double>(m_window.pixels() * static_cast<std::size_t>(out.channels())));
        const ConstImageView in = c.input("image");
        fill(out, [&](int ch, int x, int y) { return in.at(ch, x, y) - mean; });
    }

private:
    Region m_window;
    double m_sum = 0.0;
};

class Shift final : public Node
{
public:
    using Params = NoParams;
    static void describe(Declaration<Params>& d)
    {
        d.name("engine.shift").summary("Adds a figure.");
        d.input("image", "Any image.");
        d.input("figures", "Column sum.").table();
        d.output("image", "Shifted.");
    }
    explicit Shift(const Params&) {}
    void plan(PlanContext& c) override { c.output("image", c.input("image")); }
    void compute(const TileContext& c) const override
    {
        const auto by = static_cast<float>(c.table("figures").number("sum"));
        const ConstImageView in = c.input("image");
        fill(c.output("image"), [&](int ch, int x, int y) { return in.at(ch, x, y) + by; });
    }
};

class Flipped final : public Node
{
public:
    using Params = NoParams;
    static void describe(Declaration<Params>& d)
    {
        d.name("engine.flipped").summary("Upside down.");
        d.input("image", "Any image.");
        d.output("image", "Flipped.");
    }
    explicit Flipped(const Params&) {}
    void plan(PlanContext& c) override
    {
        m_window = c.input("image").data;
        c.output("image", c.input("image"));
        c.needs("image", [this](const Need& n) {
            return Region{n.region.x0, mirror(n.region.y1 - 1), n.region.x1,
                          mirror(n.region.y0) + 1};
        });
    }
    void compute(const TileContext& c) const override
    {
        const ConstImageView in = c.input("image");
        fill(c.output("image"), [&](int ch, int x, int y) { return in.at(ch, x, mirror(y)); });
    }

private:
    int mirror(int y) const { return m_window.y0 + m_window.y1 - 1 - y; }
    Region m_window;
};

class Sum final : public Node
{
public:
    using Params = NoParams;
    static void describe(Declaration<Params>& d)
    {
        d.name("engine.sum").summary("Sum of a list.");
        d.input("images", "Images of one size.").list();
        d.output("image", "Sum.");
    }
    explicit Sum(const Params&) {}
    void plan(PlanContext& c) override { c.output("image", c.input("images")); }
    void compute(const TileContext& c) const override
    {
        fill(c.output("image"), [&](int ch, int x, int y) {
            float sum = 0.0f;
            for (std::size_t i = 0; i < c.count("images"); ++i)
                sum += c.input("images", i).at(ch, x, y);
            return sum;
        });
    }
};

class BlurAll final : public Node
{
public:
    using Params = NoParams;
    static void describe(Declaration<Params>& d)
    {
        d.name("engine.blur_all").summary("Mean of the whole image.");
        d.input("image", "Any image.");
        d.output("image", "One value a channel.");
    }
    explicit BlurAll(const Params&) {}
    void plan(PlanContext& c) override
    {
        c.output("image", c.input("image"));
        c.access(Access::whole);
    }
    void compute(const TileContext& c) const override
    {
        const Region r = c.region();
        for (int ch = 0; ch < c.output("image").channels(); ++ch) {
            double sum = 0.0;
            for (int y = r.y0; y < r.y1; ++y)
                for (int x = r.x0; x < r.x1; ++x)
                    sum += static_cast<double>(c.input("image").at(ch, x, y));
            for (int y = r.y0; y < r.y1; ++y)
                for (int x = r.x0; x < r.x1; ++x)
                    c.output("image").at(ch, x, y) =
                        static_cast<float>(sum / static_cast<double>(r.pixels()));
        }
    }
};

class Fails final : public Node
{
public:
    using Params = NoParams;
    static void describe(Declaration<Params>& d)
    {
        d.name("engine.fails").summary("Fails while running.");
        d.input("image", "Any image.");
        d.output("image", "Never whole.");
    }
    explicit Fails(const Params&) {}
    void plan(PlanContext& c) override { c.output("image", c.input("image")); }
    void compute(const TileContext& c) const override
    {
        if (c.region().y1 > 40) throw InputError("row 40 is bad");
        copy_pixels(c.input("image"), c.output("image"));
    }
};

} // namespace

void register_engine_nodes()
{
    static std::once_flag once;
    std::call_once(once, [] {
        Registry& r = Registry::instance();
        r.add(node_info<Gain>());
        r.add(node_info<Box>());
        r.add(node_info<Halve>());
        r.add(node_info<Total>());
        r.add(node_info<Shift>());
        r.add(node_info<Flipped>());
        r.add(node_info<Sum>());
        r.add(node_info<BlurAll>());
        r.add(node_info<Fails>());
    });
}

std::shared_ptr<MemoryImage> noise_image(const Region& window, int channels, unsigned seed)
{
    auto image = std::make_shared<MemoryImage>();
    image->desc.data = image->desc.display = window;
    for (int c = 0; c < channels; ++c)
        image->desc.channels.push_back(std::string(1, "RGBAZ"[c % 5]));
    image->pixels = ImageBuffer(window, channels);
    std::mt19937 random(seed);
    std::lognormal_distribution<float> value(-1.0f, 1.5f);
    for (int y = window.y0; y < window.y1; ++y)
        for (int c = 0; c < channels; ++c)
            for (float& v : image->pixels.view().row_span(c, y)) v = value(random);
    return image;
}

MemoryImage run_text(const std::string& text,
                     std::map<std::string, std::shared_ptr<const MemoryImage>> inputs,
                     const RunOptions& options, std::optional<Region> roi, RunReport* report)
{
    const Graph graph = parse_graph(text, "test.yaml");
    RunRequest request;
    for (const auto& [name, image] : inputs) request.inputs[name].images = {image};
    request.roi = roi;
    RunReport r = run_graph(graph, request, options);
    MemoryImage out = std::move(r.images.at(graph.outputs.front().name).front());
    if (report) *report = std::move(r);
    return out;
}

::testing::AssertionResult same_bits(const MemoryImage& a, const MemoryImage& b)
{
    if (a.desc.data != b.desc.data)
        return ::testing::AssertionFailure()
               << a.desc.data.text() << " is not " << b.desc.data.text();
    if (a.desc.channels != b.desc.channels)
        return ::testing::AssertionFailure() << "channels differ";
    for (int y = a.desc.data.y0; y < a.desc.data.y1; ++y)
        for (int c = 0; c < a.desc.channel_count(); ++c)
            for (int x = a.desc.data.x0; x < a.desc.data.x1; ++x) {
                const float u = a.pixels.view().at(c, x, y), v = b.pixels.view().at(c, x, y);
                if (std::memcmp(&u, &v, sizeof u) != 0)
                    return ::testing::AssertionFailure()
                           << "pixel (" << x << ", " << y << ") channel " << c << ": " << u
                           << " is not " << v;
            }
    return ::testing::AssertionSuccess();
}

} // namespace rayloom::test
