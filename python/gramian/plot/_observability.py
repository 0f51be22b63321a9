"""Pictures of an `Observability`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gramian.plot._style import COLORS, Figure, figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gramian.analysis import Observability

__all__ = ["null_space", "observability", "singular_values"]


#: States that a picture names at most.
MOST = 24


def observability(answer: Observability) -> Figure:
    """Draw the singular values and what each null combination is made of."""
    if answer.nullity:
        bars = 1.2 + 0.3 * min(len(answer.names), MOST)
        fig = figure(6.4, 2.8 + bars)
        upper, lower = fig.subplots(2, 1, height_ratios=[2.8, bars])
        singular_values(answer, upper)
        null_space(answer, lower)
    else:
        fig = figure(6.4, 3.2)
        singular_values(answer, fig.subplots())
    return fig


def singular_values(answer: Observability, axes: Axes) -> None:
    """Draw the singular values as bars, those that count as zero in red."""
    values = answer.singular_values
    largest = values[0] if values[0] > 0 else 1.0
    relative = values / largest
    floor = 1e-17
    colors = [COLORS["good"]] * answer.rank + [COLORS["bad"]] * answer.nullity
    axes.bar(range(1, len(values) + 1), np.maximum(relative, floor), color=colors)
    axes.set_yscale("log")
    axes.set_ylim(floor / 3, 3)
    axes.set_xticks(range(1, len(values) + 1, -(-len(values) // MOST)))
    axes.set_xlabel("singular value of the scaled rows")
    axes.set_ylabel("relative to the largest")
    axes.set_title(f"rank {answer.rank} of {len(values)}")


def null_space(answer: Observability, axes: Axes) -> None:
    """Draw each unobservable combination as bars over the states, at most 24 that move most."""
    # In units that do not depend on metres or hours: of the scales where there
    # are any, else of what one column of the rows sees.
    sizes = 1 / answer.problem.scale
    if np.isnan(sizes).any():
        sizes = np.linalg.norm(answer.problem.all_rows, axis=0)
    space = answer.null_space * np.where(sizes > 0, sizes, 1.0)[:, None]
    space = space / np.abs(space).max(axis=0)
    shown = np.sort(np.argsort(-np.abs(space).max(axis=1), kind="stable")[:MOST])
    space, names = space[shown], [answer.names[k] for k in shown]
    n, nullity = space.shape
    width = 0.8 / nullity
    for k in range(nullity):
        offset = (k - (nullity - 1) / 2) * width
        axes.barh(np.arange(n) + offset, space[:, k], height=width)
    axes.axvline(0, color="black", linewidth=0.8)
    axes.set_yticks(range(n), names)
    axes.invert_yaxis()
    left = len(answer.names) - n
    axes.set_title("unobservable combinations" + (f", {n} of {n + left} states" if left else ""))
    axes.set_xlabel("each state in units of its scale")
