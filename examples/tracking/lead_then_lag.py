"""
A moving target needs a turn
============================

Of a target at constant velocity one straight leg never tells the range. With two legs the turn is
found, near the middle: lead, then lag.
"""

import numpy as np

import gramian as gm
from gramian.models.maneuver.plot import paths

options = {"speed": 20.0, "dt": 1.0, "samples": 40, "sigma": np.radians(0.5), "standoff": 320.0}
target = [0.0, 400.0, -5.0, 5.0]
try:
    gm.maneuver.plan(target, [0.0, 0.0], legs=1, **options)
except gm.UnobservableError as error:
    print(error)
plan = gm.maneuver.plan(target, [0.0, 0.0], legs=2, **options)
print("two legs, bounds:", plan.crlb_std[0].round(3), "turns at bearing", plan.turns)
picture = paths(plan)
