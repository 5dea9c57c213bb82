"""Identification of nonlinear dynamical systems from chaotic data.

All at once: identify. Jobs: run, check, stored_run. Many of them: campaign, open_campaign. Models: models, model,
equations. Orbits: periodic_orbit, find_orbits, stability, follow_branches. Records: Series, simulate, find_cycles,
harvest. Estimates: estimate, multi_start, LeastSquares, Residual, SeriesResidual, ShootingResidual, CycleResidual.

Arrays have one record (state, point, time) in each row.
"""

from ._orbid import (BifurcationDiagram, Branch, BranchPoint, Coordinate, Crossings, Cycle, CycleResidual, CycleSearch,
                     DataError, Ensemble, Estimate, Estimated, EstimatedScale, Flow, FoundOrbit, Identification,
                     OrbitSearch, Parameter, PeriodicOrbit, Residual, Segment, Series, SeriesResidual, ShootingResidual,
                     Stability, System, VirtualExperiment, __version__, correlation_dimension, embed, estimate,
                     expand_cycles, find_cycles, find_orbits, follow_branches, harvest, lyapunov_spectrum, model,
                     models, multi_start, periodic_orbit, read_csv, read_hdf5, simulate, stability, write_csv,
                     write_hdf5)
from .campaign_run import Campaign, CampaignProgress, campaign, open_campaign
from .equation import equations
from .identification import identify
from .job import JobError, Problem, ResultEntry, Run, Verdict, check, run, stored_run
from .least_squares import LeastSquares

__all__ = ["BifurcationDiagram", "Branch", "BranchPoint", "Campaign", "CampaignProgress", "Coordinate", "Crossings",
           "Cycle", "CycleResidual", "CycleSearch", "DataError", "Ensemble", "Estimate", "Estimated",
           "EstimatedScale", "Flow", "FoundOrbit", "Identification", "JobError", "LeastSquares", "OrbitSearch",
           "Parameter", "PeriodicOrbit", "Problem", "Residual", "ResultEntry", "Run", "Segment", "Series",
           "SeriesResidual", "ShootingResidual", "Stability", "System", "Verdict", "VirtualExperiment", "__version__",
           "campaign", "check", "correlation_dimension", "embed", "equations", "estimate", "expand_cycles",
           "find_cycles", "find_orbits", "follow_branches", "harvest", "identify", "lyapunov_spectrum", "model",
           "models", "multi_start", "open_campaign", "periodic_orbit", "read_csv", "read_hdf5", "run", "simulate",
           "stability", "stored_run", "write_csv", "write_hdf5"]
