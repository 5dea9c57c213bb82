"""Errors of a plain function: the short way to an estimate of one's own model."""

from __future__ import annotations

from typing import Any, Callable, Dict, List, Optional, Sequence, Union

import numpy as np
import numpy.typing as npt

from ._orbid import Residual, _finite_vector, _numbers

Array = npt.NDArray[np.float64]
Function = Callable[[Array], npt.ArrayLike]

# Relative steps of differences. The error of a derivative is truncation, which grows with the step (its square for
# central differences), and rounding, which falls like 1 / step: least where both are equal.
_STEPS = {"2-point": float(np.finfo(float).eps ** (1 / 2)), "3-point": float(np.finfo(float).eps ** (1 / 3))}


class LeastSquares(Residual):
    """Readings y against prediction(theta): e = y - prediction(theta), one block without latent states.

    y           readings, shape (records,).
    prediction  function of theta, shape (parameters,), that returns shape (records,). Entries that are not finite mean:
                cannot be evaluated there.
    jacobian    function of theta that returns d prediction / d theta, shape (records, parameters); or, by name, finite
                differences of `prediction`: "2-point", with relative errors of about 1e-8 (1 evaluation per parameter),
                or "3-point", of about 1e-10 (2 evaluations). Sds and the last digits of an estimate are as good as
                its derivatives. Steps are relative to each parameter; to 1 where it is 0.
    name, unit  of the readings.
    deviations  known sd of every reading, shape (records,): the estimated scale is then a factor on them.
    groups      the group of every reading, shape (records,), when `errors` is a list of several.
    errors      as "errors" of a job: distribution, sd, dof, relative, correlation, floor; interval for readings in order.
    """

    def __init__(self, y: npt.ArrayLike, prediction: Function, *, jacobian: Union[Function, str], name: str = "readings",
                 unit: str = "", deviations: Optional[npt.ArrayLike] = None, groups: Optional[Sequence[int]] = None,
                 errors: Union[None, Dict[str, Any], Sequence[Dict[str, Any]]] = None) -> None:
        super().__init__()
        self.y = _finite_vector(y, "y")
        if self.y.size == 0:
            raise ValueError("y: there is no reading")
        if not callable(prediction):
            raise TypeError("prediction: needs a function of theta")
        if not callable(jacobian) and jacobian not in _STEPS:
            raise ValueError(f"jacobian = {jacobian!r}: needs a function of theta, \"2-point\" or \"3-point\"")
        self._prediction = prediction
        self._jacobian = jacobian
        given = [errors or {}] if errors is None or isinstance(errors, dict) else errors
        several = [dict(one) for one in given]
        self._groups = [{"name": name if len(several) == 1 else f"{name}.{k}", "unit": unit, **one}
                        for k, one in enumerate(several)]
        self._block: Dict[str, Any] = {"label": name, "observed": self.y}
        if groups is None:
            if len(several) > 1:
                raise ValueError("groups: needed where there are several errors")
            self._block["records"] = self.y.size
        else:
            if len(groups) != self.y.size:
                raise ValueError(f"groups: {len(groups)} entries, needs {self.y.size}")
            self._block["groups"] = groups
        if deviations is not None:
            self._block["deviation"] = _finite_vector(deviations, "deviations", self.y.size)

    def type(self) -> str:
        return "least_squares"

    def groups(self) -> List[Dict[str, Any]]:
        return self._groups

    def layout(self) -> List[Dict[str, Any]]:
        return [self._block]

    def evaluate(self, theta: Array, latents: List[Array], derivatives: bool) -> Dict[str, Array]:
        value = {"e": self.y - self._predicted(theta)}
        if derivatives:
            value["e_theta"] = -self._derivatives(theta)
        return value

    def _predicted(self, theta: Array) -> Array:
        # A copy: functions may fill the same array at every call.
        given = np.array(_numbers(self._prediction(theta), "what prediction returned"))
        if given.shape != self.y.shape:
            raise ValueError(f"prediction returned shape {given.shape}, needs {self.y.shape}")
        return given

    def _derivatives(self, theta: Array) -> Array:
        if callable(self._jacobian):
            given = _numbers(self._jacobian(theta), "what jacobian returned")
            if given.shape != (self.y.size, theta.size):
                raise ValueError(f"jacobian returned shape {given.shape}, needs {(self.y.size, theta.size)}")
            return given
        columns = np.empty((self.y.size, theta.size))
        base = self._predicted(theta) if self._jacobian == "2-point" else None
        for j in range(theta.size):
            step = _STEPS[self._jacobian] * (abs(theta[j]) or 1.0)
            after = theta.copy()
            after[j] += step
            before = theta.copy()
            if base is None:
                before[j] -= step
            # The step as it is after rounding.
            low = self._predicted(before) if base is None else base
            columns[:, j] = (self._predicted(after) - low) / (after[j] - before[j])
        return columns
