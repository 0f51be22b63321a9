"""A camera beside a navigator: rows along its motion, by the extension."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import finite, whole
from gramian.exceptions import InputError
from gramian.models.dynamics._trajectory import MOST_STEPS, Trajectory, unit_norm

__all__ = ["visual_inertial"]

Array = NDArray[np.float64]

#: What may be unknown beside the core, in the order of the states: names and units.
UNKNOWN = {
    "camera_rotation": (("turn_x", "turn_y", "turn_z"), "rad"),
    "camera_arm": (("arm_x", "arm_y", "arm_z"), "m"),
    "gravity": (("g_x", "g_y", "g_z"), "m/s^2"),
    "gravity_strength": (("g",), "m/s^2"),
    "scale": (("scale",), "1"),
    "landmarks": ((), "m"),
}
CORE = (
    *(f"p_{i}" for i in "xyz"),
    *(f"q_{i}" for i in "wxyz"),
    *(f"v_{i}" for i in "xyz"),
    *(f"gyro_{i}" for i in "xyz"),
    *(f"accel_{i}" for i in "xyz"),
)
CORE_UNITS = (*["m"] * 3, *["1"] * 4, *["m/s"] * 3, *["rad/s"] * 3, *["m/s^2"] * 3)
#: A typical move of each state of the core.
CORE_MOVES = (*[1.0] * 3, *[1.0] * 4, *[1.0] * 3, *[0.01] * 3, *[0.1] * 3)
#: A camera that looks along the first axis of the body, forward: right, down, forward.
FORWARD = ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))


def visual_inertial(
    times: ArrayLike,
    gyro: ArrayLike,
    accel: ArrayLike,
    landmarks: ArrayLike,
    *,
    velocity: ArrayLike,
    position: ArrayLike = (0.0, 0.0, 0.0),
    attitude: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    camera: ArrayLike = FORWARD,
    arm: ArrayLike = (0.0, 0.0, 0.0),
    gravity: ArrayLike = (0.0, 0.0, -9.80665),
    unknown: Sequence[str] = ("camera_rotation", "camera_arm", "gravity_strength", "landmarks"),
    sigma: ArrayLike = 1e-3,
    rtol: float = 1e-9,
    max_steps: int = MOST_STEPS,
) -> Trajectory:
    """Follow a camera beside an inertial navigator past landmarks.

    What the images tell is then a question to the trajectory: `windows`, `problem`,
    `posterior`.

    Parameters
    ----------
    times : array_like, shape (K,)
        s, increasing. At each there is an image, and a sample of the sensors that holds
        until the next.
    gyro, accel : array_like, shape (K, 3)
        Angular rate, rad/s, and specific force, m/s^2, in body axes: what the sensors
        measure while their biases are zero.
    landmarks : array_like, shape (m, 3)
        World axes, m.
    velocity, position : array_like, shape (3,)
        At the first time, world axes.
    attitude : array_like, shape (4,)
        The unit quaternion (w, x, y, z) from body to world at the first time.
    camera : array_like, shape (3, 3)
        The matrix from body to camera axes, of which the third looks ahead; by default
        right, down, forward of a body with its axes forward, left, up.
    arm : array_like, shape (3,)
        Of the camera, body axes, m.
    gravity : array_like, shape (3,)
        Its acceleration, world axes, m/s^2.
    unknown : sequence of str
        States beside position, attitude, velocity and the biases of gyros and
        accelerometers: "camera_rotation" (3), "camera_arm" (3), "gravity" (3) or its
        strength alone, "gravity_strength" (1), "landmarks" (3 m), "scale" (1) of a map
        that is known but for it.
    sigma : array_like, shape () or (2 m,)
        Of the image coordinates over the focal length; two for each landmark.
    rtol, max_steps
        As for `gramian.dynamics.from_ode`.

    Returns
    -------
    gramian.dynamics.Trajectory
        With the tangent of the unit quaternion.

    Raises
    ------
    InputError
        Shapes that do not fit, a landmark that comes to lie behind the camera.

    Notes
    -----
    Known of one camera (Kelly & Sukhatme 2011, Int. J. Robotics Research 30; Hesch et al.
    2014, ibid. 33): in general motion past unknown landmarks four directions are not
    determined, the position and the turn about gravity; the mounting of the camera, the
    biases and the strength of gravity are. Unknown in direction, gravity adds two. Without
    rotation neither the arm of the camera nor the whole attitude is found, and with constant
    acceleration not the scale (Wu et al. 2017, IEEE ICRA; Yang et al. 2019, IEEE Robotics and
    Automation Letters 4): there it is the strength of gravity that goes with it.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.linspace(0, 1.5, 31)
    >>> gyro = np.stack([np.cos(4 * t), np.cos(5 * t), np.cos(6 * t)], axis=1)
    >>> swing = np.stack([np.sin(5.1 * t), np.sin(4.3 * t + 1), np.sin(6.6 * t + 2)], axis=1)
    >>> marks = [[9, 2, 1], [12, -3, 1], [10, 2, -3], [14, -1, -2], [11, 4, 3]]
    >>> path = visual_inertial(t, gyro, 3 * swing + [0, 0, 9.8], marks, velocity=[0, 0.2, 0.1])
    >>> found = path.windows(1.5)
    >>> found.free - int(found.rank[0])
    4
    """
    at = np.atleast_1d(finite(times, "times [s]"))
    if at.ndim != 1 or len(at) < 2:
        raise InputError(f"times has shape {at.shape}: must be (K,) with K >= 2")
    rows = {"gyro [rad/s]": gyro, "accel [m/s^2]": accel}
    samples = {name: finite(value, name) for name, value in rows.items()}
    for name, value in samples.items():
        if value.shape != (len(at), 3):
            raise InputError(
                f"{name.split()[0]} has shape {value.shape}: must be ({len(at)}, 3), as times"
            )
    marks = finite(landmarks, "landmarks [m]")
    if marks.ndim != 2 or marks.shape[1] != 3 or not len(marks):
        raise InputError(f"landmarks has shape {marks.shape}: must be (m, 3) with m >= 1")
    asked = options.sequence(unknown, "unknown", "a sequence of names")
    for name in asked:
        options.choice(name, "unknown", tuple(UNKNOWN))
    if {"gravity", "gravity_strength"} <= set(asked) or len(set(asked)) < len(asked):
        raise InputError(
            f"unknown = {options.given(unknown)}: must name each group once, and of gravity and "
            "gravity_strength one"
        )
    chosen = [name for name in UNKNOWN if name in asked]
    parts = {
        "position": (position, (3,)),
        "attitude": (attitude, (4,)),
        "velocity": (velocity, (3,)),
        "camera": (camera, (3, 3)),
        "arm": (arm, (3,)),
        "gravity": (gravity, (3,)),
    }
    given = {name: finite(value, name) for name, (value, _) in parts.items()}
    for name, (_, shape) in parts.items():
        if given[name].shape != shape:
            raise InputError(f"{name} has shape {given[name].shape}: must be {shape}")
    names, units, moves = list(CORE), list(CORE_UNITS), list(CORE_MOVES)
    for name in chosen:
        labels, unit = UNKNOWN[name]
        if name == "landmarks":
            labels = tuple(f"landmark{k}_{i}" for k in range(len(marks)) for i in "xyz")
        names += labels
        units += [unit] * len(labels)
        moves += [0.1 if unit == "rad" else 1.0] * len(labels)
    noise = finite(sigma, "sigma")
    if noise.shape not in {(), (1,), (2 * len(marks),)}:
        raise InputError(
            f"sigma has shape {noise.shape}: must be one number or ({2 * len(marks)},)"
        )
    deviations = np.broadcast_to(noise, (2 * len(marks),)).copy()
    if (bad := np.flatnonzero(~(deviations > 0))).size:
        raise InputError(f"sigma[{bad[0]}] = {deviations[bad[0]]}: must be > 0")
    _, found = _core.inertial_visual(
        at.tolist(),
        samples["gyro [rad/s]"].ravel().tolist(),
        samples["accel [m/s^2]"].ravel().tolist(),
        marks.ravel().tolist(),
        np.concatenate([given[k].ravel() for k in ("camera", "arm", "gravity")]).tolist(),
        np.concatenate([given[k] for k in ("position", "attitude", "velocity")]).tolist(),
        chosen,
        options.fraction(rtol, "rtol"),
        whole(max_steps, "max_steps", 1),
    )
    states, outputs, transitions, jacobians, changes, errors, steps = found
    free = unit_norm([3, 4, 5, 6])
    return Trajectory(
        names=tuple(names),
        units=tuple(units),
        times=at,
        states=states,
        outputs=outputs,
        transitions=transitions,
        jacobians=jacobians,
        transition_changes=changes,
        jacobian_errors=errors,
        sigma=deviations,
        scale=np.array(moves),
        tangent=np.array([free(x) for x in states]),
        steps=steps,
        vectorized=(),
    )
