"""Bearings-only target motion: what the bearings of a moving target can tell.

A target moves at constant velocity; an observer measures its bearing, clockwise
from north, and knows its own path. The state is (x0, y0, vx, vy) in metres and
metres per second at the first time; x is east, y is north.

- `problem`, `rows`: the whitened rows, for `gramian.analyze`; `NAMES`, `UNITS` and
  `state_names` name the states, `merge` joins several observers.
- `localize`: the most likely state as a `gramian.Estimate`, with its fit, other solutions and
  intervals of the likelihood; `BearingsModel` is the model behind it. `localize_many` does
  many records at once: `Localizations`, each with one of the `STATUSES`; `residuals` of a
  state; `simulate` makes noisy bearings, `localize_trials` does both many times, with `Trials`.
- `observable`, with `ObservableVerdict`: Theorem 1 for exact bearings; `discriminant`,
  `discriminant_sum`, `gram`, `gram_det`, and `best_quadruple` with `Quadruple`.
- `observability_test`, with `ObservabilityTest`: whether noisy bearings could be those of
  an unobservable track.
- `Monitor`, with `MonitorAnswer`: the same while the bearings come in.
"""

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
    Localizations,
    Trials,
    localize,
    localize_many,
    localize_trials,
    residuals,
)
from gramian.models.bearings._model import BearingsModel
from gramian.models.bearings._monitor import Monitor, MonitorAnswer
from gramian.models.bearings._motion_test import (
    ObservabilityTest,
    observability_test,
)
from gramian.models.bearings._rows import NAMES, UNITS, merge, problem, rows, simulate, state_names

__all__ = [
    "NAMES",
    "STATUSES",
    "UNITS",
    "BearingsModel",
    "Localizations",
    "Monitor",
    "MonitorAnswer",
    "ObservabilityTest",
    "ObservableVerdict",
    "Quadruple",
    "Trials",
    "best_quadruple",
    "discriminant",
    "discriminant_sum",
    "gram",
    "gram_det",
    "localize",
    "localize_many",
    "localize_trials",
    "merge",
    "observability_test",
    "observable",
    "problem",
    "residuals",
    "rows",
    "simulate",
    "state_names",
]


def __dir__() -> list[str]:
    return sorted(__all__)
