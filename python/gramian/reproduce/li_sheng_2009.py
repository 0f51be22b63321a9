"""Li & Sheng 2009, "Observability criteria for discrete bearings-only system".

Control Theory & Applications 26(5), 570-572. The paper proves; it prints no
numbers. Each of its numbered equations is evaluated here on one geometry, as it
is printed, beside the quantity that it states to be equal.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations, product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gramian.models import bearings
from gramian.report import Picture, Report, Table
from gramian.reproduce._claims import Claim, claims_data, claims_table, near, true, verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["run"]

Array = NDArray[np.float64]

#: The geometry: an observer that turns by 90 deg halfway, a target 10 km north.
DT, M, SPEED = 20.0, 20, 5.0
STATE = np.array([0.0, 10_000.0, 3.0, -1.0])


def run() -> Report:
    """Evaluate every numbered equation of the paper."""
    t, observer = _observer(90.0)
    b = _bearings(t, observer)
    checks = [*_model(t, observer, b), *_determinants(t, b), *_discriminant(t, b), *_theorem()]
    tone, headline, sentence = verdict(checks)
    return Report(
        title="Li & Sheng 2009",
        subtitle="Observability criteria for discrete bearings-only system",
        tone=tone,
        headline=headline,
        verdict=sentence,
        facts=[(claim.what, claim.note) for claim in checks if claim.outcome == "misprint"],
        tables=[
            claims_table(
                "Each numbered equation, as printed and as computed",
                checks,
                f"{M} bearings, {DT:g} s apart; the observer at {SPEED:g} m/s turns by 90 deg "
                "halfway; the target starts 10 km north and moves at (3, -1) m/s. T = t - t0.",
            ),
            _accuracy(),
        ],
        pictures=[
            Picture(
                "What unobservable means",
                "An observer on a straight line sees the same bearings from every member of one "
                "family of targets: those whose relative motion is the same but for its scale. "
                "A turn of the observer is what tells them apart.",
                _family,
            )
        ],
        data={"claims": claims_data(checks)},
    )


def _check(
    number: str,
    what: str,
    printed: float,
    computed: float,
    *,
    misprint: str = "",
    right: float | None = None,
) -> Claim:
    what = f"({number}) {what}" if number[0].isdigit() else f"{number}: {what}"
    if misprint:
        return near(what, printed, computed, right=right, note=misprint)
    return near(what, printed, computed)


def _zero(number: str, what: str, off: float) -> Claim:
    """Compare two sides whose largest difference over the largest entry is `off`."""
    what = f"({number}) {what}" if number[0].isdigit() else f"{number}: {what}"
    return true(what, bool(off < 1e-9), f"to {off:.0e}")


def _off(a: Array, b: Array) -> float:
    return float(np.abs(a - b).max() / np.abs(b).max())


def _model(t: Array, observer: Array, b: Array) -> list[Claim]:
    """Equations (1) to (4): the model."""
    h = _rows(t - t[0], b)
    z = observer[:, 0] * np.cos(b) - observer[:, 1] * np.sin(b)
    ranges = np.hypot(*(_positions(t) - observer).T)
    rows = bearings.rows(t, observer, STATE, 1.0)
    one, *_ = np.linalg.lstsq(h / [1, 1, t[-1], t[-1]], z, rcond=None)
    one /= [1, 1, t[-1], t[-1]]
    printed = np.arctan((_positions(t) - observer)[:, 0] / (_positions(t) - observer)[:, 1])
    turned = np.where((_positions(t) - observer)[:, 1] < 0, printed + np.pi, printed)
    return [
        _zero("1", "Phi = I: one state gives all Z, and is solved from them", _off(one, STATE)),
        _zero("2", "H over range is the derivative of the bearing by the state",
              _off(rows, h / ranges[:, None])),
        _zero("3", "Z = xo cos b - yo sin b is H X", _off(z, h @ STATE)),
        _zero("4", "the bearing is atan of east over north, in its quadrant",
              float(np.abs(np.sin(b - turned)).max())),
    ]  # fmt: skip


def _determinants(t: Array, b: Array) -> list[Claim]:
    """Equations (6) to (12): the determinant of the Gram matrix."""
    truth = float(bearings.discriminant_sum(t, b))
    since = t - t[0]
    # The sums of the proof run over all quadruples: m^4 terms on arrays.
    quadruple = np.meshgrid(*[np.arange(M)] * 4, indexing="ij")
    d = bearings.discriminant(t[np.stack(quadruple, axis=-1)], b[np.stack(quadruple, axis=-1)])
    lemma = float((d**2).sum() / 24)
    ti, tj, tk, tl = (since[q] for q in quadruple)
    bi, bj, bk, bl = (b[q] for q in quadruple)
    # (7): blocks 2 to 4 without their factors T and T^2.
    flat = _rows(np.ones(M), b)
    full = _rows(since, b)
    gram = full.T @ full
    seven = float(np.linalg.det(flat.T @ flat))
    body = -ti * tk * np.sin(bk - bi) * np.sin(bl - bj) + (ti * tj + tk * tl) * np.cos(bi) * np.sin(
        bj
    ) * np.cos(bk) * np.sin(bl)
    sines = np.sin(bj - bi) * np.sin(bl - bk)
    s1 = ti * tj * sines * body
    eight = float(s1.sum())
    swapped = np.swapaxes(s1, 0, 1)
    nine = (s1 + swapped + np.swapaxes(s1, 2, 3) + np.swapaxes(swapped, 2, 3)) / 4
    # From (9) to (10) the summands agree one by one.
    s2 = ti * tj * sines * d / 4
    apart = float(np.abs(nine - s2).max() / np.abs(s2).max())
    three = (
        ti * tj * sines
        - ti * tk * np.sin(bk - bi) * np.sin(bl - bj)
        + tj * tk * np.sin(bk - bj) * np.sin(bl - bi)
    )
    eleven = float((d * three).sum() / 12)
    s3 = d * three
    twelve = float((s3 + np.swapaxes(s3, 2, 3)).sum() / 24)
    return [
        _check("6", "Lemma 1: |G| = 1/24 sum D^2 over all i, j, k, l", lemma, truth),
        _check("7", "|G| of the matrix as written", seven, float(np.linalg.det(gram)), right=truth,
               misprint="blocks 2 to 4 lost their factors T and T^2; H^T H has them"),
        _check("8", "|G| as the fourfold sum", eight, truth),
        _check("9", "the same, symmetrised over i <-> j and k <-> l", float(nine.sum()), truth),
        _zero("9", "its summands are those of (10)", apart),
        _check("10", "|G| = 1/4 sum T_i T_j sin b_ij sin b_kl D", float(s2.sum()), truth),
        _check("11", "|G| = 1/12 sum D [three products]", eleven, truth),
        _check("12", "|G| = 1/24 sum of (11) symmetrised over k <-> l", twelve, truth),
    ]  # fmt: skip


def _discriminant(t: Array, b: Array) -> list[Claim]:
    """Equations (5), (13) to (15) and the appendix, at one quadruple."""
    four = np.array([0, 6, 13, 19])
    ts, bs = t[four], b[four]
    h = _rows(ts - t[0], bs)
    truth = float(np.linalg.det(h))
    forms: dict[str, Callable[[], float]] = {
        form: lambda form=form: float(bearings.discriminant(ts, bs, form=form))  # type: ignore[misc]
        for form in ("5", "13", "15")
    }
    straight_t, straight = _observer(0.0)
    sb = _bearings(straight_t, straight)[four]
    c = [1 / np.tan(sb[k] - sb[0]) for k in (1, 2, 3)]

    def tau(i: int, j: int) -> float:
        return float(ts[j - 1] - ts[i - 1])

    terms = [-tau(1, 2) * tau(3, 4) * c[0], tau(1, 3) * tau(2, 4) * c[1],
             -tau(2, 3) * tau(1, 4) * c[2]]  # fmt: skip
    vanishing = float(sum(terms)) / max(abs(x) for x in terms)
    worst = max(
        abs(
            float(bearings.discriminant(ts[list(p)], bs[list(p)]))
            - _sign(p) * float(bearings.discriminant(ts, bs))
        )
        for p in permutations(range(4))
    )
    twice = max(
        abs(float(bearings.discriminant(ts[list(p)], bs[list(p)])))
        for p in product(range(4), repeat=4)
        if len(set(p)) < 4
    )
    d = float(bearings.discriminant(ts, bs))
    return [
        _check("5", "D, the discriminant, is det of its four rows H", forms["5"](), truth),
        _check("13", "D in cotangents", forms["13"](), truth),
        _zero("14", "its bracket vanishes on an unobservable track", abs(vanishing)),
        _check("15", "D in two products of two sines", forms["15"](), truth),
        _zero("appendix 1", "a swap of two bearings turns the sign of D", worst / abs(d)),
        _zero("appendix 2", "D of two equal instants is 0", twice / abs(d)),
    ]  # fmt: skip


def _theorem() -> list[Claim]:
    """Theorem 1: rank 4 exactly where some D is not zero."""
    from gramian.analysis import analyze

    found = []
    for turn in (90.0, 1.0, 0.0):
        t, observer = _observer(turn)
        rank = analyze(bearings.problem(t, observer, STATE, 1.0)).rank
        answer = bearings.observable(t, _bearings(t, observer))
        what = (
            f"turn of {turn:g} deg: largest |D| {abs(answer.value):.3g}; so the rank, and the rank"
        )
        found.append(_check("Theorem 1", what, 4.0 if answer.observable else 3.0, float(rank)))
    return found


def _accuracy() -> Table:
    """Return how the forms of |G| keep their digits as the turn shrinks."""
    rows = []
    for turn in (90.0, 10.0, 1.0, 0.1, 0.01):
        t, observer = _observer(turn)
        b = _bearings(t, observer)
        h = _rows(t - t[0], b)
        values = [
            float(bearings.discriminant_sum(t, b)),
            float(bearings.discriminant_sum(t, b, method="qr")),
            float(np.linalg.det(h.T @ h)),
        ]
        off = [f"{abs(v / values[0] - 1):.0e}" for v in values[1:]]
        rows.append([f"{turn:g}", f"{values[0]:.6g}", *off])
    return Table(
        "What rounding does to |G| as the turn shrinks",
        [
            "turn (deg)",
            "sum of D^2",
            "by QR: relative difference",
            "det of the Gram matrix: the same",
        ],
        rows,
        "The sum of squares is the most accurate; half the digits are lost in the Gram matrix.",
    )


def _family() -> Figure:
    from gramian.plot import COLORS, figure

    fig = figure(8.0, 3.8)
    for axes, turn in zip(fig.subplots(1, 2), (0.0, 60.0), strict=True):
        t, observer = _observer(turn)
        t, observer = t[::2], observer[::2]
        # (position relative to the observer, relative velocity), the same but for scale.
        speed = np.array([0.0, SPEED])
        relative = np.array([*(STATE[:2]), *(STATE[2:] - speed)])
        for scale, color in ((1.0, COLORS["target"]), (0.7, COLORS["weak"]), (0.4, COLORS["good"])):
            x = scale * relative + np.array([0, 0, *speed])
            place = x[:2] + t[:, None] * x[2:]
            axes.plot(*place.T / 1e3, ".-", color=color, linewidth=1)
            if scale == 1.0:
                for o, p in zip(observer, place, strict=True):
                    axes.plot(*np.stack([o, p]).T / 1e3, color=COLORS["muted"], linewidth=0.6)
        axes.plot(*observer.T / 1e3, ".-", color=COLORS["observer"], label="observer")
        axes.set_xlabel("east (km)")
        axes.set_ylabel("north (km)")
        axes.set_title(
            "straight: every one is seen along the grey lines"
            if turn == 0
            else "a turn: only one is",
            fontsize="medium",
        )
        axes.legend(loc="lower right", fontsize="small", frameon=False)
    return fig


def _observer(turn_deg: float) -> tuple[Array, Array]:
    turn = np.radians(turn_deg)
    heading = np.where(np.arange(M - 1) < M // 2, 0.0, turn)
    steps = SPEED * DT * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    path: Array = np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.asarray(DT * np.arange(M), dtype=float), path


def _positions(t: Array) -> Array:
    place: Array = STATE[:2] + (t - t[0])[:, None] * STATE[2:]
    return place


def _bearings(t: Array, observer: Array) -> Array:
    angles: Array = np.arctan2(*(_positions(t) - observer).T)
    return angles


def _rows(since: Array, b: Array) -> Array:
    """Rows (2)."""
    c, s = np.cos(b), np.sin(b)
    return np.stack([c, -s, since * c, -since * s], axis=1)


def _sign(p: tuple[int, ...]) -> int:
    return round(float(np.linalg.det(np.eye(4)[list(p)])))
