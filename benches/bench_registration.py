"""Registration: the Fisher sum of 481 looks, and maximum likelihood of 200."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import exact
import numpy as np
from harness import ALL, FAST, OURS, Case, Contest, Contestant, c_function, grown, main
from limits import Limit

from gramian import registration as reg

SENSORS = np.array([[0.0, 0.0], [60e3, 0.0]])
SIGMA = np.tile([50.0, np.radians(0.1)], (2, 1))
S2 = SIGMA.ravel() ** 2
K = np.arange(481.0)
MOTION_1 = np.stack([-30e3 + 250 * K, 40e3 + 0 * K], axis=1)
TARGET_A = np.stack([-20e3 + 400 * K[:200], 25e3 + 0 * K[:200]], axis=1)
BIASES = np.array([300.0, np.radians(0.5), -200.0, np.radians(-0.4)])


def numpy_fisher(p: Any) -> Any:
    """Sum of H^T R^-1 H over all looks at once, as numpy does it best."""
    a, b = p - SENSORS[0], p - SENSORS[1]
    ra, rb = np.hypot(a[:, 0], a[:, 1]), np.hypot(b[:, 0], b[:, 1])
    h = np.empty((len(p), 2, 4))
    h[:, 0, 0], h[:, 1, 0] = a[:, 0] / ra, a[:, 1] / ra
    h[:, 0, 1], h[:, 1, 1] = a[:, 1], -a[:, 0]
    h[:, 0, 2], h[:, 1, 2] = -b[:, 0] / rb, -b[:, 1] / rb
    h[:, 0, 3], h[:, 1, 3] = -b[:, 1], b[:, 0]
    noise = (h * S2) @ h.transpose(0, 2, 1)
    solved = np.linalg.solve(noise, h)
    return np.tensordot(h, solved, axes=([0, 1], [0, 1]))


def loop_fisher(p: Any) -> Any:
    """The same look by look, as it is usually written."""
    total = np.zeros((4, 4), dtype=p.dtype)
    for x in p:
        columns = []
        for s, sign in zip(SENSORS, (1, -1), strict=True):
            d = x - s
            columns += [sign * d / np.hypot(*d), sign * np.array([d[1], -d[0]])]
        h = np.stack(columns, axis=1)
        (a, b), (_, d) = h @ np.diag(S2).astype(p.dtype) @ h.T
        total += h.T @ (np.array([[d, -b], [-b, a]]) / (a * d - b * b)) @ h
    return total


def scipy_ml(reports: Any, *, sparse: bool) -> Any:
    """Positions and biases together by scipy.optimize.least_squares."""
    from scipy.optimize import least_squares
    from scipy.sparse import lil_matrix

    count = len(reports)
    sigma = SIGMA.ravel()

    def parts(x: Any) -> Any:
        offset = x[4:].reshape(-1, 1, 2) - SENSORS
        return offset, np.hypot(offset[..., 0], offset[..., 1])

    def residual(x: Any) -> Any:
        offset, r = parts(x)
        e = np.empty((count, 4))
        e[:, 0::2] = reports[..., 0] - r - x[[0, 2]]
        turn = reports[..., 1] - np.arctan2(offset[..., 0], offset[..., 1]) - x[[1, 3]]
        e[:, 1::2] = (turn + np.pi) % (2 * np.pi) - np.pi
        return (e / sigma).ravel()

    def jacobian(x: Any) -> Any:
        offset, r = parts(x)
        j = np.zeros((count, 4, 4 + 2 * count))
        j[:, range(4), range(4)] = -1 / sigma
        k = np.arange(count)
        for s in range(2):
            u = offset[:, s] / r[:, s, None]
            for c in range(2):
                j[k, 2 * s, 4 + 2 * k + c] = -u[:, c] / sigma[2 * s]
            j[k, 2 * s + 1, 4 + 2 * k] = -u[:, 1] / r[:, s] / sigma[2 * s + 1]
            j[k, 2 * s + 1, 5 + 2 * k] = u[:, 0] / r[:, s] / sigma[2 * s + 1]
        return j.reshape(4 * count, -1)

    first = reports[..., :1] * np.stack([np.sin(reports[..., 1]), np.cos(reports[..., 1])], axis=-1)
    start = np.concatenate([np.zeros(4), (first + SENSORS).mean(axis=1).ravel()])
    scale = np.concatenate([sigma, np.full(2 * count, 50.0)])
    if sparse:
        pattern = lil_matrix((4 * count, 4 + 2 * count), dtype=int)
        for k in range(count):
            pattern[4 * k : 4 * k + 4, 4 + 2 * k : 6 + 2 * k] = 1
            for i in range(4):
                pattern[4 * k + i, i] = 1
        return least_squares(residual, start, jac_sparsity=pattern, x_scale=scale, xtol=1e-10).x[:4]
    return least_squares(residual, start, jac=jacobian, x_scale=scale, xtol=1e-10).x[:4]


@cache
def numba_kernel() -> Callable[..., Any]:
    import numba

    @numba.njit(fastmath=True)
    def kernel(positions: Any, sensors: Any, variance: Any) -> Any:
        out = np.zeros((positions.shape[0], 4, 4))
        h, g = np.empty((2, 4)), np.empty((2, 4))
        for n in range(positions.shape[0]):
            for k in range(positions.shape[1]):
                for s in range(2):
                    x = positions[n, k, 0] - sensors[s, 0]
                    y = positions[n, k, 1] - sensors[s, 1]
                    sign, r = 1.0 - 2.0 * s, np.sqrt(x * x + y * y)
                    h[0, 2 * s], h[1, 2 * s] = sign * x / r, sign * y / r
                    h[0, 2 * s + 1], h[1, 2 * s + 1] = sign * y, -sign * x
                a = b = d = 0.0
                for i in range(4):
                    a += variance[i] * h[0, i] * h[0, i]
                    b += variance[i] * h[0, i] * h[1, i]
                    d += variance[i] * h[1, i] * h[1, i]
                w = 1 / (a * d - b * b)
                for i in range(4):
                    g[0, i] = w * (d * h[0, i] - b * h[1, i])
                    g[1, i] = w * (a * h[1, i] - b * h[0, i])
                for i in range(4):
                    for j in range(4):
                        out[n, i, j] += h[0, i] * g[0, j] + h[1, i] * g[1, j]
        return out

    return kernel


def by_numba(data: Any) -> Callable[[], Any]:
    kernel = numba_kernel()
    return lambda: kernel(data, SENSORS, S2)


def by_c(data: Any) -> Callable[[], Any]:
    kernel = c_function("registration.c", "registration_fisher", *FAST)

    def work() -> Any:
        out = np.empty((len(data), 4, 4))
        kernel(data, SENSORS, S2, len(data), data.shape[1], out)
        return out

    return work


def exact_fisher(looks: Any) -> Any:
    """The sum over the looks with 50 digits."""
    import mpmath as mp

    with mp.workdps(exact.DIGITS):
        variance = mp.diag([mp.mpf(float(x)) ** 2 for x in SIGMA.ravel()])
        total = mp.zeros(4)
        for place in looks:
            h = mp.zeros(2, 4)
            for s, sign in ((0, 1), (1, -1)):
                x, y = (mp.mpf(float(place[i])) - mp.mpf(float(SENSORS[s, i])) for i in (0, 1))
                r = mp.sqrt(x * x + y * y)
                h[0, 2 * s], h[1, 2 * s] = sign * x / r, sign * y / r
                h[0, 2 * s + 1], h[1, 2 * s + 1] = sign * y, -sign * x
            total += h.T * (h * variance * h.T) ** -1 * h
        return exact.numbers(total)


@cache
def cases() -> dict[str, Case]:
    """The target of motion 1, and one a hundred baselines away."""
    made = {}
    for name, looks in (
        ("well", MOTION_1[::20].copy()),
        ("ill", MOTION_1[::20] + np.array([0, 6e6])),
    ):
        wanted = exact.lazily(lambda looks=looks: exact_fisher(looks)[None])
        made[name] = Case(looks[None], lambda found, wanted=wanted: exact.entries(found, wanted()))
    return made


def fisher_contest(tracks: int, looks: int, *, peers: bool, series: str = "") -> Contest:
    """Many tracks of many looks in one call."""
    path = np.stack([-30e3 + np.linspace(0, 120e3, looks), np.full(looks, 40e3)], axis=1)
    part = min(tracks, 20)

    def ours(data: Any) -> Callable[[], Any]:
        return lambda: reg.fisher(data, SENSORS, SIGMA)

    contestants = [
        Contestant(OURS, ours),
        Contestant("C, ten sums", by_c),
        Contestant(
            "numpy, all looks of a track at once",
            lambda data: lambda: [numpy_fisher(p) for p in data[:part]],
            part=part,
        ),
    ]
    if peers:
        contestants[1:1] = [Contestant("gramian, all threads", ours, threads=ALL)]
        contestants += [
            Contestant("numba", by_numba),
            Contestant(
                "numpy, look by look", lambda data: lambda: [loop_fisher(data[0])], part=1.0
            ),
        ]
    return Contest(
        f"registration Fisher information, {tracks} x {looks} looks",
        "track",
        float(tracks),
        path + np.linspace(0, 1000, tracks)[:, None, None],
        contestants,
        limit=Limit(
            {"fma": 48.0 * looks, "divide": looks, "root": 2.0 * looks},
            "48 multiplications and multiply-adds, a division and two roots a look",
        ),
        cases=cases(),
        size=float(tracks if series == "trials" else looks),
        series=series and f"registration Fisher against {series}",
        target="20 times numpy" if peers else "",
        note="Error of an entry over the roots of its diagonal entries.",
    )


def estimate_limit(looks: int) -> Limit:
    """What binds one maximum likelihood estimate."""
    judged = min(looks, 64)
    return Limit(
        {
            "fma": 6.0 * looks * 280 + judged * (8 * 190 + 3 * 64),
            "divide": 6.0 * looks * 26 + judged * (8 * 16 + 3 * 8),
            "root": 7.0 * (6 * looks + 8 * judged),
        },
        "5 steps and a verdict linearise each look and take it into a triangle (280 multiply-adds, "
        "26 divisions, 7 roots); 64 looks are linearised 8 times more to judge the weakest "
        "direction",
    )


def likelihood_contest(*, peers: bool) -> Contest:
    """Biases and positions of 200 looks: 404 unknowns."""

    def reports(biases: Any, track: Any) -> Any:
        return reg.simulate(track, SENSORS, SIGMA, biases, seed=1).values

    def ours(data: Any) -> Callable[[], Any]:
        return lambda: reg.estimate(data, SENSORS, SIGMA).biases

    def case(track: Any) -> Case:
        data = reports(BIASES, track)

        def make() -> Any:
            std = reg.estimate(data, SENSORS, SIGMA).std
            return exact_estimate(data), std

        wanted = exact.lazily(make)
        return Case(data, lambda x: float(np.abs((x - wanted()[0]) / wanted()[1]).max()))

    contestants = [
        Contestant(OURS, ours, limit=estimate_limit(len(TARGET_A))),
        Contestant(
            "SciPy least_squares, analytic Jacobian",
            lambda data: lambda: scipy_ml(data, sparse=False),
        ),
    ]
    if peers:
        contestants.append(
            Contestant(
                "SciPy least_squares, sparse differences",
                lambda data: lambda: scipy_ml(data, sparse=True),
            )
        )
    return Contest(
        "registration maximum likelihood, 200 looks",
        "estimate",
        1.0,
        reports(BIASES, TARGET_A),
        contestants,
        cases={"well": case(TARGET_A[::10]), "ill": case(TARGET_A[::10] + np.array([0, 60e3]))},
        target="100 times SciPy",
        note="Error: distance from the most likely biases in deviations of the bound.",
    )


def exact_estimate(reports: Any) -> Any:
    """The most likely biases with 30 digits: Gauss-Newton, positions eliminated."""
    import mpmath as mp

    with mp.workdps(30):
        sigma = [mp.mpf(float(x)) for x in SIGMA.ravel()]
        z = [[mp.mpf(float(x)) for x in look.ravel()] for look in reports]
        start = reg.estimate(reports, SENSORS, SIGMA)
        biases = mp.matrix([mp.mpf(float(x)) for x in start.biases])
        places = [
            mp.matrix([look[0] * mp.sin(look[1]), look[0] * mp.cos(look[1])])
            + mp.matrix([mp.mpf(float(x)) for x in SENSORS[0]])
            for look in z
        ]
        for _ in range(60):
            normal, right, parts = mp.zeros(4), mp.zeros(4, 1), []
            for look, place in zip(z, places, strict=True):
                e, p = mp.zeros(4, 1), mp.zeros(4, 2)
                for s in range(2):
                    x, y = (place[i] - mp.mpf(float(SENSORS[s, i])) for i in (0, 1))
                    r2 = x * x + y * y
                    r = mp.sqrt(r2)
                    turn = look[2 * s + 1] - mp.atan2(x, y) - biases[2 * s + 1]
                    turn -= 2 * mp.pi * mp.nint(turn / (2 * mp.pi))
                    e[2 * s] = (look[2 * s] - r - biases[2 * s]) / sigma[2 * s]
                    e[2 * s + 1] = turn / sigma[2 * s + 1]
                    p[2 * s, 0], p[2 * s, 1] = x / r / sigma[2 * s], y / r / sigma[2 * s]
                    p[2 * s + 1, 0] = y / r2 / sigma[2 * s + 1]
                    p[2 * s + 1, 1] = -x / r2 / sigma[2 * s + 1]
                b = mp.diag([1 / x for x in sigma])
                inverse = (p.T * p) ** -1
                kept = mp.eye(4) - p * inverse * p.T
                normal += b * kept * b
                right += b * kept * e
                parts.append((inverse * p.T, e, b))
            step = mp.lu_solve(normal, right)
            biases += step
            places = [
                place + solve * (e - b * step)
                for place, (solve, e, b) in zip(places, parts, strict=True)
            ]
            if max(abs(step[i]) / sigma[i] for i in range(4)) < mp.mpf(10) ** -14:
                break
        return np.array([float(x) for x in biases])


def contests(quick: bool) -> Iterator[Contest]:
    """Yield the contests of this part."""
    yield fisher_contest(1, 481, peers=True)
    yield fisher_contest(100 if quick else 1000, 481, peers=True)
    yield from grown(fisher_contest, quick=quick)
    yield likelihood_contest(peers=not quick)


if __name__ == "__main__":
    main(contests)
