"""Pictures of planned paths and of the closed loop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gramian.plot import COLORS, Figure, ellipse, figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gramian.models.maneuver._closed_loop import ClosedLoop
    from gramian.models.maneuver._planner import Plan
    from gramian.models.maneuver._shortest import ShortestInterval

__all__ = ["accuracy", "candidates", "ellipses", "errors", "information", "paths", "shortest"]

Array = NDArray[np.float64]

#: A line style for each law, to be distinguished without colour too.
_STYLES = {
    "max_det": (COLORS["bad"], "--"),
    "hammel_liu": (COLORS["weak"], "-."),
    "bearing_rate": (COLORS["muted"], ":"),
    "circle": (COLORS["muted"], "-."),
    "perpendicular": (COLORS["muted"], "--"),
    "plan": (COLORS["observer"], "-"),
    "plan_estimate": (COLORS["observer"], "--"),
}
_CRITERIA = {
    "D": "log det of the information",
    "A": "trace of the bound",
    "E": "smallest eigenvalue of the information",
    "combination": "variance of the combination",
}


def paths(plan: Plan) -> Figure:
    """Draw the planned path, the laws' and what they keep clear of."""
    fig = figure(6.4, 6.0)
    axes = fig.subplots()
    for law in reversed(plan.laws):
        color, style = _STYLES[law.law]
        for i, path in enumerate(law.path.reshape(-1, *plan.paths.shape[1:])):
            label = f"law {law.law}" if i == 0 else None
            axes.plot(*path.T, style, color=color, linewidth=1.2, label=label)
    for i, path in enumerate(plan.paths):
        label = "plan" if i == 0 else None
        axes.plot(*path.T, ".-", color=COLORS["observer"], markersize=4, label=label)
        label = "start" if i == 0 else None
        axes.plot(*path[0], "o", color=COLORS["observer"], markersize=8, label=label)
        if plan.turns.size:
            label = "turns" if i == 0 else None
            turns = path[plan.turns].T
            axes.plot(*turns, "s", color=COLORS["observer"], markersize=7, label=label)
    _surroundings(plan, axes)
    fig.legend(loc="outside upper center", ncols=3, fontsize="small", frameon=False)
    return fig


def shortest(found: ShortestInterval) -> Figure:
    """Draw the path that leads to the shortest interval, and the plan for "D" behind it."""
    fig = figure(6.4, 6.0)
    axes = fig.subplots()
    for i, path in enumerate(found.plan.paths):
        label = 'plan for "D"' if i == 0 else None
        axes.plot(*path.T, "--", color=COLORS["muted"], linewidth=1.4, label=label)
    for i, path in enumerate(found.path.reshape(found.plan.paths.shape)):
        label = "shortest interval" if i == 0 else None
        axes.plot(*path.T, ".-", color=COLORS["observer"], markersize=4, label=label)
        label = "start" if i == 0 else None
        axes.plot(*path[0], "o", color=COLORS["observer"], markersize=8, label=label)
    _surroundings(found.plan, axes)
    fig.legend(loc="outside upper center", ncols=3, fontsize="small", frameon=False)
    return fig


def candidates(plan: Plan, most: int = 12) -> Figure:
    """Draw the best different paths that were found, with their values."""
    from matplotlib.colors import Normalize

    fig = figure(6.4, 6.0)
    axes = fig.subplots()
    shown: list[Any] = []
    for start in plan.starts:
        alike = any(abs(start.value - one.value) <= 1e-3 * abs(one.value) for one in shown)
        if start.kept and np.isfinite(start.value) and not alike:
            shown.append(start)
    shown = shown[:most]
    norm = Normalize(0, max(len(shown) - 1, 1))
    for rank, start in reversed(list(enumerate(shown))):
        best = rank == 0
        color = COLORS["observer"] if best else str(0.35 + 0.45 * norm(rank))
        for i, path in enumerate(start.path):
            label = f"{start.value:.5g}  {start.name}" if i == 0 else None
            axes.plot(*path.T, "-", color=color, linewidth=2.2 if best else 1.1, label=label)
    handles, labels = axes.get_legend_handles_labels()
    axes.plot(*plan.paths[:, 0].T, "o", color=COLORS["observer"], markersize=8)
    _surroundings(plan, axes)
    # Below the map: beside it a long name would leave the map a strip.
    fig.legend(
        handles[::-1],
        labels[::-1],
        loc="outside lower center",
        ncols=2,
        fontsize="small",
        frameon=False,
        title=_CRITERIA[plan.criterion],
    )
    return fig


def accuracy(plan: Plan) -> Figure:
    """Draw the bound on the target's position after each sample, of the plan and the laws."""
    fig = figure(6.4, 4.0)
    axes = fig.subplots()

    def draw(covariances: Array, style: str, color: str, name: str) -> None:
        bound = np.sqrt(np.trace(covariances, axis1=1, axis2=2))
        _finite(axes, plan.times, bound, style, color, name)

    for law in reversed(plan.laws):
        color, style = _STYLES[law.law]
        draw(law.covariances, style, color, f"law {law.law}")
    draw(plan.covariances, "-", COLORS["observer"], "plan")
    axes.set_yscale("log")
    axes.set_xlabel("time, s")
    axes.set_ylabel("bound on the first position, m (1 sigma)")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", frameon=False)
    return fig


def information(plan: Plan) -> Figure:
    """Draw the criterion after each bearing, of the plan and of the laws."""
    fig = figure(6.4, 4.0)
    axes = fig.subplots()
    for law in reversed(plan.laws):
        color, style = _STYLES[law.law]
        _finite(axes, plan.times, law.values, style, color, f"law {law.law}")
    _finite(axes, plan.times, plan.values, "-", COLORS["observer"], "plan")
    if plan.criterion != "D":
        axes.set_yscale("log")
    for turn in plan.turns:
        axes.axvline(plan.times[turn], color=COLORS["observer"], linewidth=0.8, linestyle=":")
    axes.set_xlabel("time, s")
    axes.set_ylabel(_CRITERIA[plan.criterion])
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", frameon=False)
    return fig


def ellipses(plan: Plan) -> Figure:
    """Draw the 95 % ellipses of the first target after parts of the path, plan and best law."""
    fig = figure(7.2, 3.6)
    count = len(plan.values)
    law = plan.laws[0]
    for axes, part in zip(fig.subplots(1, 3), (1 / 3, 2 / 3, 1.0), strict=True):
        k = max(2, round(part * count))
        reach = 0.0
        for covariances, color, style, name in (
            (plan.covariances, COLORS["observer"], "-", "plan"),
            (law.covariances, *_STYLES[law.law], f"law {law.law}"),
        ):
            covariance = covariances[k - 1]
            if not np.isfinite(covariance).all():
                axes.plot([], [], style, color=color, label=f"{name}: none")
                continue
            outline = ellipse(covariance, 0.95)
            axes.fill(*outline.T, color=color, alpha=0.12)
            axes.plot(*outline.T, style, color=color, label=name)
            reach = max(reach, float(np.abs(outline).max()))
        if reach == 0:
            reach = 1.0
            axes.text(0, 0.4, "not determined yet", ha="center", color=COLORS["bad"])
        reach *= 1.1
        axes.plot(0, 0, "+", color=COLORS["target"], markersize=12)
        axes.set_xlim(-reach, reach)
        axes.set_ylim(-reach, reach)
        axes.set_aspect("equal")
        axes.set_title(f"after {k} bearings", fontsize="medium")
        axes.set_xlabel("east, m")
        axes.grid(alpha=0.3)
    fig.axes[0].set_ylabel("north, m")
    handles, labels = fig.axes[-1].get_legend_handles_labels()
    fig.legend(
        handles, labels, loc="outside upper center", ncols=2, fontsize="small", frameon=False
    )
    return fig


def errors(loop: ClosedLoop) -> Figure:
    """Draw the error of the closed loop against time and the final errors."""
    fig = figure(8.0, 3.8)
    left, right = fig.subplots(1, 2)
    for run in loop.runs:
        color, style = _STYLES[run.method]
        name = run.method if run.method.startswith("plan") else f"law {run.method}"
        times = loop.dt * np.arange(run.errors.shape[1])
        left.plot(times, run.rms, style, color=color, label=name)
        final = np.sort(run.errors[:, -1])
        right.plot(final, (np.arange(final.size) + 0.5) / final.size, style, color=color)
    left.set_yscale("log")
    left.set_xlabel("time, s")
    left.set_ylabel("error of the position, m (rms)")
    left.legend(fontsize="small", frameon=False)
    right.set_xlabel("final error, m")
    right.set_ylabel("part of the trials below")
    right.set_xlim(left=0)
    right.set_ylim(0, 1)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return fig


def _surroundings(plan: Plan, axes: Axes) -> None:
    """Draw the targets and what is kept clear of, and make the axes those of a map."""
    _targets(plan, axes)
    _areas(plan, axes)
    axes.set_aspect("equal")
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    axes.grid(alpha=0.3)


def _targets(plan: Plan, axes: Axes) -> None:
    for i, track in enumerate(plan.positions()):
        label = ("target" if len(plan.targets) == 1 else "possible targets") if i == 0 else None
        moving = bool(np.ptp(track, axis=0).max() > 0)
        if moving:
            axes.plot(*track.T, color=COLORS["target"], linewidth=1.5)
        axes.plot(*track[0], "*", color=COLORS["target"], markersize=13, label=label)
        if moving:
            axes.plot(*track[-1], "*", color=COLORS["target"], markersize=13, markerfacecolor="w")
        elif plan.standoff > 0:
            disc = _disc(track[0], plan.standoff, COLORS["target"], 0.08)
            axes.add_patch(disc)
            if i == 0:
                disc.set_label("stand-off range")


def _areas(plan: Plan, axes: Axes) -> None:
    areas = [
        axes.add_patch(_disc((east, north), radius, COLORS["bad"], 0.25))
        for east, north, radius in plan.keep_out
    ]
    for outline in plan.polygons:
        areas += axes.fill(*outline.T, facecolor=COLORS["bad"], edgecolor=COLORS["bad"], alpha=0.25)
    if areas:
        areas[0].set_label("not entered")


def _disc(center: Array | tuple[float, float], radius: float, color: str, alpha: float) -> Any:
    from matplotlib.patches import Circle

    east, north = (float(value) for value in center)
    return Circle((east, north), radius, facecolor=color, alpha=alpha, edgecolor=color)


def _finite(axes: Axes, times: Array, values: Array, style: str, color: str, name: str) -> None:
    shown = np.isfinite(values) & (values != 0)
    axes.plot(times[shown], values[shown], style, color=color, label=name)
