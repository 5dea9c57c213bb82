#!/usr/bin/env python3
"""How long orbid takes to start: `orbid --help`, `orbid check JOB` and `orbid run` of a job of no size, beside an empty C++
program and `python3 -c pass`.

    bench/startup.py [BUILD_FOLDER] [REPETITIONS]      default: build/release, 101

All commands take turns, so that a machine that is busy for a while is busy for all; medians, and their ratios to
`/usr/bin/python3 -c pass`. Times are from just before the process is made until it has been waited for.
"""

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))

TINY = """{ "model": { "name": "henon" },
  "data": { "simulate": { "sections": 100, "trajectories": 1 } }, "output": { "series": "csv" } }"""


def seconds(command):
    to_nothing = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
    begin = time.perf_counter()
    process = os.posix_spawnp(command[0], command, os.environ, file_actions=to_nothing)
    _, status = os.waitpid(process, 0)
    elapsed = time.perf_counter() - begin
    if status != 0:
        sys.exit(f"startup: {' '.join(command)} failed")
    return elapsed


def main():
    build = sys.argv[1] if len(sys.argv) > 1 else os.path.join(ROOT, "build", "release")
    repetitions = int(sys.argv[2]) if len(sys.argv) > 2 else 101
    orbid = os.path.join(build, "bin", "orbid")
    with tempfile.TemporaryDirectory() as folder:
        empty = os.path.join(folder, "empty")
        subprocess.run(["c++", "-O2", "-x", "c++", "-", "-o", empty], input=b"int main() {}\n", check=True)
        table3 = os.path.join(ROOT, "configs", "pendulum_table3.json")
        # Twenty-one rows of data, which are read, too.
        hares = os.path.join(ROOT, "configs", "hare_lynx.json")
        commands = {
            "empty C++ program": [empty],
            "orbid --help": [orbid, "--help"],
            "orbid check pendulum_table3.json": [orbid, "check", table3],
            "orbid check hare_lynx.json": [orbid, "check", hares],
            "/usr/bin/python3 -c pass": ["/usr/bin/python3", "-c", "pass"],
        }
        job = os.path.join(folder, "tiny.json")
        with open(job, "w") as file:
            file.write(TINY)
        results = os.path.join(folder, "results")
        commands["orbid run, 100 iterates of a map"] = [orbid, "run", job, "--out", results, "--quiet"]
        other = subprocess.run(["bash", "-c", "command -v python3"], capture_output=True, text=True).stdout.strip()
        if other and other != "/usr/bin/python3":
            commands["python3 -c pass (of the PATH)"] = [other, "-c", "pass"]
        times = {name: [] for name in commands}
        for _ in range(repetitions):
            for name, command in commands.items():
                times[name].append(seconds(command))
                shutil.rmtree(results, ignore_errors=True)
    peer = statistics.median(times["/usr/bin/python3 -c pass"])
    for name, list_of_times in times.items():
        median = statistics.median(list_of_times)
        print(f"{name:34s} {1e3 * median:7.2f} ms {median / peer:6.2f} of python3")


main()
