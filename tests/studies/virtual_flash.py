#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/methods/virtual-flash.md.

SCENES holds cornell, caustics, interior and dof, each with stack/sNN.exr (1 sample a pixel), flash_16.exr and
ref.exr, dof also anim/; and scripts/, which rendered them. Seeds that a stack lacks up to 128 are taken from
SEEDS/SCENE/stack/sNN.exr, and rendered there by Blender 3.4 where they are not (some 10 s each; without --seeds in a
folder that is removed in the end). Without Blender the rows of so many samples are left out.
"""
import argparse
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
SCENES = ["cornell", "caustics", "interior", "dof"]
SAMPLES = [4, 8, 16, 32, 64, 128]
READINGS = ["noisy", "nlm", "first", "single", "a", "b", "c", "d"]
# Table 1 of the paper.
PAPER = {4: ".855 / .899 / .921", 16: ".901 / .929 / .943", 32: ".921 / .945 / .956", 64: ".938 / .960 / .968",
         128: ".942 / .964 / .972"}


def short(value):
    """Three digits, no zero before the point."""
    text = f"{value:.3g}" if value >= 1 else f"{value:.3f}" if value >= 0.1 else f"{value:.4f}"
    return text.removeprefix("0")


def row(*cells):
    print("|", " | ".join(str(c) for c in cells), "|", flush=True)


class Study:
    def __init__(self, scenes, build, seeds, work):
        self.scenes, self.seeds, self.work = scenes, seeds, work
        self.rayloom = build / "bin" / "rayloom"

    def stack(self, scene, samples):
        """A pattern for that many renders, or None."""
        folder = self.work / "stacks" / scene
        folder.mkdir(parents=True, exist_ok=True)
        missing = []
        for seed in range(1, samples + 1):
            name = f"s{seed:02d}.exr"
            link, extra = folder / name, self.seeds / scene / "stack" / name
            if link.exists():
                continue
            own = self.scenes / scene / "stack" / name
            link.symlink_to(own if own.exists() else extra)
            if not link.exists():
                missing.append(seed)
        if missing and shutil.which("blender"):
            self.render(scene, missing)
        return f"{folder}/s%02d.exr@1-{samples}" if (folder / f"s{samples:02d}.exr").exists() else None

    def render(self, scene, seeds):
        scripts = self.work / "rendered" / "scripts"
        if not scripts.exists():
            shutil.copytree(self.scenes / "scripts", scripts)
        subprocess.run(["blender", "-b", "--factory-startup", "-t", "1", "-P", HERE / "virtual_flash_seeds.py", "--",
                        scripts, scene, self.seeds / scene / "stack", *map(str, seeds)], check=True,
                       stdout=subprocess.DEVNULL)

    def inputs(self, scene, stack):
        flash = self.scenes / scene / "flash_16.exr"
        return ["-i", f"stack={stack}:Combined", "-i", f"partial={flash}:partial_d1",
                "-i", f"flash_unit={flash}:flash_unit"]

    def run(self, *arguments):
        subprocess.run([self.rayloom, "run", *map(str, arguments), "-q"], check=True, stdout=subprocess.DEVNULL)

    def figures(self, graph, scene, stack, outputs, settings=()):
        """{output: {figure: value}}"""
        arguments = [HERE / graph, *self.inputs(scene, stack), "-i",
                     f"reference={self.scenes}/{scene}/ref.exr:Combined"]
        for setting in settings:
            arguments += ["-p", setting]
        for output in outputs:
            arguments += ["-o", f"{output}={self.work}/{output}.json"]
        self.run(*arguments)
        result = {}
        for output in outputs:
            figures = json.loads((self.work / f"{output}.json").read_text())
            result[output] = figures[0] if isinstance(figures, list) else figures
        return result

    @staticmethod
    def brightness(figures):
        """Mean of the result over that of the input."""
        return f"{figures['d']['brightness_ratio'] / figures['noisy']['brightness_ratio']:.3f}"

    def compare(self, image, reference):
        done = subprocess.run([self.rayloom, "compare", str(image), str(reference), "--no-flip", "--json"], check=True,
                              capture_output=True, text=True)
        figures = json.loads(done.stdout)
        return figures[0] if isinstance(figures, list) else figures

    def readings(self):
        """Second step and error: one run for both tables."""
        every = []
        for scene, samples, stack in self.stacks():
            f = self.figures("virtual_flash_readings.yaml", scene, stack, READINGS)
            before = self.figures("virtual_flash_readings.yaml", scene, stack, ["d"],
                                  ["outliers=0", "floor=0", f"narrow_samples={samples}"])
            self.run("ray-histogram-fusion-stack", "-i", f"stack={stack}:Combined", "-o", f"image={self.work}/rhf.exr")
            rhf = self.compare(self.work / "rhf.exr", f"{self.scenes}/{scene}/ref.exr:Combined")
            every.append((scene, samples, f, before["d"], rhf))
        print("\nThe second step\n")
        row("scene", "samples", "noisy", "7×7 only", "31×31 only", "(a)", "(b)", "(c)", "(d)", "brightness of (d)")
        for scene, samples, f, _, _ in every:
            row(scene, samples, *(short(f[k]["relmse"]) for k in READINGS if k != "nlm"),
                self.brightness(f))
        print("\nError\n")
        row("scene", "samples", "noisy", "NLM", "RHF", "before", "virtual flash", "gain")
        for scene, samples, f, before, rhf in every:
            row(scene, samples, short(f["noisy"]["relmse"]), short(f["nlm"]["relmse"]), short(rhf["relmse"]),
                short(before["relmse"]), short(f["d"]["relmse"]), f"{f['noisy']['relmse'] / f['d']['relmse']:.0f}")

    def gates(self):
        row("scene", "samples", "the paper's", "", "one-sample", "", "two-sample", "", "none", "")
        for scene, samples, stack in self.stacks():
            if samples not in (4, 16, 64):
                continue
            cells = []
            for settings in (["gate=one-sample", "outliers=0", "floor=0", f"narrow_samples={samples}"],
                             ["gate=one-sample"], ["gate=two-sample"], ["gate=none"]):
                f = self.figures("virtual_flash_readings.yaml", scene, stack, ["noisy", "d"], settings)
                cells += [short(f["d"]["relmse"]), self.brightness(f)]
            row(scene, samples, *cells)

    def albedo(self):
        row("scene", "samples", "without", "with")
        for scene, samples, stack in self.stacks():
            cells = []
            for albedo in [], ["-i", f"albedo={self.scenes}/{scene}/noisy_16.exr:Denoising Albedo"]:
                self.run("virtual-flash", *self.inputs(scene, stack), *albedo, "-o", f"image={self.work}/image.exr")
                cells.append(self.error(self.work / "image.exr", scene))
            row(scene, samples, *cells)

    def guided(self):
        """nlm-guided with and without splitting fireflies off, by albedo and by the render itself."""
        row("scene", "samples", "albedo, kept", "albedo, split", "itself, kept", "itself, split")
        for scene, samples, stack in self.stacks():
            cells = []
            for guide in ["-i", f"guide={self.scenes}/{scene}/noisy_16.exr:Denoising Albedo"], []:
                for outliers in 0, 0.2:
                    self.run("nlm-guided", "-i", f"stack={stack}:Combined", *guide, "-p", f"outliers={outliers}",
                             "-o", f"image={self.work}/image.exr")
                    cells.append(self.error(self.work / "image.exr", scene))
            row(scene, samples, *cells)

    def frames(self):
        """virtual-flash-sequence on single frames without statistics, fireflies kept and split off."""
        row("scene", "samples", "kept", "split")
        for scene in SCENES:
            for samples, albedo in (4, 16), (16, 16), (64, 64):
                folder = self.scenes / scene
                cells = []
                for outliers in 0, 0.2:
                    self.run("virtual-flash-sequence", "-i", f"frame={folder}/noisy_{samples}.exr:Combined", "-i",
                             f"guide={folder}/noisy_{albedo}.exr:Denoising Albedo", "-p", f"samples={samples}",
                             "-p", f"outliers={outliers}", "-o", f"image={self.work}/image.exr")
                    cells.append(self.error(self.work / "image.exr", scene))
                row(scene, samples, *cells)

    def stacks(self):
        for scene in SCENES:
            for samples in SAMPLES:
                stack = self.stack(scene, samples)
                if stack:
                    yield scene, samples, stack

    def error(self, image, scene):
        f = self.compare(image, f"{self.scenes}/{scene}/ref.exr:Combined")
        return f"{short(f['relmse'])} ({short(f['relmse_trimmed'])})"

    def coverage(self):
        row("samples", "paper", *SCENES)
        for samples, paper in PAPER.items():
            cells = []
            for scene in SCENES:
                stack = self.stack(scene, samples)
                shares = [self.figures("virtual_flash_coverage.yaml", scene, stack, ["coverage"],
                                       [f"confidence={c}"])["coverage"] for c in (0.95, 0.98, 0.99)] if stack else []
                cells.append(" / ".join(short(s["interval"]) for s in shares)
                             + f" ({short(shares[-1]['bound'])})" if shares else "")
            row(samples, paper, *cells)

    def sequence(self):
        frame = f"{self.scenes}/dof/anim/f%02d_16.exr"
        row("frames on either side", "relMSE of the middle frame", "without the worst 0.1 %",
            "flicker: relMSE / SMAPE between neighbouring results")
        for reach in 0, 1, 3:
            image = f"{self.work}/reach{reach}.%d.exr"
            arguments = ["virtual-flash-sequence", "-i", f"frame={frame}:Combined", "-i",
                         f"guide={frame}:Denoising Albedo"]
            if reach == 0:  # a file without a place for the frame has no neighbours
                for f in range(1, 8):
                    self.run(*(str(a).replace("%02d", f"{f:02d}") for a in arguments), "-o",
                             f"image={image}" % f)
            else:
                for name, of, layer in (("before", f"-{reach}..-1", "Combined"), ("after", f"+1..+{reach}", "Combined"),
                                        ("guide_before", f"-{reach}..-1", "Denoising Albedo"),
                                        ("guide_after", f"+1..+{reach}", "Denoising Albedo")):
                    arguments += ["-i", f"{name}={frame}@{of}:{layer}"]
                self.run(*arguments, "--frames", "1-7", "-o", f"image={image}")
            middle = self.compare(image % 4, f"{self.scenes}/dof/ref.exr:Combined")
            pairs = [self.compare(image % f, image % (f + 1)) for f in range(1, 7)]
            mean = {k: sum(p[k] for p in pairs) / len(pairs) for k in ("relmse", "smape")}
            row(reach, short(middle["relmse"]), short(middle["relmse_trimmed"]),
                f"{short(mean['relmse'])} / {short(mean['smape'])}")


def main():
    parts = ["readings", "gates", "albedo", "guided", "coverage", "sequence", "frames"]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=pathlib.Path)
    parser.add_argument("what", nargs="*", metavar="WHAT", help=", ".join(parts) + " (all of them)")
    parser.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build"))
    parser.add_argument("--seeds", type=pathlib.Path)
    arguments = parser.parse_intermixed_args()
    for what in arguments.what:
        if what not in parts:
            parser.error(f"what is '{what}'? {', '.join(parts)}")
    with tempfile.TemporaryDirectory() as work:
        work = pathlib.Path(work)
        study = Study(arguments.scenes.resolve(), arguments.build.resolve(),
                      (arguments.seeds or work / "rendered").resolve(), work)
        for what in arguments.what or parts:
            print(f"\n{what}\n")
            getattr(study, what)()
    return 0


if __name__ == "__main__":
    sys.exit(main())
