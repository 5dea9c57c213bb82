#!/usr/bin/env python3
"""docs/api.md names every header that is installed, no other, and only names that the headers hold; each with types of Eigen
refuses programs that would allocate them otherwise. Headers that are there for templates alone are named in a section of
their own, one by one or by their folder.

    check_api.py SOURCE_FOLDER INSTALLED_HEADER...      headers as CMake installs them: models/system/system.hpp ...
"""

import re
import sys
from pathlib import Path


LAYOUT = r'#include "(models/arithmetic/matrix_layout|estimator/interface/eigen_layout).hpp"'
ROOM = r"(?:models|periodic|orbits|estimator|identification|apps)"
FOR_TEMPLATES = "## Headers for templates alone"


def names_of(page):
    """(headers that the page names as public, headers and folders that it says are there for templates alone)"""
    text, _, rest = page.partition(FOR_TEMPLATES)
    others, _, text_after = rest.partition("\n## ")
    return (set(re.findall(rf"`({ROOM}/[\w/]+\.hpp)`", text + text_after)),
            set(re.findall(rf"`({ROOM}/[\w/]+(?:/|\.hpp))`", others)))


def public_headers(root, installed):
    """Those of the installed headers that a program may rely on: all but those for templates alone."""
    named, others = names_of((root / "docs" / "api.md").read_text(encoding="utf-8"))
    return {header for header in installed if header in named or
            not any(header == other or other.endswith("/") and header.startswith(other) for other in others)}


def complaints(root, installed):
    public = public_headers(root, installed)
    text = (root / "docs" / "api.md").read_text(encoding="utf-8")
    named, others = names_of(text)
    missing = [f"docs/api.md: {other} is named, but not installed" for other in sorted(others)
               if not any(header.startswith(other) for header in installed)]
    found = missing + [f"docs/api.md: {header} is installed, but not named" for header in sorted(public - named)]
    found += [f"docs/api.md: {header} is named, but not installed" for header in sorted(named - public)]
    for header in sorted(public & named):
        code = (root / header).read_text(encoding="utf-8")
        if "#include <Eigen/" in code and not re.search(LAYOUT, code):
            found.append(f"{header} has types of Eigen and does not include the header that checks their layout")
    for row in re.finditer(r"^\| `([\w/]+\.hpp)` \| (.*) \|$", text, re.M):
        header, holds = row[1], row[2]
        if header not in public:
            continue
        code = (root / header).read_text(encoding="utf-8")
        # A method of a type, an option of a compiler or a macro are no names of the header: only plain identifiers count.
        for name in re.findall(r"`(?:\w+::)*(\w+)(?:<\w+>)?`", holds):
            if not re.search(rf"\b{name}\b", code):
                found.append(f"docs/api.md: {header} does not hold {name}")
    return found


def main():
    root, installed = Path(sys.argv[1]), sys.argv[2:]
    if not installed:
        sys.exit("check_api.py: no headers given")
    if not complaints(root, installed + ["models/none.hpp"]):
        sys.exit("check_api.py: does not see a header that is not named")
    found = complaints(root, installed)
    for complaint in found:
        print(complaint, file=sys.stderr)
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
