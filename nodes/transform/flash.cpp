// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <array>
#include <string>

namespace rayloom
{
namespace
{

/// One product of the light that is kept: colour · (direct + indirect), each of them optional.
struct Lobe {
    const char* direct;
    const char* indirect; ///< null: not kept
    const char* colour;   ///< null: none
};
constexpr std::array<Lobe, 5> lobes{
    {{"diffuse_direct", nullptr, "diffuse_color"},
     {"glossy_direct", "glossy_indirect", "glossy_color"},
     {"transmission_direct", "transmission_indirect", "transmission_color"},
     {"emission", nullptr, nullptr},
     {"environment", nullptr, nullptr}}};

/// transform.flash: partial light plus flash.
class Flash final : public Node
{
public:
    struct Params {
        float intensity = 1.0f;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.flash")
            .summary("Composes a virtual flash image: partial light plus k times a unit flash.")
            .doc(
                "F = P + k·U. P is `partial`, or the sum of the given light passes, which should "
                "be "
                "all but indirect diffuse: each lobe is colour·(direct + indirect), without the "
                "colour where that input is absent (renderers whose passes are not divided by it). "
                "U is the light of an unshadowed unit point light at the camera; without it F = P, "
                "which also makes P out of passes. k is the figure `intensity` of the table (from "
                "fit.flash_intensity), or the parameter. Alpha of `partial` or of the first pass "
                "is "
                "not kept: the result is a guide.")
            .source("000_092f36e585912bb0.txt, section 3.1")
            .accuracy("Summed in float in the order of the ports.")
            .example("rayloom: 1\n"
                     "name: flash-example\n"
                     "inputs:\n"
                     "  partial: {doc: light without indirect diffuse, channels: RGB}\n"
                     "  flash_unit: {doc: light of a unit flash, channels: RGB}\n"
                     "nodes:\n"
                     "  flash: {op: transform.flash, partial: partial, flash_unit: flash_unit,\n"
                     "          intensity_factor: 3}\n"
                     "outputs:\n"
                     "  image: flash.image\n");
        d.input("partial", "P, ready made").optional();
        for (const Lobe& lobe : lobes) {
            d.input(lobe.direct, std::string("light pass: ") + lobe.direct).optional();
            if (lobe.indirect)
                d.input(lobe.indirect, std::string("light pass: ") + lobe.indirect).optional();
            if (lobe.colour)
                d.input(lobe.colour,
                        std::string("what the lobe's passes are divided by: ") + lobe.colour)
                    .optional();
        }
        d.input("flash_unit", "U, light of a unit flash").optional();
        d.input("intensity", "table with the figure `intensity`").table().optional();
        d.output("image", "F, colour channels");
        d.param("intensity_factor", &Params::intensity,
                "k without a table; a factor on k with one.")
            .range(0, 1e9)
            .source("section 3.1, figure 3");
    }

    explicit Flash(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        std::vector<std::string> light;
        for (const Lobe& lobe : lobes)
            for (const char* port : {lobe.direct, lobe.indirect})
                if (port && context.has(port)) light.push_back(port);
        const bool partial = context.has("partial");
        if (partial == !light.empty())
            throw NodeError(partial ? "connect either 'partial' or light passes, not both"
                                    : "connect 'partial', or light passes to make it from "
                                      "(diffuse_direct, glossy_direct, …)");
        const std::string first = partial ? "partial" : light.front();
        const ImageDesc& desc = context.input(first);
        const std::vector<int> colours = desc.colour();
        m_count = colours.size();
        const auto check = [&](const char* port) {
            if (port && context.has(port))
                m_channels[port] = matching_colours(context, first, port);
        };
        check("partial");
        for (const Lobe& lobe : lobes) {
            check(lobe.direct);
            check(lobe.indirect);
            check(lobe.colour);
        }
        check("flash_unit");
        if (!context.has("flash_unit")) context.note("no flash_unit: F is the partial light alone");
        context.output("image", desc.with_channels(channel_names(desc, colours)));
    }

    void compute(const TileContext& context) const override
    {
        const ImageView out = context.output("image");
        const Region& region = context.region();
        const bool flash = context.has("flash_unit");
        float k = m.intensity;
        if (flash && context.has("intensity"))
            k *= static_cast<float>(context.table("intensity").number("intensity"));
        const auto width = static_cast<std::size_t>(region.width());
        for (int y = region.y0; y < region.y1; ++y)
            for (std::size_t c = 0; c < m_count; ++c) {
                float* to = out.row(static_cast<int>(c), y);
                const auto pass = [&](const char* port) -> const float* {
                    if (!port || !context.has(port)) return nullptr;
                    return context.input(port).ptr(m_channels.find(port)->second[c], region.x0, y);
                };
                if (const float* partial = pass("partial"))
                    std::copy_n(partial, width, to);
                else
                    std::fill_n(to, width, 0.0f);
                for (const Lobe& lobe : lobes) {
                    const float* direct = pass(lobe.direct);
                    const float* indirect = pass(lobe.indirect);
                    const float* colour = pass(lobe.colour);
                    if (!direct && !indirect) continue;
                    for (std::size_t i = 0; i < width; ++i) {
                        const float sum =
                            (direct ? direct[i] : 0.0f) + (indirect ? indirect[i] : 0.0f);
                        to[i] += colour ? colour[i] * sum : sum;
                    }
                }
                if (flash) {
                    const float* unit = pass("flash_unit");
                    for (std::size_t i = 0; i < width; ++i) to[i] += k * unit[i];
                }
            }
    }

private:
    Params m;
    std::size_t m_count = 0;
    std::map<std::string, std::vector<int>, std::less<>> m_channels;
};

RAYLOOM_NODE(Flash);

} // namespace
} // namespace rayloom
