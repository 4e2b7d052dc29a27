# SPDX-License-Identifier: Apache-2.0
"""What every part of the benchmark needs: running programs, the machine, and the file of results."""

import datetime
import hashlib
import json
import math
import os
import pathlib
import platform
import resource
import subprocess
import sys
import time

SOURCE = pathlib.Path(__file__).resolve().parents[3]


class BenchError(Exception):
    """Something the user can put right; its text says what."""

    def reason(self):
        """One line of it: of a program that failed, what it said first."""
        lines = str(self).splitlines()
        return lines[1] if len(lines) > 1 else lines[0]


def say(text):
    print(text, file=sys.stderr, flush=True)


class Finished:
    """A program that ended well: what it printed and what it took."""

    def __init__(self, out, wall, cpu, max_rss):
        self.out, self.wall, self.cpu, self.max_rss = out, wall, cpu, max_rss


def run(arguments, cwd=None):
    """Runs a program; wall-clock and processor seconds and the largest resident set in bytes."""
    arguments = [str(a) for a in arguments]
    begin = time.perf_counter()
    try:
        process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=cwd)
    except OSError as e:
        raise BenchError(f"{arguments[0]} cannot be run: {e.strerror}") from e
    with process:
        # stderr is short; stdout of a JSON list of benchmarks fits a pipe's reader below.
        try:
            out = process.stdout.read()
            err = process.stderr.read()
            _, status, usage = os.wait4(process.pid, 0)
        except BaseException:
            process.kill()
            raise
        process.returncode = os.waitstatus_to_exitcode(status)
    wall = time.perf_counter() - begin
    if process.returncode != 0:
        raise BenchError(f"{' '.join(arguments)}\nended with {process.returncode}: "
                         f"{err.decode(errors='replace').strip()}")
    return Finished(out.decode(), wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024)


def _first(path, key):
    try:
        for line in pathlib.Path(path).read_text().splitlines():
            if line.startswith(key):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return None


def machine():
    """The machine, as far as it bears on time."""
    memory = _first("/proc/meminfo", "MemTotal")
    return {
        "cpu": _first("/proc/cpuinfo", "model name") or platform.processor() or platform.machine(),
        "threads": len(os.sched_getaffinity(0)),
        "memory_bytes": int(memory.split()[0]) * 1024 if memory else None,
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
    }


def git(*arguments, cwd=SOURCE):
    try:
        return subprocess.run(["git", *arguments], cwd=cwd, capture_output=True, text=True,
                              check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None


def commit():
    """The commit the work tree stands on, with "+" where it holds changes."""
    name = git("rev-parse", "--short=12", "HEAD")
    if not name:
        return "unknown"
    return name + ("+" if git("status", "--porcelain", "--untracked-files=no") else "")


def file_hash(*paths):
    digest = hashlib.sha256()
    for path in paths:
        digest.update(pathlib.Path(path).read_bytes())
    return digest.hexdigest()[:16]


class Program:
    """A build: the command, the kernel benchmarks, and a name for exactly these bytes."""

    def __init__(self, build):
        self.build = pathlib.Path(build)
        self.rayloom = self.build / "bin/rayloom"
        self.bench = self.build / "bin/rayloom_bench"
        if not self.rayloom.is_file():
            raise BenchError(f"{self.rayloom} is missing; ./dev build makes it")
        libraries = sorted(self.build.glob("lib/librayloom.so")) + sorted(self.build.glob("librayloom.so"))
        self.identity = file_hash(self.rayloom, *libraries)

    def json(self, *arguments):
        return json.loads(run([self.rayloom, *arguments]).out)

    def graph(self, path):
        """Name, inputs and outputs of a graph file."""
        return self.json("check", "--json", path)

    def run_graph(self, graph, inputs, output, options=()):
        """Runs a graph. Gives the report of --stats=json and what the process took."""
        done = run([self.rayloom, "run", graph,
                    *(a for i in inputs for a in ("-i", i)), "-o", output, "--stats=json", "-q",
                    *options])
        return json.loads(done.out), done

    def compare(self, image, other, *options):
        return self.json("compare", image, other, "--json", *options)


class Results:
    """JSON lines, one a measurement. A line is written whole once it is known, so an interrupted
    run keeps what it did, and `known` lets the next one go on from there."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.path = self.folder / "results.jsonl"
        self.lines = []
        if self.path.exists():
            text = self.path.read_text()
            for line in text.splitlines():
                try:
                    self.lines.append(json.loads(line))
                except json.JSONDecodeError:
                    say(f"{self.path}: a broken line is passed over (a run that was cut short)")
            if text and not text.endswith("\n"):
                with self.path.open("a") as file:
                    file.write("\n")
        self._machine, self._commit = machine(), commit()

    def known(self, key):
        return next((line for line in reversed(self.lines) if line.get("key") == key), None)

    def add(self, kind, key, **values):
        line = {"kind": kind, "key": key, **values, "machine": self._machine,
                "load": [round(x, 2) for x in os.getloadavg()],
                "date": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
                "commit": self._commit}
        text = json.dumps(line, ensure_ascii=False)
        with self.path.open("a") as file:
            file.write(text + "\n")
            file.flush()
            os.fsync(file.fileno())
        self.lines.append(line)
        return line

    def latest(self, kind):
        """The lines of a kind; of several that measured the same thing, the last."""
        found = {}
        for line in self.lines:
            if line["kind"] == kind:
                found[line.get("what", line["key"])] = line
        return list(found.values())


def finite(x):
    return isinstance(x, (int, float)) and math.isfinite(x)


# Two-sided 95 % quantiles of Student's t, by degrees of freedom 1 … 30.
STUDENT_95 = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179,
              2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064,
              2.060, 2.056, 2.052, 2.048, 2.045, 2.042]


def ratio_interval(first, second):
    """Ratio second/first of paired measurements with its 95 % confidence interval, from Student's t
    of the logarithms of the pairs' ratios."""
    logs = [math.log(b / a) for a, b in zip(first, second)]
    n = len(logs)
    if n < 2:
        raise ValueError("a confidence interval needs two pairs")
    mean = sum(logs) / n
    spread = math.sqrt(sum((x - mean) ** 2 for x in logs) / (n - 1))
    t = STUDENT_95[n - 2] if n - 1 <= len(STUDENT_95) else 1.96
    half = t * spread / math.sqrt(n)
    return math.exp(mean), math.exp(mean - half), math.exp(mean + half)
