# SPDX-License-Identifier: Apache-2.0
"""EXR files of any size from mirrored copies of a small one: real noise without seams that a filter
would see. Rows are made once and written as they are needed, so that a file of 64 megapixels and
thirty channels takes the memory of the small one."""

import array
import pathlib
import struct

from common import BenchError, run

MAGIC = struct.pack("<I", 20000630)
MULTI_PART = 0x1000
SAMPLE_BYTES = {0: 4, 1: 2, 2: 4}  # uint, half, float
HALF = 1
ARRAY_CODE = {2: "H", 4: "I"}


def _text(data, at):
    end = data.index(b"\0", at)
    return data[at:end], end + 1


def _attributes(data, at):
    """Name, type and bytes of each attribute of one header, and where the next begins."""
    found = []
    while data[at] != 0:
        name, at = _text(data, at)
        kind, at = _text(data, at)
        size, = struct.unpack_from("<I", data, at)
        found.append((name, kind, data[at + 4:at + 4 + size]))
        at += 4 + size
    return found, at + 1


def _channels(value):
    """Name and type of each channel, in the order of the rows."""
    found, at = [], 0
    while value[at] != 0:
        name, at = _text(value, at)
        kind, = struct.unpack_from("<I", value, at)
        found.append((name.decode(), kind))
        at += 16
    return found


class _Part:
    def __init__(self, attributes):
        self.attributes = attributes
        value = {name: v for name, _, v in attributes}
        self.channels = _channels(value[b"channels"])
        self.sizes = [SAMPLE_BYTES[kind] for _, kind in self.channels]
        x0, y0, x1, y1 = struct.unpack("<4i", value[b"dataWindow"])
        self.origin, self.width, self.height = (x0, y0), x1 - x0 + 1, y1 - y0 + 1
        self.rows = {}

    def header(self, width, height):
        window = struct.pack("<4i", 0, 0, width - 1, height - 1)
        out = b""
        for name, kind, value in self.attributes:
            if name in (b"dataWindow", b"displayWindow"):
                value = window
            if name == b"chunkCount":
                value = struct.pack("<I", height)
            out += name + b"\0" + kind + b"\0" + struct.pack("<I", len(value)) + value
        return out + b"\0"

    def row_bytes(self, width):
        return width * sum(self.sizes)

    def wide(self, row, width, black):
        """A row with its mirrored copies, channel after channel."""
        out, at = [], 0
        for (name, _), size in zip(self.channels, self.sizes):
            samples = array.array(ARRAY_CODE[size], row[at:at + size * self.width])
            at += size * self.width
            both = samples.tobytes() + samples[::-1].tobytes()
            dark = round(black(name) * width) * size
            out.append(bytes(dark) + (both * -(-width * size // len(both)))[dark:width * size])
        return b"".join(out)


def _headers(path, data):
    """Parts of a file, whether it is one of several, and where the headers end."""
    if data[:4] != MAGIC:
        raise BenchError(f"{path} is no EXR file")
    version, = struct.unpack_from("<I", data, 4)
    multi, at, parts = bool(version & MULTI_PART), 8, []
    while True:
        attributes, at = _attributes(data, at)
        parts.append(_Part(attributes))
        if not multi:
            return parts, multi, at
        if data[at] == 0:
            return parts, multi, at + 1


def _read(path):
    """Parts with their rows, of a file that is not compressed."""
    data = path.read_bytes()
    parts, multi, at = _headers(path, data)
    at += 8 * sum(p.height for p in parts)
    while at < len(data):
        number = 0
        if multi:
            number, = struct.unpack_from("<i", data, at)
            at += 4
        y, size = struct.unpack_from("<iI", data, at)
        part = parts[number]
        part.rows[y - part.origin[1]] = data[at + 8:at + 8 + size]
        at += 8 + size
    return data[:8], multi, parts


def enlarge(source, target, width, height, black=lambda channel: 0.0):
    """Writes `source` as width × height pixels with the same channels, types, layers and parts,
    not compressed. `black` gives the share of a channel's columns, from the left, that are 0."""
    plain = target.with_suffix(".plain.exr")
    # Channels of several types would all become float.
    kinds = {name: kind for p in _headers(source, source.read_bytes())[0] for name, kind in p.channels}
    types = [a for name, kind in kinds.items() for a in ("-d", f"{name}={'half' if kind == HALF else 'float'}")]
    run(["oiiotool", "-a", source, *types, "--scanline", "--compression", "none", "-o", plain])
    start, multi, parts = _read(plain)
    plain.unlink()
    headers = b"".join(p.header(width, height) for p in parts) + (b"\0" if multi else b"")
    with pathlib.Path(target).open("wb") as out:
        out.write(start + headers)
        at = out.tell() + 8 * height * len(parts)
        for part in parts:
            step = part.row_bytes(width) + (12 if multi else 8)
            out.write(array.array("Q", range(at, at + step * height, step)).tobytes())
            at += step * height
        for number, part in enumerate(parts):
            size, wide = part.row_bytes(width), {}
            for y in range(height):
                k = y % (2 * part.height)
                k = min(k, 2 * part.height - 1 - k)
                if k not in wide:
                    wide[k] = part.wide(part.rows[k], width, black)
                out.write((struct.pack("<i", number) if multi else b"") + struct.pack("<iI", y, size))
                out.write(wide[k])
