#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Breaks each kernel in the small ways mutants.txt lists, one at a time, and runs the tests that must
notice. What they let pass is a gap in the tests.

Usage: mutants.py [--build BUILD] [--jobs N] [--list] [--check [TESTS]] [SECTION...]
Sources are changed in place and put back, also after Ctrl-C; they must be as in git before. They are
built in a folder of their own, for one SIMD target alone, which takes a fraction of the time. Before
anything is broken the tests of each section are run: they must pass, or all would be "caught".
--check builds nothing: every line can still be found, every node and every file with arithmetic has its
mutants or a reason for none, and, given the program TESTS, every filter finds tests in it."""

import argparse
import collections
import fnmatch
import pathlib
import re
import signal
import subprocess
import sys
import time

SOURCE = pathlib.Path(__file__).resolve().parents[2]
KINDS = {"sign", "halo", "normalisation", "border", "channel"}
# Every source file there has mutants or a reason for none; so has every node, by its page.
KERNELS = ["nodes", "lib/stats", "lib/simd", "lib/image"]
PAGES = "docs/nodes"


class Section:
    def __init__(self, name, filters, nodes):
        self.name, self.filters = name, filters.split(":")
        # A part of a node is named after it: fuse.nlm-distances.
        self.nodes = nodes.split() if nodes else [name.split("-")[0]]
        self.mutants, self.fewer = [], None

    @property
    def tests(self):
        # What holds every node to its plain version and to its own bits is the node's test too.
        registered = [node.replace(".", "_") for node in self.nodes if "." in node]
        return ":".join(self.filters + [f"*/{test}.*/{node}*" for node in registered
                                        for test in ("PlainNode", "EveryNode")])


class Mutant:
    def __init__(self, section, kind, file, old, new):
        self.section, self.kind, self.file, self.old, self.new = section, kind, file, old, new

    def __str__(self):
        return f"{self.section.name} {self.kind}"


def read_list():
    """The sections, and {file or node: reason} of those without mutants."""
    sections, without, kind, file, old, reason = [], {}, None, None, None, None
    for line in (SOURCE / "tests/stress/mutants.txt").read_text().splitlines():
        if header := re.fullmatch(r"\[(\S+)\] tests: (\S+)(?: nodes: (.+))?", line):
            sections.append(Section(*header.groups()))
        elif line.startswith("- "):
            old = line[2:]
        elif line.startswith("+ "):
            sections[-1].mutants.append(Mutant(sections[-1], kind, file, old, line[2:]))
        elif what := re.fullmatch(r"fewer: (.+)", line):
            sections[-1].fewer = what.group(1)
        elif what := re.fullmatch(r"without: (.+)", line):
            reason = what.group(1)
        elif reason and line.startswith("  "):
            without.update((name, reason) for name in line.split())
        elif what := re.fullmatch(r"(\w+): (\S+)", line):
            kind, file = what.groups()
        elif line.strip() and not line.startswith("#"):
            sys.exit(f"mutants.txt: cannot read: {line}")
    return sections, without


def pattern_of(text):
    """The text with any white space where it has some, so that formatting does not matter."""
    return re.compile(r"\s+".join(re.escape(word) for word in text.split()))


def build(folder, jobs, target="rayloom"):
    return subprocess.run(["ninja", "-C", str(folder), f"-j{jobs}", target], capture_output=True, text=True)


def times_found(mutant):
    return len(pattern_of(mutant.old).findall((SOURCE / mutant.file).read_text()))


def names_of_tests(program):
    listed = subprocess.run([program, "--gtest_list_tests"], capture_output=True, text=True, check=True).stdout
    names, suite = [], ""
    for line in listed.splitlines():
        name = line.split("#")[0].rstrip()
        if not line.startswith(" "):
            suite = name
        else:
            names.append(suite + name.strip())
    return names


def check(sections, without, program):
    """Whether every mutant can still be made and nothing is left out, without building anything."""
    wrong = []
    mutants = [m for section in sections for m in section.mutants]
    for m in mutants:
        if times_found(m) != 1:
            wrong.append(f"{m}: {m.file}: the line is there {times_found(m)} times: {m.old}")
        if m.kind not in KINDS:
            wrong.append(f"{m}: there is no such kind")
        if m.file in without:
            wrong.append(f"{m.file}: has mutants and a reason for none")
    for name, count in collections.Counter(section.name for section in sections).items():
        if count > 1:
            wrong.append(f"[{name}]: there {count} times")
    for section in sections:
        lacking = sorted(KINDS - {m.kind for m in section.mutants})
        full = len(section.mutants) >= 5 and not lacking
        if not full and not section.fewer:
            wrong.append(f"[{section.name}]: {len(section.mutants)} mutants, none of {lacking}: give a reason (fewer:)")
        if full and section.fewer:
            wrong.append(f"[{section.name}]: lacks nothing and says why")

    broken = {m.file for m in mutants}
    files = {str(path.relative_to(SOURCE)) for folder in KERNELS for path in (SOURCE / folder).rglob("*")
             if path.suffix in (".cpp", ".h")}
    for file in sorted(files - broken - without.keys()):
        wrong.append(f"{file}: no mutants, and no reason for none (without:)")
    nodes = {page.stem for page in (SOURCE / PAGES).glob("*.md")} - {"README"}
    held = {node for section in sections for node in section.nodes if section.mutants}
    for node in sorted(nodes - held - without.keys()):
        wrong.append(f"{node}: a node without a section, and no reason for none (without:)")
    for name in sorted(without.keys() - files - nodes):
        wrong.append(f"{name}: has a reason for no mutants, but is not there")
    for node in sorted(without.keys() & held):
        wrong.append(f"{node}: has a section and a reason for none")

    if program:
        names = names_of_tests(program)
        for section in sections:
            for one in section.filters:
                if not any(fnmatch.fnmatchcase(name, one) for name in names):
                    wrong.append(f"[{section.name}]: no test is called {one}")
    print("\n".join(wrong + [f"{len(mutants)} mutants in {len(sections)} sections, {len(wrong)} complaints"]))
    return 1 if wrong else 0


def run_tests(folder, filters):
    return subprocess.run([str(folder / "bin/rayloom_tests"), "--gtest_brief=1", "--gtest_fail_fast",
                           f"--gtest_filter={filters}"], capture_output=True, text=True, timeout=300)


def refuse_unless_passing(sections, folder):
    """Tests that fail anyway, or run none, would call every mutant caught, or none."""
    for filters in sorted({section.tests for section in sections}):
        ran = run_tests(folder, filters)
        passed = re.search(r"PASSED  \] (\d+) test", ran.stdout)
        if ran.returncode != 0 or not passed or int(passed.group(1)) == 0:
            sys.exit(f"nothing is broken yet, and these tests do not pass or there are none: {filters}\n"
                     + ran.stdout[-2000:])


def judge(mutant, folder, jobs):
    """'caught', or what went otherwise."""
    path = SOURCE / mutant.file
    whole = path.read_text()
    if times_found(mutant) != 1:
        return f"STALE: the line is there {times_found(mutant)} times"
    try:
        path.write_text(pattern_of(mutant.old).sub(lambda _: mutant.new, whole))
        # Tests include headers themselves.
        built = build(folder, jobs, "rayloom_tests" if path.suffix == ".h" else "rayloom")
        if built.returncode != 0:
            return "DOES NOT COMPILE: " + " ".join(re.findall(r"error: .*", built.stdout)[:1])
        try:
            tests = run_tests(folder, mutant.section.tests)
        except subprocess.TimeoutExpired:
            return "caught (by never ending)"
        if tests.returncode == 0:
            return "SURVIVED"
        first = re.search(r"FAILED  \] (\S+)", tests.stdout)
        return f"caught by {first.group(1)}" if first else f"caught (exit code {tests.returncode})"
    finally:
        path.write_text(whole)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", metavar="SECTION")
    parser.add_argument("--build", default="build-mutants")
    parser.add_argument("--jobs", default="2")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--check", nargs="?", const="", metavar="TESTS", help="build nothing, see that all is there")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))
    sections, without = read_list()
    if arguments.check is not None:
        return check(sections, without, arguments.check)
    unknown = set(arguments.sections) - {section.name for section in sections}
    if unknown:
        sys.exit("there is no section " + ", ".join(sorted(unknown)))
    sections = [s for s in sections if not arguments.sections or s.name in arguments.sections]
    mutants = [m for section in sections for m in section.mutants]
    if arguments.list:
        for m in mutants:
            print(f"{m}: {m.file}: {m.old}")
        return 0
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
    refuse_unless_passing(sections, folder)
    missed = 0
    try:
        for m in mutants:
            begin = time.monotonic()
            verdict = judge(m, folder, arguments.jobs)
            missed += not verdict.startswith("caught")
            print(f"{m}: {verdict} ({time.monotonic() - begin:.0f} s)", flush=True)
    finally:
        build(folder, arguments.jobs, "rayloom_tests")
    print(f"{len(mutants)} mutants, {missed} not caught")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
