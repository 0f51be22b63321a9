"""Pictures of tracks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gramian._text import brief
from gramian.plot import COLORS, Figure, ellipse, ellipsoid, equal_space, figure

if TYPE_CHECKING:
    from gramian.analysis import Observability
    from gramian.models.tracks._estimate import Estimate
    from gramian.models.tracks._legs import LegChoice
    from gramian.models.tracks._scene import Scene

__all__ = ["chart", "geometry", "legs", "space"]

Array = NDArray[np.float64]

_KM = 1e-3


def chart(estimate: Estimate) -> Figure:
    """Draw a map: carriers, the estimated track, 95 % ellipses of its ends."""
    return _map(estimate.scene, estimate._whole, _covariance(estimate))


def _covariance(estimate: Estimate) -> Array | None:
    """Covariance of all states of the scene, 0 for those that are known; None where none is."""
    if not np.isfinite(estimate.covariance).all():
        return None
    free = [estimate.scene.index(name) for name in estimate.names]
    covariance = np.zeros((estimate.scene.n, estimate.scene.n))
    covariance[np.ix_(free, free)] = estimate.covariance
    return covariance


def geometry(scene: Scene, state: Array, answer: Observability) -> Figure:
    """Draw a map of what is asked: carriers, the target, and how well its place is known.

    The bound's 95 % ellipses of the first and last place; where a combination of the states
    is not determined, tracks along it in their place.
    """
    free = [scene.names.index(name) for name in answer.names]
    if not answer.nullity:
        covariance = np.zeros((state.size, state.size))
        covariance[np.ix_(free, free)] = answer.covariance()
        return _map(scene, state, covariance)
    change = np.zeros(state.size)
    change[free] = answer.null_space[:, 0]
    return _map(scene, state, None, change)


def _map(
    scene: Scene, state: Array, covariance: Array | None, change: Array | None = None
) -> Figure:
    fig = figure(6.4, 5.4)
    axes = fig.subplots()
    stamps = _times(scene)
    for path, name in _carriers(scene):
        axes.plot(*(path[:, :2] * _KM).T, ".-", color=COLORS["observer"], label=name, markersize=4)
    times = np.linspace(stamps[0], stamps[-1], 200)
    track = scene.track(state, times)[:, :2] * _KM
    axes.plot(*track.T, color=COLORS["target"], linewidth=2, label="target")
    axes.plot(*track[0], "o", color=COLORS["target"])
    axes.annotate(
        "",
        track[-1],
        track[-8],
        arrowprops={"arrowstyle": "-|>", "color": COLORS["target"], "mutation_scale": 18},
    )
    if covariance is not None:
        for k, time in enumerate((stamps[0], stamps[-1])):
            middle = scene.track(state, [time])[0, :2] * _KM
            outline = middle + ellipse(_at(scene, state, covariance, time)[:2, :2] * _KM**2, 0.95)
            label = "95 % ellipse, first and last" if k == 0 else None
            axes.plot(*outline.T, color=COLORS["bad"], linewidth=1.2, label=label)
    if change is not None:
        # As far as a fifth of the picture.
        reach = np.abs(scene.track(state + change, times)[:, :2] * _KM - track).max()
        everything = np.vstack([track, *(path[:, :2] * _KM for path, _ in _carriers(scene))])
        size = 0.2 * np.ptp(everything, axis=0).max() / reach if reach > 0 else 0.0
        for k, part in enumerate((-2, -1, 1, 2)):
            other = scene.track(state + part * size * change, times)[:, :2] * _KM
            label = "as good, to first order" if k == 0 else None
            axes.plot(*other.T, "--", color=COLORS["bad"], linewidth=1.2, label=label)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east, km")
    axes.set_ylabel("north, km")
    axes.grid(alpha=0.3)
    fig.legend(loc="outside upper center", ncols=3, fontsize="small", frameon=False)
    return fig


def space(estimate: Estimate) -> Figure:
    """Draw carriers and the estimated track in space, 95 % ellipsoids of its ends."""
    scene = estimate.scene
    fig = figure(6.4, 5.6)
    axes: Any = fig.add_subplot(projection="3d")
    stamps = _times(scene)
    points = []
    for path, name in _carriers(scene):
        wide = np.zeros((len(path), 3))
        wide[:, : path.shape[1]] = path
        points.append(wide * _KM)
        axes.plot(*points[-1].T, ".-", color=COLORS["observer"], label=name, markersize=5)
    track = estimate.track(np.linspace(stamps[0], stamps[-1], 200)) * _KM
    points.append(track)
    axes.plot(*track.T, color=COLORS["target"], linewidth=2, label="target")
    axes.plot(*track[:1].T, "o", color=COLORS["target"])
    axes.plot(*track[-1:].T, ">", color=COLORS["target"])
    low = float(np.vstack(points)[:, 2].min())
    for place in track[:: max(1, len(track) // 8)]:
        below = np.stack([place, [place[0], place[1], low]])
        axes.plot(*below.T, color=COLORS["muted"], linewidth=0.6, linestyle=":")
    covariance = _covariance(estimate)
    if covariance is not None:
        for k, time in enumerate((stamps[0], stamps[-1])):
            middle = estimate.track([time])[0] * _KM
            for i, outline in enumerate(
                ellipsoid(_at(scene, estimate._whole, covariance, time) * _KM**2)
            ):
                label = "95 % ellipsoid, first and last" if k == i == 0 else None
                axes.plot(*(middle + outline).T, color=COLORS["bad"], linewidth=0.9, label=label)
    equal_space(axes, np.vstack(points))
    axes.set(xlabel="east, km", ylabel="north, km", zlabel="up, km")
    fig.legend(loc="outside upper center", ncols=3, fontsize="small", frameon=False)
    return fig


def legs(choice: LegChoice) -> Figure:
    """Draw whitened residuals with one leg and with the number that was chosen."""
    fig = figure(6.4, 4.6)
    pair = (choice.estimates[0], choice.estimates[int(choice.count) - 1])
    for axes, estimate, color in zip(
        fig.subplots(2, 1, sharex=True), pair, (COLORS["bad"], COLORS["good"]), strict=True
    ):
        stamps = np.concatenate(
            [
                np.repeat(s.times, s.width(estimate.scene.motion.dimension))
                for s in estimate.scene.sensors
            ]
        )
        present = ~np.isnan(estimate.measurements)
        residuals = estimate.scene._inner.linearize(estimate.measurements, estimate.state)[0]
        axes.plot(stamps[present], residuals, ".", color=color)
        axes.axhspan(-2, 2, color=COLORS["muted"], alpha=0.3, zorder=0)
        count = estimate.scene.motion.count
        for j in range(1, count):
            axes.axvline(float(estimate.value(f"turn_{j}")) + estimate.scene.origin, color="0.5")
        word = "leg" if count == 1 else "legs"
        axes.set_title(f"{count} {word}: chi2 {brief(float(estimate.cost), 4)}", fontsize="small")
        axes.set_ylabel("residual / sigma")
    axes.set_xlabel("time, s")
    return fig


def _times(scene: Scene) -> Array:
    return np.unique(np.concatenate([sensor.times for sensor in scene.sensors]))


def _carriers(scene: Scene) -> list[tuple[Array, str]]:
    found = {}
    for sensor in scene.sensors:
        for carrier in (sensor.carrier, sensor.second):
            if carrier is not None:
                found[id(carrier)] = (np.atleast_2d(np.asarray(carrier.path)), carrier.name)
    return list(found.values())


def _at(scene: Scene, state: Array, covariance: Array, time: float) -> Array:
    """Covariance (D, D) of the position at a time."""
    slope = scene._inner.slopes(state, [time])[0]
    found: Array = slope @ covariance @ slope.T
    return found
