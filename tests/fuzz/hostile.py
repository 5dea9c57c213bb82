#!/usr/bin/env python3
"""Input made to do harm: every case is refused or handled, and nothing of it gets out.

    hostile.py PROGRAM SOURCE [--all] [--show] [--jobs N]

For every case: the exit code is one that was expected, never a signal or an internal error; less than 2 s of processor
time and 1 GB of memory; what the terminal gets has no control characters but line ends and tabs; no file outside the
output folder appeared or changed; report.html has no scripts and handlers but its own, pictures are well-formed and
have none. The limits of docs/limits.md are tried at the limit and one beyond.

Without --all a share of the texts is taken that go through whole runs.
"""

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

SLOWNESS = float(os.environ.get("ORBID_TEST_SLOWNESS", "1"))  # of a program with sanitizers
SECONDS, BYTES = 2.0 * SLOWNESS, 10**9
REFUSED, HANDLED = (2, 3), (0, 1, 2, 3)
ACTING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]")

TEXTS = {
    "script": "</script><script>alert(1)</script>", "image": "\"><img src=x onerror=alert(1)>",
    "attribute": "' onmouseover='alert(1)' x='", "quote": "\" onfocus=\"alert(1)\" autofocus=\"", "style": "</style><svg onload=alert(1)>",
    "comment": "--><!-- <script>", "section": "]]><script>alert(1)</script>", "entity": "&lt;script&gt;&#0;&x;",
    "link": "javascript:alert(1)", "template": "{{7*7}}${7*7}#{7*7}", "format": "%s%n%x{}{0}{:99999999}",
    "title of a terminal": "\x1b]0;owned\x07", "clear screen": "\x1b[2J\x1b[H\x1b[31m", "clipboard": "\x1b]52;c;YQ==\x1b\\",
    "carriage return": "good\rbad", "backspace": "bad\b\b\bgood", "C1": "a\x9b31m\x9d0;x\x9c", "delete": "a\x7fb",
    "right to left": "\u202egpj.exe\u2066x\u2069", "byte order mark": "\ufeffx", "null": "a\x00b",
    "parents": "../../outside", "absolute": "/tmp/orbid-outside", "shell": "$(touch outside)`touch outside`;touch outside",
    "line end": "a\nb: c\n", "comma": "a,b;c\td", "long": "x" * 20000, "wide": "\U0001d54f" * 500, "formula": "=cmd|'/c calc'!A1",
}


class Case:
    def __init__(self, name, make, expected, command=("check",), within=None):
        self.name, self.make, self.expected, self.command, self.within = name, make, expected, command, within


class Page(HTMLParser):
    """Scripts that run, and what could run one without being a script."""

    def __init__(self):
        super().__init__(convert_charrefs=True)
        self.scripts, self.bad, self.runs = 0, [], False

    def handle_starttag(self, tag, attributes):
        self.runs = tag == "script" and dict(attributes).get("type") != "application/json"
        self.scripts += self.runs
        if tag in ("iframe", "object", "embed", "base", "form"):
            self.bad.append(tag)
        for key, value in attributes:
            if key.startswith("on") or (value or "").strip().lower().startswith("javascript:"):
                self.bad.append(f"{tag} {key}")

    def handle_endtag(self, tag):
        self.runs = self.runs and tag != "script"

    def handle_data(self, data):
        if self.runs and "alert(1)" in data:
            self.bad.append("a script of the job's")


def pendulum(**changes):
    job = {"title": "t", "model": {"name": "free_pendulum", "parameters": {"w0sq": 9.81}},
           "data": {"name": "swing", "file": "swing.csv", "kind": "samples",
                    "columns": {"segment": "segment", "time": "t", "phi": "phi", "phi_dot": "phi_dot"}, "observe": ["phi"]},
           "estimate": {"parameters": {"w0sq": {"start": 9.0}}, "residuals": [{"type": "series"}]},
           "output": {"series": "none"}}
    for place, value in changes.items():
        *parents, last = place.split("__")
        at = job
        for key in parents:
            at = at[key]
        at[last] = value
    return job


def equations(text="-k * x", coordinate="x", parameter="k", **more):
    return {"model": {"equations": {coordinate: text, "w": f"-{parameter} * w"}, "parameters": {parameter: 1.0}, **more},
            "data": {"simulate": {"samples": {"step": 0.1, "count": 5}, "initial": [[1.0, 1.0]]}}}


def table(header="segment,t,phi,phi_dot", label="a", rows=60, cell="0.1"):
    lines = [header]
    for k in range(rows):
        lines.append(f"{label},{k * 0.05:.2f},{1.0 - 0.01 * k:.3f},{cell}")
    return ("\n".join(lines) + "\n").encode("utf-8", "surrogateescape")


def write(folder, name, content):
    path = folder / name
    if isinstance(content, (dict, list)):
        content = json.dumps(content)
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))
    return str(path)


def quoted(text):
    return '"' + text.replace('"', '""') + '"'


def texts_in_jobs(source):
    """Texts at all places of a job that are checked; most places refuse them."""
    swing = (source / "tests/report/hostile_names.csv").read_bytes()
    places = ["title", "data__name", "data__file", "data__kind", "model__name", "data__columns__time", "data__observe",
              "estimate__residuals", "unknown"]
    for name, text in TEXTS.items():
        for place in places:
            def make(folder, text=text, place=place):
                write(folder, "swing.csv", swing)
                value = [text] if place == "data__observe" else [{"type": text}] if place.endswith("residuals") else text
                return [write(folder, "job.json", pendulum(**{place: value}))]
            yield Case(f"{name} as {place.replace('__', '/')}", make, HANDLED)
        yield Case(f"{name} as a key", lambda folder, text=text: [write(folder, "job.json", {text: 1})], REFUSED)
        yield Case(f"{name} as coordinate", lambda folder, text=text: [write(folder, "job.json", equations(coordinate=text))],
                   HANDLED)
        yield Case(f"{name} as formula", lambda folder, text=text: [write(folder, "job.json", equations(text))], HANDLED)


def texts_in_runs(source):
    """Whole runs with texts where they are accepted."""
    swing = (source / "tests/report/hostile_names.csv").read_bytes()

    def titled(folder, text):
        write(folder, "swing.csv", swing)
        return [write(folder, "job.json", pendulum(title=text)), "--out", str(folder / "out")]

    def headed(folder, text):
        lines = swing.split(b"\n")
        at = next(i for i, line in enumerate(lines) if line and not line.startswith(b"#"))
        header = lines[at].decode().split(",")
        lines[at] = ",".join(quoted(text) if name == "phi" else name for name in header).encode()
        write(folder, "swing.csv", b"\n".join(lines))
        return [write(folder, "job.json", pendulum(data__columns__phi=text)), "--out", str(folder / "out")]

    def labelled(folder, text):
        lines = [line for line in swing.split(b"\n") if line and not line.startswith(b"#")]
        column = lines[0].decode().split(",").index("segment")
        for i in range(1, len(lines)):
            cells = lines[i].decode().split(",")
            cells[column] = quoted(text)
            lines[i] = ",".join(cells).encode()
        write(folder, "swing.csv", b"\n".join(lines) + b"\n")
        return [write(folder, "job.json", pendulum()), "--out", str(folder / "out")]

    def of_file(folder, text):
        name = text.replace("/", "_").replace("\x00", "_")[:60] + ".csv"
        write(folder, name, swing)
        return [write(folder, "job.json", pendulum(data__file=name)), "--out", str(folder / "out")]

    def united(folder, text):
        job = equations()
        job["model"]["parameters"] = {"k": {"value": 1.0, "unit": text, "description": text}}
        job["title"] = text
        return [write(folder, "job.json", job), "--out", str(folder / "out")]

    for name, text in TEXTS.items():
        for place, make in (("title", titled), ("header", headed), ("label", labelled), ("file", of_file), ("unit", united)):
            yield Case(f"run with {name} as {place}", lambda folder, make=make, text=text: make(folder, text), HANDLED,
                       ("run",), "out")


def at_the_limits():
    """(name, job at the limit, job one beyond)"""
    nested = lambda n: equations("(" * n + "-k * x" + ")" * n)
    long = lambda n: equations("-k * x" + " " * (n - 6))
    terms = lambda n: equations("-k * x" + " + x" * n)
    levels = lambda n: '{"title": ' + "[" * (n - 1) + "]" * (n - 1) + "}"
    values = lambda n: '{"title": [' + "0," * (n - 3) + "0]}"
    yield "nesting of a formula", nested(198), nested(201), nested(10**5)
    yield "length of a formula", long(20000), long(20001), terms(10**6)
    yield "length of a name", equations("-k * " + "x" * 100, "x" * 100), equations("-k * " + "x" * 101, "x" * 101), \
        equations(coordinate="x" * 10**5)
    yield "length of a parameter's name", equations(f"-{'k' * 100} * x", parameter="k" * 100), \
        equations(f"-{'k' * 101} * x", parameter="k" * 101), equations(parameter="k" * 10**5)
    yield "length of a title", pendulum(title="t" * 20000), pendulum(title="t" * 20001), pendulum(title="t" * 10**7)
    yield "levels of a job", levels(64), levels(65), levels(10**6)
    yield "values of a job", values(4 * 10**6), values(4 * 10**6 + 1), values(10**7)
    yield "equations", {**equations(), "model": many(64)}, {**equations(), "model": many(65)}, \
        {**equations(), "model": many(10**4)}


def many(count):
    return {"equations": {f"x{i}": f"-k * x{i}" for i in range(count)}, "parameters": {"k": 1.0}}


def sparse(folder, name, size, start=b""):
    path = folder / name
    with path.open("wb") as file:
        file.write(start)
        file.truncate(size)
    return str(path)


def limits():
    for name, at, beyond, far in at_the_limits():
        within = name if name not in ("levels of a job", "values of a job", "equations") else None
        yield Case(f"{name}: at the limit", lambda folder, job=at: [write(folder, "job.json", job)],
                   (0, 3) if within else HANDLED)
        yield Case(f"{name}: one beyond", lambda folder, job=beyond: [write(folder, "job.json", job)], (2,))
        yield Case(f"{name}: far beyond", lambda folder, job=far: [write(folder, "job.json", job)], (2,))
    yield Case("a job of 64 MB", lambda folder: [sparse(folder, "job.json", 64 << 20, b"{}" + b" " * 1000)], (2,))
    yield Case("a job of one byte more", lambda folder: [sparse(folder, "job.json", (64 << 20) + 1, b"{}")], (2,))
    yield Case("a job of 1 GB", lambda folder: [sparse(folder, "job.json", 1 << 30, b"{}")], (2,))

    def with_table(content):
        return lambda folder: (write(folder, "swing.csv", content), [write(folder, "job.json", pendulum())])[1]

    columns = lambda n: ("segment,t,phi,phi_dot" + ",c" * (n - 4)).encode()
    row = lambda n, k: f"\na,{k * 0.05:.2f},{1 - 0.01 * k:.3f},0.1".encode() + b",1" * (n - 4)
    for n, expected in ((100000, (0,)), (100001, (3,))):
        content = columns(n) + b"".join(row(n, k) for k in range(30)) + b"\n"
        yield Case(f"a table of {n} columns", with_table(content), expected)
    limit = 16 << 20
    line = b"segment,t,phi,phi_dot,\"" + b"x" * (limit - 24) + b"\""
    yield Case("a line of 16 MB", with_table(line + b"".join(row(4, k) + b",1" for k in range(60)) + b"\n"), (0,))
    yield Case("a line of one byte more", with_table(line[:-1] + b"x\"" + b"\n"), (3,))

    def endless(folder):
        sparse(folder, "swing.csv", 1 << 30, b"segment,t," + b"x" * (17 << 20))
        return [write(folder, "job.json", pendulum())]
    yield Case("a line of 1 GB", endless, (3,))
    yield Case("a line of 1 GB in a run", lambda folder: endless(folder) + ["--out", str(folder / "out")], (3,), ("run",))
    yield Case("a header of 10^5 columns, none the right one",
               with_table((",".join(f"column{i}" for i in range(10**5)) + "\n").encode()), (3,))
    yield Case("a column's name of 10^5 characters",
               with_table(("y" * 10**5 + ",t,phi,phi_dot\na,0,1,1\na,1,1,1\n").encode()), (3,))


def devices():
    for name in ("/dev/zero", "/dev/random", "/dev/stdin", "/dev/tty", "/dev/null", "/proc/self/mem", "/", "."):
        yield Case(f"{name} as data", lambda folder, name=name: [write(folder, "job.json", pendulum(data__file=name))],
                   REFUSED)
        yield Case(f"{name} behind a link as data", lambda folder, name=name: linked(folder, name), (3,))
        if name not in ("/dev/stdin", "/dev/tty"):
            yield Case(f"{name} as a job", lambda folder, name=name: [name], REFUSED)
    for ending in ("csv", "h5", "mat"):
        def pipe(folder, ending=ending):
            os.mkfifo(folder / f"swing.{ending}")
            job = pendulum(data__file=f"swing.{ending}")
            if ending == "h5":
                del job["data"]["columns"]
            return [write(folder, "job.json", job)]
        yield Case(f"a pipe as {ending}", pipe, (3,))
        yield Case(f"a pipe as {ending} in a run", lambda folder, pipe=pipe: pipe(folder) + ["--out", str(folder / "out")],
                   (3,), ("run",))
    for name in ("job.json", "result.json", "cycles.json", "residuals.csv"):
        def stored(folder, name=name):
            run = folder / "run"
            run.mkdir()
            if name != "job.json":
                write(run, "job.json", {"format": "orbid-job/1", **pendulum()})
            os.mkfifo(run / name)
            return [str(run)]
        yield Case(f"a pipe as stored {name}", stored, (2, 3), ("report",))


def linked(folder, target):
    (folder / "swing.csv").symlink_to(target)
    return [write(folder, "job.json", pendulum())]


def links(source):
    """Links in an output folder lead out of it: what they point to stays as it is."""
    swing = (source / "tests/report/hostile_names.csv").read_bytes()

    def prepared(folder, names):
        out, outside = folder / "out", folder / "outside"
        out.mkdir()
        outside.mkdir()
        write(folder, "swing.csv", swing)
        for name in names:
            (outside / name).write_text("untouched")
            (out / name).symlink_to(outside / name)
        return [write(folder, "job.json", pendulum()), "--out", str(out), "--force"]

    names = ("result.json", "report.html", "residuals.csv", "log.txt", "timing.json", "job.json", "checkpoint.bin", "series.h5")
    yield Case("results behind links", lambda folder: prepared(folder, names), (0, 1), ("run",), "out")
    yield Case("a lock behind a link", lambda folder: prepared(folder, (".orbid-lock",)), (2,), ("run",), "out")
    for name in ("../../outside/x", "/tmp/x", "a/b", ".."):
        several = {"model": {"name": "henon", "parameters": {"a": 1.4, "b": 0.3}}, "data": [
            {"name": n, "simulate": {"sections": 20, "initial": [[0.1, 0.1]]}} for n in (name, "other")]}
        yield Case(f"an experiment called {name}", lambda folder, job=several: [write(folder, "job.json", job), "--out",
                   str(folder / "out")], (2,), ("run",), "out")


def libraries():
    """In the current folder, which the loader is not to search."""
    def make(folder):
        for name in ("libstdc++.so.6", "libc.so.6", "libz.so.1", "libtbb.so.12", "libhdf5.so", "libmpi.so.40"):
            write(folder, name, "no library")
        write(folder, "swing.csv", table())
        return [write(folder, "job.json", pendulum())]
    yield Case("libraries in the current folder", make, (0,))


def cases(source, whole):
    runs = list(texts_in_runs(source))
    yield from texts_in_jobs(source)
    yield from (runs if whole else runs[::4])
    yield from limits()
    yield from devices()
    yield from libraries()
    yield from links(source)


def snapshot(folder, within):
    found = {}
    for path in sorted(folder.rglob("*")):
        relative = path.relative_to(folder)
        if within and relative.parts[0] == within:
            continue
        status = path.lstat()
        found[str(relative)] = (status.st_size, status.st_mtime_ns, status.st_mode)
    return found


def page_is_clean(path):
    page = Page()
    page.feed(path.read_text())
    page.close()
    own = 2  # one marks that scripts run, the other makes charts live
    return page.bad + ([f"{page.scripts} scripts that run"] if page.scripts > own else [])


def picture_is_clean(path):
    root = ElementTree.parse(path).getroot()
    wrong = []
    for element in root.iter():
        if element.tag.endswith("}script") or element.tag.endswith("}foreignObject"):
            wrong.append(element.tag)
        wrong += [key for key in element.attrib if key.startswith("on")]
    return wrong


def limited():
    resource.setrlimit(resource.RLIMIT_CPU, (int(30 * SLOWNESS), int(30 * SLOWNESS)))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def tried(program, case):
    """What is wrong with a case; empty: nothing."""
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as temporary:
        folder = Path(temporary)
        words = case.make(folder)
        before = snapshot(folder, case.within)
        environment = {**os.environ, "ORBID_CXX": "", "HOME": str(folder / "out")}
        with open(folder.parent / (folder.name + ".said"), "w+b") as said:
            run = subprocess.Popen([program, *case.command, *words], stdin=subprocess.DEVNULL, stdout=said,
                                   stderr=subprocess.STDOUT, env=environment, cwd=folder, preexec_fn=limited)
            signal_at = 60 * SLOWNESS
            try:
                pid, status, usage = wait(run, signal_at)
            finally:
                os.unlink(said.name)
            said.seek(0)
            text = said.read()
        wrong = []
        code = os.waitstatus_to_exitcode(status)
        if code not in case.expected:
            wrong.append(f"exit code {code} instead of {case.expected}")
        seconds, memory = usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024
        if seconds > SECONDS and "run" not in case.command:
            wrong.append(f"{seconds:.1f} s")
        if memory > BYTES:
            wrong.append(f"{memory / 1e9:.2f} GB")
        shown = text.decode("utf-8", "surrogateescape")
        if found := ACTING.search(shown):
            wrong.append(f"{found[0]!r} reaches the terminal")
        if re.search("[\udc80-\udcff]", shown):
            wrong.append("bytes that are no UTF-8 reach the terminal")
        if b"internal error" in text:
            wrong.append("internal error")
        if len(text) > 200_000:
            wrong.append(f"{len(text)} bytes of messages")
        after = snapshot(folder, case.within)
        if "run" not in case.command[:1] or case.within:
            if before != after:
                wrong.append(f"changed outside: {sorted(set(before.items()) ^ set(after.items()))[:4]}")
        out, shown = folder / "out", 0
        for path in out.rglob("*") if out.is_dir() else ():
            if path.name.endswith(".html"):
                wrong += page_is_clean(path)
                shown += 1
            elif path.name.endswith(".svg"):
                wrong += picture_is_clean(path)
                shown += 1
        return wrong, seconds, memory, text, shown


def wait(run, seconds):
    def end(*_):
        run.kill()
    timer = threading.Timer(seconds, end)
    timer.start()
    try:
        pid, status, usage = os.wait4(run.pid, 0)
        run.returncode = os.waitstatus_to_exitcode(status)
        return pid, status, usage
    finally:
        timer.cancel()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program")
    parser.add_argument("source", type=Path)
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--show", action="store_true")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    options.program = str(Path(options.program).resolve())
    every = list(cases(options.source, options.all))
    failures, pages, slowest, largest = 0, 0, (0.0, ""), (0, "")
    with ThreadPoolExecutor(options.jobs) as pool:
        for case, (wrong, seconds, memory, text, shown) in zip(every, pool.map(lambda c: tried(options.program, c), every)):
            pages += shown
            slowest, largest = max(slowest, (seconds, case.name)), max(largest, (memory, case.name))
            if wrong:
                failures += 1
                print(f"{case.name}: {'; '.join(wrong)}")
                if options.show:
                    print("   ", text[:600])
    print(f"{len(every)} cases, {pages} pages and pictures, {failures} failures; slowest {slowest[0]:.2f} s ({slowest[1]}), "
          f"largest {largest[0] / 1e6:.0f} MB ({largest[1]})")
    sys.exit(1 if failures or pages == 0 else 0)  # without a page none was looked at


if __name__ == "__main__":
    main()
