"""Slips that a recording shows by itself: asked about, never answered.

Each is an `InputError` with the question, and how to say that the file is right.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from gramian._arrays import wrap_angles
from gramian._text import brief
from gramian.exceptions import InputError
from gramian.io._recording import Detections, Recording, Track

__all__ = ["CHECKS", "check"]

Array = NDArray[np.float64]

#: The names by which a check is switched off: ``trust = ["speed"]``.
CHECKS = ("units", "speed", "course", "missing", "bearings", "clock")

_EACH = {2: "second", 3: "third", 4: "fourth"}
#: m/s: faster than anything that flies in air.
_FASTEST = 1500.0


def check(recording: Recording, trust: Collection[str] = ()) -> None:
    """Ask about what looks like a slip.

    Parameters
    ----------
    recording : Recording
        In metres.
    trust : collection of str
        Checks to leave out, of `CHECKS`.

    Raises
    ------
    InputError
        The first slip found, with the question.
    """
    for name in trust:
        if name not in CHECKS:
            raise InputError(f"trust: {name!r} is no check: must be of {', '.join(CHECKS)}")
    for track in recording.tracks.values():
        for name, look in (
            ("missing", _missing),
            ("units", _degrees_for_metres),
            ("units", _radians_for_places),
            ("speed", _interleaved),
            ("speed", _speed),
            ("course", _course),
        ):
            if name not in trust:
                look(track, recording.where)
    for seen in recording.sensors.values():
        if "bearings" not in trust:
            _radians_for_degrees(seen, recording.where)
    if "clock" not in trust:
        _clock(recording)
    for seen in recording.sensors.values():
        _against_tracks(seen, recording, trust)


def _ask(where: str, what: str, name: str) -> InputError:
    stop = "" if what.endswith("?") else "."
    return InputError(f"{where}: {what}{stop} If the file is right, say trust = [{name!r}]")


def _missing(track: Track, where: str) -> None:
    for name, values in (
        ("latitude", track.latitude), ("longitude", track.longitude),
        ("east", None if track.latitude is not None else track.east),
        ("north", None if track.latitude is not None else track.north),
    ):  # fmt: skip
        if values is None:
            continue
        for sentinel in (-999.0, -9999.0, 9999.0, 99999.0):
            count = int((values == sentinel).sum())
            if count:
                raise _ask(
                    where,
                    f"{name} of {track.name} is {sentinel:g} in {count} reports: does this stand "
                    "for a missing position? Leave such cells empty",
                    "missing",
                )
    if track.latitude is not None and track.longitude is not None:
        null_island = (track.latitude == 0) & (track.longitude == 0)
        if null_island.any() and not null_island.all():
            raise _ask(
                where,
                f"{track.name} is at latitude 0, longitude 0 in {int(null_island.sum())} reports: "
                "does this stand for a missing position? Leave such cells empty",
                "missing",
            )


def _speeds(track: Track) -> Array:
    steps = np.hypot(np.diff(track.east), np.diff(track.north))
    speeds: Array = steps / np.diff(track.times)
    return speeds


def _degrees_for_metres(track: Track, where: str) -> None:
    if track.latitude is not None or track.times.size < 2:
        return
    inside = np.abs(track.east).max() <= 180 and np.abs(track.north).max() <= 90
    speeds = _speeds(track)
    fast, slow = float(np.median(speeds)), float(speeds.max())
    # A degree is 111 km: what creeps as metres moves as a ship does as degrees.
    if inside and 0 < slow < 0.05 and fast * 111e3 > 0.2:
        raise _ask(
            where,
            f"{track.name} moves at {brief(slow, 2)} m/s within +-180 m east and +-90 m north: are "
            "these longitudes and latitudes in degrees (name the columns longitude and latitude), "
            "or kilometres (name them east_km and north_km)?",
            "units",
        )


def _radians_for_places(track: Track, where: str) -> None:
    if track.latitude is None or track.longitude is None or track.times.size < 3:
        return
    inside = np.abs(track.latitude).max() <= np.pi / 2 and np.abs(track.longitude).max() <= np.pi
    speeds = _speeds(track)
    # A radian is 57 degrees: what creeps as degrees moves as a ship does as radians.
    if inside and 0 < float(np.median(speeds)) < 0.5 and float(speeds.max()) * 57.3 > 0.5:
        raise _ask(
            where,
            f"{track.name} moves at {brief(float(speeds.max()), 2)} m/s within +-1.57 of latitude "
            "and +-3.14 of longitude: are these radians? Write degrees",
            "units",
        )


def _interleaved(track: Track, where: str) -> None:
    """Ask about reports that jump to and fro between places: those of several ships."""
    for ships in (2, 3, 4):
        if track.times.size < 4 * ships:
            return
        next_one, same = (
            float(np.median(np.linalg.norm(track.path[k:] - track.path[:-k], axis=1)))
            for k in (1, ships)
        )
        if next_one > 4 * same:
            raise _ask(
                where,
                f"{track.name} jumps by {brief(next_one)} m from report to report, and each "
                f"{_EACH[ships]} is {brief(same)} m from the last: are these {ships} ships? Name "
                "the column that tells them apart id",
                "speed",
            )


def _speed(track: Track, where: str) -> None:
    if track.times.size < 3:
        return
    speeds = _speeds(track)
    middle = float(np.median(speeds))
    if middle > _FASTEST:
        raise _ask(
            where,
            f"{track.name} moves at {brief(middle)} m/s: are its times in milliseconds or "
            "minutes, or "
            "its positions in feet? Give the unit in the heading (time_ms, east_ft)",
            "speed",
        )
    if track.speed is not None and np.isfinite(track.speed).any():
        said = float(np.nanmedian(track.speed))
        if said > 1 and middle > 0 and not 0.33 < middle / said < 3:
            raise _ask(
                where,
                f"{track.name} moves at {brief(middle)} m/s by its positions and at "
                f"{brief(said)} m/s by "
                "its column of speed: is a unit wrong?",
                "speed",
            )


def _course(track: Track, where: str) -> None:
    if track.course is None or track.times.size < 6:
        return
    moved = np.arctan2(np.diff(track.east), np.diff(track.north))
    said = track.course[:-1]
    clear = np.isfinite(said) & (_speeds(track) > 0.5)
    if clear.sum() < 5:
        return
    off = np.abs(wrap_angles(moved[clear] - said[clear]))
    swapped = np.abs(wrap_angles(np.pi / 2 - moved[clear] - said[clear]))
    if np.median(off) > 0.5 and np.median(swapped) < 0.2:
        raise _ask(
            where,
            f"{track.name} moves across its column of course, and along it with east and north "
            "swapped: are the columns swapped?",
            "course",
        )
    if np.median(off) > 0.8:
        raise _ask(
            where,
            f"{track.name} moves {np.degrees(np.median(off)):.0f} deg off its column of course: "
            "is the course in radians, or counted from another axis?",
            "course",
        )


def _radians_for_degrees(seen: Detections, where: str) -> None:
    if seen.bearing is None:
        return
    bearings = np.degrees(seen.bearing[np.isfinite(seen.bearing)])
    beyond = bearings[np.abs(bearings) > 360 + 1e-6]
    if beyond.size and beyond.size < 0.2 * bearings.size:
        # A whole column may be counted on over a turn; single readings are not.
        raise _ask(
            where,
            f"bearings of {seen.sensor}: {brief(beyond[0])} deg is beyond a whole turn: does it "
            "stand for a missing one? Leave its cell empty",
            "bearings",
        )
    if bearings.size < 5 or np.abs(bearings).max() > 2 * np.pi + 1e-6:
        return
    if np.any(bearings % 1) and np.ptp(bearings) > 0:
        raise _ask(
            where,
            f"bearings of {seen.sensor} are all within {brief(bearings.min())} and "
            f"{brief(bearings.max())} deg: are they radians? Name the column bearing_rad",
            "bearings",
        )


def _clock(recording: Recording) -> None:
    spans = [(t.name, t.times[0], t.times[-1]) for t in recording.tracks.values()]
    spans += [(f"sensor {d.sensor}", d.times[0], d.times[-1]) for d in recording.sensors.values()]
    for seen in recording.sensors.values():
        carrier = recording.tracks.get(seen.carrier)
        others = [carrier] if carrier else list(recording.tracks.values())
        if not others or any(
            seen.times[0] <= t.times[-1] and seen.times[-1] >= t.times[0] for t in others
        ):
            continue
        track = others[0]
        offset = float(track.times[0] - seen.times[0])
        hours = round(offset / 3600)
        hint = ""
        shifted = seen.times + 3600 * hours
        if hours and shifted[0] <= track.times[-1] and shifted[-1] >= track.times[0]:
            plural = "" if abs(hours) == 1 else "s"
            hint = f" With {hours:+d} hour{plural} they overlap: is one of the files in local time?"
        raise InputError(
            f"{recording.where}: sensor {seen.sensor} is from {recording.when(seen.times[0])} to "
            f"{recording.when(seen.times[-1])}, and {track.name} from "
            f"{recording.when(track.times[0])} to {recording.when(track.times[-1])}: they do not "
            f"overlap.{hint}"
        )


#: Shifts of a clock that are tried, s: minutes, then quarters of an hour to a day.
_SHIFTS = np.concatenate([np.arange(-3600, 3601, 10), np.arange(-96, 97) * 900]).astype(float)


def _against_tracks(seen: Detections, recording: Recording, trust: Collection[str]) -> None:
    """Ask about bearings that would fit the tracks if they were read in another way.

    Only where carrier and target are both known: a sensor on a track, and one other track.
    """
    carrier = recording.tracks.get(seen.carrier)
    if carrier is None and len(recording.tracks) == 2:
        carrier = next(iter(recording.tracks.values()))
    others = [t for t in recording.tracks.values() if t is not carrier]
    if carrier is None or len(others) != 1 or seen.bearing is None:
        return
    good = np.isfinite(seen.bearing)
    times, bearing, target = seen.times[good], seen.bearing[good], others[0]
    as_read = _misfit(carrier, target, times, bearing)
    if times.size < 8 or not np.radians(5) < as_read < np.inf:
        return
    where, off = recording.where, np.degrees(as_read)
    start = (
        f"bearings of {seen.sensor} are {off:.0f} deg off those from {carrier.name} to "
        f"{target.name} by their tracks, and "
    )
    if "bearings" not in trust:
        readings = {
            "counted counterclockwise from east": np.pi / 2 - bearing,
            "counted the other way round": -bearing,
            "those from the target to the observer": bearing + np.pi,
            "relative to the carrier's course": bearing + _heading(carrier, times),
        }
        for what, changed in readings.items():
            if _misfit(carrier, target, times, changed) < as_read / 10:
                raise _ask(where, f"{start}agree if they are {what}: are they?", "bearings")
    if "clock" not in trust:
        misfits = np.array([_misfit(carrier, target, times + s, bearing) for s in _SHIFTS])
        best = int(np.argmin(misfits))
        if misfits[best] < as_read / 10:
            raise _ask(
                where,
                f"{start}agree with {_SHIFTS[best]:+.0f} s on the sensor's clock: is one of the "
                "clocks off?",
                "clock",
            )


def _misfit(carrier: Track, target: Track, times: Array, bearing: Array) -> float:
    """Return the median error of bearings against two tracks; infinite off their span."""
    inside = (times >= max(carrier.times[0], target.times[0])) & (
        times <= min(carrier.times[-1], target.times[-1])
    )
    if inside.sum() < max(8, 0.8 * times.size):
        return float("inf")
    t = times[inside]
    at = [
        np.stack([np.interp(t, k.times, k.east), np.interp(t, k.times, k.north)])
        for k in (carrier, target)
    ]
    east, north = at[1] - at[0]
    return float(np.median(np.abs(wrap_angles(np.arctan2(east, north) - bearing[inside]))))


def _heading(carrier: Track, times: Array) -> Array:
    """Return the course of a track at given times."""
    steps = np.clip(np.searchsorted(carrier.times, times), 1, max(carrier.times.size - 1, 1))
    if carrier.times.size < 2:
        return np.zeros(times.size)
    course: Array = np.arctan2(
        carrier.east[steps] - carrier.east[steps - 1],
        carrier.north[steps] - carrier.north[steps - 1],
    )
    return course
