"""A problem: whitened rows with the names, units and scales of their states."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import as_float_array, finite
from gramian._noise import as_knowledge
from gramian._registry import load
from gramian._text import brief
from gramian._values import Value
from gramian.exceptions import InputError

__all__ = ["Accuracy", "Problem"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Accuracy(Value):
    """How accurate the derivatives of a model are, and how they were found.

    Attributes
    ----------
    method : str
        As given to `from_function`.
    error : ndarray, shape (m, n), or None
        Error of each derivative, before whitening; None where they are taken as exact.
    noise : ndarray, shape (m,), or None
        Standard deviation of the noise of h itself, where it was measured.
    step : ndarray, shape (n,), or None
        The longest step by which each state was moved.
    evaluations : int
        How often h and its Jacobian were evaluated.
    groups : int
        Groups of states that were moved together.
    """

    method: str
    error: Array | None
    noise: Array | None
    step: Array | None
    evaluations: int
    groups: int

    def keeping(self, states: list[int]) -> Accuracy:
        """Return that of these states alone."""
        return replace(
            self,
            error=None if self.error is None else self.error[:, states],
            step=None if self.step is None else self.step[states],
        )

    def summary(self) -> str:
        """Return it in a line."""
        if self.error is None:
            return f"rows by {self.method}, taken as exact"
        text = f"rows by {self.method}, errors up to {brief(self.error.max(initial=0.0), 2)}"
        if self.noise is not None:
            text += f", noise of h up to {brief(self.noise.max(initial=0.0), 2)}"
        return f"{text}, {self.evaluations} evaluations"


@dataclass(frozen=True)
class Doubt(Value):
    """What the errors of the rows leave open.

    Attributes
    ----------
    rtol : float or None
        Relative accuracy of the rows with unit columns, where it is worse than rounding.
    vague : tuple of int
        States whose columns may be zero and may be not.
    nothing : tuple of int
        States whose columns are rounding alone.
    """

    rtol: float | None
    vague: tuple[int, ...]
    nothing: tuple[int, ...]


class ProblemSource(ABC):
    """What can be asked as a problem: a model at its state."""

    @abstractmethod
    def problem(self) -> Problem:
        """Return the problem."""


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Problem(Value):
    """Whitened Jacobian rows and what their columns mean.

    Parameters
    ----------
    rows : array_like, shape (K, n)
        One row for each measurement: (d h / d x) / sigma. No row at all, shape
        (0, n), is a problem of which nothing is measured. A ``scipy.sparse`` matrix, or
        triplets (values, (rows, columns)), makes a `gramian.large.SparseProblem`, which
        has further parameters.
    names : sequence of str, length n
        The states.
    units : sequence of str, length n, optional
        Their units, for reports.
    scale : array_like, shape (n,), optional
        For each state, the deviation that would be useless: a bound above it
        counts as weak. NaN where a state has none.
    rtol : float, optional
        Relative accuracy of the rows where it is worse than rounding (rows from
        differences, positions with large offsets); ranks are decided above it.
    combinations : mapping of str to array_like, shape (n,), optional
        Named linear combinations of the states, offered as knowledge beside the
        states themselves: ``{"climb rate": [0, 0, 1, 0]}``.
    row_error : array_like, shape (K, n), optional
        Largest error of each entry of the rows, where they are not exact. What it cannot
        tell from zero makes the status "undecided".
    row_sigma : array_like, shape () or (n,), optional
        Standard deviation of random errors in the entries of each column: of normals
        that were measured, for one. Information that such errors alone would show counts
        as none, and the rest is corrected for them.

    Raises
    ------
    InputError
        A shape, name or number that does not fit.

    Notes
    -----
    A problem is never changed: each method returns another one.

    Examples
    --------
    >>> import gramian as gm
    >>> problem = gm.Problem([[1.0, 1.0], [1.0, 2.0], [1.0, 3.0]], ["level", "slope"])
    >>> gm.analyze(problem).status
    'observable'
    >>> problem.fix("level").names
    ('slope',)
    """

    rows: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: Array
    rtol: float | None
    priors: Mapping[str, float]
    combinations: Mapping[str, Array] = field(repr=False)
    constraints: Array = field(repr=False)
    prior_rows: Array = field(repr=False)
    row_error: Array | None = field(repr=False)
    row_sigma: Array | None = field(repr=False)
    accuracy: Accuracy | None = field(repr=False)

    #: What a model made it of, where that is remembered: no field, so it is neither compared
    #: nor stored.
    _made_of: ClassVar[tuple[str, tuple[Any, ...]] | None] = None

    def __new__(cls, rows: Any = None, *args: Any, **options: Any) -> Problem:
        """Make a `gramian.large.SparseProblem` of sparse rows."""
        made: type = load("large").SparseProblem if cls is Problem and is_sparse(rows) else cls
        return object.__new__(made)

    def __init__(
        self,
        rows: ArrayLike,
        names: Sequence[str],
        *,
        units: Sequence[str] | None = None,
        scale: ArrayLike | None = None,
        rtol: float | None = None,
        combinations: Mapping[str, ArrayLike] | None = None,
        row_error: ArrayLike | None = None,
        row_sigma: ArrayLike | None = None,
    ) -> None:
        names = checked_names(names)
        n = len(names)
        array = _finite(rows, "rows")
        if array.ndim != 2 or array.shape[1] != n:
            raise InputError(
                f"rows has shape {array.shape}: must be (measurements, {n}), "
                f"one column for each of the states {', '.join(names)}"
            )
        if units is not None:
            units = options.names(units, "units", "strings")
        if units is not None and len(units) != n:
            raise InputError(f"units has {len(units)} entries: must have {n}, one for each state")
        scales = np.full(n, np.nan) if scale is None else as_float_array(scale, "scale").copy()
        scales = checked_scale(scales, names)
        if rtol is not None:
            rtol = options.fraction(rtol, "rtol")
        checked = {
            key: _combination(value, f"combinations[{key!r}]", n)
            for key, value in options.mapping(
                combinations, "combinations", "name to coefficients"
            ).items()
        }
        if taken := set(checked) & set(names):
            raise InputError(f"combinations has {sorted(taken)[0]!r}: that is a state's name")
        if row_error is not None:
            row_error = as_float_array(row_error, "row_error").copy()
            if row_error.shape != array.shape or not (row_error >= 0).all():
                raise InputError(
                    f"row_error has shape {row_error.shape}: must be {array.shape}, all >= 0"
                )
        if row_sigma is not None:
            each = finite(row_sigma, "row_sigma")
            if each.shape not in {(), (n,)} or not (each >= 0).all():
                raise InputError(
                    f"row_sigma has shape {each.shape}: must be one number or ({n},), all >= 0"
                )
            row_sigma = np.array(np.broadcast_to(each, (n,)))
        self._set(
            constraints=np.zeros((0, n)),
            prior_rows=np.zeros((0, n)),
            row_error=row_error,
            row_sigma=row_sigma,
            accuracy=None,
            rows=array,
            names=names,
            units=tuple(units) if units is not None else ("",) * n,
            scale=scales,
            rtol=rtol,
            priors=MappingProxyType({}),
            combinations=MappingProxyType(checked),
        )

    @classmethod
    def _of_parts(
        cls,
        rows: Array,
        names: tuple[str, ...],
        units: tuple[str, ...],
        rtol: float | None,
        combinations: dict[str, Array],
        scale: Array,
    ) -> Problem:
        """Make a problem of parts that a model made and that fit: no check, no copy."""
        problem = object.__new__(cls)
        n = len(names)
        problem._set(
            constraints=np.zeros((0, n)),
            prior_rows=np.zeros((0, n)),
            row_error=None,
            row_sigma=None,
            accuracy=None,
            rows=rows,
            names=names,
            units=units,
            scale=scale,
            rtol=rtol,
            priors=MappingProxyType({}),
            combinations=MappingProxyType(combinations),
        )
        return problem

    def _set(self, **values: object) -> None:
        for key, value in values.items():
            object.__setattr__(self, key, value)

    def _replaced(self, **values: object) -> Problem:
        other = object.__new__(Problem)
        current = {name: getattr(self, name) for name in self.__dataclass_fields__}
        other._set(**(current | values))
        # Other rows are not what the model made, nor judged by its scale where that changed.
        kept = None if values.keys() & {"rows", "scale"} else self._made_of
        other._set(_made_of=kept)
        return other

    def _of(self, kind: str, *parts: Any) -> Problem:
        """Return the problem with what a model made it of, for `gramian.explore`."""
        self._set(_made_of=(kind, parts))
        return self

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.names)

    def index(self, name: str) -> int:
        """Return the column of a state.

        Raises
        ------
        InputError
            If there is no such state.
        """
        if isinstance(name, str) and name in self.names:
            return self.names.index(name)
        raise InputError(
            f"no state is named {options.given(name)}: the states are {', '.join(self.names)}"
        )

    def direction(self, name: str) -> Array:
        """Return the coefficients (n,) of a state or named combination."""
        if not isinstance(name, str):
            self.index(name)
        if name in self.combinations:
            return self.combinations[name]
        if name not in self.names and self.combinations:
            raise InputError(
                f"no state or combination is named {options.given(name)}: "
                f"there are {', '.join((*self.names, *self.combinations))}"
            )
        direction = np.zeros(self.n)
        direction[self.index(name)] = 1.0
        return direction

    @property
    def all_rows(self) -> Array:
        """The rows of the measurements and below them those of the priors."""
        if not self.has_prior:
            return self.rows
        prior = [self.direction(name) / sigma for name, sigma in self.priors.items()]
        return np.vstack([self.rows, self.prior_rows, *prior])

    @property
    def has_prior(self) -> bool:
        """Whether anything but exact knowledge was known beforehand."""
        return bool(self.priors) or len(self.prior_rows) > 0

    @property
    def data_rows(self) -> Array:
        """The rows of the measurements with what their random errors leave of them."""
        if self.row_sigma is None or not self.row_sigma.any() or not len(self.rows):
            return self.rows
        return _core.rows_without_noise(self.rows, self.row_sigma)

    def doubt(self) -> Doubt:
        """Return what the errors of the rows leave open."""
        if self.row_error is None or self.rtol is not None:
            return Doubt(self.rtol, (), ())
        norms = np.linalg.norm(self.rows, axis=0) if len(self.rows) else np.zeros(self.n)
        errors = np.linalg.norm(self.row_error, axis=0)
        hidden = (errors > 0) & ~(errors < norms / 3)
        # A column of rounding alone: not even a step as long as the state would show.
        step = None if self.accuracy is None else self.accuracy.step
        reach = errors * (1.0 if step is None else step)
        # One as large as its error, as the mean of two slopes at a kink is, is no rounding
        # where only tiny steps were taken.
        there = (errors < 1.5 * norms) & (reach > 1e-10)
        nothing = hidden & (reach < 1e-6) & ~there
        vague = hidden & ~nothing
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.where(hidden | (errors == 0), 0.0, errors / norms)
        rtol = float(np.linalg.norm(relative))
        default = 32 * np.finfo(float).eps * np.sqrt(max(self.rows.shape))
        return Doubt(
            min(rtol, 0.5) if rtol > default else None,
            tuple(np.flatnonzero(vague).tolist()),
            tuple(np.flatnonzero(nothing).tolist()),
        )

    def factor(self, *, prior: bool = True, rtol: float | None = None) -> _core.Analysis:
        """Return the rows reduced, with or without prior knowledge, exact one included."""
        prior, rtol = options.flag(prior, "prior"), options.tolerance(rtol)
        doubt = self.doubt()
        rows, errors = self.data_rows, self.row_error
        if cut := doubt.vague + doubt.nothing:
            rows = rows.copy()
            rows[:, cut] = 0.0
            if errors is not None:
                errors = errors.copy()
                errors[:, cut] = 0.0
        if self.rtol is not None or rtol is not None or len(rows) != len(self.rows):
            errors = None
        if prior and self.has_prior:
            known = self.all_rows[len(self.rows) :]
            rows = np.vstack([rows, known])
            errors = None if errors is None else np.vstack([errors, np.zeros_like(known)])
        exact = self.constraints if len(self.constraints) else None
        tolerance = doubt.rtol if rtol is None else rtol
        return _core.Analysis(
            at_least_one_row(rows), tolerance, exact, errors if len(rows) else None
        )

    def with_rows(self, rows: ArrayLike) -> Problem:
        """Return the same problem with other measurement rows (K, n)."""
        array = _finite(rows, "rows")
        if array.ndim != 2 or array.shape[1] != self.n:
            raise InputError(f"rows has shape {array.shape}: must be (measurements, {self.n})")
        return self._replaced(rows=array, row_error=None, accuracy=None)

    def keep_rows(self, kept: ArrayLike) -> Problem:
        """Return the problem with some of its measurements: indices, or a mask (K,)."""
        chosen = _chosen(kept, self.rows.shape[0])
        errors = None if self.row_error is None else self.row_error[chosen]
        return self._replaced(rows=self.rows[chosen], row_error=errors)

    def with_scale(self, scale: ArrayLike | Mapping[str, float]) -> Problem:
        """Return the problem with the deviations that would be useless: all, or some by name."""
        if isinstance(scale, Mapping):
            values = self.scale.copy()
            for name, value in scale.items():
                values[self.index(name)] = as_float_array(value, f"scale of {name}")
        else:
            values = as_float_array(scale, "scale").copy()
        return self._replaced(scale=checked_scale(values, self.names))

    def fix(self, *names: str) -> Problem:
        """Return the problem with these known exactly.

        Parameters
        ----------
        *names : str
            States, whose columns fall away, or named combinations.
        """
        for name in names:
            self.direction(name)
        states = [name for name in names if name not in self.combinations]
        combined = [self.combinations[name] for name in names if name in self.combinations]
        problem = self.constrain(np.array(combined)) if combined else self
        if not states:
            return problem
        gone = self._indices(states)
        return problem._keep([i for i in range(self.n) if i not in gone])

    def constrain(self, rows: ArrayLike) -> Problem:
        """Return the problem with combinations of the states known exactly.

        Parameters
        ----------
        rows : array_like, shape (q, n)
            Their coefficients: normals of the surface a state lies on, for one.
        """
        array = np.atleast_2d(_finite(rows, "rows"))
        if array.ndim != 2 or array.shape[1] != self.n:
            raise InputError(f"rows has shape {array.shape}: must be (constraints, {self.n})")
        return self._replaced(constraints=np.vstack([self.constraints, array]))

    def prior(self, sigmas: Mapping[str, Any] | ArrayLike) -> Problem:
        """Return the problem with prior knowledge added.

        Parameters
        ----------
        sigmas : mapping of str to float or (mean, sigma), or array_like (n,) or (n, n)
            Standard deviation of what is known beforehand of a state or named
            combination, independent of the measurements and of each other: 0 for what is
            known exactly, `inf` for nothing. A mean makes no difference here. A second
            prior of the same state is combined with the first. As an array, one for each
            state, or their covariance, also as a tuple (mean, covariance).
        """
        known = as_knowledge(sigmas, self.names, self.combinations, units=self.units)
        priors, rows = dict(self.priors), [self.prior_rows]
        for name, row, sigma in zip(known.names, known.rows, known.sigma.tolist(), strict=True):
            if sigma == 0:
                continue
            if name is None:
                rows.append(row[None] / sigma)
                continue
            priors[name] = 1 / np.hypot(1 / sigma, 1 / priors[name]) if name in priors else sigma
        problem = self._replaced(priors=MappingProxyType(priors), prior_rows=np.vstack(rows))
        return problem.constrain(known.exact) if len(known.exact) else problem

    def marginalize(self, names: Iterable[str]) -> Problem:
        """Return the problem of the other states, with these not known at all.

        Parameters
        ----------
        names : iterable of str
            Nuisance states. Their priors and those of combinations with them
            are used on the way.

        Notes
        -----
        The rows are reduced by a pivoted orthogonal factorisation; the
        information left is the Schur complement, without forming it.
        """
        wanted = (names,) if isinstance(names, str) else names
        out = self._indices(options.names(wanted, "names", "names of states"))
        keep = [i for i in range(self.n) if i not in out]
        if not keep:
            raise InputError("marginalize was given every state: at least one must be left")
        # Priors that touch an eliminated state go into the rows; others stay.
        used = {name for name in self.priors if self.direction(name)[out].any()}
        prior = [self.direction(name) / self.priors[name] for name in self.priors if name in used]
        # What is known exactly of an eliminated state is heavy there, not exact.
        if self.constraints[:, out].any():
            raise InputError("marginalize: a state to eliminate is part of an exact constraint")
        rows = np.vstack([self.rows, self.prior_rows, *prior])
        rtol = self.rtol
        if self.row_error is not None:
            norms = np.linalg.norm(self.rows, axis=0)
            relative = np.linalg.norm(self.row_error / np.where(norms > 0, norms, 1.0))
            rtol = min(0.5, max(float(relative), rtol or 0.0)) or None
        left = _core.marginal_rows(rows[:, out + keep], len(out), rtol)
        stay = {name: sigma for name, sigma in self.priors.items() if name not in used}
        problem = self._replaced(row_error=None, prior_rows=np.zeros((0, self.n)), rtol=rtol)
        return problem._keep(keep, rows=left, priors=stay)

    def __add__(self, other: Problem) -> Problem:
        """Join independent measurements; states of the same name are the same."""
        if not isinstance(other, Problem):
            return NotImplemented
        names = self.names + tuple(name for name in other.names if name not in self.names)
        n = len(names)

        def spread(rows: Array, own: tuple[str, ...]) -> Array:
            wide = np.zeros((*rows.shape[:-1], n))
            wide[..., [names.index(name) for name in own]] = rows
            return wide

        units, scale = [], np.full(n, np.nan)
        for i, name in enumerate(names):
            given = [p.units[p.index(name)] for p in (self, other) if name in p.names]
            if len({unit for unit in given if unit}) > 1:
                raise InputError(
                    f"state {name} is in {given[0]} in one problem, {given[1]} in other"
                )
            units.append(next((unit for unit in given if unit), ""))
            scales = [p.scale[p.index(name)] for p in (self, other) if name in p.names]
            finite = [s for s in scales if not np.isnan(s)]
            scale[i] = min(finite, default=np.nan)
        tolerances = [p.rtol for p in (self, other) if p.rtol is not None]
        combinations = {
            key: spread(value, p.names)
            for p in (other, self)
            for key, value in p.combinations.items()
        }
        errors = None
        if self.row_error is not None or other.row_error is not None:
            errors = np.vstack(
                [
                    spread(np.zeros_like(p.rows) if p.row_error is None else p.row_error, p.names)
                    for p in (self, other)
                ]
            )
        joined = Problem(
            np.vstack([spread(self.rows, self.names), spread(other.rows, other.names)]),
            names,
            units=units,
            scale=scale,
            rtol=max(tolerances, default=None),
            combinations=combinations,
            row_error=errors,
        )
        joined = joined._replaced(
            constraints=np.vstack([spread(p.constraints, p.names) for p in (self, other)]),
            prior_rows=np.vstack([spread(p.prior_rows, p.names) for p in (self, other)]),
        )
        return joined.prior(self.priors).prior(other.priors)

    def _indices(self, names: Sequence[str]) -> list[int]:
        indices = [self.index(name) for name in names]
        if len(indices) == self.n:
            raise InputError("every state was named: at least one must be left")
        return indices

    def _keep(
        self, keep: list[int], rows: Array | None = None, priors: Mapping[str, float] | None = None
    ) -> Problem:
        gone = [i for i in range(self.n) if i not in keep]
        errors = self.row_error
        if rows is None:
            rows, gone_matters = self.rows[:, keep], False
            errors = None if errors is None else errors[:, keep]
        else:
            gone_matters, errors = True, None
        # A combination with a state that was marginalised is not one of what is
        # left; with a state that is known, only its rest is.
        combinations = {
            key: value[keep]
            for key, value in self.combinations.items()
            if value[keep].any() and not (gone_matters and value[gone].any())
        }
        names = tuple(self.names[i] for i in keep)
        priors = self.priors if priors is None else priors
        priors = {key: s for key, s in priors.items() if key in names or key in combinations}
        constraints = self.constraints[:, keep]
        return self._replaced(
            accuracy=None if self.accuracy is None else self.accuracy.keeping(keep),
            constraints=constraints[constraints.any(axis=1)],
            prior_rows=self.prior_rows[:, keep],
            row_error=errors,
            row_sigma=None if self.row_sigma is None else self.row_sigma[keep],
            rows=rows,
            names=names,
            units=tuple(self.units[i] for i in keep),
            scale=self.scale[keep],
            priors=MappingProxyType(priors),
            combinations=MappingProxyType(combinations),
        )


def as_problem(
    problem_or_rows: Problem | ProblemSource | ArrayLike, names: Sequence[str] | None
) -> Problem:
    """Return the problem, that of a model, or plain rows as one."""
    if isinstance(problem_or_rows, ProblemSource):
        problem_or_rows = problem_or_rows.problem()
    if isinstance(problem_or_rows, Problem):
        if names is not None:
            raise InputError("names was given with a problem, which has its own")
        return problem_or_rows
    if is_sparse(problem_or_rows):
        return Problem(problem_or_rows, names)  # type: ignore[arg-type]
    rows = as_float_array(problem_or_rows, "rows")
    if rows.ndim != 2 or 0 in rows.shape:
        raise InputError(f"rows has shape {rows.shape}: must be (rows, states), not empty")
    return Problem(rows, [f"x{i}" for i in range(rows.shape[1])] if names is None else names)


def is_sparse(rows: object) -> bool:
    """Say whether rows are a matrix of scipy.sparse, or triplets as it takes them."""
    if hasattr(rows, "tocsr"):
        return True
    return (
        isinstance(rows, tuple)
        and len(rows) == 2
        and isinstance(rows[1], tuple)
        and len(rows[1]) == 2
        and np.ndim(rows[1][0]) == 1
    )


def at_least_one_row(rows: Array) -> Array:
    """Return the rows, or one row of zeros where nothing was measured."""
    return rows if rows.shape[-2] else np.zeros((1, rows.shape[-1]))


def checked_names(names: Sequence[str]) -> tuple[str, ...]:
    checked = options.names(names, "names")
    for i, name in enumerate(checked):
        if not name:
            raise InputError(f"names[{i}] = {name!r}: must be a non-empty string")
        if name in checked[:i]:
            raise InputError(f"names[{i}] = {name!r}: that name is taken by another state")
    if not checked:
        raise InputError("names is empty: there must be at least one state")
    return checked


def _chosen(kept: ArrayLike, rows: int) -> NDArray[np.intp]:
    """Return the numbers of the rows that are kept, given by these or by a mask."""
    try:
        given = np.asarray(kept)
    except (TypeError, ValueError):
        given = np.zeros((0, 0))
    wrong = f"kept = {options.given(kept)}: must be a mask ({rows},) or numbers of rows"
    if given.dtype == bool:
        if given.shape != (rows,):
            raise InputError(f"kept has shape {given.shape}: must be a mask ({rows},)")
        return np.flatnonzero(given)
    if given.ndim != 1 or (given.size and given.dtype.kind not in "iu"):
        raise InputError(wrong)
    outside = (given < -rows) | (given >= rows)
    if outside.any():
        i = int(np.argmax(outside))
        raise InputError(f"kept[{i}] = {given[i]}: there are {rows} rows")
    return given.astype(np.intp)


def checked_scale(scale: Array, names: tuple[str, ...]) -> Array:
    """Return the deviations that would be useless, each > 0 and finite or NaN for none."""
    if scale.shape != (len(names),):
        raise InputError(f"scale has shape {scale.shape}: must be ({len(names)},)")
    wrong = ~np.isnan(scale) & ~((scale > 0) & (scale < np.inf))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InputError(f"scale of {names[i]} = {scale[i]}: must be > 0 and finite")
    return scale


def _combination(value: ArrayLike, name: str, n: int) -> Array:
    array = _finite(value, name)
    if array.shape != (n,):
        raise InputError(f"{name} has shape {array.shape}: must be ({n},)")
    if not array.any():
        raise InputError(f"{name} is zero: must have a coefficient that is not")
    return array


def _finite(value: ArrayLike, name: str) -> Array:
    return finite(value, name).copy()
