"""Identification of nonlinear dynamical systems from chaotic data.

Jobs: run, check, stored_run. Models: models, model, equations. Orbits: periodic_orbit, find_orbits, stability,
follow_branches. Estimates: estimate, multi_start, LeastSquares, Residual.

Arrays have one record (state, point, time) in each row.
"""

from ._orbid import (
    BifurcationDiagram,
    Branch,
    BranchPoint,
    Coordinate,
    Crossings,
    DataError,
    Ensemble,
    Estimate,
    EstimatedScale,
    Flow,
    FoundOrbit,
    OrbitSearch,
    Parameter,
    PeriodicOrbit,
    Residual,
    Stability,
    System,
    __version__,
    estimate,
    find_orbits,
    follow_branches,
    model,
    models,
    multi_start,
    periodic_orbit,
    stability,
)
from .equation import equations
from .job import JobError, Problem, ResultEntry, Run, check, run, stored_run
from .least_squares import LeastSquares

__all__ = [
    "BifurcationDiagram",
    "Branch",
    "BranchPoint",
    "Coordinate",
    "Crossings",
    "DataError",
    "Ensemble",
    "Estimate",
    "EstimatedScale",
    "Flow",
    "FoundOrbit",
    "JobError",
    "LeastSquares",
    "OrbitSearch",
    "Parameter",
    "PeriodicOrbit",
    "Problem",
    "Residual",
    "ResultEntry",
    "Run",
    "Stability",
    "System",
    "__version__",
    "check",
    "equations",
    "estimate",
    "find_orbits",
    "follow_branches",
    "model",
    "models",
    "multi_start",
    "periodic_orbit",
    "run",
    "stability",
    "stored_run",
]
