"""`run`: one call that checks an estimator against its bound."""

from __future__ import annotations

import operator
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from typing import Any

import numpy as np

from gramian import _options as options
from gramian._compiled import TrialFunction, is_compiled
from gramian.exceptions import InputError
from gramian.model import Model
from gramian.monte_carlo.chunks import (
    ERROR,
    MOST,
    Chunk,
    Estimator,
    Failure,
    Statistics,
    Task,
    TrialTable,
    chunk_size,
    nees_marks,
)
from gramian.monte_carlo.execute import execute
from gramian.monte_carlo.experiment import Experiment, as_experiment, bound_of, fingerprint
from gramian.monte_carlo.result import MonteCarloResult
from gramian.monte_carlo.resume import Manifest, Store, kept_chunk_size
from gramian.monte_carlo.statistics import LEAF, Tree
from gramian.problem import Problem

__all__ = ["run", "unobservable"]

Quantities = Iterable[str] | Mapping[str, Callable[[Any], Any]]

#: Weeks of work of the fastest estimator there is.
MOST_TRIALS = 2**44


def run(
    problem: Experiment | Problem | Model,
    trials: int,
    seed: int,
    estimator: str | Estimator | None = None,
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: bool = True,
    resume: str | os.PathLike[str] | None = None,
    quantities: Quantities | None = None,
    table: bool = False,
    chunk: int | None = None,
) -> MonteCarloResult:
    """Simulate an experiment many times and set an estimator's errors beside the bound.

    Parameters
    ----------
    problem : Experiment, Problem or Model
        What is simulated: a built-in experiment (`Bearings`, `Dipole`,
        `Registration`), a model of your own measurement function (`Measurements`), a
        class of yours derived from `Experiment`, or a `gramian.Problem`, whose linear
        experiment is run.
    trials : int
        >= 1.
    seed : int
        0 to 2^64 - 1. Trial i depends on (seed, i) alone.
    estimator : str or callable, optional
        The name of a built-in estimator of the experiment (the first by default),
        which runs wholly in Rust; or a function of one trial's measurements that
        returns the estimate (n,), or a pair of that and its covariance (n, n).
        By default none where `quantities` are asked for. Or a compiled function
        (``numba.cfunc``, ``scipy.LowLevelCallable``, ``ctypes``), called without the
        interpreter, from several threads at once: see Notes.
    workers : int, optional
        Processes for an estimator or quantity in Python, threads for what runs in
        Rust or is compiled. By default Python runs in this process and Rust on as
        many threads as the work is worth.
    executor : concurrent.futures.Executor, optional
        Where chunks run instead: a process pool, or ``Client.get_executor()`` of
        Dask for many machines.
    progress : bool
        Show a progress bar, on a terminal.
    resume : path, optional
        A directory that keeps every finished chunk in Parquet. The same call goes
        on where the last one stopped, also with more trials.
    quantities : iterable of str, or mapping of str to callable, optional
        Numbers to average besides: names of the experiment's own, or functions
        of one trial's measurements, in Python or compiled.
    table : bool
        Keep the row of every trial in memory; without it, memory stays the same
        for any number of trials.
    chunk : int, optional
        Trials in a chunk, 16 times a power of two. The result does not depend on it.

    Returns
    -------
    MonteCarloResult

    Raises
    ------
    InputError
        Trials or seed out of range, an estimator or quantity that is not there,
        an executor that is shut down, a resume path that cannot be used or is of
        another run.
    UnobservableError
        A built-in estimator where the states are not observable.
    StorageError
        A chunk cannot be written; those before are whole.
    WorkerError
        Worker processes that keep dying.

    Notes
    -----
    The numbers are the same, bit for bit, for any number of threads, workers and
    chunks, and for a run that was stopped and resumed: every trial has its own
    stream of random numbers, and sums are taken along one binary tree over the
    trials. A trial that fails is counted by kind, with the first traceback, and
    is in no average. A killed worker's chunks are run again.

    A compiled estimator is ``void f(double *z, double *x)``: z are the measurements of a
    trial as `simulate` of the experiment gives them, in C order, in which it may work; it
    writes the estimate (n,) to x. With a third ``double *`` it writes the covariance (n, n)
    there. It may return ``int``: 0 for an estimate, another number k for none, which counts as
    "returned k"; what is NaN, or not written, is "not finite". A compiled quantity writes one
    number to x. None of them may keep anything between calls. `simulate` of an experiment of
    your own is called from several threads at once beside them.

    Examples
    --------
    >>> import gramian as gm
    >>> line = gm.Problem([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]], ["level", "slope"])
    >>> result = gm.monte_carlo.run(line, 20_000, seed=1)
    >>> bool((abs(result.efficiency - 1) < 0.02).all())
    True
    """
    started = time.perf_counter()
    trials, seed = _integer(trials, "trials", 1, MOST_TRIALS), _integer(seed, "seed", 0, 2**64 - 1)
    if workers is not None:
        workers = _integer(workers, "workers", 1, 10_000)
    _check_executor(executor, workers)
    experiment = as_experiment(problem)
    wanted = _quantities(experiment, quantities)
    chosen = _estimator(experiment, estimator, bool(wanted))
    bound_std = bound = None
    if chosen is not None:
        bound_std, bound = bound_of(experiment, must_exist=isinstance(chosen, str))
    edges, limit = nees_marks(len(experiment.names)) if chosen is not None else (None, np.nan)
    task = Task(
        experiment,
        seed,
        chosen,
        wanted,
        bound,
        edges,
        limit,
        keep=table or resume is not None,
    )
    if chunk is not None:
        size = _chunk(chunk)
    else:
        # A run that is resumed keeps its chunks, also when it is made longer.
        size = kept_chunk_size(resume) or chunk_size(trials, task.cost)
    total = _Total(table)
    store = None
    if resume is not None:
        store = Store(resume, _manifest(task, size))
    try:
        with _progress(trials, options.flag(progress, "progress")) as advance:
            _collect(task, trials, size, store, total, advance, workers, executor)
    except KeyboardInterrupt as stop:
        kept = f"; kept in {store.path}" if store else ""
        stop.add_note(f"stopped after {total.trials} of {trials} trials{kept}")
        raise
    finally:
        if store is not None:
            store.close()
    return MonteCarloResult.of(
        experiment,
        seed=seed,
        estimator=chosen,
        bound=bound_std,
        bound_covariance=bound,
        statistics=total.statistics(),
        edges=edges,
        failures=tuple(sorted(total.failures.values(), key=lambda f: (-f.count, f.kind))),
        trials=trials,
        sample=total.sample(),
        table=np.concatenate(total.tables) if table else None,
        seconds=time.perf_counter() - started,
        simulated=total.simulated,
    )


class _Total:
    """All chunks so far, merged in the order of their trials."""

    def __init__(self, table: bool) -> None:
        self.next = 0
        self.trials = 0
        self.simulated = 0
        self.failures: dict[str, Failure] = {}
        self.heads: list[Any] = []
        self.tables: list[Any] = []
        self._keep_table = table
        self._early: dict[int, Chunk] = {}
        self._errors: Tree | None = None
        self._scalars: dict[str, Tree] = {}
        self._histogram: Any = None
        self._inside = 0

    def add(self, chunk: Chunk, fresh: bool) -> None:
        self.trials += chunk.trials
        self.simulated += chunk.trials if fresh else 0
        self._early[chunk.first] = chunk
        while self.next in self._early:
            due = self._early.pop(self.next)
            self.next += due.trials
            self._merge(due)

    def _merge(self, chunk: Chunk) -> None:
        part = chunk.statistics
        if part.errors is not None:
            self._errors = self._errors or Tree()
            self._errors.add(part.errors)
        for name, node in part.scalars.items():
            self._scalars.setdefault(name, Tree()).add(node)
        if part.histogram is not None:
            self._histogram = part.histogram + (0 if self._histogram is None else self._histogram)
        self._inside += part.inside
        for failure in chunk.failures:
            before = self.failures.get(failure.kind)
            self.failures[failure.kind] = before.joined(failure) if before else failure
        if chunk.head is not None:
            self.heads.append(chunk.head)
        if self._keep_table:
            self.tables.append(chunk.table)

    def statistics(self) -> Statistics:
        return Statistics(
            self._errors.total() if self._errors else None,
            {name: tree.total() for name, tree in self._scalars.items()},
            self._histogram,
            self._inside,
        )

    def sample(self) -> Any:
        return np.concatenate(self.heads)


def _collect(
    task: Task,
    trials: int,
    size: int,
    store: Store | None,
    total: _Total,
    advance: Callable[[int], None],
    workers: int | None,
    executor: Executor | None,
) -> None:
    def missing() -> Iterator[tuple[int, int]]:
        for first in starts:
            count = min(size, trials - first)
            found = store.read(first, count, task.dtype) if store else None
            if found is None:
                yield first, count
            else:
                table, failures = found
                total.add(task.digest(TrialTable.of(table), failures), fresh=False)
                advance(count)

    starts = range(0, trials, size)
    with closing(execute(task, missing(), len(starts), workers, executor)) as chunks:
        for chunk in chunks:
            if store is not None and chunk.table is not None:
                store.write(chunk.first, chunk.table, chunk.failures)
            total.add(chunk, fresh=True)
            advance(chunk.trials)


def _manifest(task: Task, size: int) -> Manifest:
    from gramian._core import __version__

    return Manifest(
        scenario=fingerprint(task.experiment),
        estimator=fingerprint(task.estimator),
        quantities=fingerprint(task.quantities),
        seed=task.seed,
        chunk=size,
        version=__version__,
    )


@contextmanager
def _progress(trials: int, wanted: bool) -> Iterator[Callable[[int], None]]:
    """Show a bar with trials a second and time left; nothing where no one looks."""
    if not (wanted and sys.stderr.isatty()):
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Task as Bar
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Bar) -> Text:
            speed = task.finished_speed or task.speed
            return Text("" if speed is None else f"{speed:,.0f} trials/s")

    columns = [
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:,} of {task.total:,}"),
        Rate(),
        TimeRemainingColumn(),
    ]
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        bar = bars.add_task("Monte Carlo", total=trials)
        yield lambda count: bars.advance(bar, count)


def _integer(value: Any, name: str, least: int, most: int) -> int:
    try:
        number = operator.index(value)
    except TypeError:
        number = None
    if number is None or isinstance(value, (bool, np.bool_)):
        raise InputError(f"{name} = {value!r}: must be a whole number")
    if not least <= number <= most:
        limits = f"must be >= {least}" if number < least else f"must be <= {most}"
        raise InputError(f"{name} = {value!r}: {limits}")
    return number


def _chunk(value: int) -> int:
    size = _integer(value, "chunk", LEAF, MOST)
    if size & (size - 1):
        raise InputError(f"chunk = {size}: must be a power of two, {LEAF} or more")
    return size


def _check_executor(executor: Any, workers: int | None) -> None:
    if executor is None:
        return
    if workers is not None:
        raise InputError("workers and executor were both given: must be one of them")
    if not isinstance(executor, Executor):
        hint = ": pass its get_executor()" if hasattr(executor, "get_executor") else ""
        raise InputError(
            f"executor is a {type(executor).__name__}{hint}: must be a concurrent.futures.Executor"
        )


def _quantities(
    experiment: Experiment, given: Quantities | None
) -> dict[str, Callable[[Any], Any] | TrialFunction | None]:
    if given is None:
        return {}
    if isinstance(given, str):
        given = (given,)
    if not isinstance(given, Iterable):
        raise InputError(
            f"quantities = {given!r}: must be names of the experiment's own, or a mapping of name "
            "to function"
        )
    wanted: dict[str, Callable[[Any], Any] | TrialFunction | None] = (
        dict(given) if isinstance(given, Mapping) else dict.fromkeys(given)
    )
    for name, function in wanted.items():
        if function is not None and not isinstance(name, str):
            raise InputError(f"quantities has the name {name!r}: must be a text")
        if name in ("trial", "status", "nees") or str(name).startswith(ERROR):
            raise InputError(f"quantities has {name!r}: that is a column of every run")
        if function is None and name not in experiment.quantities:
            own = ", ".join(experiment.quantities) or "none"
            raise InputError(
                f"quantities has {name!r}: the experiment's own are {own}; "
                "others go in a mapping of name to function"
            )
        if is_compiled(function):
            wanted[name] = TrialFunction.quantity(function, name)
        elif function is not None and not callable(function):
            raise InputError(f"quantities[{name!r}] = {function!r}: must be a function")
    return wanted


def _estimator(
    experiment: Experiment, given: str | Estimator | None, quantities: bool
) -> str | Estimator | TrialFunction | None:
    if given is None:
        if quantities:
            return None
        if not experiment.estimators:
            raise InputError(
                f"estimator is missing: a {type(experiment).__name__} has no built-in one; give a "
                "function of one trial's measurements"
            )
        return experiment.estimators[0]
    if isinstance(given, str):
        if given not in experiment.estimators:
            own = ", ".join(experiment.estimators) or "none"
            raise InputError(f"estimator = {given!r}: the experiment's own are {own}")
        return given
    if is_compiled(given):
        return TrialFunction.estimator(given, len(experiment.names))
    if not callable(given):
        raise InputError(f"estimator is a {type(given).__name__}: must be a name or a function")
    return given


def unobservable(
    problem: Experiment | Problem, trials: int, seed: int, estimator: str | None, reason: str
) -> MonteCarloResult:
    """Return the result of a run that no built-in estimator can make: no estimate at all."""
    experiment = as_experiment(problem)
    chosen = estimator or experiment.estimators[0]
    bound, covariance = bound_of(experiment)
    return MonteCarloResult.of(
        experiment,
        seed=seed,
        estimator=chosen,
        bound=bound,
        bound_covariance=covariance,
        statistics=Statistics(None, {}, None, 0),
        edges=None,
        failures=(Failure("unobservable", trials, 0, reason),),
        trials=trials,
        sample=np.zeros(0, Task(experiment, seed, chosen, {}, None, None, np.nan, False).dtype),
        table=None,
        seconds=0.0,
        simulated=0,
    )
