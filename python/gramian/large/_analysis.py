"""What a sparse problem can and cannot determine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Columns
from gramian._arrays import finite, number, real, representable, whole
from gramian._registry import draw
from gramian._text import brief, plain
from gramian.analysis import Observability, Suggestion
from gramian.exceptions import InputError
from gramian.large._problem import (
    SparseProblem,
    available_bytes,
    compressed,
    require_finite_rows,
)
from gramian.large._words import NullCombination, null_combinations, some_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["SparseObservability", "SparseSuggestion", "analyze_sparse", "reduced"]

Array = NDArray[np.float64]

#: Entries beyond this, or below its inverse, have squares that float64 does not hold.
_RANGE = 1e145
Combination = str | Mapping[str, float] | ArrayLike


class SparseSuggestion(Suggestion):
    """One piece of knowledge about a sparse problem.

    Attributes
    ----------
    name : str
        The state or block that would be known.
    rank, nullity : int
        Of all states, with it known.
    repairs : bool
        Whether everything is observable then.
    crlb_std : ndarray, shape (n,)
        Bound of each state then, 0 for those known exactly; worked out when first asked
        for, by an analysis of its own.
    """

    def __init__(self, name: str, rank: int, nullity: int, problem: SparseProblem, rows: Any):
        self.__dict__.update(
            name=name, rank=rank, nullity=nullity, repairs=nullity == 0, _of=(problem, rows)
        )

    _more_fields = ("_of",)
    _not_stored = frozenset({"crlb_std"})

    @cached_property
    def crlb_std(self) -> Array:
        """Bound of each state with it known."""
        problem, rows = self.__dict__["_of"]
        if rows is not None:
            from scipy.sparse import vstack

            more = vstack([problem.rows, rows], format="csr")
            return analyze_sparse(problem.with_rows(more)).crlb_std
        known = np.zeros(problem.n, dtype=bool)
        known[problem.columns_of(self.name)] = True
        std = np.zeros(problem.n)
        std[~known] = analyze_sparse(problem.fix(self.name)).crlb_std
        return std


class SparseObservability(Observability):
    """The answer of `gramian.analyze` for sparse rows.

    Attributes
    ----------
    status, reason, decided_by, rank, nullity, names, units
        As for `gramian.Observability`.
    gap : float
        Smallest singular value that counts over the largest that does not (for full
        rank, over the tolerance), on unit columns: how clear the rank is.
    condition : float
        Largest over smallest singular value on unit columns, `inf` when the rank is short;
        the largest is an estimate from below, within about a per cent.
    singular_values : ndarray
        The smallest that were found, on unit columns, descending; those that do not count
        last.
    null_space : scipy.sparse.csc_array, shape (n, nullity)
        The unobservable combinations in units of the states, each with few states.
    null_combinations : tuple of str
        The same in words.
    missing : tuple of NullCombination
        The same with kind, gauge, blocks and component.
    crlb_std, data_std : ndarray, shape (n,)
        As for `gramian.Observability`; worked out when first asked for, by selected
        inversion, all in about the time of the analysis.
    logdet : float
    weakest_direction : ndarray, shape (n,)
        How far each state moves along the weakest observable direction at one standard
        deviation; `weakest` has more of them.
    suggestions : tuple of SparseSuggestion
        Blocks that would give most rank where some is missing.
    components : int
        How many parts the problem falls into that no measurement joins.
    component : ndarray, shape (n,)
        The part that each state is in.
    untouched : tuple of str
        States that no measurement touches.
    shortages : tuple of (tuple of str, ndarray)
        Groups of states that fewer rows touch than there are states, and those rows: no
        numbers in these places could determine them (Dulmage-Mendelsohn).
    converged : bool
        Whether the smallest singular value that counts is known to 1e-7; it is an upper
        limit otherwise.
    """

    missing: tuple[NullCombination, ...]

    _more_fields = (
        "component",
        "components",
        "untouched",
        "converged",
        "missing",
        "_vectors",
        "_rtol",
    )
    _not_stored = frozenset({"singular_values", "crlb_std", "data_std", "weakest_direction"})

    def __init__(
        self, problem: SparseProblem, analysis: _core.SparseAnalysis, rtol: float | None
    ) -> None:
        put = self.__dict__.__setitem__
        n, nullity = problem.n, analysis.nullity
        put("problem", problem)
        put("_sparse", analysis)
        put("_rtol", rtol)
        put("names", problem.names)
        put("units", problem.units)
        put("nullity", nullity)
        put("rank", n - nullity)
        smallest, dropped = analysis.smallest_counting, analysis.largest_dropped
        if nullity:
            gap = np.inf if dropped == 0 else smallest / dropped if nullity < n else 0.0
        else:
            gap = smallest / (analysis.norm * analysis.rtol)
        put("gap", float(gap))
        put("condition", np.inf if nullity else float(analysis.norm / smallest))
        put("logdet", analysis.log_det)
        put("component", analysis.component().astype(np.int64))
        put("components", int(self.component.max(initial=-1)) + 1)
        put("untouched", tuple(problem.names[j] for j in analysis.untouched()))
        put("converged", analysis.converged)
        start, index, value = analysis.null_vectors()
        from scipy.sparse import csc_array

        vectors = csc_array((value, index, start), shape=(n, nullity))
        put("_vectors", vectors)
        missing, basis = null_combinations(problem, vectors, analysis.scale(), self.component)
        put("missing", missing)
        put("null_space", basis)
        put("null_combinations", tuple(m.text for m in missing))

    null_space: Any
    component: NDArray[np.int64]
    components: int
    untouched: tuple[str, ...]
    converged: bool
    problem: SparseProblem
    _vectors: Any

    @cached_property
    def _sparse(self) -> _core.SparseAnalysis:
        return reduced(self.problem.all_rows, self._rtol)

    @property
    def undecided(self) -> tuple[str, ...]:
        """None: sparse rows carry no errors."""
        return ()

    @cached_property
    def shortages(self) -> tuple[tuple[tuple[str, ...], NDArray[np.int64]], ...]:
        """Groups of states that fewer rows touch than there are states, and those rows."""
        return tuple(
            (tuple(self.names[j] for j in columns), rows.astype(np.int64))
            for columns, rows in self._sparse.shortages()
        )

    @cached_property
    def crlb_std(self) -> Array:
        """Bound on every state, priors included."""
        return representable(self._sparse.crlb_std())

    @cached_property
    def data_std(self) -> Array:
        """Bound on every state from the measurements alone."""
        if not self.problem.priors:
            return self.crlb_std
        return reduced(self.problem.rows, self.problem.rtol).crlb_std()

    @cached_property
    def singular_values(self) -> Array:
        """The smallest singular values that were found, descending."""
        values, _ = self._sparse.weakest(len(self.names))
        return np.concatenate([values[::-1], np.full(self.nullity, self._sparse.largest_dropped)])

    def weakest(self, count: int = 1) -> tuple[Array, Any]:
        """Return the weakest observable directions.

        Parameters
        ----------
        count : int
            At most so many; about six are known of each component.

        Returns
        -------
        values : ndarray
            Singular values on unit columns, ascending.
        directions : scipy.sparse.csc_array, shape (n, values)
            How far each state moves along each at one standard deviation.
        """
        from scipy.sparse import csc_array, diags_array

        count = whole(count, "count", 1)
        values, (start, index, value) = self._sparse.weakest(count)
        vectors = csc_array((value, index, start), shape=(len(self.names), len(values)))
        scaled = diags_array(self._sparse.scale()) @ vectors @ diags_array(1 / values)
        return values, scaled.tocsc()

    @cached_property
    def weakest_direction(self) -> Array:
        """How far each state moves along the weakest observable direction."""
        _, directions = self.weakest(1)
        if directions.shape[1] == 0:
            return np.zeros(len(self.names))
        return np.asarray(directions.toarray()[:, 0])

    def std_of(self, combination: Combination) -> float:
        """Return the bound on the deviation of a state or linear combination.

        Parameters
        ----------
        combination : str, mapping of str to float, or array_like, shape (n,)
            A name, coefficients by name, or all coefficients, in units of the states.
        """
        return float(self.std_of_all([combination])[0])

    def std_of_all(self, combinations: Sequence[Combination]) -> Array:
        """Return the bounds on the deviations of many combinations, as `std_of`."""
        start, column, value = self._lines(combinations)
        return np.sqrt(self._sparse.variances(start, column, value))

    def differences(self, pairs: Sequence[tuple[str, str]]) -> Array:
        """Return the bound on the difference of each pair of states.

        Such bounds exist where those of the states do not: a common shift has no part
        in them.
        """
        differences = []
        for i, pair in enumerate(options.sequence(pairs, "pairs")):
            both = options.names(pair, f"pairs[{i}]", "two names")
            if len(both) != 2:
                raise InputError(f"pairs[{i}] has {len(both)} names: must have 2")
            index = self.problem.index
            same = index(both[0]) == index(both[1])
            differences.append({both[0]: 0.0} if same else {both[0]: 1.0, both[1]: -1.0})
        return self.std_of_all(differences)

    def covariance(self, names: Sequence[str] | None = None) -> Array:
        """Return the covariance at the bound of some states or blocks.

        Parameters
        ----------
        names : sequence of str, optional
            States, or blocks for all of theirs; all states by default.

        Returns
        -------
        ndarray, shape (m, m)
            `inf` on the diagonal and NaN beside it for states that are not observable.
        """
        wanted = self.names if names is None else options.names(names, "names")
        states = [self.names[j] for name in wanted for j in self.problem.columns_of(name)]
        start, column, value = self._lines(states)
        return self._sparse.covariance(start, column, value)

    def covariance_of(self, combinations: Sequence[Combination]) -> Array:
        """Return the covariance (m, m) at the bound of combinations, as `covariance`."""
        start, column, value = self._lines(combinations)
        return self._sparse.covariance(start, column, value)

    def rank_gain(self, rows: Any) -> int:
        """Return how much rank rows (m, n), dense or sparse, would add together."""
        from scipy.sparse import csr_array, issparse

        if not issparse(rows):
            dense = np.atleast_2d(finite(rows, "rows"))
            if dense.ndim != 2 or dense.shape[1] != len(self.names):
                raise InputError(f"rows has shape {dense.shape}: must be (m, {len(self.names)})")
            rows = csr_array(dense)
        array = compressed(rows, len(self.names), None)
        require_finite_rows(array, self.names)
        return self._sparse.rank_gain(
            array.indptr.astype(np.int64), array.indices.astype(np.int64), array.data * 1.0
        )

    def knowing(self, combination: Combination, sigma: float = 0.0) -> SparseSuggestion:
        """Return what would follow if a state, block or combination were known to `sigma`.

        Parameters
        ----------
        combination : str, mapping of str to float, or array_like, shape (n,)
            A state or block for ``sigma=0``; any combination for a measurement of it.
        sigma : float
            Its standard deviation; 0 for exactly (states and blocks only).
        """
        sigma = number(sigma, "sigma")
        if sigma < 0:
            raise InputError(f"sigma = {sigma}: must be >= 0 and finite")
        if sigma == 0 and not isinstance(combination, str):
            raise InputError("sigma = 0 is for a state or block: give a combination sigma > 0")
        name = combination if isinstance(combination, str) else "combination"
        parts: Sequence[Combination]
        if isinstance(combination, str) and combination not in self.problem.combinations:
            parts = [self.names[j] for j in self.problem.columns_of(combination)]
        else:
            parts = [combination]
        rows = self._rows(parts)
        gain = self.rank_gain(rows)
        return self._suggestion(name, gain, rows / sigma if sigma else None)

    def _suggestion(self, name: str, gain: int, row: Any) -> SparseSuggestion:
        left = self.nullity - gain
        return SparseSuggestion(name, self.rank + gain, left, self.problem, row)

    @cached_property
    def suggestions(self) -> tuple[Suggestion, ...]:
        """Blocks that would give most rank, best first; nothing where none is missing."""
        if not self.nullity:
            return ()
        lines = self._vectors.tocsr()
        size = np.sqrt(np.asarray(lines.multiply(lines).sum(axis=1))).ravel()
        block_of = self.problem.block_of
        level = np.zeros(len(self.problem.blocks))
        np.add.at(level, block_of, size**2)
        # Of each component those that the null vectors move most.
        order = np.argsort(-level, kind="stable")
        place = np.zeros(len(level), dtype=np.int64)
        place[block_of] = self.component
        left: dict[int, int] = {}
        ranked = []
        for b in order:
            if level[b] < 1e-12 or left.setdefault(int(place[b]), 0) >= 12:
                continue
            left[int(place[b])] += 1
            columns = self.problem.columns_of(self.problem.blocks[b])
            gain = int(np.linalg.matrix_rank(lines[columns].toarray(), tol=1e-6))
            ranked.append((-gain, int(b), self.problem.blocks[b], gain))
            if len(ranked) == 200:
                break
        ranked.sort()
        return tuple(self._suggestion(name, gain, None) for _, _, name, gain in ranked)

    def _rows(self, combinations: Sequence[Combination]) -> Any:
        from scipy.sparse import csr_array

        start, column, value = self._lines(combinations)
        return csr_array((value, column, start), shape=(len(combinations), len(self.names)))

    def _lines(
        self, combinations: Sequence[Combination]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
        start, column, value = [0], [], []
        for combination in options.sequence(combinations, "combinations"):
            if isinstance(combination, str) and combination not in self.problem.combinations:
                entries = {self.problem.index(combination): 1.0}
            elif isinstance(combination, Mapping):
                entries = {
                    self.problem.index(k): number(v, f"coefficient of {k}")
                    for k, v in combination.items()
                }
            else:
                vector = (
                    self.problem.combinations[combination]
                    if isinstance(combination, str)
                    else finite(combination, "combination")
                )
                if vector.shape != (len(self.names),):
                    raise InputError(
                        f"combination has shape {vector.shape}: must be ({len(self.names)},)"
                    )
                entries = {int(j): float(vector[j]) for j in np.flatnonzero(vector)}
            for j in sorted(entries):
                column.append(j)
                value.append(entries[j])
            start.append(len(column))
        return np.array(start), np.array(column, dtype=np.int64), np.array(value, dtype=float)

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as plain lists, numbers and strings, fit for JSON."""
        return {
            "status": self.status,
            "reason": self.reason,
            "decided_by": list(self.decided_by),
            "rank": self.rank,
            "nullity": self.nullity,
            "gap": plain(self.gap),
            "condition": plain(self.condition),
            "components": self.components,
            "untouched": list(self.untouched),
            "null_combinations": [
                {
                    "kind": m.kind,
                    "text": m.text,
                    "gauge": m.gauge,
                    "blocks": list(m.blocks),
                    "component": m.component,
                }
                for m in self.missing
            ],
            "names": list(self.names),
            "units": list(self.units),
            "crlb_std": plain(self.crlb_std),
            "priors": dict(self.problem.priors),
            "logdet": plain(self.logdet),
        }

    def summary(self) -> str:
        """Return the verdict, what is missing and the best suggestion as text."""
        headline = {"weak": "WEAKLY OBSERVABLE"}.get(self.status, self.status.upper())
        lines = [f"{headline}: {self.reason}"]
        lines += [f"  not observable: {text}" for text in self.grouped()]
        for states, rows in self.shortages[:5]:
            alone = "1 row alone touches" if len(rows) == 1 else f"{len(rows)} rows alone touch"
            lines.append(f"  {alone} {some_of(states, 'states')}")
        if self.status == "unobservable":
            lines.append(f"  gap {brief(self.gap, 2)}: how clear the rank is")
        if self.suggestions:
            lines.append(f"  what would help most: {self.describe(self.suggestions[0])}")
        return "\n".join(lines)

    def grouped(self) -> list[str]:
        """Return the null combinations in words, those of the same blocks in one line."""
        groups: dict[tuple[object, ...], list[NullCombination]] = {}
        for m in self.missing:
            alone = m.kind == "combination"
            groups.setdefault((m.kind, m.blocks, m.text if alone else ""), []).append(m)
        lines = []
        for same in groups.values():
            first = same[0]
            if len(same) == 1:
                lines.append(first.text)
            elif first.kind == "untouched":
                lines.append(f"{first.blocks[0]}: no measurement touches it ({len(same)} states)")
            else:
                what = ", ".join(m.gauge for m in same[:-1])
                text = same[-1].text
                # "all angle of ..." once: "all angle, voltage of ...".
                every = "all " if same[-1].kind == "shift" else ""
                lines.append(f"{every}{what}, {text.removeprefix(every)}")
        if len(lines) > 20:
            lines = [*lines[:20], f"and {len(lines) - 20} more"]
        return lines

    def describe(self, suggestion: Suggestion) -> str:
        """Return one suggestion in words."""
        if suggestion.nullity:
            left = f"{suggestion.nullity} combination{'s' if suggestion.nullity > 1 else ''}"
            return f"knowing {suggestion.name} leaves {left} unobservable"
        return f"knowing {suggestion.name} determines everything"

    def _as_table(self) -> Columns:
        return Columns("state", self.names, {"crlb_std": self.crlb_std}, {}, self.units)

    def _html_table(self) -> str:
        # Bounds of very many states take their time; nobody reads them in a notebook.
        return super()._html_table() if len(self.names) <= 2000 else ""

    def plot(self) -> Figure:
        """Draw the smallest singular values and the null combinations; needs matplotlib."""
        return draw(self, "sparse_observability")


def analyze_sparse(
    problem: SparseProblem,
    *,
    weak_ratio: float = 1.0,
    weak_condition: float = 1e8,
    rtol: float | None = None,
) -> SparseObservability:
    """Say what sparse rows determine; `gramian.analyze` calls it for them.

    Parameters
    ----------
    problem : SparseProblem
    weak_ratio, weak_condition, rtol
        As for `gramian.analyze`.

    Raises
    ------
    MemoryError
        Where the factor does not fit in the memory that is free; the message says how
        much it takes. Nothing large has been tried then.

    Notes
    -----
    Sparse QR of the rows with unit columns over 1e-13 of their norm times the identity,
    which makes the factor well defined whatever the rank; block inverse iteration with it
    and Rayleigh-Ritz on the rows themselves for the null space and the values next to it;
    selected inversion for the bounds.

    Examples
    --------
    >>> import gramian as gm
    >>> answer = gm.analyze(gm.Problem(([1.0, -1.0], ([0, 0], [0, 1])), ["a", "b"]))
    >>> answer.rank, answer.null_combinations
    (1, ('a +1, b +1',))
    """
    options.instance(problem, SparseProblem, "problem", "a sparse problem")
    weak_ratio = real(weak_ratio, "weak_ratio")
    weak_condition = real(weak_condition, "weak_condition")
    for label, limit in (("weak_ratio", weak_ratio), ("weak_condition", weak_condition)):
        if not limit > 0:
            raise InputError(f"{label} = {limit}: must be > 0")
    tolerance = problem.rtol if rtol is None else options.fraction(rtol, "rtol")
    analysis = reduced(problem.all_rows, tolerance, problem.names)
    answer = SparseObservability(problem, analysis, tolerance)
    status, reason, decided_by = _status(problem, answer, weak_ratio, weak_condition)
    answer.__dict__.update(status=status, reason=reason, decided_by=decided_by)
    return answer


def reduced(
    rows: Any,
    rtol: float | None,
    names: Sequence[str] | None = None,
    unit: float | None = None,
) -> _core.SparseAnalysis:
    """Return the core's analysis; singular values on unit columns, or on columns over `unit`."""
    start, column = rows.indptr, rows.indices
    if start.dtype != column.dtype or start.dtype not in (np.int32, np.int64):
        start, column = start.astype(np.int64), column.astype(np.int64)
    try:
        return _core.SparseAnalysis(
            start, column, rows.data, rows.shape[1], rtol, available_bytes(), unit
        )
    except InputError as error:
        if names is not None:
            largest = np.zeros(rows.shape[1])
            np.maximum.at(largest, column, np.abs(rows.data))
            wrong = np.flatnonzero((largest > _RANGE) | ((largest > 0) & (largest < 1 / _RANGE)))
            if len(wrong):
                name, value = names[wrong[0]], largest[wrong[0]]
                raise InputError(
                    f"the rows have {value:.3g} at state {name}: its square leaves the range of "
                    "float64; choose other units"
                ) from error
        raise


def _status(
    problem: SparseProblem, answer: SparseObservability, weak_ratio: float, weak_condition: float
) -> tuple[str, str, tuple[str, ...]]:
    n = problem.n
    touched, prior = np.zeros(n, dtype=bool), np.full(n, np.inf)
    if answer.nullity:
        touched[answer.null_space.indices] = True
    for name, sigma in problem.priors.items():
        if name not in problem.combinations:
            prior[problem.index(name)] = sigma
    limited = not np.isnan(problem.scale).all() or np.isfinite(prior).any()
    hardness = answer.data_std
    if not answer.nullity and not limited:
        hardness = np.abs(answer.weakest_direction) / answer._sparse.scale()
    status, reason, decided = _core.judge(
        n - answer.nullity,
        touched,
        answer.data_std,
        problem.scale,
        prior,
        answer.condition,
        hardness,
        weak_ratio,
        weak_condition,
        problem.names,
        problem.units,
    )
    return status, reason, tuple(problem.names[j] for j in decided)
