"""The search of the planner: first guesses, their refinement and the limits of a path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cache
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian import _core
from gramian._arrays import wrap_angles
from gramian.exceptions import InputError
from gramian.models.maneuver._laws import LAWS
from gramian.models.maneuver._task import Task, moved

__all__ = [
    "RESTORED",
    "Found",
    "Limits",
    "free_guesses",
    "leg_guesses",
    "one_blas_thread",
    "refined",
    "whole_counts",
]

Array = NDArray[np.float64]

#: What the planner asks its paths to keep beyond the limits, relative, so that
#: rounding on the way leaves them kept.
MARGIN = 1e-7
RESTORED = 1e-10
#: A smooth stand-in for the smallest eigenvalue, sharper in each round.
SHARPNESS = (8.0, 64.0, 512.0)


@dataclass(frozen=True, eq=False)
class Found:
    """A path in legs, on its way to the optimum."""

    name: str
    counts: NDArray[np.intp]
    headings: Array
    lengths: Array
    guess: float
    value: float
    #: By how much a limit is broken, relative; 0 where all are kept.
    short: float
    converged: bool = False
    message: str = "not refined"


def free_guesses(task: Task, seed: int) -> list[Found]:
    """Make paths of free headings that keep the limits, the best of each family first."""
    families: list[tuple[str, Array, NDArray[np.bool]]] = []
    for law in LAWS:
        for side in (1.0, -1.0):
            name = f"law {law}, {_side(side)}"
            families.append((name, *task.steered(law, [[side]], MARGIN)))
    # Angles dense near the line of sight, where a path that goes in is decided.
    offsets = np.pi * np.linspace(0.02, 0.98, 13) ** 1.5
    kinds = [
        (side, float(round(share * task.moves)))
        for share in (1.0, 0.95, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5, 0.35, 0.2)
        for side in (1.0, -1.0)
    ]
    arcs = np.array([[offset, side, back] for side, back in kinds for offset in offsets])
    groups, clear = task.steered("arcs", arcs, MARGIN)
    for k, (side, back) in enumerate(kinds):
        turn = "" if k < 2 else f", back at step {back:.0f}"
        name = f"straight then round, {_side(side)}{turn}"
        group = slice(k * offsets.size, (k + 1) * offsets.size)
        families.append((name, groups[group], clear[group]))
    if len(task.names) == 4:
        # A moving target needs legs to either side, near or far.
        aim = task.weights @ task.targets[:, :2] - task.start
        angles = np.arctan2(*aim) + np.linspace(-np.pi, np.pi, 16, endpoint=False) + np.pi / 32
        first, second = (grid.ravel() for grid in np.meshgrid(angles, angles))
        for legs in range(2, min(4, task.moves) + 1):
            turns = np.where(np.arange(legs) % 2 == 0, first[:, None], second[:, None])
            wanted = np.repeat(turns, whole_counts(np.full(legs, task.moves / legs)), axis=1)
            name = f"two headings in turn, {legs} legs"
            families.append((name, *task.steered("headings", wanted, MARGIN)))
    count = 8
    wild = _wild_headings(task, seed, count)
    families.append(("random legs", *task.steered("headings", wild, MARGIN)))
    names = [name for name, group, _ in families for _ in group]
    every = np.concatenate([group for _, group, _ in families])
    kept = np.concatenate([good for _, _, good in families])
    counts = np.ones(task.moves, dtype=np.intp)
    lengths = np.full(task.moves, task.fast * task.dt)
    return _ordered(task, names, counts, every, lengths, np.where(kept, 0.0, 1.0))


def leg_guesses(task: Task, seed: int) -> list[Found]:
    """Make paths of a few legs, to either side of the bearing in turn or all to one."""
    legs = task.legs or 1
    aim = task.weights @ task.targets[:, :2] - task.start
    bearing = np.arctan2(aim[0], aim[1])
    random = 2 * np.pi * _uniforms(seed, 60 * legs).reshape(-1, legs)
    angles = np.linspace(-np.pi, np.pi, 24, endpoint=False) + np.pi / 48
    if legs == 1:
        every, names = angles[:, None], ["straight"] * angles.size
    else:
        first, second = (grid.ravel() for grid in np.meshgrid(angles, angles))
        turns = np.where(np.arange(legs) % 2 == 0, first[:, None], second[:, None])
        every = np.concatenate([turns, random])
        names = ["two headings in turn"] * len(turns) + ["random legs"] * len(random)
    lengths = np.full(legs, task.fast * task.dt)
    guesses = []
    shares = (1.0,) if legs == 1 else (0.5, 1.0, 2.0)
    for share in shares:
        # The first leg shorter, as long and longer than the others.
        rest = np.full(legs, 1.0)
        rest[0] = share
        counts = whole_counts(task.moves * rest / rest.sum())
        limits = Limits(task, counts)
        short = np.array([limits.short(bearing + turns, lengths) for turns in every])
        guesses += _ordered(task, names, counts, bearing + every, lengths, short)
    return sorted(guesses, key=lambda g: merit(task, g))


def whole_counts(shares: Array) -> NDArray[np.intp]:
    """Return counts >= 1 with the same sum."""
    ends = np.round(np.cumsum(shares)).astype(np.intp)
    legs, steps = len(shares), int(ends[-1])
    ends = np.clip(ends, np.arange(1, legs + 1), steps - np.arange(legs)[::-1])
    return np.diff(ends, prepend=0)


def _wild_headings(task: Task, seed: int, count: int) -> Array:
    legs = min(6, task.moves)
    values = 2 * np.pi * _uniforms(seed, count * legs).reshape(count, legs)
    wild: Array = np.repeat(values, whole_counts(np.full(legs, task.moves / legs)), axis=1)
    return wild


def _uniforms(seed: int, count: int) -> Array:
    from scipy.special import ndtr

    uniform: Array = ndtr(_core.normals(seed, 0, 1, count)[0])
    return uniform


def _ordered(
    task: Task,
    names: Sequence[str],
    counts: NDArray[np.intp],
    headings: Array,
    lengths: Array,
    short: Array,
) -> list[Found]:
    values = task.objective(counts, SHARPNESS[1]).values(headings, lengths).tolist()
    found = [
        Found(name, counts, line, lengths, value, value, broken)
        for name, line, value, broken in zip(names, headings, values, short.tolist(), strict=True)
    ]
    return sorted(found, key=lambda guess: merit(task, guess))


def merit(task: Task, found: Found) -> float:
    """Return the cost, and for a broken limit more than any cost gains."""
    cost = task.cost(found.value)
    return (cost if isfinite(cost) else 1e6) + 1e3 * found.short


def _different(task: Task, guesses: list[Found], count: int) -> list[Found]:
    """Choose the best guesses that differ in value: mirror images do not."""
    chosen: list[Found] = []
    taken: dict[str, int] = {}
    costs: list[float] = []
    for guess in guesses:
        cost = task.cost(guess.value)
        if not isfinite(cost) or any(abs(cost - c) < 1e-7 * (1 + abs(c)) for c in costs):
            continue
        if taken.get(guess.name, 0) >= (count if task.legs else 2):
            continue
        taken[guess.name] = taken.get(guess.name, 0) + 1
        chosen.append(guess)
        costs.append(cost)
        if len(chosen) == count:
            break
    return chosen or guesses[:1]


@cache
def _blas() -> Any:
    # SciPy's optimiser brings its own BLAS, which must be loaded to be found.
    import scipy.optimize  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def one_blas_thread() -> AbstractContextManager[Any]:
    """Keep BLAS to one thread for a while.

    The optimiser's matrices are about 100 x 100: on several threads most of the
    time goes into waiting, ten times as much on a busy machine.
    """
    limit: AbstractContextManager[Any] = _blas().limit(limits=1, user_api="blas")
    return limit


def refined(task: Task, guesses: list[Found], starts: int, iterations: int) -> list[Found]:
    """Refine the best guesses, briefly at first, and the best of those to the end."""
    chosen = _different(task, guesses, starts)
    brief = [_refine(task, guess, min(25, iterations), SHARPNESS[:1]) for guess in chosen]
    brief.sort(key=lambda found: merit(task, found))
    last = [
        found if found.converged and task.kind != "E" else _refine(task, found, iterations)
        for found in brief[:3]
    ]
    if task.legs is not None and task.legs > 1:
        last = [_turned(task, found, iterations) for found in last[:2]] + last[2:]
    return sorted(last + brief[3:], key=lambda found: merit(task, found))


def _turned(task: Task, found: Found, iterations: int) -> Found:
    """Move the turns by whole steps as long as that makes the path better."""
    best = found
    shift = max(1, task.moves // 8)
    while shift:
        better = True
        while better:
            better = False
            for turn in range(len(best.counts) - 1):
                for move in (shift, -shift):
                    counts = best.counts.copy()
                    counts[turn] += move
                    counts[turn + 1] -= move
                    if counts.min() < 1:
                        continue
                    limits = Limits(task, counts)
                    shifted = replace(
                        best, counts=counts, short=limits.short(best.headings, best.lengths)
                    )
                    shifted = _refine(task, shifted, min(60, iterations))
                    if merit(task, shifted) < merit(task, best) - 1e-9:
                        best, better = shifted, True
        shift //= 2
    return best


class Limits:
    """Clearance of a path from its circles and the derivative of that.

    A clearance is (distance / radius)^2 - 1: at least zero outside.
    """

    def __init__(self, task: Task, counts: NDArray[np.intp]) -> None:
        self.max_turn, self.before = task.max_turn, task.heading
        self.free = len(counts) == task.moves
        ends = np.arange(1, task.moves + 1)
        reach = task.fast * task.dt * ends
        circles = []

        def add(x: Array, y: Array, radius: float, whole: float) -> None:
            # Only what the path can reach at all is a limit.
            near = np.hypot(x - task.start[0], y - task.start[1]) < radius + reach
            columns = (ends - 1.0, x, y, np.full(task.moves, radius), np.full(task.moves, whole))
            circles.append(np.stack(columns, axis=1)[near])

        if task.standoff > 0:
            for track in moved(task.targets, task.dt * ends):
                add(track[:, 0], track[:, 1], task.standoff, 0.0)
        for x, y, radius in task.keep_out:
            add(np.full(task.moves, x), np.full(task.moves, y), radius, 1.0)
        every = np.concatenate(circles) if circles else np.zeros((0, 5))
        self.radii = every[:, 3]
        self._near = _core.PlanClearance(task.start, counts.tolist(), every)

    def __len__(self) -> int:
        return len(self._near)

    def values(self, headings: Array, lengths: Array) -> Array:
        return self._near.values(headings, lengths)

    def least(self, headings: Array, lengths: Array) -> float:
        return float(self.values(headings, lengths).min(initial=np.inf))

    def short(self, headings: Array, lengths: Array) -> float:
        """Return by how much the worst limit is broken, 0 for none."""
        excess = 0.0
        if np.isfinite(self.max_turn):
            turns = np.diff(headings, prepend=headings[0] if self.before is None else self.before)
            excess = max(0.0, float(np.abs(wrap_angles(turns)).max()) - self.max_turn - 1e-9)
        return max(excess, -self.least(headings, lengths), 0.0)

    def clearance(self, headings: Array, lengths: Array) -> float:
        """Return the least distance from an edge, metres."""
        values = self.values(headings, lengths)
        # The root of 1 + value, less 1, without the loss of taking it.
        distances = self.radii * values / (1 + np.sqrt(1 + np.maximum(values, -1.0)))
        return float(distances.min(initial=np.inf))

    def gradient(self, headings: Array, lengths: Array) -> tuple[Array, Array]:
        """Return the derivatives by headings and by step lengths, (limits, legs) each."""
        return self._near.gradient(headings, lengths)


def _refine(
    task: Task,
    found: Found,
    iterations: int,
    sharpness: Sequence[float] = SHARPNESS,
) -> Found:
    if task.kind != "E":
        return _descend(task, found, iterations, np.inf)
    for sharp in sharpness:
        found = _descend(task, found, iterations, sharp)
    return found


def _descend(task: Task, found: Found, iterations: int, sharpness: float) -> Found:
    """SLSQP from a path to a local optimum; the limits are kept afterwards."""
    from scipy.optimize import minimize

    objective = task.objective(found.counts, sharpness)
    limits = Limits(task, found.counts)
    legs = len(found.counts)
    longest = task.fast * task.dt
    free_speed = task.slow < task.fast
    turning = np.isfinite(task.max_turn)
    base = task.heading if task.heading is not None else 0.0
    # The optimiser begins with a curvature of 1 by every unknown. By a heading it is about
    # 2 over the number of headings, by a turn, which moves all headings after it, about a
    # third: so scaled it takes a third of the iterations. Limits go along, so that they
    # are kept as closely as without.
    scale = 3.0 if turning else max(1.0, 0.5 * legs)

    def unpack(x: Array) -> tuple[Array, Array]:
        headings = base + np.cumsum(x[:legs]) if turning else x[:legs]
        return headings, longest * x[legs:] if free_speed else found.lengths

    def pack(by_heading: Array, by_length: Array) -> Array:
        if turning:
            by_heading = np.cumsum(by_heading[..., ::-1], axis=-1)[..., ::-1]
        if not free_speed:
            return by_heading
        return np.concatenate([by_heading, longest * by_length], axis=-1)

    def cost_and_slope(x: Array) -> tuple[float, Array]:
        try:
            value, by_heading, by_length = objective.gradient(*unpack(x))
        except InputError:  # a bearing on the target, on the way only
            return 1e6, np.zeros_like(x)
        result = task.cost(value)
        if not isfinite(result):
            return 1e6, np.zeros_like(x)
        return scale * result, scale * task.slope(value) * pack(by_heading, by_length)

    first = np.unwrap(found.headings)
    if turning:
        first = np.diff(first, prepend=base)
        if task.heading is None:
            bounds = [(None, None)] + [(-task.max_turn, task.max_turn)] * (legs - 1)
        else:
            first[0] = wrap_angles(first[0])
            bounds = [(-task.max_turn, task.max_turn)] * legs
    else:
        bounds = [(None, None)] * legs
    if free_speed:
        first = np.concatenate([first, found.lengths / longest])
        bounds += [(task.slow / task.fast, 1.0)] * legs
    constraints = []
    if len(limits):
        constraints = [
            {
                "type": "ineq",
                "fun": lambda x: scale * (limits.values(*unpack(x)) - MARGIN),
                "jac": lambda x: scale * pack(*limits.gradient(*unpack(x))),
            }
        ]
    cost, slope = _by_turns(cost_and_slope)
    done = minimize(
        cost,
        first,
        jac=slope,
        method="SLSQP",
        bounds=bounds if turning or free_speed else None,
        constraints=constraints,
        options={"maxiter": iterations, "ftol": 1e-7 * scale},
    )
    headings, lengths = unpack(np.asarray(done.x))
    if not (np.isfinite(headings).all() and np.isfinite(lengths).all()):
        return found
    if limits.free and not free_speed:
        # What the optimiser's tolerance left inside a circle is turned out of it.
        headings, _ = task.steered("headings", headings, RESTORED)
    value = float(task.objective(found.counts, np.inf).values(headings, lengths))
    result = Found(
        found.name,
        found.counts,
        headings,
        np.array(lengths),
        found.guess,
        value,
        limits.short(headings, lengths),
        bool(done.status == 0),
        str(done.message),
    )
    if merit(task, result) <= merit(task, found):
        return result
    # It began at the end: nothing was gained but the verdict.
    return replace(found, converged=result.converged, message=result.message)


def _by_turns(
    both: Callable[[Array], tuple[float, Array]],
) -> tuple[Callable[[Array], float], Callable[[Array], Array]]:
    """Return value and slope as functions of their own, for one that gives both at once.

    The optimiser asks for the slope where it has just asked for the value.
    """
    slopes: dict[bytes, Array] = {}

    def value(x: Array) -> float:
        slopes.clear()
        found, slopes[x.tobytes()] = both(x)
        return found

    def slope(x: Array) -> Array:
        known = slopes.get(x.tobytes())
        return both(x)[1] if known is None else known

    return value, slope


def _side(side: float) -> str:
    return "right" if side > 0 else "left"
