"""What a file holds: tracks and what sensors saw, on one clock and in one plane."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gramian._answers import Answer, Columns
from gramian._arrays import finite, real
from gramian.exceptions import InputError
from gramian.io._plane import centre, to_plane
from gramian.io._times import utc

__all__ = ["Detections", "Recording", "Track", "merged"]

Array = NDArray[np.float64]

_MOTION = ("speed", "course")
_UNITS = {
    "east": "m",
    "north": "m",
    "latitude": "deg",
    "longitude": "deg",
    "height": "m",
    "speed": "m/s",
    "course": "rad",
    "bearing": "rad",
    "ambiguous_bearing": "rad",
    "range": "m",
    "frequency": "Hz",
}


def _series(of: Track | Detections, names: Sequence[str]) -> Columns:
    """Return what is there of some quantities over time as a table."""
    values = {name: getattr(of, name) for name in names if getattr(of, name) is not None}
    return Columns(
        "time", of.times, values, {"time": "s"} | {name: _UNITS[name] for name in values}
    )


@dataclass(frozen=True, eq=False, repr=False)
class Track(Answer):
    """Positions of one carrier or target.

    Attributes
    ----------
    name : str
    times : ndarray, shape (k,)
        s, increasing.
    east, north : ndarray, shape (k,)
        m; NaN until the recording is projected, for a file of latitudes.
    latitude, longitude : ndarray, shape (k,), or None
        Degrees, where the file has them.
    height : ndarray, shape (k,), or None
        m, upwards.
    speed : ndarray, shape (k,), or None
        m/s over the ground, as the file says.
    course : ndarray, shape (k,), or None
        Radians clockwise from north, as the file says.
    """

    name: str
    times: Array
    east: Array
    north: Array
    latitude: Array | None = None
    longitude: Array | None = None
    height: Array | None = None
    speed: Array | None = None
    course: Array | None = None

    def _as_table(self) -> Columns:
        return _series(self, ("east", "north", "latitude", "longitude", "height", *_MOTION))

    @property
    def path(self) -> Array:
        """Positions (k, 2), m."""
        return np.stack([self.east, self.north], axis=1)

    def at(
        self, times: Array, max_gap: float, when: Callable[[float], str] = "{:g} s".format
    ) -> Array:
        """Return the positions (m, 2) at given times, interpolated between the reports.

        Parameters
        ----------
        times : ndarray, shape (m,)
            s, as the track counts them.
        max_gap : float
            s.
        when : callable
            How a time is written in a message: `Recording.when`.

        Raises
        ------
        InputError
            Times beyond the track, or in a gap longer than `max_gap` seconds.
        """
        times = finite(times, "times")
        if times.ndim != 1 or not times.size:
            raise InputError(f"times has shape {times.shape}: must be (m,), not empty")
        max_gap = real(max_gap, "max_gap")
        t, first, last = self.times, float(times.min()), float(times.max())
        if first < t[0] or last > t[-1]:
            raise InputError(
                f"{when(first)} to {when(last)} reaches beyond the track of {self.name}, "
                f"which is from {when(float(t[0]))} to {when(float(t[-1]))}"
            )
        gaps = np.diff(t)
        inside = (t[:-1] < last) & (t[1:] > first) & (gaps > max_gap)
        if inside.any():
            i = int(np.flatnonzero(inside)[0])
            raise InputError(
                f"{self.name} has a gap of {gaps[i]:.0f} s between its reports at "
                f"{when(float(t[i]))} and {when(float(t[i + 1]))}, longer than "
                f"max_gap = {max_gap:g} s"
            )
        return np.stack([np.interp(times, t, self.east), np.interp(times, t, self.north)], axis=1)


@dataclass(frozen=True, eq=False, repr=False)
class Detections(Answer):
    """What one sensor saw.

    Attributes
    ----------
    sensor, carrier : str
        Its name, and that of the track it is on.
    times : ndarray, shape (k,)
        s, increasing.
    bearing, ambiguous_bearing : ndarray, shape (k,), or None
        Radians clockwise from north; the second is the other side of a towed array. NaN
        where there is none.
    range : ndarray, shape (k,), or None
        m.
    frequency : ndarray, shape (k,), or None
        Hz.
    """

    sensor: str
    carrier: str
    times: Array
    bearing: Array | None = None
    ambiguous_bearing: Array | None = None
    range: Array | None = None
    frequency: Array | None = None

    def _as_table(self) -> Columns:
        return _series(self, ("bearing", "ambiguous_bearing", "range", "frequency"))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Which quantities it has: "bearing", "ambiguous_bearing", "range", "frequency"."""
        names = ("bearing", "ambiguous_bearing", "range", "frequency")
        return tuple(name for name in names if getattr(self, name) is not None)


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Answer):
    """Tracks and detections of one or more files.

    Attributes
    ----------
    paths : tuple of Path
    format : str
        "csv", "parquet", "gpx", "nmea", "kml" or "rep".
    tracks : dict of str to Track
    sensors : dict of str to Detections
    epoch : float or None
        UNIX seconds of time 0, where the file has dates: times count from the first
        whole second of the recording. None where they are as written.
    origin : (float, float) or None
        Latitude and longitude of the plane's origin, degrees.
    notes : tuple of str
        How the file was read, and what was left out.
    """

    paths: tuple[Path, ...]
    format: str
    tracks: dict[str, Track]
    sensors: dict[str, Detections] = field(default_factory=dict)
    epoch: float | None = None
    origin: tuple[float, float] | None = None
    notes: tuple[str, ...] = ()

    def track(self, name: str | None) -> Track:
        """Return a track by name; the only one where no name is given."""
        there = ", ".join(map(repr, self.tracks)) or "none"
        if name is None:
            if len(self.tracks) != 1:
                raise InputError(f"{self.where} has {len(self.tracks)} tracks ({there}): name one")
            return next(iter(self.tracks.values()))
        if name not in self.tracks:
            raise InputError(f"no track is named {name!r} in {self.where}: there are {there}")
        return self.tracks[name]

    @property
    def where(self) -> str:
        """The files it was read from, for messages."""
        return ", ".join(str(path) for path in self.paths)

    def when(self, time: float) -> str:
        """Return a time in words: seconds, and the date where there is one."""
        return f"{time:g} s" if self.epoch is None else f"{time:g} s ({utc(self.epoch + time)})"

    def projected(self, origin: tuple[float, float] | None = None) -> Recording:
        """Return the recording in metres about an origin, by default the middle of its tracks."""
        placed = [t for t in self.tracks.values() if t.latitude is not None]
        if not placed:
            return self
        if len(placed) < len(self.tracks):
            flat = next(t.name for t in self.tracks.values() if t.latitude is None)
            raise InputError(
                f"{self.where}: {flat} is in metres and {placed[0].name} in latitude and "
                "longitude: bring them into one plane first"
            )
        if origin is None:
            origin = centre(
                np.concatenate([t.latitude for t in placed if t.latitude is not None]),
                np.concatenate([t.longitude for t in placed if t.longitude is not None]),
            )
        tracks = {}
        for track in placed:
            latitude, longitude = np.asarray(track.latitude), np.asarray(track.longitude)
            east, north = to_plane(latitude, longitude, origin)
            tracks[track.name] = replace(track, east=east, north=north)
        return replace(self, tracks=tracks, origin=origin)

    def counted_from(self, epoch: float) -> Recording:
        """Return the same recording with another time 0, UNIX seconds."""
        if self.epoch is None:
            raise InputError(f"{self.where} has no dates: its seconds count from an unknown time")
        shift = self.epoch - epoch
        return replace(
            self,
            epoch=epoch,
            tracks={k: replace(t, times=t.times + shift) for k, t in self.tracks.items()},
            sensors={k: replace(d, times=d.times + shift) for k, d in self.sensors.items()},
        )

    def summary(self) -> str:
        """Return what is in the recording as text: tracks, spans, sampling, gaps, sensors."""
        lines = [f"{self.where}: {self.format}, {_count(len(self.tracks), 'track')}"]
        if self.epoch is not None:
            lines.append(f"  time 0 is {utc(self.epoch)}")
        if self.origin is not None:
            lines.append(f"  plane about {self.origin[0]:.5f} deg N, {self.origin[1]:.5f} deg E")
        for name, t in self.tracks.items():
            step, gap = _sampling(t.times)
            lines.append(
                f"  {name}: {_count(t.times.size, 'report')}, {self.when(float(t.times[0]))} to "
                f"{self.when(float(t.times[-1]))}, every {step:g} s, longest gap {gap:g} s"
            )
        for name, d in self.sensors.items():
            lines.append(
                f"  sensor {name} on {d.carrier}: {_count(d.times.size, 'detection')} "
                f"({', '.join(d.kinds)}), {d.times[0]:g} s to {d.times[-1]:g} s"
            )
        return "\n".join([*lines, *(f"  note: {note}" for note in self.notes)])


def merged(recordings: Sequence[Recording]) -> Recording:
    """Return several recordings as one, on one clock and in one plane.

    Raises
    ------
    InputError
        Tracks of one name in two files, and files of which some have dates and some not.
    """
    if len(recordings) == 1:
        return recordings[0].projected()
    dated = {r.epoch is not None for r in recordings if r.tracks or r.sensors}
    if len(dated) > 1:
        with_dates = next(r for r in recordings if r.epoch is not None)
        without = next(r for r in recordings if r.epoch is None)
        raise InputError(
            f"{with_dates.where} has dates and {without.where} has plain seconds: "
            "which date is second 0? Give both files dates, or both seconds"
        )
    if dated == {True}:
        epoch = min(r.epoch for r in recordings if r.epoch is not None)
        recordings = [r.counted_from(epoch) for r in recordings]
    tracks: dict[str, Track] = {}
    sensors: dict[str, Detections] = {}
    for r in recordings:
        for name, track in r.tracks.items():
            if name in tracks:
                raise InputError(f"{r.where}: a track {name!r} is in another of the files too")
            tracks[name] = track
        for name, seen in r.sensors.items():
            if name in sensors:
                raise InputError(f"{r.where}: a sensor {name!r} is in another of the files too")
            sensors[name] = seen
    return Recording(
        tuple(path for r in recordings for path in r.paths),
        " + ".join(dict.fromkeys(r.format for r in recordings)),
        tracks,
        sensors,
        recordings[0].epoch,
        None,
        tuple(note for r in recordings for note in r.notes),
    ).projected()


def _sampling(times: Array) -> tuple[float, float]:
    if times.size < 2:
        return 0.0, 0.0
    steps = np.diff(times)
    return float(np.round(np.median(steps), 6)), float(np.round(steps.max(), 6))


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
