"""JSON with comments, as jobs are written; and the pieces of it that a page shows."""

import json
import re


def without_comments(text):
    """The same text with // and /* */ comments blanked, so that lines and columns stay."""
    out, i = [], 0
    while i < len(text):
        if text[i] == '"':
            end = i + 1
            while end < len(text) and text[end] not in '"\n':
                end += 2 if text[end] == "\\" else 1
            out.append(text[i:end + 1])
            i = end + 1
        elif text.startswith("//", i):
            end = text.find("\n", i)
            end = len(text) if end < 0 else end
            out.append(" " * (end - i))
            i = end
        elif text.startswith("/*", i):
            end = text.find("*/", i + 2)
            end = len(text) if end < 0 else end + 2
            out.append(re.sub(r"[^\n]", " ", text[i:end]))
            i = end
        else:
            out.append(text[i])
            i += 1
    return "".join(out)


def strict(pairs):
    """An object whose keys differ: of two equal ones json would silently keep the last."""
    keys = [key for key, _ in pairs]
    for key in keys:
        if keys.count(key) > 1:
            raise ValueError(f'key "{key}" twice')
    return dict(pairs)


def parse(text):
    """A whole document."""
    return json.loads(without_comments(text), object_pairs_hook=strict)


def parse_pieces(text):
    """What a page shows of a job: `"key": value` pairs or values one after another, with or without commas between them.

    Returns the list of values, a pair as the object {key: value}. `...` stands for what is left out: a value of its own, or
    further members. Raises ValueError with the line (json's own errors have .lineno).
    """
    clean = without_comments(text)
    # Three dots outside of strings: a number of their own, or nothing where members are left out.
    clean = re.sub(r'("(?:[^"\\\n]|\\.)*")|\.\.\.', lambda m: m[1] or "\0", clean)
    clean = re.sub(r",\s*\0(?=\s*[}\]])", "", clean)
    clean = re.sub(r"([{\[])\s*\0\s*([}\]])", r"\1\2", clean)
    clean = clean.replace("\0", "null")
    decoder = json.JSONDecoder(object_pairs_hook=strict)
    pieces, at = [], 0

    def blank(position):
        return re.compile(r"\s*").match(clean, position).end()

    at = blank(at)
    while at < len(clean):
        value, end = decoder.raw_decode(clean, at)
        end = blank(end)
        if isinstance(value, str) and clean[end:end + 1] == ":":
            member, end = decoder.raw_decode(clean, blank(end + 1))
            value = {value: member}
        pieces.append(value)
        at = blank(end)
        if clean[at:at + 1] == ",":
            at = blank(at + 1)
    return pieces
