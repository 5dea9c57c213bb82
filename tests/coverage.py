#!/usr/bin/env python3
"""Lines and branches of product code that the tests reach, by room, from a build with the preset `coverage`.

    coverage.py BUILD [--page docs/validation.md] [--worst 20]

Reads the profiles that BUILD/profiles holds (LLVM_PROFILE_FILE), merges them, and prints a table; --page writes it
between the marks in the page. --worst lists the files with the most lines that nothing reached.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ["models", "periodic", "orbits", "estimator", "identification", "apps"]
BEGIN, END = "<!-- written by ./dev coverage -->", "<!-- end of coverage -->"


def tool(name):
    found = next((p for p in (shutil.which(name), shutil.which(f"{name}-14")) if p), None)
    return found or sys.exit(f"there is no {name}; it comes with Clang (Debian: package llvm)")


def exported(build):
    profiles = sorted(map(str, (build / "profiles").glob("*.profraw")))
    if not profiles:
        sys.exit(f"{build / 'profiles'} holds no profiles; run the tests first")
    merged = build / "merged.profdata"
    subprocess.run([tool("llvm-profdata"), "merge", "-sparse", "--failure-mode=all", "-o", merged, *profiles], check=True)
    programs = [p for p in (build / "bin").iterdir() if os.access(p, os.X_OK) and p.is_file()]
    programs += [p for p in (build / "lib").glob("liborbid.so.*") if not p.is_symlink()]
    objects = [argument for p in programs for argument in ("-object", str(p))]
    text = subprocess.run([tool("llvm-cov"), "export", "-summary-only", f"-instr-profile={merged}", *objects[1:]],
                          check=True, capture_output=True, text=True).stdout
    return json.loads(text)["data"][0]["files"]


def rooms_of(files):
    rooms, worst = defaultdict(lambda: [0, 0, 0, 0]), []
    for file in files:
        path = os.path.relpath(file["filename"], ROOT)
        room = path.split("/")[0]
        if room not in ROOMS:
            continue
        lines, branches = file["summary"]["lines"], file["summary"]["branches"]
        for k, value in enumerate((lines["covered"], lines["count"], branches["covered"], branches["count"])):
            rooms[room][k] += value
        worst.append((lines["count"] - lines["covered"], lines["count"], path))
    return rooms, sorted(worst, reverse=True)


def table(rooms):
    share = lambda part, whole: f"{100 * part / whole:.1f} %" if whole else ""
    row = lambda name, c: f"| {name} | {c[1]} | {share(c[0], c[1])} | {share(c[2], c[3])} |"
    total = [sum(c[k] for c in rooms.values()) for k in range(4)]
    return "\n".join(["| room | lines with code | reached | branches reached |", "|---|---|---|---|",
                      *(row(f"`{room}/`", rooms[room]) for room in ROOMS if room in rooms), row("all", total)])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=Path)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--worst", type=int, default=20)
    options = parser.parse_args()
    rooms, worst = rooms_of(exported(options.build))
    text = table(rooms)
    print(text)
    for missed, count, path in worst[:options.worst]:
        print(f"{missed:5d} of {count:5d} lines not reached: {path}")
    if options.page:
        page = options.page.read_text(encoding="utf-8")
        if BEGIN not in page or END not in page:
            sys.exit(f"{options.page} has no marks for the table")
        options.page.write_text(re.sub(f"{BEGIN}.*?{END}", lambda _: f"{BEGIN}\n\n{text}\n\n{END}", page, flags=re.S),
                                encoding="utf-8")


if __name__ == "__main__":
    main()
