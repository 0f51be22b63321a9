"""
A region from the likelihood
============================

A small turn, a far target: the positions that the bearings allow are a crescent that no ellipse
describes. The ellipse of the covariance is drawn beside it.
"""

import numpy as np

import gramian as gm
from gramian.plot import COLORS, ellipse, figure

t = np.arange(0.0, 900.0, 20.0)
leg = np.minimum(t, 450.0)
angle = np.radians(50.0)
path = np.stack([5.0 * (t - leg) * np.sin(angle), 5.0 * (leg + (t - leg) * np.cos(angle))], axis=1)
truth = np.array([3000.0, 7000.0, -3.0, -1.0])
sigma = np.radians(0.7)
measured = gm.bearings.simulate(t, path, truth, sigma, seed=3)
found = gm.bearings.localize(t, measured, path, sigma)
print(found.summary())

region = found.region(("x0", "y0"))
picture = figure(6.4, 5.6)
axes = picture.subplots()
axes.plot(*path.T / 1000, color=COLORS["observer"], label="observer")
for contour in region.contours:
    axes.plot(*contour.T / 1000, color=COLORS["target"], label="allowed at 95 %")
outline = found.state[:2] + ellipse(found.covariance[:2, :2], 0.95)
axes.plot(*outline.T / 1000, "--", color=COLORS["muted"], label="ellipse of the covariance")
axes.plot(*truth[:2] / 1000, "*", color="black", markersize=10, label="truth")
axes.plot(*found.state[:2] / 1000, "o", color=COLORS["target"], label="estimate")
axes.set_xlabel("east (km)")
axes.set_ylabel("north (km)")
axes.set_aspect("equal")
axes.legend(frameon=False, fontsize="small")
