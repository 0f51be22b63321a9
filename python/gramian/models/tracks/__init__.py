"""Tracks: any motion, any sensors, unknown biases.

A target moves as a `Motion`; each `Sensor` on a `Carrier` sees it; biases, scales, clock
offsets, tonals and powers are states beside those of the motion. A `Scene` puts them
together.

- `problem` and `rows` say what a scene determines; `simulate` draws measurements.
- `estimate` gives the most likely state of one record, an `Estimate`: a `gramian.Estimate` of a
  `TracksModel`; `estimate_many` those of many, `Estimates`.
- `choose_legs` tells how many legs a track has, a `LegChoice`; `leg_penalty` calibrates it.
"""

from gramian.models.tracks._estimate import Estimate, estimate
from gramian.models.tracks._legs import LegChoice, choose_legs, leg_penalty
from gramian.models.tracks._many import Estimates, estimate_many
from gramian.models.tracks._model import TracksModel
from gramian.models.tracks._motion import Carrier, Motion
from gramian.models.tracks._scene import Scene, problem, rows, simulate
from gramian.models.tracks._sensors import Sensor

__all__ = [
    "Carrier",
    "Estimate",
    "Estimates",
    "LegChoice",
    "Motion",
    "Scene",
    "Sensor",
    "TracksModel",
    "choose_legs",
    "estimate",
    "estimate_many",
    "leg_penalty",
    "problem",
    "rows",
    "simulate",
]


def __dir__() -> list[str]:
    return sorted(__all__)
