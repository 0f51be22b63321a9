"""The spine: Gram matrices and bounds of plain rows, import, memory, conversion."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from harness import OURS, Contest, Contestant, Limit, main

import gramian as gm


def gram_contest(trials: int, samples: int, *, peers: bool) -> Contest:
    """Gram matrices of (trials, samples, 4) rows."""
    rows = np.random.default_rng(1).normal(size=(trials, samples, 4))

    def numba() -> Callable[[], Any]:
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

        return lambda: kernel(rows)

    exact = np.einsum("bki,bkj->bij", rows.astype(np.longdouble), rows.astype(np.longdouble))
    contestants = [
        Contestant(OURS, lambda: lambda: gm.gram(rows)),
        Contestant("numpy matmul", lambda: lambda: rows.transpose(0, 2, 1) @ rows),
    ]
    if peers:
        contestants += [
            Contestant("numpy einsum", lambda: lambda: np.einsum("bki,bkj->bij", rows, rows)),
            Contestant("numba", numba),
        ]
    return Contest(
        f"gram of rows, {trials} x {samples} x 4",
        "trial",
        trials,
        contestants,
        limit=Limit("memory", samples * 4 * 8, "each row read once, 32 bytes"),
        error=lambda found: np.abs(
            (found - exact) / np.abs(exact).max(axis=(1, 2), keepdims=True)
        ).max(),
        size=samples,
        series="gram of rows against samples",
    )


def bound_contest(trials: int) -> Contest:
    """Bounds of (trials, 60, 4) rows by orthogonal factorisation, beside a plain inverse."""
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(trials, 60, 4)) * [1e-3, 1e-3, 1.0, 1.0]
    ill = rng.normal(size=(1, 60, 4))
    ill[..., 3] = ill[..., 2] + 1e-7 * ill[..., 3]

    def plain(a: Any) -> Any:
        return np.sqrt(np.diagonal(np.linalg.inv(a.transpose(0, 2, 1) @ a), axis1=1, axis2=2))

    def by_qr(a: Any) -> Any:
        inverse = np.linalg.inv(np.linalg.qr(a, mode="r"))
        return np.sqrt((inverse**2).sum(axis=2))

    of: dict[str, Callable[[Any], Any]] = {
        OURS: gm.crlb_std,
        "numpy inverse": plain,
        "numpy QR": by_qr,
    }

    def error(a: Any) -> Callable[[str], float]:
        import mpmath

        def relative(name: str) -> float:
            with mpmath.workdps(50):
                j = mpmath.matrix(a[0].tolist())
                covariance = (j.T * j) ** -1
                exact = np.array([float(mpmath.sqrt(covariance[i, i])) for i in range(4)])
            with np.errstate(invalid="ignore"):
                found = of[name](a)[0]
            return float(np.nan_to_num(np.abs(found / exact - 1), nan=np.inf).max())

        return relative

    return Contest(
        f"bounds of rows, {trials} x 60 x 4",
        "trial",
        trials,
        [
            Contestant(name, lambda function=function: lambda: function(rows))  # type: ignore[misc]
            for name, function in of.items()
        ],
        accuracy={"well": error(rows), "ill": error(ill)},
    )


def conversion_contest() -> Contest:
    """The same Gram call on what needs no copy, and on what needs one."""
    rows = np.random.default_rng(1).normal(size=(2000, 100, 4))
    single, transposed = rows.astype(np.float32), np.asfortranarray(rows)
    copy = np.empty_like(rows)

    def copying() -> Callable[[], Any]:
        def work() -> Any:
            np.copyto(copy, transposed)
            return gm.gram(copy)

        return work

    return Contest(
        "conversion at the boundary: gram of 2000 x 100 x 4",
        "trial",
        2000,
        [
            Contestant(OURS, lambda: lambda: gm.gram(rows)),
            Contestant("float32 given", lambda: lambda: gm.gram(single)),
            Contestant("column-major given", lambda: lambda: gm.gram(transposed)),
            Contestant("one copy by numpy, then gram", copying),
        ],
        target="at most one copy",
    )


def import_contest() -> Contest:
    """A fresh interpreter that imports the package, beside one that imports numpy."""

    def start(code: str) -> Callable[[], Callable[[], Any]]:
        return lambda: lambda: subprocess.run([sys.executable, "-c", code], check=True)

    return Contest(
        "import, whole process",
        "import",
        1,
        [
            Contestant(OURS, start("import gramian")),
            Contestant("numpy alone", start("import numpy")),
            Contestant("nothing", start("pass")),
        ],
        target="under 0.25 s, matplotlib not loaded",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    yield gram_contest(10_000, 100, peers=True)
    for samples in (10, 30, 300) if not quick else (30,):
        yield gram_contest(10_000, samples, peers=False)
    yield bound_contest(2000)
    yield conversion_contest()
    yield import_contest()


if __name__ == "__main__":
    main(contests)
