"""Registration: the Fisher sum of 481 looks, and maximum likelihood of 200."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from harness import OURS, Contest, Contestant, main

from gramian import registration as reg

SENSORS = np.array([[0.0, 0.0], [60e3, 0.0]])
SIGMA = np.tile([50.0, np.radians(0.1)], (2, 1))
S2 = SIGMA.ravel() ** 2
K = np.arange(481.0)
MOTION_1 = np.stack([-30e3 + 250 * K, 40e3 + 0 * K], axis=1)
TARGET_A = np.stack([-20e3 + 400 * K[:200], 25e3 + 0 * K[:200]], axis=1)
BIASES = np.array([300.0, np.radians(0.5), -200.0, np.radians(-0.4)])


def numpy_fisher(p):
    """Sum of H^T R^-1 H over all looks at once, as numpy does it best."""
    a, b = p - SENSORS[0], p - SENSORS[1]
    ra, rb = np.hypot(a[:, 0], a[:, 1]), np.hypot(b[:, 0], b[:, 1])
    h = np.empty((len(p), 2, 4))
    h[:, 0, 0], h[:, 1, 0] = a[:, 0] / ra, a[:, 1] / ra
    h[:, 0, 1], h[:, 1, 1] = a[:, 1], -a[:, 0]
    h[:, 0, 2], h[:, 1, 2] = -b[:, 0] / rb, -b[:, 1] / rb
    h[:, 0, 3], h[:, 1, 3] = -b[:, 1], b[:, 0]
    noise = (h * S2) @ h.transpose(0, 2, 1)
    solved = np.linalg.solve(noise, h)
    return np.tensordot(h, solved, axes=([0, 1], [0, 1]))


def loop_fisher(p):
    """The same look by look, as it is usually written."""
    total = np.zeros((4, 4), dtype=p.dtype)
    for x in p:
        columns = []
        for s, sign in zip(SENSORS, (1, -1), strict=True):
            d = x - s
            columns += [sign * d / np.hypot(*d), sign * np.array([d[1], -d[0]])]
        h = np.stack(columns, axis=1)
        (a, b), (_, d) = h @ np.diag(S2).astype(p.dtype) @ h.T
        total += h.T @ (np.array([[d, -b], [-b, a]]) / (a * d - b * b)) @ h
    return total


def scipy_ml(reports, *, sparse):
    """Positions and biases together by scipy.optimize.least_squares."""
    from scipy.optimize import least_squares
    from scipy.sparse import lil_matrix

    count = len(reports)
    sigma = SIGMA.ravel()

    def parts(x):
        offset = x[4:].reshape(-1, 1, 2) - SENSORS
        return offset, np.hypot(offset[..., 0], offset[..., 1])

    def residual(x):
        offset, r = parts(x)
        e = np.empty((count, 4))
        e[:, 0::2] = reports[..., 0] - r - x[[0, 2]]
        turn = reports[..., 1] - np.arctan2(offset[..., 0], offset[..., 1]) - x[[1, 3]]
        e[:, 1::2] = (turn + np.pi) % (2 * np.pi) - np.pi
        return (e / sigma).ravel()

    def jacobian(x):
        offset, r = parts(x)
        j = np.zeros((count, 4, 4 + 2 * count))
        j[:, range(4), range(4)] = -1 / sigma
        k = np.arange(count)
        for s in range(2):
            u = offset[:, s] / r[:, s, None]
            for c in range(2):
                j[k, 2 * s, 4 + 2 * k + c] = -u[:, c] / sigma[2 * s]
            j[k, 2 * s + 1, 4 + 2 * k] = -u[:, 1] / r[:, s] / sigma[2 * s + 1]
            j[k, 2 * s + 1, 5 + 2 * k] = u[:, 0] / r[:, s] / sigma[2 * s + 1]
        return j.reshape(4 * count, -1)

    first = reports[..., :1] * np.stack([np.sin(reports[..., 1]), np.cos(reports[..., 1])], axis=-1)
    start = np.concatenate([np.zeros(4), (first + SENSORS).mean(axis=1).ravel()])
    scale = np.concatenate([sigma, np.full(2 * count, 50.0)])
    if sparse:
        pattern = lil_matrix((4 * count, 4 + 2 * count), dtype=int)
        for k in range(count):
            pattern[4 * k : 4 * k + 4, 4 + 2 * k : 6 + 2 * k] = 1
            for i in range(4):
                pattern[4 * k + i, i] = 1
        return least_squares(residual, start, jac_sparsity=pattern, x_scale=scale, xtol=1e-10).x[:4]
    return least_squares(residual, start, jac=jacobian, x_scale=scale, xtol=1e-10).x[:4]


def fisher_contest(*, peers: bool) -> Contest:
    """481 looks at the target of motion 1."""
    exact = loop_fisher(MOTION_1.astype(np.longdouble))
    unit = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    contestants = [
        Contestant(OURS, lambda: lambda: reg.fisher(MOTION_1, SENSORS, SIGMA)),
        Contestant("numpy, all looks at once", lambda: lambda: numpy_fisher(MOTION_1)),
    ]
    if peers:
        contestants.append(Contestant("numpy, look by look", lambda: lambda: loop_fisher(MOTION_1)))
    return Contest(
        "registration: Fisher information of 481 looks",
        "call",
        1,
        contestants,
        error=lambda found: float(np.abs((found - exact) / unit).max()),
        target="20 times numpy",
    )


def tracks_contest(tracks: int) -> Contest:
    """The same for many tracks in one call."""
    many = MOTION_1 + np.linspace(0, 1000, tracks)[:, None, None]
    return Contest(
        f"registration: Fisher information of {tracks} x 481 looks",
        "track",
        tracks,
        [
            Contestant(OURS, lambda: lambda: reg.fisher(many, SENSORS, SIGMA)),
            Contestant(
                "numpy, all looks of a track at once",
                lambda: lambda: [numpy_fisher(p) for p in many[:20]],
                work=20,
            ),
        ],
    )


def likelihood_contest(*, peers: bool) -> Contest:
    """Biases and positions of 200 looks: 404 unknowns."""
    reports = reg.simulate(TARGET_A, SENSORS, SIGMA, BIASES, seed=1).values
    found = reg.estimate(reports, SENSORS, SIGMA)
    contestants = [
        Contestant(OURS, lambda: lambda: reg.estimate(reports, SENSORS, SIGMA).biases),
        Contestant(
            "SciPy least_squares, analytic Jacobian",
            lambda: lambda: scipy_ml(reports, sparse=False),
        ),
    ]
    if peers:
        contestants.append(
            Contestant(
                "SciPy least_squares, sparse differences",
                lambda: lambda: scipy_ml(reports, sparse=True),
            )
        )
    return Contest(
        "registration: maximum likelihood of 200 looks",
        "call",
        1,
        contestants,
        # Distance from ours, in standard deviations: they must agree.
        error=lambda other: float(np.abs((other - found.biases) / found.std).max()),
        target="100 times SciPy",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """Yield the contests of this part."""
    yield fisher_contest(peers=not quick)
    yield tracks_contest(100 if quick else 1000)
    yield likelihood_contest(peers=not quick)


if __name__ == "__main__":
    main(contests)
