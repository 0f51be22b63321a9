"""Flights put together from legs, as error models that are constant by segments."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import finite, number
from gramian._values import Value
from gramian.exceptions import InputError
from gramian.models.inertial._model import error_model, positive, vector, wanted
from gramian.models.linear._systems import System
from gramian.models.linear._windows import Piecewise, piecewise, rows_of_segments

__all__ = ["Flight", "Leg", "recorded", "segments", "sway"]

Array = NDArray[np.float64]
_Flown = tuple[tuple[Array, Array, Array], Array, NDArray[np.uintp]]

#: Below this speed, m/s, a vehicle stands.
STANDING = 0.1
#: m/s. Faster, the nose of a vehicle points about where it goes.
MOVING = 5.0
#: Of a flight: each is analysed by itself.
MOST_SEGMENTS = 10_000


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
    """A flight as a piecewise constant error model: of `segments`, `recorded` or `sway`.

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
        return self._kept(self.leg <= leg)

    def only(self, leg: int) -> Flight:
        """Return one leg of the flight."""
        return self._kept(self.leg == leg)

    def _kept(self, keep: NDArray[np.bool_]) -> Flight:
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
        return rows_of_segments(self.A, self._outputs, self.durations, dt, self.system.noise**2)

    def _outputs(self, k: int, time: float) -> Array:
        """Return C of a segment at a time: between the middles of two of a leg in proportion.

        An attitude half a segment off would tell an arm of the antenna from what looks
        exactly like it in a steady turn.
        """
        middles = self.times + self.durations / 2
        since = time + self.times[0]
        here: Array = self.C[k]
        for other in (k - 1, k + 1) if since < middles[k] else (k + 1, k - 1):
            if 0 <= other < len(middles) and self.leg[other] == self.leg[k]:
                part = (since - middles[k]) / (middles[other] - middles[k])
                beside = self.C[other]
                # What is not measured in one of them is not known between them.
                both = here.any(axis=1) & beside.any(axis=1)
                between: Array = np.where(both[:, None], (1 - part) * here + part * beside, here)
                return between
        return here


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
        What else `error_model` takes: estimated, outputs, lever_arm, priors, noises.

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
    found = _core.inertial_segments(
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
        wanted(model),
    )
    return _flown(system, found)


def _flown(system: System, found: _Flown) -> Flight:
    (a, c, _), table, owners = found
    durations, times, headings, speeds, latitudes, longitudes = np.ascontiguousarray(table.T)
    # Nobody knows that a vehicle stands while it moves.
    zero = np.array([name.startswith("zero_") for name in system.outputs])
    c[np.ix_(np.abs(speeds) > STANDING, zero)] = 0.0
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


def recorded(
    times: ArrayLike,
    velocity: ArrayLike,
    attitude: ArrayLike,
    latitude: float,
    height: float = 0.0,
    *,
    legs: ArrayLike | None = None,
    longitude: float = 0.0,
    step: float = 5.0,
    largest_turn: float = np.radians(3),
    **model: object,
) -> Flight:
    """Return a flight given by samples of velocity and attitude: your own.

    Parameters
    ----------
    times : array_like, shape (samples,)
        Seconds, increasing.
    velocity : array_like, shape (samples, 3)
        In N, W, U, m/s.
    attitude : array_like, shape (samples, 3)
        Heading (clockwise from north), pitch (nose up) and roll (right side down),
        radians, as `rotation` takes them. Less than 3 rad of turn between samples.
    latitude, height, longitude : float
        Where it begins; radians and metres. The place later follows from the velocity.
    legs : array_like, shape (legs - 1,), optional
        The times at which a new leg begins, increasing, within the flight: what
        `maneuvers` tells apart. One leg by default.
    step : float
        Longest segment, seconds; one interval between samples where that is longer.
    largest_turn : float
        Largest change of attitude in a segment, radians.
    **model
        What else `error_model` takes: estimated, outputs, lever_arm, priors, noises.

    Returns
    -------
    Flight

    Warns
    -----
    UserWarning
        Where heading and course agree in other axes or units and not in these, where samples
        are missing, and where one alone jumps away and back.

    Raises
    ------
    InputError
        Shapes that do not fit, times that do not increase, a turn too far between
        samples, a pitch beyond the vertical, more than 10 000 segments, what `error_model` refuses.

    Notes
    -----
    Over a segment the specific force and the angular rate are those that lead from the
    velocity and attitude at its beginning to those at its end. A recorded flight is
    never quite straight: ranks count what its noise makes visible too, and the ratios
    of `maneuvers` say whether that is worth anything.

    Examples
    --------
    >>> import numpy as np
    >>> times = np.arange(0.0, 61.0)
    >>> heading = np.clip((times - 30) * 0.05, 0, None)
    >>> velocity = 50 * np.stack([np.cos(heading), -np.sin(heading), 0 * times], axis=1)
    >>> attitude = np.stack([heading, 0 * times, 0.25 * (times > 30)], axis=1)
    >>> flight = recorded(times, velocity, attitude, 0.8, legs=[30.0])
    >>> len(flight.durations), flight.leg[0], flight.leg[-1]
    (36, np.int64(0), np.int64(1))
    """
    t = finite(times, "times")
    if t.ndim != 1 or len(t) < 2:
        raise InputError(f"times has shape {t.shape}: must be (samples,), 2 or more")
    table = {}
    for label, value in (("velocity", velocity), ("attitude", attitude)):
        table[label] = finite(value, label)
        if table[label].shape != (len(t), 3):
            raise InputError(
                f"{label} has shape {table[label].shape}: must be ({len(t)}, 3), a line for each "
                "of the times"
            )
    late = np.flatnonzero(~(np.diff(t) > 0))
    if late.size:
        index = int(late[0]) + 1
        raise InputError(
            f"times[{index}] = {t[index]} s: must be later than the sample before it, "
            f"{t[index - 1]} s"
        )
    borders = np.zeros(0) if legs is None else finite(legs, "legs")
    if borders.ndim != 1:
        raise InputError(f"legs has shape {borders.shape}: must be the times at which legs begin")
    ends = np.concatenate([t[:1], borders, t[-1:]])
    wrong = np.flatnonzero(~(np.diff(np.searchsorted(t, ends)) > 0))
    if wrong.size:
        index = min(int(wrong[0]), len(borders) - 1)
        raise InputError(
            f"legs[{index}] = {borders[index]} s: must be later than the leg before it by a "
            f"sample, and before the end, {t[-1]} s"
        )
    _look_through(t, table["velocity"], table["attitude"])
    return _sampled(t, table, borders, latitude, height, longitude, step, largest_turn, model)


def _sampled(
    t: Array,
    table: dict[str, Array],
    borders: Array,
    latitude: float,
    height: float,
    longitude: float,
    step: float,
    largest_turn: float,
    model: dict[str, object],
) -> Flight:
    positive(step=step, largest_turn=largest_turn)
    for name in ("specific_force", "angular_rate"):
        if name in model:
            raise InputError(f"{name}: must not be given, it follows from the samples")
    system = error_model(latitude, height, **model)  # type: ignore[arg-type]
    place = [number(latitude, "latitude"), number(longitude, "longitude"), number(height, "height")]
    found = _core.inertial_recorded(
        t,
        table["velocity"],
        table["attitude"],
        np.searchsorted(borders, t, side="right").tolist(),
        place,
        step,
        largest_turn,
        wanted(model),
    )
    return _bounded(_flown(system, found))


def _look_through(t: Array, velocity: Array, attitude: Array) -> None:
    """Refuse or warn of samples that are in other units or axes, missing, or failed."""
    for column, name, most in ((1, "pitch", np.pi / 2), (2, "roll", 2 * np.pi)):
        if (bad := np.flatnonzero(np.abs(attitude[:, column]) > most + 1e-9)).size:
            k = bad[0]
            raise InputError(
                f"attitude[{k}]: {name} = {attitude[k, column]:g} rad: must be within "
                f"{most:.4g}; is it in degrees?"
            )
    # The nose of what moves points about where it goes: where it does not as given, and does
    # so in other axes or units, these are meant.
    moving = np.hypot(velocity[:, 0], velocity[:, 1]) > MOVING
    if np.count_nonzero(moving) >= 3:
        first, second = velocity[moving, 0], velocity[moving, 1]
        courses = {
            "": np.arctan2(-second, first),
            "velocity in north, east": np.arctan2(second, first),
            "velocity in east, north": np.arctan2(first, second),
        }
        angles = {"": attitude[moving, 0], "attitude in degrees": np.radians(attitude[moving, 0])}
        fits = {
            " and ".join(part for part in (axes, unit) if part): np.cos(heading - course).mean()
            for unit, heading in angles.items()
            for axes, course in courses.items()
        }
        given = fits.pop("")
        likely = max(fits, key=lambda meaning: fits[meaning])
        if given < 0.5 and fits[likely] > 0.97:
            _warn(
                f"heading and course differ by {np.degrees(np.arccos(given)):.0f} deg; they would "
                f"agree with {likely}: velocities must be north, west, up, and attitudes in radians"
            )
    spans = np.diff(t)
    usual = float(np.median(spans))
    if (long := int(np.argmax(spans))) >= 0 and spans[long] > max(20 * usual, 5.0):
        _warn(
            f"times: nothing from {t[long]:g} to {t[long + 1]:g} s, where samples are {usual:g} s "
            "apart: taken for one steady motion; split the flight there if it was not"
        )
    if len(t) > 2:
        turns = np.abs(np.angle(np.exp(1j * np.diff(attitude, axis=0)))).max(axis=1)
        across = np.abs(np.angle(np.exp(1j * (attitude[2:] - attitude[:-2])))).max(axis=1)
        there_and_back = np.minimum(turns[:-1], turns[1:])
        failed = np.flatnonzero((there_and_back > 0.2) & (across < 0.1 * there_and_back))
        if 0 < failed.size <= max(3, len(t) // 50):
            k = int(failed[0]) + 1
            _warn(
                f"attitude[{k}] at {t[k]:g} s jumps by {np.degrees(turns[k - 1]):.0f} deg and "
                "back: a sample that failed?"
            )


def _warn(told: str) -> None:
    warnings.warn(told, stacklevel=4)


def _bounded(flight: Flight) -> Flight:
    """Refuse a flight of which an analysis would take minutes."""
    if len(flight.durations) > MOST_SEGMENTS:
        raise InputError(
            f"the flight makes {len(flight.durations)} segments, more than {MOST_SEGMENTS}: "
            "larger `step` and `largest_turn`, or a part of it"
        )
    return flight


def sway(
    duration: float,
    latitude: float,
    height: float = 0.0,
    *,
    amplitude: ArrayLike,
    period: ArrayLike,
    phase: ArrayLike = (0.0, 0.0, 0.0),
    heading: float = 0.0,
    velocity: ArrayLike = (0.0, 0.0, 0.0),
    step: float = 0.5,
    **model: object,
) -> Flight:
    """Return the flight of a swaying base: moored, on its wheels in the wind, at sea.

    Parameters
    ----------
    duration : float
        Seconds.
    latitude, height : float
        Radians and metres.
    amplitude, period, phase : array_like, shape (3,)
        Of the oscillation of heading, pitch and roll: radians, seconds, radians.
    heading : float
        About which it sways, radians.
    velocity : array_like, shape (3,)
        In N, W, U, m/s; constant: a base that moves.
    step : float
        Longest segment, seconds: below an eighth of the periods.
    **model
        What else `error_model` takes.

    Returns
    -------
    Flight

    Raises
    ------
    InputError
        A period that is not positive, what `recorded` refuses.

    Examples
    --------
    >>> flight = sway(20.0, 0.6, amplitude=(0.02, 0.05, 0.08), period=(9.0, 7.0, 8.0))
    >>> len(flight.durations), flight.piecewise().rank
    (40, 15)
    """
    duration, step = number(duration, "duration [s]"), number(step, "step [s]")
    positive(duration=duration, step=step)
    count = duration / step
    if count > MOST_SEGMENTS:
        raise InputError(
            f"duration = {duration} s and step = {step} s make {count:.0f} segments, more than "
            f"{MOST_SEGMENTS}"
        )
    swings = {
        name: vector(value, name)
        for name, value in (("amplitude", amplitude), ("period", period), ("phase", phase))
    }
    times = np.linspace(0.0, duration, max(int(np.ceil(count)), 1) + 1)
    angles = _core.inertial_sway(times, *swings.values())
    angles[:, 0] += number(heading, "heading")
    speeds = np.broadcast_to(vector(velocity, "velocity"), angles.shape)
    table = {"velocity": np.ascontiguousarray(speeds), "attitude": angles}
    return _sampled(times, table, np.zeros(0), latitude, height, 0.0, step, np.pi, model)
