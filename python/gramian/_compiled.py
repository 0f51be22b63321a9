"""Measurement functions that are compiled already (numba, C), called without the interpreter."""

from __future__ import annotations

import ctypes
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from gramian import _core
from gramian.exceptions import InputError

__all__ = ["CompiledFunction", "is_compiled"]

Array = NDArray[np.float64]

# The base of functions of ctypes, which has no public name.
_POINTER: Any = ctypes.CFUNCTYPE(None).__mro__[1]
#: What a function is declared as, without spaces.
PLAIN, WITH_DATA = "void(double*,double*)", "void(double*,double*,void*)"


def is_compiled(h: Any) -> bool:
    """Say whether a function has an address: numba's `cfunc`, SciPy's callable, ctypes'."""
    return _is_numba(h) or _is_low_level(h) or isinstance(h, _POINTER)


class CompiledFunction:
    """A compiled measurement function as the models take it: (count, n) to (count, m).

    Attributes
    ----------
    source : object
        What tells this function from others in another process: numba's Python function, or
        how it is declared.
    """

    def __init__(self, h: Any, jacobian: Any, states: int, measurements: int) -> None:
        self.source = [_source(h), None if jacobian is None else _source(jacobian)]
        self.has_jacobian = jacobian is not None
        address, data = _entry(h, "h")
        # In a slot of the type, not of the value: addresses are of this process.
        self._handle = _Handle(
            _core.Compiled(
                address,
                data,
                None if jacobian is None else _entry(jacobian, "jacobian"),
                states,
                measurements,
                (h, jacobian),
            )
        )

    def __call__(self, points: Any) -> Array:
        """Return the values (..., m) at points (..., n)."""
        return self._handle.compiled.values(points)

    def jacobian(self, points: Any) -> Array:
        """Return the derivatives (..., m, n) at points (..., n)."""
        return self._handle.compiled.jacobians(points)

    def maximum_likelihood(self, *arguments: Any) -> Array:
        """Return status, NEES and errors (trials, 2 + n): see the extension."""
        return self._handle.compiled.maximum_likelihood(*arguments)

    def __reduce__(self) -> NoReturn:
        raise InputError(
            "a compiled h has its address in this process alone: it cannot be pickled or sent to "
            "another one; its Monte Carlo trials run on threads"
        )

    def __deepcopy__(self, memo: Any) -> CompiledFunction:
        return self


class _Handle:
    """The extension's object, out of the reach of what goes by contents."""

    __slots__ = ("compiled",)

    def __init__(self, compiled: _core.Compiled) -> None:
        self.compiled = compiled


def _is_numba(h: Any) -> bool:
    return type(h).__module__.startswith("numba.") and hasattr(h, "address")


def _is_low_level(h: Any) -> bool:
    return isinstance(h, tuple) and type(h).__name__ == "LowLevelCallable"


def _source(h: Any) -> Any:
    if _is_numba(h):
        return getattr(h, "_pyfunc", None)
    return h.signature if _is_low_level(h) else PLAIN


def _entry(h: Any, name: str) -> tuple[int, int | None]:
    """Return the address, and that of its own data where it takes some; checked."""
    if _is_numba(h):
        declared = str(h._sig)
        if declared != "(float64*, float64*) -> none":
            raise _wrong(
                name, declared, 'numba.cfunc("void(CPointer(float64), CPointer(float64))")'
            )
        return int(h.address), None
    if _is_low_level(h):
        declared = str(h.signature)
        plain = declared.replace(" ", "")
        if plain not in (PLAIN, WITH_DATA):
            raise _wrong(
                name, declared, "void (double *, double *) or void (double *, double *, void *)"
            )
        api: Any = ctypes.pythonapi
        api.PyCapsule_GetName.restype = ctypes.c_char_p
        api.PyCapsule_GetPointer.restype = api.PyCapsule_GetContext.restype = ctypes.c_void_p
        for call in (api.PyCapsule_GetName, api.PyCapsule_GetContext):
            call.argtypes = [ctypes.py_object]
        api.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
        capsule = tuple.__getitem__(h, 0)
        address = api.PyCapsule_GetPointer(capsule, api.PyCapsule_GetName(capsule))
        data = api.PyCapsule_GetContext(capsule) or 0
        return address, data if plain == WITH_DATA else None
    number = ctypes.POINTER(ctypes.c_double)
    if not isinstance(h, _POINTER):
        raise InputError(
            f"{name} is a {type(h).__name__}: must be compiled like h (numba.cfunc, "
            "scipy.LowLevelCallable or a ctypes function)"
        )
    if h.restype is not None or list(h.argtypes or ()) != [number, number]:
        told = [getattr(kind, "__name__", str(kind)) for kind in h.argtypes or ()]
        raise _wrong(
            name,
            f"argtypes = {told}, restype = {getattr(h.restype, '__name__', h.restype)}",
            "argtypes = [POINTER(c_double), POINTER(c_double)], restype = None",
        )
    address = ctypes.cast(h, ctypes.c_void_p).value
    if not address:
        raise InputError(f"{name} is a null pointer: must be a function")
    return address, None


def _wrong(name: str, declared: str, wanted: str) -> InputError:
    return InputError(
        f"{name} is declared as {declared}: must be {wanted}, which takes the state (n,) and "
        f"writes the {'derivatives (m, n)' if name == 'jacobian' else 'measurements (m,)'}"
    )
