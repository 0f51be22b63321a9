"""A model of any kind as the extension calls it."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import finite
from gramian.exceptions import InputError

__all__ = ["EstimationModel", "as_model", "check_rows", "check_shapes", "exact_data", "handle_of"]

Array = NDArray[np.float64]


class EstimationModel(Protocol):
    """What `estimate` needs of a model.

    It may also have ``x`` or ``starts(z)`` (where to start), ``handle(z)`` (a compiled
    model), ``symmetries(x)`` (states with the same data), ``functions`` (named functions
    of the states), ``alternatives(x, z)`` (named columns), ``faults(z)`` (what is wrong with the
    measurements themselves, in words: see `gramian.estimation.channel_faults`) and ``scale``.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the states."""

    def h(self, x: Any) -> Array:
        """Return the exact measurements (m,) at a state."""

    def residuals(self, x: Any, z: Any) -> Array:
        """Return the whitened residuals (m,) of measurements at a state."""

    def rows(self, x: Any) -> Array:
        """Return the whitened rows (m, n) at a state."""


def as_model(model: Any) -> Any:
    """Return what has the parts of an `EstimationModel`, and refuse what has not."""
    lacking = [
        part for part in ("names", "units", "h", "residuals", "rows") if not hasattr(model, part)
    ]
    if lacking or isinstance(model, type):
        raise InputError(
            f"model = {options.given(model)}: must be a model (`from_function`, "
            "`bearings.BearingsModel`, ...)"
            + (f", it has no {', '.join(lacking)}" if lacking else "")
        )
    return model


def check_shapes(model: Any, z: Array, x: Array) -> Array | None:
    """Refuse residuals and rows of a model in Python that have other shapes than (m,), (m, n).

    The rows are returned; None of a compiled model, and where there are none.
    """
    if hasattr(model, "handle"):
        return None
    found = _at(model, z, x)
    if found is None:
        return None
    m, n = np.size(z), len(model.names)
    for name, value, shape in (("residuals", found[0], (m,)), ("rows", found[1], (m, n))):
        if np.shape(value) != shape:
            raise InputError(f"{name} of the model have shape {np.shape(value)}: must be {shape}")
    return np.asarray(found[1], dtype=float)


def check_rows(model: Any, z: Array, x: Array) -> None:
    """Refuse rows of a model in Python that are plainly not the derivative of its residuals.

    Along one direction first, which costs four evaluations however many states there are.
    """
    rows = check_shapes(model, z, x)
    if rows is None:
        return
    length = np.linalg.norm(rows, axis=0)
    # A thousandth of a standard deviation; of the state itself where the rows see nothing of it.
    step = np.where(length > 0, 1e-3 / np.where(length > 0, length, 1.0), 1e-6 * (1 + np.abs(x)))
    sign = np.where(np.random.default_rng(0).random(x.size) < 0.5, -1.0, 1.0)
    if _agrees(model, z, x, rows, sign * step):
        return
    for k, name in enumerate(model.names):
        if not _agrees(model, z, x, rows, np.where(np.arange(x.size) == k, step, 0.0)):
            raise InputError(
                f"rows of the model by {name} are not the derivatives of -residuals at "
                f"{np.array2string(x, precision=6)}: check the signs of both, and that both are "
                "divided by sigma"
            )


def exact_data(model: Any, x: Array) -> Array:
    """Return h(x), where the rows are the derivatives of the residuals."""
    z = finite(model.h(x), "exact data")
    check_rows(model, z, x)
    return z


def _agrees(model: Any, z: Array, x: Array, rows: Array, step: Array) -> bool:
    """Return whether rows foretell a step within 5 %, or differences cannot tell."""
    told = rows @ step
    try:
        once, twice = (
            (np.asarray(model.residuals(x - k * step, z)) - model.residuals(x + k * step, z))
            / (2 * k)
            for k in (1, 2)
        )
    except (ValueError, ArithmeticError):
        return True
    off = np.linalg.norm(once - told)
    size = max(np.linalg.norm(once), np.linalg.norm(told))
    # Rounding, kinks and jumps show in that the two differ.
    return not (off > 0.05 * size and np.linalg.norm(once - twice) < 0.2 * off)


def _at(model: Any, z: Array, x: Array) -> tuple[Any, Any] | None:
    """Return residuals and rows; None where there are none."""
    try:
        found = model.residuals(x, z), model.rows(x)
    except (ValueError, ArithmeticError):
        return None
    return found if all(np.isfinite(value).all() for value in found) else None


def handle_of(model: Any, z: Array) -> _core.Model:
    """Return the extension's model of these measurements."""
    made = getattr(model, "handle", None)
    if made is not None:
        handle: _core.Model = made(z)
        return handle

    def linearize(x: Array, with_rows: bool) -> tuple[Array, Array | None]:
        return model.residuals(x, z), model.rows(x) if with_rows else None

    def difference(start: Array, to: Array) -> Array:
        between: Array = model.residuals(start, model.h(to))
        return between

    symmetries = getattr(model, "symmetries", None)
    return _core.Model.from_functions(
        len(model.names), np.size(z), linearize, difference, symmetries
    )
