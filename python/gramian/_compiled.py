"""Functions that are compiled already (numba, C), called without the interpreter."""

from __future__ import annotations

import ctypes
from typing import Any, Generic, NamedTuple, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from gramian import _core
from gramian.exceptions import InputError

__all__ = ["CompiledFunction", "TrialFunction", "is_compiled"]

Array = NDArray[np.float64]
T = TypeVar("T")

# The base of functions of ctypes, which has no public name.
_POINTER: Any = ctypes.CFUNCTYPE(None).__mro__[1]
#: What C calls the types of numba and of ctypes.
_NUMBA = {"none": "void", "int32": "int", "float64*": "double*"}
_CTYPES = {None: "void", ctypes.c_int: "int", ctypes.POINTER(ctypes.c_double): "double*"}


class _Use(NamedTuple):
    """What a function is for: the declarations allowed, without spaces, and the same in words."""

    allowed: tuple[str, ...]
    wanted: str
    does: str


_PLAIN = "(double*,double*)"
_WANTED = "void (double *, double *)"
_VALUES = _Use((f"void{_PLAIN}",), _WANTED, "takes the state (n,) and writes the measurements (m,)")
_DERIVATIVES = _Use(
    (f"void{_PLAIN}",), _WANTED, "takes the state (n,) and writes the derivatives (m, n)"
)
_QUANTITY = _Use(
    (f"void{_PLAIN}", f"int{_PLAIN}"),
    "void or int (double *, double *)",
    "takes the measurements of a trial and writes one number",
)
_ESTIMATE = _Use(
    (*_QUANTITY.allowed, "void(double*,double*,double*)", "int(double*,double*,double*)"),
    "void or int (double *, double *) or (double *, double *, double *)",
    "takes the measurements of a trial and writes the estimate (n,), and with a third pointer its "
    "covariance (n, n)",
)


def is_compiled(h: Any) -> bool:
    """Say whether a function has an address: numba's `cfunc`, SciPy's callable, ctypes'."""
    return _is_numba(h) or _is_low_level(h) or isinstance(h, _POINTER)


class CompiledFunction:
    """A compiled measurement function as the models take it: (count, n) to (count, m).

    Attributes
    ----------
    source : object
        What tells this function from others in another process: numba's Python function, or
        how it is declared and named.
    """

    def __init__(self, h: Any, jacobian: Any, states: int, measurements: int) -> None:
        self.source = [_source(h), None if jacobian is None else _source(jacobian)]
        self.has_jacobian = jacobian is not None
        entry = _entry(h, "h", _VALUES)
        derivatives = None
        if jacobian is not None:
            found = _entry(jacobian, "jacobian", _DERIVATIVES)
            derivatives = (found.address, found.data)
        # In a slot of the type, not of the value: addresses are of this process.
        self._handle = _Handle(
            _core.Compiled(
                entry.address, entry.data, derivatives, states, measurements, (h, jacobian)
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
        raise _bound_to_its_process("h")

    def __deepcopy__(self, memo: Any) -> CompiledFunction:
        return self


class TrialFunction:
    """A compiled function of one trial's measurements: an estimator, or a quantity.

    It is not callable: what is callable is a function in Python.

    Attributes
    ----------
    source : object
        As of `CompiledFunction`.
    size : int
        How many numbers it writes.
    covariance : bool
        Whether it writes a covariance (size, size) too.
    """

    def __init__(self, function: Any, name: str, size: int, use: _Use) -> None:
        entry = _entry(function, name, use)
        self.source = _source(function)
        self.__name__ = _name(function)
        self.size = size
        self.covariance = entry.declared.count("double*") > 2
        returns = entry.declared.startswith("int")
        self._handle = _Handle(
            _core.TrialFunction(entry.address, entry.data, returns, size, self.covariance, function)
        )

    @classmethod
    def estimator(cls, function: Any, states: int) -> TrialFunction:
        """Return an estimator, checked."""
        return cls(function, "estimator", states, _ESTIMATE)

    @classmethod
    def quantity(cls, function: Any, name: str) -> TrialFunction:
        """Return a quantity, checked."""
        return cls(function, f"quantities[{name!r}]", 1, _QUANTITY)

    def records(self, z: Array) -> tuple[NDArray[np.int64], Array, Array | None]:
        """Return what it returned (trials,) and wrote (trials, size), and its covariances.

        `z` is (trials, ...). What it did not write is NaN.
        """
        found = self._handle.compiled.records(z.reshape(len(z), -1))
        returned, values, claims = np.split(found, [1, 1 + self.size], axis=1)
        covariances = claims.reshape(-1, self.size, self.size) if self.covariance else None
        return returned[:, 0].astype(np.int64), values, covariances

    def __reduce__(self) -> NoReturn:
        raise _bound_to_its_process("estimator or quantity")

    def __deepcopy__(self, memo: Any) -> TrialFunction:
        return self


def _bound_to_its_process(what: str) -> InputError:
    return InputError(
        f"a compiled {what} has its address in this process alone: it cannot be pickled or sent to "
        "another one; its Monte Carlo trials run on threads"
    )


class _Handle(Generic[T]):
    """The extension's object, out of the reach of what goes by contents."""

    __slots__ = ("compiled",)

    def __init__(self, compiled: T) -> None:
        self.compiled = compiled


def _is_numba(h: Any) -> bool:
    return type(h).__module__.startswith("numba.") and hasattr(h, "address")


def _is_low_level(h: Any) -> bool:
    return isinstance(h, tuple) and type(h).__name__ == "LowLevelCallable"


def _source(h: Any) -> Any:
    if _is_numba(h):
        return getattr(h, "_pyfunc", None)
    return [h.signature if _is_low_level(h) else None, _name(h)]


def _name(h: Any) -> str:
    inner = h.function if _is_low_level(h) else h
    inner = getattr(inner, "_pyfunc", inner)
    return str(getattr(inner, "__name__", type(h).__name__))


class _Entry(NamedTuple):
    """Where a function is, the address of its own data where it takes some, its declaration."""

    address: int
    data: int | None
    declared: str


def _entry(h: Any, name: str, use: _Use) -> _Entry:
    """Return where a function is, its declaration checked."""
    if _is_numba(h):
        kinds = [_NUMBA.get(str(kind), "?") for kind in h._sig.args]
        declared = f"{_NUMBA.get(str(h._sig.return_type), '?')}({','.join(kinds)})"
        if declared not in use.allowed:
            example = 'as numba.cfunc("void(CPointer(float64), CPointer(float64))")'
            raise _wrong(name, str(h._sig), use, example)
        return _Entry(int(h.address), None, declared)
    if _is_low_level(h):
        given = str(h.signature).replace(" ", "")
        declared = given.replace(",void*)", ")")
        if declared not in use.allowed:
            raise _wrong(name, h.signature, use, "or with void * as the last")
        address, data = _capsule(tuple.__getitem__(h, 0))
        return _Entry(address, None if declared == given else data, declared)
    if not isinstance(h, _POINTER):
        raise InputError(
            f"{name} is a {type(h).__name__}: must be compiled like h (numba.cfunc, "
            "scipy.LowLevelCallable or a ctypes function)"
        )
    kinds = [_CTYPES.get(kind, "?") for kind in h.argtypes or ()]
    declared = f"{_CTYPES.get(h.restype, '?')}({','.join(kinds)})"
    if declared not in use.allowed:
        told = [getattr(kind, "__name__", str(kind)) for kind in h.argtypes or ()]
        raise _wrong(
            name,
            f"argtypes = {told}, restype = {getattr(h.restype, '__name__', h.restype)}",
            use,
            "as argtypes = [POINTER(c_double), POINTER(c_double)], restype = None",
        )
    place = ctypes.cast(h, ctypes.c_void_p).value
    if not place:
        raise InputError(f"{name} is a null pointer: must be a function")
    return _Entry(place, None, declared)


def _capsule(capsule: Any) -> tuple[int, int]:
    """Return the address of the function in a capsule, and that of its data (0: none)."""
    api: Any = ctypes.pythonapi
    api.PyCapsule_GetName.restype = ctypes.c_char_p
    api.PyCapsule_GetPointer.restype = api.PyCapsule_GetContext.restype = ctypes.c_void_p
    for call in (api.PyCapsule_GetName, api.PyCapsule_GetContext):
        call.argtypes = [ctypes.py_object]
    api.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    address = api.PyCapsule_GetPointer(capsule, api.PyCapsule_GetName(capsule))
    return address, api.PyCapsule_GetContext(capsule) or 0


def _wrong(name: str, declared: str, use: _Use, example: str) -> InputError:
    return InputError(
        f"{name} is declared as {declared}: must be {use.wanted}, {example}, which {use.does}"
    )
