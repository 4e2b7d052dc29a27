// SPDX-License-Identifier: Apache-2.0
/// \file
/// Frame ranges, file name patterns, globs, and the command's `-i name=path[@range][:layer]`.
/// docs/images.md is the reference of the syntax.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace rayloom
{

/// Reads a frame range: comma-separated frames and intervals, `1-10`, `1-10x2` (every second),
/// `1-10y3` (all but every third), `10-1` (backwards), negative frames as in `-5--2`. Frames come
/// in the order written; one named twice is kept once, at its first place. Throws UsageError for
/// anything else; a colon is refused with both of its meanings, since tools disagree on them.
std::vector<int> parse_frame_range(std::string_view text);

/// The shortest range text parse_frame_range() reads back as the same frames: "1-10x2,15".
std::string format_frame_range(std::span<const int> frames);

/// Frames counted from the one `--frames` is at, both ends included.
struct RelativeFrames {
    int first = 0, last = 0;
};
/// Reads `-5..+5`: each end has a sign or is 0. Nothing when the text holds no `..`; throws
/// UsageError when it does and is no such range.
std::optional<RelativeFrames> parse_relative_frames(std::string_view text);

/// A file name with a place for the frame number: `%d`, `%4d`, `%04d`, or a run of `#` (one digit
/// each; a lone `#` is four). `%%` and `\#` stand for the characters themselves. Where a `%d` is,
/// `#` is a character like any other. Several places all take the same frame.
class FramePattern
{
public:
    /// Throws UsageError for a `%` that starts nothing known.
    explicit FramePattern(std::string text);
    /// Whether there is a place for a frame number.
    bool has_frame() const { return m_places > 0; }
    /// The name for one frame; without a place, always the same.
    std::string path(int frame) const;
    const std::string& text() const { return m_text; }

private:
    struct Piece {
        std::string literal;
        int digits = -1; ///< −1: literal; 0: no padding
        bool zeros = true;
    };
    std::string m_text;
    std::vector<Piece> m_pieces;
    int m_places = 0;
};

/// Whether a path holds `*`, `?` or `[` (not escaped by a backslash).
bool is_glob(std::string_view path);
/// Files that match, in natural order (`s2` before `s10`). Empty when there is none.
std::vector<std::string> expand_glob(const std::string& pattern);
/// Orders runs of digits by their value and all else by bytes.
bool natural_less(std::string_view a, std::string_view b);

/// Where the pixels of one graph input come from: one `-i` option.
struct InputSource {
    std::string name;                       ///< graph input
    std::string path;                       ///< file, pattern or glob, as written without escapes
    bool literal = false;                   ///< the path was quoted: neither pattern nor glob
    std::optional<std::vector<int>> frames; ///< of `@range`
    std::optional<RelativeFrames> relative; ///< of `@-5..+5`
    std::string layer;                      ///< layer or part; empty: not named
};

/// Splits `name=path[@range][:layer]`. The name ends at the first `=`, the path at the first `:`;
/// a range is what follows the path's last `@` when it begins like a frame (a digit or a sign) and
/// holds no `/` or letter but x and y. A backslash before `:`, `@`, `"`, `\` and `#`
/// takes the character as part of the name; a path or layer in double quotes is taken as it
/// stands. Layers may hold spaces and dots. Throws UsageError.
InputSource parse_input_source(std::string_view text);

/// The `name=path` of an output; `path` may be a pattern. Throws UsageError.
struct OutputTarget {
    std::string name;
    std::string path;
    std::string layer; ///< layer prefix to write under; empty: plain channels
};
OutputTarget parse_output_target(std::string_view text);

/// The files an input source stands for.
struct ResolvedFiles {
    std::vector<std::string> paths;
    bool is_list = false; ///< a glob or a pattern with its own range, even of one file
};

/// Expands a source. A pattern with a range gives one file a frame; one with a relative range the
/// files around `current_frame` (the one `--frames` is at), without those that neither exist nor
/// are among `all_frames`, which are all that `--frames` names; a pattern without range takes
/// `current_frame`; a glob gives every match. A path that names an
/// existing file is that file, whatever characters it holds. Throws UsageError for a pattern
/// without any frame, InputError for a glob that matches nothing.
ResolvedFiles resolve_files(const InputSource& source, std::optional<int> current_frame,
                            std::span<const int> all_frames = {});

} // namespace rayloom
