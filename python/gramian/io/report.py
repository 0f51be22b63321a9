"""What is in a recording: the report of `gramian import`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gramian._registry import draw
from gramian._text import number, plain
from gramian.io._recording import Detections, Recording, Track
from gramian.io._times import utc
from gramian.report import Picture, Report, Table

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["report"]


def report(recording: Recording) -> Report:
    """Return tracks and sensors of a recording with their spans, sampling and gaps."""
    tracks, sensors = recording.tracks, recording.sensors
    zero = recording.epoch
    facts = []
    if zero is not None:
        facts.append(("time 0", utc(zero)))
    if recording.origin is not None:
        latitude, longitude = recording.origin
        facts.append(("origin of the plane", f"{latitude:.5f} deg N, {longitude:.5f} deg E"))
    facts += [("note", note) for note in recording.notes]
    tables = []
    columns = ["reports", "from (s)", "to (s)", "every (s)", "longest gap (s)"]
    if tracks:
        rows = [[name, *_cells(t.times), _speed(t)] for name, t in tracks.items()]
        tables.append(Table("Tracks", ["track", *columns, "median speed (m/s)"], rows))
    if sensors:
        columns = ["detections", *columns[1:]]
        rows = [
            [name, d.carrier, *_cells(d.times), ", ".join(k.replace("_", " ") for k in d.kinds)]
            for name, d in sensors.items()
        ]
        tables.append(Table("Sensors", ["sensor", "on", *columns, "what it measures"], rows))
    pictures = [Picture("When", "A mark for each report.", lambda: draw(recording, "coverage"))]
    if tracks:
        caption = "Each track, from the dot on."
        pictures.insert(0, Picture("Tracks", caption, lambda: draw(recording, "places")))
    parts = [f"{len(tracks)} track{'' if len(tracks) == 1 else 's'}"] if tracks else []
    parts += [f"{len(sensors)} sensor{'' if len(sensors) == 1 else 's'}"] if sensors else []
    return Report(
        title=", ".join(path.name for path in recording.paths),
        subtitle=recording.format,
        tone="good",
        headline="READ",
        verdict=" and ".join(parts),
        facts=facts,
        tables=tables,
        pictures=pictures,
        data={
            "format": recording.format,
            "files": [str(path) for path in recording.paths],
            "epoch": zero,
            "epoch_utc": None if zero is None else utc(zero),
            "origin": None if recording.origin is None else list(recording.origin),
            "tracks": {name: _data(t) for name, t in tracks.items()},
            "sensors": {
                name: {"on": d.carrier, "measures": list(d.kinds), **_data(d)}
                for name, d in sensors.items()
            },
            "notes": list(recording.notes),
        },
    )


def _cells(times: NDArray[np.float64]) -> list[str]:
    steps = np.diff(times) if times.size > 1 else np.zeros(1)
    values = (float(times[0]), float(times[-1]), float(np.median(steps)), float(steps.max()))
    return [str(times.size), *(f"{value:.10g}" for value in np.round(values, 3))]


def _speed(track: Track) -> str:
    if track.times.size < 2:
        return ""
    steps = np.hypot(np.diff(track.east), np.diff(track.north)) / np.diff(track.times)
    return number(float(np.median(steps)), 3)


def _data(part: Track | Detections) -> dict[str, Any]:
    times = part.times
    steps = np.diff(times) if times.size > 1 else np.zeros(1)
    return {
        "count": int(times.size),
        "first": plain(times[0]),
        "last": plain(times[-1]),
        "every": plain(np.median(steps)),
        "longest_gap": plain(steps.max()),
    }
