"""Scenarios of linear systems and the reproduction of Yang & Yin 2012."""

import json
from pathlib import Path

import pytest

import gramian as gm
from gramian.reproduce import reproduce
from gramian.reproduce.yang_yin_2012 import PRINTED, verdict
from gramian.scenario import load

EXAMPLES = Path(__file__).parents[2] / "examples"


def changed(tmp_path, name, old, new):
    text = (EXAMPLES / name).read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / name
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def test_the_paper_is_reproduced(tmp_path):
    report = reproduce("yang-yin-2012")
    assert report.data["counts"] == {"all": 55, "agrees": 50, "noise": 3, "differs": 2, "unit": 8}
    orders = report.data["orders"]
    assert orders == [None, None, None, 3, 0, 0, 0, 0, 0, 0, 1, 2, 2, 1, 1]
    # In hours the older degree sees four combinations, the levels all twelve.
    units = next(table for table in report.tables if "other units" in table.title)
    assert [row[3] for row in units.rows] == ["12", "12", "4"]
    assert {row[5] for row in units.rows} == {"6, 9, 11, 12"}
    assert len({row[1] for row in units.rows}) > 1
    page, data = report.write(tmp_path)
    assert "REPRODUCED" in page.read_text(encoding="utf-8")
    assert json.loads(data.read_text(encoding="utf-8"))["levels"]["rank"] == 12


def test_verdicts_on_printed_entries():
    assert sum(len(column) for column in PRINTED.values()) == 63
    assert verdict("1.0E-02", 0.009860) == "differs"
    assert verdict("9.9E-03", 0.009860) == "agrees"
    assert verdict("5.0E-11", 0.0) == "noise"
    assert verdict("-1.0", -0.99995) == "agrees"


def test_static_alignment_prints_the_table_of_one_hour(tmp_path):
    report = load(EXAMPLES / "static_alignment.toml").analyze()
    assert report.headline == "UNOBSERVABLE"
    ratio = dict(
        zip(report.data["information"]["names"], report.data["information"]["ratio"], strict=True)
    )
    assert abs(ratio["eps_U"] - 0.125) < 5e-4
    assert report.data["levels"]["ranks"][:4] == [6, 9, 11, 12]
    report.write(tmp_path)


def test_quarter_turn_makes_three_combinations_observable(tmp_path):
    report = load(EXAMPLES / "quarter_turn.toml").analyze()
    # All ranks are full, but nothing is learned of a gyro that nothing moves around.
    assert report.headline == "WEAKLY OBSERVABLE"
    assert "of eps_U the prior says more than the window" in report.verdict
    legs = report.data["maneuvers"]
    assert legs["rank"] == [12, 15, 15, 15]
    assert legs["rank_alone"][0] == 12
    ratio = dict(
        zip(report.data["information"]["names"], report.data["information"]["ratio"], strict=True)
    )
    assert ratio["phi_U"] < 0.2
    assert ratio["Delta_N"] < 0.06
    report.write(tmp_path)
    # However finely a turn is cut, there is one sample a second and the window as long.
    finer = load(changed(tmp_path, "quarter_turn.toml", "turn_deg = 90.0", "turn_deg = -270.0"))
    assert finer.analyze().data["history"]["times"][-1] == 170.0


def test_a_system_of_ones_own(tmp_path):
    report = load(EXAMPLES / "oscillator.toml").analyze()
    assert report.headline == "OBSERVABLE"
    assert report.data["levels"]["combinations"] == {"reading": 0}
    still = changed(tmp_path, "oscillator.toml", "[-0.25, -0.02,", "[0.0, 0.0,")
    report = load(still).analyze()
    assert report.headline == "UNOBSERVABLE"
    assert report.data["levels"]["nullity"] == 2


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("oscillator.toml", "C = [[1.0, 0.0, 1.0, 0.0]]", "C = [[1.0, 0.0]]", "C has shape"),
        ("oscillator.toml", "drift = 0.01", "", "drift has none"),
        ("oscillator.toml", "drift = 0.01", "drifd = 0.01", "no state has that name"),
        ("oscillator.toml", "step = 0.5", "step = -0.5", "must be > 0"),
        ("oscillator.toml", "reading = { position", "reading = { posision", "no state is named"),
        ("static_alignment.toml", "latitude_deg = 28.15", "latitude_deg = 90.0", "must be < 90"),
        ("quarter_turn.toml", "duration = 20.0, ", "duration = 0.0, ", "must be > 0"),
        (
            "quarter_turn.toml",
            "turn_deg = 90.0",
            "turn_deg = 1e6",
            "turn_deg = 1000000.0: must be <=",
        ),
        (
            "quarter_turn.toml",
            "duration = 20.0, ",
            "duration = 2e4, ",
            "flight.legs: .*4030 pieces",
        ),
        ("quarter_turn.toml", "{ duration = 60.0 },\n]", "{ duration = 1e6 },\n]", "window.step: "),
        ("quarter_turn.toml", "speed = 50.0", "speed = 1e9", "flight: velocity"),
    ],
)
def test_mistakes_are_named(tmp_path, name, old, new, message):
    path = changed(tmp_path, name, old, new)
    with pytest.raises(gm.InputError, match=message):
        load(path).analyze()
