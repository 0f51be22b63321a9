"""
Power grid
==========

Angles of five buses from flows and one phasor. Without the phasor all angles shift together;
with it one line is still critical: if its meter fails, a bus is lost.
"""

import numpy as np

import gramian as gm

LINES = [(0, 1), (1, 2), (2, 3), (3, 0), (3, 4)]
SUSCEPTANCE = np.array([10.0, 8.0, 12.0, 9.0, 5.0])


def model(*, phasor=True):
    def flows(angle):
        out = [
            b * np.sin(angle[i] - angle[j]) for (i, j), b in zip(LINES, SUSCEPTANCE, strict=True)
        ]
        return [*out, angle[0]] if phasor else out

    x = [0.0, -0.02, -0.05, -0.03, -0.08]
    return gm.from_function(flows, x, 0.01, [f"angle {i}" for i in range(5)], units=["rad"] * 5)


if __name__ == "__main__":
    free = gm.analyze(model(phasor=False))
    print(free.summary())
    answer = gm.analyze(model())
    print(answer.summary())
    for one in answer.critical():
        print(one.name, one.nullity, one.growth)
    picture = free.plot()
