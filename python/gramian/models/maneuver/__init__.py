"""Observer maneuver: where to steer to locate a target by its bearings.

The closed-form laws give the next heading from bearing and range; `trajectory`
follows one of them, and `fisher` says what a path tells of its target. `plan` finds
the best path over a horizon, and `closed_loop` flies laws and plans without knowing
the target. Bearings and headings are clockwise from north; x is east, y is north.
"""

from __future__ import annotations

from gramian.models.maneuver._closed_loop import ClosedLoop, LoopRun, closed_loop
from gramian.models.maneuver._fisher import fisher, fisher_det, problem
from gramian.models.maneuver._laws import AtStandoff, Law, Trajectory, heading, trajectory
from gramian.models.maneuver._planner import LawComparison, Plan, Start, plan

__all__ = [
    "AtStandoff",
    "ClosedLoop",
    "Law",
    "LawComparison",
    "LoopRun",
    "Plan",
    "Start",
    "Trajectory",
    "closed_loop",
    "fisher",
    "fisher_det",
    "heading",
    "plan",
    "problem",
    "trajectory",
]
