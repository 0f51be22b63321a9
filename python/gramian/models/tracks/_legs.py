"""How many legs a track has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian._answers import Answer, Columns
from gramian._arrays import number, whole
from gramian._options import fraction
from gramian._registry import draw
from gramian._text import brief
from gramian.exceptions import InputError
from gramian.models.tracks._many import Estimates, estimate_many
from gramian.models.tracks._motion import Motion
from gramian.models.tracks._scene import Scene, as_scene, simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["LegChoice", "choose_legs", "leg_penalty"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class LegChoice(Answer):
    """How the number of legs was chosen.

    Attributes
    ----------
    estimates : tuple of Estimates
        With one leg, two, three ..
    count : ndarray of int, shape (...)
        How many legs were chosen in each trial.
    cost : ndarray, shape (legs, ...)
        Chi-square of each, priors included.
    penalty : ndarray, shape (legs,)
        What was added to each before the smallest sum was taken.
    best : Estimates
        The estimate of the number that was chosen; in a batch that chose different
        numbers, the one that most trials chose.
    """

    estimates: tuple[Estimates, ...]
    count: NDArray[np.int64]
    cost: Array
    penalty: Array

    @cached_property
    def best(self) -> Estimates:
        """The estimate of the number that was chosen, by most trials of a batch."""
        usual = int(np.bincount(np.ravel(self.count)).argmax())
        return self.estimates[usual - 1]

    @property
    def gain(self) -> Array:
        """Fall of chi-square with each further leg, shape (legs - 1, ...)."""
        return -np.diff(self.cost, axis=0)

    def summary(self) -> str:
        """Return a table of the numbers of legs."""
        if self.count.ndim:
            counts = np.bincount(self.count.ravel())
            parts = [f"{n} with {k}" for k, n in enumerate(counts) if n]
            return f"legs of {self.count.size} trials: {', '.join(parts)}"
        lines = ["  legs   chi2     dof   gain     penalty  turns"]
        for k, one in enumerate(self.estimates):
            gain = "" if k == 0 else f"{brief(float(self.gain[k - 1]), 4)}"
            turns = ", ".join(
                f"{float(one.value(f'turn_{j}')) + one.scene.origin:.4g} s" for j in range(1, k + 1)
            )
            mark = "*" if k + 1 == int(self.count) else " "
            lines.append(
                f"  {k + 1}{mark}     {float(one.cost):<8.4g} {int(one.dof):<5} {gain:<8} "
                f"{self.penalty[k]:<8.3g} {turns}"
            )
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Return a picture of the residuals with one leg and with those chosen."""
        return draw(self, "legs")

    def _verdict_line(self) -> str:
        if self.count.ndim:
            return self.summary()
        turns = int(self.count) - 1
        return f"{turns + 1} leg{'s' if turns else ''}, {turns} turn{'' if turns == 1 else 's'}"

    def _as_table(self) -> Columns:
        if self.count.ndim:
            raise InputError("a table is of one estimate: this is a batch")
        chosen = np.arange(1, len(self.estimates) + 1) == int(self.count)
        values = {"chi2": self.cost, "penalty": self.penalty, "chosen": chosen}
        return Columns("legs", range(1, len(self.estimates) + 1), values, {})


def leg_penalty(
    scene: Scene,
    state: ArrayLike | Mapping[str, float],
    *,
    level: float = 0.05,
    trials: int = 400,
    seed: int = 0,
    **options: Any,
) -> float:
    """Return how far chi-square falls by chance when a leg is added to a true track.

    Parameters
    ----------
    scene : Scene
        With a motion of legs of unknown times, or constant velocity.
    state : array_like, shape (n,), or mapping
        The true state of that motion.
    level : float
        The share of trials in which a further leg may be chosen by chance.
    trials, seed : int
        Of the simulation.
    **options
        Of `estimate_many`: prior, known.

    Returns
    -------
    float
        The quantile 1 - level of the fall, for ``penalty`` of `choose_legs`. A turn time
        that is scanned takes the best of many chances, so that the fall is no
        chi-square of the three parameters.

    Examples
    --------
    >>> import gramian as gm, numpy as np
    >>> times = np.arange(0.0, 600.0, 20.0)
    >>> path = [[0, 0], [1500, 0], [1500, 1500]]
    >>> ship = gm.tracks.Carrier(path, [0.0, 300.0, 600.0])
    >>> sensor = gm.tracks.Sensor.bearing(ship, times, sigma=0.005)
    >>> scene = gm.tracks.Scene(gm.tracks.Motion.legs(count=1), [sensor])
    >>> bool(gm.tracks.leg_penalty(scene, [3000.0, 4000.0, -4.0, 2.0], trials=40) > 3)
    True
    """
    scene, level = as_scene(scene), fraction(level, "level")
    motion = _legs_of(scene.motion, scene.motion.count + 1)
    z = simulate(scene, state, trials=whole(trials, "trials", 2), seed=seed)
    plain = estimate_many(scene, z, **options)
    more = estimate_many(scene.with_motion(motion), z, **options)
    return float(np.quantile(plain.cost - more.cost, 1 - level))


def choose_legs(
    scene: Scene,
    measurements: ArrayLike | Sequence[ArrayLike],
    *,
    most: int = 3,
    penalty: float | None = None,
    **options: Any,
) -> LegChoice:
    """Return estimates with one leg, two, three .., and the number that is chosen.

    Parameters
    ----------
    scene : Scene
        Whose motion is one of legs, or constant velocity: the number does not matter.
    measurements : array_like, shape (..., m), or one for each sensor
        See `Scene.pack`. Leading axes are a batch.
    most : int
        Legs at most, 1 to 5.
    penalty : float, optional
        What a further leg must take off chi-square; by default that of the Bayesian
        information criterion, parameters times log m (three parameters: two of velocity
        and the turn's time). `leg_penalty` calibrates it by simulation.
    **options
        Of `estimate_many`.

    Returns
    -------
    LegChoice

    Raises
    ------
    InputError
        A motion that is none of legs.

    Notes
    -----
    The times of turns are scanned over the record and polished. A leg with fewer than
    four bearings of a single sensor is not determined by itself.

    Examples
    --------
    >>> import gramian as gm, numpy as np
    >>> times = np.arange(0.0, 600.0, 20.0)
    >>> path = [[0, 0], [1500, 0], [1500, 1500]]
    >>> ship = gm.tracks.Carrier(path, [0.0, 300.0, 600.0])
    >>> sensor = gm.tracks.Sensor.bearing(ship, times, sigma=0.005)
    >>> scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), [sensor])
    >>> bearings = gm.tracks.simulate(scene, [3000.0, 4000.0, -4.0, 2.0], seed=1)
    >>> int(gm.tracks.choose_legs(scene, [bearings], most=2).count)
    1
    """
    most = whole(most, "most", 1, 5)
    motion = as_scene(scene).motion
    steady = motion.kind == "steady_legs"
    straight = motion.kind == "polynomial" and motion.order == 1
    if not (straight or motion.kind == "legs" or steady):
        raise InputError(f"legs = 'auto' with a motion of {motion.kind}: must be one of legs")
    found = []
    z = scene.pack(measurements)
    for k in range(1, most + 1):
        try:
            found.append(estimate_many(scene.with_motion(_legs_of(motion, k)), z, **options))
        except InputError:
            # More states than measurements: no more legs can be determined.
            if not found:
                raise
            break
    cost = np.array([one.cost for one in found])
    if penalty is None:
        m = max(int(np.count_nonzero(~np.isnan(z), axis=-1).max()), 2)
        extra = np.array([one.scene.n - found[0].scene.n for one in found]) * np.log(m)
    else:
        extra = number(penalty, "penalty") * np.arange(len(found))
    total = cost + extra.reshape(-1, *[1] * (cost.ndim - 1))
    count = 1 + np.argmin(total, axis=0)
    return LegChoice(tuple(found), np.asarray(count), cost, extra)


def _legs_of(motion: Motion, count: int) -> Motion:
    steady = motion.kind == "steady_legs"
    return Motion.legs(count=count, constant_speed=steady, dimension=motion.dimension)
