"""Levels of linear systems: identities, invariance, the inertial reference, bad input."""

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

import gramian as gm
from gramian import _core

# Values of A, eigenvalues and eigenvectors in 50-digit arithmetic.
REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "sins.json").read_text())
NAMES = gm.inertial.NAMES
A = np.array([[float(x) for x in row] for row in REFERENCE["A"]])
C = np.zeros((6, 15))
C[:, 3:9] = np.eye(6)
G, W_N, W_U = (float(REFERENCE["params"][key]) for key in ("g", "wN", "wU"))

# Rows: phi_N, phi_W, phi_U lead.
NULL_SPACE = np.zeros((15, 3))
for column, parts in enumerate(
    (
        {"phi_N": 1, "Delta_W": -G, "eps_W": -W_U},
        {"phi_W": 1, "Delta_N": G, "eps_N": W_U, "eps_U": -W_N},
        {"phi_U": 1, "eps_W": W_N},
    )
):
    for name, value in parts.items():
        NULL_SPACE[NAMES.index(name), column] = value

LEVELS = dict.fromkeys(NAMES) | dict.fromkeys(NAMES[3:9], 0) | {"Delta_U": 1}
COMBINATIONS = {
    "Delta_N - g phi_W": ({"Delta_N": 1, "phi_W": -G}, 1),
    "Delta_W + g phi_N": ({"Delta_W": 1, "phi_N": G}, 1),
    "eps_W": ({"eps_W": 1, "phi_N": W_U, "phi_U": -W_N}, 2),
    "eps_N": ({"eps_N": 1, "phi_W": -W_U}, 2),
    "eps_U": ({"eps_U": 1, "phi_W": W_N}, 3),
    "tilt alone": ({"phi_W": 1, "phi_N": 1}, None),
}

# What a state is multiplied by, a unit of position, of velocity, of angle, of
# the biases; and seconds in the unit of time.
DEGREE, HOUR = np.radians(1), 3600.0
UNIT_SYSTEMS = {
    "SI": ([1] * 15, 1.0),
    "hour": ([1] * 3 + [1 / HOUR] * 3 + [1] * 3 + [1 / HOUR] * 3 + [HOUR**-2] * 3, HOUR),
    "minute, degree": (
        [DEGREE] * 3 + [1 / 60] * 3 + [DEGREE, DEGREE, 1] + [DEGREE / 60] * 3 + [60.0**-2] * 3,
        60.0,
    ),
    "navigator's": (
        [DEGREE / 60] * 3
        + [0.514] * 3
        + [DEGREE / 60, DEGREE / 60, 0.3048]
        + [DEGREE / HOUR] * 3
        + [9.8e-6] * 3,
        1.0,
    ),
    "kilometre, day": (
        [1] * 3 + [1000 / 86400] * 3 + [1, 1, 1000] + [1 / 86400] * 3 + [1000 / 86400**2] * 3,
        86400.0,
    ),
    "millimetre, microradian, millisecond": (
        [1e-6] * 3 + [1.0] * 3 + [1e-6, 1e-6, 1e-3] + [1e-3] * 3 + [1e3] * 3,
        1e-3,
    ),
}


def scaled(a, c, states, outputs, time):
    return a * states / states[:, None] * time, c * states * outputs[:, None]


def test_inertial_ranks_levels_and_combinations():
    found = gm.linear.levels(A, C, NAMES, combinations={k: v for k, (v, _) in COMBINATIONS.items()})
    assert found.ranks == (6, 9, 11, *[12] * 12)
    assert dict(found.states) == LEVELS
    assert dict(found.combinations) == {k: level for k, (_, level) in COMBINATIONS.items()}
    assert [len(level) for level in found.new_combinations] == [6, 3, 2, 1]
    assert found.new_combinations[1][2] == "1 Delta_U"
    assert found.new_combinations[3] == ("6.43e-05 phi_W + 1 eps_U",)
    weakest, rejected = found.margins
    assert weakest > 1e9 * found.rtol
    assert rejected < 1e-3 * found.rtol


def test_inertial_null_space_to_twelve_digits():
    found = gm.linear.levels(A, C, NAMES).null_space
    assert found.shape == (15, 3)
    error = np.abs(found - NULL_SPACE) / np.where(NULL_SPACE == 0, 1, np.abs(NULL_SPACE))
    assert error.max() < 1e-12


@pytest.mark.parametrize("units", UNIT_SYSTEMS)
def test_levels_are_the_same_in_every_system_of_units(units):
    states, time = np.array(UNIT_SYSTEMS[units][0], dtype=float), UNIT_SYSTEMS[units][1]
    a, c = scaled(A, C, states, np.ones(6), time)
    found = gm.linear.levels(a, c, NAMES)
    assert found.ranks == (6, 9, 11, *[12] * 12)
    assert dict(found.states) == LEVELS


def test_numerical_rank_of_the_observability_matrix_fails_with_the_hour():
    q = gm.linear.observability_matrix(HOUR * A, C)
    assert np.linalg.matrix_rank(q) == 6
    assert np.linalg.matrix_rank(q.T @ q) == 4
    assert gm.linear.levels(HOUR * A, C).ranks == (6, 9, 11, *[12] * 12)


exponents = st.floats(-9, 9)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(exponents, min_size=15, max_size=15),
    st.lists(exponents, min_size=6, max_size=6),
    exponents,
)
def test_scales_of_states_outputs_and_time_change_no_level(states, outputs, time):
    d, s = 10.0 ** np.array(states), 10.0 ** np.array(outputs)
    a, c = scaled(A, C, d, s, 10.0**time)
    found = gm.linear.levels(a, c, NAMES)
    assert found.ranks == (6, 9, 11, *[12] * 12)
    assert dict(found.states) == LEVELS
    for value, level in COMBINATIONS.values():
        assert found.level_of({k: x * d[NAMES.index(k)] for k, x in value.items()}) == level
    # The null space in the first units, with the same leaders.
    null = found.null_space * d[:, None]
    null /= null[[0, 1, 2], [0, 1, 2]]
    error = np.abs(null - NULL_SPACE) / np.where(NULL_SPACE == 0, 1, np.abs(NULL_SPACE))
    assert error.max() < 1e-12


def random_system(rng, n, p, hidden):
    """A sparse or dense system of known generic ranks, mixed by permutation."""
    seen = n - hidden
    a = rng.normal(size=(n, n))
    a[:seen, seen:] = 0
    c = rng.normal(size=(p, n))
    c[:, seen:] = 0
    order = rng.permutation(n)
    ranks = tuple(min((k + 1) * p, seen) for k in range(n))
    return a[np.ix_(order, order)], c[:, order], ranks


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_scales_change_no_rank_of_random_systems(seed):
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(1, 11)), int(rng.integers(1, 4))
    a, c, ranks = random_system(rng, n, p, int(rng.integers(0, n)))
    d, s = 10.0 ** rng.uniform(-9, 9, n), 10.0 ** rng.uniform(-9, 9, p)
    moved = scaled(a, c, d, s, 10.0 ** rng.uniform(-9, 9))
    one, other = gm.linear.levels(a, c), gm.linear.levels(*moved)
    assert one.ranks == other.ranks == ranks
    assert one.states == other.states
    batch = gm.linear.batch_levels(*moved)
    assert tuple(batch.ranks) == ranks
    assert [None if np.isinf(x) else int(x) for x in batch.levels] == list(one.states.values())


def test_a_change_of_coordinates_changes_no_rank():
    rng = np.random.default_rng(5)
    for _ in range(20):
        a, c, ranks = random_system(rng, 6, 2, 2)
        t, _ = np.linalg.qr(rng.normal(size=(6, 6)))
        assert gm.linear.levels(t @ a @ t.T, c @ t.T).ranks == ranks


def test_a_discrete_system_near_the_identity_keeps_its_levels():
    small = np.eye(15) + 1e-7 * A
    assert gm.linear.levels(small, C, NAMES).ranks == (6, 9, 11, *[12] * 12)


def test_null_space_is_invisible_and_new_combinations_are_in_the_row_space():
    rng = np.random.default_rng(8)
    a, c, _ = random_system(rng, 7, 2, 3)
    found = gm.linear.levels(a, c)
    q = gm.linear.observability_matrix(a, c)
    assert np.abs(q @ found.null_space).max() < 1e-9 * np.abs(q).max()
    for k, level in enumerate(found.new):
        for column in level.T:
            assert found.level_of(column) == k


def test_toy_example_of_the_paper():
    # Yang & Yin 2012, eq. (9) to (12): orders 0, 0, 1 for any a, c1, c2.
    for factor, c1, c2 in ((1.0, 1.0, 1.0), (1e-6, 3.0, 1e5), (1e6, 1e-3, 2.0)):
        found = gm.linear.levels(
            [[0, 0, factor], [0, 0, 0], [0, 0, 0]], [[c1, 0, 0], [0, c2, 0]], ["x1", "x2", "x3"]
        )
        assert dict(found.states) == {"x1": 0, "x2": 0, "x3": 1}


def test_pole_equator_and_an_earth_at_rest():
    still = gm.inertial.static_base(0.5, earth_rate=0.0)
    assert gm.linear.levels(still).ranks[:4] == (6, 9, 11, 11)
    assert gm.linear.levels(gm.inertial.static_base(0.0)).ranks[:4] == (6, 9, 11, 12)


def test_observability_matrix_of_the_textbook():
    # python-control's own test of obsv.
    assert gm.linear.observability_matrix([[1, 2], [3, 4]], [[5, 7]]).tolist() == [[5, 7], [26, 38]]
    assert gm.linear.observability_matrix([[1, 2], [3, 4]], [[5, 7]], order=0).tolist() == [[5, 7]]


def test_state_space_objects_of_scipy_and_control():
    control = pytest.importorskip("control")
    a, c = [[0.0, 1.0], [-2.0, -3.0]], [[1.0, 0.0]]
    b, d = [[0.0], [1.0]], [[0.0]]
    expected = gm.linear.observability_matrix(a, c)
    for system in (scipy.signal.StateSpace(a, b, c, d), control.StateSpace(a, b, c, d)):
        assert np.array_equal(gm.linear.observability_matrix(system), expected)
        assert gm.linear.levels(system).ranks == (1, 2)
        assert gm.linear.gramian(system, window=1.0).shape == (2, 2)
        with pytest.raises(gm.InputError, match="C was given beside a state-space object"):
            gm.linear.levels(system, c)


def test_batches_broadcast_and_do_not_depend_on_threads():
    rng = np.random.default_rng(2)
    a, c = rng.normal(size=(3, 4, 5, 5)), rng.normal(size=(4, 2, 5))
    before = gm.set_threads(1)
    one = gm.linear.batch_levels(a, c), gm.linear.observability_matrix(a, c)
    gm.set_threads(2)
    two = gm.linear.batch_levels(a, c), gm.linear.observability_matrix(a, c)
    gm.set_threads(before)
    assert one[0].ranks.shape == (3, 4, 5)
    assert np.array_equal(one[0].ranks, two[0].ranks)
    assert np.array_equal(one[1], two[1])
    power = np.linalg.matrix_power(a[2, 1], 4)
    assert np.allclose(one[1][2, 1, 8:], c[1] @ power, rtol=1e-12)


BAD = [
    (lambda: gm.linear.levels(np.zeros((2, 3)), np.zeros((1, 3))), "A has shape"),
    (lambda: gm.linear.observability_matrix(np.zeros((2, 3)), np.zeros((1, 3))), "A has shape"),
    (lambda: gm.linear.levels(np.eye(2), np.zeros((1, 3))), r"C has shape \(1, 3\)"),
    (lambda: gm.linear.batch_levels(np.eye(2), np.zeros((1, 3))), r"C has shape \(1, 3\)"),
    (lambda: gm.linear.levels(np.eye(2)), "C is missing"),
    (lambda: gm.linear.levels(np.eye(2), [[1, 0]], ["x"]), "names has 1 entries"),
    (lambda: gm.linear.levels(np.eye(2), [[1, 0]], ["x", "x"]), "twice"),
    (lambda: gm.linear.levels(np.eye(2), [[1, np.nan]]), r"C\[0, 1\] = nan"),
    (
        lambda: gm.linear.levels(np.eye(2), [[1, 0]], ["x", "v"], combinations={"c": {"y": 1}}),
        "no state is named 'y'",
    ),
    (lambda: gm.linear.levels(np.eye(2), [[1, 0]]).level_of([0, 0]), "combination is zero"),
    (lambda: gm.linear.levels(np.eye(2), [[1, 0]]).level_of([1, 0, 0]), "combination has shape"),
    (lambda: gm.linear.levels(np.eye(2), [[1, 0]], rtol=2.0), "rtol = 2"),
    (lambda: gm.linear.observability_matrix(1e200 * np.eye(3), [[1, 0, 0]]), "is not finite"),
    (lambda: gm.linear.observability_matrix(np.eye(2), [[1, 0]], order=-1), "order = -1"),
]


@pytest.mark.parametrize(("call", "message"), BAD)
def test_bad_input_is_named(call, message):
    with pytest.raises(gm.InputError, match=message):
        call()


def test_outputs_that_see_nothing():
    found = gm.linear.levels(np.eye(3), np.zeros((2, 3)), ["a", "b", "c"])
    assert found.rank == 0
    assert found.null_combinations == ("a +1", "b +1", "c +1")
    assert gm.linear.levels(np.zeros((1, 1)), [[2.0]]).rank == 1
    assert _core.linear_levels(np.zeros((3, 3)), np.zeros((1, 3)), None)[1].tolist() == [np.inf] * 3
