"""GPX tracks, by gpxpy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gramian.exceptions import GramianError, InputError
from gramian.io._build import epoch_of, track_of
from gramian.io._recording import Recording
from gramian.io._times import unix

__all__ = ["read"]


def read(path: Path, text: str) -> Recording:
    """Read the tracks of a GPX file; routes and single waypoints are left out."""
    try:
        import gpxpy
    except ImportError as error:  # pragma: no cover - without the extra
        raise GramianError("GPX files need gpxpy: pip install 'gramian[files]'") from error
    try:
        parsed = gpxpy.parse(text)
    except gpxpy.gpx.GPXException as error:
        raise InputError(f"{path}: is not valid GPX: {error}") from error
    notes = []
    samples, untimed = _samples(parsed)
    if untimed:
        notes.append(f"{untimed} points without a time left out")
    for kind, there in (("route", parsed.routes), ("waypoint", parsed.waypoints)):
        if there:
            notes.append(f"{len(there)} {kind}{'s' if len(there) > 1 else ''} left out")
    if not samples:
        raise InputError(f"{path}: has no track with times" + (f" ({notes[0]})" if notes else ""))
    epoch = epoch_of(np.array([s[0] for rows in samples.values() for s in rows]))
    tracks = {}
    for name, rows in samples.items():
        t, latitude, longitude, height = np.array(rows).T
        columns = {"latitude": latitude, "longitude": longitude}
        if np.isfinite(height).all():
            columns["height"] = height
        tracks[name], said = track_of(name, t - epoch, columns, str(path))
        notes += said
    return Recording((path,), "gpx", tracks, {}, epoch, None, tuple(notes))


def _samples(parsed: Any) -> tuple[dict[str, list[tuple[float, ...]]], int]:
    """Return time, latitude, longitude and height of each track's points, and how many lack one."""
    samples: dict[str, list[tuple[float, ...]]] = {}
    untimed = 0
    for i, track in enumerate(parsed.tracks):
        name = track.name or f"track {i + 1}"
        if name in samples:
            name = f"{name} ({i + 1})"
        for point in (point for segment in track.segments for point in segment.points):
            if point.time is None:
                untimed += 1
                continue
            height = np.nan if point.elevation is None else point.elevation
            sample = (unix(point.time), point.latitude, point.longitude, height)
            samples.setdefault(name, []).append(sample)
    return samples, untimed
