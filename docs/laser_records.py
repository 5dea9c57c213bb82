#!/usr/bin/env python3
"""Laser-like records as others would hand them over: how many of them give their parameters?

    laser_records.py build/release/bin/orbid [--seeds 0 50] [--out FOLDER]

Lorenz's equations (those of a single-mode laser at resonance) make 2876 readings of gain * x^2 + offset, with errors of
0.4, rounded to counts of 8 bits. Every seed has a course of its own, and starts 20 % off in random directions. Prints a
line per record and what they come to; exit code 1 unless every estimate converges.
"""

import argparse
import json
import math
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TRUTH = {"s": 10.0, "r": 28.0, "b": 8.0 / 3.0, "gain": 0.6, "offset": 12.0}
STEP, COUNT, NOISE, NORMAL_95 = 0.02, 2876, 0.4, 1.959964


def slope(x):
    return (TRUTH["s"] * (x[1] - x[0]), TRUTH["r"] * x[0] - x[1] - x[0] * x[2], x[0] * x[1] - TRUTH["b"] * x[2])


def later(x, steps, h=0.002):
    """Runge and Kutta's method: errors stay far below those of the readings."""
    moved = lambda x, k, h: tuple(a + h * b for a, b in zip(x, k))
    for _ in range(steps):
        k1 = slope(x)
        k2 = slope(moved(x, k1, h / 2))
        k3 = slope(moved(x, k2, h / 2))
        k4 = slope(moved(x, k3, h))
        x = tuple(a + h / 6 * (p + 2 * q + 2 * r + s) for a, p, q, r, s in zip(x, k1, k2, k3, k4))
    return x


def written(seed, folder):
    """The record and its job; returns the job's path."""
    draw = random.Random(seed)
    x = later(tuple(a + draw.gauss(0, 1) for a in (1, 1.3, 20)), 20000)
    with open(folder / f"{seed}.csv", "w") as table:
        table.write("t,x\n")
        for i in range(COUNT):
            reading = TRUTH["gain"] * x[0] ** 2 + TRUTH["offset"] + draw.gauss(0, NOISE)
            table.write(f"{STEP * i:.2f},{min(max(round(reading), 0), 255)}\n")
            x = later(x, 10)
    job = {
        "model": {"equations": {"x": "s * (y - x)", "y": "r * x - y - x * z", "z": "x * y - b * z"},
                  "parameters": TRUTH},
        "seed": seed + 1,
        "data": {"name": "laser", "file": f"{seed}.csv", "kind": "samples", "columns": {"time": "t", "x": "x"},
                 "sensor": {"type": "function", "readings": {"x": "gain * x^2 + offset"}}, "observe": ["x"]},
        "estimate": {"parameters": {name: {"start": value * draw.choice((0.8, 1.2))} for name, value in TRUTH.items()},
                     "residuals": [{"type": "series", "interval": "auto"}]},
    }
    path = folder / f"{seed}.json"
    path.write_text(json.dumps(job, indent=1))
    return path


def deviations(result):
    """Of all parameters, in their own sds."""
    return {name: (one["value"] - TRUTH[name]) / one["sd"] for name, one in result["parameters"].items() if one["sd"]}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("orbid")
    parser.add_argument("--seeds", nargs=2, type=int, default=[0, 50], metavar=("FROM", "TO"))
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        return identified(options.orbid, options.seeds, options.out)
    with tempfile.TemporaryDirectory() as folder:
        return identified(options.orbid, options.seeds, Path(folder))


def identified(orbid, seeds, folder):
    """Makes the records of these seeds and runs their jobs; returns the exit code."""
    converged, far, inside, squares, count, seconds = 0, 0, 0, 0.0, 0, []
    for seed in range(*seeds):
        job = written(seed, folder)
        begin = time.monotonic()
        run = subprocess.run([orbid, "run", job, "--out", folder / str(seed), "--force", "--quiet", "--threads",
                              "1"], stdout=subprocess.DEVNULL)
        seconds.append(time.monotonic() - begin)
        stored = folder / str(seed) / "result.json"
        result = json.loads(stored.read_text()) if run.returncode in (0, 1) and stored.exists() else {}
        z = deviations(result) if run.returncode == 0 else {}
        print(f"{seed:4} {result.get('status', 'no result'):16} {seconds[-1]:6.1f} s ",
              "  ".join(f"{name} {value:5.1f}" for name, value in z.items()), flush=True)
        if run.returncode != 0:
            continue
        converged += 1
        far += any(abs(value) > 4 for value in z.values())
        inside += sum(abs(value) < NORMAL_95 for value in z.values())
        squares += sum(value**2 for value in z.values())
        count += len(z)
    seconds.sort()
    print(f"{converged} of {len(seconds)} converged, {far} of them beyond 4 sds; {inside} of {count} intervals hold; "
          f"rms z {math.sqrt(squares / max(count, 1)):.2f}; median {seconds[len(seconds) // 2]:.1f} s, "
          f"slowest {seconds[-1]:.1f} s")
    return 0 if converged == len(seconds) else 1


if __name__ == "__main__":
    sys.exit(main())
