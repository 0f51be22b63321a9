"""The closed-form laws of heading and the paths they make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import as_float_array, require_finite, whole
from gramian._text import brief
from gramian.exceptions import InputError

__all__ = ["LAWS", "AtStandoff", "Law", "Trajectory", "heading", "trajectory"]

Array = NDArray[np.float64]
#: The closed-form laws.
Law = Literal["max_det", "hammel_liu", "bearing_rate", "circle", "perpendicular"]
#: What a trajectory does at the stand-off range.
AtStandoff = Literal["stop", "circle"]

LAWS: tuple[Law, ...] = ("max_det", "hammel_liu", "bearing_rate", "circle", "perpendicular")


def heading(
    bearing: ArrayLike,
    range_: ArrayLike,
    step: ArrayLike,
    law: Law = "max_det",
    side: ArrayLike = 1,
    *,
    out: Array | None = None,
) -> Array:
    """Return the heading of the next leg that a law gives.

    Parameters
    ----------
    bearing : array_like, shape (...)
        Bearing of the target, radians clockwise from north.
    range_ : array_like, shape (...)
        Its range, metres, > 0.
    step : array_like, shape (...)
        Length of the leg: speed times interval, metres, > 0.
    law : {"max_det", "hammel_liu", "bearing_rate", "circle", "perpendicular"}
        With alpha = atan(step / range), the angle off the line of sight is
        pi/2 - 2 alpha, pi/2 - 1.5 alpha, acos(step / range),
        acos(step / (2 range)) and pi/2.
    side : array_like, shape (...)
        1 to turn right of the line of sight (clockwise), -1 to turn left. Over two
        legs keeping the side is better than changing it; over more it need not be
        (see `trajectory`).
    out : ndarray, shape of the result, optional
        Where the result is written: float64, C-contiguous, writable; it is returned. It may
        share memory with an argument. Without it a new array is made.

    Returns
    -------
    ndarray, shape (...)
        Radians clockwise from north, in (-pi, pi]. All arguments broadcast.

    Raises
    ------
    InputError
        A range or step that is not positive and finite; a step longer than the
        range ("max_det", "hammel_liu", "bearing_rate") or than twice the range
        ("circle"), where the law has no heading; a side that is not 1 or -1.

    Notes
    -----
    Xu et al. 2009: "max_det" is Theorem 1, eq. (12), the largest determinant of
    two bearings, one at each end of the leg. "bearing_rate" is Theorem 5: the heading
    is perpendicular to the line of sight at the end of the leg, C = beta_{k+1} +- pi/2,
    the tangent. No other heading changes the bearing more; the range falls,
    r'^2 = r^2 - s^2. "circle" stays on the circle of Theorem 6, which "bearing_rate"
    becomes in the limit of small steps: its leg is a chord.
    "hammel_liu" is not printed in the paper; this form gives its 15 figures.
    "perpendicular" is the paper's substitute for "bearing_rate" when only the
    present bearing is known; its path spirals outward.

    All are greedy. Over a horizon a planned path gives several times the
    determinant, and the inward turn of the first three comes from the length of the
    step: as the interval goes to zero they become the circle.

    Examples
    --------
    >>> import numpy as np
    >>> np.degrees(heading(0.0, 1000.0, 20.0)).round(3)
    np.float64(87.708)
    >>> np.degrees(heading(0.0, [1000.0, 500.0], 20.0, side=-1)).round(3)
    array([-87.708, -85.419])
    >>> np.degrees(heading(0.0, 100.0, 60.0, law="bearing_rate")).round(3)
    np.float64(53.13)
    >>> np.degrees(heading(0.0, 100.0, 60.0, law="circle")).round(3)
    np.float64(72.542)
    """
    if not isinstance(law, str):
        options.choice(law, "law", LAWS)
    return _core.maneuver_heading(bearing, range_, step, law, side, out)


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Answer):
    """A path that follows a law, and what its bearings tell of a fixed target.

    Attributes
    ----------
    path : ndarray, shape (..., samples, 2)
        East and north of the observer, metres; the first is the start.
    bearings : ndarray, shape (..., samples)
        Of the target, radians clockwise from north.
    ranges : ndarray, shape (..., samples)
        To the target, metres.
    headings : ndarray, shape (..., samples - 1)
        Of each leg, radians clockwise from north.
    information : ndarray, shape (..., samples, 2, 2)
        Fisher information on the target's position (east, north) of all bearings
        up to each sample, 1 / m^2.
    det : ndarray, shape (..., samples)
        Its determinant, 1 / m^4.
    count : ndarray of int, shape (...)
        How many samples were flown; less than `samples` where the path stopped at
        the stand-off range. From there on it keeps its last position and heading
        and measures no more.
    law : str
        The law followed.
    sides : ndarray of int, shape (..., samples - 1)
        The side of each leg: 1 for right, -1 for left.
    """

    path: Array
    bearings: Array
    ranges: Array
    headings: Array
    information: Array
    det: Array
    count: NDArray[np.int64]
    law: Law
    sides: NDArray[np.int64]

    @property
    def crlb_std(self) -> Array:
        """Bounds (..., samples, 2) on east and north, metres; `inf` where there is none."""
        across = np.stack([self.information[..., 1, 1], self.information[..., 0, 0]], axis=-1)
        none = np.full(across.shape, np.inf)
        det = np.broadcast_to(self.det[..., None], across.shape)
        std: Array = np.sqrt(np.divide(across, det, out=none, where=det > 0))
        return std

    def summary(self) -> str:
        """Return the path in a line of words, or the batch's size and middle."""
        if self.det.ndim > 1:
            paths = int(np.prod(self.det.shape[:-1]))
            return (
                f"{paths} paths of {self.det.shape[-1]} samples by law {self.law}: "
                f"last range {np.median(self.ranges[..., -1]):.6g} m, "
                f"det J {brief(np.median(self.det[..., -1]), 4)} 1/m^4 (medians)"
            )
        stopped = "" if self.count == self.det.size else ", then stopped at the stand-off range"
        return (
            f"{int(self.count)} samples by law {self.law}{stopped}: "
            f"range {self.ranges[0]:.6g} m to {self.ranges[-1]:.6g} m, "
            f"det J {brief(self.det[-1], 4)} 1/m^4, "
            f"bound {brief(self.crlb_std[-1, 0])} m east, {brief(self.crlb_std[-1, 1])} m north"
        )

    def _as_table(self) -> Columns:
        if self.det.ndim > 1:
            raise InputError("a table is of one path: this is a batch")
        values = {
            "east": self.path[:, 0],
            "north": self.path[:, 1],
            "bearing": self.bearings,
            "range": self.ranges,
            "det": self.det,
            "east_std": self.crlb_std[:, 0],
            "north_std": self.crlb_std[:, 1],
        }
        units = dict.fromkeys(values, "m") | {"bearing": "rad", "det": "1/m^4"}
        return Columns("sample", range(len(self.path)), values, units)


def trajectory(
    target: ArrayLike,
    start: ArrayLike,
    speed: ArrayLike,
    dt: ArrayLike,
    samples: int,
    *,
    law: Law = "max_det",
    side: ArrayLike | Literal["best"] = 1,
    sides: ArrayLike | None = None,
    sigma: ArrayLike = 1.0,
    standoff: ArrayLike | None = None,
    at_standoff: AtStandoff = "stop",
) -> Trajectory:
    """Follow a law of heading about a fixed target.

    Parameters
    ----------
    target : array_like, shape (..., 2)
        East and north, metres.
    start : array_like, shape (..., 2)
        The observer at the first sample.
    speed : array_like, shape (...)
        Its speed, m/s, > 0.
    dt : array_like, shape (...)
        Time between bearings, s, > 0.
    samples : int
        Number of samples >= 1, the first at the start: samples - 1 legs.
    law
        As for `heading`.
    side : array_like, shape (...), or "best"
        1 to turn right of the line of sight, -1 to turn left, on all legs. "best"
        searches the changes of side that make the determinant at the end large,
        the first leg to the right; see Notes.
    sides : array_like, shape (..., samples - 1), optional
        The side of each leg, instead of `side`.
    sigma : array_like, shape (...)
        Standard deviation of a bearing, radians, > 0. With 1, the information is
        that of unit noise: divide by sigma^2 afterwards.
    standoff : array_like, shape (...), optional
        The range not to go below, metres.
    at_standoff : {"stop", "circle"}
        What to do where the law's next leg would end inside the stand-off range:
        stop and measure no more, or fly the leg that ends exactly at that range.

    Returns
    -------
    Trajectory
        All arguments broadcast over their leading axes.

    Raises
    ------
    InputError
        Shapes that do not fit, numbers that are not finite, a speed, interval or
        sigma that is not positive, a start on the target or inside the stand-off
        range, a path that comes nearer than a step, where "max_det" and
        "hammel_liu" have no heading (the message names the sample).

    Notes
    -----
    Xu et al. 2009, eqs. (15) and (16); the range then follows (17),
    r'^2 = (r^2 - s^2)^2 / (r^2 + s^2) with the step s: r^2 falls by about 3 s^2 a
    step, so that every path of "max_det" comes to r = s in the end, where the
    law ends: give a stand-off range of at least a step.

    Theorem 2, "keep the side", is proved for two legs. For the sum over all pairs of
    bearings it fails: with step / range = 0.2, ten legs of "max_det" to the sides
    ++--++-+++ have 1.257 times the determinant of ten legs to one side; with
    step / range = 0.02, 160 legs with one change after leg 17 have 1.0015 times.
    ``side="best"`` tries every sequence up to 16 legs; on a longer path it adds, moves
    and takes back one change and two at a time until none gains, a local optimum
    that is never below one side. Cost: 0.02 us a sample in a batch,
    0.1 us alone.

    Examples
    --------
    >>> path = trajectory([0, 1000], [0, 0], 20.0, 1.0, 500, sigma=0.001**0.5)
    >>> print(path.summary())
    500 samples by law max_det: range 1000 m to 633.787 m, det J 0.1452 1/m^4, bound ...
    >>> trajectory([0, 1000], [0, 0], 20.0, 1.0, 500, standoff=900.0).count
    array(159)
    >>> both = trajectory([0, 100], [0, 0], 20.0, 1.0, 11, side="best")
    >>> "".join("+" if side > 0 else "-" for side in both.sides)
    '++--++-+++'
    """
    n = whole(samples, "samples", 1)
    if not isinstance(law, str):
        options.choice(law, "law", LAWS)
    options.choice(at_standoff, "at_standoff", ("stop", "circle"))
    step = _positive(speed, "speed", "m/s") * _positive(dt, "dt", "s")
    least = 0.0 if standoff is None else standoff

    def fly(sides: ArrayLike) -> Any:
        circles = at_standoff == "circle"
        return _core.maneuver_trajectory(target, start, step, n, law, sides, sigma, least, circles)

    if sides is not None:
        if not (isinstance(side, int) and side == 1):
            raise InputError("side and sides: give one of them")
        flown = as_float_array(sides, "sides")
        if flown.shape[-1:] != (n - 1,):
            raise InputError(
                f"sides has shape {flown.shape}: must be (..., {n - 1}): one for each leg"
            )
    elif isinstance(side, str):
        options.choice(side, "side", ("best",))
        one = fly([1.0])
        flown = _core.maneuver_best_sides(one["bearings"], one["ranges"], one["count"])
    else:
        flown = as_float_array(side, "side")[..., None]
    found = fly(flown if n > 1 else np.ones(1))
    require_finite(found["information"], "the information")
    require_finite(found["det"], "det J")
    return Trajectory(
        path=found["path"],
        bearings=found["bearings"],
        ranges=found["ranges"],
        headings=found["headings"],
        information=found["information"],
        det=found["det"],
        count=found["count"].astype(np.int64),
        law=law,
        sides=np.broadcast_to(flown, found["headings"].shape).astype(np.int64),
    )


def _positive(value: ArrayLike, name: str, unit: str) -> Array:
    array = as_float_array(value, name)
    if not (np.isfinite(array) & (array > 0)).all():
        bad = np.argwhere(~(np.isfinite(array) & (array > 0)))[0]
        index = f"[{', '.join(str(i) for i in bad)}]" if array.ndim else ""
        raise InputError(f"{name}{index} = {array[tuple(bad)]} {unit}: must be > 0 and finite")
    return array
