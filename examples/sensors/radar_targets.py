"""
Which targets to use
====================

Four aircraft that two radars both see. Poor ones may be good together: each choice is the one that
adds most to those before.
"""

import numpy as np

import gramian as gm
from gramian.models.registration.plot import geometry

sensors = {"A": np.array([0.0, 0.0]), "B": np.array([60e3, 0.0])}
sigma = (50.0, np.radians(0.1))
t = np.arange(0.0, 200.0)[:, None]
crowd = {
    "parallel": np.array([-20e3, 25e3]) + t * [400.0, 0.0],
    "bisector": np.array([30e3, 60e3]) + t * [0.0, -250.0],
    "far": np.array([90e3, 100e3]) + t * [50.0, 200.0],
    "baseline": np.array([6e3, 0.0]) + t * [240.0, 0.0],
}
choice = gm.registration.select(crowd, sensors, sigma, 2)
print(choice.chosen)
print(gm.analyze(gm.registration.problem(crowd["baseline"], sensors, sigma)).null_combinations)
picture = geometry(sensors, crowd, chosen=choice.chosen)
