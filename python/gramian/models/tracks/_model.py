"""A scene as a model to estimate from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._arrays import above_rounding
from gramian._text import brief
from gramian._values import Value
from gramian.estimation import channel_faults
from gramian.exceptions import InputError
from gramian.models.tracks._many import estimate_many
from gramian.models.tracks._scene import Scene
from gramian.models.tracks._sensors import UNITS

__all__ = ["TracksModel"]

Array = NDArray[np.float64]

#: Turns are tested after these shares of the times.
_TURNS = (0.25, 0.5, 0.75)
#: From so many times on.
_LEAST_TIMES = 8


@dataclass(frozen=True, eq=False)
class TracksModel(Value):
    """A scene as `gramian.estimate` and `gramian.other_solutions` take a model.

    Attributes
    ----------
    scene : Scene
    rtol : float, optional
        Relative tolerance of the rank decision; by default what rounding of the coordinates
        calls for.
    """

    scene: Scene
    rtol: float | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return self.scene.names

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the states."""
        return self.scene.units

    def measured(self, z: Any) -> Array:
        """Return measurements (m,) as `Scene.pack` takes them, of one record."""
        values = self.scene.pack(z)
        if values.ndim != 1:
            raise InputError(
                f"measurements has shape {values.shape}: must be ({self.scene.m},), one record; "
                "estimate_many takes batches"
            )
        return values

    def handle(self, z: Array) -> _core.Model:
        """Return the extension's model of these measurements."""
        return self.scene._inner.model(z)

    def h(self, x: ArrayLike) -> Array:
        """Return what the sensors read without noise (m,)."""
        return self.scene.values(x)

    def residuals(self, x: ArrayLike, z: ArrayLike) -> Array:
        """Return the whitened residuals of measurements, those of missing samples left out."""
        return self.scene._inner.linearize(z, x)[0]

    def rows(self, x: ArrayLike) -> Array:
        """Return the whitened rows (m, n) at a state."""
        return self.scene._inner.rows(x)

    def rounded(self, x: Array, rows: Array, free: Sequence[int]) -> tuple[Array, float | None]:
        """Return rows without what rounding of the coordinates leaves, and a tolerance."""
        if self.rtol is not None:
            return rows, self.rtol
        return above_rounding(rows, self.scene._inner.rounding(x)[list(free)])

    def starts(self, z: Array) -> Array:
        """Return the likeliest states that the measurements alone suggest."""
        try:
            found = estimate_many(self.scene, z)
        except InputError:
            # Too few measurements, without the prior that may make up for them.
            nothing = np.full(self.scene.n, np.nan)
            zero, unknown = np.zeros(self.scene.n), np.full(self.scene.n, np.inf)
            return self.scene._inner.starts(z, nothing, zero, unknown)
        states = np.stack([found.state, found.other])
        return states[np.isfinite(states).all(axis=1)]

    @property
    def functions(self) -> dict[str, tuple[Any, str]]:
        """The range from the nearest carrier at the first time, and at the last, by name."""
        found: dict[str, tuple[Any, str]] = {}
        for name, end in (("range", 0), ("range at the end", -1)):
            ranges = [
                (float(sensor.times[end]), sensor.carrier.at(sensor.times[[end]])[0][0])
                for sensor in self.scene.sensors
                if sensor.carrier is not None and sensor.times.size
            ]
            if ranges:
                times = [time for time, _ in ranges]
                which = int(np.argmin(times) if end == 0 else np.argmax(times))
                found[name] = (self._range(*ranges[which]), "m")
        return found

    def _range(self, time: float, place: Array) -> Callable[[Array], tuple[float, Array]]:
        scene = self.scene

        def distance(x: Array) -> tuple[float, Array]:
            offset = scene.track(x, [time])[0][: place.size] - place
            size = float(np.linalg.norm(offset))
            slope = scene._inner.slopes(x, [time])[0][: place.size]
            along: Array = offset / (size or 1.0) @ slope
            return size, along

        return distance

    def alternatives(self, x: Array, z: Array) -> dict[str, Array]:
        """Return what else may be true, as whitened columns.

        A motion of the next order, a turn; of each sensor a bias, a scale, an offset of its
        clock, unless they are states.
        """
        scene = self.scene
        times = np.unique(np.concatenate([sensor.times for sensor in scene.sensors]))
        turns = np.quantile(times, _TURNS) if times.size >= _LEAST_TIMES else np.empty(0)
        labels = scene.labels
        found = {}
        for kind, which, columns in scene._inner.departures(z, x, turns):
            if kind == "order":
                name = "acceleration" if which == 2 else f"motion of order {which:g}"
            elif kind == "turn":
                name = f"turn at {brief(which, 6)} s"
            else:
                name = f"{kind} of {labels[int(which)]}"
            found[name] = columns
        return found

    def alternative_unit(self, name: str) -> str:
        """Return the unit of an alternative's parameters."""
        kind, _, what = name.partition(" of ")
        if kind == "motion":
            order = int(what.removeprefix("order "))
            return "m/s" if order == 1 else f"m/s^{order}"
        if kind == "bias":
            return UNITS[self.scene.sensors[self.scene.labels.index(what)].kind]
        if kind == "acceleration":
            return "m/s^2"
        return {"clock": "s", "scale": ""}.get(kind, "m/s")

    def faults(self, z: Array) -> tuple[str, ...]:
        """Return which sensors are dead, stuck or doubled, in words."""
        return channel_faults(z, self.scene.sigma, self.scene.channels)
