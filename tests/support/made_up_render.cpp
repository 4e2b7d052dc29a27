// SPDX-License-Identifier: Apache-2.0
#include "tests/support/made_up_render.h"

#include <algorithm>
#include <random>

namespace rayloom::test
{

std::shared_ptr<MemoryImage> made_up_render(const std::vector<std::string>& black, unsigned seed,
                                            float complete)
{
    auto image = std::make_shared<MemoryImage>();
    image->desc.data = image->desc.display = {0, 0, 24, 18};
    const auto add = [&](const std::string& layer, const std::string& letters) {
        for (const char c : letters)
            image->desc.channels.push_back("ViewLayer." + layer + "." + std::string(1, c));
    };
    add("Combined", "RGBA");
    for (const char* lobe : {"Diff", "Gloss", "Trans"})
        for (const char* pass : {"Dir", "Ind", "Col"}) add(std::string(lobe) + pass, "RGB");
    add("Emit", "RGB");
    add("Normal", "XYZ");
    add("Depth", "Z");
    add("IndexOB", "X");
    add("IndexMA", "X");
    add("CryptoObject00", "rgba");
    image->pixels = ImageBuffer(image->desc.data, image->desc.channel_count());
    const ImageView view = image->pixels.view();
    std::mt19937 random(seed);
    std::exponential_distribution<float> light(1.0f);
    for (int y = 0; y < 18; ++y)
        for (int x = 0; x < 24; ++x) {
            const bool left = x < 12;
            for (int c = 0; c < image->desc.channel_count(); ++c) {
                const std::string& name = image->desc.channels[static_cast<std::size_t>(c)];
                const auto has = [&](const char* text) {
                    return name.find(text) != std::string::npos;
                };
                float v = light(random);
                if (has("Col")) v = 0.1f + 0.2f * static_cast<float>((x + y + c) % 4);
                if (has("Emit")) v = x == 3 && y == 3 ? 5.0f : 0.0f;
                if (has("Normal")) v = has(".Z") ? 1.0f : 0.0f;
                if (has("Depth")) v = left ? 2.0f : 7.0f;
                if (has("IndexOB")) v = left ? 1.0f : 2.0f;
                if (has("IndexMA")) v = y < 9 ? 3.0f : 4.0f;
                if (has("Crypto"))
                    v = has(".r")   ? (left ? 11.5f : -3.25f)
                        : has(".g") ? (x == 12 ? 0.75f : 1.0f)
                        : has(".b") ? (x == 12 ? 11.5f : 0.0f)
                                    : (x == 12 ? 0.25f : 0.0f);
                if (std::any_of(black.begin(), black.end(),
                                [&](const std::string& b) { return has(b.c_str()); }))
                    v = 0.0f;
                view.at(c, x, y) = v;
            }
            const auto at = [&](const std::string& layer, int c) {
                return view.at(image->desc.channel("ViewLayer." + layer + ".R") + c, x, y);
            };
            for (int c = 0; c < 3; ++c) {
                float sum = at("Emit", c);
                for (const std::string lobe : {"Diff", "Gloss", "Trans"})
                    sum += at(lobe + "Col", c) * (at(lobe + "Dir", c) + at(lobe + "Ind", c));
                view.at(c, x, y) = sum * complete;
            }
            view.at(3, x, y) = 1.0f;
        }
    return image;
}

} // namespace rayloom::test
