"""The most likely state of a model, and whether it may be believed."""

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
from gramian._arrays import ITERATIONS_MOST, SEED_MOST, finite, number, whole
from gramian._handle import (
    EstimationModel,
    as_model,
    check_rows,
    check_shapes,
    exact_data,
    handle_of,
)
from gramian._noise import Knowledge, as_box, as_known
from gramian._registry import draw
from gramian._text import above_noise, brief, describe_combination, describe_direction
from gramian._text import number as readable
from gramian.estimation._knowledge import (
    columns_of,
    critical_at,
    informed,
    knowledge_of,
    levels,
    measured,
    spread_of,
    starts_of,
)
from gramian.estimation._parts import (
    Alternative,
    Fit,
    Interval,
    Region,
    Solution,
    Status,
    not_white,
)
from gramian.exceptions import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Estimate", "estimate", "other_solutions"]

Array = NDArray[np.float64]

#: So many outliers are looked for together.
_OUTLIERS = 3
#: So many standard deviations are far beyond what is proportional to an error of the model.
_FAR = 10.0
#: How residuals may count, with the constants of 95 % efficiency on normal noise.
_LOSSES = {"squares": 0.0, "huber": 1.345, "tukey": 4.685}


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
    """A function of the caller's, x -> value or (value, gradient), whose answers are checked."""

    def __init__(self, function: Any, name: str, names: Sequence[str]) -> None:
        self._function, self._name, self._names = function, name, tuple(names)
        self._count = len(names)
        # Where the search for steps starts: with what was right before.
        self._scale = np.full(self._count, np.nan)

    def __call__(self, x: Array) -> tuple[float, Array]:
        found = self._at(x)
        if isinstance(found, (int, float)) or getattr(found, "ndim", None) == 0:
            value = number(found, f"value of {self._name}")
            return value, self._gradient(x, value)
        try:
            value, gradient = found
        except (TypeError, ValueError) as error:
            raise InputError(
                f"{self._name} returned {options.given(found)}: must be a value, or "
                "(value, gradient)"
            ) from error
        slope = finite(gradient, f"gradient of {self._name}")
        if slope.shape != (self._count,):
            raise InputError(
                f"gradient of {self._name} has shape {slope.shape}: must be ({self._count},)"
            )
        return number(value, f"value of {self._name}"), slope

    def _at(self, x: Array) -> Any:
        try:
            return self._function(x.copy())
        except TypeError as error:
            raise InputError(f"{self._name} cannot be called with a state: {error}") from error

    def _gradient(self, x: Array, value: float) -> Array:
        """Return the gradient by differences, as that of the rows of a model."""

        def values(points: Array) -> Array:
            return np.array([[number(self._at(point), self._name)] for point in points])

        unknown = np.full(1, np.nan)
        found = _core.differences(
            values,
            x,
            np.array([value]),
            self._scale,
            np.array([1 / abs(value) if value else 1.0]),
            np.zeros(1),
            unknown,
            np.full(self._count, np.nan),
            None,
            self._names,
        )
        step = found.step()
        self._scale = np.where(step > 0, 64 * step, np.nan)
        gradient: Array = found.values()[0]
        return gradient


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
            before, _ = knowledge_of(self.model, self.prior or None, {})
        return informed(self.model, self.measurements, before, self.known)

    @cached_property
    def _analysis(self) -> _core.Analysis:
        rows, rtol = self._handle.linearize(self.state)[1], None
        rounded = getattr(self.model, "rounded", None)
        if rounded is not None:
            free = [tuple(self.model.names).index(name) for name in self.names]
            rows, rtol = rounded(self._whole, rows, free)
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
            parameters, at zero; several parameters of one unit.
        """
        columns = columns_of(alternatives)
        records, alike = self._handle.scores(self.state, list(columns.values()), self.alpha, 0.8)
        for name, record in zip(columns, records, strict=True):
            figures = (record[key] for key in ("p_value", "size", "detectable", "effect"))
            if any(np.isnan(figure).any() for figure in figures):
                raise InputError(f"alternatives[{name!r}]: its test overflows float64")
        names = list(columns)
        per_unit = self._per_unit(columns, records)
        found = [
            Alternative(
                name=name,
                p_value=record["p_value"],
                restored=record["restored"],
                size=record["size"],
                detectable=record["detectable"],
                effect=record["effect"],
                per_unit=per_unit[name],
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

    def _per_unit(
        self, columns: Mapping[str, Array], records: Sequence[Mapping[str, Any]]
    ) -> dict[str, Array]:
        """Return how far each state follows a unit of each alternative of one parameter."""
        found = {}
        rows: Array | None = None
        for (name, column), record in zip(columns.items(), records, strict=True):
            if column.shape[1] != 1:
                found[name] = np.full(len(self.names), np.nan)
            elif record["dof"]:
                found[name] = record["effect"] / record["detectable"]
            else:
                # The columns of the states make it up.
                if rows is None:
                    rows = np.asarray(self._handle.linearize(self.state)[1])
                    length = np.linalg.norm(rows, axis=0)
                    length[length == 0] = 1.0
                whole = np.zeros(len(rows))
                whole[: len(column)] = column[:, 0]
                shares = np.linalg.lstsq(rows / length, whole, rcond=None)[0]
                shares[np.abs(shares) < 1e-7 * np.abs(shares).max(initial=0.0)] = 0.0
                found[name] = shares / length
        return found

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
            checked = _OwnFunction(what, name, self.names)
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
        what: str
        | Mapping[str, float]
        | ArrayLike
        | Callable[[Array], float | tuple[float, Array]],
        level: float = 0.95,
    ) -> Interval:
        """Return the values of a state or function that the measurements allow.

        Parameters
        ----------
        what : str, mapping, array_like, shape (n,), or callable
            A state or a function of the model by its name; the coefficients of a
            combination of states; or a function of the state, ``x -> value`` (differentiated
            by differences) or ``x -> (value, gradient)``.
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
        return critical_at(level, dof)

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
        rises = (critical_at(0.95, 1), critical_at(0.95, len(self.names)))
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
        alternatives, together at alpha; the correlation of neighbouring residuals. With
        Tukey's loss whether it counts less than half of the measurements.
        """
        fit = self.fit
        # Exact data repeat themselves.
        if fit.faults and not fit.warning:
            return "; ".join(fit.faults)
        if self._loss[0] != "squares":
            return self._rejected or self._colored
        best = next((a for a in fit.alternatives if a.dof > 0), None)
        if fit.dof > 0 and fit.p_value < self.alpha:
            reason = (
                f"chi2 = {fit.chi2:.4g} for {fit.dof} degrees of freedom (p = {fit.p_value:.2g}): "
                "the model does not fit"
            )
            if best is not None and best.restored > self.alpha:
                reason += f"; {best.name} would explain it (p = {best.restored:.2g})"
            if outlying := self._outlying:
                reason += f"; {outlying}"
            return reason
        if best is not None and fit.joint < self.alpha:
            return f"{best.name} shows in the residuals (p = {best.p_value:.2g})"
        return self._colored

    @property
    def _rejected(self) -> str:
        """What says that a redescending loss leaves out most measurements, in words."""
        loss, reach = self._loss
        size = np.abs(self.fit.residuals)
        beyond, there = np.count_nonzero(size > reach), np.count_nonzero(size)
        if loss != "tukey" or not 2 * beyond > there:
            return ""
        return f"{beyond} of {there} residuals are beyond {reach:g} deviations and count nothing"

    @property
    def _colored(self) -> str:
        """What says that the noise is not white, in words; empty where nothing does."""
        fit = self.fit
        white = not not_white(fit.dof, fit.p_value, fit.lag1[3], self.alpha)
        return "" if white or self._loss[0] != "squares" else fit.correlated

    @property
    def _outlying(self) -> str:
        """The few residuals without which the model would fit, in words."""
        fit = self.fit
        size = np.abs(fit.standardized)
        if size.shape != fit.residuals.shape:
            return ""
        worst = fit.outliers[np.argsort(-size[fit.outliers], kind="stable")]
        for count in range(1, min(_OUTLIERS, worst.size, fit.dof - 1) + 1):
            columns = np.zeros((size.size, count))
            columns[worst[:count], np.arange(count)] = 1.0
            (without,) = self.test({"outliers": columns})
            if without.dof == count and without.restored > self.alpha:
                which = ", ".join(
                    f"{index} (off by {brief(size[index], 2)} standard deviations)"
                    for index in sorted(worst[:count].tolist())
                )
                return (
                    f"without {'residual' if count == 1 else 'residuals'} {which} "
                    f"it would fit (p = {without.restored:.2g})"
                )
        return ""

    @property
    def null_combinations(self) -> tuple[str, ...]:
        """Combinations of the states that change no measurement, in words."""
        if not self.names or self._analysis.rank == len(self.names):
            return ()
        return tuple(
            describe_direction(above_noise(direction), self.names)
            for direction in self._analysis.null_space().T
        )

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
            std = float(self.std[index])
            spread = f"+- {readable(std, 3)}"
            if not usable and not np.isfinite(std):
                spread = "not observable: one of many values"
            elif usable and not (interval := self.interval(name, level)).is_local:
                spread = f"({100 * level:g} %: {str(interval).removeprefix(name + ' ')})"
            value = f"{readable(float(self.state[index]), 6)} {unit}".rstrip()
            lines.append(f"  {name}  {value} {spread}")
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
            # Exact data repeat themselves, and so does a dead channel: the reader must judge.
            lines += [fit.warning, *fit.faults]
        elif self.status != "misfit" and not_white(
            fit.dof, fit.p_value, fit.lag1[3], 10 * self.alpha
        ):
            lines.append(f"{fit.correlated}; the intervals are too narrow")
        return [*lines, *self.unseen_errors]

    @property
    def unseen_errors(self) -> tuple[str, ...]:
        """Errors of the model that the fit would not show, in words, the worst first.

        Of the alternatives of the fit those that leave no trace and move several states,
        and those whose smallest detectable size moves a state by more than a standard
        deviation (Baarda's external reliability), three at most.
        """
        std = np.where(self.std > 0, self.std, np.inf)
        hidden = []
        for alternative in self.fit.alternatives:
            if alternative.dof == 0:
                # One that moves a single state is another name of it.
                shift = np.abs(alternative.per_unit) / std
                told = np.count_nonzero(shift > 0) > 1
            else:
                shift = np.abs(alternative.effect) / std
                told = np.isfinite(alternative.detectable) and shift.max(initial=0.0) > 1
            if told:
                worst = int(np.argmax(shift))
                text = _hidden(float(shift[worst]), alternative, self.names[worst])
                hidden.append((shift[worst] if alternative.dof else np.inf, text))
        hidden.sort(key=lambda item: -item[0])
        return tuple(text for _, text in hidden[:3])

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


def _hidden(shift: float, alternative: Alternative, name: str) -> str:
    """Return an error that the fit would not show, and what it does to a state, in words."""

    def size(value: float) -> str:
        return f"{readable(value, 3)} {alternative.unit}".rstrip()

    if alternative.dof == 0:
        return (
            f"{alternative.name} leaves no trace: {size(1 / shift)} would move {name} by a "
            "standard deviation"
        )
    if shift > _FAR:
        # The answer does not follow so far in proportion: what counts is how little it takes.
        return (
            f"{alternative.name} of {size(alternative.detectable / shift)} would move {name} by a "
            f"standard deviation, and up to {size(alternative.detectable)} would go unseen"
        )
    return (
        f"{alternative.name} up to {size(alternative.detectable)} would go unseen and move "
        f"{name} by {brief(shift)} standard deviations"
    )


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
    constant: float | None = None,
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
    constant : float, optional
        Of the loss, in deviations; by default that of 95 % efficiency on normal noise: 1.345
        for Huber, 4.685 for Tukey.
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
    z = measured(model, measurements)
    known = as_known(known, model.names, model.units, "known")
    box = as_box(box, model.names, model.units)
    before, known = knowledge_of(model, prior, known)
    free = [k for k, name in enumerate(model.names) if name not in known]
    names = tuple(model.names[k] for k in free)
    if not names:
        raise InputError("every state is known: nothing is left to estimate")
    loss = options.choice(loss, "loss", _LOSSES)
    alpha, chance, weak_ratio = levels(alpha, chance, weak_ratio)
    search = options.flag(search, "search")
    starts = whole(starts, "starts", 0, 2**31)
    seed = whole(seed, "seed", 0, SEED_MOST)
    max_iterations = whole(max_iterations, "max_iterations", 1, ITERATIONS_MOST)
    handle = informed(model, z, before, known)
    spread = spread_of(names, before, box, tuple(model.names))
    first = starts_of(model, z, start, free, spread, before, names)
    weighting = (loss, _LOSSES[loss] if constant is None else number(constant, "constant"))
    if loss != "squares" and not weighting[1] > 0:
        raise InputError(f"constant = {weighting[1]}: must be > 0")
    check_shapes(model, z, _whole(first[0], free, known, model.names))
    if loss == "tukey":
        # Where every residual is beyond its reach it has no slope: from where Huber's ends too.
        near = handle.minimize(first, ("huber", _LOSSES["huber"]), max_iterations)
        first = np.vstack([*(one["x"] for one in near[:1]), first])
    found = handle.minimize(first, weighting, max_iterations)
    if not found:
        # With the reason, where there is one.
        handle.linearize(first[0])
        raise InputError("the model has no value at any of the starts")
    best = found[0]
    check_rows(model, z, _whole(best["x"], free, known, model.names))
    others: tuple[Solution, ...] = ()
    unseen = 1.0
    if search and best["converged"] and loss == "squares":
        also = np.array([other["x"] for other in found[1:]]).reshape(-1, len(names))
        searched = handle.others(best["x"], also, spread, starts, seed)
        unseen = searched["unseen"]
        best = best | {"x": searched["x"], "chi2": searched["chi2"]}
        others = tuple(solution_of(other) for other in searched["others"])
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


def _whole(x: Array, free: list[int], known: Mapping[str, float], names: Sequence[str]) -> Array:
    """Return a state with what is known."""
    whole = np.array([known.get(name, 0.0) for name in names])
    whole[free] = x
    return whole


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
    exact = exact_data(model, state)
    before, _ = knowledge_of(model, prior, {})
    spread = spread_of(names, before, as_box(box, names, model.units), names)
    handle = informed(model, exact, None, {})
    starts, seed = whole(starts, "starts", 0, 2**31), whole(seed, "seed", 0, SEED_MOST)
    found = handle.others(state, np.empty((0, len(names))), spread, starts, seed)
    return tuple(solution_of(other) for other in found["others"])


def solution_of(record: Mapping[str, Any]) -> Solution:
    return Solution(
        record["x"], record["chi2"], record["distance"], record["chance"], record["hits"]
    )
