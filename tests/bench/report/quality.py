# SPDX-License-Identifier: Apache-2.0
"""Error and time of every graph on every scene at every sample count, beside plain Monte Carlo."""

import shutil
import tempfile
import pathlib

import scenes as scene_files
from common import BenchError, file_hash, finite, run, say

PLAIN = "plain Monte Carlo"
MEASURES = ["rmse", "relmse", "relmse_trimmed", "psnr", "psnr_clamped", "smape", "ssim", "flip", "hdr_flip",
            "max_abs_error", "brightness_ratio"]


def display_png(image, png, layer=None):
    """The image as a display shows it: radiance clamped to [0, 1], through sRGB's transfer."""
    names = f"{layer}.R,{layer}.G,{layer}.B" if layer else "R,G,B"
    run(["oiiotool", image, "--ch", names, "--chnames", "R,G,B", "--clamp:min=0:max=1",
         "--colorconvert", "linear", "sRGB", "-d", "uint8", "-o", png])


def beauty_layer(scene, program, file):
    for layer in scene.info(program, file)["layers"]:
        if "beauty" in layer["roles"] and layer["channels"][:3] == ["R", "G", "B"]:
            return layer["layer"]
    return None


def image_name(*parts):
    return "-".join(str(p).replace("/", "_").replace(" ", "_") for p in parts) + ".png"


class Quality:
    def __init__(self, program, results, repeats=3, threads=0):
        self.program, self.results, self.repeats, self.threads = program, results, repeats, threads
        self.images = results.folder / "images"
        self.images.mkdir(exist_ok=True)

    def reference_png(self, scene):
        name = image_name(scene.name, "reference")
        if not (self.images / name).exists():
            display_png(scene.reference, self.images / name,
                        beauty_layer(scene, self.program, scene.reference))
        return name

    def measure(self, scene, image, label, spp, layer=None):
        """All errors, and the PNGs of the image and of its FLIP map. FLIP's maps span 0 … 1 in every
        case, so that methods can be compared by eye."""
        name, error = image_name(scene.name, label, spp), image_name(scene.name, label, spp, "flip")
        display_png(image, self.images / name, layer)
        errors = self.program.compare(image, scene.reference, "--map", self.images / error,
                                      "--map-kind", "flip")
        return errors, {"image": name, "error": error, "reference": self.reference_png(scene)}

    def plain(self, scene, spp, from_stack, folder):
        """The noisy image itself: mean of the stack's first `spp`, or noisy_<spp>."""
        files = scene.stack[:spp] if from_stack else [scene.file("noisy", spp)]
        key = "quality:" + file_hash(*files, scene.reference) + ":" + self.program.identity
        image = folder / f"{scene.name.replace('/', '_')}_{spp}_{'stack' if from_stack else 'file'}.exr"
        what = f"{PLAIN}|{scene.name}|{spp}|{'stack' if from_stack else 'file'}"
        line = self.results.known(key)
        if line is None and from_stack:
            self.program.run_graph(scene_files.HERE / "mean-of-stack.yaml",
                                   [f"stack={scene.stack_input(spp)}"], f"image={image}")
        image = image if from_stack else files[0]
        if line is None:
            per_sample, source = scene.seconds_per_sample(self.program)
            layer = None if from_stack else beauty_layer(scene, self.program, image)
            errors, pictures = self.measure(scene, image, PLAIN, f"{spp}{'' if from_stack else 'f'}", layer)
            line = self.results.add(
                "quality", key, what=what, graph=PLAIN, scene=scene.name, spp=spp,
                source="stack" if from_stack else image.name, pixels=errors["pixels"], errors=errors,
                seconds_per_sample=per_sample, render_time_source=source,
                render_seconds=None if per_sample is None else per_sample * spp,
                reference_rmse=scene.note.get("reference_rmse"), title=scene.note.get("title"),
                pictures=pictures)
        return line

    def case(self, case, folder):
        plain = self.plain(case.scene, case.spp, case.uses_stack, folder)
        key = ("quality:" + file_hash(case.graph["file"], *case.files, case.scene.reference) + ":" +
               self.program.identity + f":{self.threads}")
        if self.results.known(key):
            return False
        out = folder / "result.exr"
        options = ["--threads", self.threads] if self.threads else []
        seconds, cpu, rss, peak = [], [], 0, 0
        spent = 0.0
        # What takes long is not noisy; what is over at once is measured again.
        while len(seconds) < self.repeats and (not seconds or spent < 4.0):
            report, done = self.program.run_graph(case.graph["file"], case.inputs,
                                                  f"{case.output}={out}", options)
            seconds.append(report["seconds"])
            cpu.append(done.cpu)
            rss, peak = max(rss, done.max_rss), max(peak, report["peak_bytes"])
            spent += done.wall
        errors, pictures = self.measure(case.scene, out, case.graph["graph"], case.spp)
        noisy_errors = plain["errors"]
        per_sample, source = case.scene.seconds_per_sample(self.program)
        best = min(seconds)
        equal_time = None
        if per_sample:
            # Plain Monte Carlo that renders on for as long as the graph runs: squared error falls
            # as 1/samples.
            equal_time = noisy_errors["relmse"] / (1.0 + best / (per_sample * case.spp))
        self.results.add(
            "quality", key, what=f"{case.graph['graph']}|{case.scene.name}|{case.spp}",
            graph=case.graph["graph"], scene=case.scene.name, spp=case.spp,
            source="stack" if case.uses_stack else "noisy file",
            pixels=errors["pixels"], seconds=seconds, cpu_seconds=cpu, threads=report["threads"],
            peak_bytes=peak, max_rss=rss, errors=errors, noisy_errors=noisy_errors,
            equal_error_factor=noisy_errors["relmse"] / errors["relmse"] if errors["relmse"] else None,
            seconds_per_sample=per_sample, render_time_source=source,
            render_seconds=None if per_sample is None else per_sample * case.spp,
            equal_time_relmse=equal_time, inputs=[i.split("=")[0] for i in case.inputs],
            reference_rmse=case.scene.note.get("reference_rmse"), title=case.scene.note.get("title"),
            pictures=pictures)
        return True

    def run(self, data, graph_folder, only=None, spp=None):
        scenes = scene_files.find_scenes(data)
        possible, impossible = scene_files.cases(self.program, graph_folder, scenes, only, spp)
        folder = pathlib.Path(tempfile.mkdtemp(prefix="rayloom-bench-"))
        try:
            for scene in scenes:
                for count in scene.stack_spp():
                    if not spp or count in spp:
                        self.plain(scene, count, True, folder)
                for count in scene.single_spp():
                    if not spp or count in spp:
                        self.plain(scene, count, False, folder)
            for number, case in enumerate(possible, 1):
                try:
                    fresh = self.case(case, folder)
                except BenchError as e:
                    say(f"[{number}/{len(possible)}] {case.name}: {e.reason()}")
                    impossible.append({"graph": case.graph["graph"], "scene": case.scene.name,
                                       "reason": "failed: " + e.reason(),
                                       "spp": [str(case.spp)], "never": False})
                    continue
                line = self.results.latest("quality")
                line = next(x for x in line if x["what"] == f"{case.graph['graph']}|{case.scene.name}|{case.spp}")
                factor = line["equal_error_factor"]
                say(f"[{number}/{len(possible)}] {case.name} spp: {min(line['seconds']):.2f} s, "
                    f"relMSE {line['errors']['relmse']:.4g}, as {factor:.1f} times the samples"
                    + ("" if fresh else " (known)") if finite(factor) else f"{case.name}: no factor")
            for item in impossible:
                self.results.add("not_applicable", "", what=f"{item['graph']}|{item['scene']}|{item['reason']}",
                                 **item)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        return impossible
