// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/log_kernel.h"
#include "rayloom/core/registry.h"

namespace rayloom
{
namespace
{

/// transform.exp: back from transform.log.
class Exp final : public Node
{
public:
    struct Params {
        bool opponent = false;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.exp")
            .summary("Undoes transform.log.")
            .doc("x = max(e^y − ε, 0) with the ε of the figures; with `opponent` the axes are "
                 "turned back first and the channels are R, G and B again. A mean of logarithms is "
                 "below the logarithm of the mean, so what was smoothed between the two comes "
                 "back too dark: transform.restore_mean is the stage that puts it right.")
            .source("001_6a300dc64642895d.txt, section 4.2")
            .accuracy("log and exp in a row: relative error ≤ 1e-6 (|ln(x + ε)| + 1) of x + ε.")
            .example("rayloom: 1\n"
                     "name: exp-example\n"
                     "doc: There and back.\n"
                     "inputs:\n"
                     "  image: {doc: linear radiance}\n"
                     "nodes:\n"
                     "  log: {op: transform.log, image: image, opponent: true}\n"
                     "  back: {op: transform.exp, image: log.log, figures: log.figures, "
                     "opponent: true}\n"
                     "outputs:\n"
                     "  image: back\n");
        d.input("image", "logarithms");
        d.input("figures", "figures of the transform.log they came from").table();
        d.output("image", "linear radiance, not negative");
        d.param("opponent", &Params::opponent, "The input is in log-opponent axes.");
    }
    explicit Exp(const Params& p) : m_params(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        if (m_params.opponent && image.channel_count() != 3)
            throw NodeError("opponent axes are three channels; the image has " +
                            std::to_string(image.channel_count()));
        context.output("image", m_params.opponent ? image.with_channels({"R", "G", "B"}) : image);
    }

    void compute(const TileContext& context) const override
    {
        const Table& figures = context.table("figures");
        if ((figures.number("opponent") != 0.0) != m_params.opponent)
            throw InputError("transform.exp and the transform.log before it disagree about "
                             "opponent axes; give both the same value");
        const auto epsilon = static_cast<float>(figures.number("epsilon"));
        const ConstImageView image = context.input("image");
        const ImageView out = context.output("image");
        const Region& r = context.region();
        for (int y = r.y0; y < r.y1; ++y) {
            if (m_params.opponent) {
                const float *const l = image.ptr(0, r.x0, y), *const c1 = image.ptr(1, r.x0, y),
                                   *const c2 = image.ptr(2, r.x0, y);
                float *const red = out.row(0, y), *const green = out.row(1, y),
                             *const blue = out.row(2, y);
                for (int i = 0; i < r.width(); ++i) {
                    const float side = l[i] + 0.707106781f * c2[i], turn = 1.22474487f * c1[i];
                    red[i] = side + turn;
                    blue[i] = side - turn;
                    green[i] = l[i] - 1.41421356f * c2[i];
                }
            }
            for (int c = 0; c < out.channels(); ++c) {
                float* const to = out.row(c, y);
                const float* const in = m_params.opponent ? to : image.ptr(c, r.x0, y);
                for (int i = 0; i < r.width(); ++i) {
                    const float x = exp_of(in[i]) - epsilon;
                    to[i] = x > 0.0f ? x : 0.0f;
                }
            }
        }
    }

private:
    Params m_params;
};

RAYLOOM_NODE(Exp);

} // namespace
} // namespace rayloom
