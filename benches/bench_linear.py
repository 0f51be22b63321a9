"""Levels and observability matrices of many linear systems, beside numpy and python-control."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import exact
import numpy as np
from harness import ALL, FAST, OURS, Case, Contest, Contestant, c_function, main, sizes
from limits import Limit, reading

import gramian as gm

STATES, OUTPUTS = 15, 3
# python-control takes one system at a time: a part of the batch is enough.
PART = 200


def systems(count: int, states: int = STATES, spread: float = 0.0) -> tuple[Any, Any]:
    """Random systems, dense, of full rank; `spread` decades between the units of states."""
    rng = np.random.default_rng(5)
    a = rng.normal(size=(count, states, states)) / np.sqrt(states)
    unit = 10.0 ** np.linspace(0, spread, states)
    a, c = a * unit[:, None] / unit, rng.normal(size=(count, OUTPUTS, states)) / unit
    return np.ascontiguousarray(a), np.ascontiguousarray(c)


def stacked(a: Any, c: Any) -> Any:
    """The observability matrices by numpy's batched products."""
    blocks = [c]
    for _ in range(a.shape[-1] - 1):
        blocks.append(blocks[-1] @ a)
    return np.concatenate(blocks, axis=-2)


@cache
def numba_matrix() -> Callable[..., Any]:
    import numba

    @numba.njit(fastmath=True)
    def kernel(a: Any, c: Any) -> Any:
        count, n, p = a.shape[0], a.shape[1], c.shape[1]
        out = np.zeros((count, n * p, n))
        for s in range(count):
            out[s, :p] = c[s]
            for i in range(p, n * p):
                for k in range(n):
                    for j in range(n):
                        out[s, i, j] += out[s, i - p, k] * a[s, k, j]
        return out

    return kernel


@cache
def numba_rank() -> Callable[..., Any]:
    import numba

    matrix = numba_matrix()

    @numba.njit
    def kernel(a: Any, c: Any) -> Any:
        all_of = matrix(a, c)
        out = np.empty(len(a))
        for s in range(len(a)):
            values = np.linalg.svd(all_of[s])[1]
            out[s] = (values > values[0] * all_of.shape[1] * 2.2e-16).sum()
        return out

    return kernel


def by_c(data: Any) -> Callable[[], Any]:
    kernel = c_function("linear.c", "observability_matrix", *FAST)
    a, c = data

    def work() -> Any:
        out = np.empty((len(a), a.shape[1] * OUTPUTS, a.shape[1]))
        kernel(a, c, len(a), a.shape[1], OUTPUTS, out)
        return out

    return work


def levels_by_c(data: Any) -> Callable[[], Any]:
    kernel = c_function("linear.c", "levels")
    a, c = data

    def work() -> Any:
        rank, level = np.empty(len(a)), np.empty(a.shape[:2])
        kernel(a, c, len(a), a.shape[1], OUTPUTS, a.shape[1] * 2.0**-52, rank, level)
        return rank

    return work


def by_control(data: Any, *, rank: bool) -> Callable[[], Any]:
    from control import obsv

    systems = list(zip(*data, strict=True))[:PART]
    if rank:
        return lambda: np.array([np.linalg.matrix_rank(obsv(a, c)) for a, c in systems])
    return lambda: np.array([obsv(a, c) for a, c in systems])


@cache
def matrix_cases() -> dict[str, Case]:
    """States in like units, and in units twelve decades apart."""
    made = {}
    for name, spread in (("well", 0.0), ("ill", 12.0)):
        data = systems(1, STATES, spread)

        def make(data: Any = data) -> Any:
            import mpmath as mp

            with mp.workdps(exact.DIGITS):
                a, block = mp.matrix(data[0][0].tolist()), mp.matrix(data[1][0].tolist())
                blocks = []
                for _ in range(STATES):
                    blocks.append(exact.numbers(block))
                    block = block * a
                return np.concatenate(blocks)

        wanted = exact.lazily(make)

        def error(found: Any, wanted: Any = wanted) -> float:
            # Over the largest of its column: the unit of the state.
            scale = np.abs(wanted()).max(axis=0)
            return float((np.abs(found[0] - wanted()) / scale).max())

        made[name] = Case(data, error)
    return made


@cache
def rank_cases() -> dict[str, Case]:
    """The share of wrong ranks: of systems in like units, and of those 12 decades apart."""
    return {
        name: Case(
            systems(20, STATES, spread), lambda found: float((np.asarray(found) != STATES).mean())
        )
        for name, spread in (("well", 0.0), ("ill", 12.0))
    }


def matrix_contest(count: int, states: int = STATES, *, peers: bool, series: str = "") -> Contest:
    """[C; CA; ..; CA^(n-1)] of each system."""

    def ours(data: Any) -> Callable[[], Any]:
        return lambda: gm.linear.observability_matrix(*data)

    contestants = [
        Contestant(OURS, ours),
        Contestant("C, plain loops", by_c),
        Contestant("numpy, batched", lambda data: lambda: stacked(*data)),
    ]
    if peers:

        def numba(data: Any) -> Callable[[], Any]:
            kernel = numba_matrix()
            return lambda: kernel(*data)

        contestants[1:1] = [Contestant("gramian, all threads", ours, threads=ALL)]
        contestants += [
            Contestant("numba", numba),
            Contestant("python-control", lambda data: by_control(data, rank=False), part=PART),
        ]
    size = OUTPUTS * states * states
    moved = 8.0 * (2 * size + states * (states + OUTPUTS))
    return Contest(
        f"observability_matrix, {count} systems of {states} states, {OUTPUTS} outputs",
        "system",
        float(count),
        systems(count, states),
        contestants,
        limit=Limit(
            {
                "fma": (states - 1.0) * size,
                reading(moved * count): moved,
            },
            f"{states - 1} products of ({OUTPUTS}, {states}) by ({states}, {states}); each output "
            "fetched and written, each input read",
        ),
        cases=matrix_cases(),
        size=float(states if series == "states" else count),
        series=series and f"observability matrix against {series}",
        target="3 times numpy's batch" if peers else "",
        note="Error over the largest entry of the column; ill: units of states 12 decades apart.",
    )


def levels_contest(count: int) -> Contest:
    """Ranks of all O_k and the level of each state; the peers give one rank of Q."""

    def ours(data: Any) -> Callable[[], Any]:
        return lambda: gm.linear.batch_levels(*data).rank

    def numba(data: Any) -> Callable[[], Any]:
        kernel = numba_rank()
        few = tuple(x[:PART] for x in data)
        return lambda: kernel(*few)

    return Contest(
        f"rank and levels, {count} systems of {STATES} states, {OUTPUTS} outputs",
        "system",
        float(count),
        systems(count),
        [
            Contestant(OURS, ours),
            Contestant("gramian, all threads", ours, threads=ALL),
            Contestant("C, orthogonal directions", levels_by_c),
            Contestant(
                "numpy, batched: Q and its SVD",
                lambda data: lambda: np.linalg.matrix_rank(stacked(*(x[:PART] for x in data))),
                part=PART,
            ),
            Contestant("numba: Q and its SVD", numba, part=PART),
            Contestant(
                "python-control and SVD", lambda data: by_control(data, rank=True), part=PART
            ),
        ],
        limit=Limit(
            {"fma": 4.0 * STATES**3, "divide": 2.0 * STATES, "root": 2.0 * STATES},
            "n directions through A (n^3), each made orthogonal twice to those before (2 n^3), "
            "the levels of the states (n^3)",
        ),
        cases=rank_cases(),
        target="3 times numpy's batch",
        note="The error is the share of systems whose rank is wrong; ill: units of states 12 "
        "decades apart.",
    )


def windows(samples: int) -> int:
    """How many windows are joined: one to double, one more for each other bit that is set."""
    return samples.bit_length() - 1 + samples.bit_count() - 1


def gramian_contest(count: int, samples: int, *, peers: bool) -> Contest:
    """Observability Gramians of a window: two samples joined to one, or summed up."""
    dt = 0.01
    window = dt * samples

    def discrete(count: int, spread: float) -> Any:
        a, c = systems(count, 6, spread)
        return np.eye(6) + dt * a, c

    def ours(data: Any) -> Callable[[], Any]:
        return lambda: gm.linear.gramian(*data, window=window, dt=dt)

    def summed(data: Any) -> Callable[[], Any]:
        a, c = data

        def work() -> Any:
            block, total = c, np.zeros((len(a), 6, 6))
            for _ in range(round(window / dt) + 1):
                total += block.transpose(0, 2, 1) @ block
                block = block @ a
            return total

        return work

    def doubled_by_c(data: Any) -> Callable[[], Any]:
        kernel = c_function("linear.c", "gramians", *FAST)
        a, c = data

        def work() -> Any:
            out = np.empty_like(a)
            kernel(a, c, len(a), a.shape[1], OUTPUTS, samples + 1, out)
            return out

        return work

    def case(spread: float) -> Case:
        data = discrete(1, spread)

        def make() -> Any:
            import mpmath as mp

            with mp.workdps(exact.DIGITS):
                a, block = mp.matrix(data[0][0].tolist()), mp.matrix(data[1][0].tolist())
                total = mp.zeros(6)
                for _ in range(round(window / dt) + 1):
                    total += block.T * block
                    block = block * a
                return exact.numbers(total)[None]

        wanted = exact.lazily(make)
        return Case(data, lambda found: exact.entries(found, wanted()))

    return Contest(
        f"observability Gramians of {samples + 1} samples, {count} systems of 6 states",
        "system",
        float(count),
        discrete(count, 0.0),
        [
            Contestant(OURS, ours),
            *[Contestant("gramian, all threads", ours, threads=ALL)] * peers,
            Contestant("C, windows doubled, eight systems at once", doubled_by_c),
            Contestant("numpy, a sum over the samples", summed),
        ],
        limit=Limit(
            {"fma": (steps := windows(samples + 1)) * 3 * 6.0**3},
            f"{steps} windows joined to longer ones, 3 products of (6, 6) each",
        ),
        size=float(samples),
        series="" if peers else "observability Gramian against samples",
        cases={"well": case(0.0), "ill": case(12.0)},
        note="Error of an entry over the roots of its diagonal entries.",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    count = 1000 if quick else 10_000
    yield levels_contest(count)
    yield matrix_contest(count, peers=True)
    yield gramian_contest(1000, 100, peers=True)
    for samples in sizes("samples", quick=quick):
        yield gramian_contest(100, samples, peers=False)
    for trials in sizes("trials", quick=quick):
        yield matrix_contest(trials, 6, peers=False, series="systems (trials)")
    for states in (4, 8, 16) if quick else (4, 8, 16, 32, 64):
        yield matrix_contest(100, states, peers=False, series="states")


if __name__ == "__main__":
    main(contests)
