"""Pictures of observability along a trajectory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gramian.plot import COLORS, figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gramian.models.dynamics._windows import Windows

__all__ = ["heat_map"]


def heat_map(found: Windows) -> Figure:
    """Draw the bound of each state over the beginning of the window, and the rank."""
    fig = figure(9.0, max(3.6, 0.35 * len(found.names) + 2.0))
    upper, lower = fig.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    known = np.where(np.isfinite(found.std) & (found.std > 0), found.std, np.nan)
    shown = np.ma.masked_invalid(np.log10(known)).T
    edges = np.append(found.times, 2 * found.times[-1] - found.times[max(len(found.times) - 2, 0)])
    if len(found.times) == 1:
        edges[-1] = edges[0] + found.width
    mesh = upper.pcolormesh(
        edges, np.arange(len(found.names) + 1), shown, cmap="viridis_r", shading="flat"
    )
    upper.set_facecolor(COLORS["bad"])
    upper.set_yticks(np.arange(len(found.names)) + 0.5, list(found.names))
    upper.invert_yaxis()
    upper.set_title("log10 of the bound from the window alone; the ground color: not determined")
    fig.colorbar(mesh, ax=[upper, lower])
    lower.step(found.times, found.rank, where="post", color=COLORS["observer"])
    lower.axhline(found.free, color=COLORS["muted"], linestyle="--", linewidth=1)
    lower.set_ylim(0, found.free * 1.15)
    lower.set_ylabel("rank")
    lower.set_xlabel("beginning of the window")
    return fig
