"""How a target moves, and where carriers are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._arrays import finite, number, whole
from gramian._options import choice, flag, given
from gramian._values import Value
from gramian.exceptions import InputError

__all__ = ["Carrier", "Motion"]

Array = NDArray[np.float64]

#: Metres: squares of what is farther overflow.
FARTHEST = 1e150

_AXES = ("x", "y", "z")
_ORDERS = ("v", "a", "j")


@dataclass(frozen=True)
class Motion(Value):
    """How a target moves: made by its class methods.

    Positions are east, north (and up) in metres, courses clockwise from north in
    radians, times in seconds. The states count from a reference time, by default that
    of the first measurement.

    Attributes
    ----------
    kind : str
        "polynomial", "legs", "steady_legs" or "coordinated_turn".
    dimension : int
        2 or 3.
    order : int
        Of a polynomial.
    turns : tuple of float, or None
        Known times of turns, in the time of the measurements; None where they are states.
    unknown_turns : int
        How many turns have unknown times.

    Examples
    --------
    >>> import gramian as gm
    >>> gm.tracks.Motion.legs(count=2).names
    ('x0', 'y0', 'vx_1', 'vy_1', 'vx_2', 'vy_2', 'turn_1')
    """

    kind: str
    dimension: int = 2
    order: int = 0
    turns: tuple[float, ...] | None = None
    unknown_turns: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "dimension", choice(self.dimension, "dimension", (2, 3)))

    @classmethod
    def fixed(cls, *, dimension: int = 2) -> Motion:
        """Return a target at rest."""
        return cls("polynomial", dimension, 0)

    @classmethod
    def constant_velocity(cls, *, dimension: int = 2) -> Motion:
        """Return a target at constant velocity."""
        return cls("polynomial", dimension, 1)

    @classmethod
    def constant_acceleration(cls, *, dimension: int = 2) -> Motion:
        """Return a target at constant acceleration."""
        return cls("polynomial", dimension, 2)

    @classmethod
    def polynomial(cls, order: int, *, dimension: int = 2) -> Motion:
        """Return a target whose position is a polynomial in time of this order, 0 to 6."""
        return cls("polynomial", dimension, whole(order, "order", 0, 6))

    @classmethod
    def legs(
        cls,
        turns: ArrayLike | None = None,
        *,
        count: int | None = None,
        constant_speed: bool = False,
        dimension: int = 2,
    ) -> Motion:
        """Return a target on legs of constant velocity.

        Parameters
        ----------
        turns : array_like, optional
            Known times of the turns, increasing, seconds.
        count : int, optional
            Instead, how many legs, 1 to 5: the times of the turns are states.
        constant_speed : bool
            One speed on all legs, as a ship: the states are then the speed and a
            course for each leg.
        dimension : int
            2 or 3.
        """
        if (turns is None) == (count is None):
            raise InputError("legs takes the times of the turns, or the count of legs")
        kind = "steady_legs" if flag(constant_speed, "constant_speed") else "legs"
        if turns is not None:
            times = np.atleast_1d(finite(turns, "turns"))
            if times.ndim != 1 or (np.diff(times) <= 0).any():
                raise InputError(f"turns = {times.tolist()}: must be increasing times")
            return cls(kind, dimension, 0, tuple(times.tolist()), 0)
        legs = whole(count, "count", 1, 5)
        return cls(kind, dimension, 0, None, legs - 1)

    @classmethod
    def coordinated_turn(cls, *, dimension: int = 2) -> Motion:
        """Return a target that turns at constant speed and rate."""
        return cls("coordinated_turn", dimension)

    @property
    def count(self) -> int:
        """Number of legs."""
        return 1 + (self.unknown_turns if self.turns is None else len(self.turns))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        axes = _AXES[: self.dimension]
        names = [f"{axis}0" for axis in axes]
        if self.kind == "polynomial":
            for k in range(1, self.order + 1):
                letter = _ORDERS[k - 1] if k <= len(_ORDERS) else f"d{k}"
                names += [f"{letter}{axis}" for axis in axes]
            return tuple(names)
        if self.kind == "coordinated_turn":
            names += ["speed", "course", "turn_rate"]
        elif self.kind == "steady_legs":
            names += ["speed", *(f"course_{k}" for k in range(1, self.count + 1))]
        else:
            names += [f"v{axis}_{k}" for k in range(1, self.count + 1) for axis in axes]
        if self.dimension == 3 and self.kind != "legs":
            names.append("vz")
        return (*names, *(f"turn_{k}" for k in range(1, self.unknown_turns + 1)))

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the states."""
        return tuple(_unit(name) for name in self.names)


def _unit(name: str) -> str:
    if name in ("x0", "y0", "z0"):
        return "m"
    if name == "turn_rate":
        return "rad/s"
    if name.startswith("course"):
        return "rad"
    if name.startswith("turn"):
        return "s"
    if name[0] == "d" and name[1].isdigit():
        return f"m/s^{name[1]}"
    return {"a": "m/s^2", "j": "m/s^3"}.get(name[0], "m/s")


@dataclass(frozen=True, eq=False)
class Carrier(Value):
    """Where a sensor is: a path with times, straight in between, or a fixed place.

    Parameters
    ----------
    path : array_like, shape (m, D) or (D,)
        Positions (east, north, and up), metres; one position for a fixed place.
    times : array_like, shape (m,), optional
        Increasing, seconds; not for a fixed place.
    velocity : array_like, shape (m, D), optional
        Metres per second; by default the slope of the path, at a corner that over both
        pieces.
    heading : array_like, shape (m,), or float for a fixed place, optional
        Direction of the axis of a towed array, clockwise from north, radians; by default
        that of the velocity.
    name : str
        In messages and pictures.

    Raises
    ------
    InputError
        Shapes or times that do not fit.

    Examples
    --------
    >>> import gramian as gm
    >>> ship = gm.tracks.Carrier([[0, 0], [0, 500], [500, 500]], [0, 100, 200])
    >>> ship.at([50.0])[0].tolist()
    [[0.0, 250.0]]
    """

    path: ArrayLike
    times: ArrayLike | None = None
    velocity: ArrayLike | None = None
    heading: ArrayLike | float | None = None
    name: str = "carrier"

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise InputError(f"name = {given(self.name)}: must be a string")
        path = finite(self.path, "path")
        if path.ndim != (1 if self.times is None else 2) or path.shape[-1] not in (2, 3):
            wanted = "(2,) or (3,)" if self.times is None else "(m, 2) or (m, 3)"
            raise InputError(f"path of {self.name} has shape {path.shape}: must be {wanted}")
        times = None
        if self.times is not None:
            times = finite(self.times, "times")
            if times.shape != (len(path),):
                raise InputError(
                    f"times of {self.name} has shape {times.shape}: must be ({len(path)},), "
                    "one for each position of the path"
                )
        if np.abs(path).max(initial=0.0) > FARTHEST:
            raise InputError(
                f"path of {self.name} is farther than {FARTHEST:g} m from the origin: squares of "
                "distances overflow float64"
            )
        object.__setattr__(self, "path", path)
        object.__setattr__(self, "times", times)
        # Checks everything else.
        _ = self._inner

    @cached_property
    def _inner(self) -> _core.TrackCarrier:
        heading = self.heading
        if heading is not None and self.times is None:
            heading = number(heading, "heading")
        try:
            return _core.TrackCarrier(self.path, self.times, self.velocity, heading)
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from None

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return int(np.shape(self.path)[-1])

    def at(self, times: ArrayLike) -> tuple[Array, Array]:
        """Return positions and velocities (m, D) at these times.

        Raises
        ------
        InputError
            For a time outside the path.
        """
        place, velocity = self._inner.at(times)
        return place, velocity

    def headings(self, times: ArrayLike) -> Array:
        """Return headings (m,) at these times, clockwise from north, radians.

        Raises
        ------
        InputError
            For a time outside the path, or where no heading is given and the carrier rests.
        """
        return self._inner.headings(times)
