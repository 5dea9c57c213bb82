"""One page of the gallery: its prose, filled from runs of its jobs.

A page docs/gallery/NAME.md is made of its prose, docs/gallery/NAME.md.in, in which braces stand for what comes from a run:

    {{JOB /pointer}}         a number of result.json; `* 1000` multiplies, `.3f` formats
    {{deviation JOB NAME}}   of a derived quantity from its reference, in percent
    {{rms JOB fitted}}       root mean square of the errors over fitted segments, or over `predicted` ones; formats as above
    {{parameters JOB TITLE}} table of estimates with 95 % intervals beside the references, which are called TITLE; a file of configs/ as
                             TITLE: beside the values of its model, or of its columns `parameter` and `mean`
    {{readings JOB BRANCH}}  table of readings over a parameter, of what the job BRANCH has there, and of what the estimate makes of them
    {{ratio JOB NAME}}       root mean square of ln(estimate / reading), in percent, over readings called NAME; JOB:BRANCH: of BRANCH
    {{picture JOB PLOT}}     `orbid plot`; what follows are its options
    {{equations JOB}}        of the job or of the built-in model
    {{job JOB}}              how to repeat it
"""
import csv
import json
import math
import re
import subprocess
import sys
from dataclasses import dataclass, field

import real_data
from results import CONFIGS, ROOT, read_job, result, run, wrapped

GALLERY = ROOT / "docs" / "gallery"


@dataclass
class System:
    """One page. Expressions are those of the prose."""

    title: str
    page: str       # docs/gallery/NAME.md
    says: str       # what is to be seen in its picture, under it in the index
    picture: str    # JOB PLOT
    measure: str    # what the two figures are
    published: str  # text, or in braces what a run gives
    figure: str     # what a run gives, in braces
    unit: str
    job: str
    quick: bool = False  # run by the tests
    # Jobs that differ from one in configs/ by some values: name -> (job, {pointer: value}).
    variants: dict = field(default_factory=dict)


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


def published_values(name):
    if name.endswith(".json"):
        return {key: entry["value"] for key, entry in read_job(name)["model"]["parameters"].items()}
    with open(CONFIGS / name, newline="") as file:
        return {row["parameter"]: float(row["mean"]) for row in csv.DictReader(file)}


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
        """A number, formatted."""
        match = re.fullmatch(r"(?:(rms|deviation|ratio) )?([\w:]+) ([/\w][^ ]*)(?: \* (\S+))?(?: (\.\w+))?", text)
        if not match:
            sys.exit(f"{self.system.page}: not an expression: {text}")
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
        if title and "." in title[0]:
            given = published_values(title[0])
            rows = [(name, entry | {"reference": given.get(name)}) for name, entry in rows]
            title = ()
        known = any(entry["reference"] is not None for _, entry in rows)
        column = f"{' '.join(title) or 'published'} | " if known else ""
        lines = [f"| parameter | {column}orbid | 95 % interval |", "|---|---|---|" + "---|" * known]
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
