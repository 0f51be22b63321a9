"""`gramian localize`: a CSV of bearings and an observer's track to a position, or to a reason."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import gramian as gm
from gramian.scenario import load

EXAMPLE = Path(__file__).parents[2] / "examples" / "localize"
TRUTH = np.array([2500.0, 4200.0, -3.4, -1.2])


@pytest.fixture
def scenario(tmp_path):
    """The example, with its text changed."""
    for name in ("launch.csv", "bearings.csv"):
        shutil.copy(EXAMPLE / name, tmp_path)
    text = (EXAMPLE / "freighter.toml").read_text()

    def make(*changes, more=""):
        changed = text
        for old, new in changes:
            assert old in changed
            changed = changed.replace(old, new)
        path = tmp_path / "scenario.toml"
        path.write_text(changed + more)
        return load(path)

    return make


def test_the_example_is_found(scenario, tmp_path):
    report = scenario().localize()
    assert (report.headline, report.tone) == ("LOCATED", "good")
    error = np.array(report.data["state"]) - TRUTH
    assert (np.abs(error) < 3 * np.array(report.data["std"])).all()
    assert len(report.data["residuals"]) == report.data["bearings"] == 46
    assert report.data["fit"]["p_value"] > 0.01
    assert 0 < report.data["range"]["pieces"][0][0] < np.hypot(*TRUTH[:2])
    page, data = report.write(tmp_path / "out")
    assert page.read_text().count("data:image/svg+xml") == 2
    assert json.loads(data.read_text())["status"] == "determined"
    # The ellipse is that of the covariance: semi-axes over sqrt(chi-square) multiply to its root.
    covariance = np.array(report.data["covariance"])[:2, :2]
    axes = np.array(report.data["error_ellipse"]["semi_axes"])
    assert axes.prod() / 5.991464547 == pytest.approx(np.sqrt(np.linalg.det(covariance)), rel=1e-6)


def test_one_leg_is_unobservable_and_says_what_moves(scenario):
    report = scenario(("duration = 900.0", "duration = 440.0")).localize()
    assert report.headline in ("UNOBSERVABLE", "WEAKLY LOCATED", "NOT LOCATED")
    exact = scenario(("launch.csv", "straight.csv"), ("duration = 900.0", "duration = 440.0"))
    times = np.arange(0, 901, 20)
    rows = "\n".join(f"{t},{2 * t},{5 * t}" for t in times)
    (exact.path.parent / "straight.csv").write_text("t_s,east_m,north_m\n" + rows + "\n")
    report = exact.localize()
    assert (report.headline, report.tone) == ("UNOBSERVABLE", "bad")
    assert "state" not in report.data
    assert report.facts[0][0] == "changes no measurement"
    known = scenario(
        ("launch.csv", "straight.csv"), ("duration = 900.0", "duration = 440.0"),
        more="[prior]\nvx = { mean = -3.4, sigma = 0.1 }\n",
    ).localize()  # fmt: skip
    assert "state" in known.data


def test_a_prior_is_used(scenario):
    free = scenario().localize().data
    known = scenario(more="[prior]\nvx = { mean = -3.4, sigma = 0.01 }\n").localize().data
    assert known["std"][2] < 0.01 < free["std"][2]
    assert known["fit"]["dof"] == free["fit"]["dof"] + 1


def test_a_turn_of_the_target_is_found_where_the_bearings_do_not_fit(scenario, tmp_path):
    report = scenario()
    times = np.arange(0.0, 901.0, 20.0)
    path = report.track(None, times)
    place = TRUTH[:2] + np.outer(times, TRUTH[2:])
    place += np.outer(np.maximum(times - 400.0, 0.0), [4.0, 6.0])
    offsets = place - path
    seen = np.degrees(np.arctan2(offsets[:, 0], offsets[:, 1])) % 360
    seen += 0.1 * np.random.default_rng(4).normal(size=times.size)
    lines = (f"{t},{b}" for t, b in zip(times, seen, strict=True))
    (report.path.parent / "turned.csv").write_text("t_s,bearing_deg\n" + "\n".join(lines) + "\n")
    found = scenario(("bearings.csv", "turned.csv"), ("bearing_deg = 0.5", "bearing_deg = 0.1"))
    report = found.localize()
    assert (report.headline, report.tone) == ("MISFIT", "bad")
    facts = dict(report.facts)
    assert "1 turn of the target" in facts["what would explain them"]
    assert report.data["legs"]["count"] == 2
    turn = report.data["legs"]["estimate"]
    assert abs(turn["state"][turn["names"].index("turn_1")] - 400.0) < 60.0
    assert report.tables[0].title == "Legs of the target"
    page, _ = report.write(tmp_path / "out")
    assert page.read_text().count("data:image/svg+xml") == 3


def test_a_recorded_target_is_compared_with(scenario):
    target = "\n[target]\nx0 = 2500.0\ny0 = 4200.0\nvx = -3.4\nvy = -1.2\n"
    report = scenario(more=target).localize()
    assert np.hypot(*report.data["error"]) < 100
    assert any("recorded" in name for name, _ in report.facts)
    # The same scenario answers `analyze` as well.
    assert scenario(more=target).analyze().headline.startswith("OBSERVABLE")


@pytest.mark.parametrize(
    ("changes", "more", "message"),
    [
        ([("bearings.csv", "none.csv")], "", r"none.csv: cannot be read"),
        ([('bearing_deg = "bearing_deg"', 'bearing_deg = "beta"')], "", "has no column 'beta'"),
        ([("start = 0.0", "start = 2000.0")], "", "has no bearing from 2000 s"),
        ([("duration = 900.0", "duration = 50.0")], "", "3 bearings: a target of order 1 has 4"),
        ([], "[prior]\nspeed = { mean = 1.0, sigma = 1.0 }\n", "prior.speed: localize takes priors"),
        ([], "[prior]\nvx = 1.0\n", "prior.vx: localize needs its mean"),
        ([("[noise]", 'known = ["vx"]\n[noise]')], "", "known"),
    ],
)  # fmt: skip
def test_mistakes_are_named(scenario, changes, more, message):
    with pytest.raises(gm.ScenarioError, match=message):
        scenario(*changes, more=more).localize()


def test_what_is_missing_is_named(scenario):
    with pytest.raises(gm.ScenarioError, match=r"tracks.target: is missing"):
        scenario().analyze()
    text = (EXAMPLE / "freighter.toml").read_text()
    start, end = text.index("[bearings]"), text.index("[window]")
    path = scenario().path
    path.write_text(text[:start] + text[end:])
    with pytest.raises(gm.ScenarioError, match="give the target once"):
        load(path)
    target = "\n[target]\nx0 = 1\ny0 = 1\nvx = 1\nvy = 1\n"
    path.write_text(text[:start] + text[end:] + target)
    with pytest.raises(gm.ScenarioError, match="bearings: is missing"):
        load(path).localize()
