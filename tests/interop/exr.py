"""Reads a picture of ours with the OpenEXR project's own library and prints what it finds.

    python3 -m venv /tmp/venv && /tmp/venv/bin/pip install OpenEXR numpy
    /tmp/venv/bin/python tests/interop/exr.py out/plume.0001.exr

Prints windows, compression, attributes and, for each channel, its type, least, mean and largest finite number; fails
when a name, type or window is not as promised: bare R, G, B, A, colours in half, data in float, a data
window inside the display window, or with --overscan LEFT RIGHT TOP BOTTOM as much larger.
"""

import sys

import numpy
import OpenEXR


def main(path, overscan=None):
    with OpenEXR.File(path, separate_channels=True) as file:
        assert len(file.parts) == 1, f"{len(file.parts)} parts"
        header, channels = file.header(), file.channels()
        for name in sorted(header):
            if name != "channels":
                print(f"{name}: {header[name]}")
        low, high = (tuple(int(x) for x in corner) for corner in header["dataWindow"])
        frame = tuple(int(x) for x in header["displayWindow"][1])
        if overscan:
            left, right, top, bottom = overscan
            wanted = (-left, -top), (frame[0] + right, frame[1] + bottom)
            assert (low, high) == wanted, f"the data window is {low} to {high}, not {wanted[0]} to {wanted[1]}"
        else:
            is_inside = min(low) >= 0 and high[0] <= frame[0] and high[1] <= frame[1]
            assert is_inside, "the data window is outside the display window"
        size = (high[1] - low[1] + 1, high[0] - low[0] + 1)
        for name, channel in channels.items():
            pixels = channel.pixels
            finite = pixels[numpy.isfinite(pixels)].astype(numpy.float64)
            figures = f"{finite.min():.6g} {finite.mean():.6g} {finite.max():.6g}" if finite.size else "nothing finite"
            print(f"{name:<12} {pixels.dtype}  {figures}")
            assert pixels.shape == size, f"{name} has {pixels.shape} pixels, not {size}"
            colour = name in ("R", "G", "B", "A") or name.startswith("albedo.")
            wanted = (numpy.float16, numpy.float32) if colour else (numpy.float32,)
            assert pixels.dtype in wanted, f"{name} is {pixels.dtype}"
        assert {"R", "G", "B", "A"} <= set(channels), sorted(channels)
    print("as promised")


if __name__ == "__main__":
    if len(sys.argv) == 2:
        main(sys.argv[1])
    elif len(sys.argv) == 7 and sys.argv[2] == "--overscan":
        main(sys.argv[1], [int(pixels) for pixels in sys.argv[3:]])
    else:
        sys.exit(__doc__)
