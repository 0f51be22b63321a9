"""Mistakes of a scenario file, each with its line, key, value and what was expected."""

from __future__ import annotations

import re
import types
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from gramian._options import given

__all__ = ["describe"]

#: A key is shown up to so many characters.
_LONGEST = 200

_WANTED = {
    "greater_than": "must be > {gt}",
    "greater_than_equal": "must be >= {ge}",
    "less_than": "must be < {lt}",
    "less_than_equal": "must be <= {le}",
    "finite_number": "must be finite",
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "int_type": "must be a whole number, without a point",
    "int_parsing": "must be a whole number",
    "int_from_float": "must be a whole number",
    "string_type": "must be a string",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "literal_error": "must be {expected}",
    "too_short": "must have at least {min_length} entries, has {actual_length}",
    "too_long": "must have at most {max_length} entries, has {actual_length}",
    "value_error": "{error}",
}


def describe(error: ValidationError, kind: type[BaseModel], path: Path, text: str) -> str:
    """Return all mistakes of a file, a line each."""
    lines = []
    found = [
        (tuple(part for part in item["loc"] if not _is_branch(part)), item)
        for item in error.errors()
    ]
    for loc, item in found:
        # A table that fails inside need not be told that it is no number either.
        if any(len(other) > len(loc) and other[: len(loc)] == loc for other, _ in found):
            continue
        key = _short(_dotted(loc))
        # No pattern of a million characters: such a key is no slip whose line helps.
        line = _line(text, loc) if len(key) < _LONGEST else None
        place = f"{path}:{line}" if line else f"{path}"
        if item["type"] == "missing":
            lines.append(f"{place}: {key} is missing")
        elif item["type"] == "extra_forbidden":
            known = ", ".join(_known_keys(kind, loc[:-1]))
            lines.append(f"{place}: {key} is not a key here: the keys are {known}")
        else:
            wanted = _WANTED.get(item["type"], item["msg"]).format(**item.get("ctx", {}))
            whole = item["type"] == "value_error" and isinstance(item["input"], dict)
            shown = "" if not loc else f"{key}: " if whole else f"{key} = {given(item['input'])}: "
            lines.append(f"{place}: {shown}{wanted}")
    return "\n".join(dict.fromkeys(lines))


def _short(text: str) -> str:
    return text if len(text) < _LONGEST else f"{text[: _LONGEST - 3]}..."


def _is_branch(part: str | int) -> bool:
    """Say whether pydantic put the name of a union's branch into the location."""
    return isinstance(part, str) and bool(
        re.fullmatch(
            r"(\[key\]|float|int|str|bool|list|tuple|dict|constrained-.*|function-.*|[A-Z]\w+)(\[.*\])?",
            part,
        )
    )


def _dotted(loc: Sequence[str | int]) -> str:
    text = ""
    for part in loc:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text or "the file"


def _line(text: str, loc: Sequence[str | int]) -> int | None:
    """Find the line of a key; of the table it should be in when it is not there."""
    names = [str(part) for part in loc if isinstance(part, str)]
    lines = text.splitlines()
    start, found = 0, None
    # The longest prefix that is a table header, then the key below it.
    for depth in range(len(names), 0, -1):
        header = r"\s*\[+\s*" + r"\s*\.\s*".join(map(re.escape, names[:depth])) + r"\s*\]+"
        for i, line in enumerate(lines):
            if re.match(header, line):
                start, found, names = i + 1, i + 1, names[depth:]
                break
        if found:
            break
    for name in names:
        for i in range(start, len(lines)):
            if re.match(r"\s*\[", lines[i]) and i > start and found:
                break
            if re.search(rf"(^|[\s{{,.])[\"']?{re.escape(name)}[\"']?\s*(=|\.)", lines[i]):
                found, start = i + 1, i
                break
    return found


def _known_keys(kind: Any, loc: Sequence[str | int]) -> list[str]:
    """List the keys of the section at a location."""
    for part in loc:
        if isinstance(part, int):
            continue
        field = kind.model_fields.get(part)
        models = list(_models(field.annotation)) if field else []
        if not models:
            return []
        kind = models[0]
    return [field.alias or name for name, field in kind.model_fields.items()]


def _models(annotation: Any) -> typing.Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        if issubclass(annotation, BaseModel):
            yield annotation
        return
    for argument in typing.get_args(annotation):
        yield from _models(argument)
