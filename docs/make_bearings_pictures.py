"""Draw the pictures of bearings-only observability: python docs/make_bearings_pictures.py."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import gramian as gm
from gramian.plot import COLORS, figure

IMAGES = Path(__file__).parent / "img"


def main() -> None:
    IMAGES.mkdir(exist_ok=True)
    family().savefig(IMAGES / "bearings_family.png")
    power(np.arange(0.0, 61.0, 5.0)).savefig(IMAGES / "bearings_power.png")


def family() -> Figure:
    """Draw what unobservable means: one family of tracks behind the same bearings.

    Left, an observer on a straight line: tracks at half, one and one and a half times
    the range, each with its own velocity, have all bearings in common. Right, the
    observer turns: only one of them still has.
    """
    t = np.linspace(0.0, 900.0, 10)
    straight = np.stack([0 * t, 5.0 * t], axis=1)
    leg = np.minimum(t, t[5])
    turned = np.stack([5.0 * (t - leg), 5.0 * leg], axis=1)
    offset, velocity = np.array([1500.0, 6000.0]), np.array([2.0, -3.0])
    fig = figure(9.0, 4.6)
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
            axes.plot(*zip(place, far, strict=True), color=COLORS["muted"], linewidth=0.6)
        axes.plot(*path.T, marker="o", markersize=3, color=COLORS["observer"])
        for factor in (0.5, 1.0, 1.4):
            other = straight + factor * relative
            fits = factor == 1.0 or path is straight
            axes.plot(
                *other.T,
                marker="o",
                markersize=3,
                color=COLORS["target" if fits else "bad"],
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


def power(turns, level=0.05, sigmas_deg=(0.25, 0.5, 1.0), trials=5000, seed=1) -> Figure:
    """Draw how often the test rejects "unobservable" against the observer's turn, in degrees.

    60 bearings, one each 20 s, of a target at 10 km that goes (3, -1) m/s, from an
    observer at 5 m/s that goes north and turns halfway.
    """
    t = np.arange(0.0, 1200.0, 20.0)
    fig = figure()
    axes = fig.subplots()
    noise = gm.monte_carlo.normals(seed, 0, trials, t.size)
    for sigma in np.radians(sigmas_deg):
        shown = [
            gm.bearings.observability_test(
                t, exact_bearings(t, turn) + sigma * noise, sigma, level
            ).rejected.mean()
            for turn in np.radians(turns)
        ]
        axes.plot(turns, shown, marker="o", markersize=3, label=f"{np.degrees(sigma):g} deg")
    axes.axhline(level, color=COLORS["muted"], linewidth=0.8, linestyle="--")
    axes.annotate(f"level {100 * level:g} %", (turns[-1], level), ha="right", va="bottom")
    axes.set_xlabel("turn of the observer (deg)")
    axes.set_ylabel("shown observable")
    axes.set_ylim(0, 1.02)
    axes.legend(title="noise of a bearing", frameon=False)
    return fig


def exact_bearings(t, turn):
    middle = t[t.size // 2]
    leg = np.minimum(t, middle)
    east = 5.0 * (t - leg) * np.sin(turn)
    north = 5.0 * (leg + (t - leg) * np.cos(turn))
    return np.arctan2(3.0 * t - east, 1e4 - t - north)


if __name__ == "__main__":
    main()
