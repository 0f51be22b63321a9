"""The estimate of a scene: with the motion as it is, or with the number of legs chosen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from numpy.typing import ArrayLike

from gramian.exceptions import InputError
from gramian.models.tracks._legs import choose_legs
from gramian.models.tracks._scene import Scene
from gramian.models.tracks._solve import Loss, TrackEstimate, solve

__all__ = ["estimate"]


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
) -> TrackEstimate:
    """Return the most likely state of a scene, with its covariance and its status.

    Parameters
    ----------
    scene : Scene
    measurements : array_like, shape (..., m), or one for each sensor
        See `Scene.pack`; NaN for a missing sample. Leading axes are a batch.
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
        Level of the test for "misfit".
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
    TrackEstimate
        Look at its status.

    Raises
    ------
    InputError
        More states than measurements and priors; names that are none of the states;
        measurements that do not fit their sensors.

    Notes
    -----
    Damped Gauss-Newton steps on orthogonally reduced rows, from several starts
    (Levenberg-Marquardt; Moré 1978). Trials run on all threads.

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
    >>> gm.tracks.estimate(scene, [bearings]).status
    'determined'
    """
    if legs is not None and legs != "auto":
        raise InputError(f"legs = {legs!r}: must be 'auto', or left out")
    options: dict[str, Any] = {
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
    if legs == "auto":
        return choose_legs(scene, measurements, most=most_legs, **options).best
    return solve(scene, measurements, start=start, **options)
