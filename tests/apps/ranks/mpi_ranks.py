#!/usr/bin/env python3
"""Ranks of MPI: the exchange that all kinds of ranks pass, ends of ranks, and what is said when MPI cannot be used.

    mpi_ranks.py PROGRAM OTHER_PLUGIN [PLUGIN]

PROGRAM is mpi_ranks_check, OTHER_PLUGIN a plug-in of another version of orbid, PLUGIN the folder of orbid-mpi.so, where
it was built. Exit code 77: without it, or without mpiexec, only the messages were looked at.
"""

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mpiexec import CLEAN, starter


def run(command, environment=None, **variables):
    begun = time.monotonic()
    # Open MPI itself leaves memory behind.
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False,
                          env={**(environment or CLEAN), "ASAN_OPTIONS": "detect_leaks=0", **variables})
    return done.returncode, done.stdout, done.stderr, time.monotonic() - begun


def expect(right, what, found):
    if not right:
        sys.exit(f"mpi_ranks: {what}\n{found}")


def check_messages(program, other_plugin):
    """The plug-in is missing, of another version, no plug-in; none is looked for where MPI has not started it."""
    found = run([program, "exchange"], ORBID_PLUGINS="/nowhere")
    expect(found[:2] == (0, "not under MPI\n"), "a program that nobody started by MPI asks for it", found)
    with tempfile.TemporaryDirectory() as folder:
        # Elsewhere than in the build, where the plug-in may be beside it.
        moved = shutil.copy(program, folder)
        found = run([moved, "exchange"], OMPI_COMM_WORLD_SIZE="3")
        expect(found[0] == 3 and found[2] == (
            "error: this program was started by mpiexec with 3 ranks, but orbid's MPI plug-in is not installed: apt "
            "install orbid-mpi (or build with libopenmpi-dev)\n"), "other words for a missing plug-in", found)
        found = run([moved, "exchange"], PMIX_RANK="0", ORBID_PLUGINS=folder)
        expect(found[0] == 3 and f"$ORBID_PLUGINS, {folder}, holds no orbid-mpi.so" in found[2],
               "the folder that holds no plug-in is not named", found)
        plugin = Path(folder) / "orbid-mpi.so"
        shutil.copy(other_plugin, plugin)
        found = run([moved, "exchange"], PMI_RANK="0", ORBID_PLUGINS=folder)
        expect(found[0] == 3 and "belongs to another version of orbid" in found[2], "any version is taken", found)
        plugin.write_text("no library")
        found = run([moved, "exchange"], PMI_SIZE="2", ORBID_PLUGINS=folder)
        expect(found[0] == 3 and f"{plugin} cannot be loaded" in found[2], "no library is loaded", found)


def check_ranks(mpiexec, environment, program):
    """Exchanges, and ranks that fail or die."""
    for count in (1, 2, 3):
        found = run([*mpiexec, "-n", str(count), program, "exchange"], environment)
        expect(found[:2] == (0, f"{count} ranks have exchanged messages\n"), f"{count} ranks", found)
        print(f"{count} ranks: {found[3]:.1f} s")
    found = run([*mpiexec, "-n", "3", program, "exception"], environment)
    expect(found[0] == 3 and "error: the last rank fails" in found[2] and found[3] < 60,
           "an exception does not end all ranks with its exit code", found)
    found = run([*mpiexec, "-n", "3", program, "death"], environment)
    expect(found[0] not in (0, 3) and found[3] < 60, "the death of a rank does not end all", found)
    # Started by something that says there are more ranks than MPI knows of.
    found = run([program, "exchange"], environment, SLURM_STEP_NUM_TASKS="2")
    expect(found[0] != 0 and "2 ranks were started, but MPI knows of 1" in found[2], "single ranks are taken", found)


def main():
    program, other_plugin, *plugin = sys.argv[1:]
    check_messages(program, other_plugin)
    started = starter()
    if started is None or not plugin:
        print(f"skipped: there is no {'mpiexec' if plugin else 'MPI plug-in in this build'}")
        return 77
    command, environment = started
    check_ranks(command, {**environment, "ORBID_PLUGINS": plugin[0]}, program)
    return 0


if __name__ == "__main__":
    sys.exit(main())
