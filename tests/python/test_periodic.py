"""Periodic orbits against closed forms: Hopf's normal form, the maps of Henon and of logistic growth."""

import gc
import os
import signal
import threading

import numpy as np
import orbid
import pytest

# r' = mu r - r^3, theta' = w: radius sqrt(mu), period 2 pi / w, multiplier exp(-2 mu T).
HOPF = orbid.equations({"equations": {"x": "mu * x - w * y - x * (x^2 + y^2)", "y": "mu * y + w * x - y * (x^2 + y^2)"},
                        "parameters": {"mu": 0.25, "w": 2.0}})
HENON = orbid.model("henon")
FIXED = (-(1 - 0.3) + np.sqrt((1 - 0.3) ** 2 + 4 * 1.4)) / (2 * 1.4)


@pytest.mark.parametrize("method, accuracy", [("multiple_shooting", 1e-9), ("collocation", 1e-8),
                                              ("finite_difference", 2e-3)])
def test_circle_of_hopf(method, accuracy):
    orbit = orbid.periodic_orbit(HOPF, [0.52, 0.0], 3.0, method=method, sensitivities=["mu", "w"],
                                 maximum_distance=1.0)
    assert orbit.converged and orbit.status == "converged", orbit.status
    assert abs(orbit.time - np.pi) < accuracy
    np.testing.assert_allclose(np.hypot(*orbit.points.T), 0.5, rtol=0, atol=accuracy)
    np.testing.assert_allclose(orbit.multipliers, [np.exp(-0.5 * np.pi)], rtol=0, atol=accuracy)
    assert abs(orbit.trivial_multiplier - 1.0) < 10 * accuracy
    # T = 2 pi / w does not know mu; its derivative by w is -2 pi / w^2.
    np.testing.assert_allclose(orbit.time_sensitivities, [0.0, -np.pi / 2], rtol=0, atol=10 * accuracy)
    # The radius sqrt(mu): d|x|/d mu = 1 / (2 sqrt(mu)) = 1 at every point.
    assert orbit.sensitivities.shape == (len(orbit.points), 2, 2)
    along = np.einsum("pi,pi->p", orbit.points / 0.5, orbit.sensitivities[:, :, 0])
    np.testing.assert_allclose(along, 1.0, rtol=0, atol=10 * accuracy)


def test_stability_of_the_circle():
    orbit = orbid.periodic_orbit(HOPF, [0.52, 0.0], 3.0, sensitivities=["mu", "w"], maximum_distance=1.0)
    stability = orbid.stability(HOPF, orbit, sensitivities=["mu", "w"])
    assert stability.simulated and stability.unstable == 0 and stability.nearest == "none"
    # ln|multiplier| = -2 mu T: by mu -2 T, by w 4 pi mu / w^2.
    np.testing.assert_allclose(stability.ln_multiplier_sensitivities, [[-2 * np.pi, np.pi / 4]], rtol=0, atol=1e-7)
    with pytest.raises(ValueError):
        orbid.stability(HOPF, orbid.periodic_orbit(HOPF, [0.52, 0.0], 3.0), sensitivities=["mu"])


def test_fixed_point_of_henon():
    orbit = orbid.periodic_orbit(HENON, [0.6, 0.2], 1, sensitivities="a")
    assert orbit.converged and orbit.period == 1
    np.testing.assert_allclose(orbit.points, [[FIXED, 0.3 * FIXED]], rtol=0, atol=1e-12)
    jacobian = np.array([[-2.8 * FIXED, 1.0], [0.3, 0.0]])
    np.testing.assert_allclose(orbit.jacobians[0], jacobian, rtol=1e-11)
    expected = np.linalg.eigvals(jacobian)
    np.testing.assert_allclose(orbit.multipliers.real, expected[np.argsort(-abs(expected))], rtol=1e-11)
    # a x^2 + (1 - b) x - 1 = 0: dx/da = -x^2 / (2 a x + 1 - b).
    np.testing.assert_allclose(orbit.sensitivities[0, 0, 0], -FIXED**2 / (2.8 * FIXED + 0.7), rtol=1e-11)


def test_all_short_orbits_of_henon():
    found = orbid.find_orbits(HENON, [1, 2, 4], points=5000, trajectories=8)
    assert not found.interrupted and found.starts > 0
    assert set(found.settled) == {1, 2, 4}
    periods = [entry.orbit.period for entry in found.orbits]
    # Both fixed points, and the one orbit each of periods 2 and 4.
    assert periods.count(1) in (1, 2) and periods.count(2) == 1 and periods.count(4) == 1
    assert any(abs(entry.orbit.points[0, 0] - FIXED) < 1e-9 for entry in found.orbits)
    assert all(entry.orbit.converged and entry.hits >= 1 for entry in found.orbits)


def test_found_orbits_are_looked_at_where_they_are():
    found = orbid.find_orbits(HENON, [1, 2], points=1 << 12)
    entry = found.orbits[0]
    assert found.orbits[0] is entry and entry.orbit is entry.orbit
    points, multipliers = entry.orbit.points, entry.orbit.multipliers
    kept = points.copy(), multipliers.copy()
    assert not points.flags.writeable and not multipliers.flags.writeable
    assert np.shares_memory(points, found.orbits[0].orbit.points)
    del found, entry
    gc.collect()
    orbid.find_orbits(HENON, [1, 2], points=1 << 12)
    assert np.array_equal(points, kept[0]) and np.array_equal(multipliers, kept[1])


def test_doublings_of_logistic_growth():
    logistic = orbid.model("logistic")
    diagram = orbid.follow_branches(logistic, [0.6], "r", 2.5, 3.5, parameters={"r": 2.6}, maximum_period=2)
    assert diagram.start_status == "converged"
    first = diagram.branches[0]
    assert first.values.min() == pytest.approx(2.5, abs=1e-12) and first.values.max() == pytest.approx(3.5, abs=1e-12)
    for point in first.points:
        assert abs(point.orbit.points[0, 0] - (1 - 1 / point.parameter)) < 1e-9
    doubling = [point for point in first.points if point.bifurcation == "period_doubling"]
    assert len(doubling) == 1 and abs(doubling[0].parameter - 3.0) < 1e-9
    second = diagram.branches[1]
    assert second.origin is not None and second.origin[0] == 0
    again = [point.parameter for point in second.points if point.bifurcation == "period_doubling"]
    assert any(abs(parameter - (1 + np.sqrt(6))) < 1e-9 for parameter in again)


def test_search_stopped_by_ctrl_c():
    lorenz = orbid.model("lorenz")
    timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    found = orbid.find_orbits(lorenz, list(range(1, 15)), section={"coordinate": "z", "value": 27.0, "direction": -1},
                              points=1 << 18)
    assert found.interrupted


def test_no_convergence_is_a_status():
    orbit = orbid.periodic_orbit(HENON, [50.0, -50.0], 1, maximum_iterations=1)
    assert not orbit.converged and orbit.status != ""


@pytest.mark.parametrize("call, error, match", [
    (lambda: orbid.periodic_orbit(HOPF, [0.5, 0.0]), ValueError, "period: None"),
    (lambda: orbid.periodic_orbit(HOPF, [0.5, 0.0], -1.0), ValueError, ""),
    (lambda: orbid.periodic_orbit(HENON, [0.5, 0.0], 1.5), ValueError, "whole number"),
    (lambda: orbid.periodic_orbit(HENON, [[0.5, 0.0]] * 3, 2), ValueError, "3 points"),
    (lambda: orbid.periodic_orbit(HENON, [0.5, np.nan]), ValueError, r"guess\[0, 1\] = nan"),
    (lambda: orbid.periodic_orbit(HENON, [0.5, 0.0], method="shooting"), ValueError, "did you mean 'multiple_shooting'"),
    (lambda: orbid.periodic_orbit(HENON, [0.5, 0.0], nodes=5), ValueError, "nodes"),
    (lambda: orbid.periodic_orbit(HENON, [0.5, 0.0], method="collocation"), ValueError, ""),
    (lambda: orbid.periodic_orbit(None, [0.5, 0.0]), TypeError, ""),
    (lambda: orbid.periodic_orbit(HENON, [0.5, 0.0], section={"coordinate": "x", "value": 0}), ValueError, "section"),
    (lambda: orbid.find_orbits(HENON, []), ValueError, ""),
    (lambda: orbid.find_orbits(HENON, [0]), ValueError, ""),
    (lambda: orbid.find_orbits(HOPF, [1]), ValueError, ""),
    (lambda: orbid.follow_branches(HENON, [0.6, 0.2], "c", 0, 1), KeyError, "no parameter 'c'"),
    (lambda: orbid.follow_branches(HENON, [0.6, 0.2], "a", 2.0, 1.0), ValueError, ""),
])
def test_wrong_calls(call, error, match):
    with pytest.raises(error, match=match):
        call()
