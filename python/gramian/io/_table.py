"""Tables of positions or detections: CSV in its many forms, and Parquet."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian import _options as options
from gramian._arrays import wrap_angles
from gramian._values import Value
from gramian.exceptions import GramianError, InputError
from gramian.io._angles import degrees
from gramian.io._build import KNOT, detections_of, epoch_of, track_of
from gramian.io._recording import Recording
from gramian.io._times import CLOCK, instants

__all__ = ["COLUMNS", "Table", "guess", "named", "read_table", "recording_of"]

Array = NDArray[np.float64]

#: What a column can hold, and the headings by which it is found, in lower case and
#: without units.
COLUMNS: dict[str, tuple[str, ...]] = {
    "id": ("id", "ship", "vessel", "aircraft", "mmsi", "name", "track", "callsign", "icao24"),
    "date": ("date", "day"),
    "time": (
        "time",
        "t",
        "timestamp",
        "datetime",
        "date_time",
        "basedatetime",
        "when",
        "utc",
        "epoch",
    ),
    "east": ("east", "x", "easting"),
    "north": ("north", "y", "northing"),
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon", "long", "lng"),
    "height": ("height", "altitude", "alt", "elevation", "z", "up"),
    "speed": ("speed", "sog"),
    "course": ("course", "cog"),
    "bearing": ("bearing", "brg"),
    "ambiguous_bearing": ("ambiguous_bearing",),
    "range": ("range", "distance"),
    "frequency": ("frequency", "freq"),
    "sensor": ("sensor",),
}
_TEXTS = ("id", "sensor", "date")
#: The unit that a heading can end in, and the factor to m, m/s, rad, Hz.
_UNITS: dict[str, tuple[str, float]] = {
    "m": ("length", 1.0),
    "metres": ("length", 1.0),
    "meters": ("length", 1.0),
    "km": ("length", 1000.0),
    "cm": ("length", 0.01),
    "mm": ("length", 0.001),
    "mi": ("length", 1609.344),
    "ft": ("length", 0.3048),
    "feet": ("length", 0.3048),
    "nm": ("length", 1852.0),
    "nmi": ("length", 1852.0),
    "yd": ("length", 0.9144),
    "mps": ("speed", 1.0),
    "m/s": ("speed", 1.0),
    "kn": ("speed", KNOT),
    "kt": ("speed", KNOT),
    "kts": ("speed", KNOT),
    "knots": ("speed", KNOT),
    "mph": ("speed", 0.44704),
    "kmh": ("speed", 1 / 3.6),
    "km/h": ("speed", 1 / 3.6),
    "deg": ("angle", np.pi / 180),
    "degree": ("angle", np.pi / 180),
    "degrees": ("angle", np.pi / 180),
    "°": ("angle", np.pi / 180),
    "gon": ("angle", np.pi / 200),
    "rad": ("angle", 1.0),
    "radians": ("angle", 1.0),
    "hz": ("frequency", 1.0),
    "khz": ("frequency", 1000.0),
    "s": ("time", 1.0),
    "sec": ("time", 1.0),
    "seconds": ("time", 1.0),
    "ms": ("time", 1e-3),
    "min": ("time", 60.0),
    "minutes": ("time", 60.0),
    "h": ("time", 3600.0),
    "hours": ("time", 3600.0),
    "utc": ("time", 1.0),
    "hh:mm:ss": ("time", 1.0),
    "hh:mm": ("time", 1.0),
    "mm:ss": ("time", 1.0),
}
_KINDS = {
    "east": "length",
    "north": "length",
    "height": "length",
    "range": "length",
    "speed": "speed",
    "course": "angle",
    "bearing": "angle",
    "ambiguous_bearing": "angle",
    "frequency": "frequency",
    "time": "time",
}
_DECIMAL = re.compile(r"[+-]?\d+\.\d+", re.ASCII)
_MISSING = {"", "nan", "null", "na", "n/a", "none", "-", "--"}


@dataclass(frozen=True)
class Table(Value):
    """The cells of a file, as text.

    Attributes
    ----------
    path : Path
    format : str
    header : list of str
    columns : list of list of str
    lines : sequence of int
        Where each row of cells is in the file, for messages.
    notes : list of str
    """

    path: Path
    format: str
    header: list[str]
    columns: list[list[str]]
    lines: Sequence[int]
    notes: list[str]

    def __getitem__(self, name: str) -> list[str]:
        if self.header.count(name) != 1:
            many = self.header.count(name)
            raise InputError(
                f"{self.path}: has {many or 'no'} column{'s' if many > 1 else ''} {name!r}: "
                f"its columns are {', '.join(self.header) or 'none, it is empty'}"
            )
        return self.columns[self.header.index(name)]

    def numbers(self, name: str) -> Array:
        """Return a column as numbers, NaN where a cell is empty."""
        cells = self[name]
        values = np.empty(len(cells))
        for i, cell in enumerate(cells):
            if cell.lower() in _MISSING:
                values[i] = np.nan
                continue
            try:
                # Python reads 1_000 as a number; in a table it is a slip.
                value = float("" if "_" in cell else cell)
            except ValueError:
                raise InputError(
                    f"{self.place(i, name)} = {options.given(cell)}: must be a number"
                ) from None
            if not isfinite(value):
                raise InputError(f"{self.place(i, name)} = {cell[:60]}: must be finite")
            values[i] = value
        return values

    def times(
        self,
        name: str,
        date: str | None = None,
        order: str | None = None,
        unit: str | None = None,
    ) -> tuple[Array, bool, str]:
        """Return a column as seconds, whether they are since 1970, and how it was read.

        `date` is a second column that has the date; `order` says whether days or months
        stand first in dates such as 01/05/2026; `unit` whether 12:30 is "hh:mm" or "mm:ss".
        """
        cells = self[name]
        unit = unit or _split(name)[1]
        if date is not None and all(CLOCK.match(cell) for cell in cells if cell):
            cells = [
                f"{day} {cell}" if cell else "" for day, cell in zip(self[date], cells, strict=True)
            ]
            name = f"{date} and {name}"
        return instants(cells, f"{self.path}: {name}", order, unit)

    def place(self, row: int, name: str) -> str:
        """Return where a cell is, for messages."""
        return f"{self.path}:{self.lines[row]}: {name}"


def named(path: Path) -> Path:
    """Return the name of a file without that of its packing: ship.csv.gz is ship.csv."""
    return path.with_suffix("") if path.suffix.lower() == ".gz" else path


def read_table(
    path: Path, text: str, *, separator: str | None = None, decimal: str | None = None
) -> Table:
    """Split a text file into cells; what separates them is found where it is not given.

    Raises
    ------
    InputError
        No header, rows of another length than the header, a separator that is not in it.
    """
    lines, skipped = _headed(text.splitlines(), separator)
    if not lines:
        raise InputError(f"{path}: is empty")
    notes = []
    if lines[0].lower().startswith("sep="):
        separator = separator or lines.pop(0)[4:5]
        skipped += 1
    if separator is None:
        separator = _separator(lines[0])
        if separator != ",":
            notes.append(f"cells separated by {_named(separator)}")
    rows = _rows(lines, separator, path)
    header = [cell.strip() for cell in rows[0][1]] if rows else []
    if all(_number_like(cell) for cell in header):
        raise InputError(
            f"{path}:{skipped + 1}: the first line has numbers and dates only: a header must name "
            "the columns"
        )
    body, numbers = _body(rows[1:], len(header), separator, path, skipped)
    # Units may have a line of their own below the header, in brackets or not.
    units = [cell.strip("[]() ") for cell in body[0]]
    if len(body) > 1 and any(units) and all(c.lower() in {"", "-", *_UNITS} for c in units):
        header = [
            f"{h} [{u}]" if u not in ("", "-") else h for h, u in zip(header, units, strict=True)
        ]
        del body[0], numbers[0]
    if decimal is None and separator != "," and _decimal_commas(header, body, path):
        decimal = ","
        notes.append("decimal commas")
    if decimal == ",":
        body = _with_points(header, body, path)
    columns = [list(column) for column in zip(*body, strict=True)]
    return Table(path, "csv", header, columns, numbers, notes)


def _headed(lines: list[str], separator: str | None) -> tuple[list[str], int]:
    """Return the lines from the header on, and how many there were before it."""
    skipped, comment = 0, ""
    while lines and (not lines[0].strip() or lines[0].lstrip().startswith("#")):
        comment = lines.pop(0).strip().lstrip("#").strip()
        skipped += 1
    if lines and comment:
        # A header may stand behind a sign of comments: "# Timestamp,Latitude".
        sign = separator or _separator(lines[0])
        named, first = ([c.strip() for c in x.split(sign)] for x in (comment, lines[0]))
        if len(named) == len(first) and "time" in guess(named) and not guess(first):
            return [comment, *lines], skipped - 1
    return lines, skipped


def _decimal_commas(header: list[str], body: list[list[str]], path: Path) -> bool:
    """Say whether commas in cells are decimal signs."""
    comma = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?$")
    cells = [cell for row in body for cell in row if "," in cell]
    if not cells or not all(comma.match(cell) for cell in cells):
        return False
    angles = _angles(header)
    cells = [c for row in body for i, c in enumerate(row) if "," in c and i not in angles]
    if cells and all(re.fullmatch(r"[+-]?[1-9]\d{0,2},\d{3}", cell) for cell in cells):
        raise InputError(
            f"{path}: {cells[0]}: is the comma a decimal sign, or does it group thousands? "
            "Say decimal = ',' or decimal = '.'"
        )
    return True


def _angles(header: list[str]) -> list[int]:
    """Return the columns of degrees, which have no thousands."""
    found = guess(header)
    return [header.index(found[k]) for k in ("latitude", "longitude", "bearing") if k in found]


def _with_points(header: list[str], body: list[list[str]], path: Path) -> list[list[str]]:
    """Return cells with decimal points in place of commas."""
    grouped = re.compile(r"[+-]?\d{1,3}(\.\d{3})+")
    angles = _angles(header)
    for cell in (c for row in body for i, c in enumerate(row) if i not in angles):
        if grouped.fullmatch(cell):
            raise InputError(
                f"{path}: {cell}: decimals are marked by commas: does the point group thousands? "
                "Remove it"
            )
    return [[re.sub(r"(?<=\d),(?=\d)", ".", cell) for cell in row] for row in body]


def _rows(lines: list[str], separator: str, path: Path) -> list[tuple[int, list[str]]]:
    """Return the cells of each line that has some, behind its number."""
    if separator.isspace() and separator != "\t":
        return [(i, line.split()) for i, line in enumerate(lines, 1) if line.strip()]
    try:
        reader = csv.reader(io.StringIO("\n".join(lines)), delimiter=separator, strict=True)
        return [(reader.line_num, row) for row in reader if row]
    except (csv.Error, TypeError) as error:
        raise InputError(f"{path}: cannot be split into cells: {error}") from error


def _body(
    rows: list[tuple[int, list[str]]], width: int, separator: str, path: Path, skipped: int
) -> tuple[list[list[str]], list[int]]:
    """Return the rows of cells, and their lines: without empty ones and comments."""
    body, numbers = [], []
    for i, row in rows:
        cells = [cell.strip() for cell in row]
        if not any(cells) or (len(cells) != width and cells[0].startswith("#")):
            continue
        # A separator at the end of each line makes empty cells.
        while len(cells) > width and not cells[-1]:
            del cells[-1]
        if len(cells) != width:
            hint = ""
            if separator == "," and len(row) > width:
                hint = " (decimal commas need another separator than the comma)"
            raise InputError(
                f"{path}:{skipped + i}: has {len(row)} cells: must have {width}, as the "
                f"header{hint}"
            )
        body.append(cells)
        numbers.append(skipped + i)
    if not body:
        raise InputError(f"{path}: has a header and no rows")
    return body, numbers


def read_parquet(path: Path) -> Table:
    """Read a Parquet or Arrow (Feather) file, by pyarrow."""
    try:
        import pyarrow as pa
        from pyarrow import feather, parquet
    except ImportError as error:  # pragma: no cover - without the extra
        raise GramianError("Parquet files need pyarrow: pip install 'gramian[files]'") from error
    try:
        load = parquet.read_table if path.suffix == ".parquet" else feather.read_table
        found = load(path)
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    return of_columns({n: found[n].to_pylist() for n in found.column_names}, path, "parquet")


def of_frame(value: Any, name: str) -> Table | None:
    """Return a frame of pandas, polars, pyarrow or xarray as a table; None for anything else."""
    kind = type(value)
    library = kind.__module__.partition(".")[0]
    if (library, kind.__name__) == ("xarray", "Dataset"):
        units = {str(key): part.attrs.get("units") for key, part in value.variables.items()}
        frame = value.to_dataframe().reset_index()
        columns = {
            f"{key} [{units[key]}]" if units.get(key) else str(key): frame[key] for key in frame
        }
    elif (library, kind.__name__) == ("pandas", "DataFrame"):
        named = [level for level in value.index.names if level is not None]
        times = type(value.index).__name__ in ("DatetimeIndex", "TimedeltaIndex")
        if not named and times and "time" not in guess([str(key) for key in value]):
            value, named = value.rename_axis("time"), ["time"]
        frame = value.reset_index() if named else value
        columns = {str(key): frame[key] for key in frame}
    elif (library, kind.__name__) in (("polars", "DataFrame"), ("pyarrow", "Table")):
        names = value.columns if library == "polars" else value.column_names
        listed = "to_list" if library == "polars" else "to_pylist"
        columns = {key: getattr(value[key], listed)() for key in names}
    else:
        return None
    return of_columns({key: list(part) for key, part in columns.items()}, Path(name), library)


def of_columns(columns: Mapping[str, Sequence[object]], path: Path, form: str) -> Table:
    """Return a table of columns of any scalars: dates become text, None an empty cell."""
    texts = [[_cell(value) for value in column] for column in columns.values()]
    if not texts or not texts[0]:
        raise InputError(f"{path}: has no rows")
    return Table(path, form, list(columns), texts, range(1, len(texts[0]) + 1), [])


def _cell(value: object) -> str:
    if value is None or type(value).__name__ in ("NAType", "NaTType"):
        return ""
    if value != value:  # noqa: PLR0124 - NaN differs from itself
        return ""
    if isinstance(value, np.datetime64):
        return str(value.astype("datetime64[us]"))
    if isinstance(value, float):
        return repr(value)
    if hasattr(value, "total_seconds"):
        return repr(float(value.total_seconds()))
    return value.isoformat() if hasattr(value, "isoformat") else str(value)


def guess(header: Sequence[str]) -> dict[str, str]:
    """Return what each column holds, by its heading: {"time": "t_s", "east": "east_m"}."""
    found: dict[str, str] = {}
    for meaning, names in COLUMNS.items():
        for wanted in names:
            for column in header:
                word, unit = _split(column)
                fits = unit is None or meaning not in _KINDS or _UNITS[unit][0] == _KINDS[meaning]
                if word == wanted and fits and column not in found.values():
                    found.setdefault(meaning, column)
    return found


def _split(heading: str) -> tuple[str, str | None]:
    """Return the word and the unit of a heading: "Speed (kn)" and "speed_kn" alike."""
    text = heading.strip().lower()
    match = re.match(r"(.+?)\s*[\[(]\s*([^\])]+?)\s*[\])]$", text) or re.match(
        r"(.+?)[_ ]([a-z/]+)$", text
    )
    # "deg T" and "deg true" are degrees.
    if match and (unit := match.group(2).removesuffix(" t").removesuffix(" true")) in _UNITS:
        return re.sub(r"[\s-]+", "_", match.group(1).strip()), unit
    return re.sub(r"[\s-]+", "_", text), None


def recording_of(
    table: Table,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    dates: str | None = None,
) -> Recording:
    """Return the tracks or detections of a table.

    Parameters
    ----------
    table : Table
    columns : mapping of str to str, optional
        What a column holds -> its heading, where the headings do not say it.
    units : mapping of str to str, optional
        What a column holds -> its unit ("km", "kn", "rad"), where its heading does not
        say it. Without either: m, m/s, degrees, Hz, s.
    dates : {"day first", "month first"}, optional
        Of dates such as 01/05/2026.

    Raises
    ------
    InputError
        Columns that are missing, cells that are no numbers, units that do not fit.
    """
    path = table.path
    found = _meanings(table, columns)
    unit = _unit_of("time", found["time"], units, path, asked=False)
    times, dated, said = table.times(found["time"], found.get("date"), dates, unit)
    if not dated and not said:
        unit = _unit_of("time", found["time"], units, path)
        times = times * _UNITS[unit or "s"][1]
    notes = [*table.notes, *([f"{found['time']} read as {said}"] if said else [])]
    epoch = epoch_of(times) if dated else None
    times = times - (epoch or 0.0)
    values: dict[str, Array] = {}
    used = set(found.values())
    for meaning, heading in found.items():
        if meaning in _TEXTS or meaning == "time":
            continue
        cells = table[heading]
        if meaning in ("latitude", "longitude"):
            values[meaning] = _geographic(cells, f"{path}: {heading}")
            _whole(table, meaning, heading, used)
            sides = _hemisphere(table, meaning, used)
            if sides is not None:
                values[meaning] = _sided(values[meaning], table, heading, sides)
                used.add(sides)
            continue
        numbers = table.numbers(heading)
        unit = _unit_of(meaning, heading, units, path)
        default = "deg" if _KINDS[meaning] == "angle" else None
        values[meaning] = numbers * _UNITS[unit or default or _plain(_KINDS[meaning])][1]
    kinds = ["bearing", "ambiguous_bearing", "range", "frequency"]
    seen = {kind: values.pop(kind) for kind in kinds if kind in values}
    position = {"latitude", "longitude"} <= set(values) or {"east", "north"} <= set(values)
    if {"latitude", "longitude"} <= set(values):
        # Latitude and longitude are the record, a local plane is somebody's copy of it.
        if columns and {"east", "north"} & set(columns):
            values = {k: v for k, v in values.items() if k not in ("latitude", "longitude")}
        else:
            values = {k: v for k, v in values.items() if k not in ("east", "north")}
    if left := [name for name in table.header if name and name not in used]:
        notes.append(f"left out: {', '.join(left)}")
    if position:
        recording = _tracks(table, found, times, values, epoch, notes)
        if seen:
            return _with_sensors(recording, table, found, times, seen, "bearing" in (columns or {}))
        return recording
    if seen:
        return _sensors(table, found, times, seen, epoch, notes)
    raise InputError(
        f"{path}: no columns are recognised as a position (east and north, or latitude and "
        f"longitude) or a detection (bearing, range): its columns are {', '.join(table.header)}; "
        "name them with columns.east, columns.north (--column east=HEADING)"
    )


def _meanings(table: Table, columns: Mapping[str, str] | None) -> dict[str, str]:
    """Return what the columns hold: their headings by what they mean."""
    path = table.path
    found = {**guess(table.header), **dict(columns or {})}
    for meaning in found:
        if meaning not in COLUMNS:
            raise InputError(
                f"{path}: columns.{meaning}: is not known: must be one of {', '.join(COLUMNS)}"
            )
    if "time" not in found and "date" in found:
        found["time"] = found.pop("date")
    if "time" not in found:
        raise InputError(
            f"{path}: no column is recognised as the time: its columns are "
            f"{', '.join(table.header)}; name one with columns.time (--column time=HEADING)"
        )
    return found


def _tracks(
    table: Table,
    found: Mapping[str, str],
    times: Array,
    values: dict[str, Array],
    epoch: float | None,
    notes: list[str],
) -> Recording:
    names = _carriers(table, found)
    tracks = {}
    who = np.array(names)
    for name in dict.fromkeys(names):
        mine = who == name
        own = {key: column[mine] for key, column in values.items()}
        own = {
            k: v for k, v in own.items()
            if k in ("east", "north", "latitude", "longitude") or np.isfinite(v).any()
        }  # fmt: skip
        tracks[str(name)], said = track_of(str(name), times[mine], own, str(table.path))
        notes += said
    return Recording((table.path,), table.format, tracks, {}, epoch, None, tuple(notes))


def _carriers(table: Table, found: Mapping[str, str]) -> list[str]:
    """Return whose each row is: by its column, or by the name of the file."""
    return table[found["id"]] if "id" in found else [named(table.path).stem] * len(table.lines)


#: Bearings this near to the course, rad, are the course: phones call it so.
_AHEAD = 0.2


def _with_sensors(
    recording: Recording,
    table: Table,
    found: Mapping[str, str],
    times: Array,
    seen: dict[str, Array],
    told: bool,
) -> Recording:
    """Return tracks with what was seen from them, in the same rows.

    A column called bearing may be the course, unless `told` that it is none.
    """
    notes: list[str] = []
    if "bearing" in seen and not told and _is_course(recording, table, found, times, seen):
        notes.append(f"{found['bearing']} follows the track: taken as its course")
        del seen["bearing"]
    if not seen:
        return replace(recording, notes=(*recording.notes, *notes))
    carriers = _carriers(table, found)
    # One sensor on each, where nothing tells them apart.
    names = table[found["sensor"]] if "sensor" in found else carriers
    more = _sensors(table, found, times, seen, recording.epoch, notes, names, carriers)
    return replace(recording, sensors=more.sensors, notes=(*recording.notes, *more.notes))


def _is_course(
    recording: Recording,
    table: Table,
    found: Mapping[str, str],
    times: Array,
    seen: Mapping[str, Array],
) -> bool:
    """Say whether bearings point where their own track goes."""
    carriers = np.array(_carriers(table, found))
    off = []
    for name, track in recording.projected().tracks.items():
        mine = (carriers == name) & np.isfinite(times) & np.isfinite(seen["bearing"])
        moves = np.hypot(np.diff(track.east), np.diff(track.north)) > 0
        if track.times.size < 3 or not moves.any():
            continue
        at = np.clip(np.searchsorted(track.times, times[mine], "right"), 1, track.times.size - 1)
        east, north = track.east[at] - track.east[at - 1], track.north[at] - track.north[at - 1]
        clear = np.hypot(east, north) > 0
        off.append(np.abs(wrap_angles(np.arctan2(east, north) - seen["bearing"][mine]))[clear])
    away = np.concatenate(off) if off else np.empty(0)
    return away.size >= 3 and bool(np.median(away) < _AHEAD)


def _sensors(
    table: Table,
    found: Mapping[str, str],
    times: Array,
    values: dict[str, Array],
    epoch: float | None,
    notes: list[str],
    names: Sequence[str] | None = None,
    carriers: Sequence[str] | None = None,
) -> Recording:
    if names is None:
        stem = named(table.path).stem
        names = table[found["sensor"]] if "sensor" in found else [stem] * times.size
        carriers = table[found["id"]] if "id" in found else [""] * times.size
    of, whose = np.array(names), np.array(carriers)
    sensors = {}
    for name in dict.fromkeys(of.tolist()):
        mine = of == name
        on = sorted(set(whose[mine].tolist()))
        if len(on) > 1:
            raise InputError(f"{table.path}: sensor {name} is on {' and '.join(on)}")
        own = {key: column[mine] for key, column in values.items()}
        sensors[name], said = detections_of(name, on[0], times[mine], own, str(table.path))
        notes += said
    return Recording((table.path,), table.format, {}, sensors, epoch, None, tuple(notes))


def _geographic(cells: Sequence[str], place: str) -> Array:
    values = np.empty(len(cells))
    for i, cell in enumerate(cells):
        if _DECIMAL.fullmatch(cell):  # most of them, and long files
            values[i] = float(cell)
        else:
            values[i] = np.nan if cell.lower() in _MISSING else degrees(cell, f"{place}[{i}]")
    return values


#: Which letters tell the side that a latitude or a longitude is on.
_SIDES = {"latitude": {"n": 1.0, "s": -1.0}, "longitude": {"e": 1.0, "w": -1.0}}


def _hemisphere(table: Table, meaning: str, used: set[str]) -> str | None:
    """Return the column that says on which side of the equator or of Greenwich it is."""
    letters = _SIDES[meaning]
    found = []
    for name, cells in zip(table.header, table.columns, strict=True):
        if name in used or len(cells[0]) > 1:
            continue
        filled = {cell.lower() for cell in cells} - _MISSING
        if filled and filled <= set(letters):
            found.append(name)
    if len(found) > 1:
        raise InputError(
            f"{table.path}: {' and '.join(found)} may both be the hemisphere of the {meaning}: "
            "which one is it? Leave the other out"
        )
    return found[0] if found else None


def _whole(table: Table, meaning: str, heading: str, used: set[str]) -> None:
    """Refuse degrees whose minutes or seconds are in columns of their own."""
    for other in table.header:
        word, unit = _split(other)
        parted = unit is not None and _UNITS[unit][0] == "time"
        if other not in used and parted and word in COLUMNS[meaning]:
            raise InputError(
                f"{table.path}: {other!r} stands beside {heading!r}: are they the parts of one "
                f"{meaning}? Write it into one column (50 46 30)"
            )


def _sided(values: Array, table: Table, heading: str, sides: str) -> Array:
    letters = _SIDES["latitude"] | _SIDES["longitude"]
    signs = np.array([letters.get(cell.lower(), np.nan) for cell in table[sides]])
    if (wrong := np.flatnonzero(np.isfinite(values) & (values < 0))).size:
        row = int(wrong[0])
        raise InputError(
            f"{table.place(row, heading)} = {table[heading][row]} and {sides} = "
            f"{table[sides][row]}: has a sign and a hemisphere: must have one of them"
        )
    placed: Array = values * signs
    return placed


def _unit_of(
    meaning: str,
    heading: str,
    units: Mapping[str, str] | None,
    path: Path,
    asked: bool = True,
) -> str | None:
    """Return the unit of a column, None where it says none; an unknown one is `asked` about."""
    given = (units or {}).get(meaning)
    if given is None:
        unit = _split(heading)[1]
        bracket = re.search(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$", heading)
        if asked and unit is None and bracket:
            known = ", ".join(name for name, (kind, _) in _UNITS.items() if kind == _KINDS[meaning])
            raise InputError(
                f"{path}: {heading!r}: {bracket.group(1)!r} is no unit of {meaning} that is known: "
                f"say units.{meaning}, one of {known}"
            )
        return unit if unit is not None and _UNITS[unit][0] == _KINDS[meaning] else None
    allowed = [name for name, (kind, _) in _UNITS.items() if kind == _KINDS.get(meaning)]
    if given.lower() not in allowed:
        known = ", ".join(allowed)
        raise InputError(f"{path}: units.{meaning} = {given!r}: must be one of {known}")
    return given.lower()


def _plain(kind: str) -> str:
    return {"length": "m", "speed": "mps", "frequency": "hz", "time": "s"}[kind]


def _separator(line: str) -> str:
    counts = {sign: line.count(sign) for sign in ("\t", ";", "|", ",")}
    best = max(counts, key=lambda sign: counts[sign])
    if counts[best]:
        return best
    return " " if len(line.split()) > 1 else ","


def _named(separator: str) -> str:
    return {"\t": "tabs", ";": "semicolons", "|": "bars", " ": "blanks"}.get(
        separator, repr(separator)
    )


def _number_like(cell: str) -> bool:
    """Say whether a cell is a number or a date, and so no heading."""
    if re.fullmatch(r"[+-]?\d[\d.,:/ -]*(T\d[\d.,:]*)?(Z|[+-]\d\d:?\d\d)?", cell):
        return True
    try:
        float(cell)
    except ValueError:
        return False
    return True
