"""
A test for noisy bearings
=========================

Could these bearings be those of an unobservable track? 60 bearings, 20 s apart, of a target at
10 km; the observer turns halfway. Without a turn the test rejects at its level, 5 %.
"""

import numpy as np

import gramian as gm
from gramian.plot import COLORS, figure

LEVEL, TRIALS = 0.05, 2000
t = np.arange(0.0, 1200.0, 20.0)


def exact(turn):
    """Bearings of a target that goes (3, -1) m/s, from an observer at 5 m/s."""
    leg = np.minimum(t, t[t.size // 2])
    east = 5.0 * (t - leg) * np.sin(turn)
    north = 5.0 * (leg + (t - leg) * np.cos(turn))
    return np.arctan2(3.0 * t - east, 1e4 - t - north)


picture = figure()
axes = picture.subplots()
noise = gm.monte_carlo.normals(1, 0, TRIALS, t.size)
turns = np.arange(0.0, 61.0, 10.0)
for sigma in np.radians([0.25, 0.5, 1.0]):
    power = [
        gm.bearings.observability_test(t, exact(turn) + sigma * noise, sigma, LEVEL).rejected.mean()
        for turn in np.radians(turns)
    ]
    print(f"{np.degrees(sigma):g} deg:", *(f"{100 * p:.0f} %" for p in power))
    axes.plot(turns, power, marker="o", markersize=3, label=f"{np.degrees(sigma):g} deg")
axes.axhline(LEVEL, color=COLORS["muted"], linewidth=0.8, linestyle="--")
axes.set_xlabel("turn of the observer (deg)")
axes.set_ylabel("shown observable")
axes.set_ylim(0, 1.02)
axes.legend(title="noise of a bearing", frameon=False)
