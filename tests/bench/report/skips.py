# SPDX-License-Identifier: Apache-2.0
"""Time saved by each kind of shortcut, with proof that the pixels stay the same."""

import pathlib
import re
import shutil
import tempfile

import scaling
import scenes as scene_files
from common import BenchError, file_hash, run, say

# What is proved, and how.
KINDS = {
    "shortcuts": "everything on, against --no-skip",
    "black_region": "left half of the image black, everything on, against --no-skip",
    "black_passes": "glossy and transmitted light black, everything on, against --no-skip",
    "neutral": "steps that change nothing with their parameters, against --no-skip",
    "unread": "a step nobody reads, against --no-skip",
    "one_output": "one output asked for, against all of them",
    "region": "a quarter of the frame asked for, against all of it",
    "cache": "nothing changed since the last run, against an empty cache",
}
# Graphs made for a kind, where graphs that come with rayloom have none of it.
OWN_GRAPHS = scene_files.HERE / "skips"
SMALL, LARGE = (480, 270), (1920, 1080)  # images that are made for a kind: mirrored copies of the render


def same_pixels(a, b):
    """Byte by byte as pixels: the file's metadata may hold a date."""
    hashes = [run(["oiiotool", "--hash", f]).out.split("SHA-1:")[1].split()[0] for f in (a, b)]
    return hashes[0] == hashes[1]


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
    work = [(case, kind) for case in chosen.values() for kind in applicable(case)]
    if not only:
        work += own_cases(program, scenes)
    for case, kind in work:
        key = f"skip:{kind}:{file_hash(case.graph['file'], *case.files)}:{repeats}:{program.identity}"
        if results.known(key):
            continue
        folder = pathlib.Path(tempfile.mkdtemp(prefix="rayloom-bench-"))
        try:
            measure(case, program, results, folder, kind, key, repeats)
        except BenchError as e:
            say(f"skip: {case.name}: {e.reason()}")
            if isinstance(e, PixelsDiffer):
                raise
        finally:
            shutil.rmtree(folder, ignore_errors=True)


class PixelsDiffer(BenchError):
    """A shortcut that changes the picture ends the run."""


def applicable(case):
    """A graph with one image to give has no other output to leave out, and only whole renders bring passes."""
    images = [o for o in case.graph["outputs"] if o["kind"] == "image"]
    renders = any(i.startswith("render=") for i in case.inputs)
    found = ["shortcuts", "black_region", "region", "cache"]
    return found + ["one_output"] * (len(images) > 1) + ["black_passes"] * renders


def own_cases(program, scenes):
    """The graphs made for a kind, on the largest noisy render there is."""
    found = []
    noisy = [(s.pixels(program), s.single_spp()[-1], s) for s in scenes if s.single_spp()]
    if noisy:
        _, spp, scene = max(noisy, key=lambda n: n[:2])
        for graph in scene_files.graphs(program, OWN_GRAPHS):
            found.append((scene_files.bind(program, graph, scene, spp), pathlib.Path(graph["file"]).stem))
    return found


def dark(kind):
    """What is black of a channel."""
    passes = ("Gloss", "Trans")
    if kind == "black_passes":
        return lambda name: 1.0 if name.split(".")[-2:][0].startswith(passes) else 0.0
    return lambda name: 0.5 if kind == "black_region" else 0.0


def sides_of(case, kind, folder, program):
    """Of both ways to run: more arguments, and how much of the result is compared (None: all)."""
    if kind == "one_output":
        others = [o["name"] for o in case.graph["outputs"] if o["kind"] == "image" and o["name"] != case.output]
        return {"with": [], "without": [a for n in others for a in ("-o", f"{n}={folder / (n + '_.exr')}")]}, None
    if kind == "region":
        window = case.scene.info(program, case.scene.reference)["parts"][0]["data_window"]
        region = (window["width"] // 4, window["height"] // 4, window["width"] // 2, window["height"] // 2)
        return {"with": ["--roi", ",".join(map(str, region))], "without": []}, region
    if kind == "cache":
        return {"without": ["--cache", None], "with": ["--cache", None]}, None
    return {"with": [], "without": ["--no-skip"]}, None


def measure(case, program, results, folder, kind, key, repeats):
    if kind in ("black_region", "black_passes", "neutral", "unread"):
        size = SMALL if kind.startswith("black") else LARGE
        case = case.with_inputs(scaling.prepare(case, *size, folder / kind, dark(kind)))
    arguments, region = sides_of(case, kind, folder, program)
    files = {side: folder / f"{side}.exr" for side in arguments}
    seconds, cpu, reports = {s: [] for s in files}, {s: [] for s in files}, {}
    for turn in range(repeats):
        # By turns, so that both see the same machine; a cache is empty before it is full.
        for side in arguments if kind == "cache" or turn % 2 == 0 else reversed(arguments):
            more = [folder / f"cache{turn}" if a is None else a for a in arguments[side]]
            reports[side], done = program.run_graph(case.graph["file"], case.inputs, f"{case.output}={files[side]}", more)
            seconds[side].append(reports[side]["seconds"])
            cpu[side].append(done.cpu)
    if region:
        cropped(files["without"], region, folder / "cut.exr")
        cropped(files["with"], region, folder / "roi.exr")
        files = {"without": folder / "cut.exr", "with": folder / "roi.exr"}
    proof = same_pixels(files["without"], files["with"])
    results.add("skip", key, what=f"{kind}|{case.graph['graph']}", kind_of_skip=kind, title=KINDS[kind],
                graph=case.graph["graph"], scene=case.scene.name, spp=case.spp,
                seconds_with=seconds["with"], seconds_without=seconds["without"],
                cpu_with=cpu["with"], cpu_without=cpu["without"], equal_pixels=proof,
                peak_with=reports["with"]["peak_bytes"], peak_without=reports["without"]["peak_bytes"],
                reasons=reasons_of(reports["with"], reports["without"]))
    say(f"skip: {case.graph['graph']}, {KINDS[kind]}: {min(seconds['with']):.3f} s against "
        f"{min(seconds['without']):.3f} s, pixels {'equal' if proof else 'DIFFER'}")
    if not proof:
        raise PixelsDiffer(f"{case.name}: pixels differ ({KINDS[kind]})")


def reasons_of(report, without):
    """Reason → nodes that were left out, and the pixels and seconds that are known of them."""
    reasons = {}

    def entry(reason, node):
        found = reasons.setdefault(reason, {"nodes": [], "pixels": 0, "saved_seconds": None})
        name = re.sub(r"\[\d+\]$", "", node)
        if name not in found["nodes"]:
            found["nodes"].append(name)
        return found

    for skip in report["skips"]:
        found = entry(skip["reason"], skip["node"])
        found["pixels"] += skip["pixels"]
        if skip["saved_seconds"] is not None:
            found["saved_seconds"] = (found["saved_seconds"] or 0.0) + skip["saved_seconds"]
    named = {n for r in reasons.values() for n in r["nodes"]}
    # A step that hands on its input is no step of the plan.
    ran = {n["id"] for n in report["nodes"]} | named
    for node in without["nodes"]:
        if node["id"] not in ran and not node["id"].endswith((" copy", " constant")):
            entry("did not run", node["id"])
    for note in report["notes"]:
        black = re.search(r"(\w+): black, skipped$", note)
        if black:
            entry("black light", black.group(1))
    return reasons
