"""One target, its sensors, and what is unknown about them: rows, values, simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._arrays import (
    SEED_MOST,
    above_rounding,
    as_float_array,
    finite,
    number,
    whole,
)
from gramian._options import given as shown
from gramian._options import instance, sequence
from gramian._units import labelled
from gramian._values import Value
from gramian.estimation import Channel
from gramian.exceptions import InputError
from gramian.models.tracks._motion import FARTHEST, Motion
from gramian.models.tracks._sensors import Sensor
from gramian.problem import Problem

__all__ = ["Scene", "problem", "rows", "simulate"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Scene(Value):
    """One target, sensors on carriers, and what is unknown about the sensors.

    Parameters
    ----------
    motion : Motion
        How the target moves.
    sensors : sequence of Sensor
        What sees it. Measurements are in this order, sample by sample.
    reference : float, optional
        Time from which the states of the motion count, seconds; by default that of the
        first sample.

    Raises
    ------
    InputError
        What does not fit, with the sensor it is about.

    Examples
    --------
    A ship that turns north watches a target at constant velocity; its compass is off by
    an unknown angle.

    >>> import gramian as gm, numpy as np
    >>> times = np.arange(0.0, 600.0, 20.0)
    >>> path = [[0, 0], [1500, 0], [1500, 1500]]
    >>> ship = gm.tracks.Carrier(path, [0.0, 300.0, 600.0])
    >>> bearings = gm.tracks.Sensor.bearing(ship, times, sigma=0.005, bias="compass")
    >>> scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), [bearings])
    >>> scene.names
    ('x0', 'y0', 'vx', 'vy', 'compass')
    """

    motion: Motion
    sensors: Sequence[Sensor]
    reference: float | None = None
    names: tuple[str, ...] = field(init=False)
    units: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        instance(self.motion, Motion, "motion", "a Motion")
        given = [self.sensors] if isinstance(self.sensors, Sensor) else self.sensors
        sensors = tuple(sequence(given, "sensors", "a Sensor, or a sequence of them"))
        if not sensors:
            raise InputError("sensors is empty: at least one must see the target")
        for i, sensor in enumerate(sensors):
            if not isinstance(sensor, Sensor):
                raise InputError(f"sensors[{i}] = {sensor!r}: must be a Sensor")
        first = min(float(sensor.times.min()) for sensor in sensors)
        reference = first if self.reference is None else number(self.reference, "reference [s]")
        names, units = list(self.motion.names), list(self.motion.units)
        for sensor in sensors:
            for name, unit in sensor.quantities():
                if name in self.motion.names:
                    raise InputError(
                        f"{sensor.name}: {name!r} is a state of the motion: choose another name"
                    )
                if name not in names:
                    names.append(name)
                    units.append(unit)
        self._check_legs(sensors)
        for key, value in (
            ("sensors", sensors),
            ("reference", reference),
            ("names", tuple(names)),
            ("units", tuple(units)),
        ):
            object.__setattr__(self, key, value)
        # Checks everything else.
        _ = self._inner

    @cached_property
    def _inner(self) -> _core.TrackScene:
        motion, reference = self.motion, self.origin
        own = self.names[len(motion.names) :]
        index = {name: k for k, name in enumerate(own)}
        return _core.TrackScene(
            motion.dimension,
            motion.kind,
            motion.order,
            None if motion.turns is None else [t - reference for t in motion.turns],
            motion.unknown_turns,
            reference,
            len(index),
            [sensor.inner(index) for sensor in self.sensors],
            [f"sensors[{i}] ({sensor.name})" for i, sensor in enumerate(self.sensors)],
        )

    def _check_legs(self, sensors: tuple[Sensor, ...]) -> None:
        turns = self.motion.turns
        if not turns:
            return
        times = np.concatenate([sensor.times for sensor in sensors])
        ends = (-np.inf, *turns, np.inf)
        for k in range(len(ends) - 1):
            if not ((times >= ends[k]) & (times < ends[k + 1])).any():
                raise InputError(
                    f"leg {k + 1}, from {ends[k]:g} to {ends[k + 1]:g} s, has no measurement"
                )

    @property
    def origin(self) -> float:
        """Time from which the states of the motion count, s."""
        return float(self.reference or 0.0)

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.names)

    @property
    def m(self) -> int:
        """Number of measured numbers."""
        return int(self._inner.measurements)

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Where the numbers of each sensor are."""
        ends = np.cumsum([0, *(s.count * s.width(self.motion.dimension) for s in self.sensors)])
        return tuple(slice(int(a), int(b)) for a, b in pairwise(ends))

    @cached_property
    def sigma(self) -> Array:
        """Standard deviation (m,) of each measured number."""
        dimension = self.motion.dimension
        return np.concatenate([sensor.deviations(dimension) for sensor in self.sensors])

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """A name for each sensor: its own, with its place where others have the same."""
        names = [sensor.name for sensor in self.sensors]
        return tuple(
            name if names.count(name) == 1 else f"{name} of sensors[{i}]"
            for i, name in enumerate(names)
        )

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """What each sensor reads as a channel.

        Not the target's own reports: receivers round them, and hold them at rest.
        """
        found = []
        for name, sensor, where in zip(self.labels, self.sensors, self.slices, strict=True):
            if sensor.kind not in ("position", "speed", "course"):
                found.append(Channel(name, np.arange(where.start, where.stop), sensor.times))
        return tuple(found)

    def with_motion(self, motion: Motion) -> Scene:
        """Return the same sensors on a target that moves otherwise."""
        return replace(self, motion=motion)

    def state(self, given: ArrayLike | Mapping[str, float]) -> Array:
        """Return a state as an array (..., n), from one or from values by name.

        Raises
        ------
        InputError
            For a name that is missing or is none of the states.
        """
        if isinstance(given, Mapping):
            for name in given:
                self.index(name)
            missing = [name for name in self.names if name not in given]
            if missing:
                raise InputError(f"state has no {', '.join(missing)}")
            given = [
                number(given[name], labelled(f"state[{name!r}]", unit))
                for name, unit in zip(self.names, self.units, strict=True)
            ]
        x = finite(given, "state")
        if x.ndim < 1 or x.shape[-1] != self.n:
            raise InputError(
                f"state has shape {x.shape}: must be (..., {self.n}), "
                f"one number for each of {', '.join(self.names)}"
            )
        if np.abs(x).max(initial=0.0) > FARTHEST:
            k = int(np.argmax(np.abs(x)) % self.n)
            raise InputError(
                f"state: {self.names[k]} = {np.ravel(x)[np.argmax(np.abs(x))]:g}: must be within "
                f"{FARTHEST:g}, or squares of distances overflow float64"
            )
        return x

    def index(self, name: str) -> int:
        """Return the place of a state.

        Raises
        ------
        InputError
            If there is no such state.
        """
        if not isinstance(name, str) or name not in self.names:
            raise InputError(
                f"no state is named {shown(name)}: the states are {', '.join(self.names)}"
            )
        return self.names.index(name)

    def values(self, state: ArrayLike | Mapping[str, float]) -> Array:
        """Return what the sensors read without noise, shape (..., m)."""
        values: Array = self._inner.values(self.state(state))
        return values

    def track(self, state: ArrayLike | Mapping[str, float], times: ArrayLike) -> Array:
        """Return positions of the target (k, D) at these times."""
        track = self._inner.track(self.state(state), times)
        return np.asarray(track[:, : self.motion.dimension])

    def pack(self, measurements: ArrayLike | Sequence[ArrayLike]) -> Array:
        """Return measurements as one array (..., m): NaN where a sample is missing.

        Parameters
        ----------
        measurements : sequence of array_like
            For each sensor its readings (..., samples), positions (..., samples, D); or
            an array (..., m) as `simulate` gives it.

        Raises
        ------
        InputError
            Shapes that do not fit; negative ranges; angles in degrees.
        """
        if isinstance(measurements, np.ndarray) and measurements.shape[-1:] == (self.m,):
            parts: list[ArrayLike] = []
            for sensor, where in zip(self.sensors, self.slices, strict=True):
                part = as_float_array(measurements, "measurements")[..., where]
                if sensor.kind == "position":
                    part = part.reshape(*part.shape[:-1], sensor.count, -1)
                parts.append(part)
        else:
            parts = sequence(measurements, "measurements", "readings for each sensor")
        if len(parts) != len(self.sensors):
            raise InputError(
                f"measurements has {len(parts)} entries: must have {len(self.sensors)}, "
                f"one for each sensor, or be an array (..., {self.m})"
            )
        flat = [
            sensor.checked(part, self.motion.dimension)
            for sensor, part in zip(self.sensors, parts, strict=True)
        ]
        try:
            lead = np.broadcast_shapes(*(part.shape[:-1] for part in flat))
        except ValueError:
            shapes = ", ".join(str(part.shape) for part in flat)
            raise InputError(f"leading axes of the measurements do not match: {shapes}") from None
        return np.concatenate(
            [np.broadcast_to(part, (*lead, part.shape[-1])) for part in flat], axis=-1
        )


def as_scene(scene: Scene) -> Scene:
    """Return a scene, and refuse what is none."""
    return instance(scene, Scene, "scene", "a Scene")


def rows(
    scene: Scene, state: ArrayLike | Mapping[str, float], *, out: Array | None = None
) -> Array:
    """Return the whitened rows of a scene at a state.

    Parameters
    ----------
    scene : Scene
    state : array_like, shape (..., n), or mapping
        One or several states, or one by names.
    out : ndarray, shape of the result, optional
        Where the result is written: float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

    Returns
    -------
    ndarray, shape (..., m, n)
        (d h / d x) / sigma; each by the root of its detection probability.

    Raises
    ------
    InputError
        Where a sensor reads nothing, or its reading has no derivative: a target on the
        carrier, a cone angle of 0 or pi.

    Examples
    --------
    >>> import gramian as gm
    >>> coast = gm.tracks.Carrier([0.0, 0.0])
    >>> sensor = gm.tracks.Sensor.range(coast, [0.0, 10.0], sigma=2.0)
    >>> scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), [sensor])
    >>> gm.tracks.rows(scene, [0.0, 1000.0, 5.0, 0.0]).shape
    (2, 4)
    """
    found: Array = as_scene(scene)._inner.rows(scene.state(state), out)
    return found


def problem(scene: Scene, state: ArrayLike | Mapping[str, float]) -> Problem:
    """Return the problem of a scene at a state: named rows, for `gm.analyze`.

    Parameters
    ----------
    scene : Scene
    state : array_like, shape (n,), or mapping
        Where the question is asked.

    Returns
    -------
    Problem
        Priors and knowledge are added by its methods `prior` and `fix`. Scales: for
        positions the range from the nearest carrier at the first time, for velocities that
        range over the time of the measurements; a bound above them is "weak".

    Raises
    ------
    InputError
        As `rows`.

    Examples
    --------
    A fixed observer cannot tell an error of its compass from a turn of the whole track.

    >>> import gramian as gm, numpy as np
    >>> coast = gm.tracks.Carrier([0.0, 0.0])
    >>> times = np.arange(0.0, 300.0, 10.0)
    >>> sensors = [
    ...     gm.tracks.Sensor.bearing(coast, times, sigma=0.01, bias="compass"),
    ...     gm.tracks.Sensor.range(coast, times, sigma=10.0),
    ... ]
    >>> scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), sensors)
    >>> state = {"x0": 4000.0, "y0": 3000.0, "vx": -5.0, "vy": 2.0, "compass": 0.0}
    >>> gm.analyze(gm.tracks.problem(scene, state)).nullity
    1
    """
    x = as_scene(scene).state(state)
    if x.ndim != 1:
        raise InputError(f"state has shape {x.shape}: must be ({scene.n},), one state")
    values, rtol = above_rounding(rows(scene, x), scene._inner.rounding(x))
    made = Problem(values, scene.names, units=scene.units, scale=_scales(scene, x), rtol=rtol)
    return made._of("tracks", scene, x)


def _scales(scene: Scene, x: Array) -> Array:
    """Return the range for positions, and over powers of the time; NaN for other states."""
    dimension = scene.motion.dimension
    times = np.concatenate([sensor.times for sensor in scene.sensors])
    ranges = []
    for sensor in scene.sensors:
        for carrier in (sensor.carrier, sensor.second):
            if carrier is not None:
                place = carrier.at(sensor.times[:1])[0][0]
                size = min(dimension, len(place))
                ranges.append(float(np.linalg.norm(x[:size] - place[:size])))
    scales = np.full(scene.n, np.nan)
    reach, span = min(ranges, default=np.nan), float(np.ptp(times))
    powers = {"m": 0, "m/s": 1, "m/s^2": 2, "m/s^3": 3}
    for i, unit in enumerate(scene.motion.units):
        power = powers.get(unit)
        if power is not None and reach > 0 and (span > 0 or power == 0):
            scales[i] = reach / span**power
    usable: Array = np.where(np.isfinite(scales) & (scales > 0), scales, np.nan)
    return usable


def simulate(
    scene: Scene,
    state: ArrayLike | Mapping[str, float],
    *,
    trials: int | None = None,
    seed: int = 0,
    first: int = 0,
) -> Array:
    """Return measurements with noise.

    Parameters
    ----------
    scene : Scene
    state : array_like, shape (n,), or mapping
        The true state.
    trials : int, optional
        How many trials; by default one, without a leading axis.
    seed, first : int
        Trial i is that of (seed, first + i) alone.

    Returns
    -------
    ndarray, shape (m,) or (trials, m)
        In the order of the sensors; NaN where a sample is not detected.

    Raises
    ------
    InputError
        As `rows`.

    Examples
    --------
    >>> import gramian as gm
    >>> coast = gm.tracks.Carrier([0.0, 0.0])
    >>> sensor = gm.tracks.Sensor.range(coast, [0.0, 10.0], sigma=2.0)
    >>> scene = gm.tracks.Scene(gm.tracks.Motion.fixed(), [sensor])
    >>> gm.tracks.simulate(scene, [0.0, 1000.0], trials=3, seed=1).shape
    (3, 2)
    """
    count = 1 if trials is None else whole(trials, "trials", 1)
    seed = whole(seed, "seed", 0, SEED_MOST)
    first = whole(first, "first", 0, SEED_MOST)
    x = as_scene(scene).state(state)
    if x.ndim != 1:
        raise InputError(f"state has shape {x.shape}: must be ({scene.n},), one state")
    found: Array = scene._inner.simulate(x, seed, first, count)
    return found[0] if trials is None else found
