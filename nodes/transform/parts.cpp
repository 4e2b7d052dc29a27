// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/render_roles.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <cctype>
#include <cmath>

namespace rayloom
{
namespace
{

/// transform.parts: which objects and materials a pixel sees.
class Parts final : public Node
{
public:
    struct Params {
        std::string source = "auto";
        int ranks = 3;
        std::string renderer = "auto";
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.parts")
            .version(2)
            .summary("Says of each pixel which objects it sees, as pairs of id and coverage.")
            .doc("From a cryptomatte (its first one, object before material): the pixel's ranks as "
                 "they are, names stay numbers. From ID passes: one pair, the id made of object "
                 "and material number, coverage 1; whole numbers below 4096 stay apart. With "
                 "'auto' a cryptomatte comes first: it knows how much of a pixel each object "
                 "covers, "
                 "where an ID pass is one sample of it and jagged under defocus and motion. With "
                 "neither, every pixel is of the same part and the report says so.\n\n"
                 "Two pixels share Σ min(coverage) over equal ids: 1 for the same objects, 0 for "
                 "different ones, between for a partial overlap.")
            .source("003_fb3ee135f07a6099.txt, section 4.4, weight of parts; Friedman and Jones "
                    "2015, Fully automatic ID mattes with support for motion blur and transparency")
            .accuracy("Exact.")
            .example("rayloom: 1\n"
                     "name: parts-example\n"
                     "doc: Ids of a render, if it has any.\n"
                     "inputs:\n"
                     "  render: {doc: all layers of a render}\n"
                     "nodes:\n"
                     "  parts: {op: transform.parts, render: render}\n"
                     "outputs:\n"
                     "  parts: parts\n");
        d.input("render", "all layers of a render, channels named layer.channel");
        d.output("parts", "id0, coverage0, id1, coverage1, …");
        d.param("source", &Params::source, "where ids come from")
            .choices({"auto", "ids", "cryptomatte", "none"});
        d.param("ranks", &Params::ranks, "pairs of a cryptomatte that are kept").range(1, 6);
        d.param("renderer", &Params::renderer,
                "renderer map to use; auto: the one that knows most layers");
    }

    explicit Parts(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& render = context.input("render");
        const RenderRoles roles(render, m.renderer);
        m_channels.clear();
        m_ids = false;
        if (m.source == "auto" || m.source == "cryptomatte") find_cryptomatte(roles);
        if (m_channels.empty() && (m.source == "auto" || m.source == "ids")) {
            for (const char* role : {"object_id", "material_id"})
                if (const int found = roles.find(role); found >= 0)
                    m_channels.push_back(
                        roles.layers()[static_cast<std::size_t>(found)].indices[0]);
            m_ids = !m_channels.empty();
        }
        if (m_channels.empty()) {
            if (m.source == "ids" || m.source == "cryptomatte")
                throw NodeError("the render has no " +
                                std::string(m.source == "ids" ? "ID pass" : "cryptomatte"));
            if (m.source == "auto")
                context.note("no ID pass and no cryptomatte: all pixels are of one part");
        }
        std::vector<std::string> names;
        const std::size_t pairs = m_ids || m_channels.empty() ? 1 : m_channels.size() / 2;
        for (std::size_t i = 0; i < pairs; ++i) {
            names.push_back("id" + std::to_string(i));
            names.push_back("coverage" + std::to_string(i));
        }
        context.output("parts", render.with_channels(names));
    }

    void compute(const TileContext& context) const override
    {
        const Region& r = context.region();
        const ConstImageView render = context.input("render");
        const ImageView out = context.output("parts");
        for (int y = r.y0; y < r.y1; ++y) {
            if (m_ids || m_channels.empty()) {
                float* id = out.row(0, y);
                std::fill_n(id, r.width(), 0.0f);
                std::fill_n(out.row(1, y), r.width(), 1.0f);
                for (const int c : m_channels) {
                    const float* from = render.ptr(c, r.x0, y);
                    for (int x = 0; x < r.width(); ++x)
                        id[x] = id[x] * 4096.0f + (std::isfinite(from[x]) ? from[x] : 4095.0f);
                }
                continue;
            }
            for (std::size_t i = 0; i < m_channels.size(); ++i)
                std::copy_n(render.ptr(m_channels[i], r.x0, y), r.width(),
                            out.row(static_cast<int>(i), y));
        }
    }

private:
    /// The ranks of the first cryptomatte: layers NAME00, NAME01, … with R G B A = two pairs.
    void find_cryptomatte(const RenderRoles& roles)
    {
        const auto& layers = roles.layers();
        std::vector<int> found = roles.find_all("cryptomatte");
        const auto stem = [&](int i) {
            std::string name = layers[static_cast<std::size_t>(i)].layer;
            const auto digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)); };
            if (name.empty() || !digit(name.back())) return std::string();
            while (!name.empty() && digit(name.back())) name.pop_back();
            return name;
        };
        std::erase_if(found, [&](int i) {
            return layers[static_cast<std::size_t>(i)].indices.size() < 4 || stem(i).empty();
        });
        if (found.empty()) return;
        std::string chosen = stem(found[0]);
        for (const int i : found)
            if (stem(i).find("bject") != std::string::npos) chosen = stem(i);
        std::erase_if(found, [&](int i) { return stem(i) != chosen; });
        std::sort(found.begin(), found.end(), [&](int a, int b) {
            return layers[static_cast<std::size_t>(a)].layer <
                   layers[static_cast<std::size_t>(b)].layer;
        });
        for (const int i : found) {
            const LayerChannels& layer = layers[static_cast<std::size_t>(i)];
            // Files may hold the channels in any order; the pairs are R G and B A.
            for (const char name : {'r', 'g', 'b', 'a'}) {
                const auto at =
                    std::find_if(layer.names.begin(), layer.names.end(), [&](const std::string& n) {
                        return n.size() == 1 &&
                               std::tolower(static_cast<unsigned char>(n[0])) == name;
                    });
                if (at == layer.names.end()) return m_channels.clear();
                if (m_channels.size() < static_cast<std::size_t>(2 * m.ranks))
                    m_channels.push_back(
                        layer.indices[static_cast<std::size_t>(at - layer.names.begin())]);
            }
        }
    }

    Params m;
    bool m_ids = false;
    std::vector<int> m_channels;
};
RAYLOOM_NODE(Parts);

} // namespace
} // namespace rayloom
