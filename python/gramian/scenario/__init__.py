"""Scenario files: what a command works on, in TOML, checked key by key.

- `load`: a file, as the `Scenario` of its model; `from_values`: what such a file says.
- `draft`: a scenario to start from, for files of tracks and measurements; `from_files`:
  the analysis of such files without one. `Choices` says which of their tracks are meant.
- `draft_of_field`: the same for a table of a magnetic field.
- `schema`: the JSON Schema of every key, for editors; `reference`: a page of them.
"""

from gramian.scenario._draft import Choices, draft, draft_of_field, from_files
from gramian.scenario._load import from_values, load
from gramian.scenario._reference import reference, schema
from gramian.scenario.base import Scenario

__all__ = [
    "Choices",
    "Scenario",
    "draft",
    "draft_of_field",
    "from_files",
    "from_values",
    "load",
    "reference",
    "schema",
]


def __dir__() -> list[str]:
    return sorted(__all__)
