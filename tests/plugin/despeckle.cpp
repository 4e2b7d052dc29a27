// SPDX-License-Identifier: Apache-2.0
#include <rayloom/core/registry.h>

#include <algorithm>

using namespace rayloom;

struct Despeckle final : Node {
    struct Params {
        float factor = 1.0f;
    };
    static void describe(Declaration<Params>& d)
    {
        d.name("example.despeckle").summary("Dims pixels that outshine all their neighbours.");
        d.input("image", "linear radiance");
        d.output("image", "the same image without single bright pixels");
        d.param("factor", &Params::factor, "times the brightest neighbour a pixel may reach")
            .min(1);
    }
    explicit Despeckle(const Params& p) : params(p) {}

    void plan(PlanContext& context) override
    {
        window = context.input("image").data;
        context.needs("image", Halo::all(1)); // one pixel beyond the region that is asked for
        context.output("image", context.input("image"));
    }
    void compute(const TileContext& context) const override
    {
        const ConstImageView in = context.input("image");
        const ImageView out = context.output("image");
        const Region& r = context.region();
        for (int c = 0; c < out.channels(); ++c)
            for (int y = r.y0; y < r.y1; ++y)
                for (int x = r.x0; x < r.x1; ++x) {
                    float brightest = 0.0f;
                    for (int v = y - 1; v <= y + 1; ++v)
                        for (int u = x - 1; u <= x + 1; ++u)
                            if ((u != x || v != y) && window.contains(u, v))
                                brightest = std::max(brightest, in.at(c, u, v));
                    out.at(c, x, y) = std::min(in.at(c, x, y), params.factor * brightest);
                }
    }

    Params params;
    Region window;
};
RAYLOOM_NODE(Despeckle);
