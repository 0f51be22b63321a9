"""Pictures of an `Estimate` and of the threshold of a bound."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gramian.plot._style import COLORS, Figure, ellipse, figure

if TYPE_CHECKING:
    from gramian.bounds import Threshold
    from gramian.estimation import Estimate

__all__ = ["estimate", "threshold"]


def estimate(answer: Estimate, pair: Sequence[Any] | None = None, level: float = 0.95) -> Figure:
    """Draw the whitened residuals, and the likelihood region of a pair of states.

    The ellipse of the local approximation is drawn beside the region where the two differ.
    """
    names = answer.names
    pair = tuple(names[:2]) if pair is None else tuple(pair)
    fig = figure(9.0, 4.0)
    left, right = fig.subplots(1, 2)
    left.axhspan(-2, 2, color=COLORS["muted"], alpha=0.2)
    left.plot(answer.fit.residuals, ".", color=COLORS["observer"])
    left.axhline(0, color="black", linewidth=0.5)
    left.set_xlabel("measurement")
    left.set_ylabel("whitened residual")
    left.set_title(answer.status + ("" if not answer.fit.dof else _p(answer.fit.p_value)))
    if len(pair) == 2 and answer.status != "unobservable":
        region = answer.region(pair, level)
        for contour in region.contours:
            right.plot(*contour.T, color=COLORS["target"], label=f"{100 * level:g} % region")
        ends = [answer.interval(what, level) for what in pair]
        places = [names.index(what) for what in pair if what in names]
        if len(places) == 2 and not all(end.is_local for end in ends):
            local = ellipse(answer.covariance[np.ix_(places, places)], level)
            right.plot(
                *(local + answer.state[places]).T,
                "--",
                color=COLORS["muted"],
                label="local ellipse",
            )
        if len(places) == 2:
            right.plot(*answer.state[places], "+", color="black", label="estimate")
            for other in answer.others:
                right.plot(*other.state[places], "x", color=COLORS["bad"], label="other solution")
        right.set_xlabel(_label(answer, region.names[0]))
        right.set_ylabel(_label(answer, region.names[1]))
        handles, labels = right.get_legend_handles_labels()
        shown = dict(zip(labels, handles, strict=True))
        right.legend(shown.values(), shown.keys(), fontsize="small")
    return fig


def threshold(found: Threshold, state: int = 0, rmse: ArrayLike | None = None) -> Figure:
    """Draw local and global bound of a state against the noise, and a simulated RMSE."""
    fig = figure(6.4, 4.0)
    axes = fig.subplots()
    axes.plot(found.noise, np.sqrt(found.local[:, state]), "--", color=COLORS["muted"])
    axes.plot(found.noise, np.sqrt(found.bound[:, state]), color=COLORS["observer"])
    labels = ["local bound", "Weiss-Weinstein bound"]
    if rmse is not None:
        axes.plot(found.noise, np.asarray(rmse), "o", color=COLORS["target"])
        labels.append("simulated RMSE")
    if np.isfinite(found.factor[state]):
        axes.axvline(found.factor[state], color="black", linewidth=0.5)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("noise")
    axes.set_ylabel("standard deviation")
    axes.legend(labels, fontsize="small")
    return fig


def _p(p: float) -> str:
    return "" if np.isnan(p) else f", p = {p:.2g}"


def _label(answer: Estimate, name: str) -> str:
    unit = dict(zip(answer.names, answer.units, strict=True)).get(name, "")
    return f"{name}, {unit}" if unit else name
