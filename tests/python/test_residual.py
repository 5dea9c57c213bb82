"""Residuals written in Python: the same numbers as in C++, and what goes wrong in them."""

import gc
import json
import math
import threading
import traceback

import numpy as np
import pytest

import orbid

import decay_twin  # built beside the package

T = np.linspace(0.0, 5.0, 6)
Y = np.array([2.02, 1.21, 0.75, 0.43, 0.29, 0.17])
START = {"a": 1.0, "k": {"start": 1.0, "scale": "log", "bounds": [0, None]}}


class Decay(orbid.Residual):
    """y(t) = a exp(-k t), as in docs/estimator.md."""

    def __init__(self, t=T, y=Y):
        super().__init__()
        self.t = t
        self.y = y

    def groups(self):
        return [{"name": "readings", "unit": "V", "distribution": "student_t", "floor": 1e-4}]

    def layout(self):
        return [{"label": "run 1", "records": len(self.y)}]

    def evaluate(self, theta, latents, derivatives):
        shape = np.array([math.exp(-theta[1] * t) for t in self.t])
        value = {"e": self.y - theta[0] * shape}
        if derivatives:
            value["e_theta"] = np.column_stack([-shape, theta[0] * self.t * shape])
        return value


def test_fit_of_the_page():
    result = orbid.estimate(START, Decay())
    assert result.status == "converged"
    assert result.parameters["a"].value == pytest.approx(2.01592, abs=5e-6)
    assert result.parameters["k"].interval95 == pytest.approx((0.476937, 0.525455), abs=5e-7)
    assert result.parameters["k"].interval_method == "satterthwaite"
    assert result.scales["readings"].unit == "V"
    assert list(result.parameters) == ["a", "k"]
    assert result.theta.tolist() == [result.parameters["a"].value, result.parameters["k"].value]


def test_same_bytes_as_the_twin_in_cpp():
    ours = orbid.estimate(START, Decay())
    twin = orbid.estimate(START, decay_twin.Decay(T, Y))
    one, other = ours.to_dict(), twin.to_dict()
    one.pop("counts"), other.pop("counts")  # they name the residual
    assert json.dumps(one) == json.dumps(other)
    assert ours.residuals[0][0].tobytes() == twin.residuals[0][0].tobytes()
    assert ours.history == twin.history
    profiles = [result.profiles()["k"]["values"].tolist() for result in (ours, twin)]
    assert profiles[0] == profiles[1]
    draws = [result.sample(draws=50, warm_up=50)["draws"] for result in (ours, twin)]
    assert all(a.tobytes() == b.tobytes() for a, b in zip(*draws))


def test_alone_and_in_threads_the_same():
    expected = orbid.estimate(START, Decay()).to_dict()
    found = [None] * 4

    def run(k):
        found[k] = orbid.estimate(START, Decay()).to_dict()

    threads = [threading.Thread(target=run, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(json.dumps(one) == json.dumps(expected) for one in found)


class Panel(orbid.Residual):
    """y_bi = theta + z_b + error, z_b with an error of its own: a mean over groups of different means."""

    def __init__(self, y):
        super().__init__()
        self.y = y
        self.calls = []

    def groups(self):
        return [{"name": "readings", "sd": 0.1}, {"name": "between", "sd": 1.0}]

    def layout(self):
        return [{"groups": [0] * len(y) + [1], "latents": 1} for y in self.y]

    def initial_latents(self):
        return [np.zeros(1) for _ in self.y]

    def evaluate(self, theta, latents, derivatives):
        return [
            {
                "e": np.append(y - theta[0] - z[0], -z[0]),
                "e_theta": np.append(-np.ones(len(y)), 0.0)[:, None],
                "e_z": -np.ones((len(y) + 1, 1)),
            }
            for y, z in zip(self.y, latents)
        ]

    def update_active_set(self, theta, latents, scales):
        self.calls.append((theta.copy(), len(latents), scales.copy()))


def test_latent_states():
    y = [np.array([1.0, 1.2, 0.9]), np.array([3.0, 3.1, 2.9, 3.0])]
    residual = Panel(y)
    result = orbid.estimate({"mean": 0.0}, residual)
    # Closed form: means of blocks with variances 0.01 / n + 1, weighted by their inverses.
    weights = np.array([1.0 / (0.01 / len(one) + 1.0) for one in y])
    means = np.array([one.mean() for one in y])
    expected = (weights * means).sum() / weights.sum()
    # Linear and exact but for rounding, measured 2e-16.
    assert result.theta[0] == pytest.approx(expected, abs=1e-13)
    assert result.parameters["mean"].sd == pytest.approx(weights.sum() ** -0.5, rel=1e-12)
    shrunk = (means - expected) / (1.0 + 0.01 / np.array([3, 4]))
    assert [z[0] for z in result.latents[0]] == pytest.approx(shrunk.tolist(), abs=1e-13)
    assert residual.calls and residual.calls[0][1] == 2
    assert residual.calls[0][2] == pytest.approx([0.1, 1.0], rel=1e-15)  # kept as logarithms


def test_exception_comes_out_with_its_traceback():
    class Wrong(Decay):
        def evaluate(self, theta, latents, derivatives):
            if theta[0] != 1.0:
                raise KeyError("a place of its own")
            return super().evaluate(theta, latents, derivatives)

    with pytest.raises(KeyError, match="a place of its own") as raised:
        orbid.estimate(START, Wrong())
    frames = traceback.extract_tb(raised.value.__traceback__)
    assert frames[-1].name == "evaluate" and "raise KeyError" in frames[-1].line
    assert orbid.estimate(START, Decay()).status == "converged"


@pytest.mark.parametrize("method", ["groups", "layout", "type", "initial_latents", "update_active_set", "structure"])
def test_exceptions_of_other_methods(method):
    def fail(self, *arguments):
        raise ArithmeticError(method)

    wrong = type("Wrong", (Decay,), {method: fail})()
    with pytest.raises(ArithmeticError, match=method):
        orbid.estimate(START, wrong)


def test_exceptions_in_parallel_work_come_out():
    class Later(Decay):
        broken = False

        def evaluate(self, theta, latents, derivatives):
            if self.broken:
                raise OSError("no more")
            return super().evaluate(theta, latents, derivatives)

    residual = Later()
    result = orbid.estimate(START, residual)
    residual.broken = True
    for ask in (result.profiles, result.marginals, result.sample):
        with pytest.raises(OSError, match="no more"):
            ask()
    residual.broken = False
    assert result.profiles()["a"]["known"]


def test_super_init_is_needed():
    class Forgot(Decay):
        def __init__(self):
            self.t, self.y = T, Y

    with pytest.raises(TypeError, match="__init__"):
        Forgot()


def test_methods_are_needed():
    class Empty(orbid.Residual):
        pass

    with pytest.raises(TypeError, match="evaluate"):
        orbid.estimate(START, Empty())

    class NoGroups(orbid.Residual):
        def evaluate(self, theta, latents, derivatives):
            return {}

    with pytest.raises(TypeError, match="groups"):
        orbid.estimate(START, NoGroups())


@pytest.mark.parametrize(
    "answer, error, text",
    [
        (None, TypeError, "NoneType"),
        (3.0, TypeError, "float"),
        (np.zeros(6), TypeError, "ndarray"),
        ([], ValueError, "0 blocks"),
        ([{}, {}], ValueError, "2 blocks"),
        ({}, TypeError, "'e' is missing"),
        ({"e": None, "e_theta": np.zeros((6, 2))}, TypeError, "'e' is missing"),
        ({"e": np.zeros(5), "e_theta": np.zeros((6, 2))}, ValueError, r"e: shape \(5,\), needs \(6,\)"),
        ({"e": np.zeros((6, 1)), "e_theta": np.zeros((6, 2))}, ValueError, r"needs \(6,\)"),
        ({"e": np.zeros(6), "e_theta": np.zeros((2, 6))}, ValueError, r"e_theta: shape \(2, 6\), needs \(6, 2\)"),
        ({"e": np.zeros(6), "e_theta": np.zeros(12)}, ValueError, "e_theta"),
        ({"e": np.zeros(6)}, TypeError, "'e_theta' is missing"),
        ({"e": "text"}, TypeError, "real numbers"),
        ({"e": np.zeros(6, complex)}, TypeError, "complex"),
        ({"e": np.zeros(6), "e_thetas": np.zeros((6, 2))}, TypeError, "e_theta"),
        ({"e": np.array([0, 0, np.nan, 0, 0, 0]), "e_theta": np.zeros((6, 2))}, ValueError, r"e\[2\] = nan"),
        ({"e": np.zeros(6), "e_theta": np.full((6, 2), np.inf)}, ValueError, r"e_theta\[0, 0\] = inf"),
    ],
)
def test_wrong_values(answer, error, text):
    class Wrong(Decay):
        def evaluate(self, theta, latents, derivatives):
            return answer

    with pytest.raises(error, match=text):
        orbid.estimate(START, Wrong())


@pytest.mark.parametrize(
    "layout, error, text",
    [
        ([], ValueError, "no block"),
        ([3], TypeError, "needs a dict"),
        ([{"label": "a"}], TypeError, "'records'"),
        ([{"records": 6.0}], TypeError, "whole number"),
        ([{"records": -1}], ValueError, "at least 0"),
        ([{"records": 6, "group": 1}], ValueError, "there are 1 groups"),
        ([{"groups": [0, 0, 0, 0, 0, 1]}], ValueError, "there are 1 groups"),
        ([{"groups": ["readings"] * 5 + ["reading"]}], ValueError, "no group 'reading'"),
        ([{"records": 6, "deviation": np.ones(5)}], ValueError, "5 entries, needs 6"),
        ([{"records": 6, "deviations": np.ones(6)}], TypeError, "did you mean 'deviation'"),
    ],
)
def test_wrong_layouts(layout, error, text):
    class Wrong(Decay):
        def layout(self):
            return layout

    with pytest.raises(error, match=text):
        orbid.estimate(START, Wrong())


@pytest.mark.parametrize(
    "groups, error, text",
    [
        ([{}], TypeError, "'name' is missing"),
        ([{"name": "r", "distribution": "student"}], ValueError, "did you mean 'student_t'"),
        ([{"name": "r", "dof": 3}], ValueError, "another distribution"),
        ([{"name": "r", "sd": "guess"}], ValueError, "estimate"),
        ([{"name": "r", "sd": -1.0}], ValueError, ""),
        ([{"name": "r", "floor": float("nan")}], ValueError, "floor"),
        ([{"name": "r", "sigma": 1}], TypeError, "unknown 'sigma'"),
        (7, TypeError, ""),
    ],
)
def test_wrong_groups(groups, error, text):
    class Wrong(Decay):
        def groups(self):
            return groups

    with pytest.raises(error, match=text):
        orbid.estimate(START, Wrong())


def test_places_that_cannot_be_evaluated_shorten_the_step():
    class Narrow(Decay):
        refused = 0

        def evaluate(self, theta, latents, derivatives):
            if theta[0] > 1.5 and self.refused < 2:
                self.refused += 1
                return [None] if self.refused == 1 else {"e": np.full(6, np.inf), "e_theta": np.zeros((6, 2))}
            return super().evaluate(theta, latents, derivatives)

    residual = Narrow()
    result = orbid.estimate(START, residual)
    assert residual.refused == 2
    assert result.status == "converged"
    assert result.theta == pytest.approx(orbid.estimate(START, Decay()).theta, rel=1e-6)
    assert any(step["reason"] == "block failed" for step in result.history)


def test_other_arrays_are_taken():
    class Strided(Decay):
        def evaluate(self, theta, latents, derivatives):
            value = super().evaluate(theta, latents, derivatives)
            e = np.repeat(value["e"], 2)[::2]
            e.flags.writeable = False
            value["e"] = e
            if derivatives:
                value["e_theta"] = np.asfortranarray(value["e_theta"])
            return [value]

    assert json.dumps(orbid.estimate(START, Strided()).to_dict()) == json.dumps(orbid.estimate(START, Decay()).to_dict())


def test_residual_given_twice_or_in_use():
    decay = Decay()
    with pytest.raises(ValueError, match="twice"):
        orbid.estimate(START, [decay, decay])

    class Nested(Decay):
        def evaluate(self, theta, latents, derivatives):
            orbid.estimate(START, self)
            return super().evaluate(theta, latents, derivatives)

    with pytest.raises(ValueError, match="still runs"):
        orbid.estimate(START, Nested())


def test_computations_share_a_residual_of_the_library():
    series = orbid.simulate(orbid.model("henon"), sections=50, noise=[1e-3, 1e-3], seed=1).series
    residual = orbid.ShootingResidual(orbid.model("henon"), series, ["a"])

    inner = []

    def again(iteration, objective):
        if not inner:
            inner.append(orbid.estimate({"a": 1.39}, residual))

    outer = orbid.estimate({"a": 1.39}, residual, progress=again)
    assert outer.status == "converged"
    assert inner[0].theta.tolist() == outer.theta.tolist()


def test_suspended_blocks_take_part_in_the_next_estimate():
    class Blocks(orbid.Residual):
        broken = True

        def groups(self):
            return [{"name": "readings", "sd": 0.1}]

        def layout(self):
            return [{"records": 3}, {"records": 3}, {"records": 2}]

        def evaluate(self, theta, latents, derivatives):
            values = [{"e": y - theta[0] * np.ones(y.size), "e_theta": -np.ones((y.size, 1))}
                      for y in (np.array([1.0, 1.1, 0.9]), np.array([0.8, 1.2, 1.0]), np.array([2.0, 2.2]))]
            if self.broken:
                values[2] = None
            return values

    residual = Blocks()
    first = orbid.estimate({"mean": 0.0}, residual)
    assert first.counts[0]["lost"] == 1 and first.theta[0] == pytest.approx(1.0, abs=1e-12)
    assert first.profiles()["mean"]["value"] == first.theta[0]  # of the blocks that are left
    assert first.profiles()["mean"]["value"] == first.theta[0]  # and once more
    residual.broken = False
    second = orbid.estimate({"mean": 0.0}, residual)
    assert second.counts[0]["lost"] == 0 and second.theta[0] == pytest.approx(10.2 / 8, abs=1e-12)


def test_an_estimate_within_an_evaluation():
    class Nested(Decay):
        def evaluate(self, theta, latents, derivatives):
            assert orbid.estimate(START, Decay()).status == "converged"
            return super().evaluate(theta, latents, derivatives)

    assert orbid.estimate(START, Nested()).theta.tolist() == orbid.estimate(START, Decay()).theta.tolist()


def test_residuals_live_as_long_as_the_estimate_needs_them():
    result = orbid.estimate(START, Decay(T.copy(), Y.copy()))
    gc.collect()
    assert result.profiles(names=["k"])["k"]["known"]
    errors = result.residuals[0][0]
    expected = errors.copy()
    del result
    gc.collect()
    assert errors.tolist() == expected.tolist()


@pytest.mark.parametrize("residuals", [None, 3, "decay", [None], [Decay], {}, []])
def test_what_is_no_residual(residuals):
    with pytest.raises((TypeError, ValueError), match="residuals"):
        orbid.estimate(START, residuals)
