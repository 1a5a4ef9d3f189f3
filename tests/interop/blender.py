"""Blender reads the files that tests/interop/vdb.sh leaves in a folder: blender.py FOLDER, by a Python that can import bpy.

The volume is turned about x as docs/vdb.md says, from y up to z up, and its grids are sampled where their voxels should then be.
"""

import math
import sys

import bpy
import numpy

FOLDER = sys.argv[1]


def turned(points):
    """From y up to z up."""
    return numpy.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)


def sampled(volume, grid, is_vector, points):
    """The values of a grid nearest to points in the world, by a tree of geometry nodes."""
    mesh = bpy.data.meshes.new("points")
    mesh.from_pydata(points.tolist(), [], [])
    thing = bpy.data.objects.new("points", mesh)
    bpy.context.scene.collection.objects.link(thing)
    group = bpy.data.node_groups.new("sample", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    new, link = group.nodes.new, group.links.new
    source, info, named = new("NodeGroupInput"), new("GeometryNodeObjectInfo"), new("GeometryNodeGetNamedGrid")
    sample, place = new("GeometryNodeSampleGrid"), new("GeometryNodeInputPosition")
    store, out = new("GeometryNodeStoreNamedAttribute"), new("NodeGroupOutput")
    info.transform_space = "RELATIVE"
    info.inputs["Object"].default_value = volume
    named.data_type = sample.data_type = "VECTOR" if is_vector else "FLOAT"
    named.inputs["Name"].default_value = grid
    try:
        sample.interpolation_mode = "NEAREST"
    except AttributeError:
        sample.inputs["Interpolation"].default_value = "Nearest Neighbor"
    store.data_type = "FLOAT_VECTOR" if is_vector else "FLOAT"
    store.inputs["Name"].default_value = "found"
    link(info.outputs["Geometry"], named.inputs["Volume"])
    link(named.outputs["Grid"], sample.inputs["Grid"])
    link(place.outputs["Position"], sample.inputs["Position"])
    link(source.outputs["Geometry"], store.inputs["Geometry"])
    link(sample.outputs["Value"], store.inputs["Value"])
    link(store.outputs["Geometry"], out.inputs["Geometry"])
    thing.modifiers.new("sample", "NODES").node_group = group
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    found = evaluated.data.attributes["found"].data
    values = numpy.zeros(len(found) * (3 if is_vector else 1), dtype=numpy.float32)
    found.foreach_get("vector" if is_vector else "value", values)
    return values.reshape(len(found), -1)


def main():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    lines = numpy.loadtxt(f"{FOLDER}/voxels.txt")
    h = float(numpy.float32(0.05))
    voxels, values = lines[:, :3], lines[:, 3:].astype(numpy.float32)
    volume = bpy.data.volumes.new("smoke")
    volume.filepath = f"{FOLDER}/float.vdb"
    assert volume.grids.load(), volume.grids.error_message
    kinds = {grid.name: grid.data_type for grid in volume.grids}
    assert kinds == {"density": "FLOAT", "temperature": "FLOAT", "v": "VECTOR_FLOAT"}, kinds
    # Cycles blurs by the grid of this name.
    volume.velocity_grid, volume.velocity_unit = "v", "SECOND"
    thing = bpy.data.objects.new("smoke", volume)
    thing.rotation_euler = (math.pi / 2.0, 0.0, 0.0)
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.view_layer.update()

    places = turned((voxels + 0.5) * h)
    for grid, part in [("density", slice(0, 1)), ("temperature", slice(1, 2)), ("v", slice(2, 5))]:
        found = sampled(thing, grid, grid == "v", places)
        error = numpy.abs(found - values[:, part]).max()
        assert error == 0.0, f"{grid}: off by {error}"
    # Not a voxel beside: the values there are others.
    beside = sampled(thing, "density", False, places + [h, 0.0, 0.0])
    assert numpy.abs(beside - values[:, :1]).max() > 0.0

    # Bounds in the world. Blender's are those of the tree's leaves of 8 cubed voxels.
    corners = numpy.array([list(c) for c in thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).bound_box])
    matrix = numpy.array(thing.matrix_world)
    world = corners @ matrix[:3, :3].T + matrix[:3, 3]
    low, high = world.min(axis=0), world.max(axis=0)
    leaves = numpy.floor(voxels / 8.0) * 8.0
    ends = turned(numpy.concatenate([leaves, leaves + 8.0]) * h)
    own_low, own_high = ends.min(axis=0), ends.max(axis=0)
    aside = numpy.maximum(numpy.abs(low - own_low), numpy.abs(high - own_high)).max()
    assert aside <= 1e-5 * h, f"bounds {low} to {high} instead of {own_low} to {own_high}"
    print(
        f"Blender {bpy.app.version_string}: {len(voxels)} voxels of density, temperature and v equal, max error 0, "
        f"bounds in the world within {aside / h:.1e} voxels"
    )


main()
