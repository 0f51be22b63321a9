"""What a set of measurements can and cannot determine, how accurately, and what to do about it.

Every question is asked of one array, the whitened Jacobian rows (d h / d x) / sigma,
shape (K, n). A model makes rows; `analyze` says what they determine.
"""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import TYPE_CHECKING

from gramian import bounds
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
from gramian.models import REGISTRY
from gramian.problem import Problem, from_function

if TYPE_CHECKING:
    from gramian import io, monte_carlo
    from gramian.models import bearings, dipole, inertial, linear, maneuver, registration

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
    "io",
    "linear",
    "maneuver",
    "monte_carlo",
    "registration",
    "set_threads",
]


def __getattr__(name: str) -> ModuleType:
    # Imported when they are first used, so that the import of the package stays light.
    if name in REGISTRY:
        return importlib.import_module(f"gramian.models.{name}")
    if name in ("io", "monte_carlo"):
        return importlib.import_module(f"gramian.{name}")
    raise AttributeError(f"module 'gramian' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
