"""What sensors see, when, how accurately, and what is unknown about them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian._arrays import as_float_array, finite, number
from gramian._values import Value
from gramian.exceptions import InputError
from gramian.models.tracks._motion import Carrier

__all__ = ["Sensor"]

Array = NDArray[np.float64]

#: Unit of each kind, and those that are angles.
UNITS = {
    "bearing": "rad",
    "elevation": "rad",
    "range": "m",
    "range_rate": "m/s",
    "frequency": "Hz",
    "time_difference": "s",
    "frequency_difference": "Hz",
    "cone_angle": "rad",
    "signal_strength": "dB",
    "position": "m",
    "speed": "m/s",
    "course": "rad",
}

#: Readings may be so many standard deviations beyond what is possible without noise.
_NOISE = 5.0

#: Unknown or fixed: the name of a state, or a value.
Quantity = str | float | None


@dataclass(frozen=True, eq=False)
class Sensor(Value):
    """A sensor with the times of its samples: made by the method of its kind.

    Each method takes ``times`` (m,), seconds, and of

    ``sigma``
        standard deviation in the unit of the kind: one, or (m,)
    ``covariance``
        instead: (m, m), or for positions (D, D), the same each time
    ``correlation_time``
        seconds: Gauss-Markov noise, correlation exp(-dt / time)
    ``bias``
        added to the reading: the name of a state, or a value
    ``scale``
        the reading is multiplied by 1 + scale: likewise
    ``clock``
        stamp less true time, seconds: likewise
    ``true_path``
        whether the carrier's path has the true time, not the same stamps
    ``delay``
        speed of the wave, m/s: the target is seen where it was
    ``detection``
        probability of a sample, (0, 1]: for bounds and simulation
    ``mask``
        (m,) of bool: samples that count
    ``name``
        in messages; by default the kind

    Sensors that give the same name to something unknown share one state: the heading
    error of a ship is a bias of all its bearings.

    Examples
    --------
    >>> import gramian as gm
    >>> coast = gm.tracks.Carrier([0.0, 0.0])
    >>> sensor = gm.tracks.Sensor.bearing(coast, [0, 10, 20], sigma=0.01, bias="compass")
    >>> sensor.count
    3
    """

    kind: str
    times: Array
    carrier: Carrier | None = None
    second: Carrier | None = None
    sigma: Array | None = None
    covariance: Array | None = None
    correlation_time: float | None = None
    bias: tuple[tuple[float, Quantity], ...] = ()
    scale: Quantity = None
    clock: Quantity = None
    true_path: bool = False
    delay: float | None = None
    detection: Array = field(default_factory=lambda: np.ones(1))
    mask: NDArray[np.bool_] | None = None
    speed: float | None = None
    parameters: tuple[Quantity, Quantity] = (None, None)
    name: str = ""

    @classmethod
    def bearing(cls, carrier: Carrier, times: ArrayLike, **noise: Any) -> Sensor:
        """Return a sensor of horizontal angles clockwise from north, radians."""
        return _made("bearing", times, noise, carrier=carrier)

    @classmethod
    def elevation(cls, carrier: Carrier, times: ArrayLike, **noise: Any) -> Sensor:
        """Return a sensor of angles above the horizontal, radians; in 3 dimensions."""
        return _made("elevation", times, noise, carrier=carrier)

    @classmethod
    def range(cls, carrier: Carrier, times: ArrayLike, **noise: Any) -> Sensor:
        """Return a sensor of distances, metres."""
        return _made("range", times, noise, carrier=carrier)

    @classmethod
    def range_rate(cls, carrier: Carrier, times: ArrayLike, **noise: Any) -> Sensor:
        """Return a sensor of the rate of the distance, metres per second."""
        return _made("range_rate", times, noise, carrier=carrier)

    @classmethod
    def frequency(
        cls,
        carrier: Carrier,
        times: ArrayLike,
        *,
        speed: float,
        tonal: str | float = "tonal",
        **noise: Any,
    ) -> Sensor:
        """Return a sensor of the received frequency of a tonal, Hz.

        Parameters
        ----------
        carrier : Carrier
        times : array_like, shape (m,)
        speed : float
            Of the wave, m/s.
        tonal : str or float
            The emitted frequency: the name of a state, or its value in Hz.
        **noise
            See `Sensor`.
        """
        return _made(
            "frequency", times, noise, carrier=carrier, speed=speed, parameters=(tonal, 0.0)
        )

    @classmethod
    def time_difference(
        cls,
        carrier: Carrier,
        second: Carrier,
        times: ArrayLike,
        *,
        speed: float,
        clocks: tuple[Quantity, Quantity] = (None, None),
        **noise: Any,
    ) -> Sensor:
        """Return a sensor of the arrival at one carrier less that at another, seconds.

        Parameters
        ----------
        carrier, second : Carrier
        times : array_like, shape (m,)
        speed : float
            Of the wave, m/s.
        clocks : pair of str or float
            Clock offsets of both, seconds: names of states, or values.
        **noise
            See `Sensor`.
        """
        made = _made("time_difference", times, noise, carrier=carrier, second=second, speed=speed)
        extra = tuple((sign, c) for sign, c in zip((1.0, -1.0), clocks, strict=True))
        return replace(made, bias=made.bias + tuple(e for e in extra if e[1] is not None))

    @classmethod
    def frequency_difference(
        cls,
        carrier: Carrier,
        second: Carrier,
        times: ArrayLike,
        *,
        speed: float,
        tonal: str | float = "tonal",
        **noise: Any,
    ) -> Sensor:
        """Return a sensor of the frequency at one carrier less that at another, Hz."""
        return _made(
            "frequency_difference",
            times,
            noise,
            carrier=carrier,
            second=second,
            speed=speed,
            parameters=(tonal, 0.0),
        )

    @classmethod
    def cone_angle(cls, carrier: Carrier, times: ArrayLike, **noise: Any) -> Sensor:
        """Return a towed array: angles from the carrier's heading, in (0, pi) radians."""
        return _made("cone_angle", times, noise, carrier=carrier)

    @classmethod
    def signal_strength(
        cls,
        carrier: Carrier,
        times: ArrayLike,
        *,
        power: str | float = "power",
        exponent: str | float = 2.0,
        **noise: Any,
    ) -> Sensor:
        """Return a sensor of power by distance, dB: power - 10 exponent log10(range / 1 m)."""
        return _made("signal_strength", times, noise, carrier=carrier, parameters=(power, exponent))

    @classmethod
    def position(cls, times: ArrayLike, **noise: Any) -> Sensor:
        """Return reports of the target's own position (GNSS, AIS), metres."""
        return _made("position", times, noise)

    @classmethod
    def target_speed(cls, times: ArrayLike, **noise: Any) -> Sensor:
        """Return reports of the target's own speed, metres per second."""
        return _made("speed", times, noise)

    @classmethod
    def course(cls, times: ArrayLike, **noise: Any) -> Sensor:
        """Return reports of the target's own course, clockwise from north, radians."""
        return _made("course", times, noise)

    @property
    def count(self) -> int:
        """Number of samples that count."""
        return int(self.times.size)

    @property
    def unit(self) -> str:
        """Unit of the readings."""
        return UNITS[self.kind]

    def width(self, dimension: int) -> int:
        """Return the numbers of a sample."""
        return dimension if self.kind == "position" else 1

    def deviations(self, dimension: int) -> Array:
        """Return the standard deviation of each number that is read, one behind the other."""
        width = self.width(dimension)
        if self.covariance is not None:
            variances = np.diag(self.covariance)
            return np.resize(np.sqrt(variances), self.count * width)
        given = np.broadcast_to(np.asarray(self.sigma, dtype=float), (self.count,))
        return np.repeat(given, width)

    def quantities(self) -> list[tuple[str, str]]:
        """Return the names of what is unknown, with units."""
        found = [(q, self.unit) for _, q in self.bias if isinstance(q, str)]
        if isinstance(self.scale, str):
            found.append((self.scale, ""))
        if isinstance(self.clock, str):
            found.append((self.clock, "s"))
        units = ("dB", "") if self.kind == "signal_strength" else ("Hz", "")
        for quantity, unit in zip(self.parameters, units, strict=True):
            if isinstance(quantity, str):
                found.append((quantity, unit))
        return found

    def inner(self, index: Mapping[str, int]) -> dict[str, Any]:
        """Return what the extension takes; `index` numbers the unknown quantities."""

        def number(quantity: Quantity, default: float = 0.0) -> int | float:
            if isinstance(quantity, str):
                return index[quantity]
            return default if quantity is None else float(quantity)

        return {
            "kind": self.kind,
            "speed": self.speed,
            "times": self.times,
            "carrier": None if self.carrier is None else self.carrier._inner,
            "second": None if self.second is None else self.second._inner,
            "sigma": self.sigma,
            "covariance": self.covariance,
            "correlation_time": self.correlation_time,
            "bias": [(factor, number(quantity)) for factor, quantity in self.bias],
            "scale": number(self.scale),
            "clock": number(self.clock),
            "true_path": self.true_path,
            "delay": self.delay,
            "detection": self.detection,
            "parameters": (number(self.parameters[0]), number(self.parameters[1])),
        }

    def checked(self, readings: ArrayLike, dimension: int) -> Array:
        """Return readings (..., m) as they go into an estimate, flat for each trial.

        NaN is a missing sample. Readings of all samples or of those that the mask
        leaves are taken.

        Raises
        ------
        InputError
            For shapes that do not fit, negative ranges, angles in degrees.
        """
        z = as_float_array(readings, f"{self.name} [{self.unit}]")
        width = self.width(dimension)
        core = (dimension,) if width > 1 else ()
        lead = z.ndim - 1 - len(core)
        if lead < 0 or z.shape[lead + 1 :] != core:
            shape = f"(..., {self.count}, {dimension})" if core else f"(..., {self.count})"
            raise InputError(f"{self.name} has shape {z.shape}: must be {shape}")
        if self.mask is not None and z.shape[lead] == self.mask.size:
            z = np.compress(self.mask, z, axis=lead)
        if z.shape[lead] != self.count:
            raise InputError(
                f"{self.name} has {z.shape[lead]} samples: must have {self.count}, "
                "one for each of its times"
            )
        self._plausible(z, dimension)
        return z.reshape(*z.shape[:lead], -1)

    def _plausible(self, z: Array, dimension: int) -> None:
        def named(bad: NDArray[np.bool_], what: str) -> None:
            if bad.any():
                place = tuple(np.argwhere(bad)[0])
                text = ", ".join(str(int(i)) for i in place)
                raise InputError(f"{self.name}[{text}] = {z[place]} {self.unit}: {what}")

        named(np.isinf(z), "must be finite, or NaN for a missing sample")
        if self.kind != "range" and self.unit != "rad":
            return
        # Noise takes readings beyond their ends.
        slack = _NOISE * self.deviations(dimension)
        if self.kind == "range":
            named(z < -slack, "must not be negative")
            return
        named(np.abs(z) > 2 * np.pi, "beyond +-2 pi: angles are in radians; are these degrees?")
        if self.kind == "cone_angle":
            named((z < -slack) | (z > np.pi + slack), "must be between 0 and pi, from the heading")
        given = z[~np.isnan(z)]
        # Whole numbers, and several of them, are no radians.
        if (given == np.round(given)).all() and np.unique(given).size > 3:
            warnings.warn(
                f"{self.name}: all are whole numbers from {given.min():g} to {given.max():g}: "
                "angles are in radians; are these degrees?",
                stacklevel=4,
            )


def _made(
    kind: str,
    times: ArrayLike,
    noise: dict[str, Any],
    *,
    carrier: Carrier | None = None,
    second: Carrier | None = None,
    speed: float | None = None,
    parameters: tuple[Quantity, Quantity] = (None, None),
) -> Sensor:
    allowed = {
        *("sigma", "covariance", "correlation_time", "bias", "scale", "clock", "true_path"),
        *("delay", "detection", "mask", "name"),
    }
    for key in noise:
        if key not in allowed:
            raise InputError(
                f"{kind} has no argument {key!r}: it takes {', '.join(sorted(allowed))}"
            )
    name = str(noise.get("name") or kind)
    for given in (carrier, second):
        if given is not None and not isinstance(given, Carrier):
            raise InputError(f"{name}: {given!r} is no Carrier")
    stamps = finite(times, f"{name}: times")
    if stamps.ndim != 1 or not stamps.size:
        raise InputError(f"{name}: times has shape {stamps.shape}: must be (m,), not empty")
    sigma, covariance = noise.get("sigma"), noise.get("covariance")
    if (sigma is None) == (covariance is None):
        raise InputError(f"{name}: give sigma, or covariance")
    detection = np.atleast_1d(finite(noise.get("detection", 1.0), f"{name}: detection"))
    unit = UNITS[kind]
    sigma = None if sigma is None else np.atleast_1d(finite(sigma, f"{name}: sigma [{unit}]"))
    covariance = None if covariance is None else finite(covariance, f"{name}: covariance")
    mask = _mask(noise.get("mask"), stamps, name)
    if mask is not None:
        if covariance is not None and len(covariance) == stamps.size:
            covariance = covariance[np.ix_(mask, mask)]
        if sigma is not None and len(sigma) == stamps.size > 1:
            sigma = sigma[mask]
        if detection.size == stamps.size:
            detection = detection[mask]
        stamps = stamps[mask]

    def plain(value: Any, key: str, unit: str) -> Any:
        if value is None or isinstance(value, str):
            return value
        return number(value, f"{name}: {key} [{unit}]")

    bias = plain(noise.get("bias"), "bias", unit)
    first = "dB" if kind == "signal_strength" else "Hz"
    return Sensor(
        kind=kind,
        times=stamps,
        carrier=carrier,
        second=second,
        sigma=sigma,
        covariance=None if covariance is None else finite(covariance, f"{name}: covariance"),
        correlation_time=plain(noise.get("correlation_time"), "correlation_time", "s"),
        bias=() if bias is None else ((1.0, bias),),
        scale=plain(noise.get("scale"), "scale", "-"),
        clock=plain(noise.get("clock"), "clock", "s"),
        true_path=bool(noise.get("true_path", False)),
        delay=plain(noise.get("delay"), "delay", "m/s"),
        detection=detection,
        mask=mask,
        speed=plain(speed, "speed", "m/s"),
        parameters=(
            plain(parameters[0], "the first parameter", first),
            plain(parameters[1], "the second parameter", "-"),
        ),
        name=name,
    )


def _mask(given: Any, stamps: Array, name: str) -> NDArray[np.bool_] | None:
    if given is None:
        return None
    mask = np.asarray(given)
    if mask.dtype != bool or mask.shape != stamps.shape:
        raise InputError(f"{name}: mask has shape {mask.shape}: must be bool {stamps.shape}")
    if not mask.any():
        raise InputError(f"{name}: mask leaves no sample")
    return mask
