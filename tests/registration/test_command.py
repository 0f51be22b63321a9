"""Registration: scenario files, and the paper's claims."""

from pathlib import Path

import numpy as np
import pytest

import gramian as gm
from gramian import registration as reg
from gramian.reproduce import reproduce
from gramian.scenario import load

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_analyze_and_localize_the_example(tmp_path):
    scenario = load(EXAMPLES / "two_radars.toml")
    report = scenario.analyze()
    assert report.headline == "OBSERVABLE"
    assert report.data["observability"]["rank"] == 4
    assert report.data["selection"]["chosen"] == ["parallel", "baseline"]
    report.write(tmp_path)
    assert (tmp_path / "report.html").stat().st_size > 10_000
    found = scenario.localize()
    assert found.headline == "ESTIMATED"
    estimate = found.data["estimates"]["all targets"]
    truth = [300.0, np.radians(0.5), -200.0, np.radians(-0.4)]
    error = (np.array(estimate["state"]) - truth) / np.array(estimate["std"])
    assert np.abs(error).max() < 4
    assert "best 2" in found.data["estimates"]
    found.write(tmp_path / "localize")
    checked = scenario.simulate(300, 1, progress=False, resume=tmp_path / "trials")
    assert checked.headline == "REACHES THE BOUND"
    assert len(checked.pictures) >= 3
    assert checked.data["monte_carlo"]["trials"] == 300
    # The bias of one state in four is beyond 95 % of its own: chance, not a bias.
    assert dict(checked.facts)["is it unbiased?"] == "yes, all states together at 99 %"


def test_a_singular_example_is_refused_by_name():
    scenario = load(EXAMPLES / "baseline_only.toml")
    report = scenario.analyze()
    assert report.headline == "UNOBSERVABLE"
    assert "A.range +1, B.range -1" in report.verdict
    found = scenario.localize()
    assert found.headline == "UNOBSERVABLE"
    assert found.tone == "bad"
    assert "A.range +1, B.range -1" in found.verdict


def scenario_file(folder, text):
    path = folder / "s.toml"
    path.write_text(text, encoding="utf-8")
    return path


SENSORS = """model = "registration"
[sensors.A]
east = 0.0
north = 0.0
sigma_range = 50.0
sigma_azimuth_deg = 0.1
[sensors.B]
east = 60000.0
north = 0.0
sigma_range = 50.0
sigma_azimuth_deg = 0.1
"""


def test_reports_from_a_file(tmp_path):
    sensors, sigma = {"A": (0.0, 0.0), "B": (60e3, 0.0)}, (50.0, np.radians(0.1))
    lines = ["target,t,radar,r,az"]
    for name, start in (("T1", -20e3), ("T2", 10e3)):
        k = np.arange(100.0)
        path = np.stack([start + 400 * k, 25e3 + 50 * k], axis=1)
        values = reg.simulate(path, sensors, sigma, {"B.range": -150.0}, seed=3).values
        for t, look in zip(k, values, strict=True):
            for sensor, (r, azimuth) in zip("AB", look, strict=True):
                lines.append(f"{name},{t},{sensor},{r},{np.degrees(azimuth)}")
    (tmp_path / "r.csv").write_text("\n".join(lines), encoding="utf-8")
    section = """[reports]
file = "r.csv"
columns = { target = "target", time = "t", sensor = "radar", range = "r", azimuth_deg = "az" }
"""
    found = load(scenario_file(tmp_path, SENSORS + section)).localize()
    assert found.headline == "ESTIMATED"
    estimate = found.data["estimates"]["all targets"]
    assert abs(estimate["state"][2] + 150) < 4 * estimate["std"][2]
    (tmp_path / "r.csv").write_text("\n".join(lines[:-1]), encoding="utf-8")
    less = load(scenario_file(tmp_path, SENSORS + section)).localize()
    assert dict(less.facts)["left out"] == "1 report of looks of one sensor"
    section += 'missing = "raise"\n'
    with pytest.raises(gm.InputError, match="different length"):
        load(scenario_file(tmp_path, SENSORS + section)).localize()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SENSORS, "give the targets once"),
        (SENSORS.replace("50.0", "-50.0", 1), "sigma_range"),
        (SENSORS + "[biases.C]\nrange = 1.0\n[tracks.T]\nstart=[0,1]\nvelocity=[1,1]\n"
         "duration=9\nstep=1\n", r"biases\.C: no sensor is named so"),
        (SENSORS + "[tracks.T]\nstart=[0,1]\nvelocity=[1,1]\nduration=9\nstep=1\nspeed=3\n",
         "speed"),
    ],
)  # fmt: skip
def test_mistakes_are_named(tmp_path, text, message):
    with pytest.raises(gm.ScenarioError, match=message):
        load(scenario_file(tmp_path, text))


def test_a_radar_on_a_ship(tmp_path):
    """At a steady velocity, or along the same path from a file: one answer."""
    scenario = load(EXAMPLES / "radar_on_a_ship.toml")
    report = scenario.analyze()
    assert report.headline == "OBSERVABLE"
    assert dict(report.facts)["ship.azimuth is"].endswith("of its azimuths and of ship's heading")
    report.write(tmp_path)
    found = scenario.localize()
    estimate = found.data["estimates"]["all targets"]
    error = (np.array(estimate["state"]) - [120.0, 0.0, -60.0, np.radians(1.5)]) / estimate["std"]
    assert np.abs(error).max() < 4
    assert scenario.simulate(300, 1, progress=False).headline == "REACHES THE BOUND"
    t = np.linspace(0.0, 400.0, 41)
    east, north = 40e3 + 2 * t, -3e3 + 9 * t
    heading = np.full(41, np.degrees(np.arctan2(2, 9)))
    lines = [
        "t,x,y,hdg",
        *(",".join(map(repr, r)) for r in np.c_[t, east, north, heading].tolist()),
    ]
    (tmp_path / "ship.csv").write_text("\n".join(lines), encoding="utf-8")
    text = (EXAMPLES / "radar_on_a_ship.toml").read_text(encoding="utf-8")
    start, end = text.index("east = 40000.0"), text.index("azimuths =")
    columns = 'columns = { time = "t", east = "x", north = "y", heading_deg = "hdg" }\n'
    recorded = text[:start] + 'file = "ship.csv"\n' + columns + text[end:]
    again = load(scenario_file(tmp_path, recorded))
    assert np.allclose(again.problem.rows, scenario.problem.rows, rtol=1e-9)
    assert np.allclose(
        again.localize().data["estimates"]["all targets"]["state"], estimate["state"], rtol=1e-6
    )
    short = "\n".join(lines[:30])
    (tmp_path / "ship.csv").write_text(short, encoding="utf-8")
    with pytest.raises(gm.InputError, match=r"sensors\['ship'\]: .*outside the carrier's path"):
        load(scenario_file(tmp_path, recorded)).analyze()
    (tmp_path / "ship.csv").write_text("\n".join(lines[:2]), encoding="utf-8")
    with pytest.raises(gm.ScenarioError, match=r"sensors\.ship.*path has 1 place"):
        load(scenario_file(tmp_path, recorded)).analyze()


SHIP = (EXAMPLES / "radar_on_a_ship.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("velocity = [2.0, 9.0]", "", 'needs a heading_deg, or a sensor that moves'),
        ("velocity = [2.0, 9.0]", "velocity = [2.0, 9.0, 0.0]", "velocity must have 2 numbers"),
        ("north = -3000.0\n", "", "a sensor needs east and north, or a file of its path"),
        ('azimuths = "heading"', 'file = "x.csv"', "file and columns go together"),
        ('azimuths = "heading"', 'azimuths = "bow"', "azimuths"),
        ('azimuths = "heading"',
         'file = "x.csv"\ncolumns = { time = "t", east = "x", north = "y" }',
         "east is for a sensor without a file"),
        ("[biases.ship]", "[[maps]]\nwest = 0.0\neast = 1.0\nsouth = 0.0\nnorth = 1.0\n[biases.ship]",
         "maps are for sensors that stand"),
    ],
)  # fmt: skip
def test_mistakes_about_a_ship_are_named(tmp_path, old, new, message):
    assert SHIP.count(old) == 1
    with pytest.raises(gm.ScenarioError, match=message):
        load(scenario_file(tmp_path, SHIP.replace(old, new)))


def test_the_claims_of_the_paper():
    report = reproduce("zhu-2013")
    assert report.headline.startswith("REPRODUCED")
    for name in "ABC":
        errors = report.data["targets"][name]
        assert errors["ml"][0] < 1.25 * errors["bound"][0]
    trend = next(c for c in report.data["claims"] if c["claim"].endswith("as a trend"))
    assert 0.9 < float(trend["computed"].split()[2]) < 1


@pytest.mark.recorded
def test_recorded_aircraft(recorded):
    """Two radars among recorded aircraft: all of them, the best three, three at random."""
    table = np.genfromtxt(recorded("aircraft_uk.csv"), delimiter=",", names=True, dtype=None,
                          encoding="utf-8")  # fmt: skip
    tracks = {}
    for name in np.unique(table["aircraft"]):
        one = table[table["aircraft"] == name]
        tracks[str(name)] = np.stack([one["east_m"], one["north_m"]], axis=1).astype(float)
    sensors = {"A": (-30e3, -10e3), "B": (30e3, 10e3)}
    sigma = (50.0, np.radians(0.1))
    truth = {"A.range": 300.0, "A.azimuth": np.radians(0.5), "B.range": -200.0,
             "B.azimuth": np.radians(-0.4)}  # fmt: skip
    true = np.array(list(truth.values()))
    chosen = reg.select(tracks, sensors, sigma, 3)
    everyone = list(tracks)
    random = np.random.default_rng(7)
    draws = [list(random.choice(everyone, 3, replace=False)) for _ in range(20)]
    bounds, ratios = {}, {}
    for label, names in {"all": everyone, "best": list(chosen.chosen),
                         **{f"draw {i}": d for i, d in enumerate(draws)}}.items():  # fmt: skip
        looks = np.concatenate([tracks[name] for name in names])
        bounds[label] = gm.crlb_std(reg.problem(looks, sensors, sigma))
        trials = 100 if label in ("all", "best") else 10
        found = reg.estimate_trials(looks, sensors, sigma, truth, seed=5, trials=trials)
        assert (found.status == "determined").all(), label
        rmse = np.sqrt(((found.biases - true) ** 2).mean(axis=0))
        ratios[label] = rmse / bounds[label]
    assert chosen.bounds[-1] == pytest.approx(bounds["best"], rel=1e-9)
    for label in ("all", "best"):
        assert np.abs(ratios[label] - 1).max() < 0.25, (label, ratios[label])
    # Three well chosen are better than three at random, and most of what all can tell.
    size = {label: np.log(bound).mean() for label, bound in bounds.items()}
    drawn = [size[f"draw {i}"] for i in range(20)]
    assert size["all"] < size["best"] <= min(drawn)
    assert np.exp(np.median(drawn) - size["best"]) > 1.2
