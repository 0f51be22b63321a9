"""The rows that reports put on the biases of their sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from gramian import _core
from gramian import _options as options
from gramian._arrays import above_rounding, number, require_finite
from gramian.exceptions import InputError
from gramian.models.registration._reports import Reports, stage, targets
from gramian.models.registration._setup import Array, Extra, SensorsLike, Setup, setup
from gramian.problem import Problem


def rows(
    positions: ArrayLike | Reports,
    sensors: SensorsLike,
    sigma: ArrayLike,
    *,
    extras: Sequence[Extra] = (),
    biases: ArrayLike | Mapping[str, float] | None = None,
    times: ArrayLike | None = None,
    out: Array | None = None,
) -> Array:
    """Return whitened rows on the biases alone, the targets' positions unknown.

    Parameters
    ----------
    positions : array_like, shape (..., K, d), or Reports
        Where the target of each look is: east and north (d = 2), and up (d = 3),
        metres. Of `Reports` the positions that they give together.
    sensors : array_like, shape (N, d), or mapping of str to array_like, shape (d,)
        Places of the N >= 2 sensors, metres, with their names; without names
        they are A, B, C, ... A `Platform` in place of a place moves, or has azimuths
        that count from its heading.
    sigma : array_like, shape (d,) or (N, d)
        Standard deviations of range (m), azimuth and, with d = 3, elevation
        (rad): of every sensor, or a line for each.
    extras : sequence of {"gain", "position", "attitude"}
        Further biases: a range that comes out too long by a factor; a sensor
        that is not quite where it is believed to be; axes that are turned about
        the vertical (clockwise) and, with d = 3, about east and north.
    biases : array_like, shape (..., n), or mapping of str to float, optional
        The biases about which to linearise; 0 by default. They matter for
        reports, and for gain, tilts and position errors that are not small.
    times : array_like, shape (K,), optional
        Of the looks, seconds: what platforms that move need, unless `Reports` have them.
    out : ndarray, shape of the result, optional
        Where the result is written: float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

    Returns
    -------
    ndarray, shape (..., K (N - 1) d, n)
        The n columns are the biases of the first sensor, then of the second,
        and so on; `problem` names them.

    Raises
    ------
    InputError
        Coincident sensors, a target on a sensor or straight above one, a wrong
        shape, a number that is not finite, a deviation that is not positive; a time outside
        the path of a platform, or times that are missing.

    Notes
    -----
    The position is eliminated from each look's N d measurements by an orthogonal
    transformation, which leaves exactly the information that is there when it is
    unknown. For two sensors in the plane that is the track-independent model of
    Zhu, Tang & He 2013, eqs. (5) to (12), whitened; in biases over their deviations
    each look's rows span a plane of two dimensions, wherever the target is. The
    map is flat: over distances where the earth's curvature matters, give positions
    in a common local frame and use d = 3.

    Examples
    --------
    >>> look = rows([[20e3, 30e3]], [[0, 0], [60e3, 0]], (50.0, 0.00175))
    >>> look.shape
    (2, 4)
    """
    known = stage(positions, sensors, sigma, extras, times=times)
    about = known.biases(biases)
    return require_finite(
        _core.registration_rows(
            targets(known, positions, about), known.places, known.sigma, about, known.flags, out
        ),
        "a row",
    )


def problem(
    positions: ArrayLike | Reports,
    sensors: SensorsLike,
    sigma: ArrayLike,
    *,
    extras: Sequence[Extra] = (),
    biases: ArrayLike | Mapping[str, float] | None = None,
    times: ArrayLike | None = None,
    scale: Mapping[str, float] | None = None,
) -> Problem:
    """Return the problem of registering these sensors by these targets.

    Parameters
    ----------
    positions, sensors, sigma, extras, biases, times
        As for `rows`, without leading axes: the looks of all targets together.
    scale : mapping of str to float, optional
        For a bias ("A.range") or a kind of bias ("range") the deviation that
        would be useless; bounds above it make the answer "weak".

    Returns
    -------
    Problem
        States "A.range", "A.azimuth", "B.range", ...

    Notes
    -----
    What no look can tell comes out as null combinations: on a singular track
    (`singular_tracks`), and as gauge freedoms where the extras bring them. With
    position errors all sensors and targets may move or turn together; a heading
    error is the same as an azimuth bias.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> along = np.stack([np.linspace(6e3, 54e3, 50), np.zeros(50)], axis=1)
    >>> sensors = {"A": (0, 0), "B": (60e3, 0)}
    >>> gm.analyze(problem(along, sensors, (50.0, 0.00175))).null_combinations
    ('A.range +1, B.range -1',)
    """
    known = stage(positions, sensors, sigma, extras, times=times)
    about = known.biases(biases)
    places = targets(known, positions, about)
    values = _core.registration_rows(places, known.places, known.sigma, about, known.flags)
    if values.ndim != 2:
        raise InputError(
            f"the rows have shape {values.shape}: a problem is one set of looks, positions (K, d)"
        )
    scales = None
    if scale is not None:
        scales = np.full(known.n, np.nan)
        for key, value in options.mapping(scale, "scale").items():
            chosen = [i for i, name in enumerate(known.names) if key in (name, name.split(".")[-1])]
            if not chosen:
                known.index(key)
            scales[chosen] = number(value, f"scale of {key}")
    noise = _core.registration_rounding(places, known.places, known.sigma, about, known.flags)
    values, rtol = above_rounding(values, noise)
    made = Problem(
        values,
        known.names,
        units=known.units,
        scale=scales,
        rtol=rtol,
    )
    plain = known.is_pair and scale is None and not about.any()
    return made._of("registration", places, known.places, known.sigma) if plain else made


def fisher(
    positions: ArrayLike | Reports,
    sensors: SensorsLike,
    sigma: ArrayLike,
    *,
    extras: Sequence[Extra] = (),
    biases: ArrayLike | Mapping[str, float] | None = None,
    times: ArrayLike | None = None,
    out: Array | None = None,
) -> Array:
    """Return the Fisher information on the biases, the targets' positions unknown.

    Parameters
    ----------
    positions, sensors, sigma, extras, biases, times
        As for `rows`.
    out : ndarray, shape of the result, optional
        Where the result is written: float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

    Returns
    -------
    ndarray, shape (..., n, n)

    Notes
    -----
    For two sensors, J = sum of H^T R^-1 H with R = H Sigma H^T: the Schur
    complement of all positions. It is summed without an inverse from the minors
    of H Sigma^(1/2), in vectors over the looks. As always, take ranks and bounds
    from `rows` or `problem`.

    Examples
    --------
    >>> import numpy as np
    >>> s = np.array([50.0, 0.00175, 50.0, 0.00175])
    >>> j = fisher([[20e3, 30e3]], [[0, 0], [60e3, 0]], s[:2])
    >>> round(float(np.trace(j * np.outer(s, s))), 12)  # the same for every look
    2.0
    """
    known = stage(positions, sensors, sigma, extras, times=times)
    about = known.biases(biases)
    return _core.registration_fisher(
        targets(known, positions, about), known.places, known.sigma, about, known.flags, out
    )


def gauges(
    sensors: SensorsLike, extras: Sequence[Extra] = (), *, times: ArrayLike | None = None
) -> dict[str, Array]:
    """Return the combinations of biases that no target whatever can tell, by name.

    Parameters
    ----------
    sensors, extras
        As for `rows`.
    times : array_like, shape (K,), optional
        Of the looks, seconds, for platforms that move.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        "shift east", "shift north", "shift up" and "turn": all sensors and
        targets moved together; "stretch": all distances from the origin longer;
        "A.heading = A.azimuth": two names for one thing. "tilt east" and
        "tilt north" tilt the whole map, with attitude and position errors. Of sensors that
        move against each other the shifts alone are left, and the two names.

    Examples
    --------
    >>> list(gauges([[0, 0], [60e3, 0]], ["position"]))
    ['shift east', 'shift north', 'turn']
    >>> list(gauges([[0, 0], [60e3, 0]]))
    []
    """
    return gauges_of(setup(sensors, None, extras, times=times))


def gauges_of(known: Setup) -> dict[str, Array]:
    """Return the `gauges` of sensors that are set up."""
    found: dict[str, Array] = {}
    axes = ("east", "north", "up")[: known.d]

    def vector(values: Mapping[str, Array]) -> Array:
        out = np.zeros(known.n)
        for kind, numbers in values.items():
            for label, one in zip(known.labels, numbers, strict=True):
                out[known.index(f"{label}.{kind}")] = one
        return out

    ones, zeros = np.ones(len(known.labels)), np.zeros(len(known.labels))
    places, rigid = known.places, True
    if known.moves:
        # Where all move alike, the targets may be turned about the first.
        apart = known.places - known.places[:, :1]
        size = float(np.abs(known.places).max(initial=0.0))
        rigid = bool(np.abs(apart - apart[:1]).max(initial=0.0) <= 1e-12 * size)
        places = apart[0]
    place = dict(zip(("east", "north", "up"), [*places.T, zeros], strict=False))
    if "position" in known.extras:
        for axis in axes:
            found[f"shift {axis}"] = vector({axis: ones})
    if "position" in known.extras and rigid:
        # Clockwise by a small angle: all azimuths come out too small by it.
        found["turn"] = vector({"east": place["north"], "north": -place["east"], "azimuth": -ones})
        if "gain" in known.extras:
            found["stretch"] = vector({axis: place[axis] for axis in axes} | {"gain": -ones})
        if known.d == 3 and "attitude" in known.extras:
            found["tilt east"] = vector(
                {"north": -place["up"], "up": place["north"], "tilt_east": -ones}
            )
            found["tilt north"] = vector(
                {"east": place["up"], "up": -place["east"], "tilt_north": -ones}
            )
    if "attitude" in known.extras:
        for label in known.labels:
            one = np.zeros(known.n)
            one[known.index(f"{label}.azimuth")] = 1.0
            one[known.index(f"{label}.heading")] = -1.0
            found[f"{label}.heading = {label}.azimuth"] = one
    return found
