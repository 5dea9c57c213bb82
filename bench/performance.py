"""The table of what benchmarks compare: collected from what they print, kept in docs/performance.md.

Rows are "ratio | task | peer | ours | theirs | ours / theirs" (ratio.hpp).
"""
import os
import platform
import re
import subprocess
from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / "docs/performance.md"
REGRESSION = 1.1
PEERS = {"Ceres": "libceres-dev", "Boost.Odeint": "libboost-dev", "SUNDIALS (CVODES)": "libsundials-dev",
         "nanoflann": "libnanoflann-dev", "AUTO-07p": "auto-07p"}


def row_of(line):
    """Cells of a row that a benchmark printed; nothing for any other line."""
    cells = [cell.strip() for cell in line.split("|")]
    return tuple(cells[1:]) if len(cells) == 6 and cells[0] == "ratio" else None


def stored(page=PAGE):
    """Ratios of the page by task and peer."""
    if not page.exists():
        return {}
    cells = [[cell.strip() for cell in line.strip("| \n").split("|")] for line in page.read_text("utf-8").splitlines()]
    return {(c[0], c[1]): float(c[4]) for c in cells if len(c) == 5 and re.fullmatch(r"[0-9.]+", c[4])}


def regressions(rows, before):
    """Sentences about what takes more than a tenth longer, beside its peer, than the page says."""
    for task, peer, _, _, ratio in rows:
        known = before.get((task, peer))
        if known is not None and float(ratio) > REGRESSION * known:
            yield f"slower than docs/performance.md: {task}: {ratio} of {peer}, was {known:.3f}"


def version(package):
    done = subprocess.run(["dpkg-query", "-W", "-f=${Version}", package], capture_output=True, text=True, check=False)
    return done.stdout.split("+")[0] if done.returncode == 0 else "not installed"


def machine():
    """Processor, cores and compiler, as the page names them."""
    found = re.search(r"model name\s*:\s*(.*)", Path("/proc/cpuinfo").read_text("utf-8"))
    compiler = subprocess.run(["c++", "-dumpfullversion"], capture_output=True, text=True, check=False).stdout.strip()
    return f"{found.group(1) if found else platform.machine()}, {os.cpu_count()} cores, GCC {compiler}"


def text(rows, date, load):
    peers = ", ".join(f"{name} {version(package)}" for name, package in PEERS.items())
    lines = ["# Performance", "",
             "Made by `./dev bench --write`; every row is one task that orbid and a peer do in the same run, to equal",
             "error or to the same result. The last column is our time over the peer's: below 1 orbid is faster.",
             "`./dev bench` names every ratio that is more than a tenth above the one here. Times depend on the machine",
             "and on what else runs there; ratios of threads and of short tasks scatter by a tenth or two.", "",
             f"* Measured on {date}: {machine()}; load of the machine {load}.",
             f"* Peers: {peers}.", "",
             "| task | peer | orbid | peer's time | ratio |", "|---|---|---|---|---|"]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"
