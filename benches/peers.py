"""curlsmoke beside other renderers: the same smoke, in alternation, at equal threads.

    make peers                                  # or, after `cargo build --release`:
    python3 benches/peers.py [--quick] [--record]

Others are installed into a virtual environment under out/, from PyPI: Mitsuba 3, Blender (Cycles) and LuxCore, as far as they have
packages for this Python; what will not install or run is named and left out. benches/peer_renderers/baseline.c is a plain path
tracer in C, compiled here: what "times better than brute force" means can be looked up in it.

Every renderer makes pictures of different seeds, in turns. Figures are of rendering alone, without loading and compiling. The
variance of a pixel, from the spread over the seeds, is taken over the square of its mean (plus a hundredth of the mean square of all), on
average over the pixels that see smoke, and without the hundredth of them that has most: single bright paths would be all that is
seen. Time times variance does not depend on the number of paths; it is what a renderer is worth. Blocks of 16 by 16 pixels are
held against those of the mean of our pictures, so that what is compared is the same light.

With --record the table and the plot in docs/performance.md are made anew. Needs an idle machine, and half an hour.
"""

import argparse
import importlib.util
import json
import math
import os
import pathlib
import subprocess
import sys
import time

from reporting import ROOT, log_panels, processor, run, write_section

OUT = ROOT / "out/peers"
HERE = ROOT / "benches/peer_renderers"
PACKAGES = {
    "mitsuba": ["mitsuba==3.9.1"],
    "cycles": ["bpy==5.2.3" if sys.version_info >= (3, 13) else "bpy==5.0.1"],
    "luxcore": ["pyluxcore==2.11.2"],
}
MODULES = {"mitsuba": "mitsuba", "cycles": "bpy", "luxcore": "pyluxcore"}
NAMES = {"ours": "curlsmoke", "baseline": "baseline.c", "mitsuba": "Mitsuba 3", "cycles": "Cycles", "luxcore": "LuxCore"}
# Paths a pixel of the longest pictures; shorter ones have a quarter and a sixteenth. Such that none takes minutes.
SPP = {
    "plume": {"ours": 32, "baseline": 16, "mitsuba": 16, "cycles": 16, "luxcore": 16},
    "thick": {"ours": 32, "baseline": 16, "mitsuba": 2, "cycles": 16, "luxcore": 2},
    "lamps": {"ours": 64, "baseline": 64, "mitsuba": 64, "cycles": 16, "luxcore": 16},
}
BLOCK = 16
BEGIN, END = "<!-- peers: begin, written by benches/peers.py -->", "<!-- peers: end -->"


def inside_venv():
    """Goes on within the virtual environment, made where it is not."""
    python = OUT / "venv/bin/python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", OUT / "venv"], check=True)
    if pathlib.Path(sys.prefix).resolve() != (OUT / "venv").resolve():
        if subprocess.run([python, "-c", "import numpy, OpenEXR"], capture_output=True).returncode:
            subprocess.run([python, "-m", "pip", "install", "-q", "numpy", "OpenEXR"], check=True)
        os.execv(python, [str(python), *sys.argv])


def install(name):
    """Whether another renderer is there, or could be installed."""
    if importlib.util.find_spec(MODULES[name]):
        return True
    pip = [sys.executable, "-m", "pip", "install", "-q", *PACKAGES[name]]
    done = subprocess.run(pip, capture_output=True, text=True)
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        print(f"left out: {NAMES[name]}, {PACKAGES[name][0]} does not install: {lines[-1] if lines else ''}")
    return done.returncode == 0


class Ours:
    def __init__(self, args):
        self.args = args
        self.version = run([args.binary, "--version"])[0].strip()

    def render(self, name, scene, spp, seed, picture):
        import numpy

        from scenes import scene_of_ours

        (OUT / "scene.yaml").write_text(scene_of_ours(scene, spp))
        exr = picture.with_suffix(".exr")
        command = [self.args.binary, "render", OUT / "scene.yaml", "--seed", seed, "--threads", self.args.threads, "-o", exr]
        _, peak = run(command)
        numpy.save(picture, read_exr(exr, "RGB").mean(axis=-1))
        record = json.loads(exr.with_suffix(".json").read_text())
        return record["seconds"]["render"], peak


class Baseline:
    def __init__(self, args):
        self.args = args
        self.program = OUT / "baseline"
        source = HERE / "baseline.c"
        run(["cc", "-O3", "-march=native", "-fopenmp", "-o", self.program, source, "-lm"])
        self.version = f"baseline.c, {len(source.read_text().splitlines())} lines of C"

    def render(self, name, scene, spp, seed, picture):
        import numpy

        from scenes import scene_of_baseline

        (OUT / "baseline.txt").write_text(scene_of_baseline(scene))
        command = [self.program, OUT / "baseline.txt", OUT / "plume.raw", spp, seed, OUT / "baseline.pixels"]
        out, peak = run(command, {"OMP_NUM_THREADS": str(self.args.threads)})
        pixels = numpy.fromfile(OUT / "baseline.pixels", "<f4").reshape(scene["size"][::-1])
        numpy.save(picture, pixels.astype(float))
        return float(out), peak


class Other:
    def __init__(self, args, kind):
        self.args, self.kind, self.version = args, kind, NAMES[kind]
        self.command = [sys.executable, HERE / f"by_{kind}.py"]
        if kind == "mitsuba":
            self.command.append(args.variant or self.variant())

    def variant(self):
        """Vectorised and compiled where LLVM is new enough, which shows only when it ends the process."""
        try:
            run([*self.command, "llvm_ad_rgb", OUT, "thick", 1, 1, self.args.threads, OUT / "trial.npy"])
            return "llvm_ad_rgb"
        except RuntimeError as problem:
            print(f"Mitsuba traces one path at a time: its compiled variants need a newer LLVM ({problem})")
            return "scalar_rgb"

    def render(self, name, scene, spp, seed, picture):
        out, peak = run([*self.command, OUT, name, spp, seed, self.args.threads, picture])
        said = json.loads(out.strip().splitlines()[-1])
        self.version = said["version"]
        return said["seconds"], peak


def read_exr(path, channels):
    import numpy
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        return numpy.stack([file.channels()[c].pixels for c in channels], axis=-1).astype(float)


def smoke_mask(args, scene):
    """The pixels that see smoke."""
    from scenes import scene_of_ours

    (OUT / "scene.yaml").write_text(scene_of_ours(scene, 1))
    exr = OUT / "mask.exr"
    run([args.binary, "render", OUT / "scene.yaml", "--set", "output.aovs=[transmittance]", "-o", exr])
    return read_exr(exr, ["transmittance"])[..., 0] < 0.99


def blocks(picture):
    h, w = picture.shape
    return picture[: h // BLOCK * BLOCK, : w // BLOCK * BLOCK].reshape(h // BLOCK, BLOCK, w // BLOCK, BLOCK).mean(axis=(1, 3))


def compare(args, name, scene, renderers):
    """Pictures of a scene in turns: of each renderer and number of paths the seconds, the pictures and the memory."""
    import numpy

    runs = {}
    for seed in range(1, args.rounds + 1):
        for kind, renderer in list(renderers.items()):
            # Of Cycles a path a pixel tells how long loading takes, so that there must be more.
            least = 2 if kind == "cycles" else 1
            most = max(SPP[name][kind] // (8 if args.quick else 1), least)
            for spp in sorted({most} if args.quick else {max(most // 16, least), max(most // 4, least), most}):
                picture = OUT / f"{name}-{kind}-{spp}-{seed}.npy"
                try:
                    seconds, peak = renderer.render(name, scene, spp, seed, picture)
                except (RuntimeError, ValueError, OSError) as problem:
                    print(f"left out: {NAMES[kind]} does not render `{name}`: {problem}")
                    del renderers[kind]
                    break
                print(f"{name} {kind} {spp} spp, seed {seed}: {seconds:.2f} s, {peak:.0f} MiB", flush=True)
                entry = runs.setdefault(kind, {}).setdefault(spp, {"seconds": [], "peak": 0.0, "pictures": []})
                entry["seconds"].append(seconds)
                entry["peak"] = max(entry["peak"], peak)
                entry["pictures"].append(numpy.load(picture))
    return {kind: by_spp for kind, by_spp in runs.items() if kind in renderers}


def variance(pictures, reference, mask):
    """Mean relative variance of a picture, without the hundredth of pixels that has most; and with it."""
    import numpy

    relative = numpy.var(pictures, axis=0, ddof=1) / (reference**2 + 0.01 * (reference[mask] ** 2).mean())
    pixels = numpy.sort(relative[mask])
    return pixels[: len(pixels) * 99 // 100].mean(), pixels.mean()


def judge(name, scene, runs, mask):
    """Rows of the table, and points of the plot."""
    import numpy

    ours = runs["ours"]
    reference = sum(spp * numpy.mean(e["pictures"], axis=0) for spp, e in ours.items()) / sum(ours)
    rows, curves, base = [], {}, None
    pixels = scene["size"][0] * scene["size"][1]
    for kind, by_spp in runs.items():
        points = []
        for spp, entry in sorted(by_spp.items()):
            trimmed, plain = variance(entry["pictures"], reference, mask)
            points.append((float(numpy.median(entry["seconds"])), math.sqrt(trimmed)))
        curves[kind] = points
        # The last entry is that of most paths.
        seconds, peak = numpy.median(entry["seconds"]), max(e["peak"] for e in by_spp.values())
        worth = seconds * trimmed
        base = worth if kind == "ours" else base
        own, other = (numpy.array([blocks(p) for p in e["pictures"]]) for e in (entry, ours[max(ours)]))
        # Blocks without light have no relative difference.
        mean = numpy.maximum(blocks(reference), 0.01 * reference.mean())
        share = (own.mean(axis=0) - blocks(reference)) / mean
        error = numpy.sqrt(own.var(axis=0, ddof=1) / len(own) + other.var(axis=0, ddof=1) / len(other))
        error = numpy.hypot(error / mean, 2e-4)
        agreement = "" if kind == "ours" else (
            f"{100.0 * (own.mean() / blocks(reference).mean() - 1.0):+.2f} %, {100.0 * numpy.sqrt((share**2).mean()):.2f} % "
            f"({100.0 * numpy.sqrt((error**2).mean()):.2f} %)"
        )  # fmt: skip
        rows.append(
            f"| `{name}` | {NAMES[kind]} | {spp} | {seconds:.2f} | {pixels * spp / seconds / 1e3:,.0f} | {trimmed * spp:.3g} | "
            f"{worth:.3g} | {worth / base:.2f} | {seconds * plain:.3g} | {peak:.0f} | {agreement} |"
        )
    return rows, curves


COLORS = {"ours": "#c0392b", "baseline": "#7f8c8d", "mitsuba": "#2471a3", "cycles": "#d68910", "luxcore": "#229954"}


def plot(all_curves):
    """Error against time, both logarithmic, a panel for each scene."""
    return log_panels({f"{name}: relative error against seconds": c for name, c in all_curves.items()}, NAMES, COLORS)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/curlsmoke", help="our program")
    parser.add_argument("--peers", default="baseline,mitsuba,cycles,luxcore", help="whom to compare with")
    parser.add_argument("--scenes", default="plume,thick,lamps")
    parser.add_argument("--variant", help="of Mitsuba (default llvm_ad_rgb, or scalar_rgb where LLVM is too old)")
    parser.add_argument("--rounds", type=int, help="pictures of each, two or more (default 5)")
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--quick", action="store_true", help="a trial: an eighth of the paths, two rounds")
    parser.add_argument("--record", action="store_true", help="write docs/performance.md and its plot")
    args = parser.parse_args()
    args.rounds = max(args.rounds or (2 if args.quick else 5), 2)
    args.binary = args.binary.resolve()
    OUT.mkdir(parents=True, exist_ok=True)
    inside_venv()
    # Before numpy is loaded, of which the others may bring another version.
    asked = args.peers.split(",")
    installed = [kind for kind in PACKAGES if kind in asked and install(kind)]
    sys.path.insert(0, str(HERE))
    from scenes import SCENES, density, raw, vdb, vol

    d = density()
    for file, content in (("plume.vdb", vdb(d)), ("plume.vol", vol(d)), ("plume.raw", raw(d))):
        (OUT / file).write_bytes(content)
    renderers = {"ours": Ours(args)}
    if "baseline" in asked:
        renderers["baseline"] = Baseline(args)
    renderers.update({kind: Other(args, kind) for kind in installed})
    rows, curves, seen = [], {}, {}
    for name in args.scenes.split(","):
        there = dict(renderers)
        runs = compare(args, name, SCENES[name], there)
        seen.update({kind: renderers[kind].version for kind in runs})
        scene_rows, curves[name] = judge(name, SCENES[name], runs, smoke_mask(args, SCENES[name]))
        rows += scene_rows
    text = report(args, SCENES, rows, seen, d)
    print(text)
    if args.record:
        (ROOT / "docs/performance").mkdir(exist_ok=True)
        (ROOT / "docs/performance/peers.svg").write_text(plot(curves))
        write_section(ROOT / "docs/performance.md", BEGIN, END, text)
    else:
        (OUT / "peers.svg").write_text(plot(curves))


def report(args, scenes, rows, seen, d):
    what = "\n".join(
        f"- `{name}`: {scenes[name]['what']}; {scenes[name]['size'][0]} × {scenes[name]['size'][1]} pixels."
        for name in args.scenes.split(",")
    )
    return f"""
### Light, ours and others'

`make peers` renders the same voxels ({" × ".join(map(str, d.shape))}, {100.0 * (d == 0).mean():.0f} % of them empty) with others in turns, {args.rounds} pictures of each with
{args.threads} threads ({processor()}, {time.strftime("%Y-%m-%d")}): {"; ".join(seen.values())}.

{what}

`baseline.c` is the plain way: a path at a time, one number at a time, upper bounds for cells of 4³ voxels. Seconds are medians of
rendering alone. Variance is that of one path a pixel, relative to the mean, where smoke is seen, without the hundredth of pixels
that has most of it; time × variance [s] is what counts, less is better, and its ratio to ours; then the same of all pixels. Agreement: the
whole picture against ours, and the root mean square over blocks of {BLOCK} × {BLOCK} pixels (what noise alone would make).

| scene | renderer | paths a pixel | seconds | thousand paths/s | variance | time × variance | × ours | of all pixels | MiB | agreement |
|---|---|---|---|---|---|---|---|---|---|---|
{chr(10).join(rows)}

![Error against time](performance/peers.svg)
*Root of the variance against seconds of rendering.*
"""


if __name__ == "__main__":
    main()
