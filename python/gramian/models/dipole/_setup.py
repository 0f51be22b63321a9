"""What is known and given of a record to locate a dipole in: checked, and gone on with."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import as_float_array, finite, number, whole
from gramian._noise import as_pair
from gramian._text import brief
from gramian._units import labelled
from gramian.exceptions import InputError
from gramian.models.dipole._estimate import KNOWABLE, PLAIN, Description, DipoleModel, Heads
from gramian.models.dipole._model import UNITS, as_ambient, as_baselines, as_deviations

__all__ = ["Background", "Loss", "Options", "Record", "Setup", "as_times", "require_components"]

Array = NDArray[np.float64]

#: Tesla, and seconds; beyond it squares leave the range of the numbers.
LARGEST = 1e100
Background = Literal["median", "fit"]
Loss = Literal["gaussian", "huber"]

_ALIASES = {"x": "x0", "y": "y0", "z": "z0"}

#: The unit of each that may be known.
_UNITS = dict(zip(KNOWABLE, (*UNITS, "m/s", "A m^2"), strict=True))


@dataclass(frozen=True)
class Options:
    """What the search of the crate is told."""

    background: str
    loss: str
    sigma: float | None
    levels: list[float]
    origin: float | None
    starts: int
    rounds: int
    correlation: float
    others: bool = False


class Setup:
    """Checked knowledge, sensors and options."""

    def __init__(
        self,
        known: Mapping[str, float] | None,
        prior: Mapping[str, tuple[float, float]] | None,
        sensors: ArrayLike | None,
        background: str | None,
        loss: str,
        sigma: ArrayLike | None,
        starts: int,
        ambient: ArrayLike | None,
        baselines: ArrayLike | None,
        drift: bool = False,
    ) -> None:
        self.known = {
            _name(key): number(value, labelled(f"known[{key!r}]", _UNITS[_name(key)]))
            for key, value in options.mapping(known, "known").items()
        }
        self.prior = {
            _name(key): as_pair(value, f"prior of {key}", _UNITS[_name(key)])
            for key, value in options.mapping(prior, "prior", "name to (mean, sigma)").items()
        }
        if both := set(self.known) & set(self.prior):
            raise InputError(
                f"{sorted(both)[0]} is known exactly and has a prior: give one of them"
            )
        for name in ("speed", "moment"):
            given = self.known.get(name, self.prior.get(name, (1.0,))[0])
            if not given > 0:
                raise InputError(f"{name} = {given}: must be > 0")
        if background is not None:
            choices = ("median", "fit", "drift") if drift else ("median", "fit")
            options.choice(background, "background", choices)
        options.choice(loss, "loss", ("gaussian", "huber"))
        self.sigma: float | None = None
        self._given: Array | None = None
        if sigma is not None and as_float_array(sigma, "sigma [T]").ndim:
            self._given = as_float_array(sigma, "sigma [T]")
            self.sigma = float(self._given.min(initial=np.inf))
        elif sigma is not None:
            self.sigma = number(sigma, "sigma [T]")
            if not self.sigma > 0:
                raise InputError(f"sigma = {self.sigma} T: must be > 0 and finite")
        starts = whole(starts, "starts", 1, 1000)
        self.one_sensor = sensors is None
        self.sensors = (
            np.zeros((1, 3)) if sensors is None else as_float_array(sensors, "sensors").copy()
        )
        if self.sensors.ndim != 2 or self.sensors.shape[1] != 3 or not len(self.sensors):
            raise InputError(f"sensors has shape {self.sensors.shape}: must be (S, 3)")
        finite(self.sensors, "sensors")
        self.ambient = as_ambient(ambient)
        if self.ambient is not None:
            _require_tesla(float(np.abs(self.ambient).max()), "ambient")
        self.baselines = None if baselines is None else as_baselines(baselines, self.sensors.shape)
        self.heads = Heads.of(self.sensors, self.baselines, self.ambient)
        self.background, self.loss, self.starts = background, loss, starts
        self.max_iterations = 200
        #: `sigma` over the deviation of each number (K, S, components), once this is known.
        self.precision: Array | float = 1.0
        self.used = self.heads.components * len(self.sensors)
        self.exact = [self.known.get(name, np.nan) for name in KNOWABLE]
        self.priors = [list(self.prior.get(name, (np.nan, np.nan))) for name in KNOWABLE]

    @property
    def wanted(self) -> str:
        """The shape of a field."""
        axes = ["K"] if self.one_sensor else ["K", str(len(self.sensors))]
        axes += ["3"] if self.ambient is None else []
        return f"({', '.join(axes)}{',' * (len(axes) == 1)})"

    @property
    def unknowns(self) -> int:
        fitted = self.used if self.background is not None else 0
        return 9 - len(self.known) + fitted

    def options(self, background: str, origin: float | None, correlation: float = 0.0) -> Options:
        return Options(
            background,
            self.loss,
            self.sigma,
            [],
            origin,
            self.starts,
            self.max_iterations,
            correlation,
        )

    def samples(
        self, times: ArrayLike, field: ArrayLike, missing: str, use: ArrayLike | None
    ) -> tuple[Array, Array, int]:
        """Return times (K,), field (K, S, components) and how many numbers are NaN, dropped.

        Numbers that are not used are NaN.
        """
        t, y = as_times(times).copy(), as_float_array(field, "field").copy()
        components = self.heads.components
        if self.ambient is not None and y.ndim == 1 + (not self.one_sensor):
            y = y[..., None]
        if self.one_sensor and y.ndim == 2:
            y = y[:, None, :]
        if t.ndim != 1 or y.shape != (len(t), len(self.sensors), components):
            what = "three components" if components == 3 else "the total field"
            raise InputError(
                f"field has shape {np.shape(field)} for {t.size} times: must be {self.wanted}, "
                f"{what} for each time" + ("" if self.one_sensor else " and sensor")
            )
        options.choice(missing, "missing", ("raise", "drop"))
        wrong = ~np.isfinite(y)
        there = self.measured(y.shape)
        y[~there], wrong[~there] = np.nan, False
        if use is not None:
            unused = ~_used(use, y.shape)
            y[unused], wrong[unused] = np.nan, False
        if wrong.any() and missing == "raise":
            bad = wrong.any(axis=(1, 2))
            raise InputError(
                f"{bad.sum()} of {bad.size} samples are not finite, the first is sample "
                f'{np.argmax(bad)}: missing="drop" leaves out what is not'
            )
        y[wrong] = np.nan
        there = ~np.isnan(y)
        self.used = int(there.any(axis=0).sum())
        largest = float(abs(y[there]).max()) if there.any() else 0.0
        _require_tesla(largest, "the field")
        spread = np.where(there, y, -np.inf).max(axis=0, initial=-np.inf) > np.where(
            there, y, np.inf
        ).min(axis=0, initial=np.inf)
        if self.background is not None and len(t) > 1 and there.any() and not spread.any():
            raise InputError("the field is constant: there is no pass in it to locate")
        self.enough(y)
        return t, y, int(wrong.sum())

    def measured(self, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """Take the precision of each number (K, S, components); return which were measured."""
        if self._given is None or self.sigma is None:
            return np.ones(shape, dtype=bool)
        self.precision = self.sigma / as_deviations(self._given, shape)
        there: NDArray[np.bool_] = self.precision > 0
        self.used = int(there.any(axis=0).sum())
        return there

    def keep(self, samples: NDArray[np.bool_]) -> None:
        """Go on with some of the samples."""
        if isinstance(self.precision, np.ndarray):
            self.precision = self.precision[samples]

    def deviations(self, sigma: float, shape: tuple[int, ...]) -> Array:
        """Return the deviation of each number, for that of the most precise."""
        with np.errstate(divide="ignore"):
            return np.broadcast_to(sigma / np.asarray(self.precision), shape)

    def enough(self, field: Array, where: str = "") -> None:
        """Refuse fields (K, S, 3) of which fewer numbers are there than are looked for."""
        numbers = int((~np.isnan(field)).sum()) + len(self.prior)
        if numbers < max(self.unknowns, 1):
            raise InputError(
                f"{len(field)} samples {where}".rstrip()
                + f" give {numbers} numbers for {self.unknowns} unknowns: too few"
            )

    def run(self, times: ArrayLike, field: Array, options: Options) -> _core._DipoleLocalized:
        leveled = self.leveled(options)
        return _core.dipole_localize(times, field, self.heads, self.exact, self.priors, leveled)

    def leveled(self, options: Options) -> Options:
        """Return options with what is known of the precision of each number."""
        if not isinstance(self.precision, np.ndarray):
            return options
        return replace(options, levels=self.deviations(1.0, self.precision.shape).ravel().tolist())


@dataclass(frozen=True)
class Record:
    """A record as it is fitted: what is left of the samples, and how they are gone about."""

    times: Array
    #: (K, S, components); NaN for what is missing or not used.
    field: Array
    #: What was taken off each channel.
    offsets: Array
    #: Numbers that were dropped since they are missing.
    dropped: int
    setup: Setup
    options: Options
    #: Whether the correlation of the noise is fitted too.
    correlated: bool
    #: Of the answer's status: alpha, chance, weak_ratio.
    limits: tuple[float, float, float]

    @property
    def origin(self) -> float:
        """The instant of the state."""
        given = self.options.origin
        return float(self.times[0]) if given is None else given

    @property
    def filled(self) -> Array:
        """The field, 0 for what is missing or not used."""
        return np.nan_to_num(self.field)

    def of(self, samples: NDArray[np.bool_]) -> Record:
        """Return the record of some of the samples."""
        self.setup.keep(samples)
        return replace(self, times=self.times[samples], field=self.field[samples])

    def with_correlation(self, correlation: float) -> Record:
        """Return the record with noise of this correlation."""
        return replace(self, options=replace(self.options, correlation=correlation))

    def run(self) -> _core._DipoleLocalized:
        """Return the pass of one dipole that fits best."""
        return self.setup.run(self.times, self.field, self.options)

    def model(
        self, raw: _core._DipoleLocalized, weights: Array, about: Description = PLAIN
    ) -> DipoleModel:
        """Return the model at the pass that was found."""
        return DipoleModel(
            self.times - self.origin,
            self.setup.sensors,
            weights * self.setup.precision,
            raw["state"],
            self.setup.known,
            self.setup.prior,
            self.setup.background is not None,
            self.options.correlation,
            float(np.median(np.diff(self.times))) if len(self.times) > 1 else 1.0,
            about,
            self.setup.baselines,
            self.setup.ambient,
        )


def require_components(ambient: object, attitude: object, scale: object) -> None:
    """Refuse errors of sensors that have no axes."""
    if ambient is not None and (attitude is not None or scale is not None):
        raise InputError(
            "attitude and scale are errors of sensors of three components: with ambient, leave "
            "them out"
        )


def _require_tesla(largest: float, what: str) -> None:
    """Refuse a size that no field has, and warn of one that looks like other units."""
    if largest > LARGEST:
        raise InputError(
            f"{what} reaches {brief(largest, 4)} T: must be in tesla, below {LARGEST} T"
        )
    if largest > 1:
        warnings.warn(
            f"{what} reaches {brief(largest, 4)} T: it must be in tesla (1 uT = 1e-6 T)",
            UserWarning,
            stacklevel=4,  # Who called the public function.
        )


def as_times(times: ArrayLike) -> Array:
    """Return times (..., K), finite and so large at most that their spans are."""
    when = as_float_array(times, "times")
    if (far := ~(np.abs(when) <= LARGEST)).any():
        at = np.unravel_index(int(np.argmax(far)), far.shape)
        place = ", ".join(map(str, at))
        if not np.isfinite(when[at]):
            raise InputError(f"times[{place}] must be finite")
        raise InputError(f"times[{place}] = {when[at]:g} s: must be at most {LARGEST} s")
    return when


def _used(use: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return which numbers of the field (K, S, 3) are to be used."""
    try:
        given = np.asarray(use)
    except ValueError:
        # Rows of different lengths.
        given = np.empty(0)
    if given.dtype != bool:
        raise InputError(f"use = {options.given(use)}: must be True or False for each")
    samples, sensors, components = shape
    shapes = [(components * sensors,), (sensors, components), shape]
    if sensors == 1:
        shapes.append((samples, components))
    if components == 1:
        shapes.append((samples, sensors))
        shapes += [(samples,)] if sensors == 1 else []
    for whole_shape in shapes:
        if given.shape == whole_shape and (len(whole_shape) < 3 or given.size):
            return np.broadcast_to(given.reshape(-1, sensors, components), shape)
    raise InputError(
        f"use has shape {given.shape}: must be ({components * sensors},), "
        f"({sensors}, {components}) or that of field"
    )


def _name(key: str) -> str:
    name = _ALIASES.get(key, key)
    if name not in KNOWABLE:
        raise InputError(f"{key!r} cannot be known: there are {', '.join(KNOWABLE)}")
    return name
