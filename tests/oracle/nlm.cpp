// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/nlm.h"

#include "rayloom/image/border.h"

#include <algorithm>
#include <cmath>

namespace rayloom::oracle
{

namespace
{

double gaussian(int k, int radius)
{
    const double sigma = (2 * radius + 1) / 3.0;
    double sum = 0.0;
    for (int i = -radius; i <= radius; ++i) sum += std::exp(-i * i / (2.0 * sigma * sigma));
    return std::exp(-k * k / (2.0 * sigma * sigma)) / sum;
}

double mean_over_channels(const ConstImageView& image, int x, int y)
{
    double sum = 0.0;
    for (int c = 0; c < image.channels(); ++c) sum += static_cast<double>(image.at(c, x, y));
    return sum / image.channels();
}

} // namespace

NlmResult filter_nlm(std::span<const NlmFrame> frames, std::size_t centre,
                     const NlmSettings& settings)
{
    const NlmFrame& here = frames[centre];
    const Region window = here.image.region();
    const int reach = settings.window / 2, radius = settings.patch / 2,
              frame_radius = settings.patch_frames / 2, channels = here.image.channels();
    const std::size_t pixels = window.pixels();
    NlmResult result;
    result.pixels.resize(pixels * static_cast<std::size_t>(channels));
    result.variances.resize(pixels);
    result.ambiguous.resize(pixels);
    const int last = static_cast<int>(frames.size()) - 1;
    const auto guide = [&](int frame, int c, int x, int y) {
        const ConstImageView& g =
            frames[static_cast<std::size_t>(std::clamp(frame, 0, last))].guide;
        return static_cast<double>(g.at(c, border_index(x, window.x0, window.x1, Border::mirror),
                                        border_index(y, window.y0, window.y1, Border::mirror)));
    };

    for (int y = window.y0; y < window.y1; ++y)
        for (int x = window.x0; x < window.x1; ++x) {
            const std::size_t at =
                static_cast<std::size_t>(y - window.y0) * static_cast<std::size_t>(window.width()) +
                static_cast<std::size_t>(x - window.x0);
            std::vector<double> sums(static_cast<std::size_t>(channels));
            double total = 0.0, squares = 0.0;
            for (int f = 0; f <= last; ++f)
                for (int v = y - reach; v <= y + reach; ++v)
                    for (int u = x - reach; u <= x + reach; ++u) {
                        if (!window.contains(u, v)) continue;
                        const NlmFrame& there = frames[static_cast<std::size_t>(f)];
                        const int frame = f - static_cast<int>(centre);
                        const bool self = frame == 0 && u == x && v == y;
                        bool accepted = true;
                        for (int c = 0; c < channels && settings.gate != "none" && !self; ++c) {
                            const double p = static_cast<double>(here.image.at(c, x, y)),
                                         q = static_cast<double>(there.image.at(c, u, v));
                            const double low = static_cast<double>(here.low.at(c, x, y)),
                                         high = static_cast<double>(here.high.at(c, x, y));
                            if (settings.gate == "one-sample") {
                                accepted = accepted && low <= q && q <= high;
                                continue;
                            }
                            const double h_p = 0.5 * (high - low);
                            const double h_q = 0.5 * (static_cast<double>(there.high.at(c, u, v)) -
                                                      static_cast<double>(there.low.at(c, u, v)));
                            const double difference = (p - q) * (p - q),
                                         allowed = h_p * h_p + h_q * h_q;
                            accepted = accepted && difference <= allowed;
                            if (std::fabs(difference - allowed) <= 1e-5 * (difference + allowed))
                                result.ambiguous[at] = true;
                        }
                        if (!accepted) continue;
                        double distance = 0.0;
                        for (int df = -frame_radius; df <= frame_radius; ++df)
                            for (int dy = -radius; dy <= radius; ++dy)
                                for (int dx = -radius; dx <= radius; ++dx)
                                    for (int c = 0; c < here.guide.channels(); ++c) {
                                        const double e = guide(static_cast<int>(centre) + df, c,
                                                               x + dx, y + dy) -
                                                         guide(f + df, c, u + dx, v + dy);
                                        distance += gaussian(df, frame_radius) *
                                                    gaussian(dx, radius) * gaussian(dy, radius) *
                                                    e * e / here.guide.channels();
                                    }
                        const double variance =
                            std::min(mean_over_channels(here.guide_variance, x, y),
                                     mean_over_channels(there.guide_variance, u, v));
                        const double sigma = settings.range * settings.range * variance;
                        const double near = (u - x) * (u - x) + (v - y) * (v - y) + frame * frame;
                        double weight =
                            std::exp(-near / (2.0 * settings.sigma_s * settings.sigma_s));
                        if (distance > 0.0)
                            weight *= sigma > 0.0 ? std::exp(-distance / (2.0 * sigma)) : 0.0;
                        for (int c = 0; c < channels; ++c)
                            sums[static_cast<std::size_t>(c)] +=
                                weight * static_cast<double>(there.image.at(c, u, v));
                        total += weight;
                        squares += weight * weight;
                    }
            for (int c = 0; c < channels; ++c)
                result.pixels[static_cast<std::size_t>(c) * pixels + at] =
                    sums[static_cast<std::size_t>(c)] / total;
            result.variances[at] = squares / (total * total);
        }
    return result;
}

} // namespace rayloom::oracle
