#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes the pictures of README.md and docs/methods/ray-histogram-fusion.md again: mean of the samples |
# denoised | reference, linear to sRGB, everything above 1 white.
# Usage: docs/images/make.sh [FOLDER OF rayloom]; needs oiiotool (OpenImageIO).
# README's is made from tests/data; the others need the whole renders, $RAYLOOM_DATA/cycles.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
rayloom=${1:-build/bin}/rayloom
[ -x "$rayloom" ] || {
    echo "make.sh: there is no $rayloom; run ./dev build first" >&2
    exit 1
}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

beauty=(--ch ViewLayer.Combined.R,ViewLayer.Combined.G,ViewLayer.Combined.B --chnames R,G,B)

# strip SCENE_FOLDER CROP OUT [COMPRESSION]
strip() {
    local scene=$1 samples=16 crop=$2 out=$3 k mean=()
    for k in $(seq -f %02g 1 "$samples"); do
        mean+=("$scene/stack/s$k.exr" "${beauty[@]}")
        [ "$k" = 01 ] || mean+=(--add)
    done
    oiiotool "${mean[@]}" --divc "$samples" -d float -o "$work/before.exr"
    "$rayloom" run graphs/ray-histogram-fusion-stack.yaml \
        -i stack="$scene/stack/s%02d.exr@1-$samples:Combined" -o image="$work/after.exr" 2>"$work/log" || {
        cat "$work/log" >&2
        exit 1
    }
    oiiotool "$scene/ref.exr" "${beauty[@]}" -o "$work/reference.exr"
    local panel panels=()
    for panel in before after reference; do
        oiiotool "$work/$panel.exr" --ch R,G,B --cut "$crop" --clamp:min=0:max=1 \
            --colorconvert linear sRGB -d uint8 -o "$work/$panel.tif"
        panels+=("$work/$panel.tif")
    done
    oiiotool "${panels[@]}" --mosaic:pad=4 3x1 --nosoftwareattrib -d uint8 \
        --compression "${4:-zip:9}" -o "$out"
    echo "$out: $(stat -c %s "$out") bytes"
}

# Without the frame of the picture and the floor: a PNG of all of it would be too large.
strip tests/data/cycles/cornell 276x192+6+6 docs/images/cornell.png
if [ -z "${RAYLOOM_DATA:-}" ]; then
    echo "make.sh: RAYLOOM_DATA is not set: the strips of docs/methods stay as they are"
    exit
fi
for scene in cornell caustics interior dof; do
    crop=320x240+0+0
    [ $scene != cornell ] || crop=288x288+0+0
    strip "$RAYLOOM_DATA/cycles/$scene" $crop docs/images/ray-histogram-fusion-$scene.jpg jpeg:90
done
