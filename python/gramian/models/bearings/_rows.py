"""Bearings-only target motion: what the bearings of a moving target can tell.

A target moves at constant velocity; an observer measures its bearing, clockwise
from north, and knows its own path. The state is (x0, y0, vx, vy) in metres and
metres per second at the first time; x is east, y is north.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import (
    SEED_MOST,
    as_float_array,
    finite,
    require_finite,
    whole,
    wrap_angles,
)
from gramian.exceptions import InputError
from gramian.problem import Problem

__all__ = ["NAMES", "UNITS", "merge", "problem", "rows", "simulate", "state_names"]

Array = NDArray[np.float64]

#: The states: position and velocity at the first time.
NAMES = ("x0", "y0", "vx", "vy")
#: Their units.
UNITS = ("m", "m", "m/s", "m/s")

_AXES = {2: "xy", 3: "xyz"}
_ORDERS = (("", "0", "m"), ("v", "", "m/s"), ("a", "", "m/s^2"), ("j", "", "m/s^3"))


def state_names(order: int = 1, dimensions: int = 2) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the states of a target that moves as a polynomial in time, and their units.

    Parameters
    ----------
    order : {0, 1, 2, 3}
        0 at rest, 1 at constant velocity, 2 accelerated, 3 with constant jerk.
    dimensions : {2, 3}

    Returns
    -------
    tuple of tuple of str
        Names and units, both of length dimensions * (order + 1).

    Examples
    --------
    >>> state_names(2)[0]
    ('x0', 'y0', 'vx', 'vy', 'ax', 'ay')
    >>> state_names(1, 3)[0]
    ('x0', 'y0', 'z0', 'vx', 'vy', 'vz')
    """
    options.choice(order, "order", (0, 1, 2, 3))
    return _states(order, options.choice(dimensions, "dimensions", (2, 3)))


@cache
def _states(order: int, dimensions: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    axes = _AXES[dimensions]
    kinds = _ORDERS[: order + 1]
    names = tuple(f"{head}{axis}{tail}" for head, tail, _ in kinds for axis in axes)
    return names, tuple(unit for _, _, unit in kinds for _ in axes)


def rows(
    times: ArrayLike,
    observer: ArrayLike,
    target: ArrayLike,
    sigma: ArrayLike,
    *,
    order: int | None = None,
    observer_index: ArrayLike | None = None,
    sigma_elevation: ArrayLike | None = None,
    detection: ArrayLike | None = None,
    out: Array | None = None,
) -> Array:
    """Return whitened rows of bearings of a moving target.

    Parameters
    ----------
    times : array_like, shape (..., m)
        Increasing, seconds.
    observer : array_like, shape (..., m, 2) or (..., m, 3)
        Observer positions (east, north), metres; with a height as well azimuth
        and elevation are measured, in space.
    target : array_like, shape (..., n) or (..., m, 2 or 3)
        The state at the first time, by default (x0, y0, vx, vy), in space
        (x0, y0, z0, vx, vy, vz); or positions at all times, where the geometry
        is taken. For two or more times of which an array could be either, its
        last axis decides: as many numbers as coordinates are positions.
    sigma : array_like, shape () or (..., m)
        Standard deviation of the bearings (azimuths), radians, > 0.
    order : {0, 1, 2, 3}, optional
        The target's motion is a polynomial in time of this order: at rest, at
        constant velocity, accelerated, with constant jerk. By default as the
        length of the state says, 1 for positions. With 0 the target is one
        position, never one for each time.
    observer_index : array_like of int, shape (m,), optional
        For several observers, which one took each bearing. Times of different
        observers may then coincide; see `merge`.
    sigma_elevation : array_like, shape () or (..., m), optional
        The same for elevations; by default `sigma`.
    detection : array_like, shape () or (..., m), optional
        Probability, 0 to 1, that each bearing is obtained at all. Its
        information counts by that part: what is expected of a run in which
        bearings are missed at random.
    out : ndarray, shape of the result, optional
        Where the result is written: float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made. Not with `detection`.

    Returns
    -------
    ndarray, shape (..., m, n) or (..., 2 m, n)
        (d bearing / d state) / sigma, with n = 2 (order + 1); in space azimuth
        and elevation of each time in turn, with n = 3 (order + 1).

    Raises
    ------
    InputError
        Shapes that do not fit, numbers that are not finite, times that do not
        increase, a sigma that is not positive, an observer on the target (in
        space also straight below or above it).

    Notes
    -----
    The row at range r and bearing b is [cos b, -sin b, T cos b, -T sin b] / (r sigma)
    with T the time from the first one: Li & Sheng 2009, eq. (3), weighted as
    Xu et al. 2009, eq. (9). Order N has n = 2 (N + 1) states and is determined
    by n bearings at least: with fewer the rank is short, which `analyze` says.

    Positions far from the origin (map coordinates of millions of metres) carry
    their rounding into the rows, which an array cannot tell: for ranks and bounds
    of such give `analyze` and `crlb_std` the `problem`, which knows it.

    Examples
    --------
    >>> rows([0.0, 10.0], [[0, 0], [0, 50]], [0.0, 1000.0, 3.0, -1.0], 0.01)[0]
    array([ 0.1, -0. ,  0. , -0. ])
    >>> rows([0.0, 10.0], [[0, 0, 0], [0, 50, 0]], [0, 1000, 0, 3, -1, 0], 0.01).shape
    (4, 6)
    """
    place = as_float_array(target, "target")
    path = as_float_array(observer, "observer")
    dimensions = path.shape[-1] if path.ndim >= 2 and path.shape[-1] == 3 else 2
    order, is_state = _target_kind(place, dimensions, order)
    if dimensions == 2 and sigma_elevation is not None:
        raise InputError("sigma_elevation was given for an observer in the plane: (..., m, 3)")
    if detection is not None and out is not None:
        raise InputError("out goes without detection, whose roots the rows are multiplied by after")
    check_index(times, observer_index)
    if dimensions == 2 and order == 1 and observer_index is None:
        result = _core.bearing_rows(times, path, place, sigma, is_state, out)
    else:
        noise = np.atleast_1d(as_float_array(sigma, "sigma [rad]"))
        if dimensions == 3:
            up = noise
            if sigma_elevation is not None:
                up = np.atleast_1d(finite(sigma_elevation, "sigma_elevation"))
            m = path.shape[-2]
            if noise.shape[-1] != up.shape[-1]:
                noise, up = (
                    np.broadcast_to(s, (*s.shape[:-1], m)) if s.shape[-1] == 1 else s
                    for s in (noise, up)
                )
            lead = np.broadcast_shapes(noise.shape[:-1], up.shape[:-1])
            parts = [np.broadcast_to(s, (*lead, s.shape[-1])) for s in (noise, up)]
            noise = np.concatenate(parts, axis=-1)
        result = _core.bearing_motion_rows(
            times, path, place, noise, dimensions, order, is_state, observer_index is not None, out
        )
    result = require_finite(result, "a row")
    if detection is None:
        return result
    return _detected(result, detection, path.shape[-2])


def _target_kind(place: Array, dimensions: int, order: int | None) -> tuple[int, bool]:
    """Return the order of the motion, and whether the target is a state."""
    size = place.shape[-1] if place.ndim else 0
    if order is None:
        if size == dimensions:
            return 1, False
        order = size // dimensions - 1 if size % dimensions == 0 else -1
        if order not in (1, 2, 3):
            usual = ", ".join(state_names(1, dimensions)[0])
            raise InputError(
                f"target has shape {place.shape}: must be (..., {2 * dimensions}), a state {usual}"
                f" (or of a higher order), or (..., m, {dimensions}), positions"
            )
        return order, True
    names = state_names(order, dimensions)[0]
    if size == len(names):
        return order, True
    if size == dimensions:
        return order, False
    raise InputError(
        f"target has shape {place.shape}: for order = {order} it must be (..., {len(names)}), "
        f"a state {', '.join(names)}" + (f", or (..., m, {dimensions}), positions" if order else "")
    )


def _detected(result: Array, detection: ArrayLike, m: int) -> Array:
    part = as_float_array(detection, "detection")
    if part.ndim and part.shape[-1] != m:
        raise InputError(f"detection has shape {part.shape}: must be () or (..., {m})")
    if len(bad := np.argwhere(~((part >= 0) & (part <= 1)))):
        place = f"[{', '.join(map(str, bad[0]))}]" if part.ndim else ""
        raise InputError(f"detection{place} = {part[tuple(bad[0])]}: must be from 0 to 1")
    root = np.sqrt(part)
    if part.ndim:
        root = np.repeat(root, result.shape[-2] // m, axis=-1)[..., None]
    scaled: Array = result * root
    return scaled


def check_index(times: ArrayLike, observer_index: ArrayLike | None) -> NDArray[np.int64] | None:
    """Return the index as an array; refuse times that decrease, or stand still for one observer."""
    if observer_index is None:
        return None
    t = as_float_array(times, "times")
    try:
        index = np.asarray(observer_index)
    except ValueError:  # lists of several lengths
        index = np.zeros(0)
    if index.dtype.kind not in "iu" or t.ndim == 0 or index.shape != t.shape[-1:]:
        raise InputError(
            f"observer_index has shape {index.shape} and type {index.dtype}: "
            f"must be integers, one for each of {t.shape[-1:]} times"
        )
    if (bad := np.argwhere(np.diff(t, axis=-1) < 0)).size:
        i = int(bad[0][-1]) + 1
        raise InputError(f"times[{i}] is earlier than the one before: times must not decrease")
    for k in np.unique(index):
        own = np.flatnonzero(index == k)
        if (bad := np.argwhere(np.diff(t[..., own], axis=-1) <= 0)).size:
            i = int(own[int(bad[0][-1]) + 1])
            same = f" of the same observer, {k}" if own.size < index.size else ""
            late = t[(*bad[0][:-1], i)]
            raise InputError(f"times[{i}] = {late:g} s: must be later than the one before{same}")
    return index


def merge(*tracks: Sequence[ArrayLike]) -> tuple[Array, ...]:
    """Join what several observers measured into one track, in the order of time.

    Parameters
    ----------
    *tracks : sequence of array_like
        For each observer its times (m_k,) and positions (m_k, 2 or 3), and what
        else there is one of for each time: bearings, standard deviations.

    Returns
    -------
    tuple of ndarray
        The same arrays joined, and last the `observer_index` that the functions
        of this module take.

    Raises
    ------
    InputError
        Tracks of different kinds or lengths.

    Examples
    --------
    >>> t, path, index = merge(([0, 20], [[0, 0], [0, 9]]), ([10], [[500, 0]]))
    >>> t, index
    (array([ 0., 10., 20.]), array([0, 1, 0]))
    """
    if not tracks:
        raise InputError("merge was given no track")
    for k, track in enumerate(tracks):
        if not isinstance(track, (list, tuple)):
            raise InputError(
                f"track {k} = {options.given(track)}: must be a tuple of times, positions, ..."
            )
    arrays = [[finite(part, f"track {k}") for part in track] for k, track in enumerate(tracks)]
    for k, track in enumerate(arrays):
        if len(track) != len(arrays[0]) or not track:
            raise InputError(
                f"track {k} has {len(track)} arrays: must have {len(arrays[0])}, as the first"
            )
        for part, first in zip(track, arrays[0], strict=True):
            if part.shape[1:] != first.shape[1:] or part.shape[:1] != track[0].shape:
                raise InputError(
                    f"track {k} has an array of shape {part.shape}: "
                    f"must be ({track[0].size}, ...), as the first track's {first.shape}"
                )
    index = np.repeat(np.arange(len(arrays)), [track[0].size for track in arrays])
    joined = [np.concatenate(parts) for parts in zip(*arrays, strict=True)]
    order = np.argsort(joined[0], kind="stable")
    return (*(part[order] for part in joined), index[order])


def problem(
    times: ArrayLike,
    observer: ArrayLike,
    target: ArrayLike,
    sigma: ArrayLike,
    *,
    order: int | None = None,
    observer_index: ArrayLike | None = None,
    sigma_elevation: ArrayLike | None = None,
    detection: ArrayLike | None = None,
) -> Problem:
    """Return the problem of one track: rows with named states.

    Parameters
    ----------
    times, observer, target, sigma, order, observer_index, sigma_elevation, detection
        As for `rows`, without leading axes.

    Returns
    -------
    Problem
        States as `state_names` has them, x0, y0, vx, vy by default; combinations
        "range", "bearing" (in space also "elevation") of the target from the
        first observer, and for a moving one "speed" and "course", at the first
        time, linearised there. Scales: the range at the first time for positions, that
        range over the time for velocities, and so on; a bound above them is "weak".

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(0.0, 300.0, 20.0)
    >>> straight = np.stack([0 * t, 5 * t], axis=1)
    >>> answer = gm.analyze(problem(t, straight, [0, 1e4, 3, -1], np.radians(0.5)))
    >>> answer.status, answer.rank
    ('unobservable', 3)
    """
    values = rows(
        times,
        observer,
        target,
        sigma,
        order=order,
        observer_index=observer_index,
        sigma_elevation=sigma_elevation,
        detection=detection,
    )
    if values.ndim != 2:
        raise InputError(f"the rows have shape {values.shape}: a problem is one track, (m, n)")
    dimensions = 3 if len(values) == 2 * len(times) else 2  # type: ignore[arg-type]
    place = as_float_array(target, "target")
    order, is_state = _target_kind(place, dimensions, order)
    values, rtol, combinations, scale = _core.bearing_frame(
        times, observer, place, values, is_state
    )
    names, units = _states(order, dimensions)
    return Problem._of_parts(values, names, units, rtol, combinations, scale)


def simulate(
    times: ArrayLike,
    observer: ArrayLike,
    target: ArrayLike,
    sigma: ArrayLike,
    seed: int,
    *,
    trials: int | None = None,
    order: int | None = None,
    observer_index: ArrayLike | None = None,
) -> Array:
    """Return noisy bearings, the same for the same seed on any machine.

    Parameters
    ----------
    times, observer, target, sigma, order, observer_index
        As for `rows`, without leading axes and in the plane.
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
    seed = whole(seed, "seed", 0, SEED_MOST)
    if trials is not None:
        trials = whole(trials, "trials", 1)
    # Checks everything, the observer on the target included.
    checked = rows(times, observer, target, sigma, order=order, observer_index=observer_index)
    t, place = as_float_array(times, "times"), as_float_array(target, "target")
    path = as_float_array(observer, "observer")
    if checked.ndim != 2 or path.shape[-1] != 2:
        raise InputError("simulate takes one track, without leading axes, in the plane")
    offsets = (_positions(t, place, 2) if _target_kind(place, 2, order)[1] else place) - path
    exact = np.arctan2(offsets[:, 0], offsets[:, 1])
    noise = _core.normals(seed, 0, trials or 1, t.size)
    spread = as_float_array(sigma, "sigma [rad]")
    if not (spread < 1e15).all():
        raise InputError(f"sigma = {spread.max():g} rad: must be below 1e15, or no angle is left")
    noisy = exact + spread * noise
    wrapped = wrap_angles(noisy)
    return wrapped if trials is not None else wrapped[0]


def _positions(times: Array, state: Array, dimensions: int) -> Array:
    since = (times - times[0])[:, None]
    positions = np.zeros((times.size, dimensions))
    power = np.ones_like(since)
    for k, derivative in enumerate(state.reshape(-1, dimensions)):
        positions += power * derivative
        power = power * since / (k + 1)
    return positions
