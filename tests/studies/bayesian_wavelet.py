#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tables and pictures of docs/methods/bayesian-wavelet.md.

Usage: bayesian_wavelet.py SCENES [--rayloom COMMAND] [--pictures FOLDER] [PART...]

SCENES holds cornell, caustics, interior and dof, each with noisy_16.exr, noisy_64.exr and ref.exr;
cornell and interior also have stack/sNN.exr and stack_passes/sNN.exr (1 sample a pixel, 8 seeds).
PART: errors, channels, means, clean, growth, bands (all of them). Tables go to standard output; with
--pictures, histograms (SVG) and renders (PNG, by oiiotool) go to FOLDER.
"""
import argparse
import json
import math
import pathlib
import subprocess
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
SINGLE = [(scene, samples) for samples in ("16", "64") for scene in ("cornell", "interior", "caustics", "dof")]
STACKS = [("cornell", "8×1"), ("interior", "8×1")]


class Study:
    def __init__(self, scenes, rayloom, work):
        self.scenes, self.rayloom, self.work = scenes, rayloom, work

    def inputs(self, scene, samples):
        folder = self.scenes / scene
        if samples == "8×1":
            beauty, passes = folder / "stack/s%02d.exr@1-8", folder / "stack_passes/s%02d.exr@1-8"
        elif samples == "clean":
            beauty = passes = folder / "ref.exr"
        else:
            beauty = passes = folder / f"noisy_{samples}.exr"
        reference = folder / "ref.exr"
        return {"beauty": f"{beauty}:Combined", "diffuse_indirect": f"{passes}:DiffInd",
                "diffuse_color": f"{passes}:DiffCol", "reference_indirect": f"{reference}:DiffInd",
                "reference_color": f"{reference}:DiffCol"}

    def run(self, graph, inputs, outputs, params):
        command = [self.rayloom, "run", str(HERE / graph), "-q"]
        for name, path in inputs.items():
            command += ["-i", f"{name}={path}"]
        for name, path in outputs.items():
            command += ["-o", f"{name}={path}"]
        for name, value in params.items():
            command += ["-p", f"{name}={value}"]
        subprocess.run(command, check=True)

    def figures(self, scene, samples, names, **params):
        graph = "bayesian_wavelet_stack.yaml" if samples == "8×1" else "bayesian_wavelet.yaml"
        files = {name: self.work / f"{name}.json" for name in names}
        self.run(graph, self.inputs(scene, samples), files, params)
        return [json.loads(file.read_text()) for file in files.values()]

    def factors(self, scene, samples, name="light", **params):
        noisy, filtered = self.figures(scene, samples, ["noisy", name], **params)
        return noisy["rmse"] / filtered["rmse"], noisy["relmse"] / filtered["relmse"]


def row(*cells):
    print("| " + " | ".join(str(c) for c in cells) + " |", flush=True)


def head(*cells):
    print()
    row(*cells)
    row(*["---"] * len(cells))


def cell(factors):
    return f"{factors[0]:.2f} ({factors[1]:.1f})"


def errors(study):
    print("\nErrors of the indirect component: times RMSE (and relMSE) below the noisy one.")
    head("scene", "samples", "light, measured noise", "light, given (0.6, 1.5)", "light, given (0.19, 1.5)",
         "radiance, measured noise")
    for scene, samples in STACKS + SINGLE:
        row(scene, samples, cell(study.factors(scene, samples)),
            cell(study.factors(scene, samples, noise="given", s=0.6, p=1.5)),
            cell(study.factors(scene, samples, noise="given", s=0.19, p=1.5)),
            cell(study.factors(scene, samples, "radiance")))
    print("\nOther strengths: times RMSE below the noisy one.")
    strengths = (0.7, 1.0, 1.4, 2.0)
    head("scene", "samples", *strengths)
    for scene, samples in STACKS + SINGLE:
        row(scene, samples, *(f"{study.factors(scene, samples, strength=s)[0]:.2f}" for s in strengths))


def channels(study):
    print("\nAxes: times RMSE (and relMSE) below the noisy one.")
    head("scene", "samples", "log R, G, B", "log-opponent, all", "log-opponent, luminance alone")
    for scene, samples in SINGLE:
        row(scene, samples, cell(study.factors(scene, samples)),
            cell(study.factors(scene, samples, opponent="true")),
            cell(study.factors(scene, samples, opponent="true", cored="first")))


def means(study):
    print("\nMean after filtering, as a share of the mean before.")
    head("scene", "samples", "light", "light without the energy stage", "beauty")
    for scene, samples in STACKS + SINGLE:
        light, beauty = study.figures(scene, samples, ["mean_of_light", "mean_of_beauty"])
        (without,) = study.figures(scene, samples, ["mean_of_light"], energy=0)
        row(scene, samples, *(f"{t['brightness_ratio']:.5f}" for t in (light, without, beauty)))


def clean(study):
    print("\nThe reference filtered: RMSE as a share of the noisy render's.")
    head("scene", "of 16 samples", "of 64 samples")
    for scene in ("cornell", "interior", "caustics", "dof"):
        (filtered,) = study.figures(scene, "clean", ["light"])
        row(scene, *(f"{filtered['rmse'] / study.figures(scene, n, ['noisy'])[0]['rmse']:.2f}"
                     for n in ("16", "64")))


def growth(study):
    print("\nDeviation of the noise in the upright bands of a level, as a multiple of the level before.")
    head("scene", "samples", "level 2", "level 3", "measured shapes p")
    for scene, samples in SINGLE:
        passes = study.inputs(scene, samples)
        study.run("bayesian_wavelet_bands.yaml",
                  {"noisy": passes["diffuse_indirect"], "clean": passes["reference_indirect"]},
                  {"deviation": study.work / "deviation.json"}, {"levels": 3})
        tables = [json.loads((study.work / f"deviation.{i}.json").read_text()) for i in range(13)]
        level = [math.hypot(tables[1 + 4 * i]["deviation"], tables[3 + 4 * i]["deviation"]) for i in range(3)]
        shapes = [t["p_c"] for t in tables]
        row(scene, samples, f"{level[1] / level[0]:.2f}", f"{level[2] / level[1]:.2f}",
            f"{min(shapes):.2f} to {max(shapes):.2f}")


def bands(study, pictures):
    for scene, samples in (("interior", "16"), ("cornell", "16")):
        files = {name: study.work / f"{name}.json"
                 for name in ("signal", "noise", "histogram_signal", "histogram_noise")}
        passes = study.inputs(scene, samples)
        study.run("bayesian_wavelet_bands.yaml",
                  {"noisy": passes["diffuse_indirect"], "clean": passes["reference_indirect"]}, files, {})
        tables = {name: [json.loads((study.work / f"{name}.{i}.json").read_text()) for i in range(9)]
                  for name in files}
        print(f"\n{scene}, {samples} samples: bands of the logarithm of light (luminance).")
        head("band", "s of the signal", "p", "fitting error", "s of the noise", "p", "fitting error")
        for signal, noise in zip(tables["signal"], tables["noise"]):
            row(signal["band"], *(f"{t[k]:.4f}" for t in (signal, noise) for k in ("s", "p", "fitting_error")))
        if pictures:
            histograms(pictures / f"bayesian-wavelet-bands-{scene}.svg", tables)


def histograms(path, tables):
    """Observed (red) and fitted (blue) densities of each band, on a logarithmic scale."""
    width, height, margin, columns = 190, 120, 18, 5
    svg = []
    for line, kind in enumerate(("histogram_signal", "histogram_noise")):
        for column, table in enumerate(tables[kind]):
            x0 = column % columns * (width + margin) + margin
            y0 = (2 * line + column // columns) * (height + 2 * margin) + margin
            reach = -table[0]["x"]
            logs = [math.log10(r[k]) for r in table for k in ("observed", "fitted") if r[k] > 0]
            top = max(logs)
            bottom = max(min(logs), top - 5)

            def points(key):
                at = []
                for r in table:
                    y = math.log10(r[key]) if r[key] > 0 else bottom
                    at.append(f"{x0 + (r['x'] / reach + 1) * width / 2:.1f},"
                              f"{y0 + (top - max(y, bottom)) / (top - bottom) * height:.1f}")
                return " ".join(at)

            title = f"{table[0]['band']}, {'signal' if line == 0 else 'noise'}, ±{reach:.2f}"
            svg.append(f'<rect x="{x0}" y="{y0}" width="{width}" height="{height}" fill="none" stroke="#999"/>')
            svg.append(f'<text x="{x0}" y="{y0 - 4}" font-size="11" font-family="sans-serif">{title}</text>')
            svg.append(f'<polyline points="{points("observed")}" fill="none" stroke="#c33"/>')
            svg.append(f'<polyline points="{points("fitted")}" fill="none" stroke="#36c"/>')
    w, h = columns * (width + margin) + margin, 4 * (height + 2 * margin)
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {w} {h}">\n'
                    f'<rect width="{w}" height="{h}" fill="#fff"/>\n' + "\n".join(svg) + "\n</svg>\n")


def renders(study, pictures):
    """Noisy, filtered and reference side by side: the indirect component."""
    for scene, samples, exposure in (("interior", "64", 1.0), ("cornell", "8×1", 1.5)):
        files = {name: study.work / f"{name}.exr" for name in ("before", "after", "reference")}
        graph = "bayesian_wavelet_stack.yaml" if samples == "8×1" else "bayesian_wavelet.yaml"
        study.run(graph, study.inputs(scene, samples), files, {})
        side = [str(f) for f in files.values()]
        command = ["oiiotool", *side, "--mosaic:pad=4", "3x1", "--mulc", str(exposure), "--clamp:min=0:max=1",
                   "--powc", "0.4545", "-d", "uint8", "-o", str(pictures / f"bayesian-wavelet-{scene}.png")]
        subprocess.run(command, check=True)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("scenes", type=pathlib.Path)
    arguments.add_argument("parts", nargs="*", metavar="PART")
    arguments.add_argument("--rayloom", default=str(HERE.parent.parent / "build/bin/rayloom"))
    arguments.add_argument("--pictures", type=pathlib.Path)
    given = arguments.parse_intermixed_args()
    parts = given.parts or ["errors", "channels", "means", "clean", "growth", "bands"]
    with tempfile.TemporaryDirectory() as work:
        study = Study(given.scenes, given.rayloom, pathlib.Path(work))
        for part in parts:
            if part == "bands":
                bands(study, given.pictures)
            else:
                {"errors": errors, "channels": channels, "means": means, "clean": clean, "growth": growth}[part](study)
        if given.pictures:
            renders(study, given.pictures)


if __name__ == "__main__":
    main()
