"""Truncated power series in time, which pass through the user's functions as numbers do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Jet"]

Series = NDArray[np.complex128]

#: What NumPy calls these and what a jet does.
_OPERATIONS = {
    "add": "__add__",
    "subtract": "__sub__",
    "multiply": "__mul__",
    "divide": "__truediv__",
    "true_divide": "__truediv__",
    "power": "__pow__",
    "float_power": "__pow__",
    "negative": "__neg__",
    "positive": "__pos__",
    "absolute": "__abs__",
}
_FUNCTIONS = frozenset(
    (
        *("sin", "cos", "tan", "exp", "expm1", "log", "log1p", "sqrt", "cbrt", "square"),
        *("reciprocal", "sinh", "cosh", "tanh", "arcsin", "arccos", "arctan", "arctan2"),
        *("hypot", "conjugate"),
    )
)


class Jet:
    """A power series in time, of several points at once.

    Parameters
    ----------
    series : ndarray of complex, shape (order + 1, points)
        The coefficients. An imaginary part of 1e-30 carries a derivative (complex step).

    Notes
    -----
    Recurrences as in Griewank & Walther 2008, table 13.2.
    """

    __slots__ = ("series",)
    # NumPy's arrays leave arithmetic with a jet to it.
    __array_priority__ = 1000

    def __init__(self, series: Series) -> None:
        self.series = series

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        """Take part in NumPy's functions of numbers."""
        if method != "__call__" or options:
            return NotImplemented
        arrays = [x for x in inputs if isinstance(x, np.ndarray) and x.ndim]
        if arrays:
            # Entry by entry, as objects.
            shape = np.broadcast_shapes(*(x.shape for x in arrays))
            spread = [
                np.broadcast_to(x, shape).ravel() if isinstance(x, np.ndarray) else [x] * len(out)
                for out in [np.empty(int(np.prod(shape)), dtype=object)]
                for x in inputs
            ]
            found = np.empty(int(np.prod(shape)), dtype=object)
            for k, entries in enumerate(zip(*spread, strict=True)):
                found[k] = ufunc(*entries)
            return found.reshape(shape)
        jets = [self._taken(x) for x in inputs]
        name = ufunc.__name__
        if name in _OPERATIONS:
            return getattr(jets[0], _OPERATIONS[name])(*jets[1:])
        if name in _FUNCTIONS:
            return getattr(jets[0], name)(*jets[1:])
        raise TypeError(f"numpy.{name} has no power series")

    def _taken(self, other: Any) -> Jet:
        if isinstance(other, Jet):
            return other
        series = np.zeros_like(self.series)
        series[0] = other
        return Jet(series)

    def _at_rest(self) -> bool:
        return not self.series[1:].any()

    def __add__(self, other: Any) -> Jet:
        return Jet(self.series + self._taken(other).series)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Jet:
        return Jet(self.series - self._taken(other).series)

    def __rsub__(self, other: Any) -> Jet:
        return self._taken(other) - self

    def __neg__(self) -> Jet:
        return Jet(-self.series)

    def __pos__(self) -> Jet:
        return self

    def __abs__(self) -> Jet:
        return Jet(self.series * np.where(self.series[0].real < 0, -1.0, 1.0))

    def __mul__(self, other: Any) -> Jet:
        a, b = self.series, self._taken(other).series
        return Jet(np.array([(a[: k + 1] * b[k::-1]).sum(axis=0) for k in range(len(a))]))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Jet:
        a, b = self.series, self._taken(other).series
        found = np.zeros_like(a)
        for k in range(len(a)):
            found[k] = (a[k] - (found[:k] * b[k:0:-1]).sum(axis=0)) / b[0]
        return Jet(found)

    def __rtruediv__(self, other: Any) -> Jet:
        return self._taken(other) / self

    def __pow__(self, other: Any) -> Jet:
        power = self._taken(other)
        exponents = np.unique(power.series[0])
        if not power._at_rest() or len(exponents) != 1 or exponents[0].imag != 0:
            return (power * self.log()).exp()
        p = float(exponents[0].real)
        if p == int(p) and abs(p) < 64:
            found = self._taken(1.0)
            for _ in range(abs(int(p))):
                found = found * self
            return found if p >= 0 else 1.0 / found
        a = self.series
        series = np.zeros_like(a)
        series[0] = a[0] ** p
        for k in range(1, len(a)):
            j = np.arange(1, k + 1)[:, None]
            series[k] = ((p * j - (k - j)) * a[1 : k + 1] * series[k - 1 :: -1]).sum(axis=0)
            series[k] /= k * a[0]
        return Jet(series)

    def __rpow__(self, other: Any) -> Jet:
        return self._taken(other) ** self

    def exp(self) -> Jet:
        """Return the exponential."""
        a = self.series
        found = np.zeros_like(a)
        found[0] = np.exp(a[0])
        for k in range(1, len(a)):
            j = np.arange(1, k + 1)[:, None]
            found[k] = (j * a[1 : k + 1] * found[k - 1 :: -1]).sum(axis=0) / k
        return Jet(found)

    def log(self) -> Jet:
        """Return the natural logarithm."""
        return self._integrated(np.log(self.series[0]), self._rate() / self)

    def _both(self, sign: float) -> tuple[Jet, Jet]:
        """Return sine and cosine, for sign -1; hyperbolic ones for +1."""
        a = self.series
        s, c = np.zeros_like(a), np.zeros_like(a)
        sine, cosine = (np.sin, np.cos) if sign < 0 else (np.sinh, np.cosh)
        s[0], c[0] = sine(a[0]), cosine(a[0])
        for k in range(1, len(a)):
            j = np.arange(1, k + 1)[:, None]
            s[k] = (j * a[1 : k + 1] * c[k - 1 :: -1]).sum(axis=0) / k
            c[k] = sign * (j * a[1 : k + 1] * s[k - 1 :: -1]).sum(axis=0) / k
        return Jet(s), Jet(c)

    def _rate(self) -> Jet:
        """Return the derivative by time; its last coefficient is not known, and 0."""
        rate = np.zeros_like(self.series)
        rate[:-1] = self.series[1:] * np.arange(1, len(rate))[:, None]
        return Jet(rate)

    @staticmethod
    def _integrated(first: Any, rate: Jet) -> Jet:
        found = np.zeros_like(rate.series)
        found[0] = first
        found[1:] = rate.series[:-1] / np.arange(1, len(found))[:, None]
        return Jet(found)

    def arctan2(self, other: Any) -> Jet:
        """Return the angle of (other, self)."""
        y, x = self, self._taken(other)
        square = x * x + y * y
        a, b = y.series[0], x.series[0]
        turned = (b.real * a.imag - a.real * b.imag) / square.series[0].real
        first = np.arctan2(a.real, b.real) + 1j * turned
        return self._integrated(first, (x * y._rate() - y * x._rate()) / square)

    def hypot(self, other: Any) -> Jet:
        """Return the root of the summed squares."""
        x = self._taken(other)
        return (self * self + x * x) ** 0.5

    def conjugate(self) -> Jet:
        """Return itself: the imaginary part is a derivative."""
        return self

    def __getattr__(self, name: str) -> Callable[..., Jet]:
        """Find the other functions, which NumPy asks of objects in arrays too."""
        simple: dict[str, Callable[[], Jet]] = {
            "sin": lambda: self._both(-1.0)[0],
            "cos": lambda: self._both(-1.0)[1],
            "tan": lambda: self._both(-1.0)[0] / self._both(-1.0)[1],
            "sinh": lambda: self._both(1.0)[0],
            "cosh": lambda: self._both(1.0)[1],
            "tanh": lambda: self._both(1.0)[0] / self._both(1.0)[1],
            "sqrt": lambda: self**0.5,
            "cbrt": lambda: self ** (1 / 3),
            "square": lambda: self * self,
            "reciprocal": lambda: 1.0 / self,
            "expm1": lambda: self.exp() - 1.0,
            "log1p": (self + 1.0).log,
            "arctan": lambda: self.arctan2(1.0),
            "arcsin": lambda: self._integrated(
                np.arcsin(self.series[0]), self._rate() / (1.0 - self * self) ** 0.5
            ),
            "arccos": lambda: self._integrated(
                np.arccos(self.series[0]), -self._rate() / (1.0 - self * self) ** 0.5
            ),
        }
        if name in simple:
            return simple[name]
        raise AttributeError(name)

    def __float__(self) -> float:
        """Refuse: a power series is no number."""
        raise TypeError("a power series is no number: float() and branches have no derivative")

    def _compared(self, other: Any) -> Any:
        raise TypeError("a power series has no size: comparisons have no derivative")

    __lt__ = __le__ = __gt__ = __ge__ = _compared
