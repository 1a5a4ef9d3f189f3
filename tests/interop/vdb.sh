#!/bin/sh
# OpenVDB's own tools, and Blender where its Python module is at hand, read the .vdb files that we write. Installs
#
#     apt-get install -y libopenvdb-tools python3-openvdb
#
# where they are missing, and fails, rather than skips, without them. Blender is asked through BLENDER_PYTHON, a Python that can
# `import bpy` (a virtual environment with `pip install bpy`); without it that part is left out, and said so. The other direction,
# files written by OpenVDB, is part of `cargo test`.
set -eu
cd "$(dirname "$0")/../.."
has_openvdb() { command -v vdb_print >/dev/null && /usr/bin/python3 -c "import pyopenvdb" 2>/dev/null; }
has_openvdb || apt-get install -y libopenvdb-tools python3-openvdb >/dev/null || true
has_openvdb || {
    echo "OpenVDB's tools are missing and could not be installed: as root, apt-get install -y libopenvdb-tools python3-openvdb" >&2
    exit 1
}
cargo test --quiet --test vdb files_for_openvdb_to_read_are_written
cargo test --quiet --test interchange for_openvdb_to_read_are_written
folder=${CARGO_TARGET_DIR:-target}/tmp/vdb
vdb_print -l "$folder/float_zip.vdb"
vdb_print "$folder"/*.vdb
# Debian's module belongs to Debian's Python.
/usr/bin/python3 - "$folder" <<'PYTHON'
import struct
import sys
import pyopenvdb as vdb

folder = sys.argv[1]
expected = {}
for line in open(folder + "/voxels.txt"):
    x, y, z, d = line.split()
    expected[int(x), int(y), int(z)] = float(d)
for name in ["float_plain", "float_zip", "half_plain", "half_zip"]:
    for grid_name in ["density", "again"]:
        grid = vdb.read(f"{folder}/{name}.vdb", grid_name)
        found = {}
        for item in grid.citerOnValues():
            assert item.min == item.max, "an active tile that nobody wrote"
            found[item.min] = item.value
        assert found.keys() == expected.keys(), f"{name}: other voxels are active"
        for voxel, value in expected.items():
            if name.startswith("half"):
                value = struct.unpack("e", struct.pack("e", value))[0]
            assert found[voxel] == value, f"{name} {voxel}: {found[voxel]} instead of {value}"
        assert grid.gridClass == vdb.GridClass.FOG_VOLUME and grid.background == 0
        assert grid.evalActiveVoxelBoundingBox() == (grid.metadata["file_bbox_min"], grid.metadata["file_bbox_max"])
        assert grid.activeVoxelCount() == grid.metadata["file_voxel_count"] == len(expected)
        # The centre of voxel (0, 0, 0) is half a voxel from the corner that the grid was made with.
        corner = grid.transform.indexToWorld((-0.5, -0.5, -0.5))
        assert max(abs(a - b) for a, b in zip(corner, (-2.0, 0.4, -0.7))) < 1e-6, corner
    print(f"{name}: {len(expected)} voxels equal")
PYTHON

# Vectors, temperatures and level sets.
means=${CARGO_TARGET_DIR:-target}/tmp/vdb_means
vdb_print "$means"/*.vdb
/usr/bin/python3 - "$means" <<'PYTHON'
import math
import struct
import sys
import pyopenvdb as vdb

folder = sys.argv[1]
half = lambda x: struct.unpack("e", struct.pack("e", x))[0]
expected = {}
for line in open(folder + "/voxels.txt"):
    numbers = line.split()
    expected[tuple(map(int, numbers[:3]))] = [float(x) for x in numbers[3:]]
for name in ["float", "half"]:
    read = lambda values: [half(v) for v in values] if name == "half" else values
    for grid_name, part in [("density", slice(0, 1)), ("temperature", slice(1, 2)), ("v", slice(2, 5))]:
        grid = vdb.read(f"{folder}/{name}.vdb", grid_name)
        found = {}
        for item in grid.citerOnValues():
            assert item.min == item.max, "an active tile that nobody wrote"
            found[item.min] = list(item.value) if grid_name == "v" else [item.value]
        assert found.keys() == expected.keys(), f"{name} {grid_name}: other voxels are active"
        error = max(abs(a - b) for at, v in expected.items() for a, b in zip(found[at], read(v[part])))
        assert error == 0.0, f"{name} {grid_name}: off by {error}"
        assert grid.evalActiveVoxelBoundingBox() == (grid.metadata["file_bbox_min"], grid.metadata["file_bbox_max"])
        assert grid.activeVoxelCount() == grid.metadata["file_voxel_count"] == len(expected)
        assert max(abs(x) for x in grid.transform.indexToWorld((-0.5, -0.5, -0.5))) < 1e-6
        assert grid.transform.voxelSize() == (0.05000000074505806,) * 3, grid.transform.voxelSize()
        if grid_name == "v":
            assert isinstance(grid, vdb.Vec3SGrid) and tuple(grid.background) == (0, 0, 0)
            assert grid.metadata["vector_type"] == "contravariant relative" and grid.vectorType == "contravariant relative"
            assert grid.gridClass == vdb.GridClass.UNKNOWN
        else:
            assert grid.gridClass == vdb.GridClass.FOG_VOLUME and grid.background == 0
    print(f"{name}: {len(expected)} voxels of density, temperature and v equal, max error 0")

# A ball of radius 0.4 about (0.1, 0.2, -0.3) and a box, on voxels of 0.03.
for name in ["level_set_float", "level_set_half"]:
    grid = vdb.read(f"{folder}/{name}.vdb", "surface")
    assert grid.gridClass == vdb.GridClass.LEVEL_SET
    h = grid.transform.voxelSize()[0]
    is_half = name.endswith("half")
    rounding = lambda d: 2.0**-11 * abs(d) + 1e-7 if is_half else 2e-7
    assert abs(grid.background - 3 * h) < 1e-7
    def distance(at):
        p = grid.transform.indexToWorld(at)
        ball = math.dist(p, (0.1, 0.2, -0.3)) - 0.4
        q = [abs(a - b) - c for a, b, c in zip(p, (0.9, 0.1, 0.0), (0.25, 0.5, 0.3))]
        box = math.hypot(*(max(x, 0.0) for x in q)) + min(max(q), 0.0)
        return min(ball, box)
    low, high = grid.evalActiveVoxelBoundingBox()
    get = grid.getConstAccessor()
    worst, active = 0.0, 0
    for i in range(low[0] - 6, high[0] + 7):
        for j in range(low[1] - 6, high[1] + 7):
            for k in range(low[2] - 6, high[2] + 7):
                value, is_on = get.probeValue((i, j, k))
                d = distance((i, j, k))
                if is_on:
                    active += 1
                    assert abs(value - d) <= rounding(d), f"{i, j, k}: {value} instead of {d}"
                    worst = max(worst, abs(value - d))
                else:
                    assert abs(d) > grid.background - 1e-6, f"{i, j, k} at {d} is not in the band"
                    assert value == math.copysign(grid.background, d), f"{i, j, k}: {value} at {d}"
    assert active == grid.activeVoxelCount() == grid.metadata["file_voxel_count"]
    # OpenVDB's own mesher closes it.
    points, triangles, quads = grid.convertToPolygons()
    off = max(abs(distance(grid.transform.worldToIndex(tuple(map(float, p))))) for p in points)
    assert len(quads) > 1000 and off < h, off
    print(f"{name}: {active} voxels of the band, off by at most {worst:.1e} m; a mesh of {len(quads)} quads within {off / h:.2f} voxels")
PYTHON

if [ -n "${BLENDER_PYTHON:-}" ]; then
    "$BLENDER_PYTHON" tests/interop/blender.py "$means"
else
    echo "Blender was not asked: set BLENDER_PYTHON to a Python that can import bpy"
fi
