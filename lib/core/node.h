// SPDX-License-Identifier: Apache-2.0
/// \file
/// The node contract. A node is a class with a declaration (describe()), a plan() that sees no
/// pixel, and a compute() that fills one region of its outputs. docs/writing-a-node.md walks
/// through one.
#pragma once

#include "rayloom/core/error.h"
#include "rayloom/core/param.h"
#include "rayloom/core/table.h"
#include "rayloom/image/deep.h"
#include "rayloom/image/image_desc.h"
#include "rayloom/image/view.h"

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace rayloom
{

/// What travels along a connection.
enum class PortKind {
    image, ///< one image
    list,  ///< a list of images: frames, pyramid levels, lobes
    deep,  ///< one deep image
    table, ///< figures (see Table), known only once the whole image was seen
};

/// Declaration of one input or output.
struct PortInfo {
    std::string name;
    PortKind kind = PortKind::image;
    bool required = true;
    std::string doc;
};

/// How the engine calls compute().
enum class Access {
    tiles, ///< any region, from any thread
    rows,  ///< full-width row bands, one call at a time, top to bottom (readers and writers)
    whole, ///< once, for the whole data window (for methods that are global by nature)
};

/// Asked by the engine: to fill `region` of output element `output_element`, which part of input
/// element `input_element` must be there?
struct Need {
    std::size_t input_element = 0;
    std::size_t output_element = 0;
    Region region;
};
/// May answer more than exists; the engine clips to the input's data window.
using NeedFunction = std::function<Region(const Need&)>;

/// A reduction over a whole image: `values` numbers summed over every row of `domain`.
struct Reduction {
    Region domain;
    std::size_t values = 0;
    int block_rows = 1; ///< rows per reduce() call; blocks start at domain.y0
};

/// One input as the planner knows it.
struct PlannedInput {
    bool connected = false;
    PortKind kind = PortKind::image;
    std::vector<ImageDesc> images; ///< one for image and deep, n for a list, none for a table
    /// Whether an element is zero everywhere, found by reading it. Empty: not to be known.
    std::function<bool(std::size_t)> black;
};

/// What plan() decided; read by the engine.
struct PlanResult {
    struct Alias {
        std::string output;
        std::size_t output_element = 0;
        std::string input;
        std::size_t input_element = 0;
    };
    struct Constant {
        std::string output;
        std::size_t element = 0;
        float value = 0.0f;
    };
    struct ChannelAlias {
        std::string output;
        std::size_t output_element = 0;
        int output_channel = 0;
        std::string input;
        std::size_t input_element = 0;
        int input_channel = 0;
    };
    std::map<std::string, std::vector<ImageDesc>, std::less<>> outputs;
    std::map<std::string, NeedFunction, std::less<>> needs;        ///< absent: the same region
    std::map<std::string, NeedFunction, std::less<>> reduce_needs; ///< inputs reduce() reads
    std::vector<Alias> aliases;
    std::vector<Constant> constants;
    std::vector<ChannelAlias> channel_aliases;
    std::optional<Reduction> reduction;
    std::optional<Region> sink;
    Access access = Access::tiles;
    int row_alignment = 1; ///< Access::rows: bands start and end on multiples of this below data.y0
    bool pointwise = true; ///< no need function was given
    bool cheap = false;
    std::string in_place; ///< input whose memory the output may share; empty: none
    std::size_t scratch_bytes = 0;
    std::vector<std::string> notes;
};

/// What a node's plan() sees and says. No pixel is touched: every error a user can make is found
/// here, as a NodeError.
class PlanContext
{
public:
    PlanContext(std::map<std::string, PlannedInput, std::less<>> inputs)
        : m_inputs(std::move(inputs))
    {
    }

    /// Whether an optional input is connected.
    bool has(std::string_view port) const;
    /// Elements of a list input (1 for an image); 0 when not connected.
    std::size_t count(std::string_view port) const;
    /// The image at an input. Precondition: connected.
    const ImageDesc& input(std::string_view port, std::size_t element = 0) const;
    /// Whether every channel of the image is known to be zero everywhere. Asking has a file read.
    bool black(std::string_view port, std::size_t element = 0) const;

    /// Declares an output image. Unless a need is given the node reads, of each input, the same
    /// region it writes.
    void output(std::string_view port, ImageDesc desc);
    /// Declares a list output; its elements are computed independently of one another
    /// (TileContext::element()). All outputs of a node have the same number of elements and, per
    /// element, the same data window.
    void output_list(std::string_view port, std::vector<ImageDesc> descs);

    /// The input is read `halo` pixels beyond the written region.
    void needs(std::string_view port, const Halo& halo);
    void needs(std::string_view port, NeedFunction function);
    /// All of the input is read whatever the region.
    void needs_all(std::string_view port);

    /// The output is the input, untouched: nothing is computed, and its content hash is the
    /// input's.
    void pass_through(std::string_view output, std::string_view input,
                      std::size_t output_element = 0, std::size_t input_element = 0);
    /// One channel of the output is one channel of the input, bit for bit. compute() copies it;
    /// this tells the engine, so that what depends on that channel alone stays in the cache.
    void pass_channel(std::string_view output, int output_channel, std::string_view input,
                      int input_channel, std::size_t output_element = 0,
                      std::size_t input_element = 0);
    /// The output has one value everywhere.
    void constant(std::string_view output, float value, std::size_t element = 0);

    /// Asks for reduce() over every row of `domain`, `values` doubles, before any compute(). A node
    /// whose rows share work (a window) may ask for blocks of rows; the blocks are the same however
    /// the engine cuts the image, so the sums are too.
    void reduce(const Region& domain, std::size_t values, int block_rows = 1);
    /// The reduction reads this input, `halo` beyond its row. Inputs not named are not read.
    void reduce_needs(std::string_view port, const Halo& halo = {});
    void reduce_needs(std::string_view port, NeedFunction function);

    void access(Access access, int row_alignment = 1);
    /// The node has no output; compute() is called with the rows of `domain` in order, then
    /// commit().
    void sink(const Region& domain);
    /// compute() may find `port` and the node's only output in the same memory: it reads each pixel
    /// before it writes it, and no other pixel. Saves a copy of what was just read from a file. The
    /// port must have no need function, and the output its window and channels.
    void in_place(std::string_view port) { m_result.in_place = port; }
    /// So cheap that storing its result in the cache costs more than making it again.
    void cheap() { m_result.cheap = true; }
    /// Memory compute() allocates for one call, for the memory budget.
    void scratch(std::size_t bytes) { m_result.scratch_bytes = bytes; }
    /// A line for the user's report ("albedo missing: the beauty guides itself").
    void note(std::string text) { m_result.notes.push_back(std::move(text)); }

    /// Indices of named channels of an input. Throws NodeError that lists what there is.
    std::vector<int> require_channels(std::string_view port, std::span<const std::string> names,
                                      std::size_t element = 0) const;
    /// Throws NodeError unless both inputs have the same data window.
    void require_same_window(std::string_view a, std::string_view b, std::size_t a_element = 0,
                             std::size_t b_element = 0) const;

    const PlanResult& result() const { return m_result; }

private:
    const PlannedInput& find(std::string_view port) const;

    std::map<std::string, PlannedInput, std::less<>> m_inputs;
    PlanResult m_result;
};

/// Run-time services of one compute() or reduce() call; implemented by the engine.
class RunServices
{
public:
    virtual ~RunServices() = default;
    virtual bool cancelled() const noexcept = 0;
    virtual bool may_skip() const noexcept = 0;
    virtual void count_skip(std::string_view reason, std::size_t pixels) = 0;
    virtual void count(std::string_view what, std::size_t n) = 0;
};

/// Pixels of one region. Input views cover at least what plan() said is needed, clipped to the
/// input's data window; they may cover more.
class TileContext
{
public:
    struct Input {
        std::string_view port;
        std::span<const ConstImageView> images;
        std::span<const DeepView> deep;
        const Table* table = nullptr;
    };
    struct Output {
        std::string_view port;
        ImageView view;
    };
    TileContext(const Region& region, std::size_t element, std::span<const Input> inputs,
                std::span<const Output> outputs, RunServices& services)
        : m_region(region), m_element(element), m_inputs(inputs), m_outputs(outputs),
          m_services(&services)
    {
    }

    /// The region to fill (for a reduction: one full row of the domain).
    const Region& region() const { return m_region; }
    /// Which element of the output list is asked for.
    std::size_t element() const { return m_element; }
    bool has(std::string_view port) const;
    std::size_t count(std::string_view port) const;
    ConstImageView input(std::string_view port, std::size_t element = 0) const;
    DeepView deep(std::string_view port) const;
    const Table& table(std::string_view port) const;
    /// Whether somebody reads this output; one nobody reads need not be filled.
    bool wants(std::string_view port) const;
    /// The pixels to fill; region() is exactly the view's region.
    ImageView output(std::string_view port) const;

    /// False under --no-skip: shortcuts must then not be taken (pixels are the same either way).
    bool may_skip() const { return m_services->may_skip(); }
    /// Reports a shortcut taken over `pixels` pixels; shown by --stats.
    void count_skip(std::string_view reason, std::size_t pixels) const
    {
        m_services->count_skip(reason, pixels);
    }
    /// Adds to a named counter of this node in the report ("repaired NaN pixels").
    void count(std::string_view what, std::size_t n) const { m_services->count(what, n); }
    /// Throws Cancelled when the run was stopped. Call once per row in slow loops.
    void check_cancelled() const
    {
        if (m_services->cancelled()) throw Cancelled();
    }

private:
    const Input* find(std::string_view port) const;

    Region m_region;
    std::size_t m_element = 0;
    std::span<const Input> m_inputs;
    std::span<const Output> m_outputs;
    RunServices* m_services;
};

/// Base of every node. One object is made per planned use of the node, so plan() may keep what
/// compute() needs (kernels, tables) in members; after plan() and finish() it is not changed again.
class Node
{
public:
    virtual ~Node() = default;
    virtual void plan(PlanContext& context) = 0;
    /// Fills context.region(). Same inputs and parameters, same bits, whatever the region's size,
    /// the thread or the SIMD target. Empty in a node whose outputs are all tables.
    virtual void compute(const TileContext& context) const = 0;

    /// Adds what one row (or block of rows) of the domain contributes to `sums` (zeros on entry).
    virtual void reduce(const TileContext& rows, std::span<double> sums) const;
    /// Combines partial results, in a fixed tree order over rows. Both are what reduce() made of
    /// some rows, never untouched zeros: a minimum may be kept as it is. Adds by default.
    virtual void combine(std::span<double> into, std::span<const double> other) const;
    /// Sees the totals, before any compute(); returns the tables of its table outputs by port.
    virtual std::map<std::string, Table, std::less<>>
    finish(std::span<const double> totals, std::span<const TileContext::Input> tables);

    /// Sinks: everything was written; make it final. Called once, after the last compute().
    virtual void commit() {}
    /// Sinks: the run failed or was cancelled; leave nothing behind.
    virtual void abandon() noexcept {}
    /// Sources: a hash of the content behind this node beyond its parameters (file bytes); empty
    /// when the parameters say it all. `thorough` asks for the bytes, else size and time may do.
    virtual std::string content_key(bool thorough) const;
    /// Sources with a deep output: one row of it, called top to bottom, one call at a time.
    virtual DeepRow read_deep_row(int y) const;
};

} // namespace rayloom
