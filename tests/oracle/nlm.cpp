// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/nlm.h"

#include "rayloom/image/border.h"

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <vector>

namespace rayloom::oracle
{

namespace
{

template <class Real>
std::vector<Real> gaussian(int radius)
{
    const double sigma = (2 * radius + 1) / 3.0;
    double sum = 0.0;
    for (int i = -radius; i <= radius; ++i) sum += std::exp(-i * i / (2.0 * sigma * sigma));
    std::vector<Real> weights;
    for (int i = -radius; i <= radius; ++i)
        weights.push_back(static_cast<Real>(std::exp(-i * i / (2.0 * sigma * sigma)) / sum));
    return weights;
}

template <class Real>
Real mean_over_channels(const ConstImageView& image, int x, int y)
{
    Real sum = 0;
    for (int c = 0; c < image.channels(); ++c) sum += static_cast<Real>(image.at(c, x, y));
    return sum / static_cast<Real>(image.channels());
}

/// A guide, continued beyond the window by reflection.
template <class Real>
class Guide
{
public:
    Guide(const ConstImageView& image, int margin)
        : m_region(image.region().grown({margin, margin, margin, margin})),
          m_channels(static_cast<std::size_t>(image.channels()))
    {
        const Region& window = image.region();
        m_pixels.reserve(m_region.pixels() * m_channels);
        for (int y = m_region.y0; y < m_region.y1; ++y)
            for (int x = m_region.x0; x < m_region.x1; ++x)
                for (int c = 0; c < image.channels(); ++c)
                    m_pixels.push_back(static_cast<Real>(
                        image.at(c, border_index(x, window.x0, window.x1, Border::mirror),
                                 border_index(y, window.y0, window.y1, Border::mirror))));
    }
    /// All channels of a pixel.
    const Real* at(int x, int y) const
    {
        return m_pixels.data() + (static_cast<std::size_t>(y - m_region.y0) *
                                      static_cast<std::size_t>(m_region.width()) +
                                  static_cast<std::size_t>(x - m_region.x0)) *
                                     m_channels;
    }

private:
    Region m_region;
    std::size_t m_channels;
    std::vector<Real> m_pixels;
};

} // namespace

template <class Real>
NlmResult<Real> filter_nlm(std::span<const NlmFrame> frames, std::size_t centre,
                           const NlmSettings& settings, const Region& part)
{
    const NlmFrame& here = frames[centre];
    const Region window = here.image.region();
    const int reach = settings.window / 2, radius = settings.patch / 2,
              frame_radius = settings.patch_frames / 2, channels = here.image.channels(),
              guide_channels = here.guide.channels();
    const std::size_t pixels = part.pixels();
    NlmResult<Real> result;
    result.pixels.resize(pixels * static_cast<std::size_t>(channels));
    result.variances.resize(pixels);
    result.ambiguous.resize(pixels);
    const int last = static_cast<int>(frames.size()) - 1;
    std::vector<Guide<Real>> guides;
    for (const NlmFrame& frame : frames) guides.emplace_back(frame.guide, radius);
    const auto guide = [&](int frame) -> const Guide<Real>& {
        return guides[static_cast<std::size_t>(std::clamp(frame, 0, last))];
    };
    const std::vector<Real> over_patch = gaussian<Real>(radius),
                            over_frames = gaussian<Real>(frame_radius);
    const Real two_sigma_s = static_cast<Real>(2.0 * settings.sigma_s * settings.sigma_s),
               range = static_cast<Real>(settings.range * settings.range);

    for (int y = part.y0; y < part.y1; ++y)
        for (int x = part.x0; x < part.x1; ++x) {
            const std::size_t at =
                static_cast<std::size_t>(y - part.y0) * static_cast<std::size_t>(part.width()) +
                static_cast<std::size_t>(x - part.x0);
            std::vector<Real> sums(static_cast<std::size_t>(channels));
            Real total = 0, squares = 0;
            for (int f = 0; f <= last; ++f)
                for (int v = y - reach; v <= y + reach; ++v)
                    for (int u = x - reach; u <= x + reach; ++u) {
                        if (!window.contains(u, v)) continue;
                        const NlmFrame& there = frames[static_cast<std::size_t>(f)];
                        const int frame = f - static_cast<int>(centre);
                        const bool self = frame == 0 && u == x && v == y;
                        bool accepted = true;
                        for (int c = 0; c < channels && settings.gate != NlmGate::none && !self;
                             ++c) {
                            const Real p = static_cast<Real>(here.image.at(c, x, y)),
                                       q = static_cast<Real>(there.image.at(c, u, v));
                            const Real low = static_cast<Real>(here.low.at(c, x, y)),
                                       high = static_cast<Real>(here.high.at(c, x, y));
                            if (settings.gate == NlmGate::one_sample) {
                                accepted = accepted && low <= q && q <= high;
                                continue;
                            }
                            const Real h_p = (high - low) / 2;
                            const Real h_q = (static_cast<Real>(there.high.at(c, u, v)) -
                                              static_cast<Real>(there.low.at(c, u, v))) /
                                             2;
                            const Real difference = (p - q) * (p - q),
                                       allowed = h_p * h_p + h_q * h_q;
                            accepted = accepted && difference <= allowed;
                            if constexpr (std::is_same_v<Real, double>)
                                if (std::fabs(difference - allowed) <=
                                    1e-5 * (difference + allowed))
                                    result.ambiguous[at] = true;
                        }
                        if (!accepted) continue;
                        Real distance = 0;
                        for (int df = -frame_radius; df <= frame_radius; ++df) {
                            const Guide<Real>& guide_p = guide(static_cast<int>(centre) + df);
                            const Guide<Real>& guide_q = guide(f + df);
                            for (int dy = -radius; dy <= radius; ++dy)
                                for (int dx = -radius; dx <= radius; ++dx) {
                                    const Real* a = guide_p.at(x + dx, y + dy);
                                    const Real* b = guide_q.at(u + dx, v + dy);
                                    Real sum = 0;
                                    for (int c = 0; c < guide_channels; ++c)
                                        sum += (a[c] - b[c]) * (a[c] - b[c]);
                                    distance +=
                                        over_frames[static_cast<std::size_t>(df + frame_radius)] *
                                        over_patch[static_cast<std::size_t>(dx + radius)] *
                                        over_patch[static_cast<std::size_t>(dy + radius)] * sum;
                                }
                        }
                        distance /= static_cast<Real>(guide_channels);
                        const Real variance =
                            std::min(mean_over_channels<Real>(here.guide_variance, x, y),
                                     mean_over_channels<Real>(there.guide_variance, u, v));
                        const Real near = static_cast<Real>((u - x) * (u - x) + (v - y) * (v - y) +
                                                            frame * frame);
                        Real weight = std::exp(-near / two_sigma_s);
                        if (distance > 0)
                            weight *= range * variance > 0
                                          ? std::exp(-distance / (2 * range * variance))
                                          : 0;
                        for (int c = 0; c < channels; ++c)
                            sums[static_cast<std::size_t>(c)] +=
                                weight * static_cast<Real>(there.image.at(c, u, v));
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

template NlmResult<float> filter_nlm(std::span<const NlmFrame>, std::size_t, const NlmSettings&,
                                     const Region&);
template NlmResult<double> filter_nlm(std::span<const NlmFrame>, std::size_t, const NlmSettings&,
                                      const Region&);

} // namespace rayloom::oracle
