// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/steerable.h"

#include <cmath>

namespace rayloom::oracle
{

double steerable_high(const PixelFunction& image, int x, int y)
{
    double blurred = 0.0;
    for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i)
            blurred += (2 - std::abs(i)) * (2 - std::abs(j)) / 16.0 * image(x + i, y + j);
    return image(x, y) - blurred;
}

double steerable_low(const PixelFunction& image, int level, int x, int y)
{
    // All means in a row are one mean over a square: the first takes offsets 0 and 1, the others
    // ±1, ±2, ±4, …, and every sum of them occurs once.
    const int from = 1 - (1 << level), to = 1 << level;
    double sum = 0.0;
    for (int j = from; j <= to; ++j)
        for (int i = from; i <= to; ++i) sum += image(x + i, y + j);
    const double side = to - from + 1;
    return sum / (side * side);
}

double steerable_oriented(const PixelFunction& image, int level, int orientation, int x, int y)
{
    const int dx[] = {1, 1, 0, 1}, dy[] = {0, 1, 1, -1};
    const int h = 1 << (level - 1);
    const double plus =
        steerable_low(image, level - 1, x + h * dx[orientation], y + h * dy[orientation]);
    const double minus =
        steerable_low(image, level - 1, x - h * dx[orientation], y - h * dy[orientation]);
    const double weight = orientation % 2 == 0 ? std::sqrt(1.0 / 8.0) : std::sqrt(1.0 / 16.0);
    return weight * std::sqrt(2.0) * h * (plus - minus);
}

} // namespace rayloom::oracle
