"""Camera beside a navigator: known unobservable directions, with unknown extrinsics."""

import numpy as np
import pytest

import gramian as gm
from gramian.models.inertial import visual_inertial

GRAVITY = 9.81
TIMES = np.linspace(0, 1.5, 31)
LANDMARKS = np.array([[9.0, 1, 2], [12, -3, 1], [10, 2, -3], [14, -1, -2], [11, 4, 3], [8, -4, 3]])
DOWN = np.array([0, 0, -GRAVITY])
MOUNTING = ("camera_rotation", "camera_arm", "gravity_strength")


def turning(t):
    return np.stack([0.6 * np.cos(4 * t), 0.7 * np.cos(5 * t), 0.8 * np.cos(6 * t)], axis=-1)


def still(t):
    return np.zeros((*np.shape(t), 3))


def pushed(t):
    swing = [3 * np.sin(5.1 * t), 3 * np.sin(4.3 * t + 1), 3 * np.sin(6.6 * t + 2)]
    return np.stack(swing, axis=-1) - DOWN


def constant(t):
    return np.array([0.7, 0.5, 0.3]) - DOWN + still(t)


def level(t):
    return still(t) - DOWN


def flight(gyro, accel, unknown=(*MOUNTING, "landmarks"), **options):
    given = {"velocity": [0.5, 0.2, 0.1], "arm": [0.1, 0.05, -0.02], "gravity": DOWN} | options
    return visual_inertial(TIMES, gyro(TIMES), accel(TIMES), LANDMARKS, unknown=unknown, **given)


def lost(path):
    found = path.windows(1.5)
    answer = gm.analyze(path.problem())
    # A window and the problem of the whole path answer alike.
    assert answer.nullity == found.free - found.rank[0]
    return answer.nullity


def test_general_motion_leaves_place_and_yaw():
    # Kelly & Sukhatme 2011; Hesch et al. 2014: the place of the origin and a turn about gravity.
    # Extrinsics, biases and the strength of gravity, which is the scale, are found.
    path = flight(turning, pushed)
    assert lost(path) == 4
    found = path.windows(1.5)
    free, _ = np.linalg.qr(found.null_spaces[0])
    names = list(path.names)
    moves = np.zeros((len(names), 4))
    for k, axis in enumerate(np.eye(3)):
        moves[:3, k] = axis
        moves[names.index("landmark0_x") :, k] = np.tile(axis, len(LANDMARKS))
    # About the vertical: the attitude at the beginning is the unit quaternion.
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])
    moves[names.index("q_z"), 3] = 0.5
    moves[7:10, 3] = turn @ [0.5, 0.2, 0.1]
    moves[names.index("landmark0_x") :, 3] = (LANDMARKS @ turn.T).ravel()
    away = moves - free @ (free.T @ moves)
    assert np.abs(away).max() < 1e-5 * np.abs(moves).max()


def test_gravity_of_unknown_direction_leaves_the_whole_attitude():
    # Martinelli 2012; Hesch et al. 2014: nothing tells the axes of the world from one another.
    unknown = ("camera_rotation", "camera_arm", "gravity", "landmarks")
    assert lost(flight(turning, pushed, unknown)) == 6


def test_the_scale_of_a_map_gravity_and_mounting_are_found():
    # Weiss et al. 2012; Kelly & Sukhatme 2011: a map that is known but for its scale.
    unknown = ("camera_rotation", "camera_arm", "gravity", "scale")
    assert lost(flight(turning, pushed, unknown)) == 0
    # Nothing accelerates: of the scale nothing is known.
    assert "scale" in "".join(
        gm.analyze(flight(still, level, ("scale",)).problem()).null_combinations
    )
    # Beside landmarks that are unknown it is one more way to say the same.
    assert lost(flight(turning, pushed, (*MOUNTING, "scale", "landmarks"))) == 5


@pytest.mark.parametrize("force", [level, constant, pushed])
def test_motion_without_rotation_leaves_more(force):
    # Wu et al. 2017 (VINS on wheels): without rotation all of the global orientation, with
    # constant acceleration the scale too; Yang et al. 2019: and the arm of the camera.
    least = 4 + 2 + 3 + (0 if force is pushed else 1)
    assert lost(flight(still, force)) >= least


def test_constant_acceleration_loses_the_scale_and_no_rotation_the_attitude():
    # Wu et al. 2017 for a calibrated camera and known gravity: 4 in general motion, 5 with
    # constant acceleration in body axes, 6 without rotation.
    known = ("landmarks",)
    assert lost(flight(turning, pushed, known)) == 4
    assert lost(flight(still, pushed, known)) == 6
    assert lost(flight(still, constant, known)) == 7


def rotated(q, a):
    w, u = q[0], q[1:]
    return a + 2 * np.cross(u, w * a + np.cross(u, a))


def test_it_is_what_the_same_functions_in_python_give():
    unknown = ("camera_rotation", "camera_arm", "gravity", "landmarks")
    path = flight(turning, pushed, unknown)
    camera = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    gyro, accel = turning(TIMES), pushed(TIMES)

    def f(t, x):
        k = np.searchsorted(TIMES, t, side="right") - 1
        w, a, q = gyro[k] - x[10:13], accel[k] - x[13:16], x[3:7]
        dq = 0.5 * np.concatenate([[-(q[1:] @ w)], q[0] * w + np.cross(q[1:], w)])
        return np.concatenate([x[7:10], dq, rotated(q, a) + x[22:25], 0 * x[10:]])

    def h(t, x):
        back = np.concatenate([x[3:4], -x[4:7]])
        seen = []
        for mark in x[25:].reshape(-1, 3):
            inside = rotated(back, mark - x[:3]) - x[19:22]
            c = camera @ (inside + np.cross(x[16:19], inside))
            seen += [c[0] / c[2], c[1] / c[2]]
        return np.array(seen)

    own = gm.dynamics.from_ode(f, h, path.states[0], TIMES[:6], path.names, sigma=1e-3)
    assert np.allclose(own.states, path.states[:6], atol=1e-9)
    assert np.allclose(own.outputs, path.outputs[:6], atol=1e-10)
    assert np.allclose(own.transitions, path.transitions[:5], atol=1e-8)
    assert np.allclose(own.jacobians, path.jacobians[:6], atol=1e-9)


MARKS = [[9.0, 1, 2]]
BAD = [
    ({"times": [0.0, 0.0]}, r"times\[1\] = 0.0 s: must be later"),
    ({"times": [0.0]}, "times has shape"),
    ({"gyro": [[0, 0, 0]]}, r"gyro has shape \(1, 3\): must be \(2, 3\)"),
    ({"accel": [[0, 0, np.nan]] * 2}, "accel"),
    ({"landmarks": [1.0, 2.0, 3.0]}, "landmarks has shape"),
    ({"landmarks": [[-9.0, 0, 0]]}, r"landmarks\[0\] is not in front of the camera at t = 0"),
    ({"attitude": [1.0, 1, 0, 0]}, "attitude"),
    ({"camera": np.ones((3, 3))}, "attitude is not a rotation|camera"),
    ({"unknown": ["range"]}, "unknown = 'range'"),
    ({"unknown": ["gravity", "gravity_strength"]}, "of gravity and"),
    ({"sigma": 0.0}, r"sigma\[0\] = 0.0: must be > 0"),
    ({"sigma": [1.0, 1.0, 1.0]}, "sigma has shape"),
]


@pytest.mark.parametrize(("changed", "message"), BAD)
def test_bad_input_is_named(changed, message):
    given = {
        "times": [0.0, 0.1],
        "gyro": np.zeros((2, 3)),
        "accel": np.zeros((2, 3)),
        "landmarks": MARKS,
        "velocity": [0.0, 0, 0],
    } | changed
    positional = [given.pop(name) for name in ("times", "gyro", "accel", "landmarks")]
    with pytest.raises(gm.InputError, match=message):
        visual_inertial(*positional, **given)
