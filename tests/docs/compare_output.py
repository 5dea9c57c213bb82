"""What a command printed against what the page says it prints.

A line of the page that is `...` stands for any number of lines, a … within a line for any text; blanks count as one blank, since
columns follow the widest number. Words must be equal. Numbers: by default whole numbers are equal and others agree to one unit of the last digit shown. The block
may state another tolerance behind its language:

    text relative=0.3      numbers agree to 30 %
    text sd=4              rows `value sd [lower, upper]` of an estimate: value and interval agree to 4 of the sds shown, sds to a
                           factor of 2; rows against known values: the value agrees to 4 sds, and is off by at most 4 of them;
                           everything else as `relative` says, if it stands there too

The last is for estimates from chaotic records: another processor rounds otherwise, follows another trajectory, and finds other
values within their errors.
"""

import re

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
# Not within a word: k2, 1_experiment.md and sha256 are words.
TOKEN = re.compile(rf"(?<![\w.])({NUMBER})(?![\w]|\.\w)")


def last_digit(number):
    """One unit of the last digit that is written: 0.01 of 3.14, 1e-9 of 2.5e-8; 0 of a whole number."""
    mantissa, _, power = number.lower().partition("e")
    digits = len(mantissa.partition(".")[2])
    if not digits and not power:
        return 0.0
    return 10.0 ** (int(power or 0) - digits)


def numbers_agree(shown, printed, relative):
    a, b = float(shown), float(printed)
    bound = 1.01 * last_digit(shown) if relative is None else relative * abs(a)
    return abs(a - b) <= max(bound, 1.01 * last_digit(shown))


ESTIMATE = re.compile(rf"^(\S+) .*?({NUMBER}) ({NUMBER}) \[({NUMBER}), ({NUMBER})\]( .*)?$")
KNOWN = re.compile(rf"^(\S+) ({NUMBER}) ({NUMBER}) ({NUMBER}) % ({NUMBER}) % ({NUMBER})$")


def estimates_agree(shown, printed, sds, known):
    """Rows of an estimate or of its comparison with known values; None for other lines. `sds` of the rows so far, by name."""
    a, b = ESTIMATE.match(shown), ESTIMATE.match(printed)
    if a and b:
        sd = float(a[3])
        sds[a[1]] = sd
        near = all(abs(float(a[i]) - float(b[i])) <= known * sd for i in (2, 4, 5))
        return a[1] == b[1] and near and 0.5 <= float(b[3]) / sd <= 2.0 and (a[6] or "").split() == (b[6] or "").split()
    a, b = KNOWN.match(shown), KNOWN.match(printed)
    if a and b:
        near = abs(float(a[3]) - float(b[3])) <= known * sds.get(a[1], 0.0)
        return a[1] == b[1] and a[2] == b[2] and a[4] == b[4] and near and abs(float(b[6])) <= known
    return None


def lines_agree(shown, printed, options, sds):
    shown, printed = " ".join(shown.split()), " ".join(printed.split())
    if "sd" in options:
        agree = estimates_agree(shown, printed, sds, float(options["sd"]))
        if agree is not None:
            return agree
    if "…" in shown:
        # Each piece between the signs at its place, in order; what they stand for is cut out of both.
        pieces = [re.escape(TOKEN.sub("#", piece)).replace("\\#", "#").replace("#", NUMBER) for piece in shown.split("…")]
        whole = re.fullmatch("(.*?)".join(f"({piece})" for piece in pieces), printed)
        if not whole:
            return False
        shown, printed = shown.replace("…", " "), " ".join(whole.groups()[::2])
    relative = float(options["relative"]) if "relative" in options else None
    if TOKEN.sub("#", shown) != TOKEN.sub("#", printed):
        return False
    return all(numbers_agree(a, b, relative) for a, b in zip(TOKEN.findall(shown), TOKEN.findall(printed)))


def difference(expected, printed, options):
    """None, or what differs: the first line of the page that has no line of the output in its place."""
    want = [line.rstrip() for line in expected.strip("\n").split("\n")]
    have = [line.rstrip() for line in printed.strip("\n").split("\n")]
    return match(want, have, 0, 0, options)


def match(want, have, i, j, options):
    sds = {}
    while i < len(want):
        if want[i].strip() == "...":
            if i + 1 == len(want):
                return None
            for skip in range(j, len(have) + 1):
                if match(want, have, i + 1, skip, options) is None:
                    return None
            return (i, f"after the dots, nothing in the output goes on with: {want[i + 1].strip()}")
        if j >= len(have):
            return (i, f"not in the output: {want[i].strip()}")
        if not lines_agree(want[i], have[j], options, sds):
            return (i, f"page:   {want[i].strip()}\n    output: {have[j].strip()}")
        i, j = i + 1, j + 1
    if j < len(have) and "".join(have[j:]).strip():
        return (i - 1, f"the output goes on: {have[j].strip()}")
    return None
