// SPDX-License-Identifier: Apache-2.0
#include "tests/stress/hostile_images.h"

#include "tests/support/made_up_deep.h"
#include "tests/support/made_up_input.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace rayloom::test
{

namespace
{

using PixelChange = std::function<float(int channel, int x, int y, float was)>;

constexpr float nan = std::numeric_limits<float>::quiet_NaN();
constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float denormal = 1e-40f;

/// Counts of samples and the bins they lie in are not radiance: their kinds of hostility are apart.
bool counts_something(const std::string& input)
{
    return input.ends_with("histogram") || input.ends_with("count");
}

/// What surfaces make of light: a share of it, not an amount.
bool is_share(const std::string& input)
{
    for (const char* share : {"albedo", "_color", "pivot", "flash_unit"})
        if (input.ends_with(share)) return true;
    return input == "multiplier" || input == "other";
}

bool holds_variance(const std::string& input) { return input.ends_with("variance"); }

HostileCase with_pixels(std::string name, Demand demand, const Region& window, PixelChange change)
{
    return {
        std::move(name), demand, [=](const Graph& graph) {
            RunRequest request = made_up_request(graph, window);
            change_images(request, [&](const std::string& input, std::size_t, MemoryImage& image) {
                // Light times a share of 1e30 has no float to be in.
                const bool given = demand == Demand::no_nan && is_share(input);
                if (!counts_something(input) && !given) set_pixels(image, change);
            });
            for (auto& [input, binding] : request.inputs)
                if (binding.deep)
                    binding.deep = std::make_shared<MemoryDeep>(with_values(*binding.deep, change));
            return request;
        }};
}

HostileCase with_window(std::string name, const Region& window)
{
    return {std::move(name), Demand::finite,
            [=](const Graph& graph) { return made_up_request(graph, window); }};
}

HostileCase with_channels(std::string name, const Region& window,
                          const std::vector<std::string>& channels)
{
    return {std::move(name), Demand::finite, [=](const Graph& graph) {
                RunRequest request = made_up_request(graph, window);
                change_images(
                    request, [&](const std::string& input, std::size_t, MemoryImage& image) {
                        if (counts_something(input)) return;
                        MemoryImage other;
                        other.desc = image.desc.with_channels(channels);
                        other.pixels = ImageBuffer(image.desc.data, other.desc.channel_count());
                        set_pixels(other, [&](int c, int x, int y, float) {
                            return image.pixels.view().at(c % image.desc.channel_count(), x, y);
                        });
                        image = std::move(other);
                    });
                for (auto& [input, binding] : request.inputs) {
                    if (!binding.deep) continue;
                    const MemoryDeep& deep = *binding.deep;
                    const int had = deep.desc.channel_count();
                    const auto at = [&](int c, int x, int y) {
                        return samples_at(deep, c % had, x, y);
                    };
                    binding.deep = std::make_shared<MemoryDeep>(make_deep(
                        window, channels,
                        [&](int x, int y) { return static_cast<int>(at(0, x, y).size()); },
                        [&](int c, int x, int y, int s) {
                            return at(c, x, y)[static_cast<std::size_t>(s)];
                        }));
                }
                return request;
            }};
}

HostileCase with_list_of(std::size_t length, const Region& window)
{
    return {"lists of " + std::to_string(length), Demand::finite, [=](const Graph& graph) {
                RunRequest request = made_up_request(graph, window);
                for (auto& [name, binding] : request.inputs)
                    if (binding.is_list && binding.images.size() > length)
                        binding.images.resize(length);
                return request;
            }};
}

/// The last input (or the last image of the last list) is another size than the rest.
HostileCase with_odd_one_out(std::string name, const Region& window, const Region& other)
{
    return {std::move(name), Demand::finite, [=](const Graph& graph) {
                RunRequest request = made_up_request(graph, window);
                RunRequest odd = made_up_request(graph, other);
                if (request.inputs.empty()) return request;
                auto& last = std::prev(request.inputs.end())->second;
                const InputBinding& other_size = std::prev(odd.inputs.end())->second;
                if (last.deep)
                    last.deep = other_size.deep;
                else
                    last.images.back() = other_size.images.back();
                return request;
            }};
}

/// Other numbers of samples in every deep pixel, of the values value(channel, x, y, sample).
HostileCase with_samples(std::string name, const Region& window,
                         const std::function<int(int, int)>& samples,
                         const std::function<float(int, int, int, int)>& value)
{
    return {std::move(name), Demand::finite, [=](const Graph& graph) {
                RunRequest request = made_up_request(graph, window);
                for (auto& [input, binding] : request.inputs)
                    if (binding.deep)
                        binding.deep = std::make_shared<MemoryDeep>(
                            make_deep(window, binding.deep->desc.channels, samples, value));
                return request;
            }};
}

/// Light, a covering that lets the last of ten thousand samples be seen, and a depth.
float plain_sample(int channel, int x, int y, int sample)
{
    if (channel == 3) return 1e-4f * static_cast<float>((sample + x) % 3);
    if (channel == 4) return 1.0f + 0.001f * static_cast<float>((sample * 7919) % 10007);
    return 1e-3f * static_cast<float>((sample * 31 + x * 7 + y * 3 + channel) % 101);
}

} // namespace

std::vector<HostileCase> deep_cases(int side)
{
    const Region window{0, 0, side, side - 6};
    std::vector<HostileCase> cases;
    const auto add = [&](std::string name, const std::function<int(int, int)>& samples,
                         const std::function<float(int, int, int, int)>& value) {
        cases.push_back(with_samples(std::move(name), window, samples, value));
    };
    add(
        "deep pixels with 0 samples", [](int, int) { return 0; }, plain_sample);
    add(
        "deep pixels with 0 samples beside 1", [](int x, int y) { return (x + y) % 2; },
        plain_sample);
    add(
        "deep pixels with 10 000 samples",
        [](int x, int y) { return (x * 5 + y * 11) % 53 == 0 ? 10000 : 0; }, plain_sample);
    cases.push_back(with_samples(
        "10 000 samples in the only pixel", {-3, 7, -2, 8}, [](int, int) { return 10000; },
        plain_sample));
    const auto five = [](int, int) { return 5; };
    const auto alpha = [](float a) {
        return [a](int c, int x, int y, int s) { return c == 3 ? a : plain_sample(c, x, y, s); };
    };
    add("deep alpha 0 everywhere", five, alpha(0.0f));
    add("deep alpha 1 everywhere", five, alpha(1.0f));
    add("deep alpha above 1", five, alpha(3.0f));
    add("deep alpha below 0", five, alpha(-1.0f));
    add("deep alpha of denormals", five, alpha(denormal));
    add("black deep samples", five,
        [](int c, int x, int y, int s) { return c < 3 ? 0.0f : plain_sample(c, x, y, s); });
    add("deep samples that cancel", five, [](int c, int x, int y, int s) {
        return c < 3 ? (s % 2 == 0 ? 1.0f : -1.0f) : plain_sample(c, x, y, s);
    });
    add("one depth for all samples", five,
        [](int c, int x, int y, int s) { return c == 4 ? 1.0f : plain_sample(c, x, y, s); });
    add("deep samples back to front", five, [](int c, int x, int y, int s) {
        return c == 4 ? static_cast<float>(-s) : plain_sample(c, x, y, s);
    });
    return cases;
}

void change_images(
    RunRequest& request,
    const std::function<void(const std::string& input, std::size_t element, MemoryImage&)>& change)
{
    for (auto& [name, binding] : request.inputs)
        for (std::size_t i = 0; i < binding.images.size(); ++i) {
            const MemoryImage& was = *binding.images[i];
            auto image = std::make_shared<MemoryImage>();
            image->desc = was.desc;
            image->pixels = ImageBuffer(was.desc.data, was.desc.channel_count());
            copy_pixels(was.pixels.view(), image->pixels.view());
            change(name, i, *image);
            binding.images[i] = std::move(image);
        }
}

void set_pixels(MemoryImage& image, const PixelChange& value)
{
    const Region& r = image.desc.data;
    for (int c = 0; c < image.desc.channel_count(); ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x) {
                float& v = image.pixels.view().at(c, x, y);
                v = value(c, x, y, v);
            }
}

namespace
{

/// Calls with each pixel and each sample: visit(x, y, value).
void each_value(const RunRequest& request, const std::function<void(int, int, float)>& visit)
{
    for (const auto& [name, binding] : request.inputs) {
        for (const auto& image : binding.images)
            for (int c = 0; c < image->desc.channel_count(); ++c)
                for (int y = image->desc.data.y0; y < image->desc.data.y1; ++y)
                    for (int x = image->desc.data.x0; x < image->desc.data.x1; ++x)
                        visit(x, y, image->pixels.view().at(c, x, y));
        if (!binding.deep) continue;
        const ImageDesc& desc = binding.deep->desc;
        for (int c = 0; c < desc.channel_count(); ++c)
            for (int y = desc.data.y0; y < desc.data.y1; ++y)
                for (int x = desc.data.x0; x < desc.data.x1; ++x)
                    for (const float v : samples_at(*binding.deep, c, x, y)) visit(x, y, v);
    }
}

} // namespace

bool has_negative_pixels(const RunRequest& request)
{
    bool any = false;
    each_value(request, [&](int, int, float v) { any = any || (std::isfinite(v) && v < 0.0f); });
    return any;
}

Region box_of_bad_pixels(const RunRequest& request)
{
    Region box;
    each_value(request, [&](int x, int y, float v) {
        if (!std::isfinite(v)) box = box.hull({x, y, x + 1, y + 1});
    });
    return box;
}

std::vector<HostileCase> hostile_cases(int side)
{
    // A prime width and another prime height: no tile, strip or vector fits.
    const Region window{0, 0, side, side - 6};
    const int half = side / 2;
    std::vector<HostileCase> cases;
    const auto pixels = [&](std::string name, PixelChange change, Demand demand = Demand::finite) {
        cases.push_back(with_pixels(std::move(name), demand, window, std::move(change)));
    };
    pixels("zeros", [](int, int, int, float) { return 0.0f; });
    pixels("negative zeros", [](int, int, int, float) { return -0.0f; });
    pixels("a constant", [](int c, int, int, float) { return 0.37f + static_cast<float>(c); });
    pixels("denormals", [](int, int x, int y, float) {
        return denormal * static_cast<float>((x * 7 + y * 3) % 5);
    });
    pixels("1e-30", [](int, int, int, float v) { return v * 1e-30f; });
    pixels("half-max", [](int, int x, int y, float v) {
        return (x + y) % 3 == 0 ? v : (x % 2 == 0 ? 65504.0f : -65504.0f);
    });
    pixels("negative lobes",
           [](int, int x, int y, float v) { return (x + y) % 2 == 0 ? -0.3f * v : v; });
    pixels("all negative", [](int, int, int, float v) { return -v; });
    pixels("fireflies",
           [](int, int x, int y, float v) { return (x * 31 + y * 17) % 97 == 0 ? 1e6f : v; });
    pixels(
        "1e30", [](int, int, int, float v) { return v * 1e30f; }, Demand::no_nan);
    pixels(
        "the largest floats",
        [](int, int x, int y, float) {
            const float most = std::numeric_limits<float>::max();
            return (x + 2 * y) % 5 == 0 ? -most : most;
        },
        Demand::anything);
    pixels(
        "1e-30 beside 1e30",
        [](int, int x, int y, float v) {
            return (x / 3 + y / 2) % 2 == 0 ? v * 1e30f : v * 1e-30f;
        },
        Demand::no_nan);
    pixels(
        "one NaN", [](int, int x, int y, float v) { return x == 0 && y == 0 ? nan : v; },
        Demand::confined);
    pixels(
        "one infinity", [](int, int x, int y, float v) { return x == 1 && y == 0 ? infinity : v; },
        Demand::confined);
    pixels(
        "one negative infinity in one channel",
        [](int c, int x, int y, float v) { return c == 0 && x == 0 && y == 1 ? -infinity : v; },
        Demand::confined);
    pixels(
        "a tile of NaN",
        [=](int, int x, int y, float v) { return x < half / 2 && y < half / 2 ? nan : v; },
        Demand::confined);

    pixels(
        "nothing but NaN", [](int, int, int, float) { return nan; }, Demand::hopeless);

    const auto by_input = [&](std::string name, std::function<PixelChange(const std::string&)> of) {
        cases.push_back({std::move(name), Demand::finite, [=](const Graph& graph) {
                             RunRequest request = made_up_request(graph, window);
                             change_images(request, [&](const std::string& input, std::size_t,
                                                        MemoryImage& image) {
                                 if (const PixelChange change = of(input))
                                     set_pixels(image, change);
                             });
                             return request;
                         }});
    };
    by_input("zero variance", [](const std::string& input) -> PixelChange {
        if (!holds_variance(input)) return {};
        return [](int, int, int, float) { return 0.0f; };
    });
    by_input("variance without mean", [](const std::string& input) -> PixelChange {
        if (holds_variance(input)) return [](int, int, int, float) { return 2.0f; };
        if (counts_something(input)) return {};
        return [](int, int, int, float) { return 0.0f; };
    });
    by_input("negative variance", [](const std::string& input) -> PixelChange {
        if (!holds_variance(input)) return {};
        return [](int, int, int, float v) { return -v; };
    });
    by_input("one sample a pixel", [](const std::string& input) -> PixelChange {
        if (input.ends_with("count")) return [](int, int, int, float) { return 1.0f; };
        if (!input.ends_with("histogram")) return {};
        // One whole sample in one bin of each channel, and the count.
        return [](int c, int x, int y, float) {
            return c == 60 || (c < 60 && c % 20 == (x + y) % 20) ? 1.0f : 0.0f;
        };
    });
    by_input("two samples a pixel", [](const std::string& input) -> PixelChange {
        if (input.ends_with("count")) return [](int, int, int, float) { return 2.0f; };
        if (!input.ends_with("histogram")) return {};
        return [](int c, int x, int y, float) {
            return c == 60                                              ? 2.0f
                   : (c % 20 == (x + y) % 20 || c % 20 == (x + 7) % 20) ? 1.0f
                                                                        : 0.0f;
        };
    });
    by_input("no samples", [](const std::string& input) -> PixelChange {
        if (!counts_something(input)) return {};
        return [](int, int, int, float) { return 0.0f; };
    });
    by_input("a histogram and a count that do not agree",
             [](const std::string& input) -> PixelChange {
                 if (!counts_something(input)) return {};
                 return [](int c, int x, int, float v) {
                     return x % 3 == 0 ? -v : c % 2 == 0 ? 1e7f : v;
                 };
             });
    cases.push_back(with_list_of(1, window));
    cases.push_back(with_list_of(2, window));

    cases.push_back(with_window("1 x 1", {0, 0, 1, 1}));
    cases.push_back(with_window("2 x 2", {0, 0, 2, 2}));
    cases.push_back(with_window("1 x N", {0, 0, 1, side}));
    cases.push_back(with_window("N x 1", {0, 0, side, 1}));
    cases.push_back(with_window("3 x 5, smaller than any window", {0, 0, 3, 5}));
    cases.push_back(with_window("a negative origin", {-side - 3, -side - 1, -3, -5}));
    for (const int far : {1 << 27, 1 << 30}) {
        const std::string where = "an origin at " + std::to_string(far);
        cases.push_back(with_window(where, {far, far - 9, far + half, far - 9 + half}));
        cases.push_back(with_window("-" + where, {-far, -far, half - far, half - far}));
    }

    cases.push_back(with_channels("one channel", window, {"Y"}));
    cases.push_back(with_channels("two channels", window, {"Y", "A"}));
    cases.push_back(with_channels("five channels", window, {"R", "G", "B", "A", "Z"}));
    cases.push_back(with_odd_one_out("one image is smaller", window, {0, 0, half, half}));
    cases.push_back(with_odd_one_out("one image lies elsewhere", window,
                                     {side, side, side + half, side + half}));
    return cases;
}

} // namespace rayloom::test
