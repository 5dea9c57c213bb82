"""The estimator from Python: closed forms, options, wrong calls."""

import collections.abc
import gc
import json
import math
import threading

import numpy as np
import pytest

import orbid

X = np.linspace(-1.0, 2.0, 12)
Y = 1.5 - 0.7 * X + np.array([3, -5, 2, 7, -4, -6, 5, 1, -3, 4, -2, -2]) * 1e-2
DESIGN = np.column_stack([np.ones_like(X), X])


def line(**options):
    return orbid.LeastSquares(Y, lambda theta: DESIGN @ theta, jacobian=lambda theta: DESIGN, **options)


def test_a_line_is_exact():
    result = orbid.estimate({"c": 0.0, "s": 0.0}, line(unit="m"))
    beta, squares, _, _ = np.linalg.lstsq(DESIGN, Y, rcond=None)
    variance = squares[0] / (len(Y) - 2)
    covariance = variance * np.linalg.inv(DESIGN.T @ DESIGN)
    assert result.status == "converged"
    # Linear: exact but for rounding of the normal equations here, condition 2.
    assert result.theta == pytest.approx(beta, rel=1e-12)
    values = list(result.parameters.values())
    assert list(result.sds) == [one.sd for one in values] and (result.sds > 0.0).all()
    assert result.intervals.shape == (len(values), 2)
    assert [tuple(row) for row in result.intervals] == [one.interval95 for one in values]
    # The scale ends within 1e-6 of its own sd, which is 0.2 of it.
    assert result.scales["readings"].value ** 2 == pytest.approx(variance, rel=1e-6)
    assert result.covariance == pytest.approx(covariance, rel=1e-6)
    assert result.scales["readings"].count == 12
    assert result.degrees_of_freedom == pytest.approx(10)
    quantile = 2.2281388519649385  # Student's t, 0.975, 10 degrees of freedom
    half = quantile * math.sqrt(covariance[1, 1])
    assert result.parameters["s"].interval95 == pytest.approx((beta[1] - half, beta[1] + half), rel=1e-5)
    profile = result.profiles(names="s")["s"]
    assert profile["interval"] == pytest.approx((beta[1] - half, beta[1] + half), rel=1e-3)
    assert profile["theta"].shape == (len(profile["values"]), 2)
    marginal = result.marginals(names=["s"])["s"]
    assert marginal["mean"] == pytest.approx(beta[1], rel=1e-3)
    assert marginal["interval95"] == pytest.approx((beta[1] - half, beta[1] + half), rel=2e-3)


def test_errors_are_named_as_in_jobs():
    fixed = orbid.estimate({"c": 0.0, "s": 0.0}, line(errors={"sd": 0.05}))
    assert not fixed.scales["readings"].estimated
    assert fixed.covariance == pytest.approx(0.05**2 * np.linalg.inv(DESIGN.T @ DESIGN), rel=1e-9)
    student = orbid.estimate({"c": 0.0, "s": 0.0}, line(errors={"distribution": "student_t", "dof": 4}))
    assert student.scales["readings"].distribution == "student_t"
    two = orbid.estimate(
        {"c": 0.0, "s": 0.0}, line(groups=[0] * 6 + [1] * 6, errors=[{"sd": 0.05}, {"name": "late", "sd": 0.1}])
    )
    weights = np.repeat([1 / 0.05**2, 1 / 0.1**2], 6)
    assert two.covariance == pytest.approx(np.linalg.inv(DESIGN.T @ (weights[:, None] * DESIGN)), rel=1e-9)
    assert list(two.scales) == ["readings.0", "late"]
    known = orbid.estimate({"c": 0.0, "s": 0.0}, line(deviations=np.full(12, 0.05), errors={"sd": 1.0}))
    assert known.covariance == pytest.approx(fixed.covariance, rel=1e-9)


def test_differences_are_asked_for_by_name():
    def prediction(theta):
        return theta[0] * np.exp(-theta[1] * X)

    def jacobian(theta):
        shape = np.exp(-theta[1] * X)
        return np.column_stack([shape, -theta[0] * X * shape])

    y = prediction([1.2, 0.4]) + 1e-3 * np.cos(7 * X)
    start = {"a": 1.0, "k": 0.3}
    exact = orbid.estimate(start, orbid.LeastSquares(y, prediction, jacobian=jacobian))
    for name, accuracy in (("2-point", 1e-6), ("3-point", 1e-9)):
        # Errors of derivatives, 1e-8 and 1e-10, times ten, times the condition of the problem (about 3).
        near = orbid.estimate(start, orbid.LeastSquares(y, prediction, jacobian=name))
        assert near.status == "converged"
        for one in ("a", "k"):
            assert near.parameters[one].sd == pytest.approx(exact.parameters[one].sd, rel=accuracy)
            assert near.parameters[one].value == pytest.approx(exact.parameters[one].value, rel=accuracy)
    with pytest.raises(ValueError, match="2-point"):
        orbid.LeastSquares(y, prediction, jacobian="4-point")
    with pytest.raises(TypeError, match="jacobian"):
        orbid.LeastSquares(y, prediction)


def test_priors_bounds_and_ties():
    sd = 0.05
    prior = {"normal": {"mean": 1.0, "sd": 0.01}}
    result = orbid.estimate({"c": {"start": 1.0, "prior": prior}, "s": 0.0}, line(errors={"sd": sd}))
    information = DESIGN.T @ DESIGN / sd**2 + np.diag([1 / 0.01**2, 0.0])
    expected = np.linalg.solve(information, DESIGN.T @ Y / sd**2 + np.array([1.0 / 0.01**2, 0.0]))
    assert result.theta == pytest.approx(expected, rel=1e-10)
    assert 0.0 < result.parameters["c"].data_share < 1.0
    bounded = orbid.estimate({"c": {"start": 1.0, "bounds": [None, 1.2]}, "s": 0.0}, line(errors={"sd": sd}))
    assert bounded.parameters["c"].value == 1.2 and bounded.parameters["c"].at_bound == "upper"
    assert math.isnan(bounded.parameters["c"].sd)
    tied = orbid.estimate({"c": 1.0, "s": {"tied": {"to": "c", "factor": -0.5}}}, line(errors={"sd": sd}))
    design = DESIGN @ np.array([1.0, -0.5])
    assert tied.parameters["c"].value == pytest.approx(design @ Y / (design @ design), rel=1e-12)
    assert tied.parameters["s"].value == -0.5 * tied.parameters["c"].value
    joint = {"normal": {"names": ["c", "s"], "mean": [1.5, -0.7], "covariance": [[1e-8, 0], [0, 1e-8]]}}
    held = orbid.estimate({"c": 1.0, "s": 0.0}, line(errors={"sd": sd}), joint_priors=[joint])
    assert held.theta == pytest.approx([1.5, -0.7], abs=1e-4)


def test_derived_quantities_and_progress():
    seen = []
    result = orbid.estimate(
        {"c": 0.0, "s": -1.0},
        line(errors={"sd": 0.05}),
        derived={"ratio": (lambda t: t[0] / t[1], lambda t: np.array([1 / t[1], -t[0] / t[1] ** 2]))},
        progress=lambda iteration, objective: seen.append((iteration, objective)),
    )
    gradient = np.array([1 / result.theta[1], -result.theta[0] / result.theta[1] ** 2])
    assert result.derived["ratio"].value == result.theta[0] / result.theta[1]
    assert result.derived["ratio"].sd == pytest.approx(math.sqrt(gradient @ result.covariance @ gradient), rel=1e-9)
    assert seen and seen[-1][0] == result.iterations

    def fail(*arguments):
        raise LookupError("in progress")

    with pytest.raises(LookupError, match="in progress"):
        orbid.estimate({"c": 0.0, "s": 0.0}, line(), progress=fail)
    with pytest.raises(LookupError, match="in progress"):
        orbid.estimate({"c": 0.0, "s": 0.0}, line(), derived={"a": (fail, fail)})


def test_functions_of_derived_quantities_are_kept():
    class Pair(collections.abc.Sequence):
        """Makes its functions when it is asked for them."""

        def __len__(self):
            return 2

        def __getitem__(self, k):
            return [lambda t: t[0] - t[1], lambda t: np.array([1.0, -1.0])][k]

    derived = {"difference": Pair(), "sum": (lambda t: t[0] + t[1], lambda t: np.ones(2))}
    result = orbid.estimate({"c": 0.0, "s": 0.0}, line(errors={"sd": 0.05}), derived=derived,
                            progress=lambda *arguments: derived.clear() or gc.collect())
    assert result.derived["difference"].value == result.theta[0] - result.theta[1]
    assert not derived and result.derived["sum"].value == result.theta[0] + result.theta[1]
    assert set(result.sample(draws=20, warm_up=20, chains=1)["derived"]) == {"difference", "sum"}
    for wrong in ({1: derived}, {"a": 3}, {"a": (3, 4)}, {"a": "ab"}, {"a": (len,)}, [("a", len)]):
        with pytest.raises(TypeError, match="derived"):
            orbid.estimate({"c": 0.0, "s": 0.0}, line(), derived=wrong)


def test_sample_and_multi_start():
    result = orbid.estimate({"c": 0.0, "s": 0.0}, line(errors={"sd": 0.05}))
    sample = result.sample(draws=400, warm_up=200, chains=2, seed=3)
    assert sample["status"] == "complete"
    assert [chain.shape for chain in sample["draws"]] == [(400, 2), (400, 2)]
    for name in ("c", "s"):
        quantity = sample["parameters"][name]
        # Five Monte-Carlo standard errors.
        assert abs(quantity["mean"] - result.parameters[name].value) < 5 * quantity["mean_error"]
    again = result.sample(draws=400, warm_up=200, chains=2, seed=3)
    assert [a.tobytes() for a in again["draws"]] == [a.tobytes() for a in sample["draws"]]

    def two_minima():
        y = np.array([4.0, 1.0])
        return orbid.LeastSquares(
            y,
            lambda t: np.array([t[0] ** 2, 0.9 + 0.05 * t[0]]),
            jacobian=lambda t: np.array([[2 * t[0]], [0.05]]),
            errors={"sd": 0.1},
        )

    found = orbid.multi_start({"t": {"start": -1.0, "bounds": [-5, 5]}}, two_minima, starts=8, seed=2)
    assert found["best"].theta[0] == pytest.approx(2.0, abs=1e-2)
    assert sorted(np.sign(one["theta"][0]) for one in found["optima"]) == [-1, 1]
    assert len(found["runs"]) == 8 and not found["interrupted"]
    seen = []
    orbid.multi_start({"t": {"start": -1.0, "bounds": [-5, 5]}}, two_minima, starts=3,
                      progress=lambda finished, total: seen.append((finished, total)))
    assert seen == [(1, 3), (2, 3), (3, 3)]
    with pytest.raises(ZeroDivisionError):
        orbid.multi_start({"t": {"start": -1.0, "bounds": [-5, 5]}}, two_minima, starts=3,
                          progress=lambda finished, total: 1 // 0)
    with pytest.raises(ValueError, match="multi_start"):
        found["best"].profiles()
    shared = two_minima()
    with pytest.raises(ValueError, match="twice"):
        orbid.multi_start({"t": {"start": -1.0, "bounds": [-5, 5]}}, lambda: shared, starts=3)
    with pytest.raises(TypeError, match="function"):
        orbid.multi_start({"t": 1.0}, shared)


def test_result_as_a_dict_is_json():
    result = orbid.estimate({"c": 0.0, "s": 0.0}, line())
    stored = json.loads(json.dumps(result.to_dict()))
    assert stored["parameters"]["c"]["value"] == result.parameters["c"].value
    assert stored["parameters"]["c"]["interval95"] == list(result.parameters["c"].interval95)
    assert stored["status"] == "converged"
    assert "c = " in repr(result) and "converged" in repr(result)


@pytest.mark.parametrize(
    "parameters, error, text",
    [
        (None, TypeError, "parameters"),
        (["c", "s"], TypeError, "dict"),
        ({}, ValueError, "none"),
        ({1: 2.0}, TypeError, "no text"),
        ({"c": None, "s": 0.0}, TypeError, "'c'"),
        ({"c": "1", "s": 0.0}, TypeError, "'c'"),
        ({"c": True, "s": 0.0}, TypeError, "'c'"),
        ({"c": float("nan"), "s": 0.0}, ValueError, "nan"),
        ({"c": {}, "s": 0.0}, TypeError, "'start' is missing"),
        ({"c": {"start": 1, "skale": "log"}, "s": 0.0}, TypeError, "did you mean 'scale'"),
        ({"c": {"start": 1, "scale": "logg"}, "s": 0.0}, ValueError, "did you mean 'log'"),
        ({"c": {"start": -1, "scale": "log"}, "s": 0.0}, ValueError, "c"),
        ({"c": {"start": 1, "bounds": [2, 3]}, "s": 0.0}, ValueError, "c"),
        ({"c": {"start": 1, "bounds": 3}, "s": 0.0}, ValueError, "bounds"),
        ({"c": {"start": 1, "prior": {"normal": {"mean": 0, "sd": -1}}}, "s": 0.0}, ValueError, "sd"),
        ({"c": {"start": 1, "prior": {"normal": {"mean": 0}}}, "s": 0.0}, TypeError, "'sd' is missing"),
        ({"c": {"start": 1, "prior": {"normale": {}}}, "s": 0.0}, ValueError, "normale"),
        ({"c": {"start": 1, "prior": "vague"}, "s": 0.0}, ValueError, "vague"),
        ({"c": 1.0, "s": {"tied": "d"}}, ValueError, "d"),
        ({"c": 1.0, "s": {"tied": "c", "start": 1}}, TypeError, "start"),
    ],
)
def test_wrong_parameters(parameters, error, text):
    with pytest.raises(error, match=text):
        orbid.estimate(parameters, line())


@pytest.mark.parametrize(
    "options, error, text",
    [
        ({"maximum_iteration": 3}, TypeError, "did you mean 'maximum_iterations'"),
        ({"maximum_iterations": 0}, ValueError, "at least 1"),
        ({"maximum_iterations": 3.0}, TypeError, "whole number"),
        ({"variance": "reml"}, ValueError, "did you mean 'ml'"),
        ({"step_tolerance": -1.0}, ValueError, "step_tolerance|tolerance"),
        ({"step_tolerance": None}, TypeError, "step_tolerance"),
        ({"verdict": 1}, TypeError, "True or False"),
        ({"progress": 3}, TypeError, "function"),
        ({"derived": 3}, TypeError, "derived"),
        ({"joint_priors": [{"normal": {"names": ["q"], "mean": [0], "covariance": [[1]]}}]}, ValueError, "q"),
    ],
)
def test_wrong_options(options, error, text):
    with pytest.raises(error, match=text):
        orbid.estimate({"c": 0.0, "s": 0.0}, line(), **options)


@pytest.mark.parametrize(
    "y, error, text",
    [
        (None, TypeError, "y"),
        ([1.0, float("nan")], ValueError, r"y\[1\] = nan"),
        (["a", "b"], TypeError, "y"),
        (np.ones((2, 2)), ValueError, "one dimension"),
        (np.ones(3, complex), TypeError, "complex"),
        (np.ones(3, bool), TypeError, "bool"),
        ([], ValueError, "no reading"),
        (np.ma.array([1.0, 2.0], mask=[0, 1]), TypeError, "masked"),
        (np.array([2**53 + 1, 0]), ValueError, "y: .*2.53"),
        (np.ones(2, np.longdouble), TypeError, "y: numbers of type (float128|longdouble)"),
    ],
)
def test_wrong_readings(y, error, text):
    with pytest.raises(error, match=text):
        orbid.estimate({"c": 0.0}, orbid.LeastSquares(y, lambda t: t[0] * np.ones(2), jacobian="2-point"))


def test_functions_may_fill_one_array():
    filled = np.empty(Y.size)

    def prediction(theta):
        filled[:] = DESIGN @ theta
        return filled

    result = orbid.estimate({"c": 0.0, "s": 0.0}, orbid.LeastSquares(Y, prediction, jacobian="3-point"))
    assert result.theta == pytest.approx(orbid.estimate({"c": 0.0, "s": 0.0}, line()).theta, rel=1e-6)


@pytest.mark.parametrize(
    "prediction, jacobian, text",
    [
        (lambda t: np.ones(3), lambda t: DESIGN, r"prediction returned shape \(3,\)"),
        (lambda t: DESIGN @ t, lambda t: DESIGN.T, r"jacobian returned shape \(2, 12\)"),
        (lambda t: None, lambda t: DESIGN, "what prediction returned: None"),
        (lambda t: DESIGN @ t * 1j, lambda t: DESIGN, "complex"),
    ],
)
def test_wrong_functions(prediction, jacobian, text):
    with pytest.raises((TypeError, ValueError), match=text):
        orbid.estimate({"c": 0.0, "s": 0.0}, orbid.LeastSquares(Y, prediction, jacobian=jacobian))


def test_wrong_names_of_inquiries():
    result = orbid.estimate({"c": 0.0, "s": 0.0}, line())
    for ask in (result.profiles, result.marginals):
        with pytest.raises(ValueError, match="slope"):
            ask(names=["slope"])
        with pytest.raises(TypeError, match="names"):
            ask(names=3)
        with pytest.raises(TypeError, match="unknown 'name'"):
            ask(name="c")
    with pytest.raises(TypeError, match="draws"):
        result.sample(draws=10.5)


def test_estimates_in_a_thread_are_not_interrupted_by_others():
    found = []
    thread = threading.Thread(target=lambda: found.append(orbid.estimate({"c": 0.0, "s": 0.0}, line())))
    thread.start()
    thread.join()
    assert found[0].status == "converged"
