"""Monte Carlo: whether an estimator reaches its bound, with a covariance that fits its errors.

- `run` simulates an experiment many times, estimates in every trial, and sets the errors
  beside the bound: a `MonteCarloResult`, with `Nees`, `Quantity` and `Failure`.
- `sweep` does so over a range of scenarios: a `SweepResult`.
- `Bearings`, `Dipole`, `Registration` and `Tracks` are the experiments of the models,
  `Linear` that of any `gramian.Problem`, `Measurements` that of a measurement function of your own.
- `Experiment` is the class to derive your own from, with `Estimates` and `normals`.

A run takes one core, many, or a cluster, and gives the same numbers to the last bit.
"""

import typing as _typing

from gramian._registry import REGISTRY as _REGISTRY
from gramian._registry import part as _part
from gramian.monte_carlo.chunks import Failure
from gramian.monte_carlo.experiment import Estimates, Experiment, Linear, Measurements, normals
from gramian.monte_carlo.result import MonteCarloResult, Nees, Quantity
from gramian.monte_carlo.run import run
from gramian.monte_carlo.sweep import SweepResult, sweep

if _typing.TYPE_CHECKING:
    from gramian.models.bearings.monte_carlo import Bearings as Bearings
    from gramian.models.dipole.monte_carlo import Dipole as Dipole
    from gramian.models.registration.monte_carlo import Registration as Registration
    from gramian.models.tracks.monte_carlo import Tracks as Tracks

__all__ = [
    "Estimates",
    "Experiment",
    "Failure",
    "Linear",
    "Measurements",
    "MonteCarloResult",
    "Nees",
    "Quantity",
    "SweepResult",
    "normals",
    "run",
    "sweep",
]
__all__.extend(entry.experiment for entry in _REGISTRY.values() if entry.experiment)


def __getattr__(name: str) -> type:
    # The experiments of the models, loaded when they are used: they import this package.
    for model, entry in _REGISTRY.items():
        if entry.experiment == name:
            return _part(model, "monte_carlo", name)
    raise AttributeError(f"module 'gramian.monte_carlo' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
