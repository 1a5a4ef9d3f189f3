"""A scene by Mitsuba 3: by_mitsuba.py VARIANT FOLDER SCENE SPP SEED THREADS PICTURE.npy prints {"seconds": …, "version": …}."""

import json
import pathlib
import sys
import time

import drjit
import mitsuba as mi
import numpy
from scenes import CAMERA, DIMS, LOW, SCENES, VOXEL


def build(s, folder):
    T = mi.ScalarTransform4f
    grey = lambda v: {"type": "rgb", "value": [v, v, v]}
    diffuse = lambda v: {"type": "diffuse", "reflectance": grey(v)}
    high = [LOW[a] + DIMS[a] * VOXEL for a in range(3)]
    # One empty voxel above the ground, so that two faces do not lie in one plane.
    low = [LOW[0], LOW[1] + VOXEL, LOW[2]]
    center, half = [[0.5 * (b + sign * a) for a, b in zip(low, high)] for sign in (1.0, -1.0)]
    scene = {
        "type": "scene",
        # Its roulette lets at most 95 % of paths live, which is noisy in thick smoke.
        "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": 64 if s["albedo"] < 0.99 else 1000000},
        "sensor": {
            "type": "perspective",
            "fov": CAMERA["vertical_fov_deg"],
            "fov_axis": "y",
            "to_world": T().look_at(origin=CAMERA["position"], target=CAMERA["look_at"], up=[0, 1, 0]),
            "film": {
                "type": "hdrfilm",
                "width": s["size"][0],
                "height": s["size"][1],
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
            "sampler": {"type": "independent"},
        },
        "ground": {
            "type": "rectangle",
            "to_world": T().rotate([1, 0, 0], -90).scale([20, 20, 1]),
            "bsdf": diffuse(s["ground"]),
        },
        "smoke": {
            "type": "cube",
            "to_world": T().translate(center).scale(half),
            "bsdf": {"type": "null"},
            "interior": {
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
            },
        },
    }
    if s["sky"]:
        scene["sky"] = {"type": "constant", "radiance": grey(s["sky"])}
    if s["sun"]:
        sun = {"direction": s["sun"]["direction"], "irradiance": grey(s["sun"]["irradiance"])}
        scene["sun"] = {"type": "directional", **sun}
    for i, (place, intensity) in enumerate(s["lamps"]):
        scene[f"lamp{i}"] = {"type": "point", "position": place, "intensity": grey(intensity)}
    if s["ball"]:
        ball = {"center": s["ball"]["center"], "radius": s["ball"]["radius"]}
        scene["ball"] = {"type": "sphere", **ball, "bsdf": diffuse(s["ball"]["reflectance"])}
    return mi.load_dict(scene)


def main():
    variant, folder, name, spp, seed, threads, picture = sys.argv[1:]
    mi.set_variant(variant)
    drjit.set_thread_count(int(threads))
    scene = build(SCENES[name], pathlib.Path(folder))
    if variant.startswith("llvm"):
        # Compiling is no part of rendering.
        drjit.eval(mi.render(scene, spp=1, seed=1 << 20))
        drjit.sync_thread()
    start = time.perf_counter()
    image = numpy.array(mi.render(scene, spp=int(spp), seed=int(seed)))
    seconds = time.perf_counter() - start
    numpy.save(picture, image.astype(float).mean(axis=-1))
    print(json.dumps({"seconds": seconds, "version": f"Mitsuba {mi.__version__} ({variant}, volpath)"}))


main()
