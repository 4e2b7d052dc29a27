# SPDX-License-Identifier: Apache-2.0
"""Scenes found in a folder, and which files of a scene a graph's inputs are. docs/benchmark.md has
the layout."""

import json
import pathlib
import re

from common import BenchError, run

HERE = pathlib.Path(__file__).resolve().parent
# Graphs for which the rules below do not do: see "cases.json" in docs/benchmark.md.
CASES = json.loads((HERE / "cases.json").read_text())


def seconds_of(clock):
    """"01:02.34" or "1:02:03.4" in seconds."""
    total = 0.0
    for part in clock.strip('" ').split(":"):
        total = 60 * total + float(part)
    return total


class Scene:
    def __init__(self, name, folder, reference):
        self.name, self.folder, self.reference = name, folder, reference
        note = folder / "scene.json"
        self.note = json.loads(note.read_text()) if note.exists() else {}
        self.stack = self._numbered("stack")
        self.stack_passes = self._numbered("stack_passes")
        self._infos = {}
        self._seconds = None

    def _numbered(self, what):
        """A file that is not there ends the stack: what counts are s01 … sNN without a gap."""
        files = sorted((self.folder / what).glob("s[0-9][0-9].exr"))
        return [f for k, f in enumerate(files, 1) if f.name == f"s{k:02d}.exr"]

    def stack_of(self, program, role):
        """The stack whose files hold a role; light passes may lie in a stack of their own."""
        for files in (self.stack, self.stack_passes):
            if files and (not role or role in self.roles(program, files[0])):
                return files
        return []

    def file(self, what, spp):
        """The file of one kind at one sample count, e.g. noisy_16.exr."""
        short = self.folder.name
        names = [f"{what}_{spp}.exr"]
        if what == "noisy":
            names.append(f"{short}_{spp}.exr")
        if what == "histogram":
            names.append(f"{short}_{spp}_hist.exr")
        return next((self.folder / n for n in names if (self.folder / n).is_file()), None)

    def single_spp(self):
        """Sample counts of which there is a noisy render."""
        found = set()
        for file in self.folder.glob("*.exr"):
            match = re.fullmatch(rf"(?:noisy|{re.escape(self.folder.name)})_(\d+)\.exr", file.name)
            if match:
                found.add(int(match.group(1)))
        return sorted(found)

    def stack_spp(self):
        return [n for n in (2 ** k for k in range(2, 7)) if n <= len(self.stack)]

    def stack_input(self, count, what="stack"):
        return f"{self.folder}/{what}/s%02d.exr@1-{count}"

    def info(self, program, file):
        if file not in self._infos:
            self._infos[file] = program.json("info", "--json", file)
        return self._infos[file]

    def roles(self, program, file):
        found = {role for layer in self.info(program, file)["layers"] for role in layer["roles"]}
        return found | {"beauty"}  # the default layer, where no renderer's names say which it is

    def layers(self, program, file):
        return {layer["layer"] for layer in self.info(program, file)["layers"]}

    def pixels(self, program):
        window = self.info(program, self.reference)["parts"][0]["data_window"]
        return window["width"] * window["height"]

    def seconds_per_sample(self, program):
        """Seconds a renderer needs for one sample of every pixel of this window, and where that is
        from. Of all files that say how long they took, the one with most samples: what rendering
        costs once (loading, building) is shared by more of them."""
        if self._seconds is None:
            self._seconds = self._read_seconds(program)
        return self._seconds

    def _read_seconds(self, program):
        best = None
        files = [(spp, self.file("noisy", spp)) for spp in self.single_spp()]
        files += [(1, f) for f in self.stack[:1]]
        for spp, file in files:
            if file is None:
                continue
            text = run(["oiiotool", "--info", "-v", file]).out
            found = re.search(r'cycles\.\S+\.render_time: "([\d:.]+)"', text)
            if found is None:
                found = re.search(r'\bRenderTime: "([\d:.]+)"', text)
            samples = re.search(r'cycles\.\S+\.samples: "(\d+)"', text)
            if found and (best is None or spp > best[0]):
                best = (spp, seconds_of(found.group(1)) / int(samples.group(1) if samples else spp),
                        file.name)
        if best is None:
            return None, "no file of the scene says how long it rendered"
        share = 1.0
        if self.note.get("rendered_pixels"):
            share = self.pixels(program) / self.note["rendered_pixels"]
        text = f"render time in {best[2]}"
        if share != 1.0:
            text += f", times {share:.3f} (share of the rendered image)"
        return best[1] * share, text


def find_scenes(data):
    """Every folder at or below `data` (two levels) that has a reference."""
    data = pathlib.Path(data).resolve()
    if not data.is_dir():
        raise BenchError(f"{data}: there is no such folder of scenes")
    scenes = []
    for folder in [data, *sorted(data.glob("*/")), *sorted(data.glob("*/*/"))]:
        for reference in (folder / "ref.exr", folder / f"{folder.name}_ref.exr"):
            if reference.is_file():
                name = folder.name if folder == data else str(folder.relative_to(data))
                scenes.append(Scene(name, folder, reference))
                break
    if not scenes:
        raise BenchError(f"{data}: no folder in it has a ref.exr; docs/benchmark.md has the layout")
    return scenes


class Case:
    """A graph on a scene at a sample count."""

    def __init__(self, graph, scene, spp, inputs, files, output, uses_stack):
        self.graph, self.scene, self.spp = graph, scene, spp
        self.inputs = inputs  # what follows -i
        self.files = files  # the files behind them
        self.output = output  # name of the graph's output
        self.uses_stack = uses_stack

    @property
    def name(self):
        return f"{self.graph['graph']} {self.scene.name} {self.spp}"

    def with_inputs(self, inputs):
        """The same with other files."""
        return Case(self.graph, self.scene, self.spp, inputs, self.files, self.output, self.uses_stack)


class NotApplicable(Exception):
    pass


def bind(program, graph, scene, spp):
    """A Case, or NotApplicable with the reason.

    A list with a role is the stack (or stack_passes) whose files have it; an image with a role is that
    layer of noisy_<spp>.exr, an image named `render` all of that file; any other image is <input>_<spp>.exr or the part of flash_<spp>.exr of that name. Optional inputs are given
    when their file is there, but the beauty only once."""
    table = CASES.get(graph["graph"], {})
    if "not_applicable" in table:
        raise NotApplicable(table["not_applicable"])
    wanted = table.get("inputs")
    inputs, files, beauty, uses_stack = [], [], False, False
    for port in graph["inputs"]:
        name, role = port["name"], port["role"]
        if wanted is not None and name not in wanted:
            continue
        required = port["required"] or wanted is not None
        is_beauty = role == "beauty"
        value, missing = None, None
        noisy, own = scene.file("noisy", spp), scene.file(name, spp)
        if port["kind"] == "list":
            stack = scene.stack_of(program, role)
            if not required and (beauty or name != "stack"):
                continue
            if not stack:
                missing = f"'{role}' in the files of a stack" if role else "stack"
            elif len(stack) < spp:
                missing = f"stack of {spp} renders with '{role}'"
            else:
                value, uses_stack = scene.stack_input(spp, stack[0].parent.name), True
                files += stack[:spp]
        elif name == "render" and not role and port["kind"] != "deep":
            if noisy is None:
                missing = f"noisy_{spp}.exr"
            else:
                value, beauty = str(noisy), True
                files.append(noisy)
        elif port["kind"] == "deep" or not role or (is_beauty and not required):
            flash = scene.file("flash", spp)
            if is_beauty and beauty and not required:
                continue
            if own is not None:
                value = str(own)
                files.append(own)
            elif port["kind"] == "image" and flash is not None and name in scene.layers(program, flash):
                value = f"{flash}:{name}"
                files.append(flash)
            else:
                missing = f"{name}_{spp}.exr"
        else:
            if noisy is None:
                missing = f"noisy_{spp}.exr"
            elif role not in scene.roles(program, noisy):
                missing = f"'{role}' in {noisy.name}"
            else:
                value = str(noisy)
                files.append(noisy)
        if value is None:
            if required:
                raise NotApplicable(f"input '{name}': the scene has no {missing}")
            continue
        beauty = beauty or is_beauty
        inputs.append(f"{name}={value}")
    if not beauty:
        raise NotApplicable("no input of the graph is the noisy render")
    outputs = [o["name"] for o in graph["outputs"] if o["kind"] in (None, "image")]
    output = table.get("output") or ("image" if "image" in outputs else outputs[0] if outputs else None)
    if output is None:
        raise NotApplicable("the graph makes no image")
    return Case(graph, scene, spp, inputs, sorted(set(files)), output, uses_stack)


def graphs(program, folder, only=None):
    """Graph files of a folder with name, inputs and outputs."""
    found = []
    for file in sorted(pathlib.Path(folder).glob("*.yaml")):
        graph = program.graph(file)
        if not only or graph["graph"] in only:
            found.append(graph)
    if only and len(found) < len(set(only)):
        names = {g["graph"] for g in found}
        raise BenchError("there is no graph " + ", ".join(sorted(set(only) - names)))
    return found


def cases(program, graph_folder, scenes, only=None, spp=None):
    """All that can run, and what cannot: {"graph", "scene", "reason"}."""
    possible, impossible = [], []
    for graph in graphs(program, graph_folder, only):
        for scene in scenes:
            reasons, found = {}, False
            counts = sorted(set(scene.stack_spp()) | set(scene.single_spp()))
            for count in counts:
                if spp and count not in spp:
                    continue
                try:
                    possible.append(bind(program, graph, scene, count))
                    found = True
                except NotApplicable as e:
                    reasons[count] = str(e)
            for reason in dict.fromkeys(reasons.values()):
                at = [str(n) for n, r in reasons.items() if r == reason]
                impossible.append({"graph": graph["graph"], "scene": scene.name, "reason": reason,
                                   "spp": at, "never": not found})
    return possible, impossible
