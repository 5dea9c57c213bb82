#!/usr/bin/env python3
"""Tells the crank from its misprint, and with it how far model criticism can see.

    criticism.py encoder BIN_DIR [SEEDS]     5 000 sections read by the encoder, the series itself: decisive
    criticism.py cycles BIN_DIR [SEEDS]      cycles alone with errors of 5e-3 of the range: the models differ by less

Runs jobs with "criticism": data of the variant "crank", "crank_as_printed" as the alternative. SEEDS: how many, 20 if
left out. Prints one line per seed and the counts. Only the standard library.
"""
import json
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# An encoder of 4096 steps; the second reading 15.08 ms after the first.
ENCODER = {"type": "angle_difference", "angle": "phi", "rate": "phi_dot", "delay": 0.01508,
           "step": 2 * math.pi / 4096, "rounding": "nearest"}
# Errors of 5e-3 of the range: of a turn, and of the 29.3 rad/s that the velocities of the attractor span.
NOISE = {"phi": 5e-3 * 2 * math.pi, "phi_dot": 5e-3 * 29.3}


def job(seed, task):
    """Length and frictions; the truth is the start, for what is compared are the two optima."""
    simulate = {"sections": 5000 if task == "encoder" else 42754, "trajectories": 1, "transient": 20}
    data = {"name": "run1", "simulate": simulate}
    estimate = {"parameters": {"l": {"start": 0.317}, "k2": {"start": 4.85e-4}, "k3": {"start": 1.9e-4}},
                "criticism": {"variants": ["crank_as_printed"]}}
    parameters = {"k1": 0.0}
    whole = {"model": {"name": "parametric_pendulum", "variant": "crank", "parameters": parameters}, "seed": seed,
             "data": data, "estimate": estimate, "output": {"series": "none"}}
    if task == "encoder":
        data["sensor"] = ENCODER
        parameters["k1"] = 1e-3
        estimate["parameters"]["k1"] = {"start": 1e-3}
        estimate["residuals"] = [{"type": "series"}]
    else:
        simulate["noise"] = NOISE
        whole["orbits"] = {"periods": [1, 2, 3, 4, 5]}
        estimate["residuals"] = [{"type": "cycles"}]
    return whole


def compare(bin_dir, task, seed, folder):
    path = folder / f"{task}_{seed}.json"
    path.write_text(json.dumps(job(seed, task), indent=1))
    out = folder / f"{task}_{seed}"
    done = subprocess.run([str(bin_dir / "orbid"), "run", str(path), "--out", str(out), "--quiet"],
                          capture_output=True, text=True)
    if not (out / "result.json").exists():
        sys.exit(f"orbid run {path} ended with {done.returncode}:\n{done.stderr}")
    result = json.loads((out / "result.json").read_text())
    return result["status"], result.get("criticism")


def main():
    if len(sys.argv) < 3 or sys.argv[1] not in ("encoder", "cycles"):
        sys.exit(__doc__)
    task, bin_dir = sys.argv[1], Path(sys.argv[2]).resolve()
    seeds = range(1, 1 + (int(sys.argv[3]) if len(sys.argv) > 3 else 20))
    values = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            start = time.perf_counter()
            status, criticism = compare(bin_dir, task, seed, Path(folder))
            seconds = time.perf_counter() - start
            if criticism is None:
                print(f"seed {seed}: {status}: nothing was compared", flush=True)
                continue
            other = criticism["alternatives"][0]
            factor = other["ln_bayes_factor"]
            if factor["value"] is not None:
                values.append(factor["value"])
            shown = "-" if factor["value"] is None else f"{factor['value']:+.2f}"
            print(f"seed {seed}: {status}, other {other['status']}, ln B {shown} {factor['reason'] or ''} "
                  f"on {other['used']} blocks, large defects {criticism['large_defects']} and "
                  f"{other['large_defects']}, {seconds:.1f} s", flush=True)
    decided = sum(value > 5 for value in values)
    open_ = sum(abs(value) < 3 for value in values)
    print(f"{len(values)} of {len(seeds)} known; ln B > 5 in {decided}, |ln B| < 3 in {open_}")


if __name__ == "__main__":
    main()
