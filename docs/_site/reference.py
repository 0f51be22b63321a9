"""Write the pages of the reference from what the package says of itself.

Every public name from `__all__`, the commands from the command, the scenario files
from their schema. The pages go to `reference/generated`, which is not kept.
"""

from __future__ import annotations

import importlib
import inspect
import sys
from pathlib import Path
from types import ModuleType

import typer.main
from sphinx.pycode import ModuleAnalyzer

import gramian as gm
from gramian.cli import app as command

DOCS = Path(__file__).parents[1]
OUT = DOCS / "reference" / "generated"


def modules() -> dict[str, ModuleType]:
    """Give every public module by the name under which it is used."""
    found = {"gramian": gm}
    for name in sorted(gm.__all__):
        value = getattr(gm, name)
        if inspect.ismodule(value):
            found[f"gramian.{name}"] = value
    for name in ("io.g2o", "io.neighbours", "plot"):
        found[f"gramian.{name}"] = importlib.import_module(f"gramian.{name}")
    return found


def names(module: ModuleType) -> list[str]:
    """Give the public names of a module that are no modules themselves."""
    return [name for name in module.__all__ if ours(getattr(module, name))]


def ours(value: object) -> bool:
    """Say whether a value is documented here: no module, and no class of another package."""
    elsewhere = inspect.isclass(value) and not value.__module__.startswith("gramian")
    return not (inspect.ismodule(value) or elsewhere)


def write(app: object = None) -> None:
    """Write all generated pages; leave those alone that have not changed."""
    OUT.mkdir(parents=True, exist_ok=True)
    pages = {f"{name}.rst": page(name, module) for name, module in modules().items()}
    pages["commands.md"] = commands()
    for stray in OUT.iterdir():
        if stray.name not in pages:
            stray.unlink()
    for name, text in pages.items():
        path = OUT / name
        if not path.exists() or path.read_text() != text:
            path.write_text(text)


def page(name: str, module: ModuleType) -> str:
    """Give the page of one module, in reStructuredText."""
    # `gramian.bearings` is an attribute of the package; its file is elsewhere.
    sys.modules.setdefault(name, module)
    lines = [name, "=" * len(name), "", f".. automodule:: {name}", "   :no-members:", ""]
    lines += [f".. currentmodule:: {name}", ""]
    kinds: dict[str, list[str]] = {
        "Functions": [],
        "Classes": [],
        "Exceptions": [],
        "Constants": [],
    }
    for each in names(module):
        if each != "__version__":
            kinds[kind(getattr(module, each))].append(each)
    for title, members in kinds.items():
        if not members:
            continue
        lines += [title, "-" * len(title), ""]
        for each in members:
            lines += entry(title, each, getattr(module, each))
    return "\n".join(lines)


def kind(value: object) -> str:
    """Say in which part of a page a value stands."""
    if inspect.isclass(value):
        return "Exceptions" if issubclass(value, BaseException) else "Classes"
    return "Functions" if inspect.isroutine(value) else "Constants"


def entry(title: str, name: str, value: object) -> list[str]:
    """Give the directive of one name."""
    if title == "Functions":
        return [f".. autofunction:: {name}", ""]
    if title == "Constants":
        said = [f"   {line}" for line in comment(name, value)]
        return [f".. py:data:: {name}", "", *said, "", f"   ``{value!r}``", ""]
    return [f".. autoclass:: {name}", "   :members:", "   :show-inheritance:", ""]


def comment(name: str, value: object) -> list[str]:
    """Give the comment before a constant, from the file that sets it."""
    for module in list(sys.modules.values()):
        inside = getattr(module, "__name__", "").startswith("gramian.")
        if inside and getattr(module, name, None) is value and module.__file__.endswith(".py"):
            comments = ModuleAnalyzer.for_module(module.__name__).find_attr_docs()
            if text := comments.get(("", name)):
                return text
    return []


def commands() -> str:
    """Give the page of the commands, in Markdown."""
    lines = ["# Commands", ""]
    lines += ["Exit status: 0 when answered, 1 for bad input, 2 for wrong usage.", ""]
    for name, each in typer.main.get_command(command).commands.items():
        arguments = [one for one in each.params if not one.opts[0].startswith("-")]
        usage = " ".join(["gramian", name, *map(metavar, arguments), "[OPTIONS]"])
        lines += [f"## gramian {name}", "", inspect.cleandoc(each.help or ""), ""]
        lines += ["```text", usage, "```", ""]
        rows = [option(one) for one in each.params if one.name != "help"]
        lines += ["| | |", "|---|---|", *rows, ""] if rows else []
    return "\n".join(lines)


def metavar(parameter: typer.core.TyperArgument | typer.core.TyperOption) -> str:
    """Give the word that stands for a value, none for a switch."""
    if getattr(parameter, "is_flag", False):
        return ""
    return parameter.metavar or parameter.name.upper()


def option(parameter: typer.core.TyperArgument | typer.core.TyperOption) -> str:
    """Give the row of one argument or option."""
    called = [one for one in parameter.opts if one.startswith("-")]
    shown = " ".join([*called, metavar(parameter)]).strip()
    text = " ".join((parameter.help or "").split())
    if isinstance(parameter.default, (str, int, float, Path)) and parameter.default is not False:
        text += f" Default: {parameter.default}."
    return f"| `{shown}` | {text} |"
