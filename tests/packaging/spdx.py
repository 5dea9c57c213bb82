#!/usr/bin/env python3
"""The list of third-party parts has what SPDX 2.3 requires, and names all that the list of licences names.

    spdx.py BUILD
"""

import json
import re
import sys
from pathlib import Path

build = Path(sys.argv[1])
listed = json.loads((build / "orbid.spdx.json").read_text(encoding="utf-8"))
wrong = []


def must(what, *, of, fits):
    value = of.get(what)
    if not isinstance(value, str) or not re.fullmatch(fits, value):
        wrong.append(f"{of.get('SPDXID')}: {what} is {value!r}")


# Clauses 6 (document), 7 (packages) and 11 (relationships) of the specification.
must("spdxVersion", of=listed, fits=r"SPDX-2\.3")
must("dataLicense", of=listed, fits="CC0-1.0")
must("SPDXID", of=listed, fits="SPDXRef-DOCUMENT")
must("name", of=listed, fits=".+")
must("documentNamespace", of=listed, fits=r"https?://[^#\s]+")
must("created", of=listed["creationInfo"], fits=r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ")
if not listed["creationInfo"]["creators"] or not all(
        re.match("(Tool|Person|Organization): .", c) for c in listed["creationInfo"]["creators"]):
    wrong.append("creators")
for package in listed["packages"]:
    must("SPDXID", of=package, fits=r"SPDXRef-[A-Za-z0-9.-]+")
    must("name", of=package, fits=".+")
    must("versionInfo", of=package, fits=r"[^\s]+")
    must("downloadLocation", of=package, fits="NOASSERTION")
identifiers = [package["SPDXID"] for package in listed["packages"]]
if len(set(identifiers)) != len(identifiers):
    wrong.append("an identifier comes twice")
described = [r for r in listed["relationships"] if r["relationshipType"] == "DESCRIBES"]
if len(described) != 1 or described[0]["relatedSpdxElement"] != "SPDXRef-orbid":
    wrong.append("the document describes no package, or several")
for relationship in listed["relationships"]:
    for end in ("spdxElementId", "relatedSpdxElement"):
        if relationship[end] not in [*identifiers, "SPDXRef-DOCUMENT"]:
            wrong.append(f"{relationship[end]} is related, but is not there")

names = {(p["name"], p["versionInfo"]) for p in listed["packages"] if p["name"] != "orbid"}
table = (build / "third_party_licences.txt").read_text(encoding="utf-8").split("\n\n")[1]
expected = {tuple(line.split()[:2]) for line in table.splitlines() if "no Debian package" not in line}
if len(expected) < 5 or names != expected:
    wrong.append(f"the lists differ: {sorted(names ^ expected)}")
print(f"{len(names)} third-party parts")
for each in wrong:
    print(each)
sys.exit(1 if wrong else 0)
