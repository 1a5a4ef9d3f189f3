"""Compares FLIP of `curlsmoke compare --mode flip` with that of its authors' package, on made-up pictures.

    python3 -m venv /tmp/venv && /tmp/venv/bin/pip install flip-evaluator==1.7 OpenEXR numpy
    /tmp/venv/bin/python tests/interop/flip.py target/release/curlsmoke

Prints both means for each pair; fails where they differ by 1e-4 or more.
"""

import pathlib
import re
import subprocess
import sys
import tempfile

import flip_evaluator
import numpy
import OpenEXR

LIMIT = 1e-4


def pairs():
    random = numpy.random.default_rng(7)
    y, x = numpy.mgrid[0:90, 0:131] / 90.0
    smooth = numpy.stack([0.5 + 0.4 * numpy.sin(5 * x), 0.3 + 0.3 * y, 0.2 + 0.1 * x * y], -1)
    disk = numpy.where(((x - 0.7) ** 2 + (y - 0.5) ** 2 < 0.06)[..., None], [6.0, 4.0, 1.0], smooth)
    yield "noise", smooth * random.gamma(20, 1 / 20, smooth.shape), smooth
    yield "a per cent", 1.01 * disk, disk
    yield "a pixel aside", numpy.roll(disk, 1, 1), disk
    yield "other colours", disk[..., ::-1], disk
    yield "very bright", disk * random.gamma(4, 1 / 4, disk.shape) * 300, disk * 300
    yield "mostly black", disk * (disk > 1) * 1.2, disk * (disk > 1)
    yield "mean and median apart", disk**8, (disk * 1.05) ** 8


def write(path, pixels):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {name: numpy.ascontiguousarray(pixels[..., i]) for i, name in enumerate("RGB")}
    OpenEXR.File(header, channels).write(str(path))


def ours(program, image, reference, ldr):
    command = [program, "compare", str(image), str(reference), "--mode", "flip", "--threshold", "1"]
    out = subprocess.run(command + ["--ldr"] * ldr, capture_output=True, text=True, check=True).stdout
    return float(re.search(r"mean FLIP ([0-9.]+)", out).group(1))


def main(program):
    worst = 0.0
    with tempfile.TemporaryDirectory() as folder:
        image, reference = (pathlib.Path(folder) / name for name in ("image.exr", "reference.exr"))
        for name, a, b in pairs():
            for kind in ("HDR", "LDR"):
                limit = 1.0 if kind == "LDR" else numpy.inf
                p, q = (numpy.clip(pixels, 0, limit).astype(numpy.float32) for pixels in (a, b))
                write(image, p)
                write(reference, q)
                # Of the low range the package is told that its numbers are light as well.
                theirs = flip_evaluator.evaluate(q, p, kind, inputsRGB=False, applyMagma=False)[1]
                own = ours(program, image, reference, kind == "LDR")
                worst = max(worst, abs(own - theirs))
                print(f"{kind}  {name:<22} {own:.6f}  {theirs:.6f}  {own - theirs:+.1e}")
    print(f"largest difference {worst:.1e}")
    assert worst < LIMIT, f"more than {LIMIT}"


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
