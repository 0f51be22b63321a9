"""Rows, null combinations and simulation of scenes."""

import pickle

import numpy as np
import pytest

import gramian as gm
from gramian.models.tracks import Carrier, Motion, Scene, Sensor, problem, rows, simulate

CV = Motion.constant_velocity()
TIMES = np.arange(0.0, 600.0, 20.0)
COAST = Carrier([0.0, 0.0], name="coast")
STRAIGHT = Carrier([[0, 0], [3000, 0]], [0.0, 600.0], name="straight")
BENT = Carrier([[0, 0], [1500, 0], [1500, 1500]], [0.0, 300.0, 600.0], name="bent")
STATE = np.array([4000.0, 3000.0, -5.0, 2.0])


def nullity(sensors, state, motion=CV):
    return gm.analyze(problem(Scene(motion, sensors), state))


def test_rows_of_bearings_are_those_of_gm_bearings():
    scene = Scene(CV, [Sensor.bearing(BENT, TIMES, sigma=0.01)])
    target = STATE[:2] + TIMES[:, None] * STATE[2:]
    wanted = gm.bearings.rows(TIMES, BENT.at(TIMES)[0], target, 0.01)
    np.testing.assert_allclose(rows(scene, STATE), wanted, rtol=1e-12, atol=1e-12)


def test_rows_of_a_fixed_target_are_the_information_of_maneuver():
    path = BENT.at(TIMES)[0]
    scene = Scene(Motion.fixed(), [Sensor.bearing(BENT, TIMES, sigma=0.02)])
    found = rows(scene, [2500.0, 2200.0])
    offset = np.array([2500.0, 2200.0]) - path
    square = (offset**2).sum(axis=1)
    wanted = np.stack([offset[:, 1], -offset[:, 0]], axis=1) / square[:, None] / 0.02
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


@pytest.mark.parametrize("carrier", [COAST, STRAIGHT])
@pytest.mark.parametrize("ranges", [False, True])
def test_a_bias_of_bearings_turns_the_relative_track(carrier, ranges):
    """Exact for a fixed carrier, and for a straight one at constant velocity."""
    sensors = [Sensor.bearing(carrier, TIMES, sigma=0.01, bias="compass")]
    if ranges:
        sensors.append(Sensor.range(carrier, TIMES, sigma=10.0))
    answer = nullity(sensors, [*STATE, 0.0])
    # Bearings alone of such a carrier leave the scale of the track free as well.
    assert answer.nullity == (1 if ranges else 2)
    velocity = np.array([5.0, 0.0]) if carrier is STRAIGHT else np.zeros(2)
    relative = np.array([STATE[:2], STATE[2:] - velocity])
    turn = np.stack([relative[:, 1], -relative[:, 0]], axis=1)
    null = np.concatenate([turn.ravel(), [-1.0]])
    found = answer.null_space
    part = found @ np.linalg.lstsq(found, null, rcond=None)[0]
    assert np.abs(part - null).max() < 1e-5 * np.abs(null).max()
    null[-1] *= -1
    # The sign matters: bearings grow clockwise, and the track must turn back.
    assert np.linalg.norm(rows(Scene(CV, sensors), [*STATE, 0.0]) @ null) > 1


def test_a_turning_carrier_tells_the_bias():
    sensors = [Sensor.bearing(BENT, TIMES, sigma=0.01, bias="compass")]
    assert nullity(sensors, [*STATE, 0.0]).nullity == 0
    # And a target known to be at rest, from a straight carrier.
    sensors = [Sensor.bearing(STRAIGHT, TIMES, sigma=0.01, bias="compass")]
    assert nullity(sensors, [4000.0, 3000.0, 0.0], Motion.fixed()).nullity == 0


def test_frequency_alone_from_a_fixed_carrier_leaves_a_rotation():
    sensors = [Sensor.frequency(COAST, TIMES, speed=1500.0, sigma=0.05)]
    answer = nullity(sensors, [*STATE, 300.0])
    assert answer.nullity == 1
    turn = np.array([STATE[1], -STATE[0], STATE[3], -STATE[2], 0.0])
    residual = rows(Scene(CV, sensors), [*STATE, 300.0]) @ turn
    assert np.abs(residual).max() < 1e-9


def test_frequency_makes_bearings_of_a_straight_observer_observable():
    bearing = Sensor.bearing(STRAIGHT, TIMES, sigma=0.01)
    assert nullity([bearing], STATE).nullity == 1
    tone = Sensor.frequency(STRAIGHT, TIMES, speed=1500.0, sigma=0.02)
    assert nullity([bearing, tone], [*STATE, 300.0]).nullity == 0


def test_clock_offset_and_place_along_the_track_are_confounded():
    """The place along the track moves against the offset where the carrier drops out."""
    sensors = [
        Sensor.bearing(COAST, TIMES, sigma=0.01, clock="clock"),
        Sensor.range(COAST, TIMES, sigma=10.0, clock="clock"),
    ]
    answer = nullity(sensors, [*STATE, 0.5])
    assert answer.nullity == 1
    null = np.array([*STATE[2:], 0.0, 0.0, 1.0])
    assert np.abs(rows(Scene(CV, sensors), [*STATE, 0.5]) @ null).max() < 1e-9


def test_time_difference_with_unknown_clocks():
    """Three receivers, two differences: their clock differences as states, rank full."""
    others = [Carrier([6000.0, 0.0]), Carrier([0.0, 6000.0])]
    sensors = [
        Sensor.time_difference(
            COAST, other, TIMES, speed=1500.0, sigma=1e-4, clocks=(None, f"clock_{k}")
        )
        for k, other in enumerate(others)
    ]
    assert nullity(sensors, [*STATE, 0.01, -0.02]).nullity == 0
    # A target at rest: one difference of clocks is one of range, and no more is told.
    assert nullity(sensors, [4000.0, 3000.0, 0.01, -0.02], Motion.fixed()).nullity == 2


def test_signal_strength_with_unknown_power():
    path = Carrier([[0, 0], [3000, 500], [2500, 3000]], [0.0, 300.0, 600.0])
    sensors = [Sensor.signal_strength(path, TIMES, sigma=1.0, exponent="eta")]
    answer = nullity(sensors, [1500.0, 1800.0, 30.0, 2.1], Motion.fixed())
    assert answer.nullity == 0
    # A fixed receiver of a fixed target has one number.
    still = [Sensor.signal_strength(COAST, TIMES, sigma=1.0)]
    assert nullity(still, [1500.0, 1800.0, 30.0], Motion.fixed()).nullity == 2


def test_radar_and_camera_in_space():
    radar, camera = Carrier([0.0, 0.0, 10.0]), Carrier([2000.0, 500.0, 30.0])
    late = TIMES[:-1] + 7.0
    sensors = [
        Sensor.range(radar, TIMES, sigma=20.0),
        Sensor.bearing(radar, TIMES, sigma=0.01),
        Sensor.bearing(camera, late, sigma=0.001, bias="pan"),
        Sensor.elevation(camera, late, sigma=0.001, bias="tilt"),
    ]
    motion = Motion.constant_velocity(dimension=3)
    state = [5000.0, 7000.0, 1500.0, -60.0, -40.0, 3.0, 0.0, 0.0]
    assert nullity(sensors, state, motion).nullity == 0
    assert nullity(sensors[1:2], state[:6], motion).nullity == 3


def test_detection_is_expected_information():
    full = Scene(CV, [Sensor.bearing(BENT, TIMES, sigma=0.01)])
    part = Scene(CV, [Sensor.bearing(BENT, TIMES, sigma=0.01, detection=0.36)])
    np.testing.assert_allclose(rows(part, STATE), 0.6 * rows(full, STATE))
    z = simulate(part, STATE, trials=400, seed=3)
    assert abs(np.mean(~np.isnan(z)) - 0.36) < 0.02


def test_one_model_whatever_the_frame():
    """Moving and turning everything leaves the bound on speed as it is."""
    angle = 0.7
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    path = np.asarray(BENT.path) @ turn.T + [300.0, -500.0]
    state = np.concatenate([turn @ STATE[:2] + [300.0, -500.0], turn @ STATE[2:]])
    bounds = []
    for carrier, x in ((BENT, STATE), (Carrier(path, BENT.times), state)):
        scene = Scene(CV, [Sensor.bearing(carrier, TIMES, sigma=0.01)])
        j = rows(scene, x).T @ rows(scene, x)
        bounds.append(np.linalg.det(j))
    assert bounds[1] == pytest.approx(bounds[0], rel=1e-8)


def test_trials_depend_on_seed_and_number_alone():
    scene = Scene(CV, [Sensor.bearing(BENT, TIMES, sigma=0.01, correlation_time=60.0)])
    all_of_them = simulate(scene, STATE, trials=5, seed=9)
    np.testing.assert_array_equal(
        simulate(scene, STATE, trials=2, seed=9, first=3), all_of_them[3:]
    )


def test_scenes_pickle():
    scene = Scene(CV, [Sensor.bearing(BENT, TIMES, sigma=0.01, bias="compass")])
    other = pickle.loads(pickle.dumps(scene))
    np.testing.assert_array_equal(rows(other, [*STATE, 0.1]), rows(scene, [*STATE, 0.1]))


def test_mask_drops_samples():
    mask = np.arange(TIMES.size) % 3 > 0
    scene = Scene(CV, [Sensor.bearing(BENT, TIMES, sigma=0.01, mask=mask)], reference=0.0)
    full = Scene(CV, [Sensor.bearing(BENT, TIMES, sigma=0.01)])
    np.testing.assert_array_equal(rows(scene, STATE), rows(full, STATE)[mask])
    z = full.values(STATE)
    np.testing.assert_array_equal(scene.pack([z]), z[mask])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Scene(CV, [Sensor.elevation(COAST, TIMES, sigma=0.1)]), "elevation.*3 dimensions"),
        (
            lambda: Scene(CV, [Sensor.bearing(Carrier([0.0, 0.0, 0.0]), TIMES, sigma=0.1)]),
            "3 components: the motion has 2",
        ),
        (
            lambda: Scene(CV, [Sensor.bearing(BENT, [0.0, 700.0], sigma=0.1)]),
            r"times\[1\] = 700 s: outside the carrier's path, 0 to 600 s",
        ),
        (lambda: Scene(CV, [Sensor.bearing(COAST, TIMES, sigma=4.0)]), "at most pi"),
        (lambda: Scene(CV, [Sensor.range(COAST, TIMES, sigma=-1.0)]), r"sigma\[0\] = -1: must be"),
        (
            lambda: Scene(CV, [Sensor.range(COAST, [0.0, 1.0], covariance=[[1, 2], [2, 1]])]),
            "not positive definite",
        ),
        (lambda: Scene(CV, [Sensor.cone_angle(COAST, TIMES, sigma=0.1)]), "no heading"),
        (lambda: Sensor.range(COAST, TIMES, sigma=1.0, bais="b"), "no argument 'bais'"),
        (lambda: Sensor.range(COAST, TIMES), "give sigma, or covariance"),
        (lambda: Scene(CV, []), "sensors is empty"),
        (Motion.legs, "turns, or the count"),
        (
            lambda: Scene(
                Motion.legs([105.0, 115.0]), [Sensor.bearing(BENT, TIMES + 1.0, sigma=0.1)]
            ),
            "leg 2, from 105 to 115 s, has no measurement",
        ),
        (
            lambda: rows(Scene(CV, [Sensor.range(COAST, TIMES, sigma=1.0)]), [1.0, 2.0]),
            r"must be \(..., 4\)",
        ),
        (
            lambda: problem(
                Scene(CV, [Sensor.range(COAST, TIMES, sigma=1.0)]), {"x0": 1.0, "q": 2.0}
            ),
            "no state is named 'q'",
        ),
        (
            lambda: rows(Scene(CV, [Sensor.range(COAST, TIMES, sigma=1.0)]), [0.0, 0.0, 1.0, 0.0]),
            r"sensors\[0\] \(range\): sample 0: the target is at the carrier",
        ),
        (
            lambda: rows(
                Scene(CV, [Sensor.cone_angle(STRAIGHT, TIMES, sigma=0.1)]), [9000.0, 0.0, 0.0, 0.0]
            ),
            "cone angle of 0 or pi",
        ),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(gm.InputError, match=message):
        make()


def test_measurements_that_cannot_be():
    scene = Scene(
        CV, [Sensor.bearing(BENT, TIMES, sigma=0.01), Sensor.range(BENT, TIMES, sigma=1.0)]
    )
    z, r = scene.values(STATE)[: TIMES.size], scene.values(STATE)[TIMES.size :]
    with pytest.raises(gm.InputError, match=r"beyond .*are these degrees"):
        scene.pack([np.degrees(z), r])
    with pytest.raises(gm.InputError, match=r"range\[0\] = -.* m: must not be negative"):
        scene.pack([z, -r])
    with pytest.raises(gm.InputError, match="3 samples: must have 30"):
        scene.pack([z[:3], r])
    with pytest.raises(gm.InputError, match="must be finite, or NaN"):
        scene.pack([z, np.where(r > 4500, np.inf, r)])
    with pytest.warns(UserWarning, match="are these degrees"):
        scene.pack([np.arange(TIMES.size) % 6, r])


def test_what_is_too_far_for_squares_is_refused():
    """Rows of zeros would call it unobservable."""
    times = [0.0, 10.0, 20.0]
    with pytest.raises(gm.InputError, match="path of carrier is farther than 1e\\+150 m"):
        gm.tracks.Carrier([[0.0, 0.0], [1e151, 0.0], [0.0, 1.0]], times)
    ship = gm.tracks.Carrier([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]], times)
    sensor = gm.tracks.Sensor.bearing(ship, times, sigma=0.01)
    scene = gm.tracks.Scene(gm.tracks.Motion.fixed(), [sensor])
    for function in (gm.tracks.problem, gm.tracks.rows, gm.tracks.simulate):
        with pytest.raises(gm.InputError, match=r"state: y0 = -1e\+160: must be within 1e\+150"):
            function(scene, [1e3, -1e160])
    assert gm.analyze(gm.tracks.problem(scene, [1e3, -1e3])).rank == 2
