#!/usr/bin/env python3
"""Makes the k-th call of one kind fail in short runs of the program, for all k, and looks at what is left.

    faults.py PROGRAM LIBRARY [--fast] [--kinds NAME ...] [--faults NAME ...] [--most N] [--seed N] [--jobs N]

After each fault: no file is half written, no temporary is left, the message names what failed and why, the exit code
is right, and the same command without faults ends with the bytes of a run that nobody disturbed. Allocations: all of
the first --most (1000) of a run, then as many at equal distances. --fast: a few of each, for the tests.
"""

import argparse
import collections
import errno
import json
import os
import random
import re
import shutil
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from kinds_of_run import kinds, run

# What fails, with which error; "on": from the k-th call on.
FAULTS = [("write", errno.ENOSPC, ""), ("write", errno.EIO, "on"), ("write", "short", ""), ("write", "kill", ""),
          ("sync", errno.EIO, ""), ("sync", "kill", ""), ("rename", errno.EACCES, ""), ("rename", "kill", ""),
          ("open", errno.EACCES, ""), ("open", errno.EMFILE, "on"), ("open", "kill", ""), ("mmap", errno.ENOMEM, ""),
          ("memory", errno.ENOMEM, ""), ("memory", errno.ENOMEM, "on"), ("memory", "kill", ""),
          ("read", errno.EIO, ""), ("close", errno.EDQUOT, "")]
# Files that show times, or what a run of its own makes of the way it took. result.json is stored more than once.
TIMED = ("timing.json", "log.txt", "report.html", "checkpoint.bin")
ON_THE_WAY = (*TIMED, "result.json")
CODES = {"memory": (5,), "mmap": (3, 4, 5)}
SQLITE_SAYS = ("disk I/O error", "database or disk is full", "unable to open database file", "locking protocol",
               "attempt to write a readonly database", "if the disk could not be read just now")
FILE = re.compile(r"/|\.\w")  # something that looks like the name of a file
# Memory ran out where nothing could be unwound: as after a kill, the next run removes what is left.
ENDED_AT_ONCE = "what was stored before is whole"
SHARED = Path("/dev/shm")


def fault_name(fault):
    what, error, lasting = fault
    return f"{what}:{errno.errorcode.get(error, error)}{':on' if lasting else ''}"


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*")
            if path.is_file() and not path.name.startswith(("campaign.sqlite", "campaign.lock"))}


def is_whole(name, data):
    """Whether a file that differs from run to run can be read to its end."""
    if name.endswith(".json"):
        try:
            return isinstance(json.loads(data), dict)
        except ValueError:
            return False
    if name.endswith("report.html"):
        return data.rstrip().endswith(b"</html>")
    return len(data) > 0


class Trials:
    """Trials of one kind of run, in a place of its own."""

    def __init__(self, program, library, kind, place):
        self.program, self.library, self.kind, self.place = program, library, kind, place
        self.before = contents(kind.before / kind.out) if (kind.before / kind.out).exists() else {}
        folder = self.fresh("undisturbed")
        end = run(program, kind.words, folder)
        if end.returncode not in (0, 1):
            sys.exit(f"{kind.name}: exit code {end.returncode}: {end.stderr}")
        self.code, self.after, self.tables = end.returncode, contents(folder / kind.out), self.exported(folder)
        self.said = end.stdout
        shutil.rmtree(folder)

    def fresh(self, name):
        folder = self.place / self.kind.name / name / "work"
        shutil.rmtree(folder.parent, ignore_errors=True)
        shutil.copytree(self.kind.before, folder)
        return folder

    def exported(self, folder):
        return [run(self.program, words, folder).stdout for words in self.kind.tables]

    def faulty(self, folder, fault, number):
        """A run with a fault, and how its log counts it: (fired, calls)."""
        what, error, lasting = fault
        log = folder.parent / "log"
        log.unlink(missing_ok=True)
        end = run(self.program, self.kind.words, folder, LD_PRELOAD=self.library, ORBID_FAULT_PROGRAM=self.program,
                  ORBID_FAULT_LOG=str(log), ORBID_FAULT=f"{what}:{number}:{error}{':on' if lasting else ''}")
        lines = [line.split() for line in (log.read_text() if log.exists() else "").splitlines()]
        calls = [int(line[2]) for line in lines if line[0] == "calls"]
        return end, any(line[0] == "fired" for line in lines), calls[-1] if calls else 0

    def calls(self, what):
        folder = self.fresh(f"count_{what}")
        _, _, calls = self.faulty(folder, (what, 0, ""), 0)
        shutil.rmtree(folder.parent)
        return calls

    def left(self, folder, killed):
        """What is wrong with the files after a fault."""
        found = contents(folder / self.kind.out) if (folder / self.kind.out).exists() else {}
        for name, data in found.items():
            base = name.rpartition("/")[2]
            if base.startswith(".orbid-"):
                if not killed and name not in self.before:
                    yield f"{name} is left"
                continue
            known = (self.before.get(name), self.after.get(name))
            if data not in known and not (base in ON_THE_WAY and is_whole(name, data)):
                yield f"{name} is neither the old file nor the new one ({len(data)} bytes)"

    def message(self, end, fault, folder):
        """What is wrong with exit code and message."""
        what, error, _ = fault
        said = end.stderr
        if end.returncode < 0 or "terminate called" in said or "internal error" in said:
            yield f"exit code {end.returncode}: {said[-300:]!r}"
            return
        found = contents(folder / self.kind.out) if (folder / self.kind.out).exists() else {}
        if end.returncode == self.code:
            missing = [name for name, data in self.after.items()
                       if name not in found or (name.rpartition("/")[2] not in TIMED and found[name] != data)]
            if [name for name in missing if Path(name).name not in said]:
                yield f"exit code {end.returncode}, but {missing} are missing or old, and the message is {said!r}"
            if end.stdout != self.said and not said and not self.kind.tables:
                yield f"exit code {end.returncode}, but other words: {end.stdout!r}"
            return
        if end.returncode not in CODES.get(what, (2, 3, 4)):
            yield f"exit code {end.returncode}: {said[-300:]!r}"
        reason = os.strerror(error) if isinstance(error, int) else os.strerror(errno.ENOSPC)
        if what == "memory" and "memory" not in said:
            yield f"nothing about memory: {said!r}"
        elif what != "memory" and (not any(text in said for text in (reason, *SQLITE_SAYS)) or not FILE.search(said)):
            yield f"no reason or no file: {said!r}"

    def complaints(self, fault, number):
        """(whether the fault took place, what is wrong) of one trial."""
        what = fault[0]
        folder = self.fresh(f"{fault_name(fault)}_{number}")
        end, fired, _ = self.faulty(folder, fault, number)
        killed = fault[1] == "kill"
        said = []
        if killed != (end.returncode == -9) and fired:
            said.append(f"exit code {end.returncode} of a killed run")
        if not killed:
            said += self.message(end, fault, folder)
        said += self.left(folder, killed or ENDED_AT_ONCE in end.stderr)
        said += self.next_run(folder, memory=what in ("memory", "mmap"))
        shutil.rmtree(folder.parent)
        return fired, said

    def next_run(self, folder, memory=False):
        """What is wrong after the same command without faults."""
        said = []
        again = run(self.program, self.kind.words, folder)
        if again.returncode != self.code:
            said.append(f"the next run ended with {again.returncode}: {again.stderr[-300:]!r}")
        found = contents(folder / self.kind.out)
        differing = sorted(name for name in found.keys() | self.after.keys()
                           if (found.get(name) != self.after.get(name) and Path(name).name not in TIMED)
                           or (name in found) != (name in self.after))
        if differing:
            said.append(f"after the next run other bytes, or files too many or too few: {differing}")
        if memory and self.exported(folder) != self.tables:
            run(self.program, ["campaign", "retry", self.kind.out, "--quiet"], folder)  # tasks that had no memory
        if self.exported(folder) != self.tables:
            said.append("the next run's tables differ")
        cache = folder / "cache" / "orbid"
        if cache.exists():
            said += [f"{path.name} is left in the cache" for path in cache.iterdir() if path.suffix != ".so"]
        return said


def numbers(calls, most):
    """Which calls are to fail: all, or the first and then as many at equal distances."""
    if calls <= 2 * most:
        return list(range(1, calls + 1))
    return [*range(1, most + 1), *(most + round((calls - most) * i / most) for i in range(1, most + 1))]


def chosen_faults(trials, given, draw):
    """Which calls of a kind of run are to fail, and how many calls there are."""
    wanted, counted = [], {}
    for fault in FAULTS:
        what, error, lasting = fault
        if given.faults and not any(fault_name(fault).startswith(each) for each in given.faults):
            continue
        if what not in counted:
            counted[what] = trials.calls(what)
        most = given.most // 4 if what == "memory" and (lasting or error == "kill") else given.most
        chosen = numbers(counted[what], most)
        if given.fast:
            chosen = draw.sample(chosen, min(1, len(chosen)))
        wanted += [(fault, number) for number in chosen]
    return wanted, counted


def findings_of(trials, given, draw):
    """(faults that took place, findings) of a kind of run; tells the first ten of each kind of fault."""
    name = trials.kind.name
    wanted, counted = chosen_faults(trials, given, draw)
    with ThreadPoolExecutor(given.jobs) as pool:
        results = list(pool.map(lambda one: trials.complaints(*one), wanted))
    seen = collections.Counter()
    for (fault, number), (_, said) in zip(wanted, results):
        seen[fault_name(fault)] += bool(said)
        if said and seen[fault_name(fault)] <= 10:
            print(f"{name}, {fault_name(fault)}, call {number}: {'; '.join(said)}", flush=True)
    print(f"{name}: {len(wanted)} faults, {seen.total()} findings; calls {counted}", flush=True)
    return sum(happened for happened, _ in results), seen.total()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("library")
    parser.add_argument("--fast", action="store_true")
    parser.add_argument("--kinds", nargs="*")
    parser.add_argument("--faults", nargs="*", help="write, write:kill ...")
    parser.add_argument("--most", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    program, library = str(Path(given.program).resolve()), str(Path(given.library).resolve())
    draw = random.Random(given.seed)
    fired = failed = 0
    with tempfile.TemporaryDirectory(dir=SHARED if SHARED.is_dir() else None) as temporary:
        place = Path(temporary)
        for kind in kinds(program, library, place):
            if kind.name not in (given.kinds or [kind.name]) or (given.fast and kind.name == "compiled"):
                continue
            happened, found = findings_of(Trials(program, library, kind, place / "trials"), given, draw)
            fired += happened
            failed += found
    print(f"{fired} faults, {failed} findings")
    return 1 if failed or fired == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
