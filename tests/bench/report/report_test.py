#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests of the benchmark's driver and of its report. Usage: report_test.py BUILD driver|browser
Ends with 77 when what the tests need is not on this machine (ctest: skipped)."""

import json
import math
import os
import pathlib
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
sys.dont_write_bytecode = True

import bench  # noqa: E402
import html_report  # noqa: E402
import kernels  # noqa: E402
import pages  # noqa: E402
import scenes  # noqa: E402
import svg  # noqa: E402
import common  # noqa: E402
from common import SOURCE, Program, Results, ratio_interval  # noqa: E402
from mirrored_exr import enlarge  # noqa: E402

BUILD = None
GRAPHS = ["--graph", "ray-histogram-fusion-stack", "--graph", "nlm-guided"]
CHROMIUM = next((p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if p), None)


def measured(folder):
    """A real run, small: one scene, one sample count, and kernels of made-up figures (kernels take
    too long here, and what is drawn of them does not hang on the figures)."""
    data = folder / "data"
    data.mkdir()
    (data / "interior").symlink_to(SOURCE / "tests/data/cycles/interior")
    code = bench.main(["quality", "--data", str(data), "--build", str(BUILD), "--out", str(folder / "out"),
                       *GRAPHS, "--spp", "4,8", "--repeats", "1"])
    assert code == 0, code
    results = Results(folder / "out")
    results.add("scaling", "a", graph="ray-histogram-fusion-stack", scene="interior", spp=4, width=100, height=100,
                threads=2, seconds=1.0, cpu_seconds=1.0, peak_bytes=2**24, max_rss=2**26)
    results.add("scaling", "b", graph="ray-histogram-fusion-stack", scene="interior", spp=4, width=100, height=100,
                threads=1, seconds=1.9, cpu_seconds=1.9, peak_bytes=2**24, max_rss=2**26)
    limits = {"triad": {"1": 1e10, "2": 1.5e10}, "mul_add": {"1": 1e11, "2": 2e11}, "fused": {"1": 2e11, "2": 4e11}}
    results.add("kernels", "k", limits=limits, entries=[
        {"name": "fuse.x/case/64x48", "threads": 1, "seconds": 1e-3, "intensity": 3.0, "flops_per_second": 2e10,
         "share_of_limit": 0.66, "bound_by": "memory", "ns_per_pixel": 3.0, "bytes_per_pixel": 8.0, "flops_per_pixel": 24.0},
        *({"name": f"fuse.y/node/width:1920/height:1080/threads:{threads}/process_time/real_time", "threads": threads,
           "seconds": 1.0, "real_seconds": real, "ns_per_pixel": 77.0,
           "bytes_per_pixel": 12.0, "flops_per_pixel": 3.0, "intensity": 0.25, "flops_per_second": 4e7,
           "share_of_limit": 0.08, "bound_by": "memory", "times_faster_than_oracle": 4.0} for threads, real in ((1, 1.0), (2, 0.55)))])
    ratio, low, high = ratio_interval([1.0, 1.1, 1.0], [0.9, 0.95, 0.92])
    results.add("against", "g", part="kernel", name="fuse.x/case", revision="abc", then=[1, 1.1, 1], now=[.9, .95, .92],
                ratio=ratio, low=low, high=high, verdict="faster")
    results.add("against", "h", part="kernel", name="fuse.z/new", revision="abc", verdict="only in the new build")
    results.add("skip", "s", kind_of_skip="cache", title="nothing changed, against an empty cache", graph="nlm-guided", seconds_with=[0.1],
                seconds_without=[0.2], cpu_with=[0.2], cpu_without=[0.4], peak_with=2**20, peak_without=2**22, equal_pixels=True,
                reasons={"its result is in the cache": {"nodes": ["first"], "pixels": 0, "saved_seconds": None}})
    html_report.write(results)
    return folder / "out"


class Statistics(unittest.TestCase):
    def test_interval_of_known_pairs(self):
        # Logarithms of the ratios: ln 2 + (-0.1, 0, 0.1); t(2) = 4.303, deviation 0.1.
        first, second = [1.0, 2.0, 3.0], [2 * math.exp(-0.1), 4.0, 6 * math.exp(0.1)]
        ratio, low, high = ratio_interval(first, second)
        half = 4.303 * 0.1 / math.sqrt(3)
        self.assertAlmostEqual(ratio, 2.0, 12)
        self.assertAlmostEqual(low, 2.0 * math.exp(-half), 12)
        self.assertAlmostEqual(high, 2.0 * math.exp(half), 12)

    def test_pareto_front(self):
        self.assertEqual(html_report.pareto([(3, 1), (1, 5), (2, 5), (2, 3), (4, 2)]), [(1, 5), (2, 3), (3, 1)])

    def test_ticks_are_labelled_and_inside(self):
        for low, high in ((1e-4, 3.0), (0.9, 1.1), (2.0, 2.0), (5, 5000)):
            axis = svg.Axis(low, high)
            labels = [v for v, text in axis.ticks() if text]
            self.assertGreaterEqual(len(labels), 1, (low, high))
            self.assertTrue(all(-1e-9 <= axis.at(v) <= 1 + 1e-9 for v in labels))
        self.assertEqual(svg.number(1e-5), "10⁻⁵")

    def test_roofline(self):
        limits = {"triad": {1: 1e10}, "mul_add": {1: 1e11}}
        line = {"name": "a/b/real_time", "cpu_time": 1.0, "real_time": 2.0, "time_unit": "ms", "items_per_second": 5e8,
                "flops_per_pixel": 4.0, "bytes_per_pixel": 8.0}
        out = kernels.figures(line, limits)  # 1e6 pixels in 1 ms of processor time
        self.assertEqual(out["pixels"], 1000000)
        self.assertAlmostEqual(out["flops_per_second"], 4e9)
        self.assertEqual(out["bound_by"], "memory")
        self.assertAlmostEqual(out["share_of_limit"], 4e9 / 5e9)
        by_cpu = kernels.figures({**line, "name": "a/plain_b"}, limits)  # the rate is by processor time
        self.assertEqual(by_cpu["pixels"], 500000)
        copy = kernels.figures({**line, "flops_per_pixel": 0.0}, limits)  # only memory bounds it
        self.assertAlmostEqual(copy["share_of_limit"], 8e9 / 1e10)
        pair = [{"name": "a/plain_b/16x8", "ns_per_pixel": 8.0, "threads": 1},
                {"name": "a/b/width:64/threads:1", "ns_per_pixel": 2.0, "threads": 1},
                {"name": "a/b/noise:4", "ns_per_pixel": 2.0, "threads": 1}]
        kernels.oracle_pairs(pair)
        self.assertEqual(pair[1]["times_faster_than_oracle"], 4.0)
        self.assertNotIn("times_faster_than_oracle", pair[2])

    def test_names_keep_clear_of_marks_and_of_one_another(self):
        plot = svg.Plot("", svg.Axis(1, 100), svg.Axis(1, 100), "", "")
        crowd = [(10 * 1.001 ** k, 10) for k in range(9)]  # all but on top of one another
        plot.labels([([m], f"name{k}", "#000") for k, m in enumerate(crowd)], crowd)
        boxes = []
        for text in plot.body:
            x, y, anchor = re.search(r'x="([\d.]+)" y="([\d.]+)".*text-anchor="(\w+)"', text).groups()
            left = float(x) - {"start": 0, "middle": 14, "end": 28}[anchor]
            boxes.append((left, float(y) - 7, left + 28, float(y)))
        self.assertGreater(len(boxes), 3)
        self.assertLess(len(boxes), 9)
        for k, a in enumerate(boxes):
            self.assertFalse(any(a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3] for b in boxes[:k]), boxes)
            for px, py in ((plot.px(x), plot.py(y)) for x, y in crowd):
                self.assertFalse(a[0] < px < a[2] and a[1] < py < a[3])

    def test_scenes_with_one_reason_share_a_row(self):
        data = lambda: None
        data.title, data.missing = str, [
            {"graph": "g", "scene": s, "spp": [str(n)], "reason": f"input 'color': the scene has no noisy_{n}.exr"} for s in "ab" for n in (4, 8)]
        self.assertEqual(html_report.missing_rows(data), [["g", "a, b", "4, 8", "input 'color': the scene has no noisy_N.exr"]])

    def test_render_times(self):
        self.assertAlmostEqual(scenes.seconds_of("00:02.94"), 2.94)
        self.assertAlmostEqual(scenes.seconds_of("1:02:03.5"), 3723.5)

    def test_broken_last_line_is_passed_over(self):
        with tempfile.TemporaryDirectory() as name:
            results = Results(name)
            results.add("quality", "k1", what="w")
            with results.path.open("a") as file:
                file.write('{"kind": "quality", "key": "k2", "cut sho')
            again = Results(name)
            again.add("quality", "k3", what="v")
            self.assertEqual([x["key"] for x in Results(name).lines], ["k1", "k3"])


class EnlargedFiles(unittest.TestCase):
    def test_mirrored_copies_keep_layers_parts_and_pixels(self):
        with tempfile.TemporaryDirectory() as name:
            for file in ("noisy_16.exr", "flash_16.exr"):  # layers of half and float; three parts
                source, large = SOURCE / "tests/data/cycles/interior" / file, pathlib.Path(name) / file
                enlarge(source, large, 250, 200)
                before, after = (Program(BUILD).json("info", "--json", f) for f in (source, large))
                layers = lambda info: [(x["layer"], x["channels"], x["type"]) for x in info["layers"]]
                self.assertEqual(layers(before), layers(after))
                self.assertEqual([(p["data_window"]["width"], p["data_window"]["height"]) for p in after["parts"]],
                                 [(250, 200)] * len(before["parts"]))
                # Where the copies lie, and which way round.
                for at, turn in (("96x96+0+0", []), ("96x96+96+0", ["--flop"]), ("96x96+96+96", ["--flop", "--flip"]),
                                 ("58x8+192+192", ["--cut", "58x8+0+0"])):
                    hashes = []
                    for f, do in ((large, ["--cut", at]), (source, turn)):
                        part = pathlib.Path(name) / "part.exr"
                        common.run(["oiiotool", "-a", f, *do, "--origin", "+0+0", "-o", part])
                        hashes.append(re.findall(r"SHA-1: (\w+)", common.run(["oiiotool", "-a", "--hash", part]).out))
                    self.assertEqual(len(hashes[0]), len(before["parts"]))
                    self.assertEqual(hashes[0], hashes[1], (file, at))


class Driver(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp())
        cls.out = measured(cls.folder)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def lines(self):
        return [json.loads(x) for x in (self.out / "results.jsonl").read_text().splitlines()]

    def test_every_line_says_where_it_is_from(self):
        for line in self.lines():
            for key in ("machine", "load", "date", "commit"):
                self.assertTrue(line[key], key)

    def test_figures_of_a_case(self):
        case = next(x for x in self.lines() if x["kind"] == "quality" and x["spp"] == 8 and
                    x["graph"] == "ray-histogram-fusion-stack")
        self.assertEqual(case["pixels"], 96 * 96)
        self.assertGreater(case["equal_error_factor"], 5)
        self.assertAlmostEqual(case["equal_error_factor"], case["noisy_errors"]["relmse"] / case["errors"]["relmse"])
        more = 1 + min(case["seconds"]) / case["render_seconds"]
        self.assertAlmostEqual(case["equal_time_relmse"], case["noisy_errors"]["relmse"] / more)
        self.assertGreater(case["max_rss"], case["peak_bytes"])
        # 2.9 s for 16 spp of 76800 pixels or thereabouts: the crop's share of it.
        self.assertLess(case["seconds_per_sample"], 0.1)

    def test_second_run_measures_nothing_again(self):
        before = [x for x in self.lines() if x["kind"] == "quality"]
        bench.main(["quality", "--data", str(self.folder / "data"), "--build", str(BUILD), "--out", str(self.out),
                    *GRAPHS, "--spp", "4,8", "--repeats", "1"])
        self.assertEqual([x for x in self.lines() if x["kind"] == "quality"], before)

    def test_a_graph_whose_inputs_are_missing_is_listed(self):
        possible, impossible = scenes.cases(Program(BUILD), SOURCE / "graphs", scenes.find_scenes(self.folder / "data"),
                                            ["ray-histogram-fusion"])
        self.assertEqual(possible, [])
        self.assertTrue(any("histogram_16" in i["reason"] and "16" in i["spp"] for i in impossible), impossible)

    def test_report_fetches_nothing(self):
        text = (self.out / "report.html").read_text()
        self.assertNotRegex(text, r'(src|href)\s*=\s*"(?!data:)')
        self.assertNotIn("http", re.sub(r'data:image/png;base64,[^"]*', "", text))

    def test_pages_keep_the_text_around(self):
        docs = self.folder / "docs"
        docs.mkdir()
        (docs / "accuracy.md").write_text(f"before\n{pages.BEGIN}\nold\n{pages.END}\nafter\n")
        pages.write(Results(self.out), docs)
        text = (docs / "accuracy.md").read_text()
        self.assertRegex(text, r"(?s)^before\n.*ray-histogram-fusion-stack.*\nafter\n$")
        self.assertNotIn("old", text)
        self.assertIn("| `fuse.y` | – | 77 | – | × 1.82 | 12 | 3 | 8 % (memory) | × 4 |", (docs / "performance.md").read_text())
        for page in ("accuracy.md", "performance.md"):
            for word in ("machine:", "load:", "date:", "commit:"):
                self.assertIn(word, (docs / page).read_text())


# What the browser is asked, at the end of a copy of the report; the answer is read from the page.
PROBE = """
<pre id="answer"></pre>
<script>
addEventListener("load", () => {
  const answer = {plots: {}, errors: window.seen};
  for (const plot of document.querySelectorAll("svg.plot")) {
    const frame = plot.getBoundingClientRect();
    const inside = (r) => r.left >= frame.left - 1 && r.right <= frame.right + 1 && r.top >= frame.top - 1 && r.bottom <= frame.bottom + 1;
    const marks = [...plot.querySelectorAll(".mark")].map((m) => m.getBoundingClientRect());
    answer.plots[plot.id] = {width: frame.width, height: frame.height, marks: marks.length,
      inside: marks.every((r) => r.width > 0 && inside(r)),
      labels: [...plot.querySelectorAll("text")].filter((t) => t.getBoundingClientRect().width > 0).length,
      ticksInside: [...plot.querySelectorAll(".tick, .axis")].every((t) => inside(t.getBoundingClientRect()))};
  }
  const box = document.getElementById("wipe").getBoundingClientRect();
  const over = document.getElementById("over");
  answer.sizes = [...document.querySelectorAll("#wipe img")].map((i) => [i.naturalWidth, i.naturalHeight]);
  answer.differ = document.getElementById("over").src !== document.getElementById("under").src;
  const press = (type, share) => document.getElementById("wipe").dispatchEvent(new PointerEvent(type,
    {clientX: box.left + share * box.width, clientY: box.top + 5, pointerId: 1, bubbles: true}));
  press("pointerdown", 0.25);
  answer.pressed = getComputedStyle(over).clipPath;
  press("pointermove", 0.75);
  answer.dragged = getComputedStyle(over).clipPath;
  press("pointerup", 0.75);
  press("pointermove", 0.1);
  answer.released = getComputedStyle(over).clipPath;
  const left = document.getElementById("left");
  answer.views = [];
  for (const option of left.options) {
    left.value = option.value;
    left.dispatchEvent(new Event("change"));
    answer.views.push(over.src.length);
  }
  left.value = "noisy";
  left.dispatchEvent(new Event("change"));
  const rows = [...document.querySelectorAll("#choices tbody tr")];
  answer.choices = rows.map((r) => r.dataset.graph);
  answer.figures = rows.map((r) => Number(r.cells[2].textContent));
  rows[rows.length - 1].click();
  answer.clicked = [document.getElementById("graph").value, ...rows.filter((r) => r.classList.contains("chosen")).map((r) => r.dataset.graph)];
  answer.clickedImage = document.getElementById("under").src.length;
  rows[0].click();
  answer.firstImage = document.getElementById("under").src.length;
  answer.onPaper = [...document.querySelectorAll("#four img")].map((i) => i.src.length);
  dispatchEvent(new Event("beforeprint"));
  answer.folded = [...document.querySelectorAll("details")].filter((d) => !d.open).length;
  answer.details = document.querySelectorAll("details").length;
  const slider = document.getElementById("position");
  slider.value = POSITION;
  slider.dispatchEvent(new Event("input"));
  answer.slid = getComputedStyle(over).clipPath;
  document.getElementById("answer").textContent = JSON.stringify(answer);
});
</script>
"""
# For pictures of the wipe alone: no waiting, so that what is painted first is already right.
ALONE = """
<script>
for (const image of document.querySelectorAll("#wipe img")) image.decoding = "sync";
const slider = document.getElementById("position");
slider.value = POSITION;
slider.dispatchEvent(new Event("input"));
const wipe = document.getElementById("wipe");
for (const part of document.querySelectorAll("main > *, #viewer > *")) if (!part.contains(wipe)) part.style.display = "none";
document.getElementById("viewer").style.margin = "0";
</script>
"""
CATCH = '<script>window.seen = []; addEventListener("error", (e) => window.seen.push(String(e.message)));</script>'


def png_rows(path):
    """Pixels of an 8-bit RGB or RGBA PNG, as rows of bytes and bytes per pixel."""
    data, at, packed = path.read_bytes(), 8, b""
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        if kind == b"IHDR":
            width, height, depth, colour = struct.unpack(">IIBB", data[at + 8:at + 18])
        if kind == b"IDAT":
            packed += data[at + 8:at + 8 + size]
        at += 12 + size
    assert depth == 8 and colour in (2, 6)
    step = 3 if colour == 2 else 4
    raw, stride, rows, above = zlib.decompress(packed), width * step, [], bytearray(width * step)
    for y in range(height):
        kind, row = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        for x in range(stride):
            a = row[x - step] if x >= step else 0
            b, c = above[x], above[x - step] if x >= step else 0
            if kind == 1:
                row[x] = (row[x] + a) & 255
            elif kind == 2:
                row[x] = (row[x] + b) & 255
            elif kind == 3:
                row[x] = (row[x] + (a + b) // 2) & 255
            elif kind == 4:
                p = a + b - c
                da, db, dc = abs(p - a), abs(p - b), abs(p - c)
                row[x] = (row[x] + (a if da <= db and da <= dc else b if db <= dc else c)) & 255
        rows.append(row)
        above = row
    return rows, step


class Browser(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp())
        cls.out = measured(cls.folder)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def chromium(self, *arguments):
        profile = tempfile.mkdtemp(dir=self.folder)
        done = subprocess.run([CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
                               "--disable-background-networking", "--disable-component-update", "--disable-sync",
                               "--hide-scrollbars", "--window-size=1200,900", f"--user-data-dir={profile}",
                               "--virtual-time-budget=10000", *arguments], capture_output=True, text=True, timeout=240)
        self.assertEqual(done.returncode, 0, done.stderr[-2000:])
        return done.stdout

    def probed(self, position, script=PROBE):
        text = (self.out / "report.html").read_text()
        file = self.folder / f"probe{position}.html"
        file.write_text(text.replace("<head>", "<head>" + CATCH, 1).replace(
            "</body>", script.replace("POSITION", str(position)) + "</body>"))
        return file

    def test_plots_are_drawn_and_the_wipe_works(self):
        page = self.chromium("--dump-dom", self.probed(30).as_uri())
        found = re.search(r'<pre id="answer"[^>]*>(.*?)</pre>', page, re.S)
        self.assertTrue(found and found.group(1), "the report's script did not come to its end")
        answer = json.loads(found.group(1).replace("&gt;", ">").replace("&lt;", "<").replace("&amp;", "&"))
        self.assertEqual(answer["errors"], [])
        self.assertEqual(set(answer["plots"]), {"plot-time-interior", "plot-spp-interior", "plot-roofline",
                                                "plot-scaling-seconds", "plot-scaling-cpu_seconds", "plot-scaling-max_rss",
                                                "plot-scaling-threads", "plot-against"})
        for name, plot in answer["plots"].items():
            self.assertGreater(plot["width"], 300, name)
            self.assertGreater(plot["marks"], 0, name)
            self.assertTrue(plot["inside"], name)
            self.assertTrue(plot["ticksInside"], name)
            self.assertGreater(plot["labels"], 4, name)
        self.assertGreaterEqual(answer["plots"]["plot-time-interior"]["marks"], 4)
        self.assertEqual(answer["sizes"], [[96, 96], [96, 96]])
        self.assertTrue(answer["differ"])
        self.assertIn("75%", answer["pressed"])
        self.assertIn("25%", answer["dragged"])
        self.assertEqual(answer["released"], answer["dragged"])
        self.assertIn("70%", answer["slid"])
        self.assertEqual(len(set(answer["views"])), 5)  # five pictures, none like another
        # The list beside it: best first, and a click shows that graph.
        self.assertEqual(set(answer["choices"]), {"ray-histogram-fusion-stack", "nlm-guided"})
        self.assertEqual(answer["figures"], sorted(answer["figures"]))
        self.assertEqual(answer["clicked"], [answer["choices"][-1]] * 2)
        self.assertNotEqual(answer["clickedImage"], answer["firstImage"])
        # On paper there is no wipe: four pictures, and nothing stays folded.
        self.assertEqual(len(set(answer["onPaper"])), 4)
        self.assertGreater(answer["details"], 2)
        self.assertEqual(answer["folded"], 0)

    def test_pixels_follow_the_wipe(self):
        shots = {}
        for position in (0, 50, 100):
            file = self.folder / f"shot{position}.png"
            for _ in range(4):  # a busy machine may be asked for its picture before it has painted
                self.chromium(f"--screenshot={file}", self.probed(position, ALONE).as_uri())
                shots[position] = png_rows(file)
                rows, step = shots[position]
                if any(value != 255 for value in rows[344][132 * step:192 * step]):
                    break
        (none, step), (half, _), (full, _) = shots[0], shots[50], shots[100]
        self.assertNotEqual(none, full)
        # The wipe is alone on the page, 576 wide, and begins after the page's margin.
        left = 50 + 32
        y = 44 + 300
        for x, wanted in ((left + 100, full), (left + 476, none)):
            block = slice(x * step, (x + 60) * step)
            self.assertEqual([r[block] for r in half[y:y + 40]], [r[block] for r in wanted[y:y + 40]])
            self.assertNotEqual([r[block] for r in none[y:y + 40]], [r[block] for r in full[y:y + 40]])


if __name__ == "__main__":
    BUILD = pathlib.Path(sys.argv[1]).resolve()
    part = sys.argv[2]
    for tool in ("oiiotool",):
        if not shutil.which(tool):
            print(f"skipped: there is no {tool}")
            sys.exit(77)
    if part == "browser" and CHROMIUM is None:
        print("skipped: there is no Chromium (apt-get install chromium)")
        sys.exit(77)
    suite = unittest.TestSuite()
    for case in ((Browser,) if part == "browser" else (Statistics, EnlargedFiles, Driver)):
        suite.addTests(unittest.defaultTestLoader.loadTestsFromTestCase(case))
    sys.exit(0 if unittest.TextTestRunner(verbosity=2).run(suite).wasSuccessful() else 1)
