"""NMEA 0183 and AIS sentences, by pyais.

Own ship from RMC and GGA sentences, other ships from AIS position reports (``!AIVDM``).
AIS messages carry no date: their time is that of the tag block or of the logger's stamp
before the sentence, or of the last RMC sentence.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from gramian.exceptions import GramianError, InputError
from gramian.io._build import KNOT, epoch_of, track_of
from gramian.io._recording import Recording
from gramian.io._times import unix

__all__ = ["looks_like", "read"]

_LINE = re.compile(r"^(?P<head>[^$!]*)(?P<sentence>[$!][A-Z]{2}[A-Z]{3},.*?)\s*$")
_STAMP = re.compile(r"\bc:(\d{9,13})|(\d{9,10}(?:\.\d+)?)|(\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d\S*)")
_OWN = "own ship"
_FIXES = ("RMC", "GGA")


def looks_like(text: str) -> bool:
    """Say whether a file holds sentences: by its first line that is not blank or a comment."""
    for line in text.splitlines():
        if line.strip() and not line.startswith("#"):
            return bool(_LINE.match(line))
    return False


def read(path: Path, text: str) -> Recording:
    """Read a log of sentences: own ship and the ships heard by AIS."""
    try:
        from pyais import decode
        from pyais.exceptions import AISBaseException
    except ImportError as error:  # pragma: no cover - without the extra
        raise GramianError("NMEA and AIS files need pyais: pip install 'gramian[files]'") from error
    log = _Log()
    for sentence, stamp in _sentences(path, text, log.left_out):
        if stamp is not None:
            log.clock = stamp
        if sentence.startswith("$"):
            log.own_ship(sentence)
        elif group := log.complete(sentence):
            try:
                log.hear(decode(*group))
            except AISBaseException:
                log.leave_out("AIS sentences that cannot be decoded")
    if not log.samples:
        raise InputError(
            f"{path}: has no position with a time ("
            + (", ".join(f"{n} {what}" for what, n in log.left_out.items()) or "no sentence")
            + ")"
        )
    epoch = epoch_of(np.array([s[0] for rows in log.samples.values() for s in rows]))
    notes = [f"{n} {what} left out" for what, n in log.left_out.items()]
    tracks = {}
    for key, rows in log.samples.items():
        # Own ship's RMC and GGA of one instant are one report.
        unique: dict[float, tuple[float, ...]] = {}
        for row in rows:
            unique.setdefault(row[0], row)
        t, latitude, longitude, course, speed = np.array(list(unique.values())).T
        columns = {"latitude": latitude, "longitude": longitude}
        if np.isfinite(speed).any():
            columns |= {"course": np.radians(course), "speed": speed * KNOT}
        name = log.names.get(key, key)
        if name in tracks:
            name = f"{name} ({key})"
        tracks[name], said = track_of(name, t - epoch, columns, str(path))
        notes += said
    return Recording((path,), "nmea", tracks, {}, epoch, None, tuple(notes))


@dataclass
class _Log:
    """What has been read of a log so far; a sample is time, place, course, speed."""

    samples: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    left_out: dict[str, int] = field(default_factory=dict)
    parts: dict[tuple[str, str], list[str]] = field(default_factory=dict)
    clock: float | None = None
    day: datetime | None = None

    def leave_out(self, what: str) -> None:
        _count(self.left_out, what)

    def complete(self, sentence: str) -> list[str] | None:
        """Return the sentences of a message, once the last one is there."""
        fields = sentence.split(",")
        if len(fields) < 5 or fields[1] in ("", "1"):
            return [sentence]
        key = fields[3], fields[4]
        if fields[2] == "1":
            if self.parts.pop(key, None):
                self.leave_out("AIS messages of which a part is lost")
            self.parts[key] = []
        kept = self.parts.get(key)
        if kept is None or fields[2] != str(len(kept) + 1):
            # Not to be joined with parts of another message.
            self.parts.pop(key, None)
            self.leave_out("AIS messages of which a part is lost")
            return None
        kept.append(sentence)
        if str(len(kept)) != fields[1]:
            return None
        return self.parts.pop(key)

    def hear(self, message: Any) -> None:
        """Take an AIS message."""
        said = message.asdict()
        ship = str(said["mmsi"])
        if said.get("shipname"):
            self.names[ship] = str(said["shipname"]).strip()
        if "lat" not in said or message.msg_type not in (1, 2, 3, 18, 19):
            self.leave_out(f"AIS messages of type {message.msg_type}")
            return
        if self.clock is None:
            self.leave_out("AIS positions before the first time")
            return
        latitude, longitude = float(said["lat"]), float(said["lon"])
        # 91 and 181 degrees stand for a position that is not available.
        if abs(latitude) > 90 or abs(longitude) > 180:
            self.leave_out("AIS messages without a position")
            return
        moment, second = self.clock, said.get("second")
        if isinstance(second, int) and second < 60:
            # The second of the position, within the minute that the receiver says.
            moment += second - self.clock % 60
            moment += 60.0 * round((self.clock - moment) / 60)
        speed, course = float(said["speed"]), float(said["course"])
        course = course if course < 360 else np.nan
        speed = speed if speed < 102.3 else np.nan
        self.samples.setdefault(ship, []).append((moment, latitude, longitude, course, speed))

    def own_ship(self, sentence: str) -> None:
        """Take a sentence of own ship's receiver."""
        kind = sentence[3:6]
        fields = sentence.partition("*")[0].split(",")
        try:
            sample = {"RMC": self._rmc, "GGA": self._gga}.get(kind, lambda _: None)(fields)
        except (ValueError, IndexError):
            sample = None
        if sample is None:
            undated = kind == "GGA" and self.day is None and fields[6:7] not in ([""], ["0"])
            without = " before the date of an RMC" if undated else " without a fix"
            self.leave_out(f"sentences {kind}" + (without if kind in _FIXES else ""))
            return
        self.clock = sample[0]
        self.samples.setdefault(_OWN, []).append(sample)

    def _rmc(self, fields: list[str]) -> tuple[float, ...] | None:
        self.day = datetime.strptime(fields[9], "%d%m%y").replace(tzinfo=UTC)
        if fields[2] != "A":
            return None
        course = float(fields[8]) if fields[8] else np.nan
        speed = float(fields[7]) if fields[7] else np.nan
        place = _degrees(fields[3], fields[4]), _degrees(fields[5], fields[6])
        return unix(self.day) + _of_day(fields[1]), *place, course, speed

    def _gga(self, fields: list[str]) -> tuple[float, ...] | None:
        # A GGA sentence has no date: that of the last RMC.
        if self.day is None or fields[6] in ("", "0"):
            return None
        place = _degrees(fields[2], fields[3]), _degrees(fields[4], fields[5])
        return unix(self.day) + _of_day(fields[1]), *place, np.nan, np.nan


def _sentences(
    path: Path, text: str, left_out: dict[str, int]
) -> Iterator[tuple[str, float | None]]:
    for line in text.splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        match = _LINE.match(line)
        if match is None:
            _count(left_out, "lines that are no sentence")
            continue
        sentence = match["sentence"]
        if not _checksum_holds(sentence):
            _count(left_out, "sentences with a wrong checksum")
            continue
        stamp = None
        if found := _STAMP.search(match["head"]):
            if found.group(1):
                value = float(found.group(1))
                stamp = value / 1000 if value > 1e11 else value
            elif found.group(2):
                stamp = float(found.group(2))
            else:
                try:
                    stamp = unix(datetime.fromisoformat(found.group(3).rstrip(",;|")))
                except ValueError:
                    raise InputError(
                        f"{path}: {found.group(3)!r}: is not a date and time"
                    ) from None
        yield sentence, stamp


def _checksum_holds(sentence: str) -> bool:
    body, star, given = sentence[1:].partition("*")
    if not star:
        return True
    total = 0
    for character in body:
        total ^= ord(character)
    return given[:2].upper() == f"{total & 255:02X}"


def _of_day(text: str) -> float:
    return timedelta(
        hours=int(text[:2]), minutes=int(text[2:4]), seconds=float(text[4:])
    ).total_seconds()


def _degrees(text: str, letter: str) -> float:
    # Degrees and minutes in one: 5046.5 is 50 degrees 46.5 minutes.
    whole, minutes = divmod(float(text), 100)
    value = whole + minutes / 60
    return -value if letter in ("S", "W") else value


def _count(left_out: dict[str, int], what: str) -> None:
    left_out[what] = left_out.get(what, 0) + 1
