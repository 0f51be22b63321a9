"""Records of more than one dipole on a straight pass: dipoles chosen by BIC, motions, sensors."""

import numpy as np
import pytest

import gramian as gm
from gramian.models.dipole import Description, DipoleModel

TIMES = np.arange(0.0, 20.0, 0.5)
SENSORS = [[0.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.5, 0.0, 0.0]]
R0, V = np.array([-10.0, -10.0, 10.0]), np.array([1.0, 1.0, 0.0])
M, OFFSET, SECOND = (
    np.array([10.0, 20.0, 10.0]),
    np.array([1.6, 1.2, 0.0]),
    np.array([-12.0, 8.0, 15.0]),
)
KNOWN = {"z": 10.0, "vz": 0.0}
SIGMA = 1e-12


def record(seed, *more, description=None, sigma=SIGMA):
    """A noisy record of the body with these further states."""
    known = {name + "0" * (len(name) == 1): value for name, value in KNOWN.items()}
    model = DipoleModel(
        TIMES,
        np.array(SENSORS),
        np.ones((TIMES.size, 3, 3)),
        np.concatenate([R0, V, M]),
        known,
        {},
        description=description or Description(),
    )
    truth = np.concatenate([R0[:2], V[:2], M, *more])
    noise = np.random.default_rng(seed).normal(size=(TIMES.size, 3, 3)) * sigma
    return model.h(truth).reshape(noise.shape) + noise, truth


def test_two_dipoles_are_chosen_and_located_at_the_bound():
    errors = []
    for seed in range(2):
        y, truth = record(seed, OFFSET, SECOND, description=Description(sources=2))
        found = gm.dipole.localize(TIMES, y, KNOWN, sensors=SENSORS, sigma=SIGMA, sources=(1, 2, 3))
        assert found.candidates[0][0] == Description(sources=2)
        assert found.names[7] == "dx of dipole 2"
        assert found.status == "determined"
        # Which of the two is called the first is not said.
        other = np.concatenate([truth[:2] + OFFSET[:2], V[:2], SECOND, -OFFSET, M])
        off = min((found.state - x for x in (truth, other)), key=lambda e: np.abs(e[:2]).sum())
        errors.append(off @ np.linalg.solve(found.covariance, off) / 13)
    assert np.mean(errors) < 2.5


def test_of_one_dipole_one_is_chosen():
    for seed in range(4):
        y, _ = record(seed)
        found = gm.dipole.localize(TIMES, y, KNOWN, sensors=SENSORS, sigma=SIGMA, sources=(1, 2))
        assert found.candidates[0][0].sources == 1


@pytest.mark.parametrize(
    ("motion", "more"),
    [("along", [0.02]), ("turning", [0.03]), ("accelerated", [0.01, -0.02, 0.005])],
)
def test_motions_are_chosen_and_found(motion, more):
    y, truth = record(3, more, description=Description(motion=motion))
    wanted = {"sensors": SENSORS, "sigma": SIGMA}
    assert gm.dipole.localize(TIMES, y, KNOWN, **wanted).status == "misfit"
    found = gm.dipole.localize(TIMES, y, KNOWN, **wanted, motion=("straight", motion))
    assert found.candidates[0][0].motion == motion
    assert found.status == "determined"
    off = (found.state - truth) / found.std
    assert abs(off).max() < 4.5
    blank = found.model.record(np.zeros(y.size))
    places = np.array([blank.place(truth, t)[0] for t in np.linspace(0, 20, 401)])
    near = found.interval("range")
    assert near.value == pytest.approx(np.linalg.norm(places, axis=1).min(), rel=1e-3)


def test_errors_of_the_sensors_widen_what_follows():
    y, _ = record(5)
    wanted = {"sensors": SENSORS, "sigma": SIGMA, "background": "fit"}
    exact = gm.dipole.localize(TIMES, y, KNOWN, **wanted)
    loose = gm.dipole.localize(TIMES, y, KNOWN, **wanted, attitude=0.02, scale=0.01)
    assert "attitude x of sensor 2" in loose.names
    assert "scale of sensor 3" in loose.names
    free = exact.pass_std > 0
    assert (loose.pass_std[free] > 1.5 * exact.pass_std[free]).all()
    assert loose.status in ("determined", "weak")


def test_a_drift_of_the_background_is_fitted():
    y, truth = record(6)
    y = y + 1e-11 * (TIMES[:, None, None] - 4) + 2e-5
    flat = gm.dipole.localize(TIMES, y, KNOWN, sensors=SENSORS, sigma=SIGMA, background="fit")
    assert flat.status == "misfit"
    found = gm.dipole.localize(TIMES, y, KNOWN, sensors=SENSORS, sigma=SIGMA, background="drift")
    assert found.status == "determined"
    drift = found.state[[name.startswith("drift") for name in found.names]]
    np.testing.assert_allclose(drift, 1e-11, rtol=0.3)
    assert abs((found.state[:7] - truth) / found.std[:7]).max() < 4.5


def test_bad_descriptions():
    y, _ = record(1)
    for options, message in [
        ({"sources": 0}, "sources = 0: must be >= 1"),
        ({"sources": 5}, "sources = 5: must be <= 4"),
        ({"sources": ()}, "at least one"),
        ({"motion": "round"}, "motion = 'round': must be"),
        ({"attitude": -0.1}, r"attitude \[rad\] = -0\.1: must be > 0"),
        ({"scale": 0.0}, r"scale = 0\.0: must be > 0"),
    ]:
        with pytest.raises(gm.InputError, match=message):
            gm.dipole.localize(TIMES, y, KNOWN, sensors=SENSORS, sigma=SIGMA, **options)
