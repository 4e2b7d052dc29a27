// SPDX-License-Identifier: Apache-2.0
/// \file
/// The one family of errors. A node throws `NodeError`; the planner and the engine add where in the
/// graph it happened. The command maps each class to an exit code.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace rayloom
{

/// A place in a graph file; `line` and `column` count from 1, 0 when unknown.
struct SourcePosition {
    std::string file;
    int line = 0;
    int column = 0;

    /// "file:line:column", leaving out what is unknown.
    std::string text() const;
    friend bool operator==(const SourcePosition&, const SourcePosition&) = default;
};

/// One complaint about a graph: where, and what to do about it.
struct Problem {
    SourcePosition where;
    std::string message;

    std::string text() const;
};

/// Base of everything rayloom throws on purpose.
class Error : public std::runtime_error
{
public:
    using std::runtime_error::runtime_error;
    /// Process exit code documented in docs/command.md.
    virtual int exit_code() const noexcept { return 70; }
};

/// The command line was wrong (unknown option, malformed `-i`).
class UsageError : public Error
{
public:
    using Error::Error;
    int exit_code() const noexcept override { return 2; }
};

/// A graph cannot be run as written. Holds every problem found, not the first alone.
class GraphError : public Error
{
public:
    explicit GraphError(std::vector<Problem> problems);
    explicit GraphError(Problem problem) : GraphError(std::vector<Problem>{std::move(problem)}) {}
    const std::vector<Problem>& problems() const noexcept { return m_problems; }
    int exit_code() const noexcept override { return 2; }

private:
    std::vector<Problem> m_problems;
};

/// Thrown by a node's plan(): inputs and parameters do not fit together. The planner turns it into
/// a Problem that carries the node's name and position.
class NodeError : public Error
{
public:
    using Error::Error;
    int exit_code() const noexcept override { return 2; }
};

/// An input file is missing, truncated, not what it should be, or lacks channels.
class InputError : public Error
{
public:
    using Error::Error;
    int exit_code() const noexcept override { return 3; }
};

/// An output could not be written. Nothing is left under the final name.
class OutputError : public Error
{
public:
    using Error::Error;
    int exit_code() const noexcept override { return 4; }
};

/// The run does not fit the memory budget, or memory ran out.
class MemoryError : public Error
{
public:
    using Error::Error;
    int exit_code() const noexcept override { return 5; }
};

/// The run was stopped from outside (Ctrl-C).
class Cancelled : public Error
{
public:
    Cancelled() : Error("cancelled") {}
    int exit_code() const noexcept override { return 130; }
};

} // namespace rayloom
