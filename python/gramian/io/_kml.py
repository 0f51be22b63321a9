"""KML tracks (``gx:Track``), and placemarks with a time stamp."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gramian.exceptions import InputError
from gramian.io._build import epoch_of, track_of
from gramian.io._recording import Recording
from gramian.io._times import instants

__all__ = ["read"]

#: Times as text, and longitude, latitude and height beside them.
_Samples = tuple[list[str], list[tuple[float, float, float]]]


def read(path: Path, text: str) -> Recording:
    """Read the tracks of a KML file; paths without times are left out."""
    if re.search(r"<!(DOCTYPE|ENTITY)", text):
        raise InputError(f"{path}: has a document type declaration, which is not read")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise InputError(f"{path}: is not valid KML: {error}") from error
    samples, untimed = _samples(root, path)
    if not samples:
        raise InputError(f"{path}: has no track with times ({untimed} places or paths without)")
    notes = [f"{untimed} places or paths without a time left out"] if untimed else []
    times = {}
    for name, (when, _) in samples.items():
        times[name], dated, _ = instants(when, f"{path}: times of {name}")
        if not dated:
            raise InputError(f"{path}: times of {name} have no date")
    epoch = epoch_of(np.concatenate(list(times.values())))
    tracks = {}
    for name, (_, where) in samples.items():
        longitude, latitude, height = np.array(where).T
        columns = {"latitude": latitude, "longitude": longitude}
        if np.isfinite(height).all():
            columns["height"] = height
        tracks[name], said = track_of(name, times[name] - epoch, columns, str(path))
        notes += said
    return Recording((path,), "kml", tracks, {}, epoch, None, tuple(notes))


def _samples(root: ET.Element, path: Path) -> tuple[dict[str, _Samples], int]:
    """Return the times and places of each track, and how many places have no time."""
    samples: dict[str, _Samples] = {}
    untimed = 0
    for mark in _all(root, "Placemark"):
        name = _text(mark, "name") or f"track {len(samples) + 1}"
        for track in _all(mark, "Track"):
            when = [(e.text or "").strip() for e in _all(track, "when")]
            where = [_place((e.text or "").split(), path) for e in _all(track, "coord")]
            if len(when) != len(where):
                raise InputError(
                    f"{path}: track {name} has {len(when)} times and {len(where)} places"
                )
            kept = samples.setdefault(name, ([], []))
            kept[0].extend(when)
            kept[1].extend(where)
        stamp = next((_text(s, "when") for s in _all(mark, "TimeStamp")), "")
        for point in _all(mark, "Point"):
            if stamp:
                kept = samples.setdefault(name, ([], []))
                kept[0].append(stamp)
                kept[1].append(_place(_text(point, "coordinates").split(","), path))
            else:
                untimed += 1
        untimed += sum(1 for _ in _all(mark, "LineString"))
    return samples, untimed


def _all(element: ET.Element, tag: str) -> Iterator[ET.Element]:
    return (e for e in element.iter() if e.tag.rpartition("}")[2] == tag)


def _text(element: ET.Element, tag: str) -> str:
    return next(((e.text or "").strip() for e in _all(element, tag)), "")


def _place(parts: list[str], path: Path) -> tuple[float, float, float]:
    try:
        values = [float(part) for part in parts]
    except ValueError:
        values = []
    if len(values) not in (2, 3) or not np.isfinite(values).all():
        raise InputError(f"{path}: coordinates {' '.join(parts)!r}: must be longitude, latitude")
    return values[0], values[1], values[2] if len(values) == 3 else float("nan")
