"""Which measurements, sensors or places to add: so many that what is known after is best.

`select` chooses among candidates for any problem, dense or sparse, and its `Choice` says
within how much of the best possible it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import finite, number, whole
from gramian._noise import negligible
from gramian._text import brief, count
from gramian.exceptions import InputError
from gramian.problem import Problem, is_sparse

__all__ = ["Choice", "select"]

Array = NDArray[np.float64]

#: States that a choice is made on at most: the candidates' own, and those of the goal.
_STATES = 400
#: Rows are squared.
_LARGEST = 1e145


@dataclass(frozen=True, eq=False, repr=False)
class Choice(Answer):
    """What `select` chose.

    Attributes
    ----------
    chosen : tuple of str
        Names of the candidates: in the order in which greedy took them, or as exchange
        left them.
    method : {"greedy", "exchange"}
        Which of the two was better; greedy where they are equal.
    goal : str
    worth : float
        Half the log determinant of the information (nats) for "D"; for "A" and a state the
        root of the mean weighted variance; for "E" the longest axis. `inf`, or `-inf` for
        "D", where the rank is short.
    within : float
        The deviations could be smaller by at most this fraction with any other choice of so
        many (for "D": their geometric mean), by the convex relaxation; NaN where there is
        no such limit: for "E", and where even all candidates leave the rank short.
    guarantee : float
        What part of the best possible gain the greedy choice has in any case: 1 - 1/e for
        "D" where everything was observable before; NaN elsewhere, as there is none.
    gains : ndarray, shape (budget,)
        For "D" what each choice of greedy added to the worth (nats), for the others by how
        much each lowered it; `inf` while the rank was short.
    rank, nullity : int
        Of all states with the choice added; those that no candidate touches and that the
        goal does not ask for do not count for a sparse problem.
    weights : mapping of str to float
        Fractions of the candidates in the relaxation; empty where there is none.
    """

    chosen: tuple[str, ...]
    method: Literal["greedy", "exchange"]
    goal: str
    worth: float
    within: float
    guarantee: float
    gains: Array
    rank: int
    nullity: int
    weights: Mapping[str, float]

    def summary(self) -> str:
        """Return the choice in words."""
        text = f"{', '.join(self.chosen)} ({self.method})"
        if self.nullity:
            left = count(self.nullity, "combination is", "combinations are")
            return f"{text}: {left} still not observable"
        if np.isnan(self.within):
            return f"{text}: how far from the best is not known for goal {self.goal}"
        return f"{text}: within {brief(100 * self.within, 2)} % of the best possible"

    def _as_table(self) -> Columns:
        taken = [name in self.chosen for name in self.weights]
        if self.weights:
            values = {"weight": list(self.weights.values()), "chosen": taken}
            return Columns("candidate", list(self.weights), values, {})
        return Columns("candidate", self.chosen, {"chosen": [True] * len(self.chosen)}, {})


def select(
    candidates: Mapping[str, Any] | Sequence[Any],
    budget: int,
    goal: str | Mapping[str, float] = "D",
    *,
    problem: Problem | None = None,
    exchange: bool = True,
    relax: bool = True,
) -> Choice:
    """Choose the candidates that tell most.

    Parameters
    ----------
    candidates : mapping of str to rows, or sequence of rows
        What each would add: whitened rows (K_i, n), dense or sparse, or a `Problem` of the
        same states. One row may be given as (n,).
    budget : int
        How many to choose.
    goal : {"D", "A", "E"}, name of a state, or mapping of str to float
        "D": the volume of the error ellipsoid. "A": the mean variance of all states, each
        divided by its scale; a state: its bound; a mapping: several states, each variance
        times its weight. "E": the longest axis, each state divided by its scale.
    problem : Problem, optional
        What is measured and known already, dense or sparse, and the names of the states.
        A sparse one may have any number of states where all are observable (but for "E"):
        only what the candidates' rows see of each other is formed. Where some are not, it
        is first reduced to the states that candidates touch and the goal asks for, by
        elimination of the others; nothing is lost by that.
    exchange : bool
        Whether to swap chosen candidates for others until no swap helps.
    relax : bool
        Whether to work out within how much of the best the choice is.

    Returns
    -------
    Choice

    Raises
    ------
    InputError
        Candidates that do not fit each other or the problem, an unknown goal, a budget that
        exceeds the number of candidates.

    Notes
    -----
    Greedy first: while the rank is short, more rank comes first. Then exchange (Fedorov
    1972). The limit on what any choice can reach is that of the relaxation, in which
    candidates may be chosen by fractions (Joshi & Boyd 2009), with its duality gap added.
    "D" is submodular; "A" and "E" are not in general, so greedy has no guarantee for them.

    Examples
    --------
    >>> import numpy as np
    >>> angles = np.radians([0, 10, 20, 80, 100])
    >>> looks = {f"{np.degrees(a):.0f} deg": [[np.cos(a), np.sin(a)]] for a in angles}
    >>> choice = select(looks, 2)
    >>> choice.chosen, round(choice.within, 3)
    (('0 deg', '80 deg'), 0.008)
    """
    if isinstance(candidates, Mapping):
        named = {str(key): value for key, value in candidates.items()}
    else:
        listed = options.sequence(candidates, "candidates", "rows by name, or a sequence of rows")
        named = {f"candidate {k}": value for k, value in enumerate(listed)}
    exchange, relax = options.flag(exchange, "exchange"), options.flag(relax, "relax")
    if problem is not None:
        options.instance(problem, Problem, "problem", "a Problem")
    if not isinstance(goal, (str, Mapping)):
        raise InputError(
            f"goal = {options.given(goal)}: must be 'D', 'A', 'E', the name of a state, or "
            "weights by name"
        )
    if not named:
        raise InputError("candidates is empty: nothing can be chosen")
    budget = whole(budget, "budget", 1)
    if budget > len(named):
        raise InputError(f"budget = {budget}: must be from 1 to {len(named)}, the candidates")
    if problem is not None and is_sparse(problem.rows) and goal != "E":
        choice = _sparse(named, budget, goal, problem, exchange, relax)
        if choice is not None:
            return choice
    names, base, groups, scale = _dense(named, problem, goal)
    n = len(names)
    letter, weights = _goal(goal, names, scale)
    ends = np.cumsum([len(group) for group in groups]).tolist()
    order, worth, rank, swapped, best, relaxed = _core.choose(
        base if len(base) else np.zeros((1, n)),
        np.concatenate(groups),
        ends,
        budget,
        letter,
        weights,
        100 if exchange else 0,
        4000 if relax else 0,
    )
    better = best > worth[-1] + 1e-9 * abs(worth[-1]) if np.isfinite(best) else False
    keys = list(named)
    value = best if better else worth[-1]
    limit = relaxed[2] if relaxed is not None and relax else np.nan
    full_before = rank[0] == n and len(base) > 0 and _rank(base) == n
    return Choice(
        chosen=tuple(keys[i] for i in (swapped if better else order)),
        method="exchange" if better else "greedy",
        goal=goal if isinstance(goal, str) else "A",
        worth=_shown(value, letter),
        within=_within(value, limit, letter, n),
        guarantee=1 - float(np.exp(-1)) if letter == "D" and full_before else np.nan,
        gains=_gains(worth, letter, weights, base, full_before),
        rank=rank[-1],
        nullity=n - rank[-1],
        weights=dict(zip(keys, relaxed[0].tolist(), strict=True))
        if relaxed is not None and relax
        else {},
    )


def _sparse(
    named: Mapping[str, Any],
    budget: int,
    goal: str | Mapping[str, float],
    problem: Problem,
    exchange: bool,
    relax: bool,
) -> Choice | None:
    """Choose for a sparse problem all of whose states are observable; None for others."""
    from scipy.sparse import csr_array, vstack

    from gramian.large._analysis import reduced
    from gramian.large._problem import available_bytes

    analysis = reduced(problem.all_rows, problem.rtol)
    if analysis.nullity:
        return None
    groups = [csr_array(_rows(value, key, problem)) for key, value in named.items()]
    for key, group in zip(named, groups, strict=True):
        if group.shape[1] != problem.n:
            raise InputError(
                f"candidate {key!r} has shape {group.shape}: must be (K, {problem.n}), one column "
                "for each state"
            )
    rows = csr_array(vstack(groups, format="csr"))
    rows.sum_duplicates()
    letter, weights = _goal(goal, problem.names, problem.scale)
    asked = np.flatnonzero(weights) if letter == "A" else None
    if asked is None:
        worth = analysis.log_det / 2
    else:
        worth = -float(weights[asked] @ analysis.crlb_std()[asked] ** 2)
    c, g = analysis.gram(
        rows.indptr.astype(np.int64),
        rows.indices.astype(np.int64),
        rows.data * 1.0,
        None if asked is None else asked.tolist(),
        None if asked is None else weights[asked].tolist(),
        available_bytes(),
    )
    ends = np.cumsum([group.shape[0] for group in groups]).tolist()
    order, reached, swapped, best, relaxed = _core.choose_observable(
        c, g, ends, budget, worth, 100 if exchange else 0, 4000 if relax else 0
    )
    keys = list(named)
    better = best > reached[-1] + 1e-9 * abs(reached[-1])
    fractions, limit = (relaxed[0], relaxed[2]) if relaxed and relax else (np.zeros(0), np.nan)
    levels = np.array([worth, *reached])
    # The others' share of the volume is the same with any choice.
    touched = len(np.unique(rows.indices))
    value = best if better else reached[-1]
    return Choice(
        chosen=tuple(keys[i] for i in (swapped if better else order)),
        method="exchange" if better else "greedy",
        goal=goal if isinstance(goal, str) else "A",
        worth=_shown(value, letter),
        within=_within(value, limit, letter, max(touched, 1)),
        guarantee=1 - float(np.exp(-1)) if letter == "D" else np.nan,
        gains=np.diff(levels if letter == "D" else -np.sqrt(-levels)),
        rank=problem.n,
        nullity=0,
        weights=dict(zip(keys, fractions.tolist(), strict=True)) if len(fractions) else {},
    )


def _rank(rows: Array) -> int:
    return _core.Analysis(rows, None).rank


def _shown(worth: float, letter: str) -> float:
    return worth if letter == "D" else float(np.sqrt(-worth))


def _within(value: float, limit: float, letter: str, n: int) -> float:
    if not np.isfinite(limit) or not np.isfinite(value):
        return np.nan
    if letter == "D":
        return max(0.0, float(-np.expm1((value - limit) / n)))
    # Variances cannot be negative, whatever the duality gap.
    return max(0.0, float(1 - np.sqrt(max(-limit, 0.0) / -value)))


def _gains(worth: Sequence[float], letter: str, weights: Array, base: Array, full: bool) -> Array:
    start = -np.inf
    if full and letter == "D":
        start = float(np.linalg.slogdet(base.T @ base)[1] / 2)
    elif full and letter == "E":
        start = -1 / float(np.linalg.svd(base * weights, compute_uv=False)[-1]) ** 2
    elif full:
        start = -float(weights @ _core.Analysis(base, None).crlb_std() ** 2)
    levels = np.array([start, *worth])
    with np.errstate(invalid="ignore"):
        gains: Array = np.diff(levels if letter == "D" else -np.sqrt(-levels))
    return np.where(np.isnan(gains), np.inf, gains)


def _goal(goal: str | Mapping[str, float], names: Sequence[str], scale: Array) -> tuple[str, Array]:
    n = len(names)
    unit = np.where(np.isnan(scale), 1.0, scale)
    if isinstance(goal, Mapping):
        if not goal:
            raise InputError("goal is empty: must name at least one state")
        weights = np.zeros(n)
        for name, given in goal.items():
            if name not in names:
                raise InputError(f"goal names {options.given(name)}: no state has that name")
            weight = number(given, f"goal[{name!r}]")
            if not weight > 0:
                raise InputError(f"goal[{name!r}] = {weight}: must be > 0 and finite")
            weights[list(names).index(name)] = weight
        return "A", weights
    if goal == "D":
        return "D", unit
    if goal == "A":
        return "A", 1 / (n * unit**2)
    if goal == "E":
        return "E", unit
    if goal in names:
        return "A", np.array([float(name == goal) for name in names])
    raise InputError(f"goal = {goal!r}: must be 'D', 'A', 'E', or the name of a state")


def _dense(
    named: Mapping[str, Any], problem: Problem | None, goal: str | Mapping[str, float]
) -> tuple[Sequence[str], Array, list[Array], Array]:
    """States, rows there are, rows of each candidate and scales, all dense."""
    arrays = {key: _rows(value, key, problem) for key, value in named.items()}
    n = problem.n if problem is not None else next(iter(arrays.values())).shape[1]
    for key, array in arrays.items():
        if array.shape[1] != n:
            raise InputError(
                f"candidate {key!r} has shape {array.shape}: must be (K, {n}), one column for "
                "each state"
            )
    if problem is None or not is_sparse(problem.rows):
        names = problem.names if problem is not None else [f"x{j}" for j in range(n)]
        base = np.zeros((0, n)) if problem is None else problem.all_rows
        if problem is not None and len(exact := problem.constraints):
            # The choice squares its rows: as exact as leaves that its digits.
            dense = [a.toarray() if is_sparse(a) else a for a in arrays.values()]
            sigma = 30 * negligible(np.vstack([base, *dense]), exact)
            base = np.vstack([base, exact / sigma[:, None]])
        scale = problem.scale if problem is not None else np.full(n, np.nan)
        groups = [a.toarray() if is_sparse(a) else a for a in arrays.values()]
        return names, base, groups, scale
    touched = np.zeros(n, dtype=bool)
    for array in arrays.values():
        touched[array.tocsr().indices if is_sparse(array) else array.any(axis=0)] = True
    asked = list(goal) if isinstance(goal, Mapping) else [goal]
    touched[[problem.index(name) for name in asked if name in problem.names]] = True
    if goal in ("A", "E"):
        touched[:] = True
    if touched.sum() > _STATES:
        raise InputError(
            f"the candidates and the goal touch {touched.sum()} states: a choice is made on at "
            f"most {_STATES} where some are not observable: fix the gauge first, or give fewer "
            "candidates; goal 'E' is for problems of that size only"
        )
    keep = np.flatnonzero(touched)
    others = [problem.names[j] for j in np.flatnonzero(~touched)]
    smaller = problem.marginalize(others) if others else problem
    rows: Any = smaller.all_rows
    return (
        smaller.names,
        _without_rounding(rows.toarray(), smaller.rtol if others else None),
        [a.tocsc()[:, keep].toarray() if is_sparse(a) else a[:, keep] for a in arrays.values()],
        smaller.scale,
    )


def _without_rounding(rows: Array, rtol: float | None) -> Array:
    """Return rows that are zero along what they do not determine, on unit columns."""
    if rtol is None:
        return rows
    norms = np.linalg.norm(rows, axis=0)
    norms[norms == 0] = 1.0
    # An elimination leaves its rounding there: a choice would take it for knowledge.
    left, values, right = np.linalg.svd(rows / norms, full_matrices=False)
    values[values <= rtol * values[0]] = 0.0
    kept: Array = (left * values) @ right * norms
    return kept


def _rows(value: Any, key: str, problem: Problem | None) -> Any:
    if isinstance(value, Problem):
        if problem is not None and value.names != problem.names:
            raise InputError(f"candidate {key!r} has other states than the problem")
        return value.all_rows
    if is_sparse(value):
        if value.dtype.kind not in "fiub" or value.ndim != 2:
            raise InputError(
                f"candidate {key!r} is {value.dtype} of shape {value.shape}: must be real, (K, n)"
            )
        return _within_range(value, value.data, key)
    array = np.atleast_2d(finite(value, f"candidate {key!r}"))
    if array.ndim != 2 or 0 in array.shape:
        raise InputError(f"candidate {key!r} has shape {array.shape}: must be (K, n), not empty")
    return _within_range(array, array, key)


def _within_range(rows: Any, values: Any, key: str) -> Any:
    largest = float(np.abs(values).max(initial=0.0))
    if not largest < _LARGEST:
        raise InputError(
            f"candidate {key!r} has an entry of size {largest:g}: must be finite, with a square "
            "that float64 holds"
        )
    return rows
