#!/bin/bash
# Jobs that `curlsmoke farm` prints, run by the farms that they are for: their pictures must have the bytes of those that this
# machine makes by itself. A farm that is not there is named and left out; without any the test fails.
#
# Open Job Description: openjd-cli, from PyPI into an environment of its own under target/. Slurm: as root, with
#
#     apt-get install -y slurm-wlm munge
#
# its daemons run on this machine alone, in a folder of their own and without systemd. CURLSMOKE names the program to be tested,
# FARMS the farms: "openjd slurm".
set -euo pipefail
cd "$(dirname "$0")/../.."
farm=$PWD/tests/farm
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
export CURLSMOKE=${CURLSMOKE:-$target/release/curlsmoke}
[ -x "$CURLSMOKE" ] || { echo "$CURLSMOKE is missing: cargo build --release --bin curlsmoke" >&2; exit 1; }
work=$(mktemp -d "${TMPDIR:-/tmp}/curlsmoke-farm.XXXXXX")
trap 'rm -rf "$work"' EXIT
export work
cp "$farm/plume.yaml" "$work/"
mkdir "$work/local"

echo "== this machine"
(cd "$work/local" && "$CURLSMOKE" render ../plume.yaml --progress none)

ran=() skipped=()
for name in ${FARMS:-openjd slurm}; do
    echo "== $name"
    status=0
    TARGET=$target "$farm/$name.sh" || status=$?
    case $status in
    0) ran+=("$name") ;;
    # EX_UNAVAILABLE of sysexits.h.
    69) skipped+=("$name") ;;
    *) echo "$name failed" >&2; exit 1 ;;
    esac
done
echo "ran: ${ran[*]:-none}; skipped: ${skipped[*]:-none}"
[ ${#ran[@]} -gt 0 ]
