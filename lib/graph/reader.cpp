// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/reader.h"

#include "rayloom/graph/graph_reader.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <tuple>

namespace rayloom
{

namespace fs = std::filesystem;

namespace reading
{

std::string read_text(const std::string& path)
{
    std::error_code error;
    if (fs::is_directory(path, error))
        throw InputError("'" + path + "' is a folder, not a graph file");
    std::ifstream file(path, std::ios::binary);
    if (!file) throw InputError("cannot read graph '" + path + "': " + std::strerror(errno));
    // One byte more than allowed at most; the parser then says so.
    std::string text(yaml::max_bytes + 1, '\0');
    file.read(text.data(), static_cast<std::streamsize>(text.size()));
    if (file.bad()) throw InputError("cannot read graph '" + path + "': " + std::strerror(errno));
    text.resize(static_cast<std::size_t>(file.gcount()));
    return text;
}

Graph read_tree(const std::string& text, const std::string& name, const std::string& folder,
                ReadState& state, const Ops& ops)
{
    Graph graph;
    graph.file = name;
    graph.folder = folder.empty() ? "." : folder;
    graph.text = text;
    if (const yaml::ValuePtr root = yaml::parse(text, name, state.problems))
        GraphReader(graph, state, ops).read(*root);
    return graph;
}

std::string path_from(const std::string& folder, const std::string& written)
{
    const fs::path path(written);
    if (written.empty() || path.is_absolute() || folder.empty() || folder == ".") return written;
    return (fs::path(folder) / path).string();
}

} // namespace reading

namespace
{

using reading::ReadState;

constexpr std::size_t max_problems = 200;

/// Throws when there are problems: in the order of the files, then of lines, each once.
void throw_problems(std::vector<Problem>& problems)
{
    if (problems.empty()) return;
    std::vector<std::string> files;
    for (const Problem& p : problems)
        if (std::find(files.begin(), files.end(), p.where.file) == files.end())
            files.push_back(p.where.file);
    const auto place = [&](const Problem& p) {
        const auto file = std::find(files.begin(), files.end(), p.where.file) - files.begin();
        return std::tuple(file, p.where.line, p.where.column);
    };
    std::stable_sort(problems.begin(), problems.end(),
                     [&](const Problem& a, const Problem& b) { return place(a) < place(b); });
    std::vector<Problem> out;
    for (Problem& p : problems)
        if (std::none_of(out.begin(), out.end(), [&](const Problem& q) {
                return q.where == p.where && q.message == p.message;
            }))
            out.push_back(std::move(p));
    if (out.size() > max_problems) {
        const std::size_t more = out.size() - max_problems;
        out.resize(max_problems);
        const SourcePosition whole_file{out.front().where.file, 0, 0};
        out.push_back({whole_file, "and " + std::to_string(more) + " more problems"});
    }
    throw GraphError(std::move(out));
}

} // namespace

NodeInfo graph_signature(const Graph& graph)
{
    NodeInfo info;
    info.name = graph.name;
    info.doc = graph.doc;
    for (const GraphInput& input : graph.inputs)
        info.inputs.push_back({input.name, input.kind, input.required, input.doc});
    for (const GraphOutput& output : graph.outputs)
        info.outputs.push_back(
            {output.name, output.kind.value_or(PortKind::image), true, output.doc});
    for (const GraphParam& param : graph.params) info.params.push_back(param.info);
    return info;
}

Graph read_graph(const std::string& path)
{
    ReadState state;
    const std::string text = reading::read_text(path);
    std::error_code error;
    state.open.emplace_back(fs::weakly_canonical(path, error).string(), path);
    Graph graph = reading::read_tree(text, path, fs::path(path).parent_path().string(), state);
    throw_problems(state.problems);
    return graph;
}

std::string op_from(const std::string& folder, const std::string& op)
{
    if (!op.starts_with(graph_prefix)) return op;
    const std::string file = op.substr(graph_prefix.size());
    if (file.empty()) return op;
    const std::string path = locate_graph(file, folder).value_or(reading::path_from(folder, file));
    std::error_code error;
    const fs::path absolute = fs::absolute(path, error);
    return std::string(graph_prefix) + (error ? path : absolute.lexically_normal().string());
}

Graph graph_with_ops(const Graph& graph, const std::map<std::string, std::string, std::less<>>& ops)
{
    ReadState state;
    std::error_code error;
    if (fs::exists(graph.file, error))
        state.open.emplace_back(fs::weakly_canonical(graph.file, error).string(), graph.file);
    Graph bound = reading::read_tree(graph.text, graph.file, graph.folder, state, ops);
    throw_problems(state.problems);
    return bound;
}

Graph parse_graph(const std::string& text, const std::string& name, const std::string& folder)
{
    ReadState state;
    Graph graph = reading::read_tree(text, name, folder, state);
    throw_problems(state.problems);
    return graph;
}

} // namespace rayloom
