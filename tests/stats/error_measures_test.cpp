// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/error_measures.h"

#include "rayloom/core/error.h"
#include "tests/support/folders.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>
#include <yaml-cpp/yaml.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <unistd.h>

namespace rayloom
{
namespace
{

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr float nan = std::numeric_limits<float>::quiet_NaN();

ImageBuffer constant_image(const Region& region, std::array<float, 3> rgb)
{
    ImageBuffer image(region, 3);
    for (int y = region.y0; y < region.y1; ++y)
        for (int c = 0; c < 3; ++c)
            for (float& v : image.view().row_span(c, y)) v = rgb[static_cast<std::size_t>(c)];
    return image;
}

ImageBuffer make_image(const Region& region, int channels,
                       const std::function<float(int c, int x, int y)>& value)
{
    ImageBuffer image(region, channels);
    for (int y = region.y0; y < region.y1; ++y)
        for (int c = 0; c < channels; ++c)
            for (int x = region.x0; x < region.x1; ++x) image.view().at(c, x, y) = value(c, x, y);
    return image;
}

/// A smooth scene of some range with an edge and a highlight, and a noisy copy of it.
struct Scene {
    ImageBuffer image, reference;
};
Scene noisy_scene(int width, int height, int channels, unsigned seed, float noise = 0.3f,
                  float brightness = 1.0f)
{
    std::mt19937 random(seed);
    std::exponential_distribution<float> factor(1.0f);
    const Region region{-7, 3, width - 7, height + 3};
    ImageBuffer reference = make_image(region, channels, [&](int c, int x, int y) {
        const float fx = static_cast<float>(x + 7) / static_cast<float>(width);
        const float fy = static_cast<float>(y - 3) / static_cast<float>(height);
        float v = 0.05f + 0.6f * fx * static_cast<float>(c + 1) / 3.0f + 0.3f * fy * fy;
        if (fx > 0.4f && fy > 0.3f) v *= 0.2f;
        if (std::hypot(fx - 0.7f, fy - 0.2f) < 0.1f) v += 12.0f;
        return brightness * v;
    });
    ImageBuffer image = make_image(region, channels, [&](int c, int x, int y) {
        return reference.view().at(c, x, y) * (1.0f - noise + noise * factor(random));
    });
    return {std::move(image), std::move(reference)};
}

// ------------------------------------------------------------------ values known from definitions

TEST(ErrorMeasures, ConstantOffsetGivesTheFiguresOfItsDefinition)
{
    const Region region{5, -4, 45, 36};
    const float r = 0.5f, d = 0.75f;
    const ErrorMeasures m = measure_errors(constant_image(region, {d, d, d}).view(),
                                           constant_image(region, {r, r, r}).view());
    EXPECT_EQ(m.pixels, 1600u);
    EXPECT_EQ(m.non_finite_pixels, 0u);
    EXPECT_DOUBLE_EQ(m.rmse, 0.25);
    EXPECT_NEAR(m.relmse, 0.0625 / 0.26, 1e-15);
    EXPECT_NEAR(m.relmse_trimmed, 0.0625 / 0.26, 1e-15);
    EXPECT_NEAR(m.psnr, 10.0 * std::log10(16.0), 1e-12);
    EXPECT_NEAR(m.psnr_clamped, 10.0 * std::log10(16.0), 1e-12);
    EXPECT_NEAR(m.smape, 0.25 / 1.26, 1e-15);
    EXPECT_DOUBLE_EQ(m.max_abs_error, 0.25);
    EXPECT_NEAR(m.brightness_ratio, 1.5, 1e-14);
    // Without variance SSIM is its luminance term of the sRGB-encoded greys.
    const auto encode = [](double v) { return 1.055 * std::pow(v, 1.0 / 2.4) - 0.055; };
    const double a = encode(d), b = encode(r);
    EXPECT_NEAR(m.ssim, (2 * a * b + 1e-4) / (a * a + b * b + 1e-4), 1e-12);
}

TEST(ErrorMeasures, ClampedPsnrDoesNotSeeWhatTheDisplayCannotShow)
{
    const Region region{0, 0, 16, 16};
    const ErrorMeasures m = measure_errors(constant_image(region, {9, 9, -1}).view(),
                                           constant_image(region, {2, 2, 0}).view());
    EXPECT_TRUE(std::isinf(m.psnr_clamped));
    EXPECT_NEAR(m.psnr, -10.0 * std::log10((49.0 + 49.0 + 1.0) / 3.0), 1e-12);
    EXPECT_EQ(m.max_abs_error, 7.0);
}

TEST(ErrorMeasures, EqualImagesAreAtTheBestValueOfEveryMeasure)
{
    const Scene s = noisy_scene(50, 40, 3, 1);
    const ErrorMeasures m = measure_errors(s.image.view(), s.image.view());
    EXPECT_EQ(m.rmse, 0.0);
    EXPECT_EQ(m.relmse, 0.0);
    EXPECT_EQ(m.relmse_trimmed, 0.0);
    EXPECT_EQ(m.smape, 0.0);
    EXPECT_EQ(m.max_abs_error, 0.0);
    EXPECT_EQ(m.flip, 0.0);
    EXPECT_EQ(m.hdr_flip, 0.0);
    EXPECT_NEAR(m.ssim, 1.0, 1e-12);
    EXPECT_NEAR(m.brightness_ratio, 1.0, 1e-15);
    EXPECT_TRUE(std::isinf(m.psnr) && m.psnr > 0.0);
}

TEST(ErrorMeasures, TrimmingDropsTheWorstThousandthAndNothingElse)
{
    ErrorOptions pixelwise;
    pixelwise.ssim = pixelwise.flip = pixelwise.hdr_flip = false;
    const Region region{0, 0, 100, 30};
    const ImageBuffer reference = constant_image(region, {0.3f, 0.3f, 0.3f});
    ImageBuffer image = constant_image(region, {0.4f, 0.4f, 0.4f});
    for (int i = 0; i < 3; ++i) image.view().at(0, 7 + 11 * i, 2 + 9 * i) = 1000.0f;
    const ErrorMeasures m = measure_errors(image.view(), reference.view(), pixelwise);
    const double quiet = std::pow(0.4f - 0.3f, 2) / (0.3f * 0.3f + 0.01);
    EXPECT_NEAR(m.relmse_trimmed, quiet, 1e-7);
    EXPECT_GT(m.relmse, 1000.0 * quiet);
    image.view().at(1, 50, 15) = 1000.0f; // one fire-fly more than a thousandth of 3000
    EXPECT_GT(measure_errors(image.view(), reference.view(), pixelwise).relmse_trimmed,
              1000.0 * quiet);
}

TEST(ErrorMeasures, PixelsThatAreNotFiniteAreCountedAndLeftOut)
{
    Scene s = noisy_scene(40, 32, 3, 2);
    const Region& region = s.image.region();
    Scene clean = noisy_scene(40, 32, 3, 2);
    s.image.view().at(1, 4, 9) = nan;
    s.reference.view().at(2, 20, 20) = -infinity;
    s.image.view().at(0, 20, 20) = infinity;
    for (ImageBuffer* image : {&clean.image, &clean.reference})
        for (int c = 0; c < 3; ++c) image->view().at(c, 4, 9) = image->view().at(c, 20, 20) = 0.0f;
    const ErrorMeasures m = measure_errors(s.image.view(), s.reference.view());
    EXPECT_EQ(m.non_finite_pixels, 2u);
    EXPECT_EQ(m.pixels, region.pixels() - 2);
    const ErrorMeasures black = measure_errors(clean.image.view(), clean.reference.view());
    const double kept = static_cast<double>(m.pixels) / static_cast<double>(region.pixels());
    EXPECT_NEAR(m.relmse, black.relmse / kept, 1e-12);
    EXPECT_NEAR(m.flip * kept, black.flip, 0.02 / static_cast<double>(m.pixels) * 100);
    for (const double v : {m.rmse, m.psnr, m.smape, m.ssim, m.flip, m.hdr_flip, m.max_abs_error})
        EXPECT_TRUE(std::isfinite(v));
    const ImageBuffer map = error_map(s.image.view(), s.reference.view(), ErrorMap::flip);
    EXPECT_EQ(map.view().at(0, 4, 9), 0.0f);
}

TEST(ErrorMeasures, OneValueThatIsNotFiniteIsEnoughWhereverItIs)
{
    const Region region = noisy_scene(21, 16, 3, 2).image.region();
    for (const int x : {region.x0, region.x0 + 9, region.x1 - 1})
        for (const int y : {region.y0, region.y1 - 1})
            for (int c = 0; c < 3; ++c)
                for (const bool of_reference : {false, true}) {
                    Scene s = noisy_scene(21, 16, 3, 2);
                    (of_reference ? s.reference : s.image).view().at(c, x, y) =
                        c == 1 ? nan : infinity;
                    const ErrorMeasures m = measure_errors(s.image.view(), s.reference.view());
                    EXPECT_EQ(m.non_finite_pixels, 1u) << x << " " << y << " " << c;
                    EXPECT_TRUE(std::isfinite(m.rmse)) << x << " " << y << " " << c;
                }
}

TEST(ErrorMeasures, SayWhatDoesNotFit)
{
    const ImageBuffer a(Region{0, 0, 4, 4}, 3), b(Region{0, 0, 4, 5}, 3), c(Region{0, 0, 4, 4}, 2);
    EXPECT_THROW(measure_errors(a.view(), b.view()), InputError);
    EXPECT_THROW(measure_errors(a.view(), c.view()), InputError);
    EXPECT_THROW(measure_errors(c.view(), c.view()), InputError);
    ImageBuffer bad(Region{0, 0, 4, 4}, 3);
    bad.fill(nan);
    EXPECT_THROW(measure_errors(bad.view(), bad.view()), InputError);
    ErrorOptions options;
    options.pixels_per_degree = 0.0;
    EXPECT_THROW(measure_errors(a.view(), a.view(), options), NodeError);
    options = {};
    options.tone_mapper = ToneMapper::none;
    EXPECT_THROW(measure_errors(a.view(), a.view(), options), NodeError);
}

TEST(ErrorMeasures, TableHoldsWhatHasAValue)
{
    const Region region{0, 0, 8, 8};
    const Table t = measure_errors(constant_image(region, {1, 0, 0}).view(),
                                   constant_image(region, {0, 1, 0}).view())
                        .table();
    EXPECT_TRUE(t.has("flip"));
    EXPECT_FALSE(t.has("ssim")) << "8×8 has no 11×11 window";
    EXPECT_NEAR(t.number("rmse"), std::sqrt(2.0 / 3.0), 1e-15);
}

// -------------------------------------------------------------------------------- FLIP from paper

double uniform_flip(std::array<float, 3> a, std::array<float, 3> b)
{
    const Region region{0, 0, 30, 25};
    const ErrorMeasures m =
        measure_errors(constant_image(region, a).view(), constant_image(region, b).view());
    return m.flip;
}

// Without edges FLIP is the redistributed Hunt-adjusted HyAB distance to the power 0.7. From the
// CIELAB coordinates of sRGB's primaries (D65): green 87.735, −86.183, 83.180; blue 32.300, 79.191,
// −107.862; red 53.239, 80.090, 67.200.
double hand_flip(std::array<double, 3> p, std::array<double, 3> q)
{
    const auto distance = [](std::array<double, 3> u, std::array<double, 3> v) {
        const auto hunt = [](std::array<double, 3> lab) {
            return std::array<double, 3>{lab[0], lab[1] * lab[0] / 100, lab[2] * lab[0] / 100};
        };
        u = hunt(u);
        v = hunt(v);
        return std::pow(std::abs(u[0] - v[0]) + std::hypot(u[1] - v[1], u[2] - v[2]), 0.7);
    };
    const double largest = distance({87.735, -86.183, 83.180}, {32.300, 79.191, -107.862});
    const double e = distance(p, q), knee = 0.4 * largest;
    return e < knee ? 0.95 * e / knee : 0.95 + 0.05 * (e - knee) / (largest - knee);
}

TEST(Flip, UniformColoursFollowTheHyabFormula)
{
    const std::array<double, 3> black{0, 0, 0}, white{100, 0, 0}, green{87.735, -86.183, 83.180},
        blue{32.300, 79.191, -107.862}, red{53.239, 80.090, 67.200};
    EXPECT_NEAR(uniform_flip({0, 1, 0}, {0, 0, 1}), 1.0, 1e-9);
    EXPECT_NEAR(uniform_flip({0, 0, 0}, {1, 1, 1}), 0.96738, 2e-5);
    EXPECT_NEAR(uniform_flip({0, 0, 0}, {1, 1, 1}), hand_flip(black, white), 2e-5);
    EXPECT_NEAR(uniform_flip({1, 0, 0}, {0, 1, 0}), hand_flip(red, green), 2e-5);
    EXPECT_NEAR(uniform_flip({1, 0, 0}, {0, 0, 0}), hand_flip(red, black), 2e-5);
    EXPECT_NEAR(uniform_flip({0, 0, 1}, {1, 1, 1}), hand_flip(blue, white), 2e-5);
    // Mid grey of 18.4187 % reflectance is L* = 50.
    EXPECT_NEAR(uniform_flip({0.184187f, 0.184187f, 0.184187f}, {0, 0, 0}),
                hand_flip({50.0, 0, 0}, black), 2e-5);
}

TEST(Flip, IsSymmetricAndMirrors)
{
    const Scene s = noisy_scene(45, 33, 3, 5);
    const Region& region = s.image.region();
    const auto mirrored = [&](const ImageBuffer& from) {
        return make_image(region, 3, [&](int c, int x, int y) {
            return from.view().at(c, region.x0 + region.x1 - 1 - x, y);
        });
    };
    const ImageBuffer ab = error_map(s.image.view(), s.reference.view(), ErrorMap::flip);
    const ImageBuffer ba = error_map(s.reference.view(), s.image.view(), ErrorMap::flip);
    const ImageBuffer mirror =
        error_map(mirrored(s.image).view(), mirrored(s.reference).view(), ErrorMap::flip);
    for (int y = region.y0; y < region.y1; ++y)
        for (int x = region.x0; x < region.x1; ++x) {
            EXPECT_EQ(ab.view().at(0, x, y), ba.view().at(0, x, y));
            EXPECT_NEAR(ab.view().at(0, x, y),
                        mirror.view().at(0, region.x0 + region.x1 - 1 - x, y), 1e-6);
        }
}

TEST(Flip, ExposuresSpanFromTheBrightestToTheMedian)
{
    // Reinhard maps 17/3 to 0.85.
    std::vector<double> luminance{0.5, 8.0, 2.0, 0.25, 1.0};
    const ExposureRange r = flip_exposures(luminance, ToneMapper::reinhard);
    EXPECT_NEAR(r.start, std::log2(17.0 / 3.0 / 8.0), 1e-14);
    EXPECT_NEAR(r.stop, std::log2(17.0 / 3.0 / 1.0), 1e-14);
    EXPECT_EQ(r.count, 3);
    EXPECT_EQ(r.at(0), r.start);
    EXPECT_NEAR(r.at(2), r.stop, 1e-15);

    std::vector<double> mostly_black{0, 0, 0, 0, 3.0, 1.0, -2.0};
    const ExposureRange dark = flip_exposures(mostly_black, ToneMapper::reinhard);
    EXPECT_NEAR(dark.stop, std::log2(17.0 / 3.0 / 2.0), 1e-14);
    EXPECT_EQ(dark.count, 2);

    std::vector<double> black{0, 0};
    EXPECT_EQ(flip_exposures(black, ToneMapper::aces).count, 1);
}

TEST(Flip, HdrSeesWhatClampingHides)
{
    const Region region{0, 0, 40, 40};
    const auto lamp = [&](float inside) {
        return make_image(region, 3, [=](int, int x, int y) {
            return std::hypot(x - 20, y - 20) < 8 ? inside : 0.2f;
        });
    };
    const ErrorMeasures m = measure_errors(lamp(6.0f).view(), lamp(20.0f).view());
    EXPECT_EQ(m.flip, 0.0);
    EXPECT_GT(m.hdr_flip, 0.01);
}

// ------------------------------------------------------------- tiles, threads, second
// implementation

TEST(ErrorMeasures, SameBitsForAnyThreadCountAndRowByRow)
{
    const Scene s = noisy_scene(77, 71, 3, 8);
    std::vector<ErrorMeasures> results;
    for (const int threads : {1, 3}) {
        tbb::task_arena arena(threads);
        arena.execute(
            [&] { results.push_back(measure_errors(s.image.view(), s.reference.view())); });
    }
    EXPECT_EQ(results[0].table(), results[1].table());

    const ErrorMeter meter({});
    const Region& window = s.image.region();
    std::vector<double> together(static_cast<std::size_t>(window.height()) * ErrorMeter::sum_count);
    meter.add_rows({s.image.view(), s.reference.view(), window}, window.y0, window.y1, together);
    for (int y = window.y0; y < window.y1; ++y) {
        Region rows{window.x0, y, window.x1, y + 1};
        rows = rows.grown({0, 0, meter.halo_rows(), meter.halo_rows()}).intersect(window);
        const ImagePair pair{s.image.view().crop(rows), s.reference.view().crop(rows), window};
        std::vector<double> alone(ErrorMeter::sum_count);
        meter.add_rows(pair, y, y + 1, alone);
        for (std::size_t i = 0; i < alone.size(); ++i)
            EXPECT_EQ(alone[i],
                      together[static_cast<std::size_t>(y - window.y0) * alone.size() + i])
                << "row " << y << " number " << i;
    }
}

TEST(ErrorMeasures, MapsAreTheSameInTiles)
{
    const Scene s = noisy_scene(53, 41, 3, 9);
    const Region& window = s.image.region();
    const ErrorMeter meter({});
    for (const ErrorMap kind : {ErrorMap::absolute, ErrorMap::relative, ErrorMap::flip}) {
        const ImageBuffer whole = error_map(s.image.view(), s.reference.view(), kind);
        for (const int tile : {1, 7, 16})
            for (int y = window.y0; y < window.y1; y += tile)
                for (int x = window.x0; x < window.x1; x += tile) {
                    const Region part = Region{x, y, x + tile, y + tile}.intersect(window);
                    const Region held =
                        part.grown(Halo::all(meter.map_halo(kind))).intersect(window);
                    ImageBuffer out(part, 1);
                    meter.map({s.image.view().crop(held), s.reference.view().crop(held), window},
                              kind, out.view());
                    for (int v = part.y0; v < part.y1; ++v)
                        for (int u = part.x0; u < part.x1; ++u)
                            ASSERT_EQ(out.view().at(0, u, v), whole.view().at(0, u, v));
                    if (tile == 1 && kind == ErrorMap::flip) x += 12; // one in 13 is enough
                }
    }
}

/// A Python 3 that has numpy; empty when there is none.
std::string python_with_numpy()
{
    for (const char* python : {"python3", "/usr/bin/python3"})
        if (std::system((std::string(python) + " -c 'import numpy' >/dev/null 2>&1").c_str()) == 0)
            return python;
    return {};
}

class NumpyOracle : public ::testing::Test
{
protected:
    void SetUp() override
    {
        m_python = python_with_numpy();
        if (m_python.empty()) GTEST_SKIP() << "no python3 with numpy (Debian: python3-numpy)";
        m_folder = std::filesystem::temp_directory_path() /
                   ("rayloom_measures_" + std::to_string(::getpid()));
        std::filesystem::create_directories(m_folder);
    }
    void TearDown() override
    {
        if (!m_folder.empty()) std::filesystem::remove_all(m_folder);
    }

    std::string write(const ImageBuffer& image, const std::string& name) const
    {
        const std::filesystem::path path = m_folder / name;
        std::ofstream file(path, std::ios::binary);
        const Region& region = image.region();
        for (int y = region.y0; y < region.y1; ++y)
            for (int x = region.x0; x < region.x1; ++x)
                for (int c = 0; c < image.channels(); ++c) {
                    const float v = image.view().at(c, x, y);
                    file.write(reinterpret_cast<const char*>(&v), sizeof v);
                }
        return path.string();
    }

    void compare(const Scene& s, double pixels_per_degree) const
    {
        char number[32];
        std::snprintf(number, sizeof number, "%.17g", pixels_per_degree);
        const std::string command =
            m_python + " '" + test::source_folder().string() +
            "/tests/oracle/error_measures_numpy.py' " + std::to_string(s.image.region().width()) +
            " " + std::to_string(s.image.region().height()) + " " +
            std::to_string(s.image.channels()) + " " + number + " '" + write(s.image, "image.raw") +
            "' '" + write(s.reference, "reference.raw") + "'";
        std::string json;
        FILE* pipe = ::popen(command.c_str(), "r");
        ASSERT_NE(pipe, nullptr);
        char buffer[4096];
        while (const std::size_t n = std::fread(buffer, 1, sizeof buffer, pipe))
            json.append(buffer, n);
        ASSERT_EQ(::pclose(pipe), 0) << json;
        const YAML::Node expected = YAML::Load(json);

        ErrorOptions options;
        options.pixels_per_degree = pixels_per_degree;
        Table got = measure_errors(s.image.view(), s.reference.view(), options).table();
        for (const ToneMapper mapper :
             {ToneMapper::aces, ToneMapper::hable, ToneMapper::reinhard}) {
            options.tone_mapper = mapper;
            got.set(std::string("hdr_flip_") + tone_mapper_name(mapper),
                    measure_errors(s.image.view(), s.reference.view(), options).hdr_flip);
        }
        std::size_t compared = 0;
        for (const auto& entry : expected) {
            const auto name = entry.first.as<std::string>();
            ASSERT_TRUE(got.has(name)) << name;
            ++compared;
            if (entry.second.as<std::string>() == "Infinity") { // PSNR of equal images
                EXPECT_EQ(got.number(name), static_cast<double>(infinity)) << name;
                continue;
            }
            const auto value = entry.second.as<double>();
            EXPECT_NEAR(got.number(name), value, 1e-6 * std::abs(value)) << name;
        }
        const bool has_ssim = s.image.region().width() >= 11 && s.image.region().height() >= 11;
        EXPECT_EQ(compared, has_ssim ? 15u : 14u);
    }

    std::string m_python;
    std::filesystem::path m_folder;
};

TEST_F(NumpyOracle, AgreesOnANoisyScene)
{
    compare(noisy_scene(61, 47, 3, 11), flip_pixels_per_degree);
}
TEST_F(NumpyOracle, AgreesOnFaintNoise) { compare(noisy_scene(48, 40, 3, 12, 0.002f), 40.0); }
TEST_F(NumpyOracle, AgreesOnGrey) { compare(noisy_scene(39, 43, 1, 13), 25.0); }
TEST_F(NumpyOracle, AgreesOnTinyImages)
{
    compare(noisy_scene(9, 6, 3, 14), flip_pixels_per_degree);
    compare(noisy_scene(1, 1, 3, 15), flip_pixels_per_degree);
    compare(noisy_scene(40, 1, 3, 16), 10.0);
}
TEST_F(NumpyOracle, AgreesOnADarkAndOnABrightScene)
{
    compare(noisy_scene(40, 36, 3, 17, 0.5f, 1e-4f), 67.0);
    compare(noisy_scene(40, 36, 3, 18, 0.5f, 1e4f), 67.0);
}
TEST_F(NumpyOracle, AgreesOnBlackNegativeAndBrokenPixels)
{
    Scene s = noisy_scene(50, 50, 3, 19);
    const Region& region = s.image.region();
    for (int y = region.y0; y < region.y1 - 15; ++y)
        for (int c = 0; c < 3; ++c)
            for (int x = region.x0; x < region.x1; ++x) {
                s.reference.view().at(c, x, y) = 0.0f;
                s.image.view().at(c, x, y) *= (x + y) % 3 == 0 ? -0.01f : 0.01f;
            }
    s.image.view().at(0, 10, 40) = nan;
    s.image.view().at(2, 30, 12) = infinity;
    s.reference.view().at(1, 0, 45) = -infinity;
    compare(s, flip_pixels_per_degree);
}

} // namespace
} // namespace rayloom
