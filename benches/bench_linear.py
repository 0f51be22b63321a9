"""Levels and observability matrices of many linear systems, beside numpy and python-control."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from harness import OURS, Contest, Contestant, Limit, main

import gramian as gm

STATES, OUTPUTS = 15, 6
# python-control takes one system at a time: a part of the batch is enough.
PART = 200


def systems(count: int) -> tuple[Any, Any]:
    """Random systems, dense, of full rank."""
    rng = np.random.default_rng(5)
    a = rng.normal(size=(count, STATES, STATES)) / np.sqrt(STATES)
    return a, rng.normal(size=(count, OUTPUTS, STATES))


def stacked(a: Any, c: Any) -> Any:
    """The observability matrices by numpy's batched products."""
    blocks = [c]
    for _ in range(STATES - 1):
        blocks.append(blocks[-1] @ a)
    return np.concatenate(blocks, axis=-2)


def matrix_contest(count: int) -> Contest:
    """[C; CA; ..; CA^14] of each system."""
    a, c = systems(count)

    def control() -> Callable[[], Any]:
        from control import obsv

        return lambda: [obsv(a[i], c[i]) for i in range(PART)]

    products = (STATES - 1) * OUTPUTS * STATES * STATES
    return Contest(
        f"observability_matrix, {count} systems of {STATES} states, {OUTPUTS} outputs",
        "system",
        count,
        [
            Contestant(OURS, lambda: lambda: gm.linear.observability_matrix(a, c)),
            Contestant("numpy, batched", lambda: lambda: stacked(a, c)),
            Contestant("python-control", control, work=PART),
        ],
        limit=Limit("fma", products, "14 products of (6, 15) by (15, 15)"),
        target="3 times numpy's batch",
    )


def levels_contest(count: int) -> Contest:
    """Ranks of all O_k and the level of each state; the peers give one rank of Q."""
    a, c = systems(count)

    def control() -> Callable[[], Any]:
        from control import obsv

        return lambda: [np.linalg.matrix_rank(obsv(a[i], c[i])) for i in range(PART)]

    return Contest(
        f"levels, {count} systems of {STATES} states, {OUTPUTS} outputs",
        "system",
        count,
        [
            Contestant(OURS, lambda: lambda: gm.linear.batch_levels(a, c).rank),
            Contestant(
                "numpy, batched: Q and its SVD",
                lambda: lambda: np.linalg.matrix_rank(stacked(a, c)),
            ),
            Contestant("python-control and SVD", control, work=PART),
        ],
        target="3 times numpy's batch",
    )


def contests(quick: bool) -> Iterator[Contest]:
    """All contests of this part."""
    count = 1000 if quick else 10_000
    yield levels_contest(count)
    yield matrix_contest(count)


if __name__ == "__main__":
    main(contests)
