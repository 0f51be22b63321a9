"""Pictures of bearings-only target motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gramian._text import brief
from gramian.bounds import crlb
from gramian.plot import COLORS, Figure, ellipse, figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gramian.analysis import Observability
    from gramian.models.bearings.scenario import Geometry, StraightLineFit

__all__ = ["bearing_history", "bound_against_time", "draw_geometry", "geometry"]

Array = NDArray[np.float64]


def geometry(tracks: Geometry, answer: Observability) -> Figure:
    """Draw the paths, some lines of sight and the error ellipse of the first position."""
    fig = figure(6.4, 5.4)
    draw_geometry(tracks, answer, fig.subplots())
    fig.legend(loc="outside upper center", ncols=2, fontsize="small", frameon=False)
    return fig


def draw_geometry(tracks: Geometry, answer: Observability, axes: Axes) -> None:
    """Draw the same into given axes, without a legend."""
    km = 1e-3
    observer, target = tracks.observer * km, tracks.target * km
    for i in np.unique(np.linspace(0, len(observer) - 1, 12).astype(int)):
        axes.plot(*zip(observer[i], target[i], strict=True), color=COLORS["muted"], linewidth=0.6)
    for path, name, color in (
        (observer, tracks.observer_name, COLORS["observer"]),
        (target, tracks.target_name, COLORS["target"]),
    ):
        axes.plot(*path.T, color=color, linewidth=2, label=name)
        axes.plot(*path[0], "o", color=color)
        if np.ptp(path, axis=0).max() > 0:
            axes.annotate(
                "",
                path[-1],
                path[max(-len(path), -8)],
                arrowprops={"arrowstyle": "-|>", "color": color, "mutation_scale": 18},
            )
    everything = np.vstack([observer, target])
    low, high = everything.min(axis=0), everything.max(axis=0)
    middle, half = (low + high) / 2, max((high - low).max() / 2, 1e-6) * 1.25
    axis = _error_axis(answer)
    if answer.nullity:
        axes.axline(target[0], target[0] + axis, color=COLORS["bad"], linestyle="--", linewidth=2)
        axes.plot([], [], color=COLORS["bad"], linestyle="--", label="range not determined")
    else:
        covariance = _position_covariance(answer) * km**2
        outline = ellipse(covariance, 0.95) + target[0]
        # The larger half axis, whatever its direction.
        reach = float(np.hypot(*(outline - target[0]).T).max())
        size = f"{brief(reach)} km" if reach >= 1 else f"{brief(1e3 * reach, 2)} m"
        label = f"95 % error ellipse, half axis {size}"
        if reach > 4 * half:
            label += ": far beyond this map"
        elif reach < half / 50:
            label += ": too small to see"
            axes.plot(*target[0], "+", color=COLORS["good"], markersize=16, zorder=5)
        else:
            half = max(half, 1.1 * float(np.abs(outline - middle).max()))
        axes.fill(*outline.T, color=COLORS["bad"], alpha=0.18, zorder=0)
        axes.plot(*outline.T, color=COLORS["bad"], linewidth=1.2, label=label)
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_aspect("equal")
    axes.set_xlabel("east, km")
    axes.set_ylabel("north, km")
    axes.grid(alpha=0.3)


def bound_against_time(tracks: Geometry, history: tuple[Array, Array]) -> Figure:
    """Draw the relative bound from the bearings so far, on a coloured scale."""
    del tracks
    times, relative = history
    fig = figure(6.4, 4.0)
    axes = fig.subplots()
    top, bottom = 1e3, 1e-3
    for low, high, color, name in (
        (bottom, 0.1, "good", "a fix"),
        (0.1, 1.0, "weak", "rough"),
        (1.0, top, "bad", "hopeless"),
    ):
        axes.axhspan(100 * low, 100 * high, color=COLORS[color], alpha=0.12, linewidth=0)
        axes.text(
            1.01, 100 * np.sqrt(max(low, 1e-3) * high), name, color=COLORS[color], va="center",
            transform=axes.get_yaxis_transform(),
        )  # fmt: skip
    finite = np.isfinite(relative)
    axes.plot(times[finite], 100 * relative[finite], color="black", linewidth=1.8)
    if finite.any():
        axes.plot(times[finite][-1], 100 * relative[finite][-1], "o", color="black")
    else:
        axes.text(
            0.5, 0.5, "no bound exists at any time", ha="center", transform=axes.transAxes,
            fontsize="large", color=COLORS["bad"],
        )  # fmt: skip
    axes.set_yscale("log")
    axes.set_ylim(100 * bottom, 100 * top)
    axes.set_xlim(left=0, right=times[-1])
    axes.set_xlabel("time since the first bearing, s")
    axes.set_ylabel("bound on the position, % of mean range")
    return fig


def bearing_history(tracks: Geometry, fit: StraightLineFit) -> Figure:
    """Draw the bearings and what a constant-velocity fit leaves of them."""
    fig = figure(6.4, 4.6)
    upper, lower = fig.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    t = tracks.times - tracks.times[0]
    upper.plot(t, np.degrees(np.unwrap(tracks.bearing)), ".-", color=COLORS["observer"])
    upper.set_ylabel("bearing, deg")
    sigma = np.degrees(tracks.sigma)
    lower.axhspan(-sigma, sigma, color=COLORS["muted"], alpha=0.3, label="1 sigma of the noise")
    if fit.residuals.size == t.size:
        color = COLORS["good"] if fit.holds else COLORS["bad"]
        lower.plot(t, np.degrees(fit.residuals), ".-", color=color)
    lower.axhline(0, color="black", linewidth=0.8)
    lower.set_ylabel("left over, deg")
    lower.set_xlabel("time since the first bearing, s")
    lower.legend(fontsize="small", frameon=False, loc="upper right")
    return fig


def _position_covariance(answer: Observability) -> Array:
    """Return the covariance (2, 2) of the first position; 0 for a known coordinate."""
    full = np.zeros((2, 2))
    place = [("x0", "y0").index(name) for name in answer.names if name in ("x0", "y0")]
    index = [answer.names.index(("x0", "y0")[i]) for i in place]
    full[np.ix_(place, place)] = crlb(answer.problem)[np.ix_(index, index)]
    return full


def _error_axis(answer: Observability) -> Array:
    """Return the direction in the plane along which the position changes no measurement."""
    direction = np.zeros(2)
    source = answer.null_space[:, 0] if answer.nullity else answer.weakest_direction
    for i, name in enumerate(("x0", "y0")):
        if name in answer.names:
            direction[i] = source[answer.names.index(name)]
    length = float(np.hypot(*direction))
    return direction / length if length > 0 else np.array([0.0, 1.0])
