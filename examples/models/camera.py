"""
Camera calibration
==================

One view of a plane held square to the axis hides the focal length in the depth; a tilt
separates the two.
"""

import numpy as np

import gramian as gm

NAMES = ["focal", "cx", "cy", "depth", "tilt"]
PLANE = np.stack(np.meshgrid([-0.2, 0.0, 0.2], [-0.1, 0.0, 0.1]), axis=-1).reshape(-1, 2)


def model(tilt):
    def pixels(x):
        focal, cx, cy, depth, turn = x
        u, v = PLANE.T
        z = depth + u * np.sin(turn)
        return np.concatenate([cx + focal * u * np.cos(turn) / z, cy + focal * v / z])

    units = ["px", "px", "px", "m", "rad"]
    return gm.from_function(pixels, [800.0, 320.0, 240.0, 1.5, tilt], 0.3, NAMES, units=units)


if __name__ == "__main__":
    square = gm.analyze(model(0.0))
    print(square.summary())
    print(gm.analyze(model(0.6)).summary())
    picture = square.plot()
