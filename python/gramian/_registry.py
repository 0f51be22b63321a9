"""Every model by name, and how what is loaded on demand is found.

This is the only list of models, and the only place that imports a module by its
name: a model's scenario, experiment and pictures are loaded when they are asked
for, so the files that ask stand below the models and import none of them.
"""

from __future__ import annotations

import importlib
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["REGISTRY", "Entry", "draw", "load", "part"]


class Entry(NamedTuple):
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
    "tracks": Entry("TracksScenario", "Tracks"),
}


def load(module: str) -> ModuleType:
    """Return a module of the package, loaded now if it was not."""
    return importlib.import_module(f"gramian.{module}")


def part(model: str, module: str, attribute: str) -> type:
    """Return a class from a part of a model that is loaded on demand."""
    found: type = getattr(load(f"models.{model}.{module}"), attribute)
    return found


def draw(result: object, picture: str, *args: Any, **options: Any) -> Figure:
    """Draw a result with a function of the ``plot`` module beside its class.

    A class of `gramian.models.dipole` is drawn by `gramian.models.dipole.plot`, one of
    `gramian.monte_carlo` by `gramian.monte_carlo.plot`, and where these have no such picture,
    as `gramian.plot` draws the class that it is made of.
    """
    homes = [cls.__module__.rpartition(".")[0] for cls in type(result).__mro__]
    packages = dict.fromkeys((*(home for home in homes if home.startswith("gramian")), "gramian"))
    modules = [f"{package}.plot" for package in packages if find_spec(f"{package}.plot")]
    plots = (importlib.import_module(module) for module in modules)
    drawing = next(getattr(plot, picture) for plot in plots if hasattr(plot, picture))
    figure: Figure = drawing(result, *args, **options)
    return figure
