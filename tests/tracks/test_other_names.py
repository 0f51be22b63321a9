"""One motion that is written in several ways, and tracks that read nearly alike."""

import numpy as np
import pytest

import gramian as gm
from gramian.models.tracks import Carrier, Motion, Scene, Sensor, estimate, estimate_many, simulate

TIMES = np.arange(0.0, 600.0, 20.0)
SHIP = Carrier([[0, 0], [1500, 0], [1500, 1500]], [0.0, 300.0, 600.0])
TURN = 2 * np.pi


def polar(motion):
    """Bearings and ranges of a target whose velocity is a speed and courses."""
    sensors = [
        Sensor.bearing(SHIP, TIMES, sigma=0.005),
        Sensor.range(SHIP, TIMES, sigma=30.0),
    ]
    return Scene(motion, sensors)


MOTIONS = {
    "turn": (Motion.coordinated_turn(), [0.002]),
    "legs": (Motion.legs([300.0], constant_speed=True), [2.2]),
}


@pytest.mark.parametrize("kind", MOTIONS)
@pytest.mark.parametrize("course", [0.3, 3.1, 5.0])
def test_the_same_motion_is_no_other_solution(kind, course):
    """Whole turns, an opposite speed, more than half a turn from sample to sample."""
    motion, more = MOTIONS[kind]
    scene = polar(motion)
    found = estimate(scene, simulate(scene, [3000.0, 4000.0, 4.0, course, *more], seed=1))
    assert found.status == "determined", found.reason
    assert not [other for other in found.others if other.chance > 0.01]
    assert found["speed"] > 0
    for name in found.names:
        interval = found.interval(name)
        assert interval.is_local, str(interval)


@pytest.mark.parametrize("kind", MOTIONS)
@pytest.mark.parametrize("true", [3.2, 5.0])
def test_a_prior_of_a_course_holds_for_every_name_of_it(kind, true):
    """286 degrees and -74 degrees are one course, in the prior as in the data."""
    motion, more = MOTIONS[kind]
    scene = polar(motion)
    name = scene.names[3]
    z = simulate(scene, [3000.0, 4000.0, 4.0, true, *more], seed=1)
    states = []
    for turns in (0, -1):
        prior = {name: (true + turns * TURN, 0.1)}
        found = estimate(scene, z, prior=prior)
        assert found.status == "determined", found.reason
        many = estimate_many(scene, z, prior=prior)
        assert str(many.status) == "determined"
        np.testing.assert_allclose(many.state, found.state, rtol=1e-4, atol=1e-6)
        states.append(found.state - [0, 0, 0, turns * TURN, *np.zeros(len(more))])
    np.testing.assert_allclose(states[0], states[1], rtol=1e-5)


def test_a_target_does_not_go_backwards_to_please_a_prior():
    scene = polar(MOTIONS["turn"][0])
    z = simulate(scene, [3000.0, 4000.0, 4.0, 1.0, 0.002], seed=1)
    found = estimate(scene, z, prior={"course": (1.0 + np.pi, 0.8)})
    assert found["speed"] > 0
    # Half a turn is four deviations of the prior, and counts as such.
    assert found.fit.chi2 > 53 + 0.8 * (np.pi / 0.8) ** 2


def test_a_bias_of_bearings_is_one_whatever_its_turns():
    sensors = [
        Sensor.bearing(SHIP, TIMES, sigma=0.01, bias="b", clock="late", true_path=True),
        Sensor.range(SHIP, TIMES, sigma=30.0, clock="late", true_path=True),
    ]
    scene = Scene(Motion.constant_velocity(), sensors)
    truth = [7200.0, 1100.0, -1.8, -4.0, -0.04, -4.0]
    z = simulate(scene, truth, seed=1)
    found = estimate(scene, z, prior={"late": (0.0, 10.0)})
    assert found.status in ("determined", "weak"), found.reason
    for other in found.others:
        assert abs(other.state[4] - found["b"]) < np.pi
    interval = found.interval("b")
    assert len(interval.pieces) == 1
    assert interval.length < 1


@pytest.mark.parametrize("course", [-3.1, 3.1, 5.0])
def test_errors_of_courses_in_trials_are_the_short_way_round(course):
    experiment = gm.monte_carlo.Tracks(
        polar(MOTIONS["turn"][0]), [3000.0, 4000.0, 4.0, course, 0.002]
    )
    result = gm.monte_carlo.run(experiment, 400, seed=1)
    assert (np.abs(result.efficiency - 1) < 0.15).all(), result.efficiency


def listened(path, times, sigma):
    """Frequencies of an unknown tonal along two legs: two tracks, kilometres apart, fit alike."""
    carrier = Carrier(path, [times[0], 0.5 * (times[0] + times[-1]), times[-1]])
    sensor = Sensor.frequency(carrier, times, speed=340.0, sigma=sigma)
    return Scene(Motion.constant_velocity(), [sensor])


@pytest.mark.parametrize("seed", range(6))
def test_a_track_that_reads_nearly_alike_is_found(seed):
    """Mirrored across the first leg, and fitted from there by another solver: SciPy's."""
    from scipy.optimize import least_squares

    rng = np.random.default_rng(seed)
    times = np.linspace(0.0, 700.0, 18)
    bend = rng.uniform(0.1, 0.5)
    ends = [np.zeros(2), 1500.0 * np.array([1.0, 0.0])]
    ends.append(ends[1] + 1500.0 * np.array([np.cos(bend), np.sin(bend)]))
    scene = listened(np.array(ends), times, 0.05)
    truth = np.array([2500.0, 2400.0, 0.5, -0.8, 150.0])
    z = simulate(scene, truth, seed=seed)
    found = estimate(scene, z, prior={"tonal": (150.0, 1.0)})

    def residuals(x):
        return np.append((z - scene.values(x)) / scene.sigma, 150.0 - x[4])

    def rows(x):
        return np.vstack([-gm.tracks.rows(scene, x), [0.0, 0.0, 0.0, 0.0, -1.0]])

    mirror = truth * [1, -1, 1, -1, 1]
    other = least_squares(residuals, mirror, rows, method="lm", x_scale=[1e3, 1e3, 1, 1, 1])
    rise = 2 * other.cost - found.fit.chi2
    assert rise > -1e-3
    if rise < 3.84:
        assert found.status in ("ambiguous", "weak"), found.status
        for k, name in enumerate(scene.names):
            assert other.x[k] in found.interval(name)


def test_noise_takes_angles_beyond_their_ends():
    """What `simulate` gives, `estimate` takes; degrees are refused all the same."""
    sensor = Sensor.cone_angle(SHIP, TIMES[:15], sigma=0.05)
    scene = Scene(Motion.fixed(), [sensor])
    z = simulate(scene, [-4000.0, 60.0], trials=40, seed=1)
    assert (z > np.pi).any()
    assert np.isfinite(estimate_many(scene, z).state).any()
    with pytest.raises(gm.InputError, match="between 0 and pi"):
        estimate(scene, [np.full(15, 3.5)])
    near = Sensor.range(SHIP, TIMES[:5], sigma=20.0)
    scene = Scene(Motion.fixed(), [near])
    assert (scene.pack([[-15.0, 5, 100, 200, 300]]) < 0).any()
    with pytest.raises(gm.InputError, match="must not be negative"):
        scene.pack([[-999.0, 5, 100, 200, 300]])
