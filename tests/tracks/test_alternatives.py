"""What a scene's estimate says where the scene is wrong: misfit, and by what."""

import numpy as np
import pytest

import gramian as gm
from gramian.models.tracks import Carrier, Motion, Scene, Sensor, TracksModel, estimate, simulate

CV = Motion.constant_velocity()
TIMES = np.linspace(0.0, 1200.0, 60)
STATE = np.array([1500.0, 3700.0, 3.0, -4.0])
SHIP = Carrier([[0, 0], [1060, 1060], [2120, 0], [3180, 1060], [4240, 0]], 300.0 * np.arange(5))
COAST = Carrier([0.0, 0.0])


def mixed(motion=CV, **bearing):
    sensors = [
        Sensor.bearing(SHIP, TIMES, sigma=np.radians(0.3), **bearing),
        Sensor.range(COAST, TIMES[::3], sigma=15.0),
        Sensor.range_rate(COAST, TIMES[1::3], sigma=0.3),
    ]
    return Scene(motion, sensors)


#: What is true, for each alternative: a scene and a state whose departure has size 1.
TRUE = {
    "acceleration": lambda a: (mixed(Motion.constant_acceleration()), [*STATE, 0.7 * a, -a]),
    "turn at 600 s": lambda a: (mixed(Motion.legs([600.0])), [*STATE, 3.0 + a, -4.0 + 0.5 * a]),
    "bias of bearing": lambda a: (mixed(bias="off"), [*STATE, a]),
    "clock of bearing": lambda a: (mixed(clock="late", true_path=True), [*STATE, a]),
}


def size(model, x, name):
    """The size of an alternative whose score has a noncentrality of 25; 36 of two parameters."""
    columns = model.alternatives(np.asarray(x), model.h(x))[name]
    direction = {"acceleration": [0.7, -1.0], "turn at 600 s": [1.0, 0.5]}.get(name, [1.0])
    column = columns @ direction
    rows = model.rows(x)
    left = column - rows @ np.linalg.lstsq(rows, column, rcond=None)[0]
    return (5.0 if columns.shape[1] == 1 else 6.0) / np.linalg.norm(left)


@pytest.mark.parametrize("name", TRUE)
def test_an_alternative_is_named(name):
    """Alone, or with what cannot be told from it."""
    model = TracksModel(mixed())
    scene, state = TRUE[name](size(model, STATE, name))
    records = simulate(scene, state, trials=100, seed=3)
    named = 0
    for z in records:
        found = estimate(mixed(), z, search=False)
        best = found.fit.alternatives[0]
        named += found.status == "misfit" and (name == best.name or name in best.alike)
    assert named >= 0.7 * len(records)


def test_an_honest_scene_fits():
    """Misfit in no more than `alpha`, or little more, of honest records."""
    records = simulate(mixed(), STATE, trials=400, seed=5)
    told = [estimate(mixed(), z, search=False, alpha=0.02).status == "misfit" for z in records]
    # Chi-square and the alternatives, each at 0.02, and correlation at 0.002.
    assert np.mean(told) < 0.04 + 3 * np.sqrt(0.04 / 400)


def test_units_and_sizes_of_alternatives():
    state = [*STATE[:2], 7.0, -4.0]
    scene = mixed(Motion.legs([600.0]))
    found = estimate(mixed(), scene.values([*STATE, 7.0, -4.0]), start=state)
    turn = next(a for a in found.fit.alternatives if a.name == "turn at 600 s")
    assert turn.unit == "m/s"
    # The change of the velocity, to first order.
    np.testing.assert_allclose(turn.size, [4.0, 0.0], atol=0.4)
    units = {a.name: a.unit for a in found.fit.alternatives}
    assert units["bias of bearing"] == "rad"
    assert units["bias of range_rate"] == "m/s"
    assert units["scale of range"] == ""
    assert units["clock of range"] == "s"
    assert units["acceleration"] == "m/s^2"


def test_what_a_state_explains_is_no_alternative():
    scene = mixed(bias="off", clock="late")
    model = TracksModel(scene)
    x = np.array([*STATE, 0.01, 0.5])
    names = set(model.alternatives(x, model.h(x)))
    assert {"bias of bearing", "clock of bearing"} & names == set()
    assert {"bias of range", "clock of range"} <= names


def test_a_target_at_rest_that_moves():
    still = Scene(Motion.fixed(), mixed().sensors)
    z = simulate(mixed(), [1500.0, 3700.0, 0.05, 0.06], seed=1)
    found = estimate(still, z)
    assert found.status == "misfit"
    best = found.fit.alternatives[0]
    assert "motion of order 1" in (best.name, *best.alike)
    assert best.unit == "m/s"


def test_missing_samples_and_delays():
    sensors = [
        Sensor.bearing(SHIP, TIMES, sigma=np.radians(0.3), delay=1500.0),
        Sensor.range(COAST, TIMES[::3], sigma=15.0),
    ]
    scene = Scene(CV, sensors)
    z = simulate(Scene(Motion.legs([600.0]), sensors), [*STATE, 3.6, -4.0], seed=2)
    z[7] = z[33] = np.nan
    found = estimate(scene, z)
    assert found.status == "misfit"
    assert "turn at 600 s" in found.reason


def test_the_general_estimator_takes_the_model():
    scene = mixed()
    z = simulate(scene, STATE, seed=4)
    one, other = estimate(scene, z), gm.estimate(TracksModel(scene), z)
    assert one.status == other.status == "determined"
    np.testing.assert_allclose(one.state, other.state, rtol=1e-9)
    ends = [answer.interval("range").pieces[0] for answer in (one, other)]
    np.testing.assert_allclose(*ends, rtol=1e-6)
    assert one.interval("range at the end").value == pytest.approx(
        np.linalg.norm(one.track([1200.0])[0] - SHIP.path[-1])
    )


def test_other_minima_that_starts_reach_are_told():
    """Ranges from two places: the image across their line is another solution."""
    ends = [Carrier([0.0, 0.0]), Carrier([3000.0, 0.0])]
    scene = Scene(Motion.fixed(), [Sensor.range(c, TIMES[:9], sigma=20.0) for c in ends])
    found = estimate(scene, simulate(scene, [1000.0, 2500.0], seed=1))
    assert found.status == "ambiguous"
    np.testing.assert_allclose(found.others[0].state, found.state * [1, -1], rtol=1e-6)


def test_a_batch_has_a_function_of_its_own():
    records = simulate(mixed(), STATE, trials=3, seed=1)
    with pytest.raises(gm.InputError, match="estimate_many takes batches"):
        estimate(mixed(), records)
    assert gm.tracks.estimate_many(mixed(), records).summary() == "3 trials: 3 determined"
