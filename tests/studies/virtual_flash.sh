#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The figures of docs/methods/virtual-flash.md. Usage: virtual_flash.sh SCENES [BUILD_FOLDER] [WHAT]…
# SCENES holds cornell, caustics, interior and dof, each with stack/sNN.exr (1 sample a pixel; 128 of them
# for all rows of coverage), flash_16.exr and ref.exr. WHAT: readings, gates, albedo, coverage, sequence (all of them).
set -euo pipefail
scenes=$(realpath "$1")
build=$(realpath "${2:-build}")
shift $(($# < 2 ? $# : 2))
what=${*:-readings gates albedo coverage sequence}
here=$(realpath "$(dirname "$0")")
rayloom=$build/bin/rayloom

inputs() { # SCENE SAMPLES
    printf '%s\n' -i "stack=$scenes/$1/stack/s%02d.exr@1-$2:Combined" \
        -i "partial=$scenes/$1/flash_16.exr:partial_d1" \
        -i "flash_unit=$scenes/$1/flash_16.exr:flash_unit" -i "reference=$scenes/$1/ref.exr:Combined"
}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Runs a graph of figures, then prints `output value` of one figure of each output.
measure() { # OUTPUTS GRAPH ARGUMENT…
    local outputs=$1 with=()
    shift
    for o in $outputs; do with+=(-o "$o=$work/$o.json"); done
    "$rayloom" run "$@" "${with[@]}" -q >/dev/null
}
figure() { # OUTPUT FIGURE
    sed -nE "s/.*\"$2\": ?([-+0-9.e]+).*/\1/p" "$work/$1.json" | head -n 1
}

for part in $what; do
    case $part in
    readings | gates)
        gates=two-sample
        [ "$part" = gates ] && gates='two-sample one-sample none paper'
        samples='4 8 16 32'
        [ "$part" = gates ] && samples=16
        for scene in cornell caustics interior dof; do
            for n in $samples; do
                for gate in $gates; do
                    mapfile -t with < <(inputs "$scene" "$n")
                    outputs='noisy nlm first single a b c d'
                    settings=(-p "gate=$gate")
                    [ "$gate" = paper ] &&
                        settings=(-p gate=one-sample -p outliers=0 -p floor=0 -p "narrow_samples=$n")
                    measure "$outputs" "$here/virtual_flash_readings.yaml" "${with[@]}" "${settings[@]}"
                    for f in relmse brightness_ratio; do
                        printf '%s %s %s %s %s' "$part" "$scene" "$n" "$gate" "$f"
                        for o in $outputs; do printf ' %s %.4g' "$o" "$(figure "$o" $f)"; done
                        echo
                    done
                done
            done
        done
        ;;
    albedo)
        for scene in cornell caustics interior dof; do
            for n in 4 8 16 32; do
                for albedo in without with; do
                    mapfile -t with < <(inputs "$scene" "$n" | head -n -2)
                    [ $albedo = without ] ||
                        with+=(-i "albedo=$scenes/$scene/noisy_16.exr:Denoising Albedo")
                    "$rayloom" run virtual-flash "${with[@]}" -q -o "image=$work/image.exr" 2>/dev/null
                    printf 'albedo %s %s %s' "$scene" "$n" $albedo
                    "$rayloom" compare "$work/image.exr" "$scenes/$scene/ref.exr" |
                        awk '/^(relmse|relmse_trimmed|brightness_ratio) / { printf " %s %.4g", $1, $2 } END { print "" }'
                done
            done
        done
        ;;
    coverage)
        for confidence in 0.95 0.98 0.99; do
            for n in 4 16 32 64 128; do
                for scene in cornell caustics interior dof; do
                    if [ ! -e "$(printf '%s/%s/stack/s%02d.exr' "$scenes" "$scene" "$n")" ]; then
                        printf 'coverage %s %s %s no stack of so many\n' "$confidence" "$n" "$scene"
                        continue
                    fi
                    mapfile -t with < <(inputs "$scene" "$n")
                    measure coverage "$here/virtual_flash_coverage.yaml" "${with[@]}" -p "confidence=$confidence"
                    printf 'coverage %s %s %s interval %.3f bound %.3f\n' "$confidence" "$n" "$scene" \
                        "$(figure coverage interval)" "$(figure coverage bound)"
                done
            done
        done
        ;;
    sequence)
        anim=$scenes/dof/anim
        for f in 1 2 3 4 5 6 7; do # a file without a place for the frame has no neighbours
            "$rayloom" run virtual-flash-sequence -i "frame=$anim/f0$f""_16.exr:Combined" \
                -i "guide=$anim/f0$f""_16.exr:Denoising Albedo" -o "image=$work/reach0.$f.exr" -q
        done
        for reach in 1 3; do
            "$rayloom" run virtual-flash-sequence --frames 1-7 -q -o "image=$work/reach$reach.%d.exr" \
                -i "frame=$anim/f%02d_16.exr:Combined" -i "guide=$anim/f%02d_16.exr:Denoising Albedo" \
                -i "before=$anim/f%02d_16.exr@-$reach..-1:Combined" -i "after=$anim/f%02d_16.exr@+1..+$reach:Combined" \
                -i "guide_before=$anim/f%02d_16.exr@-$reach..-1:Denoising Albedo" \
                -i "guide_after=$anim/f%02d_16.exr@+1..+$reach:Denoising Albedo"
        done
        for reach in 0 1 3; do
            echo "sequence reach $reach, frame 4 against its reference"
            "$rayloom" compare "$work/reach$reach.4.exr" "$scenes/dof/ref.exr:Combined" --no-flip
            echo "sequence reach $reach, flicker: differences of neighbouring frames"
            for f in 1 2 3 4 5 6; do
                "$rayloom" compare "$work/reach$reach.$f.exr" "$work/reach$reach.$((f + 1)).exr" --no-flip --json
            done
        done
        ;;
    *)
        echo "what is '$part'? readings, gates, coverage or sequence" >&2
        exit 2
        ;;
    esac
done
