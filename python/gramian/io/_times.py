"""Instants as files write them: ISO 8601, UNIX seconds, clock times, plain seconds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from gramian._arrays import number
from gramian.exceptions import InputError

__all__ = ["instants", "unix", "utc"]

Array = NDArray[np.float64]

#: Seconds since 1970 from 2000 to 2100: what is taken for UNIX time.
_UNIX = (9.4e8, 4.2e9)
_CLOCK = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:\.\d*)?))?$")
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


def instants(cells: Sequence[str], place: str) -> tuple[Array, bool, str]:
    """Return a column of instants as seconds.

    Parameters
    ----------
    cells : sequence of str
        As the file has them; an empty cell is a missing sample and becomes NaN.
    place : str
        What to call the column in an error: "ships.csv: time".

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
    if all(_CLOCK.match(text) for text in filled):
        return _clock(texts, place), False, "clock times, counted over midnight"
    if _is_number(filled[0]):
        values = np.array([_seconds(text, i, place) for i, text in enumerate(texts)])
        return _numeric(values, place)
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
            f"{place}[{i}] = {text!r}: must be a number of seconds, as the cells before it"
        ) from None


def _numeric(values: Array, place: str) -> tuple[Array, bool, str]:
    known = values[np.isfinite(values)]
    if np.isinf(values).any():
        raise InputError(f"{place}: a time is infinite")
    low, high = float(known.min()), float(known.max())
    for factor, unit in ((1.0, "seconds"), (1e3, "milliseconds"), (1e6, "microseconds")):
        if _UNIX[0] * factor <= low and high <= _UNIX[1] * factor:
            return values / factor, True, f"UNIX {unit}"
    if low > 3.6e4 and high < 7.4e4 and high - low < 1000 and np.any(known % 1):
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
        match = _CLOCK.match(text)
        hours, minutes, rest = (float(part or 0) for part in match.groups()) if match else (99,) * 3
        if hours > 23 or minutes > 59 or rest >= 61:
            raise InputError(f"{place}[{i}] = {text!r}: is not a time of day (HH:MM:SS)")
        moment = 3600 * hours + 60 * minutes + rest
        # Half a day back is midnight passed; less is a report out of order.
        if moment + days < last - _DAY / 2:
            days += _DAY
        last = max(last, moment + days)
        seconds.append(moment + days)
    return np.array(seconds)


def _dates(texts: Sequence[str], place: str) -> Array:
    seconds, zoned = [], None
    for i, text in enumerate(texts):
        if not text:
            seconds.append(np.nan)
            continue
        try:
            moment = datetime.fromisoformat(text.replace("/", "-"))
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
