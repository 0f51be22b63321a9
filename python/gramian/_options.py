"""Options of public functions: choices, flags, names, mappings, callables.

Each returns the value where it is of its kind and names the argument where it is not.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Set
from typing import Any, TypeVar

import numpy as np

from gramian._arrays import as_float_array, number
from gramian.exceptions import InputError

__all__ = [
    "choice",
    "deviations",
    "flag",
    "fraction",
    "function",
    "given",
    "instance",
    "mapping",
    "names",
    "path",
    "sequence",
    "tolerance",
]

T = TypeVar("T")
C = TypeVar("C", bound=Callable[..., Any])


def given(value: object) -> str:
    """Return a value as it is shown in a message, at most a line of it."""
    try:
        text = repr(value)
    except Exception:
        text = f"a {type(value).__name__}"
    text = " ".join(text.split())
    return text if len(text) <= 80 else f"{text[:77]}..."


def choice(value: T, name: str, allowed: Iterable[object]) -> T:
    """Return one of the values that are allowed."""
    allowed = tuple(allowed)
    # Not `in`: an array compares elementwise, and True equals 1.
    if isinstance(value, (str, int, np.integer)) and not isinstance(value, bool):
        for one in allowed:
            if type(one) is not bool and one == value:
                return value
    words = [f'"{one}"' if isinstance(one, str) else str(one) for one in allowed]
    wanted = " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
    raise InputError(f"{name} = {given(value)}: must be {wanted}")


def flag(value: bool, name: str) -> bool:
    """Return True or False."""
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    raise InputError(f"{name} = {given(value)}: must be True or False")


def names(value: Iterable[str], name: str, what: str = "names") -> tuple[str, ...]:
    """Return a sequence of strings as a tuple."""
    wrong = f"{name} = {given(value)}: must be a sequence of {what}"
    if isinstance(value, (str, bytes, Mapping, Set)):
        raise InputError(wrong)
    try:
        items = tuple(value)
    except TypeError as error:
        raise InputError(wrong) from error
    for i, item in enumerate(items):
        if not isinstance(item, str):
            raise InputError(f"{name}[{i}] = {given(item)}: must be a string")
    return tuple(map(str, items))


def mapping(
    value: Mapping[str, T] | None, name: str, of: str = "name to number"
) -> Mapping[str, T]:
    """Return a mapping from strings; None is an empty one."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise InputError(f"{name} = {given(value)}: must be a mapping of {of}")
    for key in value:
        if not isinstance(key, str):
            raise InputError(f"{name} has the key {given(key)}: must be a string")
    return value


def deviations(value: Mapping[str, float] | None, name: str) -> dict[str, float]:
    """Return a mapping of names to standard deviations, each > 0 and finite."""
    checked = {}
    for key, sigma in mapping(value, name, "name to standard deviation").items():
        deviation = number(sigma, f"{name} of {key}")
        if not deviation > 0:
            raise InputError(f"{name} of {key} = {given(sigma)}: must be > 0 and finite")
        checked[key] = deviation
    return checked


def fraction(value: float, name: str) -> float:
    """Return a number between 0 and 1, neither of them: a tolerance, a level."""
    if type(value) is not float:
        array = as_float_array(value, name)
        if array.shape != ():
            raise InputError(f"{name} has shape {array.shape}: must be one number")
        value = float(array)
    if not 0 < value < 1:
        raise InputError(f"{name} = {value}: must be between 0 and 1")
    return value


def tolerance(value: float | None, name: str = "rtol") -> float | None:
    """Return a tolerance between 0 and 1, or None for the default."""
    return None if value is None else fraction(value, name)


def sequence(value: Any, name: str, what: str = "a sequence") -> list[Any]:
    """Return the entries of a sequence; text and mappings are none."""
    try:
        if not isinstance(value, (str, bytes, Mapping, Set)):
            return list(value)
    except TypeError:
        pass
    raise InputError(f"{name} = {given(value)}: must be {what}")


def path(value: str | os.PathLike[str], name: str = "path") -> str:
    """Return the name of a file or directory."""
    try:
        text = os.fspath(value)
    except TypeError:
        text = None
    if isinstance(text, str) and text and "\0" not in text:
        return text
    raise InputError(f"{name} = {given(value)}: must be the path of a file")


def function(value: C, name: str) -> C:
    """Return what can be called."""
    if callable(value):
        return value
    raise InputError(f"{name} = {given(value)}: must be a function")


def instance(value: object, kind: type[T], name: str, what: str) -> T:
    """Return a value of a class; `what` says in words what it must be."""
    if isinstance(value, kind):
        return value
    raise InputError(f"{name} = {given(value)}: must be {what}")
