"""May it be believed? Coverage, power, false alarms, recall of other solutions, cost.

    python benches/bench_trust.py [--proofs] [--only NAME] [--model MODEL]

Without `--proofs` sizes that take a minute; with it those of the claims in docs/howto/trust.md.
Each line says what was asked, what was measured, and whether it is met.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass

import numpy as np
from harness import OURS, Case, Contest, Contestant
from scipy.stats import chi2, ncx2

import gramian as gm
from gramian import _core
from gramian.models.dipole import DipoleModel

TIMES = np.arange(0.0, 600.0, 15.0)
TURN = np.stack([np.maximum(0, 5 * (TIMES - 300)), np.minimum(5 * TIMES, 1500)], axis=1)


def zigzag(legs: int = 4) -> np.ndarray:
    """Return a path that turns by 90 degrees to and fro."""
    speed, each = 5.0, TIMES[-1] / legs
    leg = np.minimum((TIMES / each).astype(int), legs - 1)
    velocity = speed * np.stack([np.where(leg % 2, 1, -1), np.ones(len(leg))], axis=1) / np.sqrt(2)
    step = np.diff(TIMES, prepend=0.0)
    return np.cumsum(velocity * step[:, None], axis=0)


def bearings(
    path: np.ndarray, degrees: float, times: np.ndarray = TIMES
) -> gm.bearings.BearingsModel:
    """Return bearings of this deviation as a model."""
    return gm.bearings.BearingsModel(times, path, np.array([np.deg2rad(degrees)]))


def scenes() -> dict[str, tuple[gm.bearings.BearingsModel, np.ndarray]]:
    """Return the seven scenes of the issue: model and true state."""

    def target(distance: float) -> np.ndarray:
        direction = np.array([1500.0, 2500.0])
        return np.concatenate([distance * direction / np.linalg.norm(direction), [3.0, -1.0]])

    few = [0, 13, 26, 39]
    return {
        "3 km / 0.1 deg": (bearings(TURN, 0.1), target(3e3)),
        "8 km / 1 deg": (bearings(TURN, 1.0), target(8e3)),
        "11 km / 1.5 deg": (bearings(TURN, 1.5), target(11e3)),
        "15 km / 2 deg": (bearings(TURN, 2.0), np.array([4e3, 15e3, 3.0, -1.0])),
        "zigzag 10 km / 1 deg": (bearings(zigzag(), 1.0), target(10e3)),
        "4 bearings": (bearings(TURN[few], 0.5, TIMES[few]), target(3e3)),
        "1 km / 5 deg": (bearings(TURN, 5.0), target(1e3)),
    }


@dataclass
class Line:
    """One thing asked, and what was measured."""

    name: str
    asked: str
    found: str
    met: bool | None

    def __str__(self) -> str:
        word = {True: "yes", False: "NO", None: "-"}[self.met]
        return f"{self.name:<46} {self.asked:<34} {self.found:<34} {word}"


def coverage(proofs: bool) -> Iterator[Line]:
    """Regions and intervals hold the truth; 'determined' is right."""
    trials = 2000 if proofs else 100
    for name, (model, truth) in scenes().items():
        found = gm.estimate_trials(model, truth, seed=11, trials=trials)
        slack = 3 * np.sqrt(0.05 * 0.95 / trials) if not proofs else 0.0
        inside, covered = found.inside.mean(), found.covered.mean()
        near = name.startswith("3 km")
        top = 0.97 + slack if near else 1.0
        yield Line(
            f"coverage, {name}",
            "93..97 % all four, range" if near else ">= 93 % all four, range",
            f"{100 * inside:.1f} %, {100 * covered:.1f} %",
            bool(min(inside, covered) >= 0.93 - slack and max(inside, covered) <= top),
        )
        said = found.status == "determined"
        right = found.inside[said].mean() if said.any() else 1.0
        enough = said.mean() >= 0.95 - slack if near else True
        shares = ", ".join(f"{100 * v:.1f} % {k}" for k, v in found.shares.items() if v)
        yield Line(
            f"  determined and outside, {name}",
            "<= 5.5 % of all; >= 90 % right",
            f"{100 * found.wrong:.1f} %; {100 * right:.1f} % of {100 * said.mean():.1f} %",
            bool(found.wrong <= 0.055 + slack and (said.mean() < 0.5 or right >= 0.9) and enough),
        )
        yield Line(
            f"  {name}", "", shares + f"; {100 * (~found.certain).mean():.1f} % uncertain", None
        )


@dataclass(frozen=True)
class Trace:
    """An alternative as it is simulated, and the alternatives that look like it."""

    shift: np.ndarray
    parameters: int
    alike: frozenset[str]
    along: np.ndarray
    spans: dict[str, np.ndarray]


def power(proofs: bool, chosen: str | None = None) -> Iterator[Line]:
    """Alternatives at a noncentrality of 25 are named; honest trials are no misfits.

    Beside what is named stand what is misfit, and what linear theory leaves: the best test of as
    many parameters at this noncentrality, alone (detected) and corrected for the number of
    alternatives (misfit), and how often the trace of this alternative is found where it is one
    of the known ones, each as likely (known).
    """
    trials = 500 if proofs else 60
    cases: dict[str, tuple[object, np.ndarray]] = {
        "bearings": (bearings(TURN, 0.1), np.array([1500.0, 2500, 3, -1])),
        "dipole": (dipole(), DIPOLE[[0, 1, 3, 4, 6, 7, 8]]),
        "tracks": (tracks(), np.array([1500.0, 3700, 3, -4])),
    }
    for name, (full, truth) in cases.items():
        if chosen not in (None, name):
            continue
        # Intervals are not asked for: they take time.
        model = copy(full)
        object.__setattr__(model, "__class__", type("Plain", (type(model),), {"judged": ()}))
        columns = model.alternatives(truth, model.h(truth))
        traces = {key: trace(model, truth, columns, key) for key in columns}
        left = {key: found for key, found in traces.items() if found is not None}
        for key, alternative in left.items():
            found = gm.estimate_trials(model, truth, seed=5, trials=trials, shift=alternative.shift)
            p = np.array([found.alternatives[k] for k in columns])
            best = np.array(list(columns))[np.argmin(p, axis=0)]
            hit = np.isin(best, list(alternative.alike)) & (p.min(axis=0) < 0.001)
            slack = 3 * np.sqrt(0.16 / trials) if not proofs else 0.0
            parameters = alternative.parameters
            seen = [
                ncx2.sf(chi2.isf(0.001 / tested, parameters), parameters, 25.0)
                for tested in (1, len(columns))
            ]
            yield Line(
                f"power, {name}, {key}",
                "named in >= 80 %",
                f"{100 * hit.mean():.1f} % (misfit {100 * found.shares['misfit']:.1f} %; theory: "
                f"detected {100 * seen[0]:.1f} %, misfit {100 * seen[1]:.1f} %, "
                f"known {100 * known(alternative, left):.1f} %)",
                bool(hit.mean() >= 0.8 - slack),
            )
        honest = 20_000 if proofs else 1000
        found = gm.estimate_trials(model, truth, seed=77, trials=honest)
        share = found.shares["misfit"]
        slack = 3 * np.sqrt(0.002 / honest) if not proofs else 0.0
        yield Line(
            f"false misfit, {name}, {honest} trials",
            "<= 0.2 %",
            f"{100 * share:.3f} %",
            bool(share <= 0.002 + slack),
        )


def trace(
    model: object, truth: np.ndarray, columns: dict[str, np.ndarray], key: str
) -> Trace | None:
    """Return an alternative at a score noncentrality of 25; None where it leaves no trace.

    Of several parameters the direction that leaves the largest trace. Projected columns, and
    what looks like them, are those at the fit, where alternatives are tested: the shift may move
    it by many deviations.
    """
    wide = {k: c[:, None] if c.ndim == 1 else c for k, c in columns.items()}
    basis = span(model.rows(truth))
    off = off_from(basis, wide[key])
    along = np.linalg.svd(off, full_matrices=False)[2][0]
    one, length = wide[key] @ along, np.linalg.norm(off @ along)
    if length <= 1e-6 * np.linalg.norm(one):
        return None
    size, at = sized(model, truth, wide[key], one / length)
    basis = span(model.rows(at))
    mark = off_from(basis, wide[key] @ along)
    mark /= np.linalg.norm(mark)
    spans = {k: span(off_from(basis, c)) for k, c in wide.items()}
    alike = {k for k, q in spans.items() if k == key or np.linalg.norm(q.T @ mark) > 0.9}
    shift = size * one / length
    return Trace(shift, wide[key].shape[1], frozenset(alike), mark, spans)


def span(columns: np.ndarray) -> np.ndarray:
    """Return orthonormal columns that span the same."""
    lengths = np.linalg.norm(columns, axis=0)
    q, r = np.linalg.qr(columns / np.where(lengths > 0, lengths, 1.0))
    return q[:, np.abs(np.diag(r)) > 1e-9]


def off_from(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return what lies off a basis; nothing where that is rounding."""
    off = columns - basis @ (basis.T @ columns)
    off -= basis @ (basis.T @ off)
    left = np.linalg.norm(off, axis=0) > 1e-9 * np.linalg.norm(columns, axis=0)
    return off * left


def known(alternative: Trace, left: dict[str, Trace]) -> float:
    """Return how often a trace is found where all traces, but not their signs, are known."""
    names = list(left)
    marks = np.stack([left[k].along for k in names], axis=1)
    noise = np.random.default_rng(1).normal(size=(4000, len(marks)))
    seen = np.abs((5 * alternative.along + noise) @ marks)
    best = np.array(names)[np.argmax(seen, axis=1)]
    return float(np.isin(best, list(alternative.alike)).mean())


def sized(
    model: object, truth: np.ndarray, columns: np.ndarray, column: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return the factor of a whitened shift at which the score noncentrality is 25, and the fit.

    Of a record with the shift and no noise, after its fit: 5 where the model is linear over
    what the shift moves the answer by, which may be many deviations.
    """
    z = model.h(truth)
    whitened = model.residuals(truth, z + 1.0) - model.residuals(truth, z)
    size, at = 5.0, truth
    for _ in range(8):
        shifted = model.handle(z + size * column / whitened)
        at = shifted.minimize(truth[None], ("squares", 0.0), 200)[0]["x"]
        statistic = shifted.scores(at, [columns], 1e-3, 0.8)[0][0]["statistic"]
        size *= float(np.clip(5.0 / np.sqrt(statistic), 0.5, 2.0))
    return size, np.asarray(at)


def tracks() -> gm.tracks.TracksModel:
    """Return bearings from a ship that turns, and ranges and their rates from a coast."""
    times = np.linspace(0.0, 1200.0, 60)
    corners = [[0, 0], [1060, 1060], [2120, 0], [3180, 1060], [4240, 0]]
    ship = gm.tracks.Carrier(corners, 300.0 * np.arange(5))
    coast = gm.tracks.Carrier([0.0, 0.0])
    sensors = [
        gm.tracks.Sensor.bearing(ship, times, sigma=np.radians(0.3)),
        gm.tracks.Sensor.range(coast, times[::3], sigma=15.0),
        gm.tracks.Sensor.range_rate(coast, times[1::3], sigma=0.3),
    ]
    scene = gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), sensors)
    return gm.tracks.TracksModel(scene)


DIPOLE = np.array([-10.0, -10, 5, 1, 1, 0, 10, 20, 10])


def dipole(state: np.ndarray = DIPOLE, sigma: float = 3e-10) -> DipoleModel:
    """Return a pass of known height as a model."""
    times = np.arange(0.0, 20.0, 0.5)
    weights = np.full((times.size, 1, 3), 1 / sigma)
    known = {"z0": float(state[2]), "vz": float(state[5])}
    return DipoleModel(times, np.zeros((1, 3)), weights, state, known, {})


@dataclass
class Plane:
    """Measurements of a place in the plane: ranges, time differences or cone angles."""

    kind: str
    places: np.ndarray
    sigma: float
    names: tuple[str, ...] = ("east", "north")
    units: tuple[str, ...] = ("m", "m")

    def h(self, x: np.ndarray) -> np.ndarray:
        """Return the exact measurements."""
        offset = np.asarray(x) - self.places
        distance = np.linalg.norm(offset, axis=1)
        if self.kind == "ranges":
            return distance
        if self.kind == "time differences":
            return distance[1:] - distance[0]
        return offset[:, 0] / np.maximum(distance, 1e-9)

    def residuals(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return what is left, whitened."""
        return (z - self.h(x)) / self.sigma

    def rows(self, x: np.ndarray) -> np.ndarray:
        """Return the derivatives, whitened."""
        offset = np.asarray(x) - self.places
        distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-9)[:, None]
        unit = offset / distance
        if self.kind == "ranges":
            return unit / self.sigma
        if self.kind == "time differences":
            return (unit[1:] - unit[0]) / self.sigma
        axis = np.array([1.0, 0.0])
        return (axis - unit[:, :1] * unit) / distance / self.sigma


def recall(proofs: bool) -> Iterator[Line]:
    """Searches find the minima that an exhaustive one finds.

    Where chi2 is level along a valley to rounding, steps come to rest anywhere on it: places
    that a push of a thousandth of a deviation does not come back to are told apart.
    """
    each = 250 if proofs else 12
    many = 600 if proofs else 300
    total_places, total_seen, total_level = 0, 0, 0
    for kind in ("ranges", "time differences", "cone angles", "dipole"):
        rng = np.random.default_rng(3)
        places_of, seen_of, level_of = 0, 0, 0
        for trial in range(each):
            if kind == "dipole":
                state = np.concatenate(
                    [rng.normal(size=3) * 10, rng.normal(size=3), rng.normal(size=3) * 30]
                )
                times = np.arange(21.0)
                weights = np.full((times.size, 1, 3), 1e9)
                speed = {"speed": float(np.linalg.norm(state[3:6]))}
                model = DipoleModel(times, np.zeros((1, 3)), weights, state, speed, {})
                x = model.coordinates(state)
                names = model.names
                width = {"v": np.pi, "m": 60.0}
                ends = [
                    (-30.0, 30.0) if name.endswith("0") else (-width[name[0]], width[name[0]])
                    for name in names
                ]
            else:
                count = {"ranges": 3, "time differences": 4, "cone angles": 4}[kind]
                model = Plane(kind, rng.uniform(-100, 100, (count, 2)), 1.0)
                if kind == "cone angles":
                    model.sigma = 0.02
                x = rng.uniform(-150, 150, 2)
                ends = [(-200.0, 200.0)] * 2
            handle = gm.estimate.__globals__["handle_of"](model, model.h(x))
            low, high = (list(e) for e in zip(*ends, strict=True))
            minima, found, level = handle.recall(x, ("box", low, high), 64, trial, many, 50.0)
            places_of, seen_of = places_of + minima, seen_of + found
            level_of += level
        share = seen_of / max(places_of, 1)
        total_places, total_seen = total_places + places_of, total_seen + seen_of
        total_level += level_of
        yield Line(
            f"others, {kind}, {each} scenes",
            ">= 99 % of the other minima",
            f"{100 * share:.2f} % of {places_of} (and {level_of} on level ground)",
            None,
        )
    share = total_seen / max(total_places, 1)
    yield Line(
        f"others, all {4 * each} scenes",
        ">= 99 % of the other minima",
        f"{100 * share:.2f} % of {total_places} (and {total_level} on level ground)",
        bool(share >= 0.99),
    )


class Counted:
    """A model that counts its linearisations."""

    def __init__(self, handle: object, states: int, measurements: int) -> None:
        self.count, self._handle = 0, handle
        self.model = _core.Model.from_functions(
            states, measurements, self._linearize, self._difference, None
        )

    def _linearize(self, x: np.ndarray, rows: bool) -> tuple[np.ndarray, np.ndarray]:
        # Rows with their reduction take most of the time: residuals alone are not counted.
        self.count += rows
        return self._handle.linearize(x)

    def _difference(self, start: np.ndarray, to: np.ndarray) -> np.ndarray:
        return self._handle.linearize(start)[0] - self._handle.linearize(to)[0]

    def of(self, call: Callable[[object], object]) -> int:
        """Return how many a call takes."""
        self.count = 0
        call(self.model)
        return self.count


def cost(proofs: bool) -> Iterator[Line]:
    """Compare an interval, and a search, with one solve: linearisations, and time.

    The solve is one from the truth, the cheapest there is; beside it the search is compared
    with a solve from a point of the prior, as it makes 64 of them.
    """
    rounds = 40 if proofs else 10
    prior = {"x0": (4e3, 4e3), "y0": (6e3, 4e3), "vx": (0.0, 5.0), "vy": (0.0, 5.0)}
    squares = ("squares", 0.0)
    for name, (model, truth) in scenes().items():
        ratios, counts = [], []
        names = tuple(model.names)
        spread = ("normal", [prior[n][0] for n in names], [prior[n][1] for n in names])
        none = np.zeros((0, len(names)))
        ends = ([0, 1], [float(v) for v in model.observer[0]])
        for seed in range(rounds):
            rng = np.random.default_rng(seed)
            z = model.h(truth) + model.sigma * rng.normal(size=len(model.times))
            handle = model.handle(z)
            best = handle.minimize(model.starts(z), squares, 200)[0]["x"]
            point = np.array(spread[1]) + np.array(spread[2]) * rng.normal(size=len(names))
            calls = [
                lambda h, n=truth[None]: h.minimize(n, squares, 200),
                lambda h, b=best, e=ends, o=none: h.interval(b, o, e, 3.841459),
                lambda h, b=best, o=none, s=spread: h.others(b, o, s, 64, 0),
                lambda h, n=point[None]: h.minimize(n, squares, 200),
            ]
            counted = Counted(handle, len(names), len(model.times))
            counts.append([counted.of(call) for call in calls])
            ratios.append([timed(lambda c=call, h=handle: c(h)) for call in calls])
        solve, interval, others, far = np.median(np.array(counts), axis=0)
        times = np.median(np.array(ratios), axis=0)
        yield Line(
            f"cost, {name}",
            "interval <= 60, others(64) <= 100",
            f"{interval / solve:.0f}, {others / solve:.0f} solves ({others / far:.0f} from afar); "
            f"by time {times[1] / times[0]:.0f}, {times[2] / times[0]:.0f}",
            bool(interval <= 60 * solve and others <= 100 * solve),
        )


def timed(call: Callable[[], object]) -> float:
    """Return the least of three times of the processor, seconds: others may use it too."""
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        call()
        best = min(best, time.process_time() - start)
    return best


def profile(model: gm.bearings.BearingsModel, z: np.ndarray, best: np.ndarray) -> list[float]:
    """Return the interval of the range by SciPy: the likelihood with the range held, ends by roots.

    From the estimate outwards; a second piece elsewhere is not looked for.
    """
    from scipy.optimize import brentq, least_squares

    at = np.asarray(model.observer[0], dtype=float)
    scale = gm.crlb_std(gm.Problem(model.rows(best), model.names))

    def state(range_: float, rest: np.ndarray) -> np.ndarray:
        place = at + range_ * np.array([np.sin(rest[0]), np.cos(rest[0])])
        return np.concatenate([place, rest[1:] * scale[2:]])

    offset = best[:2] - at
    start = np.concatenate([[np.arctan2(*offset)], best[2:] / scale[2:]])
    least = float((model.residuals(best, z) ** 2).sum())

    def above(range_: float) -> float:
        fit = least_squares(lambda rest: model.residuals(state(range_, rest), z), start)
        return 2 * fit.cost - least - 3.841459

    here = float(np.hypot(*offset))
    ends = []
    for factor in (0.5, 2.0):
        far = here * factor
        for _ in range(12):
            if above(far) > 0:
                break
            far *= factor
        ends.append(brentq(above, here, far, rtol=1e-9))
    return ends


def interval_contest() -> Contest:
    """A likelihood interval of the range, beside profiles by SciPy."""
    model, truth = scenes()["3 km / 0.1 deg"]
    rng = np.random.default_rng(1)
    z = model.h(truth) + model.sigma * rng.normal(size=len(model.times))
    handle = model.handle(z)
    best = handle.minimize(model.starts(z), ("squares", 0.0), 200)[0]["x"]
    none = np.zeros((0, len(model.names)))
    function = ([0, 1], [float(v) for v in model.observer[0]])

    def ours(_: object) -> Callable[[], object]:
        def work() -> list[float]:
            pieces = handle.interval(best, none, function, 3.841459)["pieces"]
            return [pieces[0][0], pieces[-1][1]]

        return work

    wanted = profile(model, z, best)

    def error(found: list[float]) -> float:
        return float(np.abs(np.array(found) / np.array(wanted) - 1).max())

    return Contest(
        f"likelihood interval of the range, {len(model.times)} bearings",
        "interval",
        1.0,
        None,
        [
            Contestant(OURS, ours),
            Contestant("SciPy, profiles and brentq", lambda _: lambda: profile(model, z, best)),
        ],
        cases={"well": Case(None, error)},
        note="Ours looks for further pieces as well. Error: the ends against those of SciPy.",
    )


def others_contest() -> Contest:
    """Which other places fit three ranges as well, beside many starts of SciPy."""
    from scipy.optimize import least_squares

    beacons = np.array([[-60.0, 0.5], [0.0, 0.0], [70.0, -0.4]])
    model, x = Plane("ranges", beacons, 1.0), np.array([20.0, 80.0])
    # Across the line of the beacons, to all digits.
    wanted = least_squares(
        lambda p: model.residuals(p, model.h(x)), [20.0, -80.0], xtol=1e-15, ftol=1e-15, gtol=1e-15
    ).x
    handle = gm.estimate.__globals__["handle_of"](model, model.h(x))
    spread, none = ("box", [-200.0, -200.0], [200.0, 200.0]), np.empty((0, 2))
    starts = np.random.default_rng(1).uniform(-200, 200, (64, 2))

    def ours(_: object) -> Callable[[], object]:
        return lambda: [np.asarray(o["x"]) for o in handle.others(x, none, spread, 64, 0)["others"]]

    def scipy(_: object) -> Callable[[], object]:
        def work() -> list[np.ndarray]:
            found: list[np.ndarray] = []
            for start in starts:
                fit = least_squares(
                    lambda p: model.residuals(p, model.h(x)), start, jac=lambda p: -model.rows(p)
                )
                places = [x, *found]
                if all(np.linalg.norm(fit.x - p) > 0.1 for p in places) and fit.cost < 25:
                    found.append(fit.x)
            return found

        return work

    def error(found: list[np.ndarray]) -> float:
        """Return how far the nearest is from the place across the line of the beacons."""
        return min((float(np.linalg.norm(f - wanted)) for f in found), default=np.inf)

    return Contest(
        "other solutions of three ranges, 64 starts",
        "search",
        1.0,
        None,
        [
            Contestant(OURS, ours),
            Contestant("SciPy least_squares from 64 starts", scipy),
        ],
        cases={"well": Case(None, error)},
        note="Three beacons almost in a line, exact ranges; both call functions in Python. "
        "Error: metres from the other minimum.",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    yield interval_contest()
    yield others_contest()


MODELS = ("bearings", "dipole", "tracks")
PARTS: dict[str, Callable[..., Iterator[Line]]] = {
    "coverage": coverage,
    "power": power,
    "recall": recall,
    "cost": cost,
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--proofs", action="store_true", help="the sizes of the claims")
    parser.add_argument("--only", choices=tuple(PARTS))
    parser.add_argument("--model", choices=MODELS, help="of power: this one alone")
    given = parser.parse_args()
    for name, part in PARTS.items():
        if given.only in (None, name):
            more = (given.model,) if part is power else ()
            for line in part(given.proofs, *more):
                print(line, flush=True)


if __name__ == "__main__":
    main()
