"""The planner: paths that make targets as well known as they can, and how far from best."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import ITERATIONS_MOST, SEED_MOST, number, whole, wrap_angles
from gramian._text import brief, plain
from gramian._values import Value
from gramian.exceptions import InputError, UnobservableError
from gramian.models.maneuver._laws import LAWS
from gramian.models.maneuver._sensing import Sensing
from gramian.models.maneuver._task import Criterion, Over, Task, moved

__all__ = ["LawComparison", "Plan", "Start", "Violation", "plan"]

Array = NDArray[np.float64]

#: The largest derivative of the log of the criterion by a heading that counts as an optimum.
FIRST_ORDER = 1e-2
#: Work of the bound: passes on coarse cells, cells of the fine ones.
BOUND_PASSES, BOUND_CELLS = 40, 4e7


@dataclass(frozen=True, eq=False, repr=False)
class Start(Answer):
    """One first guess, or one disturbance of a path, and what became of it.

    Attributes
    ----------
    name : str
        Its family.
    guess, value : float
        The criterion of the guess (NaN for a disturbance), and of the path it led to.
    projected_gradient : float
        As `Plan.projected_gradient`, where the refinement ended.
    kept : bool
        Whether that path keeps all limits.
    path : ndarray, shape (observers, samples, 2)
        That path, metres.
    """

    name: str
    guess: float
    value: float
    projected_gradient: float
    kept: bool
    path: Array = field(repr=False)

    @property
    def converged(self) -> bool:
        """Whether a first-order optimum was reached."""
        return self.kept and self.projected_gradient < FIRST_ORDER


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
    path : ndarray, shape (samples, 2) or (observers, samples, 2)
    values : ndarray, shape (samples,)
        Its criterion after each sample.
    crlb_std : ndarray, shape (beliefs, states)
        Bound on the standard deviation of each state, for each possible target.
    covariances : ndarray, shape (samples, 2, 2)
        As `Plan.covariances`.
    """

    law: str
    side: int
    value: float
    behind: float
    kept: bool
    path: Array = field(repr=False)
    values: Array = field(repr=False)
    crlb_std: Array = field(repr=False)
    covariances: Array = field(repr=False)


@dataclass(frozen=True, eq=False)
class Violation(Value):
    """A limit that a path breaks, where it breaks it most.

    Attributes
    ----------
    limit : str
        The argument of `plan` that asks for it.
    index : int or None
        Which of the circles of "keep_out", or of the "polygons".
    observer : int
        Whose path; of two that come too close, the first.
    sample : int
        At this sample, or on the move that leads there; a turn: at this sample.
    by : float
        By how much: metres, m/s for "speed", rad (in one step) for "max_turn_rate".
    """

    limit: str
    index: int | None
    observer: int
    sample: int
    by: float

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain numbers and strings."""
        return {
            "limit": self.limit,
            "index": self.index,
            "observer": self.observer,
            "sample": self.sample,
            "by": self.by,
        }

    def __str__(self) -> str:
        """Which limit, by how much, and where."""
        name = self.limit if self.index is None else f"{self.limit}[{self.index}]"
        unit = {"speed": "m/s", "max_turn_rate": "rad a step"}.get(self.limit, "m")
        who = f", observer {self.observer}" if self.observer else ""
        return f"{name} is broken by {brief(self.by)} {unit} at sample {self.sample}{who}"


_CRITERIA = {
    "D": "log det of the information",
    "A": "trace of the bound",
    "E": "smallest eigenvalue of the information",
    "combination": "variance of the combination",
}


_RATIOS = {
    "D": "in det^(1/n)",
    "A": "in the trace",
    "E": "in the eigenvalue",
    "combination": "in the variance",
}


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Answer):
    """A planned path and how good it is; made by `plan`.

    Attributes
    ----------
    path : ndarray, shape (samples, 2) or (observers, samples, 2)
        Positions at which samples are taken, the first at the start, metres.
    headings, speeds : ndarray, shape (samples - 1,) or (observers, samples - 1)
        Clockwise from north, in (-pi, pi], radians; through the water, m/s.
    turns : ndarray of int
        With a number of legs: the samples at which the path turns.
    criterion : str
        "D", "A", "E" or "combination".
    value : float
        The criterion at the end: log det of the information in physical units
        (D), trace of the bound on the scaled states (A), smallest eigenvalue of
        the information on the scaled states (E), variance of the combination.
        With several beliefs its expectation, the worst, or what is reached with a chance.
    values : ndarray, shape (samples,)
        The same after each sample; -inf, inf or 0 while the states are not
        determined.
    crlb_std : ndarray, shape (beliefs, states)
        Bound on the standard deviation of each state, for each possible target.
    covariances : ndarray, shape (samples, 2, 2)
        The bound on the covariance of the first position of the first target after
        each sample, what was known before included; NaN while there is none.
    laws : tuple of LawComparison
        The closed-form laws on the same constraints, best first.
    starts : tuple of Start
        Everything that was refined, best first.
    optimum, optima : int
        The path is local optimum number `optimum` (1 is the best) of `optima`
        different ones that were found.
    guesses : int
        How many first guesses were compared before some were refined.
    projected_gradient : float
        The largest derivative of log det, or of the log of another criterion, by a
        heading (rad) or a speed (as a share of the largest) that no active limit holds:
        zero at an optimum. With corners ("E", the worst of beliefs) that of the sharpest
        stand-in.
    converged : bool
        Whether `projected_gradient` is below 0.01 and all limits are kept; the path
        is the best there is all the same, and `message` says why not.
    stopped : str
        "done", "time" where the time was up, "interrupted" by Ctrl-C.
    message : str
    bound : float
        What no path can exceed: an upper bound on the criterion for "D" and "E", a lower
        one for "A" and a combination, whatever the path; NaN where none is computed.
    violations : tuple of Violation
        The limits that the path breaks, each once, the worst first: empty where all are
        kept.
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
    covariances: Array = field(repr=False)
    laws: tuple[LawComparison, ...]
    starts: tuple[Start, ...] = field(repr=False)
    optimum: int
    optima: int
    guesses: int
    projected_gradient: float
    converged: bool
    stopped: str
    message: str
    bound: float
    violations: tuple[Violation, ...]
    clearance: float
    targets: Array = field(repr=False)
    weights: Array = field(repr=False)
    names: tuple[str, ...]
    dt: float
    standoff: float
    keep_out: Array = field(repr=False)
    polygons: tuple[Array, ...] = field(repr=False)

    @property
    def times(self) -> Array:
        """Times of the bearings from the start on, seconds."""
        return np.arange(len(self.values), dtype=float) * self.dt

    @property
    def determinant(self) -> float:
        """The determinant of the information; criterion "D" only (else NaN)."""
        return float(np.exp(self.value)) if self.criterion == "D" else float("nan")

    @property
    def gap(self) -> float:
        """How many times better any path could be, at most: 1 for a proved optimum.

        The ratio of det^(1/n), traces, eigenvalues or variances, n the number of states;
        NaN where no bound is known.
        """
        if self.criterion == "D":
            return float(np.exp((self.bound - self.value) / len(self.names)))
        ratio = self.bound / self.value
        return ratio if self.criterion == "E" else 1 / ratio

    @property
    def paths(self) -> Array:
        """The path of each observer, shape (observers, samples, 2)."""
        return self.path if self.path.ndim == 3 else self.path[None]

    def positions(self) -> Array:
        """Return the positions of all possible targets, shape (targets, samples, 2)."""
        return moved(self.targets.reshape(-1, 4), self.times)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain numbers, strings and lists."""
        return {
            "criterion": self.criterion,
            "value": plain(self.value),
            "converged": self.converged,
            "projected_gradient": plain(self.projected_gradient),
            "stopped": self.stopped,
            "message": self.message,
            "optimum": self.optimum,
            "optima": self.optima,
            "guesses": self.guesses,
            "bound": plain(self.bound),
            "gap": plain(self.gap),
            "violations": [one.to_dict() for one in self.violations],
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
            f"{len(self.values)} samples, {noun} {self.value:.6g}   {state}",
            f"local optimum {self.optimum} of {self.optima} found from {len(self.starts)} starts, "
            f"chosen among {self.guesses} guesses"
            + (f" ({self.starts[0].name})" if self.starts else ""),
            f"projected gradient {brief(self.projected_gradient, 2)} a radian",
            "bound (1 sigma)   "
            + "   ".join(
                f"{name} {brief(value, 4)}"
                for name, value in zip(
                    self.names, np.sqrt(self.weights @ self.crlb_std**2), strict=True
                )
            ),
        ]
        if np.isfinite(self.gap):
            percent = brief(100 * (self.gap - 1), 2)
            lines.append(f"within {percent} % of any path {_RATIOS[self.criterion]}")
        for law in self.laws:
            note = "" if law.kept else "   (breaks a limit)"
            lines.append(f"{law.law:>14} is {brief(law.behind, 4)} times behind{note}")
        return "\n".join(lines)

    def _as_table(self) -> Columns:
        values: dict[str, Any] = {}
        units = {"time": "s"}
        headings, speeds = np.atleast_2d(self.headings), np.atleast_2d(self.speeds)
        for i, path in enumerate(self.paths):
            end = "" if self.path.ndim == 2 else f"_{i + 1}"
            for name, unit, column in (
                ("east", "m", path[:, 0]),
                ("north", "m", path[:, 1]),
                ("heading", "rad", np.append(headings[i], np.nan)),
                ("speed", "m/s", np.append(speeds[i], np.nan)),
            ):
                values[name + end] = column
                units[name + end] = unit
        values["criterion"] = self.values
        return Columns("time", self.times, values, units)

    @property
    def reason(self) -> str:
        """The criterion and what it came to; why the search did not converge."""
        text = f"{len(self.values)} samples, {_CRITERIA[self.criterion]} {self.value:.6g}"
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
    sensors: Sequence[Sensing] | None = None,
    belief: ArrayLike | None = None,
    over: Over = "expectation",
    standoff: float | None = None,
    keep_out: ArrayLike | None = None,
    polygons: Sequence[ArrayLike] | None = None,
    max_turn_rate: float | None = None,
    heading: float | None = None,
    legs: int | None = None,
    return_to: ArrayLike | None = None,
    max_distance: float | None = None,
    separation: float | None = None,
    current: ArrayLike | None = None,
    prior: Mapping[str, float] | ArrayLike | None = None,
    weights: ArrayLike | None = None,
    scale: ArrayLike | None = None,
    starts: int = 12,
    restarts: int = 24,
    max_iterations: int = 400,
    seed: int = 0,
    bound: bool = True,
    time_limit: float | None = None,
    progress: Callable[[int, int, float], object] | None = None,
) -> Plan:
    """Plan the paths from which the sensors tell the most of their targets.

    Parameters
    ----------
    target : array_like, shape (2,), (4,), (beliefs, 2 or 4) or (beliefs, targets, 2 or 4)
        Position (x, y) of a fixed target; or (x0, y0, vx, vy) of one at constant
        velocity, whose four states are then to be found. Several rows are possible
        states of one target; with three axes every belief has several targets that
        are found together. Metres, seconds; x east, y north.
    start : array_like, shape (2,) or (observers, 2)
        Where the first sample is taken: by one observer, or by several at once.
    speed : float or (float, float)
        Speed of the observers through the water, or its least and largest, m/s, > 0.
    dt : float
        Time from one sample to the next, seconds, > 0.
    samples : int
        Number of samples >= 2, the first at the start: samples - 1 moves.
    criterion : {"D", "A", "E"} or {"combination": name or array_like}
        Largest determinant of the information; smallest trace of the bound;
        largest smallest eigenvalue of the information; smallest variance of a
        combination: a state, or of one target "range", "bearing" (from the start, at
        the first time), "speed", "course", or one number for each state.
    sigma : float, optional
        Standard deviation of a bearing, radians, > 0. Without a prior it does not
        change the path, and is 1 if not given; a prior needs it.
    sensors : sequence of Sensing, optional
        What every observer measures instead of bearings alone; unknown biases and
        parameters are states too.
    belief : array_like, shape (states, states), optional
        Covariance of a Gaussian belief about `target`, of which points with the same mean
        and covariance are planned for. It is no prior: give that beside it.
    over : {"expectation", "worst"} or {"chance": probability}
        What is made of several beliefs: their mean, the worst, or what the criterion is at
        least as good as with this probability.
    standoff : float, optional
        No sample is taken closer than this to any possible target, metres. By
        default one step, or half the first range if that is less: with none at
        all the best path is onto the target.
    keep_out : array_like, shape (circles, 3), optional
        Discs (east, north, radius) that no part of a path enters, metres.
    polygons : sequence of array_like, shape (corners, 2), optional
        Outlines of areas that no part of a path enters, metres.
    max_turn_rate : float, optional
        The heading changes from one step to the next by this times `dt` at most, rad/s.
    heading : float, optional
        Heading before the start, from which the first turn counts, radians.
    legs : int, optional
        The paths are made of this many straight legs; the steps at which they turn
        are found too. Several observers turn together.
    return_to : array_like, shape (2,) or (3,), optional
        Where every path ends (east, north), within a radius: one step if not given.
    max_distance : float, optional
        The longest path through the water, metres; needs a range of speeds.
    separation : float, optional
        Observers keep this distance where they measure, metres.
    current : array_like, shape (2,), optional
        Velocity of the water (or wind) that carries the observers, m/s.
    prior : mapping, array_like of shape (states,) or (states, states), optional
        What is known before: standard deviations by name (of states or of the
        named combinations above), one for each state (`inf` for none), or an
        information matrix.
    weights : array_like, shape (beliefs,), optional
        Probabilities of the beliefs; equal by default.
    scale : array_like, shape (states,), optional
        What counts as one unit of each state for "A" and "E". By default 1 m, and
        for velocities 1 m over the length of the path in time.
    starts : int
        How many of the best different guesses are refined. With 1 that is the best law or
        arc; each more brings its share of straight legs and coarse paths to choose from,
        all of them from 12 on.
    restarts : int
        How often one of the best paths is disturbed and refined again.
    max_iterations : int
        Of a refinement, in each round of multipliers.
    seed : int
        Of the random guesses and disturbances: the same seed gives the same plan,
        unless the time is up before.
    bound : bool
        Whether to compute what no path can exceed, `Plan.bound`: for bearings without
        unknown biases and blind arcs, and not for a chance.
    time_limit : float, optional
        Seconds after which the best path so far is returned.
    progress : callable, optional
        Called with pieces of work done, their number, and the best criterion so far.
        Ctrl-C returns the best path so far.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        Values that cannot be used; limits that cannot be kept, by name: a start
        inside the stand-off range, a circle or a polygon, a place to return to out of reach.
    UnobservableError
        No path of this kind determines the states: a moving target and a single
        leg without a prior, or too few samples.

    Notes
    -----
    First guesses are the closed-form laws, paths straight in at many angles and round the
    stand-off circle, and paths of one to six straight legs on a grid of headings, steered
    clear of circles. The best different ones go downhill on an augmented Lagrangian of
    the limits, by a limited-memory quasi-Newton method on the analytic gradient; turns of
    legs are exchanged by whole steps; then the best paths are disturbed (a part turned,
    mirrored, made straight) and refined again. What is best in the end is polished to a
    first-order optimum, see `Plan.projected_gradient`.

    The stand-off range holds where samples are taken: between two of them a
    chord along the circle comes nearer by up to step^2 / (8 standoff). Edges of fields of
    view are smooth in the search and exact in the result.

    The information is that of Xu et al. 2009, eqs. (9) and (10), with the rows of
    `gm.tracks`.

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
        sensors=sensors,
        belief=belief,
        over=over,
        standoff=standoff,
        keep_out=keep_out,
        polygons=polygons,
        max_turn_rate=max_turn_rate,
        heading=heading,
        legs=legs,
        return_to=return_to,
        max_distance=max_distance,
        separation=separation,
        current=current,
        prior=prior,
        weights=weights,
        scale=scale,
    )
    seconds = np.inf if time_limit is None else number(time_limit, "time_limit")
    if not seconds > 0:
        raise InputError(f"time_limit = {time_limit} s: must be > 0")
    if progress is not None and not callable(progress):
        raise InputError(f"progress = {progress!r}: must be callable")
    search = _core.PlanSearch(
        task.problem(),
        whole(starts, "starts", 1, 10_000),
        whole(restarts, "restarts", 0, 10**6),
        whole(max_iterations, "max_iterations", 1, ITERATIONS_MOST),
        whole(seed, "seed", 0, SEED_MOST),
    )
    began = monotonic()
    stopped = search.run(seconds, progress)
    best = search.best()
    if best is None:
        if stopped == "time":
            raise UnobservableError(f"time_limit = {time_limit} s: no path was found in that time")
        raise UnobservableError(_why_not(task))
    most = None
    if options.flag(bound, "bound") and stopped == "done" and best["broken"] <= 1e-9:
        rest = max(seconds - (monotonic() - began), 0.1)
        most = search.bound(BOUND_PASSES, BOUND_CELLS, rest)
    return _result(task, search, best, stopped, most)


def _result(
    task: Task,
    search: _core.PlanSearch,
    best: dict[str, Any],
    stopped: str,
    most: float | None,
) -> Plan:
    counts = best["counts"]
    headings = np.repeat(best["headings"], counts, axis=1)
    speeds = np.repeat(best["speeds"], counts, axis=1)
    clearance, projected = best["clearance"], best["projected_gradient"]
    kept = best["broken"] <= 1e-9
    optimal = projected < FIRST_ORDER
    violations = tuple(Violation(*one) for one in best["violations"])
    message = "first-order optimum"
    if not kept:
        words = "; ".join(str(one) for one in violations)
        message = f"no path found that keeps all limits: {words}"
    elif stopped != "done":
        message = "the time was up" if stopped == "time" else "interrupted"
    elif not optimal:
        message = f"iteration limit: projected gradient {brief(projected, 2)}"
    starts = sorted(
        (Start(name if legs == 0 else f"{name}, {legs}", guess, value, gradient, good,
               np.array(paths))
         for name, legs, guess, value, gradient, good, paths in search.tried()),
        key=lambda start: (not start.kept, task.cost(start.value)),
    )  # fmt: skip
    costs = [task.cost(start.value) for start in starts if start.converged]
    one = (lambda values: values[0]) if task.single else np.asarray
    return Plan(
        path=one(np.array(best["paths"])),
        headings=one(wrap_angles(headings)),
        speeds=one(speeds),
        turns=np.cumsum(counts)[:-1] if task.legs is not None else np.zeros(0, dtype=np.intp),
        criterion=task.kind,
        value=best["value"],
        values=best["values"],
        crlb_std=_bounds(best),
        covariances=best["covariances"],
        laws=_law_comparisons(task, search, best["value"]),
        starts=tuple(starts),
        optimum=1,
        optima=_distinct(costs),
        guesses=search.guessed(),
        projected_gradient=projected,
        converged=bool(kept and optimal and stopped == "done"),
        stopped=stopped,
        message=message,
        bound=np.nan if most is None else most,
        violations=() if kept else violations,
        clearance=clearance,
        targets=task.targets,
        weights=task.weights,
        names=task.names,
        dt=task.dt,
        standoff=task.standoff,
        keep_out=task.keep_out,
        polygons=tuple(task.polygons),
    )


def _bounds(found: dict[str, Any]) -> Array:
    """Return the bounds (beliefs, states) that a path and the prior give."""
    roots = np.array(found["roots"])
    n = round(roots.shape[1] ** 0.5)
    return _core.crlb_std(roots.reshape(-1, n, n), None)


def _distinct(costs: Sequence[float]) -> int:
    """How many of the costs differ by more than the optimiser's tolerance."""
    seen: list[float] = []
    for cost in costs:
        if np.isfinite(cost) and not any(abs(cost - other) < 1e-5 for other in seen):
            seen.append(cost)
    return max(1, len(seen))


def _law_comparisons(
    task: Task, search: _core.PlanSearch, planned: float
) -> tuple[LawComparison, ...]:
    counts = [1] * task.moves
    speeds = np.full((len(task.starts), task.moves), task.fast).tolist()
    result = []
    for law in LAWS:
        sides = []
        for side in (1, -1):
            headings = [
                (
                    _held(task, law, side, start) if task.legs else task.law(law, side, start)
                ).tolist()
                for start in task.starts
            ]
            found = search.judge(counts, headings, speeds)
            kept = found["broken"] <= 1e-9
            sides.append((task.cost(found["value"]) + (0.0 if kept else 1e6), side, kept, found))
        _, side, kept, found = min(sides, key=lambda entry: entry[:2])
        gap = task.cost(found["value"]) - task.cost(planned)
        result.append(
            LawComparison(
                law=law,
                side=side,
                value=found["value"],
                behind=float(np.exp(min(gap, 700.0))) if np.isfinite(gap) else np.inf,
                kept=kept,
                path=np.array(found["paths"][0] if task.single else found["paths"]),
                values=found["values"],
                crlb_std=_bounds(found),
                covariances=found["covariances"],
            )
        )
    return tuple(sorted(result, key=lambda one: (not one.kept, one.behind)))


def _held(task: Task, law: str, side: int, start: Array) -> Array:
    """Ask a law at the start of each of equal legs and hold its heading for the leg."""
    legs = task.legs or 1
    ends = np.round(np.arange(legs + 1) * task.moves / legs).astype(int)
    at, step = start, 0
    headings: list[float] = []
    aim = np.tensordot(task.weights, task.targets, 1).mean(axis=0)
    for count in np.diff(ends):
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
            float(side),
            here,
        )[0]
        headings += [float(heading)] * int(count)
        at = at + count * length * np.array([np.sin(heading), np.cos(heading)])
        step += int(count)
    return np.array(headings)


def _why_not(task: Task) -> str:
    rows = (task.moves + 1) * len(task.starts) * len(task.sensors) * task.targets.shape[1]
    if len(task.names) > rows and not task.known:
        return (
            f"samples = {task.moves + 1}: so few readings cannot determine "
            f"{len(task.names)} states without a prior"
        )
    if task.legs == 1 and task.dimension == 4:
        return (
            "legs = 1: bearings from a straight leg at constant speed do not determine the range "
            "of a target at constant velocity; allow 2 legs or give a prior"
        )
    return "no path was found whose readings determine all states: give more samples or a prior"
