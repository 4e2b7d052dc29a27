#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The figures of docs/methods/pivot.md. Usage: pivot.py SCENES [BUILD_FOLDER] [VARIANT...]

SCENES holds cornell, caustics, interior and dof, each with noisy_16.exr, noisy_64.exr (the latter with ID passes)
and ref.exr, as Cycles writes them. Each line: relMSE of the image, without the worst 0.1 % of the
pixels in brackets; then, without those, of the pixels within 3 of an ID boundary, of all others, their
ratio, its root (the ratio of the errors themselves), and of the textured ones (colour that changes by more
than 5 % within 5x5 pixels, away from boundaries); mean brightness over the reference's; the root again with what
no partial image holds taken as in the reference. SPP in the
environment chooses samples per pixel (16,64); KEEP is a folder that keeps the images. Needs numpy and
OpenImageIO.
"""
import os
import subprocess
import sys
import tempfile

import numpy as np
import OpenImageIO as oiio

HERE = os.path.dirname(os.path.abspath(__file__))
GRAPHS = os.path.abspath(os.path.join(HERE, "../../graphs")) + "/"
LOBES = GRAPHS + "pivot-lobes.yaml"
PLANES = GRAPHS + "pivot-planes.yaml"
BEAUTY = os.path.join(HERE, "pivot_beauty.yaml")
# Variants: graph, changes of its text, changes of the text of pivot-planes.yaml, parameters.
BARE = ["-p", "detail=false", "-p", "energy=0"]
KEPT = "marked: light.marked, when: $detail"


def planes(node, setting):
    old = f"op: {node}"
    return [(old, f"{old}, {setting}" if node == "fuse.planes" else f"{old}\n    {setting}")]


def residual(*settings):
    return [(KEPT, KEPT.replace("when", ", ".join(settings) + ", when"))]


VARIANTS = {
    "noisy": (None, [], [], []),
    "beauty": (BEAUTY, [], [], []),
    "default": (LOBES, [], [], []),
    "bare": (LOBES, [], [], BARE),
    "no-detail": (LOBES, [], [], ["-p", "detail=false"]),
    **{f"energy-{n}": (LOBES, [], [], ["-p", f"energy={n}"]) for n in (0, 4, 8)},
    "no-fireflies": (LOBES, [], [], ["-p", "fireflies=false"]),
    **{f"stride-{n}": (LOBES, [], planes("fit.plane", f"stride: {n}"), []) for n in (1, 2)},
    "no-pivot": (LOBES, [("    pivot: lobes.pivot\n", "")], [], []),
    "ids": (LOBES, [("ranks: 2", "source: ids")], [], []),
    "no-parts": (LOBES, [("ranks: 2", "source: none")], [], []),
    "nlm": (LOBES, [], [], ["-p", "filter=graph:nlm-image"]),
    "every-size": (LOBES, [], planes("fit.plane", "growth: 0"), []),
    "growth-1": (LOBES, [], planes("fit.plane", "growth: 1"), []),
    "blend-min": (LOBES, [], planes("fuse.planes", "blend: min"), []),
    "blend-min-bare": (LOBES, [], planes("fuse.planes", "blend: min"), BARE),
    "range-mean": (LOBES, [], planes("fit.plane", "range_scale: mean"), []),
    "range-mean-bare": (LOBES, [], planes("fit.plane", "range_scale: mean"), BARE),
    "no-range": (LOBES, [], [], ["-p", "range=0"]),
    "no-range-bare": (LOBES, [], [], ["-p", "range=0"] + BARE),
    "no-support": (LOBES, residual("support: 0"), [], []),
    **{f"residual-{factor}-r{radius}": (LOBES, residual(f"factor: {factor}", f"radius: {radius}"), [], [])
       for factor in (1, 1.5, 2, 3) for radius in (0, 1, 2, 3)},
}


def layer(path, name):
    image = oiio.ImageBuf(path)
    names = list(image.spec().channelnames)
    prefix = name + "." if name else ""
    return image.get_pixels(oiio.FLOAT)[..., [names.index(prefix + c) for c in "RGB"]]


def single(path, name):
    image = oiio.ImageBuf(path)
    return image.get_pixels(oiio.FLOAT)[..., list(image.spec().channelnames).index(name)]


def around(mask, reach):
    """Pixels with one of `mask` in the square around them."""
    out = mask.copy()
    for _ in range(reach):
        wide = np.pad(out, 1)
        rows = wide[:-2] | wide[1:-1] | wide[2:]
        out = rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]
    return out


def masks(folder):
    """Near an ID boundary; textured and not near one."""
    file = folder + "/noisy_64.exr"
    ids = single(file, "ViewLayer.IndexOB.X") * 4096 + single(file, "ViewLayer.IndexMA.X")
    edge = np.zeros(ids.shape, bool)
    for a, b in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
        differ = ids[a] != ids[b]
        edge[a] |= differ
        edge[b] |= differ
    near = around(edge, 2)
    colour = sum(layer(folder + "/ref.exr", f"ViewLayer.{k}Col") for k in ("Diff", "Gloss")).mean(-1)
    wide = np.pad(colour, 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(wide, (5, 5))
    textured = windows.std((-1, -2)) > 0.05 * np.maximum(windows.mean((-1, -2)), 1e-6)
    return near, textured & ~near


def lobes(path):
    """What the partial images hold."""
    return sum(layer(path, f"ViewLayer.{k}Col") * (layer(path, f"ViewLayer.{k}Dir") + layer(path, f"ViewLayer.{k}Ind"))
               for k in ("Diff", "Gloss", "Trans"))


def root_ratio(error, near):
    kept = error <= np.quantile(error, 0.999)
    return (error[near & kept].mean() / error[~near & kept].mean()) ** 0.5


def figures(image, reference, near, textured, rest):
    error = ((image - reference) ** 2 / (reference**2 + 0.01)).mean(-1)
    kept = error <= np.quantile(error, 0.999)
    mean = [error[m & kept].mean() for m in (near, ~near, textured)]
    return (f"{error.mean():.4f} ({error[kept].mean():.4f}) near {mean[0]:.4f} else {mean[1]:.4f} "
            f"ratio {mean[0] / mean[1]:.2f} root {(mean[0] / mean[1]) ** 0.5:.2f} textured {mean[2]:.4f} "
            f"brightness {image.mean() / reference.mean():.3f} "
            f"filtered root {root_ratio(((image - reference - rest) ** 2 / (reference**2 + 0.01)).mean(-1), near):.2f}")


def changed(file, changes, folder, name):
    """A copy of a graph with other text; the graphs it names are still found."""
    with open(file, encoding="utf-8") as stream:
        text = stream.read()
    for old, new in changes:
        assert old in text, (file, old)
        text = text.replace(old, new)
    text = text.replace("graph:pivot-planes.yaml", "graph:" + PLANES)
    with open(f"{folder}/{name}", "w", encoding="utf-8") as stream:
        stream.write(text)
    return f"{folder}/{name}"


def main():
    scenes = os.path.abspath(sys.argv[1])
    build = os.path.abspath(sys.argv[2] if len(sys.argv) > 2 else "build")
    wanted = sys.argv[3:] or list(VARIANTS)
    samples = [int(n) for n in os.environ.get("SPP", "16,64").split(",")]
    with tempfile.TemporaryDirectory() as work:
        for name in wanted:
            graph, changes, planes_changes, params = VARIANTS[name]
            if graph:
                graph = changed(graph, changes, work, "graph.yaml")
            if planes_changes:
                params = params + ["-p", "filter=graph:" + changed(PLANES, planes_changes, work, "planes.yaml")]
            for scene in ("cornell", "caustics", "interior", "dof"):
                folder = scenes + "/" + scene
                near, textured = masks(folder)
                reference = layer(folder + "/ref.exr", "ViewLayer.Combined")
                held = lobes(folder + "/ref.exr")
                for spp in (64,) if name == "ids" else samples:
                    render = f"{folder}/noisy_{spp}.exr"
                    out = f"{os.environ.get('KEEP', work)}/{name}_{scene}_{spp}.exr"
                    if graph:
                        subprocess.run([build + "/bin/rayloom", "run", graph, "-i", "render=" + render, "-o",
                                        "image=" + out, "-q"] + params, check=True,
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                    rest = (layer(render, "ViewLayer.Combined") - reference) - (lobes(render) - held)
                    image = layer(out, "") if graph else layer(render, "ViewLayer.Combined")
                    print(f"{name:16s} {scene:8s} {spp:2d}",
                          figures(image, reference, near, textured, rest), flush=True)


if __name__ == "__main__":
    main()
