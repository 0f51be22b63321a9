"""The planner against the closed-form laws and a plain optimiser: time and what is reached.

The error of a path is how far its determinant stays below the best known.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from typing import Any

import exact
import numpy as np
from harness import FAST, OURS, Case, Contest, Contestant, c_function, main
from limits import Limit

import gramian as gm
from gramian import _core
from gramian.maneuver._search import one_blas_thread

TARGET, STEP, SIGMA = np.array([0.0, 1000.0]), 20.0, 0.001**0.5
#: Best determinants found by 60 starts of SLSQP: samples, stand-off.
BEST = {(40, 800.0): 2.05985e-4, (100, 800.0): 5.40373e-3, (100, 500.0): 3.0366e-2}


def log_det(headings: Any) -> tuple[float, Any]:
    """Minus log det and its gradient by the headings, in numpy."""
    moves = STEP * np.stack([np.sin(headings), np.cos(headings)], axis=1)
    path = np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
    offset = TARGET - path
    squared = (offset**2).sum(axis=1)
    rows = offset[:, ::-1] * [1, -1] / (SIGMA * squared[:, None])
    information = rows.T @ rows
    through = rows @ np.linalg.inv(information)
    x, y = offset.T
    a, b = 2 * through.T
    both = 2 * (a * y - b * x) / squared
    pull = np.stack([b + both * x, both * y - a], axis=1) / (SIGMA * squared[:, None])
    after = np.cumsum(pull[::-1], axis=0)[::-1][1:]
    gradient = STEP * (after[:, 0] * np.cos(headings) - after[:, 1] * np.sin(headings))
    return -float(np.linalg.slogdet(information)[1]), -gradient


def below(best: float) -> Callable[[Any], float]:
    """How far the determinant of a path stays below the best known."""

    def error(path: Any) -> float:
        offset = TARGET - path
        rows = offset[:, ::-1] * [1, -1] / (SIGMA * (offset**2).sum(axis=1)[:, None])
        return max(0.0, 1 - float(np.linalg.det(rows.T @ rows)) / best)

    return error


def plain(samples: int, standoff: float) -> Callable[[], Any]:
    """SLSQP on numpy from the path of the law: one start."""
    from scipy.optimize import minimize

    start = gm.maneuver.trajectory(TARGET, [0, 0], STEP, 1.0, samples).headings

    def clearance(headings: Any) -> Any:
        moves = STEP * np.stack([np.sin(headings), np.cos(headings)], axis=1)
        return ((np.cumsum(moves, axis=0) - TARGET) ** 2).sum(axis=1) / standoff**2 - 1

    def slopes(headings: Any) -> Any:
        moves = STEP * np.stack([np.sin(headings), np.cos(headings)], axis=1)
        away = np.cumsum(moves, axis=0) - TARGET
        turned = STEP * np.stack([np.cos(headings), -np.sin(headings)], axis=1)
        return np.tril(2 * away @ turned.T) / standoff**2

    def work() -> Any:
        with one_blas_thread():  # as ours
            done = minimize(
                log_det, start, jac=True, method="SLSQP", options={"maxiter": 400, "ftol": 1e-7},
                constraints=[{"type": "ineq", "fun": clearance, "jac": slopes}],
            )  # fmt: skip
        moves = STEP * np.stack([np.sin(done.x), np.cos(done.x)], axis=1)
        return np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])

    return work


def plan_contest(samples: int, standoff: float) -> Contest:
    """A whole plan beside one start of a plain optimiser, and the laws."""

    def law(name: Any) -> Callable[[Any], Callable[[], Any]]:
        return lambda _: (
            lambda: gm.maneuver.trajectory(TARGET, [0, 0], STEP, 1.0, samples, law=name).positions
        )

    def ours(_: Any) -> Callable[[], Any]:
        return lambda: (
            gm.maneuver.plan(
                TARGET, [0, 0], STEP, 1.0, samples, sigma=SIGMA, standoff=standoff
            ).path
        )

    contestants = [
        Contestant(OURS, ours),
        Contestant("SLSQP on numpy, one start", lambda _: plain(samples, standoff)),
        Contestant("law max_det", law("max_det")),
        Contestant("law hammel_liu", law("hammel_liu")),
    ]
    return Contest(
        f"plan, {samples} bearings, stand-off {standoff:g} m",
        "plan",
        1.0,
        None,
        contestants,
        cases={"below the best": Case(None, below(BEST[samples, standoff]))},
        target="under 2 s, within 0.5 % of the best known",
        note="The error is the share of the determinant that is missing to the best known. "
        "The laws heed no stand-off.",
    )


def gradient_contest(samples: int) -> Contest:
    """The criterion and its gradient once."""

    def ours(headings: Any) -> Callable[[], Any]:
        ask = _core.PlanObjective(
            [0, 0], 1.0, [1] * (samples - 1), [[0, 1000, 0, 0]], [1.0], SIGMA, [1.0, 1.0],
            np.zeros((1, 0, 2)), "D", np.inf, np.zeros((1, 2)),
        )  # fmt: skip
        lengths = np.full(samples - 1, STEP)
        return lambda: -ask.gradient(headings, lengths)[1]

    def case(headings: Any) -> Case:
        wanted = exact.lazily(lambda: exact_gradient(headings))
        return Case(
            headings, lambda found: float(np.abs(found - wanted()).max() / np.abs(wanted()).max())
        )

    def by_c(headings: Any) -> Callable[[], Any]:
        kernel = c_function("plan.c", "minus_log_det", *FAST, result=ctypes.c_double)
        gradient, space = np.empty(samples - 1), np.empty(4 * samples)
        call = kernel.bound(gradient, headings, samples - 1, TARGET, STEP, SIGMA, space)
        return lambda: call()[0]

    curved = np.linspace(0.2, 2.0, samples - 1)
    straight = 0.3 + 1e-6 * np.sin(np.arange(samples - 1.0))
    return Contest(
        f"log det and gradient, {samples} bearings",
        "gradient",
        1.0,
        curved,
        [
            Contestant(OURS, ours),
            Contestant("C, sums and their derivatives", by_c),
            Contestant("numpy", lambda headings: lambda: log_det(headings)[1]),
        ],
        limit=Limit(
            {"fma": 40.0 * samples, "sincos": samples, "divide": 2.0 * samples},
            "a bearing: a sine and cosine, two divisions, 40 multiply-adds",
        ),
        cases={"well": case(curved), "ill": case(straight)},
        note="Ill: an almost straight path.",
    )


def exact_gradient(headings: Any) -> Any:
    """The gradient of minus log det with 50 digits, by differences of 1e-20."""
    import mpmath as mp

    with mp.workdps(60):
        angles = [mp.mpf(float(h)) for h in headings]
        goal = [mp.mpf(float(x)) for x in TARGET]
        moves = [(STEP * mp.sin(h), STEP * mp.cos(h)) for h in angles]
        at, offsets = (mp.mpf(0), mp.mpf(0)), []
        for move in [(mp.mpf(0), mp.mpf(0)), *moves]:
            at = (at[0] + move[0], at[1] + move[1])
            offsets.append((goal[0] - at[0], goal[1] - at[1]))

        def derivative_terms(x: Any, y: Any) -> Any:
            r2 = x * x + y * y
            return y * y / r2**2, -x * y / r2**2, x * x / r2**2

        sums = [
            mp.fsum(terms) for terms in zip(*(derivative_terms(*o) for o in offsets), strict=True)
        ]
        det = sums[0] * sums[2] - sums[1] ** 2
        # d log det / d(x, y) of each offset.
        pulls = []
        for x, y in offsets:
            r2 = x * x + y * y
            of = []
            for dx, dy in ((1, 0), (0, 1)):
                d2 = 2 * (x * dx + y * dy)
                a = 2 * y * dy / r2**2 - 2 * y * y * d2 / r2**3
                b = -(x * dy + y * dx) / r2**2 + 2 * x * y * d2 / r2**3
                c = 2 * x * dx / r2**2 - 2 * x * x * d2 / r2**3
                of.append((sums[2] * a + sums[0] * c - 2 * sums[1] * b) / det)
            pulls.append(of)
        out, after = [], (mp.mpf(0), mp.mpf(0))
        for k in range(len(angles) - 1, -1, -1):
            after = (after[0] + pulls[k + 1][0], after[1] + pulls[k + 1][1])
            # An offset shrinks as the observer moves; minus log det turns the sign again.
            out.append(STEP * (after[0] * mp.cos(angles[k]) - after[1] * mp.sin(angles[k])))
        return np.array([float(g) for g in reversed(out)])


def contests(quick: bool) -> Iterator[Contest]:
    """Yield the contests of the planner."""
    yield gradient_contest(100)
    for samples, standoff in list(BEST)[:1] if quick else BEST:
        yield plan_contest(samples, standoff)


if __name__ == "__main__":
    main(contests)
