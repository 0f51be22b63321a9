"""The posterior bound: 100 steps, 4 states, one bearing a step, many trials."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from harness import OURS, Contest, Contestant, main

TRIALS, STEPS = 2000, 100
MOVE = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]])
SHAPE = np.kron(np.eye(2), [[1 / 3, 1 / 2], [1 / 2, 1.0]])
#: Well conditioned; and a prior of 1000 km, a sensor of 1 mm, noise of 1e-6.
CASES = {
    "well": (0.05, np.diag([5.0, 10, 5, 10]), 5**-0.5),
    "ill": (1e-6, np.diag([1e12, 1e6, 1e12, 1e6]), 1e3),
}


def _rows(trials: int, weight: float) -> np.ndarray:
    rng = np.random.default_rng(2)
    angle = rng.uniform(0, 2 * np.pi, (trials, STEPS))
    rows = np.zeros((trials, STEPS, 1, 4))
    rows[..., 0, 0], rows[..., 0, 2] = np.cos(angle) * weight, -np.sin(angle) * weight
    return rows


def _textbook(rows: np.ndarray, noise: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """The information recursion that inverts the process noise."""
    d11 = MOVE.T @ np.linalg.inv(noise) @ MOVE
    d12 = -MOVE.T @ np.linalg.inv(noise)
    d22 = np.linalg.inv(noise)
    j = np.broadcast_to(np.linalg.inv(prior), (*rows.shape[:-3], 4, 4))
    out = []
    for k in range(STEPS):
        if k:
            j = d22 - d12.T @ np.linalg.solve(j + d11, np.broadcast_to(d12, j.shape))
        j = j + np.swapaxes(rows[..., k, :, :], -1, -2) @ rows[..., k, :, :]
        out.append(np.sqrt(np.diagonal(np.linalg.inv(j), axis1=-2, axis2=-1)))
    return np.stack(out, axis=-2)


def _numba() -> Callable[..., np.ndarray]:
    import numba

    @numba.njit(fastmath=False)
    def covariance(rows, move, noise, prior):  # noqa: PLR0912 - as one writes it for a compiler
        trials, steps = rows.shape[0], rows.shape[1]
        out = np.empty((trials, steps, 4))
        p, fp, ph = np.empty((4, 4)), np.empty((4, 4)), np.empty(4)
        for trial in range(trials):
            p[:] = prior
            for k in range(steps):
                if k:
                    for i in range(4):
                        for j in range(4):
                            s = 0.0
                            for m in range(4):
                                s += move[i, m] * p[m, j]
                            fp[i, j] = s
                    for i in range(4):
                        for j in range(4):
                            s = noise[i, j]
                            for m in range(4):
                                s += fp[i, m] * move[j, m]
                            p[i, j] = s
                s = 1.0
                for i in range(4):
                    ph[i] = 0.0
                    for j in range(4):
                        ph[i] += p[i, j] * rows[trial, k, 0, j]
                    s += ph[i] * rows[trial, k, 0, i]
                for i in range(4):
                    for j in range(4):
                        p[i, j] -= ph[i] * ph[j] / s
                    out[trial, k, i] = np.sqrt(p[i, i])
        return out

    return covariance


def _bound(name: str, case: str, trials: int) -> Callable[[], np.ndarray]:
    q, prior, weight = CASES[case]
    rows, noise = _rows(trials, weight), q * SHAPE
    if name == "numpy":
        return lambda: _textbook(rows, noise, prior)
    if name == "numba":
        compiled = _numba()
        return lambda: compiled(rows, MOVE, noise, prior)
    import gramian as gm

    form: Any = "information" if name.endswith("information form") else "covariance"
    return lambda: gm.bounds.posterior(rows, MOVE, noise, prior, form=form).std


def _exact(case: str) -> np.ndarray:
    import mpmath as mp

    q, prior, weight = CASES[case]
    with mp.workdps(60):
        f, noise, p = (mp.matrix(x.tolist()) for x in (MOVE, q * SHAPE, prior))
        out = []
        for k, row in enumerate(_rows(1, weight)[0, :, 0]):
            if k:
                p = f * p * f.T + noise
            h = mp.matrix([row.tolist()])
            ph = p * h.T
            p = p - ph * ph.T / (1 + (h * ph)[0])
            out.append([float(mp.sqrt(p[i, i])) for i in range(4)])
    return np.array(out)


def _error(case: str) -> Callable[[str], float | None]:
    def error(name: str) -> float | None:
        try:
            with np.errstate(all="ignore"):
                found = _bound(name, case, 1)()[0]
        except np.linalg.LinAlgError:
            return float("inf")  # no digit left: its matrix cannot be inverted
        off = np.abs(found / _exact(case) - 1)
        return float(np.where(np.isfinite(off), off, np.inf).max())

    return error


def contests(quick: bool) -> Iterator[Contest]:
    """The contests of this module."""
    names = [OURS, f"{OURS}, information form", "numba", "numpy"]
    yield Contest(
        f"posterior bound, {STEPS} steps, 4 states",
        "trial",
        TRIALS,
        [
            Contestant(name, lambda name=name: _bound(name, "well", TRIALS), work=TRIALS)
            for name in names
        ],
        accuracy={case: _error(case) for case in CASES},
        target="1.5 us a trial",
    )


if __name__ == "__main__":
    main(contests)
