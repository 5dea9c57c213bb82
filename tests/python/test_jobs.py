"""Jobs: the command line's numbers, problems with their JSON Pointer, Ctrl-C."""

import gc
import json
import os
import pathlib
import signal
import subprocess
import threading

import numpy as np
import orbid
import pytest

PROGRAM = os.environ["ORBID_PROGRAM"]
SOURCE = pathlib.Path(__file__).parents[2]

# configs/pendulum_table3.json with fewer sections.
TABLE3 = {
    "model": {"name": "parametric_pendulum", "variant": "crank",
              "parameters": {"m": 0.0858, "l": 0.317, "k1": 0.0, "k2": 4.85e-4, "k3": 1.90e-4, "g": 9.81, "A": 0.131,
                             "omega": 9.09, "epsilon": 0.173}},
    "seed": 1,
    "section": {"phase": 0.0},
    "data": {"name": "run1",
             "simulate": {"sections": 16384, "trajectories": 4, "transient": 300, "initial": "random",
                          "restart": "when_captured_or_at_rest"},
             "sensor": {"type": "state"}},
    "orbits": {"periods": [1, 2], "box": 0.01, "neighbours": 32, "local_map": "quadratic", "symmetry": True},
    "estimate": {"parameters": {"l": {"start": 0.377, "bounds": [0.05, 5.0]},
                                "k2": {"start": 6.48e-4, "bounds": [0.0, 0.05]},
                                "k3": {"start": 2.535e-4, "bounds": [0.0, 0.05]}},
                 "derived": {"k2_over_m": "k2 / m", "k3_over_m": "k3 / m"},
                 "residuals": [{"type": "cycles", "periods": [1, 2], "weights": "covariance"}],
                 "variance": "restricted",
                 "strategy": ["cycles"]},
    "reference": {"l": 0.317},
}
LOGISTIC = {"model": {"name": "logistic", "parameters": {"r": 3.9}},
            "estimate": {"parameters": {"r": {"start": 3.85}}, "strategy": "auto"}}


def logistic_record(count=200, r=3.9):
    x = [0.3]
    while len(x) < count:
        x.append(r * x[-1] * (1.0 - x[-1]))
    return np.array(x)


def with_record(table, **data):
    return {**LOGISTIC, "data": {"file": table, "kind": "section", **data}}


@pytest.fixture(scope="module")
def table3(tmp_path_factory):
    return orbid.run(TABLE3, tmp_path_factory.mktemp("table3") / "out")


def test_table3_is_the_command_lines(table3, tmp_path):
    (tmp_path / "job.json").write_text(json.dumps(TABLE3))
    done = subprocess.run([PROGRAM, "run", tmp_path / "job.json", "--out", tmp_path / "out", "--quiet"],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (table3.folder / "result.json").read_bytes() == (tmp_path / "out" / "result.json").read_bytes()
    assert (table3.folder / "residuals.csv").read_bytes() == (tmp_path / "out" / "residuals.csv").read_bytes()
    stored = json.loads((tmp_path / "out" / "result.json").read_text())
    for name, entry in stored["parameters"].items():
        assert table3.parameters[name].value == entry["value"]
        assert table3.parameters[name].sd == entry["sd"]
        assert list(table3.parameters[name].interval95) == entry["interval95"]
    assert table3.summary == done.stdout


def test_what_a_run_holds(table3):
    assert table3.status == "converged" and table3.exit_code == 0
    length = table3.parameters["l"]
    assert abs(length.value / 0.317 - 1.0) < 1e-4 and length.unit == "m"
    assert length.interval95[0] < length.value < length.interval95[1]
    assert set(table3.derived) == {"k2_over_m", "k3_over_m"}
    assert length.entry["start"] == 0.377
    residuals = table3.residuals
    assert residuals.dtype.names == ("experiment", "segment_or_cycle", "coordinate", "time_or_phase", "observed",
                                     "predicted", "sd")
    assert set(residuals["coordinate"]) == {"phi", "phi_dot"}
    assert residuals["observed"].dtype == np.float64 and np.isfinite(residuals["observed"]).all()
    again = orbid.stored_run(table3.folder)
    assert again.result == table3.result and again.status == "converged"
    assert "simulate" in table3.messages and "l" in table3.summary


def test_a_job_file_and_text_and_stages(tmp_path):
    job = {**TABLE3, "data": {"name": "run1", "simulate": {"sections": 1000}}}
    file = tmp_path / "small.json"
    file.write_text("// a comment\n" + json.dumps(job))
    run = orbid.run(file, stage="simulate")
    assert run.folder == tmp_path / "small" and run.status == "done" and run.result == {}
    assert (tmp_path / "small" / "series.h5").exists()
    text = orbid.run(json.dumps(job), tmp_path / "text", stage="simulate", threads=1)
    assert (text.folder / "series.h5").read_bytes() == (run.folder / "series.h5").read_bytes()


def test_without_a_folder_results_go_with_the_run():
    run = orbid.run(with_record({"x": logistic_record()}))
    folder = run.folder
    assert run.status == "converged" and (folder / "result.json").exists()
    del run
    gc.collect()
    assert not folder.exists()


def test_data_as_arrays(tmp_path):
    x = logistic_record()
    run = orbid.run(with_record({"x": x}), tmp_path / "out")
    assert run.status == "converged"
    # A record without errors: what is left are roundings.
    assert abs(run.parameters["r"].value - 3.9) < 1e-9
    assert run.parameters["r"].one_sided is None
    assert run.verdict.line == run.result["verdict"]["line"] and run.verdict.trust in ("all", "values", "none")
    # The same as from a file of these numbers.
    (tmp_path / "x.csv").write_text("x\n" + "\n".join(map(repr, x.tolist())) + "\n")
    from_file = orbid.run(with_record(str(tmp_path / "x.csv"), columns={"x": "x"}), tmp_path / "out2")
    assert from_file.result["parameters"] == run.result["parameters"]
    # The folder repeats itself: its job.json names the table in it.
    again = orbid.run(tmp_path / "out" / "job.json", tmp_path / "out3")
    assert again.result["parameters"] == run.result["parameters"]
    assert orbid.check(with_record({"x": x})) == []


@pytest.mark.parametrize("columns, match", [
    ({"x": np.ones((2, 2))}, r"/data/file/x: shape \(2, 2\)"),
    ({"x": [0.1, 0.2], "t": [0.0]}, "/data/file/t: 1 entries, the other columns have 2"),
    ({"x": [None, 0.1]}, "/data/file/x: of type object"),
    ({"x": np.array([0.1 + 1j])}, "/data/file/x: of type complex"),
    ({"x": np.ma.array([0.1, 0.2], mask=[0, 1])}, "/data/file/x: a masked array"),
    ({"x": np.array([1, 2**53 + 1])}, r"/data/file/x: .*2\^53"),
    ({"x": np.array([0.1, 0.2], np.longdouble)}, "/data/file/x: numbers of type"),
    ({}, "/data/file: no column"),
    ({"x": [0.1, np.nan, 0.3, 0.4, 0.5]}, 'csv:3, column "x": "nan" is not a finite number'),
    ({"y": [0.1, 0.2, 0.3]}, '/data/columns/y: the model logistic has no coordinate "y"'),
])
def test_bad_columns(columns, match):
    with pytest.raises(orbid.JobError, match=match):
        orbid.run(with_record(columns))


def test_problems_name_their_pointer(tmp_path):
    job = {**TABLE3, "estimate": {**TABLE3["estimate"], "parameters": {"ll": {"start": -1}}}, "seeed": 1}
    problems = orbid.check(job)
    assert {"/seeed", "/estimate/parameters/ll"} <= {problem.pointer for problem in problems}
    assert all(problem.line is None for problem in problems)
    with pytest.raises(orbid.JobError, match="/seeed: .*did you mean \"seed\"") as caught:
        orbid.run(job, tmp_path / "out")
    assert isinstance(caught.value, ValueError)
    assert caught.value.problems == problems
    assert not (tmp_path / "out").exists()
    file = tmp_path / "job.json"
    file.write_text(json.dumps(job, indent=1))
    with pytest.raises(orbid.JobError) as caught:
        orbid.run(file)
    seeed = next(problem for problem in caught.value.problems if problem.pointer == "/seeed")
    assert seeed.line == 1 + file.read_text().split("\n").index(' "seeed": 1')
    assert seeed.text.startswith(f"{file}:{seeed.line}:")


def test_data_that_cannot_be_read():
    with pytest.raises(orbid.JobError, match="none.csv") as caught:
        orbid.run(with_record("none.csv", columns={"x": "x"}))
    assert [problem.data for problem in caught.value.problems] == [True]


@pytest.mark.parametrize("job", ["{", "{}", {}, "[1]"])
def test_what_is_no_job(job, tmp_path):
    with pytest.raises((orbid.JobError, FileNotFoundError)):
        orbid.run(job, tmp_path / "out")


def test_wrong_calls(table3, tmp_path):
    for job in (None, 1, [TABLE3]):
        with pytest.raises(TypeError):
            orbid.run(job, tmp_path / "out")
    for bad, match in [(object(), "/seed: object has no form in JSON"), (np.nan, "/seed: nan: must be a finite number"),
                       ({"a~/b": [0, np.inf]}, "/seed/a~0~1b/1: inf: must be"),
                       ({1: 2}, "/seed: the key 1 is no text")]:
        with pytest.raises(orbid.JobError, match=match) as caught:
            orbid.run({**TABLE3, "seed": bad}, tmp_path / "out")
        assert caught.value.problems[0].pointer == match.split(":")[0]
        assert orbid.check({**TABLE3, "seed": bad}) == caught.value.problems
    with pytest.raises(ValueError, match="did you mean 'orbits'"):
        orbid.run(TABLE3, tmp_path / "out", stage="orbit")
    with pytest.raises(ValueError, match="threads"):
        orbid.run(TABLE3, tmp_path / "out", threads=-1)
    with pytest.raises(FileNotFoundError):
        orbid.run(tmp_path / "none.json")
    with pytest.raises(FileNotFoundError):
        orbid.stored_run(tmp_path)
    # The folder of another job is left alone.
    with pytest.raises(orbid.JobError, match="force"):
        orbid.run({**TABLE3, "seed": 2}, table3.folder)
    assert orbid.stored_run(table3.folder).result == table3.result


def test_a_refused_job_leaves_nothing(tmp_path, table3):
    record = {"x": [0.1, 0.2, 0.3]}
    for wrong in (with_record({"y": [0.1, 0.2, 0.3]}), {**with_record(record), "seed": "none"}):
        with pytest.raises(orbid.JobError):
            orbid.run(wrong, tmp_path / "out")
        assert not (tmp_path / "out").exists()
    with pytest.raises(orbid.JobError, match="force"):
        orbid.run(with_record(record), table3.folder)
    assert not (table3.folder / "arrays").exists()
    (tmp_path / "mine" / "arrays").mkdir(parents=True)
    (tmp_path / "mine" / "arrays" / "other.csv").write_text("x\n1\n")
    with pytest.raises(orbid.JobError):
        orbid.run({**with_record(record), "seed": "none"}, tmp_path / "mine")
    assert [file.name for file in (tmp_path / "mine").rglob("*.csv")] == ["other.csv"]


def test_numpy_in_a_job(tmp_path):
    job = {**TABLE3, "seed": np.int64(3), "data": {"name": "run1", "simulate": {
        "sections": np.int32(100), "trajectories": 1, "initial": np.array([[0.1, 0.2]])}}}
    assert orbid.run(job, tmp_path / "out", stage="simulate").status == "done"


def test_progress_is_told_line_by_line(tmp_path):
    lines = []
    run = orbid.run(TABLE3, tmp_path / "out", stage="simulate", progress=lines.append)
    assert lines and lines == run.messages.splitlines()


def test_an_error_in_progress_ends_the_run(tmp_path):
    def fail(line):
        raise LookupError("mine")
    with pytest.raises(LookupError, match="mine"):
        orbid.run(TABLE3, tmp_path / "out", progress=fail)


def test_ctrl_c_returns_the_best_estimate_so_far(tmp_path):
    job = {**TABLE3, "estimate": {**TABLE3["estimate"], "strategy": ["prediction", "cycles", "harvest"],
                                  "criticism": {"without": ["k3"]}}}

    def stop(line):
        if line.startswith("cycles "):
            os.kill(os.getpid(), signal.SIGINT)
    run = orbid.run(job, tmp_path / "out", progress=stop)
    assert run.status == "interrupted" and run.exit_code == 130
    assert run.result["status"] == "interrupted"
    # The cycles stage was done: its answer is the result, nearer than the start by far.
    assert abs(run.parameters["l"].value / 0.317 - 1.0) < 0.01
    # The same job goes on to its end.
    assert orbid.run(job, tmp_path / "out").status == "converged"


def test_two_jobs_at_once(tmp_path, table3):
    done = {}

    def work(k):
        done[k] = orbid.run(TABLE3, tmp_path / str(k), threads=1)
    threads = [threading.Thread(target=work, args=(k,)) for k in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for run in done.values():
        assert (run.folder / "result.json").read_bytes() == (table3.folder / "result.json").read_bytes()
