"""Degrees of observability of the biases, along a track and between instants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gramian import _core
from gramian import _options as options
from gramian._arrays import whole
from gramian.exceptions import InputError
from gramian.models.registration._reports import Reports, stage, targets
from gramian.models.registration._setup import Array, Extra, SensorsLike, Setup

Method = Literal["eta", "pair", "paper"]


def degree(
    positions: ArrayLike | Reports,
    sensors: SensorsLike,
    sigma: ArrayLike,
    *,
    method: Method = "eta",
    lag: int = 1,
    instants: Sequence[tuple[int, int]] | None = None,
    window: int | None = None,
    smoothing: int | None = None,
    biases: ArrayLike | Mapping[str, float] | None = None,
    times: ArrayLike | None = None,
    out: Array | None = None,
) -> Array:
    """Return how well the biases can be determined, along a track or between instants.

    Parameters
    ----------
    positions : array_like, shape (..., K, d), or Reports
        The looks' targets, in the order of time.
    sensors, sigma
        As for `rows`.
    method : {"eta", "pair", "paper"}
        "eta": N / (N - 1) det(mean projector)^(1/n) in [0, 1], for any number of
        sensors; it has no unit and does not grow with the number of looks alone.
        "pair": sin phi_1 sin phi_2 in [0, 1], how far the plane that a look of
        two sensors spans has turned at another. "paper": abs(det M) in m^2, the
        degree of Zhu, Tang & He 2013 (show it as 10 log10); it grows with the
        square of the path between the two instants.
    lag : int
        "pair" and "paper" compare look k with look k + lag.
    instants : sequence of (int, int), optional
        Compare these looks instead.
    window : int, optional
        "eta" of the last so many looks; by default of all so far.
    smoothing : int, optional
        Number of looks, odd, over which positions are smoothed by a parabola first.
    biases : array_like, shape (n,), or mapping of str to float, optional
        Taken off reports before they become positions.
    times : array_like, shape (K,), optional
        Of the looks, seconds, for platforms that move.
    out : ndarray, shape of the result, optional
        Where the result is written: float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

    Returns
    -------
    ndarray
        "eta": shape (..., K), 0 where there are too few looks. Others: shape
        (..., K - lag), or (..., number of instants).

    Raises
    ------
    InputError
        "pair" or "paper" for other than two sensors in the plane; looks that do
        not exist; otherwise as `rows`.

    Notes
    -----
    Take degrees of smoothed and bias-corrected positions. det M is a difference
    of products of ranges that nearly cancel: between neighbouring reports of a
    target at 400 m/s it changes by (400 m)^2, by noise of 50 m at each of two
    places by about as much, and by an azimuth bias of 0.5 degrees so much that a
    target *on* the baseline, where the degree is 0, seems to have one. That the
    paper finds it above 0 there is this artefact.

    Examples
    --------
    >>> pair = [[20e3, 30e3], [45e3, 25e3]]
    >>> sensors, sigma = [[0, 0], [60e3, 0]], (50.0, np.radians(0.1))
    >>> degree(pair, sensors, sigma, method="paper").round()
    array([3.35105062e+08])
    >>> degree(pair, sensors, sigma).round(4)
    array([0.    , 0.2075])
    """
    options.choice(method, "method", ("eta", "pair", "paper"))
    known = stage(positions, sensors, sigma, times=times)
    lag = whole(lag, "lag", 1)
    if window is not None:
        window = whole(window, "window", 2)
    places = _smoothed(targets(known, positions, biases), smoothing)
    if method == "eta":
        if instants is not None:
            raise InputError('instants go with method "pair" or "paper": eta is of all looks')
        none = np.zeros(known.n)
        return _core.registration_running_eta(places, known.places, known.sigma, none, window, out)
    _two_in_the_plane(known, f"method {method!r}")
    looks = places.shape[-2] if places.ndim >= 2 else 0
    if instants is None:
        if lag >= looks:
            raise InputError(f"lag = {lag}: must be from 1 to {looks - 1}, for {looks} looks")
        chosen = [(k, k + lag) for k in range(looks - lag)]
    else:
        chosen = _pairs(instants)
        for place, (i, j) in enumerate(chosen):
            if not (0 <= i < looks and 0 <= j < looks):
                raise InputError(f"instants[{place}] = ({i}, {j}): must be from 0 to {looks - 1}")
    return _core.registration_pair_degrees(
        places, known.places, known.sigma, chosen, method == "pair", out
    )


def _pairs(instants: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    try:
        pairs = [tuple(pair) for pair in instants]
    except TypeError as error:
        raise InputError(
            f"instants = {options.given(instants)}: must be a sequence of pairs"
        ) from error
    chosen = []
    for place, pair in enumerate(pairs):
        if len(pair) != 2:
            raise InputError(f"instants[{place}] = {options.given(pair)}: must be two looks")
        chosen.append((whole(pair[0], f"instants[{place}]"), whole(pair[1], f"instants[{place}]")))
    return chosen


def eta(
    positions: ArrayLike | Reports,
    sensors: SensorsLike,
    sigma: ArrayLike,
    *,
    times: ArrayLike | None = None,
    out: Array | None = None,
) -> Array:
    """Return the degree eta of whole sets of looks, one number for each.

    Parameters
    ----------
    positions, sensors, sigma, times
        As for `rows`; leading axes are sets.
    out : ndarray, shape of the result, optional
        Where the result is written: float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

    Returns
    -------
    ndarray, shape (...)
        In [0, 1]: 0 where some combination of biases is not observable.

    Examples
    --------
    >>> float(eta([[20e3, 30e3], [45e3, 25e3]], [[0, 0], [60e3, 0]], (50, 0.00175)).round(3))
    0.207
    """
    known = stage(positions, sensors, sigma, times=times)
    return _core.registration_eta(
        targets(known, positions, None), known.places, known.sigma, np.zeros(known.n), out
    )


def _two_in_the_plane(known: Setup, what: str, extras: Sequence[Extra] = ()) -> None:
    if known.places.shape[-2:] != (2, 2) or extras:
        raise InputError(
            f"{what} is for two sensors in the plane, here are {len(known.labels)} with "
            f'{known.d} coordinates: use method "eta" or the problem\'s analysis'
        )


def _smoothed(places: Array, window: int | None) -> Array:
    """Local parabolas over `window` looks; at the ends those of the first and last window."""
    if window is None:
        return places
    looks = places.shape[-2] if places.ndim >= 2 else 0
    if window < 3 or window % 2 == 0 or window > looks:
        raise InputError(f"smoothing = {window}: must be odd, from 3 to {looks} looks")
    half = window // 2
    design = np.vander(np.arange(-half, half + 1) / max(half, 1), 3)
    hat = design @ np.linalg.pinv(design)
    out = places.copy()
    for k in range(looks):
        middle = min(max(k, half), looks - 1 - half)
        part = places[..., middle - half : middle + half + 1, :]
        out[..., k, :] = np.einsum("j,...jd->...d", hat[k - middle + half], part)
    return out
