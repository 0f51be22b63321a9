"""Slips that a first scenario has: each is named, none passes for something else."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import gramian as gm
from gramian import cli, plot
from gramian.report import Table
from gramian.scenario import load

EXAMPLES = Path(__file__).parents[2] / "examples"
SCENARIO = """\
model = "bearings"
[tracks]
file = "tracks.csv"
columns = { id = "ship", time = "t", east = "x", north = "y" }
observer = "me"
target = "them"
[window]
start = 0.0
duration = 900.0
step = 15.0
[noise]
bearing_deg = 0.5
"""
TIMES = 30.0 * np.arange(31)
TRACKS = "ship,t,x,y\n" + "".join(
    f"me,{t},{5 * min(t, 450)},{5 * max(0, t - 450)}\nthem,{t},{3000 + 3 * t},{5000 - 4 * t}\n"
    for t in TIMES
)


def scenario(folder, text=SCENARIO, tracks=TRACKS):
    (folder / "tracks.csv").write_text(tracks)
    path = folder / "mine.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("0.5", "true", r"mine.toml:12: noise.bearing_deg = True: must be a number"),
        ('"bearings"', '["bearings"]', r"model = \['bearings'\]: must be one of"),
        ('target = "them"', 'target = "me"', "observer and target are the same track, 'me'"),
        ("[noise]", "[prior]\nspead = 1.0\n[noise]", r"mine.toml:12: prior.spead = 'spead'"),
        (
            "[noise]",
            "[prior]\nspeed = { mean = 5.0, sigma = 0.0 }\n[noise]",
            r"^\S+mine.toml:12: prior.speed.sigma = 0.0: must be > 0.0$",
        ),
    ],
)
def test_slips_in_the_scenario(tmp_path, before, after, message):
    with pytest.raises(gm.ScenarioError, match=message):
        load(scenario(tmp_path, SCENARIO.replace(before, after))).analyze()


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("me,0.0,0.0", "me,0.0,1_000", r"tracks.csv:2: x = '1_000': must be a number"),
        ("me,0.0,", "me,12:00:00,", r"t\[0\] = '12:00:00': must be"),
        ("ship,t,x,y", "ship,t,y,y", r"has 2 columns 'y'|has no column 'x'"),
        ("ship,t,x,y", "ship,t,x,y,x", r"has 5 cells|has 4 cells: must have 5"),
    ],
)
def test_slips_in_the_tracks(tmp_path, before, after, message):
    with pytest.raises(gm.ScenarioError, match=message):
        load(scenario(tmp_path, tracks=TRACKS.replace(before, after))).analyze()


def test_a_byte_order_mark_is_no_slip(tmp_path):
    assert load(scenario(tmp_path, b"\xef\xbb\xbf" + SCENARIO.encode())).analyze().data["bearings"]


def test_a_command_that_does_not_work_on_a_model_says_on_which_it_does(tmp_path):
    with pytest.raises(gm.ScenarioError, match=r'plan does not work on it, but on "maneuver"$'):
        load(scenario(tmp_path)).plan()


def test_the_command_says_its_version(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["gramian", "--version"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 0
    assert capsys.readouterr().out == f"gramian {gm.__version__}\n"


def test_the_demo_keeps_what_was_edited(tmp_path, monkeypatch, capsys):
    edited = tmp_path / "demo" / "1_easy.toml"
    for _ in range(2):
        monkeypatch.setattr(sys, "argv", ["gramian", "demo", "--out", str(tmp_path / "demo")])
        with pytest.raises(SystemExit):
            cli.main()
        edited.write_text(edited.read_text().replace("bearing_deg = 0.5", "bearing_deg = 2.0"))
    assert "sigma 2 deg" in capsys.readouterr().out
    assert "bearing_deg = 2.0" in edited.read_text()


def test_the_picture_of_what_is_unseen_does_not_depend_on_units():
    def lengths(metre, second):
        rows = np.array([[1.0, -0.5, 2.0, 0.0], [0.0, 1.0, -3.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
        units = [metre, metre, metre / second, metre / second]
        answer = gm.analyze(rows / units)
        fig = plot.figure()
        axes = fig.subplots()
        plot.null_space(answer, axes)
        found = np.array([bar.get_width() for bar in axes.patches])
        return found * np.sign(found[0])

    np.testing.assert_allclose(lengths(1.0, 1.0), lengths(1e-3, 1 / 3600), atol=1e-9)


@pytest.mark.parametrize(
    ("example", "before", "after", "command", "message"),
    [
        (
            "oscillator",
            'units = ["m", "m/s"',
            'units = ["m"',
            "analyze",
            "mine.toml: system.units has 3 entries: must have 4",
        ),
        ("dipole_table_1", "duration = ", "duration = 1e300 # ", "analyze", "more than a million"),
        ("plan_fixed_target", "count = ", "count = 1000000 # ", "plan", "count = 1000000: must be"),
        ("plan_fixed_target", "sigma_deg = ", "sigma_deg = 99 # ", "plan", "must be < 90"),
        ("plan_fixed_target", "standoff = ", "standoff = 1e-300 # ", "plan", "standoff = 1e-300"),
        (
            "dipole_one_sensor",
            "speed = ",
            "speed = -1.0 # ",
            "localize",
            r"mine.toml: speed = -1.0",
        ),
    ],
)
def test_slips_in_the_examples(
    tmp_path, capsys, monkeypatch, example, before, after, command, message
):
    text = (EXAMPLES / f"{example}.toml").read_text()
    assert before in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(before, after))
    (tmp_path / "dipole_pass.csv").write_text((EXAMPLES / "dipole_pass.csv").read_text())
    monkeypatch.setattr(sys, "argv", ["gramian", command, str(path)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 1
    said = capsys.readouterr().err
    assert re.search(message, said), said
    assert "mine.toml" in said


@pytest.mark.parametrize(
    ("example", "before", "after", "message"),
    [
        ("two_radars", "[-20000.0,", "[true,", r"tracks.parallel.start\[0\] = True: must be a number"),
        ("two_radars", "[-20000.0,", '["1",', r"tracks.parallel.start\[0\] = '1': must be a number"),
        ("two_radars", "range = 300.0", "range = true", "biases.A.range = True: must be a number"),
        ("two_radars", "= 199.0", "= 1e300", "tracks.parallel: a track of more than a hundred"),
        ("two_radars", "step = 1.0", "step = 1e-9", "tracks.parallel: a track of more than a hundred"),
        ("two_radars", "[-20000.0,", "[1e300,", "more than 1e150 m from a target"),
        ("two_radars", "select = 2 ", "select = 2.5 ", "select = 2.5: must be a whole number"),
        ("oscillator", "A = [\n  [0.0, 1.0", "A = [\n  [0.0, true", r"system.A\[0\]\[1\] = True: must"),
        ("plan_fixed_target", "[0.0, 1000.0]", "[true, 0]", r"position\[0\] = True: must be a number"),
        ("plan_fixed_target", "[0.0, 1000.0]", "7.0", r"position = 7.0: must be a list"),
    ],
)  # fmt: skip
def test_numbers_that_are_none_or_of_absurd_size(tmp_path, example, before, after, message):
    text = (EXAMPLES / f"{example}.toml").read_text()
    assert before in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(before, after, 1))
    with pytest.raises(gm.InputError, match=message):
        load(path).localize()


def test_the_command_names_what_it_can_reproduce(capsys):
    with pytest.raises(SystemExit):
        cli.app(["reproduce", "--help"])
    shown = re.sub(r"[\s│]+", "", capsys.readouterr().out)
    assert "yang-yin-2012" in shown


def test_a_scenario_without_a_target_can_only_be_localized():
    with pytest.raises(gm.ScenarioError, match="analyze and simulate ask about a given target"):
        load(EXAMPLES / "localize" / "freighter.toml").simulate(10, 1)


def test_phrases_are_read_from_the_left_and_numbers_from_the_right():
    table = Table(
        "t",
        ["from", "combination", "bound", "unit", "state"],
        [
            ["outputs", "1 position + 1 offset", "11.85 m", "rad/s", "never"],
            ["", "1 drift", "not observable", "m", "2"],
        ],
    )
    assert [table.is_text(i) for i in range(5)] == [True, True, False, False, False]
