"""What a frame costs: processor time and memory against particles, voxels, pixels, paths a pixel, optical depth and threads.

    make costs                                  # or, after `cargo build --release`:
    python3 benches/costs.py [--quick] [--record]

A ball of smoke (radius 1 m, density 1 on average, stirred for half a second by three octaves of noise) on a floor in a sun and an even sky is
rendered again and again, with one quantity changed at a time from the middle of its range. Each frame is made twice, whole and as a
picture of next to no pixels: the time of all processors that the second takes is what the smoke costs (advection and grid, and the program's
start), and the difference is what light costs. Other programs change such times little, but they do: figures are medians over rounds that go
through all runs in turns. Exponents are slopes of straight lines through the logarithms, of the upper half of each range, where constant
costs no longer show.

With --record the section and the plot in docs/performance.md are made anew. Needs nothing but Python; a quarter of an hour of an idle machine.
"""

import argparse
import json
import math
import os
import pathlib
import statistics
import time

from reporting import ROOT, log_panels, processor, run_timed, write_section

OUT = ROOT / "out/costs"
BEGIN, END = "<!-- costs: begin, written by benches/costs.py -->", "<!-- costs: end -->"
# One is changed at a time, the others stay at these. `depth` is the optical depth across the ball.
BASE = {"particles": 300_000, "voxel": 0.02, "pixels": 36_864, "spp": 16, "depth": 20.0, "threads": os.cpu_count()}
SWEEPS = {
    "particles": [30_000, 100_000, 300_000, 1_000_000, 3_000_000],
    "voxel": [0.04, 0.028, 0.02, 0.014, 0.01, 0.007],
    "pixels": [9_216, 36_864, 147_456, 589_824],
    "spp": [4, 16, 64, 256],
    "depth": [1.25, 5.0, 20.0, 80.0, 320.0, 1280.0],
    "threads": [n for n in (1, 2, 4, 8, 16, 32, 64) if n <= os.cpu_count()],
}
QUICK = {
    "particles": [30_000, 100_000, 300_000],
    "voxel": [0.04, 0.02, 0.014],
    "pixels": [2_304, 9_216, 36_864],
    "spp": [4, 16, 64],
    "depth": [1.25, 20.0, 320.0],
}
TIMES = ("smoke", "light")
NAMES = {"smoke": "smoke [s]", "light": "light [s]", "memory": "memory [100 MiB]"}
COLORS = {"smoke": "#2471a3", "light": "#c0392b", "memory": "#7d3c98"}
LABELS = {
    "particles": "particles",
    "voxel": "voxels that hold density",
    "pixels": "pixels",
    "spp": "paths a pixel",
    "depth": "optical depth across the smoke",
    "threads": "threads",
}


def scene(v):
    """The ball as YAML (which JSON is)."""
    height = math.isqrt(round(v["pixels"] * 9 / 16))
    grey = lambda g: [g, g, g]
    return {
        "version": 1,
        "frames": {"first": 1, "last": 13, "fps": 24},
        "camera": {"position": [0.0, 0.6, 5.0], "look_at": [0.0, 0.0, 0.0], "vertical_fov_deg": 34.0},
        "film": {"resolution": [round(v["pixels"] / height), height], "spp": v["spp"]},
        "render": {"max_bounces": 100_000, "memory_limit_gib": 16},
        "shapes": {"floor": {"plane": {"point": [0.0, -1.3, 0.0]}, "material": {"diffuse": {"reflectance": grey(0.3)}}}},
        "flow": {"potentials": [{"noise": {"length_scale": 0.8, "speed": 0.3, "octaves": 3}}]},
        "smoke": {
            "emitters": [
                {"sphere": {"center": grey(0.0), "radius": 1.0}, "count": v["particles"], "mass": 4.0 / 3.0 * math.pi, "lifetime": 100.0}
            ],
            "advect": {"integrator": "rk2"},
            "grid": {"voxel_size": v["voxel"], "kernel_radius": max(0.04, 1.5 * v["voxel"])},
            "medium": {"extinction": v["depth"] / 2.0, "albedo": grey(0.9)},
        },
        "lights": [{"sun": {"direction": [0.6, -0.7, -0.4], "irradiance": grey(3.0)}}, {"environment": {"radiance": grey(0.5)}}],
    }


def measure(args, v):
    """Figures of a frame."""

    def render(v):
        (OUT / "scene.yaml").write_text(json.dumps(scene(v), indent=2))
        exr = OUT / "ball.####.exr"
        command = [args.binary, "render", OUT / "scene.yaml", "--frames", 13, "--threads", v["threads"], "-o", exr]
        seconds = run_timed(command)[2]
        return seconds, json.loads((OUT / "ball.0013.json").read_text())

    smoke, _ = render({**v, "pixels": 36, "spp": 1})
    all_of_it, record = render(v)
    return {
        "smoke": smoke,
        "light": max(all_of_it - smoke, 1e-3),
        # In hundreds of mebibytes, so that it shares an axis with seconds.
        "memory": record["memory_peak"] / 2.0**20 / 100.0,
        "voxels": record["grid"]["active_voxels"],
        "grid_mib": record["grid"]["bytes"] / 2.0**20,
    }


def slope(points):
    """Exponent over the upper half of a range, by least squares."""
    points = [(math.log(x), math.log(y)) for x, y in points[(len(points) - 1) // 2 :]]
    mx, my = (statistics.fmean(p[a] for p in points) for a in range(2))
    spread = sum((x - mx) ** 2 for x, _ in points)
    return sum((x - mx) * (y - my) for x, y in points) / spread if spread else float("nan")


def report(args, base, sweeps, curves, figures):
    rows = []
    for name in sweeps:
        first, last = (figures[name, sweeps[name][i]] for i in (0, -1))
        x0, x1 = (curves[name]["smoke"][i][0] for i in (0, -1))
        cells = [f"{first[t]:.2f} to {last[t]:.2f} s ({slope(curves[name][t]):.2f})" for t in TIMES]
        memory = f"{100 * first['memory']:.0f} to {100 * last['memory']:.0f} MiB ({slope(curves[name]['memory']):.2f})"
        rows.append(f"| {LABELS[name]} | {x0:,.4g} to {x1:,.4g} | {' | '.join(cells)} | {memory} |")
    most = figures["particles", sweeps["particles"][-1]]
    least = figures["particles", sweeps["particles"][0]]
    more = sweeps["particles"][-1] - sweeps["particles"][0]
    of_particle = 100.0 * (most["memory"] - least["memory"]) * 2**20 / more
    fine, coarse = figures["voxel", sweeps["voxel"][-1]], figures["voxel", sweeps["voxel"][0]]
    of_voxel = 100.0 * (fine["memory"] - coarse["memory"]) * 2**20 / (fine["voxels"] - coarse["voxels"])
    stored = (fine["grid_mib"] - coarse["grid_mib"]) * 2**20 / (fine["voxels"] - coarse["voxels"])
    around = figures["threads", sweeps["threads"][-1]]
    rounds = "once" if args.rounds == 1 else f"{args.rounds} rounds in turns"
    others = ", ".join(f"{LABELS[k]} {v:,}" for k, v in base.items() if k != "voxel")
    return f"""
### What a frame costs

`make costs` renders a ball of smoke with one quantity changed at a time, {rounds} ({processor()}, {time.strftime("%Y-%m-%d")}).
All else stays at {others}, voxels of {base["voxel"]} m (so that {around["voxels"]:,.0f} hold density). In brackets: the
exponent, of the upper half of the range. Times are those of all processors together: over threads they would stay the same if nothing
were lost by sharing work.

| changed | range | smoke | light | memory |
|---|---|---|---|---|
{chr(10).join(rows)}

A particle takes {of_particle:.0f} bytes of memory, a voxel that holds density {of_voxel:.1f} when the frame has most of it, of which {stored:.1f}
are what is stored of it (bricks are never quite full), and the rest is there while the grid is made.

![Time and memory](performance/costs.svg)
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/curlsmoke", help="our program")
    parser.add_argument("--rounds", type=int, help="of each run (default 3)")
    parser.add_argument("--quick", action="store_true", help="a trial: three small runs of each, one round")
    parser.add_argument("--record", action="store_true", help="write docs/performance.md and its plot")
    args = parser.parse_args()
    args.rounds = max(args.rounds or (1 if args.quick else 3), 1)
    args.binary = args.binary.resolve()
    OUT.mkdir(parents=True, exist_ok=True)
    sweeps = {**SWEEPS, **QUICK} if args.quick else SWEEPS
    base = {**BASE, **{name: values[1] for name, values in QUICK.items()}} if args.quick else BASE
    runs = {}
    for turn in range(args.rounds):
        for name, values in sweeps.items():
            for value in values:
                found = measure(args, {**base, name: value})
                runs.setdefault((name, value), []).append(found)
                shown = ", ".join(f"{k} {found[k]:.2f} s" for k in TIMES)
                print(f"{turn + 1} of {args.rounds}, {name} {value:g}: {shown}, {100 * found['memory']:.0f} MiB", flush=True)
    figures = {key: {k: statistics.median(r[k] for r in many) for k in many[0]} for key, many in runs.items()}
    curves = {}
    for name, values in sweeps.items():
        x = lambda value: figures[name, value]["voxels"] if name == "voxel" else value
        curves[name] = {k: [(x(v), figures[name, v][k]) for v in values] for k in NAMES}
    text = report(args, base, sweeps, curves, figures)
    print(text)
    svg = log_panels({LABELS[name]: c for name, c in curves.items()}, NAMES, COLORS, columns=3)
    if args.record:
        (ROOT / "docs/performance").mkdir(exist_ok=True)
        (ROOT / "docs/performance/costs.svg").write_text(svg)
        write_section(ROOT / "docs/performance.md", BEGIN, END, text)
    else:
        (OUT / "costs.svg").write_text(svg)


if __name__ == "__main__":
    main()
