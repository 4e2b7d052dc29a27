// SPDX-License-Identifier: Apache-2.0
#include "tests/support/engine_nodes_for_tests.h"

#include "rayloom/graph/reader.h"

#include <gtest/gtest.h>

namespace rayloom::test
{
namespace
{

const char* const graph = R"(
rayloom: 1
name: flash
inputs:
  image: noisy
  partial: partial
  unit: {doc: flash, optional: true}
nodes:
  fit: {op: fit.flash_intensity, image: image, partial: partial, flash_unit: unit}
  flash: {op: transform.flash, partial: partial, flash_unit: unit, intensity: fit.intensity}
outputs:
  image: flash.image
  figures: fit.intensity
)";

std::shared_ptr<MemoryImage> scaled(const MemoryImage& from, float factor)
{
    auto image = std::make_shared<MemoryImage>();
    image->desc = from.desc;
    image->pixels = ImageBuffer(from.desc.data, 3);
    for (int y = from.desc.data.y0; y < from.desc.data.y1; ++y)
        for (int c = 0; c < 3; ++c)
            for (int x = from.desc.data.x0; x < from.desc.data.x1; ++x)
                image->pixels.view().at(c, x, y) = factor * from.pixels.view().at(c, x, y);
    return image;
}

double luminance(const MemoryImage& image)
{
    const double weights[] = {0.2126, 0.7152, 0.0722};
    double sum = 0.0;
    for (int y = image.desc.data.y0; y < image.desc.data.y1; ++y)
        for (int c = 0; c < 3; ++c)
            for (const float v : image.pixels.view().row_span(c, y))
                sum += weights[c] * static_cast<double>(v);
    return sum / static_cast<double>(image.desc.data.pixels());
}

RunReport run(const std::map<std::string, std::shared_ptr<const MemoryImage>>& inputs)
{
    RunRequest request;
    for (const auto& [name, image] : inputs) request.inputs[name].images = {image};
    return run_graph(parse_graph(graph, "flash.yaml"), request);
}

TEST(FlashIntensity, GivesTheFlashImageTheBrightnessOfTheInput)
{
    const auto image = noise_image({0, 0, 70, 50}, 3, 1), partial = scaled(*image, 0.4f),
               unit = noise_image({0, 0, 70, 50}, 3, 2);
    const RunReport report = run({{"image", image}, {"partial", partial}, {"unit", unit}});
    const double k = report.tables.at("figures").front().number("intensity");
    EXPECT_NEAR(k, 0.6 * luminance(*image) / luminance(*unit), 1e-6 * k);
    const Table& figures = report.tables.at("figures").front();
    EXPECT_NEAR(figures.number("image_luminance"), luminance(*image), 1e-12);
    EXPECT_NEAR(figures.number("partial_luminance"), luminance(*partial), 1e-12);
    EXPECT_NEAR(figures.number("flash_unit_luminance"), luminance(*unit), 1e-12);
    const MemoryImage& flash = report.images.at("image").front();
    EXPECT_NEAR(luminance(flash), luminance(*image), 1e-5 * luminance(*image));
    EXPECT_EQ(flash.pixels.view().at(1, 5, 7),
              partial->pixels.view().at(1, 5, 7) +
                  static_cast<float>(k) * unit->pixels.view().at(1, 5, 7));
}

TEST(FlashIntensity, IsNeverNegative)
{
    const auto image = noise_image({0, 0, 40, 30}, 3, 1), unit = noise_image({0, 0, 40, 30}, 3, 2);
    const RunReport report =
        run({{"image", image}, {"partial", scaled(*image, 1.5f)}, {"unit", unit}});
    EXPECT_EQ(report.tables.at("figures").front().number("intensity"), 0.0);
}

TEST(FlashIntensity, WithoutAFlashThePartialLightStandsAlone)
{
    const auto image = noise_image({0, 0, 40, 30}, 3, 1), partial = scaled(*image, 0.5f);
    for (const auto& unit : {std::shared_ptr<MemoryImage>(), scaled(*image, 0.0f)}) {
        std::map<std::string, std::shared_ptr<const MemoryImage>> inputs{{"image", image},
                                                                         {"partial", partial}};
        if (unit) inputs["unit"] = unit;
        const RunReport report = run(inputs);
        EXPECT_EQ(report.tables.at("figures").front().number("intensity"), 0.0);
        EXPECT_TRUE(same_bits(report.images.at("image").front(), *partial));
        bool said = false;
        for (const std::string& note : report.notes)
            said = said || note.find("no flash_unit") != std::string::npos;
        EXPECT_EQ(said, !unit);
    }
}

TEST(FlashIntensity, WindowsMustAgree)
{
    const auto image = noise_image({0, 0, 40, 30}, 3, 1), other = noise_image({0, 0, 41, 30}, 3, 2);
    EXPECT_THROW(run({{"image", image}, {"partial", other}}), Error);
}

} // namespace
} // namespace rayloom::test
