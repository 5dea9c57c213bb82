#!/usr/bin/env python3
"""docs/api.md names every header that is installed outside of detail/, no other, and only names that the headers hold; each with
types of Eigen refuses programs that would allocate them otherwise.

    check_api.py SOURCE_FOLDER PUBLIC_HEADER...      headers as CMake installs them: models/system/system.hpp ...
"""

import re
import sys
from pathlib import Path


def complaints(root, installed):
    public = {header for header in installed if "/detail/" not in header}
    text = (root / "docs" / "api.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:models|periodic|orbits|estimator|apps)/\w+\.hpp)`", text))
    found = [f"docs/api.md: {header} is installed, but not named" for header in sorted(public - named)]
    found += [f"docs/api.md: {header} is named, but not installed" for header in sorted(named - public)]
    for header in sorted(public & named):
        code = (root / header).read_text(encoding="utf-8")
        if "#include <Eigen/" in code and not re.search(r'#include "(models|estimator)/detail/matrix_layout.hpp"', code):
            found.append(f"{header} has types of Eigen and does not include detail/matrix_layout.hpp")
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
