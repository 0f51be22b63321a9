"""Tracks: any motion, any sensors, unknown biases.

A target moves as a `Motion`; sensors on carriers see it; biases, scales, clock offsets,
tonals and powers are states beside those of the motion. A `Scene` puts them together.
"""

from __future__ import annotations

from gramian.models.tracks._estimate import estimate
from gramian.models.tracks._legs import LegChoice, choose_legs, leg_penalty
from gramian.models.tracks._motion import Carrier, Motion
from gramian.models.tracks._scene import Scene, problem, rows, simulate
from gramian.models.tracks._sensors import Sensor
from gramian.models.tracks._solve import TrackEstimate

__all__ = [
    "Carrier",
    "LegChoice",
    "Motion",
    "Scene",
    "Sensor",
    "TrackEstimate",
    "choose_legs",
    "estimate",
    "leg_penalty",
    "problem",
    "rows",
    "simulate",
]


def __dir__() -> list[str]:
    return sorted(__all__)
