"""The record of a pass as a model, for everything that is asked of an estimate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._arrays import finite
from gramian._values import Value
from gramian.estimation import Channel, channel_faults
from gramian.models.dipole._model import MU0, NAMES

__all__ = ["KNOWABLE", "PARTS", "PLAIN", "Description", "DipoleModel", "Heads"]

Array = NDArray[np.float64]

#: What may be known: the states, the speed (m/s) and the moment's size (A m^2).
KNOWABLE = (*NAMES, "speed", "moment")

#: Sizes of vectors, and where those are in the state.
PARTS = {"speed": slice(3, 6), "moment": slice(6, 9)}

#: Of a further dipole: its offset from the first, and its moment.
PLACED = ("dx", "dy", "dz", "mx", "my", "mz")


@dataclass(frozen=True)
class Description(Value):
    """What a record is explained by, beside one dipole on a straight pass.

    Attributes
    ----------
    motion : str
        "straight"; "along", a constant acceleration along the track; "accelerated", a constant
        one in any direction; "turning", at a constant rate about z, clockwise seen from above,
        the dipoles with the body.
    sources : int
        Dipoles of the body, 1 to 4; those after the first at an offset from it.
    quadrupole : bool
        Whether it has a quadrupole too, at the place of the first dipole, which turns with the
        body. Where a component of this place has neither a value nor a prior, it is the
        centre's, about which the quadrupole Q has no part along the moment, (Q m)_i = 0: of
        its five numbers one less is a state then.
    drift : bool
        Whether a drift of each channel, linear in time, is fitted beside its constant.
    attitude, scale : float or None
        Standard deviations of the attitude (rad) and the scale of each sensor, states then;
        None where they are exact.
    earth_field : tuple of float or None
        The ambient field, T, where the body has a moment too that this induces: the state
        "induced volume", m^3, times it over the vacuum permeability.
    """

    motion: str = "straight"
    sources: int = 1
    quadrupole: bool = False
    drift: bool = False
    attitude: float | None = None
    scale: float | None = None
    earth_field: tuple[float, float, float] | None = None

    def __str__(self) -> str:
        """Return the description in words."""
        dipoles = "1 dipole" if self.sources == 1 else f"{self.sources} dipoles"
        dipoles += " with a quadrupole" if self.quadrupole else ""
        induced = "" if self.earth_field is None else ", with an induced moment"
        return f"{dipoles}, {self.motion}{induced}"


#: One dipole on a straight pass.
PLAIN = Description()


@dataclass(frozen=True)
class Heads:
    """Sensors as the extension takes them."""

    places: list[list[float]]
    baselines: list[list[float]]
    ambient: tuple[float, float, float] | None

    @classmethod
    def of(
        cls,
        sensors: Array,
        baselines: Array | None,
        ambient: tuple[float, float, float] | None,
    ) -> Heads:
        """Return sensors (S, 3), with their baselines where they are gradiometers."""
        return cls(sensors.tolist(), [] if baselines is None else baselines.tolist(), ambient)

    @property
    def components(self) -> int:
        """Numbers of one sample of one sensor."""
        return 3 if self.ambient is None else 1

    @property
    def axes(self) -> str:
        """Letters of the components."""
        return "xyz" if self.ambient is None else "F"

    @property
    def quiet(self) -> float:
        """The reading without a dipole, T."""
        if self.ambient is None or self.baselines:
            return 0.0
        return float(np.linalg.norm(self.ambient))


@dataclass(frozen=True, eq=False)
class DipoleModel(Value):
    """The fields of a pass at one or more sensors.

    Its states are those of (r0, v, m) that are not known, and with `background` a constant
    of each channel. A vector of known size is described by angles: "v from z", the angle from an
    axis, and "v about z", the one about it.

    Attributes
    ----------
    times : ndarray, shape (K,)
        Seconds since the instant of the state.
    sensors : ndarray, shape (S, 3)
        Metres.
    weights : ndarray, shape (K, S, 3), or (K, S, 1) of the total field
        1 / sigma of each number of the field, 1/T; 0 for one that does not count.
    near : ndarray, shape (9,)
        A pass near the one looked for: it settles from which axis angles count.
    known : mapping of str to float
    prior : mapping of str to (mean, sigma)
    background : bool
        Whether a constant of each channel is among the states.
    correlation : float
        Of the noise of neighbouring samples of a channel, from 0 to below 1.
    spacing : float
        The time between neighbours of which it is told, s.
    description : Description
        What there is beside one dipole on a straight pass.
    baselines : ndarray, shape (S, 3), or None
        Of gradiometers: from each sensor to its second head, metres.
    ambient : tuple of float, or None
        Of sensors of the total field: the field without the dipole, tesla.
    """

    times: Array
    sensors: Array
    weights: Array
    near: Array
    known: Mapping[str, float]
    prior: Mapping[str, tuple[float, float]]
    background: bool = False
    correlation: float = 0.0
    spacing: float = 1.0
    description: Description = PLAIN
    baselines: Array | None = None
    ambient: tuple[float, float, float] | None = None

    @property
    def heads(self) -> Heads:
        """The sensors as the extension takes them."""
        return Heads.of(self.sensors, self.baselines, self.ambient)

    def record(self, z: ArrayLike) -> _core.DipoleRecord:
        """Return the extension's record of these fields, (K, S, components) or flat, tesla."""
        plain = _core.DipoleRecord(
            self.times,
            finite(z, "field").reshape(self.weights.shape),
            self.heads,
            self.weights,
            self.background,
            [self.known.get(name, np.nan) for name in KNOWABLE],
            [list(self.prior.get(name, (np.nan, np.nan))) for name in KNOWABLE],
            self.near.tolist(),
            self.correlation,
            self.spacing,
        )
        about = self.description
        if about == PLAIN:
            return plain
        induced = None
        if about.earth_field is not None:
            x, y, z = (component / MU0 for component in about.earth_field)
            induced = (x, y, z)
        x, y, z = (name not in self.known and name not in self.prior for name in NAMES[:3])
        return plain.described(
            about.motion,
            about.sources,
            (x, y, z) if about.quadrupole else None,
            about.drift,
            about.attitude,
            about.scale,
            induced,
        )

    @cached_property
    def _blank(self) -> _core.DipoleRecord:
        return self.record(np.zeros(self.weights.shape))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return tuple(self._blank.names)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the states."""
        return tuple(self._blank.units)

    @property
    def x(self) -> Array:
        """The states of the pass near the one looked for."""
        return self._blank.coordinates(self.near.tolist())

    @property
    def used(self) -> NDArray[np.bool_]:
        """Which channels (components S,) count."""
        used: NDArray[np.bool_] = (self.weights > 0).any(axis=0).ravel()
        return used

    @property
    def judged(self) -> tuple[str, ...]:
        """Names of the functions whose intervals make an answer weak."""
        return ("range",)

    @property
    def functions(self) -> dict[str, tuple[Callable[[Array], tuple[float, Array]], str]]:
        """The range at the closest point, seen from the first sensor, sizes, components.

        Of several dipoles: the size of the sum of their moments, and the range of their
        centre, about which this sum has no moment along itself.
        """
        found: dict[str, tuple[Callable[[Array], tuple[float, Array]], str]]
        near: Callable[[Array], tuple[float, Array]]
        if self.description.motion == "straight" and self.description.sources == 1:
            near = _Of(self._blank, _Closest(self.sensors[0]))
        else:
            near = _Nearest(self)
        found = {"range": (near, "m")}
        if "speed" not in self.known:
            found["speed"] = (_Of(self._blank, _Size(PARTS["speed"])), "m/s")
        if self.description.sources > 1:
            found["moment"] = (_Total(self), "A m^2")
        elif "moment" not in self.known:
            found["moment"] = (_Of(self._blank, _Size(PARTS["moment"])), "A m^2")
        own = self.names
        for index, name in enumerate(NAMES):
            if name not in own and name not in self.known:
                unit = "m/s" if name[0] == "v" else "A m^2"
                found[name] = (_Of(self._blank, _Component(index)), unit)
        return found

    def expand(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return the pass (9,) of states (n,), and its derivatives (9, n)."""
        return self._blank.expand(x)

    def bodies(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return place from the first dipole (m) and moment (A m^2) of each.

        Shape (sources, 6), with the derivatives (sources, 6, n) by the states; the moment that
        is induced is not in it.
        """
        state = finite(x, "x")
        full, by = self._blank.expand(state)
        count, names = self.description.sources, self.names
        values, columns = np.zeros((count, 6)), np.zeros((count, 6, state.size))
        values[0, 3:], columns[0, 3:] = full[6:], by[6:]
        for k in range(1, count):
            for i, part in enumerate(PLACED):
                j = names.index(f"{part} of dipole {k + 1}")
                values[k, i], columns[k, i, j] = state[j], 1.0
        return values, columns

    def reordered(self, x: Array, order: Sequence[int]) -> Array:
        """Return states (n,) of the same body with its dipoles in another order.

        What is known of r0 and m remains that of the first, and the body is then another.
        """
        bodies = self.bodies(x)[0][list(order)]
        first = self.expand(x)[0]
        first[:3] += bodies[0, :3]
        first[6:] = bodies[0, 3:]
        there, other = self.coordinates(first), x.copy()
        further = {
            f"{part} of dipole {k + 1}": value
            for k in range(1, len(order))
            for part, value in zip(
                PLACED, [*(bodies[k, :3] - bodies[0, :3]), *bodies[k, 3:]], strict=True
            )
        }
        for k, name in enumerate(self.names):
            # Angles of a vector of known size are "m from z" and the like.
            passing = name in NAMES or name.startswith(("v ", "m "))
            other[k] = there[k] if passing else further.get(name, x[k])
        return other

    def quadrupole(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return the quadrupole (3, 3), A m^3, and its derivatives (3, 3, n) by the states.

        Symmetric, without a trace, in the axes of the sensors at the instant of the state; zeros
        where the description has none.
        """
        (xx, yy, xy, xz, yz), by = self._blank.quadrupole(finite(x, "x"))
        values = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, -xx - yy]])
        columns = np.stack([by[0], by[2], by[3], by[2], by[1], by[4], by[3], by[4], -by[0] - by[1]])
        return values, columns.reshape(3, 3, -1)

    def centre(self, x: ArrayLike) -> tuple[Array, Array]:
        """Return the centre of the dipoles, from the first (m), and its derivatives (3, n).

        Each counts by the share that its moment has along the sum of all.
        """
        values, by = self.bodies(x)
        total, by_total = values[:, 3:].sum(axis=0), by[:, 3:].sum(axis=0)
        squared = float(total @ total) or 1.0
        share = values[:, 3:] @ total / squared
        by_share = (
            np.einsum("kin,i->kn", by[:, 3:], total)
            + values[:, 3:] @ by_total
            - 2 * np.outer(share, total @ by_total)
        ) / squared
        offsets, by_offsets = values[:, :3], by[:, :3]
        columns: Array = offsets.T @ by_share + np.einsum("k,kin->in", share, by_offsets)
        return share @ offsets, columns

    def nearest(self, x: ArrayLike) -> tuple[float, Array, Array, Array]:
        """Return when the centre is nearest to the first sensor, and where it is then.

        The time since the instant of the state (s) and its derivatives (n,), the place from
        the sensor (m) and its derivatives (3, n).
        """
        return _Nearest(self).place(finite(x, "x"))

    def coordinates(self, state: ArrayLike) -> Array:
        """Return the states (n,) of a pass (9,)."""
        return self._blank.coordinates(finite(state, "state").tolist())

    def carry(self, x: Array, other: DipoleModel) -> Array:
        """Return states here as those of another model of the body: 0 for what is not here."""
        there, own = other.coordinates(self.expand(x)[0]), dict(zip(self.names, x, strict=True))
        for k, name in enumerate(other.names):
            if name not in NAMES:
                there[k] = own.get(name, there[k])
        return there

    def handle(self, z: Array) -> _core.Model:
        """Return the extension's model of these fields; its priors are part of it."""
        return self.record(z).model()

    def h(self, x: ArrayLike) -> Array:
        """Return the exact readings (components K S,) at a state, tesla."""
        # Constants are of the channels that count.
        even = replace(
            self,
            weights=np.ones(self.weights.shape),
            background=False,
            correlation=0.0,
            description=replace(self.description, drift=False),
        )
        own = len(even.names)
        state = finite(x, "x")
        left = even.handle(np.zeros(self.weights.shape)).linearize(state[:own])[0]
        exact: Array = -left[: self.weights.size]
        if self.background:
            levels = np.zeros((2, self.used.size))
            levels[: 2 if self.description.drift else 1, self.used] = state[own:].reshape(
                -1, int(self.used.sum())
            )
            since = self.times - self.times.mean()
            exact = exact + (levels[0] + since[:, None] * levels[1]).ravel()
        return exact

    def residuals(self, x: ArrayLike, z: ArrayLike) -> Array:
        """Return the whitened residuals (components K S,) of fields at a state."""
        return self.handle(finite(z, "z")).linearize(x)[0][: self.weights.size]

    def rows(self, x: ArrayLike) -> Array:
        """Return the whitened rows (components K S, n) at a state."""
        return self._blank.model().linearize(x)[1][: self.weights.size]

    def alternatives(self, x: Array, z: Array) -> dict[str, Array]:
        """Return what else may be true, as whitened columns.

        Accelerations, a quadrupole, a second dipole on the track or beside it; of each
        channel a constant, a drift and a gain, and of several sensors their clocks.
        """
        return dict(self.record(z).alternatives(x))

    def alternative_unit(self, name: str) -> str:
        """Return the unit of an alternative's parameters."""
        kinds = {
            "acceleration": "m/s^2",
            "a second dipole": "A m^2",
            "a quadrupole": "A m^3",
            "clock": "s",
            "background": "T",
            "drift": "T/s",
        }
        return next((unit for kind, unit in kinds.items() if name.startswith(kind)), "")

    def faults(self, z: Array) -> tuple[str, ...]:
        """Return which channels are dead, stuck or doubled, in words."""
        sensors, axes = len(self.sensors), self.heads.axes
        count = len(axes)
        places = np.arange(self.weights.size).reshape(-1, count * sensors)
        channels = [
            Channel(
                f"channel {axes[c % count]}"
                + (f" of sensor {c // count + 1}" if sensors > 1 else ""),
                places[:, c],
                self.times,
            )
            for c in range(count * sensors)
        ]
        # Zero where a number does not count.
        sigma = np.divide(
            1.0, self.weights, out=np.zeros(self.weights.shape), where=self.weights > 0
        )
        readings = finite(z, "field").ravel()
        return channel_faults(readings, sigma.ravel(), channels)


class _Of:
    """A function of the pass as one of the states of a record."""

    def __init__(self, record: _core.DipoleRecord, function: Any) -> None:
        self._record, self._function = record, function
        self.range = function.range

    def __call__(self, x: Array) -> tuple[float, Array]:
        state, columns = self._record.expand(x)
        value, gradient = self._function(state)
        along: Array = gradient @ columns
        return float(value), along


class _Closest:
    range = (0.0, np.inf)

    def __init__(self, sensor: Array) -> None:
        self._sensor = sensor

    def __call__(self, state: Array) -> tuple[float, Array]:
        place, v = state[:3] - self._sensor, state[3:6]
        squared = float(v @ v)
        time = -float(place @ v) / squared if squared > 0 else 0.0
        closest = place + time * v
        distance = float(np.linalg.norm(closest))
        # At the closest point a change of its time changes nothing.
        unit = closest / (distance or 1.0)
        return distance, np.concatenate([unit, time * unit, np.zeros(3)])


def _turn(angle: float) -> tuple[Array, Array]:
    """Return the turn (3, 3) about z by an angle, clockwise from above, and its derivative."""
    sin, cos = np.sin(angle), np.cos(angle)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return turn, np.array([[-sin, cos, 0.0], [-cos, -sin, 0.0], [0.0, 0.0, 0.0]])


class _Nearest:
    """The least distance from the first sensor of a body, as it moves."""

    range = (0.0, np.inf)

    def __init__(self, model: DipoleModel) -> None:
        self._model, self._record = model, model._blank
        self._times = np.linspace(model.times.min(), model.times.max(), 65)

    def at(self, x: Array, time: float) -> tuple[Array, Array]:
        """Return where the centre is, from the sensor, and its derivatives (3, n)."""
        place, by = self._record.place(x, time)
        offset, by_offset = self._model.centre(x)
        if self._model.description.motion == "turning":
            index = self._model.names.index("turn rate")
            turn, turned = _turn(x[index] * time)
            by_offset = turn @ by_offset
            by_offset[:, index] += time * (turned @ offset)
            offset = turn @ offset
        return place + offset - self._model.sensors[0], by + by_offset

    def time(self, x: Array) -> float:
        """Return when it is nearest, within the record."""
        offset, motion = self._model.centre(x)[0], self._model.description.motion
        sensor = self._model.sensors[0]
        low, high = float(self._times[0]), float(self._times[-1])
        if motion == "straight":
            r, v = np.split(self._record.expand(x)[0][:6], 2)
            squared = float(v @ v)
            nearest = -float((r + offset - sensor) @ v) / squared if squared > 0 else low
            return min(max(nearest, low), high)
        rate = x[self._model.names.index("turn rate")] if motion == "turning" else 0.0

        def distance(time: float) -> float:
            centre = _turn(rate * time)[0] @ offset if rate else offset
            return float(np.linalg.norm(self._record.place(x, time)[0] + centre - sensor))

        near = int(np.argmin([distance(float(t)) for t in self._times]))
        low, high = self._times[max(near - 1, 0)], self._times[min(near + 1, 64)]
        # Halves of the golden section, to the last digits that a least value has.
        for _ in range(36):
            first, second = high - 0.618034 * (high - low), low + 0.618034 * (high - low)
            if distance(first) < distance(second):
                high = second
            else:
                low = first
        return float(0.5 * (low + high))

    def place(self, x: Array) -> tuple[float, Array, Array, Array]:
        """Return time, its derivatives (n,), place (3,) and its derivatives at this time."""
        time = self.time(x)
        step = 1e-4 * float(np.ptp(self._times) or 1.0)
        (before, by_before), (after, by_after) = self.at(x, time - step), self.at(x, time + step)
        here, by = self.at(x, time)
        velocity, by_velocity = (after - before) / (2 * step), (by_after - by_before) / (2 * step)
        bend = (after - 2 * here + before) / step**2
        # There here @ velocity = 0, whatever the states.
        slope = float(velocity @ velocity + here @ bend)
        by_time = -(velocity @ by + here @ by_velocity) / (slope or np.inf)
        return time, by_time, here, by

    def __call__(self, x: Array) -> tuple[float, Array]:
        offset, by = self.at(x, self.time(x))
        distance = float(np.linalg.norm(offset))
        along: Array = (offset / (distance or 1.0)) @ by
        return distance, along


class _Total:
    """The size of the sum of the moments of several dipoles."""

    range = (0.0, np.inf)

    def __init__(self, model: DipoleModel) -> None:
        self._model = model

    def __call__(self, x: Array) -> tuple[float, Array]:
        values, by = self._model.bodies(x)
        total = values[:, 3:].sum(axis=0)
        size = float(np.linalg.norm(total))
        along: Array = total / (size or 1.0) @ by[:, 3:].sum(axis=0)
        return size, along


class _Size:
    range = (0.0, np.inf)

    def __init__(self, part: slice) -> None:
        self._part = part

    def __call__(self, state: Array) -> tuple[float, Array]:
        gradient, vector = np.zeros(9), state[self._part]
        size = float(np.linalg.norm(vector))
        gradient[self._part] = vector / (size or 1.0)
        return size, gradient


class _Component:
    range = (-np.inf, np.inf)

    def __init__(self, index: int) -> None:
        self._index = index

    def __call__(self, state: Array) -> tuple[float, Array]:
        gradient = np.zeros(9)
        gradient[self._index] = 1.0
        return float(state[self._index]), gradient
