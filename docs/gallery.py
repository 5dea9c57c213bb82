#!/usr/bin/env python3
"""Writes the gallery of real systems: runs their jobs, draws their pictures, fills their pages.

    gallery.py write BIN_DIR [SYSTEM...]   the pages and pictures of these systems, of all if none is named, and the index
    gallery.py check BIN_DIR               runs the quick jobs: do the pages say what they give, and has each all its parts?

A page docs/gallery/NAME.md is made of its prose, docs/gallery/NAME.md.in, in which braces stand for what comes from a run:

    {{JOB /pointer}}         a number of result.json; `* 1000` multiplies, `.3f` formats
    {{deviation JOB NAME}}   of a derived quantity from its reference, in percent
    {{rms JOB fitted}}       root mean square of the errors over fitted segments, or over `predicted` ones; formats as above
    {{parameters JOB TITLE}} table of estimates with 95 % intervals beside the references, which are called TITLE; a job as TITLE:
                             beside the values that its model gives
    {{readings JOB BRANCH}}  table of readings over a parameter, of what the job BRANCH has there, and of what the estimate makes of them
    {{ratio JOB NAME}}       root mean square of ln(estimate / reading), in percent, over readings called NAME; JOB:BRANCH: of BRANCH
    {{picture JOB PLOT}}     `orbid plot`; what follows are its options
    {{equations JOB}}        of the job or of the built-in model
    {{job JOB}}              how to repeat it

Only the standard library. A new system is an entry of SYSTEMS and its prose.
"""
import csv
import json
import math
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import real_data
from results import CONFIGS, ROOT, read_job, result, run, wrapped

sys.path.insert(0, str(ROOT / "tests" / "docs"))
from compare_output import difference  # noqa: E402

GALLERY = ROOT / "docs" / "gallery"
BEGIN, END = "<!-- written by ./dev gallery -->", "<!-- end of the gallery -->"
HEADINGS = ["The record", "The equations", "The job", "Result", "What the residuals say", "What is not known"]
LARGEST_PICTURE = 150_000


@dataclass
class System:
    """One page. Expressions are those of the prose, without braces."""

    title: str
    page: str       # docs/gallery/NAME.md
    says: str       # what is to be seen in its picture, under it in the index
    picture: str    # JOB PLOT
    measure: str    # what the two figures are
    published: str  # expression or text
    figure: str     # expression
    unit: str
    job: str
    quick: bool = False  # run by the tests
    # Jobs that differ from one in configs/ by some values: name -> (job, {pointer: value}).
    variants: dict = field(default_factory=dict)

    def exists(self):
        return (CONFIGS / f"{self.job}.json").exists()


NOTHING_FITTED = {"/estimate/parameters": {}, "/reference": {}}
SYSTEMS = [
    System("Silverbox", "silverbox", "an electronic oscillator with a hardening spring", "silverbox prediction",
           "rms error of the predicted multisine test", "1.49 (GRU network)",
           "silverbox /prediction/1/rms/y * 1000 .3f", "mV", "silverbox", quick=True),
    System("Flutter rig", "flutter", "limit cycles of a wing over the wind speed", "flutter_speed branch",
           "rms deviation of heave amplitudes, stable and unstable cycles", "ratio flutter_fit:flutter_branch h.half_range .1f",
           "ratio flutter_fit h.half_range .1f", "%", "flutter_fit",
           variants={"flutter_speed": ("flutter_branch", {"/periodic/continuation/plot": "vh"})}),
    System("Swinging pendulum", "swing", "a real pendulum comes to rest", "pendulum_swing_friction prediction --format png --dpi 200",
           "rms error of the largest swings, predicted", "rms swing_published predicted * 1000 .1f",
           "rms pendulum_swing_friction predicted * 1000 .2f", "mrad", "pendulum_swing_friction", quick=True,
           variants={"swing_published": ("pendulum_swing_friction", NOTHING_FITTED | {"/model/parameters": real_data.PUBLISHED})}),
    System("Double pendulum", "double_pendulum", "a real double pendulum, read by encoders", "double_pendulum prediction",
           "rms error of predicted windows", "rms arms_published predicted * 1000 .2f",
           "rms double_pendulum predicted * 1000 .2f", "mrad", "double_pendulum", quick=True,
           # Both angles count the same: with estimated sds the states would be fitted to the better one alone.
           variants={"arms_published": ("double_pendulum", NOTHING_FITTED | {
               "/model/variant": "viscous",
               "/estimate/residuals/0/errors": {name: {"distribution": "normal", "sd": 3e-4} for name in ("phi1", "phi2")}})}),
    System("Hare and lynx", "hare_lynx", "pelts of hare and lynx, 1900 to 1920", "hare_lynx prediction",
           "growth of hares", "0.547 (posterior mean by sampling)", "hare_lynx /parameters/alpha/value .3f", "per year", "hare_lynx",
           quick=True),
    System("Simulated pendulum", "simulated_pendulum", "simulated, the example of the paper: a chaotic section and its cycles",
           "pendulum_table3 section", "error of the linear damping k2/m", "11.3", "deviation pendulum_table3 k2_over_m .1g", "%",
           "pendulum_table3"),
    System("Pendulum with a motor", "pendulum_motor", "a real pendulum driven by a torque", "pendulum_motor prediction",
           "rms error of the second half, predicted", "0.878", "rms pendulum_motor predicted .3f", "rad", "pendulum_motor"),
    System("Ion channel", "ion_channel", "current through a real cell under a voltage protocol", "ion_channel prediction",
           "rms error of the current", "0.0317", "rms ion_channel fitted .4f", "nA", "ion_channel"),
]


def job_of(name, variants):
    """The job as a dictionary, its files absolute."""
    base, values = variants.get(name, (name, {}))
    job = read_job(f"{base}.json")
    for pointer, value in values.items():
        *folders, last = pointer.split("/")[1:]
        place = job
        for folder in folders:
            place = place[int(folder) if isinstance(place, list) else folder]
        place[last] = value

    def absolute(value):
        if isinstance(value, dict):
            return {key: str(CONFIGS / inner) if key == "file" and isinstance(inner, str) else absolute(inner)
                    for key, inner in value.items()}
        return [absolute(inner) for inner in value] if isinstance(value, list) else value

    return absolute(job)


def shown(value, sd):
    """Two digits of the sd decide how many of the value are told."""
    if not sd:
        return f"{value:.6g}"
    digits = max(1, math.floor(math.log10(abs(value) or sd)) - math.floor(math.log10(sd)) + 2)
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e7 else text


class Runs:
    """Results of the jobs of one system, each run when it is first asked for."""

    def __init__(self, bin_dir, system, work, pictures=True):
        self.bin_dir, self.system, self.work, self.pictures = bin_dir, system, work, pictures

    def folder(self, job):
        if not (self.work / job / "out").exists():
            run(self.bin_dir, job_of(job, self.system.variants), self.work / job)
        return self.work / job / "out"

    def answer(self, job):
        self.folder(job)
        return result(self.work / job)

    def orbid(self, *arguments):
        return subprocess.run([str(self.bin_dir / "orbid"), *map(str, arguments)], check=True, capture_output=True, text=True).stdout

    def expression(self, text):
        """A number, formatted; text that is none stays."""
        match = re.fullmatch(r"(?:(rms|deviation|ratio) )?([\w:]+) ([/\w][^ ]*)(?: \* (\S+))?(?: (\.\w+))?", text)
        if not match:
            return text
        kind, job, what, factor, form = match.groups()
        if kind == "ratio":
            job, _, branch = job.partition(":")
            pairs = [(row, known.get(what) if branch else float(row["predicted"]))
                     for row, known in self.beside(job, branch) if row["coordinate"] == what]
            logs = [math.log(value / float(row["observed"])) for row, value in pairs]
            return f"{100 * math.sqrt(sum(x * x for x in logs) / len(logs)):{form}}"
        value = answer = self.answer(job)
        if kind == "rms":
            value = real_data.rms(answer, {entry["segment"] for entry in answer["prediction"] if entry["fitted"] == (what == "fitted")})
        elif kind == "deviation":
            entry = answer["derived"][what]
            value = 100 * abs(entry["value"] / entry["reference"] - 1)
        else:
            for key in what.split("/")[1:]:
                value = value[int(key)] if isinstance(value, list) else value[key]
        return f"{value * float(factor or 1):{form}}" if form else f"{value}"

    def rows(self, job, file="residuals.csv"):
        with open(self.folder(job) / file, newline="") as table:
            return list(csv.DictReader(table))

    def on_branch(self, branch, place):
        """Amplitudes and frequencies of the orbits that a branch has at a value of its parameter, between its points by lines."""
        job = json.loads((self.folder(branch) / "job.json").read_text())
        parameter, points = job["periodic"]["continuation"]["parameter"], self.rows(branch, "branch.csv")
        for one, following in zip(points, points[1:]):
            a, b = float(one[parameter]), float(following[parameter])
            if min(a, b) <= place < max(a, b) and one["branch"] == following["branch"]:
                share = (place - a) / (b - a)
                yield {name.replace("_half_range", ".half_range"): (1 - share) * float(one[name]) + share * float(following[name])
                       for name in one if name.endswith("_half_range") or name == "frequency"}

    def beside(self, job, branch):
        """(reading, {coordinate: value} of the orbit of the branch that is nearest to its cycle), cycle by cycle."""
        known = {}
        for row in self.rows(job):
            if row["coordinate"] == "h.half_range" and branch:
                known = min(self.on_branch(branch, float(row["time_or_phase"])), default={},
                            key=lambda orbit: abs(orbit["h.half_range"] - float(row["observed"])))
            yield row, known

    def parameters(self, job, *title):
        answer = self.answer(job)
        rows = [(name, entry) for kind in ("parameters", "derived") for name, entry in answer[kind].items()]
        if title and (CONFIGS / f"{title[0]}.json").exists():
            given = job_of(title[0], {})["model"]["parameters"]
            rows = [(name, entry | {"reference": given.get(name, {}).get("value")}) for name, entry in rows]
            title = ()
        known = any(entry["reference"] is not None for _, entry in rows)
        lines = ["| parameter | " + (f"{' '.join(title) or 'published'} | " if known else "") + "orbid | 95 % interval |", "|---|---|---|" + "---|" * known]
        for name, entry in rows:
            reference, interval = entry["reference"], entry["interval95"]
            unit = "" if entry["unit"] in (None, "1") else f" [{entry['unit']}]"
            limits = f"{shown(interval[0], entry['sd'])} ... {shown(interval[1], entry['sd'])}" if interval else "at its bound"
            first = f"{'' if reference is None else f'{reference:.6g}'} | " if known else ""
            lines.append(f"| {name}{unit} | {first}{shown(entry['value'], entry['sd'])} | {limits} |")
        return "\n".join(lines)

    def readings(self, job, branch):
        lines = ["| record | | measured | published | orbid |", "|---|---|---|---|---|"]
        for row, known in self.beside(job, branch):
            published = f"{known[row['coordinate']]:.4g}" if row["coordinate"] in known else ""
            lines.append(f"| {row['segment_or_cycle']} | {row['coordinate']} | {float(row['observed']):.4g} | {published} | "
                         f"{float(row['predicted']):.4g} |")
        return "\n".join(lines)

    def picture(self, job, plot, *options):
        form = options[options.index("--format") + 1] if "--format" in options else "svg"
        name = f"{job}_{plot}.{form}"
        if self.pictures:
            self.orbid("plot", self.folder(job), plot, "--out", GALLERY / name, *options)
        says = re.search(rf"^ *{plot} +(\S.*)$", self.orbid("plot", self.folder(job)), flags=re.M)[1]
        return f"![{self.system.title}. {says}]({name})"

    def equations(self, job):
        model = job_of(job, self.system.variants)["model"]
        if "equations" not in model:
            return "```text\n" + self.orbid("models", model["name"]).split("\n\n")[1] + "\n```"
        lines = [f"{name}' = {formula}" for name, formula in model["equations"].items()]
        where = [f"{name} = {formula}" for name, formula in model.get("definitions", {}).items()]
        return "```text\n" + "\n".join(lines + [""] * bool(where) + where) + "\n```"

    def job(self, job):
        return f"[configs/{job}.json](../../configs/{job}.json), repeated by\n\n    orbid run configs/{job}.json"

    def filled(self, prose):
        def put(match):
            name, *words = match[1].split()
            if name in ("parameters", "readings", "picture", "equations", "job"):
                return getattr(self, name)(*words)
            return self.expression(match[1])
        return re.sub(r"\{\{(.+?)\}\}", put, prose)

    def page(self):
        return flowing(self.filled(prose_of(self.system)))


def prose_of(system):
    return (GALLERY / f"{system.page}.md.in").read_text()


def flowing(text):
    """Paragraphs filled anew: what stands for a number is longer than the number."""
    parts = re.split(r"(```.*?\n```)", text, flags=re.S)
    for i in range(0, len(parts), 2):
        parts[i] = re.sub(r"^(?![|#*<!] ?|    ).+(\n.+)*$", lambda block: block[0].replace("\n", " "), parts[i], flags=re.M)
    return "\n".join(wrapped("".join(parts).split("\n")))


def active():
    return [system for system in SYSTEMS if system.exists()]


def picture_of(system):
    job, plot, *options = system.picture.split()
    return f"{job}_{plot}.{'png' if '--format' in options else 'svg'}"


def pictures_table(folder):
    """Three pictures a row, each a link to its page."""
    cells = [f"[![{system.title}]({folder}{picture_of(system)})]({folder}{system.page}.md)<br>**{system.title}**: {system.says}"
             for system in active()]
    rows = [cells[i:i + 3] + [""] * (3 - len(cells[i:i + 3])) for i in range(0, len(cells), 3)]
    table = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(["<div class=\"gallery\" markdown>", "", table[0], "|---|---|---|", *table[1:], "", "</div>"])


def figures_row(system, runs):
    return (f"| [{system.title}]({system.page}.md) | {system.measure} [{system.unit}] | {runs.expression(system.published)} | "
            f"{runs.expression(system.figure)} | `orbid run configs/{system.job}.json` |")


def rows_of(text):
    """The rows of the table of figures in the index, by page."""
    return {match[1]: match[0] for match in re.finditer(r"^\| \[[^]]*\]\((\w+)\.md\) \|.*$", text, flags=re.M)}


def index(rows):
    prose = (GALLERY / "README.md.in").read_text()
    table = ["| system | | published | orbid | repeated by |", "|---|---|---|---|---|"]
    table += [rows[system.page] for system in active() if system.page in rows]
    return prose.replace("{{pictures}}", pictures_table("")).replace("{{figures}}", "\n".join(table))


def between_marks(text, inner):
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}\n\n{inner}\n\n{END}{rest.split(END)[1]}"


def write(bin_dir, wanted):
    unknown = set(wanted) - {system.page for system in active()}
    if unknown:
        sys.exit(f"no system {', '.join(sorted(unknown))}; there are {', '.join(system.page for system in active())}")
    contents = GALLERY / "README.md"
    rows = rows_of(contents.read_text()) if contents.exists() else {}
    for system in active():
        if wanted and system.page not in wanted:
            continue
        with tempfile.TemporaryDirectory() as work:
            runs = Runs(bin_dir, system, Path(work))
            (GALLERY / f"{system.page}.md").write_text(runs.page())
            runs.picture(*system.picture.split())
            rows[system.page] = figures_row(system, runs)
        print(f"docs/gallery/{system.page}.md", flush=True)
        contents.write_text(index(rows))
    overview = ROOT / "README.md"
    overview.write_text(between_marks(overview.read_text(), pictures_table("docs/gallery/")))


def problems_of(system):
    """What is missing of a page, or was changed by hand."""
    page = GALLERY / f"{system.page}.md"
    if not page.exists():
        return ["there is no page; ./dev gallery writes it"]
    found, text = [], page.read_text()
    if re.findall(r"^## (.*)$", text, flags=re.M) != HEADINGS:
        found.append(f"its headings are not {', '.join(HEADINGS)}")
    pictures = re.findall(r"!\[[^]]*\]\((.*?)\)", text)
    if picture_of(system) not in pictures or len(pictures) < 2:
        found.append("it needs two pictures, that of the index among them")
    found += [f"{name} has more than {LARGEST_PICTURE} bytes" for name in pictures if (GALLERY / name).stat().st_size > LARGEST_PICTURE]
    prose = re.split(r"\{\{.+?\}\}", " ".join(prose_of(system).split()))
    if not re.fullmatch(".+?".join(map(re.escape, prose)), " ".join(text.split())):
        found.append("it was not made of its prose: change NAME.md.in, then run ./dev gallery")
    return found


def check(bin_dir):
    """Every page has its parts; those of the quick jobs say what these give, to a unit of the last digit or 1e-4."""
    contents, found = (GALLERY / "README.md").read_text(), []
    rows = rows_of(contents)
    for system in active():
        mine = problems_of(system)
        if system.quick and not mine:
            with tempfile.TemporaryDirectory() as work:
                runs = Runs(bin_dir, system, Path(work), pictures=False)
                for shown_here, made in (((GALLERY / f"{system.page}.md").read_text(), runs.page()),
                                         (rows.get(system.page, "none"), figures_row(system, runs))):
                    differs = difference(shown_here, made, {"relative": "1e-4"})
                    mine += [differs[1]] if differs else []
        found += [f"docs/gallery/{system.page}.md: {problem}" for problem in mine]
    if contents != index(rows) or set(rows) != {system.page for system in active()}:
        found.append("docs/gallery/README.md: not what ./dev gallery makes")
    if pictures_table("docs/gallery/") not in (ROOT / "README.md").read_text():
        found.append("README.md: not the pictures that ./dev gallery puts there")
    written = "".join(path.read_text() for path in GALLERY.glob("*.md"))
    found += [f"docs/gallery/{path.name}: nothing names it" for path in GALLERY.iterdir()
              if path.suffix != ".in" and path.name != "README.md" and f"({path.name})" not in written]
    return found


def main(arguments):
    if len(arguments) == 3 and arguments[1] == "check":
        found = check(Path(arguments[2]).resolve())
        print("\n".join(found) if found else f"{len(active())} systems, {sum(system.quick for system in active())} of them run")
        sys.exit(1 if found else 0)
    if len(arguments) >= 3 and arguments[1] == "write":
        write(Path(arguments[2]).resolve(), arguments[3:])
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main(sys.argv)
