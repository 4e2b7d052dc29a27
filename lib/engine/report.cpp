// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/report.h"

#include "rayloom/core/text.h"

#include <cstdio>

namespace rayloom
{

namespace
{

std::string format(const char* pattern, auto... values)
{
    char buffer[256];
    std::snprintf(buffer, sizeof buffer, pattern, values...);
    return buffer;
}

} // namespace

std::string RunReport::text() const
{
    std::string out =
        format("%-28s %-22s %10s %10s %8s\n", "node", "op", "seconds", "Mpixel", "calls");
    for (const NodeReport& n : nodes) {
        out += format("%-28s %-22s %10.3f %10.3f %8zu", n.id.c_str(), n.op.c_str(), n.seconds,
                      static_cast<double>(n.pixels) * 1e-6, n.calls);
        for (const auto& [what, count] : n.counts) out += format("  %s: %zu", what.c_str(), count);
        out += "\n";
    }
    out += format(
        "%.3f s in all on %d thread%s; reading %.3f, computing %.3f, writing %.3f thread-seconds\n",
        seconds, threads, threads == 1 ? "" : "s", reading, computing, writing);
    out += format(
        "%d sweep%s of %d strip%s, tiles %dx%d; pixels in memory at most %s (planned %s)\n", sweeps,
        sweeps == 1 ? "" : "s", strips, strips == 1 ? "" : "s", tile_width, tile_height,
        format_bytes(peak_bytes).c_str(), format_bytes(planned_peak_bytes).c_str());
    for (const SkipReport& s : skips) {
        out += "skipped: " + s.node + ": " + s.reason;
        if (s.pixels > 0) out += format(" (%zu pixels)", s.pixels);
        if (s.saved_seconds >= 0) out += format(", about %.3f s saved", s.saved_seconds);
        out += "\n";
    }
    for (const std::string& note : notes) out += "note: " + note + "\n";
    return out;
}

std::string RunReport::json() const
{
    const auto list = [](const auto& items, const auto& item_text) {
        std::string out = "[";
        for (const auto& item : items) out += (out.size() > 1 ? ", " : "") + item_text(item);
        return out + "]";
    };
    const auto counts = [](const std::map<std::string, std::size_t>& map) {
        std::string out = "{";
        for (const auto& [name, n] : map)
            out += (out.size() > 1 ? ", " : "") + json_quote(name) + ": " + std::to_string(n);
        return out + "}";
    };
    const auto quoted = [](const std::string& s) { return json_quote(s); };
    std::string out =
        "{\"graph\": " + json_quote(graph) + ", \"seconds\": " + json_number(seconds) +
        ", \"reading\": " + json_number(reading) + ", \"computing\": " + json_number(computing) +
        ", \"writing\": " + json_number(writing) + ", \"threads\": " + std::to_string(threads) +
        ", \"sweeps\": " + std::to_string(sweeps) + ", \"strips\": " + std::to_string(strips) +
        ", \"tile\": [" + std::to_string(tile_width) + ", " + std::to_string(tile_height) +
        "], \"peak_bytes\": " + std::to_string(peak_bytes) +
        ", \"planned_peak_bytes\": " + std::to_string(planned_peak_bytes);
    out += ",\n \"nodes\": " + list(nodes, [&](const NodeReport& n) {
               return "{\"id\": " + json_quote(n.id) + ", \"op\": " + json_quote(n.op) +
                      ", \"seconds\": " + json_number(n.seconds) +
                      ", \"pixels\": " + std::to_string(n.pixels) +
                      ", \"calls\": " + std::to_string(n.calls) +
                      ", \"skipped\": " + counts(n.skipped) + ", \"counts\": " + counts(n.counts) +
                      "}";
           });
    out += ",\n \"skips\": " + list(skips, [&](const SkipReport& s) {
               return "{\"node\": " + json_quote(s.node) + ", \"reason\": " + json_quote(s.reason) +
                      ", \"pixels\": " + std::to_string(s.pixels) + ", \"saved_seconds\": " +
                      (s.saved_seconds >= 0 ? json_number(s.saved_seconds) : "null") + "}";
           });
    std::string figures = "{";
    for (const auto& [name, all] : tables)
        figures += (figures.size() > 1 ? ", " : "") + json_quote(name) + ": " +
                   (all.size() == 1 ? all.front().json()
                                    : list(all, [](const Table& t) { return t.json(); }));
    out += ",\n \"tables\": " + figures + "}";
    out +=
        ",\n \"notes\": " + list(notes, quoted) + ", \"written\": " + list(written, quoted) + "}";
    return out;
}

} // namespace rayloom
