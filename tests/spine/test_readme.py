"""The README and the pages in docs: their Python runs, what they name and link to exists."""

import inspect
import re
from pathlib import Path

import pytest

import gramian as gm

ROOT = Path(__file__).parents[2]
BLOCKS = re.compile(r"```python\n(.*?)```", flags=re.S)
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
MODULES = ("bearings", "bounds", "dipole", "inertial", "io", "linear", "maneuver")
MODULES = (gm, *(getattr(gm, name) for name in (*MODULES, "monte_carlo", "registration")))


def names(modules):
    """Give all names of the package: functions, their arguments, classes, what those have."""
    for module in modules:
        for name, value in inspect.getmembers(module):
            yield name
            if inspect.isclass(value):
                yield from dir(value)
                yield from getattr(value, "__annotations__", {})
            elif inspect.isroutine(value):
                yield from inspect.signature(value).parameters


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_a_page_names_exists(page):
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.S)
    known = {*names(MODULES), "no_std"}
    said = re.findall(r"`(gm\.)?((?:\w+\.)*)([a-z]\w*)((?:\(.*?\))?|=.*?)`", text)
    # One word without an underscore may be anything.
    own = [name for gm_, _, name, rest in said if gm_ or rest or "_" in name]
    assert [name for name in own if name not in known] == []
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", text) if "://" not in link]
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
