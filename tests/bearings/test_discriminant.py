"""The discriminant of bearings, its sums and choices: identities, accuracy, failures."""

from itertools import combinations, permutations

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gramian as gm

B = gm.bearings
METHODS = ("direct", "factored", "qr")

# B1 and B2 of the reference values: a target at constant velocity, an observer
# that turns once. Computed once with 50 digits.
B1 = {"det": 942924.4480085992, "best": [0, 5, 10, 19], "value": 66.88261326410802}
B2 = {"det": 199119852.3833185, "best": [0, 20, 30, 39], "value": 380.6182922518034}


def track(m=20, turn_deg=90.0, *, start=(0.0, 10_000.0)):
    times = 20.0 * np.arange(m)
    heading = np.where(np.arange(m - 1) < m // 2, 0.0, np.radians(turn_deg))
    steps = 100.0 * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    path = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    offsets = np.array(start) + times[:, None] * np.array([3.0, -1.0]) - path
    return times, np.arctan2(offsets[:, 0], offsets[:, 1])


def random_tracks(trials, m, seed=0):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.5, 20.0, (trials, m)), axis=1)
    return times, rng.uniform(-np.pi, np.pi, (trials, m))


def rows(times, bearings):
    c, s = np.cos(bearings), np.sin(bearings)
    t = times - times[..., :1]
    return np.stack([c, -s, t * c, -t * s], axis=-1)


def exact_det(times, bearings, weights=None):
    mpmath.mp.dps = 50
    total = mpmath.zeros(4)
    for i in range(len(times)):
        t, b = mpmath.mpf(times[i]) - mpmath.mpf(times[0]), mpmath.mpf(bearings[i])
        w = 1 if weights is None else mpmath.mpf(weights[i])
        h = mpmath.matrix([[mpmath.cos(b), -mpmath.sin(b), t * mpmath.cos(b), -t * mpmath.sin(b)]])
        total += w * h.T * h
    return mpmath.det(total)


def relative_error(value, exact):
    return abs(float((mpmath.mpf(float(value)) - exact) / exact))


def test_all_forms_are_the_determinant_of_four_rows():
    times, bearings = random_tracks(500, 4)
    wanted = np.linalg.det(rows(times, bearings))
    size = np.abs(times[:, 3] - times[:, 0]) ** 2
    for form in ("15", "5", "13"):
        found = B.discriminant(times, bearings, form=form)
        # The cotangent form divides by sines that are taken back again.
        assert np.all(np.abs(found - wanted) <= 1e-11 * size), form


def test_a_swap_changes_the_sign_and_equal_instants_give_zero():
    times, bearings = track(4, 60.0)
    one = B.discriminant(times, bearings)
    for order in permutations(range(4)):
        parity = round(np.linalg.det(np.eye(4)[list(order)]))
        for form in ("15", "5"):
            swapped = B.discriminant(times[list(order)], bearings[list(order)], form=form)
            assert swapped == pytest.approx(parity * one, rel=1e-9)
    times[2], bearings[2] = times[1], bearings[1]
    assert B.discriminant(times, bearings) == 0


@settings(deadline=None, max_examples=60)
@given(st.integers(4, 12), st.integers(0, 2**32), st.booleans())
def test_lemma_1_with_and_without_weights(m, seed, weighted):
    times, bearings = (x[0] for x in random_tracks(1, m, seed))
    weights = np.random.default_rng(seed).uniform(0.1, 3.0, m) if weighted else None
    a = rows(times, bearings) * (1 if weights is None else np.sqrt(weights)[:, None])
    wanted = 0.0
    for four in combinations(range(m), 4):
        wanted += np.linalg.det(a[list(four)]) ** 2
    for method in METHODS:
        found = B.discriminant_sum(times, bearings, weights, method=method)
        assert found == pytest.approx(wanted, rel=1e-9)
    assert B.gram_det(times, bearings, weights)[1] == pytest.approx(wanted, rel=1e-6)
    assert np.linalg.det(B.gram(times, bearings, weights)) == pytest.approx(wanted, rel=1e-5)


def test_published_geometries():
    for (times, bearings), known in ((track(), B1), (track(40, 10.0), B2)):
        for method in METHODS:
            assert B.discriminant_sum(times, bearings, method=method) == pytest.approx(
                known["det"], rel=1e-10
            )
        best = B.best_quadruple(times, bearings)
        assert best.indices.tolist() == known["best"]
        assert abs(best.value) == pytest.approx(known["value"], rel=1e-10)


@pytest.mark.parametrize("turn", [90.0, 10.0, 1.0, 0.1, 0.01])
def test_accuracy_against_fifty_digits(turn):
    times, bearings = track(20, turn)
    exact = exact_det(times, bearings)
    assert relative_error(B.discriminant_sum(times, bearings), exact) <= 1e-12
    assert relative_error(B.discriminant_sum(times, bearings, method="factored"), exact) <= 5e-12
    assert relative_error(B.discriminant_sum(times, bearings, method="qr"), exact) <= 1e-10
    # What the documentation promises of the Gram matrix.
    bound = {90.0: 1e-14, 10.0: 2e-12, 1.0: 3e-10, 0.1: 4e-8, 0.01: 4e-6}[turn]
    assert relative_error(B.gram_det(times, bearings)[1], exact) <= bound


def test_turning_and_shifting_change_nothing():
    times, bearings = track(30, 40.0)
    turned = np.mod(bearings + 2.5 + np.pi, 2 * np.pi) - np.pi
    later = times + 1e6
    for method in METHODS:
        one = B.discriminant_sum(times, bearings, method=method)
        assert B.discriminant_sum(times, turned, method=method) == pytest.approx(one, rel=1e-9)
        assert B.discriminant_sum(later, bearings, method=method) == pytest.approx(one, rel=1e-9)
    assert B.gram_det(later, turned)[1] == pytest.approx(one, rel=1e-8)


def test_whole_turns_and_half_turns_of_a_bearing_change_nothing():
    times, bearings = track(12, 70.0)
    one = B.discriminant_sum(times, bearings)
    moved = bearings + np.pi * np.arange(-6, 6)
    assert B.discriminant_sum(times, moved) == pytest.approx(one, rel=1e-9)


def test_equal_bearings_and_a_collision_course():
    times = np.arange(10.0)
    for value in (0.0, 1.0, -3.0):
        same = np.full(10, value)
        for method in ("direct", "factored"):
            assert B.discriminant_sum(times, same, method=method) == 0
        assert not B.observable(times, same).observable
    crossing = np.array([0.1, 0.4, 0.1, 0.4, 0.1, -0.3, 0.1])
    wanted = float(exact_det(times[:7], crossing))
    for method in METHODS:
        found = B.discriminant_sum(times[:7], crossing, method=method)
        assert found == pytest.approx(wanted, rel=1e-12)


def test_a_fixed_target_needs_two_bearings():
    rng = np.random.default_rng(3)
    b, w = rng.uniform(-3, 3, 15), rng.uniform(0.1, 2, 15)
    rows2 = np.stack([np.cos(b), -np.sin(b)], axis=1)
    wanted = np.linalg.det((w[:, None] * rows2).T @ rows2)
    pairs = sum(w[i] * w[j] * np.sin(b[i] - b[j]) ** 2 for i, j in combinations(range(15), 2))
    assert pairs == pytest.approx(wanted, rel=1e-12)
    for method in METHODS:
        found = B.discriminant_sum(np.arange(15.0), b, w, method=method, order=0)
        assert found == pytest.approx(wanted, rel=1e-12)
    # Xu et al. 2009, eq. (14), for two bearings.
    two = B.discriminant_sum([0.0, 1.0], [0.0, np.pi / 3], [0.5, 4.0], order=0)
    assert two == pytest.approx(2.0 * 0.75)


def test_weights_are_the_fisher_information():
    times, bearings = track(20, 90.0)
    observer = np.zeros((20, 2))
    ranges = np.linspace(5e3, 9e3, 20)
    positions = ranges[:, None] * np.stack([np.sin(bearings), np.cos(bearings)], axis=1)
    whitened = B.rows(times, observer, positions, 0.01)
    found = B.gram(times, bearings, 1 / (0.01 * ranges) ** 2)
    assert found == pytest.approx(gm.gram(whitened), rel=1e-10, abs=1e-16)


def test_batches_equal_single_calls_and_broadcast():
    times, bearings = random_tracks(6, 9)
    weights = np.random.default_rng(1).uniform(0.5, 2, 9)
    for method in METHODS:
        many = B.discriminant_sum(times[0], bearings.reshape(2, 3, 9), weights, method=method)
        assert many.shape == (2, 3)
        one = [B.discriminant_sum(times[0], b, weights, method=method) for b in bearings]
        assert np.array_equal(many.ravel(), one)
    matrix, det = B.gram_det(times, bearings, weights)
    assert matrix.shape == (6, 4, 4)
    for i in range(6):
        single = B.gram_det(times[i], bearings[i], weights)
        # Shared times take their sums once: the last digits may differ.
        assert np.allclose(single[0], matrix[i], rtol=1e-13)
        assert single[1] == pytest.approx(det[i], rel=1e-12)
    best = B.best_quadruple(times, bearings)
    assert best.indices.shape == (6, 4)
    assert best.value[4] == B.best_quadruple(times[4], bearings[4]).value


def test_results_do_not_depend_on_the_number_of_threads():
    times, bearings = track(150, 30.0)
    batch = bearings + 0.01 * np.arange(300)[:, None] * np.sin(times)
    results = []
    before = gm.set_threads(1)
    try:
        for threads in (1, 2, 3):
            gm.set_threads(threads)
            results.append(
                (
                    float(B.discriminant_sum(times, bearings)),
                    B.best_quadruple(times, bearings).value.tobytes(),
                    B.gram(times, batch).tobytes(),
                )
            )
    finally:
        gm.set_threads(before)
    assert results[0] == results[1] == results[2]


def test_the_best_of_many_is_found_or_nearly():
    closeness = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        m = 201
        times = 10.0 * np.arange(m)
        wiggle = rng.normal(0, 0.2, 4)
        x = times / times[-1]
        bearings = sum(a * np.sin((k + 1) * 2.1 * x + k) for k, a in enumerate(wiggle)) + 2 * x
        selected = B.best_quadruple(times, bearings)
        # Without one bearing that the selection did not take, all are searched.
        drop = next(i for i in range(1, m) if i not in selected.indices)
        keep = np.arange(m) != drop
        searched = B.best_quadruple(times[keep], bearings[keep])
        closeness.append(abs(selected.value) / abs(searched.value))
    assert min(closeness) >= 0.99


def test_the_certificate_of_theorem_1():
    for turn in (90.0, 1.0, 1e-3, 1e-6):
        verdict = B.observable(*track(20, turn))
        assert verdict.observable
        assert verdict.relative_motion is None
        assert verdict.summary().startswith("OBSERVABLE")
    times, bearings = track(20, 0.0)
    verdict = B.observable(times, bearings)
    assert not verdict.observable
    assert verdict.summary().startswith("UNOBSERVABLE")
    # The target's motion (3, -1) less the observer's (0, 5), at 10 km.
    assert verdict.relative_motion == pytest.approx([0, 1, 3e-4, -6e-4], abs=1e-9)
    assert verdict.to_dict()["indices"] == list(verdict.indices)
    # Far from the origin, bearings carry the rounding of the coordinates.
    far = 4e6 + 100.0 * np.arange(20)
    offsets = (4e6 + 3.0 * times) - far, (6e6 - times + 1e4) - 6e6
    rounded = np.arctan2(offsets[0].astype(np.float32), offsets[1].astype(np.float32))
    assert not B.observable(times, rounded, accuracy=1e-5).observable


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: B.discriminant_sum([0, 1, 2], [0, 1, 2]), "3 bearings: at least 4 are needed"),
        (lambda: B.discriminant_sum([0], [0], order=0), "1 bearings: at least 2 are needed"),
        (lambda: B.best_quadruple([0, 1, 2], [0, 1, 2]), "at least 4"),
        (lambda: B.observable([0, 1, 2], [0, 1, 2]), "at least 4"),
        (
            lambda: B.discriminant_sum([0, 1, 1, 2], [0, 1, 2, 3]),
            r"times\[2\] = 1 s: must be later",
        ),
        (lambda: B.discriminant_sum([0, 1, 2, 3], [0, 1, 2]), "a bearing for each time"),
        (lambda: B.discriminant_sum([0, 1, 2, 3], [0, np.nan, 2, 3]), r"bearings\[1\] = nan"),
        (lambda: B.gram([0, 1, 2, 3], [0, np.inf, 2, 3]), r"bearings\[1\] = inf"),
        (lambda: B.gram([0, np.nan, 2, 3], [0, 1, 2, 3]), r"times\[1\] = nan"),
        (lambda: B.gram([0, 1], [0, 1], [1, -1]), r"weights\[1\] = -1: must be >= 0"),
        (lambda: B.gram([0, 1], [0, 1], [1, 1, 1]), "a weight for each bearing"),
        (lambda: B.gram([], []), "must not be empty"),
        (lambda: B.discriminant([0, 1, 2], [0, 1, 2]), "four instants"),
        (lambda: B.discriminant([0, 1, 2, 3], [0, 0, 1, 2], form="13"), r"bearings\[1\] is on"),
        (lambda: B.discriminant([0, 1, 2, 3], [0, 0, 1, 2], form="7"), "form = '7'"),
        (lambda: B.discriminant_sum([0], [0], method="slow"), 'must be "direct"'),
        (lambda: B.discriminant_sum([0], [0], order=2), "order = 2"),
        (lambda: B.observable([0, 1, 2, 3], [0, 1, 2, 3], accuracy=-1), "accuracy = -1"),
        (lambda: B.observable(np.arange(4.0), np.zeros((2, 4))), "one track"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(gm.InputError, match=message):
        call()
