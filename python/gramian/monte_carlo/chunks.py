"""One chunk of trials: simulate, estimate, and what came of it."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian.exceptions import InputError
from gramian.monte_carlo.experiment import Estimates, Experiment, squared_over
from gramian.monte_carlo.statistics import LEAF, Moments, moments

__all__ = ["HEAD", "Chunk", "Failure", "Statistics", "Task", "chunk_size", "nees_marks"]

Array = NDArray[np.float64]
Table = NDArray[np.void]
Estimator = Callable[[Any], Any]

#: The trials whose rows are always kept, for pictures.
HEAD = 2048
#: Errors beyond this overflow when their fourth power is summed.
LARGEST = 1e75
#: Entries of the column `status` beside 0 (success) and the built-in estimators' own, > 0.
STATUS = {"raised": -1, "not finite": -2, "wrong shape": -3}
#: Bins of the NEES histogram, the last one for all above.
BINS = 48


@dataclass(frozen=True)
class Failure:
    """Trials that gave no number, of one kind.

    Attributes
    ----------
    kind : str
        "raised ValueError", "not finite", "wrong shape", "not converged", ...
    count : int
    first_trial : int
        The first of them.
    message : str
        The first traceback, or what was found.
    """

    kind: str
    count: int
    first_trial: int
    message: str

    def joined(self, other: Failure) -> Failure:
        """Return both as one; the message is that of the earlier trial."""
        early = min(self, other, key=lambda failure: failure.first_trial)
        return Failure(self.kind, self.count + other.count, early.first_trial, early.message)


def chunk_size(trials: int, cost: float | None) -> int:
    """Return how many trials a chunk has: by the run alone, never by the workers.

    Small enough for many chunks, so that workers share and little is lost; large
    enough to be worth a message between processes. `cost` is roughly what a trial
    takes in Rust, in seconds; None for a function in Python.
    """
    least, most, chunks = LEAF, 1024, 64
    if cost is not None:
        most = max(LEAF, min(32768, int(0.5 / cost)))
        least, chunks = min(2048, most), 32
    size = LEAF
    while size < least or (2 * size <= most and 2 * size * chunks <= trials):
        size *= 2
    return size


@dataclass(frozen=True, eq=False)
class Statistics:
    """What is kept of a chunk, or of many: no more for a million trials than for one."""

    errors: Moments | None
    scalars: Mapping[str, Moments]
    histogram: NDArray[np.int64] | None
    inside: int


@dataclass(frozen=True, eq=False)
class Chunk:
    """The outcome of the trials `first` to `first + trials - 1`."""

    first: int
    trials: int
    statistics: Statistics
    failures: tuple[Failure, ...]
    head: Table | None
    table: Table | None = field(repr=False)


@dataclass(frozen=True, eq=False)
class Task:
    """All that a worker must know to run any chunk."""

    experiment: Experiment
    seed: int
    estimator: str | Estimator | None
    quantities: Mapping[str, Callable[[Any], Any] | None]
    bound: Array | None
    edges: Array | None
    limit: float
    keep: bool

    @property
    def in_rust(self) -> bool:
        """Whether no function of the user's has a part in it."""
        return not (callable(self.estimator) or any(self.quantities.values()))

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The columns of the per-trial table."""
        columns: list[tuple[str, str]] = [("trial", "<i8"), ("status", "<i2")]
        if self.estimator is not None:
            columns += [(f"error_{name}", "<f8") for name in self.experiment.names]
            columns += [("nees", "<f8")]
        return np.dtype(columns + [(name, "<f8") for name in self.quantities])

    def empty(self, trials: int) -> Table:
        """Return a table of zeros."""
        return np.zeros(trials, dtype=self.dtype)

    def run(self, first: int, trials: int) -> Chunk:
        """Simulate and estimate `trials` trials from `first` on."""
        table = self.empty(trials)
        table["trial"] = np.arange(first, first + trials)
        notes = _Notes()
        measurements = None
        if callable(self.estimator) or any(self.quantities.values()):
            measurements = self.experiment.simulate(self.seed, first, trials)
            if len(measurements) != trials:
                raise InputError(
                    f"simulate returned {len(measurements)} trials: must be {trials}, as asked"
                )
        if isinstance(self.estimator, str):
            found = self.experiment.estimate(self.estimator, self.seed, first, trials)
            self._take(found, table, notes)
        elif self.estimator is not None:
            self._estimate(self.estimator, measurements, table, notes)
        for name, function in self.quantities.items():
            self._quantity(name, function, measurements, table, notes)
        return self.digest(table, tuple(notes.failures.values()))

    def digest(self, table: Table, failures: tuple[Failure, ...]) -> Chunk:
        """Return the chunk of a finished table, fresh or from a file."""
        first, trials = int(table["trial"][0]), len(table)
        errors = histogram = None
        inside = 0
        scalars = {}
        if self.estimator is not None:
            ok = table["status"] == 0
            columns = [table[f"error_{name}"] for name in self.experiment.names]
            errors = moments(np.stack(columns, axis=1), ok)
            nees = table["nees"]
            known = ok & np.isfinite(nees)
            scalars["nees"] = moments(nees[:, None], known)
            if self.edges is not None:
                place = np.searchsorted(self.edges[1:], nees[known], side="right")
                histogram = np.bincount(place, minlength=BINS + 1)
                inside = int((nees[known] <= self.limit).sum())
        for name in self.quantities:
            values = table[name]
            scalars[name] = moments(values[:, None], np.abs(values) <= LARGEST)
        return Chunk(
            first,
            trials,
            Statistics(errors, scalars, histogram, inside),
            failures,
            table[: max(0, HEAD - first)].copy() if first < HEAD else None,
            table if self.keep else None,
        )

    def _take(self, found: Estimates, table: Table, notes: _Notes) -> None:
        errors = np.asarray(found.errors)
        status = np.asarray(found.status)
        bad = status != 0
        lost = ~(np.abs(errors) <= LARGEST).all(axis=1) & ~bad
        for code in np.unique(status[bad]):
            kind = found.kinds.get(int(code), f"status {code}")
            notes.add(kind, table["trial"][status == code], f"the estimator says: {kind}")
        if lost.any():
            place = int(np.flatnonzero(lost)[0])
            notes.add("not finite", table["trial"][lost], f"the errors are {errors[place]}")
        table["status"] = np.where(lost, STATUS["not finite"], status)
        for i, name in enumerate(self.experiment.names):
            table[f"error_{name}"] = np.where(bad, np.nan, errors[:, i])
        nees = found.nees
        if nees is None:
            nees = np.full(len(table), np.nan)
            if self.bound is not None:
                nees[~bad & ~lost] = squared_over(errors[~bad & ~lost], self.bound)
        table["nees"] = np.where(bad, np.nan, nees)

    def _estimate(
        self, estimator: Estimator, measurements: Any, table: Table, notes: _Notes
    ) -> None:
        names = tuple(self.experiment.names)
        n = len(names)
        truth = np.asarray(self.experiment.truth, dtype=float)
        columns = [table[f"error_{name}"] for name in names]
        for i in range(len(table)):
            trial = int(table["trial"][i])
            for column in columns:
                column[i] = np.nan
            table["nees"][i] = np.nan
            try:
                state, covariance = _answer(estimator(measurements[i]), n)
            except _Unusable as refusal:
                notes.add(refusal.kind, [trial], str(refusal))
                table["status"][i] = STATUS[refusal.kind]
                continue
            except Exception as error:
                text = "".join(traceback.format_exception(error))
                notes.add(f"raised {type(error).__name__}", [trial], text)
                table["status"][i] = STATUS["raised"]
                continue
            error_vector = state - truth
            for column, value in zip(columns, error_vector, strict=True):
                column[i] = value
            try:
                table["nees"][i] = _nees(error_vector, covariance, self.bound)
            except _Unusable as refusal:
                notes.add(refusal.kind, [trial], str(refusal))

    def _quantity(
        self,
        name: str,
        function: Callable[[Any], Any] | None,
        measurements: Any,
        table: Table,
        notes: _Notes,
    ) -> None:
        values = table[name]
        if function is None:
            first = int(table["trial"][0])
            values[:] = self.experiment.quantity(name, self.seed, first, len(table))
        else:
            for i in range(len(table)):
                trial = int(table["trial"][i])
                values[i] = np.nan
                try:
                    value = np.asarray(function(measurements[i]), dtype=float)
                    if value.ndim:
                        kind = f"{name}: wrong shape"
                        notes.add(kind, [trial], f"{name} has shape {value.shape}: must be ()")
                        continue
                    values[i] = value
                except Exception as error:
                    text = "".join(traceback.format_exception(error))
                    notes.add(f"{name}: raised {type(error).__name__}", [trial], text)
                    continue
                if not abs(values[i]) <= LARGEST:
                    notes.add(f"{name}: not finite", [trial], f"{name} = {values[i]}")
            return
        if (bad := ~(np.abs(values) <= LARGEST)).any():
            place = int(np.flatnonzero(bad)[0])
            notes.add(f"{name}: not finite", table["trial"][bad], f"{name} = {values[place]}")


class _Notes:
    """The failures of a chunk, by kind."""

    def __init__(self) -> None:
        self.failures: dict[str, Failure] = {}

    def add(self, kind: str, trials: Sequence[int] | NDArray[Any], message: str) -> None:
        new = Failure(kind, len(trials), int(trials[0]), message)
        before = self.failures.get(kind)
        self.failures[kind] = before.joined(new) if before else new


class _Unusable(Exception):
    """Something that an estimator returned and that is no estimate."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


def _answer(returned: Any, n: int) -> tuple[Array, Array | None]:
    covariance = None
    if isinstance(returned, tuple) and len(returned) == 2 and np.ndim(returned[1]) == 2:
        returned, covariance = returned
    elif hasattr(returned, "covariance"):
        found = [a for a in ("state", "estimate", "x") if hasattr(returned, a)]
        if found:
            returned, covariance = getattr(returned, found[0]), returned.covariance
    wanted = f"must be ({n},), or a pair of that and a covariance ({n}, {n})"
    try:
        state = np.asarray(returned, dtype=float)
    except (TypeError, ValueError) as error:
        raise _Unusable(
            "wrong shape", f"the estimator returned {returned!r:.200}: {wanted}"
        ) from error
    if state.shape != (n,):
        raise _Unusable("wrong shape", f"the estimate has shape {state.shape}: {wanted}")
    if not (np.abs(state) <= LARGEST).all():
        raise _Unusable("not finite", f"the estimate is {state}: must be finite")
    if covariance is not None:
        covariance = np.asarray(covariance, dtype=float)
        if covariance.shape != (n, n):
            raise _Unusable("wrong shape", f"the covariance has shape {covariance.shape}: {wanted}")
    return state, covariance


def _nees(error: Array, covariance: Array | None, bound: Array | None) -> float:
    claimed = bound if covariance is None else covariance
    if claimed is None:
        return np.nan
    value = float(squared_over(error[None], claimed)[0])
    if np.isnan(value) and covariance is not None:
        raise _Unusable(
            "covariance not positive definite (no NEES)",
            f"the estimator claims the covariance\n{covariance}",
        )
    return value


def nees_marks(n: int) -> tuple[Array, float]:
    """Return the edges of the NEES histogram (its last bin is open) and the 95 % point."""
    from scipy.stats import chi2

    return np.linspace(0.0, float(chi2.ppf(0.999, n)), BINS + 1), float(chi2.ppf(0.95, n))
