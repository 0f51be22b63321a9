"""Monte Carlo: whether an estimator reaches its bound and is honest about its errors.

`run` simulates an experiment many times, estimates in every trial, and sets the
errors beside the bound; `sweep` does so over a range of scenarios. Both run on
one core, on many, or on a cluster, with the same numbers to the last bit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gramian.models import REGISTRY, part
from gramian.monte_carlo.chunks import Failure
from gramian.monte_carlo.experiment import Estimates, Experiment, Linear, Measurements, normals
from gramian.monte_carlo.result import MonteCarloResult, Nees, Quantity
from gramian.monte_carlo.run import run
from gramian.monte_carlo.sweep import SweepResult, sweep

if TYPE_CHECKING:
    from gramian.models.bearings.monte_carlo import Bearings
    from gramian.models.dipole.monte_carlo import Dipole
    from gramian.models.registration.monte_carlo import Registration

__all__ = [
    "Bearings",
    "Dipole",
    "Estimates",
    "Experiment",
    "Failure",
    "Linear",
    "Measurements",
    "MonteCarloResult",
    "Nees",
    "Quantity",
    "Registration",
    "SweepResult",
    "normals",
    "run",
    "sweep",
]


def __getattr__(name: str) -> type:
    # The experiments of the models, which import this package.
    for model, entry in REGISTRY.items():
        if entry.experiment == name:
            return part(model, "monte_carlo", name)
    raise AttributeError(f"module 'gramian.monte_carlo' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
