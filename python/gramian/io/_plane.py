"""Latitude and longitude to metres in one plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gramian.exceptions import GramianError, InputError

__all__ = ["centre", "to_plane"]

Array = NDArray[np.float64]


def centre(latitude: Array, longitude: Array) -> tuple[float, float]:
    """Return the middle of a set of places, degrees.

    Raises
    ------
    InputError
        Latitudes beyond 90 degrees, longitudes beyond 360, and places that reach further
        than a plane can serve (2000 km).
    """
    for name, values, limit in (("latitude", latitude, 90.0), ("longitude", longitude, 360.0)):
        if (bad := np.flatnonzero(np.abs(values) > limit)).size:
            packed = np.abs(values[bad[0]])
            hint = (
                f": is it degrees and minutes in one? Write {packed // 100:.0f} {packed % 100:g}"
                if packed % 100 < 60 and packed // 100 <= limit and packed > 360
                else ": are latitude and longitude swapped?"
                if name == "latitude" and np.abs(longitude).max() <= 90
                else ""
            )
            raise InputError(
                f"{name} = {values[bad[0]]:g} deg: must be within +-{limit:g} deg{hint}"
            )
    # Longitudes are averaged on the circle, for tracks that cross the date line.
    angle = np.radians(longitude)
    middle = np.degrees(np.arctan2(np.sin(angle).mean(), np.cos(angle).mean()))
    place = float((latitude.min() + latitude.max()) / 2), float(middle)
    east, north = to_plane(latitude, longitude, place)
    reach = float(np.hypot(east, north).max())
    if not reach < 1e6:
        raise InputError(
            f"the places reach {reach / 1000:.0f} km from their middle: too far for one plane "
            "(1000 km); choose the tracks that belong together"
        )
    return place


def to_plane(latitude: Array, longitude: Array, origin: tuple[float, float]) -> tuple[Array, Array]:
    """Return metres east and north of an origin, on the WGS 84 ellipsoid.

    The projection is azimuthal equidistant: distances and bearings from the origin are
    exact. Between other points lengths are true to d^2 / (6 R^2) across the radius, which
    is 4e-5 at 100 km (4 m), and bearings to the convergence of the meridians there.
    """
    try:
        from pyproj import Proj
    except ImportError as error:  # pragma: no cover - without the extra
        raise GramianError(
            "latitudes and longitudes need pyproj: pip install 'gramian[files]'"
        ) from error
    project = Proj(proj="aeqd", lat_0=origin[0], lon_0=origin[1], ellps="WGS84")
    east, north = project(longitude, latitude)
    return np.asarray(east, dtype=float), np.asarray(north, dtype=float)
