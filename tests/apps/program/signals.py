#!/usr/bin/env python3
"""Interrupts runs of the program at random moments: how long each takes to end, and what it leaves.

    signals.py PROGRAM SOURCE [--whole] [--seed N]

Every run must end by itself with exit code 130 (or 0, if it was done before) within a limit, and every file of its
folder must be whole. --whole: many moments of longer jobs, and the limit of 0.3 s that an idle machine keeps.
"""

import argparse
import csv
import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from xml.etree import ElementTree

HENON = {"name": "henon", "parameters": {"a": 1.4, "b": 0.3}}


def jobs(source, whole):
    """Job documents by name; each takes seconds at least."""
    size = 4 if whole else 1
    henon = {"name": "run", "simulate": {"sections": 400000 * size, "initial": [[0.1, 0.1]], "transient": 100}}
    noisy = {"name": "run", "simulate": {**henon["simulate"], "sections": 6000 * size,
                                         "noise": {"x": 1e-3, "y": 1e-3}}}
    periods = {"periods": [1, 2, 3, 4, 5, 6, 7, 8]}
    configs = {name: json_with_comments(source / "configs" / f"{name}.json") for name in ("hare_lynx",)}
    hare = configs["hare_lynx"]
    hare["data"]["file"] = str(source / "configs" / hare["data"]["file"])
    hare["estimate"]["multi_start"] = {"starts": 20}
    hare["estimate"]["posterior"]["sample"] = {"draws": 5000, "chains": 2, "warm_up": 500}
    return {
        "simulation": {"model": HENON, "seed": 1, "data": {**henon, "simulate": {**henon["simulate"],
                                                                                 "sections": 20000000}}},
        "search": {"model": HENON, "seed": 1, "data": henon, "orbits": {**periods, "invariants": True}},
        "noisy search": {"model": HENON, "seed": 1, "data": noisy, "orbits": {**periods, "method": "patch_map"}},
        "orbits of a model": {"model": HENON, "seed": 1, "periodic": {"search": {"periods": list(range(1, 13))}}},
        "estimate": hare,
    }


def json_with_comments(path):
    lines = []
    for line in path.read_text().splitlines():
        quotes = 0
        for at, character in enumerate(line):
            quotes += character == '"'
            if line.startswith("//", at) and quotes % 2 == 0:
                line = line[:at]
                break
        lines.append(line)
    return json.loads("\n".join(lines))


def check_whole(folder):
    """Raises for a file that is cut off or left over."""
    for path in folder.rglob("*"):
        if path.is_dir():
            continue
        if path.suffix == ".json":
            json.loads(path.read_text())
        elif path.suffix == ".csv":
            with path.open(newline="") as file:
                widths = {len(row) for row in csv.reader(file) if row and not row[0].startswith("#")}
            if len(widths) > 1 or not path.read_text().endswith("\n"):
                raise ValueError(f"{path}: rows of {sorted(widths)} cells")
        elif path.suffix == ".svg":
            ElementTree.parse(path)
        elif path.suffix == ".h5":
            if path.read_bytes()[:8] != b"\x89HDF\r\n\x1a\n":
                raise ValueError(f"{path}: no HDF5 file")
        elif path.suffix == ".html":
            if "</html>" not in path.read_text():
                raise ValueError(f"{path}: cut off")
        elif path.name not in ("log.txt", "checkpoint.bin"):
            raise ValueError(f"{path}: left over")


def interrupted_after(program, job, out, delay):
    """Seconds from the signal to the end; None when the run had ended before."""
    run = subprocess.Popen([program, "run", str(job), "--out", str(out), "--force"], stdout=subprocess.PIPE,
                           stderr=subprocess.STDOUT, text=True)
    while not out.exists() and run.poll() is None:
        time.sleep(0.001)
    try:
        run.wait(delay)
    except subprocess.TimeoutExpired:
        pass
    ended = run.poll() is not None
    sent = time.monotonic()
    if not ended:
        run.send_signal(signal.SIGINT)
    text, _ = run.communicate(timeout=120)
    took = time.monotonic() - sent
    if run.returncode not in ((0, 1) if ended else (130, 0, 1)):
        raise ValueError(f"exit code {run.returncode}:\n{text}")
    if run.returncode == 130 and not (out / "job.json").exists():
        raise ValueError(f"no job.json:\n{text}")
    check_whole(out)
    return took if run.returncode == 130 else None


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("program")
    arguments.add_argument("source", type=Path)
    arguments.add_argument("--whole", action="store_true")
    arguments.add_argument("--seed", type=int, default=1)
    given = arguments.parse_args()
    # Other tests may use all processors, and a sanitizer slows every step.
    limit = 0.3 if given.whole else 10.0
    moments = random.Random(given.seed)
    failed = counted = 0
    with tempfile.TemporaryDirectory() as folder:
        for name, document in jobs(given.source.resolve(), given.whole).items():
            job = Path(folder) / "job.json"
            job.write_text(json.dumps(document))
            times = []
            for repetition in range(30 if given.whole else 2):
                delay = moments.uniform(0.0, 6.0 if given.whole else 1.5)
                try:
                    took = interrupted_after(given.program, job, Path(folder) / f"{name} {repetition}", delay)
                except (ValueError, OSError, ElementTree.ParseError, subprocess.TimeoutExpired) as error:
                    print(f"{name}, interrupted after {delay:.3f} s: {error}")
                    failed += 1
                    continue
                if took is None:
                    continue
                times.append(took)
                if took > limit:
                    print(f"{name}, interrupted after {delay:.3f} s: ended {took:.3f} s later")
                    failed += 1
            counted += len(times)
            if times:
                print(f"{name}: {len(times)} times, {max(times):.3f} s at most, "
                      f"{sorted(times)[len(times) // 2]:.3f} s median")
    if counted == 0:
        print("no run was interrupted: all had ended before")
    return 1 if failed or counted == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
