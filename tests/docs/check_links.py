#!/usr/bin/env python3
"""Every link of every page leads somewhere: files and pictures exist, anchors are headings of their page.

    check_links.py FOLDER      prints FILE:LINE: what is wrong; exit code 1 if anything is

Addresses on the network are not asked (tests run without one); only their form is looked at.
"""

import difflib
import sys
from pathlib import Path
from urllib.parse import unquote, urlparse

from markdown_page import pages_of, read_page


def broken_links(root):
    """List of "file:line: message", and the number of links looked at."""
    root = Path(root).resolve()
    pages = {path.resolve(): read_page(path) for path in pages_of(root)}
    found, count = [], 0
    for path, page in pages.items():
        name = path.relative_to(root)
        found += [f"{name}:{line}: {text}" for line, text in page.problems]
        for link in page.links:
            count += 1
            where = f"{name}:{link.line}: {'picture' if link.picture else 'link'} {link.target}"
            if urlparse(link.target).scheme:
                if urlparse(link.target).scheme not in ("https", "http", "mailto") or (
                        link.target.startswith("http") and not urlparse(link.target).netloc):
                    found.append(f"{where}: not an address")
                continue
            target, _, anchor = unquote(link.target).partition("#")
            file = (path.parent / target).resolve() if target else path
            if not file.exists():
                found.append(f"{where}: there is no such file")
            elif root not in file.parents and file != root:
                found.append(f"{where}: leads out of the project")
            elif link.picture and file.suffix not in (".svg", ".png"):
                found.append(f"{where}: not a picture")
            elif anchor and file not in pages:
                found.append(f"{where}: an anchor in a file that is not a page")
            elif anchor and anchor not in pages[file].anchors():
                near = ", ".join(difflib.get_close_matches(anchor, sorted(pages[file].anchors())))
                found.append(f"{where}: no such heading" + (f"; near: {near}" if near else ""))
    return found, count


if __name__ == "__main__":
    messages, links = broken_links(sys.argv[1])
    print("\n".join(messages) if messages else f"links: {links}, all lead somewhere")
    sys.exit(1 if messages or not links else 0)
