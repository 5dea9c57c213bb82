"""Models written as text: the keys of "model" in a job (docs/equations.md)."""

from __future__ import annotations

import difflib
import numbers
from typing import Any, Iterable, Mapping

from . import _orbid

_KEYS = ("name", "equations", "parameters", "kind", "definitions", "units", "coordinates", "forcing_phase",
         "angles", "switching", "inputs", "symmetry", "stiff")
_PARAMETER_KEYS = ("value", "unit", "domain", "typical", "description")


def _pointer(*parts: str) -> str:
    return "".join("/" + part.replace("~", "~0").replace("/", "~1") for part in parts)


def _check_keys(given: Iterable[str], known: Iterable[str], pointer: str) -> None:
    names = list(known)
    for key in given:
        if key not in names:
            nearest = difflib.get_close_matches(str(key), names, 1)
            hint = f'did you mean "{nearest[0]}"?' if nearest else "known are " + ", ".join(names)
            raise KeyError(f"{pointer}/{key}: unknown key: {hint}")


def _text(value: Any, *pointer: str) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{_pointer(*pointer)}: must be text, not {type(value).__name__}")
    return value


def _number(value: Any, *pointer: str) -> float:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise TypeError(f"{_pointer(*pointer)}: must be a number, not {type(value).__name__}")
    return float(value)


def _mapping(value: Any, *pointer: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise TypeError(f"{_pointer(*pointer)}: must be a dict, not {type(value).__name__}")
    return value


def _known_coordinate(name: str, coordinates: list[str], pointer: str) -> str:
    if name not in coordinates:
        raise ValueError(f'{pointer}: "{name}" is no coordinate; there are ' + ", ".join(coordinates))
    return name


def _add_parameters(text: _orbid.EquationText, parameters: Mapping[str, Any]) -> None:
    for name, given in parameters.items():
        keys = dict(given) if isinstance(given, Mapping) else {"value": given}
        _check_keys(keys, _PARAMETER_KEYS, _pointer("parameters", name))
        domain = _text(keys.get("domain", "any"), "parameters", name, "domain")
        if domain not in ("any", "positive", "nonnegative"):
            raise ValueError(f"{_pointer('parameters', name, 'domain')}: must be any, positive or nonnegative")
        typical = keys.get("typical")
        text.add_parameter(name, _text(keys.get("unit", "1"), "parameters", name, "unit"), domain,
                           _number(keys.get("value", 0.0), "parameters", name, "value"),
                           None if typical is None else _number(typical, "parameters", name, "typical"),
                           _text(keys.get("description", ""), "parameters", name, "description"))


def _set_symmetry(text: _orbid.EquationText, symmetry: Mapping[str, Any], coordinates: list[str]) -> None:
    _check_keys(symmetry, ("signs", "phase_shift"), "/symmetry")
    signs = dict.fromkeys(coordinates, 1.0)
    for name, sign in _mapping(symmetry.get("signs", {}), "symmetry", "signs").items():
        signs[_known_coordinate(name, coordinates, "/symmetry/signs")] = _number(sign, "symmetry", "signs", name)
    text.set_symmetry(list(signs.values()), _number(symmetry.get("phase_shift", 0.0), "symmetry", "phase_shift"))


def _set_forcing(text: _orbid.EquationText, forcing: Any) -> None:
    if isinstance(forcing, str):
        forcing = {"frequency": forcing}
    _check_keys(_mapping(forcing, "forcing_phase"), ("name", "frequency"), "/forcing_phase")
    text.set_forcing(_text(forcing.get("name", "phase"), "forcing_phase", "name"),
                     _text(forcing.get("frequency", ""), "forcing_phase", "frequency"))


def _refusal(problems: Iterable[tuple[str, int, int | None, str]], names: Mapping[str, list[str]]) -> ValueError:
    """All problems of a text, each with its place."""
    lines = []
    for key, index, character, rule in problems:
        of = names.get(key, [])
        place = _pointer(key, of[index]) if index < len(of) else _pointer(key) if key else ""
        where = "" if character is None else f", character {character + 1}"
        lines.append(f"{place}{where}: {rule}" if place else rule)
    return ValueError("\n".join(lines))


def equations(model: Mapping[str, Any]) -> _orbid.System:
    """A model from its equations, with the keys of "model" in a job.

    >>> oscillator = equations({"equations": {"x": "v", "v": "-k * x"}, "parameters": {"k": 4.0}})

    Interpreted: no compiler is needed. Raises ValueError naming each problem with its place.
    """
    model = _mapping(model)
    _check_keys(model, _KEYS, "")
    formulas = _mapping(model.get("equations", {}), "equations")
    order = list(model.get("coordinates", formulas))
    if sorted(order) != sorted(formulas):
        raise ValueError('/coordinates: must list every name of "equations" once: the order of the state')
    units = _mapping(model.get("units", {}), "units")
    angles = list(model.get("angles", ()))
    for key, names in (("units", units), ("angles", angles)):
        for name in names:
            _known_coordinate(name, order, _pointer(key))
    kind = model.get("kind", "flow")
    if kind not in ("flow", "map"):
        raise ValueError("/kind: must be flow or map")

    text = _orbid.EquationText()
    text.name = _text(model.get("name", "equations"), "name")
    text.map = kind == "map"
    text.stiff = bool(model.get("stiff", False))
    for name in order:
        unit = _text(units.get(name, "rad" if name in angles else "1"), "units", name)
        if name in angles and unit != "rad":
            raise ValueError(f"{_pointer('units', name)}: an angle is in rad, not in {unit}")
        text.add_coordinate(name, _text(formulas[name], "equations", name), unit, name in angles)
    definitions = _mapping(model.get("definitions", {}), "definitions")
    for name, formula in definitions.items():
        text.add_definition(name, _text(formula, "definitions", name))
    parameters = _mapping(model.get("parameters", {}), "parameters")
    _add_parameters(text, parameters)
    if model.get("forcing_phase") is not None:
        _set_forcing(text, model["forcing_phase"])
    if "switching" in model:
        text.switching = [_text(item, "switching") for item in model["switching"]]
    inputs = _mapping(model.get("inputs", {}), "inputs")
    for name, unit in inputs.items():
        text.add_input(name, _text(unit, "inputs", name))
    if "symmetry" in model:
        _set_symmetry(text, _mapping(model["symmetry"], "symmetry"), order)

    system, problems = _orbid.system_from_text(text)
    if system is None:
        raise _refusal(problems, {"equations": order, "definitions": list(definitions),
                                  "parameters": list(parameters), "inputs": list(inputs)})
    return system
