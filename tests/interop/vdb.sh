#!/bin/sh
# OpenVDB's own tools read the .vdb files that we write. Needs
#
#     apt-get install -y libopenvdb-tools python3-openvdb
#
# and fails, rather than skips, without them. The other direction, files written by OpenVDB, is part of `cargo test`.
set -eu
cd "$(dirname "$0")/../.."
command -v vdb_print >/dev/null || { echo "vdb_print is missing: apt-get install -y libopenvdb-tools python3-openvdb" >&2; exit 1; }
cargo test --quiet --test vdb files_for_openvdb_to_read_are_written
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
