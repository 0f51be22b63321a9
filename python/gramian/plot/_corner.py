"""The bound of chosen states, each and in pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gramian.exceptions import InputError
from gramian.plot._style import COLORS, Figure, ellipse, figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gramian.analysis import Observability
    from gramian.estimation import Estimate

__all__ = ["corner"]

Array = NDArray[np.float64]

#: More states than these make panels that nobody can read.
_MOST = 8


def corner(
    answer: Observability | Estimate, names: Sequence[str] | None = None, level: float = 0.95
) -> Figure:
    """Draw the density of each state and the ellipses of each pair, from the covariance.

    Parameters
    ----------
    answer : Observability or Estimate
    names : sequence of str, optional
        The states to draw, at most 8; by default the first ones.
    level : float
        The probability that the outer ellipse holds; the inner is of one deviation.

    Raises
    ------
    InputError
        An unknown name, more than 8, a level that is not between 0 and 1.
    """
    if not 0 < level < 1:
        raise InputError(f"level = {level}: must be between 0 and 1")
    chosen = tuple(answer.names[:_MOST] if names is None else names)
    for name in chosen:
        if name not in answer.names:
            raise InputError(f"no state is named {name!r}: there are {', '.join(answer.names)}")
    if not 0 < len(chosen) <= _MOST:
        raise InputError(f"names has {len(chosen)} states: must have 1 to {_MOST}")
    places = [answer.names.index(name) for name in chosen]
    covariance, std = _spread(answer, chosen, places)
    state = getattr(answer, "state", None)
    middle = np.zeros(len(chosen)) if state is None else np.asarray(state)[places]
    n = len(chosen)
    fig = figure(1.2 + 1.7 * n, 1.0 + 1.7 * n)
    axes = fig.subplots(n, n, squeeze=False)
    labels = [
        f"{name}, {answer.units[place]}" if answer.units[place] else name
        for name, place in zip(chosen, places, strict=True)
    ]
    for i in range(n):
        for j in range(n):
            ax = axes[i, j]
            if j > i:
                ax.remove()
            elif i == j:
                _density(ax, float(middle[i]), float(std[i]))
            else:
                pair = [j, i]
                _pair(ax, middle[pair], covariance[np.ix_(pair, pair)], level)
            if j <= i:
                _label(ax, labels[j] if i == n - 1 else "", labels[i] if j == 0 and i else "")
    what = "estimate" if state is not None else "error at the bound"
    fig.suptitle(f"{what}: one deviation and {100 * level:g} %", fontsize="medium")
    return fig


def _spread(answer: Any, names: Sequence[str], places: list[int]) -> tuple[Array, Array]:
    """Return covariance (m, m) and deviations (m,); `inf` and NaN for what is not observable."""
    if hasattr(answer, "std_of"):
        std = np.asarray(answer.crlb_std)[places]
        if answer.nullity == 0:
            return answer.covariance(names), std
        # Of those that are observable, by the variance of their sums.
        m = len(names)
        covariance = np.full((m, m), np.nan)
        np.fill_diagonal(covariance, std**2)
        for i in range(m):
            for j in range(i):
                if np.isfinite(std[[i, j]]).all():
                    total = np.zeros(len(answer.names))
                    total[[places[i], places[j]]] = 1.0
                    both = 0.5 * (answer.std_of(total) ** 2 - std[i] ** 2 - std[j] ** 2)
                    covariance[i, j] = covariance[j, i] = both
        return covariance, std
    return np.asarray(answer.covariance)[np.ix_(places, places)], np.asarray(answer.std)[places]


def _density(axes: Axes, middle: float, std: float) -> None:
    if not np.isfinite(std):
        _nothing(axes)
        return
    if std == 0:
        axes.axvline(middle, color=COLORS["good"], linewidth=2)
        return
    x = np.linspace(-4, 4, 161)
    axes.plot(middle + std * x, np.exp(-0.5 * x**2), color=COLORS["observer"], linewidth=1.5)
    inside = np.abs(x) <= 1
    axes.fill_between(
        middle + std * x[inside], np.exp(-0.5 * x[inside] ** 2), color=COLORS["observer"], alpha=0.2
    )
    axes.set_ylim(0, 1.15)
    axes.set_yticks([])


def _pair(axes: Axes, middle: Array, covariance: Array, level: float) -> None:
    if not np.isfinite(covariance).all():
        _nothing(axes)
        return
    for probability, width in ((1 - np.exp(-0.5), 1.5), (level, 0.9)):
        outline = middle + ellipse(covariance, probability)
        axes.plot(*outline.T, color=COLORS["observer"], linewidth=width)
    axes.plot(*middle, "+", color=COLORS["target"])


def _nothing(axes: Axes) -> None:
    axes.text(
        0.5, 0.5, "not\nobservable", ha="center", va="center", color=COLORS["bad"],
        transform=axes.transAxes, fontsize="small",
    )  # fmt: skip
    axes.set_xticks([])
    axes.set_yticks([])


def _label(axes: Axes, below: str, beside: str) -> None:
    axes.set_xlabel(below)
    axes.set_ylabel(beside)
    axes.tick_params(labelsize="x-small", axis="x", rotation=30)
    axes.tick_params(labelsize="x-small", axis="y")
    axes.locator_params(nbins=4)
    if not below:
        axes.set_xticklabels([])
    if not beside:
        axes.set_yticklabels([])
