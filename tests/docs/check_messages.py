#!/usr/bin/env python3
"""The messages that docs/messages.md explains are the program's own.

    check_messages.py FOLDER      exit code 1 if a message of the page is in no source

A message is what stands in backticks in the first column of a table whose head is `message`. Between the signs … its pieces are
looked for in the text of the string literals, placeholders of fmt counting as …
"""

import re
import sys
from pathlib import Path

ROOMS = ["models", "periodic", "orbits", "estimator", "identification", "apps"]


def texts(root):
    """All string literals of the sources, adjacent ones and sums of them joined, placeholders as …, one long text."""
    found = []
    for room in ROOMS:
        for path in sorted((Path(root) / room).rglob("*.[ch]pp")):
            source = re.sub(r"^\s*//.*$", "", path.read_text(encoding="utf-8"), flags=re.M)
            source = re.sub(r'(?<!\\)"\s*\n\s*"', "", source)
            # "a " + x + " b" and "a " << x: what is put in between is a placeholder too.
            source = re.sub(r'(?<!\\)"\s*\+[^";]*\+\s*"', "{}", source)
            for literal in re.findall(r'"((?:[^"\\\n]|\\.)*)"', source):
                found.append(re.sub(r"\{[^{}]*\}", "…", literal.replace('\\"', '"').replace("\\n", " ")))
    return re.sub(r" +", " ", "\n".join(found))


def messages(page):
    """(line, message) of every message in the tables of the page."""
    found, inside = [], False
    for number, line in enumerate(Path(page).read_text(encoding="utf-8").split("\n"), 1):
        if not line.startswith("|"):
            inside = False
        elif re.match(r"\| *message *\|", line):
            inside = True
        elif inside and not re.match(r"\|[-| ]+\|$", line):
            found += [(number, message) for message in re.findall(r"`([^`]+)`", line.split("|")[1])]
    return found


def unknown(page, root):
    """Messages of the page that no source has, as (line, message, piece), and how many there are in all."""
    program, listed = texts(root), messages(page)
    missing = []
    for line, message in listed:
        for piece in message.split("…"):
            piece = piece.strip()
            if piece and piece not in program:
                missing.append((line, message, piece))
                break
    return missing, len(listed)


if __name__ == "__main__":
    page = Path(sys.argv[1]) / "docs" / "messages.md"
    missing, count = unknown(page, sys.argv[1])
    for line, message, piece in missing:
        print(f'docs/messages.md:{line}: no source says "{piece}" (of: {message})')
    if not missing:
        print(f"messages: {count}, all the program's own")
    sys.exit(1 if missing or not count else 0)
