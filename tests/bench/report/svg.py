# SPDX-License-Identifier: Apache-2.0
"""Plots as SVG text: logarithmic or linear axes, lines, marks, error bars. Nothing is fetched, and they print.

Series differ by colour (Okabe and Ito's palette, told apart with any colour vision), by the shape of
their marks, and by their dashes, so that no one of them carries the meaning alone."""

import html
import math

COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8B6914", "#7F7F7F"]
SHAPES = ["square", "triangle", "diamond", "down", "cross", "plus", "star", "bar"]
DASHES = ["", "6 3", "2 2.5", "8 3 2 3", "4 2", "10 4", "1 3", "12 3 3 3"]
# For letters: the pale ones of the palette are hard to read on white.
DEEP = {"#E69F00": "#946600", "#56B4E9": "#1B76AB", "#CC79A7": "#9C3F74", "#7F7F7F": "#5F5F5F"}
INK, GRID = "#1c1c1c", "#e3e3e3"


def escape(text):
    return html.escape(str(text), quote=True)


def mark(shape, x, y, colour, size=4.6, title=""):
    s = size
    tip = f"<title>{escape(title)}</title>" if title else ""
    fill = f'class="mark" fill="{colour}" stroke="#fff" stroke-width="1"'
    line = f'class="mark" fill="none" stroke="{colour}" stroke-width="2.4"'
    if shape == "circle":
        return f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{s:.2f}" {fill}>{tip}</circle>'
    if shape in ("cross", "plus", "star"):
        d = ""
        if shape in ("cross", "star"):
            d += f"M{x-s:.2f} {y-s:.2f}L{x+s:.2f} {y+s:.2f}M{x-s:.2f} {y+s:.2f}L{x+s:.2f} {y-s:.2f}"
        if shape in ("plus", "star"):
            d += f"M{x-s*1.2:.2f} {y:.2f}H{x+s*1.2:.2f}M{x:.2f} {y-s*1.2:.2f}V{y+s*1.2:.2f}"
        return f'<path d="{d}" {line}>{tip}</path>'
    points = {"square": [(-.9, -.9), (.9, -.9), (.9, .9), (-.9, .9)],
              "triangle": [(0, -1.2), (1.1, .85), (-1.1, .85)],
              "down": [(0, 1.2), (1.1, -.85), (-1.1, -.85)],
              "diamond": [(0, -1.3), (1.2, 0), (0, 1.3), (-1.2, 0)],
              "bar": [(-1.3, -.45), (1.3, -.45), (1.3, .45), (-1.3, .45)]}[shape]
    text = " ".join(f"{x + s * a:.2f},{y + s * b:.2f}" for a, b in points)
    return f'<polygon points="{text}" {fill}>{tip}</polygon>'


def number(x):
    """A tick's label: 0.01, 1, 20, 1 000, 10⁻⁵."""
    if x == 0:
        return "0"
    if 1e-3 <= abs(x) < 1e5:
        text = f"{x:.4g}"
        return f"{int(x):,}".replace(",", " ") if float(x).is_integer() else text
    power = math.floor(math.log10(abs(x)) + 1e-9)
    digits = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    lead = x / 10 ** power
    return ("" if abs(lead - 1) < 1e-9 else f"{lead:.3g}·") + f"10{digits}"


class Axis:
    def __init__(self, low, high, log=True, only=None):
        self.log, self.only = log, only
        if log:
            low, high = math.log10(low), math.log10(high)
        if high - low < (0.3 if log else 1e-9):
            middle, half = (low + high) / 2, 0.15 if log else 0.5
            low, high = middle - half, middle + half
        room = 0.06 * (high - low)
        self.low, self.high = (low - room, high + room) if log else (low, high + room)

    def at(self, value):
        """Share of the axis, 0 … 1."""
        v = math.log10(value) if self.log else value
        return (v - self.low) / (self.high - self.low)

    def ticks(self):
        """(value, label or None for a fine line)."""
        if self.only:
            return [(v, number(v)) for v in self.only]
        if not self.log:
            span = self.high - self.low
            step = 10 ** math.floor(math.log10(span / 4))
            step = next(step * m for m in (1, 2, 5, 10) if span / (step * m) <= 5.5)
            first = math.ceil(self.low / step - 1e-9)
            return [(k * step, number(round(k * step, 10))) for k in range(first, int(self.high / step + 1e-9) + 1)]
        decades = self.high - self.low
        labelled = (1, 2, 5) if decades < 2.0 else (1,)
        if decades < 0.5:
            labelled = (1, 1.5, 2, 3, 4, 5, 6, 8)
        found = []
        for power in range(math.floor(self.low) - 1, math.ceil(self.high) + 1):
            for m in sorted(set(labelled) | {1, 2, 3, 4, 5, 6, 7, 8, 9}):
                value = m * 10.0 ** power
                if self.low <= math.log10(value) <= self.high:
                    every = 2 if decades > 7 else 1
                    shown = m in labelled and (m != 1 or power % every == 0)
                    found.append((value, number(value) if shown else None))
        return found


class Plot:
    def __init__(self, title, x, y, x_label, y_label, width=500, height=340, name=""):
        self.title, self.x, self.y = title, x, y
        self.x_label, self.y_label = x_label, y_label
        self.width, self.height, self.name = width, height, name
        self.left, self.right, self.top, self.bottom = 62, 14, 30, 46
        self.body = []

    def px(self, value):
        return self.left + self.x.at(value) * (self.width - self.left - self.right)

    def py(self, value):
        return self.height - self.bottom - self.y.at(value) * (self.height - self.top - self.bottom)

    def line(self, points, colour, dash="", width=1.8, opacity=1.0, kind="series"):
        if len(points) < 2:
            return
        d = "M" + "L".join(f"{self.px(x):.2f} {self.py(y):.2f}" for x, y in points)
        dashes = f' stroke-dasharray="{dash}"' if dash else ""
        self.body.append(f'<path class="{kind}" d="{d}" fill="none" stroke="{colour}" stroke-width="{width}"'
                         f' stroke-opacity="{opacity}"{dashes} stroke-linejoin="round"/>')

    def steps(self, points, colour, width=7, opacity=0.25):
        """A front: to the right of a point nothing is better until the next."""
        path = []
        for k, (x, y) in enumerate(points):
            if k:
                path.append((x, points[k - 1][1]))
            path.append((x, y))
        self.line(path, colour, "", width, opacity, "front")

    def marks(self, points, shape, colour, titles=(), size=4.6):
        for k, (x, y) in enumerate(points):
            self.body.append(mark(shape, self.px(x), self.py(y), colour, size, titles[k] if k < len(titles) else ""))

    def text(self, x, y, text, colour=INK, anchor="start", dx=0, dy=0, rotate=None, size=10.5):
        px, py = self.px(x) + dx, self.py(y) + dy
        turn = f' transform="rotate({rotate:.1f} {px:.1f} {py:.1f})"' if rotate else ""
        self.body.append(f'<text x="{px:.1f}" y="{py:.1f}" fill="{colour}" text-anchor="{anchor}"'
                         f' font-size="{size}" class="halo"{turn}>{escape(text)}</text>')

    def labels(self, wanted, obstacles, size=10.5):
        """Names beside their marks, each where it covers neither a mark nor another name; what finds no such
        place goes without. wanted: (marks it may stand beside, text, colour), the important first; obstacles: all marks."""
        taken = [(self.px(x) - 6, self.py(y) - 6, self.px(x) + 6, self.py(y) + 6) for x, y in obstacles]
        places = ((9, 4, "start"), (-9, 4, "end"), (0, -9, "middle"), (0, 16, "middle"),
                  (7, -6, "start"), (7, 13, "start"), (-7, -6, "end"), (-7, 13, "end"))
        for marks, text, colour in wanted:
            width = 0.59 * size * len(text)
            for (x, y), (dx, dy, anchor) in ((m, p) for m in marks for p in places):
                left = self.px(x) + dx - {"start": 0, "middle": width / 2, "end": width}[anchor]
                base = self.py(y) + dy
                box = (left, base - 0.8 * size, left + width, base + 0.25 * size)
                free = not any(box[0] < t[2] and t[0] < box[2] and box[1] < t[3] and t[1] < box[3] for t in taken)
                if free and box[0] > self.left and box[2] < self.width - self.right and \
                        box[1] > self.top and box[3] < self.height - self.bottom:
                    taken.append(box)
                    self.text(x, y, text, DEEP.get(colour, colour), anchor, dx, dy, size=size)
                    break

    def angle(self, x0, y0, x1, y1):
        """Of a line on the page, in degrees, for text along it."""
        return math.degrees(math.atan2(self.py(y1) - self.py(y0), self.px(x1) - self.px(x0)))

    def svg(self):
        left, right = self.left, self.width - self.right
        top, bottom = self.top, self.height - self.bottom
        clip = f"clip-{self.name}"
        out = [f'<svg class="plot" id="plot-{escape(self.name)}" viewBox="0 0 {self.width} {self.height}" '
               f'role="img" aria-label="{escape(self.title)}">',
               f'<clipPath id="{clip}"><rect x="{left}" y="{top - 6}" width="{right - left + 8}" '
               f'height="{bottom - top + 12}"/></clipPath>',
               f'<text x="{left}" y="16" font-size="13.5" font-weight="600" fill="{INK}">{escape(self.title)}</text>']
        for value, label in self.x.ticks():
            x = self.px(value)
            if not left - 1 <= x <= right + 1:
                continue
            if label:
                out.append(f'<path d="M{x:.2f} {top}V{bottom}" stroke="{GRID}"/>'
                           f'<text x="{x:.2f}" y="{bottom + 15}" text-anchor="middle" class="tick">{label}</text>')
            else:
                out.append(f'<path d="M{x:.2f} {bottom}v-4" stroke="#999" stroke-width="0.7"/>')
        for value, label in self.y.ticks():
            y = self.py(value)
            if not top - 1 <= y <= bottom + 1:
                continue
            if label:
                out.append(f'<path d="M{left} {y:.2f}H{right}" stroke="{GRID}"/>'
                           f'<text x="{left - 7}" y="{y + 3.6:.2f}" text-anchor="end" class="tick">{label}</text>')
            else:
                out.append(f'<path d="M{left} {y:.2f}h4" stroke="#999" stroke-width="0.7"/>')
        out.append(f'<path d="M{left} {top}V{bottom}H{right}" fill="none" stroke="{INK}" stroke-width="1"/>')
        out.append(f'<text x="{(left + right) / 2}" y="{self.height - 8}" text-anchor="middle" class="axis">'
                   f'{escape(self.x_label)}</text>')
        middle = (top + bottom) / 2
        if self.y_label:
            out.append(f'<text x="15" y="{middle}" text-anchor="middle" class="axis" '
                       f'transform="rotate(-90 15 {middle})">{escape(self.y_label)}</text>')
        out.append(f'<g clip-path="url(#{clip})">' + "".join(self.body) + "</g></svg>")
        return "".join(out)


def legend(entries):
    """entries: (label, colour, shape or None, dash; None: no line)."""
    parts = []
    for label, colour, shape, dash in entries:
        dashes = f' stroke-dasharray="{dash}"' if dash else ""
        symbol = "" if dash is None else f'<path d="M1 8H33" stroke="{colour}" stroke-width="1.8"{dashes}/>'
        if shape:
            symbol += mark(shape, 17, 8, colour)
        parts.append(f'<span><svg width="34" height="16" aria-hidden="true">{symbol}</svg>{escape(label)}</span>')
    return '<p class="legend">' + "".join(parts) + "</p>"
