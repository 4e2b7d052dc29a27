// SPDX-License-Identifier: Apache-2.0
#include "tests/support/plane_scene.h"

#include "tests/support/raster.h"

#include <algorithm>
#include <cmath>
#include <random>

namespace rayloom::test
{

namespace
{

std::vector<std::string> colour_names(int colours)
{
    return colours == 1 ? std::vector<std::string>{"Y"} : std::vector<std::string>{"R", "G", "B"};
}

} // namespace

std::vector<NodeInput> PlaneScene::inputs(const TestImage* planes) const
{
    std::vector<NodeInput> list{{"image", {&image}}};
    if (planes)
        list.push_back({"coefficients", {planes}});
    else
        list.push_back({"variance", {&variance}});
    if (normal) list.push_back({"normal", {&*normal}});
    if (boundary) list.push_back({"boundary", {&*boundary}});
    if (parts) list.push_back({"parts", {&*parts}});
    if (pivot) list.push_back({"pivot", {&*pivot}});
    return list;
}

oracle::PlaneInput PlaneScene::for_oracle() const
{
    oracle::PlaneInput in{to_raster(image), to_raster(variance), {}, {}, {}, {}, 0, 0};
    if (normal) in.normal = to_raster(*normal);
    if (boundary) in.boundary = to_raster(*boundary);
    if (parts) in.parts = to_raster(*parts);
    if (pivot) in.pivot = to_raster(*pivot);
    in.x0 = image.desc.data.x0;
    in.y0 = image.desc.data.y0;
    return in;
}

PlaneScene even_scene(const Region& data, int colours,
                      const std::function<float(int, int, int)>& value, float variance)
{
    PlaneScene scene;
    scene.image = make_image(data, colour_names(colours), value);
    scene.variance =
        make_image(data, colour_names(colours), [&](int, int, int) { return variance; });
    return scene;
}

PlaneScene noisy_scene(const Region& data, int colours, float noise, unsigned seed)
{
    std::mt19937 random(seed);
    std::normal_distribution<float> normal(0.0f, 1.0f);
    const auto object = [&](int x, int y) { return (x - data.x0) / 13 + (y - data.y0) / 17; };
    PlaneScene scene;
    scene.image = make_image(data, colour_names(colours), [&](int c, int x, int y) {
        const float light = (object(x, y) % 2 == 0 ? 0.6f : 1.4f) +
                            0.02f * static_cast<float>(x - data.x0) + 0.1f * static_cast<float>(c);
        return std::max(0.0f, light * (1.0f + noise * normal(random)));
    });
    scene.variance = make_image(data, colour_names(colours), [&](int, int x, int y) {
        return noise * noise * (object(x, y) % 2 == 0 ? 0.5f : 2.0f);
    });
    scene.normal = make_image(data, {"X", "Y", "Z"}, [&](int c, int x, int y) {
        if (x % 19 == 7 && y % 11 == 3) return 0.0f;
        const float a = 0.5f * static_cast<float>(object(x, y)) + 0.02f * static_cast<float>(y);
        return c == 0 ? std::sin(a) : c == 1 ? 0.0f : std::cos(a);
    });
    scene.boundary = make_image(data, {"boundary"}, [&](int, int x, int y) {
        return object(x, y) != object(x + 1, y) ? 1.0f : 0.0f;
    });
    scene.parts =
        make_image(data, {"id0", "coverage0", "id1", "coverage1"}, [&](int c, int x, int y) {
            const bool edge = object(x, y) != object(x, y + 1);
            switch (c) {
            case 0: return static_cast<float>(object(x, y));
            case 1: return edge ? 0.75f : 1.0f;
            case 2: return static_cast<float>(object(x, y + 1)) + (edge ? 0.0f : 100.0f);
            default: return edge ? 0.25f : 0.0f;
            }
        });
    return scene;
}

TestImage filter_planes(const PlaneScene& scene, const ParamValues& fit, const ParamValues& fuse,
                        const RunOptions& options)
{
    NodeRun fitted = run_node("fit.plane", fit, scene.inputs(), options);
    NodeRun fused =
        run_node("fuse.planes", fuse, scene.inputs(&fitted.image("coefficients")), options);
    return std::move(fused.outputs.at("image")[0]);
}

} // namespace rayloom::test
