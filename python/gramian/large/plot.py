"""Pictures of sparse problems; needs matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gramian.plot import COLORS, corner, figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gramian.large._analysis import SparseObservability

__all__ = ["corner", "sparse_observability"]


def sparse_observability(answer: SparseObservability) -> Figure:
    """Draw the smallest singular values, those that do not count in red."""
    fig = figure(8.0, 3.2)
    axes = fig.subplots()
    values = np.maximum(answer.singular_values[-40:], 1e-17)
    colors = [COLORS["good"]] * (len(values) - answer.nullity) + [COLORS["bad"]] * min(
        answer.nullity, len(values)
    )
    axes.bar(range(len(values)), values, color=colors)
    axes.set_yscale("log")
    axes.set_xlabel("the smallest singular values of the rows with unit columns")
    axes.set_title(f"rank {answer.rank} of {len(answer.names)}")
    return fig
