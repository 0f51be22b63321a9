"""Functions written for JAX, PyTorch and CasADi as functions of arrays, with their Jacobians."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gramian.exceptions import InputError

__all__ = ["FOREIGN"]

Array = NDArray[np.float64]


def parts(value: Any) -> Iterator[Any]:
    """Yield the numbers and arrays of lists in lists, in order."""
    for part in value:
        if isinstance(part, (list, tuple)):
            yield from parts(part)
        else:
            yield part


def lines(value: Any, flat: Callable[[Any], Any], stack: Callable[[Any], Any]) -> Any:
    """Return what a vectorized function returns for each point as an array."""
    return stack([flat(line) for line in value]) if isinstance(value, (list, tuple)) else value


class JaxFunction:
    """A function written for JAX as a function of arrays, with its Jacobian."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        try:
            import jax  # noqa: F401
        except ImportError as error:
            raise InputError('method = "jax" needs jax: pip install jax') from error
        self._h = function

    def _value(self, x: Any) -> Any:
        from jax import numpy

        def flat(value: Any) -> Any:
            if isinstance(value, (list, tuple)):
                return numpy.concatenate([numpy.ravel(part) for part in parts(value)])
            return value

        return lines(self._h(x), flat, numpy.stack) if x.ndim > 1 else flat(self._h(x))

    def __call__(self, x: Array) -> NDArray[Any]:
        from jax import numpy

        return np.asarray(self._value(numpy.asarray(x)))

    def jacobian_of(self, x: Array, *, vectorized: bool) -> NDArray[Any]:
        import jax
        from jax import numpy

        def h(state: Any) -> Any:
            value = numpy.ravel(self._value(state[None])[0] if vectorized else self._value(state))
            if numpy.iscomplexobj(value):
                return numpy.concatenate([value.real, value.imag])
            return value

        return np.asarray(jax.jacfwd(h)(x)).reshape(-1, x.size)


class TorchFunction:
    """A function written for PyTorch as a function of arrays, with its Jacobian."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        try:
            import torch  # noqa: F401
        except ImportError as error:
            raise InputError('method = "torch" needs PyTorch: pip install torch') from error
        self._h = function

    def _value(self, x: Any) -> Any:
        import torch

        def tensor(part: Any) -> Any:
            return part if isinstance(part, torch.Tensor) else torch.as_tensor(np.asarray(part))

        def flat(value: Any) -> Any:
            if isinstance(value, (list, tuple)):
                return torch.cat([tensor(part).reshape(-1) for part in parts(value)])
            if not isinstance(value, torch.Tensor):
                raise InputError(f"h returns a {type(value).__name__}: must be a tensor, or a list")
            return value

        return lines(self._h(x), flat, torch.stack) if x.ndim > 1 else flat(self._h(x))

    def __call__(self, x: Array) -> NDArray[Any]:
        import torch

        value = self._value(torch.tensor(x, dtype=torch.float64))
        return np.asarray(value.detach().cpu().numpy())

    def jacobian_of(self, x: Array, *, vectorized: bool) -> NDArray[Any]:
        import torch

        def h(state: Any) -> Any:
            value = self._value(state[None])[0] if vectorized else self._value(state)
            value = value.reshape(-1)
            return torch.cat([value.real, value.imag]) if value.is_complex() else value

        found = torch.autograd.functional.jacobian(h, torch.tensor(x, dtype=torch.float64))
        return np.asarray(found.detach().cpu().numpy()).reshape(-1, x.size)


class CasadiFunction:
    """A CasADi function as a function of arrays, with its Jacobian."""

    def __init__(self, function: Any) -> None:
        try:
            import casadi
        except ImportError as error:
            raise InputError('method = "casadi" needs CasADi: pip install casadi') from error
        if not isinstance(function, casadi.Function):
            raise InputError(f"h is a {type(function).__name__}: must be a casadi.Function")
        state = casadi.MX.sym("x", function.size1_in(0))
        value = casadi.vec(function(state))
        self._value = casadi.Function("h", [state], [value])
        self._jacobian = casadi.Function("dh", [state], [casadi.jacobian(value, state)])

    def __call__(self, x: Array) -> Array:
        return np.asarray(self._value(x), dtype=float).ravel()

    def jacobian_of(self, x: Array, *, vectorized: bool) -> Array:
        if vectorized:
            raise InputError("vectorized = True: a CasADi function takes one state; leave it out")
        return np.asarray(self._jacobian(x), dtype=float).reshape(-1, x.size)


#: By the method of `from_function`.
FOREIGN: Mapping[str, Callable[[Any], Any]] = {
    "jax": JaxFunction,
    "torch": TorchFunction,
    "casadi": CasadiFunction,
}
