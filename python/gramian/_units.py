"""Values with units to plain numbers in the unit of an argument: converted, never stripped.

The gate (`convert` in the extension) calls `bare` for what is no plain array or nest of
numbers. Arguments are known by their names, which mean one thing throughout the package;
where a name has several meanings the call says the unit: ``"sigma [rad]"``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian.exceptions import InputError

__all__ = ["FACTORS", "WANTED", "bare", "labelled"]

Array = NDArray[np.float64]

#: The unit of each argument, as pint and astropy read it.
WANTED: dict[str, str] = {
    **dict.fromkeys(("times", "time", "duration", "dt", "max_gap", "correlation_time"), "s"),
    **dict.fromkeys(
        (
            "observer",
            "path",
            "positions",
            "position",
            "targets",
            "sensors",
            "track",
            "standoff",
            "range_",
            "first_range",
            "radius",
            "extent",
            "keep_out",
            "height",
            "lever_arm",
            "distance",
            "r0",
        ),
        "m",
    ),
    **dict.fromkeys(("velocity", "speed", "speed_change", "v"), "m/s"),
    **dict.fromkeys(
        (
            "bearings",
            "bearing",
            "heading",
            "pitch",
            "roll",
            "bank",
            "turn",
            "largest_turn",
            "latitude",
            "longitude",
            "sigma_elevation",
        ),
        "rad",
    ),
    **dict.fromkeys(("max_turn_rate", "angular_rate"), "rad/s"),
    **dict.fromkeys(("field", "ambient", "earth_field"), "T"),
    **dict.fromkeys(("moment", "m", "permanent"), "A*m**2"),
    "specific_force": "m/s**2",
    "induced_volume": "m**3",
    "target": "place",
}

#: What an argument may hold besides a single unit: a place (x, y) or (x, y, z), and a
#: place with its velocity.
_PLACE = "place"
_STATE = ("m", "m", "m/s", "m/s")

#: Units by the names that headings and attributes have for them: kind and factor.
FACTORS: dict[str, tuple[str, float]] = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), ("m", 1.0)),
    **dict.fromkeys(("km", "kilometre", "kilometres", "kilometer", "kilometers"), ("m", 1000.0)),
    **dict.fromkeys(("ft", "feet", "foot"), ("m", 0.3048)),
    **dict.fromkeys(("nm", "nmi", "nautical_miles"), ("m", 1852.0)),
    **dict.fromkeys(("yd", "yards"), ("m", 0.9144)),
    **dict.fromkeys(("mps", "m/s", "m s-1", "m s**-1"), ("m/s", 1.0)),
    **dict.fromkeys(("kn", "kt", "kts", "knot", "knots"), ("m/s", 1852 / 3600)),
    **dict.fromkeys(("kmh", "km/h", "km h-1"), ("m/s", 1 / 3.6)),
    **dict.fromkeys(("deg", "degree", "degrees"), ("rad", np.pi / 180)),
    **dict.fromkeys(("rad", "radian", "radians"), ("rad", 1.0)),
    "hz": ("Hz", 1.0),
    "khz": ("Hz", 1000.0),
    **dict.fromkeys(("s", "sec", "second", "seconds"), ("s", 1.0)),
    "ms": ("s", 1e-3),
    "min": ("s", 60.0),
    "t": ("T", 1.0),
    "mt": ("T", 1e-3),
    "ut": ("T", 1e-6),
    "nt": ("T", 1e-9),
    "mg": ("T", 1e-7),
}


def bare(value: Any, name: str) -> Any:
    """Return a value without its unit, in that of the argument.

    Parameters
    ----------
    value : object
        Anything; what has no unit is returned as it is. Dates (datetime64, `datetime`)
        become seconds since 1970-01-01 UTC, and spans of time seconds.
    name : str
        The argument as messages call it, with its unit in brackets where its name does
        not say it: "sigma [rad]".

    Raises
    ------
    InputError
        A unit of another kind than the argument's, and any unit where the argument is in
        units of the caller's own.
    """
    shown, wanted = _wanted(name)
    if isinstance(value, (list, tuple)):
        return _bare_list(value, shown, wanted)
    if _is_date(value):
        # Seconds since 1970 are a time, and no number of something else.
        if wanted not in ("s", None) or (
            wanted is None and isinstance(value, (np.datetime64, datetime)) and "time" not in name
        ):
            raise InputError(f"{shown} holds dates: must be in {_said(wanted)}")
        return _seconds(value, shown)
    unit = _unit(value)
    if unit is None:
        return value
    if wanted is None:
        raise InputError(
            f"{shown} has the unit {unit}, and no unit is known for this argument: give plain "
            "numbers, in units that agree with each other"
        )
    if wanted == _PLACE:
        shape = np.shape(value)
        if not shape or shape[-1] not in (2, 3):
            raise InputError(
                f"{shown} has the unit {unit} and shape {shape}: a state has several units: "
                "give plain numbers in m and m/s, or a list with a unit for each"
            )
        wanted = "m"
    return _converted(value, unit, shown, wanted)


def labelled(name: str, unit: str) -> str:
    """Return an argument with the unit of a state, as `bare` reads it: "prior of vx [m/s]"."""
    plain = unit.replace("^", "**").replace("·", "*").strip()
    plain = re.sub(r"(?<=[A-Za-z0-9)]) (?=[A-Za-z(])", "*", plain)
    return f"{name} [{plain}]" if plain else name


def _wanted(name: str) -> tuple[str, str | None]:
    """Return an argument as messages call it, and its unit; None where it has none."""
    if name.endswith("]") and " [" in name:
        shown, _, unit = name[:-1].rpartition(" [")
        return shown, None if unit == "-" else unit
    # "legs[2].speed", "sonar: times", "sensors['a']", "track 3".
    key = re.sub(r"\[[^\]]*\]$", "", name).rpartition(": ")[2].rpartition(".")[2]
    return name, WANTED.get(re.sub(r" ('.*'|\d+)$", "", key))


def _said(wanted: str | None) -> str:
    return {None: "plain numbers", _PLACE: "m"}.get(wanted, str(wanted))


def _unit(value: Any) -> Any:
    """Return the unit of a value: that of pint, astropy and unyt, or an attribute of xarray."""
    kind = type(value)
    if kind is np.ndarray or isinstance(value, (float, int, str, np.generic)):
        return None
    for marks, unit in (("to_value", "unit"), ("magnitude", "units"), ("to_value", "units")):
        if hasattr(value, marks) and hasattr(value, unit):
            return getattr(value, unit)
    if kind.__module__.startswith("xarray"):
        inner = _unit(getattr(value, "data", None))
        return inner if inner is not None else value.attrs.get("units")
    if kind.__module__.startswith("pandas"):
        # pint-pandas: its arrays say their unit in their type.
        types = getattr(value, "dtypes", None)
        for one in types if isinstance(types, Iterable) else (types,):
            if (found := getattr(one, "units", None)) is not None:
                return found
    return None


def _converted(value: Any, unit: Any, shown: str, wanted: str) -> Any:
    mismatch = f"{shown} has the unit {unit}: must be convertible to {wanted}"
    if isinstance(unit, str):  # an attribute
        kind, factor = FACTORS.get(unit.strip().lower(), (None, 1.0))
        if kind is None:
            raise InputError(
                f"{shown} has the attribute units = {unit!r}, which is not known: convert it to "
                f"{wanted} and drop the attribute"
            )
        if kind != wanted:
            raise InputError(mismatch)
        return np.asarray(value, dtype=float) * factor
    data = getattr(value, "data", value) if type(value).__module__.startswith("xarray") else value
    if type(data).__module__.startswith("pandas"):
        raise InputError(
            f"{shown} is a pandas object with the unit {unit}: give its quantities "
            f"(.pint.quantity), or convert it to {wanted} and drop the unit"
        )
    try:
        if hasattr(data, "to_value"):
            return np.asarray(data.to_value(wanted.replace("**", "^")), dtype=float)
        return np.asarray(data.m_as(wanted), dtype=float)
    except Exception as error:  # each library has its own
        raise InputError(mismatch) from error


def _bare_list(value: Any, shown: str, wanted: str | None) -> Any:
    """Return a list, of which some entries may have units."""
    kinds = set(map(type, value))
    if kinds <= {float, int, bool, np.float64}:
        return value
    if not any(
        kind in (list, tuple) or _unit(one) is not None or _is_date(one)
        for kind, one in ((type(one), one) for one in value)
    ):
        return value
    units: Iterable[str | None] = [wanted] * len(value)
    if wanted == _PLACE and not kinds & {list, tuple}:
        units = _STATE if len(value) == 4 else ["m" if len(value) in (2, 3) else None] * len(value)
    return [
        bare(one, f"{shown}[{i}] [{unit or '-'}]")
        for i, (one, unit) in enumerate(zip(value, units, strict=True))
    ]


def _is_date(value: Any) -> bool:
    kind = getattr(getattr(value, "dtype", None), "kind", "")
    if isinstance(kind, str) and kind in ("M", "m"):
        return True
    name = str(getattr(value, "dtype", ""))
    return (
        name.startswith(("Datetime", "Duration", "datetime64", "timedelta64"))
        or type(value).__module__ == "datetime"
        or str(getattr(value, "type", "")).startswith(("timestamp", "duration"))
    )


def _seconds(value: Any, shown: str) -> Array:
    """Return instants as seconds since 1970, spans as seconds."""
    if getattr(value, "tzinfo", None) is not None and hasattr(value, "timestamp"):
        return np.asarray(float(value.timestamp()))
    zone = getattr(getattr(value, "dtype", None), "tz", None)
    if zone is not None:  # pandas, with a zone
        values = getattr(value, "dt", value)
        value = values.tz_convert("UTC").tz_localize(None) if values is value else (
            values.tz_convert("UTC").dt.tz_localize(None)
        )  # fmt: skip
    array = np.asarray(value)
    if array.dtype.kind == "O":
        array = array.astype("timedelta64[us]" if _spans(array) else "datetime64[us]")
    if np.isnat(array).any():
        raise InputError(f"{shown}[{int(np.flatnonzero(np.isnat(array.ravel()))[0])}] is no time")
    if array.dtype.kind not in "Mm":
        raise InputError(f"{shown} cannot be read as times")
    unit = np.datetime_data(array.dtype)[0]
    if unit in ("Y", "M", "W", "D", "h", "m", "s"):
        array = array.astype(f"{array.dtype.kind}8[s]")
        return np.asarray(array.view("int64"), dtype=float)
    # Whole seconds and the rest apart: nanoseconds since 1970 have 19 digits.
    whole = array.astype(f"{array.dtype.kind}8[s]")
    rest = (array - whole) / np.timedelta64(1, "s")
    return np.asarray(whole.view("int64").astype(float) + rest, dtype=float)


def _spans(array: NDArray[Any]) -> bool:
    return hasattr(array.ravel()[0], "total_seconds") if array.size else False
