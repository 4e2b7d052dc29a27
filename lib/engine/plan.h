// SPDX-License-Identifier: Apache-2.0
/// \file
/// From a graph and a request to a list of work items. Every error a user can make comes out here,
/// before any pixel is computed.
#pragma once

#include "rayloom/core/node.h"
#include "rayloom/core/registry.h"
#include "rayloom/engine/request.h"
#include "rayloom/graph/model.h"

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace rayloom
{

class ImageReader;

/// What of a graph an op stands for; messages name it accordingly.
enum class OpRole { node, input, output };

/// "node 'fused' (fuse.histogram)", "input 'color'", "output 'image'".
std::string op_title(OpRole role, const std::string& id, const std::string& op);

/// One use of a node: after mapping over lists, so a node of the file may be several of these.
struct PlannedOp {
    std::string id; ///< name in the graph; "outer/inner" inside a graph used as a node, "fused[1]"
                    ///< when mapped
    std::string op;
    SourcePosition where;
    const NodeInfo* info = nullptr; ///< null for the engine's own (memory sources and the like)
    int version = 1;
    OpRole role = OpRole::node;
    ParamValues params;
    std::unique_ptr<Node> node;
    PlanResult result;
    struct TableInput {
        std::string port;
        int op = -1;
        std::string source_port;
    };
    std::vector<TableInput> table_inputs;
    std::map<std::string, Table, std::less<>> tables; ///< filled while running
    std::optional<std::vector<double>> cached_totals; ///< the reduction's result, from the cache
    std::string key; ///< hash of node, version, parameters and inputs
    bool needed = false;
    bool finished = false; ///< finish() was called

    std::string title() const { return op_title(role, id, op); }
};

/// One image, flat or deep, that flows: an output of an op, one element of it.
struct Stream {
    PortKind kind = PortKind::image;
    ImageDesc desc;
    std::size_t row_samples = 0;           ///< deep: samples of its fullest row, as far as known
    int item = -1;                         ///< work item that makes it
    int output = 0;                        ///< which of the item's outputs
    std::vector<std::string> channel_keys; ///< content hash per channel
    /// Where each channel was copied from bit for bit (itself when nowhere).
    struct Origin {
        int stream = -1;
        int channel = 0;
    };
    std::vector<Origin> origins;

    std::string key() const;
};

/// What the engine runs: one element of one op.
struct WorkItem {
    struct Input {
        std::string port;
        PortKind kind = PortKind::image;
        std::vector<int> streams;
    };
    struct Output {
        std::string port;
        int stream = -1;
        bool wanted = false;
    };
    int op = -1;
    std::size_t element = 0;
    Region window; ///< data window of its outputs (the domain, for a sink)
    std::vector<Input> inputs;
    std::vector<Output> outputs;
    bool needed = false;
    bool deep = false;    ///< its only output is deep: rows are made whole
    bool inlined = false; ///< evaluated inside its only consumer's tiles
    /// Stream of a file reader whose rows are read straight into this item's rows, which compute()
    /// then works on in place; −1: none.
    int in_place = -1;
    /// Items with the same number make rows out of the same part of the same file; −1: no file.
    int file = -1;
    /// Pixels of the caller that are read where they are; the item has no rows of its own.
    std::optional<ConstImageView> lent;
    std::shared_ptr<const Node> source; ///< stands in for the op: its result, read from the cache
};

/// A requested output.
struct PlannedOutput {
    std::string name;
    int sink_item = -1; ///< −1 for a table
    int table_op = -1;
    std::string table_port;
    OutputBinding binding;
    bool in_memory = false;
    bool deep = false;
};

/// A node that will not run, and why.
struct PrunedNode {
    std::string id;
    std::string reason;
    double saved_seconds = -1.0; ///< −1: not known
};

struct Plan {
    std::string graph_name;
    std::vector<PlannedOp> ops;
    std::vector<WorkItem> items; ///< in an order in which producers come first
    std::vector<Stream> streams;
    std::vector<PlannedOutput> outputs;
    struct RowAccess {
        Access access = Access::tiles;
        int alignment = 1; ///< Access::rows: see PlanResult::row_alignment
        bool whole_rows = false;
    };
    /// How the item's rows are made.
    RowAccess access_of(const WorkItem& item) const;
    /// What reads the item's rows from a file, or those it works on in place; null when none does.
    const ImageReader* file_reader(const WorkItem& item) const;

    /// Image inputs by op and port; reductions read them without a work item of their own.
    std::map<int, std::map<std::string, std::vector<int>, std::less<>>> op_inputs;
    std::vector<PrunedNode> pruned;
    std::vector<std::string> notes;
    std::vector<std::string>
        channel_plan; ///< a line per input layer: filtered, guide, passed through
    bool skip = true;
};

/// Plans a graph. Throws GraphError (all problems at once), InputError when a file is at fault,
/// UsageError when the request names what the graph does not have.
Plan make_plan(const Graph& graph, const RunRequest& request, const RunOptions& options = {});

} // namespace rayloom
