"""Error models of a strapdown inertial navigator, for questions of observability.

Axes are north, west, up (N, W, U) for navigation and forward, left, up for the
body, so that a level vehicle that heads north has both the same. States, in
this order: tilt phi (rad), velocity error dV (m/s), errors of latitude and
longitude (rad) and height (m), gyro bias eps (rad/s) and accelerometer bias
Delta (m/s^2) in body axes. Errors are what the navigator says less what is.
Scale factors, misalignments, lever arms and more can be estimated beside them.

- `static_base`, `error_model`: linear systems for `gramian.linear`, at rest and moving;
  `NAMES` and `UNITS` of the 15 states, `ESTIMATED` what can be estimated beside them,
  `OUTPUTS` what can be measured.
- `segments`, of `Leg`, `recorded` and `sway`: a whole flight, as a `Flight`.
- `visual_inertial`: a camera beside a navigator, as a `gramian.dynamics.Trajectory`.
- `maneuvers`: which leg of a flight makes which state observable, as `Maneuvers`.
- `rotation`, `gravity`, `radii`, `EARTH_RATE`: attitude and the earth.
"""

from gramian.models.inertial._earth import EARTH_RATE, gravity, radii
from gramian.models.inertial._flight import Flight, Leg, recorded, segments, sway
from gramian.models.inertial._maneuvers import Maneuvers, maneuvers
from gramian.models.inertial._model import (
    ESTIMATED,
    NAMES,
    OUTPUTS,
    UNITS,
    error_model,
    rotation,
    static_base,
)
from gramian.models.inertial._visual import visual_inertial

__all__ = [
    "EARTH_RATE",
    "ESTIMATED",
    "NAMES",
    "OUTPUTS",
    "UNITS",
    "Flight",
    "Leg",
    "Maneuvers",
    "error_model",
    "gravity",
    "maneuvers",
    "radii",
    "recorded",
    "rotation",
    "segments",
    "static_base",
    "sway",
    "visual_inertial",
]


def __dir__() -> list[str]:
    return sorted(__all__)
