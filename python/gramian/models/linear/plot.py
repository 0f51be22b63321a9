"""Pictures of linear systems: levels, posterior over prior, combinations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gramian.exceptions import InputError
from gramian.plot import COLORS, figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gramian.models.linear._degrees import Information
    from gramian.models.linear._levels import Levels

__all__ = ["combination_map", "level_steps", "ratio_history"]

Array = NDArray[np.float64]


def level_steps(found: Levels) -> Figure:
    """Draw the rank by derivative as steps, and the level of each state and combination."""
    if found.ranks is None or found.states is None or found.combinations is None:
        raise InputError(str(found.reason))
    last = len(found.new) if found.nullity else len(found.new) - 1
    shown = list(found.ranks[: max(last, 1) + 1])
    named = {**found.states, **found.combinations}
    fig = figure(9.0, max(3.6, 0.22 * len(named) + 1.2))
    left, right = fig.subplots(1, 2, width_ratios=(1, 1.3))
    orders = np.arange(len(shown))
    left.step(
        [*orders, orders[-1] + 1], [*shown, shown[-1]], where="post", color=COLORS["observer"]
    )
    for k, rank in enumerate(shown):
        left.annotate(str(rank), (k + 0.5, rank), ha="center", va="bottom")
    n = len(found.names)
    left.axhline(n, color=COLORS["muted"], linestyle="--", linewidth=1)
    left.annotate("states", (0.1, n), va="bottom", color=COLORS["muted"])
    left.set_ylim(0, n * 1.12 + 0.5)
    left.set_xticks(orders + 0.5, [str(k) for k in orders])
    left.set_xlabel("derivatives of the output")
    left.set_ylabel("rank")
    never = max([level for level in named.values() if level is not None], default=0) + 1
    for i, level in enumerate(named.values()):
        place = never if level is None else level
        color = COLORS["bad"] if level is None else COLORS["good"]
        right.plot([0, place], [i, i], color=COLORS["muted"], linewidth=0.6)
        right.plot(place, i, "o", color=color)
    right.set_yticks(range(len(named)), list(named), fontsize=8)
    labels = [*(str(k) for k in range(never)), "never"] if None in named.values() else None
    right.set_xticks(range(never + (labels is not None)), labels)
    right.invert_yaxis()
    right.set_xlim(-0.2, never + 0.3)
    right.set_xlabel("known from derivative")
    return fig


def ratio_history(times: Array, ratios: Array, names: Sequence[str], unit: str = "s") -> Figure:
    """Draw posterior over prior deviation of each state, (times, n), against the window."""
    fig = figure(8.0, 4.4)
    axes = fig.subplots()
    styles = ("-", "--", ":", "-.")
    palette = [COLORS[key] for key in ("observer", "target", "good", "weak", "bad", "muted")]
    for i, name in enumerate(names):
        axes.plot(
            times,
            ratios[:, i],
            color=palette[i % len(palette)],
            linestyle=styles[i // len(palette) % len(styles)],
            linewidth=1.4,
            label=name,
        )
    positive = times[times > 0]
    if positive.size > 1 and positive[-1] / positive[0] > 500:
        axes.set_xscale("log")
        axes.set_xlim(positive[0], positive[-1])
    axes.set_yscale("log")
    axes.axhline(1.0, color="black", linewidth=0.8)
    axes.set_xlabel(f"window, {unit}" if unit else "window")
    axes.set_ylabel("posterior / prior standard deviation")
    axes.grid(alpha=0.3, which="both", linewidth=0.4)
    fig.legend(loc="outside right center", fontsize=8)
    return fig


def combination_map(found: Information) -> Figure:
    """Draw what each combination is made of, in prior deviations, best known first."""
    n = len(found.names)
    parts = (found.vectors / found.prior[:, None])[:, ::-1]
    values = found.values[::-1]
    fig = figure(max(6.4, 0.46 * n + 1.8), max(4.0, 0.3 * n + 1.6))
    axes = fig.subplots()
    image = axes.imshow(np.abs(parts), vmin=0, vmax=1, cmap="viridis", aspect="auto")
    axes.set_yticks(range(n), found.names, fontsize=8)
    labels = [f"{value:.1e}" if value > 0 else "0" for value in values]
    axes.set_xticks(range(n), labels, rotation=60, ha="right", fontsize=8)
    for i, value in enumerate(values):
        if value <= 1:
            # From here on the prior knows more than the window.
            axes.axvline(i - 0.5, color=COLORS["bad"], linewidth=1.6)
            break
    axes.set_xlabel("eigenvalue of P0 J: information of the window over the prior's")
    fig.colorbar(image, label="part of each state, in prior deviations")
    return fig
