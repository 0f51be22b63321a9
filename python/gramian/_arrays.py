"""Arguments to arrays and numbers: what is not a real number is named, never guessed."""

from __future__ import annotations

from math import isfinite, isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian import _core
from gramian.exceptions import InputError

__all__ = [
    "ITERATIONS_MOST",
    "SEED_MOST",
    "above_rounding",
    "as_float_array",
    "finite",
    "number",
    "real",
    "representable",
    "require_finite",
    "rounding_of_columns",
    "whole",
    "wrap_angles",
]

Array = NDArray[np.float64]

SEED_MOST = 2**64 - 1
#: Steps of an estimator: one that has not come to rest after so many never does.
ITERATIONS_MOST = 10_000


# The gate itself, `convert` in the extension: dtype, masks, finiteness, layout.
as_float_array = _core.as_float_array
finite = _core.as_finite_array
require_finite = _core.require_finite
above_rounding = _core.above_rounding
representable = _core.representable
rounding_of_columns = _core.rounding_of_columns


def number(value: Any, name: str) -> float:
    """Return one finite number."""
    if type(value) is float and isfinite(value):
        return value
    return _one(finite(value, name), name)


def real(value: Any, name: str) -> float:
    """Return one number that may be infinite."""
    if type(value) is float and not isnan(value):
        return value
    array = as_float_array(value, name)
    return _one(array if array.shape == () and array == np.inf else finite(array, name), name)


def _one(array: Array, name: str) -> float:
    if array.shape != ():
        shown = name.rpartition(" [")[0] if name.endswith("]") and " [" in name else name
        raise InputError(f"{shown} has shape {array.shape}: must be one number")
    return float(array)


def whole(value: Any, name: str, least: int = 0, most: int = 2**63 - 1) -> int:
    """Return a whole number from `least` to `most`."""
    try:
        count = int(value)
        fits = count == value and not isinstance(value, (bool, str))
    except Exception:  # whatever a value of a strange kind raises
        fits = False
    if not fits:
        raise InputError(f"{name} = {value!r}: must be a whole number >= {least}")
    if not least <= count <= most:
        limit = f">= {least}" if count < least else f"<= {most}"
        raise InputError(f"{name} = {value!r}: must be {limit}")
    return count


def wrap_angles(angles: Array) -> Array:
    """Return the angles in (-pi, pi] that differ from these by whole turns."""
    # In one array: many records of many angles do not fit the caches several times.
    wrapped: Array = np.asarray(angles / (2 * np.pi))
    wrapped -= 0.5
    np.ceil(wrapped, out=wrapped)
    wrapped *= 2 * np.pi
    return np.subtract(angles, wrapped, out=wrapped)
