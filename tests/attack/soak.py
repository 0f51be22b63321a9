"""Call public functions for minutes, and see that the memory of the process stays flat.

    python tests/attack/soak.py --minutes 10

Each round calls everything that the attack knows once as it is and once gone wrong, and the
resident memory is told once a minute. It may grow by 2 % and 4 MiB from the end of the first
fifth of the time to the end.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import signal
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from attack.attack import Attack, called

#: Seconds of a call: what works in proportion to what it is given is interrupted then.
PATIENCE = 1.0


@contextlib.contextmanager
def bounded() -> Iterator[None]:
    """Let a call refuse, and interrupt one that takes long."""

    def stop(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    try:
        with contextlib.suppress(Exception):  # the attack judges refusals
            yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def resident() -> float:
    """Return the resident memory of this process, MiB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    return float("nan")


def soak(minutes: float, seed: int = 0) -> list[tuple[float, int, float]]:
    """Return time, calls and resident memory, s and MiB, about fifty times."""
    attack = Attack(seed)
    began = time.monotonic()
    told: list[tuple[float, int, float]] = []
    calls = index = 0
    while (now := time.monotonic() - began) < 60 * minutes:
        name, _, make, arguments = attack.call(index)
        for given in (attack.targets[name][1], arguments):
            with warnings.catch_warnings(), np.errstate(all="ignore"), bounded():
                warnings.simplefilter("ignore")
                called(make(), given)
            calls += 1
        # The same few thousand calls again and again: what is kept of a new one is no leak.
        index = (index + 1) % (8 * len(attack.names))
        if now >= len(told) * 60 * minutes / 50:
            gc.collect()
            told.append((now, calls, resident()))
            if len(told) % 5 == 1:
                print(f"{now:6.0f} s  {calls:8} calls  {told[-1][2]:8.1f} MiB", flush=True)
    gc.collect()
    told.append((time.monotonic() - began, calls, resident()))
    return told


def main() -> int:
    """Run as a command: exit status 1 where the memory grows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    told = soak(options.minutes, options.seed)
    settled = max(memory for _, _, memory in told[: max(1, len(told) // 5)])
    last = told[-1][2]
    grown = last - settled
    flat = grown <= 0.02 * settled + 4
    print(
        f"{told[-1][1]} calls in {told[-1][0]:.0f} s: {settled:.1f} MiB after a fifth, "
        f"{last:.1f} MiB at the end: {'flat' if flat else 'GROWS'}"
    )
    return int(not flat)


if __name__ == "__main__":
    sys.exit(main())
