"""Statistics that are summed in one fixed order, whatever the chunks and workers.

The trials are the leaves of one binary tree: a leaf holds `LEAF` neighbouring
trials, and a node is the merge of its two children. A chunk of a power of two
of trials is a whole subtree, so a run cut in other chunks, on other workers or
in two sittings goes through the same additions and ends in the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEAF", "Moments", "Tree", "moments"]

Array = NDArray[np.float64]

#: Trials that are summed directly; chunks are this times a power of two.
LEAF = 16


@dataclass(frozen=True, eq=False)
class Moments:
    """Moments of vectors (d,), of one node or of several (leading axis).

    Attributes
    ----------
    count : ndarray, shape (...)
    mean : ndarray, shape (..., d)
    scatter : ndarray, shape (..., d, d)
        Sum of products of deviations from the mean.
    fourth : ndarray, shape (..., d)
        Sum of fourth powers of the values themselves.
    low, high : ndarray, shape (..., d)
        Extremes; `inf` and `-inf` for no value.
    """

    count: Array
    mean: Array
    scatter: Array
    fourth: Array
    low: Array
    high: Array

    def merge(self, other: Moments) -> Moments:
        """Return the moments of both (Chan, Golub & LeVeque 1983).

        Exactly `self` where the other is empty, so padding changes nothing.
        """
        count = self.count + other.count
        share = other.count / np.maximum(count, 1.0)
        change = other.mean - self.mean
        weight = self.count * share
        return Moments(
            count,
            self.mean + change * share[..., None],
            self.scatter
            + other.scatter
            + (change[..., :, None] * change[..., None, :]) * weight[..., None, None],
            self.fourth + other.fourth,
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
        )

    def _pick(self, index: int | slice) -> Moments:
        return Moments(
            self.count[index],
            self.mean[index],
            self.scatter[index],
            self.fourth[index],
            self.low[index],
            self.high[index],
        )


def moments(values: Array, ok: NDArray[np.bool_]) -> Moments:
    """Return the moments of the rows (trials, d) of one chunk that are `ok`."""
    trials, d = values.shape
    leaves = 1
    while leaves * LEAF < trials:
        leaves *= 2
    everything = bool(ok.all())
    full = everything and trials == leaves * LEAF
    # State by state, so that each sum runs over neighbours in memory.
    padded = np.zeros((d, leaves * LEAF))
    weight = np.zeros(leaves * LEAF)
    if everything:
        padded[:, :trials] = values.T
        weight[:trials] = 1.0
    else:
        padded[:, :trials][:, ok] = values[ok].T
        weight[:trials][ok] = 1.0
    columns, weights = padded.reshape(d, leaves, LEAF), weight.reshape(leaves, LEAF)
    count = np.full(leaves, float(LEAF)) if full else _sum(weights)
    mean = _sum(columns) / np.maximum(count, 1.0)
    deviation = columns - mean[:, :, None]
    if full:
        low, high = columns.min(axis=-1), columns.max(axis=-1)
    else:
        deviation *= weights
        low = np.where(weights > 0, columns, np.inf).min(axis=-1)
        high = np.where(weights > 0, columns, -np.inf).max(axis=-1)
    scatter = np.empty((leaves, d, d))
    for i in range(d):
        for j in range(i + 1):
            scatter[:, i, j] = scatter[:, j, i] = _sum(deviation[i] * deviation[j])
    columns *= columns
    columns *= columns
    node = Moments(
        count,
        mean.T,
        scatter,
        _sum(columns).T,
        low.T,
        high.T,
    )
    while leaves > 1:
        node = node._pick(slice(0, None, 2)).merge(node._pick(slice(1, None, 2)))
        leaves //= 2
    return node._pick(0)


def _sum(values: Array) -> Array:
    """Sum over the last axis, of length LEAF, by halves: one order on every machine."""
    while values.shape[-1] > 1:
        half = values.shape[-1] // 2
        values = values[..., :half] + values[..., half:]
    return values[..., 0]


class Tree:
    """Merges the moments of chunks, given in order, as the one binary tree does."""

    def __init__(self) -> None:
        self._waiting: list[tuple[int, Moments]] = []

    def add(self, node: Moments) -> None:
        """Take the next chunk, a subtree of the same height as the others."""
        height = 0
        while self._waiting and self._waiting[-1][0] == height:
            node = self._waiting.pop()[1].merge(node)
            height += 1
        self._waiting.append((height, node))

    def total(self) -> Moments:
        """Return the moments of all chunks so far; there must be one."""
        nodes = [node for _, node in self._waiting]
        total = nodes.pop()
        while nodes:
            total = nodes.pop().merge(total)
        return total
