#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Repeats a small render and its histogram, mirrored, to WIDTH x HEIGHT tiled half-float EXR files.

Usage: make_large_histogram.py IMAGE.exr HISTOGRAM.exr WIDTH HEIGHT OUT_FOLDER
Needs python3-openimageio. Writes OUT_FOLDER/large.exr and OUT_FOLDER/large_hist.exr.
"""
import sys

import numpy as np
import OpenImageIO as oiio

TILE = 64


def repeat(source, target, width, height):
    pixels = oiio.ImageBuf(source).get_pixels(oiio.FLOAT)
    # Mirrored copies, so that there are no seams.
    row = np.concatenate([pixels, pixels[:, ::-1]], axis=1)
    block = np.concatenate([row, row[::-1]], axis=0)
    channels = block.shape[2]
    spec = oiio.ImageSpec(width, height, channels, oiio.HALF)
    spec.channelnames = oiio.ImageBuf(source).spec().channelnames
    spec.tile_width = spec.tile_height = TILE
    spec.attribute("compression", "zip")
    out = oiio.ImageOutput.create(target)
    if not out.open(target, spec):
        raise SystemExit(out.geterror())
    columns = np.arange(width) % block.shape[1]
    for y in range(0, height, TILE):
        y_end = min(height, y + TILE)
        rows = np.arange(y, y_end) % block.shape[0]
        band = np.ascontiguousarray(block[rows][:, columns])
        if not out.write_tiles(0, width, y, y_end, 0, 1, band):
            raise SystemExit(out.geterror())
    out.close()


def main():
    image, histogram, width, height, folder = sys.argv[1:6]
    repeat(image, f"{folder}/large.exr", int(width), int(height))
    repeat(histogram, f"{folder}/large_hist.exr", int(width), int(height))


main()
