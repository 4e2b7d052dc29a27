# SPDX-License-Identifier: Apache-2.0
"""Time and memory over the size of the image and the number of threads."""

import math
import pathlib
import shutil
import tempfile

import scenes as scene_files
from common import BenchError, file_hash, machine, say
from mirrored_exr import enlarge


def prepare(case, width, height, folder, black=lambda channel: 0.0):
    """The case's inputs at another size; `black` as enlarge() takes it."""
    made = folder / f"{width}x{height}"
    for file in case.files:
        target = made / file.relative_to(case.scene.folder)
        target.parent.mkdir(exist_ok=True, parents=True)
        if not target.exists():
            try:
                enlarge(file, target, width, height, black)
            except OSError as e:
                target.unlink(missing_ok=True)
                raise BenchError(f"{target}: {e.strerror}") from e
    return [text.replace(str(case.scene.folder), str(made)) for text in case.inputs]


def budget():
    """What a run may hold of pixels: a third of the machine's memory, as one would give it."""
    return (machine()["memory_bytes"] or 6 << 30) // 3


def scaling(program, results, data, graph_folder, megapixels, threads, spp=4, only=None):
    scenes = scene_files.find_scenes(data)
    possible, _ = scene_files.cases(program, graph_folder, scenes, only, [spp, 16])
    chosen = {}
    for case in possible:
        # One scene is enough for time; the smallest sample count keeps reading short.
        old = chosen.get(case.graph["graph"])
        size = (case.spp != spp, -case.scene.pixels(program))
        if old is None or size < old[0]:
            chosen[case.graph["graph"]] = (size, case)
    folder = pathlib.Path(tempfile.mkdtemp(prefix="rayloom-bench-"))
    took = {}
    # Threads are compared at one size, large enough for many tiles.
    middle, failed = min(megapixels, key=lambda mp: abs(math.log(mp))), set()
    try:
        for mp in sorted(megapixels):
            width = 16 * round(math.sqrt(mp * 1e6 * 16 / 9) / 16)
            height = 16 * round(width * 9 / 16 / 16)
            # Graphs that were quick at the size before come first: a run that is cut short has most of them.
            for name, (_, case) in sorted(chosen.items(), key=lambda c: took.get(c[0], 0.0)):
                counts = sorted(set(threads)) if mp == middle else [max(threads)]
                for count in counts if name not in failed else []:
                    key = (f"scaling:{file_hash(case.graph['file'])}:{case.scene.name}:{case.spp}:{width}x{height}:"
                           f"{count}:{program.identity}")
                    if known := results.known(key):
                        took[name] = known["cpu_seconds"]
                        continue
                    try:
                        took[name] = measure(case, program, results, key, width, height, count, folder)
                    except BenchError as e:
                        say(f"scaling: {case.name} {width}x{height}: {e.reason()}")
                        failed.add(name)
                        break
            # The next size wants the space.
            shutil.rmtree(folder / f"{width}x{height}", ignore_errors=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def measure(case, program, results, key, width, height, threads, folder):
    inputs = prepare(case, width, height, folder)
    out = folder / f"{width}x{height}" / "out.exr"
    report, done = program.run_graph(case.graph["file"], inputs, f"{case.output}={out}",
                                     ["--threads", threads, "--memory", budget()])
    out.unlink()
    results.add("scaling", key, what=f"{case.graph['graph']}|{width}x{height}|{threads}",
                graph=case.graph["graph"], scene=case.scene.name, spp=case.spp, width=width,
                height=height, threads=threads, seconds=report["seconds"], cpu_seconds=done.cpu,
                peak_bytes=report["peak_bytes"], max_rss=done.max_rss, memory_budget=budget(),
                sweeps=report.get("sweeps"), strips=report.get("strips"))
    say(f"scaling: {case.graph['graph']} {width}x{height}, {threads} threads: {report['seconds']:.2f} s, "
        f"{done.cpu:.1f} s of processor time, {done.max_rss / 2**20:.0f} MiB")
    return done.cpu
