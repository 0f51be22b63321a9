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

from gramian import _core

__all__ = ["LEAF", "Moments", "Tree", "moments"]

Array = NDArray[np.float64]

#: Trials that are summed directly; chunks are this times a power of two.
LEAF = 16


@dataclass(frozen=True, eq=False)
class Moments:
    """Moments of vectors (d,).

    Attributes
    ----------
    d : int
    node : ndarray
        All of them in a row: count, `mean`, `scatter`, `fourth`, `low`, `high`.
    """

    d: int
    node: Array

    @property
    def count(self) -> float:
        """How many vectors."""
        return float(self.node[0])

    @property
    def mean(self) -> Array:
        """Their mean (d,)."""
        return self.node[1 : 1 + self.d]

    @property
    def scatter(self) -> Array:
        """Sum of products of deviations from the mean (d, d)."""
        return self.node[1 + self.d : 1 + self.d + self.d**2].reshape(self.d, self.d)

    @property
    def fourth(self) -> Array:
        """Sum of fourth powers of the values themselves (d,)."""
        return self.node[-3 * self.d : -2 * self.d]

    @property
    def low(self) -> Array:
        """Lowest values (d,); `inf` for no vector."""
        return self.node[-2 * self.d : -self.d]

    @property
    def high(self) -> Array:
        """Highest values (d,); `-inf` for no vector."""
        return self.node[-self.d :]

    def merge(self, other: Moments) -> Moments:
        """Return the moments of both: exactly `self` where the other is empty."""
        return Moments(self.d, _core.merge_moments(self.d, self.node, other.node))


def moments(values: Array, ok: NDArray[np.bool_]) -> Moments:
    """Return the moments of the rows (trials, d) of one chunk that are `ok`."""
    return Moments(values.shape[1], _core.moments(values, ok))


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
