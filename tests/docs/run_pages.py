#!/usr/bin/env python3
"""Runs pages as a reader would, block by block, and compares what is printed with what they say.

    run_pages.py ROOT ORBID GROUP [--cache FOLDER] [--keep FOLDER] [--write]

GROUP is an entry of run_pages.json: pages that are read one after another, in one scratch folder, with orbid on the PATH
and the project's configs/ beside.

* A block of json, jsonc or python whose first line is a comment that begins with the name of a file is written to that file:
  what the reader sees is what runs.
* A block `sh` is run by bash, which stops at the first command that fails.
* A block `text` after it is what it prints, on standard error too, less the lines of progress, which hold times; the scratch
  folder is called /home/you. compare_output.py compares. Without such a block, output is not looked at.
* A picture of the page that lies in the page's own folder must be among the files the blocks have made, as large as the one in
  the folder within a factor of two.

--keep leaves the scratch folder in FOLDER; --write puts its pictures into the pages' folders and its output into their blocks.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from compare_output import difference
from markdown_page import read_page

# "orbits         0.72 s  137 cycles from 479 candidates"
PROGRESS = re.compile(r"^[a-z][a-z ]*? {2,}[\d.]+ (?:s|min|h)(?: .*)?$\n?", re.M)
FILE_NAME = re.compile(r"^(?://|#) ([\w-]+\.(?:jsonc?|py|csv))\b")


def run_block(text, folder, environment):
    ran = subprocess.run(["bash", "-e", "-o", "pipefail", "-c", text], cwd=folder, env=environment, text=True,
                         stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    return ran.returncode, PROGRESS.sub("", ran.stdout).replace(f"{Path(folder).resolve()}/", "/home/you/")


def run_page(path, folder, environment, report, rewrite=None):
    """Messages (line, text) about one page; its files and outputs stay in `folder`. `rewrite` collects (block, new text)."""
    page, found, last = read_page(path), list(read_page(path).problems), None
    ran = 0
    for block in page.blocks:
        name = FILE_NAME.match(block.text)
        if name and block.language in ("json", "jsonc", "python"):
            (folder / name[1]).write_text(block.text, encoding="utf-8")
        if block.language == "sh":
            begin = time.monotonic()
            code, out = run_block(block.text, folder, environment)
            report(f"{path.name}:{block.line}: {time.monotonic() - begin:.1f} s")
            ran += 1
            last = (block, out)
            if code:
                found.append((block.line, f"exit code {code}\n{out.rstrip()}"))
                break  # what follows rests on it
        elif block.language == "text" and last:
            differs = difference(block.text, last[1], block.options)
            if differs:
                found.append((block.line + differs[0], differs[1]))
                if rewrite is not None:
                    rewrite.append((block, last[1]))
            last = None
    if not ran:
        found.append((1, "nothing in this page is run"))
    for link in page.links:
        if link.picture and "/" not in link.target:
            made, shown = folder / link.target, path.parent / link.target
            if not made.exists():
                found.append((link.line, f"no block of this page makes the picture {link.target}"))
            elif shown.exists() and not 0.5 < made.stat().st_size / max(1, shown.stat().st_size) < 2:
                found.append((link.line, f"{link.target} is not what the page's commands make: {shown.stat().st_size} bytes "
                                         f"in the page's folder, {made.stat().st_size} made"))
    return found


def write_back(path, folder, changes):
    """Puts pictures and outputs of a run into the page's folder and text; outputs with `...` are left to the author."""
    for link in read_page(path).links:
        if link.picture and "/" not in link.target and (folder / link.target).exists():
            shutil.copy(folder / link.target, path.parent / link.target)
    lines = path.read_text(encoding="utf-8").split("\n")
    for block, text in reversed(changes):
        if "…" not in block.text and "..." not in block.text.split("\n"):
            first = block.line - 1
            lines[first:first + block.text.count("\n")] = text.strip("\n").split("\n")
    path.write_text("\n".join(lines), encoding="utf-8")


def run_group(root, orbid, pages, folder, cache=None, write=False, report=lambda line: None):
    """Runs pages in order in one folder. Messages "page:line: text"."""
    environment = dict(os.environ, PATH=f"{Path(orbid).resolve().parent}{os.pathsep}{os.environ['PATH']}", LC_ALL="C.UTF-8",
                       ORBID_SOURCE=str(Path(root).resolve()))
    if cache:
        environment["XDG_CACHE_HOME"] = str(Path(cache).resolve())
    if (Path(root) / "configs").exists() and not (Path(folder) / "configs").exists():
        (Path(folder) / "configs").symlink_to(Path(root).resolve() / "configs")
    found = []
    for name in pages:
        path, changes = Path(root) / name, []
        messages = run_page(path, Path(folder), environment, report, changes)
        if write:
            write_back(path, Path(folder), changes)
        found += [f"{name}:{line}: {text}" for line, text in messages]
    return found


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("root")
    parser.add_argument("orbid")
    parser.add_argument("group")
    parser.add_argument("--cache")
    parser.add_argument("--keep")
    parser.add_argument("--write", action="store_true")
    words = parser.parse_args()
    groups = {group["name"]: group["pages"] for group in json.loads((Path(__file__).parent / "run_pages.json").read_text())}
    if words.group not in groups:
        parser.error(f"no group {words.group}; there are {', '.join(groups)}")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(words.keep or scratch)
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            parser.error(f"{folder} is not empty: what lies there would be taken for results of the page")
        begin = time.monotonic()
        found = run_group(words.root, words.orbid, groups[words.group], folder, words.cache, words.write, print)
    print("\n".join(found) if found else f"{words.group}: {len(groups[words.group])} pages, {time.monotonic() - begin:.0f} s, "
          "as they say")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
