#!/usr/bin/env python3
"""Breaks valid jobs in many ways; `orbid check` must refuse or accept each of them, and never end in any other way.

usage: mutated_jobs.py path/to/orbid [--all] [--jobs N] [--show]

Every job of tests/apps/jobs/valid and configs is changed at every key and value: left out, misspelt, replaced by values
of other types, by numbers far off, and by its neighbour's value. So are pairs of these changes, since what an early
block lacks may be missed by a later one. Exit codes 0, 2 and 3 are answers; signals, internal errors (4), what a
sanitizer says and checks that do not end are failures, printed with the job.

Without --all a fixed sample is checked: in the jobs of tests/apps/jobs/valid every block and every key of a block left
out or misspelt, and a share of the rest.
"""
import argparse
import copy
import json
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

root = Path(__file__).resolve().parents[3]
corpus = root / "tests/apps/jobs"
answers = (0, 2, 3)
sanitizers = ("Sanitizer:", "runtime error:")
seconds_at_most = 60 * float(os.environ.get("ORBID_TEST_SLOWNESS", "1"))  # of a program with sanitizers
bytes_at_most = 8 << 30
sample_size = 330  # of keys further within, of other values, and of pairs of changes

replacements = [None, True, 0, -1, 0.5, 1e300, -1e300, 9007199254740992, "", "nonsense", [], {}, [0], {"x": 1}]


def without_comments(text):
    string_or_comment = re.compile(r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/', re.DOTALL)
    return string_or_comment.sub(lambda match: match[0] if match[0][0] == '"' else " ", text)


def with_absolute_files(value, folder):
    """Mutated jobs stand in another folder than the data they name."""
    if isinstance(value, dict):
        return {key: str((folder / entry).resolve()) if key == "file" and isinstance(entry, str)
                else with_absolute_files(entry, folder) for key, entry in value.items()}
    if isinstance(value, list):
        return [with_absolute_files(entry, folder) for entry in value]
    return value


def places(value, path=()):
    """The paths of all values within a document, parents first."""
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in entries:
        yield path + (key,)
        yield from places(entry, path + (key,))


def parent_of(document, path):
    for key in path[:-1]:
        document = document[key]
    return document


def rename(parent, key, name):
    """Keeps the order of the keys."""
    entries = [(name if each == key else each, entry) for each, entry in parent.items()]
    parent.clear()
    parent.update(entries)


def changes(document, path):
    """(name, whether something is missing then, change) of one value; a change is made in a copy of the document."""
    key = path[-1]
    value = parent_of(document, path)[key]

    def put(new):
        return lambda job: parent_of(job, path).__setitem__(key, copy.deepcopy(new))

    yield "left out", True, lambda job: parent_of(job, path).pop(key)
    if isinstance(key, str):
        yield "misspelt", True, lambda job: rename(parent_of(job, path), key, key[:-1] + "B")
    for new in replacements:
        if type(new) is not type(value) or new != value:
            yield f"is {json.dumps(new)}", False, put(new)
    if isinstance(value, list):
        yield "one more", False, put(value + value[-1:])
        yield "one less", False, put(value[:-1])
        yield "reversed", False, put(value[::-1])
    else:
        yield "in a list", False, put([value])
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        yield "opposite", False, put(-value)
    siblings = parent_of(document, path)
    for other in siblings if isinstance(siblings, dict) else range(len(siblings)):
        if other != key and type(siblings[other]) is type(value) and siblings[other] != value:
            yield f"is that of {other}", False, put(siblings[other])
            break


def changed(document, steps):
    """The document after these changes, or nothing where the second one lost its place by the first."""
    job = copy.deepcopy(document)
    try:
        for step in steps:
            step(job)
    except (KeyError, IndexError, TypeError, AttributeError):
        return None
    return json.dumps(job)


def mutations(jobs, everything):
    """(name, text) of the mutated jobs; the same ones in every run."""
    chance = random.Random(1)
    blocks, keys, values, pairs = [], [], [], []
    for file, document in jobs:
        changed_once, missing_once = [], []
        for path in places(document):
            pointer = "/" + "/".join(map(str, path))
            outer = len(path) <= 2 and file.parent.name == "valid"
            for what, missing, change in changes(document, path):
                one = f"{pointer} {what}", change
                changed_once.append(one)
                if missing:
                    missing_once.append(one)
                kind = values if not missing else blocks if outer else keys
                kind.append((f"{file.name}: {one[0]}", document, [change]))
        # Something missing in one place, and anything at another.
        for _ in range(len(changed_once)):
            (first, one), (second, two) = chance.choice(missing_once), chance.choice(changed_once)
            pairs.append((f"{file.name}: {first}, {second}", document, [two, one]))
    if not everything:
        keys, values, pairs = (chance.sample(kind, sample_size) for kind in (keys, values, pairs))
    for name, document, steps in blocks + keys + values + pairs:
        text = changed(document, steps)
        if text is not None:
            yield name, text


def limit_memory(orbid):
    """For all that is run; but the address sanitizer reserves more than there is."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (bytes_at_most, before[1]))
    if subprocess.run([orbid, "--version"], capture_output=True).returncode != 0:
        resource.setrlimit(resource.RLIMIT_AS, before)


def fault_of(command):
    """What is wrong with how a command ends; nothing when it gives an answer. Its exit code."""
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=seconds_at_most)
    except subprocess.TimeoutExpired:
        return f"has not ended after {seconds_at_most} s", None
    if any(sign in run.stderr for sign in sanitizers):
        return f"has a flaw: {run.stderr.strip()[:2000]}", run.returncode
    if run.returncode in answers:
        return None, run.returncode
    if run.returncode < 0:
        return f"is killed by {signal.Signals(-run.returncode).name}", run.returncode
    return f"ends with code {run.returncode}: {run.stderr.strip()[-300:]}", run.returncode


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("orbid")
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--show", action="store_true", help="the whole text of each job that fails")
    options = parser.parse_args()
    limit_memory(options.orbid)
    # What could not fail would say nothing.
    for ending in ("kill -SEGV $$", "kill -ABRT $$", "exit 4", "echo file.cpp:1:1: runtime error: >&2; exit 2"):
        if fault_of(["sh", "-c", ending])[0] is None:
            sys.exit(f"mutated_jobs.py: does not see that a program ends by {ending}")

    files = sorted((corpus / "valid").glob("*.json")) + sorted((root / "configs").glob("*.json"))
    jobs = []
    for file in files:
        document = json.loads(without_comments(file.read_text()))
        jobs.append((file, with_absolute_files(document, file.parent)))
    with tempfile.TemporaryDirectory() as folder:

        def check(numbered):
            number, (name, text) = numbered
            file = Path(folder) / f"{number}.json"
            file.write_text(text)
            fault, code = fault_of([options.orbid, "check", "--threads", "1", str(file)])
            file.unlink()
            return name, text, fault, code

        failures, codes = [], {}
        with ThreadPoolExecutor(options.jobs) as pool:
            for name, text, fault, code in pool.map(check, enumerate(mutations(jobs, options.all))):
                codes[code] = codes.get(code, 0) + 1
                if fault is None:
                    continue
                failures.append(name)
                print(f"{name}\n  orbid check {fault}")
                if options.show:
                    print(f"  {text}")
    count = sum(codes.values())
    print(f"mutated_jobs.py: {count} jobs of {len(jobs)}, exit codes {codes}, {len(failures)} failures")
    if count < 1000 or codes.get(0, 0) < 100 or codes.get(2, 0) < 500:
        print("too few jobs, or too few of them are accepted or refused: the changes do not do what they should")
        return 1
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
