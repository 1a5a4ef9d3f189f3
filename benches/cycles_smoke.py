"""Smoke of ours, baked to a .vdb file, in Cycles and here: block means of both pictures.

Run by a Python that can import bpy, numpy and OpenEXR, after `cargo build --release`:

    PYTHON benches/cycles_smoke.py [--spp 1024] [--binary target/release/curlsmoke]

The surroundings are those of the plume of `make peers`; the smoke is of particles. Fails where a block of 40 × 40 pixels differs by
more than 2 % and three standard errors.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy
import OpenEXR

ROOT = pathlib.Path(__file__).resolve().parent.parent
PEERS = ROOT / "benches/peer_renderers"
sys.path.insert(0, str(PEERS))
from scenes import SCENES, scene_of_ours  # noqa: E402

BLOCK, SEEDS = 40, 4
SMOKE = {
    "emitters": [{
        "disk": {"center": [0.0, 0.15, 0.0], "radius": 0.3}, "rate": 30000, "mass": 0.3, "start": -5,
        "lifetime": 4.0, "fade_out": 2.0,
    }],
    "grid": {"voxel_size": 0.025, "kernel_radius": 0.06, "expansion": 0.03},
    "seed": 3,
}  # fmt: skip
FLOW = {
    "potentials": [
        {"uniform": {"velocity": [0.0, 0.8, 0.0]}},
        {"noise": {"length_scale": 0.7, "speed": 0.3, "octaves": 3, "spin_rate": 0.1}},
    ]
}


def picture(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        return numpy.stack([channels[c].pixels for c in "RGB"], axis=-1).astype(float).mean(axis=-1)


def blocks(pixels):
    height, width = (n // BLOCK for n in pixels.shape)
    return pixels[: height * BLOCK, : width * BLOCK].reshape(height, BLOCK, width, BLOCK).mean(axis=(1, 3))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spp", type=int, default=1024, help="paths of a pixel, of all seeds together")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/curlsmoke")
    arguments = parser.parse_args()
    spp = max(arguments.spp // SEEDS, 2)
    settings = SCENES["plume"]
    ours = json.loads(scene_of_ours(settings, spp))
    ours["smoke"] = {"medium": ours["smoke"]["medium"], **SMOKE}
    ours["flow"], ours["frames"] = FLOW, {"first": 1, "last": 1}
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "scene.yaml").write_text(json.dumps(ours))
        run = lambda *words: subprocess.run(
            [str(w) for w in words], cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        program = arguments.binary.resolve()
        run(program, "bake", "scene.yaml", "--output", "plume.vdb", "--threads", arguments.threads)
        own, other = [], []
        for seed in range(1, SEEDS + 1):
            run(program, "render", "scene.yaml", "-o", "own.exr", "--seed", seed, "--threads", arguments.threads)
            own.append(blocks(picture(folder / "own.exr")))
            run(sys.executable, PEERS / "by_cycles.py", folder, "plume", spp, seed, arguments.threads, "cycles.npy")
            other.append(blocks(numpy.load(folder / "cycles.npy")))
    own, other = numpy.array(own), numpy.array(other)
    share = other.mean(axis=0) / own.mean(axis=0) - 1.0
    variance = (own.var(axis=0, ddof=1) + other.var(axis=0, ddof=1)) / SEEDS
    error = numpy.sqrt(variance) / own.mean(axis=0)
    print("block means, ours:")
    print(numpy.array2string(own.mean(axis=0), precision=3, max_line_width=140))
    print("Cycles beside ours [%]:")
    print(numpy.array2string(100.0 * share, precision=2, suppress_small=True, max_line_width=140))
    print(
        f"whole picture {100.0 * (other.mean() / own.mean() - 1.0):+.2f} %, worst block {100.0 * numpy.abs(share).max():.2f} % "
        f"(root mean square {100.0 * numpy.sqrt((share**2).mean()):.2f} %; standard error of a block at most {100.0 * error.max():.2f} %)"
    )
    if (numpy.abs(share) > 0.02 + 3.0 * error).any():
        sys.exit("a block differs by more than 2 %")


main()
