"""A scene by LuxCore: by_luxcore.py FOLDER SCENE SPP SEED THREADS PICTURE.npy prints {"seconds": …, "version": …}."""

import json
import math
import os
import pathlib
import sys
import time

import numpy
import pyluxcore
from scenes import CAMERA, DIMS, LOW, SCENES, VOXEL

# Of its ray marching [m]: a voxel, and less where that would be thick.
STEP = {"thick": 0.25 * VOXEL}


def properties(values):
    """Keys with one value or several."""
    all_of_them = pyluxcore.Properties()
    for key, value in values.items():
        all_of_them.Set(pyluxcore.Property(key, list(value) if isinstance(value, (list, tuple)) else value))
    return all_of_them


def ball_mesh(center, radius, around=256):
    """A ball of triangles."""
    rows = around // 2
    corners, faces = [], []
    for j in range(rows + 1):
        for i in range(around):
            polar, turn = math.pi * j / rows, 2.0 * math.pi * i / around
            v = (math.sin(polar) * math.cos(turn), math.cos(polar), math.sin(polar) * math.sin(turn))
            corners.append(tuple(c + radius * x for c, x in zip(center, v)))
    for j in range(rows):
        for i in range(around):
            a, b = j * around + i, j * around + (i + 1) % around
            faces += [(a, b, a + around)] if j > 0 else []
            faces += [(b, b + around, a + around)] if j + 1 < rows else []
    return corners, faces


def build(name, s, folder):
    scene, values = pyluxcore.Scene(), {}

    def mesh(shape, corners, faces, material):
        scene.DefineMesh(shape, corners, faces, None, None, None, None)
        values[f"scene.objects.{shape}.shape"] = shape
        values[f"scene.objects.{shape}.material"] = material

    width, height = s["size"]
    # The field of view is that of the longer side. Rows are mapped upside down between pixels too, which shifts the picture by one.
    half = math.tan(math.radians(0.5 * CAMERA["vertical_fov_deg"])) * width / height
    aspect, row = height / width, 2.0 / width
    values |= {
        "scene.camera.type": "perspective",
        "scene.camera.lookat.orig": CAMERA["position"],
        "scene.camera.lookat.target": CAMERA["look_at"],
        "scene.camera.up": [0.0, 1.0, 0.0],
        "scene.camera.fieldofview": 2.0 * math.degrees(math.atan(half)),
        "scene.camera.screenwindow": [-1.0, 1.0, -aspect - row, aspect - row],
        "scene.camera.cliphither": 0.01,
        "scene.camera.lensradius": 0.0,
        "scene.camera.autofocus.enable": False,
    }
    if s["sky"]:
        values |= {"scene.lights.sky.type": "constantinfinite", "scene.lights.sky.color": [s["sky"]] * 3}
    if s["sun"]:
        values |= {
            "scene.lights.sun.type": "sharpdistant",
            "scene.lights.sun.direction": s["sun"]["direction"],
            "scene.lights.sun.color": [s["sun"]["irradiance"]] * 3,
        }
    for i, (place, intensity) in enumerate(s["lamps"]):
        lamp = f"scene.lights.lamp{i}"
        # Of power, not of radiant intensity.
        color = [4.0 * math.pi * intensity] * 3
        values |= {f"{lamp}.type": "point", f"{lamp}.position": place, f"{lamp}.color": color}
    # Samples of its grids are at i/n.
    size = [n * VOXEL for n in DIMS]
    to_grid = [0.0] * 15 + [1.0]
    for a in range(3):
        to_grid[5 * a] = 1.0 / size[a]
        to_grid[12 + a] = -LOW[a] / size[a] - 0.5 / DIMS[a]
    voxels = numpy.fromfile(folder / "plume.raw", "<f4")
    texture = "scene.textures.density"
    values |= {f"{texture}.n{axis}": n for axis, n in zip("xyz", DIMS)}
    values |= {
        f"{texture}.type": "densitygrid",
        f"{texture}.wrap": "black",
        f"{texture}.storage": "float",
        f"{texture}.mapping.type": "globalmapping3d",
        f"{texture}.mapping.transformation": to_grid,
        f"{texture}.data": voxels.tolist(),
    }
    for key, factor in (("scattering", s["albedo"]), ("absorption", 1.0 - s["albedo"])):
        values |= {
            f"scene.textures.{key}.type": "scale",
            f"scene.textures.{key}.texture1": "density",
            f"scene.textures.{key}.texture2": s["extinction"] * factor,
            f"scene.volumes.air_of_smoke.{key}": key,
        }
    values |= {
        "scene.volumes.air_of_smoke.type": "heterogeneous",
        "scene.volumes.air_of_smoke.asymmetry": [s["g"]] * 3,
        "scene.volumes.air_of_smoke.steps.size": STEP.get(name, VOXEL),
        "scene.volumes.air_of_smoke.steps.maxcount": 1 << 20,
        "scene.volumes.air_of_smoke.multiscattering": True,
        "scene.materials.container.type": "null",
        "scene.materials.container.volume.interior": "air_of_smoke",
        "scene.materials.earth.type": "matte",
        "scene.materials.earth.kd": [s["ground"]] * 3,
    }
    # One empty voxel above the ground, so that two faces do not lie in one plane.
    low, high = [LOW[0], LOW[1] + VOXEL, LOW[2]], [a + b for a, b in zip(LOW, size)]
    corners = [tuple((high if i >> a & 1 else low)[a] for a in range(3)) for i in range(8)]
    quads = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    mesh("box", corners, [t for q in quads for t in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))], "container")
    mesh("plain", [(-20.0, 0.0, -20.0), (-20.0, 0.0, 20.0), (20.0, 0.0, 20.0), (20.0, 0.0, -20.0)], [(0, 1, 2), (0, 2, 3)], "earth")
    if s["ball"]:
        values |= {"scene.materials.stone.type": "matte", "scene.materials.stone.kd": [s["ball"]["reflectance"]] * 3}
        mesh("ball", *ball_mesh(s["ball"]["center"], s["ball"]["radius"]), "stone")
    scene.Parse(properties(values))
    return scene


def main():
    folder, name, spp, seed, threads, picture = sys.argv[1:]
    s = SCENES[name]
    pyluxcore.Init(lambda _: None)
    scene = build(name, s, pathlib.Path(folder))
    width, height = s["size"]
    settings = {
        "renderengine.type": "PATHCPU",
        "renderengine.seed": int(seed),
        "sampler.type": "SOBOL",
        "sampler.sobol.adaptive.strength": 0.0,
        "film.width": width,
        "film.height": height,
        "film.filter.type": "NONE",
        "film.imagepipelines.0.0.type": "NOP",
        "film.outputs.0.type": "RGB",
        "film.outputs.0.filename": "rgb.exr",
        "native.threads.count": int(threads),
        "path.pathdepth.total": 1024,
        "path.pathdepth.diffuse": 1024,
        "path.pathdepth.glossy": 1024,
        "path.pathdepth.specular": 1024,
        "path.russianroulette.depth": 64,
        "path.clamping.variance.maxvalue": 0.0,
        "lightstrategy.type": "UNIFORM",
        "batch.haltspp": int(spp),
    }
    session = pyluxcore.RenderSession(pyluxcore.RenderConfig(properties(settings), scene))
    session.Start()
    start = time.perf_counter()
    while not session.HasDone():
        time.sleep(0.01)
        session.UpdateStats()
    seconds = time.perf_counter() - start
    pixels = numpy.zeros(width * height * 3, dtype=numpy.float32)
    session.GetFilm().GetOutputFloat(pyluxcore.FilmOutputType.RGB, pixels, 0, True)
    session.Stop()
    # The bottom row comes first.
    numpy.save(picture, pixels.reshape(height, width, 3)[::-1].astype(float).mean(axis=-1))
    print(json.dumps({"seconds": seconds, "version": f"LuxCore {pyluxcore.Version()} (PATHCPU)"}), flush=True)
    # It may crash while Python takes its objects apart.
    os._exit(0)


main()
