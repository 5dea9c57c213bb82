#!/usr/bin/env python3
"""The house keeps its order: who includes whom, what a library never does, which folder holds what.

    include_arrows.py [FOLDER]      prints FILE:LINE: what is wrong; exit code 1 if anything is

All rooms share one include root, so the linker cannot hold the arrows between them: arrows.txt beside this file does.
"""

import re
import sys
from collections import defaultdict
from pathlib import Path

HERE = Path(__file__).resolve().parent
INCLUDE = re.compile(r'^ *# *include +["<]([^">]+)[">]')
# What a library must not do: read or write JSON, print, end the program. snprintf formats in memory and is no printf.
FORBIDDEN = re.compile(
    r"nlohmann|<iostream>|\b(cout|cerr|clog|stdout|stderr)\b|\bfmt::print|\b(v?printf|puts|putchar|perror)\b *\("
    r"|\b(exit|quick_exit|_Exit|abort|terminate) *\(")
# Dear to compile: they stand behind plain functions, each compiled once.
DECOMPOSITION = re.compile(r"^(unsupported/)?Eigen/(Cholesky|QR|LU|SVD|Eigenvalues|Dense|Eigen|Sparse.*)$")
MAY_DECOMPOSE = {*(f"models/arithmetic/{kind}.cpp" for kind in (
    "cholesky_factor", "eigenvalues", "lu_factor", "orthogonal_factor", "singular_values")),
    "periodic/solution/closing_equations.cpp"}
LARGEST_FOLDER = 45
LONGEST_README = 8


def read_arrows(file):
    """Rooms and folders, each with the set of what it may include."""
    arrows = {}
    for line in file.read_text(encoding="utf-8").splitlines():
        if line.strip() and not line.startswith("#"):
            name, _, targets = line.partition(":")
            arrows[name] = set(targets.split())
    return arrows


def cycles(arrows):
    """Folders of a room that reach themselves."""
    for start in arrows:
        room, _, _ = start.partition("/")
        reached, todo = set(), [f"{room}/{target}" for target in arrows[start] if "/" in start]
        while todo:
            folder = todo.pop()
            if folder not in reached:
                reached.add(folder)
                todo += [f"{room}/{target}" for target in arrows.get(folder, ())]
        if start in reached:
            yield f"arrows.txt: {start} includes itself in a circle"


def allowed(arrows, file, included):
    """Whether a file may include a header, both relative to the root."""
    room, target = file.split("/")[0], included.split("/")[0]
    if room != target:
        return target in arrows[room] or included in arrows[room]
    folder, other = str(Path(file).parent), str(Path(included).parent)
    folder = folder if "/" in folder else f"{folder}/"
    return folder == other or other.partition("/")[2] in arrows.get(folder, ())


def complaints(root):
    """Everything that is wrong, and the number of includes looked at."""
    arrows = read_arrows(HERE / "arrows.txt")
    rooms = [name for name in arrows if "/" not in name]
    found, seen, names = list(cycles(arrows)), 0, defaultdict(list)
    for top in [*rooms, "tests", "bench"]:
        for path in sorted([*root.glob(f"{top}/**/*.cpp"), *root.glob(f"{top}/**/*.hpp")]):
            file = str(path.relative_to(root))
            names[path.name].append(file)
            if top not in rooms:
                continue
            folder = str(Path(file).parent)
            if (folder if "/" in folder else f"{folder}/") not in arrows:
                found.append(f"{file}: arrows.txt does not know its folder")
                continue
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
                include = INCLUDE.match(line)
                if include and include[1].split("/")[0] in [*rooms, "tests", "bench"]:
                    seen += 1
                    if not allowed(arrows, file, include[1]):
                        found.append(f"{file}:{number}: may not include {include[1]} (tests/house/arrows.txt)")
                if include and DECOMPOSITION.match(include[1]) and file not in MAY_DECOMPOSE:
                    found.append(f"{file}:{number}: {include[1]} is dear to compile: call a function of models/arithmetic/")
                if top not in ("apps", "python") and FORBIDDEN.search(line.partition("//")[0]):
                    found.append(f"{file}:{number}: JSON, printing and exiting belong to apps/ alone")
    found += [f"{', '.join(files)}: one name for several files" for files in names.values() if len(files) > 1]
    for name in arrows:
        folder = root / name
        if not folder.is_dir():
            found.append(f"arrows.txt: there is no folder {name}")
            continue
        count = sum(1 for path in folder.iterdir() if path.is_file())
        if count > LARGEST_FOLDER + 1:
            found.append(f"{name}: {count} files, more than {LARGEST_FOLDER} and a README: which folders are they?")
        readme = folder / "README.md"
        if not readme.is_file():
            found.append(f"{name}: no README.md says what it holds")
        elif "/" in name.rstrip("/") and len(readme.read_text(encoding="utf-8").splitlines()) > LONGEST_README:
            found.append(f"{readme.relative_to(root)}: more than {LONGEST_README} lines")
    return found, seen


def trials():
    """The search sees what it must see, and nothing else."""
    for text in ('std::printf("x");', 'std::fprintf(stderr, "x");', 'fmt::print("x");', "cout << 1;", "std::exit (1);"):
        assert FORBIDDEN.search(text), text
    for text in ('std::snprintf(text, 9, "x");', "early_exit(1);", "at_exit = 1;", "inputs(1);"):
        assert not FORBIDDEN.search(text), text
    arrows = {"a": set(), "b": {"a", "c/d/e.hpp"}, "b/x": set(), "b/y": {"x"}}
    assert allowed(arrows, "b/y/f.cpp", "b/x/f.hpp") and not allowed(arrows, "b/x/f.cpp", "b/y/f.hpp")
    assert allowed(arrows, "b/x/f.cpp", "a/x/f.hpp") and not allowed(arrows, "a/x/f.cpp", "b/x/f.hpp")
    assert allowed(arrows, "b/x/f.cpp", "c/d/e.hpp") and not allowed(arrows, "b/x/f.cpp", "c/d/f.hpp")
    assert not list(cycles(arrows)) and list(cycles({"b/x": {"y"}, "b/y": {"x"}}))


if __name__ == "__main__":
    trials()
    messages, includes = complaints(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE.parents[1])
    for message in messages:
        print(message, file=sys.stderr)
    if not includes:
        sys.exit("include arrows: no include found, the search is broken")
    if messages:
        sys.exit(1)
    print(f"include arrows: {includes} includes, all allowed")
