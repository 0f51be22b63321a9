"""Error models: one place and motion, constant coefficients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import as_float_array, finite, number
from gramian.exceptions import InputError
from gramian.models.inertial._earth import EARTH_RATE, gravity
from gramian.models.linear._systems import System

__all__ = [
    "ESTIMATED",
    "NAMES",
    "OUTPUTS",
    "UNITS",
    "error_model",
    "positive",
    "rotation",
    "static_base",
    "vector",
    "wanted",
]

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


class _Group(NamedTuple):
    """States or outputs that belong together: names, unit, option of their deviation."""

    names: tuple[str, ...]
    unit: str
    option: str


_OFF_DIAGONAL = ("LF", "UF", "UL", "FL", "FU", "LU")

_ESTIMATED = {
    "lever_arm": _Group(("l_F", "l_L", "l_U"), "m", "lever_arm_error"),
    "gyro_scale": _Group(("gyro_scale_F", "gyro_scale_L", "gyro_scale_U"), "1", "gyro_scale_error"),
    "gyro_misalignment": _Group(
        tuple(f"gyro_{pair}" for pair in _OFF_DIAGONAL), "rad", "gyro_misalignment_error"
    ),
    "accelerometer_scale": _Group(
        ("accel_scale_F", "accel_scale_L", "accel_scale_U"), "1", "accelerometer_scale_error"
    ),
    "accelerometer_nonorthogonality": _Group(
        tuple(f"accel_{pair}" for pair in _OFF_DIAGONAL[:3]),
        "rad",
        "accelerometer_misalignment_error",
    ),
    "accelerometer_misalignment": _Group(
        tuple(f"accel_{pair}" for pair in _OFF_DIAGONAL), "rad", "accelerometer_misalignment_error"
    ),
    "g_sensitivity": _Group(
        tuple(f"g_sens_{i}{j}" for i in "FLU" for j in "FLU"), "rad s/m", "g_sensitivity_error"
    ),
    "odometer_scale": _Group(("odo_scale",), "1", "odometer_scale_error"),
    "odometer_mounting": _Group(("odo_pitch", "odo_yaw"), "rad", "odometer_mounting_error"),
    "odometer_arm": _Group(("odo_l_F", "odo_l_L", "odo_l_U"), "m", "odometer_arm_error"),
}

_OUTPUTS = {
    "velocity": _Group(("V_N", "V_W", "V_U"), "m/s", "velocity_noise"),
    "position": _Group(("latitude", "longitude", "height"), "m", "position_noise"),
    "odometer": _Group(("odometer",), "m/s", "odometer_noise"),
    "side_slip": _Group(("slip_L", "slip_U"), "m/s", "side_slip_noise"),
    "zero_velocity": _Group(("zero_V_N", "zero_V_W", "zero_V_U"), "m/s", "zero_velocity_noise"),
    "zero_angular_rate": _Group(
        ("zero_w_F", "zero_w_L", "zero_w_U"), "rad/s", "zero_angular_rate_noise"
    ),
    "heading": _Group(("heading",), "rad", "heading_noise"),
}

#: What `error_model` can estimate beside the 15 states, in the order of the states.
ESTIMATED = tuple(_ESTIMATED)
#: What can be measured, by `error_model`'s `outputs`.
OUTPUTS = tuple(_OUTPUTS)


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
    odometer_arm: ArrayLike = (0.0, 0.0, 0.0),
    estimated: Sequence[str] = (),
    outputs: Sequence[str] = ("velocity", "position"),
    earth_rate: float = EARTH_RATE,
    gravity_gradient: Literal["include", "omit"] = "include",
    tilt: float = TILT,
    velocity_error: float = 0.1,
    position_error: float = 10.0,
    gyro_bias: float = GYRO_BIAS,
    accelerometer_bias: float | None = None,
    lever_arm_error: float = 0.1,
    gyro_scale_error: float = 1e-4,
    gyro_misalignment_error: float = 1e-4,
    accelerometer_scale_error: float = 1e-4,
    accelerometer_misalignment_error: float = 1e-4,
    g_sensitivity_error: float = 5e-9,
    odometer_scale_error: float = 0.01,
    odometer_mounting_error: float = 0.01,
    odometer_arm_error: float = 0.1,
    velocity_noise: float = 0.01,
    position_noise: float = 1.0,
    odometer_noise: float = 0.05,
    side_slip_noise: float = 0.05,
    zero_velocity_noise: float = 0.01,
    zero_angular_rate_noise: float = 1e-5,
    heading_noise: float = 0.005,
) -> System:
    """Return the error model of a navigator beside what aids it.

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
        Of the body against the navigation axes, in body axes, rad/s.
    lever_arm, odometer_arm : array_like, shape (3,)
        From the navigator to the antenna of the receiver and to the wheels of the
        odometer, in body axes, metres.
    estimated : sequence of str
        What is estimated beside the 15 states, in any order:

        - "lever_arm": of the antenna, F, L, U (m);
        - "gyro_scale", "accelerometer_scale": relative, one for each axis;
        - "gyro_misalignment": the six off-diagonal entries of the gyros' matrix,
          `gyro_LF` the reading of L by the rate along F (rad);
        - "accelerometer_misalignment": the same of the accelerometers. With the
          gyros' too, the body axes are in nothing but the lever arms and the odometer:
          a rotation of both triads is a tilt;
        - "accelerometer_nonorthogonality": the lower triangle only (3); the body axes
          are then those of the accelerometers, and all can be estimated together;
        - "g_sensitivity": readings of the gyros by the specific force, 9, by rows
          (rad/s per m/s^2);
        - "odometer_scale" (relative), "odometer_mounting" (pitch and yaw of the wheels'
          axes against the body, rad), "odometer_arm" (m).
    outputs : sequence of str
        What is measured:

        - "velocity", "position": of the antenna;
        - "odometer": the forward speed of the wheels; "side_slip": their speed to
          the left and upwards, which is zero but for `side_slip_noise`;
        - "zero_velocity", "zero_angular_rate": of the navigator itself while it
          stands; in a flight, in the segments below 0.1 m/s;
        - "heading": of the body's forward axis, of a compass or two antennas.
    earth_rate : float
        rad/s.
    gravity_gradient : {"include", "omit"}
        The change of gravity with latitude and height. With it the height
        channel diverges by itself, as a free navigator's does.
    tilt, velocity_error, position_error, gyro_bias, accelerometer_bias : float
        What is known beforehand, standard deviations: rad, m/s, m, rad/s, m/s^2;
        for the accelerometers 1e-4 of gravity by default.
    lever_arm_error, odometer_arm_error : float
        The same of the arms, m.
    gyro_scale_error, accelerometer_scale_error, odometer_scale_error : float
        The same of scale factors, relative.
    gyro_misalignment_error, accelerometer_misalignment_error : float
        The same of each misalignment, rad.
    g_sensitivity_error : float
        rad/s per m/s^2; 5e-9 is 0.01 deg/h per g.
    odometer_mounting_error : float
        rad.
    velocity_noise, position_noise : float
        Standard deviations of the antenna's velocity (m/s) and position (m).
    odometer_noise, side_slip_noise, zero_velocity_noise : float
        m/s.
    zero_angular_rate_noise, heading_noise : float
        rad/s, rad.

    Returns
    -------
    System

    Raises
    ------
    InputError
        A latitude beyond the poles or on one; an attitude that is not a
        rotation; an unknown name, or one twice; the heading of a nose that points up; a
        number that is not finite.

    Notes
    -----
    The exact derivative of the mechanisation
    v' = C f - (2 w_ie + w_en) x v + g, L' = v_N / (R_M + h),
    lambda' = -v_W / ((R_N + h) cos L), h' = v_U, with the tilt phi of the
    computed axes, C^ = (I - [phi x]) C, and readings (I + M) f + bias of the
    accelerometers and (I + M) w + G f + bias of the gyros; changes of the radii with
    latitude are in it. See Titterton & Weston, Strapdown Inertial Navigation
    Technology, ch. 3, 4 and 12.

    Examples
    --------
    >>> import math, gramian as gm
    >>> level = error_model(math.radians(45), velocity=(100.0, 0.0, 0.0))
    >>> gm.linear.levels(level).rank
    12
    >>> error_model(0.8, estimated=["odometer_scale"], outputs=["odometer"]).names[-1]
    'odo_scale'
    """
    latitude, height = number(latitude, "latitude"), number(height, "height")
    if accelerometer_bias is None:
        accelerometer_bias = 1e-4 * gravity(latitude, height)
    deviations = {
        "tilt": tilt,
        "velocity_error": velocity_error,
        "position_error": position_error,
        "gyro_bias": gyro_bias,
        "accelerometer_bias": accelerometer_bias,
        "lever_arm_error": lever_arm_error,
        "gyro_scale_error": gyro_scale_error,
        "gyro_misalignment_error": gyro_misalignment_error,
        "accelerometer_scale_error": accelerometer_scale_error,
        "accelerometer_misalignment_error": accelerometer_misalignment_error,
        "g_sensitivity_error": g_sensitivity_error,
        "odometer_scale_error": odometer_scale_error,
        "odometer_mounting_error": odometer_mounting_error,
        "odometer_arm_error": odometer_arm_error,
        "velocity_noise": velocity_noise,
        "position_noise": position_noise,
        "odometer_noise": odometer_noise,
        "side_slip_noise": side_slip_noise,
        "zero_velocity_noise": zero_velocity_noise,
        "zero_angular_rate_noise": zero_angular_rate_noise,
        "heading_noise": heading_noise,
    }
    positive(**deviations)
    to_nav = np.eye(3) if attitude is None else finite(attitude, "attitude")
    if to_nav.shape != (3, 3):
        raise InputError("attitude is not a rotation: must be a (3, 3) orthogonal matrix")
    asked = wanted(
        {
            "lever_arm": lever_arm,
            "odometer_arm": odometer_arm,
            "estimated": estimated,
            "outputs": outputs,
            "earth_rate": earth_rate,
            "gravity_gradient": gravity_gradient,
        }
    )
    a, c, per_metre = _core.inertial_error_model(
        latitude,
        height,
        None if specific_force is None else vector(specific_force, "specific_force"),
        vector(velocity, "velocity"),
        to_nav,
        vector(angular_rate, "angular_rate"),
        asked,
    )
    metres = per_metre[0]
    states = [_ESTIMATED[name] for name in asked[2]]
    seen = [_OUTPUTS[name] for name in asked[3]]
    prior = [
        *[tilt] * 3,
        *[velocity_error] * 3,
        *(position_error * metres),
        *[gyro_bias] * 3,
        *[accelerometer_bias] * 3,
        *(deviations[group.option] for group in states for _ in group.names),
    ]
    noise = [
        deviations[group.option] * (metres[i] if name == "position" else 1.0)
        for name, group in zip(asked[3], seen, strict=True)
        for i in range(len(group.names))
    ]
    return System(
        A=a[0],
        C=c[0],
        names=NAMES + tuple(name for group in states for name in group.names),
        units=UNITS + tuple(group.unit for group in states for _ in group.names),
        prior=np.array(prior),
        outputs=tuple(name for group in seen for name in group.names),
        noise=np.array(noise),
    )


#: What the extension is asked for: the arms, the groups of states, the outputs, the
#: rate of the Earth, whether gravity changes with the place.
Wanted = tuple[Array, Array, list[str], list[str], float, bool]


def wanted(model: Mapping[str, Any]) -> Wanted:
    """Return what the extension is asked for, of the options of `error_model`."""
    gradient = model.get("gravity_gradient", "include")
    if gradient not in ("include", "omit"):
        raise InputError(f'gravity_gradient = {gradient!r}: must be "include" or "omit"')
    states = _chosen(model.get("estimated", ()), "estimated", ESTIMATED)
    if {"accelerometer_misalignment", "accelerometer_nonorthogonality"} <= set(states):
        raise InputError(
            "estimated has accelerometer_misalignment and accelerometer_nonorthogonality, "
            "which is a part of it: give one"
        )
    seen = _chosen(model.get("outputs", ("velocity", "position")), "outputs", OUTPUTS)
    if not seen:
        raise InputError(f"outputs is empty: must have one or more of {', '.join(OUTPUTS)}")
    return (
        vector(model.get("lever_arm", (0.0, 0.0, 0.0)), "lever_arm"),
        vector(model.get("odometer_arm", (0.0, 0.0, 0.0)), "odometer_arm"),
        states,
        seen,
        number(model.get("earth_rate", EARTH_RATE), "earth_rate"),
        gradient == "include",
    )


def _chosen(given: Any, label: str, known: Sequence[str]) -> list[str]:
    """Return the names given, in the order of those that exist."""
    if isinstance(given, str) or not isinstance(given, (list, tuple)):
        raise InputError(f"{label} = {options.given(given)}: must be a sequence of names")
    for index, name in enumerate(given):
        if not isinstance(name, str) or name not in known:
            raise InputError(
                f"{label}[{index}] = {options.given(name)}: must be one of {', '.join(known)}"
            )
        if name in given[:index]:
            raise InputError(f"{label} has {name!r} twice")
    return [name for name in known if name in given]


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
