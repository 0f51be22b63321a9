"""The field of a moving dipole, its derivatives, rows and Fisher information."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._arrays import SEED_MOST, as_float_array, finite, number, require_finite, whole
from gramian.exceptions import InputError
from gramian.problem import Problem

__all__ = [
    "MU0",
    "NAMES",
    "UNITS",
    "Jacobian",
    "Pass",
    "equivalents",
    "field",
    "fisher",
    "jacobian",
    "measure",
    "moment",
    "problem",
    "rows",
    "simulate",
]

Array = NDArray[np.float64]

#: The states: position, velocity and moment.
NAMES = ("x0", "y0", "z0", "vx", "vy", "vz", "mx", "my", "mz")
#: Their units.
UNITS = ("m", "m", "m", "m/s", "m/s", "m/s", "A m^2", "A m^2", "A m^2")

#: The five numbers of a quadrupole, A m^3, the last of its diagonal is minus the sum of the others.
ENTRIES = ("Qxx", "Qyy", "Qxy", "Qxz", "Qyz")

#: The magnetic constant, H/m.
MU0 = 4e-7 * np.pi

_ORIGIN = ((0.0, 0.0, 0.0),)


class Jacobian(NamedTuple):
    """Derivatives of the field: by position (T/m) and by moment (T/(A m^2)), (..., 3, 3)."""

    position: Array
    moment: Array


class Pass(NamedTuple):
    """A dipole at constant velocity: r0 (m, at the first time), v (m/s), m (A m^2)."""

    r0: Array
    v: Array
    m: Array


def field(position: ArrayLike, moment: ArrayLike, *, out: Array | None = None) -> Array:
    """Return the field of a dipole at a sensor.

    Parameters
    ----------
    position : array_like, shape (..., 3)
        Of the dipole from the sensor, metres.
    moment : array_like, shape (..., 3)
        A m^2.
    out : ndarray, shape of the result, optional
        Where the result is written: float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

    Returns
    -------
    ndarray, shape (..., 3)
        Tesla.

    Raises
    ------
    InputError
        A dipole on the sensor, numbers that are not finite, shapes that do not fit.

    Notes
    -----
    Dai, Zhou & Shan 2020, eq. (2), with mu0 / (4 pi) = 1e-7 H/m.

    Examples
    --------
    >>> field([2.0, 0.0, 0.0], [4.0, 0.0, 0.0])
    array([1.e-07, 0.e+00, 0.e+00])
    """
    return _core.dipole_field(position, moment, out)


def jacobian(position: ArrayLike, moment: ArrayLike, *, out: Array | None = None) -> Jacobian:
    """Return the derivatives of `field` by position and by moment.

    Parameters
    ----------
    position, moment : array_like, shape (..., 3)
        As for `field`.
    out : ndarray, shape (..., 2, 3, 3), optional
        Where the results are written, float64, C-contiguous, writable: they are views of
        it. It may share memory with an argument. Without it a new array is made.

    Returns
    -------
    Jacobian
        Two arrays (..., 3, 3), both symmetric.

    Notes
    -----
    Dai, Zhou & Shan 2020, eqs. (20) and (21), times the mu0 / (4 pi) that the
    print drops.

    Examples
    --------
    >>> j = jacobian([1.0, -2.0, 0.5], [3.0, 1.0, 2.0])
    >>> bool(np.allclose(j.position @ [1.0, -2.0, 0.5], -3 * field([1.0, -2.0, 0.5], [3, 1, 2])))
    True
    """
    both = require_finite(_core.dipole_jacobian(position, moment, out), "the Jacobian")
    return Jacobian(both[..., 0, :, :], both[..., 1, :, :])


def moment(
    permanent: ArrayLike, attitude: ArrayLike, induced_volume: float, earth_field: ArrayLike
) -> Array:
    """Return the moment of a body: permanent, turned with it, and induced.

    Parameters
    ----------
    permanent : array_like, shape (..., 3)
        In the body's frame, A m^2.
    attitude : array_like, shape (..., 3, 3)
        Rotation from the body's frame to the sensor's.
    induced_volume : float
        Volume times effective susceptibility, m^3.
    earth_field : array_like, shape (..., 3)
        In the sensor's frame, tesla.

    Returns
    -------
    ndarray, shape (..., 3)

    Notes
    -----
    Dai, Zhou & Shan 2020, eqs. (3) and (4).

    Examples
    --------
    >>> moment([100.0, 0.0, 0.0], np.eye(3), 2.0, [0.0, 2e-5, -4.5e-5]).round(1)
    array([100. ,  31.8, -71.6])
    """
    turn, own, earth = (
        finite(value, name)
        for name, value in (
            ("attitude", attitude),
            ("permanent", permanent),
            ("earth_field", earth_field),
        )
    )
    for name, array, shape in (
        ("permanent", own, (3,)),
        ("attitude", turn, (3, 3)),
        ("earth_field", earth, (3,)),
    ):
        if array.shape[-len(shape) :] != shape:
            raise InputError(
                f"{name} has shape {array.shape}: must be (..., {', '.join(map(str, shape))})"
            )
    if not np.allclose(turn @ turn.swapaxes(-1, -2), np.eye(3), atol=1e-6):
        raise InputError("attitude is no rotation: attitude times its transpose must be 1")
    total: Array = (
        np.einsum("...ij,...j->...i", turn, own)
        + number(induced_volume, "induced_volume") / MU0 * earth
    )
    return require_finite(total, "the moment")


def rows(
    r0: ArrayLike,
    v: ArrayLike,
    m: ArrayLike,
    times: ArrayLike,
    sigma: ArrayLike,
    *,
    sensors: ArrayLike | None = None,
    ambient: ArrayLike | None = None,
    baselines: ArrayLike | None = None,
    quadrupole: ArrayLike | None = None,
    out: Array | None = None,
) -> Array:
    """Return whitened rows of the field of a dipole at constant velocity.

    Parameters
    ----------
    r0 : array_like, shape (..., 3)
        Position at the first time, metres.
    v : array_like, shape (..., 3)
        Velocity, m/s.
    m : array_like, shape (..., 3)
        Moment, A m^2.
    times : array_like, shape (..., K)
        Increasing, seconds.
    sigma : array_like, shape () or (..., K), or (S, 3) or (..., K, S, 3)
        Standard deviation of the noise, tesla, > 0 (for gradiometers that of the difference):
        of all, of each time, or of each channel or number, `inf` where nothing was measured.
        With `ambient` (S, 1) or (..., K, S, 1).
    sensors : array_like, shape (S, 3), optional
        Where the sensors are, metres; one at the origin by default.
    ambient : array_like, shape (3,), optional
        The field without the dipole, tesla. With it the sensors are of the total
        field: they measure ``|ambient + field|``, one number instead of three.
    baselines : array_like, shape (3,) or (S, 3), optional
        From each sensor to its second head, metres. With it the sensors are gradiometers:
        they measure the difference, that of the second head less that of the first, tesla.
    quadrupole : array_like, shape (..., 3, 3), optional
        Of a body that has one too, at the place of its dipole: symmetric, without a trace, A m^3;
        for its convention see the notes of `localize`.
    out : ndarray, shape of the result, optional
        Where the result is written: float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

    Returns
    -------
    ndarray, shape (..., K * S * 3, 9) or (..., K * S, 9)
        Derivatives by (r0, v, m) over sigma: for each time, in it for each
        sensor, in it for each component. Those of what was not measured are 0. With
        `quadrupole` 14 columns, the last by Qxx, Qyy, Qxy, Qxz and Qyz.

    Raises
    ------
    InputError
        Shapes that do not fit, numbers that are not finite, times that do not
        increase, a sigma that is not positive, a sample at which the dipole is
        on a sensor.

    Notes
    -----
    Dai, Zhou & Shan 2020, eq. (19). One sensor of three components always has
    the null vector (r0, v, 3 m); one of the total field also has that of a turn
    about the ambient field. Where the field of the dipole is far weaker than the ambient
    one, two more directions are hardly seen: such a sensor determines five numbers, a time,
    a duration and three sizes. A gradiometer has none in general: its baseline is a length.
    With a quadrupole Q the null vector is (r0, v, 3 m, 4 Q). A move of the body by d then differs
    from a change of Q by 3 (d m^T + m d^T) - 2 (d . m) 1 only as far as Q itself moves: at
    Q = 0 three more directions are not determined, whatever the sensors.

    Examples
    --------
    >>> a = rows([-10, -10, 5], [1, 1, 0], [10, 20, 10], np.arange(21.0), 1e-9)
    >>> a.shape, bool(abs(a @ [-10, -10, 5, 1, 1, 0, 30, 60, 30]).max() < 1e-12 * abs(a).max())
    ((63, 9), True)
    """
    places, kind = _sensors(sensors), _kind(sensors, baselines, ambient)
    samples = as_float_array(times, "times").shape[-1:]
    count = as_float_array(places, "sensors").shape[-2:-1]
    shape = (*samples, *count, 3 if ambient is None else 1)
    entries = _entries(quadrupole)
    return require_finite(
        _core.dipole_rows(times, r0, v, m, _levels(sigma, shape), places, kind, entries, out),
        "a row",
    )


def measure(
    r0: ArrayLike,
    v: ArrayLike,
    m: ArrayLike,
    times: ArrayLike,
    *,
    sensors: ArrayLike | None = None,
    ambient: ArrayLike | None = None,
    baselines: ArrayLike | None = None,
    quadrupole: ArrayLike | None = None,
    out: Array | None = None,
) -> Array:
    """Return what sensors measure of a dipole at constant velocity, without noise.

    Parameters
    ----------
    r0, v, m, times, sensors, ambient, baselines, quadrupole
        As for `rows`.
    out : ndarray, shape of the result, optional
        Where the result is written: float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

    Returns
    -------
    ndarray, shape (..., K, 3) or (..., K), with ``sensors`` (..., K, S, 3) or (..., K, S)
        Tesla. With `ambient` the total field, otherwise three components; with `baselines`
        their differences.

    Examples
    --------
    >>> measure([-10, -10, 5], [1, 1, 0], [10, 20, 10], np.arange(21.0)).shape
    (21, 3)
    """
    kind = _kind(sensors, baselines, ambient)
    one, entries = sensors is None, _entries(quadrupole)
    found = _core.dipole_measure(times, r0, v, m, _sensors(sensors), kind, entries, one, out)
    return require_finite(found, "the field")


def simulate(
    r0: ArrayLike,
    v: ArrayLike,
    m: ArrayLike,
    times: ArrayLike,
    sigma: ArrayLike,
    seed: int,
    *,
    sensors: ArrayLike | None = None,
    ambient: ArrayLike | None = None,
    baselines: ArrayLike | None = None,
    quadrupole: ArrayLike | None = None,
    trials: int | None = None,
) -> Array:
    """Return noisy fields of a pass, the same for the same seed on any machine.

    Parameters
    ----------
    r0, v, m, times, sensors, ambient, baselines, quadrupole
        As for `rows`, of one pass.
    sigma : array_like
        As for `rows`, or 0 for all. What was not measured is NaN.
    seed : int
        >= 0. Trial i depends on (seed, i) alone.
    trials : int, optional
        Number of trials; without it one trial without a leading axis.

    Returns
    -------
    ndarray
        As `measure` returns, with trials in front.

    Examples
    --------
    >>> one = simulate([-10, -10, 5], [1, 1, 0], [10, 20, 10], [0, 1, 2], 1e-9, seed=4)
    >>> one.shape
    (3, 3)
    """
    seed = whole(seed, "seed", 0, SEED_MOST)
    if trials is not None:
        trials = whole(trials, "trials", 1)
    exact = measure(
        r0,
        v,
        m,
        times,
        sensors=sensors,
        ambient=ambient,
        baselines=baselines,
        quadrupole=quadrupole,
    )
    if exact.ndim != 1 + (ambient is None) + (sensors is not None):
        raise InputError("simulate takes one pass, without leading axes")
    noise = _core.normals(seed, 0, trials or 1, exact.size).reshape(-1, *exact.shape)
    noisy: Array = exact + as_noise(sigma, exact, 3 if ambient is None else 1) * noise
    return noisy if trials is not None else noisy[0]


def fisher(
    r0: ArrayLike,
    v: ArrayLike,
    m: ArrayLike,
    times: ArrayLike,
    sigma: ArrayLike,
    *,
    sensors: ArrayLike | None = None,
    out: Array | None = None,
) -> Array:
    """Return the Fisher information of (r0, v, m) from three-component sensors.

    Parameters
    ----------
    r0, v, m, times, sensors
        As for `rows`; leading axes broadcast.
    sigma : array_like, shape () or (..., K)
        Standard deviation of each component, tesla, > 0.
    out : ndarray, shape of the result, optional
        Where the result is written: float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

    Returns
    -------
    ndarray, shape (..., 9, 9)

    Raises
    ------
    InputError
        As for `rows`.

    Notes
    -----
    Dai, Zhou & Shan 2020, eq. (18). At constant velocity all 42 different sums
    in it are combinations of seven, the sums of t^k / r^12 for k = 0 to 6, which
    is what is summed. Half the digits are lost in the matrix: take ranks and
    bounds from `rows` or `problem`. For other sensors, or deviations of each channel, use
    ``gm.gram(rows(...))``.

    Examples
    --------
    >>> j = fisher([-10, -10, 5], [1, 1, 0], [10, 20, 10], np.arange(21.0), 1e-9)
    >>> round(float(j[0, 0]), 6)
    216.076908
    """
    return require_finite(
        _core.dipole_fisher(times, r0, v, m, _at_least_1d(sigma), _sensors(sensors), out),
        "the information",
    )


def equivalents(
    r0: ArrayLike, v: ArrayLike, m: ArrayLike, scale: ArrayLike
) -> dict[Literal["same", "mirror"], Pass]:
    """Return the passes that one sensor of three components cannot tell from this one.

    Parameters
    ----------
    r0, v, m : array_like, shape (..., 3)
        The pass.
    scale : array_like, shape (...)
        The sizes u > 0 wanted.

    Returns
    -------
    dict
        "same": (u r0, u v, u^3 m); "mirror": (-u r0, -u v, u^3 m). Both make the
        same field at the origin as the pass itself.

    Raises
    ------
    InputError
        A scale that is not positive.

    Notes
    -----
    Dai, Zhou & Shan 2020, eq. (28), which is printed for all u != 0. It holds for
    u > 0: a negative u turns the sign of the field. The mirror image is an
    ambiguity of its own, which the Fisher matrix cannot show.

    Examples
    --------
    >>> far = equivalents([-10, -10, 5], [1, 1, 0], [10, 20, 10], 2.0)["same"]
    >>> far.r0, far.m
    (array([-20., -20.,  10.]), array([ 80., 160.,  80.]))
    """
    u = as_float_array(scale, "scale")[..., None]
    if not ((u > 0) & (u < np.inf)).all():
        raise InputError(
            f"scale = {scale!r}: must be > 0 and finite; a negative scale turns the sign of the "
            "field, and the mirror image is returned beside"
        )
    start, velocity, strength = (
        finite(value, name) for name, value in (("r0", r0), ("v", v), ("m", m))
    )
    for name, array in (("r0", start), ("v", velocity), ("m", strength)):
        if array.shape[-1:] != (3,):
            raise InputError(f"{name} has shape {array.shape}: must be (..., 3)")
    return {
        "same": Pass(u * start, u * velocity, u**3 * strength),
        "mirror": Pass(-u * start, -u * velocity, u**3 * strength),
    }


def problem(
    r0: ArrayLike,
    v: ArrayLike,
    m: ArrayLike,
    times: ArrayLike,
    sigma: ArrayLike,
    *,
    sensors: ArrayLike | None = None,
    ambient: ArrayLike | None = None,
    baselines: ArrayLike | None = None,
    quadrupole: ArrayLike | None = None,
    scale: ArrayLike | None = None,
) -> Problem:
    """Return the problem of one pass: rows with named states.

    Parameters
    ----------
    r0, v, m, times, sigma, sensors, ambient, baselines, quadrupole
        As for `rows`, without leading axes.
    scale : array_like, shape (9,) or (14,), optional
        For each state the deviation that would be useless. By default the closest range
        to a sensor for the position, that range over the time of the pass (or the speed, if
        it is more) for the velocity, the moment, and for the quadrupole that of the moment
        moved by this range.

    Returns
    -------
    Problem
        States x0, y0, z0, vx, vy, vz, mx, my, mz, with `quadrupole` Qxx, Qyy, Qxy, Qxz, Qyz;
        combinations "speed", "moment" (its magnitude) and "range" (at the first time),
        linearised there.

    Notes
    -----
    One sensor of three components: nullity 1, the scale; 2 where the moment is
    perpendicular to the plane of the pass and the sensor; 3 for a radial or a
    resting pass. Knowing a state repairs it only if its part in the null vector
    (r0, v, 3 m) is not zero: z0 = 0 known says nothing.

    Examples
    --------
    >>> import gramian as gm
    >>> answer = gm.analyze(problem([-10, -10, 5], [1, 1, 0], [10, 20, 10], np.arange(21.0), 1e-9))
    >>> scale = answer.null_space[:, 0]
    >>> answer.nullity, (scale[6:] / scale[0]).round(9)
    (1, array([-3., -6., -3.]))
    >>> answer.knowing("speed").repairs, answer.knowing("vz").repairs
    (True, False)
    """
    values = rows(
        r0,
        v,
        m,
        times,
        sigma,
        sensors=sensors,
        ambient=ambient,
        baselines=baselines,
        quadrupole=quadrupole,
    )
    if values.ndim != 2:
        raise InputError(f"the rows have shape {values.shape}: a problem is one pass")
    combinations = {}
    for name, key, vector, first in (
        ("range", "r0", r0, 0),
        ("speed", "v", v, 3),
        ("moment", "m", m, 6),
    ):
        along = as_float_array(vector, key)
        size = np.linalg.norm(along)
        if size > 0:
            combinations[name] = np.zeros(values.shape[1])
            combinations[name][first : first + 3] = along / size
    if scale is None:
        scale = _scales(r0, v, m, times, sensors)
        if quadrupole is not None:
            scale = np.append(scale, np.repeat(scale[0] * scale[6], len(ENTRIES)))
    more = () if quadrupole is None else ENTRIES
    names, units = (*NAMES, *more), (*UNITS, *("A m^3" for _ in more))
    made = Problem(values, names, units=units, scale=scale, combinations=combinations)
    if any(x is not None for x in (ambient, baselines, quadrupole)) or np.ndim(sigma) > 1:
        return made
    return made._of("dipole", r0, v, m, times, sigma, sensors)


def _scales(
    r0: ArrayLike, v: ArrayLike, m: ArrayLike, times: ArrayLike, sensors: ArrayLike | None
) -> Array:
    """Return what each state's deviation must stay below to be of use; NaN for none."""
    t = as_float_array(times, "times")
    velocity = as_float_array(v, "v")
    path = as_float_array(r0, "r0") + (t - t[0])[:, None] * velocity
    places = as_float_array(_sensors(sensors), "sensors").reshape(-1, 3)
    reach = float(np.linalg.norm(path[:, None] - places, axis=2).min())
    span = float(np.ptp(t))
    rate = max(float(np.linalg.norm(velocity)), reach / span if span > 0 else 0.0)
    scales = np.repeat([reach, rate, float(np.linalg.norm(as_float_array(m, "m")))], 3)
    usable: Array = np.where(np.isfinite(scales) & (scales > 0), scales, np.nan)
    return usable


def _sensors(sensors: ArrayLike | None) -> ArrayLike:
    return _ORIGIN if sensors is None else sensors


def _entries(quadrupole: ArrayLike | None) -> Array | None:
    """Return the five numbers (..., 5) of quadrupoles (..., 3, 3)."""
    if quadrupole is None:
        return None
    given = finite(quadrupole, "quadrupole [A m^3]")
    if given.shape[-2:] != (3, 3):
        raise InputError(f"quadrupole has shape {given.shape}: must be (..., 3, 3)")
    rounding = 1e-9 * np.abs(given).max(initial=0.0)
    if (np.abs(given - np.swapaxes(given, -1, -2)) > rounding).any():
        raise InputError(f"quadrupole = {given.tolist()}: must be symmetric")
    if (np.abs(np.trace(given, axis1=-2, axis2=-1)) > rounding).any():
        raise InputError(f"quadrupole = {given.tolist()}: must have a trace of 0")
    rows, columns = (0, 1, 0, 0, 1), (0, 1, 1, 2, 2)
    entries: Array = given[..., rows, columns]
    return entries


def _kind(
    sensors: ArrayLike | None, baselines: ArrayLike | None, ambient: ArrayLike | None
) -> tuple[list[list[float]], tuple[float, float, float] | None]:
    """Return what sensors measure, as the extension takes it."""
    if baselines is None:
        return [], as_ambient(ambient)
    shape = finite(_sensors(sensors), "sensors").shape[-2:]
    return as_baselines(baselines, shape).tolist(), as_ambient(ambient)


def _levels(sigma: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return deviations as the extension takes them: (..., 1), (..., K), or of each number."""
    given = as_float_array(sigma, "sigma [T]")
    if given.ndim == 0:
        return finite(given, "sigma [T]")[None]
    if given.shape == shape[1:]:
        return as_deviations(given, shape).ravel()
    if given.ndim > 2 and given.shape[-3:] == shape:
        return _positive(given).reshape(*given.shape[:-3], -1)
    return given


def _positive(sigma: Array) -> Array:
    if (bad := ~(sigma > 0)).any():
        at = np.unravel_index(int(np.argmax(bad)), bad.shape)
        place = f"[{', '.join(map(str, at))}]" if at else ""
        raise InputError(f"sigma{place} = {sigma[at]:g} T: must be > 0")
    return sigma


def as_deviations(sigma: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return the deviation of each number of a record of a shape (K, S, components), tesla."""
    given = _positive(as_float_array(sigma, "sigma [T]"))
    if given.shape == shape[:1]:
        given = given[:, None, None]
    elif given.shape not in ((), shape[1:], shape):
        samples, sensors, components = shape
        raise InputError(
            f"sigma has shape {given.shape}: must be (), ({samples},) of times, "
            f"({sensors}, {components}) of channels, or ({samples}, {sensors}, {components})"
        )
    if not (given < np.inf).any():
        raise InputError("sigma is infinite throughout: nothing was measured")
    return np.array(np.broadcast_to(given, shape))


def as_baselines(baselines: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return baselines (S, 3) of sensors of that shape, metres, none of them 0."""
    given = finite(baselines, "baselines [m]")
    if given.shape not in ((3,), shape):
        wanted = ", ".join(map(str, shape))
        raise InputError(f"baselines has shape {given.shape}: must be (3,) or ({wanted})")
    apart = np.array(np.broadcast_to(given, shape))
    if (still := ~apart.any(axis=-1)).any():
        raise InputError(
            f"baselines[{int(np.argmax(still))}] is 0: the heads of a gradiometer must be apart"
        )
    return apart


def _at_least_1d(sigma: ArrayLike) -> Array:
    array = as_float_array(sigma, "sigma [T]")
    return array[None] if array.ndim == 0 else array


def as_noise(sigma: ArrayLike, exact: Array, components: int) -> Array:
    """Return the deviation of each number of a record, NaN for one that is not measured."""
    if as_float_array(sigma, "sigma [T]").ndim == 0:
        level = number(sigma, "sigma [T]")
        if level < 0:
            raise InputError(f"sigma = {level} T: must be >= 0 and finite")
        return np.asarray(level)
    each = as_deviations(sigma, (len(exact), exact[0].size // components, components))
    return np.where(each < np.inf, each, np.nan).reshape(exact.shape)


def as_ambient(ambient: ArrayLike | None) -> tuple[float, float, float] | None:
    if ambient is None:
        return None
    array = as_float_array(ambient, "ambient")
    if array.shape != (3,) or not np.isfinite(array).all() or not array.any():
        raise InputError(f"ambient = {ambient!r}: must be three finite numbers in tesla, not all 0")
    return float(array[0]), float(array[1]), float(array[2])
