"""Scenarios of a linear system of one's own: `model = "linear"`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from gramian._text import brief, number
from gramian.exceptions import InputError
from gramian.models.linear import _levels, _windows
from gramian.models.linear._degrees import history, posterior
from gramian.report import Picture, Report, Table, Tone
from gramian.scenario.base import Scenario, Section

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gramian.models.linear._degrees import Information
    from gramian.models.linear._levels import Levels

__all__ = ["LinearScenario", "Observed", "linear_report"]

Array = NDArray[np.float64]


class Matrices(Section):
    """x' = A x (or x[k+1] = A x[k]), y = C x; rows of numbers."""

    A: list[list[float]] = Field(min_length=1)
    C: list[list[float]] = Field(min_length=1)
    names: list[str] | None = None
    units: list[str] | None = None
    time: Literal["continuous", "discrete"] = "continuous"


class Window(Section):
    """How long and how often outputs are taken, in the system's unit of time."""

    duration: float = Field(gt=0)
    step: float = Field(gt=0)

    @model_validator(mode="after")
    def _steps(self) -> Window:
        if self.step > self.duration:
            raise ValueError(f"step {self.step} must not exceed the duration {self.duration}")
        if self.duration / self.step > 1e5:
            raise ValueError("a window of more than a hundred thousand samples: a longer step")
        return self


Deviation = Annotated[float, Field(gt=0)]


class Noise(Section):
    """Standard deviation of each output, or one for all."""

    output: Deviation | list[Deviation] = 1.0


class LinearScenario(Scenario):
    """A system, and if given a window, noise and prior knowledge."""

    model: Literal["linear"]
    system: Matrices
    combinations: dict[str, dict[str, float]] = Field(default_factory=dict)
    window: Window | None = None
    noise: Noise = Noise()
    prior: dict[str, Deviation] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _prior_of_all(self) -> LinearScenario:
        units, states, outputs = self.system.units, len(self.system.A), len(self.system.C)
        if units and len(units) != states:
            raise ValueError(f"system.units has {len(units)} entries: must have {states}")
        output = self.noise.output
        if isinstance(output, list) and len(output) not in (1, outputs):
            raise ValueError(f"noise.output has {len(output)} entries: must have {outputs}")
        if self.prior and self.window is None:
            raise ValueError("prior says something only over a window: give [window] too")
        return self

    def analyze(self) -> Report:
        """Answer what each derivative determines, and what the window adds to the prior."""
        try:
            found = _levels.levels(
                self.system.A,
                self.system.C,
                self.system.names,
                combinations=self.combinations,
            )
            observed = self._observed(found) if self.window and self.prior else None
        except InputError as error:
            raise self.error("system", str(error)) from error
        count = len(self.system.C)
        outputs = "1 output" if count == 1 else f"{count} outputs"
        return linear_report(
            self.path.stem, f"{len(found.names)} states, {outputs}", found, observed
        )

    def _observed(self, found: Levels) -> Observed:
        assert self.window is not None
        missing = [name for name in found.names if name not in self.prior]
        if missing or len(self.prior) > len(found.names):
            unknown = [name for name in self.prior if name not in found.names]
            if unknown:
                raise self.error(
                    f"prior.{unknown[0]}", f"no state has that name: {', '.join(found.names)}"
                )
            raise self.error("prior", f"{', '.join(missing)} has none: every state needs one")
        sigma = np.broadcast_to(np.asarray(self.noise.output, dtype=float), (len(self.system.C),))
        seen = _windows.rows(
            self.system.A,
            self.system.C,
            window=self.window.duration,
            dt=self.window.step,
            R=sigma**2,
            time=self.system.time,
        )
        return Observed.of(
            seen,
            [self.prior[name] for name in found.names],
            found.names,
            self.system.units or [""] * len(found.names),
            len(self.system.C),
            self.window.step,
            "",
        )


@dataclass(frozen=True, eq=False)
class Observed:
    """A window of outputs against the prior: at its end, and on the way."""

    information: Information
    times: Array
    ratios: Array
    unit: str

    @classmethod
    def of(
        cls,
        seen: Array,
        prior: Sequence[float] | Array,
        names: Sequence[str],
        units: Sequence[str],
        block: int,
        step: float,
        unit: str,
    ) -> Observed:
        """Work out both from whitened rows, `block` a sample, a sample each `step`."""
        root = np.diag(np.asarray(prior, dtype=float))
        total = len(seen) // block
        # Long windows by factors, short ones (a maneuver) evenly.
        space = np.geomspace if total > 500 else np.linspace
        counts = np.unique(space(1, total, min(total, 60)).round().astype(int))
        ratios, samples = history(seen, root, block, counts.tolist())
        end = posterior(seen @ root, root, tuple(names), tuple(units), (total - 1) * step)
        return cls(end, np.asarray((samples - 1) * step, dtype=float), ratios, unit)


def linear_report(
    title: str,
    subtitle: str,
    found: Levels,
    observed: Observed | None,
    *,
    where: str = "",
    facts: Sequence[tuple[str, str]] = (),
    tables: Sequence[Table] = (),
    data: Mapping[str, Any] | None = None,
) -> Report:
    """Return the report that both linear models give.

    `where` says what the levels are of, when not of the whole: "first leg".
    """
    n = len(found.names)
    verdict = f"rank {found.rank} of {n}: " + (
        f"{_count(found.nullity, 'combination')} of the states that no output ever shows"
        if found.nullity
        else "the outputs and their derivatives determine every state"
    )
    if found.ranks is None:
        lines = [("ranks by derivative", str(found.reason))]
    else:
        lines = [("ranks by derivative", ", ".join(map(str, _distinct(found.ranks))))]
    weakest, rejected = found.margins
    lines.append(
        (
            "how clear the ranks are",
            f"weakest coupling {brief(weakest, 2)}, rounding {brief(rejected, 1)}, cut at "
            f"{brief(found.rtol, 1)}",
        )
    )
    tone, headline, weakness = linear_verdict(found.nullity, observed)
    if found.undecided:
        tone, headline = "weak", "UNDECIDED"
        weakness = "; what decides it is too near to rounding, the rank may be larger"
    verdict += weakness
    if observed is not None and (unlearned := _unlearned(observed.information)):
        told = ", ".join(f"{name} ({brief(ratio)} of the prior)" for name, ratio in unlearned)
        lines.append(("the prior says more of", told))
    lines += facts
    shown = [*_levels_table(found), *_null_table(found)]
    if where:
        shown = [replace(table, title=f"{where.capitalize()}: {table.title}") for table in shown]
    shown += tables
    pictures = [
        Picture(
            "What each derivative adds",
            "Left, the rank of the outputs and their first k derivatives. Right, from which "
            "derivative on each state and named combination is known; red for never.",
            found.plot,
        )
    ]
    if found.ranks is None:
        pictures = []
    values: dict[str, Any] = {"levels": found.to_dict()} | dict(data or {})
    if observed is not None:
        information = observed.information
        shown.insert(0, _ratio_table(information, found, where, observed.unit))
        values["information"] = information.to_dict()
        values["history"] = {
            "times": observed.times.tolist(),
            "ratios": observed.ratios.tolist(),
        }

        def ratios() -> Figure:
            from gramian.models.linear.plot import ratio_history

            return ratio_history(observed.times, observed.ratios, information.names, observed.unit)

        pictures += [
            Picture(
                "What the window adds to the prior",
                "Posterior over prior deviation of each state as the window grows: a line "
                "that stays at 1 learns nothing.",
                ratios,
            ),
            Picture(
                "Combinations, best known first",
                "Each column is a combination of the states. "
                + (
                    "Right of the red line the prior knows more than the window. "
                    if information.determined < len(information.names)
                    else "The window knows more than the prior of every one. "
                )
                + "None of it depends on a unit.",
                information.plot,
            ),
        ]
    return Report(
        title=title,
        subtitle=subtitle,
        tone=tone,
        headline=headline,
        verdict=verdict,
        facts=lines,
        tables=shown,
        pictures=pictures,
        data=values,
    )


def linear_verdict(nullity: int, observed: Observed | None) -> tuple[Tone, str, str]:
    """Return the tone, the headline, and what to add to the verdict.

    Weak is what is observable, but of which the prior says more than the window.
    """
    if nullity:
        return "bad", "UNOBSERVABLE", ""
    unlearned = _unlearned(observed.information) if observed is not None else ()
    if not unlearned:
        return "good", "OBSERVABLE", ""
    name, ratio = unlearned[0]
    told = f"; of {name} the prior says more than the window (posterior / prior {brief(ratio)})"
    return "weak", "WEAKLY OBSERVABLE", told


def _unlearned(information: Information) -> tuple[tuple[str, float], ...]:
    """Return the states of which the prior says more than the window, the least known first.

    Measurements as good as the prior bring posterior / prior to 1 / sqrt 2.
    """
    ratio = np.asarray(information.ratio)
    order = np.argsort(-ratio)
    return tuple((information.names[i], float(ratio[i])) for i in order if ratio[i] > 0.5**0.5)


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}{'' if n == 1 else 's'}"


def _distinct(ranks: Sequence[int]) -> list[int]:
    shown = list(ranks[:1])
    for rank in ranks[1:]:
        if rank == shown[-1]:
            break
        shown.append(rank)
    return shown


def _levels_table(found: Levels) -> list[Table]:
    if found.ranks is None:
        return []
    rows = []
    for k, level in enumerate(found.new_combinations):
        source = "outputs" if k == 0 else f"derivative {k}"
        rows += [[source if i == 0 else "", text] for i, text in enumerate(level)]
    return [
        Table(
            "What becomes known when",
            ["from", "combination"],
            rows,
            "A combination is determined up to those above it.",
        )
    ]


def _null_table(found: Levels) -> list[Table]:
    if not found.nullity:
        return []
    return [
        Table(
            "What cannot be determined",
            ["unobservable combination"],
            [[text] for text in found.null_combinations],
            "Moving the states together in these proportions changes no output, ever.",
        )
    ]


def _ratio_table(information: Information, found: Levels, where: str, unit: str) -> Table:
    rows = []
    for i, name in enumerate(information.names):
        level = found.states[name] if found.states is not None else None
        rows.append(
            [
                name,
                ("never" if level is None else str(level)) if found.states is not None else "-",
                number(information.prior[i]),
                number(information.posterior[i]),
                information.units[i],
                f"{brief(information.ratio[i])}",
            ]
        )
    column = "known on its own from derivative" + (f", {where}" if where else "")
    return Table(
        f"After a window of {information.window:g} {unit}".rstrip(),
        ["state", column, "prior", "posterior", "unit", "posterior / prior"],
        rows,
        "A state that is never known alone can gain from the prior of those it is tied to.",
    )
