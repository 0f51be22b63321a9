"""Scenarios of a strapdown navigator beside a satellite receiver: `model = "inertial"`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from gramian._text import brief
from gramian.exceptions import InputError
from gramian.models import linear
from gramian.models.inertial import _earth, _flight, _model
from gramian.models.linear._degrees import posterior
from gramian.models.linear.scenario import Observed, Window, linear_report, linear_verdict
from gramian.report import Report, Table
from gramian.scenario.base import Scenario, Section

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
    """A navigator at rest, or on a flight put together from legs."""

    model: Literal["inertial"]
    site: Site
    flight: Flown | None = None
    window: Window | None = None
    prior: Known = Known()
    noise: Noise = Noise()
    lever_arm: tuple[float, float, float] = (0.0, 0.0, 0.0)

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
                velocity_error=self.prior.velocity,
                position_error=self.prior.position,
                lever_arm=self.lever_arm,
                **priors,
            )
        except InputError as error:
            raise self.error("flight", str(error)) from error
        return self._in_flight(flight, place)

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
        samples = sum(leg.duration for leg in flight.legs) / self._step
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
        # The rows up to each leg, to say what each adds.
        rows, data = [], []
        root = np.diag(system.prior)
        leaders = [int(np.flatnonzero(column)[0]) for column in found.null_space.T]
        for leg in range(int(flight.leg.max()) + 1):
            upto = flight.upto(leg)
            ranks = upto.piecewise()
            end = float(upto.durations.sum())
            samples = int(end / step * (1 + 1e-12)) + 1
            information = posterior(
                seen[: samples * len(system.C)] @ root, root, system.names, system.units, end
            )
            ratios = [information.ratio[i] for i in leaders]
            data.append({"leg": leg, "rank": ranks.rank, "unseen": list(ranks.null_combinations)})
            rows.append(
                [
                    f"{leg + 1}, to {information.window:g} s",
                    str(ranks.rank),
                    *(f"{brief(ratio)}" for ratio in ratios),
                ]
            )
        names = [system.names[i] for i in leaders]
        table = Table(
            "Leg by leg: what was never seen on the first",
            ["leg", "rank", *(f"{name}, posterior / prior" for name in names)],
            rows,
            "Each state leads one of the combinations that the first leg alone leaves unseen; "
            "the columns say how well it is known after the leg.",
        )
        whole, total = ranks, end
        observed = Observed.of(
            seen,
            system.prior,
            system.names,
            system.units,
            len(system.C),
            step,
            "s",
        )
        values: dict[str, Any] = {"legs": data, "piecewise": whole.to_dict()}
        unseen = len(system.names) - whole.rank
        report = linear_report(
            self.path.stem,
            f"{len(rows)} legs, {total:g} s, {place}",
            found,
            observed,
            where="first leg",
            facts=[("rank after all legs", f"{whole.rank} of {len(system.names)}")],
            tables=[table],
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
            tables=[table, *(t for t in report.tables if t is not table)],
        )
