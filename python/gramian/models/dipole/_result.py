"""What locating a dipole answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from gramian._registry import draw
from gramian._text import plain
from gramian.models.dipole._model import NAMES, UNITS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PARTS", "ClosestPoint", "Localization", "Localizations", "Solution", "root"]

Array = NDArray[np.float64]

#: Sizes of vectors, and where those are in the state.
PARTS = {"speed": slice(3, 6), "moment": slice(6, 9)}


@dataclass(frozen=True, eq=False)
class Solution:
    """One pass and how well it fits: see `Localization`."""

    r0: Array
    v: Array
    m: Array
    cost: float


@dataclass(frozen=True, eq=False)
class Localization:
    """The answer of `localize`.

    Attributes
    ----------
    r0, v, m : ndarray, shape (3,)
        Position at the first time (m), velocity (m/s), moment (A m^2).
    std : ndarray, shape (9,)
        Standard deviations of (r0, v, m) at the constrained bound; 0 for what is known.
    covariance : ndarray, shape (9, 9)
        The constrained Cramer-Rao bound at the answer.
    cost : float
        Sum of squared residuals over sigma^2, priors included.
    mirror : Solution or None
        The best pass near the mirror image. Where nothing tells the two apart it
        has the same cost. None where there is none.
    origin : float
        The instant of r0: the first time of the record.
    times : ndarray, shape (K,)
        The samples used.
    residuals : ndarray, shape (K, S, 3)
        Field minus background minus model, tesla.
    model : ndarray, shape (K, S, 3)
        The field of the answer, without background.
    background : ndarray, shape (S, 3)
        What was taken off or fitted, tesla.
    weights : ndarray, shape (K, S, 3)
        Between 0 (a spike) and 1.
    sigma : float
        The standard deviation given or estimated, tesla.
    explained : float
        Fraction of the field's sum of squares, without background and spikes,
        that the model explains.
    spikes : int
        Samples of a sensor that were rejected.
    dropped : int
        Samples with NaN that were left out, if asked.
    converged : bool
    closest : ClosestPoint
        Closest approach to the first sensor.
    known, prior : mapping
        The knowledge used.
    """

    r0: Array
    v: Array
    m: Array
    std: Array
    covariance: Array
    cost: float
    mirror: Solution | None
    origin: float
    times: Array
    residuals: Array
    model: Array
    background: Array
    weights: Array
    sigma: float
    explained: float
    spikes: int
    dropped: int
    converged: bool
    closest: ClosestPoint
    known: Mapping[str, float]
    prior: Mapping[str, tuple[float, float]]
    sensors: Array = field(repr=False)

    @property
    def speed(self) -> tuple[float, float]:
        """The speed and its standard deviation, m/s."""
        return self._size(self.v, "speed")

    @property
    def moment(self) -> tuple[float, float]:
        """The size of the moment and its standard deviation, A m^2."""
        return self._size(self.m, "moment")

    @property
    def status(self) -> Literal["good", "weak"]:
        """Whether to rely on the answer.

        It is weak where the closest range is known to no better than a third, a
        vector (r0, v or m) no better than its length, or where the dipole explains
        less than half of the field.
        """
        vectors = zip((self.r0, self.v, self.m), self.std.reshape(3, 3), strict=True)
        vague = any(np.linalg.norm(std) > np.linalg.norm(x) > 0 for x, std in vectors)
        near = self.closest
        if vague or near.range_std > near.range / 3 or self.explained < 0.5:
            return "weak"
        return "good"

    @property
    def direction(self) -> Array:
        """The direction of travel, a unit vector."""
        unit: Array = self.v / np.linalg.norm(self.v)
        return unit

    @property
    def no_mirror(self) -> str:
        """Why there is no mirror image, in words."""
        if any(self.known.get(name) for name in NAMES[:6]):
            return "excluded by what is known"
        return "nothing fits there"

    def _size(self, vector: Array, name: str) -> tuple[float, float]:
        size, part = float(np.linalg.norm(vector)), PARTS[name]
        if name in self.known:
            return size, 0.0
        along = vector / size if size > 0 else vector
        return size, root(along @ self.covariance[part, part] @ along)

    def to_dict(self) -> dict[str, Any]:
        """Return the answer, without the samples, as plain lists and numbers, fit for JSON."""
        mirror = self.mirror and {
            "r0": plain(self.mirror.r0),
            "v": plain(self.mirror.v),
            "m": plain(self.mirror.m),
            "cost": plain(self.mirror.cost),
        }
        return {
            "names": list(NAMES),
            "units": list(UNITS),
            "r0": plain(self.r0),
            "v": plain(self.v),
            "m": plain(self.m),
            "std": plain(self.std),
            "covariance": plain(self.covariance),
            "cost": plain(self.cost),
            "mirror": mirror,
            "speed": plain(np.array(self.speed)),
            "moment": plain(np.array(self.moment)),
            "closest": {
                "time": self.closest.time,
                "time_std": self.closest.time_std,
                "position": list(self.closest.position),
                "range": self.closest.range,
                "range_std": self.closest.range_std,
            },
            "background": plain(self.background),
            "sigma": self.sigma,
            "explained": self.explained,
            "status": self.status,
            "origin": self.origin,
            "samples": len(self.times),
            "spikes": self.spikes,
            "dropped": self.dropped,
            "converged": self.converged,
            "known": dict(self.known),
            "prior": {name: list(value) for name, value in self.prior.items()},
        }

    def summary(self) -> str:
        """Return the answer as text."""
        near = self.closest
        lines = [] if self.status == "good" else ["WEAKLY DETERMINED: do not rely on it"]
        lines += [
            f"closest at {near.range:.3g} m (+- {near.range_std:.2g}), "
            f"{near.time:.4g} s (+- {near.time_std:.2g})",
            f"speed {self.speed[0]:.4g} m/s (+- {self.speed[1]:.2g}), "
            f"moment {self.moment[0]:.4g} A m^2 (+- {self.moment[1]:.2g})",
        ]
        values = np.concatenate([self.r0, self.v, self.m])
        for name, unit, value, std in zip(NAMES, UNITS, values, self.std, strict=True):
            how = f"+- {std:.2g}" if std > 0 else "known"
            lines.append(f"  {name}  {value:10.4g} {unit:6s} {how}")
        lines.append(
            f"explains {100 * self.explained:.1f} % of the field; sigma {self.sigma:.3g} T, "
            f"{len(self.times)} samples, {self.spikes} spikes, {self.dropped} dropped"
        )
        if self.mirror is None:
            lines.append(f"mirror image: {self.no_mirror}")
        elif self.mirror.cost <= self.cost * (1 + 1e-6) + 1e-9:
            lines.append("mirror image (-r0, -v, m): fits exactly as well, so either may be true")
        else:
            lines.append(
                f"mirror image: fits worse, cost {self.mirror.cost:.6g} against {self.cost:.6g}"
            )
        if not self.converged:
            lines.append("the search had not ended when it was stopped")
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Draw the field with the model and the residuals; needs matplotlib."""
        return draw(self, "fit")


@dataclass(frozen=True)
class ClosestPoint:
    """The closest approach to a sensor: when, where, how near (seen from the sensor)."""

    time: float
    time_std: float
    position: tuple[float, float, float]
    range: float
    range_std: float


@dataclass(frozen=True, eq=False)
class Localizations:
    """The answers of `localize_many`, without their bounds.

    Attributes
    ----------
    states : ndarray, shape (..., 9)
        (r0, v, m).
    costs : ndarray, shape (...)
    mirrors : ndarray, shape (..., 9)
        The best near each mirror image; `inf` where knowledge excludes it.
    mirror_costs : ndarray, shape (...)
    sigmas : ndarray, shape (...)
    converged : ndarray of bool, shape (...)
    """

    states: Array
    costs: Array
    mirrors: Array
    mirror_costs: Array
    sigmas: Array
    converged: NDArray[np.bool_]


def root(variance: float | Array) -> float:
    """Return the root of a variance, 0 for one that rounding made negative."""
    return float(np.sqrt(np.maximum(variance, 0.0)))
