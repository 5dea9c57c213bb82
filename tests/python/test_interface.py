"""What the package is built on: installed headers alone."""

import pathlib
import re

SOURCE = pathlib.Path(__file__).parents[2]
ROOMS = ("models", "periodic", "orbits", "estimator", "identification", "apps")


def included(folder):
    for file in sorted(folder.rglob("*.[ch]pp")):
        for line, text in enumerate(file.read_text().splitlines(), 1):
            found = re.match(r'#\s*include\s+["<]([^">]+)[">]', text)
            if found and found.group(1).split("/")[0] in ROOMS:
                yield f"{file.name}:{line}", found.group(1)


def test_installed_headers_alone_are_included():
    public = set(re.findall(r"`((?:%s)/[a-z0-9_/]+\.hpp)`" % "|".join(ROOMS), (SOURCE / "docs" / "api.md").read_text()))
    includes = list(included(SOURCE / "python"))
    assert len(includes) > 10 and len(public) > 10
    assert [(place, header) for place, header in includes if header not in public] == []
