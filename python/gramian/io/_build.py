"""From samples as they stand in a file to tracks and detections in order."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gramian.exceptions import InputError
from gramian.io._recording import Detections, Track

__all__ = ["KNOT", "YARD", "detections_of", "epoch_of", "track_of"]

Array = NDArray[np.float64]

#: m/s
KNOT = 1852 / 3600
#: m
YARD = 0.9144


def epoch_of(times: Array) -> float:
    """Return the whole UNIX second from which a recording counts."""
    return float(np.floor(times[np.isfinite(times)].min()))


def track_of(
    name: str, times: Array, columns: Mapping[str, Array], place: str
) -> tuple[Track, list[str]]:
    """Return a track in order of time, and what was left out of it.

    Samples without a time or a position are left out; so is a second report of the same
    instant at the same place.

    Raises
    ------
    InputError
        Two places at one instant, a clock set back by an hour, and a track without a single
        position.
    """
    position = ("latitude", "longitude") if "latitude" in columns else ("east", "north")
    placed = np.isfinite(columns[position[0]]) & np.isfinite(columns[position[1]])
    good = np.isfinite(times) & placed
    notes = []
    if not good.all():
        left_out = int((~good).sum())
        notes.append(f"{name}: {left_out} of {good.size} reports have no time or no position")
    if not good.any():
        raise InputError(f"{place}: {name} has no report with a time and a position")
    order = np.flatnonzero(good)[np.argsort(times[good], kind="stable")]
    t = times[order]
    _clock_set_back(name, times[good], place)
    if (np.diff(times[good]) < 0).any():
        notes.append(f"{name}: reports were not in order of time, and have been sorted")
    again = np.flatnonzero(np.diff(t) == 0)
    for i in again:
        if any(columns[key][order[i]] != columns[key][order[i + 1]] for key in position):
            raise InputError(f"{place}: {name} is at two places at {t[i]:.10g} s")
    if again.size:
        notes.append(f"{name}: {_count(again.size, 'report')} came twice")
        order = np.delete(order, again + 1)
        t = times[order]
    values = {key: column[order] for key, column in columns.items()}
    if "east" not in values:
        values["east"] = values["north"] = np.full(t.size, np.nan)
    return Track(name, t, **values), notes


def _clock_set_back(name: str, times: Array, place: str) -> None:
    """Ask about reports that go on an hour earlier, as local time does in autumn."""
    steps = np.diff(times)
    back = np.flatnonzero(steps < 0)
    if back.size != 1 or times.size < 6:
        return
    usual = float(np.median(steps[steps > 0]))
    if 0 < steps[back[0]] + 3600.0 <= 3 * usual:
        raise InputError(
            f"{place}: {name} goes on an hour earlier after {times[back[0]]:.10g} s: was the clock "
            "set back? Give the times in UTC or with a zone; if it was not, sort the lines by time"
        )


def detections_of(
    sensor: str, carrier: str, times: Array, columns: Mapping[str, Array], place: str
) -> tuple[Detections, list[str]]:
    """Return detections in order of time, and what was left out of them.

    Raises
    ------
    InputError
        A sensor without a single detection, or two that differ at one instant.
    """
    seen = np.zeros(times.size, dtype=bool)
    for column in columns.values():
        seen |= np.isfinite(column)
    good = np.isfinite(times) & seen
    notes = []
    if not good.all():
        left_out = int((~good).sum())
        notes.append(f"sensor {sensor}: {left_out} of {good.size} lines hold no detection")
    if not good.any():
        raise InputError(f"{place}: sensor {sensor} has no detection with a time")
    order = np.flatnonzero(good)[np.argsort(times[good], kind="stable")]
    t = times[order]
    again = np.flatnonzero(np.diff(t) == 0)
    for i in again:
        for column in columns.values():
            first, second = column[order[i]], column[order[i + 1]]
            if first != second and not (np.isnan(first) and np.isnan(second)):
                raise InputError(f"{place}: sensor {sensor} has two detections at {t[i]:.10g} s")
    if again.size:
        notes.append(f"sensor {sensor}: {_count(again.size, 'detection')} came twice")
        order = np.delete(order, again + 1)
    kept = {k: c[order] for k, c in columns.items() if np.isfinite(c[order]).any()}
    return Detections(sensor, carrier, times[order], **kept), notes


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
