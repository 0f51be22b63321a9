"""A dipole that is none: each wrong model is a misfit, or its error is told before it happens."""

import pickle

import numpy as np
import pytest

import gramian as gm
from gramian.models.dipole import DipoleModel, localize

TIMES = np.arange(0.0, 20.0, 0.5)
R0, V, M = np.array([-10.0, -10, 5]), np.array([1.0, 1, 0]), np.array([10.0, 20, 10])
SIGMA = 3e-10
KNOWN = {"z": 5.0, "vz": 0.0}
TRIALS = 12


def record(kind, seed):
    place = R0 + TIMES[:, None] * V
    if kind.startswith("acceleration"):
        size = float(kind.split()[-1])
        place = place + 0.5 * TIMES[:, None] ** 2 * size * V / np.linalg.norm(V)
    field = np.array(gm.dipole.field(place, np.broadcast_to(M, place.shape)))
    if kind == "second dipole":
        other = R0 + [0.0, -4.0, 0.0] + TIMES[:, None] * V
        field += gm.dipole.field(other, np.broadcast_to([3.0, -2.0, 4.0], other.shape))
    if kind == "10 nT left in":
        field += [10e-9, 3e-9, -5e-9]
    field += SIGMA * np.random.default_rng(seed).normal(size=field.shape)
    if kind.startswith("dead"):
        field[:, "xyz".index(kind[-1])] = 0.0
    return field


def covered(answer):
    """Whether undetectable errors of a kind that was tested explain how far the answer is off."""
    off = np.abs(answer.state - answer.model.coordinates(np.concatenate([R0, V, M])))
    told = [np.abs(a.effect) for a in answer.fit.alternatives if np.isfinite(a.detectable)]
    return (off <= np.max(told, axis=0) + 3 * answer.std).all()


@pytest.mark.parametrize(
    ("kind", "background", "least"),
    [
        ("acceleration 0.01", None, 0),
        ("acceleration 0.03", None, TRIALS),
        ("10 nT left in", None, TRIALS),
        ("dead x", "fit", TRIALS),
        ("dead y", "fit", TRIALS),
        ("dead z", "fit", TRIALS),
    ],
)
def test_a_wrong_model_is_a_misfit_or_its_error_is_covered(kind, background, least):
    misfits = 0
    for seed in range(TRIALS):
        answer = localize(TIMES, record(kind, seed), KNOWN, sigma=SIGMA, background=background)
        if answer.status == "misfit":
            misfits += 1
        else:
            assert covered(answer)
    assert misfits >= least


def test_an_acceleration_is_named():
    answer = localize(TIMES, record("acceleration 0.03", 1), KNOWN, sigma=SIGMA)
    assert "acceleration" in answer.fit.alternatives[0].name
    assert "acceleration" in answer.reason
    assert "would go unseen" in localize(TIMES, record("honest", 1), KNOWN, sigma=SIGMA).summary()


def test_a_dead_channel_is_named():
    answer = localize(TIMES, record("dead y", 1), KNOWN, sigma=SIGMA, background="fit")
    assert answer.reason == "channel y is constant over the record: dead or stuck"
    doubled = record("honest", 1)
    doubled[:, 2] = 2.0 * doubled[:, 0]
    told = localize(TIMES, doubled, KNOWN, sigma=SIGMA)
    assert told.fit.faults == ("channel z is a copy of channel x",)


def test_a_second_dipole_is_mostly_a_misfit():
    found = [localize(TIMES, record("second dipole", k), KNOWN, sigma=SIGMA) for k in range(10)]
    assert sum(answer.status == "misfit" for answer in found) >= 6


def test_honest_passes_are_determined():
    found = [localize(TIMES, record("honest", seed), KNOWN, sigma=SIGMA) for seed in range(20)]
    assert all(answer.status == "determined" for answer in found)
    # The lag test, of neighbours of one channel, has its level.
    late = np.array([answer.fit.lag1[3] for answer in found])
    assert 0 <= (late < 0.05).sum() <= 8


def test_the_answer_is_an_estimate_with_the_region_of_the_likelihood():
    answer = localize(TIMES, record("honest", 3), KNOWN, sigma=SIGMA)
    assert isinstance(answer, gm.Estimate)
    assert answer.names == ("x0", "y0", "vx", "vy", "mx", "my", "mz")
    assert answer.fit.dof == 3 * TIMES.size - 7
    # The height is known and the track passes overhead: no range below 5 m is left.
    near = answer.interval("range")
    assert near.pieces[0][0] == pytest.approx(5.0, abs=1e-6)
    assert near.local == pytest.approx(1.959964 * answer.closest.range_std, rel=1e-4)
    assert answer.interval("speed").local == pytest.approx(1.959964 * answer.speed[1], rel=1e-4)
    assert answer.contains(answer.model.coordinates(np.concatenate([R0, V, M])))
    assert len(answer.region(("x0", "y0")).contours) == 1
    again = pickle.loads(pickle.dumps(answer))
    assert again == answer
    assert again["z0"] == 5.0


def test_a_known_speed_is_told_by_angles_and_the_mirror_image_is_another_solution():
    known = {"speed": np.linalg.norm(V)}
    answer = localize(TIMES, record("honest", 4), known, sigma=SIGMA)
    assert answer.status == "ambiguous"
    assert answer.names[3:5] == ("v from z", "v about z")
    assert answer.others[0].chance == pytest.approx(0.5)
    assert len(answer.interval("vx").pieces) == 2
    image = answer.model.expand(answer.others[0].state)[0]
    assert image[:3] == pytest.approx(-answer.r0, rel=1e-6)
    found = gm.other_solutions(answer.model, answer.state)
    # Angles a whole turn apart are one state.
    assert answer.model.expand(found[0].state)[0][:3] == pytest.approx(-answer.r0, rel=1e-6)


def test_the_model_serves_the_general_estimate():
    weights = np.full((TIMES.size, 1, 3), 1 / SIGMA)
    near = np.concatenate([R0, V, M])
    model = DipoleModel(TIMES, np.zeros((1, 3)), weights, near, {"z0": 5.0, "vz": 0.0}, {})
    field = record("honest", 5)
    general = gm.estimate(model, field.ravel())
    own = localize(TIMES, field, KNOWN, sigma=SIGMA)
    assert general.state == pytest.approx(own.state, rel=1e-6)
    assert general.status == own.status == "determined"


def test_without_a_sigma_chi2_tests_nothing():
    answer = localize(TIMES, record("honest", 6), KNOWN)
    assert np.isnan(answer.fit.p_value)
    assert answer.status == "determined"
    # The alternatives still do.
    assert localize(TIMES, record("10 nT left in", 6), KNOWN).status == "misfit"


def test_widened_deviations_allow_for_what_is_left_over_and_do_not_hide_that_it_is():
    t = np.arange(0.0, 20.0, 0.1)
    sensors = [[0.0, 0.0, 0.0], [0.0, 3.0, 0.0]]
    y = gm.dipole.simulate(
        [-10, -9, 5], [1, 0.9, 0], [10, 20, 10], t, 1e-11, seed=2, sensors=sensors
    )
    y += gm.dipole.measure([-12, -11, 5], [1, 0.9, 0], [3, -4, 6], t, sensors=sensors)
    found = gm.dipole.localize(t, y, sensors=sensors)
    wide = found.widened()
    assert found.status == wide.status == "misfit"
    assert wide.reason == found.reason
    truth = float(np.hypot(1.0, 0.9))
    factor = wide.sigma / found.sigma
    assert factor > 2
    np.testing.assert_allclose(wide.pass_std, factor * found.pass_std, rtol=1e-6)
    narrow, broad = (answer.interval("speed").pieces[0] for answer in (found, wide))
    assert not narrow[0] < truth < narrow[1]
    assert broad[1] - broad[0] > 1.5 * (narrow[1] - narrow[0])
    # A fit with nothing left over but noise is hardly widened, and never narrowed.
    y = gm.dipole.simulate([-10, -9, 5], [1, 0.9, 0], [10, 20, 10], t, 1e-11, 2, sensors=sensors)
    found = gm.dipole.localize(t, y, sensors=sensors)
    assert found.status == found.widened().status
    assert found.sigma <= found.widened().sigma < 1.3 * found.sigma


def test_a_late_clock_of_one_of_two_sensors_is_told_and_named():
    # Along the track a late clock and a shorter way between the sensors are nearly one.
    times = np.arange(0.0, 6.0, 0.02)
    pair = [[0.0, 0, 0], [0.0, 0.5, 0]]
    v, m = [0.0, 10.0, 0.0], [80.0, 40.0, 90.0]

    def exact(late, sensors):
        return gm.dipole.measure([0.9, -22.0 - 10.0 * late, -1.5], v, m, times, sensors=sensors)

    noise = 5e-8 * np.random.default_rng(6).normal(size=(times.size, 3, 3))
    field = exact(0.0, pair) + noise[:, :2]
    clean = gm.dipole.localize(times, field, sensors=pair, sigma=5e-8)
    (clock,) = (a for a in clean.fit.alternatives if a.name.startswith("clock"))
    assert (clock.name, clock.unit, clock.dof) == ("clock of sensor 2", "s", 1)
    assert clean.unseen_errors[0].startswith("clock of sensor 2 of")
    late = field.copy()
    late[:, 1] = exact(1e-4, pair)[:, 1] + noise[:, 1]
    shift = gm.dipole.localize(times, late, sensors=pair, sigma=5e-8).state - clean.state
    foretold = 1e-4 * clock.per_unit / clean.std
    assert np.abs(foretold).max() > 0.05
    assert shift / clean.std == pytest.approx(foretold, abs=0.05 * np.abs(foretold).max())
    # Across the track it shows.
    across = [[0.0, 0, 0], [4.0, 0, 0], [0, 0, 3.0]]
    field = exact(0.0, across) + noise
    field[:, 2] = exact(0.1, across)[:, 2] + noise[:, 2]
    seen = gm.dipole.localize(times, field, sensors=across, sigma=5e-8)
    assert seen.status == "misfit"
    assert seen.fit.alternatives[0].name == "clock of sensor 3"


def test_alternatives_have_units_and_none_is_a_state_of_the_fit():
    times = np.arange(0.0, 6.0, 0.02)
    pair = [[0.0, 0, 0], [4.0, 0, 1.0]]
    passing = [0.9, -22.0, -1.5], [0.0, 10.0, 0.0], [80.0, 40.0, 90.0]
    field = gm.dipole.simulate(*passing, times, 5e-8, seed=6, sensors=pair)
    straight = gm.dipole.localize(times, field, sensors=pair, sigma=5e-8).fit.alternatives
    unit = {a.name.split(" of ")[0]: a.unit for a in straight}
    assert unit["acceleration"] == unit["acceleration along the track"] == "m/s^2"
    assert (unit["clock"], unit["gain"], unit["a quadrupole"]) == ("s", "", "A m^3")
    assert unit["a second dipole behind"] == "A m^2"
    told = {"sensors": pair, "sigma": 5e-8, "motion": "accelerated", "background": "drift"}
    names = [a.name for a in gm.dipole.localize(times, field, **told).fit.alternatives]
    assert not [name for name in names if name.startswith(("acceleration", "drift", "background"))]
