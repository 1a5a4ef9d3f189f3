"""Midpoint steps through the curl of four octaves of Perlin noise by central differences, with the SIMD library
FastNoiseSIMD (`pip install numpy pyfastnoisesimd`): what `cargo bench --bench flow` is compared with.

    python3 benches/fastnoise.py
"""

import time

import numpy
import pyfastnoisesimd as fns

COUNT = 1 << 14
STEP = 1e-3


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


def main():
    for threads in (1, 2):
        ns = [noise(seed, threads) for seed in (1, 2, 3)]
        p = numpy.random.default_rng(1).uniform(-1.0, 1.0, (3, COUNT)).astype(numpy.float32)
        best = float("inf")
        for _ in range(12):
            start = time.perf_counter()
            middle = p + 0.5 / 24.0 * curl(ns, p)
            p = (p + curl(ns, middle.astype(numpy.float32)) / 24.0).astype(numpy.float32)
            best = min(best, time.perf_counter() - start)
        print(f"{threads} threads: {COUNT / best / 1e6:.2f} million particle steps a second")


if __name__ == "__main__":
    main()
