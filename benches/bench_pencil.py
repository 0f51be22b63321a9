"""What a linear system hides, and how near it is to hiding something: pencil and distance."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from harness import OURS, Case, Contest, Contestant, main

import gramian as gm


def hidden_system(n: int, hidden: int, spread: float = 0.0) -> tuple[Any, Any]:
    """A system whose last states are not seen, in other coordinates; units decades apart."""
    rng = np.random.default_rng(n)
    a = rng.normal(size=(n, n))
    a[: n - hidden, n - hidden :] = 0
    c = np.concatenate([rng.normal(size=(2, n - hidden)), np.zeros((2, hidden))], axis=1)
    q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    unit = 10.0 ** np.linspace(0, spread, n)
    a, c = q @ a @ q.T, c @ q.T
    return unit[:, None] * a / unit, c / unit


def hautus(a: Any, c: Any) -> int:
    """The rank test at each eigenvalue, in numpy: how many fail."""
    count = 0
    for z in np.linalg.eigvals(a):
        stack = np.concatenate([a - z * np.eye(len(a)), c])
        count += np.linalg.matrix_rank(stack) < len(a)
    return count


def pencil_contest(n: int, hidden: int) -> Contest:
    """The dimension of what is hidden."""

    def by(work: Callable[[Any, Any], Any]) -> Callable[[Any], Callable[[], Any]]:
        return lambda data: lambda: work(*data)

    def case(n: int, hidden: int, spread: float) -> Case:
        return Case(hidden_system(n, hidden, spread), lambda found: float(abs(found - hidden)))

    return Contest(
        f"unobservable part of {n} states, {hidden} hidden",
        "system",
        1.0,
        hidden_system(n, hidden),
        [
            Contestant(OURS, by(lambda a, c: gm.linear.unobservable(a, c).nullity)),
            Contestant("numpy, the test of Hautus at each eigenvalue", by(hautus)),
        ],
        cases={"well": case(8, 2, 0.0), "ill": case(n, hidden, 8.0)},
        note="The error is how far the dimension is off; well: 8 states, 2 of them hidden, ill: "
        f"{n} states in units 8 decades apart. Ours gives the hidden states and modes as well; "
        "ranks of observability matrices are in the contest of ranks and levels.",
    )


def pairs(n: int, turned: bool) -> tuple[Any, Any]:
    """Two of each eigenvalue 1, 2, .. and their sum measured; dense in other coordinates."""
    a, c = np.diag(np.r_[np.arange(1.0, n // 2 + 1), np.arange(1.0, n // 2 + 1)]), np.ones((1, n))
    if turned:
        q = np.linalg.qr(np.random.default_rng(n).normal(size=(n, n)))[0]
        a, c = q @ a @ q.T, c @ q.T
    return a, c


def three_forms(a: Any, _: Any) -> int:
    from scipy.linalg import schur

    for _ in range(3):
        schur(a, output="complex")
    return len(a) // 2


def pairs_contest(n: int, turned: bool) -> Contest:
    """Half of all states hidden, beside three Schur forms by LAPACK."""

    def by(work: Callable[[Any, Any], Any]) -> Callable[[Any], Callable[[], Any]]:
        return lambda data: lambda: work(*data)

    def error(found: Any) -> float:
        return float(abs(found - n // 2))

    return Contest(
        f"{n // 2} pairs of equal modes, {'dense' if turned else 'diagonal'}",
        "system",
        1.0,
        pairs(n, turned),
        [
            Contestant(OURS, by(lambda a, c: gm.linear.unobservable(a, c).nullity)),
            Contestant("SciPy: three complex Schur forms and no answer", by(three_forms)),
        ],
        cases={"well": Case(pairs(n, turned), error)},
        note="Asked for: 50 ms on one thread, and no slower than the three forms. "
        + (
            ""
            if turned
            else "The Schur form of a diagonal matrix is the matrix: LAPACK has nothing to do."
        ),
        why=""
        if turned
        else "LAPACK has nothing to do and tells nothing; ours finds the 50 directions. Of the "
        "same system in other coordinates (dense) the three Schur forms take 1.5 times as long as "
        "our answer.",
    )


def smallest(a: Any, c: Any, z: complex) -> float:
    stack = np.concatenate([a - z * np.eye(len(a)), c.astype(complex)])
    return float(np.linalg.svd(stack, compute_uv=False)[-1])


def by_scipy(a: Any, c: Any) -> float:
    """The least of the smallest singular value over z, from each eigenvalue."""
    from scipy.optimize import minimize

    found = [
        minimize(
            lambda z: smallest(a, c, complex(*z)), [z.real, z.imag], method="Nelder-Mead",
            options={"xatol": 1e-8, "fatol": 1e-12},
        ).fun
        for z in np.linalg.eigvals(a)
        if z.imag >= 0
    ]  # fmt: skip
    return min(found)


def grid(a: Any, c: Any) -> float:
    """The least over a fine grid: an upper limit on the distance."""
    size = np.linalg.norm(a, 2)
    best, at, width = np.inf, 0j, size
    for _ in range(12):
        line = np.linspace(-width, width, 41)
        for x in line:
            for y in line:
                if (value := smallest(a, c, at + complex(x, y))) < best:
                    best, where = value, at + complex(x, y)
        at, width = where, width / 8
    return best


def distance_contest(n: int) -> Contest:
    """How near the nearest unobservable system is, in the 2-norm."""
    rng = np.random.default_rng(7)

    def system(n: int, left: float) -> tuple[Any, Any]:
        a, c = hidden_system(n, 1)
        return a + left * rng.normal(size=a.shape), c + left * rng.normal(size=c.shape)

    def case(left: float) -> Case:
        data = system(4, left)
        wanted = grid(*data)
        # A distance above the least is wrong; one below is nearer than the grid came.
        return Case(data, lambda found: max(0.0, float(found) / wanted - 1))

    return Contest(
        f"distance to the nearest unobservable system, {n} states",
        "system",
        1.0,
        system(n, 0.1),
        [
            Contestant(OURS, lambda data: lambda: gm.linear.distance(*data).distance),
            Contestant(
                "SciPy Nelder-Mead from each eigenvalue", lambda data: lambda: by_scipy(*data)
            ),
        ],
        cases={"well": case(0.3), "ill": case(1e-6)},
        note="By how much the distance is above the least of a fine grid; ill: a system 1e-6 from "
        "an unobservable one.",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    yield pencil_contest(10, 2)
    yield pencil_contest(50, 5)
    yield pencil_contest(100, 10)
    yield pairs_contest(20 if quick else 100, turned=True)
    yield pairs_contest(20 if quick else 100, turned=False)
    yield distance_contest(6 if quick else 10)


if __name__ == "__main__":
    main(contests)
