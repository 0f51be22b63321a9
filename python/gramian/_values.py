"""Values: what is copied, pickled, compared and stored by its fields alone.

Whatever was worked out from the fields of a `Value`, kernels of the extension included,
is worked out again where it is needed. `encode` and `decode` take values to what JSON can
hold and back, without pickle: a file can name no class but one of these.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gramian.exceptions import InputError

__all__ = ["Value", "decode", "encode", "kind_of"]

#: Every class of values, by the name it has in a file.
_KINDS: dict[str, type[Value]] = {}

#: Modules whose classes are public names of the package itself.
_TOP = {"analysis", "problem", "estimation", "model"}


class Value:
    """What its fields are: copied, pickled, compared and stored by them alone."""

    #: Attributes that count as fields, beside those of the dataclass.
    _more_fields: ClassVar[tuple[str, ...]] = ()
    #: Fields that can be worked out again and are not stored.
    _not_stored: ClassVar[frozenset[str]] = frozenset()
    #: Fields that make no difference between two values.
    _not_compared: ClassVar[frozenset[str]] = frozenset()
    #: What is worked out from the fields and yet goes into a file, since a model that is
    #: a function of the user's does not.
    _saved_results: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        _KINDS[kind_of(cls)] = cls

    @classmethod
    def _stored(cls) -> tuple[str, ...]:
        own: list[str] = [f.name for f in fields(cls)] if is_dataclass(cls) else []
        return tuple(name for name in (*own, *cls._more_fields) if name not in cls._not_stored)

    def __getstate__(self) -> dict[str, Any]:
        state = {name: self.__dict__[name] for name in self._stored() if name in self.__dict__}
        return {
            name: _Frozen(value) if isinstance(value, MappingProxyType) else value
            for name, value in state.items()
        }

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        for name, value in state.items():
            frozen = isinstance(value, _Frozen)
            self.__dict__[name] = MappingProxyType(dict(value)) if frozen else value

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(
            _same(self.__dict__.get(name), other.__dict__.get(name))
            for name in self._stored()
            if name not in self._not_compared
        )

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        parts: list[str] = []
        length = len(type(self).__name__)
        for name in self._stored():
            if name.startswith("_") or name not in self.__dict__:
                continue
            parts.append(f"{name}={_brief(self.__dict__[name])}")
            length += len(parts[-1]) + 2
            if length > 96:
                parts[-1] = "..."
                break
        return f"{type(self).__name__}({', '.join(parts)})"


class _Frozen(dict[str, Any]):
    """A read-only mapping on its way through pickle."""


def kind_of(cls: type) -> str:
    """Return the name of a class in a file: what it is called in the package."""
    path = cls.__module__.removeprefix("gramian.").removeprefix("models.").split(".")
    return cls.__qualname__ if path[0] in _TOP else f"{path[0]}.{cls.__qualname__}"


def _class_of(kind: str) -> type[Value]:
    module = kind.rpartition(".")[0]
    if kind not in _KINDS and module.isidentifier() and module[0] != "_":
        from gramian._registry import REGISTRY

        inner = module in REGISTRY or module == "dynamics"
        try:
            importlib.import_module(f"gramian.models.{module}" if inner else f"gramian.{module}")
        except ImportError as error:
            raise ValueError(f"there is no {kind}") from error
    if kind not in _KINDS and not module:
        for top in sorted(_TOP):
            importlib.import_module(f"gramian.{top}")
    if kind not in _KINDS:
        raise ValueError(f"there is no {kind}")
    return _KINDS[kind]


def _same(a: Any, b: Any) -> bool:  # noqa: PLR0911  (a kind a line)
    """Say whether two fields are equal by value; NaN equals NaN."""
    if a is b:
        return True
    if hasattr(a, "tocsc") and hasattr(b, "tocsc"):
        return bool(a.shape == b.shape and a.dtype == b.dtype and (a != b).nnz == 0)
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return _same_arrays(a, b)
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)) and type(a) is type(b):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, partial) and isinstance(b, partial):
        return _same((a.func, a.args, a.keywords), (b.func, b.args, b.keywords))
    if isinstance(a, (float, complex)) and isinstance(b, (float, complex)):
        return _same_arrays(np.asarray(a), np.asarray(b))
    return bool(a == b)


def _same_arrays(a: Any, b: Any) -> bool:
    if not (isinstance(a, np.ndarray) and isinstance(b, np.ndarray)):
        return False
    if a.shape != b.shape or a.dtype != b.dtype:
        return False
    if a.dtype.names is not None:
        return all(_same_arrays(a[name], b[name]) for name in a.dtype.names)
    if a.dtype == object:
        return all(map(_same, a.ravel().tolist(), b.ravel().tolist()))
    return np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")


def _brief(value: Any) -> str:  # noqa: PLR0911  (a kind a line)
    """Return a field in a few characters."""
    if isinstance(value, np.ndarray):
        if value.ndim == 0 or value.size <= 4:
            return np.array2string(value, precision=4, separator=", ").replace("\n", "")
        return f"array{value.shape}".replace(",)", ")")
    if isinstance(value, (float, np.floating)):
        return f"{value:.5g}"
    if isinstance(value, tuple) and value and all(isinstance(x, float) for x in value[:4]):
        inside = ", ".join(map(_brief, value[:4]))
        return f"({inside}{', ...' if len(value) > 4 else ''})"
    if isinstance(value, (tuple, list)) and len(value) > 3:
        return f"{len(value)} {'names' if isinstance(value[0], str) else 'entries'}"
    if isinstance(value, Mapping):
        return f"{len(value)} entries" if len(value) > 2 else str(dict(value))
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


class _NotSaved:
    """In place of a function, which no file holds."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __call__(self, *args: Any, **options: Any) -> Any:
        raise InputError(
            f"{self.name} was not saved with the answer, as no function is: "
            "give the model again, dataclasses.replace(answer, model=model)"
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _NotSaved) and other.name == self.name

    def __hash__(self) -> int:
        return hash(self.name)


def encode(value: Any) -> Any:
    """Return a value as JSON can hold it, so that `decode` finds it equal."""
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, (int, float)) and not isinstance(value, np.generic):
        return value if isinstance(value, int) or np.isfinite(value) else _special(value)
    for test, encode in _ENCODERS:
        if test(value):
            return encode(value)
    # A model of the user's own, or a function: what it is is not in the answer.
    name = getattr(value, "__name__", None) or f"the {type(value).__name__}"
    return {"$": "function", "name": str(name)}


def _special(value: float) -> dict[str, Any]:
    return {"$": "float", "value": str(value)}


def _encode_value(value: Value) -> dict[str, Any]:
    stored = {
        name: encode(value.__dict__[name]) for name in value._stored() if name in value.__dict__
    }
    for name in value._saved_results:
        stored[name] = encode(getattr(value, name))
    return {"$": "value", "kind": kind_of(type(value)), "fields": stored}


def _encode_array(array: NDArray[Any]) -> dict[str, Any]:
    if array.dtype.names is not None:
        columns = {name: _encode_array(array[name]) for name in array.dtype.names}
        return {"$": "table", "shape": list(array.shape), "columns": columns}
    if array.dtype == object:
        values: list[Any] = [encode(item) for item in array.ravel().tolist()]
    elif array.dtype.kind == "c":
        values = [part for z in array.ravel().tolist() for part in (_float(z.real), _float(z.imag))]
    elif array.dtype.kind == "f":
        flat = array.ravel()
        values = flat.tolist()
        for i in np.flatnonzero(~np.isfinite(flat)).tolist():
            values[i] = str(values[i])
    else:
        values = array.ravel().tolist()
    dtype = array.dtype.str if array.dtype != object else "object"
    return {"$": "array", "dtype": dtype, "shape": list(array.shape), "values": values}


def _float(value: float) -> float | str:
    return value if np.isfinite(value) else str(value)


def _encode_mapping(value: Mapping[Any, Any]) -> dict[str, Any]:
    kind = "frozen" if isinstance(value, MappingProxyType) else "dict"
    return {"$": kind, "items": [[encode(k), encode(v)] for k, v in value.items()]}


def _encode_sparse(value: Any) -> dict[str, Any]:
    parts = {name: _encode_array(getattr(value, name)) for name in ("data", "indices", "indptr")}
    return {"$": "sparse", "format": value.format, "shape": list(value.shape)} | parts


def _encode_slice(value: slice) -> dict[str, Any]:
    return {"$": "slice", "items": [encode(v) for v in (value.start, value.stop, value.step)]}


_ENCODERS: list[tuple[Callable[[Any], bool], Callable[[Any], Any]]] = [
    (lambda v: isinstance(v, Value), _encode_value),
    (lambda v: isinstance(v, np.ndarray), _encode_array),
    (lambda v: isinstance(v, np.generic), lambda v: _encode_array(np.asarray(v)) | {"$": "scalar"}),
    (lambda v: isinstance(v, Mapping), _encode_mapping),
    (lambda v: isinstance(v, tuple), lambda v: {"$": "tuple", "items": [encode(x) for x in v]}),
    (lambda v: isinstance(v, list), lambda v: {"$": "list", "items": [encode(x) for x in v]}),
    (lambda v: isinstance(v, slice), _encode_slice),
    (lambda v: isinstance(v, complex), lambda v: {"$": "complex", "parts": [v.real, v.imag]}),
    (lambda v: isinstance(v, Path), lambda v: {"$": "path", "value": str(v)}),
    (lambda v: getattr(v, "format", None) in ("csr", "csc"), _encode_sparse),
]


def decode(coded: Any) -> Any:
    if not isinstance(coded, dict):
        return coded
    what = coded.get("$")
    if what not in _DECODERS:
        raise ValueError(f"it has an entry of the kind {what!r}")
    return _DECODERS[what](coded)


def _decode_value(coded: Mapping[str, Any]) -> Value:
    cls = _class_of(coded["kind"])
    allowed = {*cls._stored(), *cls._saved_results}
    unknown = [name for name in coded["fields"] if name not in allowed]
    missing = [name for name in cls._stored() if name not in coded["fields"]]
    if unknown or missing:
        raise ValueError(f"{coded['kind']} has other fields: {', '.join(unknown + missing)}")
    made = cls.__new__(cls)
    made.__setstate__({name: decode(value) for name, value in coded["fields"].items()})
    return made


def _decode_array(coded: Mapping[str, Any]) -> NDArray[Any]:
    values, shape = coded["values"], tuple(coded["shape"])
    if coded["dtype"] == "object":
        array = np.empty(len(values), dtype=object)
        array[:] = [decode(value) for value in values]
        return array.reshape(shape)
    dtype = np.dtype(coded["dtype"])
    if dtype.kind == "c":
        parts = np.array([float(value) for value in values])
        return (parts[0::2] + 1j * parts[1::2]).astype(dtype).reshape(shape)
    if dtype.kind == "f":
        values = [float(value) for value in values]
    return np.array(values, dtype=dtype).reshape(shape)


def _decode_table(coded: Mapping[str, Any]) -> NDArray[Any]:
    columns = {name: _decode_array(column) for name, column in coded["columns"].items()}
    table = np.empty(tuple(coded["shape"]), dtype=[(n, c.dtype) for n, c in columns.items()])
    for name, column in columns.items():
        table[name] = column
    return table


def _decode_sparse(coded: Mapping[str, Any]) -> Any:
    from scipy.sparse import csc_array, csr_array

    made = {"csr": csr_array, "csc": csc_array}[coded["format"]]
    parts = tuple(_decode_array(coded[name]) for name in ("data", "indices", "indptr"))
    return made(parts, shape=tuple(coded["shape"]))


_DECODERS: dict[Any, Callable[[Mapping[str, Any]], Any]] = {
    "value": _decode_value,
    "array": _decode_array,
    "scalar": lambda c: _decode_array(c)[()],
    "table": _decode_table,
    "sparse": _decode_sparse,
    "float": lambda c: float(c["value"]),
    "complex": lambda c: complex(*c["parts"]),
    "dict": lambda c: {decode(k): decode(v) for k, v in c["items"]},
    "frozen": lambda c: MappingProxyType({decode(k): decode(v) for k, v in c["items"]}),
    "tuple": lambda c: tuple(decode(item) for item in c["items"]),
    "list": lambda c: [decode(item) for item in c["items"]],
    "slice": lambda c: slice(*(decode(item) for item in c["items"])),
    "path": lambda c: Path(c["value"]),
    "function": lambda c: _NotSaved(c["name"]),
}
