"""Writes tests/data/vdb/*.vdb.gz with OpenVDB's own library and tools.

    apt-get install -y libopenvdb-tools python3-openvdb
    /usr/bin/python3 tests/interop/make_fixtures.py

The values are a formula of the voxel, which tests/vdb.rs knows too. Every value is exact in half precision.
"""
import gzip
import pathlib
import subprocess
import tempfile

import pyopenvdb as vdb

HERE = pathlib.Path(__file__).resolve().parent.parent / "data" / "vdb"


def value(i, j, k):
    return ((7 * i + 13 * j + 29 * k) % 64 + 1) / 64.0


def transform(shift):
    t = vdb.createLinearTransform(0.25)
    t.translate(shift)
    return t


def density():
    grid = vdb.FloatGrid()
    grid.name = "density"
    grid.gridClass = vdb.GridClass.FOG_VOLUME
    grid.transform = transform((0.5, -1.0, 2.0))
    access = grid.getAccessor()
    for i in range(-5, 12, 3):
        for j in range(120, 136, 2):
            for k in range(-3, 9, 2):
                access.setValueOn((i, j, k), value(i, j, k))
    # A dense leaf, so that compressing it gains something.
    for i in range(24, 32):
        for j in range(128, 136):
            for k in range(8):
                access.setValueOn((i, j, k), value(i // 2, j // 4, 0))
    # Inactive values in a leaf: one other than the background, two others, many.
    access.setValueOff((3, 121, 1), 0.5)
    access.setValueOff((-4, 121, 1), 0.25)
    access.setValueOff((-4, 121, 3), 0.75)
    for n in range(5):
        access.setValueOff((9, 129, n), (n + 1) / 8.0)
    # Tiles of one leaf's size, active and not.
    grid.fill((16, 128, 0), (23, 135, 7), 1.5, True)
    grid.fill((16, 136, 0), (23, 143, 7), 0.75, False)
    return grid


def base():
    grid = density()
    twin = grid.copy()
    twin.name = "twin"
    twin.transform = transform((0.0, 0.0, 100.0))
    heat = vdb.FloatGrid()
    heat.name = "heat"
    heat.transform = grid.transform
    heat.getAccessor().setValueOn((-4097, 0, 5000), 2.0)
    velocity = vdb.Vec3SGrid()
    velocity.name = "v"
    velocity.getAccessor().setValueOn((1, 2, 3), (1, 2, 3))
    return [heat, velocity, grid, twin]


def store(path, name):
    data = gzip.compress(path.read_bytes(), 9, mtime=0)
    (HERE / f"{name}.vdb.gz").write_bytes(data)
    print(f"{name}: {path.stat().st_size} bytes, {len(data)} packed")


HERE.mkdir(parents=True, exist_ok=True)
with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    vdb.write(str(folder / "base.vdb"), grids=base())
    store(folder / "base.vdb", "float_shared")
    for bits, word in [(32, "float"), (16, "half")]:
        for codec in ["none", "active", "zip", "blosc"]:
            out = folder / f"{word}_{codec}.vdb"
            command = ["vdb_tool", "-read", str(folder / "base.vdb"), "-write", f"codec={codec}", f"bits={bits}", str(out)]
            subprocess.run(command, check=True, capture_output=True)
            store(out, out.stem)
    sphere = vdb.createLevelSetSphere(radius=2.0, center=(0, 0, 0), voxelSize=0.5)
    sphere.name = "surface"
    tilted = vdb.FloatGrid()
    tilted.name = "tilted"
    tilted.transform = vdb.createLinearTransform([[1, 1, 0, 0], [-1, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    tilted.getAccessor().setValueOn((0, 0, 0), 1.0)
    boxes = vdb.FloatGrid()
    boxes.name = "boxes"
    boxes.transform = vdb.createLinearTransform([[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    boxes.getAccessor().setValueOn((0, 0, 0), 1.0)
    affine = vdb.FloatGrid()
    affine.name = "affine"
    affine.transform = vdb.createLinearTransform([[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [4, 5, 6, 1]])
    affine.getAccessor().setValueOn((0, 0, 0), 1.0)
    negative = vdb.FloatGrid()
    negative.name = "negative"
    negative.getAccessor().setValueOn((5, 6, 7), -1.0)
    huge = vdb.FloatGrid()
    huge.name = "huge"
    huge.fill((0, 0, 0), (4095, 4095, 4095), 1.0, True)
    vdb.write(str(folder / "odd.vdb"), grids=[sphere, tilted, boxes, affine, negative, huge])
    store(folder / "odd.vdb", "odd")
