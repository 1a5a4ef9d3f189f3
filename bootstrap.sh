#!/usr/bin/env bash
# Makes sure that an Embree 4 library can be found by the built program, and says nothing when there is one already.
#
# Looked for, in the order in which the program looks: $EMBREE_DIR, .embree/ of this checkout, the loader's own
# search, the usual prefixes. Where there is none, the library is taken out of a Python wheel (pinned version and
# checksum; nothing is installed) into .embree/, which git ignores.
#
# With --denoiser it does the same for Open Image Denoise 2, into .oidn/, which `curlsmoke denoise` alone needs, and
# nothing else.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

fetch_denoiser() {
    local package=pyoidn version=2.5.1.0 folder=.oidn platform checksum library=libOpenImageDenoise.so
    local by_hand="install Open Image Denoise 2 yourself (from openimagedenoise.org; macOS: brew install open-image-denoise) or set OIDN_DIR to a folder that holds it"
    refuse() {
        echo "bootstrap: $*; $by_hand" >&2
        exit 1
    }
    case "$(uname -s)-$(uname -m)" in
    Linux-x86_64)
        platform=manylinux2014_x86_64
        checksum=32ad13368f8de1ef63001942ad05b02a00cd732d1206d97f352d3a3f606d823e
        ;;
    Darwin-arm64)
        platform=macosx_12_0_arm64 library=libOpenImageDenoise.dylib
        checksum=ed803c20333d37873678d69abf1e3546e89dbaf4639408b7c92173e11b6355cb
        ;;
    Darwin-x86_64)
        platform=macosx_10_15_x86_64 library=libOpenImageDenoise.dylib
        checksum=c9d366e448c7a99ef54b936806ef2e6ae1e1383b0a3ba08f5509a39553fa03c2
        ;;
    *) refuse "no ready-made Open Image Denoise is known for $(uname -s) on $(uname -m)" ;;
    esac
    if [ -e "$folder/$package-$version.ok" ] && [ -e "$folder/lib/$library" ]; then return; fi
    python3 -m pip --version >/dev/null 2>&1 || refuse "python3 with pip is needed to fetch Open Image Denoise"
    echo "bootstrap: fetching $package $version into $folder/" >&2
    download="$(mktemp -d "${TMPDIR:-/tmp}/curlsmoke-oidn.XXXXXX")"
    partial=".oidn.$$.tmp"
    trap 'rm -rf "$download" "$partial"' EXIT
    python3 -m pip --disable-pip-version-check --no-input download --quiet --no-deps --only-binary=:all: \
        --python-version 3.11 --implementation cp --platform "$platform" --dest "$download" "$package==$version" >&2 ||
        refuse "pip could not fetch $package $version (its message is above)"
    mkdir -p "$partial/lib"
    # Checked before anything is unpacked. Of the wheel only what the processor's own device needs is kept, in a folder
    # called lib, which is where its parts look for each other.
    python3 - "$download" "$checksum" "$partial/lib" "$library" <<'PYTHON' || refuse "the downloaded $package $version was not unpacked; nothing was changed"
import hashlib, os, re, sys, zipfile
from pathlib import Path

folder, checksum, target, library = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]), sys.argv[4]
wheel = next(folder.glob("*.whl"))
found = hashlib.sha256(wheel.read_bytes()).hexdigest()
if found != checksum:
    sys.exit(f"bootstrap: wrong checksum of {wheel.name}: sha256 is {found}, expected {checksum}")
with zipfile.ZipFile(wheel) as archive:
    for name in archive.namelist():
        base = os.path.basename(name)
        is_library = re.match(r"lib(OpenImageDenoise(_core|_device_cpu)?|tbb)[.0-9]*\.(so|dylib)", base)
        if is_library or re.search(r"licen[cs]e", base, re.IGNORECASE):
            (target / base).write_bytes(archive.read(name))
            (target / base).chmod(0o755)
if not (target / library).exists():
    sys.exit(f"bootstrap: {wheel.name} holds no {library}")
PYTHON
    touch "$partial/$package-$version.ok"
    rm -rf "$folder"
    mv "$partial" "$folder"
}

case "${1:-}" in
"") ;;
--denoiser)
    fetch_denoiser
    exit 0
    ;;
*)
    echo "bootstrap: unknown argument $1; known is --denoiser" >&2
    exit 2
    ;;
esac

# The wheel carries Embree 4.4.0 and the threading library it needs.
package=embreex
version=4.4.0.post1
folder=.embree
stamp="$folder/$package-$version.ok"

fail() {
    echo "bootstrap: $*" >&2
    exit 1
}

by_hand="install Embree 4 yourself (Debian 13 or Ubuntu 24.04: apt install libembree4-4; macOS: brew install embree) or set EMBREE_DIR to a folder that holds it"

case "$(uname -s)" in
Darwin) library=libembree4.dylib pattern='libembree4*.dylib' ;;
*) library=libembree4.so pattern='libembree4.so*' ;;
esac

holds_embree() {
    [ -n "$(find -L "$1" -maxdepth 1 -name "$pattern" -type f -print -quit 2>/dev/null)" ]
}

if [ -n "${EMBREE_DIR:-}" ]; then
    for candidate in "$EMBREE_DIR" "$EMBREE_DIR/lib" "$EMBREE_DIR/lib64"; do
        if holds_embree "$candidate"; then exit 0; fi
    done
    fail "EMBREE_DIR is $EMBREE_DIR, but neither it nor its lib folder holds $library; correct it or unset it"
fi

if [ -e "$stamp" ] && holds_embree "$folder"; then exit 0; fi

# The loader's own search: what it has in its cache, and the folders named for it.
if command -v ldconfig >/dev/null 2>&1 || [ -x /sbin/ldconfig ]; then
    if PATH="$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null | grep 'libembree4\.so' >/dev/null; then exit 0; fi
fi
IFS=: read -r -a loader_folders <<<"${LD_LIBRARY_PATH:-}:${DYLD_LIBRARY_PATH:-}"
for candidate in ${loader_folders[@]+"${loader_folders[@]}"} \
    /usr/local/lib /usr/lib /usr/lib64 "/usr/lib/$(uname -m)-linux-gnu" \
    /opt/homebrew/lib /opt/embree/lib /opt/local/lib; do
    if [ -n "$candidate" ] && holds_embree "$candidate"; then exit 0; fi
done

case "$(uname -s)-$(uname -m)" in
Linux-x86_64)
    platform=manylinux_2_28_x86_64
    checksum=2cd0f7d5c6342e6247e31f700761689cae7829454d8c6de0c41e62124a023e1f
    ;;
Darwin-arm64)
    platform=macosx_14_0_arm64
    checksum=3ed370224566681071f245bbc5104feebee1354097679ab69cb3a70c94633cb3
    ;;
Darwin-x86_64)
    platform=macosx_13_0_x86_64
    checksum=85d9b232805e95be845ee5d77ddea4e6b21c992b7e60fa7bdf4f578b84797a15
    ;;
*) fail "no ready-made Embree 4 is known for $(uname -s) on $(uname -m); $by_hand" ;;
esac

command -v python3 >/dev/null 2>&1 || fail "no Embree 4 found, and no python3 to fetch it with; install python3 and its pip, or $by_hand"
python3 -m pip --version >/dev/null 2>&1 || fail "no Embree 4 found, and python3 has no pip to fetch it with; install pip (Debian and Ubuntu: apt install python3-pip), or $by_hand"

echo "bootstrap: no Embree 4 found; fetching $package $version into $folder/" >&2
download="$(mktemp -d "${TMPDIR:-/tmp}/curlsmoke-embree.XXXXXX")"
trap 'rm -rf "$download"' EXIT
python3 -m pip --disable-pip-version-check --no-input download --quiet --no-deps --only-binary=:all: \
    --python-version 3.11 --implementation cp --platform "$platform" --dest "$download" "$package==$version" >&2 ||
    fail "pip could not fetch $package $version (its message is above); check the network, or $by_hand"

# Checked before anything is unpacked. The library is unpacked beside its final place and moved in one step, so that
# an interrupted run leaves nothing that looks finished.
python3 - "$download" "$checksum" "$library" <<'PYTHON' || fail "the downloaded $package $version was not unpacked; nothing was changed"
import hashlib, os, re, sys, zipfile
from pathlib import Path

folder, checksum, library = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
wheel = next(folder.glob("*.whl"))
found = hashlib.sha256(wheel.read_bytes()).hexdigest()
if found != checksum:
    sys.exit(f"bootstrap: wrong checksum of {wheel.name}: sha256 is {found}, expected {checksum}")
target = folder / "unpacked"
target.mkdir()
with zipfile.ZipFile(wheel) as archive:
    for name in archive.namelist():
        base = os.path.basename(name)
        if re.match(r"lib(embree4|tbb)[^/]*\.(so|dylib)", base):
            (target / base).write_bytes(archive.read(name))
            (target / base).chmod(0o755)
        elif re.search(r"licen[cs]e", base, re.IGNORECASE):
            (target / base).write_bytes(archive.read(name))
versioned = sorted(p.name for p in target.iterdir() if p.name.startswith("libembree4") and p.name != library)
if not (target / library).exists():
    if not versioned:
        sys.exit(f"bootstrap: {wheel.name} holds no {library}")
    (target / library).symlink_to(versioned[0])
PYTHON

partial=".embree.$$.tmp"
mkdir "$partial"
trap 'rm -rf "$download" "$partial"' EXIT
cp -R "$download/unpacked/." "$partial/"
touch "$partial/$(basename "$stamp")"
rm -rf "$folder"
mv "$partial" "$folder"
