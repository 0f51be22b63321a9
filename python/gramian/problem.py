"""A problem: whitened rows with the names, units and scales of their states."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import as_float_array, finite
from gramian._registry import load
from gramian.exceptions import InputError

__all__ = ["Problem", "from_function"]

Array = NDArray[np.float64]


@dataclass(frozen=True, init=False, eq=False)
class Problem:
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
    ) -> None:
        names = _checked_names(names)
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
        scales = _checked_scale(scales, names)
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
        self._set(
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
    ) -> Problem:
        """Make a problem of parts that a model made and that fit: no check, no copy."""
        problem = object.__new__(cls)
        problem._set(
            rows=rows,
            names=names,
            units=units,
            scale=np.full(len(names), np.nan),
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
        return other

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
        if not self.priors:
            return self.rows
        prior = [self.direction(name) / sigma for name, sigma in self.priors.items()]
        return np.vstack([self.rows, *prior])

    def with_rows(self, rows: ArrayLike) -> Problem:
        """Return the same problem with other measurement rows (K, n)."""
        array = _finite(rows, "rows")
        if array.ndim != 2 or array.shape[1] != self.n:
            raise InputError(f"rows has shape {array.shape}: must be (measurements, {self.n})")
        return self._replaced(rows=array)

    def with_scale(self, scale: ArrayLike | Mapping[str, float]) -> Problem:
        """Return the problem with the deviations that would be useless: all, or some by name."""
        if isinstance(scale, Mapping):
            values = self.scale.copy()
            for name, value in scale.items():
                values[self.index(name)] = as_float_array(value, f"scale of {name}")
        else:
            values = as_float_array(scale, "scale").copy()
        return self._replaced(scale=_checked_scale(values, self.names))

    def fix(self, *names: str) -> Problem:
        """Return the problem with these states known exactly.

        Parameters
        ----------
        *names : str
            States; their columns fall away.
        """
        return self._keep([i for i in range(self.n) if i not in self._indices(names)])

    def prior(self, sigmas: Mapping[str, float]) -> Problem:
        """Return the problem with prior knowledge added.

        Parameters
        ----------
        sigmas : mapping of str to float
            Standard deviation of what is known beforehand of a state or named
            combination, independent of the measurements and of each other. A
            second prior of the same state is combined with the first.
        """
        priors = dict(self.priors)
        for name, sigma in options.deviations(sigmas, "prior").items():
            self.direction(name)
            before = priors.get(name)
            both = sigma if before is None else 1 / np.hypot(1 / sigma, 1 / before)
            priors[name] = float(both)
        return self._replaced(priors=MappingProxyType(priors))

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
        rows = np.vstack([self.rows, *prior])
        left = _core.marginal_rows(rows[:, out + keep], len(out), self.rtol)
        stay = {name: sigma for name, sigma in self.priors.items() if name not in used}
        return self._keep(keep, rows=left, priors=stay)

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
        joined = Problem(
            np.vstack([spread(self.rows, self.names), spread(other.rows, other.names)]),
            names,
            units=units,
            scale=scale,
            rtol=max(tolerances, default=None),
            combinations=combinations,
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
        if rows is None:
            rows, gone_matters = self.rows[:, keep], False
        else:
            gone_matters = True
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
        return self._replaced(
            rows=rows,
            names=names,
            units=tuple(self.units[i] for i in keep),
            scale=self.scale[keep],
            priors=MappingProxyType(priors),
            combinations=MappingProxyType(combinations),
        )


def as_problem(problem_or_rows: Problem | ArrayLike, names: Sequence[str] | None) -> Problem:
    """Return the problem, or plain rows as one."""
    if isinstance(problem_or_rows, Problem):
        if names is not None:
            raise InputError("names was given with a problem, which has its own")
        return problem_or_rows
    if is_sparse(problem_or_rows):
        return Problem(problem_or_rows, names)  # type: ignore[arg-type]
    rows = as_float_array(problem_or_rows, "rows")
    if rows.ndim != 2 or 0 in rows.shape:
        raise InputError(f"rows has shape {rows.shape}: must be (rows, states), not empty")
    return Problem(rows, names or [f"x{i}" for i in range(rows.shape[1])])


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


def from_function(
    h: Callable[[Array], ArrayLike],
    x: ArrayLike,
    sigma: ArrayLike,
    names: Sequence[str],
    *,
    method: Literal["central", "complex", "given"] = "central",
    jacobian: Callable[[Array], ArrayLike] | None = None,
    units: Sequence[str] | None = None,
    scale: ArrayLike | None = None,
    combinations: Mapping[str, ArrayLike] | None = None,
) -> Problem:
    """Make a problem of a measurement function of your own.

    Parameters
    ----------
    h : callable
        Takes the state (n,), returns the measurements (K,).
    x : array_like, shape (n,)
        The state at which the question is asked.
    sigma : array_like, shape (), (K,) or (K, K)
        Standard deviation of all measurements or of each, or their covariance.
    names : sequence of str, length n
        The states.
    method : {"central", "complex", "given"}
        How the Jacobian is found: fourth-order central differences with a step
        scaled to each state; a complex step, exact to rounding, for an `h` that
        accepts complex numbers and is analytic in them (no abs, no comparison);
        or the function `jacobian`.
    jacobian : callable, optional
        Takes the state (n,), returns (K, n). Needed by ``method="given"`` only.
    units, scale, combinations : optional
        As for `Problem`. The scale also sets the step of the differences.

    Returns
    -------
    Problem
        With `rtol` set to the error of the differences, so that their noise is
        not taken for information.

    Raises
    ------
    InputError
        Shapes that do not fit, a sigma that is not positive, a covariance that
        is not positive definite, a result that is not finite.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> ranges = lambda p: [np.hypot(p[0], p[1]), np.hypot(p[0] - 100, p[1])]
    >>> problem = gm.from_function(ranges, [30.0, 40.0], 1.0, ["east", "north"])
    >>> gm.analyze(problem).rank
    2
    """
    names = _checked_names(names)
    options.function(h, "h")
    options.choice(method, "method", ("central", "complex", "given"))
    if jacobian is not None:
        options.function(jacobian, "jacobian")
    state = _finite(x, "x")
    if state.shape != (len(names),):
        raise InputError(f"x has shape {state.shape}: must be ({len(names)},), one for each name")
    if (method == "given") != (jacobian is not None):
        raise InputError(
            f'method = "{method}" with jacobian {"given" if jacobian is not None else "missing"}: '
            'a jacobian goes with method = "given" and with no other'
        )
    rtol: float | None = None
    if jacobian is not None:
        values = _finite(jacobian(state), "jacobian(x)")
    elif method == "complex":
        values = _complex_step(h, state)
    elif method == "central":
        values, rtol = _central_differences(h, state, scale)
    else:
        raise InputError(f'method = {method!r}: must be "central", "complex" or "given"')
    if values.ndim != 2 or values.shape[1] != len(names):
        raise InputError(
            f"the Jacobian has shape {values.shape}: must be (measurements, {len(names)})"
        )
    rows = _whitened(values, sigma)
    return Problem(rows, names, units=units, scale=scale, rtol=rtol, combinations=combinations)


def _whitened(jacobian: Array, sigma: ArrayLike) -> Array:
    noise = _finite(sigma, "sigma")
    count = jacobian.shape[0]
    if noise.ndim < 2:
        if noise.ndim == 1 and noise.shape != (count,):
            raise InputError(f"sigma has {noise.shape[0]} entries: must have 1 or {count}")
        if (bad := np.argwhere(np.atleast_1d(noise) <= 0)).size:
            i = int(bad[0][0])
            raise InputError(f"sigma[{i}] = {np.atleast_1d(noise)[i]}: must be > 0")
        whitened: Array = jacobian / np.broadcast_to(noise, (count,))[:, None]
        return whitened
    if noise.shape != (count, count):
        raise InputError(f"sigma has shape {noise.shape}: a covariance must be ({count}, {count})")
    if not np.allclose(noise, noise.T, rtol=1e-10, atol=0):
        raise InputError("sigma is not symmetric: a covariance must be")
    from scipy.linalg import solve_triangular

    try:
        factor = np.linalg.cholesky(noise)
    except np.linalg.LinAlgError:
        raise InputError("sigma is not positive definite: a covariance must be") from None
    result: Array = solve_triangular(factor, jacobian, lower=True)
    return result


def _complex_step(h: Callable[[Array], ArrayLike], x: Array) -> Array:
    columns = []
    for i in range(x.size):
        step = 1e-100 * max(1.0, abs(x[i]))
        moved: Any = x.astype(complex)
        moved[i] += 1j * step
        try:
            values = np.asarray(h(moved))
        except TypeError as error:
            raise InputError(f"h does not accept complex numbers: {error}") from error
        if not np.iscomplexobj(values):
            raise InputError(
                'h returns real numbers for a complex state: use method = "central", '
                "or an h without abs, real or conversions to float"
            )
        columns.append(values.ravel().imag / step)
    return _finite(np.stack(columns, axis=1), "the complex-step Jacobian of h")


def _central_differences(
    h: Callable[[Array], ArrayLike], x: Array, scale: ArrayLike | None
) -> tuple[Array, float]:
    size = np.abs(x)
    if scale is not None:
        known = as_float_array(scale, "scale")
        if known.shape == x.shape:
            size = np.fmax(size, known)
    # A state at 0 with no scale gives no hint of its size.
    size[size == 0] = 1.0
    steps = np.finfo(float).eps ** 0.2 * size

    def difference(i: int, step: float) -> Array:
        ends = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[i] += sign * step
            ends.append((moved[i], _finite(h(moved), "h(x)").ravel()))
        (upper, above), (lower, below) = ends
        change: Array = (above - below) / (upper - lower)
        return change

    columns, error = [], 0.0
    for i, step in enumerate(steps):
        wide, narrow = difference(i, step), difference(i, step / 2)
        column = (4 * narrow - wide) / 3
        norm = np.linalg.norm(column)
        if norm > 0:
            # Twice the true error of the better estimate at most, in practice.
            error = max(error, float(np.linalg.norm(narrow - wide) / norm) ** 2)
        columns.append(column)
    return np.stack(columns, axis=1), min(max(1e-9, error), 1e-2)


def _checked_names(names: Sequence[str]) -> tuple[str, ...]:
    checked = options.names(names, "names")
    for i, name in enumerate(checked):
        if not name:
            raise InputError(f"names[{i}] = {name!r}: must be a non-empty string")
        if name in checked[:i]:
            raise InputError(f"names[{i}] = {name!r}: that name is taken by another state")
    if not checked:
        raise InputError("names is empty: there must be at least one state")
    return checked


def _checked_scale(scale: Array, names: tuple[str, ...]) -> Array:
    if scale.shape != (len(names),):
        raise InputError(f"scale has shape {scale.shape}: must be ({len(names)},)")
    for name, value in zip(names, scale, strict=True):
        if not (np.isnan(value) or 0 < value < np.inf):
            raise InputError(f"scale of {name} = {value}: must be > 0 and finite")
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
