"""Observability while the bearings arrive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gramian import _core

__all__ = ["Monitor", "MonitorAnswer"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MonitorAnswer:
    """What the bearings so far say.

    Attributes
    ----------
    count : int
        How many bearings there are.
    rank : int
        Rank of the rows with unit columns, of 4.
    det, logdet : float
        Determinant of the information and its logarithm.
    singular_value : float
        Smallest singular value of the rows with unit columns, at the first time.
    crlb_std : ndarray, shape (4,)
        Bounds on x0, y0, vx, vy at the first time, `inf` where there is none: metres
        where ranges were given, parts of the range where not.
    statistic, dof, p_value : float
        The test of `observability_test`, in its streaming form; 0, 0 and 1 below four
        bearings.
    relative_motion : ndarray, shape (4,)
        The relative motion that fits best, at unit range at the first time.
    """

    count: int
    rank: int
    det: float
    logdet: float
    singular_value: float
    crlb_std: Array
    statistic: float
    dof: float
    p_value: float
    relative_motion: Array


class Monitor:
    """Take bearings one by one and say after each what they determine so far.

    Notes
    -----
    No bearing is kept: 28 numbers are, whatever the count. Rank, determinant,
    smallest singular value and bound are those of all rows at once. The statistic
    of the test is the smallest singular value of the rows in standard time, that is
    the sum of squared residuals each weighted by the relative square of its range.
    Where the range hardly changes this is the chi-square of `observability_test`; where
    it does, scale and degrees of freedom (then not a whole number) are set so that mean
    and variance agree: simulated unobservable tracks are rejected at the level or, for
    close passages, somewhat more rarely (at 5 %, 3 to 5 %). The near bearings, which say
    most, count least then, so `observability_test` has more power there.

    The Rust type under it, `bearings::Monitor`, needs no allocator and 220 bytes in
    single precision.

    Examples
    --------
    >>> import numpy as np
    >>> monitor = Monitor()
    >>> for t in np.arange(0.0, 400.0, 20.0):
    ...     answer = monitor.push(t, np.arctan2(3.0 * t, 10_000.0 - 6.0 * t), sigma=0.01)
    >>> answer.count, answer.rank, bool(answer.p_value > 0.99)
    (20, 3, True)
    """

    def __init__(self) -> None:
        self._monitor = _core.BearingMonitor()

    def push(
        self, time: float, bearing: float, sigma: float, distance: float | None = None
    ) -> MonitorAnswer:
        """Take in a bearing and return what all so far say.

        Parameters
        ----------
        time : float
            Later than all before, seconds.
        bearing : float
            Radians, wrapped or not.
        sigma : float
            Its standard deviation, radians, > 0.
        distance : float, optional
            The target's distance as far as it is known, metres, > 0; for all bearings
            or for none. With it the information is Fisher's and bounds are in metres;
            without, the range counts as 1.

        Returns
        -------
        MonitorAnswer

        Raises
        ------
        InputError
            A time not later than the one before, a sigma or distance that is not positive, a
            distance that only some bearings have, a number that is not finite. The bearing is
            not taken in then.
        """
        self._monitor.push(time, bearing, sigma, distance)
        return self.answer()

    def answer(self) -> MonitorAnswer:
        """Return what the bearings so far say."""
        count, rank, numbers = self._monitor.answer()
        det, logdet, singular_value, statistic, dof, p_value = (float(x) for x in numbers[:6])
        return MonitorAnswer(
            count=count,
            rank=rank,
            det=det,
            logdet=logdet,
            singular_value=singular_value,
            crlb_std=numbers[6:10],
            statistic=statistic,
            dof=dof,
            p_value=p_value,
            relative_motion=numbers[10:14],
        )
