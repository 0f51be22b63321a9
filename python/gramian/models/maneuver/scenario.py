"""Scenarios of an observer whose path is to be chosen: `model = "maneuver"`."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from gramian._text import brief, number
from gramian.exceptions import InputError
from gramian.models.maneuver import _closed_loop, _planner, _shortest, _soonest
from gramian.models.maneuver._sensing import Sensing
from gramian.report import Picture, Report, Table, Tone
from gramian.scenario.base import Scenario, Section

if TYPE_CHECKING:
    from gramian.models.maneuver._closed_loop import ClosedLoop
    from gramian.models.maneuver._planner import Plan
    from gramian.models.maneuver._shortest import ShortestInterval
    from gramian.models.maneuver._soonest import Soonest

__all__ = ["ManeuverScenario"]

Positive = Annotated[float, Field(gt=0)]
Pair = tuple[float, float]
Progress = Callable[[int, int, float], object]
Method = Literal[
    "max_det", "hammel_liu", "bearing_rate", "circle", "perpendicular", "plan", "plan_estimate"
]

UNITS = {"x": "m", "y": "m", "x0": "m", "y0": "m", "vx": "m/s", "vy": "m/s"}


class Target(Section):
    """Where the target is, or may be, at the first bearing."""

    position: Pair | None = None
    positions: list[Pair] | None = Field(default=None, min_length=1)
    weights: list[float] | None = None
    velocity: Pair | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> Target:
        if (self.position is None) == (self.positions is None):
            raise ValueError("give position, or positions for several possible targets")
        return self

    def states(self) -> list[list[float]]:
        """Return a row for each possible target, with its velocity if it moves."""
        places = [self.position] if self.position else self.positions or []
        return [[*place, *(self.velocity or ())] for place in places]


class Observer(Section):
    """Where the observers start and how they can move."""

    start: Pair | None = None
    starts: list[Pair] | None = Field(default=None, min_length=2)
    separation: float | None = Field(default=None, ge=0)
    return_to: Pair | tuple[float, float, Positive] | None = None
    max_distance: Positive | None = None
    current: Pair | None = None
    speed: Positive | tuple[Positive, Positive]
    heading_deg: float | None = None
    max_turn_rate_deg: Positive | None = None
    legs: int | None = Field(default=None, ge=1)

    @model_validator(mode="after")
    def _one_or_several(self) -> Observer:
        if (self.start is None) == (self.starts is None):
            raise ValueError("give start, or starts for several observers")
        return self


class SensorSection(Section):
    """Something else than a bearing that is measured at every sample."""

    kind: Literal["bearing", "range", "range_rate", "frequency", "cone_angle", "signal_strength"]
    sigma: Positive | None = None
    sigma_deg: Positive | None = None
    detection: float = Field(default=1.0, gt=0, le=1)
    bias: str | None = None
    blind_deg: list[Pair] = Field(default_factory=list)
    reach: Positive | None = None
    parameters: dict[str, float] = Field(default_factory=dict)
    unknown: dict[str, str] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_sigma(self) -> SensorSection:
        angle = self.kind in ("bearing", "cone_angle")
        if (self.sigma_deg is None) == angle or (self.sigma is None) != angle:
            raise ValueError("give sigma_deg for a bearing or cone angle, sigma for all others")
        return self

    def sensing(self) -> Sensing:
        """Return it for the planner."""
        sigma = np.radians(self.sigma_deg or 0.0) if self.sigma is None else self.sigma
        return Sensing(
            self.kind,
            float(sigma),
            detection=self.detection,
            bias=self.bias,
            blind=[(float(np.radians(a)), float(np.radians(b))) for a, b in self.blind_deg],
            reach=self.reach,
            parameters=self.parameters,
            unknown=self.unknown,
        )


class Bearings(Section):
    """How many bearings, how often, how good."""

    count: int = Field(ge=2, le=100_000)
    step: Positive
    sigma_deg: float | None = Field(default=None, gt=0, lt=90)


class Limits(Section):
    """What the path keeps clear of."""

    standoff: float | None = Field(default=None, ge=0)
    keep_out: list[tuple[float, float, Positive]] = Field(default_factory=list)
    polygons: list[list[Pair]] = Field(default_factory=list)


class Goal(Section):
    """What is to be made best, and how hard it is searched."""

    criterion: Literal["D", "A", "E"] = "D"
    combination: str | list[float] | None = None
    accuracy: Positive | None = None
    interval: str | None = None
    over: Literal["expectation", "worst"] = "expectation"
    chance: float | None = Field(default=None, gt=0, lt=1)
    starts: int = Field(default=24, ge=1)
    restarts: int = Field(default=32, ge=0)
    time_limit: Positive | None = None
    bound: bool = True
    seed: int = Field(default=0, ge=0)

    @model_validator(mode="after")
    def _of_something(self) -> Goal:
        if self.accuracy is not None and not isinstance(self.combination, str):
            raise ValueError("accuracy needs combination, the name of what is to be known so well")
        if self.interval is not None and (self.combination, self.accuracy) != (None, None):
            raise ValueError("interval stands alone: give no combination and no accuracy beside it")
        return self


class Loop(Section):
    """The closed loop: an observer that does not know the target."""

    first_range: tuple[Positive, Positive]
    first_speed: Positive | None = None
    methods: tuple[Method, ...] = ("plan", "max_det", "hammel_liu", "bearing_rate")
    trials: int = Field(default=40, ge=1)
    seed: int = Field(default=0, ge=0)
    lost: float = Field(default=0.0, ge=0, lt=1)
    when_lost: Literal["predict", "hold"] = "predict"
    false_alarms: float = Field(default=0.0, ge=0, lt=1)
    opening: int = Field(default=0, ge=0)
    replan: int = Field(default=15, ge=1)
    horizon: int | None = Field(default=None, ge=2)


class ManeuverScenario(Scenario):
    """An observer, a target and the limits of the path between them."""

    model: Literal["maneuver"]
    target: Target
    observer: Observer
    bearings: Bearings
    sensors: list[SensorSection] = Field(default_factory=list)
    limits: Limits = Field(default_factory=Limits)
    goal: Goal = Field(default_factory=Goal)
    prior: dict[str, Positive] = Field(default_factory=dict)
    closed_loop: Loop | None = None

    def plan(self, progress: Progress | None = None) -> Report:
        """Plan the path, compare it with the laws, and fly both if asked to."""
        try:
            found = self._plan(progress)
            if found.stopped == "interrupted":
                stop = KeyboardInterrupt()
                stop.add_note(f"the best path so far: {found}")
                raise stop
            loop = self._loop()
        except InputError as error:
            raise self.error("plan", str(error)) from error
        return _report(self.path.name, found, loop)

    def _plan(self, progress: Progress | None) -> Plan | Soonest | ShortestInterval:
        observer, limits, goal = self.observer, self.limits, self.goal
        combination = goal.combination
        sigma_deg = self.bearings.sigma_deg
        if (sigma_deg is None) != bool(self.sensors):
            raise InputError("give bearings.sigma_deg, or [[sensors]] and no bearings.sigma_deg")
        places = (
            self.target.states(),
            observer.starts or observer.start or (),
            observer.speed,
            self.bearings.step,
            self.bearings.count,
        )
        options: dict[str, Any] = {
            "sigma": _radians(sigma_deg),
            "sensors": [sensor.sensing() for sensor in self.sensors] or None,
            "over": goal.over if goal.chance is None else {"chance": goal.chance},
            "standoff": limits.standoff,
            "keep_out": limits.keep_out or None,
            "polygons": limits.polygons or None,
            "return_to": observer.return_to,
            "max_distance": observer.max_distance,
            "separation": observer.separation,
            "current": observer.current,
            "max_turn_rate": _radians(observer.max_turn_rate_deg),
            "heading": _radians(observer.heading_deg),
            "legs": observer.legs,
            "prior": self.prior or None,
            "weights": self.target.weights,
            "starts": goal.starts,
            "restarts": goal.restarts,
            "time_limit": goal.time_limit,
            "bound": goal.bound,
            "seed": goal.seed,
            "progress": progress,
        }
        if goal.accuracy is not None:
            wanted = (str(combination), goal.accuracy)
            return _soonest.soonest(*places, accuracy=wanted, **options)
        if goal.interval is not None:
            del options["bound"]
            return _shortest.shortest_interval(*places, name=goal.interval, **options)
        criterion = goal.criterion if combination is None else {"combination": combination}
        return _planner.plan(*places, criterion=criterion, **options)

    def _loop(self) -> ClosedLoop | None:
        loop = self.closed_loop
        if loop is None:
            return None
        if self.target.position is None:
            raise InputError("closed_loop needs one target: target.position")
        if not isinstance(self.observer.speed, float):
            raise InputError("closed_loop needs one speed, not a range")
        if self.observer.start is None or self.bearings.sigma_deg is None:
            raise InputError("closed_loop needs one observer that takes bearings")
        return _closed_loop.closed_loop(
            [*self.target.position, *(self.target.velocity or ())],
            self.observer.start,
            self.observer.speed,
            self.bearings.step,
            self.bearings.count,
            sigma=float(np.radians(self.bearings.sigma_deg)),
            first_range=loop.first_range,
            first_speed=loop.first_speed,
            methods=loop.methods,
            lost=loop.lost,
            when_lost=loop.when_lost,
            false_alarms=loop.false_alarms,
            opening=loop.opening,
            standoff=self.limits.standoff,
            keep_out=self.limits.keep_out or None,
            max_turn_rate=_radians(self.observer.max_turn_rate_deg),
            replan=loop.replan,
            horizon=loop.horizon,
            trials=loop.trials,
            seed=loop.seed,
        )


def _radians(degrees: float | None) -> float | None:
    return None if degrees is None else float(np.radians(degrees))


def _pictures() -> ModuleType:
    """Return the pictures, which need matplotlib: imported when a page is written."""
    from gramian.models.maneuver import plot

    return plot


def _report(
    title: str, found: Plan | Soonest | ShortestInterval, loop: ClosedLoop | None
) -> Report:
    shortest = found if isinstance(found, _shortest.ShortestInterval) else None
    soonest = found if isinstance(found, _soonest.Soonest) else None
    plan = found if isinstance(found, _planner.Plan) else found.plan
    tone, headline, verdict = _judged(found, plan)
    facts = _plan_facts(plan) if shortest is None else _shortest_facts(shortest)
    if loop is not None:
        first = loop.runs[0]
        facts.append(
            (
                "flown without knowing",
                f"{first.method} ends with {number(first.final_rms, 3)} m rms",
            )
        )
    shown = [
        Picture(
            "Paths",
            "The planned path with a dot for each bearing, and the laws on the same limits.",
            lambda: _pictures().paths(plan),
        ),
        Picture(
            "Candidate paths",
            "The best different paths that the search found, with the criterion of each.",
            lambda: _pictures().candidates(plan),
        ),
        Picture(
            "Information along the paths",
            "What is known after each bearing; a plan may lose at first to win in the end.",
            lambda: _pictures().information(plan),
        ),
        Picture(
            "Accuracy against time",
            "The bound on the target's first position after each sample, plan and laws.",
            lambda: _pictures().accuracy(plan),
        ),
        Picture(
            "Error ellipses",
            "The region that holds 95 % of the errors at the bound.",
            lambda: _pictures().ellipses(plan),
        ),
    ]
    tables = [_laws_table(plan), _bounds_table(plan), _starts_table(plan)]
    data: dict[str, Any] = _plain(plan.to_dict())
    if soonest is not None:
        tables.insert(0, _tried_table(soonest))
        data["soonest"] = _plain(soonest.to_dict())
        del data["soonest"]["plan"]
    if shortest is not None:
        tables.insert(0, _intervals_table(shortest))
        data["interval"] = _plain(shortest.to_dict())
        del data["interval"]["plan"]
        shown.insert(
            0,
            Picture(
                "Path to the shortest interval",
                'With a dot for each sample; behind it the plan for "D", the smallest ellipse.',
                lambda: _pictures().shortest(shortest),
            ),
        )
    if loop is not None:
        tables.insert(1, _loop_table(loop))
        data["closed_loop"] = _plain(loop.to_dict())
        shown.append(
            Picture(
                "Closed loop",
                "Errors of an observer that estimates the target as it goes, on the same noise.",
                lambda: _pictures().errors(loop),
            )
        )
    return Report(
        title=title,
        subtitle=f"{len(plan.values)} samples over {plan.times[-1]:.6g} s",
        tone=tone,
        headline=headline,
        verdict=verdict,
        facts=facts,
        tables=tables,
        pictures=shown,
        data=data,
    )


def _plan_facts(plan: Plan) -> list[tuple[str, str]]:
    """Return how the plan was found, and how far from the best it can be."""
    facts = [
        ("which optimum", ("the one" if plan.optima == 1 else f"the best of {plan.optima}")
         + f" that {len(plan.starts)} starts led to, chosen among {plan.guesses} guesses"),
    ]  # fmt: skip
    if plan.starts:
        facts.append(("where from", plan.starts[0].name))
    if np.isfinite(plan.clearance):
        facts.append(("nearest to a limit", f"{number(max(plan.clearance, 0.0), 3)} m"))
    facts.append(("first-order optimum", f"projected gradient {brief(plan.projected_gradient, 2)}"))
    if np.isfinite(plan.gap):
        facts.append(
            ("of any path", f"no path is better by more than {brief(100 * (plan.gap - 1), 2)} %"
             + (" in det^(1/n)" if plan.criterion == "D" else ""))
        )  # fmt: skip
    if plan.turns.size:
        times = ", ".join(f"{plan.times[turn]:.6g} s" for turn in plan.turns)
        facts.append(("turns at", times))
    return facts


def _shortest_facts(shortest: ShortestInterval) -> list[tuple[str, str]]:
    """Return where the path is from, and when it turns where it has legs."""
    name, count = shortest.candidates[0][0], len(shortest.candidates)
    facts = [("where from", f"{name}: the shortest of {count} different paths")]
    bends = np.abs(np.diff(np.atleast_2d(shortest.headings), axis=1)).max(axis=0) > 1e-6
    turns = shortest.times[1:-1][bends]
    if 0 < turns.size <= 8:
        facts.append(("turns at", ", ".join(f"{turn:.6g} s" for turn in turns)))
    facts.append(("the tables below", 'are of the plan for "D", which it was compared with'))
    return facts


def _judged(found: Plan | Soonest | ShortestInterval, plan: Plan) -> tuple[Tone, str, str]:
    """Return the tone, the headline and the verdict."""
    if isinstance(found, _shortest.ShortestInterval):
        is_open = bool(np.isinf(found.length))
        return "bad" if is_open else "good", "OPEN INTERVAL" if is_open else "PLANNED", found.reason
    tone: Tone = "good"
    headline = "PLANNED"
    if not plan.converged:
        broken = plan.message.startswith("no path")
        tone, headline = ("bad", "A LIMIT IS BROKEN") if broken else ("weak", "NOT CONVERGED")
    if isinstance(found, _soonest.Soonest):
        verdict = found.reason
        if found.samples is None:
            tone, headline = "bad", "NOT ACCURATE ENOUGH"
    else:
        best = plan.laws[0]
        position = _position_bound(plan.crlb_std, plan.weights)
        law = _position_bound(best.crlb_std, plan.weights)
        verdict = f"the target's position is known to {number(position, 3)} m"
        verdict += f", by the best law to {number(law, 3)} m"
    if not plan.converged:
        verdict += f"; {plan.message}"
    return tone, headline, verdict


def _position_bound(crlb_std: Any, weights: Any) -> float:
    return float(np.sqrt(weights @ (crlb_std[:, :2] ** 2).sum(axis=1)))


def _tried_table(soonest: Soonest) -> Table:
    rows = [
        [
            str(count),
            f"{(count - 1) * soonest.dt:.6g}",
            "" if np.isinf(found) else number(found),
            "" if least == 0 else number(least),
        ]
        for count, found, least in soonest.tried
    ]
    columns = ["samples", "time, s", f"{soonest.name} known to", "no path below"]
    note = f"Wanted: {brief(soonest.accuracy)}. Empty: nothing found, or nothing proved."
    return Table("How soon it is known so well", columns, rows, note)


def _intervals_table(shortest: ShortestInterval) -> Table:
    rows = [
        [name, "open" if np.isinf(long) else number(long), number(local)]
        for name, long, local in shortest.candidates[:12]
    ]
    unit = f", {shortest.unit}" if shortest.unit else ""
    columns = ["path", f"interval{unit}", f"by the ellipse{unit}"]
    note = f"{100 * shortest.level:.4g} % interval of {shortest.name}, by the likelihood."
    return Table("Lengths of the interval", columns, rows, note)


def _laws_table(plan: Plan) -> Table:
    rows = [
        ["plan", number(plan.value, 5), "", number(_position_bound(plan.crlb_std, plan.weights))]
    ]
    rows += [
        [
            f"law {law.law}" + ("" if law.kept else " (breaks a limit)"),
            number(law.value, 5),
            "" if np.isinf(law.behind) else f"{brief(law.behind, 4)}",
            number(_position_bound(law.crlb_std, plan.weights)),
        ]
        for law in plan.laws
    ]
    noun = {
        "D": "log det of the information",
        "A": "trace of the bound",
        "E": "smallest eigenvalue",
        "combination": "variance",
    }[plan.criterion]
    return Table(
        "The plan and the closed-form laws on the same limits",
        ["path", noun, "times behind", "position known to, m"],
        rows,
        "Times behind: the ratio of determinants, traces, eigenvalues or variances.",
    )


def _bounds_table(plan: Plan) -> Table:
    columns = ["state", "unit"]
    several = len(plan.targets) > 1
    columns += [f"possible target {i + 1}" for i in range(len(plan.targets))] if several else [
        "standard deviation"
    ]  # fmt: skip
    rows = [
        [
            name,
            UNITS.get(name.rsplit("_", 1)[0], ""),
            *(number(value) for value in plan.crlb_std[:, i]),
        ]
        for i, name in enumerate(plan.names)
    ]
    return Table("How accurately, at best, at the end", columns, rows)


def _starts_table(plan: Plan) -> Table:
    rows = [
        [
            start.name,
            "" if np.isnan(start.guess) else number(start.guess, 5),
            number(start.value, 5),
            "yes" if start.converged else "no",
        ]
        for start in plan.starts[:12]
    ]
    note = f"The best of {len(plan.starts)}; only the most promising are carried to the end."
    return Table("Starts", ["first guess", "guess", "path", "converged"], rows, note)


def _loop_table(loop: ClosedLoop) -> Table:
    rows = [
        [
            run.method,
            str(run.trials),
            f"{number(run.final_rms, 3)} +- {brief(run.uncertainty, 1)}",
            f"{number(run.final_median, 3)}",
            f"{number(run.final_p90, 3)}",
            f"{brief(run.nearest.min(), 4)}",
        ]
        for run in loop.runs
    ]
    columns = ["method", "trials", "final error rms, m", "median, m", "90 %, m", "nearest range, m"]
    note = "The target is not known to the observer: it estimates, chooses, moves and measures."
    return Table("Closed loop", columns, rows, note)


def _plain(value: Any) -> Any:
    """Replace what JSON has no number for: infinity becomes null."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
