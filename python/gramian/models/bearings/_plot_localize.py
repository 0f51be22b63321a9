"""Pictures of a target located from its bearings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gramian.plot import COLORS, Figure, figure

__all__ = ["located", "residuals"]

Array = NDArray[np.float64]


def located(
    observer: Array,
    bearings: Array,
    path: Array,
    contours: tuple[Array, ...],
    recorded: Array | None,
) -> Figure:
    """Draw the observer, its bearings, the estimated track and the region of its start.

    Parameters
    ----------
    observer : ndarray, shape (m, 2)
    bearings : ndarray, shape (m,)
    path : ndarray, shape (m, 2)
        The estimated positions.
    contours : tuple of ndarray, shape (k, 2)
        Around the first one; open where the region has no end.
    recorded : ndarray, shape (m, 2), optional
        Where the target was.
    """
    km = 1e-3
    fig = figure(6.4, 5.4)
    axes = fig.subplots()
    reach = 1.15 * np.hypot(*(path - observer).T)
    for i in np.unique(np.linspace(0, len(bearings) - 1, 12).astype(int)):
        ray = observer[i] + np.outer([0, reach[i]], [np.sin(bearings[i]), np.cos(bearings[i])])
        axes.plot(*ray.T * km, color=COLORS["muted"], linewidth=0.6)
    axes.plot(*observer.T * km, color=COLORS["observer"], linewidth=2, label="observer")
    axes.plot(*observer[0] * km, "o", color=COLORS["observer"])
    axes.plot(*path.T * km, color=COLORS["target"], linewidth=2, label="estimated track")
    axes.plot(*path[0] * km, ".", color=COLORS["target"])
    for number, outline in enumerate(contours):
        label = None if number else "95 % of its start"
        axes.fill(*outline.T * km, color=COLORS["weak"], alpha=0.6, zorder=3, label=label)
    if recorded is not None:
        axes.plot(*recorded.T * km, "--", color=COLORS["good"], label="recorded track")
    everything = np.vstack([observer, path])
    low, high = everything.min(axis=0), everything.max(axis=0)
    middle, half = (low + high) / 2 * km, max(float((high - low).max()) / 2, 1e-3) * 1.3 * km
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_aspect("equal")
    axes.set_xlabel("east (km)")
    axes.set_ylabel("north (km)")
    fig.legend(loc="outside upper center", ncols=2, fontsize="small", frameon=False)
    return fig


def residuals(times: Array, left: Array, sigma: float) -> Figure:
    """Draw what the estimate leaves of each bearing, against one and two deviations."""
    fig = figure(6.4, 3.0)
    axes = fig.subplots()
    degrees = np.degrees(sigma)
    axes.axhspan(-2 * degrees, 2 * degrees, color=COLORS["good"], alpha=0.12, linewidth=0)
    axes.axhspan(-degrees, degrees, color=COLORS["good"], alpha=0.18, linewidth=0)
    axes.axhline(0, color="black", linewidth=0.8)
    axes.plot(times - times[0], np.degrees(left), ".", color=COLORS["observer"])
    axes.set_xlabel("time (s)")
    axes.set_ylabel("measured - predicted (deg)")
    return fig
