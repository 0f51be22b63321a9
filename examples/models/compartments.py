"""
Two compartments
================

A drug in two compartments, solved by an adaptive integrator. Of volume and dose only the
ratio is determined, and the errors of the solver are not taken for information.
"""

import numpy as np
from scipy.integrate import solve_ivp

import gramian as gm

NAMES = ["k12", "k21", "ke", "volume", "dose"]
UNITS = ["1/h", "1/h", "1/h", "l", "mg"]


def model(rtol=1e-6):
    def concentration(p):
        k12, k21, ke, volume, dose = p
        solution = solve_ivp(
            lambda _, a: [-(k12 + ke) * a[0] + k21 * a[1], k12 * a[0] - k21 * a[1]],
            (0, 8),
            [dose, 0],
            rtol=rtol,
            atol=1e-3 * rtol,
            t_eval=np.linspace(0.5, 8, 8),
        )
        return solution.y[0] / volume

    return gm.from_function(concentration, [0.5, 0.3, 0.2, 5.0, 100.0], 0.01, NAMES, units=UNITS)


if __name__ == "__main__":
    answer = gm.analyze(model())
    print(answer.summary())
    print(gm.analyze(model().problem().fix("dose")).summary())
    picture = answer.plot()
