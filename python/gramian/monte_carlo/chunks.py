"""One chunk of trials: simulate, estimate, and what came of it."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian._answers import Answer
from gramian._arrays import as_float_array
from gramian._compiled import TrialFunction
from gramian.exceptions import InputError
from gramian.monte_carlo.experiment import Estimates, Experiment, squared_over
from gramian.monte_carlo.statistics import LEAF, Moments, moments

__all__ = [
    "HEAD",
    "Chunk",
    "Failure",
    "Statistics",
    "Task",
    "TrialTable",
    "chunk_size",
    "nees_marks",
]

Array = NDArray[np.float64]
Table = NDArray[np.void]
Estimator = Callable[[Any], Any]

#: The largest chunk that may be asked for.
MOST = 2**24
#: The trials whose rows are always kept, for pictures.
HEAD = 2048
#: Errors beyond this overflow when their fourth power is summed.
LARGEST = 1e75
#: Entries of the column `status` beside 0 (success) and the estimators' own, > 0.
STATUS = {"raised": -1, "not finite": -2, "wrong shape": -3, "not numbers": -4, "returned": -5}
#: The largest number that a compiled function may return.
MOST_RETURNED = 2**15 - 1
#: What a trial of compiled functions takes, roughly, in seconds: it sets the size of chunks.
COMPILED = 1e-4
#: What the name of a column of errors begins with.
ERROR = "error_"
#: What is asked of an estimate.
FINITE = "must be finite"
#: Bins of the NEES histogram, the last one for all above.
BINS = 48


@dataclass(frozen=True, repr=False)
class Failure(Answer):
    """Trials that gave no number, of one kind.

    Attributes
    ----------
    kind : str
        "raised ValueError", "not finite", "wrong shape", "not converged", "returned 3", ...
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

    @property
    def gist(self) -> str:
        """What it said, in one line."""
        lines = [line.strip() for line in self.message.strip().splitlines()]
        _, raised, name = self.kind.rpartition("raised ")
        if raised:
            # The rest of a traceback is about where, and below may be more of the message.
            said = [i for i, line in enumerate(lines) if line.split(":")[0].endswith(name)]
            lines = lines[said[-1] if said else -1 :]
        return " ".join(lines)

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
        least, chunks = min(1024, most), 32
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


@dataclass(eq=False)
class TrialTable:
    """What came of the trials from `first` on, each with its place in every array.

    Attributes
    ----------
    status : ndarray of int, shape (trials,)
    errors : ndarray, shape (trials, n), or None
    nees : ndarray, shape (trials,), or None
    quantities : dict of str to ndarray, shape (trials,)
    """

    first: int
    status: NDArray[np.int16]
    errors: Array | None = None
    nees: Array | None = None
    quantities: dict[str, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, table: Table) -> TrialTable:
        """Return the columns of a table, as `table` writes them."""
        names = table.dtype.names or ()
        errors = [name for name in names if name.startswith(ERROR)]
        others = set(names) - {"trial", "status", "nees", *errors}
        return cls(
            int(table["trial"][0]),
            table["status"].copy(),
            np.stack([table[name] for name in errors], axis=1) if errors else None,
            table["nees"].copy() if errors else None,
            {name: table[name].copy() for name in names if name in others},
        )

    def table(self, dtype: np.dtype[np.void], most: int | None = None) -> Table:
        """Return the trials, or the first `most` of them, as a structured array."""
        status = self.status[:most]
        table = np.empty(len(status), dtype=dtype)
        columns: list[NDArray[Any]] = [self.first + np.arange(len(status)), status]
        if self.errors is not None and self.nees is not None:
            columns += [*self.errors[:most].T, self.nees[:most]]
        columns += [values[:most] for values in self.quantities.values()]
        for name, column in zip(dtype.names or (), columns, strict=True):
            table[name] = column
        return table


@dataclass(frozen=True, eq=False)
class Task:
    """All that a worker must know to run any chunk."""

    experiment: Experiment
    seed: int
    estimator: str | Estimator | TrialFunction | None
    quantities: Mapping[str, Callable[[Any], Any] | TrialFunction | None]
    bound: Array | None
    edges: Array | None
    limit: float
    keep: bool

    @property
    def in_rust(self) -> bool:
        """Whether no function in Python has a part in it, but for the experiment's own."""
        return not any(callable(part) for part in (self.estimator, *self.quantities.values()))

    @property
    def cost(self) -> float | None:
        """What a trial takes, roughly, in seconds; None where a function in Python says."""
        if not self.in_rust:
            return None
        parts = (self.estimator, *self.quantities.values())
        compiled = any(isinstance(part, TrialFunction) for part in parts)
        built_in = isinstance(self.estimator, str) or not compiled
        return max(compiled * COMPILED, built_in * self.experiment.cost)

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The columns of the per-trial table."""
        columns: list[tuple[str, str]] = [("trial", "<i8"), ("status", "<i2")]
        if self.estimator is not None:
            columns += [(f"{ERROR}{name}", "<f8") for name in self.experiment.names]
            columns += [("nees", "<f8")]
        return np.dtype(columns + [(name, "<f8") for name in self.quantities])

    def run(self, first: int, trials: int) -> Chunk:
        """Simulate and estimate `trials` trials from `first` on."""
        rows, notes = TrialTable(first, np.zeros(trials, dtype=np.int16)), _Notes()
        measurements = None
        parts = (self.estimator, *self.quantities.values())
        if any(callable(part) or isinstance(part, TrialFunction) for part in parts):
            measurements = self.experiment.simulate(self.seed, first, trials)
            if len(measurements) != trials:
                raise InputError(
                    f"simulate returned {len(measurements)} trials: must be {trials}, as asked"
                )
        if isinstance(self.estimator, str):
            found = self.experiment.estimate(self.estimator, self.seed, first, trials)
            self._take(found, rows, notes)
        elif isinstance(self.estimator, TrialFunction):
            self._called(self.estimator, measurements, rows, notes)
        elif self.estimator is not None:
            self._estimate(self.estimator, measurements, rows, notes)
        for name, function in self.quantities.items():
            self._quantity(name, function, measurements, rows, notes)
        return self.digest(rows, tuple(notes.failures.values()))

    def digest(self, rows: TrialTable, failures: tuple[Failure, ...]) -> Chunk:
        """Return the chunk of finished rows, fresh or from a file."""
        errors = histogram = None
        inside = 0
        scalars = {}
        if rows.errors is not None and rows.nees is not None:
            ok = rows.status == 0
            errors = moments(rows.errors, ok)
            known = ok & np.isfinite(rows.nees)
            scalars["nees"] = moments(rows.nees[:, None], known)
            if self.edges is not None:
                nees = rows.nees[known]
                place = np.searchsorted(self.edges[1:], nees, side="right")
                histogram = np.bincount(place, minlength=BINS + 1)
                inside = int((nees <= self.limit).sum())
        for name, values in rows.quantities.items():
            scalars[name] = moments(values[:, None], np.abs(values) <= LARGEST)
        return Chunk(
            rows.first,
            len(rows.status),
            Statistics(errors, scalars, histogram, inside),
            failures,
            rows.table(self.dtype, HEAD - rows.first) if rows.first < HEAD else None,
            rows.table(self.dtype) if self.keep else None,
        )

    def _take(self, found: Estimates, rows: TrialTable, notes: _Notes) -> None:
        trials, n = len(rows.status), len(self.experiment.names)
        if not isinstance(found, Estimates):
            raise InputError(f"estimate returned a {type(found).__name__}: must be Estimates")
        for name, shape in {"errors": (trials, n), "status": (trials,), "nees": (trials,)}.items():
            value = getattr(found, name)
            if np.shape(value) != shape and not (name == "nees" and value is None):
                raise InputError(f"estimate returned {name} {np.shape(value)}: must be {shape}")
        if not (np.abs(found.status) < 2**15).all():
            raise InputError("estimate returned a status of 32768 or more: must be less")
        # Copies: they are written to.
        errors = np.array(found.errors, dtype=float, order="C")
        status = np.array(found.status, dtype=np.int16)
        bad = status != 0
        good = np.abs(errors) <= LARGEST
        lost = np.zeros_like(bad) if good.all() else ~good.all(axis=1) & ~bad
        for code in np.unique(status[bad]):
            kind = found.kinds.get(int(code), f"status {code}")
            notes.add(kind, rows.first, status == code, f"the estimator says: {kind}")
        if lost.any():
            place = int(np.flatnonzero(lost)[0])
            notes.add("not finite", rows.first, lost, f"the errors are {errors[place]}")
            status[lost] = STATUS["not finite"]
        if found.nees is not None:
            nees = np.array(found.nees, dtype=float)
        else:
            nees = np.full(trials, np.nan)
            if self.bound is not None:
                nees[status == 0] = squared_over(errors[status == 0], self.bound)
        errors[bad] = nees[bad] = np.nan
        rows.status, rows.errors, rows.nees = status, errors, nees

    def _estimate(
        self, estimator: Estimator, measurements: Any, rows: TrialTable, notes: _Notes
    ) -> None:
        truth = np.asarray(self.experiment.truth, dtype=float)
        trials, n = len(rows.status), len(truth)
        errors = rows.errors = np.full((trials, n), np.nan)
        covariances: dict[int, Array] = {}
        for i in range(trials):
            trial = rows.first + i
            try:
                state, covariance = _answer(estimator(measurements[i]), n)
            except _Unusable as refusal:
                notes.add_one(refusal.kind, trial, str(refusal))
                rows.status[i] = STATUS[refusal.kind]
                continue
            except (Exception, SystemExit) as error:
                text = "".join(traceback.format_exception(error))
                notes.add_one(f"raised {type(error).__name__}", trial, text)
                rows.status[i] = STATUS["raised"]
                continue
            errors[i] = state - truth
            if covariance is not None:
                covariances[i] = covariance
        claiming = np.zeros(trials, dtype=bool)
        claiming[list(covariances)] = True
        claims = np.stack(list(covariances.values())) if covariances else None
        rows.nees = self._nees(errors, rows, claiming, claims, notes)

    def _called(
        self, estimator: TrialFunction, measurements: Any, rows: TrialTable, notes: _Notes
    ) -> None:
        """Estimate by a compiled function."""
        returned, states, claims = estimator.records(_records(measurements))
        status = rows.status = _status(returned)
        for kind, message, which in _refusals(returned):
            notes.add(kind, rows.first, which, f"the estimator {message}")
        lost = (returned == 0) & ~(np.abs(states) <= LARGEST).all(axis=1)
        if lost.any():
            place = int(np.flatnonzero(lost)[0])
            notes.add("not finite", rows.first, lost, f"the estimate is {states[place]}: {FINITE}")
            status[lost] = STATUS["not finite"]
        rows.errors = states - np.asarray(self.experiment.truth, dtype=float)
        rows.errors[status != 0] = np.nan
        claiming = (status == 0) & (claims is not None)
        rows.nees = self._nees(
            rows.errors, rows, claiming, None if claims is None else claims[claiming], notes
        )

    def _nees(
        self,
        errors: Array,
        rows: TrialTable,
        claiming: NDArray[np.bool_],
        claims: Array | None,
        notes: _Notes,
    ) -> Array:
        """Return the squared errors over the covariances claimed, or else over the bound.

        `claims` are those of the trials that are `claiming`.
        """
        trials = len(rows.status)
        nees = np.full(trials, np.nan)
        if self.bound is not None and (held := (rows.status == 0) & ~claiming).any():
            nees[held] = squared_over(errors[held], self.bound)
        if claims is None or not len(claims):
            return nees
        with np.errstate(invalid="ignore", over="ignore"):
            size = np.sqrt(np.abs(np.diagonal(claims, axis1=1, axis2=2)))
            # A filter's covariance may be a little uneven by rounding.
            most = 1e-6 * size[:, :, None] * size[:, None, :]
            slanted = (np.abs(claims - np.swapaxes(claims, 1, 2)) > most).any(axis=(1, 2))
            squares = squared_over(errors[claiming], claims)
        for kind, wrong in {
            "covariance not symmetric (no NEES)": slanted,
            "covariance not positive definite (no NEES)": np.isnan(squares) & ~slanted,
        }.items():
            if wrong.any():
                which = np.zeros(trials, dtype=bool)
                which[claiming] = wrong
                message = f"the estimator claims the covariance\n{claims[wrong][0]}"
                notes.add(kind, rows.first, which, message)
        nees[claiming] = np.where(slanted, np.nan, squares)
        return nees

    def _quantity(
        self,
        name: str,
        function: Callable[[Any], Any] | TrialFunction | None,
        measurements: Any,
        rows: TrialTable,
        notes: _Notes,
    ) -> None:
        trials = len(rows.status)
        if not callable(function):
            if function is None:
                values = np.asarray(
                    self.experiment.quantity(name, self.seed, rows.first, trials), dtype=float
                )
                if values.shape != (trials,):
                    raise InputError(f"quantity returned {values.shape}: must be ({trials},)")
                there = np.ones(trials, dtype=bool)
            else:
                returned, found, _ = function.records(_records(measurements))
                there = returned == 0
                values = np.where(there, found[:, 0], np.nan)
                for kind, message, which in _refusals(returned):
                    notes.add(f"{name}: {kind}", rows.first, which, f"{name} {message}")
            rows.quantities[name] = values
            if (lost := there & ~(np.abs(values) <= LARGEST)).any():
                place = int(np.flatnonzero(lost)[0])
                notes.add(f"{name}: not finite", rows.first, lost, f"{name} = {values[place]}")
            return
        values = rows.quantities[name] = np.full(trials, np.nan)
        for i in range(trials):
            trial = rows.first + i
            try:
                value = _numbers(function(measurements[i]), f"{name} is", 0)
                if value.ndim:
                    kind = f"{name}: wrong shape"
                    notes.add_one(kind, trial, f"{name} has shape {value.shape}: must be ()")
                    continue
                values[i] = value
            except _Unusable as refusal:
                notes.add_one(f"{name}: {refusal.kind}", trial, str(refusal))
                continue
            except (Exception, SystemExit) as error:
                text = "".join(traceback.format_exception(error))
                notes.add_one(f"{name}: raised {type(error).__name__}", trial, text)
                continue
            if not abs(values[i]) <= LARGEST:
                notes.add_one(f"{name}: not finite", trial, f"{name} = {values[i]}")


def _records(measurements: Any) -> Array:
    """Return the measurements as a compiled function takes them: numbers, (trials, ...)."""
    return np.ascontiguousarray(as_float_array(measurements, "measurements"))


def _status(returned: NDArray[np.int64]) -> NDArray[np.int16]:
    """Return what compiled functions returned as the column of the table."""
    fits = (returned >= 0) & (returned <= MOST_RETURNED)
    return np.where(fits, returned, STATUS["returned"]).astype(np.int16)


def _refusals(returned: NDArray[np.int64]) -> Iterator[tuple[str, str, NDArray[np.bool_]]]:
    """Yield kind, message and trials of each number that is not 0."""
    status = _status(returned)
    for code in np.unique(status[status != 0]):
        which = status == code
        first = returned[which][0]
        if code > 0:
            yield f"returned {code}", f"returned {code}: 0 is for success", which
        else:
            wanted = f"must be 0 for success, or 1 to {MOST_RETURNED}"
            yield "returned no status", f"returned {first}: {wanted}", which


class _Notes:
    """The failures of a chunk, by kind."""

    def __init__(self) -> None:
        self.failures: dict[str, Failure] = {}

    def add(self, kind: str, first: int, which: NDArray[np.bool_], message: str) -> None:
        """Note some of the trials from `first` on."""
        places = np.flatnonzero(which)
        self._join(Failure(kind, len(places), first + int(places[0]), message))

    def add_one(self, kind: str, trial: int, message: str) -> None:
        """Note a trial."""
        self._join(Failure(kind, 1, trial, message))

    def _join(self, new: Failure) -> None:
        before = self.failures.get(new.kind)
        self.failures[new.kind] = before.joined(new) if before else new


class _Unusable(Exception):
    """Something that an estimator returned and that is no estimate."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


def _answer(returned: Any, n: int) -> tuple[Array, Array | None]:
    covariance = None
    if isinstance(returned, (tuple, list)) and len(returned) == 2 and _axes(returned[1]) == 2:
        returned, covariance = returned
    elif hasattr(returned, "covariance"):
        found = [a for a in ("state", "estimate", "x") if hasattr(returned, a)]
        if found:
            returned, covariance = getattr(returned, found[0]), returned.covariance
    state = _numbers(returned, "the estimator returned", n)
    if state.shape != (n,):
        raise _Unusable("wrong shape", f"the estimate has shape {state.shape}: {_wanted(n)}")
    if not (np.abs(state) <= LARGEST).all():
        raise _Unusable("not finite", f"the estimate is {state}: {FINITE}")
    if covariance is not None:
        covariance = _numbers(covariance, "the covariance is", n)
        if covariance.shape != (n, n):
            raise _Unusable(
                "wrong shape", f"the covariance has shape {covariance.shape}: {_wanted(n)}"
            )
    return state, covariance


def _wanted(n: int) -> str:
    return f"must be ({n},), or a pair of that and a covariance ({n}, {n})" if n else "must be ()"


def _axes(value: Any) -> int:
    try:
        return int(np.ndim(value))
    except ValueError:
        return -1


def _numbers(value: Any, what: str, n: int) -> Array:
    """Return real numbers, the masked ones NaN; anything else is not taken for some."""
    try:
        if value is None or np.iscomplexobj(value):
            raise TypeError
        masked = np.ma.getmaskarray(value) if isinstance(value, np.ma.MaskedArray) else None
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise _Unusable("not numbers", f"{what} {value!r:.200}: {_wanted(n)}") from error
    return array if masked is None else np.where(masked, np.nan, array)


def nees_marks(n: int) -> tuple[Array, float]:
    """Return the edges of the NEES histogram (its last bin is open) and the 95 % point."""
    from scipy.special import chdtri

    return np.linspace(0.0, float(chdtri(n, 0.001)), BINS + 1), float(chdtri(n, 0.05))
