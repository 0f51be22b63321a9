"""Reports: what the sensors measured, matched in time; simulated or recorded."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gramian import _core
from gramian import _options as options
from gramian._arrays import SEED_MOST, as_float_array, number, real, whole, wrap_angles
from gramian._text import brief
from gramian._values import Value
from gramian.exceptions import InputError
from gramian.models.registration._setup import Array, Extra, SensorsLike, Setup, setup


@dataclass(frozen=True, eq=False)
class Reports(Value):
    """Reports of all sensors on the same targets at the same instants.

    Parameters
    ----------
    values : array_like, shape (..., K, N, d)
        For each look and sensor: range (m), azimuth and, with d = 3, elevation (rad).
    times : array_like, shape (K,), optional
        Instants of the looks, seconds: those of one target after the other, where a time that
        does not increase begins the next. Platforms that move need them.
    """

    values: Array
    times: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", report_array(self.values))
        if self.times is not None:
            times = np.asarray(self.times, dtype=float)
            if times.shape != (self.values.shape[-3],):
                raise InputError(
                    f"times has shape {times.shape}: must be ({self.values.shape[-3]},), "
                    "one for each look"
                )
            object.__setattr__(self, "times", times)

    def positions(
        self,
        sensors: SensorsLike,
        sigma: ArrayLike,
        *,
        extras: Sequence[Extra] = (),
        biases: ArrayLike | Mapping[str, float] | None = None,
    ) -> Array:
        """Return where all sensors together put the targets.

        Parameters
        ----------
        sensors, sigma, extras
            As for `rows`.
        biases : array_like, shape (..., n), or mapping of str to float, optional
            Taken off the reports first.

        Returns
        -------
        ndarray, shape (..., K, d)
            The mean of the sensors' positions, weighted by their noise.
        """
        known = stage(self, sensors, sigma, extras)
        return targets(known, self, biases)


def report_array(value: ArrayLike | Sequence[ArrayLike]) -> Array:
    """Return reports as an array (..., K, N, d); warn of degrees."""
    try:
        array = as_float_array(value, "reports")  # type: ignore[arg-type]
    except InputError:
        try:
            lengths = [np.size(item) for item in value]  # type: ignore[union-attr]
        except (TypeError, ValueError):
            lengths = []
        if len(set(lengths)) < 2:
            raise
        raise InputError(
            f"reports of different length ({', '.join(map(str, lengths))}): every look needs "
            "one report from each sensor; match() pairs recordings by their times"
        ) from None
    if array.ndim < 3 or array.shape[-1] not in (2, 3):
        raise InputError(
            f"reports has shape {array.shape}: must be (..., K, N, d), for each look and sensor "
            "range, azimuth and, in space, elevation"
        )
    largest = np.fmax.reduce(np.abs(array[..., 1:]), axis=None, initial=0.0)
    if largest > 2 * np.pi:
        warnings.warn(
            f"reports have an angle of {brief(largest, 4)} rad, more than a whole turn: "
            "are they in degrees? Angles are in radians here",
            UserWarning,
            stacklevel=3,
        )
    return array


def fused(known: Setup, reports: Array, biases: Array) -> Array:
    """Return the weighted mean (..., K, d) of the sensors' positions."""
    reports = known.to_north(reports)
    places = _core.registration_places(reports, known.places, known.sigma, biases, known.flags)
    offset = places - known.places
    if not (np.abs(offset) < 1e150).all():
        raise InputError(
            "reports: a sensor would be more than 1e150 m from a target: "
            "its square overflows float64"
        )
    ranges = np.linalg.norm(offset, axis=-1, keepdims=True)
    if not (ranges > 0).all():
        raise InputError("reports: a corrected range is 0: the target would be on the sensor")
    along = offset / ranges
    # Weights 1/sigma^2 along the line of sight and 1/(r sigma)^2 across it.
    flat = np.hypot(along[..., 0], along[..., 1])[..., None]
    flat = np.maximum(flat, np.finfo(float).tiny)
    turn = np.zeros_like(along)
    turn[..., 0], turn[..., 1] = along[..., 1] / flat[..., 0], -along[..., 0] / flat[..., 0]
    axes = [(along, np.ones_like(ranges)), (turn, ranges * flat)]
    if known.d == 3:
        axes.append((np.cross(turn, along), ranges))
    weight = np.zeros((*places.shape, known.d))
    for i, (axis, lever) in enumerate(axes):
        strength = 1 / (lever[..., 0] * known.sigma[:, i]) ** 2
        weight += strength[..., None, None] * axis[..., :, None] * axis[..., None, :]
    total = weight.sum(axis=-3)
    pulled = (weight @ places[..., None]).sum(axis=-3)
    try:
        positions: Array = np.linalg.solve(total, pulled)[..., 0]
        placed = bool(np.isfinite(positions).all())
    except np.linalg.LinAlgError:
        placed = False
    if not placed:
        raise InputError(
            f"reports: the sensors, up to {brief(ranges.max())} m from a target, cannot place it: "
            "in one direction nothing is left of their accuracy"
        )
    return positions


def stage(
    value: ArrayLike | Reports,
    sensors: SensorsLike,
    sigma: ArrayLike | None,
    extras: Sequence[Extra] = (),
    least: int = 2,
    times: ArrayLike | None = None,
) -> Setup:
    """Return the sensors at the looks of positions or reports, whose own times come first."""
    if isinstance(value, Reports) and value.times is not None:
        times = value.times
    known = setup(sensors, sigma, extras, least, times=times)
    if not known.moves:
        return known
    if isinstance(value, Reports):
        shape = value.values.shape[:-1]
    else:
        shape = as_float_array(value, "positions").shape
    looks = shape[-2] if len(shape) > 1 else 0
    if looks != len(known.places):
        raise InputError(
            f"times has shape ({len(known.places)},): must be ({looks},), one for each look"
        )
    return known


def targets(
    known: Setup, value: ArrayLike | Reports, biases: ArrayLike | Mapping[str, float] | None
) -> Array:
    """Return positions (..., K, d) from positions or from reports."""
    if isinstance(value, Reports):
        return fused(known, value.values, known.biases(biases))
    return as_float_array(value, "positions")


def simulate(
    positions: ArrayLike,
    sensors: SensorsLike,
    sigma: ArrayLike,
    biases: ArrayLike | Mapping[str, float] | None = None,
    *,
    seed: int,
    trials: int | None = None,
    extras: Sequence[Extra] = (),
    times: ArrayLike | None = None,
) -> Reports:
    """Return noisy, biased reports; the same for the same seed on any machine.

    Parameters
    ----------
    positions : array_like, shape (K, d)
        The true positions of the looks' targets, metres.
    sensors, sigma, extras
        As for `rows`.
    biases : array_like, shape (n,), or mapping of str to float, optional
        The true biases: ``{"A.range": 300.0, "B.azimuth": -0.007}``; 0 where none is given.
    seed : int
        >= 0. Trial i depends on (seed, i) alone.
    trials : int, optional
        Number of trials; without it one trial without a leading axis.
    times : array_like, shape (K,), optional
        Of the looks, seconds: where platforms that move are then. Kept in the reports.

    Returns
    -------
    Reports
        Values (K, N, d) or (trials, K, N, d).

    Examples
    --------
    >>> one = simulate([[2e4, 3e4]], [[0, 0], [6e4, 0]], (50.0, 0.002), {"A.range": 300.0}, seed=1)
    >>> one.values.shape
    (1, 2, 2)
    """
    seed = whole(seed, "seed", 0, SEED_MOST)
    if trials is not None:
        trials = whole(trials, "trials", 1)
    known = stage(positions, sensors, sigma, extras, times=times)
    exact = _core.registration_reports(
        positions, known.places, known.sigma, known.biases(biases), known.flags
    )
    if exact.ndim != 3:
        raise InputError("simulate takes one set of looks, positions (K, d)")
    noise = _core.normals(seed, 0, trials or 1, exact.size).reshape(-1, *exact.shape)
    with np.errstate(over="ignore", invalid="ignore"):
        noisy = exact + known.sigma * noise
    if not np.isfinite(noisy).all():
        raise InputError(f"sigma reaches {known.sigma.max():.3g}: its noise overflows float64")
    values = known.as_measured(noisy)
    return Reports(
        values if trials is not None else values[0],
        None if times is None else as_float_array(times, "times"),
    )


def match(
    recordings: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    interpolate: Literal["none", "linear"] = "none",
    missing: Literal["raise", "drop", "keep"] = "raise",
    tolerance: float = 1e-3,
    max_gap: float = np.inf,
) -> Reports:
    """Pair recordings of one target by their times.

    Parameters
    ----------
    recordings : mapping of str to (times, reports)
        For each sensor, in the order of the sensors: instants (K_s,), increasing,
        and reports (K_s, d). A report with NaN is one that is missing.
    interpolate : {"none", "linear"}
        What to do where instants differ by more than the tolerance: refuse, or
        interpolate all reports to the instants of the first sensor that lie
        within every recording.
    missing : {"raise", "drop", "keep"}
        What to do, without interpolation, with instants at which not every sensor has a
        report: refuse; leave them out; or keep them, with NaN where a report is missing,
        as `estimate` takes them.
    tolerance : float
        Seconds by which instants may differ and be the same.
    max_gap : float
        Seconds; looks in a longer gap of any recording are left out.

    Returns
    -------
    Reports

    Raises
    ------
    InputError
        Recordings whose lengths or times do not match, unless interpolation is
        asked for; recordings without a common time.

    Notes
    -----
    A target that turns between two reports is not where the line between them
    is: at 10 s and 3 g that is some hundred metres. Interpolate only what moves
    straight between reports, or what is reported often.

    Examples
    --------
    >>> a = ([0.0, 10.0], [[1000.0, 0.1], [1100.0, 0.2]])
    >>> b = ([0.0, 5.0, 10.0], [[900.0, 0.0], [950.0, 0.1], [1000.0, 0.2]])
    >>> match({"A": a, "B": b}, interpolate="linear").values.shape
    (2, 2, 2)
    """
    options.choice(interpolate, "interpolate", ("none", "linear"))
    options.choice(missing, "missing", ("raise", "drop", "keep"))
    tolerance, max_gap = number(tolerance, "tolerance [s]"), real(max_gap, "max_gap")
    if tolerance < 0:
        raise InputError(f"tolerance = {tolerance} s: must be >= 0")
    if not max_gap > 0:
        raise InputError(f"max_gap = {max_gap} s: must be > 0")
    clean = _recordings(recordings)
    if len(clean) < 2:
        raise InputError(f"recordings has {len(clean)} entries: registration needs 2 or more")
    (first, (t, _)), *others = clean.items()
    if interpolate == "none" and missing != "raise":
        return _together(clean, tolerance, missing == "keep")
    if interpolate == "none":
        for name, (other, _) in others:
            if len(other) != len(t):
                raise InputError(
                    f"reports of different length: {first!r} has {len(t)}, {name!r} {len(other)}; "
                    'interpolate="linear" matches them, missing="drop" leaves out what one lacks'
                )
            apart = np.abs(other - t)
            if (late := np.flatnonzero(apart > tolerance)).size:
                raise InputError(
                    f"report {late[0]} of {first!r} is at {t[late[0]]} s, of {name!r} at "
                    f"{other[late[0]]} s: times do not match; "
                    'interpolate="linear" brings them to the times of the first'
                )
        return Reports(np.stack([v for _, v in clean.values()], axis=1), t)
    inside = np.ones(t.size, dtype=bool)
    for other, _ in clean.values():
        inside &= (t >= other[0]) & (t <= other[-1])
        place = np.clip(np.searchsorted(other, t), 1, max(len(other) - 1, 1))
        if len(other) > 1:
            exact = (np.abs(t - other[place]) <= tolerance) | (
                np.abs(t - other[place - 1]) <= tolerance
            )
            inside &= exact | (other[place] - other[place - 1] <= max_gap)
    chosen = t[inside]
    if not chosen.size:
        raise InputError("the recordings have no common time")
    columns = []
    for other, values in clean.values():
        unwrapped = values.copy()
        unwrapped[:, 1] = np.unwrap(values[:, 1])
        columns.append(np.stack([np.interp(chosen, other, c) for c in unwrapped.T], axis=-1))
    joined = np.stack(columns, axis=1)
    joined[..., 1] = wrap_angles(joined[..., 1])
    return Reports(joined, chosen)


def _together(recordings: dict[str, tuple[Array, Array]], tolerance: float, keep: bool) -> Reports:
    """Return the looks at which all sensors report, or any."""
    times = np.concatenate([t for t, _ in recordings.values()])
    order = np.argsort(times, kind="stable")
    look = np.empty(len(times), dtype=int)
    start, count = -np.inf, -1
    for i in order:
        if times[i] - start > tolerance:
            start, count = times[i], count + 1
        look[i] = count
    width = next(iter(recordings.values()))[1].shape[1]
    values = np.full((count + 1, len(recordings), width), np.nan)
    at, first = np.full(count + 1, np.nan), 0
    for s, (name, (t, v)) in enumerate(recordings.items()):
        own = look[first : first + len(t)]
        if (twice := np.flatnonzero(np.diff(own) == 0)).size:
            k = int(twice[0])
            raise InputError(
                f"recording {name!r}: reports at {t[k]} s and {t[k + 1]} s are within the "
                f"tolerance of {brief(tolerance)} s: it must be smaller"
            )
        values[own, s] = v
        at[own] = np.where(np.isnan(at[own]), t, at[own])
        first += len(t)
    use = np.isfinite(values).all(axis=(1, 2)) | keep
    if not use.any():
        raise InputError("the recordings have no common time")
    return Reports(values[use], at[use])


def _recordings(
    recordings: Mapping[str, tuple[ArrayLike, ArrayLike]],
) -> dict[str, tuple[Array, Array]]:
    clean = {}
    for name, pair in options.mapping(
        recordings, "recordings", "sensor to (times, values)"
    ).items():
        if not isinstance(pair, (tuple, list)) or len(pair) != 2:
            raise InputError(
                f"recordings[{name!r}] = {options.given(pair)}: must be times and values"
            )
        clean[name] = _recording(name, *pair)
    widths = {name: v.shape[1] for name, (_, v) in clean.items()}
    if len(set(widths.values())) > 1:
        told = ", ".join(f"{name!r} {width}" for name, width in widths.items())
        raise InputError(f"reports have different numbers of columns: {told}")
    return clean


def _recording(name: str, times: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    """Check one sensor's recording."""
    t, v = (
        as_float_array(x, f"recording {name!r}: {what}")
        for x, what in ((times, "times"), (values, "reports"))
    )
    if t.ndim != 1 or v.ndim != 2 or len(t) != len(v) or not len(t) or v.shape[1] not in (2, 3):
        raise InputError(
            f"recording {name!r}: times {t.shape} and reports {v.shape}: must be (K,) and (K, d), "
            "for each time a report of range, azimuth and, in space, elevation"
        )
    if (late := np.flatnonzero(~(np.diff(t) > 0))).size:
        raise InputError(
            f"recording {name!r}: times[{late[0] + 1}] = {t[late[0] + 1]} s: "
            f"must be later than the one before, {t[late[0]]} s"
        )
    if np.isinf(v).any():
        raise InputError(
            f"recording {name!r}: reports[{np.argwhere(np.isinf(v))[0][0]}] is infinite"
        )
    # NaN is a report that is missing.
    there = ~np.isnan(v).any(axis=1)
    if not there.any():
        raise InputError(f"recording {name!r}: every report is NaN")
    return t[there], v[there]
