"""Bearings: sums over all quadruples, Gram matrices with determinants, the test on noise."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from math import comb
from typing import Any

import numpy as np
from harness import OURS, Contest, Contestant, Limit, c_library, main, pointer

import gramian as gm

B = gm.bearings
FAST = ("-ffast-math",)


def track(m: int, turn_deg: float = 90.0) -> tuple[Any, Any]:
    """A target at constant velocity, an observer that turns once."""
    times = 20.0 * np.arange(m)
    heading = np.where(np.arange(m - 1) < m // 2, 0.0, np.radians(turn_deg))
    steps = 100.0 * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    path = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    offsets = np.array([0.0, 1e4]) + times[:, None] * np.array([3.0, -1.0]) - path
    return times, np.arctan2(offsets[:, 0], offsets[:, 1])


def c_function(name: str, result: Any = None, flags: tuple[str, ...] = ()) -> Any:
    function = getattr(c_library("bearings.c", *flags), name)
    function.restype = result
    return function


def exact_sum(times: Any, bearings: Any) -> Any:
    """The determinant of the Gram matrix with 50 digits."""
    import mpmath

    mpmath.mp.dps = 50
    total = mpmath.zeros(4)
    for t, b in zip(times, bearings, strict=True):
        cos, sin = mpmath.cos(mpmath.mpf(b)), mpmath.sin(mpmath.mpf(b))
        time = mpmath.mpf(t) - mpmath.mpf(times[0])
        h = mpmath.matrix([[cos, -sin, time * cos, -time * sin]])
        total += h.T * h
    return mpmath.det(total)


def relative(found: Any, exact: Any) -> float:
    import mpmath

    return float(abs(mpmath.mpf(float(found)) / exact - 1))


def numba_sum() -> Callable[..., float]:
    import numba

    @numba.njit(fastmath=True)
    def kernel(t: Any, b: Any) -> float:
        m = t.size
        s = np.sin(b[None, :] - b[:, None])
        p, q = np.empty(m), np.empty(m)
        total = 0.0
        for j in range(1, m):
            for k in range(j + 1, m - 1):
                for n in range(k + 1, m):
                    p[n] = (t[n] - t[j]) * s[k, n]
                    q[n] = (t[n] - t[k]) * s[j, n]
                for i in range(j):
                    a = (t[k] - t[i]) * s[i, j]
                    c = (t[j] - t[i]) * s[i, k]
                    for n in range(k + 1, m):
                        d = a * p[n] - c * q[n]
                        total += d * d
        return total

    return kernel


def numpy_sum(t: Any, b: Any, last: int) -> float:
    """The pairs with j below `last` only: all would take minutes."""
    m = t.size
    s, tau = np.sin(b[None, :] - b[:, None]), t[None, :] - t[:, None]
    total = 0.0
    for j in range(1, last):
        for k in range(j + 1, m - 1):
            a, c = tau[:j, k] * s[:j, j], tau[:j, j] * s[:j, k]
            p, q = tau[j, k + 1 :] * s[k, k + 1 :], tau[k, k + 1 :] * s[j, k + 1 :]
            d = np.outer(a, p) - np.outer(c, q)
            total += (d * d).sum()
    return total


def sum_contest(m: int, threads: int, target: str) -> Contest:
    times, bearings = track(m)
    exact = exact_sum(times, bearings)
    quadruples = comb(m, 4)
    last = 5
    part = sum(j * (m - 1 - k) for j in range(1, last) for k in range(j + 1, m - 1))

    def by_c(name: str, *flags: str) -> Callable[[], Callable[[], Any]]:
        def prepare() -> Callable[[], Any]:
            kernel = c_function(name, ctypes.c_double, flags)
            t, b = pointer(times), pointer(bearings)
            return lambda: kernel(t, b, ctypes.c_long(m))

        return prepare

    def by_numba() -> Callable[[], Any]:
        kernel = numba_sum()
        return lambda: kernel(times, bearings)

    contestants = [Contestant(OURS, lambda: lambda: B.discriminant_sum(times, bearings))]
    if threads == 1:
        contestants += [
            Contestant("C, gcc -O3 -march=native", by_c("discriminant_sum")),
            Contestant("the same, four rows at once", by_c("discriminant_sum_blocked")),
            Contestant("C, also -ffast-math", by_c("discriminant_sum", *FAST)),
            Contestant("numba", by_numba),
            Contestant(
                "numpy, outer products",
                lambda: lambda: numpy_sum(times, bearings, last),
                work=float(part),
            ),
        ]
    return Contest(
        f"sum of D^2 over all quadruples, m = {m}",
        "quadruple",
        float(quadruples),
        contestants,
        limit=Limit("fma", 2.0, "two multiply-adds a quadruple"),
        # numpy did only a part.
        error=lambda found: min(relative(found, exact), 1.0),
        threads=threads,
        size=float(m),
        series=f"sum of D^2, {threads} thread{'s' if threads > 1 else ''}",
        target=target,
    )


def other_methods(m: int) -> Contest:
    times, bearings = track(m, 1.0)
    exact = exact_sum(times, bearings)

    def ours(method: Any) -> Callable[[], Callable[[], Any]]:
        return lambda: lambda: B.discriminant_sum(times, bearings, method=method)

    return Contest(
        f"the same number by three methods, m = {m}, a turn of 1 deg",
        "track",
        1.0,
        [
            Contestant(OURS, ours("direct")),
            Contestant("gramian, factored", ours("factored")),
            Contestant("gramian, qr", ours("qr")),
            Contestant("gramian, gram_det", lambda: lambda: B.gram_det(times, bearings)[1]),
        ],
        error=lambda found: relative(found, exact),
    )


def gram_contest(trials: int, m: int) -> Contest:
    times = 10.0 * np.arange(m)
    bearings = np.random.default_rng(3).uniform(-np.pi, np.pi, (trials, m))
    few = slice(0, 20)
    exact = [exact_sum(times, b) for b in bearings[few]]

    def rows() -> Any:
        c, s, t = np.cos(bearings), np.sin(bearings), times - times[0]
        return np.stack([c, -s, t * c, -t * s], axis=-1)

    def einsum() -> Any:
        h = rows()
        matrix = np.einsum("bki,bkj->bij", h, h)
        return matrix, np.linalg.det(matrix)

    def six_sums() -> Any:
        t = times - times[0]
        powers = np.stack([t**0, t, t * t])
        c, s = np.cos(2 * bearings) @ powers.T, np.sin(2 * bearings) @ powers.T
        sums = powers.sum(axis=1)
        a, b, d = (sums + c) / 2, -s / 2, (sums - c) / 2
        matrix = np.empty((trials, 4, 4))
        for row, column, k in ((0, 0, 0), (0, 2, 1), (2, 0, 1), (2, 2, 2)):
            matrix[:, row, column], matrix[:, row, column + 1] = a[:, k], b[:, k]
            matrix[:, row + 1, column], matrix[:, row + 1, column + 1] = b[:, k], d[:, k]
        return matrix, np.linalg.det(matrix)

    def by_c() -> Callable[[], Any]:
        kernel = c_function("gram_det", flags=FAST)
        matrix, det = np.empty((trials, 4, 4)), np.empty(trials)
        arguments = (
            pointer(times), pointer(bearings), ctypes.c_long(trials), ctypes.c_long(m),
            pointer(matrix), pointer(det),
        )  # fmt: skip

        def work() -> Any:
            kernel(*arguments)
            return matrix, det

        return work

    def by_numba() -> Callable[[], Any]:
        import numba

        @numba.njit(fastmath=True)
        def kernel(times: Any, bearings: Any) -> Any:
            trials, m = bearings.shape
            out, det = np.zeros((trials, 4, 4)), np.empty(trials)
            h = np.empty(4)
            for n in range(trials):
                for i in range(m):
                    t = times[i] - times[0]
                    h[0], h[1] = np.cos(bearings[n, i]), -np.sin(bearings[n, i])
                    h[2], h[3] = t * h[0], t * h[1]
                    for a in range(4):
                        for b in range(a, 4):
                            out[n, a, b] += h[a] * h[b]
                for a in range(4):
                    for b in range(a):
                        out[n, a, b] = out[n, b, a]
                det[n] = np.linalg.det(out[n])
            return out, det

        return lambda: kernel(times, bearings)

    return Contest(
        f"gram and det, {trials} x {m}",
        "trial",
        float(trials),
        [
            Contestant(OURS, lambda: lambda: B.gram_det(times, bearings)),
            Contestant("C, vector maths library", by_c),
            Contestant("numba", by_numba),
            Contestant("numpy einsum", lambda: einsum),
            Contestant("numpy, six sums", lambda: six_sums),
        ],
        limit=Limit("sincos", float(m), "a sine and a cosine of each bearing"),
        error=lambda found: max(relative(d, e) for d, e in zip(found[1][few], exact, strict=True)),
        target="0.12 us a trial, 45 x numpy einsum, 5 x numba, 1.4 x C",
    )


def test_contest(trials: int, m: int) -> Contest:
    times, bearings = track(m, 0.0)
    sigma = np.radians(0.5)
    noisy = bearings + sigma * np.random.default_rng(4).normal(size=(trials, m))
    few = 10

    def least_squares() -> Any:
        from scipy import optimize, stats

        t = times / times[-1]
        found = []
        for b in noisy[:few]:
            fit = optimize.least_squares(
                lambda c, b=b: (b - np.arctan2(c[0] + c[1] * t, 1 + c[2] * t)) / sigma,
                [b.mean(), 0.0, 0.0],
            )
            found.append(stats.chi2.sf(2 * fit.cost, m - 3))
        return np.array(found)

    wanted = least_squares()
    return Contest(
        f"observability_test, {trials} x {m}",
        "test",
        float(trials),
        [
            Contestant(OURS, lambda: lambda: B.observability_test(times, noisy, sigma).p_value),
            Contestant("scipy least_squares", lambda: least_squares, work=float(few)),
        ],
        error=lambda found: float(np.abs(found[:few] / wanted - 1).max()),
        target="5 us a test",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """Yield the contests of bearings."""
    asked = "{} ns on an AVX-512 machine of 60 G multiply-adds a second, 2.5 x C"
    yield sum_contest(128, 1, asked.format(0.11))
    yield sum_contest(256, 1, asked.format(0.075))
    if not quick:
        yield sum_contest(400, 1, asked.format(0.065))
    yield sum_contest(256, 2, "1.8 x one thread")
    yield other_methods(100)
    yield gram_contest(10_000, 100)
    yield test_contest(5_000, 60)


if __name__ == "__main__":
    main(contests)
