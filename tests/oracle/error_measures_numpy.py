# SPDX-License-Identifier: Apache-2.0
"""Second implementation of the error measures, from their publications, in plain double numpy.

    error_measures_numpy.py WIDTH HEIGHT CHANNELS PIXELS_PER_DEGREE IMAGE.raw REFERENCE.raw

Files hold float32 in [y][x][channel] order. Prints one JSON object. Filters are full 2-D sums over
the printed kernels, images go through sRGB and back, matrices are inverted numerically: nothing
here is separable, folded or cancelled by hand.
"""

import json
import sys

import numpy as np

RGB_TO_XYZ = np.array([
    [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
    [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
    [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
])
WHITE = RGB_TO_XYZ @ np.ones(3)
LUMA = np.array([0.2126, 0.7152, 0.0722])


def correlate(plane, kernel, mode):
    ry, rx = kernel.shape[0] // 2, kernel.shape[1] // 2
    if mode == "edge":
        plane = np.pad(plane, ((ry, ry), (rx, rx)), mode="edge")
    h, w = plane.shape[0] - 2 * ry, plane.shape[1] - 2 * rx
    out = np.zeros((max(h, 0), max(w, 0)))
    for j in range(kernel.shape[0]):
        for i in range(kernel.shape[1]):
            out += kernel[j, i] * plane[j:j + h, i:i + w]
    return out


def to_srgb(x):
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-300) ** (1 / 2.4) - 0.055)


def from_srgb(x):
    return np.where(x > 0.04045, ((x + 0.055) / 1.055) ** 2.4, x / 12.92)


def to_ycxcz(rgb):
    t = rgb @ RGB_TO_XYZ.T / WHITE
    x, y, z = t[..., 0], t[..., 1], t[..., 2]
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], -1)


def from_ycxcz(c):
    y = (c[..., 0] + 16) / 116
    x, z = y + c[..., 1] / 500, y - c[..., 2] / 200
    return (np.stack([x, y, z], -1) * WHITE) @ np.linalg.inv(RGB_TO_XYZ).T


def to_hunt_lab(rgb):
    t = rgb @ RGB_TO_XYZ.T / WHITE
    d = 6 / 29
    f = np.where(t > d ** 3, np.cbrt(t), t / (3 * d * d) + 4 / 29)
    lightness = 116 * f[..., 1] - 16
    return np.stack([lightness,
                     0.01 * lightness * 500 * (f[..., 0] - f[..., 1]),
                     0.01 * lightness * 200 * (f[..., 1] - f[..., 2])], -1)


def hyab(p, q):
    d = p - q
    return np.abs(d[..., 0]) + np.hypot(d[..., 1], d[..., 2])


def csf_kernel(terms, ppd):
    r = int(np.ceil(3 * np.sqrt(0.04 / (2 * np.pi ** 2)) * ppd))
    x, y = np.meshgrid(np.arange(-r, r + 1) / ppd, np.arange(-r, r + 1) / ppd)
    k = sum(a * np.sqrt(np.pi / b) * np.exp(-np.pi ** 2 * (x * x + y * y) / b) for a, b in terms)
    return k / k.sum()


def feature_kernels(ppd):
    sd = 0.5 * 0.082 * ppd
    r = int(np.ceil(3 * sd))
    x, y = np.meshgrid(np.arange(-r, r + 1.0), np.arange(-r, r + 1.0))
    g = np.exp(-(x * x + y * y) / (2 * sd * sd))
    kernels = []
    for k in (-x * g, (x * x / (sd * sd) - 1) * g):
        positive, negative = k[k > 0].sum(), -k[k < 0].sum()
        kernels.append(np.where(k > 0, k / positive, k / negative))
    return kernels


def flip_map(image_srgb, reference_srgb, ppd):
    lab, edges, points = [], [], []
    kernels = [csf_kernel([(1, 0.0047)], ppd), csf_kernel([(1, 0.0053)], ppd),
               csf_kernel([(34.1, 0.04), (13.5, 0.025)], ppd)]
    edge, point = feature_kernels(ppd)
    for srgb in (image_srgb, reference_srgb):
        c = to_ycxcz(from_srgb(srgb))
        filtered = np.stack([correlate(c[..., i], kernels[i], "edge") for i in range(3)], -1)
        lab.append(to_hunt_lab(np.clip(from_ycxcz(filtered), 0, 1)))
        y = (c[..., 0] + 16) / 116
        edges.append(np.hypot(correlate(y, edge, "edge"), correlate(y, edge.T, "edge")))
        points.append(np.hypot(correlate(y, point, "edge"), correlate(y, point.T, "edge")))
    green, blue = to_hunt_lab(np.array([0.0, 1, 0])), to_hunt_lab(np.array([0.0, 0, 1]))
    cmax = hyab(green, blue) ** 0.7
    e = hyab(lab[0], lab[1]) ** 0.7
    e = np.where(e < 0.4 * cmax, 0.95 / (0.4 * cmax) * e,
                 0.95 + (e - 0.4 * cmax) / (cmax - 0.4 * cmax) * 0.05)
    f = np.maximum(np.abs(edges[0] - edges[1]), np.abs(points[0] - points[1]))
    return e ** (1 - (f / np.sqrt(2)) ** 0.5)


HABLE = dict(a=0.15, b=0.50, c=0.10, d=0.20, e=0.02, f=0.30)


def hable_raw(x, a, b, c, d, e, f):
    return (x * (a * x + c * b) + d * e) / (x * (a * x + b) + d * f) - e / f


def tone_map(x, mapper):
    if mapper == "reinhard":
        return np.clip(x / (1 + (x @ LUMA)[..., None]), 0, 1)
    if mapper == "hable":
        return np.clip(hable_raw(2 * x, **HABLE) / hable_raw(11.2, **HABLE), 0, 1)
    x = 0.6 * x
    return np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0, 1)


def inverse_tone(t, mapper):
    """The grey value mapped to t, by bisection."""
    low, high = 0.0, 1e4
    for _ in range(200):
        mid = 0.5 * (low + high)
        if tone_map(np.full((1, 3), mid), mapper)[0, 0] < t:
            low = mid
        else:
            high = mid
    return 0.5 * (low + high)


def hdr_flip_map(image, reference, good, ppd, mapper):
    image, reference = np.maximum(image, 0), np.maximum(reference, 0)
    luminance = (reference @ LUMA)[good]
    x = inverse_tone(0.85, mapper)
    if luminance.max() == 0:
        exposures = [0.0]
    else:
        median = np.percentile(luminance, 50)
        if median == 0:
            median = np.percentile(luminance[luminance > 0], 50)
        start, stop = np.log2(x / luminance.max()), np.log2(x / median)
        exposures = np.linspace(start, stop, max(2, int(np.ceil(stop - start))))
    maps = [flip_map(to_srgb(tone_map(image * 2.0 ** e, mapper)),
                     to_srgb(tone_map(reference * 2.0 ** e, mapper)), ppd) for e in exposures]
    return np.max(maps, axis=0)


def ssim_mean(image_srgb, reference_srgb, good):
    a, b = image_srgb, reference_srgb
    k = np.exp(-np.arange(-5, 6) ** 2 / (2 * 1.5 ** 2))
    k = np.outer(k, k)
    k /= k.sum()
    if min(a.shape) < 11:
        return None
    windows_a = np.lib.stride_tricks.sliding_window_view(a, (11, 11))
    windows_b = np.lib.stride_tricks.sliding_window_view(b, (11, 11))
    ma = (windows_a * k).sum((2, 3))
    mb = (windows_b * k).sum((2, 3))
    da, db = windows_a - ma[..., None, None], windows_b - mb[..., None, None]
    va, vb, cov = (da * da * k).sum((2, 3)), (db * db * k).sum((2, 3)), (da * db * k).sum((2, 3))
    s = ((2 * ma * mb + 1e-4) * (2 * cov + 9e-4)
         / ((ma ** 2 + mb ** 2 + 1e-4) * (va + vb + 9e-4)))
    return float(s[good[5:-5, 5:-5]].mean())


def measures(image, reference, ppd):
    good = np.isfinite(image).all(-1) & np.isfinite(reference).all(-1)
    image = np.where(good[..., None], image, 0.0)
    reference = np.where(good[..., None], reference, 0.0)
    d, r = image[good], reference[good]
    squared = (d - r) ** 2
    relative = squared / (r ** 2 + 0.01)
    per_pixel = np.sort(relative.mean(-1))
    kept = len(per_pixel) - int(0.001 * len(per_pixel))
    clamped = (np.clip(d, 0, 1) - np.clip(r, 0, 1)) ** 2
    three = image.shape[-1] == 3
    weights = LUMA if three else np.ones(1)
    out = {
        "pixels": int(good.sum()),
        "non_finite_pixels": int((~good).sum()),
        "rmse": np.sqrt(squared.mean()),
        "relmse": relative.mean(),
        "relmse_trimmed": per_pixel[:kept].mean(),
        "psnr": -10 * np.log10(squared.mean()),
        "psnr_clamped": -10 * np.log10(clamped.mean()),
        "smape": (np.abs(d - r) / (np.abs(d) + np.abs(r) + 0.01)).mean(),
        "max_abs_error": np.abs(d - r).max(),
        "brightness_ratio": (d @ weights).mean() / (r @ weights).mean(),
    }
    if not three:
        image, reference = np.repeat(image, 3, -1), np.repeat(reference, 3, -1)
    a, b = np.clip(image, 0, 1), np.clip(reference, 0, 1)
    s = ssim_mean(to_srgb(a @ LUMA), to_srgb(b @ LUMA), good)
    if s is not None:
        out["ssim"] = s
    out["flip"] = flip_map(to_srgb(a), to_srgb(b), ppd)[good].mean()
    for mapper in ("aces", "hable", "reinhard"):
        out["hdr_flip_" + mapper] = hdr_flip_map(image, reference, good, ppd, mapper)[good].mean()
    return {key: float(value) for key, value in out.items()}


def main():
    width, height, channels = (int(v) for v in sys.argv[1:4])
    images = [np.fromfile(path, np.float32).reshape(height, width, channels).astype(np.float64)
              for path in sys.argv[5:7]]
    with np.errstate(all="ignore"):
        print(json.dumps(measures(images[0], images[1], float(sys.argv[4]))))


if __name__ == "__main__":
    main()
