"""What a set of measurements can and cannot determine, how accurately, and what to do about it.

Every question is asked of one array, the whitened Jacobian rows (d h / d x) / sigma,
shape (K, n). A model makes rows; `analyze` says what they determine.
"""

from __future__ import annotations

from gramian import bearings, bounds, dipole, inertial, linear, maneuver, monte_carlo, registration
from gramian._core import __version__, set_threads
from gramian.analysis import Observability, Suggestion, analyze
from gramian.bounds import crlb, crlb_std, gram
from gramian.exceptions import (
    ConvergenceError,
    GramianError,
    InputError,
    ScenarioError,
    StorageError,
    UnobservableError,
    WorkerError,
)
from gramian.problem import Problem, from_function

__all__ = [
    "ConvergenceError",
    "GramianError",
    "InputError",
    "Observability",
    "Problem",
    "ScenarioError",
    "StorageError",
    "Suggestion",
    "UnobservableError",
    "WorkerError",
    "__version__",
    "analyze",
    "bearings",
    "bounds",
    "crlb",
    "crlb_std",
    "dipole",
    "from_function",
    "gram",
    "inertial",
    "linear",
    "maneuver",
    "monte_carlo",
    "registration",
    "set_threads",
]
