#!/usr/bin/env python3
"""Compares `orbid schema --campaign` with what orbid reads, by python3-jsonschema.

usage: campaign_schema.py path/to/orbid

The schema must be valid itself. Campaigns that orbid runs must be valid by it: those of `new`, configs/campaigns and
VALID. Those of BROKEN must be refused by orbid, and be invalid by the schema if their fault is one of structure, valid
if it takes the job or another file to see it. Exit code 77: there is no validator.
"""
import copy
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

root = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(root / "tests/docs"))

try:
    from jsonschema import Draft202012Validator
except ImportError:
    # A python of the user's own may stand before Debian's, which has the package.
    if sys.executable != "/usr/bin/python3" and os.access("/usr/bin/python3", os.X_OK):
        os.execv("/usr/bin/python3", ["/usr/bin/python3", *sys.argv])
    print("campaign_schema.py: python3-jsonschema is not installed", file=sys.stderr)
    sys.exit(77)

from commented_json import without_comments  # noqa: E402

JOB = {
    "model": {"name": "free_pendulum", "parameters": {"w0sq": 30, "c2": 0.05}},
    "data": {"simulate": {"samples": {"step": 0.02, "count": 31}, "noise": {"phi": 0.005, "phi_dot": 0.02},
                          "initial": [[1.0, 0.0]]}},
    "estimate": {"parameters": {"w0sq": {"start": 33}, "c2": {"start": 0.1}}, "residuals": [{"type": "series"}]},
}
COUNT = {"key": "/data/simulate/samples/count", "values": [31, 41]}
SWEEP = {"$schema": "s", "title": "t", "kind": "sweep", "job": JOB, "vary": [COUNT], "seed": 5, "replicates": 2}
COVERAGE = {"kind": "coverage", "job": "job.json", "replicates": 2}
GRID = {"kind": "profile_grid", "job": JOB, "grid": {"c2": [0.01, 0.1]}}
RANGE = {"from": 0.01, "to": 1, "count": 3, "spacing": "log"}
RECORDS = {"kind": "records", "job": "recorded.json", "records": "record_*.csv"}


def changed(campaign, **changes):
    """The campaign with other keys; None leaves one out."""
    return {key: value for key, value in {**copy.deepcopy(campaign), **changes}.items() if value is not None}


def vary(**item):
    return changed(SWEEP, vary=[item])


VALID = {
    "sweep": SWEEP,
    "sweep by replicates": changed(SWEEP, vary=None),
    "range": vary(key="/model/parameters/c2", range=RANGE, name="friction"),
    "keys": vary(keys=["/data/simulate/noise/phi", "/data/simulate/noise/phi_dot"], values=[[1e-3, 1e-2], [1e-2, 0.1]]),
    "draw": vary(key="/estimate/parameters/w0sq/start", draw={"uniform": [28, 32]}),
    "log_uniform": vary(key="/estimate/parameters/c2/start", draw={"log_uniform": [0.01, 1]}),
    "normal": vary(key="/model/parameters/w0sq", draw={"normal": [30, 0.1]}),
    "files": changed(RECORDS, kind="sweep", records=None, vary=[{"key": "/data/file", "files": "record_*.csv"}]),
    "multiply_by": vary(key="/data/simulate/noise", multiply_by=[0.5, 2]),
    "coverage": COVERAGE,
    "truth": changed(COVERAGE, truth={"w0sq": 30, "c2": {"value": 0.05, "bound": 1e-3}}),
    "limit": changed(COVERAGE, limit={"seconds": 60}),
    "grid": GRID,
    "grid of a range": changed(GRID, grid={"c2": RANGE}),
    "models": {"kind": "compare_models", "jobs": {"inline": JOB, "file": "job.json"}},
    "changes": {"kind": "compare_models", "jobs": {"a": "job.json", "b": "job.json"},
                "changes": {"b": {"estimate": {"parameters": {"c2": None}}}}},
    "pattern": {"kind": "compare_models", "jobs": "j*b*.json"},
    "records": RECORDS,
    "record_key": changed(RECORDS, record_key="/data/file"),
}

# (fault, what the message contains, campaign): structure = the schema can see it; meaning = it takes the job or a file.
BROKEN = [
    ("structure", "must be an object", []),
    ("structure", '"kind" is missing', changed(SWEEP, kind=None)),
    ("structure", 'did you mean "coverage"?', changed(COVERAGE, kind="covrage")),
    ("structure", 'did you mean "replicates"?', changed(COVERAGE, replikates=2)),
    ("structure", '"replicates" is missing', changed(COVERAGE, replicates=None)),
    ("structure", "/replicates", changed(COVERAGE, replicates=0)),
    ("structure", "/replicates", changed(COVERAGE, replicates=1.5)),
    ("structure", "/seed", changed(SWEEP, seed=-1)),
    ("structure", 'needs "job"', changed(SWEEP, job=None)),
    ("structure", "/job", changed(SWEEP, job=3)),
    ("structure", "/jobs", changed(SWEEP, jobs={"a": JOB})),
    ("structure", "/run", changed(COVERAGE, job=None, run="out")),
    ("structure", '"grid" is missing', changed(GRID, grid=None)),
    ("structure", "/grid", changed(SWEEP, grid={"c2": [1]})),
    ("structure", "/grid", changed(GRID, grid={})),
    ("structure", "/grid/c2", changed(GRID, grid={"c2": {"from": 1, "to": 2}})),
    ("structure", '"records" is missing', changed(RECORDS, records=None)),
    ("structure", "/record_key", changed(SWEEP, record_key="/data/file")),
    ("structure", "/vary", changed(SWEEP, vary=[])),
    ("structure", "/vary/0", vary(values=[1])),
    ("structure", "/vary/0", vary(key="/seed")),
    ("structure", "/vary/0", vary(key="/seed", values=[1], range=RANGE)),
    ("structure", "/vary/0/key", vary(key="seed", values=[1])),
    ("structure", "/vary/0", vary(key="/seed", keys=["/seed", "/title"], values=[1])),
    ("structure", "/vary/0/keys", vary(keys=["/seed"], values=[[1]])),
    ("structure", "/vary/0/values", vary(key="/seed", values=[])),
    ("structure", "/vary/0/range/count", vary(key="/seed", range={"from": 1, "to": 2, "count": 1})),
    ("structure", "/vary/0/range/spacing", vary(key="/seed", range={**RANGE, "spacing": "even"})),
    ("structure", "/vary/0/draw", vary(key="/seed", draw={"uniform": [1, 2], "normal": [1, 2]})),
    ("structure", "/vary/0/draw/uniform", vary(key="/seed", draw={"uniform": [1, 2, 3]})),
    ("structure", "/truth/w0sq", changed(COVERAGE, truth={"w0sq": {"bound": 1}})),
    ("structure", "/truth/w0sq/bound", changed(COVERAGE, truth={"w0sq": {"value": 1, "bound": 0}})),
    ("structure", "/limit/seconds", changed(SWEEP, limit={"seconds": -1})),
    ("structure", "/vary/0/multiply_by", vary(key="/data/simulate/noise", multiply_by=[])),
    ("structure", "/changes", changed(SWEEP, changes={"b": {}})),
    ("meaning", "no number there", vary(key="/model/name", multiply_by=[2])),
    ("meaning", 'no job "c"', {"kind": "compare_models", "jobs": {"a": JOB, "b": JOB}, "changes": {"c": {}}}),
    ("meaning", "does not exist", changed(SWEEP, job="none.json")),
    ("meaning", "no file matches", changed(RECORDS, records="none_*.csv")),
    ("meaning", "no finished run", {"kind": "bootstrap", "run": "none", "replicates": 2}),
    ("meaning", "nothing varies", changed(SWEEP, vary=None, replicates=None)),
    ("meaning", "at least two jobs", {"kind": "compare_models", "jobs": {"a": JOB}}),
    ("meaning", 'add "replicates"', changed(vary(key="/seed", draw={"uniform": [1, 2]}), replicates=None)),
    ("meaning", "must ascend", vary(key="/model/parameters/c2", draw={"uniform": [2, 1]})),
    ("meaning", "needs ends > 0", vary(key="/model/parameters/c2", range={**RANGE, "from": 0})),
    ("meaning", "one for each of", vary(keys=["/seed", "/title"], values=[[1]])),
    ("meaning", "leads nowhere", vary(key="/modl/parameters/c2", values=[1])),
    ("meaning", "varies twice", changed(SWEEP, vary=[COUNT, {**COUNT, "name": "again"}])),
    ("meaning", "no parameter", changed(GRID, grid={"c9": [1]})),
    ("meaning", "/data/simulate/samples/count", vary(key="/data/simulate/samples/count", values=["many"])),
]


def main():
    orbid = Path(sys.argv[1]).resolve()
    failures = []

    def run(*arguments, cwd=None):
        return subprocess.run([orbid, *arguments], capture_output=True, text=True, cwd=cwd)

    schema = json.loads(run("schema", "--campaign").stdout)
    Draft202012Validator.check_schema(schema)
    validator = Draft202012Validator(schema)

    def fault(campaign):
        error = next(validator.iter_errors(campaign), None)
        return None if error is None else f"{error.json_path}: {error.message[:200]}"

    texts = {str(file): file.read_text() for file in sorted((root / "configs/campaigns").glob("*.json"))}
    for kind in schema["properties"]["kind"]["enum"]:
        texts[f"orbid new campaign {kind}"] = run("new", "campaign", kind).stdout
    for name, text in texts.items():
        document = json.loads(without_comments(text))
        # Jobs may stand beside campaigns: a campaign has a kind.
        if "kind" in document and fault(document):
            failures.append(f"{name}: the schema says {fault(document)}")
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "job.json").write_text(json.dumps(JOB))
        (Path(folder) / "jxb.json").write_text(json.dumps({**JOB, "seed": 2}))
        recorded = {**JOB, "data": {"file": "record_1.csv", "kind": "samples",
                                    "columns": {"time": "t", "phi": "phi", "phi_dot": "phi_dot"}}}
        (Path(folder) / "recorded.json").write_text(json.dumps(recorded))
        (Path(folder) / "csv.json").write_text(json.dumps({**JOB, "output": {"series": "csv"}}))
        made = run("simulate", "csv.json", "--quiet", cwd=folder)
        assert made.returncode == 0, made.stderr
        for number in (1, 2):
            (Path(folder) / f"record_{number}.csv").write_bytes((Path(folder) / "csv/series.csv").read_bytes())
        campaigns = [(name, None, campaign) for name, campaign in VALID.items()]
        campaigns += [(fault, part, campaign) for fault, part, campaign in BROKEN]
        for number, (name, part, campaign) in enumerate(campaigns):
            file = Path(folder) / f"campaign_{number}.json"
            file.write_text(json.dumps(campaign))
            done = run("campaign", file.name, "--quiet", "--threads", "1", cwd=folder)
            said = fault(campaign)
            what = f"{name}: {json.dumps(campaign)[:300]}\n    orbid: {done.returncode} {done.stderr.strip()[:300]}"
            if part is None:
                if done.returncode != 0 or said is not None:
                    failures.append(f"valid {what}\n    schema: {said}")
            elif done.returncode not in (2, 3) or part not in done.stderr or (said is not None) != (name == "structure"):
                failures.append(f"{what}\n    schema: {said}\n    expected: {part}")
    for failure in failures:
        print(failure)
    print(f"campaign_schema.py: {len(VALID) + len(texts)} valid and {len(BROKEN)} broken campaigns, "
          f"{len(failures)} disagreements")
    return 1 if failures else 0


sys.exit(main())
