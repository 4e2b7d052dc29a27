#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The figures of docs/methods/pivot.md. Usage: pivot.py SCENES [BUILD_FOLDER] [VARIANT...]

SCENES holds cornell, caustics, interior and dof, each with noisy_16.exr, noisy_64.exr (the latter with ID passes)
and ref.exr, as Cycles writes them. Each line: relMSE of the image, without the worst 0.1 % of the
pixels in brackets; then, without those, of the pixels within 3 of an ID boundary, of all others, their
ratio, its root (the ratio of the errors themselves), and of the textured ones (colour that changes by more
than 5 % within 5x5 pixels, away from boundaries); mean brightness over the reference's; the root again with what
no partial image holds taken as in the reference; the ratio of absolute errors. SPP in the
environment chooses samples per pixel (16,64); KEEP is a folder that keeps the images. Needs numpy and
OpenImageIO.

Variants beside those of the graph: noisy; reference, the reference filtered (there is no noise to speak of, what is
left is bias); with-ids, 16 samples with the ID passes of 64; exact-light, the reference's light with the render's
colours and remainder; nlm-image, virtual-flash and ray-histogram-fusion-stack, other methods on the beauty; flat and
flat-ids, light of 1 with normal noise of 50 % on the scene's objects, without and with ids, where all error is
variance; shares, of what the error near boundaries consists.
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


# Of other methods: graph and inputs, SCENE and RENDER in them replaced.
STACK = "stack=SCENE/stack/s%02d.exr@1-16:Combined"
FLASH = ["-i", "partial=SCENE/flash_16.exr:partial_d1", "-i", "flash_unit=SCENE/flash_16.exr:flash_unit"]
PEERS = {
    "nlm-image": ["-i", "image=RENDER:Combined"],
    "virtual-flash": ["-i", STACK, *FLASH],
    "ray-histogram-fusion-stack": ["-i", STACK],
    "reference": ["-i", "render=SCENE/ref.exr"],
}
ALONE = [*PEERS, "with-ids", "exact-light", "flat", "flat-ids", "shares"]
VARIANTS = {
    "noisy": (None, [], [], []),
    "beauty": (BEAUTY, [], [], []),
    "default": (LOBES, [], [], []),
    "bare": (LOBES, [], [], BARE),
    "no-detail": (LOBES, [], [], ["-p", "detail=false"]),
    **{f"energy-{n}": (LOBES, [], [], ["-p", f"energy={n}"]) for n in (0, 4, 8)},
    "no-fireflies": (LOBES, [], [], ["-p", "fireflies=false"]),
    **{f"stride-{n}": (LOBES, [], planes("fit.plane", f"stride: {n}"), []) for n in (1, 2)},
    **{f"dense-{n}": (LOBES, [], planes("fit.plane", f"dense: {n}"), []) for n in (2, 5, 8)},
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


def flat(folder, ids, work):
    """A render of light 1 with noise, and its colour."""
    source = oiio.ImageBuf(folder + "/noisy_64.exr")
    names = list(source.spec().channelnames)
    guides = ["Denoising Normal", "Denoising Depth"] + (["Index", "Crypto"] if ids else [])
    kept = [i for i, name in enumerate(names) if any(g in name for g in guides)]
    colour = np.maximum(layer(folder + "/ref.exr", "ViewLayer.DiffCol"), 0.3)
    light = (1 + 0.5 * np.random.default_rng(1).standard_normal(colour.shape[:2]))[..., None].repeat(3, -1)
    passes = {"Combined": colour * light, "DiffCol": colour, "DiffDir": light, "DiffInd": 0 * light}
    pixels = np.concatenate([source.get_pixels(oiio.FLOAT)[..., kept], *passes.values()], -1).astype(np.float32)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], "float")
    spec.channelnames = tuple([names[i] for i in kept] + [f"ViewLayer.{p}.{c}" for p in passes for c in "RGB"])
    for attribute in source.spec().extra_attribs:
        if attribute.name.startswith("cryptomatte"):
            spec.attribute(attribute.name, attribute.value)
    out = oiio.ImageBuf(spec)
    out.set_pixels(oiio.ROI(), pixels)
    path = f"{work}/flat_{os.path.basename(folder)}_{ids}.exr"
    out.write(path)
    return path, colour


def with_ids(folder, work):
    """The render of 16 samples with the ID passes of that of 64, which are of one sample in either."""
    render, ids = oiio.ImageBuf(folder + "/noisy_16.exr"), folder + "/noisy_64.exr"
    passes = ["ViewLayer.IndexMA.X", "ViewLayer.IndexOB.X"]
    pixels = np.dstack([render.get_pixels(oiio.FLOAT), *(single(ids, name) for name in passes)])
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], "float")
    spec.channelnames = tuple([*render.spec().channelnames, *passes])
    out = oiio.ImageBuf(spec)
    out.set_pixels(oiio.ROI(), np.ascontiguousarray(pixels))
    path = f"{work}/ids_{os.path.basename(folder)}.exr"
    out.write(path)
    return path


def exact_light(render, reference):
    lit = sum(layer(render, f"ViewLayer.{k}Col") * (layer(reference, f"ViewLayer.{k}Dir") +
                                                   layer(reference, f"ViewLayer.{k}Ind"))
              for k in ("Diff", "Gloss", "Trans"))
    return lit + layer(render, "ViewLayer.Combined") - lobes(render)


def shares(folder, images):
    """Relative errors near boundaries and elsewhere: noise of the reference, what renders of 16 and 64 samples with
    seeds of their own have in common beyond it, and what each has alone. Before that: pixels near boundaries of which
    no object covers 98 %, and their share in what is near beyond the error elsewhere."""
    near = masks(folder)[0]
    reference = layer(folder + "/ref.exr", "ViewLayer.Combined")
    scale = reference**2 + 0.01
    errors = [image - reference for image in images]
    squares = [(e * e / scale).mean(-1) for e in errors]
    common = (errors[0] * errors[1] / scale).mean(-1)
    noise = (layer(folder + "/ref.exr", "ViewLayer.RefVar") / scale).mean(-1)
    kept = np.logical_and(*(s <= np.quantile(s, 0.999) for s in squares))
    ranks = [f"{kind}0{rank}.{c}" for kind in ("CryptoObject", "CryptoMaterial") for rank in (0, 1) for c in "ga"]
    cover = {name: single(folder + "/noisy_64.exr", "ViewLayer." + name) for name in ranks}
    mixed = np.minimum(*(np.maximum.reduce([c for name, c in cover.items() if kind in name])
                         for kind in ("Object", "Material"))) < 0.98
    excess = [((squares[1] - squares[1][~near & kept].mean()) * (mask & kept)).sum() for mask in (near & mixed, near)]
    text = [f"mixed {(near & mixed).mean():.2f} of all pixels, {excess[0] / excess[1]:.2f} of the excess near at 64"]
    for name, mask in (("near", near & kept), ("else", ~near & kept)):
        both = common[mask].mean()
        text.append(f"{name}: reference {noise[mask].mean():.4f} common {both - noise[mask].mean():.4f} "
                    f"16 alone {squares[0][mask].mean() - both:.4f} 64 alone {squares[1][mask].mean() - both:.4f}")
    return "; ".join(text)


def alone(name, scenes, build, samples, work):
    def run(graph, inputs, out):
        subprocess.run([build + "/bin/rayloom", "run", graph, *inputs, "-o", "image=" + out, "-q"], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return layer(out, "")

    for scene in ("cornell", "caustics", "interior", "dof"):
        folder = scenes + "/" + scene
        out = f"{os.environ.get('KEEP', work)}/{name}_{scene}"
        near, textured = masks(folder)
        reference = layer(folder + "/ref.exr", "ViewLayer.Combined")
        if name == "shares":
            print(f"{name:16s} {scene:8s}", shares(folder, [
                run(LOBES, ["-i", f"render={folder}/noisy_{n}.exr"], f"{out}_{n}.exr") for n in (16, 64)]), flush=True)
            continue
        if name.startswith("flat"):
            render, colour = flat(folder, name == "flat-ids", work)
            light = run(LOBES, ["-i", "render=" + render], out + ".exr") / colour
            ratio = root_ratio(((light - 1) ** 2).mean(-1), near)
            print(f"{name:16s} {scene:8s} root {ratio:.2f}", flush=True)
            continue
        for spp in samples if name in ("nlm-image", "exact-light") else samples[:1]:
            render = f"{folder}/noisy_{spp}.exr"
            if name == "exact-light":
                image = exact_light(render, folder + "/ref.exr")
            elif name == "with-ids":
                image = run(LOBES, ["-i", "render=" + with_ids(folder, work)], out + ".exr")
            else:
                graph = LOBES if name == "reference" else GRAPHS + name + ".yaml"
                inputs = [i.replace("SCENE", folder).replace("RENDER", render) for i in PEERS[name]]
                image = run(graph, inputs, f"{out}_{spp}.exr")
            print(f"{name:16s} {scene:8s} {spp:2d}", figures(image, reference, near, textured, 0), flush=True)


def figures(image, reference, near, textured, rest):
    error = ((image - reference) ** 2 / (reference**2 + 0.01)).mean(-1)
    kept = error <= np.quantile(error, 0.999)
    mean = [error[m & kept].mean() for m in (near, ~near, textured)]
    return (f"{error.mean():.4f} ({error[kept].mean():.4f}) near {mean[0]:.4f} else {mean[1]:.4f} "
            f"ratio {mean[0] / mean[1]:.2f} root {(mean[0] / mean[1]) ** 0.5:.2f} textured {mean[2]:.4f} "
            f"brightness {image.mean() / reference.mean():.3f} "
            f"filtered root {root_ratio(((image - reference - rest) ** 2 / (reference**2 + 0.01)).mean(-1), near):.2f} "
            f"absolute {root_ratio(((image - reference) ** 2).mean(-1), near):.2f}")


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
    wanted = sys.argv[3:] or [*VARIANTS, *ALONE]
    samples = [int(n) for n in os.environ.get("SPP", "16,64").split(",")]
    with tempfile.TemporaryDirectory() as work:
        for name in wanted:
            if name in ALONE:
                alone(name, scenes, build, samples, work)
                continue
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
