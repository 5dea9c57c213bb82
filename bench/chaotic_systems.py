#!/usr/bin/env python3
"""How many of a set of chaotic systems are identified from short noisy records, and in what time.

    bench/chaotic_systems.py build/release/bin/orbid FOLDER --case B --limit 60

FOLDER holds systems.json (by name: truth, start, free, redundant, forced parameters) and records/NAME_CASE.json with
its data. Case B2 is the first coordinate of the record of A2. A system is solved where the exit code is 0 and every estimated parameter lies within four reported sds and
10 % of the truth. An answer is wrong where the exit code is 0 and one parameter lies beyond both. --far begins 100 %
off (twice or half the truth). Times are those of the processor, with one thread a run.
"""

import argparse
import json
import math
import os
import pathlib
import signal
import subprocess
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor


def job_of(folder, name, case, system, far):
    job = json.loads((folder / "records" / f"{name}_{case[0] if case == 'B2' else case}.json").read_text())
    record = f"{name}_A2.csv" if case == "B2" else job["data"]["file"]
    job["data"]["file"] = str(folder / "records" / record)
    for parameter, value in system["truth"].items():
        entry = job["estimate"]["parameters"].get(parameter)
        if far and entry is not None:
            entry["start"] = 2.0 * value if system["start"][parameter] / value > 1.0 else 0.5 * value
    return job


def run(program, job, folder, limit):
    """Exit code (None: stopped at the limit) and processor time [s]."""
    path = folder / "job.json"
    path.write_text(json.dumps(job))
    process = subprocess.Popen([program, "run", path, "--out", folder / "out", "--threads", "1", "--quiet"],
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    ticks = os.sysconf("SC_CLK_TCK")
    stopped = False
    used = 0.0
    while True:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            used = usage.ru_utime + usage.ru_stime
            return (None if stopped else os.waitstatus_to_exitcode(status)), used
        fields = pathlib.Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        used = (int(fields[11]) + int(fields[12])) / ticks
        if used > limit and not stopped:
            process.send_signal(signal.SIGINT)
            stopped = True
        if used > limit + 5.0:
            process.kill()
        time.sleep(0.05)


def judged(folder, system, case, code):
    """Solved, wrong, and (covered, all) 95 % intervals."""
    result = folder / "out" / "result.json"
    if code != 0 or not result.exists():
        return False, False, (0, 0)
    parameters = json.loads(result.read_text())["parameters"]
    redundant = system["redundant"]["A" if case.startswith("A") else "B"]
    solved, wrong, covered, count = True, False, 0, 0
    for name in system["free"]:
        entry = parameters.get(name)
        if entry is None or name in redundant or entry["sd"] is None:
            continue
        truth = system["truth"][name]
        error = abs(entry["value"] - truth)
        far, off = error > 4.0 * entry["sd"], error > 0.1 * abs(truth)
        solved = solved and not far and not off
        wrong = wrong or (far and off)
        lower, upper = entry["interval95"]
        covered += lower <= truth <= upper
        count += 1
    return solved, wrong, (covered, count)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("program")
    arguments.add_argument("folder", type=pathlib.Path)
    arguments.add_argument("--case", default="A1", choices=["A1", "A2", "B", "B2"])
    arguments.add_argument("--limit", type=float, default=60.0, help="processor time of a run [s]")
    arguments.add_argument("--far", action="store_true", help="start at twice or half the truth")
    arguments.add_argument("--jobs", type=int, default=os.cpu_count())
    asked = arguments.parse_args()
    folder = asked.folder.resolve()
    systems = json.loads((folder / "systems.json").read_text())

    def one(name):
        with tempfile.TemporaryDirectory() as scratch:
            work = pathlib.Path(scratch)
            code, used = run(asked.program, job_of(folder, name, asked.case, systems[name], asked.far), work,
                             asked.limit)
            return name, code, used, judged(work, systems[name], asked.case, code)

    with ThreadPoolExecutor(asked.jobs) as pool:
        rows = list(pool.map(one, sorted(systems)))
    print("| system | outcome | processor time [s] |\n|---|---|---|")
    for name, code, used, (solved, wrong, _) in rows:
        outcome = "solved" if solved else "WRONG" if wrong else "stopped" if code is None else f"exit code {code}"
        print(f"| {name} | {outcome} | {used:.1f} |")
    times = sorted(used for _, _, used, _ in rows)
    covered = sum(row[3][2][0] for row in rows)
    count = sum(row[3][2][1] for row in rows)
    print(f"\n{sum(row[3][0] for row in rows)} of {len(rows)} solved, {sum(row[3][1] for row in rows)} wrong; "
          f"median {times[len(times) // 2]:.1f} s, slowest {times[-1]:.1f} s; "
          f"{covered} of {count} intervals cover ({100.0 * covered / max(count, 1) if count else math.nan:.1f} %)")


if __name__ == "__main__":
    main()
