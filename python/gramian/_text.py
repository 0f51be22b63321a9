"""Numbers and combinations of states in words, and as JSON can hold them."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["describe_combination", "describe_null_space", "number", "plain", "visible"]

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
    """Return each column as text: "1 x0 + 0.42 vx"."""
    return tuple(describe_combination(column, names) for column in null_space.T)


#: A combination of more states than this is told by what it moves, or by its largest.
LONG = 12


def describe_combination(coefficients: Array, names: Sequence[str]) -> str:
    """Return c^T x as text, without the states that have no part in it.

    Of many states that move alike it says so; of many others, the ten largest.
    """
    part = np.flatnonzero(coefficients)
    if len(part) > LONG:
        values = coefficients[part]
        if np.allclose(values, values[0], rtol=1e-6):
            return f"all {len(part)} of {_together([names[int(i)] for i in part])} move together"
        largest = np.sort(part[np.argsort(-np.abs(values), kind="stable")[:10]])
        left = len(part) - len(largest)
        return f"{_sum(coefficients, names, largest)} and {left} smaller terms"
    return _sum(coefficients, names, part)


def _sum(coefficients: Array, names: Sequence[str], part: NDArray[np.intp]) -> str:
    text = ""
    for i in part:
        sign = "-" if coefficients[i] < 0 else "+"
        text += f" {sign} " if text else ("-" if sign == "-" else "")
        text += f"{abs(coefficients[i]):.4g} {names[int(i)]}"
    return text


def _together(names: Sequence[str]) -> str:
    """Return what names have in common: "x" for x0, x1, ..., or the first and last."""
    stems = {name.rstrip("0123456789[]()_, ") for name in names}
    return stems.pop() if len(stems) == 1 and "" not in stems else f"{names[0]} .. {names[-1]}"


def plain(value: Any) -> Any:
    """Return numbers and arrays as what JSON can hold; "inf", "-inf" for infinities."""
    if isinstance(value, np.ndarray) and value.ndim:
        return [plain(item) for item in value]
    number = float(value)
    return number if np.isfinite(number) else str(number)
