"""Channels that are dead, stuck or doubled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._text import brief
from gramian._values import Value
from gramian.estimation._parts import SMALL

__all__ = ["Channel", "channel_faults", "faulty"]

Array = NDArray[np.float64]

#: Of a batch the faults of so many records are told in words.
_TOLD = 20


@dataclass(frozen=True, eq=False)
class Channel(Value):
    """A channel of a recording: its name, where its readings are, and when they were taken.

    Attributes
    ----------
    name : str
    places : ndarray of int, shape (k,)
        Among the measurements, in the order of time.
    times : ndarray, shape (k,)
        When they were taken.
    unit : str
        Of the times, or what they number: "look".
    """

    name: str
    places: NDArray[np.intp]
    times: Array
    unit: str = "s"


def channel_faults(
    readings: ArrayLike, sigma: ArrayLike, channels: Sequence[Channel]
) -> tuple[str, ...]:
    """Return which channels are dead, stuck or doubled, in words.

    Parameters
    ----------
    readings : array_like, shape (m,)
        NaN where one is missing.
    sigma : array_like, shape (), (1,) or (m,)
        Standard deviations; 0 for a reading that does not count.
    channels : sequence of Channel

    Returns
    -------
    tuple of str

    Notes
    -----
    A channel is stuck where readings in the middle of a step of its converter would keep one
    value for so long in less than one record of 10^4; where readings around the run repeat
    each other as well, the steps are coarse, and nothing is told. Exact data, which have no
    noise, repeat themselves: where chi2 is improbably small, what is told here is no fault.
    """
    return _faults(np.asarray(readings, dtype=float), sigma, channels)[0]


def _faults(values: Array, sigma: ArrayLike, channels: Sequence[Channel]) -> list[tuple[str, ...]]:
    """Return what `channel_faults` does of each of the records (..., m), one after another."""
    deviations = np.atleast_1d(np.asarray(sigma, dtype=float))
    deviations = np.broadcast_to(deviations, (*deviations.shape[:-1], values.shape[-1]))
    kinds = _core.channels(values, deviations, [list(map(int, c.places)) for c in channels])
    kinds = kinds.reshape(-1 if channels else int(np.prod(values.shape[:-1])), len(channels), 3)
    told: list[tuple[str, ...]] = [()] * len(kinds)
    for index in np.flatnonzero((kinds[..., 0] > 0).any(axis=-1)).tolist():
        found = zip(channels, kinds[index].astype(int).tolist(), strict=True)
        told[index] = tuple(_fault(channels, one, kind) for one, kind in found if kind[0])
    return told


def _fault(channels: Sequence[Channel], one: Channel, kind: Sequence[int]) -> str:
    code, first, last = kind
    if code == 1:
        return f"{one.name} is constant over the record: dead or stuck"
    if code == 3:
        return f"{one.name} is a copy of {channels[first].name}"
    times = (brief(one.times[k], 6) for k in (first, last))
    ends = " to ".join(f"{t} s" if one.unit == "s" else f"{one.unit} {t}" for t in times)
    return f"{one.name} is stuck at one value from {ends}, longer than its noise lets it"


def faulty(
    readings: Array, sigma: ArrayLike, channels: Sequence[Channel], p_value: ArrayLike
) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Return which records (...) have a faulty channel, and in words which and where.

    Not those whose `p_value`, that of chi2, is near 1 or NaN: exact data repeat themselves.
    """
    with np.errstate(invalid="ignore"):
        asked = np.asarray(p_value) <= SMALL
    # Times or an observer of each record make more records than there are readings.
    shape = np.broadcast_shapes(readings.shape[:-1], asked.shape)
    readings = np.broadcast_to(readings, (*shape, readings.shape[-1]))
    asked = np.broadcast_to(asked, shape)
    if not channels or not asked.any():
        return np.zeros(shape, dtype=bool), ()
    told = _faults(readings, sigma, channels)
    bad = np.array([bool(words) for words in told], dtype=bool).reshape(shape) & asked
    if not shape:
        return bad, told[0] if bad else ()
    places = np.argwhere(bad)
    indices = np.flatnonzero(bad)
    words = [
        f"record {', '.join(map(str, place))}: {'; '.join(told[index])}"
        for place, index in zip(places[:_TOLD].tolist(), indices.tolist(), strict=False)
    ]
    if len(places) > _TOLD:
        words.append(f"and {len(places) - _TOLD} records more")
    return bad, tuple(words)
