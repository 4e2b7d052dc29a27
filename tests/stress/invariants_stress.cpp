// SPDX-License-Identifier: Apache-2.0
// What stays true of a node or a graph whatever its picture: which invariants each one holds stands
// in invariants.txt, and why it does not hold the others. The list and the measurement must agree
// both ways, so that a node that loses one fails, and a new node is asked for its line.
#include "rayloom/core/registry.h"
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/stress/hostile_images.h"
#include "tests/stress/reach.h"
#include "tests/stress/soak.h"
#include "tests/support/folders.h"
#include "tests/support/made_up_deep.h"
#include "tests/support/made_up_input.h"
#include "tests/support/subjects.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iomanip>
#include <optional>
#include <set>
#include <sstream>

namespace rayloom::test
{
namespace
{

/// Sizes that halve evenly, so that a pyramid halves the mirrored picture at the mirrored places,
/// and prime ones.
struct Picture {
    Region window;
    bool flat_and_edges; ///< a flat third, one of steps, one of noise
    bool even;
    float constant; ///< value of its constant images
};
const std::vector<Picture> pictures{{{0, 0, 48, 48}, false, true, 0.375f},
                                    {{-17, -9, 26, 28}, false, false, 41.0f},
                                    {{64, -80, 112, -48}, true, true, 0.0017f}};

// ---- What inputs are ----

bool is_light(const std::string& input)
{
    for (const char* other : {"histogram", "count", "variance", "albedo", "guide", "normal",
                              "depth", "parts", "pivot", "color", "levels", "boundary", "marked"})
        if (input.ends_with(other) && !(input == "color")) return false;
    return !input.starts_with("guide");
}

/// Whether a channel of a render is the colour of surfaces.
bool is_surface(const std::string& channel) { return channel.find("Col.") != std::string::npos; }

/// Variance of what is light.
bool is_its_variance(const std::string& input, const RunRequest& request)
{
    if (!input.ends_with("variance")) return false;
    // An image without a guide guides itself.
    if (input == "guide_variance") return !request.inputs.contains("guide");
    const std::string of = input.substr(0, input.size() - std::string("variance").size());
    return of.empty() || is_light(of.substr(0, of.size() - 1));
}

/// Neither light nor a feature that could be the same everywhere.
bool is_no_picture(const std::string& input)
{
    for (const char* other : {"histogram", "count", "parts", "boundary", "marked"})
        if (input.ends_with(other)) return true;
    return false;
}

/// Made-up input with a display window that mirrors onto itself.
RunRequest request_for(const Graph& graph, const Picture& picture)
{
    RunRequest request = made_up_request(graph, picture.window);
    change_images(request, [&](const std::string& input, std::size_t, MemoryImage& image) {
        image.desc.display = image.desc.data;
        if (!picture.flat_and_edges || !is_light(input)) return;
        const Region& r = image.desc.data;
        const int alpha = image.desc.alpha();
        set_pixels(image, [&](int c, int x, int y, float v) {
            if (c == alpha || 3 * (x - r.x0) >= 2 * r.width()) return v;
            // Nearly flat: where samples agree to the last bit, rounding decides what is alike.
            if (3 * (x - r.x0) < r.width()) return 0.6f + 0.1f * static_cast<float>(c) + 1e-3f * v;
            return (((x - r.x0) / 5 + (y - r.y0) / 4) % 2 == 0 ? 0.05f : 2.0f) + 0.01f * v;
        });
    });
    for (auto& [name, binding] : request.inputs)
        if (binding.deep) {
            auto deep = std::make_shared<MemoryDeep>(*binding.deep);
            deep->desc.display = deep->desc.data;
            binding.deep = std::move(deep);
        }
    return request;
}

/// Images and samples: value(input, channel, x, y, was).
using Change = std::function<float(const std::string&, const ImageDesc&, int, int, int, float)>;

RunRequest changed(RunRequest request, const Change& value)
{
    change_images(request, [&](const std::string& input, std::size_t, MemoryImage& image) {
        set_pixels(image, [&](int c, int x, int y, float v) {
            return value(input, image.desc, c, x, y, v);
        });
    });
    for (auto& [name, binding] : request.inputs)
        if (binding.deep)
            binding.deep = std::make_shared<MemoryDeep>(
                with_values(*binding.deep, [&, &name = name](int c, int x, int y, float v) {
                    return value(name, binding.deep->desc, c, x, y, v);
                }));
    return request;
}

// ---- What runs give ----

RunReport run(const Graph& graph, const RunRequest& request)
{
    RunOptions options;
    options.threads = 1;
    return run_graph(graph, request, options);
}

template <class T>
using Results = std::map<std::string, std::vector<T>, std::less<>>;

/// What a run gave as rows of numbers that have one scale: a channel of an image, of the samples of
/// a deep image, or one figure.
struct Series {
    std::string output;
    std::string name; ///< of the output, or output.column
    bool colour = true;
    std::vector<float> image;
    std::vector<double> figures;
    std::string text; ///< windows, channels, numbers of samples, cells that are no numbers
};

std::vector<Series> series_of(const RunReport& report)
{
    std::vector<Series> all;
    for (const auto& [name, list] : report.images)
        for (const MemoryImage& image : list)
            for (int c = 0; c < image.desc.channel_count(); ++c) {
                Series s;
                s.output = s.name = name;
                s.text =
                    image.desc.data.text() + " " + image.desc.channels[static_cast<std::size_t>(c)];
                const std::vector<int> colour = image.desc.colour();
                const std::string& channel = image.desc.channels[static_cast<std::size_t>(c)];
                s.colour = std::ranges::find(colour, c) != colour.end() && !is_surface(channel) &&
                           !channel.ends_with(".A");
                for (int y = image.desc.data.y0; y < image.desc.data.y1; ++y) {
                    const auto row = image.pixels.view().row_span(c, y);
                    s.image.insert(s.image.end(), row.begin(), row.end());
                }
                all.push_back(std::move(s));
            }
    for (const auto& [name, list] : report.deep)
        for (const MemoryDeep& deep : list)
            for (int c = 0; c < deep.desc.channel_count(); ++c) {
                Series s;
                s.output = s.name = name;
                s.text =
                    deep.desc.data.text() + " " + deep.desc.channels[static_cast<std::size_t>(c)];
                s.colour = c < 3;
                for (const auto& row : deep.rows) {
                    const auto& samples = row->samples[static_cast<std::size_t>(c)];
                    s.image.insert(s.image.end(), samples.begin(), samples.end());
                    for (const auto first : row->first) s.text += " " + std::to_string(first);
                }
                all.push_back(std::move(s));
            }
    for (const auto& [name, list] : report.tables)
        for (const Table& whole : list) {
            Table table = whole;
            // Of figures by channel those of light.
            std::erase_if(table.rows, [](const auto& row) {
                return std::ranges::find(row, Table::Cell("A")) != row.end();
            });
            for (std::size_t c = 0; c < table.columns.size(); ++c) {
                Series s;
                s.output = name;
                s.name = name + "." + table.columns[c];
                for (const auto& row : table.rows)
                    if (const double* v = std::get_if<double>(&row[c]))
                        s.figures.push_back(*v);
                    else
                        s.text += std::get<std::string>(row[c]) + "\n";
                all.push_back(std::move(s));
            }
        }
    return all;
}

std::string numbers(const std::string& name, std::size_t i, double u, double v)
{
    std::ostringstream text;
    text << std::setprecision(9) << name << " value " << i << ": " << v << ", not " << u;
    return text.str();
}

/// What is wrong where b ought to be a times `factor`, to the last bit or up to rounding, measured
/// against the largest value of the channel; empty when nothing is.
std::string unlike(const Series& a, const Series& b, double factor, bool exact)
{
    if (a.name != b.name || a.text != b.text || a.image.size() != b.image.size() ||
        a.figures.size() != b.figures.size())
        return a.name + " has another shape, or text";
    double most = 0.0;
    for (const float v : a.image) most = std::max(most, std::abs(factor * v));
    for (std::size_t i = 0; i < a.image.size(); ++i) {
        const double u = factor * a.image[i], v = b.image[i];
        // Beside the least floats there are too few digits.
        const bool denormal = std::max(std::abs(u), std::abs(v)) < 1e-36;
        if (!(exact ? u == v || denormal : std::abs(u - v) <= 2e-5 * most))
            return numbers(a.name, i, u, v);
    }
    most = 0.0;
    for (const double v : a.figures) most = std::max(most, std::abs(factor * v));
    for (std::size_t i = 0; i < a.figures.size(); ++i) {
        const double u = factor * a.figures[i], v = b.figures[i];
        if (!(u == v || std::abs(u - v) <= 1e-5 * most)) return numbers(a.name, i, u, v);
    }
    return {};
}

/// What is wrong with each output that is not as it should be.
using Broken = std::map<std::string, std::string>;

Broken unlike(const RunReport& a, const RunReport& b)
{
    const std::vector<Series> p = series_of(a), q = series_of(b);
    Broken broken;
    for (std::size_t i = 0; i < p.size(); ++i)
        if (const std::string why = i < q.size() ? unlike(p[i], q[i], 1.0, false) : "other outputs";
            !why.empty())
            broken.emplace(p[i].output, why);
    return broken;
}

/// Outputs that differ by more than a five-hundredth of their values, in the mean.
Broken much_unlike(const RunReport& a, const RunReport& b)
{
    const std::vector<Series> p = series_of(a), q = series_of(b);
    Broken broken;
    for (std::size_t i = 0; i < p.size(); ++i) {
        double sum = 0.0, differences = 0.0;
        const bool same_shape = i < q.size() && p[i].text == q[i].text &&
                                p[i].image.size() == q[i].image.size() && p[i].figures.empty();
        for (std::size_t k = 0; same_shape && k < p[i].image.size(); ++k) {
            sum += std::abs(p[i].image[k]);
            differences += std::abs(p[i].image[k] - q[i].image[k]);
        }
        if (!same_shape || !(differences <= 0.002 * sum))
            broken.emplace(p[i].output, "much is other");
    }
    return broken;
}

// ---- Moves ----

/// Where pixel (x, y) of the moved picture comes from, in a window moved likewise.
struct Move {
    bool swap_axes;
    Region window(const Region& w) const { return swap_axes ? Region{w.y0, w.x0, w.y1, w.x1} : w; }
    std::pair<int, int> from(const Region& to, int x, int y) const
    {
        return swap_axes ? std::pair{y, x} : std::pair{to.x0 + to.x1 - 1 - x, y};
    }
};
constexpr Move mirror{false}, transpose{true};

MemoryImage moved(const MemoryImage& image, const Move& move)
{
    MemoryImage out;
    out.desc = image.desc;
    out.desc.data = move.window(image.desc.data);
    out.desc.display = move.window(image.desc.display);
    out.pixels = ImageBuffer(out.desc.data, out.desc.channel_count());
    set_pixels(out, [&](int c, int x, int y, float) {
        const auto [fx, fy] = move.from(out.desc.data, x, y);
        return image.pixels.view().at(c, fx, fy);
    });
    return out;
}

MemoryDeep moved(const MemoryDeep& deep, const Move& move)
{
    const Region to = move.window(deep.desc.data);
    const auto at = [&](int c, int x, int y) {
        const auto [fx, fy] = move.from(to, x, y);
        return samples_at(deep, c, fx, fy);
    };
    MemoryDeep out = make_deep(
        to, deep.desc.channels, [&](int x, int y) { return static_cast<int>(at(0, x, y).size()); },
        [&](int c, int x, int y, int s) { return at(c, x, y)[static_cast<std::size_t>(s)]; });
    out.desc.display = move.window(deep.desc.display);
    return out;
}

std::pair<RunReport, RunReport> moved_both_ways(const Graph& graph, const RunRequest& plain,
                                                const RunReport& result, const Move& move)
{
    RunRequest request = plain;
    change_images(request, [&](const std::string&, std::size_t, MemoryImage& image) {
        image = moved(image, move);
    });
    for (auto& [name, binding] : request.inputs)
        if (binding.deep) binding.deep = std::make_shared<MemoryDeep>(moved(*binding.deep, move));
    RunReport expected;
    for (const auto& [name, list] : result.images)
        for (const MemoryImage& image : list) expected.images[name].push_back(moved(image, move));
    for (const auto& [name, list] : result.deep)
        for (const MemoryDeep& deep : list) expected.deep[name].push_back(moved(deep, move));
    expected.tables = result.tables;
    return {std::move(expected), run(graph, request)};
}

// ---- The other invariants ----

/// What a mean of many pixels, summed in float, may miss by.
constexpr float averaging_error = 2e-5f;

Broken breaks_constant(const RunReport& result, float value, bool same_value)
{
    Broken broken;
    for (const Series& s : series_of(result)) {
        if (s.image.empty()) continue;
        const float expected = same_value ? value : s.image.front();
        const float limit = averaging_error * std::max(value, std::abs(expected));
        for (std::size_t i = 0; i < s.image.size(); ++i)
            if (!(std::abs(s.image[i] - expected) <= limit))
                broken.emplace(s.output, numbers(s.name, i, expected, s.image[i]));
    }
    return broken;
}

/// Every pixel lies between the least and the largest pixel of light it is made from, in the
/// channel of its name.
Broken breaks_range(const Graph& graph, const RunRequest& request, const RunReport& result)
{
    Broken broken;
    const Reach reach(graph, request);
    struct Limits {
        float low = INFINITY, high = -INFINITY;
    };
    for (const auto& [output, list] : result.images)
        for (std::size_t i = 0; i < list.size(); ++i) {
            const MemoryImage& image = list[i];
            // Neighbouring pixels are often made from the same ones.
            std::map<std::string, std::pair<Region, std::vector<Limits>>> known;
            const auto limits_of = [&](const std::string& input, const Region& region) {
                auto& [of, limits] = known[input];
                if (of == region && !limits.empty()) return limits;
                of = region;
                limits.assign(image.desc.channels.size(), {});
                for (const auto& from : request.inputs.find(input)->second.images)
                    for (int c = 0; c < from->desc.channel_count(); ++c)
                        for (std::size_t to = 0; to < limits.size(); ++to) {
                            const auto& names = from->desc.channels;
                            const std::string& name = image.desc.channels[to];
                            if (name != names[static_cast<std::size_t>(c)] &&
                                std::ranges::find(names, name) != names.end())
                                continue;
                            for (int y = region.y0; y < region.y1; ++y) {
                                const float* row = from->pixels.view().ptr(c, region.x0, y);
                                for (int x = 0; x < region.width(); ++x) {
                                    limits[to].low = std::min(limits[to].low, row[x]);
                                    limits[to].high = std::max(limits[to].high, row[x]);
                                }
                            }
                        }
                return limits;
            };
            const Region& r = image.desc.data;
            float brightest = 0.0f;
            for (int c = 0; c < image.desc.channel_count(); ++c)
                for (int y = r.y0; y < r.y1; ++y)
                    for (const float v : image.pixels.view().row_span(c, y))
                        brightest = std::max(brightest, std::abs(v));
            for (int y = r.y0; y < r.y1; ++y)
                for (int x = r.x0; x < r.x1 && !broken.contains(output); ++x) {
                    // A sample of them will do where many are read.
                    if ((x * 7 + y * 3) % 8 != 0) continue;
                    std::vector<Limits> limits(image.desc.channels.size());
                    for (const auto& [input, region] : reach.read_for(output, i, x, y)) {
                        const auto bound = request.inputs.find(input);
                        if (bound == request.inputs.end() || !is_light(input) ||
                            bound->second.images.empty())
                            continue;
                        const std::vector<Limits> own = limits_of(input, region);
                        for (std::size_t c = 0; c < own.size(); ++c) {
                            limits[c].low = std::min(limits[c].low, own[c].low);
                            limits[c].high = std::max(limits[c].high, own[c].high);
                        }
                    }
                    for (std::size_t c = 0; c < limits.size(); ++c) {
                        const float v = image.pixels.view().at(static_cast<int>(c), x, y);
                        const float slack = averaging_error * std::max(std::abs(limits[c].low),
                                                                       std::abs(limits[c].high)) +
                                            1e-7f * brightest;
                        if (!(v >= limits[c].low - slack && v <= limits[c].high + slack)) {
                            std::ostringstream text;
                            text << std::setprecision(9) << output << " channel " << c << " pixel "
                                 << x << "," << y << " is " << v << ", made from " << limits[c].low
                                 << " to " << limits[c].high;
                            broken.emplace(output, text.str());
                        }
                    }
                }
        }
    return broken;
}

/// By output (or figure): the powers of k it may be multiplied by where light is multiplied by k
/// and its variance by k².
using Degrees = std::map<std::string, std::set<int>>;

void keep_degrees(Degrees& degrees, Broken& broken, const RunReport& plain, const RunReport& scaled,
                  double k, bool exact)
{
    const std::vector<Series> a = series_of(plain), b = series_of(scaled);
    for (std::size_t i = 0; i < a.size(); ++i) {
        if (!a[i].colour || (a[i].image.empty() && a[i].figures.empty())) continue;
        std::set<int>& held = degrees[a[i].name];
        for (const int degree : std::set(held)) {
            const std::string why =
                i < b.size() ? unlike(a[i], b[i], std::pow(k, degree), exact) : "other outputs";
            if (why.empty()) continue;
            held.erase(degree);
            // Of a power that was right so far.
            if (degree == 1 || held.empty())
                broken[a[i].name] += "k = " + std::to_string(k) + ", power " +
                                     std::to_string(degree) + ": " + why + "; ";
        }
    }
}

RunRequest scaled_by(const RunRequest& request, float k)
{
    return changed(
        request, [&](const std::string& input, const ImageDesc& desc, int c, int, int, float v) {
            // Colours of surfaces are a share of light.
            const std::string& channel = desc.channels[static_cast<std::size_t>(c)];
            if (channel == "A" || channel == "Z" || is_surface(channel)) return v;
            return is_its_variance(input, request) ? k * k * v : is_light(input) ? k * v : v;
        });
}

/// The lists of a request in another order that is neither the same nor the reverse.
RunRequest shuffled(RunRequest request)
{
    for (auto& [name, binding] : request.inputs)
        if (binding.is_list) {
            const auto was = binding.images;
            for (std::size_t i = 0; i < was.size(); ++i)
                binding.images[i] = was[(2 * i + 1) % was.size()];
        }
    return request;
}

// ---- What a subject holds ----

struct Measured {
    std::set<std::string> held;                 ///< words of its line
    std::map<std::string, std::string> missing; ///< what it could hold and does not, and where
};

/// `lists` is the graph to try the order of lists on; null when the subject has none.
Measured measured(const Graph& graph, const Graph* lists, const std::vector<Picture>& all)
{
    Measured m;
    std::set<std::string> outputs;
    // Adds a word, or words `output:property` when not all outputs hold it; the error of a run that
    // is refused is of all outputs.
    const auto look = [&](const std::string& property, const std::vector<Picture>& of,
                          const std::set<std::string>& names, const auto& breaks) {
        Broken broken;
        for (const Picture& picture : of) {
            try {
                for (const auto& [output, why] : breaks(picture))
                    broken.emplace(output, picture.window.text() + ": " + why);
            } catch (const Error& e) {
                for (const std::string& output : names) broken.emplace(output, e.what());
            }
        }
        std::erase_if(broken, [&](const auto& b) { return !names.contains(b.first); });
        if (broken.empty()) {
            m.held.insert(property);
            return std::set<std::string>{};
        }
        m.missing[property] = broken.begin()->second;
        std::set<std::string> left;
        for (const std::string& output : names)
            if (broken.contains(output))
                left.insert(output);
            else
                m.held.insert(output + ":" + property);
        return left;
    };
    std::vector<Picture> even;
    std::ranges::copy_if(all, std::back_inserter(even), &Picture::even);
    std::map<int, RunReport> results;
    const auto plain = [&](const Picture& picture) -> const RunReport& {
        const auto it = results.find(picture.window.x0);
        if (it != results.end()) return it->second;
        return results[picture.window.x0] = run(graph, request_for(graph, picture));
    };
    const RunReport& first = plain(all.front());
    const RunRequest request = request_for(graph, all.front());
    std::set<std::string> images, deep;
    for (const Series& s : series_of(first)) outputs.insert(s.output);
    for (const auto& [name, list] : first.images) images.insert(name);
    for (const auto& [name, list] : first.deep) deep.insert(name);
    bool has_light = false, has_light_images = false;
    for (const auto& [name, binding] : request.inputs) {
        has_light = has_light || is_light(name);
        has_light_images = has_light_images || (is_light(name) && !binding.images.empty());
    }

    if (!(images.empty() && deep.empty()) && !request.inputs.empty()) {
        std::map<int, RunReport> constants;
        const auto constant = [&](const Picture& p) -> const RunReport& {
            const auto it = constants.find(p.window.x0);
            if (it != constants.end()) return it->second;
            const RunRequest even_light =
                changed(request_for(graph, p), [&](const std::string& input, const ImageDesc& desc,
                                                   int c, int, int, float v) {
                    if (is_no_picture(input)) return v;
                    const bool share = input.ends_with("albedo") || input.ends_with("pivot") ||
                                       input.ends_with("_color") ||
                                       is_surface(desc.channels[static_cast<std::size_t>(c)]);
                    return share ? 0.375f : p.constant;
                });
            return constants[p.window.x0] = run(graph, even_light);
        };
        std::set<std::string> pixels = images;
        pixels.insert(deep.begin(), deep.end());
        look("flat", all, pixels,
             [&](const Picture& p) { return breaks_constant(constant(p), p.constant, false); });
        look("constant", all, pixels,
             [&](const Picture& p) { return breaks_constant(constant(p), p.constant, true); });
    }
    if (!images.empty() && has_light_images)
        look("range", all, images, [&](const Picture& p) {
            return breaks_range(graph, request_for(graph, p), plain(p));
        });
    if (has_light) {
        Degrees degrees;
        Broken broken;
        for (const Series& s : series_of(first))
            if (s.colour && !(s.image.empty() && s.figures.empty())) degrees[s.name] = {0, 1, 2};
        try {
            for (const Picture& p : all)
                for (const double k : {std::exp2(-24), std::exp2(24), 3.0})
                    keep_degrees(
                        degrees, broken, plain(p),
                        run(graph, scaled_by(request_for(graph, p), static_cast<float>(k))), k,
                        k != 3.0);
        } catch (const Error& e) {
            for (auto& [name, held] : degrees) held.clear();
            broken[""] = e.what();
        }
        if (std::ranges::all_of(degrees, [](const auto& d) { return d.second.contains(1); })) {
            m.held.insert("scale");
        } else {
            for (const auto& [name, held] : degrees)
                if (held.size() == 3) // zero everywhere
                    continue;
                else if (held.contains(1))
                    m.held.insert(name + ":k");
                else if (held.contains(2))
                    m.held.insert(name + ":k²");
                else if (held.contains(0))
                    m.held.insert(name + ":1");
                else
                    m.missing["scale"] += name + ": " + broken[name] + broken[""] + "\n";
        }
    }
    if (lists) {
        std::set<std::string> of_lists;
        for (const GraphOutput& output : lists->outputs) of_lists.insert(output.name);
        look("order", all, of_lists, [&](const Picture& p) {
            const RunRequest in_order = request_for(*lists, p);
            return unlike(run(*lists, in_order), run(*lists, shuffled(in_order)));
        });
    }
    if (request.inputs.empty()) return m;
    for (const auto& [property, move] :
         {std::pair("mirror", mirror), std::pair("transpose", transpose)}) {
        std::map<int, std::pair<RunReport, RunReport>> ways;
        const auto both = [&, &move = move ](const Picture& p) -> const auto&
        {
            const auto it = ways.find(p.window.x0);
            if (it != ways.end()) return it->second;
            return ways[p.window.x0] =
                       moved_both_ways(graph, request_for(graph, p), plain(p), move);
        };
        const auto strictly = [&](const Picture& p) {
            return unlike(both(p).first, both(p).second);
        };
        const auto nearly = [&](const Picture& p) {
            return much_unlike(both(p).first, both(p).second);
        };
        const std::set<std::string> left = look(property, all, outputs, strictly);
        if (left.empty()) continue;
        // What little is left of it.
        const std::map<std::string, std::string> missing = m.missing;
        const auto few = look(std::string(property) + "-even", even, left, strictly);
        if (!few.empty()) look(std::string(property) + "-nearly", even, few, nearly);
        m.missing = missing;
    }
    return m;
}

/// The example of a node, and beside what it shows the node's own output: an example may undo what
/// its node does.
Graph graph_of_node(const std::string& node)
{
    Graph graph = example_graph(node);
    const auto it = std::ranges::find(graph.nodes, node, &GraphNode::op);
    const std::string port = Registry::instance().find(node)->outputs.front().name;
    const bool shown = std::ranges::any_of(graph.outputs, [&](const GraphOutput& o) {
        return o.stream.node == it->id && (o.stream.port.empty() || o.stream.port == port);
    });
    if (shown) return graph;
    GraphOutput own;
    own.name = "own";
    own.stream.node = it->id;
    own.stream.port = port;
    graph.outputs.push_back(own);
    return graph;
}

bool has_lists(const Graph& graph)
{
    return std::ranges::any_of(graph.inputs,
                               [](const GraphInput& i) { return i.kind == PortKind::list; });
}

/// A graph that gives a node its lists, where its example does not.
std::optional<Graph> graph_of_lists(const std::string& node)
{
    const NodeInfo& info = *Registry::instance().find(node);
    const Graph example = graph_of_node(node);
    if (std::ranges::none_of(info.inputs,
                             [](const PortInfo& p) { return p.kind == PortKind::list; }))
        return std::nullopt;
    if (has_lists(example)) return example;
    std::string inputs, ports, outputs;
    bool any = false;
    for (const PortInfo& port : info.inputs) {
        // The first list, where none must be there.
        const bool list = port.kind == PortKind::list && !any;
        if (!list && !port.required) continue;
        any = any || list;
        inputs += "  " + port.name + ": " + (list ? "{kind: list}" : "{}") + "\n";
        ports += ", " + port.name + ": " + port.name;
    }
    for (const PortInfo& port : info.outputs)
        if (port.required) outputs += "  " + port.name + ": n." + port.name + "\n";
    return parse_graph("rayloom: 1\nname: lists\ninputs:\n" + inputs + "nodes:\n  n: {op: " + node +
                           ports + "}\noutputs:\n" + outputs,
                       node);
}

// ---- The list ----

struct Listed {
    std::map<std::string, std::set<std::string>> held;
    /// Property and subject, and why it is not held.
    std::map<std::pair<std::string, std::string>, std::string> reasons;
};

Listed listed()
{
    std::ifstream file(test::source_folder() / "tests/stress/invariants.txt");
    Listed list;
    std::string property, reason;
    for (std::string line; std::getline(file, line);) {
        line = line.substr(0, line.find('#'));
        const bool inner = line.starts_with(' ');
        std::istringstream words(line);
        std::string subject;
        if (!(words >> subject)) continue;
        if (inner) {
            EXPECT_FALSE(reason.empty()) << line;
            for (; !subject.empty(); subject.clear(), words >> subject)
                EXPECT_TRUE(list.reasons.emplace(std::pair{property, subject}, reason).second)
                    << "two reasons: " << property << " of " << subject;
        } else if (subject == "without") {
            std::getline(words >> property, reason);
            EXPECT_TRUE(property.ends_with(':')) << line;
            property.pop_back();
        } else {
            std::set<std::string>& held = list.held[subject];
            for (std::string word; words >> word;) held.insert(word);
        }
    }
    return list;
}

std::string line_of(const std::string& subject, const std::set<std::string>& held)
{
    std::string line = subject;
    for (const std::string& word : held) line += " " + word;
    return line;
}

void expect_listed(const std::string& subject, const Measured& m)
{
    static const Listed list = listed();
    const auto it = list.held.find(subject);
    if (it == list.held.end() || it->second != m.held)
        ADD_FAILURE() << "tests/stress/invariants.txt says: "
                      << (it == list.held.end() ? "nothing" : line_of(subject, it->second))
                      << "\n                     measured is: " << line_of(subject, m.held);
    for (const auto& [property, where] : m.missing)
        EXPECT_TRUE(list.reasons.contains({property, subject}))
            << "no reason why " << subject << " is without " << property << ": " << where;
    for (const auto& [of, reason] : list.reasons)
        if (of.second == subject) {
            EXPECT_TRUE(m.missing.contains(of.first))
                << subject << " holds " << of.first << ", and yet: " << reason;
        }
}

std::string test_name(const ::testing::TestParamInfo<std::string>& info)
{
    return as_test_name(info.param);
}

class InvariantsOfNode : public ::testing::TestWithParam<std::string>
{
};

TEST_P(InvariantsOfNode, AreThoseListed)
{
    if (touches_files(example_graph(GetParam()))) GTEST_SKIP() << "reads or writes files";
    const Graph graph = graph_of_node(GetParam());
    const std::optional<Graph> lists = graph_of_lists(GetParam());
    expect_listed(GetParam(), measured(graph, lists ? &*lists : nullptr, pictures));
}

INSTANTIATE_TEST_SUITE_P(Registry, InvariantsOfNode, ::testing::ValuesIn(built_in_nodes()),
                         test_name);

class InvariantsOfGraph : public ::testing::TestWithParam<std::string>
{
};

TEST_P(InvariantsOfGraph, AreThoseListed)
{
    const Graph graph = read_graph(GetParam());
    // The plain even picture shows nothing that the others do not, and graphs take time.
    expect_listed("graph:" + graph.name,
                  measured(graph, has_lists(graph) ? &graph : nullptr, {pictures[1], pictures[2]}));
}

INSTANTIATE_TEST_SUITE_P(Shipped, InvariantsOfGraph, ::testing::ValuesIn(shipped_graphs()),
                         test_name);

TEST(Invariants, AreListedForNothingElse)
{
    std::set<std::string> subjects;
    for (const std::string& node : built_in_nodes())
        if (!touches_files(example_graph(node))) subjects.insert(node);
    for (const std::string& file : shipped_graphs())
        subjects.insert("graph:" + read_graph(file).name);
    const Listed list = listed();
    for (const auto& [subject, held] : list.held)
        EXPECT_TRUE(subjects.contains(subject)) << "nothing is called " << subject;
    for (const auto& [of, reason] : list.reasons)
        EXPECT_TRUE(subjects.contains(of.second)) << "nothing is called " << of.second;
}

} // namespace
} // namespace rayloom::test
