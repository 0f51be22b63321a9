"""The user's functions, called for several points at once, and their derivatives."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian import _core
from gramian import _options as options
from gramian._arrays import as_float_array
from gramian.exceptions import InputError

__all__ = ["Function", "complex_step", "derivative", "found_moves", "many", "real_array"]

Array = NDArray[np.float64]
Function = Callable[..., Any]
#: Of times (k,) and states (k, n).
Many = Callable[[Array, Array], Array]


def real_array(value: Any, what: str) -> Array:
    """Return what a function of the caller's returned as real numbers: NaN is its own."""
    array: Array = as_float_array(value, what)
    return array


def many(function: Function, name: str, size: int | None, vectorized: bool) -> Many:
    """Return the function of times (k,) and states (k, n) with values (k, size)."""

    def checked(value: Any, count: int) -> Array:
        array = real_array(value, f"what {name} returned")
        if array.ndim == 0:
            array = array[None]
        wanted = (size, count) if vectorized else (size,)
        if array.ndim != len(wanted) or (size is not None and array.shape != wanted):
            shape = ", ".join("p" if w is None else str(w) for w in wanted)
            raise InputError(f"{name} returned shape {array.shape}: must be ({shape})")
        return array

    def call(t: Array, x: Array) -> Array:
        if vectorized:
            return np.ascontiguousarray(checked(function(t, x.T), len(t)).T)
        return np.array([checked(function(float(a), b), 1) for a, b in zip(t, x, strict=True)])

    return call


def given(function: Function, name: str, shape: tuple[int, int], vectorized: bool) -> Many:
    """Return a given Jacobian as a function of times (k,) and states (k, n)."""

    def call(t: Array, x: Array) -> Array:
        if vectorized:
            values = real_array(function(t, x.T), f"what {name} returned")
            if values.shape == shape:
                values = np.broadcast_to(values[:, :, None], (*shape, len(t)))
            if values.shape != (*shape, len(t)):
                raise InputError(
                    f"{name} returned shape {values.shape}: must be {(*shape, len(t))}"
                )
            return np.ascontiguousarray(np.moveaxis(values, -1, 0))
        out = np.empty((len(t), *shape))
        for k, (a, b) in enumerate(zip(t, x, strict=True)):
            value = real_array(function(float(a), b), f"what {name} returned")
            if value.shape != shape:
                raise InputError(f"{name} returned shape {value.shape}: must be {shape}")
            out[k] = value
        return out

    return call


def complex_step(function: Function, size: int, vectorized: bool) -> Many:
    """Return the Jacobian by complex steps: exact to rounding where the code is analytic."""
    step = 1e-30

    def call(t: Array, x: Array) -> Array:
        count, n = x.shape
        points = np.repeat(x.astype(complex), n, axis=0)
        points[np.arange(count * n), np.tile(np.arange(n), count)] += 1j * step
        times = np.repeat(t, n)
        if vectorized:
            values = np.asarray(function(times, points.T)).T
        else:
            values = np.array(
                [
                    np.atleast_1d(np.asarray(function(float(a), b)))
                    for a, b in zip(times, points, strict=True)
                ]
            )
        derivative = np.imag(values).reshape(count, n, size) / step
        return np.ascontiguousarray(np.swapaxes(derivative, 1, 2))

    return call


def by_jax(function: Function, vectorized: bool) -> Many:
    """Return the Jacobian by forward differentiation of JAX."""
    try:
        jax: Any = importlib.import_module("jax")
    except ImportError:
        raise InputError('jacobian = "jax" needs JAX: pip install jax') from None
    if vectorized:
        raise InputError('jacobian = "jax" takes functions of one state: set vectorized=False')
    jax.config.update("jax_enable_x64", True)
    forward = jax.jit(jax.vmap(jax.jacfwd(lambda t, x: jax.numpy.asarray(function(t, x)), 1)))

    def call(t: Array, x: Array) -> Array:
        values: Array = np.ascontiguousarray(np.asarray(forward(t, x), dtype=float))
        return values

    return call


def derivative(
    function: Function,
    jacobian: Any,
    name: str,
    shape: tuple[int, int],
    vectorized: bool,
    at: tuple[Array, Array],
    scale: Array,
) -> Many | None:
    """Return how the Jacobian of a function is found; None for differences in the crate.

    "auto" takes complex steps where they agree with a difference at `at`.
    """
    if callable(jacobian):
        return given(jacobian, f"the Jacobian of {name}", shape, vectorized)
    word = jacobian if isinstance(jacobian, str) else ""
    if word == "differences":
        return None
    if word == "jax":
        return by_jax(function, vectorized)
    found = complex_step(function, shape[0], vectorized)
    if word == "complex":
        return found
    if not isinstance(jacobian, str) or jacobian != "auto":
        raise InputError(
            f'jacobian = {options.given(jacobian)}: must be "auto", "complex", "differences", '
            '"jax" or two functions'
        )
    t, x = at
    plain = many(function, name, shape[0], vectorized)
    direction = scale * np.linspace(0.6, 1.0, x.shape[1])
    try:
        with np.errstate(all="ignore"):
            exact = found(t, x)[0] @ direction
    except (TypeError, ValueError, InputError, ArithmeticError, np.exceptions.ComplexWarning):
        return None
    step = 1e-4
    rough = (plain(t, x + step * direction) - plain(t, x - step * direction))[0] / (2 * step)
    size = np.abs(rough).max(initial=0.0) + np.abs(exact).max(initial=0.0)
    agrees = np.isfinite(exact).all() and np.abs(exact - rough).max(initial=0.0) <= 1e-4 * size
    return found if agrees else None


def found_moves(
    functions: Mapping[str, Many | None], t: float, x: Array, names: tuple[str, ...], most: Array
) -> Array:
    """Return over which moves (n,) functions bend at x: 500 of the best steps, or `most`.

    Raises
    ------
    InputError
        Where one jumps or has no derivative there.
    """
    moves = most
    for name, function in functions.items():
        if function is not None:
            step = _steps(function, name, t, x, names)
            moves = np.fmin(moves, np.where(step > 0, 500 * step, np.inf))
    return moves


def _steps(function: Many, name: str, t: float, x: Array, names: tuple[str, ...]) -> Array:
    """Return the longest good step of each state."""

    def values(points: Array) -> Array:
        return function(np.full(len(points), t), points)

    here = values(x[None])[0]
    unknown = np.full(len(x), np.nan)
    try:
        with np.errstate(all="ignore"):
            found = _core.differences(
                values,
                x,
                here,
                unknown,
                1 / np.where(here == 0, 1.0, np.abs(here)),
                np.zeros(here.size),
                np.full(here.size, np.nan),
                unknown,
                None,
                names,
            )
    except InputError as error:
        told = str(error).replace("h(x)", name).split(": for an angle")[0]
        wraps = " jumps " in told or " kink " in told
        hint = ": give sine and cosine of an angle that wraps, or a jacobian" if wraps else ""
        raise InputError(f"at t = {t:g} {told}{hint}") from None
    return found.step()
