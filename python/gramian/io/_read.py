"""Reading a file of any format."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from datetime import datetime
from os import PathLike
from pathlib import Path
from typing import Any

from gramian import _options as options
from gramian._arrays import whole
from gramian._files import read_text, read_whole
from gramian.exceptions import InputError
from gramian.io import _gpx, _kml, _nmea, _rep, _slips, _table
from gramian.io._recording import Recording, merged
from gramian.io._table import Table, named
from gramian.io._times import unix

__all__ = ["FORMATS", "joined", "read", "table", "unix_seconds"]

#: Format -> what it is, by which library, what is read, what is left out.
FORMATS: dict[str, tuple[str, str, str, str]] = {
    "csv": (
        "table with a header",
        "csv (standard library)",
        "positions, detections, or both; any separator, decimal commas, dates, UNIX and clock "
        "times, degrees-minutes-seconds, hemispheres",
        "columns that are not named or recognised (named in a note), lines of comments (#)",
    ),
    "parquet": (
        "Parquet, Feather (Arrow)",
        "pyarrow",
        "as csv",
        "nested columns",
    ),
    "gpx": ("GPX 1.0, 1.1", "gpxpy", "tracks with times, elevation", "routes, waypoints"),
    "kml": (
        "KML 2.2",
        "xml.etree (standard library)",
        "gx:Track, placemarks with a time stamp",
        "paths without times, styles",
    ),
    "nmea": (
        "NMEA 0183, AIS",
        "pyais",
        "RMC and GGA of own ship; AIS position reports (types 1-3, 18, 19) and names",
        "all other sentences, wrong checksums (counted)",
    ),
    "rep": (
        ".rep, .dsf of a maritime analysis tool",
        "read here",
        "tracks; ;SENSOR: and ;SENSOR2: lines with ambiguous bearings, frequencies, ranges",
        "annotations, shapes (counted)",
    ),
}

#: What pyarrow reads.
BINARY = (".parquet", ".feather", ".arrow")


def read(
    *paths: Path | str | Any,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    separator: str | None = None,
    decimal: str | None = None,
    dates: str | None = None,
    trust: Collection[str] = (),
    size_limit: int | None = None,
) -> Recording:
    r"""Read files of tracks and measurements, packed by gzip or not.

    Parameters
    ----------
    *paths : path or frame
        One or more files; what is in them is put on one clock and in one plane. A frame of
        pandas or polars, a table of pyarrow or a dataset of xarray stands for a table; the
        attribute ``units`` of a variable counts as a unit in its heading.
    columns : mapping of str to str, optional
        For tables: what a column holds ("time", "east", "north", "latitude", "longitude",
        "height", "speed", "course", "bearing", "range", "frequency", "id", "sensor") ->
        its heading. Headings that say it themselves ("lat", "t_s", "Speed (kn)") are found.
    units : mapping of str to str, optional
        For tables: what a column holds -> its unit, where the heading does not end in it.
    separator, decimal : str, optional
        For tables: what separates cells, and the decimal sign; found where not given.
    dates : {"day first", "month first"}, optional
        For tables: the order in dates such as 01/05/2026, where it does not show itself.
    trust : collection of str
        Checks for slips to leave out: "units", "speed", "course", "missing", "bearings",
        "clock".
    size_limit : int, optional
        Bytes; a larger file is refused. By default 512 MiB.

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        A file that cannot be read, with line and cell; slips, with the question.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from gramian import io
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "ship.csv"
    >>> _ = path.write_text("t_s;lat;lon\n0;50,0;-1,0\n60;50,001;-1,0\n120;50,002;-1,0\n")
    >>> recording = io.read(path)
    >>> recording.track("ship").north.round(1).tolist()
    [-111.2, 0.0, 111.2]
    """
    if not paths:
        raise InputError("read was given no file")
    columns = options.mapping(columns, "columns", "what a column holds to its heading")
    units = options.mapping(units, "units", "what a column holds to its unit")
    for name, strings in (("columns", columns), ("units", units)):
        for key, value in strings.items():
            if not isinstance(value, str):
                raise InputError(f"{name} of {key} = {options.given(value)}: must be a string")
    separator, decimal = _signs(separator, decimal)
    if size_limit is not None:
        size_limit = whole(size_limit, "size_limit", 1)
    if dates is not None:
        options.choice(dates, "dates", ("day first", "month first"))
    found = []
    for i, given in enumerate(paths):
        frame = _table.of_frame(given, "frame" if len(paths) == 1 else f"frame {i + 1}")
        if frame is not None:
            found.append(_table.recording_of(frame, columns, units, dates))
            continue
        if not isinstance(given, (str, PathLike)):
            raise InputError(
                f"{options.given(given)}: must be a path, or a frame of pandas, polars, pyarrow "
                "or xarray"
            )
        found.append(_one(Path(given), columns, units, separator, decimal, dates, size_limit))
    return joined(found, trust)


def joined(recordings: Sequence[Recording], trust: Collection[str] = ()) -> Recording:
    """Return recordings as one, on one clock and in one plane, checked for slips."""
    given = options.sequence(recordings, "recordings", "recordings that `read` returned")
    if not given:
        raise InputError("recordings is empty: there must be at least one")
    for i, one in enumerate(given):
        options.instance(one, Recording, f"recordings[{i}]", "a recording that `read` returned")
    recording = merged(given)
    _slips.check(recording, _trusted(trust))
    return recording


def unix_seconds(date: str) -> float:
    """Return a date and time (ISO 8601; UTC where no zone is given) as UNIX seconds.

    Raises
    ------
    InputError
        What is no date.

    Examples
    --------
    >>> unix_seconds("1970-01-02")
    86400.0
    """
    try:
        return unix(datetime.fromisoformat(date))
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"date = {options.given(date)}: must be as ISO 8601 has it") from error


def _one(
    path: Path,
    columns: Mapping[str, str] | None,
    units: Mapping[str, str] | None,
    separator: str | None,
    decimal: str | None,
    dates: str | None,
    size_limit: int | None,
) -> Recording:
    suffix = named(path).suffix.lower()
    text = _text(path, size_limit)
    if text is None:
        return _table.recording_of(_table.read_parquet(path), columns, units, dates)
    if suffix == ".g2o":
        raise InputError(f"{path} is a pose graph: read_graph and `gramian analyze` take it")
    if suffix == ".gpx" or "<gpx" in text[:2000]:
        return _gpx.read(path, text)
    if suffix == ".kml" or "<kml" in text[:2000]:
        return _kml.read(path, text)
    if suffix in (".rep", ".dsf") or _rep.looks_like(text):
        return _rep.read(path, text)
    if suffix in (".nmea", ".ais") or _nmea.looks_like(text):
        return _nmea.read(path, text)
    if suffix in (".json", ".geojson") or text.lstrip().startswith(("{", "[{")):
        raise InputError(f"{path}: is JSON, which is not read: save it as CSV, GPX or KML")
    cells = _table.read_table(path, text, separator=separator, decimal=decimal)
    return _table.recording_of(cells, columns, units, dates)


def table(path: Path | str, *, separator: str | None = None, decimal: str | None = None) -> Table:
    r"""Read a table with a header, CSV in any form or Parquet, as the text of its cells.

    Parameters
    ----------
    path : path
    separator, decimal : str, optional
        Found where not given.

    Raises
    ------
    InputError
        A file that cannot be read, rows of another length than the header.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from gramian import io
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "field.csv"
    >>> _ = path.write_text("t;x_uT\n0;1,5\n1;\n")
    >>> io.table(path).numbers("x_uT").tolist()
    [1.5, nan]
    """
    path = Path(options.path(path))
    separator, decimal = _signs(separator, decimal)
    text = _text(path, None)
    if text is None:
        return _table.read_parquet(path)
    return _table.read_table(path, text, separator=separator, decimal=decimal)


def _signs(separator: str | None, decimal: str | None) -> tuple[str | None, str | None]:
    """Return what separates cells, and the decimal sign."""
    if separator is not None and not (isinstance(separator, str) and len(separator) == 1):
        raise InputError(f"separator = {options.given(separator)}: must be one character")
    return separator, None if decimal is None else options.choice(decimal, "decimal", (".", ","))


def _trusted(trust: Collection[str]) -> tuple[str, ...]:
    if isinstance(trust, (set, frozenset)):
        trust = sorted(trust, key=str)
    return options.names(trust, "trust", "checks")


def _text(path: Path, size_limit: int | None) -> str | None:
    """Return the text of a file; None for a Parquet file that may be read."""
    try:
        if path.suffix.lower() in BINARY:
            read_whole(path, size_limit)
            return None
        return read_text(path, size_limit)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error}") from error


def select(recording: Recording, names: Sequence[str]) -> Recording:
    """Return a recording with some of its tracks, and the sensors on them."""
    from dataclasses import replace

    tracks = {name: recording.track(name) for name in names}
    sensors = {k: d for k, d in recording.sensors.items() if d.carrier in tracks or not d.carrier}
    return replace(recording, tracks=tracks, sensors=sensors)
