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
from gramian.reproduce._claims import (
    Claim,
    Outcome,
    claims_data,
    claims_table,
    fitted,
    near,
    refuted,
    true,
)
from gramian.reproduce._claims import verdict as overall

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PRINTED", "run", "verdict"]

Array = NDArray[np.float64]

#: The paper does not print its latitude: the one that its tables fit.
LATITUDE = 28.15

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

#: The columns of the null space, s1 to s3, by their entries above rounding. Their mixing is
#: arbitrary, so that they are compared with the computed null space and not entry by entry.
NULL: dict[str, dict[str, float]] = {
    "s1": {
        "phi_N": -1.0e-1, "phi_W": -2.0e-2, "phi_U": -2.0e-4, "eps_N": -6.8e-7, "eps_W": 3.4e-6,
        "eps_U": 1.3e-6, "Delta_N": -1.9e-1, "Delta_W": 9.8e-1,
    },
    "s2": {
        "phi_N": 2.0e-2, "phi_W": -1.0e-1, "phi_U": -2.4e-4, "eps_N": -3.4e-6, "eps_W": -6.9e-7,
        "eps_U": 6.4e-6, "Delta_N": -9.8e-1, "Delta_W": -1.9e-1,
    },
    "s3": {
        "phi_N": -1.5e-5, "phi_W": -2.8e-5, "phi_U": 1.0, "eps_N": -9.7e-10, "eps_W": 6.4e-5,
        "eps_U": 1.8e-9, "Delta_N": -2.8e-4, "Delta_W": 1.5e-4,
    },
}  # fmt: skip

#: Printed eigenvalues of s1 to s15.
PRINTED_VALUES = (
    *["0"] * 3, "4e-7", *["1"] * 5, *["2"] * 2, *["95.9"] * 2, *["96.9"] * 2
)  # fmt: skip

#: The order beta that the text gives for each.
PRINTED_ORDERS = (None, None, None, None, 0, 0, 0, 0, 0, 0, 1, 2, 2, 1, 1)

#: Table 2 as printed: the combination of each row.
COMBINATIONS: dict[str, dict[str, str]] = {
    "s1": {"phi_N": "-0.1", "Delta_N": "-0.19", "Delta_W": "0.98"},
    "s2": {"phi_W": "-0.1", "Delta_W": "-0.19", "Delta_N": "-0.98"},
    "s3": {"phi_U": "1"},
    "s4": {"eps_U": "1", "Delta_N": "6.5e-6"},
    "s5": {"dV_W": "1"},
    "s6": {"dL": "1"},
    "s7": {"dV_N": "1"},
    "s8": {"dh": "1"},
    "s9": {"dlambda": "1"},
    "s10": {"dV_U": "1"},
    "s11": {"Delta_U": "1"},
    "s12": {"phi_U": "6.4e-5", "phi_N": "-0.01", "eps_W": "-1", "Delta_W": "-0.001"},
    "s13": {"phi_W": "0.01", "eps_N": "1", "Delta_N": "-0.001"},
    "s14": {"phi_W": "-0.99", "Delta_N": "0.1"},
    "s15": {"phi_N": "0.99", "Delta_W": "0.1"},
}

# Below this a computed component is zero: those that are not are above 1e-14.
ZERO = 1e-16


def run() -> Report:
    """Compute everything and compare it with the printed values."""
    system = inertial.static_base(np.radians(LATITUDE))
    found = linear.degree(system, method="order")
    assert isinstance(found, linear.Degree)
    entries, counts = _entries(found)
    toy_table, toy = _toy()
    reordered, ranking, units = _reordered(system)
    levels = linear.levels(system)
    q = linear.observability_matrix(system)
    groups = {
        "Table 1, eigenvectors": entries,
        "Table 1, eigenvalues and orders": [*_values(found), *_orders(found)],
        "Table 1, the null space": _null_columns(q),
        "Table 2, the combinations": _table_2(found, q),
        "Toy example, equations (9) to (12)": toy,
        "The text": [
            fitted("the latitude", "none", f"{LATITUDE:g} deg",
                   "chosen so that the eigenvalues and eigenvectors agree"),
            true("the orders come in groups of 6, 3, 2 and, for s4, 1",
                 tuple(levels.ranks[:4] if levels.ranks else ()) == (6, 9, 11, 12),
                 f"ranks {', '.join(map(str, levels.ranks[:5] if levels.ranks else ()))}"),
            true("three combinations are never seen", len(levels.null_combinations) == 3,
                 "; ".join(levels.null_combinations)),
            units,
        ],
    }  # fmt: skip
    claims = [claim for group in groups.values() for claim in group]
    tone, headline, sentence = overall(claims)
    information = linear.degree(system, window=3600.0, dt=1.0)
    assert isinstance(information, linear.Information)

    def maps() -> Figure:
        return information.plot()

    return Report(
        title="Yang & Yin 2012",
        subtitle="degree of observability, strapdown navigator on a static base",
        tone=tone,
        headline=headline,
        verdict=sentence,
        facts=[
            ("ranks by derivative", ", ".join(map(str, levels.ranks[:5] if levels.ranks else ()))),
            ("never seen", "; ".join(levels.null_combinations)),
            ("the older degrees", ranking),
            ("the paper's formula of the order",
             "to the letter it gives 14 for nearly all: some part of each combination shows in "
             "the last derivative; the printed orders are the levels"),
        ],
        tables=[
            toy_table,
            _values_table(found),
            *(claims_table(title, group) for title, group in groups.items()),
            reordered,
        ],
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
            "claims": claims_data(claims),
            "counts": counts,
            "eigenvalues": found.values.tolist(),
            "orders": list(found.order),
            "levels": levels.to_dict(),
            "information": information.to_dict(),
        },
    )  # fmt: skip


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


def _entries(found: linear.Degree) -> tuple[list[Claim], dict[str, int]]:
    counts = {"all": 0, "agrees": 0, "noise": 0, "differs": 0, "unit": 0}
    claims = []
    # What rounding of Q^T Q leaves in the eigenvector of s4, beside eigenvalues of zero.
    left = np.finfo(float).eps * found.values[-1] / found.values[3]
    # s13 and s14 are orthogonal, and s12 and s15 likewise: what that makes of the print.
    fourteen = {state: float(text) for state, text in PRINTED["s14"].items()}
    implied = (fourteen["eps_N"] - 1e-3 * fourteen["Delta_N"]) / -fourteen["phi_W"]
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
            outcome: Outcome = "FAILS"
            note = ""
            if kind == "agrees":
                outcome = "holds"
            elif kind == "noise" and abs(float(printed)) < left:
                outcome, note = "misprint", f"it is 0; double precision leaves {left:.0e} of it"
            elif (name, state) in {("s12", "phi_N"), ("s13", "phi_W")} and (
                abs(computed - implied) < 1e-4
            ):
                outcome, note = "misprint", f"orthogonal to the print of s14 it is {implied:.5f}"
            shown = "0" if abs(computed) < ZERO else f"{computed:.3E}"
            claims.append(Claim(f"{name}, {state}", printed, shown, outcome, note))
    return claims, counts


def _values(found: linear.Degree) -> list[Claim]:
    """Compare the eigenvalues in the digits printed; whole numbers to 1e-6."""
    claims = []
    for i, (printed, value) in enumerate(zip(PRINTED_VALUES, found.values, strict=True)):
        floor = {"0": 1e-12 * found.values[-1], "4e-7": 0.5e-7}.get(printed)
        if floor is None:
            floor = 0.05 if "." in printed else 1e-6
        claims.append(near(f"eigenvalue of s{i + 1}", float(printed), value, rel=0, floor=floor))
    return claims


def _orders(found: linear.Degree) -> list[Claim]:
    return [
        true(f"order of s{i + 1} is {printed}", found.order[i] == printed, str(found.order[i]))
        for i, printed in enumerate(PRINTED_ORDERS)
        if printed is not None
    ]


def _null_columns(q: Array) -> list[Claim]:
    """Compare the printed columns of s1 to s3 with the computed null space."""
    names = list(inertial.NAMES)
    null = _null_space(q)
    claims = []
    for name, column in NULL.items():
        v = np.array([column.get(state, 0.0) for state in names])
        off = float(np.linalg.norm(v - null @ (null.T @ v)) / np.linalg.norm(v))
        # What the printed digits of its entries leave.
        least = 1e-6 if name == "s3" else 1e-3
        claims.append(true(f"{name} lies in the null space", off < least, f"off by {off:.0e}"))
    return claims


def _table_2(found: linear.Degree, q: Array) -> list[Claim]:
    names = list(found.names)
    claims = []
    for name, terms in COMBINATIONS.items():
        stated = np.array([float(terms.get(state, 0.0)) for state in names])
        if name in NULL:
            # Whether it is unseen, to what the digits leave: 0.1 is 1.0E-01 in table 1.
            seen = float(np.linalg.norm(q @ stated))
            allowed = sum(
                0.005 * float(np.linalg.norm(q[:, names.index(state)]))
                for state, text in terms.items()
                if text != "1"
            )
            claims.append(
                refuted(
                    f"{name} = {_words(terms)} is not seen",
                    seen > 1.5 * allowed,
                    f"norm of its measurements {seen:.2g}, digits leave {allowed:.2g}",
                    "terms of the null space are dropped that the measurements show",
                )
            )
            continue
        if name in ("s8", "s9"):
            # Equal eigenvalues: any mixture of the two.
            pair = found.vectors[:, 7:9]
            part = float(np.linalg.norm(pair[names.index(next(iter(terms)))]))
            claims.append(near(f"{name} = {_words(terms)}, within s8 and s9", 1.0, part, rel=1e-5))
            continue
        vector = _vector(found, name)
        for state, text in terms.items():
            claims.append(_coefficient(name, state, text, float(vector[names.index(state)])))
        rest = np.where(stated == 0, np.abs(vector), 0)
        left_out = names[int(rest.argmax())]
        least = min(abs(float(text)) for text in terms.values())
        what = f"{name} = {_words(terms)}: what is left out is smaller than what is kept"
        size = f"largest left out: {rest.max():.2g} {left_out}"
        claims.append(true(what, bool(rest.max() < least), size))
    return claims


def _coefficient(name: str, state: str, printed: str, computed: float) -> Claim:
    """Compare one coefficient in its printed digits; a sign alone that is wrong is a misprint."""
    half = _half_unit(printed) or 0.005
    value, what = float(printed), f"{name}, coefficient of {state}"
    right = -value if abs(computed + value) <= half < abs(computed - value) else None
    return near(what, value, computed, rel=0, floor=half, right=right,
                note="the sign: table 1 has the other")  # fmt: skip


def _half_unit(text: str) -> float:
    """Return half a unit of the last digit printed; 0 for a coefficient of 1 not printed."""
    if text.lstrip("-") == "1":
        return 0.0
    mantissa, _, exponent = text.partition("e")
    places = len(mantissa.partition(".")[2])
    return 0.5 * 10.0 ** (int(exponent or 0) - places)


def _words(terms: dict[str, str]) -> str:
    return " + ".join(
        (f"{text} " if text.lstrip("-") != "1" else text.replace("1", "")) + state
        for state, text in terms.items()
    ).replace("+ -", "- ")


def _null_space(q: Array) -> Array:
    """Return the null space (n, 3) of the seen levels, from the scaled rows."""
    # Each derivative is scaled by its size: the last powers are far below rounding.
    blocks = q.reshape(-1, 6, q.shape[1])
    scaled = np.concatenate([b / max(float(np.abs(b).max()), 1e-300) for b in blocks[:4]])
    null: Array = np.linalg.svd(scaled)[2][-3:].T
    return null


def _values_table(found: linear.Degree) -> Table:
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
    )


def _toy() -> tuple[Table, list[Claim]]:
    rows, claims = [], []
    names = ["x1", "x2", "x3"]
    for a, c1, c2 in ((1.0, 1.0, 1.0), (0.1, 1.0, 1.0), (10.0, 1.0, 1.0), (1.0, 10.0, 1.0)):
        matrix = np.array([[0, 0, a], [0, 0, 0], [0, 0, 0]])
        outputs = np.array([[c1, 0, 0], [0, c2, 0]])
        degrees = linear.degree(matrix, outputs, "eigenvalue", names=names)
        assert isinstance(degrees, linear.Degree)
        by_state = dict(zip(degrees.states, degrees.values, strict=True))
        found = linear.levels(matrix, outputs, names).states or {}
        case = f"a = {a:g}, c1 = {c1:g}, c2 = {c2:g}"
        printed = (c1**2, c2**2, (a * c1) ** 2)
        for name, value in zip(names, printed, strict=True):
            claims.append(near(f"(12): eigenvalue of {name}, {case}", value, by_state[name]))
        order = [found[name] for name in names]
        claims.append(true(f"(10), (11): derivatives 0, 0, 1 give x1, x2, x3, {case}",
                           order == [0, 0, 1], ", ".join(map(str, order))))  # fmt: skip
        rows.append(
            [
                case,
                ", ".join(f"{by_state[name]:g}" for name in names),
                ", ".join(f"{value:g}" for value in printed),
                ", ".join(map(str, order)),
            ]
        )
    # (11) at x = (2, 3, 5): y1 = c1 x1, its derivative a c1 x3.
    a, c1, x = 0.1, 10.0, np.array([2.0, 3.0, 5.0])
    rate = np.array([[0, 0, a], [0, 0, 0], [0, 0, 0]]) @ x
    claims.append(
        near("(11): x3 = y1 / (a c1), at x = (2, 3, 5)", c1 * x[0] / (a * c1), float(x[2]),
             right=float(c1 * rate[0] / (a * c1)), note="a dot is lost: the derivative of y1")
    )  # fmt: skip
    table = Table(
        "Toy example, eq. (9) to (12)",
        ["", "eigenvalues of x1, x2, x3", "by eq. (12)", "levels (paper: 0, 0, 1)"],
        rows,
    )
    return table, claims


def _reordered(system: linear.System) -> tuple[Table, str, Claim]:
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
    ranks = {row[5] for row in rows}
    return (
        table,
        f"{rows[0][3]} combinations seen with the second as unit, {rows[2][3]} by the hour",
        true(
            "eigenvalues of different states do not compare: the unit of time orders them anew",
            len({row[1] for row in rows}) > 1 and len(ranks) == 1,
            f"highest: {'; '.join(row[1] for row in rows)}; the levels stay",
        ),
    )
