"""Sparse rows with the names, blocks and gauges of their states."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import as_float_array, finite, whole
from gramian._noise import as_mean_and_sigma
from gramian.exceptions import GramianError, InputError
from gramian.problem import Problem, checked_scale

__all__ = [
    "SparseProblem",
    "available_bytes",
    "compressed",
    "require_finite_rows",
    "similarity_gauges",
]

Array = NDArray[np.float64]

#: Where Linux says how much memory a control group may take and has taken, of both versions.
_CONTROL_GROUPS = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    (
        "/sys/fs/cgroup/memory/memory.limit_in_bytes",
        "/sys/fs/cgroup/memory/memory.usage_in_bytes",
    ),
)
#: A state's name, unit, scale and place, in memory: what is taken before any factor.
_BYTES_OF_A_STATE = 200
#: Eliminated states leave rows of this accuracy, relative to the columns.
_ELIMINATION = 1e-9


class SparseProblem(Problem):
    """Whitened sparse rows and what their columns mean.

    `gramian.Problem` makes one of these when it is given sparse rows.

    Parameters
    ----------
    rows : scipy.sparse array or matrix, shape (K, n), or (values, (rows, columns))
        One row for each measurement: (d h / d x) / sigma. Duplicate entries are summed,
        as SciPy does; stored zeros count as no entry.
    names : sequence of str, or function of the column number, optional
        The states, "block.state" where they come in blocks ("x12.theta"); x0, x1, ...
        by default.
    units, scale, rtol, combinations : optional
        As for `gramian.Problem`.
    blocks : sequence of str, length n, optional
        The block that each state belongs to; by default what stands before the last dot
        of its name, or the name itself.
    gauges : mapping of str to array_like, shape (n,), optional
        Directions in which all states may move together without a change of any
        measurement, by their names in the field: "translation along x", "scale". They
        are tested, not believed. `similarity_gauges` makes them from positions.
    shape : (int, int), optional
        Of triplets, where it does not follow from the names and the last row.

    Attributes
    ----------
    blocks : tuple of str
        The names of the blocks, in the order of their first states.
    block_of : ndarray, shape (n,)
        The number of each state's block.

    Raises
    ------
    InputError
        A shape, name, index or number that does not fit.

    Examples
    --------
    >>> import gramian as gm
    >>> from scipy.sparse import csr_array
    >>> rows = csr_array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    >>> levelling = gm.Problem(rows, lambda j: f"benchmark{j}.height")
    >>> gm.analyze(levelling).null_combinations
    ('all height of 3 blocks shift alike',)
    >>> gm.analyze(levelling.fix("benchmark0")).status
    'observable'
    """

    rows: Any
    blocks: tuple[str, ...]
    block_of: NDArray[np.int64]
    gauges: Mapping[str, Array]

    _more_fields = ("blocks", "block_of", "gauges")

    def __init__(
        self,
        rows: Any,
        names: Sequence[str] | Callable[[int], str] | None = None,
        *,
        units: Sequence[str] | None = None,
        scale: ArrayLike | None = None,
        rtol: float | None = None,
        combinations: Mapping[str, ArrayLike] | None = None,
        blocks: Sequence[str] | None = None,
        gauges: Mapping[str, ArrayLike] | None = None,
        shape: tuple[int, int] | None = None,
    ) -> None:
        if not hasattr(_core, "SparseAnalysis"):
            raise GramianError(
                "this build of gramian cannot take sparse problems: make demo leaves them out, "
                "pip install . has them"
            )
        if names is not None and not callable(names):
            names = options.names(names, "names", "names or a function")
        count = None if names is None or callable(names) else len(names)
        array = compressed(rows, count, shape)
        n = array.shape[1]
        if n == 0:
            raise InputError(f"rows has shape {array.shape}: must have at least one column")
        _require_memory(_BYTES_OF_A_STATE * n, f"{n} states, named and numbered,")
        listed = _names(names, n)
        if units is not None:
            units = options.names(units, "units", "strings")
        if units is not None and len(units) != n:
            raise InputError(f"units has {len(units)} entries: must have {n}, one for each state")
        scales = np.full(n, np.nan) if scale is None else as_float_array(scale, "scale").copy()
        scales = checked_scale(scales, listed)
        if rtol is not None:
            rtol = options.fraction(rtol, "rtol")
        require_finite_rows(array, listed)
        own = (
            [_before_dot(name) for name in listed]
            if blocks is None
            else options.names(blocks, "blocks", "names of blocks")
        )
        if len(own) != n:
            raise InputError(f"blocks has {len(own)} entries: must have {n}, one for each state")
        number: dict[str, int] = {}
        block_of = np.array([number.setdefault(name, len(number)) for name in own])
        self._set(
            rows=array,
            names=listed,
            units=tuple(units) if units is not None else ("",) * n,
            scale=scales,
            rtol=rtol,
            priors=MappingProxyType({}),
            combinations=_vectors(combinations, "combinations", n),
            constraints=np.zeros((0, n)),
            prior_rows=np.zeros((0, n)),
            row_error=None,
            row_sigma=None,
            accuracy=None,
            blocks=tuple(number),
            block_of=block_of,
            gauges=_vectors(gauges, "gauges", n),
        )
        if taken := set(self.combinations) & self._columns.keys():
            raise InputError(f"combinations has {sorted(taken)[0]!r}: that is a state's name")

    def _replaced(self, **values: object) -> SparseProblem:
        other = object.__new__(SparseProblem)
        fields = (*Problem.__dataclass_fields__, "blocks", "block_of", "gauges")
        current = {name: getattr(self, name) for name in fields}
        other._set(**(current | values))
        return other

    def __repr__(self) -> str:
        return (
            f"SparseProblem({self.rows.shape[0]} rows, {self.n} states in "
            f"{len(self.blocks)} blocks, {self.rows.nnz} entries)"
        )

    @cached_property
    def _columns(self) -> dict[str, int]:
        return {name: j for j, name in enumerate(self.names)}

    @cached_property
    def _block_columns(self) -> dict[str, Any]:
        order = np.argsort(self.block_of, kind="stable")
        starts = np.searchsorted(self.block_of[order], np.arange(len(self.blocks) + 1))
        return {name: order[starts[b] : starts[b + 1]] for b, name in enumerate(self.blocks)}

    def index(self, name: str) -> int:
        """Return the column of a state."""
        if isinstance(name, str) and name in self._columns:
            return self._columns[name]
        raise InputError(f"no state is named {options.given(name)}: {_some(self.names)}")

    def columns_of(self, name: str) -> list[int]:
        """Return the column of a state, or the columns of a block."""
        if isinstance(name, str):
            if name in self._columns:
                return [self._columns[name]]
            if name in self._block_columns:
                return [int(j) for j in self._block_columns[name]]
        raise InputError(
            f"no state or block is named {options.given(name)}: {_some(self.names)}; "
            f"the blocks are {_some(self.blocks, '')}"
        )

    def direction(self, name: str) -> Array:
        """Return the coefficients (n,) of a state or named combination."""
        if isinstance(name, str) and name in self.combinations:
            return self.combinations[name]
        direction = np.zeros(self.n)
        direction[self.index(name)] = 1.0
        return direction

    @property
    def all_rows(self) -> Any:
        """The rows of the measurements and below them those of the priors."""
        if not self.priors:
            return self.rows
        return _stacked([self.rows, self._prior_rows(list(self.priors))])

    def _prior_rows(self, names: Sequence[str]) -> Any:
        from scipy.sparse import coo_array

        i: list[int] = []
        j: list[int] = []
        values: list[float] = []
        for row, name in enumerate(names):
            if name in self.combinations:
                direction = self.combinations[name]
                columns = np.flatnonzero(direction)
                entries = direction[columns] / self.priors[name]
            else:
                columns, entries = np.array([self.index(name)]), np.array([1 / self.priors[name]])
            i += [row] * len(columns)
            j += columns.tolist()
            values += entries.tolist()
        return coo_array((values, (i, j)), shape=(len(names), self.n)).tocsr()

    def with_rows(self, rows: Any) -> SparseProblem:
        """Return the same problem with other measurement rows (K, n)."""
        array = compressed(rows, self.n, None)
        require_finite_rows(array, self.names)
        return self._replaced(rows=array)

    def prior(self, sigmas: Mapping[str, Any] | ArrayLike) -> SparseProblem:
        """Return the problem with prior knowledge added.

        Parameters
        ----------
        sigmas : mapping of str to float or (mean, sigma), or array_like, shape (n,)
            Standard deviation of what is known beforehand of a state, of each state of a
            block, or of a named combination; `inf` for nothing. What is known exactly is
            for `fix`.
        """
        if not isinstance(sigmas, Mapping):
            each = as_float_array(sigmas, "prior")
            if each.shape != (self.n,):
                raise InputError(f"prior has shape {each.shape}: must be ({self.n},)")
            sigmas = dict(zip(self.names, each.tolist(), strict=True))
        spread: dict[str, Any] = {}
        for name, sigma in options.mapping(sigmas, "prior").items():
            if name in self.combinations or name in self._columns:
                spread[name] = sigma
            else:
                spread |= {self.names[j]: sigma for j in self.columns_of(name)}
        priors = dict(self.priors)
        for name, sigma in spread.items():
            unit = self.units[self._columns[name]] if name in self._columns else ""
            _, value = as_mean_and_sigma(sigma, f"prior of {name}", unit)
            if value == np.inf:
                continue
            if value == 0:
                raise InputError(f"prior of {name} = 0: what is known exactly is for fix")
            if name in priors:
                value = 1 / np.hypot(1 / value, 1 / priors[name])
            priors[name] = float(value)
        return self._replaced(priors=MappingProxyType(priors))

    def fix(self, *names: str) -> SparseProblem:
        """Return the problem with these states, or all states of these blocks, known exactly."""
        return self._kept(self._gone(names))

    def constrain(self, rows: ArrayLike) -> SparseProblem:
        """Refuse: a sparse problem knows states and blocks exactly, not combinations.

        Raises
        ------
        InputError
            Always: name the combination in `combinations` and give it a prior.
        """
        raise InputError(
            "a sparse problem takes no exact combination of states: name it in combinations= "
            "and give it a prior with a small deviation, or fix the states"
        )

    def factor(self, *, prior: bool = True, rtol: float | None = None) -> _core.Analysis:
        """Refuse: a sparse problem is factored sparsely, by `gramian.analyze`.

        Raises
        ------
        InputError
            Always.
        """
        raise InputError(
            "a sparse problem has no dense factor: `gramian.analyze` answers for it, or make a "
            "problem of rows.toarray() where it is small"
        )

    def marginalize(self, names: Iterable[str]) -> SparseProblem:
        """Return the problem of the other states, with these not known at all.

        Parameters
        ----------
        names : iterable of str
            Nuisance states, or blocks of them. Their priors and those of combinations
            with them are used on the way.

        Notes
        -----
        The rows that are left are those of the triangular factor with the nuisance states
        first: the Schur complement, without forming it. What is left below about 1e-9 of
        a column is taken for rounding (`rtol` of the result).
        """
        wanted = (names,) if isinstance(names, str) else names
        gone = self._gone(options.names(wanted, "names", "names of states or blocks"))
        used = [name for name in self.priors if self.direction(name)[gone].any()]
        rows = _stacked([self.rows, self._prior_rows(used)]) if used else self.rows
        from scipy.sparse import csr_array

        start, column, value = _core.sparse_marginal_rows(
            rows.indptr.astype(np.int64),
            rows.indices.astype(np.int64),
            rows.data,
            gone,
            available_bytes(),
        )
        left = csr_array((value, column, start), shape=(len(start) - 1, self.n))
        stay = {name: sigma for name, sigma in self.priors.items() if name not in used}
        rtol = max(_ELIMINATION, self.rtol or 0)
        return self._replaced(rows=left, priors=MappingProxyType(stay), rtol=rtol)._kept(
            gone, strict=True
        )

    def _gone(self, names: Sequence[str]) -> NDArray[np.bool_]:
        gone = np.zeros(self.n, dtype=bool)
        for name in names:
            gone[self.columns_of(name)] = True
        if gone.all():
            raise InputError("every state was named: at least one must be left")
        return gone

    def _kept(self, gone: NDArray[np.bool_], *, strict: bool = False) -> SparseProblem:
        keep = np.flatnonzero(~gone)
        names = tuple(self.names[j] for j in keep)
        combinations = {
            key: value[keep]
            for key, value in self.combinations.items()
            if value[keep].any() and not (strict and value[gone].any())
        }
        number: dict[int, int] = {}
        block_of = np.array([number.setdefault(b, len(number)) for b in self.block_of[keep]])
        left = set(names)
        return self._replaced(
            rows=self.rows[:, keep].tocsr(),
            constraints=np.zeros((0, len(keep))),
            prior_rows=np.zeros((0, len(keep))),
            names=names,
            units=tuple(self.units[j] for j in keep),
            scale=self.scale[keep],
            priors=MappingProxyType(
                {k: s for k, s in self.priors.items() if k in left or k in combinations}
            ),
            combinations=MappingProxyType(combinations),
            blocks=tuple(self.blocks[b] for b in number),
            block_of=block_of,
            gauges=MappingProxyType({key: value[keep] for key, value in self.gauges.items()}),
        )

    def __add__(self, other: Problem) -> SparseProblem:
        """Join independent measurements; states of the same name are the same."""
        if not isinstance(other, Problem):
            return NotImplemented
        second = other if isinstance(other, SparseProblem) else _as_sparse(other)
        return _joined(self, second)

    def __radd__(self, other: Problem) -> SparseProblem:
        """Join a dense problem with this one."""
        if not isinstance(other, Problem):
            return NotImplemented
        return _joined(_as_sparse(other), self)


def _as_sparse(problem: Problem) -> SparseProblem:
    from scipy.sparse import csr_array

    made = SparseProblem(
        csr_array(problem.rows),
        problem.names,
        units=problem.units,
        scale=problem.scale,
        rtol=problem.rtol,
        combinations=problem.combinations,
    )
    return made._replaced(priors=problem.priors)


def _joined(first: SparseProblem, second: SparseProblem) -> SparseProblem:
    from scipy.sparse import coo_array

    names = first.names + tuple(name for name in second.names if name not in first._columns)
    column = {name: j for j, name in enumerate(names)}
    n = len(names)
    units, scale = [""] * n, np.full(n, np.nan)
    blocks = [""] * n
    stacked = []
    gauges: dict[str, Array] = {}
    combinations: dict[str, Array] = {}
    for problem in (first, second):
        to = np.array([column[name] for name in problem.names])
        rows = problem.rows.tocoo()
        stacked.append(
            coo_array((rows.data, (rows.row, to[rows.col])), shape=(rows.shape[0], n)).tocsr()
        )
        for j, k in enumerate(to):
            if units[k] and problem.units[j] and units[k] != problem.units[j]:
                raise InputError(
                    f"state {names[k]} is in {units[k]} in one problem, {problem.units[j]} in other"
                )
            units[k] = units[k] or problem.units[j]
            blocks[k] = blocks[k] or problem.blocks[problem.block_of[j]]
        scale[to] = np.fmin(scale[to], problem.scale)
        for key, value in problem.gauges.items():
            # Each problem knows its own part of a common gauge.
            gauges.setdefault(key, np.zeros(n))[to] = value
        for key, value in problem.combinations.items():
            combinations.setdefault(key, np.zeros(n))[to] = value
    tolerances = [p.rtol for p in (first, second) if p.rtol is not None]
    joined = SparseProblem(
        _stacked(stacked),
        names,
        units=units,
        scale=scale,
        rtol=max(tolerances, default=None),
        combinations=combinations,
        blocks=blocks,
        gauges=gauges,
    )
    return joined.prior(first.priors).prior(second.priors)


def similarity_gauges(
    positions: Sequence[ArrayLike | None],
    states: Sequence[Sequence[str]],
    *,
    axes: Sequence[str] = ("x", "y", "z"),
    scale: bool = False,
) -> dict[str, Array]:
    """Return translations, rotations and scale as directions of the states.

    Parameters
    ----------
    positions : sequence of array_like, shape (d,), or None
        Where each block is, d = 2 or 3, in the axes its states are in; None for a block
        that a move of the whole does not change.
    states : sequence of sequences of str
        The states of each block, in the order of the columns: the axes for its position;
        "r" and an axis ("rz"; "theta" in the plane) for its attitude, as small rotations
        about the axes of the world. Others do not move.
    axes : sequence of str
        Their names; the first d are used.
    scale : bool
        Whether the measurements leave the scale open: bearings without a distance.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        For the parameter `gauges` of a problem.

    Examples
    --------
    >>> gauges = similarity_gauges([[1.0, 2.0]], [["x", "y", "theta"]])
    >>> gauges["rotation about z"]
    array([-2.,  1.,  1.])
    """
    axes = options.names(axes, "axes")
    scale = options.flag(scale, "scale")
    places, blocks = options.sequence(positions, "positions"), options.sequence(states, "states")
    if len(places) != len(blocks):
        raise InputError(
            f"positions has {len(places)} entries and states {len(blocks)}: must be one for "
            "each block"
        )
    where = [None if p is None else finite(p, f"positions[{i}]") for i, p in enumerate(places)]
    wanted = [options.names(own, f"states[{i}]") for i, own in enumerate(blocks)]
    d = next((p.size for p in where if p is not None), 2)
    for i, p in enumerate(where):
        if p is not None and (p.shape != (d,) or d not in (2, 3)):
            raise InputError(
                f"positions[{i}] has shape {p.shape}: must be (2,) for all, or (3,) for all"
            )
    if len(axes) < d:
        raise InputError(f"axes has {len(axes)} entries: must have {d}")
    used = list(axes[:d])
    turning = {"theta": 2} | {f"r{axis}": i for i, axis in enumerate(axes)}
    directions: dict[str, list[float]] = {f"translation along {axis}": [] for axis in used}
    about = list(range(3)) if d == 3 else [2]
    directions |= {f"rotation about {axes[i] if i < len(axes) else 'z'}": [] for i in about}
    directions |= {"scale": []} if scale else {}
    for place, own in zip(where, wanted, strict=True):
        p = np.zeros(3)
        if place is not None:
            p[:d] = place
        for state in own:
            i = used.index(state) if state in used and place is not None else -1
            moved = [float(i == k) for k in range(d)]
            for k in about:
                axis = np.eye(3)[k]
                turn = float(np.cross(axis, p)[i]) if i >= 0 else float(turning.get(state) == k)
                moved.append(turn)
            if scale:
                moved.append(float(p[i]) if i >= 0 else 0.0)
            for values, value in zip(directions.values(), moved, strict=True):
                values.append(value)
    return {name: np.array(values) for name, values in directions.items()}


def compressed(rows: Any, count: int | None, shape: tuple[int, int] | None) -> Any:
    """Return rows as a scipy.sparse.csr_array in canonical form, float64."""
    from scipy.sparse import coo_array, csr_array, issparse

    if not issparse(rows):
        rows = _from_triplets(rows, count, shape, coo_array)
    if rows.dtype.kind not in "fiub":
        raise InputError(f"rows is of type {rows.dtype}: must be real numbers")
    if rows.ndim != 2:
        raise InputError(f"rows has shape {rows.shape}: must be (measurements, states)")
    if count is not None and rows.shape[1] != count:
        raise InputError(
            f"rows has shape {rows.shape}: must be (measurements, {count}), "
            "one column for each of the names"
        )
    _require_valid(rows)
    if rows.format == "csr":
        # The caller's arrays are used where they are, and never changed.
        array = csr_array((rows.data, rows.indices, rows.indptr), shape=rows.shape)
        if not array.has_canonical_format:
            array = array.copy()
    else:
        try:
            array = csr_array(rows)
        except ValueError as error:
            raise InputError(f"rows cannot be read as a sparse matrix: {error}") from error
    array.sum_duplicates()
    if array.dtype != np.float64:
        array = array.astype(np.float64)
    return array


def _require_valid(rows: Any) -> None:
    """Raise where the numbers of rows and columns are broken: SciPy writes where they point."""
    if rows.format in ("csr", "csc", "bsr"):
        try:
            rows.check_format(full_check=True)
        except ValueError as error:
            what = "compressed rows" if rows.format == "csr" else rows.format.upper()
            raise InputError(f"rows is no valid matrix in {what}: {error}") from error
    elif rows.format == "coo":
        for label, place, limit in zip(("row", "column"), rows.coords, rows.shape, strict=True):
            wrong = (place < 0) | (place >= limit)
            if len(place) != len(rows.data) or wrong.any():
                raise InputError(
                    f"rows is no valid matrix in COO: {label} numbers must be from 0 to "
                    f"{limit - 1}, one for each value"
                )


def _from_triplets(
    rows: Any, count: int | None, shape: tuple[int, int] | None, coo_array: Any
) -> Any:
    try:
        values, (i, j) = rows
        indices = [np.asarray(i), np.asarray(j)]
    except (TypeError, ValueError) as error:
        raise InputError(
            f"rows = {options.given(rows)}: must be a matrix of scipy.sparse, or "
            "(values, (rows, columns))"
        ) from error
    values = as_float_array(values, "values of the triplets").ravel()
    places = []
    for label, index in zip(("row", "column"), indices, strict=True):
        kind = index.dtype.kind if index.size else "i"
        if kind not in "iu" or index.ndim != 1 or len(index) != len(values):
            raise InputError(
                f"{label} numbers of the triplets are {index.dtype} of shape {index.shape}: must "
                f"be whole numbers below 2^63, ({len(values)},), one for each value"
            )
        wrong = (index < 0) | (index > np.iinfo(np.int64).max)
        if wrong.any():
            k = int(np.argmax(wrong))
            raise InputError(f"{label}[{k}] = {index[k]}: must be from 0 to 2^63 - 1")
        places.append(index.astype(np.int64))
    most = [int(p.max(initial=-1)) + 1 for p in places]
    by_data = (most[0], most[1] if count is None else count)
    shape = by_data if shape is None else _shape(shape)
    for label, place, limit in zip(("row", "column"), places, shape, strict=True):
        if place.max(initial=-1) >= limit:
            k = int(np.argmax(place >= limit))
            raise InputError(f"{label}[{k}] = {place[k]}: must be below {limit}")
    _require_memory(
        8 * shape[0], f"the starts of {shape[0]} rows alone", "number the rows without gaps"
    )
    return coo_array((values, tuple(places)), shape=shape)


def _shape(given: Any) -> tuple[int, int]:
    try:
        rows, columns = given
    except (TypeError, ValueError) as error:
        raise InputError(
            f"shape = {options.given(given)}: must be (measurements, states)"
        ) from error
    return whole(rows, "shape[0]"), whole(columns, "shape[1]")


def require_finite_rows(array: Any, names: Sequence[str]) -> None:
    """Raise where an entry of a sparse matrix is not finite."""
    wrong = ~np.isfinite(array.data)
    if wrong.any():
        k = int(np.argmax(wrong))
        row = int(np.searchsorted(array.indptr, k, side="right")) - 1
        column = int(array.indices[k])
        raise InputError(
            f"rows[{row}, {column}] = {array.data[k]} (state {names[column]}): must be finite"
        )


def _names(names: Sequence[str] | Callable[[int], str] | None, n: int) -> tuple[str, ...]:
    if names is None:
        return tuple(f"x{j}" for j in range(n))
    listed = tuple(names(j) for j in range(n)) if callable(names) else tuple(names)
    wrong = next((name for name in listed if not isinstance(name, str) or not name), None)
    if wrong is not None:
        raise InputError(f"names has {wrong!r}: must be text, not empty")
    if len(set(listed)) < n:
        seen: set[str] = set()
        twice = next(name for name in listed if name in seen or seen.add(name))  # type: ignore[func-returns-value]
        raise InputError(f"names has {twice!r} twice")
    return listed


def _vectors(given: Mapping[str, ArrayLike] | None, label: str, n: int) -> Mapping[str, Array]:
    made = {}
    for key, value in options.mapping(given, label, "name to coefficients").items():
        vector = finite(value, f"{label}[{key!r}]")
        if vector.shape != (n,):
            raise InputError(f"{label}[{key!r}] has shape {vector.shape}: must be ({n},)")
        made[key] = vector
    return MappingProxyType(made)


def _before_dot(name: str) -> str:
    return name.rpartition(".")[0] or name


def _some(names: Sequence[str], what: str = "the states are ") -> str:
    if len(names) <= 8:
        return what + ", ".join(names)
    return f"{what}{', '.join(names[:4])}, ... {names[-1]} ({len(names)})"


def _stacked(parts: Sequence[Any]) -> Any:
    from scipy.sparse import vstack

    return vstack(parts, format="csr")


def _require_memory(wanted: int, what: str, advice: str = "number the states without gaps") -> None:
    """Raise where what is wanted is more than is free."""
    free = available_bytes()
    if wanted > free:
        raise MemoryError(
            f"{what} would take {wanted / 1e9:.3g} GB: {free / 1e9:.3g} GB are available; {advice}"
        )


def available_bytes() -> int:
    """Return how much memory may be taken: the least of what the limits leave, or much.

    Those of the system, of the control group (a container) and of the process.
    """
    free = [2**62]
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        free += [int(x.split()[1]) * 1024 for x in lines if x.startswith("MemAvailable:")]
    except OSError:
        pass
    for limit, used in _CONTROL_GROUPS:
        try:
            most = Path(limit).read_text().strip()
            taken = int(Path(used).read_text())
        except (OSError, ValueError):
            continue
        if most.isdigit():
            free.append(int(most) - taken)
    try:
        import resource
    except ImportError:  # Windows
        return max(min(free), 0)
    most_addresses, _ = resource.getrlimit(resource.RLIMIT_AS)
    if most_addresses != resource.RLIM_INFINITY:
        try:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            free.append(most_addresses - pages * resource.getpagesize())
        except OSError:
            free.append(most_addresses)
    return max(min(free), 0)
