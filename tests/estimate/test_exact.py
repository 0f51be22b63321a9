"""Measurements known exactly, nonlinear ones: the state keeps to them, from starts that do not."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

import gramian as gm

LOOKS = np.random.default_rng(1).standard_normal((4, 3))
LOOKS /= np.linalg.norm(LOOKS, axis=1)[:, None]


def turned(q):
    """Rotate by a quaternion (w, x, y, z) of any length, as a polynomial: q v q*."""
    w, x, y, z = q
    matrix = np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )
    return (LOOKS @ matrix.T).ravel()


@pytest.mark.parametrize("length", [lambda q: q @ q, lambda q: np.sqrt(q @ q)])
@pytest.mark.parametrize("seed", range(12))
def test_a_quaternion_of_length_one(seed, length):
    rng = np.random.default_rng(seed)
    q = Rotation.random(random_state=seed).as_quat()
    h = lambda x: np.append(turned(x), length(x))  # noqa: E731
    z = h(q) + np.append(0.01 * rng.standard_normal(12), 0)
    start = q + 0.2 * rng.standard_normal(4)
    names = ["w", "x", "y", "z"]
    found = gm.estimate(gm.from_function(h, start, [0.01] * 12 + [0.0], names), z, search=False)
    assert (found.status, found.converged) == ("determined", True)
    assert np.linalg.norm(found.state) == pytest.approx(1, abs=1e-12)
    # As on the sphere, by tangent and retraction.
    sphere = gm.from_function(turned, q, 0.01, names, tangent=[tuple(names)])
    wanted = gm.estimate(sphere, z[:12], search=False)
    np.testing.assert_allclose(found.state * np.sign(found.state @ q), wanted.state, atol=1e-7)
    np.testing.assert_allclose(found.std, wanted.std, rtol=1e-4)


CURVES = {
    "circle": (lambda p: p @ p, lambda a: 10 * np.array([np.cos(a), np.sin(a)])),
    "range": (lambda p: np.hypot(*(p - 3)), lambda a: 3 + 10 * np.array([np.cos(a), np.sin(a)])),
    "ellipse": (
        lambda p: (p[0] / 10) ** 2 + (p[1] / 3) ** 2,
        lambda a: np.array([10 * np.cos(a), 3 * np.sin(a)]),
    ),
}


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("seed", range(20))
def test_a_point_on_a_curve(curve, seed):
    tied, point = CURVES[curve]
    rng = np.random.default_rng(seed)
    truth = point(rng.uniform(0, 2 * np.pi))
    h = lambda p: np.array([p[0] - 0.3 * p[1], np.hypot(p[0] - 40, p[1] + 30), tied(p)])  # noqa: E731
    z = h(truth) + np.append(0.3 * rng.standard_normal(2), 0)
    start = truth * rng.uniform(0.6, 1.7) + 0.7 * rng.standard_normal(2)
    found = gm.estimate(gm.from_function(h, start, [0.3, 0.3, 0.0], ["x", "y"]), z)
    assert found.converged
    assert tied(found.state) == pytest.approx(z[2], rel=1e-12)

    def chi2(angle):
        return float(np.sum(((z - h(point(angle)))[:2] / 0.3) ** 2))

    # The least along the whole curve, point by point, then to all digits.
    angles = np.linspace(0, 2 * np.pi, 2001)
    near = angles[np.argmin([chi2(a) for a in angles])]
    best = minimize_scalar(chi2, bounds=(near - 0.01, near + 0.01), options={"xatol": 1e-12})
    fits = {"determined", "weak", "ambiguous"}
    assert found.status in (fits if best.fun < 9 else fits | {"misfit"})
    assert chi2_of(found, z, h) == pytest.approx(best.fun, rel=1e-6, abs=1e-6)


def chi2_of(found, z, h):
    return float(np.sum(((z - h(found.state))[:2] / 0.3) ** 2))


@pytest.mark.parametrize("seed", range(20))
def test_two_exact_ranges(seed):
    rng = np.random.default_rng(seed)
    beacons, truth = rng.uniform(-100, 100, (5, 3)), rng.uniform(-50, 50, 3)
    h = lambda p: np.linalg.norm(p - beacons, axis=1)  # noqa: E731
    sigma = np.array([1.0, 1.0, 1.0, 0.0, 0.0])
    z = h(truth) + sigma * rng.standard_normal(5)
    start = truth + 15 * rng.standard_normal(3)
    found = gm.estimate(gm.from_function(h, start, sigma, ["x", "y", "z"]), z)
    assert found.converged
    np.testing.assert_allclose(h(found.state)[3:], z[3:], rtol=1e-12)
    # Along the circle where both are met nothing is better: the slope is that of the exact ones.
    rows = (found.state - beacons) / h(found.state)[:, None]
    slope = rows[:3].T @ (z - h(found.state))[:3]
    left = np.linalg.lstsq(rows[3:].T, slope, rcond=None)[0]
    np.testing.assert_allclose(rows[3:].T @ left, slope, atol=1e-5)


def test_as_many_exact_ones_as_states_leave_nothing_to_the_others():
    beacons = np.array([[0.0, 0.0], [100.0, 0.0]])
    h = lambda p: np.append(np.linalg.norm(p - beacons, axis=1), p)  # noqa: E731
    model = gm.from_function(h, [30.0, 40.0], [0.0, 0.0, 5.0, 5.0], ["x", "y"])
    z = h(np.array([40.0, 30.0])) + np.array([0, 0, 3, -2])
    found = gm.estimate(model, z, start=[60.0, 5.0])
    assert found.converged
    np.testing.assert_allclose(found.state, [40, 30], atol=1e-9)
    assert (found.std < 1e-3).all()


def test_exact_ones_that_repeat_each_other():
    h = lambda p: [p @ p, 2 * (p @ p), p[0] - p[1]]  # noqa: E731
    model = gm.from_function(h, [3.0, 3.0], [0.0, 0.0, 0.1], ["x", "y"])
    found = gm.estimate(model, [25.0, 50.0, -1.0], start=[2.0, 7.0])
    assert found.converged
    np.testing.assert_allclose(found.state, [3, 4], atol=1e-9)
    # That contradict each other are no fit.
    wrong = gm.estimate(model, [25.0, 50.5, -1.0], start=[2.0, 7.0])
    assert wrong.status in {"misfit", "not_converged"}
