"""Two legs against a distant target at constant velocity: where to turn, in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from gramian import _core
from gramian import _options as options
from gramian._answers import Answer
from gramian._arrays import number, whole
from gramian.exceptions import InputError

__all__ = ["TwoLegs", "two_legs"]


@dataclass(frozen=True, eq=False, repr=False)
class TwoLegs(Answer):
    """The best two legs at long range.

    Attributes
    ----------
    turn : float
        Share of the time at which to turn.
    turn_time : float
        The same in seconds.
    headings : tuple of float
        Of the two legs, radians clockwise from the line of sight, lead then lag or lag then
        lead. At long range only what lies across it counts: a heading and its supplement
        are the same.
    log_det : float
        Log of the determinant of the information on (x0, y0, vx, vy).
    range_std : float
        Bound on the range at the first time, metres.
    """

    turn: float
    turn_time: float
    headings: tuple[float, float]
    log_det: float
    range_std: float


def two_legs(
    range_: float,
    speed: float,
    duration: float,
    samples: int,
    *,
    sigma: float,
    cross_speed: float = 0.0,
    turn: float | None = None,
    goal: Literal["determinant", "range"] = "determinant",
) -> TwoLegs:
    """Return the best two legs against a distant target at constant velocity.

    Parameters
    ----------
    range_ : float
        To the target, metres, > 0, long against the track.
    speed : float
        Of the observer, m/s, > 0.
    duration : float
        Of the track, seconds, > 0.
    samples : int
        Bearings, >= 4, evenly over the track.
    sigma : float
        Standard deviation of a bearing, radians, > 0.
    cross_speed : float
        Of the target across the line of sight, m/s, > 0 to the right, less than `speed` in
        size.
    turn : float, optional
        Turn at this share of the time instead of the best one, from lead to lag.
    goal : {"determinant", "range"}
        The largest determinant of the information on all four states, or the least
        variance of the range.

    Returns
    -------
    TwoLegs

    Raises
    ------
    InputError
        Numbers outside these limits.

    Notes
    -----
    At long range a bearing's row for cross-range, its rate, range and its rate is
    (1, t, -u / R, -t u / R) / (sigma R), with the cross-range distance u that observer and
    target have moved against each other. A straight leg has u linear in t, and no range. Two
    legs give the Gram matrix of 1, t, u, t u with a corner in u: its determinant is
    D (N / (sigma R)^2)^4 T^8 / R^4. Against a target without cross speed, with
    y = turn (1 - turn) and unit speed, D = y^3 (20 y^3 - 15 y + 4) / 6480. It is largest
    for 10 y^3 - 5 y + 1 = 0: a turn at 0.3322 or, equally, 0.6678 of the time, and 0.904
    times as large for a turn in the middle. The range alone is best for a turn at
    0.707 with the second leg at 44 degrees; at right angles 0.742 comes within 0.3 %.
    True to the order of track over range and of 1 / N.

    Examples
    --------
    >>> import numpy as np
    >>> best = two_legs(50e3, 5.0, 600.0, 61, sigma=np.radians(0.5))
    >>> round(best.turn, 4), np.degrees(best.headings)
    (0.3322, array([ 90., -90.]))
    """
    r, v, time, noise = (
        _positive(value, name, unit)
        for value, name, unit in (
            (range_, "range_", "m"),
            (speed, "speed", "m/s"),
            (duration, "duration", "s"),
            (sigma, "sigma", "rad"),
        )
    )
    count = whole(samples, "samples", 4, 2**53)
    options.choice(goal, "goal", ("determinant", "range"))
    cross = number(cross_speed, "cross_speed [m/s]") / v
    if turn is None:
        share, first, second, det, variance = _core.maneuver_best_two_legs(cross, goal == "range")
    else:
        share, first, second = number(turn, "turn"), 1.0, -1.0
        det, variance = _core.maneuver_two_leg_terms(share, 1.0 - cross, -1.0 - cross)
    # The terms are those of unit speed and time.
    with np.errstate(divide="ignore", invalid="ignore"):
        log_det = (
            4 * np.log(count)
            - 8 * (np.log(noise) + np.log(r))
            + 8 * np.log(time)
            - 4 * np.log(r)
            + np.log(det)
            + 4 * np.log(v)
        )
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        std = float(
            np.float64(noise) * r * (r / (np.float64(v) * time)) * np.sqrt(variance / count)
        )
    if np.isnan(log_det) or np.isnan(std) or (np.isinf(log_det) and log_det > 0):
        raise InputError(
            f"range_ = {r:g} m, speed = {v:g} m/s, duration = {time:g} s, sigma = {noise:g} rad, "
            f"cross_speed = {cross_speed} m/s: the bound overflows float64"
        )
    headings = (float(np.arcsin(first)), float(np.arcsin(second)))
    return TwoLegs(share, share * time, headings, float(log_det), std)


def _positive(value: float, name: str, unit: str) -> float:
    given = number(value, f"{name} [{unit}]")
    if not given > 0:
        raise InputError(f"{name} = {given} {unit}: must be > 0")
    return given
