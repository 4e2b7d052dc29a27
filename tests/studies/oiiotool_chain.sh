#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Ten operations on a 4k image: one graph of oiio.* nodes against one oiiotool command, in turn.
# Prints wall seconds and peak memory of each run. Usage: oiiotool_chain.sh [BUILD_FOLDER] [RUNS]
set -euo pipefail
build=$(realpath "${1:-build}")
runs=${2:-5}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

oiiotool --create 4096x2160 4 --noise:type=gaussian:mean=0.5:stddev=0.2:seed=1 --chnames R,G,B,A \
    -d half --compression zip -o a.exr
oiiotool --create 4096x2160 4 --noise:type=gaussian:mean=0.4:stddev=0.1:seed=2 --chnames R,G,B,A \
    -d half --compression zip -o b.exr

cat >chain.yaml <<'YAML'
rayloom: 1
name: chain
inputs: {a: {channels: RGB}, b: {channels: RGB}}
nodes:
  n1: {op: oiio.mul, image: a, value: 1.1}
  n2: {op: oiio.add, image: n1, value: 0.01}
  n3: {op: oiio.abs, image: n2}
  n4: {op: oiio.clamp, image: n3, min: 0, max: 4}
  n5: {op: oiio.blur, image: n4, width: 5, height: 5}
  n6: {op: oiio.over, image: n5, under: b}
  n7: {op: oiio.mad, image: n6, scale: 0.9, offset: 0.02}
  n8: {op: oiio.sub, image: n7, other: b}
  n9: {op: oiio.absdiff, image: n8, value: 0.1}
  n10: {op: oiio.mul, image: n9, value: 2}
outputs: {image: n10}
YAML

graph=("$build/bin/rayloom" run chain.yaml -i a=a.exr -i b=b.exr -o image=graph.exr -q)
tool=(oiiotool a.exr --mulc 1.1 --addc 0.01 --abs --clamp:min=0:max=4 --blur 5x5 b.exr --over
    --mulc 0.9 --addc 0.02 b.exr --sub --absdiffc 0.1 --mulc 2 -d half -o tool.exr)

measure() { /usr/bin/time -f '%e %M' "$@" 2>&1 >/dev/null | tail -n 1; }
measure "${graph[@]}" >/dev/null
measure "${tool[@]}" >/dev/null
oiiotool graph.exr tool.exr --diff | tail -n 1
printf '%8s %12s %12s %12s %12s\n' run graph/s tool/s graph/MB tool/MB
for run in $(seq "$runs"); do
    read -r gs gm <<<"$(measure "${graph[@]}")"
    read -r ts tm <<<"$(measure "${tool[@]}")"
    printf '%8d %12s %12s %12d %12d\n' "$run" "$gs" "$ts" $((gm / 1024)) $((tm / 1024))
done
