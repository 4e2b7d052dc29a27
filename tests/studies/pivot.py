#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The figures of docs/methods/pivot.md. Usage: pivot.py SCENES [BUILD_FOLDER] [VARIANT...]

SCENES holds cornell, interior and dof, each with noisy_16.exr, noisy_64.exr (the latter with ID passes)
and ref.exr, as Cycles writes them. Each line: relMSE of the image, without the worst 0.1 % of the
pixels in brackets; then, without those, of the pixels within 3 of an ID boundary, of all others, their
ratio, and of the textured ones (colour that changes by more than 5 % within 5x5 pixels, away from
boundaries); mean brightness over the reference's. Needs numpy and OpenImageIO.
"""
import os
import subprocess
import sys
import tempfile

import numpy as np
import OpenImageIO as oiio

HERE = os.path.dirname(os.path.abspath(__file__))
LOBES = os.path.join(HERE, "../../graphs/pivot-lobes.yaml")
BEAUTY = os.path.join(HERE, "pivot_beauty.yaml")
# Variants: graph, changes of its text, parameters.
BARE = ["-p", "detail=false", "-p", "energy=0"]
VARIANTS = {
    "beauty": (BEAUTY, [], []),
    "beauty-bare": (BEAUTY, [], BARE),
    "default": (LOBES, [], []),
    "bare": (LOBES, [], BARE),
    "no-detail": (LOBES, [], ["-p", "detail=false"]),
    "no-energy": (LOBES, [], ["-p", "energy=0"]),
    "energy-6": (LOBES, [], ["-p", "energy=6"]),
    "energy-8": (LOBES, [], ["-p", "energy=8"]),
    "ids": (LOBES, [("ranks: 2", "source: ids")], []),
    "ids-bare": (LOBES, [("ranks: 2", "source: ids")], BARE),
    "no-parts": (LOBES, [("ranks: 2", "source: none")], []),
    "three-ranks": (LOBES, [("ranks: 2", "ranks: 3")], []),
    "nlm": (LOBES, [], ["-p", "filter=nlm"]),
    "every-size": (LOBES, [("op: fit.plane\n", "op: fit.plane\n    growth: 0\n")], []),
    "growth-1": (LOBES, [("op: fit.plane\n", "op: fit.plane\n    growth: 1\n")], []),
    "blend-min": (LOBES, [("op: fuse.planes\n", "op: fuse.planes\n    blend: min\n")], []),
    "blend-min-bare": (LOBES, [("op: fuse.planes\n", "op: fuse.planes\n    blend: min\n")], BARE),
    "range-mean": (LOBES, [("op: fit.plane\n", "op: fit.plane\n    range_scale: mean\n")], []),
    "range-mean-bare": (LOBES, [("op: fit.plane\n", "op: fit.plane\n    range_scale: mean\n")], BARE),
    "residual-1": (LOBES, [("marked: light.marked, when: $detail",
                            "marked: light.marked, factor: 1, when: $detail")], []),
    "residual-1.5-r2": (LOBES, [("marked: light.marked, when: $detail",
                                 "marked: light.marked, factor: 1.5, radius: 2, when: $detail")], []),
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


def figures(image, reference, near, textured):
    error = ((image - reference) ** 2 / (reference**2 + 0.01)).mean(-1)
    kept = error <= np.quantile(error, 0.999)
    mean = [error[m & kept].mean() for m in (near, ~near, textured)]
    return (f"{error.mean():.4f} ({error[kept].mean():.4f}) near {mean[0]:.4f} else {mean[1]:.4f} "
            f"ratio {mean[0] / mean[1]:.2f} textured {mean[2]:.4f} "
            f"brightness {image.mean() / reference.mean():.3f}")


def main():
    scenes = os.path.abspath(sys.argv[1])
    build = os.path.abspath(sys.argv[2] if len(sys.argv) > 2 else "build")
    wanted = sys.argv[3:] or list(VARIANTS)
    with tempfile.TemporaryDirectory() as work:
        for name in wanted:
            graph, changes, params = VARIANTS[name]
            with open(graph, encoding="utf-8") as file:
                text = file.read()
            for old, new in changes:
                assert old in text, (name, old)
                text = text.replace(old, new)
            text = text.replace("graph:nlm-image.yaml",
                                "graph:" + os.path.abspath(HERE + "/../../graphs/nlm-image.yaml"))
            with open(work + "/graph.yaml", "w", encoding="utf-8") as file:
                file.write(text)
            for scene in ("cornell", "interior", "dof"):
                folder = scenes + "/" + scene
                near, textured = masks(folder)
                reference = layer(folder + "/ref.exr", "ViewLayer.Combined")
                for spp in (64,) if "source: ids" in text else (16, 64):
                    out = f"{os.environ.get('KEEP', work)}/{name}_{scene}_{spp}.exr"
                    subprocess.run([build + "/bin/rayloom", "run", work + "/graph.yaml", "-i",
                                    f"render={folder}/noisy_{spp}.exr", "-o", "image=" + out, "-q"]
                                   + params, check=True, stdout=subprocess.DEVNULL,
                                   stderr=subprocess.DEVNULL)
                    print(f"{name:16s} {scene:8s} {spp:2d}",
                          figures(layer(out, ""), reference, near, textured), flush=True)


if __name__ == "__main__":
    main()
