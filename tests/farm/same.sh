#!/bin/bash
# same.sh FOLDER: its pictures and previews have the bytes of those in $work/local/out, and nothing is missing or left over.
set -euo pipefail
for frame in 0001 0002 0003 0004; do
    for ending in exr png; do
        cmp "$work/local/out/plume.$frame.$ending" "$1/plume.$frame.$ending"
    done
    [ -s "$1/plume.$frame.json" ]
done
left=$(find "$1" -name '*.checkpoint' -o -name '.*.tmp.*')
[ -z "$left" ] || { echo "left over: $left" >&2; exit 1; }
echo "4 pictures and 4 previews in $1 have equal bytes"
