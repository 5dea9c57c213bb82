"""Identification without a job: arrays in, an estimate out."""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, Sequence, Union

import numpy as np
import numpy.typing as npt

from . import _orbid
from ._orbid import Identification, Series, System

Columns = Mapping[str, npt.ArrayLike]
Record = Union[Series, Columns]


def _series(model: System, record: Record, sampling: str, phase: float) -> Series:
    """A record as a Series: of columns, those of coordinates, "t" and "segment", and the sds "NAME_sd"."""
    if isinstance(record, Series):
        return record
    coordinates = [one for one in model.coordinates if one.name in record]
    known = {one.name for one in coordinates} | {"t", "segment"}
    unknown = set(record) - known - {f"{one.name}_sd" for one in coordinates}
    if unknown or not coordinates:
        raise ValueError(f"records: columns {sorted(unknown)}: known are t, segment and the coordinates of the model, "
                         f"{[one.name for one in model.coordinates]}, each with NAME_sd")
    columns = {name: _orbid._numbers(values, f"records: {name}") for name, values in record.items()
               if name != "segment"}
    sizes = {name: values.shape for name, values in columns.items()}
    if len(set(sizes.values())) != 1 or len(next(iter(sizes.values()))) != 1:
        raise ValueError(f"records: columns of shapes {sizes}: all need one, (records,)")
    values = np.column_stack([columns[one.name] for one in coordinates])
    sds = np.column_stack([columns.get(f"{one.name}_sd", np.full(len(values), np.nan)) for one in coordinates])
    has_sds = any(name.endswith("_sd") for name in columns)
    labels = np.asarray(record["segment"]) if "segment" in record else np.zeros(len(values), dtype=int)
    if labels.shape != (len(values),):
        raise ValueError(f"records: segment: shape {labels.shape}, needs {(len(values),)}")
    cuts = np.flatnonzero(labels[1:] != labels[:-1]) + 1
    options: Dict[str, Any] = {"sampling": sampling or ("samples" if "t" in columns else "section"), "phase": phase,
                               "labels": [str(labels[k]) for k in (0, *cuts)]}
    if "t" in columns:
        options["times"] = np.split(columns["t"], cuts)
    if has_sds:
        options["deviations"] = np.split(sds, cuts)
    return Series(np.split(values, cuts), [{"name": one.name, "unit": one.unit, "angle": one.angle}
                                           for one in coordinates], **options)


def identify(model: System, records: Union[Record, Sequence[Union[Record, Mapping[str, Any]]]],
             parameters: Mapping[str, Union[float, Mapping[str, Any]]], *, sampling: str = "", sensor: Any = None,
             phase: float = 0.0, observe: Union[None, str, Sequence[str]] = None, **options: Any) -> Identification:
    """Parameters of a model from records of its motion, by stages that need no good first guess.

    model       a System, see model() and equations().
    records     a Series, or a dict of columns, {"t": array, "phi": array}, by the model's coordinates: radians,
                seconds, SI; nan is a missing reading. "segment" holds labels, "phi_sd" known sds. A list of several: each a
                Series, columns, or a dict with "record" and, as in a job, name, sensor, observe, parameters, free,
                initial_state; fit and predict (labels of segments), simulated (True: by this very model).
    parameters  dict from names to starts, or to dicts with start, bounds, scale, prior, tied. The others keep `values`.
    sampling    of columns: "samples" (the default with "t") or "section"; phase [rad] of the section.
    sensor      of all records that have none of their own, as in a job; None: the state. observe: likewise.

    And with the names and defaults of a job:

    values          dict or array: all parameters of the model.
    strategy        "auto", or a list of "prediction", "cycles", "harvest", "series", "waveform"; a list within the list
                    is estimated from together; last {"if_needed": [...]}, for where the series is not explained.
    residuals       list of dicts with type "cycles", "series" or "waveform", and their keys (docs/job_reference.md);
                    known_sds=True: readings err by their sds.
    cycles, search  what find_cycles() found in the section record, and the options it was called with.
    section         {"coordinate": "z", "value": 27, "direction": 1}: the plane of these cycles' points, autonomous models.
                    Residuals of cycles then take the times in which they close, unless "times" is False.
    derived         dict from names to formulas of parameters.
    joint_priors, variance, scan, seed (1), step_tolerance (1e-3), starts (1), start_seed.
    progress        called as progress(step, share, note), share in [0, 1] or None.

    The result is an Estimate with .stages, .cycles, .matching and .structure; the same job gives the same bytes.
    Ctrl-C: the best estimate so far, status "interrupted". ValueError, TypeError and KeyError name what is wrong.
    """
    several = [records] if isinstance(records, (Series, Mapping)) else list(records)
    experiments: List[Dict[str, Any]] = []
    for one in several:
        experiment: Dict[str, Any] = {"record": one}
        if isinstance(one, Mapping) and "record" in one:
            experiment = {**one}
        experiment["record"] = _series(model, experiment["record"], sampling, phase)
        experiment.setdefault("sensor", sensor)
        experiment.setdefault("observe", observe)
        experiments.append(experiment)
    return _orbid.identify(model, experiments, parameters, **options)
