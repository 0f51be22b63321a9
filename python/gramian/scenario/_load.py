"""From a file to the scenario of its model."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gramian._files import read_whole
from gramian._registry import REGISTRY
from gramian.exceptions import ScenarioError
from gramian.scenario.base import Scenario, scenario_class
from gramian.scenario.validation_errors import describe

__all__ = ["from_values", "load", "parsed"]

#: A scenario is written by hand, or nearly: bytes.
SCENARIO_LIMIT = 1 << 24


def load(path: Path | str) -> Scenario:
    """Read and check a scenario file.

    Parameters
    ----------
    path : path
        A TOML file with the key ``model``; files that it names are relative to it.

    Raises
    ------
    ScenarioError
        With file, line, key, value and what was expected, for each error.
    """
    path = Path(path)
    try:
        # With or without the byte order mark that some editors put in front.
        text = read_whole(path, SCENARIO_LIMIT).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: cannot be read: {error}") from error
    return parsed(text, path)


def parsed(text: str, path: Path) -> Scenario:
    """Return the scenario of a text, as if it had been read from a file."""
    try:
        values = tomllib.loads(text)
    except RecursionError:
        raise ScenarioError(f"{path}: is nested too deeply") from None
    except ValueError as error:  # TOMLDecodeError, or an integer of thousands of digits
        raise ScenarioError(f"{path}: is not valid TOML: {error}") from error
    return from_values(values, path, text)


def from_values(
    values: Mapping[str, Any], path: Path = Path("scenario.toml"), text: str = ""
) -> Scenario:
    """Check what a scenario file says, given as a mapping.

    Parameters
    ----------
    values : mapping
        Its keys; files that they name are relative to the folder of `path`.
    path : path
        Where it is from, for messages.
    text : str
        The text of that file, in which the line of a mistake is looked up.

    Raises
    ------
    ScenarioError
        As `load`.
    """
    known = ", ".join(f'"{name}"' for name in REGISTRY)
    if "model" not in values:
        raise ScenarioError(f"{path}: model is missing: must be one of {known}")
    if not isinstance(values["model"], str) or values["model"] not in REGISTRY:
        raise ScenarioError(f"{path}: model = {values['model']!r}: must be one of {known}")
    kind = scenario_class(values["model"])
    try:
        # As JSON: strict there takes a list for a tuple, but no text or truth for a number.
        scenario = kind.model_validate_json(json.dumps(values, default=str))
    except ValidationError as error:
        raise ScenarioError(describe(error, kind, path, text)) from error
    except (RecursionError, ValueError) as error:
        raise ScenarioError(f"{path}: cannot be used: {error}") from error
    scenario.path = path
    return scenario
