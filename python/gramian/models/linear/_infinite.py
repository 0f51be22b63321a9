"""Gramians over all time, and what a model of fewer states would keep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian import _core
from gramian._answers import Answer, Columns
from gramian._arrays import finite, number
from gramian._text import brief
from gramian.exceptions import InputError
from gramian.models.linear._systems import SystemLike, Time, system_of, time_of, whitener

__all__ = ["Hankel", "SplitGramian", "gramian_factor", "hankel", "split_gramian"]

Array = NDArray[np.float64]


def gramian_factor(
    A: SystemLike,
    C: ArrayLike | None = None,
    *,
    R: ArrayLike | None = None,
    discount: float = 0.0,
    time: Time = "continuous",
) -> Array:
    """Return the triangular factor of the observability Gramian over an infinite window.

    Parameters
    ----------
    A : array_like, shape (n, n), or state-space object
    C : array_like, shape (p, n)
    R : array_like, optional
        Covariance of the outputs, in continuous time its density.
    discount : float
        Outputs at time t count with weight e^(-discount t), per unit of time or sample:
        what an unstable system needs is twice its fastest growth.
    time : {"continuous", "discrete"}
        A state-space object with a nonzero attribute ``dt`` is discrete.

    Returns
    -------
    ndarray, shape (n, n)
        Upper triangular, with W = factor^T factor.

    Raises
    ------
    InputError
        A system that is not stable after the discount, or by no more than rounding, and
        shows it: there is no such Gramian.

    Notes
    -----
    Doubling of the sum (Smith 1968) on triangular factors; a continuous system by the
    bilinear transform, which leaves the Gramian as it is. The product C^T C is not
    formed.

    Examples
    --------
    >>> factor = gramian_factor([[-1.0, 0.0], [0.0, -2.0]], [[1.0, 1.0]])
    >>> (factor.T @ factor).round(4)
    array([[0.5   , 0.3333],
           [0.3333, 0.25  ]])
    """
    time = time_of(A, time)
    system = system_of(A, C, R=R)
    white = whitener(R, len(system.C), system.noise) @ system.C
    a = _discounted(system.A, discount, time)
    return _core.linear_infinite(a, white, time == "discrete")


def _discounted(a: Array, discount: float, time: str) -> Array:
    discount = number(discount, "discount")
    if discount < 0:
        raise InputError(f"discount = {discount}: must be >= 0")
    if time == "discrete":
        smaller: Array = a * np.exp(-discount / 2)
        return smaller
    shifted: Array = a - discount / 2 * np.eye(len(a))
    return shifted


@dataclass(frozen=True, eq=False, repr=False)
class SplitGramian(Answer):
    """The Gramians of the two parts of a system that need not be stable.

    Attributes
    ----------
    stable : ndarray, shape (n, k)
        Orthonormal basis of the motions that decay.
    stable_factor : ndarray, shape (k, k)
        Factor of the Gramian of their coefficients, over all time to come.
    antistable : ndarray, shape (n, n - k)
        Basis of the motions that grow.
    antistable_factor : ndarray, shape (n - k, n - k)
        Factor of theirs, over all time gone by.
    """

    stable: Array
    stable_factor: Array
    antistable: Array
    antistable_factor: Array


def split_gramian(
    A: SystemLike, C: ArrayLike | None = None, *, R: ArrayLike | None = None
) -> SplitGramian:
    """Return the Gramians of the stable and the antistable part of x' = A x apart.

    Parameters
    ----------
    A, C, R
        As for `gramian_factor`.

    Returns
    -------
    SplitGramian

    Raises
    ------
    InputError
        An eigenvalue on the imaginary axis: it belongs to neither part.

    Examples
    --------
    >>> parts = split_gramian([[-1.0, 0.0], [0.0, 2.0]], [[1.0, 1.0]])
    >>> float(abs(parts.stable_factor[0, 0]).round(4))
    0.7071
    >>> float(abs(parts.antistable_factor[0, 0]).round(4))
    0.5
    """
    if time_of(A) == "discrete":
        raise InputError("A is a discrete system: split_gramian takes x' = A x")
    system = system_of(A, C, R=R)
    white = whitener(R, len(system.C), system.noise) @ system.C
    (s, sf), (u, uf) = _core.linear_parts(system.A, white)
    return SplitGramian(s, sf, u, uf)


@dataclass(frozen=True, eq=False, repr=False)
class Hankel(Answer):
    """Hankel singular values of a stable system, and what truncation would cost.

    Attributes
    ----------
    values : ndarray, shape (n,)
        Descending: how much of input energy each balanced state hands to the output.
    bounds : ndarray, shape (n + 1,)
        For a balanced model of k states, k = 0..n, the largest error of its frequency
        response is at most bounds[k]: twice the sum of the values left out.
    """

    values: Array
    bounds: Array

    def order(self, error: float) -> int:
        """Return how many balanced states keep the error of the response below `error`."""
        allowed = number(error, "error")
        if allowed < 0:
            raise InputError(f"error = {allowed}: must be >= 0")
        return int(np.argmax(self.bounds <= allowed))

    def summary(self) -> str:
        """Return the orders that keep 10, 1 and 0.1 % of the largest bound, as text."""
        lines = [f"Hankel singular values {brief(self.values[0], 4)} to {brief(self.values[-1])}"]
        for part in (0.1, 0.01, 0.001):
            order = self.order(part * self.bounds[0])
            lines.append(
                f"  {order} of {len(self.values)} states: error below {brief(self.bounds[order])}"
            )
        return "\n".join(lines)

    def _as_table(self) -> Columns:
        return Columns("order", range(len(self.bounds)), {"error_bound": self.bounds}, {})


def hankel(
    A: SystemLike,
    B: ArrayLike | None = None,
    C: ArrayLike | None = None,
    *,
    time: Time = "continuous",
) -> Hankel:
    """Return the Hankel singular values of a stable system.

    Parameters
    ----------
    A : array_like, shape (n, n), or state-space object
        An object has its own B and C.
    B : array_like, shape (n, m)
    C : array_like, shape (p, n)
    time : {"continuous", "discrete"}
        A state-space object with a nonzero attribute ``dt`` is discrete.

    Returns
    -------
    Hankel

    Raises
    ------
    InputError
        Shapes that do not fit, a system that is not stable.

    Notes
    -----
    Singular values of the product of the factors of both Gramians (square-root
    algorithm, Tombs & Postlethwaite 1987); neither Gramian is formed. The error bound is
    that of Glover 1984 and Enns 1984.

    Examples
    --------
    >>> found = hankel([[-1.0, 0.0], [0.0, -100.0]], [[1.0], [1.0]], [[1.0, 1.0]])
    >>> found.values.round(4)
    array([0.5002, 0.0048])
    >>> found.order(0.01)
    1
    """
    time = time_of(A, time)
    if hasattr(A, "A") and hasattr(A, "C") and not isinstance(A, np.ndarray):
        if B is not None:
            raise InputError("B was given beside a state-space object, which has its own")
        B = getattr(A, "B", None)
    if B is None:
        raise InputError(
            "B is missing: give A, B and C, or an object with all three, "
            "as scipy.signal.StateSpace and control.StateSpace have"
        )
    b = finite(B, "B")
    system = system_of(A, C)
    if b.ndim != 2 or len(b) != system.n or not b.size:
        raise InputError(f"B has shape {b.shape}: must be ({system.n}, inputs)")
    observability = gramian_factor(system.A, system.C, time=time)
    reachability = gramian_factor(system.A.T, b.T, time=time)
    values = _core.linear_hankel(observability, reachability)
    return Hankel(values, np.append(2 * np.cumsum(values[::-1])[::-1], 0.0))
