"""The estimate of a scene from one record: with the motion as it is, or with legs chosen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian._options import choice
from gramian._registry import draw
from gramian._text import above_noise, describe_direction
from gramian._text import number as readable
from gramian.estimation import Estimate as General
from gramian.estimation import estimate as estimate_model
from gramian.exceptions import InputError
from gramian.models.tracks._legs import LegChoice, choose_legs
from gramian.models.tracks._many import STATUSES, Estimates, Loss, estimate_many, knowledge
from gramian.models.tracks._model import TracksModel
from gramian.models.tracks._scene import Scene, as_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Estimate", "estimate"]

Array = NDArray[np.float64]

#: So many starts are followed again where what they led to ran away.
_STARTS = 8


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Estimate(General):
    """The answer of `estimate`: a `gramian.Estimate` of the states of a scene.

    Attributes
    ----------
    legs : LegChoice or None
        How the number of legs was chosen, where it was.
    """

    legs: LegChoice | None = None
    _found: Estimates

    _not_in_dict = General._not_in_dict | {"legs"}

    @property
    def scene(self) -> Scene:
        """The scene, with the motion that was estimated."""
        scene: Scene = self.model.scene
        return scene

    @property
    def _free(self) -> list[int]:
        return [self.scene.index(name) for name in self.names]

    @property
    def null_combinations(self) -> tuple[str, ...]:
        """Combinations of the states that change no measurement, in words."""
        if (own := super().null_combinations) or not self._is_unobservable:
            return own
        # Next to a singular place the rows alone are no guide: the starts were asked too.
        direction = self._found.null_direction[self._free]
        return (describe_direction(above_noise(direction), self.names),)

    @property
    def _is_unobservable(self) -> bool:
        return STATUSES[int(self._found.code)] == "unobservable"

    @cached_property
    def covariance(self) -> Array:
        """The local Gaussian approximation (n, n); of a robust loss the sandwich formula."""
        if self._loss[0] == "squares" and not self._is_unobservable:
            return super().covariance
        return np.asarray(self._found.covariance[np.ix_(self._free, self._free)])

    @cached_property
    def std(self) -> Array:
        """Standard deviations (n,) of the local Gaussian approximation; `inf` for none."""
        if self._loss[0] == "squares" and not self._is_unobservable:
            return super().std
        return np.sqrt(np.diagonal(self.covariance))

    @cached_property
    def _weak(self) -> str:
        usual = self._usual_range
        if usual:
            vague = float(self._found.vagueness)
            if np.isinf(vague):
                return "positions are not determined where the steps ended"
            if vague > self.weak_ratio:
                return (
                    f"positions are known to {readable(vague * usual, 2)} m at worst, at a range "
                    f"of {readable(usual, 2)} m"
                )
            if self._loss[0] == "squares":
                for name in self.model.functions:
                    interval = self.interval(name)
                    if not interval.length <= 2 * 1.96 * self.weak_ratio * usual:
                        return str(interval)
        return ""

    @cached_property
    def _usual_range(self) -> float:
        """The median distance from the nearest carrier, m; 0 where no sensor has one."""
        medians = []
        for sensor in self.scene.sensors:
            if sensor.carrier is not None and sensor.times.size:
                places = sensor.carrier.at(sensor.times)[0]
                track = self.scene.track(self._whole, sensor.times)[:, : places.shape[1]]
                medians.append(float(np.median(np.linalg.norm(track - places, axis=1))))
        return min(medians, default=0.0)

    def track(self, times: ArrayLike) -> Array:
        """Return positions (k, D) at these times."""
        return self.scene.track(self._whole, times)

    def plot(self, view: Literal["map", "space"] | None = None) -> Figure:
        """Draw carriers, track and error ellipses; needs matplotlib.

        Parameters
        ----------
        view : {"map", "space"}, optional
            From above, or in space; by default in space where the motion is.
        """
        if view is None:
            view = "space" if self.scene.motion.dimension == 3 else "map"
        if choice(view, "view", ("map", "space")) == "space" and self.scene.motion.dimension == 2:
            raise InputError('view = "space": the motion is in the plane')
        return draw(self, "chart" if view == "map" else "space")

    def summary(self, level: float = 0.95) -> str:
        """Return status, states with their intervals, fit and legs as text."""
        lines = [super().summary(level)]
        if self.legs is not None:
            lines.append(self.legs.summary())
        return "\n".join(lines)


def estimate(
    scene: Scene,
    measurements: ArrayLike | Sequence[ArrayLike],
    *,
    prior: Mapping[str, tuple[float, float]] | None = None,
    known: Mapping[str, float] | None = None,
    loss: Loss = "squares",
    constant: float | None = None,
    start: ArrayLike | Mapping[str, float] | None = None,
    legs: Literal["auto"] | None = None,
    most_legs: int = 3,
    alpha: float = 0.001,
    weak_ratio: float = 0.25,
    max_iterations: int = 60,
    polish: int = 4,
    rtol: float | None = None,
    **options: Any,
) -> Estimate:
    """Return the most likely state of a scene, and whether it may be believed.

    Parameters
    ----------
    scene : Scene
    measurements : array_like, shape (m,), or one for each sensor
        See `Scene.pack`; NaN for a missing sample.
    prior : mapping of str to (mean, sigma), optional
        What is known of states beforehand.
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
    legs : {"auto"}, optional
        Chooses the number of legs up to `most_legs`, see `choose_legs`; the motion of
        the scene is then one of legs, whatever their number.
    most_legs : int
    alpha : float
        Level of the tests for "misfit": of chi-square, of the score tests of the
        alternatives together, of the correlation of neighbouring residuals.
    weak_ratio : float
        "weak" where the deviation of a position, at any time while the sensors look,
        exceeds this many times the median distance from the nearest carrier, or the
        interval of the first or last range is that of such a deviation.
    max_iterations : int
        Steps at most from each start.
    polish : int
        How many of the starts are followed to their end.
    rtol : float, optional
        Relative tolerance of the rank decision; by default what rounding of the coordinates
        and times calls for.
    **options
        As for `gramian.estimate`: a box and starts in it, `chance`, `search`.

    Returns
    -------
    Estimate
        Look at its status first. A motion of the next order, turns, and of each sensor a
        bias, a scale and an offset of its clock are among the alternatives of its fit.

    Raises
    ------
    InputError
        More states than measurements and priors; names that are none of the states;
        measurements that do not fit their sensors; a batch of records.

    See Also
    --------
    estimate_many : Many records at once, without alternatives, other solutions, intervals.

    Notes
    -----
    Damped Gauss-Newton steps on orthogonally reduced rows, from several starts
    (Levenberg-Marquardt; Moré 1978).

    Examples
    --------
    >>> import gramian as gm, numpy as np
    >>> times = np.arange(0.0, 600.0, 20.0)
    >>> path = [[0, 0], [1500, 0], [1500, 1500]]
    >>> ship = gm.tracks.Carrier(path, [0.0, 300.0, 600.0])
    >>> sensor = gm.tracks.Sensor.bearing(ship, times, sigma=0.005)
    >>> scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), [sensor])
    >>> truth = {"x0": 3000.0, "y0": 4000.0, "vx": -4.0, "vy": 2.0}
    >>> bearings = gm.tracks.simulate(scene, truth, seed=1)
    >>> found = gm.tracks.estimate(scene, [bearings])
    >>> found.status, 4000.0 in found.interval("y0")
    ('determined', True)
    """
    if legs is not None and legs != "auto":
        raise InputError(f"legs = {legs!r}: must be 'auto', or left out")
    z = TracksModel(as_scene(scene)).measured(measurements)
    fit: dict[str, Any] = {
        "prior": prior,
        "known": known,
        "loss": loss,
        "constant": constant,
        "alpha": alpha,
        "weak_ratio": weak_ratio,
        "max_iterations": max_iterations,
        "polish": polish,
        "rtol": rtol,
    }
    chosen = None
    if legs == "auto":
        chosen = choose_legs(scene, z, most=most_legs, **fit)
        found = chosen.best
    else:
        found = estimate_many(scene, z, start=start, **fit)
    states = np.stack([found.state, found.other])
    if loss == "tukey":
        # Its loss has minima where most measurements count nothing; Huber's has not.
        convex = fit | {"loss": "huber", "constant": None}
        near = estimate_many(found.scene, z, start=start if legs is None else None, **convex)
        states = np.vstack([near.state, states])
    states = states[np.isfinite(states).all(axis=1)]
    if len(states) and not np.isfinite(found.vagueness):
        # They ran away: from where they began it is seen how far the likelihood grows.
        begun = found.scene._inner.starts(z, *knowledge(found.scene, prior, known))
        states = np.vstack([begun[:_STARTS], states])
    if not len(states):
        raise InputError(
            "the measurements have no finite likelihood at any of the starts: is a start, or the "
            "mean of a prior, on a sensor or beyond what float64 holds?"
        )
    general = estimate_model(
        TracksModel(found.scene, rtol),
        z,
        start=states,
        prior=prior,
        known=known,
        loss=loss,
        constant=constant,
        alpha=alpha,
        weak_ratio=weak_ratio,
        **options,
    )
    if STATUSES[int(found.code)] != "unobservable":
        found = _found_at(general, found, z, fit)
    parts = {part.name: getattr(general, part.name) for part in fields(General)}
    answer = Estimate(**parts, legs=chosen, _found=found)
    if not answer._is_unobservable:
        return answer
    # Any of the states that fit: further steps only run along the null direction.
    return replace(answer, state=found.state[answer._free], converged=True, others=())


def _found_at(general: General, found: Estimates, z: Array, fit: Mapping[str, Any]) -> Estimates:
    """Return what the batch says of the answer, where this is not the state that it ended at."""
    off = np.abs(general._whole - found.state)
    off = off[[found.scene.index(name) for name in general.names]]
    if (off <= 0.01 * general.std).all():
        return found
    there = estimate_many(found.scene, z, start=general._whole, **fit)
    return there if np.isfinite(there.state).all() else found
