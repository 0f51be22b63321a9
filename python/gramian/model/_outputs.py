"""What a measurement function returned, as numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian._arrays import as_float_array
from gramian.exceptions import InputError
from gramian.problem import Array

__all__ = ["as_outputs", "stacked"]


def as_outputs(values: Any) -> NDArray[Any]:
    """Return what h returned as an array of any type."""
    if np.ma.is_masked(values):
        place = int(np.flatnonzero(np.ma.getmaskarray(values))[0])
        raise InputError(f"h(x)[{place}] is masked: must be a number")
    try:
        return np.asarray(values)
    except ValueError as error:
        # Parts of different lengths.
        raise InputError(f"h(x) cannot be read as an array of numbers: {error}") from None


def stacked(values: NDArray[Any], *, is_complex: bool) -> Array:
    """Return measurements as one vector of real numbers."""
    if is_complex:
        return np.concatenate([values.real.ravel(), values.imag.ravel()]).astype(float)
    return as_float_array(values, "h(x)").ravel()
