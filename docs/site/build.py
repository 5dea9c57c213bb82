#!/usr/bin/env python3
"""Builds the site: the pages of docs/ and the API of the headers, one navigation, no network.

    build.py OUTPUT_FOLDER [VERSION]      needs doxygen; `./dev docs` runs it into build/docs

The pages are written for readers on a forge or in an editor. Before Doxygen reads them, their copies get what it needs: an anchor
for each heading, its own form of links, and `@subpage` where a table of contents names a page, which makes the tree. Ends with
exit code 1 on any warning of Doxygen, on a page of docs/ that no table of contents names, and on any link of the finished site
that leads nowhere.
"""

import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "docs"))
from markdown_page import FENCE, LINK, read_page, slug  # noqa: E402

ROOMS = ["models", "periodic", "orbits", "estimator", "identification", "apps"]
CONTENTS = ROOT / "docs" / "README.md"
# Pages whose links make the tree.
TABLES_OF_CONTENTS = [CONTENTS, ROOT / "docs" / "tutorial" / "README.md"]


def pages():
    """Every page of the site: those of docs/, and those of the project that they name."""
    others = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "configs/README.md", "examples/README.md"]
    return sorted((ROOT / "docs").rglob("*.md")) + [ROOT / name for name in others] + sorted((ROOT / "configs/data").rglob("*.md"))


def identity(path):
    """Name of a page for Doxygen: docs/tutorial/1_experiment.md is tutorial_1_experiment, README.md is project."""
    if path == CONTENTS:
        return "index"
    name = str(path.relative_to(ROOT).with_suffix("")).removeprefix("docs/")
    return "page_" + re.sub(r"\W", "_", name).lower()


def for_doxygen(path, known, named, copies):
    """The text of a page as Doxygen wants it; `named` collects the pages that are in the tree."""
    page, out, fenced, headings = read_page(path), [], False, 0
    lines = path.read_text(encoding="utf-8").split("\n")
    anchors = {heading.line: heading.anchor for heading in page.headings}
    indented = {number for number, line in enumerate(lines, 1) if line.startswith("    ")}

    def link(match):
        picture, target = match[1], match[2]
        words = match[0][len(picture) + 1:match[0].rindex("](")]
        if re.match(r"[a-z]+:", target):
            return match[0]
        file, _, anchor = unquote(target).partition("#")
        where = (path.parent / file).resolve() if file else path
        if picture:
            # Doxygen knows pictures by their names alone.
            name = f"{identity(where.parent / 'x').removesuffix('x')}{where.name}"
            shutil.copy(where, copies / name)
            return f"![{words}]({name})"
        if where not in known:
            return words
        if path in TABLES_OF_CONTENTS and not anchor and where not in named and where != path and where not in TABLES_OF_CONTENTS[:1]:
            named.append(where)
            return f'@subpage {identity(where)} "{words}"'
        return f"[{words}](@ref {identity(where)}{'_' + anchor if anchor else ''})"

    for number, line in enumerate(lines, 1):
        fence = FENCE.match(line)
        if fence and (not fenced or not fence[3].strip()):
            fenced = not fenced
            language = fence[3].split()[0] if fence[3].split() else ""
            # Without a known language Doxygen colours a block as C++.
            out.append(line if not fenced else f"{fence[1]}{fence[2]}{{.{language if language in ('cpp', 'py') else 'unparsed'}}}")
        elif fenced or (number in indented and (number == 1 or number - 1 in indented or not lines[number - 2].strip())):
            out.append(line)
        elif number in anchors:
            label = identity(path) if not headings else f"{identity(path)}_{anchors[number]}"
            headings += 1
            title = "Contents" if label == "index" else line.lstrip("# ")
            out.append(f"{'#' * (len(line) - len(line.lstrip('#')))} {title} {{#{'mainpage' if label == 'index' else label}}}")
        else:
            text = LINK.sub(link, line)
            # Outside of code, @ and \ begin commands of Doxygen and < begins HTML.
            pieces = re.split(r"(`[^`]*`)", text)
            out.append("".join(piece if piece.startswith("`") else
                               re.sub(r"\\(?=[a-z])|@(?!ref |subpage )", lambda m: "\\" + m[0], piece) for piece in pieces))
    return "\n".join(out)


class Site(HTMLParser):
    """Anchors and links of one page of the finished site."""

    def __init__(self, text):
        super().__init__()
        self.anchors, self.links = set(), []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.anchors |= {attributes[key] for key in ("id", "name") if attributes.get(key)}
        for key in ("href", "src"):
            if attributes.get(key):
                self.links.append(attributes[key])


def broken(html):
    """Links of the finished site that lead nowhere, and anything it would fetch from the network."""
    parsed = {file.name: Site(file.read_text(encoding="utf-8")) for file in html.glob("*.html")}
    found = []
    for name, page in parsed.items():
        for link in page.links:
            if re.match(r"(https?:|mailto:|javascript:|data:)", link):
                continue
            file, _, anchor = unquote(link).partition("#")
            file = file or name
            if not (html / file).exists():
                found.append(f"{name}: {link}: no such file")
            # Doxygen 1.9.4 links to a heading of nested types that it leaves out when all of them are `detail`.
            elif anchor and anchor != "nested-classes" and file in parsed and anchor not in parsed[file].anchors:
                found.append(f"{name}: {link}: no such anchor")
        for fetched in re.findall(r"<(?:script|link|img)[^>]*(?:src|href)=\"(?:https?:)?//[^\"]*", (html / name).read_text()):
            found.append(f"{name}: fetched from the network: {fetched}")
    return found, sum(len(page.links) for page in parsed.values())


def main():
    output, version = Path(sys.argv[1]).resolve(), sys.argv[2] if len(sys.argv) > 2 else ""
    copies = output / "pages"
    shutil.rmtree(copies, ignore_errors=True)
    shutil.rmtree(output / "html", ignore_errors=True)
    copies.mkdir(parents=True)
    known, named = set(pages()), []
    for path in [*TABLES_OF_CONTENTS, *(page for page in pages() if page not in TABLES_OF_CONTENTS)]:
        (copies / f"{identity(path)}.md").write_text(for_doxygen(path, known, named, copies), encoding="utf-8")
    problems = [f"{path.relative_to(ROOT)}: no table of contents names this page"
                for path in pages() if path not in named and path != CONTENTS]
    here = ROOT / "docs" / "site"
    lines = {"PROJECT_NUMBER": version, "INPUT": " ".join([str(copies), *(str(ROOT / room) for room in ROOMS)]),
             "STRIP_FROM_PATH": str(ROOT), "OUTPUT_DIRECTORY": str(output), "LAYOUT_FILE": str(here / "layout.xml"),
             "HTML_EXTRA_STYLESHEET": str(here / "style.css"), "USE_MDFILE_AS_MAINPAGE": str(copies / "index.md"),
             "FILTER_PATTERNS": f'*.hpp="sed -E -f {here / "headers.sed"}"', "IMAGE_PATH": str(copies)}
    settings = (here / "Doxyfile").read_text() + "".join(f"{name} = {value}\n" for name, value in lines.items())
    ran = subprocess.run(["doxygen", "-"], input=settings, text=True, capture_output=True)
    # The copies stand for the pages; a warning names the page.
    names = {str(copies / f"{identity(path)}.md"): str(path.relative_to(ROOT)) for path in pages()}
    for line in ran.stderr.split("\n"):
        if line.strip():
            for copy, name in names.items():
                line = line.replace(copy, name)
            problems.append(line)
    if ran.returncode:
        problems.append(f"doxygen ended with exit code {ran.returncode}")
    found, count = broken(output / "html") if (output / "html").exists() else (["doxygen wrote no site"], 0)
    problems += found
    if problems:
        print("\n".join(problems), file=sys.stderr)
        sys.exit(1)
    print(f"{output / 'html' / 'index.html'}: {len(known)} pages, {count} links")


if __name__ == "__main__":
    main()
