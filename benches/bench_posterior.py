"""The posterior bound: 100 steps, 4 states, one bearing a step, many trials."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np
from harness import ALL, FAST, OURS, Case, Contest, Contestant, c_function, main
from limits import Limit

import gramian as gm

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


@cache
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


def _ours(form: Any) -> Callable[[Any], Callable[[], Any]]:
    def prepare(data: Any) -> Callable[[], Any]:
        rows, noise, prior = data
        return lambda: gm.bounds.posterior(rows, MOVE, noise, prior, form=form).std

    return prepare


def _by_numba(data: Any) -> Callable[[], Any]:
    compiled, (rows, noise, prior) = _numba(), data
    return lambda: compiled(rows, MOVE, noise, prior)


def _by_c(data: Any) -> Callable[[], Any]:
    kernel, (rows, noise, prior) = c_function("posterior.c", "posterior", *FAST), data

    def work() -> Any:
        out = np.empty((len(rows), STEPS, 4))
        kernel(rows, MOVE, noise, prior, len(rows), STEPS, out)
        return out

    return work


def _pybounds(data: Any) -> Callable[[], Any]:
    """Its recursion for one trial; it gives the last step alone."""
    from pybounds.stochastic import stochastic_constructability_gramian

    rows, noise, prior = data
    inverse, first = np.linalg.inv(noise), np.linalg.inv(prior)
    one = [np.eye(1)] * STEPS

    def work() -> Any:
        f0 = first + rows[0, 0].T @ rows[0, 0]
        found = stochastic_constructability_gramian(
            [MOVE] * STEPS, list(rows[0]), [inverse] * STEPS, one, F0=f0
        )
        return np.sqrt(np.diagonal(np.linalg.inv(found)))[None, None]

    return work


def _stone_soup(data: Any) -> Callable[[], Any]:
    """Its PCRB metric, fed with linear measurements: a row a step."""
    import datetime

    from stonesoup.metricgenerator.pcrbmetric import PCRBMetric
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
    from stonesoup.types.array import StateVectors
    from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
    from stonesoup.types.state import GaussianState

    rows, noise, prior = data
    start = datetime.datetime(2000, 1, 1)
    states = [
        GroundTruthState([[0.0]] * 4, timestamp=start + datetime.timedelta(seconds=k))
        for k in range(STEPS)
    ]

    class Rows(LinearGaussian):  # type: ignore[misc]
        """The row of the step that a state belongs to."""

        def jacobian(self, state: Any, **_: Any) -> Any:
            return rows[0, int((state.timestamp - start).total_seconds())]

    measurement = Rows(ndim_state=4, mapping=[0], noise_covar=np.eye(1))
    transition = LinearGaussianTimeInvariantTransitionModel(
        transition_matrix=MOVE, covariance_matrix=noise
    )
    # Its first bound is the prior: the first row is put into it.
    known = np.linalg.inv(np.linalg.inv(prior) + rows[0, 0].T @ rows[0, 0])
    given = GaussianState([[0.0]] * 4, known)

    def work() -> Any:
        found = PCRBMetric._compute_pcrb_single(
            given, transition, measurement, GroundTruthPath(states),
            StateVectors([[0.0], [0.0]]), 1.0, (0, 2), (1, 3),
        )  # fmt: skip
        return np.sqrt(np.diagonal(found["inverse_j"], axis1=1, axis2=2))[None]

    return work


_PLAIN = Limit(
    {"fma": 170.0 * STEPS, "divide": STEPS, "root": 4.0 * STEPS},
    "a step of the plain covariance: 128 multiply-adds to move, 42 to take in the row",
)


def _data(case: str, trials: int) -> Any:
    q, prior, weight = CASES[case]
    return _rows(trials, weight), q * SHAPE, prior


@cache
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


def _case(name: str) -> Case:
    def error(found: Any) -> float:
        found, exact = np.asarray(found)[0], _exact(name)
        if len(found) == 1:  # the last step alone
            exact = exact[-1:]
        off = np.abs(found / exact - 1)
        return float(np.where(np.isfinite(off), off, np.inf).max())

    return Case(_data(name, 1), error)


def contests(quick: bool) -> Iterator[Contest]:
    """The contests of this module."""
    yield Contest(
        f"posterior bound, {STEPS} steps, 4 states",
        "trial",
        float(TRIALS),
        _data("well", TRIALS),
        [
            Contestant(OURS, _ours(None)),
            Contestant("gramian, all threads", _ours(None), threads=ALL),
            Contestant(
                "gramian, information form",
                _ours("information"),
                limit=Limit(
                    {"fma": 320.0 * STEPS, "divide": 28.0 * STEPS, "root": 4.0 * STEPS},
                    "a step: two orthogonalisations, four rows of noise, a triangular inverse: "
                    "320 multiply-adds, 28 divisions, 4 roots",
                ),
            ),
            Contestant("C, covariances of eight trials", _by_c, limit=_PLAIN),
            Contestant("numba, covariances", _by_numba, limit=_PLAIN),
            Contestant("numpy, informations", lambda data: lambda: _textbook(*data)),
            Contestant("pybounds", _pybounds, part=1.0),
            Contestant("Stone Soup, PCRB metric", _stone_soup, part=1.0),
        ],
        limit=Limit(
            {"fma": 152.0 * STEPS, "divide": 8.0 * STEPS, "root": 4.0 * STEPS},
            "a step of the factors V^T D V: 152 multiply-adds (38 to take in the row, 102 to "
            "move, 12 for the variances), 8 divisions, 4 roots",
        ),
        cases={name: _case(name) for name in CASES},
        target="1.5 us a trial on a machine of 60 G multiply-adds a second",
        note="pybounds gives the bound of the last step alone.",
        why="The C subtracts covariances: one division a step instead of seven, and no digit left "
        "in the ill case. Ours keep factors, with all digits; one division for the four inverses "
        "of a row, or no test for zeros, made them no faster.",
    )


if __name__ == "__main__":
    main(contests)
