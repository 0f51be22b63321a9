"""Error models of a strapdown inertial navigator, for questions of observability.

Axes are north, west, up (N, W, U) for navigation and forward, left, up for the
body, so that a level vehicle that heads north has both the same. States, in
this order: tilt phi (rad), velocity error dV (m/s), errors of latitude and
longitude (rad) and height (m), gyro bias eps (rad/s) and accelerometer bias
Delta (m/s^2) in body axes. Errors are what the navigator says less what is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian._numbers import finite, number, reals
from gramian.exceptions import InputError
from gramian.linear.systems import System
from gramian.linear.windows import Piecewise, piecewise

__all__ = [
    "EARTH_RATE",
    "NAMES",
    "UNITS",
    "Flight",
    "Leg",
    "error_model",
    "gravity",
    "radii",
    "rotation",
    "segments",
    "static_base",
]

Array = NDArray[np.float64]

#: Rotation of the Earth, rad/s (WGS 84).
EARTH_RATE = 7.292115e-5
#: What is known beforehand by default: tilts of 1 minute of arc, gyro biases of 0.01 deg/h.
TILT = float(np.radians(1 / 60))
GYRO_BIAS = float(np.radians(0.01)) / 3600

# WGS 84: semi-major axis, flattening, and the constants of Somigliana's formula
# for gravity on the ellipsoid. NIMA TR8350.2, tables 3.1, 3.3 and 3.4.
_SEMI_MAJOR = 6378137.0
_FLATTENING = 1 / 298.257223563
_ECCENTRICITY2 = _FLATTENING * (2 - _FLATTENING)
_GRAVITY_EQUATOR = 9.7803253359
_SOMIGLIANA = 0.00193185265241
# omega^2 a^2 b / GM, for gravity above the ellipsoid.
_GRAVITY_RATIO = 0.00344978650684

# Segments of one leg: more are a slip in its numbers, and hours of work.
_MOST_PIECES = 10_000

NAMES = (
    "phi_N", "phi_W", "phi_U",
    "dV_N", "dV_W", "dV_U",
    "dL", "dlambda", "dh",
    "eps_N", "eps_W", "eps_U",
    "Delta_N", "Delta_W", "Delta_U",
)  # fmt: skip
UNITS = (*["rad"] * 3, *["m/s"] * 3, "rad", "rad", "m", *["rad/s"] * 3, *["m/s^2"] * 3)
OUTPUTS = ("V_N", "V_W", "V_U", "latitude", "longitude", "height")


def radii(latitude: float) -> tuple[float, float]:
    """Return the radii of curvature in the meridian and across it, metres.

    Parameters
    ----------
    latitude : float
        Geodetic, radians.

    Examples
    --------
    >>> meridian, normal = radii(0.0)
    >>> round(meridian), round(normal)
    (6335439, 6378137)
    """
    latitude = number(latitude, "latitude")
    w = np.sqrt(1 - _ECCENTRICITY2 * np.sin(latitude) ** 2)
    return float(_SEMI_MAJOR * (1 - _ECCENTRICITY2) / w**3), float(_SEMI_MAJOR / w)


def gravity(latitude: float, height: float = 0.0) -> float:
    """Return gravity, m/s^2, positive downwards.

    Parameters
    ----------
    latitude : float
        Geodetic, radians.
    height : float
        Above the ellipsoid, metres.

    Notes
    -----
    Somigliana's formula; above the ellipsoid the second-order expansion of
    NIMA TR8350.2, eq. (4-3).

    Examples
    --------
    >>> import math
    >>> round(gravity(math.radians(45)), 6)
    9.806198
    """
    latitude, height = number(latitude, "latitude"), number(height, "height")
    if not abs(height) < _SEMI_MAJOR:
        raise InputError(f"height = {height} m: must be within the radius of the Earth")
    s = np.sin(latitude) ** 2
    ground = _GRAVITY_EQUATOR * (1 + _SOMIGLIANA * s) / np.sqrt(1 - _ECCENTRICITY2 * s)
    first, second = _free_air(s)
    return float(ground * (1 - first * height + second * height**2))


def _free_air(s: float) -> tuple[float, float]:
    first = 2 / _SEMI_MAJOR * (1 + _FLATTENING + _GRAVITY_RATIO - 2 * _FLATTENING * s)
    return first, 3 / _SEMI_MAJOR**2


def rotation(heading: float, pitch: float = 0.0, roll: float = 0.0) -> Array:
    """Return the matrix (3, 3) from body axes (forward, left, up) to (N, W, U).

    Parameters
    ----------
    heading : float
        Clockwise from north, radians.
    pitch : float
        Nose up, radians.
    roll : float
        Right side down, radians.

    Examples
    --------
    >>> import math
    >>> (rotation(math.radians(90)) @ [1, 0, 0]).round(9) + 0.0
    array([ 0., -1.,  0.])
    """
    heading, pitch, roll = (
        number(value, name)
        for name, value in (("heading", heading), ("pitch", pitch), ("roll", roll))
    )
    # A turn clockwise seen from above is negative about "up"; nose up is
    # negative about "left".
    c, s = np.cos(heading), np.sin(heading)
    about_up = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    c, s = np.cos(pitch), np.sin(pitch)
    about_left = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    c, s = np.cos(roll), np.sin(roll)
    about_forward = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    matrix: Array = about_up @ about_left @ about_forward
    return matrix


def static_base(
    latitude: float,
    height: float = 0.0,
    *,
    earth_rate: float = EARTH_RATE,
    tilt: float = TILT,
    velocity: float = 0.1,
    position: float = 10.0,
    gyro_bias: float = GYRO_BIAS,
    accelerometer_bias: float | None = None,
    velocity_noise: float = 0.01,
    position_noise: float = 1.0,
) -> System:
    """Return the error model of a navigator at rest, level and heading north.

    Parameters
    ----------
    latitude : float
        Geodetic, radians, between -pi/2 and pi/2 and neither of them.
    height : float
        Above the ellipsoid, metres.
    earth_rate : float
        Rotation of the Earth, rad/s; 0 shows what it gives.
    tilt, velocity, position, gyro_bias, accelerometer_bias : float
        What is known beforehand, standard deviations: rad, m/s, m, rad/s, m/s^2;
        for the accelerometers 1e-4 of gravity by default.
    velocity_noise, position_noise : float
        Standard deviations of the measured velocity (m/s) and position (m).

    Returns
    -------
    System
        15 states, outputs velocity and position; combinations that are known
        at level 1, 2 and 3.

    Raises
    ------
    InputError
        A latitude beyond the poles or on one, where longitude does not exist.

    Notes
    -----
    Yang & Yin 2012, eq. (13): the paper does not print A; this is the standard
    model, without the change of gravity with height, which reproduces its table 1.
    `error_model` has that too.

    Examples
    --------
    >>> import math, gramian as gm
    >>> found = gm.linear.levels(static_base(math.radians(28.15)))
    >>> found.ranks[:4], found.states["phi_N"], found.combinations["Delta_N - g phi_W"]
    ((6, 9, 11, 12), None, 1)
    """
    system = error_model(
        latitude,
        height,
        earth_rate=earth_rate,
        gravity_gradient="omit",
        tilt=tilt,
        velocity_error=velocity,
        position_error=position,
        gyro_bias=gyro_bias,
        accelerometer_bias=accelerometer_bias,
        velocity_noise=velocity_noise,
        position_noise=position_noise,
    )
    g = gravity(latitude, height)
    north, up = earth_rate * np.cos(latitude), earth_rate * np.sin(latitude)
    named = {
        "Delta_N - g phi_W": {"Delta_N": 1.0, "phi_W": -g},
        "Delta_W + g phi_N": {"Delta_W": 1.0, "phi_N": g},
        "eps_N - w_U phi_W": {"eps_N": 1.0, "phi_W": -up},
        "eps_W + w_U phi_N - w_N phi_U": {"eps_W": 1.0, "phi_N": up, "phi_U": -north},
        "eps_U + w_N phi_W": {"eps_U": 1.0, "phi_W": north},
    }
    combinations = {}
    for name, parts in named.items():
        combinations[name] = np.zeros(system.n)
        for state, factor in parts.items():
            combinations[name][system.names.index(state)] = factor
    return System(
        A=system.A,
        C=system.C,
        names=system.names,
        units=system.units,
        prior=system.prior,
        outputs=system.outputs,
        noise=system.noise,
        combinations=combinations,
    )


def error_model(
    latitude: float,
    height: float = 0.0,
    *,
    specific_force: ArrayLike | None = None,
    velocity: ArrayLike = (0.0, 0.0, 0.0),
    attitude: ArrayLike | None = None,
    angular_rate: ArrayLike = (0.0, 0.0, 0.0),
    lever_arm: ArrayLike = (0.0, 0.0, 0.0),
    lever_arm_states: Literal["known", "estimated"] = "known",
    earth_rate: float = EARTH_RATE,
    gravity_gradient: Literal["include", "omit"] = "include",
    tilt: float = TILT,
    velocity_error: float = 0.1,
    position_error: float = 10.0,
    gyro_bias: float = GYRO_BIAS,
    accelerometer_bias: float | None = None,
    lever_arm_error: float = 0.1,
    velocity_noise: float = 0.01,
    position_noise: float = 1.0,
) -> System:
    """Return the error model of a moving navigator beside a satellite receiver.

    Parameters
    ----------
    latitude : float
        Geodetic, radians, between -pi/2 and pi/2 and neither of them.
    height : float
        Above the ellipsoid, metres.
    specific_force : array_like, shape (3,), optional
        In N, W, U, m/s^2; that of constant velocity by default.
    velocity : array_like, shape (3,)
        In N, W, U, m/s.
    attitude : array_like, shape (3, 3), optional
        From body to navigation axes, as `rotation` gives; the identity by default.
    angular_rate : array_like, shape (3,)
        Of the body against the navigation axes, in body axes, rad/s. Only the
        velocity of an antenna with a lever arm depends on it.
    lever_arm : array_like, shape (3,)
        From the navigator to the antenna, in body axes, metres.
    lever_arm_states : {"known", "estimated"}
        With "estimated", its three errors are states 16 to 18.
    earth_rate : float
        rad/s.
    gravity_gradient : {"include", "omit"}
        The change of gravity with latitude and height. With it the height
        channel diverges by itself, as a free navigator's does.
    tilt, velocity_error, position_error, gyro_bias, accelerometer_bias : float
        What is known beforehand, standard deviations: rad, m/s, m, rad/s, m/s^2;
        for the accelerometers 1e-4 of gravity by default.
    lever_arm_error : float
        The same of the lever arm, m.
    velocity_noise, position_noise : float
        Standard deviations of the antenna's velocity (m/s) and position (m).

    Returns
    -------
    System

    Raises
    ------
    InputError
        A latitude beyond the poles or on one; an attitude that is not a
        rotation; a number that is not finite.

    Notes
    -----
    The exact derivative of the mechanisation
    v' = C f - (2 w_ie + w_en) x v + g, L' = v_N / (R_M + h),
    lambda' = -v_W / ((R_N + h) cos L), h' = v_U, with the tilt phi of the
    computed axes, C^ = (I - [phi x]) C; changes of the radii with latitude are in
    it. See Titterton & Weston, Strapdown Inertial Navigation Technology, ch. 3 and 12.

    Examples
    --------
    >>> import math, gramian as gm
    >>> level = error_model(math.radians(45), velocity=(100.0, 0.0, 0.0))
    >>> gm.linear.levels(level).rank
    12
    """
    latitude, height = _place(latitude, height)
    if accelerometer_bias is None:
        accelerometer_bias = 1e-4 * gravity(latitude, height)
    _positive(
        tilt=tilt,
        velocity_error=velocity_error,
        position_error=position_error,
        gyro_bias=gyro_bias,
        accelerometer_bias=accelerometer_bias,
        lever_arm_error=lever_arm_error,
        velocity_noise=velocity_noise,
        position_noise=position_noise,
    )
    if gravity_gradient not in ("include", "omit"):
        raise InputError(f'gravity_gradient = {gravity_gradient!r}: must be "include" or "omit"')
    if lever_arm_states not in ("known", "estimated"):
        raise InputError(f'lever_arm_states = {lever_arm_states!r}: must be "known" or "estimated"')
    v = _velocity(velocity)
    to_nav = np.eye(3) if attitude is None else finite(attitude, "attitude").copy()
    if to_nav.shape != (3, 3) or not np.allclose(to_nav @ to_nav.T, np.eye(3), atol=1e-9):
        raise InputError("attitude is not a rotation: must be a (3, 3) orthogonal matrix")
    earth = _Earth(latitude, height, earth_rate)
    w_ie, w_en = earth.rotation(), earth.transport(v)
    f = (
        np.cross(2 * w_ie + w_en, v) + np.array([0, 0, gravity(latitude, height)])
        if specific_force is None
        else _vector(specific_force, "specific_force")
    )
    n = 18 if lever_arm_states == "estimated" else 15
    tilts, speeds, places = slice(0, 3), slice(3, 6), slice(6, 9)
    gyros, accelerometers = slice(9, 12), slice(12, 15)

    # The change of w_in with velocity and place.
    by_speed, by_place = earth.transport_by_speed(), earth.transport_by_place(v)
    rotation_by_place = earth.rotation_by_place()

    a = np.zeros((n, n))
    a[tilts, tilts] = -_cross(w_ie + w_en)
    a[tilts, speeds] = by_speed
    a[tilts, places] = rotation_by_place + by_place
    a[tilts, gyros] = -to_nav
    a[speeds, tilts] = _cross(f)
    a[speeds, speeds] = -_cross(2 * w_ie + w_en) + _cross(v) @ by_speed
    a[speeds, places] = _cross(v) @ (2 * rotation_by_place + by_place)
    a[speeds, accelerometers] = to_nav
    if gravity_gradient == "include":
        a[5, 6:9] -= earth.gravity_by_place()
    a[places, speeds], a[places, places] = earth.place_rates(v)

    arm = to_nav @ _vector(lever_arm, "lever_arm")
    w_nb = to_nav @ _vector(angular_rate, "angular_rate")
    c = np.zeros((6, n))
    # Velocity of the antenna, v + C (w_nb x l); w_nb is what the gyros say less
    # what the navigator takes w_in to be.
    c[0:3, speeds] = np.eye(3) + _cross(arm) @ by_speed
    c[0:3, tilts] = _cross(np.cross(w_nb, arm)) - _cross(arm) @ _cross(w_ie + w_en)
    c[0:3, gyros] = -_cross(arm) @ to_nav
    c[0:3, places] = _cross(arm) @ (rotation_by_place + by_place)
    # Its place, p + T C l with T from metres to latitude, longitude, height.
    to_place, by_latitude, by_height = earth.to_place()
    c[3:6, places] = np.eye(3)
    c[3:6, 6] += by_latitude @ arm
    c[3:6, 8] += by_height @ arm
    c[3:6, tilts] = to_place @ _cross(arm)
    if n > 15:
        c[0:3, 15:18] = _cross(w_nb) @ to_nav
        c[3:6, 15:18] = to_place @ to_nav

    metres = np.abs(np.diag(to_place))
    prior = [
        *[tilt] * 3,
        *[velocity_error] * 3,
        *(position_error * metres),
        *[gyro_bias] * 3,
        *[accelerometer_bias] * 3,
        *[lever_arm_error] * (n - 15),
    ]
    return System(
        A=a,
        C=c,
        names=NAMES + (("l_F", "l_L", "l_U") if n > 15 else ()),
        units=UNITS + (("m",) * (n - 15)),
        prior=np.array(prior),
        outputs=OUTPUTS,
        noise=np.concatenate([np.full(3, velocity_noise), position_noise * metres]),
    )


class _Earth:
    """Rates of the navigation axes and their derivatives at one place."""

    def __init__(self, latitude: float, height: float, rate: float) -> None:
        self.rate = number(rate, "earth_rate")
        self.latitude, self.height = latitude, height
        self.sin, self.cos = np.sin(latitude), np.cos(latitude)
        self.tan = self.sin / self.cos
        meridian, normal = radii(latitude)
        self.m, self.n = meridian + height, normal + height
        w2 = 1 - _ECCENTRICITY2 * self.sin**2
        # d R / d latitude
        self.dn = normal * _ECCENTRICITY2 * self.sin * self.cos / w2
        self.dm = 3 * meridian * _ECCENTRICITY2 * self.sin * self.cos / w2

    def rotation(self) -> Array:
        return self.rate * np.array([self.cos, 0.0, self.sin])

    def rotation_by_place(self) -> Array:
        out = np.zeros((3, 3))
        out[:, 0] = self.rate * np.array([-self.sin, 0.0, self.cos])
        return out

    def transport(self, v: Array) -> Array:
        rate: Array = self.transport_by_speed() @ v
        return rate

    def transport_by_speed(self) -> Array:
        return np.array(
            [[0, -1 / self.n, 0], [1 / self.m, 0, 0], [0, -self.tan / self.n, 0]], dtype=float
        )

    def transport_by_place(self, v: Array) -> Array:
        north, west = v[0], v[1]
        n, m, tan = self.n, self.m, self.tan
        by_latitude = [
            west * self.dn / n**2,
            -north * self.dm / m**2,
            -west * (1 / self.cos**2 / n - tan * self.dn / n**2),
        ]
        by_height = [west / n**2, -north / m**2, west * tan / n**2]
        return np.array([by_latitude, [0.0, 0.0, 0.0], by_height]).T

    def gravity_by_place(self) -> Array:
        """Return the derivative of gravity by latitude, longitude and height."""
        s, ds = self.sin**2, 2 * self.sin * self.cos
        w2 = 1 - _ECCENTRICITY2 * s
        ground = _GRAVITY_EQUATOR * (1 + _SOMIGLIANA * s) / np.sqrt(w2)
        by_latitude = (
            ground * ds * (_SOMIGLIANA / (1 + _SOMIGLIANA * s) + _ECCENTRICITY2 / (2 * w2))
        )
        first, second = _free_air(s)
        first_by_latitude = -4 * _FLATTENING / _SEMI_MAJOR * ds
        h = self.height
        return np.array(
            [
                by_latitude * (1 - first * h + second * h**2) - ground * first_by_latitude * h,
                0.0,
                ground * (-first + 2 * second * h),
            ]
        )

    def place_rates(self, v: Array) -> tuple[Array, Array]:
        """Return the derivatives of (L', lambda', h') by velocity and by place."""
        by_speed, by_latitude, by_height = self.to_place()
        by_place = np.zeros((3, 3))
        by_place[:, 0], by_place[:, 2] = by_latitude @ v, by_height @ v
        return by_speed, by_place

    def to_place(self) -> tuple[Array, Array, Array]:
        """Return the matrix from metres N, W, U to latitude, longitude, height.

        And its derivatives by latitude and by height.
        """
        n, m, cos = self.n, self.m, self.cos
        matrix = np.diag([1 / m, -1 / (n * cos), 1.0])
        by_latitude = np.diag([-self.dm / m**2, (self.dn / n - self.tan) / (n * cos), 0.0])
        by_height = np.diag([-1 / m**2, 1 / (n**2 * cos), 0.0])
        return matrix, by_latitude, by_height


@dataclass(frozen=True)
class Leg:
    """A part of a flight with constant rates.

    Attributes
    ----------
    duration : float
        Seconds, > 0.
    turn : float
        By how much the heading changes over the leg, clockwise, radians.
    speed_change : float
        By how much the speed along the heading changes, m/s.
    bank : float
        Roll during the leg, right side down, radians. A coordinated turn banks
        by atan(speed turn rate / g).
    """

    duration: float
    turn: float = 0.0
    speed_change: float = 0.0
    bank: float = 0.0


@dataclass(frozen=True, eq=False)
class Flight:
    """A flight as a piecewise constant error model: what `segments` makes.

    Attributes
    ----------
    system : System
        Names, units, priors and noise; A and C of the first segment.
    A : ndarray, shape (segments, n, n)
    C : ndarray, shape (segments, p, n)
    durations : ndarray, shape (segments,)
    times : ndarray, shape (segments,)
        Beginning of each segment.
    heading, speed, latitude, longitude : ndarray, shape (segments,)
        In its middle; radians and m/s.
    leg : ndarray of int, shape (segments,)
        The leg that each belongs to.
    """

    system: System
    A: Array
    C: Array
    durations: Array
    times: Array
    heading: Array
    speed: Array
    latitude: Array
    longitude: Array
    leg: NDArray[np.int64]

    def upto(self, leg: int) -> Flight:
        """Return the flight up to and with a leg."""
        keep = self.leg <= leg
        return replace(
            self,
            A=self.A[keep],
            C=self.C[keep],
            durations=self.durations[keep],
            times=self.times[keep],
            heading=self.heading[keep],
            speed=self.speed[keep],
            latitude=self.latitude[keep],
            longitude=self.longitude[keep],
            leg=self.leg[keep],
        )

    def piecewise(self, *, rtol: float | None = None) -> Piecewise:
        """Analyse which combinations the flight determines."""
        return piecewise(self.A, self.C, self.durations, self.system.names, rtol=rtol)

    def rows(self, *, dt: float) -> Array:
        """Return whitened rows of samples every `dt`, about the state at the beginning."""
        found = Piecewise(
            self.system.names, (), (), (), (), np.zeros((0, 0)), self.A, self.C, self.durations
        )
        return found.rows(dt=dt, R=self.system.noise**2)


def segments(
    legs: Sequence[Leg],
    latitude: float,
    height: float = 0.0,
    *,
    speed: float = 0.0,
    heading: float = 0.0,
    longitude: float = 0.0,
    step: float = 5.0,
    largest_turn: float = np.radians(3),
    **model: object,
) -> Flight:
    """Put a flight together, level and along its heading, as constant segments.

    Parameters
    ----------
    legs : sequence of Leg
    latitude, height, longitude : float
        Where it begins; radians and metres.
    speed, heading : float
        With which it begins; m/s, and radians clockwise from north.
    step : float
        Longest segment while turning or changing speed, seconds; a leg that does
        neither is one segment.
    largest_turn : float
        Largest change of heading in a segment, radians.
    **model
        What else `error_model` takes: lever_arm, priors, noises.

    Returns
    -------
    Flight

    Raises
    ------
    InputError
        No leg, a duration that is not positive, what `error_model` refuses.

    Examples
    --------
    >>> import math
    >>> quarter = segments([Leg(60.0), Leg(30.0, turn=math.pi / 2)], math.radians(45), speed=50.0)
    >>> quarter.durations.sum(), round(math.degrees(quarter.heading[-1]), 1)
    (np.float64(90.0), 88.5)
    """
    if len(legs) == 0:
        raise InputError("legs is empty: a flight needs one")
    _positive(step=step, largest_turn=largest_turn)
    latitude, height = _place(latitude, height)
    made: list[System] = []
    table = []
    time, place = 0.0, np.array([latitude, longitude])
    for index, leg in enumerate(legs):
        for name in ("duration", "turn", "speed_change", "bank"):
            number(getattr(leg, name), f"legs[{index}].{name}")
        if not leg.duration > 0:
            raise InputError(f"legs[{index}].duration = {leg.duration} s: must be > 0 and finite")
        count = 1
        if leg.turn != 0 or leg.speed_change != 0:
            pieces = max(leg.duration / step, abs(leg.turn) / largest_turn)
            if not pieces <= _MOST_PIECES:
                raise InputError(
                    f"legs[{index}] makes {pieces:.3g} segments, more than {_MOST_PIECES}: "
                    "a shorter leg, or larger `step` and `largest_turn`"
                )
            count = math.ceil(pieces)
        duration = leg.duration / count
        rate, push = leg.turn / leg.duration, leg.speed_change / leg.duration
        for _ in range(count):
            course = heading + rate * duration / 2
            fast = speed + push * duration / 2
            ahead = np.array([np.cos(course), -np.sin(course), 0.0])
            right = np.array([-np.sin(course), -np.cos(course), 0.0])
            v = fast * ahead
            earth = _Earth(place[0], height, float(model.get("earth_rate", EARTH_RATE)))  # type: ignore[arg-type]
            w = 2 * earth.rotation() + earth.transport(v)
            force = (
                push * ahead
                + fast * rate * right
                + np.cross(w, v)
                + np.array([0.0, 0.0, gravity(place[0], height)])
            )
            turned = rotation(course, 0.0, leg.bank)
            made.append(
                error_model(
                    place[0],
                    height,
                    specific_force=force,
                    velocity=v,
                    attitude=turned,
                    angular_rate=turned.T @ [0.0, 0.0, -rate],
                    **model,  # type: ignore[arg-type]
                )
            )
            table.append((duration, time, course, fast, place[0], place[1], index))
            place = place + duration * np.array([v[0] / earth.m, -v[1] / (earth.n * earth.cos)])
            time, heading, speed = (
                time + duration,
                heading + rate * duration,
                speed + push * duration,
            )
    lengths, times, headings, speeds, latitudes, longitudes, owners = np.array(table).T
    return Flight(
        system=made[0],
        A=np.array([s.A for s in made]),
        C=np.array([s.C for s in made]),
        durations=lengths,
        times=times,
        heading=headings,
        speed=speeds,
        latitude=latitudes,
        longitude=longitudes,
        leg=owners.astype(np.int64),
    )


def _place(latitude: float, height: float) -> tuple[float, float]:
    latitude, height = number(latitude, "latitude"), number(height, "height")
    if not abs(latitude) <= np.pi / 2:
        raise InputError(f"latitude = {latitude} rad: must be within -pi/2 and pi/2")
    # Nearer than this, a millimetre, tan L has no digit left that means anything.
    if np.pi / 2 - abs(latitude) < 1e-10:
        raise InputError(
            f"latitude = {latitude} rad is a pole: west and longitude do not exist there (tan L)"
        )
    # Gravity is expanded in the height over the radius: far out it means nothing.
    if not -_SEMI_MAJOR / 2 < height < _SEMI_MAJOR:
        raise InputError(
            f"height = {height} m: must be above the ellipsoid's core and below its radius"
        )
    return latitude, height


def _positive(**values: float) -> None:
    for label, value in values.items():
        if not number(value, label) > 0:
            raise InputError(f"{label} = {value}: must be > 0 and finite")


def _vector(value: ArrayLike, name: str) -> Array:
    array = reals(value, name)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(f"{name} = {value!r}: must be three finite numbers")
    return array


def _velocity(value: ArrayLike) -> Array:
    v = _vector(value, "velocity")
    if not np.abs(v).max() < 1e9:
        raise InputError(f"velocity = {v.tolist()} m/s: must be below 1e9, which is beyond light")
    return v


def _cross(v: Array) -> Array:
    """Return the matrix of v x."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
