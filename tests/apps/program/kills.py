#!/usr/bin/env python3
"""Kills runs of the program at random moments (SIGKILL), repeats the same command, and compares what it leaves.

    kills.py PROGRAM SOURCE [--whole [JOB=TIMES ...]] [--seed N]

The folder of a run that was killed and then repeated must hold the same bytes as that of a run that nobody disturbed.
Times, the log and the report, which shows times, are left out. --whole: 200 kills over long jobs.
"""

import argparse
import json
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from signals import json_with_comments

WHOLE = {"pendulum_table3": 120, "hare_lynx": 60, "pendulum_experiment": 20}
TIMED = ("timing.json", "log.txt", "report.html", "checkpoint.bin")


def document(source, name):
    """The job of that name in configs, shortened where it takes minutes."""
    job = json_with_comments(source / "configs" / f"{name}.json")
    data = job["data"]
    if "file" in data:
        data["file"] = str(source / "configs" / data["file"])
    sections = {"pendulum_table3": 65536, "pendulum_experiment": 5000}
    if name in sections:
        data["simulate"]["sections"] = sections[name]
    return job


def command(program, job, out):
    return [program, "run", str(job), "--out", str(out), "--quiet"]


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes()
            for path in folder.rglob("*") if path.is_file() and path.name not in TIMED}


def killed_after(program, job, out, delay):
    """Starts a run and kills it after a delay; whether it was still running."""
    run = subprocess.Popen(command(program, job, out), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        run.wait(delay)
    except subprocess.TimeoutExpired:
        run.kill()
        run.wait()
        return True
    return False


def complaint(program, job, out, undisturbed, delay):
    """What is wrong with a run that is killed after a delay and then repeated; None: nothing."""
    killed_after(program, job, out, delay)
    again = subprocess.run(command(program, job, out), capture_output=True, text=True)
    if again.returncode not in (0, 1):
        return f"exit code {again.returncode}:\n{again.stdout}{again.stderr}"
    found = contents(out)
    if found.keys() != undisturbed.keys():
        return f"files {sorted(found.keys() ^ undisturbed.keys())} are in one folder only"
    differing = [name for name, data in found.items() if data != undisturbed[name]]
    return f"other bytes in {differing}" if differing else None


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("program")
    arguments.add_argument("source", type=Path)
    arguments.add_argument("--whole", nargs="*", metavar="JOB=TIMES")
    arguments.add_argument("--seed", type=int, default=1)
    given = arguments.parse_args()
    chosen = {"henon": 3}
    if given.whole is not None:
        chosen = {name: int(times) for name, _, times in (each.partition("=") for each in given.whole)} or WHOLE
    moments = random.Random(given.seed)
    failed = counted = 0
    with tempfile.TemporaryDirectory() as folder:
        for name, times in chosen.items():
            # Folders of the same name and depth: stored jobs hold paths relative to them.
            job = Path(folder) / f"{name}.json"
            job.write_text(json.dumps(document(given.source.resolve(), name)))
            begun = time.monotonic()
            subprocess.run(command(given.program, job, Path(folder) / f"{name}_whole"), check=False,
                           stdout=subprocess.DEVNULL)
            took = time.monotonic() - begun
            undisturbed = contents(Path(folder) / f"{name}_whole")
            wrong = 0
            for repetition in range(times):
                delay = moments.uniform(0.0, took)
                said = complaint(given.program, job, Path(folder) / f"{name}_{repetition}", undisturbed, delay)
                if said is not None:
                    print(f"{name}, killed after {delay:.3f} s: {said}", flush=True)
                    wrong += 1
            print(f"{name}: {times - wrong} of {times} the same bytes, {took:.1f} s undisturbed", flush=True)
            failed += wrong
            counted += times
    return 1 if failed or counted == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
