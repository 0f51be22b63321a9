"""The Earth under a navigator: ellipsoid, gravity, and how the axes turn over it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gramian._arrays import number
from gramian.exceptions import InputError

__all__ = ["EARTH_RATE", "Earth", "checked_place", "gravity", "radii"]

Array = NDArray[np.float64]

#: Rotation of the Earth, rad/s (WGS 84).
EARTH_RATE = 7.292115e-5

# WGS 84: semi-major axis, flattening, and the constants of Somigliana's formula
# for gravity on the ellipsoid. NIMA TR8350.2, tables 3.1, 3.3 and 3.4.
_SEMI_MAJOR = 6378137.0
_FLATTENING = 1 / 298.257223563
_ECCENTRICITY2 = _FLATTENING * (2 - _FLATTENING)
_GRAVITY_EQUATOR = 9.7803253359
_SOMIGLIANA = 0.00193185265241
# omega^2 a^2 b / GM, for gravity above the ellipsoid.
_GRAVITY_RATIO = 0.00344978650684


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
    latitude = number(latitude, "latitude")
    w = np.sqrt(1 - _ECCENTRICITY2 * np.sin(latitude) ** 2)
    return float(_SEMI_MAJOR * (1 - _ECCENTRICITY2) / w**3), float(_SEMI_MAJOR / w)


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
    latitude, height = number(latitude, "latitude"), number(height, "height")
    if not abs(height) < _SEMI_MAJOR:
        raise InputError(f"height = {height} m: must be within the radius of the Earth")
    s = np.sin(latitude) ** 2
    ground = _GRAVITY_EQUATOR * (1 + _SOMIGLIANA * s) / np.sqrt(1 - _ECCENTRICITY2 * s)
    first, second = _free_air(s)
    return float(ground * (1 - first * height + second * height**2))


def _free_air(s: float) -> tuple[float, float]:
    first = 2 / _SEMI_MAJOR * (1 + _FLATTENING + _GRAVITY_RATIO - 2 * _FLATTENING * s)
    return first, 3 / _SEMI_MAJOR**2


class Earth:
    """Rates of the navigation axes and their derivatives at one place."""

    def __init__(self, latitude: float, height: float, rate: float) -> None:
        self.rate = number(rate, "earth_rate")
        self.latitude, self.height = latitude, height
        self.sin, self.cos = np.sin(latitude), np.cos(latitude)
        self.tan = self.sin / self.cos
        meridian, normal = radii(latitude)
        self.m, self.n = meridian + height, normal + height
        w2 = 1 - _ECCENTRICITY2 * self.sin**2
        # d R / d latitude
        self.dn = normal * _ECCENTRICITY2 * self.sin * self.cos / w2
        self.dm = 3 * meridian * _ECCENTRICITY2 * self.sin * self.cos / w2

    def rotation(self) -> Array:
        """Return the rate of the Earth in N, W, U."""
        return self.rate * np.array([self.cos, 0.0, self.sin])

    def rotation_by_place(self) -> Array:
        """Return its derivative by latitude, longitude and height."""
        out = np.zeros((3, 3))
        out[:, 0] = self.rate * np.array([-self.sin, 0.0, self.cos])
        return out

    def transport(self, v: Array) -> Array:
        """Return the rate at which the axes turn as they move over the Earth."""
        rate: Array = self.transport_by_speed() @ v
        return rate

    def transport_by_speed(self) -> Array:
        """Return its derivative by the velocity."""
        return np.array(
            [[0, -1 / self.n, 0], [1 / self.m, 0, 0], [0, -self.tan / self.n, 0]], dtype=float
        )

    def transport_by_place(self, v: Array) -> Array:
        """Return its derivative by latitude, longitude and height."""
        north, west = v[0], v[1]
        n, m, tan = self.n, self.m, self.tan
        by_latitude = [
            west * self.dn / n**2,
            -north * self.dm / m**2,
            -west * (1 / self.cos**2 / n - tan * self.dn / n**2),
        ]
        by_height = [west / n**2, -north / m**2, west * tan / n**2]
        return np.array([by_latitude, [0.0, 0.0, 0.0], by_height]).T

    def gravity_by_place(self) -> Array:
        """Return the derivative of gravity by latitude, longitude and height."""
        s, ds = self.sin**2, 2 * self.sin * self.cos
        w2 = 1 - _ECCENTRICITY2 * s
        ground = _GRAVITY_EQUATOR * (1 + _SOMIGLIANA * s) / np.sqrt(w2)
        by_latitude = (
            ground * ds * (_SOMIGLIANA / (1 + _SOMIGLIANA * s) + _ECCENTRICITY2 / (2 * w2))
        )
        first, second = _free_air(s)
        first_by_latitude = -4 * _FLATTENING / _SEMI_MAJOR * ds
        h = self.height
        return np.array(
            [
                by_latitude * (1 - first * h + second * h**2) - ground * first_by_latitude * h,
                0.0,
                ground * (-first + 2 * second * h),
            ]
        )

    def place_rates(self, v: Array) -> tuple[Array, Array]:
        """Return the derivatives of (L', lambda', h') by velocity and by place."""
        by_speed, by_latitude, by_height = self.to_place()
        by_place = np.zeros((3, 3))
        by_place[:, 0], by_place[:, 2] = by_latitude @ v, by_height @ v
        return by_speed, by_place

    def to_place(self) -> tuple[Array, Array, Array]:
        """Return the matrix from metres N, W, U to latitude, longitude, height.

        And its derivatives by latitude and by height.
        """
        n, m, cos = self.n, self.m, self.cos
        matrix = np.diag([1 / m, -1 / (n * cos), 1.0])
        by_latitude = np.diag([-self.dm / m**2, (self.dn / n - self.tan) / (n * cos), 0.0])
        by_height = np.diag([-1 / m**2, 1 / (n**2 * cos), 0.0])
        return matrix, by_latitude, by_height


def checked_place(latitude: float, height: float) -> tuple[float, float]:
    """Return latitude and height as they may be, or say what is wrong with them."""
    latitude, height = number(latitude, "latitude"), number(height, "height")
    if not abs(latitude) <= np.pi / 2:
        raise InputError(f"latitude = {latitude} rad: must be within -pi/2 and pi/2")
    # Nearer than this, a millimetre, tan L has no digit left that means anything.
    if np.pi / 2 - abs(latitude) < 1e-10:
        raise InputError(
            f"latitude = {latitude} rad is a pole: west and longitude do not exist there (tan L)"
        )
    # Gravity is expanded in the height over the radius: far out it means nothing.
    if not -_SEMI_MAJOR / 2 < height < _SEMI_MAJOR:
        raise InputError(
            f"height = {height} m: must be above the ellipsoid's core and below its radius"
        )
    return latitude, height
