"""A test on noisy bearings: whether the track could be one that no estimator can locate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._arrays import number, reals
from gramian.exceptions import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["ObservabilityTest", "family_figure", "observability_test", "power_figure"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ObservabilityTest:
    """The answer of `observability_test`, with the leading axes of its input.

    Attributes
    ----------
    statistic : ndarray, shape (...)
        Weighted sum of squared residuals of the relative motion that fits best.
    dof : int
        Its degrees of freedom where the track is unobservable, m - 3.
    p_value : ndarray, shape (...)
        Probability of a statistic as large, were the track unobservable.
    level : float
        The level of the verdict.
    rejected : ndarray of bool, shape (...)
        Whether p_value is below the level: "unobservable" is then not believable.
    relative_motion : ndarray, shape (..., 4)
        The motion (x, y, vx, vy) at the first time, relative to an observer on a
        straight line, that fits the bearings best; at unit range there, as its
        size is what bearings cannot tell. Velocities are then ranges per second.
    """

    statistic: Array
    dof: int
    p_value: Array
    level: float
    rejected: NDArray[np.bool_]
    relative_motion: Array

    @property
    def course(self) -> Array:
        """Direction of the fitted relative motion, clockwise from north, radians."""
        course: Array = np.arctan2(self.relative_motion[..., 2], self.relative_motion[..., 3])
        return course

    @property
    def verdict(self) -> str | NDArray[np.str_]:
        """Return "observable" where "unobservable" is rejected, else "not shown observable"."""
        words = np.where(self.rejected, "observable", "not shown observable")
        return str(words) if words.ndim == 0 else words

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and lists, fit for JSON."""
        return {
            "statistic": self.statistic.tolist(),
            "dof": self.dof,
            "p_value": self.p_value.tolist(),
            "level": self.level,
            "rejected": self.rejected.tolist(),
            "relative_motion": self.relative_motion.tolist(),
            "course": self.course.tolist(),
        }

    def summary(self) -> str:
        """Return the verdict in words."""
        if self.rejected.ndim:
            share = 100 * self.rejected.mean()
            return f"{share:.3g} % of {self.rejected.size} tracks shown observable"
        figures = f"chi-square {self.statistic:.4g} on {self.dof}, p = {self.p_value:.3g}"
        if self.rejected:
            return (
                f"OBSERVABLE at the {100 * self.level:g} % level: no straight relative "
                f"motion has these bearings ({figures})"
            )
        return (
            f"NOT SHOWN OBSERVABLE at the {100 * self.level:g} % level: a straight relative "
            f"motion on course {np.degrees(self.course):.4g} deg has these bearings as well "
            f"as their noise allows ({figures})"
        )


def observability_test(
    times: ArrayLike, bearings: ArrayLike, sigma: ArrayLike, level: float = 0.05
) -> ObservabilityTest:
    """Test whether noisy bearings could be those of an unobservable track.

    Parameters
    ----------
    times : array_like, shape (..., m)
        Increasing, seconds.
    bearings : array_like, shape (..., m)
        Radians, wrapped or not; at least four.
    sigma : array_like, shape () or (..., m)
        Standard deviation of the bearings, radians, > 0.
    level : float
        Probability to reject a track that is unobservable, between 0 and 1.

    Returns
    -------
    ObservabilityTest
        Statistic, degrees of freedom, p-value, verdict and the fitted motion.

    Raises
    ------
    InputError
        Fewer than four bearings, shapes that do not fit, times that do not increase, a
        sigma that is not positive, numbers that are not finite, a level out of range.

    Notes
    -----
    A track is unobservable iff tan b = (x + vx T) / (y + vy T) at all times for one
    relative motion (x, y, vx, vy) (see `observable`): three parameters, since its
    size does not matter. They are fitted by weighted least squares to the bearings
    themselves, on the full circle. The sum of squared residuals is then chi-square
    with m - 3 degrees of freedom, to first order in the noise. Neither range nor the
    target's state enters.

    *Rejected* means that the observer's maneuver shows in the bearings. *Not rejected*
    does not prove that the track is unobservable, only that these bearings do not
    tell; how much they would tell is a matter of the bounds (`gramian.analyze`).

    On 20 000 simulated unobservable tracks (60 bearings, 0.5 deg) levels of 0.5, 1, 5
    and 10 % rejected 0.47, 1.00, 5.2 and 10.2 %, the same within chance for close
    passages, far targets and bearings that do not change at all. The fit starts from an
    eigenvector of the Gram matrix in standard time, where noise causes no bias, and goes
    on by Levenberg-Marquardt steps; a second start guards what would be rejected.

    Examples
    --------
    >>> import numpy as np, gramian as gm
    >>> t = np.arange(0.0, 1200.0, 20.0)
    >>> straight = np.stack([0 * t, 5.0 * t], axis=1)
    >>> turned = straight.copy()
    >>> turned[30:, 0] = 5.0 * (t[30:] - t[30])
    >>> turned[30:, 1] = straight[30, 1]
    >>> sigma = np.radians(0.5)
    >>> for path in (straight, turned):
    ...     b = gm.bearings.simulate(t, path, [0, 1e4, 3, -1], sigma, seed=1)
    ...     test = observability_test(t, b, sigma)
    ...     print(test.verdict, test.dof, bool(test.p_value > 0.05))
    not shown observable 57 True
    observable 57 False
    """
    if not 0 < number(level, "level") < 1:
        raise InputError(f"level = {level}: must be between 0 and 1")
    noise = reals(sigma, "sigma")
    found = _core.bearing_test(times, bearings, noise[None] if noise.ndim == 0 else noise)
    dof = np.shape(bearings)[-1] - 3
    p_value = found[..., 1]
    return ObservabilityTest(found[..., 0], dof, p_value, level, p_value < level, found[..., 2:])


def power_figure(
    turns_deg: ArrayLike | None = None,
    *,
    level: float = 0.05,
    sigma_deg: ArrayLike = (0.25, 0.5, 1.0),
    trials: int = 2000,
    seed: int = 1,
) -> Figure:
    """Draw how often the test rejects "unobservable" against the observer's turn.

    Parameters
    ----------
    turns_deg : array_like, shape (k,), optional
        Turns of the observer halfway, degrees; 0 to 60 by default.
    level : float
        Of the test.
    sigma_deg : array_like, shape (s,)
        Standard deviations of the bearings, degrees.
    trials : int
        Simulated tracks for each point.
    seed : int
        Of the noise.

    Returns
    -------
    matplotlib.figure.Figure

    Notes
    -----
    60 bearings, one each 20 s, of a target at 10 km that goes (3, -1) m/s, from an
    observer at 5 m/s that goes north and turns halfway.
    """
    from gramian import plot

    turns = np.arange(0.0, 61.0, 5.0) if turns_deg is None else reals(turns_deg, "turns_deg")
    t = np.arange(0.0, 1200.0, 20.0)
    fig = plot.figure()
    axes = fig.subplots()
    noise = _core.normals(seed, 0, trials, t.size)
    for sigma in np.atleast_1d(np.radians(reals(sigma_deg, "sigma_deg"))):
        power = [
            observability_test(
                t, _turned_bearings(t, turn) + sigma * noise, sigma, level
            ).rejected.mean()
            for turn in np.radians(turns)
        ]
        axes.plot(turns, power, marker="o", markersize=3, label=f"{np.degrees(sigma):g} deg")
    axes.axhline(level, color=plot.COLORS["muted"], linewidth=0.8, linestyle="--")
    axes.annotate(f"level {100 * level:g} %", (turns[-1], level), ha="right", va="bottom")
    axes.set_xlabel("turn of the observer (deg)")
    axes.set_ylabel("shown observable")
    axes.set_ylim(0, 1.02)
    axes.legend(title="noise of a bearing", frameon=False)
    return fig


def family_figure() -> Figure:
    """Draw what unobservable means: one family of tracks behind the same bearings.

    Returns
    -------
    matplotlib.figure.Figure
        Left, an observer on a straight line: tracks at half, one and one and a half
        times the range, each with its own velocity, have all bearings in common.
        Right, the observer turns: only one of them still has.
    """
    from gramian import plot

    t = np.linspace(0.0, 900.0, 10)
    straight = np.stack([0 * t, 5.0 * t], axis=1)
    leg = np.minimum(t, t[5])
    turned = np.stack([5.0 * (t - leg), 5.0 * leg], axis=1)
    offset, velocity = np.array([1500.0, 6000.0]), np.array([2.0, -3.0])
    fig = plot.figure(9.0, 4.6)
    for axes, path, title in zip(
        fig.subplots(1, 2),
        (straight, turned),
        ("a straight observer: unobservable", "a turn: one track fits"),
        strict=True,
    ):
        relative = offset + t[:, None] * (velocity - np.array([0.0, 5.0]))
        truth = relative + straight
        lines = truth - path
        lines = lines / np.hypot(lines[:, :1], lines[:, 1:])
        for place, line in zip(path, lines, strict=True):
            far = place + 8500.0 * line
            axes.plot(*zip(place, far, strict=True), color=plot.COLORS["muted"], linewidth=0.6)
        axes.plot(*path.T, marker="o", markersize=3, color=plot.COLORS["observer"])
        for factor in (0.5, 1.0, 1.4):
            other = straight + factor * relative
            fits = factor == 1.0 or path is straight
            axes.plot(
                *other.T,
                marker="o",
                markersize=3,
                color=plot.COLORS["target" if fits else "bad"],
                linestyle="-" if fits else ":",
                alpha=1.0 if factor == 1.0 else 0.65,
            )
        axes.annotate("observer", path[0], (-6, 2), textcoords="offset points", ha="right")
        axes.annotate("target", truth[0], (6, 4), textcoords="offset points")
        axes.set_title(title)
        axes.set_aspect("equal")
        axes.set_xlim(-3000, 6200)
        axes.set_xlabel("east (m)")
    fig.axes[0].set_ylabel("north (m)")
    return fig


def _turned_bearings(t: Array, turn: float) -> Array:
    """Return exact bearings of the track of `power_figure`."""
    middle = t[t.size // 2]
    leg = np.minimum(t, middle)
    east = 5.0 * (t - leg) * np.sin(turn)
    north = 5.0 * (leg + (t - leg) * np.cos(turn))
    exact: Array = np.arctan2(3.0 * t - east, 1e4 - t - north)
    return exact
