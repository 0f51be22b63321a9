"""Observer maneuver: where to steer to locate a target by its bearings.

- `heading` of a `Law`: the next heading from bearing and range, `AtStandoff` says what a
  law does once it is near enough; `trajectory` follows a law, as a `Trajectory`.
- `plan`: the best paths over a horizon, a `Plan` with `Start`, `LawComparison` and
  `Violation`; `soonest`: in how few samples an accuracy is reached, a `Soonest`;
  `shortest_interval`: by the likelihood interval, where the ellipse misleads, a
  `ShortestInterval`;
  `Sensing` is what an observer measures on the way.
- `closed_loop`: laws and plans without knowing the target, a `ClosedLoop` of `LoopRun`.
- `two_legs`: where to turn against a distant moving target, in closed form, as `TwoLegs`.
- `fisher`, `fisher_det`, `fisher_and_det`, `problem`: what a path tells of its target;
  `scene`: that path and what is measured along it for `gramian.tracks`.

Bearings and headings are clockwise from north; x is east, y is north.
"""

from gramian.models.maneuver._closed_loop import ClosedLoop, LoopRun, closed_loop
from gramian.models.maneuver._fisher import (
    fisher,
    fisher_and_det,
    fisher_det,
    problem,
)
from gramian.models.maneuver._laws import AtStandoff, Law, Trajectory, heading, trajectory
from gramian.models.maneuver._planner import LawComparison, Plan, Start, Violation, plan
from gramian.models.maneuver._scene import scene
from gramian.models.maneuver._sensing import Sensing
from gramian.models.maneuver._shortest import ShortestInterval, shortest_interval
from gramian.models.maneuver._soonest import Soonest, soonest
from gramian.models.maneuver._two_legs import TwoLegs, two_legs

__all__ = [
    "AtStandoff",
    "ClosedLoop",
    "Law",
    "LawComparison",
    "LoopRun",
    "Plan",
    "Sensing",
    "ShortestInterval",
    "Soonest",
    "Start",
    "Trajectory",
    "TwoLegs",
    "Violation",
    "closed_loop",
    "fisher",
    "fisher_and_det",
    "fisher_det",
    "heading",
    "plan",
    "problem",
    "scene",
    "shortest_interval",
    "soonest",
    "trajectory",
    "two_legs",
]


def __dir__() -> list[str]:
    return sorted(__all__)
