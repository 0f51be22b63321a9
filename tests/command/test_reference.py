"""The page of every scenario key is what the code has, and its examples are taken."""

import tomllib
from pathlib import Path

import pytest
from pydantic import TypeAdapter
from typer.testing import CliRunner

import gramian as gm
from gramian._registry import REGISTRY
from gramian.cli import app
from gramian.scenario import reference, schema
from gramian.scenario._keys import KEYS, key_of
from gramian.scenario._reference import _sections
from gramian.scenario.base import scenario_class

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "scenario.md"


def fields(model):
    kind = scenario_class(model)
    for section in [kind, *(s for _, s in _sections(kind, ""))]:
        for name, field in section.model_fields.items():
            yield section, field.alias or name, field


def test_the_page_is_current():
    done = CliRunner().invoke(app, ["schema", "all", "--markdown"], catch_exceptions=False)
    assert done.stdout == PAGE.read_text(encoding="utf-8"), "gramian schema all --markdown"


@pytest.mark.parametrize("model", REGISTRY)
def test_every_key_is_explained_and_no_other(model):
    explained = set()
    for section, name, _ in fields(model):
        said = key_of(model, section.__mro__, name)
        assert said is not None, f"{section.__name__}.{name}"
        assert said[1], f"{section.__name__}.{name} has no meaning"
        explained |= {f"{kind.__name__}.{name}" for kind in section.__mro__}
    lines = [line.split("|")[0].strip() for line in KEYS[model].splitlines() if line.strip()]
    assert set(lines) <= explained
    assert len(lines) == len(set(lines))


@pytest.mark.parametrize("model", REGISTRY)
def test_every_example_is_taken_by_its_key(model):
    shown = 0
    for section, name, field in fields(model):
        example = key_of(model, section.__mro__, name)[2]
        if not example:
            continue
        value = tomllib.loads(f"value = {example}")["value"]
        TypeAdapter(field.annotation).validate_python(value)
        shown += 1
    assert shown > 5


def test_the_schema_for_editors_explains_too():
    window = schema("bearings")["$defs"]["Window"]["properties"]
    assert window["duration"]["description"] == "how long (s)"
    gap = schema("bearings")["$defs"]["Tracks"]["properties"]["max_gap"]
    assert gap["default"] == 120.0
    assert "interpolated" in gap["description"]
    for model in REGISTRY:
        assert f"## `{model}`" in reference("all")
    with pytest.raises(gm.InputError, match="must be one of bearings"):
        reference("sonar")
