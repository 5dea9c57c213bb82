"""Jobs from Python: the same runs, files and numbers as the command line's."""

from __future__ import annotations

import csv
import hashlib
import json
import math
import os
import pathlib
import tempfile
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Mapping, Optional, Set, Tuple, Union

import numpy as np
import numpy.typing as npt

from . import _orbid
from .equation import _pointer

Job = Union[Mapping[str, Any], str, "os.PathLike[str]"]


@dataclass(frozen=True)
class Problem:
    """Something wrong with a job, where, and which rule it breaks."""

    pointer: str
    """JSON Pointer (RFC 6901); empty: the whole job, or a file."""
    rule: str
    text: str
    """All of it as one line."""
    line: Optional[int] = None
    """From 1; None where the job is a dict."""
    column: Optional[int] = None
    data: bool = False
    """A data file that cannot be read, not the job itself."""


class JobError(ValueError):
    """A job that cannot be run; the message names the JSON Pointer of every problem."""

    def __init__(self, message: str, problems: Optional[List[Problem]] = None) -> None:
        super().__init__(message)
        self.problems: List[Problem] = problems or []


@dataclass(frozen=True)
class ResultEntry:
    """A number of result.json with its uncertainty; nan where there is none."""

    value: float
    sd: float
    interval95: Tuple[float, float]
    unit: str
    entry: Mapping[str, Any]
    """The whole entry of result.json."""
    one_sided: Optional[str] = None
    """The end of interval95 that is a one-sided limit, "lower" or "upper"; the other end is a bound."""

    def __repr__(self) -> str:
        return f"ResultEntry({self.value} +- {self.sd} {self.unit})"


@dataclass(frozen=True)
class Verdict:
    """Whether an estimate can be trusted."""

    trust: str
    """"all": values and intervals, "values": not the intervals, "none"."""
    line: str
    because: Tuple[str, ...]
    """All reasons."""


def _number(value: Optional[float]) -> float:
    return float("nan") if value is None else float(value)


def _entry(entry: Mapping[str, Any]) -> ResultEntry:
    lower, upper = entry.get("interval95") or (None, None)
    return ResultEntry(_number(entry.get("value")), _number(entry.get("sd")), (_number(lower), _number(upper)),
                       entry.get("unit") or "", entry, entry.get("one_sided"))


def _table(path: pathlib.Path, text: Set[str]) -> npt.NDArray[Any]:
    """A file of columns as a structured array: those of `text` as str, others as float64 (empty cells nan)."""
    with open(path, newline="", encoding="utf-8") as file:
        header, *rows = list(csv.reader(file))
    columns = []
    for k, name in enumerate(header):
        cells = [row[k] for row in rows]
        columns.append(np.array(cells, dtype=np.str_) if name in text else
                       np.array([float(cell) if cell else np.nan for cell in cells], dtype=np.float64))
    return np.rec.fromarrays(columns, names=header).view(np.ndarray)  # type: ignore[call-overload, no-any-return]


class Run:
    """A run and its folder of results."""

    def __init__(self, folder: pathlib.Path, result: Dict[str, Any], exit_code: int = 0, summary: str = "",
                 messages: str = "", keep: Optional[tempfile.TemporaryDirectory[str]] = None) -> None:
        self.folder = folder
        self.result = result
        """Content of result.json; empty: the job has no estimate, or was interrupted before it."""
        self.exit_code = exit_code
        """That of the command line: 0 done, 1 without a valid answer, 130 interrupted."""
        self.summary = summary
        """The tables that the command line prints."""
        self.messages = messages
        """Progress and remarks, as on standard error."""
        self._keep = keep

    @property
    def status(self) -> str:
        """converged, no_progress, iteration_limit, singular, failed or interrupted; done or nothing_found of jobs
        without an estimate."""
        if self.exit_code == 130:
            return "interrupted"
        return str(self.result.get("status", "done" if self.exit_code == 0 else "nothing_found"))

    @property
    def verdict(self) -> Optional[Verdict]:
        """What an engineer must know about the estimate, in one line; None where there is none."""
        found = self.result.get("verdict")
        return Verdict(found["trust"], found["line"], tuple(found["because"])) if found else None

    @property
    def parameters(self) -> Dict[str, ResultEntry]:
        """What was estimated, by name."""
        return {name: _entry(entry) for name, entry in self.result.get("parameters", {}).items()}

    @property
    def derived(self) -> Dict[str, ResultEntry]:
        """Derived quantities, by name."""
        return {name: _entry(entry) for name, entry in self.result.get("derived", {}).items()}

    @property
    def intervals(self) -> Dict[str, Mapping[str, Any]]:
        """Intervals by simulation, by name: entries of "intervals" in result.json; error scales as "series.u.scale".
        Empty: the job asks for none, or they were refused."""
        block = self.result.get("intervals") or {}
        return {name: entry for kind in ("parameters", "derived", "errors")
                for name, entry in (block.get(kind) or {}).items()}

    @property
    def replicates(self) -> npt.NDArray[Any]:
        """bootstrap.csv as a structured array: "replicate", "status", and "NAME", "sd(NAME)" of each quantity (nan of
        those that failed)."""
        return _table(self.folder / "bootstrap.csv", {"status"})

    @property
    def residuals(self) -> npt.NDArray[Any]:
        """residuals.csv as a structured array: text columns as str, numbers as float64 (empty cells nan)."""
        return _table(self.folder / "residuals.csv", {"experiment", "segment_or_cycle", "coordinate"})

    def __repr__(self) -> str:
        return f"Run({self.status}, {self.folder})"


def _refused(pointer: str, rule: str) -> JobError:
    text = f"{pointer}: {rule}" if pointer else rule
    return JobError(text, [Problem(pointer, rule, text)])


def _plain(value: Any, pointer: str = "") -> Any:
    """A value as JSON has it: NumPy's numbers and arrays as numbers and lists."""
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise _refused(pointer, f"the key {key!r} is no text")
        return {key: _plain(item, pointer + _pointer(key)) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(item, f"{pointer}/{k}") for k, item in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        raise _refused(pointer, f"{value}: must be a finite number")
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise _refused(pointer, f"{type(value).__name__} has no form in JSON")


def _write_table(columns: Mapping[str, Any], pointer: str, folder: pathlib.Path) -> str:
    """Columns as a table in the folder, named by its content: shortest decimals that read back to the same double."""
    if not columns:
        raise _refused(pointer, "no column")
    cells: List[List[str]] = []
    for name, given in columns.items():
        if isinstance(given, np.ma.MaskedArray):
            raise _refused(f"{pointer}/{name}", 'a masked array; fill it with nan and say "missing": "nan"')
        column = np.asarray(given)
        if column.ndim != 1:
            raise _refused(f"{pointer}/{name}", f"shape {column.shape}, needs one dimension")
        if column.dtype.kind not in "fiuU":
            raise _refused(f"{pointer}/{name}", f"of type {column.dtype}; needs numbers (or text: labels of segments)")
        if column.dtype.kind != "U":
            try:
                _orbid._numbers(column, name)  # doubles are read from the file: nothing may be rounded on its way there
            except (TypeError, ValueError) as error:
                raise _refused(f"{pointer}/{name}", str(error).partition(": ")[2]) from None
        if cells and len(column) != len(cells[0]):
            raise _refused(f"{pointer}/{name}", f"{len(column)} entries, the other columns have {len(cells[0])}")
        quoted = column.dtype.kind == "U"
        cells.append(['"' + x.replace('"', '""') + '"' if quoted else repr(x) for x in column.tolist()])
    header = ",".join('"' + name.replace('"', '""') + '"' for name in columns)
    text = "\n".join([header, *(",".join(row) for row in zip(*cells)), ""])
    file = folder / "arrays" / (hashlib.sha256(text.encode()).hexdigest()[:16] + ".csv")
    file.parent.mkdir(parents=True, exist_ok=True)
    unfinished = file.with_suffix(".part")
    unfinished.write_text(text, encoding="utf-8")
    unfinished.replace(file)
    return str(file.resolve())


def _with_tables(job: Any, folder: pathlib.Path, place: str = "") -> Any:
    """A job, or the jobs of a campaign, with data whose "file" is a dict of arrays written to files."""
    if not isinstance(job, Mapping):
        return job
    if "kind" in job:
        campaign = dict(job)
        if "job" in job:
            campaign["job"] = _with_tables(job["job"], folder, "/job")
        if isinstance(job.get("jobs"), Mapping):
            campaign["jobs"] = {name: _with_tables(one, folder, "/jobs" + _pointer(name))
                                for name, one in job["jobs"].items()}
        return campaign
    data: Any = job.get("data")
    several = isinstance(data, (list, tuple))
    written: List[Any] = []
    for k, block in enumerate(data if several else [data]):
        pointer = f"{place}/data/{k}/file" if several else f"{place}/data/file"
        if isinstance(block, Mapping) and isinstance(block.get("file"), Mapping):
            columns = block["file"]
            own_names = {"time" if name == "t" else name: name for name in columns}
            block = {"columns": own_names, **block, "file": _write_table(columns, pointer, folder)}
        written.append(block)
    return dict(job) if data is None else {**job, "data": written if several else written[0]}


def _problem(row: Tuple[str, int, int, str, bool, str], with_lines: bool) -> Problem:
    pointer, line, column, rule, data, text = row
    if with_lines:
        return Problem(pointer, rule, text, line or None, column or None, data)
    return Problem(pointer, rule, f"{pointer}: {rule}" if pointer else rule, data=data)


def _text_of(job: Job, folder: pathlib.Path) -> Tuple[str, pathlib.Path, bool]:
    """Text of a job, the file that its paths are relative to, whether its lines mean something to the caller."""
    if isinstance(job, Mapping):
        return json.dumps(_plain(_with_tables(job, folder)), indent=1), pathlib.Path.cwd() / "job.json", False
    if isinstance(job, str) and job.lstrip().startswith("{"):
        return job, pathlib.Path.cwd() / "job.json", True
    if isinstance(job, (str, os.PathLike)):
        file = pathlib.Path(job)
        return file.read_text(encoding="utf-8"), file, True
    raise TypeError(f"job: a dict, JSON text or the path of a job file is needed, not {type(job).__name__}")


def _folder_of(job: Job, out: Union[str, "os.PathLike[str]", None]
               ) -> Tuple[pathlib.Path, Optional[tempfile.TemporaryDirectory[str]]]:
    """Where results go; a temporary folder where nothing names one."""
    if out is not None:
        return pathlib.Path(out), None
    if isinstance(job, Mapping) or (isinstance(job, str) and job.lstrip().startswith("{")):
        keep = tempfile.TemporaryDirectory(prefix="orbid-")
        return pathlib.Path(keep.name), keep
    return pathlib.Path(job).with_suffix(""), None


def check(job: Job) -> List[Problem]:
    """All problems of a job or a campaign, those of its data files included; none: it can be run."""
    with tempfile.TemporaryDirectory(prefix="orbid-") as folder:
        try:
            text, source, with_lines = _text_of(job, pathlib.Path(folder))
        except JobError as error:
            return error.problems
        return [_problem(row, with_lines) for row in _orbid.job_problems(text, source)]


def run(job: Job, out: Union[str, "os.PathLike[str]", None] = None, *, threads: int = 0, stage: str = "all",
        force: bool = False, progress: Optional[Callable[[str], object]] = None) -> Run:
    """Runs a job as the command line does, and returns its results.

    job       a dict with the keys of a job file, JSON text (beginning with "{"), or the path of a job file. Paths in it
              are relative to the current folder, those of a job file to that file. In a dict, "file" of the data may be
              a dict of columns, {"t": array, "x": array}: they are written to a table in `out`.
    out       folder of the results; None: a job file's path without its ending, else a temporary folder that goes with
              the Run.
    threads   at most so many; 0: all.
    stage     "all", or one of simulate, orbits, periodic, estimate.
    force     overwrite a folder that holds the result of another job.
    progress  called with each line of progress, by other threads than this one, one at a time.

    Ctrl-C stops the run at its next step: the Run then has status "interrupted" and the best estimate so far.
    Raises JobError for a job that cannot be run, or data that cannot be used.
    """
    if isinstance(threads, bool) or threads < 0:
        raise ValueError(f"threads = {threads}: must be a whole number >= 0")
    folder, keep = _folder_of(job, out)
    there, tables = folder.exists(), _tables(folder)
    try:
        return _run(job, folder, threads, stage, force, progress, keep)
    except Exception:
        _as_before(folder, there, tables)
        raise


def _as_before(folder: pathlib.Path, there: bool, tables: Set[pathlib.Path]) -> None:
    """Takes back what was written for a job that was refused."""
    _remove_tables(folder, _tables(folder) - tables)
    if not there and folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def _tables(folder: pathlib.Path) -> Set[pathlib.Path]:
    return set((folder / "arrays").glob("*.csv"))


def _remove_tables(folder: pathlib.Path, tables: Set[pathlib.Path]) -> None:
    """Takes back tables of a job that was refused: its folder is as it was before. Those of a run that began are part
    of its job.json and stay."""
    stored = folder / "job.json"
    text = stored.read_text(encoding="utf-8") if stored.exists() else ""
    for table in tables:
        if table.name not in text:
            table.unlink(missing_ok=True)
    if tables and not any((folder / "arrays").iterdir()):
        (folder / "arrays").rmdir()


def _run(job: Job, folder: pathlib.Path, threads: int, stage: str, force: bool,
         progress: Optional[Callable[[str], object]], keep: Optional[tempfile.TemporaryDirectory[str]]) -> Run:
    text, source, with_lines = _text_of(job, folder)
    exit_code, rows, summary, messages, result = _orbid.run_job(text, source, folder, threads, stage, force, progress)
    if exit_code == 3 and not rows:
        # Data are read while the job runs, which tells their problems as text.
        rows = _orbid.job_problems(text, source)
    problems = [_problem(row, with_lines) for row in rows]
    if problems:
        raise JobError("\n".join(problem.text for problem in problems), problems)
    if exit_code not in (0, 1, 130):
        raise JobError(messages.strip() or summary.strip())
    return Run(folder, json.loads(result) if result else {}, exit_code, summary, messages, keep)


def stored_run(folder: Union[str, "os.PathLike[str]"]) -> Run:
    """A run that is stored in a folder, by the command line or by run()."""
    path = pathlib.Path(folder)
    file = path / "result.json"
    if not file.exists():
        raise FileNotFoundError(f"{file}: there is no result of a run in this folder")
    result = json.loads(file.read_text(encoding="utf-8"))
    return Run(path, result, {"interrupted": 130, "converged": 0}.get(result.get("status"), 1))
