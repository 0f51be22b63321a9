"""Simulated scenes: the estimator against its bound."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian._arrays import wrap_angles
from gramian.models.tracks._many import STATUSES, estimate_many, priors_of
from gramian.models.tracks._scene import Scene, as_scene, problem, simulate
from gramian.monte_carlo.experiment import Estimates, Experiment, squared_over
from gramian.problem import Problem

__all__ = ["Tracks"]

Array = NDArray[np.float64]

#: The statuses that are no estimate.
_FAILURES = {1: "unobservable", 2: "not converged"}


@dataclass(frozen=True, eq=False)
class Tracks(Experiment):
    """A scene with a true state; a trial's measurements are those of `tracks.simulate`.

    Parameters
    ----------
    scene : Scene
    state : array_like, shape (n,), or mapping
        The true state.
    prior : mapping of str to (mean, sigma), optional
        What the estimator is given beforehand, the same in every trial.

    Notes
    -----
    Estimator "ml": the most likely state of `tracks.estimate_many`.

    Examples
    --------
    >>> import gramian as gm, numpy as np
    >>> times = np.arange(0.0, 600.0, 20.0)
    >>> path = [[0, 0], [1500, 0], [1500, 1500]]
    >>> ship = gm.tracks.Carrier(path, [0.0, 300.0, 600.0])
    >>> sensor = gm.tracks.Sensor.bearing(ship, times, sigma=0.002)
    >>> scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), [sensor])
    >>> experiment = gm.monte_carlo.Tracks(scene, [3000.0, 4000.0, -4.0, 2.0])
    >>> result = gm.monte_carlo.run(experiment, 1000, seed=1)
    >>> bool((abs(result.efficiency - 1) < 0.1).all())
    True
    """

    scene: Scene
    state: Array
    prior: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    estimators: ClassVar[tuple[str, ...]] = ("ml",)

    def __init__(
        self,
        scene: Scene,
        state: ArrayLike | Mapping[str, float],
        prior: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        object.__setattr__(self, "scene", scene)
        object.__setattr__(self, "state", as_scene(scene).state(state).copy())
        mean, sigma = priors_of(scene, prior)
        pairs = {
            name: (float(mean[k]), float(sigma[k]))
            for k, name in enumerate(scene.names)
            if np.isfinite(sigma[k])
        }
        object.__setattr__(self, "prior", pairs)
        # Checks everything else.
        self.problem()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return self.scene.names

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the states."""
        return self.scene.units

    @property
    def truth(self) -> Array:
        """The true state."""
        return self.state

    @property
    def cost(self) -> float:
        """Seconds for a trial, roughly."""
        return 5e-5 + 2e-6 * self.scene.m

    def problem(self) -> Problem:
        """Return the problem at the true state."""
        found = problem(self.scene, self.state)
        sigmas = {name: sigma for name, (_, sigma) in self.prior.items()}
        return found.prior(sigmas) if sigmas else found

    def simulate(self, seed: int, first: int, trials: int) -> Array:
        """Return measurements (trials, m)."""
        return simulate(self.scene, self.state, trials=trials, seed=seed, first=first)

    def estimate(self, name: str, seed: int, first: int, trials: int) -> Estimates:
        """Return the errors of the most likely states."""
        z = self.simulate(seed, first, trials)
        found = estimate_many(self.scene, z, prior=self.prior)
        errors = found.state - self.state
        # A course may be written with a whole turn more.
        angles = [unit == "rad" for unit in self.units]
        errors[:, angles] = wrap_angles(errors[:, angles])
        unobservable = found.code == STATUSES.index("unobservable")
        status = np.where(unobservable, 1, 0)
        status[found.code == STATUSES.index("not_converged")] = 2
        covariance = np.where(np.isfinite(found.covariance), found.covariance, 0.0)
        return Estimates(errors, squared_over(errors, covariance), status, _FAILURES)
