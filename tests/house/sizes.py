#!/usr/bin/env python3
"""What has grown too long: files over 300 lines, functions over 60, and the lines of each room.

    sizes.py [--list] [FOLDER]      one row per room; --list names every file and function that is too long

Only what the formatter wrote is understood: a body ends where a closing brace has the indentation of its first line.
"""

import re
import subprocess
import sys
from pathlib import Path

ROOMS = ("apps", "estimator", "identification", "models", "orbits", "periodic", "python")
CODE = {".cpp", ".hpp", ".py", ".js", ".pyi"}
LONGEST_FILE, LONGEST_FUNCTION = 300, 60
NO_FUNCTION = re.compile(
    r"^\s*(if|else|for|while|do|switch|case|default|try|\} |namespace|struct|class|union|enum|requires|return)\b")


def cpp_functions(lines):
    """(first line, number of lines, text) of every function, counted from its signature to its closing brace."""
    for end, line in enumerate(lines):
        close = re.match(r"^(\s*)\}(?:;|\)|,)?\s*(//.*)?$", line)
        if not close:
            continue
        indent = close.group(1)
        begin = end - 1
        # Back to what opened it: the nearest line above with the same indentation that begins a statement.
        while begin >= 0 and not (lines[begin].strip() and len(lines[begin]) - len(lines[begin].lstrip()) <= len(indent)):
            begin -= 1
        while begin > 0 and re.match(r"^\s*(:|\{)", lines[begin]):  # initialisers
            begin -= 1
            while begin > 0 and len(lines[begin]) - len(lines[begin].lstrip()) > len(indent):
                begin -= 1
        first = lines[begin]
        if "(" in first and not NO_FUNCTION.match(first) and line.strip() == "}":
            yield begin + 1, end - begin + 1, first.strip()


def python_functions(lines):
    for begin, line in enumerate(lines):
        opened = re.match(r"^(\s*)(?:async )?def (\w+)", line)
        if opened:
            end = begin + 1
            while end < len(lines) and (not lines[end].strip() or lines[end].lstrip() != lines[end]
                                        and len(lines[end]) - len(lines[end].lstrip()) > len(opened.group(1))
                                        or re.match(r"^\s*\)", lines[end])):
                end += 1
            while not lines[end - 1].strip():
                end -= 1
            yield begin + 1, end - begin, line.strip()


def main():
    arguments = [a for a in sys.argv[1:] if a != "--list"]
    root = Path(arguments[0] if arguments else Path(__file__).resolve().parents[2])
    known = subprocess.run(["git", "-C", root, "ls-files", *ROOMS], check=True, capture_output=True, text=True).stdout
    total = [0, 0, 0, 0]
    print(f"{'room':<10} {'lines':>7} {'files':>6} {'over 300':>9} {'functions over 60':>18}")
    long = []
    for room in ROOMS:
        row = [0, 0, 0, 0]
        for name in known.split():
            file = root / name
            if not name.startswith(f"{room}/") or not file.exists():
                continue
            lines = file.read_text(encoding="utf-8").splitlines()
            row[0] += len(lines)
            row[1] += 1
            if file.suffix not in CODE:
                continue
            if len(lines) > LONGEST_FILE:
                row[2] += 1
                long.append(f"{name}: {len(lines)} lines")
            functions = python_functions if file.suffix in (".py", ".pyi") else cpp_functions
            for at, count, text in functions(lines):
                if count > LONGEST_FUNCTION:
                    row[3] += 1
                    long.append(f"{name}:{at}: {count} lines: {text}")
        print(f"{room:<10} {row[0]:>7} {row[1]:>6} {row[2]:>9} {row[3]:>18}")
        total = [a + b for a, b in zip(total, row)]
    print(f"{'all':<10} {total[0]:>7} {total[1]:>6} {total[2]:>9} {total[3]:>18}")
    if "--list" in sys.argv:
        print("\n".join(long))


if __name__ == "__main__":
    main()
