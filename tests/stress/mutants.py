#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Breaks each kernel in the small ways mutants.txt lists, one at a time, and runs the tests that must
notice. What they let pass is a gap in the tests.

Usage: mutants.py [--build BUILD] [--jobs N] [--list] [--check] [NODE...]
Sources are changed in place and put back, also after Ctrl-C; they must be as in git before. They are
built in a folder of their own, for one SIMD target alone, which takes a fraction of the time."""

import argparse
import pathlib
import re
import signal
import subprocess
import sys
import time

SOURCE = pathlib.Path(__file__).resolve().parents[2]


class Mutant:
    def __init__(self, node, tests, kind, file, old, new):
        self.node, self.tests, self.kind, self.file, self.old, self.new = node, tests, kind, file, old, new

    def __str__(self):
        return f"{self.node} {self.kind}"


def read_list():
    mutants, node, tests, kind, file, old = [], None, None, None, None, None
    for line in (SOURCE / "tests/stress/mutants.txt").read_text().splitlines():
        if header := re.fullmatch(r"\[(\S+)\] tests: (\S+)", line):
            node, tests = header.groups()
            # What holds every node to its plain version and to its own bits is the node's test too.
            registered = node.replace(".", "_")
            tests += f":*/PlainNode.*/{registered}*:*/EveryNode.*/{registered}"
        elif line.startswith("- "):
            old = line[2:]
        elif line.startswith("+ "):
            mutants.append(Mutant(node, tests, kind, file, old, line[2:]))
        elif what := re.fullmatch(r"(\w+): (\S+)", line):
            kind, file = what.groups()
        elif line.strip() and not line.startswith("#"):
            sys.exit(f"mutants.txt: cannot read: {line}")
    return mutants


def pattern_of(text):
    """The text with any white space where it has some, so that formatting does not matter."""
    return re.compile(r"\s+".join(re.escape(word) for word in text.split()))


def build(folder, jobs, target="rayloom"):
    return subprocess.run(["ninja", "-C", str(folder), f"-j{jobs}", target], capture_output=True, text=True)


def times_found(mutant):
    return len(pattern_of(mutant.old).findall((SOURCE / mutant.file).read_text()))


def check(mutants):
    """Whether every mutant can still be made, without building anything."""
    stale = [m for m in mutants if times_found(m) != 1]
    for m in stale:
        print(f"{m}: {m.file}: the line is there {times_found(m)} times: {m.old}")
    print(f"{len(mutants)} mutants, {len(stale)} out of date")
    return 1 if stale else 0


def judge(mutant, folder, jobs):
    """'caught', or what went otherwise."""
    path = SOURCE / mutant.file
    whole = path.read_text()
    if times_found(mutant) != 1:
        return f"STALE: the line is there {times_found(mutant)} times"
    try:
        path.write_text(pattern_of(mutant.old).sub(lambda _: mutant.new, whole))
        built = build(folder, jobs)
        if built.returncode != 0:
            return "DOES NOT COMPILE: " + " ".join(re.findall(r"error: .*", built.stdout)[:1])
        try:
            tests = subprocess.run([str(folder / "bin/rayloom_tests"), "--gtest_brief=1", "--gtest_fail_fast",
                                    f"--gtest_filter={mutant.tests}"], capture_output=True, text=True, timeout=300)
        except subprocess.TimeoutExpired:
            return "caught (by never ending)"
        if "0 tests from 0 test suites" in tests.stdout:
            return "NO TESTS: " + mutant.tests
        if tests.returncode == 0:
            return "SURVIVED"
        first = re.search(r"FAILED  \] (\S+)", tests.stdout)
        return f"caught by {first.group(1)}" if first else f"caught (exit code {tests.returncode})"
    finally:
        path.write_text(whole)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("nodes", nargs="*", metavar="NODE")
    parser.add_argument("--build", default="build-mutants")
    parser.add_argument("--jobs", default="2")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--check", action="store_true", help="only see whether every line is still there")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))
    mutants = [m for m in read_list() if not arguments.nodes or m.node in arguments.nodes]
    if arguments.list:
        for m in mutants:
            print(f"{m}: {m.file}: {m.old}")
        return 0
    if arguments.check:
        return check(mutants)
    files = sorted({m.file for m in mutants})
    changed = subprocess.run(["git", "-C", str(SOURCE), "status", "--porcelain", "--", *files],
                             capture_output=True, text=True).stdout
    if changed:
        sys.exit("these are not as in git:\n" + changed)
    folder = SOURCE / arguments.build
    subprocess.run(["cmake", "--preset", "release", "-S", str(SOURCE), "-B", str(folder), "-DRAYLOOM_BENCHMARKS=OFF",
                    "-DCMAKE_CXX_FLAGS=-DHWY_COMPILE_ONLY_STATIC"], cwd=SOURCE, stdout=subprocess.DEVNULL, check=True)
    built = build(folder, arguments.jobs, "rayloom_tests")
    if built.returncode != 0:
        sys.exit(built.stdout)
    missed = 0
    try:
        for m in mutants:
            begin = time.monotonic()
            verdict = judge(m, folder, arguments.jobs)
            missed += not verdict.startswith("caught")
            print(f"{m}: {verdict} ({time.monotonic() - begin:.0f} s)", flush=True)
    finally:
        build(folder, arguments.jobs)
    print(f"{len(mutants)} mutants, {missed} not caught")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
