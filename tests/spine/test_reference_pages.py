"""The reference of the site has every public name, and each says what it is."""

import inspect
from pathlib import Path

import pytest

import gramian as gm

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def reference(monkeypatch):
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(str(DOCS))
    from _site import reference

    return reference


def test_every_public_name_is_on_a_page(reference):
    pages = reference.modules()
    assert set(pages) >= {
        f"gramian.{name}" for name in gm.__all__ if inspect.ismodule(getattr(gm, name))
    }
    for name, module in pages.items():
        text = reference.page(name, module)
        for each in reference.names(module):
            assert each == "__version__" or f":: {each}\n" in text, f"{name}.{each}"


def test_every_public_name_is_described(reference):
    bare = []
    for name, module in reference.modules().items():
        for each in reference.names(module):
            value = getattr(module, each)
            named = inspect.isroutine(value) or inspect.isclass(value)
            if each != "__version__" and not (
                value.__doc__ if named else reference.comment(each, value)
            ):
                bare.append(f"{name}.{each}")
    assert bare == []


def test_every_command_is_on_the_page(reference):
    text = reference.commands()
    for command in ("analyze", "localize", "plan", "simulate", "import", "schema", "reproduce"):
        assert f"## gramian {command}\n" in text
    assert "--sigma-deg" in text


def test_the_gallery_is_large_enough():
    examples = DOCS.parent / "examples"
    found = [
        script
        for header in examples.rglob("GALLERY_HEADER.rst")
        for script in header.parent.glob("*.py")
    ]
    assert len([script for script in found if script.parent != examples]) >= 24
