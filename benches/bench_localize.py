"""Estimating a target from bearings: ours beside a loop over SciPy and plain C."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import exact
import numpy as np
from harness import ALL, FAST, OURS, Case, Contest, Contestant, c_function, main
from limits import Limit

from gramian import bearings


@dataclass(frozen=True)
class Track:
    """A path along which bearings are taken, and what peers do with them."""

    times: Any
    path: Any
    sigma: float

    def offsets(self, x: Any) -> Any:
        return x[:2] + self.times[:, None] * x[2:] - self.path

    def residual(self, x: Any, z: Any) -> Any:
        left = z - np.arctan2(*self.offsets(x).T)
        return ((left + np.pi) % (2 * np.pi) - np.pi) / self.sigma

    def jacobian(self, x: Any) -> Any:
        d = self.offsets(x)
        g = np.stack([-d[:, 1], d[:, 0]], axis=1) / (d**2).sum(axis=1)[:, None] / self.sigma
        return np.hstack([g, self.times[:, None] * g])

    def pseudo_linear(self, z: Any) -> Any:
        """The start that most users write: Li & Sheng 2009, eq. (3), by least squares."""
        c, s = np.cos(z), np.sin(z)
        rows = np.stack([c, -s, self.times * c, -self.times * s], axis=1)
        return np.linalg.lstsq(rows, self.path[:, 0] * c - self.path[:, 1] * s, rcond=None)[0]

    def by_scipy(self, *, start: Any = None, plain: bool = False) -> Callable[[Any], Any]:
        """MINPACK with the analytic Jacobian; `plain`: SciPy's defaults."""
        from scipy.optimize import least_squares

        def estimate(z: Any) -> Any:
            first = self.pseudo_linear(z) if start is None else start
            if plain:
                return least_squares(self.residual, first, args=(z,), x_scale="jac").x
            return least_squares(
                self.residual, first, lambda x, _: self.jacobian(x), args=(z,), method="lm",
                x_scale="jac",
            ).x  # fmt: skip

        return estimate

    def most_likely(self, z: Any) -> Any:
        """The estimate with 30 digits: Gauss-Newton from ours."""
        import mpmath as mp

        with mp.workdps(30):
            number = lambda x: mp.mpf(float(x))  # noqa: E731
            near = bearings.localize_many(self.times, z, self.path, self.sigma).state
            x = mp.matrix([number(e) for e in near])
            for _ in range(60):
                normal, right = mp.zeros(4), mp.zeros(4, 1)
                for t, angle, place in zip(self.times, z, self.path, strict=True):
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


def limit(m: int) -> Limit:
    """What binds one estimate from m bearings."""
    return Limit(
        {"fma": 5.0 * 63 * m, "divide": 5.0 * 2 * m},
        "a start and 4 linearisations of each bearing: an arc tangent (25 multiply-adds and a "
        "division), a row (10 and a division), 4 columns made orthogonal (28)",
    )


M = 60
TRUTH = np.array([2000.0, 6000.0, 3.0, -2.0])
SIGMA = float(np.radians(0.5))
HEADING = np.where(np.arange(M - 1) < M // 2, 0.0, np.radians(60.0))
STEPS = 75.0 * np.stack([np.sin(HEADING), np.cos(HEADING)], axis=1)
TRACK = Track(15.0 * np.arange(M), np.vstack([np.zeros(2), np.cumsum(STEPS, axis=0)]), SIGMA)
TIMES, PATH = TRACK.times, TRACK.path
TARGET = "100 000 estimates a second on one thread"


def noisy(trials: int, sigma: float = SIGMA) -> Any:
    return bearings.simulate(TIMES, PATH, TRUTH, sigma, seed=1, trials=trials)


def scipy_loop(few: int, start: Any = None) -> Callable[[Any], Callable[[], Any]]:
    """One call of least_squares for each trial."""

    def prepare(data: Any) -> Callable[[], Any]:
        estimate = TRACK.by_scipy(start=start)
        return lambda: np.array([estimate(z) for z in data[:few]])

    return prepare


def by_c(data: Any) -> Callable[[], Any]:
    kernel = c_function("localize.c", "localize", *FAST)

    def work() -> Any:
        out = np.empty((len(data), 4))
        kernel(TIMES, data, PATH, len(data), M, out)
        return out

    return work


FEW = 3  # trials that each contestant is asked for its accuracy


def case(sigma: float, data: Any = None) -> Case:
    """Distance from the most likely state, in deviations."""
    z = noisy(FEW, sigma)

    def make() -> Any:
        std = bearings.localize_many(TIMES, z, PATH, sigma).std
        return np.array([TRACK.most_likely(one) for one in z]), std

    wanted = exact.lazily(make)
    return Case(
        z if data is None else data,
        lambda found: float(np.abs((found[:FEW] - wanted()[0]) / wanted()[1]).max()),
    )


def estimates_contest(trials: int, peer_trials: int) -> Contest:
    """Estimates from given bearings."""

    def ours(data: Any) -> Callable[[], Any]:
        return lambda: bearings.localize_many(TIMES, data, PATH, SIGMA).state

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
                scipy_loop(peer_trials),
                part=float(peer_trials),
            ),
            Contestant(
                "SciPy least_squares, started at the truth",
                scipy_loop(peer_trials, TRUTH),
                part=float(peer_trials),
            ),
        ],
        limit=limit(M),
        cases={"well": case(SIGMA / 5), "ill": case(SIGMA * 2)},
        target=TARGET,
        note="Error: distance from the most likely state in deviations of the bound; ours gives "
        "covariance, rank and a status beside the state.",
    )


def simulated_contest(trials: int) -> Contest:
    """Simulation and estimate in one pass, beside the two calls."""

    def one_pass(data: Any) -> Callable[[], Any]:
        sigma, trials = data
        return lambda: (
            TRUTH + bearings.localize_trials(TIMES, PATH, TRUTH, sigma, trials=trials, seed=1).error
        )

    def two_calls(data: Any) -> Callable[[], Any]:
        sigma, trials = data
        return lambda: bearings.localize_many(TIMES, noisy(trials, sigma), PATH, sigma).state

    return Contest(
        f"bearings simulated and located, {trials} trials, m = {M}",
        "trial",
        float(trials),
        (SIGMA, trials),
        [
            Contestant(OURS, one_pass),
            Contestant("gramian, all threads", one_pass, threads=ALL),
            Contestant("gramian, simulate, then localize", two_calls),
        ],
        limit=limit(M),
        cases={
            name: case(sigma, (sigma, FEW))
            for name, sigma in (("well", SIGMA / 5), ("ill", SIGMA * 2))
        },
        target="80 000 trials a second on one thread",
        note="The limit is that of the estimate: random numbers are whole-number work.",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    trials = 2_000 if quick else 20_000
    yield estimates_contest(trials, 20 if quick else 100)
    yield simulated_contest(trials)


if __name__ == "__main__":
    main(contests)
