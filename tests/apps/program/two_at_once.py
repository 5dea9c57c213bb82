#!/usr/bin/env python3
"""Two programs at once, and signals that a terminal or a batch system sends.

    two_at_once.py PROGRAM

Into one output folder: the second run says who writes there and ends; stopped (SIGSTOP) runs keep it, killed ones do
not. Two runs that compile the same equations into one empty cache. Output that nobody reads any more (`orbid run |
head`), a terminal that is closed (SIGHUP), with nohup or without.
"""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PROGRAM = str(Path(sys.argv[1]).resolve())
HENON = {"name": "henon", "parameters": {"a": 1.4, "b": 0.3}}
LOCK = ".orbid-lock"


def job(folder, name, sections, **more):
    file = folder / f"{name}.json"
    data = {"name": "run", "simulate": {"sections": sections, "initial": [[0.1, 0.1]], "transient": 100}}
    file.write_text(json.dumps({"model": HENON, "seed": 1, "data": data, "orbits": {"periods": [1, 2]}, **more}))
    return str(file)


def start(*words, **options):
    return subprocess.Popen([PROGRAM, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def locked(run, out):
    """Waits until a run has its folder."""
    latest = time.monotonic() + 60
    while time.monotonic() < latest and run.poll() is None:
        try:
            if (out / LOCK).read_text().startswith("process"):
                return
        except OSError:
            pass
        time.sleep(0.005)
    raise AssertionError(f"{out} was never locked: {run.communicate()}")


def check(right, what):
    if not right:
        raise AssertionError(what)


def one_folder(folder):
    file, out = job(folder, "long", 60_000_000), folder / "long"
    first = start("run", file, "--out", str(out))
    try:
        locked(first, out)
        first.send_signal(signal.SIGSTOP)
        for further in ([], ["--force"]):
            second = start("run", file, "--out", str(out), *further)
            _, said = second.communicate(timeout=60)
            check(second.returncode == 2, f"the second run ended with {second.returncode}: {said}")
            pattern = rf"cannot store results in .*: process {first.pid} on \S+ since \d{{4}}-\d\d-\d\d .* writes there"
            check(re.search(pattern, said), f"the second run says: {said}")
        first.send_signal(signal.SIGCONT)
        first.send_signal(signal.SIGTERM)
        said = first.communicate(timeout=120)
        check(first.returncode == 130, f"a stopped and continued run ended with {first.returncode}: {said}")
        check(not (out / LOCK).exists(), "a run that ended left its lock behind")
    finally:
        first.kill()
        first.communicate()


def killed(folder):
    file, out = job(folder, "killed", 60_000_000), folder / "killed"
    first = start("run", file, "--out", str(out))
    locked(first, out)
    first.kill()
    first.communicate()
    check((out / LOCK).exists(), "a killed run cannot have removed its lock: was it the right file?")
    file = job(folder, "killed", 2000)
    second = start("run", file, "--out", str(out), "--force")
    _, said = second.communicate(timeout=120)
    check(second.returncode == 0, f"after a kill the next run ended with {second.returncode}: {said}")
    check(not (out / LOCK).exists(), "a run that ended left its lock behind")


def nobody_reads(folder):
    file, out = job(folder, "piped", 2000), folder / "piped"
    run = subprocess.Popen([PROGRAM, "run", file, "--out", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    run.stdout.close()  # as head does when it has what it wanted
    run.stderr.close()
    check(run.wait(120) == 0, f"without readers a run ended with {run.returncode}")
    check((out / "report.html").exists() and (out / "cycles.json").exists(), "without readers a run stored too little")


def hung_up(folder):
    file, out = job(folder, "hung", 60_000_000), folder / "hung"
    run = start("run", file, "--out", str(out))
    locked(run, out)
    run.send_signal(signal.SIGHUP)
    said = run.communicate(timeout=120)
    check(run.returncode == 130, f"after SIGHUP a run ended with {run.returncode}: {said}")
    file, out = job(folder, "nohup", 1_000_000), folder / "nohup"
    run = start("run", file, "--out", str(out), preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
    locked(run, out)
    run.send_signal(signal.SIGHUP)
    said = run.communicate(timeout=300)
    check(run.returncode == 0, f"a run that ignores SIGHUP ended with {run.returncode}: {said}")


def one_cache(folder):
    """Without a compiler equations are interpreted, and nothing is shared."""
    cache = folder / "cache"
    cache.mkdir()
    equations = {"equations": {"x": "1 - a * x^2 + y", "y": "b * x"}, "kind": "map", "parameters": {"a": 1.4, "b": 0.3}}
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    runs = []
    for name in ("one", "other"):
        file = job(folder, name, 2000, model=equations)
        runs.append((folder / name, start("run", file, "--out", str(folder / name), env=environment)))
    for out, run in runs:
        said = run.communicate(timeout=300)
        check(run.returncode == 0, f"of two runs at one cache one ended with {run.returncode}: {said}")
    files = [(out / "cycles.json").read_bytes() for out, _ in runs]
    check(files[0] == files[1], "two runs at one cache differ")
    left = [path.name for path in (cache / "orbid").glob("*") if path.suffix != ".so"] if (cache / "orbid").exists() else []
    check(not left, f"left in the cache: {left}")


def main():
    for test in (one_folder, killed, nobody_reads, hung_up, one_cache):
        with tempfile.TemporaryDirectory() as folder:
            test(Path(folder))
        print(f"{test.__name__}: as it should be", flush=True)


if __name__ == "__main__":
    main()
