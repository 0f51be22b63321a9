"""Sensors and the names of their biases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _options as options
from gramian._arrays import as_float_array, finite, wrap_angles
from gramian._text import brief
from gramian._values import Value
from gramian.exceptions import InputError

if TYPE_CHECKING:
    from gramian.models.tracks import Carrier

Array = NDArray[np.float64]
Extra = Literal["gain", "position", "attitude"]
Azimuths = Literal["north", "heading"]

EXTRAS: tuple[Extra, ...] = ("gain", "position", "attitude")
LETTERS = tuple("ABCDEFGHIJKLMNOPQRSTUVWXYZ")


@dataclass(frozen=True, eq=False)
class Platform(Value):
    """A sensor that moves, or whose azimuths count from the heading of what carries it.

    It stands for a place among the `sensors` of this module's functions, which then take the
    times of the looks.

    Parameters
    ----------
    path : array_like, shape (m, d) or (d,)
        Places (east, north, and up), metres, straight in between; one place for a sensor
        that stands.
    times : array_like, shape (m,), optional
        Of the places, increasing, seconds, on the clock of the sensor; m >= 2. Not for one
        place.
    heading : array_like, shape (m,), or float for one place, optional
        Clockwise from north, radians; by default that of the velocity along the path.
    azimuths : {"north", "heading"}
        What azimuths count from.

    Raises
    ------
    InputError
        Shapes or times that do not fit; a path of one place with times.

    Notes
    -----
    Place and heading at a look are those of a `gramian.tracks.Carrier`, and taken as known.
    With azimuths from the heading, reports are r and theta - heading, and an error of the
    heading is the same as one of the azimuth: one state, "B.azimuth", is their sum. With
    the extra "attitude" both are states, "B.azimuth" and "B.heading", of which only the sum
    is observable, unless priors tell them apart. Errors of the path are not modelled, nor
    what a wrong heading does to places that are reckoned by it.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> ship = Platform([[60e3, 0], [60e3, 9e3]], [0.0, 900.0], azimuths="heading")
    >>> t = np.linspace(0.0, 900.0, 50)
    >>> target = np.stack([200.0 * t - 40e3, 30e3 + 0 * t], axis=1)
    >>> seen = gm.registration.problem(
    ...     target, {"A": (0, 0), "B": ship}, (50.0, 0.00175), times=t, extras=["attitude"]
    ... )
    >>> gm.analyze(seen).null_combinations
    ('A.azimuth +1, A.heading -1', 'B.azimuth +1, B.heading -1')
    """

    path: ArrayLike
    times: ArrayLike | None = None
    heading: ArrayLike | float | None = None
    azimuths: Azimuths = "north"

    def __post_init__(self) -> None:
        options.choice(self.azimuths, "azimuths", ("north", "heading"))
        carrier = self.carrier
        for name in ("path", "times"):
            object.__setattr__(self, name, getattr(carrier, name))
        if self.times is not None and np.shape(self.path)[0] < 2:
            raise InputError(
                "path has 1 place: a platform that moves needs 2 or more, with their times; one "
                "that stands is given by its place, without times"
            )
        if self.times is None and self.heading is None and self.azimuths == "heading":
            raise InputError(
                'azimuths = "heading" without a heading: a platform that stands has one only '
                "where it is given"
            )

    @cached_property
    def carrier(self) -> Carrier:
        """Place and heading at any time of the path."""
        from gramian.models.tracks import Carrier

        return Carrier(self.path, self.times, heading=self.heading, name="platform")

    @property
    def moves(self) -> bool:
        """Whether it has a path."""
        return self.times is not None


SensorsLike = ArrayLike | Mapping[str, ArrayLike | Platform] | Sequence[ArrayLike | Platform]


@dataclass(frozen=True, eq=False)
class Setup(Value):
    """Checked sensors: names, places, deviations (N, d), further biases.

    Places are (N, d), or of platforms that move (K, N, d), those at each look. Headings that
    azimuths count from are (N,) or (K, N), 0 for north; None where all are.
    """

    labels: tuple[str, ...]
    places: Array
    sigma: Array
    extras: tuple[Extra, ...]
    headings: Array | None = None

    @property
    def d(self) -> int:
        """Number of coordinates."""
        return int(self.places.shape[-1])

    @property
    def moves(self) -> bool:
        """Whether places are given look by look."""
        return self.places.ndim == 3

    def at(self, looks: NDArray[np.bool_] | np.bool_) -> Setup:
        """Return the sensors at these looks alone."""
        headings = self.headings
        if headings is not None and headings.ndim == 2:
            headings = headings[looks]
        places = self.places[looks] if self.moves else self.places
        return replace(self, places=places, headings=headings)

    def to_north(self, reports: Array) -> Array:
        """Return reports (..., K, N, d) with azimuths that all count from north."""
        return self._turned(reports, 1.0)

    def as_measured(self, reports: Array) -> Array:
        """Return reports (..., K, N, d) as the sensors give them: what `to_north` undoes."""
        return self._turned(reports, -1.0)

    def _turned(self, reports: Array, sign: float) -> Array:
        if self.headings is None:
            return reports
        out = reports.copy()
        out[..., 1] = wrap_angles(reports[..., 1] + sign * self.headings)
        return out

    @property
    def flags(self) -> tuple[bool, bool, bool]:
        """Which extras there are, in the order of the extension module."""
        extras = self.extras
        if not extras:
            return False, False, False
        return "gain" in extras, "position" in extras, "attitude" in extras

    @property
    def kinds(self) -> tuple[tuple[str, str], ...]:
        """The biases of one sensor: name and unit."""
        space = self.d == 3
        kinds = [("range", "m"), ("azimuth", "rad")]
        kinds += [("elevation", "rad")] if space else []
        if "gain" in self.extras:
            kinds.append(("gain", ""))
        if "position" in self.extras:
            kinds += [("east", "m"), ("north", "m")] + ([("up", "m")] if space else [])
        if "attitude" in self.extras:
            kinds += [("tilt_east", "rad"), ("tilt_north", "rad")] if space else []
            kinds.append(("heading", "rad"))
        return tuple(kinds)

    @property
    def names(self) -> tuple[str, ...]:
        """All biases: "A.range", "A.azimuth", ..."""
        return tuple(f"{label}.{kind}" for label in self.labels for kind, _ in self.kinds)

    @property
    def units(self) -> tuple[str, ...]:
        """Their units."""
        return tuple(unit for _ in self.labels for _, unit in self.kinds)

    @property
    def n(self) -> int:
        """Number of biases."""
        return len(self.labels) * (len(self.kinds) if self.extras else self.d)

    def biases(self, value: ArrayLike | Mapping[str, float] | None, name: str = "biases") -> Array:
        """Return biases (..., n) from an array or from values by name."""
        if value is None:
            return np.zeros(self.n)
        if not isinstance(value, Mapping):
            array = as_float_array(value, name)
            if array.ndim == 0 or array.shape[-1] != self.n:
                raise InputError(
                    f"{name} has shape {array.shape}: must be (..., {self.n}), "
                    f"for {', '.join(self.names)}"
                )
            return array
        array = np.zeros(self.n)
        for key, one in options.mapping(value, name).items():
            array[self.index(key)] = as_float_array(one, f"{name}[{key!r}]")
        return array

    def index(self, name: str) -> int:
        """Return the place of a bias."""
        if isinstance(name, str) and name in self.names:
            return self.names.index(name)
        raise InputError(
            f"no bias is named {options.given(name)}: there are {', '.join(self.names)}"
        )

    @property
    def is_pair(self) -> bool:
        """Whether these are two sensors in the plane without further biases."""
        return self.places.shape == (2, 2) and not self.extras


def setup(
    sensors: SensorsLike,
    sigma: ArrayLike | None,
    extras: Sequence[Extra] = (),
    least: int = 2,
    *,
    times: ArrayLike | None = None,
    still: str = "",
) -> Setup:
    """Check sensors, `least` or more, and deviations; `sigma` None stands for deviations of 1.

    Platforms that move have places at the `times` of the looks; `still` names what none may
    be given to.
    """
    labels, places, headings = _placed(sensors, times, still)
    # On a few numbers Python is faster than numpy, and small calls are common.
    numbers = places.ravel().tolist()
    if not isfinite(sum(numbers)):
        finite(places, "sensors")
    if len(labels) < least:
        raise InputError(
            f"sensors has {len(labels)} entries: registration needs {least} or more sensors"
        )
    ordered = () if isinstance(extras, tuple) and not extras else _ordered(extras)
    if (
        max(numbers) - min(numbers) > 1e100
        and (span := np.ptp(places.reshape(-1, places.shape[-1]), axis=0).max()) > 1e100
    ):
        raise InputError(f"sensors are {brief(span)} m apart: their squares overflow float64")
    d = places.shape[-1]
    if headings is not None and d == 3 and "attitude" in ordered:
        raise InputError(
            'extras has "attitude" with azimuths from the heading, in space: tilts are about east '
            "and north, and do not turn with a platform"
        )
    noise = np.ones(d) if sigma is None else as_float_array(sigma, "sigma")
    if noise.shape not in ((d,), (len(labels), d)):
        quantities = "range, azimuth" + (", elevation" if d == 3 else "")
        raise InputError(
            f"sigma has shape {noise.shape}: must be ({d},), {quantities} of every sensor, "
            f"or ({len(labels)}, {d}), one line for each sensor"
        )
    if noise.ndim == 1:
        noise = np.tile(noise, (len(labels), 1))
    return Setup(labels, places, noise, ordered, headings)


def _placed(
    sensors: SensorsLike, times: ArrayLike | None, still: str
) -> tuple[tuple[str, ...], Array, Array | None]:
    """Return names, places and headings of sensors."""
    # Small calls are common: what is an array is told first, which is quickest.
    named: Mapping[str, ArrayLike | Platform]
    if not isinstance(sensors, np.ndarray) and isinstance(sensors, Mapping):
        named = {str(key): place for key, place in sensors.items()}
    elif isinstance(sensors, (list, tuple)) and any(isinstance(p, Platform) for p in sensors):
        named = dict(zip(_letters(len(sensors)), sensors, strict=True))
    else:
        places = _stationary(as_float_array(sensors, "sensors"))  # type: ignore[arg-type]
        return _letters(len(places)), places, None
    still_ones = {
        key: as_float_array(place, f"sensors[{key!r}]")
        for key, place in named.items()
        if not isinstance(place, Platform)
    }
    labels = tuple(named)
    if len(still_ones) == len(named):
        return labels, _stationary(_stacked(still_ones)), None
    for key, place in still_ones.items():
        if place.ndim != 1:
            raise InputError(
                f"sensors[{key!r}] has shape {place.shape}: must be (2,), east and north, or (3,), "
                "east, north and up"
            )
    carried = {key: one for key, one in named.items() if isinstance(one, Platform)}
    return labels, *_platforms(labels, still_ones, carried, times, still)


def _stationary(places: Array) -> Array:
    if places.ndim != 2 or places.shape[1] not in (2, 3):
        raise InputError(
            f"sensors has shape {places.shape}: must be (N, 2), east and north, "
            "or (N, 3), east, north and up"
        )
    return places


def _letters(count: int) -> tuple[str, ...]:
    return LETTERS[:count] if count <= 26 else tuple(f"S{i + 1}" for i in range(count))


def _stacked(places: Mapping[str, Array], axis: int = 0) -> Array:
    if len({place.shape[-1:] if axis else place.shape for place in places.values()}) > 1:
        raise InputError(
            "sensors has places of different length: "
            + ", ".join(f"{key} {place.shape[axis:]}" for key, place in places.items())
        )
    return np.stack(list(places.values()), axis=axis) if places else np.zeros((0, 2))


def _platforms(
    labels: tuple[str, ...],
    places: dict[str, Array],
    platforms: dict[str, Platform],
    times: ArrayLike | None,
    still: str,
) -> tuple[Array, Array | None]:
    """Return places and headings of sensors some of which are platforms."""
    moving = [key for key, one in platforms.items() if one.moves]
    when = np.zeros(1)
    if moving:
        if still:
            raise InputError(f"{still} is for sensors that stand: sensors[{moving[0]!r}] moves")
        if times is None:
            raise InputError(
                f"sensors[{moving[0]!r}] moves: the times of the looks are missing; give times, "
                "or Reports(values, times)"
            )
        when = finite(times, "times")
        if when.ndim != 1 or not when.size:
            raise InputError(f"times has shape {when.shape}: must be (K,), one for each look")
    headings = dict.fromkeys(labels, np.zeros(()))
    for key, one in platforms.items():
        # Any time is as good as another for one that stands.
        at = when if one.moves else np.zeros(1)
        try:
            place = one.carrier.at(at)[0]
            heading = one.carrier.headings(at) if one.azimuths == "heading" else headings[key]
        except InputError as error:
            raise InputError(f"sensors[{key!r}]: {error}") from None
        places[key] = place if one.moves else place[0]
        headings[key] = heading if one.moves else heading.reshape(-1)[0]
    turned = any(one.azimuths == "heading" for one in platforms.values())
    north = np.stack(np.broadcast_arrays(*headings.values()), axis=-1) if turned else None
    if not moving:
        return _stacked({key: places[key] for key in labels}), north
    looks = {
        key: place if place.ndim == 2 else np.broadcast_to(place, (len(when), *place.shape))
        for key in labels
        for place in [places[key]]
    }
    return _stacked(looks, axis=1), north


def _ordered(extras: Sequence[Extra]) -> tuple[Extra, ...]:
    if isinstance(extras, str):
        raise InputError(
            f"extras is the string {extras!r}: must be a sequence such as ({extras!r},)"
        )
    for extra in options.names(extras, "extras"):
        if extra not in EXTRAS:
            raise InputError(f"extras has {extra!r}: must be of {', '.join(map(repr, EXTRAS))}")
    return tuple(extra for extra in EXTRAS if extra in extras)
