"""Reading the tables that a scenario names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gramian import io
from gramian.exceptions import InputError, ScenarioError

__all__ = ["read_columns"]


def read_columns(
    path: Path,
    numbers: Mapping[str, str],
    texts: Mapping[str, str] | None = None,
    *,
    missing: Literal["raise", "nan"] = "raise",
) -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.str_]]]:
    """Read columns of a table with a header line, in any form that `gramian.io` reads.

    The column called "time" here may hold dates, UNIX or clock times: it is in seconds,
    dates from the first whole second on.

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
    try:
        table = io.table(path)
        values = {name: _column(table, name, column, missing) for name, column in numbers.items()}
        words = {name: np.array(_cells(table, name, column), dtype=str)
                 for name, column in (texts or {}).items()}  # fmt: skip
    except ScenarioError:
        raise
    except InputError as error:
        raise ScenarioError(str(error)) from error
    return values, words


def _column(
    table: io.Table, meaning: str, column: str, missing: Literal["raise", "nan"]
) -> NDArray[np.float64]:
    cells = _cells(table, meaning, column)
    if meaning == "time":
        times, dated, _ = table.times(column)
        values = times - (np.floor(np.nanmin(times)) if dated else 0.0)
    else:
        values = table.numbers(column)
    if missing == "raise" and (empty := np.flatnonzero(np.isnan(values))).size:
        place = table.place(int(empty[0]), column)
        raise ScenarioError(f"{place} = {cells[empty[0]]!r}: must be a number")
    return values


def _cells(table: io.Table, meaning: str, column: str) -> list[str]:
    count = table.header.count(column)
    if count != 1:
        many = f"{count} columns" if count else "no column"
        raise ScenarioError(
            f"{table.path}: has {many} {column!r} (for {meaning}): "
            + ("must have one" if count else f"its columns are {', '.join(table.header)}")
        )
    return table[column]
