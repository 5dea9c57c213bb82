"""Campaigns: the command line's numbers and tables, stopping and going on, journals of others."""

import csv
import gc
import io
import json
import os
import pathlib
import shutil
import signal
import sqlite3
import subprocess
import threading
import zlib

import numpy as np
import orbid
import pytest

PROGRAM = os.environ["ORBID_PROGRAM"]

JOB = {
    "model": {"name": "free_pendulum", "parameters": {"w0sq": 30, "c2": 0.05}},
    "data": {"simulate": {"samples": {"step": 0.02, "count": 31}, "noise": {"phi": 0.005, "phi_dot": 0.02},
                          "initial": [[1.0, 0.0]]}},
    "estimate": {"parameters": {"w0sq": {"start": 33}}, "residuals": [{"type": "series"}]},
}
# The last setting of the first key fails; "c2" varies and, as a column of its own, is estimated nowhere.
CAMPAIGN = {
    "title": "short swings", "kind": "sweep", "job": JOB, "seed": 4, "replicates": 2,
    "vary": [{"key": "/data/simulate/initial/0/0", "name": "start", "values": [0.5, 1.0, 1e300]},
             {"key": "/model/parameters/w0sq", "values": np.array([29.0, 30.0])},
             {"key": "/title", "name": "status", "values": ["first, \"one\"", "second"]}],
}


def program(*arguments, cwd=None):
    return subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, cwd=cwd)


def exported(folder, *options):
    """A table of the command line, as its header and columns of text."""
    done = program("campaign", "export", folder, *options)
    assert done.returncode == 0, done.stderr
    header, *rows = list(csv.reader(io.StringIO(done.stdout)))
    return header, [list(cells) for cells in zip(*rows)]


def compare(table, header, columns):
    """Bit for bit: numbers of the command line read back to the same doubles."""
    assert list(table.dtype.names) == header
    for name, cells in zip(header, columns):
        if table[name].dtype.kind == "U":
            assert table[name].tolist() == cells, name
        else:
            numbers = np.array([float(cell) if cell else np.nan for cell in cells])
            np.testing.assert_array_equal(table[name], numbers, err_msg=name)


@pytest.fixture(scope="module")
def swings(tmp_path_factory):
    return orbid.campaign(CAMPAIGN, tmp_path_factory.mktemp("swings") / "out", threads=2)


def test_the_command_line_gives_the_same(swings, tmp_path):
    (tmp_path / "campaign.json").write_text(json.dumps(orbid.job._plain(CAMPAIGN)))
    done = program("campaign", tmp_path / "campaign.json", "--quiet")
    assert done.returncode == 0, done.stderr
    theirs = orbid.open_campaign(tmp_path / "campaign")
    assert theirs.counts == swings.counts == {"tasks": 24, "waiting": 0, "done": 16, "failed": 8}
    for ours, other in ((swings.table(), theirs.table()), (swings.parameters(), theirs.parameters())):
        assert ours.dtype == other.dtype and ours.tobytes() == other.tobytes()
    # Either goes on with the other's journal.
    assert program("campaign", tmp_path / "campaign.json", "--out", swings.folder, "--quiet").returncode == 0
    assert orbid.campaign(tmp_path / "campaign.json").counts == swings.counts


def test_the_tables_are_those_that_are_exported(swings):
    table = swings.table()
    compare(table, *exported(swings.folder))
    compare(swings.table(times=True), *exported(swings.folder, "--times"))
    compare(swings.parameters(), *exported(swings.folder, "--table", "parameters"))
    assert table["number"].tolist() == list(range(24)) and table["start"].dtype == np.float64
    # A column of what varies gives way to one of the same name.
    assert set(table["status_varied"]) == {'first, "one"', "second"}
    assert set(table["status"]) >= {"converged"} and (table["state"] == "failed").sum() == 8
    assert np.isnan(table["objective"][table["state"] == "failed"]).all()
    done = table[table["state"] == "done"]
    assert np.array_equal(done["w0sq_truth"], done["w0sq_varied"])
    assert (abs(done["w0sq"] - done["w0sq_truth"]) < 6.0 * done["w0sq_sd"]).all()
    assert (done["w0sq_lower"] < done["w0sq"]).all() and (done["w0sq"] < done["w0sq_upper"]).all()
    long = swings.parameters()
    assert long["value"][long["parameter"] == "w0sq"].tolist() == done["w0sq"].tolist()


def test_results_and_jobs_of_tasks(swings, tmp_path):
    table = swings.table()
    for number in (0, 9):
        result = swings.result(number)
        assert result["parameters"]["w0sq"]["value"] == table["w0sq"][number]
        text = program("campaign", "export", swings.folder, "--result", number).stdout
        assert json.loads(text) == result
        # The job of a task, run alone.
        run = orbid.run(swings.job(number), tmp_path / str(number), threads=1)
        assert run.parameters["w0sq"].value == table["w0sq"][number]
        assert run.parameters["w0sq"].interval95[0] == table["w0sq_lower"][number]
    assert swings.job(1)["seed"] == 5 and swings.job(0)["seed"] == 4
    assert swings.result(23) == {} and table["state"][23] == "failed" and table["message"][23]
    for number in (-1, 24):
        with pytest.raises(ValueError, match=f"task {number}: the campaign has"):
            swings.job(number)
        with pytest.raises(ValueError, match=f"task {number}: the campaign has 24 tasks"):
            swings.result(number)
    assert swings.document["title"] == "short swings" and len(swings.document["factors"]) == 3


def test_plain_sqlite(swings):
    """What docs/python.md shows for programs without orbid."""
    journal = sqlite3.connect(swings.path)
    values = journal.execute("SELECT task, value, sd FROM parameter WHERE name = 'w0sq' ORDER BY task").fetchall()
    content, = journal.execute("SELECT content FROM result WHERE task = 0").fetchone()
    journal.close()
    assert len(values) == 16 and values[0][1] == swings.table()["w0sq"][0]
    assert json.loads(zlib.decompress(content)) == swings.result(0)


def test_failed_tasks_run_again_when_asked(swings):
    before = swings.table(times=True)
    again = orbid.campaign(CAMPAIGN, swings.folder, retry=True)
    after = again.table(times=True)
    assert again.exit_code == 0 and again.counts == swings.counts
    failed = before["state"] == "failed"
    assert (after["attempts"] == before["attempts"] + failed).all()


def test_a_campaign_that_was_stopped_goes_on(tmp_path, swings):
    long = {**CAMPAIGN, "replicates": 40}
    told = []

    def stop(now):
        told.append(now)
        if now.done >= 5 and len(told) > 1:
            os.kill(os.getpid(), signal.SIGINT)
    stopped = orbid.campaign(long, tmp_path / "out", threads=1, progress=stop)
    assert stopped.status == "interrupted" and stopped.exit_code == 130
    counts = stopped.counts
    assert 5 <= counts["done"] + counts["failed"] < 480 and sum(counts.values()) == 2 * 480
    table = stopped.table()
    waits = table["state"] == "waiting"
    assert waits.sum() == counts["waiting"]
    assert np.isnan(table["w0sq"][waits]).all() and (table["status"][waits] == "").all()
    assert all(isinstance(now, orbid.CampaignProgress) and now.tasks == 480 for now in told)
    # The same call, without what stops it.
    short = {**CAMPAIGN, "vary": CAMPAIGN["vary"][1:], "replicates": 100}
    calls = []

    def stop_once(now):
        calls.append(now)
        if now.done >= 5 and now.waiting > 0:
            os.kill(os.getpid(), signal.SIGINT)
    first = orbid.campaign(short, tmp_path / "short", threads=1, progress=stop_once)
    assert first.status == "interrupted"
    kept = first.table()
    whole = orbid.campaign(short, tmp_path / "short")
    assert whole.status == "done" and whole.exit_code == 0 and whole.counts["done"] == 400
    ended = kept["state"] == "done"
    assert whole.table()[ended].tobytes() == kept[ended].tobytes() or (
        whole.table()[ended].tolist() == kept[ended].tolist())
    assert whole.table().tolist() == orbid.campaign(short, tmp_path / "undisturbed", threads=3).table().tolist()


def test_an_error_in_progress_ends_the_campaign(tmp_path):
    def fail(now):
        raise LookupError("mine")
    with pytest.raises(LookupError, match="mine"):
        orbid.campaign(CAMPAIGN, tmp_path / "out", progress=fail)
    assert orbid.campaign(CAMPAIGN, tmp_path / "out").status == "done"


def test_others_run_while_a_campaign_runs(tmp_path):
    """The interpreter's lock is free: another thread counts, and reads the journal."""
    seen = []
    done = threading.Event()

    def look():
        while not done.is_set():
            if (tmp_path / "out" / "campaign.sqlite").exists():
                try:
                    seen.append(orbid.open_campaign(tmp_path / "out").counts["done"])
                except (ValueError, sqlite3.OperationalError):
                    pass  # is being made
            done.wait(0.01)
    other = threading.Thread(target=look)
    other.start()
    orbid.campaign({**CAMPAIGN, "vary": CAMPAIGN["vary"][1:], "replicates": 20}, tmp_path / "out")
    done.set()
    other.join()
    assert len(seen) > 3 and seen == sorted(seen)


def test_data_as_arrays_go_with_the_campaign(tmp_path):
    t = np.arange(60) * 0.02
    pendulum = orbid.model("free_pendulum")
    swing = pendulum.flow([1.0, 0.0], t, {"w0sq": 30.0, "c2": 0.05}).states
    swing = swing + np.random.default_rng(1).normal(0.0, [5e-3, 2e-2], swing.shape)
    job = {"model": {"name": "free_pendulum", "parameters": {"c2": 0.05}},
           "data": {"kind": "samples", "file": {"t": t, "phi": swing[:, 0], "phi_dot": swing[:, 1]}},
           "estimate": {"parameters": {"w0sq": {"start": 33}, "c2": {"start": 0.1}},
                        "residuals": [{"type": "series"}]}}
    grid = {"kind": "profile_grid", "job": job, "grid": {"c2": [0.0, 0.05, 0.5]}}
    made = orbid.campaign(grid, tmp_path / "out")
    objective = made.table()["objective"]
    assert made.status == "done" and objective[1] < objective[0] and objective[1] < objective[2]
    compared = orbid.campaign({"kind": "compare_models",
                               "jobs": {"with": job, "without": {**job, "model": {
                                   "name": "free_pendulum", "parameters": {"c2": 0}},
                                   "estimate": {"parameters": {"w0sq": {"start": 33}},
                                                "residuals": [{"type": "series"}]}}}})
    assert compared.table()["job"].tolist() == ["with", "without"]
    # Without out the journal goes with the Campaign.
    folder = compared.folder
    del compared
    gc.collect()
    assert not folder.exists()
    bad = {**job, "data": {**job["data"], "file": {"t": t, "phi": t[:5]}}}
    with pytest.raises(orbid.JobError, match="/job/data/file/phi: 5 entries"):
        orbid.campaign({**grid, "job": bad}, tmp_path / "bad")
    assert not (tmp_path / "bad").exists()


def test_problems_name_their_pointer(tmp_path, swings):
    wrong = {**CAMPAIGN, "replikates": 2}
    with pytest.raises(orbid.JobError, match='/replikates: .*did you mean "replicates"') as caught:
        orbid.campaign(wrong, tmp_path / "out")
    assert [problem.pointer for problem in caught.value.problems] == ["/replikates"]
    assert not (tmp_path / "out").exists()
    assert orbid.check(wrong) == caught.value.problems and orbid.check(CAMPAIGN) == []
    file = tmp_path / "campaign.json"
    file.write_text(json.dumps({**orbid.job._plain(CAMPAIGN), "replikates": 2}, indent=1))
    with pytest.raises(orbid.JobError) as caught:
        orbid.campaign(file)
    assert caught.value.problems[0].text.startswith(f"{file}:{caught.value.problems[0].line}:")
    # The journal of another campaign is left alone.
    with pytest.raises(orbid.JobError, match="journal of another campaign .*seed"):
        orbid.campaign({**CAMPAIGN, "seed": 5}, swings.folder)
    assert orbid.open_campaign(swings.folder).counts["tasks"] == 24


def test_wrong_calls(tmp_path):
    for bad in (None, 1, [CAMPAIGN]):
        with pytest.raises(TypeError):
            orbid.campaign(bad, tmp_path / "out")
    with pytest.raises(ValueError, match="threads"):
        orbid.campaign(CAMPAIGN, tmp_path / "out", threads=-1)
    with pytest.raises(FileNotFoundError):
        orbid.campaign(tmp_path / "none.json")
    with pytest.raises(FileNotFoundError, match="no journal"):
        orbid.open_campaign(tmp_path)
    (tmp_path / "campaign.sqlite").write_text("something else " * 100)
    with pytest.raises(ValueError, match="is not the journal of a campaign"):
        orbid.open_campaign(tmp_path)


def test_a_journal_that_cannot_be_written_is_read(swings, tmp_path):
    shutil.copytree(swings.folder, tmp_path / "copy")
    for path in (tmp_path / "copy" / "campaign.sqlite", tmp_path / "copy"):
        path.chmod(0o555 if path.is_dir() else 0o444)
    try:
        assert orbid.open_campaign(tmp_path / "copy").counts == swings.counts
    finally:
        (tmp_path / "copy").chmod(0o755)


def test_what_is_shown(swings):
    assert repr(swings) == f"Campaign(24 of 24 tasks have ended, {swings.folder})"
    assert "24" in swings.summary and swings.messages == ""
    assert pathlib.Path(swings.path).name == "campaign.sqlite"
