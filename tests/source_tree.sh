#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# What every source file owes: the licence line first, and nothing left unfinished.
# Usage: source_tree.sh SOURCE_FOLDER
set -euo pipefail
cd "$1"
mapfile -t files < <(find lib nodes tests cmake dev .ci CMakeLists.txt -type f \
    \( -name '*.h' -o -name '*.cpp' -o -name '*.cmake' -o -name '*.py' -o -name '*.sh' \
    -o -name CMakeLists.txt -o -path dev -o -path .ci/run \))
failed=0
for file in "${files[@]}"; do
    # A script's first line says which interpreter runs it.
    first=$(sed -n '1{/^#!/d};p;q' "$file")
    if [[ $first != *'SPDX-License-Identifier: Apache-2.0'* ]]; then
        echo "$file: does not begin with the SPDX line (Apache-2.0)"
        failed=1
    fi
done
# The words are spelled in two halves, so that this line does not find itself.
if grep -nE '\b(TO''DO|FIX''ME|XX''X)\b' "${files[@]}"; then failed=1; fi
[ $failed -eq 0 ] && echo "${#files[@]} files are in order"
exit $failed
