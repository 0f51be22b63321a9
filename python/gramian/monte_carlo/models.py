"""The built-in experiments: what is simulated and estimated wholly in Rust."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core, bearings
from gramian.monte_carlo.experiment import Experiment
from gramian.problem import Problem

__all__ = ["Bearings"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Bearings(Experiment):
    """Bearings of a target at constant velocity, as `gramian.bearings`.

    A trial's measurements are the bearings (m,) in (-pi, pi], radians.

    Parameters
    ----------
    times : array_like, shape (m,)
        Increasing, seconds.
    observer : array_like, shape (m, 2)
        Observer positions (east, north), metres.
    target : array_like, shape (4,)
        The true state x0, y0, vx, vy: metres and metres per second.
    sigma : float or array_like, shape (m,)
        Standard deviation of the bearings, radians, > 0.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(0.0, 600.0, 10.0)
    >>> path = np.stack([np.where(t < 300, 0, 5 * (t - 300)), np.minimum(5 * t, 1500)], axis=1)
    >>> scene = gm.monte_carlo.Bearings(t, path, [2000.0, 5000.0, -2.0, 1.0], np.radians(0.5))
    >>> scene.simulate(seed=1, first=0, trials=3).shape
    (3, 60)
    """

    times: ArrayLike
    observer: ArrayLike
    target: ArrayLike
    sigma: ArrayLike
    names = bearings.NAMES

    def __post_init__(self) -> None:
        # Checks everything.
        self.problem()

    @property
    def units(self) -> tuple[str, ...]:
        """Metres and metres per second."""
        return bearings.UNITS

    @property
    def truth(self) -> Array:
        """The true state."""
        return np.asarray(self.target, dtype=float)

    def problem(self) -> Problem:
        """Return the problem at the true state."""
        return bearings.problem(self.times, self.observer, self.target, self.sigma)

    def simulate(self, seed: int, first: int, trials: int) -> Array:
        """Return bearings (trials, m)."""
        t, path = np.asarray(self.times, dtype=float), np.asarray(self.observer, dtype=float)
        offsets = self.truth[:2] + (t - t[0])[:, None] * self.truth[2:] - path
        exact = np.arctan2(offsets[:, 0], offsets[:, 1])
        noise = _core.normals(seed, first, trials, t.size)
        noisy = exact + np.asarray(self.sigma, dtype=float) * noise
        wrapped: Array = noisy - 2 * np.pi * np.ceil(noisy / (2 * np.pi) - 0.5)
        return wrapped
