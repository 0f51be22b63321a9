"""Scenario files: what a command works on, in TOML, checked key by key.

`load` reads one, as the `Scenario` of its model.
"""

from gramian.scenario._load import load
from gramian.scenario.base import Scenario

__all__ = ["Scenario", "load"]


def __dir__() -> list[str]:
    return sorted(__all__)
