"""Maneuver: paths of a law, and the information along given paths.

Both are timed against two loops of numpy: over the trials, as one writes it first,
and over the samples with all trials in a vector.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import exact
import numpy as np
from harness import ALL, FAST, OURS, Case, Contest, Contestant, c_function, main
from limits import Limit, reading

import gramian as gm

TRIALS, SAMPLES = 2000, 100
FEW = 20  # trials that the slowest loop is given


STEP = 20.0


def _start(trials: int, distance: float = 1e4) -> tuple[Any, Any]:
    rng = np.random.default_rng(1)
    target = np.array([0.8, 0.9]) * distance
    return rng.uniform(-0.5, 0.5, (trials, 2)) * distance, target


def _numpy_path(start: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, ...]:
    """Follow the max_det law with numpy, any leading axes."""
    step, position = STEP, start
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


@cache
def _numba_path() -> Callable[..., Any]:
    import numba

    @numba.njit(fastmath=True)
    def kernel(start: Any, target: Any, step: float, steps: int) -> Any:
        trials = len(start)
        positions = np.empty((trials, steps, 2))
        headings, det = np.empty((trials, steps)), np.empty((trials, steps))
        for n in range(trials):
            x, y, xx, xy, yy = start[n, 0], start[n, 1], 0.0, 0.0, 0.0
            for k in range(steps):
                dx, dy = target[0] - x, target[1] - y
                r2 = dx * dx + dy * dy
                a, b = dy / r2, -dx / r2
                xx, xy, yy = xx + a * a, xy + a * b, yy + b * b
                heading = np.arctan2(dx, dy) + np.pi / 2 - 2 * np.arctan(step / np.sqrt(r2))
                positions[n, k, 0], positions[n, k, 1] = x, y
                headings[n, k], det[n, k] = heading, xx * yy - xy * xy
                x, y = x + step * np.sin(heading), y + step * np.cos(heading)
        return positions, headings, det

    return kernel


@cache
def _numba_fisher() -> Callable[..., Any]:
    import numba

    @numba.njit(fastmath=True)
    def kernel(path: Any, target: Any) -> Any:
        out = np.empty((len(path), 2, 2))
        for n in range(len(path)):
            xx = xy = yy = 0.0
            for k in range(path.shape[1]):
                dx, dy = target[0] - path[n, k, 0], target[1] - path[n, k, 1]
                w = 1 / (dx * dx + dy * dy)
                a, b = dy * w, -dx * w
                xx, xy, yy = xx + a * a, xy + a * b, yy + b * b
            out[n, 0, 0], out[n, 1, 1] = xx, yy
            out[n, 0, 1] = out[n, 1, 0] = xy
        return out

    return kernel


def _path_by_c(data: Any) -> Callable[[], Any]:
    kernel, (start, target) = c_function("maneuver.c", "trajectories", *FAST), data
    shape = (len(start), SAMPLES)

    def work() -> Any:
        positions, headings, det = np.empty((*shape, 2)), np.empty(shape), np.empty(shape)
        kernel(start, target, STEP, *shape, positions, headings, det)
        return det

    return work


def _path_by_numba(data: Any) -> Callable[[], Any]:
    kernel, (start, target) = _numba_path(), data
    return lambda: kernel(start, target, STEP, SAMPLES)[-1]


def _fisher_by_c(data: Any) -> Callable[[], Any]:
    kernel, (paths, target) = c_function("maneuver.c", "path_fisher", *FAST), data

    def work() -> Any:
        out = np.empty((len(paths), 2, 2))
        kernel(paths, target, *paths.shape[:2], out)
        return out

    return work


def _fisher_by_numba(data: Any) -> Callable[[], Any]:
    kernel = _numba_fisher()
    return lambda: kernel(*data)


@cache
def _exact_det(distance: float) -> Any:
    """The determinant at every sample of one path, with 30 digits."""
    import mpmath as mp

    start, target = _start(1, distance)
    out = []
    with mp.workdps(30):
        x, y = (mp.mpf(float(c)) for c in start[0])
        goal = [mp.mpf(float(c)) for c in target]
        xx = xy = yy = mp.mpf(0)
        for _ in range(SAMPLES):
            dx, dy = goal[0] - x, goal[1] - y
            r2 = dx * dx + dy * dy
            xx, xy, yy = xx + (dy / r2) ** 2, xy - dx * dy / r2**2, yy + (dx / r2) ** 2
            out.append(xx * yy - xy * xy)
            heading = mp.atan2(dx, dy) + mp.pi / 2 - 2 * mp.atan(STEP / mp.sqrt(r2))
            x, y = x + STEP * mp.sin(heading), y + STEP * mp.cos(heading)
    return np.array([float(d) for d in out])


def _path_case(distance: float) -> Case:
    def error(found: Any) -> float:
        # The first determinants are zero or rounding: from the tenth sample on.
        return float(np.abs(np.asarray(found)[0, 10:] / _exact_det(distance)[10:] - 1).max())

    return Case(_start(1, distance), error)


def _fisher_case(distance: float) -> Case:
    start, target = _start(2, distance)
    paths = np.ascontiguousarray(_numpy_path(start, target)[0])

    def make() -> Any:
        return np.array(
            [exact.numbers(exact.gram(exact.sight_rows(p, target, 1.0))) for p in paths]
        )

    wanted = exact.lazily(make)
    return Case((paths, target), lambda found: exact.entries(found, wanted()))


def _ours_path(data: Any) -> Callable[[], Any]:
    start, target = data
    return lambda: gm.maneuver.trajectory(target, start, STEP, 1.0, SAMPLES).det


def _ours_fisher(data: Any) -> Callable[[], Any]:
    paths, target = data
    return lambda: gm.maneuver.fisher(paths, target, 1.0)


def _ours_fisher_single(data: Any) -> Callable[[], Any]:
    paths, target = (np.asarray(part, np.float32) for part in data)
    return lambda: gm.maneuver.fisher(paths, target, 1.0)


def contests(quick: bool) -> Iterator[Contest]:
    """The contests of this module."""
    yield Contest(
        f"maneuver path of the max_det law, {TRIALS} x {SAMPLES} samples",
        "trial",
        float(TRIALS),
        _start(TRIALS),
        [
            Contestant(OURS, _ours_path),
            Contestant("gramian, all threads", _ours_path, threads=ALL),
            Contestant("C", _path_by_c),
            Contestant("numba", _path_by_numba),
            Contestant(
                "numpy, loop over trials",
                lambda data: lambda: [_numpy_path(s, data[1])[-1] for s in data[0][:FEW]],
                part=float(FEW),
            ),
            Contestant("numpy, all trials at once", lambda data: lambda: _numpy_path(*data)[-1]),
        ],
        limit=Limit(
            {"fma": 60.0 * SAMPLES, "sincos": SAMPLES, "divide": 4.0 * SAMPLES, "root": SAMPLES},
            "a step: two arc tangents (30 multiply-adds, a division each), a sine and cosine, "
            "two more divisions and a root",
        ),
        cases={"well": _path_case(1e4), "ill": _path_case(1e7)},
        target="20 times numpy's loop",
        note="Error of the determinants; ill: the target 10 000 km away.",
    )
    yield Contest(
        f"maneuver Fisher information of a fixed target, {TRIALS} x {SAMPLES} samples",
        "trial",
        float(TRIALS),
        (
            np.ascontiguousarray(_numpy_path(*_start(TRIALS))[0]),
            _start(TRIALS)[1],
        ),
        [
            Contestant(OURS, _ours_fisher),
            Contestant("gramian, all threads", _ours_fisher, threads=ALL),
            Contestant(
                "gramian, float32",
                _ours_fisher_single,
                limit=Limit(
                    {
                        "fma": 4.0 * SAMPLES,
                        "divide": SAMPLES / 4,
                        reading(8.0 * SAMPLES * TRIALS): 8.0 * SAMPLES,
                    },
                    "the same in twice the lanes, which divide in half the time; 8 bytes read",
                ),
            ),
            Contestant("C", _fisher_by_c),
            Contestant("numba", _fisher_by_numba),
            Contestant(
                "numpy, loop over trials",
                lambda data: lambda: np.array([_numpy_fisher(p, data[1]) for p in data[0][:200]]),
                part=200.0,
            ),
            Contestant("numpy, all trials at once", lambda data: lambda: _numpy_fisher(*data)),
        ],
        limit=Limit(
            {
                "fma": 8.0 * SAMPLES,
                "divide": SAMPLES,
                reading(16.0 * SAMPLES * TRIALS): 16.0 * SAMPLES,
            },
            "8 multiply-adds and a division a sample, 16 bytes read",
        ),
        cases={"well": _fisher_case(1e4), "ill": _fisher_case(1e7)},
        target="20 times numpy's loop",
        note="Error of an entry over the roots of its diagonal entries.",
    )


if __name__ == "__main__":
    main(contests)
