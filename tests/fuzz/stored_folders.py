#!/usr/bin/env python3
"""Makes stored runs of each kind, and lets `stored_folders` change them.

    stored_folders.py PROGRAM DRIVER [--count N] [--seed N] [--jobs N]

Per run: one file is changed, and all commands that read the folder are called. See stored_folders.cpp.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

HENON = {"name": "henon", "parameters": {"a": 1.4, "b": 0.3}}
PENDULUM = {"name": "free_pendulum", "parameters": {"w0sq": 9.81, "c1": 0.2}}


def jobs(folder):
    """Job documents by name; each run takes a fraction of a second."""
    section = {"name": "run", "simulate": {"sections": 400, "initial": [[0.1, 0.1]], "transient": 100,
                                           "noise": {"x": 1e-4, "y": 1e-4}}}
    swing = {"name": "swing", "file": str(folder / "swing" / "series.csv"), "kind": "samples",
             "columns": {"segment": "segment", "time": "t", "phi": "phi", "phi_dot": "phi_dot"}, "observe": ["phi"]}
    branch = {"parameter": "a", "range": [0.2, 0.5]}
    return {
        "swing": {"model": PENDULUM, "seed": 1, "output": {"series": "csv"},
                  "data": {"name": "swing", "simulate": {"samples": {"step": 0.05, "count": 40}, "initial": [[1.0, 0.0]],
                                                         "noise": {"phi": 1e-3, "phi_dot": 1e-3}}}},
        "cycles": {"title": "cycles", "model": HENON, "seed": 1, "data": section,
                   "orbits": {"periods": [1, 2, 4]}, "periodic": {"orbits": [{"period": 1, "points": [[0.6, 0.2]]}]},
                   "estimate": {"parameters": {"a": {"start": 1.39}, "b": {"start": 0.31}},
                                "residuals": [{"type": "cycles"}]}},
        "series": {"title": "series", "model": PENDULUM, "seed": 1, "data": swing,
                   "estimate": {"parameters": {"w0sq": {"start": 9.5}, "c1": {"start": 0.1}},
                                "residuals": [{"type": "series"}], "profile": True,
                                "posterior": {"sample": {"draws": 20, "chains": 2, "warm_up": 20}}},
                   "output": {"series": "none"}},
        "branch": {"title": "branch", "model": {"name": "henon", "parameters": {"a": 0.3, "b": 0.3}},
                   "periodic": {"orbits": [{"period": 1, "points": [[0.8, 0.2]]}], "continuation": branch}},
    }


def made(program, folder):
    """The folders of all runs; the record of the pendulum is what the run on its series predicts."""
    folders = []
    for name, job in jobs(folder).items():
        file = folder / f"{name}.json"
        file.write_text(json.dumps(job))
        run = subprocess.run([program, "run", str(file), "--out", str(folder / name), "--quiet"], capture_output=True,
                             text=True)
        if run.returncode not in (0, 1):
            sys.exit(f"{name}: exit code {run.returncode}: {run.stderr}")
        folders.append(folder / name)
    (folder / "series" / "predict.txt").write_text(str(folder / "swing" / "series.csv"))
    return folders


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program")
    parser.add_argument("driver")
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    environment = {**os.environ, "ORBID_CXX": ""}  # equations are interpreted
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as temporary:
        folder = Path(temporary)
        folders = made(options.program, folder)
        share = -(-options.count // options.jobs)
        workers = [subprocess.Popen([options.driver, str(folder / f"work{i}"), str(share),
                                     str(options.seed + i * share), *map(str, folders)], env=environment)
                   for i in range(options.jobs)]
        codes = [worker.wait() for worker in workers]
    sys.exit(max(abs(code) for code in codes))


if __name__ == "__main__":
    main()
