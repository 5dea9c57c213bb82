"""Identification of nonlinear dynamical systems from chaotic data."""

from ._orbid import DataError, System, __version__, model

__all__ = ["DataError", "System", "__version__", "model"]
