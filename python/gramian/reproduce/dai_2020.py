"""Dai, Zhou & Shan 2020: one three-component magnetometer and a moving dipole."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian._text import brief, number, plain
from gramian.analysis import analyze
from gramian.models import dipole
from gramian.report import Picture, Report, Table, answer_pictures, answer_tables

__all__ = ["run"]

Array = NDArray[np.float64]

#: Table 1, with T = 1 s and 21 samples.
R0, V, M = (-10.0, -10.0, 5.0), (1.0, 1.0, 0.0), (10.0, 20.0, 10.0)
TIMES = np.arange(21.0)
TRUE = np.array([*R0, *V, *M])

#: Table 2: five estimates without knowledge, and the u printed for each.
TABLE_2 = (
    ((-68.3, -69.1, 33.1, 6.8, 6.9, 0.03, 2.90e3, 6.06e3, 3.11e3), 6.7),
    ((-8.2, -7.61, 3.84, 0.81, 0.76, 0.018, 4.73, 9.24, 4.65), 0.78),
    ((-154.3, -160.37, 75.9, 14.2, 16.43, 0.15, 3.66e4, 7.27e4, 3.72e4), 15.3),
    ((-700.8, -706.8, 350.1, 70.1, 70.6, 0.20, 3.49e6, 6.97e6, 3.51e6), 70.0),
    ((-17.6, -16.7, 7.1, 1.75, 1.65, 0.14, 50.9, 96.1, 54.7), 1.7),
)

#: Table 3: the genetic algorithm's estimate with z0 = 5 m and vz = 0 known.
TABLE_3 = np.array([-10.4, -9.6, 5.0, 1.03, 0.95, 0.0, 10.07, 19.67, 10.20])

#: Where the stand-in for the genetic algorithm looks, without z0 and vz.
BOX = [(-50.0, 50.0)] * 2 + [(-5.0, 5.0)] * 2 + [(-100.0, 100.0)] * 3
FREE = [0, 1, 3, 4, 6, 7, 8]


def run(*, generations: int = 400) -> Report:
    """Compute Tables 1 to 3 and Figs. 2 and 3 and compare them with the printed values.

    Parameters
    ----------
    generations : int
        How long SciPy's differential evolution, the stand-in for the paper's
        genetic algorithm, may work.
    """
    exact = dipole.measure(R0, V, M, TIMES)
    twice = dipole.equivalents(R0, V, M, 2.0)["same"]
    other = dipole.measure(*twice, TIMES)
    apart = float(np.abs(exact - other).max() / np.abs(exact).max())
    opposite = dipole.measure(*(-2 * np.array(R0), -2 * np.array(V), -8 * np.array(M)), TIMES)
    answer = analyze(dipole.problem(R0, V, M, TIMES, 1e-9))
    family = [_on_the_family(np.array(state), printed, exact) for state, printed in TABLE_2]
    ours, seconds = _ours(exact)
    evolved, history = _evolution(exact, generations)
    methods = (
        ("published genetic algorithm", TABLE_3, None),
        ("differential evolution (SciPy)", evolved, float(history[-1, 0])),
        ("gramian, its own starts", ours, seconds),
    )
    ours_cost = _cost(ours, exact)
    return Report(
        title="Dai, Zhou & Shan 2020",
        subtitle="one three-component magnetometer, a dipole at constant velocity",
        tone="good",
        headline="REPRODUCED",
        verdict=(
            f"x and x(2) make the same data to {apart:.0e}; no single sensor tells the size; "
            f"with z0 and vz known the pass is found to {_error(ours):.0e}"
        ),
        facts=[
            ("null combination", answer.null_combinations[0]),
            (
                "eq. (28)",
                "holds for u > 0: at u = -2 the field is that of u = 2 with the opposite sign "
                f"(sum over the data {float(np.abs(exact + opposite).max()):.0e} T)",
            ),
            ("not in the paper", "the mirror image (-r0, -v, m) makes the same field as well"),
        ],
        tables=[
            Table(
                "Table 1: the pass",
                ["quantity", "x", "y", "z"],
                [
                    ["r0, m", *map(str, R0)],
                    ["v, m/s", *map(str, V)],
                    ["m, A m^2", *map(str, M)],
                ],
            ),
            Table(
                "Table 2: the published estimates without knowledge, each on the family of u",
                ["u printed", "u from r0", "u from v", "u from m", "off the family", "data missed"],
                [
                    [
                        f"{item['printed']:g}",
                        *(f"{brief(item[key])}" for key in ("from_r", "from_v", "from_m")),
                        f"{100 * item['off']:.1f} %",
                        f"{100 * item['missed']:.1f} %",
                    ]
                    for item in family
                ],
                "Off the family: distance of the estimate from (u r0, u v, u^3 m), each part "
                "relative to itself. Data missed: root mean square of the field it makes, less "
                "the data, over that of the data.",
            ),
            Table(
                "Table 3: with z0 = 5 m and vz = 0 known",
                ["method", *(dipole.NAMES[i] for i in FREE), "error", "V, T^2", "seconds"],
                [
                    [
                        name,
                        *(number(state[i]) for i in FREE),
                        f"{_error(state):.1e}",
                        f"{_cost(state, exact):.1e}",
                        "" if took is None else f"{brief(took, 2)}",
                    ]
                    for name, state, took in methods
                ],
                "Error: the largest of those of r0, v and m, each relative to itself.",
            ),
            *answer_tables(answer),
        ],
        pictures=[
            Picture(
                "Fig. 2: data of x and of x(2)",
                "The two passes, one twice as far, fast and eight times as strong, make one curve.",
                lambda: _pictures().fields(TIMES, {"x": exact, "x(2)": other}),
            ),
            Picture(
                "Fig. 3: how the cost falls",
                "Differential evolution, the stand-in for the genetic algorithm, gains digits by "
                "the second; separable least squares ends before its first generation.",
                lambda: _pictures().convergence(
                    {
                        "differential evolution": (history[:, 0], history[:, 1]),
                        "gramian": (np.array([seconds]), np.array([ours_cost])),
                    }
                ),
            ),
            *answer_pictures(answer),
        ],
        data={
            "figure_2": {"relative_difference": apart},
            "table_2": family,
            "table_3": [
                {
                    "method": name,
                    "state": plain(state),
                    "error": _error(state),
                    "cost": _cost(state, exact),
                    "seconds": took,
                }
                for name, state, took in methods
            ],
            "figure_3": {"seconds": plain(history[:, 0]), "cost": plain(history[:, 1])},
            "observability": answer.to_dict(),
        },
    )


def _on_the_family(state: Array, printed: float, exact: Array) -> dict[str, float]:
    """Find the u of an estimate, and how far it is off the family and off the data."""

    def fitted(part: slice) -> float:
        true = TRUE[part]
        return float(state[part] @ true / (true @ true))

    parts = (slice(0, 3), slice(3, 6), slice(6, 9))
    from_r, from_v, cubed = (fitted(part) for part in parts)
    on = np.concatenate([printed * TRUE[:6], printed**3 * TRUE[6:]])
    off = max(float(np.linalg.norm(state[p] - on[p]) / np.linalg.norm(on[p])) for p in parts)
    made = dipole.measure(state[:3], state[3:6], state[6:], TIMES)
    missed = float(np.sqrt(((made - exact) ** 2).sum() / (exact**2).sum()))
    return {
        "printed": printed,
        "from_r": from_r,
        "from_v": from_v,
        "from_m": float(np.cbrt(cubed)),
        "off": off,
        "missed": missed,
    }


def _ours(exact: Array) -> tuple[Array, float]:
    best = np.inf
    for _ in range(3):
        start = time.perf_counter()
        found = dipole.localize(TIMES, exact, {"z": 5.0, "vz": 0.0})
        best = min(best, time.perf_counter() - start)
    return np.concatenate([found.r0, found.v, found.m]), best


def _evolution(exact: Array, generations: int) -> tuple[Array, Array]:
    """Minimise V(x0) as the paper does, with differential evolution, and watch it."""
    from scipy.optimize import differential_evolution

    def full(free: Array) -> Array:
        states = np.tile(TRUE, (free.shape[1], 1))
        states[:, FREE] = free.T
        return states

    def cost(free: Array) -> Array:
        states = full(free)
        made = dipole.measure(states[:, :3], states[:, 3:6], states[:, 6:], TIMES)
        # Scaled, so that the search does not take 1e-18 T^2 for nothing.
        sums: Array = ((made - exact) ** 2).sum(axis=(1, 2)) / (exact**2).sum()
        return sums

    history = []
    start = time.perf_counter()

    def watch(intermediate_result: Any) -> None:
        history.append((time.perf_counter() - start, float(intermediate_result.fun)))

    result = differential_evolution(
        cost,
        BOX,
        maxiter=generations,
        popsize=15,
        tol=0.0,
        seed=1,
        polish=False,
        vectorized=True,
        updating="deferred",
        callback=watch,
    )
    curve = np.array(history)
    curve[:, 1] *= (exact**2).sum()
    state: Array = full(np.asarray(result.x)[:, None])[0]
    return state, curve


def _error(state: Array) -> float:
    return max(
        float(np.linalg.norm((state - TRUE)[p]) / np.linalg.norm(TRUE[p]))
        for p in (slice(0, 3), slice(3, 6), slice(6, 9))
    )


def _cost(state: Array, exact: Array) -> float:
    made = dipole.measure(state[:3], state[3:6], state[6:], TIMES)
    return float(((made - exact) ** 2).sum())


def _pictures() -> Any:
    from gramian.models.dipole import plot as pictures

    return pictures
