"""What a problem can and cannot determine: `analyze` and its answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import number, real, whole
from gramian._registry import draw, load
from gramian._text import brief, describe_null_space
from gramian._text import number as readable
from gramian.exceptions import InputError
from gramian.problem import Problem, ProblemSource, as_problem, at_least_one_row, is_sparse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Candidate", "Critical", "Observability", "Suggestion", "analyze"]

Array = NDArray[np.float64]
Status = Literal["observable", "weak", "undecided", "unobservable"]


@dataclass(frozen=True, eq=False, repr=False)
class Suggestion(Answer):
    """One piece of knowledge and what would follow from it.

    Attributes
    ----------
    name : str
        The state or combination that would be known exactly.
    rank, nullity : int
        Of all states, with it known.
    repairs : bool
        Whether everything is observable then.
    crlb_std : ndarray, shape (n,)
        Bound of each state then; 0 for the known one.
    """

    name: str
    rank: int
    nullity: int
    repairs: bool
    crlb_std: Array


@dataclass(frozen=True, eq=False, repr=False)
class Critical(Answer):
    """A measurement, or a group of them, and what its loss would cost.

    Attributes
    ----------
    name : str
    rows : tuple of int
        Which rows.
    nullity : int
        How many combinations would no longer be observable.
    growth : float
        Largest factor by which a bound would grow; `inf` where one would be lost.
    worst : str
        The state whose bound that is.
    crlb_std : ndarray, shape (n,)
        Bounds without it.
    """

    name: str
    rows: tuple[int, ...]
    nullity: int
    growth: float
    worst: str
    crlb_std: Array


@dataclass(frozen=True, eq=False, repr=False)
class Candidate(Answer):
    """A measurement that could be added, or a group of them, and what it would give.

    Attributes
    ----------
    name : str
    rows : tuple of int
        Which of the rows that were offered.
    gained : int
        How many more combinations would be observable.
    crlb_std : ndarray, shape (n,)
        Bounds with it.
    """

    name: str
    rows: tuple[int, ...]
    gained: int
    crlb_std: Array


@dataclass(frozen=True, eq=False, repr=False)
class Observability(Answer):
    """The answer of `analyze`.

    Attributes
    ----------
    status : {"observable", "weak", "undecided", "unobservable"}
        "undecided" where the rows are too inaccurate to tell: `nullity` is the most it
        can be then.
    reason : str
        What decided the status, in words.
    decided_by : tuple of str
        The states that decided it; empty for "observable".
    rank, nullity : int
    names, units : tuple of str, length n
    singular_values : ndarray, shape (n,)
        Of the scaled rows, descending. Columns are scaled by `scale` where it is
        given, to unit length otherwise.
    gap : float
        Smallest singular value that counts over the largest that does not (for
        full rank, over the tolerance), on unit columns: how clear the rank is.
    condition : float
        Largest over smallest singular value on unit columns, `inf` when the rank is short.
    null_space : ndarray, shape (n, nullity)
        The unobservable combinations in physical units, each with a leading coefficient of 1.
    null_combinations : tuple of str
        The same, readable: "x0 +1, vx +0.42".
    crlb_std : ndarray, shape (n,)
        Bound on the standard deviation, priors included; `inf` where none exists, and where
        the state is `undecided`.
    data_std : ndarray, shape (n,)
        The same from the measurements alone.
    logdet : float
        Log determinant of the information, `-inf` when the rank is short.
    weakest_direction : ndarray, shape (n,)
        The longest axis of the error ellipsoid (on unit columns) among what is
        observable: how far each state moves along it at one standard deviation.
    undecided : tuple of str
        States that an unobservable combination may or may not move: the rows, with errors
        above 1e-8 of their size, are not accurate enough to tell.
    suggestions : tuple of Suggestion
        What knowing one state or named combination would give, best first; worked out when
        first asked for.
    """

    status: Status
    reason: str
    decided_by: tuple[str, ...]
    rank: int
    nullity: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    singular_values: Array
    gap: float
    condition: float
    null_space: Array
    null_combinations: tuple[str, ...]
    crlb_std: Array
    data_std: Array
    logdet: float
    weakest_direction: Array
    problem: Problem
    _rtol: float | None = None

    _not_in_dict = frozenset({"problem"})
    _more_in_dict = ("undecided", "priors", "islands", "suggestions")

    @cached_property
    def _analysis(self) -> _core.Analysis:
        return self.problem.factor(rtol=self._rtol)

    @property
    def undecided(self) -> tuple[str, ...]:
        """States of which the rows are not accurate enough to tell whether they are observable."""
        return tuple(self.names[i] for i in self._analysis.undecided())

    @property
    def priors(self) -> Mapping[str, float]:
        """Standard deviations of what was known beforehand, by name."""
        return self.problem.priors

    def covariance(self, names: Sequence[str] | None = None) -> Array:
        """Return the covariance at the bound, priors included.

        Parameters
        ----------
        names : sequence of str, optional
            States, all by default.

        Returns
        -------
        ndarray, shape (m, m)
            `inf` throughout where the rank is short.
        """
        found = self._analysis.crlb()
        wanted = self.names if names is None else options.names(names, "names", "names of states")
        part = [self.problem.index(name) for name in wanted]
        if found is None:
            return np.full((len(part), len(part)), np.inf)
        block: Array = found[np.ix_(part, part)]
        return block

    @cached_property
    def suggestions(self) -> tuple[Suggestion, ...]:
        """What knowing one state or named combination would give, best first."""
        return _suggestions(self.problem, self._analysis)

    def std_of(self, combination: str | ArrayLike) -> float:
        """Return the bound on the deviation of a state or linear combination.

        Parameters
        ----------
        combination : str or array_like, shape (n,)
            A name, or coefficients in physical units.
        """
        return self._analysis.combination_std(self._direction(combination))

    def knowing(self, combination: str | ArrayLike, sigma: float = 0.0) -> Suggestion:
        """Return what would follow if a combination were also known to `sigma`.

        Parameters
        ----------
        combination : str or array_like, shape (n,)
        sigma : float
            Its standard deviation; 0 for exactly.
        """
        sigma = number(sigma, "sigma")
        if not sigma >= 0:
            raise InputError(f"sigma = {sigma}: must be >= 0 and finite")
        name = combination if isinstance(combination, str) else "combination"
        rank, std = self._analysis.knowing(self._direction(combination), float(sigma))
        n = len(self.names)
        return Suggestion(name, rank, n - rank, rank == n, std)

    def critical(
        self, factor: float = 2.0, groups: Mapping[str, Sequence[int]] | None = None
    ) -> tuple[Critical, ...]:
        """Return the measurements whose loss matters, the worst first.

        Parameters
        ----------
        factor : float
            What counts: a bound that grows by more than this, besides what becomes
            unobservable.
        groups : mapping of str to sequence of int, optional
            Rows that are lost together, by name; each row by itself by default.

        Returns
        -------
        tuple of Critical

        Notes
        -----
        Of single rows by their leverage, from the factorisation that is there; of
        groups by the rows that are left.
        """
        factor = number(factor, "factor")
        if not factor >= 1:
            raise InputError(f"factor = {factor}: must be >= 1")
        problem, before = self.problem, self.crlb_std
        found = []

        def lost(name: str, rows: tuple[int, ...], std: Array, nullity: int) -> None:
            with np.errstate(invalid="ignore", divide="ignore"):
                growth = np.where(np.isfinite(before) & (before > 0), std / before, 1.0)
            if nullity or growth.max() > factor:
                worst = self.names[int(np.argmax(growth))]
                found.append(Critical(name, rows, nullity, float(growth.max()), worst, std))

        if groups is None:
            rows = problem.data_rows if problem.row_sigma is None else problem.rows
            lever = self._analysis.leverage(rows) if len(rows) else np.zeros(0)
            # A bound grows by 1 / sqrt(1 - leverage) at most; a leverage of 1 is one to rounding.
            most = max((1 + 1e-9) / factor / factor, 1e-9)
            for i in np.flatnonzero(1 - lever <= most).tolist():
                std = self._analysis.without(rows[i])
                if std is not None:
                    lost(f"row {i}", (i,), std, 0)
                else:
                    self._lose(f"row {i}", [i], lost)
        else:
            for name, members in _members(groups, len(problem.rows)).items():
                self._lose(name, members, lost)
        found.sort(key=lambda one: (-one.nullity, -one.growth))
        return tuple(found)

    def _lose(self, name: str, members: Sequence[int], lost: Callable[..., None]) -> None:
        problem = self.problem
        rows = _places(members, name, len(problem.rows))
        kept = np.ones(len(problem.rows), dtype=bool)
        kept[list(rows)] = False
        left = problem.keep_rows(kept).factor()
        lost(name, rows, left.crlb_std(), max(0, len(self.names) - left.rank - self.nullity))

    def candidates(
        self,
        rows_or_problem: Problem | ProblemSource | ArrayLike,
        groups: Mapping[str, Sequence[int]] | None = None,
    ) -> tuple[Candidate, ...]:
        """Rank measurements that could be added by what they would give.

        Parameters
        ----------
        rows_or_problem : array_like, shape (K, n), Problem or Model
            Whitened rows of what could be measured, of the same states.
        groups : mapping of str to sequence of int, optional
            Rows that come together, by name; each row by itself by default.

        Returns
        -------
        tuple of Candidate
            The best first: most combinations made observable, then the smallest bounds
            relative to the scales (or to what they are now).
        """
        other = as_problem(rows_or_problem, None)
        named = isinstance(rows_or_problem, (Problem, ProblemSource))
        if other.n != len(self.names) or (named and other.names != self.names):
            raise InputError(
                f"rows_or_problem has the states {', '.join(other.names)}: must have "
                f"{', '.join(self.names)}"
            )
        rows, n = other.data_rows, other.n
        reference = np.where(np.isfinite(self.crlb_std), self.crlb_std, _reference(self.problem))
        reference = np.where(np.isnan(self.problem.scale), reference, self.problem.scale)
        reference = np.where(reference > 0, reference, 1.0)
        ranked = []
        members = _members(groups, len(rows))
        for name, group in members.items():
            chosen = _places(group, name, len(rows))
            if len(chosen) == 1:
                rank, std = self._analysis.knowing(rows[chosen[0]], 1.0)
            else:
                base = np.vstack([self.problem.all_rows, rows[list(chosen)]])
                exact = self.problem.constraints
                joined = _core.Analysis(base, self._analysis.rtol, exact if len(exact) else None)
                rank, std = joined.rank, joined.crlb_std()
            known = np.isfinite(std) & (std > 0)
            level = float(np.log(std[known] / reference[known]).mean()) if known.any() else 0.0
            ranked.append(
                (
                    (n - rank, int(np.isinf(std).sum()), round(level, 9)),
                    Candidate(name, chosen, rank - self.rank, std),
                )
            )
        ranked.sort(key=lambda item: item[0])
        return tuple(candidate for _, candidate in ranked)

    @cached_property
    def islands(self) -> tuple[tuple[str, ...], ...]:
        """Groups of states that no measurement or prior ties to each other.

        One group where all are tied; states that nothing measures are groups of one.
        """
        rows = np.vstack([self.problem.all_rows, self.problem.constraints]) != 0
        owner = list(range(len(self.names)))

        def root(i: int) -> int:
            while owner[i] != i:
                owner[i] = owner[owner[i]]
                i = owner[i]
            return i

        for pattern in np.unique(rows, axis=0):
            first, *others = np.flatnonzero(pattern).tolist() or [0]
            for i in others:
                owner[root(i)] = root(first)
        groups: dict[int, list[str]] = {}
        for i, name in enumerate(self.names):
            groups.setdefault(root(i), []).append(name)
        return tuple(tuple(group) for group in groups.values())

    def _direction(self, combination: str | ArrayLike) -> ArrayLike:
        return self.problem.direction(combination) if isinstance(combination, str) else combination

    def _as_table(self) -> Columns:
        shown = {"crlb_std": self.crlb_std}
        if self.problem.has_prior:
            shown["data_std"] = self.data_std
        if not np.isnan(self.problem.scale).all():
            shown["scale"] = self.problem.scale
        return Columns(
            "state", self.names, shown, {}, self.units, {"covariance": self.covariance()}
        )

    def summary(self) -> str:
        """Return the verdict, the bounds and the best suggestions as text."""
        headline = {"weak": "WEAKLY OBSERVABLE"}.get(self.status, self.status.upper())
        lines = [f"{headline}: {self.reason}"]
        lines += [f"  not observable: {text}" for text in self.null_combinations]
        width = max(len(name) for name in self.names)
        undecided = set(self.undecided)
        for name, unit, std in zip(self.names, self.units, self.crlb_std, strict=True):
            bound = "not observable" if np.isinf(std) else f"{std:.6g} {unit}".rstrip()
            bound = "undecided" if name in undecided else bound
            lines.append(f"  {name:<{width}}  {bound}")
        lines += [f"  {text}" for text in self._remarks()]
        if self.status != "observable" and self.suggestions:
            lines.append(f"  what would help most: {self.describe(self.suggestions[0])}")
        return "\n".join(lines)

    def _remarks(self) -> list[str]:
        """Return what is worth a line beside the bounds: islands, critical measurements."""
        remarks = []
        islands = [group for group in self.islands if len(group) < len(self.names)]
        if islands:
            told = [
                "{" + ", ".join(group[:4]) + (", ..." if group[4:] else "") + "}"
                for group in islands
            ]
            more = f" and {len(told) - 4} more" if told[4:] else ""
            remarks.append(f"not tied to each other: {', '.join(told[:4])}{more}")
        if self.status in {"observable", "weak"} and len(self.problem.rows) > self.rank:
            vital = [one for one in self.critical(10.0) if one.nullity]
            if vital:
                names = ", ".join(one.name for one in vital[:6]) + (", ..." if vital[6:] else "")
                remarks.append(f"not observable without: {names}")
        undecided = self.undecided
        if undecided:
            names = ", ".join(undecided[:6]) + (", ..." if undecided[6:] else "")
            remarks.append(
                f"undecided: the rows are not accurate enough to tell whether what is not "
                f"observable moves {names}; give a Jacobian or a more accurate h"
            )
        accuracy = self.problem.accuracy
        if accuracy is not None and (self.status == "undecided" or undecided):
            remarks.append(accuracy.summary())
        return remarks

    def describe(self, suggestion: Suggestion) -> str:
        """Return one suggestion in words."""
        if suggestion.nullity:
            left = f"{suggestion.nullity} combination{'s' if suggestion.nullity > 1 else ''}"
            return f"knowing {suggestion.name} leaves {left} unobservable"
        known = [
            f"{name} to {readable(std, 3)} {unit}".rstrip()
            for name, unit, std in zip(self.names, self.units, suggestion.crlb_std, strict=True)
            if std > 0
        ]
        return f"knowing {suggestion.name} gives {', '.join(known)}"

    def plot(self) -> Figure:
        """Draw singular values and null combinations; needs matplotlib."""
        return draw(self, "observability")

    def corner(self, names: Sequence[str] | None = None, level: float = 0.95) -> Figure:
        """Draw the bound of chosen states, each and in pairs; needs matplotlib.

        Parameters
        ----------
        names : sequence of str, optional
            At most 8 states; by default the first ones.
        level : float
            The probability that the outer ellipses hold; the inner ones are of one
            deviation.
        """
        return draw(self, "corner", names, level)


def _members(groups: Mapping[str, Sequence[int]] | None, rows: int) -> Mapping[str, Sequence[int]]:
    """Return rows that come together by name: each by itself where none are given."""
    if groups is None:
        return {f"row {i}": (i,) for i in range(rows)}
    return options.mapping(groups, "groups", "name to numbers of rows")


def _places(group: Sequence[int], name: str, rows: int) -> tuple[int, ...]:
    label = f"groups[{name!r}]"
    members = options.sequence(group, label, "numbers of rows")
    return tuple(whole(i, label, 0, rows - 1) for i in members)


def analyze(
    problem_or_rows: Problem | ProblemSource | ArrayLike,
    names: Sequence[str] | None = None,
    scale: ArrayLike | Mapping[str, float] | None = None,
    prior: Mapping[str, Any] | ArrayLike | None = None,
    *,
    weak_ratio: float = 1.0,
    weak_condition: float = 1e8,
    rtol: float | None = None,
) -> Observability:
    """Say what the rows determine, how well, and what knowledge would help.

    Parameters
    ----------
    problem_or_rows : Problem, Model or array_like, shape (K, n)
        Whitened rows, (d h / d x) / sigma. Sparse ones are answered by a
        `gramian.large.SparseObservability`, with the same attributes.
    names : sequence of str, length n, optional
        The states, for plain rows; x0, x1, ... by default.
    scale : array_like, shape (n,), or mapping of str to float, optional
        For each state the deviation that would be useless. A bound above it
        makes the status "weak".
    prior : mapping of str to float or (mean, sigma), or array_like, optional
        Standard deviations of what is known beforehand, added to the problem's; all of
        them as an array (n,), or a covariance (n, n). 0 is exact knowledge, `inf` none.
    weak_ratio : float
        "weak" where a bound exceeds this many times the scale or prior.
    weak_condition : float
        "weak" where, with no scale or prior given, the condition number of the
        rows with unit columns exceeds this.
    rtol : float, optional
        Relative rank tolerance on the singular values of the rows with unit
        columns; by default 32 eps sqrt(max(K, n)), or the problem's own.

    Returns
    -------
    Observability

    Raises
    ------
    InputError
        A wrong shape, an empty array, a number that is not finite, an unknown name.

    Notes
    -----
    Rank deficiency is an answer, not an error. The rank is decided from the
    singular values of the rows with unit columns, by orthogonal factorisation,
    so it does not depend on units. A prior makes a problem full rank; the status
    then compares the bound *from the measurements alone* with the prior, so that
    what only the prior determines is called "weak".

    Examples
    --------
    >>> import gramian as gm
    >>> answer = gm.analyze([[1.0, 2.0], [2.0, 4.0]], names=["x", "v"])
    >>> answer.status, answer.rank, answer.null_combinations
    ('unobservable', 1, ('x +1, v -0.5',))
    >>> answer.crlb_std
    array([inf, inf])
    >>> answer.suggestions[0].name, answer.suggestions[0].repairs
    ('x', True)
    """
    problem = as_problem(problem_or_rows, names)
    if scale is not None:
        problem = problem.with_scale(scale)
    if prior is not None:
        problem = problem.prior(prior)
    weak_ratio = real(weak_ratio, "weak_ratio")
    weak_condition = real(weak_condition, "weak_condition")
    for label, threshold in (("weak_ratio", weak_ratio), ("weak_condition", weak_condition)):
        if not threshold > 0:
            raise InputError(f"{label} = {threshold}: must be > 0")
    if rtol is not None:
        rtol = options.fraction(rtol, "rtol")
    if is_sparse(problem.rows):
        sparse: Observability = load("large").analyze_sparse(
            problem, weak_ratio=weak_ratio, weak_condition=weak_condition, rtol=rtol
        )
        return sparse
    analysis = problem.factor(rtol=rtol)
    data_std = analysis.crlb_std()
    if problem.has_prior:
        data_std = problem.factor(prior=False, rtol=rtol).crlb_std()
    crlb_std = analysis.crlb_std()
    unit_values = analysis.singular_values()
    n, rank = problem.n, analysis.rank
    if rank < n:
        dropped = unit_values[rank]
        gap = np.inf if dropped == 0 else float(unit_values[rank - 1] / dropped) if rank else 0.0
        condition = np.inf
    else:
        known = unit_values[np.isfinite(unit_values)]
        condition = float(known[0] / known[-1]) if known.size else 1.0
        gap = 1 / (condition * analysis.rtol)
    null_space = analysis.null_space()
    null_combinations = describe_null_space(null_space, problem.names)
    scale_given = ~np.isnan(problem.scale)
    values = unit_values
    if scale_given.all() and not len(problem.constraints):
        values = _core.singular_values(at_least_one_row(problem.all_rows) * problem.scale)
    status, reason, decided_by = _status(
        problem, null_space, data_std, condition, weak_ratio, weak_condition
    )
    if status == "unobservable" and rtol is None:
        undecided = _undecided(
            problem, analysis, null_space, unit_values, weak_ratio, weak_condition
        )
        if undecided:
            status, reason = "undecided", undecided
    answer = Observability(
        status=status,
        reason=reason,
        decided_by=decided_by,
        rank=rank,
        nullity=n - rank,
        names=problem.names,
        units=problem.units,
        singular_values=values,
        gap=gap,
        condition=condition,
        null_space=null_space,
        null_combinations=null_combinations,
        crlb_std=crlb_std,
        data_std=data_std,
        logdet=analysis.log_det,
        weakest_direction=analysis.weakest_direction(),
        problem=problem,
        _rtol=rtol,
    )
    # The factorisation that is there already.
    vars(answer)["_analysis"] = analysis
    return answer


def _status(
    problem: Problem,
    null_space: Array,
    data_std: Array,
    condition: float,
    weak_ratio: float,
    weak_condition: float,
) -> tuple[Status, str, tuple[str, ...]]:
    n, nullity = null_space.shape
    prior = np.full(n, np.inf)
    for name, sigma in problem.priors.items():
        if name in problem.names:
            prior[problem.index(name)] = sigma
    status, reason, decided = _core.judge(
        n - nullity,
        np.asarray(null_space.any(axis=1)),
        data_std,
        problem.scale,
        prior,
        condition,
        data_std / _reference(problem),
        weak_ratio,
        weak_condition,
        problem.names,
        problem.units,
    )
    return cast("Status", status), reason, tuple(problem.names[i] for i in decided)


def _undecided(
    problem: Problem,
    analysis: _core.Analysis,
    null_space: Array,
    values: Array,
    weak_ratio: float,
    weak_condition: float,
) -> str | None:
    """Return why the rows are too inaccurate to tell, or None where they are not.

    A direction that counts as open is one of two: nothing is known of it, or less than
    the error of the rows. Where that little would be weak anyway, it makes no difference.
    """
    doubt = problem.doubt()
    advice = "give a Jacobian, a more accurate h, or scale"
    if doubt.vague:
        names = ", ".join(problem.names[i] for i in doubt.vague)
        return (
            f"the derivatives by {names} are smaller than their errors: {advice}, "
            "from which the step is found"
        )
    if doubt.rtol is None or problem.row_error is None or problem.rtol is not None:
        return None
    rank = analysis.rank
    tolerance = analysis.rtol * values[0]
    left = values[rank:]
    # Open for certain: columns of nothing.
    if len(doubt.nothing) + int((problem.rows == 0).all(axis=0).sum()) >= len(left):
        return None
    norms = np.linalg.norm(problem.all_rows, axis=0)
    norms = np.where(norms > 0, norms, 1.0)
    for direction in null_space.T:
        # The largest bound that errors of this size could hide.
        unit = direction * norms
        least = np.abs(direction) / np.linalg.norm(unit) / tolerance
        touched = direction != 0
        limits = problem.scale
        for name, sigma in problem.priors.items():
            if name in problem.names:
                i = problem.index(name)
                limits = limits.copy()
                limits[i] = np.fmin(limits[i], sigma)
        with np.errstate(invalid="ignore"):
            weak = (least > weak_ratio * limits)[touched & ~np.isnan(limits)].any()
        if np.isnan(limits[touched]).all():
            weak = 1 / analysis.rtol > weak_condition
        if not weak:
            return (
                f"sigma_{rank + 1} = {brief(values[rank], 2)} on unit columns, accuracy of "
                "the rows "
                f"{brief(analysis.rtol, 2)}: {advice}"
            )
    return None


def _reference(problem: Problem) -> Array:
    """Return what to compare each state's bound with.

    That is its scale, or what it alone would be known to.
    """
    return _core.references(at_least_one_row(problem.all_rows), problem.scale)


def _suggestions(problem: Problem, analysis: _core.Analysis) -> tuple[Suggestion, ...]:
    n = problem.n
    if n == 1:
        return ()
    reference = _reference(problem)
    ranked = []
    for name in (*problem.names, *problem.combinations):
        rank, std = analysis.knowing(problem.direction(name), 0.0)
        open_states = std > 0
        finite = open_states & np.isfinite(std)
        # Over the states that are left: how far above the reference, on average.
        level = np.log(std[finite] / reference[finite]).mean() if finite.any() else 0.0
        level = round(float(level), 9)  # rounding must not decide between equals
        unknown = int(np.isinf(std).sum())
        ranked.append(
            ((n - rank, unknown, level), Suggestion(name, rank, n - rank, rank == n, std))
        )
    ranked.sort(key=lambda item: item[0])
    return tuple(suggestion for _, suggestion in ranked)
