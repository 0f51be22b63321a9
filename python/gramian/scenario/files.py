"""Reading the CSV files that a scenario names."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gramian.exceptions import ScenarioError

__all__ = ["read_columns"]


def read_columns(
    path: Path,
    numbers: Mapping[str, str],
    texts: Mapping[str, str] | None = None,
    *,
    missing: Literal["raise", "nan"] = "raise",
) -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.str_]]]:
    """Read columns of a CSV file with a header line.

    Parameters
    ----------
    path : Path
    numbers, texts : mapping of str to str
        What each column is called here -> its name in the file.
    missing : {"raise", "nan"}
        What to do about empty and "nan" cells of numbers.

    Returns
    -------
    tuple of dict
        Arrays of floats and arrays of strings, by the names given here.

    Raises
    ------
    ScenarioError
        A missing file or column, a cell that is not a finite number: with the line.
    """
    texts = texts or {}
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            header = [cell.strip() for cell in next(reader, [])]
            for meaning, column in {**numbers, **texts}.items():
                if column not in header:
                    raise ScenarioError(
                        f"{path}: has no column {column!r} (for {meaning}): "
                        f"its columns are {', '.join(header) or 'none, it is empty'}"
                        + _other_separator(header)
                    )
                if header.count(column) > 1:
                    raise ScenarioError(
                        f"{path}: has {header.count(column)} columns {column!r} (for {meaning}): "
                        "must have one"
                    )
            values: dict[str, list[float]] = {meaning: [] for meaning in numbers}
            words: dict[str, list[str]] = {meaning: [] for meaning in texts}
            for row in reader:
                if not row:
                    continue
                if len(row) != len(header):
                    raise ScenarioError(
                        f"{path}:{reader.line_num}: has {len(row)} cells: "
                        f"must have {len(header)}, as the header"
                    )
                for meaning, column in numbers.items():
                    cell = row[header.index(column)]
                    if missing == "nan" and cell.strip().lower() in ("", "nan"):
                        values[meaning].append(math.nan)
                        continue
                    values[meaning].append(_number(cell, f"{path}:{reader.line_num}: {column}"))
                for meaning, column in texts.items():
                    words[meaning].append(row[header.index(column)].strip())
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ScenarioError(f"{path}: cannot be read: {error}") from error
    return (
        {meaning: np.array(column, dtype=float) for meaning, column in values.items()},
        {meaning: np.array(column, dtype=str) for meaning, column in words.items()},
    )


def _other_separator(header: list[str]) -> str:
    if len(header) == 1 and any(sign in header[0] for sign in ";\t|"):
        return "; cells must be separated by commas, decimals by points"
    return ""


def _number(cell: str, place: str) -> float:
    try:
        # Python reads 1_000 as a number; in a table it is a slip.
        value = float("" if "_" in cell else cell)
    except ValueError:
        hint = " (dates and clock times: convert them to seconds)" if ":" in cell else ""
        raise ScenarioError(f"{place} = {cell!r}: must be a number{hint}") from None
    if not math.isfinite(value):
        raise ScenarioError(f"{place} = {cell}: must be finite")
    return value
