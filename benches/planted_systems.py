"""Thousands of pairs with an exactly planted unobservable block, and of observable ones.

    python benches/planted_systems.py [--pairs 2000] [--most 200] [--seed 0]

Prints how many were judged wrong. The tests run a small part of this.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

import gramian as gm

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from planted import planted


def hidden_pairs(count: int, most: int, rng: Any) -> int:
    """Return how many of `count` pairs were given another dimension than was planted."""
    wrong = 0
    for trial in range(count):
        # Few large ones: the exact check of what was planted takes their time.
        n = round(4 * (most / 4) ** rng.uniform())
        hidden = int(rng.integers(1, n // 2 + 1))
        kind = ("integer", "orthogonal")[trial % 2]
        units = 30 if trial % 4 > 1 else 0
        a, c = planted(rng, n, hidden, kind, trial % 8 > 3, units)
        found = gm.linear.unobservable(a, c).nullity
        if found != hidden:
            wrong += 1
            print(f"n = {n}, {kind}, units {units}: {found} for {hidden}")
    return wrong


def observable_pairs(count: int, most: int, rng: Any) -> tuple[int, float]:
    """Return how many of `count` observable pairs were called unobservable, and the nearest."""
    called, nearest, tried = 0, np.inf, 0
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
            called += gm.linear.unobservable(a, c).nullity > 0
    return called, float(nearest)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=2000)
    parser.add_argument("--most", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    generator = np.random.default_rng(given.seed)
    print("wrong dimension:", hidden_pairs(given.pairs, given.most, generator))
    print("called unobservable, nearest:", observable_pairs(given.pairs, given.most, generator))
