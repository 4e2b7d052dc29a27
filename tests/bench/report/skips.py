# SPDX-License-Identifier: Apache-2.0
"""Time saved by each kind of shortcut, with proof that the pixels stay the same."""

import pathlib
import shutil
import tempfile

import scaling
import scenes as scene_files
from common import BenchError, file_hash, run, say

# What is proved for every graph, and how.
KINDS = {
    "shortcuts": "everything on, against --no-skip",
    "black_region": "left half of the image black, everything on, against --no-skip",
    "black_passes": "glossy and transmitted light black, everything on, against --no-skip",
    "one_output": "one output asked for, against all of them",
    "region": "a quarter of the frame asked for, against all of it",
    "cache": "nothing changed since the last run, against an empty cache",
}
SIZE = (480, 270)  # of images that are made for a kind: mirrored copies of the render


def same_pixels(a, b):
    """Byte by byte as pixels: the file's metadata may hold a date."""
    hashes = [run(["oiiotool", "--hash", f]).out.split("SHA-1:")[1].split()[0] for f in (a, b)]
    return hashes[0] == hashes[1]


def without(case, program, out, repeats):
    """Runs with and without shortcuts, taking turns: both see the same machine."""
    files = {"with": out / "with.exr", "without": out / "without.exr"}
    seconds, cpu, reports = {"with": [], "without": []}, {"with": [], "without": []}, {}
    for turn in range(repeats):
        for side in (("with", "without") if turn % 2 == 0 else ("without", "with")):
            options = ["--no-skip"] if side == "without" else []
            reports[side], done = program.run_graph(case.graph["file"], case.inputs,
                                                    f"{case.output}={files[side]}", options)
            seconds[side].append(reports[side]["seconds"])
            cpu[side].append(done.cpu)
    return files, seconds, cpu, reports


def cropped(whole, region, target):
    """The pixels of a whole result that a region asks for."""
    x, y, w, h = region
    run(["oiiotool", whole, "--cut", f"{w}x{h}+{x}+{y}", "-o", target])


def skips(program, results, data, graph_folder, only=None, repeats=3):
    scenes = scene_files.find_scenes(data)
    possible, _ = scene_files.cases(program, graph_folder, scenes, only)
    chosen = {}
    for case in possible:
        old = chosen.get(case.graph["graph"])
        if old is None or (case.scene.pixels(program), case.spp) > (old.scene.pixels(program), old.spp):
            chosen[case.graph["graph"]] = case
    for case in chosen.values():
        folder = pathlib.Path(tempfile.mkdtemp(prefix="rayloom-bench-"))
        try:
            for kind in applicable(case):
                key = (f"skip:{kind}:{file_hash(case.graph['file'], *case.files)}:{repeats}:"
                       f"{program.identity}")
                if results.known(key):
                    continue
                try:
                    measure(case, program, results, folder, kind, key, repeats)
                except BenchError as e:
                    say(f"skip: {case.name}: {e.reason()}")
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def applicable(case):
    """A graph with one image to give has no other output to leave out, and only whole renders bring passes."""
    images = [o for o in case.graph["outputs"] if o["kind"] == "image"]
    renders = any(i.startswith("render=") for i in case.inputs)
    return [k for k in KINDS if (k != "one_output" or len(images) > 1) and (k != "black_passes" or renders)]


def dark(kind):
    """What is black of a channel."""
    passes = ("Gloss", "Trans")
    if kind == "black_passes":
        return lambda name: 1.0 if name.split(".")[-2:][0].startswith(passes) else 0.0
    return lambda name: 0.5


def measure(case, program, results, folder, kind, key, repeats):
    graph, proof = case.graph["file"], None
    if kind in ("shortcuts", "black_region", "black_passes"):
        if kind != "shortcuts":
            case = case.with_inputs(scaling.prepare(case, *SIZE, folder / kind, dark(kind)))
        files, seconds, cpu, reports = without(case, program, folder, repeats)
        proof = same_pixels(files["with"], files["without"])
        report = reports["with"]
    elif kind == "one_output":
        seconds, cpu = {"with": [], "without": []}, {"with": [], "without": []}
        others = [o["name"] for o in case.graph["outputs"] if o["kind"] == "image" and o["name"] != case.output]
        for _ in range(repeats):
            for side in ("with", "without"):
                more = [a for name in (others if side == "without" else []) for a in ("-o", f"{name}={folder / (name + '_.exr')}")]
                got, done = program.run_graph(graph, case.inputs, f"{case.output}={folder / (side + '.exr')}", more)
                seconds[side].append(got["seconds"])
                cpu[side].append(done.cpu)
                if side == "with":
                    report = got
        proof = same_pixels(folder / "without.exr", folder / "with.exr")
    elif kind == "region":
        window = case.scene.info(program, case.scene.reference)["parts"][0]["data_window"]
        w, h = window["width"] // 2, window["height"] // 2
        region = (window["width"] // 4, window["height"] // 4, w, h)
        seconds, cpu = {"with": [], "without": []}, {"with": [], "without": []}
        for _ in range(repeats):
            for side, options in (("with", ["--roi", ",".join(map(str, region))]), ("without", [])):
                got, done = program.run_graph(graph, case.inputs,
                                              f"{case.output}={folder / (side + '.exr')}", options)
                seconds[side].append(got["seconds"])
                cpu[side].append(done.cpu)
                if side == "with":
                    report = got
        cropped(folder / "without.exr", region, folder / "cut.exr")
        cropped(folder / "with.exr", region, folder / "roi.exr")
        proof = same_pixels(folder / "cut.exr", folder / "roi.exr")
    else:
        seconds, cpu = {"with": [], "without": []}, {"with": [], "without": []}
        for turn in range(repeats):
            cache = ["--cache", folder / f"cache{turn}"]
            for side in ("without", "with"):
                got, done = program.run_graph(graph, case.inputs,
                                              f"{case.output}={folder / (side + '.exr')}", cache)
                seconds[side].append(got["seconds"])
                cpu[side].append(done.cpu)
            report = got
        proof = same_pixels(folder / "without.exr", folder / "with.exr")
    reasons = {}
    for skip in report["skips"]:
        entry = reasons.setdefault(skip["reason"], {"nodes": [], "pixels": 0, "saved_seconds": None})
        entry["nodes"].append(skip["node"])
        entry["pixels"] += skip["pixels"]
        if skip["saved_seconds"] is not None:
            entry["saved_seconds"] = (entry["saved_seconds"] or 0.0) + skip["saved_seconds"]
    for node in report["nodes"]:
        for reason, pixels in node["skipped"].items():
            entry = reasons.setdefault(reason, {"nodes": [], "pixels": 0, "saved_seconds": None})
            if node["id"] not in entry["nodes"]:
                entry["nodes"].append(node["id"])
                entry["pixels"] += pixels
    results.add("skip", key, what=f"{kind}|{case.graph['graph']}", kind_of_skip=kind, title=KINDS[kind],
                graph=case.graph["graph"], scene=case.scene.name, spp=case.spp,
                seconds_with=seconds["with"], seconds_without=seconds["without"],
                cpu_with=cpu["with"], cpu_without=cpu["without"], equal_pixels=proof, reasons=reasons)
    say(f"skip: {case.graph['graph']}, {KINDS[kind]}: {min(seconds['with']):.3f} s against "
        f"{min(seconds['without']):.3f} s, pixels {'equal' if proof else 'DIFFER'}")
    if not proof:
        raise BenchError(f"{case.name}: pixels differ ({KINDS[kind]})")
