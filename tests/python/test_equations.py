"""Models written as text, with the keys of a job."""

import numpy as np
import orbid
import pytest

DUFFING = {
    "name": "shaken_oscillator",
    "equations": {"x": "v", "v": "-delta * v - spring + gamma * cos(tau)"},
    "definitions": {"spring": "alpha * x + beta * x^3"},
    "units": {"x": "m", "v": "m/s"},
    "parameters": {"delta": {"value": 0.3, "unit": "1/s", "domain": "nonnegative"}, "alpha": -1.0, "beta": 1.0,
                   "gamma": 0.5, "omega": 1.2},
    "forcing_phase": {"name": "tau", "frequency": "omega"},
    "symmetry": {"signs": {"x": -1, "v": -1}, "phase_shift": np.pi},
}


def test_text_is_the_model_of_the_registry():
    text = orbid.equations(DUFFING)
    registry = orbid.model("duffing")
    assert text.name == "shaken_oscillator" and text.kind == "forced"
    assert [(row.name, row.unit) for row in text.coordinates] == [("x", "m"), ("v", "m/s")]
    assert text.symmetry == ([-1.0, -1.0], np.pi)
    names = {row.name for row in registry.parameters}
    shared = {"delta": 0.3, "alpha": -1.0, "beta": 1.0, "gamma": 0.5, "omega": 1.2}
    assert set(shared) == names
    x = [[0.3, -0.2], [1.1, 0.4]]
    np.testing.assert_allclose(text.rhs(x, shared, phase=[0.1, 2.0]), registry.rhs(x, shared, phase=[0.1, 2.0]),
                               rtol=1e-14)


def test_maps_angles_order_and_switching():
    standard = orbid.equations({"kind": "map", "equations": {"p": "p + K * sin(q)", "q": "q + p + K * sin(q)"},
                                "coordinates": ["q", "p"], "angles": ["q"], "parameters": {"K": 0.9}})
    assert standard.kind == "map"
    assert [(row.name, row.unit, row.angle) for row in standard.coordinates] == [("q", "rad", True), ("p", "1", False)]
    smooth = orbid.equations({"equations": {"x": "v", "v": "-x - k * v * abs(v)"}, "parameters": {"k": 0.1},
                              "switching": []})
    assert smooth.flow([1.0, 0.0], [1.0]).ok


@pytest.mark.parametrize("change, error, match", [
    ({"equations": {"x": "v", "v": "-delta * q"}}, ValueError, "/equations/v, character 10: .*q"),
    ({"definitions": {"spring": "alpha * ("}}, ValueError, "/definitions/spring"),
    ({"parameters": {"delta": "0.3"}}, TypeError, "/parameters/delta/value"),
    ({"parameters": {"delta": {"value": 0.3, "units": "1"}}}, KeyError, "did you mean \"unit\""),
    ({"parameters": {"delta": {"domain": "real"}}}, ValueError, "/parameters/delta/domain"),
    ({"equation": {}}, KeyError, "did you mean \"equations\""),
    ({"kind": "flows"}, ValueError, "/kind"),
    ({"angles": ["y"]}, ValueError, "/angles: \"y\" is no coordinate"),
    ({"angles": ["x"]}, ValueError, "an angle is in rad"),
    ({"coordinates": ["x"]}, ValueError, "/coordinates"),
    ({"symmetry": {"signs": {"y": 1}}}, ValueError, "/symmetry/signs"),
    ({"forcing_phase": {"name": "tau", "frequency": "w"}}, ValueError, "/forcing_phase"),
    ({"equations": "x' = v"}, TypeError, "/equations"),
])
def test_problems_are_named_with_their_place(change, error, match):
    with pytest.raises(error, match=match):
        orbid.equations({**DUFFING, **change})
    with pytest.raises(TypeError):
        orbid.equations(None)
