"""The replay format of a maritime analysis tool: tracks (.rep) and sensors (.dsf).

A line of a track is date, time, name, symbol, latitude and longitude in degrees,
minutes and seconds, course in degrees, speed in knots, depth in metres. A line that
starts with ``;SENSOR:`` has date, time, carrier, symbol, a place or NULL, bearing in
degrees, range in yards and the name of the sensor; ``;SENSOR2:`` has the ambiguous
bearing and the frequency in Hz after the bearing. NULL stands for what was not measured.
Other lines that start with a semicolon are annotations and are left out.
"""

from __future__ import annotations

import re
import shlex
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from gramian.exceptions import InputError
from gramian.io._build import KNOT, YARD, detections_of, epoch_of, track_of
from gramian.io._recording import Recording
from gramian.io._times import unix

__all__ = ["looks_like", "read"]

_SENSOR = re.compile(r";SENSOR(2?):?$", re.IGNORECASE)


def looks_like(text: str) -> bool:
    """Say whether a file is of this format: by its first line that is not blank."""
    for line in text.splitlines():
        if line.strip():
            return bool(re.match(r"\s*(;;?[A-Z]|(\d{6}|\d{8})\s+\d{6})", line))
    return False


def read(path: Path, text: str) -> Recording:
    """Read a file of tracks, of sensors, or of both."""
    tracks: dict[str, list[tuple[float, ...]]] = {}
    sensors: dict[str, tuple[str, list[tuple[float, ...]]]] = {}
    left_out: dict[str, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        place = f"{path}:{number}"
        fields = _fields(line, place)
        sensor = _SENSOR.match(fields[0])
        if sensor:
            name, carrier, sample = _detection(fields[1:], bool(sensor.group(1)), place)
            if sensors.setdefault(name, (carrier, []))[0] != carrier:
                raise InputError(
                    f"{place}: sensor {name} is on {carrier}, and on {sensors[name][0]} before"
                )
            sensors[name][1].append(sample)
        elif fields[0].startswith(";"):
            left_out[fields[0]] = left_out.get(fields[0], 0) + 1
        else:
            name, report = _report(fields, place)
            tracks.setdefault(name, []).append(report)
    if not tracks and not sensors:
        raise InputError(f"{path}: has no track and no sensor line")
    notes = [f"{count} lines {kind} left out" for kind, count in left_out.items()]
    # The hours of all samples, for the time 0 they share.
    samples = [s for rows in tracks.values() for s in rows]
    samples += [s for _, rows in sensors.values() for s in rows]
    epoch = epoch_of(np.array([s[0] for s in samples]))
    built, seen = {}, {}
    for name, rows in tracks.items():
        t, latitude, longitude, course, speed, depth = np.array(rows).T
        columns = {
            "latitude": latitude,
            "longitude": longitude,
            "course": np.radians(course),
            "speed": speed * KNOT,
            "height": -depth,
        }
        built[name], said = track_of(name, t - epoch, columns, str(path))
        notes += said
    for name, (carrier, rows) in sensors.items():
        t, bearing, ambiguous, frequency, distance = np.array(rows).T
        columns = {
            "bearing": np.radians(bearing),
            "ambiguous_bearing": np.radians(ambiguous),
            "frequency": frequency,
            "range": distance * YARD,
        }
        seen[name], said = detections_of(name, carrier, t - epoch, columns, str(path))
        notes += said
        known = bearing[np.isfinite(bearing)]
        if known.size > 4 and not np.any(known % 1):
            notes.append(f"sensor {name}: bearings are whole degrees")
    return Recording((path,), "rep", built, seen, epoch, None, tuple(notes))


def _fields(line: str, place: str) -> list[str]:
    try:
        # Names with blanks stand in quotes.
        words = shlex.shlex(line, posix=True)
        words.whitespace_split, words.commenters, words.quotes = True, "", '"'
        return list(words)
    except ValueError:
        raise InputError(f"{place}: a quotation mark is not closed") from None


def _report(fields: list[str], place: str) -> tuple[str, tuple[float, ...]]:
    if len(fields) < 14:
        raise InputError(
            f"{place}: has {len(fields)} fields: a line of a track has at least 14 (date, time, "
            "name, symbol, latitude, longitude, course, speed)"
        )
    depth = _value(fields[14], "depth", place) if len(fields) > 14 else np.nan
    return fields[2].strip(), (
        _moment(fields[0], fields[1], place),
        _geographic(fields[4:8], "NS", 90, place),
        _geographic(fields[8:12], "EW", 180, place),
        _value(fields[12], "course", place),
        _value(fields[13], "speed", place),
        depth,
    )


def _detection(
    fields: list[str], ambiguous: bool, place: str
) -> tuple[str, str, tuple[float, ...]]:
    # The place of the sensor is NULL, or eight fields.
    where = 1 if len(fields) > 4 and fields[4].upper() == "NULL" else 8
    first = 4 + where
    count = 4 if ambiguous else 2
    if len(fields) < first + count + 1:
        raise InputError(
            f"{place}: has {len(fields)} fields after its keyword: must have at least "
            f"{first + count + 1} (date, time, carrier, symbol, place or NULL, bearing, "
            + ("ambiguous bearing, frequency, " if ambiguous else "")
            + "range, sensor)"
        )
    names = ["bearing", "ambiguous bearing", "frequency", "range"] if ambiguous else [
        "bearing", "range",
    ]  # fmt: skip
    values = [
        _value(text, name, place)
        for text, name in zip(fields[first : first + count], names, strict=True)
    ]
    bearing, other, frequency, distance = (
        values if ambiguous else [values[0], np.nan, np.nan, values[1]]
    )
    for name, angle in (("bearing", bearing), ("ambiguous bearing", other)):
        if abs(angle) > 360:
            raise InputError(f"{place}: {name} {angle:g} deg: must be within +-360")
    if distance < 0:
        raise InputError(f"{place}: range {distance:g} yards: must be >= 0")
    sample = (_moment(fields[0], fields[1], place), bearing, other, frequency, distance)
    return fields[first + count].strip(), fields[2].strip(), sample


def _moment(date: str, time: str, place: str) -> float:
    # Two digits of the year, or four.
    if not re.fullmatch(r"\d{6}|\d{8}", date):
        raise InputError(f"{place}: date {date!r}: must be YYMMDD or YYYYMMDD")
    if not re.fullmatch(r"\d{6}(\.\d*)?", time):
        raise InputError(f"{place}: time {time!r}: must be HHMMSS or HHMMSS.SSS")
    layout = "%Y%m%d" if len(date) == 8 else "%y%m%d"
    try:
        day = datetime.strptime(date, layout).replace(tzinfo=UTC)
        clock = timedelta(hours=int(time[:2]), minutes=int(time[2:4]), seconds=float(time[4:]))
    except ValueError:
        raise InputError(f"{place}: {date} {time}: is not a date") from None
    if int(time[:2]) > 23 or int(time[2:4]) > 59 or float(time[4:]) >= 61:
        raise InputError(f"{place}: time {time!r}: is not a time of day")
    return unix(day + clock)


def _geographic(parts: list[str], letters: str, limit: int, place: str) -> float:
    *numbers, letter = parts
    what = "latitude" if letters == "NS" else "longitude"
    if letter.upper() not in tuple(letters):
        raise InputError(f"{place}: {what} ends in {letter!r}: must be {' or '.join(letters)}")
    whole, minutes, seconds = (_value(text, what, place) for text in numbers)
    value = whole + minutes / 60 + seconds / 3600
    if not 0 <= value <= limit or minutes >= 60 or seconds >= 60:
        raise InputError(f"{place}: {what} {' '.join(parts)}: must be within {limit} deg")
    return -value if letter.upper() in "SW" else value


def _value(text: str, name: str, place: str) -> float:
    if text.upper() in ("NULL", "NAN"):
        return float("nan")
    try:
        value = float(text)
    except ValueError:
        raise InputError(
            f"{place}: {name} = {text[:60]!r}: must be a number, NULL or NaN"
        ) from None
    if not np.isfinite(value):
        raise InputError(f"{place}: {name} = {text[:60]}: must be finite")
    return value
