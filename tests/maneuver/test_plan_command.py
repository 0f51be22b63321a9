"""`gramian plan` on a scenario file: the answer, its page and its mistakes."""

import json
import sys
from pathlib import Path

import pytest

from gramian import cli
from gramian.exceptions import ScenarioError
from gramian.scenario import load

EXAMPLES = Path(__file__).parents[2] / "examples"

SHORT = """
model = "maneuver"
[target]
position = [0.0, 1000.0]
[observer]
start = [0.0, 0.0]
speed = 20.0
[bearings]
count = 30
step = 1.0
sigma_deg = 1.8
[limits]
standoff = 700.0
[closed_loop]
first_range = [1500.0, 500.0]
lost = 0.2
trials = 3
replan = 30
methods = ["plan", "max_det"]
"""


def write(folder, text):
    path = folder / "short.toml"
    path.write_text(text)
    return path


def test_the_command_writes_its_answer(tmp_path, monkeypatch, capsys):
    path = write(tmp_path, SHORT)
    monkeypatch.setattr(sys, "argv", ["gramian", "plan", str(path), "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    shown = capsys.readouterr().out
    assert "PLANNED: the target's position is known to" in shown
    assert "times behind" in shown
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["converged"] is True
    assert len(result["path_m"]) == 30
    assert {law["law"] for law in result["laws"]} >= {"max_det", "hammel_liu"}
    assert len(result["closed_loop"]["methods"]) == 2
    page = (tmp_path / "out" / "report.html").read_text()
    for picture in ("Paths", "Information along the paths", "Error ellipses", "Closed loop"):
        assert picture in page


def test_the_examples_are_planned():
    report = load(EXAMPLES / "plan_moving_target.toml").plan()
    assert report.headline == "PLANNED"
    # Of the 59 moves, the turn is near the middle.
    assert 24 <= report.data["turns"][0] <= 36
    assert load(EXAMPLES / "plan_fixed_target.toml").model == "maneuver"


SOON = (
    SHORT[: SHORT.index("[closed_loop]")].replace("standoff = 700.0", "standoff = 300.0")
    + """
[goal]
combination = "range"
accuracy = ACCURACY
starts = 2
restarts = 0
"""
)


def test_how_soon_an_accuracy_is_reached(tmp_path):
    report = load(write(tmp_path, SOON.replace("ACCURACY", "100.0"))).plan()
    assert report.headline == "PLANNED"
    assert report.verdict.startswith("range to 100 after ")
    found = report.data["soonest"]
    assert found["at_least"] <= found["samples"] < 30
    assert found["reached"] <= 100.0
    assert len(report.data["path_m"]) == found["samples"]
    table = report.tables[0]
    assert [int(row[0]) for row in table.rows] == [count for count, _, _ in found["tried"]]


def test_an_accuracy_that_is_not_reached_is_said(tmp_path):
    report = load(write(tmp_path, SOON.replace("ACCURACY", "0.01"))).plan()
    assert report.headline == "NOT ACCURATE ENOUGH"
    assert "no path found in 30 samples" in report.verdict
    assert report.data["soonest"]["samples"] is None
    assert report.data["soonest"]["time_s"] == "inf"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[limits]", '[goal]\naccuracy = 5.0\n[limits]', "accuracy needs combination"),
        ("standoff = 700.0", "standoff = 1700.0", "plan: start is 1000 m from target, inside standoff"),
        ("speed = 20.0", "speed = 0.0", r":7: observer.speed = 0.0: must be > 0"),
        ("position = [0.0, 1000.0]", "", "give position, or positions"),
        ("count = 30", "count = 1", ":9: bearings.count = 1: must be >= 2"),
        ("lost = 0.2", "lost = 1.0", "closed_loop.lost = 1.0: must be < 1"),
        ("[limits]", '[prior]\ndepth = 1.0\n[limits]', "prior = 'depth': must be one of"),
        ("speed = 20.0", "speed = [10.0, 20.0]", "closed_loop needs one speed"),
    ],
)  # fmt: skip
def test_mistakes_are_named(tmp_path, old, new, words):
    path = write(tmp_path, SHORT.replace(old, new, 1))
    with pytest.raises(ScenarioError, match=words):
        load(path).plan()


def test_the_shortest_interval_is_planned_for(tmp_path):
    text = SOON.replace('combination = "range"\naccuracy = ACCURACY', 'interval = "range"')
    report = load(write(tmp_path, text)).plan()
    assert report.headline == "PLANNED"
    assert report.verdict.startswith("95 % interval of range: ")
    found = report.data["interval"]
    assert [row[0] for row in report.tables[0].rows] == [c[0] for c in found["candidates"][:12]]
    assert found["length"] == min(length for _, length, _ in found["candidates"])
    assert f"{float(report.tables[0].rows[0][1]):.3g}" == f"{found['length']:.3g}"
    assert report.facts[0][1].startswith(found["candidates"][0][0])
    assert report.pictures[0].draw() is not None
