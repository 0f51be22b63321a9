"""Tables of a magnetic field: what is in them, for `gramian import`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gramian._values import Value
from gramian.exceptions import InputError
from gramian.io._read import table
from gramian.io._table import Table as Cells
from gramian.io._table import guess
from gramian.report import Report, Table

__all__ = ["FieldTable", "field_table", "report"]

#: Units of a field by how a heading writes them.
_UNITS = {unit.lower(): unit for unit in ("T", "mT", "uT", "nT", "mG", "G")} | {"µt": "uT"}
_AXIS = re.compile(r"(.*?)[_ ]?([xyz])[_ ]?[\[(]?(µ?[a-z]+)[\])]?$", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class FieldTable(Value):
    """A table with a time and three components of a field for each sensor.

    Attributes
    ----------
    cells : Table
    time : str
        The column of times.
    unit : str
        Of the field.
    sensors : list of (str, str, str)
        The columns of each.
    by : str or None
        The column that tells one pass from another.
    passes : dict of str to ndarray
        The times of each, s.
    """

    cells: Cells
    time: str
    unit: str
    sensors: list[tuple[str, str, str]]
    by: str | None
    passes: dict[str, np.ndarray]


def field_table(path: Path) -> FieldTable | None:
    """Return what is in a table of a magnetic field; None where a file is none.

    Columns are recognised by headings such as ``s1_x_uT`` or ``Bx (nT)``, three for each
    sensor in one unit. A column of words tells passes apart.
    """
    try:
        cells = table(path)
    except InputError:
        return None
    axes: dict[str, dict[str, str]] = {}
    units = set()
    for heading in cells.header:
        match = _AXIS.match(heading.strip())
        if match and (unit := _UNITS.get(match[3].lower())):
            axes.setdefault(match[1], {})[match[2].lower()] = heading
            units.add(unit)
    sensors = [(of["x"], of["y"], of["z"]) for of in axes.values() if len(of) == 3]
    time = guess(cells.header).get("time")
    if not sensors or time is None or len(units) != 1:
        return None
    times = cells.times(time)[0]
    by = next((name for name in cells.header if name != time and _is_words(cells[name])), None)
    if by is None:
        passes = {"": times}
    else:
        labels = np.array(cells[by])
        passes = {str(one): times[labels == one] for one in dict.fromkeys(cells[by])}
    return FieldTable(cells, time, units.pop(), sensors, by, passes)


def _is_words(cells: list[str]) -> bool:
    """Say whether each cell is a word that stands for many rows."""
    few = set(cells)
    return len(few) <= max(1, len(cells) // 4) and all(re.search(r"[^\W\d]", one) for one in few)


def report(found: FieldTable) -> Report:
    """Return sensors and passes of a table of a field, with their sampling and gaps."""
    rows = []
    for name, times in found.passes.items():
        steps = np.diff(times) if times.size > 1 else np.zeros(1)
        values = (times[0], times[-1], np.median(steps), steps.max())
        rows.append([name or "all", str(times.size), *(f"{value:.6g}" for value in values)])
    columns = ["samples", "from (s)", "to (s)", "every (s)", "longest gap (s)"]
    sensors, passes = len(found.sensors), len(found.passes)
    sensors_text = f"{sensors} sensor{'' if sensors == 1 else 's'}"
    return Report(
        title=found.cells.path.name,
        subtitle=f"{found.cells.format}, a magnetic field",
        tone="good",
        headline="READ",
        verdict=f"{sensors_text} in {passes} pass{'' if passes == 1 else 'es'}",
        facts=[("unit", found.unit)],
        tables=[
            Table("Passes", [found.by or "pass", *columns], rows),
            Table(
                "Sensors",
                ["sensor", "x", "y", "z"],
                [[str(i + 1), *names] for i, names in enumerate(found.sensors)],
            ),
        ],
        pictures=[],
        data={
            "format": found.cells.format,
            "files": [str(found.cells.path)],
            "unit": found.unit,
            "sensors": [list(names) for names in found.sensors],
            "passes": {name: int(times.size) for name, times in found.passes.items()},
        },
    )
