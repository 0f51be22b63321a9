"""What a Monte Carlo run is made of: something that can simulate its measurements."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import SEED_MOST, whole
from gramian._compiled import CompiledFunction
from gramian._noise import Knowledge, as_knowledge
from gramian.exceptions import InputError, UnobservableError
from gramian.model import Model
from gramian.problem import Problem

__all__ = ["Estimates", "Experiment", "Linear", "Measurements", "fingerprint", "normals"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Estimates:
    """What a built-in estimator found in some trials.

    Attributes
    ----------
    errors : ndarray, shape (trials, n)
        Estimate minus truth.
    nees : ndarray, shape (trials,), or None
        Normalised squared error by the covariance that the estimator claims, NaN
        where there is none; None to have it by the bound.
    status : ndarray of int, shape (trials,)
        0 for success, otherwise a key of `kinds`.
    kinds : mapping of int to str
        What each other status means: "not converged".
    """

    errors: Array
    nees: Array | None
    status: NDArray[np.integer[Any]]
    kinds: Mapping[int, str]


class Experiment(ABC):
    """The protocol of a Monte Carlo experiment: derive from it for one of your own.

    A subclass must have `names`, `truth` and `simulate`; a `problem` gives the
    bound beside. A frozen dataclass whose fields are numbers, strings and arrays
    does all else by itself: it can be sent to another process and be recognised
    when a run is resumed.

    Attributes
    ----------
    estimators : tuple of str
        Names of estimators that `estimate` runs; the first is the default.
    quantities : tuple of str
        Names of numbers that `quantity` computes from a trial's measurements.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import numpy as np, gramian as gm
    >>> @dataclass(frozen=True)
    ... class Level(gm.monte_carlo.Experiment):
    ...     samples: int
    ...     names = ("level",)
    ...     truth = np.array([3.0])
    ...     def simulate(self, seed, first, trials):
    ...         return 3.0 + gm.monte_carlo.normals(seed, first, trials, self.samples)
    ...     def problem(self):
    ...         return gm.Problem(np.ones((self.samples, 1)), self.names)
    >>> result = gm.monte_carlo.run(Level(10), 1000, seed=1, estimator=lambda z: [z.mean()])
    >>> bool(abs(result.efficiency[0] - 1) < 0.06)
    True
    """

    estimators: ClassVar[tuple[str, ...]] = ()
    quantities: ClassVar[tuple[str, ...]] = ()
    names: Any
    """The states, a sequence of str."""
    truth: Any
    """Their true values, array_like, shape (n,)."""

    @abstractmethod
    def simulate(self, seed: int, first: int, trials: int) -> Any:
        """Return the measurements of the trials `first` to `first + trials - 1`.

        Indexed by trial: an array (trials, ...) or a list. Trial i must depend on
        (seed, i) alone; `normals` gives such numbers.
        """

    @property
    def units(self) -> Sequence[str]:
        """The units of the states."""
        return ("",) * len(self.names)

    @property
    def cost(self) -> float:
        """What a trial of the built-in estimator takes, roughly, in seconds: sets the chunks."""
        return 1e-5

    def problem(self) -> Problem | None:
        """Return the problem at the truth, for the bound; None for no bound."""
        return None

    def estimate(self, name: str, seed: int, first: int, trials: int) -> Estimates:
        """Run a built-in estimator, simulation included."""
        raise NotImplementedError(f"{type(self).__name__} has no estimator {name!r}")

    def quantity(self, name: str, seed: int, first: int, trials: int) -> Array:
        """Compute a built-in quantity, simulation included, shape (trials,)."""
        raise NotImplementedError(f"{type(self).__name__} has no quantity {name!r}")


def squared_over(errors: Array, covariance: Array) -> Array:
    """Return e^T C^-1 e of errors (trials, n), with covariances (n, n) or one each.

    NaN where a covariance is not positive definite.
    """
    # States of very different size: scaled, the factorisation keeps its digits.
    scale = np.sqrt(np.abs(np.diagonal(covariance, axis1=-2, axis2=-1)))
    scale = np.where(scale > 0, scale, 1.0)
    scaled = np.nan_to_num(covariance / (scale[..., :, None] * scale[..., None, :]))
    whole = np.linalg.eigvalsh(scaled)[..., 0] > 0
    usable = np.where(whole[..., None, None], scaled, np.eye(errors.shape[-1]))
    vectors = errors / scale
    # No sum depends on how many trials there are: one system for each, or the inverse of
    # the one covariance taken column by column.
    if usable.ndim == 2:
        solved: NDArray[np.floating[Any]] = np.zeros_like(vectors)
        for j, column in enumerate(np.linalg.inv(usable).T):
            solved += vectors[:, j : j + 1] * column
    else:
        solved = np.linalg.solve(usable, vectors[..., None])[..., 0]
    squares: Array = np.where(whole, (vectors * solved).sum(axis=-1), np.nan)
    return squares


def normals(seed: int, first: int, trials: int, count: int) -> Array:
    """Return standard normal numbers that depend on (seed, trial) alone.

    Parameters
    ----------
    seed : int
        >= 0.
    first, trials : int
        The trials from `first` on.
    count : int
        Numbers for each trial.

    Returns
    -------
    ndarray, shape (trials, count)

    Examples
    --------
    >>> bool((normals(7, 0, 10, 3)[4:6] == normals(7, 4, 2, 3)).all())
    True
    """
    return _core.normals(
        whole(seed, "seed", 0, SEED_MOST),
        whole(first, "first"),
        whole(trials, "trials"),
        whole(count, "count"),
    )


@dataclass(frozen=True, eq=False)
class Linear(Experiment):
    """The linear (or linearised) experiment of a `Problem`: z = A x + unit normal noise.

    Priors are measurements like others, drawn anew in each trial. The truth is
    zero: an estimate is an error.

    Parameters
    ----------
    of : Problem
    """

    of: Problem
    estimators: ClassVar[tuple[str, ...]] = ("least_squares",)

    def __post_init__(self) -> None:
        options.instance(self.of, Problem, "of", "a Problem")

    @property
    def names(self) -> tuple[str, ...]:
        """The states of the problem."""
        return self.of.names

    @property
    def units(self) -> tuple[str, ...]:
        """Their units."""
        return self.of.units

    @property
    def truth(self) -> Array:
        """Zero."""
        return np.zeros(self.of.n)

    def problem(self) -> Problem:
        """Return the problem itself."""
        return self.of

    def simulate(self, seed: int, first: int, trials: int) -> Array:
        """Return whitened measurements (trials, rows)."""
        return normals(seed, first, trials, len(self.of.all_rows))

    def estimate(self, name: str, seed: int, first: int, trials: int) -> Estimates:
        """Return the least-squares errors."""
        rows = self.of.all_rows
        scale = np.linalg.norm(rows, axis=0)
        q, r = np.linalg.qr(rows / scale)
        projected = np.empty((trials, 1, len(scale)))
        # Not all measurements of a large chunk at once.
        block = max(1, 2**17 // len(rows))
        for start in range(0, trials, block):
            part = projected[start : start + block]
            # A product for each trial: one of all together would round differently
            # for another chunk size.
            np.matmul(self.simulate(seed, first + start, len(part))[:, None, :], q, out=part)
        errors = (projected @ np.linalg.inv(r).T)[:, 0] / scale
        nees = (projected**2).sum(axis=(1, 2))
        return Estimates(errors, nees, np.zeros(trials, dtype=np.int16), {})


@dataclass(frozen=True, eq=False)
class Measurements(Experiment):
    """The experiment of a measurement function of your own: a `Model` at its `x`.

    Parameters
    ----------
    of : Model
        Of `from_function`; its `x` is the truth.
    prior : mapping, array_like or tuple, optional
        What the estimator knows beforehand, as for `gramian.estimate`; means are drawn
        anew around the truth in each trial.

    Notes
    -----
    Estimator "ml": `gramian.estimate` from the truth, without a search for other
    solutions; its NEES is by the covariance at the estimate. Of a compiled measurement function
    (`from_function`) with independent noise all of it runs in Rust, on threads: more than
    twenty times as many trials a second. Differences keep the steps found at the truth then.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> beacons = np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]])
    >>> ranges = lambda p: np.hypot(*(beacons - p).T)
    >>> model = gm.from_function(ranges, [30.0, 40.0], 1.0, ["east", "north"])
    >>> result = gm.monte_carlo.run(model, 200, seed=1)
    >>> bool((abs(result.efficiency - 1) < 0.2).all())
    True
    """

    of: Model
    prior: Any = None
    estimators: ClassVar[tuple[str, ...]] = ("ml",)

    def __post_init__(self) -> None:
        if not isinstance(self.of, Model):
            raise InputError(
                f"of is a {type(self.of).__name__}: must be a model of gramian.from_function"
            )
        # Checks everything else.
        self.problem()

    @property
    def names(self) -> tuple[str, ...]:
        """The states of the model."""
        return self.of.names

    @property
    def units(self) -> tuple[str, ...]:
        """Their units."""
        return self.of.units

    @property
    def truth(self) -> Array:
        """The model's own state."""
        if self.of.x is None:
            raise InputError("the model has no x to be the truth: give it with model.at(x)")
        return self.of.x

    @property
    def cost(self) -> float:
        """A trial takes some ten Jacobians: of a function in Python a millisecond."""
        return 1e-3 if self.of.compiled is None else 2e-5

    def problem(self) -> Problem:
        """Return the problem at the truth."""
        problem = self.of.problem(self.truth)
        return problem if self.prior is None else problem.prior(self.prior)

    def simulate(self, seed: int, first: int, trials: int) -> Array:
        """Return measurements (trials, m), NaN where one is missing."""
        return self.of.simulate(self.truth, seed, trials, first)

    def estimate(self, name: str, seed: int, first: int, trials: int) -> Estimates:
        """Return the maximum-likelihood errors."""
        if name != "ml":
            return super().estimate(name, seed, first, trials)
        return _maximum_likelihood(self, seed, first, trials)


def _maximum_likelihood(experiment: Measurements, seed: int, first: int, trials: int) -> Estimates:
    from gramian.estimation._knowledge import informed

    model, truth = experiment.of, experiment.truth
    n = len(truth)
    errors = np.full((trials, n), np.nan)
    nees = np.full(trials, np.nan)
    status = np.zeros(trials, dtype=np.int16)
    known = as_knowledge(
        experiment.prior, model.names, model.combinations, units=tuple(model.units)
    )
    # Streams of their own for the means: past all trials of the measurements.
    drawn = normals(seed, first + 2**62, trials, len(known.rows)) * known.sigma
    if (h := model.compiled) is not None:
        measured = experiment.simulate(seed, first, trials)
        told = _without_interpreter(h, model, measured, known, known.rows @ truth + drawn)
        return Estimates(told[:, 2:], told[:, 1], told[:, 0].astype(np.int16), KINDS)
    for k, z in enumerate(experiment.simulate(seed, first, trials)):
        prior = replace(known, mean=known.rows @ truth + drawn[k])
        handle = informed(model, z, prior, {})
        found = handle.minimize(truth[None], ("squares", 0.0), 100)
        if not found or not found[0]["converged"]:
            status[k] = 2
            continue
        x = found[0]["x"]
        analysis = _core.Analysis(handle.linearize(x)[1], None)
        covariance = analysis.crlb()
        if covariance is None:
            status[k] = 1
            continue
        errors[k] = x - truth
        nees[k] = squared_over(errors[k][None], covariance)[0]
    return Estimates(errors, nees, status, KINDS)


#: What became of a trial of `Measurements` that has no estimate.
KINDS = {1: "unobservable", 2: "not_converged"}


def _without_interpreter(
    h: CompiledFunction, model: Model, z: Array, known: Knowledge, means: Array
) -> Array:
    """Return status, NEES and errors (trials, 2 + n) of a compiled model at its x."""
    # Differences with the steps, and above the noise, that were found at the truth.
    accuracy, noise = model.accuracy, model.noise
    step = np.full(model.n, np.nan) if accuracy.step is None else accuracy.step
    rounding = np.full(z.shape[1], np.nan) if accuracy.noise is None else accuracy.noise
    periods = np.zeros(z.shape[1]) if model.periods is None else model.periods
    return h.maximum_likelihood(
        model.x, z, noise.root, periods, step, rounding, known.rows, means, known.sigma
    )


def as_experiment(problem: Experiment | Problem | Model) -> Experiment:
    """Return the experiment, checked; a `Problem` as its linear one, a `Model` as its own."""
    if isinstance(problem, Problem):
        experiment: Experiment = Linear(problem)
    elif isinstance(problem, Model):
        experiment = Measurements(problem)
    elif isinstance(problem, Experiment):
        experiment = problem
    else:
        raise InputError(
            f"problem is a {type(problem).__name__}: must be a gramian.Problem, a gramian.Model "
            "or a gramian.monte_carlo.Experiment (Bearings, Dipole, Registration, Measurements, "
            "or a class of yours derived from Experiment)"
        )
    names = tuple(experiment.names)
    truth = np.asarray(experiment.truth, dtype=float)
    if not names or truth.shape != (len(names),):
        raise InputError(
            f"truth has shape {truth.shape}: must be ({len(names)},), one for each of the states "
            f"{', '.join(names)}"
        )
    if not np.isfinite(truth).all():
        raise InputError(f"truth = {truth}: must be finite")
    return experiment


def bound_of(
    experiment: Experiment, *, must_exist: bool = False
) -> tuple[Array | None, Array | None]:
    """Return the bound's deviations (n,) and covariance (n, n), as far as they exist.

    With `must_exist` states that cannot be observed are refused.
    """
    from gramian.bounds import crlb, crlb_std

    problem = experiment.problem()
    if problem is None:
        return None, None
    if tuple(problem.names) != tuple(experiment.names):
        raise InputError(
            f"the problem has the states {', '.join(problem.names)}, the experiment "
            f"{', '.join(experiment.names)}: must be the same"
        )
    try:
        covariance = crlb(problem)
    except UnobservableError as error:
        if must_exist:
            raise UnobservableError(
                f"no estimator can find these states: {error}", error.null_combinations
            ) from None
        covariance = None
    return crlb_std(problem), covariance


def fingerprint(value: Any) -> str:
    """Return a digest of what a value is made of, the same in every process.

    Arrays, numbers, strings, containers, dataclasses and plain objects go by
    their contents; a function by its name, source, defaults and closure (not by
    the globals it uses).
    """
    import hashlib

    digest = hashlib.sha256()
    _digest(digest, value, 0)
    return digest.hexdigest()[:32]


def _digest(digest: Any, value: Any, depth: int) -> None:
    if depth > 12:
        return
    label, parts = _plain_parts(value) or _callable_parts(value) or _object_parts(value)
    digest.update(label.encode() + b"\0")
    for part in parts:
        if isinstance(part, bytes):
            digest.update(part)
        else:
            _digest(digest, part, depth + 1)


Parts = tuple[str, Sequence[Any]]


def _plain_parts(value: Any) -> Parts | None:
    if value is None or isinstance(value, (bool, int, float, complex, str)):
        return type(value).__name__, [repr(value).encode()]
    if isinstance(value, (np.ndarray, np.generic)) and value.dtype != object:
        array = np.ascontiguousarray(value)
        return f"array {array.dtype} {array.shape}", [array.tobytes()]
    if isinstance(value, np.ndarray):
        return f"objects {value.shape}", value.ravel().tolist()
    if isinstance(value, Mapping):
        keys = sorted(value, key=repr)
        return f"mapping {len(keys)}", [item for key in keys for item in (key, value[key])]
    if isinstance(value, (list, tuple)):
        return f"sequence {len(value)}", list(value)
    return None


def _callable_parts(value: Any) -> Parts | None:
    if isinstance(value, partial):
        return "partial", [value.func, value.args, value.keywords]
    if inspect.ismethod(value):
        return f"method {value.__name__}", [value.__self__]
    if inspect.isfunction(value):
        try:
            text = inspect.getsource(value)
        except (OSError, TypeError):
            text = value.__code__.co_code.hex()
        cells = [cell.cell_contents for cell in value.__closure__ or ()]
        return f"function {value.__qualname__}", [
            text,
            value.__defaults__,
            value.__kwdefaults__,
            cells,
        ]
    if isinstance(value, type) or inspect.isbuiltin(value):
        return f"named {value.__module__} {value.__qualname__}", []
    return None


def _object_parts(value: Any) -> Parts:
    label = f"object {type(value).__qualname__}"
    if is_dataclass(value):
        return label, [(f.name, getattr(value, f.name)) for f in fields(value)]
    return label, [getattr(value, "__dict__", {})]
