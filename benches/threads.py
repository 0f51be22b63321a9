"""What a second thread gains: the best of many calls on one thread and on all, by turns.

    python benches/threads.py [ROUNDS]

The best, as other work on the machine takes one of the cores now and then. Beside it what the
machine itself gives: multiply-adds on all threads over those on one.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import bench_linear
import numpy as np
from harness import ALL
from limits import measure

import gramian as gm


def works() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Name and call, from 0.15 ms of work on."""
    times, rng = 10.0 * np.arange(100), np.random.default_rng(0)
    for trials in (1000, 2000, 5000, 10_000):
        bearings = rng.uniform(-3, 3, (trials, 100))
        yield (
            f"bearings Gram and det, {trials} x 100",
            lambda given=bearings: gm.bearings.gram_det(times, given),
        )
    a, c = bench_linear.systems(1000, 6)
    yield (
        "Gramians of 1000 systems, 6 states",
        lambda: gm.linear.gramian(np.eye(6) + 0.01 * a, c, window=1.0, dt=0.01),
    )
    a15, c15 = bench_linear.systems(1000)
    yield "levels of 1000 systems, 15 states", lambda: gm.linear.batch_levels(a15, c15)


def main() -> None:
    """Print a line for each."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 150
    for name, work in works():
        best = {1: np.inf, ALL: np.inf}
        for _ in range(rounds):
            for threads in (1, ALL):
                gm.set_threads(threads)
                work()  # wakes them
                start = time.perf_counter()
                work()
                best[threads] = min(best[threads], time.perf_counter() - start)
        one, both = best[1], best[ALL]
        print(
            f"{name:40} {one * 1e6:7.0f} us, {ALL} threads {both * 1e6:7.0f} us: {one / both:.2f}"
        )
    if rates := measure(0.2):
        for kind in ("fma", "read 128 MB"):
            print(f"{'the machine, ' + kind:40} {rates['all'][kind] / rates['one'][kind]:.2f}")


if __name__ == "__main__":
    main()
