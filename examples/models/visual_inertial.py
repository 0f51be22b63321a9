"""
Visual-inertial
===============

Landmarks from a moving carrier whose roll and pitch are known: yaw and origin stay open, also
at coordinates of 5000 km.
"""

import numpy as np

import gramian as gm

TURNS = 0.3 * np.arange(4)


def model(offset=0.0):
    rng = np.random.default_rng(1)
    landmarks, steps = rng.uniform(-20, 20, (6, 3)), rng.uniform(-5, 5, (4, 3))
    names = ["x", "y", "z", "yaw"] + [f"{axis}{k}" for k in range(6) for axis in "xyz"]

    def seen(x):
        points, out = x[4:].reshape(6, 3), []
        for turn, step in zip(TURNS, steps, strict=True):
            for angle, back in ((x[3] + turn, False), (x[3], True)):
                c, s = np.cos(angle), np.sin(angle)
                if back:
                    moved = np.array(
                        [c * step[0] - s * step[1], s * step[0] + c * step[1], step[2]]
                    )
                else:
                    view = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
            out.append((points - x[:3] - moved) @ view.T)
        return np.concatenate([part.ravel() for part in out])

    x = np.concatenate([np.full(3, offset), [0.2], (landmarks + offset).ravel()])
    return gm.from_function(seen, x, 0.01, names)


if __name__ == "__main__":
    answer = gm.analyze(model())
    print(answer.rank, answer.nullity, answer.suggestions[0].name)
    picture = answer.plot()
