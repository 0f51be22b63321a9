"""What locating a dipole answers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._answers import Answer, Columns, columns_of_states
from gramian._options import choice
from gramian._registry import draw
from gramian._text import brief
from gramian.estimation import Estimate, Fit, Interval, Region
from gramian.estimation import Solution as Other
from gramian.exceptions import InputError
from gramian.models.dipole._estimate import PARTS, Description, DipoleModel
from gramian.models.dipole._model import NAMES, UNITS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["ClosestPoint", "Localization", "Localizations", "Solution", "deviation", "information"]

Array = NDArray[np.float64]

#: Why deviations are infinite.
_NO_LEVEL = (
    "the noise level cannot be estimated from as many numbers as states, and so no deviation: "
    "give sigma"
)

#: What `localize_many` says of an answer; "not_looked" where it was not asked.
STATUSES = (
    "unobservable",
    "not_converged",
    "ambiguous",
    "weak",
    "determined",
    "not_looked",
    "misfit",
)


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Answer):
    """One pass and how well it fits: see `Localization`."""

    r0: Array
    v: Array
    m: Array
    cost: float


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Localization(Estimate):
    """The answer of `localize`: a `gramian.Estimate`, with what is special to a pass.

    Attributes
    ----------
    r0, v, m : ndarray, shape (3,)
        Position at the first time (m), velocity (m/s), moment (A m^2).
    pass_std : ndarray, shape (9,)
        Standard deviations of (r0, v, m); 0 for what is known.
        `names`, `state` and `std` are of what was estimated: see `DipoleModel`.
    pass_covariance : ndarray, shape (9, 9)
        The constrained Cramer-Rao bound at the answer. Where the noise was estimated too, the
        variance of the measured field is that of Student's t, ``freedom / (freedom - 2)``
        times as large; below three degrees of freedom that of three.
    freedom : float
        Degrees of freedom of Student's t, which `interval`, `std` and `pass_std` follow where
        sigma or the correlation was estimated; `inf` where both were given. They are 0 where as
        many numbers as states are there: the noise cannot be estimated then, deviations are
        `inf`, intervals open, and the status is "weak" at best.
    cost : float
        Sum of squared residuals over sigma^2, priors included.
    mirror : Solution or None
        The best pass near the mirror image. Where nothing tells the two apart it
        has the same cost. None where there is none.
    origin : float
        The instant of r0: the first time of the record.
    times : ndarray, shape (K,)
        The samples used.
    residuals : ndarray, shape (K, S, 3), or (K, S, 1) of the total field
        Field minus background minus model, tesla; NaN where there is no field.
    predicted : ndarray, shape as `residuals`
        The field of the answer, without background; of the total field without ``|ambient|``.
    background : ndarray, shape (S, 3) or (S, 1)
        What was taken off or fitted, tesla; of the total field beside ``|ambient|``.
    weights : ndarray, shape as `residuals`
        Between 0 (a spike, or a number that is not used) and 1.
    sigma : float
        The standard deviation given or estimated, tesla; of those that differ the smallest.
    sigmas : ndarray, shape as `residuals`
        Of each number; `inf` for what was not measured.
    sigma_given : bool
        Whether it was given. Otherwise chi2 is what it was estimated from, and its p NaN.
    explained : float
        Fraction of the field's sum of squares, without background and spikes,
        that the model explains.
    spikes : int
        Samples of a sensor in which a number was rejected.
    dropped : int
        Numbers of the field that are NaN and were left out, if asked.
    correlation : float
        Of the noise of neighbouring samples of a channel.
    correlation_given : bool
        Whether it was given, not fitted.
    candidates : tuple of (Description, float)
        What was tried, with Schwarz's criterion (BIC), the chosen first.
    closest : ClosestPoint
        Closest approach to the first sensor; of several dipoles that of their centre, see
        `DipoleModel.centre`.
    """

    r0: Array
    v: Array
    m: Array
    pass_std: Array
    pass_covariance: Array
    cost: float
    mirror: Solution | None
    origin: float
    times: Array
    residuals: Array
    predicted: Array
    background: Array
    weights: Array
    sigma: float
    sigmas: Array
    sigma_given: bool
    explained: float
    spikes: int
    dropped: int
    closest: ClosestPoint
    sensors: Array
    correlation: float = 0.0
    correlation_given: bool = True
    freedom: float = math.inf
    candidates: tuple[tuple[Description, float], ...] = ()
    #: Of one that is widened: why the answer that it comes from does not fit.
    _misfit_before: str = ""

    _more_in_dict = (*Estimate._more_in_dict, "speed", "moment")
    _not_in_dict = Estimate._not_in_dict | {
        "measurements",
        "times",
        "residuals",
        "predicted",
        "weights",
        "sigmas",
        "sensors",
        "candidates",
    }

    @cached_property
    def _handle(self) -> _core.Model:
        # Knowledge is part of the model.
        handle: _core.Model = self.model.handle(self.measurements)
        return handle

    @cached_property
    def fit(self) -> Fit:
        """How well the model fits, and what would explain that it does not."""
        found = super().fit
        # Where the noise was estimated from the residuals they tell nothing of it.
        return found if self.sigma_given else replace(found, p_value=np.nan)

    @cached_property
    def _analysis(self) -> _core.Analysis:
        return information(self.model, self._handle, self.state, self.freedom)

    @cached_property
    def covariance(self) -> Array:
        """The local Gaussian approximation (n, n); `inf` where none exists."""
        found = super().covariance
        return np.full(found.shape, np.inf) if self.freedom == 0 else found

    @cached_property
    def std(self) -> Array:
        """Standard deviations (n,) of the local Gaussian approximation."""
        found = super().std
        return np.full(found.shape, np.inf) if self.freedom == 0 else found

    def interval(
        self,
        what: str
        | Mapping[str, float]
        | ArrayLike
        | Callable[[Array], float | tuple[float, Array]],
        level: float = 0.95,
    ) -> Interval:
        """Return the values of a state or function that the measurements allow.

        As `gramian.Estimate.interval`; any, where the noise level cannot be estimated.
        """
        if self.freedom > 0:
            return super().interval(what, level)
        name, unit, _, value = self._function(what)
        return Interval(name, unit, level, value, ((None, None),), math.inf, True)

    def region(self, pair: Sequence[Any], level: float = 0.95) -> Region:
        """Return the values of a pair of states or functions that the measurements allow.

        As `gramian.Estimate.region`.

        Raises
        ------
        InputError
            As there, and where the noise level cannot be estimated.
        """
        self._require_noise()
        return super().region(pair, level)

    def sample(self, count: int = 256, seed: int = 0) -> Array:
        """Return states (count, n) spread as the likelihood is, priors included.

        As `gramian.Estimate.sample`.

        Raises
        ------
        InputError
            As there, and where the noise level cannot be estimated.
        """
        self._require_noise()
        return super().sample(count, seed)

    def _require_noise(self) -> None:
        if self.freedom == 0:
            raise InputError(_NO_LEVEL)

    def _rise(self, level: float, dof: int) -> float:
        if math.isinf(self.freedom):
            return super()._rise(level, dof)
        if self.freedom == 0:
            return math.inf
        from scipy.special import fdtri

        return dof * float(fdtri(dof, max(self.freedom, 1.0), level))

    def sample_passes(self, count: int = 256, seed: int = 0) -> Array:
        """Return passes (count, 9) spread as the likelihood is: `sample`, as (r0, v, m)."""
        return np.array([self.model.expand(x)[0] for x in self.sample(count, seed)])

    @cached_property
    def _spread(self) -> float:
        """By how much deviations grow where the residuals are larger than noise, and correlated.

        As the mean of a series has the variance of its samples times their autocorrelation
        time, the sum of all autocorrelations, up to the first that is not positive.
        """
        there = (self.weights > 0) & np.isfinite(self.residuals)
        left = np.where(there, self.residuals, 0.0)
        left = (left / self.sigmas).reshape(len(self.times), -1)
        squares = float((left**2).sum())
        freedom = max(int(there.sum()) - len(self.state), 1)
        if squares == 0.0:
            return 1.0
        time = 1.0
        for lag in range(1, max(len(left) // 4, 1)):
            share = float((left[lag:] * left[:-lag]).sum()) / squares
            if share <= 0.0:
                break
            time += 2.0 * share
        return float(np.sqrt(max(time * squares / freedom, 1.0)))

    def widened(self) -> Localization:
        """Return the same answer with deviations and intervals that allow for its residuals.

        Returns
        -------
        Localization
            The same pass with a larger `sigma`, so that `std`, `interval` and `region` are
            wider. It is never smaller than before.

        Notes
        -----
        The residuals of a body that is no dipole are correlated. Here they count as noise:
        their variance times their autocorrelation time takes the place of sigma^2. This does
        not bound the error of a model that does not fit, and `status` stays "misfit". A
        description that fits is better (`sources=`, `motion=`).

        Examples
        --------
        >>> import numpy as np, gramian as gm
        >>> t = np.arange(0, 20, 0.2)
        >>> y = gm.dipole.measure([-10, -10, 5], [1, 1, 0], [10, 20, 10], t)
        >>> y += gm.dipole.measure([-13, -13, 5], [1, 1, 0], [5, -10, 10], t)
        >>> found = gm.dipole.localize(t, y, {"z": 5.0, "vz": 0.0})
        >>> wide = found.widened()
        >>> found.status, bool(wide.speed[1] > 3 * found.speed[1])
        ('misfit', True)
        """
        if self.freedom == 0:
            return self
        factor = self._spread
        model = replace(self.model, weights=self.model.weights / factor)
        wide = replace(
            self,
            model=model,
            sigma=self.sigma * factor,
            sigmas=self.sigmas * factor,
            cost=self.cost / factor**2,
            mirror=self.mirror and replace(self.mirror, cost=self.mirror.cost / factor**2),
            others=tuple(_nearer(other, factor) for other in self.others),
            _misfit_before=self._misfit,
        )
        # Priors do not widen.
        columns = model.expand(self.state)[1]
        spread = columns @ wide.covariance @ columns.T
        by_range = model.functions["range"][0](self.state)[1]
        near = replace(
            self.closest,
            time_std=self.closest.time_std * factor,
            range_std=deviation(by_range, wide.covariance),
        )
        std = np.sqrt(np.maximum(np.diag(spread), 0.0))
        return replace(wide, pass_std=std, pass_covariance=spread, closest=near)

    @cached_property
    def _misfit(self) -> str:
        return self._misfit_before or super()._misfit or self._growing

    @property
    def _exact(self) -> bool:
        """Whether the record has no noise to speak of."""
        return self.sigma < 1e-9 * float(np.abs(self.predicted).max(initial=0.0))

    @property
    def _colored(self) -> str:
        # With a robust loss pairs of spikes that are not rejected are left in.
        level = self.alpha if self._loss[0] == "squares" else self.alpha**2
        if self.fit.lag1[3] < level and not (self._exact or self.fit.warning):
            return f'{self.fit.correlated}; correlation="fit" is for noise that is not white'
        return ""

    @property
    def _growing(self) -> str:
        """What says that the residuals grow with the field, in words; empty otherwise.

        Noise does not know of the pass: what grows with it is an error of the model, which a
        fitted deviation and correlation would pass for noise. Spearman's rank correlation of
        the squares of what is not told by the sample before, at a tenth of `alpha`.
        """
        if self._exact or self.fit.warning:
            return ""
        left = self.residuals * (self.sigma / self.sigmas)
        lead = left[1:] - self.correlation * left[:-1]
        there = np.isfinite(lead)
        known = there.any(axis=(1, 2))
        if known.sum() < 20:
            return ""
        size = np.where(there, lead, 0.0) ** 2
        size = size.sum(axis=(1, 2)) / np.maximum(there.sum(axis=(1, 2)), 1)
        from scipy.special import ndtr
        from scipy.stats import rankdata

        field = (self.predicted[1:] ** 2).sum(axis=(1, 2))
        with np.errstate(invalid="ignore", divide="ignore"):
            correlation = float(np.corrcoef(rankdata(field[known]), rankdata(size[known]))[0, 1])
        p_value = float(ndtr(-correlation * np.sqrt(known.sum() - 1)))
        if not p_value < 0.1 * self.alpha:
            return ""
        return (
            f"the residuals grow with the field (rank correlation {brief(correlation, 2)}, "
            f"p = {brief(p_value, 2)}), as noise does not: the model does not fit"
        )

    @cached_property
    def _weak(self) -> str:
        if self.freedom == 0:
            return _NO_LEVEL
        if self.explained < 0.5:
            return f"the dipole explains {100 * self.explained:.0f} % of the field"
        return super()._weak

    def __getitem__(self, name: str) -> float:
        if name in self.names:
            return float(self.state[self.names.index(name)])
        if name in PARTS:
            return self.moment[0] if name == "moment" else self.speed[0]
        if name == "range":
            return self.closest.range
        if name not in NAMES:
            there = ", ".join(dict.fromkeys((*NAMES, *PARTS, "range", *self.names)))
            raise InputError(f"no state {name!r}: there are {there}")
        return float(self._pass[NAMES.index(name)])

    @property
    def _pass(self) -> Array:
        return np.concatenate([self.r0, self.v, self.m])

    @property
    def speed(self) -> tuple[float, float]:
        """The speed and its standard deviation, m/s."""
        return self._size(self.v, "speed")

    @property
    def moment(self) -> tuple[float, float]:
        """The size of the moment and its standard deviation, A m^2; of several dipoles the sum."""
        if self.model.description.sources > 1:
            size, along = self.model.functions["moment"][0](self.state)
            return size, deviation(along, self.covariance)
        return self._size(self.m, "moment")

    @property
    def quadrupole(self) -> Array:
        """The quadrupole (3, 3) at the first time, A m^3; zeros where none was fitted."""
        values: Array = self.model.quadrupole(self.state)[0]
        return values

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

    @property
    def _noise(self) -> str:
        """The deviations in words, tesla."""
        most = float(self.sigmas[self.sigmas < np.inf].max(initial=self.sigma))
        more = f" to {brief(most)}" if most > self.sigma * (1 + 1e-9) else ""
        return brief(self.sigma) + more

    @property
    def _image(self) -> str:
        """What the mirror image is, in words."""
        if self.model.baselines is None:
            return "mirror image (-r0, -v, m)"
        return "mirror image about the middle of the gradiometer (with -v, -m)"

    def _size(self, vector: Array, name: str) -> tuple[float, float]:
        size, part = float(np.linalg.norm(vector)), PARTS[name]
        if name in self.known:
            return size, 0.0
        along = vector / size if size > 0 else vector
        return size, deviation(along, self.pass_covariance[part, part])

    def to_dict(self) -> dict[str, Any]:
        """Return the answer, without the samples, as plain lists and numbers, fit for JSON."""
        more = {"pass_names": list(NAMES), "pass_units": list(UNITS), "samples": len(self.times)}
        return super().to_dict() | more

    def summary(self, level: float = 0.95) -> str:
        """Return the answer as text."""
        near = self.closest
        lines = [
            f"{self.status.upper()}: {self.reason}",
            f"closest at {brief(near.range)} m (+- {brief(near.range_std, 2)}), "
            f"{brief(near.time, 4)} s (+- {brief(near.time_std, 2)})",
            f"speed {brief(self.speed[0], 4)} m/s (+- {brief(self.speed[1], 2)}), "
            f"moment {brief(self.moment[0], 4)} A m^2 (+- {brief(self.moment[1], 2)})",
        ]
        interval = self.interval("range", level)
        if not interval.is_local:
            lines.append(f"closest {interval} ({100 * level:g} %)")
        for name, unit, value, std in zip(NAMES, UNITS, self._pass, self.pass_std, strict=True):
            how = f"+- {brief(std, 2)}" if std > 0 else "known"
            lines.append(f"  {name}  {value:10.4g} {unit:6s} {how}")
        lines.append(
            f"explains {100 * self.explained:.1f} % of the field; sigma {self._noise} T, "
            f"{len(self.times)} samples, {self.spikes} spikes, {self.dropped} dropped"
            + (f", correlation {brief(self.correlation, 2)}" if self.correlation else "")
        )
        lines.extend(self._fit_lines())
        if self.candidates:
            tried = ", ".join(f"{about} {brief(bic, 6)}" for about, bic in self.candidates)
            lines.append(f"explained by {self.candidates[0][0]}; BIC of what was tried: {tried}")
        if self.mirror is None:
            lines.append(f"mirror image: {self.no_mirror}")
        elif self.mirror.cost <= self.cost * (1 + 1e-6) + 1e-9:
            lines.append(f"{self._image}: fits exactly as well, so either may be true")
        else:
            lines.append(
                f"mirror image: fits worse, cost {self.mirror.cost:.6g} against {self.cost:.6g}"
            )
        return "\n".join(lines)

    def _verdict_line(self) -> str:
        near = self.closest
        return (
            f"{self.status}: closest at {brief(near.range)} m (+- {brief(near.range_std, 2)} m), "
            f"{brief(near.time, 4)} s"
        )

    def plot(self, view: Literal["field", "path", "space"] = "field") -> Figure:
        """Draw the answer; needs matplotlib.

        Parameters
        ----------
        view : {"field", "path", "space"}
            The field with its model and what is left; the pass from above and from the
            side; the pass in space, with the 95 % ellipsoid of its closest point.
        """
        pictures = {"field": "fit", "path": "path", "space": "space"}
        return draw(self, pictures[choice(view, "view", pictures)])

    def _as_table(self) -> Columns:
        values = {"value": self._pass, "std": self.pass_std}
        return columns_of_states(NAMES, UNITS, values, covariance=self.pass_covariance)


@dataclass(frozen=True, repr=False)
class ClosestPoint(Answer):
    """The closest approach to a sensor: when, where, how near (seen from the sensor)."""

    time: float
    time_std: float
    position: tuple[float, float, float]
    range: float
    range_std: float


@dataclass(frozen=True, eq=False, repr=False)
class Localizations(Answer):
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
    p_value : ndarray, shape (...)
        How likely a true model costs as much: chi-square. NaN where sigma was estimated, or with
        as many numbers as unknowns.
    converged : ndarray of bool, shape (...)
    code : ndarray of int, shape (...)
        What is said of each answer: the place in `STATUSES`.
    """

    states: Array
    costs: Array
    mirrors: Array
    mirror_costs: Array
    sigmas: Array
    p_value: Array
    converged: NDArray[np.bool_]
    code: NDArray[np.int8]

    @property
    def status(self) -> str | NDArray[np.str_]:
        """The status in words: one of `STATUSES`, or an array of them."""
        words = np.array(STATUSES)[self.code]
        return str(words) if self.code.ndim == 0 else words

    def _as_table(self) -> Columns:
        values = {"": np.atleast_2d(self.states), "mirror": np.atleast_2d(self.mirrors)}
        others: dict[str, Any] = {"cost": self.costs, "mirror_cost": self.mirror_costs}
        others |= {"sigma": self.sigmas, "p_value": self.p_value}
        others |= {"converged": self.converged, "status": self.status}
        return columns_of_states(NAMES, UNITS, values, others)


def _nearer(other: Other, factor: float) -> Other:
    """Return another solution as it is told with deviations that are larger by a factor."""
    distance = other.distance / factor
    half = 0.5 * math.erfc(distance / math.sqrt(8.0))
    return replace(other, chi2=other.chi2 / factor**2, distance=distance, chance=half)


def information(
    model: DipoleModel, handle: _core.Model, state: Array, freedom: float
) -> _core.Analysis:
    """Return what the rows of an answer determine, the noise being that of Student's t.

    Its variance is freedom / (freedom - 2); below three degrees, where it grows without
    limit, that of three. Priors keep theirs: they are the last rows.
    """
    rows: Array = handle.linearize(state)[1]
    if math.isfinite(freedom):
        rows[: model.weights.size] *= math.sqrt(1 - 2 / max(freedom, 3.0))
    return _core.Analysis(rows, None)


def deviation(gradient: Array, covariance: Array) -> float:
    """Return the standard deviation of a function of what has a covariance.

    It is `inf` of what has no bound, and 0 where rounding made the variance negative.
    """
    own = gradient != 0
    inner = covariance[np.ix_(own, own)]
    if np.isinf(inner).any():
        return math.inf
    return float(np.sqrt(max(gradient[own] @ inner @ gradient[own], 0.0)))
