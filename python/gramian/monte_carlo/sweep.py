"""`sweep`: a Monte Carlo run at every point of a range of scenarios."""

from __future__ import annotations

import inspect
import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._registry import draw
from gramian._text import brief, plain
from gramian.exceptions import InputError, UnobservableError
from gramian.monte_carlo.chunks import Estimator
from gramian.monte_carlo.experiment import Experiment
from gramian.monte_carlo.result import MonteCarloResult
from gramian.monte_carlo.run import Quantities, run, unobservable
from gramian.problem import Problem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["SweepResult", "sweep"]

Array = NDArray[np.float64]

#: What `SweepResult.values` knows of every state.
OF_STATES = ("rmse", "bias", "std", "bound", "efficiency", "truth")
#: And of a run.
OF_RUNS = ("nees", "inside", "used", "failed")


@dataclass(frozen=True, eq=False, repr=False)
class SweepResult(Answer):
    """The runs of a sweep, on a grid of one or two parameters.

    Attributes
    ----------
    parameters : mapping of str to ndarray
        The values of each parameter, in the order of the grid's axes.
    results : tuple of MonteCarloResult
        One for each point of the grid, the last parameter changing fastest.
    """

    parameters: Mapping[str, Array]
    results: tuple[MonteCarloResult, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the grid."""
        return tuple(len(values) for values in self.parameters.values())

    @property
    def names(self) -> tuple[str, ...]:
        """The states."""
        return self.results[0].names

    def values(self, what: str, state: str | None = None) -> Array:
        """Return a number of every run, in the shape of the grid.

        Parameters
        ----------
        what : str
            "rmse", "bias", "std", "bound", "efficiency" or "truth" of a state;
            "nees" (its mean), "inside", "used" or "failed" of the run; or the
            name of a quantity, for its mean.
        state : str, optional
            Which state; without it, those of all states on a last axis.
        """
        if not isinstance(what, str):
            raise InputError(
                f"what = {options.given(what)}: must be a word or the name of a quantity"
            )
        if state is not None and not isinstance(state, str):
            raise InputError(f"state = {options.given(state)}: must be the name of a state")
        picked = [_value(result, what) for result in self.results]
        array = np.array(picked, dtype=float)
        array = array.reshape(*self.shape, *array.shape[1:])
        if state is None:
            return array
        if state not in self.names:
            raise InputError(f"no state is named {state!r}: there are {', '.join(self.names)}")
        if what not in OF_STATES:
            raise InputError(f"{what!r} is of a run and not of a state")
        chosen: Array = array[..., self.names.index(state)]
        return chosen

    def _columns(self) -> dict[str, list[Any]]:
        points = list(itertools.product(*self.parameters.values()))
        columns: dict[str, list[Any]] = {
            name: [float(point[axis]) for point in points]
            for axis, name in enumerate(self.parameters)
        }
        first = self.results[0]
        if first.estimator is not None:
            for state in self.names:
                for what in ("rmse", "bound", "efficiency"):
                    if what == "rmse" or first.bound is not None:
                        columns[f"{what}_{state}"] = self.values(what, state).ravel().tolist()
            for what in OF_RUNS:
                columns[what] = self.values(what).ravel().tolist()
        for name in first.quantities:
            columns[name] = self.values(name).ravel().tolist()
        return columns

    def _as_table(self) -> Columns:
        columns = self._columns()
        return Columns("run", range(len(self.results)), columns, {})

    def _verdict_line(self) -> str:
        over = " x ".join(f"{len(v)} of {name}" for name, v in self.parameters.items())
        return f"{len(self.results)} runs of {self.results[0].trials} trials: {over}"

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values, fit for JSON."""
        return {
            "parameters": {name: plain(values) for name, values in self.parameters.items()},
            "results": [result.to_dict() for result in self.results],
        }

    def summary(self) -> str:
        """Return the table of all points as text."""
        columns = self._columns()
        # No number where there is no estimate.
        texts = [
            ["-" if np.isnan(v) else f"{brief(v, 4)}" for v in values]
            for values in columns.values()
        ]
        rows = [list(columns), *map(list, zip(*texts, strict=True))]
        widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        return "\n".join(
            "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
            for row in rows
        )

    def plot(self, what: str = "rmse", states: Sequence[str] | None = None) -> Figure:
        """Draw a number against the parameters, the bound beside; needs matplotlib.

        Parameters
        ----------
        what : str
            As for `values`.
        states : sequence of str, optional
            Which states; all by default.
        """
        return draw(self, "sweep", what, tuple(states) if states is not None else self.names)


def sweep(
    scenario: Experiment | Callable[..., Experiment | Problem],
    parameters: Mapping[str, ArrayLike],
    trials: int,
    seed: int,
    estimator: str | Estimator | None = None,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: bool = True,
    resume: str | os.PathLike[str] | None = None,
    quantities: Quantities | None = None,
) -> SweepResult:
    """Run a Monte Carlo over one or two parameters of a scenario.

    Parameters
    ----------
    scenario : callable or Experiment
        A function of the parameters, by keyword, that returns an experiment or
        `Problem`; or an experiment of which fields are replaced.
    parameters : mapping of str to array_like
        One or two parameters and their values.
    trials, seed
        As for `run`, at every point. All points use the same random numbers, so
        that their differences are those of the scenarios.
    estimator, workers, executor, progress, quantities
        As for `run`.
    resume : path, optional
        A directory with one directory for each point.

    Returns
    -------
    SweepResult

    Notes
    -----
    Where the states are not observable a built-in estimator gives no estimate:
    the bound is `inf` there, and all trials count as failed.

    Examples
    --------
    >>> import gramian as gm
    >>> def line(samples):
    ...     return gm.Problem([[1.0, i] for i in range(int(samples))], ["level", "slope"])
    >>> result = gm.monte_carlo.sweep(line, {"samples": [4, 8, 16]}, 2000, seed=1)
    >>> result.values("bound", "slope").round(3)
    array([0.447, 0.154, 0.054])
    """
    if not isinstance(parameters, Mapping):
        raise InputError(
            f"parameters is a {type(parameters).__name__}: must be a mapping of name to values"
        )
    given = options.mapping(parameters, "parameters", "name to values")
    grid = {name: _values(name, values) for name, values in given.items()}
    if not 1 <= len(grid) <= 2:
        raise InputError(f"parameters has {len(grid)} entries: must have one or two")
    make = _maker(scenario, tuple(grid))
    results = []
    for values in itertools.product(*grid.values()):
        point = {name: value.item() for name, value in zip(grid, values, strict=True)}
        place = None
        if resume is not None:
            text = "_".join(f"{name}={value!r}" for name, value in point.items())
            place = Path(resume) / text.replace(os.sep, "-")
        experiment = make(**point)
        try:
            result = run(
                experiment,
                trials,
                seed,
                estimator,
                workers=workers,
                executor=executor,
                progress=progress,
                resume=place,
                quantities=quantities,
            )
        except UnobservableError as error:
            # A point of the range where no estimate exists is an answer too.
            name = estimator if isinstance(estimator, str) else None
            result = unobservable(experiment, trials, seed, name, str(error))
        results.append(result)
    return SweepResult(MappingProxyType(grid), tuple(results))


def _values(name: str, given: ArrayLike) -> Array:
    try:
        values = np.asarray(given)
    except ValueError as error:  # lists of different length
        raise InputError(f"parameters[{name!r}]: {error}") from None
    if values.ndim != 1 or values.size == 0:
        raise InputError(
            f"parameters[{name!r}] has shape {values.shape}: must be (values,), not empty"
        )
    if values.dtype.kind not in "iuf" or not np.isfinite(values).all():
        raise InputError(f"parameters[{name!r}]: must be finite numbers")
    return values


def _maker(
    scenario: Experiment | Callable[..., Experiment | Problem], names: tuple[str, ...]
) -> Callable[..., Experiment | Problem]:
    if isinstance(scenario, Experiment):
        if not is_dataclass(scenario):
            raise InputError(
                f"scenario is a {type(scenario).__name__}: to replace its fields it must be a "
                "dataclass; or give a function of the parameters"
            )
        own = [f.name for f in fields(scenario)]
        for name in names:
            if name not in own:
                raise InputError(
                    f"parameters has {name!r}: the experiment's fields are {', '.join(own)}"
                )
        return lambda **point: replace(scenario, **point)
    if not callable(scenario):
        raise InputError(
            f"scenario is a {type(scenario).__name__}: must be an experiment, or a function of "
            "the parameters that returns one"
        )
    try:
        inspect.signature(scenario).bind(**dict.fromkeys(names))
    except TypeError as e:
        raise InputError(f"parameters: scenario cannot be called with them: {e}") from None
    except ValueError:  # a function of an extension that does not tell its arguments
        pass
    return scenario


def _value(result: MonteCarloResult, what: str) -> Any:
    if what in OF_STATES:
        value = getattr(result, what)
        if value is None:
            raise InputError(f"the runs have no {what}: the experiment has no problem")
        return value
    if what in ("used", "failed"):
        return getattr(result, what)
    if what == "nees":
        return result.nees.mean if result.nees else np.nan
    if what == "inside":
        return result.nees.inside if result.nees else np.nan
    if what in result.quantities:
        return result.quantities[what].mean
    known = (*OF_STATES, *OF_RUNS, *result.quantities)
    raise InputError(f"the runs have no {what!r}: there are {', '.join(known)}")
