"""
The bound of every filter
=========================

A target whose velocity wanders, followed by bearings from an observer that weaves or goes straight:
no filter's error can stay below these curves.
"""

import numpy as np

import gramian as gm
from gramian.plot import COLORS, figure

dt, steps, sigma = 10.0, 120, np.radians(0.5)
t = dt * np.arange(steps)
block = np.array([[1.0, dt], [0.0, 1.0]])
transition = np.kron(block, np.eye(2))
noise = 1e-4 * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(2))
target = np.array([3000.0, 9000.0]) + t[:, None] * np.array([-3.0, -1.0])
heading = {"straight": 0 * t, "weaving": np.radians(60) * np.sign(np.sin(2 * np.pi * t / 600))}
picture = figure(7.0, 4.2)
axes = picture.subplots()
for (name, course), color in zip(heading.items(), ("bad", "good"), strict=True):
    step = 5.0 * dt * np.stack([np.sin(course), np.cos(course)], axis=1)
    offset = target - np.vstack([[0.0, 0.0], np.cumsum(step[:-1], axis=0)])
    square = (offset**2).sum(axis=1)
    across = np.stack([offset[:, 1], -offset[:, 0]], axis=1) / square[:, None] / sigma
    rows = np.concatenate([across, 0 * across], axis=1)[:, None, :]
    bound = gm.bounds.posterior(rows, transition, noise, [3000.0, 3000.0, 5.0, 5.0])
    print(name, bound.rmse([0, 1])[[30, 60, -1]].round(0), "m after 5, 10 and 20 minutes")
    axes.semilogy(t / 60, bound.rmse([0, 1]), color=COLORS[color], label=name)
axes.set_xlabel("time (min)")
axes.set_ylabel("bound on the position (m)")
axes.legend(frameon=False)
