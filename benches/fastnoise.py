"""Midpoint steps through the curl of four octaves of noise: ours, and Perlin noise by central differences with the SIMD
library FastNoiseSIMD (`pip install numpy pyfastnoisesimd`), in turns, since processors change their clock.

    python3 benches/fastnoise.py
"""

import pathlib
import statistics
import subprocess
import time

import numpy
import pyfastnoisesimd as fns

COUNT = 1 << 14
STEP = 1e-3
ROUNDS = 12
ROOT = pathlib.Path(__file__).resolve().parent.parent


def noise(seed, threads):
    n = fns.Noise(seed=seed, numWorkers=threads)
    n.noiseType = fns.NoiseType.PerlinFractal
    n.frequency = 2.0
    n.fractal.octaves = 4
    n.fractal.lacunarity = 2.0
    n.fractal.gain = 0.4
    return n


def slope(n, p, axis):
    """∂n/∂axis at points p (3, count)."""
    values = []
    for sign in (-1.0, 1.0):
        coords = fns.empty_coords(p.shape[1])
        coords[:, : p.shape[1]] = p
        coords[axis, : p.shape[1]] += sign * STEP
        values.append(n.genFromCoords(coords)[: p.shape[1]])
    return (values[1] - values[0]) / (2.0 * STEP)


def curl(ns, p):
    return numpy.stack(
        [
            slope(ns[2], p, 1) - slope(ns[1], p, 2),
            slope(ns[0], p, 2) - slope(ns[2], p, 0),
            slope(ns[1], p, 0) - slope(ns[0], p, 1),
        ]
    )


def theirs(threads):
    """Million steps a second: the median of a second."""
    ns = [noise(seed, threads) for seed in (1, 2, 3)]
    p = numpy.random.default_rng(1).uniform(-1.0, 1.0, (3, COUNT)).astype(numpy.float32)
    times = []
    end = time.perf_counter() + 1.0
    while time.perf_counter() < end:
        start = time.perf_counter()
        middle = p + 0.5 / 24.0 * curl(ns, p)
        p = (p + curl(ns, middle.astype(numpy.float32)) / 24.0).astype(numpy.float32)
        times.append(time.perf_counter() - start)
    return COUNT / statistics.median(times) / 1e6


def ours(threads):
    """Million steps a second: the median of a second."""
    command = ["cargo", "bench", "-q", "--bench", "kernels", "--", "wall", "open midpoint step", str(threads)]
    run = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return 1e3 / float(run.stdout)


def main():
    for threads in (1, 2):
        pairs = [(theirs(threads), ours(threads)) for _ in range(ROUNDS)]
        ratio = statistics.quantiles([b / a for a, b in pairs], n=4)
        a, b = (statistics.median(x) for x in zip(*pairs))
        print(f"{threads} threads: theirs {a:.2f}, ours {b:.2f} million particle steps a second;", end=" ")
        print(f"ratio {ratio[1]:.2f}, quartiles {ratio[0]:.2f} and {ratio[2]:.2f}")


if __name__ == "__main__":
    main()
