"""The kinds of run that faults are tried on: what is there before, the command, where its files go."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "fuzz"))
import stored_folders

CAMPAIGN = {"title": "three records", "kind": "sweep", "job": "cycles.json", "replicates": 3}
EQUATIONS = {"equations": {"x": "1 - a * x^2 + y", "y": "b * x"}, "kind": "map", "parameters": {"a": 1.4, "b": 0.3}}


class Kind:
    """A command in a folder of its own. `before` is copied there for every trial."""

    def __init__(self, name, before, words, out, tables=()):
        self.name, self.before, self.words, self.out, self.tables = name, before, words, out, tables


def environment(folder, compiling=False):
    """No compiler and no cache of the user's, unless the run is about them."""
    found = {key: value for key, value in os.environ.items() if not key.startswith("ORBID_")}
    found.update(XDG_CACHE_HOME=str(folder / "cache"), NO_COLOR="1")
    if not compiling:
        found["ORBID_CXX"] = ""
    return found


def run(program, words, folder, **more):
    return subprocess.run([program, *words], cwd=folder, env={**environment(folder, "compiled" in words[1]), **more},
                          capture_output=True, text=True, errors="replace", timeout=600)


def begun_run(program, library, base, folder):
    """A folder whose run was killed after its first checkpoint was stored; without the library nothing has begun."""
    if library is None:
        shutil.copytree(base, folder)
        return
    for rename in range(1, 40):
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(base, folder)
        run(program, ["run", "series.json", "--threads", "1", "--quiet"], folder, LD_PRELOAD=library,
            ORBID_FAULT=f"rename:{rename}:kill", ORBID_FAULT_PROGRAM=program, ORBID_FAULT_LOG=str(folder / "log"))
        (folder / "log").unlink(missing_ok=True)
        if (folder / "series" / "checkpoint.bin").exists():
            return
    sys.exit("no run was left with a checkpoint")


def kinds(program, library, place):
    """All kinds; their folders are made below `place`. Paths in jobs are relative: copies are read, not originals."""
    jobs, base, done, begun = place / "jobs", place / "base", place / "done", place / "begun"
    jobs.mkdir(parents=True)
    base.mkdir()
    stored_folders.made(program, jobs)
    shutil.copy(jobs / "swing" / "series.csv", base / "swing.csv")
    documents = stored_folders.jobs(base)
    documents["series"]["data"]["file"] = "swing.csv"
    documents["compiled"] = {**documents["cycles"], "model": EQUATIONS}
    for name, document in documents.items():
        (base / f"{name}.json").write_text(json.dumps(document))
    (base / "campaign.json").write_text(json.dumps(CAMPAIGN))
    (base / "other.json").write_text(json.dumps({**documents["cycles"], "seed": 2}))
    shutil.copytree(base, done)
    for name in ("series", "cycles"):
        run(program, ["run", f"{name}.json", "--threads", "1", "--quiet"], done)
    begun_run(program, library, base, begun)
    quiet = ["--threads", "1", "--quiet"]
    tables = [["campaign", "export", "campaign", "--table", table] for table in ("tasks", "parameters")]
    return [
        Kind("estimate", base, ["run", "series.json", *quiet], "series"),
        Kind("cycles", base, ["run", "cycles.json", *quiet], "cycles"),
        Kind("resumed", begun, ["run", "series.json", *quiet], "series"),
        Kind("overwritten", done, ["run", "other.json", "--out", "cycles", "--force", *quiet], "cycles"),
        Kind("campaign", base, ["campaign", "campaign.json", "--engine", "threads", *quiet], "campaign", tables),
        Kind("report", done, ["report", "series"], "series"),
        Kind("plot", done, ["plot", "cycles", "section"], "cycles"),
        Kind("predict", done, ["predict", "series", "swing.csv", *quiet], "series"),
        Kind("compare", done, ["compare", "series", "series"], "series"),
        Kind("compiled", base, ["run", "compiled.json", *quiet], "compiled"),
    ]
