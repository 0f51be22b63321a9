"""Scenarios of a strapdown navigator beside what aids it: `model = "inertial"`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from gramian._text import brief
from gramian.exceptions import InputError
from gramian.models import linear
from gramian.models.inertial import _earth, _flight, _maneuvers, _model
from gramian.models.linear.scenario import Observed, Window, linear_report, linear_verdict
from gramian.report import Picture, Report, Table
from gramian.scenario.base import Scenario, Section
from gramian.scenario.files import read_columns

if TYPE_CHECKING:
    from gramian.models.inertial._flight import Flight

__all__ = ["InertialScenario"]

Array = NDArray[np.float64]

#: What the states of the error model are, in a line for a page.
SYMBOLS = (
    "errors of phi: attitude (rad), dV: velocity (m/s), dL and dlambda: latitude and longitude "
    "(rad), dh: height (m); biases of eps: gyroscopes (rad/s), Delta: accelerometers (m/s^2); "
    "_N north, _W west, _U up"
)


class Site(Section):
    """Where it begins: degrees, metres above the ellipsoid."""

    latitude_deg: float = Field(gt=-90, lt=90)
    height: float = 0.0


class Leg(Section):
    """A part of the flight: seconds, degrees clockwise, m/s, degrees right side down."""

    duration: float = Field(gt=0)
    turn_deg: float = Field(default=0.0, ge=-3600, le=3600)
    speed_change: float = 0.0
    bank_deg: float = Field(default=0.0, gt=-90, lt=90)


class Flown(Section):
    """How it moves; without this section it stands still, level, heading north."""

    speed: float = 0.0
    heading_deg: float = 0.0
    legs: list[Leg] = Field(min_length=1)


class Columns(Section):
    """What the columns of a recorded flight are called."""

    time: str = "time"
    v_north: str = "v_north"
    v_east: str = "v_east"
    v_up: str = "v_up"
    heading_deg: str = "heading_deg"
    pitch_deg: str = "pitch_deg"
    roll_deg: str = "roll_deg"


class Recorded(Section):
    """A flight of one's own: a table of attitude and velocity."""

    file: str
    columns: Columns = Columns()
    legs: list[float] = Field(default_factory=list)
    names: list[str] = Field(default_factory=list)
    step: float = Field(default=5.0, gt=0)
    largest_turn_deg: float = Field(default=3.0, gt=0)

    @model_validator(mode="after")
    def _named(self) -> Recorded:
        if self.names and len(self.names) != len(self.legs) + 1:
            raise ValueError(
                f"names has {len(self.names)} entries: must have {len(self.legs) + 1}, one more "
                "than legs has times"
            )
        return self


class Known(Section):
    """What is known beforehand, standard deviations."""

    tilt_arcmin: float = Field(default=1.0, gt=0)
    velocity: float = Field(default=0.1, gt=0)
    position: float = Field(default=10.0, gt=0)
    gyro_bias_deg_per_hour: float = Field(default=0.01, gt=0)
    accelerometer_bias_micro_g: float = Field(default=100.0, gt=0)


class Noise(Section):
    """Standard deviations of the receiver: m/s, m."""

    velocity: float = Field(default=0.01, gt=0)
    position: float = Field(default=1.0, gt=0)


class InertialScenario(Scenario):
    """A navigator at rest, on a flight put together from legs, or on a recorded one."""

    model: Literal["inertial"]
    site: Site
    flight: Flown | None = None
    recorded: Recorded | None = None
    window: Window | None = None
    prior: Known = Known()
    noise: Noise = Noise()
    lever_arm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    odometer_arm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    estimated: list[str] = Field(default_factory=list)
    outputs: list[str] = Field(default=["velocity", "position"])

    @model_validator(mode="after")
    def _one_motion(self) -> InertialScenario:
        if self.flight is not None and self.recorded is not None:
            raise ValueError("has [flight] and [recorded]: give one")
        standing = self.flight is None and self.recorded is None
        if standing and (self.estimated or self.outputs != ["velocity", "position"]):
            raise ValueError("estimated and outputs belong to a [flight] or [recorded]: give one")
        return self

    def analyze(self) -> Report:
        """Answer which combinations of the errors the receiver determines, and when."""
        latitude = np.radians(self.site.latitude_deg)
        gravity = _earth.gravity(latitude, self.site.height)
        priors = {
            "tilt": np.radians(self.prior.tilt_arcmin / 60),
            "gyro_bias": np.radians(self.prior.gyro_bias_deg_per_hour) / 3600,
            "accelerometer_bias": self.prior.accelerometer_bias_micro_g * 1e-6 * gravity,
            "velocity_noise": self.noise.velocity,
            "position_noise": self.noise.position,
        }
        place = f"latitude {self.site.latitude_deg:g} deg"
        model: dict[str, Any] = {
            "velocity_error": self.prior.velocity,
            "position_error": self.prior.position,
            "lever_arm": self.lever_arm,
            "odometer_arm": self.odometer_arm,
            "estimated": self.estimated,
            "outputs": self.outputs,
            **priors,
        }
        if self.recorded is not None:
            return self._in_flight(self._read(self.recorded, latitude, model), place)
        if self.flight is None:
            return self._at_rest(latitude, place, priors)
        self._check_size(self.flight)
        try:
            legs = [
                _flight.Leg(
                    leg.duration,
                    np.radians(leg.turn_deg),
                    leg.speed_change,
                    np.radians(leg.bank_deg),
                )
                for leg in self.flight.legs
            ]
            flight = _flight.segments(
                legs,
                latitude,
                self.site.height,
                speed=self.flight.speed,
                heading=np.radians(self.flight.heading_deg),
                **model,
            )
        except InputError as error:
            raise self.error("flight", str(error)) from error
        return self._in_flight(flight, place)

    def _read(self, recorded: Recorded, latitude: float, model: dict[str, Any]) -> Flight:
        """Return the flight of a file."""
        names = recorded.columns
        columns, _ = read_columns(
            self.beside(recorded.file), {key: getattr(names, key) for key in Columns.model_fields}
        )
        velocity = np.stack([columns["v_north"], -columns["v_east"], columns["v_up"]], axis=1)
        angles = [columns["heading_deg"], columns["pitch_deg"], columns["roll_deg"]]
        try:
            flight = _flight.recorded(
                columns["time"],
                velocity,
                np.radians(np.stack(angles, axis=1)),
                latitude,
                self.site.height,
                legs=recorded.legs or None,
                step=recorded.step,
                largest_turn=np.radians(recorded.largest_turn_deg),
                **model,
            )
        except InputError as error:
            raise self.error("recorded", str(error)) from error
        self._check_samples(float(flight.durations.sum()))
        return flight

    def _check_size(self, flight: Flown) -> None:
        """Refuse a flight that would take minutes."""
        pieces = sum(
            max(leg.duration / 5, abs(leg.turn_deg) / 3)
            for leg in flight.legs
            if leg.turn_deg or leg.speed_change
        )
        if pieces > 2000:
            raise self.error(
                "flight.legs",
                f"turning and changing speed make {pieces:.0f} pieces of 5 s or 3 deg, more than "
                "2000: shorten these legs",
            )
        self._check_samples(sum(leg.duration for leg in flight.legs))

    def _check_samples(self, duration: float) -> None:
        samples = duration / self._step
        if samples > 2e4:
            raise self.error(
                "window.step",
                f"the flight has {brief(samples)} samples of {self._step:g} s, more than 20 000: "
                "a longer step or shorter legs",
            )

    @property
    def _step(self) -> float:
        """Time between samples in flight, s."""
        return self.window.step if self.window else 1.0

    @staticmethod
    def _explained(report: Report) -> Report:
        """Return the report with a line that says what the symbols are."""
        return replace(report, facts=[*report.facts, ("symbols", SYMBOLS)])

    def _at_rest(self, latitude: float, place: str, priors: dict[str, float]) -> Report:
        system = _model.static_base(
            latitude,
            self.site.height,
            velocity=self.prior.velocity,
            position=self.prior.position,
            **priors,
        )
        observed = None
        if self.window is not None:
            seen = linear.rows(system, window=self.window.duration, dt=self.window.step)
            observed = Observed.of(
                seen,
                system.prior,
                system.names,
                system.units,
                len(system.C),
                self.window.step,
                "s",
            )
        report = linear_report(self.path.stem, f"at rest, {place}", linear.levels(system), observed)
        return self._explained(report)

    def _in_flight(self, flight: Flight, place: str) -> Report:
        found = linear.levels(flight.A[0], flight.C[0], flight.system.names)
        step = self._step
        system = flight.system
        seen = flight.rows(dt=step)
        legs = self.recorded.names if self.recorded is not None else []
        parts = _maneuvers.maneuvers(flight, legs=legs or None, dt=step)
        whole = flight.piecewise()
        leaders = [int(np.flatnonzero(column)[0]) for column in found.null_space.T]
        count, total = len(parts.legs), float(flight.durations.sum())
        rows = [
            [
                f"{leg if legs else k + 1}, to {brief(parts.ends[k])} s",
                str(parts.rank_alone[k]),
                str(parts.rank[k]),
                *(brief(parts.ratio[k, i]) for i in leaders),
            ]
            for k, leg in enumerate(parts.legs)
        ]
        names = [system.names[i] for i in leaders]
        table = Table(
            "Leg by leg: what was never seen on the first",
            ["leg", "rank alone", "rank so far", *(f"{name}, posterior / prior" for name in names)],
            rows,
            "Each state leads one of the combinations that the first leg alone leaves unseen; "
            "the columns say how well it is known after the leg.",
        )
        each = Table(
            "Which leg makes which state observable",
            [
                "state",
                *(f"{leg}: alone" for leg in parts.legs),
                *(f"to {leg}" for leg in parts.legs),
            ],
            [
                [
                    name,
                    *(
                        brief(ratio) if known else "-"
                        for ratios, flags in (
                            (parts.ratio_alone, parts.known_alone),
                            (parts.ratio, parts.known),
                        )
                        for ratio, known in zip(ratios[:, i], flags[:, i], strict=True)
                    ),
                ]
                for i, name in enumerate(parts.names)
            ],
            "Posterior over prior deviation by the leg alone, and by the flight up to its end; "
            "- where its rank leaves the state open.",
        )
        observed = Observed.of(
            seen,
            system.prior,
            system.names,
            system.units,
            len(system.C),
            step,
            "s",
        )
        values: dict[str, Any] = {"maneuvers": parts.to_dict(), "piecewise": whole.to_dict()}
        unseen = len(system.names) - whole.rank
        report = linear_report(
            self.path.stem,
            f"{count} legs, {total:g} s, {place}",
            found,
            observed,
            where="first leg",
            facts=[("rank after all legs", f"{whole.rank} of {len(system.names)}")],
            tables=[table, each],
            data=values,
        )
        # The whole flight gives the verdict, the first leg the levels.
        verdict = (
            f"the first leg alone has rank {found.rank}, all legs {whole.rank} "
            f"of {len(system.names)}"
        )
        tone, headline, weakness = linear_verdict(unseen, observed)
        report = self._explained(report)
        return replace(
            report,
            tone=tone,
            headline=headline,
            verdict=verdict + weakness,
            tables=[
                table,
                each,
                *(shown for shown in report.tables if shown is not table and shown is not each),
            ],
            pictures=[
                Picture(
                    "Which leg makes which state observable",
                    "Posterior over prior deviation of each state after each leg; crosses where "
                    "the flight up to there leaves it open.",
                    parts.plot,
                ),
                *report.pictures,
            ],
        )
