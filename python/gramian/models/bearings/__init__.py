"""Bearings-only target motion: what the bearings of a moving target can tell.

A target moves at constant velocity; an observer measures its bearing, clockwise
from north, and knows its own path. The state is (x0, y0, vx, vy) in metres and
metres per second at the first time; x is east, y is north.
"""

from __future__ import annotations

from gramian.models.bearings._discriminant import (
    ObservableVerdict,
    Quadruple,
    best_quadruple,
    discriminant,
    discriminant_sum,
    gram,
    gram_det,
    observable,
)
from gramian.models.bearings._localize import (
    STATUSES,
    Localization,
    Trials,
    localize,
    localize_trials,
    residuals,
)
from gramian.models.bearings._monitor import Monitor, MonitorAnswer
from gramian.models.bearings._motion_test import (
    ObservabilityTest,
    family_figure,
    observability_test,
    power_figure,
)
from gramian.models.bearings._rows import NAMES, UNITS, merge, problem, rows, simulate, state_names

__all__ = [
    "NAMES",
    "STATUSES",
    "UNITS",
    "Localization",
    "Monitor",
    "MonitorAnswer",
    "ObservabilityTest",
    "ObservableVerdict",
    "Quadruple",
    "Trials",
    "best_quadruple",
    "discriminant",
    "discriminant_sum",
    "family_figure",
    "gram",
    "gram_det",
    "localize",
    "localize_trials",
    "merge",
    "observability_test",
    "observable",
    "power_figure",
    "problem",
    "residuals",
    "rows",
    "simulate",
    "state_names",
]
