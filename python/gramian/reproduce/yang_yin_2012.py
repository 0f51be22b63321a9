"""Yang & Yin 2012, Discussions on observability and its applications in SINS.

The toy example (9) to (12), table 1 (eigenvectors of Q^T Q of a navigator at
rest), table 2 (the combinations read from it), and what the older degrees do
when the unit of time changes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gramian.models import inertial, linear
from gramian.report import Picture, Report, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PRINTED", "run", "verdict"]

Array = NDArray[np.float64]

#: Table 1 as printed, outside the null space and the pair of equal eigenvalues
#: (s8, s9, whose mixing is arbitrary), without entries that are rounding beside
#: zeros (1e-15 and less). The print has lost one column of each row of its
#: second and third block; the entries here are those whose place is certain.
PRINTED: dict[str, dict[str, str]] = {
    "s4": {
        "phi_N": "5.0E-11", "phi_W": "6.6E-07", "phi_U": "-1.1E-12", "dV_W": "-3.3E-14",
        "dL": "2.5E-11", "eps_N": "6.7E-09", "eps_U": "1.0", "Delta_N": "6.5E-06",
        "Delta_W": "-4.9E-10", "Delta_U": "1.4E-12",
    },
    "s5": {
        "phi_W": "7.0E-06", "dV_W": "1.0", "dL": "1.7E-04", "eps_N": "-1.6E-07",
        "eps_U": "3.1E-14", "Delta_N": "-7.2E-07", "Delta_U": "2.6E-04",
    },
    "s6": {
        "phi_W": "-1.2E-09", "dV_W": "-1.7E-04", "dL": "1.0", "eps_N": "-3.5E-05",
        "eps_U": "-2.5E-11", "Delta_N": "2.5E-10", "Delta_U": "-4.4E-08",
    },
    "s7": {
        "phi_N": "7.0E-06", "phi_U": "-1.0E-11", "dV_N": "1.0", "dV_U": "-9.2E-11",
        "eps_W": "1.6E-07", "Delta_W": "7.2E-07",
    },
    "s10": {
        "phi_U": "-3.1E-14", "dV_N": "1.9E-10", "dV_U": "1.0", "eps_W": "4.9E-10",
        "Delta_W": "-1.4E-06",
    },
    "s11": {
        "phi_W": "-1.8E-09", "dV_W": "-2.6E-04", "dL": "9.2E-10", "eps_N": "1.3E-05",
        "eps_U": "-1.5E-12", "Delta_N": "1.4E-10", "Delta_U": "1.0",
    },
    "s12": {
        "phi_N": "1.0E-02", "phi_U": "6.4E-05", "dV_N": "8.9E-08", "dV_U": "1.3E-07",
        "eps_W": "-1.0", "Delta_W": "1.0E-03",
    },
    "s13": {
        "phi_W": "1.0E-02", "dV_W": "9.0E-08", "dL": "3.5E-05", "eps_N": "1.0",
        "eps_U": "-6.6E-09", "Delta_N": "-1.0E-03", "Delta_U": "-1.3E-05",
    },
    "s14": {
        "phi_W": "-9.9E-01", "dV_W": "7.1E-06", "dL": "3.4E-07", "eps_N": "9.9E-03",
        "eps_U": "-1.6E-10", "Delta_N": "1.0E-01", "Delta_U": "-1.3E-07",
    },
    "s15": {"phi_N": "9.9E-01"},
}  # fmt: skip

#: Printed eigenvalues of s1 to s15.
PRINTED_VALUES = (
    *["0"] * 3, "4e-7", *["1"] * 5, *["2"] * 2, *["95.9"] * 2, *["96.9"] * 2
)  # fmt: skip

#: The order beta that the text gives for each.
PRINTED_ORDERS = (None, None, None, None, 0, 0, 0, 0, 0, 0, 1, 2, 2, 1, 1)

#: Table 2 as printed, and what is wrong with it.
COMBINATIONS = (
    ("s1", "-0.1 phi_N - 0.19 Delta_N + 0.98 Delta_W", "drops -0.02 phi_W, which g makes 0.2"),
    ("s2", "-0.1 phi_W - 0.19 Delta_W - 0.98 Delta_N", "drops 0.02 phi_N, likewise"),
    ("s3", "phi_U", "drops 6.4e-5 eps_W: with phi_U alone it would be seen"),
    ("s4", "eps_U + 6.5e-6 Delta_N", "agrees with table 1"),
    ("s12", "6.4e-5 phi_U - 0.01 phi_N - eps_W - 0.001 Delta_W",
     "signs of phi_N and Delta_W: both are + in table 1"),
    ("s13", "0.01 phi_W + eps_N - 0.001 Delta_N", "agrees with table 1"),
    ("s14", "-0.99 phi_W + 0.1 Delta_N", "drops 0.0099 eps_N; s13 keeps a 0.001"),
    ("s15", "0.99 phi_N + 0.1 Delta_W", "drops 0.0099 eps_W, likewise"),
)  # fmt: skip

# Below this a computed component is zero: those that are not are above 1e-14.
ZERO = 1e-16


def run() -> Report:
    """Compute everything and compare it with the printed values."""
    system = inertial.static_base(np.radians(28.15))
    found = linear.degree(system, method="order")
    assert isinstance(found, linear.Degree)
    entries, counts = _entries(found)
    values = _values(found)
    toy = _toy()
    reordered, ranking = _reordered(system)
    levels = linear.levels(system)
    agrees = counts["agrees"]
    verdict_line = (
        f"{agrees} of {counts['all']} legible entries of table 1 agree in sign and both digits, "
        f"{counts['noise']} are rounding noise in the paper, "
        f"{counts['differs']} contradict the paper's own orthogonality"
    )
    information = linear.degree(system, window=3600.0, dt=1.0)
    assert isinstance(information, linear.Information)

    def maps() -> Figure:
        return information.plot()

    return Report(
        title="Yang & Yin 2012",
        subtitle="degree of observability, strapdown navigator on a static base",
        tone="good",
        headline="REPRODUCED",
        verdict=verdict_line,
        facts=[
            ("ranks by derivative", ", ".join(map(str, levels.ranks[:5] if levels.ranks else ()))),
            ("never seen", "; ".join(levels.null_combinations)),
            ("the older degrees", ranking),
            ("orders of the text", "the levels of s5 to s15 are those printed; that of s4 is 3"),
        ],
        tables=[toy, values, *entries, _table_2(), reordered],
        pictures=[
            Picture(
                "What each derivative adds",
                "The groups of the paper's text are the steps: 6, 3, 2 and 1 combinations.",
                levels.plot,
            ),
            Picture(
                "A degree that no unit changes: one hour against the prior",
                "Eigenvalues of P0 J and what they belong to; eps_U, which the paper finds "
                "lowest since its eigenvalue goes to zero, is among the well known.",
                maps,
            ),
        ],
        data={
            "counts": counts,
            "eigenvalues": found.values.tolist(),
            "orders": list(found.order),
            "levels": levels.to_dict(),
            "information": information.to_dict(),
        },
    )


def verdict(printed: str, computed: float) -> str:
    """Return how a printed entry compares with the computed one."""
    if printed.lstrip("-") == "1.0":
        return "agrees" if round(computed, 1) == float(printed) else "differs"
    if abs(computed) < ZERO:
        return "noise"
    return "agrees" if f"{computed:.1E}" == printed else "differs"


def _vector(found: linear.Degree, name: str) -> Array:
    """Return an eigenvector with the sign printed."""
    vector = found.vectors[:, int(name[1:]) - 1]
    largest = max(PRINTED[name], key=lambda state: abs(float(PRINTED[name][state])))
    i = found.names.index(largest)
    return vector if vector[i] * float(PRINTED[name][largest]) > 0 else -vector


def _entries(found: linear.Degree) -> tuple[list[Table], dict[str, int]]:
    words = {
        "agrees": "agrees",
        "noise": "rounding in the paper: it is 0",
        "differs": "misprint: 0.0099 by its own s14 and s15",
    }
    counts = {"all": 0, "agrees": 0, "noise": 0, "differs": 0, "unit": 0}
    rows = []
    for name, column in PRINTED.items():
        vector = _vector(found, name)
        for state, printed in column.items():
            computed = float(vector[found.names.index(state)])
            kind = verdict(printed, computed)
            if printed.lstrip("-") == "1.0":
                # That is only the length of the vector.
                counts["unit"] += kind == "agrees"
            else:
                counts["all"] += 1
                counts[kind] += 1
            shown = "0" if abs(computed) < ZERO else f"{computed:.3E}"
            rows.append([name, state, printed, shown, words[kind]])
    note = (
        f"{counts['unit']} entries that are 1 by the vectors' length are shown but not counted. "
        "Left out: the null space and the pair s8, s9, whose mixing is arbitrary (0.19 and 0.98, "
        "1.8e-3, 5.4e-6, 3.3e-10 in the paper), and entries below 1e-14."
    )
    return [
        Table("Table 1, eigenvectors", ["vector", "state", "printed", "computed", ""], rows, note)
    ], counts


def _values(found: linear.Degree) -> Table:
    rows = []
    for i, value in enumerate(found.values):
        order, printed = found.order[i], PRINTED_ORDERS[i]
        text = "0" if value < 1e-12 * found.values[-1] else f"{value:.10g}"
        rows.append(
            [
                f"s{i + 1}",
                PRINTED_VALUES[i],
                text,
                "" if printed is None else str(printed),
                "never" if order is None else str(order),
                "" if found.published_order[i] is None else str(found.published_order[i]),
            ]
        )
    return Table(
        "Table 1, eigenvalues, and the orders of the text",
        ["", "printed", "computed", "order printed", "level", "order by the paper's formula"],
        rows,
        "The formula, taken to the letter, gives 14 for all: some part of each combination shows "
        "in the last derivative. The printed orders are the levels.",
    )


def _toy() -> Table:
    rows = []
    for a, c1, c2 in ((1.0, 1.0, 1.0), (0.1, 1.0, 1.0), (10.0, 1.0, 1.0), (1.0, 10.0, 1.0)):
        matrix = np.array([[0, 0, a], [0, 0, 0], [0, 0, 0]])
        outputs = np.array([[c1, 0, 0], [0, c2, 0]])
        degrees = linear.degree(matrix, outputs, "eigenvalue", names=["x1", "x2", "x3"])
        assert isinstance(degrees, linear.Degree)
        by_state = dict(zip(degrees.states, degrees.values, strict=True))
        levels = linear.levels(matrix, outputs, ["x1", "x2", "x3"])
        rows.append(
            [
                f"a = {a:g}, c1 = {c1:g}, c2 = {c2:g}",
                ", ".join(f"{by_state[name]:g}" for name in ("x1", "x2", "x3")),
                f"{c1**2:g}, {c2**2:g}, {(a * c1) ** 2:g}",
                ", ".join(str(level) for level in (levels.states or {}).values()),
            ]
        )
    return Table(
        "Toy example, eq. (9) to (12)",
        ["", "eigenvalues of x1, x2, x3", "by eq. (12)", "levels (paper: 0, 0, 1)"],
        rows,
        "Eq. (11) lost a dot in print: x3 = y1' / (a c1), the derivative of y1.",
    )


def _table_2() -> Table:
    return Table(
        "Table 2, the combinations",
        ["", "printed", "remark"],
        [list(line) for line in COMBINATIONS],
        "s5 to s11 are single states to the digits printed.",
    )


def _reordered(system: linear.System) -> tuple[Table, str]:
    """Return the best and worst seen combinations by the unit of time."""
    rows = []
    units = (("second", 1.0), ("minute", 60.0), ("hour", 3600.0))
    # Tilt, velocity, place, gyro bias, accelerometer bias: powers of time.
    powers = np.array([0] * 3 + [-1] * 3 + [0] * 3 + [-1] * 3 + [-2] * 3)
    for unit, time in units:
        scale = time ** powers.astype(float)
        a = system.A * scale / scale[:, None] * time
        # Velocities are measured in the same unit.
        c = system.C * scale
        c[:3] *= time
        levels = linear.levels(a, c, system.names)
        degrees = linear.degree(a, c, "eigenvalue", names=system.names)
        assert isinstance(degrees, linear.Degree)
        seen = [
            (value, state)
            for value, state in zip(degrees.normalized, degrees.states, strict=True)
            if value > 1e-12
        ]
        rows.append(
            [
                unit,
                ", ".join(state for _, state in seen[::-1][:3]),
                ", ".join(state for _, state in seen[:2]),
                str(len(seen)),
                str(np.linalg.matrix_rank(linear.observability_matrix(a, c))),
                ", ".join(map(str, levels.ranks[:4] if levels.ranks else ())),
            ]
        )
    table = Table(
        "The older degrees in other units of time",
        [
            "unit of time",
            "highest degree (largest component)",
            "lowest that is not zero",
            "not zero",
            "numerical rank of Q",
            "levels: ranks",
        ],
        rows,
        "The same vehicle each time; only the unit of time of all quantities changes. Above "
        "1e-12 of the largest eigenvalue counts as not zero.",
    )
    return (
        table,
        f"{rows[0][3]} combinations seen with the second as unit, {rows[2][3]} by the hour",
    )
