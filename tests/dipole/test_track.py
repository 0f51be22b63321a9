"""The sequential filter of a dipole that maneuvers, against its bound."""

from __future__ import annotations

import numpy as np
import pytest

import gramian as gm

NAMES = ("x", "y", "z", "vx", "vy", "vz", "mx", "my", "mz")
TRUTH = np.array([-10.0, -10.0, 5.0, 1.0, 1.0, 0.0, 10.0, 20.0, 10.0])
SIGMA = np.array([0.5, 0.5, 0.3, 0.1, 0.1, 0.05, 1.5, 1.5, 1.5])
T = np.arange(0.0, 20.0, 0.25)
ACCELERATION, MOMENT = 1e-3, 1e-2


def course(rng, steps=T):
    """Return states (K, 9) of a dipole that wanders."""
    states = [TRUTH]
    for dt in np.diff(steps):
        x = states[-1].copy()
        u, w = rng.normal(size=(2, 3)) * np.sqrt(ACCELERATION * dt)
        x[:3] += dt * x[3:6] + dt / np.sqrt(3) * u
        x[3:6] += np.sqrt(0.75) * u + 0.5 * w
        x[6:] += np.sqrt(MOMENT * dt) * rng.normal(size=3)
        states.append(x)
    return np.array(states)


def recorded(states, rng, sensors, sigma=1e-9):
    place = states[:, None, :3] - sensors
    exact = gm.dipole.field(place, states[:, None, 6:])
    return exact + sigma * rng.normal(size=exact.shape)


def start(mean):
    return dict(zip(NAMES, np.c_[mean, SIGMA].tolist(), strict=True))


SENSORS = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
OPTIONS = {"sigma": 1e-9, "acceleration": ACCELERATION, "moment": MOMENT, "sensors": SENSORS}


def test_errors_are_those_of_the_bound():
    squares, bounds, nees = [], [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        states = course(rng)
        mean = TRUTH + SIGMA * rng.normal(size=9)
        found = gm.dipole.track(
            T, recorded(states, rng, SENSORS), start(mean), truth=states, **OPTIONS
        )
        off = states - found.states
        squares.append(off**2)
        bounds.append(found.bound**2)
        nees.append((found._root @ off[-1]) @ (found._root @ off[-1]))
    rmse, bound = np.sqrt(np.mean(squares, axis=0)), np.sqrt(np.mean(bounds, axis=0))
    late = slice(20, None)
    # A deviation of 9 % each in 60 records, averaged over states that are much alike.
    assert 0.85 < np.median(rmse[late] / bound[late]) < 1.25
    # 9 on average, a deviation of 0.55.
    assert abs(np.mean(nees) - 9) < 2.5


def test_the_bound_is_that_of_the_general_recursion():
    states = course(np.random.default_rng(3))
    rng = np.random.default_rng(4)
    found = gm.dipole.track(
        T, recorded(states, rng, SENSORS), start(TRUTH), truth=states, **OPTIONS
    )
    rows = []
    for x in states:
        parts = [gm.dipole.jacobian(x[:3] - s, x[6:]) for s in SENSORS]
        zero = np.zeros((3, 3))
        rows.append(np.vstack([np.hstack([j.position, zero, j.moment]) for j in parts]) / 1e-9)
    dt = 0.25
    transition = np.eye(9)
    transition[:3, 3:6] = dt * np.eye(3)
    noise = np.zeros((9, 9))
    eye = np.eye(3)
    noise[:3, :3], noise[3:6, 3:6] = ACCELERATION * dt**3 / 3 * eye, ACCELERATION * dt * eye
    noise[:3, 3:6] = noise[3:6, :3] = ACCELERATION * dt**2 / 2 * eye
    noise[6:, 6:] = MOMENT * dt * eye
    general = gm.bounds.posterior(np.array(rows), transition, noise, SIGMA)
    assert found.bound == pytest.approx(general.std, rel=1e-7)


def test_a_track_goes_on_where_it_ended():
    rng = np.random.default_rng(1)
    states = course(rng)
    seen = recorded(states, rng, SENSORS)
    whole = gm.dipole.track(T, seen, start(TRUTH), truth=states, **OPTIONS)
    first = gm.dipole.track(T[:30], seen[:30], start(TRUTH), truth=states[:30], **OPTIONS)
    rest = gm.dipole.track(T[30:], seen[30:], first, truth=states[30:], **OPTIONS)
    assert rest.states == pytest.approx(whole.states[30:], rel=1e-9, abs=1e-12)
    assert rest.bound == pytest.approx(whole.bound[30:], rel=1e-9)


def test_without_wandering_it_ends_at_the_estimate_of_all_samples():
    rng = np.random.default_rng(7)
    states = TRUTH + np.outer(T, [1.0, 1.0, 0, 0, 0, 0, 0, 0, 0])
    seen = recorded(states, rng, SENSORS)
    still = OPTIONS | {"acceleration": 0.0, "moment": 0.0}
    # From a good start, where the field is linear over what is not known.
    good = np.c_[TRUTH, 0.1 * SIGMA].tolist()
    found = gm.dipole.track(T, seen, dict(zip(NAMES, good, strict=True)), **still)
    means = dict(zip(gm.dipole.NAMES, good, strict=True))
    whole = gm.dipole.localize(T, seen, prior=means, sigma=1e-9, sensors=SENSORS, background=None)
    last = np.concatenate([whole.r0 + T[-1] * whole.v, whole.v, whole.m])
    assert (abs(found.states[-1] - last) < 0.1 * found.std[-1]).all()


def test_a_dipole_that_maneuvers_more_than_told_is_a_misfit():
    rng = np.random.default_rng(2)
    states = course(rng)
    seen = recorded(states, rng, SENSORS, 1e-10)
    fine = OPTIONS | {"sigma": 1e-10}
    assert gm.dipole.track(T, seen, start(TRUTH), **fine).status == "determined"
    tight = fine | {"acceleration": 1e-7, "moment": 0.0}
    assert gm.dipole.track(T, seen, start(TRUTH), **tight).status == "misfit"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"times": T[::-1]}, "sample 1: time"),
        ({"sigma": 0.0}, "sigma"),
        ({"acceleration": -1.0}, "acceleration"),
        ({"field": np.zeros((3, 3))}, "field has shape"),
        ({"start": {"x": (0.0, 1.0)}}, "start has no y, z, vx"),
        ({"start": {"x0": (0.0, 1.0)}}, "start of 'x0'"),
        ({"start": start(TRUTH) | {"x": (0.0, 0.0)}}, "start of x"),
        ({"truth": np.zeros(9)}, "truth has shape"),
        ({"sensors": TRUTH[None, :3]}, "sample 0: "),
    ],
)
def test_bad_input_is_named(change, message):
    given = {"times": T, "field": np.zeros((T.size, 3)), "start": start(TRUTH), "sigma": 1e-9}
    with pytest.raises(gm.InputError, match=message):
        gm.dipole.track(**(given | change))
