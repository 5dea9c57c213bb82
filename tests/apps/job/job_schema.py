#!/usr/bin/env python3
"""Compares `orbid schema` with what orbid reads, by python3-jsonschema.

usage: job_schema.py path/to/orbid

The schema must be valid itself. Every job that orbid accepts must be valid by it: tests/apps/jobs/valid, configs, and
what `orbid new` prints for every model and task. Every job of tests/apps/job/jobs/broken.txt whose fault is one of
structure must be invalid, every other one valid, unless it is no JSON at all. Exit code 77: there is no validator.
"""
import json
import os
import subprocess
import sys
from pathlib import Path

try:
    from jsonschema import Draft202012Validator
except ImportError:
    # A python of the user's own may stand before Debian's, which has the package.
    if sys.executable != "/usr/bin/python3" and os.access("/usr/bin/python3", os.X_OK):
        os.execv("/usr/bin/python3", ["/usr/bin/python3", *sys.argv])
    print("job_schema.py: python3-jsonschema is not installed", file=sys.stderr)
    sys.exit(77)

root = Path(__file__).resolve().parents[3]
corpus = root / "tests/apps/jobs"
failures = []


def without_comments(text):
    """The text with comments blanked, outside of strings."""
    out, i, in_string = [], 0, False
    while i < len(text):
        if in_string:
            if text[i] == "\\":
                out.append(text[i])
                i += 1
            elif text[i] == '"':
                in_string = False
            out.append(text[i])
            i += 1
        elif text.startswith("//", i):
            while i < len(text) and text[i] != "\n":
                i += 1
        elif text.startswith("/*", i):
            i = text.index("*/", i + 2) + 2
        else:
            in_string = text[i] == '"'
            out.append(text[i])
            i += 1
    return "".join(out)


def check(condition, what):
    if not condition:
        failures.append(what)


def first_error(validator, text):
    error = next(validator.iter_errors(json.loads(without_comments(text))), None)
    return None if error is None else f"{error.json_path}: {error.message[:200]}"


def main():
    orbid = sys.argv[1]

    def run(*arguments):
        return subprocess.run([orbid, *arguments], capture_output=True, text=True)

    schema = json.loads(run("schema").stdout)
    Draft202012Validator.check_schema(schema)
    validator = Draft202012Validator(schema)
    accepted = 0

    def check_accepted(name, text):
        nonlocal accepted
        accepted += 1
        error = first_error(validator, text)
        check(error is None, f"{name}: orbid accepts it, the schema does not: {error}")

    for file in sorted((corpus / "valid").glob("*.json")) + sorted((root / "configs").glob("*.json")):
        check_accepted(file, file.read_text())
    # The listing begins with the names; tasks that a model cannot do are refused with code 2.
    models = [line.split()[0] for line in run("models").stdout.splitlines() if line.strip()]
    for model in ["equations", *models]:
        for task in ["simulate", "auto", "cycles", "series", "waveform", "periodic", "search", "continuation"]:
            job = run("new", model, task)
            if job.returncode == 0:
                check_accepted(f"orbid new {model} {task}", job.stdout)
    broken = 0
    for line in (corpus / "broken.txt").read_text().splitlines():
        if line.startswith("#"):
            continue
        name, fault = [cell.strip() for cell in line.split("|")][:2]
        check(fault in ("structure", "meaning", "syntax"), f"{name}: unknown fault {fault}")
        if fault == "syntax":
            continue
        broken += 1
        error = first_error(validator, (corpus / "broken" / f"{name}.json").read_text())
        check((error is not None) == (fault == "structure"), f"{name}: a fault of {fault}, the schema says: {error}")
    check(accepted > 100 and broken > 60, f"only {accepted} valid and {broken} broken jobs were compared")
    for failure in failures:
        print(failure)
    print(f"job_schema.py: {accepted} valid and {broken} broken jobs, {len(failures)} disagreements")
    return 1 if failures else 0


sys.exit(main())
