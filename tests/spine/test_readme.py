"""The README and the pages in docs: their Python runs, what they name and link to exists."""

import inspect
import re
from pathlib import Path

import pytest

import gramian as gm
from gramian._registry import REGISTRY
from gramian.estimation import Fit

ROOT = Path(__file__).parents[2]
BLOCKS = re.compile(r"```python\n(.*?)```", flags=re.S)
# Cells, whose output the build of the site puts on the page.
CELLS = re.compile(r"```\{code-cell\} python\n(?::[^\n]*\n)*(.*?)```", flags=re.S)
# Pages that the build of the site writes are checked there.
GENERATED = ("gallery/", "reference/generated/", "scenario.md")
PAGES = [ROOT / "README.md"]
PAGES += [
    page
    for page in sorted((ROOT / "docs").rglob("*.md"))
    if not page.relative_to(ROOT / "docs").as_posix().startswith(GENERATED)
]
# What the pages name beside the package: words of other tools and of Rust.
# The vocabulary of statuses is not a name.
OTHERS = {"no_std", "default-features", "python-control", "not_converged"}
# Keys of a scenario.
KEYS = {"window.start", "tracks.max_gap"}
# Pages about one module, where they are not named after it.
ABOUT = {"files": "io"}


def names(module):
    """Give the public names of a module: what it has, arguments, members of its classes."""
    for name in module.__all__:
        value = getattr(module, name)
        yield name
        if inspect.isclass(value):
            yield from dir(value)
            yield from getattr(value, "__annotations__", {})
            if not issubclass(value, Exception):
                yield from inspect.signature(value).parameters
        elif inspect.isroutine(value):
            yield from inspect.signature(value).parameters


def module(name):
    return gm if name == "gm" else getattr(gm, name)


def known_on(page, line):
    """Give what may be named in a line: of the package, the page's module, those of the line."""
    about = {"gm", ABOUT.get(page.stem, page.stem)} & {"gm", *gm.__all__} | set(
        re.findall(r"`gm\.(\w+)`", line)
    )
    about = {name for name in about if name == "gm" or inspect.ismodule(getattr(gm, name, None))}
    return OTHERS.union(*(names(module(name)) for name in about))


# The page of scenario keys is generated, and held to the schema by a test of its own.
@pytest.mark.parametrize(
    "page", [page for page in PAGES if page.name != "scenario.md"], ids=lambda page: page.name
)
def test_what_a_page_names_exists(page):
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.S)
    missing = []
    for line in text.splitlines():
        known = known_on(page, line)
        for path, last, rest in re.findall(r"`((?:\w+\.)*)([a-z]\w*)((?:\(.*?\))?|=.*?)`", line):
            parts = [part for part in path.split(".") if part and part != "gm"]
            if parts or path:
                if path + last in KEYS:
                    continue
                if parts[:1] == ["answer"]:
                    kind = "Estimate" if page.stem == "trust" else "Observability"
                    parts = [kind, *parts[1:]]
                elif parts == ["fit"]:
                    if last not in {*dir(Fit), *Fit.__annotations__}:
                        missing.append(path + last)
                    continue
                # A qualified name is of that module, or a member of that class, and no other.
                owner = gm if not parts or parts[0] in gm.__all__ else None
                for part in (*parts, last):
                    owner = getattr(owner, part, None)
                if owner is None:
                    missing.append(path + last)
            # One word without an underscore may be anything.
            elif (rest or "_" in last) and last not in known:
                missing.append(last)
    assert missing == []
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", text) if "://" not in link]
    links = [link for link in links if not any(part in link for part in GENERATED)]
    assert [link for link in links if not (page.parent / link).exists()] == []


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if BLOCKS.search(page.read_text())],
    ids=lambda page: page.name,
)
def test_blocks_run_and_print_what_they_say(page, capsys):
    space = {}
    for block in BLOCKS.findall(page.read_text()):
        exec(compile(block, str(page), "exec"), space)
        printed = capsys.readouterr().out.splitlines()
        claims = [a or b for a, b in re.findall(r"print\(.*?\)\s*# (.*)|\n# (.*)", block)]
        assert claims, f"a block claims nothing: {block}"
        assert printed == [claim.split(": on the line")[0] for claim in claims]


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if CELLS.search(page.read_text())],
    ids=lambda page: page.stem,
)
def test_cells_run_top_to_bottom(page):
    pytest.importorskip("matplotlib")
    space = {}
    for cell in CELLS.findall(page.read_text()):
        exec(compile(cell, str(page), "exec"), space)


def test_the_readme_has_every_model():
    text = (ROOT / "README.md").read_text()
    assert [name for name in REGISTRY if f"`gm.{name}`" not in text] == []
