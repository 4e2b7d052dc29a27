// SPDX-License-Identifier: Apache-2.0
#include "tests/support/sample_stack.h"

#include <cmath>
#include <random>

namespace rayloom::test
{

std::vector<TestImage> random_stack(const Region& data, int count, bool alpha)
{
    std::mt19937 random(17);
    std::normal_distribution<float> exponent(-0.5f, 1.2f);
    std::uniform_int_distribution<int> kind(0, 9);
    std::vector<std::string> channels{"R", "G", "B"};
    if (alpha) channels.push_back("A");
    std::vector<TestImage> stack;
    for (int i = 0; i < count; ++i)
        stack.push_back(make_image(data, channels, [&](int, int, int) {
            const int k = kind(random);
            if (k == 0) return 0.0f;
            const float v = std::pow(10.0f, (k == 1 ? 4.0f : 1.0f) * exponent(random));
            return k == 2 ? -v : v;
        }));
    return stack;
}

std::vector<const TestImage*> pointers(const std::vector<TestImage>& images)
{
    std::vector<const TestImage*> list;
    for (const TestImage& image : images) list.push_back(&image);
    return list;
}

TestDeep deep_of(const std::vector<TestImage>& stack)
{
    TestDeep deep;
    deep.desc = stack[0].desc;
    const Region& r = deep.desc.data;
    for (int y = r.y0; y < r.y1; ++y) {
        auto row = std::make_shared<DeepRow>();
        row->samples.resize(deep.desc.channels.size());
        row->first.push_back(0);
        for (int x = r.x0; x < r.x1; ++x) {
            for (const TestImage& image : stack)
                for (int c = 0; c < deep.desc.channel_count(); ++c)
                    row->samples[static_cast<std::size_t>(c)].push_back(image.view().at(c, x, y));
            row->first.push_back(row->first.back() + static_cast<std::uint32_t>(stack.size()));
        }
        deep.rows.push_back(row);
    }
    return deep;
}

} // namespace rayloom::test
