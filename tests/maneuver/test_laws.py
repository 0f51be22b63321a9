"""The closed-form laws: published and reference values, the range recursion, bad input."""

import json
from pathlib import Path

import numpy as np
import pytest

import gramian as gm

REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "maneuver.json").read_text())
LAWS = ("max_det", "hammel_liu", "bearing_rate", "circle", "perpendicular")
CASE = {"target": [0.0, 1000.0], "start": [0.0, 0.0], "speed": 20.0, "dt": 1.0}


@pytest.mark.parametrize("law", ["max_det", "hammel_liu"])
def test_paths_equal_the_references(law):
    path = gm.maneuver.trajectory(**CASE, samples=500, law=law, sigma=0.001**0.5)
    for samples, wanted in REFERENCE[law].items():
        k = int(samples) - 1
        got = {
            "det": path.det[k],
            "J_xx": path.information[k, 0, 0],
            "J_yy": path.information[k, 1, 1],
            "range_m": path.ranges[k],
            "x": path.path[k, 0],
            "y": path.path[k, 1],
        }
        for name, value in wanted.items():
            assert got[name] == pytest.approx(value, rel=1e-12), (samples, name)


def test_range_follows_the_recursion():
    path = gm.maneuver.trajectory([30.0, -700.0], [200.0, 90.0], 7.0, 2.0, 400)
    r, s = path.ranges[:-1], 14.0
    np.testing.assert_allclose(
        path.ranges[1:], np.abs(r**2 - s**2) / np.sqrt(r**2 + s**2), rtol=1e-12
    )
    assert (np.diff(path.ranges) < 0).all()


def test_the_tangent_goes_inside_the_circle_and_perpendicular_leaves_it():
    tangent = gm.maneuver.trajectory(**CASE, samples=300, law="bearing_rate")
    np.testing.assert_allclose(tangent.ranges, np.sqrt(1000.0**2 - 400.0 * np.arange(300)))
    circle = gm.maneuver.trajectory(**CASE, samples=300, law="circle")
    np.testing.assert_allclose(circle.ranges, 1000.0, rtol=1e-12)
    spiral = gm.maneuver.trajectory(**CASE, samples=300, law="perpendicular")
    np.testing.assert_allclose(spiral.ranges, np.sqrt(1000.0**2 + 400.0 * np.arange(300)))


def test_max_det_heading_is_the_best_of_a_fine_grid():
    rng = np.random.default_rng(3)
    for _ in range(20):
        r, ratio, bearing = rng.uniform(10, 1e4), rng.uniform(0.01, 0.99), rng.uniform(-3, 3)
        s = ratio * r
        c = np.linspace(0, np.pi, 20001)
        after = s**2 + r**2 - 2 * r * s * np.cos(c)
        best = c[np.argmax(s**2 * np.sin(c) ** 2 / after**2)]
        ours = gm.maneuver.heading(bearing, r, s)
        assert np.cos(ours - bearing) == pytest.approx(np.cos(best), abs=3e-4)


def test_the_tangent_is_perpendicular_to_the_line_of_sight_at_its_end():
    path = gm.maneuver.trajectory([50, 900], [3, -70], 35.0, 2.0, 60, law="bearing_rate", side=-1)
    off = path.headings - path.bearings[1:] + np.pi / 2
    np.testing.assert_allclose(np.sin(off), 0.0, atol=1e-13)
    assert np.degrees(gm.maneuver.heading(0, 100, 60, "bearing_rate")) == pytest.approx(
        53.13010235415598, rel=1e-14
    )


def test_no_heading_changes_the_bearing_more_than_the_tangent():
    rng = np.random.default_rng(4)
    for _ in range(20):
        r, ratio = rng.uniform(10, 1e4), rng.uniform(0.01, 0.99)
        off = np.linspace(0, np.pi, 20001)
        change = np.arctan2(ratio * np.sin(off), 1 - ratio * np.cos(off))
        tangent = gm.maneuver.heading(0.0, r, ratio * r, "bearing_rate")
        assert tangent == pytest.approx(off[np.argmax(change)], abs=2e-4)
        assert change.max() == pytest.approx(np.arcsin(ratio), abs=1e-7)


@pytest.mark.parametrize(("law", "det"), [("bearing_rate", 0.0772), ("circle", 0.0623)])
def test_the_two_laws_of_the_bearing_rate_in_the_case_of_the_tables(law, det):
    path = gm.maneuver.trajectory(**CASE, samples=500, law=law, sigma=0.001**0.5)
    assert path.det[-1] == pytest.approx(det, abs=5e-5)


def flown(ratio, legs, sides):
    return gm.maneuver.trajectory([0, 1], [0, 0], ratio, 1.0, legs + 1, sides=sides).det[-1]


def test_keeping_the_side_is_best_for_two_legs():
    for ratio in (0.01, 0.1, 0.3):
        assert flown(ratio, 2, [1, 1]) > flown(ratio, 2, [1, -1])
        best = gm.maneuver.trajectory([0, 1], [0, 0], ratio, 1.0, 3, side="best")
        assert best.sides.tolist() == [1, 1]


def test_over_more_legs_changes_of_side_can_be_better():
    pattern = [1 if c == "+" else -1 for c in "++--++-+++"]
    assert flown(0.2, 10, pattern) / flown(0.2, 10, np.ones(10)) == pytest.approx(1.257, abs=5e-4)
    for turn, gain in ((15, 1.00144), (17, 1.00155)):
        sides = np.where(np.arange(160) < turn, 1, -1)
        one = flown(0.02, 160, np.ones(160))
        assert flown(0.02, 160, sides) / one == pytest.approx(gain, abs=5e-6)


@pytest.mark.parametrize("law", LAWS)
def test_the_best_sides_are_the_best_of_all(law):
    legs = 9
    every = 1 - 2 * (np.arange(2 ** (legs - 1))[:, None] >> np.arange(legs) & 1)
    case = {"target": [0, 400], "start": [5, 0], "speed": 60.0, "dt": 1.0, "samples": legs + 1}
    case |= {"law": law, "standoff": 60.0, "at_standoff": "circle"}
    all_of_them = gm.maneuver.trajectory(**case, sides=every)
    best = gm.maneuver.trajectory(**case, side="best")
    assert best.det[-1] == pytest.approx(all_of_them.det[:, -1].max(), rel=1e-9)


def test_the_best_sides_of_long_paths_are_at_least_one_side():
    speeds = np.array([5.0, 20.0, 30.0])
    case = {"target": [0, 1000], "start": [0, 0], "dt": 1.0, "samples": 300, "standoff": 500.0}
    one = gm.maneuver.trajectory(**case, speed=speeds)
    best = gm.maneuver.trajectory(**case, speed=speeds, side="best")
    assert (best.det[:, -1] >= one.det[:, -1] * (1 - 1e-12)).all()
    assert (np.abs(np.diff(best.sides)).sum(axis=1) > 0).any()
    paths = gm.maneuver.trajectory([0, 1], [0, 0], 0.02, 1.0, 161, side="best")
    assert paths.det[-1] / flown(0.02, 160, np.ones(160)) > 1.005


def test_hammel_liu_maximises_the_integral_of_bearing_rate_over_range_for_small_steps():
    r, s = 1000.0, 1.0
    u = (np.arange(200) + 0.5) / 200

    def integral(c):
        after2 = r**2 + (s * u) ** 2 - 2 * r * s * u * np.cos(c)
        return np.mean(r * np.sin(c) / after2**1.5)

    c = np.pi / 2 - np.linspace(0, 4, 4001) * np.arctan(s / r)
    best = c[np.argmax([integral(x) for x in c])]
    off = np.pi / 2 - gm.maneuver.heading(0.0, r, s, "hammel_liu")
    assert off == pytest.approx(np.pi / 2 - best, rel=2e-3)


@pytest.mark.parametrize("law", LAWS)
def test_sides_mirror_and_geometry_turns(law):
    path = gm.maneuver.trajectory(**CASE, samples=60, law=law)
    left = gm.maneuver.trajectory(**CASE, samples=60, law=law, side=-1)
    np.testing.assert_allclose(left.path * [-1, 1], path.path, atol=1e-9)
    np.testing.assert_allclose(left.det, path.det, rtol=1e-12)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    shift = np.array([5000.0, -3000.0])
    turned = gm.maneuver.trajectory(turn @ [0, 1000] + shift, shift, 20.0, 1.0, 60, law=law)
    np.testing.assert_allclose(turned.path, path.path @ turn.T + shift, atol=1e-8)
    np.testing.assert_allclose(turned.det, path.det, rtol=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_trajectory_flies_the_headings_of_the_law(law):
    path = gm.maneuver.trajectory(**CASE, samples=40, law=law, side=-1)
    wanted = gm.maneuver.heading(path.bearings[:-1], path.ranges[:-1], 20.0, law, side=-1)
    np.testing.assert_allclose(np.cos(path.headings - wanted), 1.0, rtol=1e-14)
    legs = 20.0 * np.stack([np.sin(path.headings), np.cos(path.headings)], axis=-1)
    np.testing.assert_allclose(np.diff(path.path, axis=0), legs, atol=1e-10)


def test_batches_equal_single_paths():
    rng = np.random.default_rng(5)
    targets, starts = rng.normal(scale=3000, size=(3, 1, 2)), rng.normal(scale=300, size=(7, 2))
    side = rng.choice([-1, 1], size=(3, 7))
    speed = rng.uniform(1, 4, size=7)
    batch = gm.maneuver.trajectory(targets, starts, speed, 2.0, 50, side=side, standoff=50.0)
    assert batch.path.shape == (3, 7, 50, 2)
    for i, j in [(0, 0), (2, 6), (1, 3)]:
        one = gm.maneuver.trajectory(
            targets[i, 0], starts[j], speed[j], 2.0, 50, side=side[i, j], standoff=50.0
        )
        for name in ("path", "bearings", "ranges", "headings", "information", "det", "count"):
            np.testing.assert_allclose(
                getattr(batch, name)[i, j], getattr(one, name), rtol=1e-12, atol=1e-12
            )


def test_path_stops_at_the_standoff():
    free = gm.maneuver.trajectory(**CASE, samples=400)
    path = gm.maneuver.trajectory(**CASE, samples=400, standoff=800.0)
    flown = int(path.count)
    assert flown == np.count_nonzero(free.ranges >= 800.0)
    np.testing.assert_array_equal(path.path[:flown], free.path[:flown])
    assert (path.path[flown:] == path.path[flown - 1]).all()
    assert (path.det[flown:] == path.det[flown - 1]).all()


def test_path_circles_at_the_standoff():
    path = gm.maneuver.trajectory(**CASE, samples=400, standoff=800.0, at_standoff="circle")
    assert path.ranges.min() >= 800.0 * (1 - 1e-12)
    np.testing.assert_allclose(path.ranges[-50:], 800.0, rtol=1e-12)
    assert path.count == 400
    stopped = gm.maneuver.trajectory(**CASE, samples=400, standoff=800.0)
    assert path.det[-1] > 1.5 * stopped.det[-1]


def test_reaching_a_step_of_range_is_an_error_that_names_the_sample():
    with pytest.raises(gm.InputError, match=r"sample 3\d\d: the step, 30 m, is longer than"):
        gm.maneuver.trajectory([0, 1000], [0, 0], 30.0, 1.0, 4000)
    path = gm.maneuver.trajectory([0, 1000], [0, 0], 30.0, 1.0, 4000, standoff=30.0)
    assert 30.0 <= path.ranges[-1] < 200.0


def test_landing_on_the_target_is_an_error():
    with pytest.raises(gm.InputError, match="position 1 is the target's"):
        gm.maneuver.trajectory([0, 10], [0, 0], 10.0, 1.0, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speed": 0.0}, "speed = 0.0 m/s: must be > 0"),
        ({"speed": [20.0, np.nan]}, r"speed\[1\] = nan m/s: must be > 0 and finite"),
        ({"dt": -1.0}, "dt = -1.0 s: must be > 0"),
        ({"samples": 0}, "samples = 0: must be >= 1"),
        ({"start": [0.0, 1000.0]}, "position 0 is the target's"),
        ({"start": [0.0, 990.0]}, "sample 0: the step, 20 m, is longer than the range, 10 m"),
        ({"sigma": 0.0}, "sigma = 0 rad: must be > 0"),
        ({"standoff": -1.0}, "standoff = -1: must be >= 0"),
        ({"standoff": 1200.0}, "position 0 is at range 1000 m, inside the stand-off range 1200 m"),
        ({"side": 0}, "side = 0: must be 1 .* or -1"),
        ({"side": "both"}, 'side = .both.: must be "best"'),
        ({"sides": [1, -1]}, r"sides has shape \(2,\): must be \(..., 9\): one for each leg"),
        ({"sides": [2] * 9}, "side = 2: must be 1"),
        ({"sides": [1] * 9, "side": -1}, "side and sides: give one of them"),
        ({"law": "best"}, 'law = "best": must be "max_det"'),
        ({"at_standoff": "turn"}, 'at_standoff = .turn.: must be "stop" or "circle"'),
        ({"target": [0.0, np.inf]}, r"target\[1\] = inf: must be finite"),
        ({"target": [0.0, 1.0, 2.0]}, r"target has shape \(3,\): must be \(..., 2\)"),
        ({"start": [[0.0, 0.0], [0.0, 1000.0]]}, r"at batch index \[1\]: position 0 is the target"),
    ],
)
def test_bad_input_of_a_trajectory_is_named(change, message):
    with pytest.raises(gm.InputError, match=message):
        gm.maneuver.trajectory(**{**CASE, "samples": 10, **change})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, 0.0, 1.0), "range_ = 0 m: must be > 0"),
        ((0.0, 10.0, 0.0), "step = 0 m: must be > 0"),
        ((0.0, 10.0, [1.0, 11.0]), r"at batch index \[1\]: .*the step, 11 m, is longer than"),
        ((0.0, 10.0, 11.0, "bearing_rate"), "longer than the range, 10 m"),
        ((0.0, 10.0, 21.0, "circle"), "longer than twice the range, 10 m"),
        ((np.nan, 10.0, 1.0), "bearing = nan: must be finite"),
    ],
)
def test_bad_input_of_a_heading_is_named(arguments, message):
    with pytest.raises(gm.InputError, match=message):
        gm.maneuver.heading(*arguments)
