"""Bearings as a model that `gramian.estimate` takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._arrays import finite
from gramian._text import brief
from gramian._values import Value
from gramian.estimation import Channel, channel_faults
from gramian.models.bearings._rows import state_names

__all__ = ["BearingsModel", "channels"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BearingsModel(Value):
    """Bearings of a target that moves as a polynomial in time.

    Attributes
    ----------
    times : ndarray, shape (m,)
        Seconds.
    observer : ndarray, shape (m, 2)
        Metres (east, north).
    sigma : ndarray, shape (1,) or (m,)
        Radians.
    order : int
        0 at rest, 1 constant velocity, 2 accelerated, 3 constant jerk.
    observer_index : ndarray of int, shape (m,), optional
        Which observer took each bearing; one took all by default.
    """

    times: Array
    observer: Array
    sigma: Array
    order: int = 1
    observer_index: NDArray[np.int64] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return state_names(self.order)[0]

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the states."""
        return state_names(self.order)[1]

    @property
    def functions(self) -> dict[str, tuple[tuple[tuple[int, int], Array], str]]:
        """The first range, by its name."""
        return {"range": (((0, 1), self.observer[0]), "m")}

    def handle(self, z: Array) -> _core.Model:
        """Return the extension's model of these bearings."""
        states = len(self.names)
        return _core.Model.bearings(self.times, self.observer, z, self.sigma, states)

    def h(self, x: ArrayLike) -> Array:
        """Return the exact bearings (m,) at a state, radians."""
        zeros = np.zeros(self.times.size)
        residuals = self.handle(zeros).linearize(x)[0]
        exact: Array = -residuals * self.sigma
        return exact

    def residuals(self, x: ArrayLike, z: ArrayLike) -> Array:
        """Return the whitened residuals (m,) of bearings at a state."""
        return self.handle(finite(z, "z")).linearize(x)[0]

    def rows(self, x: ArrayLike) -> Array:
        """Return the whitened rows (m, n) at a state."""
        return self.handle(np.zeros(self.times.size)).linearize(x)[1]

    def rounded(self, x: Array, rows: Array, free: Sequence[int]) -> tuple[Array, float | None]:
        """Return rows without what rounding of the coordinates leaves in them, and a tolerance.

        Of the rank decision: beside large coordinates or times a straight path is not straight.
        """
        m = self.times.size
        clean, rtol, *_ = _core.bearing_frame(self.times, self.observer, x, rows[:m], True)
        return np.vstack([clean, rows[m:]]), rtol

    def starts(self, z: Array) -> Array:
        """Return a ladder of ranges along the first bearings, and the pseudo-linear state."""
        n = len(self.names)
        first = float(np.angle(np.exp(1j * z[: max(1, z.size // 8)]).mean()))
        direction = np.array([np.sin(first), np.cos(first)])
        path = np.linalg.norm(np.ptp(self.observer, axis=0)) or 1.0
        ladder = np.zeros((12, n))
        ladder[:, :2] = self.observer[0] + path * np.geomspace(0.03, 100, 12)[:, None] * direction
        if self.order < 1:
            return ladder
        # The target goes with the observer: at any range that keeps the bearing.
        moving = ladder.copy()
        span = self.times[-1] - self.times[0]
        moving[:, 2:4] = (self.observer[-1] - self.observer[0]) / (span or 1.0)
        record = _core.bearings_localize(
            self.times, self.observer, z, self.sigma, n, None, True, None, 50, 0.25, 0.0
        )
        state = np.asarray(record["state"])
        known = [state[None, :]] if np.isfinite(state).all() else []
        return np.concatenate([*known, ladder, moving])

    def alternatives(self, x: Array, z: Array) -> dict[str, Array]:
        """Return what else may be true, as whitened columns.

        A motion of one order more, a turn, a bias of the bearings, a clock offset of the path.
        """
        t = self.times - self.times[0]
        place = self.rows(x)[:, :2]
        weight = np.broadcast_to(1.0 / self.sigma, t.shape)
        parts = channels(self.times, self.observer_index)
        found: dict[str, Array] = {}
        for part in parts:
            column = np.zeros(t.size)
            column[part.places] = weight[part.places]
            found[part.name.replace("bearing", "bias")] = column
        power = self.order + 1
        found["acceleration" if power == 2 else f"motion of order {power}"] = (
            place * (t**power / factorial(power))[:, None]
        )
        if t.size >= 8 and self.order == 1:
            for share in (0.25, 0.5, 0.75):
                at = float(np.quantile(t, share))
                found[f"turn at {brief(at, 4)} s"] = place * np.maximum(t - at, 0.0)[:, None]
            if len(parts) == 1:
                velocity = np.gradient(self.observer, self.times, axis=0)
                found["clock offset of the path"] = -(place * velocity).sum(axis=1)
        return found

    def alternative_unit(self, name: str) -> str:
        """Return the unit of an alternative's parameters."""
        if name.startswith("turn"):
            return "m/s"
        if name.startswith("bias"):
            return "rad"
        fixed = {"clock offset of the path": "s"}
        return fixed.get(name, f"m/s^{self.order + 1}" if self.order else "m/s")

    def faults(self, z: Array) -> tuple[str, ...]:
        """Return where the bearings are stuck or copied, in words."""
        return channel_faults(z, self.sigma, channels(self.times, self.observer_index))


def channels(times: Array, observer_index: NDArray[np.int64] | None) -> list[Channel]:
    """Return the bearings of each observer as a channel."""
    first = times.reshape(-1, times.shape[-1])[0]
    if observer_index is None:
        return [Channel("bearing", np.arange(first.size), first)]
    return [
        Channel(f"bearing of observer {k}", places, first[places])
        for k in np.unique(observer_index).tolist()
        if (places := np.flatnonzero(observer_index == k)).size
    ]
