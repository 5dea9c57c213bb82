#!/usr/bin/env python3
"""Builds the site: the pages by mkdocs, the C++ interface by Doxygen in its folder api/; no network.

    build.py OUTPUT_FOLDER [VERSION]      needs mkdocs, mkdocs-material, doxygen; `./dev docs` runs it into build/docs

Ends with exit code 1 on any warning of either program, on a page that no table of contents names, on any link of the finished
site that leads nowhere, and on anything that a page would fetch from the network.
"""

import os
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

ROOT = Path(__file__).resolve().parents[2]


class Page(HTMLParser):
    """Anchors and links of one page of the finished site, and what it fetches from the network."""

    def __init__(self, text):
        super().__init__()
        self.anchors, self.links, self.fetched = set(), [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.anchors |= {attributes[key] for key in ("id", "name") if attributes.get(key)}
        for key in ("href", "src"):
            if attributes.get(key):
                self.links.append(attributes[key])
                if tag != "a" and re.match(r"(https?:)?//", attributes[key]):
                    self.fetched.append(attributes[key])


def broken(html):
    """Links of the finished site that lead nowhere, anything it would fetch from the network, and the number of links."""
    # The page for wrong addresses is at home at the root of a server.
    parsed = {file: Page(file.read_text(encoding="utf-8")) for file in html.rglob("*.html") if file.name != "404.html"}
    found = []
    for path, page in parsed.items():
        name = path.relative_to(html)
        for link in page.links:
            if re.match(r"([a-z]+:|//)", link):
                continue
            target, _, anchor = unquote(link).partition("#")
            file = Path(os.path.normpath(path.parent / target)) if target else path
            if not file.exists():
                found.append(f"{name}: {link}: no such file")
            # Doxygen 1.9.4 links to a heading of nested types that it leaves out when all of them are `detail`.
            elif anchor and anchor != "nested-classes" and file in parsed and anchor not in parsed[file].anchors:
                found.append(f"{name}: {link}: no such anchor")
        found += [f"{name}: fetched from the network: {address}" for address in page.fetched]
    return found, len(parsed), sum(len(page.links) for page in parsed.values())


def main():
    output, version = Path(sys.argv[1]).resolve(), sys.argv[2] if len(sys.argv) > 2 else ""
    html = output / "html"
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir(parents=True)
    settings = os.environ | {"ORBID_VERSION": version, "ORBID_SITE": str(output), "PYTHONDONTWRITEBYTECODE": "1"}
    commands = (["doxygen", "docs/site/Doxyfile"], ["mkdocs", "build", "--strict", "-f", "docs/site/mkdocs.yml", "-d", str(html)])
    running = [subprocess.Popen(command, cwd=ROOT, env=settings, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
               for command in commands]
    problems = []
    for process in running:
        # mkdocs colours what it says, and says more than what is wrong.
        printed = re.sub(r"^INFO.*\n( .*\n)*", "", re.sub(r"\x1b\[\d*m", "", process.communicate()[1]), flags=re.M)
        problems += [line for line in printed.split("\n") if line.strip()]
        if process.returncode:
            problems.append(f"{process.args[0]} ended with exit code {process.returncode}")
    if not problems:
        (output / "api").rename(html / "api")
        problems, pages, links = broken(html)
    if problems:
        print("\n".join(problems), file=sys.stderr)
        sys.exit(1)
    print(f"{html / 'index.html'}: {pages} pages, {links} links")


if __name__ == "__main__":
    main()
