"""
Where should the observer go?
=============================

40 bearings, 20 m apart, of a fixed target that must not be approached below 800 m. The plan goes in
to the stand-off range and then round; the greedy laws are behind it.
"""

import numpy as np

import gramian as gm
from gramian.models.maneuver.plot import paths

plan = gm.maneuver.plan(
    [0.0, 1000.0], [0.0, 0.0], speed=20.0, dt=1.0, samples=40, sigma=np.sqrt(0.001), standoff=800.0
)
print(plan.message, f"log det J = {plan.value:.3f}")
for law in plan.laws:
    print(f"{law.law:14} {law.value:.3f}")
picture = paths(plan)
