"""Estimates of the biases from reports, with what they cannot tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns, columns_of_states
from gramian._arrays import SEED_MOST, as_float_array, number, real, whole
from gramian._text import brief, describe_direction
from gramian._units import labelled
from gramian._values import Value
from gramian.estimation import Channel, channel_faults
from gramian.estimation import Estimate as General
from gramian.estimation import estimate as estimate_model
from gramian.estimation._knowledge import levels
from gramian.estimation._parts import Status
from gramian.exceptions import ConvergenceError, InputError, UnobservableError
from gramian.models.registration._model import gauges_of
from gramian.models.registration._reports import Reports, report_array, stage
from gramian.models.registration._setup import Array, Extra, SensorsLike, Setup
from gramian.models.registration._tracks import singular_tracks

Method = Literal["ls", "gls", "ml"]
STATUSES = ("determined", "not_converged", "unobservable")

#: Information of which more than this share is made by the noise of the positions is none.
NOISE_SHARE = 0.5
#: Nor is information that grows by more than this share within its own deviation.
BEND = 0.05


@dataclass(frozen=True, eq=False)
class RegistrationModel(Value):
    """Reports as a model of the biases: each target is where it is likeliest.

    Attributes
    ----------
    sensors : Setup
        Names, places, noise and kinds of biases; of platforms that move, at the looks.
    reports : ndarray, shape (K, N, d)
        Reports near which the model is asked, NaN where one is missing: `h` says what is
        measured of their targets.
    truth : ndarray, shape (K, d), optional
        Positions reported without bias, NaN where there is none.
    truth_sigma : ndarray, shape (d,), optional
        Their deviations, m.
    times : ndarray, shape (K,), optional
        Of the looks, s, starting anew with each target: with them the clocks are tested.
    clocks : bool
        Whether the clocks are states.
    """

    sensors: Setup
    reports: Array
    truth: Array | None = None
    truth_sigma: Array | None = None
    times: Array | None = None
    clocks: bool = False

    @cached_property
    def velocity(self) -> Array | None:
        """Velocities (K, d) of the targets, m/s; None without times."""
        if self.times is None:
            return None
        still = replace(self, times=None, clocks=False)
        return _velocities(self.times, still.record(self.reports).positions(still.x.tolist()))

    @property
    def _clock_names(self) -> tuple[str, ...]:
        if not self.clocks:
            return ()
        # Without truth all clocks are compared to the first.
        labels = self.sensors.labels[1 if self.truth is None else 0 :]
        return tuple(f"{label}.clock" for label in labels)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the biases, and of the clocks: "B.clock"."""
        return self.sensors.names + self._clock_names

    @property
    def units(self) -> tuple[str, ...]:
        """Their units."""
        return self.sensors.units + ("s",) * len(self._clock_names)

    @property
    def x(self) -> Array:
        """No bias at all."""
        return np.zeros(len(self.names))

    def measured(self, z: ArrayLike) -> Array:
        """Return reports as they are taken, flat; NaN where one is missing."""
        values = as_float_array(z, "reports")
        if values.size != self.reports.size:
            raise InputError(
                f"reports has {values.size} numbers: must have {self.reports.size}, those of "
                f"{len(self.reports)} looks"
            )
        return values.reshape(-1)

    def record(self, z: ArrayLike) -> _core.RegistrationRecord:
        """Return the extension's record of these reports, (K, N, d) or flat."""
        known = self.sensors
        values = np.reshape(np.asarray(z, dtype=float), self.reports.shape)
        truth = None
        if self.truth is not None and self.truth_sigma is not None:
            truth = (self.truth, self.truth_sigma)
        return _core.RegistrationRecord(
            known.to_north(values),
            known.places,
            known.sigma,
            known.flags,
            truth,
            self.velocity if self.clocks else None,
        )

    def handle(self, z: Array) -> _core.Model:
        """Return the extension's model of these reports."""
        return self.record(z).model()

    def starts(self, z: Array) -> Array:
        """Return where to start: no bias at all."""
        return np.zeros((1, len(self.names)))

    def residuals(self, x: ArrayLike, z: ArrayLike) -> Array:
        """Return what is left of reports, whitened, positions eliminated."""
        return self.handle(np.asarray(z, dtype=float)).linearize(x)[0]

    def rows(self, x: ArrayLike) -> Array:
        """Return the whitened rows on the biases, positions eliminated."""
        return self.handle(self.reports).linearize(x)[1]

    def h(self, x: ArrayLike) -> Array:
        """Return the exact reports (K N d,) of the targets, with these biases."""
        known, values = self.sensors, np.asarray(x, dtype=float)
        places = self.record(self.reports).positions(self.x.tolist())
        exact = np.full(self.reports.shape, np.nan)
        placed = np.isfinite(places).all(axis=1)
        there = known.at(placed)
        late = dict(zip(self._clock_names, values[known.n :].tolist(), strict=True))
        for s, label in enumerate(known.labels):
            where = places[placed]
            if self.velocity is not None and (offset := late.get(f"{label}.clock", 0.0)):
                where = where - offset * self.velocity[placed]
            exact[placed, s] = _core.registration_reports(
                where, there.places, known.sigma, values[: known.n], known.flags
            )[:, s]
        exact = known.as_measured(exact)
        exact[np.isnan(self.reports)] = np.nan
        return exact.ravel()

    def alternatives(self, x: Array, z: Array) -> dict[str, Array]:
        """Return what else may be true, as whitened columns: drifts of biases, gains, clocks."""
        known = self.sensors
        found = self.record(z).alternatives(np.asarray(x).tolist(), self.velocity)
        return {
            f"drift of {known.names[index]}"
            if kind == "drift"
            else f"{kind} of {known.labels[index]}": column
            for kind, index, column in found
        }

    def faults(self, z: Array) -> tuple[str, ...]:
        """Return which ranges or angles of a sensor are dead, stuck or doubled, in words."""
        looks, sensors, kinds = self.reports.shape
        places = np.arange(self.reports.size).reshape(looks, sensors, kinds)
        when, unit = (
            (np.arange(1.0, 1 + looks), "look") if self.times is None else (self.times, "s")
        )
        channels = [
            Channel(f"{label}.{kind}", places[:, s, q], when, unit)
            for s, label in enumerate(self.sensors.labels)
            for q, kind in enumerate(("range", "azimuth", "elevation")[:kinds])
        ]
        sigma = np.broadcast_to(self.sensors.sigma, (looks, sensors, kinds)).ravel()
        return channel_faults(np.ravel(z), sigma, channels)

    def alternative_unit(self, name: str) -> str:
        """Return the unit of an alternative's parameter: a drift is a change a look."""
        kind, _, what = name.partition(" of ")
        if kind == "drift":
            return f"{self.units[self.names.index(what)]} a look".strip()
        return "s" if kind == "clock" else ""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Estimate(General):
    """The answer of `estimate` to one set of reports: a `gramian.Estimate` of the biases.

    Attributes
    ----------
    method : {"ls", "gls", "ml"}
    positions : ndarray, shape (K, d)
        The targets.
    held_by_prior : tuple of str
        The combinations that the reports do not determine and only the prior does.
    noise_share : float
        Share of the weakest direction's information that noise would make alone.
    bend : float
        Its growth within the direction's own deviation.
    """

    method: Method
    positions: Array
    held_by_prior: tuple[str, ...]
    noise_share: float
    bend: float
    _found: tuple[Array, Array] | None = None
    _refused: str = ""

    _not_in_dict = General._not_in_dict | {"positions"}

    @property
    def biases(self) -> Array:
        """The biases (n,): `state`."""
        return self.state

    @cached_property
    def covariance(self) -> Array:
        """Of the method, (n, n); where something is not determined, on the rest."""
        return super().covariance if self._found is None else self._found[0]

    @cached_property
    def std(self) -> Array:
        """Standard deviations (n,); `inf` for a bias that is not determined."""
        return super().std if self._found is None else self._found[1]

    @cached_property
    def _misfit(self) -> str:
        # Unweighted least squares are not at the least chi2.
        return "" if self.method == "ls" else super()._misfit

    @cached_property
    def _verdict(self) -> tuple[Status, str]:
        if self._refused:
            return "unobservable", f"the reports do not determine {self._refused}"
        return super()._verdict

    def summary(self, level: float = 0.95) -> str:
        """Return the answer as text; angles in degrees."""
        lines = [f"{self.status.upper()}: {self.reason} ({self.method.upper()})"]
        width = max(len(name) for name in self.names)
        columns = (self.names, self.units, self.state, self.std)
        for name, unit, value, std in zip(*columns, strict=True):
            if np.isinf(std):
                lines.append(f"  {name:<{width}}  not observable")
            elif unit == "rad":
                degrees = np.degrees([value, std])
                lines.append(f"  {name:<{width}}  {degrees[0]:.5g} +- {brief(degrees[1], 2)} deg")
            else:
                lines.append(f"  {name:<{width}}  {value:.5g} +- {brief(std, 2)} {unit}".rstrip())
        lines += [f"  held by the prior alone: {text}" for text in self.held_by_prior]
        lines += ["  " + line for line in self._fit_lines()]
        return "\n".join(lines)


@dataclass(frozen=True, eq=False, repr=False)
class Estimates(Answer):
    """What `estimate` makes of many sets of reports; arrays have their leading axes.

    Attributes
    ----------
    names, units : tuple of str, length n
    biases : ndarray, shape (..., n)
    std : ndarray, shape (..., n)
        Standard deviations; `inf` for a bias that is not determined and has no prior.
    covariance : ndarray, shape (..., n, n)
        Where something is not determined, on the rest.
    status : ndarray of str, shape (...)
        "determined", "not_converged" or "unobservable"; whether the model fits is in
        `p_value`.
    iterations : ndarray of int, shape (...)
        Linearisations made.
    chi_square : ndarray, shape (...)
        Sum of squared residuals over their deviations.
    dof : int
        What chi-square is on average when reports agree with the model.
    noise_share : ndarray, shape (...)
        Share of the weakest direction's information that noise would make alone.
    bend : ndarray, shape (...)
        Its growth within the direction's own deviation.
    positions : ndarray, shape (..., K, d)
        The targets.
    method : {"ls", "gls", "ml"}
    prior : mapping of str to float
        Deviations known beforehand.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    biases: Array
    std: Array
    covariance: Array
    status: NDArray[np.str_]
    iterations: NDArray[np.int_]
    chi_square: Array
    dof: int
    noise_share: Array
    bend: Array
    positions: Array = field(repr=False)
    method: Method
    prior: Mapping[str, float]

    _more_in_dict = ("p_value",)
    _not_in_dict = frozenset({"positions"})

    @property
    def p_value(self) -> Array:
        """Probability of a larger chi-square: small when reports and model disagree.

        NaN without degrees of freedom.
        """
        if self.dof < 1:
            return np.nan * self.chi_square
        value: Array = _core.chi_square_survival(self.chi_square, self.dof)[()]
        return value

    def __getitem__(self, name: str) -> Array:
        """Return one bias by name."""
        if name not in self.names:
            raise InputError(f"no bias is named {name!r}: there are {', '.join(self.names)}")
        value: Array = self.biases[..., self.names.index(name)]
        return value

    def summary(self) -> str:
        """Return how many there are, and their states, as text."""
        counts = [f"{int((self.status == name).sum())} {name}" for name in STATUSES]
        return f"{self.status.size} estimates: {', '.join(counts)}"

    def _as_table(self) -> Columns:
        others = {"status": self.status, "chi2": self.chi_square, "p_value": self.p_value}
        return columns_of_states(
            self.names, self.units, {"": self.biases, "std": self.std}, others, self.covariance
        )


def estimate(
    reports: ArrayLike | Reports,
    sensors: SensorsLike,
    sigma: ArrayLike,
    *,
    method: Method = "ml",
    prior: ArrayLike | Mapping[str, float] | None = None,
    extras: Sequence[Extra] = (),
    iterations: int | None = None,
    tolerance: float = 1e-6,
    on_failure: Literal["raise", "report"] = "raise",
    loss: Literal["squares", "huber", "tukey"] = "squares",
    truth: ArrayLike | None = None,
    truth_sigma: ArrayLike | None = None,
    clocks: bool = False,
    fixed: Mapping[str, float] | None = None,
    alpha: float = 0.001,
) -> Estimate | Estimates:
    """Estimate the biases from reports alone: the targets' positions are not needed.

    Parameters
    ----------
    reports : array_like, shape (..., K, N, d), or Reports
        For each look and sensor range (m), azimuth and, with d = 3, elevation
        (rad); NaN where one is missing, in one set of reports with "ml". Leading axes are
        trials. Platforms that move need `Reports` with times.
    sensors, sigma, extras
        As for `rows`.
    method : {"ls", "gls", "ml"}
        "ml": maximum likelihood, by Gauss-Newton over the biases and all
        positions, which reaches the bound. "gls": least squares weighted by the
        noise, linearised at the reports. "ls": the same unweighted, in metres, as
        in Zhu, Tang & He 2013.
    prior : mapping of str to float, or array_like, shape (n,), optional
        Standard deviations of biases known beforehand to be near 0 (`inf` for
        none): what a singular geometry needs. Not with "ls".
    iterations : int, optional
        Linearisations at most: 100 for "ml", 1 for "gls" and "ls". With more,
        those are linearised again at the corrected reports, as large biases need.
    tolerance : float
        "ml" ends when a step is below so many standard deviations.
    on_failure : {"raise", "report"}
        Raise when biases are not determined or the iteration did not end; or say
        so in `status` and `std`. With trials the first failure counts.
    loss : {"squares", "huber", "tukey"}
        How residuals count: the others bear gross reports. Of one set of reports, with "ml".
    truth : array_like, shape (K, d), optional
        Positions reported without bias (a transponder, GNSS), metres, NaN where there is
        none: with them one sensor is enough, and no track is singular.
    truth_sigma : array_like, shape (d,) or scalar
        Their deviations, metres.
    clocks : bool
        Whether the clocks of the sensors may be off: the states "B.clock", .. (s), how late
        the stamps are, against the first sensor's or against the truth. Needs the times of
        the looks and targets that move. The path of a platform is on the clock of its sensor.
    fixed : mapping of str to float, optional
        Biases that are known: an extra that only some sensors have is fixed at 0 for the
        others.
    alpha : float
        Level of the tests of the fit of one set of reports: "misfit" below it.

    Returns
    -------
    Estimate or Estimates
        Of one set of reports, a `gramian.Estimate`; of trials, `Estimates`.

    Raises
    ------
    UnobservableError
        Reports from a singular geometry without a prior; it names the combination
        of biases and, for two sensors, the track.
    ConvergenceError
        An iteration that did not end.
    InputError
        As `rows`; reports of a wrong shape.

    Warns
    -----
    UserWarning
        Angles beyond a whole turn: degrees by mistake.

    Notes
    -----
    Each look's equations in position and biases are reduced by an orthogonal
    transformation; what is left gives d xi = (sum P_k)^-1 sum P_k e_k, with
    P = W - W G (G^T W G)^-1 G^T W, W = Sigma^-1 and G = dh/dp; positions follow by
    back-substitution. Azimuth residuals are wrapped. Least squares has two
    defects: linearisation at large biases, cured by linearising again, and noise
    in the coefficients, cured only by maximum likelihood.

    Reports put even a target on a singular track a little beside it, so the rows
    never look singular. A direction is refused when half of its information would
    be made by the noise of the positions, or when its information grows by 5 % or
    more within its own standard deviation (then the deviation is not one). The
    check is not perfect: abeam a sensor about one set of reports in ten fits
    another, regular track as well as the true one, and is answered. Where a target
    may be on a singular track, ask `check_track` too.

    Examples
    --------
    >>> import numpy as np
    >>> path = np.stack([np.linspace(-20e3, 60e3, 100), np.full(100, 25e3)], axis=1)
    >>> sensors, sigma = {"A": (0, 0), "B": (60e3, 0)}, (50.0, np.radians(0.1))
    >>> from gramian.models.registration import simulate
    >>> reports = simulate(path, sensors, sigma, {"A.range": 300, "B.azimuth": -0.007}, seed=1)
    >>> answer = estimate(reports, sensors, sigma)
    >>> bool(abs(answer["A.range"] - 300) < 4 * answer.std[0])
    True
    """
    options.choice(method, "method", ("ls", "gls", "ml"))
    values = reports.values if isinstance(reports, Reports) else report_array(reports)
    known = stage(reports, sensors, sigma, extras, 2 if truth is None else 1)
    if method == "ls" and prior is not None:
        raise InputError('method "ls" is not weighted: a prior needs "gls" or "ml"')
    options.choice(on_failure, "on_failure", ("raise", "report"))
    options.choice(loss, "loss", ("squares", "huber", "tukey"))
    times = reports.times if isinstance(reports, Reports) else None
    general = {
        "missing reports": bool(np.isnan(values).any()),
        "loss": loss != "squares",
        "truth": truth is not None or truth_sigma is not None,
        "clocks": bool(clocks),
        "fixed": bool(fixed),
    }
    count = _iterations(iterations, method)
    tolerance = number(tolerance, "tolerance")
    if not tolerance > 0:
        raise InputError(f"tolerance = {tolerance}: must be > 0")
    limits = levels(alpha, 0.01, 0.25)
    asked = [name for name, given in general.items() if given]
    if asked:
        if method != "ml" or values.ndim > 3:
            what = f'method "{method}"' if method != "ml" else f"{values.shape} reports"
            raise InputError(
                f'{asked[0]} with {what}: is for one set of reports (K, N, d), with method "ml"'
            )
        model = _model(known, values, times, truth, truth_sigma, bool(clocks))
        return _general(model, prior, fixed, loss, on_failure, limits)
    deviations = _prior(known.names, known.units, prior)
    found = _core.registration_estimate(
        known.to_north(values), known.places, known.sigma, known.flags, deviations, method,
        (count, tolerance, NOISE_SHARE, BEND), True,
    )  # fmt: skip
    looks = values.shape[-3]
    if values.ndim > 3:
        return _many(known, found, looks, method, deviations, on_failure)
    return _one(known, values, times, found, method, deviations, on_failure, limits)


def estimate_trials(
    positions: ArrayLike,
    sensors: SensorsLike,
    sigma: ArrayLike,
    biases: ArrayLike | Mapping[str, float] | None = None,
    *,
    seed: int,
    trials: int,
    first: int = 0,
    method: Method = "ml",
    prior: ArrayLike | Mapping[str, float] | None = None,
    extras: Sequence[Extra] = (),
    iterations: int | None = None,
    tolerance: float = 1e-6,
    times: ArrayLike | None = None,
) -> Estimates:
    """Simulate and estimate in one pass: what `estimate` makes of `simulate`, for many trials.

    Parameters
    ----------
    positions, biases, times
        The truth, as for `simulate`.
    sensors, sigma, extras, method, prior, iterations, tolerance
        As for `estimate`.
    seed, first, trials : int
        Trials first, first + 1, ... under this seed.

    Returns
    -------
    Estimates
        Failures are in `status`. Positions are not kept: shape (trials, 0, d).

    Examples
    --------
    >>> import numpy as np
    >>> path = np.stack([np.linspace(-20e3, 60e3, 100), np.full(100, 25e3)], axis=1)
    >>> sensors, sigma = {"A": (0, 0), "B": (60e3, 0)}, (50.0, np.radians(0.1))
    >>> estimate_trials(path, sensors, sigma, {"A.range": 300}, seed=1, trials=50).summary()
    '50 estimates: 50 determined, 0 not_converged, 0 unobservable'
    """
    known = stage(positions, sensors, sigma, extras, times=times)
    seed, first = whole(seed, "seed", 0, SEED_MOST), whole(first, "first")
    trials = whole(trials, "trials", 1)
    options.choice(method, "method", ("ls", "gls", "ml"))
    if method == "ls" and prior is not None:
        raise InputError('method "ls" is not weighted: a prior needs "gls" or "ml"')
    count = _iterations(iterations, method)
    deviations = _prior(known.names, known.units, prior)
    found = _core.registration_estimate_trials(
        positions, known.places, known.sigma, known.biases(biases), known.flags, deviations,
        method, (count, tolerance, NOISE_SHARE, BEND), seed, first, trials,
    )  # fmt: skip
    looks = as_float_array(positions, "positions").shape[0]
    return _many(known, found, looks, method, deviations, "report")


def _iterations(given: int | None, method: str) -> int:
    if given is None:
        return 100 if method == "ml" else 1
    return whole(given, "iterations", 1, 100_000)


def _prior(
    names: tuple[str, ...],
    units: tuple[str, ...],
    prior: ArrayLike | Mapping[str, float] | None,
) -> Array | None:
    if prior is None:
        return None
    deviations = np.full(len(names), np.inf)
    if isinstance(prior, Mapping):
        for name, value in options.mapping(prior, "prior").items():
            if name not in names:
                raise InputError(
                    f"no bias is named {options.given(name)}: there are {', '.join(names)}"
                )
            k = names.index(name)
            deviations[k] = real(value, labelled(f"prior of {name}", units[k]))
    else:
        given = as_float_array(prior, "prior")
        if given.shape != deviations.shape:
            raise InputError(
                f"prior has shape {given.shape}: must be ({len(names)},), for {', '.join(names)}"
            )
        deviations = given.copy()
    for name, value in zip(names, deviations, strict=True):
        if not value > 0:
            raise InputError(f"prior of {name} = {value}: must be > 0, or inf for none")
    return deviations


def _model(
    known: Setup,
    values: Array,
    times: Array | None,
    truth: ArrayLike | None,
    truth_sigma: ArrayLike | None,
    clocks: bool,
) -> RegistrationModel:
    """Return the model of looks that say something: those of two sensors, or with a truth."""
    shape = (len(values), len(known.labels), known.d)
    if values.shape != shape:
        raise InputError(
            f"reports has shape {values.shape}: must be {shape}, for each look one line from "
            "each sensor"
        )
    if np.isinf(values).any():
        k, s, q = np.argwhere(np.isinf(values))[0].tolist()
        raise InputError(
            f"reports[{k}, {s}, {q}] = {values[k, s, q]}: must be finite, or NaN where one is "
            "missing"
        )
    places, spread = None, None
    if truth is not None:
        places = as_float_array(truth, "truth")
        if places.shape != (len(values), known.d):
            raise InputError(
                f"truth has shape {places.shape}: must be {(len(values), known.d)}, one position "
                "for each look"
            )
        if truth_sigma is None:
            raise InputError("truth needs truth_sigma, its deviation in metres")
        spread = np.broadcast_to(as_float_array(truth_sigma, "truth_sigma"), (known.d,)).copy()
        if not ((spread > 0) & np.isfinite(spread)).all():
            raise InputError(f"truth_sigma = {truth_sigma}: must be > 0 and finite")
    elif truth_sigma is not None:
        raise InputError("truth_sigma was given without truth")
    model = RegistrationModel(known, values, places, spread)
    record = model.record(values)
    use = np.array(record.lines()) > 0
    if not use.any():
        raise InputError(
            "reports: no look has whole reports of two sensors, or of one and a true position"
        )
    if clocks and times is None:
        raise InputError("clocks need the times of the looks: give Reports(values, times)")
    return RegistrationModel(
        known.at(use),
        values[use],
        None if places is None else places[use],
        spread,
        None if times is None else times[use],
        clocks,
    )


#: Velocities are the slopes of parabolas through so many looks or so many seconds.
_WINDOW_LOOKS, _WINDOW_TIME = 15, 60.0


def _velocities(times: Array, places: Array) -> Array:
    """Return velocities (K, d) of targets at `places`: one after another, as times start anew."""
    out = np.zeros_like(places)
    starts = np.flatnonzero(~(np.diff(times) > 0)) + 1
    for part in np.split(np.arange(len(times)), starts):
        t, p = times[part], places[part]
        if len(part) < 2:
            continue
        for i, now in enumerate(t):
            near = np.abs(t - now)
            reach = max(_WINDOW_TIME / 2, np.sort(near)[min(_WINDOW_LOOKS, len(t)) - 1])
            chosen = near <= reach
            order = min(2, int(chosen.sum()) - 1)
            powers = np.vander((t[chosen] - now) / reach, order + 1, increasing=True)
            out[part[i]] = np.linalg.lstsq(powers, p[chosen], rcond=None)[0][1] / reach
    return out


def _general(
    model: RegistrationModel,
    prior: ArrayLike | Mapping[str, float] | None,
    fixed: Mapping[str, float] | None,
    loss: Literal["squares", "huber", "tukey"],
    on_failure: Literal["raise", "report"],
    limits: tuple[float, float, float],
) -> Estimate:
    """Estimate by the one solver: whatever is missing, robust, or more than biases."""
    known, values = model.sensors, model.reports
    deviations = _prior(model.names, model.units, prior)
    texts: tuple[str, ...] = ()
    noise_share, bend, refused = np.nan, np.nan, ""
    whole_looks = np.isfinite(values).all(axis=(1, 2))
    if model.truth is None and len(known.labels) > 1 and whole_looks.any():
        # Whether the noise of the positions makes the information: see `estimate`.
        there = known.at(whole_looks)
        first = _core.registration_estimate(
            there.to_north(values[whole_looks]), there.places, known.sigma, known.flags,
            None if deviations is None else deviations[: known.n], "ml",
            (100, 1e-6, NOISE_SHARE, BEND), True,
        )  # fmt: skip
        fails = "report" if fixed else on_failure
        _, status, texts = _judged(known, first, deviations, fails, settle=False)
        if status == "unobservable" and not fixed:
            refused = "; ".join(texts)
        noise_share, bend = float(first["noise_share"]), float(first["bend"])
    given = {}
    if deviations is not None:
        pairs = zip(model.names, deviations.tolist(), strict=True)
        given = {name: (0.0, value) for name, value in pairs if np.isfinite(value)}
    found = estimate_model(
        model,
        values,
        prior=given,
        known=None if fixed is None else options.mapping(fixed, "fixed"),
        search=False,
        loss=loss,
        alpha=limits[0],
        chance=limits[1],
        weak_ratio=limits[2],
    )
    if on_failure == "raise":
        if found.status == "unobservable":
            space = found._analysis.null_space()
            names = tuple(describe_direction(column, found.names) for column in space.T)
            raise UnobservableError(f"{found.reason}: take other targets or give a prior", names)
        if not found.converged:
            raise ConvergenceError(f"no minimum within {found.iterations} linearisations")
    parts = {name: value for name, value in vars(found).items() if name in found._stored()}
    return Estimate(
        **parts,
        method="ml",
        positions=model.record(values).positions(found._whole.tolist()),
        held_by_prior=texts if given else (),
        noise_share=noise_share,
        bend=bend,
        _refused=refused,
    )


def _judged(
    known: Setup,
    found: _core._Registered,
    prior: Array | None,
    on_failure: Literal["raise", "report"],
    settle: bool = True,
) -> tuple[Array, NDArray[np.str_], tuple[str, ...]]:
    """Return deviations, statuses and the combinations that the reports do not determine."""
    n = known.n
    covariance, directions = found["covariance"], found["directions"]
    # Numbers where there is one estimate.
    code, nullity, iterations = (
        found["status"][()],
        found["nullity"][()],
        found["iterations"][()],
    )
    lead = found["biases"].shape[:-1]
    std = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0))
    # The directions are orthonormal on the scale of what each bias alone would be known to.
    scale = np.linalg.norm(directions, axis=-2)
    scale = np.where(scale > 0, scale, 1.0)
    touched = np.abs(directions) / scale[..., None, :] > 0.05
    free = (touched & (np.arange(n)[:, None] < nullity[..., None, None])).any(axis=-2)
    std = np.where(free & (code == 2)[..., None], np.inf, std)
    texts: tuple[str, ...] = ()
    if (nullity > 0).any():
        first = np.unravel_index(int(np.argmax(nullity > 0)), nullity.shape) if lead else ()
        m = int(nullity[first])
        texts, where = _named(known, directions[first][:m], scale[first])
        if on_failure == "raise" and (code == 2).any():
            place = f"at batch index {list(map(int, first))}: " if lead else ""
            advice = "take other targets or give a prior"
            if prior is not None:
                advice = "take other targets or a prior of these biases too"
            raise UnobservableError(
                f"{place}these reports do not determine {'; '.join(texts)}{where}: {advice}", texts
            )
    if on_failure == "raise" and settle and (code == 1).any():
        raise ConvergenceError(
            f"{int((code == 1).sum())} of {code.size} estimates did not settle in "
            f"{int(iterations.max())} linearisations: the geometry is weak or the reports are "
            "far from the model"
        )
    return std, np.array(STATUSES)[code.astype(int)], texts


def _known_spreads(known: Setup, prior: Array | None) -> dict[str, float]:
    if prior is None:
        return {}
    pairs = zip(known.names, prior.tolist(), strict=True)
    return {name: value for name, value in pairs if np.isfinite(value)}


def _one(
    known: Setup,
    reports: Array,
    times: Array | None,
    found: _core._Registered,
    method: Method,
    prior: Array | None,
    on_failure: Literal["raise", "report"],
    limits: tuple[float, float, float],
) -> Estimate:
    std, status, texts = _judged(known, found, prior, on_failure)
    given = _known_spreads(known, prior)
    refused = status == "unobservable"
    return Estimate(
        model=_model(known, reports, times, None, None, False),
        measurements=reports.ravel(),
        names=known.names,
        units=known.units,
        state=found["biases"],
        converged=bool(status != "not_converged"),
        iterations=int(found["iterations"]),
        prior={name: (0.0, value) for name, value in given.items()},
        known={},
        others=(),
        unseen=1.0,
        alpha=limits[0],
        chance=limits[1],
        weak_ratio=limits[2],
        method=method,
        positions=found["positions"],
        held_by_prior=texts if prior is not None else (),
        noise_share=float(found["noise_share"]),
        bend=float(found["bend"]),
        _found=(found["covariance"], std),
        _refused="; ".join(texts) if refused else "",
    )


def _many(
    known: Setup,
    found: _core._Registered,
    looks: int,
    method: Method,
    prior: Array | None,
    on_failure: Literal["raise", "report"],
) -> Estimates:
    std, status, _ = _judged(known, found, prior, on_failure)
    given = _known_spreads(known, prior)
    return Estimates(
        names=known.names,
        units=known.units,
        biases=found["biases"],
        std=std,
        covariance=found["covariance"],
        status=status,
        iterations=found["iterations"].astype(int),
        chi_square=found["chi_square"],
        dof=looks * (len(known.labels) - 1) * known.d - known.n + len(given),
        noise_share=found["noise_share"],
        bend=found["bend"],
        positions=found["positions"],
        method=method,
        prior=given,
    )


def _named(known: Setup, directions: Array, scale: Array) -> tuple[tuple[str, ...], str]:
    """Name the combinations that span these directions, and for two sensors the track."""
    basis = np.linalg.qr((directions / scale).T)[0]
    if known.is_pair and len(directions) == 1:
        for track in singular_tracks(dict(zip(known.labels, known.places, strict=True))):
            for side, vector in track.null_vectors.items():
                scaled = vector / scale
                inside = np.linalg.norm(basis.T @ scaled) / np.linalg.norm(scaled)
                if inside > 0.98:
                    return (track.combinations[side],), f" (as for targets {track.where})"
    freedoms = {
        name: vector
        for name, vector in gauges_of(known).items()
        if np.linalg.norm(basis.T @ (vector / scale)) > 0.98 * np.linalg.norm(vector / scale)
    }
    scaled = np.array([vector / scale / np.linalg.norm(vector / scale)
                       for vector in freedoms.values()])  # fmt: skip
    if freedoms and np.linalg.matrix_rank(scaled, rtol=1e-6) == len(directions):
        return tuple(
            f"{name} ({describe_direction(vector, known.names)})"
            for name, vector in freedoms.items()
        ), ""
    # Reduced so that each has a leading bias that the others do not contain.
    rows = basis.T.copy()
    for k in range(len(rows)):
        pivot = int(np.argmax(np.abs(rows[k])))
        rows[k] /= rows[k, pivot]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, pivot] * rows[k]
    texts = []
    for row in rows:
        lead = int(np.argmax(np.abs(row) > 0.5 * np.abs(row).max()))
        kept = np.where(np.abs(row) > 0.05 * np.abs(row).max(), row, 0.0) * scale
        kept /= kept[lead]
        texts.append(describe_direction(np.array([float(f"{x:.2g}") for x in kept]), known.names))
    return tuple(texts), ""
