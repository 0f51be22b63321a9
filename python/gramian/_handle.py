"""A model of any kind as the extension calls it."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gramian import _core
from gramian import _options as options
from gramian.exceptions import InputError

__all__ = ["EstimationModel", "as_model", "handle_of"]

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
