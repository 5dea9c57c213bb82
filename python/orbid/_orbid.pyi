import os
from typing import Any, Callable, Dict, Final, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

Array = npt.NDArray[np.float64]
Numbers = Union[float, Sequence[float], Sequence[Sequence[float]], npt.NDArray[np.floating[Any]],
                npt.NDArray[np.integer[Any]]]
Parameters = Union[None, Mapping[str, float], Sequence[float], Array]
Names = Union[None, bool, str, Sequence[str]]
Texts = Union[str, Sequence[str], None]
Keys = Mapping[str, Any]
Rows = List[Dict[str, Any]]
Section = Keys
Path = Union[str, "os.PathLike[str]"]
Complex = npt.NDArray[np.complex128]

__version__: str

class DataError(ValueError): ...

def _numbers(values: object, name: str) -> Array: ...
def _finite_vector(values: object, name: str, size: Optional[int] = None) -> Array: ...

# Models

class Parameter:
    name: Final[str]
    unit: Final[str]
    domain: Final[str]
    default: Final[float]
    description: Final[str]
    typical_size: Final[float]

class Coordinate:
    name: Final[str]
    unit: Final[str]
    angle: Final[bool]

class Flow:
    status: Final[str]
    ok: Final[bool]
    states: Final[Array]
    sensitivities: Final[Array]
    directions: Final[List[str]]
    stopped_after: Final[float]
    stopped_state: Final[Array]
    steps: Final[int]
    crossings: Final[int]
    stickings: Final[int]

class Crossings:
    status: Final[str]
    times: Final[Array]
    states: Final[Array]
    sensitivities: Final[Array]
    time_sensitivities: Final[Array]
    directions: Final[List[str]]

class Ensemble:
    sections: Final[List[Array]]
    times: Final[List[Array]]
    status: Final[List[str]]

class System:
    name: Final[str]
    variant: Final[str]
    kind: Final[str]
    dimension: Final[int]
    coordinates: Final[List[Coordinate]]
    parameters: Final[List[Parameter]]
    inputs: Final[List[Coordinate]]
    stiff: Final[bool]
    symmetry: Final[Optional[Tuple[List[float], float]]]
    def values(self, parameters: Parameters = None) -> Array: ...
    def flow(self, x0: Numbers, t: Numbers, parameters: Parameters = None, *, sensitivities: Names = False,
             phase: float = 0.0, clock: str = "time", rtol: float = 1e-12, atol: float = 1e-12,
             maximum_steps: int = 1000000) -> Flow: ...
    def rhs(self, x: Numbers, parameters: Parameters = None, *, phase: Numbers = 0.0) -> Array: ...
    def rhs_derivatives(self, x: Numbers, parameters: Parameters = None, *, sensitivities: Names = False,
                        phase: Numbers = 0.0) -> Array: ...
    def with_input(self, times: Numbers, values: Numbers, *, interpolation: str = "linear") -> System: ...
    def period(self, parameters: Parameters = None, *, clock: str = "time") -> float: ...
    def crossings(self, x0: Numbers, section: Section, count: int, parameters: Parameters = None, *,
                  sensitivities: Names = False, longest: float = 1e4, rtol: float = 1e-12, atol: float = 1e-12,
                  maximum_steps: int = 1000000) -> Crossings: ...
    def ensemble(self, starts: Numbers, count: int, parameters: Parameters = None, *, phase: float = 0.0,
                 section: Optional[Section] = None, longest: float = 1e4, rtol: float = 1e-12, atol: float = 1e-12,
                 maximum_steps: int = 1000000) -> Ensemble: ...
    def readings(self, sensor: Keys, states: Numbers, parameters: Parameters = None, *,
                 sensitivities: Names = None, phase: Numbers = 0.0) -> Tuple[Array, Array]: ...

def models() -> Rows: ...
def model(name: str, variant: str = "", size: Optional[int] = None) -> System: ...

class EquationText:
    name: str
    map: bool
    stiff: bool
    switching: Optional[List[str]]
    def __init__(self) -> None: ...
    def add_coordinate(self, name: str, formula: str, unit: str, angle: bool) -> None: ...
    def add_definition(self, name: str, formula: str) -> None: ...
    def add_parameter(self, name: str, unit: str, domain: str, value: float, typical: Optional[float],
                      description: str) -> None: ...
    def add_input(self, name: str, unit: str) -> None: ...
    def set_forcing(self, phase: str, frequency: str) -> None: ...
    def set_symmetry(self, signs: Sequence[float], phase_shift: float) -> None: ...

def system_from_text(text: EquationText) -> Tuple[Optional[System], List[Tuple[str, int, Optional[int], str]]]: ...

# Periodic orbits

class PeriodicOrbit:
    status: Final[str]
    converged: Final[bool]
    period: Final[int]
    rotation: Final[List[int]]
    points: Final[Array]
    times: Final[Array]
    time: Final[float]
    multipliers: Final[Complex]
    trivial_multiplier: Final[complex]
    jacobians: Final[List[Array]]
    sensitivities: Final[Array]
    time_sensitivities: Final[Array]
    residual: Final[float]
    iterations: Final[int]
    distance: Final[float]
    sticking: Final[bool]
    repeats: Final[int]
    discretisation_error: Final[float]

class Stability:
    simulated: Final[bool]
    unstable: Final[int]
    nearest: Final[str]
    distance: Final[float]
    directions: Final[List[Complex]]
    ln_multiplier_sensitivities: Final[Array]

class FoundOrbit:
    orbit: Final[PeriodicOrbit]
    origin: Final[str]
    mirror: Final[int]
    hits: Final[int]

class OrbitSearch:
    orbits: Final[List[FoundOrbit]]
    settled: Final[Dict[int, bool]]
    starts: Final[int]
    captured: Final[int]
    interrupted: Final[bool]

class BranchPoint:
    parameter: Final[float]
    arclength: Final[float]
    orbit: Final[PeriodicOrbit]
    unstable: Final[int]
    bifurcation: Final[str]
    parameter_error: Final[float]

class Branch:
    values: Final[Array]
    points: Final[List[BranchPoint]]
    first: Final[str]
    last: Final[str]
    origin: Final[Optional[Tuple[int, int]]]

class BifurcationDiagram:
    start_status: Final[str]
    branches: Final[List[Branch]]

def periodic_orbit(system: System, guess: Numbers, period: Optional[float] = None, parameters: Parameters = None, *,
                   method: str = "multiple_shooting", sensitivities: Names = False,
                   section: Optional[Section] = None, phase: float = 0.0, rotation: Sequence[int] = ...,
                   tolerance: float = 1e-9, maximum_iterations: int = 40, maximum_distance: float = 0.1,
                   nodes: Optional[int] = None) -> PeriodicOrbit: ...
def stability(system: System, orbit: PeriodicOrbit, parameters: Parameters = None, *, sensitivities: Names = False,
              phase: float = 0.0, near: float = 0.05) -> Stability: ...
def find_orbits(system: System, periods: Sequence[int], parameters: Parameters = None, *,
                section: Optional[Section] = None, phase: float = 0.0, seed: int = 1, points: int = 131072,
                trajectories: int = 256, initial: Optional[Numbers] = None, symmetry: bool = True,
                stabilised: bool = True) -> OrbitSearch: ...
def follow_branches(system: System, guess: Numbers, parameter: str, lower: float, upper: float, *,
                    period: Optional[float] = None, parameters: Parameters = None,
                    section: Optional[Section] = None, phase: float = 0.0, direction: int = 0,
                    first_step: float = 1e-2, largest_step: float = 5e-2, maximum_points: int = 1000,
                    switch_doublings: bool = True, switch_symmetry: bool = True, maximum_period: int = 16,
                    maximum_branches: int = 32) -> BifurcationDiagram: ...

# Jobs

_ProblemRow = Tuple[str, int, int, str, bool, str]

def job_problems(text: str, source: Path) -> List[_ProblemRow]: ...
def run_job(text: str, source: Path, out: Path, threads: int,
            stage: str, force: bool,
            progress: Optional[Callable[[str], object]]) -> Tuple[int, List[_ProblemRow], str, str, str]: ...
def run_campaign(text: str, source: Path, out: Path, threads: int, retry: bool,
                 progress: Optional[Callable[[int, int, int, int, int, float, float], object]]
                 ) -> Tuple[int, List[_ProblemRow], str, str]: ...
def campaign_job(folder: Path, number: int) -> Tuple[str, Path]: ...

# Estimator

class Residual:
    """A source of errors e = y - yhat(theta, z) with derivatives; subclass it to bring one of your own."""
    def __init__(self) -> None: ...
    def evaluate(self, theta: Array, latents: List[Array], derivatives: bool) -> Any: ...

class Estimated:
    """One estimated or derived number with its uncertainty."""
    name: Final[str]
    unit: Final[str]
    value: Final[float]
    start: Final[float]
    sd: Final[float]
    interval95: Final[Tuple[float, float]]
    interval_method: Final[str]
    at_bound: Final[str]
    laplace_sd: Final[float]
    data_share: Final[float]
    bias: Final[float]

class EstimatedScale:
    """Error scale of a group of records."""
    group: Final[str]
    unit: Final[str]
    factor: Final[bool]
    estimated: Final[bool]
    value: Final[float]
    sd: Final[float]
    interval95: Final[Tuple[float, float]]
    interval_method: Final[str]
    count: Final[int]
    rms: Final[float]
    lag1: Final[float]
    effective_count: Final[float]
    distribution: Final[str]
    shape: Final[Dict[str, Estimated]]

class Estimate:
    """Result of estimate(); profiles, marginals and samples are asked of it."""
    status: Final[str]
    message: Final[str]
    parameters: Final[Dict[str, Estimated]]
    derived: Final[Dict[str, Estimated]]
    theta: Final[Array]
    sds: Final[Array]
    intervals: Final[Array]
    scales: Final[Dict[str, EstimatedScale]]
    covariances: Final[Rows]
    covariance: Final[Array]
    correlation: Final[Array]
    singular_values: Final[Array]
    latents: Final[List[List[Array]]]
    latent_sds: Final[List[List[Array]]]
    residuals: Final[List[List[Array]]]
    null_directions: Final[List[Array]]
    sloppy_directions: Final[Rows]
    counts: Final[Rows]
    history: Final[Rows]
    trust_normal: Final[bool]
    distrust: Final[str]
    objective: Final[float]
    log_likelihood: Final[float]
    log_integral: Final[float]
    degrees_of_freedom: Final[float]
    effective_count: Final[float]
    iterations: Final[int]
    evaluations: Final[int]
    rounds: Final[int]
    remaining: Final[float]
    def to_dict(self) -> Dict[str, Any]: ...
    def profiles(self, *, names: Texts = None, level: float = 0.95, tolerance: float = 1e-4, reach: float = 40.0,
                 curve_points: int = 4, maximum_points: int = 60) -> Dict[str, Dict[str, Any]]: ...
    def marginals(self, *, names: Texts = None, step: float = 0.5, fall: float = 12.0, reach: float = 40.0,
                  maximum_points: int = 41, full_hessian: bool = ...) -> Dict[str, Dict[str, Any]]: ...
    def sample(self, *, chains: int = 4, warm_up: int = 500, draws: int = 1000, seed: int = 1, acceptance: float = 0.8,
               maximum_depth: int = 10, spread: float = 1.0) -> Dict[str, Any]: ...

Values = Mapping[str, Union[float, Keys]]
Derived = Optional[Mapping[str, Tuple[Callable[[Array], float], Callable[[Array], ArrayLike]]]]

def estimate(parameters: Values, residuals: Union[Residual, Sequence[Residual]], derived: Derived = None, *,
             variance: str = "restricted", clusters: str = "automatic", maximum_iterations: int = 200,
             maximum_rounds: int = 20, step_tolerance: float = 1e-6, relative_singular_value: float = 3e-8,
             verdict: bool = True, full_hessian: bool = False, joint_priors: Optional[Sequence[Keys]] = None,
             progress: Optional[Callable[[int, float], object]] = None) -> Estimate: ...
def multi_start(parameters: Values, residuals: Callable[[], Union[Residual, Sequence[Residual]]],
                derived: Derived = None, *, starts: int = 20, seed: int = 1, width: float = 1.0,
                screening_iterations: int = 0, kept: int = 10, distance: float = 0.1, objective_tolerance: float = 0.01,
                **options: Any) -> Dict[str, Any]: ...

class Identification(Estimate):
    """Result of identify(): an Estimate, and the stages that led to it."""
    stages: Final[Rows]
    cycles: Final[List["Cycle"]]
    matching: Final[Rows]
    structure: Final[Dict[str, Any]]

def identify(system: System, records: Sequence[Keys], parameters: Values, *, section: Optional[Section] = None,
             **options: Any) -> Identification: ...

# Series, cycles, their residuals

class Segment:
    """One uninterrupted piece of a Series."""
    label: Final[str]
    values: Final[Array]
    times: Final[Array]
    deviations: Final[Array]
    def __len__(self) -> int: ...

Coordinates = Union[System, Sequence[Union[str, Keys]]]
Records = Union[ArrayLike, Sequence[ArrayLike]]

class Series:
    """A measured or simulated record in segments, shape (records, coordinates) each; nan is a missing reading."""
    def __init__(self, values: Records, coordinates: Coordinates, *, times: Optional[Records] = None,
                 deviations: Optional[Records] = None, labels: Texts = None, sampling: str = ..., phase: float = 0.0,
                 origin: str = "") -> None: ...
    sampling: Final[str]
    coordinates: Final[Rows]
    segments: Final[List[Segment]]
    phase: Final[float]
    origin: Final[str]
    timed: Final[bool]
    scale: Final[Array]
    def __len__(self) -> int: ...

def read_csv(file: Path, columns: Mapping[str, Union[str, Keys]], coordinates: Optional[Coordinates] = None, *,
             segment: str = "", time: str = "", time_unit: str = "s", step: float = 0.0, sampling: str = ...,
             window: Sequence[float] = ..., rows: Sequence[int] = ..., every: int = 1, nan_is_missing: bool = False,
             phase: float = 0.0, minimum_points: int = 1, time_tolerance: float = 0.05, equidistant: bool = True,
             complete: bool = False) -> Series: ...
def read_hdf5(file: Path, *, minimum_points: int = 1) -> Series: ...
def write_csv(file: Path, series: Series) -> None: ...
def write_hdf5(file: Path, series: Series) -> None: ...

class VirtualExperiment:
    """A simulated record and what happened."""
    series: Final[Series]
    events: Final[Rows]
    complete: Final[bool]
    message: Final[str]

def simulate(system: System, parameters: Parameters = None, *, sections: int = ..., section: Optional[Section] = None,
             longest_return: float = 0.0, step: float = ..., count: int = ..., transient: int = ...,
             trajectories: int = 1, initial: Optional[ArrayLike] = None, random_range: Optional[ArrayLike] = None,
             restart: bool = True, phase: float = 0.0, sensor: Optional[Keys] = None, noise: Optional[ArrayLike] = None,
             noise_correlation: Optional[ArrayLike] = None, seed: int = 0, rtol: float = ..., atol: float = ...,
             maximum_steps: int = ...) -> VirtualExperiment: ...

class Cycle:
    """An unstable periodic orbit found in a series."""
    def __init__(self, points: ArrayLike, *, covariance: Optional[ArrayLike] = None,
                 multipliers: Optional[Sequence[complex]] = None, ln_multiplier: Optional[ArrayLike] = None,
                 ln_multiplier_covariance: Optional[ArrayLike] = None, time: float = ...,
                 time_sd: float = ..., time_covariance: Optional[ArrayLike] = None) -> None: ...
    period: Final[int]
    rotation: Final[List[int]]
    points: Final[Array]
    covariance: Final[Array]
    multipliers: Final[Complex]
    ln_multiplier: Final[Array]
    ln_multiplier_covariance: Final[Array]
    common_errors: Final[Array]
    time: Final[float]
    time_sd: Final[float]
    time_covariance: Final[Array]
    code: Final[str]
    recurrences: Final[int]
    mirror: Final[Optional[int]]
    quality: Final[List[str]]

class CycleSearch:
    """What a search for cycles found."""
    cycles: Final[List[Cycle]]
    missing: Final[List[int]]
    candidates: Final[int]
    rejected: Final[int]
    patch_map: Final[bool]
    reading_covariance: Final[Array]
    remarks: Final[List[str]]

def find_cycles(series: Series, *, method: str = "automatic", periods: Optional[Sequence[int]] = None, box: float = 0.1,
                neighbours: int = 0, order: int = 0, minimum_recurrences: int = 1,
                symmetry_signs: Optional[Sequence[float]] = None, reading_covariance: Optional[ArrayLike] = None,
                partition: Optional[Keys] = None) -> CycleSearch: ...
def harvest(series: Series, system: System, parameters: Parameters, known: Sequence[Cycle], *,
            covariance: Optional[ArrayLike] = None, free: Texts = None, sensor: Optional[Keys] = None,
            phase: float = 0.0, section: Optional[Section] = None, maximum_orbits: int = 400,
            search_points: int = 100000, **options: Any) -> Dict[str, Any]: ...
def lyapunov_spectrum(series: Series, *, order: int = 0, neighbours: int = 0, steps: int = 262144,
                      symmetry_signs: Optional[Sequence[float]] = None) -> Dict[str, Any]: ...
def correlation_dimension(series: Series, *, theiler: int = 0, pairs: int = 1000000,
                          points: int = 200000) -> Dict[str, Any]: ...
def expand_cycles(cycles: Sequence[Cycle], *, complete_to: int, continuous: bool = True) -> Dict[str, Any]: ...
def embed(series: Series, *, coordinate: str = ..., delay: int = 0, dimension: int = 0, largest_delay: int = 1000,
          largest_dimension: int = 8) -> Dict[str, Any]: ...

Latents = Optional[Sequence[ArrayLike]]

class SeriesResidual(Residual):
    """Samples minus their prediction from one initial state per segment (single shooting)."""
    def evaluate(self, theta: ArrayLike, latents: Latents = None, derivatives: bool = False) -> Rows: ...
    def __init__(self, system: System, series: Series, parameters: Sequence[Optional[str]], *,
                 values: Parameters = None, name: str = "series", observe: Texts = None,
                 segments: Optional[Sequence[int]] = None, sensor: Optional[Keys] = None,
                 errors: Optional[Mapping[str, Keys]] = None, known_sds: bool = False,
                 start: Optional[ArrayLike] = None, initial: Optional[Values] = None, rtol: float = ...,
                 atol: float = ..., maximum_steps: int = ...) -> None: ...
    def state(self, block: int, theta: ArrayLike, latents: ArrayLike) -> Array: ...

class ShootingResidual(Residual):
    """A recorded series by multiple shooting: nodes along every segment, matched exactly or with an error."""
    def evaluate(self, theta: ArrayLike, latents: Latents = None, derivatives: bool = False) -> Rows: ...
    def __init__(self, system: System, series: Series, parameters: Sequence[Optional[str]], *,
                 values: Parameters = None, name: str = "series", observe: Texts = None,
                 segments: Optional[Sequence[int]] = None, sensor: Optional[Keys] = None,
                 errors: Optional[Mapping[str, Keys]] = None, known_sds: bool = False,
                 start: Optional[ArrayLike] = None, interval: int = 0, matching: str = "exact",
                 matching_sd: Union[ArrayLike, str] = ..., rtol: float = ..., atol: float = ...,
                 maximum_steps: int = ...) -> None: ...
    interval: Final[int]

class CycleResidual(Residual):
    """Measured cycles against re-solved periodic orbits of the model."""
    def evaluate(self, theta: ArrayLike, latents: Latents = None, derivatives: bool = False) -> Rows: ...
    def __init__(self, system: System, cycles: Sequence[Cycle], parameters: Sequence[Optional[str]], start: ArrayLike,
                 *, values: Parameters = None, phase: float = 0.0, section: Optional[Section] = None,
                 periods: Optional[Sequence[int]] = None, weights: str = "covariance", positions: bool = True,
                 multipliers: bool = False, times: bool = False, sensor: Optional[Keys] = None,
                 errors: Optional[Mapping[str, Keys]] = None, maximum_move: float = 0.05, gate: float = 25.0,
                 rtol: float = ..., atol: float = ..., maximum_steps: int = ...) -> None: ...
    at_rest: Final[List[int]]
