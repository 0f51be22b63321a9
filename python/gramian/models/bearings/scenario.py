"""Scenarios of bearings-only target motion: `model = "bearings"`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from gramian import _core, io
from gramian._arrays import wrap_angles
from gramian._text import brief, number, plain, signed
from gramian.analysis import Observability, analyze
from gramian.bounds import crlb_std
from gramian.exceptions import InputError, ScenarioError
from gramian.models.bearings import _rows
from gramian.report import Picture, Report, Table, Tone, answer_pictures, answer_tables, tone_of
from gramian.scenario.base import Scenario, Section, Simulation

if TYPE_CHECKING:
    from gramian.problem import Problem

__all__ = ["BearingsScenario", "Geometry"]

Array = NDArray[np.float64]

#: A position known no better than this part of the range is not a fix.
USELESS = 0.25


class Columns(Section):
    """The names of the columns in a table of tracks, where their headings do not say it."""

    id: str | None = None
    date: str | None = None
    time: str | None = None
    east: str | None = None
    north: str | None = None
    latitude: str | None = None
    longitude: str | None = None
    height: str | None = None
    speed: str | None = None
    course: str | None = None
    bearing: str | None = None
    sensor: str | None = None

    @model_validator(mode="after")
    def _pairs(self) -> Columns:
        for one, other in (("east", "north"), ("latitude", "longitude")):
            if (getattr(self, one) is None) != (getattr(self, other) is None):
                there = one if getattr(self, one) else other
                raise ValueError(f"{there} is given alone: give {one} and {other}")
        return self


class Reading(Section):
    """How a file is read; all of it is found where it is not given."""

    units: dict[str, str] = Field(default_factory=dict)
    separator: str | None = Field(default=None, min_length=1, max_length=1)
    decimal: Literal[".", ","] | None = None
    dates: Literal["day first", "month first"] | None = None
    trust: list[str] = Field(default_factory=list)


class Tracks(Reading):
    """Recorded tracks, in any of the formats of `gramian.io`."""

    file: str | list[str]
    target_file: str | None = None
    columns: Columns | None = None
    observer: str | None = None
    target: str | None = None
    max_gap: float = Field(default=120.0, gt=0)

    @model_validator(mode="after")
    def _ids(self) -> Tracks:
        columns = self.columns
        if columns is not None and columns.id is not None and self.observer is None:
            raise ValueError("observer must name a track, since columns.id is given")
        if self.target_file in (None, self.file) and self.observer == self.target is not None:
            raise ValueError(f"observer and target are the same track, {self.target!r}")
        return self

    @property
    def files(self) -> list[str]:
        """The files of the observer, and of the target where it has none of its own."""
        return [self.file] if isinstance(self.file, str) else self.file


class BearingColumns(Section):
    """The names of the columns in a table of bearings, where their headings do not say it."""

    time: str | None = None
    bearing_deg: str | None = None
    bearing_rad: str | None = None

    @model_validator(mode="after")
    def _once(self) -> BearingColumns:
        if self.bearing_deg is not None and self.bearing_rad is not None:
            raise ValueError("give bearing_deg or bearing_rad, not both")
        return self


class MeasuredBearings(Reading):
    """Measured bearings for `localize`, clockwise from north."""

    file: str | None = None
    sensor: str | None = None
    columns: BearingColumns | None = None


class Target(Section):
    """A target at constant velocity, in place of a recorded one: m, m/s."""

    x0: float
    y0: float
    vx: float
    vy: float


class Window(Section):
    """When the bearings are taken: seconds, as the files count them.

    In files with dates, second 0 is that of the first report. Measured bearings have
    their own times, and no step.
    """

    start: float | str | None = None
    duration: float = Field(gt=0)
    step: float | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _steps(self) -> Window:
        if self.step is None:
            return self
        if self.step > self.duration:
            raise ValueError(f"step {self.step} s must not exceed the duration {self.duration} s")
        if self.duration / self.step > 1e6:
            raise ValueError("a window of more than a million bearings: choose a longer step")
        return self

    def times(self, start: float) -> Array:
        """Instants from the start to the end of the window."""
        step = self.duration / 60 if self.step is None else self.step
        # Both ends belong to the window; a rounding error must not drop the last.
        count = int(np.floor(self.duration / step * (1 + 1e-12))) + 1
        return np.asarray(start + step * np.arange(count), dtype=float)


class Noise(Section):
    """The bearings' standard deviation, degrees."""

    bearing_deg: float = Field(gt=0, lt=90)


class Known(Section):
    """What is known beforehand of a state or combination; the mean is used by `localize`."""

    sigma: float = Field(gt=0)
    mean: float | None = None


class Limits(Section):
    """Standard deviations from which a state counts as weakly known: m, m/s."""

    position: float | None = Field(default=None, gt=0)
    velocity: float | None = Field(default=None, gt=0)


Quantity = Literal["x0", "y0", "vx", "vy", "range", "bearing", "speed", "course"]


class BearingsScenario(Scenario):
    """An observer, a target, a window of time and the noise of the bearings."""

    model: Literal["bearings"]
    tracks: Tracks
    target: Target | None = None
    bearings: MeasuredBearings | None = None
    window: Window | None = None
    noise: Noise
    prior: dict[Quantity, Known | float] = Field(default_factory=dict)
    known: list[Literal["x0", "y0", "vx", "vy"]] = Field(default_factory=list)
    limits: Limits = Limits()

    @model_validator(mode="after")
    def _one_target(self) -> BearingsScenario:
        recorded = self.tracks.target is not None or self.tracks.target_file is not None
        given = recorded + (self.target is not None)
        if given > 1 or not (given or self.bearings):
            raise ValueError(
                "give the target once: as tracks.target (a recorded track) "
                "or as the section [target] (x0, y0, vx, vy); "
                "with measured [bearings] it may be left out"
            )
        for name, value in self.prior.items():
            if isinstance(value, float) and not value > 0:
                raise ValueError(f"prior.{name} = {value}: must be > 0")
        if len(set(self.known)) == 4:
            raise ValueError("known names every state: nothing is left to determine")
        return self

    @property
    def sigma(self) -> float:
        """The bearings' standard deviation, radians."""
        return float(np.radians(self.noise.bearing_deg))

    @cached_property
    def geometry(self) -> Geometry:
        """Where observer and target are at each instant."""
        if self.target is None and self.tracks.target is None and self.tracks.target_file is None:
            raise self.error(
                "tracks.target", "is missing: analyze and simulate ask about a given target"
            )
        times = self.times
        names = [self.tracks.observer or "observer", self.tracks.target or "target"]
        if self.target is not None:
            observer = self.track(self.tracks.observer, times)
            state = np.array([self.target.x0, self.target.y0, self.target.vx, self.target.vy])
            target = state[:2] + (times - times[0])[:, None] * state[2:]
        else:
            observer, target = self.track(self.tracks.observer, times), self.target_at(times)
        return Geometry(names[0], names[1], times, observer, target, self.sigma)

    @cached_property
    def recording(self) -> io.Recording:
        """The files of tracks and bearings, on one clock and in one plane."""
        if isinstance(self._taken, io.Recording):
            return self._taken
        tracks = self.tracks
        columns = tracks.columns.model_dump(exclude_none=True) if tracks.columns else {}
        parts = [
            self._read(file, columns, tracks)
            for file in [*tracks.files, *([tracks.target_file] if tracks.target_file else [])]
        ]
        given = self.bearings
        if given is not None and given.file is not None and given.file not in tracks.files:
            seen = given.columns.model_dump(exclude_none=True) if given.columns else {}
            units = {"bearing": "rad"} if "bearing_rad" in seen else {}
            for name in ("bearing_deg", "bearing_rad"):
                if name in seen:
                    seen["bearing"] = seen.pop(name)
                    units = units or {"bearing": "deg"}
            parts.append(self._read(given.file, seen, given, units))
        trust = {*tracks.trust, *(given.trust if given is not None else ())}
        try:
            return io.joined(parts, trust)
        except InputError as error:
            raise ScenarioError(str(error)) from error

    def _read(
        self,
        file: str,
        columns: dict[str, str],
        how: Reading,
        units: dict[str, str] | None = None,
    ) -> io.Recording:
        try:
            return io.read(
                self.beside(file),
                columns=columns,
                units={**(units or {}), **how.units},
                separator=how.separator,
                decimal=how.decimal,
                dates=how.dates,
                trust=how.trust,
            )
        except InputError as error:
            raise ScenarioError(str(error)) from error

    @cached_property
    def times(self) -> Array:
        """The instants of the bearings.

        Those that were measured; else those of the window, or 61 over the whole time that
        the tracks share.
        """
        if self.measured is not None:
            return self.measured[0]
        if self.window is not None:
            return self.window.times(self.start)
        first, last = self._span
        if not last > first:
            raise self.error("window", "the tracks have no time in common: give a window")
        return np.linspace(first, last, 61)

    @property
    def start(self) -> float:
        """The first instant, s as the recording counts them."""
        start = None if self.window is None else self.window.start
        if isinstance(start, float):
            return start
        if start is None or start.startswith("+"):
            later = 0.0
            try:
                later = float(start or 0.0)
            except ValueError:
                raise self._no_start(start) from None
            return self._span[0] + later
        if self.recording.epoch is None:
            raise self.error("window.start", f"{start!r} is a date, and the files have none")
        try:
            return io.unix_seconds(start) - self.recording.epoch
        except ValueError:
            raise self._no_start(start) from None

    def _no_start(self, start: str | None) -> ScenarioError:
        return self.error(
            "window.start",
            f"{start!r}: must be seconds, a date (2026-05-01T12:00:00Z), or seconds from the "
            'first instant that the tracks share ("+600")',
        )

    @cached_property
    def measured(self) -> tuple[Array, Array] | None:
        """Times and bearings of the sensor within the window; None where none is meant."""
        seen = {n: d for n, d in self.recording.sensors.items() if d.bearing is not None}
        if self._sensor is None:
            return None
        chosen = seen[self._sensor]
        times, bearing = chosen.times, np.asarray(chosen.bearing)
        inside = np.isfinite(bearing)
        if self.window is not None:
            first, last = self.start, self.start + self.window.duration
            inside &= (times >= first) & (times <= last)
            if not inside.any():
                when = self.recording.when
                raise self.error(
                    "window",
                    f"{self.recording.where} has no bearing from {when(first)} to {when(last)}: "
                    f"they are from {when(float(times[0]))} to {when(float(times[-1]))}",
                )
        return times[inside], bearing[inside]

    @cached_property
    def _sensor(self) -> str | None:
        """The sensor whose bearings are meant: the one named, or the only one."""
        given = None if self.bearings is None else self.bearings.sensor
        seen = [name for name, d in self.recording.sensors.items() if d.bearing is not None]
        if given is None:
            if len(seen) == 1:
                return seen[0]
            if self.bearings is None:
                return None
        if given not in seen:
            there = ", ".join(map(repr, seen)) or "none"
            problem = "is missing" if given is None else f"no sensor is named {given!r}"
            raise self.error("bearings.sensor", f"{problem}: sensors with bearings are {there}")
        return given

    @cached_property
    def _span(self) -> tuple[float, float]:
        """The first and the last instant that the tracks and the sensor share."""
        spans = [self._named(self.tracks.observer).times]
        if self._sensor is not None:
            spans.append(self.recording.sensors[self._sensor].times)
        elif self.target is None:
            spans.append(self._target_track().times)
        return max(float(t[0]) for t in spans), min(float(t[-1]) for t in spans)

    def _named(self, name: str | None) -> io.Track:
        if name is None and len(self.recording.tracks) > 1:
            # The observer's file may stand beside the target's own.
            name = next(iter(self.recording.tracks))
        try:
            return self.recording.track(name)
        except InputError as error:
            raise self.error("tracks", str(error)) from error

    def track(self, name: str | None, times: Array) -> Array:
        """Return the positions of a track at given times, interpolated between its reports."""
        return self._along(self._named(name), times)

    def _along(self, track: io.Track, times: Array) -> Array:
        if track.times.size < 2:
            raise self.error("tracks", f"{track.name} has 1 report: must have at least 2")
        try:
            return track.at(times, self.tracks.max_gap, self.recording.when)
        except InputError as error:
            raise self.error("window", str(error).replace("max_gap", "tracks.max_gap")) from error

    def target_at(self, times: Array) -> Array:
        """Return the recorded positions of the target at given times."""
        return self._along(self._target_track(), times)

    def _target_track(self) -> io.Track:
        name = self.tracks.target
        if name is None:
            observer = self.tracks.observer or next(iter(self.recording.tracks))
            others = [track for track in self.recording.tracks if track != observer]
            if len(others) != 1:
                there = ", ".join(map(repr, others)) or "none"
                raise self.error(
                    "tracks.target", f"is missing: beside {observer!r} there are {there}"
                )
            name = others[0]
        return self._named(name)

    @property
    def epoch(self) -> dict[str, Any]:
        """When the states are: seconds of the recording, and the date where there is one."""
        first, zero = float(self.times[0]), self.recording.epoch
        return {"time": first, "utc": None if zero is None else io.utc(zero + first)}

    @cached_property
    def problem(self) -> Problem:
        """The rows, with what is known and the limits."""
        geometry = self.geometry
        problem = geometry.problem
        position = self.limits.position or USELESS * geometry.mean_range
        velocity = self.limits.velocity or USELESS * geometry.mean_range / geometry.duration
        problem = problem.with_scale([position, position, velocity, velocity])
        if self.known:
            problem = problem.fix(*self.known)
        priors: dict[str, float] = {}
        for name, value in self.prior.items():
            if name in problem.names or name in problem.combinations:
                priors[name] = value if isinstance(value, float) else value.sigma
            else:
                what = "a known state" if name in self.known else "undefined for this target"
                raise self.error(f"prior.{name}", f"is {what}")
        return problem.prior(priors)

    def analyze(self) -> Report:
        """Answer whether the target's motion can be determined from its bearings, and how well."""
        geometry, problem = self.geometry, self.problem
        answer = analyze(problem)
        relative = _relative(answer, geometry)
        fit = geometry.straight_line_fit(answer)
        tone, headline, verdict = _verdict(answer, relative, fit)
        pictures = [
            Picture(
                "Geometry",
                "Paths, some of the lines of sight, and "
                + (
                    "the line along which the target may be anywhere."
                    if answer.nullity
                    else "the 95 % error ellipse of the target's first position at the bound."
                ),
                lambda: _pictures().geometry(geometry, answer),
            ),
            Picture(
                "How the bound falls with time",
                "Bound on the first position over the mean range, from the bearings so far. "
                "Below 10 % is a fix; above 100 % the error exceeds the range itself.",
                lambda: _pictures().bound_against_time(geometry, self._bound_history()),
            ),
            Picture(
                "Bearings",
                "Above, the bearings of the target; below, what the best constant-velocity fit "
                "leaves of them without noise, against one standard deviation of the noise.",
                lambda: _pictures().bearing_history(geometry, fit),
            ),
            *answer_pictures(answer),
        ]
        facts, helps = self._advice(answer, relative, fit)
        tables = answer_tables(answer)
        if helps:
            tables.insert(
                1,
                Table(
                    "What would help",
                    ["what", "bound on the first position", "of the mean range"],
                    [[what, number(bound) + " m", _percent(part)] for what, bound, part in helps],
                ),
            )
        data: dict[str, Any] = {
            "model": self.model,
            "observer": geometry.observer_name,
            "target": geometry.target_name,
            "bearings": geometry.times.size,
            "epoch": self.epoch,
            "mean_range": geometry.mean_range,
            "relative_bound": plain(relative),
            "observability": answer.to_dict(),
            "constant_velocity": {
                "off_line_max": fit.off_line,
                "misfit_chi2": fit.misfit,
                "bias": plain(fit.bias),
                "holds": fit.holds,
            },
            "help": [
                {"what": what, "bound": plain(bound), "relative_bound": plain(part)}
                for what, bound, part in helps
            ],
        }
        return Report(
            title=f"{geometry.observer_name} -> {geometry.target_name}",
            subtitle=(
                f"{geometry.times.size} bearings over {geometry.duration:g} s, "
                f"sigma {self.noise.bearing_deg:g} deg, mean range {geometry.mean_range:.0f} m"
            ),
            tone=tone,
            headline=headline,
            verdict=verdict,
            facts=facts,
            tables=tables,
            pictures=pictures,
            data=data,
        )

    def experiment(self) -> Simulation:
        """Return the experiment of a target on the straight track nearest to this one."""
        from gramian.monte_carlo import Bearings

        geometry = self.geometry
        if self.known:
            raise self.error("known", "simulate estimates every state: give a [prior] instead")
        priors: dict[str, float] = {}
        for name, value in self.prior.items():
            if name not in _rows.NAMES:
                raise self.error(
                    f"prior.{name}", "simulate takes what is known of x0, y0, vx and vy alone"
                )
            priors[name] = value if isinstance(value, float) else value.sigma
        t = geometry.times - geometry.times[0]
        design = np.stack([np.ones_like(t), t], axis=1)
        line = np.linalg.lstsq(design, geometry.target, rcond=None)[0]
        off = float(np.hypot(*(geometry.target - design @ line).T).max())
        facts = []
        if self.target is None:
            facts.append(
                (
                    "simulated target",
                    f"on the straight track nearest to the recorded one ({off:.0f} m off at most)",
                )
            )
        return Simulation(
            Bearings(geometry.times, geometry.observer, np.concatenate(line), self.sigma, priors),
            title=f"{geometry.observer_name} -> {geometry.target_name}",
            subtitle=(
                f"{geometry.times.size} bearings over {geometry.duration:g} s, "
                f"sigma {self.noise.bearing_deg:g} deg"
            ),
            facts=facts,
        )

    def localize(self) -> Report:
        """Estimate the target's motion from measured bearings."""
        from gramian.models.bearings._scenario_localize import localize

        return localize(self)

    def _bound_history(self) -> tuple[Array, Array]:
        """Relative bound from the bearings up to each instant."""
        geometry, rows = self.geometry, self.problem.all_rows
        m = geometry.times.size
        ends = np.unique(np.linspace(2, m, min(m - 1, 120)).astype(int))
        bounds = []
        for end in ends:
            # Zero rows in place of the bearings to come keep one shape and one call.
            part = rows.copy()
            part[end:m] = 0.0
            bounds.append(part)
        std = crlb_std(np.array(bounds))
        place = [i for i, name in enumerate(self.problem.names) if name in ("x0", "y0")]
        relative: Array = np.sqrt((std[:, place] ** 2).sum(axis=1)) / geometry.mean_range
        return geometry.times[ends - 1] - geometry.times[0], relative

    def _advice(
        self, answer: Observability, relative: float, fit: StraightLineFit
    ) -> tuple[list[tuple[str, str]], list[tuple[str, float, float]]]:
        geometry, problem = self.geometry, self.problem
        facts: list[tuple[str, str]] = []
        if answer.nullity:
            facts += [("cannot be determined", text) for text in answer.null_combinations]
        else:
            along = answer.weakest_direction
            moves = ", ".join(
                f"{name} {signed(value)} {unit}"
                for name, value, unit in zip(answer.names, along, answer.units, strict=True)
            )
            facts.append(("hardest direction (1 sigma)", moves))
        place = [i for i, name in enumerate(problem.names) if name in ("x0", "y0")]

        def bound(std: Array) -> float:
            return float(np.sqrt((std[place] ** 2).sum()))

        helps = []
        knowledge = {
            "speed": (0.5, "target speed known to 0.5 m/s"),
            "course": (np.radians(5.0), "target course known to 5 deg"),
            "range": (0.1 * geometry.mean_range, "one range known to 10 %"),
        }
        for name, (sigma, what) in knowledge.items():
            if name in problem.combinations:
                helps.append((what, bound(answer.knowing(name, sigma).crlb_std)))
        turns = [(what, bound(crlb_std(turned))) for what, turned in geometry.turns(self.problem)]
        helps += sorted(turns, key=lambda item: item[1])[:2]
        helps = [item for item in helps if item[1] < relative * geometry.mean_range]
        helps.sort(key=lambda item: item[1])
        ranked = [(what, value, value / geometry.mean_range) for what, value in helps]
        if not relative < 0.02:
            for label, (what, _, part) in zip(
                ("what would help most", "what would help next"), ranked[:2], strict=False
            ):
                facts.append((label, f"{what}  ->  position to {_percent(part)} of the range"))
        facts.append(("does the target keep its course?", fit.describe()))
        facts.append(("time of the states", self.recording.when(float(self.times[0]))))
        return facts, ranked


@dataclass(frozen=True, eq=False)
class StraightLineFit:
    """How well the target's positions agree with constant velocity."""

    off_line: float
    """Largest distance of a position from the best straight track, m."""
    misfit: float
    """Chi-square that the noise-free bearings leave over a constant-velocity fit."""
    bias: Array
    """Error of that fit in each state."""
    residuals: Array
    """What it leaves of each bearing, rad."""
    ratio: float
    """Bias of the first position over its bound."""
    p_value: float
    """Median p-value with which the bearings would reject the fit."""

    @property
    def holds(self) -> bool:
        """Whether the bound can be believed: the bias is within it and the misfit unseen."""
        return self.ratio < 1 and self.p_value > 0.05

    def describe(self) -> str:
        """Return the finding in words."""
        off = f"up to {self.off_line:.0f} m" if self.off_line >= 0.5 else "less than 1 m"
        text = f"it is {off} off any straight line"
        if self.holds:
            return f"yes, near enough: {text}"
        parts = []
        if self.ratio >= 1:
            parts.append(f"a constant-velocity fit is off by {self.ratio:.1f} times the bound")
        seen = "shows" if self.p_value <= 0.05 else "does not show"
        parts.append(f"the misfit {seen} in the bearings (median p = {brief(self.p_value, 2)})")
        return f"NO: {text}; {'; '.join(parts)}"


@dataclass(frozen=True, eq=False)
class Geometry:
    """Positions of observer and target at the instants of the bearings."""

    observer_name: str
    target_name: str
    times: Array
    observer: Array
    target: Array
    sigma: float

    @cached_property
    def problem(self) -> Problem:
        """The rows at these positions."""
        return _rows.problem(self.times, self.observer, self.target, self.sigma)

    @cached_property
    def ranges(self) -> Array:
        """Distance at each instant, m."""
        ranges: Array = np.hypot(*(self.target - self.observer).T)
        return ranges

    @property
    def duration(self) -> float:
        """From the first bearing to the last, s."""
        return float(self.times[-1] - self.times[0])

    @property
    def mean_range(self) -> float:
        """Mean of the distance, m."""
        return float(self.ranges.mean())

    @property
    def bearing(self) -> Array:
        """Noise-free bearings, rad."""
        offset = self.target - self.observer
        angle: Array = np.arctan2(offset[:, 0], offset[:, 1])
        return angle

    def straight_line_fit(self, answer: Observability) -> StraightLineFit:
        """Fit constant velocity to the positions, and to their noise-free bearings."""
        t = self.times - self.times[0]
        design = np.stack([np.ones_like(t), t], axis=1)
        line = np.linalg.lstsq(design, self.target, rcond=None)[0]
        straight = design @ line
        off_line = float(np.hypot(*(self.target - straight).T).max())
        names = list(answer.names)
        free = [_rows.NAMES.index(name) for name in names]
        # The fit starts on the straight track nearest to the truth and goes where
        # the bearings pull it: what it moves by is the bias of an estimator.
        state = np.concatenate(line)
        start = state.copy()
        rows = residual = np.zeros(0)
        for _ in range(12):
            position = state[:2] + t[:, None] * state[2:]
            offset = position - self.observer
            if not np.hypot(*offset.T).min() > 0:
                break
            change = self.bearing - np.arctan2(offset[:, 0], offset[:, 1])
            residual = wrap_angles(change)
            rows = _rows.rows(self.times, self.observer, position, self.sigma)[:, free]
            scale = 1 / np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
            step = scale * np.linalg.lstsq(rows * scale, residual / self.sigma, rcond=1e-9)[0]
            state[free] += step
            if np.hypot(*(state - start)[:2]) > 10 * self.mean_range:
                break
        misfit = float(((residual / self.sigma) ** 2).sum())
        bias = np.zeros(4)
        bias[free] = (state - start)[free]
        # The first position of the recorded track, not of the straight line, is
        # what a user compares with.
        bias[:2] += start[:2] - self.target[0]
        place = [i for i, name in enumerate(names) if name in ("x0", "y0")]
        bound = float(np.sqrt((answer.crlb_std[place] ** 2).sum()))
        ratio = float(np.hypot(*bias[:2])) / bound if bound > 0 else 0.0
        dof = max(t.size - len(free), 1)
        return StraightLineFit(
            off_line=off_line,
            misfit=misfit,
            bias=bias,
            residuals=residual,
            ratio=ratio,
            p_value=float(_core.chi_square_survival(dof + misfit, dof)),
        )

    def turns(self, problem: Problem) -> list[tuple[str, Problem]]:
        """Return the same problem had the observer turned: each of some turns."""
        free = [_rows.NAMES.index(name) for name in problem.names]
        m = self.times.size
        turned = []
        for part in (1 / 3, 1 / 2, 2 / 3):
            k = int(part * (m - 1))
            for angle in (-90, -60, -30, 30, 60, 90):
                a = np.radians(angle)
                # A clockwise turn: rotate what comes after instant k about there.
                turn = np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
                path = self.observer.copy()
                path[k:] = path[k] + (path[k:] - path[k]) @ turn.T
                if not np.hypot(*(self.target - path).T).min() > 0:
                    continue
                rows = _rows.rows(self.times, path, self.target, self.sigma)[:, free]
                side = "right" if angle > 0 else "left"
                what = (
                    f"a {abs(angle)} deg turn to the {side} "
                    f"at {self.times[k] - self.times[0]:.0f} s"
                )
                turned.append((what, problem.with_rows(rows)))
        return turned


def _relative(answer: Observability, geometry: Geometry) -> float:
    place = [i for i, name in enumerate(answer.names) if name in ("x0", "y0")]
    return float(np.sqrt((answer.crlb_std[place] ** 2).sum())) / geometry.mean_range


def _verdict(answer: Observability, relative: float, fit: StraightLineFit) -> tuple[Tone, str, str]:
    tone = tone_of(answer)
    if answer.nullity:
        combination = answer.null_combinations[0]
        return (
            tone,
            "UNOBSERVABLE",
            f"no bearing changes when the states move together: {combination}",
        )
    headline = "WEAKLY OBSERVABLE" if answer.status == "weak" else "OBSERVABLE"
    verdict = f"the bound on the position is {_percent(relative)} of the range"
    if relative >= 1:
        tone, headline = "bad", "HOPELESS"
        verdict += ": the error is larger than the range itself"
    elif relative < 0.02 and fit.holds:
        verdict += ": easy"
    elif answer.status == "weak" and relative < USELESS:
        verdict += f", but {answer.reason}"
    if not fit.holds and tone != "bad":
        tone = "weak"
        headline += " IF IT KEEPS ITS COURSE"
        verdict += f", but the target turns: it is {fit.off_line:.0f} m off any straight line"
    return tone, headline, verdict


def _percent(part: float) -> str:
    value = 100 * part
    return f"{number(value, 2)} %" if value < 100 else f"{value:.0f} %"


def _pictures() -> Any:
    from gramian.models.bearings import plot as pictures

    return pictures
