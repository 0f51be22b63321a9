"""Xu, Sheng, Chen & Tan 2009: optimal maneuver trajectories of the observer platform.

Control Theory & Applications 26 (12), 1337-1344. Tables 1 to 3 and Figures 5 to 12.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from gramian.models.maneuver import Law, Trajectory, trajectory
from gramian.report import Picture, Report, Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gramian.plot import Figure

__all__ = ["NAMED", "PRINTED", "computed", "run"]

#: Numbers of samples of the tables' columns, the first sample at the start point.
SAMPLES = (100, 200, 300, 400, 500)

#: The printed figures by table label and law, one for each of `SAMPLES`.
PRINTED: dict[str, dict[Law, tuple[str, ...]]] = {
    "|J|": {
        "hammel_liu": ("0.0022", "0.0114", "0.0294", "0.0577", "0.1010"),
        "max_det": ("0.0023", "0.0125", "0.0344", "0.0740", "0.1452"),
    },
    "J_x": {
        "hammel_liu": ("0.0624", "0.0967", "0.1679", "0.2555", "0.3271"),
        "max_det": ("0.0642", "0.1031", "0.1753", "0.2769", "0.3933"),
    },
    "J_y": {
        "hammel_liu": ("0.0418", "0.1211", "0.1750", "0.2263", "0.3110"),
        "max_det": ("0.0422", "0.1252", "0.1965", "0.2675", "0.3692"),
    },
}

#: Printed figures that are off, by label, law and samples, with what is right.
NAMED: dict[tuple[str, Law, int], str] = {
    ("J_x", "max_det", 300): "0.1750",
    ("J_x", "max_det", 400): "0.2768",
    ("J_y", "max_det", 200): "0.1254",
}

_NAMES: dict[Law, str] = {"hammel_liu": "H-L", "max_det": "P-M"}
_MEANING = {"|J|": "det J", "J_x": "J_yy", "J_y": "J_xx"}


def _case(law: Law, **change: Any) -> Trajectory:
    """Return a path of the paper's numerical example, section 5."""
    setting: dict[str, Any] = {
        "target": [0.0, 1000.0],
        "start": [0.0, 0.0],
        "speed": 20.0,
        "dt": 1.0,
        "samples": 500,
        "sigma": 0.001**0.5,
    }
    return trajectory(law=law, **(setting | change))


def computed() -> dict[str, dict[Law, list[float]]]:
    """Return what the tables should print, by their labels.

    The labels of Tables 2 and 3 are exchanged in print: "J_x" is the element of
    the north axis and "J_y" that of the east axis.
    """
    at = np.array(SAMPLES) - 1
    values: dict[str, dict[Law, list[float]]] = {"|J|": {}, "J_x": {}, "J_y": {}}
    for law in _NAMES:
        path = _case(law)
        values["|J|"][law] = path.det[at].tolist()
        values["J_x"][law] = path.information[at, 1, 1].tolist()
        values["J_y"][law] = path.information[at, 0, 0].tolist()
    return values


def run() -> Report:
    """Compute the tables and figures and compare them with the printed values."""
    ours = computed()
    equal, total, surprises, tables = 0, 0, [], []
    for number, (label, laws) in enumerate(PRINTED.items(), start=1):
        rows = []
        for law, name in _NAMES.items():
            digits = [f"{value:.4f}" for value in ours[label][law]]
            marks = []
            for k, printed, right in zip(SAMPLES, laws[law], digits, strict=True):
                total += 1
                equal += printed == right
                named = NAMED.get((label, law, k))
                if printed == right:
                    marks.append("equal")
                elif named == right:
                    marks.append("misprint")
                else:
                    marks.append("DIFFERS")
                    surprises.append(f"{label} {name} k = {k}")
            rows.append([f"{name}, printed", *laws[law]])
            rows.append([f"{name}, computed", *(f"{value:.6f}" for value in ours[label][law])])
            rows.append([f"{name}, in four digits", *marks])
        tables.append(
            Table(
                f"Table {number}: {label} as printed, which is {_MEANING[label]}",
                ["k", *(str(k) for k in SAMPLES)],
                rows,
                note=_note(label),
            )
        )
    good = not surprises
    return Report(
        title="xu-2009",
        subtitle="Optimal maneuver trajectories of the observer platform in passive localization",
        tone="good" if good else "bad",
        headline="REPRODUCED" if good else "NOT REPRODUCED",
        verdict=(
            f"{equal} of {total} printed figures are equal in their four digits; "
            f"{len(NAMED)} are misprints, named below"
            if good
            else f"these differ: {', '.join(surprises)}"
        ),
        facts=[
            ("column k", "the sum over k bearings, the first at the start point"),
            ("Tables 2 and 3", 'their labels are exchanged: "J_x" prints J_yy, "J_y" prints J_xx'),
            *(
                (
                    f"{label}, {_NAMES[law]}, k = {k}",
                    f"prints {PRINTED[label][law][SAMPLES.index(k)]}, right is {right}",
                )
                for (label, law, k), right in NAMED.items()
            ),
            (
                "H-L",
                "the paper gives no formula: heading = bearing +- (pi/2 - 1.5 atan(step / range)) "
                "gives all 15 of its figures",
            ),
        ],
        tables=tables,
        pictures=_pictures(),
        data={
            "samples": list(SAMPLES),
            "printed": PRINTED,
            "computed": ours,
            "misprints": [
                {"label": label, "law": law, "samples": k, "right": right}
                for (label, law, k), right in NAMED.items()
            ],
            "equal": equal,
            "total": total,
        },
    )


def _note(label: str) -> str:
    misprints = [f"k = {k}" for (other, _, k) in NAMED if other == label]
    return f"Misprinted in row P-M: {', '.join(misprints)}." if misprints else ""


def _pictures() -> list[Picture]:
    return [
        Picture(
            "Figure 5",
            "The right branch at V = 30 m/s: a spiral inward. The paper runs 4000 samples; "
            "the law ends where the range comes down to a step, so the path stops there.",
            lambda: _paths([("right", _case("max_det", speed=30.0, samples=4000, standoff=30.0))]),
        ),
        Picture(
            "Figure 6",
            "Both branches at V = 50 m/s: mirror images. They end at a step's range too.",
            lambda: _paths(
                [
                    (name, _case("max_det", speed=50.0, samples=500, standoff=50.0, side=side))
                    for name, side in (("right", 1), ("left", -1))
                ]
            ),
        ),
        Picture(
            "Figure 7",
            "A faster observer turns inward sooner (first range 500 m, 200 samples). "
            "The paper does not print its speeds; these are ours.",
            lambda: _paths(
                [
                    (
                        f"{speed:.0f} m/s" if side == 1 else "",
                        _case(
                            "max_det",
                            target=[0.0, 500.0],
                            speed=speed,
                            samples=200,
                            side=side,
                            standoff=speed,
                        ),
                    )
                    for speed in (5.0, 10.0, 15.0, 20.0)
                    for side in (1, -1)
                ],
                colors=2,
            ),
        ),
        Picture(
            "Figure 8",
            "The farther the target, the nearer the path is to a circle (15 m/s, 600 samples). "
            "The paper does not print its ranges; these are ours.",
            lambda: _paths(
                [
                    (
                        f"{first:.0f} m",
                        _case(
                            "max_det",
                            start=[0.0, 1000.0 - first],
                            speed=15.0,
                            samples=600,
                            standoff=15.0,
                        ),
                    )
                    for first in (600.0, 1000.0, 1500.0, 2000.0)
                ]
            ),
        ),
        Picture(
            "Figure 9",
            "The two laws in the case of the tables: P-M is the inner path.",
            lambda: _paths([(name, _case(law)) for law, name in _NAMES.items()]),
        ),
        Picture(
            "Figure 10",
            "det J of both; the printed figures as dots.",
            lambda: _curves("|J|", lambda path: path.det, "det J (1/m^4)"),
        ),
        Picture(
            "Figure 11",
            "J_yy of both, which the paper calls J_x; the printed figures as dots.",
            lambda: _curves("J_x", lambda path: path.information[:, 1, 1], "J_yy (1/m^2)"),
        ),
        Picture(
            "Figure 12",
            "J_xx of both, which the paper calls J_y; the printed figures as dots.",
            lambda: _curves("J_y", lambda path: path.information[:, 0, 0], "J_xx (1/m^2)"),
        ),
    ]


def _palette() -> list[str]:
    from gramian.plot import COLORS

    return [COLORS[name] for name in ("observer", "weak", "good", "bad")]


def _paths(paths: Sequence[tuple[str, Trajectory]], colors: int = 1) -> Figure:
    """Draw paths about the target; `colors` paths in a row share one."""
    from gramian.plot import COLORS, figure

    fig = figure(5.6, 5.4)
    axes = fig.subplots()
    palette = _palette()
    for i, (name, path) in enumerate(paths):
        flown = path.path[: int(path.count)]
        color = palette[i // colors]
        axes.plot(*flown.T, color=color, linewidth=1.2, label=name or None)
        axes.plot(*flown[0], "o", color=color, markersize=5)
    # The target is the same in all: along the first bearing at the first range.
    first = paths[0][1]
    sight = np.array([np.sin(first.bearings[0]), np.cos(first.bearings[0])])
    target = first.path[0] + first.ranges[0] * sight
    axes.plot(*target, "*", color=COLORS["target"], markersize=13, label="target")
    axes.set_aspect("equal")
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")
    axes.grid(color=COLORS["muted"], alpha=0.25)
    fig.legend(loc="outside upper center", ncols=5, fontsize="small", frameon=False)
    return fig


def _curves(label: str, of: Any, name: str) -> Figure:
    """Draw one element of the information of both laws, with the printed figures."""
    from gramian.plot import COLORS, figure

    fig = figure(6.4, 3.8)
    axes = fig.subplots()
    for color, (law, law_name) in zip(("observer", "bad"), _NAMES.items(), strict=True):
        axes.plot(np.arange(1, 501), of(_case(law)), color=COLORS[color], label=law_name)
        axes.plot(
            SAMPLES, [float(x) for x in PRINTED[label][law]], "o", color=COLORS[color], markersize=4
        )
    axes.set_xlabel("samples k")
    axes.set_ylabel(name)
    axes.grid(color=COLORS["muted"], alpha=0.25)
    axes.legend(frameon=False)
    return fig
