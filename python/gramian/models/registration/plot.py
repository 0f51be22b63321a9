"""Pictures of sensor registration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gramian.plot import COLORS, Figure, estimate, figure

if TYPE_CHECKING:
    from gramian.models.registration._field import Field

__all__ = ["bars", "degrees", "estimate", "field", "geometry", "selection"]

Array = NDArray[np.float64]
#: Line colours for several targets that colour-blind readers can distinguish.
LINES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def geometry(
    sensors: Mapping[str, Array],
    tracks: Mapping[str, Array],
    *,
    chosen: Sequence[str] = (),
    singular: bool = True,
) -> Figure:
    """Draw sensors, with the paths (m, d) of those that move, and tracks.

    With `chosen` the other tracks are grey. With `singular` the lines on which two sensors'
    biases cannot be determined are shaded, if both stand.
    """
    fig = figure(6.8, 5.6)
    axes = fig.subplots()
    km = 1e-3
    paths = {
        name: np.atleast_2d(np.asarray(place, dtype=float))[:, :2] * km
        for name, place in sensors.items()
    }
    places = {name: path[0] for name, path in paths.items()}
    moving = [path for path in paths.values() if len(path) > 1]
    points = [np.asarray(track, dtype=float)[:, :2] * km for track in tracks.values()]
    everything = np.vstack([*points, *paths.values()])
    low, high = everything.min(axis=0), everything.max(axis=0)
    middle, half = (low + high) / 2, max((high - low).max() / 2, 1e-6) * 1.12
    if singular and len(places) == 2 and not moving:
        _singular_lines(axes, *places.values())
    bright = 0
    for (name, _), path in zip(tracks.items(), points, strict=True):
        if chosen and name not in chosen:
            axes.plot(*path.T, color=COLORS["muted"], linewidth=0.9, alpha=0.7)
            continue
        color = LINES[bright % len(LINES)]
        bright += 1
        axes.plot(*path.T, color=color, linewidth=2, label=name if bright <= 8 else None)
        axes.plot(*path[0], "o", color=color, markersize=4)
    for path in moving:
        axes.plot(*path.T, color="black", linewidth=1.2, linestyle="--")
    for name, place in places.items():
        axes.plot(*place, "^", color="black", markersize=10)
        axes.annotate(
            name, (place[0], place[1]), xytext=(7, 5), textcoords="offset points", weight="bold"
        )
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_aspect("equal")
    axes.set_xlabel("east, km")
    axes.set_ylabel("north, km")
    axes.grid(alpha=0.3)
    fig.legend(loc="outside upper center", ncols=3, fontsize="small", frameon=False)
    return fig


def _singular_lines(axes: Any, a: Array, b: Array) -> None:
    span = b - a
    across = np.array([-span[1], span[0]])
    style: dict[str, Any] = {"color": COLORS["bad"], "alpha": 0.18, "linewidth": 7, "zorder": 0}
    axes.axline(a, b, label="nothing told along here", **style)
    for place in (a, b):
        axes.axline(place, place + across, **style)


def degrees(
    curves: Mapping[str, tuple[Array, Array]], *, ylabel: str, decibels: str = "no"
) -> Figure:
    """Draw degrees against time; `decibels` "yes" shows 10 log10."""
    fig = figure(6.8, 3.8)
    axes = fig.subplots()
    for (name, (times, values)), color in zip(curves.items(), LINES * 4, strict=False):
        shown = np.asarray(values, dtype=float)
        if decibels == "yes":
            # Zero has no logarithm: it is left out of the line.
            shown = 10 * np.log10(np.where(shown > 0, shown, np.nan))
        axes.plot(times, shown, color=color, linewidth=1.6, label=name)
    if decibels != "yes":
        # A degree of 0 to rounding must look like one.
        largest = max((float(np.max(v, initial=0.0)) for _, v in curves.values()), default=0.0)
        axes.set_ylim(0, 1.08 * max(largest, 0.05))
    axes.set_xlabel("time, s")
    axes.set_ylabel(ylabel)
    axes.grid(alpha=0.3)
    if len(curves) > 1:
        axes.legend(fontsize="small", frameon=False)
    return fig


def field(answer: Field) -> Figure:
    """Draw a map of eta or of a bias's bound."""
    from matplotlib.colors import LogNorm

    fig = figure(6.8, 5.4)
    axes = fig.subplots()
    values = answer.values
    if answer.unit == "rad":
        values, unit = np.degrees(values), "deg"
    else:
        unit = answer.unit
    good = values[np.isfinite(values) & (values > 0)]
    low, high = np.quantile(good, [0.01, 0.99]) if good.size else (0.1, 1.0)
    if high <= low:
        low, high = 0.5 * low, 2 * low + 1e-300
    best_is_high = answer.quantity == "eta"
    mesh = axes.pcolormesh(
        answer.east * 1e-3,
        answer.north * 1e-3,
        np.where(np.isfinite(values) & (values > 0), values, np.nan),
        norm=LogNorm(low, high),
        cmap="viridis" if best_is_high else "viridis_r",
        shading="nearest",
    )
    axes.set_facecolor(COLORS["bad"])
    label = "eta" if best_is_high else f"bound of {answer.quantity}, {unit}".rstrip(", ")
    fig.colorbar(mesh, ax=axes, label=label, extend="both")
    for name, place in zip(answer.labels, answer.sensors * 1e-3, strict=True):
        axes.plot(*place, "^", color="white", markeredgecolor="black", markersize=11)
        axes.annotate(
            name,
            (place[0], place[1]),
            xytext=(7, 5),
            textcoords="offset points",
            weight="bold",
        )
    axes.set_aspect("equal")
    axes.set_xlabel("east, km")
    axes.set_ylabel("north, km")
    where = f"8 looks on a circle of {answer.radius * 1e-3:g} km"
    if answer.heading is not None:
        where = (
            f"8 looks on {2 * answer.radius * 1e-3:g} km of track, "
            f"heading {np.degrees(answer.heading):.0f} deg"
        )
    axes.set_title(where, fontsize="medium")
    return fig


def selection(labels: Sequence[str], bounds: Array, everything: Array, name: str) -> Figure:
    """Draw how a bias's bound falls with each target that is added."""
    fig = figure(6.8, 3.6)
    axes = fig.subplots()
    shown = np.where(np.isfinite(bounds), bounds, np.nan)
    axes.plot(range(1, len(labels) + 1), shown, "o-", color=COLORS["observer"], label="chosen")
    axes.axhline(float(everything), color=COLORS["good"], linestyle="--", label="all targets")
    axes.set_xticks(range(1, len(labels) + 1), labels, rotation=20, ha="right", fontsize="small")
    axes.set_yscale("log")
    axes.set_ylabel(name)
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize="small", frameon=False)
    return fig


def bars(groups: Mapping[str, tuple[Array, Array]], names: Sequence[str]) -> Figure:
    """Draw errors over their bounds, a group of bars for each way of choosing targets."""
    fig = figure(6.8, 3.6)
    axes = fig.subplots()
    width = 0.8 / max(len(groups), 1)
    place = np.arange(len(names))
    for k, ((label, (errors, bounds)), color) in enumerate(
        zip(groups.items(), LINES, strict=False)
    ):
        axes.bar(
            place + (k - (len(groups) - 1) / 2) * width,
            np.abs(errors) / bounds,
            width,
            color=color,
            label=label,
        )
    axes.axhline(1.0, color="black", linewidth=0.9)
    axes.set_xticks(place, names)
    axes.set_ylabel("error over its bound")
    axes.legend(fontsize="small", frameon=False)
    return fig
