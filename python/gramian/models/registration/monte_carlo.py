"""Reports of sensors with constant biases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._arrays import as_float_array
from gramian.models.registration import _estimate, _model
from gramian.models.registration._reports import stage
from gramian.models.registration._setup import Extra, Platform, SensorsLike, Setup
from gramian.monte_carlo.experiment import Estimates, Experiment, squared_over
from gramian.problem import Problem

__all__ = ["Registration"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Registration(Experiment):
    """Reports of sensors with biases, as `gramian.registration`.

    A trial's measurements are the reports (K, N, d): for each look and sensor
    range, azimuth (and elevation).

    Parameters
    ----------
    positions : array_like, shape (K, d)
        The true positions of the looks' targets, metres.
    sensors, sigma
        As for `registration.rows`.
    biases : mapping of str to float, or array_like, shape (n,), optional
        The true biases: ``{"A.range": 300.0}``; 0 where none is given.
    extras : sequence of str
        As for `registration.rows`.
    times : array_like, shape (K,), optional
        Of the looks, seconds, for platforms that move.

    Notes
    -----
    Estimators "ml", "gls" and "ls" are the methods of `registration.estimate`;
    the NEES is by the covariance that each claims.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> path = np.stack([np.linspace(-20e3, 60e3, 100), np.full(100, 25e3)], axis=1)
    >>> sensors = {"A": (0, 0), "B": (60e3, 0)}
    >>> scene = gm.monte_carlo.Registration(path, sensors, (50.0, 0.00175), {"A.range": 300.0})
    >>> result = gm.monte_carlo.run(scene, 500, seed=1)
    >>> bool((abs(result.efficiency - 1) < 0.15).all())
    True
    """

    positions: Array
    sensors: Any
    sigma: Array
    biases: Array
    extras: tuple[Extra, ...]
    times: Array | None
    estimators: ClassVar[tuple[str, ...]] = ("ml", "gls", "ls")

    def __init__(
        self,
        positions: ArrayLike,
        sensors: SensorsLike,
        sigma: ArrayLike,
        biases: ArrayLike | Mapping[str, float] | None = None,
        extras: Sequence[Extra] = (),
        times: ArrayLike | None = None,
    ) -> None:
        object.__setattr__(self, "positions", as_float_array(positions, "positions").copy())
        object.__setattr__(self, "sensors", _copied(sensors))
        object.__setattr__(self, "sigma", as_float_array(sigma, "sigma").copy())
        object.__setattr__(self, "extras", tuple(extras))
        when = None if times is None else as_float_array(times, "times").copy()
        object.__setattr__(self, "times", when)
        object.__setattr__(self, "biases", np.array(self._setup.biases(biases)))
        # Checks everything else.
        self.problem()

    @property
    def _setup(self) -> Setup:
        return stage(self.positions, self.sensors, self.sigma, self.extras, times=self.times)

    @property
    def names(self) -> tuple[str, ...]:
        """The biases: "A.range", "A.azimuth", ..."""
        return self._setup.names

    @property
    def units(self) -> tuple[str, ...]:
        """Metres and radians."""
        return self._setup.units

    @property
    def truth(self) -> Array:
        """The true biases."""
        return self.biases

    @property
    def cost(self) -> float:
        """Seconds for a trial, roughly."""
        return 2e-6 * len(self.positions)

    def problem(self) -> Problem:
        """Return the problem at the true biases."""
        return _model.problem(
            self.positions,
            self.sensors,
            self.sigma,
            extras=self.extras,
            biases=self.biases,
            times=self.times,
        )

    def simulate(self, seed: int, first: int, trials: int) -> Array:
        """Return reports (trials, K, N, d)."""
        known = self._setup
        exact = _core.registration_reports(
            self.positions, known.places, known.sigma, self.biases, known.flags
        )
        noise = _core.normals(seed, first, trials, exact.size).reshape(-1, *exact.shape)
        return known.as_measured(exact + known.sigma * noise)

    def estimate(self, name: str, seed: int, first: int, trials: int) -> Estimates:
        """Return the errors of the estimated biases."""
        method: Any = name
        found = _estimate.estimate_trials(
            self.positions,
            self.sensors,
            self.sigma,
            self.biases,
            seed=seed,
            trials=trials,
            first=first,
            method=method,
            extras=self.extras,
            times=self.times,
        )
        status = np.select(
            [found.status == "not_converged", found.status == "unobservable"], [1, 2], 0
        )
        errors = found.biases - self.truth
        nees = squared_over(errors, found.covariance)
        return Estimates(errors, nees, status, {1: "not converged", 2: "unobservable"})


def _copied(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {
            str(key): item
            if isinstance(item, Platform)
            else as_float_array(item, f"sensors[{key!r}]").copy()
            for key, item in value.items()
        }
    if isinstance(value, (list, tuple)) and any(isinstance(item, Platform) for item in value):
        return tuple(value)
    return as_float_array(value, "sensors").copy()
