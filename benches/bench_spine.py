"""The spine: Gram matrices and bounds of plain rows, conversion at the boundary, import."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import exact
import numpy as np
from harness import ALL, FAST, OURS, Case, Contest, Contestant, c_function, grown, main
from limits import Limit, reading

import gramian as gm


def rows_of(trials: int, samples: int, spread: float = 0.0) -> Any:
    """Rows of four; `spread` decades between the units of the states."""
    units = 10.0 ** np.linspace(0, spread, 4)
    return np.random.default_rng(1).normal(size=(trials, samples, 4)) * units


@cache
def numba_gram() -> Callable[..., Any]:
    import numba

    @numba.njit(fastmath=True)
    def kernel(rows: Any) -> Any:
        out = np.zeros((rows.shape[0], 4, 4))
        for b in range(rows.shape[0]):
            for k in range(rows.shape[1]):
                for i in range(4):
                    for j in range(4):
                        out[b, i, j] += rows[b, k, i] * rows[b, k, j]
        return out

    return kernel


def gram_by_numba(data: Any) -> Callable[[], Any]:
    kernel = numba_gram()
    return lambda: kernel(data)


def gram_by_c(data: Any) -> Callable[[], Any]:
    kernel = c_function("linear.c", "gram4", *FAST)

    def work() -> Any:
        out = np.empty((len(data), 4, 4))
        kernel(data, len(data), data.shape[1], out)
        return out

    return work


@cache
def gram_cases() -> dict[str, Case]:
    """States in like units, and in units twelve decades apart."""
    cases = {}
    for name, spread in (("well", 0.0), ("ill", 12.0)):
        data = rows_of(2, 60, spread)
        wanted = exact.lazily(
            lambda data=data: np.array([exact.numbers(exact.gram(rows)) for rows in data])
        )
        cases[name] = Case(data, lambda found, wanted=wanted: exact.entries(found, wanted()))
    return cases


def gram_contest(trials: int, samples: int, *, peers: bool, series: str = "") -> Contest:
    """Gram matrices of (trials, samples, 4) rows."""

    def ours(data: Any) -> Callable[[], Any]:
        return lambda: gm.gram(data)

    def single(data: Any) -> Callable[[], Any]:
        rows = data.astype(np.float32)
        return lambda: gm.gram(rows)

    moved, half = samples * 32.0 + 256, samples * 16.0 + 128
    contestants = [
        Contestant(OURS, ours),
        Contestant(
            "gramian, float32",
            single,
            limit=Limit(
                {reading(half * trials): half, "fma": samples * 5.0},
                "16 bytes of each row read, the result fetched and written; twice the lanes",
            ),
        ),
        Contestant("C", gram_by_c),
        Contestant("numpy matmul", lambda data: lambda: data.transpose(0, 2, 1) @ data),
    ]
    if peers:
        contestants[1:1] = [Contestant("gramian, all threads", ours, threads=ALL)]
        contestants += [
            Contestant("numpy einsum", lambda data: lambda: np.einsum("bki,bkj->bij", data, data)),
            Contestant("numba", gram_by_numba),
        ]
    return Contest(
        f"gram of rows, {trials} x {samples} x 4",
        "trial",
        float(trials),
        rows_of(trials, samples),
        contestants,
        limit=Limit(
            {reading(moved * trials): moved, "fma": samples * 10.0},
            "32 bytes of each row read, the result fetched and written; 10 products a row",
        ),
        cases=gram_cases(),
        size=float(trials if series == "trials" else samples),
        series=series and f"Gram of rows against {series}",
        note="Error of an entry over the roots of its diagonal entries; ill: units of states 12 "
        "decades apart.",
    )


def plain(a: Any) -> Any:
    return np.sqrt(np.diagonal(np.linalg.inv(a.transpose(0, 2, 1) @ a), axis1=1, axis2=2))


def by_qr(a: Any) -> Any:
    inverse = np.linalg.inv(np.linalg.qr(a, mode="r"))
    return np.sqrt((inverse**2).sum(axis=2))


def bound_contest(trials: int) -> Contest:
    """Bounds of (trials, 60, 4) rows by orthogonal factorisation, beside a plain inverse."""
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(trials, 60, 4)) * [1e-3, 1e-3, 1.0, 1.0]
    ill = rng.normal(size=(1, 60, 4))
    ill[..., 3] = ill[..., 2] + 1e-7 * ill[..., 3]

    def ours(data: Any) -> Callable[[], Any]:
        return lambda: gm.crlb_std(data)

    def case(a: Any) -> Case:
        wanted = exact.lazily(lambda: exact.bounds(exact.gram(a[0])))
        return Case(a, lambda found: float(np.abs(found[0] / wanted() - 1).max()))

    return Contest(
        f"bounds of rows, {trials} x 60 x 4",
        "trial",
        float(trials),
        rows,
        [
            Contestant(OURS, ours),
            Contestant("gramian, all threads", ours, threads=ALL),
            Contestant("numpy inverse", lambda data: lambda: plain(data)),
            Contestant("numpy QR", lambda data: lambda: by_qr(data)),
        ],
        limit=Limit(
            {"fma": 60 * 27 + 40.0, "divide": 64.0, "root": 4.0},
            "60 rows orthogonalised, 27 multiply-adds a row, 1 division; the triangular inverse",
        ),
        cases={"well": case(rows[:1]), "ill": case(ill)},
        note="Ill: two states that differ in the seventh digit alone. Ours decides the rank too.",
    )


def conversion_contest() -> Contest:
    """The same Gram call on what needs no copy, and on what needs one."""

    def on(change: Callable[[Any], Any], call: Callable[[Any], Any]) -> Any:
        def prepare(rows: Any) -> Callable[[], Any]:
            changed = change(rows)
            return lambda: call(changed)

        return prepare

    def copied(given: Any) -> Any:
        return gm.gram(np.array(given, dtype=float, order="C"))

    changes: dict[str, Callable[[Any], Any]] = {
        "float32": lambda rows: rows.astype(np.float32),
        "column-major": np.asfortranarray,
        "every other row": lambda rows: np.repeat(rows, 2, axis=1)[:, ::2],
        "lists": lambda rows: rows[:100].tolist(),
    }
    contestants = [Contestant(OURS, on(lambda rows: rows, gm.gram))]
    for name, change in changes.items():
        part = 100.0 if name == "lists" else None
        contestants += [
            Contestant(f"gramian, {name} given", on(change, gm.gram), part=part),
            Contestant(f"numpy converts {name}, then gramian", on(change, copied), part=part),
        ]
    return Contest(
        "conversion at the boundary: gram of 2000 x 100 x 4",
        "trial",
        2000.0,
        rows_of(2000, 100),
        contestants,
        cases=gram_cases(),
        target="at most one copy: no more than numpy's copy and the call on it",
        note="float32 given has its own seven digits; ill: units of states 12 decades apart.",
    )


def import_contest() -> Contest:
    """A fresh interpreter that imports the package, beside one that imports numpy."""

    def start(code: str) -> Callable[[Any], Callable[[], Any]]:
        return lambda _: lambda: subprocess.run([sys.executable, "-c", code], check=True)

    return Contest(
        "import, whole process",
        "import",
        1.0,
        None,
        [
            Contestant(OURS, start("import gramian")),
            Contestant("nothing but numpy", start("import numpy")),
            Contestant("nothing", start("pass")),
        ],
        target="under 0.25 s, matplotlib not loaded",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    yield gram_contest(10_000, 100, peers=True)
    yield from grown(gram_contest, quick=quick)
    yield bound_contest(2000)
    yield conversion_contest()
    yield import_contest()


if __name__ == "__main__":
    main(contests)
