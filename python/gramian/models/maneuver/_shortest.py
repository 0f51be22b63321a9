"""Paths by the length of the likelihood interval, where the ellipse misleads."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from inspect import signature
from time import monotonic
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import number, whole
from gramian._text import brief, count, plain
from gramian.estimation._knowledge import critical_at
from gramian.exceptions import InputError
from gramian.models.maneuver._planner import Plan, plan
from gramian.models.maneuver._scene import scene
from gramian.models.maneuver._sensing import Sensing
from gramian.models.maneuver._task import MOVING, Criterion, Task
from gramian.models.tracks import Scene, TracksModel

__all__ = ["ShortestInterval", "shortest_interval"]

Array = NDArray[np.float64]

#: Plans are made for these criteria, and for what the interval is of where the planner
#: knows it by that name; their paths are compared.
_CRITERIA: tuple[Criterion, ...] = ("D", "A", "E")
_COMBINATIONS = ("range", *MOVING)
#: A path is bent by so many smooth changes of its headings, or by one for each leg.
_MODES = 5
#: First step of the search by such a change, rad.
_STEP = 0.2


@dataclass(frozen=True, eq=False, repr=False)
class ShortestInterval(Answer):
    """A path chosen by the likelihood interval it leads to; made by `shortest_interval`.

    Attributes
    ----------
    name, unit : str
        What the interval is of.
    level : float
        Its confidence.
    length : float
        Of the interval, from its first end to its last: over the beliefs as `over` says; inf
        where it is open, or an end of it is not certain.
    lengths : ndarray, shape (beliefs,)
        For each belief, measured exactly.
    ellipse : float
        The same of the interval that the local bound (the ellipse) promises.
    path : ndarray, shape (samples, 2) or (observers, samples, 2)
        Positions at which samples are taken, metres.
    headings, speeds : ndarray, shape (samples - 1,) or (observers, samples - 1)
        Clockwise from north, radians; through the water, m/s.
    candidates : tuple of (str, float, float)
        What was compared, the best first: where a path is from, its length, its ellipse's.
    stopped : str
        "done", or what ended the search early: "time" or "interrupted".
    times : ndarray, shape (samples,)
        Of the samples, seconds.
    plan : Plan
        The plan for "D" that it was compared with, among others.
    """

    name: str
    unit: str
    level: float
    length: float
    lengths: Array = field(repr=False)
    ellipse: float
    path: Array = field(repr=False)
    headings: Array = field(repr=False)
    speeds: Array = field(repr=False)
    candidates: tuple[tuple[str, float, float], ...] = field(repr=False)
    stopped: str
    times: Array = field(repr=False)
    plan: Plan = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain numbers, strings and lists."""
        return {
            "name": self.name,
            "unit": self.unit,
            "level": self.level,
            "length": plain(self.length),
            "lengths": plain(self.lengths),
            "ellipse": plain(self.ellipse),
            "path": plain(self.path),
            "headings": plain(self.headings),
            "speeds": plain(self.speeds),
            "candidates": [[name, plain(a), plain(b)] for name, a, b in self.candidates],
            "stopped": self.stopped,
            "times": plain(self.times),
            "plan": self.plan.to_dict(),
        }

    @property
    def reason(self) -> str:
        """How long the interval is, and what the ellipse would have said."""
        what = f"{100 * self.level:.4g} % interval of {self.name}"
        early = {"done": "", "time": "; the time was up", "interrupted": "; interrupted"}
        if not np.isfinite(self.length):
            share = int(np.isinf(self.lengths).sum())
            some = count(len(self.lengths), "belief")
            return (
                f"{what}: open for {share} of {some} on every path that was compared"
                + (early[self.stopped])
            )
        return (
            f"{what}: {brief(self.length)} {self.unit} long, by the ellipse "
            f"{brief(self.ellipse)} {self.unit}{early[self.stopped]}"
        )

    def summary(self) -> str:
        """Return the answer and the paths that were compared."""
        lines = [self.reason, f"{'path':<24} {'interval':>12} {'ellipse':>12}"]
        lines += [
            f"{name:<24} {_length(long):>12} {_length(local):>12}"
            for name, long, local in self.candidates[:8]
        ]
        return "\n".join(lines)

    def _verdict_line(self) -> str:
        return self.reason

    def _as_table(self) -> Columns:
        names, lengths, ellipses = (list(column) for column in zip(*self.candidates, strict=True))
        return Columns("path", names, {"length": lengths, "ellipse": ellipses}, {})


def _length(value: float) -> str:
    return "open" if np.isinf(value) else brief(value)


def shortest_interval(
    target: ArrayLike,
    start: ArrayLike,
    speed: float | tuple[float, float],
    dt: float,
    samples: int,
    *,
    name: str = "range",
    level: float = 0.95,
    evaluations: int = 120,
    seed: int = 0,
    time_limit: float | None = None,
    progress: Callable[[int, int, float], object] | None = None,
    **options_of_plan: Any,
) -> ShortestInterval:
    """Choose the path that leads to the shortest likelihood interval.

    Far away, or with few and noisy bearings, what the measurements allow is not an ellipse:
    the interval of the range is long on the far side, or open. A path that makes the ellipse
    small need not make that interval short.

    Parameters
    ----------
    target, start, speed, dt, samples
        As for `plan`, of one target.
    name : str
        What the interval is of: a state, "range" (from the observer at the first time) or
        "range at the end".
    level : float
        Confidence, between 0 and 1.
    evaluations : int
        How often the best path is changed and judged again, >= 0.
    seed : int
        As for `plan`.
    time_limit : float, optional
        Seconds in all, > 0; the best so far is returned.
    progress : callable, optional
        As for `plan`, of each plan in turn, and of the search: evaluations done, their
        number, the shortest length so far. Ctrl-C returns the best so far.
    **options_of_plan
        All others of `plan` but "criterion" and "bound". `sigma` or `sensors` must be given:
        the interval depends on the noise. A prior has its mean at each belief.

    Returns
    -------
    ShortestInterval

    Raises
    ------
    InputError
        As `plan`; no noise; several targets in a belief; a name that is none.
    UnobservableError
        As `plan`.

    Notes
    -----
    The interval is that of the profile likelihood (Venzon & Moolgavkar 1988) where each
    belief is measured without noise, from its first end to its last where it has several
    pieces. Lost readings count by their probability. The paths of plans for "D", "A" and "E",
    the closed-form laws among them, are compared; the best is then changed by smooth bends,
    or leg by leg, with the simplex of Nelder & Mead. It is a search: no bound is given.

    Examples
    --------
    >>> import gramian as gm
    >>> best = gm.maneuver.shortest_interval(
    ...     [0.0, 8000.0, 0.0, -3.0], [0.0, 0.0], 5.0, 60.0, 20, sigma=0.02,
    ...     legs=2, evaluations=0, starts=2, restarts=0,
    ... )
    >>> best.length <= best.candidates[-1][1]
    True
    """
    level = options.fraction(level, "level")
    evaluations = whole(evaluations, "evaluations", 0, 100_000)
    for word in ("criterion", "bound"):
        if word in options_of_plan:
            raise InputError(f"{word}: shortest_interval plans for the interval of {name!r}")
    if options_of_plan.get("sigma") is None and options_of_plan.get("sensors") is None:
        raise InputError("sigma is not given: a likelihood interval depends on the noise")
    ends = np.inf if time_limit is None else number(time_limit, "time_limit")
    if not ends > 0:
        raise InputError(f"time_limit = {time_limit} s: must be > 0")
    ends += monotonic()
    task = _task(target, start, speed, dt, samples, options_of_plan)
    judge = _Judge(task, name, level)
    found: list[_Judged] = []
    plans: list[Plan] = []
    apart = 0.01 * task.fast * task.dt  # paths nearer than that are one
    stopped = "done"
    try:
        known = name in _COMBINATIONS and (name == "range" or task.dimension == len(MOVING))
        for criterion in (*_CRITERIA, *([{"combination": name}] if known else [])):
            rest = None if time_limit is None else max(ends - monotonic(), 0.01)
            made = plan(
                target, start, speed, dt, samples, criterion=criterion, bound=False,
                seed=seed, time_limit=rest, progress=progress, **options_of_plan,
            )  # fmt: skip
            plans.append(made)
            what = name if isinstance(criterion, dict) else made.criterion
            for label, path in _paths(made, what):
                if not any(np.allclose(path, other.path, atol=apart) for other in found):
                    found.append(judge.of(label, path))
            if (stopped := made.stopped) != "done":
                break
        best = min(found, key=lambda one: one.order)
        if stopped == "done" and evaluations:
            search = _Search(judge, best, evaluations, ends, progress)
            stopped = search.run()
            found.append(search.best)
    except KeyboardInterrupt:
        if not found:
            raise
        stopped = "interrupted"
    if not found:
        raise InputError("no path was found that keeps all limits: see `plan` with these")
    found.sort(key=lambda one: one.order)
    best = found[0]
    one = (lambda values: values[0]) if task.single else np.asarray
    headings, speeds = judge.steered(best.path)
    return ShortestInterval(
        name=name,
        unit=judge.unit,
        level=level,
        length=best.length,
        lengths=best.lengths,
        ellipse=best.ellipse,
        path=one(best.path),
        headings=one(headings),
        speeds=one(speeds),
        candidates=tuple((each.label, each.length, each.ellipse) for each in found),
        stopped=stopped,
        times=np.arange(task.moves + 1, dtype=float) * task.dt,
        plan=plans[0],
    )


def _task(
    target: ArrayLike,
    start: ArrayLike,
    speed: float | tuple[float, float],
    dt: float,
    samples: int,
    given: Mapping[str, Any],
) -> Task:
    """Return what is asked of `plan`, checked, with its own defaults."""
    defaults = {name: one.default for name, one in signature(plan).parameters.items()}
    asked = {name for name in signature(Task.checked).parameters if name in defaults}
    asked -= {"target", "start", "speed", "dt", "samples"}
    chosen = {name: given.get(name, defaults[name]) for name in asked}
    return Task.checked(target=target, start=start, speed=speed, dt=dt, samples=samples, **chosen)


def _paths(made: Plan, criterion: str) -> Iterator[tuple[str, Array]]:
    """Yield the paths that a plan compared and that keep the limits."""
    if not made.violations:
        yield f"plan for {criterion}", made.paths
    for start in made.starts:
        if start.kept:
            yield f"{start.name} ({criterion})", np.asarray(start.path)
    for law in made.laws:
        if law.kept:
            yield law.law, np.asarray(law.path).reshape(made.paths.shape)


@dataclass(frozen=True, eq=False)
class _Judged:
    """A path with the lengths it leads to."""

    label: str
    path: Array
    lengths: Array
    weights: Array
    length: float
    ellipse: float

    @property
    def order(self) -> tuple[float, float, float]:
        """Shorter before longer; where it is open for some, by for how many."""
        closed = np.isfinite(self.lengths)
        open_share = float(self.weights[~closed].sum())
        rest = float(self.lengths[closed] @ self.weights[closed]) if closed.any() else np.inf
        return self.length, open_share, rest if open_share else self.length


@dataclass(frozen=True, eq=False)
class _Judge:
    """Lengths of the intervals that a path leads to."""

    task: Task
    name: str
    level: float

    def __post_init__(self) -> None:
        if self.task.targets.shape[1] != 1:
            raise InputError(
                f"target has {self.task.targets.shape[1]} targets in a belief: must be one, whose "
                "interval it is"
            )
        model = self._any
        options.choice(self.name, "name", [*model.functions, *model.names])

    @cached_property
    def _any(self) -> TracksModel:
        """Any path: the names are the same on all."""
        northward = self.task.fast * self.task.dt * np.array([[0.0, 0.0], [0.0, 1.0]])
        return TracksModel(self._scene(self.task.starts[:, None] + northward))

    @cached_property
    def unit(self) -> str:
        """Of what the interval is of."""
        model = self._any
        if self.name in model.functions:
            return str(model.functions[self.name][1])
        return str(dict(zip(model.names, model.units, strict=True))[self.name])

    def steered(self, path: Array) -> tuple[Array, Array]:
        """Return headings and speeds through the water, (observers, moves)."""
        steps = np.diff(path, axis=1) / self.task.dt - self.task.current
        return np.arctan2(steps[..., 0], steps[..., 1]), np.hypot(steps[..., 0], steps[..., 1])

    def _scene(self, path: Array) -> Scene:
        """Return what the observers see from (observers, samples, 2)."""
        task = self.task
        times = np.arange(path.shape[1], dtype=float) * task.dt
        # A reading that is lost with a probability tells less by as much, as expected.
        sensors = [
            replace(sensing, sigma=sensing.sigma / sensing.detection**0.5, detection=1.0)
            for sensing in task.sensors
        ]
        return scene(path, sensors, times, order=task.dimension // 2 - 1)

    def of(self, label: str, path: Array) -> _Judged:
        """Judge a path."""
        task = self.task
        model = TracksModel(self._scene(path))
        named = model.functions.get(self.name)
        function: Any = None if named is None else named[0]
        if named is None:
            function = np.array([float(state == self.name) for state in model.names])
        lengths, ellipses = [], []
        # The planner's order of the states behind those of the target may be another.
        added = _added(task.sensors)
        own = task.names[task.dimension :]
        order = [*range(task.dimension)]
        order += [task.dimension + own.index(state) for state in model.names[task.dimension :]]
        behind = [added[state] for state in model.names[task.dimension :]]
        for targets, prior in zip(task.targets, task.prior, strict=True):
            x = np.concatenate([targets[0, : task.dimension], behind])
            try:
                exact = model.h(x)
            except InputError:
                # A target on the axis of an array, say: such a path is not chosen.
                lengths.append(np.inf)
                ellipses.append(np.inf)
                continue
            handle = model.handle(self._seen(path, targets[0], exact))
            rows = prior[prior.any(axis=1)][:, order]
            if len(rows):
                handle = handle.with_prior(rows, rows @ x, np.ones(len(rows)))
            found = handle.interval(x, np.empty((0, x.size)), function, self.rise)
            low, high = found["pieces"][0][0], found["pieces"][-1][1]
            # An end that is not sure may be farther out.
            sure = found["certain"] and low is not None and high is not None
            lengths.append(high - low if sure else np.inf)
            ellipses.append(2 * float(found["local"]))
        values, local = np.array(lengths, dtype=float), np.array(ellipses, dtype=float)
        return _Judged(label, path, values, task.weights, self._over(values), self._over(local))

    @cached_property
    def rise(self) -> float:
        """By how much chi2 rises to the ends of the interval."""
        return critical_at(self.level, 1)

    def _seen(self, path: Array, target: Array, z: Array) -> Array:
        """Return readings, NaN for what is in a blind arc or out of reach."""
        times = np.arange(path.shape[1], dtype=float) * self.task.dt
        away = target[:2] + times[:, None] * target[2:] - path
        range_, bearing = (
            np.hypot(*np.moveaxis(away, -1, 0)),
            np.arctan2(away[..., 0], away[..., 1]),
        )
        headings = self.steered(path)[0]
        headings = np.concatenate([headings, headings[:, -1:]], axis=1)
        relative = np.mod(bearing - headings, 2 * np.pi)
        seen = []
        for distances, angles in zip(range_, relative, strict=True):
            for sensing in self.task.sensors:
                lost = distances > (np.inf if sensing.reach is None else float(sensing.reach))
                for begin, end in sensing.blind:
                    lost |= np.mod(angles - begin, 2 * np.pi) <= np.mod(end - begin, 2 * np.pi)
                seen.append(~lost)
        return np.where(np.concatenate(seen), z, np.nan)

    def _over(self, lengths: Array) -> float:
        task = self.task
        if task.over == "worst":
            return float(lengths.max())
        if task.over == "chance":
            order = np.argsort(lengths)
            reached = np.cumsum(task.weights[order]) >= task.chance - 1e-12
            return float(lengths[order][np.argmax(reached)])
        return float(np.inf if np.isinf(lengths).any() else lengths @ task.weights)


def _added(sensors: Sequence[Sensing]) -> dict[str, float]:
    """Return the states that the sensors add, with their values: biases are zero."""
    values: dict[str, float] = {}
    for sensing in sensors:
        if sensing.bias:
            values.setdefault(sensing.bias, 0.0)
        for parameter, name in sensing.unknown.items():
            default = 2.0 if parameter == "exponent" else 0.0
            values.setdefault(name, float(sensing.parameters.get(parameter, default)))
    return values


class _Search:
    """Smooth changes of the headings of a path, by the simplex of Nelder & Mead."""

    def __init__(
        self,
        judge: _Judge,
        best: _Judged,
        evaluations: int,
        ends: float,
        progress: Callable[[int, int, float], object] | None,
    ) -> None:
        self.judge, self.first, self.best = judge, best, best
        self.evaluations, self.ends, self.progress = evaluations, ends, progress
        self.done = 0
        task = judge.task
        self.core = _core.PlanSearch(task.problem(), 1, 0, 1, 0)
        self.headings, self.speeds = judge.steered(best.path)
        self.modes = self._modes()

    def _modes(self) -> Array:
        """Return the changes, (modes, observers, moves): of each leg, or smooth ones."""
        observers, moves = self.headings.shape
        modes = []
        for k in range(observers):
            if self.judge.task.legs is None:
                phase = np.pi * (np.arange(moves) + 0.5) / moves
                shapes = [np.cos(i * phase) for i in range(min(_MODES, moves))]
            else:
                turned = np.abs(np.diff(self.headings, axis=1)).max(axis=0) > 1e-9
                leg = np.concatenate([[0], np.cumsum(turned)])
                shapes = [(leg == i).astype(float) for i in range(leg[-1] + 1)]
            for shape in shapes:
                mode = np.zeros((observers, moves))
                mode[k] = shape
                modes.append(mode)
        return np.array(modes)

    def _cost(self, bends: Array) -> float:
        """Return the log of the length; infinite for a path that breaks a limit."""
        if self.done >= self.evaluations or monotonic() > self.ends:
            raise StopIteration
        self.done += 1
        headings = self.headings + np.tensordot(bends, self.modes, 1)
        made = self.core.judge([1] * headings.shape[1], headings.tolist(), self.speeds.tolist())
        if made["broken"] > 1e-9:
            return np.inf
        found = self.judge.of(f"{self.first.label}, bent", np.array(made["paths"]))
        if found.order < self.best.order:
            self.best = found
        if self.progress is not None:
            self.progress(self.done, self.evaluations, self.best.length)
        length, open_share, rest = found.order
        # Open ends cost more than any length.
        return (
            float(np.log(length))
            if np.isfinite(length)
            else 1e3 * (1 + open_share) + np.log1p(rest if np.isfinite(rest) else 1e300)
        )

    def run(self) -> str:
        """Search; return what ended it."""
        from scipy.optimize import minimize

        count = len(self.modes)
        simplex = np.vstack([np.zeros(count), _STEP * np.eye(count)])
        try:
            minimize(
                self._cost, np.zeros(count), method="Nelder-Mead",
                options={"initial_simplex": simplex, "maxfev": self.evaluations, "fatol": 1e-4,
                         "xatol": 1e-3},
            )  # fmt: skip
        except StopIteration:
            pass
        except KeyboardInterrupt:
            return "interrupted"
        return "time" if monotonic() > self.ends else "done"
