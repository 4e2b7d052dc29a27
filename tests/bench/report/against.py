# SPDX-License-Identifier: Apache-2.0
"""Two builds in one interleaved run, and what differs beyond the noise."""

import pathlib
import random
import shutil
import tempfile

import kernels as kernel_runs
import scenes as scene_files
from common import SOURCE, BenchError, Program, git, ratio_interval, run, say


def build_revision(revision, folder, jobs):
    """A build of another revision, in a work tree of its own that is kept for the next time."""
    sha = git("rev-parse", "--short=12", f"{revision}^{{commit}}")
    if not sha:
        raise BenchError(f"git does not know the revision '{revision}'")
    tree = pathlib.Path(folder).resolve() / sha
    if not (tree / "CMakeLists.txt").exists():
        say(f"checking out {sha}")
        if git("worktree", "add", "--detach", "--force", str(tree), sha) is None:
            raise BenchError(f"git could not check out {sha} at {tree}")
    build = tree / "build"
    say(f"building {sha}")
    run(["cmake", "-S", tree, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release"])
    run(["cmake", "--build", build, "-j", jobs, "--target", "bin/rayloom", "rayloom_bench"])
    return sha, Program(build)


def verdict(low, high):
    if high < 1.0:
        return "faster"
    if low > 1.0:
        return "slower"
    return "no difference beyond the noise"


def interleave(pairs, measure):
    """measure(side) for both sides, in an order drawn anew for each pair (with a fixed seed), after
    one round that does not count."""
    order = random.Random(1)
    first, second = [], []
    measure("then"), measure("now")
    for _ in range(pairs):
        sides = ["then", "now"]
        order.shuffle(sides)
        got = {side: measure(side) for side in sides}
        first.append(got["then"])
        second.append(got["now"])
    return first, second


def compare_kernels(programs, results, sha, pattern, pairs, min_time):
    listed = {side: set(run([p.bench, "--benchmark_list_tests", f"--benchmark_filter={pattern}"]).out.split())
              for side, p in programs.items()}
    for name in sorted(listed["then"] & listed["now"]):
        if name.startswith("machine/"):
            continue

        def measure(side, name=name):
            lines = kernel_runs.run_benchmarks(programs[side], "^" + name + "$", min_time)
            return kernel_runs.seconds_of(lines[0])

        then, now = interleave(pairs, measure)
        report(results, "kernel", name, sha, then, now, {})
    for name in sorted(listed["then"] ^ listed["now"]):
        if not name.startswith("machine/"):
            alone(results, "kernel", name, sha, f"only in the {'new' if name in listed['now'] else 'old'} build")


def report(results, part, name, sha, then, now, more):
    ratio, low, high = ratio_interval(then, now)
    line = results.add("against", "", what=f"{sha}|{part}|{name}", part=part, name=name, revision=sha,
                       then=then, now=now, ratio=ratio, low=low, high=high, verdict=verdict(low, high), **more)
    say(f"{name}: time × {ratio:.3f} (95 %: {low:.3f} … {high:.3f}), {line['verdict']}"
        + more.get("text", ""))


def alone(results, part, name, sha, why):
    """What one build has and the other has not, or cannot run."""
    results.add("against", "", what=f"{sha}|{part}|{name}", part=part, name=name, revision=sha, verdict=why)
    say(f"{name}: {why}")


def compare_quality(programs, graph_folders, results, sha, data, only, pairs):
    scenes = scene_files.find_scenes(data)
    now = programs["now"]
    cases, _ = scene_files.cases(now, graph_folders["now"], scenes, only)
    here = {pathlib.Path(g["file"]).name for g in scene_files.graphs(now, graph_folders["now"])}
    for file in sorted(graph_folders["then"].glob("*.yaml")):
        if file.name not in here and (not only or file.stem in only):
            alone(results, "quality", file.stem, sha, "only in the old build")
    largest = {}
    for case in cases:
        key = (case.graph["graph"], case.scene.name)
        if key not in largest or case.spp > largest[key].spp:
            largest[key] = case
    for case in largest.values():
        graph = {side: folder / pathlib.Path(case.graph["file"]).name for side, folder in graph_folders.items()}
        if not graph["then"].exists():
            alone(results, "quality", case.name, sha, "only in the new build")
            continue
        folder = pathlib.Path(tempfile.mkdtemp(prefix="rayloom-bench-"))
        try:
            # Processor time: an interval of wall-clock times on a machine that does other things
            # says more of those.
            def measure(side, case=case, graph=graph, folder=folder):
                return programs[side].run_graph(graph[side], case.inputs,
                                                f"{case.output}={folder / (side + '.exr')}")[1].cpu

            then_times, now_times = interleave(pairs, measure)
            # Both are measured by the new build's yardstick.
            both = now.compare(folder / "now.exr", folder / "then.exr", "--ref", case.scene.reference)
            errors = {m: [both["b"][m], both["a"][m]] for m in ("rmse", "relmse", "smape", "ssim", "flip")
                      if m in both["a"]}
            same = errors["rmse"][0] == errors["rmse"][1] and errors["flip"][0] == errors["flip"][1]
            text = "; errors unchanged" if same else (
                f"; relMSE {errors['relmse'][0]:.5g} → {errors['relmse'][1]:.5g} "
                f"(× {errors['relmse'][1] / errors['relmse'][0]:.4f})" if errors["relmse"][0] else "; errors differ")
            report(results, "quality", case.name, sha, then_times, now_times,
                   {"errors": errors, "errors_unchanged": same, "text": text})
        except BenchError as e:
            alone(results, "quality", case.name, sha, "not compared: " + e.reason())
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def against(revision, now, results, data, sets, only, pattern, pairs, min_time, jobs):
    sha, then = build_revision(revision, results.folder / "against", jobs)
    programs = {"then": then, "now": now}
    if "kernels" in sets:
        compare_kernels(programs, results, sha, pattern, pairs, min_time)
    if "quality" in sets:
        folders = {"then": then.build.parent / "graphs", "now": SOURCE / "graphs"}
        compare_quality(programs, folders, results, sha, data, only, pairs)
