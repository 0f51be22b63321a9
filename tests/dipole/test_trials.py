"""Trials of a body that is more than one dipole on a straight pass, with priors."""

import numpy as np
import pytest

import gramian as gm
from gramian.models.dipole import localize, localize_trials

TIMES, SIGMA = np.arange(0.0, 20.0), 1e-12
PASS = [-10.0, -10.0, 10.0], [1.0, 1.0, 0.0], [10.0, 20.0, 10.0]
GIVEN = *PASS, TIMES, SIGMA
SENSORS = [[0.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.5, 0.0, 0.0]]
TWO = [[1.6, 1.2, 1.0, -12.0, 8.0, 15.0]]
PRIOR = {"z": (10.2, 0.2), "vz": (0.01, 0.02)}


@pytest.mark.parametrize(
    ("known", "prior"),
    [({}, PRIOR), ({"vz": 0.0}, {"z": (10.2, 0.2)}), ({"speed": np.sqrt(2)}, PRIOR)],
)
def test_trials_of_two_dipoles_are_those_of_localize(known, prior):
    found = localize_trials(
        *GIVEN, 5, 2, known=known, prior=prior, sensors=SENSORS, dipoles=TWO, first=3
    )
    fields = gm.monte_carlo.Dipole(*GIVEN, sensors=SENSORS, dipoles=TWO).simulate(5, 3, 2)
    for state, field in zip(found, fields, strict=True):
        one = localize(TIMES, field, known, prior=prior, sensors=SENSORS, sigma=SIGMA, sources=2)
        assert one.converged
        np.testing.assert_array_equal(state, np.concatenate([one.r0, one.v, one.m]))


def test_a_prior_of_the_first_tells_which_it_is():
    """One dipole explains most of the field, at the place of the second."""
    strong = [[1.6, 1.2, 1.0, -24.0, 16.0, 30.0]]
    prior = {"z": (10.0, 0.05), "vz": (0.0, 0.02)}
    found = localize_trials(*GIVEN, 1, 2, prior=prior, sensors=SENSORS, dipoles=strong)
    assert (np.abs(found - np.concatenate(PASS))[:, 2] < 0.2).all()
    assert (np.abs(found - np.concatenate(PASS))[:, 6:] < 5.0).all()


def test_a_prior_that_is_true_of_either_tells_no_order():
    level = [[1.6, 1.2, 0.0, -24.0, 16.0, 30.0]]
    given = {"sensors": SENSORS, "known": ["vz"], "dipoles": level, "prior": {"z0": 0.05}}
    scene = gm.monte_carlo.Dipole(*GIVEN, **given)
    off = scene.estimate("ml", 1, 0, 3).errors / gm.crlb_std(scene.problem())
    assert (np.abs(off) < 4.5).all()


def test_of_two_dipoles_without_a_prior_the_order_is_the_nearest_to_the_truth():
    found = localize_trials(*GIVEN, 5, 2, sensors=SENSORS, dipoles=TWO)
    bound = gm.crlb_std(gm.monte_carlo.Dipole(*GIVEN, sensors=SENSORS, dipoles=TWO).problem())[:9]
    assert (np.abs(found - np.concatenate(PASS)) < 5 * bound).all()


def test_errors_with_a_prior_are_those_of_the_bound():
    """Each trial's mean is drawn about the truth."""
    # Little noise: with more the likelihood of two dipoles bends within it.
    given = *PASS, TIMES, 1e-13
    told = {"sensors": SENSORS, "known": ["vz"], "dipoles": TWO}
    scene = gm.monte_carlo.Dipole(*given, prior={"z0": 1e-3}, **told)
    trials = 10
    errors = scene.estimate("ml", 3, 0, trials).errors
    rows = scene.problem().rows
    # Four deviations of the mean.
    nees = ((errors @ rows.T) ** 2).sum(axis=1)
    states = len(scene.names)
    assert abs(nees.mean() / states - 1) < 4 * np.sqrt(2 / (states * trials))
    free = gm.monte_carlo.Dipole(*given, **told)
    z = scene.names.index("z0")
    assert gm.crlb_std(scene.problem())[z] < 1e-3 < gm.crlb_std(free.problem())[z]
    assert errors[:, z].std() < 1.6e-3
    # The noise is the same, and a trial depends on its number alone.
    np.testing.assert_array_equal(scene.simulate(3, 0, 2), free.simulate(3, 0, 2))
    assert scene._priors(3, 1, 1) == scene._priors(3, 0, 2)[1:]


def test_a_prior_of_one_dipole():
    given = *PASS, TIMES, 1e-11
    scene = gm.monte_carlo.Dipole(*given, known=["vz"], prior={"z0": 0.05, "vx": 0.02})
    found = gm.monte_carlo.run(scene, 200, seed=1)
    states = len(scene.names)
    assert abs(found.nees.mean / states - 1) < 4 * np.sqrt(2 / (states * 200))
    line = scene._priors(1, 7, 1)[0]
    one = localize_trials(*given, 1, 1, known={"vz": 0.0}, prior=line, first=7)
    off = scene.estimate("ml", 1, 7, 1).errors[0]
    names = [gm.dipole.NAMES.index(name) for name in scene.names]
    np.testing.assert_array_equal(off, (one[0] - np.concatenate(PASS))[names])


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"dipoles": [[1.0, 2.0]]}, r"dipoles has shape \(1, 2\): must be \(n, 6\)"),
        ({"dipoles": TWO, "prior": {"zz": (1.0, 1.0)}}, "'zz' cannot be known"),
        ({"dipoles": TWO, "prior": {"z": (1.0, 0.0)}}, "prior of z"),
        ({"dipoles": TWO, "known": {"z": 1.0}, "prior": {"z": (1.0, 1.0)}}, "z0 is known exactly"),
        ({"attitude": -0.1}, "attitude = -0.1: must be > 0"),
        ({"acceleration": 0.1, "turn_rate": 0.1}, "two motions"),
        ({"scale": 0.1, "ambient": [0.0, 0.0, 5e-5]}, "attitude and scale are errors of sensors"),
    ],
)
def test_bad_bodies(more, message):
    with pytest.raises(gm.InputError, match=message):
        localize_trials(*GIVEN, 1, 1, sensors=SENSORS, **more)


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        ({"z": 0.1}, "prior has 'z'"),
        ({"z0": 0.0}, "prior of z0 = 0.0: must be > 0"),
        ({"vz": 0.1}, "vz is known exactly and has a prior"),
    ],
)
def test_bad_priors_of_an_experiment(prior, message):
    with pytest.raises(gm.InputError, match=message):
        gm.monte_carlo.Dipole(*GIVEN, known=["vz"], prior=prior)
