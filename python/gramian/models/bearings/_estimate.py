"""The most likely state of one target from its bearings, and whether it may be believed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._arrays import finite
from gramian._text import brief
from gramian._values import Value
from gramian.estimation import Channel, Estimate, channel_faults
from gramian.estimation import estimate as general
from gramian.exceptions import InputError
from gramian.models.bearings._rows import state_names

__all__ = ["BearingsModel", "estimate"]

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
    """

    times: Array
    observer: Array
    sigma: Array
    order: int = 1

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
            self.times, self.observer, z, self.sigma, n, None, True, None, 50, 0.25
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
        found: dict[str, Array] = {
            "bias": np.broadcast_to(1.0 / self.sigma, t.shape).copy(),
        }
        power = self.order + 1
        found["acceleration" if power == 2 else f"motion of order {power}"] = (
            place * (t**power / factorial(power))[:, None]
        )
        if t.size >= 8 and self.order == 1:
            for share in (0.25, 0.5, 0.75):
                at = float(np.quantile(t, share))
                found[f"turn at {brief(at, 4)} s"] = place * np.maximum(t - at, 0.0)[:, None]
            velocity = np.gradient(self.observer, self.times, axis=0)
            found["clock offset of the path"] = -(place * velocity).sum(axis=1)
        return found

    def alternative_unit(self, name: str) -> str:
        """Return the unit of an alternative's parameters."""
        if name.startswith("turn"):
            return "m/s"
        fixed = {"bias": "rad", "clock offset of the path": "s"}
        return fixed.get(name, f"m/s^{self.order + 1}" if self.order else "m/s")

    def faults(self, z: Array) -> tuple[str, ...]:
        """Return where the bearings are stuck, in words."""
        one = Channel("bearing", np.arange(self.times.size), self.times)
        return channel_faults(z, self.sigma, [one])


def estimate(
    times: ArrayLike,
    bearings: ArrayLike,
    observer: ArrayLike,
    sigma: ArrayLike,
    prior: Mapping[str, tuple[float, float]] | None = None,
    *,
    order: int = 1,
    **options: Any,
) -> Estimate:
    """Return the most likely state of a moving target, and whether it may be believed.

    Parameters
    ----------
    times : array_like, shape (m,)
        Seconds.
    bearings : array_like, shape (m,)
        Clockwise from north, radians; whole turns do not matter.
    observer : array_like, shape (m, 2)
        Observer positions (east, north), metres.
    sigma : array_like, shape () or (m,)
        Standard deviation of the bearings, radians, > 0.
    prior : mapping of str to (mean, sigma), optional
        What is known of states beforehand: ``{"vx": (3.0, 0.5)}``.
    order : int
        The target's position is a polynomial in time of this order.
    **options
        As for `gramian.estimate`.

    Returns
    -------
    gramian.estimation.Estimate
        Its interval of "range" is that of the first range.

    Raises
    ------
    InputError
        Shapes that do not fit, numbers that are not finite, a sigma that is not positive.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(0.0, 600.0, 20.0)
    >>> path = np.stack([np.maximum(0, 5 * (t - 300)), np.minimum(5 * t, 1500)], axis=1)
    >>> seen = gm.bearings.simulate(t, path, [2000, 6000, 3, -1], 1e-3, seed=2)
    >>> answer = estimate(t, seen, path, 1e-3)
    >>> answer.status, answer.contains([2000, 6000, 3, -1])
    ('determined', True)
    """
    when, path, z = (
        finite(times, "times"),
        finite(observer, "observer"),
        finite(bearings, "bearings"),
    )
    if when.ndim != 1 or z.shape != when.shape:
        raise InputError(
            f"times has shape {when.shape}, bearings {z.shape}: must be (m,) both; "
            "localize takes batches"
        )
    if path.ndim != 2:
        raise InputError(f"observer has shape {path.shape}: must be (m, 2), one track")
    model = BearingsModel(when, path, np.atleast_1d(finite(sigma, "sigma [rad]")), order)
    model.handle(z)
    return general(model, z, prior=prior, **options)
