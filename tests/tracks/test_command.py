"""Scenario files of tracks: analyze, localize, simulate."""

import csv
from pathlib import Path

import numpy as np
import pytest

import gramian as gm
from gramian.scenario import load

EXAMPLE = Path(__file__).parents[2] / "examples" / "towed_array.toml"


def test_the_example_is_analyzed_and_simulated(tmp_path):
    scenario = load(EXAMPLE)
    report = scenario.analyze()
    assert report.headline == "OBSERVABLE"
    assert all(page.exists() for page in report.write(tmp_path / "page"))
    simulated = scenario.simulate(200, 1, progress=False)
    assert "tonal" in str(simulated.data)


def test_measurements_of_a_file_are_localized(tmp_path):
    scenario = load(EXAMPLE)
    scene = scenario.scene
    z = gm.tracks.simulate(scene, scenario.state, seed=3)
    with (tmp_path / "z.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["sensor", "value"])
        for sensor, where in zip(scene.sensors, scene.slices, strict=True):
            writer.writerows([sensor.name, repr(float(value))] for value in z[where])
    text = EXAMPLE.read_text() + '\n[measurements]\nfile = "z.csv"\n'
    (tmp_path / "s.toml").write_text(text)
    report = load(tmp_path / "s.toml").localize()
    assert report.headline == "DETERMINED"
    truth = [scenario.state[name] for name in scene.names]
    off = np.abs(np.array(report.data["state"]) - truth) / report.data["std"]
    assert (off < 5).all()
    assert all(picture.draw() is not None for picture in report.pictures)


def test_slips_are_named(tmp_path):
    def said(old, new):
        (tmp_path / "s.toml").write_text(EXAMPLE.read_text().replace(old, new))
        with pytest.raises(gm.ScenarioError) as caught:
            load(tmp_path / "s.toml").analyze()
        return str(caught.value)

    assert "carrier 'shop'" in said('carrier = "ship"', 'carrier = "shop"')
    assert "the states are" in said("vx = -3", "vq = -3")
    assert "outside the carrier's path" in said("last = 1205", "last = 1305")
    assert "sigma" in said("sigma_deg = 0.5", "sigma_deg = 0.5\nsigma = 0.1")
