"""Dipole passes: Fisher information of many, and locating one beside a genetic search."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from harness import OURS, Contest, Contestant, Limit, c_library, main, pointer

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


def by_numba(r0: Any, v: Any, m: Any, times: Any) -> Callable[[], Any]:
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

    return lambda: kernel(r0, v, m, times, 1 / SIGMA**2)


def by_jax(r0: Any, v: Any, m: Any, times: Any) -> Callable[[], Any]:
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp

    inputs = [jnp.asarray(x) for x in (r0, v, m, times)]
    compiled = jax.jit(lambda *given: closed_form(jnp, *given))
    return lambda: compiled(*inputs).block_until_ready()


def by_c(r0: Any, v: Any, m: Any, times: Any) -> Callable[[], Any]:
    library = c_library("dipole.c", "-ffast-math", "-fopenmp-simd")
    size = ctypes.c_size_t

    def work() -> Any:
        out = np.empty((len(r0), 9, 9))
        library.dipole_fisher(
            *(pointer(x) for x in (r0, v, m, times)),
            ctypes.c_double(SIGMA),
            size(len(r0)),
            size(len(times)),
            pointer(out),
        )
        return out

    return work


def fisher_contest(trials: int, samples: int, *, peers: bool) -> Contest:
    given = passes(trials, samples)
    # Sums of long doubles over few trials: a reference that shares no code.
    few = [x[:20].astype(np.longdouble) for x in given[:3]] + [given[3].astype(np.longdouble)]
    exact = closed_form(np, *few)
    size = np.sqrt(np.einsum("tii,tjj->tij", exact, exact))
    contestants = [Contestant(OURS, lambda: lambda: gm.dipole.fisher(*given, SIGMA))]
    if peers:
        part = max(1, trials // 10)
        less = (*(x[:part] for x in given[:3]), given[3])
        contestants += [
            Contestant("C, 42 sums", lambda: by_c(*given)),
            Contestant("numba, 42 sums", lambda: by_numba(*given)),
            Contestant("jax, closed form", lambda: by_jax(*given)),
            Contestant("numpy, closed form", lambda: lambda: closed_form(np, *less), work=part),
            Contestant(
                "rows, then gram",
                lambda: lambda: gm.gram(gm.dipole.rows(*less, SIGMA)),
                work=part,
            ),
        ]
    return Contest(
        f"Fisher information of dipole passes, {trials} x {samples}",
        "trial",
        trials,
        contestants,
        limit=Limit("fma", 17 * samples + 500, "17 a sample (one a division), 500 a trial"),
        error=lambda found: float(np.abs((np.asarray(found)[:20] - exact) / size).max()),
        size=samples,
        series="dipole Fisher information against samples",
        target="at most 0.75 us; numpy 80, numba 10, jax 45, C 1.3 times"
        if (trials, samples) == (2000, 200)
        else "",
    )


def localize_contest() -> Contest:
    """Table 1 of Dai et al. 2020 without noise, z0 and vz known."""
    times = np.arange(21.0)
    true = np.array([-10.0, -10.0, 5.0, 1.0, 1.0, 0.0, 10.0, 20.0, 10.0])
    field = gm.dipole.measure(true[:3], true[3:6], true[6:], times)
    free = [0, 1, 3, 4, 6, 7, 8]
    total = (field**2).sum()

    def ours() -> Any:
        found = gm.dipole.localize(times, field, {"z": 5.0, "vz": 0.0})
        return np.concatenate([found.r0, found.v, found.m])

    def evolution() -> Callable[[], Any]:
        from scipy.optimize import differential_evolution

        def cost(x: Any) -> Any:
            states = np.tile(true, (x.shape[1], 1))
            states[:, free] = x.T
            made = gm.dipole.measure(states[:, :3], states[:, 3:6], states[:, 6:], times)
            return ((made - field) ** 2).sum(axis=(1, 2)) / total

        box = [(-50, 50)] * 2 + [(-5, 5)] * 2 + [(-100, 100)] * 3

        def work() -> Any:
            result = differential_evolution(
                cost, box, maxiter=200, tol=0, seed=1, polish=False, vectorized=True,
                updating="deferred",
            )  # fmt: skip
            state = true.copy()
            state[free] = result.x
            return state

        return work

    return Contest(
        "locating the pass of Table 1, noise-free",
        "pass",
        1,
        [
            Contestant(OURS, lambda: ours),
            Contestant("differential evolution (SciPy), 200 generations", evolution),
        ],
        error=lambda x: float(np.abs((x - true)[free] / true[free]).max()),
        target="under 50 ms, relative error under 1e-8",
    )


def field_contest() -> Contest:
    """Fields of single dipoles beside magpylib's."""
    rng = np.random.default_rng(5)
    r, m = rng.normal(size=(100_000, 3)), rng.normal(size=(100_000, 3))

    def magpylib() -> Callable[[], Any]:
        from magpylib.core import dipole_Hfield

        mu0 = gm.dipole.MU0
        return lambda: mu0 * dipole_Hfield(observers=r, moments=m)

    exact = gm.dipole.field(r.astype(float), m)
    size = np.linalg.norm(exact, axis=1, keepdims=True)
    return Contest(
        "field of a dipole, 100000 places",
        "place",
        len(r),
        [
            Contestant(OURS, lambda: lambda: gm.dipole.field(r, m)),
            Contestant("magpylib", magpylib),
        ],
        error=lambda found: float(np.abs((found - exact) / size).max()),
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    yield fisher_contest(2000, 200, peers=True)
    for samples in (20, 2000) if not quick else ():
        yield fisher_contest(2000, samples, peers=False)
    yield localize_contest()
    yield field_contest()


if __name__ == "__main__":
    main(contests)
