"""Chosen modes of sparse systems that grow: heat in a square plate, one and two sensors.

    python benches/sparse_modes.py [--largest 100000]

The plate's symmetry makes modes come in pairs: one sensor hides one of each, two show
all. What must be hidden is known, and checked. Seconds of the processor, one thread.
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array, kron

import gramian as gm


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--largest", type=int, default=100_000)
    given = parser.parse_args()
    gm.set_threads(1)
    print(" states   one sensor   two sensors   hidden of the slowest   peak memory")
    for n in (1000, 10_000, 100_000):
        if n > given.largest:
            break
        side = int(np.sqrt(n))
        rod = diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(side, side))
        a = csr_array(kron(rod, eye_array(side)) + kron(eye_array(side), rod))
        # On no line of symmetry, and on no node of the first modes.
        places = [side // 7 * side + side // 3, side // 5 * side + side // 11]
        seconds, hidden = [], []
        for count in (1, 2):
            c = csr_array(
                (np.ones(count), (range(count), places[:count])), shape=(count, a.shape[0])
            )
            start = time.process_time()
            found = gm.linear.modes(a, c, near=0.0, count=4)
            seconds.append(time.process_time() - start)
            hidden.append(found.hidden_at.tolist()[:2])
        # (1, 1) alone, then (1, 2) with (2, 1).
        assert hidden == [[0, 1], [0, 0]], hidden
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        print(
            f"{a.shape[0]:7d}  {seconds[0]:9.2f} s  {seconds[1]:10.2f} s   "
            f"{hidden[0]} and {hidden[1]}     {peak:8.2f} GB",
            flush=True,
        )


if __name__ == "__main__":
    main()
