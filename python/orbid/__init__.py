"""Identification of nonlinear dynamical systems from chaotic data."""

from ._orbid import DataError, System, __version__, model

__all__ = ["DataError", "System", "__version__", "model"]

from ._orbid import Estimate, EstimatedScale, Residual, estimate, multi_start
from .least_squares import LeastSquares

__all__ += ["Estimate", "EstimatedScale", "LeastSquares", "Residual", "estimate", "multi_start"]
