"""The models: each makes rows, and brings what is special to it.

A new model is one folder here and one line in `REGISTRY`.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from types import ModuleType

__all__ = ["REGISTRY", "Entry"]


@dataclass(frozen=True)
class Entry:
    """What the rest of the package needs to know of a model without importing it.

    Attributes
    ----------
    scenario : str
        The class of its scenario files, in the model's ``scenario`` module.
    experiment : str or None
        The class of its Monte Carlo experiment, in the model's ``monte_carlo`` module;
        None for a model whose experiment is the general one.
    """

    scenario: str
    experiment: str | None = None


#: Every model by name, in the order in which lists of models are printed.
REGISTRY = {
    "bearings": Entry("BearingsScenario", "Bearings"),
    "dipole": Entry("DipoleScenario", "Dipole"),
    "inertial": Entry("InertialScenario"),
    "linear": Entry("LinearScenario"),
    "registration": Entry("RegistrationScenario", "Registration"),
    "maneuver": Entry("ManeuverScenario"),
}


def __getattr__(name: str) -> ModuleType:
    if name in REGISTRY:
        return importlib.import_module(f"gramian.models.{name}")
    raise AttributeError(f"module 'gramian.models' has no attribute {name!r}")


def part(model: str, name: str, attribute: str) -> type:
    """Return a class from a part of a model that is loaded on demand."""
    module = importlib.import_module(f"gramian.models.{model}.{name}")
    found: type = getattr(module, attribute)
    return found
