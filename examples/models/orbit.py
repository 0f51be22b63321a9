"""
Orbit from ranges
=================

A satellite in a circular orbit, seen from one station in its plane, by Kepler's law: ten
minutes of ranges give radius and phase.
"""

import numpy as np

import gramian as gm

MU = 3.986004418e14  # m^3/s^2
STATION = np.array([6.371e6, 0.0])
NAMES = ["radius", "phase"]


def model(span=600.0):
    times = np.linspace(0, span, 30)

    def ranges(x):
        angle = x[1] + np.sqrt(MU / x[0] ** 3) * times
        return np.hypot(*(x[0] * np.array([np.cos(angle), np.sin(angle)]) - STATION[:, None]))

    return gm.from_function(
        ranges, [7.0e6, -0.3], 10.0, NAMES, units=["m", "rad"], scale=[1e4, 0.01]
    )


if __name__ == "__main__":
    answer = gm.analyze(model())
    print(answer.summary())
    picture = answer.plot()
