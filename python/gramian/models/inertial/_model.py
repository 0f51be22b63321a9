"""Error models: one place and motion, constant coefficients."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._arrays import as_float_array, finite, number
from gramian.exceptions import InputError
from gramian.models.inertial._earth import EARTH_RATE, gravity
from gramian.models.linear._systems import System

__all__ = ["NAMES", "UNITS", "error_model", "positive", "rotation", "static_base", "vector"]

Array = NDArray[np.float64]

#: What is known beforehand by default: tilts of 1 minute of arc, gyro biases of 0.01 deg/h.
TILT = float(np.radians(1 / 60))
GYRO_BIAS = float(np.radians(0.01)) / 3600

#: The states of the error model.
NAMES = (
    "phi_N", "phi_W", "phi_U",
    "dV_N", "dV_W", "dV_U",
    "dL", "dlambda", "dh",
    "eps_N", "eps_W", "eps_U",
    "Delta_N", "Delta_W", "Delta_U",
)  # fmt: skip
#: Their units.
UNITS = (*["rad"] * 3, *["m/s"] * 3, "rad", "rad", "m", *["rad/s"] * 3, *["m/s^2"] * 3)
#: What a navigator at rest determines, in the order of the extension.
AT_REST = (
    "Delta_N - g phi_W",
    "Delta_W + g phi_N",
    "eps_N - w_U phi_W",
    "eps_W + w_U phi_N - w_N phi_U",
    "eps_U + w_N phi_W",
)
OUTPUTS = ("V_N", "V_W", "V_U", "latitude", "longitude", "height")


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
    return _core.inertial_rotation(
        number(heading, "heading"), number(pitch, "pitch"), number(roll, "roll")
    )


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
    latitude, height = number(latitude, "latitude"), number(height, "height")
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
    rows = _core.inertial_combinations_at_rest(latitude, height, earth_rate)
    combinations = dict(zip(AT_REST, rows, strict=True))
    return replace(system, combinations=combinations)


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
    latitude, height = number(latitude, "latitude"), number(height, "height")
    if accelerometer_bias is None:
        accelerometer_bias = 1e-4 * gravity(latitude, height)
    positive(
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
    to_nav = np.eye(3) if attitude is None else finite(attitude, "attitude")
    if to_nav.shape != (3, 3):
        raise InputError("attitude is not a rotation: must be a (3, 3) orthogonal matrix")
    a, c, per_metre = _core.inertial_error_model(
        latitude,
        height,
        None if specific_force is None else vector(specific_force, "specific_force"),
        vector(velocity, "velocity"),
        to_nav,
        vector(angular_rate, "angular_rate"),
        vector(lever_arm, "lever_arm"),
        lever_arm_states == "estimated",
        number(earth_rate, "earth_rate"),
        gravity_gradient == "include",
    )
    n, metres = a.shape[-1], per_metre[0]
    prior = [
        *[tilt] * 3,
        *[velocity_error] * 3,
        *(position_error * metres),
        *[gyro_bias] * 3,
        *[accelerometer_bias] * 3,
        *[lever_arm_error] * (n - 15),
    ]
    return System(
        A=a[0],
        C=c[0],
        names=NAMES + (("l_F", "l_L", "l_U") if n > 15 else ()),
        units=UNITS + (("m",) * (n - 15)),
        prior=np.array(prior),
        outputs=OUTPUTS,
        noise=np.concatenate([np.full(3, velocity_noise), position_noise * metres]),
    )


def positive(**values: float) -> None:
    """Refuse the first that is not above zero and finite."""
    for label, value in values.items():
        if not number(value, label) > 0:
            raise InputError(f"{label} = {value}: must be > 0 and finite")


def vector(value: ArrayLike, name: str) -> Array:
    """Return three finite numbers."""
    array = as_float_array(value, name)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(f"{name} = {value!r}: must be three finite numbers")
    return array
