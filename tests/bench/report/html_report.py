# SPDX-License-Identifier: Apache-2.0
"""One HTML file from results.jsonl: plots, tables, and the image viewer. It needs no network."""

import base64
import json
import math
import pathlib
import re
import statistics

from common import finite
from quality import PLAIN
from svg import COLOURS, DASHES, INK, SHAPES, Axis, Plot, escape, legend, mark, number

HERE = pathlib.Path(__file__).resolve().parent


def pareto(points):
    """Of (x, y): those that no other beats in one without losing in the other, by rising x."""
    front = []
    for x, y in sorted(points):
        if not front or y < front[-1][1]:
            front.append((x, y))
    return front


def geometric_mean(values):
    return math.exp(statistics.fmean(math.log(v) for v in values)) if values else None


def short(x, digits=3):
    return "–" if not finite(x) else f"{x:.{digits}g}"


def seconds_text(s):
    if not finite(s):
        return "–"
    return f"{s * 1000:.0f} ms" if s < 0.95 else f"{s:.2f} s" if s < 10 else f"{s:.0f} s"


def mib(b):
    return "–" if not finite(b) else f"{b / 2**20:.0f}"


def table(head, rows, left=1):
    """Text stands left in the first `left` columns, figures right."""
    def cells(tag, row):
        return "".join(f'<{tag}{"" if k < left else " class=n"}>{c}</{tag}>' for k, c in enumerate(row))
    return ('<div class="scroll"><table><thead><tr>' + cells("th", head) + "</tr></thead><tbody>"
            + "".join(f"<tr>{cells('td', r)}</tr>" for r in rows) + "</tbody></table></div>")


class Style:
    """The look of each graph, the same in every plot."""

    def __init__(self, names):
        self.look = {PLAIN: ("#1c1c1c", "circle", "")}
        for k, name in enumerate(names):
            # Past the palette colours come again with another shape.
            self.look[name] = (COLOURS[k % len(COLOURS)], SHAPES[(k + k // len(COLOURS)) % len(SHAPES)],
                               DASHES[k % len(DASHES)])

    def legend(self, names):
        return legend([(n, self.look[n][0], self.look[n][1], self.look[n][2]) for n in names])


class Data:
    def __init__(self, results):
        self.quality = sorted(results.latest("quality"), key=lambda q: (q["scene"], q["graph"], q["spp"]))
        self.scaling = results.latest("scaling")
        self.skip = results.latest("skip")
        kernels = results.latest("kernels")
        self.kernels = kernels[-1] if kernels else None
        self.against = results.latest("against")
        self.missing = results.latest("not_applicable")
        self.scenes = list(dict.fromkeys(q["scene"] for q in self.quality))
        self.graphs = sorted({q["graph"] for q in self.quality} - {PLAIN} | {s["graph"] for s in self.scaling})
        self.style = Style(self.graphs)
        self.everything = [*self.quality, *self.scaling, *self.skip, *self.against,
                           *([self.kernels] if self.kernels else [])]

    def title(self, scene):
        titles = [q.get("title") for q in self.quality if q["scene"] == scene and q.get("title")]
        return titles[0] if titles else scene

    def of(self, scene, graph, source=None):
        return [q for q in self.quality if q["scene"] == scene and q["graph"] == graph and
                (source is None or (q["source"] == "stack") == (source == "stack"))]

    def plain_sources(self, scene):
        """The plain series to draw: the stack where there is one, else the noisy files."""
        return "stack" if self.of(scene, PLAIN, "stack") else "file"


def best(case):
    return min(case["seconds"])


def describe(q):
    text = f"{q['graph']}, {q['spp']} spp: relMSE {short(q['errors']['relmse'])}, RMSE {short(q['errors']['rmse'])}"
    if "seconds" in q:
        text += f", {seconds_text(best(q))}"
    if finite(q.get("equal_error_factor")):
        text += f", as {q['equal_error_factor']:.1f}× the samples"
    return text


def time_error_plots(data):
    plots = []
    for scene in data.scenes:
        series = {}
        for graph in [PLAIN, *data.graphs]:
            for q in data.of(scene, graph, data.plain_sources(scene) if graph == PLAIN else None):
                x = (q.get("render_seconds") or 0.0) + (best(q) if "seconds" in q else 0.0)
                if x > 0 and finite(q["errors"]["relmse"]) and q["errors"]["relmse"] > 0:
                    series.setdefault(graph, []).append((x, q["errors"]["relmse"], q))
        points = [(x, y) for s in series.values() for x, y, _ in s]
        if not points:
            continue
        rendered = any(q.get("render_seconds") for s in series.values() for _, _, q in s)
        plot = Plot(data.title(scene), Axis(min(p[0] for p in points), max(p[0] for p in points)),
                    Axis(min(p[1] for p in points), max(p[1] for p in points)),
                    "seconds to render and filter" if rendered else "seconds to filter", "relMSE",
                    name=f"time-{scene}".replace("/", "_"))
        plot.steps(pareto(points), "#E69F00")
        for graph, found in series.items():
            colour, shape, dash = data.style.look[graph]
            found.sort(key=lambda f: f[2]["spp"])
            plot.line([(x, y) for x, y, _ in found], colour, dash)
            plot.marks([(x, y) for x, y, _ in found], shape, colour, [describe(q) for *_, q in found])
            if graph == PLAIN:
                for x, y, q in found:
                    plot.text(x, y, f"{q['spp']}", "#555", "start", 6, -5, size=9.5)
                (x, y, _) = found[-1]
                plot.line([(x, y), (x * 1000, y / 1000)], colour, "1.5 3", 1.2, kind="model")
        plots.append(plot.svg())
    return plots


def spp_plots(data):
    plots = []
    for scene in data.scenes:
        series = {}
        for graph in [PLAIN, *data.graphs]:
            found = data.of(scene, graph, data.plain_sources(scene) if graph == PLAIN else None)
            if found:
                series[graph] = sorted((q["spp"], q["errors"]["rmse"], q) for q in found)
        if not series:
            continue
        counts = sorted({n for s in series.values() for n, _, _ in s})
        values = [v for s in series.values() for _, v, _ in s if v > 0]
        floor = next((q.get("reference_rmse") for s in series.values() for *_, q in s if q.get("reference_rmse")), None)
        low = min([*values, *([floor] if floor else [])])
        plot = Plot(data.title(scene), Axis(counts[0] / 1.15, counts[-1] * 1.15, only=counts), Axis(low, max(values)),
                    "samples per pixel", "RMSE", name=f"spp-{scene}".replace("/", "_"))
        if PLAIN in series:
            # The model 1/√n through the centre of the measured points.
            centre = math.exp(statistics.fmean(math.log(v * math.sqrt(n)) for n, v, _ in series[PLAIN]))
            ends = (counts[0] / 1.5, counts[-1] * 1.5)
            plot.line([(n, centre / math.sqrt(n)) for n in ends], INK, "1.5 3", 1.2, kind="model")
            turn = plot.angle(ends[0], centre / math.sqrt(ends[0]), ends[1], centre / math.sqrt(ends[1]))
            between = math.sqrt(counts[0] * counts[min(1, len(counts) - 1)])
            plot.text(between, centre / math.sqrt(between), "slope −½", "#555", "middle", 0, -7, turn)
        if floor:
            plot.line([(counts[0] / 2, floor), (counts[-1] * 2, floor)], "#777", "9 4", 1, kind="floor")
            plot.text(counts[0], floor, "error of the reference itself", "#555", "start", 0, -4)
        # Marks of one sample count stand side by side.
        step = 10 ** (0.017 * (plot.x.high - plot.x.low))
        others = [g for g in series if g != PLAIN]
        for graph, found in series.items():
            colour, shape, dash = data.style.look[graph]
            aside = 1.0 if graph == PLAIN else step ** (others.index(graph) - (len(others) - 1) / 2)
            if graph != PLAIN:
                plot.line([(n * aside, v) for n, v, _ in found], colour, dash)
            plot.marks([(n * aside, v) for n, v, _ in found], shape, colour, [describe(q) for *_, q in found])
        plots.append(plot.svg())
    return plots


def roofline_plot(data):
    limits = data.kernels["limits"]
    # One thread and one size; the rest would lie on top of it.
    sizes = lambda name: [int(w) for w in re.findall(r"/(?:width:)?(\d+)(?:/|x\d+)", name)]
    entries = [e for e in data.kernels["entries"] if "intensity" in e and not is_plain(e) and e["threads"] == 1 and
               ("/width:1920/" in e["name"] if is_node_run(e) else not {640, 3840} & set(sizes(e["name"])) or
                not e["name"].startswith("error_measures"))]
    if not entries or "triad" not in limits:
        return ""
    threads = sorted(int(k) for k in limits["triad"])
    get = lambda what, n: limits.get(what, {}).get(n) or limits.get(what, {}).get(str(n))
    rates = [e["flops_per_second"] / 1e9 for e in entries]
    intensities = [e["intensity"] for e in entries]
    top = max(get(w, n) / 1e9 for w in ("fused", "mul_add") for n in threads if get(w, n))
    plot = Plot("Kernels under the roofline", Axis(min([0.2, *intensities]), max([100, *intensities])),
                Axis(min([0.5, *rates]), top * 1.2), "operations per byte that must be moved", "Gflop/s",
                1030, 600, "roofline")
    for n in threads:
        bandwidth, peak, fused = (get(w, n) for w in ("triad", "mul_add", "fused"))
        ridge = peak / bandwidth
        plot.line([(1e-3, bandwidth * 1e-3 / 1e9), (ridge, peak / 1e9), (1e6, peak / 1e9)], INK,
                  "" if n == 1 else "6 3", 1.6, kind="roof")
        threads_text = f"{n} thread{'s' if n > 1 else ''}"
        plot.text(plot_right(plot), peak / 1e9, f"{threads_text}, multiply and add: {peak / 1e9:.0f} Gflop/s", INK, "end", -4, -5)
        if fused and n == threads[-1]:
            plot.line([(fused / bandwidth, fused / 1e9), (1e6, fused / 1e9)], "#999", "2 3", 1.2, kind="roof")
            plot.text(plot_right(plot), fused / 1e9, f"{threads_text}, fused: {fused / 1e9:.0f} Gflop/s", "#555", "end", -4, -5)
        if n == threads[-1]:
            at = ridge / 6
            turn = plot.angle(at, bandwidth * at, ridge, bandwidth * ridge)
            turn = math.degrees(math.atan2(plot.py(peak / 1e9) - plot.py(bandwidth * at / 1e9), plot.px(ridge) - plot.px(at)))
            plot.text(at, bandwidth * at / 1e9, f"memory: {bandwidth / 1e9:.1f} GB/s", INK, "middle", 0, -7, turn)
    stages = sorted({stage_of(e) for e in entries})
    look = {stage: (COLOURS[k % len(COLOURS)], SHAPES[k % len(SHAPES)]) for k, stage in enumerate(stages)}
    at = lambda e: (e["intensity"], e["flops_per_second"] / 1e9)
    # Kernels by themselves are large marks and are named first; operations of OpenImageIO last.
    order = sorted(entries, key=lambda e: (e["name"].startswith("oiio."), is_node_run(e), -e["flops_per_second"]))
    names = {}
    for e in order:
        parts = e["name"].split("/")
        names.setdefault(parts[0] if "." in parts[0] else "/".join(parts[:2]), []).append(e)
    for e in reversed(order):
        colour, shape = look[stage_of(e)]
        plot.marks([at(e)], shape, colour,
                   [f"{kernel_name(e['name'])}: {at(e)[1]:.2f} Gflop/s, {100 * e.get('share_of_limit', 0):.2g} % of the limit"],
                   3.8 if is_node_run(e) else 5.8)
    plot.labels([([at(e) for e in of], name, look[stage_of(of[0])][0]) for name, of in names.items()], [at(e) for e in entries])
    return legend([(s, *look[s], None) for s in stages]) + plot.svg()


def stage_of(entry):
    """fuse, transform, …; what is no node by its own name."""
    return entry["name"].split("/")[0].split(".")[0]


def plot_right(plot):
    """The value at the right end of the x axis."""
    return 10 ** plot.x.high if plot.x.log else plot.x.high


def kernel_name(name):
    """Without what the table says in columns of its own."""
    name = re.sub(r"/width:(\d+)/height:(\d+)", r"/\1x\2", name)
    return re.sub(r"/real_time|/process_time|/threads:\d+", "", name)


def is_node_run(entry):
    """A node or a graph, run by the engine (node_bench.cpp), rather than a kernel."""
    return "/node/" in entry["name"] or entry["name"].startswith("graph/")


def is_plain(entry):
    """The plain version of a kernel or node."""
    return "/plain_" in entry["name"]


NODE_HEAD = ["node or graph", "0.26 MP", "2.1 MP", "8.3 MP", "2 threads", "bytes", "flop", "of the limit", "plain version"]
NODE_TEXT = ("Every node alone and every graph, run by the engine on images in memory: nanoseconds a pixel (of the first input, all its "
             "channels) on one thread by image size; at 2.1 megapixels the wall-clock gain of a second thread, the share of the "
             "machine's limit on one thread, and how many times longer the plain version of the tests takes (in double, 160×100). "
             "Nodes that move more than they compute run on memory that an earlier run has used. Bytes and operations a pixel are "
             "what no implementation can avoid; tests/oracle/plain_nodes.cpp says how they are counted.")


def node_rows(data):
    """ns a pixel by image size on one thread, and what a second thread brings in wall-clock time."""
    found = {}
    for e in filter(is_node_run, data.kernels["entries"]):
        size = re.search(r"/width:(\d+)/", e["name"])
        if size and "ns_per_pixel" in e:
            name = e["name"].split("/width:")[0].removesuffix("/node")
            found.setdefault(name, {})[int(size.group(1)), e["threads"]] = e
    rows = []
    for name, by in sorted(found.items()):
        one, two = by.get((1920, 1)), by.get((1920, 2))
        rows.append([name, *(short(by[width, 1]["ns_per_pixel"], 4) if (width, 1) in by else "–" for width in (640, 1920, 3840)),
                     f"× {one['real_seconds'] / two['real_seconds']:.2f}" if one and two else "–", *shares(one or {})])
    return rows


def shares(entry):
    """Bytes, operations, share of the limit, and the plain version, as the tables print them."""
    share, times = entry.get("share_of_limit"), entry.get("times_faster_than_oracle")
    return [short(entry.get("bytes_per_pixel"), 4), f"{entry['flops_per_pixel']:.0f}" if "flops_per_pixel" in entry else "–",
            f"{100 * share:.2g} % ({entry['bound_by']})" if share and share < 0.095 else
            f"{100 * share:.0f} % ({entry['bound_by']})" if share else "–",
            f"× {short(times)}" if times else "–"]


KERNEL_HEAD = ["kernel", "threads", "ns a pixel", "Gflop/s", "GB/s", "bytes", "flop", "of the limit", "plain version"]


def kernel_rows(data):
    """Kernels by themselves; their plain versions are the last column."""
    return [[kernel_name(e["name"]), e["threads"], short(e.get("ns_per_pixel"), 4), short(e.get("flops_per_second", float("nan")) / 1e9),
             short(e.get("bytes_per_second", float("nan")) / 1e9), *shares(e)]
            for e in data.kernels["entries"] if "ns_per_pixel" in e and not is_node_run(e) and not is_plain(e)]


def scaling_plots(data):
    lines = data.scaling
    if not lines:
        return []
    most = max(s["threads"] for s in lines)
    plots = []
    for what, label, unit in (("seconds", "Time", "seconds"), ("cpu_seconds", "Processor time", "seconds of all threads"),
                              ("max_rss", "Memory", "MiB, whole process")):
        series = {}
        for s in lines:
            if s["threads"] == most:
                value = s[what] / (2**20 if what == "max_rss" else 1)
                series.setdefault(s["graph"], []).append((s["width"] * s["height"] / 1e6, value, s))
        xs = [x for f in series.values() for x, _, _ in f]
        ys = [y for f in series.values() for _, y, _ in f]
        plot = Plot(f"{label} over image size, {most} thread{'s' if most > 1 else ''}", Axis(min(xs), max(xs)), Axis(min(ys), max(ys)), "megapixels", unit,
                    name=f"scaling-{what}")
        for graph, found in series.items():
            colour, shape, dash = data.style.look[graph]
            found.sort(key=lambda f: f[0])
            plot.line([(x, y) for x, y, _ in found], colour, dash)
            plot.marks([(x, y) for x, y, _ in found], shape, colour,
                       [f"{graph}, {s['width']}×{s['height']}: {s['seconds']:.2f} s, {mib(s['max_rss'])} MiB" for *_, s in found])
        if what != "max_rss" and max(xs) > 3 * min(xs):
            # One line of the slope of proportion, below all others.
            low = min(y / x for f in series.values() for x, y, _ in f)
            ends = [(x, 0.8 * low * x) for x in (min(xs) / 2, max(xs) * 2)]
            plot.line(ends, "#777", "1.5 3", 1.1, kind="model")
            middle = math.sqrt(min(xs) * max(xs))
            plot.text(middle, 0.8 * low * middle, "proportional", "#555", "middle", 0, 13,
                      plot.angle(*ends[0], *ends[1]))
        plots.append(plot.svg())
    if most > 1:
        series = {}
        for graph in {s["graph"] for s in lines}:
            of_graph = [s for s in lines if s["graph"] == graph]
            size = next((s["width"] for s in of_graph if s["threads"] == 1), None)
            one = next((s["seconds"] for s in of_graph if s["threads"] == 1), None)
            if one:
                series[graph] = sorted((s["threads"], one / s["seconds"]) for s in of_graph if s["width"] == size)
        if series:
            plot = Plot("Speed-up over threads", Axis(1, most, log=False, only=list(range(1, most + 1))),
                        Axis(0, max([most, *(y for f in series.values() for _, y in f)]), log=False), "threads", "times faster than one thread", name="scaling-threads")
            plot.x.low, plot.x.high = 0.8, most + 0.2
            plot.line([(1, 1), (most, most)], "#777", "1.5 3", 1.2, kind="model")
            for graph, found in sorted(series.items()):
                colour, shape, dash = data.style.look[graph]
                plot.line(found, colour, dash)
                plot.marks(found, shape, colour, [f"{graph}: × {y:.2f} with {x}" for x, y in found])
            plots.append(plot.svg())
    return plots


def against_name(line):
    threads = re.search(r"/threads:(\d+)", line["name"])
    return kernel_name(line["name"]).replace("/node/", "/") + (f", {threads.group(1)} threads" if threads and threads.group(1) != "1" else "")


def against_plot(data):
    """Of the last revision that was compared: what can be, as a plot; a table of all."""
    if not data.against:
        return ""
    revision = data.against[-1]["revision"]
    every = sorted((a for a in data.against if a["revision"] == revision), key=lambda a: (a["part"], a["name"]))
    lines = [a for a in every if "ratio" in a]
    rows = [[escape(against_name(a)), *([f"{a['ratio']:.3f}", f"{a['low']:.3f} … {a['high']:.3f}"] if "ratio" in a else ["–", "–"]),
             escape(a["verdict"]), "–" if "errors" not in a else "unchanged" if a["errors_unchanged"] else
             f"relMSE {short(a['errors']['relmse'][0], 5)} → {short(a['errors']['relmse'][1], 5)}"] for a in every]
    # What differs comes first: that is what one looks for.
    rows.sort(key=lambda r: (r[3].startswith("no difference"), r[1] == "–"))
    text = ""
    if lines:
        low, high = min([0.9, *(a["low"] for a in lines)]), max([1.1, *(a["high"] for a in lines)])
        plot = Plot(f"Time of this build over that of {revision}, 95 % intervals", Axis(low, high), Axis(0, len(lines), log=False, only=[]),
                    "ratio of times (left of 1: faster now)", "", 1030, 90 + 22 * len(lines), "against")
        plot.left = 340
        plot.y.low, plot.y.high = -0.5, len(lines) - 0.5
        plot.line([(1, -1), (1, len(lines) + 1)], INK, "", 1, kind="model")
        names = ""
        for k, a in enumerate(reversed(lines)):
            colour = {"faster": "#0072B2", "slower": "#D55E00"}.get(a["verdict"], "#777")
            plot.line([(a["low"], k), (a["high"], k)], colour, "", 2.4)
            plot.marks([(a["ratio"], k)], {"faster": "diamond", "slower": "triangle"}.get(a["verdict"], "circle"), colour,
                       [f"{a['name']}: × {a['ratio']:.3f} ({a['low']:.3f} … {a['high']:.3f}), {a['verdict']}"])
            names += (f'<text x="332" y="{plot.py(k) + 4:.1f}" text-anchor="end" class="tick">'
                      f'{escape(against_name(a))}</text>')
        text = plot.svg().replace("</svg>", names + "</svg>")
    return text + table(["what", "ratio of times", "95 %", "time", "errors"], rows)


def summary_table(data):
    rows = []
    for graph in data.graphs:
        cases = [q for q in data.quality if q["graph"] == graph]
        if not cases:
            continue
        last = {}
        for q in cases:
            if q["scene"] not in last or q["spp"] > last[q["scene"]]["spp"]:
                last[q["scene"]] = q
        last = list(last.values())
        factors = [q["equal_error_factor"] for q in last if finite(q["equal_error_factor"])]
        times = [q["errors"]["relmse"] / q["equal_time_relmse"] for q in last if q.get("equal_time_relmse")]
        megapixels = sum(q["pixels"] for q in last) / 1e6
        colour, shape, _ = data.style.look[graph]
        icon = f'<svg width="16" height="14" aria-hidden="true">{mark(shape, 8, 7, colour)}</svg> '
        rows.append([f"<span class=graph>{icon}{escape(graph)}</span>", len(last), f"× {geometric_mean(factors):.1f}" if factors else "–",
                     f"× {min(factors):.1f} … {max(factors):.1f}" if factors else "–",
                     f"{100 * geometric_mean(times):.0f} %" if times else "–",
                     short(sum(best(q) for q in last) / megapixels), mib(max(q["max_rss"] for q in last))])
    return table(["graph", "scenes", "as so many times the samples (geometric mean)", "worst … best scene",
                  "relMSE, of plain Monte Carlo's in the same time", "s per megapixel", "peak MiB"], rows)


def quality_table(data):
    rows = []
    for q in data.quality:
        e = q["errors"]
        plain = q["graph"] == PLAIN
        rows.append([escape(data.title(q["scene"])), escape(q["graph"]) + (f" ({escape(q['source'])})" if plain else ""), q["spp"],
                     "–" if plain else seconds_text(best(q)), "–" if plain else mib(q["peak_bytes"]), "–" if plain else mib(q["max_rss"]),
                     short(e["rmse"]), short(e["relmse"]), short(e.get("relmse_trimmed")), short(e["psnr"], 4),
                     short(e["smape"]), short(e.get("ssim")), short(e.get("flip")), short(e.get("hdr_flip")),
                     short(e.get("brightness_ratio"), 4),
                     "–" if plain else f"× {short(q['equal_error_factor'])}", "–" if plain else short(q["equal_time_relmse"])])
    return table(["scene", "graph", "spp", "time", "MiB pixels", "MiB process", "RMSE", "relMSE", "trimmed", "PSNR dB", "SMAPE", "SSIM",
                  "FLIP", "HDR-FLIP", "brightness", "equal-error samples", "plain's relMSE in equal time"], rows, 2)


SKIP_HEAD = ["shortcut", "graph", "without", "with", "processor s without", "with", "saved", "MiB without", "with", "pixels"]
SKIP_TEXT = ("Each run with and without, taking turns, least of each; saved is processor time, starting the program included. "
             "Pixels of both are compared by hash. MiB is what bands of pixels held at most.")


def skip_rows(data):
    order = list(dict.fromkeys(s["kind_of_skip"] for s in data.skip))
    rows = []
    for s in sorted(data.skip, key=lambda s: (order.index(s["kind_of_skip"]), s["graph"])):
        a, b = min(s["cpu_with"]), min(s["cpu_without"])
        rows.append([s["title"], s["graph"], seconds_text(min(s["seconds_without"])), seconds_text(min(s["seconds_with"])),
                     f"{b:.2f}", f"{a:.2f}", f"{100 * (1 - a / b):.0f} %", mib(s.get("peak_without")), mib(s.get("peak_with")),
                     "equal" if s["equal_pixels"] else "DIFFER"])
    return rows


def skip_details(data):
    """What was left out, by graph: the same for most kinds."""
    found = {}
    for s in data.skip:
        reasons = "; ".join(f"{r}: {', '.join(v['nodes'])}"
                            + (f" ({v['saved_seconds']:.3f} s)" if v["saved_seconds"] is not None else "")
                            for r, v in s["reasons"].items()) or "nothing"
        found.setdefault((s["graph"], reasons), []).append(s["title"].split(",")[0])
    return table(["graph", "shortcut", "what was left out"],
                 [[escape(graph), escape(", ".join(kinds)), escape(reasons)] for (graph, reasons), kinds in sorted(found.items())], 3)


def missing_rows(data):
    """What was not measured: graph, scenes, sample counts, reason; scenes with the same reason share a row."""
    grouped = {}
    for m in data.missing:
        # "no noisy_4.exr" and "no noisy_8.exr" are one reason.
        reason = m["reason"]
        for n in m["spp"]:
            reason = re.sub(rf"\b(of |\w+_){n}\b", r"\g<1>N", reason)
        scenes, counts = grouped.setdefault((m["graph"], reason), ({}, set()))
        scenes[data.title(m["scene"])] = True
        counts.update(int(n) for n in m["spp"])
    return [[graph, ", ".join(scenes), ", ".join(map(str, sorted(counts))), reason]
            for (graph, reason), (scenes, counts) in grouped.items()]


def embedded(path):
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode()


def viewer(data, folder):
    """The cases with images: for each scene and graph the largest sample count, and the noisy one it
    started from."""
    images, cases, names = {}, [], {}

    def add(name):
        path = folder / "images" / name
        if name not in names and path.exists():
            names[name] = f"i{len(names)}"
            images[names[name]] = embedded(path)
        return names.get(name)

    chosen = {}
    for q in data.quality:
        if q["graph"] != PLAIN:
            key = (q["scene"], q["graph"])
            if key not in chosen or q["spp"] > chosen[key]["spp"]:
                chosen[key] = q
    for q in chosen.values():
        noisy = [p for p in data.of(q["scene"], PLAIN) if p["spp"] == q["spp"] and
                 (p["source"] == "stack") == (q["source"] == "stack")]
        if not noisy:
            continue
        noisy = noisy[0]
        case = {"scene": data.title(q["scene"]), "graph": q["graph"], "spp": q["spp"],
                "noisy": add(noisy["pictures"]["image"]), "result": add(q["pictures"]["image"]),
                "reference": add(q["pictures"]["reference"]), "error": add(q["pictures"]["error"]),
                "noisy_error": add(noisy["pictures"]["error"]),
                "relmse": q["errors"]["relmse"],
                "figures": [short(q["errors"]["relmse"]), short(q["errors"].get("flip")), f"× {short(q['equal_error_factor'])}", seconds_text(best(q))],
                "text": f"relMSE {short(noisy['errors']['relmse'])} → {short(q['errors']['relmse'])}, "
                        f"FLIP {short(noisy['errors'].get('flip'))} → {short(q['errors'].get('flip'))}, "
                        f"{seconds_text(best(q))}"}
        if all(case[k] for k in ("noisy", "result", "reference", "error", "noisy_error")):
            cases.append(case)
    return cases, images


VIEWS = [("noisy", "noisy"), ("result", "result"), ("reference", "reference"), ("error", "FLIP of the result"),
         ("noisy_error", "FLIP of the noisy")]


def viewer_html(cases, images):
    if not cases:
        return ""
    options = "".join(f'<option value="{k}">{escape(v)}</option>' for k, v in VIEWS)
    scenes = list(dict.fromkeys(c["scene"] for c in cases))
    chooser = "".join(f"<option>{escape(s)}</option>" for s in scenes)
    text = json.dumps({"cases": cases, "images": images}, ensure_ascii=False).replace("</", "<\\/")
    return f"""
<section id="viewer"><h2>Look at it</h2>
<p>Drag across the image, or use the arrow keys on the slider. Images are as a display shows them: radiance
clamped to [0, 1], sRGB. FLIP maps run from black (no difference seen) to pale yellow (1) in every case.</p>
<div class="controls">
<label>Scene <select id="scene">{chooser}</select></label>
<label>Graph <select id="graph"></select></label>
<label>Left <select id="left">{options}</select></label>
<label>Right <select id="right">{options}</select></label>
</div>
<div class="beside"><div>
<figure class="wipe" id="wipe"><img id="under" alt="right image"><img id="over" alt="left image"><i id="bar"></i>
<b id="name-left"></b><b id="name-right"></b></figure>
<input type="range" id="position" min="0" max="100" step="0.5" value="50" aria-label="position of the wipe">
</div><table id="choices"><thead><tr><th>graph</th><th class=n>spp</th><th class=n>relMSE</th><th class=n>FLIP</th><th class=n>samples</th>
<th class=n>time</th></tr></thead><tbody></tbody></table></div>
<div class="four" id="four">{"".join(f'<figure><img alt="{escape(v)}" data-view="{k}"><figcaption>{escape(v)}</figcaption></figure>' for k, v in VIEWS[:4])}</div>
<p id="caption"></p>
</section>
<script type="application/json" id="viewer-data">{text}</script>"""


def folded(title, content):
    """Open in print."""
    return f"<details><summary>{escape(title)}</summary>{content}</details>"


def taken(lines):
    """One line: where a section's figures are from."""
    return '<p class="note">' + escape("; ".join(f"{k} {v}" for k, v in facts(lines)[1:])) + "</p>"


def range_text(values):
    values = sorted(set(values))
    return str(values[0]) if len(values) == 1 else f"{values[0]} to {values[-1]}"


def facts(lines):
    """Machine, load, date and commit of lines; what differs between them is all named."""
    if not lines:
        return []
    machines = sorted({(m["cpu"], m["threads"], m["memory_bytes"], m["system"]) for m in (x["machine"] for x in lines)}, key=str)
    return [("machine", "; ".join(f"{c}, {t} threads, {(b or 0) / 2**30:.0f} GiB, {s}" for c, t, b, s in machines)),
            ("load", f"{range_text([x['load'][0] for x in lines])} (one-minute average while measuring)"),
            ("date", range_text([x["date"][:16].replace("T", " ") for x in lines]) + " UTC"),
            ("commit", ", ".join(sorted({x["commit"] for x in lines})) +
             (" (+: with changes that are not committed)" if any(x["commit"].endswith("+") for x in lines) else ""))]


def page(data, folder):
    parts = []
    add = parts.append
    names = [PLAIN, *data.graphs]
    add("<h1>rayloom: run time against error</h1>")
    add('<p class="lead">What every graph that comes with rayloom makes of real renders, how long it takes, and what the '
        "same seconds would have bought in more samples.</p>")
    add('<dl class="facts">' + "".join(f"<dt>{k}</dt><dd>{escape(v)}</dd>" for k, v in facts(data.everything)) + "</dl>")
    if data.quality:
        add(summary_table(data))
        add('<p class="note">At the largest sample count of each scene. <em>As so many times the samples</em>: relMSE of the '
            "noisy image over that of the result; by so much the samples of plain Monte Carlo would have to grow, since its "
            "squared error falls as 1/samples. <em>In the same time</em>: plain Monte Carlo may render on for as long as the graph runs.</p>")
        add("<section><h2>Error against time</h2><p>Below and left is better. The broad band joins the points that nothing "
            "beats in both time and error. Dotted: where plain Monte Carlo would go on to. Small figures: its samples per pixel.</p>")
        add(data.style.legend([n for n in names if any(q["graph"] == n for q in data.quality)]))
        add('<div class="plots">' + "".join(time_error_plots(data)) + "</div></section>")
        add(viewer_html(*viewer(data, folder)))
        add("<section><h2>Error against samples</h2><p>Plain Monte Carlo follows the dotted line of slope −½. A method worth "
            "its time stays below it; a biased one flattens out. Marks of one sample count stand side by side.</p>")
        add(data.style.legend([n for n in names if any(q["graph"] == n for q in data.quality)]))
        add('<div class="plots">' + "".join(spp_plots(data)) + "</div></section>")
    if data.kernels:
        add("<section><h2>Kernels and the machine's limits</h2><p>Both limits are measured in the same run: bandwidth by a "
            "triad over arrays no cache holds, arithmetic by chains of multiplications and additions. Results with the same bits "
            "on every machine need separate multiplication and addition; the fused peak shows what that costs. Operations are "
            "counted from the equations, bytes are what must be read and written once. Large marks: kernels by themselves; small "
            "ones: nodes inside a run at 2.1 megapixels; one thread.</p>" + taken([data.kernels]))
        add(roofline_plot(data))
        add(folded("Kernels by themselves, in figures",
                   table(KERNEL_HEAD, [[f"<code>{escape(r[0])}</code>", *r[1:]] for r in kernel_rows(data)])) + "</section>")
        if rows := node_rows(data):
            add(f"<section><h2>Every node and graph inside a run</h2><p>{NODE_TEXT}</p>")
            add(folded(f"{len(rows)} nodes and graphs, in figures",
                       table(NODE_HEAD, [[f"<code>{escape(r[0])}</code>", *r[1:]] for r in rows])) + "</section>")
    if data.scaling:
        add("<section><h2>Size and threads</h2><p>Images of any size from mirrored copies of a real render. "
            "Runs may hold a third of the machine's memory for pixels (<code>--memory</code>).</p>" + taken(data.scaling))
        add(data.style.legend([g for g in data.graphs if any(s["graph"] == g for s in data.scaling)]))
        add('<div class="plots">' + "".join(scaling_plots(data)) + "</div></section>")
    if data.skip:
        add(f"<section><h2>Shortcuts</h2><p>{SKIP_TEXT}</p>{taken(data.skip)}")
        add(table(SKIP_HEAD, [[escape(c) for c in r] for r in skip_rows(data)], 2))
        add(folded("What was left out", skip_details(data)) + "</section>")
    if data.against:
        add("<section><h2>Against another build</h2><p>Both builds took turns in one run. Times of graphs are processor time.</p>" + taken(data.against))
        add(against_plot(data) + "</section>")
    if data.quality:
        add("<section><h2>All figures</h2>" + taken(data.quality) + folded(f"{len(data.quality)} cases", quality_table(data)))
        sources = sorted({f"{data.title(q['scene'])}: {q['render_time_source']}" for q in data.quality})
        add('<p class="note">Definitions of the errors: docs/measures.md. Time is the fastest of up to three runs, planning not '
            "included; reading and writing are. Seconds to render: " + escape("; ".join(sources)) +
            "; they were measured where the scenes were rendered, with that machine's threads.</p>")
        if data.missing:
            rows = [[escape(c) for c in row] for row in missing_rows(data)]
            add(folded("What was not measured, and why", table(["graph", "scenes", "spp", "reason"], rows, 4)))
        add("</section>")
    if not data.everything:
        add("<p>There are no results yet.</p>")
    return "\n".join(parts)


def write(results):
    data = Data(results)
    html = (HERE / "report.html").read_text()
    html = html.replace("/* style */", (HERE / "report.css").read_text())
    html = html.replace("/* script */", (HERE / "report.js").read_text())
    html = html.replace("<!-- body -->", page(data, results.folder))
    target = results.folder / "report.html"
    target.write_text(html)
    return target
