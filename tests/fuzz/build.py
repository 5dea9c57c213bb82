#!/usr/bin/env python3
"""Builds the fuzzer: what takes bytes from outside by Clang with sanitizers, the rest from a finished release build.

    build.py BUILD [--jobs N]

BUILD is the folder of the release build, whose compile commands and static libraries are used. Of the rooms' sources only
those that read are compiled anew; the linker takes them before those of the libraries. The program is
BUILD/fuzz/orbid_fuzz.
"""

import argparse
import json
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SANITIZERS = ["-fsanitize=fuzzer-no-link,address,undefined", "-fno-sanitize=null,alignment,object-size,vptr,function",
              "-fno-sanitize-recover=all", "-fno-omit-frame-pointer"]
# What reads texts and files.
READING = {
    "models/formulas": ["expression", "expression_graph", "expression_derivative"],
    "models/equations": ["equation_reader", "equation_switching", "equation_text", "equations"],
    "orbits/records": ["csv_file", "data_file", "hdf5_stream", "nearest_name", "record_part", "text_table"],
    "apps/documents": ["fingerprint", "json_document", "json_reader", "json_value", "printable", "schema_check"],
    "apps/job/reading": ["job_reader"],
    "apps/results": ["branch_file", "cycle_reader", "orbit_file"],
    "apps/stored_run": ["stored_run", "stored_shape"],
}
TARGETS = ["target", "record_targets", "document_targets", "libfuzzer"]
LIBRARIES = ["apps", "identification", "orbits", "periodic", "estimator", "models"]
LINKED = ["-lfmt", "-ltbb", "-lcrypto", "-lboost_program_options", "-lsqlite3", "-lz", "-ldl", "-lpthread"]


def kept(words):
    """Include folders, definitions and the standard of a command of GCC; its precompiled header is GCC's own."""
    flags, skip = [], False
    for i, word in enumerate(words):
        if skip:
            skip = False
        elif word in ("-isystem", "-D", "-I"):
            flags += [word, words[i + 1]]
            skip = True
        elif word in ("-include", "-o", "-c", "-MF", "-MT"):
            skip = True
        elif word.startswith(("-I", "-D", "-std=", "-ffp-contract")):
            flags.append(word)
    return flags


def commands(build, out):
    """Sources with their objects and flags; those of a room are those of any of its batches."""
    flags = {}
    for entry in json.loads((build / "compile_commands.json").read_text()):
        path = Path(entry["file"])
        room = path.relative_to(build if path.is_relative_to(build) else ROOT).parts[0]
        if "_batch_" in path.name and room not in flags:
            flags[room] = kept(shlex.split(entry["command"]))
    work = [(ROOT / folder / f"{name}.cpp", out / f"{folder}/{name}.o".replace("/", "_"), flags[folder.split("/")[0]])
            for folder, names in READING.items() for name in names]
    return work + [(Path(__file__).with_name(f"{name}.cpp"), out / f"{name}.o", flags["apps"]) for name in TARGETS]


def compiled(job):
    source, thing, flags = job
    depends = thing.with_suffix(".d")
    if thing.exists() and depends.exists():
        files = depends.read_text().replace("\\\n", " ").split(":", 1)[1].split()
        if all(Path(f).exists() and Path(f).stat().st_mtime <= thing.stat().st_mtime for f in files):
            return None
    command = ["clang++", *flags, "-O1", "-g1", "-w", "-UNDEBUG", "-I", str(ROOT), *SANITIZERS, "-MMD", "-MF", str(depends), "-c",
               str(source), "-o", str(thing)]
    run = subprocess.run(command, capture_output=True, text=True)
    return None if run.returncode == 0 else f"{source}:\n{run.stderr[:3000]}"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("build", type=Path)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    build, out = options.build.resolve(), options.build.resolve() / "fuzz"
    out.mkdir(exist_ok=True)
    work = commands(build, out)
    with ThreadPoolExecutor(options.jobs) as pool:
        failures = [failure for failure in pool.map(compiled, work) if failure]
    if failures:
        sys.exit("\n".join(failures))
    program = out / "orbid_fuzz"
    libraries = [str(build / room / f"liborbid_{room}.a") for room in LIBRARIES]
    subprocess.run(["clang++", "-fsanitize=fuzzer,address,undefined", "-Wl,--allow-multiple-definition", "-o", str(program), *[str(thing) for _, thing, _ in work],
                    "-Wl,--start-group", *libraries, "-Wl,--end-group", *LINKED], check=True)
    print(program)


if __name__ == "__main__":
    main()
