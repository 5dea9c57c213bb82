#!/usr/bin/env python3
"""Runs every benchmark to its end, one after the other, and says how long each took.

usage: run.py BUILD [--long] [--limit MINUTES] [--write] [PROGRAM...]

By default with sizes chosen to take less than ten minutes together on two cores, and no longer than --limit (10) in any
case. With --long those of the figures in docs/, without a limit. Only the programs named, if some are. At the end comes
one table of what was compared with peers, and what has become slower beside them than docs/performance.md says; --write
makes that page anew, from a run of all programs. Exit code 1 when a program crashes, fails or does not end in time, or
when one of the build has no entry here.
"""
import argparse
import datetime
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import performance

root = Path(__file__).resolve().parents[1]
CYCLES = "{cycles}"  # cycles.json of configs/pendulum_table3.json, found first

# Program: arguments of the short run, and of the long one. Each list is one run.
programs = {
    "branch_bench": ([[]], [[]]),
    "chain_bench": ([["1e5"]], [[]]),
    "cycle_information_bench": ([[CYCLES, "measured"], [CYCLES, "orbits", "10"]],
                                [[CYCLES, "measured"], [CYCLES, "orbits"], [CYCLES, "multipliers"]]),
    "cycle_search_bench": ([["pendulum", "0.1", "18"], ["henon", "0.01", "18"]], [[]]),
    "ensemble_bench": ([[]], [[]]),
    "equation_bench": ([[]], [[]]),
    "estimator_bench": ([[]], [[]]),
    "experiment_cycles_bench": ([["0", "1"]], [[]]),
    "flow_bench": ([[]], [[]]),
    "grid_bench": ([["18"]], [[]]),
    "identification_bench": ([["lorenz", "short", "pendulum", "1000", "paper", "5000", "iteration", "42754"]], [[]]),
    "orbit_search_bench": ([["parametric_pendulum", "3", "14"]], [[]]),
    "periodic_bench": ([[]], [[]]),
    "campaign_bench": ([["20000", "0"], ["2000", "1"]], [["100000", "0"], ["100000", "1"], ["200", "1000"]]),
    "rank_chain_bench": ([["2e4", "2"]], [["1e5", "1", "2", "4"], ["1e6", "2", "4"]]),
    "scale_bench": ([[]], [[], ["henon", "1e8"]]),
    "sensitivity_bench": ([[]], [[]]),
    "auto/compare.py": ([["{build}"]], [["{build}"]]),
}


class OutOfTime(Exception):
    pass


def processor_seconds():
    """Of all programs run so far: what counts on a machine that others use too."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


class Runs:
    def __init__(self, build, limit):
        self.build = build
        self.end = time.monotonic() + limit if limit else None
        self.cycles = None
        self.folder = tempfile.TemporaryDirectory()
        self.compared = []  # rows of performance.py

    def seconds_left(self):
        if self.end is None:
            return None
        left = self.end - time.monotonic()
        if left <= 0.0:
            raise OutOfTime
        return left

    def command(self, name, arguments):
        program = root / "bench" / name if name.endswith(".py") else self.build / "bin" / name
        values = {"{build}": str(self.build)}
        if CYCLES in arguments:
            values[CYCLES] = self.found_cycles()
        return [str(program), *(values.get(argument, argument) for argument in arguments)]

    def found_cycles(self):
        if self.cycles is None:
            out = Path(self.folder.name) / "table3"
            job = root / "configs/pendulum_table3.json"
            subprocess.run([str(self.build / "bin/orbid"), "orbits", str(job), "--out", str(out), "--quiet"],
                           check=True, stdout=subprocess.DEVNULL, timeout=self.seconds_left())
            self.cycles = str(out / "cycles.json")
        return self.cycles

    def code_of(self, command):
        """Exit code of a program; what it prints is shown, and its rows are kept."""
        limit = self.seconds_left()
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, errors="replace") as program:
            watch = threading.Timer(limit, program.kill) if limit is not None else None
            if watch:
                watch.start()
            for line in program.stdout:
                row = performance.row_of(line)
                if row:
                    self.compared.append(row)
                else:
                    print(line, end="", flush=True)
            code = program.wait()
            if watch:
                watch.cancel()
                if not watch.is_alive() and code == -signal.SIGKILL and self.end <= time.monotonic():
                    raise OutOfTime
        return code

    def fault_of(self, name, arguments):
        """How a run that did not go to its end ended; nothing otherwise."""
        try:
            code = self.code_of(self.command(name, arguments))
        except (subprocess.TimeoutExpired, OutOfTime):
            return "out of time"
        except (subprocess.CalledProcessError, OSError) as error:
            return str(error)
        if code < 0:
            return f"killed by {signal.Signals(-code).name}"
        return f"exit code {code}" if code else None


def main():
    parser = argparse.ArgumentParser(description="Runs every benchmark.")
    parser.add_argument("build", type=Path)
    parser.add_argument("programs", nargs="*")
    parser.add_argument("--long", action="store_true", help="the sizes of the figures in docs/; no limit")
    parser.add_argument("--write", action="store_true", help="make docs/performance.md anew; not with PROGRAM")
    parser.add_argument("--limit", type=float, default=10.0, help="minutes for all together (default 10)")
    options = parser.parse_intermixed_args()
    built = {path.name for path in (options.build / "bin").glob("*_bench")} | {"auto/compare.py"}
    unknown = [name for name in options.programs if name not in programs]
    missing = [f"{name}: has no entry in bench/run.py" for name in sorted(built - set(programs))]
    missing += [f"{name}: is not built" for name in sorted(set(programs) - built)]
    if unknown:
        parser.error(f"there is no benchmark {', '.join(unknown)}; known: {', '.join(programs)}")
    if options.write and options.programs:
        parser.error("--write needs a run of all programs")
    load = f"{os.getloadavg()[0]:.1f} before, "
    chosen = options.programs or [name for name in programs if name in built]
    runs = Runs(options.build.resolve(), None if options.long else 60.0 * options.limit)
    rows = []
    for name in chosen:
        begin, processor = time.monotonic(), processor_seconds()
        faults = []
        for arguments in programs[name][1 if options.long else 0]:
            print(f"== {name} {' '.join(arguments)}".rstrip(), flush=True)
            fault = runs.fault_of(name, arguments)
            if fault:
                print(f"{name}: {fault}", flush=True)
                faults.append(fault)
        rows.append((time.monotonic() - begin, processor_seconds() - processor, name, "; ".join(faults)))
    print("\nseconds  of processor")
    for seconds, processor, name, faults in rows:
        print(f"{seconds:7.1f} {processor:13.1f}  {name}{'  FAILED: ' + faults if faults else ''}")
    print(f"{sum(row[0] for row in rows):7.1f} {sum(row[1] for row in rows):13.1f}  all")
    for line in missing:
        print(line)
    if runs.compared:
        width = [max(len(row[i]) for row in runs.compared) for i in range(5)]
        print("\nours over the peer's")
        for row in runs.compared:
            print("  ".join(cell.ljust(size) for cell, size in zip(row, width)).rstrip())
        for line in performance.regressions(runs.compared, performance.stored()):
            print(line)
    if options.write and not any(row[3] for row in rows):
        load += f"{os.getloadavg()[0]:.1f} after"
        performance.PAGE.write_text(performance.text(runs.compared, datetime.date.today(), load), "utf-8")
        print(f"written: {performance.PAGE.relative_to(root)}")
    return 1 if any(row[3] for row in rows) or any("no entry" in line for line in missing) else 0


if __name__ == "__main__":
    sys.exit(main())
