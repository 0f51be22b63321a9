"""The machine's limits, measured in the same run, on one thread and on all at once."""

from __future__ import annotations

import ctypes
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from harness import c_library, pointer

#: Bytes of the arrays that are read, of every level of the memory.
READS = {
    "read 32 kB": 2**15,
    "read 128 kB": 2**17,
    "read 512 kB": 2**19,
    "read 2 MB": 2**21,
    "read 8 MB": 2**23,
    "read 32 MB": 2**25,
    "read 128 MB": 2**27,
}

#: Of arrays that are written, in memory that has been in use: in the cache of the core, and
#: farther.
WRITES = {"write 512 kB": 2**19, "write 8 MB": 2**23}

#: What each rate counts, a second.
KINDS = {
    "fma": "multiply-adds, in lanes of a vector",
    "divide": "divisions, in lanes",
    "root": "square roots, in lanes",
    "sincos": "pairs of a sine and a cosine, in lanes",
    **dict.fromkeys([*READS, *WRITES], "bytes of an array of that size"),
}

#: Rates by number of threads ("one", "all") and kind.
Rates = dict[str, dict[str, float]]


def measure(seconds: float = 0.1) -> Rates:
    """Return the best rates seen in `seconds` each; none without a compiler."""
    try:
        library = c_library("limits.c", "-fno-math-errno")
    except (OSError, RuntimeError) as error:
        print(f"The machine's limits are not measured: {error}", file=sys.stderr)
        return {}
    works = {kind: _work(library, kind) for kind in KINDS}
    one = {kind: _best(work, seconds, 1) for kind, work in works.items()}
    threads = os.cpu_count() or 1
    together = {kind: _best(work, seconds, threads) for kind, work in works.items()}
    # Where others use the machine, one thread alone can be faster than all.
    return {"one": one, "all": {kind: max(one[kind], together[kind]) for kind in KINDS}}


def larger(first: Rates, second: Rates) -> Rates:
    """Return the better of two measurements, kind by kind."""
    if not (first and second):
        return first or second
    return {
        threads: {kind: max(rate, second[threads][kind]) for kind, rate in rates.items()}
        for threads, rates in first.items()
    }


def reading(size: float) -> str:
    """Return the kind of what reads `size` bytes again and again.

    It is the largest array of `READS` that is no larger, so the limit is never too low.
    """
    return [kind for kind, of in READS.items() if of <= max(size, 2**15)][-1]


def writing(size: float) -> str:
    """Return the kind of what writes `size` bytes again and again, likewise."""
    return [kind for kind, of in WRITES.items() if of <= max(size, 2**19)][-1]


@dataclass
class Gauge:
    """Rates that are seen in turn with the contestants of a contest.

    A machine changes its pace within minutes: what binds is what it does beside the contest.
    """

    _works: dict[str, Callable[[], float]] = field(default_factory=dict)

    def once(self, rates: Rates, wanted: Iterable[tuple[str, str]]) -> None:
        """Measure once what is wanted, ("one" or "all", kind); keep the best in `rates`."""
        for threads, kind in wanted:
            if kind not in self._works:
                self._works[kind] = _work(c_library("limits.c", "-fno-math-errno"), kind)
            count = 1 if threads == "one" else os.cpu_count() or 1
            # Of a large array one piece of work takes milliseconds.
            rate = _best(self._works[kind], 0.0, count, 2 if READS.get(kind, 0) > 2**24 else 10)
            of = rates.setdefault(threads, {})
            of[kind] = max(rate, of.get(kind, 0.0))


def _work(library: ctypes.CDLL, kind: str) -> Callable[[], float]:
    """Return what does some of the work and tells how much; threads may call it together."""
    name = kind.split(maxsplit=1)[0]
    function = getattr(library, f"{name}_rate")
    function.restype = ctypes.c_double
    size, many = ctypes.c_size_t, ctypes.c_long
    if kind == "sincos":
        angles = np.random.default_rng(0).uniform(-3, 3, 512)

        def sincos() -> float:
            s, c = np.empty_like(angles), np.empty_like(angles)
            done: float = function(
                pointer(angles), pointer(s), pointer(c), size(angles.size), many(500)
            )
            return done

        return sincos
    if kind in READS or kind in WRITES:
        count = {**READS, **WRITES}[kind] // 8
        # Threads that write have an array each.
        arrays = threading.local()
        shared = np.ones(count)
        repeats = max(1, 2**23 // count)

        def through() -> float:
            array = shared
            if kind in WRITES:
                if not hasattr(arrays, "own"):
                    arrays.own = shared.copy()
                array = arrays.own
            out = np.zeros(1)
            done: float = function(pointer(array), size(array.size), many(repeats), pointer(out))
            return done

        return through
    repeats = 200_000 if kind == "fma" else 10_000

    def arithmetic() -> float:
        out = np.zeros(1)
        done: float = function(many(repeats), pointer(out))
        return done

    return arithmetic


def _best(work: Callable[[], float], seconds: float, threads: int, pieces: int = 10) -> float:
    """Return the best rate of several goes: never fewer than three, however slow the machine.

    Each of several threads does so many `pieces` of work in a go.
    """
    best, goes = 0.0, 0
    with ThreadPoolExecutor(threads) as pool:

        def go() -> float:
            if threads == 1:
                return work()
            # Long enough that the start of the threads does not show.
            jobs = [pool.submit(lambda: sum(work() for _ in range(pieces))) for _ in range(threads)]
            return sum(job.result() for job in jobs)

        go()  # warm: pages are mapped, the clock is up
        end = time.perf_counter() + seconds
        while goes < 3 or time.perf_counter() < end:
            start = time.perf_counter()
            done = go()
            best = max(best, done / (time.perf_counter() - start))
            goes += 1
    return best


@dataclass
class Limit:
    """What binds a kernel: operations a unit of work, by the kinds of `KINDS`.

    Multiply-adds and sines share the arithmetic units, divisions and roots the
    divider, bytes the way to the caches, one way for those read and one for those written;
    these run beside one another, so the slowest of them binds.
    """

    operations: dict[str, float]
    count: str  # where the numbers come from, in words

    def best(self, rates: dict[str, float]) -> tuple[float, str]:
        """Return the least seconds a unit, and the kinds that bind."""
        groups = (("fma", "sincos"), ("divide", "root"), tuple(READS), tuple(WRITES))
        times = []
        for group in groups:
            kinds = [kind for kind in group if self.operations.get(kind)]
            spent = sum(self.operations[kind] / rates[kind] for kind in kinds)
            times.append((spent, " + ".join(kinds)))
        return max(times)


if __name__ == "__main__":
    for threads, rates in measure().items():
        for kind, rate in rates.items():
            print(f"{threads:4} {kind:11} {rate / 1e9:8.2f} G/s  {KINDS[kind]}")
