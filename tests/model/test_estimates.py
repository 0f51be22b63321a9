"""Models of one's own: estimates, other solutions and Monte Carlo by the user's function."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import gramian as gm

FOLDER = Path(__file__).parents[2] / "examples" / "models"


def gallery(name, **options):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.model(**options)


def gnss():
    """Six satellites, so that a fault shows."""
    more = [[15600e3, 7540e3, 20140e3], [18760e3, 2750e3, 18610e3], [17610e3, 14630e3, 13480e3]]
    more += [[19170e3, 610e3, 18390e3], [-9000e3, 12000e3, 21000e3], [3000e3, -17000e3, 20000e3]]
    return gallery("gnss_clock", satellites=np.array(more))


def beacons():
    anchors = [[0.0, 0.0], [100.0, 0.0], [40.0, 80.0], [0.0, 60.0], [90.0, 90.0]]
    return gallery("trilateration", beacons=np.array(anchors))


def bearings():
    """Three stations, the emitter where the angle wraps."""
    stations = np.array([[0.0, 0.0], [0.0, 500.0], [-1500.0, -900.0], [-1800.0, 1000.0]])

    def seen(p):
        offset = p - stations
        return np.arctan2(offset[:, 1], offset[:, 0])

    names = ["east", "north"]
    return gm.from_function(seen, [-2000.0, 0.0], np.radians(1.0), names, angles=True)


@pytest.mark.parametrize("make", [gnss, beacons, bearings])
class TestThreeOfTheGallery:
    def test_the_truth_is_found(self, make):
        model = make()
        found = gm.estimate(model, model.h(), start=model.x + 0.1 * gm.crlb_std(model))
        assert found.status in {"determined", "weak"}
        np.testing.assert_allclose(found.state, model.x, atol=1e-4 * gm.crlb_std(model).min())
        np.testing.assert_allclose(found.std, gm.crlb_std(model), rtol=1e-6)

    def test_a_planted_bias_is_a_misfit(self, make):
        model = make()
        z = model.simulate(seed=5)
        assert gm.estimate(model, z).status in {"determined", "weak"}
        z[1] += 60 * model.noise.sigma[1]
        wrong = gm.estimate(model, z)
        assert wrong.status == "misfit"
        assert "does not fit" in wrong.reason

    def test_monte_carlo_reaches_the_bound(self, make):
        result = gm.monte_carlo.run(make(), 300, seed=4)
        assert result.failures == ()
        assert (abs(result.efficiency - 1) < 0.2).all()
        assert result.nees.consistent


def test_two_ranges_have_a_mirror_image():
    anchors = np.array([[0.0, 0.0], [100.0, 0.0]])
    model = gm.from_function(
        lambda p: np.hypot(*(p - anchors).T), [50.0, 30.0], 0.5, ["east", "north"]
    )
    box = {"east": (-100.0, 200.0), "north": (-100.0, 100.0)}
    (other,) = gm.other_solutions(model, model.x, box=box)
    np.testing.assert_allclose(other.state, [50.0, -30.0], atol=1e-5)
    found = gm.estimate(model, model.h(), box=box)
    assert found.status == "ambiguous"


def test_vectorised_functions_do_the_same():
    times = np.linspace(0, 4, 9)
    calls = []

    def many(x):
        calls.append(len(x))
        return x[:, :1] * np.sin(x[:, 1:] * times)

    one = gm.from_function(lambda x: x[0] * np.sin(x[1] * times), [2.0, 0.7], 0.1, ["a", "w"])
    all_at_once = gm.from_function(many, [2.0, 0.7], 0.1, ["a", "w"], vectorized=True)
    z = one.simulate(seed=1)
    np.testing.assert_array_equal(z, all_at_once.simulate(seed=1))
    a, b = gm.estimate(one, z), gm.estimate(all_at_once, z)
    np.testing.assert_array_equal(a.state, b.state)
    assert a.fit.chi2 == b.fit.chi2
    assert max(calls) > 4
    np.testing.assert_array_equal(
        gm.monte_carlo.run(one, 40, 1).rmse, gm.monte_carlo.run(all_at_once, 40, 1).rmse
    )


def test_missing_measurements_are_left_out():
    model = beacons()
    z = model.simulate(seed=2)
    z[[1, 3]] = np.nan
    anchors = np.array([[0.0, 0.0], [40.0, 80.0], [90.0, 90.0]])
    fewer = gallery("trilateration", beacons=anchors)
    found, wanted = gm.estimate(model, z), gm.estimate(fewer, z[[0, 2, 4]])
    np.testing.assert_allclose(found.state, wanted.state, rtol=1e-9)
    np.testing.assert_allclose(found.std, wanted.std, rtol=1e-9)
    assert found.fit.dof == wanted.fit.dof == 1
    # Of correlated measurements what is left of their covariance.
    covariance = 0.25 * (np.eye(5) + 0.5)
    correlated = gm.from_function(model.h, model.x, covariance, ["east", "north"])
    left = gm.from_function(
        lambda p: model.h(p)[[0, 2, 4]], model.x, covariance[:3, :3], ["east", "north"]
    )
    np.testing.assert_allclose(
        gm.estimate(correlated, z).state, gm.estimate(left, z[[0, 2, 4]]).state, rtol=1e-9
    )
    with pytest.raises(gm.InputError, match="measurements has 2 entries: must have 5"):
        gm.estimate(model, [1.0, 2.0])
    with pytest.raises(gm.InputError, match=r"measurements\[0\] = inf"):
        gm.estimate(model, [np.inf, *z[1:]])


def test_exact_measurements():
    model = gm.from_function(
        lambda x: [x[0] + x[1], x[0], x[1]], [1.0, 2.0], [0.0, 1.0, 1.0], ["a", "b"]
    )
    found = gm.estimate(model, [3.5, 1.0, 2.0])
    np.testing.assert_allclose(found.state, [1.25, 2.25], atol=1e-6)
    np.testing.assert_allclose(found.std, gm.crlb_std(model), rtol=1e-5)
    assert found.fit.dof == 1


def test_a_quaternion_and_its_opposite_are_one_attitude():
    """q and -q turn alike: no second solution."""
    from scipy.spatial.transform import Rotation

    vectors = np.array([[1.0, 0, 0], [0, 1, 0], [0.3, 0.2, 1]])
    q = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_quat()
    names = ["qx", "qy", "qz", "qw"]

    attitude = gm.from_function(
        lambda x: Rotation.from_quat(x).apply(vectors).ravel(),
        q,
        0.01,
        names,
        tangent=[tuple(names)],
    )
    found = gm.estimate(attitude, attitude.simulate(seed=3))
    assert (found.status, found.others) == ("determined", ())


def test_a_unit_quaternion_stays_one():
    from scipy.spatial.transform import Rotation

    vectors = np.eye(3)[:2]
    q = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_quat()
    names = ["qx", "qy", "qz", "qw"]
    tied = gm.from_function(
        lambda x: Rotation.from_quat(x).apply(vectors).ravel(),
        q,
        0.01,
        names,
        tangent=[tuple(names)],
    )
    turned = gm.estimate(tied, tied.simulate(seed=1))
    # It and its negative are the same rotation, and no other solution.
    assert (turned.status, turned.others) == ("determined", ())
    assert turned.converged
    assert np.linalg.norm(turned.state) == pytest.approx(1, abs=1e-12)
    np.testing.assert_allclose(turned.std, gm.crlb_std(tied.at(turned.state)), rtol=1e-4)
    trials = gm.estimate_trials(tied, q, seed=1, trials=8)
    np.testing.assert_allclose(np.linalg.norm(trials.states, axis=1), 1, atol=1e-12)
    far = Rotation.from_rotvec([1.2, 0.4, -0.6]).as_quat()
    again = gm.estimate(tied, tied.simulate(seed=1), start=far)
    same = np.sign(again.state @ turned.state) * again.state
    np.testing.assert_allclose(same, turned.state, atol=1e-6)


def test_redundant_measurements_must_agree():
    d = np.array([[1.0, -1, 0], [0, 1, -1], [1, 0, -1]])
    anchors = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 8.0]])
    model = gm.from_function(
        lambda p: d @ np.hypot(*(p - anchors).T), [3.0, 2.0], 0.01 * d @ d.T, ["e", "n"]
    )
    z = model.simulate(seed=4)
    assert gm.estimate(model, z).status == "determined"
    with pytest.raises(gm.InputError, match="measurements contradict sigma"):
        gm.estimate(model, z + np.array([0, 0, 0.5]))


def test_an_interval_takes_a_plain_function():
    """By differences, the same as with its gradient."""
    model = beacons()
    found = gm.estimate(model, model.simulate([30.0, 40.0], seed=3))

    def distance(x):
        return np.hypot(x[0], x[1])

    def both(x):
        return distance(x), x / distance(x)

    plain, given = found.interval(distance), found.interval(both)
    assert plain.value == given.value
    np.testing.assert_allclose(plain.pieces, given.pieces, rtol=1e-6)
    coordinate = found.interval(lambda x: x[0])
    np.testing.assert_allclose(coordinate.pieces, found.interval(model.names[0]).pieces, rtol=1e-6)
    with pytest.raises(gm.InputError, match=r"must be a value, or \(value, gradient\)"):
        found.interval(lambda x: [1.0, 2.0, 3.0])
