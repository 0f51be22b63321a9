"""Maneuver: paths of a law, and the information along given paths.

Both are timed against two loops of numpy: over the trials, as one writes it first,
and over the samples with all trials in a vector.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from harness import OURS, Contest, Contestant, main

TRIALS, SAMPLES = 2000, 100
FEW = 20  # trials that the slowest loop is given


def _start() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    return rng.uniform(-5000, 5000, (TRIALS, 2)), np.array([8000.0, 9000.0])


def _numpy_path(start: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, ...]:
    """Follow the max_det law with numpy, any leading axes."""
    step, position = 20.0, start
    information = np.zeros((*start.shape[:-1], 2, 2))
    out = []
    for _ in range(SAMPLES):
        gap = target - position
        r2 = np.sum(gap**2, axis=-1)
        bearing, r = np.arctan2(gap[..., 0], gap[..., 1]), np.sqrt(r2)
        row = np.stack([gap[..., 1], -gap[..., 0]], axis=-1) / r2[..., None]
        information = information + row[..., :, None] * row[..., None, :]
        heading = bearing + np.pi / 2 - 2 * np.arctan(step / r)
        out.append((position, bearing, r, heading, information, np.linalg.det(information)))
        course = np.stack([np.sin(heading), np.cos(heading)], axis=-1)
        position = position + step * course
    return tuple(np.stack(x, axis=start.ndim - 1) for x in zip(*out, strict=True))


def _numpy_fisher(path: np.ndarray, target: np.ndarray) -> np.ndarray:
    gap = target - path
    r2 = np.sum(gap**2, axis=-1)
    rows = np.stack([gap[..., 1], -gap[..., 0]], axis=-1) / r2[..., None]
    return np.swapaxes(rows, -1, -2) @ rows


def _paths_by(how: str) -> Callable[[], Callable[[], Any]]:
    def prepare() -> Callable[[], Any]:
        import gramian as gm

        start, target = _start()
        if how == OURS:
            return lambda: gm.maneuver.trajectory(target, start, 20.0, 1.0, SAMPLES).det
        if how == "trials":
            return lambda: [_numpy_path(s, target)[-1] for s in start[:FEW]]
        return lambda: _numpy_path(start, target)[-1]

    return prepare


def _fisher_by(how: str) -> Callable[[], Callable[[], Any]]:
    def prepare() -> Callable[[], Any]:
        import gramian as gm

        start, target = _start()
        paths = _numpy_path(start, target)[0].copy()
        if how == OURS:
            return lambda: gm.maneuver.fisher(paths, target, 1.0)
        if how == "trials":
            return lambda: [_numpy_fisher(p, target) for p in paths[:200]]
        return lambda: _numpy_fisher(paths, target)

    return prepare


def contests(quick: bool) -> Iterator[Contest]:
    """The contests of this module."""
    yield Contest(
        f"maneuver path of the max_det law, {SAMPLES} samples",
        "trial",
        TRIALS,
        [
            Contestant(OURS, _paths_by(OURS)),
            Contestant("numpy, loop over trials", _paths_by("trials"), work=FEW),
            Contestant("numpy, all trials at once", _paths_by("samples")),
        ],
        target="20 times numpy's loop",
    )
    yield Contest(
        f"maneuver Fisher information of a fixed target, {SAMPLES} samples",
        "trial",
        TRIALS,
        [
            Contestant(OURS, _fisher_by(OURS)),
            Contestant("numpy, loop over trials", _fisher_by("trials"), work=200),
            Contestant("numpy, all trials at once", _fisher_by("samples")),
        ],
        target="20 times numpy's loop",
    )


if __name__ == "__main__":
    main(contests)
