"""Local weak observability: ranks of the Lie derivatives, by jets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _options as options
from gramian._answers import Answer, Columns
from gramian._arrays import finite, number, whole
from gramian._text import count, describe_direction
from gramian.analysis import analyze
from gramian.exceptions import InputError
from gramian.models.dynamics._functions import Function
from gramian.models.dynamics._jets import Jet
from gramian.problem import Problem

__all__ = ["LieDerivatives", "lie_derivatives"]

Array = NDArray[np.float64]

#: The unit in the last place.
EPSILON = float(np.finfo(float).eps)
#: What the imaginary part of a complex step is: its square is lost in rounding.
_STEP = 1e-30
#: Points near x0 at which the generic rank is looked for.
_POINTS = 4


@dataclass(frozen=True, eq=False, repr=False)
class LieDerivatives(Answer):
    """The Lie derivatives of the outputs at a point, and what they tell.

    Attributes
    ----------
    names, units : tuple of str, length n
    values : ndarray, shape (order + 1, p)
        L_f^k h: the k-th derivative of each output by time.
    gradients : ndarray, shape (order + 1, p, n)
        d L_f^k h / dx.
    ranks : tuple of int, length order + 1
        The rank of the gradients up to each derivative, at the point.
    generic_ranks : tuple of int, length order + 1
        The greatest rank that was found at points near by: that of almost all points.
    null_space : ndarray, shape (n, nullity)
        What the gradients do not see at the point.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    gradients: Array
    ranks: tuple[int, ...]
    generic_ranks: tuple[int, ...]
    null_space: Array

    _more_in_dict = ("observable", "null_combinations")

    @property
    def observable(self) -> bool:
        """Whether the system is locally weakly observable at the point (sufficient)."""
        return self.ranks[-1] == len(self.names)

    @property
    def null_combinations(self) -> tuple[str, ...]:
        """The null space in words."""
        return tuple(describe_direction(column, self.names) for column in self.null_space.T)

    def summary(self) -> str:
        """Return the ranks and what is not seen, as text."""
        n = len(self.names)
        head = "LOCALLY WEAKLY OBSERVABLE" if self.observable else "RANK SHORT"
        lines = [f"{head}: rank {self.ranks[-1]} of {n} {self._told()}"]
        if not self.observable:
            lines += [f"  not seen: {text}" for text in self.null_combinations]
            if self.generic_ranks[-1] > self.ranks[-1]:
                lines.append(f"  rank {self.generic_ranks[-1]} at almost all points near by")
        return "\n".join(lines)

    def _told(self) -> str:
        return f"with {count(len(self.ranks) - 1, 'derivative')}"

    def _as_table(self) -> Columns:
        orders = [str(k) for k in range(len(self.ranks))]
        values = {"rank": self.ranks, "generic rank": self.generic_ranks}
        return Columns("derivative", orders, values, {})


def lie_derivatives(
    f: Function,
    h: Function,
    x0: ArrayLike,
    names: Sequence[str] | None = None,
    *,
    order: int | None = None,
    time: float = 0.0,
    sigma: ArrayLike = 1.0,
    units: Sequence[str] | None = None,
    scale: ArrayLike | None = None,
    rtol: float | None = None,
) -> LieDerivatives:
    """Return the Lie derivatives of x' = f(t, x), y = h(t, x) at a point, with their ranks.

    Parameters
    ----------
    f, h : callable
        f(t, x) -> (n,), h(t, x) -> (p,), of x of shape (n,), in arithmetic and the usual
        functions of NumPy: power series in time pass through them. Branches on x cannot
        be differentiated.
    x0 : array_like, shape (n,)
    names, units : sequence of str, length n, optional
    order : int, optional
        The highest derivative; n - 1 by default, at most 12.
    time : float
        The time at the point; derivatives are total ones where f and h depend on it.
    sigma : array_like, shape () or (p,)
        Standard deviation of each output: what weighs them against each other.
    scale : array_like, shape (n,), optional
        A typical move of each state, within which generic points are looked at. By
        default the size of x0, at least 1.
    rtol : float, optional
        Relative rank tolerance of the gradients.

    Returns
    -------
    LieDerivatives

    Raises
    ------
    InputError
        Shapes that do not fit, a function that no power series passes through, a value
        that is not finite.

    Notes
    -----
    Hermann & Krener 1977: where the gradients of the Lie derivatives have rank n, the
    system is locally weakly observable; the converse holds at almost all points. The
    series of x and y in time come by recurrences from f and h as they are written
    (Griewank & Walther 2008, chapter 13), their gradients by complex steps through them:
    both exact to rounding. Ranks are taken in the unit of time in which the derivatives
    are of like size.

    Examples
    --------
    The optic flow below a camera: the height is seen only while the speed changes.

    >>> import numpy as np
    >>> def flow(t, x):
    ...     return [x[0] / x[1]]
    >>> def steady(t, x):
    ...     return [0 * x[0], 0 * x[0]]
    >>> lie_derivatives(steady, flow, [1.0, 2.0], ["speed", "height"]).null_combinations
    ('speed +0.5, height +1',)
    >>> def speeding(t, x):
    ...     return [0 * x[0] + 0.3, 0 * x[0]]
    >>> lie_derivatives(speeding, flow, [1.0, 2.0], ["speed", "height"]).ranks
    (1, 2)
    """
    from gramian.models.dynamics._trajectory import described

    for function, name in ((f, "f"), (h, "h")):
        options.function(function, name)
    start = np.atleast_1d(finite(x0, "x0"))
    if start.ndim != 1 or not start.size:
        raise InputError(f"x0 has shape {start.shape}: must be (n,)")
    n = len(start)
    labels, measures, moves = described(names, units, scale, start)
    highest = min(n - 1, 12) if order is None else whole(order, "order", 0)
    if highest > 100:
        raise InputError(f"order = {highest}: must be at most 100")
    tolerance = options.tolerance(rtol)
    at = number(time, "time [-]")
    rng = np.random.default_rng(0)
    for function, name in ((f, "f"), (h, "h")):
        # A complex step passes by a pole.
        with np.errstate(all="ignore"):
            finite(function(at, start), f"what {name} returned")
    values, gradients = _at_point(f, h, start, at, highest)
    p = values.shape[1]
    given = finite(sigma, "sigma")
    deviation = np.broadcast_to(given, (p,)) if given.shape in ((), (1,), (p,)) else None
    if deviation is None or not (deviation > 0).all():
        raise InputError("sigma: must be > 0, one number or one for each output")
    weight = 1 / deviation[:, None]
    off = _errors(f, h, start, at, gradients)
    ranks, null = _ranks(weight * gradients, weight * off, labels, moves, tolerance)
    best = list(ranks)
    for _ in range(_POINTS):
        point = start + 0.1 * moves * rng.uniform(-1, 1, n)
        try:
            _, near = _at_point(f, h, point, at, highest)
            off = _errors(f, h, point, at, near)
        except InputError:
            continue
        other, _ = _ranks(weight * near, weight * off, labels, moves, tolerance)
        best = [max(pair) for pair in zip(best, other, strict=True)]
    return LieDerivatives(
        names=labels,
        units=measures,
        values=values,
        gradients=gradients,
        ranks=tuple(ranks),
        generic_ranks=tuple(best),
        null_space=null,
    )


def _at_point(f: Function, h: Function, x0: Array, at: float, order: int) -> tuple[Array, Array]:
    """Return derivatives (order + 1, p) by time and their gradients (order + 1, p, n)."""
    n = len(x0)
    series = np.zeros((n, order + 1, n), dtype=complex)
    series[:, 0] = x0[:, None] + 1j * _STEP * np.eye(n)
    clock = np.zeros((order + 1, n), dtype=complex)
    clock[0] = at
    if order:
        clock[1] = 1.0
    for k in range(order):
        # The series of the rates up to t^k give that of the states up to t^(k + 1).
        rate = _called(f, "f", clock[: k + 1], series[:, : k + 1], n)
        series[:, k + 1] = rate[:, k] / (k + 1)
    found = _called(h, "h", clock, series, None)
    factors = np.array([float(factorial(k)) for k in range(order + 1)])
    values = np.real(found[:, :, 0]).T * factors[:, None]
    gradients = np.moveaxis(np.imag(found) / _STEP, 1, 0) * factors[:, None, None]
    for name, array in (("Lie derivative", values), ("gradient of a Lie derivative", gradients)):
        if not np.isfinite(array).all():
            k = int(np.argwhere(~np.isfinite(array))[0][0])
            raise InputError(f"the {name} of order {k} is not finite at x = {x0.tolist()}")
    return values, np.ascontiguousarray(gradients)


def _errors(f: Function, h: Function, x0: Array, at: float, gradients: Array) -> Array:
    """Return how wrong the gradients may be by rounding: terms that cancel leave it behind.

    They are found again at points a few units in the last place away.
    """
    rng = np.random.default_rng(1)
    off = np.zeros_like(gradients)
    for _ in range(3):
        near = x0 * (1 + 4 * EPSILON * rng.choice((-1.0, 1.0), len(x0)))
        _, other = _at_point(f, h, near, at, len(gradients) - 1)
        off = np.maximum(off, np.abs(other - gradients))
    return 4 * (off + EPSILON * np.abs(gradients))


def _called(function: Function, name: str, clock: Any, series: Any, size: int | None) -> Any:
    x = np.empty(len(series), dtype=object)
    for i, own in enumerate(series):
        x[i] = Jet(own)
    try:
        with np.errstate(all="ignore"):
            given = function(Jet(clock), x)
    except (TypeError, AttributeError) as error:
        raise InputError(
            f"{name} takes no power series: {error}; write it in arithmetic and NumPy's functions"
        ) from error
    listed = list(np.atleast_1d(np.asarray(given, dtype=object)).ravel())
    if size is not None and len(listed) != size:
        raise InputError(f"{name} returned {len(listed)} numbers: must be {size}")
    out = np.zeros((len(listed), *clock.shape), dtype=complex)
    for i, entry in enumerate(listed):
        if isinstance(entry, Jet):
            out[i] = entry.series
        else:
            out[i, 0] = number(entry, f"what {name} returned")
    return out


def _ranks(
    gradients: Array, errors: Array, names: tuple[str, ...], moves: Array, rtol: float | None
) -> tuple[list[int], Array]:
    """Return the ranks up to each derivative, and the null space of all."""
    orders = len(gradients)
    # Coefficients of the series rather than derivatives, in a unit of time that keeps
    # them no larger than the first ones.
    scaled = gradients / np.array([factorial(k) for k in range(orders)], dtype=float)[:, None, None]
    size = np.abs(scaled * moves).max(axis=(1, 2))
    first = size.max(initial=0.0) if not size[0] else size[0]
    later = [(first / size[k]) ** (1 / k) for k in range(1, orders) if size[k] > 0]
    unit = min([*later, 1e30]) if later else 1.0
    with np.errstate(over="ignore"):
        factors = (unit ** np.arange(orders))[:, None, None] * moves
        factors = factors / np.array([factorial(k) for k in range(orders)])[:, None, None]
        rows, off = gradients * factors, errors * factors
    width = len(names)
    ranks = []
    answer = None
    for k in range(orders):
        seen, wrong = rows[: k + 1].reshape(-1, width), off[: k + 1].reshape(-1, width)
        answer = analyze(Problem(seen, names, row_error=wrong), rtol=rtol)
        ranks.append(answer.rank)
    assert answer is not None
    null = answer.null_space * moves[:, None]
    lead = np.abs(null).argmax(axis=0)
    return ranks, null / null[lead, np.arange(null.shape[1])]
