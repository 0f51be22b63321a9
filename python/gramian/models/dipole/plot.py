"""Pictures of passing dipoles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gramian.plot import COLORS, Figure, corner, ellipsoid, equal_space, estimate, figure

if TYPE_CHECKING:
    from gramian.models.dipole._result import Localization

__all__ = ["convergence", "corner", "estimate", "fields", "fit", "path", "space"]

_AXES = ("x", "y", "z")


def fit(answer: Localization) -> Figure:
    """Draw the field of each component with the model, and what is left."""
    sensors, letters = len(answer.sensors), answer.model.heads.axes
    fig = figure(4.6 * sensors + 1.2, 7.0 if len(letters) == 3 else 3.6)
    axes = fig.subplots(len(letters), sensors, sharex=True, sharey=True, squeeze=False)
    unit, name = _unit(answer.predicted)
    good = answer.weights > 0
    for s in range(sensors):
        for i, letter in enumerate(letters):
            ax = axes[i, s]
            data = np.where(good[:, s, i], (answer.predicted + answer.residuals)[:, s, i], np.nan)
            ax.plot(
                answer.times,
                data / unit,
                ".",
                markersize=3 if len(answer.times) > 60 else 6,
                color=COLORS["muted"],
                label="field",
            )
            ax.plot(
                answer.times,
                answer.predicted[:, s, i] / unit,
                color=COLORS["target"],
                label="dipole",
            )
            ax.plot(
                answer.times,
                np.where(good[:, s, i], answer.residuals[:, s, i], np.nan) / unit,
                color=COLORS["observer"],
                linewidth=0.8,
                label="left over",
            )
            ax.axvline(answer.closest.time, color="black", linewidth=0.5)
            if s == 0:
                ax.set_ylabel(f"{letter}   {name}")
        if sensors > 1:
            axes[0, s].set_title(f"sensor {s + 1}")
        axes[-1, s].set_xlabel("time, s")
    axes[0, 0].legend(loc="upper right", fontsize="small")
    fig.suptitle(f"one dipole explains {100 * answer.explained:.1f} % of the field")
    return fig


def path(answer: Localization) -> Figure:
    """Draw the pass from above and from the side, with its mirror image."""
    fig = figure(8.4, 4.0)
    axes = fig.subplots(1, 2)
    t = answer.times - answer.origin
    passes = [(answer.r0, answer.v, COLORS["target"], "pass")]
    if answer.mirror is not None:
        passes.append((answer.mirror.r0, answer.mirror.v, COLORS["muted"], "mirror image"))
    for ax, (i, j) in zip(axes, ((0, 1), (1, 2)), strict=True):
        for r0, v, color, label in passes:
            line = r0 + t[:, None] * v
            ax.plot(line[:, i], line[:, j], color=color, label=label)
            ax.plot(*line[-1, [i, j]], ">", color=color)
        ax.plot(answer.sensors[:, i], answer.sensors[:, j], "k^", label="sensor")
        ax.set_xlabel(f"{_AXES[i]}, m")
        ax.set_ylabel(f"{_AXES[j]}, m")
        ax.set_aspect("equal", "datalim")
    axes[0].legend(fontsize="small")
    return fig


def space(answer: Localization) -> Figure:
    """Draw the pass in space: path, moment, closest point with its 95 % ellipsoid, mirror image."""
    fig = figure(6.4, 5.6)
    axes: Any = fig.add_subplot(projection="3d")
    t = answer.times - answer.origin
    line = answer.r0 + t[:, None] * answer.v
    near = np.array(answer.closest.position)
    points = [line, answer.sensors, near[None]]
    axes.plot(*line.T, color=COLORS["target"], linewidth=2, label="pass")
    axes.plot(*line[-1:].T, ">", color=COLORS["target"])
    axes.plot(*near[None].T, "o", color=COLORS["target"], markersize=5)
    size = 0.3 * float(np.linalg.norm(np.ptp(line, axis=0)))
    axes.quiver(
        *near, *(size * answer.m / np.linalg.norm(answer.m)), color=COLORS["good"], label="moment"
    )
    if answer.mirror is not None:
        image = answer.mirror.r0 + t[:, None] * answer.mirror.v
        axes.plot(*image.T, color=COLORS["muted"], label="mirror image")
        points.append(image)
    # Position at the closest point: r0 + v t.
    since = answer.closest.time - answer.origin
    slope = np.hstack([np.eye(3), since * np.eye(3), np.zeros((3, 3))])
    covariance = slope @ answer.pass_covariance @ slope.T
    if np.isfinite(covariance).all():
        for k, outline in enumerate(ellipsoid(covariance)):
            label = "95 % of the closest point" if k == 0 else None
            axes.plot(*(near + outline).T, color=COLORS["bad"], linewidth=0.9, label=label)
    for sensor in answer.sensors:
        axes.plot(*sensor[None].T, "k^")
        # To see how high the pass is, and where.
        axes.plot(*np.stack([sensor, near]).T, color=COLORS["muted"], linewidth=0.8, linestyle=":")
    axes.plot([], [], "k^", label="sensor")
    equal_space(axes, np.vstack(points))
    axes.set(xlabel="x, m", ylabel="y, m", zlabel="z, m")
    fig.legend(loc="outside upper center", ncols=3, fontsize="small", frameon=False)
    return fig


def fields(times: NDArray[np.float64], curves: dict[str, NDArray[np.float64]]) -> Figure:
    """Draw the fields (K, 3) of several passes, component by component."""
    fig = figure(6.4, 5.4)
    axes = fig.subplots(3, 1, sharex=True)
    unit, name = _unit(next(iter(curves.values())))
    styles = ((COLORS["observer"], "-", 3.0), (COLORS["target"], "--", 1.4))
    for (label, field), (color, line, width) in zip(curves.items(), styles, strict=False):
        for i, ax in enumerate(axes):
            ax.plot(times, field[:, i] / unit, line, color=color, linewidth=width, label=label)
            ax.set_ylabel(f"{_AXES[i]}   {name}")
    axes[0].legend(fontsize="small")
    axes[-1].set_xlabel("time, s")
    return fig


def convergence(
    curves: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]], against: str
) -> Figure:
    """Draw costs against what they took, both on logarithmic axes."""
    fig = figure(6.4, 4.0)
    axes = fig.subplots()
    colors = (COLORS["observer"], COLORS["target"], COLORS["good"])
    for (label, (taken, cost)), color in zip(curves.items(), colors, strict=False):
        floor = np.maximum(cost, 1e-45)
        axes.plot(taken, floor, "o" if len(cost) == 1 else "-", color=color, label=label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(against)
    axes.set_ylabel("sum of squares, T$^2$")
    axes.legend(fontsize="small")
    return fig


def _unit(field: NDArray[np.float64]) -> tuple[float, str]:
    largest = float(np.abs(field).max())
    return (1e-9, "nT") if largest < 2e-7 else (1e-6, "uT")
