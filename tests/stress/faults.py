#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What disks, machines and people do to a running command, done on purpose. After each fault: the right
exit code, nothing half-written under the final name, the earlier file as it was.

Usage: faults.py BUILD [--soak] [NAME...]     NAME: one of the faults (all)
The last line counts the faults injected."""

import argparse
import contextlib
import hashlib
import os
import pathlib
import random
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time

SOURCE = pathlib.Path(__file__).resolve().parents[2]
SCENE = SOURCE / "tests/data/cycles/interior"
RENDER = SCENE / "stack/s01.exr"
GRAPH = "ray-histogram-fusion-stack"
STACK = f"stack={SCENE}/stack/s%02d.exr@1-4"
EARLIER = b"the earlier file"
NOBODY = 65534
PLAIN_FORMATS = ["tif", "jpg", "png", "hdr", "tga"]

# A median over a wide window: seconds of code between two looks at the clock.
SLOW = """rayloom: 1
name: slow
inputs: {color: {channels: RGB}}
nodes: {slow: {op: oiio.median, image: color, width: 31}}
outputs: {image: slow}
"""
# Reads and writes, and nothing else to speak of: most of the time a file is open.
COPY = """rayloom: 1
name: copy
inputs: {color: {channels: RGB}}
nodes: {twice: {op: oiio.mul, image: color, value: 2}}
outputs: {image: twice}
"""
# The same of a deep picture.
COPY_DEEP = """rayloom: 1
name: copy-deep
inputs: {deep: {kind: deep}}
nodes:
  flat: {op: transform.deep_flatten, deep: deep}
  again: {op: transform.deep_recolor, deep: deep, color: flat}
outputs: {deep: again}
"""


class Fault(AssertionError):
    pass


class Bench:
    """One fault's folder, and what it may do there."""

    def __init__(self, build, soak, seed):
        self.program = str(pathlib.Path(build).resolve() / "bin/rayloom")
        self.soak = soak
        self.random = random.Random(seed)
        self.injected = 0
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="rayloom-fault-"))
        (self.folder / "slow.yaml").write_text(SLOW)
        (self.folder / "copy.yaml").write_text(COPY)
        (self.folder / "copy-deep.yaml").write_text(COPY_DEEP)

    def close(self):
        shutil.rmtree(self.folder, ignore_errors=True)

    def start(self, *arguments, folder=None, before=None):
        return subprocess.Popen([self.program, *map(str, arguments)], cwd=folder or self.folder,
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL,
                                preexec_fn=before)

    def run(self, *arguments, folder=None, before=None, timeout=300):
        child = self.start(*arguments, folder=folder, before=before)
        out, err = child.communicate(timeout=timeout)
        return Result(child.returncode, out.decode(errors="replace"), err.decode(errors="replace"))

    def denoise(self, *more, out="image=out.exr", **how):
        return self.run("run", GRAPH, "-i", STACK, "-o", out, "-q", *more, **how)

    def fault(self):
        self.injected += 1


class Result:
    def __init__(self, code, out, err):
        self.code, self.out, self.err = code, out, err

    def expect(self, codes, what):
        if self.code not in codes:
            raise Fault(f"{what}: exit code {self.code}, not one of {sorted(codes)}\n{self.err[-800:]}")
        if self.code not in (0, 127) and not self.err.strip():
            raise Fault(f"{what}: exit code {self.code} and not a word")
        return self


def content(path):
    return hashlib.sha256(pathlib.Path(path).read_bytes()).hexdigest()


def names(folder):
    return sorted(p.name for p in folder.iterdir())


def expect(condition, what):
    if not condition:
        raise Fault(what)


def expect_earlier(path, what):
    expect(path.read_bytes() == EARLIER, f"{what}: the earlier file is not as it was")


@contextlib.contextmanager
def small_disk(bench, size):
    """A file system of `size` bytes at bench.folder/disk; needs root. Else limited file sizes."""
    disk = bench.folder / "disk"
    disk.mkdir(exist_ok=True)
    mounted = os.geteuid() == 0 and subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size}", "none", str(disk)], capture_output=True).returncode == 0

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
    try:
        yield disk, None if mounted else limit
    finally:
        if mounted:
            subprocess.run(["umount", "-l", str(disk)], check=False)
        shutil.rmtree(disk, ignore_errors=True)


# ------------------------------------------------------------------------------------------- faults


def disk_full(bench):
    """The disk is full at the first byte, in the middle, at the end; the cache's disk, too."""
    whole = bench.denoise().expect({0}, "to begin with")
    size, expected = (bench.folder / "out.exr").stat().st_size, content(bench.folder / "out.exr")
    sizes = [4096, 8192, size // 2, size - 1] + [bench.random.randrange(4096, size) for _ in range(20 * bench.soak)]
    for space in sizes:
        with small_disk(bench, space) as (disk, before):
            (disk / "out.exr").write_bytes(EARLIER)
            bench.fault()
            bench.denoise(out="image=disk/out.exr", before=before).expect({4}, f"disk of {space} bytes")
            expect_earlier(disk / "out.exr", f"disk of {space} bytes")
            expect(names(disk) == ["out.exr"], f"disk of {space} bytes: left {names(disk)}")
    # A cache that cannot be written costs time and nothing else.
    for space in [4096, 65536]:
        with small_disk(bench, space) as (disk, before):
            if before:
                continue  # the limit would hold for the output as well
            bench.fault()
            bench.denoise("--cache", "disk/cache").expect({0}, f"cache on a disk of {space} bytes")
            expect(content(bench.folder / "out.exr") == expected, "other pixels with a full cache disk")
    return whole


def write_deep(path, size, seed):
    """A deep EXR of size x size pixels with nought to eight samples of R, G, B, A, Z, not compressed. It has
    a date, without which OpenImageIO gives every copy the time of its making."""
    noise = random.Random(seed)
    channels = b"".join(name + bytes(1) + struct.pack("<iB3xii", 2, 0, 1, 1) for name in (b"A", b"B", b"G", b"R", b"Z"))
    box = struct.pack("<4i", 0, 0, size - 1, size - 1)
    header = b"".join(name + b"\0" + kind + b"\0" + struct.pack("<i", len(value)) + value for name, kind, value in [
        (b"capDate", b"string", b"2026:01:01 00:00:00"), (b"channels", b"chlist", channels + b"\0"),
        (b"chunkCount", b"int", struct.pack("<i", size)), (b"compression", b"compression", b"\0"),
        (b"dataWindow", b"box2i", box), (b"displayWindow", b"box2i", box), (b"lineOrder", b"lineOrder", b"\0"),
        (b"maxSamplesPerPixel", b"int", struct.pack("<i", 8)), (b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
        (b"screenWindowCenter", b"v2f", bytes(8)), (b"screenWindowWidth", b"float", struct.pack("<f", 1)), (b"type", b"string", b"deepscanline"),
        (b"version", b"int", struct.pack("<i", 1))])
    head = struct.pack("<ii", 20000630, 2 | 0x800) + header + b"\0"
    rows = []
    for y in range(size):
        ends, total = [], 0
        for _ in range(size):
            total += noise.randrange(9)
            ends.append(total)
        colors = [noise.uniform(0.0, 0.5) for _ in range(4 * total)]
        depths = [noise.uniform(1.0, 9.0) for _ in range(total)]
        samples = struct.pack(f"<{5 * total}f", *colors, *depths)
        rows.append(struct.pack("<iQQQ", y, 4 * size, len(samples), len(samples)) + struct.pack(f"<{size}i", *ends) +
                    samples)
    at, table = len(head) + 8 * size, []
    for row in rows:
        table.append(at)
        at += len(row)
    path.write_bytes(head + struct.pack(f"<{size}Q", *table) + b"".join(rows))


def deep_disk_full(bench):
    """The disk is full while a deep EXR is written."""
    write_deep(bench.folder / "deep.exr", 60, 1)
    copy = ["run", "copy-deep.yaml", "-i", "deep=deep.exr", "-q", "-o"]
    bench.run(*copy, "deep=out.exr").expect({0}, "to begin with")
    size = (bench.folder / "out.exr").stat().st_size
    sizes = [4096, 8192, size // 2, size - 1] + [bench.random.randrange(4096, size) for _ in range(20 * bench.soak)]
    for space in sizes:
        with small_disk(bench, space) as (disk, before):
            (disk / "out.exr").write_bytes(EARLIER)
            bench.fault()
            bench.run(*copy, "deep=disk/out.exr", before=before).expect({4}, f"disk of {space} bytes")
            expect_earlier(disk / "out.exr", f"disk of {space} bytes")
            expect(names(disk) == ["out.exr"], f"disk of {space} bytes: left {names(disk)}")


def unwritable(bench):
    """A folder, or an earlier file's folder, that may not be written to; a name that is a folder."""
    locked = bench.folder / "locked"
    locked.mkdir()
    (locked / "out.exr").write_bytes(EARLIER)
    locked.chmod(0o555)
    bench.folder.chmod(0o755)
    become = (lambda: os.setuid(NOBODY)) if os.geteuid() == 0 else None
    reaches = subprocess.run([bench.program, "--version"], preexec_fn=become, capture_output=True).returncode == 0
    if reaches:
        bench.fault()
        bench.denoise(out="image=locked/out.exr", before=become).expect({4}, "unwritable folder")
        expect_earlier(locked / "out.exr", "unwritable folder")
        bench.fault()
        bench.denoise("--cache", "locked/cache", out="image=/dev/null/out.exr",
                      before=become).expect({4}, "a device for a folder")
    locked.chmod(0o755)
    (bench.folder / "folder.exr").mkdir()
    for out in ("image=folder.exr", "image=not/there/out.exr", "image=/dev/full", "image=copy.yaml/out.exr"):
        bench.fault()
        bench.denoise(out=out).expect({2, 4}, out)
    bench.fault()
    link = bench.folder / "link.exr"
    link.symlink_to(link)
    bench.denoise(out="image=link.exr").expect({4}, "a link to itself")


def vanishing_folder(bench):
    """The folder of the output goes while pixels are computed."""
    for _ in range(1 + 4 * bench.soak):
        going = bench.folder / "going"
        going.mkdir()
        child = bench.start("run", "slow.yaml", "-i", f"color={SCENE}/ref.exr", "-o", "image=going/out.exr")
        wait_for(child, b"filtered")
        bench.fault()
        shutil.rmtree(going)
        err = child.communicate(timeout=300)[1].decode(errors="replace")
        Result(child.returncode, "", err or "?").expect({4}, "vanished folder")
        expect(not going.exists(), "the folder came back")


def wait_for(child, word):
    """Reads what the command says until the word comes: then it computes pixels."""
    said = b""
    while word not in said:
        c = os.read(child.stderr.fileno(), 1)
        if not c:
            raise Fault(f"it ended before it said {word!r}: {said[-500:]!r}")
        said += c
    return said


def stopped(bench, number, codes, graph="copy.yaml", read="color=large.exr", write="image"):
    """One signal at a random time of a run that mostly writes."""
    out = bench.folder / "work"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    arguments = ["run", graph, "-i", read, "-o", f"{write}=work/out.exr", "-q"]
    begin = time.monotonic()
    bench.run(*arguments).expect({0}, "to begin with")
    lasts = time.monotonic() - begin
    complete = content(out / "out.exr")
    left = finished = 0
    rounds = 400 if bench.soak else 12
    for _ in range(rounds):
        (out / "out.exr").write_bytes(EARLIER)
        child = bench.start(*arguments)
        time.sleep(bench.random.uniform(0.0, 1.1 * lasts))
        bench.fault()
        child.send_signal(number)
        asked = time.monotonic()
        err = child.communicate(timeout=60)[1].decode(errors="replace")
        waited = time.monotonic() - asked
        expect(waited < 5.0 + lasts, f"it went on for {waited:.1f} s")
        # Before main() began, a signal ends a process as it ends any.
        if child.returncode not in codes | {0, -number}:
            raise Fault(f"exit code {child.returncode}: {err[-500:]}")
        if content(out / "out.exr") == complete:
            finished += 1
        else:
            expect_earlier(out / "out.exr", f"after signal {number}")
        for name in names(out):
            if name != "out.exr":
                expect(number == signal.SIGKILL and name.startswith("."), f"left {name}")
                (out / name).unlink()
                left += 1
    print(f"    {rounds} signals over {lasts:.2f} s: {finished} came after the file was whole, "
          f"{left} left a hidden file")


def make_large(bench):
    """A picture of a few megabytes, so that writing takes a while."""
    (bench.folder / "large.yaml").write_text(
        "rayloom: 1\nname: large\ninputs: {color: {channels: RGB}}\n"
        "nodes: {big: {op: oiio.resize, image: color, width: 1400, height: 1400}}\noutputs: {image: big}\n")
    bench.run("run", "large.yaml", "-i", f"color={SCENE}/ref.exr", "-o", "image=large.exr", "-q",
              "--compression", "none").expect({0}, "a large picture")


def kill(bench):
    """kill -9 at random times while a file is written."""
    make_large(bench)
    stopped(bench, signal.SIGKILL, {-signal.SIGKILL})


def interrupt(bench):
    """Ctrl-C and SIGTERM at random times while a file is written."""
    make_large(bench)
    stopped(bench, signal.SIGINT, {130})
    stopped(bench, signal.SIGTERM, {130})


def deep_stopped(bench):
    """kill -9 and SIGTERM at random times while a deep EXR is written."""
    write_deep(bench.folder / "deep.exr", 200, 2)
    stopped(bench, signal.SIGKILL, {-signal.SIGKILL}, "copy-deep.yaml", "deep=deep.exr", "deep")
    stopped(bench, signal.SIGTERM, {130}, "copy-deep.yaml", "deep=deep.exr", "deep")


def address_space(bench):
    """Less address space than it takes, from too little to load the libraries up to enough."""
    bench.denoise("-t", "2").expect({0}, "to begin with")
    expected = content(bench.folder / "out.exr")
    seen = {}
    sizes = range(40, 1600, 20) if bench.soak else [100, 460, 480, 500, 540, 600, 900]
    for megabytes in sizes:
        (bench.folder / "out.exr").write_bytes(EARLIER)

        def limit(bytes=megabytes << 20):
            resource.setrlimit(resource.RLIMIT_AS, (bytes, bytes))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        bench.fault()
        # Where not even the libraries that rayloom stands on have room, they end as they end.
        starts = subprocess.run([bench.program, "--version"], preexec_fn=limit, capture_output=True).returncode == 0
        r = bench.denoise("-t", "2", before=limit)
        if starts:
            r.expect({0, 5}, f"ulimit -v {megabytes} MiB")
        seen[r.code] = seen.get(r.code, 0) + 1
        if r.code == 0:
            expect(content(bench.folder / "out.exr") == expected, f"other pixels in {megabytes} MiB")
        else:
            expect_earlier(bench.folder / "out.exr", f"ulimit -v {megabytes} MiB")
    print("    exit codes: " + ", ".join(f"{n} times {code}" for code, n in sorted(seen.items())))


def memory_budget(bench):
    """--memory from nothing to plenty: the same bytes, or a refusal."""
    bench.denoise().expect({0}, "to begin with")
    expected = content(bench.folder / "out.exr")
    seen = {}
    budget = 1000
    while budget < 1 << 26:
        (bench.folder / "out.exr").write_bytes(EARLIER)
        bench.fault()
        r = bench.denoise("--memory", budget).expect({0, 5}, f"--memory {budget}")
        seen[r.code] = seen.get(r.code, 0) + 1
        if r.code == 0:
            expect(content(bench.folder / "out.exr") == expected, f"other pixels with --memory {budget}")
        else:
            expect_earlier(bench.folder / "out.exr", f"--memory {budget}")
        budget = int(budget * (1.5 if bench.soak else 3.1))
    expect(set(seen) == {0, 5}, f"budgets did not reach from refusal to plenty: {seen}")


def truncated(bench):
    """An input cut off at every 4 KiB: refused by name, nothing written."""
    inputs = [RENDER, SCENE / "noisy_16.exr", SCENE / "ref.exr"] if bench.soak else [RENDER]
    for whole in inputs:
        data = whole.read_bytes()
        for size in range(0, len(data), 4096):
            (bench.folder / "cut.exr").write_bytes(data[:size])
            (bench.folder / "out.exr").write_bytes(EARLIER)
            bench.fault()
            r = bench.run("run", "copy.yaml", "-i", "color=cut.exr", "-o", "image=out.exr", "-q")
            r.expect({3}, f"{whole.name} cut at {size}")
            expect("cut.exr: " in r.err, f"{whole.name} cut at {size}: the file is not named")
            expect_earlier(bench.folder / "out.exr", f"{whole.name} cut at {size}")
    for name in PLAIN_FORMATS:
        whole = plain_render(bench, name)
        # Where less than a row is missing a reader may have every pixel all the same.
        sizes = range(0, len(whole) * 95 // 100, max(1, len(whole) // (40 if bench.soak else 3)))
        for size in sizes:
            cut = f"cut.{name}"
            (bench.folder / cut).write_bytes(whole[:size])
            (bench.folder / "out.exr").write_bytes(EARLIER)
            bench.fault()
            r = bench.run("run", "copy.yaml", "-i", f"color={cut}", "-o", "image=out.exr", "-q")
            r.expect({3}, f"{name} of {len(whole)} bytes cut at {size}")
            expect(f"{cut}: " in r.err, f"{name} cut at {size}: the file is not named")
            expect_earlier(bench.folder / "out.exr", f"{name} cut at {size}")


def plain_render(bench, ending):
    """The render in a format without layers."""
    name = f"whole.{ending}"
    bench.run("run", "copy.yaml", "-i", f"color={RENDER}", "-o", f"image={name}", "-q").expect({0}, name)
    return (bench.folder / name).read_bytes()


def damaged(bench):
    """An input with random bytes changed: refused, or read; never a crash."""
    exr = RENDER.read_bytes()
    plain = {name: plain_render(bench, name) for name in PLAIN_FORMATS}
    for i in range(2400 if bench.soak else 24):
        kind = "exr" if i % 6 else PLAIN_FORMATS[i // 6 % len(PLAIN_FORMATS)]
        data = exr if i % 6 else plain[kind]
        bad = bytearray(data)
        place = bench.random.randrange(min(len(bad), 1200) if i % 2 else len(bad))
        for k in range(bench.random.choice([1, 1, 4, 32])):
            bad[(place + k) % len(bad)] = bench.random.randrange(256)
        (bench.folder / f"bad.{kind}").write_bytes(bad)
        (bench.folder / "out.exr").unlink(missing_ok=True)
        bench.fault()

        def limit():
            resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        r = bench.run("run", "copy.yaml", "-i", f"color=bad.{kind}", "-o", "image=out.exr", "-q", before=limit)
        if r.code not in (0, 2, 3, 5):
            shutil.copy(bench.folder / f"bad.{kind}",
                        pathlib.Path(tempfile.gettempdir()) / f"rayloom-crash.{kind}")
        r.expect({0, 2, 3, 5}, f"damage {i} at byte {place}, kept as rayloom-crash.{kind}")
        expect((bench.folder / "out.exr").exists() == (r.code == 0), f"damage {i}: exit code {r.code}")


def replaced(bench):
    """The input is replaced, cut off or removed while it is read."""
    for how in ("rename", "remove", "truncate"):
        for _ in range(1 + 9 * bench.soak):
            shutil.copy(SCENE / "ref.exr", bench.folder / "in.exr")
            (bench.folder / "out.exr").write_bytes(EARLIER)
            child = bench.start("run", "slow.yaml", "-i", "color=in.exr", "-o", "image=out.exr", "--memory", "3M")
            wait_for(child, b"filtered")
            time.sleep(bench.random.uniform(0.0, 0.2))
            bench.fault()
            if how == "rename":
                shutil.copy(SOURCE / "tests/data/cycles/cornell/ref.exr", bench.folder / "other.exr")
                os.replace(bench.folder / "other.exr", bench.folder / "in.exr")
            elif how == "remove":
                (bench.folder / "in.exr").unlink()
            else:
                os.truncate(bench.folder / "in.exr", 9000)
            err = child.communicate(timeout=300)[1].decode(errors="replace")
            Result(child.returncode, "", err or "?").expect({0, 3}, how)
            if child.returncode == 0:
                bench.run("run", "slow.yaml", "-i", f"color={SCENE}/ref.exr", "-o", "image=expected.exr", "-q")
                expect(content(bench.folder / "out.exr") == content(bench.folder / "expected.exr"),
                       f"{how}: neither the file that was opened nor an error")
            else:
                expect_earlier(bench.folder / "out.exr", how)


def many_frames(bench):
    """A pattern of 10 000 frames (800 in the short version), whole and with gaps."""
    last = 10000 if bench.soak else 800
    (bench.folder / "tiny.yaml").write_text(
        "rayloom: 1\nname: tiny\ninputs: {color: {channels: RGB}}\n"
        "nodes: {cut: {op: oiio.cut, image: color, width: 4, height: 4}}\noutputs: {image: cut}\n")
    (bench.folder / "mean.yaml").write_text(
        "rayloom: 1\nname: mean\ninputs: {stack: {kind: list, channels: RGB}}\n"
        "nodes: {mean: {op: transform.statistics, stack: stack}}\noutputs: {image: mean.mean}\n")
    bench.run("run", "tiny.yaml", "-i", f"color={SCENE}/ref.exr", "-o", "image=tiny.exr", "-q").expect({0}, "tiny")
    shot = bench.folder / "shot"
    shot.mkdir()
    for frame in range(1, last + 1):
        os.link(bench.folder / "tiny.exr", shot / f"s.{frame:05d}.exr")
    bench.fault()
    bench.run("run", "mean.yaml", "-i", f"stack=shot/s.%05d.exr@1-{last}", "-o", "image=mean.exr", "-q").expect(
        {0}, f"a stack of {last}")
    compared = bench.run("compare", "mean.exr", "tiny.exr", "--no-flip", "--fail", "relmse=1e-12")
    compared.expect({0}, "the mean of many times the same")
    missing = [17, last // 2, last - 1]
    for frame in missing:
        (shot / f"s.{frame:05d}.exr").unlink()
    bench.fault()
    r = bench.run("run", "mean.yaml", "-i", f"stack=shot/s.%05d.exr@1-{last}", "-o", "image=gap.exr", "-q")
    r.expect({3}, "a gap in a stack")
    expect("s.00017.exr" in r.err, "the missing frame is not named")
    expect(not (bench.folder / "gap.exr").exists(), "a file in spite of the gap")
    first = 1 if bench.soak else last - 10
    bench.fault()
    r = bench.run("run", "tiny.yaml", "-i", "color=shot/s.%05d.exr", "-o", "image=out.%05d.exr", "--frames",
                  f"{first}-{last}", "--keep-going", "-q", timeout=3600)
    r.expect({3}, "frames with gaps")
    made = sum(1 for n in names(bench.folder) if n.startswith("out."))
    expect(made == last + 1 - first - sum(frame >= first for frame in missing), f"{made} frames were made")


def large_graphs(bench):
    """1 000 nodes in a row, 200 graphs inside one another."""
    nodes = ["  n0: {op: oiio.mul, image: color, value: 2}"]
    for i in range(1, 1000):
        nodes.append(f"  n{i}: {{op: oiio.mul, image: n{i - 1}, value: {0.5 if i % 2 else 2}}}")
    (bench.folder / "long.yaml").write_text(
        "rayloom: 1\nname: long\ninputs: {color: {channels: RGB}}\nnodes:\n" + "\n".join(nodes) +
        "\noutputs: {image: n999}\n")
    bench.fault()
    bench.run("run", "long.yaml", "-i", f"color={SCENE}/ref.exr", "-o", "image=long.exr", "-q").expect({0}, "1 000 nodes")
    bench.run("compare", "long.exr", f"{SCENE}/ref.exr:Combined", "--no-flip", "--fail", "relmse=1e-12").expect(
        {0}, "1 000 nodes that come to nothing")
    # Graphs may lie 16 deep in one another; more is refused, whether it ends or not.
    for depth in (15, 200):
        folder = bench.folder / f"deep{depth}"
        folder.mkdir()
        for i in range(depth):
            inner = (f"{{op: \"graph:g{i + 1}.yaml\", color: color}}" if i + 1 < depth
                     else "{op: oiio.mul, image: color, value: 1.5}")
            (folder / f"g{i}.yaml").write_text(
                f"rayloom: 1\nname: g{i}\ninputs: {{color: {{channels: RGB}}}}\nnodes: {{inner: {inner}}}\n"
                "outputs: {image: inner}\n")
        bench.fault()
        r = bench.run("run", f"deep{depth}/g0.yaml", "-i", f"color={SCENE}/ref.exr", "-o", "image=deep.exr", "-q")
        r.expect({2} if depth == 200 else {0}, f"{depth} graphs inside one another")
        if depth == 200:
            expect("graphs within graphs more than 16 deep" in r.err, "the reason is not said")


def broken_cache(bench):
    """Entries of the cache cut off, changed, emptied, exchanged, or folders: the same picture."""
    bench.denoise("--cache", "cache").expect({0}, "to begin with")
    expected = content(bench.folder / "out.exr")
    cache = bench.folder / "cache"
    entries = [p for p in sorted(cache.rglob("*")) if p.is_file()]
    expect(entries, "nothing was cached")

    def folder(path):
        path.unlink()
        path.mkdir()

    def change(path):
        data = bytearray(path.read_bytes())
        for _ in range(3):
            data[bench.random.randrange(len(data))] ^= 1 << bench.random.randrange(8)
        path.write_bytes(data)

    ways = {
        "cut off": lambda p: os.truncate(p, bench.random.randrange(p.stat().st_size)),
        "emptied": lambda p: os.truncate(p, 0),
        "bits changed": change,
        "made longer": lambda p: p.write_bytes(p.read_bytes() + b"more"),
        "exchanged": lambda p: shutil.copy(bench.random.choice([e for e in entries if e.is_file() and e != p]), p),
        "a folder": folder,
    }
    for _ in range(1 + 19 * bench.soak):
        for name, break_it in ways.items():
            shutil.rmtree(cache)
            bench.denoise("--cache", "cache").expect({0}, "filling the cache")
            entries = [p for p in sorted(cache.rglob("*")) if p.is_file()]
            for entry in entries:
                bench.fault()
                break_it(entry)
            bench.denoise("--cache", "cache").expect({0}, f"cache entries {name}")
            expect(content(bench.folder / "out.exr") == expected, f"other pixels with cache entries {name}")
    shutil.rmtree(cache)
    cache.write_text("not a folder")
    bench.fault()
    bench.denoise("--cache", "cache").expect({4}, "a file for a cache folder")


def shared_cache(bench):
    """Processes that fill and read one cache at once."""
    bench.denoise().expect({0}, "to begin with")
    expected = content(bench.folder / "out.exr")
    for _ in range(2 + 48 * bench.soak):
        shutil.rmtree(bench.folder / "cache", ignore_errors=True)
        children = [bench.start("run", GRAPH, "-i", STACK, "-o", f"image=out{i}.exr", "-q", "--cache", "cache")
                    for i in range(4)]
        for i, child in enumerate(children):
            bench.fault()
            err = child.communicate(timeout=300)[1].decode(errors="replace")
            Result(child.returncode, "", err or "?").expect({0}, "sharing a cache")
            expect(content(bench.folder / f"out{i}.exr") == expected, "other pixels from a shared cache")
        bench.denoise("--cache", "cache").expect({0}, "after sharing")
        expect(content(bench.folder / "out.exr") == expected, "other pixels from what was shared")


def trimmed_cache(bench):
    """Processes that fill, read and trim one cache at once: what one reads the others remove."""
    scenes = [f"stack={SOURCE}/tests/data/cycles/{name}/stack/s%02d.exr@1-4" for name in ("interior", "cornell")]
    expected = []
    for scene in scenes:
        bench.run("run", GRAPH, "-i", scene, "-o", "image=out.exr", "-q", "--cache", "cache").expect({0}, "first")
        expected.append(content(bench.folder / "out.exr"))
    sizes = sorted(p.stat().st_size for p in (bench.folder / "cache").iterdir())
    for room in (1, sizes[-1], sum(sizes) // 2):
        for _ in range(1 + 15 * bench.soak):
            children = [bench.start("run", GRAPH, "-i", scenes[i % 2], "-o", f"image=out{i}.exr", "-q",
                                    "--cache", "cache", "--cache-size", room) for i in range(4)]
            for i, child in enumerate(children):
                bench.fault()
                err = child.communicate(timeout=300)[1].decode(errors="replace")
                Result(child.returncode, "", err or "?").expect({0}, f"a cache of {room} bytes")
                expect(content(bench.folder / f"out{i}.exr") == expected[i % 2], f"other pixels, cache of {room} bytes")
            left = sum(p.stat().st_size for p in (bench.folder / "cache").iterdir())
            expect(left <= room, f"{left} bytes in a cache of {room}")


FAULTS = [disk_full, deep_disk_full, unwritable, vanishing_folder, kill, interrupt, deep_stopped, address_space,
          memory_budget, truncated, damaged, replaced, many_frames, large_graphs, broken_cache, shared_cache,
          trimmed_cache]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build")
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--soak", action="store_true", help="many times as many")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_intermixed_args()
    chosen = [f for f in FAULTS if not arguments.names or f.__name__ in arguments.names]
    injected = failed = 0
    for fault in chosen:
        bench = Bench(arguments.build, int(arguments.soak), arguments.seed)
        begin = time.monotonic()
        try:
            fault(bench)
            verdict = "ok"
        except Fault as e:
            verdict = f"FAILED: {e}"
            failed += 1
        finally:
            bench.close()
        injected += bench.injected
        print(f"{fault.__name__}: {bench.injected} faults in {time.monotonic() - begin:.1f} s: {verdict}", flush=True)
    print(f"{injected} faults injected, {failed} of {len(chosen)} kinds failed")
    return 1 if failed or not chosen else 0


if __name__ == "__main__":
    sys.exit(main())
