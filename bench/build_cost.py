#!/usr/bin/env python3
"""What building costs on this machine.

    build_cost.py [release|develop]   processor seconds of a full build of the program, by folder, and its dearest files
    build_cost.py changes             wall seconds until the program is linked again after a one-line change
    build_cost.py models              processor seconds after a change in a model, over those of a file that only
                                      includes Boost.Odeint and Eigen

`./dev build-cost` calls it. The build folders are its own (build/cost_*), no cache takes part. ORBID_JOBS limits the
number of compilers at once.
"""

import json
import os
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DEAREST = 20
REPETITIONS = 3
# Each stands for a kind of change: the program's own code, the estimator, numerics of orbits, two models, the job.
CHANGES = ["apps/program/run.cpp", "estimator/minimisation/minimum.cpp", "orbits/local_maps/noise_level.cpp",
           "models/catalogue/lorenz.hpp", "models/catalogue/double_pendulum.hpp", "apps/job/job.hpp"]
MODELS = ["duffing", "parametric_pendulum"]


def run(*command, **options):
    """Runs a command; its output is shown only when it fails."""
    result = subprocess.run(command, cwd=ROOT, text=True, capture_output=True, **options)
    if result.returncode != 0:
        sys.exit(f"{result.stdout[-4000:]}{result.stderr[-4000:]}\nbuild cost: {' '.join(map(str, command))} failed")
    return result.stdout


def configure(preset, folder, *options):
    # Its own folder: an interrupted measurement must not leave objects that the next one would not count.
    run("cmake", "--preset", preset, "-B", folder, *options, "-DORBID_TESTS=OFF", "-DORBID_PYTHON=OFF")


def build(folder, *targets):
    jobs = os.environ.get("ORBID_JOBS", str(os.cpu_count()))
    return run("cmake", "--build", folder, "--parallel", jobs, "--target", *targets)


def children():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def folder_of(source, build_folder):
    """The folder of the tree that a source belongs to; a batch's, a model's or a shape's is told by its name."""
    path = Path(source)
    if path.is_relative_to(build_folder):
        inside = path.relative_to(build_folder)
        batch = re.match(r"(.+)_batch_\d+$", inside.stem)
        if batch:
            nested = ROOT / inside.parent / batch[1].replace("_", "/")
            return str(inside.parent / (batch[1] if not nested.is_dir() else batch[1].replace("_", "/")))
        return f"{inside.parent} (made by the build)"
    return str(path.relative_to(ROOT).parent) if path.is_relative_to(ROOT) else "other"


def full(preset):
    folder = ROOT / "build" / f"cost_{preset}"
    shutil.rmtree(folder, ignore_errors=True)
    log = ROOT / "build" / f"cost_{preset}.txt"
    log.unlink(missing_ok=True)
    # A launcher in front of each compiler call: bash alone, nothing to install.
    launcher = ROOT / "build" / "cost_launcher.sh"
    launcher.write_text('#!/bin/bash\nTIMEFORMAT="%U %S"\n'
                        '{ time "${@:2}" 2>&3; } 3>&2 2>"$1.$$"; status=$?\n'
                        'source=none\nfor word in "${@:2}"; do [[ $word == *.cpp || $word == *.cxx ]] && source=$word; done\n'
                        'echo "$(cat "$1.$$") $source" >>"$1"; rm "$1.$$"; exit $status\n')
    launcher.chmod(0o755)
    configure(preset, folder, f"-DCMAKE_CXX_COMPILER_LAUNCHER={launcher};{log}")
    begin, before = time.monotonic(), children()
    build(folder, "orbid")
    wall, total = time.monotonic() - begin, children() - before
    seconds = {}
    for line in log.read_text().splitlines():
        user, system, source = line.split(" ", 2)
        seconds[source] = seconds.get(source, 0.0) + float(user) + float(system)
    folders = defaultdict(float)
    for source, cost in seconds.items():
        folders[folder_of(source, folder)] += cost
    print(f"{preset}: {total:.0f} s of processor time, {wall:.0f} s on {os.cpu_count()} processors, "
          f"{len(seconds)} files compiled\n")
    for name, cost in sorted(folders.items(), key=lambda item: -item[1]):
        print(f"{cost:8.1f} s  {name}")
    print(f"{total - sum(seconds.values()):8.1f} s  linking and all else\n")
    for source, cost in sorted(seconds.items(), key=lambda item: -item[1])[:DEAREST]:
        print(f"{cost:8.1f} s  {os.path.relpath(source, folder if source.startswith(str(folder)) else ROOT)}")


def changes():
    folder = ROOT / "build" / "cost_develop"
    configure("develop", folder, "-DCMAKE_CXX_COMPILER_LAUNCHER=")
    build(folder, "orbid")
    for name in CHANGES:
        file, text = ROOT / name, (ROOT / name).read_text()
        times = []
        try:
            for repetition in range(REPETITIONS if not name.endswith("job.hpp") else 1):
                # A line more, so that the object differs and the library is linked anew.
                file.write_text(f"{text}\n// {repetition}\n")
                begin = time.monotonic()
                build(folder, "orbid")
                times.append(time.monotonic() - begin)
        finally:
            file.write_text(text)
        print(f"{statistics.median(times):8.1f} s  {name}", flush=True)


def models():
    folder = ROOT / "build" / "cost_develop"
    configure("develop", folder, "-DCMAKE_CXX_COMPILER_LAUNCHER=")
    build(folder, "orbid_models")
    commands = json.loads((folder / "compile_commands.json").read_text())
    compiler = commands[0]["command"].split()[0]

    def median(call):
        costs = []
        for _ in range(REPETITIONS):
            before = children()
            call()
            costs.append(children() - before)
        return statistics.median(costs)

    with tempfile.TemporaryDirectory() as scratch:
        peer = Path(scratch) / "peer.cpp"
        peer.write_text("#include <boost/numeric/odeint.hpp>\n#include <Eigen/Dense>\n")
        cost_of_peer = median(lambda: run(compiler, "-std=c++20", "-O2", "-isystem", "/usr/include/eigen3", "-c", peer,
                                          "-o", Path(scratch) / "peer.o"))
    print(f"{cost_of_peer:8.1f} s  Boost.Odeint and Eigen alone")

    def again(model):
        (ROOT / f"models/catalogue/{model}.hpp").touch()
        build(folder, "orbid_models")

    for model in MODELS:
        cost = median(lambda model=model: again(model))
        print(f"{cost:8.1f} s  {model}, ratio {cost / cost_of_peer:.2f}")


if __name__ == "__main__":
    kind = sys.argv[1] if len(sys.argv) > 1 else "release"
    if kind not in ("release", "develop", "changes", "models"):
        sys.exit(__doc__)
    {"changes": changes, "models": models}.get(kind, lambda: full(kind))()
