// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/yaml.h"

#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/exceptions.h>
#include <yaml-cpp/parser.h>

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <map>
#include <optional>
#include <sstream>
#include <unordered_map>
#include <unordered_set>

namespace rayloom::yaml
{

const Entry* Value::find(std::string_view key) const
{
    for (const Entry& entry : entries)
        if (entry.key == key) return &entry;
    return nullptr;
}

std::string Value::describe() const
{
    switch (kind) {
    case Kind::null: return "empty";
    case Kind::sequence: return "a list";
    case Kind::mapping: return "a mapping";
    case Kind::scalar: break;
    }
    constexpr std::size_t shown = 60;
    return "'" + (text.size() > shown ? text.substr(0, shown) + "…" : text) + "'";
}

namespace
{

/// Stops the parser when a limit is exceeded.
struct LimitExceeded {
    Problem problem;
};

/// Builds the tree from the parser's events. yaml-cpp's own tree keeps one of two equal keys
/// without a word and expands nothing of `<<`; the events show both.
class TreeBuilder final : public YAML::EventHandler
{
public:
    TreeBuilder(std::string file, std::vector<Problem>& problems)
        : m_file(std::move(file)), m_problems(problems)
    {
    }

    ValuePtr root() const { return m_root; }

    void OnDocumentStart(const YAML::Mark& mark) override { m_document = position(mark); }
    const SourcePosition& document_start() const { return m_document; }
    void OnDocumentEnd() override {}

    void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override
    {
        auto value = std::make_shared<Value>();
        value->where = position(mark);
        finish(std::move(value), anchor);
    }

    void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override
    {
        const auto it = m_anchors.find(anchor);
        if (it == m_anchors.end())
            throw LimitExceeded{
                {position(mark), "this alias stands inside the value it refers to"}};
        add(it->second, position(mark));
    }

    void OnScalar(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                  const std::string& text) override
    {
        auto value = std::make_shared<Value>();
        value->kind = Value::Kind::scalar;
        value->where = position(mark);
        value->text = text;
        value->quoted = tag == "!" || tag == "tag:yaml.org,2002:str";
        check_tag(tag, value->where);
        finish(std::move(value), anchor);
    }

    void OnSequenceStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                         YAML::EmitterStyle::value) override
    {
        open(Value::Kind::sequence, mark, tag, anchor);
    }
    void OnSequenceEnd() override { close(); }

    void OnMapStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                    YAML::EmitterStyle::value) override
    {
        open(Value::Kind::mapping, mark, tag, anchor);
    }
    void OnMapEnd() override { close(); }

private:
    struct Open {
        std::shared_ptr<Value> value;
        YAML::anchor_t anchor = YAML::NullAnchor;
        ValuePtr key; ///< read, its value not yet
        SourcePosition key_where;
        std::unordered_map<std::string, int> lines; ///< of the keys so far
        std::vector<Entry> merged;                  ///< of `<<`, in order of precedence
        bool has_merge = false;
    };

    SourcePosition position(const YAML::Mark& mark) const
    {
        return {m_file, mark.line + 1, mark.column + 1};
    }

    void check_tag(const std::string& tag, const SourcePosition& where)
    {
        if (tag.empty() || tag == "?" || tag == "!" || tag.starts_with("tag:yaml.org,2002:"))
            return;
        m_problems.push_back({where, "graph files have no tags; remove '" + tag + "'"});
    }

    void open(Value::Kind kind, const YAML::Mark& mark, const std::string& tag,
              YAML::anchor_t anchor)
    {
        if (static_cast<int>(m_open.size()) >= max_depth)
            throw LimitExceeded{
                {position(mark), "nested more than " + std::to_string(max_depth) + " levels deep"}};
        Open level;
        level.value = std::make_shared<Value>();
        level.value->kind = kind;
        level.value->where = position(mark);
        level.anchor = anchor;
        check_tag(tag, level.value->where);
        m_open.push_back(std::move(level));
    }

    void close()
    {
        Open level = std::move(m_open.back());
        m_open.pop_back();
        for (Entry& entry : level.merged)
            if (!level.lines.contains(entry.key)) level.value->entries.push_back(std::move(entry));
        finish(std::move(level.value), level.anchor);
    }

    void finish(std::shared_ptr<Value> value, YAML::anchor_t anchor)
    {
        const SourcePosition where = value->where;
        if (anchor != YAML::NullAnchor) m_anchors[anchor] = value;
        add(std::move(value), where);
    }

    /// Puts a complete value where it belongs: document, list, key or value.
    void add(ValuePtr value, const SourcePosition& where)
    {
        if (m_open.empty()) {
            m_root = std::move(value);
            return;
        }
        Open& level = m_open.back();
        level.value->expanded += value->expanded;
        if (level.value->expanded > max_values)
            throw LimitExceeded{{where, "more than " + std::to_string(max_values) +
                                            " values once aliases are expanded"}};
        if (level.value->is_sequence()) {
            level.value->items.push_back(std::move(value));
        } else if (!level.key) {
            level.key = std::move(value);
            level.key_where = where;
        } else {
            const ValuePtr key = std::move(level.key);
            level.key = nullptr;
            add_entry(level, *key, std::move(value));
        }
    }

    void add_entry(Open& level, const Value& key, ValuePtr value)
    {
        if (!key.is_scalar()) {
            m_problems.push_back(
                {level.key_where, "a key must be a word, this is " + key.describe()});
            return;
        }
        if (key.text == "<<" && !key.quoted) {
            merge(level, *value);
            return;
        }
        const auto [first, added] = level.lines.emplace(key.text, level.key_where.line);
        if (!added) {
            m_problems.push_back({level.key_where, "'" + key.text +
                                                       "' is given twice, first on line " +
                                                       std::to_string(first->second)});
            return;
        }
        // The parser marks an empty value where the next thing begins.
        if (value->is_null()) {
            auto here = std::make_shared<Value>(*value);
            here->where = level.key_where;
            value = std::move(here);
        }
        level.value->entries.push_back({key.text, level.key_where, std::move(value)});
    }

    void merge(Open& level, const Value& value)
    {
        if (level.has_merge) {
            m_problems.push_back({level.key_where, "'<<' is given twice; list the mappings: "
                                                   "'<<: [*a, *b]'"});
            return;
        }
        level.has_merge = true;
        std::unordered_set<std::string> merged;
        const auto take = [&](const Value& source) {
            if (!source.is_mapping()) {
                m_problems.push_back(
                    {level.key_where,
                     "'<<' takes a mapping or a list of mappings, this is " + source.describe()});
                return;
            }
            for (const Entry& entry : source.entries)
                if (merged.insert(entry.key).second) level.merged.push_back(entry);
        };
        if (value.is_sequence())
            for (const ValuePtr& item : value.items) take(*item);
        else
            take(value);
    }

    std::string m_file;
    std::vector<Problem>& m_problems;
    SourcePosition m_document;
    ValuePtr m_root;
    std::vector<Open> m_open;
    std::map<YAML::anchor_t, ValuePtr> m_anchors;
};

/// Offset of the first byte that no text has; npos when the text is well-formed UTF-8 without
/// control characters.
std::size_t first_binary_byte(std::string_view text)
{
    for (std::size_t i = 0; i < text.size();) {
        const auto byte = static_cast<unsigned char>(text[i]);
        std::size_t length = 0;
        if (byte < 0x80)
            length = byte >= 0x20 || byte == '\t' || byte == '\n' || byte == '\r' ? 1 : 0;
        else if (byte >= 0xc2 && byte < 0xe0)
            length = 2;
        else if (byte >= 0xe0 && byte < 0xf0)
            length = 3;
        else if (byte >= 0xf0 && byte < 0xf5)
            length = 4;
        if (length == 0 || i + length > text.size()) return i;
        for (std::size_t k = 1; k < length; ++k)
            if ((static_cast<unsigned char>(text[i + k]) & 0xc0) != 0x80) return i;
        i += length;
    }
    return std::string_view::npos;
}

bool is_reference_char(char c)
{
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '-' || c == '.';
}

/// `levels[1]` when the line has an index between braces, where brackets mean lists.
std::string index_in_braces(const std::string& line)
{
    const std::size_t open = line.find('{');
    if (open == std::string::npos) return "";
    for (std::size_t i = line.find('[', open); i != std::string::npos; i = line.find('[', i + 1)) {
        const std::size_t end = line.find_first_not_of("0123456789", i + 1);
        if (end == std::string::npos || end == i + 1 || line[end] != ']') continue;
        std::size_t start = i;
        while (start > open + 1 && is_reference_char(line[start - 1])) --start;
        if (start < i) return line.substr(start, end + 1 - start);
    }
    return "";
}

/// What the parser says, and what it comes from where this format invites the mistake.
std::string explain(const YAML::Exception& error, const std::string& text)
{
    std::string message = "not valid YAML: " + error.msg;
    if (error.msg == "end of map flow not found") message += " (an opened '{' finds no '}')";
    if (error.msg == "end of sequence flow not found") message += " (an opened '[' finds no ']')";
    if (error.mark.is_null()) return message;
    std::istringstream lines(text);
    std::string line;
    for (int i = 0; i <= error.mark.line; ++i)
        if (!std::getline(lines, line)) return message;
    if (const std::string index = index_in_braces(line); !index.empty())
        message += "; inside { } an index needs quotes: '" + index + "'";
    if (line.substr(0, line.find_first_not_of(" \t")).find('\t') != std::string::npos)
        message += "; indent with spaces, not tabs";
    return message;
}

} // namespace

ValuePtr parse(const std::string& text, const std::string& file, std::vector<Problem>& problems)
{
    const SourcePosition whole_file{file, 0, 0};
    if (text.size() > max_bytes) {
        problems.push_back({whole_file, "the file is larger than " +
                                            std::to_string(max_bytes >> 20) +
                                            " MiB; is it a graph file?"});
        return nullptr;
    }
    if (const std::size_t at = first_binary_byte(text); at != std::string_view::npos) {
        problems.push_back({whole_file, "this is no text file (byte " + std::to_string(at) +
                                            " belongs to no UTF-8 text)"});
        return nullptr;
    }
    TreeBuilder builder(file, problems);
    try {
        std::istringstream stream(text);
        YAML::Parser parser(stream);
        if (!parser.HandleNextDocument(builder)) {
            problems.push_back({whole_file, "the file is empty; a graph begins with 'rayloom: 1'"});
            return nullptr;
        }
        const ValuePtr root = builder.root();
        if (parser.HandleNextDocument(builder))
            problems.push_back(
                {builder.document_start(), "a graph file holds one document; remove what follows"});
        return root;
    } catch (const LimitExceeded& limit) {
        problems.push_back(limit.problem);
    } catch (const YAML::Exception& error) {
        SourcePosition where = whole_file;
        if (!error.mark.is_null()) {
            where.line = error.mark.line + 1;
            where.column = error.mark.column + 1;
        }
        problems.push_back({where, explain(error, text)});
    }
    return nullptr;
}

} // namespace rayloom::yaml
