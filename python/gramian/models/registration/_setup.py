"""Sensors and the names of their biases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _options as options
from gramian._arrays import as_float_array, finite
from gramian._text import brief
from gramian._values import Value
from gramian.exceptions import InputError

Array = NDArray[np.float64]
Extra = Literal["gain", "position", "attitude"]
SensorsLike = ArrayLike | Mapping[str, ArrayLike]

EXTRAS: tuple[Extra, ...] = ("gain", "position", "attitude")
LETTERS = tuple("ABCDEFGHIJKLMNOPQRSTUVWXYZ")


@dataclass(frozen=True, eq=False)
class Setup(Value):
    """Checked sensors: names, places (N, d), deviations (N, d), further biases."""

    labels: tuple[str, ...]
    places: Array
    sigma: Array
    extras: tuple[Extra, ...]

    @property
    def d(self) -> int:
        """Number of coordinates."""
        return int(self.places.shape[1])

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
    sensors: SensorsLike, sigma: ArrayLike | None, extras: Sequence[Extra] = (), least: int = 2
) -> Setup:
    """Check sensors, `least` or more, and deviations; `sigma` None stands for deviations of 1."""
    # Small calls are common: what is an array is told first, which is quickest.
    if not isinstance(sensors, np.ndarray) and isinstance(sensors, Mapping):
        labels = tuple(str(key) for key in sensors)
        rows = [as_float_array(place, f"sensors[{key!r}]") for key, place in sensors.items()]
        if len({row.shape for row in rows}) > 1:
            raise InputError(
                "sensors has places of different length: "
                + ", ".join(f"{k} {r.shape}" for k, r in zip(labels, rows, strict=True))
            )
        places = np.array(rows)
    else:
        places = as_float_array(sensors, "sensors")
        count = places.shape[0] if places.ndim else 0
        labels = LETTERS[:count] if count <= 26 else tuple(f"S{i + 1}" for i in range(count))
    if places.ndim != 2 or places.shape[1] not in (2, 3):
        raise InputError(
            f"sensors has shape {places.shape}: must be (N, 2), east and north, "
            "or (N, 3), east, north and up"
        )
    # On a few numbers Python is faster than numpy, and small calls are common.
    numbers = places.ravel().tolist()
    if not isfinite(sum(numbers)):
        finite(places, "sensors")
    if len(places) < least:
        raise InputError(
            f"sensors has {len(places)} entries: registration needs {least} or more sensors"
        )
    ordered = () if isinstance(extras, tuple) and not extras else _ordered(extras)
    if (
        max(numbers) - min(numbers) > 1e100
        and (span := (places.max(axis=0) - places.min(axis=0)).max()) > 1e100
    ):
        raise InputError(f"sensors are {brief(span)} m apart: their squares overflow float64")
    d = places.shape[1]
    noise = np.ones(d) if sigma is None else as_float_array(sigma, "sigma")
    if noise.shape not in ((d,), (len(places), d)):
        quantities = "range, azimuth" + (", elevation" if d == 3 else "")
        raise InputError(
            f"sigma has shape {noise.shape}: must be ({d},), {quantities} of every sensor, "
            f"or ({len(places)}, {d}), one line for each sensor"
        )
    if noise.ndim == 1:
        noise = np.tile(noise, (len(places), 1))
    return Setup(labels, places, noise, ordered)


def _ordered(extras: Sequence[Extra]) -> tuple[Extra, ...]:
    if isinstance(extras, str):
        raise InputError(
            f"extras is the string {extras!r}: must be a sequence such as ({extras!r},)"
        )
    for extra in options.names(extras, "extras"):
        if extra not in EXTRAS:
            raise InputError(f"extras has {extra!r}: must be of {', '.join(map(repr, EXTRAS))}")
    return tuple(extra for extra in EXTRAS if extra in extras)
