"""Locating simulated records of a pass, one after the other or all at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import SEED_MOST, as_float_array, number, whole
from gramian.exceptions import InputError, UnobservableError
from gramian.models.dipole._body import Passing, as_body
from gramian.models.dipole._setup import Setup, as_times, require_components

__all__ = ["localize_trials"]

Array = NDArray[np.float64]


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
    others: bool = True,
    quadrupole: ArrayLike | None = None,
    dipoles: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    turn_rate: float | None = None,
    induced_volume: float | None = None,
    earth_field: ArrayLike | None = None,
    attitude: float | None = None,
    scale: float | None = None,
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
    others : bool
        Whether to look for passes that fit better than where the starts lead, as `localize`
        does, where sensors are of the total field or gradiometers. For a body that is more
        than one dipole on a straight pass `localize` looks for them in any case.
    quadrupole, dipoles, acceleration, turn_rate, induced_volume, earth_field, attitude, scale
        What there is beside one dipole on a straight pass, as for
        `gramian.monte_carlo.Dipole`: every trial is then located by `localize` with this
        description.

    Returns
    -------
    ndarray, shape (trials, 9)
        The estimates (r0, v, m). Of an answer and its mirror image, or another pass, that fit
        the same, the one nearer to the truth; of several dipoles (r0, m) of the first, in the
        order nearest to the truth where `known` and `prior` do not say which is the first. NaN
        for a trial that `localize` refuses.

    Raises
    ------
    InputError
        As for `localize` and `simulate`.

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
    setup = Setup(known, prior, sensors, None, "gaussian", sigma, starts, ambient, baselines)
    times = as_times(times)
    there = setup.measured((times.size, len(setup.sensors), setup.heads.components))
    setup.enough(np.where(there, 0.0, np.nan))
    state = np.concatenate([_three(r0, "r0"), _three(v, "v"), _three(m, "m")])
    options.flag(others, "others")
    body = as_body(
        quadrupole=quadrupole,
        dipoles=dipoles,
        acceleration=acceleration,
        turn_rate=turn_rate,
        induced_volume=induced_volume,
        earth_field=earth_field,
        attitude=attitude,
        scale=scale,
    )
    require_components(ambient, attitude, scale)
    if body is not None:
        each = as_float_array(sigma, "sigma [T]")
        passing = Passing(
            body,
            state,
            times,
            each if each.ndim else float(each),
            tuple(setup.known),
            None if setup.one_sensor else setup.sensors,
            setup.ambient,
            setup.baselines,
            setup.prior,
        )
        return _each(passing, setup, seed, first, trials)
    few = ambient is not None or baselines is not None
    out = _core.dipole_localize_trials(
        times,
        state.tolist(),
        number(sigma, "sigma [T]") if setup.sigma is None else setup.sigma,
        setup.heads,
        setup.exact,
        setup.priors,
        setup.leveled(replace(setup.options("none", None), others=others and few)),
        seed,
        first,
        trials,
    )
    estimates: Array = out[:, :9]
    return estimates


def _each(passing: Passing, setup: Setup, seed: int, first: int, trials: int) -> Array:
    """Return the passes (trials, 9) that `localize` finds of a body, trial by trial."""
    estimates = np.full((trials, 9), np.nan)
    fields, states = passing.simulate(seed, first, trials)
    for k, (field, x) in enumerate(zip(fields, states, strict=True)):
        try:
            found = passing.located(field, setup.known, setup.prior, setup.starts)
        except (InputError, UnobservableError):
            continue
        estimates[k] = passing.pass_of(found, x)
    return estimates


def _three(value: ArrayLike, name: str) -> Array:
    array = as_float_array(value, name)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(f"{name} = {value!r}: must be three finite numbers")
    return array
