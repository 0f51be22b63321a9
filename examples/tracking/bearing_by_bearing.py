"""
Bearing by bearing
==================

The monitor keeps no bearing and runs on a microcontroller. Here it watches a track whose observer
turns after five minutes: rank 3 until then, and a bound that falls afterwards.
"""

import numpy as np

import gramian as gm
from gramian.plot import COLORS, figure

t = np.arange(0.0, 600.0, 10.0)
leg = np.minimum(t, 300.0)
path = np.stack([6.0 * (t - leg), 6.0 * leg], axis=1)
target = np.array([2500.0, 5000.0, -2.0, 1.0])
offset = target[:2] + t[:, None] * target[2:] - path
bearings, ranges = np.arctan2(*offset.T), np.hypot(*offset.T)

monitor = gm.bearings.Monitor()
rank, bound = [], []
for time, bearing, distance in zip(t, bearings, ranges, strict=True):
    answer = monitor.push(time, bearing, sigma=0.01, distance=distance)
    rank.append(answer.rank)
    bound.append(np.hypot(*answer.crlb_std[:2]))
print("rank 4 from", t[np.argmax(np.array(rank) == 4)], "s on")

picture = figure(7.5, 4.2)
top, bottom = picture.subplots(2, 1, sharex=True, height_ratios=[1, 2])
top.step(t, rank, where="post", color=COLORS["observer"])
top.set_ylabel("rank")
top.set_yticks([1, 2, 3, 4])
bottom.semilogy(t, bound, color=COLORS["target"])
bottom.set_ylabel("bound on the position (m)")
bottom.set_xlabel("time (s)")
for axes in (top, bottom):
    axes.axvline(300.0, color=COLORS["muted"], linestyle="--", linewidth=0.8)
