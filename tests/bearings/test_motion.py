"""Rows of any order of motion, of several observers, in space, of missed bearings."""

import numpy as np
import pytest

import gramian as gm
from gramian.models.bearings import merge, problem, rows, state_names

STATE = np.array([900, 4000, 300, 3, -2, 1.5, 0.01, -0.02, 0.005, 1e-5, 2e-5, -3e-5])
TIMES = np.linspace(0, 400, 24)
PATH = np.stack(
    [600 * np.sin(TIMES / 90), 450 * np.cos(TIMES / 70), 80 * np.sin(TIMES / 50)], axis=1
)


def state(order, dimensions):
    return STATE.reshape(4, 3)[: order + 1, :dimensions].ravel()


def place(x, dimensions):
    derivatives = x.reshape(-1, dimensions)
    factors = [1, 1, 2, 6]
    return sum(TIMES[:, None] ** k * d / factors[k] for k, d in enumerate(derivatives))


def angles(x, dimensions):
    offset = place(x, dimensions) - PATH[:, :dimensions]
    azimuth = np.arctan2(offset[:, 0], offset[:, 1])
    if dimensions == 2:
        return azimuth
    elevation = np.arctan2(offset[:, 2], np.hypot(offset[:, 0], offset[:, 1]))
    return np.stack([azimuth, elevation], axis=1).ravel()


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_rows_are_the_differences_of_the_angles(order, dimensions):
    x = state(order, dimensions)
    sigma = np.linspace(1e-3, 2e-3, 24)
    up = {"sigma_elevation": 3e-3} if dimensions == 3 else {}
    found = rows(TIMES, PATH[:, :dimensions], x, sigma, order=order, **up)
    noise = np.stack([sigma, np.full(24, 3e-3)], axis=1).ravel() if dimensions == 3 else sigma
    names, units = state_names(order, dimensions)
    by_differences = gm.from_function(
        lambda x: angles(x, dimensions), x, noise, names, scale=np.abs(x) + 1e-6
    )
    assert found == pytest.approx(by_differences.rows(), rel=1e-7, abs=1e-7 * np.abs(found).max())
    named = problem(TIMES, PATH[:, :dimensions], x, sigma, order=order, **up)
    assert (named.names, named.units) == (names, units)
    assert np.array_equal(named.rows, found)
    if order:
        # Positions instead of the state: the same geometry.
        where = place(x, dimensions)
        again = rows(TIMES, PATH[:, :dimensions], where, sigma, order=order, **up)
        assert again == pytest.approx(found, rel=1e-9, abs=1e-12 * np.abs(found).max())


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_an_order_takes_as_many_bearings_as_states(order):
    n = 2 * (order + 1)
    x = state(order, 2)
    path = PATH[:, :2]
    few = gm.analyze(problem(TIMES[: n - 1], path[: n - 1], x, 1e-3, order=order))
    assert (few.status, few.rank) == ("unobservable", n - 1)
    assert gm.analyze(problem(TIMES[:n], path[:n], x, 1e-3, order=order)).rank == n
    with pytest.raises(gm.InputError, match=f"{n - 1} bearings.*order {order} has {n} states"):
        gm.bearings.localize_many(TIMES[: n - 1], np.zeros(n - 1), path[: n - 1], 1e-3, order=order)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_an_observer_that_moves_as_the_target_may_learns_no_scale(order):
    # The observer's own motion is of the target's order: relative motion is known but for scale.
    drift = np.array([[2.0, -1.0], [0.004, 0.003], [2e-5, -1e-5]])[:order]
    path = sum(TIMES[:, None] ** (k + 1) * d / [1, 2, 6][k] for k, d in enumerate(drift))
    answer = gm.analyze(problem(TIMES, path, state(order, 2), 1e-3, order=order))
    assert answer.nullity == 1
    relative = state(order, 2).copy()
    relative[2:] -= drift.ravel()
    null = answer.null_space[:, 0]
    assert null / null[0] == pytest.approx(relative / relative[0], rel=1e-5)
    # One order less of the target's motion, and the maneuver tells.
    if order > 1:
        assert gm.analyze(problem(TIMES, path, state(order - 1, 2), 1e-3)).nullity == 0


def test_several_observers():
    fixed = np.tile([4000.0, 0.0], (24, 1))
    t, where, index = merge((TIMES, PATH[:, :2]), (TIMES, fixed))
    assert t.size == 48
    assert index[:2].tolist() == [0, 1]
    joint = problem(t, where, state(1, 2), 1e-3, observer_index=index)
    apart = problem(TIMES, PATH[:, :2], state(1, 2), 1e-3) + problem(
        TIMES, fixed, state(1, 2), 1e-3
    )
    assert gm.gram(joint.rows) == pytest.approx(gm.gram(apart.rows), rel=1e-12)
    # Two observers at rest see together what neither sees alone.
    t, where, index = merge((TIMES, 0 * fixed), (TIMES + 1.0, fixed))
    assert gm.analyze(problem(TIMES, fixed, state(1, 2), 1e-3)).nullity == 1
    assert gm.analyze(problem(t, where, state(1, 2), 1e-3, observer_index=index)).nullity == 0
    noisy = gm.bearings.simulate(
        t, where, state(1, 2), 1e-3, seed=1, observer_index=index, trials=200
    )
    answer = gm.bearings.localize_many(t, noisy, where, 1e-3, observer_index=index)
    error = (answer.state - state(1, 2)) / answer.std
    assert np.sqrt((error**2).mean(axis=0)) == pytest.approx(np.ones(4), abs=0.2)


def test_elevation_tells_the_range_of_a_known_height():
    level = PATH * [1, 1, 0] + [0, 0, 500]
    answer = gm.analyze(problem(TIMES, level * [0, 0, 1], state(1, 3), 1e-3).fix("z0", "vz"))
    assert answer.status == "observable"
    flat = gm.analyze(problem(TIMES, level[:, :2] * 0, state(1, 2), 1e-3))
    assert flat.status == "unobservable"
    names = set(problem(TIMES, PATH, state(1, 3), 1e-3).combinations)
    assert names == {"range", "bearing", "elevation", "speed", "course"}


@pytest.mark.parametrize("dimensions", [2, 3])
def test_combinations_are_the_differences_of_what_they_name(dimensions):
    x = state(1, dimensions)
    found = problem(TIMES, PATH[:, :dimensions], x, 1e-3).combinations

    def quantities(x):
        offset, v = x[:dimensions] - PATH[0, :dimensions], x[dimensions:]
        values = {
            "range": np.linalg.norm(offset),
            "bearing": np.arctan2(offset[0], offset[1]),
            "speed": np.linalg.norm(v),
            "course": np.arctan2(v[0], v[1]),
        }
        if dimensions == 3:
            values["elevation"] = np.arctan2(offset[2], np.hypot(offset[0], offset[1]))
        return values

    for name, gradient in found.items():
        for i in range(x.size):
            step = np.zeros(x.size)
            step[i] = 1e-4
            slope = (quantities(x + step)[name] - quantities(x - step)[name]) / 2e-4
            assert gradient[i] == pytest.approx(slope, rel=1e-6, abs=1e-9)


def test_missed_bearings_count_by_their_probability():
    plain = rows(TIMES, PATH[:, :2], state(1, 2), 1e-3)
    half = rows(TIMES, PATH[:, :2], state(1, 2), 1e-3, detection=0.5)
    assert gm.gram(half) == pytest.approx(0.5 * gm.gram(plain), rel=1e-12)
    part = np.linspace(0, 1, 24)
    scaled = rows(TIMES, PATH[:, :2], state(1, 2), 1e-3, detection=part)
    assert gm.gram(scaled) == pytest.approx(gm.gram(plain, part), rel=1e-12)
    space = rows(TIMES, PATH, state(1, 3), 1e-3)
    assert gm.gram(
        rows(TIMES, PATH, state(1, 3), 1e-3, detection=part)
    ) == pytest.approx(gm.gram(space, np.repeat(part, 2)), rel=1e-12)  # fmt: skip
    # What the information is on average over runs with misses.
    seen = np.random.default_rng(2).random((4000, 24)) < part
    mean = gm.gram(np.broadcast_to(plain, (4000, 24, 4)), seen.astype(float)).mean(axis=0)
    assert mean == pytest.approx(gm.gram(scaled), rel=0.05)


def test_leading_axes():
    many = np.stack([state(2, 2), 2 * state(2, 2)])
    found = rows(TIMES, PATH[:, :2], many, 1e-3)
    assert found.shape == (2, 24, 6)
    assert np.array_equal(found[1], rows(TIMES, PATH[:, :2], many[1], 1e-3))
    sigma = np.stack([np.full(24, 1e-3), np.full(24, 2e-3)])
    found = rows(TIMES, PATH, state(1, 3), sigma, sigma_elevation=4e-3)
    assert found.shape == (2, 48, 6)
    assert found[0, ::2] == pytest.approx(2 * found[1, ::2], rel=1e-12)
    assert np.array_equal(found[0, 1::2], found[1, 1::2])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: rows(TIMES, PATH[:, :2], np.ones(5), 1), r"target has shape \(5,\): must be \(..., 4\)"),
        (lambda: rows(TIMES, PATH[:, :2], np.ones(4), 1, order=2), r"order = 2 it must be \(..., 6\)"),
        (lambda: rows(TIMES, PATH[:, :2], np.ones(4), 1, order=7), r"order = 7: must be 0, 1, 2 or 3"),
        (lambda: rows(TIMES, PATH, STATE[:4], 1), r"must be \(..., 6\), a state x0, y0, z0"),
        (lambda: rows(TIMES, PATH, PATH + np.array([0, 0, 5]), 1), r"observer\[0\] is straight below or above"),
        (lambda: rows(TIMES, PATH, PATH, 1), r"observer\[0\] is at the target's position"),
        (lambda: rows(TIMES, PATH[:, :2], STATE[:2], 1, order=0, detection=1.5), "detection = 1.5"),
        (lambda: rows(TIMES, PATH[:, :2], STATE[:4], 1, detection=np.ones(3)), r"detection has shape"),
        (lambda: rows(TIMES, PATH[:, :2], STATE[:4], 1, sigma_elevation=1), "in the plane"),
        (lambda: rows(TIMES, PATH, STATE[:6], 1, sigma_elevation=np.ones(9)), "sigma has shape"),
        (lambda: rows(TIMES, PATH, STATE[:6], 1, sigma_elevation=-1), "= -1 rad: must be > 0"),
        (lambda: rows(TIMES * 0, PATH, STATE[:6], 1), r"times\[1\] = 0 s: must be later"),
        (lambda: rows(TIMES, PATH[:, :2], STATE[:4], 1, observer_index=np.zeros(3, int)),
         r"observer_index has shape \(3,\)"),
        (lambda: state_names(1, 4), "dimensions = 4: must be 2 or 3"),
        (merge, "no track"),
        (lambda: merge(([0.0], [[0, 0]]), ([0.0],)), "track 1 has 1 arrays: must have 2"),
        (lambda: merge(([0.0], [[0, 0]]), ([0.0], [[0, 0, 0]])), "track 1 has an array of shape"),
    ],
)  # fmt: skip
def test_bad_input(call, message):
    with pytest.raises(gm.InputError, match=message):
        call()
