// SPDX-License-Identifier: Apache-2.0
// Error of nodes that work pixel by pixel or on small windows, against their definitions written
// out in double.
#include "nodes/transform/log_kernel.h"
#include "rayloom/image/border.h"
#include "tests/oracle/nlm.h"
#include "tests/oracle/restore_mean.h"
#include "tests/oracle/steerable.h"
#include "tests/stress/error_budget.h"
#include "tests/support/raster.h"
#include "tests/support/run_node.h"

#include <boost/math/distributions/students_t.hpp>

#include <functional>
#include <random>

namespace rayloom::test::budget
{
namespace
{

const std::vector<std::string> rgb{"R", "G", "B"};
const Region window{-3, 2, 30, 27};

/// A pixel's value in double, beyond the window mirrored.
double pixel(const TestImage& image, int c, int x, int y)
{
    const Region& r = image.desc.data;
    return static_cast<double>(image.view().at(c, border_index(x, r.x0, r.x1, Border::mirror),
                                               border_index(y, r.y0, r.y1, Border::mirror)));
}

TestImage random_image(unsigned seed, const std::function<double(std::mt19937&)>& value,
                       std::vector<std::string> channels = rgb)
{
    std::mt19937 random(seed);
    return make_image(window, std::move(channels),
                      [&](int, int, int) { return static_cast<float>(value(random)); });
}

/// Radiance of `decades` decades around 1.
TestImage light(unsigned seed, double decades)
{
    return random_image(seed, [&](std::mt19937& random) {
        return std::pow(10.0, decades * (std::uniform_real_distribution<>()(random) - 0.5));
    });
}

/// Every pixel of the first three channels against truth(c, x, y).
Error against(const TestImage& image, const std::function<double(int, int, int)>& truth,
              double scale = 0.0)
{
    Error error(scale);
    const Region& r = image.desc.data;
    for (int c = 0; c < image.desc.channel_count(); ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x)
                error.add(static_cast<double>(image.view().at(c, x, y)), truth(c, x, y));
    return error;
}

// ------------------------------------------------------------------------------- logarithms

void logarithms(Table& table)
{
    Error log_error, exp_error;
    for (double x = 1e-37; x < 1e38; x *= 1.00137) {
        const auto f = static_cast<float>(x);
        const double truth = std::log(static_cast<double>(f));
        // Near 1 the logarithm crosses zero.
        log_error.add(1.0 + (static_cast<double>(log_of(f)) - truth) / (1.0 + std::fabs(truth)),
                      1.0);
    }
    for (double y = -80.0; y < 80.0; y += 0.00713) {
        const auto f = static_cast<float>(y);
        exp_error.add(static_cast<double>(exp_of(f)), std::exp(static_cast<double>(f)));
    }
    table.push_back({"transform.log, ln x", "1e-37 to 1e38", "1 + |ln x|", log_error});
    table.push_back({"transform.exp, e^y", "|y| < 80", itself, exp_error});
}

// ------------------------------------------------------------------------------- variances

void intervals(Table& table)
{
    for (const int samples : {2, 16, 1000}) {
        const TestImage mean = light(4, 1.0), variance = light(5, 8.0);
        const NodeRun run =
            run_node("threshold.interval", {{"confidence", 0.998}, {"samples", double(samples)}},
                     {{"mean", {&mean}}, {"variance", {&variance}}});
        const boost::math::students_t student(samples - 1);
        const double t = boost::math::quantile(boost::math::complement(student, 0.001));
        table.push_back({"threshold.interval, half width", std::to_string(samples) + " samples",
                         itself, against(run.image("half_width"), [&](int c, int x, int y) {
                             return t * std::sqrt(pixel(variance, c, x, y) / samples);
                         })});
    }
}

/// Second differences, whose smaller square counts. Squares of floats that differ by σ on a mean of
/// `ratio` σ: the differences themselves are exact in double.
void local_variances(Table& table)
{
    for (const double ratio : {1.0, 1e4}) {
        const TestImage image = random_image(6, [&](std::mt19937& random) {
            return std::normal_distribution<>(ratio, 1.0)(random);
        });
        const NodeRun run = run_node("transform.local_variance", {{"radius", std::int64_t{3}}},
                                     {{"image", {&image}}});
        // The factor of the expectation is a constant: it is read off at one pixel.
        const auto seen = [&](int c, int x, int y) {
            double sum = 0.0;
            int n = 0;
            for (int v = std::max(y - 3, window.y0); v < std::min(y + 4, window.y1); ++v)
                for (int u = std::max(x - 3, window.x0); u < std::min(x + 4, window.x1); ++u, ++n) {
                    const double two = 2.0 * pixel(image, c, u, v);
                    const double h = two - pixel(image, c, u - 1, v) - pixel(image, c, u + 1, v);
                    const double w = two - pixel(image, c, u, v - 1) - pixel(image, c, u, v + 1);
                    sum += std::min(h * h, w * w);
                }
            return sum / n;
        };
        const TestImage& out = run.image("variance");
        const double factor = static_cast<double>(out.view().at(0, window.x0, window.y0)) /
                              seen(0, window.x0, window.y0);
        char text[40];
        std::snprintf(text, sizeof text, "mean/σ = %g", ratio);
        table.push_back(
            {"transform.local_variance", text, itself,
             against(out, [&](int c, int x, int y) { return factor * seen(c, x, y); })});

        const TestImage other = random_image(7, [&](std::mt19937& random) {
            return std::normal_distribution<>(ratio, 1.0)(random);
        });
        const NodeRun half = run_node("transform.half_buffers", {{"radius", std::int64_t{2}}},
                                      {{"a", {&image}}, {"b", {&other}}});
        table.push_back(
            {"transform.half_buffers, variance", text, itself,
             against(half.image("variance"), [&](int c, int x, int y) {
                 double sum = 0.0;
                 int n = 0;
                 for (int v = std::max(y - 2, window.y0); v < std::min(y + 3, window.y1); ++v)
                     for (int u = std::max(x - 2, window.x0); u < std::min(x + 3, window.x1);
                          ++u, ++n) {
                         const double e = 0.5 * (pixel(image, c, u, v) - pixel(other, c, u, v));
                         sum += e * e;
                     }
                 return sum / n;
             })});
    }
}

// ------------------------------------------------------------------------------- means that return

void restored_means(Table& table)
{
    for (const double decades : {1.0, 8.0}) {
        const TestImage image = light(8, decades), reference = light(9, decades);
        const NodeRun run = run_node("transform.restore_mean", {{"scale", std::int64_t{3}}},
                                     {{"image", {&image}}, {"reference", {&reference}}});
        const oracle::Raster<double> truth =
            oracle::restore_share(to_raster(image), to_raster(reference), 3);
        table.push_back({"transform.restore_mean",
                         decades > 1.0 ? "light over eight decades" : "light over one decade",
                         itself, against(run.image(), [&](int c, int x, int y) {
                             return truth.at(c, x - window.x0, y - window.y0);
                         })});
    }
}

void residuals(Table& table)
{
    const TestImage image = light(10, 1.0), original = light(11, 1.0), variance = light(12, 1.0);
    const NodeRun run =
        run_node("fuse.residual", {{"radius", std::int64_t{2}}, {"factor", 0.05}},
                 {{"image", {&image}}, {"original", {&original}}, {"variance", {&variance}}});
    table.push_back(
        {"fuse.residual", "light over one decade", itself,
         against(run.image(), [&](int c, int x, int y) {
             double b = 0.0, n = 0.0;
             for (int v = std::max(y - 2, window.y0); v < std::min(y + 3, window.y1); ++v)
                 for (int u = std::max(x - 2, window.x0); u < std::min(x + 3, window.x1); ++u)
                     for (int k = 0; k < 3; ++k) {
                         const double d = pixel(original, k, u, v) - pixel(image, k, u, v);
                         b += d * d;
                         n += pixel(variance, k, u, v);
                     }
             const double share = b > 0.0 ? std::max(0.0, 1.0 - 0.05 * n / b) : 0.0;
             return pixel(image, c, x, y) +
                    share * (pixel(original, c, x, y) - pixel(image, c, x, y));
         })});
}

// ------------------------------------------------------------------------------- bands

void steerable_inverse(Table& table)
{
    for (const double offset : {0.0, 1e4}) {
        const TestImage image = random_image(13, [&](std::mt19937& random) {
            return std::normal_distribution<>(offset, 1.0)(random);
        });
        const NodeRun apart =
            run_node("multiscale.steerable", {{"levels", std::int64_t{3}}}, {{"image", {&image}}});
        std::vector<const TestImage*> bands;
        for (const TestImage& band : apart.outputs.at("bands")) bands.push_back(&band);
        const char* text = offset > 0.0 ? "noise of σ = 1 on 1e4" : "noise";
        Error low(offset + 4.0);
        const TestImage& last = *bands.back();
        const Region& r = last.desc.data;
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x)
                low.add(static_cast<double>(last.view().at(0, x, y)),
                        oracle::steerable_low([&](int u, int v) { return pixel(image, 0, u, v); },
                                              3, x, y));
        table.push_back({"multiscale.steerable, low-pass", text, largest, low});
        const NodeRun again =
            run_node("multiscale.steerable_inverse", {}, {{"bands", bands, nullptr, true}});
        table.push_back(
            {"multiscale.steerable_inverse of multiscale.steerable", text, largest,
             against(
                 again.image(), [&](int c, int x, int y) { return pixel(image, c, x, y); },
                 offset + 4.0)});
    }
}

// ------------------------------------------------------------------------------- gates

/// Pixels whose gate hangs on the last bit are left out: float may decide otherwise.
void gated_nlm(Table& table)
{
    for (const bool symmetric : {true, false}) {
        const TestImage image = light(14, 1.0), spread = light(15, 1.0);
        const TestImage guide = random_image(
            16, [](std::mt19937& random) { return std::normal_distribution<>(0.5, 0.1)(random); });
        const TestImage guide_variance =
            random_image(17, [](std::mt19937&) { return 0.01; }, {"Y"});
        const auto shifted = [&](float sign) {
            return make_image(window, rgb, [&](int c, int x, int y) {
                return image.view().at(c, x, y) + sign * spread.view().at(c, x, y);
            });
        };
        const TestImage low = shifted(-1.0f), high = shifted(1.0f);
        const NodeRun run =
            run_node("fuse.nlm",
                     {{"gate", std::string(symmetric ? "two-sample" : "one-sample")},
                      {"window", std::int64_t{9}},
                      {"patch", std::int64_t{5}}},
                     {{"image", {&image}, nullptr, true},
                      {"guide", {&guide}, nullptr, true},
                      {"guide_variance", {&guide_variance}, nullptr, true},
                      {"low", {&low}, nullptr, true},
                      {"high", {&high}, nullptr, true}});
        oracle::NlmSettings settings;
        settings.gate = symmetric ? oracle::NlmGate::two_sample : oracle::NlmGate::one_sample;
        settings.window = 9;
        settings.sigma_s = 3.0;
        const oracle::NlmFrame frame{image.view(), guide.view(), guide_variance.view(), low.view(),
                                     high.view()};
        const auto truth = oracle::filter_nlm<double>({&frame, 1}, 0, settings, window);
        Error error;
        for (int c = 0; c < 3; ++c)
            for (int y = window.y0; y < window.y1; ++y)
                for (int x = window.x0; x < window.x1; ++x) {
                    const auto at =
                        static_cast<std::size_t>((y - window.y0) * window.width() + x - window.x0);
                    if (!truth.ambiguous[at])
                        error.add(static_cast<double>(run.image().view().at(c, x, y)),
                                  truth.pixels[static_cast<std::size_t>(c) * window.pixels() + at]);
                }
        table.push_back({symmetric ? "fuse.nlm, two-sample gate" : "fuse.nlm, one-sample gate",
                         "light over one decade", itself, error});
    }
}

} // namespace

void add_node_entries(Table& table)
{
    gated_nlm(table);
    steerable_inverse(table);
    logarithms(table);
    intervals(table);
    local_variances(table);
    restored_means(table);
    residuals(table);
}

} // namespace rayloom::test::budget
