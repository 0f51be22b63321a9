# The extension module. Its functions take keywords by position only through the
# thin faces of the package; the docstrings are there.

from collections.abc import Callable, Sequence
from typing import Any, Self, TypedDict, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import disjoint_base

_Array = NDArray[np.float64]

__version__: str

# the gate for numbers (`convert`): `name` is the argument's, for messages
def as_float_array(value: ArrayLike, name: str) -> _Array: ...
def as_finite_array(value: ArrayLike, name: str) -> _Array: ...
def require_finite(values: _Array, name: str) -> _Array: ...
def is_single(*values: object) -> bool: ...

# spine
def above_rounding(rows: ArrayLike, noise: ArrayLike) -> tuple[_Array, float | None]: ...
def representable(std: _Array) -> _Array: ...
def rounding_of_columns(rows: ArrayLike, accuracy: ArrayLike, width: int) -> _Array: ...
def empty_call() -> None: ...
def gram(
    rows: ArrayLike, weights: ArrayLike | None, out: NDArray[Any] | None = None
) -> NDArray[Any]: ...
def chi_square_critical(alpha: float, dof: float) -> float: ...
def chi_square_survival(value: ArrayLike, dof: ArrayLike) -> _Array: ...
def crlb_std(rows: ArrayLike, rtol: float | None, out: _Array | None = None) -> _Array: ...
def marginal_rows(rows: ArrayLike, eliminated: int, rtol: float | None) -> _Array: ...
def normals(seed: int, first: int, trials: int, count: int) -> _Array: ...
def set_threads(threads: int) -> int: ...
def threads() -> int: ...
def be_worker(alone: bool, check: Callable[[], object]) -> None: ...

@final
class Analysis:
    def __new__(
        cls,
        rows: ArrayLike,
        rtol: float | None,
        exact: ArrayLike | None = None,
        errors: ArrayLike | None = None,
    ) -> Analysis: ...
    @property
    def rank(self) -> int: ...
    @property
    def rtol(self) -> float: ...
    @property
    def log_det(self) -> float: ...
    def singular_values(self) -> _Array: ...
    def null_space(self) -> _Array: ...
    def weakest_direction(self) -> _Array: ...
    def crlb_std(self) -> _Array: ...
    def undecided(self) -> list[int]: ...
    def crlb(self) -> _Array | None: ...
    def crlb_root(self) -> _Array | None: ...
    def combination_std(self, combination: ArrayLike) -> float: ...
    def knowing(self, combination: ArrayLike, sigma: float) -> tuple[int, _Array]: ...
    def leverage(self, rows: ArrayLike) -> _Array: ...
    def without(self, row: ArrayLike) -> _Array | None: ...

def singular_values(rows: ArrayLike) -> _Array: ...
def rows_without_noise(rows: ArrayLike, sigma: ArrayLike) -> _Array: ...
def brief(value: float, digits: int) -> str: ...
def moves(change: ArrayLike, names: Sequence[str]) -> str: ...
def references(rows: ArrayLike, scale: ArrayLike) -> _Array: ...
def judge(
    rank: int,
    touched: NDArray[np.bool_],
    data_std: ArrayLike,
    scale: ArrayLike,
    prior: ArrayLike,
    condition: float,
    hardness: ArrayLike,
    weak_ratio: float,
    weak_condition: float,
    names: Sequence[str],
    units: Sequence[str],
) -> tuple[str, str, list[int]]: ...

@final
class Compiled:
    def __new__(
        cls,
        address: int,
        data: int | None,
        jacobian: tuple[int, int | None] | None,
        states: int,
        measurements: int,
        kept: object,
    ) -> Self: ...
    def values(self, points: ArrayLike) -> _Array: ...
    def jacobians(self, points: ArrayLike) -> _Array: ...
    def maximum_likelihood(
        self,
        truth: ArrayLike,
        z: ArrayLike,
        weight: ArrayLike,
        period: ArrayLike,
        step: ArrayLike,
        noise: ArrayLike,
        known: ArrayLike,
        mean: ArrayLike,
        sigma: ArrayLike,
    ) -> _Array: ...

@final
class TrialFunction:
    def __new__(
        cls,
        address: int,
        data: int | None,
        returns: bool,
        size: int,
        covariance: bool,
        kept: object,
    ) -> Self: ...
    def records(self, z: ArrayLike) -> _Array: ...

@final
class Differences:
    def values(self) -> _Array: ...
    def error(self) -> _Array: ...
    def noise(self) -> _Array: ...
    def step(self) -> _Array: ...
    @property
    def evaluations(self) -> int: ...
    @property
    def groups(self) -> int: ...

def differences(
    function: Callable[[_Array], ArrayLike],
    x: ArrayLike,
    at: ArrayLike,
    scale: ArrayLike,
    weight: ArrayLike,
    period: ArrayLike,
    noise: ArrayLike,
    step: ArrayLike,
    pattern: Sequence[Sequence[int]] | None,
    names: Sequence[str],
) -> Differences: ...

# sparse problems
_Compressed = tuple[NDArray[np.int64], NDArray[np.int64], _Array]

@final
class SparseAnalysis:
    def __new__(
        cls,
        start: NDArray[Any],
        column: NDArray[Any],
        value: _Array,
        columns: int,
        rtol: float | None,
        available: int,
        unit: float | None = None,
    ) -> SparseAnalysis: ...
    @property
    def nullity(self) -> int: ...
    @property
    def norm(self) -> float: ...
    @property
    def rtol(self) -> float: ...
    @property
    def log_det(self) -> float: ...
    @property
    def smallest_counting(self) -> float: ...
    @property
    def largest_dropped(self) -> float: ...
    @property
    def converged(self) -> bool: ...
    @property
    def factor_entries(self) -> int: ...
    @property
    def peak_bytes(self) -> int: ...
    @property
    def structural_rank(self) -> int: ...
    @property
    def empty_rows(self) -> int: ...
    def component(self) -> NDArray[np.uint64]: ...
    def untouched(self) -> NDArray[np.uint64]: ...
    def shortages(self) -> list[tuple[NDArray[np.uint64], NDArray[np.uint64]]]: ...
    def null_vectors(self) -> _Compressed: ...
    def weakest(self, count: int) -> tuple[_Array, _Compressed]: ...
    def scale(self) -> _Array: ...
    def crlb_std(self) -> _Array: ...
    def variances(
        self, start: NDArray[np.int64], column: NDArray[np.int64], value: _Array
    ) -> _Array: ...
    def covariance(
        self, start: NDArray[np.int64], column: NDArray[np.int64], value: _Array
    ) -> _Array: ...
    def gram(
        self,
        start: NDArray[np.int64],
        column: NDArray[np.int64],
        value: _Array,
        states: Sequence[int] | None,
        weights: Sequence[float] | None,
        available: int,
    ) -> tuple[_Array, _Array | None]: ...
    def rank_gain(
        self, start: NDArray[np.int64], column: NDArray[np.int64], value: _Array
    ) -> int: ...

def sparse_marginal_rows(
    start: NDArray[np.int64],
    column: NDArray[np.int64],
    value: _Array,
    eliminated: NDArray[np.bool_],
    available: int,
) -> _Compressed: ...
def weak_places(
    vertices: int, first: NDArray[np.int64], second: NDArray[np.int64]
) -> tuple[NDArray[np.uint64], NDArray[np.uint64], NDArray[np.uint64]]: ...

# choice among candidates
def choose_observable(
    c: ArrayLike,
    g: ArrayLike | None,
    ends: Sequence[int],
    budget: int,
    worth: float,
    exchange: int,
    steps: int,
) -> tuple[
    list[int],
    list[float],
    list[int],
    float,
    tuple[_Array, float, float] | None,
]: ...
def choose(
    base: ArrayLike,
    rows: ArrayLike,
    ends: Sequence[int],
    budget: int,
    goal: str,
    weights: ArrayLike,
    exchange: int,
    steps: int,
) -> tuple[
    list[int],
    list[float],
    list[int],
    list[int],
    float,
    tuple[_Array, float, float] | None,
]: ...

# models with their measurements
_Record = dict[str, Any]

@final
class Model:
    @staticmethod
    def from_functions(
        states: int,
        measurements: int,
        linearize: Callable[[_Array, bool], tuple[_Array, _Array | None]],
        difference: Callable[[_Array, _Array], _Array],
        symmetries: Callable[[_Array], _Array] | None,
        priors: int = 0,
        groups: Sequence[tuple[Sequence[int], float]] = ...,
        twofold: Sequence[int] = ...,
    ) -> Model: ...
    @staticmethod
    def bearings(
        times: ArrayLike,
        observer: ArrayLike,
        bearings: ArrayLike,
        sigma: ArrayLike,
        states: int,
    ) -> Model: ...
    @property
    def states(self) -> int: ...
    @property
    def measurements(self) -> int: ...
    def with_prior(self, combinations: ArrayLike, mean: ArrayLike, sigma: ArrayLike) -> Model: ...
    def with_known(self, known: Sequence[float | None]) -> Model: ...
    def linearize(self, x: ArrayLike) -> tuple[_Array, _Array]: ...
    def minimize(
        self, starts: ArrayLike, loss: tuple[str, float], max_iterations: int
    ) -> list[_Record]: ...
    def others(
        self,
        x: ArrayLike,
        more: ArrayLike,
        spread: tuple[str, Sequence[float], Sequence[float]] | None,
        starts: int,
        seed: int,
    ) -> _Record: ...
    def interval(
        self, x: ArrayLike, others: ArrayLike, function: object, rise: float
    ) -> _Record: ...
    def contours(
        self, x: ArrayLike, others: ArrayLike, functions: tuple[object, object], rise: float
    ) -> list[tuple[_Array, bool, bool]]: ...
    def trials(
        self,
        truth: ArrayLike,
        starts: ArrayLike,
        spread: tuple[str, Sequence[float], Sequence[float]] | None,
        search: tuple[int, int] | None,
        function: object | None,
        rises: tuple[float, float],
        alternatives: Sequence[ArrayLike],
        shift: ArrayLike | None,
        seed: int,
        first: int,
        trials: int,
    ) -> _Array: ...
    def recall(
        self,
        x: ArrayLike,
        spread: tuple[str, Sequence[float], Sequence[float]],
        starts: int,
        seed: int,
        many: int,
        reach: float,
    ) -> tuple[int, int, int]: ...
    def fit(self, x: ArrayLike) -> _Record: ...
    def weiss_weinstein(
        self, mean: ArrayLike, sigma: ArrayLike, vectors: ArrayLike, samples: int
    ) -> tuple[_Array, _Array, list[int]]: ...
    def scores(
        self, x: ArrayLike, alternatives: Sequence[ArrayLike], alpha: float, power: float
    ) -> tuple[list[_Record], list[list[float]]]: ...

def channels(values: ArrayLike, sigma: ArrayLike, places: Sequence[Sequence[int]]) -> _Array: ...
def barankin(rows: ArrayLike, offsets: ArrayLike, differences: ArrayLike) -> _Array | None: ...

# bearings
class _Quadruple(TypedDict):
    indices: _Array
    value: _Array

class _Fisher(TypedDict):
    fisher: _Array
    det: _Array

class _Gram(TypedDict):
    gram: _Array
    det: _Array

class _MotionTest(TypedDict):
    statistic: _Array
    p_value: _Array
    relative_motion: _Array

def bearing_best_quadruple(times: ArrayLike, bearings: ArrayLike) -> _Quadruple: ...
def bearing_discriminant(
    times: ArrayLike, bearings: ArrayLike, form: str, out: _Array | None = None
) -> _Array: ...
def bearing_discriminant_sum(
    times: ArrayLike,
    bearings: ArrayLike,
    weights: ArrayLike | None,
    method: str,
    order: int,
    out: _Array | None = None,
) -> _Array: ...
def bearing_gram(
    times: ArrayLike, bearings: ArrayLike, weights: ArrayLike | None, out: _Array | None = None
) -> _Array: ...
def bearing_gram_and_det(
    times: ArrayLike, bearings: ArrayLike, weights: ArrayLike | None, out: _Array | None = None
) -> _Gram: ...
def bearing_rows(
    times: ArrayLike,
    observer: ArrayLike,
    target: ArrayLike,
    sigma: ArrayLike,
    is_state: bool,
    out: _Array | None = None,
) -> _Array: ...
def bearing_motion_rows(
    times: ArrayLike,
    observer: ArrayLike,
    target: ArrayLike,
    sigma: ArrayLike,
    dimensions: int,
    order: int,
    is_state: bool,
    several: bool,
    out: _Array | None = None,
) -> _Array: ...
def bearing_frame(
    times: ArrayLike,
    observer: ArrayLike,
    target: ArrayLike,
    rows: ArrayLike,
    is_state: bool,
) -> tuple[_Array, float | None, dict[str, _Array], _Array]: ...
def bearing_test(times: ArrayLike, bearings: ArrayLike, sigma: ArrayLike) -> _MotionTest: ...

@disjoint_base
class BearingMonitor:
    def __new__(cls) -> Self: ...
    def push(
        self, time: float, bearing: float, sigma: float, distance: float | None = None
    ) -> MonitorAnswer: ...
    def answer(self) -> MonitorAnswer: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __getstate__(self) -> tuple[list[float], list[int], bool]: ...
    def __setstate__(self, state: tuple[list[float], list[int], bool]) -> None: ...

@final
class MonitorAnswer:
    def __eq__(self, other: object, /) -> bool: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    @property
    def count(self) -> int: ...
    @property
    def rank(self) -> int: ...
    @property
    def det(self) -> float: ...
    @property
    def logdet(self) -> float: ...
    @property
    def singular_value(self) -> float: ...
    @property
    def crlb_std(self) -> _Array: ...
    @property
    def statistic(self) -> float: ...
    @property
    def dof(self) -> float: ...
    @property
    def p_value(self) -> float: ...
    @property
    def relative_motion(self) -> _Array: ...

# estimates from bearings. Trial i takes its noise from (seed, first + i) alone, so a
# run may be cut anywhere. A status is a place in `gramian.bearings.STATUSES`.
class _Localized(TypedDict):
    state: _Array
    null_direction: _Array
    covariance: _Array
    status: _Array
    nullity: _Array
    iterations: _Array
    chi2: _Array
    lag_p_value: _Array

class _LocalizedTrials(TypedDict):
    error: _Array
    std: _Array
    nees: _Array
    chi2: _Array
    status: _Array
    iterations: _Array

def bearings_localize(
    times: ArrayLike,
    observer: ArrayLike,
    bearings: ArrayLike,
    sigma: ArrayLike,
    states: int,
    prior: tuple[ArrayLike, ArrayLike] | None,
    several: bool,
    rtol: float | None,
    max_iterations: int,
    weak_ratio: float,
    correlation: float,
) -> _Localized: ...
def bearings_localize_trials(
    times: ArrayLike,
    observer: ArrayLike,
    truth: ArrayLike,
    sigma: ArrayLike,
    seed: int,
    first: int,
    trials: int,
    prior: tuple[ArrayLike, ArrayLike] | None,
    several: bool,
    rtol: float | None,
    max_iterations: int,
    weak_ratio: float,
) -> _LocalizedTrials: ...

# dipole
class _DipoleLocalized(TypedDict):
    state: _Array
    mirror: _Array
    cost: _Array
    mirror_cost: _Array
    sigma: _Array
    converged: _Array
    rounds: _Array
    efficiency: _Array
    status: _Array
    background: _Array
    residuals: _Array
    weights: _Array

def dipole_field(position: ArrayLike, moment: ArrayLike, out: _Array | None = None) -> _Array: ...
def dipole_jacobian(
    position: ArrayLike, moment: ArrayLike, out: _Array | None = None
) -> _Array: ...
def dipole_measure(
    times: ArrayLike,
    position: ArrayLike,
    velocity: ArrayLike,
    moment: ArrayLike,
    sensors: ArrayLike,
    kind: tuple[Sequence[Sequence[float]], tuple[float, float, float] | None],
    quadrupole: ArrayLike | None,
    one: bool,
    out: _Array | None = None,
) -> _Array: ...
def dipole_rows(
    times: ArrayLike,
    position: ArrayLike,
    velocity: ArrayLike,
    moment: ArrayLike,
    sigma: ArrayLike,
    sensors: ArrayLike,
    kind: tuple[Sequence[Sequence[float]], tuple[float, float, float] | None],
    quadrupole: ArrayLike | None,
    out: _Array | None = None,
) -> _Array: ...
def dipole_fisher(
    times: ArrayLike,
    position: ArrayLike,
    velocity: ArrayLike,
    moment: ArrayLike,
    sigma: ArrayLike,
    sensors: ArrayLike,
    out: _Array | None = None,
) -> _Array: ...
def dipole_track(
    times: ArrayLike,
    field: ArrayLike,
    sensors: Sequence[Sequence[float]],
    sigma: ArrayLike,
    start: float,
    state: Sequence[float],
    root: ArrayLike,
    wander: tuple[float, float],
    truth: ArrayLike | None,
    bound_root: ArrayLike | None,
) -> dict[str, _Array]: ...
def dipole_check(
    times: ArrayLike, field: ArrayLike
) -> tuple[list[tuple[str, dict[str, Any]]], list[tuple[float, float, float]]]: ...
def dipole_localize(
    times: ArrayLike,
    field: ArrayLike,
    sensors: object,
    exact: Sequence[float],
    prior: Sequence[Sequence[float]],
    options: object,
) -> _DipoleLocalized: ...

@final
class DipoleRecord:
    def __new__(
        cls,
        times: ArrayLike,
        field: ArrayLike,
        sensors: object,
        weights: ArrayLike,
        offsets: bool,
        exact: Sequence[float],
        prior: Sequence[Sequence[float]],
        near: Sequence[float],
        correlation: float,
        spacing: float,
    ) -> DipoleRecord: ...
    def model(self) -> Model: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def units(self) -> list[str]: ...
    def coordinates(self, at: Sequence[float]) -> _Array: ...
    def expand(self, x: ArrayLike) -> tuple[_Array, _Array]: ...
    def described(
        self,
        motion: str,
        sources: int,
        quadrupole: tuple[bool, bool, bool] | None,
        drift: bool,
        attitude: float | None,
        scale: float | None,
        induced: tuple[float, float, float] | None,
    ) -> DipoleRecord: ...
    def place(self, x: ArrayLike, time: float) -> tuple[_Array, _Array]: ...
    def quadrupole(self, x: ArrayLike) -> tuple[_Array, _Array]: ...
    def seeds(self, x: ArrayLike, most: int) -> _Array: ...
    def alike(self, x: ArrayLike) -> _Array: ...
    def robust(self, x: ArrayLike, sigma: float | None) -> tuple[_Array, float, float]: ...
    def noise(self, x: ArrayLike, spacing: float, sigma: float | None) -> tuple[float, float]: ...
    def alternatives(self, x: ArrayLike) -> list[tuple[str, _Array]]: ...
    def __len__(self) -> int: ...

def dipole_localize_trials(
    times: ArrayLike,
    state: Sequence[float],
    sigma: float,
    sensors: object,
    exact: Sequence[float],
    prior: Sequence[Sequence[float]],
    options: object,
    seed: int,
    first: int,
    trials: int,
) -> _Array: ...

@final
class RegistrationRecord:
    def __new__(
        cls,
        reports: ArrayLike,
        sensors: ArrayLike,
        sigma: ArrayLike,
        extras: tuple[bool, bool, bool],
        truth: tuple[ArrayLike, ArrayLike] | None,
        velocity: ArrayLike | None,
    ) -> RegistrationRecord: ...
    def positions(self, x: Sequence[float]) -> _Array: ...
    def lines(self) -> list[int]: ...
    def model(self) -> Model: ...
    def alternatives(
        self, x: Sequence[float], velocity: ArrayLike | None
    ) -> list[tuple[str, int, _Array]]: ...

# maneuver
class _Path(TypedDict):
    count: _Array
    path: _Array
    bearings: _Array
    ranges: _Array
    headings: _Array
    information: _Array
    det: _Array

def maneuver_fisher(
    positions: ArrayLike,
    target: ArrayLike,
    sigma: ArrayLike,
    times: ArrayLike | None,
    single: bool,
    out: NDArray[Any] | None = None,
) -> NDArray[Any]: ...
def maneuver_fisher_and_det(
    positions: ArrayLike,
    target: ArrayLike,
    sigma: ArrayLike,
    times: ArrayLike | None,
    out: _Array | None = None,
) -> _Fisher: ...
def maneuver_fisher_det(
    positions: ArrayLike,
    target: ArrayLike,
    sigma: ArrayLike,
    times: ArrayLike | None,
    pairs: bool,
    out: _Array | None = None,
) -> _Array: ...
def maneuver_heading(
    bearing: ArrayLike,
    range_: ArrayLike,
    step: ArrayLike,
    law: str,
    side: ArrayLike,
    out: _Array | None = None,
) -> _Array: ...
def maneuver_best_two_legs(
    cross: float, of_range: bool
) -> tuple[float, float, float, float, float]: ...
def maneuver_two_leg_terms(turn: float, first: float, second: float) -> tuple[float, float]: ...
def maneuver_best_sides(bearings: ArrayLike, ranges: ArrayLike, count: ArrayLike) -> _Array: ...
def maneuver_trajectory(
    target: ArrayLike,
    start: ArrayLike,
    step: ArrayLike,
    samples: int,
    law: str,
    side: ArrayLike,
    sigma: ArrayLike,
    standoff: ArrayLike,
    circles: bool,
) -> _Path: ...

# maneuver: planner and closed loop
PLAN_STATES: int

@final
class PlanSearch:
    def __new__(
        cls,
        problem: dict[str, Any],
        starts: int,
        restarts: int,
        iterations: int,
        seed: int,
    ) -> PlanSearch: ...
    def run(self, seconds: float, progress: Callable[[int, int, float], object] | None) -> str: ...
    def best(self) -> dict[str, Any] | None: ...
    def tried(
        self,
    ) -> list[tuple[str, int, float, float, float, bool, list[list[list[float]]]]]: ...
    def guessed(self) -> int: ...
    def bound(self, passes: int, cells: float, seconds: float) -> float | None: ...
    def judge(
        self,
        counts: Sequence[int],
        headings: Sequence[Sequence[float]],
        speeds: Sequence[Sequence[float]],
    ) -> dict[str, Any]: ...
    def gradient(
        self, counts: NDArray[np.int64], headings: _Array, speeds: _Array, sharpness: float
    ) -> tuple[float, _Array]: ...

def plan_steered(
    start: ArrayLike,
    dt: float,
    lengths: ArrayLike,
    first: float | None,
    standoff: float,
    targets: ArrayLike,
    keep_out: ArrayLike,
    max_turn: float,
    law: str,
    side: float,
    aim: ArrayLike,
) -> _Array: ...
def maneuver_closed_loop(
    target: ArrayLike,
    start: ArrayLike,
    dt: float,
    length: float,
    steps: int,
    sigma: float,
    first_range: tuple[float, float],
    first_speed: float | None,
    gate: float,
    opening: int,
    when_lost: str,
    standoff: float,
    keep_out: ArrayLike,
    max_turn: float,
    guide: str,
    wanted: ArrayLike,
    noise: ArrayLike,
    lost: ArrayLike,
    alarms: ArrayLike,
) -> _Array: ...

# monte_carlo
def bearing_log_det_trials(
    times: ArrayLike,
    bearings: ArrayLike,
    sigma: ArrayLike,
    seed: int,
    first: int,
    trials: int,
) -> _Array: ...
def moments(values: ArrayLike, ok: NDArray[np.bool_]) -> _Array: ...
def merge_moments(d: int, left: ArrayLike, right: ArrayLike) -> _Array: ...

# posterior
class _Posterior(TypedDict):
    std: _Array
    roots: _Array

def semidefinite_roots(covariance: ArrayLike) -> _Array: ...
def posterior(
    root: ArrayLike,
    rows: ArrayLike,
    after: ArrayLike,
    transition: ArrayLike,
    noise: ArrayLike,
    is_covariance: bool,
    every_root: bool,
) -> _Posterior: ...

# registration: `extras` are gain, position, attitude; `settings` the linearisations
# at most, the tolerance, the noise share and the bend
class _Registered(TypedDict):
    biases: _Array
    covariance: _Array
    directions: _Array
    status: _Array
    iterations: _Array
    chi_square: _Array
    nullity: _Array
    noise_share: _Array
    bend: _Array
    positions: _Array

def registration_rows(
    positions: ArrayLike,
    sensors: ArrayLike,
    sigma: ArrayLike,
    biases: ArrayLike,
    extras: tuple[bool, bool, bool],
    out: _Array | None = None,
) -> _Array: ...
def registration_rounding(
    positions: ArrayLike,
    sensors: ArrayLike,
    sigma: ArrayLike,
    biases: ArrayLike,
    extras: tuple[bool, bool, bool],
) -> _Array: ...
def registration_fisher(
    positions: ArrayLike,
    sensors: ArrayLike,
    sigma: ArrayLike,
    biases: ArrayLike,
    extras: tuple[bool, bool, bool],
    out: _Array | None = None,
) -> _Array: ...
def registration_eta(
    positions: ArrayLike,
    sensors: ArrayLike,
    sigma: ArrayLike,
    biases: ArrayLike,
    out: _Array | None = None,
) -> _Array: ...
def registration_running_eta(
    positions: ArrayLike,
    sensors: ArrayLike,
    sigma: ArrayLike,
    biases: ArrayLike,
    window: int | None,
    out: _Array | None = None,
) -> _Array: ...
def registration_pair_degrees(
    positions: ArrayLike,
    sensors: ArrayLike,
    sigma: ArrayLike,
    instants: Sequence[tuple[int, int]],
    whitened: bool,
    out: _Array | None = None,
) -> _Array: ...
def registration_reports(
    positions: ArrayLike,
    sensors: ArrayLike,
    sigma: ArrayLike,
    biases: ArrayLike,
    extras: tuple[bool, bool, bool],
) -> _Array: ...
def registration_places(
    reports: ArrayLike,
    sensors: ArrayLike,
    sigma: ArrayLike,
    biases: ArrayLike,
    extras: tuple[bool, bool, bool],
) -> _Array: ...
def registration_estimate(
    reports: ArrayLike,
    sensors: ArrayLike,
    sigma: ArrayLike,
    extras: tuple[bool, bool, bool],
    prior: ArrayLike | None,
    method: str,
    settings: tuple[int, float, float, float],
    keep_positions: bool,
) -> _Registered: ...
def registration_estimate_trials(
    positions: ArrayLike,
    sensors: ArrayLike,
    sigma: ArrayLike,
    biases: ArrayLike,
    extras: tuple[bool, bool, bool],
    prior: ArrayLike | None,
    method: str,
    settings: tuple[int, float, float, float],
    seed: int,
    first: int,
    trials: int,
) -> _Registered: ...

# inertial
EARTH_RATE: float

def inertial_radii(latitude: float) -> tuple[float, float]: ...
def inertial_gravity(latitude: float, height: float) -> float: ...
def inertial_rotation(heading: float, pitch: float, roll: float) -> _Array: ...
def inertial_combinations_at_rest(latitude: float, height: float, earth_rate: float) -> _Array: ...

_Wanted = tuple[ArrayLike, ArrayLike, Sequence[str], Sequence[str], float, bool]

def inertial_error_model(
    latitude: float,
    height: float,
    specific_force: ArrayLike | None,
    velocity: ArrayLike,
    attitude: ArrayLike,
    angular_rate: ArrayLike,
    wanted: _Wanted,
) -> tuple[_Array, _Array, _Array]: ...
def inertial_segments(
    legs: Sequence[Sequence[float]],
    start: Sequence[float],
    step: float,
    largest_turn: float,
    wanted: _Wanted,
) -> tuple[tuple[_Array, _Array, _Array], _Array, NDArray[np.uintp]]: ...
def inertial_recorded(
    times: ArrayLike,
    velocity: ArrayLike,
    angles: ArrayLike,
    legs: Sequence[int],
    place: Sequence[float],
    step: float,
    largest_turn: float,
    wanted: _Wanted,
) -> tuple[tuple[_Array, _Array, _Array], _Array, NDArray[np.uintp]]: ...
def inertial_sway(
    times: ArrayLike, amplitude: ArrayLike, period: ArrayLike, phase: ArrayLike
) -> _Array: ...

# dynamics
_Many = Callable[[_Array, _Array], _Array]

def dynamics_follow(
    rate: _Many,
    rate_jacobian: _Many | None,
    output: _Many,
    output_jacobian: _Many | None,
    outputs: int,
    scale: list[float],
    x0: list[float],
    times: list[float],
    rtol: float | None,
    most: int,
    names: list[str],
    takes_many: bool,
) -> tuple[_Array, _Array, _Array, _Array, _Array, _Array, int]: ...
def inertial_visual(
    times: list[float],
    gyro: list[float],
    accel: list[float],
    landmarks: list[float],
    mounting: list[float],
    start: list[float],
    unknown: list[str],
    rtol: float,
    most: int,
) -> tuple[list[float], tuple[_Array, _Array, _Array, _Array, _Array, _Array, int]]: ...
def dynamics_rows(
    transitions: ArrayLike,
    changes: ArrayLike,
    white: ArrayLike,
    errors: ArrayLike,
    first: int,
    last: int,
) -> tuple[_Array, _Array]: ...
def dynamics_windows(
    transitions: ArrayLike,
    changes: ArrayLike,
    white: ArrayLike,
    errors: ArrayLike,
    width: int,
    rtol: float | None,
    basis: ArrayLike | None,
) -> tuple[list[int], _Array, _Array, list[_Array]]: ...

# linear
def observability_matrix(
    a: ArrayLike, c: ArrayLike, order: int | None, out: _Array | None = None
) -> _Array: ...
def linear_levels(a: ArrayLike, c: ArrayLike, rtol: float | None) -> _Array: ...
def linear_gramian(
    a: ArrayLike,
    c: ArrayLike,
    q: ArrayLike | None,
    duration: float,
    samples: int | None,
    out: _Array | None = None,
) -> _Array: ...
def linear_transition(a: ArrayLike, duration: float) -> _Array: ...
def right_singular(rows: ArrayLike) -> tuple[_Array, _Array]: ...
def piecewise_ranks(
    a: ArrayLike, c: ArrayLike, durations: ArrayLike, rtol: float | None
) -> tuple[
    NDArray[np.uintp], NDArray[np.uintp], NDArray[np.uintp], list[bool], list[list[bool]], _Array
]: ...
def linear_infinite(a: ArrayLike, c: ArrayLike, discrete: bool) -> _Array: ...
def linear_hankel(observability: ArrayLike, reachability: ArrayLike) -> _Array: ...
def linear_parts(a: ArrayLike, c: ArrayLike) -> list[tuple[_Array, _Array]]: ...
def linear_balanced(a: ArrayLike, c: ArrayLike) -> tuple[_Array, _Array]: ...

@final
class LinearPencil:
    def __new__(cls, a: ArrayLike, c: ArrayLike) -> LinearPencil: ...
    @property
    def norm(self) -> float: ...
    def eigenvalues(self) -> _Array: ...
    def sigma(self, re: float, im: float) -> float: ...
    def distance(self) -> tuple[float, tuple[float, float], _Array, int]: ...
    def certify(
        self, slack: float, most: int
    ) -> tuple[tuple[float, tuple[float, float], _Array, int], float, bool]: ...

@final
class LinearUnobservable:
    def __new__(cls, a: ArrayLike, c: ArrayLike, rtol: float | None) -> LinearUnobservable: ...
    @property
    def margins(self) -> tuple[float, float, float]: ...
    @property
    def undecided(self) -> bool: ...
    @property
    def scales(self) -> tuple[list[float], float]: ...
    def null_space(self) -> _Array: ...
    def modes(self) -> list[tuple[float, float, float, _Array]]: ...
    def project(self, rows: ArrayLike) -> _Array: ...
    def left_by(self, outputs: ArrayLike) -> list[int]: ...

@final
class LinearAnalysis:
    def __new__(cls, a: ArrayLike, c: ArrayLike, rtol: float | None) -> LinearAnalysis: ...
    @property
    def rtol(self) -> float: ...
    @property
    def margins(self) -> tuple[float, float]: ...
    @property
    def growth(self) -> float: ...
    @property
    def undecided(self) -> bool: ...
    @property
    def rank(self) -> int: ...
    def ranks(self) -> list[int] | None: ...
    def state_levels(self) -> list[int | None] | None: ...
    def level_of(self, combination: ArrayLike, tolerance: float | None) -> int | None: ...
    def residuals(self, combination: ArrayLike) -> list[float]: ...
    def null_space(self) -> _Array: ...
    def combinations(self) -> list[_Array]: ...

# tracks
@final
class TrackCarrier:
    def __new__(
        cls,
        path: ArrayLike,
        times: ArrayLike | None,
        velocity: ArrayLike | None,
        heading: ArrayLike | float | None,
    ) -> TrackCarrier: ...
    def at(self, times: ArrayLike) -> tuple[_Array, _Array]: ...
    def headings(self, times: ArrayLike) -> _Array: ...

def track_statuses() -> list[str]: ...

@final
class TrackScene:
    def __new__(
        cls,
        dimension: int,
        motion: str,
        order: int,
        turns: Sequence[float] | None,
        unknown_turns: int,
        reference: float,
        nuisances: int,
        channels: Sequence[dict[str, object]],
        labels: Sequence[str],
    ) -> TrackScene: ...
    @property
    def states(self) -> int: ...
    @property
    def measurements(self) -> int: ...
    def rows(self, states: ArrayLike, out: _Array | None = None) -> _Array: ...
    def rounding(self, state: ArrayLike) -> _Array: ...
    def values(self, states: ArrayLike) -> _Array: ...
    def simulate(self, state: ArrayLike, seed: int, first: int, trials: int) -> _Array: ...
    def track(self, state: ArrayLike, times: ArrayLike) -> _Array: ...
    def slopes(self, state: ArrayLike, times: ArrayLike) -> _Array: ...
    def departures(
        self, measurements: ArrayLike, state: ArrayLike, turns: ArrayLike
    ) -> list[tuple[str, float, _Array]]: ...
    def linearize(self, measurements: ArrayLike, state: ArrayLike) -> tuple[_Array, _Array]: ...
    def model(self, measurements: ArrayLike) -> Model: ...
    def mirrored(self, state: ArrayLike) -> _Array | None: ...
    def starts(
        self, measurements: ArrayLike, known: ArrayLike, mean: ArrayLike, sigma: ArrayLike
    ) -> _Array: ...
    def estimate(
        self,
        measurements: ArrayLike,
        known: ArrayLike,
        mean: ArrayLike,
        sigma: ArrayLike,
        starts: ArrayLike | None,
        max_iterations: int,
        loss: str,
        constant: float,
        polish: int,
        rtol: float | None,
        alpha: float,
        weak_ratio: float,
        correlation: float,
    ) -> dict[str, _Array]: ...
