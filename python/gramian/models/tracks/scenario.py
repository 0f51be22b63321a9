"""Scenarios of tracks: `model = "tracks"`."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from gramian import io
from gramian._text import brief, number
from gramian.analysis import Observability, analyze
from gramian.exceptions import InputError
from gramian.models.tracks._estimate import Estimate, estimate
from gramian.models.tracks._motion import Carrier, Motion
from gramian.models.tracks._scene import Scene, problem
from gramian.models.tracks._sensors import Sensor
from gramian.problem import Problem
from gramian.report import Picture, Report, Table, Tone, answer_pictures, answer_tables, tone_of
from gramian.scenario.base import Scenario, Section, Simulation

__all__ = ["TracksScenario"]

Array = NDArray[np.float64]

Kind = Literal[
    "bearing",
    "elevation",
    "range",
    "range_rate",
    "frequency",
    "time_difference",
    "frequency_difference",
    "cone_angle",
    "signal_strength",
    "position",
    "speed",
    "course",
]


_ANGLES = ("bearing", "elevation", "cone_angle", "course")


class Moves(Section):
    """How the target moves."""

    kind: Literal[
        "fixed", "constant_velocity", "constant_acceleration", "legs", "coordinated_turn"
    ] = "constant_velocity"
    dimension: Literal[2, 3] = 2
    turns: list[float] | None = None
    count: int | Literal["auto"] | None = None
    constant_speed: bool = False

    @model_validator(mode="after")
    def _legs(self) -> Moves:
        given = (self.turns is not None) + (self.count is not None)
        if (self.kind == "legs") != bool(given) or given > 1:
            raise ValueError("legs take turns, times in seconds, or a count; other kinds neither")
        return self

    @property
    def motion(self) -> Motion:
        """The motion; with two legs where their number is to be found."""
        if self.kind == "legs":
            count = 2 if self.count == "auto" else self.count
            return Motion.legs(
                self.turns,
                count=count,
                constant_speed=self.constant_speed,
                dimension=self.dimension,
            )
        made: Motion = getattr(Motion, self.kind)(dimension=self.dimension)
        return made


class Borne(Section):
    """A carrier: a place, or a path with times. Metres, seconds, degrees."""

    name: str
    path: list[list[float]] | None = None
    times: list[float] | None = None
    place: list[float] | None = None
    heading_deg: float | None = None

    @model_validator(mode="after")
    def _once(self) -> Borne:
        if (self.place is None) == (self.path is None) or (self.path is None) != (
            self.times is None
        ):
            raise ValueError("give place, or path and times")
        return self

    @property
    def carrier(self) -> Carrier:
        """The carrier."""
        if self.place is None:
            return Carrier(self.path or [], self.times, name=self.name)
        heading = None if self.heading_deg is None else float(np.radians(self.heading_deg))
        return Carrier(self.place, heading=heading, name=self.name)


class Steps(Section):
    """Times at equal steps, seconds, the last included."""

    first: float = 0.0
    last: float
    step: float = Field(gt=0)


class Seen(Section):
    """A sensor; see `gramian.tracks.Sensor`. Angles in degrees where a key says so."""

    kind: Kind
    name: str | None = None
    carrier: str | None = None
    second: str | None = None
    times: Steps | list[float]
    sigma: float | None = Field(default=None, gt=0)
    sigma_deg: float | None = Field(default=None, gt=0)
    correlation_time: float | None = Field(default=None, gt=0)
    bias: str | float | None = None
    scale: str | float | None = None
    clock: str | float | None = None
    true_path: bool = False
    delay: float | None = Field(default=None, gt=0)
    detection: float = Field(default=1.0, gt=0, le=1)
    speed: float | None = Field(default=None, gt=0)
    tonal: str | float | None = None
    power: str | float | None = None
    exponent: str | float | None = None
    clocks: list[str] | None = None

    @model_validator(mode="after")
    def _one_sigma(self) -> Seen:
        if (self.sigma is None) == (self.sigma_deg is None):
            raise ValueError("give sigma, or sigma_deg for an angle")
        if self.kind in _ANGLES and self.sigma is not None and self.sigma > 0.35:
            raise ValueError(
                f"sigma = {self.sigma:g} rad of a {self.kind} is {np.degrees(self.sigma):.0f} deg: "
                "are these degrees? Say it in degrees (sigma_deg)"
            )
        return self

    def sensor(self, carriers: dict[str, Carrier]) -> Sensor:
        """Return the sensor."""
        if isinstance(self.times, Steps):
            count = int((self.times.last - self.times.first) / self.times.step * (1 + 1e-12)) + 1
            times = self.times.first + self.times.step * np.arange(count)
        else:
            times = np.array(self.times)
        options: dict[str, Any] = {
            "sigma": np.radians(self.sigma_deg or 0.0) if self.sigma is None else self.sigma,
            "correlation_time": self.correlation_time,
            "bias": self.bias,
            "scale": self.scale,
            "clock": self.clock,
            "true_path": self.true_path,
            "delay": self.delay,
            "detection": self.detection,
            "name": self.name or self.kind,
        }
        for key in ("speed", "tonal", "power", "exponent", "clocks"):
            value = getattr(self, key)
            if value is not None:
                options[key] = tuple(value) if key == "clocks" else value
        method = "target_speed" if self.kind == "speed" else self.kind
        borne = []
        for name in (self.carrier, self.second):
            if name is not None:
                if name not in carriers:
                    raise InputError(
                        f"carrier {name!r}: the carriers are {', '.join(carriers) or 'none'}"
                    )
                borne.append(carriers[name])
        try:
            made: Sensor = getattr(Sensor, method)(*borne, times, **options)
        except TypeError as error:
            raise InputError(f"{self.name or self.kind}: {error}") from None
        return made


class Measured(Section):
    """A CSV file of measurements: columns sensor, and value (and value_2, value_3)."""

    file: str


class TracksScenario(Scenario):
    """One target, sensors on carriers, and what is unknown about them."""

    model: Literal["tracks"]
    motion: Moves = Moves()
    carriers: list[Borne] = Field(default_factory=list)
    sensors: list[Seen] = Field(min_length=1)
    target: dict[str, float] = Field(default_factory=dict)
    prior: dict[str, float | list[float]] = Field(default_factory=dict)
    known: dict[str, float] = Field(default_factory=dict)
    measurements: Measured | None = None
    loss: Literal["squares", "huber", "tukey"] = "squares"

    @cached_property
    def scene(self) -> Scene:
        """The scene."""
        try:
            carriers = {one.name: one.carrier for one in self.carriers}
            sensors = [one.sensor(carriers) for one in self.sensors]
            return Scene(self.motion.motion, sensors)
        except InputError as error:
            raise self.error("sensors", str(error)) from error

    @property
    def state(self) -> dict[str, float]:
        """The state of `target`, zero for what is unknown about the sensors."""
        names = self.scene.names
        own = len(self.scene.motion.names)
        full = dict.fromkeys(names[own:], 0.0) | self.target | self.known
        for name in full:
            if name not in names:
                raise self.error(f"target.{name}", f"the states are {', '.join(names)}")
        missing = [name for name in names if name not in full]
        if missing:
            raise self.error("target", f"has no {', '.join(missing)}")
        return full

    @property
    def priors(self) -> dict[str, tuple[float, float]]:
        """Means and deviations; a number alone is the deviation about the target's state."""
        found = {}
        for name, value in self.prior.items():
            if isinstance(value, list):
                if len(value) != 2:
                    raise self.error(f"prior.{name}", "must be a sigma, or [mean, sigma]")
                found[name] = (value[0], value[1])
            else:
                found[name] = (self.target.get(name, 0.0), value)
        return found

    @property
    def problem(self) -> Problem:
        """The rows at the state of `target`, with the prior and what is known."""
        try:
            asked = problem(self.scene, self.state)
            asked = asked.prior({name: sigma for name, (_, sigma) in self.priors.items()})
            return asked.fix(*self.known) if self.known else asked
        except InputError as error:
            raise self.error("target", str(error)) from error

    def analyze(self) -> Report:
        """Answer what the sensors determine of a target at the state of `target`."""
        answer = analyze(self.problem)
        verdict = (
            f"no measurement changes when the states move together: {answer.null_combinations[0]}"
            if answer.nullity
            else answer.reason
        )
        return Report(
            title=self.path.stem,
            subtitle=self._subtitle(),
            tone=tone_of(answer),
            headline=answer.status.upper(),
            verdict=verdict,
            facts=[("cannot be determined", text) for text in answer.null_combinations],
            tables=answer_tables(answer),
            pictures=[self._map(answer), *answer_pictures(answer)],
            data={"model": self.model, "observability": answer.to_dict()},
        )

    def _map(self, answer: Observability) -> Picture:
        scene, state = self.scene, np.array([self.state[name] for name in self.scene.names])
        shown = (
            "dashed, tracks along a combination of the states that is not determined"
            if answer.nullity
            else "the 95 % ellipses that the bound allows of its first and last place"
        )

        def draw() -> Any:
            from gramian.models.tracks.plot import geometry

            return geometry(scene, state, answer)

        return Picture("Map", f"Carriers, the target, and {shown}.", draw)

    def localize(self) -> Report:
        """Estimate the state from the measurements of a file."""
        if self.measurements is None:
            raise self.error("measurements", "localize needs the file of the measurements")
        z = self._read(self.measurements.file)
        auto = self.motion.count == "auto"
        try:
            found = estimate(
                self.scene,
                z,
                prior=self.priors,
                known=self.known,
                loss=self.loss,
                legs="auto" if auto else None,
            )
        except InputError as error:
            raise self.error("measurements", str(error)) from error
        status = found.status
        tones: dict[str, Tone] = {"determined": "good", "weak": "weak", "ambiguous": "weak"}
        tables = [_states(found), *_doubts(found)]
        pictures = [
            Picture(
                "Map",
                "Carriers, the estimated track, and 95 % ellipses of its first and last place.",
                found.plot,
            )
        ]
        if found.legs is not None:
            pictures.append(
                Picture(
                    "Legs",
                    "Residuals with one leg, and with the number that was chosen.",
                    found.legs.plot,
                )
            )
        return Report(
            title=self.path.stem,
            subtitle=self._subtitle(),
            tone=tones.get(status, "bad"),
            headline=status.upper().replace("_", " "),
            verdict=found.reason,
            facts=_facts(found),
            tables=tables,
            pictures=pictures,
            data={"model": self.model, **found.to_dict()},
        )

    def experiment(self) -> Simulation:
        """Return the experiment of the target at the state of `target`."""
        from gramian.models.tracks.monte_carlo import Tracks

        if self.known:
            raise self.error("known", "simulate estimates every state: give a [prior] instead")
        return Simulation(
            Tracks(self.scene, self.state, self.priors),
            title=self.path.stem,
            subtitle=self._subtitle(),
        )

    def _subtitle(self) -> str:
        scene = self.scene
        kinds = ", ".join(dict.fromkeys(sensor.name for sensor in scene.sensors))
        return f"{scene.m} measurements of {kinds}; {self.motion.kind.replace('_', ' ')}"

    def _read(self, name: str) -> list[Array]:
        path, width = self.beside(name), self.scene.motion.dimension
        try:
            table = io.table(path)
            names = table["sensor"]
            columns = [c for c in ("value", "value_2", "value_3")[:width] if c in table.header]
            values = np.stack([table.numbers(column) for column in columns or ["value"]], axis=1)
        except InputError as error:
            raise self.error("measurements.file", str(error)) from error
        sensors = {sensor.name: sensor.width(width) for sensor in self.scene.sensors}
        for row, sensor in enumerate(names):
            if sensor not in sensors:
                raise self.error(
                    "measurements.file",
                    f"{table.place(row, 'sensor')} = {sensor!r}: must be one of "
                    f"{', '.join(sensors)}",
                )
        who, out = np.array(names), []
        for sensor, wide in sensors.items():
            if values.shape[1] < wide:
                raise self.error("measurements.file", f"{sensor}: needs {wide} values a row")
            own = values[who == sensor, :wide]
            out.append(own if wide > 1 else own[:, 0])
        return out


def _facts(found: Estimate) -> list[tuple[str, str]]:
    """Return how well the scene fits, and what errors of it would go unseen."""
    fit = found.fit
    p = "" if np.isnan(fit.p_value) else f" (p = {brief(fit.p_value, 2)})"
    facts = [("fit", f"chi2 {brief(fit.chi2, 4)} for {fit.dof} degrees of freedom{p}")]
    if found.status == "unobservable":
        facts += [("cannot be determined", text) for text in found.null_combinations]
    if found.status != "misfit":
        facts += [("would go unseen", text) for text in found.unseen_errors]
    return facts


def _states(found: Estimate) -> Table:
    """Return the states with their intervals, where these mean something."""
    trusted = found.status not in ("misfit", "unobservable") and found._loss[0] == "squares"
    rows = []
    for name, unit, value, std in zip(
        found.names, found.units, found.state, found.std, strict=True
    ):
        allowed = str(found.interval(name)).removeprefix(f"{name} ") if trusted else ""
        rows.append(
            [
                name,
                f"{number(value, 6)} {unit}",
                "none" if np.isinf(std) else f"{number(std)} {unit}",
                allowed,
            ]
        )
    rows += [[name, f"{number(value, 6)}", "known", ""] for name, value in found.known.items()]
    return Table("The most likely state", ["state", "value", "1 sigma", "95 % interval"], rows)


def _doubts(found: Estimate) -> list[Table]:
    """Return what would explain a misfit, and other states that fit, as tables."""
    tables = []
    better = [a for a in found.fit.alternatives if a.dof and a.restored > found.alpha]
    if found.status == "misfit" and better:
        rows = [
            [
                alternative.name,
                ", ".join(f"{brief(size)} {alternative.unit}" for size in alternative.size),
                brief(alternative.restored, 2),
                ", ".join(alternative.alike),
            ]
            for alternative in better[:5]
        ]
        header = ["alternative", "size", "p with it", "cannot be told from"]
        tables.append(Table("What would explain the residuals", header, rows))
    if found.others:
        rows = [
            [*(number(value, 5) for value in other.state), number(other.chi2), brief(other.chance)]
            for other in found.others
        ]
        header = [*found.names, "chi-square", "chance that noise prefers it"]
        tables.append(Table("Other solutions", header, rows))
    return tables
