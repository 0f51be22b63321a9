"""Bearings: sums over all quadruples, Gram matrices with determinants, Fisher information."""

from __future__ import annotations

import ctypes
import math
import mmap
from collections.abc import Callable, Iterator
from functools import cache
from math import comb
from typing import Any

import exact
import numpy as np
from harness import ALL, FAST, OURS, Case, Contest, Contestant, c_function, grown, main
from limits import Limit, reading

import gramian as gm

B = gm.bearings


def track(m: int, turn_deg: float = 90.0, seed: int | None = None) -> tuple[Any, Any]:
    """Bearings of a target at constant velocity from an observer that turns once."""
    times, path, states = tracks(1, m, turn_deg, seed)
    offsets = states[0, :2] + times[:, None] * states[0, 2:] - path
    return times, np.arctan2(offsets[:, 0], offsets[:, 1])


def tracks(trials: int, m: int, turn_deg: float, seed: int | None = 0) -> tuple[Any, Any, Any]:
    """Times, the path of an observer that turns once, states of targets."""
    times = 20.0 * np.arange(m)
    heading = np.where(np.arange(m - 1) < m // 2, 0.0, np.radians(turn_deg))
    steps = 100.0 * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    path = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    states = np.tile([0.0, 1e4, 3.0, -1.0], (trials, 1))
    if seed is not None:
        states += np.random.default_rng(seed).normal(size=(trials, 4)) * [500, 500, 1, 1]
    return times, path, states


# --- sums of D^2 -------------------------------------------------------------


@cache
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
    """The pairs with j below `last`: of a long track all would take minutes."""
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


@cache
def sum_cases() -> dict[str, Case]:
    """A turn of a right angle and one of a hundredth of a degree, 40 bearings each."""
    cases = {}
    for name, turn in (("well", 90.0), ("ill", 0.01)):
        data = track(40, turn)
        wanted = exact.lazily(lambda data=data: exact.det(exact.gram(exact.bearing_rows(*data))))
        cases[name] = Case(data, lambda found, wanted=wanted: exact.relative(found, wanted()))
    return cases


#: A row rotated into a triangle of four: multiply-adds, divisions, roots.
ROTATED = {"fma": 40.0, "divide": 12.0, "root": 4.0}


def sum_contest(m: int) -> Contest:
    def ours(method: Any) -> Callable[[Any], Callable[[], Any]]:
        return lambda data: lambda: B.discriminant_sum(*data, method=method)

    def by_c(name: str, *flags: str) -> Callable[[Any], Callable[[], Any]]:
        def prepare(data: Any) -> Callable[[], Any]:
            kernel = c_function("bearings.c", name, *flags, result=ctypes.c_double)
            return lambda: kernel(*data, len(data[0]))

        return prepare

    def by_numba(data: Any) -> Callable[[], Any]:
        kernel = numba_sum()
        return lambda: kernel(*data)

    last = 5
    part = sum(j * (m - 1 - k) for j in range(1, last) for k in range(j + 1, m - 1))

    def by_numpy(data: Any) -> Callable[[], Any]:
        return lambda: numpy_sum(*data, last if len(data[0]) == m else len(data[0]))

    contestants = [Contestant(OURS, ours("direct"))]
    if m >= 128:
        contestants.append(Contestant("gramian, all threads", ours("direct"), threads=ALL))
    contestants += [
        Contestant(
            "gramian, method factored",
            ours("factored"),
            limit=Limit({"fma": 5 * m**3 / 3 / comb(m, 4)}, "5 multiply-adds for each of m^3 / 3"),
        ),
        Contestant(
            "gramian, method qr",
            ours("qr"),
            limit=Limit(
                {kind: count * m / comb(m, 4) for kind, count in ROTATED.items()},
                "m rows rotated in",
            ),
        ),
    ]
    if m <= 256:
        contestants += [
            Contestant("C, gcc -O3 -march=native", by_c("discriminant_sum")),
            Contestant("C, four rows at once", by_c("discriminant_sum_blocked")),
        ]
    contestants.append(Contestant("C, also -ffast-math", by_c("discriminant_sum", *FAST)))
    if m <= 256:
        contestants += [
            Contestant("numba", by_numba),
            Contestant("numpy, outer products", by_numpy, part=float(part) if m > 40 else None),
        ]
    asked = {128: 0.11, 256: 0.075, 400: 0.065}
    return Contest(
        f"sum of D^2 over all quadruples, m = {m}",
        "quadruple",
        float(comb(m, 4)),
        track(m),
        contestants,
        limit=Limit({"fma": 2.0}, "two multiply-adds a quadruple"),
        cases=sum_cases(),
        size=float(m),
        series="sum of D^2 against samples",
        target=f"{asked[m]} ns on a machine of 60 G multiply-adds a second, 2.5 x C"
        if m in asked
        else "",
        note="The methods factored and qr give the same number in m^3 and m operations.",
    )


# --- Gram matrices and determinants ----------------------------------------------


def einsum(times: Any, bearings: Any) -> Any:
    c, s, t = np.cos(bearings), np.sin(bearings), times - times[0]
    h = np.stack([c, -s, t * c, -t * s], axis=-1)
    matrix = np.einsum("bki,bkj->bij", h, h)
    return matrix, np.linalg.det(matrix)


def six_sums(times: Any, bearings: Any) -> Any:
    t = times - times[0]
    powers = np.stack([t**0, t, t * t])
    c, s = np.cos(2 * bearings) @ powers.T, np.sin(2 * bearings) @ powers.T
    sums = powers.sum(axis=1)
    a, b, d = (sums + c) / 2, -s / 2, (sums - c) / 2
    matrix = np.empty((len(bearings), 4, 4))
    for row, column, k in ((0, 0, 0), (0, 2, 1), (2, 0, 1), (2, 2, 2)):
        matrix[:, row, column], matrix[:, row, column + 1] = a[:, k], b[:, k]
        matrix[:, row + 1, column], matrix[:, row + 1, column + 1] = b[:, k], d[:, k]
    return matrix, np.linalg.det(matrix)


def gram_by_c(data: Any) -> Callable[[], Any]:
    kernel = c_function("bearings.c", "gram_det", *FAST)
    times, bearings = data
    trials, m = bearings.shape

    def work() -> Any:
        matrix, det = np.empty((trials, 4, 4)), np.empty(trials)
        kernel(times, bearings, trials, m, matrix, det)
        return matrix, det

    return work


@cache
def numba_gram() -> Callable[..., Any]:
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

    return kernel


def gram_by_numba(data: Any) -> Callable[[], Any]:
    kernel = numba_gram()
    return lambda: kernel(*data)


def gram_by_jax(data: Any) -> Callable[[], Any]:
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp

    @jax.jit
    def kernel(times: Any, bearings: Any) -> Any:
        c, s, t = jnp.cos(bearings), jnp.sin(bearings), times - times[0]
        h = jnp.stack([c, -s, t * c, -t * s], axis=-1)
        matrix = jnp.einsum("bki,bkj->bij", h, h)
        return matrix, jnp.linalg.det(matrix)

    given = tuple(map(jnp.asarray, data))
    return lambda: jax.block_until_ready(kernel(*given))


@cache
def gram_cases() -> dict[str, Case]:
    """Bearings all around, and a track with a turn of one degree."""
    cases = {}
    times = 10.0 * np.arange(60)
    around = np.random.default_rng(3).uniform(-np.pi, np.pi, (5, 60))
    turned = np.stack([track(60, 1.0, seed)[1] for seed in range(5)])
    for name, t, bearings in (("well", times, around), ("ill", 2 * times, turned)):
        wanted = exact.lazily(
            lambda t=t, bearings=bearings: [
                exact.det(exact.gram(exact.bearing_rows(t, b))) for b in bearings
            ]
        )
        cases[name] = Case(
            (t, bearings), lambda found, wanted=wanted: exact.largest(found[1], wanted())
        )
    return cases


def gram_contest(trials: int, m: int, *, peers: bool = True, series: str = "") -> Contest:
    bearings = np.random.default_rng(3).uniform(-np.pi, np.pi, (trials, m))

    def ours(data: Any) -> Callable[[], Any]:
        return lambda: B.gram_det(*data)

    contestants = [
        Contestant(OURS, ours),
        Contestant("C, vector maths library", gram_by_c),
        Contestant("numpy, six sums", lambda data: lambda: six_sums(*data)),
    ]
    if peers:
        contestants[1:1] = [Contestant("gramian, all threads", ours, threads=ALL)]
        contestants += [
            Contestant("numba", gram_by_numba),
            Contestant("JAX", gram_by_jax),
            Contestant("numpy einsum", lambda data: lambda: einsum(*data)),
        ]
    return Contest(
        f"bearings Gram and det, {trials} x {m}",
        "trial",
        float(trials),
        (10.0 * np.arange(m), bearings),
        contestants,
        limit=Limit(
            {"sincos": m, "fma": 6.0 * m},
            "a sine, a cosine and six sums for each bearing",
        ),
        cases=gram_cases(),
        size=float(trials if series == "trials" else m),
        series=series and f"bearings Gram against {series}",
        target="0.12 us a trial on a machine of 60 G multiply-adds a second, "
        "45 x numpy einsum, 5 x numba, 1.4 x C"
        if peers
        else "",
        note="The error is that of the determinant.",
    )


# --- Fisher information of tracks ---------------------------------------------------

SIGMA = 0.01


def sighted(times: Any, path: Any, states: Any) -> Any:
    """Rows, Fisher information and its determinant, all tracks at once."""
    t = times - times[0]
    d = states[:, None, :2] + t[:, None] * states[:, None, 2:] - path
    g = np.stack([d[..., 1], -d[..., 0]], axis=-1) / ((d**2).sum(-1) * SIGMA)[..., None]
    h = np.concatenate([g, t[:, None] * g], axis=-1)
    matrix = h.transpose(0, 2, 1) @ h
    return matrix, np.linalg.det(matrix)


def stone_soup_samples(times: Any, path: Any, sigma: float) -> Callable[[Any], Iterator[Any]]:
    """Its measurement model, state and whitened row at every sample, for a state of ours."""
    from stonesoup.models.measurement.nonlinear import Cartesian2DToBearing
    from stonesoup.types.state import State, StateVector

    # Its name changed with a version.
    differentiate = getattr(Cartesian2DToBearing, "jacobian", None) or Cartesian2DToBearing.jac
    models = [
        Cartesian2DToBearing(
            ndim_state=4,
            mapping=(0, 2),
            noise_covar=np.array([[sigma**2]]),
            translation_offset=np.array([[place[0]], [place[1]]]),
        )
        for place in path
    ]

    def samples(x: Any) -> Iterator[Any]:
        for t, model in zip(times - times[0], models, strict=True):
            at = State(StateVector([x[0] + t * x[2], x[2], x[1] + t * x[3], x[3]]))
            # Its bearings are from the x axis, anticlockwise.
            d = -np.asarray(differentiate(model, at), dtype=float)[0] / sigma
            yield model, at, [d[0], d[2], t * d[0], t * d[2]]

    return samples


def stone_soup(data: Any) -> Callable[[], Any]:
    """Its Jacobian at every sample, as its own metrics do."""
    times, path, states = data
    samples = stone_soup_samples(times, path, SIGMA)

    def work() -> Any:
        rows = np.array([[row for *_, row in samples(x)] for x in states[:2]])
        out = rows.transpose(0, 2, 1) @ rows
        return out, np.linalg.det(out)

    return work


def pybounds_simulator(dt: float) -> Any:
    import jax.numpy as jnp
    from pybounds import JaxSimulator

    return JaxSimulator(
        lambda x, u: jnp.array([x[2], x[3], 0.0, 0.0]),
        lambda x, u: jnp.array([jnp.arctan2(x[0] - u[0], x[1] - u[1])]),
        dt,
        ["x", "y", "vx", "vy"],
        ["ox", "oy"],
        ["bearing"],
    )


def pybounds_once(data: Any) -> Callable[[], Any]:
    """One call for one track, as its users make it: it compiles anew."""
    from pybounds import JaxEmpiricalObservabilityMatrix

    times, path, states = data
    simulator = pybounds_simulator(times[1] - times[0])

    def work() -> Any:
        found = JaxEmpiricalObservabilityMatrix(simulator, states[0], path).O / SIGMA
        matrix = (found.T @ found)[None]
        return matrix, np.linalg.det(matrix)

    return work


def pybounds_windows(data: Any) -> Callable[[], Any]:
    """Its sliding windows along one long track: one call, a window a trial."""
    from pybounds import JaxSlidingEmpiricalObservabilityMatrix

    times, path, states = data
    m, count, dt = len(times), 200, times[1] - times[0]
    simulator = pybounds_simulator(dt)
    t = dt * np.arange(m + count - 1)
    step = path[-1] - path[-2]
    whole = np.vstack([path, path[-1] + step * np.arange(1, count)[:, None]])
    x = states[0] + t[:, None] * np.concatenate([states[0, 2:], [0, 0]])

    def work() -> Any:
        made = JaxSlidingEmpiricalObservabilityMatrix(simulator, t, x, whole, w=m)
        rows = np.array(made.O_sliding) / SIGMA
        matrix = rows.transpose(0, 2, 1) @ rows
        return matrix[:1], np.linalg.det(matrix)[:1]

    return work


@cache
def fisher_cases() -> dict[str, Case]:
    """Turns of a right angle and of one degree."""
    cases = {}
    for name, turn in (("well", 90.0), ("ill", 1.0)):
        data = tracks(3, 60, turn)
        wanted = exact.lazily(
            lambda data=data: [
                exact.det(exact.gram(exact.sight_rows(data[1], x, SIGMA, data[0]))) for x in data[2]
            ]
        )
        cases[name] = Case(data, lambda found, wanted=wanted: exact.largest(found[1], wanted()))
    return cases


def fisher_by_c(data: Any) -> Callable[[], Any]:
    kernel = c_function("bearings.c", "track_fisher", *FAST)
    times, path, states = data

    def work() -> Any:
        matrix, det = np.empty((len(states), 4, 4)), np.empty(len(states))
        kernel(times, path, states, SIGMA, len(states), len(times), matrix, det)
        return matrix, det

    return work


def fisher_contest(trials: int, m: int, *, peers: bool, series: str = "") -> Contest:
    """The matrix and its determinant, as everybody takes it; ours has a better one too."""
    sight = gm.maneuver

    def rooted(data: Any) -> Callable[[], Any]:
        times, path, states = data

        def work() -> Any:
            matrix = sight.fisher(path, states, SIGMA, times)
            return matrix, sight.fisher_det(path, states, SIGMA, times)

        return work

    def ours(data: Any) -> Callable[[], Any]:
        times, path, states = data

        def work() -> Any:
            return sight.fisher_and_det(path, states, SIGMA, times)

        return work

    contestants = [
        Contestant(OURS, ours),
        Contestant("C, nine sums", fisher_by_c),
        Contestant("numpy", lambda data: lambda: sighted(*data)),
    ]
    if peers:
        contestants[1:1] = [
            Contestant("gramian, all threads", ours, threads=ALL),
            Contestant(
                "gramian, the determinant from a factor of the rows",
                rooted,
                limit=Limit(
                    {"fma": 40.0 * m + 20.0 * m, "divide": 14.0 * m, "root": 4.0 * m},
                    "the matrix, and each row rotated into a triangle",
                ),
            ),
        ]
        contestants += [
            Contestant("Stone Soup, Jacobian at each sample", stone_soup, part=2.0),
            Contestant("pybounds, sliding windows (JAX)", pybounds_windows, part=200.0),
            Contestant("pybounds, one call", pybounds_once, part=1.0),
        ]
    return Contest(
        f"bearings Fisher information and det of moving targets, {trials} x {m}",
        "trial",
        float(trials),
        tracks(trials, m, 90.0),
        contestants,
        limit=Limit(
            {"fma": 17.0 * m, "divide": m, reading(256.0 * trials): 256.0},
            "17 multiply-adds and a division for each bearing",
        ),
        cases=fisher_cases(),
        size=float(trials if series == "trials" else m),
        series=series and f"bearings Fisher against {series}",
        note="The error is that of the determinant.",
    )


# --- rows, the results that take the most memory ------------------------------------------


def rows_contest(trials: int, m: int) -> Contest:
    """Rows in a new array, which as a rule gets the memory of the one before; in one that is
    there; and in pages that the system has to map, as where results are kept."""

    def ours(data: Any) -> Callable[[], Any]:
        times, path, states = data
        return lambda: B.rows(times, path, states, SIGMA)

    def into(data: Any) -> Callable[[], Any]:
        times, path, states = data
        out = B.rows(times, path, states, SIGMA).copy()
        return lambda: B.rows(times, path, states, SIGMA, out=out)

    def mapped(data: Any) -> Callable[[], Any]:
        times, path, states = data
        shape = (len(states), len(times), 4)

        def work() -> Any:
            pages = mmap.mmap(-1, 8 * math.prod(shape))
            out = np.frombuffer(pages).reshape(shape)
            return B.rows(times, path, states, SIGMA, out=out)

        return work

    def by_numpy(data: Any) -> Callable[[], Any]:
        times, path, states = data

        def work() -> Any:
            since = (times - times[0])[:, None]
            gap = states[:, None, :2] + since * states[:, None, 2:] - path
            seen = gap[..., ::-1] * [1, -1] / ((gap**2).sum(axis=-1) * SIGMA)[..., None]
            return np.concatenate([seen, since * seen], axis=-1)

        return work

    def case(turn_deg: float) -> Case:
        data = tracks(2, m, turn_deg)
        times, path, states = data
        wanted = exact.lazily(
            lambda: np.array([exact.sight_rows(path, x, SIGMA, times) for x in states], float)
        )

        def error(found: Any) -> float:
            size = np.abs(wanted()).max(axis=1, keepdims=True)
            return float((np.abs(found - wanted()) / size).max())

        return Case(data, error)

    return Contest(
        f"bearings rows of moving targets, {trials} x {m}",
        "trial",
        float(trials),
        tracks(trials, m, 90.0),
        [
            Contestant(OURS, ours),
            Contestant("gramian, out=", into),
            Contestant("gramian, in pages mapped anew", mapped),
            Contestant("gramian, out=, all threads", into, threads=ALL),
            Contestant("numpy", by_numpy),
        ],
        limit=Limit(
            {"divide": m, "fma": 8.0 * m, reading(32.0 * m * trials): 32.0 * m},
            "a division and 8 multiply-adds for each bearing, 32 bytes of it written",
        ),
        cases={"well": case(90.0)},
        note="Error of an entry over the largest of its column.",
    )


# --- the test on noise ----------------------------------------------------------------


def test_contest(trials: int, m: int) -> Contest:
    sigma = np.radians(0.5)

    def noisy(trials: int, sigma: float, seed: int) -> Any:
        times, bearings = track(m, 0.0)
        return times, bearings + sigma * np.random.default_rng(seed).normal(size=(trials, m)), sigma

    def least_squares(data: Any, few: int) -> Callable[[], Any]:
        from scipy import optimize, stats

        times, bearings, sigma = data
        t = times / times[-1]

        def work() -> Any:
            found = []
            for b in bearings[:few]:
                fit = optimize.least_squares(
                    lambda c, b=b: (b - np.arctan2(c[0] + c[1] * t, 1 + c[2] * t)) / sigma,
                    [np.tan(b[0]), 0.0, 0.0],
                    xtol=1e-14,
                    ftol=1e-14,
                    gtol=1e-14,
                )
                found.append(stats.chi2.sf(2 * fit.cost, m - 3))
            return np.array(found)

        return work

    def case(sigma: float) -> Case:
        data = noisy(5, sigma, 5)
        wanted = exact.lazily(lambda: [closest_p(data[0], b, sigma) for b in data[1]])
        return Case(data, lambda found: exact.largest(found, wanted()))

    return Contest(
        f"observability_test, {trials} x {m}",
        "test",
        float(trials),
        noisy(trials, float(sigma), 4),
        [
            Contestant(OURS, lambda data: lambda: B.observability_test(*data).p_value),
            Contestant(
                "gramian, all threads",
                lambda data: lambda: B.observability_test(*data).p_value,
                threads=ALL,
            ),
            Contestant("SciPy least_squares", lambda data: least_squares(data, 5), part=5.0),
        ],
        limit=Limit(
            {"sincos": m, "fma": 12.0 * m + 4 * 45 * m, "divide": 4 * 2.0 * m},
            "a sine, a cosine and 12 sums of each bearing, then 4 steps of an arc tangent and the "
            "sums (45 multiply-adds, 2 divisions)",
        ),
        cases={"well": case(float(sigma)), "ill": case(float(np.radians(5.0)))},
        target="5 us a test",
        note="Well: bearings of 0.5 deg; ill: of 5 deg.",
    )


def closest_p(times: Any, bearings: Any, sigma: float) -> Any:
    """The probability with 30 digits: Gauss-Newton on the fit, from SciPy's answer."""
    import mpmath as mp
    from scipy import optimize

    with mp.workdps(30):
        t = [mp.mpf(float(x)) / mp.mpf(float(times[-1])) for x in times]
        b = [mp.mpf(float(x)) for x in bearings]
        scaled = times / times[-1]
        near = optimize.least_squares(
            lambda c: bearings - np.arctan2(c[0] + c[1] * scaled, 1 + c[2] * scaled),
            [np.tan(bearings[0]), 0.0, 0.0],
        )
        c = mp.matrix(near.x.tolist())
        for _ in range(60):
            normal, right, chi2 = mp.zeros(3), mp.zeros(3, 1), mp.mpf(0)
            for x, z in zip(t, b, strict=True):
                y, w = c[0] + c[1] * x, 1 + c[2] * x
                left, r2 = z - mp.atan2(y, w), y * y + w * w
                row = [w / r2, x * w / r2, -x * y / r2]
                chi2 += left * left
                for i in range(3):
                    right[i] += row[i] * left
                    for j in range(3):
                        normal[i, j] += row[i] * row[j]
            step = mp.lu_solve(normal, right)
            c += step
            if mp.norm(step) < mp.mpf(10) ** -14:
                break
        return mp.gammainc(
            mp.mpf(len(b) - 3) / 2, chi2 / (2 * mp.mpf(sigma) ** 2), regularized=True
        )


def contests(quick: bool) -> Iterator[Contest]:
    """Yield the contests of bearings."""
    for m in (32, 128, 256) if quick else (32, 64, 128, 256, 400, 512):
        yield sum_contest(m)
    yield gram_contest(10_000, 100)
    yield fisher_contest(2000, 100, peers=True)
    yield rows_contest(10_000, 60)
    yield from grown(gram_contest, quick=quick)
    yield from grown(fisher_contest, quick=quick)
    yield test_contest(5_000, 60)


if __name__ == "__main__":
    main(contests)
