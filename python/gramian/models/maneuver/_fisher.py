"""The information that bearings along a path hold on a target."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import as_float_array, require_finite
from gramian.exceptions import InputError
from gramian.models import bearings
from gramian.problem import Problem

__all__ = ["fisher", "fisher_and_det", "fisher_det", "problem"]

Array = NDArray[np.float64]


def fisher(
    path: ArrayLike,
    target: ArrayLike,
    sigma: ArrayLike,
    times: ArrayLike | None = None,
    *,
    out: NDArray[Any] | None = None,
) -> NDArray[Any]:
    """Return the Fisher information of bearings of a target along a path.

    Parameters
    ----------
    path : array_like, shape (..., m, 2)
        East and north of the observer at each bearing, metres.
    target : array_like, shape (..., 2) or (..., 4)
        A fixed target, or the state (x0, y0, vx, vy) at the first time of one at
        constant velocity; then `times` is needed.
    sigma : array_like, shape () or (..., m)
        Standard deviation of the bearings, radians, > 0.
    times : array_like, shape (..., m), optional
        Increasing, seconds.
    out : ndarray, shape of the result, optional
        Where the result is written: of its type, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

    Returns
    -------
    ndarray, shape (..., 2, 2) or (..., 4, 4)
        On (x, y) or (x0, y0, vx, vy).

    Raises
    ------
    InputError
        Shapes that do not fit, numbers that are not finite, a sigma that is not
        positive, times that do not increase or are missing, a position on the target.

    Notes
    -----
    Xu et al. 2009, eqs. (9) and (10); with the times, the rows of
    `gramian.bearings.rows`. The sum keeps half the digits of the rows: take bounds
    from `gramian.analyze` of `problem` and determinants from `fisher_det`.

    Where all arrays are float32 (numbers and lists go along), it is computed in float32, in
    twice as many lanes, and is float32: an entry is off by up to about ``1e-7 (3 + m / 16)`` of
    the roots of its diagonal entries. Coordinates of float32 are good to 1e-7 of their size, so
    let them count from near the path. `fisher_and_det` and `fisher_det` are float64: what is
    left of a determinant that cancels would be lost.

    Examples
    --------
    >>> fisher([[0, 0], [1000, 0]], [0.0, 1000.0], 0.01).round(6)
    array([[0.0125, 0.0025],
           [0.0025, 0.0025]])
    """
    single = _core.is_single(path, target, sigma, times)
    return _core.maneuver_fisher(*_arguments(path, target, sigma, times), single, out)


def fisher_det(
    path: ArrayLike,
    target: ArrayLike,
    sigma: ArrayLike,
    times: ArrayLike | None = None,
    *,
    method: Literal["root", "pairs"] = "root",
    out: Array | None = None,
) -> Array:
    """Return the determinant of `fisher`, without the loss of forming it.

    Parameters
    ----------
    path, target, sigma, times
        As for `fisher`.
    method : {"root", "pairs"}
        From the triangular factor of the rows, O(m); or the sum over pairs of
        sin^2(b_i - b_j) / (sigma_i sigma_j r_i r_j)^2, O(m^2), for a fixed target.
    out : ndarray, shape of the result, optional
        Where the result is written: float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

    Returns
    -------
    ndarray, shape (...)

    Raises
    ------
    InputError
        As for `fisher`; "pairs" for a moving target.

    Notes
    -----
    "pairs" is eq. (14) of Xu et al. 2009.

    Examples
    --------
    >>> float(fisher_det([[0, 0], [1000, 0]], [0.0, 1000.0], 0.01).round(9))
    2.5e-05
    """
    options.choice(method, "method", ("root", "pairs"))
    arguments = _arguments(path, target, sigma, times)
    if method == "pairs" and arguments[1].shape[-1] == 4:
        raise InputError('method = "pairs" is for a fixed target: a moving one has four states')
    found = _core.maneuver_fisher_det(*arguments, method == "pairs", out)
    found = require_finite(found, "the determinant")
    return found if out is not None else found[()]


def fisher_and_det(
    path: ArrayLike,
    target: ArrayLike,
    sigma: ArrayLike,
    times: ArrayLike | None = None,
    *,
    out: Array | None = None,
) -> tuple[Array, Array]:
    """Return the Fisher information and the determinant of that matrix, in one pass.

    The fast way for many trials whose information is well conditioned.

    Parameters
    ----------
    path, target, sigma, times
        As for `fisher`.
    out : ndarray, shape (..., 5) or (..., 17), optional
        Where the results are written, float64, C-contiguous, writable: they are views of
        it. It may share memory with an argument. Without it a new array is made.

    Returns
    -------
    matrix : ndarray, shape (..., 2, 2) or (..., 4, 4)
    det : ndarray, shape (...)

    Raises
    ------
    InputError
        As for `fisher`; a determinant that overflows.

    Notes
    -----
    The determinant is taken from the sums: its error is that of the matrix, about
    1e-16 times the condition of the information. For a target that is nearly
    unobservable it is rounding noise of either sign; `fisher_det` is exact there.

    Examples
    --------
    >>> matrix, det = fisher_and_det([[0, 0], [1000, 0]], [0.0, 1000.0], 0.01)
    >>> matrix.shape, round(float(det), 9)
    ((2, 2), 2.5e-05)
    """
    both = _core.maneuver_fisher_and_det(*_arguments(path, target, sigma, times), out)
    return both["fisher"], both["det"]


def problem(
    path: ArrayLike, target: ArrayLike, sigma: ArrayLike, times: ArrayLike | None = None
) -> Problem:
    """Return the problem of locating a target along a path: rows with named states.

    Parameters
    ----------
    path, target, sigma, times
        As for `fisher`, without leading axes.

    Returns
    -------
    Problem
        That of `gramian.bearings.problem`, and to rounding that of `gramian.tracks.problem` of
        the `scene`. States x and y, or x0, y0, vx and vy; combinations "range" and "bearing"
        of a fixed target from the last position, of a moving one from the first. A bound
        above the range from the first position is "weak".

    Examples
    --------
    >>> import gramian as gm
    >>> gm.analyze(problem([[0, 0], [0, 100]], [0.0, 1000.0], 0.01)).status
    'unobservable'
    """
    places, at, noise, when = _arguments(path, target, sigma, times)
    places = as_float_array(places, "path")
    if places.ndim != 2 or at.ndim != 1:
        raise InputError(
            f"path has shape {places.shape}, target {at.shape}: must be (m, 2) and (2,) or (4,)"
        )
    if when is None:
        when = np.arange(float(len(places)))
    made = bearings.problem(when, places, at, noise, order=at.size // 2 - 1)
    if at.size == 4:
        return made
    # To where the observer is now.
    offset = at - places[-1]
    length = float(np.hypot(*offset))
    east, north = offset / length
    seen = {"range": [east, north], "bearing": [north / length, -east / length]}
    return Problem(
        made.rows, ("x", "y"), units=made.units, scale=made.scale, rtol=made.rtol, combinations=seen
    )


def _arguments(
    path: ArrayLike, target: ArrayLike, sigma: ArrayLike, times: ArrayLike | None
) -> tuple[ArrayLike, Array, Array, ArrayLike | None]:
    place, noise = as_float_array(target, "target"), as_float_array(sigma, "sigma [rad]")
    if place.ndim == 0 or place.shape[-1] not in (2, 4):
        raise InputError(
            f"target has shape {place.shape}: must be (..., 2), or (..., 4): x0, y0, vx, vy"
        )
    if (place.shape[-1] == 4) != (times is not None):
        raise InputError(
            f"target has {place.shape[-1]} numbers and times are "
            f"{'given' if times is not None else 'missing'}: a moving target needs times, "
            "a fixed one has none"
        )
    return path, place, noise[None] if noise.ndim == 0 else noise, times
