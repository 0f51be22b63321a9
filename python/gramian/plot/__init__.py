"""Pictures of answers; wants matplotlib (``pip install gramian[plot]``).

Every function returns a `matplotlib.figure.Figure` of its own, never touches
pyplot's state, and so works in a notebook, a script and a server alike.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gramian.exceptions import GramianError

try:
    from matplotlib.figure import Figure
except ImportError as error:  # pragma: no cover - without the extra
    raise GramianError("pictures want matplotlib: pip install 'gramian[plot]'") from error

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gramian.analysis import Observability

__all__ = ["COLORS", "Figure", "ellipse", "figure", "observability", "singular_values"]

Array = NDArray[np.float64]

#: Colours that stay apart for colour-blind readers (Okabe & Ito).
COLORS = {
    "observer": "#0072B2",
    "target": "#D55E00",
    "good": "#009E73",
    "weak": "#E69F00",
    "bad": "#CC3311",
    "muted": "#999999",
}


def figure(width: float = 6.4, height: float = 4.0) -> Figure:
    """Return an empty figure in the house style."""
    return Figure(figsize=(width, height), layout="constrained", dpi=110)


def ellipse(covariance: Array, probability: float) -> Array:
    """Return the outline (200, 2) of the region that holds a normal error with this probability."""
    values, vectors = np.linalg.eigh(covariance)
    # Two degrees of freedom: the chi-square quantile has a closed form.
    radius = np.sqrt(-2 * np.log1p(-probability))
    angle = np.linspace(0, 2 * np.pi, 200)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    outline: Array = (vectors @ (radius * np.sqrt(np.maximum(values, 0))[:, None] * circle)).T
    return outline


def observability(answer: Observability) -> Figure:
    """Draw the singular values and what each null combination is made of."""
    fig = figure(8.0, 3.2)
    if answer.nullity:
        left, right = fig.subplots(1, 2)
        singular_values(answer, left)
        null_space(answer, right)
    else:
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
    axes.set_xticks(range(1, len(values) + 1))
    axes.set_xlabel("singular value of the scaled rows")
    axes.set_ylabel("relative to the largest")
    axes.set_title(f"rank {answer.rank} of {len(values)}")


def null_space(answer: Observability, axes: Axes) -> None:
    """Draw each unobservable combination as bars over the states."""
    # In units that do not depend on metres or hours: of the scales where there
    # are any, else of what one column of the rows sees.
    sizes = 1 / answer.problem.scale
    if np.isnan(sizes).any():
        sizes = np.linalg.norm(answer.problem.all_rows, axis=0)
    space = answer.null_space * np.where(sizes > 0, sizes, 1.0)[:, None]
    space = space / np.abs(space).max(axis=0)
    n, nullity = space.shape
    width = 0.8 / nullity
    for k in range(nullity):
        offset = (k - (nullity - 1) / 2) * width
        axes.barh(np.arange(n) + offset, space[:, k], height=width)
    axes.axvline(0, color="black", linewidth=0.8)
    axes.set_yticks(range(n), answer.names)
    axes.invert_yaxis()
    axes.set_title("moves together, unseen")
    axes.set_xlabel("each state in units of its scale")
