"""Contests: the same work by several contestants, interleaved in one run.

A bench module `bench_<part>.py` has one function, ``contests(quick)``, that yields
`Contest`s. `run.py` runs them all; each module can also be run alone:

    python benches/bench_spine.py [--quick]
"""

from __future__ import annotations

import ctypes
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
OURS = "gramian"


@dataclass
class Contestant:
    """One way to do the work.

    `prepare()` imports what is needed, makes the inputs and returns a function that
    does the work once; what it returns is handed to the contest's `error`. An
    exception in it is listed with its message instead of a time.

    `work` is for a contestant so slow that it is given only a part of the work.
    """

    name: str
    prepare: Callable[[], Callable[[], Any]]
    work: float | None = None


@dataclass
class Limit:
    """What binds a kernel: operations a unit of work, at the rate of `kind`.

    kind: "fma" (vector multiply-adds, in lanes), "sincos" (sine and cosine of one
    angle), "memory" (bytes), as measured by `limits.py` in the same run.
    """

    kind: str
    operations: float
    count: str  # where the number comes from, in words


@dataclass
class Contest:
    """The same `work` units by each contestant; ours is named `gramian`.

    `error` gives the relative error of what a contestant returned, against
    high-precision arithmetic; `accuracy` names further cases: (well- and
    ill-conditioned), each a function of the contestant's name, None where unknown.
    """

    name: str
    unit: str
    work: float
    contestants: Sequence[Contestant]
    limit: Limit | None = None
    error: Callable[[Any], float] | None = None
    accuracy: dict[str, Callable[[str], float | None]] = field(default_factory=dict)
    threads: int = 1
    size: float | None = None  # the size that a growth series varies
    series: str = ""  # contests of one series are drawn as time against size
    target: str = ""  # what was asked for, in words


@dataclass
class Row:
    """The outcome of one contestant."""

    contest: str
    contestant: str
    unit: str
    threads: int
    minimum: float | None  # seconds a unit
    median: float | None
    ratio: float | None  # median over ours, of the same run
    error: float | None = None
    accuracy: dict[str, float | None] = field(default_factory=dict)
    fraction: float | None = None  # of the limit
    limit: str = ""
    message: str = ""
    size: float | None = None
    series: str = ""
    target: str = ""


def run(contest: Contest, *, rounds: int, limits: dict[str, float] | None = None) -> list[Row]:
    """Run a contest: each round times every contestant once, in turn."""
    import gramian as gm

    before = gm.set_threads(contest.threads)
    try:
        ready: list[tuple[Contestant, Callable[[], Any], int]] = []
        messages: dict[str, str] = {}
        results: dict[str, Any] = {}
        for contestant in contest.contestants:
            try:
                work = contestant.prepare()
                results[contestant.name] = work()  # warm: compiles, fills caches
                start = time.perf_counter()
                work()
                once = time.perf_counter() - start
            except Exception as error:  # a peer that fails is a result too
                messages[contestant.name] = f"{type(error).__name__}: {error}".splitlines()[0]
                continue
            # Enough calls a round that the clock's grain and call cost do not show.
            ready.append((contestant, work, max(1, min(1000, int(0.02 / max(once, 1e-7))))))
        times: dict[str, list[float]] = {c.name: [] for c, _, _ in ready}
        for _ in range(rounds):
            for contestant, work, calls in ready:
                if (
                    times[contestant.name]
                    and times[contestant.name][0]
                    * len(times[contestant.name])
                    * (contestant.work or contest.work)
                    > 5.0
                ):
                    continue  # slow ones need no more rounds
                start = time.perf_counter()
                for _ in range(calls):
                    work()
                spent = (time.perf_counter() - start) / calls
                times[contestant.name].append(spent / (contestant.work or contest.work))
    finally:
        gm.set_threads(before)
    ours = statistics.median(times[OURS]) if times.get(OURS) else None
    rows = []
    for contestant in contest.contestants:
        name = contestant.name
        measured = times.get(name)
        row = Row(
            contest.name,
            name,
            contest.unit,
            contest.threads,
            min(measured) if measured else None,
            statistics.median(measured) if measured else None,
            statistics.median(measured) / ours if measured and ours else None,
            message=messages.get(name, ""),
            size=contest.size,
            series=contest.series,
            target=contest.target if name == OURS else "",
        )
        if measured:
            if contest.error is not None:
                row.error = float(contest.error(results[name]))
            row.accuracy = {case: of(name) for case, of in contest.accuracy.items()}
            if contest.limit and limits and row.minimum:
                best = contest.limit.operations / (limits[contest.limit.kind] * contest.threads)
                row.fraction = best / row.minimum
                row.limit = f"{contest.limit.kind}: {contest.limit.count}"
        rows.append(row)
    return rows


def seconds(value: float | None) -> str:
    """Return a time with a unit that suits it."""
    if value is None:
        return "-"
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e-9:.3g} ns"


def markdown(rows: Iterable[Row]) -> str:
    """Return the rows as Markdown tables, one for each contest."""
    text, contest = "", None
    for row in rows:
        if row.contest != contest:
            contest = row.contest
            threads = f"{row.threads} thread" + ("s" if row.threads != 1 else "")
            target = f" Asked for: {row.target}." if row.target else ""
            text += f"\n### {contest}\n\nTime for one {row.unit}, {threads}.{target}\n\n"
            text += "| contestant | median | minimum | x ours | relative error | of the limit |\n"
            text += "|---|---|---|---|---|---|\n"
        if row.message:
            text += f"| {row.contestant} | not run: {row.message} | | | | |\n"
            continue
        errors = [] if row.error is None else [f"{row.error:.1g}"]
        errors += [f"{case} {e:.1g}" for case, e in row.accuracy.items() if e is not None]
        fraction = f"{row.fraction:.0%} ({row.limit})" if row.fraction else ""
        ratio = f"{row.ratio:.3g}" if row.ratio else ""
        text += (
            f"| {row.contestant} | {seconds(row.median)} | {seconds(row.minimum)} | {ratio} "
            f"| {', '.join(errors)} | {fraction} |\n"
        )
    return text


def c_library(source: str, *flags: str) -> ctypes.CDLL:
    """Compile benches/c/<source> with gcc -O3 -march=native and load it."""
    out = Path(tempfile.gettempdir()) / f"gramian-bench-{Path(source).stem}{''.join(flags)}.so"
    command = ["gcc", "-O3", "-march=native", "-shared", "-fPIC", *flags]
    command += [str(HERE / "c" / source), "-o", str(out), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[0])
    return ctypes.CDLL(str(out))


def pointer(array: Any) -> ctypes.c_void_p:
    """Return the address of a numpy array for a C function."""
    return ctypes.c_void_p(array.ctypes.data)


def main(contests: Callable[[bool], Iterator[Contest]]) -> None:
    """Run one bench module alone and print its tables."""
    import sys

    from limits import measure

    quick = "--quick" in sys.argv
    limits = measure()
    rows: list[Row] = []
    for contest in contests(quick):
        rows += run(contest, rounds=3 if quick else 7, limits=limits)
        print(markdown(rows[-len(contest.contestants) :]), flush=True)
