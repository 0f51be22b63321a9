"""Where a target is and how it moves, from its bearings: the most likely state."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns, columns_of_states
from gramian._arrays import (
    ITERATIONS_MOST,
    SEED_MOST,
    as_float_array,
    finite,
    number,
    whole,
    wrap_angles,
)
from gramian._noise import as_pair
from gramian._text import brief, plain
from gramian.estimation import Estimate, estimate
from gramian.estimation._channels import faulty
from gramian.estimation._parts import NEIGHBOURS, not_white
from gramian.exceptions import InputError
from gramian.models.bearings._model import BearingsModel, channels
from gramian.models.bearings._rows import check_index, state_names

__all__ = [
    "STATUSES",
    "Localizations",
    "Trials",
    "localize",
    "localize_many",
    "localize_trials",
    "residuals",
]

Array = NDArray[np.float64]

#: What a status code means; `Localizations.code` is the place in this tuple.
STATUSES = ("determined", "weak", "unobservable", "unbounded", "not_converged", "misfit")

#: Of these the extension finds all but the last, which is decided from the fit.
_MISFIT = STATUSES.index("misfit")
_UNOBSERVABLE = STATUSES.index("unobservable")


@dataclass(frozen=True, eq=False, repr=False)
class Localizations(Answer):
    """The answer of `localize_many`: an estimate of each record.

    Attributes
    ----------
    state : ndarray, shape (..., n)
        The most likely state at the first time, in the order of `names`; NaN
        where none exists (status "unobservable" and "unbounded").
    covariance : ndarray, shape (..., n, n)
        Inverse of the Fisher information there, `inf` where none exists.
    code : ndarray of int, shape (...)
        What became of each trial: the place in `STATUSES`.
    chi2 : ndarray, shape (...)
        Sum of the squared whitened residuals, those of the prior included; with
        a true model chi-square with `dof` degrees of freedom.
    dof : int
    iterations : ndarray of int, shape (...)
        Steps taken.
    nullity : ndarray of int, shape (...)
        Number of independent combinations that no bearing sees.
    null_direction : ndarray, shape (..., n)
        Where the nullity is not zero, one change of the states that leaves every
        bearing as it is, per metre of position; zero elsewhere.
    names, units : tuple of str, length n
    correlated : ndarray of bool, shape (...)
        Whether neighbouring residuals are correlated by more than noise leaves: a "misfit".
    faults : tuple of str
        Bearings that are stuck at one value, or those of another observer once more: a
        "misfit", whatever chi2 is. Of a batch with the place of the record.
    """

    state: Array
    covariance: Array
    code: NDArray[np.int8]
    chi2: Array
    dof: int
    iterations: NDArray[np.int32]
    nullity: NDArray[np.int32]
    null_direction: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    correlated: NDArray[np.bool_]
    faults: tuple[str, ...] = ()

    @property
    def status(self) -> str | NDArray[np.str_]:
        """The status in words: one of `STATUSES`, or an array of them."""
        words = np.array(STATUSES)[self.code]
        return str(words) if self.code.ndim == 0 else words

    @property
    def std(self) -> Array:
        """Standard deviation of each state, shape (..., n); `inf` where none exists."""
        std: Array = np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))
        return std

    @property
    def p_value(self) -> Array:
        """Probability of a larger `chi2` if the model is true, shape (...).

        Small values say that the target did not move as the model has it, or
        that the noise is larger than `sigma`. NaN without degrees of freedom.
        """
        if self.dof < 1:
            return np.full(self.chi2.shape, np.nan)
        return _core.chi_square_survival(self.chi2, self.dof)

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as plain lists, numbers and strings, fit for JSON."""
        status = self.status
        return {
            "status": status if isinstance(status, str) else status.tolist(),
            "names": list(self.names),
            "units": list(self.units),
            "state": _plain(self.state),
            "std": _plain(self.std),
            "covariance": _plain(self.covariance),
            "chi2": _plain(self.chi2),
            "dof": self.dof,
            "p_value": _plain(self.p_value),
            "iterations": self.iterations.tolist(),
            "nullity": self.nullity.tolist(),
            "null_direction": _plain(self.null_direction),
            "correlated": self.correlated.tolist(),
            "faults": list(self.faults),
        }

    def summary(self) -> str:
        """Return the estimate, or for a batch what became of its trials, as text."""
        if self.code.ndim:
            counts = np.bincount(self.code.ravel(), minlength=len(STATUSES))
            parts = [f"{n} {word}" for n, word in zip(counts, STATUSES, strict=True) if n]
            return f"{self.code.size} trials: {', '.join(parts)}"
        lines = [str(self.status).upper()]
        for name, unit, value, std in zip(
            self.names, self.units, self.state, self.std, strict=True
        ):
            known = "not determined" if np.isinf(std) else f"{value:.6g} +- {brief(std)} {unit}"
            lines.append(f"  {name}  {known}")
        lines.append(f"  residuals: chi2 {brief(self.chi2, 4)} with {self.dof} degrees of freedom")
        if self.correlated.any():
            lines.append("  neighbouring residuals are correlated")
        lines += [f"  {text}" for text in self.faults]
        return "\n".join(lines)

    def _as_table(self) -> Columns:
        others = {"status": self.status, "chi2": self.chi2, "p_value": self.p_value}
        return columns_of_states(
            self.names, self.units, {"": self.state, "std": self.std}, others, self.covariance
        )


@dataclass(frozen=True, eq=False, repr=False)
class Trials(Answer):
    """The answer of `localize_trials`, one entry for each trial.

    Attributes
    ----------
    error : ndarray, shape (trials, n)
        Estimate less truth; NaN where no estimate exists.
    std : ndarray, shape (trials, n)
        Deviations that the estimator itself states; `inf` where there are none.
    nees : ndarray, shape (trials,)
        error^T covariance^-1 error: chi-square with n degrees of freedom if the
        covariance tells the truth; NaN where no estimate exists.
    chi2 : ndarray, shape (trials,)
        As in `Localizations`.
    code : ndarray of int, shape (trials,)
        The place in `STATUSES`.
    iterations : ndarray of int, shape (trials,)
    """

    error: Array
    std: Array
    nees: Array
    chi2: Array
    code: NDArray[np.int8]
    iterations: NDArray[np.int32]

    def _as_table(self) -> Columns:
        n = self.error.shape[-1]
        names, units = (f"x{i}" for i in range(n)), ("",) * n
        values = {"error": self.error, "std": self.std}
        others = {"nees": self.nees, "chi2": self.chi2, "status": np.array(STATUSES)[self.code]}
        return columns_of_states(tuple(names), units, values, others)


def localize(
    times: ArrayLike,
    bearings: ArrayLike,
    observer: ArrayLike,
    sigma: ArrayLike,
    prior: Mapping[str, tuple[float, float]] | None = None,
    *,
    order: int = 1,
    observer_index: ArrayLike | None = None,
    **options: Any,
) -> Estimate:
    """Return the most likely state of a moving target, and whether it may be believed.

    Parameters
    ----------
    times : array_like, shape (m,)
        Increasing, seconds.
    bearings : array_like, shape (m,)
        Clockwise from north, radians; whole turns do not matter. Where some are beyond 2 pi and
        the model does not fit, a warning asks whether they are degrees.
    observer : array_like, shape (m, 2)
        Observer positions (east, north), metres.
    sigma : array_like, shape () or (m,)
        Standard deviation of the bearings, radians, > 0.
    prior : mapping of str to (mean, sigma), optional
        What is known of states beforehand: ``{"vx": (3.0, 0.5)}``.
    order : int
        The target's position is a polynomial in time of this order: 0 at rest,
        1 at constant velocity, 2 accelerated, 3 with constant jerk.
    observer_index : array_like of int, shape (m,), optional
        For bearings of several observers, which one took each. Times of
        different observers may then coincide.
    **options
        As for `gramian.estimate`: a start, a box, a robust loss, levels.

    Returns
    -------
    gramian.estimation.Estimate
        With its fit, other solutions, and intervals and regions of the likelihood; its
        interval of "range" is that of the first range. The status is "unobservable" where a
        combination of states leaves all bearings as they are: `null_combinations` has it.

    Raises
    ------
    InputError
        Shapes that do not fit, numbers that are not finite, times that do not
        increase, a sigma that is not positive, too few bearings for the order.

    See Also
    --------
    localize_many : Many records at once, without other solutions and intervals.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(0.0, 600.0, 20.0)
    >>> path = np.stack([np.maximum(0, 5 * (t - 300)), np.minimum(5 * t, 1500)], axis=1)
    >>> seen = gm.bearings.simulate(t, path, [2000, 6000, 3, -1], 1e-3, seed=2)
    >>> answer = localize(t, seen, path, 1e-3)
    >>> answer.status, answer.contains([2000, 6000, 3, -1])
    ('determined', True)
    """
    when, path, z = (
        finite(times, "times"),
        finite(observer, "observer"),
        finite(bearings, "bearings"),
    )
    if when.ndim != 1 or z.shape != when.shape:
        raise InputError(
            f"times has shape {when.shape}, bearings {z.shape}: must be (m,) both; "
            "localize_many takes batches"
        )
    if path.ndim != 2:
        raise InputError(f"observer has shape {path.shape}: must be (m, 2), one track")
    states = len(state_names(order)[0])
    if prior is None or isinstance(prior, Mapping):
        check_count(z.size, order, min(len(prior or {}), states))
    index = check_index(when, observer_index)
    if index is None:
        check_index(when, np.zeros(when.size, dtype=int))
    deviations = np.atleast_1d(finite(sigma, "sigma [rad]"))
    model = BearingsModel(when, path, deviations, order, index)
    model.handle(z)
    answer = estimate(model, z, prior=prior, **options)
    if answer.status == "misfit" and (largest := float(np.abs(z).max())) > 2 * np.pi:
        warnings.warn(
            f"bearings reach {brief(largest, 4)} rad and do not fit: they must be in radians; "
            "are these degrees?",
            UserWarning,
            stacklevel=2,
        )
    return answer


def localize_many(
    times: ArrayLike,
    bearings: ArrayLike,
    observer: ArrayLike,
    sigma: ArrayLike,
    prior: Mapping[str, tuple[float, float]] | None = None,
    *,
    order: int = 1,
    observer_index: ArrayLike | None = None,
    weak_ratio: float = 0.25,
    max_iterations: int = 50,
    rtol: float | None = None,
    alpha: float = 0.001,
) -> Localizations:
    """Return the most likely states of many records at once, with their covariances.

    Parameters
    ----------
    times : array_like, shape (..., m)
        Increasing, seconds.
    bearings : array_like, shape (..., m)
        Clockwise from north, radians; whole turns do not matter.
    observer : array_like, shape (..., m, 2)
        Observer positions (east, north), metres.
    sigma : array_like, shape () or (..., m)
        Standard deviation of the bearings, radians, > 0.
    prior : mapping of str to (mean, sigma), optional
        What is known of states beforehand: ``{"vx": (3.0, 0.5)}``.
    order : int
        The target's position is a polynomial in time of this order: 0 at rest,
        1 at constant velocity, 2 accelerated, 3 with constant jerk.
    observer_index : array_like of int, shape (m,), optional
        For bearings of several observers, which one took each. Times of
        different observers may then coincide.
    weak_ratio : float
        "weak" where the deviation of the first range exceeds this many times it.
    max_iterations : int
    rtol : float, optional
        Relative tolerance of the rank decision; by default what rounding of the
        coordinates calls for.
    alpha : float
        "misfit" where a true model gives so large a chi-square with a smaller
        probability than this, in (0, 1), or neighbouring residuals so correlated with a
        tenth of it.

    Returns
    -------
    Localizations
        Leading axes are a batch, computed by all threads. Look at each status: "determined";
        "weak", a state whose range is hardly known; "unbounded", the likelihood grows towards
        infinite range; "not_converged", the iterations ran out; "misfit", the bearings
        contradict the motion or their sigma, or have neighbours whose residuals are
        correlated, or are stuck at one value, which outranks these;
        "unobservable", a combination of states leaves all bearings as they are. Other
        solutions and intervals of the likelihood: `localize`, of one record.

    Raises
    ------
    InputError
        Shapes that do not fit, numbers that are not finite, times that do not
        increase, a sigma that is not positive, too few bearings for the order.

    Notes
    -----
    Newton's method on the direction, the derivatives over the range, and the
    reciprocal range, in which bearings are nearly linear; damped Gauss-Newton
    where a Newton step does not exist. The start is the pseudo-linear solution
    of Li & Sheng 2009, eq. (3), made consistent: the bias that noise brings
    into its squares is taken out by a generalised eigenvector. A ladder of
    ranges is tried where that fails.

    Bearings alone tell the motion relative to an observer on a straight line,
    but for its scale: then the null direction is the relative position and
    velocity themselves. What is far away, or hardly out-maneuvered, is "weak"
    long before; its covariance, which takes the problem as linear, is a hint.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(0.0, 600.0, 20.0)
    >>> path = np.stack([np.maximum(0, 5 * (t - 300)), np.minimum(5 * t, 1500)], axis=1)
    >>> seen = gm.bearings.simulate(t, path, [2000, 6000, 3, -1], 1e-3, seed=1, trials=3)
    >>> answer = localize_many(t, seen, path, 1e-3)
    >>> bool((abs(answer.state - [2000, 6000, 3, -1]) < 4 * answer.std).all())
    True
    >>> answer.summary()
    '3 trials: 3 determined'
    """
    names, units = state_names(order)
    n = len(names)
    seen = as_float_array(bearings, "bearings")
    max_iterations = _check_options(weak_ratio, max_iterations, rtol)
    options.fraction(alpha, "alpha")
    known = _prior(prior, names, units)
    check_count(seen.shape[-1] if seen.ndim else 0, order, len(prior or {}))
    index = check_index(times, observer_index)
    found = _core.bearings_localize(
        times,
        observer,
        seen,
        sigma,
        n,
        known,
        index is not None,
        rtol,
        max_iterations,
        weak_ratio,
        NEIGHBOURS * alpha,
    )
    # Beyond what float64 holds the sum of squares is infinite, whatever it went through.
    chi2 = np.where(np.isnan(found["chi2"]), np.inf, found["chi2"])
    dof = seen.shape[-1] + len(prior or {}) - n
    p_value = _core.chi_square_survival(chi2, dof) if dof > 0 else np.full(chi2.shape, np.nan)
    bad, faults = faulty(seen, sigma, channels(as_float_array(times, "times"), index), p_value)
    correlated = np.asarray(not_white(dof, p_value, found["lag_p_value"], alpha))
    code = np.asarray(_judged(found["status"].astype(np.int8), p_value, bad | correlated, alpha))
    return Localizations(
        state=found["state"],
        covariance=found["covariance"],
        code=code,
        chi2=chi2,
        dof=dof,
        iterations=found["iterations"].astype(np.int32),
        nullity=found["nullity"].astype(np.int32),
        null_direction=found["null_direction"],
        names=names,
        units=units,
        correlated=correlated,
        faults=faults if (code == _MISFIT).any() else (),
    )


def _judged(
    code: NDArray[np.int8], p_value: Array, wrong: NDArray[np.bool_], alpha: float
) -> NDArray[np.int8]:
    """Return the codes with what does not fit marked: it outranks all that trust the model."""
    with np.errstate(invalid="ignore"):
        bad = ((p_value < alpha) | wrong) & (code != _UNOBSERVABLE)
    return np.where(bad, np.int8(_MISFIT), code)


def localize_trials(
    times: ArrayLike,
    observer: ArrayLike,
    target: ArrayLike,
    sigma: ArrayLike,
    *,
    trials: int,
    seed: int,
    first: int = 0,
    prior: Mapping[str, tuple[float, float]] | None = None,
    observer_index: ArrayLike | None = None,
    weak_ratio: float = 0.25,
    max_iterations: int = 50,
    rtol: float | None = None,
) -> Trials:
    """Simulate bearings and estimate the target from them, many times in one pass.

    Parameters
    ----------
    times, observer, sigma, prior, observer_index, weak_ratio, max_iterations, rtol
        As for `localize`; leading axes, if any, have the length `trials`.
    target : array_like, shape (n,) or (trials, n)
        The true state: 2, 4, 6 or 8 numbers for a motion of order 0 to 3.
    trials : int
    seed : int
        >= 0. Trial i takes its noise from (seed, first + i) alone: the same
        noise as trial i of `simulate`, whatever the number of threads, and
        however a run is cut into pieces.
    first : int
        Number of the first trial, to continue or to divide a run.

    Returns
    -------
    Trials

    Raises
    ------
    InputError
        As `localize`; also an observer on the target.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0.0, 600.0, 20.0)
    >>> path = np.stack([np.maximum(0, 5 * (t - 300)), np.minimum(5 * t, 1500)], axis=1)
    >>> run = localize_trials(t, path, [2000, 6000, 3, -1], 1e-3, trials=1000, seed=1)
    >>> bool(abs(run.nees.mean() - 4) < 0.4)
    True
    """
    seed, first = whole(seed, "seed", 0, SEED_MOST), whole(first, "first")
    trials = whole(trials, "trials", 1)
    truth = as_float_array(target, "target")
    n = truth.shape[-1] if truth.ndim else 0
    if n not in (2, 4, 6, 8):
        raise InputError(
            f"target has shape {truth.shape}: must be (..., n), a state of 2, 4, 6 or 8 numbers"
        )
    names, units = state_names(n // 2 - 1)
    max_iterations = _check_options(weak_ratio, max_iterations, rtol)
    known = _prior(prior, names, units)
    when = as_float_array(times, "times")
    check_count(when.shape[-1] if when.ndim else 0, n // 2 - 1, len(prior or {}))
    check_index(when, observer_index)
    if not (as_float_array(sigma, "sigma [rad]") < 1e15).all():
        raise InputError("sigma: must be below 1e15 rad, or no angle is left")
    found = _core.bearings_localize_trials(
        when,
        observer,
        truth,
        sigma,
        seed,
        first,
        trials,
        known,
        observer_index is not None,
        rtol,
        max_iterations,
        weak_ratio,
    )
    return Trials(
        error=found["error"],
        std=found["std"],
        nees=found["nees"],
        chi2=found["chi2"],
        code=found["status"].astype(np.int8),
        iterations=found["iterations"].astype(np.int32),
    )


def residuals(
    times: ArrayLike, bearings: ArrayLike, observer: ArrayLike, state: ArrayLike
) -> Array:
    """Return measured less predicted bearings, in (-pi, pi].

    Parameters
    ----------
    times, bearings, observer
        As for `localize`.
    state : array_like, shape (..., n)
        The target's state at the first time, of order n/2 - 1.

    Returns
    -------
    ndarray, shape (..., m)

    Examples
    --------
    >>> residuals([0.0, 10.0], [0.1, 0.1], [[0, 0], [0, 0]], [0, 1000, 0, 0])
    array([0.1, 0.1])
    """
    t, x = finite(times, "times"), finite(state, "state")
    seen, path = finite(bearings, "bearings"), finite(observer, "observer")
    if x.ndim == 0 or x.shape[-1] not in (2, 4, 6, 8):
        raise InputError(f"state has shape {x.shape}: must be (..., n), 2, 4, 6 or 8 numbers")
    m = t.shape[-1] if t.ndim else 0
    if m == 0 or seen.shape[-1:] != (m,) or path.shape[-2:] != (m, 2):
        raise InputError(
            f"times has shape {t.shape}, bearings {seen.shape}, observer {path.shape}: "
            "must be (..., m), (..., m) and (..., m, 2)"
        )
    since = t - t[..., :1]
    place = np.zeros((*np.broadcast_shapes(t.shape[:-1], x.shape[:-1]), t.shape[-1], 2))
    power = np.ones_like(since)
    for k in range(x.shape[-1] // 2):
        place = place + power[..., None] * x[..., None, 2 * k : 2 * k + 2]
        power = power * since / (k + 1)
    offset = place - path
    return wrap_angles(seen - np.arctan2(offset[..., 0], offset[..., 1]))


def check_count(count: int, order: int, known: int) -> None:
    states = 2 * (order + 1)
    wanted = max(1, states - known)
    if count < wanted:
        raise InputError(
            f"{count} bearings: a target of order {order} has {states} states"
            + (f", {known} with a prior," if known else "")
            + f" and needs at least {wanted} bearings"
        )


def _check_options(weak_ratio: float, max_iterations: int, rtol: float | None) -> int:
    """Check the options of the search; return `max_iterations` as a whole number."""
    if not number(weak_ratio, "weak_ratio") > 0:
        raise InputError(f"weak_ratio = {weak_ratio}: must be > 0")
    if rtol is not None:
        options.fraction(rtol, "rtol")
    return whole(max_iterations, "max_iterations", 1, ITERATIONS_MOST)


def _prior(
    prior: Mapping[str, tuple[float, float]] | None,
    names: tuple[str, ...],
    units: tuple[str, ...],
) -> tuple[Array, Array] | None:
    if prior is None or not options.mapping(prior, "prior", "name to (mean, sigma)"):
        return None
    mean, sigma = np.zeros(len(names)), np.full(len(names), np.inf)
    for name, given in prior.items():
        if name not in names:
            raise InputError(f"prior of {name!r}: the states are {', '.join(names)}")
        k = names.index(name)
        mean[k], sigma[k] = as_pair(given, f"prior of {name}", units[k])
    return mean, sigma


def _plain(values: Array) -> Any:
    return plain(values) if values.ndim else plain(float(values))
