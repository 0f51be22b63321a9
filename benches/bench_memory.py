"""Memory at the peak of one call, beyond what is there before it: each in a fresh process."""

from __future__ import annotations

import ctypes
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from harness import HERE, OURS, Footprint, main

import gramian as gm

Work = Callable[[int], Callable[[], Any]]
MIB = 2**20


def status(key: str) -> int:
    """Return a number of bytes that the kernel keeps on this process."""
    with open("/proc/self/status") as lines:
        return next(1024 * int(line.split()[1]) for line in lines if line.startswith(key))


def peak(make: Work, trials: int) -> int:
    """Return the bytes that a call takes at its peak; a small call goes before it."""
    make(10)()
    call = make(trials)
    ctypes.CDLL(None).malloc_trim(0)
    with open("/proc/self/clear_refs", "w") as control:
        control.write("5")  # the peak starts anew
    before = status("VmRSS")
    kept = call()
    after = status("VmHWM")
    del kept
    return max(0, after - before)


def rows(trials: int) -> Any:
    return np.random.default_rng(1).normal(size=(trials, 100, 4))


def gram_of(change: Callable[[Any], Any]) -> Work:
    def make(trials: int) -> Callable[[], Any]:
        given = change(rows(trials))
        return lambda: gm.gram(given)

    return make


def numpy_copy(trials: int) -> Callable[[], Any]:
    given = rows(trials).tolist()
    return lambda: np.array(given)


def every_other(given: Any) -> Any:
    return np.repeat(given, 2, axis=1)[:, ::2]


def bearings(trials: int) -> Any:
    return 10.0 * np.arange(100), np.random.default_rng(3).uniform(-3, 3, (trials, 100))


def of_bearings(name: str) -> Work:
    def make(trials: int) -> Callable[[], Any]:
        import bench_bearings as b

        data = bearings(trials)
        by = {
            OURS: lambda data: lambda: gm.bearings.gram_det(*data),
            "numpy, six sums": lambda data: lambda: b.six_sums(*data),
            "numpy einsum": lambda data: lambda: b.einsum(*data),
            "numba": b.gram_by_numba,
            "JAX": b.gram_by_jax,
        }
        return by[name](data)

    return make


def of_dipoles(name: str) -> Work:
    def make(trials: int) -> Callable[[], Any]:
        import bench_dipole as d

        data = d.passes(trials, 200)
        by: dict[str, Callable[[Any], Callable[[], Any]]] = {
            OURS: lambda data: lambda: gm.dipole.fisher(*data, d.SIGMA),
            "numba, 42 sums": d.by_numba,
            "numpy, closed form": lambda data: lambda: d.closed_form(np, *data),
            "JAX, closed form": d.by_jax,
            "gramian, rows then Gram": lambda data: lambda: gm.gram(gm.dipole.rows(*data, d.SIGMA)),
        }
        return by[name](data)

    return make


def monte_carlo(trials: int) -> Callable[[], Any]:
    import bench_monte_carlo as m

    scene = m.bearings_scene(m.TRACK.sigma)
    return lambda: m.run((scene, trials))


#: Title: trials, what is given (MiB) and the works by name.
WORKS: dict[str, tuple[int, float, dict[str, Work]]] = {
    "conversion at the boundary: gram of 20000 x 100 x 4": (
        20_000,
        20_000 * 3200 / MIB,
        {
            OURS: gram_of(lambda given: given),
            "gramian, float32 given": gram_of(lambda given: given.astype(np.float32)),
            "gramian, column-major given": gram_of(np.asfortranarray),
            "gramian, every other row given": gram_of(every_other),
            "gramian, lists given": gram_of(lambda given: given.tolist()),
            "numpy, a copy of the lists": numpy_copy,
        },
    ),
    "bearings Gram and det, 50000 x 100": (
        50_000,
        50_000 * 800 / MIB,
        {
            name: of_bearings(name)
            for name in (OURS, "numba", "numpy, six sums", "numpy einsum", "JAX")
        },
    ),
    "dipole Fisher information, 2000 x 200": (
        2000,
        0.1,
        {
            name: of_dipoles(name)
            for name in (
                OURS,
                "numba, 42 sums",
                "gramian, rows then Gram",
                "numpy, closed form",
                "JAX, closed form",
            )
        },
    ),
    "Monte Carlo of bearings maximum likelihood, 100000 trials": (
        100_000,
        0.0,
        {OURS: monte_carlo},
    ),
}


def contests(quick: bool) -> Iterator[Footprint]:
    """Yield what is to be measured."""
    for title, (trials, given, works) in WORKS.items():
        yield Footprint(
            title,
            list(works),
            lambda name, title=title: measured(title, name),  # type: ignore[misc]
            note=f"Given: {given:.1f} MiB in {trials} trials, result kept." if given else "",
            target="at most one copy of what is given" if "conversion" in title else "",
        )


def measured(title: str, name: str) -> float:
    """Return the peak in bytes of a fresh process."""
    command = [sys.executable, "-W", "ignore", __file__, "--one", title, name]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=HERE)
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[-1])
    return float(done.stdout.split()[-1])


def one(title: str, name: str) -> None:
    trials, _, works = WORKS[title]
    gm.set_threads(1)
    print(peak(works[name], trials))


if __name__ == "__main__":
    if "--one" in sys.argv:
        one(*sys.argv[-2:])
    else:
        main(contests)
