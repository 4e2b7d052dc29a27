#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Run time against error: the benchmark of rayloom. `./dev bench --help`; docs/benchmark.md."""

import argparse
import os
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import against as against_runs  # noqa: E402
import html_report  # noqa: E402
import kernels as kernel_runs  # noqa: E402
import pages  # noqa: E402
import quality as quality_runs  # noqa: E402
import scaling as scaling_runs  # noqa: E402
import skips as skip_runs  # noqa: E402
from common import SOURCE, BenchError, Program, Results, say  # noqa: E402

SETS = ["kernels", "quality", "scaling", "skip"]


def numbers(kind):
    return lambda text: [kind(x) for x in text.split(",")]


def arguments(argv):
    parser = argparse.ArgumentParser(
        prog="./dev bench", description="Run time against error: kernels, quality, scaling, shortcuts, and a report.",
        epilog="A run that was stopped goes on where it was: results.jsonl keeps every measurement.")
    parser.add_argument("set", nargs="?", default="all", choices=[*SETS, "all", "report"],
                        help="what to measure (default all); report: only draw the report anew")
    parser.add_argument("--data", default=SOURCE / "tests/data/cycles", help="folder of scenes (docs/benchmark.md)")
    parser.add_argument("--graphs", default=SOURCE / "graphs", help="folder of graph files")
    parser.add_argument("--build", default=SOURCE / "build", help="build folder")
    parser.add_argument("--out", help="folder of results and report (default: bench/ in the build folder)")
    parser.add_argument("--graph", action="append", help="only this graph (repeatable)")
    parser.add_argument("--spp", type=numbers(int), help="only these sample counts, e.g. 4,16")
    parser.add_argument("--repeats", type=int, default=3, help="runs of a case, of which the fastest counts (3)")
    parser.add_argument("--filter", default=".", help="kernels: regular expression of names")
    parser.add_argument("--min-time", type=float, default=0.2, help="kernels: seconds for each (0.2)")
    parser.add_argument("--megapixels", type=numbers(float), default=[0.1, 1.0, 4.0, 16.0, 64.0],
                        help="scaling: sizes (0.1,1,4,16,64); 64 want 21 GB of temporary files")
    parser.add_argument("--threads", type=numbers(int), help="scaling: numbers of threads (1 … all)")
    parser.add_argument("--again", action="store_true", help="forget what is measured already")
    parser.add_argument("--against", metavar="REV", help="compare with the build of another revision")
    parser.add_argument("--pairs", type=int, default=7, help="against: runs of each build (7)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="against: compilers at a time")
    parser.add_argument("--write-docs", action="store_true",
                        help="put the tables into docs/performance.md and docs/accuracy.md")
    return parser.parse_args(argv)


def main(argv=None):
    options = arguments(argv)
    try:
        out = pathlib.Path(options.out) if options.out else pathlib.Path(options.build) / "bench"
        if options.again and (out / "results.jsonl").exists():
            (out / "results.jsonl").rename(out / f"results-{int(time.time())}.jsonl")
        results = Results(out)
        begin = time.monotonic()
        sets = SETS if options.set == "all" else [options.set]
        if options.set != "report":
            program = Program(options.build)
            if options.against:
                if options.set in ("scaling", "skip"):
                    raise BenchError("--against compares kernels and quality")
                against_runs.against(options.against, program, results, options.data, sets, options.graph,
                                     options.filter, options.pairs, options.min_time, options.jobs)
            else:
                measure(options, program, results, sets)
            say(f"measured in {time.monotonic() - begin:.0f} s")
        html_report.write(results)
        say(f"report: {results.folder / 'report.html'}")
        if options.write_docs:
            pages.write(results, SOURCE / "docs")
    except BenchError as e:
        say(f"bench: {e}")
        return 2
    except KeyboardInterrupt:
        say("bench: stopped; what was measured is kept, the same command goes on from there")
        return 130
    return 0


def measure(options, program, results, sets):
    if "quality" in sets:
        quality_runs.Quality(program, results, options.repeats).run(
            options.data, options.graphs, options.graph, options.spp)
    if "skip" in sets:
        skip_runs.skips(program, results, options.data, options.graphs, options.graph, options.repeats)
    if "scaling" in sets:
        threads = options.threads or list(range(1, len(os.sched_getaffinity(0)) + 1))
        scaling_runs.scaling(program, results, options.data, options.graphs, options.megapixels, threads,
                             only=options.graph)
    if "kernels" in sets:
        kernel_runs.kernels(program, results, options.filter, options.min_time)


if __name__ == "__main__":
    sys.exit(main())
