"""The keys of scenario files: as JSON Schema, and as a page for readers."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator
from typing import Any, Literal

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from gramian._registry import REGISTRY
from gramian.exceptions import InputError
from gramian.scenario._keys import key_of
from gramian.scenario.base import scenario_class

__all__ = ["reference", "schema"]


def schema(model: str) -> dict[str, Any]:
    """Return the JSON Schema of a model's scenario files.

    Raises
    ------
    InputError
        A model that is not known.
    """
    kind = _kind(model)
    found = kind.model_json_schema()
    for section in [kind, *(s for _, s in _sections(kind, ""))]:
        place = found if section is kind else found.get("$defs", {}).get(section.__name__)
        for name, field in section.model_fields.items():
            said = key_of(model, section.__mro__, field.alias or name)
            if place is None or said is None:
                continue
            unit, meaning, example = said
            key = place["properties"][field.alias or name]
            key["description"] = meaning + (f" ({unit})" if unit else "")
            if example:
                key["examples"] = [example]
    return found


def reference(model: str) -> str:
    """Return a page of every key of a model's scenario files, in Markdown.

    Parameters
    ----------
    model : str
        A model, or "all".

    Raises
    ------
    InputError
        A model that is not known.
    """
    if model == "all":
        return _PREFACE + "\n".join(reference(one) for one in REGISTRY)
    kind = _kind(model)
    lines = [f"## `{model}`", "", *_about(kind), ""]
    for path, section in [("", kind), *_sections(kind, "")]:
        if path:
            lines += [f"### `{path}`", "", *_about(section), ""]
        lines += ["| key | type | unit | default | example | |", "|---|---|---|---|---|---|"]
        for name, field in section.model_fields.items():
            shown = field.alias or name
            unit, meaning, example = key_of(model, section.__mro__, shown) or ("", "", "")
            cells = (
                f"`{shown}`",
                _type(field.annotation, _limits(field.metadata)),
                unit,
                _default(field),
                f"`{example}`" if example else "",
                meaning,
            )
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        lines.append("")
    return "\n".join(lines[:-1]) + "\n"


def _kind(model: str) -> type[BaseModel]:
    if model not in REGISTRY:
        known = ", ".join(REGISTRY)
        raise InputError(f"model = {model!r}: must be one of {known}")
    return scenario_class(model)


def _about(kind: type[BaseModel]) -> list[str]:
    lines = (kind.__doc__ or "").strip().splitlines()
    return [line.strip() for line in lines]


def _sections(kind: type[BaseModel], path: str) -> Iterator[tuple[str, type[BaseModel]]]:
    """Yield the tables below a class, with the names by which a file has them."""
    for name, field in kind.model_fields.items():
        for below, section in _below(field.annotation, f"{path}{field.alias or name}"):
            yield below, section
            yield from _sections(section, f"{below}.")


def _below(annotation: Any, path: str) -> Iterator[tuple[str, type[BaseModel]]]:
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        if issubclass(annotation, BaseModel):
            yield path, annotation
        return
    origin = typing.get_origin(annotation)
    suffix = {list: "[]", tuple: "[]", dict: ".NAME"}.get(origin, "")
    for argument in typing.get_args(annotation):
        yield from _below(argument, path + suffix)


_PREFACE = """# Scenario files

Every key, as `gramian schema all --markdown` prints it. A scenario is a TOML file with the key
`model`; files that it names are relative to it. A key that is not here is an error, with its line.
`NAME` is a name of your choice, `[]` one of a list. `gramian schema MODEL` prints the JSON Schema,
for editors.

"""

_WORDS = {float: "number", int: "whole number", str: "string", bool: "true or false"}


def _type(annotation: Any, limits: str = "") -> str:  # noqa: PLR0911 - one for each kind
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if annotation in _WORDS:
        # The limits of a text are those of its length.
        return _WORDS[annotation] + (
            limits.replace("entries", "length") if annotation is str else limits
        )
    if origin is Literal:
        return " or ".join(f'"{one}"' if isinstance(one, str) else str(one) for one in arguments)
    if origin is typing.Annotated:
        return _type(arguments[0], _limits(list(arguments[1:])) or limits)
    if origin is list:
        return f"list of {_type(arguments[0])}" + limits
    if origin is tuple:
        if arguments[-1] is Ellipsis:
            return f"list of {_type(arguments[0])}" + limits
        return f"list of {len(arguments)}: {_type(arguments[0])}"
    if origin is dict:
        return f"table of {_type(arguments[1])}"
    if origin in (typing.Union, types.UnionType):
        parts = [_type(one, limits) for one in arguments if one is not type(None)]
        return " or ".join(dict.fromkeys(parts))
    return "table"


def _limits(metadata: list[Any]) -> str:
    found = []
    for one in metadata:
        for kind, sign, name in (
            (Gt, ">", "gt"), (Ge, ">=", "ge"), (Lt, "<", "lt"), (Le, "<=", "le"),
            (MinLen, "entries >=", "min_length"), (MaxLen, "entries <=", "max_length"),
        ):  # fmt: skip
            if isinstance(one, kind):
                found.append(f"{sign} {getattr(one, name):g}")
    return f", {', '.join(found)}" if found else ""


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is None or isinstance(value, BaseModel) or value in ([], {}, ()):
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str):
        return f'`"{value}"`'
    return f"`{list(value) if isinstance(value, (tuple, list)) else value}`".replace("'", '"')
