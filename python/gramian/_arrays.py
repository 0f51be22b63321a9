"""Arguments to arrays and numbers: what is not a real number is named, never guessed."""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gramian.exceptions import InputError

__all__ = [
    "SEED_MOST",
    "above_rounding",
    "as_float_array",
    "finite",
    "number",
    "representable",
    "require_finite",
    "rounding_of_columns",
    "whole",
    "wrap_angles",
]

Array = NDArray[np.float64]

SEED_MOST = 2**64 - 1


def as_float_array(value: ArrayLike, name: str) -> Array:
    """Return an array of float64, the argument itself where it is one.

    Raises
    ------
    InputError
        For what numpy would convert at a loss: masked entries, complex numbers,
        None; and for what it cannot convert.
    """
    if type(value) is np.ndarray and value.dtype == np.float64:
        return value
    mask = getattr(value, "_mask", None)
    if mask is not None and np.any(mask):
        raise InputError(
            f"{name} has {int(np.count_nonzero(mask))} masked entries: drop or fill them first"
        )
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "fiubO":
            raise TypeError(f"its type is {array.dtype}")
        if array.dtype.kind == "O" and any(item is None for item in array.flat):
            raise TypeError("it holds None")
        result: Array = np.asarray(array, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} cannot be read as an array of numbers: {error}") from error
    return result


def finite(value: ArrayLike, name: str) -> Array:
    """Return an array of finite numbers, or name the first that is not."""
    array = as_float_array(value, name)
    if len(bad := np.argwhere(~np.isfinite(array))):
        index = ", ".join(str(i) for i in bad[0])
        place = f"[{index}]" if index else ""
        raise InputError(f"{name}{place} = {array[tuple(bad[0])]}: must be finite")
    return array


def require_finite(values: Array, name: str) -> Array:
    """Return computed numbers, or refuse them where they left those that can be held."""
    if values.size <= 64:
        # On a few numbers Python is faster than numpy, and small calls are common.
        good = all(map(isfinite, values.ravel().tolist()))
    else:
        with np.errstate(over="ignore", invalid="ignore"):
            # A sum is quicker than a look at each, and finite unless one of them is not.
            good = bool(np.isfinite(values.sum())) or bool(np.isfinite(values).all())
    if not good:
        raise InputError(f"{name} exceeds the numbers that can be held: choose other units")
    return values


def number(value: Any, name: str) -> float:
    """Return one finite number."""
    array = finite(value, name)
    if array.shape != ():
        raise InputError(f"{name} has shape {array.shape}: must be one number")
    return float(array)


def rounding_of_columns(rows: Array, accuracy: Array, width: int) -> Array:
    """Return how much of the length of each column is rounding.

    Parameters
    ----------
    rows : ndarray, shape (K, n)
        Rows of a model.
    accuracy : ndarray, shape (K,)
        Rounding of the entries of each row, relative to the length of the vector they
        are part of.
    width : int
        So many columns after one another hold the coordinates of one vector; an entry
        of exactly 0 is taken for one that is not part of it.
    """
    count, n = rows.shape
    split = rows.reshape(count, -1, width)
    # Divided by the largest, or squares of small numbers would be lost.
    top = float(np.abs(rows).max(initial=0.0)) or 1.0
    lengths = accuracy[:, None] * np.linalg.norm(split / top, axis=2)
    noise: Array = np.sqrt(((split != 0) * lengths[:, :, None] ** 2).sum(axis=0)).reshape(n)
    return top * noise


def above_rounding(rows: Array, noise: Array) -> tuple[Array, float | None]:
    """Return rows without columns that are rounding alone, and the accuracy of the others.

    Ranks are decided on columns of unit length. A target dead ahead along an axis has
    columns that are all rounding, or nearly so: made as long as the others they would
    count as information.

    Parameters
    ----------
    rows : ndarray, shape (K, n)
        Rows of a model.
    noise : ndarray, shape (n,)
        How much of the length of each column is rounding.

    Returns
    -------
    rows : ndarray, shape (K, n)
    rtol : float or None
        Relative accuracy of the scaled columns; None where it is that of plain rows.
    """
    top = float(np.abs(rows).max(initial=0.0)) or 1.0
    sizes = top * np.linalg.norm(rows / top, axis=0)
    # With less than two digits left, a column says nothing.
    held = sizes > 100 * noise
    rtol = float(np.linalg.norm(noise[held] / sizes[held]))
    default = 32 * np.finfo(float).eps * np.sqrt(max(rows.shape))
    return np.where(held, rows, 0.0), rtol if rtol > default else None


def representable(std: Array, rows: ArrayLike) -> Array:
    """Return bounds that double precision can hold; refuse rows whose squares it cannot.

    Raises
    ------
    InputError
        For a bound of 0, one that only units far from the sizes of the states give, or
        none because all entries for a state are too small.
    """
    known = std[np.isfinite(std)]
    if known.size and not (known.min() > 1e-150 and known.max() < 1e150):
        raise InputError(
            "rows are too small or too large for their squares to be held (a bound would be "
            f"{known.min():.3g} to {known.max():.3g}): choose other units"
        )
    if known.size < std.size:
        largest = np.abs(np.asarray(rows, dtype=float)).max(axis=-2, initial=0.0)
        vanishing = (largest > 0) & (largest < 1e-150)
        if vanishing.any():
            raise InputError(
                "rows are too small for their squares to be held (the largest entry of a column "
                f"is {largest[vanishing].max():.3g}): choose other units"
            )
    return std


def whole(value: Any, name: str, least: int = 0, most: int = 2**63 - 1) -> int:
    """Return a whole number from `least` to `most`."""
    try:
        count = int(value)
        fits = count == value and not isinstance(value, (bool, str))
    except (TypeError, ValueError, OverflowError):
        fits = False
    if not fits:
        raise InputError(f"{name} = {value!r}: must be a whole number >= {least}")
    if not least <= count <= most:
        limit = f">= {least}" if count < least else f"<= {most}"
        raise InputError(f"{name} = {value!r}: must be {limit}")
    return count


def wrap_angles(angles: Array) -> Array:
    """Return the angles in (-pi, pi] that differ from these by whole turns."""
    wrapped: Array = angles - 2 * np.pi * np.ceil(angles / (2 * np.pi) - 0.5)
    return wrapped
