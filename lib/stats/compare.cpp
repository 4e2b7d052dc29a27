// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/compare.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"
#include "rayloom/stats/colour_map.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>

namespace rayloom
{

namespace
{

/// Figures that are errors: 0 is best and a ratio of two says which image is better.
constexpr const char* error_figures[] = {"rmse",          "relmse", "relmse_trimmed", "smape",
                                         "max_abs_error", "flip",   "hdr_flip"};
constexpr const char* not_finite = "non_finite_pixels"; // left out of all other figures
/// Figures that are better the higher they are.
constexpr const char* merit_figures[] = {"psnr", "psnr_clamped", "ssim"};

bool is_merit(const std::string& name)
{
    return std::find(std::begin(merit_figures), std::end(merit_figures), name) !=
           std::end(merit_figures);
}

std::optional<double> figure(const Table& table, const std::string& name)
{
    if (!table.has(name)) return std::nullopt;
    return table.number(name);
}

std::string number_text(double value)
{
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%.6g", value);
    return buffer;
}

Table ratios(const Table& a, const Table& b)
{
    Table out;
    for (const char* name : error_figures) {
        const auto va = figure(a, name), vb = figure(b, name);
        if (va && vb && (*va != 0.0 || *vb != 0.0)) out.set(name, *va / *vb);
    }
    return out;
}

} // namespace

double Comparison::equal_error_sample_factor() const
{
    return b ? b->relmse / a.relmse : ErrorMeasures::none;
}

std::string Comparison::json() const
{
    const Table table_a = a.table();
    if (!b) return table_a.json();
    const Table table_b = b->table();
    return "{\"a\": " + table_a.json() + ",\n \"b\": " + table_b.json() +
           ",\n \"a_over_b\": " + ratios(table_a, table_b).json() +
           ",\n \"psnr_gain\": " + json_number(a.psnr - b->psnr) +
           ",\n \"equal_error_sample_factor\": " + json_number(equal_error_sample_factor()) + "}";
}

std::string Comparison::text() const
{
    const Table table_a = a.table(), table_b = b ? b->table() : Table{};
    const Table ratio = b ? ratios(table_a, table_b) : Table{};
    const auto padded = [](std::string s, std::size_t width) {
        s.resize(std::max(width, s.size() + 1), ' ');
        return s;
    };
    std::string out;
    if (b) out += padded("", 26) + padded("A", 16) + padded("B", 16) + "A / B\n";
    std::vector<std::string> names = table_a.columns;
    for (const std::string& name : table_b.columns)
        if (!table_a.has(name)) names.push_back(name);
    for (const std::string& name : names) {
        std::string line = padded(name, 26);
        const auto va = figure(table_a, name);
        line += padded(va ? number_text(*va) : "-", 16);
        if (b) {
            const auto vb = figure(table_b, name);
            line += padded(vb ? number_text(*vb) : "-", 16);
            if (const auto r = figure(ratio, name)) line += number_text(*r);
        }
        line.erase(line.find_last_not_of(' ') + 1);
        out += line + "\n";
    }
    if (b) {
        out += padded("psnr_gain", 26) + number_text(a.psnr - b->psnr) + " dB\n";
        out += padded("equal_error_sample_factor", 26) + number_text(equal_error_sample_factor()) +
               "\n";
    }
    return out;
}

Comparison compare_images(ConstImageView a, ConstImageView b, const ErrorOptions& options)
{
    return {measure_errors(a, b, options), std::nullopt};
}

Comparison compare_images(ConstImageView a, ConstImageView b, ConstImageView reference,
                          const ErrorOptions& options)
{
    return {measure_errors(a, reference, options), measure_errors(b, reference, options)};
}

ErrorLimit parse_error_limit(std::string_view text)
{
    std::vector<std::string> names(std::begin(error_figures), std::end(error_figures));
    names.emplace_back(not_finite);
    names.insert(names.end(), std::begin(merit_figures), std::end(merit_figures));
    const std::size_t equals = text.find('=');
    if (equals == std::string_view::npos)
        throw UsageError("'" + std::string(text) +
                         "' is not a limit; write measure=value, for example flip=0.05");
    ErrorLimit limit;
    limit.measure = text.substr(0, equals);
    if (std::find(names.begin(), names.end(), limit.measure) == names.end())
        throw UsageError("there is no measure '" + limit.measure + "'" +
                         suggestion(limit.measure, names));
    const char* end = text.data() + text.size();
    const auto [stopped, status] = std::from_chars(text.data() + equals + 1, end, limit.value);
    if (status != std::errc{} || stopped != end || !std::isfinite(limit.value))
        throw UsageError("'" + std::string(text.substr(equals + 1)) +
                         "' is not a number; the limit of " + limit.measure + " needs one");
    return limit;
}

std::vector<std::string> broken_limits(const ErrorMeasures& measures,
                                       std::span<const ErrorLimit> limits)
{
    const Table table = measures.table();
    std::vector<std::string> out;
    for (const ErrorLimit& limit : limits) {
        const auto value = figure(table, limit.measure);
        const bool merit = is_merit(limit.measure);
        if (!value)
            out.push_back(limit.measure + " has no value here, its limit is " +
                          number_text(limit.value));
        else if (merit ? *value < limit.value : *value > limit.value)
            out.push_back(limit.measure + " is " + number_text(*value) +
                          (merit ? ", below its limit " : ", above its limit ") +
                          number_text(limit.value));
    }
    const bool asked = std::ranges::any_of(
        limits, [](const ErrorLimit& limit) { return limit.measure == not_finite; });
    if (!limits.empty() && !asked && measures.non_finite_pixels > 0)
        out.push_back(std::to_string(measures.non_finite_pixels) +
                      " pixels that are not finite were left out; " + not_finite +
                      "=N would allow so many");
    return out;
}

ErrorPicture error_picture(ConstImageView image, ConstImageView reference, ErrorMap map,
                           const ErrorOptions& options)
{
    const ImageBuffer errors = error_map(image, reference, map, options);
    ErrorPicture picture;
    if (map == ErrorMap::absolute || map == ErrorMap::relative) {
        std::vector<float> values;
        for (int y = errors.region().y0; y < errors.region().y1; ++y) {
            const auto row = errors.view().row_span(0, y);
            values.insert(values.end(), row.begin(), row.end());
        }
        const auto at = values.begin() +
                        static_cast<std::ptrdiff_t>(0.995 * static_cast<double>(values.size() - 1));
        std::nth_element(values.begin(), at, values.end());
        const float largest = *std::max_element(at, values.end());
        picture.high = *at > 0.0f ? *at : largest > 0.0f ? largest : 1.0;
    }
    picture.srgb = map_colours(errors.view(), 0.0, picture.high);
    return picture;
}

} // namespace rayloom
