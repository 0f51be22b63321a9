"""A recorded pair of files of a maritime analysis tool: two ships, bearings and ranges.

The observer keeps its course; the target turns towards it and then follows.
"""

import numpy as np
import pytest

import gramian as gm
from gramian.models.tracks import Carrier, Motion, Scene, Sensor, estimate

pytestmark = pytest.mark.recorded


def seconds(stamp):
    return int(stamp[:2]) * 3600.0 + int(stamp[2:4]) * 60.0 + float(stamp[4:])


@pytest.fixture
def ships(recorded):
    """Times of the bearings, bearings, ranges, and the places of both ships then."""
    tracks = {}
    for line in recorded("rep/sen_tracks.rep").read_text().splitlines():
        word = line.split()
        if len(word) < 13 or word[0].startswith(";"):
            continue
        north = float(word[4]) + float(word[5]) / 60 + float(word[6]) / 3600
        east = float(word[8]) + float(word[9]) / 60 + float(word[10]) / 3600
        tracks.setdefault(word[2], []).append((seconds(word[1]), east, north))
    found = {}
    origin = np.array(tracks["Frigate"])[-47, 1:]
    for name, reports in tracks.items():
        rows = np.array(reports)
        scale = np.radians(6371000.0) * np.array([np.cos(np.radians(origin[1])), 1.0])
        found[name] = (rows[:, 0], (rows[:, 1:] - origin) * scale)
    seen = []
    for line in recorded("rep/sen_frig_sensor.dsf").read_text().splitlines():
        if line.startswith(";SENSOR:"):
            word = line.split()
            # Ranges are in yards.
            seen.append((seconds(word[2]), np.radians(float(word[6])), 0.9144 * float(word[7])))
    times, bearings, ranges = np.array(seen).T

    def at(name):
        t, place = found[name]
        return np.stack([np.interp(times, t, place[:, k]) for k in range(2)], axis=1)

    return times - times[0], bearings, ranges, at("Frigate"), at("New_SSK")


def test_the_reader_agrees_with_the_tracks(ships):
    _, bearings, _, observer, target = ships
    offset = target - observer
    off = bearings - np.arctan2(offset[:, 0], offset[:, 1])
    assert np.abs(np.angle(np.exp(1j * off))).max() < np.radians(2.0)


def test_one_leg_is_a_misfit(ships):
    times, bearings, _, observer, _ = ships
    ship = Carrier(observer, times)
    for count, sigma_deg, chi2 in ((47, 1.0, 1926.0), (22, 0.5, 237.0)):
        sensor = Sensor.bearing(ship, times[:count], sigma=np.radians(sigma_deg))
        scene = Scene(Motion.constant_velocity(), [sensor])
        # The observer is straight but for the rounding of its track: the whole range
        # is not determined either, and the misfit is told where it is.
        start = [3000.0, 3000.0, 0.0, 0.0]
        found = estimate(scene, [bearings[:count]], rtol=1e-12)
        assert found.fit.chi2 == pytest.approx(chi2, rel=0.02), (count, start)
        assert found.status == "misfit"
        assert found.fit.p_value < 1e-30


def test_legs_are_unobservable_from_a_straight_path(ships):
    """The relative track can be scaled by any factor."""
    times, _, _, observer, target = ships
    line = np.polynomial.polynomial.polyfit(times, observer, 1)
    straight = line[0] + times[:, None] * line[1]
    assert np.abs(straight - observer).max() < 25.0
    ship = Carrier(straight[[0, -1]], times[[0, -1]])
    turns = [500.0, 900.0, 1500.0]
    sensor = Sensor.bearing(ship, times, sigma=np.radians(1.0))
    scene = Scene(Motion.legs(turns), [sensor])
    knots = np.array([0.0, *turns, times[-1]])
    places = np.stack([np.interp(knots, times, target[:, k]) for k in range(2)], axis=1)
    velocity = np.diff(places, axis=0) / np.diff(knots)[:, None]
    state = np.concatenate([places[0], velocity.ravel()])
    answer = gm.analyze(gm.tracks.problem(scene, state))
    assert (answer.nullity, answer.status) == (1, "unobservable")
    relative = np.concatenate([places[0] - straight[0], (velocity - line[1]).ravel()])
    null = answer.null_space[:, 0]
    cosine = abs(null @ relative) / np.linalg.norm(null) / np.linalg.norm(relative)
    assert cosine == pytest.approx(1.0, abs=1e-9)


def test_one_range_determines_everything(ships):
    """The rank is full, and the recorded track is inside the likelihood region."""
    times, bearings, ranges, observer, target = ships
    ship = Carrier(observer, times)
    turns = [360.0, 660.0, 840.0, 960.0, 1080.0, 1200.0, 1350.0]
    # Whole degrees were cut off towards zero: the middle is half a degree on.
    middle = bearings + np.sign(bearings) * np.radians(0.5)
    sensors = [
        Sensor.bearing(ship, times, sigma=np.radians(1.0)),
        Sensor.range(ship, times[:1], sigma=100.0),
    ]
    scene = Scene(Motion.legs(turns), sensors)
    z = scene.pack([middle, ranges[:1]])
    # The recorded track on these legs: linear in the states.
    design = np.stack([scene.track(unit, times).ravel() for unit in np.eye(scene.n)], axis=1)
    recorded = np.linalg.lstsq(design, target.ravel(), rcond=None)[0]
    assert np.abs(design @ recorded - target.ravel()).max() < 200.0
    answer = gm.analyze(gm.tracks.problem(scene, recorded))
    assert answer.nullity == 0
    assert np.isfinite(answer.crlb_std).all()
    alone = Scene(scene.motion, sensors[:1])
    without = gm.analyze(gm.tracks.problem(alone, recorded))
    assert without.singular_values[-1] < 0.03 * answer.singular_values[-1]
    found = estimate(scene, z, start=recorded, max_iterations=300)
    there = scene._inner.linearize(z, recorded)[0]
    # 95 % of chi-square with 18 degrees of freedom.
    assert (there**2).sum() - found.fit.chi2 < 28.87
