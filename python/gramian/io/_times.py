"""Instants as files write them: ISO 8601, UNIX seconds, clock times, plain seconds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from gramian._arrays import number
from gramian.exceptions import InputError

__all__ = ["CLOCK", "instants", "unix", "utc"]

Array = NDArray[np.float64]

#: Seconds since 1970 from 2000 to 2100: what is taken for UNIX time.
_UNIX = (9.4e8, 4.2e9)
#: A time of day.
CLOCK = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:\.\d*)?))?\s*([AaPp][Mm])?$")
#: Two numbers, of which the first may be hours or minutes.
_SHORT = re.compile(r"\d{1,3}:\d{2}(?:\.\d*)?$")
#: 01.05.2026 12:00:00, 5/1/26 3:00 PM: the order of day and month is a convention.
_LOCAL = re.compile(r"(\d{1,2})([./-])(\d{1,2})\2(\d{4}|\d{2})(?:[ T]+(.*))?$")
#: Days since year 0 and since 1900 of the years 1970 to 2100: what a spreadsheet counts.
_DAYS = ((25_569.0, 73_050.0), (719_529.0, 767_010.0))
_DAY = 86_400.0


def utc(seconds: float) -> str:
    """Return UNIX seconds as a date and time of day.

    Raises
    ------
    InputError
        What is no number, and years beyond 1 to 9999.

    Examples
    --------
    >>> utc(86400.25)
    '1970-01-02T00:00:00.25Z'
    """
    seconds = number(seconds, "seconds")
    try:
        moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)
    except OverflowError:
        raise InputError(f"seconds = {seconds:g}: must be of the years 1 to 9999") from None
    text = moment.strftime("%Y-%m-%dT%H:%M:%S")
    part = f"{seconds % 1:.3f}"[1:].rstrip("0").rstrip(".")
    return f"{text}{part}Z"


def unix(moment: datetime) -> float:
    """Return a moment as UNIX seconds; without a zone it is taken as UTC."""
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    return (moment - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds()


def instants(
    cells: Sequence[str], place: str, order: str | None = None, unit: str | None = None
) -> tuple[Array, bool, str]:
    """Return a column of instants as seconds.

    Parameters
    ----------
    cells : sequence of str
        As the file has them; an empty cell is a missing sample and becomes NaN.
    place : str
        What to call the column in an error: "ships.csv: time".
    order : {"day first", "month first"}, optional
        Of dates such as 01/05/2026.
    unit : str, optional
        "hh:mm" or "mm:ss" for times such as 12:30.

    Returns
    -------
    seconds : ndarray
        Since 1970 where the column has dates, else as they are written.
    dated : bool
        Whether they are UNIX seconds.
    note : str
        How the column was read; empty for plain seconds.

    Raises
    ------
    InputError
        A cell that is none of these, and columns that mix them or mix times with and
        without a zone.
    """
    texts = [cell.strip() for cell in cells]
    filled = [text for text in texts if text]
    if not filled:
        raise InputError(f"{place}: every cell is empty")
    if all(_SHORT.match(text) for text in filled):
        if unit == "mm:ss":
            pairs = [text.split(":") if text else ("nan", "nan") for text in texts]
            return np.array([60 * float(m) + float(s) for m, s in pairs]), False, "mm:ss"
        if unit not in ("hh:mm", "hh:mm:ss"):
            raise InputError(
                f"{place} = {filled[0]!r}: hours and minutes, or minutes and seconds? "
                'Say units = { time = "hh:mm" } or "mm:ss", or name the column so: time [mm:ss]'
            )
    if all(CLOCK.match(text) for text in filled):
        return _clock(texts, place), False, "clock times, counted over midnight"
    if _is_number(filled[0]):
        values = np.array([_seconds(text, i, place) for i, text in enumerate(texts)])
        return _numeric(values, place)
    if _LOCAL.match(filled[0]):
        texts, said = _iso(texts, place, order)
        return _dates(texts, place), True, f"dates and times, {said}"
    return _dates(texts, place), True, "dates and times"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _seconds(text: str, i: int, place: str) -> float:
    if not text:
        return np.nan
    try:
        return float("" if "_" in text else text)
    except ValueError:
        raise InputError(
            f"{place}[{i}] = {text[:60]!r}: must be a number of seconds, as the cells before it"
        ) from None


def _numeric(values: Array, place: str) -> tuple[Array, bool, str]:
    known = values[np.isfinite(values)]
    if np.isinf(values).any():
        raise InputError(f"{place}: a time is infinite")
    low, high = float(known.min()), float(known.max())
    for factor, unit in ((1.0, "seconds"), (1e3, "milliseconds"), (1e6, "microseconds")):
        if _UNIX[0] * factor <= low and high <= _UNIX[1] * factor:
            return values / factor, True, f"UNIX {unit}"
    if any(
        first <= low and high <= last and high - low < 1000 and np.any(known % 1)
        for first, last in _DAYS
    ):
        raise InputError(
            f"{place} is from {low} to {high}: this looks like the day numbers of a spreadsheet. "
            "Write dates (2026-05-01T12:00:00Z) or seconds"
        )
    return values, False, ""


def _clock(texts: Sequence[str], place: str) -> Array:
    seconds, days, last = [], 0.0, -np.inf
    for i, text in enumerate(texts):
        if not text:
            seconds.append(np.nan)
            continue
        match = CLOCK.match(text)
        moment = _of_day(match) if match else np.nan
        if np.isnan(moment):
            raise InputError(f"{place}[{i}] = {text!r}: is not a time of day (HH:MM:SS)")
        # Half a day back is midnight passed; less is a report out of order.
        if moment + days < last - _DAY / 2:
            days += _DAY
        last = max(last, moment + days)
        seconds.append(moment + days)
    return np.array(seconds)


def _of_day(match: re.Match[str]) -> float:
    """Return a time of day in seconds, NaN for one that there is not."""
    hours, minutes, rest = (float(part or 0) for part in match.groups()[:3])
    half = (match.group(4) or "").lower()
    if half:
        if not 1 <= hours <= 12:
            return float("nan")
        hours = hours % 12 + (12 if half == "pm" else 0)
    if hours > 23 or minutes > 59 or rest >= 61:
        return float("nan")
    return 3600 * hours + 60 * minutes + rest


def _iso(texts: Sequence[str], place: str, order: str | None) -> tuple[list[str], str]:
    """Return dates such as 01.05.2026 as ISO 8601 has them, and how they were read."""
    found = [_LOCAL.match(text) for text in texts]
    parts = [match.groups() for match in found if match]
    for text, match in zip(texts, found, strict=True):
        if text and match is None:
            raise InputError(f"{place} = {text!r}: must be a date as the others, {parts[0]}")
    first, second = (max(int(part[k]) for part in parts) for k in (0, 2))
    if order is None:
        if first > 12 or parts[0][1] == ".":
            order = "day first"
        elif second > 12:
            order = "month first"
        else:
            text = next(text for text in texts if text)
            raise InputError(
                f"{place} = {text!r}: is the day or the month first? "
                'Say dates = "day first" or "month first"'
            )
    out = []
    for match in found:
        if match is None:
            out.append("")
            continue
        one, _, two, year, rest = match.groups()
        day, month = (one, two) if order == "day first" else (two, one)
        # As the maritime formats have it: 70 to 99 are of the last century.
        year = year if len(year) == 4 else ("19" if int(year) >= 70 else "20") + year
        clock = CLOCK.match((rest or "").strip())
        if clock and clock.group(4) and not np.isnan(moment := _of_day(clock)):
            rest = f"{int(moment // 3600):02d}:{int(moment % 3600 // 60):02d}:{moment % 60:09.6f}"
        elif clock:
            rest = clock.group(0).zfill(8 if clock.group(3) else 5)
        out.append(f"{year}-{int(month):02d}-{int(day):02d}" + (f"T{rest}" if rest else ""))
    return out, order


def _moment(text: str) -> datetime:
    """Return a date; a leap second is the second after the one before it."""
    text = text.replace("/", "-")
    if re.search(r"T?\d{2}:\d{2}:60", text):
        return datetime.fromisoformat(text.replace(":60", ":59")) + timedelta(seconds=1)
    return datetime.fromisoformat(text)


def _dates(texts: Sequence[str], place: str) -> Array:
    seconds, zoned = [], None
    for i, text in enumerate(texts):
        if not text:
            seconds.append(np.nan)
            continue
        try:
            moment = _moment(text)
        except ValueError:
            raise InputError(
                f"{place}[{i}] = {text!r}: must be seconds, a date and time "
                "(2026-05-01T12:00:00Z) or a time of day (12:00:00)"
            ) from None
        if zoned is not None and zoned != (moment.tzinfo is not None):
            raise InputError(
                f"{place}[{i}] = {text!r}: some times have a zone and some have none: "
                "give all of them one"
            )
        zoned = moment.tzinfo is not None
        seconds.append(unix(moment))
    return np.array(seconds)
