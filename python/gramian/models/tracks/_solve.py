"""The most likely state of a scene, trial by trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._answers import Answer, Columns, columns_of_states
from gramian._arrays import above_rounding, number, whole
from gramian._noise import as_known, as_pair
from gramian._options import choice, mapping, tolerance
from gramian._registry import draw
from gramian._text import brief
from gramian.estimation import Estimate, Interval, Region, Solution
from gramian.estimation._channels import faulty
from gramian.exceptions import InputError
from gramian.models.tracks._scene import Scene, as_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Loss", "TrackEstimate", "solve"]

Array = NDArray[np.float64]

#: Statuses, worst first.
STATUSES = tuple(_core.track_statuses())

#: Constants of the robust losses with 95 % efficiency on normal noise.
CONSTANTS = {"squares": 0.0, "huber": 1.345, "tukey": 4.685}

Loss = Literal["squares", "huber", "tukey"]


class _Likely:
    """A scene as `gramian.estimate` takes a model."""

    def __init__(self, scene: Scene, known: Mapping[str, float]) -> None:
        self.names, self.units = scene.names, scene.units
        self._scene, self._known = scene, known

    def handle(self, z: Array) -> _core.Model:
        """Return the extension's model of these measurements."""
        return self._scene._inner.model(z)

    def rounded(self, x: Array, rows: Array) -> tuple[Array, float | None]:
        """Return rows without what rounding of the coordinates leaves, and a tolerance."""
        free = np.array([name not in self._known for name in self.names])
        state = np.array([self._known.get(name, 0.0) for name in self.names])
        state[free] = x
        return above_rounding(rows, self._scene._inner.rounding(state)[free])


@dataclass(frozen=True, eq=False, repr=False)
class TrackEstimate(Answer):
    """The answer of `estimate`: one estimate, or one for each trial of a batch.

    Attributes
    ----------
    scene : Scene
    measurements : ndarray, shape (..., m)
    state : ndarray, shape (..., n)
        The most likely state; where the status is "unobservable" one of many. NaN in a
        trial of a batch whose measurements have no likelihood at any of the starts
        ("not_converged").
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
    iterations : ndarray of int, shape (...)
    prior : mapping of str to (mean, sigma)
    known : mapping of str to float
    loss : str
        As given to `estimate`.
    faults : tuple of str
        Sensors that are dead, stuck or doubled: a "misfit", whatever chi2 is. Of a batch with
        the place of the record.
    legs : LegChoice or None
        How the number of legs was chosen, where it was.
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
    iterations: NDArray[np.int32]
    prior: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    loss: Loss = "squares"
    faults: tuple[str, ...] = ()
    legs: Any = None

    _more_in_dict = ("status", "names", "units", "std")
    _not_in_dict = frozenset(
        {"scene", "measurements", "legs", "code", "other", "other_cost", "prior", "known", "loss"}
    )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return self.scene.names

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the states."""
        return self.scene.units

    @property
    def status(self) -> str | NDArray[np.str_]:
        """The status in words, worst first in `STATUSES`; an array for a batch."""
        words = np.array(STATUSES)[self.code]
        return str(words) if self.code.ndim == 0 else words

    @property
    def std(self) -> Array:
        """Standard deviation of each state, shape (..., n); `inf` where none exists."""
        std: Array = np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))
        return std

    @property
    def reason(self) -> str:
        """What decided the status of a single estimate."""
        status = self.status
        if not isinstance(status, str):
            raise InputError("reason is of one estimate: this is a batch")
        if status == "misfit" and self.faults:
            return "; ".join(self.faults)
        costs = [float(self.cost), float(self.other_cost)]
        return _core.track_reason(
            int(self.code),
            costs,
            float(self.dof),
            float(self.p_value),
            self.null_direction,
            self.names,
        )

    @property
    def residuals(self) -> Array:
        """Whitened residuals of a single estimate, those of missing samples left out."""
        if self.state.ndim != 1:
            raise InputError("residuals are of one estimate: this is a batch")
        residuals: Array = self.scene._inner.linearize(self.measurements, self.state)[0]
        return residuals

    @property
    def outliers(self) -> NDArray[np.int64]:
        """Measurements whose whitened residual exceeds 4, by their place."""
        present = np.flatnonzero(~np.isnan(self.measurements))
        return present[np.abs(self.residuals) > 4]

    def value(self, name: str) -> Array:
        """Return one state, shape (...)."""
        value: Array = self.state[..., self.scene.index(name)]
        return value

    def track(self, times: ArrayLike) -> Array:
        """Return positions (k, D) of a single estimate at these times."""
        return self.scene.track(self.state, times)

    @cached_property
    def _likelihood(self) -> Estimate:
        """The estimate as one of a general model."""
        if self.state.ndim != 1:
            raise InputError("intervals and regions are of one estimate: this is a batch")
        if self.loss != "squares":
            raise InputError(
                f"loss = {self.loss!r}: intervals and regions are of the likelihood, "
                'which is that of loss = "squares"'
            )
        free = [i for i, name in enumerate(self.names) if name not in self.known]
        others: tuple[Solution, ...] = ()
        if np.isfinite(self.other_cost):
            others = (Solution(self.other[free], float(self.other_cost), np.nan, np.nan, 1),)
        return Estimate(
            model=_Likely(self.scene, self.known),
            measurements=self.measurements,
            names=tuple(self.names[i] for i in free),
            units=tuple(self.units[i] for i in free),
            state=self.state[free],
            converged=self.status != "not_converged",
            iterations=int(self.iterations),
            prior=dict(self.prior),
            known=dict(self.known),
            others=others,
            unseen=1.0,
            alpha=0.001,
            chance=0.01,
            weak_ratio=0.25,
        )

    def interval(self, what: Any, level: float = 0.95) -> Interval:
        """Return the values of a state or combination that the measurements allow.

        Parameters
        ----------
        what : str, mapping, array_like or callable
            As for `gramian.Estimate.interval`: a state by its name, ``{"x0": 1, "vx": 60}``
            for a coordinate a minute later, a function ``x -> (value, gradient)``.
        level : float
            Confidence, between 0 and 1.

        Returns
        -------
        Interval
            By profile likelihood; not the local approximation of `covariance`.

        Raises
        ------
        InputError
            Of a batch, of a robust loss; what does not fit.

        Examples
        --------
        >>> import gramian as gm, numpy as np
        >>> times = np.arange(0.0, 600.0, 20.0)
        >>> ship = gm.tracks.Carrier([[0, 0], [1500, 0], [1500, 1500]], [0.0, 300.0, 600.0])
        >>> sensor = gm.tracks.Sensor.bearing(ship, times, sigma=0.005)
        >>> scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), [sensor])
        >>> bearings = gm.tracks.simulate(scene, [3000.0, 4000.0, -4.0, 2.0], seed=1)
        >>> found = gm.tracks.estimate(scene, [bearings])
        >>> 4000.0 in found.interval("y0")
        True
        """
        return self._likelihood.interval(what, level)

    def region(self, pair: Sequence[Any], level: float = 0.95) -> Region:
        """Return the values of a pair of states or combinations that are allowed.

        Parameters
        ----------
        pair : two of what `interval` takes
        level : float

        Returns
        -------
        Region
            Contours of the profile likelihood.

        Raises
        ------
        InputError
            As `interval`; not two.
        """
        return self._likelihood.region(pair, level)

    def plot(self, view: Literal["map", "space"] | None = None) -> Figure:
        """Draw a single estimate: carriers, track, error ellipses; needs matplotlib.

        Parameters
        ----------
        view : {"map", "space"}, optional
            From above, or in space; by default in space where the motion is.
        """
        if self.code.ndim:
            raise InputError("a picture is of one estimate: this is a batch")
        if view is None:
            view = "space" if self.scene.motion.dimension == 3 else "map"
        if choice(view, "view", ("map", "space")) == "space" and self.scene.motion.dimension == 2:
            raise InputError('view = "space": the motion is in the plane')
        return draw(self, "chart" if view == "map" else "space")

    def summary(self) -> str:
        """Return the estimate, or for a batch what became of its trials, as text."""
        if self.code.ndim:
            counts = np.bincount(self.code.ravel(), minlength=len(STATUSES))
            parts = [f"{n} {word}" for n, word in zip(counts, STATUSES, strict=True) if n]
            return f"{self.code.size} trials: {', '.join(parts)}"
        lines = [f"{str(self.status).upper()}: {self.reason}"]
        width = max(len(name) for name in self.names)
        for name, unit, value, std in zip(
            self.names, self.units, self.state, self.std, strict=True
        ):
            known = f"{value:.6g} +- {brief(std)} {unit}" if std else f"{value:.6g} {unit} (known)"
            lines.append(f"  {name:<{width}}  {'not determined' if np.isinf(std) else known}")
        lines.append(f"  chi2 {brief(float(self.chi2), 4)} with {int(self.dof)} degrees of freedom")
        if self.legs is not None:
            lines.append(self.legs.summary())
        return "\n".join(lines)

    def _as_table(self) -> Columns:
        others = {"status": self.status, "chi2": self.chi2, "p_value": self.p_value}
        return columns_of_states(
            self.names, self.units, {"": self.state, "std": self.std}, others, self.covariance
        )


def solve(
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
) -> TrackEstimate:
    """Return the most likely state of a scene: `estimate` for a motion as it is."""
    z = as_scene(scene).pack(measurements)
    n = scene.n
    mean, sigma = priors_of(scene, prior)
    fixed = np.full(n, np.nan)
    for name, value in as_known(known, scene.names, scene.units, "known").items():
        index = scene.index(name)
        if np.isfinite(sigma[index]):
            raise InputError(f"{name} is in known and in prior: must be in one of them")
        fixed[index] = value
    free = int(np.isnan(fixed).sum())
    if not free:
        raise InputError("known names every state: at least one must be left")
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
    found = scene._inner.estimate(
        z,
        fixed,
        mean,
        sigma,
        begin,
        whole(max_iterations, "max_iterations", 1, 2**31),
        loss,
        tuned,
        whole(polish, "polish", 1, 1000),
        tolerance(rtol),
        number(alpha, "alpha"),
        number(weak_ratio, "weak_ratio"),
    )
    if z.ndim == 1 and np.isnan(found["state"]).any():
        raise InputError(
            "the measurements have no finite likelihood at any of the starts: is a start, or the "
            "mean of a prior, on a sensor or beyond what float64 holds?"
        )
    code = np.asarray(found["code"]).astype(np.int8)
    bad, faults = faulty(z, scene.sigma, scene.channels, found["p_value"])
    code = np.where(bad & (code != 0), np.int8(STATUSES.index("misfit")), code)
    return TrackEstimate(
        scene=scene,
        measurements=z,
        state=found["state"],
        covariance=found["covariance"],
        code=np.asarray(code),
        chi2=found["chi2"],
        cost=found["cost"],
        dof=np.asarray(found["dof"]).astype(int),
        p_value=found["p_value"],
        other=found["other"],
        other_cost=found["other_cost"],
        null_direction=found["null_direction"],
        iterations=found["iterations"].astype(np.int32),
        prior=dict(prior or {}),
        known=dict(known or {}),
        loss=loss,
        faults=faults,
    )


def priors_of(scene: Scene, prior: Mapping[str, tuple[float, float]] | None) -> tuple[Array, Array]:
    """Return means and deviations (n,) of a prior, infinite where there is none."""
    mean, sigma = np.zeros(scene.n), np.full(scene.n, np.inf)
    for name, given in mapping(prior, "prior", "name to (mean, sigma)").items():
        index = scene.index(name)
        mean[index], sigma[index] = as_pair(given, f"prior of {name}", scene.units[index])
    return mean, sigma
