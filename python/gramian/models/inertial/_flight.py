"""Flights put together from legs, as error models that are constant by segments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gramian._arrays import number
from gramian.exceptions import InputError
from gramian.models.inertial._earth import EARTH_RATE, Earth, checked_place, gravity
from gramian.models.inertial._model import error_model, positive, rotation
from gramian.models.linear._systems import System
from gramian.models.linear._windows import Piecewise, piecewise

__all__ = ["Flight", "Leg", "segments"]

Array = NDArray[np.float64]

# Segments of one leg: more are a slip in its numbers, and hours of work.
_MOST_PIECES = 10_000


@dataclass(frozen=True)
class Leg:
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


@dataclass(frozen=True, eq=False)
class Flight:
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
    if len(legs) == 0:
        raise InputError("legs is empty: a flight needs one")
    positive(step=step, largest_turn=largest_turn)
    latitude, height = checked_place(latitude, height)
    made: list[System] = []
    table = []
    time, place = 0.0, np.array([latitude, longitude])
    for index, leg in enumerate(legs):
        for name in ("duration", "turn", "speed_change", "bank"):
            number(getattr(leg, name), f"legs[{index}].{name}")
        if not leg.duration > 0:
            raise InputError(f"legs[{index}].duration = {leg.duration} s: must be > 0 and finite")
        count = 1
        if leg.turn != 0 or leg.speed_change != 0:
            pieces = max(leg.duration / step, abs(leg.turn) / largest_turn)
            if not pieces <= _MOST_PIECES:
                raise InputError(
                    f"legs[{index}] makes {pieces:.3g} segments, more than {_MOST_PIECES}: "
                    "a shorter leg, or larger `step` and `largest_turn`"
                )
            count = math.ceil(pieces)
        duration = leg.duration / count
        rate, push = leg.turn / leg.duration, leg.speed_change / leg.duration
        for _ in range(count):
            course = heading + rate * duration / 2
            fast = speed + push * duration / 2
            ahead = np.array([np.cos(course), -np.sin(course), 0.0])
            right = np.array([-np.sin(course), -np.cos(course), 0.0])
            v = fast * ahead
            earth = Earth(place[0], height, float(model.get("earth_rate", EARTH_RATE)))  # type: ignore[arg-type]
            w = 2 * earth.rotation() + earth.transport(v)
            force = (
                push * ahead
                + fast * rate * right
                + np.cross(w, v)
                + np.array([0.0, 0.0, gravity(place[0], height)])
            )
            turned = rotation(course, 0.0, leg.bank)
            made.append(
                error_model(
                    place[0],
                    height,
                    specific_force=force,
                    velocity=v,
                    attitude=turned,
                    angular_rate=turned.T @ [0.0, 0.0, -rate],
                    **model,  # type: ignore[arg-type]
                )
            )
            table.append((duration, time, course, fast, place[0], place[1], index))
            place = place + duration * np.array([v[0] / earth.m, -v[1] / (earth.n * earth.cos)])
            time, heading, speed = (
                time + duration,
                heading + rate * duration,
                speed + push * duration,
            )
    lengths, times, headings, speeds, latitudes, longitudes, owners = np.array(table).T
    return Flight(
        system=made[0],
        A=np.array([s.A for s in made]),
        C=np.array([s.C for s in made]),
        durations=lengths,
        times=times,
        heading=headings,
        speed=speeds,
        latitude=latitudes,
        longitude=longitudes,
        leg=owners.astype(np.int64),
    )
