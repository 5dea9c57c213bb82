#!/usr/bin/env python3
"""Writes the gallery of real systems: runs their jobs, draws their pictures, fills their pages.

    gallery.py write BIN_DIR [SYSTEM...]   the pages and pictures of these systems, of all if none is named, and the index
    gallery.py check BIN_DIR               runs the quick jobs: do the pages say what they give, and has each all its parts?

A page docs/gallery/NAME.md is made of its prose, docs/gallery/NAME.md.in: gallery_page.py says how. A new system is an entry of
SYSTEMS and its prose. Only the standard library.
"""
import re
import sys
import tempfile
from pathlib import Path

import real_data
from gallery_page import GALLERY, Runs, System, prose_of
from results import ROOT

sys.path.insert(0, str(ROOT / "tests" / "docs"))
from compare_output import difference  # noqa: E402

BEGIN, END = "<!-- written by ./dev gallery -->", "<!-- end of the gallery -->"
HEADINGS = ["The record", "The equations", "The job", "Result", "What the residuals say", "What is not known"]
LARGEST_PICTURE = 150_000

NOTHING_FITTED = {"/estimate/parameters": {}, "/reference": {}}
SYSTEMS = [
    System("Silverbox", "silverbox", "an electronic oscillator with a hardening spring", "silverbox prediction",
           "rms error of the predicted multisine test", "1.49 (GRU network)",
           "{{silverbox /prediction/1/rms/y * 1000 .3f}}", "mV", "silverbox", quick=True),
    System("Flutter rig", "flutter", "limit cycles of a wing over the wind speed", "flutter_fit branch",
           "rms deviation of heave amplitudes, stable cycles", "{{ratio flutter_fit:flutter_branch h.half_range .1f}}",
           "{{ratio flutter_fit h.half_range .1f}}", "%", "flutter_fit"),
    System("Swinging pendulum", "swing", "a real pendulum comes to rest", "pendulum_swing_friction prediction --format png --dpi 200",
           "rms error of the largest swings, predicted", "{{rms swing_published predicted * 1000 .1f}}",
           "{{rms pendulum_swing_friction predicted * 1000 .2f}}", "mrad", "pendulum_swing_friction", quick=True,
           variants={"swing_published": ("pendulum_swing_friction", NOTHING_FITTED | {"/model/parameters": real_data.PUBLISHED})}),
    System("Double pendulum", "double_pendulum", "a real double pendulum, read by encoders", "double_pendulum prediction",
           "rms error of predicted windows", "{{rms arms_published predicted * 1000 .2f}}",
           "{{rms double_pendulum predicted * 1000 .2f}}", "mrad", "double_pendulum", quick=True,
           # Both angles count the same: with estimated sds the states would be fitted to the better one alone.
           variants={"arms_published": ("double_pendulum", NOTHING_FITTED | {
               "/model/variant": "viscous",
               "/estimate/residuals/0/errors": {name: {"distribution": "normal", "sd": 3e-4} for name in ("phi1", "phi2")}})}),
    System("Pendulum with a motor", "pendulum_motor", "a real pendulum driven by a torque", "pendulum_motor prediction",
           "rms error of the second half, predicted", "0.878", "{{rms pendulum_motor predicted .3f}}", "rad", "pendulum_motor", quick=True),
    System("Ion channel", "ion_channel", "current through a real cell under a voltage protocol", "ion_channel prediction",
           "rms error of the current", "0.0317", "{{rms ion_channel fitted .4f}}", "nA", "ion_channel"),
    System("Hare and lynx", "hare_lynx", "pelts of hare and lynx, 1900 to 1920", "hare_lynx prediction",
           "growth of hares", "0.547 (posterior mean by sampling)", "{{hare_lynx /parameters/alpha/value .3f}}", "per year", "hare_lynx",
           quick=True),
    System("Simulated pendulum", "simulated_pendulum", "the example of the paper: a chaotic section and its cycles",
           "pendulum_table3 section", "error of the linear damping k2/m", "11.3", "{{deviation pendulum_table3 k2_over_m .1g}}", "%",
           "pendulum_table3"),
]


def picture_of(system):
    job, plot, *options = system.picture.split()
    return f"{job}_{plot}.{'png' if '--format' in options else 'svg'}"


def pictures_table(folder):
    """Three pictures a row, each a link to its page."""
    cells = [f"[![{system.title}]({folder}{picture_of(system)})]({folder}{system.page}.md)<br>**{system.title}**: {system.says}"
             for system in SYSTEMS]
    rows = [cells[i:i + 3] + [""] * (3 - len(cells[i:i + 3])) for i in range(0, len(cells), 3)]
    table = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(["<div class=\"gallery\" markdown>", "", table[0], "|---|---|---|", *table[1:], "", "</div>"])


def figures_row(system, runs):
    return (f"| [{system.title}]({system.page}.md) | {system.measure} [{system.unit}] | {runs.filled(system.published)} | "
            f"{runs.filled(system.figure)} | `orbid run configs/{system.job}.json` |")


def rows_of(text):
    """The rows of the table of figures in the index, by page."""
    return {match[1]: match[0] for match in re.finditer(r"^\| \[[^]]*\]\((\w+)\.md\) \|.*$", text, flags=re.M)}


def index(rows):
    prose = (GALLERY / "README.md.in").read_text()
    table = ["| system | | published | orbid | repeated by |", "|---|---|---|---|---|"]
    table += [rows[system.page] for system in SYSTEMS if system.page in rows]
    return prose.replace("{{pictures}}", pictures_table("")).replace("{{figures}}", "\n".join(table))


def between_marks(text, inner):
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}\n\n{inner}\n\n{END}{rest.split(END)[1]}"


def write(bin_dir, wanted):
    unknown = set(wanted) - {system.page for system in SYSTEMS}
    if unknown:
        sys.exit(f"no system {', '.join(sorted(unknown))}; there are {', '.join(system.page for system in SYSTEMS)}")
    contents = GALLERY / "README.md"
    rows = rows_of(contents.read_text()) if contents.exists() else {}
    for system in SYSTEMS:
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
    for name in pictures:
        size = (GALLERY / name).stat().st_size if (GALLERY / name).exists() else 0
        if not 0 < size <= LARGEST_PICTURE:
            found.append(f"{name} has {size} bytes, not 1 to {LARGEST_PICTURE}")
    prose = re.split(r"\{\{.+?\}\}", " ".join(prose_of(system).split()))
    if not re.fullmatch(".+?".join(map(re.escape, prose)), " ".join(text.split())):
        found.append("it was not made of its prose: change NAME.md.in, then run ./dev gallery")
    return found


def check(bin_dir):
    """Every page has its parts; those of the quick jobs say what these give, to a unit of the last digit or 1e-4."""
    contents, found = (GALLERY / "README.md").read_text(), []
    rows = rows_of(contents)
    for system in SYSTEMS:
        mine = problems_of(system)
        if system.quick and not mine:
            with tempfile.TemporaryDirectory() as work:
                runs = Runs(bin_dir, system, Path(work), pictures=False)
                for shown_here, made in (((GALLERY / f"{system.page}.md").read_text(), runs.page()),
                                         (rows.get(system.page, "none"), figures_row(system, runs))):
                    differs = difference(shown_here, made, {"relative": "1e-4"})
                    mine += [differs[1]] if differs else []
        found += [f"docs/gallery/{system.page}.md: {problem}" for problem in mine]
    if contents != index(rows) or set(rows) != {system.page for system in SYSTEMS}:
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
        print("\n".join(found) if found else f"{len(SYSTEMS)} systems, {sum(system.quick for system in SYSTEMS)} of them run")
        sys.exit(1 if found else 0)
    if len(arguments) >= 3 and arguments[1] == "write":
        write(Path(arguments[2]).resolve(), arguments[3:])
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main(sys.argv)
