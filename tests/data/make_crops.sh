#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes tests/data/cycles from the full Cycles data set:
#   tests/data/make_crops.sh DATASET_FOLDER
# where DATASET_FOLDER holds cornell/, caustics/, interior/, dof/ as described in cycles/README.md.
set -eu
if [ $# -ne 1 ] || [ ! -f "$1/cornell/ref.exr" ]; then
    echo "usage: $0 DATASET_FOLDER (with cornell/, caustics/, interior/, dof/ in it)" >&2
    exit 2
fi
from=$1
to=$(dirname "$0")/cycles
beauty=ViewLayer.Combined.R,ViewLayer.Combined.G,ViewLayer.Combined.B,ViewLayer.Combined.A

# cut SCENE WINDOW: the same rectangle of every file, moved to the origin.
cut() {
    scene=$1
    window=$2
    mkdir -p "$to/$scene/stack"
    for n in 01 02 03 04 05 06 07 08 09 10 11 12 13 14 15 16; do
        oiiotool --nosoftwareattrib "$from/$scene/stack/s$n.exr" --ch $beauty --cut "$window" \
            -d half --compression zip -o "$to/$scene/stack/s$n.exr"
    done
    oiiotool --nosoftwareattrib "$from/$scene/ref.exr" --ch $beauty --cut "$window" \
        -d half --compression zip -o "$to/$scene/ref.exr"
    # Colour passes are half in the source, data passes float; say so, or one float makes all float.
    oiiotool --nosoftwareattrib "$from/$scene/noisy_16.exr" --cut "$window" -d half \
        -d "ViewLayer.Denoising Normal.X=float" -d "ViewLayer.Denoising Normal.Y=float" \
        -d "ViewLayer.Denoising Normal.Z=float" -d "ViewLayer.Denoising Depth.Z=float" \
        --compression zip -o "$to/$scene/noisy_16.exr"
    oiiotool --nosoftwareattrib -a "$from/$scene/flash_16.exr" --cut "$window" \
        --compression zip -o "$to/$scene/flash_16.exr"
}

# cut_passes SCENE WINDOW: the diffuse passes of each render of the stack.
cut_passes() {
    mkdir -p "$to/$1/stack_passes"
    for n in 01 02 03 04 05 06 07 08; do
        oiiotool --nosoftwareattrib "$from/$1/stack_passes/s$n.exr" --cut "$2" -d half \
            --compression zip -o "$to/$1/stack_passes/s$n.exr"
    done
}

cut cornell 288x288+0+0
cut caustics 96x96+150+90
cut interior 96x96+85+85
cut dof 96x96+100+60
cut_passes interior 96x96+85+85
