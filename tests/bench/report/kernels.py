# SPDX-License-Identifier: Apache-2.0
"""Kernel benchmarks against the limits of the machine, both from one run of rayloom_bench."""

import json
import re

from common import BenchError, file_hash, run, say


def run_benchmarks(program, pattern, min_time):
    if not program.bench.is_file():
        raise BenchError(f"{program.bench} is missing; ./dev build makes it")
    done = run([program.bench, f"--benchmark_filter={pattern}", "--benchmark_format=json",
                f"--benchmark_min_time={min_time}"])
    return json.loads(done.out)["benchmarks"] if done.out.strip() else []


NANOSECONDS = {"ns": 1.0, "us": 1e3, "ms": 1e6, "s": 1e9}


def threads_of(line):
    match = re.search(r"threads:(\d+)", line["name"])
    return int(match.group(1)) if match else 1


def seconds_of(line):
    """Of one iteration. One thread: processor time, which other programs on the machine disturb less.
    Several: wall-clock time."""
    time = line["real_time"] if threads_of(line) > 1 else line["cpu_time"]
    return time * NANOSECONDS[line["time_unit"]] * 1e-9


def limits_of(lines):
    """Bandwidth and operations per second that the probes reach, by number of threads."""
    limits = {}
    for line in lines:
        if not line["name"].startswith("machine/"):
            continue
        what, threads = line["name"].split("/")[1], threads_of(line)
        count = line.get("bytes_per_iteration") or line.get("flops_per_iteration")
        # Google Benchmark gives processor time per iteration of one thread.
        limits.setdefault(what, {})[threads] = threads * count / (line["cpu_time"] * NANOSECONDS[line["time_unit"]] * 1e-9)
    return limits


def pixels_of(line):
    """Google Benchmark divides by wall-clock time where a benchmark is by that, and says so in its name."""
    if "items_per_second" in line:
        time = line["real_time"] if "/real_time" in line["name"] else line["cpu_time"]
        return line["items_per_second"] * (time * NANOSECONDS[line["time_unit"]] * 1e-9)
    if "time_per_pixel" in line:
        cpu = line["cpu_time"] * NANOSECONDS[line["time_unit"]] * 1e-9
        return cpu / line["time_per_pixel"]
    return None


def figures(line, limits):
    """Time per pixel, rates, and the share of what the roofline allows."""
    seconds, threads = seconds_of(line), threads_of(line)
    out = {"name": line["name"], "threads": threads, "seconds": seconds,
           "real_seconds": line["real_time"] * NANOSECONDS[line["time_unit"]] * 1e-9}
    pixels = pixels_of(line)
    if not pixels:
        return out
    out["pixels"] = round(pixels)
    out["ns_per_pixel"] = seconds / pixels * 1e9
    flops, moved = line.get("flops_per_pixel"), line.get("bytes_per_pixel")
    bandwidth = limits.get("triad", {}).get(threads)
    peak = limits.get("mul_add", {}).get(threads)
    if moved:
        out["bytes_per_pixel"] = moved
        out["bytes_per_second"] = moved * pixels / seconds
    if flops:
        out["flops_per_pixel"] = flops
        out["flops_per_second"] = flops * pixels / seconds
    if moved and bandwidth and peak:
        # What a pixel would take at the limits; a copy has memory's alone.
        computing, moving = (flops or 0) / peak, moved / bandwidth
        out["share_of_limit"] = max(computing, moving) / (seconds / pixels)
        out["bound_by"] = "arithmetic" if computing >= moving else "memory"
        if flops:
            out["intensity"] = flops / moved
    return out


def arguments_of(parts):
    return {p for p in parts if ":" in p and p.split(":")[0] not in ("width", "height", "threads")}


def oracle_pairs(entries):
    """Benchmarks named node/plain_CASE/… measure the oracle of node/CASE/…: speed-up by pixel."""
    for entry in entries:
        parts = entry["name"].split("/")
        if len(parts) < 2 or not parts[1].startswith("plain_") or "ns_per_pixel" not in entry:
            continue
        for other in entries:
            names = other["name"].split("/")
            # Arguments such as noise:8 must be the same; sizes and threads need not.
            same = arguments_of(parts) == arguments_of(names)
            if names[0] == parts[0] and names[1] == parts[1][len("plain_"):] and same and other["threads"] == 1 and \
                    "ns_per_pixel" in other:
                other["times_faster_than_oracle"] = entry["ns_per_pixel"] / other["ns_per_pixel"]


def kernels(program, results, pattern=".", min_time=0.2):
    key = f"kernels:{pattern}:{min_time}:{program.identity}:{file_hash(program.bench)}"
    if results.known(key):
        say("kernels: known")
        return
    probes = run_benchmarks(program, "^machine/", min_time)
    limits = limits_of(probes)
    say("limits: " + "; ".join(
        f"{what} {value / 1e9:.1f} G{'B' if what == 'triad' else 'flop'}/s on {n} thread{'s' if n > 1 else ''}"
        for what, by_threads in limits.items() for n, value in by_threads.items()))
    names = [n for n in run([program.bench, "--benchmark_list_tests", f"--benchmark_filter={pattern}"]).out.split()
             if not n.startswith("machine/")]
    entries, groups = [], {}
    for name in names:
        groups.setdefault("/".join(name.split("/")[:2]), []).append(name)
    # Sizes and threads of a node run in one process: starting it takes longer than many of them.
    for group, of in groups.items():
        part = f"kernel:{'|'.join(of)}:{min_time}:{program.identity}:{file_hash(program.bench)}"
        known = results.known(part)
        if known is None:
            try:
                lines = run_benchmarks(program, "^(" + "|".join(re.escape(n).replace(r"\-", "-") for n in of) + ")$", min_time)
            except BenchError as e:
                say(f"kernels: {group}: {e.reason()}")
                continue
            known = results.add("kernel_run", part, what=group, raw=lines)
        entries += [figures(line, limits) for line in known["raw"]]
    oracle_pairs(entries)
    for entry in entries:
        share = f", {100 * entry['share_of_limit']:.0f} % of the {entry['bound_by']} limit" \
            if "share_of_limit" in entry else ""
        rate = f"{entry['ns_per_pixel']:.1f} ns a pixel" if "ns_per_pixel" in entry else f"{entry['seconds']:.3g} s"
        say(f"{entry['name']}: {rate}{share}")
    results.add("kernels", key, what=f"kernels {pattern}", limits=limits, entries=entries)
