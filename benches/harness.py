"""Contests: the same work by several contestants, interleaved in one run.

A bench module `bench_<part>.py` has one function, ``contests(quick)``, that yields
`Contest`s. `run.py` runs them all, each part in a fresh process; a module can also
be run alone:

    python benches/bench_spine.py [--quick]
"""

from __future__ import annotations

import ctypes
import gc
import importlib.util
import math
import os
import shutil
import statistics
import subprocess
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from limits import Gauge, Limit, Rates

HERE = Path(__file__).parent
OURS = "gramian"
ALL = os.cpu_count() or 1
#: Of the series that show the growth of time: fixed costs no longer show in the last.
SIZES = {"trials": (10, 100, 1000, 10_000, 100_000), "samples": (10, 100, 1000, 10_000)}

#: Set before numpy and its peers are imported, so that "one thread" is one.
ONE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "JAX_PLATFORMS": "cpu",
}


@dataclass
class Contestant:
    """One way to do the work.

    `prepare(data)` imports what is needed and returns a function that does the work
    once on this data. An exception in it is listed with its message instead of a time.

    `part` is for a contestant so slow that it is given only so many units of the
    work. `threads` is how many gramian may use. `limit` stands in for the contest's
    where another method is used. One that answers another question is not `asked`
    for its accuracy. `against` is which of ours it is compared with: the one that answers
    the same question.
    """

    name: str
    prepare: Callable[[Any], Callable[[], Any]]
    part: float | None = None
    threads: int = 1
    limit: Limit | None = None
    asked: bool = True
    against: str = OURS


@dataclass
class Case:
    """Data on which each contestant is asked for its relative error."""

    data: Any
    error: Callable[[Any], float]


@dataclass
class Contest:
    """The same `work` units on the same data by each contestant; ours is named `gramian`.

    `cases` are a well- and an ill-conditioned one, or more, against high-precision
    arithmetic.
    """

    name: str
    unit: str
    work: float
    data: Any
    contestants: Sequence[Contestant]
    limit: Limit | None = None
    cases: dict[str, Case] = field(default_factory=dict)
    size: float | None = None  # the size that a growth series varies
    series: str = ""  # contests of one series are drawn as time against size
    target: str = ""  # what was asked for, in words
    note: str = ""
    why: str = ""  # why others are faster, with the figure that shows it


@dataclass
class Footprint:
    """The memory that contestants take at the peak: `measure(name)` gives bytes."""

    name: str
    contestants: Sequence[str]
    measure: Callable[[str], float]
    note: str = ""
    target: str = ""

    def run(self) -> list[Row]:
        """Measure each once."""
        rows = []
        for name in self.contestants:
            row = Row(self.name, name, "call", 1, note=self.note, target=self.target)
            try:
                row.memory = self.measure(name)
            except Exception as error:  # listed, as in a contest
                row.message = told(error)
            rows.append(row)
        return rows


@dataclass
class Row:
    """The outcome of one contestant."""

    contest: str
    contestant: str
    unit: str
    threads: int
    part: str = ""
    work: float = 1.0  # units a call
    minimum: float | None = None  # seconds a unit
    median: float | None = None
    ratio: float | None = None  # median over that of `against`, of the same run
    against: str = OURS
    errors: dict[str, float | None] = field(default_factory=dict)
    operations: dict[str, float] = field(default_factory=dict)  # a unit, by kind
    count: str = ""  # where their numbers come from
    fraction: float | None = None  # of the limit
    rates: dict[str, float] = field(default_factory=dict)  # by kind, seen beside the contest
    limit: str = ""
    memory: float | None = None  # bytes at the peak beyond the inputs
    message: str = ""
    size: float | None = None
    series: str = ""
    target: str = ""
    note: str = ""
    why: str = ""


@cache
def guests() -> dict[str, Callable[[Contest], Iterable[Contestant]]]:
    """Return what joins from benches/contestants: a function `join` of each file, by its name."""
    found = {}
    for path in sorted((HERE / "contestants").glob("*.py")):
        spec = importlib.util.spec_from_file_location(f"contestants_{path.stem}", path)
        if spec is None or spec.loader is None:
            raise ImportError(f"{path} cannot be read")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        found[path.stem] = module.join
    return found


def joined(contest: Contest) -> list[Contestant]:
    """Return a contest's contestants, and those that join from benches/contestants."""
    return [*contest.contestants, *(one for join in guests().values() for one in join(contest))]


def told(error: Exception) -> str:
    """Return an error in one line."""
    return f"{type(error).__name__}: {error}".splitlines()[0]


@dataclass
class _Ready:
    contestant: Contestant
    work: Callable[[], Any]
    calls: int
    units: float
    times: list[float] = field(default_factory=list)

    def go(self) -> None:
        """Time enough calls that the clock's grain does not show."""
        start = time.perf_counter()
        for _ in range(self.calls):
            self.work()
        spent = time.perf_counter() - start
        self.times.append(spent / self.calls / self.units)


def sizes(of: str, *, quick: bool) -> list[int]:
    """Return the sizes of a series, three of them in a quick run."""
    return [size for size in SIZES[of] if not quick or 100 <= size <= 10_000]


def grown(contest: Callable[..., Contest], *, quick: bool) -> Iterator[Contest]:
    """Yield a contest against trials, of 50 samples, and against samples, in 100 trials."""
    for trials in sizes("trials", quick=quick):
        yield contest(trials, 50, peers=False, series="trials")
    for samples in sizes("samples", quick=quick):
        yield contest(100, samples, peers=False, series="samples")


def run(
    contest: Contest,
    *,
    rounds: int,
    limits: Rates,
    gauge: Gauge | None = None,
    seconds: float = 0.02,
    patience: float = 4.0,
) -> list[Row]:
    """Run a contest: each round times every contestant once, in turn.

    `gauge` takes its turn too, and its rates stand in for the `limits` then. `seconds` is
    how long each is timed in a round, `patience` what a slow one may take in all.
    """
    import gramian as gm

    contest = replace(contest, contestants=joined(contest))
    ready: list[_Ready] = []
    messages: dict[str, str] = {}
    rates: Rates = {}
    bound = {
        ("one" if one.threads == 1 else "all", kind)
        for one in contest.contestants
        if (limit := one.limit or contest.limit)
        for kind in limit.operations
    }
    before = gm.set_threads(1)
    try:
        for contestant in contest.contestants:
            try:
                gm.set_threads(contestant.threads)
                work = contestant.prepare(contest.data)
                work()  # warm: compiles, fills caches
                start = time.perf_counter()
                work()
                once = time.perf_counter() - start
            except Exception as error:  # a peer that fails is a result too
                messages[contestant.name] = told(error)
                continue
            calls = max(1, min(1000, int(seconds / max(once, 1e-7))))
            ready.append(_Ready(contestant, work, calls, contestant.part or contest.work))
        gc.collect()
        gc.disable()
        for _ in range(rounds):
            if gauge is not None and limits:
                gauge.once(rates, sorted(bound))
            for one in ready:
                if one.times and sum(one.times) * one.units * one.calls > patience:
                    continue  # slow ones need no more rounds
                if gm.set_threads(one.contestant.threads) != one.contestant.threads:
                    one.work()  # starts the threads
                one.go()
    finally:
        gc.enable()
        gm.set_threads(1)
        rows = _rows(contest, ready, messages, limits, rates)
        gm.set_threads(before)
    return rows


def _rows(
    contest: Contest,
    ready: Sequence[_Ready],
    messages: dict[str, str],
    limits: Rates,
    rates: Rates,
) -> list[Row]:
    measured = {one.contestant.name: one.times for one in ready if one.times}
    rows = []
    for contestant in contest.contestants:
        times = measured.get(contestant.name)
        row = Row(
            contest.name,
            contestant.name,
            contest.unit,
            contestant.threads,
            work=contestant.part or contest.work,
            message=messages.get(contestant.name, ""),
            size=contest.size,
            series=contest.series,
            target=contest.target if contestant.name == OURS else "",
            note=contest.note if contestant.name == OURS else "",
            why=contest.why if contestant.name == OURS else "",
            against=contestant.against,
        )
        if times:
            row.minimum, row.median = min(times), statistics.median(times)
            if ours := measured.get(contestant.against):
                row.ratio = row.median / statistics.median(ours)
            if limit := contestant.limit or contest.limit:
                row.operations, row.count = limit.operations, limit.count
                row.rates = rates.get("one" if row.threads == 1 else "all", {})
            if contestant.asked:
                row.errors = {case: _error(contestant, of) for case, of in contest.cases.items()}
        rows.append(row)
    against(rows, limits)
    return rows


def against(rows: Iterable[Row], limits: Rates) -> None:
    """Set each row's fraction of the limit: at its own rates, or at these if there are any."""
    from limits import Limit

    for row in rows:
        if limits and row.operations and row.minimum:
            rates = row.rates or limits["one" if row.threads == 1 else "all"]
            least, kind = Limit(row.operations, row.count).best(rates)
            row.fraction, row.limit = least / row.minimum, f"{kind}: {row.count}"


def impossible(rows: Iterable[Row]) -> list[Row]:
    """Return the rows that are faster than what binds them: their operations or rates are wrong."""
    return [row for row in rows if row.fraction and row.fraction > 1]


def _error(contestant: Contestant, case: Case) -> float:
    """Return the relative error on a case; infinite where no number comes out."""
    import numpy as np

    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            error = float(case.error(contestant.prepare(case.data)()))
    except Exception:  # it could not do the case at all
        return math.inf
    return error if math.isfinite(error) else math.inf


def seconds(value: float | None) -> str:
    """Return a time with a unit that suits it."""
    if value is None:
        return "-"
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e-9:.3g} ns"


def markdown(rows: Iterable[Row]) -> str:
    """Return the rows as Markdown tables, one for each contest."""
    contests: dict[str, list[Row]] = {}
    for row in rows:
        contests.setdefault(row.contest, []).append(row)
    return "".join(_table(name, of) for name, of in contests.items())


def _table(name: str, rows: Sequence[Row]) -> str:
    first = next((row for row in rows if row.contestant == OURS), rows[0])
    about = [f"Asked for: {first.target}."] * bool(first.target) + [first.note] * bool(first.note)
    if any(row.memory is not None for row in rows):
        text = f"\n### {name}\n\nMemory at the peak beyond the inputs. {' '.join(about)}\n\n"
        text += "| contestant | MiB | |\n|---|---|---|\n"
        for row in rows:
            size = "-" if row.memory is None else f"{row.memory / 2**20:.1f}"
            text += f"| {row.contestant} | {size} | {row.message} |\n"
        return text
    if all(row.message for row in rows):
        return f"\n### {name}\n\n" + "".join(f"{row.contestant}: {row.message}\n" for row in rows)
    cases = list(dict.fromkeys(case for row in rows for case in row.errors))
    limited = any(row.fraction for row in rows)
    threads = any(row.threads != 1 for row in rows)
    heads = ["contestant", *["threads"] * threads, "median", "minimum", "x ours"]
    heads += [f"error, {case}" for case in cases] + ["of the limit"] * limited
    text = f"\n### {name}\n\n{' '.join([f'Time for one {first.unit}.', *about])}\n"
    if first.limit:
        text += f"Bound by {first.limit}.\n"
    text += f"\n| {' | '.join(heads)} |\n|{'---|' * len(heads)}\n"
    for row in rows:
        cells = [row.contestant] + [str(row.threads)] * threads
        if row.message:
            message = row.message.replace("|", "\\|")
            cells += [f"not run: {message}"] + [""] * (len(heads) - len(cells) - 1)
        else:
            cells += [seconds(row.median), seconds(row.minimum)]
            to = "" if row.against == OURS else f" ({row.against})"
            cells.append(f"{row.ratio:.3g}{to}" if row.ratio else "")
            cells += [_digits(row.errors.get(case)) for case in cases]
            cells += [percent(row.fraction)] * limited
        text += f"| {' | '.join(cells)} |\n"
    return text


def percent(fraction: float | None) -> str:
    """Return a fraction of the limit in two digits."""
    if not fraction:
        return ""
    if fraction < 1e-3:
        return "<0.1%"
    return f"{100 * fraction:.{1 if fraction < 0.1 else 0}f}%"


def _digits(error: float | None) -> str:
    if error is None:
        return ""
    return "no digit" if error >= 1 else f"{error:.1g}"


@cache
def c_library(source: str, *flags: str) -> ctypes.CDLL:
    """Compile benches/c/<source> with gcc -O3 -march=native and load it."""
    if shutil.which("gcc") is None:
        raise RuntimeError("gcc is not installed")
    compiler = ["gcc", "-O3", "-march=native", "-fPIC", *flags, "-c", str(HERE / "c" / source)]
    with tempfile.TemporaryDirectory() as place:
        # Linked without the flags: with -ffast-math the library would set the
        # processor to flush small numbers to zero, for everyone in the process.
        made, library = f"{place}/made.o", f"{place}/made.so"
        for command in (
            [*compiler, "-o", made],
            ["gcc", "-shared", made, "-o", library, "-lm"],
        ):
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                raise RuntimeError(done.stderr.strip().splitlines()[0])
        return ctypes.CDLL(library)


FAST = ("-ffast-math", "-fopenmp-simd")


@dataclass(frozen=True)
class CFunction:
    """A C function that takes numpy arrays, integers as long, and floats."""

    function: Any

    def __call__(self, *arguments: Any) -> Any:
        return self.function(*map(_argument, arguments))

    def bound(self, *arguments: Any) -> Callable[[], Any]:
        """Return the call with its arguments made ready, for work of microseconds."""
        made = [_argument(value) for value in arguments]

        def call() -> Any:
            self.function(*made)
            return arguments  # which keeps the arrays

        return call


def c_function(source: str, name: str, *flags: str, result: Any = None) -> CFunction:
    """Return a function of benches/c/<source>."""
    function = getattr(c_library(source, *flags), name)
    function.restype = result
    return CFunction(function)


def _argument(value: Any) -> Any:
    if isinstance(value, int):
        return ctypes.c_long(value)
    return ctypes.c_double(value) if isinstance(value, float) else pointer(value)


def pointer(array: Any) -> ctypes.c_void_p:
    """Return the address of a numpy array for a C function."""
    if not (array.flags.c_contiguous and array.dtype == float):
        raise ValueError("C takes contiguous arrays of doubles")
    return ctypes.c_void_p(array.ctypes.data)


def main(contests: Callable[[bool], Iterator[Contest | Footprint]]) -> None:
    """Run one bench module alone and print its tables."""
    import sys

    from limits import Gauge, measure

    if any(os.environ.get(name) != value for name, value in ONE_THREAD.items()):
        # numpy is there already, with as many threads as it likes: anew.
        os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, **ONE_THREAD})
    quick = "--quick" in sys.argv
    only = [word for word in sys.argv[1:] if not word.startswith("-")]
    limits, gauge = measure(), Gauge()
    for contest in contests(quick):
        if not only or any(word in contest.name for word in only):
            if isinstance(contest, Footprint):
                rows = contest.run()
            else:
                rows = run(contest, rounds=3 if quick else 7, limits=limits, gauge=gauge)
            print(markdown(rows), flush=True)
