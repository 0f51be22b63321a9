"""Flights put together from legs, as error models that are constant by segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import number
from gramian._values import Value
from gramian.exceptions import InputError
from gramian.models.inertial._earth import EARTH_RATE
from gramian.models.inertial._model import NAMES, error_model, positive, vector
from gramian.models.linear._systems import System
from gramian.models.linear._windows import Piecewise, piecewise

__all__ = ["Flight", "Leg", "segments"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Leg(Value):
    """A part of a flight with constant rates.

    Attributes
    ----------
    duration : float
        Seconds, > 0.
    turn : float
        By how much the heading changes over the leg, clockwise, radians.
    speed_change : float
        By how much the speed along the heading changes, m/s.
    bank : float
        Roll during the leg, right side down, radians. A coordinated turn banks
        by atan(speed turn rate / g).
    """

    duration: float
    turn: float = 0.0
    speed_change: float = 0.0
    bank: float = 0.0

    def __post_init__(self) -> None:
        for name in ("duration", "turn", "speed_change", "bank"):
            object.__setattr__(self, name, number(getattr(self, name), name))
        if not self.duration > 0:
            raise InputError(f"duration = {self.duration} s: must be > 0")


@dataclass(frozen=True, eq=False)
class Flight(Value):
    """A flight as a piecewise constant error model: what `segments` makes.

    Attributes
    ----------
    system : System
        Names, units, priors and noise; A and C of the first segment.
    A : ndarray, shape (segments, n, n)
    C : ndarray, shape (segments, p, n)
    durations : ndarray, shape (segments,)
    times : ndarray, shape (segments,)
        Beginning of each segment.
    heading, speed, latitude, longitude : ndarray, shape (segments,)
        In its middle; radians and m/s.
    leg : ndarray of int, shape (segments,)
        The leg that each belongs to.
    """

    system: System
    A: Array
    C: Array
    durations: Array
    times: Array
    heading: Array
    speed: Array
    latitude: Array
    longitude: Array
    leg: NDArray[np.int64]

    def upto(self, leg: int) -> Flight:
        """Return the flight up to and with a leg."""
        keep = self.leg <= leg
        return replace(
            self,
            A=self.A[keep],
            C=self.C[keep],
            durations=self.durations[keep],
            times=self.times[keep],
            heading=self.heading[keep],
            speed=self.speed[keep],
            latitude=self.latitude[keep],
            longitude=self.longitude[keep],
            leg=self.leg[keep],
        )

    def piecewise(self, *, rtol: float | None = None) -> Piecewise:
        """Analyse which combinations the flight determines."""
        return piecewise(self.A, self.C, self.durations, self.system.names, rtol=rtol)

    def rows(self, *, dt: float) -> Array:
        """Return whitened rows of samples every `dt`, about the state at the beginning."""
        found = Piecewise(
            self.system.names, (), (), (), (), np.zeros((0, 0)), self.A, self.C, self.durations
        )
        return found.rows(dt=dt, R=self.system.noise**2)


def segments(
    legs: Sequence[Leg],
    latitude: float,
    height: float = 0.0,
    *,
    speed: float = 0.0,
    heading: float = 0.0,
    longitude: float = 0.0,
    step: float = 5.0,
    largest_turn: float = np.radians(3),
    **model: object,
) -> Flight:
    """Put a flight together, level and along its heading, as constant segments.

    Parameters
    ----------
    legs : sequence of Leg
    latitude, height, longitude : float
        Where it begins; radians and metres.
    speed, heading : float
        With which it begins; m/s, and radians clockwise from north.
    step : float
        Longest segment while turning or changing speed, seconds; a leg that does
        neither is one segment.
    largest_turn : float
        Largest change of heading in a segment, radians.
    **model
        What else `error_model` takes: lever_arm, priors, noises.

    Returns
    -------
    Flight

    Raises
    ------
    InputError
        No leg, a duration that is not positive, what `error_model` refuses.

    Examples
    --------
    >>> import math
    >>> quarter = segments([Leg(60.0), Leg(30.0, turn=math.pi / 2)], math.radians(45), speed=50.0)
    >>> quarter.durations.sum(), round(math.degrees(quarter.heading[-1]), 1)
    (np.float64(90.0), 88.5)
    """
    if not isinstance(legs, (list, tuple)) or not all(isinstance(leg, Leg) for leg in legs):
        raise InputError(f"legs = {options.given(legs)}: must be a sequence of Leg")
    if len(legs) == 0:
        raise InputError("legs is empty: a flight needs one")
    speed, heading = number(speed, "speed"), number(heading, "heading")
    longitude = number(longitude, "longitude")
    positive(step=step, largest_turn=largest_turn)
    for name in ("specific_force", "velocity", "attitude", "angular_rate"):
        if name in model:
            raise InputError(f"{name}: must not be given, it follows from the legs")
    system = error_model(latitude, height, **model)  # type: ignore[arg-type]
    lever_arm: ArrayLike = model.get("lever_arm", (0.0, 0.0, 0.0))  # type: ignore[assignment]
    (a, c, _), table, owners = _core.inertial_segments(
        [
            [
                number(getattr(leg, name), f"legs[{index}].{name}")
                for name in ("duration", "turn", "speed_change", "bank")
            ]
            for index, leg in enumerate(legs)
        ],
        [
            number(value, name)
            for name, value in (
                ("latitude", latitude),
                ("longitude", longitude),
                ("height", height),
                ("speed", speed),
                ("heading", heading),
            )
        ],
        step,
        largest_turn,
        vector(lever_arm, "lever_arm"),
        system.n > len(NAMES),
        float(model.get("earth_rate", EARTH_RATE)),  # type: ignore[arg-type]
        model.get("gravity_gradient", "include") == "include",
    )
    durations, times, headings, speeds, latitudes, longitudes = np.ascontiguousarray(table.T)
    return Flight(
        system=replace(system, A=a[0], C=c[0]),
        A=a,
        C=c,
        durations=durations,
        times=times,
        heading=headings,
        speed=speeds,
        latitude=latitudes,
        longitude=longitudes,
        leg=owners.astype(np.int64),
    )
