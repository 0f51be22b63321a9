"""
The same bearings from many tracks
==================================

An observer on a straight line: tracks at half, one and 1.4 times the range, each with its own
velocity, have all bearings in common. Once the observer turns only one of them still fits.
"""

import numpy as np

import gramian as gm
from gramian.plot import COLORS, figure

t = np.linspace(0.0, 900.0, 10)
straight = np.stack([0 * t, 5.0 * t], axis=1)
leg = np.minimum(t, t[5])
turned = np.stack([5.0 * (t - leg), 5.0 * leg], axis=1)
target = np.array([1500.0, 6000.0, 2.0, -3.0])  # m, m/s

for path in (straight, turned):
    answer = gm.analyze(gm.bearings.problem(t, path, target, sigma=np.radians(0.5)))
    print(answer.status, answer.null_combinations)

relative = target[:2] + t[:, None] * target[2:] - straight
picture = figure(9.0, 4.6)
titles = ("a straight observer: unobservable", "a turn: one track fits")
for axes, path, title in zip(picture.subplots(1, 2), (straight, turned), titles, strict=True):
    lines = straight + relative - path
    lines = lines / np.hypot(lines[:, :1], lines[:, 1:])
    for place, line in zip(path, lines, strict=True):
        far = place + 8500.0 * line
        axes.plot(*zip(place, far, strict=True), color=COLORS["muted"], linewidth=0.6)
    axes.plot(*path.T, marker="o", markersize=3, color=COLORS["observer"], label="observer")
    for factor in (0.5, 1.0, 1.4):
        fits = factor == 1.0 or path is straight
        axes.plot(
            *(straight + factor * relative).T,
            marker="o",
            markersize=3,
            color=COLORS["target" if fits else "bad"],
            linestyle="-" if fits else ":",
            alpha=1.0 if factor == 1.0 else 0.65,
        )
    axes.annotate("observer", path[0], (-6, 2), textcoords="offset points", ha="right")
    axes.annotate("target", target[:2], (6, 4), textcoords="offset points")
    axes.set_title(title)
    axes.set_aspect("equal")
    axes.set_xlim(-3000, 6200)
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")
