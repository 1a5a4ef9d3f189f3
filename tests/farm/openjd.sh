#!/bin/bash
# A template of Open Job Description, run by openjd-cli in chunks of three frames, and with a bake before. Started by run.sh.
set -euo pipefail
farm=$(dirname "$0")
venv=$TARGET/farm-venv
if ! [ -x "$venv/bin/openjd" ] && ! { python3 -m venv "$venv" && "$venv/bin/pip" install --quiet openjd-cli==0.8.0; }; then
    echo "skipped: openjd-cli cannot be installed from PyPI" >&2
    exit 69
fi
openjd=$venv/bin/openjd
mkdir -p "$work/openjd" && cd "$work/openjd"
"$CURLSMOKE" farm openjd ../plume.yaml --chunk 3 > plume.template.yaml
"$openjd" check plume.template.yaml
"$openjd" summary plume.template.yaml
"$openjd" run plume.template.yaml -p Curlsmoke="$CURLSMOKE" > log || { cat log; exit 1; }
# Chunks of at most three; progress is in lines of their own.
grep -F 'Frames(CHUNK[INT]) = ' log
grep -F 'Chunks run: 2' log
grep -q 'openjd_progress: 100' log
"$farm/same.sh" "$work/openjd/out"

mkdir baked && cd baked
"$CURLSMOKE" farm openjd ../../plume.yaml --chunk 2 --bake > plume.template.yaml
"$openjd" check plume.template.yaml
"$openjd" run plume.template.yaml --step render --run-dependencies -p Curlsmoke="$CURLSMOKE" > log || { cat log; exit 1; }
for frame in 0001 0002 0003 0004; do
    [ -s "out/plume.$frame.vdb" ]
    # What it was made from differs, and so do the files; the pixels do not.
    "$CURLSMOKE" compare "out/plume.$frame.exr" "$work/local/out/plume.$frame.exr"
done
