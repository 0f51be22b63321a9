"""
GNSS with clock
===============

Position and clock of a receiver from four pseudoranges, and from three: then one combination
stays open.
"""

import numpy as np

import gramian as gm

SATELLITES = np.array(  # m, Earth-centred
    [
        [15600e3, 7540e3, 20140e3],
        [18760e3, 2750e3, 18610e3],
        [17610e3, 14630e3, 13480e3],
        [19170e3, 610e3, 18390e3],
    ]
)
RECEIVER = [-41.8, -16.8, 6370059.6]  # m


def model(satellites=SATELLITES):
    def pseudoranges(x):
        return np.linalg.norm(satellites - x[:3], axis=1) + x[3]

    return gm.from_function(
        pseudoranges,
        [*RECEIVER, 0.0],
        3.0,
        ["x", "y", "z", "clock"],
        units=["m"] * 4,
        scale=[1e4] * 4,
    )


if __name__ == "__main__":
    print(gm.analyze(model()).summary())
    three = gm.analyze(model(SATELLITES[:3]))
    print(three.summary())
    picture = three.plot()
