# SPDX-License-Identifier: Apache-2.0
"""Time and memory over the size of the image and the number of threads."""

import math
import pathlib
import re
import shutil
import tempfile

import scenes as scene_files
from common import BenchError, file_hash, run, say


def channels_of(source):
    """Channel names of each part, in the file's order, and whether all are half."""
    text = run(["oiiotool", "--info", "-v", "-a", source]).out
    found = []
    for line in re.findall(r"channel list: (.*)", text):
        names = [re.fullmatch(r"(.*?)(?: \((\w+)\))?", name).groups() for name in line.split(", ")]
        found.append(([name for name, _ in names], all(kind in (None, "half") for _, kind in names)))
    return found


def mirrored(source, target, width, height, side, parts):
    """Fills width × height with mirrored copies of an image of `side`: real noise of any size, without
    seams that a filter would see."""
    columns = math.ceil(width / (2 * side[0]))
    rows = math.ceil(height / (2 * side[1]))
    made = []
    for number, (part, (names, half)) in enumerate(zip(parts, channels_of(source))):
        one = ["-i:subimage=%d" % number, source] if len(parts) > 1 else [source]
        made.append(target.with_suffix(f".part{number}.exr"))
        # One block of 2×2: the image, and what mirrors show of it. A mosaic forgets names.
        run(["oiiotool", *one, *one, "--flop", *one, "--flip", *one, "--flip", "--flop",
             "--mosaic:pad=0", "2x2",
             *(["--dup"] * (columns * rows - 1)), "--mosaic:pad=0", f"{columns}x{rows}",
             "--cut", f"{width}x{height}+0+0", "--chnames", ",".join(names), "-d", "half" if half else "float",
             *(["--attrib", "oiio:subimagename", part["name"]] if part.get("name") else []), "-o", made[-1]])
    run(["oiiotool", *made, *(["--siappendall"] if len(made) > 1 else []), "-o", target])
    for file in made:
        file.unlink()


def prepare(case, program, width, height, folder):
    """The case's inputs at another size."""
    window = case.scene.info(program, case.scene.reference)["parts"][0]["data_window"]
    side = (window["width"], window["height"])
    made = folder / f"{width}x{height}"
    made.mkdir(exist_ok=True)
    inputs = []
    for file in case.files:
        target = made / file.relative_to(case.scene.folder)
        target.parent.mkdir(exist_ok=True)
        if not target.exists():
            mirrored(file, target, width, height, side, case.scene.info(program, file)["parts"])
    for text in case.inputs:
        inputs.append(text.replace(str(case.scene.folder), str(made)))
    return inputs


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
    try:
        for _, case in chosen.values():
            jobs = [(mp, max(threads)) for mp in megapixels]
            middle = sorted(megapixels)[len(megapixels) // 2]
            jobs += [(middle, n) for n in threads if n != max(threads)]
            for mp, count in jobs:
                width = 16 * round(math.sqrt(mp * 1e6 * 16 / 9) / 16)
                height = 16 * round(width * 9 / 16 / 16)
                key = (f"scaling:{file_hash(case.graph['file'])}:{case.scene.name}:{case.spp}:{width}x{height}:"
                       f"{count}:{program.identity}")
                if results.known(key):
                    continue
                try:
                    inputs = prepare(case, program, width, height, folder)
                    report, done = program.run_graph(
                        case.graph["file"], inputs, f"{case.output}={folder / 'out.exr'}", ["--threads", count])
                except BenchError as e:
                    say(f"scaling: {case.name}: {e.reason()}")
                    break
                results.add("scaling", key, what=f"{case.graph['graph']}|{width}x{height}|{count}",
                            graph=case.graph["graph"], scene=case.scene.name, spp=case.spp, width=width,
                            height=height, threads=count, seconds=report["seconds"], cpu_seconds=done.cpu,
                            peak_bytes=report["peak_bytes"], max_rss=done.max_rss)
                say(f"scaling: {case.graph['graph']} {width}x{height}, {count} threads: {report['seconds']:.2f} s, "
                    f"{done.max_rss / 2**20:.0f} MiB")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
