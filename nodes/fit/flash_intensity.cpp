// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <string>

namespace rayloom
{
namespace
{

/// fit.flash_intensity: how bright the virtual flash must be.
class FlashIntensity final : public Node
{
public:
    struct Params {
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("fit.flash_intensity")
            .summary("Finds the flash intensity that gives the flash image the input's brightness.")
            .doc("k ≥ 0 such that the mean luminance (Rec. 709 weights) of partial + k·flash_unit "
                 "equals that of image: the flash makes up for the light that `partial` lacks. "
                 "Where partial is already as bright, or flash_unit is black or absent, k = 0 and "
                 "the flash image is `partial` alone.")
            .source("000_092f36e585912bb0.txt, section 3.1")
            .accuracy("Sums in double.")
            .example("rayloom: 1\n"
                     "name: flash-intensity-example\n"
                     "inputs:\n"
                     "  image: {doc: noisy radiance, channels: RGB}\n"
                     "  partial: {doc: its light without indirect diffuse, channels: RGB}\n"
                     "  flash_unit: {doc: light of a unit flash, channels: RGB}\n"
                     "nodes:\n"
                     "  fit: {op: fit.flash_intensity, image: image, partial: partial,\n"
                     "        flash_unit: flash_unit}\n"
                     "  flash: {op: transform.flash, partial: partial, flash_unit: flash_unit,\n"
                     "          intensity: fit.intensity}\n"
                     "outputs:\n"
                     "  image: flash.image\n");
        d.input("image", "the noisy render");
        d.input("partial", "its light without what bounces off several diffuse surfaces");
        d.input("flash_unit", "light of an unshadowed unit point light at the camera").optional();
        d.output("intensity", "one row: intensity, and the mean luminance of each input").table();
    }

    explicit FlashIntensity(const Params&) {}

    void plan(PlanContext& context) override
    {
        const std::size_t colours = context.input("image").colour().size();
        if (colours != 1 && colours != 3)
            throw NodeError("input 'image' has " + std::to_string(colours) +
                            " colour channels; it must have R, G, B, or one channel");
        for (const char* port : {"image", "partial", "flash_unit"}) {
            if (!context.has(port)) continue;
            m_channels[port] = matching_colours(context, "image", port);
            context.reduce_needs(port);
        }
        if (!context.has("flash_unit"))
            context.note("no flash_unit: the flash image is the partial light alone");
        m_pixels = static_cast<double>(context.input("image").data.pixels());
        context.reduce(context.input("image").data, 3);
    }

    void compute(const TileContext&) const override {}

    void reduce(const TileContext& row, std::span<double> sums) const override
    {
        std::size_t next = 0;
        for (const char* port : {"image", "partial", "flash_unit"}) {
            double& sum = sums[next++];
            if (!row.has(port)) continue;
            const std::vector<int>& channels = m_channels.find(port)->second;
            static constexpr double weights[] = {0.2126, 0.7152, 0.0722};
            for (std::size_t c = 0; c < channels.size(); ++c) {
                const double weight = channels.size() == 3 ? weights[c] : 1.0;
                const Region& region = row.region();
                for (int y = region.y0; y < region.y1; ++y) {
                    const float* from = row.input(port).ptr(channels[c], region.x0, y);
                    for (int i = 0; i < region.width(); ++i)
                        sum += weight * static_cast<double>(from[i]);
                }
            }
        }
    }

    std::map<std::string, Table, std::less<>> finish(std::span<const double> totals,
                                                     std::span<const TileContext::Input>) override
    {
        const double missing = totals[0] - totals[1];
        Table table;
        table.set("intensity", totals[2] > 0.0 ? std::max(0.0, missing / totals[2]) : 0.0);
        table.set("image_luminance", totals[0] / m_pixels);
        table.set("partial_luminance", totals[1] / m_pixels);
        table.set("flash_unit_luminance", totals[2] / m_pixels);
        return {{"intensity", table}};
    }

private:
    std::map<std::string, std::vector<int>, std::less<>> m_channels;
    double m_pixels = 1.0;
};

RAYLOOM_NODE(FlashIntensity);

} // namespace
} // namespace rayloom
