"""Draw the pictures of docs/howto/trust.md: python docs/make_trust_pictures.py."""

import re
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import gramian as gm
from gramian.plot import COLORS, estimate, figure, threshold

IMAGES = Path(__file__).parent / "img"
PAGE = Path(__file__).parent / "howto" / "trust.md"


def main() -> None:
    IMAGES.mkdir(exist_ok=True)
    # The page's own code: what it shows is what is drawn.
    scope: dict = {"__name__": "trust"}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.S):
        exec(block, scope)
    misfit(scope["answer"], scope["better"]).savefig(IMAGES / "trust_misfit.png")
    others(scope["beacons"], scope["others"]).savefig(IMAGES / "trust_others.png")
    estimate(scope["far"], ("x0", "y0")).savefig(IMAGES / "trust_region.png")
    noise = scope["noise"][::5]
    rmse = [error(scope["Ring"](sigma)) for sigma in noise]
    fig = threshold(scope["found"])
    fig.axes[0].plot(noise, rmse, "o", color=COLORS["target"], label="simulated RMSE")
    fig.axes[0].legend(fontsize="small")
    fig.savefig(IMAGES / "trust_threshold.png")


def misfit(wrong: gm.Estimate, right: gm.Estimate) -> Figure:
    """Draw residuals of a model that does not fit, and of one with the turn in it."""
    fig = figure(9.0, 3.6)
    for axes, answer, title in zip(
        fig.subplots(1, 2, sharey=True), (wrong, right), ("straight", "with the turn"), strict=True
    ):
        axes.axhspan(-2, 2, color=COLORS["muted"], alpha=0.2)
        axes.plot(answer.fit.residuals, "o-", color=COLORS["observer"], linewidth=0.6)
        axes.set_title(f"{title}: {answer.status}, p = {answer.fit.p_value:.2g}")
        axes.set_xlabel("bearing")
    fig.axes[0].set_ylabel("whitened residual")
    return fig


def others(model: object, found: tuple) -> Figure:
    """Draw chi2 of exact ranges over the plane, with the other solution."""
    fig = figure(6.4, 4.6)
    axes = fig.subplots()
    east, north = np.linspace(-20, 120, 200), np.linspace(-60, 60, 200)
    z = model.h(np.array([40.0, 30.0]))
    chi2 = [[(model.residuals(np.array([e, n]), z) ** 2).sum() for e in east] for n in north]
    axes.contour(east, north, np.sqrt(chi2), levels=[1, 2, 4, 8, 16, 32], cmap="viridis")
    axes.plot(*model.places.T, "k^", label="beacons")
    axes.plot(40, 30, "o", color=COLORS["good"], label="truth")
    axes.plot(*found[0].state, "x", color=COLORS["bad"], label="other solution")
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    axes.legend(fontsize="small")
    return fig


def error(model: object) -> float:
    """Simulate the RMSE of the posterior mean."""
    rng = np.random.default_rng(0)
    grid = np.linspace(-4, 4, 1601)
    exact = np.array([model.h([x]) for x in grid])
    squares = []
    for x in rng.normal(size=400):
        z = model.h([x]) + model.sigma * rng.normal(size=3)
        log = -0.5 * ((z - exact) ** 2).sum(axis=1) / model.sigma**2 - 0.5 * grid**2
        weight = np.exp(log - log.max())
        squares.append((weight @ grid / weight.sum() - x) ** 2)
    return float(np.sqrt(np.mean(squares)))


if __name__ == "__main__":
    main()
