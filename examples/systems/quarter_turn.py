"""
A quarter turn in flight
========================

A strapdown navigator aided by velocity and position. At rest three combinations of its errors are
hidden; segments of a flight with a turn and an acceleration reveal them one after the other.
"""

import numpy as np

import gramian as gm
from gramian.plot import COLORS, figure

Leg = gm.inertial.Leg
legs = [Leg(60.0), Leg(30.0, turn=np.pi / 2), Leg(20.0, speed_change=20.0), Leg(60.0)]
flight = gm.inertial.segments(legs, np.radians(28.15), speed=50.0)
found = gm.linear.piecewise(flight.A, flight.C, flight.durations)
ranks = np.array(found.total_ranks)
print("rank after each segment:", ranks.tolist())

ends = flight.times + flight.durations
picture = figure(7.2, 4.4)
top, bottom = picture.subplots(2, 1, sharex=True)
top.step(ends, ranks, where="post", color=COLORS["observer"])
top.set_ylabel("rank so far")
bottom.plot(flight.times + flight.durations / 2, np.degrees(flight.heading), ".-",
            color=COLORS["target"], label="heading (deg)")  # fmt: skip
bottom.plot(flight.times + flight.durations / 2, flight.speed, ".-",
            color=COLORS["good"], label="speed (m/s)")  # fmt: skip
bottom.set_xlabel("time (s)")
bottom.legend(frameon=False)
