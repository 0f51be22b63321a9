"""Monte Carlo: whether an estimator reaches its bound and is honest about its errors.

`run` simulates an experiment many times, estimates in every trial, and sets the
errors beside the bound; `sweep` does so over a range of scenarios. Both run on
one core, on many, or on a cluster, with the same numbers to the last bit.
"""

from gramian.monte_carlo.chunks import Failure
from gramian.monte_carlo.experiment import Estimates, Experiment, Linear, Measurements, normals
from gramian.monte_carlo.models import Bearings, Dipole, Registration
from gramian.monte_carlo.result import MonteCarloResult, Nees, Quantity
from gramian.monte_carlo.run import run
from gramian.monte_carlo.sweep import SweepResult, sweep

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
