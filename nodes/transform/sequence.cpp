// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/registry.h"

#include <algorithm>
#include <string>
#include <vector>

namespace rayloom
{
namespace
{

/// transform.sequence: a frame and its neighbours as one list.
class Sequence final : public Node
{
public:
    struct Params {
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.sequence")
            .summary("Puts a frame between the frames before and after it.")
            .doc("The list is before, frame, after, in that order; either neighbour list may be "
                 "absent, "
                 "as at the ends of an animation. No pixel is copied.")
            .accuracy("Exact.")
            .example("rayloom: 1\n"
                     "name: sequence-example\n"
                     "inputs:\n"
                     "  frame: {doc: the current frame, channels: RGB}\n"
                     "  before: {doc: frames before it, kind: list, channels: RGB}\n"
                     "nodes:\n"
                     "  frames: {op: transform.sequence, before: before, frame: frame}\n"
                     "  result: {op: fuse.nlm, image: frames.frames, earlier: before, gate: none,\n"
                     "           range: 0.1, window: 7}\n"
                     "outputs:\n"
                     "  image: result.image\n");
        d.input("before", "frames before the current one, in order").list().optional();
        d.input("frame", "the current frame");
        d.input("after", "frames after it, in order").list().optional();
        d.output("frames", "all of them").list();
    }

    explicit Sequence(const Params&) {}

    void plan(PlanContext& context) override
    {
        m_from.clear();
        std::vector<ImageDesc> descs;
        for (const char* port : {"before", "frame", "after"})
            for (std::size_t i = 0; context.has(port) && i < context.count(port); ++i) {
                context.require_same_window("frame", port, 0, i);
                if (context.input(port, i).channels != context.input("frame").channels)
                    throw NodeError(std::string(port) + "[" + std::to_string(i) +
                                    "] has other channels than the frame");
                descs.push_back(context.input(port, i));
                m_from.push_back({port, i});
            }
        context.output_list("frames", descs);
        for (std::size_t i = 0; i < m_from.size(); ++i)
            context.pass_through("frames", m_from[i].port, i, m_from[i].element);
        for (const char* port : {"before", "frame", "after"})
            if (context.has(port))
                context.needs(port, [this, name = std::string(port)](const Need& need) {
                    const Source& source = m_from[need.output_element];
                    return name == source.port && need.input_element == source.element ? need.region
                                                                                       : Region{};
                });
    }

    void compute(const TileContext& context) const override
    {
        const Source& source = m_from[context.element()];
        copy_pixels(context.input(source.port, source.element).crop(context.region()),
                    context.output("frames"));
    }

private:
    struct Source {
        const char* port;
        std::size_t element;
    };
    std::vector<Source> m_from;
};

RAYLOOM_NODE(Sequence);

} // namespace
} // namespace rayloom
