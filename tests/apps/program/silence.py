#!/usr/bin/env python3
"""Long runs without a terminal: no silence, and the best so far when they are interrupted or killed.

    silence.py PROGRAM SOURCE [--whole] [--seed N]

With --progress 1 no two lines on standard error may be further apart than two seconds (times the slowness of the
machine). An estimate that is interrupted after its start was evaluated leaves result.json with the status `interrupted`
and a number for every parameter; one that is killed after twelve seconds leaves it too. --whole: more moments.
"""

import argparse
import json
import math
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from signals import HENON, json_with_comments

# Lines come after one second; a second more is for the machine.
LONGEST = 2.0
DUFFING = {"equations": {"x": "v", "v": "-c * v - k * x - b * x^3 + f * cos(phase)"},
           "parameters": {"c": 0.1, "k": 1.0, "b": 1.0, "f": 0.2, "omega": 1.2}, "forcing_phase": "omega"}


def duffing_series(samples, **estimate):
    """A long record of an oscillator by interpreted equations: seconds for an evaluation."""
    return {"model": DUFFING, "seed": 1, "output": {"series": "none"},
            "data": {"name": "run", "simulate": {"samples": {"step": 0.1, "count": samples}, "initial": [[0.5, 0.0]],
                                                 "noise": {"x": 0.05, "v": 0.0}}, "observe": ["x"]},
            "estimate": {"parameters": {"c": {"start": 0.12}, "k": {"start": 1.03}, "b": {"start": 1.1},
                                        "f": {"start": 0.22}},
                         "residuals": [{"type": "series", "interval": "segment"}], **estimate}}


def jobs(source):
    """Job documents by name; each takes many seconds."""
    henon = {"name": "run", "simulate": {"sections": 40000000, "initial": [[0.1, 0.1]], "transient": 100}}
    noisy = {"name": "run", "simulate": {"sections": 24000, "initial": [[0.1, 0.1]], "transient": 100,
                                         "noise": {"x": 1e-3, "y": 1e-3}}}
    hare = json_with_comments(source / "configs" / "hare_lynx.json")
    hare["data"]["file"] = str(source / "configs" / hare["data"]["file"])
    hare["estimate"]["multi_start"] = {"starts": 200}
    draws = json.loads(json.dumps(hare))
    draws["estimate"]["multi_start"] = {"starts": 1}
    draws["estimate"]["posterior"]["sample"] = {"draws": 100000, "chains": 2, "warm_up": 500}
    cascade = json_with_comments(source / "configs" / "pendulum_cascade.json")
    cascade["periodic"]["continuation"].update(points=100000, step={"first": 1e-5, "largest": 1e-5})
    return {
        "simulation": {"model": HENON, "seed": 1, "data": henon},
        "noisy search": {"model": HENON, "seed": 1, "data": noisy,
                         "orbits": {"periods": [1, 2, 3, 4, 5, 6, 7, 8], "method": "patch_map"}},
        "orbits of a model": {"model": HENON, "seed": 1, "periodic": {"search": {"periods": list(range(1, 16))}}},
        "branches": cascade,
        "starts": hare,
        "draws": draws,
        "long series": duffing_series(400000),
        "profiles": duffing_series(6000, profile=True, marginals=True),
    }


class Watched:
    """A run, and when it wrote which line."""

    def __init__(self, program, job, out):
        self.begun = time.monotonic()
        self.lines = []
        self.out = out
        self.process = subprocess.Popen([program, "run", str(job), "--out", str(out), "--force", "--progress", "1"],
                                        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self.reading = threading.Thread(target=self.read)
        self.reading.start()

    def read(self):
        for line in self.process.stderr:
            self.lines.append((time.monotonic(), line.rstrip()))

    def wait(self, seconds):
        try:
            self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def wait_for(self, word, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end and self.process.poll() is None:
            if any(word in line for _, line in self.lines):
                return True
            time.sleep(0.01)
        return False

    def end(self, what):
        if self.process.poll() is None:
            self.process.send_signal(what)
        code = self.process.wait(120)
        self.reading.join()
        return code

    def gaps(self, until):
        times = [self.begun] + [at for at, _ in self.lines if at < until] + [until]
        return [(later - sooner, index) for index, (sooner, later) in enumerate(zip(times, times[1:]))]


def slowness(program):
    """1 on an idle machine: how much longer than 50 ms a start of the program takes."""
    took = []
    for _ in range(3):
        begun = time.monotonic()
        subprocess.run([program, "--help"], stdout=subprocess.DEVNULL, check=True)
        took.append(time.monotonic() - begun)
    return max(1.0, sorted(took)[1] / 0.05)


def is_best_so_far(out):
    """What is wrong with the result of an estimate that was left; empty: nothing."""
    if not (out / "result.json").exists():
        return "no result.json"
    result = json.loads((out / "result.json").read_text())
    if result["status"] != "interrupted":
        return f"status {result['status']}"
    values = {name: one["value"] for name, one in result["parameters"].items()}
    if not values or not all(isinstance(value, (int, float)) and math.isfinite(value) for value in values.values()):
        return f"parameters {values}, message {result['message']}"
    return ""


def silent(program, folder, name, document, seconds):
    job = folder / "job.json"
    job.write_text(json.dumps(document))
    run = Watched(program, job, folder / name)
    ended = run.wait(seconds)
    until = time.monotonic()
    code = run.end(signal.SIGINT)
    limit = LONGEST * slowness(program)
    longest, index = max(run.gaps(until))
    print(f"{name}: {len(run.lines)} lines in {until - run.begun:.1f} s, {longest:.2f} s between two at most")
    if code not in ((0, 1) if ended else (130, 0, 1)):
        print(f"  exit code {code}: {run.lines[-3:]}")
        return 1
    if longest > limit:
        print(f"  more than {limit:.1f} s, after {run.lines[index - 1][1] if index > 0 else 'the start'}")
        return 1
    return 0


def left(program, folder, name, document, delay, what):
    """Ends an estimate some seconds after its start was evaluated."""
    job = folder / "job.json"
    job.write_text(json.dumps(document))
    run = Watched(program, job, folder / f"{name} {what.name} {delay:.3f}")
    if not run.wait_for("objective", 60.0) or run.wait(delay):
        run.end(signal.SIGKILL)
        print(f"{name}: ended before it could be interrupted: {run.lines[-3:]}")
        return 1
    code = run.end(what)
    wrong = is_best_so_far(run.out)
    print(f"{name}: {what.name} {delay:.2f} s after the first step: {wrong or 'the best so far is there'}")
    return 1 if wrong or code != (-signal.SIGKILL if what == signal.SIGKILL else 130) else 0


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("program")
    arguments.add_argument("source", type=Path)
    arguments.add_argument("--whole", action="store_true")
    arguments.add_argument("--seed", type=int, default=1)
    given = arguments.parse_args()
    moments = random.Random(given.seed)
    failed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind, document in jobs(given.source.resolve()).items():
            failed += silent(given.program, folder, kind, document, 20.0 if given.whole else 5.0)
        for _ in range(10 if given.whole else 2):
            for what in (signal.SIGTERM, signal.SIGINT):
                failed += left(given.program, folder, "estimate", duffing_series(300000), moments.uniform(0.0, 4.0),
                               what)
        # From so far it takes many steps, however fast they are.
        far = duffing_series(1000000)
        far["estimate"]["parameters"] = {"c": {"start": 0.3}, "k": {"start": 1.6}, "b": {"start": 2.0},
                                         "f": {"start": 0.35}}
        failed += left(given.program, folder, "estimate", far, 14.0, signal.SIGKILL)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
