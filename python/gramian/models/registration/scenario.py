"""Scenarios of sensor registration: `model = "registration"`."""

from __future__ import annotations

from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from gramian._text import brief, count, describe_direction, number, plain
from gramian.analysis import Observability, analyze
from gramian.bounds import crlb_std
from gramian.exceptions import ConvergenceError, InputError, UnobservableError
from gramian.models.registration import (
    _degree,
    _estimate,
    _field,
    _model,
    _reports,
    _select,
    _tracks,
)
from gramian.models.registration._estimate import Estimate
from gramian.models.registration._reports import Reports
from gramian.models.registration._select import Selection
from gramian.models.registration._setup import Platform, setup
from gramian.report import Picture, Report, Table, Tone, answer_pictures, answer_tables, tone_of
from gramian.scenario.base import Scenario, Section, Simulation
from gramian.scenario.files import read_columns

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gramian.problem import Problem

__all__ = ["RegistrationScenario"]

Array = NDArray[np.float64]
Kind = Literal[
    "range", "azimuth_deg", "elevation_deg", "gain", "east", "north", "up",
    "tilt_east_deg", "tilt_north_deg", "heading_deg",
]  # fmt: skip


class PathColumns(Section):
    """The names of the columns in the file of a sensor's path."""

    time: str
    east: str
    north: str
    up: str | None = None
    heading_deg: str | None = None


class Sensor(Section):
    """A sensor: its place in metres, or its path, and its standard deviations."""

    east: float | None = None
    north: float | None = None
    up: float | None = None
    velocity: list[float] | None = Field(default=None, min_length=2, max_length=3)
    file: str | None = None
    columns: PathColumns | None = None
    heading_deg: float | None = None
    azimuths: Literal["north", "heading"] = "north"
    sigma_range: float = Field(gt=0)
    sigma_azimuth_deg: float = Field(gt=0, lt=90)
    sigma_elevation_deg: float | None = Field(default=None, gt=0, lt=90)

    @model_validator(mode="after")
    def _placed(self) -> Sensor:
        if (self.file is None) != (self.columns is None):
            raise ValueError("file and columns go together: the path of a sensor that moves")
        if self.file is not None:
            fixed = ("east", "north", "up", "velocity", "heading_deg")
            if given := [key for key in fixed if getattr(self, key) is not None]:
                raise ValueError(f"{given[0]} is for a sensor without a file of its path")
        elif self.east is None or self.north is None:
            raise ValueError("a sensor needs east and north, or a file of its path")
        up = self.up if self.columns is None else self.columns.up
        if (up is None) != (self.sigma_elevation_deg is None):
            raise ValueError("up and sigma_elevation_deg go together: both for sensors in space")
        if self.velocity is not None and len(self.velocity) != self.d:
            raise ValueError(f"velocity must have {self.d} numbers")
        if self.azimuths == "heading" and not self.moves and self.heading_deg is None:
            raise ValueError('azimuths = "heading" needs a heading_deg, or a sensor that moves')
        return self

    @property
    def d(self) -> int:
        """Number of coordinates."""
        return 2 if self.sigma_elevation_deg is None else 3

    @property
    def moves(self) -> bool:
        """Whether it has a path."""
        return self.file is not None or self.velocity is not None


class TargetColumns(Section):
    """The names of the columns in the file of tracks."""

    id: str
    time: str
    east: str
    north: str
    up: str | None = None


class Targets(Section):
    """Tracks of targets from a file: metres, seconds."""

    file: str
    columns: TargetColumns
    names: list[str] | None = None


class Track(Section):
    """A target on a straight line at constant speed, in place of a recorded one."""

    start: list[float] = Field(min_length=2, max_length=3)
    velocity: list[float] = Field(min_length=2, max_length=3)
    duration: float = Field(gt=0)
    step: float = Field(gt=0)

    @model_validator(mode="after")
    def _looks(self) -> Track:
        if self.duration / self.step > 1e5:
            raise ValueError("a track of more than a hundred thousand looks: a longer step")
        return self


class ReportColumns(Section):
    """The names of the columns in the file of reports."""

    target: str
    time: str
    sensor: str
    range: str
    azimuth_deg: str
    elevation_deg: str | None = None


class Reported(Section):
    """Reports of all sensors from a file: metres, degrees, seconds."""

    file: str
    columns: ReportColumns
    interpolate: Literal["none", "linear"] = "none"
    missing: Literal["raise", "drop"] = "drop"
    tolerance: float = Field(default=1e-3, gt=0)
    max_gap: float = Field(default=60.0, gt=0)


class Estimation(Section):
    """How biases are estimated, and what is known of them: deviations about 0."""

    method: Literal["ls", "gls", "ml"] = "ml"
    loss: Literal["squares", "huber", "tukey"] = "squares"
    clocks: bool = False
    prior: dict[str, dict[Kind, float]] = Field(default_factory=dict)


class Map(Section):
    """A map of a degree or bound, edges in metres."""

    west: float
    east: float
    south: float
    north: float
    heading_deg: float | None = None
    radius: float = Field(default=2000.0, gt=0)
    quantity: str = "eta"

    @model_validator(mode="after")
    def _edges(self) -> Map:
        if not (self.west < self.east and self.south < self.north):
            raise ValueError("a map needs west < east and south < north")
        return self


class RegistrationScenario(Scenario):
    """Sensors, targets that all of them see, and what is asked of their reports."""

    model: Literal["registration"]
    sensors: dict[str, Sensor] = Field(min_length=2)
    extras: list[Literal["gain", "position", "attitude"]] = Field(default_factory=list)
    targets: Targets | None = None
    tracks: dict[str, Track] = Field(default_factory=dict)
    reports: Reported | None = None
    biases: dict[str, dict[Kind, float]] = Field(default_factory=dict)
    useless: dict[Kind, float] = Field(default_factory=dict)
    seed: int = Field(default=1, ge=0)
    select: int = Field(default=3, ge=1)
    estimate: Estimation = Estimation()
    maps: list[Map] = Field(default_factory=list)

    @model_validator(mode="after")
    def _whole(self) -> RegistrationScenario:
        if len({sensor.d for sensor in self.sensors.values()}) > 1:
            raise ValueError("sensors: all of them in space, with up, or none")
        given = [self.targets is not None, bool(self.tracks), self.reports is not None]
        if sum(given) != 1:
            raise ValueError(
                "give the targets once: [targets] (a file), [tracks.NAME] (straight lines) "
                "or [reports] (what the sensors measured)"
            )
        for section, names in (("biases", self.biases), ("estimate.prior", self.estimate.prior)):
            for name in names:
                if name not in self.sensors:
                    raise ValueError(
                        f"{section}.{name}: no sensor is named so: {', '.join(self.sensors)}"
                    )
        if self.biases and self.reports is not None:
            raise ValueError("biases are for simulated reports: recorded ones have their own")
        if self.maps and self.moving:
            raise ValueError("maps are for sensors that stand")
        return self

    @property
    def d(self) -> int:
        """Number of coordinates."""
        return next(iter(self.sensors.values())).d

    @property
    def moving(self) -> bool:
        """Whether a sensor moves."""
        return any(sensor.moves for sensor in self.sensors.values())

    @cached_property
    def places(self) -> dict[str, Array | Platform]:
        """Where the sensors are, m."""
        return {name: self._place(name, sensor) for name, sensor in self.sensors.items()}

    def _place(self, name: str, sensor: Sensor) -> Array | Platform:
        if sensor.file is not None and sensor.columns is not None:
            columns = sensor.columns
            numbers = {"time": columns.time, "east": columns.east, "north": columns.north}
            if columns.up is not None:
                numbers["up"] = columns.up
            axes = tuple(numbers)[1:]
            if columns.heading_deg is not None:
                numbers["heading"] = columns.heading_deg
            values, _ = read_columns(self.beside(sensor.file), numbers)
            path = np.stack([values[axis] for axis in axes], axis=1)
            heading = np.radians(values["heading"]) if "heading" in values else None
            try:
                return Platform(path, values["time"], heading, sensor.azimuths)
            except InputError as error:
                raise self.error(f"sensors.{name}", str(error)) from error
        place = np.array([sensor.east, sensor.north, sensor.up][: self.d], dtype=float)
        turn = None if sensor.heading_deg is None else float(np.radians(sensor.heading_deg))
        if sensor.velocity is None:
            if sensor.azimuths == "north":
                return place
            return Platform(place, heading=turn, azimuths=sensor.azimuths)
        looks = np.concatenate(
            [_times(reports) for reports in self.measured.values()]
            if self.reports is not None
            else [times for times, _ in self.seen.values()]
        )
        ends = np.array([looks.min(), looks.max()])
        ends[1] += ends[0] == ends[1]
        headings = None if turn is None else np.full(2, turn)
        path = place + ends[:, None] * np.array(sensor.velocity)
        return Platform(path, ends, headings, sensor.azimuths)

    @property
    def paths(self) -> dict[str, Array]:
        """Places (d,) and paths (m, d) of the sensors, m."""
        return {
            name: np.asarray(place.path if isinstance(place, Platform) else place)
            for name, place in self.places.items()
        }

    @cached_property
    def sigma(self) -> Array:
        """Standard deviations (N, d), m and rad."""
        lines = []
        for s in self.sensors.values():
            angles = [s.sigma_azimuth_deg]
            angles += [s.sigma_elevation_deg] if s.sigma_elevation_deg is not None else []
            lines.append([s.sigma_range, *np.radians(angles)])
        return np.array(lines)

    def _by_name(self, section: str, values: dict[str, dict[Kind, float]]) -> dict[str, float]:
        found = {}
        for sensor, biases in values.items():
            for key, value in biases.items():
                kind = key.removesuffix("_deg")
                name = f"{sensor}.{kind}"
                if name not in self.names:
                    raise self.error(f"{section}.{sensor}.{key}", "the sensor has no such bias")
                found[name] = float(np.radians(value)) if key.endswith("_deg") else value
        return found

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The biases."""
        apart = {name: np.full(self.d, float(i)) for i, name in enumerate(self.sensors)}
        return setup(apart, self.sigma, self.extras).names

    @cached_property
    def truth(self) -> dict[str, float]:
        """Biases put into simulated reports."""
        return self._by_name("biases", self.biases)

    @cached_property
    def prior(self) -> dict[str, float] | None:
        """Deviations known beforehand."""
        return self._by_name("estimate.prior", self.estimate.prior) or None

    @cached_property
    def seen(self) -> dict[str, tuple[Array, Array]]:
        """Times and positions of each target."""
        if self.reports is not None:
            return {
                name: (_times(r), r.positions(self.places, self.sigma, extras=self.extras))
                for name, r in self.measured.items()
            }
        if self.targets is None:
            tracks: dict[str, tuple[Array, Array]] = {}
            for name, track in self.tracks.items():
                if len(track.start) != self.d or len(track.velocity) != self.d:
                    raise self.error(
                        f"tracks.{name}", f"start and velocity must have {self.d} numbers"
                    )
                count = int(np.floor(track.duration / track.step * (1 + 1e-12))) + 1
                t = np.asarray(track.step * np.arange(count), dtype=float)
                path = np.array(track.start) + t[:, None] * np.array(track.velocity)
                tracks[name] = (t, np.asarray(path, dtype=float))
            return tracks
        columns = self.targets.columns
        numbers = {"time": columns.time, "east": columns.east, "north": columns.north}
        if self.d == 3:
            if columns.up is None:
                raise self.error("targets.columns", "up is missing: the sensors are in space")
            numbers["up"] = columns.up
        values, words = read_columns(self.beside(self.targets.file), numbers, {"id": columns.id})
        there = list(dict.fromkeys(words["id"].tolist()))
        for name in self.targets.names or []:
            if name not in there:
                raise self.error("targets.names", f"no track is named {name!r}: {', '.join(there)}")
        recorded: dict[str, tuple[Array, Array]] = {}
        for name in self.targets.names or there:
            chosen = words["id"] == name
            order = np.argsort(values["time"][chosen], kind="stable")
            axes = ("east", "north", "up")[: self.d]
            places = np.stack([values[axis][chosen][order] for axis in axes], axis=1)
            recorded[str(name)] = (values["time"][chosen][order], places)
        return recorded

    @cached_property
    def measured(self) -> dict[str, Reports]:
        """Reports of each target: recorded, or simulated with the biases put in."""
        return self._matched[0]

    @cached_property
    def _matched(self) -> tuple[dict[str, Reports], int]:
        """The same, and how many reports were left out: of looks that not all sensors have."""
        if self.reports is None:
            simulated = {
                name: _reports.simulate(
                    places, self.places, self.sigma, self.truth, seed=self.seed + i,
                    extras=self.extras, times=times,
                )
                for i, (name, (times, places)) in enumerate(self.seen.items())
            }  # fmt: skip
            return simulated, 0
        columns = self.reports.columns
        numbers = {
            "time": columns.time, "range": columns.range, "azimuth": columns.azimuth_deg,
        }  # fmt: skip
        if self.d == 3:
            if columns.elevation_deg is None:
                raise self.error("reports.columns", "elevation_deg is missing")
            numbers["elevation"] = columns.elevation_deg
        texts = {"target": columns.target, "sensor": columns.sensor}
        path = self.beside(self.reports.file)
        values, words = read_columns(path, numbers, texts)
        found, left_out = {}, 0
        for name in dict.fromkeys(words["target"].tolist()):
            recordings = {}
            for sensor in self.sensors:
                chosen = (words["target"] == name) & (words["sensor"] == sensor)
                if not chosen.any():
                    raise self.error(
                        "reports", f"sensor {sensor!r} has no report of {name!r} in {path}"
                    )
                order = np.argsort(values["time"][chosen], kind="stable")
                one = [values["range"][chosen][order]]
                one += [
                    np.radians(values[angle][chosen][order])
                    for angle in ("azimuth", "elevation")[: self.d - 1]
                ]
                recordings[sensor] = (values["time"][chosen][order], np.stack(one, axis=1))
            found[name] = _reports.match(
                recordings,
                interpolate=self.reports.interpolate,
                missing=self.reports.missing,
                tolerance=self.reports.tolerance,
                max_gap=self.reports.max_gap,
            )
            if self.reports.interpolate == "none":
                given = sum(len(times) for times, _ in recordings.values())
                left_out += given - len(self.sensors) * len(found[name].values)
        return found, left_out

    @cached_property
    def all_positions(self) -> Array:
        """Positions of all looks of all targets."""
        return np.concatenate([places for _, places in self.seen.values()])

    @cached_property
    def all_times(self) -> Array:
        """Their times."""
        return np.concatenate([times for times, _ in self.seen.values()])

    @property
    def problem(self) -> Problem:
        """The rows of all looks of all targets, with the prior."""
        return self.problem_at(self.all_positions, self.all_times)

    def problem_at(self, positions: Array, times: Array) -> Problem:
        """Return the problem of looks at these positions and times."""
        scale = {
            key.removesuffix("_deg"): float(np.radians(value)) if key.endswith("_deg") else value
            for key, value in self.useless.items()
        }
        problem = _model.problem(
            positions,
            self.places,
            self.sigma,
            extras=self.extras,
            biases=self.truth or None,
            times=times,
            scale=scale or None,
        )
        return problem.prior(self.prior) if self.prior else problem

    def analyze(self) -> Report:
        """Answer which biases these targets can tell, how well, and which targets do."""
        answer = analyze(self.problem)
        each = [self._line(name, places, times) for name, (times, places) in self.seen.items()]
        budget = min(self.select, len(self.seen))
        chosen = _select.select(
            {name: places for name, (_, places) in self.seen.items()},
            self.places, self.sigma, budget, extras=self.extras, prior=self.prior,
            times={name: times for name, (times, _) in self.seen.items()},
        )  # fmt: skip
        tables = [
            _bounds_table(answer),
            Table(
                "What each target tells alone",
                ["target", "looks", "eta", *map(_label, answer.names)]
                + ["singular track"] * self._is_pair,
                [[name, *cells] for name, *cells in each],
                "eta in [0, 1] is the degree of observability"
                + "; 'singular track' is the nearest one and how far off it the target comes "
                "at most" * self._is_pair + ".",
            ),
            Table(
                "The most informative target"
                if budget == 1
                else f"The {budget} most informative targets",
                ["added", *map(_label, answer.names)],
                [
                    [name, *(_cell(b, u) for b, u in zip(bounds, answer.units, strict=True))]
                    for name, bounds in zip(chosen.chosen, chosen.bounds, strict=True)
                ]
                + [["all", *map(_cell, chosen.all_bounds, answer.units)]],
                "The bound of each bias after each addition.",
            ),
            *answer_tables(answer)[1:],
        ]
        tone, headline = tone_of(answer), answer.status.upper()
        if answer.nullity:
            verdict = f"no look tells {'; '.join(answer.null_combinations)}"
            if answer.nullity > 2:
                verdict = f"no look tells {answer.nullity} combinations of the biases"
        else:
            worst = int(np.argmax(answer.crlb_std / np.tile(self._units(), len(self.sensors))))
            verdict = (
                f"all {len(answer.names)} biases are determined; the weakest, "
                f"{answer.names[worst]}, to {_cell(answer.crlb_std[worst], answer.units[worst])}"
            )
        return Report(
            title="Registration of " + ", ".join(self.sensors),
            subtitle=f"{count(len(self.seen), 'target')}, {count(len(self.all_positions), 'look')}",
            tone=tone,
            headline="WEAKLY OBSERVABLE" if answer.status == "weak" else headline,
            verdict=verdict,
            facts=self._facts(answer, chosen),
            tables=tables,
            pictures=[*self._pictures(chosen), *answer_pictures(answer)],
            data={
                "model": self.model,
                "observability": answer.to_dict(),
                "targets": {name: {"looks": int(n), "eta": eta} for name, n, eta, *_ in each},
                "selection": chosen.to_dict(),
            },
        )

    def _units(self) -> Array:
        """Return what to compare unlike biases by: the sigma of what they are a bias of."""
        own = self.sigma[0]
        per = len(self.names) // len(self.sensors)
        return np.concatenate([own, np.ones(per - self.d)])

    @property
    def _is_pair(self) -> bool:
        """Whether these are two sensors that stand in the plane, which have singular tracks."""
        return self.d == 2 and len(self.sensors) == 2 and not self.moving

    def _line(self, name: str, places: Array, times: Array) -> list[str]:
        problem = self.problem_at(places, times)
        std, units = crlb_std(problem), problem.units
        eta = float(_degree.eta(places, self.places, self.sigma, times=times))
        cells = [name, str(len(places)), f"{eta:.3f}", *map(_cell, std, units)]
        if self._is_pair:
            check = _tracks.check_track(places, self.places)
            cells.append(f"{check.track.where}, {check.distance:.0f} m")
        return cells

    def _facts(self, answer: Observability, chosen: Selection) -> list[tuple[str, str]]:
        facts = [("cannot be determined", text) for text in answer.null_combinations]
        if answer.nullity and self._is_pair and not self.extras:
            check = _tracks.check_track(self.all_positions, self.places)
            facts.append(("why", f"every target keeps {check.track.where}"))
        for name, sensor in self.sensors.items():
            if sensor.azimuths == "heading" and "attitude" not in self.extras:
                text = f"the sum of the errors of its azimuths and of {name}'s heading"
                facts.append((f"{name}.azimuth is", text))
        gauges = _model.gauges(self.places, self.extras, times=self.all_times)
        for name, vector in gauges.items():
            text = describe_direction(vector, answer.names)
            if not answer.problem.priors:
                facts.append(("free whatever the targets", f"{name}: {text}"))
        facts.append(("best targets", ", ".join(chosen.chosen)))
        if answer.nullity and answer.suggestions:
            best = answer.suggestions[0]
            gives = ", ".join(
                f"{name} to {_cell(std, unit)}"
                for name, std, unit in zip(answer.names, best.crlb_std, answer.units, strict=True)
                if std > 0
            )
            facts.append(("what would help most", f"knowing {best.name} gives {gives}"))
        return facts

    def _pictures(self, chosen: Selection) -> list[Picture]:
        pictures = [
            Picture(
                "Geometry",
                "Sensors and the paths of those that move; targets, the chosen ones in colour."
                if self.moving
                else "Sensors and targets; the chosen ones in colour. On the red lines two "
                "sensors' biases cannot be determined, if a target keeps to them.",
                lambda: _plot().geometry(
                    self.paths, {k: p for k, (_, p) in self.seen.items()}, chosen=chosen.chosen
                ),
            ),
            Picture(
                "Degree against time",
                "The degree eta of each chosen target's looks so far: how fast it tells.",
                lambda: _plot().degrees(
                    {
                        name: (
                            self.seen[name][0] - self.seen[name][0][0],
                            _degree.degree(
                                self.seen[name][1],
                                self.places,
                                self.sigma,
                                times=self.seen[name][0],
                            ),
                        )
                        for name in chosen.chosen
                    },
                    ylabel="eta",
                ),
            ),
        ]
        if self.d != 2 or self.moving:
            return pictures
        maps = self.maps or [self._default_map(None), self._default_map(90.0)]
        for m in maps:
            what = "eta" if m.quantity == "eta" else f"the bound of {m.quantity}"
            course = "" if m.heading_deg is None else f", heading {m.heading_deg:g} deg"
            pictures.append(
                Picture(
                    f"Where targets tell the biases: {what}{course}",
                    "Each place stands for 8 looks around it. Red: nothing is determined.",
                    partial(self._draw, m),
                )
            )
        return pictures

    def _default_map(self, heading: float | None) -> Map:
        places = np.array([p[:2] for p in self.paths.values()])
        middle, half = places.mean(axis=0), 1.5 * max(np.ptp(places, axis=0).max(), 1e3)
        return Map(
            west=middle[0] - half, east=middle[0] + half,
            south=middle[1] - half, north=middle[1] + half, heading_deg=heading,
        )  # fmt: skip

    def _draw(self, m: Map) -> Figure:
        return self._field(m).plot()

    def _field(self, m: Map) -> _field.Field:
        heading = None if m.heading_deg is None else float(np.radians(m.heading_deg))
        if m.quantity != "eta" and m.quantity not in self.names:
            raise self.error("maps.quantity", f"must be eta or one of {', '.join(self.names)}")
        return _field.field(
            self.places, self.sigma, (m.west, m.east, m.south, m.north), heading, m.radius,
            quantity=m.quantity,
        )  # fmt: skip

    def localize(self) -> Report:
        """Estimate the biases from the reports of all targets, and of the best few."""
        budget = min(self.select, len(self.measured))
        positions = {
            name: r.positions(self.places, self.sigma, extras=self.extras)
            for name, r in self.measured.items()
        }
        chosen = _select.select(
            positions,
            self.places,
            self.sigma,
            budget,
            extras=self.extras,
            prior=self.prior,
            times={name: _times(r) for name, r in self.measured.items()},
        )
        groups = {"all targets": tuple(self.measured), f"best {budget}": chosen.chosen}
        outcomes = {label: self._estimate(names) for label, names in groups.items()}
        first = outcomes["all targets"]
        tables, shown = [], {}
        for label, outcome in outcomes.items():
            if isinstance(outcome, Estimate):
                tables.append(self._estimate_table(label, groups[label], outcome))
                if self.truth:
                    errors = np.array([outcome[name] for name in self.names])
                    errors -= self._truth_array()
                    shown[label] = (errors, outcome.std[: len(errors)])
        data: dict[str, Any] = {
            "model": self.model,
            "selection": chosen.to_dict(),
            "estimates": {
                label: outcome.to_dict() if isinstance(outcome, Estimate) else str(outcome)
                for label, outcome in outcomes.items()
            },
        }
        tone: Tone
        if isinstance(first, Estimate):
            fits = first.status != "misfit"
            held = first.held_by_prior
            tone = "bad" if not fits else "weak" if held else "good"
            headline = "ESTIMATED" if not held else "ESTIMATED, IN PART FROM THE PRIOR"
            if not fits:
                headline = "THE REPORTS DO NOT FIT"
            verdict = ("" if fits else f"{first.reason}; ") + "; ".join(
                f"{name} {_cell(value, unit)} +- {_cell(std, unit)}"
                for name, value, std, unit in zip(
                    first.names, first.biases, first.std, first.units, strict=True
                )
            )
            facts = [
                (
                    "do the reports agree with the model?",
                    f"{'yes' if fits else 'NO'} (chi-square {brief(first.fit.chi2, 4)} of "
                    f"{first.fit.dof}, p = {brief(first.fit.p_value, 2)})",
                ),
                *(("held by the prior alone", text) for text in held),
                *(
                    [("left out", f"{count(self._matched[1], 'report')} of looks of one sensor")]
                    if self._matched[1]
                    else []
                ),
                ("best targets", ", ".join(chosen.chosen)),
            ]
        else:
            tone, headline, verdict = "bad", "UNOBSERVABLE", str(first)
            unseen = getattr(first, "null_combinations", ())
            if len(unseen) > 2:
                verdict = f"these reports leave {len(unseen)} combinations open: give priors"
            if isinstance(first, ConvergenceError):
                headline = "NO ANSWER"
            facts = [("cannot be determined", text) for text in unseen]
        pictures = self._pictures(chosen)[:2]
        if shown:
            pictures.insert(
                0,
                Picture(
                    "Errors over their bounds",
                    "Of the biases put into the reports: about two of three bars stay below 1.",
                    lambda: _plot().bars(shown, self.names),
                ),
            )
        looks = sum(len(r.values) for r in self.measured.values())
        return Report(
            title="Registration of " + ", ".join(self.sensors),
            subtitle=(
                f"{count(len(self.measured), 'target')}, {count(looks, 'look')}, "
                f"{self.estimate.method.upper()}"
            ),
            tone=tone,
            headline=headline,
            verdict=verdict,
            facts=facts,
            tables=tables,
            pictures=pictures,
            data=data,
        )

    def _truth_array(self) -> Array:
        return np.array([self.truth.get(name, 0.0) for name in self.names])

    def _estimate(self, names: tuple[str, ...]) -> Estimate | UnobservableError | ConvergenceError:
        measured = [self.measured[name] for name in names]
        # One target after another: their times start anew. Those of platforms count from one
        # zero, so that the last to begin comes first.
        if self.moving:
            measured.sort(key=lambda one: -_times(one)[0])
        values = np.concatenate([one.values for one in measured])
        times = [
            one.times - (0.0 if self.moving else one.times[0])
            for one in measured
            if one.times is not None
        ]
        together = np.concatenate(times) if len(times) == len(measured) else None
        try:
            found = _estimate.estimate(
                Reports(values, together),
                self.places,
                self.sigma,
                method=self.estimate.method,
                prior=self.prior,
                extras=self.extras,
                loss=self.estimate.loss,
                clocks=self.estimate.clocks,
            )
        except (UnobservableError, ConvergenceError) as error:
            return error
        assert isinstance(found, Estimate)
        return found

    def _estimate_table(self, label: str, names: tuple[str, ...], found: Estimate) -> Table:
        columns = ["bias", "estimate", "standard deviation"]
        rows = []
        for i, (name, unit) in enumerate(zip(found.names, found.units, strict=True)):
            row = [name, _cell(found.biases[i], unit), _cell(found.std[i], unit)]
            if self.truth:
                true = self.truth.get(name, 0.0)
                row += [_cell(true, unit), _cell(found.biases[i] - true, unit)]
            rows.append(row)
        if self.truth:
            columns += ["put in", "error"]
        which = "" if len(names) > 6 else f" ({', '.join(names)})"
        return Table(f"From {label}{which}", columns, rows)

    def experiment(self) -> Simulation:
        """Return the looks of all targets as a Monte Carlo experiment."""
        from gramian.monte_carlo import Registration

        return Simulation(
            Registration(
                self.all_positions,
                self.places,
                self.sigma,
                self.truth or None,
                self.extras,
                self.all_times,
            ),
            title="Registration of " + ", ".join(self.sensors),
            subtitle=f"{count(len(self.seen), 'target')}, {count(len(self.all_positions), 'look')}",
        )

    def simulate(
        self, trials: int, seed: int, *, resume: Path | None = None, progress: bool = True
    ) -> Report:
        """Check the estimator against its bound over simulated trials of all targets.

        With a prior, or by another method than "ml", the trials are run in one go:
        there is nothing to resume.
        """
        if self.prior is None and self.estimate.method == "ml":
            return super().simulate(trials, seed, resume=resume, progress=progress)
        if resume is not None:
            raise self.error("resume", "all trials run in one call: nothing is kept to go on from")
        bound = crlb_std(self.problem)
        found = _estimate.estimate_trials(
            self.all_positions, self.places, self.sigma, self.truth or None, seed=seed,
            trials=trials, method=self.estimate.method, prior=self.prior, extras=self.extras,
            times=self.all_times,
        )  # fmt: skip
        good = found.status == "determined"
        errors = found.biases[good] - self._truth_array()
        rmse = np.sqrt((errors**2).mean(axis=0)) if good.any() else np.full(len(bound), np.inf)
        ratio = rmse / bound
        # Three deviations of an RMSE from so many trials.
        limit = 1 + 3 / np.sqrt(2 * max(int(good.sum()), 1)) + 0.02
        fine = bool(good.all() and np.isfinite(ratio).all() and ratio.max() < limit)
        rows = [
            [n, _cell(r, u), _cell(b, u), number(q), _cell(float(m), u)]
            for n, u, r, b, q, m in zip(
                found.names, found.units, rmse, bound, ratio,
                errors.mean(axis=0) if good.any() else np.zeros(len(bound)), strict=True,
            )
        ]  # fmt: skip
        return Report(
            title="Registration of " + ", ".join(self.sensors),
            subtitle=f"{trials} trials, seed {seed}, {self.estimate.method.upper()}",
            tone="good" if fine else "weak" if good.any() else "bad",
            headline="REACHES THE BOUND" if fine else "SHORT OF THE BOUND",
            verdict=f"{int(good.sum())} of {trials} trials gave an answer",
            tables=[
                Table(
                    "Errors and bounds",
                    ["bias", "RMSE", "bound", "RMSE / bound", "mean error"],
                    rows,
                )
            ],
            data={
                "model": self.model,
                "trials": trials,
                "answered": int(good.sum()),
                "rmse": plain(rmse),
                "bound": plain(bound),
            },
        )


def _times(reports: Reports) -> Array:
    return np.arange(len(reports.values), dtype=float) if reports.times is None else reports.times


def _label(name: str) -> str:
    return name


def _cell(value: float, unit: str) -> str:
    if np.isinf(value):
        return "not observable"
    if unit == "rad":
        return f"{brief(np.degrees(value), 4)} deg"
    return f"{brief(value, 4)} {unit}".rstrip()


def _bounds_table(answer: Observability) -> Table:
    return Table(
        "How accurately, at best, from all targets",
        ["bias", "standard deviation"],
        [
            [name, _cell(std, unit)]
            for name, std, unit in zip(answer.names, answer.crlb_std, answer.units, strict=True)
        ],
    )


def _plot() -> Any:
    from gramian.models.registration import plot as pictures

    return pictures
