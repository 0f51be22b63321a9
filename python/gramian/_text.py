"""Numbers and combinations of states in words, and as JSON can hold them."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian import _core

__all__ = [
    "above_noise",
    "brief",
    "count",
    "describe_combination",
    "describe_direction",
    "describe_null_space",
    "number",
    "plain",
    "signed",
    "visible",
]

Array = NDArray[np.float64]


def number(value: float, digits: int = 4) -> str:
    """Return a number for a table: "not observable" for infinity."""
    if np.isinf(value):
        return "not observable"
    if value == 0:
        return "0"
    size = abs(value)
    if 1e-3 <= size < 1e6:
        text = f"{value:.{digits}g}"
        return f"{value:.0f}" if "e" in text else text
    return f"{value:.{digits - 1}e}"


def brief(value: Any, digits: int = 3) -> str:
    """Return a number in so many digits, for a sentence: 580, not 5.8e+02.

    Examples
    --------
    >>> brief(583.2, 2), brief(0.0123456), brief(4.2e-9, 2), brief(float("inf"))
    ('580', '0.0123', '4.2e-09', 'inf')
    """
    return _core.brief(value, digits)


def signed(value: Any, digits: int = 3) -> str:
    """Return a change, with its sign: "+580", "-0.0123"."""
    return ("-" if value < 0 else "+") + brief(abs(value), digits)


def count(n: int, one: str, many: str = "") -> str:
    """Return a count with its noun: "1 row", "2 rows"; `many` where it is not one + "s"."""
    return f"{n} {one if n == 1 else many or one + 's'}"


def visible(text: str) -> str:
    r"""Return text from a file as it may go to a terminal: control characters are shown.

    A terminal obeys them: an escape sequence can set its title.

    Examples
    --------
    >>> print(visible("ship\x1b[31m"))
    ship\x1b[31m
    """
    if text.isprintable():
        return text
    return "".join(
        sign
        if sign in "\n\t" or not unicodedata.category(sign).startswith(("Cc", "Cf"))
        else sign.encode("unicode_escape").decode()
        for sign in text
    )


def describe_null_space(null_space: Array, names: Sequence[str]) -> tuple[str, ...]:
    """Return each column as text: "x0 +1, vx +0.42"."""
    return tuple(describe_direction(column, names) for column in null_space.T)


#: A combination of more states than this is described by what it moves, or by its largest.
LONG = 12


def above_noise(change: Array) -> Array:
    """Return a direction without the components that are rounding, noise in a text."""
    kept: Array = np.where(np.abs(change) < 1e-9 * np.abs(change).max(), 0.0, change)
    return kept


def describe_direction(change: Array, names: Sequence[str]) -> str:
    """Return how states move together: "x0 +1, vx -0.42", without those that stay.

    Not written as a sum, which is what `describe_combination` says a measurement knows. Of
    many states that move alike it says so; of many others, the ten largest.
    """
    return _described(change, names, _moves)


def describe_combination(coefficients: Array, names: Sequence[str]) -> str:
    """Return c^T x as text, "1 x0 - 0.42 vx", without the states that have no part in it.

    Of many states with the same part it says so; of many others, the ten largest.
    """
    return _described(coefficients, names, _sum)


def _described(
    coefficients: Array,
    names: Sequence[str],
    write: Callable[[Array, Sequence[str], NDArray[np.intp]], str],
) -> str:
    part = np.flatnonzero(coefficients)
    if len(part) > LONG:
        values = coefficients[part]
        if np.allclose(values, values[0], rtol=1e-6):
            return f"all {len(part)} of {_together([names[int(i)] for i in part])} move together"
        largest = np.sort(part[np.argsort(-np.abs(values), kind="stable")[:10]])
        left = count(len(part) - len(largest), "smaller term")
        return f"{write(coefficients, names, largest)} and {left}"
    return write(coefficients, names, part)


def _moves(change: Array, names: Sequence[str], part: NDArray[np.intp]) -> str:
    return _core.moves(change[part], [names[int(i)] for i in part])


def _sum(coefficients: Array, names: Sequence[str], part: NDArray[np.intp]) -> str:
    text = ""
    for i in part:
        sign = "-" if coefficients[i] < 0 else "+"
        text += f" {sign} " if text else ("-" if sign == "-" else "")
        text += f"{brief(abs(coefficients[i]), 4)} {names[int(i)]}"
    return text


def _together(names: Sequence[str]) -> str:
    """Return what names have in common: "x" for x0, x1, ..., or the first and last."""
    stems = {name.rstrip("0123456789[]()_, ") for name in names}
    return stems.pop() if len(stems) == 1 and "" not in stems else f"{names[0]} .. {names[-1]}"


def plain(value: Any) -> Any:  # noqa: PLR0911  (a kind a line)
    """Return a value as JSON can hold it; "inf", "-inf" and "nan" for what is not finite."""
    if value is None or isinstance(value, (str, bool)):
        return value
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray):
        if value.dtype.kind == "f" and np.isfinite(value).all():
            return value.tolist()
        return [plain(item) for item in value] if value.ndim else plain(value.item())
    if isinstance(value, int):
        return value
    if isinstance(value, float):
        return value if np.isfinite(value) else str(value)
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(item) for item in value]
    made = getattr(value, "to_dict", None)
    return str(value) if made is None else made()
