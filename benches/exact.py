"""The same numbers with 50 digits, from the doubles that the contestants are given."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mpmath as mp
import numpy as np

Array = Any
DIGITS = 50


def gram(rows: Array) -> Any:
    """Return sum of row^T row of (K, n) rows of doubles or of mpmath's numbers."""
    n = len(rows[0])
    with mp.workdps(DIGITS):
        out = mp.zeros(n)
        numbers = [[mp.mpf(x) for x in row] for row in rows]
        for i in range(n):
            for j in range(i + 1):
                out[i, j] = out[j, i] = mp.fsum(row[i] * row[j] for row in numbers)
    return out


def det(matrix: Any) -> Any:
    with mp.workdps(DIGITS):
        return mp.det(matrix)


def log_det(matrix: Any) -> float:
    with mp.workdps(DIGITS):
        return float(mp.log(mp.det(matrix)))


def bounds(information: Any) -> Array:
    """Return the roots of the diagonal of the inverse."""
    with mp.workdps(DIGITS):
        inverse = information**-1
        return np.array([float(mp.sqrt(inverse[i, i])) for i in range(inverse.rows)])


def bearing_rows(times: Array, bearings: Array) -> list[list[Any]]:
    """Rows (cos, -sin, T cos, -T sin)."""
    with mp.workdps(DIGITS):
        rows = []
        for time, bearing in zip(times, bearings, strict=True):
            cos, sin = mp.cos(mp.mpf(float(bearing))), mp.sin(mp.mpf(float(bearing)))
            t = mp.mpf(float(time)) - mp.mpf(float(times[0]))
            rows.append([cos, -sin, t * cos, -t * sin])
        return rows


def sight_rows(path: Array, target: Array, sigma: float, times: Array | None = None) -> Any:
    """Rows of bearings of a target, fixed or (x0, y0, vx, vy), from along a path."""
    with mp.workdps(DIGITS):
        of = [mp.mpf(float(x)) for x in target]
        rows = []
        for k, place in enumerate(path):
            t = mp.mpf(float(times[k])) - mp.mpf(float(times[0])) if times is not None else 0
            x, y = (of[i] - mp.mpf(float(place[i])) + (t * of[i + 2] if t else 0) for i in (0, 1))
            r2 = (x * x + y * y) * mp.mpf(sigma)
            row = [y / r2, -x / r2]
            rows.append([*row, t * row[0], t * row[1]] if times is not None else row)
        return rows


def numbers(matrix: Any) -> Array:
    return np.array(matrix.tolist(), dtype=float)


def relative(found: Any, exact: Any) -> float:
    """Return |found / exact - 1| of one number."""
    return float(abs(mp.mpf(float(found)) / exact - 1))


def largest(found: Array, exact: Sequence[Any]) -> float:
    """Return the largest relative error of the first numbers; `found` may hold fewer."""
    few = np.ravel(found)[: len(exact)]
    return max(relative(f, e) for f, e in zip(few, exact, strict=False))


def entries(found: Array, exact: Array) -> float:
    """Return the largest error of symmetric matrices, each entry over the roots of its diagonal."""
    found = np.asarray(found).reshape(-1, *np.shape(exact)[-2:])[: len(exact)]
    exact = exact[: len(found)]
    scale = np.sqrt(np.diagonal(exact, axis1=-2, axis2=-1).astype(float))
    return float((np.abs(found - exact) / (scale[:, :, None] * scale[:, None, :])).max())


def lazily(make: Callable[[], Any]) -> Callable[[], Any]:
    """Return a function that makes the value once, when it is first asked for."""
    kept: list[Any] = []

    def value() -> Any:
        if not kept:
            kept.append(make())
        return kept[0]

    return value
