"""Dipole passes: Fisher information of many, and locating one beside a genetic search."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import exact
import numpy as np
from harness import ALL, FAST, OURS, Case, Contest, Contestant, c_function, grown, main
from limits import Limit, reading

import gramian as gm

SIGMA = 1e-9


def passes(trials: int, samples: int) -> tuple[Any, ...]:
    """Random passes, none through the sensor."""
    rng = np.random.default_rng(4)
    r0 = rng.normal(size=(trials, 3)) * 10 + [0, 0, 30]
    v, m = rng.normal(size=(trials, 3)), rng.normal(size=(trials, 3)) * 30
    v[:, 2] *= 0.1
    return r0, v, m, np.linspace(0.0, 20.0, samples)


def closed_form(xp: Any, r0: Any, v: Any, m: Any, times: Any) -> Any:
    """The closed form with array operations of numpy or jax.numpy."""
    t = times - times[0]
    r = r0[:, None, :] + t[:, None] * v[:, None, :]
    inverse = 1 / xp.sqrt((r * r).sum(-1))
    n = r * inverse[..., None]
    mk = m[:, None, :]
    s = (n * mk).sum(-1)
    cube = 1e-7 * inverse**3
    quartic = 3 * cube * inverse
    eye = xp.eye(3)
    nn = n[..., :, None] * n[..., None, :]
    nm = n[..., :, None] * mk[..., None, :]
    mm = mk[..., :, None] * mk[..., None, :]
    size = (mk * mk).sum(-1)[..., None, None]
    s_ = s[..., None, None]
    p = (quartic**2)[..., None, None] * (
        s_**2 * eye - 2 * s_ * (nm + xp.swapaxes(nm, -1, -2)) + (size + 5 * s_**2) * nn + mm
    )
    c = (quartic * cube)[..., None, None] * (
        2 * xp.swapaxes(nm, -1, -2) - nm - s_ * eye - 4 * s_ * nn
    )
    d = (cube**2)[..., None, None] * (3 * nn + eye)
    tt = t[:, None, None]
    p0, p1, p2 = p.sum(1), (tt * p).sum(1), (tt * tt * p).sum(1)
    c0, c1, d0 = c.sum(1), (tt * c).sum(1), d.sum(1)
    top = xp.concatenate([p0, p1, c0], -1)
    middle = xp.concatenate([p1, p2, c1], -1)
    bottom = xp.concatenate([xp.swapaxes(c0, -1, -2), xp.swapaxes(c1, -1, -2), d0], -1)
    return xp.concatenate([top, middle, bottom], -2) / SIGMA**2


@cache
def numba_kernel() -> Callable[..., Any]:
    import numba

    @numba.njit(fastmath=True)
    def kernel(r0: Any, v: Any, m: Any, times: Any, weight: float) -> Any:
        trials, samples = r0.shape[0], times.shape[0]
        out = np.zeros((trials, 9, 9))
        n = np.zeros(3)
        p, c, d = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
        for b in range(trials):
            q = m[b]
            size = q[0] * q[0] + q[1] * q[1] + q[2] * q[2]
            for k in range(samples):
                t = times[k] - times[0]
                total = 0.0
                for i in range(3):
                    n[i] = r0[b, i] + t * v[b, i]
                    total += n[i] * n[i]
                inverse = 1 / np.sqrt(total)
                s = 0.0
                for i in range(3):
                    n[i] *= inverse
                    s += n[i] * q[i]
                cube = 1e-7 * inverse * inverse * inverse
                quartic = 3 * cube * inverse
                radial = size + 5 * s * s
                for i in range(3):
                    for j in range(3):
                        one = 1.0 if i == j else 0.0
                        nn = n[i] * n[j]
                        p[i, j] = (
                            quartic
                            * quartic
                            * (
                                s * s * one
                                - 2 * s * (n[i] * q[j] + q[i] * n[j])
                                + radial * nn
                                + q[i] * q[j]
                            )
                        )
                        c[i, j] = (
                            quartic * cube * (2 * q[i] * n[j] - n[i] * q[j] - s * one - 4 * s * nn)
                        )
                        d[i, j] = cube * cube * (3 * nn + one)
                for i in range(3):
                    for j in range(3):
                        out[b, i, j] += p[i, j]
                        out[b, i, 3 + j] += t * p[i, j]
                        out[b, 3 + i, 3 + j] += t * t * p[i, j]
                        out[b, i, 6 + j] += c[i, j]
                        out[b, 3 + i, 6 + j] += t * c[i, j]
                        out[b, 6 + i, 6 + j] += d[i, j]
            for i in range(9):
                for j in range(i, 9):
                    out[b, i, j] *= weight
                    out[b, j, i] = out[b, i, j]
        return out

    return kernel


def by_numba(data: Any) -> Callable[[], Any]:
    kernel = numba_kernel()
    return lambda: kernel(*data, 1 / SIGMA**2)


def by_jax(data: Any) -> Callable[[], Any]:
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp

    inputs = [jnp.asarray(x) for x in data]
    compiled = jax.jit(lambda *given: closed_form(jnp, *given))
    return lambda: compiled(*inputs).block_until_ready()


def by_c(data: Any) -> Callable[[], Any]:
    kernel = c_function("dipole.c", "dipole_fisher", *FAST)

    def work() -> Any:
        out = np.empty((len(data[0]), 9, 9))
        kernel(*data, SIGMA, len(data[0]), len(data[3]), out)
        return out

    return work


def some(data: Any, trials: int) -> Any:
    """The first trials of the data."""
    return (*(x[:trials] for x in data[:3]), data[3])


def differences(field: Callable[[Any, Any, Any, Any], Any], data: Any) -> Any:
    """Fisher information by central differences of a function of (r0, v, m, times)."""
    state = np.concatenate(data[:3], axis=1)
    steps = 1e-5 * np.maximum(1.0, np.abs(state))
    columns = []
    for i in range(9):
        sides = []
        for sign in (1, -1):
            moved = state.copy()
            moved[:, i] += sign * steps[:, i]
            sides.append(field(moved[:, :3], moved[:, 3:6], moved[:, 6:], data[3]))
        columns.append((sides[0] - sides[1]) / (2 * steps[:, i, None, None] * SIGMA))
    rows = np.stack(columns, axis=-1).reshape(len(state), -1, 9)
    return rows.transpose(0, 2, 1) @ rows


def magpylib_functions(data: Any) -> Callable[[], Any]:
    """Its field function, all samples of all trials in one call for each difference."""
    from magpylib.core import dipole_Hfield

    def field(r0: Any, v: Any, m: Any, times: Any) -> Any:
        r = r0[:, None] + (times - times[0])[:, None] * v[:, None]
        moments = np.broadcast_to(m[:, None], r.shape)
        # From the dipole to the sensor; the field is even.
        h = dipole_Hfield(observers=r.reshape(-1, 3), moments=moments.reshape(-1, 3))
        return gm.dipole.MU0 * h.reshape(r.shape)

    few = some(data, FEW)
    return lambda: differences(field, few)


def magpylib_objects(data: Any) -> Callable[[], Any]:
    """Its Dipole and Sensor, a path for each trial and difference."""
    import magpylib

    sensor = magpylib.Sensor()

    def field(r0: Any, v: Any, m: Any, times: Any) -> Any:
        out = []
        for r, w, q in zip(r0, v, m, strict=True):
            path = r + (times - times[0])[:, None] * w
            out.append(sensor.getB(magpylib.misc.Dipole(moment=q, position=path)))
        return np.array(out)

    few = some(data, FEW // 10)
    return lambda: differences(field, few)


FEW = 50  # trials that the slower peers are given


def exact_rows(r0: Any, v: Any, m: Any, times: Any) -> Any:
    """Rows of one pass with 50 digits."""
    import mpmath as mp

    with mp.workdps(exact.DIGITS):
        number = lambda x: [mp.mpf(e) for e in x]  # noqa: E731
        r0, v, m = number(r0), number(v), number(m)
        rows = []
        for time in times:
            t = mp.mpf(float(time)) - mp.mpf(float(times[0]))
            r = [r0[i] + t * v[i] for i in range(3)]
            size = mp.sqrt(sum(x * x for x in r))
            n = [x / size for x in r]
            s = sum(a * b for a, b in zip(n, m, strict=True))
            cube = mp.mpf(10) ** -7 / size**3 / mp.mpf(SIGMA)
            quartic = 3 * cube / size
            for i in range(3):
                one = [int(i == j) for j in range(3)]
                at = [
                    quartic * (s * one[j] + n[i] * m[j] + m[i] * n[j] - 5 * s * n[i] * n[j])
                    for j in range(3)
                ]
                by = [cube * (3 * n[i] * n[j] - one[j]) for j in range(3)]
                rows.append([*at, *(t * x for x in at), *by])
        return rows


@cache
def fisher_cases() -> dict[str, Case]:
    """Random passes, and passes a thousand times nearer than they are long."""
    well = passes(5, 20)
    near = (well[0] * 0, well[1], well[2], well[3])
    near[0][:] = -10.0 * well[1] + 0.01 * np.random.default_rng(6).normal(size=(5, 3))
    cases = {}
    for name, data in (("well", well), ("ill", near)):
        wanted = exact.lazily(
            lambda data=data: np.array(
                [
                    exact.numbers(exact.gram(exact_rows(*one, data[3])))
                    for one in zip(*data[:3], strict=True)
                ]
            )
        )
        cases[name] = Case(data, lambda found, wanted=wanted: exact.entries(found, wanted()))
    return cases


def fisher_contest(trials: int, samples: int, *, peers: bool, series: str = "") -> Contest:
    # The numbers that numpy's arrays hold are a hundred times those of the passes.
    few = max(1, min(trials, 40_000 // samples))

    def ours(data: Any) -> Callable[[], Any]:
        return lambda: gm.dipole.fisher(*data, SIGMA)

    contestants = [
        Contestant(OURS, ours),
        Contestant("C, 42 sums", by_c),
        Contestant(
            "numpy, closed form",
            lambda data: lambda: closed_form(np, *some(data, few)),
            part=float(few),
        ),
    ]
    if peers:
        contestants[1:1] = [Contestant("gramian, all threads", ours, threads=ALL)]
        contestants += [
            Contestant("numba, 42 sums", by_numba),
            Contestant("JAX, closed form", by_jax),
            Contestant(
                "gramian, rows then Gram",
                lambda data: lambda: gm.gram(gm.dipole.rows(*some(data, few), SIGMA)),
                part=float(few),
                limit=Limit(
                    {"fma": (60.0 + 135) * samples, "divide": samples, "root": samples},
                    "60 for three rows, 45 products each",
                ),
            ),
            Contestant("magpylib functions, differences", magpylib_functions, part=FEW),
            Contestant("magpylib objects, differences", magpylib_objects, part=FEW / 10),
        ]
    return Contest(
        f"dipole Fisher information, {trials} x {samples}",
        "trial",
        float(trials),
        passes(trials, samples),
        contestants,
        limit=Limit(
            {"fma": 16.0 * samples + 500, "divide": samples},
            "16 multiply-adds and a division a sample, 500 multiply-adds a trial",
        ),
        cases=fisher_cases(),
        size=float(trials if series == "trials" else samples),
        series=series and f"dipole Fisher against {series}",
        target="at most 0.75 us; numpy 80, numba 10, JAX 45, C 1.3 times" if peers else "",
        note="Error of an entry over the roots of its diagonal entries.",
    )


FREE = [0, 1, 3, 4, 6, 7, 8]  # z0 and vz are known

#: What the search takes on Table 1, by count of its parts.
LOCATE = Limit(
    {
        kind: 21.0 * (500 * shape + 160 * moment + 90 * step)
        for kind, (shape, moment, step) in {
            "fma": (33, 87, 318),
            "divide": (1, 1, 2),
            "root": (1, 1, 2),
        }.items()
    },
    "for each of 21 samples 500 shapes are tried (33 multiply-adds, a division and a root), 160 "
    "moments fitted (87, 1, 1) and 90 steps linearised (318, 2, 2)",
)


def table_1(distance: float) -> Any:
    """The pass of Table 1 of Dai et al. 2020, `distance` times as far away."""
    state = np.array([-10.0, -10.0, 5.0, 1.0, 1.0, 0.0, 10.0, 20.0, 10.0])
    state[:3] *= distance
    return state


def by_scipy(
    times: Any, field: Any, truth: Any, *, near: float = 1.0, tolerance: float = 1e-8
) -> Any:
    """The free states by least_squares, from `near` times the truth."""
    from scipy.optimize import least_squares

    state, size, start = truth.copy(), np.abs(field).max(), near * truth[FREE]

    def residual(x: Any) -> Any:
        state[FREE] = x
        made = gm.dipole.measure(state[:3], state[3:6], state[6:], times)
        return ((made - field) / size).ravel()

    return least_squares(
        residual, start, x_scale=np.abs(start), xtol=tolerance, ftol=tolerance, gtol=tolerance
    ).x


def most_likely(times: Any, field: Any, near: Any) -> Any:
    """The most likely free states with 30 digits: Gauss-Newton from a state near them."""
    import mpmath as mp

    with mp.workdps(30):
        x, count = [mp.mpf(e) for e in near], len(FREE)
        z = [mp.mpf(e) / mp.mpf(SIGMA) for e in np.ravel(field)]
        for _ in range(60):
            normal, right = mp.zeros(count), mp.zeros(count, 1)
            for seen, row in zip(z, exact_rows(x[:3], x[3:6], x[6:], times), strict=True):
                # The field is linear in the moment.
                left = seen - sum(a * b for a, b in zip(row[6:], x[6:], strict=True))
                for i, a in enumerate(FREE):
                    right[i] += row[a] * left
                    for j, b in enumerate(FREE):
                        normal[i, j] += row[a] * row[b]
            step = mp.lu_solve(normal, right)
            for i, a in enumerate(FREE):
                x[a] += step[i]
            if max(abs(step[i] / x[a]) for i, a in enumerate(FREE)) < mp.mpf(10) ** -18:
                break
        return np.array([float(x[a]) for a in FREE])


def localize_contest() -> Contest:
    """Table 1 of Dai et al. 2020 without noise, z0 and vz known."""

    def given(distance: float) -> Any:
        true, times = table_1(distance), np.arange(21.0)
        return times, gm.dipole.measure(true[:3], true[3:6], true[6:], times), true

    def ours(data: Any) -> Callable[[], Any]:
        times, field, true = data

        def work() -> Any:
            found = gm.dipole.localize(times, field, {"z": true[2], "vz": 0.0})
            return np.concatenate([found.r0, found.v, found.m])[FREE]

        return work

    def evolution(data: Any) -> Callable[[], Any]:
        from scipy.optimize import differential_evolution

        times, field, true = data
        total = (field**2).sum()

        def cost(x: Any) -> Any:
            states = np.tile(true, (x.shape[1], 1))
            states[:, FREE] = x.T
            made = gm.dipole.measure(states[:, :3], states[:, 3:6], states[:, 6:], times)
            return ((made - field) ** 2).sum(axis=(1, 2)) / total

        box = [(-50, 50)] * 2 + [(-5, 5)] * 2 + [(-100, 100)] * 3
        return lambda: (
            differential_evolution(
                cost, box, maxiter=200, tol=0, seed=1, polish=False, vectorized=True,
                updating="deferred",
            ).x
        )  # fmt: skip

    def case(distance: float) -> Case:
        data = given(distance)
        return Case(data, lambda x: float(np.abs(x / data[2][FREE] - 1).max()))

    return Contest(
        "locating the pass of Table 1, noise-free",
        "pass",
        1.0,
        given(1.0),
        [
            Contestant(OURS, ours, limit=LOCATE),
            Contestant("differential evolution (SciPy), 200 generations", evolution),
            Contestant(
                "SciPy least_squares, started near the truth",
                lambda data: lambda: by_scipy(*data, near=0.7, tolerance=1e-15),
            ),
        ],
        cases={"well": case(1.0), "ill": case(4.0)},
        target="under 50 ms, relative error under 1e-8",
        note="Ill: four times as far away, the path's length the same.",
    )


def field_contest() -> Contest:
    """Fields of single dipoles beside magpylib's."""

    def places(count: int, scale: float) -> Any:
        rng = np.random.default_rng(5)
        return scale * rng.normal(size=(count, 3)), rng.normal(size=(count, 3))

    def magpylib(data: Any) -> Callable[[], Any]:
        from magpylib.core import dipole_Hfield

        mu0 = gm.dipole.MU0
        return lambda: mu0 * dipole_Hfield(observers=data[0], moments=data[1])

    def case(scale: float) -> Case:
        data = places(20, scale)

        def error(found: Any) -> float:
            wanted = wanted_of()
            size = np.linalg.norm(wanted, axis=1, keepdims=True)
            return float(np.abs((found[:20] - wanted) / size).max())

        def make() -> Any:
            import mpmath as mp

            out = []
            with mp.workdps(exact.DIGITS):
                for r, m in zip(*data, strict=True):
                    at, by = [mp.mpf(x) for x in r], [mp.mpf(x) for x in m]
                    size = mp.sqrt(sum(x * x for x in at))
                    s = sum(a * b for a, b in zip(at, by, strict=True)) / size**2
                    out.append(
                        [
                            float((3 * s * a - b) / size**3 / 10**7)
                            for a, b in zip(at, by, strict=True)
                        ]
                    )
            return np.array(out)

        wanted_of = exact.lazily(make)
        return Case(data, error)

    def ours(data: Any) -> Callable[[], Any]:
        return lambda: gm.dipole.field(*data)

    return Contest(
        "field of a dipole, 100000 places",
        "place",
        1e5,
        places(100_000, 1.0),
        [
            Contestant(OURS, ours),
            Contestant("gramian, all threads", ours, threads=ALL),
            Contestant("magpylib", magpylib),
        ],
        limit=Limit(
            {"fma": 20.0, "divide": 1, "root": 1, reading(72e5): 72},
            "20 multiply-adds, a division, a root; 48 bytes read, 24 written",
        ),
        cases={"well": case(1.0), "ill": case(1e-6)},
        note="Ill: a micrometre away.",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    yield fisher_contest(2000, 200, peers=True)
    yield from grown(fisher_contest, quick=quick)
    yield localize_contest()
    yield field_contest()


if __name__ == "__main__":
    main(contests)
