"""The bearings of a target at constant velocity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import as_float_array, wrap_angles
from gramian.exceptions import InputError
from gramian.models.bearings import _rows
from gramian.monte_carlo.experiment import Estimates, Experiment
from gramian.problem import Problem

__all__ = ["Bearings"]

Array = NDArray[np.float64]

#: The statuses of `bearings_localize` that are no estimate.
_BEARINGS_FAILURES = {
    2: "unobservable",
    3: "likelihood grows to infinite range",
    4: "not_converged",
}


@dataclass(frozen=True, eq=False)
class Bearings(Experiment):
    """Bearings of a target at constant velocity, as `gramian.bearings`.

    A trial's measurements are the bearings (m,) in (-pi, pi], radians; with a
    prior, followed by the trial's prior means (4,).

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
    prior : mapping of str to float, optional
        Standard deviations of what is known beforehand of the states; what is
        believed is drawn anew around the truth in each trial.

    Notes
    -----
    Estimator "ml": the maximum-likelihood state of `bearings.localize_many`; its NEES
    is by the covariance at the estimate. Quantity "gram_logdet": the natural
    logarithm of the determinant of the Gram matrix of the noisy bearings (Li &
    Sheng 2009, Lemma 1). Both simulate and compute in one pass in Rust.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(0.0, 600.0, 10.0)
    >>> path = np.stack([np.where(t < 300, 0, 5 * (t - 300)), np.minimum(5 * t, 1500)], axis=1)
    >>> scene = gm.monte_carlo.Bearings(t, path, [2000.0, 5000.0, -2.0, 1.0], np.radians(0.1))
    >>> result = gm.monte_carlo.run(scene, 2000, seed=1)
    >>> bool((abs(result.efficiency - 1) < 0.06).all()), result.nees.consistent
    (True, True)
    """

    times: Array
    observer: Array
    target: Array
    sigma: Array
    prior: Mapping[str, float] = field(default_factory=dict)
    names = _rows.NAMES
    estimators: ClassVar[tuple[str, ...]] = ("ml",)
    quantities: ClassVar[tuple[str, ...]] = ("gram_logdet",)

    def __init__(
        self,
        times: ArrayLike,
        observer: ArrayLike,
        target: ArrayLike,
        sigma: ArrayLike,
        prior: Mapping[str, float] | None = None,
    ) -> None:
        given = {"times": times, "observer": observer, "target": target, "sigma": sigma}
        for name, value in given.items():
            # Own copies: what is given may change, an experiment may not.
            object.__setattr__(self, name, as_float_array(value, name).copy())
        object.__setattr__(self, "prior", options.deviations(prior, "prior"))
        if self.target.shape != (4,):
            raise InputError(f"target has shape {self.target.shape}: must be (4,), x0, y0, vx, vy")
        if unknown := set(self.prior) - set(self.names):
            raise InputError(
                f"prior has {sorted(unknown)[0]!r}: must be of the states {', '.join(self.names)}"
            )
        # Checks everything else.
        self.problem()

    @property
    def units(self) -> tuple[str, ...]:
        """Metres and metres per second."""
        return _rows.UNITS

    @property
    def truth(self) -> Array:
        """The true state."""
        return self.target

    @property
    def exact(self) -> Array:
        """The bearings without noise (m,)."""
        t = self.times - self.times[0]
        offsets = self.target[:2] + t[:, None] * self.target[2:] - self.observer
        angles: Array = np.arctan2(offsets[:, 0], offsets[:, 1])
        return angles

    @property
    def cost(self) -> float:
        """Seconds for a trial, roughly."""
        return 2e-6 + 4e-8 * self.times.size

    def problem(self) -> Problem:
        """Return the problem at the true state."""
        problem = _rows.problem(self.times, self.observer, self.target, self.sigma)
        return problem.prior(self.prior) if self.prior else problem

    def simulate(self, seed: int, first: int, trials: int) -> Array:
        """Return bearings (trials, m), or with a prior (trials, m + 4)."""
        m = self.times.size
        noise = _core.normals(seed, first, trials, m + 4 * bool(self.prior))
        noisy = noise[:, :m]
        noisy *= self.sigma
        noisy += self.exact
        wrapped = wrap_angles(noisy)
        if not self.prior:
            return wrapped
        return np.concatenate([wrapped, self._believed(noise[:, m:])], axis=1)

    def _believed(self, noise: Array) -> Array:
        sigma = self._prior_sigma()
        return self.target + np.where(np.isfinite(sigma), sigma, 0.0) * noise

    def _prior_sigma(self) -> Array:
        return np.array([self.prior.get(name, np.inf) for name in self.names])

    def estimate(self, name: str, seed: int, first: int, trials: int) -> Estimates:
        """Return the errors of the maximum-likelihood states."""
        prior = None
        if self.prior:
            noise = _core.normals(seed, first, trials, self.times.size + 4)
            prior = (self._believed(noise[:, self.times.size :]), self._prior_sigma())
        found = _core.bearings_localize_trials(
            self.times,
            self.observer,
            self.target,
            self.sigma,
            seed,
            first,
            trials,
            prior,
            False,
            None,
            50,
            0.5,
        )
        status = found["status"].astype(np.int16)
        # A weak estimate is an estimate: its error counts like any other.
        return Estimates(
            found["error"], found["nees"], np.where(status == 1, 0, status), _BEARINGS_FAILURES
        )

    def quantity(self, name: str, seed: int, first: int, trials: int) -> Array:
        """Return the log determinants."""
        return _core.bearing_log_det_trials(self.times, self.exact, self.sigma, seed, first, trials)
