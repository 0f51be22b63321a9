"""Observability while the bearings arrive."""

from __future__ import annotations

from gramian import _core
from gramian._core import MonitorAnswer

__all__ = ["Monitor", "MonitorAnswer"]


class Monitor(_core.BearingMonitor):
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

    __slots__ = ()
