#!/usr/bin/env python3
"""Builds the fuzzer: what takes bytes from outside by Clang with sanitizers, the rest from a finished release build.

    build.py BUILD [--jobs N]

BUILD is the folder of the release build, whose compile commands and static libraries are used. Of the rooms' sources only
those that read are compiled anew, by the batches of that build. The program is BUILD/fuzz/orbid_fuzz.
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
# What reads texts and files: folders whose batches are instrumented.
READING = ["models/formulas_batch", "models/equations_batch", "orbits/records_batch", "orbits/records/matlab_file",
           "apps/documents_batch", "apps/results_batch", "apps/stored_run_batch", "apps/job_batch",
           "apps/job/reading/job_reader", "apps/job_blocks_batch", "apps/report_plots_batch", "apps/report_batch"]
TARGETS = ["target", "text_targets", "file_targets", "libfuzzer"]
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
    entries = {}
    for entry in json.loads((build / "compile_commands.json").read_text()):
        path = Path(entry["file"])
        base = build if path.is_relative_to(build) else ROOT
        entries[str(path.relative_to(base))] = shlex.split(entry["command"])
    work, flags = [], None
    for file, words in entries.items():
        if any(file.startswith(each) for each in READING):
            source = next(base / file for base in (build, ROOT) if (base / file).exists())
            work.append((source, out / (file.replace("/", "_") + ".o"), kept(words)))
        if file.startswith("apps/results_batch"):
            flags = kept(words)
    for target in TARGETS:
        work.append((Path(__file__).with_name(f"{target}.cpp"), out / f"{target}.o", flags))
    return work


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
    subprocess.run(["clang++", "-fsanitize=fuzzer,address,undefined", "-o", str(program), *[str(thing) for _, thing, _ in work],
                    "-Wl,--start-group", *libraries, "-Wl,--end-group", *LINKED], check=True)
    print(program)


if __name__ == "__main__":
    main()
