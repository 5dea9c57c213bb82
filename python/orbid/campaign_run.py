"""Campaigns from Python: many runs with one journal, made here or by the command line."""

from __future__ import annotations

import contextlib
import json
import os
import pathlib
import sqlite3
import tempfile
import zlib
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterator, List, Optional, Sequence, Tuple, Union
from urllib.parse import quote

import numpy as np
import numpy.typing as npt

from . import _orbid
from .job import Job, JobError, _as_before, _folder_of, _problem, _tables, _text_of

_JOURNAL = "campaign.sqlite"
_TIMES = ("attempts", "host", "rank", "started", "seconds", "processor_seconds")
_TEXTS = ("state", "status", "message", "host", "parameter")

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class CampaignProgress:
    """How far a running campaign is."""

    tasks: int
    waiting: int
    """Those in work included."""
    done: int
    """Ended with a result, valid or not."""
    failed: int
    """Ended without one."""
    in_work: int
    seconds: float
    """Since the call."""
    remaining: float
    """Seconds that are expected from what tasks have taken; nan: nothing is known yet."""


def _unchangeable(file: pathlib.Path) -> bool:
    """Readers of a journal share memory in its folder. Where that cannot be written, and no log is left, nobody changes
    the file either."""
    log = file.with_name(file.name + "-wal")
    return not os.access(file.parent, os.W_OK) and (not log.exists() or log.stat().st_size == 0)


def _structured(columns: Sequence[Tuple[str, Array]]) -> Array:
    table = np.empty(len(columns[0][1]), dtype=[(name, column.dtype) for name, column in columns])
    for name, column in columns:
        table[name] = column
    return table


def _column(name: str, cells: Sequence[Any]) -> Array:
    """Cells of SQL: text as str ("" where there is none), numbers as float64 (nan)."""
    if name == "number":
        return np.array(cells, dtype=np.int64)
    if name in _TEXTS:
        return np.array([cell or "" for cell in cells], dtype=np.str_)
    return np.array(cells, dtype=np.float64)


def _varied_column(values: List[Any]) -> Array:
    """Values of what varies: numbers if all are, otherwise text."""
    if all(value is None or (isinstance(value, (int, float)) and not isinstance(value, bool)) for value in values):
        return np.array(values, dtype=np.float64)
    return np.array([value if isinstance(value, str) else json.dumps(value) for value in values], dtype=np.str_)


def _with_varied(before: List[Tuple[str, Array]], varied: List[Tuple[str, Array]],
                 after: List[Tuple[str, Array]]) -> Array:
    """One table; what varies gives way to a column of the same name, as in the tables of the command line."""
    taken = {name for name, _ in before + after}
    renamed = []
    for name, column in varied:
        while name in taken:
            name += "_varied"
        taken.add(name)
        renamed.append((name, column))
    return _structured(before + renamed + after)


class Campaign:
    """A campaign and its journal. What is asked is read from the journal as it is now, also while another program runs
    the campaign."""

    def __init__(self, folder: pathlib.Path, exit_code: Optional[int] = None, summary: str = "", messages: str = "",
                 keep: Optional[tempfile.TemporaryDirectory[str]] = None) -> None:
        self.folder = folder
        self.path = folder / _JOURNAL
        """The journal, a file of SQLite."""
        self.exit_code = exit_code
        """That of the command line: 0 done, 1 no task has a result, 130 interrupted; None: not run by this program."""
        self.summary = summary
        """What the command line prints of it at the end."""
        self.messages = messages
        """What was mended of a damaged journal."""
        self._keep = keep

    @contextlib.contextmanager
    def _read(self) -> Iterator[sqlite3.Connection]:
        """The journal at one moment."""
        file = self.path.absolute()
        if not file.exists():
            raise FileNotFoundError(f"{file}: there is no journal of a campaign in this folder")
        options = "mode=ro&immutable=1" if _unchangeable(file) else "mode=ro"
        connection = sqlite3.connect(f"file:{quote(str(file))}?{options}", uri=True, timeout=20.0, isolation_level=None)
        try:
            connection.execute("BEGIN")
            yield connection
        finally:
            connection.close()

    @property
    def counts(self) -> Dict[str, int]:
        """Numbers of "tasks", and of those "waiting", "done" and "failed"."""
        with self._read() as journal:
            (tasks,), = journal.execute("SELECT value FROM campaign WHERE key = 'tasks'").fetchall()
            ended = dict(journal.execute("SELECT state, count(*) FROM task GROUP BY state").fetchall())
        done, failed = ended.get("done", 0), ended.get("failed", 0)
        return {"tasks": tasks, "waiting": tasks - done - failed, "done": done, "failed": failed}

    @property
    def status(self) -> str:
        """done: no task waits, and some have a result; failed: none has; interrupted: some wait."""
        counts = self.counts
        return "interrupted" if counts["waiting"] else "done" if counts["done"] else "failed"

    @property
    def document(self) -> Dict[str, Any]:
        """The campaign with all defaults, its lists and jobs written out."""
        with self._read() as journal:
            (text,), = journal.execute("SELECT value FROM campaign WHERE key = 'document'").fetchall()
        document: Dict[str, Any] = json.loads(text)
        return document

    def table(self, *, times: bool = False) -> Array:
        """One row for each task, as a structured array: number, what varies, state, status, exit_code, objective; for
        each parameter NAME, NAME_sd, NAME_lower, NAME_upper, and NAME_truth, NAME_bound where a task has them; message.
        Numbers are float64, nan where there is none; "number" is int64. These are the columns of
        `orbid campaign export`.

        times  also attempts, host, rank, started, seconds, processor_seconds.
        """
        names = ["state", "status", "exit_code", "objective", "message", *_TIMES]
        with self._read() as journal:
            varied = journal.execute("SELECT name FROM varied ORDER BY position").fetchall()
            # What a waiting task once gave counts no longer.
            ended = ", ".join(f"iif(state = 'waiting', NULL, {name})" if name not in ("state", "attempts") else name
                              for name in names)
            rows = journal.execute(f"SELECT number, choices, {ended} FROM task ORDER BY number").fetchall()
            number = np.array([row[0] for row in rows], dtype=np.int64)
            parameters = self._parameter_columns(journal, number)
        cells = list(zip(*rows)) if rows else [()] * (2 + len(names))
        choices = [json.loads(text) for text in cells[1]]
        column = {name: (name, _column(name, cells[k])) for k, name in enumerate(names, 2)}
        after = [column[name] for name in names[:4]] + parameters + [column["message"]]
        return _with_varied([("number", number)],
                            [(name, _varied_column([row[k] for row in choices])) for k, (name,) in enumerate(varied)],
                            after + ([column[name] for name in _TIMES] if times else []))

    @staticmethod
    def _parameter_columns(journal: sqlite3.Connection, number: Array) -> List[Tuple[str, Array]]:
        """Estimates of the tasks with these numbers, parameters in the order of their first appearance."""
        columns = []
        # position is that of the row with the least task: so SQLite reads a column beside min().
        named = journal.execute("SELECT name, count(truth), count(bound), min(task) AS first, position "
                                "FROM parameter GROUP BY name ORDER BY first, position").fetchall()
        for name, truths, bounds, _, _ in named:
            found = journal.execute("SELECT task, value, sd, lower, upper, truth, bound FROM parameter "
                                    "JOIN task ON number = task WHERE name = ? AND state <> 'waiting'", (name,))
            cells = np.array(found.fetchall(), dtype=np.float64).reshape(-1, 7)
            values = np.full((6, len(number)), np.nan)
            values[:, np.searchsorted(number, cells[:, 0].astype(np.int64))] = cells[:, 1:].T
            ends = ["", "_sd", "_lower", "_upper"] + ["_truth"] * (truths > 0) + ["_bound"] * (bounds > 0)
            kept = [0, 1, 2, 3] + [4] * (truths > 0) + [5] * (bounds > 0)
            columns += [(name + end, values[k]) for end, k in zip(ends, kept)]
        return columns

    def parameters(self) -> Array:
        """One row for each task and parameter, as a structured array: number, what varies, status, parameter, value,
        sd, lower, upper, truth, bound."""
        names = ["number", "status", "parameter", "value", "sd", "lower", "upper", "truth", "bound"]
        with self._read() as journal:
            varied = journal.execute("SELECT name FROM varied ORDER BY position").fetchall()
            rows = journal.execute(
                "SELECT number, status, name, value, sd, lower, upper, truth, bound, choices FROM task "
                "JOIN parameter ON parameter.task = number WHERE state <> 'waiting' ORDER BY number, position").fetchall()
        cells = list(zip(*rows)) if rows else [()] * 10
        choices = [json.loads(text) for text in cells[9]]
        columns = [(name, _column(name, cells[k])) for k, name in enumerate(names)]
        return _with_varied(columns[:1],
                            [(name, _varied_column([row[k] for row in choices])) for k, (name,) in enumerate(varied)],
                            columns[1:])

    def result(self, number: int) -> Dict[str, Any]:
        """Content of the result.json of a task, from 0; empty: it has none."""
        with self._read() as journal:
            found = journal.execute("SELECT content FROM task LEFT JOIN result ON task = number WHERE number = ?",
                                    (int(number),)).fetchone()
        if found is None:
            raise ValueError(f"task {number}: the campaign has {self.counts['tasks']} tasks, from 0")
        result: Dict[str, Any] = json.loads(zlib.decompress(found[0])) if found[0] else {}
        return result

    def job(self, number: int) -> Dict[str, Any]:
        """The job of a task, from 0. Relative paths in it start where the campaign's job stands."""
        job: Dict[str, Any] = json.loads(_orbid.campaign_job(self.folder, number)[0])
        return job

    def __repr__(self) -> str:
        counts = self.counts
        return f"Campaign({counts['done'] + counts['failed']} of {counts['tasks']} tasks have ended, {self.folder})"


def campaign(campaign: Job, out: Union[str, "os.PathLike[str]", None] = None, *, threads: int = 0, retry: bool = False,
             progress: Optional[Callable[[CampaignProgress], object]] = None) -> Campaign:
    """Runs the waiting tasks of a campaign in threads of this process, and returns what there is of it.

    campaign  a dict with the keys of a campaign file, JSON text (beginning with "{"), or the path of such a file. Paths
              in it are relative to the current folder, those of a file to that file. In jobs of a dict, "file" of the
              data may be a dict of columns, as for run().
    out       folder of the journal; None: the file's path without its ending, else a temporary folder that goes with
              the Campaign.
    threads   tasks at the same time; 0: one per core.
    retry     tasks that failed are run again, too.
    progress  called at most ten times a second, by another thread than this one.

    Ctrl-C stops the tasks in work; the others wait, and the same call goes on with them. Raises JobError for a campaign
    that cannot be run, or a folder that holds another one.
    """
    if isinstance(threads, bool) or threads < 0:
        raise ValueError(f"threads = {threads}: must be a whole number >= 0")
    folder, keep = _folder_of(campaign, out)
    there, tables = folder.exists(), _tables(folder)

    def tell(*now: Any) -> None:
        if progress is not None:
            progress(CampaignProgress(*now))
    try:
        text, source, with_lines = _text_of(campaign, folder)
        exit_code, rows, summary, messages = _orbid.run_campaign(text, source, folder, threads, retry,
                                                                 None if progress is None else tell)
        problems = [_problem(row, with_lines) for row in rows]
        if problems:
            raise JobError("\n".join(problem.text for problem in problems), problems)
        if exit_code not in (0, 1, 130):
            raise JobError(messages.strip())
    except JobError:
        _as_before(folder, there, tables)
        raise
    return Campaign(folder, exit_code, summary, messages, keep)


def open_campaign(folder: Union[str, "os.PathLike[str]"]) -> Campaign:
    """The campaign of a folder, made by the command line or by campaign(), also while it runs."""
    found = Campaign(pathlib.Path(folder))
    try:
        _ = found.counts
    except (sqlite3.Error, ValueError) as error:
        raise ValueError(f"{found.path}: is not the journal of a campaign: {error}") from None
    return found
