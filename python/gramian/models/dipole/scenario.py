"""Scenarios of a passing magnetic dipole: `model = "dipole"`."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from gramian._text import brief, count, number, plain
from gramian.analysis import Observability, analyze
from gramian.exceptions import InputError, UnobservableError
from gramian.models.dipole import _localize, _model, _trials
from gramian.models.dipole._result import Localization
from gramian.report import Picture, Report, Table, Tone, answer_pictures, answer_tables, tone_of
from gramian.scenario.base import Scenario, Section, Simulation
from gramian.scenario.files import read_columns

if TYPE_CHECKING:
    from gramian.monte_carlo import Dipole
    from gramian.problem import Problem

__all__ = ["DipoleScenario"]

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Quantity = Literal[
    "x", "y", "z", "x0", "y0", "z0", "vx", "vy", "vz", "mx", "my", "mz", "speed", "moment"
]

Course = Literal["straight", "along", "accelerated", "turning"]

#: Of all numbers, of each sensor, or of each component of each.
Deviation = Annotated[float, Field(gt=0, allow_inf_nan=True)]
Deviations = Deviation | list[Deviation] | list[list[Deviation]]

_UNITS = {"T": 1.0, "mT": 1e-3, "uT": 1e-6, "nT": 1e-9, "mG": 1e-7, "G": 1e-4}


class Columns(Section):
    """The names of the columns: time in seconds, three of the field for each sensor, or one."""

    time: str
    field: list[tuple[str, str, str] | str] = Field(min_length=1)


class Select(Section):
    """Only the rows in which a column has this value."""

    column: str
    value: str


class Record(Section):
    """A recorded field."""

    file: str
    columns: Columns
    unit: Literal["T", "mT", "uT", "nT", "mG", "G"]
    select: Select | None = None
    missing: Literal["raise", "drop"] = "raise"


class Window(Section):
    """Which times are used, seconds; without them the whole record, or the pass in it."""

    start: float
    end: float

    @model_validator(mode="after")
    def _order(self) -> Window:
        if not self.end > self.start:
            raise ValueError(f"end {self.end} s must be later than start {self.start} s")
        return self


class Prior(Section):
    """What is known to a standard deviation."""

    mean: float
    sigma: float = Field(gt=0)


class Fit(Section):
    """How the record is fitted; see `gramian.dipole.localize`."""

    background: Literal["none", "median", "fit", "drift"] = "median"
    loss: Literal["gaussian", "huber"] = "huber"
    window: Literal["pass"] | Window | None = "pass"
    sigma_nT: Deviations | None = None
    starts: int = Field(default=12, ge=1)
    sources: list[int | Literal["quadrupole"]] = Field(default=[1], min_length=1)
    motion: list[Course] = Field(default=["straight"], min_length=1)
    attitude_deg: float | None = Field(default=None, gt=0)
    scale: float | None = Field(default=None, gt=0)
    earth_field_uT: Vector | None = None
    correlation: float | Literal["fit"] = 0.0
    use: list[bool] | None = None


class Further(Section):
    """A dipole of the body after the first: its offset from that (m) and moment (A m^2)."""

    offset: Vector
    m: Vector


class Pass(Section):
    """A pass in place of a record: position (m) at the first time, velocity (m/s), moment.

    What else there is to the body and the sensors is named as in `gramian.monte_carlo.Dipole`.
    """

    r0: Vector
    v: Vector
    m: Vector
    duration: float = Field(gt=0)
    step: float = Field(gt=0)
    sigma_nT: Deviations
    quadrupole: tuple[Vector, Vector, Vector] | None = None
    dipoles: list[Further] | None = Field(default=None, min_length=1, max_length=3)
    acceleration: float | Vector | None = None
    turn_rate_deg_s: float | None = None
    induced_volume: float | None = None
    earth_field_uT: Vector | None = None
    attitude_deg: float | None = Field(default=None, gt=0)
    scale: float | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _samples(self) -> Pass:
        if self.duration / self.step > 1e6:
            raise ValueError("a pass of more than a million samples: choose a longer step")
        return self

    @property
    def body(self) -> dict[str, Any]:
        """What there is beside one dipole on a straight pass, as arguments."""
        earth, tilt, rate = self.earth_field_uT, self.attitude_deg, self.turn_rate_deg_s
        dipoles = self.dipoles
        given = {
            "quadrupole": self.quadrupole,
            "dipoles": None if dipoles is None else [[*d.offset, *d.m] for d in dipoles],
            "acceleration": self.acceleration,
            "turn_rate": None if rate is None else np.radians(rate),
            "induced_volume": self.induced_volume,
            "earth_field": None if earth is None else 1e-6 * np.array(earth),
            "attitude": None if tilt is None else np.radians(tilt),
            "scale": self.scale,
        }
        return {name: value for name, value in given.items() if value is not None}

    @property
    def times(self) -> Array:
        """Instants from 0 to the duration."""
        count = int(np.floor(self.duration / self.step * (1 + 1e-12))) + 1
        return np.asarray(self.step * np.arange(count), dtype=float)


class DipoleScenario(Scenario):
    """One or more sensors, a record or an assumed pass, and what is known of it."""

    model: Literal["dipole"]
    sensors: list[Vector] = Field(default_factory=lambda: [(0.0, 0.0, 0.0)], min_length=1)
    ambient_uT: Vector | None = None
    baselines: list[Vector] | None = None
    record: Record | None = None
    assumed: Pass | None = Field(default=None, alias="pass")
    known: dict[Quantity, float] = Field(default_factory=dict)
    prior: dict[Quantity, Prior] = Field(default_factory=dict)
    fit: Fit = Fit()

    @model_validator(mode="after")
    def _one_source(self) -> DipoleScenario:
        if (self.record is None) == (self.assumed is None):
            raise ValueError("give the section [record] (a recorded field) or [pass], one of them")
        if self.record and len(self.record.columns.field) != len(self.sensors):
            raise ValueError(
                f"record.columns.field names {count(len(self.record.columns.field), 'sensor')}, "
                f"sensors has {len(self.sensors)} position(s): must be as many"
            )
        wanted, kind = (str, "one column") if self.ambient_uT else (tuple, "three columns")
        if self.record and not all(isinstance(f, wanted) for f in self.record.columns.field):
            raise ValueError(
                f"record.columns.field must name {kind} for each sensor: "
                + ("with" if self.ambient_uT else "without")
                + " ambient_uT sensors are of "
                + ("the total field" if self.ambient_uT else "three components")
            )
        if self.ambient_uT is not None and not any(self.ambient_uT):
            raise ValueError("ambient_uT is 0: must be the field without the dipole")
        if self.baselines is not None and len(self.baselines) not in (1, len(self.sensors)):
            raise ValueError(
                f"baselines has {len(self.baselines)} entries, sensors {len(self.sensors)}: must "
                "be one for all, or as many"
            )
        if self.baselines is not None and not all(any(b) for b in self.baselines):
            raise ValueError("a baseline is 0: the heads of a gradiometer must be apart")
        for name, given in (
            ("pass", self.assumed and self.assumed.sigma_nT),
            ("fit", self.fit.sigma_nT),
        ):
            if isinstance(given, list):
                self._deviations(given, name)
        return self

    def _deviations(self, given: Deviations, where: str) -> float | Array:
        """Return deviations in tesla: one, or (S, components)."""
        if not isinstance(given, list):
            return 1e-9 * given
        shape = len(self.sensors), 3 if self.ambient_uT is None else 1
        rows = [row if isinstance(row, list) else [row] * shape[1] for row in given]
        if [len(row) for row in rows] != [shape[1]] * shape[0]:
            raise ValueError(
                f"{where}.sigma_nT must be one number, or {shape[0]} of sensors, or {shape[0]} "
                f"rows of {shape[1]}"
            )
        return 1e-9 * np.array(rows)

    @property
    def _kind(self) -> dict[str, Any]:
        """The sensors, as arguments of the functions of `gramian.dipole`."""
        apart = self.baselines
        if apart is not None and len(apart) == 1:
            apart = apart * len(self.sensors)
        return {
            "sensors": self._positions,
            "ambient": None if self.ambient_uT is None else 1e-6 * np.array(self.ambient_uT),
            "baselines": None if apart is None else np.array(apart, dtype=float),
        }

    @property
    def _sensors(self) -> str:
        """How many sensors of which kind, in words."""
        return _sensors_of(len(self.sensors), self.ambient_uT is None, self.baselines is None)

    @property
    def _noise(self) -> float | Array:
        """Of the assumed pass, tesla."""
        assert self.assumed is not None
        return self._deviations(self.assumed.sigma_nT, "pass")

    @property
    def _positions(self) -> Array:
        return np.array(self.sensors, dtype=float)

    @property
    def _priors(self) -> dict[str, tuple[float, float]]:
        return {name: (value.mean, value.sigma) for name, value in self.prior.items()}

    @cached_property
    def _samples(self) -> tuple[Array, Array]:
        """Times and field (K, S, 3), or (K, S) of the total field, in tesla."""
        assert self.record is not None
        record = self.record
        path = self.beside(record.file)
        numbers = {"time": record.columns.time}
        for s, names in enumerate(record.columns.field):
            own = zip("xyz", names, strict=True) if isinstance(names, tuple) else [("F", names)]
            numbers |= {f"{axis} of sensor {s + 1}": name for axis, name in own}
        texts = {"selection": record.select.column} if record.select else {}
        missing: Literal["raise", "nan"] = "nan" if record.missing == "drop" else "raise"
        values, words = read_columns(path, numbers, texts, missing=missing)
        chosen = np.ones(values["time"].shape, dtype=bool)
        if record.select:
            chosen = words["selection"] == record.select.value
            if not chosen.any():
                there = ", ".join(sorted(set(words["selection"])))
                raise self.error(
                    "record.select.value", f"{record.select.value!r} is not in {path}: {there}"
                )
        times = values.pop("time")[chosen]
        field = np.stack([column[chosen] for column in values.values()], axis=1)
        if self.ambient_uT is None:
            field = field.reshape(len(times), -1, 3)
        return times, _UNITS[record.unit] * field

    def locate(self) -> Localization:
        """Locate the dipole in the record."""
        times, field = self._samples
        fit = self.fit
        window: Literal["pass"] | tuple[float, float] | None = (
            (fit.window.start, fit.window.end) if isinstance(fit.window, Window) else fit.window
        )
        assert self.record is not None
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)
            try:
                return _localize.localize(
                    times,
                    field,
                    {str(name): value for name, value in self.known.items()},
                    prior=self._priors,
                    **self._kind,
                    background=None if fit.background == "none" else fit.background,
                    loss=fit.loss,
                    sigma=None if fit.sigma_nT is None else self._deviations(fit.sigma_nT, "fit"),
                    window=window,
                    missing=self.record.missing,
                    starts=fit.starts,
                    sources=fit.sources,
                    motion=fit.motion,
                    attitude=None if fit.attitude_deg is None else np.radians(fit.attitude_deg),
                    scale=fit.scale,
                    earth_field=(
                        None if fit.earth_field_uT is None else 1e-6 * np.array(fit.earth_field_uT)
                    ),
                    correlation=fit.correlation,
                    use=fit.use,
                )
            except UserWarning as warning:
                raise self.error("record.unit", str(warning)) from None

    def localize(self) -> Report:
        """Estimate the pass from its field."""
        if self.record is None:
            raise self.error("record", "is missing: there is nothing to locate from")
        try:
            found = self.locate()
        except UnobservableError as error:
            return self._refusal(error)
        return _located(found, self._title, self.model)

    @property
    def _title(self) -> str:
        if self.record is None:
            return self.path.stem
        return f"{self.record.file}" + (
            f" ({self.record.select.value})" if self.record.select else ""
        )

    def _refusal(self, error: UnobservableError) -> Report:
        return Report(
            title=self._title,
            subtitle=f"{self._sensors}, one dipole",
            tone="bad",
            headline="UNOBSERVABLE",
            verdict=str(error),
            facts=[("cannot be determined", text) for text in error.null_combinations],
            data={"model": self.model, "null_combinations": list(error.null_combinations)},
        )

    def _experiment(self, known: Sequence[str] = ()) -> Dipole:
        """Return the experiment of the assumed pass, with states that are known."""
        from gramian.monte_carlo import Dipole

        given = self.assumed
        assert given is not None
        beside = {**self._kind, **given.body}
        try:
            return Dipole(
                given.r0, given.v, given.m, given.times, self._noise, known=known, **beside
            )
        except InputError as error:
            # Its arguments are called as the keys are, but for their units.
            names = {name: name for name in Pass.model_fields}
            names |= {"turn_rate": "turn_rate_deg_s", "earth_field": "earth_field_uT"}
            names |= {"attitude": "attitude_deg"}
            key = names.get(str(error).split()[0], "")
            raise self.error(f"pass.{key}" if key else "pass", str(error)) from None

    @property
    def _held(self) -> list[str]:
        """The components of the place that a quadrupole is told about, not its centre's."""
        if self.assumed is None or self.assumed.quadrupole is None:
            return []
        told = {_long(name) for name in (*self.known, *self.prior)}
        return [name for name in _model.NAMES[:3] if name in told]

    @cached_property
    def _problem(self) -> tuple[Problem, Array]:
        """The rows of the pass, assumed or located, and its state."""
        if self.assumed is not None and self.assumed.body:
            given = self.assumed
            return self._experiment(self._held).problem(), np.array([*given.r0, *given.v, *given.m])
        if self.assumed is not None:
            given = self.assumed
            state = np.array([*given.r0, *given.v, *given.m])
            times, sigma = given.times, self._noise
        else:
            found = self.locate()
            start = found.r0 + (found.times[0] - found.origin) * found.v
            state = np.concatenate([start, found.v, found.m])
            differ = np.ptp(found.sigmas) > 0
            times, sigma = found.times, found.sigmas if differ else found.sigma
        problem = _model.problem(state[:3], state[3:6], state[6:], times, sigma, **self._kind)
        return problem, state

    @property
    def problem(self) -> Problem:
        """The rows of the pass, with what is known of it."""
        problem, state = self._problem
        names = {_long(name) for name in self.known}
        sizes = [name for name in names if name not in _model.NAMES]
        fixed = [name for name in _model.NAMES if name in names]
        fixed = [name for name in fixed if name in problem.names]
        if len(fixed) == len(problem.names):
            raise self.error("known", "names every state: nothing is left to determine")
        if fixed:
            problem = problem.fix(*fixed)
        # Exactly known sizes: to a millionth of themselves, so that they stay rows.
        sigmas = {name: 1e-6 * float(self._size(name, state)) for name in sizes}
        sigmas |= {_long(name): value.sigma for name, value in self.prior.items()}
        for name in sigmas:
            if name not in problem.names and name not in problem.combinations:
                raise self.error(f"prior.{name}", "is of something that is known")
        return problem.prior(sigmas) if sigmas else problem

    @property
    def _passing(self) -> str:
        """What passes, in words."""
        if self.assumed is None or not self.assumed.body:
            return "one passing dipole"
        body = self._experiment(self._held).body
        return "one passing dipole" if body is None else str(body.description)

    def analyze(self) -> Report:
        """Answer what the field of the pass determines, and what knowledge would add."""
        try:
            problem = self.problem
        except UnobservableError as error:
            if self.record is None:
                raise
            return self._refusal(error)
        answer, state = analyze(problem), self._problem[1]
        return Report(
            title=self._title,
            subtitle=f"{len(problem.rows)} numbers of {self._sensors}, {self._passing}",
            tone=tone_of(answer),
            headline={"weak": "WEAKLY OBSERVABLE"}.get(answer.status, answer.status.upper()),
            verdict=answer.reason,
            facts=_facts(answer),
            tables=answer_tables(answer),
            pictures=answer_pictures(answer),
            data={"model": self.model, "state": plain(state), "observability": answer.to_dict()},
        )

    def _size(self, name: str, state: Array) -> float:
        return float(np.linalg.norm(state[3:6] if name == "speed" else state[6:]))

    def experiment(self) -> Simulation:
        """Return the experiment of the assumed pass, with what is known of it."""
        if self.assumed is None:
            raise self.error("pass", "is missing: there is nothing to simulate")
        given = self.assumed
        return Simulation(
            self._experiment([_long(name) for name in self.known]),
            title=self._title,
            subtitle=f"{len(given.times)} samples of {self._sensors}, sigma {self._sigma_text}",
        )

    @property
    def _sigma_text(self) -> str:
        each = 1e9 * np.ravel(self._noise)
        seen = each[each < np.inf]
        if seen.min() == seen.max():
            return f"{seen[0]:g} nT"
        return f"{seen.min():g} to {seen.max():g} nT"

    def _true(self, name: str, state: Array) -> float:
        if name in ("speed", "moment"):
            return self._size(name, state)
        return float(state[_model.NAMES.index(_long(name))])

    def simulate(
        self, trials: int, seed: int, *, resume: Path | None = None, progress: bool = False
    ) -> Report:
        """Locate the assumed pass many times and compare with the bound.

        With a prior, or knowledge that is not true of the pass, the trials are
        run in one go: there is nothing to resume.
        """
        if self.assumed is None:
            raise self.error("pass", "is missing: there is nothing to simulate")
        given = self.assumed
        state = np.array([*given.r0, *given.v, *given.m])
        if not self.prior and all(
            np.isclose(value, self._true(str(name), state), rtol=1e-9, atol=1e-12)
            for name, value in self.known.items()
        ):
            return super().simulate(trials, seed, resume=resume, progress=progress)
        known = {str(name): value for name, value in self.known.items()}
        found = _trials.localize_trials(
            given.r0,
            given.v,
            given.m,
            given.times,
            self._noise,
            seed,
            trials,
            known=known,
            prior=self._priors,
            **self._kind,
            **given.body,
        )
        if given.body:
            told = {_long(name): value for name, value in known.items()}
            passing = self._experiment(list(told))._passing
            assert passing is not None
            priors = {_long(name): pair for name, pair in self._priors.items()}
            bound = replace(passing, prior=priors).bound(told)
        else:
            exact = _model.measure(given.r0, given.v, given.m, given.times, **self._kind)
            bound = _localize.localize(
                given.times,
                exact,
                known,
                prior=self._priors,
                sigma=self._noise,
                **self._kind,
            ).pass_std
        # A trial of a body that is refused is NaN.
        located = found[~np.isnan(found).any(axis=1)]
        if not len(located):
            raise self.error("pass", f"none of {trials} trials is located")
        rmse = np.sqrt(((located - state) ** 2).mean(axis=0))
        ratio = np.divide(rmse, bound, out=np.ones(9), where=bound > 0)
        spread = 3 / np.sqrt(2 * len(located))
        near = bool((np.abs(ratio - 1) < spread + 0.05).all())
        return Report(
            title=self._title,
            subtitle=f"{trials} trials, seed {seed}",
            tone="good" if near else "weak",
            headline="AT THE BOUND" if near else "OFF THE BOUND",
            verdict=f"errors (rms) are {ratio.min():.3f} to {ratio.max():.3f} times the bounds"
            + (f"; {trials - len(located)} trials are refused" if len(located) < trials else ""),
            tables=[
                Table(
                    "Errors against the bound",
                    ["state", "true", "root mean square error", "bound", "ratio"],
                    [
                        [
                            name,
                            number(state[i]),
                            number(rmse[i]),
                            number(bound[i]),
                            f"{ratio[i]:.3f}",
                        ]
                        for i, name in enumerate(_model.NAMES)
                    ],
                )
            ],
            data={
                "model": self.model,
                "trials": trials,
                "seed": seed,
                "rmse": plain(rmse),
                "bound": plain(bound),
            },
        )


_TONES: dict[str, Tone] = {"determined": "good", "misfit": "bad"}
_HEADLINES = {
    "determined": "LOCATED",
    "weak": "LOCATED, VAGUELY",
    "ambiguous": "LOCATED, NOT UNIQUELY",
    "misfit": "THE MODEL DOES NOT FIT",
    "not_converged": "NOT CONVERGED",
    "unobservable": "NOT OBSERVABLE",
}


#: How states begin that tell a vector of known size by angles.
_ANGLES = ("r ", "v ", "m ")


def _explained_by(found: Localization) -> str:
    sources = found.model.description.sources
    return "one dipole explains" if sources == 1 else f"{count(sources, 'dipole')} explain"


def _located(found: Localization, title: str, model: str) -> Report:
    near, speed, moment = found.closest, found.speed, found.moment
    tone = _TONES.get(found.status, "weak")
    facts = [
        (
            "closest approach",
            f"{number(near.range, 3)} m +- {number(near.range_std, 2)} at {brief(near.time, 4)} s",
        ),
        ("seen from the first sensor", "(" + ", ".join(f"{x:.2f}" for x in near.position) + ") m"),
        (
            "speed",
            f"{brief(speed[0], 4)} m/s"
            + (f" +- {number(speed[1], 2)}" if speed[1] > 0 else " (known)"),
        ),
        ("direction of travel", "(" + ", ".join(f"{x:.3f}" for x in found.direction) + ")"),
        (
            "moment",
            f"{brief(moment[0], 4)} A m^2"
            + (f" +- {number(moment[1], 2)}" if moment[1] > 0 else ""),
        ),
        ("mirror image", _mirror(found)),
        (
            "left over",
            f"{100 * (1 - found.explained):.1f} % of the field's square; sigma "
            f"{_nanotesla(found)} nT; {found.spikes} spikes and {found.dropped} missing "
            f"samples left out of {len(found.times) + found.dropped}",
        ),
    ]
    values = np.concatenate([found.r0, found.v, found.m])
    columns = ["state", "value", "standard deviation", "unit"]
    mirror = None
    if found.mirror is not None:
        mirror = np.concatenate([found.mirror.r0, found.mirror.v, found.mirror.m])
        columns.append("mirror image")
    table = Table(
        "The pass",
        columns,
        [
            [
                name,
                number(values[i]),
                number(found.pass_std[i]) if found.pass_std[i] > 0 else "known",
                _model.UNITS[i],
                *([number(mirror[i])] if mirror is not None else []),
            ]
            for i, name in enumerate(_model.NAMES)
        ],
        "Standard deviations are the bound with independent noise of the sigma above; where the "
        "dipole is no more than a model of the body, the true errors are larger.",
    )

    more = [
        [name, number(found.state[k]), number(found.std[k]), found.units[k]]
        for k, name in enumerate(found.names)
        if name not in _model.NAMES and not name.startswith(_ANGLES)
    ]
    tables = [table]
    if more:
        tables.append(Table("Beside the pass", columns[:4], more, str(found.model.description)))

    def pictures() -> Any:
        from gramian.models.dipole import plot as drawn

        return drawn

    return Report(
        title=title,
        subtitle=(
            f"{count(len(found.times), 'sample')} of "
            + _sensors_of(
                len(found.sensors), found.model.ambient is None, found.model.baselines is None
            )
        ),
        tone=tone,
        headline=_HEADLINES[found.status],
        verdict=(
            ("" if found.status == "determined" else f"{found.reason}; ")
            + f"{_explained_by(found)} {100 * found.explained:.1f} % of the field; it passes at "
            f"{number(near.range, 3)} m, +- {number(100 * near.range_std / near.range, 2)} %"
        ),
        facts=facts,
        tables=tables,
        pictures=[
            Picture(
                "Field",
                "Samples, the field of the dipole, and what it leaves over.",
                found.plot,
            ),
            Picture(
                "Path",
                "From above and from the side. At one sensor its mirror image has the same field.",
                lambda: pictures().path(found),
            ),
        ],
        data={"model": model, "localization": found.to_dict()},
    )


def _mirror(found: Localization) -> str:
    if found.mirror is None:
        return found.no_mirror
    if found.mirror.cost <= found.cost * (1 + 1e-6) + 1e-9:
        return "(-r0, -v, m) fits exactly as well: a prior of one component would tell them apart"
    return f"fits worse: cost {found.mirror.cost:.5g} against {found.cost:.5g}"


def _facts(answer: Observability) -> list[tuple[str, str]]:
    facts = [("cannot be determined", text) for text in answer.null_combinations]
    if answer.nullity and answer.suggestions:
        repairs = [s.name for s in answer.suggestions if s.repairs]
        if repairs:
            facts.append(("any one of these would repair it", ", ".join(repairs)))
    return facts


def _sensors_of(number: int, vector: bool, single: bool) -> str:
    """Say how many sensors there are, and what they measure."""
    if single:
        return count(number, "three-component sensor" if vector else "total-field sensor")
    return count(number, "gradiometer" if vector else "total-field gradiometer")


def _nanotesla(found: Localization) -> str:
    seen = 1e9 * found.sigmas[found.sigmas < np.inf]
    least, most = float(seen.min()), float(seen.max())
    return brief(least) + (f" to {brief(most)}" if most > least * (1 + 1e-9) else "")


def _long(name: str) -> str:
    return f"{name}0" if name in ("x", "y", "z") else name
