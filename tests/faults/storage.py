#!/usr/bin/env python3
"""Runs on a machine that is short of something.

    storage.py PROGRAM

A full disk (a small tmpfs: only root may mount one), a folder that cannot be written, little memory (RLIMIT_AS), files
from the future (the clock was set back), a folder that is deleted while a run writes. Each ends with a named reason and
the right exit code; what is stored is whole, and the next run gives the bytes of one that nobody disturbed.
"""

import contextlib
import hashlib
import os
import resource
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from faults import contents, is_whole, TIMED
from kinds_of_run import kinds, run

PROGRAM = str(Path(sys.argv[1]).resolve())
MEGABYTE = 1 << 20


class Skipped(Exception):
    """The machine does not allow this test."""


def check(right, what):
    if not right:
        raise AssertionError(what)


def same(folder, wanted, what):
    found = contents(folder)
    differing = [name for name in found.keys() | wanted.keys()
                 if name not in TIMED and found.get(name) != wanted.get(name)]
    check(not differing, f"{what}: other bytes in {differing}")


@contextlib.contextmanager
def small_disk(folder, kilobytes):
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(folder)],
                             capture_output=True, text=True, check=False)
    if mounted.returncode != 0:
        raise Skipped(f"a tmpfs cannot be mounted: {mounted.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def full_disk(place, kind, wanted):
    """Disks of several sizes: full at another file each time."""
    refused = 0
    for kilobytes in range(8, 240, 16):
        with small_disk(place / "disk", kilobytes) as disk:
            work = place / "work"
            shutil.copytree(kind.before, work)
            (work / kind.out).symlink_to(disk)
            end = run(PROGRAM, kind.words, work)
            check(end.returncode in (0, 4), f"{kilobytes} kB: exit code {end.returncode}: {end.stderr}")
            if end.returncode == 4:
                refused += 1
                check("No space left on device" in end.stderr or "disk is full" in end.stderr,
                      f"{kilobytes} kB: {end.stderr}")
            for name, data in contents(disk).items():
                check(not name.startswith(".orbid-"), f"{kilobytes} kB: {name} is left")
                check(data == wanted.get(name) or is_whole(name, data), f"{kilobytes} kB: {name} is not whole")
            subprocess.run(["mount", "-o", "remount,size=20m", str(disk)], check=True)
            end = run(PROGRAM, kind.words, work)
            check(end.returncode == 0, f"{kilobytes} kB and then more: exit code {end.returncode}: {end.stderr}")
            same(disk, wanted, f"{kilobytes} kB and then more")
            shutil.rmtree(work)
        (place / "disk").rmdir()
    check(refused > 3, f"only {refused} disks were full")


def as_nobody():
    os.setgid(65534)
    os.setuid(65534)


def read_only_folder(place, kind, wanted):
    work = place / "work"
    shutil.copytree(kind.before, work)
    out = work / kind.out
    out.mkdir()
    for path in [place.parent, place, *place.rglob("*")]:
        path.chmod(path.stat().st_mode | 0o055 if path.is_dir() else 0o644)
    out.chmod(0o555)
    root = os.geteuid() == 0
    reached = [Path(PROGRAM), *Path(PROGRAM).parents, *work.parents]
    parent_open = all(os.stat(each).st_mode & 0o001 for each in reached)
    if root and not parent_open:
        raise Skipped("root may write everywhere, and nobody else may reach these folders")
    end = subprocess.run([PROGRAM, *kind.words], cwd=work, capture_output=True, text=True, check=False,
                         preexec_fn=as_nobody if root else None)
    check(end.returncode == 2 and "not writable" in end.stderr, f"exit code {end.returncode}: {end.stderr}")
    out.chmod(0o755)
    end = run(PROGRAM, kind.words, work)
    check(end.returncode == 0, f"writable again: exit code {end.returncode}: {end.stderr}")
    same(out, wanted, "writable again")


def little_memory(place, kind, wanted):
    for megabytes in (96, 128, 160, 192, 256, 512):
        work = place / "work"
        shutil.copytree(kind.before, work)

        def limit(size=megabytes * MEGABYTE):
            resource.setrlimit(resource.RLIMIT_AS, (size, size))

        end = subprocess.run([PROGRAM, *kind.words], cwd=work, capture_output=True, text=True, check=False,
                             preexec_fn=limit)
        if end.returncode == 127:
            continue  # the program itself could not be loaded
        check(end.returncode in (0, 3, 5), f"{megabytes} MB: exit code {end.returncode}: {end.stderr}")
        check(end.returncode == 0 or "memory" in end.stderr, f"{megabytes} MB: {end.stderr}")
        end = run(PROGRAM, kind.words, work)
        check(end.returncode == 0, f"{megabytes} MB and then more: exit code {end.returncode}: {end.stderr}")
        same(work / kind.out, wanted, f"{megabytes} MB and then more")
        shutil.rmtree(work)
    # A record of 480 MB where 256 MB are allowed.
    (place / "large.json").write_text('{"model": {"name": "henon", "parameters": {"a": 1.4, "b": 0.3}}, "seed": 1,'
                                      '"data": {"name": "run", "simulate": {"sections": 30000000, '
                                      '"initial": [[0.1, 0.1]]}},'
                                      '"orbits": {"periods": [1]}}')

    def small():
        resource.setrlimit(resource.RLIMIT_AS, (256 * MEGABYTE, 256 * MEGABYTE))

    end = subprocess.run([PROGRAM, "run", "large.json", "--threads", "1", "--quiet"], cwd=place, capture_output=True,
                         text=True, check=False, preexec_fn=small)
    check(end.returncode == 5 and "out of memory" in end.stderr and "the limit is 268 MB" in end.stderr,
          f"256 MB: exit code {end.returncode}: {end.stderr}")


def clock_set_back(place, kind, wanted):
    """All files of a half-finished run seem to come from the next year."""
    work = place / "work"
    shutil.copytree(kind.before, work)
    run(PROGRAM, kind.words, work)
    out = work / kind.out
    for name in ("result.json", "report.html"):
        (out / name).unlink()
    machine = hashlib.sha256(socket.gethostname().encode()).hexdigest()[:8]
    (out / f".orbid-tmp-999999999-{machine}-0.result.json").write_text("half")
    later = time.time() + 366 * 86400
    for path in [*work.rglob("*"), out]:
        os.utime(path, (later, later))
    end = run(PROGRAM, kind.words, work)
    check(end.returncode == 0, f"exit code {end.returncode}: {end.stderr}")
    same(out, wanted, "files from the future")


def deleted_folder(place, kind, wanted):
    """The folder goes at several moments; a run that still has something to store says so."""
    told = 0
    for delay in (0.0, 0.01, 0.03, 0.06, 0.1, 0.2):
        work = place / "work"
        shutil.copytree(kind.before, work)
        out = work / kind.out
        process = subprocess.Popen([PROGRAM, *kind.words], cwd=work, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                   text=True)
        latest = time.monotonic() + 60
        while not (out / ".orbid-lock").exists() and process.poll() is None and time.monotonic() < latest:
            time.sleep(0.001)
        time.sleep(delay)
        shutil.rmtree(out, ignore_errors=True)
        said = process.communicate(timeout=300)[1]
        check(process.returncode in (0, 2, 3, 4), f"exit code {process.returncode}: {said}")
        if process.returncode:
            told += 1
            check("No such file or directory" in said and kind.out in said and "internal" not in said, said)
        shutil.rmtree(work / kind.out, ignore_errors=True)
        end = run(PROGRAM, kind.words, work)
        check(end.returncode == 0, f"the next run: exit code {end.returncode}: {end.stderr}")
        same(out, wanted, "after a deleted folder")
        shutil.rmtree(work)
    check(told > 0, "no run noticed that its folder was gone")


def main():
    skipped = 0
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        kind = next(each for each in kinds(PROGRAM, None, place / "kinds") if each.name == "estimate")
        work = place / "undisturbed"
        shutil.copytree(kind.before, work)
        check(run(PROGRAM, kind.words, work).returncode == 0, "the undisturbed run failed")
        wanted = contents(work / kind.out)
        for test in (full_disk, read_only_folder, little_memory, clock_set_back, deleted_folder):
            folder = place / test.__name__
            folder.mkdir()
            try:
                test(folder, kind, wanted)
                print(f"{test.__name__}: as it should be", flush=True)
            except Skipped as reason:
                skipped += 1
                print(f"{test.__name__}: skipped: {reason}", flush=True)
    print(f"{skipped} skipped")


if __name__ == "__main__":
    main()
