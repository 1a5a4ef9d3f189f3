#!/usr/bin/env python3
"""Masks of shapes as PyPI's `cryptomatte-api` decodes them from pictures of this program and from files of their own. Needs

    pip install cryptomatte-api OpenEXR numpy

and fails, rather than skips, without them. The masks must be those of the layers `shape_id` (through the middle of each pixel, so that
whole pixels are compared).
"""
import os
import subprocess
import sys
import tempfile

import cryptomatte_api
import numpy
import OpenEXR

SCENE = "scenes/tests/solids.yaml"


def main():
    program = sys.argv[1] if len(sys.argv) > 1 else "target/release/curlsmoke"
    with tempfile.TemporaryDirectory() as folder:
        for layout in ["single", "separate"]:
            path = os.path.join(folder, layout + ".exr")
            sets = ["output.aovs=[cryptomatte, shape_id]", "output.layout=" + layout]
            flags = [flag for text in sets for flag in ("--set", text)]
            subprocess.run([program, "render", SCENE, "--spp", "64", "-o", path, "--progress", "none", *flags], check=True)
            own = {name: path[:-4] + "." + name + ".exr" for name in ["shape_id", "CryptoObject"]}
            with OpenEXR.File(own["shape_id"] if layout == "separate" else path, separate_channels=True) as file:
                shape_id = file.channels()["shape_id"].pixels
            # The decoder looks at the first part of a file alone.
            loaded = cryptomatte_api.Cryptomatte.load(own["CryptoObject"] if layout == "separate" else path)
            assert len(loaded) == 1, f"{layout}: {len(loaded)} sets of masks"
            masks = loaded[0].masks()
            names = sorted(masks)
            total = sum(masks.values())
            # But for pixels on outlines, shapes cover all of a pixel or nothing of it.
            even = (total < 1e-3) | (total > 0.999)
            assert even.mean() > 0.9 and ((total > 0.5) == (shape_id > 0))[even].all(), f"{layout}: masks miss shapes"
            for number, name in enumerate(names, 1):
                middle = shape_id == number
                whole = masks[name] > 0.999
                assert whole.any() and (middle[whole]).all(), f"{layout}: {name} covers pixels whose middle it is not"
                print(f"{layout}: {name} covers {masks[name].sum():.1f} pixels, {int(whole.sum())} of them whole")


main()
