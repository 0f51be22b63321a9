"""From measurements to states, and whether the answer may be believed.

`estimate` finds the most likely state of a model; its answer, an `Estimate`, says how
well the model fits, which other states fit as well, and how large the region of likely
states is. `other_solutions` asks the same of a state without measurements.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns, columns_of_states
from gramian._arrays import SEED_MOST, finite, number, real, whole
from gramian._handle import EstimationModel, as_model, handle_of
from gramian._noise import (
    Knowledge,
    as_box,
    as_knowledge,
    as_known,
    as_pair,
    negligible,
)
from gramian._registry import draw
from gramian._text import brief, describe_combination, describe_direction
from gramian._text import number as readable
from gramian._values import Value
from gramian.exceptions import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "STATUSES",
    "Alternative",
    "Channel",
    "Estimate",
    "EstimationModel",
    "Fit",
    "Interval",
    "Region",
    "Solution",
    "Trials",
    "channel_faults",
    "estimate",
    "estimate_trials",
    "other_solutions",
]

Array = NDArray[np.float64]
Status = Literal["unobservable", "misfit", "not_converged", "ambiguous", "weak", "determined"]

#: Every status of an `Estimate`, worst first.
STATUSES = ("unobservable", "misfit", "not_converged", "ambiguous", "weak", "determined")

#: Residuals whose p is larger are too small.
_SMALL = 0.999

#: Of a batch the faults of so many records are told in words.
_TOLD = 20

#: How residuals may count, with the constants of 95 % efficiency on normal noise.
_LOSSES = {"squares": 0.0, "huber": 1.345, "tukey": 4.685}


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Answer):
    """Another state that fits.

    Attributes
    ----------
    state : ndarray, shape (n,)
    chi2 : float
        Sum of its squared whitened residuals.
    distance : float
        |h(other) - h(best)|, whitened: how many deviations apart their exact data are.
    chance : float
        The chance that noise prefers the wrong one of the two.
    hits : int
        How many of the starts reached it.
    """

    state: Array
    chi2: float
    distance: float
    chance: float
    hits: int


@dataclass(frozen=True, eq=False, repr=False)
class Alternative(Answer):
    """What a test says of one way in which the model may be wrong.

    Attributes
    ----------
    name : str
    p_value : float
        Probability of as large a statistic where the model is true.
    restored : float
        p of the fit with the alternative in the model.
    size : ndarray, shape (parameters,)
        Its parameters that fit best.
    detectable : float
        The smallest size that is seen with 80 % power; `inf` where it leaves no trace,
        or has several parameters.
    effect : ndarray, shape (n,)
        What that size does to each state: the external reliability.
    alike : tuple of str
        Alternatives that the residuals cannot tell from it (correlation above 0.9).
    dof : int
        Parameters that leave a trace outside the model's columns.
    unit : str
        Of the parameters and of `detectable`; empty where the model gives none.
    """

    name: str
    p_value: float
    restored: float
    size: Array
    detectable: float
    effect: Array
    alike: tuple[str, ...]
    dof: int = 1
    unit: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Answer):
    """How well the model fits.

    Attributes
    ----------
    chi2 : float
        Sum of the squared whitened residuals, those of priors included.
    dof : int
        Measurements and priors less states.
    p_value : float
        Probability of a larger chi2 if the model is true; NaN without degrees of freedom.
    residuals : ndarray, shape (m,)
        Whitened residuals in the order of the measurements.
    standardized : ndarray, shape (m,)
        The same over their own deviations after the fit: standard normal each.
    lag1 : tuple of float
        Correlation of neighbouring residuals; its mean and standard deviation for a true
        model after this fit; the probability of a larger one.
    alternatives : tuple of Alternative
        What would explain a misfit, the likeliest first.
    faults : tuple of str
        Channels that are dead, stuck or doubled, in words.
    """

    chi2: float
    dof: int
    p_value: float
    residuals: Array
    standardized: Array
    lag1: tuple[float, float, float, float]
    alternatives: tuple[Alternative, ...] = ()
    faults: tuple[str, ...] = ()

    @property
    def outliers(self) -> NDArray[np.int64]:
        """Measurements whose residual one honest record in a hundred would exceed."""
        from scipy.special import ndtri

        count = max(self.standardized.size, 1)
        return np.flatnonzero(np.abs(self.standardized) > -ndtri(0.005 / count))

    @property
    def joint(self) -> float:
        """The p of the likeliest alternative times their number (Bonferroni); at most 1."""
        tested = [a.p_value for a in self.alternatives if a.dof > 0]
        return min(1.0, len(tested) * min(tested)) if tested else 1.0

    @property
    def warning(self) -> str:
        """What a p near 1 says; empty otherwise."""
        if self.dof > 0 and self.p_value > _SMALL:
            return f"p = {self.p_value:.6g}: the residuals are too small; sigma or a unit is wrong"
        return ""

    def _as_table(self) -> Columns:
        values = {"residual": self.residuals}
        if self.standardized.shape == self.residuals.shape:
            values["standardized"] = self.standardized
        return Columns("measurement", range(len(self.residuals)), values, {})


@dataclass(frozen=True, eq=False, repr=False)
class Interval(Answer):
    """The values of a state or function that the measurements allow.

    Attributes
    ----------
    name, unit : str
    level : float
        Confidence.
    value : float
        At the estimate.
    pieces : tuple of (float or None, float or None)
        Ascending; None for an end that does not exist.
    local : float
        Half the length of the interval of the local Gaussian approximation.
    certain : bool
        Whether each end is one: not where a constrained solve beyond it did not converge,
        so that the interval may go on.
    """

    name: str
    unit: str
    level: float
    value: float
    pieces: tuple[tuple[float | None, float | None], ...]
    local: float
    certain: bool = True

    @property
    def length(self) -> float:
        """Distance from the lowest to the highest end; `inf` for an open interval."""
        low, high = self.pieces[0][0], self.pieces[-1][1]
        return np.inf if low is None or high is None else high - low

    @property
    def is_local(self) -> bool:
        """Whether the local approximation differs by less than 5 %."""
        if len(self.pieces) != 1 or not np.isfinite(self.length):
            return False
        low, high = self.pieces[0]
        ends = (self.value - (low or 0.0), (high or 0.0) - self.value)
        return all(abs(end - self.local) < 0.05 * self.local for end in ends)

    def __contains__(self, value: float) -> bool:
        # Ends are found to ten digits: the least value of a function is one of them.
        return any(
            (low is None or value >= low - 1e-9 * abs(low))
            and (high is None or value <= high + 1e-9 * abs(high))
            for low, high in self.pieces
        )

    def __str__(self) -> str:
        words = []
        unit = f" {self.unit}" if self.unit else ""
        for low, high in self.pieces:
            if low is None and high is None:
                words.append("no limit either way")
            elif high is None:
                words.append(f"at least {readable(float(low or 0))}{unit}, no upper limit")
            elif low is None:
                words.append(f"at most {readable(high)}{unit}, no lower limit")
            else:
                words.append(f"{readable(low)} to {readable(high)}{unit}")
        doubt = "" if self.certain else " (perhaps farther: a constrained solve did not converge)"
        return f"{self.name} {' or '.join(words)}{doubt}"


@dataclass(frozen=True, eq=False, repr=False)
class Region(Answer):
    """The values of a pair of states or functions that the measurements allow.

    Attributes
    ----------
    names : tuple of str, length 2
    level : float
    contours : tuple of (ndarray, shape (k, 2))
        A curve for each piece.
    closed : tuple of bool
        Whether each closes; one that does not has an open end.
    complete : tuple of bool
        Whether each was followed to its end: not where a constrained solve did not
        converge on the way.
    """

    names: tuple[str, str]
    level: float
    contours: tuple[Array, ...]
    closed: tuple[bool, ...]
    complete: tuple[bool, ...]

    def _as_table(self) -> Columns:
        points = np.vstack([*self.contours, np.zeros((0, 2))])
        pieces = np.repeat(np.arange(len(self.contours)), [len(c) for c in self.contours])
        values = {self.names[0]: points[:, 0], self.names[1]: points[:, 1], "piece": pieces}
        return Columns("point", range(len(points)), values, {})


class _Extended:
    """A model with the parameters of an alternative as further states, linear in them."""

    judged = ()

    def __init__(self, model: Any, name: str, columns: Array) -> None:
        self._model, self._columns = model, columns
        self.count = columns.shape[1]
        self._states = len(model.names)
        more = [name] if self.count == 1 else [f"{name} {k + 1}" for k in range(self.count)]
        self.names = (*model.names, *more)
        unit = getattr(model, "alternative_unit", lambda _: "")(name)
        self.units = (*model.units, *[unit] * self.count)

    def handle(self, z: Array) -> _core.Model:
        inner, n = handle_of(self._model, z), self._states
        # Priors of the model's own stand below the measurements.
        own = inner.measurements - len(self._columns)
        columns = np.vstack([self._columns, np.zeros((own, self.count))])

        def linearize(x: Array, _: bool) -> tuple[Array, Array]:
            left, rows = inner.linearize(x[:n])
            return left - columns @ x[n:], np.hstack([rows, columns])

        def difference(start: Array, to: Array) -> Array:
            return linearize(start, False)[0] - linearize(to, False)[0]

        return _core.Model.from_functions(
            len(self.names), len(columns), linearize, difference, None
        )

    def h(self, x: Any) -> Array:
        # Alternatives are of whitened data: h is that of the model.
        exact: Array = self._model.h(np.asarray(x)[: self._states])
        return exact

    def residuals(self, x: Any, z: Any) -> Array:
        return self.handle(z).linearize(x)[0]

    def rows(self, x: Any) -> Array:
        return np.hstack([self._model.rows(np.asarray(x)[: self._states]), self._columns])


class _Distance:
    """Distance of some states, coordinates of a place, from a point."""

    range = (0.0, np.inf)

    def __init__(self, states: list[int], start: Array) -> None:
        self._states, self._start = states, start

    def __call__(self, x: Array) -> tuple[float, Array]:
        offset = x[self._states] - self._start
        distance = float(np.linalg.norm(offset))
        gradient = np.zeros(len(x))
        gradient[self._states] = offset / (distance or 1.0)
        return distance, gradient


class _OwnFunction:
    """A function of the caller's, x -> (value, gradient), whose answers are checked."""

    def __init__(self, function: Any, name: str, count: int) -> None:
        self._function, self._name, self._count = function, name, count

    def __call__(self, x: Array) -> tuple[float, Array]:
        try:
            found: Any = self._function(x)
        except TypeError as error:
            raise InputError(f"{self._name} cannot be called with a state: {error}") from error
        try:
            value, gradient = found
        except (TypeError, ValueError) as error:
            raise InputError(
                f"{self._name} returned {options.given(found)}: must be (value, gradient)"
            ) from error
        slope = finite(gradient, f"gradient of {self._name}")
        if slope.shape != (self._count,):
            raise InputError(
                f"gradient of {self._name} has shape {slope.shape}: must be ({self._count},)"
            )
        return number(value, f"value of {self._name}"), slope


class _Partly:
    """A function of all states as one of those that are not known."""

    def __init__(
        self, function: Callable[[Array], tuple[float, Array]], at: Array, free: list[int]
    ) -> None:
        self._function, self._at, self._free = function, at, free
        self.range = getattr(function, "range", (-np.inf, np.inf))

    def __call__(self, x: Array) -> tuple[float, Array]:
        whole = self._at.copy()
        whole[self._free] = x
        value, gradient = self._function(whole)
        return value, np.asarray(gradient)[self._free]


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Answer):
    """The answer of `estimate`.

    Attributes
    ----------
    model : object
    measurements : ndarray, shape (m,)
    names, units : tuple of str, length n
        The states that were estimated; those in `known` are not among them.
    state : ndarray, shape (n,)
        The most likely state that was found; one of many where the status is
        "unobservable".
    converged : bool
    iterations : int
    prior : mapping, array_like or tuple, or None
        As given to `estimate`.
    known : mapping of str to float
    others : tuple of Solution
        Other states that fit, the likeliest first.
    unseen : float
        Upper 95 % limit on the probability that a further start finds a solution not in
        `others`; 1 where no starts were spread.
    alpha, chance, weak_ratio : float
        As for `estimate`.
    unbounded : bool
        Whether the likelihood grows towards infinity, as of bearings that spread: the state
        is then one on the way, at some hundred times the range of the start, and the
        intervals have no upper limit.
    """

    model: Any
    measurements: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    state: Array
    converged: bool
    iterations: int
    prior: Any
    known: Mapping[str, float]
    others: tuple[Solution, ...]
    unseen: float
    alpha: float
    chance: float
    weak_ratio: float
    unbounded: bool = False
    _loss: tuple[str, float] = ("squares", 0.0)
    _prior: Knowledge | None = None

    _more_in_dict: ClassVar[tuple[str, ...]] = ("status", "reason", "std", "covariance", "fit")
    _not_in_dict = frozenset({"model"})
    _not_compared = frozenset({"model"})
    _saved_results = ("fit", "covariance", "std", "_verdict")

    @cached_property
    def _handle(self) -> _core.Model:
        before = self._prior
        if before is None:
            before, _ = _knowledge(self.model, self.prior or None, {})
        return informed(self.model, self.measurements, before, self.known)

    @cached_property
    def _analysis(self) -> _core.Analysis:
        rows, rtol = self._handle.linearize(self.state)[1], None
        rounded = getattr(self.model, "rounded", None)
        if rounded is not None:
            rows, rtol = rounded(self.state, rows)
        return _core.Analysis(rows, rtol)

    @cached_property
    def fit(self) -> Fit:
        """How well the model fits, and what would explain that it does not."""
        found = self._handle.fit(self.state)
        made = getattr(self.model, "faults", None)
        faults = () if made is None else tuple(made(self.measurements))
        return Fit(alternatives=self._alternatives(), faults=faults, **found)

    def test(self, alternatives: Mapping[str, ArrayLike]) -> tuple[Alternative, ...]:
        """Return score tests of alternatives, the likeliest first.

        Parameters
        ----------
        alternatives : mapping of str to array_like, shape (m,) or (m, parameters)
            For each the derivatives of the measurements, whitened, with respect to its
            parameters, at zero.
        """
        columns = _columns(alternatives)
        records, alike = self._handle.scores(self.state, list(columns.values()), self.alpha, 0.8)
        for name, record in zip(columns, records, strict=True):
            figures = (record[key] for key in ("p_value", "size", "detectable", "effect"))
            if any(np.isnan(figure).any() for figure in figures):
                raise InputError(f"alternatives[{name!r}]: its test overflows float64")
        names = list(columns)
        found = [
            Alternative(
                name=name,
                p_value=record["p_value"],
                restored=record["restored"],
                size=record["size"],
                detectable=record["detectable"],
                effect=record["effect"],
                dof=record["dof"],
                alike=tuple(
                    other
                    for other, value in zip(names, line, strict=True)
                    if other != name and abs(value) > 0.9
                ),
            )
            for name, record, line in zip(names, records, alike, strict=True)
        ]
        return tuple(sorted(found, key=lambda alternative: alternative.p_value))

    def _alternatives(self) -> tuple[Alternative, ...]:
        made = getattr(self.model, "alternatives", None)
        if made is None:
            return ()
        unit = getattr(self.model, "alternative_unit", lambda _: "")
        found = self.test(made(self._whole, self.measurements))
        return tuple(replace(alternative, unit=unit(alternative.name)) for alternative in found)

    @property
    def _whole(self) -> Array:
        """All states of the model, those that are known at their values."""
        if self.names == tuple(self.model.names):
            return self.state
        return np.array([self[name] for name in self.model.names])

    def refit(self, name: str | None = None) -> Estimate:
        """Return the estimate with an alternative in the model.

        Parameters
        ----------
        name : str, optional
            Which; by default the one whose score test says most.

        Returns
        -------
        Estimate
            Its last states are the parameters of the alternative, in the units of its
            columns; linear in these.

        Raises
        ------
        InputError
            No such alternative; none that leaves a trace.
        """
        made = getattr(self.model, "alternatives", None)
        columns = {} if made is None else made(self._whole, self.measurements)
        if name is None:
            best = next((a for a in self.fit.alternatives if a.dof > 0), None)
            if best is None:
                raise InputError("no alternative leaves a trace: there is nothing to refit")
            name = best.name
        if name not in columns:
            raise InputError(f"no alternative {name!r}: there are {', '.join(columns) or 'none'}")
        column = np.asarray(columns[name], dtype=float)
        more = _Extended(self.model, name, column[:, None] if column.ndim == 1 else column)
        start = np.concatenate([self._whole, np.zeros(more.count)])
        return estimate(
            more,
            self.measurements,
            start=start,
            # A model that holds its knowledge keeps it.
            prior={} if hasattr(self.model, "prior") else self.prior,
            known={} if hasattr(self.model, "known") else self.known,
            search=False,
            alpha=self.alpha,
            chance=self.chance,
            weak_ratio=self.weak_ratio,
        )

    @cached_property
    def covariance(self) -> Array:
        """The local Gaussian approximation (n, n); `inf` where none exists."""
        found = self._analysis.crlb()
        n = len(self.names)
        return np.full((n, n), np.inf) if found is None else found

    @cached_property
    def std(self) -> Array:
        """Standard deviations (n,) of the local Gaussian approximation."""
        std: Array = self._analysis.crlb_std()
        return std

    def __getitem__(self, name: str) -> float:
        if name in self.known:
            return float(self.known[name])
        return float(self.state[self._index(name)])

    def _index(self, name: str) -> int:
        if not isinstance(name, str) or name not in self.names:
            raise InputError(
                f"no state {options.given(name)}: the states are {', '.join(self.names)}"
            )
        return self.names.index(name)

    def _named(self, what: str) -> tuple[str, str, Any, float]:
        """Return what `_function` does, of a function of the model."""
        given, unit = self.model.functions[what]
        places = tuple(self.model.names)
        free = [places.index(name) for name in self.names]
        if callable(given):
            function = given if self.names == places else _Partly(given, self._whole, free)
            return what, unit, function, float(function(self.state)[0])
        states, start = list(given[0]), np.asarray(given[1], dtype=float)
        value = float(np.linalg.norm(self._whole[states] - start))
        if all(k in free for k in states):
            return what, unit, ([free.index(k) for k in states], start.tolist()), value
        return what, unit, _Partly(_Distance(states, start), self._whole, free), value

    def _function(self, what: Any) -> tuple[str, str, Any, float]:
        """Return name, unit, what the extension takes, and the value at the estimate."""
        if isinstance(what, str) and what in getattr(self.model, "functions", {}):
            return self._named(what)
        if isinstance(what, str):
            row = np.zeros(len(self.names))
            row[self._index(what)] = 1.0
            return what, self.units[self._index(what)], row, float(self[what])
        if isinstance(what, Mapping):
            row = np.zeros(len(self.names))
            for name, factor in what.items():
                row[self._index(name)] = number(factor, f"coefficient of {name}")
            return describe_combination(row, self.names), "", row, float(row @ self.state)
        if callable(what):
            name = getattr(what, "__name__", "function")
            checked = _OwnFunction(what, name, len(self.names))
            return name, "", checked, checked(self.state.copy())[0]
        row = finite(what, "combination")
        if row.shape != self.state.shape:
            raise InputError(
                f"combination has shape {row.shape}: must be ({len(self.names)},), "
                "one coefficient for each state"
            )
        return describe_combination(row, self.names), "", row, float(row @ self.state)

    def interval(
        self,
        what: str | Mapping[str, float] | ArrayLike | Callable[[Array], tuple[float, Array]],
        level: float = 0.95,
    ) -> Interval:
        """Return the values of a state or function that the measurements allow.

        Parameters
        ----------
        what : str, mapping, array_like, shape (n,), or callable
            A state or a function of the model by its name; the coefficients of a
            combination of states; or a function ``x -> (value, gradient)``.
        level : float
            Confidence, between 0 and 1.

        Returns
        -------
        Interval
            By profile likelihood: all values at which chi2, at its least, rises by no more
            than the critical value of chi-square with one degree of freedom.

        Raises
        ------
        InputError
            A name or shape that does not fit, a level outside (0, 1).

        Notes
        -----
        Venzon & Moolgavkar 1988. Open ends are None: looked for to a thousand times the
        distance of the estimate.
        """
        name, unit, function, value = self._function(what)
        rise = self._rise(level, 1)
        found = self._handle.interval(self.state, self._other_states(), function, rise)
        if found["better"] is not None:
            # A lower minimum was met on the way: what is allowed counts from there.
            states = np.vstack([self._other_states(), self.state])
            found = self._handle.interval(found["better"]["x"], states, function, rise)
        pieces, local = tuple(found["pieces"]), float(found["local"])
        return Interval(name, unit, level, value, pieces, local, bool(found["certain"]))

    def region(self, pair: Sequence[Any], level: float = 0.95) -> Region:
        """Return the values of a pair of states or functions that the measurements allow.

        Parameters
        ----------
        pair : two of what `interval` takes
        level : float

        Raises
        ------
        InputError
            As `interval`; not two.
        """
        both = options.sequence(pair, "pair", "two states or functions")
        if len(both) != 2:
            raise InputError(f"pair = {options.given(pair)}: must be two states or functions")
        first, second = (self._function(what) for what in both)
        found = self._handle.contours(
            self.state, self._other_states(), (first[2], second[2]), self._rise(level, 2)
        )
        return Region(
            (first[0], second[0]),
            level,
            tuple(points for points, _, _ in found),
            tuple(closed for _, closed, _ in found),
            tuple(complete for _, _, complete in found),
        )

    def contains(self, state: ArrayLike, level: float = 0.95) -> bool:
        """Say whether a state (n,) is in the likelihood region of all states."""
        x = finite(state, "state")
        if x.shape != self.state.shape:
            raise InputError(f"state has shape {x.shape}: must be ({len(self.names)},)")
        residuals = self._handle.linearize(x)[0]
        limit = self.fit.chi2 + self._rise(level, len(self.names))
        return bool(residuals @ residuals <= limit)

    def _rise(self, level: float, dof: int) -> float:
        """Return by how much chi2 rises to the edge of a region of `dof` functions."""
        return _critical(level, dof)

    def sample(self, count: int = 256, seed: int = 0) -> Array:
        """Return states (count, n) spread as the likelihood is, priors included.

        Parameters
        ----------
        count : int
            >= 1.
        seed : int
            >= 0. State i depends on (seed, i) alone.

        Raises
        ------
        InputError
            A number that does not fit.

        Warns
        -----
        UserWarning
            Samples that did not converge: they are left out.

        Notes
        -----
        Each is the most likely state of measurements and priors with their noise added once
        more, from the estimate on: randomized maximum likelihood (Oliver, He & Reynolds
        1996), exact for a linear model. Where the region of likely states bends, their mean
        and covariance are those to pass on: `covariance` is that of the tangent. Other
        solutions are not among them.
        """
        count, seed = whole(count, "count", 1, 2**31), whole(seed, "seed", 0, SEED_MOST)
        rises = (_critical(0.95, 1), _critical(0.95, len(self.names)))
        out = self._handle.trials(
            self.state, self.state[None], None, None, None, rises, [], None, seed, 0, count
        )
        good = out[:, 0] == 1
        if not good.all():
            warnings.warn(
                f"{count - good.sum()} of {count} samples did not converge and are left out: "
                "the region of likely states bends too much for their size",
                UserWarning,
                stacklevel=2,
            )
        states: Array = out[good, -len(self.names) :]
        return states

    def _other_states(self) -> Array:
        states = [other.state for other in self.others]
        return np.array(states).reshape(-1, len(self.names))

    @cached_property
    def _weak(self) -> str:
        """What makes the answer weak, in words; empty where nothing does."""
        judged = getattr(self.model, "judged", getattr(self.model, "functions", {}))
        for name in judged:
            interval = self.interval(name)
            # 1.96 deviations either way, each at most this share of the value.
            if not interval.length <= 2 * 1.96 * self.weak_ratio * abs(interval.value):
                return str(interval)
        scale = getattr(self.model, "scale", None)
        if scale is not None:
            whole_scale = dict(zip(self.model.names, np.asarray(scale, dtype=float), strict=True))
            for name in self.names:
                limit = whole_scale[name]
                if np.isfinite(limit):
                    interval = self.interval(name)
                    if not interval.length <= 2 * 1.96 * limit:
                        return f"{interval}; more than {readable(limit)} says nothing"
        return ""

    @cached_property
    def _misfit(self) -> str:
        """What says that the model does not fit, in words; empty where nothing does.

        Dead or doubled channels; chi2, at the level alpha; the score tests of the model's
        alternatives, together at alpha.
        """
        fit = self.fit
        # Exact data repeat themselves.
        if fit.faults and not fit.warning:
            return "; ".join(fit.faults)
        if self._loss[0] != "squares":
            return ""
        best = next((a for a in fit.alternatives if a.dof > 0), None)
        if fit.dof > 0 and fit.p_value < self.alpha:
            reason = (
                f"chi2 = {fit.chi2:.4g} for {fit.dof} degrees of freedom (p = {fit.p_value:.2g}): "
                "the model does not fit"
            )
            if best is not None and best.restored > self.alpha:
                reason += f"; {best.name} would explain it (p = {best.restored:.2g})"
            return reason
        if best is not None and fit.joint < self.alpha:
            return f"{best.name} shows in the residuals (p = {best.p_value:.2g})"
        return ""

    @property
    def null_combinations(self) -> tuple[str, ...]:
        """Combinations of the states that change no measurement, in words."""
        if not self.names or self._analysis.rank == len(self.names):
            return ()
        texts = []
        for direction in self._analysis.null_space().T:
            # Components that are rounding would only be noise in the text.
            shown = np.where(np.abs(direction) < 1e-9 * np.abs(direction).max(), 0, direction)
            texts.append(describe_direction(shown, self.names))
        return tuple(texts)

    @cached_property
    def _verdict(self) -> tuple[Status, str]:
        if unseen := self.null_combinations:
            return "unobservable", f"no measurement sees {unseen[0]}"
        if misfit := self._misfit:
            return "misfit", misfit
        if not (self.converged or self.unbounded):
            return "not_converged", f"no minimum within {self.iterations} steps"
        near = [other for other in self.others if other.chance > self.chance]
        if near:
            place = ", ".join(f"{value:.6g}" for value in near[0].state)
            return "ambiguous", (
                f"({place}) fits as well: noise prefers the wrong one in "
                f"{brief(100 * near[0].chance)} % of trials"
            )
        if self._weak or self.unbounded:
            growing = ("the likelihood grows towards infinity",) if self.unbounded else ()
            return "weak", ": ".join(filter(None, (*growing, self._weak)))
        return "determined", "one solution fits"

    @property
    def status(self) -> Status:
        """One of `STATUSES`."""
        return self._verdict[0]

    @property
    def reason(self) -> str:
        """What decided the status."""
        return self._verdict[1]

    def summary(self, level: float = 0.95) -> str:
        """Return status, states with their intervals, fit and other solutions as text."""
        lines = [f"{self.status.upper()}: {self.reason}"]
        usable = self.status != "unobservable"
        for index, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            value = f"  {name}  {readable(float(self.state[index]), 6)} {unit}"
            if usable:
                interval = self.interval(name, level)
                spread = (
                    f"+- {readable(float(self.std[index]), 3)}"
                    if interval.is_local
                    else f"({100 * level:g} %: {str(interval).removeprefix(name + ' ')})"
                )
                value = f"{value} {spread}"
            lines.append(value)
        lines.extend("  " + line for line in self._fit_lines())
        for other in self.others:
            place = ", ".join(f"{value:.6g}" for value in other.state)
            lines.append(
                f"  other solution ({place}): chi2 {brief(other.chi2, 4)}, chance "
                f"{brief(other.chance, 2)}"
            )
        return "\n".join(lines)

    def _fit_lines(self) -> list[str]:
        """Return what the residuals say, and what errors they would not show, as lines."""
        fit = self.fit
        p = "" if np.isnan(fit.p_value) else f", p {brief(fit.p_value)}"
        lines = [f"chi2 {brief(fit.chi2, 4)} with {fit.dof} degrees of freedom{p}"]
        if fit.warning:
            lines.append(fit.warning)
        return [*lines, *self.unseen_errors]

    @property
    def unseen_errors(self) -> tuple[str, ...]:
        """Errors of the model that the fit would not show, in words, the worst first.

        Of the alternatives of the fit those whose smallest detectable size moves a state
        by more than a standard deviation (Baarda's external reliability), three at most.
        """
        std = self.std
        hidden = []
        for alternative in self.fit.alternatives:
            if alternative.dof == 0 or not np.isfinite(alternative.detectable):
                continue
            shift = np.abs(alternative.effect) / np.where(std > 0, std, np.inf)
            worst = int(np.argmax(shift)) if shift.size else 0
            if shift.size and shift[worst] > 1:
                hidden.append((float(shift[worst]), alternative, self.names[worst]))
        hidden.sort(key=lambda item: -item[0])
        return tuple(
            f"{alternative.name} up to "
            f"{f'{readable(alternative.detectable, 3)} {alternative.unit}'.rstrip()} would go "
            f"unseen and move {name} by {brief(size)} standard deviations"
            for size, alternative, name in hidden[:3]
        )

    def plot(self) -> Figure:
        """Draw the estimate of its first states, each and in pairs; needs matplotlib."""
        return self.corner()

    def plot_region(self, pair: Sequence[Any] | None = None, level: float = 0.95) -> Figure:
        """Draw residuals and the likelihood region of a pair of states; needs matplotlib.

        By default of the first two; with the ellipse of the local approximation where the
        two differ by more than 5 %.
        """
        return draw(self, "estimate", pair, level)

    def corner(self, names: Sequence[str] | None = None, level: float = 0.95) -> Figure:
        """Draw the estimate of chosen states, each and in pairs; needs matplotlib.

        By the local Gaussian approximation: `interval` and `region` have the likelihood's.

        Parameters
        ----------
        names : sequence of str, optional
            At most 8 states; by default the first ones.
        level : float
            The probability that the outer ellipses hold; the inner ones are of one
            deviation.
        """
        return draw(self, "corner", names, level)

    def _as_table(self) -> Columns:
        values = {"value": self.state, "std": self.std}
        return columns_of_states(self.names, self.units, values, covariance=self.covariance)


def estimate(
    model: EstimationModel,
    measurements: ArrayLike,
    *,
    start: ArrayLike | None = None,
    prior: Mapping[str, Any] | ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    known: Mapping[str, float] | None = None,
    box: Mapping[str, tuple[float, float]] | None = None,
    search: bool = True,
    starts: int = 32,
    seed: int = 0,
    loss: Literal["squares", "huber", "tukey"] = "squares",
    alpha: float = 0.001,
    chance: float = 0.01,
    weak_ratio: float = 0.25,
    max_iterations: int = 200,
) -> Estimate:
    """Return the most likely state of a model, and whether it may be believed.

    Parameters
    ----------
    model : EstimationModel
        A `gramian` model, or anything with ``names``, ``units``, ``h(x)``,
        ``residuals(x, z)`` and ``rows(x)``.
    measurements : array_like, shape (m,)
    start : array_like, shape (n,) or (k, n), optional
        Where to start; by default where the model says, or points of prior and box.
    prior : mapping of str to (mean, sigma), array_like or (mean, covariance), optional
        What is known beforehand of states, and of named combinations of a model that has
        them. A deviation alone, by name or one for each state (n,), and a covariance
        (n, n) alone are about the model's `x`. 0 is exact knowledge, `inf` none.
    known : mapping of str to float, optional
        States that are known exactly.
    box : mapping of str to (low, high), optional
        Where states without a prior may be: there further solutions are looked for.
    search : bool
        Whether to look for other solutions: without, the one that is found may be one of
        several.
    starts : int
        How many points of prior and box are followed in search of other solutions.
    seed : int
        Of the independent half of them.
    loss : {"squares", "huber", "tukey"}
        How residuals count.
    alpha : float
        Level of the tests of the fit: "misfit" where p of chi2 is below it, or where the
        score tests of the model's alternatives, together, say so at this level.
    chance : float
        "ambiguous" where noise prefers another solution more often than this.
    weak_ratio : float
        "weak" where a named function, a range, has an interval wider than that of this
        share of its value as deviation.
    max_iterations : int

    Returns
    -------
    Estimate
        Look at its status first.

    Raises
    ------
    InputError
        A name, shape or number that does not fit; no place to start from.

    Notes
    -----
    Damped Gauss-Newton steps on orthogonally reduced rows. Where a search finds a state
    that fits better than where the starts ended, that is the answer.
    """
    model = as_model(model)
    z = _measured(model, measurements)
    known = as_known(known, model.names, model.units, "known")
    box = as_box(box, model.names, model.units)
    before, known = _knowledge(model, prior, known)
    free = [k for k, name in enumerate(model.names) if name not in known]
    names = tuple(model.names[k] for k in free)
    if not names:
        raise InputError("every state is known: nothing is left to estimate")
    loss = options.choice(loss, "loss", _LOSSES)
    alpha, chance, weak_ratio = levels(alpha, chance, weak_ratio)
    search = options.flag(search, "search")
    starts = whole(starts, "starts", 0, 2**31)
    seed = whole(seed, "seed", 0, SEED_MOST)
    max_iterations = whole(max_iterations, "max_iterations", 1, 2**31)
    handle = informed(model, z, before, known)
    spread = _spread(names, before, box, tuple(model.names))
    first = _starts(model, z, start, free, spread, before, names)
    weighting = (loss, _LOSSES[loss])
    found = handle.minimize(first, weighting, max_iterations)
    if not found:
        # With the reason, where there is one.
        handle.linearize(first[0])
        raise InputError("the model has no value at any of the starts")
    best = found[0]
    others: tuple[Solution, ...] = ()
    unseen = 1.0
    if search and best["converged"] and loss == "squares":
        searched = handle.others(best["x"], spread, starts, seed)
        unseen = searched["unseen"]
        best = best | {"x": searched["x"], "chi2": searched["chi2"]}
        others = tuple(_solution(other) for other in searched["others"])
    return Estimate(
        model=model,
        measurements=z,
        names=names,
        units=tuple(model.units[k] for k in free),
        state=best["x"],
        converged=best["converged"],
        iterations=best["iterations"],
        prior=prior,
        known=known,
        others=others,
        unseen=unseen,
        alpha=alpha,
        chance=chance,
        weak_ratio=weak_ratio,
        unbounded=best["unbounded"],
        _loss=weighting,
        _prior=before,
    )


@dataclass(frozen=True, eq=False, repr=False)
class Trials(Answer):
    """What `estimate_trials` found; arrays have one entry a trial.

    Attributes
    ----------
    names : tuple of str, length n
    truth : ndarray, shape (n,)
    states : ndarray, shape (trials, n)
        NaN, as `chi2`, where nothing of a trial could be computed: it did not converge.
    status : ndarray of str, shape (trials,)
        As of an `Estimate`.
    chi2, p_values, lag_p_values : ndarray, shape (trials,)
    chances : ndarray, shape (trials,)
        The largest chance that noise prefers another solution.
    inside : ndarray of bool, shape (trials,)
        Whether the truth is in the likelihood region of all states.
    covered : ndarray of bool, shape (trials,)
        Whether it is in the interval of `function`; all True without one.
    intervals : ndarray, shape (trials, 2)
        Lowest and highest end; infinite where open, NaN without a function.
    certain : ndarray of bool, shape (trials,)
    solves : ndarray, shape (trials,)
        Constrained solves an interval took.
    alternatives : mapping of str to ndarray, shape (trials,)
        p of the score test of each.
    """

    names: tuple[str, ...]
    truth: Array
    states: Array
    status: NDArray[np.str_]
    chi2: Array
    p_values: Array
    lag_p_values: Array
    chances: Array
    inside: NDArray[np.bool_]
    covered: NDArray[np.bool_]
    intervals: Array
    certain: NDArray[np.bool_]
    solves: Array
    alternatives: Mapping[str, Array]

    @property
    def shares(self) -> dict[str, float]:
        """Share of the trials with each status."""
        return {name: float((self.status == name).mean()) for name in STATUSES}

    @property
    def wrong(self) -> float:
        """Share of all trials that say "determined" with the truth outside the region."""
        return float(((self.status == "determined") & ~self.inside).mean())

    def to_dict(self) -> dict[str, Any]:
        """Return the shares as plain numbers, fit for JSON."""
        return {
            "trials": len(self.status),
            "shares": self.shares,
            "inside": float(self.inside.mean()),
            "covered": float(self.covered.mean()),
            "wrong": self.wrong,
            "uncertain": float((~self.certain).mean()),
        }

    def __str__(self) -> str:
        said = ", ".join(f"{100 * v:.3g} % {name}" for name, v in self.shares.items() if v > 0)
        inside = f"truth in the region {100 * self.inside.mean():.3g} %"
        if not np.isnan(self.intervals).all():
            inside += f", in the interval {100 * self.covered.mean():.3g} %"
        return f"{len(self.status)} trials: {said}; {inside}"


def estimate_trials(
    model: EstimationModel,
    truth: ArrayLike,
    *,
    seed: int,
    trials: int,
    first: int = 0,
    level: float = 0.95,
    function: str | None = None,
    alternatives: Mapping[str, ArrayLike] | None = None,
    shift: ArrayLike | None = None,
    start: ArrayLike | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    box: Mapping[str, tuple[float, float]] | None = None,
    starts: int = 0,
    alpha: float = 0.001,
    chance: float = 0.01,
    weak_ratio: float = 0.25,
) -> Trials:
    """Simulate a state many times, estimate it each time, and ask whether the answers hold.

    Parameters
    ----------
    model : EstimationModel
    truth : array_like, shape (n,)
    seed : int
        >= 0. Trial i depends on (seed, i) alone.
    trials : int
        How many, >= 1.
    first : int
        Number of the first trial.
    level : float
        Confidence of regions and intervals.
    function : str, optional
        A function of the model: its interval is found in each trial, and makes an answer
        "weak" as in `estimate`. By default the first one the model judges by, if any.
    alternatives : mapping of str to array_like, shape (m,) or (m, parameters), optional
        Whitened columns of the score tests; by default the model's own, at the truth.
    shift : array_like, shape (m,), optional
        What the data have that the model has not, whitened: a bias, for one.
    start, prior, box, alpha, chance, weak_ratio
        As for `estimate`; a prior's mean is drawn about the truth.
    starts : int
        Points of prior and box that are followed in search of other solutions.

    Returns
    -------
    Trials

    Raises
    ------
    InputError
        As `estimate`.

    Notes
    -----
    Whitened noise is added to the residuals of exact data, on all threads, in the crate.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(0.0, 600.0, 20.0)
    >>> path = np.stack([np.maximum(0, 5 * (t - 300)), np.minimum(5 * t, 1500)], axis=1)
    >>> model = gm.bearings.BearingsModel(t, path, np.array([1e-3]))
    >>> found = estimate_trials(model, [2000.0, 6000.0, 3.0, -1.0], seed=1, trials=100)
    >>> bool(found.inside.mean() > 0.85)
    True
    """
    model = as_model(model)
    x = finite(truth, "truth")
    names = tuple(model.names)
    if x.shape != (len(names),):
        raise InputError(f"truth has shape {x.shape}: must be ({len(names)},)")
    seed, first = whole(seed, "seed", 0, SEED_MOST), whole(first, "first")
    trials, starts = whole(trials, "trials", 1), whole(starts, "starts", 0, 2**31)
    alpha, chance, weak_ratio = levels(alpha, chance, weak_ratio)
    z = finite(model.h(x), "exact data")
    centred = {}
    for state, pair in options.mapping(prior, "prior", "name to (mean, sigma)").items():
        if state not in names:
            raise InputError(f"prior of {state!r}: the states are {', '.join(names)}")
        k = names.index(state)
        centred[state] = (float(x[k]), as_pair(pair, f"prior of {state}", model.units[k])[1])
    before, exact = _knowledge(model, centred or None, {})
    if exact:
        raise InputError(f"prior of {next(iter(exact))}: sigma = 0, must be > 0 in trials")
    handle = informed(model, z, before, {})
    spread = _spread(names, before, as_box(box, names, model.units), names)
    places = _starts(model, z, start, list(range(len(names))), spread, before, names)
    functions = getattr(model, "functions", {})
    judged = tuple(getattr(model, "judged", functions))
    if function is not None and not isinstance(function, str):
        raise InputError(f"function = {options.given(function)}: must be the name of a function")
    name = function if function is not None else (judged[0] if judged else None)
    what = None
    if name is not None:
        if name not in functions:
            there = ", ".join(functions) or "none"
            raise InputError(f"function = {name!r}: the model has {there}")
        what = functions[name][0]
        if not callable(what):
            what = (list(what[0]), [float(value) for value in what[1]])
    if alternatives is None:
        made = getattr(model, "alternatives", None)
        alternatives = {} if made is None else made(x, z)
    columns = _columns(alternatives)
    out = handle.trials(
        x,
        places,
        spread,
        (starts, seed) if starts or spread is not None else (0, seed),
        what,
        (_critical(level, 1), _critical(level, len(names))),
        list(columns.values()),
        None if shift is None else finite(shift, "shift"),
        seed,
        first,
        trials,
    )
    head, n = 14, len(names)
    p = out[:, head + n :]
    with np.errstate(invalid="ignore"):
        tested = p.shape[1]
        dof = z.size + len(centred) - n
        misfit = (out[:, 2] < alpha) & (dof > 0)
        if tested:
            misfit |= tested * p.min(axis=1) < alpha
        long = out[:, 8] - out[:, 7] > 2 * 1.96 * weak_ratio * np.abs(out[:, 12])
        status = np.select(
            [
                misfit,
                out[:, 0] != 1,
                out[:, 4] > chance,
                long & (what is not None and name in judged),
            ],
            ["misfit", "not_converged", "ambiguous", "weak"],
            "determined",
        )
    return Trials(
        names=names,
        truth=x,
        states=out[:, head : head + n],
        status=status,
        chi2=out[:, 1],
        p_values=out[:, 2],
        lag_p_values=out[:, 3],
        chances=out[:, 4],
        inside=out[:, 5] == 1,
        covered=(out[:, 6] == 1) | (what is None),
        intervals=out[:, 7:9],
        certain=(out[:, 10] == 1) | (what is None),
        solves=out[:, 13],
        alternatives=dict(zip(columns, p.T, strict=True)),
    )


def levels(alpha: float, chance: float, weak_ratio: float) -> tuple[float, float, float]:
    """Return the levels of a status, checked."""
    alpha, chance = options.fraction(alpha, "alpha"), options.fraction(chance, "chance")
    weak_ratio = real(weak_ratio, "weak_ratio")
    if not weak_ratio > 0:
        raise InputError(f"weak_ratio = {weak_ratio}: must be > 0")
    return alpha, chance, weak_ratio


def _columns(alternatives: Mapping[str, ArrayLike] | None) -> dict[str, Array]:
    """Return the columns (m, parameters) of alternatives by name."""
    columns = {}
    of = "name to derivatives of the measurements"
    for name, given in options.mapping(alternatives, "alternatives", of).items():
        column = finite(given, f"alternatives[{name!r}]")
        if column.ndim not in (1, 2) or column.size == 0:
            raise InputError(
                f"alternatives[{name!r}] has shape {column.shape}: must be (m,) or (m, parameters)"
            )
        columns[name] = column[:, None] if column.ndim == 1 else column
    return columns


def other_solutions(
    model: EstimationModel,
    x: ArrayLike,
    *,
    prior: Mapping[str, Any] | ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    box: Mapping[str, tuple[float, float]] | None = None,
    starts: int = 64,
    seed: int = 0,
) -> tuple[Solution, ...]:
    """Return the states whose exact data lie near those of `x`, before anything is measured.

    Parameters
    ----------
    model : EstimationModel
    x : array_like, shape (n,)
    prior, box, starts, seed
        As for `estimate`: where else to look.

    Returns
    -------
    tuple of Solution
        Local minima of chi2 for the exact data of `x`, the likeliest first.

    Raises
    ------
    InputError
        As `estimate`.
    """
    model = as_model(model)
    state = finite(x, "x")
    names = tuple(model.names)
    if state.shape != (len(names),):
        raise InputError(f"x has shape {state.shape}: must be ({len(names)},)")
    before, _ = _knowledge(model, prior, {})
    spread = _spread(names, before, as_box(box, names, model.units), names)
    handle = informed(model, model.h(state), None, {})
    starts, seed = whole(starts, "starts", 0, 2**31), whole(seed, "seed", 0, SEED_MOST)
    found = handle.others(state, spread, starts, seed)
    return tuple(_solution(other) for other in found["others"])


def _solution(record: Mapping[str, Any]) -> Solution:
    return Solution(
        record["x"], record["chi2"], record["distance"], record["chance"], record["hits"]
    )


@dataclass(frozen=True, eq=False)
class Channel(Value):
    """A channel of a recording: its name, where its readings are, and when they were taken.

    Attributes
    ----------
    name : str
    places : ndarray of int, shape (k,)
        Among the measurements, in the order of time.
    times : ndarray, shape (k,)
        When they were taken.
    unit : str
        Of the times, or what they number: "look".
    """

    name: str
    places: NDArray[np.intp]
    times: Array
    unit: str = "s"


def channel_faults(
    readings: ArrayLike, sigma: ArrayLike, channels: Sequence[Channel]
) -> tuple[str, ...]:
    """Return which channels are dead, stuck or doubled, in words.

    Parameters
    ----------
    readings : array_like, shape (m,)
        NaN where one is missing.
    sigma : array_like, shape (), (1,) or (m,)
        Standard deviations; 0 for a reading that does not count.
    channels : sequence of Channel

    Returns
    -------
    tuple of str

    Notes
    -----
    A channel is stuck where readings in the middle of a step of its converter would keep one
    value for so long in less than one record of 10^4; where readings around the run repeat
    each other as well, the steps are coarse, and nothing is told. Exact data, which have no
    noise, repeat themselves: where chi2 is improbably small, what is told here is no fault.
    """
    return _faults(np.asarray(readings, dtype=float), sigma, channels)[0]


def _faults(values: Array, sigma: ArrayLike, channels: Sequence[Channel]) -> list[tuple[str, ...]]:
    """Return what `channel_faults` does of each of the records (..., m), one after another."""
    deviations = np.atleast_1d(np.asarray(sigma, dtype=float))
    deviations = np.broadcast_to(deviations, (*deviations.shape[:-1], values.shape[-1]))
    kinds = _core.channels(values, deviations, [list(map(int, c.places)) for c in channels])
    kinds = kinds.reshape(-1, len(channels), 3)
    told: list[tuple[str, ...]] = [()] * len(kinds)
    for index in np.flatnonzero((kinds[..., 0] > 0).any(axis=-1)).tolist():
        found = zip(channels, kinds[index].astype(int).tolist(), strict=True)
        told[index] = tuple(_fault(channels, one, kind) for one, kind in found if kind[0])
    return told


def _fault(channels: Sequence[Channel], one: Channel, kind: Sequence[int]) -> str:
    code, first, last = kind
    if code == 1:
        return f"{one.name} is constant over the record: dead or stuck"
    if code == 3:
        return f"{one.name} is a copy of {channels[first].name}"
    times = (brief(one.times[k], 6) for k in (first, last))
    ends = " to ".join(f"{t} s" if one.unit == "s" else f"{one.unit} {t}" for t in times)
    return f"{one.name} is stuck at one value from {ends}, longer than its noise lets it"


def faulty(
    readings: Array, sigma: ArrayLike, channels: Sequence[Channel], p_value: ArrayLike
) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Return which records (...) have a faulty channel, and in words which and where.

    Not those whose `p_value`, that of chi2, is near 1 or NaN: exact data repeat themselves.
    """
    with np.errstate(invalid="ignore"):
        asked = np.asarray(p_value) <= _SMALL
    # Times or an observer of each record make more records than there are readings.
    shape = np.broadcast_shapes(readings.shape[:-1], asked.shape)
    readings = np.broadcast_to(readings, (*shape, readings.shape[-1]))
    asked = np.broadcast_to(asked, shape)
    if not channels or not asked.any():
        return np.zeros(shape, dtype=bool), ()
    told = _faults(readings, sigma, channels)
    bad = np.array([bool(words) for words in told], dtype=bool).reshape(shape) & asked
    if not shape:
        return bad, told[0] if bad else ()
    places = np.argwhere(bad)
    indices = np.flatnonzero(bad)
    words = [
        f"record {', '.join(map(str, place))}: {'; '.join(told[index])}"
        for place, index in zip(places[:_TOLD].tolist(), indices.tolist(), strict=False)
    ]
    if len(places) > _TOLD:
        words.append(f"and {len(places) - _TOLD} records more")
    return bad, tuple(words)


def _measured(model: Any, measurements: ArrayLike) -> Array:
    """Return measurements as the model takes them: of some, NaN is one that is missing."""
    checked = getattr(model, "measured", None)
    if checked is not None:
        own: Array = checked(measurements)
        return own
    return finite(measurements, "measurements")


def _knowledge(
    model: Any, prior: Any, known: Mapping[str, float]
) -> tuple[Knowledge, dict[str, float]]:
    """Return the priors with their means, and what is known exactly, by name.

    The mean of a deviation without one is where the model is asked, its `x`.
    """
    names = tuple(model.names)
    combinations = getattr(model, "combinations", {})
    found = as_knowledge(prior, names, combinations, units=tuple(model.units))
    mean, at = found.mean.copy(), getattr(model, "x", None)
    if (lacking := np.isnan(mean)).any():
        if at is None:
            name = found.names[int(np.argmax(lacking))]
            what = f"prior of {name}" if name is not None else "prior"
            raise InputError(f"{what} has no mean, and the model no x: must be (mean, sigma)")
        mean[lacking] = found.rows[lacking] @ np.asarray(at, dtype=float)
    values = dict(known)
    open_ones = []
    for k, name in enumerate(found.names):
        if found.sigma[k] == 0 and name in names:
            values[str(name)] = float(mean[k])
        else:
            open_ones.append(k)
    centre = found.state_mean
    if at is not None:
        centre = np.where(np.isnan(centre), np.asarray(at, dtype=float), centre)
    left = Knowledge(
        tuple(found.names[k] for k in open_ones),
        found.rows[open_ones],
        mean[open_ones],
        found.sigma[open_ones],
        centre,
        found.state_sigma,
    )
    return left, values


def informed(
    model: Any, z: Array, prior: Knowledge | None, known: Mapping[str, float]
) -> _core.Model:
    """Return the extension's model of measurements, with what is known beside them."""
    handle = handle_of(model, z)
    if prior is not None and len(prior.rows):
        sigma = prior.sigma
        if (exact := sigma == 0).any():
            # As exact as rows of the measurements and arithmetic let it be.
            sigma = np.where(exact, _negligible(model, prior.rows), sigma)
        handle = handle.with_prior(prior.rows, prior.mean, sigma)
    if known:
        handle = handle.with_known([known.get(name) for name in model.names])
    return handle


def _negligible(model: Any, rows: Array) -> Array:
    """Return deviations of combinations (q, n) far below what the measurements tell."""
    at = getattr(model, "x", None)
    if at is None:
        raise InputError("prior of sigma 0 of a combination: the model needs an x for its size")
    return negligible(np.asarray(model.rows(at)), rows)


def _spread(
    names: tuple[str, ...],
    prior: Knowledge,
    box: Mapping[str, tuple[float, float]],
    states: tuple[str, ...],
) -> tuple[str, list[float], list[float]] | None:
    """Return where the states may be; None where one of them may be anywhere."""
    known = _prior_of_states(prior, names, states)
    if any(name not in known and name not in box for name in names):
        return None
    if not any(name in box for name in names):
        pairs = [known[name] for name in names]
        return "normal", [float(p[0]) for p in pairs], [float(p[1]) for p in pairs]
    ends = [
        box[name]
        if name in box
        else (known[name][0] - 4 * known[name][1], known[name][0] + 4 * known[name][1])
        for name in names
    ]
    return "box", [float(end[0]) for end in ends], [float(end[1]) for end in ends]


def _prior_of_states(
    prior: Knowledge, names: tuple[str, ...], states: tuple[str, ...]
) -> dict[str, tuple[float, float]]:
    """Return mean and deviation of each state of which a prior says something."""
    pairs = zip(states, prior.state_mean.tolist(), prior.state_sigma.tolist(), strict=True)
    return {name: (m, s) for name, m, s in pairs if name in names and 0 < s < np.inf}


def _starts(
    model: Any,
    z: Array,
    start: ArrayLike | None,
    free: list[int],
    spread: tuple[str, list[float], list[float]] | None,
    prior: Knowledge,
    names: tuple[str, ...],
) -> Array:
    n = len(model.names)
    if start is not None:
        given = np.atleast_2d(finite(start, "start"))
        if given.ndim != 2 or given.shape[1] not in (n, len(free)):
            raise InputError(f"start has shape {np.shape(start)}: must be ({n},) or (k, {n})")
        return given[:, free] if given.shape[1] == n else given
    made = getattr(model, "starts", None)
    if made is not None:
        return np.asarray(made(z), dtype=float)[:, free]
    at = getattr(model, "x", None)
    if at is not None:
        return np.asarray(at, dtype=float)[None, free]
    if spread is not None:
        first, second = np.array(spread[1]), np.array(spread[2])
        normal = spread[0] == "normal"
        middle = first if normal else 0.5 * (first + second)
        # And a step off it along each state: the middle itself may be a singular place.
        steps = np.diag(second if normal else 0.25 * (second - first))
        return np.vstack([middle, middle + steps, middle - steps])
    known = _prior_of_states(prior, names, tuple(model.names))
    missing = [name for name in names if name not in known]
    raise InputError(
        f"nowhere to start: give start, or a prior or box for {', '.join(missing) or 'the states'}"
    )


def _critical(level: float, dof: int) -> float:
    return _core.chi_square_critical(1 - options.fraction(level, "level"), dof)
