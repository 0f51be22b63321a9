"""Thousands of pairs with an exactly planted unobservable block, and of observable ones.

    python benches/planted_systems.py [--pairs 2000] [--most 200] [--seed 0]

Prints how many were judged wrong or "undecided", and how long it took: a quarter of an hour
on one core, nearly all of it for distances. The tests run a small part of this.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import gramian as gm

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from planted import planted


def hidden_pairs(count: int, most: int, rng: Any) -> tuple[int, int]:
    """Return how many of `count` pairs were given another dimension than was planted.

    And how many of them were called undecided, whatever the dimension.
    """
    wrong = undecided = 0
    for trial in range(count):
        # Few large ones: the exact check of what was planted takes their time.
        n = round(4 * (most / 4) ** rng.uniform())
        hidden = int(rng.integers(1, n // 2 + 1))
        kind = ("integer", "orthogonal")[trial % 2]
        units = 30 if trial % 4 > 1 else 0
        a, c = planted(rng, n, hidden, kind, trial % 8 > 3, units)
        found = gm.linear.unobservable(a, c)
        undecided += found.undecided
        if found.nullity != hidden:
            wrong += 1
            print(f"n = {n}, {kind}, units {units}: {found.nullity} for {hidden}, {found.status}")
    return wrong, undecided


def observable_pairs(count: int, most: int, rng: Any) -> tuple[int, int, float]:
    """Return how many of `count` observable pairs were called unobservable, and the nearest.

    Between them how many were called undecided.
    """
    called, undecided, nearest, tried = 0, 0, np.inf, 0
    while tried < count:
        n = round(4 * (most / 4) ** rng.uniform())
        a, c = rng.normal(size=(n, n)), rng.normal(size=(int(rng.integers(1, 4)), n))
        # Towards the nearest unobservable real pair, but for a part of the way.
        away = gm.linear.distance(a, c)
        if abs(away.z.imag) < 1e-9:
            v = away.direction.real / np.linalg.norm(away.direction.real)
            left = 10.0 ** rng.uniform(-7.5, 0)
            a = a - (1 - left) * np.outer((a - away.z.real * np.eye(n)) @ v, v)
            c = c - (1 - left) * np.outer(c @ v, v)
        relative = gm.linear.distance(a, c).relative
        if relative > 1e-8:
            tried += 1
            nearest = min(nearest, relative)
            found = gm.linear.unobservable(a, c)
            called += found.status == "unobservable"
            undecided += found.undecided
            if tried % 100 == 0:
                print(f"{tried} observable ones", file=sys.stderr, flush=True)
    return called, undecided, float(nearest)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=2000)
    parser.add_argument("--most", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    generator = np.random.default_rng(given.seed)
    start = time.monotonic()
    wrong, doubtful = hidden_pairs(given.pairs, given.most, generator)
    print(f"{given.pairs} planted: {wrong} with another dimension, {doubtful} undecided")
    print(f"{time.monotonic() - start:.0f} s", flush=True)
    called, doubtful, nearest = observable_pairs(given.pairs, given.most, generator)
    print(f"{given.pairs} observable: {called} called unobservable, {doubtful} undecided")
    print(f"the nearest at {nearest:.1e} of the norm; {time.monotonic() - start:.0f} s in all")
