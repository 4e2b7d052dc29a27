// SPDX-License-Identifier: Apache-2.0
/// \file
/// Declaring nodes and finding them by name.
///
///     class Gain final : public Node {
///     public:
///         struct Params { float factor = 1.0f; };
///         static void describe(Declaration<Params>& d);   // ports, parameters, prose
///         explicit Gain(const Params& p) : m(p) {}
///         void plan(PlanContext&) override;
///         void compute(const TileContext&) const override;
///     private:
///         Params m;
///     };
///     RAYLOOM_NODE(Gain);
#pragma once

#include "rayloom/core/node.h"

#include <concepts>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace rayloom
{

/// Values of a node's parameters by name, checked and of the declared types.
using ParamValues = std::map<std::string, ParamValue, std::less<>>;

/// All that is known of a kind of node.
struct NodeInfo {
    std::string name;     ///< "stage.what", the name graph files use
    int version = 1;      ///< raised when the same input and parameters give other pixels
    std::string summary;  ///< one sentence
    std::string doc;      ///< paragraphs for the reference page
    std::string source;   ///< paper file and equations
    std::string accuracy; ///< error of the fast path against the plain double one
    std::vector<PortInfo> inputs, outputs;
    std::vector<ParamInfo> params;
    std::string example; ///< a minimal graph file that uses the node
    std::string origin;  ///< "built in", or the plug-in's file
    std::function<std::unique_ptr<Node>(const ParamValues&)> create;

    const ParamInfo* param(std::string_view param_name) const;
    const PortInfo* input(std::string_view port) const;
    const PortInfo* output(std::string_view port) const;
};

/// Returned by Declaration::input() and output(), to say more about a port.
class PortBuilder
{
public:
    explicit PortBuilder(PortInfo& info) : m_info(&info) {}
    PortBuilder& list()
    {
        m_info->kind = PortKind::list;
        return *this;
    }
    PortBuilder& deep()
    {
        m_info->kind = PortKind::deep;
        return *this;
    }
    PortBuilder& table()
    {
        m_info->kind = PortKind::table;
        return *this;
    }
    PortBuilder& optional()
    {
        m_info->required = false;
        return *this;
    }

private:
    PortInfo* m_info;
};

/// Returned by Declaration::param(), to say more about a parameter.
class ParamBuilder
{
public:
    explicit ParamBuilder(ParamInfo& info) : m_info(&info) {}
    ParamBuilder& min(double v)
    {
        m_info->min = v;
        return *this;
    }
    ParamBuilder& max(double v)
    {
        m_info->max = v;
        return *this;
    }
    ParamBuilder& range(double lo, double hi) { return min(lo).max(hi); }
    ParamBuilder& unit(std::string u)
    {
        m_info->unit = std::move(u);
        return *this;
    }
    ParamBuilder& source(std::string s)
    {
        m_info->source = std::move(s);
        return *this;
    }
    ParamBuilder& required()
    {
        m_info->required = true;
        return *this;
    }
    /// A text parameter names a file, or a list of texts several: where a graph file says which,
    /// the node sees the path from the graph file's folder. An empty path stays empty.
    ParamBuilder& path()
    {
        m_info->type = m_info->type == ParamType::texts ? ParamType::paths : ParamType::path;
        return *this;
    }
    /// Allowed texts of a text parameter.
    ParamBuilder& choices(std::vector<std::string> c)
    {
        m_info->choices = std::move(c);
        m_info->type = ParamType::choice;
        return *this;
    }

private:
    ParamInfo* m_info;
};

namespace detail
{
template <class T>
struct ParamTraits {
    static_assert(sizeof(T) == 0, "a parameter is bool, int, float, double, std::string, or a "
                                  "std::vector of float, double or std::string");
};
template <>
struct ParamTraits<bool> {
    static constexpr ParamType type = ParamType::boolean;
    static ParamValue to(bool v) { return v; }
    static bool from(const ParamValue& v) { return std::get<bool>(v); }
};
template <>
struct ParamTraits<int> {
    static constexpr ParamType type = ParamType::integer;
    static ParamValue to(int v) { return std::int64_t{v}; }
    static int from(const ParamValue& v) { return static_cast<int>(std::get<std::int64_t>(v)); }
};
template <std::floating_point T>
struct ParamTraits<T> {
    static constexpr ParamType type = ParamType::real;
    static ParamValue to(T v) { return static_cast<double>(v); }
    static T from(const ParamValue& v) { return static_cast<T>(std::get<double>(v)); }
};
template <>
struct ParamTraits<std::string> {
    static constexpr ParamType type = ParamType::text;
    static ParamValue to(const std::string& v) { return v; }
    static std::string from(const ParamValue& v) { return std::get<std::string>(v); }
};
template <std::floating_point T>
struct ParamTraits<std::vector<T>> {
    static constexpr ParamType type = ParamType::reals;
    static ParamValue to(const std::vector<T>& v)
    {
        return std::vector<double>(v.begin(), v.end());
    }
    static std::vector<T> from(const ParamValue& v)
    {
        std::vector<T> out;
        for (double d : std::get<std::vector<double>>(v)) out.push_back(static_cast<T>(d));
        return out;
    }
};
template <>
struct ParamTraits<std::vector<std::string>> {
    static constexpr ParamType type = ParamType::texts;
    static ParamValue to(const std::vector<std::string>& v) { return v; }
    static std::vector<std::string> from(const ParamValue& v)
    {
        return std::get<std::vector<std::string>>(v);
    }
};
} // namespace detail

/// Filled in by a node's describe().
template <class P>
class Declaration
{
public:
    Declaration& name(std::string n)
    {
        info.name = std::move(n);
        return *this;
    }
    Declaration& version(int v)
    {
        info.version = v;
        return *this;
    }
    Declaration& summary(std::string s)
    {
        info.summary = std::move(s);
        return *this;
    }
    Declaration& doc(std::string s)
    {
        info.doc = std::move(s);
        return *this;
    }
    Declaration& source(std::string s)
    {
        info.source = std::move(s);
        return *this;
    }
    Declaration& accuracy(std::string s)
    {
        info.accuracy = std::move(s);
        return *this;
    }
    Declaration& example(std::string s)
    {
        info.example = std::move(s);
        return *this;
    }
    PortBuilder input(std::string port, std::string doc)
    {
        info.inputs.push_back({std::move(port), PortKind::image, true, std::move(doc)});
        return PortBuilder(info.inputs.back());
    }
    PortBuilder output(std::string port, std::string doc)
    {
        info.outputs.push_back({std::move(port), PortKind::image, true, std::move(doc)});
        return PortBuilder(info.outputs.back());
    }
    /// Declares a field of the parameter struct; its default is the field's initialiser.
    template <class T>
    ParamBuilder param(std::string param_name, T P::*field, std::string doc)
    {
        using Traits = detail::ParamTraits<T>;
        ParamInfo p;
        p.name = param_name;
        p.type = Traits::type;
        p.default_value = Traits::to(P{}.*field);
        p.doc = std::move(doc);
        if constexpr (std::is_same_v<T, int>) {
            p.min = std::numeric_limits<int>::min();
            p.max = std::numeric_limits<int>::max();
        }
        info.params.push_back(std::move(p));
        setters[std::move(param_name)] = [field](P& params, const ParamValue& v) {
            params.*field = Traits::from(v);
        };
        return ParamBuilder(info.params.back());
    }

    NodeInfo info;
    std::map<std::string, std::function<void(P&, const ParamValue&)>, std::less<>> setters;
};

/// Every kind of node in the process: the built-in ones and those of loaded plug-ins.
class Registry
{
public:
    static Registry& instance();

    /// Throws Error when the name is taken; within load_plugins() that error is kept until the
    /// plug-in's static initialisers are done, as nothing may be thrown through them.
    void add(NodeInfo info);
    /// The same for what `describe` returns; whatever that throws is treated as a name that is
    /// taken.
    void add(NodeInfo (*describe)());
    const NodeInfo* find(std::string_view name) const;
    /// Sorted by name.
    std::vector<const NodeInfo*> all() const;
    std::vector<std::string> names() const;

    /// Loads every shared library in a list of folders separated by ':' (as in $RAYLOOM_PLUGINS).
    /// Throws InputError that names the file when one cannot be loaded.
    void load_plugins(const std::string& folders);

private:
    std::map<std::string, NodeInfo, std::less<>> m_nodes;
    std::string m_origin = "built in";
    bool m_loading = false;
    std::string m_refusal; ///< what add() has to say against the plug-in being loaded
};

/// NodeInfo of a node class; registering it is up to the caller (tests of the contract use this).
template <class N>
NodeInfo node_info()
{
    using P = typename N::Params;
    Declaration<P> d;
    N::describe(d);
    d.info.create = [setters = d.setters](const ParamValues& values) -> std::unique_ptr<Node> {
        P params;
        for (const auto& [key, value] : values)
            if (const auto it = setters.find(key); it != setters.end()) it->second(params, value);
        return std::make_unique<N>(params);
    };
    return std::move(d.info);
}

/// Registers a node class when its file is loaded.
#define RAYLOOM_NODE(NodeClass)                                                                    \
    namespace                                                                                      \
    {                                                                                              \
    [[maybe_unused]] const bool registered_##NodeClass =                                           \
        (::rayloom::Registry::instance().add(&::rayloom::node_info<NodeClass>), true);             \
    }                                                                                              \
    static_assert(true, "asks for a semicolon")

} // namespace rayloom
