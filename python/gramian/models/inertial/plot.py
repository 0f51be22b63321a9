"""Pictures of flights: what each leg makes observable."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gramian._text import brief
from gramian.plot import COLORS, figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gramian.models.inertial._maneuvers import Maneuvers

__all__ = ["maneuver_map"]


def maneuver_map(found: Maneuvers) -> Figure:
    """Draw posterior over prior of each state after each leg; a cross: not determined."""
    n, legs = len(found.names), len(found.legs)
    fig = figure(max(5.6, 0.9 * legs + 3.0), max(4.0, 0.26 * n + 1.6))
    axes = fig.subplots()
    shown = np.clip(found.ratio.T, 1e-4, 1.0)
    image = axes.imshow(np.log10(shown), vmin=-3, vmax=0, cmap="viridis", aspect="auto")
    for i, k in np.argwhere(~found.known.T):
        axes.plot(k, i, "x", color=COLORS["bad"])
    axes.set_yticks(range(n), found.names, fontsize=8)
    labels = [f"{leg}\nto {brief(end)} s" for leg, end in zip(found.legs, found.ends, strict=True)]
    axes.set_xticks(range(legs), labels, fontsize=8)
    axes.set_xlabel("crosses: not determined by the flight up to here")
    fig.colorbar(image, label="log10 of posterior / prior standard deviation")
    return fig
