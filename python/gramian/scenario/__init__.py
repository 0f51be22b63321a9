"""Scenario files: what a command works on, in TOML, checked key by key.

`load` reads one, as the `Scenario` of its model; `draft` writes one for files of tracks and
measurements, and `from_files` does without.
"""

from gramian.scenario._draft import Choices, draft, from_files
from gramian.scenario._load import load, schema
from gramian.scenario.base import Scenario

__all__ = ["Choices", "Scenario", "draft", "from_files", "load", "schema"]


def __dir__() -> list[str]:
    return sorted(__all__)
