"""Locating a passing dipole from its field and what is known beforehand."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import ITERATIONS_MOST, SEED_MOST, as_float_array, finite, number, whole
from gramian._noise import as_pair
from gramian._text import brief, describe_null_space
from gramian._units import labelled
from gramian.analysis import analyze
from gramian.estimation import Solution as Other
from gramian.estimation._knowledge import levels
from gramian.exceptions import InputError, UnobservableError
from gramian.models.dipole._estimate import KNOWABLE, Description, DipoleModel, Heads
from gramian.models.dipole._model import (
    NAMES,
    UNITS,
    Pass,
    as_ambient,
    as_baselines,
    as_deviations,
    problem,
)
from gramian.models.dipole._result import (
    ClosestPoint,
    Localization,
    Localizations,
    Solution,
    root,
)

__all__ = ["localize", "localize_many", "localize_trials"]

Array = NDArray[np.float64]

#: Tesla, and seconds; beyond it squares leave the range of the numbers.
LARGEST = 1e100
Background = Literal["median", "fit"]
Motion = Literal["straight", "along", "accelerated", "turning"]
Loss = Literal["gaussian", "huber"]

_PLAIN = Description()

_ALIASES = {"x": "x0", "y": "y0", "z": "z0"}

#: The unit of each that may be known.
_UNITS = dict(zip(KNOWABLE, (*UNITS, "m/s", "A m^2"), strict=True))

#: A window of the pass reaches this many times the time from the closest point
#: to 45 degrees: the field is down to 1 or 2 per cent there.
_REACH = 4.0


@dataclass(frozen=True)
class _Options:
    background: str
    loss: str
    sigma: float | None
    levels: list[float]
    origin: float | None
    starts: int
    rounds: int
    correlation: float


def localize(
    times: ArrayLike,
    field: ArrayLike,
    known: Mapping[str, float] | None = None,
    *,
    prior: Mapping[str, tuple[float, float]] | None = None,
    sensors: ArrayLike | None = None,
    ambient: ArrayLike | None = None,
    baselines: ArrayLike | None = None,
    background: Background | Literal["drift"] | None = None,
    sources: int | Sequence[int] = 1,
    motion: Motion | Sequence[Motion] = "straight",
    attitude: float | None = None,
    scale: float | None = None,
    earth_field: ArrayLike | None = None,
    loss: Loss = "gaussian",
    sigma: ArrayLike | None = None,
    window: Literal["pass"] | tuple[float, float] | None = None,
    missing: Literal["raise", "drop"] = "raise",
    use: ArrayLike | None = None,
    correlation: float | Literal["fit"] = 0.0,
    starts: int = 12,
    alpha: float = 0.001,
    chance: float = 0.01,
    weak_ratio: float = 0.25,
    max_iterations: int = 200,
) -> Localization:
    """Locate a passing dipole from the field it makes and what is known beforehand.

    Parameters
    ----------
    times : array_like, shape (K,)
        Increasing, seconds. The state is that of the first one.
    field : array_like, shape (K, 3), or (K, S, 3) with `sensors`
        Tesla; with `ambient` (K,) or (K, S), as `measure` returns.
    known : mapping of str to float, optional
        What is known exactly: x0 (or x), y0, z0, vx, vy, vz, mx, my, mz, speed
        (m/s), moment (its size, A m^2).
    prior : mapping of str to (mean, sigma), optional
        What is known to a standard deviation, by the same names.
    sensors : array_like, shape (S, 3), optional
        Where the sensors are, metres; one at the origin by default.
    ambient : array_like, shape (3,), optional
        The field without the dipole, tesla, at sensors of the total field: they read
        ``|ambient + field|``. Its direction must be right; its size may be slightly wrong
        where a `background` is fitted.
    baselines : array_like, shape (3,) or (S, 3), optional
        From each sensor to its second head, metres, of gradiometers: `field` is the
        difference, that of the second head less that of the first, tesla (the gradient
        times the length).
    background : {"median", "fit"}, optional
        What to do about a constant field in the record (of the total field, beside the size
        of `ambient`): fit a constant to each channel;
        with "median" the median of the whole record is taken off first; with "drift" a
        line in time is fitted beside the constant. Nothing by default.
    sources : int or sequence of int
        How many dipoles the body carries, 1 to 4; of several the one of the least BIC. With
        more than one r0 and m, known or with a prior too, are those of the first; `moment` and
        `closest` are of all: of the sum of the moments, and of their centre.
    motion : {"straight", "along", "accelerated", "turning"}, or a sequence of these
        How the body moves, see `Description`; of several the one of the least BIC.
    attitude, scale : float, optional
        Standard deviations of the attitude (rad) and of the scale of each sensor, which are
        states then; exact by default.
    earth_field : array_like, shape (3,), optional
        The ambient field, tesla, of a body that it magnetises: beside the permanent moment
        m, which turns with the body, there is one along this field, whose size is the state
        "induced volume". The two are told apart where the body turns (``motion="turning"``).
    loss : {"gaussian", "huber"}
        Squares, or Huber's loss with spikes rejected.
    sigma : array_like, shape (), (K,), (S, 3) or (K, S, 3), optional
        Standard deviation of the noise, tesla (for gradiometers that of the difference): of
        all, of each time, channel or number, `inf` for what is not to be used; with `ambient`
        (S, 1) or (K, S, 1). Estimated from the residuals, one for all, by default.
    window : "pass" or (start, end), optional
        Use only these times; "pass" finds the pass first and keeps four times
        the time from its closest point to 45 degrees on both sides.
    missing : {"raise", "drop"}
        What to do about numbers that are NaN.
    use : array_like of bool, shape (3 S,), (S, 3) or that of `field`, optional
        Which channels, or which numbers, to use: ``check_record(times, field).usable`` for
        one. All by default. With `ambient` (S,), (S, 1) or that of `field`. What has an
        infinite `sigma` is not used either.
    correlation : float or "fit"
        Of the noise of neighbouring samples of a channel, at the usual time between them:
        from 0, white noise, to below 1; or fitted with the pass.
    starts : int
        How many starts are followed, 1 to 1000.
    alpha, chance, weak_ratio : float
        As for `gramian.estimate`: levels of "misfit" and "ambiguous", and the share of the
        closest range that its deviation may be before the answer is "weak".
    max_iterations : int
        Most iterations of the separable least squares from each start, >= 1.

    Returns
    -------
    Localization
        A `gramian.Estimate`: look at its status first.

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
    form. The covariance is the Cramer-Rao bound under the constraints, under Huber's loss
    that of the M-estimate; where the model itself is the larger error it is too small.
    Correlated noise is of first order, its parameters by restricted maximum likelihood. Where
    channels have a `sigma` each, `explained` weighs the numbers by it.

    For the total field, the search takes the component along `ambient` for the reading; the
    best of what it finds is fitted with ``|ambient + field|``. Where the dipole's field is far
    weaker than the ambient one, a single sensor determines five numbers for nine unknowns: a
    time, a duration and three sizes. The mirror image at a single gradiometer is the pass
    reflected in its middle, with the opposite velocity and moment.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(21.0)
    >>> y = gm.dipole.simulate([-10, -10, 5], [1, 1, 0], [10, 20, 10], t, 1e-12, seed=1)
    >>> answer = gm.dipole.localize(t, y, {"z": 5.0, "vz": 0.0}, sigma=1e-12)
    >>> answer.m.round(1), answer.mirror
    (array([10., 20., 10.]), None)
    """
    setup = _Setup(
        known, prior, sensors, background, loss, sigma, starts, ambient, baselines, drift=True
    )
    if ambient is not None and (attitude is not None or scale is not None):
        raise InputError(
            "attitude and scale are errors of sensors of three components: with ambient, leave "
            "them out"
        )
    wanted = _descriptions(sources, motion, background == "drift", attitude, scale, earth_field)
    limits = levels(alpha, chance, weak_ratio)
    setup.max_iterations = whole(max_iterations, "max_iterations", 1, ITERATIONS_MOST)
    fitted = isinstance(correlation, str) and correlation == "fit"
    if not fitted:
        correlation = number(correlation, "correlation")
        if not 0 <= correlation < 1:
            raise InputError(f"correlation = {correlation}: must be from 0 to below 1")
    t, y, dropped = setup.samples(times, field, missing, use)
    # The instant of the state, whichever samples are used.
    origin = float(np.ravel(as_float_array(times, "times"))[0])
    offsets = np.zeros(y.shape[1:])
    if background == "median":
        # Over the whole record: a window of the pass alone has no quiet part.
        measured = ~np.isnan(y).all(axis=0)
        offsets[measured] = np.nanmedian(y[:, measured], axis=0) - setup.heads.quiet
        y = y - offsets
    fixed = 0.0 if fitted else float(correlation)
    inner = setup.options("none" if background is None else "fit", origin, fixed)
    if isinstance(window, tuple):
        start, end = window
        keep = (t >= start) & (t <= end)
        t, y = t[keep], y[keep]
        setup.keep(keep)
    elif window is not None and not (isinstance(window, str) and window == "pass"):
        raise InputError(f'window = {options.given(window)}: must be "pass", (start, end) or None')
    setup.enough(y, "in the window" if window is not None else "")
    raw = setup.run(t, y, inner)
    if window == "pass":
        keep = _of_the_pass(raw["state"], t - origin, setup.sensors)
        if (~np.isnan(y[keep])).sum() >= 4 * setup.unknowns:
            t, y = t[keep], y[keep]
            setup.keep(keep)
            raw = setup.run(t, y, inner)
    # Few numbers of each sample leave other passes that fit as well.
    few = ambient is not None or baselines is not None
    if few or wanted != [Description()]:
        return _described(wanted, raw, t, y, offsets, inner, dropped, setup, limits, fitted)
    if fitted:
        inner, raw = _with_correlation(raw, t, y, inner, setup)
    return _answer(raw, t, y, offsets, inner, dropped, setup, limits, correlation_given=not fitted)


def _with_correlation(
    raw: _core._DipoleLocalized, t: Array, y: Array, inner: _Options, setup: _Setup
) -> tuple[_Options, _core._DipoleLocalized]:
    """Return the answer with the correlation of the noise that fits, and the options for it."""
    for _ in range(8):
        model = setup.model(raw, t, inner, np.sqrt(raw["weights"]))
        state = _states(model, raw)
        found, _ = model.record(np.nan_to_num(y)).noise(state, model.spacing, setup.sigma)
        moved, inner = abs(found - inner.correlation), replace(inner, correlation=found)
        raw = setup.run(t, y, inner)
        if moved < 1e-2 * (1 - found):
            break
    return inner, raw


def _states(model: DipoleModel, raw: _core._DipoleLocalized) -> Array:
    """Return the states of a model for a pass that was found, with the constants."""
    state = model.coordinates(raw["state"])
    if model.background:
        levels = raw["background"].ravel()[model.used]
        first = len(state) - len(levels) * (2 if model.description.drift else 1)
        state[first : first + len(levels)] = levels
    return state


def _descriptions(
    sources: int | Sequence[int],
    motion: str | Sequence[str],
    drift: bool,
    attitude: float | None,
    scale: float | None,
    earth_field: ArrayLike | None,
) -> list[Description]:
    """Return what a record may be explained by, motion after motion, sources ascending."""
    if isinstance(sources, Sequence) and not isinstance(sources, str):
        counts = sorted({whole(count, "sources", 1, 4) for count in sources})
    else:
        counts = [whole(sources, "sources", 1, 4)]
    motions = [motion] if isinstance(motion, str) or motion is None else list(motion)
    for one in motions:
        options.choice(one, "motion", ("straight", "along", "accelerated", "turning"))
    if not counts or not motions:
        raise InputError("sources and motion must name at least one each")
    deviations = []
    for given, name in ((attitude, "attitude [rad]"), (scale, "scale")):
        value = None if given is None else number(given, name)
        if value is not None and not value > 0:
            raise InputError(f"{name} = {value}: must be > 0")
        deviations.append(value)
    ambient = None
    if earth_field is not None:
        values = finite(earth_field, "earth_field [T]")
        if values.shape != (3,) or not values.any():
            raise InputError(f"earth_field = {values.tolist()}: must be three numbers, not all 0")
        x, y, z = values.tolist()
        ambient = (x, y, z)
    tilt, gain = deviations
    return [Description(m, n, drift, tilt, gain, ambient) for m in motions for n in counts]


@dataclass(frozen=True)
class _Settled:
    """What a description makes of a record."""

    about: Description
    model: DipoleModel
    state: Array
    weights: Array
    efficiency: float
    sigma: float
    converged: bool
    iterations: int
    bic: float


def _settle(
    about: Description,
    starts: Array,
    raw: _core._DipoleLocalized,
    t: Array,
    y: Array,
    inner: _Options,
    setup: _Setup,
    correlated: bool,
) -> _Settled:
    """Fit a description from some starts, until noise and weights settle."""
    filled, counts = np.nan_to_num(y), (raw["weights"] > 0) & ~np.isnan(y)
    weights, efficiency = raw["weights"] * counts, float(raw["efficiency"])
    sigma, count = float(raw["sigma"]), int(counts.sum())
    iterations = 0
    for _ in range(20):
        model = setup.model(raw, t, inner, np.sqrt(weights * efficiency) / sigma, about)
        handle = model.handle(filled)
        found = handle.minimize(starts, ("squares", 0.0), setup.max_iterations)
        if not found:
            raise InputError("the body meets a sensor at every start")
        state, before = found[0]["x"], (sigma, inner.correlation)
        starts, iterations = state[None], iterations + found[0]["iterations"]
        unit = replace(model, weights=(counts * setup.precision).astype(float))
        if correlated:
            even = replace(unit, correlation=0.0)
            rho, _ = even.record(filled).noise(state, model.spacing, setup.sigma)
            inner = replace(inner, correlation=rho)
        if setup.loss == "huber":
            flat, efficiency, sigma = unit.record(filled).robust(state, setup.sigma)
            weights = flat.reshape(counts.shape)
        elif setup.sigma is None:
            left = unit.residuals(state, filled)
            sigma = float(np.sqrt(left @ left / max(count - len(state), 1)))
            sigma = max(sigma, 1e-12 * before[0])
        settled = abs(sigma - before[0]) < 1e-4 * sigma
        if settled and abs(inner.correlation - before[1]) < 1e-2 * (1 - inner.correlation):
            break
    left = unit.residuals(state, filled) / sigma
    size = np.abs(left)
    loss = left**2
    if setup.loss == "huber":
        loss = np.where(size > 1.345, 1.345 * (2 * size - 1.345), loss)
    # Twice the log likelihood, less a constant; with the variances of the innovations.
    steps = np.diff(t) / model.spacing
    share = inner.correlation ** (2 * steps) if inner.correlation > 0 else np.zeros(len(steps))
    log_variance = setup.used * float(np.log1p(-share).sum())
    bic = loss.sum() + 2 * count * np.log(sigma) + log_variance + len(state) * np.log(count)
    return _Settled(
        about,
        setup.model(raw, t, inner, np.sqrt(weights * efficiency) / sigma, about),
        state,
        weights,
        efficiency,
        sigma,
        bool(found[0]["converged"]),
        iterations,
        float(bic),
    )


def _described(
    wanted: Sequence[Description],
    raw: _core._DipoleLocalized,
    t: Array,
    y: Array,
    offsets: Array,
    inner: _Options,
    dropped: int,
    setup: _Setup,
    limits: tuple[float, float, float],
    correlated: bool,
) -> Localization:
    """Return the answer of the description that explains the record best."""
    filled = np.nan_to_num(y)
    tried: list[_Settled] = []
    failed: list[str] = []
    for motion in dict.fromkeys(about.motion for about in wanted):
        counts = [about.sources for about in wanted if about.motion == motion]
        last: _Settled | None = None
        for count in range(1, max(counts) + 1):
            about = replace(wanted[0], motion=motion, sources=count)
            if last is None:
                model = setup.model(raw, t, inner, np.sqrt(raw["weights"]), about)
                starts = _states(model, raw)[None]
            else:
                starts = last.model.record(filled).seeds(last.state, 8)
            try:
                settled = _settle(about, starts, raw, t, y, inner, setup, correlated)
                # A dipole without a moment, or far away, tells of nothing.
                _core.Analysis(settled.model.handle(filled).linearize(settled.state)[1], None)
            except InputError as error:
                failed.append(f"{about}: {error}")
                break
            if count in counts:
                tried.append(settled)
                earlier = last is not None and last.about.sources in counts
                if last is not None and earlier and settled.bic > last.bic:
                    break
            last = settled
    if not tried:
        raise InputError(f"no description fits: {'; '.join(failed)}")
    tried.sort(key=lambda one: one.bic)
    best = tried[0]
    model, handle = best.model, best.model.handle(filled)
    alike = model.record(filled).alike(best.state)
    searched = handle.others(best.state, alike, None, 0, 0)
    # The best of all that were reached, which may be another than the fit began with.
    state = np.asarray(searched["x"])
    found = model.expand(state)[0]
    others, mirror = [], None
    best_bodies = _bodies(model, state, handle)
    for other in searched["others"]:
        if _same_bodies(best_bodies, _bodies(model, other["x"], handle)):
            # Only which of the dipoles is called the first differs.
            continue
        others.append(
            Other(other["x"], other["chi2"], other["distance"], other["chance"], other["hits"])
        )
        if mirror is None:
            image = model.expand(other["x"])[0]
            mirror = Solution(image[:3], image[3:6], image[6:], other["chi2"])
    left = handle.linearize(state)[0]
    exact = model.h(state).reshape(y.shape)
    names = [name for name in model.names if name.startswith("background")]
    levels = np.zeros(offsets.shape)
    if names:
        first = model.names.index(names[0])
        levels[model.used.reshape(levels.shape)] = state[first : first + len(names)]
    return _localization(
        _Found(
            model=model,
            state=state,
            found=found,
            cost=float(left @ left),
            mirror=mirror,
            others=tuple(others),
            sigma=best.sigma,
            weights=best.weights,
            residuals=filled - exact,
            fitted=levels,
            converged=best.converged,
            iterations=best.iterations,
        ),
        t,
        y,
        offsets,
        replace(inner, correlation=model.correlation),
        dropped,
        setup,
        limits,
        correlation_given=not correlated,
        candidates=tuple((one.about, one.bic) for one in tried),
    )


def _bodies(model: DipoleModel, x: Array, handle: _core.Model) -> tuple[Array, Array]:
    """Return place and moment (count, 6) of each dipole of a state, and their deviations."""
    full, by = model.expand(x)
    places, moved = model.bodies(x)
    places[:, :3] += full[:3]
    moved[:, :3] += by[:3]
    covariance = _core.Analysis(handle.linearize(x)[1], None).crlb()
    if covariance is None:
        return places, np.zeros(places.shape)
    spread = ((moved @ covariance) * moved).sum(axis=-1)
    return places, np.sqrt(np.maximum(spread, 0.0))


def _same_bodies(one: tuple[Array, Array], other: tuple[Array, Array]) -> bool:
    """Say whether two answers have the same dipoles in another order, as far as noise tells."""
    orders = list(itertools.permutations(range(len(one[0]))))[1:]
    return any(
        (np.abs(one[0] - other[0][list(p)]) < 5 * np.hypot(one[1], other[1][list(p)])).all()
        for p in orders
    )


def localize_many(
    times: ArrayLike,
    field: ArrayLike,
    known: Mapping[str, float] | None = None,
    *,
    prior: Mapping[str, tuple[float, float]] | None = None,
    sensors: ArrayLike | None = None,
    ambient: ArrayLike | None = None,
    baselines: ArrayLike | None = None,
    background: Background | None = None,
    loss: Loss = "gaussian",
    sigma: ArrayLike | None = None,
    starts: int = 12,
) -> Localizations:
    """Locate dipoles in many records at once.

    Parameters
    ----------
    times : array_like, shape (..., K)
        Increasing, seconds.
    field : array_like, shape (..., K, 3), or (..., K, S, 3) with `sensors`
        Tesla; with `ambient` (..., K) or (..., K, S).
    known, prior, sensors, ambient, baselines, background, loss, sigma, starts
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
    setup = _Setup(known, prior, sensors, background, loss, sigma, starts, ambient, baselines)
    y = as_float_array(field, "field").copy()
    if y.ndim < 1 + (sensors is not None) + (ambient is None):
        raise InputError(f"field has shape {y.shape}: must be (..., {setup.wanted[1:]}")
    if ambient is not None:
        y = y[..., None]
    if sensors is None:
        y = y[..., None, :]
    when = _as_times(times)
    there = setup.measured((*when.shape[-1:], len(setup.sensors), setup.heads.components))
    if y.shape[-3:] == there.shape:
        y[..., ~there] = 0.0
    finite(y, "field")
    if background == "median":
        seen = np.where(there, y, np.nan) if y.shape[-3:] == there.shape else y
        used = there.any(axis=0)
        offsets = np.zeros((*y.shape[:-3], 1, *y.shape[-2:]))
        offsets[..., used] = np.nanmedian(seen[..., used], axis=-2, keepdims=True)
        y = y - (offsets - setup.heads.quiet)
    setup.enough(np.where(there, 0.0, np.nan))
    out = setup.run(when, y, setup.options("none" if background is None else "fit", None))
    return Localizations(
        states=out["state"],
        costs=out["cost"],
        mirrors=out["mirror"],
        mirror_costs=out["mirror_cost"],
        sigmas=out["sigma"],
        converged=out["converged"] == 1,
    )


def localize_trials(
    r0: ArrayLike,
    v: ArrayLike,
    m: ArrayLike,
    times: ArrayLike,
    sigma: ArrayLike,
    seed: int,
    trials: int,
    *,
    known: Mapping[str, float] | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    sensors: ArrayLike | None = None,
    ambient: ArrayLike | None = None,
    baselines: ArrayLike | None = None,
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
    known, prior, sensors, ambient, baselines, starts
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
    setup = _Setup(known, prior, sensors, None, "gaussian", sigma, starts, ambient, baselines)
    times = _as_times(times)
    there = setup.measured((times.size, len(setup.sensors), setup.heads.components))
    setup.enough(np.where(there, 0.0, np.nan))
    state = np.concatenate([_three(r0, "r0"), _three(v, "v"), _three(m, "m")])
    out = _core.dipole_localize_trials(
        times,
        state.tolist(),
        number(sigma, "sigma [T]") if setup.sigma is None else setup.sigma,
        setup.heads,
        setup.exact,
        setup.priors,
        setup.leveled(setup.options("none", None)),
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

    def options(self, background: str, origin: float | None, correlation: float = 0.0) -> _Options:
        return _Options(
            background,
            self.loss,
            self.sigma,
            [],
            origin,
            self.starts,
            self.max_iterations,
            correlation,
        )

    def model(
        self,
        raw: _core._DipoleLocalized,
        t: Array,
        inner: _Options,
        weights: Array,
        about: Description = _PLAIN,
    ) -> DipoleModel:
        """Return the model of a record at the pass that was found."""
        origin = t[0] if inner.origin is None else inner.origin
        return DipoleModel(
            t - origin,
            self.sensors,
            weights * self.precision,
            raw["state"],
            self.known,
            self.prior,
            self.background is not None,
            inner.correlation,
            float(np.median(np.diff(t))) if len(t) > 1 else 1.0,
            about,
            self.baselines,
            self.ambient,
        )

    def samples(
        self, times: ArrayLike, field: ArrayLike, missing: str, use: ArrayLike | None
    ) -> tuple[Array, Array, int]:
        """Return times (K,), field (K, S, components) and how many numbers are NaN, dropped.

        Numbers that are not used are NaN.
        """
        t, y = _as_times(times).copy(), as_float_array(field, "field").copy()
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

    def run(self, times: ArrayLike, field: Array, options: _Options) -> _core._DipoleLocalized:
        leveled = self.leveled(options)
        return _core.dipole_localize(times, field, self.heads, self.exact, self.priors, leveled)

    def leveled(self, options: _Options) -> _Options:
        """Return options with what is known of the precision of each number."""
        if not isinstance(self.precision, np.ndarray):
            return options
        return replace(options, levels=self.deviations(1.0, self.precision.shape).ravel().tolist())


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


def _as_times(times: ArrayLike) -> Array:
    """Return times (..., K), finite and so large at most that their spans are."""
    when = as_float_array(times, "times")
    if (far := ~(np.abs(when) <= LARGEST)).any():
        at = np.unravel_index(int(np.argmax(far)), far.shape)
        place = ", ".join(map(str, at))
        if not np.isfinite(when[at]):
            raise InputError(f"times[{place}] must be finite")
        raise InputError(f"times[{place}] = {when[at]:g} s: must be at most {LARGEST} s")
    return when


@dataclass(frozen=True)
class _Found:
    """What a fit found: the part of an answer that follows from nothing else."""

    model: DipoleModel
    state: Array
    found: Array
    cost: float
    mirror: Solution | None
    others: tuple[Other, ...]
    sigma: float
    weights: Array
    residuals: Array
    fitted: Array
    converged: bool
    iterations: int


def _answer(
    raw: _core._DipoleLocalized,
    t: Array,
    y: Array,
    offsets: Array,
    inner: _Options,
    dropped: int,
    setup: _Setup,
    limits: tuple[float, float, float],
    correlation_given: bool,
) -> Localization:
    mirror, sigma = raw["mirror"], float(raw["sigma"])
    mirror_cost = float(raw["mirror_cost"])
    model = setup.model(raw, t, inner, np.sqrt(raw["weights"] * raw["efficiency"]) / sigma)
    state = _states(model, raw)
    others: tuple[Other, ...] = ()
    if np.isfinite(mirror_cost):
        constants = int(model.used.sum()) if model.background else 0
        image = model.coordinates(mirror)
        image[len(state) - constants :] = state[len(state) - constants :]
        # Priors tell the two apart too.
        handle = model.handle(np.nan_to_num(y))
        apart = handle.linearize(image)[0] - handle.linearize(state)[0]
        distance = float(np.linalg.norm(apart))
        half = 0.5 * math.erfc(distance / math.sqrt(8.0))
        others = (Other(image, mirror_cost, distance, half, 1),)
    return _localization(
        _Found(
            model=model,
            state=state,
            found=raw["state"],
            cost=float(raw["cost"]),
            mirror=Solution(mirror[:3], mirror[3:6], mirror[6:], mirror_cost)
            if np.isfinite(mirror_cost)
            else None,
            others=others,
            sigma=sigma,
            weights=raw["weights"],
            residuals=raw["residuals"],
            fitted=raw["background"],
            converged=bool(raw["converged"]),
            iterations=int(raw["rounds"]),
        ),
        t,
        y,
        offsets,
        inner,
        dropped,
        setup,
        limits,
        correlation_given=correlation_given,
    )


def _localization(
    fit: _Found,
    t: Array,
    y: Array,
    offsets: Array,
    inner: _Options,
    dropped: int,
    setup: _Setup,
    limits: tuple[float, float, float],
    correlation_given: bool,
    candidates: tuple[tuple[Description, float], ...] = (),
) -> Localization:
    model, state, found, weights = fit.model, fit.state, fit.found, fit.weights
    origin = float(t[0]) if inner.origin is None else inner.origin
    absent = np.isnan(y)
    y = np.where(absent, 0.0, y)
    sigmas = setup.deviations(fit.sigma, y.shape)
    covariance = _covariance(model, model.handle(y), state, t, sigmas, setup)
    signal = y - setup.heads.quiet - fit.fitted
    residuals = fit.residuals
    # What does not count explains nothing.
    share = np.where(weights > 0, fit.sigma / sigmas, 0.0)
    return Localization(
        model=model,
        measurements=y.ravel(),
        names=model.names,
        units=model.units,
        state=state,
        converged=fit.converged,
        iterations=fit.iterations,
        prior=setup.prior,
        known=setup.known,
        others=fit.others,
        unseen=1.0,
        alpha=limits[0],
        chance=limits[1],
        weak_ratio=limits[2],
        _loss=("squares", 0.0) if setup.loss == "gaussian" else ("huber", 1.345),
        r0=found[:3],
        v=found[3:6],
        m=found[6:],
        pass_std=np.sqrt(np.maximum(np.diag(covariance), 0.0)),
        pass_covariance=covariance,
        cost=fit.cost,
        mirror=fit.mirror,
        origin=origin,
        times=t,
        residuals=np.where(absent, np.nan, residuals),
        predicted=signal - residuals,
        background=offsets + fit.fitted,
        weights=weights,
        sigma=fit.sigma,
        sigmas=sigmas,
        sigma_given=setup.sigma is not None,
        explained=float(1 - ((share * residuals) ** 2).sum() / ((share * signal) ** 2).sum()),
        spikes=int((~(weights > 0) & ~absent).any(axis=-1).sum()),
        dropped=dropped,
        closest=_closest(found, covariance, origin, setup.sensors[0])
        if model.description.motion == "straight" and model.description.sources == 1
        else _nearest(model, state, model.handle(y), origin),
        sensors=setup.sensors,
        correlation=inner.correlation,
        correlation_given=correlation_given,
        candidates=candidates,
    )


def _covariance(
    model: DipoleModel,
    handle: _core.Model,
    state: Array,
    t: Array,
    sigma: Array,
    setup: _Setup,
) -> Array:
    """Return the bound (9, 9) at an answer, on what knowledge leaves free."""
    if not len(state):
        return np.zeros((9, 9))
    found, columns = model.expand(state)
    lines = handle.linearize(state)[1]
    analysis = _core.Analysis(lines, None)
    bound = analysis.crlb()
    if bound is None and model.description != _PLAIN:
        directions = describe_null_space(analysis.null_space(), model.names)
        raise UnobservableError(
            f"what is known does not suffice for {model.description}: "
            f"{'; '.join(directions)} is not determined",
            directions,
        )
    if bound is None:
        null = columns @ analysis.null_space()
        # What rounding left in a state that has no part in it.
        size = np.linalg.norm(lines @ np.linalg.pinv(columns), axis=0)
        part = np.abs(null) * size[:, None]
        null[part < 1e-9 * part.max(axis=0)] = 0.0
        directions = describe_null_space(null, NAMES)
        here = Pass(found[:3] + model.times[0] * found[3:6], found[3:6], found[6:])
        raise UnobservableError(_refusal(here, t, sigma, setup, directions), directions)
    spread: Array = columns @ bound @ columns.T
    return spread


def _refusal(here: Pass, t: Array, sigma: Array, setup: _Setup, directions: Sequence[str]) -> str:
    given = ", ".join(f"{name} = {value:g}" for name, value in setup.known.items())
    given += ", ".join(f"prior of {name}" for name in setup.prior)
    scene = problem(
        *here,
        t,
        sigma,
        sensors=setup.sensors,
        ambient=setup.ambient,
        baselines=setup.baselines,
    )
    answer = analyze(scene)
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
        time_std=root(by_time @ covariance @ by_time),
        position=(float(position[0]), float(position[1]), float(position[2])),
        range=distance,
        range_std=root(by_range @ covariance @ by_range),
    )


def _nearest(model: DipoleModel, state: Array, handle: _core.Model, origin: float) -> ClosestPoint:
    """Return the closest approach of a body that does not pass straight, or of its centre."""
    time, by_time, place, by = model.nearest(state)
    covariance = _core.Analysis(handle.linearize(state)[1], None).crlb()
    distance = float(np.linalg.norm(place))
    by_range = place / (distance or 1.0) @ by
    if covariance is None:
        covariance = np.full((state.size, state.size), np.inf)
    x, y, z = place.tolist()
    return ClosestPoint(
        time=origin + time,
        time_std=root(by_time @ covariance @ by_time),
        position=(x, y, z),
        range=distance,
        range_std=root(by_range @ covariance @ by_range),
    )


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


def _three(value: ArrayLike, name: str) -> Array:
    array = as_float_array(value, name)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(f"{name} = {value!r}: must be three finite numbers")
    return array
