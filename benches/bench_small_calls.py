"""Small calls from Python, as people make them in loops: ratios to numpy, or to an empty
call into the extension, measured in the same run.

    python benches/bench_small_calls.py
"""

from __future__ import annotations

import sys
import timeit
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from harness import OURS, Contest, Contestant

import gramian as gm
from gramian import _core

SAMPLES = 50
#: Of calls that need another number each time: Python's own loop is then in both times.
LOOP = 1000


def track() -> tuple[Any, Any, Any, float]:
    """Fifty bearings from a curved path."""
    t = np.arange(SAMPLES) * 10.0
    path = np.stack([5 * t * np.cos(t / 100), 4 * t], axis=1)
    return t, path, np.array([0.0, 1e4, 3.0, -1.0]), 0.01


Work = Callable[[], object]


def pushes() -> tuple[Work, Work]:
    """Return as many pushes as empty calls, both of a loop over the times."""
    times = [float(i) for i in range(LOOP)]
    empty = _core.empty_call

    def push_all() -> None:
        push = gm.bearings.Monitor().push
        for t in times:
            push(t, 0.3, 0.01)

    def call_all() -> None:
        for _ in times:
            empty()

    return push_all, call_all


def table() -> list[tuple[str, str, float, Work, Work]]:
    """Return what is called, what it is measured by, the ratio wanted, and both."""
    rows = gm.bearings.rows(*track())
    problem = gm.bearings.problem(*track())
    position, moment = np.array([1.0, 2.0, 3.0]), np.array([1.0, 0.0, 0.0])

    def svd() -> object:
        return np.linalg.svd(rows)

    def inverse() -> object:
        return np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))

    empty = _core.empty_call
    return [
        ("crlb_std(rows)", "sqrt(diag(inv(A.T A)))", 0.6, lambda: gm.crlb_std(rows), inverse),
        ("bearings.problem", "numpy svd", 2, lambda: gm.bearings.problem(*track_of), svd),
        ("analyze(problem)", "numpy svd", 4, lambda: gm.analyze(problem), svd),
        (f"{LOOP} Monitor.push", f"{LOOP} empty calls", 6, *pushes()),
        ("dipole.field", "an empty call", 15, lambda: gm.dipole.field(position, moment), empty),
        (
            "dipole.field of lists",
            "an empty call",
            15,
            lambda: gm.dipole.field([1.0, 2.0, 3.0], [1.0, 0.0, 0.0]),
            empty,
        ),
        (
            "maneuver.heading",
            "an empty call",
            15,
            lambda: gm.maneuver.heading(0.3, 1000.0, 10.0),
            empty,
        ),
    ]


track_of = track()
#: What is no rival but a measure: the report does not count it among the faster ones.
NOTHING = {name: f"nothing: {name}" for name in ("an empty call", f"{LOOP} empty calls")}
WHY = {
    "analyze(problem)": "The SVD is one part of the answer: ours also decides the rank with the "
    "units scaled, finds bounds with and without the prior, the weakest combination and its words.",
}


def microseconds(work: Callable[[], object]) -> float:
    """Return the shortest time of a call, of many rounds."""
    timer = timeit.Timer(work)
    count, spent = timer.autorange(lambda *_: None)
    count = max(1, int(count * 0.02 / spent))
    return min(timer.repeat(25, count)) / count * 1e6


def contests(quick: bool) -> Iterator[Contest]:
    """Yield the table as contests of the harness."""
    for name, by, wanted, ours, theirs in table():
        yield Contest(
            f"small call: {name}",
            "call",
            1.0,
            None,
            [
                Contestant(OURS, lambda _, work=ours: work),
                Contestant(NOTHING.get(by, by), lambda _, work=theirs: work),
            ],
            target=f"at most {wanted:g} times {by}",
            note="An empty call goes into the extension and does nothing there: what is left when "
            "nothing is computed."
            if by in NOTHING
            else "",
            why=WHY.get(name, ""),
        )


def main() -> int:
    """Print the table; 1 where a ratio is above what is wanted."""
    print(f"{'call':24} {'us':>8}  {'by':26} {'us':>8} {'ratio':>7} {'wanted':>7}")
    worst = 0
    for name, by, wanted, ours, theirs in table():
        # Measured by turns, so that a busy machine slows both alike.
        pairs = [(microseconds(ours), microseconds(theirs)) for _ in range(3)]
        mine, other = min(a for a, _ in pairs), min(b for _, b in pairs)
        ratio = mine / other
        worst |= ratio > wanted
        print(f"{name:24} {mine:8.2f}  {by:26} {other:8.2f} {ratio:7.2f} {wanted:7.1f}")
    return int(worst)


if __name__ == "__main__":
    sys.exit(main())
