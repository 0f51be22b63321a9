"""The models of examples/models say what their pages say."""

import importlib.util
from pathlib import Path

import pytest

import gramian as gm

FOLDER = Path(__file__).parents[2] / "examples" / "models"


def load(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("name", "options", "nullity"),
    [
        ("gnss_clock", {}, 0),
        ("trilateration", {}, 0),
        ("hand_eye", {"axes": [[0, 0, 0.5], [0, 0, -0.8]]}, 1),
        ("hand_eye", {"axes": [[0, 0, 0.5], [0.6, 0, 0]]}, 0),
        ("camera", {"tilt": 0.0}, 1),
        ("camera", {"tilt": 0.6}, 0),
        ("compartments", {}, 1),
        ("power_grid", {}, 0),
        ("power_grid", {"phasor": False}, 1),
        ("visual_inertial", {}, 4),
        ("visual_inertial", {"offset": 5e6}, 4),
        ("direction_finding", {}, 0),
        ("uwb", {}, 0),
        ("magnetometer", {"tilted": False}, 1),
        ("magnetometer", {}, 0),
        ("orbit", {}, 0),
        ("pose_graph", {"poses": 10}, 3),
    ],
)
def test_verdict(name, options, nullity):
    answer = gm.analyze(load(name).model(**options))
    assert answer.nullity == nullity
    if nullity == 0:
        assert answer.status in {"observable", "weak"}
    else:
        assert answer.status in {"unobservable", "undecided"}


def test_all_are_tried():
    tried = {mark[0] for mark in test_verdict.pytestmark[0].args[1]}
    assert {script.stem for script in FOLDER.glob("*.py")} == tried


def test_what_is_fixed_takes_its_errors_along():
    problem = load("compartments").model().problem()
    assert gm.analyze(problem.fix("dose")).status == "observable"
