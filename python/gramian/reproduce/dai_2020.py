"""Dai, Zhou & Shan 2020: one three-component magnetometer and a moving dipole.

The paper minimises eq. (31) by a genetic algorithm (Alimi et al. 2015) of which it prints neither
code nor settings. In its place stands `scipy.optimize.differential_evolution`: the same kind (a
population, mutation, crossover, selection), well kept, and in the library already; packages
of genetic algorithms proper (DEAP, pygad) would be a dependency for one picture, and their
operators on real numbers are no nearer to the paper's.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian._text import brief, number, plain
from gramian.analysis import analyze
from gramian.models import dipole
from gramian.report import Picture, Report, Table, answer_pictures, answer_tables
from gramian.reproduce._claims import (
    Claim,
    claims_data,
    claims_table,
    near,
    refuted,
    true,
    verdict,
)

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
#: Passes in a generation.
POPULATION = 105


def run(*, generations: int = 400) -> Report:
    """Compute Tables 1 to 3, Figs. 2 and 3 and the equations, and compare each with the print.

    Parameters
    ----------
    generations : int
        How long SciPy's differential evolution, in the place of the paper's genetic
        algorithm, may work.
    """
    exact = dipole.measure(R0, V, M, TIMES)
    twice = dipole.equivalents(R0, V, M, 2.0)["same"]
    other = dipole.measure(*twice, TIMES)
    apart = float(np.abs(exact - other).max() / np.abs(exact).max())
    answer = analyze(dipole.problem(R0, V, M, TIMES, 1e-9))
    family = [_on_the_family(np.array(state), printed, exact) for state, printed in TABLE_2]
    ours, course = _ours(exact)
    evolved, history = _evolution(exact, generations)
    methods = (
        ("published genetic algorithm", TABLE_3),
        ("differential evolution (SciPy)", evolved),
        ("gramian, its own starts", ours),
    )
    proved, printed_claims = _equations(exact), _tables(family, ours)
    figures = _figures(apart, course, history)
    claims = [*proved, *printed_claims, *figures]
    tone, headline, sentence = verdict(claims)
    return Report(
        title="Dai, Zhou & Shan 2020",
        subtitle="one three-component magnetometer, a dipole at constant velocity",
        tone=tone,
        headline=headline,
        verdict=sentence,
        facts=[
            ("null combination", answer.null_combinations[0] if answer.nullity else "none"),
            (
                "genetic algorithm",
                "SciPy's differential evolution stands for it: the same kind, well kept, and the "
                "paper prints neither code nor settings of its own",
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
                ["method", *(dipole.NAMES[i] for i in FREE), "error", "V, T^2"],
                [
                    [
                        name,
                        *(number(state[i]) for i in FREE),
                        f"{_error(state):.1e}",
                        f"{_cost(state, exact):.1e}",
                    ]
                    for name, state in methods
                ],
                "Error: the largest of those of r0, v and m, each relative to itself.",
            ),
            claims_table("Equations (5) to (28) and section 2", proved),
            claims_table("Tables 2 and 3", printed_claims),
            claims_table("Figures 2 and 3", figures),
            *answer_tables(answer),
        ],
        pictures=[
            Picture(
                "Fig. 2: data of x and of x(2)",
                "The two passes, one twice as far, fast and eight times as strong, make one curve.",
                lambda: _pictures().fields(TIMES, {"x": exact, "x(2)": other}),
            ),
            Picture(
                "Fig. 3: how the cost falls with the iterations",
                "Differential evolution, in the place of the genetic algorithm, by generations of "
                f"{POPULATION} passes; separable least squares by its iterations.",
                lambda: _pictures().convergence(
                    {
                        "differential evolution": (1.0 + np.arange(len(history)), history),
                        "gramian": (1.0 + np.arange(len(course)), course),
                    },
                    "iteration",
                ),
            ),
            *answer_pictures(answer),
        ],
        data={
            "claims": claims_data(claims),
            "figure_2": {"relative_difference": apart},
            "table_2": family,
            "table_3": [
                {
                    "method": name,
                    "state": plain(state),
                    "error": _error(state),
                    "cost": _cost(state, exact),
                }
                for name, state in methods
            ],
            "figure_3": {"evolution": plain(history), "gramian": plain(course)},
            "observability": answer.to_dict(),
        },
    )


def _equations(exact: Array) -> list[Claim]:
    """Compare the model and the null vector with the print."""
    r0, v, m = (np.array(part) for part in (R0, V, M))
    path = r0 + TIMES[:, None] * v
    size = np.linalg.norm(path, axis=1)[:, None]
    field = 1e-7 * (3 * (path @ m)[:, None] * path - size**2 * m) / size**5
    rows = dipole.rows(R0, V, M, TIMES, 1.0)
    eye = np.eye(3)
    jacobian = []
    for t, r in zip(TIMES, path, strict=True):
        n = np.linalg.norm(r)
        by_r = (
            3 / n**5 * ((r @ m) * eye + np.outer(r, m) + np.outer(m, r)
                        - 5 * (r @ m) / n**2 * np.outer(r, r))
        )  # fmt: skip
        by_m = (3 * np.outer(r, r) - n**2 * eye) / n**5
        jacobian.append(1e-7 * np.hstack([by_r, t * by_r, by_m]))
    printed = np.concatenate(jacobian)
    null = np.concatenate([r0, v, 3 * m])
    unseen = float(np.linalg.norm(rows @ null) / np.linalg.norm(np.abs(rows) @ np.abs(null)))
    wrong = float(
        np.linalg.norm(rows @ np.concatenate([r0, v, m]))
        / np.linalg.norm(np.abs(rows) @ np.abs(null))
    )
    alone = analyze(dipole.problem(R0, V, M, TIMES, 1e-9))
    with_y, with_z = (
        analyze(dipole.problem(R0, V, M, TIMES, 1e-9).fix(name)) for name in ("y0", "z0")
    )
    opposite = dipole.measure(*(-2 * r0, -2 * v, -8 * m), TIMES)
    return [
        true("(5), (12): the field of a dipole at constant velocity", _off(exact, field) < 1e-12,
             f"library and print differ by {_off(exact, field):.0e} of the largest"),
        true("(19) to (21): its Jacobian, with the factor mu0 / 4 pi that (20), (21) leave out",
             _off(rows, printed) < 1e-12, f"differ by {_off(rows, printed):.0e} of the largest"),
        true("(23), (26): (r0, v, 3 m) is in the null space", unseen < 1e-14,
             f"its measurements are {unseen:.0e} of their terms; those of (r0, v, m) {wrong:.1e}"),
        true("Proposition 1: one sensor alone does not determine the state, by one direction",
             alone.nullity == 1, f"rank {alone.rank} of 9"),
        true("2.2.1: it does where y0 is known", with_y.nullity == 0, f"rank {with_y.rank} of 8"),
        true("2.2.2: it does where z0 is known", with_z.nullity == 0, f"rank {with_z.rank} of 8"),
        refuted("(28): x(u) makes the same field for every u other than 0",
                _off(opposite, -exact) < 1e-12, "at u = -2 the field has the opposite sign",
                "it holds for u > 0"),
    ]  # fmt: skip


def _off(a: Array, b: Array) -> float:
    return float(np.abs(a - b).max() / np.abs(b).max())


def _tables(family: list[dict[str, float]], ours: Array) -> list[Claim]:
    """Compare the printed estimates with the family, and with what the data determine."""
    claims = []
    for index, item in enumerate(family, start=1):
        name = f"Table 2, estimate {index}"
        printed = item["printed"]
        for key, part in (("from_r", "r0"), ("from_v", "v"), ("from_m", "m")):
            claims.append(near(f"{name}: u printed, from {part}", printed, item[key], rel=0.06))
        claims.append(
            true(
                f"{name}: it is on the family of u",
                item["off"] < 0.2,
                f"off by {item['off']:.1%}; the field missed {item['missed']:.1%}",
            )
        )
    claims.append(
        true(
            "Table 3: the printed estimate is near the truth",
            _error(TABLE_3) < 0.05,
            f"off by {_error(TABLE_3):.1%}",
        )
    )
    for i in FREE:
        scale = float(np.linalg.norm(TRUE[3 * (i // 3) : 3 * (i // 3) + 3]))
        claims.append(
            near(
                f"Table 3: {dipole.NAMES[i]}, beside what the data determine",
                TABLE_3[i],
                float(ours[i]),
                rel=0,
                floor=0.05 * scale,
            )
        )
    claims.append(
        true(
            "with z0 and vz known the data determine the pass",
            _error(ours) < 1e-8,
            f"localize is off by {_error(ours):.0e}",
        )
    )
    return claims  # fmt: skip


def _figures(apart: float, course: Array, history: Array) -> list[Claim]:
    return [
        true("Fig. 2: x and x(2) make the same data", apart < 1e-12,
             f"to {apart:.0e} of the largest"),
        true("Fig. 3: V falls with the iterations of the genetic algorithm",
             bool((np.diff(history) <= 0).all() and history[-1] < history[0]),
             f"from {history[0]:.1e} to {history[-1]:.1e} T^2 in {len(history)} generations"),
        true("Fig. 3: ours ends at rounding in fewer iterations than it takes generations",
             bool(course[-1] < 1e-25 * _power() and len(course) < len(history)),
             f"{course[-1]:.1e} T^2 after {len(course)} iterations; differential evolution is at "
             f"{history[min(len(course), len(history)) - 1]:.1e} after as many generations"),
    ]  # fmt: skip


def _power() -> float:
    """Sum of squares of the data."""
    return float((dipole.measure(R0, V, M, TIMES) ** 2).sum())


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


def _ours(exact: Array) -> tuple[Array, Array]:
    """Locate the pass, and the cost after each number of iterations until it stands still."""
    costs: list[float] = []
    for iterations in range(1, 40):
        found = dipole.localize(
            TIMES, exact, {"z": 5.0, "vz": 0.0}, sigma=1e-9, max_iterations=iterations
        )
        costs.append(_cost(np.concatenate([found.r0, found.v, found.m]), exact))
        if costs[-1] < 1e-26 * _power() or (iterations > 12 and costs[-1] >= costs[-2]):
            break
    found = dipole.localize(TIMES, exact, {"z": 5.0, "vz": 0.0})
    return np.concatenate([found.r0, found.v, found.m]), np.array(costs)


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

    history: list[float] = []

    def watch(intermediate_result: Any) -> None:
        history.append(float(intermediate_result.fun))

    result = differential_evolution(
        cost,
        BOX,
        maxiter=generations,
        popsize=POPULATION // len(FREE),
        tol=0.0,
        seed=1,
        polish=False,
        vectorized=True,
        updating="deferred",
        callback=watch,
    )
    curve = np.array(history) * (exact**2).sum()
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
