"""
Hand-eye calibration
====================

The pose of a camera on a hand: turns about one axis leave the offset along it open, turns
about a second axis determine it.
"""

import numpy as np
from scipy.spatial.transform import Rotation

import gramian as gm

NAMES = ["rx", "ry", "rz", "tx", "ty", "tz"]
UNITS = ["rad"] * 3 + ["m"] * 3
X = [0.1, -0.2, 0.3, 0.05, 0.02, 0.1]


def model(axes):
    """Motions of the hand about `axes`, and what the eye sees of them: X^-1 A X."""
    turns = Rotation.from_rotvec(np.asarray(axes))
    moves = np.array([[0.1, 0.2, 0.0], [0.0, -0.1, 0.3], [0.2, 0.0, 0.1]])[: len(axes)]

    def seen(x):
        eye, offset = Rotation.from_rotvec(x[:3]), x[3:]
        rotation = (eye.inv() * turns * eye).as_rotvec()
        shift = eye.inv().apply(turns.apply(offset) + moves - offset)
        return np.concatenate([rotation.ravel() / 1e-3, shift.ravel() / 1e-3])

    return gm.from_function(seen, X, 1.0, NAMES, units=UNITS)


if __name__ == "__main__":
    one_axis = gm.analyze(model([[0, 0, 0.5], [0, 0, -0.8]]))
    print(one_axis.summary())
    print(gm.analyze(model([[0, 0, 0.5], [0.6, 0, 0]])).summary())
    picture = one_axis.plot()
