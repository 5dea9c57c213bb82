"""Flows and sections against closed forms of the harmonic oscillator x'' = -k x."""

import numpy as np
import orbid
import pytest

OSCILLATOR = orbid.equations({"equations": {"x": "v", "v": "-k * x"},
                              "parameters": {"k": {"value": 1.0, "domain": "positive"}}})
# Steps of the tolerance 1e-12 over a few radians: measured below 4e-12, bound ten times that.
NEAR = {"rtol": 0, "atol": 4e-11}


def test_flow_of_the_oscillator():
    t = np.linspace(0.0, 6.0, 13)
    flow = OSCILLATOR.flow([1.0, 0.0], t, {"k": 4.0})
    assert flow.ok and flow.status == "ok" and flow.steps > 0
    np.testing.assert_allclose(flow.states, np.column_stack([np.cos(2 * t), -2 * np.sin(2 * t)]), **NEAR)
    assert flow.sensitivities.shape == (13, 2, 0) and flow.directions == []
    assert flow.stopped_after == 6.0
    np.testing.assert_array_equal(flow.stopped_state, flow.states[-1])


def test_one_duration_is_one_row():
    assert OSCILLATOR.flow([1, 0], 1).states.shape == (1, 2)


def test_sensitivities_of_the_oscillator():
    t = np.array([0.5, 3.0])
    flow = OSCILLATOR.flow([1.0, 0.0], t, sensitivities=["k"])
    assert flow.directions == ["x", "v", "k"]
    assert flow.sensitivities.shape == (2, 2, 3)
    for k, (c, s) in enumerate(zip(np.cos(t), np.sin(t))):
        # x = cos(w t), v = -w sin(w t), dw/dk = 1 / 2 at w = 1.
        by_k = np.array([-t[k] * s / 2, -(s + t[k] * c) / 2])
        np.testing.assert_allclose(flow.sensitivities[k], np.column_stack([[c, -s], [s, c], by_k]), **NEAR)
    # True: all parameters; an empty list: the start alone.
    assert OSCILLATOR.flow([1.0, 0.0], t, sensitivities=True).sensitivities.tobytes() == flow.sensitivities.tobytes()
    assert OSCILLATOR.flow([1.0, 0.0], t, sensitivities=[]).sensitivities.shape == (2, 2, 2)
    section = {"coordinate": "x", "value": 0.0}
    assert OSCILLATOR.crossings([1.0, 0.0], section, 2, sensitivities=True).directions == ["x", "v", "k"]
    assert OSCILLATOR.crossings([1.0, 0.0], section, 2, sensitivities=[]).directions == ["x", "v"]


def test_right_hand_side_and_derivatives():
    assert OSCILLATOR.rhs([2.0, 3.0], {"k": 4.0}).tolist() == [3.0, -8.0]
    assert OSCILLATOR.rhs([[2.0, 3.0]], {"k": 4.0}).tolist() == [[3.0, -8.0]]
    by_all = OSCILLATOR.rhs_derivatives([2.0, 3.0], {"k": 4.0}, sensitivities="k")
    assert by_all.tolist() == [[0.0, 1.0, 0.0], [-4.0, 0.0, -2.0]]


def test_crossings_of_the_oscillator():
    section = {"coordinate": "x", "value": 0.0, "direction": 1}
    found = OSCILLATOR.crossings([1.0, 0.0], section, 3, sensitivities=["k"])
    turns = np.pi * np.array([1.5, 3.5, 5.5])
    assert found.status == "ok"
    np.testing.assert_allclose(found.times, turns, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.states, [[0.0, 1.0]] * 3, rtol=0, atol=1e-10)
    assert found.directions == ["x", "v", "k"]
    # t = (..) pi / w: dt/dk = -t / 2 at w = 1.
    np.testing.assert_allclose(found.time_sensitivities[:, 2], -turns / 2, rtol=0, atol=1e-9)
    assert found.sensitivities.shape == (3, 2, 3)
    same = OSCILLATOR.crossings([1.0, 0.0], {"normal": [1.0, 0.0], "offset": 0.0}, 3)
    np.testing.assert_array_equal(same.times, found.times)
    lost = OSCILLATOR.crossings([1.0, 0.0], {"coordinate": "x", "value": 2.0}, 1, longest=50.0)
    assert lost.status != "ok" and lost.states.shape == (0, 2)


def test_ensembles():
    ensemble = OSCILLATOR.ensemble([[1.0, 0.0], [2.0, 0.0]], 2, section={"coordinate": "x", "value": 0.0})
    assert ensemble.status == ["ok", "ok"] and len(ensemble.times) == 2
    np.testing.assert_allclose(ensemble.sections[1], [[2.0, 0.0], [0.0, 2.0], [0.0, 2.0]], rtol=0, atol=1e-10)
    henon = orbid.model("henon")
    iterates = henon.ensemble([[0.1, 0.2]], 3).sections[0]
    x = np.array([0.1, 0.2])
    for row in iterates[1:]:
        x = np.array([1.0 - 1.4 * x[0] ** 2 + x[1], 0.3 * x[0]])
        np.testing.assert_allclose(row, x, rtol=0, atol=1e-14)
    with pytest.raises(ValueError, match="autonomous model needs one"):
        OSCILLATOR.ensemble([[1.0, 0.0]], 2)
    with pytest.raises(ValueError, match="of autonomous models"):
        henon.ensemble([[0.1, 0.2]], 2, section={"coordinate": "x", "value": 0.0})


def test_readings():
    states = np.array([[0.1, 1.0], [0.2, 2.0]])
    plain, nothing = OSCILLATOR.readings({"type": "state"}, states)
    assert np.array_equal(plain, states) and nothing.shape == (2, 2, 0)
    squared, derivatives = OSCILLATOR.readings({"type": "function", "readings": {"x": "k * x^2"}}, states, {"k": 3.0},
                                               sensitivities=["k"])
    np.testing.assert_allclose(squared[:, 0], 3.0 * states[:, 0] ** 2, rtol=1e-15)
    np.testing.assert_allclose(derivatives[1], [[6.0 * 0.2, 0.0, 0.04], [0.0, 1.0, 0.0]], rtol=1e-15)
    pendulum = orbid.model("free_pendulum")
    names = [row.name for row in pendulum.coordinates]
    encoder = {"type": "angle_difference", "angle": names[0], "rate": names[1], "delay": 1e-3}
    read, _ = pendulum.readings(encoder, [[0.3, 0.5]])
    moved = pendulum.flow([0.3, 0.5], 1e-3).states[0, 0]
    plain, _ = pendulum.readings({"type": "state"}, [[0.3, 0.5]])
    assert read[0, 0] == plain[0, 0]
    # A difference of 5e-4 rad by flows of the tolerance 1e-12 over 1e-3 s.
    assert abs(read[0, 1] - (moved - 0.3) / 1e-3) < 1e-8
    for wrong in ({"type": "state", "angle": names[1]}, {**encoder, "rate": names[0]}, {**encoder, "delay": 0.0},
                  {**encoder, "rounding": "nearest"}, {**encoder, "type": "angel"}):
        with pytest.raises(ValueError, match="sensor"):
            pendulum.readings(wrong, [[0.3, 0.5]])
    with pytest.raises(TypeError, match="did you mean 'delay'"):
        pendulum.readings({**encoder, "dellay": 1.0}, [[0.3, 0.5]])
    with pytest.raises(ValueError):
        OSCILLATOR.readings({"type": "function", "readings": {"x": "q * x"}}, states)


def test_measured_inputs():
    driven = orbid.equations({"equations": {"x": "k * u"}, "parameters": {"k": 2.0}, "inputs": {"u": "1"}})
    assert [row.name for row in driven.inputs] == ["u"]
    with pytest.raises(ValueError):
        driven.flow([0.0], [1.0])
    ramp = driven.with_input([0.0, 10.0], [0.0, 10.0])
    # x = t^2
    np.testing.assert_allclose(ramp.flow([0.0], [1.0, 3.0]).states[:, 0], [1.0, 9.0], rtol=0, atol=1e-10)
    assert not ramp.flow([0.0], [11.0]).ok
    with pytest.raises(ValueError, match="needs one for each of 2 times"):
        driven.with_input([0.0, 1.0], [[0.0], [1.0], [2.0]])


def test_unlucky_numbers_are_a_status():
    explosion = orbid.equations({"equations": {"x": "k * x^2"}, "parameters": {"k": 1.0}})
    flow = explosion.flow([1.0], [0.5, 2.0])  # x = 1 / (1 - t)
    assert not flow.ok and flow.status != ""
    assert 0.5 < flow.stopped_after < 1.01


@pytest.mark.parametrize("call, error, match", [
    (lambda: OSCILLATOR.flow([1.0], [1.0]), ValueError, "x0: 1 entries, needs 2"),
    (lambda: OSCILLATOR.flow([[1.0, 0.0]], [1.0]), ValueError, "x0: shape"),
    (lambda: OSCILLATOR.flow([1.0, np.nan], [1.0]), ValueError, r"x0\[1\] = nan"),
    (lambda: OSCILLATOR.flow([1.0, 0.0], [2.0, 1.0]), ValueError, "ascend"),
    (lambda: OSCILLATOR.flow([1.0, 0.0], [-1.0]), ValueError, ""),
    (lambda: OSCILLATOR.flow([1.0, 0.0], None), TypeError, "t: None"),
    (lambda: OSCILLATOR.flow([1.0, 0.0], [1.0], rtol=0.0), ValueError, "tolerance"),
    (lambda: OSCILLATOR.flow([1.0, 0.0], [1.0], maximum_steps=-1), TypeError, ""),
    (lambda: OSCILLATOR.flow([1.0, 0.0], [1.0], clock="phase"), ValueError, "forced"),
    (lambda: OSCILLATOR.flow([1.0, 0.0], [1.0], clock="tine"), ValueError, "did you mean 'time'"),
    (lambda: OSCILLATOR.flow([1.0, 0.0], [1.0], sensitivities=["kk"]), KeyError, "did you mean 'k'"),
    (lambda: OSCILLATOR.flow([1.0, 0.0], [1.0], sensitivities=[1]), TypeError, "names"),
    (lambda: OSCILLATOR.flow([1.0, 0.0], [1.0], sensitivities=["k", "k"]), ValueError, ""),
    (lambda: OSCILLATOR.crossings([1.0, 0.0], None, 1), TypeError, "section"),
    (lambda: OSCILLATOR.crossings([1.0, 0.0], {"coordinate": "y", "value": 1}, 1), KeyError, "no coordinate"),
    (lambda: OSCILLATOR.crossings([1.0, 0.0], {"coordinate": "x"}, 1), TypeError, "value"),
    (lambda: OSCILLATOR.crossings([1.0, 0.0], {"coordinate": 3, "value": 0}, 1), TypeError, "coordinate"),
    (lambda: OSCILLATOR.crossings([1.0, 0.0], {"coordinate": "x", "valu": 0}, 1), TypeError, "value"),
    (lambda: OSCILLATOR.crossings([1.0, 0.0], {"coordinate": "x", "value": 0, "direction": 2}, 1), ValueError,
     "1 or -1"),
    (lambda: OSCILLATOR.rhs([1.0, 0.0], phase=[0.0, 1.0]), ValueError, "phase: 2 entries"),
])
def test_wrong_calls(call, error, match):
    with pytest.raises(error, match=match):
        call()
