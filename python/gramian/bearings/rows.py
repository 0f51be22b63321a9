"""Bearings-only target motion: what the bearings of a moving target can tell.

A target moves at constant velocity; an observer measures its bearing, clockwise
from north, and knows its own path. The state is (x0, y0, vx, vy) in metres and
metres per second at the first time; x is east, y is north.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian.exceptions import InputError
from gramian.problem import Problem

__all__ = ["NAMES", "UNITS", "problem", "rows", "simulate"]

Array = NDArray[np.float64]

NAMES = ("x0", "y0", "vx", "vy")
UNITS = ("m", "m", "m/s", "m/s")


def rows(times: ArrayLike, observer: ArrayLike, target: ArrayLike, sigma: ArrayLike) -> Array:
    """Return whitened rows of bearings of a target at constant velocity.

    Parameters
    ----------
    times : array_like, shape (..., m)
        Increasing, seconds.
    observer : array_like, shape (..., m, 2)
        Observer positions (east, north), metres.
    target : array_like, shape (..., 4) or (..., m, 2)
        The state (x0, y0, vx, vy) at the first time, or positions at all times;
        the geometry is taken there. For two or more times of which an array
        could be either, its last axis decides: 4 is a state, 2 are positions.
    sigma : array_like, shape () or (..., m)
        Standard deviation of the bearings, radians, > 0.

    Returns
    -------
    ndarray, shape (..., m, 4)
        (d bearing / d x0, y0, vx, vy) / sigma.

    Raises
    ------
    InputError
        Shapes that do not fit, numbers that are not finite, times that do not
        increase, a sigma that is not positive, an observer on the target.

    Notes
    -----
    The row at range r and bearing b is [cos b, -sin b, T cos b, -T sin b] / (r sigma)
    with T the time from the first one: Li & Sheng 2009, eq. (3), weighted as
    Xu et al. 2009, eq. (9).

    Examples
    --------
    >>> rows([0.0, 10.0], [[0, 0], [0, 50]], [0.0, 1000.0, 3.0, -1.0], 0.01)[0]
    array([ 0.1, -0. ,  0. , -0. ])
    """
    place = np.asarray(target, dtype=float)
    if place.ndim == 0 or place.shape[-1] not in (2, 4):
        raise InputError(
            f"target has shape {place.shape}: must be (..., 4), a state x0, y0, vx, vy, "
            "or (..., m, 2), positions"
        )
    noise = np.asarray(sigma, dtype=float)
    return _core.bearing_rows(
        times, observer, place, noise[None] if noise.ndim == 0 else noise, place.shape[-1] == 4
    )


def problem(times: ArrayLike, observer: ArrayLike, target: ArrayLike, sigma: ArrayLike) -> Problem:
    """Return the problem of one track: rows with named states.

    Parameters
    ----------
    times, observer, target, sigma
        As for `rows`, without leading axes.

    Returns
    -------
    Problem
        States x0, y0, vx, vy; combinations "range", "bearing", "speed" and
        "course" (of the target at the first time), linearised there.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(0.0, 300.0, 20.0)
    >>> straight = np.stack([0 * t, 5 * t], axis=1)
    >>> answer = gm.analyze(problem(t, straight, [0, 1e4, 3, -1], np.radians(0.5)))
    >>> answer.status, answer.rank
    ('unobservable', 3)
    """
    values = rows(times, observer, target, sigma)
    if values.ndim != 2:
        raise InputError(f"the rows have shape {values.shape}: a problem is one track, (m, 4)")
    t, path = np.asarray(times, dtype=float), np.asarray(observer, dtype=float)
    place = np.asarray(target, dtype=float)
    positions = place if place.shape[-1] == 2 else _positions(t, place)
    offsets = positions - path
    ranges = np.hypot(offsets[:, 0], offsets[:, 1])
    # Offsets between large coordinates carry the rounding of those coordinates.
    size = max(np.abs(positions).max(), np.abs(path).max())
    rounding = 8 * np.finfo(float).eps * size / ranges.min()
    default = 32 * np.finfo(float).eps * np.sqrt(max(t.size, 4))
    if place.shape[-1] == 4:
        velocity = place[2:]
    else:
        velocity = np.polyfit(t - t[0], place, 1)[0] if t.size > 1 else np.zeros(2)
    east, north = offsets[0] / ranges[0]
    combinations = {
        "range": np.array([east, north, 0, 0]),
        "bearing": np.array([north, -east, 0, 0]) / ranges[0],
    }
    speed = np.hypot(*velocity)
    if speed > 0:
        along = velocity / speed
        combinations["speed"] = np.array([0, 0, along[0], along[1]])
        combinations["course"] = np.array([0, 0, along[1], -along[0]]) / speed
    return Problem(
        values,
        NAMES,
        units=UNITS,
        rtol=float(rounding) if rounding > default else None,
        combinations=combinations,
    )


def simulate(
    times: ArrayLike,
    observer: ArrayLike,
    target: ArrayLike,
    sigma: ArrayLike,
    seed: int,
    *,
    trials: int | None = None,
) -> Array:
    """Return noisy bearings, the same for the same seed on any machine.

    Parameters
    ----------
    times, observer, target, sigma
        As for `rows`, without leading axes.
    seed : int
        >= 0. Trial i depends on (seed, i) alone.
    trials : int, optional
        Number of trials; without it one trial without a leading axis.

    Returns
    -------
    ndarray, shape (m,) or (trials, m)
        Bearings in (-pi, pi], radians.

    Examples
    --------
    >>> t, path = [0.0, 10.0], [[0, 0], [0, 50]]
    >>> one = simulate(t, path, [0, 1e3, 3, -1], 0.01, seed=1)
    >>> many = simulate(t, path, [0, 1e3, 3, -1], 0.01, seed=1, trials=3)
    >>> many.shape, bool((many[0] == one).all())
    ((3, 2), True)
    """
    if seed < 0:
        raise InputError(f"seed = {seed}: must be >= 0")
    if trials is not None and trials < 1:
        raise InputError(f"trials = {trials}: must be >= 1")
    # Checks everything, the observer on the target included.
    if rows(times, observer, target, sigma).ndim != 2:
        raise InputError("simulate takes one track, without leading axes")
    t, place = np.asarray(times, dtype=float), np.asarray(target, dtype=float)
    positions = place if place.shape[-1] == 2 else _positions(t, place)
    offsets = positions - np.asarray(observer, dtype=float)
    exact = np.arctan2(offsets[:, 0], offsets[:, 1])
    noise = _core.normals(seed, 0, trials or 1, t.size)
    noisy = exact + np.asarray(sigma, dtype=float) * noise
    wrapped: Array = noisy - 2 * np.pi * np.ceil(noisy / (2 * np.pi) - 0.5)
    return wrapped if trials is not None else wrapped[0]


def _positions(times: Array, state: Array) -> Array:
    positions: Array = state[:2] + (times - times[0])[:, None] * state[2:]
    return positions
