"""A scene by Blender's Cycles: by_cycles.py FOLDER SCENE SPP SEED THREADS PICTURE.npy prints {"seconds": …, "version": …}.

The y axis points up here as elsewhere: nothing in Blender's renderer minds.
"""

import json
import math
import pathlib
import sys
import time

import bpy
import numpy
import OpenEXR
from mathutils import Matrix, Vector
from scenes import CAMERA, SCENES


def aimed(direction, place=(0.0, 0.0, 0.0)):
    """What looks, or shines, along a direction with the y axis up."""
    back = -Vector(direction).normalized()
    right = Vector((0.0, 1.0, 0.0)).cross(back).normalized()
    axes = Matrix((right, back.cross(right), back)).transposed().to_4x4()
    return Matrix.Translation(place) @ axes


def material(name, fill):
    """A material of nodes; `fill(nodes, links, output)` makes them."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes = made.node_tree.nodes
    nodes.clear()
    fill(nodes, made.node_tree.links, nodes.new("ShaderNodeOutputMaterial"))
    return made


def diffuse(name, albedo):
    def fill(nodes, links, output):
        node = nodes.new("ShaderNodeBsdfDiffuse")
        node.inputs["Color"].default_value = (albedo, albedo, albedo, 1.0)
        links.new(node.outputs["BSDF"], output.inputs["Surface"])

    return material(name, fill)


def smoke(s):
    def fill(nodes, links, output):
        node = nodes.new("ShaderNodeVolumePrincipled")
        for key, value in {
            "Color": (s["albedo"],) * 3 + (1.0,),
            "Absorption Color": (0.0, 0.0, 0.0, 1.0),
            "Density": s["extinction"],
            "Density Attribute": "density",
            "Anisotropy": s["g"],
            "Emission Strength": 0.0,
            "Blackbody Intensity": 0.0,
        }.items():
            node.inputs[key].default_value = value
        links.new(node.outputs["Volume"], output.inputs["Volume"])

    return material("smoke", fill)


def add(name, data, matrix=None):
    made = bpy.data.objects.new(name, data)
    if matrix:
        made.matrix_world = matrix
    bpy.context.scene.collection.objects.link(made)
    return made


def build(s, folder):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit = "VERTICAL"
    camera.angle = math.radians(CAMERA["vertical_fov_deg"])
    camera.clip_start, camera.clip_end = 0.01, 1000.0
    way = [b - a for a, b in zip(CAMERA["position"], CAMERA["look_at"])]
    scene.camera = add("camera", camera, aimed(way, CAMERA["position"]))

    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    background = next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND")
    background.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    background.inputs["Strength"].default_value = s["sky"]
    if s["sun"]:
        sun = bpy.data.lights.new("sun", "SUN")
        sun.energy, sun.angle = s["sun"]["irradiance"], 0.0
        add("sun", sun, aimed(s["sun"]["direction"]))
    for i, (place, intensity) in enumerate(s["lamps"]):
        lamp = bpy.data.lights.new(f"lamp{i}", "POINT")
        # Of a ball of radiance L and radius r Cycles takes 4 π² r² L for its power, π r² L being the intensity.
        lamp.energy, lamp.shadow_soft_size = 4.0 * math.pi * intensity, 0.0
        add(f"lamp{i}", lamp, Matrix.Translation(place))

    ground = bpy.data.meshes.new("ground")
    corners = [(-20.0, 0.0, -20.0), (-20.0, 0.0, 20.0), (20.0, 0.0, 20.0), (20.0, 0.0, -20.0)]
    ground.from_pydata(corners, [], [(0, 1, 2, 3)])
    ground.materials.append(diffuse("ground", s["ground"]))
    add("ground", ground)
    if s["ball"]:
        place, radius = s["ball"]["center"], s["ball"]["radius"]
        bpy.ops.mesh.primitive_uv_sphere_add(segments=256, ring_count=128, radius=radius, location=place)
        bpy.context.object.data.materials.append(diffuse("ball", s["ball"]["reflectance"]))
    volume = bpy.data.volumes.new("smoke")
    volume.filepath = str(folder / "plume.vdb")
    volume.grids.load()
    volume.render.precision, volume.render.clipping = "FULL", 0.0
    volume.materials.append(smoke(s))
    add("smoke", volume)
    return scene


def set_up(scene, s, seed, threads):
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = s["size"]
    scene.render.threads_mode, scene.render.threads = "FIXED", threads
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    cycles = scene.cycles
    # Nothing biased; roulette as late as elsewhere.
    for key, value in {
        "seed": seed,
        "use_adaptive_sampling": False,
        "use_denoising": False,
        "pixel_filter_type": "BOX",
        "filter_width": 1.0,
        "max_bounces": 1024,
        "diffuse_bounces": 1024,
        "volume_bounces": 1024,
        "transparent_max_bounces": 1024,
        "min_light_bounces": 64,
        "sample_clamp_direct": 0.0,
        "sample_clamp_indirect": 0.0,
        "blur_glossy": 0.0,
        "light_sampling_threshold": 0.0,
        "volume_biased": False,
        "volume_preview_step_rate": 1.0,
    }.items():
        if hasattr(cycles, key):
            setattr(cycles, key, value)


def seconds_of(scene, spp, path):
    scene.cycles.samples = spp
    scene.render.filepath = str(path)
    start = time.perf_counter()
    bpy.ops.render.render(write_still=True)
    return time.perf_counter() - start


def main():
    folder, name, spp, seed, threads, picture = sys.argv[1:]
    # Blender takes other paths for relative to a file of its own.
    folder, spp = pathlib.Path(folder).resolve(), max(int(spp), 2)
    scene = build(SCENES[name], folder)
    set_up(scene, SCENES[name], int(seed), int(threads))
    path = folder / "cycles.exr"
    # Each render makes its tree of densities again, which is loading: a picture of one path tells how long that takes.
    first = seconds_of(scene, 1, path)
    seconds = max(seconds_of(scene, spp, path) - first, 1e-3) * spp / (spp - 1)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        pixels = numpy.stack([channels[c].pixels for c in "RGB"], axis=-1)
    numpy.save(picture, pixels.astype(float).mean(axis=-1))
    print("\n" + json.dumps({"seconds": seconds, "version": f"Cycles of Blender {bpy.app.version_string}"}), flush=True)


main()
