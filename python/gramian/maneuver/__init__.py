"""Observer maneuver: where to steer to locate a target by its bearings.

The closed-form laws give the next heading from bearing and range; `trajectory`
follows one of them. Bearings and headings are clockwise from north; x is east, y is north.
"""

from __future__ import annotations

from gramian.maneuver.laws import AtStandoff, Law, Trajectory, heading, trajectory

__all__ = ["AtStandoff", "Law", "Trajectory", "heading", "trajectory"]
