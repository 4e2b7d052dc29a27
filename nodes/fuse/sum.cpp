// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <vector>

namespace rayloom
{

/// Sum of partial images.
class FuseSum final : public Node
{
public:
    struct Params {
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("fuse.sum")
            .summary("Adds images: filtered partial images and the unfiltered remainder.")
            .doc("Colour channels are added in double, in the order of the list, `base` first, and "
                 "rounded once; alpha and every other channel are those of `base`, or of the "
                 "first image without one. All images need the same data window.")
            .source("003_fb3ee135f07a6099.txt, section 8")
            .accuracy("Rounded once to float.")
            .example("rayloom: 1\n"
                     "name: sum-example\n"
                     "doc: The sum of two light passes.\n"
                     "inputs:\n"
                     "  direct: {doc: direct light, channels: RGB}\n"
                     "  indirect: {doc: indirect light, channels: RGB}\n"
                     "nodes:\n"
                     "  light:\n"
                     "    op: fuse.sum\n"
                     "    images: [direct, indirect]\n"
                     "outputs:\n"
                     "  image: light\n");
        d.input("images", "images to add; may be absent when there is a base").list().optional();
        d.input("base", "added first; gives alpha and windows").optional();
        d.output("image", "the sum");
    }

    explicit FuseSum(const Params&) {}

    void plan(PlanContext& context) override
    {
        const std::size_t n = context.count("images");
        m_base = context.has("base");
        if (n == 0 && !m_base) throw NodeError("nothing to add: connect 'images', 'base' or both");
        const ImageDesc& first = m_base ? context.input("base") : context.input("images", 0);
        const char* port = m_base ? "base" : "images";
        m_colours.clear();
        if (m_base) m_colours.push_back(first.colour());
        for (std::size_t i = 0; i < n; ++i)
            m_colours.push_back(matching_colours(context, port, "images", ColourCount::same, i));
        context.output("image", first);
        if (m_colours.size() == 1) context.pass_through("image", port);
        m_passed.plan(context, port, m_colours[0]);
    }

    void compute(const TileContext& context) const override
    {
        const Region& r = context.region();
        const ImageView out = context.output("image");
        const auto image = [&](std::size_t i) {
            if (!m_base) return context.input("images", i);
            return i == 0 ? context.input("base") : context.input("images", i - 1);
        };
        std::vector<ConstImageView> images;
        for (std::size_t i = 0; i < m_colours.size(); ++i) images.push_back(image(i));
        for (int y = r.y0; y < r.y1; ++y)
            for (std::size_t c = 0; c < m_colours[0].size(); ++c) {
                const auto row = [&](std::size_t i) {
                    return images[i].ptr(m_colours[i][c], r.x0, y);
                };
                add_rows(row, images.size(), out.row(m_colours[0][c], y), r.width());
            }
        m_passed.copy(image(0), out);
    }

private:
    /// Σ row(i)[x] in double, rounded once; a block's sums stay in the first-level cache. Of two
    /// rows float's own sum is the same: double has more than twice its digits (and begins at +0,
    /// which makes −0 of two −0 a +0).
    template <class Row>
    static void add_rows(const Row& row, std::size_t count, float* to, int width)
    {
        if (count == 1) {
            std::copy_n(row(0), width, to);
            return;
        }
        if (count == 2) {
            const float *a = row(0), *b = row(1);
            for (int x = 0; x < width; ++x) to[x] = 0.0f + a[x] + b[x];
            return;
        }
        constexpr int block = 128;
        for (int x0 = 0; x0 < width; x0 += block) {
            const int n = std::min(block, width - x0);
            double sum[block] = {};
            for (std::size_t i = 0; i < count; ++i) {
                const float* from = row(i) + x0;
                for (int x = 0; x < n; ++x) sum[x] += static_cast<double>(from[x]);
            }
            for (int x = 0; x < n; ++x) to[x0 + x] = static_cast<float>(sum[x]);
        }
    }

    std::vector<std::vector<int>> m_colours; ///< [image]
    PassedChannels m_passed;
    bool m_base = false;
};

RAYLOOM_NODE(FuseSum);

} // namespace rayloom
