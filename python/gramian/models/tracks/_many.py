"""The most likely states of many records of a scene at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._answers import Answer, Columns, columns_of_states
from gramian._arrays import ITERATIONS_MOST, number, whole
from gramian._noise import as_known, as_pair
from gramian._options import choice, mapping, tolerance
from gramian.estimation._channels import faulty
from gramian.estimation._parts import NEIGHBOURS, not_white
from gramian.exceptions import InputError
from gramian.models.tracks._scene import Scene, as_scene

__all__ = ["STATUSES", "Estimates", "Loss", "estimate_many", "knowledge", "priors_of"]

Array = NDArray[np.float64]

#: Statuses, worst first.
STATUSES = tuple(_core.track_statuses())

#: Constants of the robust losses with 95 % efficiency on normal noise.
CONSTANTS = {"squares": 0.0, "huber": 1.345, "tukey": 4.685}

Loss = Literal["squares", "huber", "tukey"]


@dataclass(frozen=True, eq=False, repr=False)
class Estimates(Answer):
    """The answer of `estimate_many`, one entry for each record.

    Attributes
    ----------
    scene : Scene
    measurements : ndarray, shape (..., m)
    state : ndarray, shape (..., n)
        The most likely state; where the status is "unobservable" one of many. NaN where the
        measurements have no likelihood at any of the starts ("not_converged").
    covariance : ndarray, shape (..., n, n)
        The local Gaussian approximation; `inf` where none exists, 0 for known states.
    code : ndarray of int, shape (...)
        The place of the status in `STATUSES`.
    chi2 : ndarray, shape (...)
        Sum of the squared whitened residuals of the measurements.
    cost : ndarray, shape (...)
        Twice the loss that was minimised, priors included.
    dof : ndarray of int, shape (...)
        Measurements that are there, and priors, less states.
    p_value : ndarray, shape (...)
        Probability of a larger `cost` if the model is true; NaN without degrees of
        freedom, or with a robust loss.
    other : ndarray, shape (..., n)
        The next best solution that was found; NaN where there is none.
    other_cost : ndarray, shape (...)
        Its cost; infinite where there is none.
    null_direction : ndarray, shape (..., n)
        Where the status is "unobservable", one change that no measurement sees.
    vagueness : ndarray, shape (...)
        The largest deviation of a position while the sensors look, over the usual distance
        from the nearest carrier.
    iterations : ndarray of int, shape (...)
    correlated : ndarray of bool, shape (...)
        Whether neighbouring residuals are correlated by more than noise leaves: a "misfit".
    faults : tuple of str
        Sensors that are dead, stuck or doubled, with the place of the record: a "misfit",
        whatever chi2 is.
    """

    scene: Scene
    measurements: Array
    state: Array
    covariance: Array
    code: NDArray[np.int8]
    chi2: Array
    cost: Array
    dof: NDArray[np.int64]
    p_value: Array
    other: Array
    other_cost: Array
    null_direction: Array
    vagueness: Array
    iterations: NDArray[np.int32]
    correlated: NDArray[np.bool_]
    faults: tuple[str, ...] = ()

    _more_in_dict = ("status", "names", "units", "std")
    _not_in_dict = frozenset({"scene", "measurements", "code", "other", "other_cost"})

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return self.scene.names

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the states."""
        return self.scene.units

    @property
    def status(self) -> NDArray[np.str_]:
        """The statuses in words, shape (...), worst first in `STATUSES`."""
        return np.array(STATUSES)[self.code]

    @property
    def std(self) -> Array:
        """Standard deviation of each state, shape (..., n); `inf` where none exists."""
        std: Array = np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))
        return std

    def value(self, name: str) -> Array:
        """Return one state, shape (...)."""
        value: Array = self.state[..., self.scene.index(name)]
        return value

    def summary(self) -> str:
        """Return what became of the records as text."""
        counts = np.bincount(self.code.ravel(), minlength=len(STATUSES))
        parts = [f"{n} {word}" for n, word in zip(counts, STATUSES, strict=True) if n]
        return f"{self.code.size} trials: {', '.join(parts)}"

    def _as_table(self) -> Columns:
        others = {"status": self.status, "chi2": self.chi2, "p_value": self.p_value}
        return columns_of_states(
            self.names, self.units, {"": self.state, "std": self.std}, others, self.covariance
        )


def estimate_many(
    scene: Scene,
    measurements: ArrayLike | Sequence[ArrayLike],
    *,
    prior: Mapping[str, tuple[float, float]] | None = None,
    known: Mapping[str, float] | None = None,
    loss: Loss = "squares",
    constant: float | None = None,
    start: ArrayLike | Mapping[str, float] | None = None,
    alpha: float = 0.001,
    weak_ratio: float = 0.25,
    max_iterations: int = 60,
    polish: int = 4,
    rtol: float | None = None,
) -> Estimates:
    """Return the most likely states of many records at once, with covariances and statuses.

    Parameters
    ----------
    scene : Scene
    measurements : array_like, shape (..., m), or one for each sensor
        See `Scene.pack`; NaN for a missing sample. Leading axes are a batch.
    prior : mapping of str to (mean, sigma), optional
        What is known of states beforehand, in every record.
    known : mapping of str to float, optional
        States that are known exactly.
    loss : {"squares", "huber", "tukey"}
        How a residual counts. With a robust loss the covariance is that of the
        sandwich formula.
    constant : float, optional
        Of the loss, in deviations: 1.345 for Huber, 4.685 for Tukey, at which the
        efficiency on normal noise is 95 %.
    start : array_like, shape (n,) or (k, n), or mapping, optional
        States to begin from; by default found from the measurements.
    alpha : float
        "misfit" where a true model gives so large a chi-square with a smaller
        probability than this, or neighbouring residuals so correlated with a tenth of it;
        with Tukey's loss where half of the measurements count nothing.
    weak_ratio : float
        "weak" where the deviation of a position, at any time while the sensors look,
        exceeds this many times the median distance from the nearest carrier.
    max_iterations : int
        Steps at most from each start.
    polish : int
        How many of the starts are followed to their end.
    rtol : float, optional
        Relative tolerance of the rank decision.

    Returns
    -------
    Estimates
        Look at each status. Alternatives, other solutions and intervals of the likelihood:
        `estimate`, of one record.

    Raises
    ------
    InputError
        More states than measurements and priors; names that are none of the states;
        measurements that do not fit their sensors.

    Notes
    -----
    Damped Gauss-Newton steps on orthogonally reduced rows, from several starts
    (Levenberg-Marquardt; Moré 1978). Records run on all threads.

    Examples
    --------
    >>> import gramian as gm, numpy as np
    >>> times = np.arange(0.0, 600.0, 20.0)
    >>> ship = gm.tracks.Carrier([[0, 0], [1500, 0], [1500, 1500]], [0.0, 300.0, 600.0])
    >>> sensor = gm.tracks.Sensor.bearing(ship, times, sigma=0.005)
    >>> scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), [sensor])
    >>> seen = gm.tracks.simulate(scene, [3000.0, 4000.0, -4.0, 2.0], trials=20, seed=2)
    >>> gm.tracks.estimate_many(scene, seen).summary()
    '20 trials: 20 determined'
    """
    z = as_scene(scene).pack(measurements)
    fixed, mean, sigma = knowledge(scene, prior, known)
    free = int(np.isnan(fixed).sum())
    information = int(np.isfinite(sigma).sum())
    present = np.count_nonzero(~np.isnan(z), axis=-1)
    if (present + information < free).any():
        raise InputError(
            f"{free} states from {int(present.min())} measurements and {information} priors: "
            "must be at least as many as the states"
        )
    choice(loss, "loss", CONSTANTS)
    tuned = CONSTANTS[loss] if constant is None else number(constant, "constant")
    if loss != "squares" and not tuned > 0:
        raise InputError(f"constant = {constant}: must be > 0")
    begin = None if start is None else np.atleast_2d(scene.state(start))
    alpha = number(alpha, "alpha")
    found = scene._inner.estimate(
        z,
        fixed,
        mean,
        sigma,
        begin,
        whole(max_iterations, "max_iterations", 1, ITERATIONS_MOST),
        loss,
        tuned,
        whole(polish, "polish", 1, 1000),
        tolerance(rtol),
        alpha,
        number(weak_ratio, "weak_ratio"),
        NEIGHBOURS * alpha,
    )
    if z.ndim == 1 and np.isnan(found["state"]).any():
        raise InputError(
            "the measurements have no finite likelihood at any of the starts: is a start, or the "
            "mean of a prior, on a sensor or beyond what float64 holds?"
        )
    code = np.asarray(found["code"]).astype(np.int8)
    bad, faults = faulty(z, scene.sigma, scene.channels, found["p_value"])
    dof = np.asarray(found["dof"]).astype(int)
    correlated = np.asarray(not_white(dof, found["p_value"], found["lag_p_value"], alpha))
    rejected = np.zeros(dof.shape, dtype=bool)
    if loss == "tukey":
        # So large is twice the loss where half of the measurements are beyond its reach.
        rejected = found["cost"] > 0.5 * (tuned**2 / 3 + 1) * (present + information)
    misfit = (bad | correlated | rejected) & (code != 0)
    code = np.where(misfit, np.int8(STATUSES.index("misfit")), code)
    return Estimates(
        scene=scene,
        measurements=z,
        state=found["state"],
        covariance=found["covariance"],
        code=np.asarray(code),
        chi2=found["chi2"],
        cost=found["cost"],
        dof=dof,
        p_value=found["p_value"],
        other=found["other"],
        other_cost=found["other_cost"],
        null_direction=found["null_direction"],
        vagueness=found["vagueness"],
        iterations=found["iterations"].astype(np.int32),
        correlated=correlated,
        faults=faults,
    )


def knowledge(
    scene: Scene,
    prior: Mapping[str, tuple[float, float]] | None,
    known: Mapping[str, float] | None,
) -> tuple[Array, Array, Array]:
    """Return what is known exactly (n,), NaN elsewhere, and means and deviations of the prior."""
    mean, sigma = priors_of(scene, prior)
    fixed = np.full(scene.n, np.nan)
    for name, value in as_known(known, scene.names, scene.units, "known").items():
        index = scene.index(name)
        if np.isfinite(sigma[index]):
            raise InputError(f"{name} is in known and in prior: must be in one of them")
        fixed[index] = value
    if not np.isnan(fixed).any():
        raise InputError("known names every state: at least one must be left")
    return fixed, mean, sigma


def priors_of(scene: Scene, prior: Mapping[str, tuple[float, float]] | None) -> tuple[Array, Array]:
    """Return means and deviations (n,) of a prior, infinite where there is none."""
    mean, sigma = np.zeros(scene.n), np.full(scene.n, np.inf)
    for name, given in mapping(prior, "prior", "name to (mean, sigma)").items():
        index = scene.index(name)
        mean[index], sigma[index] = as_pair(given, f"prior of {name}", scene.units[index])
    return mean, sigma
