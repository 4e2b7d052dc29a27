// SPDX-License-Identifier: Apache-2.0
#include "tests/support/run_node.h"

#include <algorithm>
#include <cstring>

namespace rayloom::test
{

namespace
{

/// What is in an output before the node fills it, so that a pixel it forgets stands out.
constexpr float never_filled = -12345.0f;

class Services final : public RunServices
{
public:
    Services(NodeRun& run, bool skip) : m_run(&run), m_skip(skip) {}
    bool cancelled() const noexcept override { return false; }
    bool may_skip() const noexcept override { return m_skip; }
    void count_skip(std::string_view reason, std::size_t pixels) override
    {
        m_run->skipped[std::string(reason)] += pixels;
    }
    void count(std::string_view what, std::size_t n) override
    {
        m_run->counted[std::string(what)] += n;
    }

private:
    NodeRun* m_run;
    bool m_skip;
};

ImageBuffer copy_of(ConstImageView from, const Region& part)
{
    ImageBuffer copy(part, from.channels());
    copy_pixels(from, copy.view());
    return copy;
}

/// Inputs of one call, as views of buffers that hold nothing but what was asked for.
struct CallInputs {
    std::vector<std::vector<ImageBuffer>> buffers;
    std::vector<std::vector<ConstImageView>> views;
    std::vector<std::vector<DeepView>> deep;
    std::vector<TileContext::Input> inputs;
};

CallInputs gather(const std::vector<NodeInput>& given,
                  const std::map<std::string, NeedFunction, std::less<>>& needs,
                  const Region& region, std::size_t element, bool only_named)
{
    CallInputs call;
    for (const NodeInput& in : given) {
        const auto need = needs.find(in.port);
        if (only_named && need == needs.end()) continue;
        auto& buffers = call.buffers.emplace_back();
        auto& views = call.views.emplace_back();
        auto& deep = call.deep.emplace_back();
        const auto part = [&](std::size_t i, const Region& data) {
            const Region wanted =
                need == needs.end() ? region : need->second(Need{i, element, region});
            return wanted.intersect(data);
        };
        for (std::size_t i = 0; i < in.images.size(); ++i) {
            buffers.push_back(copy_of(in.images[i]->view(), part(i, in.images[i]->desc.data)));
            views.push_back(buffers.back().view());
        }
        if (in.deep)
            deep.push_back({in.deep->desc.data, in.deep->desc.channel_count(), in.deep->rows});
    }
    std::size_t k = 0;
    for (const NodeInput& in : given) {
        if (only_named && needs.find(in.port) == needs.end()) continue;
        call.inputs.push_back({in.port, call.views[k], call.deep[k], nullptr});
        ++k;
    }
    return call;
}

} // namespace

TestImage make_image(const Region& data, std::vector<std::string> channels,
                     const std::function<float(int, int, int)>& value)
{
    TestImage image;
    image.desc.data = image.desc.display = data;
    image.desc.channels = std::move(channels);
    image.pixels = ImageBuffer(data, image.desc.channel_count());
    for (int c = 0; c < image.desc.channel_count(); ++c)
        for (int y = data.y0; y < data.y1; ++y)
            for (int x = data.x0; x < data.x1; ++x) image.view().at(c, x, y) = value(c, x, y);
    return image;
}

const TestImage& NodeRun::image(std::string_view port, std::size_t element) const
{
    return outputs.find(port)->second.at(element);
}

NodeRun run_node(std::string_view op, const ParamValues& params,
                 const std::vector<NodeInput>& inputs, const RunOptions& options)
{
    const NodeInfo* info = Registry::instance().find(op);
    if (!info) throw Error("no node is called " + std::string(op));
    ParamValues checked;
    for (const ParamInfo& p : info->params) {
        const auto given = params.find(p.name);
        checked[p.name] = check_param(p, given == params.end() ? p.default_value : given->second);
    }
    for (const auto& [name, value] : params)
        if (!info->param(name)) throw Error(std::string(op) + " has no parameter " + name);
    const auto node = info->create(checked);

    std::map<std::string, PlannedInput, std::less<>> planned;
    for (const PortInfo& port : info->inputs) planned[port.name].kind = port.kind;
    for (const NodeInput& in : inputs) {
        PlannedInput& p = planned.at(in.port);
        p.connected = true;
        for (const TestImage* image : in.images) p.images.push_back(image->desc);
        if (in.deep) p.images.push_back(in.deep->desc);
    }
    PlanContext plan(planned);
    node->plan(plan);

    NodeRun run;
    run.plan = plan.result();
    Services services(run, options.may_skip);
    if (run.plan.reduction) {
        const Region& domain = run.plan.reduction->domain;
        const int step = run.plan.reduction->block_rows;
        std::vector<double> totals(run.plan.reduction->values, 0.0);
        for (int y = domain.y0; y < domain.y1; y += step) {
            const Region rows{domain.x0, y, domain.x1, std::min(y + step, domain.y1)};
            const CallInputs call = gather(inputs, run.plan.reduce_needs, rows, 0, true);
            std::vector<double> sums(totals.size(), 0.0);
            node->reduce(TileContext(rows, 0, call.inputs, {}, services), sums);
            if (y == domain.y0)
                totals = std::move(sums);
            else
                node->combine(totals, sums);
        }
        run.tables = node->finish(totals, {});
    }

    const auto wanted = [&](const std::string& port) {
        return options.wanted.empty() || std::find(options.wanted.begin(), options.wanted.end(),
                                                   port) != options.wanted.end();
    };
    std::size_t elements = 0;
    for (const auto& [port, descs] : run.plan.outputs) {
        if (!wanted(port)) continue;
        elements = std::max(elements, descs.size());
        for (const ImageDesc& desc : descs) {
            run.outputs[port].push_back({desc, ImageBuffer(desc.data, desc.channel_count())});
            run.outputs[port].back().pixels.fill(never_filled);
        }
    }
    for (std::size_t element = 0; element < elements; ++element) {
        const Region data = run.outputs.begin()->second[element].desc.data;
        for (int y = data.y0; y < data.y1; y += options.tile_height)
            for (int x = data.x0; x < data.x1; x += options.tile_width) {
                const Region tile = Region{x, y, std::min(x + options.tile_width, data.x1),
                                           std::min(y + options.tile_height, data.y1)};
                const CallInputs call = gather(inputs, run.plan.needs, tile, element, false);
                std::vector<TileContext::Output> outputs;
                for (auto& [port, images] : run.outputs)
                    outputs.push_back({port, images[element].view().crop(tile)});
                node->compute(TileContext(tile, element, call.inputs, outputs, services));
            }
    }
    return run;
}

std::size_t differing_floats(const TestImage& a, const TestImage& b)
{
    std::size_t n = 0;
    const Region& r = a.desc.data;
    for (int c = 0; c < a.desc.channel_count(); ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x)
                n += std::memcmp(a.view().ptr(c, x, y), b.view().ptr(c, x, y), sizeof(float)) != 0;
    return n;
}

} // namespace rayloom::test
