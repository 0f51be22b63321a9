"""Pictures of Monte Carlo runs and sweeps."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from gramian._text import brief, number
from gramian.plot import COLORS, figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from gramian.monte_carlo.result import MonteCarloResult
    from gramian.monte_carlo.sweep import SweepResult

__all__ = [
    "error_cloud",
    "nees_histogram",
    "overview",
    "quantity_histogram",
    "rmse_and_bound",
    "single",
    "sweep",
]


def overview(result: MonteCarloResult) -> Figure:
    """Draw all that the run has: error clouds, RMSE beside the bound, NEES, quantities."""
    drawers: list[Callable[[Axes], None]] = []
    if result.used:
        pairs = [pair for pair in ((0, 1), (2, 3)) if pair[1] < len(result.names)]
        drawers += [partial(error_cloud, result, states=pair) for pair in pairs]
        drawers.append(partial(rmse_and_bound, result))
        if result.nees is not None:
            drawers.append(partial(nees_histogram, result))
    drawers += [partial(quantity_histogram, result, name=name) for name in result.quantities]
    columns = min(2, max(1, len(drawers)))
    rows = max(1, -(-len(drawers) // columns))
    fig = figure(5.2 * columns, 3.9 * rows)
    all_axes = np.atleast_1d(fig.subplots(rows, columns)).ravel()
    for draw, axes in zip(drawers, all_axes, strict=False):
        draw(axes)
    for axes in all_axes[len(drawers) :]:
        axes.set_axis_off()
    fig.suptitle(result.verdict, fontsize="medium")
    return fig


def single(result: MonteCarloResult, draw: Callable[..., None], **options: Any) -> Figure:
    """Draw one picture of a run on a figure of its own."""
    fig = figure()
    draw(result, fig.subplots(), **options)
    return fig


def error_cloud(result: MonteCarloResult, axes: Axes, states: tuple[int, int] = (0, 1)) -> None:
    """Draw the errors of two states with the 95 % ellipses of the errors and of the bound."""
    i, j = states
    good = result.sample["status"] == 0
    x = result.sample[f"error_{result.names[i]}"][good]
    y = result.sample[f"error_{result.names[j]}"][good]
    axes.scatter(x, y, s=4, alpha=0.35, color=COLORS["observer"], linewidths=0)
    pair = np.ix_([i, j], [i, j])
    centre = result.bias[[i, j]]
    if np.isfinite(result.covariance[pair]).all():
        _ellipse(axes, centre, result.covariance[pair], "errors, 95 %", "observer", "-")
    if result.bound_covariance is not None:
        _ellipse(axes, 0 * centre, result.bound_covariance[pair], "bound, 95 %", "target", "--")
    axes.plot(*centre, "+", color="black", markersize=9, label="mean error")
    axes.set_xlabel(_label(result, i, "error of "))
    axes.set_ylabel(_label(result, j, "error of "))
    shown = f"first {len(x)} of {result.used}" if len(x) < result.used else f"{len(x)}"
    # A few wild estimates must not shrink the rest to a dot: they are counted.
    outside = np.zeros(len(x), dtype=bool)
    for values, set_limits in ((x, axes.set_xlim), (y, axes.set_ylim)):
        low, high = np.quantile(values, [0.005, 0.995])
        margin = 0.5 * (high - low)
        beyond = (values < low - margin) | (values > high + margin)
        if beyond.any():
            set_limits(low - margin, high + margin)
            outside |= beyond
    lost = f", {outside.sum()} outside the frame" if outside.any() else ""
    axes.set_title(f"{shown} trials{lost}", fontsize="medium")
    axes.legend(fontsize="small")


def _ellipse(
    axes: Axes, centre: np.ndarray, covariance: np.ndarray, label: str, color: str, style: str
) -> None:
    from scipy.special import chdtri

    values, vectors = np.linalg.eigh(covariance)
    angle = np.linspace(0, 2 * np.pi, 181)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    radius = np.sqrt(chdtri(2, 0.05) * np.maximum(values, 0))
    outline = centre[:, None] + vectors @ (radius[:, None] * circle)
    axes.plot(*outline, style, color=COLORS[color], label=label, linewidth=1.6)


def rmse_and_bound(result: MonteCarloResult, axes: Axes) -> None:
    """Draw the RMSE of each state over its bound, with its confidence interval."""
    places = np.arange(len(result.names))
    if result.bound is None or result.efficiency is None or result.efficiency_interval is None:
        axes.bar(places, result.rmse, color=COLORS["observer"])
        axes.set_xticks(places, [_label(result, i) for i in range(len(places))])
        axes.set_yscale("log")
        axes.set_ylabel("RMSE")
        axes.set_title("RMSE (no bound)", fontsize="medium")
        return
    known = np.isfinite(result.bound) & (result.bound > 0)
    ratio = np.where(known, result.efficiency, np.nan)
    reach = np.abs(result.efficiency_interval - result.efficiency[:, None]).T
    axes.errorbar(
        places[known],
        ratio[known],
        yerr=reach[:, known],
        fmt="o",
        capsize=4,
        color=COLORS["observer"],
        label="RMSE / bound, 95 %",
    )
    axes.axhline(1.0, color=COLORS["target"], linestyle="--", label="bound")
    for i in places[~known]:
        axes.text(i, 1.0, "not\nobservable", ha="center", va="bottom", color=COLORS["bad"])
    labels = [
        f"{name}\n{number(rmse, 3)}\n/ {number(bound, 3)}"
        for name, rmse, bound in zip(result.names, result.rmse, result.bound, strict=True)
    ]
    axes.set_xticks(places, labels, fontsize="small" if len(labels) < 7 else "xx-small")
    axes.set_xlim(-0.5, len(places) - 0.5)
    axes.set_ylabel("RMSE / bound")
    axes.set_title("RMSE against the bound", fontsize="medium")
    axes.legend(fontsize="small")


def nees_histogram(result: MonteCarloResult, axes: Axes) -> None:
    """Draw the NEES with the chi-square density of a consistent estimator."""
    nees = result.nees
    if nees is None:
        axes.set_title("no NEES: no covariance to compare with", fontsize="medium")
        return
    from scipy.stats import chi2

    width = np.diff(nees.edges)
    density = nees.histogram[:-1] / nees.count / width
    axes.bar(
        nees.edges[:-1],
        density,
        width,
        align="edge",
        color=COLORS["observer"],
        alpha=0.5,
        label="trials",
    )
    x = np.linspace(nees.edges[0], nees.edges[-1], 300)[1:]
    axes.plot(x, chi2.pdf(x, nees.dof), color=COLORS["target"], label=f"chi-square, {nees.dof}")
    inside = nees.mean <= nees.edges[-1]
    label = f"mean {brief(nees.mean)}" + ("" if inside else ", beyond the axis")
    axes.axvline(min(nees.mean, nees.edges[-1]), color="black", linewidth=1.5, label=label)
    axes.set_xlim(0, 1.02 * nees.edges[-1])
    axes.axvspan(*nees.band, color=COLORS["good"], alpha=0.4, label="band of the mean")
    top = max(density.max(), 0.2 / nees.dof**0.5)
    axes.set_ylim(0, 1.25 * top)
    over = nees.histogram[-1] / nees.count
    axes.set_xlabel(f"NEES   ({brief(100 * over, 2)} % beyond the axis, 0.1 % expected)")
    axes.set_ylabel("density")
    axes.set_title(f"{brief(100 * nees.inside)} % within the 95 % ellipsoid", fontsize="medium")
    axes.legend(fontsize="small")


def quantity_histogram(result: MonteCarloResult, axes: Axes, name: str) -> None:
    """Draw the values of a quantity in the first trials, with the mean of all."""
    values = result.sample[name]
    values = values[np.isfinite(values)]
    if values.size:
        axes.hist(values, bins=40, color=COLORS["observer"], alpha=0.6)
    axes.axvline(result.quantities[name].mean, color="black", linewidth=1, label="mean")
    axes.set_xlabel(name)
    axes.set_ylabel("trials")
    axes.set_title(f"{name}, {values.size} of {result.trials} trials", fontsize="medium")
    axes.legend(fontsize="small")


def _label(result: MonteCarloResult, i: int, before: str = "") -> str:
    unit = f" ({result.units[i]})" if result.units[i] else ""
    return f"{before}{result.names[i]}{unit}"


def sweep(result: SweepResult, what: str, states: tuple[str, ...]) -> Figure:
    """Draw a sweep: curves over one parameter, maps over two."""
    from gramian.monte_carlo.sweep import OF_STATES

    if what not in OF_STATES:
        states = ()
    beside = what == "rmse" and result.results[0].bound is not None
    count = max(1, len(states))
    if len(result.parameters) == 1:
        columns = min(2, count)
        rows = -(-count // columns)
        fig = figure(5.2 * columns, 3.6 * rows)
        for k, axes in enumerate(np.atleast_1d(fig.subplots(rows, columns)).ravel()):
            if k < count:
                _curve(result, what, states[k] if states else None, axes, beside)
            else:
                axes.set_axis_off()
        return fig
    columns = 2 if beside else 1
    fig = figure(4.8 * columns, 3.6 * count)
    grid = np.atleast_1d(fig.subplots(count, columns)).reshape(count, columns)
    for k in range(count):
        state = states[k] if states else None
        for axes, shown in zip(grid[k], (what, "bound"), strict=False):
            _map(result, shown, state, axes, what)
    return fig


def _curve(result: SweepResult, what: str, state: str | None, axes: Axes, beside: bool) -> None:
    (parameter, x), *_ = result.parameters.items()
    y = result.values(what, state)
    axes.plot(x, y, "o-", color=COLORS["observer"], label=what)
    if state is not None and what in ("rmse", "bias", "std", "efficiency"):
        i = result.names.index(state)
        limits = np.array([getattr(run, f"{what}_interval")[i] for run in result.results])
        axes.fill_between(x, *limits.T, color=COLORS["observer"], alpha=0.2, label="95 %")
    if beside:
        bound = result.values("bound", state)
        axes.plot(x, bound, "--", color=COLORS["target"], label="bound")
        for place in x[~np.isfinite(bound)]:
            axes.axvline(place, color=COLORS["bad"], linestyle=":")
    if what in ("rmse", "std", "bound") and (y[np.isfinite(y)] > 0).any():
        axes.set_yscale("log")
    if what == "efficiency":
        axes.axhline(1.0, color=COLORS["target"], linestyle="--", label="bound")
    if (x > 0).all() and x.max() > 30 * x.min():
        axes.set_xscale("log")
    unit = _unit(result, state)
    axes.set_xlabel(parameter)
    axes.set_ylabel(f"{what} of {state}{unit}" if state else what)
    axes.legend(fontsize="small")


def _map(result: SweepResult, shown: str, state: str | None, axes: Axes, what: str) -> None:
    (first, x), (second, y) = result.parameters.items()
    values = result.values(shown, state).T
    both = [result.values(kind, state) for kind in ({shown, what})]
    finite = np.concatenate([v[np.isfinite(v)] for v in both])
    limits = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    logarithmic = limits[0] > 0 and limits[1] > 30 * limits[0]
    from matplotlib.colors import LogNorm, Normalize

    norm = (LogNorm if logarithmic else Normalize)(*limits)
    image = axes.pcolormesh(
        np.arange(len(x) + 1) - 0.5, np.arange(len(y) + 1) - 0.5, values, norm=norm, cmap="viridis"
    )
    for j, i in np.ndindex(values.shape):
        text = f"{brief(values[j, i])}" if np.isfinite(values[j, i]) else "not\nobservable"
        axes.text(
            i,
            j,
            text,
            ha="center",
            va="center",
            fontsize="x-small",
            bbox={"facecolor": "white", "alpha": 0.6, "linewidth": 0, "pad": 1},
        )
    axes.set_xticks(range(len(x)), [f"{brief(value, 4)}" for value in x])
    axes.set_yticks(range(len(y)), [f"{brief(value, 4)}" for value in y])
    axes.set_xlabel(first)
    axes.set_ylabel(second)
    axes.set_title(
        f"{shown} of {state}{_unit(result, state)}" if state else shown, fontsize="medium"
    )
    axes.figure.colorbar(image, ax=axes)


def _unit(result: SweepResult, state: str | None) -> str:
    if state is None:
        return ""
    unit = result.results[0].units[result.names.index(state)]
    return f" ({unit})" if unit else ""
