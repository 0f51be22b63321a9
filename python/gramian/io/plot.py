"""Pictures of a recording."""

from __future__ import annotations

import numpy as np

from gramian.io._recording import Recording
from gramian.plot import COLORS, Figure, figure

__all__ = ["coverage", "places"]

#: So many tracks are told apart by colour.
_NAMED = 8


def places(recording: Recording) -> Figure:
    """Draw the tracks in their plane, each from its first report on."""
    fig = figure(6.4, 5.4)
    axes = fig.subplots()
    cycle = list(COLORS.values())
    for i, track in enumerate(recording.tracks.values()):
        color = cycle[i % len(cycle)] if len(recording.tracks) <= _NAMED else COLORS["muted"]
        east, north = track.east / 1000, track.north / 1000
        axes.plot(east, north, color=color, linewidth=1.5, label=track.name)
        axes.plot(east[:1], north[:1], "o", color=color, markersize=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east (km)")
    axes.set_ylabel("north (km)")
    if len(recording.tracks) <= _NAMED:
        fig.legend(loc="outside upper center", ncols=4, fontsize="small", frameon=False)
    return fig


def coverage(recording: Recording) -> Figure:
    """Draw when each track was reported and each sensor saw something."""
    lines = {name: (t.times, COLORS["observer"]) for name, t in recording.tracks.items()}
    lines |= {f"sensor {n}": (d.times, COLORS["target"]) for n, d in recording.sensors.items()}
    fig = figure(6.4, 1.0 + 0.22 * len(lines))
    axes = fig.subplots()
    for row, (times, color) in enumerate(lines.values()):
        axes.plot(times, np.full(times.size, row), "|", color=color, markersize=6)
    axes.set_yticks(range(len(lines)), list(lines), fontsize="small")
    axes.invert_yaxis()
    axes.set_xlabel("time (s)" if recording.epoch is None else f"s after {recording.when(0.0)}")
    return fig
