"""Models by name, their tables and parameters."""

import numpy as np
import orbid
import pytest


def test_models_are_listed():
    names = [entry["name"] for entry in orbid.models()]
    assert names == sorted(names)
    assert {"lorenz", "henon", "parametric_pendulum"} <= set(names)
    lorenz96 = next(entry for entry in orbid.models() if entry["name"] == "lorenz96")
    assert lorenz96["size"] > 0 and "x" in lorenz96["equations"]


def test_tables_of_lorenz():
    lorenz = orbid.model("lorenz")
    assert (lorenz.name, lorenz.kind, lorenz.dimension, lorenz.variant) == ("lorenz", "autonomous", 3, "")
    assert [row.name for row in lorenz.coordinates] == ["x", "y", "z"]
    assert [(row.name, row.domain, row.default) for row in lorenz.parameters] == [
        ("sigma", "> 0", 10.0), ("rho", ">= 0", 28.0), ("beta", "> 0", 8.0 / 3.0)]
    assert lorenz.symmetry == ([-1.0, -1.0, 1.0], 0.0)
    assert repr(lorenz) == "System(lorenz, autonomous, 3 coordinates)"


def test_variants_and_sizes():
    pendulum = orbid.model("parametric_pendulum", variant="harmonic")
    assert pendulum.variant == "harmonic" and pendulum.kind == "forced"
    assert [row.angle for row in pendulum.coordinates] == [True, False]
    assert orbid.model("lorenz96", size=12).dimension == 12
    with pytest.raises(ValueError, match="crank"):
        orbid.model("parametric_pendulum", variant="none_such")
    with pytest.raises(ValueError, match="size"):
        orbid.model("lorenz", size=5)
    with pytest.raises(ValueError, match="henon"):
        orbid.model("hennon")
    with pytest.raises(TypeError):
        orbid.model(None)


def test_period_of_the_forcing():
    pendulum = orbid.model("parametric_pendulum")
    assert pendulum.period({"omega": 4.0}) == 2.0 * np.pi / 4.0
    assert pendulum.period({"omega": 4.0}, clock="phase") == 2.0 * np.pi
    with pytest.raises(ValueError):
        orbid.model("lorenz").period()


def test_parameters_by_name_and_as_array():
    lorenz = orbid.model("lorenz")
    assert lorenz.values().tolist() == [10.0, 28.0, 8.0 / 3.0]
    assert lorenz.values({"rho": 20}).tolist() == [10.0, 20.0, 8.0 / 3.0]
    assert lorenz.values([1.0, 2.0, 3.0]).tolist() == [1.0, 2.0, 3.0]


def test_wrong_parameters():
    lorenz = orbid.model("lorenz")
    with pytest.raises(KeyError, match="no parameter 'sigmaa': did you mean 'sigma'"):
        lorenz.values({"sigmaa": 1.0})
    with pytest.raises(KeyError, match="there is 'sigma', 'rho', 'beta'"):
        lorenz.values({"q": 1.0})
    with pytest.raises(ValueError, match=r"parameters\['sigma'\] = -1.0+: must be > 0"):
        lorenz.values({"sigma": -1.0})
    with pytest.raises(ValueError, match=r"parameters\['sigma'\]\[0\] = nan"):
        lorenz.values({"sigma": float("nan")})
    with pytest.raises(ValueError, match="parameters: 2 entries, needs 3"):
        lorenz.values([1.0, 2.0])
    with pytest.raises(TypeError):
        lorenz.values({"sigma": None})
    with pytest.raises(TypeError):
        lorenz.values({1: 2.0})
    with pytest.raises(TypeError):
        lorenz.values("sigma")
