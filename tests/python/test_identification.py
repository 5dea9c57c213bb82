"""identify(): the numbers of a job, its refusals, Ctrl-C and the caller's functions."""

import json
import os
import pathlib
import signal
import threading

import numpy as np
import orbid
import pytest

TRUE = {"w0sq": 19.62, "c1": 0.2}
START = {"w0sq": {"start": 17.0, "bounds": [5.0, 60.0]}, "c1": 0.3}


@pytest.fixture(scope="module")
def swing():
    """A free pendulum's swings, read with errors of 5 mrad."""
    pendulum = orbid.model("free_pendulum")
    t = np.arange(200) * 0.02
    flow = pendulum.flow([1.2, 0.0], t, TRUE)
    reading = flow.states[:, 0] + np.random.default_rng(1).normal(0.0, 5e-3, t.size)
    return pendulum, TRUE, {"t": t, "phi": reading}


def identified(swing, **options):
    pendulum, known, record = swing
    return orbid.identify(pendulum, record, START, values=known, residuals=[{"type": "series"}], **options)


def test_numbers_are_those_of_the_job(swing):
    _, known, record = swing
    run = orbid.run({"model": {"name": "free_pendulum", "parameters": known}, "seed": 1,
                     "data": {"file": record, "kind": "samples"},
                     "estimate": {"parameters": {name: one if isinstance(one, dict) else {"start": one}
                                                 for name, one in START.items()},
                                  "residuals": [{"type": "series"}], "strategy": "auto"}})
    result = identified(swing)
    assert result.status == run.status == "converged"
    for name, entry in run.parameters.items():
        ours = result.parameters[name]
        assert (ours.value, ours.sd, ours.interval95) == (entry.value, entry.sd, entry.interval95)
        assert abs(ours.value - TRUE[name]) < 4.0 * ours.sd
    assert np.array_equal(result.correlation, np.array(run.result["correlation"]["matrix"]))
    assert np.array_equal(result.theta, [entry.value for entry in run.parameters.values()])
    assert np.array_equal(result.sds, [entry.sd for entry in run.parameters.values()])
    assert np.array_equal(result.intervals, [entry.interval95 for entry in run.parameters.values()])
    assert [stage["stage"] for stage in result.stages] == ["prediction", "series"]
    assert sum(len(e) for block in result.residuals for e in block) >= record["t"].size


def test_the_experiment_of_the_paper_is_that_of_its_job():
    """van de Wouw, Verbeek, van Campen (1995), section 5, from so few points that series alone are not believed."""
    values = {"m": 0.0858, "l": 0.317, "k1": 1.0e-3, "k2": 4.85e-4, "k3": 1.90e-4, "g": 9.81, "A": 0.131,
              "omega": 9.09, "epsilon": 0.173}
    sensor = {"type": "angle_difference", "angle": "phi", "rate": "phi_dot", "delay": 0.01508,
              "step": 1.5339807878856412e-3, "rounding": "nearest"}
    free = {"l": {"start": 0.45, "bounds": [0.1, 2.0]}, "k1": {"start": 2.0e-4, "bounds": [0.0, 0.1]},
            "k2": {"start": 1.7e-3, "bounds": [0.0, 0.1]}, "k3": {"start": 4.0e-5, "bounds": [0.0, 0.1]}}
    run = orbid.run({"model": {"name": "parametric_pendulum", "variant": "crank", "parameters": values}, "seed": 1,
                     "data": {"name": "run1", "sensor": sensor,
                              "simulate": {"sections": 300, "trajectories": 4, "transient": 20}},
                     "orbits": {}, "estimate": {"parameters": free, "strategy": "auto"}})

    pendulum = orbid.model("parametric_pendulum", "crank")
    record = orbid.simulate(pendulum, values, sections=300, trajectories=4, transient=20, sensor=sensor, seed=1).series
    # Two readings of the angle, each rounded to the encoder's step, stand behind a point.
    variance, delay = sensor["step"] ** 2 / 12.0, sensor["delay"]
    how = {"symmetry_signs": [-1.0, -1.0], "reading_covariance": [[variance, -variance / delay],
                                                                  [-variance / delay, 2.0 * variance / (delay * delay)]]}
    ours = orbid.identify(pendulum, [{"record": record, "sensor": sensor, "simulated": True}], free, values=values,
                          cycles=orbid.find_cycles(record, **how), search=how)
    assert ours.status == run.status == "converged"
    assert [stage["stage"] for stage in ours.stages] == ["prediction", "series", "cycles", "harvest", "series"]
    for name, entry in run.parameters.items():
        assert (ours.parameters[name].value, ours.parameters[name].sd) == (entry.value, entry.sd)
        assert abs(entry.value - values[name]) < 4.0 * entry.sd


def test_bounds_and_initial_values_are_those_of_the_job(swing):
    pendulum, known, record = swing
    series = [{"type": "series", "interval": "segment"}]
    free = {"w0sq": {"start": 17.0, "scale": "linear"}, "c1": {"start": 0.3, "scale": "log"}}
    beginning = {"phi": {"start": 1.2, "prior": {"lognormal": {"median": 1.2, "log_sd": 0.1}}}}
    run = orbid.run({"model": {"name": "free_pendulum", "parameters": known}, "seed": 1,
                     "data": {"file": record, "kind": "samples", "initial_state": beginning},
                     "estimate": {"parameters": free, "residuals": series}})
    ours = orbid.identify(pendulum, [{"record": record, "initial_state": beginning}], free, values=known,
                          residuals=series, strategy=["series"])
    assert len(run.parameters) == 3
    assert [one.value for one in run.parameters.values()] == [one.value for one in ours.parameters.values()]


def test_what_no_record_determines_is_told_and_held(swing):
    structure = identified(swing).structure
    assert structure["examined"] and structure["reason"] == "" and structure["directions"] == []
    # x'' = -a b x: neither a nor b, and y in a unit of its own.
    oscillator = orbid.equations({"equations": {"x": "a * y", "y": "-b * x"}, "parameters": {"a": 1.4, "b": 2.1}})
    t = np.arange(200) * 0.05
    record = {"t": t, "x": np.cos(np.sqrt(3.0) * t) + np.random.default_rng(2).normal(0.0, 1e-3, t.size)}
    result = orbid.identify(oscillator, record, {"a": 1.4, "b": 2.1}, residuals=[{"type": "series"}])
    assert result.status == "converged"
    direction, = result.structure["directions"]
    assert (direction["kind"], direction["unknowns"], direction["held"]) == ("scaling", ["y", "a", "b"], "b")
    assert direction["components"] == [1.0, -1.0, 1.0]
    a, b = result.parameters["a"], result.parameters["b"]
    assert b.value == 2.1 and np.isnan(b.sd)
    assert abs(a.value * b.value - 3.0) < 4.0 * a.sd * b.value


def test_a_series_gives_the_same_as_its_columns(swing):
    pendulum, known, record = swing
    phi = next(one for one in pendulum.coordinates if one.name == "phi")
    series = orbid.Series(record["phi"], [{"name": "phi", "unit": phi.unit, "angle": phi.angle}], times=record["t"])
    ours = orbid.identify(pendulum, [{"record": series}], START, values=known, residuals=[{"type": "series"}])
    assert np.array_equal(ours.theta, identified(swing).theta)


def test_refusals_name_what_is_wrong(swing):
    pendulum, known, record = swing
    with pytest.raises(KeyError, match="no parameter 'w0'"):
        orbid.identify(pendulum, record, {"w0": 19.0}, values=known)
    with pytest.raises(ValueError, match="theta.*known are t, segment"):
        orbid.identify(pendulum, {"t": record["t"], "theta": record["phi"]}, START, values=known)
    with pytest.raises(ValueError, match="columns of shapes"):
        orbid.identify(pendulum, {"t": record["t"], "phi": record["phi"][:-1]}, START, values=known)
    with pytest.raises(TypeError, match="unknown 'stategy'.*did you mean 'strategy'"):
        identified(swing, stategy="auto")
    with pytest.raises(ValueError, match="did you mean 'series'"):
        identified(swing, strategy=["serie"])
    with pytest.raises(TypeError, match="needs a number"):
        orbid.identify(pendulum, record, {"w0sq": {"start": "17"}}, values=known)


def test_progress_is_told_and_its_exception_raised(swing):
    told = []
    identified(swing, progress=lambda step, share, note: told.append((step, share)))
    assert told and all(isinstance(step, str) and (share is None or 0.0 <= share) for step, share in told)

    def failing(*_):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        identified(swing, progress=failing)


def test_several_starts_lead_to_the_same_end(swing):
    alone, several = identified(swing), identified(swing, starts=5)
    assert several.status == "converged"
    for name, one in alone.parameters.items():
        assert abs(several.parameters[name].value - one.value) < 0.01 * one.sd


def test_ctrl_c_gives_the_best_so_far(swing):
    asked = []

    def interrupt(*_):
        if not asked:
            asked.append(True)
            os.kill(os.getpid(), signal.SIGINT)

    assert threading.current_thread() is threading.main_thread()
    result = identified(swing, starts=50, progress=interrupt)
    assert asked and result.status == "interrupted"


LORENZ = {"sigma": 10.0, "rho": 28.0, "beta": 8.0 / 3.0}
PLANE = {"coordinate": "z", "value": 27, "direction": 1}


def lorenz_cycles(error):
    """The shortest cycles in all their crossings (tests/reference/lorenz_orbits.json), read with normal errors."""
    table = json.loads((pathlib.Path(__file__).parents[1] / "reference" / "lorenz_orbits.json").read_text())["cycles"]
    lorenz, random, cycles = orbid.model("lorenz"), np.random.default_rng(7), []
    for entry in table:
        period = len(entry["code"])
        if period > 3:
            continue
        # Crossings after the first one, and the last of these is the first again.
        crossed = lorenz.crossings([float(entry["x"]), float(entry["y"]), 27.0], PLANE, period, LORENZ)
        assert np.allclose(crossed.states[-1, :2], [float(entry["x"]), float(entry["y"])], rtol=0.0, atol=1e-6)
        points = crossed.states[:, :2] + error * random.normal(size=(period, 2))
        covariance = error**2 * np.eye(2 * period + 1)
        covariance[-1, 0] = covariance[0, -1] = 0.5 * error**2
        cycles.append(orbid.Cycle(points, covariance=covariance[:-1, :-1], time_covariance=covariance[-1, :-1],
                                  time=float(entry["period"]) + error * random.normal(), time_sd=error))
        assert np.array_equal(cycles[-1].time_covariance, covariance[-1, :-1])
    return lorenz, cycles


def test_cycles_of_a_flow_are_compared_at_their_plane():
    lorenz, cycles = lorenz_cycles(1e-4)
    assert [cycle.period for cycle in cycles] == [2, 3, 3]
    starts = {name: 1.05 * value for name, value in LORENZ.items()}
    errors = {"x": {"sd": 1}, "y": {"sd": 1}}
    found = {times: orbid.identify(lorenz, [], starts, values=LORENZ, cycles=cycles, section=PLANE,
                                   residuals=[{"type": "cycles", "times": times, "errors": errors}])
             for times in (True, False)}
    usual = orbid.identify(lorenz, [], starts, values=LORENZ, cycles=cycles, section=PLANE,
                           residuals=[{"type": "cycles", "errors": errors}])
    for name, value in LORENZ.items():
        for one in found.values():
            entry = one.parameters[name]
            assert one.status == "converged" and abs(entry.value - value) < 4.0 * entry.sd < 0.01 * value
        assert found[True].parameters[name].sd < found[False].parameters[name].sd
        assert usual.parameters[name].value == found[True].parameters[name].value


def test_what_planes_of_cycles_cannot_be_is_refused(swing):
    lorenz, cycles = lorenz_cycles(1e-4)
    with pytest.raises(ValueError, match="section: without cycles"):
        identified(swing, section=PLANE)
    with pytest.raises(ValueError, match="time_covariance: needs shape"):
        orbid.Cycle(cycles[0].points, time=1.0, time_sd=0.1, time_covariance=[1.0])
    with pytest.raises(KeyError, match="no coordinate 'w'"):
        orbid.identify(lorenz, [], LORENZ, cycles=cycles, section={"coordinate": "w", "value": 1})
    with pytest.raises((KeyError, ValueError), match="z"):
        orbid.identify(lorenz, [], LORENZ, cycles=cycles, section=PLANE,
                       residuals=[{"type": "cycles", "errors": {"z": {"sd": 1}}}])
