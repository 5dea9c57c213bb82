#!/usr/bin/env python3
"""Writes docs/gallery/chaotic_systems.md and its pictures from the journals of three campaigns.

    orbid campaign configs/campaigns/chaotic_systems.json --out DIR/all
    orbid campaign configs/campaigns/chaotic_systems_5_percent.json --out DIR/all_5_percent
    orbid campaign configs/campaigns/chaotic_systems_first.json --out DIR/first
    docs/chaotic_systems.py DIR

The page is made of its prose, docs/gallery/chaotic_systems.md.in: {{table}} and {{not solved}} stand for what the journals say,
{{picture NAME}} for a picture. A case without a journal is left out. A system is solved where the run converged and every
parameter lies within four reported sds and 10 % of the truth; an answer is wrong where a run that converged has a parameter beyond
both. Times are those of the processor: a run of more than 60 s counts as stopped, also where a longer limit let it go on, as a busy
machine needs it. Only the standard library.
"""
import math
import sqlite3
import sys
from dataclasses import dataclass
from pathlib import Path
from statistics import median

GALLERY = Path(__file__).resolve().parent / "gallery"
LIMIT = 60.0  # processor time of a run [s]
CASES = {"all": "all coordinates, 1 %", "all_5_percent": "all coordinates, 5 %", "first": "first coordinate, 1 %"}
COLORS = {"all": "#0072b2", "all_5_percent": "#d55e00", "first": "#009e73"}
INK, GRID, FRAME = "#1d2430", "#e3e6eb", "#39424f"


@dataclass
class Estimate:
    error: float
    truth: float
    sd: float
    covered: bool
    bound: float  # the expected sd

    @property
    def z(self):
        return self.error / self.sd


@dataclass
class Run:
    system: str
    converged: bool  # exit code 0
    status: str
    message: str
    seconds: float
    estimates: list
    weakest: float  # the largest expected sd of a parameter over its value

    @property
    def finished(self):
        return self.converged and self.seconds <= LIMIT

    @property
    def right(self):
        return self.converged and all(abs(e.z) <= 4.0 and abs(e.error) <= 0.1 * abs(e.truth) for e in self.estimates)

    @property
    def solved(self):
        return self.finished and self.right

    @property
    def wrong(self):
        return self.finished and any(abs(e.z) > 4.0 and abs(e.error) > 0.1 * abs(e.truth) for e in self.estimates)


def runs_of(folder):
    """What a journal holds, by name of the system."""
    journal = sqlite3.connect(f"file:{folder / 'campaign.sqlite'}?mode=ro", uri=True)
    runs = []
    tasks = "SELECT number, job, status, message, exit_code, processor_seconds, state FROM task JOIN choices ON task = number"
    for number, system, status, message, code, seconds, state in journal.execute(tasks).fetchall():
        if state == "waiting":
            sys.exit(f"{folder}: the campaign is not finished; the same command goes on")
        rows = journal.execute("SELECT error, truth, sd, covered, bound FROM parameter WHERE task = ? AND truth IS NOT NULL "
                               "AND sd > 0 ORDER BY position", (number,)).fetchall()
        estimates = [Estimate(error, truth, sd, bool(covered), bound or math.nan) for error, truth, sd, covered, bound in rows]
        weakest = journal.execute("SELECT max(bound / abs(truth)) FROM parameter WHERE task = ?", (number,)).fetchone()[0]
        runs.append(Run(system, code == 0 and state == "done", "time_limit" if seconds > LIMIT else status, message, seconds,
                        estimates, weakest or math.nan))
    return sorted(runs, key=lambda run: run.system)


def wilson(hits, count):
    """95 % interval of a share (Wilson 1927)."""
    z2 = 1.959963984540054 ** 2
    middle = (hits + z2 / 2.0) / (count + z2)
    half = math.sqrt(z2 * (hits * (count - hits) / count + z2 / 4.0)) / (count + z2)
    return middle - half, middle + half


def root_mean_square(values):
    values = [value for value in values if math.isfinite(value)]
    return math.sqrt(sum(value * value for value in values) / len(values)) if values else math.nan


def table(cases):
    lines = ["| read, noise | solved | converged | wrong answers | 95 % intervals that hold the truth | rms z "
             "| median error over expected sd | median, longest time |", "|---|---|---|---|---|---|---|---|"]
    for case, runs in cases.items():
        estimates = [e for run in runs if run.finished for e in run.estimates]
        covered = sum(e.covered for e in estimates)
        low, high = wilson(covered, len(estimates))
        ratios = [abs(e.error) / e.bound for e in estimates if math.isfinite(e.bound)]
        times = [run.seconds for run in runs]
        longest = "stopped at 60 s" if max(times) > LIMIT or any(run.status == "time_limit" for run in runs) else f"{max(times):.0f} s"
        lines.append(f"| {CASES[case]} | {sum(run.solved for run in runs)} of {len(runs)} | {sum(run.finished for run in runs)} | "
                     f"{sum(run.wrong for run in runs)} | {covered} of {len(estimates)}: {100 * covered / len(estimates):.1f} % "
                     f"({100 * low:.1f} to {100 * high:.1f}) | {root_mean_square([e.z for e in estimates]):.2f} | "
                     f"{median(ratios):.2f} | {median(times):.1f} s, {longest} |")
    return "\n".join(lines)


def reason(run):
    if run.status == "time_limit":
        later = f"; {'right' if run.right else 'converged'} after {run.seconds:.0f} s" if run.converged else ""
        return f"no answer in {LIMIT:.0f} s{later}"
    if not run.finished:
        return f"`{run.status}`: {run.message.split(';')[0]}"
    worst = max(run.estimates, key=lambda e: abs(e.error / e.truth))
    far = max(run.estimates, key=lambda e: abs(e.z))
    return f"an error of {100 * abs(worst.error / worst.truth):.0f} %, {abs(worst.z):.1f} sds; largest z {abs(far.z):.1f}"


def not_solved(cases):
    lines = ["| system | read, noise | why | largest expected sd over its parameter |", "|---|---|---|---|"]
    for system in sorted({run.system for runs in cases.values() for run in runs if not run.solved}):
        for case, runs in cases.items():
            for run in runs:
                if run.system == system and not run.solved:
                    weakest = f"{100 * run.weakest:{'.0f' if run.weakest > 0.1 else '.2g'}} %" if math.isfinite(run.weakest) else "not known"
                    lines.append(f"| {system} | {CASES[case]} | {reason(run)} | {weakest} |")
    return "\n".join(lines)


class Picture:
    """An SVG in the style of `orbid plot`."""

    def __init__(self, width, height, title, describes):
        self.parts = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width * 0.3528:.2f}mm" height="{height * 0.3528:.2f}mm" '
                      f'viewBox="0 0 {width} {height}" role="img" font-family="Helvetica,Arial,\'Liberation Sans\',sans-serif">',
                      f"<title>{title}</title>", f"<desc>{describes}</desc>", f'<rect width="{width}" height="{height}" fill="#ffffff"/>']

    def line(self, points, color, width=0.5, dashes=""):
        dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
        path = "L".join(f"{x:.2f} {y:.2f}" for x, y in points)
        self.parts.append(f'<path fill="none" stroke="{color}" stroke-width="{width}"{dashed} d="M{path}"/>')

    def text(self, x, y, words, anchor="middle", size=8.0):
        self.parts.append(f'<text x="{x:.2f}" y="{y:.2f}" text-anchor="{anchor}" font-size="{size}" fill="{INK}">{words}</text>')

    def bar(self, x, y, width, height, color):
        self.parts.append(f'<rect x="{x:.2f}" y="{y:.2f}" width="{width:.2f}" height="{height:.2f}" fill="{color}" fill-opacity="0.55"/>')

    def dot(self, x, y, color, hollow=False):
        fill, stroke = ("#ffffff", color) if hollow else (color, "#ffffff")
        self.parts.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="2" fill="{fill}" stroke="{stroke}" stroke-width="{0.8 if hollow else 0.4}"/>')

    def write(self, name):
        (GALLERY / name).write_text("\n".join([*self.parts, "</svg>", ""]))


def deviations(cases):
    """How many estimates lie how many reported sds from the truth, beside the normal density."""
    picture = Picture(30 + 158 * len(cases), 170, "Deviations from the truth in reported standard deviations",
                      "One histogram per case over z = (estimate - truth) / sd, with the normal density of as many estimates")
    for panel, (case, runs) in enumerate(cases.items()):
        z = [e.z for run in runs if run.finished for e in run.estimates]
        left, top, width, height, widths = 30 + panel * 158, 24, 140, 116, 0.5
        edges = [-4.0 + widths * k for k in range(17)]
        counts = [sum(a <= value < a + widths for value in z) for a in edges[:-1]]
        outside = len(z) - sum(counts)
        normal = [(x, len(z) * widths * math.exp(-x * x / 2) / math.sqrt(2 * math.pi)) for x in (-4 + 0.1 * k for k in range(81))]
        most = 1.08 * max(max(counts), max(y for _, y in normal))
        def at(x, y):
            return left + (x + 4) / 8 * width, top + height * (1 - y / most)
        for x in (-4, -2, 0, 2, 4):
            picture.line([at(x, 0), at(x, most)], GRID)
            picture.text(at(x, 0)[0], top + height + 11, x)
        for a, count in zip(edges, counts):
            x, y = at(a, count)
            picture.bar(x + 0.4, y, width * widths / 8 - 0.8, top + height - y, COLORS[case])
        picture.line([at(x, y) for x, y in normal], INK, 0.9)
        picture.line([at(-4, 0), at(4, 0)], FRAME)
        step = max(10, round(most / 3, -1))
        for k in range(int(most // step) + 1):
            picture.text(left - 3, at(0, k * step)[1] + 2.7, f"{k * step:.0f}", "end", 7)
        picture.text(left + width / 2, 14, f"{CASES[case]}: {len(z)}" + (f", {outside} beyond ± 4" if outside else ""))
    picture.text(15 + 79 * len(cases), 166, "(estimate - truth) / sd")
    picture.write("chaotic_systems_deviations.svg")


def errors_over_bounds(cases):
    """Per system: root mean square of its parameters' errors over the expected sds."""
    systems = [run.system for run in next(iter(cases.values()))]
    left, top, row, width = 112, 34, 8.6, 376
    height = row * len(systems)
    picture = Picture(500, round(top + height + 30), "Errors over the expected ones, by system",
                      "Root mean square over the parameters of error / expected sd; hollow: not solved")
    low, high = 0.001, 100.0
    def x_of(value):
        return left + width * math.log(min(max(value, low), high) / low) / math.log(high / low)
    for k, case in enumerate(cases):
        picture.dot(left + 10 + 130 * k, 12, COLORS[case])
        picture.text(left + 16 + 130 * k, 14.7, CASES[case], "start")
    picture.dot(14, 12, FRAME, hollow=True)
    picture.text(20, 14.7, "not solved", "start")
    for power in range(-3, 3):
        x = x_of(10.0 ** power)
        picture.line([(x, top - 4), (x, top + height)], FRAME if power == 0 else GRID, 0.8 if power == 0 else 0.5)
        picture.text(x, top + height + 11, f"{10.0 ** power:g}")
    for k, system in enumerate(systems):
        y = top + row * k + row / 2
        picture.line([(left, y), (left + width, y)], GRID, 0.3)
        picture.text(left - 4, y + 2.5, system, "end", 7)
        for case, runs in cases.items():
            run = next(run for run in runs if run.system == system)
            ratio = root_mean_square([e.error / e.bound for e in run.estimates])
            if math.isfinite(ratio):
                picture.dot(x_of(ratio), y, COLORS[case], hollow=not run.solved)
    picture.text(left + width / 2, top + height + 24, "rms of error / expected sd over the parameters of a system")
    picture.write("chaotic_systems_bounds.svg")


def main(arguments):
    if len(arguments) != 2:
        sys.exit(__doc__)
    journals = Path(arguments[1])
    cases = {case: runs_of(journals / case) for case in CASES if (journals / case / "campaign.sqlite").exists()}
    if not cases:
        sys.exit(f"{journals}: has no journal in {', '.join(CASES)}")
    deviations(cases)
    errors_over_bounds(cases)
    prose = (GALLERY / "chaotic_systems.md.in").read_text()
    for mark, made in (("{{table}}", table(cases)), ("{{not solved}}", not_solved(cases)),
                       ("{{picture deviations}}", "![Deviations from the truth](chaotic_systems_deviations.svg)"),
                       ("{{picture bounds}}", "![Errors over the expected ones](chaotic_systems_bounds.svg)")):
        if mark not in prose:
            sys.exit(f"docs/gallery/chaotic_systems.md.in has no {mark}")
        prose = prose.replace(mark, made)
    (GALLERY / "chaotic_systems.md").write_text(prose)


if __name__ == "__main__":
    main(sys.argv)
