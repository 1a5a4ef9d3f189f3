"""The scenes that renderers are compared on: smoke of one shape, its surroundings, and files of both for each renderer."""

import json
import struct

import numpy

DIMS = (128, 256, 128)  # x, y, z
VOXEL = 1.0 / 64.0
LOW = (-1.0, 0.0, -1.0)

# y up; all is grey. Lamps are points: place and radiant intensity. The camera's distance is such that the plume fills half of it.
CAMERA = {"position": [1.5, 2.8, 9.0], "look_at": [0.0, 2.0, 0.0], "vertical_fov_deg": 26.0}
SUN = {"direction": [-0.612, -0.707, -0.354], "irradiance": 3.14159}
SCENES = {
    "plume": {
        "what": "a plume, 20 per metre, albedo 0.9, in a sun and an even sky",
        "size": [320, 240], "extinction": 20.0, "albedo": 0.9, "g": 0.3, "sun": SUN, "sky": 0.5, "ground": 0.5,
        "ball": None, "lamps": [],
    },
    "thick": {
        "what": "the same, 1,000 per metre (optical depth above 500), albedo 0.999",
        "size": [80, 64], "extinction": 1000.0, "albedo": 0.999, "g": 0.3, "sun": SUN, "sky": 0.5, "ground": 0.5,
        "ball": None, "lamps": [],
    },
    "lamps": {
        "what": "the same, 1 per metre, albedo 0.9, about a ball, with three small lamps and no other light",
        "size": [320, 240], "extinction": 1.0, "albedo": 0.9, "g": 0.3, "sun": None, "sky": 0.0, "ground": 0.5,
        "ball": {"center": [0.15, 1.2, 0.1], "radius": 0.35, "reflectance": 0.7},
        "lamps": [([-0.5, 2.2, 0.3], 1.0), ([0.6, 0.9, 0.2], 1.0), ([0.1, 3.2, -0.4], 1.0)],
    },
}  # fmt: skip


def density():
    """Rising lumps with crisp edges, at most 1 and mostly empty, as an array by x, y and z; its outermost voxels are empty."""
    axes = [LOW[a] + (numpy.arange(DIMS[a]) + 0.5) * VOXEL for a in range(3)]
    x, y, z = numpy.meshgrid(*axes, indexing="ij", sparse=True)
    lumps = sum(
        0.62**o * numpy.sin(2.9 * 1.87**o * x + 1.1 * o + numpy.cos(2.1 * 1.87**o * y))
        * numpy.sin(2.5 * 1.87**o * z + 2.3 * o + numpy.cos(2.7 * 1.87**o * y)) for o in range(7)
    )  # fmt: skip
    lean = (0.22 * numpy.sin(1.7 * y) * y / 4.0, 0.18 * numpy.cos(2.6 * y) * y / 4.0)
    squared = ((x - lean[0]) ** 2 + (z - lean[1]) ** 2) / (0.22 + 0.13 * y) ** 2
    ends = numpy.clip((y - 0.08) / 0.2, 0.0, 1.0) * numpy.clip((3.85 - y) / 0.5, 0.0, 1.0)
    d = numpy.clip((numpy.exp(-squared) * (1.0 + 0.9 * lumps) - 0.3) * ends, 0.0, None)
    d = d / (0.25 + d)
    for axis in range(3):
        edge = numpy.moveaxis(d, axis, 0)
        edge[:2] = edge[-2:] = 0.0
    return (d / d.max()).astype(numpy.float32)


def vdb(d):
    """A .vdb file of voxels: leaves of 8 cubed in nodes of 128 cubed, active values only, uncompressed."""
    text = lambda s: struct.pack("<I", len(s)) + s.encode()
    mask = lambda flags: numpy.packbits(flags, bitorder="little").tobytes()
    vector = lambda *v: struct.pack("<3d", *v)
    nodes = {}
    for i, j, k in numpy.ndindex(*(n // 8 for n in DIMS)):
        leaf = d[8 * i : 8 * i + 8, 8 * j : 8 * j + 8, 8 * k : 8 * k + 8].reshape(-1)
        if leaf.any():
            node = (i // 16) << 10 | (j // 16) << 5 | k // 16
            nodes.setdefault(node, []).append(((i % 16) << 8 | (j % 16) << 4 | k % 16, leaf))
    head = struct.pack("<QIIIB", 0x56444220, 224, 10, 0, 1) + b"00000000-0000-0000-0000-000000000000"
    head += struct.pack("<II", 0, 1) + text("density") + text("Tree_float_5_4_3") + text("")
    # OpenVDB reads the name from here.
    grid = struct.pack("<II", 2, 2) + text("class") + text("string") + text("fog volume")
    grid += text("name") + text("string") + text("density")
    grid += text("UniformScaleTranslateMap") + vector(*(c + 0.5 * VOXEL for c in LOW))
    for s in (VOXEL, VOXEL, 1.0 / VOXEL, 1.0 / VOXEL**2, 0.5 / VOXEL):
        grid += vector(s, s, s)
    grid += struct.pack("<IfII3i", 1, 0.0, 0, 1, 0, 0, 0)
    upper = numpy.zeros(32**3, bool)
    upper[list(nodes)] = True
    grid += mask(upper) + mask(numpy.zeros(32**3, bool)) + b"\0"
    buffers = b""
    for _, leaves in sorted(nodes.items()):
        lower = numpy.zeros(16**3, bool)
        lower[[place for place, _ in leaves]] = True
        grid += mask(lower) + mask(numpy.zeros(16**3, bool)) + b"\0"
        grid += b"".join(mask(leaf != 0.0) for _, leaf in leaves)
        buffers += b"".join(mask(leaf != 0.0) + b"\0" + leaf[leaf != 0.0].astype("<f4").tobytes() for _, leaf in leaves)
    start = len(head) + 24
    blocks = start + len(grid)
    return head + struct.pack("<3q", start, blocks, blocks + len(buffers)) + grid + buffers


def vol(d):
    """The same for Mitsuba, x fastest."""
    high = [LOW[a] + DIMS[a] * VOXEL for a in range(3)]
    head = b"VOL" + struct.pack("<B5i6f", 3, 1, *DIMS, 1, *LOW, *high)
    return head + raw(d)


def raw(d):
    """Voxels alone, x fastest."""
    return numpy.ascontiguousarray(d.transpose(2, 1, 0)).astype("<f4").tobytes()


def scene_of_ours(s, spp):
    """The scene as curlsmoke reads it (JSON is YAML)."""
    grey = lambda v: [v, v, v]
    diffuse = lambda v: {"diffuse": {"reflectance": grey(v)}}
    # A slab, so that the ground ends where that of the others does.
    shapes = {"ground": {"box": {"center": [0.0, -0.5, 0.0], "size": [40.0, 1.0, 40.0]}, "material": diffuse(s["ground"])}}
    if s["ball"]:
        ball = {"center": s["ball"]["center"], "radius": s["ball"]["radius"]}
        shapes["ball"] = {"sphere": ball, "material": diffuse(s["ball"]["reflectance"])}
    lights = [{"point": {"position": place, "intensity": grey(i)}} for place, i in s["lamps"]]
    if s["sun"]:
        lights.append({"sun": {"direction": s["sun"]["direction"], "irradiance": grey(s["sun"]["irradiance"])}})
    if s["sky"]:
        lights.append({"environment": {"radiance": grey(s["sky"])}})
    medium = {
        "extinction": s["extinction"],
        "albedo": grey(s["albedo"]),
        "phase": {"henyey_greenstein": {"g": s["g"]}},
    }
    return json.dumps({
        "version": 1,
        "camera": CAMERA,
        "film": {"resolution": s["size"], "spp": spp, "filter": {"box": {"radius": 0.5}}},
        "render": {"max_bounces": 100000},
        "shapes": shapes,
        "smoke": {"file": {"path": "plume.vdb"}, "medium": medium},
        "lights": lights,
    }, indent=2)  # fmt: skip


def scene_of_baseline(s):
    """The numbers that baseline.c reads, in its order."""
    sun, ball = s["sun"] or {"direction": [0.0, -1.0, 0.0], "irradiance": 0.0}, s["ball"]
    numbers = [*s["size"], *DIMS, *LOW, VOXEL, s["extinction"], s["albedo"], s["g"]]
    numbers += [*CAMERA["position"], *CAMERA["look_at"], CAMERA["vertical_fov_deg"]]
    numbers += [*(-c for c in sun["direction"]), sun["irradiance"], s["sky"], 1, s["ground"]]
    numbers += [1, *ball["center"], ball["radius"], ball["reflectance"]] if ball else [0] * 6
    numbers += [len(s["lamps"])]
    for place, intensity in s["lamps"]:
        numbers += [*place, intensity]
    return " ".join(map(str, numbers)) + "\n"
