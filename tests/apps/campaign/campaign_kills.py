#!/usr/bin/env python3
"""Kills processes of campaigns at random moments (SIGKILL), repeats the same command, and compares the tables.

    campaign_kills.py PROGRAM SOURCE [--times N] [--seed N] [--mpi]

A campaign whose ranks, rank 0 or all of them were killed, and that was then run again, must give the same bytes as one
that nobody disturbed.
--times: how many campaigns are disturbed, 6 by default. --mpi: every other three with ranks of MPI.
"""

import argparse
import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path[1:1] = [str(Path(__file__).resolve().parents[1] / folder) for folder in ("program", "ranks")]
from mpiexec import CLEAN, starter  # noqa: E402
from signals import json_with_comments  # noqa: E402

KINDS = ("a rank", "rank 0", "all")
REPLICATES = 40
TABLES = ("tasks", "parameters", "summary")
# A process that was killed is gone at once; MPI asks its own first.
LONGEST_END = 30.0
# A campaign whose rank was started anew goes on to its end.
LONGEST_RUN = 600.0


def members(session):
    """Processes of a session that still run, as (number, parent)."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            number, _, rest = stat.read_text().partition(" (")
        except OSError:
            continue
        state, parent, _, own = rest.rpartition(") ")[2].split()[:4]
        if int(own) == session and state != "Z":
            found.append((int(number), int(parent)))
    return found


def end(processes):
    for number in processes:
        with contextlib.suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)


class Campaign:
    """Runs of one campaign, each into a folder of its own."""

    def __init__(self, program, file, mpi):
        self.program, self.file = program, file
        self.mpiexec, self.environment = mpi or ([], CLEAN)

    def command(self, out, mpi):
        ranks = [*self.mpiexec, "-n", "3"] if mpi else []
        options = [] if mpi else ["--threads", "3"]
        return [*ranks, self.program, "campaign", str(self.file), "--out", str(out), "--quiet", *options]

    def start(self, out, mpi):
        """A run as the first process of a session of its own."""
        # To a file: a process that outlives the run would keep a pipe open.
        with open(f"{out}.log", "w", encoding="utf-8") as log:
            return subprocess.Popen(self.command(out, mpi), stdout=log, stderr=log, start_new_session=True,
                                    env=self.environment)

    def finish(self, out, mpi):
        """Runs the same command to its end."""
        repeated = self.command(out, mpi)
        done = subprocess.run(repeated, capture_output=True, text=True, check=False, env=self.environment)
        if done.returncode != 0:
            words = " ".join(map(str, repeated))
            raise RuntimeError(f"{words}: exit code {done.returncode}\n{done.stdout}{done.stderr}")

    def tables(self, out):
        return {table: subprocess.run([self.program, "campaign", "export", str(out), "--table", table], check=True,
                                      capture_output=True).stdout for table in TABLES}


def kill(run, kind, mpi, moments):
    """Kills one rank that computes, rank 0 or all; what could be killed."""
    running = members(run.pid)
    # Processes are children of rank 0, ranks of MPI those of mpiexec.
    ranks = sorted(number for number, parent in running if parent == run.pid)
    if kind == "all":
        chosen = [number for number, _ in running]
    elif kind == "rank 0":
        chosen = ranks[:1] if mpi else [run.pid]
    else:
        ranks = ranks[1:] if mpi else ranks
        chosen = [moments.choice(ranks)] if ranks else []
    end(chosen)
    return len(chosen)


def disturb(campaign, out, kind, mpi, delay, moments):
    """Starts a run and kills after a delay. @return whether something was killed"""
    run = campaign.start(out, mpi)
    time.sleep(delay)
    killed = kill(run, kind, mpi, moments) if run.poll() is None else 0
    try:
        # Alone, a rank of this machine is started anew, and the run goes on.
        code = run.wait(LONGEST_END if mpi and killed else LONGEST_RUN)
    except subprocess.TimeoutExpired as late:
        left = [number for number, _ in members(run.pid)]
        end(left)
        code = run.wait()
        # mpiexec was once seen to wait for ever after a rank was killed; its ranks must be gone.
        if not mpi or left != [run.pid]:
            raise RuntimeError(f"{len(left)} processes have not ended") from late
    if kind == "a rank" and not mpi and code != 0:
        raise RuntimeError(f"the death of one rank ends all: exit code {code}\n{Path(f'{out}.log').read_text()}")
    latest = time.monotonic() + LONGEST_END
    while (left := members(run.pid)) and time.monotonic() < latest:
        time.sleep(0.01)
    if left:
        raise RuntimeError(f"{len(left)} processes outlive the run")
    return killed > 0


def complaint(campaign, out, kind, mpi, took, undisturbed, moments):
    """How often something was killed, and what is wrong with the campaign, run to its end after that; None: nothing."""
    kills = 0
    try:
        for _ in range(moments.randint(1, 3)):
            kills += disturb(campaign, out, kind, mpi, moments.uniform(0.05, 0.7) * took, moments)
        campaign.finish(out, mpi)
    except RuntimeError as error:
        return kills, str(error)
    differing = [name for name, text in campaign.tables(out).items() if text != undisturbed[name]]
    return kills, f"other bytes in {differing}" if differing else None


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("program")
    arguments.add_argument("source", type=Path)
    arguments.add_argument("--times", type=int, default=6)
    arguments.add_argument("--seed", type=int, default=1)
    arguments.add_argument("--mpi", action="store_true")
    given = arguments.parse_args()
    mpi_ranks = starter() if given.mpi else None
    if given.mpi and mpi_ranks is None:
        print("there is no mpiexec: without ranks of MPI")
    moments = random.Random(given.seed)
    counted = dict.fromkeys(KINDS, 0)
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "campaign.json"
        document = json_with_comments(given.source / "configs" / "campaigns" / "henon_coverage.json")
        file.write_text(json.dumps({**document, "replicates": REPLICATES}))
        campaign = Campaign(given.program, file, mpi_ranks)
        begun = time.monotonic()
        campaign.finish(Path(folder) / "whole", False)
        took = time.monotonic() - begun
        undisturbed = campaign.tables(Path(folder) / "whole")
        for repetition in range(given.times):
            kind = KINDS[repetition % len(KINDS)]
            mpi = mpi_ranks is not None and repetition // len(KINDS) % 2 == 1
            out = Path(folder) / f"disturbed_{repetition}"
            kills, said = complaint(campaign, out, kind, mpi, took, undisturbed, moments)
            counted[kind] += kills
            if said is not None:
                print(f"{repetition}: {kind}{' of MPI' if mpi else ''}: {said}", flush=True)
                failed += 1
    kills = ", ".join(f"{kind} {times} times" for kind, times in counted.items())
    print(f"{given.times - failed} of {given.times} campaigns the same bytes, {took:.1f} s undisturbed; "
          f"killed: {kills}")
    return 1 if failed or sum(counted.values()) == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
