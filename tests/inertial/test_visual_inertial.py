"""Camera beside a navigator: known unobservable directions, with unknown extrinsics."""

import numpy as np
import pytest

import gramian as gm

GRAVITY = 9.81
#: Of 41 states the norm of the quaternion is not free.
FREE = 40
LANDMARKS = np.array(
    [[1.0, 2, 9], [-3, 1, 12], [2, -3, 10], [-1, -2, 14], [4, 3, 11], [-4, 3, 8]]
).T
NAMES = [
    *(f"p_{i}" for i in "xyz"),
    *(f"q_{i}" for i in "wxyz"),
    *(f"v_{i}" for i in "xyz"),
    *(f"gyro_{i}" for i in "xyz"),
    *(f"accel_{i}" for i in "xyz"),
    *(f"turn_{i}" for i in "xyz"),
    *(f"arm_{i}" for i in "xyz"),
    "g",
    *(f"landmark{k}_{i}" for k in range(6) for i in "xyz"),
]


def cross(a, b):
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def rotated(q, a):
    """Return the vector a of the body in the axes of the world."""
    w, u = q[0], q[1:]
    return a + 2 * cross(u, w * a + cross(u, a)) + 0 * w


def trajectory(rate, force):
    """Follow a camera with inputs: measured angular rate and specific force, functions of t."""

    def f(t, x):
        q, bias = x[3:7], x[10:16]
        w = rate(t).reshape(3, -1) - bias[:3]
        a = force(t).reshape(3, -1) - bias[3:]
        turning = 0.5 * np.concatenate(
            [-(q[1:] * w).sum(axis=0, keepdims=True), q[:1] * w + cross(q[1:], w)]
        )
        acceleration = rotated(q, a)
        acceleration[2] = acceleration[2] - x[22]
        return np.concatenate([x[7:10], turning, acceleration, 0 * x[10:]])

    def h(t, x):
        q, seen = x[3:7], []
        back = np.concatenate([q[:1], -q[1:]])
        for k in range(6):
            inside = rotated(back, x[23 + 3 * k : 26 + 3 * k] - x[:3]) - x[19:22]
            inside = inside + cross(x[16:19], inside)
            seen += [inside[0] / inside[2], inside[1] / inside[2]]
        return np.stack(seen)

    start = np.zeros(41)
    start[3], start[22] = 1.0, GRAVITY
    start[7:10] = [0.5, 0.2, 0.1]
    start[19:22] = [0.1, 0.05, -0.02]
    start[23:] = LANDMARKS.T.ravel()
    return gm.dynamics.from_ode(
        f, h, start, np.linspace(0, 1.5, 13), NAMES, sigma=1e-3, vectorized=True,
        tangent=gm.dynamics.unit_norm([3, 4, 5, 6]),
    )  # fmt: skip


def level(t):
    return np.stack([0 * t, 0 * t, 0 * t + GRAVITY])


def test_general_motion_leaves_place_and_yaw():
    # Kelly & Sukhatme 2011; Hesch et al. 2014: the place of the origin and a turn about gravity.
    # Extrinsics, biases and the strength of gravity, which is the scale, are found.
    answer = trajectory(turning, pushed).windows(1.5)
    assert int(answer.rank[0]) == FREE - 4


def turning(t):
    return np.stack([0.6 * np.cos(4 * t), 0.7 * np.cos(5 * t), 0.8 * np.cos(6 * t)])


def pushed(t):
    swing = [3 * np.sin(5.1 * t), 3 * np.sin(4.3 * t + 1), 3 * np.sin(6.6 * t + 2)]
    return level(t) + np.stack(swing)


def constant(t):
    return level(t) + np.stack([0.7 + 0 * t, 0.5 + 0 * t, 0.3 + 0 * t])


@pytest.mark.parametrize("force", [level, constant, pushed])
def test_motion_without_rotation_leaves_more(force):
    # Wu et al. 2017 (VINS on wheels): without rotation all of the global orientation, with
    # constant acceleration the scale too; Yang et al. 2019: and the arm of the camera.
    answer = trajectory(lambda t: 0 * level(t), force).windows(1.5)
    least = 4 + 2 + 3 + (0 if force is pushed else 1)
    assert answer.rank[0] <= FREE - least
