#!/usr/bin/env python3
"""Blocks of code in the pages are right, as far as that can be told without running a page from its beginning.

    check_code_blocks.py FOLDER ORBID [COMPILER FLAG...]       prints FILE:LINE: what is wrong; exit code 1 if anything is

* json, jsonc: whole jobs (an object with a model and something to do) pass `orbid check`, run from configs/ so that its data
  are found; pieces of jobs and of results parse as JSON with comments, no key twice.
* cpp: whole programs compile (adding_a_model.md is compiled and run by tests/house/adding_a_model.sh).
* Commands of the text, `orbid COMMAND --option file.json` and `./dev COMMAND`: command and options are in the program's help, and
  jobs of the project that are named exist.

Blocks of pages that are run (run_pages.py) take part in all of this but `orbid check`: their data exist only there.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import commented_json
from markdown_page import pages_of, read_page


def is_whole_job(value):
    return isinstance(value, dict) and "model" in value and bool({"data", "periodic", "estimate", "orbits"} & set(value))


def check_json(block, orbid, configs, ran_elsewhere):
    """Messages about a block of JSON, each as (line within the block, text), and whether it was a whole job."""
    try:
        value = commented_json.parse(block.text)
    except ValueError:
        try:
            commented_json.parse_pieces(block.text)
        except ValueError as error:
            return [(getattr(error, "lineno", 1), f"not JSON with comments: {getattr(error, 'msg', error)}")], False
        return [], False
    if not is_whole_job(value) or ran_elsewhere:
        return [], False
    with tempfile.NamedTemporaryFile("w", suffix=".json", dir=configs, prefix=".page_") as job:
        job.write(block.text)
        job.flush()
        ran = subprocess.run([orbid, "check", job.name], capture_output=True, text=True)
    if ran.returncode == 0:
        return [], True
    return [(1, "orbid check refuses this job: " + (ran.stderr or ran.stdout).strip().replace(job.name, "JOB"))], True


def check_cpp(block, compiler):
    """Messages about a block of C++: whole programs must compile."""
    if not compiler or not re.search(r"^int main\(", block.text, re.M):
        return [], False
    with tempfile.NamedTemporaryFile("w", suffix=".cpp") as source:
        source.write(block.text)
        source.flush()
        ran = subprocess.run([*compiler, "-std=c++20", "-fsyntax-only", source.name], capture_output=True, text=True)
    if ran.returncode == 0:
        return [], True
    line = re.search(rf"^{re.escape(source.name)}:(\d+)", ran.stderr, re.M)
    return [(int(line[1]) if line else 1, "does not compile: " + ran.stderr.strip().split("\n")[0])], True


class Commands:
    """Commands and options of `orbid` and `./dev`, asked from their help."""

    def __init__(self, orbid, dev):
        text = subprocess.run([orbid, "--help"], capture_output=True, text=True, check=True).stdout
        self.orbid = dict.fromkeys(re.findall(r"^  ([a-z]+) ", text, re.M))
        self.dev = set(re.findall(r"^  ([a-z]+) ", subprocess.run([dev, "help"], capture_output=True, text=True).stdout, re.M))
        self.program = orbid
        if not self.orbid or not self.dev:
            raise SystemExit("check_code_blocks: no commands in the help: the search is broken")

    def options(self, command):
        if self.orbid[command] is None:
            ran = subprocess.run([self.program, command, "--help"], capture_output=True, text=True)
            self.orbid[command] = set(re.findall(r"--[a-z][a-z-]*", ran.stdout)) | {"--help"}
        return self.orbid[command]

    def problems(self, line):
        """What is wrong in a line of the text that calls orbid or ./dev; nothing for other lines."""
        call = re.match(r"\s*(?:\$ )?(?:time )?(?:\S*/)?orbid +(.+)", line)
        if call:
            words = re.split(r"\s{2,}|[|>&;#]", call[1])[0].split()
            command = words[0]
            if not re.fullmatch(r"[a-z]+", command):
                return []
            if command not in self.orbid and command != "help":
                return [f"orbid has no command {command}"]
            if command == "help":
                return []
            return [f"orbid {command} has no option {word}" for word in words
                    if word.startswith("--") and word.split("=")[0] not in self.options(command)]
        call = re.match(r"\s*\./dev +([a-z]+)", line)
        if call and call[1] not in self.dev:
            return [f"./dev has no command {call[1]}"]
        return []


def check_pages(root, orbid, compiler, run_pages):
    """List of "file:line: message", and counts by kind of block."""
    root = Path(root).resolve()
    commands = Commands(orbid, root / "dev")
    found, counts = [], {"jobs": 0, "pieces": 0, "programs": 0, "commands": 0}
    for path in pages_of(root):
        page, name = read_page(path), path.relative_to(root)
        executed = str(name) in run_pages
        for block in page.blocks:
            messages = []
            if block.language in ("json", "jsonc"):
                messages, whole = check_json(block, orbid, root / "configs", executed)
                counts["jobs" if whole else "pieces"] += 1
            elif block.language == "cpp":
                messages, whole = check_cpp(block, compiler)
                counts["programs"] += whole
            elif block.language == "sh" and not executed:
                found.append(f"{name}:{block.line}: a page with blocks that can be run, but not listed in run_pages.json")
            found += [f"{name}:{block.line + line - 1}: {text}" for line, text in messages]
        for number, line in enumerate(path.read_text(encoding="utf-8").split("\n"), 1):
            if re.match(r"\s*(\$ )?(time )?(\S*/)?orbid +[a-z]+( |$)|\s*\./dev +[a-z]", line) and name.name != "CHANGELOG.md":
                if not re.match(r" {4}|\t", line) and not any(
                        b.line <= number < b.line + b.text.count("\n") and b.language in ("sh", "") for b in page.blocks):
                    continue  # prose that begins with the program's name
                counts["commands"] += 1
                found += [f"{name}:{number}: {text}" for text in commands.problems(line)]
                for job in re.findall(r"\bconfigs/[\w/.]+\.json\b", line):
                    if not (root / job).exists() and "new" not in line:
                        found.append(f"{name}:{number}: there is no {job}")
    return found, counts


if __name__ == "__main__":
    listed = json.loads((Path(__file__).parent / "run_pages.json").read_text())
    ran = {page for group in listed for page in group["pages"]}
    messages, counts = check_pages(sys.argv[1], sys.argv[2], sys.argv[3:], ran)
    summary = ", ".join(f"{count} {kind}" for kind, count in counts.items())
    print("\n".join(messages) if messages else f"code blocks: {summary}, all right")
    sys.exit(1 if messages or not counts["pieces"] else 0)
