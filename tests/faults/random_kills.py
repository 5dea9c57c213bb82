#!/usr/bin/env python3
"""Kills commands at random moments (SIGKILL), repeats them, and compares what they leave.

    random_kills.py PROGRAM [--count N] [--seed N] [--kinds NAME ...]

Runs, campaigns, `predict`, `compare`, `plot`, `report`, and runs that compile their equations into the cache. Every
other trial kills twice. Afterwards the same command must end with the bytes of one that nobody disturbed, and leave
nothing else behind.
"""

import argparse
import random
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from faults import SHARED, Trials
from kinds_of_run import environment, kinds, run


class Killed:
    """One kind of command, and how long it takes."""

    def __init__(self, program, kind, place):
        self.program, self.kind, self.trials = program, kind, Trials(program, "", kind, place)
        folder = self.trials.fresh("timed")
        begun = time.monotonic()
        run(program, kind.words, folder)
        self.took = time.monotonic() - begun
        shutil.rmtree(folder.parent)

    def kill(self, folder, delay):
        """Whether it still ran when it was killed."""
        process = subprocess.Popen([self.program, *self.kind.words], cwd=folder, stdout=subprocess.DEVNULL,
                                   stderr=subprocess.DEVNULL, env=environment(folder, "compiled" in self.kind.words[1]))
        try:
            process.wait(delay)
            return False
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return True

    def complaints(self, moments, times):
        folder = self.trials.fresh("killed")
        killed = [self.kill(folder, moments.uniform(0.0, self.took)) for _ in range(times)]
        said = [*self.trials.left(folder, True), *self.trials.next_run(folder)]
        shutil.rmtree(folder.parent, ignore_errors=True)  # a compiler may still write there
        return sum(killed), said


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="*")
    given = parser.parse_args()
    program = str(Path(given.program).resolve())
    moments = random.Random(given.seed)
    failed = 0
    with tempfile.TemporaryDirectory(dir=SHARED if SHARED.is_dir() else None, ignore_cleanup_errors=True) as temporary:
        place = Path(temporary)
        all_kinds = [Killed(program, kind, place / "trials") for kind in kinds(program, None, place)
                     if kind.name in (given.kinds or [kind.name])]
        kills = dict.fromkeys([each.kind.name for each in all_kinds], 0)
        for number in range(given.count):
            chosen = all_kinds[number % len(all_kinds)]
            times = 1 + number // len(all_kinds) % 2
            hit, said = chosen.complaints(moments, times)
            kills[chosen.kind.name] += hit
            if said:
                failed += 1
                print(f"{chosen.kind.name}, trial {number}, {times} kills: {'; '.join(said)}", flush=True)
    print(f"{given.count - failed} of {given.count} whole and the same bytes; killed while they ran: {kills}")
    return 1 if failed or sum(kills.values()) == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
