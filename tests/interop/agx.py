#!/usr/bin/env python3
"""The view `agx` of `curlsmoke sheet` beside the transform of Blender's own OpenColorIO configuration. Needs

    pip install bpy==5.0.1 opencolorio OpenEXR numpy pillow

and fails, rather than skips, without them. Colours: 40,000 in the gamut of Rec. 709 over sixteen stops, half of them muted.
Differences are in steps of an 8-bit channel.
"""
import glob
import importlib.util
import os
import subprocess
import sys
import tempfile

import numpy
import OpenEXR
import PyOpenColorIO as ocio
from PIL import Image

# Mean and 99th percentile of the differences that are allowed: half a step is what rounding alone may make.
MEAN_MAX, MOST_MAX = 0.5, 2.5


def blender_config():
    package = importlib.util.find_spec("bpy")
    if package is None:
        sys.exit("bpy is missing: pip install bpy==5.0.1")
    found = glob.glob(os.path.join(os.path.dirname(package.origin), "*", "datafiles", "colormanagement", "config.ocio"))
    return ocio.Config.CreateFromFile(found[0])


def colors():
    rng = numpy.random.default_rng(7)
    rgb = rng.random((200, 200, 3)) ** 1.5
    rgb /= rgb.max(2, keepdims=True)
    grey = rgb.mean(2, keepdims=True)
    rgb = grey + (rgb - grey) * rng.random((200, 200, 1))
    rgb[:100] = grey[:100] + (rgb[:100] - grey[:100]) * 0.6
    return (rgb * 2.0 ** rng.uniform(-9, 7, (200, 200, 1))).astype(numpy.float32)


def main():
    program = sys.argv[1] if len(sys.argv) > 1 else "target/release/curlsmoke"
    light = colors()
    with tempfile.TemporaryDirectory() as folder:
        exr, png = os.path.join(folder, "light.exr"), os.path.join(folder, "shown.png")
        OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, {"RGB": light}).write(exr)
        subprocess.run([program, "sheet", exr, "-o", png, "--view", "agx"], check=True, stdout=subprocess.DEVNULL)
        ours = numpy.asarray(Image.open(png)).astype(float)
    processor = blender_config().getProcessor("Linear Rec.709", "sRGB", "AgX", ocio.TRANSFORM_DIR_FORWARD)
    theirs = light.copy()
    processor.getDefaultCPUProcessor().applyRGB(theirs)
    error = numpy.abs(ours - 255 * theirs.clip(0, 1))
    mean, most = error.mean(), numpy.percentile(error, 99)
    print(f"mean {mean:.3f}, 99 % within {most:.2f}, muted colours within {numpy.percentile(error[:100], 99):.2f}, largest {error.max():.1f}")
    if mean > MEAN_MAX or most > MOST_MAX:
        sys.exit(f"more than {MEAN_MAX} on average or {MOST_MAX} for 99 %")


main()
