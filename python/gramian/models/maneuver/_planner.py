"""The planner: headings over a horizon that make a target as well known as they can."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._answers import Answer, Columns
from gramian._arrays import SEED_MOST, whole, wrap_angles
from gramian._text import brief, plain
from gramian.exceptions import UnobservableError
from gramian.models.maneuver._laws import LAWS
from gramian.models.maneuver._search import (
    RESTORED,
    Found,
    Limits,
    free_guesses,
    leg_guesses,
    one_blas_thread,
    refined,
    whole_counts,
)
from gramian.models.maneuver._task import Criterion, Task, moved

__all__ = ["LawComparison", "Plan", "Start", "plan"]

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Start(Answer):
    """One first guess and what became of it.

    Attributes
    ----------
    name : str
        Its family.
    guess, value : float
        The criterion of the guess, and of the path it led to.
    converged : bool
        Whether the optimiser came to its end from there.
    """

    name: str
    guess: float
    value: float
    converged: bool


@dataclass(frozen=True, eq=False, repr=False)
class LawComparison(Answer):
    """A closed-form law on the same constraints as a plan.

    Attributes
    ----------
    law : str
    side : int
        The better side: +1 turns right of the line of sight, -1 left.
    value : float
        Its criterion.
    behind : float
        How many times better the plan is: the ratio of determinants, traces,
        eigenvalues or variances; `inf` where the law determines nothing.
    kept : bool
        Whether its path keeps all limits.
    path : ndarray, shape (samples, 2)
    values : ndarray, shape (samples,)
        Its criterion after each bearing.
    crlb_std : ndarray, shape (targets, states)
        Bound on the standard deviation of each state, for each possible target.
    """

    law: str
    side: int
    value: float
    behind: float
    kept: bool
    path: Array = field(repr=False)
    values: Array = field(repr=False)
    crlb_std: Array = field(repr=False)


_CRITERIA = {
    "D": "log det of the information",
    "A": "trace of the bound",
    "E": "smallest eigenvalue of the information",
    "combination": "variance of the combination",
}


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Answer):
    """A planned path and how good it is; made by `plan`.

    Attributes
    ----------
    path : ndarray, shape (samples, 2)
        Positions at which a bearing is taken, the first at the start, metres.
    headings : ndarray, shape (samples - 1,)
        Clockwise from north, in (-pi, pi], radians.
    speeds : ndarray, shape (samples - 1,)
    turns : ndarray of int
        With a number of legs: the samples at which the path turns.
    criterion : str
        "D", "A", "E" or "combination".
    value : float
        The criterion at the end: log det of the information in physical units
        (D), trace of the bound on the scaled states (A), smallest eigenvalue of
        the information on the scaled states (E), variance of the combination.
        With several targets its expectation.
    values : ndarray, shape (samples,)
        The same after each bearing; -inf, inf or 0 while the states are not
        determined.
    crlb_std : ndarray, shape (targets, states)
        Bound on the standard deviation of each state, for each possible target.
    laws : tuple of LawComparison
        The closed-form laws on the same constraints, best first.
    starts : tuple of Start
        Every guess that was refined, best first.
    optimum, optima : int
        The path is local optimum number `optimum` (1 is the best) of `optima`
        different ones that starts converged to.
    guesses : int
        How many first guesses were compared before some were refined.
    converged : bool
        False where the optimiser stopped early or a limit is not kept; the path
        is the best there is all the same, and `message` says why.
    message : str
    clearance : float
        The smallest distance by which the limits are kept, metres; below zero
        where one is broken, `inf` without any.
    """

    path: Array = field(repr=False)
    headings: Array = field(repr=False)
    speeds: Array = field(repr=False)
    turns: NDArray[np.intp]
    criterion: str
    value: float
    values: Array = field(repr=False)
    crlb_std: Array
    laws: tuple[LawComparison, ...]
    starts: tuple[Start, ...] = field(repr=False)
    optimum: int
    optima: int
    guesses: int
    converged: bool
    message: str
    clearance: float
    targets: Array = field(repr=False)
    weights: Array = field(repr=False)
    names: tuple[str, ...]
    dt: float
    sigma: float
    standoff: float
    keep_out: Array = field(repr=False)

    @property
    def times(self) -> Array:
        """Times of the bearings from the start on, seconds."""
        return np.arange(self.path.shape[0], dtype=float) * self.dt

    @property
    def determinant(self) -> float:
        """The determinant of the information; criterion "D" only (else NaN)."""
        return float(np.exp(self.value)) if self.criterion == "D" else float("nan")

    def positions(self) -> Array:
        """Return the positions of the possible targets, shape (targets, samples, 2)."""
        return moved(self.targets, self.times)

    def covariance(self, path: Array | None = None, target: int = 0) -> Array | None:
        """Return the bound on the covariance of a target's first position.

        Parameters
        ----------
        path : ndarray, shape (k, 2), optional
            Bearings along this path from the start on; along the plan by default.
        target : int
            Which of the possible targets.

        Returns
        -------
        ndarray, shape (2, 2), or None
            None where the bearings do not determine the position. Without the prior.
        """
        taken = self.path if path is None else path
        times = self.dt * np.arange(len(taken))
        position = moved(self.targets, times)[target]
        rows = _core.bearing_rows(times, taken, position, [self.sigma], False)
        full = _core.Analysis(rows[:, : len(self.names)], None).crlb()
        return None if full is None else full[:2, :2]

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain numbers, strings and lists."""
        return {
            "criterion": self.criterion,
            "value": plain(self.value),
            "converged": self.converged,
            "message": self.message,
            "optimum": self.optimum,
            "optima": self.optima,
            "guesses": self.guesses,
            "clearance_m": plain(self.clearance),
            "states": list(self.names),
            "crlb_std": plain(self.crlb_std),
            "times_s": self.times.tolist(),
            "path_m": self.path.tolist(),
            "headings_rad": self.headings.tolist(),
            "speeds_m_s": self.speeds.tolist(),
            "turns": self.turns.tolist(),
            "values": plain(self.values),
            "laws": [
                {
                    "law": law.law,
                    "side": law.side,
                    "value": plain(law.value),
                    "behind": plain(law.behind),
                    "kept": law.kept,
                    "crlb_std": plain(law.crlb_std),
                }
                for law in self.laws
            ],
            "starts": [
                {"name": s.name, "guess": plain(s.guess), "value": plain(s.value)}
                | {"converged": s.converged}
                for s in self.starts
            ],
        }

    def summary(self) -> str:
        """Return the answer in a few lines of words and numbers."""
        noun = _CRITERIA[self.criterion]
        state = "converged" if self.converged else f"NOT CONVERGED: {self.message}"
        lines = [
            f"{self.path.shape[0]} bearings, {noun} {self.value:.6g}   {state}",
            f"local optimum {self.optimum} of {self.optima} found from {len(self.starts)} starts, "
            f"chosen among {self.guesses} guesses ({self.starts[0].name})",
            "bound (1 sigma)   "
            + "   ".join(
                f"{name} {brief(value, 4)}"
                for name, value in zip(
                    self.names, np.sqrt(self.weights @ self.crlb_std**2), strict=True
                )
            ),
        ]
        for law in self.laws:
            note = "" if law.kept else "   (breaks a limit)"
            lines.append(f"{law.law:>14} is {brief(law.behind, 4)} times behind{note}")
        return "\n".join(lines)

    def _as_table(self) -> Columns:
        values = {
            "east": self.path[:, 0],
            "north": self.path[:, 1],
            "heading": np.append(self.headings, np.nan),
            "speed": np.append(self.speeds, np.nan),
            "criterion": self.values,
        }
        units = {"time": "s", "east": "m", "north": "m", "heading": "rad", "speed": "m/s"}
        return Columns("time", self.times, values, units)

    @property
    def reason(self) -> str:
        """The criterion and what it came to; why the search did not converge."""
        text = f"{len(self.path)} bearings, {_CRITERIA[self.criterion]} {self.value:.6g}"
        return text if self.converged else f"{text}; {self.message}"

    @property
    def status(self) -> str:
        """What became of the search: "converged" or "not_converged"."""
        return "converged" if self.converged else "not_converged"


def plan(
    target: ArrayLike,
    start: ArrayLike,
    speed: float | tuple[float, float],
    dt: float,
    samples: int,
    *,
    criterion: Criterion = "D",
    sigma: float | None = None,
    standoff: float | None = None,
    keep_out: ArrayLike | None = None,
    max_turn_rate: float | None = None,
    heading: float | None = None,
    legs: int | None = None,
    prior: Mapping[str, float] | ArrayLike | None = None,
    weights: ArrayLike | None = None,
    scale: ArrayLike | None = None,
    starts: int = 8,
    max_iterations: int = 400,
    seed: int = 0,
) -> Plan:
    """Plan the path from which the bearings of a target tell the most.

    Parameters
    ----------
    target : array_like, shape (2,), (4,), (targets, 2) or (targets, 4)
        Position (x, y) of a fixed target; or (x0, y0, vx, vy) of one at constant
        velocity, whose four states are then to be found. Several rows are
        possible targets: the expectation of the criterion is planned for. Metres,
        seconds; x east, y north.
    start : array_like, shape (2,)
        Where the first bearing is taken.
    speed : float or (float, float)
        Speed of the observer, or its least and largest, m/s, > 0.
    dt : float
        Time from one bearing to the next, seconds, > 0.
    samples : int
        Number of bearings >= 2, the first at the start: samples - 1 moves.
    criterion : {"D", "A", "E"} or {"combination": name or array_like}
        Largest determinant of the information; smallest trace of the bound;
        largest smallest eigenvalue of the information; smallest variance of a
        combination: a state, "range", "bearing" (from the start, at the first
        time), "speed", "course", or one number for each state.
    sigma : float, optional
        Standard deviation of a bearing, radians, > 0. Without a prior it does not
        change the path, and is 1 if not given; a prior needs it.
    standoff : float, optional
        No bearing is taken closer than this to any possible target, metres. By
        default one step, or half the first range if that is less: with none at
        all the best path is onto the target.
    keep_out : array_like, shape (circles, 3), optional
        Discs (east, north, radius) that no part of the path enters, metres.
    max_turn_rate : float, optional
        The heading changes from one step to the next by this times `dt` at most, rad/s.
    heading : float, optional
        Heading before the start, from which the first turn counts, radians.
    legs : int, optional
        The path is made of this many straight legs; the steps at which it turns
        are found too.
    prior : mapping, array_like of shape (states,) or (states, states), optional
        What is known before: standard deviations by name (of states or of the
        named combinations above), one for each state (`inf` for none), or an
        information matrix.
    weights : array_like, shape (targets,), optional
        Probabilities of the possible targets; equal by default.
    scale : array_like, shape (states,), optional
        What counts as one unit of each state for "A" and "E". By default 1 m, and
        for velocities 1 m over the length of the path in time.
    starts : int
        How many of the best different guesses are refined. Most of the time goes into
        this: with 1 a plan takes half or less of it, and says nothing of other optima.
    max_iterations : int
        Of the optimiser, for each start.
    seed : int
        Of the random guesses.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        Values that cannot be used; limits that cannot be kept, by name: a start
        inside the stand-off range or a keep-out circle.
    UnobservableError
        No path of this kind determines the states: a moving target and a single
        leg without a prior, or too few bearings.

    Notes
    -----
    First guesses come from families: the closed-form laws, paths straight in at
    many angles, along the edge of the stand-off circle and back, legs to either
    side, and random ones, all steered clear of the limits. The best different
    ones are refined by SciPy's SLSQP on the analytic gradient of the criterion
    and of the limits. The result is a local optimum, and says which; a path round
    a stand-off circle has many that differ by less than a thousandth.

    The stand-off range holds where bearings are taken: between two of them a
    chord along the circle comes nearer by up to step^2 / (8 standoff).

    The information is that of Xu et al. 2009, eqs. (9) and (10).

    Examples
    --------
    >>> import gramian as gm
    >>> best = gm.maneuver.plan(
    ...     [0.0, 1000.0], [0.0, 0.0], 20.0, 1.0, 40, sigma=0.001**0.5, standoff=800.0
    ... )
    >>> print(f"{best.determinant:.3g}", best.converged)
    0.000206 True
    >>> law = next(law for law in best.laws if law.law == "max_det")
    >>> round(law.behind, 1)
    2.5
    """
    task = Task.checked(
        target=target,
        start=start,
        speed=speed,
        dt=dt,
        samples=samples,
        criterion=criterion,
        sigma=sigma,
        standoff=standoff,
        keep_out=keep_out,
        max_turn_rate=max_turn_rate,
        heading=heading,
        legs=legs,
        prior=prior,
        weights=weights,
        scale=scale,
    )
    starts, max_iterations = whole(starts, "starts", 1), whole(max_iterations, "max_iterations", 1)
    seed = whole(seed, "seed", 0, SEED_MOST)
    with one_blas_thread():
        guesses = leg_guesses(task, seed) if legs is not None else free_guesses(task, seed)
        found = refined(task, guesses, starts, max_iterations)
    if not np.isfinite(task.cost(found[0].value)):
        raise UnobservableError(_why_not(task))
    return _result(task, found, len(guesses))


def _result(task: Task, found: list[Found], guesses: int) -> Plan:
    best = found[0]
    headings = np.repeat(best.headings, best.counts)
    lengths = np.repeat(best.lengths, best.counts)
    moves = lengths[:, None] * np.stack([np.sin(headings), np.cos(headings)], axis=1)
    path = np.concatenate([task.start[None], task.start + np.cumsum(moves, axis=0)])
    limits = Limits(task, best.counts)
    clearance = limits.clearance(best.headings, best.lengths)
    size = max(task.standoff, task.keep_out[:, 2].max(initial=0.0), 1e-300)
    kept = clearance >= -1e-9 * size and _turns_kept(task, headings)
    message = best.message
    if not kept:
        message = (
            f"no path found that keeps all limits: this one breaks one by {brief(-clearance)} m"
            if clearance < 0
            else "no path found that keeps all limits: this one turns faster than it may"
        )
    different = _distinct([task.cost(one.value) for one in found if one.converged])
    return Plan(
        path=path,
        headings=wrap_angles(headings),
        speeds=lengths / task.dt,
        turns=np.cumsum(best.counts)[:-1] if task.legs is not None else np.zeros(0, dtype=np.intp),
        criterion=task.kind,
        value=best.value,
        values=task.objective(np.ones(task.moves, dtype=np.intp)).along(headings, lengths),
        crlb_std=_bounds(task, path),
        laws=_law_comparisons(task, best.value),
        starts=tuple(Start(one.name, one.guess, one.value, one.converged) for one in found),
        optimum=1,
        optima=different,
        guesses=guesses,
        converged=best.converged and kept,
        message=message,
        clearance=clearance,
        targets=task.targets,
        weights=task.weights,
        names=task.names,
        dt=task.dt,
        sigma=task.sigma,
        standoff=task.standoff,
        keep_out=task.keep_out,
    )


def _bounds(task: Task, path: Array) -> Array:
    """Return the bounds (targets, states) that the bearings of a path and the prior give."""
    times = task.dt * np.arange(task.moves + 1)
    positions = moved(task.targets, times)
    rows = _core.bearing_rows(times, path, positions, [task.sigma], False)[..., : len(task.names)]
    return _core.crlb_std(np.concatenate([rows, task.prior], axis=1), None)


def _turns_kept(task: Task, headings: Array) -> bool:
    before = headings[:1] if task.heading is None else np.array([task.heading])
    turns = wrap_angles(np.diff(np.concatenate([before, headings])))
    return bool(np.abs(turns).max() <= task.max_turn + 1e-9)


def _distinct(costs: Sequence[float]) -> int:
    """How many of the costs differ by more than the optimiser's tolerance."""
    seen: list[float] = []
    for cost in costs:
        if np.isfinite(cost) and not any(abs(cost - other) < 1e-5 for other in seen):
            seen.append(cost)
    return max(1, len(seen))


def _law_comparisons(task: Task, planned: float) -> tuple[LawComparison, ...]:
    counts = np.ones(task.moves, dtype=np.intp)
    objective = task.objective(counts)
    lengths = np.full(task.moves, task.fast * task.dt)
    limits = Limits(task, counts)
    result = []
    for law in LAWS:
        sides = []
        for side in (1, -1):
            headings = (
                _held(task, law, side) if task.legs else task.steered(law, [side], RESTORED)[0]
            )
            value = float(objective.values(headings, lengths))
            clear = limits.least(headings, lengths) >= -1e-9 and _turns_kept(task, headings)
            sides.append((task.cost(value) + (0.0 if clear else 1e6), side, value, clear, headings))
        _, side, value, clear, headings = min(sides, key=lambda entry: entry[:2])
        gap = task.cost(value) - task.cost(planned)
        moves = lengths[:, None] * np.stack([np.sin(headings), np.cos(headings)], axis=1)
        path = np.concatenate([task.start[None], task.start + np.cumsum(moves, axis=0)])
        behind = float(np.exp(min(gap, 700.0))) if np.isfinite(gap) else np.inf
        values = objective.along(headings, lengths)
        bounds = _bounds(task, path)
        result.append(LawComparison(law, side, value, behind, clear, path, values, bounds))
    return tuple(sorted(result, key=lambda one: (not one.kept, one.behind)))


def _held(task: Task, law: str, side: int) -> Array:
    """Ask a law at the start of each of equal legs and hold its heading for the leg."""
    counts = whole_counts(np.full(task.legs or 1, task.moves / (task.legs or 1)))
    at, step = task.start, 0
    headings: list[float] = []
    aim = task.weights @ task.targets
    for count in counts:
        here = aim.copy()
        here[:2] += step * task.dt * here[2:]
        length = task.fast * task.dt
        heading = _core.plan_steered(
            at,
            task.dt,
            [length],
            headings[-1] if headings else task.heading,
            0.0,
            np.zeros((0, 4)),
            np.zeros((0, 3)),
            task.max_turn,
            law,
            [float(side)],
            here,
        )[0]
        headings += [float(heading)] * int(count)
        at = at + count * length * np.array([np.sin(heading), np.cos(heading)])
        step += int(count)
    return np.array(headings)


def _why_not(task: Task) -> str:
    if len(task.names) > task.moves + 1 and not task.known:
        return (
            f"samples = {task.moves + 1}: so few bearings cannot determine "
            f"{len(task.names)} states without a prior"
        )
    if task.legs == 1 and len(task.names) == 4:
        return (
            "legs = 1: bearings from a straight leg at constant speed do not determine the range "
            "of a target at constant velocity; allow 2 legs or give a prior"
        )
    return "no path was found whose bearings determine all states: give more samples or a prior"
