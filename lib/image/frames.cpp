// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/frames.h"

#include "rayloom/core/error.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <glob.h>
#include <unordered_set>

namespace rayloom
{

namespace
{
// A range is a list somebody renders; more than this is a slip of the keyboard.
constexpr std::int64_t max_frames = 1'000'000;

bool is_digit(char c) { return c >= '0' && c <= '9'; }

[[noreturn]] void bad_range(std::string_view text, const std::string& why)
{
    throw UsageError("frame range '" + std::string(text) + "': " + why +
                     "; write 7, 1-10, 1-10x2 (every second) or a comma list of these");
}

// Reads an optional sign and digits from `rest`, which it shortens.
std::optional<int> take_number(std::string_view& rest)
{
    std::size_t n = !rest.empty() && rest[0] == '-' ? 1 : 0;
    if (n >= rest.size() || !is_digit(rest[n])) return std::nullopt;
    int value = 0;
    const auto [end, status] = std::from_chars(rest.data(), rest.data() + rest.size(), value);
    if (status != std::errc{}) return std::nullopt;
    rest.remove_prefix(static_cast<std::size_t>(end - rest.data()));
    return value;
}
} // namespace

std::vector<int> parse_frame_range(std::string_view text)
{
    if (text.find(':') != std::string_view::npos)
        throw UsageError("frame range '" + std::string(text) +
                         "': ':' means every n-th frame to some tools and interleaved passes to "
                         "others; write 1-10x2 for every second frame");
    std::vector<int> frames;
    std::unordered_set<int> seen;
    const auto add = [&](std::int64_t frame) {
        if (seen.insert(static_cast<int>(frame)).second) frames.push_back(static_cast<int>(frame));
        if (static_cast<std::int64_t>(frames.size()) > max_frames)
            bad_range(text, "more than a million frames");
    };
    std::string_view rest = text;
    while (true) {
        const auto first = take_number(rest);
        if (!first)
            bad_range(text, rest.empty() ? "a frame is missing"
                                         : "no frame at '" + std::string(rest) + "'");
        std::int64_t last = *first, step = 1;
        bool except = false;
        if (!rest.empty() && rest[0] == '-') {
            rest.remove_prefix(1);
            const auto end = take_number(rest);
            if (!end) bad_range(text, "the interval has no end");
            last = *end;
            if (!rest.empty() && (rest[0] == 'x' || rest[0] == 'y')) {
                except = rest[0] == 'y';
                rest.remove_prefix(1);
                const auto by = take_number(rest);
                if (!by || *by < 1) bad_range(text, "the step must be a whole number above 0");
                step = *by;
            }
        }
        if (std::abs(last - *first) / (except ? 1 : step) >= max_frames)
            bad_range(text, "more than a million frames");
        const std::int64_t sign = last < *first ? -1 : 1, length = (last - *first) * sign;
        if (except) {
            for (std::int64_t i = 0; i <= length; ++i)
                if (i % step != 0) add(*first + sign * i);
        } else {
            for (std::int64_t i = 0; i <= length; i += step) add(*first + sign * i);
        }
        if (rest.empty()) break;
        if (rest[0] != ',') bad_range(text, "'" + std::string(rest) + "' is not understood");
        rest.remove_prefix(1);
    }
    if (frames.empty()) bad_range(text, "no frame is left");
    return frames;
}

std::string format_frame_range(std::span<const int> frames)
{
    std::string out;
    for (std::size_t i = 0; i < frames.size();) {
        // Longest run with one step from here; a backwards run only with step −1.
        std::size_t n = 1;
        std::int64_t step = 0;
        if (i + 1 < frames.size()) {
            step = std::int64_t{frames[i + 1]} - frames[i];
            while (i + n < frames.size() && std::int64_t{frames[i + n]} - frames[i + n - 1] == step)
                ++n;
        }
        if (!out.empty()) out += ',';
        out += std::to_string(frames[i]);
        if (n >= 3 || (n == 2 && (step == 1 || step == -1))) {
            out += '-' + std::to_string(frames[i + n - 1]);
            if (step != 1 && step != -1) out += 'x' + std::to_string(std::abs(step));
            i += n;
        } else {
            i += 1;
        }
    }
    return out;
}

std::optional<RelativeFrames> parse_relative_frames(std::string_view text)
{
    const std::size_t dots = text.find("..");
    if (dots == std::string_view::npos) return std::nullopt;
    const auto bad = [&](const std::string& why) {
        throw UsageError("relative frames '" + std::string(text) + "': " + why +
                         "; write -5..+5 or -5..-1, and frames that are the same in every run as "
                         "1-10");
    };
    const auto end = [&](std::string_view part) {
        if (part != "0" && !part.starts_with('-') && !part.starts_with('+'))
            bad("'" + std::string(part) + "' has no sign");
        if (part.starts_with('+')) part.remove_prefix(1);
        const auto number = take_number(part);
        if (!number || !part.empty() || std::abs(std::int64_t{*number}) > max_frames)
            bad("an end is not a number");
        return number.value_or(0);
    };
    const RelativeFrames frames{end(text.substr(0, dots)), end(text.substr(dots + 2))};
    if (frames.first > frames.last) bad("the first frame comes after the last one");
    return frames;
}

FramePattern::FramePattern(std::string text) : m_text(std::move(text))
{
    const auto percent_place = [&](std::size_t i) -> std::size_t { // length of %[0][n]d at i, or 0
        std::size_t n = i + 1;
        while (n < m_text.size() && is_digit(m_text[n])) ++n;
        return n < m_text.size() && m_text[n] == 'd' && n - i <= 4 ? n - i + 1 : 0;
    };
    bool has_percent = false;
    for (std::size_t i = 0; i < m_text.size(); ++i) {
        if (m_text[i] != '%') continue;
        if (i + 1 < m_text.size() && m_text[i + 1] == '%') {
            ++i;
            continue;
        }
        if (percent_place(i) == 0)
            throw UsageError("'" + m_text +
                             "': '%' starts no frame number; write %04d, or %% "
                             "for a percent sign");
        has_percent = true;
    }
    std::string literal;
    const auto place = [&](int digits, bool zeros) {
        if (!literal.empty()) m_pieces.push_back({std::move(literal), -1, true});
        literal.clear();
        m_pieces.push_back({"", digits, zeros});
        ++m_places;
    };
    for (std::size_t i = 0; i < m_text.size(); ++i) {
        const char c = m_text[i], next = i + 1 < m_text.size() ? m_text[i + 1] : '\0';
        if (c == '%' && next == '%') {
            literal += '%';
            ++i;
        } else if (c == '%') {
            const std::size_t length = percent_place(i);
            const std::string digits = m_text.substr(i + 1, length - 2);
            place(digits.empty() ? 0 : std::stoi(digits), !digits.empty() && digits[0] == '0');
            i += length - 1;
        } else if (c == '\\' && next == '#') {
            literal += '#';
            ++i;
        } else if (c == '#' && !has_percent) {
            std::size_t run = 1;
            while (i + run < m_text.size() && m_text[i + run] == '#') ++run;
            place(run == 1 ? 4 : static_cast<int>(run), true);
            i += run - 1;
        } else {
            literal += c;
        }
    }
    if (!literal.empty()) m_pieces.push_back({std::move(literal), -1, true});
}

std::string FramePattern::path(int frame) const
{
    std::string out;
    for (const Piece& piece : m_pieces) {
        if (piece.digits < 0) {
            out += piece.literal;
        } else {
            const std::string digits = std::to_string(std::abs(std::int64_t{frame}));
            const std::string sign = frame < 0 ? "-" : "";
            const std::size_t have = digits.size() + sign.size();
            const auto want = static_cast<std::size_t>(piece.digits);
            const std::string pad(want > have ? want - have : 0, piece.zeros ? '0' : ' ');
            out += piece.zeros ? sign + pad + digits : pad + sign + digits;
        }
    }
    return out;
}

bool is_glob(std::string_view path)
{
    for (std::size_t i = 0; i < path.size(); ++i) {
        if (path[i] == '\\')
            ++i;
        else if (path[i] == '*' || path[i] == '?' || path[i] == '[')
            return true;
    }
    return false;
}

bool natural_less(std::string_view a, std::string_view b)
{
    std::size_t i = 0, j = 0;
    while (i < a.size() && j < b.size()) {
        if (is_digit(a[i]) && is_digit(b[j])) {
            const std::size_t i0 = i, j0 = j;
            while (i < a.size() && is_digit(a[i])) ++i;
            while (j < b.size() && is_digit(b[j])) ++j;
            std::string_view x = a.substr(i0, i - i0), y = b.substr(j0, j - j0);
            x.remove_prefix(std::min(x.find_first_not_of('0'), x.size() - 1));
            y.remove_prefix(std::min(y.find_first_not_of('0'), y.size() - 1));
            if (x.size() != y.size()) return x.size() < y.size();
            if (x != y) return x < y;
        } else {
            if (a[i] != b[j])
                return static_cast<unsigned char>(a[i]) < static_cast<unsigned char>(b[j]);
            ++i;
            ++j;
        }
    }
    if ((a.size() - i) != (b.size() - j)) return a.size() - i < b.size() - j;
    return a < b; // equal but for leading zeros: any fixed order
}

std::vector<std::string> expand_glob(const std::string& pattern)
{
    glob_t found{};
    std::vector<std::string> paths;
    if (::glob(pattern.c_str(), 0, nullptr, &found) == 0)
        paths.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
    ::globfree(&found);
    std::sort(paths.begin(), paths.end(), natural_less);
    return paths;
}

namespace
{
// One piece of `-i`: text up to an unquoted stop character. Escapes are kept where the piece is a
// pattern or glob (they mean the same there) and removed where `unescape` says so.
struct Piece {
    std::string text;
    bool quoted = false;
    std::vector<std::size_t> at_signs; // unescaped '@' in text
};

Piece take_piece(std::string_view& rest, char stop, std::string_view whole)
{
    Piece piece;
    if (!rest.empty() && rest[0] == '"') {
        piece.quoted = true;
        std::size_t i = 1;
        for (; i < rest.size() && rest[i] != '"'; ++i) {
            if (rest[i] == '\\' && i + 1 < rest.size() &&
                (rest[i + 1] == '"' || rest[i + 1] == '\\'))
                ++i;
            piece.text += rest[i];
        }
        if (i >= rest.size())
            throw UsageError("'" + std::string(whole) + "': the double quote is never closed");
        rest.remove_prefix(i + 1);
        return piece;
    }
    std::size_t i = 0;
    for (; i < rest.size() && rest[i] != stop; ++i) {
        if (rest[i] == '\\' && i + 1 < rest.size()) {
            const char next = rest[i + 1];
            if (next == ':' || next == '@' || next == '"') {
                piece.text += next;
                ++i;
                continue;
            }
            piece.text += rest[i];
            piece.text += next; // \\ \# \* stay for the pattern to read
            ++i;
            continue;
        }
        if (rest[i] == '@') piece.at_signs.push_back(piece.text.size());
        piece.text += rest[i];
    }
    rest.remove_prefix(i);
    return piece;
}

bool looks_like_range(std::string_view text)
{
    if (text.empty() || !(is_digit(text[0]) || text[0] == '-' || text[0] == '+')) return false;
    const bool relative = text.find("..") != std::string_view::npos;
    return std::all_of(text.begin(), text.end(), [relative](char c) {
        return is_digit(c) || c == '-' ||
               (relative ? c == '+' || c == '.' : c == ',' || c == 'x' || c == 'y');
    });
}

void take_range(InputSource& source, std::string_view range)
{
    source.relative = parse_relative_frames(range);
    if (!source.relative) source.frames = parse_frame_range(range);
}

std::string take_name(std::string_view& rest, std::string_view option, const char* form)
{
    const std::size_t equals = rest.find('=');
    if (equals == std::string_view::npos || equals == 0)
        throw UsageError(std::string(option) + " '" + std::string(rest) + "': write " + form);
    std::string name(rest.substr(0, equals));
    rest.remove_prefix(equals + 1);
    return name;
}

std::string without_escapes(std::string_view text)
{
    std::string out;
    for (std::size_t i = 0; i < text.size(); ++i) {
        if (text[i] == '\\' && i + 1 < text.size()) ++i;
        out += text[i];
    }
    return out;
}

bool exists(const std::string& path)
{
    std::error_code ignored;
    return std::filesystem::exists(path, ignored);
}
} // namespace

InputSource parse_input_source(std::string_view text)
{
    static constexpr const char* form = "name=path, name=path@1-16 or name=path:layer";
    std::string_view rest = text;
    InputSource source;
    source.name = take_name(rest, "-i", form);
    Piece path = take_piece(rest, ':', text);
    if (path.quoted) {
        source.literal = true;
        if (!rest.empty() && rest[0] == '@') {
            const std::size_t end = std::min(rest.find(':'), rest.size());
            take_range(source, rest.substr(1, end - 1));
            source.literal = false;
            rest.remove_prefix(end);
        }
    } else if (!path.at_signs.empty()) {
        const std::size_t at = path.at_signs.back();
        const std::string range = path.text.substr(at + 1);
        if (looks_like_range(range)) {
            take_range(source, range);
            path.text.resize(at);
        }
    }
    source.path = std::move(path.text);
    if (source.path.empty())
        throw UsageError("-i '" + std::string(text) + "': the path is missing; write " + form);
    if (rest.empty()) return source;
    if (rest[0] != ':')
        throw UsageError("-i '" + std::string(text) + "': '" + std::string(rest) +
                         "' follows the closing quote; write " + form);
    rest.remove_prefix(1);
    const bool quoted_layer = !rest.empty() && rest[0] == '"';
    Piece layer = take_piece(rest, '\0', text);
    if (!rest.empty())
        throw UsageError("-i '" + std::string(text) + "': '" + std::string(rest) +
                         "' follows the closing quote; write " + form);
    source.layer = quoted_layer ? layer.text : without_escapes(layer.text);
    if (source.layer.empty())
        throw UsageError("-i '" + std::string(text) + "': the layer after ':' is missing");
    // "@1-10:5" is a range to other tools.
    if (source.frames && !quoted_layer &&
        std::all_of(source.layer.begin(), source.layer.end(), is_digit))
        throw UsageError("-i '" + std::string(text) +
                         "': ':' in a frame range means every n-th "
                         "frame to some tools and interleaved passes to others; write x" +
                         source.layer + " for every n-th frame, or :\"" + source.layer +
                         "\" for a layer of that name");
    return source;
}

OutputTarget parse_output_target(std::string_view text)
{
    static constexpr const char* form = "name=path or name=path:layer";
    std::string_view rest = text;
    OutputTarget target;
    target.name = take_name(rest, "-o", form);
    const Piece path = take_piece(rest, ':', text);
    target.path = path.text;
    if (target.path.empty())
        throw UsageError("-o '" + std::string(text) + "': the path is missing; write " + form);
    if (rest.empty()) return target;
    const bool colon = rest[0] == ':';
    if (colon) rest.remove_prefix(1);
    const Piece layer = take_piece(rest, '\0', text);
    if (!colon || !rest.empty() || layer.text.empty())
        throw UsageError("-o '" + std::string(text) + "': write " + form);
    target.layer = layer.quoted ? layer.text : without_escapes(layer.text);
    return target;
}

ResolvedFiles resolve_files(const InputSource& source, std::optional<int> current_frame,
                            std::span<const int> all_frames)
{
    if (source.literal) return {{source.path}, false};
    if (source.relative) {
        const FramePattern pattern(source.path);
        if (!pattern.has_frame())
            throw UsageError("'" + source.path +
                             "' has a relative range but no place for a frame number; write %04d "
                             "where it stands");
        if (!current_frame)
            throw UsageError("the frames of '" + source.path +
                             "' are counted from the one --frames is at; add --frames 1-100");
        ResolvedFiles files{{}, true};
        for (int offset = source.relative->first; offset <= source.relative->last; ++offset) {
            const int frame = *current_frame + offset;
            std::string path = pattern.path(frame);
            if (std::find(all_frames.begin(), all_frames.end(), frame) != all_frames.end() ||
                exists(path))
                files.paths.push_back(std::move(path));
        }
        return files;
    }
    if (source.frames) {
        const FramePattern pattern(source.path);
        if (!pattern.has_frame())
            throw UsageError("'" + source.path + "' has frames " +
                             format_frame_range(*source.frames) +
                             " but no place for a frame number; write %04d where it stands");
        ResolvedFiles files{{}, true};
        for (const int frame : *source.frames) files.paths.push_back(pattern.path(frame));
        return files;
    }
    if (exists(source.path)) return {{source.path}, false};
    // A percent sign that starts no frame number may be part of a glob or of a missing file's name.
    std::optional<FramePattern> pattern;
    if (source.path.find_first_of("%#") != std::string::npos) pattern.emplace(source.path);
    std::string path = source.path;
    if (pattern && pattern->has_frame()) {
        if (!current_frame)
            throw UsageError("'" + source.path +
                             "' needs a frame number; add @1-16 to take a stack of files, or "
                             "--frames 1-100 to run the graph over an animation");
        path = pattern->path(*current_frame);
        if (!is_glob(path)) return {{path}, false};
    }
    if (is_glob(path)) {
        ResolvedFiles files{expand_glob(path), true};
        if (files.paths.empty()) throw InputError("no file matches '" + path + "'");
        return files;
    }
    return {{without_escapes(path)}, false};
}

} // namespace rayloom
