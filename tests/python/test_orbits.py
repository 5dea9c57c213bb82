"""Series, cycles and their residuals from Python."""

import gc
import math
import types

import numpy as np
import pytest

import orbid

HENON = orbid.model("henon")


def address(array):
    return array.__array_interface__["data"][0]


@pytest.fixture(scope="module")
def henon():
    return orbid.simulate(HENON, sections=20000, seed=3)


def test_a_million_records_go_in_and_out_without_a_copy():
    values = np.random.default_rng(1).normal(size=(10**6, 2))
    before = values.copy()
    series = orbid.Series(values, ["x", "y"])
    out = series.segments[0].values
    assert address(out) == address(values)
    assert out.shape == values.shape and out.strides == values.strides
    assert not out.flags.writeable and values.flags.writeable
    assert len(series) == 10**6
    del series, values
    gc.collect()
    assert np.array_equal(out, before)
    again = orbid.Series(out, ["x", "y"])  # read-only: fine
    assert address(again.segments[0].values) == address(out)


def test_the_library_reads_the_array_itself():
    values = np.random.default_rng(1).normal(size=(1000, 2))
    series = orbid.Series(values, ["x", "y"])
    values[17] = [40.0, -40.0]  # the extremes themselves: 0.1 % on each side are left out of the range
    assert series.segments[0].values[17].tolist() == [40.0, -40.0]
    assert series.scale.tolist() == orbid.Series(values.copy(), ["x", "y"]).scale.tolist()


def test_a_simulated_record_goes_out_without_a_copy(henon):
    series = henon.series
    one, other = series.segments[0].values, henon.series.segments[0].values
    assert address(one) == address(other)
    del series
    gc.collect()
    assert np.isfinite(one).all()


def test_series_outlives_what_made_it():
    experiment = orbid.simulate(orbid.model("henon"), sections=100, seed=1)
    series = experiment.series
    del experiment
    gc.collect()
    values = series.segments[0].values
    del series
    gc.collect()
    assert values.shape == (100, 2) and np.isfinite(values).all()
    # x' = 1 - a x^2 + y, y' = b x: in each its own rounding.
    x, y = values.T
    assert np.abs(x[1:] - (1 - 1.4 * x[:-1] ** 2 + y[:-1])).max() < 1e-14
    assert np.abs(y[1:] - 0.3 * x[:-1]).max() < 1e-15


@pytest.mark.parametrize(
    "make",
    [
        lambda a: np.asfortranarray(a),
        lambda a: np.repeat(a, 2, axis=0)[::2],
        lambda a: a[::-1][::-1],
        lambda a: a.astype(np.longlong),
        lambda a: a.tolist(),
        lambda a: a.astype(np.float32),
        lambda a: a.astype(">f8"),
    ],
)
def test_other_arrays_are_converted(make):
    values = np.arange(12.0).reshape(6, 2)
    given = make(values)
    series = orbid.Series(given, ["x", "y"])
    assert series.segments[0].values.tolist() == values.tolist()
    assert series.segments[0].values.dtype == np.float64


@pytest.mark.parametrize(
    "values, error, text",
    [
        (None, TypeError, "values"),
        ("text", TypeError, "values"),
        (np.zeros((5, 3)), ValueError, r"\(5, 3\).*\(records, 2\)"),
        (np.zeros(5), ValueError, r"\(5,\)"),
        (np.zeros((2, 5, 2)), ValueError, "values"),
        (np.zeros((0, 2)), ValueError, "no record"),
        (np.zeros((5, 2), complex), TypeError, "complex"),
        (np.zeros((5, 2), bool), TypeError, "bool"),
        (np.zeros((5, 2), object), TypeError, "object"),
        (np.array([[0, np.inf]]), ValueError, r"values\[0, 1\] = inf"),
        (np.full((5, 2), 2**60), ValueError, "2\\^53"),
        ([np.zeros((5, 2)), np.zeros((5, 3))], ValueError, r"values\[1\]"),
    ],
)
def test_wrong_values(values, error, text):
    with pytest.raises(error, match=text):
        orbid.Series(values, ["x", "y"])


@pytest.mark.parametrize(
    "coordinates, options, error, text",
    [
        (None, {}, TypeError, "coordinates"),
        ("xy", {}, TypeError, "coordinates"),
        (["x", 3], {}, TypeError, "coordinates"),
        (["x", "x"], {}, ValueError, "twice"),
        (["x", ""], {}, ValueError, "no name"),
        (["x", {"name": "y", "angel": True}], {}, TypeError, "did you mean 'angle'"),
        (["x", "y"], {"time": 3}, TypeError, "did you mean 'times'"),
        (["x", "y"], {"times": [0.0, 1.0]}, ValueError, "needs 5"),
        (["x", "y"], {"times": [0.0, 1.0, 1.0, 2.0, 3.0]}, ValueError, "ascend"),
        (["x", "y"], {"times": [0.0, 1.0, np.nan, 2.0, 3.0]}, ValueError, "nan"),
        (["x", "y"], {"sampling": "samples"}, ValueError, "need times"),
        (["x", "y"], {"sampling": "sections"}, ValueError, "did you mean 'section'"),
        (["x", "y"], {"labels": ["a", "b"]}, ValueError, "labels"),
        (["x", "y"], {"deviations": np.zeros((5, 2))}, ValueError, "> 0"),
        (["x", "y"], {"phase": None}, TypeError, "phase"),
    ],
)
def test_wrong_descriptions(coordinates, options, error, text):
    with pytest.raises(error, match=text):
        orbid.Series(np.zeros((5, 2)), coordinates, **options)


def test_what_cycles_and_estimates_hold_is_read_only(henon):
    search = orbid.find_cycles(henon.series, periods=[1, 2])
    cycle = search.cycles[0]
    for array in (cycle.points, cycle.covariance, cycle.multipliers, cycle.ln_multiplier,
                  cycle.ln_multiplier_covariance, search.reading_covariance):
        assert not array.flags.writeable
    assert np.shares_memory(cycle.points, search.cycles[0].points)
    expected = cycle.points.copy()
    points = cycle.points
    del search, cycle
    gc.collect()
    orbid.find_cycles(henon.series, periods=[1, 2])
    assert np.array_equal(points, expected)
    series = orbid.simulate(HENON, sections=50, noise=[1e-3, 1e-3], seed=1).series
    result = orbid.estimate({"a": 1.4}, orbid.ShootingResidual(HENON, series, ["a"]))
    for array in (result.covariance, result.correlation, result.theta, result.residuals[0][0], result.latents[0][0]):
        assert not array.flags.writeable


def test_mappings_and_none_are_taken():
    section = types.MappingProxyType({"coordinate": "z", "value": 27, "direction": None})
    parameters = types.MappingProxyType({"rho": 28.0})
    made = orbid.simulate(orbid.model("lorenz"), parameters, sections=5, step=None, count=None, section=section)
    assert len(made.series) == 5
    series = orbid.Series(np.zeros((3, 1)), [types.MappingProxyType({"name": "x", "unit": "m"})])
    assert series.coordinates[0]["unit"] == "m"
    read_only = types.MappingProxyType
    prior = read_only({"normal": read_only({"mean": 1.38, "sd": 0.1})})
    series = orbid.simulate(HENON, sections=50, noise=[1e-3, 1e-3], seed=1).series
    residual = orbid.ShootingResidual(HENON, series, ["a"], errors=read_only({"x": read_only({"sd": 1e-3})}))
    result = orbid.estimate(read_only({"a": read_only({"start": 1.39, "prior": prior})}), residual)
    assert result.status == "converged" and not result.scales["series.x"].estimated


def test_a_list_of_records_is_one_segment():
    values = np.arange(10.0).reshape(5, 2)
    series = orbid.Series(list(values), ["x", "y"], deviations=list(np.ones((5, 2))))
    assert len(series.segments) == 1 and series.segments[0].values.tolist() == values.tolist()
    assert series.segments[0].deviations.tolist() == np.ones((5, 2)).tolist()
    several = orbid.Series([values, values[:1]], ["x", "y"], times=[np.arange(5.0), np.zeros(1)])
    assert [len(one) for one in several.segments] == [5, 1]
    assert several.segments[1].times.tolist() == [0.0]


def test_one_coordinate_needs_no_second_axis():
    values = np.arange(5.0)
    series = orbid.Series(values, ["x"], deviations=np.ones(5))
    assert series.segments[0].values.tolist() == values[:, None].tolist()
    assert series.segments[0].deviations.shape == (5, 1)
    assert np.shares_memory(series.segments[0].values, values)
    del values
    gc.collect()
    np.random.default_rng(2).normal(size=5)  # other use of freed memory
    assert series.segments[0].values[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_state_of_a_block():
    system, theta, series = lotka()
    residual = orbid.SeriesResidual(system, series, list(theta))
    start = list(theta.values())
    latents = np.arange(1.0, 1.0 + system.dimension)
    assert residual.state(0, start, latents).tolist() == latents.tolist()
    for block in (-1, 99, 2**40):
        with pytest.raises(ValueError, match="block"):
            residual.state(block, start, latents)
    for wrong in ((0, start, []), (0, start, [np.nan] * system.dimension), (0, start[:1], latents), (0, [], latents)):
        with pytest.raises(ValueError, match="latents|theta"):
            residual.state(*wrong)
    for wrong in ((0.5, start, latents), (0, None, latents), (None, start, latents)):
        with pytest.raises(TypeError):
            residual.state(*wrong)


def test_segments_times_and_files(tmp_path):
    values = [np.array([[0.1, 1.0], [0.2, np.nan], [0.3, 3.0]]), np.array([[1.1, -1.0], [1.2, -2.0]])]
    times = [np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.5])]
    coordinates = [{"name": "phi", "unit": "rad", "angle": True}, {"name": "w", "unit": "rad/s"}]
    series = orbid.Series(values, coordinates, times=times, labels=["one", "two"], phase=0.25, origin="by hand")
    assert [segment.label for segment in series.segments] == ["one", "two"]
    assert series.sampling == "samples" and series.timed and series.phase == 0.25
    assert [len(segment) for segment in series.segments] == [3, 2]
    orbid.write_hdf5(tmp_path / "record.h5", series)
    orbid.write_csv(tmp_path / "record.csv", series)
    back = [
        orbid.read_hdf5(tmp_path / "record.h5"),
        orbid.read_csv(
            tmp_path / "record.csv", {"phi": "phi", "w": "w"}, coordinates, segment="segment", time="t", phase=0.25
        ),
    ]
    for other in back:
        assert other.coordinates == series.coordinates
        for a, b in zip(series.segments, other.segments):
            assert np.array_equal(a.values, b.values, equal_nan=True) and a.times.tolist() == b.times.tolist()
    (tmp_path / "broken.csv").write_text("phi,w\n0.1,2\n0.2,abc\n")
    with pytest.raises(orbid.DataError, match="broken.csv"):
        orbid.read_csv(tmp_path / "broken.csv", {"phi": "phi", "w": "w"})
    with pytest.raises(orbid.DataError):
        orbid.read_hdf5(tmp_path / "missing.h5")
    (tmp_path / "bare.csv").write_text("phi\n" + "\n".join(str(k) for k in range(10)) + "\n")
    part = orbid.read_csv(tmp_path / "bare.csv", {"phi": "phi"}, step=0.5, window=(1, 4), rows=(1, 8), every=2)
    assert part.sampling == "samples" and part.segments[0].times.tolist() == [1.0, 2.0, 3.0]
    assert np.ravel(part.segments[0].values).tolist() == [2.0, 4.0, 6.0]
    volts = orbid.read_csv(tmp_path / "bare.csv", {"phi": {"column": "phi", "factor": 0.5}}, step=0.5)
    assert np.ravel(volts.segments[0].values).tolist() == [0.5 * k for k in range(10)]
    with pytest.raises(ValueError, match="window: needs"):
        orbid.read_csv(tmp_path / "bare.csv", {"phi": "phi"}, step=0.5, window=(1,))
    with pytest.raises(TypeError, match="did you mean 'offset'"):
        orbid.read_csv(tmp_path / "record.csv", {"phi": {"column": "phi", "ofset": 1.0}})
    with pytest.raises(TypeError):
        orbid.write_csv(tmp_path / "none.csv", None)


def test_cycles_of_the_henon_map(henon):
    search = orbid.find_cycles(henon.series, periods=[1, 2, 3, 4])
    assert [cycle.period for cycle in search.cycles] == [1, 2, 4]
    assert search.missing == [3]
    # Fixed point: x = (b - 1 + sqrt((1 - b)^2 + 4 a)) / (2 a), y = b x, a = 1.4, b = 0.3.
    x = (-0.7 + math.sqrt(0.49 + 5.6)) / 2.8
    root = math.sqrt(1.4**2 * x**2 + 0.3)
    one = search.cycles[0]
    sd = np.sqrt(np.diag(one.covariance))
    assert one.points.shape == (1, 2) and one.covariance.shape == (2, 2)
    # Clean data: within five of the sds found.
    assert np.abs(one.points[0] - [x, 0.3 * x]).max() < 5 * sd.max()
    assert one.multipliers.dtype == complex
    assert one.multipliers.real == pytest.approx([-1.4 * x - root, -1.4 * x + root], rel=1e-4)
    assert one.ln_multiplier == pytest.approx(np.log(np.abs(one.multipliers)), rel=1e-12)
    assert one.mirror is None and one.time != one.time
    with pytest.raises(ValueError):
        orbid.expand_cycles(search.cycles, complete_to=0)
    expansion = orbid.expand_cycles(search.cycles, complete_to=4)
    assert [term["period"] for term in expansion["by_period"]] == [1, 2, 3, 4]


def test_parameters_from_cycles(henon):
    cycles = orbid.find_cycles(henon.series, periods=[1, 2, 4, 6]).cycles
    start = [1.38, 0.305]
    residual = orbid.CycleResidual(HENON, cycles, ["a", "b"], start)
    result = orbid.estimate({"a": start[0], "b": start[1]}, residual)
    assert result.status == "converged"
    for name, true in (("a", 1.4), ("b", 0.3)):
        # Clean data of a map that the model is: local maps close to 1e-6 and better.
        assert abs(result.parameters[name].value - true) < 1e-5
    assert set(result.scales) == {"cycles.x", "cycles.y"}
    # Neither the lists nor the model need be held by the caller.
    residual = orbid.CycleResidual(orbid.model("henon"), list(cycles), ["a", "b"], start)
    gc.collect()
    assert orbid.estimate({"a": start[0], "b": start[1]}, residual).theta.tolist() == result.theta.tolist()


def lotka(noise=0.05):
    system = orbid.model("lotka_volterra")
    theta = {parameter.name: parameter.default for parameter in system.parameters}
    start = np.array([[10.0, 5.0]])
    experiment = orbid.simulate(system, None, step=0.1, count=120, initial=start, noise=[noise, noise], seed=5)
    return system, theta, experiment.series


def test_parameters_from_samples_two_ways():
    system, theta, series = lotka()
    names = list(theta)
    parameters = {name: {"start": 1.05 * value, "scale": "log"} for name, value in theta.items()}
    single = orbid.estimate(parameters, orbid.SeriesResidual(system, series, names))
    multiple = orbid.estimate(parameters, orbid.ShootingResidual(system, series, names))
    for result in (single, multiple):
        assert result.status == "converged"
        for name in names:
            estimated = result.parameters[name]
            assert abs(estimated.value - theta[name]) < 5 * estimated.sd  # five sds
    for name in names:
        # The same data, model and errors; both end within 1e-6 sds, matching is exact to 2e-5 of the readings' error.
        assert single.parameters[name].value == pytest.approx(
            multiple.parameters[name].value, abs=0.05 * single.parameters[name].sd
        )
    assert len(single.latents[0][0]) == 2


def test_python_and_library_residuals_together():
    system, theta, series = lotka()
    names = list(theta)
    first = names[0]

    def known(t):
        return np.array([t[0]])

    weight = orbid.LeastSquares(
        [theta[first]], known, jacobian=lambda t: np.eye(1, len(t)), name="known", errors={"sd": 1e-9}
    )
    result = orbid.estimate(dict(theta), [weight, orbid.SeriesResidual(system, series, names)])
    assert result.parameters[first].value == pytest.approx(theta[first], abs=1e-8)
    assert [count["type"] for count in result.counts] == ["least_squares", "series"]


def test_residuals_keep_series_and_system():
    system, theta, series = lotka()
    names = list(theta)
    expected = orbid.estimate(dict(theta), orbid.SeriesResidual(system, series, names)).theta
    values = np.array(series.segments[0].values)
    mine = orbid.Series(values, system, times=series.segments[0].times)
    residual = orbid.SeriesResidual(orbid.model("lotka_volterra"), mine, names)
    del system, series, values, mine
    gc.collect()
    np.random.default_rng(2).normal(size=240)  # other use of freed memory
    assert orbid.estimate(dict(theta), residual).theta.tolist() == expected.tolist()


def test_evaluate_has_the_derivatives_of_its_errors():
    system, theta, series = lotka()
    names = list(theta)
    residual = orbid.SeriesResidual(system, series, names)
    at = np.array([theta[name] for name in names])
    (value,) = residual.evaluate(at, derivatives=True)
    assert value["status"] == "ok" and value["e_theta"].shape == (240, len(names)) and value["e_z"].shape == (240, 2)
    step = 1e-6
    after, before = at.copy(), at.copy()
    after[0] += step
    before[0] -= step
    difference = (residual.evaluate(after)[0]["e"] - residual.evaluate(before)[0]["e"]) / (2 * step)
    # Central differences: truncation 1e-12 and rounding 1e-10 relative, times a hundred for their growth in time.
    assert np.abs(difference - value["e_theta"][:, 0]).max() < 1e-6 * np.abs(value["e_theta"][:, 0]).max()


def test_lyapunov_dimension_and_embedding(henon):
    spectrum = orbid.lyapunov_spectrum(henon.series)
    # lambda1 = 0.41922, the sum is ln 0.3; statistical error of 20000 steps: five sds.
    assert abs(spectrum["exponents"][0] - 0.41922) < 5 * spectrum["sds"][0]
    assert spectrum["exponents"].sum() == pytest.approx(math.log(0.3), abs=1e-3)
    dimension = orbid.correlation_dimension(henon.series)
    assert abs(dimension["dimension"] - 1.22) < 0.05
    t = np.arange(3000) * 0.05
    wave = orbid.Series((np.sin(t) + 0.5 * np.sin(0.37 * t))[:, None], ["x"], times=t)
    embedding = orbid.embed(wave, delay=20, dimension=3)
    assert embedding["series"].segments[0].values.shape == (3000 - 40, 3)
    assert np.array_equal(embedding["series"].segments[0].values[:, 1], wave.segments[0].values[20:-20, 0])


def test_harvest_finds_what_a_search_missed(henon):
    known = [cycle for cycle in orbid.find_cycles(henon.series, periods=[1, 2, 4]).cycles if cycle.period != 2]
    found = orbid.harvest(henon.series, HENON, None, known, periods=[1, 2, 4], search_points=20000)
    assert [cycle.period for cycle in found["cycles"]] == [2]
    assert found["orbits"] >= 3


def test_cycles_measured_elsewhere():
    x = (-0.7 + math.sqrt(0.49 + 5.6)) / 2.8
    cycle = orbid.Cycle([[x, 0.3 * x]], covariance=np.eye(2) * 1e-8)
    assert cycle.period == 1 and cycle.points.tolist() == [[x, 0.3 * x]]
    with pytest.raises(ValueError, match="covariance"):
        orbid.Cycle([[x, 0.3 * x]], covariance=np.eye(3))
    with pytest.raises(ValueError, match="points"):
        orbid.Cycle([x, 0.3 * x])
    with pytest.raises(ValueError, match="nan"):
        orbid.Cycle([[x, math.nan]])


@pytest.mark.parametrize(
    "call, error, text",
    [
        (lambda s: orbid.find_cycles(None), TypeError, ""),
        (lambda s: orbid.find_cycles(s, period=[1]), TypeError, "did you mean 'periods'"),
        (lambda s: orbid.find_cycles(s, periods=[1.5]), TypeError, "whole number"),
        (lambda s: orbid.find_cycles(s, periods=[0]), ValueError, "period"),
        (lambda s: orbid.find_cycles(s, periods=3), TypeError, "list"),
        (lambda s: orbid.find_cycles(s, method="patch"), ValueError, "did you mean 'patch_map'"),
        (lambda s: orbid.find_cycles(s, box=0.7), ValueError, "box"),
        (lambda s: orbid.find_cycles(s, symmetry_signs=[1, 2]), ValueError, ""),
        (lambda s: orbid.find_cycles(s, partition={"coordinate": "z"}), KeyError, "z"),
        (lambda s: orbid.lyapunov_spectrum(s, order=9), ValueError, "order"),
        (lambda s: orbid.correlation_dimension(s, pairs=1), ValueError, "pairs"),
        (lambda s: orbid.embed(s), ValueError, ""),
        (lambda s: orbid.expand_cycles([1], complete_to=1), TypeError, ""),
        (lambda s: orbid.simulate(None), TypeError, "system"),
        (lambda s: orbid.simulate(HENON), TypeError, "sections"),
        (lambda s: orbid.simulate(HENON, sections=0), ValueError, "sections"),
        (lambda s: orbid.simulate(HENON, sections=10, noise=[0.1]), ValueError, "noise"),
        (lambda s: orbid.simulate(HENON, {"c": 1.0}, sections=10), KeyError, "c"),
        (lambda s: orbid.simulate(HENON, sections=None), TypeError, "either"),
        (lambda s: orbid.Cycle(np.zeros((1, 2)), multipliers=3), TypeError, "multipliers"),
        (lambda s: orbid.simulate(HENON, sections=10, initial=[[0.1, np.nan]]), ValueError, "nan"),
        (lambda s: orbid.CycleResidual(HENON, [], ["a", "b"], [1.4, 0.3]), ValueError, ""),
        (lambda s: orbid.CycleResidual(HENON, [None], ["a"], [1.4]), TypeError, ""),
        (lambda s: orbid.CycleResidual(HENON, [orbid.Cycle([[0.6, 0.2]])], ["a"], [1.4, 0.3]), ValueError, "start"),
        (lambda s: orbid.CycleResidual(HENON, [orbid.Cycle([[0.6, 0.2]])], ["a"], [1.4]), ValueError, "covariance"),
        (lambda s: orbid.SeriesResidual(HENON, s, ["a"]), ValueError, ""),
        (lambda s: orbid.SeriesResidual(HENON, None, ["a"]), TypeError, ""),
        (lambda s: orbid.SeriesResidual(None, s, ["a"]), TypeError, "system"),
        (lambda s: orbid.ShootingResidual(HENON, s, "a"), TypeError, "parameters"),
        (lambda s: orbid.ShootingResidual(HENON, s, ["a", "a"]), ValueError, "twice"),
        (lambda s: orbid.ShootingResidual(HENON, s, [None]), ValueError, "none"),
        (lambda s: orbid.ShootingResidual(HENON, s, ["c"]), KeyError, "c"),
        (lambda s: orbid.ShootingResidual(HENON, s, ["a"], matching="loose"), ValueError, "exact"),
        (lambda s: orbid.ShootingResidual(HENON, s, ["a"], errors={"z": {}}), KeyError, "z"),
        (lambda s: orbid.ShootingResidual(HENON, s, ["a"], error={}), TypeError, "did you mean 'errors'"),
    ],
)
def test_wrong_calls(henon, call, error, text):
    with pytest.raises(error, match=text):
        call(henon.series)
