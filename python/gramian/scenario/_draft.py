"""From files of tracks and measurements to a scenario: its text, and the scenario itself."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from gramian.exceptions import InputError
from gramian.io import Detections, Recording, Track, read, unix_seconds
from gramian.io.fields import FieldTable
from gramian.scenario._load import parsed
from gramian.scenario.base import Scenario

__all__ = ["Choices", "draft", "draft_of_field", "from_files"]


@dataclass(frozen=True)
class Choices:
    """What a recording cannot say by itself.

    Attributes
    ----------
    observer, target, sensor : str or None
        Tracks, and the sensor whose bearings are used.
    sigma_deg : float or None
        Standard deviation of the bearings, degrees.
    start : float, str or None
        Start of the window: s as the files count them, a date, or "+600" for s from the
        first instant that is shared.
    duration, step : float or None
        s.
    dates : {"day first", "month first"} or None
        The order in dates such as 01/05/2026.
    column : mapping of str to str, or None
        What a column holds -> its heading, where the headings do not say it.
    """

    observer: str | None = None
    target: str | None = None
    sensor: str | None = None
    sigma_deg: float | None = None
    start: float | str | None = None
    duration: float | None = None
    step: float | None = None
    dates: str | None = None
    column: Mapping[str, str] | None = None

    @property
    def given(self) -> list[str]:
        """The names of those that were given."""
        return [f.name for f in fields(self) if getattr(self, f.name) is not None]


def from_files(paths: Sequence[Path], choices: Choices) -> Scenario:
    """Return the scenario of files of tracks and measurements, without one of its own."""
    recording = read(*paths, columns=choices.column, dates=choices.dates)
    scenario = parsed(draft(recording, choices), Path(recording.where))
    scenario.take(recording)
    return scenario


def draft(recording: Recording, choices: Choices, folder: Path | None = None) -> str:
    """Return the text of a scenario for a recording.

    Parameters
    ----------
    recording : Recording
    choices : Choices
    folder : Path, optional
        Where the scenario will be; its files are named relative to it.

    Raises
    ------
    InputError
        Where the observer or the bearings' accuracy is open, with what there is to choose.
    """
    # What no file says cannot be named by a line of one.
    for name, value, most in (
        ("sigma-deg", choices.sigma_deg, 90.0),
        ("duration", choices.duration, np.inf),
        ("step", choices.step, np.inf),
    ):
        if value is not None and not 0 < value < most:
            limit = "a number > 0" if most == np.inf else f"between 0 and {most:g}"
            raise InputError(f"--{name} = {value}: must be {limit}")
    sensor = _sensor(recording, choices)
    observer = _observer(recording, choices, sensor)
    target = _target(recording, choices, observer, sensor)
    start, duration, step = _window(recording, choices, observer, target, sensor)
    if choices.sigma_deg is None:
        raise InputError(
            "the standard deviation of the bearings is not in the files: give it in degrees "
            "(--sigma-deg)"
        )
    files = [_relative(path, folder) for path in recording.paths]
    shown = json.dumps(files[0] if len(files) == 1 else files)
    lines = [
        'model = "bearings"',
        "",
        "[tracks]",
        f"file = {shown}",
        f"observer = {json.dumps(observer.name)}",
    ]
    if target is not None:
        lines.append(f"target = {json.dumps(target.name)}")
    if choices.column:
        named = ", ".join(f"{what} = {json.dumps(name)}" for what, name in choices.column.items())
        lines.append(f"columns = {{ {named} }}")
    if choices.dates is not None:
        lines.append(f"dates = {json.dumps(choices.dates)}")
    gap = max(_longest_gap(track) for track in (observer, target) if track is not None)
    if gap > 120:
        lines.append(f"max_gap = {np.ceil(gap):.0f}.0        # s; the longest gap of these tracks")
    if sensor is not None:
        lines += ["", "[bearings]", f"sensor = {json.dumps(sensor.sensor)}"]
    lines += [
        "",
        "[window]",
        f"start = {_number(start)}  # {recording.when(start)}",
        f"duration = {_number(duration)}  # s",
    ]
    if step is not None:
        lines.append(f"step = {_number(step)}  # s")
    lines += [
        "",
        "[noise]",
        f"bearing_deg = {_number(choices.sigma_deg)}  # standard deviation",
    ]
    return "\n".join(lines) + "\n"


def draft_of_field(
    found: FieldTable,
    one: str | None,
    positions: Sequence[tuple[float, float, float]],
    folder: Path | None = None,
) -> str:
    """Return the text of a scenario for a pass in a table of a magnetic field.

    Parameters
    ----------
    found : FieldTable
    one : str or None
        The pass; may be None where there is only one.
    positions : sequence of (float, float, float)
        Where each sensor is, m; may be empty for one sensor, which is the origin then.
    folder : Path, optional
        Where the scenario will be; its files are named relative to it.

    Raises
    ------
    InputError
        Where the pass or the places of the sensors are open.
    """
    where, passes = found.cells.path, list(found.passes)
    if one is not None and found.by is None:
        raise InputError(f"--pass {one}: {where} has one pass and no name for it")
    if one is None and len(passes) == 1:
        one = passes[0]
    if one is None or one not in passes:
        there = ", ".join(map(repr, passes))
        raise InputError(
            f"{where} has the passes {there}: which one? (--pass)"
            if one is None
            else f"{where} has no pass {one!r}: there are {there}"
        )
    count = len(found.sensors)
    places = list(positions) or ([(0.0, 0.0, 0.0)] if count == 1 else [])
    if len(places) != count:
        raise InputError(
            f"{where} has {count} sensors: give the place of each in metres, {count} times "
            f"--sensor-at X,Y,Z, not {len(places)}"
        )
    lines = [
        'model = "dipole"',
        f"sensors = {json.dumps([list(place) for place in places])}  # m",
        "",
        "[record]",
        f"file = {json.dumps(_relative(where, folder))}",
        f"unit = {json.dumps(found.unit)}",
        f"columns = {{ time = {json.dumps(found.time)}, "
        f"field = {json.dumps([list(names) for names in found.sensors])} }}",
    ]
    if found.by is not None:
        lines.append(f"select = {{ column = {json.dumps(found.by)}, value = {json.dumps(one)} }}")
    if count == 1:
        lines += [
            "",
            "# One sensor cannot tell the scale: something must be known.",
            "# [known]",
            "# speed = 10.0  # m/s",
        ]
    return "\n".join(lines) + "\n"


def _sensor(recording: Recording, choices: Choices) -> Detections | None:
    seen = {name: d for name, d in recording.sensors.items() if d.bearing is not None}
    if choices.sensor is not None:
        if choices.sensor not in seen:
            raise InputError(
                f"no sensor with bearings is named {choices.sensor!r} in {recording.where}: "
                f"there are {', '.join(map(repr, seen)) or 'none'}"
            )
        return seen[choices.sensor]
    if len(seen) > 1:
        raise InputError(
            f"{recording.where} has bearings of {', '.join(map(repr, seen))}: choose one (--sensor)"
        )
    return next(iter(seen.values()), None)


def _observer(recording: Recording, choices: Choices, sensor: Detections | None) -> Track:
    name = choices.observer or (sensor.carrier if sensor is not None else "") or None
    if name is None and len(recording.tracks) != 1:
        raise InputError(
            f"{recording.where} has the tracks {', '.join(map(repr, recording.tracks)) or 'none'}: "
            "which one is the observer? (--observer)"
        )
    return recording.track(name)


def _target(
    recording: Recording, choices: Choices, observer: Track, sensor: Detections | None
) -> Track | None:
    if choices.target is not None:
        return recording.track(choices.target)
    others = [t for t in recording.tracks.values() if t is not observer]
    if len(others) == 1:
        return others[0]
    if sensor is None:
        raise InputError(
            f"{recording.where} has the tracks {', '.join(map(repr, recording.tracks))}: "
            "which one is the target? (--target)"
        )
    return None


def _window(
    recording: Recording,
    choices: Choices,
    observer: Track,
    target: Track | None,
    sensor: Detections | None,
) -> tuple[float, float, float | None]:
    spans = [t.times for t in (observer, target, sensor) if t is not None]
    first, last = max(float(t[0]) for t in spans), min(float(t[-1]) for t in spans)
    if not last > first:
        raise InputError(
            f"{recording.where}: {observer.name} and what it observes have no time in common"
        )
    start = _start(recording, choices.start, first, last)
    duration = choices.duration if choices.duration is not None else float(np.floor(last - start))
    if not duration > 0:
        raise InputError(
            f"{recording.where}: the window starts at {recording.when(start)}: what is shared is "
            f"from {recording.when(first)} to {recording.when(last)}"
        )
    if sensor is not None:
        return start, duration, choices.step
    # About sixty bearings, where no sensor says when.
    step = duration / 60 if choices.step is None else choices.step
    return start, duration, float(np.round(step, 3)) or step


def _start(recording: Recording, given: float | str | None, first: float, last: float) -> float:
    if given is None:
        return min(float(np.ceil(first)), last)
    if isinstance(given, str) and given.startswith("+"):
        with suppress(ValueError):
            return first + float(given)
    with suppress(ValueError):
        return float(given)
    if recording.epoch is None:
        raise InputError(f"start = {given!r}: {recording.where} has no dates: give seconds")
    try:
        return unix_seconds(str(given)) - recording.epoch
    except InputError:
        raise InputError(
            f"start = {given!r}: must be seconds, a date (2026-05-01T12:00:00Z), or seconds from "
            'the first instant that is shared ("+600")'
        ) from None


def _longest_gap(track: Track) -> float:
    return float(np.diff(track.times).max(initial=0.0))


def _relative(path: Path, folder: Path | None) -> str:
    full = path.resolve()
    return str(full) if folder is None else os.path.relpath(full, folder.resolve())


def _number(value: float) -> str:
    """Return a float as TOML has it: with a point."""
    text = f"{value:.10g}"
    return text if "." in text or "e" in text else f"{text}.0"
