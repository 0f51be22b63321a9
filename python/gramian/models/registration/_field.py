"""Maps of where targets tell the biases well."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gramian import _core
from gramian._answers import Answer, Columns
from gramian._arrays import as_float_array, number, whole
from gramian._registry import draw
from gramian.exceptions import InputError
from gramian.models.registration._setup import Array, SensorsLike, setup

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Places of a map that are worked on at a time.
_PLACES = 100_000


@dataclass(frozen=True, eq=False, repr=False)
class Field(Answer):
    """A map.

    Attributes
    ----------
    east, north : ndarray, shape (nx,) and (ny,)
        Places of the map, m.
    values : ndarray, shape (ny, nx)
        eta, or the bound of a bias (`inf` where it is not observable).
    quantity, unit : str
    heading : float or None
        Of the short tracks, rad; None for discs.
    radius : float
        m.
    sensors : ndarray, shape (N, 2)
    labels : tuple of str
    """

    east: Array
    north: Array
    values: Array
    quantity: str
    unit: str
    heading: float | None
    radius: float
    sensors: Array
    labels: tuple[str, ...]

    def plot(self) -> Figure:
        """Draw the map; needs matplotlib."""
        return draw(self, "field")

    def _as_table(self) -> Columns:
        east, north = np.meshgrid(self.east, self.north)
        values = {"east": east.ravel(), "north": north.ravel(), self.quantity: self.values.ravel()}
        units = {"east": "m", "north": "m", self.quantity: self.unit}
        return Columns("place", range(self.values.size), values, units)

    def to_xarray(self) -> Any:
        """Return the map as an xarray Dataset with the coordinates east and north."""
        import xarray as xr

        metres = {"units": "m"}
        value = (("north", "east"), self.values, {"units": self.unit})
        places = {"east": ("east", self.east, metres), "north": ("north", self.north, metres)}
        return xr.Dataset({self.quantity: value}, places)

    def _html_table(self) -> str:
        return ""


def field(
    sensors: SensorsLike,
    sigma: ArrayLike,
    extent: ArrayLike,
    heading: float | None = None,
    radius: float = 2000.0,
    *,
    quantity: str = "eta",
    points: int = 100,
) -> Field:
    """Return the map of how well the biases are determined by looks around each place.

    Parameters
    ----------
    sensors : array_like, shape (N, 2), or mapping of str to array_like, shape (2,)
    sigma
        As for `rows`.
    extent : array_like, shape (4,)
        West, east, south and north of the map, m.
    heading : float, optional
        Course of a target, rad clockwise from north: the 8 looks are then spread
        along a straight piece of track, 2 radius long, instead of on a circle.
    radius : float
        m.
    quantity : str
        "eta", or the name of a bias whose bound is wanted.
    points : int
        Places along the longer side of the map.

    Returns
    -------
    Field

    Notes
    -----
    A single look has no degree: its projector has the same trace everywhere, and
    only how it turns from place to place tells anything. So each place of the
    map stands for 8 looks around it.

    Examples
    --------
    >>> here = field([[0, 0], [60e3, 0]], (50, np.radians(0.1)), (30e3, 30001, 40e3, 40001), points=2)
    >>> here.values[0, 0].round(6)
    np.float64(0.031317)
    """  # noqa: E501
    known = setup(sensors, sigma, still="field")
    if known.d != 2:
        raise InputError("field is a map of the plane: give sensors (N, 2)")
    edges = as_float_array(extent, "extent")
    if edges.shape != (4,) or not np.isfinite(edges).all():
        raise InputError(f"extent = {extent!r}: must be west, east, south, north in metres")
    west, east, south, north = edges
    if not (west < east and south < north):
        raise InputError(f"extent = {extent!r}: must have west < east and south < north")
    radius = number(radius, "radius")
    if not radius > 0:
        raise InputError(f"radius = {radius} m: must be > 0 and finite")
    points = whole(points, "points", 2, 10_000)
    if heading is not None:
        heading = number(heading, "heading")
    index = None if isinstance(quantity, str) and quantity == "eta" else known.index(quantity)
    longer = max(east - west, north - south)
    if not longer < 1e150:
        raise InputError(f"extent = {extent!r}: must be narrower than 1e150 m")
    nx = max(2, round(points * (east - west) / longer))
    ny = max(2, round(points * (north - south) / longer))
    x, y = np.linspace(west, east, nx), np.linspace(south, north, ny)
    if heading is None:
        angle = np.arange(8) * np.pi / 4
        around = radius * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    else:
        along = np.linspace(-radius, radius, 8)
        around = along[:, None] * np.array([np.sin(heading), np.cos(heading)])
    none = np.zeros(known.n)

    def of_rows(norths: Array) -> Array:
        places = np.stack(np.meshgrid(x, norths), axis=-1)[:, :, None, :] + around
        # A look exactly on a sensor has no azimuth: beside it, it has.
        for sensor in known.places:
            on = np.hypot(*np.moveaxis(places - sensor, -1, 0)) < 1e-6 * radius
            places[on] += 1e-3 * radius
        if index is None:
            return _core.registration_eta(places, known.places, known.sigma, none)
        looks = _core.registration_rows(places, known.places, known.sigma, none, known.flags)
        return _core.crlb_std(looks, None)[..., index]

    # Some rows of the map at a time: little memory, and Ctrl-C ends it soon.
    step = max(1, _PLACES // nx)
    values = np.concatenate([of_rows(y[k : k + step]) for k in range(0, ny, step)])
    unit = "" if index is None else known.units[index]
    return Field(x, y, values, quantity, unit, heading, float(radius), known.places, known.labels)
