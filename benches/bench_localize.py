"""Maximum-likelihood estimates from bearings: ours beside SciPy's least_squares in a loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import exact
import numpy as np
from harness import ALL, FAST, OURS, Case, Contest, Contestant, c_function, main
from limits import Limit

from gramian import bearings

M, SIGMA, TRUTH = 60, float(np.radians(0.5)), np.array([2000.0, 6000.0, 3.0, -2.0])
TIMES = 15.0 * np.arange(M)
HEADING = np.where(np.arange(M - 1) < M // 2, 0.0, np.radians(60.0))
STEPS = 75.0 * np.stack([np.sin(HEADING), np.cos(HEADING)], axis=1)
PATH = np.vstack([np.zeros(2), np.cumsum(STEPS, axis=0)])
TARGET = "100 000 estimates a second on one thread"


def noisy(trials: int, sigma: float = SIGMA) -> Any:
    return bearings.simulate(TIMES, PATH, TRUTH, sigma, seed=1, trials=trials)


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


def scipy_loop(few: int, start: Callable[[Any], Any]) -> Callable[[Any], Callable[[], Any]]:
    """One call of least_squares for each trial, with the analytic Jacobian."""

    def prepare(data: Any) -> Callable[[], Any]:
        from scipy.optimize import least_squares

        def estimate(z: Any) -> Any:
            def residual(x: Any) -> Any:
                left = z - np.arctan2(*offsets(x).T)
                return ((left + np.pi) % (2 * np.pi) - np.pi) / SIGMA

            return least_squares(residual, start(z), jacobian, method="lm", x_scale="jac").x

        return lambda: np.array([estimate(z) for z in data[:few]])

    return prepare


def by_c(data: Any) -> Callable[[], Any]:
    kernel = c_function("localize.c", "localize", *FAST)

    def work() -> Any:
        out = np.empty((len(data), 4))
        kernel(TIMES, data, PATH, len(data), M, out)
        return out

    return work


def most_likely(z: Any) -> Any:
    """The estimate with 30 digits: Gauss-Newton from ours."""
    import mpmath as mp

    with mp.workdps(30):
        number = lambda x: mp.mpf(float(x))  # noqa: E731
        x = mp.matrix([number(e) for e in bearings.localize(TIMES, z, PATH, SIGMA).state])
        for _ in range(60):
            normal, right = mp.zeros(4), mp.zeros(4, 1)
            for t, angle, place in zip(TIMES, z, PATH, strict=True):
                dx = x[0] + number(t) * x[2] - number(place[0])
                dy = x[1] + number(t) * x[3] - number(place[1])
                r2, left = dx * dx + dy * dy, number(angle) - mp.atan2(dx, dy)
                left -= 2 * mp.pi * mp.nint(left / (2 * mp.pi))
                row = [dy / r2, -dx / r2, number(t) * dy / r2, -number(t) * dx / r2]
                for i in range(4):
                    right[i] += row[i] * left
                    for j in range(4):
                        normal[i, j] += row[i] * row[j]
            step = mp.lu_solve(normal, right)
            x += step
            if mp.norm(step) < mp.mpf(10) ** -12:
                break
        return np.array([float(e) for e in x])


def case(sigma: float) -> Case:
    """Distance from the most likely state, in deviations."""
    z = noisy(3, sigma)

    def make() -> Any:
        std = bearings.localize(TIMES, z, PATH, sigma).std
        return np.array([most_likely(one) for one in z]), std

    wanted = exact.lazily(make)
    return Case(z, lambda found: float(np.abs((found[:3] - wanted()[0]) / wanted()[1]).max()))


def estimates_contest(trials: int, peer_trials: int) -> Contest:
    """Estimates from given bearings."""

    def ours(data: Any) -> Callable[[], Any]:
        return lambda: bearings.localize(TIMES, data, PATH, SIGMA).state

    return Contest(
        f"bearings localize, {trials} trials, m = {M}",
        "estimate",
        float(trials),
        noisy(trials),
        [
            Contestant(OURS, ours),
            Contestant("gramian, all threads", ours, threads=ALL),
            Contestant("C, Gauss-Newton on normal equations", by_c),
            Contestant(
                "SciPy least_squares, pseudo-linear start",
                scipy_loop(peer_trials, pseudo_linear),
                part=float(peer_trials),
            ),
            Contestant(
                "SciPy least_squares, started at the truth",
                scipy_loop(peer_trials, lambda _: TRUTH),
                part=float(peer_trials),
            ),
        ],
        limit=Limit(
            {"fma": 5.0 * 63 * M, "divide": 5.0 * 2 * M},
            "a start and 4 linearisations of each bearing: an arc tangent (25 multiply-adds and a "
            "division), a row (10 and a division), 4 columns made orthogonal (28)",
        ),
        cases={"well": case(SIGMA / 5), "ill": case(SIGMA * 2)},
        target=TARGET,
        note="Error: distance from the most likely state in deviations of the bound; ours gives "
        "covariance, rank and a status beside the state.",
    )


def simulated_contest(trials: int) -> Contest:
    """Simulation and estimate in one pass, beside the two calls."""

    def one_pass(_: Any) -> Callable[[], Any]:
        return lambda: bearings.localize_trials(TIMES, PATH, TRUTH, SIGMA, trials=trials, seed=1)

    def two_calls(_: Any) -> Callable[[], Any]:
        return lambda: bearings.localize(TIMES, noisy(trials), PATH, SIGMA)

    return Contest(
        f"bearings simulated and located, {trials} trials, m = {M}",
        "trial",
        float(trials),
        None,
        [
            Contestant(OURS, one_pass, asked=False),
            Contestant("gramian, all threads", one_pass, threads=ALL, asked=False),
            Contestant("gramian, simulate, then localize", two_calls, asked=False),
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
