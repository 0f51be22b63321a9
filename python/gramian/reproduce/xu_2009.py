"""Xu, Sheng, Chen & Tan 2009: optimal maneuver trajectories of the observer platform.

Control Theory & Applications 26 (12), 1337-1344. Tables 1 to 3, Figures 1 to 12, equations
(1) to (24), Theorems 1 to 6 and the corollaries, each a comparison that can fail.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gramian.models import maneuver
from gramian.models.maneuver import Law, Trajectory
from gramian.report import Picture, Report, Table
from gramian.reproduce._claims import (
    Claim,
    claims_data,
    claims_table,
    fitted,
    near,
    refuted,
    rounded,
    true,
    verdict,
)
from gramian.reproduce._xu_theory import theory

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gramian.plot import Figure

__all__ = ["NAMED", "PRINTED", "computed", "run"]

Array = NDArray[np.float64]

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
    return maneuver.trajectory(law=law, **(setting | change))


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
    """Compute theorems, equations, tables and figures and compare each with the print."""
    ours = computed()
    figures, tables = [], []
    for index, (label, laws) in enumerate(PRINTED.items(), start=1):
        rows = []
        for law, name in _NAMES.items():
            marks = []
            for k, printed, value in zip(SAMPLES, laws[law], ours[label][law], strict=True):
                claim = rounded(
                    f"Table {index}: {label} {name}, k = {k}",
                    printed,
                    value,
                    ".4f",
                    right=NAMED.get((label, law, k)),
                    note=f"right is {value:.4f}",
                )
                figures.append(claim)
                marks.append(claim.outcome)
            rows.append([f"{name}, printed", *laws[law]])
            rows.append([f"{name}, computed", *(f"{value:.6f}" for value in ours[label][law])])
            rows.append([f"{name}, in four digits", *marks])
        tables.append(
            Table(
                f"Table {index}: {label} as printed, which is {_MEANING[label]}",
                ["k", *(str(k) for k in SAMPLES)],
                rows,
            )
        )
    proved, drawn = theory(), [*_hammel_liu(), *_figures()]
    claims = [*figures, *proved, *drawn]
    tone, headline, sentence = verdict(claims)
    return Report(
        title="xu-2009",
        subtitle="Optimal maneuver trajectories of the observer platform in passive localization",
        tone=tone,
        headline=headline,
        verdict=sentence,
        facts=[
            ("column k", "the sum over k bearings, the first at the start point"),
            ("Tables 2 and 3", 'their labels are exchanged: "J_x" prints J_yy, "J_y" prints J_xx'),
            *((claim.what, claim.note) for claim in claims if claim.outcome == "misprint"),
            *(
                (claim.what, f"refuted: {claim.computed}; {claim.note}")
                for claim in claims
                if claim.outcome == "refuted"
            ),
        ],
        tables=[
            *tables,
            claims_table("Equations (1) to (24), theorems and corollaries", proved),
            claims_table("The law of Hammel and Liu, and Figures 4 to 12", drawn),
        ],
        pictures=_pictures(),
        data={
            "samples": list(SAMPLES),
            "printed": PRINTED,
            "computed": ours,
            "claims": claims_data(claims),
        },
    )


def _hammel_liu() -> list[Claim]:
    """Show the factor that the paper does not print: fitted, and derived beside."""
    r, s = 1000.0, 1.0
    u = (np.arange(200) + 0.5) / 200
    factor = np.linspace(1, 2, 2001)
    c = np.pi / 2 - factor * np.arctan(s / r)
    after = r**2 + (s * u) ** 2 - 2 * r * s * u * np.cos(c)[:, None]
    best = float(factor[np.argmax((r * np.sin(c)[:, None] / after**1.5).mean(axis=1))])
    turn = float(maneuver.heading(0.0, r, s, "hammel_liu"))
    taken = (np.pi / 2 - turn) / float(np.arctan(s / r))
    return [
        fitted("H-L: heading = beta +- (pi/2 - f atan(s / r)), the factor f", "none",
               f"{taken:.6g}", "chosen so that all 15 figures of H-L agree"),
        near("H-L: that factor maximises the integral of abs(d beta) / r over a short leg",
             1.5, best, rel=2e-3),
        near("H-L: the law of the library has it", 1.5, taken, rel=1e-6),
    ]  # fmt: skip


def _figures() -> list[Claim]:
    """Compute what is said of each figure."""
    left, right = (_case("max_det", samples=60, side=side) for side in (-1, 1))
    spiral = _case("max_det", speed=30.0, samples=4000, standoff=30.0)
    flown = int(spiral.count)
    turned = np.unwrap(spiral.bearings[:flown])
    six = [_case("max_det", speed=50.0, standoff=50.0, side=side) for side in (1, -1)]
    speeds = (5.0, 10.0, 15.0, 20.0)
    seven = [
        _case("max_det", target=[0.0, 500.0], speed=v, samples=200, standoff=v) for v in speeds
    ]
    lost = [float(1 - p.ranges[int(p.count) - 1] / p.ranges[0]) for p in seven]
    early = [float(p.det[20] / p.det[1]) for p in seven]
    firsts = (600.0, 1000.0, 1500.0, 2000.0)
    # The share of the range lost on the same angle about the target.
    eight = []
    for first in firsts:
        path = _case("max_det", start=[0.0, 1000.0 - first], speed=15.0, samples=600, standoff=15.0)
        angle = np.abs(np.unwrap(path.bearings[: int(path.count)]) - path.bearings[0])
        eight.append(float(1 - np.interp(1.0, angle, path.ranges[: angle.size]) / first))
    hl, pm = (_case(law) for law in _NAMES)
    ratio = pm.det[1:] / hl.det[1:]
    north = pm.information[1:, 1, 1] / hl.information[1:, 1, 1]
    east = pm.information[1:, 0, 0] / hl.information[1:, 0, 0]
    mirror = float(np.abs(left.path * [-1, 1] - right.path).max())
    mirror_6 = float(np.abs(six[1].path * [-1, 1] - six[0].path).max())
    worst = max(
        float(np.linalg.norm(np.diff(p.path[: int(p.count)], axis=0), axis=1).max() / 50.0)
        for p in six
    )
    tangent, circle = (_case(law) for law in ("bearing_rate", "circle"))
    gain = np.diff(circle.det[[0, 100, 200, 300, 400, 499]])
    return [
        true("Fig. 4: left and right branch are mirror images", mirror < 1e-6,
             f"to {mirror:.0e} m"),
        true("Fig. 5: at 30 m/s the path is a spiral inward",
             bool((np.diff(spiral.ranges[:flown]) < 0).all())
             and abs(turned[-1] - turned[0]) > 2 * np.pi,
             f"{abs(turned[-1] - turned[0]) / (2 * np.pi):.2f} turns about the target, the range "
             "falls on every leg"),
        refuted("Fig. 5: the law runs 4000 samples", flown < 4000, f"{flown} samples",
                "there the range is down to a step, and alpha <= pi/4 of Theorem 1 is broken"),
        true("Fig. 6: at 50 m/s left and right are mirror images", mirror_6 < 1e-6
             and abs(worst - 1) < 1e-9, f"to {mirror_6:.0e} m"),
        true("Fig. 7: the faster, the sooner toward the target",
             bool((np.diff(lost) > 0).all()) and bool((np.diff(early) != 0).all()),
             "share of the range lost at 5, 10, 15, 20 m/s: "
             + ", ".join(f"{x:.3f}" for x in lost)),
        true("Fig. 8: the farther the target, the nearer to a circle",
             bool((np.diff(eight) < 0).all()),
             "share of the range lost over 1 rad from 600, 1000, 1500, 2000 m: "
             + ", ".join(f"{x:.3f}" for x in eight)),
        true("Fig. 9: P-M is the inner path", bool((pm.ranges[1:] < hl.ranges[1:]).all()),
             f"at the end {pm.ranges[-1]:.1f} m and {hl.ranges[-1]:.1f} m"),
        true("Fig. 10: det J of P-M is the larger for every k", bool((ratio > 1).all()),
             f"{ratio.min():.6f} to {ratio.max():.3f} times"),
        _always("Fig. 11: J_x of P-M is the larger for every k", north),
        _always("Fig. 12: J_y of P-M is the larger for every k", east),
        true("Section 5: on the circle the information grows ever slower than on P-M",
             bool(pm.det[-1] > tangent.det[-1] > circle.det[-1]) and bool(gain.min() > 0),
             f"det J of 500 bearings: P-M {pm.det[-1]:.4f}, tangent {tangent.det[-1]:.4f}, "
             f"circle {circle.det[-1]:.4f}"),
    ]  # fmt: skip


def _always(what: str, ratio: Array) -> Claim:
    """Compare at every k: refuted where it fails for some k but not at the end."""
    below = int((ratio < 1 - 1e-12).sum())
    found = f"{ratio.min():.4f} to {ratio.max():.4f} times"
    if below and ratio[-1] > 1:
        note = f"smaller at {below} of {ratio.size} k, at worst {1 - ratio.min():.2%}"
        return refuted(what, True, found, note)
    return true(what, bool(ratio[-1] > 1), found)


def _pictures() -> list[Picture]:
    return [
        Picture(
            "Figures 1 and 2",
            "One leg: O the observer, A the target, B the end of the leg of max_det, where AD "
            "meets the circle of radius s again.",
            _geometry,
        ),
        Picture(
            "Figure 3",
            "Two legs to one side, and with a change of side.",
            lambda: _paths(
                [
                    (name, _case("max_det", speed=300.0, samples=3, sides=sides))
                    for name, sides in (("kept", [1, 1]), ("changed", [1, -1]))
                ]
            ),
        ),
        Picture(
            "Figure 4",
            "The two branches from one place.",
            lambda: _paths(
                [
                    (name, _case("max_det", samples=60, side=side))
                    for name, side in (("right", 1), ("left", -1))
                ]
            ),
        ),
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


def _geometry() -> Figure:
    """Draw Figures 1 and 2."""
    from gramian.plot import COLORS, figure

    fig = figure(5.0, 5.0)
    axes = fig.subplots()
    target, s = np.array([0.0, 100.0]), 50.0
    turn = float(maneuver.heading(0.0, 100.0, s))
    end, side = s * np.array([np.sin(turn), np.cos(turn)]), np.array([s, 0.0])
    circle = np.linspace(0, 2 * np.pi, 200)
    axes.plot(s * np.sin(circle), s * np.cos(circle), color=COLORS["muted"], linewidth=0.8)
    for a, b, style in (((0, 0), target, ":"), ((0, 0), side, ":"), (side, target, ":"),
                        ((0, 0), end, "-")):  # fmt: skip
        axes.plot(*np.stack([a, b]).T, style, color=COLORS["observer"])
    for name, place in (("O", (0, 0)), ("A", target), ("D", side), ("B", end)):
        axes.annotate(
            name, (float(place[0]), float(place[1])), textcoords="offset points", xytext=(4, 4)
        )
    axes.set_aspect("equal")
    return fig


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
