#!/usr/bin/env python3
"""More than two hundred refused inputs: each message names its place and is for people.

    refusals.py PROGRAM SOURCE [--show]

The broken jobs and tables of tests/apps/jobs, command lines, campaigns and stored folders. For each: the exit code is 2
or 3, the message names the file, option or word that is wrong, and nothing of the program's inside is in it. --show
prints all messages, to be read.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

INSIDE = re.compile(r"internal error|std::|nlohmann|json\.exception|orbid::|what\(\)|bad_alloc|basic_string|vector::|"
                    r"_M_|terminate|Assertion|\b0x[0-9a-f]{6,}\b|\bnullptr\b|\.[ch]pp\b|type_error|out_of_range")

SAMPLES = {"model": {"name": "free_pendulum"},
           "data": {"file": "data.csv", "kind": "samples", "columns": {"time": "t", "phi": "theta"}},
           "estimate": {"parameters": {"w0sq": {"start": 60}}, "residuals": [{"type": "series"}]}}

# Arguments of the program, and what the message must name.
COMMAND_LINES = [
    (["rnu", "job.json"], "rnu"), (["--verbose"], "--verbose"), (["run"], "JOB"), (["run", "none.json"], "none.json"),
    (["run", "job.json", "--ou", "x"], "--ou"), (["run", "job.json", "--out"], "--out"),
    (["run", "job.json", "--threads", "many"], "threads"), (["run", "job.json", "--threads", "2.5"], "threads"),
    (["run", "job.json", "--threads", "-1"], "threads"), (["run", "job.json", "--threads", "1e9"], "threads"),
    (["run", "job.json", "other.json"], "2 arguments"), (["run", ".", "--out", "x"], "."), (["run", "data.csv"], "data.csv"),
    (["check"], "JOB"), (["check", "none.json"], "none.json"), (["check", "job.json", "--json"], "--json"),
    (["models", "free_pendulm"], "free_pendulm"), (["models", "lorenz", "rossler"], "2 arguments"), (["models", ""], "\"\""),
    (["new"], "MODEL"), (["new", "lorentz"], "lorentz"), (["new", "lorenz", "serie"], "serie"),
    (["new", "henon", "series"], "series"), (["report"], "DIR"), (["report", "nowhere"], "nowhere"),
    (["report", "job.json"], "job.json"), (["report", "."], "."), (["plot"], "DIR"), (["plot", "nowhere"], "nowhere"),
    (["plot", ".", "nothing"], "."), (["plot", ".", "--format", "gif"], "gif"), (["plot", ".", "--width", "wide"], "width"),
    (["compare"], "DIR"), (["compare", "nowhere", "."], "nowhere"), (["compare", "nowhere"], "DIR2"),
    (["predict"], "DIR"), (["predict", "nowhere"], "DIR DATA"), (["predict", ".", "data.csv"], "."),
    (["campaign"], "CAMPAIGN"), (["campaign", "none.json"], "none.json"), (["completion"], "SHELL"),
    (["completion", "fsh"], "fsh"), (["help", "rnu"], "rnu"), (["schema", "result"], "orbid schema"),
    (["--color"], "--color"), (["models", "--color", "sometimes"], "sometimes"), (["man", "run"], "orbid man"),
    (["simulate", "none.json"], "none.json"), (["orbits", "none.json"], "none.json"), (["periodic", "none.json"], "none.json"),
    (["estimate", "none.json"], "none.json"), (["simulate"], "JOB"), (["orbits"], "JOB"), (["periodic"], "JOB"),
]

# Changes of a valid campaign, and what the message must name.
CAMPAIGNS = [
    ({"kind": "covrage"}, "/kind"), ({"jobs": "none_*.json"}, "/jobs"), ({"jobs": 3}, "/jobs"), ({"replicates": 0}, "/replicates"),
    ({"replicates": 1.5}, "/replicates"), ({"replicates": "two"}, "/replicates"), ({"limit": {"seconds": -1}}, "/limit/seconds"),
    ({"limit": {"second": 1}}, "/limit/second"), ({"titel": "t"}, "/titel"), ({"vary": [{"key": "data", "multiply_by": [2]}]}, "/vary/0"),
    ({"vary": {}}, "/vary"), ({"seed": -1}, "/seed"), ({"truth": "none.json"}, "/truth"), ({"vary": [{"key": "/data"}]}, "/vary/0"),
    ({"title": 3}, "/title"), ({"changes": "none.json"}, "/changes"), ({"kind": None}, "/kind"), ({"limit": 60}, "/limit"),
]

# Files of a stored run, and what is put in their place; the file must be named.
STORED = [(name, text) for name in ("result.json", "job.json")
          for text in ("", "{", "[]", "{}", "null", '{"a": 1e9991}', '{"a": "\x01"}', "\x00\xff", "{\"a\": 1, \"a\": 2}", "[" * 70)]


def write(folder, name, content):
    (folder / name).write_text(content if isinstance(content, str) else json.dumps(content), encoding="latin-1")


def rows(path):
    return [[cell.strip() for cell in line.split("|")] for line in path.read_text(encoding="utf-8").splitlines()
            if line.strip() and not line.startswith("#")]


def refused(program, folder, arguments):
    run = subprocess.run([program, *arguments], cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, timeout=120,
                         env={**os.environ, "NO_COLOR": "1"}, check=False)
    return run.returncode, (run.stdout + run.stderr).decode("utf-8", "replace")


def jobs(source, scratch):
    corpus = source / "tests/apps/jobs"
    for path in sorted((corpus / "broken").glob("*.json")):
        yield f"job {path.stem}", corpus / "broken", ["check", path.name], path.name
    for path in sorted((corpus / "bad_data").iterdir()):
        if path.suffix != ".csv":
            continue
        folder = scratch / "tables" / path.stem
        folder.mkdir(parents=True)
        shutil.copy(path, folder / "data.csv")
        row = next((r for r in rows(corpus / "bad_data.txt") if r[0] == path.name), None)
        if row is None or row[1] != "samples":
            continue
        write(folder, "job.json", SAMPLES)
        yield f"table {path.stem}", folder, ["run", "job.json", "--out", "out", "--quiet"], \
            "run1" if path.stem == "two_readings" else "data.csv"  # whole records are named as experiments


def others(source, scratch, program):
    folder = scratch / "lines"
    folder.mkdir()
    write(folder, "job.json", SAMPLES)
    write(folder, "other.json", SAMPLES)
    write(folder, "data.csv", "t,theta\n" + "".join(f"{0.1 * k:.1f},{0.01 * k}\n" for k in range(20)))
    for arguments, place in COMMAND_LINES:
        yield f"line {' '.join(arguments)}", folder, arguments, place
    shutil.copy(source / "configs/henon.json", folder / "henon.json")
    valid = {"title": "t", "kind": "coverage", "jobs": "henon.json", "replicates": 1, "limit": {"seconds": 60}}
    for k, (change, place) in enumerate(CAMPAIGNS):
        write(folder, f"campaign{k}.json", {**valid, **change})
        yield f"campaign {json.dumps(change)}", folder, ["check", f"campaign{k}.json"], place
    stored = scratch / "stored"
    run = {"model": {"equations": {"x": "-k * x"}, "parameters": {"k": 1.0}},
           "data": {"simulate": {"samples": {"step": 0.1, "count": 40}, "initial": [[1.0]], "noise": {"x": 0.01}}},
           "estimate": {"parameters": {"k": {"start": 1.2}}, "residuals": [{"type": "series"}]}}
    write(folder, "stored.json", run)
    code, said = refused(program, folder, ["run", "stored.json", "--out", str(stored), "--quiet"])
    if code != 0:
        sys.exit(f"the run that is to be damaged failed: {said}")
    for k, (name, text) in enumerate(STORED):
        damaged = scratch / f"stored{k}"
        shutil.copytree(stored, damaged)
        write(damaged, name, text)
        yield f"stored {name} {text[:12]!r}", scratch, ["report", damaged.name], name


def main():
    program, source = str(Path(sys.argv[1]).resolve()), Path(sys.argv[2]).resolve()
    bad = 0
    with tempfile.TemporaryDirectory() as temporary:
        scratch = Path(temporary)
        cases = [*jobs(source, scratch), *others(source, scratch, program)]
        with ThreadPoolExecutor(2) as pool:
            answers = list(pool.map(lambda case: refused(program, case[1], case[2]), cases))
        for (name, _, _, place), (code, message) in zip(cases, answers):
            if "--show" in sys.argv:
                print(f"## {name} [{code}]\n{message.strip()[:600]}")
            faults = [f"exit code {code}"] if code not in (2, 3) else []
            if place not in message:
                faults.append(f"{place} is not named")
            if inside := INSIDE.search(message):
                faults.append(f"says {inside[0]}")
            if faults:
                bad += 1
                print(f"{name}: {', '.join(faults)}: {message.strip()[:300]}")
    print(f"{len(cases)} refused inputs, {bad} failures")
    return 1 if bad or len(cases) < 200 else 0


if __name__ == "__main__":
    sys.exit(main())
