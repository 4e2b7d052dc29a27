# SPDX-License-Identifier: Apache-2.0
"""Tables of docs/performance.md and docs/accuracy.md, between two marks; the text around them stays."""

import pathlib

from common import finite, say
from html_report import (KERNEL_HEAD, NODE_HEAD, NODE_TEXT, SKIP_HEAD, SKIP_TEXT, Data, best, facts, kernel_rows, mib,
                         missing_rows, node_rows, seconds_text, short, skip_rows)
from quality import PLAIN

BEGIN = "<!-- generated: ./dev bench --write-docs -->"
END = "<!-- end of generated -->"

TITLES = {
    "performance.md": "# Performance\n\nHow fast, in how much memory, and how far from what the machine allows. "
                      "[benchmark.md](benchmark.md) says how it is measured.\n",
    "accuracy.md": "# Accuracy\n\nWhat every graph that comes with rayloom makes of the bundled renders. "
                   "[measures.md](measures.md) defines the errors, [benchmark.md](benchmark.md) the run.\n",
}


def table(head, rows, left=1):
    lines = ["| " + " | ".join(head) + " |", "|" + "|".join("---" if k < left else "---:" for k in range(len(head))) + "|"]
    lines += ["| " + " | ".join(str(c).replace("|", "\\|") for c in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def stated(lines):
    return "".join(f"- {key}: {value}\n" for key, value in facts(lines)) + "\n"


def accuracy(data):
    if not data.quality:
        return "No quality run yet.\n"
    out = "## Figures of a run\n\n" + stated(data.quality)
    rows = []
    for q in data.quality:
        e, plain = q["errors"], q["graph"] == PLAIN
        rows.append([data.title(q["scene"]), q["graph"] + (f" ({q['source']})" if plain else ""), q["spp"], short(e["rmse"]),
                     short(e["relmse"]), short(e.get("relmse_trimmed")), short(e["psnr"], 4), short(e["smape"]), short(e.get("ssim")),
                     short(e.get("flip")), short(e.get("hdr_flip")), "–" if plain else f"× {short(q['equal_error_factor'])}",
                     "–" if plain or not finite(q["equal_time_relmse"]) else f"{100 * e['relmse'] / q['equal_time_relmse']:.0f} %"])
    out += table(["scene", "graph", "spp", "RMSE", "relMSE", "trimmed", "PSNR dB", "SMAPE", "SSIM", "FLIP", "HDR-FLIP",
                  "equal-error samples", "of plain's relMSE in equal time"], rows, 2)
    out += ("\n*Equal-error samples*: by how much the samples of plain Monte Carlo would have to grow to reach this relMSE. "
            "*In equal time*: plain Monte Carlo renders on for as long as the graph runs. Both take its squared error "
            "to fall as 1/samples. The references have an error of their own (RMSE of the whole images: "
            + ", ".join(dict.fromkeys(f"{data.title(q['scene'])} {q['reference_rmse']:g}" for q in data.quality
                                      if q.get("reference_rmse"))) + ").\n")
    if data.missing:
        out += "\nNot measured:\n\n" + table(["graph", "scenes", "spp", "reason"], missing_rows(data), 4)
    return out


def performance(data):
    out = ""
    if data.kernels:
        limits = data.kernels["limits"]
        out += "## Kernels of a run\n\n" + stated([data.kernels])
        out += table(["limit", *(f"{n} thread{'s' if int(n) > 1 else ''}" for n in limits["triad"])],
                     [[{"triad": "memory, triad, GB/s", "mul_add": "multiply and add, Gflop/s",
                        "fused": "fused multiply-add, Gflop/s"}[what], *(f"{v / 1e9:.1f}" for v in by.values())]
                      for what, by in limits.items()])
        out += "\n" + table(KERNEL_HEAD, [[f"`{r[0]}`", *r[1:]] for r in kernel_rows(data)])
        out += ("\nBytes and operations are of a pixel. The limit is the smaller of multiply-and-add and of memory bandwidth times "
                "operations per byte. One thread: processor time; several: wall-clock time.\n\n")
        if rows := node_rows(data):
            out += f"## Every node and graph inside a run\n\n{NODE_TEXT}\n\n"
            out += table(NODE_HEAD, [[f"`{r[0]}`", *r[1:]] for r in rows]) + "\n"
    cases = [q for q in data.quality if q["graph"] != PLAIN]
    if cases:
        out += "## Graphs of a run\n\n" + stated(cases)
        out += table(["graph", "scene", "spp", "pixels", "seconds", "processor s", "s per megapixel", "MiB for pixels", "MiB, process"],
                     [[q["graph"], data.title(q["scene"]), q["spp"], q["pixels"], seconds_text(best(q)), short(min(q["cpu_seconds"])),
                       short(best(q) / q["pixels"] * 1e6), mib(q["peak_bytes"]), mib(q["max_rss"])] for q in cases], 2) + "\n"
    if data.scaling:
        out += "## Size and threads of a run\n\n" + stated(data.scaling)
        out += ("Seconds are wall-clock time, which other programs lengthen (the load says how many there were); "
                "processor seconds of all threads are what to compare.\n\n")
        out += table(["graph", "spp", "image", "threads", "seconds", "processor s", "MiB for pixels", "MiB, process"],
                     [[s["graph"], s["spp"], f"{s['width']}×{s['height']}", s["threads"], f"{s['seconds']:.2f}", f"{s['cpu_seconds']:.1f}", mib(s["peak_bytes"]),
                       mib(s["max_rss"])] for s in sorted(data.scaling, key=lambda s: (s["graph"], s["threads"], s["width"]))]) + "\n"
    if data.skip:
        out += "## Shortcuts of a run\n\n" + stated(data.skip) + SKIP_TEXT + "\n\n" + table(SKIP_HEAD, skip_rows(data), 2)
    return out or "No run yet.\n"


def put(path, text):
    """Replaces what is between the marks; without marks the block goes to the end."""
    old = path.read_text() if path.exists() else TITLES[path.name]
    block = f"{BEGIN}\n\n{text.strip()}\n\n{END}"
    if BEGIN in old and END in old:
        new = old[:old.index(BEGIN)] + block + old[old.index(END) + len(END):]
    else:
        new = old.rstrip() + "\n\n" + block + "\n"
    path.write_text(new)


def write(results, docs):
    data = Data(results)
    put(pathlib.Path(docs) / "performance.md", performance(data))
    put(pathlib.Path(docs) / "accuracy.md", accuracy(data))
    say(f"wrote the tables of {docs}/performance.md and {docs}/accuracy.md")
