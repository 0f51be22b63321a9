"""What every scenario has."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict, PrivateAttr

from gramian._registry import REGISTRY, part
from gramian.exceptions import ScenarioError
from gramian.report import Report

if TYPE_CHECKING:
    from gramian.monte_carlo import Experiment
    from gramian.problem import Problem

__all__ = ["Scenario", "Section", "Simulation", "models_for", "scenario_class"]


@dataclass(frozen=True)
class Simulation:
    """A Monte Carlo experiment, and what a report says of it beforehand."""

    experiment: Experiment
    title: str
    subtitle: str
    facts: Sequence[tuple[str, str]] = ()


class Section(BaseModel):
    """A table of a scenario file: unknown keys, NaN and infinity are errors.

    So are true, false and "1" for a number, at any depth.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)


class Scenario(Section):
    """A scenario file of one model; each model says what can be asked of it.

    A subclass adds ``model: Literal["name"]``, its sections, and the methods for
    the commands that it supports.
    """

    model: str
    _path: Path = PrivateAttr(default=Path("scenario.toml"))
    _taken: Any = PrivateAttr(default=None)

    @property
    def path(self) -> Path:
        """The file it was read from."""
        return self._path

    @path.setter
    def path(self, path: Path) -> None:
        self._path = path

    def take(self, recording: object) -> None:
        """Use what has been read of the scenario's files already."""
        self._taken = recording

    def beside(self, name: str) -> Path:
        """Return the path of a file that is named relative to the scenario file."""
        return self._path.parent / name

    @property
    def inputs(self) -> tuple[Path, ...]:
        """The scenario's own file and those that it names, as far as they are there."""
        named = [self._path, *(self.beside(name) for name in _files(self))]
        return tuple(dict.fromkeys(path for path in named if path.is_file()))

    def error(self, key: str, message: str) -> ScenarioError:
        """Return an error about a key that only the whole scenario shows to be wrong."""
        return ScenarioError(f"{self._path}: {key}: {message}")

    @property
    def problem(self) -> Problem:
        """The rows, with what is known beforehand: what `analyze` answers for."""
        raise self._unsupported("analyze")

    def analyze(self) -> Report:
        """Answer what the measurements can and cannot determine."""
        raise self._unsupported("analyze")

    def localize(self) -> Report:
        """Estimate from recorded measurements."""
        raise self._unsupported("localize")

    def plan(self, progress: Callable[[int, int, float], object] | None = None) -> Report:
        """Choose what to do so as to know more; `progress` hears of pieces of work done."""
        raise self._unsupported("plan")

    def experiment(self) -> Simulation:
        """Return what `simulate` runs."""
        raise self._unsupported("simulate")

    def simulate(
        self, trials: int, seed: int, *, resume: Path | None = None, progress: bool = True
    ) -> Report:
        """Check the estimator against its bound over simulated trials."""
        from gramian.monte_carlo.report import simulate

        what = self.experiment()
        return simulate(
            what.experiment,
            trials,
            seed,
            title=what.title,
            subtitle=what.subtitle,
            facts=what.facts,
            resume=resume,
            progress=progress,
        )

    def _unsupported(self, command: str) -> ScenarioError:
        able = ", ".join(f'"{name}"' for name in models_for(command))
        return ScenarioError(
            f'{self._path}: model = "{self.model}": the command {command} does not work on it, '
            f"but on {able}"
        )


def _files(section: BaseModel) -> Iterator[str]:
    """Yield what every key `file`, `files` or `*_file` of a section says, at any depth."""
    for key in type(section).model_fields:
        value = getattr(section, key)
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, BaseModel):
                yield from _files(item)
            elif (key in {"file", "files"} or key.endswith("_file")) and isinstance(
                item, (str, Path)
            ):
                yield str(item)


def models_for(command: str) -> list[str]:
    """Return the models that a command works on."""
    method = "experiment" if command == "simulate" else command
    return [
        name
        for name in REGISTRY
        if any(
            getattr(scenario_class(name), how) is not getattr(Scenario, how)
            for how in {method, command}
        )
    ]


def scenario_class(model: str) -> type[Scenario]:
    """Return the class of a model's scenario files."""
    kind: type[Scenario] = part(model, "scenario", REGISTRY[model].scenario)
    return kind
