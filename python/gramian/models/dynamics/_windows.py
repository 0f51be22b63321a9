"""Observability along a trajectory, window by window."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gramian._answers import Answer, Columns
from gramian._registry import draw
from gramian._text import describe_direction, plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Windows"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Windows(Answer):
    """What windows of outputs tell of the state at their beginning.

    Attributes
    ----------
    names, units : tuple of str, length n
    times : ndarray, shape (W,)
        Where each window begins.
    width : float
    samples : int
        In each window.
    rank : ndarray of int, shape (W,)
        How many combinations are determined.
    free : int
        How many there are: n, less the constraints on the state.
    std : ndarray, shape (W, n)
        Bound of the standard deviation of each state from the window alone; `inf` where
        it is not determined.
    singular_values : ndarray, shape (W, free)
        Of the rows with unit columns, descending: a small last one is a weak direction.
    null_spaces : tuple of ndarray, shape (n, nullity)
        What each window does not determine, in physical units.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    times: Array
    width: float
    samples: int
    rank: NDArray[np.int64]
    free: int
    std: Array
    singular_values: Array
    null_spaces: tuple[Array, ...]

    @property
    def null_combinations(self) -> tuple[tuple[str, ...], ...]:
        """What each window does not determine, in words."""
        return tuple(
            tuple(describe_direction(column, self.names) for column in space.T)
            for space in self.null_spaces
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as plain lists, numbers and strings, fit for JSON."""
        return {
            "names": list(self.names),
            "units": list(self.units),
            "times": plain(self.times),
            "width": self.width,
            "rank": self.rank.tolist(),
            "free": self.free,
            "std": [plain(row) for row in self.std],
            "singular_values": [plain(row) for row in self.singular_values],
            "null_combinations": [list(texts) for texts in self.null_combinations],
        }

    def summary(self) -> str:
        """Return when what is determined, as text."""
        lines = [f"windows of {self.width:g} ({self.samples} samples), {self.free} combinations"]
        texts = self.null_combinations
        first = 0
        for k in range(1, len(self.times) + 1):
            same = k < len(self.times) and self.rank[k] == self.rank[first]
            if same:
                continue
            left = "; ".join(texts[first]) or "all determined"
            last = self.times[k - 1]
            lines.append(
                f"  from {self.times[first]:g} to {last:g}: rank {self.rank[first]}, "
                + (f"not determined: {left}" if texts[first] else left)
            )
            first = k
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Draw the bound of each state over time as a heat map; needs matplotlib."""
        return draw(self, "heat_map")

    def _as_table(self) -> Columns:
        texts = ["; ".join(part) for part in self.null_combinations]
        values = {"rank": self.rank} | dict(zip(self.names, self.std.T, strict=True))
        units = dict(zip(self.names, self.units, strict=True))
        return Columns("time", self.times, values | {"not determined": texts}, units)
