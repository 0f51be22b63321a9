"""Equations (1) to (24), Theorems 1 to 6 and the corollaries of Xu et al. 2009, each compared.

Every right side is computed here as it is printed; every left side by the library, or by its
definition where the library has no part in it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import bounds
from gramian.models import maneuver
from gramian.reproduce._claims import Claim, near, refuted, true

__all__ = ["CASE", "theory"]

Array = NDArray[np.float64]

#: The case of the tables: target, start, speed, interval, variance of a bearing.
CASE = {"target": [0.0, 1000.0], "start": [0.0, 0.0], "speed": 20.0, "dt": 1.0}
R = 0.001
#: One leg, far from small steps, so that no approximation passes for an equality.
BETA, RANGE, STEP = 0.4, 100.0, 30.0
ALPHA = float(np.arctan2(STEP, RANGE))


def theory() -> list[Claim]:
    """Return the claims in the paper's order."""
    return [*_information(), *_one_leg(), *_two_legs(), *_trajectories(), *_bearing_rate()]


def _off(a: Array | float, b: Array | float) -> float:
    """Return the largest difference over the largest entry."""
    a, b = np.asarray(a), np.asarray(b)
    return float(np.abs(a - b).max() / max(np.abs(b).max(), 1e-300))


def _equal(what: str, a: Array | float, b: Array | float, tolerance: float = 1e-9) -> Claim:
    off = _off(a, b)
    return true(what, off <= tolerance, f"both sides differ by {off:.0e} of the largest")


def _path(
    law: maneuver.Law = "max_det", samples: int = 40, **change: object
) -> maneuver.Trajectory:
    setting: dict[str, Any] = {**CASE, "samples": samples, "sigma": R**0.5, **change}
    return maneuver.trajectory(law=law, **setting)


def _bearing(at: Array, target: Array) -> Array:
    """Equation (7) without noise."""
    angle: Array = np.arctan2(target[..., 0] - at[..., 0], target[..., 1] - at[..., 1])
    return angle


def _information() -> list[Claim]:
    path = _path()
    target = np.array(CASE["target"])
    at, b, r = path.path, path.bearings, path.ranges
    h = 1e-3
    numeric = np.stack(
        [
            (_bearing(at, target + h * e) - _bearing(at, target - h * e)) / (2 * h)
            for e in np.eye(2)
        ],
        axis=1,
    )
    rows = np.stack([np.cos(b) / r, -np.sin(b) / r], axis=1)
    other = np.stack([target[1] - at[:, 1], -(target[0] - at[:, 0])], axis=1) / (r**2)[:, None]
    increments = rows[:, :, None] * rows[:, None, :] / R
    total = path.information[-1]
    # (1) for linear estimators: the weighted least squares reaches the bound, another
    # unbiased one does not go below.
    weights = 1 + np.arange(len(b)) % 5
    gain = np.linalg.solve((rows.T * weights) @ rows, rows.T * weights)
    excess = np.linalg.eigvalsh(R * gain @ gain.T - np.linalg.inv(total))
    # (2), (3): the expectation of minus the second derivative of the log-likelihood. In the
    # noise it is linear, so that two opposite draws give the expectation exactly.
    found = np.zeros((2, 2))
    noise = R**0.5 * np.cos(7.0 * np.arange(len(b)))
    step = 0.5

    def minus_log(x: Array, sign: float) -> float:
        return float(((b + sign * noise - _bearing(at, x)) ** 2).sum() / (2 * R))

    for i, e in enumerate(np.eye(2) * step):
        for j, d in enumerate(np.eye(2) * step):
            found[i, j] = np.mean(
                [
                    minus_log(target + e + d, s) - minus_log(target + e - d, s)
                    - minus_log(target - e + d, s) + minus_log(target - e - d, s)
                    for s in (1.0, -1.0)
                ]
            ) / (4 * step**2)  # fmt: skip
    return [
        true(
            "(1): P - J^-1 is positive semidefinite, of an unbiased estimator that is not the best",
            excess.min() >= -1e-9 * excess.max() and excess.max() > 0,
            f"eigenvalues of the difference {excess.min():.2e}, {excess.max():.2e} m^2",
        ),
        _equal("(2), (3): J is the mean of -grad grad' ln p, by differences", found, total, 1e-4),
        *_recursion(rows),
        _equal(
            "(6): a leg goes V dt (sin C, cos C)",
            np.diff(at, axis=0),
            20.0 * np.stack([np.sin(path.headings), np.cos(path.headings)], axis=1),
        ),
        _equal("(7): the bearing is atan((xT - x) / (yT - y))", b, _bearing(at, target), 1e-12),
        _equal("(8): J is the sum of H'H / R", total, increments.sum(axis=0)),
        _equal("(9): H is the derivative of the bearing, by differences", numeric, rows, 1e-6),
        _equal("(9): H by coordinates and by bearing and range", other, rows),
        _equal("(10): J grows by H'H / R", np.diff(path.information, axis=0), increments[1:]),
    ]


def _recursion(rows: Array) -> list[Claim]:
    """Equations (4) and (5) against the library's bound, which never inverts Q."""
    f = np.eye(2) + np.array([[0.0, 0.02], [0.0, 0.0]])
    q = np.diag([4.0, 1.0])
    inverse = np.linalg.inv(q)
    information = np.diag([1e-4, 1e-4])
    whitened = rows / R**0.5
    j = information + np.outer(whitened[0], whitened[0])
    for row in whitened[1:]:
        d11, d12, d33 = f.T @ inverse @ f, -f.T @ inverse, inverse
        j = d33 - d12.T @ np.linalg.solve(j + d11, d12) + np.outer(row, row)
    ours = bounds.posterior(whitened[:, None, :], f, q, [100.0, 100.0]).std[-1]
    printed = np.sqrt(np.diag(np.linalg.inv(j)))
    return [_equal("(4), (5): the recursion of the posterior bound", ours, printed, 1e-8)]


def _det(heading: Array | float, beta: float, r: float, s: float) -> Array:
    """Return the determinant after (11), as printed, times R^2."""
    off = np.asarray(heading) - beta
    inner = s**2 * np.sin(off) ** 2 + (r - s * np.cos(off)) ** 2
    printed: Array = s**2 * np.sin(off) ** 2 / (r**2 * inner**2)
    return printed


def _leg(heading: float, beta: float = BETA) -> tuple[Array, float, Array]:
    """Return where a leg from the origin ends, the bearing there, and the range."""
    target = RANGE * np.array([np.sin(beta), np.cos(beta)])
    end = STEP * np.array([np.sin(heading), np.cos(heading)])
    return end, float(_bearing(end, target)), np.hypot(*(target - end))


def _heading(law: maneuver.Law = "max_det", side: int = 1) -> float:
    return float(maneuver.heading(BETA, RANGE, STEP, law, side))


def _one_leg() -> list[Claim]:
    target = RANGE * np.array([np.sin(BETA), np.cos(BETA)])
    at = np.array([[0.0, 0.0], STEP * np.array([np.sin(1.1), np.cos(1.1)])])
    exact = float(maneuver.fisher_det(at, target, 1.0))
    headings = BETA + np.linspace(-np.pi, np.pi, 200_001)
    values = _det(headings, BETA, RANGE, STEP)
    tops = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] > values[2:])) + 1
    found = np.sort(headings[tops])
    ours = np.array([_heading(side=-1), _heading()])
    right, left = _leg(ours[1]), _leg(ours[0])
    # Fig. 2: D on the circle about O with OD perpendicular to OA; B where AD meets it again.
    d = STEP * np.array([np.cos(BETA), -np.sin(BETA)])
    along = (target - d) / np.linalg.norm(target - d)
    b = d - 2 * (d @ along) * along
    half = -(d @ along) * along + d
    angles = [
        float(np.arccos(np.clip(u @ v / np.linalg.norm(u) / np.linalg.norm(v), -1, 1)))
        for u, v in ((d, half), (b, half), (-target, d - target))
    ]
    psi = _det(headings, BETA, RANGE, STEP) ** 0.5 * RANGE
    slope = np.gradient(psi, headings)
    off = headings - BETA
    bottom = STEP**2 + RANGE**2 - 2 * STEP * RANGE * np.cos(off)
    appendix = STEP * ((STEP**2 + RANGE**2) * np.cos(off) - 2 * STEP * RANGE) / bottom**2
    inside = np.abs(np.sin(off)) > 1e-3
    printed = np.where(np.sin(off) > 0, appendix, -appendix)
    return [
        near("(11) and Fig. 1: the determinant of two bearings, R = 1, by its printed form",
             float(_det(1.1, BETA, RANGE, STEP)), exact),
        true("(12), (13): the largest of all headings lie at beta +- (pi/2 - 2 alpha)",
             len(found) == 2 and np.abs(found - (BETA + np.array([-1, 1])
             * (np.pi / 2 - 2 * ALPHA))).max() < 1e-4,
             f"maxima on a grid at {', '.join(f'{x - BETA:+.4f}' for x in found)} rad from beta"),
        _equal("Theorem 1: the library's max_det is that heading", ours,
               BETA + np.array([-1, 1]) * (np.pi / 2 - 2 * ALPHA), 1e-12),
        _equal("Appendix: the derivative of Psi", slope[inside], printed[inside], 1e-3),
        near("Appendix: at the optimum cos(C - beta) = 2 s r / (s^2 + r^2) = sin 2 alpha",
             float(np.sin(2 * ALPHA)), float(np.cos(ours[1] - BETA))),
        _equal("Fig. 2: the leg ends at B, where AD meets the circle of radius s again",
               right[0], b),
        _equal("Fig. 2: the angles DOE, BOE and OAD are alpha", np.array(angles),
               np.full(3, ALPHA)),
        near("Fig. 2: the bearing changes by alpha", ALPHA, BETA - right[1]),
        _equal("Theorem 3: two branches from a place, mirror images of equal determinant",
               float(_det(ours[0], BETA, RANGE, STEP)), float(_det(ours[1], BETA, RANGE, STEP))),
        near("Fig. 4: left and right end at the same range", float(right[2]), float(left[2])),
    ]  # fmt: skip


def _sides(ratio: float, legs: int, sides: ArrayLike) -> Array:
    return maneuver.trajectory([0, 1], [0, 0], ratio, 1.0, legs + 1, sides=sides).det[..., -1]


def _two_legs() -> list[Claim]:
    path = _path(samples=12)
    b, r = path.bearings, path.ranges
    pairs = np.sin(b[:, None] - b) ** 2 / (r[:, None] ** 2 * r**2)
    ratios = (0.01, 0.05, 0.1, 0.2, 0.3, 0.4)
    gains = [
        float(_sides(x, 2, np.array([1, 1])) / _sides(x, 2, np.array([1, -1]))) for x in ratios
    ]
    kept, pattern = np.ones(10), np.array([1, 1, -1, -1, 1, 1, -1, 1, 1, 1])
    ten = float(_sides(0.2, 10, pattern) / _sides(0.2, 10, kept))
    every = 1 - 2 * (np.arange(2**9)[:, None] >> np.arange(10) & 1)
    best = float(_sides(0.2, 10, every).max() / _sides(0.2, 10, kept))
    far = float(
        _sides(0.02, 160, np.where(np.arange(160) < 17, 1, -1)) / _sides(0.02, 160, np.ones(160))
    )
    return [
        _equal("(14): det J = 1/2 R^-2 sum sin^2(b_i - b_j) / (r_i^2 r_j^2)",
               float(pairs.sum() / (2 * R**2)), float(path.det[-1])),
        true("Theorem 2 and Fig. 3: over two legs the same side is better",
             min(gains) > 1, f"{min(gains):.3f} to {max(gains):.3f} times, s / r from 0.01 to 0.4"),
        refuted("Theorem 2: the side is always kept", ten > 1 and far > 1,
                f"{ten:.3f} times and {far:.4f} times",
                "ten legs at s / r = 0.2, sides ++--++-+++; 160 at 0.02, one change after 17"),
        refuted("Theorem 3: the best path is one of two branches", best > 1 + 1e-9,
                f"the best of all sequences of ten sides: {best:.3f} times",
                "true of each leg by itself, and of two legs"),
    ]  # fmt: skip


def _trajectories() -> list[Claim]:
    claims = []
    for number, side in (("15", 1), ("16", -1)):
        path = _path(side=side)
        b, a, r, s = path.bearings[:-1], np.arctan(20.0 / path.ranges[:-1]), path.ranges, 20.0
        printed = path.path[:-1] + s * np.stack(
            [side * np.cos(2 * a - side * b), np.sin(2 * a - side * b)], axis=1
        )
        word = "right" if side == 1 else "left"
        claims.append(_equal(f"({number}), Theorem 4: the {word} branch", path.path[1:], printed))
        squared = (r[:-1] ** 2 - s**2) ** 2 / (r[:-1] ** 2 + s**2)
        claims.append(_equal(f"(17), Corollary 1: the range of the {word} branch",
                             r[1:] ** 2, squared))  # fmt: skip
    ratio = np.linspace(0.001, 0.999, 999)
    headings = maneuver.heading(0.0, 1.0, ratio)
    ends = np.hypot(ratio * np.sin(headings), 1 - ratio * np.cos(headings))
    alpha = np.arctan(ratio)
    small = maneuver.heading(0.0, 1.0, np.array([1e-2, 1e-4, 1e-6]))
    return [
        *claims,
        _equal("Corollary 2: r' / r = cos 2 alpha / cos alpha", ends, np.cos(2 * alpha)
               / np.cos(alpha)),
        true("Corollary 2: the range falls, s < r", bool((ends < 1).all()),
             f"r' / r from {ends.min():.3f} to {ends.max():.6f}"),
        true("Remark 2: for s << r the heading tends to beta +- pi/2",
             bool((np.abs(small - np.pi / 2) < [0.021, 2.1e-4, 2.1e-6]).all()),
             "short of it by " + ", ".join(f"{x:.0e}" for x in np.pi / 2 - small) + " rad"),
    ]  # fmt: skip


def _bearing_rate() -> list[Claim]:
    course, speed, t = 1.1, 12.0, 1e-4
    target = RANGE * np.array([np.sin(BETA), np.cos(BETA)])

    def at(time: float) -> tuple[float, float]:
        place = speed * time * np.array([np.sin(course), np.cos(course)])
        return float(_bearing(place, target)), float(np.hypot(*(target - place)))

    (b, r), (b0, r0), (b1, r1) = at(0.0), at(-t), at(t)
    later_b, later_r = at(3.0)
    eighteen = np.array([-later_r * np.sin(later_b) + r * np.sin(b),
                         -later_r * np.cos(later_b) + r * np.cos(b)])  # fmt: skip
    moved = 3.0 * speed * np.array([np.sin(course), np.cos(course)])
    r_dot, b_dot = (r1 - r0) / (2 * t), (b1 - b0) / (2 * t)
    rate = speed * np.sin(course - b)
    courses = np.linspace(-np.pi, np.pi, 20_001)
    way = speed * t * np.stack([np.sin(BETA + courses), np.cos(BETA + courses)], axis=1)
    rates = np.abs(_bearing(way, target) - b)
    inner = (
        (rates[1:-1] > rates[:-2]) & (rates[1:-1] >= rates[2:]) & (rates[1:-1] > rates.max() / 2)
    )
    tops = courses[1:-1][inner]
    tangent = _heading("bearing_rate")
    end_bearing = _leg(tangent)[1]
    headings = BETA + np.linspace(0, np.pi, 200_001)
    change = np.arctan2(STEP * np.sin(headings - BETA), RANGE - STEP * np.cos(headings - BETA))
    grid = float(headings[np.argmax(change)])
    circle = _path("circle", samples=200)
    shrink = []
    for steps in (50, 500, 5000):
        # Once round, in ever more legs.
        path = maneuver.trajectory(
            [0, 1], [0, 0], 2 * np.pi / steps, 1.0, steps + 1, law="bearing_rate"
        )
        shrink.append(1 - float(path.ranges[-1]))
    middle = (circle.path[1:] + circle.path[:-1]) / 2
    slope = np.diff(circle.path, axis=0)
    radius = (middle[:, 1] - 1000.0) / (middle[:, 0] - 0.0)
    ends = [maneuver.heading(0.0, 1.0, 0.3, law) for law in ("bearing_rate", "circle")]
    return [
        _equal("(18): what the line of sight lost is what the observer moved", eighteen, moved),
        near("(19): the range changes by -V cos(C - beta)", -speed * float(np.cos(course - b)),
             r_dot, rel=1e-6),
        near("(19), (20): r d beta/dt = V sin(C - beta)", float(rate), r * b_dot, rel=1e-6,
             right=-float(rate), note="the sign: it is -V sin(C - beta); the size, which is what "
             "is maximised, stays"),
        true("(21): of all courses the size of the rate is largest at C - beta = +- pi/2",
             bool(np.abs(np.abs(tops) - np.pi / 2).max() < 1e-3) and len(tops) == 2,
             f"by differences at {', '.join(f'{x:+.4f}' for x in tops)} rad from beta"),
        near("(22), Theorem 5: the heading is perpendicular to the line of sight at its end",
             end_bearing + np.pi / 2, tangent),
        true("Theorem 5: no heading changes the bearing more over a leg",
             abs(grid - tangent) < 1e-4 and tangent - BETA < np.pi / 2,
             f"grid {grid:.5f}, law {tangent:.5f} rad"),
        _equal("(23), Theorem 6: the path of law circle is the circle of radius r0",
               np.hypot(circle.path[:, 0], circle.path[:, 1] - 1000.0), np.full(200, 1000.0)),
        true("Theorem 6: the path of Theorem 5 tends to that circle as the steps shrink",
             shrink[1] < shrink[0] / 8 and shrink[2] < shrink[1] / 8 and shrink[2] < 0.01,
             "once round in 50, 500, 5000 legs the range falls by "
             + ", ".join(f"{x:.3g}" for x in shrink)),
        true("Theorem 6: on a discrete path tangent and circle are two laws",
             abs(float(ends[0] - ends[1])) > 0.1,
             f"at s / r = 0.3 they are {abs(float(ends[0] - ends[1])):.3f} rad apart"),
        _equal("(24): y' (y - yT) / (x - xT) = -1 along the circle",
               slope[:, 1] * radius, -slope[:, 0], 1e-9),
    ]  # fmt: skip
