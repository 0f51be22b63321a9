"""
Laws in the closed loop
=======================

An observer that does not know where the target is: it takes a bearing, estimates, chooses a heading
by the estimate, moves. One bearing in five is lost. What matters is the error at the end.
"""

import numpy as np

import gramian as gm
from gramian.models.maneuver.plot import errors

loop = gm.maneuver.closed_loop(
    [0.0, 1000.0],
    [0.0, 0.0],
    20.0,
    1.0,
    60,
    sigma=0.02,
    first_range=(1500.0, 500.0),
    lost=0.2,
    standoff=300.0,
    trials=300,
    seed=1,
)
for run in loop.runs:
    print(f"{run.method:14} final error {np.sqrt((run.errors[:, -1] ** 2).mean()):.1f} m")
picture = errors(loop)
