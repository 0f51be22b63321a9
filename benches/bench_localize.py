"""Maximum-likelihood estimates from bearings: ours beside SciPy's least_squares in a loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np
from harness import OURS, Contest, Contestant, main

from gramian import bearings

M, SIGMA, TRUTH = 60, float(np.radians(0.5)), np.array([2000.0, 6000.0, 3.0, -2.0])
TIMES = 15.0 * np.arange(M)
HEADING = np.where(np.arange(M - 1) < M // 2, 0.0, np.radians(60.0))
STEPS = 75.0 * np.stack([np.sin(HEADING), np.cos(HEADING)], axis=1)
PATH = np.vstack([np.zeros(2), np.cumsum(STEPS, axis=0)])
TARGET = "100 000 estimates a second on one thread"


@cache
def noisy(trials: int) -> Any:
    return bearings.simulate(TIMES, PATH, TRUTH, SIGMA, seed=1, trials=trials)


def offsets(x: Any) -> Any:
    return x[:2] + TIMES[:, None] * x[2:] - PATH


def jacobian(x: Any) -> Any:
    d = offsets(x)
    g = np.stack([-d[:, 1], d[:, 0]], axis=1) / (d**2).sum(axis=1)[:, None] / SIGMA
    return np.hstack([g, TIMES[:, None] * g])


def pseudo_linear(z: Any) -> Any:
    """The start that most users write: Li & Sheng 2009, eq. (3), by least squares."""
    c, s = np.cos(z), np.sin(z)
    rows = np.stack([c, -s, TIMES * c, -TIMES * s], axis=1)
    return np.linalg.lstsq(rows, PATH[:, 0] * c - PATH[:, 1] * s, rcond=None)[0]


def scipy_loop(trials: int, start: Callable[[Any], Any]) -> Callable[[], Any]:
    """One call of least_squares for each trial, with the analytic Jacobian."""
    from scipy.optimize import least_squares

    def estimate(z: Any) -> Any:
        def residual(x: Any) -> Any:
            left = z - np.arctan2(*offsets(x).T)
            return ((left + np.pi) % (2 * np.pi) - np.pi) / SIGMA

        return least_squares(residual, start(z), jacobian, method="lm", x_scale="jac").x

    return lambda: np.array([estimate(z) for z in noisy(trials)])


def estimates_contest(trials: int, peer_trials: int) -> Contest:
    """Estimates from given bearings."""

    def ours() -> Callable[[], Any]:
        z = noisy(trials)
        return lambda: bearings.localize(TIMES, z, PATH, SIGMA).state

    def error(found: Any) -> float:
        """Largest distance from the most likely state, in deviations."""
        best = bearings.localize(TIMES, noisy(peer_trials), PATH, SIGMA)
        few = min(peer_trials, len(found))
        return float(np.abs((found[:few] - best.state[:few]) / best.std[:few]).max())

    return Contest(
        f"bearings localize, {trials} trials, m = {M}",
        "estimate",
        trials,
        [
            Contestant(OURS, ours),
            Contestant(
                "SciPy least_squares, pseudo-linear start",
                lambda: scipy_loop(peer_trials, pseudo_linear),
                work=peer_trials,
            ),
            Contestant(
                "SciPy least_squares, started at the truth",
                lambda: scipy_loop(peer_trials, lambda _: TRUTH),
                work=peer_trials,
            ),
        ],
        error=error,
        target=TARGET,
    )


def simulated_contest(trials: int) -> Contest:
    """Simulation and estimate in one pass, beside the two calls."""

    def two_calls() -> Any:
        z = bearings.simulate(TIMES, PATH, TRUTH, SIGMA, seed=1, trials=trials)
        return bearings.localize(TIMES, z, PATH, SIGMA)

    return Contest(
        f"bearings simulated and located, {trials} trials, m = {M}",
        "trial",
        trials,
        [
            Contestant(
                OURS,
                lambda: (
                    lambda: bearings.localize_trials(
                        TIMES, PATH, TRUTH, SIGMA, trials=trials, seed=1
                    )
                ),
            ),
            Contestant("gramian: simulate, then localize", lambda: two_calls),
        ],
        target="80 000 trials a second on one thread",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    trials = 2_000 if quick else 20_000
    yield estimates_contest(trials, 20 if quick else 100)
    yield simulated_contest(trials)


if __name__ == "__main__":
    main(contests)
