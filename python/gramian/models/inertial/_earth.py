"""The Earth under a navigator: radii of curvature and gravity."""

from __future__ import annotations

from gramian import _core
from gramian._arrays import number

__all__ = ["EARTH_RATE", "gravity", "radii"]

#: Rotation of the Earth, rad/s (WGS 84).
EARTH_RATE = _core.EARTH_RATE


def radii(latitude: float) -> tuple[float, float]:
    """Return the radii of curvature in the meridian and across it, metres.

    Parameters
    ----------
    latitude : float
        Geodetic, radians.

    Examples
    --------
    >>> meridian, normal = radii(0.0)
    >>> round(meridian), round(normal)
    (6335439, 6378137)
    """
    return _core.inertial_radii(number(latitude, "latitude"))


def gravity(latitude: float, height: float = 0.0) -> float:
    """Return gravity, m/s^2, positive downwards.

    Parameters
    ----------
    latitude : float
        Geodetic, radians.
    height : float
        Above the ellipsoid, metres.

    Notes
    -----
    Somigliana's formula; above the ellipsoid the second-order expansion of
    NIMA TR8350.2, eq. (4-3).

    Examples
    --------
    >>> import math
    >>> round(gravity(math.radians(45)), 6)
    9.806198
    """
    return _core.inertial_gravity(number(latitude, "latitude"), number(height, "height"))
