"""Geographic coordinates as people write them."""

from __future__ import annotations

import re

from gramian.exceptions import InputError

__all__ = ["degrees"]

_PART = re.compile(r"\d+(?:[.,]\d+)?")
_SHAPE = re.compile(
    r"\s*([+-]?)\s*(\d+(?:[.,]\d+)?(?:[\s°d:'\u2032m]+\d+(?:[.,]\d+)?){0,2})[\s\"\u2033'\u2032°s]*([NSEWnsew]?)\s*$"
)


def degrees(text: str, place: str) -> float:
    """Return a latitude or longitude in degrees.

    Takes decimal degrees, degrees and minutes, and degrees, minutes and seconds, with a
    sign or a hemisphere: ``50.775``, ``50°46.5'N``, ``50 46 30 N``, ``N 50:46:30``.

    Raises
    ------
    InputError
        Text of another shape, minutes or seconds of 60 and more, a sign beside a hemisphere.
    """
    given = text.strip()
    moved = re.sub(r"^([NSEWnsew])\s*(.*)$", r"\2\1", given)
    match = _SHAPE.match(moved)
    if match is None:
        raise InputError(
            f"{place} = {given!r}: must be degrees, as 50.775, 50°46.5'N or 50 46 30 N"
        )
    sign, body, hemisphere = match.groups()
    parts = [float(part.replace(",", ".")) for part in _PART.findall(body)]
    if any(part >= 60 for part in parts[1:]):
        raise InputError(f"{place} = {given!r}: minutes and seconds must be below 60")
    if sign and hemisphere:
        raise InputError(f"{place} = {given!r}: has a sign and a hemisphere: must have one of them")
    value = 0.0
    for part in reversed(parts):
        value = part + value / 60
    return -value if sign == "-" or hemisphere.upper() in ("S", "W") else value
