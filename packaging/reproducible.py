#!/usr/bin/env python3
"""Builds one commit twice, in folders of other names, without a compiler cache, and compares what comes out to the byte.

    reproducible.py [--packages] [--objects REGEX] [--commit HEAD] [--jobs N] [--keep FOLDER]

Compared are the program, its libraries and the plug-in for MPI; with --packages the Debian packages as well, which
takes three times as long. --objects compares only the object files whose paths match, in minutes. Exit code 1: they
differ, and the folders stay.
"""

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def run(arguments, **more):
    result = subprocess.run([str(a) for a in arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **more)
    if result.returncode != 0:
        sys.exit(f"{' '.join(map(str, arguments))}\n{result.stdout[-3000:]}")
    return result.stdout


def build(source, preset, objects, jobs, environment):
    """The files to compare, by their names within the build folder."""
    run(["cmake", "--preset", preset, "-DORBID_TESTS=OFF", "-DCMAKE_CXX_COMPILER_LAUNCHER="], cwd=source, env=environment)
    folder = source / "build" / preset
    if objects:
        targets = [line.split(":")[0] for line in run(["ninja", "-C", folder, "-t", "targets", "all"]).splitlines()]
        wanted = [t for t in targets if t.endswith(".o") and re.search(objects, t) and "verify" not in t]
        if not wanted:
            sys.exit(f"no object file matches {objects}")
        run(["ninja", "-C", folder, "-j", jobs, *wanted], env=environment)
        return {name: folder / name for name in wanted}
    run(["ninja", "-C", folder, "-j", jobs, *(["all"] if preset == "package" else ["orbid"])], env=environment)
    files = [folder / "bin/orbid", *(f for f in (folder / "lib").rglob("*") if f.is_file() and not f.is_symlink())]
    if preset == "package":
        run(["cpack", "--config", folder / "CPackConfig.cmake", "-B", folder], cwd=folder, env=environment)
        files += folder.glob("*.deb")
    return {str(file.relative_to(folder)): file for file in files}


def differences(first, second):
    digest = lambda file: hashlib.sha256(file.read_bytes()).hexdigest()
    for name in sorted(first.keys() | second.keys()):
        if name not in first or name not in second:
            yield name, "there in one build only"
        elif digest(first[name]) != digest(second[name]):
            yield name, f"{first[name]} and {second[name]} differ"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--packages", action="store_true")
    parser.add_argument("--objects", default="")
    parser.add_argument("--commit", default="HEAD")
    parser.add_argument("--jobs", default=os.environ.get("ORBID_JOBS", str(os.cpu_count())))
    parser.add_argument("--keep", help="a folder for both builds, which stay there")
    options = parser.parse_args()
    commit = run(["git", "rev-parse", options.commit], cwd=ROOT).strip()
    environment = {**os.environ, "CCACHE_DISABLE": "1",
                   "SOURCE_DATE_EPOCH": run(["git", "log", "-1", "--format=%ct", commit], cwd=ROOT).strip()}
    scratch = Path(options.keep or tempfile.mkdtemp())
    built = []
    for name in ("a", "another/and longer/folder".replace(" ", "_")):
        source = scratch / name
        source.parent.mkdir(parents=True, exist_ok=True)
        run(["git", "clone", "-q", "--no-checkout", ROOT, source])
        run(["git", "-C", source, "checkout", "-q", commit])
        built.append(build(source, "package" if options.packages else "release", options.objects, options.jobs, environment))
        environment = {**environment, "TZ": "Pacific/Auckland", "LC_ALL": "C.UTF-8"}
    found = list(differences(*built))
    for name, what in found:
        print(f"{name}: {what}")
    print(f"{commit}: {len(built[0])} files compared, {len(found)} differ")
    if not found and not options.keep:
        shutil.rmtree(scratch)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
