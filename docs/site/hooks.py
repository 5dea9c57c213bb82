"""What mkdocs is told of the pages: which there are, in the order of the tables of contents, and what they link to."""

import json
import logging
import os
import re
import sys
from pathlib import Path

from mkdocs.structure.files import File
from mkdocs.structure.nav import Link

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "docs"))
from markdown_page import LINK, read_page, slug  # noqa: E402

CONTENTS = "docs/README.md"
warn = logging.getLogger("mkdocs.hooks").warning
seen = {}  # of the page at hand: how often each anchor was given


def linked(page, target):
    """Where a link of a page leads, from the project's folder; None: out of it."""
    return None if ":" in target else os.path.normpath(os.path.join(os.path.dirname(page), target.partition("#")[0]))


def entries(table):
    """(heading, {words: page}) for each page that a table of contents names; a README in docs/ is such a table itself."""
    page = read_page(ROOT / table)
    for link in page.links:
        name = linked(table, link.target)
        if link.words and not link.words.startswith("!") and name and name.endswith(".md") and name != CONTENTS:
            inner = re.fullmatch(r"docs/.*README\.md", name) and [{"Overview": name}, *(entry for _, entry in entries(name))]
            yield ([heading.title for heading in page.headings if heading.line < link.line][-1],
                   {link.words[0].upper() + link.words[1:]: inner or name})


def named(nav):
    """Pages of a navigation, in its order."""
    for entry in nav:
        for value in entry.values():
            yield from [value] if isinstance(value, str) else named(value)


def anchor(title, separator):
    """The anchor of a heading as forges make it."""
    name = slug(title)
    seen[name] = seen.get(name, -1) + 1
    return f"{name}-{seen[name]}" if seen[name] else name


def on_config(config):
    sections = {}
    for heading, entry in entries(CONTENTS):
        sections.setdefault(heading, []).append(entry)
    next(iter(sections.values())).insert(1, {"Contents": CONTENTS})
    config["nav"] = [{title: section} for title, section in sections.items()]
    config["mdx_configs"]["toc"]["slugify"] = anchor
    config["copyright"] = f"orbid {os.environ.get('ORBID_VERSION', '')}"
    pages = {str(path.relative_to(ROOT)) for folder in ("docs", "configs") for path in (ROOT / folder).rglob("*.md")}
    for name in sorted(pages - set(named(config["nav"]))):
        warn(f"{name}: no table of contents names this page")
    return config


def on_files(files, config):
    """The pages, from where they are in the project, and every other file that one of them links to."""
    names = dict.fromkeys(named(config["nav"]))
    for name in list(names):
        targets = {linked(name, link.target) for link in read_page(ROOT / name).links} - {None}
        names |= dict.fromkeys(sorted(target for target in targets if not target.endswith(".md") and (ROOT / target).is_file()))
    for name in names:
        files.append(File(name, str(ROOT), config["site_dir"], config["use_directory_urls"]))
    return files


def on_nav(nav, config, files):
    nav.items.append(Link("C++ interface", "api/index.html"))
    return nav


def on_page_markdown(markdown, page, config, files):
    """Links to what the site does not hold (folders, notes beside sources) become words."""
    seen.clear()

    def link(match):
        name = linked(page.file.src_uri, match[2])
        gone = name and (ROOT / name).exists() and not files.get_file_from_path(name)
        return match[0][1:match[0].rindex("](")] if gone else match[0]

    # What stands behind the language of a block is for the tests.
    return re.sub(r"^( *`{3,}\w+) .*$", r"\1", LINK.sub(link, markdown), flags=re.M)


def on_page_content(html, page, config, files):
    """What mkdocs reads otherwise than forges do: a heading that was swallowed, a list that does not begin."""
    lost = [heading.title for heading in read_page(page.file.abs_src_path).headings if f'id="{heading.anchor}"' not in html]
    for text in lost + re.findall(r"^\* .{0,50}", re.sub(r"<pre>.*?</pre>", "", html, flags=re.S), flags=re.M):
        warn(f"{page.file.src_uri}: neither heading nor list, is a blank line missing before it? {text}")


def on_post_build(config):
    """For readers without a server: browsers refuse scripts the index of the search, and a worker, that are files."""
    site = Path(config["site_dir"])
    worker, = (site / "assets" / "javascripts" / "workers").glob("search.*.js")
    # A string of JSON is one of JavaScript.
    code = json.dumps(re.sub(r"\n//# sourceMappingURL=.*", "", worker.read_text()))
    (site / "search" / "offline.js").write_text(
        f"var __search = {{ index: Promise.resolve({(site / 'search' / 'search_index.json').read_text()}) }};\n"
        f"var Worker = class extends Worker {{ constructor() {{ super(URL.createObjectURL(new Blob([{code}]))); }} }};\n")
