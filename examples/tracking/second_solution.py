"""
A second solution
=================

Ranges to three beacons that stand nearly in line: a place on the other side fits almost as well,
which no covariance shows. The map is the misfit, in standard deviations.
"""

import numpy as np

import gramian as gm
from gramian.plot import COLORS, figure

BEACONS = np.array([[0.0, 0.0], [50.0, 1.0], [100.0, -1.0]])


def ranges(x):
    return np.hypot(x[0] - BEACONS[:, 0], x[1] - BEACONS[:, 1])


truth = np.array([40.0, 30.0])
model = gm.from_function(ranges, truth, 0.5, ["east", "north"], units=["m", "m"], scale=[50, 50])
for other in gm.other_solutions(model, truth):
    print(other)
print(gm.estimate(model, ranges(truth)).status)

east, north = np.meshgrid(np.linspace(-10, 110, 241), np.linspace(-60, 60, 241))
each = np.hypot(east[..., None] - BEACONS[:, 0], north[..., None] - BEACONS[:, 1])
misfit = np.linalg.norm((each - ranges(truth)) / 0.5, axis=-1)
picture = figure(6.8, 5.0)
axes = picture.subplots()
filled = axes.contourf(east, north, np.minimum(misfit, 20), 20, cmap="viridis_r")
picture.colorbar(filled, label="misfit (standard deviations)")
axes.plot(*BEACONS.T, "^", color=COLORS["observer"], label="beacons")
axes.plot(*truth, "*", color="white", markersize=12, label="truth")
for other in gm.other_solutions(model, truth):
    axes.plot(*other.state, "X", color=COLORS["bad"], markersize=10, label="second solution")
axes.set_xlabel("east (m)")
axes.set_ylabel("north (m)")
axes.legend(fontsize="small")
