"""Derivatives that are not differences: their errors, and whether they fit the function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gramian import _core
from gramian._arrays import finite
from gramian.exceptions import InputError
from gramian.problem import Array

__all__ = ["Around", "complex_step", "confirmed"]

NOT_ANALYTIC = (
    ': h is not analytic (abs, norm, real, a comparison or conjugate in it); use method = "central"'
)


@dataclass(frozen=True)
class Around:
    """A measurement function near a state, as differences see it.

    `batch` returns h at points (count, n), NaN where it has no value; `at` is h(state),
    `weight` one over the deviation of each measurement, `periods` 0 for one that is no angle.
    """

    batch: Callable[[Array], Array]
    state: Array
    at: Array
    scale: Array
    weight: Array
    periods: Array


def confirmed(
    derivative: Callable[[Array], Array], around: Around, *, by_complex_step: bool
) -> tuple[Array, Array, int]:
    """Return derivatives (m, n), their error by rounding, and how often h was evaluated.

    They are checked against differences.
    """
    state, at, scale = around.state, around.at, around.scale
    n = state.size
    raw = derivative(state)
    # Of a Jacobian in single precision fewer digits are right.
    precision = np.finfo(raw.dtype if raw.dtype.kind == "f" else float).eps
    values = finite(raw, "the Jacobian")
    if values.shape != (at.size, n):
        hint = ": is it transposed?" if values.shape == (n, at.size) else ""
        raise InputError(f"the Jacobian has shape {values.shape}: must be ({at.size}, {n}){hint}")
    # What rounding inside leaves: second differences over a few units in the last place;
    # also of single precision, where all that was returned may be such numbers.
    largest = np.abs(values).max(axis=0, initial=0.0)
    single = float(np.finfo(np.float32).eps)
    error = precision * np.maximum(np.abs(values), largest if precision >= single else 0.0)
    size = np.where(state == 0, np.where(np.isnan(scale), 1.0, scale), state)
    with np.errstate(over="ignore"):
        maybe_single = precision < single and bool((values == values.astype(np.float32)).all())
    calls = 1
    for unit in (precision, single)[: 1 + maybe_single]:
        for signs in (1.0, np.where(np.arange(n) % 2, 1.0, -1.0)):
            step = 8 * unit * np.abs(size) * signs
            calls += 2
            try:
                bent = derivative(state + step) - 2 * values + derivative(state - step)
            except (InputError, ArithmeticError, ValueError):
                continue
            bent = np.abs(bent)
            if unit >= single and (bent > 1e-2 * single * largest).any():
                error = np.maximum(error, single * largest)
            error = np.maximum(error, bent)
    # A complex step takes an evaluation a state, and one more.
    calls *= n + 1 if by_complex_step else 1
    calls += 1 + _compare(values, error, around, by_complex_step=by_complex_step)
    return values, error, calls


def _compare(values: Array, error: Array, around: Around, *, by_complex_step: bool) -> int:
    """Compare derivatives with differences along two directions.

    Returns how often h was evaluated.
    """
    state, scale = around.state, around.scale
    nothing, calls = np.zeros(1), 0
    known = np.where(np.isnan(scale), np.where(state == 0, 1.0, np.abs(state)), scale)
    for turn in (0, 1):
        direction = known * np.cos(1.0 + 2.4 * np.arange(state.size) + turn)

        def line(t: Array, along: Array = direction) -> Array:
            return around.batch(state + t * along)

        with np.errstate(all="ignore"):
            try:
                found = _core.differences(
                    line,
                    nothing,
                    around.at,
                    np.ones(1),
                    around.weight,
                    around.periods,
                    np.full(around.at.size, np.nan),
                    np.full(1, np.nan),
                    None,
                    ("the state along a line",),
                )
            except InputError:
                # Differences that do not exist check nothing.
                return calls
        calls += found.evaluations
        slope, allowed = found.values()[:, 0], found.error()[:, 0]
        expected = values @ direction
        slack = 3 * allowed + 3 * (error @ np.abs(direction)) + 1e-6 * np.abs(slope).max()
        off = np.abs(expected - slope)
        if (bad := np.flatnonzero(off > slack + 1e-3 * np.abs(slope))).size:
            i = int(bad[np.argmax(off[bad] / slack[bad])])
            raise InputError(
                f"the Jacobian does not fit h: along a line h(x)[{i}] changes by "
                f"{slope[i]:.6g}, by the Jacobian {expected[i]:.6g}"
                + (NOT_ANALYTIC if by_complex_step else _guess(values, expected, slope, direction))
            )
    return calls


def _guess(values: Array, expected: Array, slope: Array, direction: Array) -> str:
    """Return what may be wrong with a Jacobian that does not fit, or nothing."""
    if values.shape[0] == values.shape[1] and np.allclose(values.T @ direction, slope, rtol=1e-3):
        return ": it is transposed"
    if np.allclose(-expected, slope, rtol=1e-3):
        return ": its sign is wrong"
    with np.errstate(all="ignore"):
        ratio = slope / expected
    if np.isfinite(ratio).all() and np.allclose(ratio, ratio[0], rtol=1e-3):
        return f": it is off by the factor {ratio[0]:.6g}, a unit perhaps"
    return ""


def complex_step(h: Callable[[Array], ArrayLike], x: Array) -> Array:
    """Return the Jacobian by steps along the imaginary axis (Squire & Trapp 1998)."""
    if np.iscomplexobj(np.asarray(h(x.copy()))):
        raise InputError('h(x) is complex: a complex step needs a real h; use method = "central"')
    columns = []
    for i in range(x.size):
        step = 1e-100 * max(1.0, abs(x[i]))
        moved: Any = x.astype(complex)
        moved[i] += 1j * step
        try:
            values = np.asarray(h(moved))
        except TypeError as error:
            raise InputError(f"h does not accept complex numbers: {error}") from error
        if not np.iscomplexobj(values):
            raise InputError(
                'h returns real numbers for a complex state: use method = "central", '
                "or an h without abs, real or conversions to float"
            )
        columns.append(values.ravel().imag / step)
    return finite(np.stack(columns, axis=1), "the complex-step Jacobian of h")
