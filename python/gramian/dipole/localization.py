"""Locating a passing dipole from its field and what is known beforehand."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._numbers import SEED_MOST, finite, reals, whole
from gramian.analysis import analyze, describe_null_space, plain
from gramian.dipole.model import NAMES, UNITS, Pass, problem, rows
from gramian.exceptions import InputError, UnobservableError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "ClosestPoint",
    "Localization",
    "Localizations",
    "Solution",
    "localize",
    "localize_many",
    "localize_trials",
]

Array = NDArray[np.float64]

#: Tesla; beyond it squares leave the range of the numbers.
LARGEST = 1e100
Background = Literal["median", "fit"]
Loss = Literal["gaussian", "huber"]

#: What may be known: the states, the speed (m/s) and the moment's size (A m^2).
KNOWABLE = (*NAMES, "speed", "moment")
_ALIASES = {"x": "x0", "y": "y0", "z": "z0"}
_PARTS = {"speed": slice(3, 6), "moment": slice(6, 9)}

#: A window of the pass reaches this many times the time from the closest point
#: to 45 degrees: the field is down to 1 or 2 per cent there.
_REACH = 4.0


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
        Fraction of the field's sum of squares, background off and spikes apart,
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
        size, part = float(np.linalg.norm(vector)), _PARTS[name]
        if name in self.known:
            return size, 0.0
        along = vector / size if size > 0 else vector
        return size, _root(along @ self.covariance[part, part] @ along)

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
        """Draw the field with the model and the residuals; wants matplotlib."""
        from gramian.plot import dipole as pictures

        return pictures.fit(self)


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


@dataclass(frozen=True)
class _Options:
    background: str
    loss: str
    sigma: float | None
    origin: float | None
    starts: int


def localize(
    times: ArrayLike,
    field: ArrayLike,
    known: Mapping[str, float] | None = None,
    *,
    prior: Mapping[str, tuple[float, float]] | None = None,
    sensors: ArrayLike | None = None,
    background: Background | None = None,
    loss: Loss = "gaussian",
    sigma: float | None = None,
    window: Literal["pass"] | tuple[float, float] | None = None,
    missing: Literal["raise", "drop"] = "raise",
    starts: int = 12,
) -> Localization:
    """Locate a passing dipole from the field it makes and what is known beforehand.

    Parameters
    ----------
    times : array_like, shape (K,)
        Increasing, seconds. The state is that of the first one.
    field : array_like, shape (K, 3), or (K, S, 3) with `sensors`
        Tesla.
    known : mapping of str to float, optional
        What is known exactly: x0 (or x), y0, z0, vx, vy, vz, mx, my, mz, speed
        (m/s), moment (its size, A m^2).
    prior : mapping of str to (mean, sigma), optional
        What is known to a standard deviation, by the same names.
    sensors : array_like, shape (S, 3), optional
        Where the sensors are, metres; one at the origin by default.
    background : {"median", "fit"}, optional
        What to do about a constant field in the record: take off the median of
        each channel (over the whole record), or fit a constant to each; nothing
        by default.
    loss : {"gaussian", "huber"}
        Squares, or Huber's loss with spikes rejected.
    sigma : float, optional
        Standard deviation of the noise, tesla; estimated from the residuals by default.
    window : "pass" or (start, end), optional
        Use only these times; "pass" finds the pass first and keeps four times
        the time from its closest point to 45 degrees on both sides.
    missing : {"raise", "drop"}
        What to do about samples with NaN.
    starts : int
        How many starts are followed, >= 1.

    Returns
    -------
    Localization

    Raises
    ------
    UnobservableError
        The knowledge does not suffice; names the null combinations and what
        would repair it.
    InputError
        Knowledge that contradicts itself, fewer numbers than unknowns, NaN, a
        field of zeros, shapes and names that do not fit.

    Warns
    -----
    UserWarning
        A field above 1 T, which is unlikely to be in tesla.

    Notes
    -----
    Separable least squares: for each position and velocity the moment follows
    by linear least squares, so at most six numbers are searched for. Starts come
    from the shape of the field: in the frame of the pass it is a sum of three
    functions of (t - tc) / tau, whose coefficients give frame and moment in closed
    form. The covariance is the Cramer-Rao bound under the constraints, with the
    noise independent from sample to sample; where the model itself is the larger
    error it is too small.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(21.0)
    >>> y = gm.dipole.simulate([-10, -10, 5], [1, 1, 0], [10, 20, 10], t, 1e-12, seed=1)
    >>> answer = gm.dipole.localize(t, y, {"z": 5.0, "vz": 0.0}, sigma=1e-12)
    >>> answer.m.round(1), answer.mirror
    (array([10., 20., 10.]), None)
    """
    setup = _Setup(known, prior, sensors, background, loss, sigma, starts)
    t, y, dropped = setup.samples(times, field, missing)
    # The instant of the state, whichever samples are used.
    origin = float(np.ravel(times)[0])
    offsets = np.zeros((y.shape[1], 3))
    if background == "median":
        # Over the whole record: a window of the pass alone has no quiet part.
        offsets = np.median(y, axis=0)
        y = y - offsets
    inner = setup.options("fit" if background == "fit" else "none", origin)
    if isinstance(window, tuple):
        start, end = window
        keep = (t >= start) & (t <= end)
        t, y = t[keep], y[keep]
    elif window not in (None, "pass"):
        raise InputError(f'window = {window!r}: must be "pass", (start, end) or None')
    setup.enough(t, "in the window" if window is not None else "")
    raw = setup.run(t, y, inner)
    if window == "pass":
        keep = _of_the_pass(raw[:9], t - origin, setup.sensors)
        if keep.sum() * 3 * len(setup.sensors) >= 4 * setup.unknowns:
            t, y = t[keep], y[keep]
            raw = setup.run(t, y, inner)
    return _answer(raw, t, y, offsets, origin, dropped, setup)


def localize_many(
    times: ArrayLike,
    field: ArrayLike,
    known: Mapping[str, float] | None = None,
    *,
    prior: Mapping[str, tuple[float, float]] | None = None,
    sensors: ArrayLike | None = None,
    background: Background | None = None,
    loss: Loss = "gaussian",
    sigma: float | None = None,
    starts: int = 12,
) -> Localizations:
    """Locate dipoles in many records at once.

    Parameters
    ----------
    times : array_like, shape (..., K)
        Increasing, seconds.
    field : array_like, shape (..., K, 3), or (..., K, S, 3) with `sensors`
        Tesla.
    known, prior, sensors, background, loss, sigma, starts
        As for `localize`.

    Returns
    -------
    Localizations

    Raises
    ------
    InputError
        As for `localize`. Whether the knowledge suffices is not asked: see
        `problem` for that.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(21.0)
    >>> y = gm.dipole.simulate([-10, -10, 5], [1, 1, 0], [10, 20, 10], t, 1e-9, 1, trials=4)
    >>> gm.dipole.localize_many(t, y, {"z": 5.0, "vz": 0.0}, sigma=1e-9).states.shape
    (4, 9)
    """
    setup = _Setup(known, prior, sensors, background, loss, sigma, starts)
    y = reals(field, "field")
    if y.ndim < (2 if sensors is None else 3):
        raise InputError(
            f"field has shape {y.shape}: must be "
            + ("(..., K, 3)" if sensors is None else "(..., K, S, 3)")
        )
    if sensors is None:
        y = y[..., None, :]
    setup.enough(np.empty(np.shape(times)[-1:]))
    out = setup.run(times, y, setup.options(background or "none", None))
    return Localizations(
        states=out[..., :9],
        costs=out[..., 18],
        mirrors=out[..., 9:18],
        mirror_costs=out[..., 19],
        sigmas=out[..., 20],
        converged=out[..., 21] == 1,
    )


def localize_trials(
    r0: ArrayLike,
    v: ArrayLike,
    m: ArrayLike,
    times: ArrayLike,
    sigma: float,
    seed: int,
    trials: int,
    *,
    known: Mapping[str, float] | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    sensors: ArrayLike | None = None,
    first: int = 0,
    starts: int = 12,
) -> Array:
    """Simulate a pass many times and locate it each time, in one go.

    Parameters
    ----------
    r0, v, m, times, sigma
        The pass and its measurement, as for `simulate`.
    seed : int
        >= 0. Trial i depends on (seed, i) alone and has the noise of `simulate`.
    trials : int
        How many, >= 1.
    known, prior, sensors, starts
        As for `localize`.
    first : int
        Number of the first trial.

    Returns
    -------
    ndarray, shape (trials, 9)
        The estimates (r0, v, m). Of an answer and its mirror image that fit
        the same, the one nearer to the truth.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> known = {"z": 5.0, "vz": 0.0}
    >>> x = localize_trials(
    ...     [-10, -10, 5], [1, 1, 0], [10, 20, 10], np.arange(21.0), 1e-9, 0, 50, known=known
    ... )
    >>> x.shape, bool(abs(x[:, 0].mean() + 10) < 0.5)
    ((50, 9), True)
    """
    seed, first = whole(seed, "seed", 0, SEED_MOST), whole(first, "first")
    trials = whole(trials, "trials", 1)
    setup = _Setup(known, prior, sensors, None, "gaussian", sigma, starts)
    setup.enough(times)
    state = np.concatenate([_three(r0, "r0"), _three(v, "v"), _three(m, "m")])
    out = _core.dipole_localize_trials(
        times,
        state.tolist(),
        float(sigma),
        setup.sensors.tolist(),
        setup.exact,
        setup.priors,
        setup.options("none", None),
        seed,
        first,
        trials,
    )
    estimates: Array = out[:, :9]
    return estimates


class _Setup:
    """Checked knowledge, sensors and options."""

    def __init__(
        self,
        known: Mapping[str, float] | None,
        prior: Mapping[str, tuple[float, float]] | None,
        sensors: ArrayLike | None,
        background: str | None,
        loss: str,
        sigma: float | None,
        starts: int,
    ) -> None:
        self.known = {
            _name(key): _number(value, f"known[{key!r}]") for key, value in (known or {}).items()
        }
        self.prior = {}
        for key, value in (prior or {}).items():
            try:
                mean, deviation = value
            except (TypeError, ValueError):
                raise InputError(
                    f"prior[{key!r}] = {value!r}: must be a mean and a standard deviation"
                ) from None
            mean, deviation = (
                _number(mean, f"prior[{key!r}]"),
                _number(deviation, f"sigma of {key}"),
            )
            if deviation <= 0:
                raise InputError(f"prior[{key!r}] has sigma = {deviation}: must be > 0")
            self.prior[_name(key)] = (mean, deviation)
        if both := set(self.known) & set(self.prior):
            raise InputError(
                f"{sorted(both)[0]} is known exactly and has a prior: give one of them"
            )
        for name in ("speed", "moment"):
            given = self.known.get(name, self.prior.get(name, (1.0,))[0])
            if not given > 0:
                raise InputError(f"{name} = {given}: must be > 0")
        if background not in (None, "median", "fit"):
            raise InputError(f'background = {background!r}: must be "median", "fit" or None')
        if loss not in ("gaussian", "huber"):
            raise InputError(f'loss = {loss!r}: must be "gaussian" or "huber"')
        if sigma is not None and not 0 < sigma < np.inf:
            raise InputError(f"sigma = {sigma} T: must be > 0 and finite")
        starts = whole(starts, "starts", 1)
        self.one_sensor = sensors is None
        self.sensors = np.zeros((1, 3)) if sensors is None else reals(sensors, "sensors").copy()
        if self.sensors.ndim != 2 or self.sensors.shape[1] != 3 or not len(self.sensors):
            raise InputError(f"sensors has shape {self.sensors.shape}: must be (S, 3)")
        finite(self.sensors, "sensors")
        self.background, self.loss, self.sigma, self.starts = background, loss, sigma, starts
        self.exact = [self.known.get(name, np.nan) for name in KNOWABLE]
        self.priors = [list(self.prior.get(name, (np.nan, np.nan))) for name in KNOWABLE]

    @property
    def unknowns(self) -> int:
        fitted = 3 * len(self.sensors) if self.background == "fit" else 0
        return 9 - len(self.known) + fitted

    def options(self, background: str, origin: float | None) -> _Options:
        return _Options(background, self.loss, self.sigma, origin, self.starts)

    def samples(self, times: ArrayLike, field: ArrayLike, missing: str) -> tuple[Array, Array, int]:
        """Return times (K,), field (K, S, 3) and how many samples were dropped."""
        t, y = reals(times, "times").copy(), reals(field, "field").copy()
        wanted = "(K, 3)" if self.one_sensor else f"(K, {len(self.sensors)}, 3)"
        if self.one_sensor and y.ndim == 2:
            y = y[:, None, :]
        if t.ndim != 1 or y.shape != (len(t), len(self.sensors), 3):
            raise InputError(
                f"field has shape {np.shape(field)} for {t.size} times: must be {wanted}, "
                "three components for each time" + ("" if self.one_sensor else " and sensor")
            )
        if missing not in ("raise", "drop"):
            raise InputError(f'missing = {missing!r}: must be "raise" or "drop"')
        if not np.isfinite(t).all():
            raise InputError(f"times[{np.argmin(np.isfinite(t))}] must be finite")
        bad = ~np.isfinite(y).all(axis=(1, 2))
        if bad.any():
            if missing == "raise":
                raise InputError(
                    f"{bad.sum()} of {bad.size} samples are not finite, the first is sample "
                    f'{np.argmax(bad)}: missing="drop" leaves them out'
                )
            t, y = t[~bad], y[~bad]
        largest = float(abs(y).max()) if t.size else 0.0
        if largest > LARGEST:
            raise InputError(
                f"the field reaches {largest:.4g} T: must be in tesla, below {LARGEST} T"
            )
        if largest > 1:
            warnings.warn(
                f"the field reaches {largest:.4g} T: it must be in tesla (1 uT = 1e-6 T)",
                UserWarning,
                stacklevel=3,
            )
        if self.background is not None and len(t) > 1 and not np.ptp(y, axis=0).any():
            raise InputError("the field is constant: there is no pass in it to locate")
        self.enough(t)
        return t, y, int(bad.sum())

    def enough(self, times: ArrayLike, where: str = "") -> None:
        numbers = 3 * len(self.sensors) * np.size(times) + len(self.prior)
        if numbers < max(self.unknowns, 1):
            raise InputError(
                f"{np.size(times)} samples {where}".rstrip()
                + f" give {numbers} numbers for {self.unknowns} unknowns: too few"
            )

    def run(self, times: ArrayLike, field: Array, options: _Options) -> Array:
        return _core.dipole_localize(
            times, field, self.sensors.tolist(), self.exact, self.priors, options
        )


def _answer(
    raw: Array,
    t: Array,
    y: Array,
    offsets: Array,
    origin: float,
    dropped: int,
    setup: _Setup,
) -> Localization:
    count, channels = len(t), y.shape[1:]
    size = y.size
    state, mirror = raw[:9], raw[9:18]
    cost, mirror_cost, sigma = (float(x) for x in raw[18:21])
    fitted = raw[23 : 23 + y[0].size].reshape(channels)
    residuals = raw[23 + y[0].size : 23 + y[0].size + size].reshape(count, *channels)
    weights = raw[23 + y[0].size + size :].reshape(count, *channels)
    covariance = _covariance(state, t, origin, sigma, weights, setup)
    signal = y - fitted
    good = weights > 0
    closest = _closest(state, covariance, origin, setup.sensors[0])
    return Localization(
        r0=state[:3],
        v=state[3:6],
        m=state[6:],
        std=np.sqrt(np.maximum(np.diag(covariance), 0.0)),
        covariance=covariance,
        cost=cost,
        mirror=Solution(mirror[:3], mirror[3:6], mirror[6:], mirror_cost)
        if np.isfinite(mirror_cost)
        else None,
        origin=origin,
        times=t,
        residuals=residuals,
        model=signal - residuals,
        background=offsets + fitted,
        weights=weights,
        sigma=sigma,
        explained=float(1 - (residuals[good] ** 2).sum() / (signal[good] ** 2).sum()),
        spikes=int((~good).any(axis=-1).sum()),
        dropped=dropped,
        converged=bool(raw[21]),
        closest=closest,
        known=setup.known,
        prior=setup.prior,
        sensors=setup.sensors,
    )


def _covariance(
    state: Array, t: Array, origin: float, sigma: float, weights: Array, setup: _Setup
) -> Array:
    """Return the bound at an answer, on what knowledge leaves free."""
    shift = t[0] - origin
    start = state[:3] + shift * state[3:6]
    here = Pass(start, state[3:6], state[6:])
    lines = rows(*here, t, sigma, sensors=setup.sensors)
    lines[:, 3:6] += shift * lines[:, :3]
    lines = lines * np.sqrt(weights.reshape(-1, 1))
    if setup.background == "fit":
        lines = _centered(lines, np.sqrt(weights), setup)
    extra = []
    for name, (_, deviation) in setup.prior.items():
        extra.append(_gradient(name, state) / deviation)
    lines = np.vstack([lines, *extra]) if extra else lines
    free = _free_directions(setup.known, state)
    if not free.shape[1]:
        return np.zeros((9, 9))
    analysis = _core.Analysis(lines @ free, None)
    bound = analysis.crlb()
    if bound is None:
        null = free @ analysis.null_space()
        # What rounding left in a state that has no part in it.
        part = np.abs(null) * np.linalg.norm(lines, axis=0)[:, None]
        null[part < 1e-9 * part.max(axis=0)] = 0.0
        directions = describe_null_space(null, NAMES)
        raise UnobservableError(_refusal(here, t, sigma, setup, directions), directions)
    spread: Array = free @ bound @ free.T
    return spread


def _refusal(here: Pass, t: Array, sigma: float, setup: _Setup, directions: Sequence[str]) -> str:
    given = ", ".join(f"{name} = {value:g}" for name, value in setup.known.items())
    given += ", ".join(f"prior of {name}" for name in setup.prior)
    answer = analyze(problem(*here, t, sigma, sensors=setup.sensors))
    told = setup.known.keys() | setup.prior.keys()
    repairs = [
        s.name
        for s in answer.suggestions
        if s.repairs and s.name in KNOWABLE and s.name not in told
    ]
    text = (
        f"what is known ({given or 'nothing'}) does not suffice: "
        f"{'; '.join(directions)} is not determined"
    )
    if repairs:
        text += f"; any one of these would do: {', '.join(repairs)}"
    return text


def _centered(lines: Array, roots: Array, setup: _Setup) -> Array:
    """Return the rows with what constants of each channel explain taken off."""
    by_channel = lines.reshape(len(roots), -1, 9)
    w = roots.reshape(len(roots), -1, 1)
    total = (w**2).sum(axis=0)
    means = (w * by_channel).sum(axis=0) / np.where(total > 0, total, 1.0)
    centered: Array = (by_channel - w * means).reshape(-1, 9)
    return centered


def _gradient(name: str, state: Array) -> Array:
    """Return the derivative of a state, of the speed or of the moment's size."""
    row = np.zeros(9)
    if name in _PARTS:
        part = state[_PARTS[name]]
        row[_PARTS[name]] = part / np.linalg.norm(part)
    else:
        row[NAMES.index(name)] = 1.0
    return row


def _free_directions(known: Mapping[str, float], state: Array) -> Array:
    """Return a basis (9, d) of the moves that exact knowledge allows."""
    blocks = []
    for part, size in ((slice(0, 3), None), (slice(3, 6), "speed"), (slice(6, 9), "moment")):
        axes = [i for i in range(part.start, part.stop) if NAMES[i] not in known]
        basis = np.zeros((9, len(axes)))
        basis[axes, range(len(axes))] = 1.0
        if size in known and axes:
            along = basis.T @ state
            if along.any():
                # The rest of an orthonormal basis that begins along the vector.
                across = np.linalg.qr(np.column_stack([along, np.eye(len(axes))]))[0][:, 1:]
                basis = basis @ across[:, : len(axes) - 1]
        blocks.append(basis)
    return np.hstack(blocks)


def _of_the_pass(state: Array, t: Array, sensors: Array) -> NDArray[np.bool_]:
    keep = np.zeros(t.shape, dtype=bool)
    v = state[3:6]
    speed = float(np.linalg.norm(v))
    if speed == 0:
        return ~keep
    for sensor in sensors:
        place = state[:3] - sensor
        closest = -(place @ v) / speed**2
        reach = _REACH * float(np.linalg.norm(place + closest * v)) / speed
        keep |= np.abs(t - closest) <= reach
    return keep


def _closest(state: Array, covariance: Array, origin: float, sensor: Array) -> ClosestPoint:
    r, v = state[:3] - sensor, state[3:6]
    squared = float(v @ v)
    if squared == 0:
        position, time, by_time = r, 0.0, np.zeros(9)
    else:
        time = float(-(r @ v) / squared)
        position = r + time * v
        by_time = np.concatenate([-v, -r - 2 * time * v, np.zeros(3)]) / squared
    distance = float(np.linalg.norm(position))
    # At the closest point a change of its time changes nothing.
    unit = position / distance
    by_range = np.concatenate([unit, time * unit, np.zeros(3)])
    return ClosestPoint(
        time=origin + time,
        time_std=_root(by_time @ covariance @ by_time),
        position=(float(position[0]), float(position[1]), float(position[2])),
        range=distance,
        range_std=_root(by_range @ covariance @ by_range),
    )


def _root(variance: float | Array) -> float:
    return float(np.sqrt(np.maximum(variance, 0.0)))


def _name(key: str) -> str:
    name = _ALIASES.get(key, key)
    if name not in KNOWABLE:
        raise InputError(f"{key!r} cannot be known: there are {', '.join(KNOWABLE)}")
    return name


def _number(value: float, name: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {value!r}: must be a number") from None
    if not np.isfinite(number):
        raise InputError(f"{name} = {number}: must be finite")
    return number


def _three(value: ArrayLike, name: str) -> Array:
    array = reals(value, name)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(f"{name} = {value!r}: must be three finite numbers")
    return array
