"""One scene by curlsmoke and by Mitsuba 3, block by block: lumpy smoke that scatters forward, over a diffuse floor and about
a diffuse ball, in a sun and an even sky.

    python3 -m venv venv && venv/bin/pip install numpy OpenEXR mitsuba==3.9.1
    cargo build --release
    venv/bin/python benches/mitsuba_compare.py

Fails where the means of a block of 16 by 16 pixels differ by more than one per cent and by more than three standard errors
of their difference. With --record the figures are written into docs/verification.md. Both get the same voxels, made here:
as a .vdb file and as one of Mitsuba's own. Some minutes of two processors; no part of the tests.
"""

import argparse
import json
import pathlib
import struct
import subprocess
import sys
import tempfile

import numpy

ROOT = pathlib.Path(__file__).resolve().parent.parent
MARK = "<!-- What follows is written by benches/mitsuba_compare.py. -->"
SIZE = (192, 144)
BLOCK = 16
DIMS = (64, 128, 64)  # x, y, z
VOXEL = 1.0 / 32.0
LOW = (-1.0, 0.0, -1.0)
SCENE = {
    "camera": {"position": [1.5, 2.8, 9.0], "look_at": [0.0, 2.0, 0.0], "vertical_fov_deg": 26.0},
    "extinction": 20.0,
    "albedo": 0.9,
    "g": 0.3,
    "sky": 0.5,
    # Of the light: down, to the left and away.
    "sun": {"direction": [-0.612, -0.707, -0.354], "irradiance": 3.14159},
    "floor": {"center": [0.0, -0.5, 0.0], "size": [40.0, 1.0, 40.0], "reflectance": 0.5},
    "ball": {"center": [0.15, 1.2, 0.1], "radius": 0.35, "reflectance": 0.7},
}


def density():
    """A leaning plume of lumps with crisp edges, as an array by x, y and z; its outermost voxels are empty."""
    axes = [LOW[a] + (numpy.arange(DIMS[a]) + 0.5) * VOXEL for a in range(3)]
    x, y, z = numpy.meshgrid(*axes, indexing="ij")
    height = y / 4.0
    lumps = sum(
        0.6**o * numpy.sin(3.1 * 1.9**o * x + 1.3 * o + numpy.cos(2.3 * 1.9**o * y))
        * numpy.cos(2.7 * 1.9**o * z + 0.7 * o + numpy.sin(2.9 * 1.9**o * y)) for o in range(5)
    )
    middle = (0.25 * numpy.sin(2.0 * y) * height, 0.2 * numpy.cos(3.0 * y) * height)
    radius = 0.3 + 0.45 * height
    core = numpy.clip(1.0 - 0.5 * ((x - middle[0]) ** 2 + (z - middle[1]) ** 2) / radius**2, 0.0, None) ** 2
    ends = numpy.clip((y - 0.1) / 0.3, 0.0, 1.0) * numpy.clip((3.8 - y) / 0.6, 0.0, 1.0)
    d = numpy.clip((core * (1.0 + 0.9 * lumps) - 0.25) * ends, 0.0, None)
    d = d / (0.3 + d)
    for axis in range(3):
        edge = numpy.moveaxis(d, axis, 0)
        edge[:2] = edge[-2:] = 0.0
    return (d / d.max()).astype(numpy.float32)


def vdb(d):
    """A .vdb file of voxels within one node of 128 cubed: active values only, uncompressed."""
    text = lambda s: struct.pack("<I", len(s)) + s.encode()
    mask = lambda flags: numpy.packbits(flags, bitorder="little").tobytes()
    vector = lambda *v: struct.pack("<3d", *v)
    leaves = []
    for i, j, k in numpy.ndindex(*(n // 8 for n in DIMS)):
        leaf = d[8 * i : 8 * i + 8, 8 * j : 8 * j + 8, 8 * k : 8 * k + 8].reshape(-1)
        if leaf.any():
            leaves.append((i << 8 | j << 4 | k, leaf))
    head = struct.pack("<QIIIB", 0x56444220, 224, 10, 0, 1) + b"00000000-0000-0000-0000-000000000000"
    head += struct.pack("<II", 0, 1) + text("density") + text("Tree_float_5_4_3") + text("")
    # Active values without further compression; no metadata but the class.
    grid = struct.pack("<I", 2) + struct.pack("<I", 1) + text("class") + text("string") + text("fog volume")
    grid += text("UniformScaleTranslateMap") + vector(*(c + 0.5 * VOXEL for c in LOW))
    for s in (VOXEL, VOXEL, 1.0 / VOXEL, 1.0 / VOXEL**2, 0.5 / VOXEL):
        grid += vector(s, s, s)
    grid += struct.pack("<IfII3i", 1, 0.0, 0, 1, 0, 0, 0)
    upper, lower = numpy.zeros(32**3, bool), numpy.zeros(16**3, bool)
    upper[0] = True
    lower[[place for place, _ in leaves]] = True
    grid += mask(upper) + mask(numpy.zeros(32**3, bool)) + b"\0"
    grid += mask(lower) + mask(numpy.zeros(16**3, bool)) + b"\0"
    grid += b"".join(mask(leaf != 0.0) for _, leaf in leaves)
    buffers = b"".join(mask(leaf != 0.0) + b"\0" + leaf[leaf != 0.0].astype("<f4").tobytes() for _, leaf in leaves)
    start = len(head) + 24
    blocks = start + len(grid)
    return head + struct.pack("<3q", start, blocks, blocks + len(buffers)) + grid + buffers


def vol(d):
    """The same for Mitsuba, x fastest."""
    high = [LOW[a] + DIMS[a] * VOXEL for a in range(3)]
    head = b"VOL" + struct.pack("<B5i6f", 3, 1, *DIMS, 1, *LOW, *high)
    return head + numpy.ascontiguousarray(d.transpose(2, 1, 0)).astype("<f4").tobytes()


def ours(args, folder, spp, seeds):
    s = SCENE
    grey = lambda v: [v, v, v]
    diffuse = lambda v: {"diffuse": {"reflectance": grey(v)}}
    scene = {
        "version": 1,
        "camera": s["camera"],
        "film": {"resolution": list(SIZE), "spp": spp, "filter": {"box": {"radius": 0.5}}},
        "render": {"max_bounces": 100000},
        "shapes": {
            "floor": {"box": {k: s["floor"][k] for k in ("center", "size")}, "material": diffuse(s["floor"]["reflectance"])},
            "ball": {
                "sphere": {k: s["ball"][k] for k in ("center", "radius")},
                "material": diffuse(s["ball"]["reflectance"]),
            },
        },
        "smoke": {
            "file": {"path": "plume.vdb"},
            "medium": {
                "extinction": s["extinction"],
                "albedo": grey(s["albedo"]),
                "phase": {"henyey_greenstein": {"g": s["g"]}},
            },
        },
        "lights": [
            {"sun": {"direction": s["sun"]["direction"], "irradiance": grey(s["sun"]["irradiance"])}},
            {"environment": {"radiance": grey(s["sky"])}},
        ],
    }
    (folder / "scene.yaml").write_text(json.dumps(scene, indent=2))
    import OpenEXR

    pictures = []
    for seed in seeds:
        out = folder / f"ours-{seed}.exr"
        command = [args.curlsmoke, "render", folder / "scene.yaml", "--seed", str(seed), "-o", out]
        subprocess.run([str(c) for c in command], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        with OpenEXR.File(str(out), separate_channels=True) as file:
            pictures.append(numpy.stack([file.channels()[c].pixels for c in "RGB"], axis=-1).astype(float).mean(axis=-1))
    return pictures


def theirs(args, folder, spp, seeds):
    import mitsuba as mi

    mi.set_variant(args.variant)
    T, s = mi.ScalarTransform4f, SCENE
    grey = lambda v: {"type": "rgb", "value": [v, v, v]}
    box = lambda center, size: T().translate(center).scale([0.5 * e for e in size])
    high = [LOW[a] + DIMS[a] * VOXEL for a in range(3)]
    low = [LOW[0], LOW[1] + VOXEL, LOW[2]]
    camera = s["camera"]
    smoke = {
        "type": "heterogeneous",
        "albedo": s["albedo"],
        "scale": s["extinction"],
        "phase": {"type": "hg", "g": s["g"]},
        "sigma_t": {
            "type": "gridvolume",
            "filename": str(folder / "plume.vol"),
            "raw": True,
            "filter_type": "trilinear",
            "wrap_mode": "clamp",
            "to_world": T().translate(LOW).scale([b - a for a, b in zip(LOW, high)]),
        },
    }
    scene = mi.load_dict(
        {
            "type": "scene",
            # No roulette before most paths have ended: theirs is noisy in thick smoke.
            "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": 64},
            "sensor": {
                "type": "perspective",
                "fov": camera["vertical_fov_deg"],
                "fov_axis": "y",
                "to_world": T().look_at(origin=camera["position"], target=camera["look_at"], up=[0, 1, 0]),
                "film": {
                    "type": "hdrfilm",
                    "width": SIZE[0],
                    "height": SIZE[1],
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgb",
                    "component_format": "float32",
                },
                "sampler": {"type": "independent"},
            },
            "sky": {"type": "constant", "radiance": grey(s["sky"])},
            "sun": {
                "type": "directional",
                "direction": s["sun"]["direction"],
                "irradiance": grey(s["sun"]["irradiance"]),
            },
            "floor": {
                "type": "cube",
                "to_world": box(s["floor"]["center"], s["floor"]["size"]),
                "bsdf": {"type": "diffuse", "reflectance": grey(s["floor"]["reflectance"])},
            },
            "ball": {
                "type": "sphere",
                "center": s["ball"]["center"],
                "radius": s["ball"]["radius"],
                "bsdf": {"type": "diffuse", "reflectance": grey(s["ball"]["reflectance"])},
            },
            # Begins one empty voxel above the floor, so that two faces do not lie in one plane.
            "smoke": {
                "type": "cube",
                "to_world": box([0.5 * (a + b) for a, b in zip(low, high)], [b - a for a, b in zip(low, high)]),
                "bsdf": {"type": "null"},
                "interior": smoke,
            },
        }
    )
    pictures = [numpy.array(mi.render(scene, spp=spp, seed=seed)).astype(float).mean(axis=-1) for seed in seeds]
    return pictures, mi.__version__


def blocks(picture):
    h, w = picture.shape
    return picture.reshape(h // BLOCK, BLOCK, w // BLOCK, BLOCK).mean(axis=(1, 3))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--curlsmoke", default=ROOT / "target/release/curlsmoke", help="the program")
    parser.add_argument("--variant", default="scalar_rgb", help="of Mitsuba; llvm_ad_rgb needs LLVM 16 or later")
    parser.add_argument("--spp", type=int, default=16, help="of Mitsuba, for each seed; ours has twice as many")
    parser.add_argument("--seeds", type=int, default=16, help="pictures of each, whose spread is the standard error")
    parser.add_argument("--keep", type=pathlib.Path, help="a folder for scene, voxels and pictures")
    parser.add_argument("--record", action="store_true", help="write the figures into docs/verification.md")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as fresh:
        folder = args.keep or pathlib.Path(fresh)
        folder.mkdir(parents=True, exist_ok=True)
        d = density()
        (folder / "plume.vdb").write_bytes(vdb(d))
        (folder / "plume.vol").write_bytes(vol(d))
        seeds = range(1, args.seeds + 1)
        a = ours(args, folder, 2 * args.spp, seeds)
        b, version = theirs(args, folder, args.spp, seeds)
        numpy.save(folder / "ours.npy", numpy.mean(a, axis=0))
        numpy.save(folder / "theirs.npy", numpy.mean(b, axis=0))
    own = subprocess.run([str(args.curlsmoke), "--version"], check=True, capture_output=True, text=True).stdout.strip()
    judge(args, a, b, own, version)


def judge(args, a, b, own, version):
    a, b = (numpy.array([blocks(p) for p in pictures]) for pictures in (a, b))
    mean = [x.mean(axis=0) for x in (a, b)]
    error = numpy.sqrt(sum(x.var(axis=0, ddof=1) / len(x) for x in (a, b)))
    # Our pictures have colours of eleven bits.
    error = numpy.hypot(error, 2e-4 * mean[1])
    share, z = (mean[0] - mean[1]) / mean[1], (mean[0] - mean[1]) / error
    is_off = (abs(share) > 0.01) & (abs(z) > 3.0)
    whole = (mean[0].mean() / mean[1].mean() - 1.0) * 100.0
    text = f"""
## Beside Mitsuba 3

Written by `benches/mitsuba_compare.py --record`, which says what is needed; a record of one run, not part of any test. One
scene, {SIZE[0]} by {SIZE[1]} pixels: lumpy smoke ({DIMS[0]} by {DIMS[1]} by {DIMS[2]} voxels, {SCENE["extinction"]:g} per metre, albedo {SCENE["albedo"]}, g = {SCENE["g"]}) about a diffuse ball, on a
diffuse floor, in a sun and an even sky. {own}, {args.seeds} pictures of {2 * args.spp} paths a pixel; Mitsuba {version} (`{args.variant}`, `volpath`),
{args.seeds} of {args.spp}. Means of blocks of {BLOCK} by {BLOCK} pixels; σ is the standard error of their difference, from the spread between pictures
and the rounding of ours to half precision.

| | |
|---|---|
| blocks | {z.size} |
| beyond both 1 % and 3 σ | {int(is_off.sum())} |
| largest difference | {abs(share).max() * 100.0:.2f} % |
| largest deviation | {abs(z).max():.2f} σ |
| root of the mean square deviation | {numpy.sqrt((z**2).mean()):.2f} σ |
| mean σ of a block | {(error / mean[1]).mean() * 100.0:.2f} % |
| whole picture | {whole:+.3f} % |

Deviation of each block [σ]; plain sky has none:

"""
    text += "\n".join("    " + " ".join(f"{x:+5.1f}" for x in row) for row in z) + "\n"
    print(text)
    if args.record:
        page = ROOT / "docs/verification.md"
        before = page.read_text().split(MARK)[0].rstrip("\n") + "\n\n" if page.exists() else ""
        page.write_text(before + MARK + "\n" + text)
    if is_off.any():
        sys.exit(f"{int(is_off.sum())} blocks differ by more than 1 % and 3 standard errors")


if __name__ == "__main__":
    main()
