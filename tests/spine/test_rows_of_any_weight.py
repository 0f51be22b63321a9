"""Rank and bounds of rows over 30 orders of magnitude, against the exact ones."""

from fractions import Fraction

import numpy as np
import pytest

import gramian as gm


def exact_rank(rows):
    """Return the rank of rows of floats in fractions."""
    lines = [[Fraction(x) for x in row] for row in np.asarray(rows, float).tolist()]
    rank = 0
    for c in range(len(lines[0])):
        top = next((i for i in range(rank, len(lines)) if lines[i][c]), None)
        if top is None:
            continue
        lines[rank], lines[top] = lines[top], lines[rank]
        for line in lines[rank + 1 :]:
            if line[c]:
                factor = line[c] / lines[rank][c]
                line[c:] = [x - factor * y for x, y in zip(line[c:], lines[rank][c:], strict=True)]
        rank += 1
    return rank


def determined(rows):
    """Return which states the rows determine, exactly."""
    rank = exact_rank(rows)
    return [exact_rank([*rows, unit]) == rank for unit in np.eye(len(rows[0]))]


def powers(rng, decades, count):
    """Return powers of two over so many decades."""
    return 2.0 ** np.round(rng.uniform(-decades / 2, decades / 2, count) * np.log2(10))


#: Rows of random numbers times powers of ten, of full rank: (5, 4), (5, 4), (6, 5).
HEAVY_AND_LIGHT = [
    [
        [-4.2281187652462781e-03, -6.2648648537829621e-03, 1.1660514386552790e-02, 1.5589e-03],
        [-3.5953546989991320e-01, 9.5134588475976889e-02, 1.4148539363150170e00, -2.5495902e-01],
        [-8.8022121028186838e-11, 1.0596494798079952e-10, 3.5659415454150770e-10, 2.23156284e-10],
        [-2.1442439952035387e-04, -6.3252798610638798e-05, -5.3111354151275966e-05, -2.1934e-04],
        [-2.2151335208127543e13, 1.0664074866507034e12, 2.9005504766777031e13, -7.6542841e10],
    ],
    [
        [2.3902211796313076e12, -1.7288886052295297e14, 3.3500548641995129e13, 2.64783624e14],
        [4.1949540321137274e-14, 5.2227704610270450e-14, 4.9505401521543633e-14, -3.0514820e-14],
        [-2.1948851573708820e10, 6.5109121037028341e09, 1.3222807000342716e10, 1.93579243e10],
        [1.4341676751684308e-03, -4.9169659556049872e-04, -7.59624191958e-04, -2.280426970e-04],
        [5.5006519269113694e00, -3.4039811286645265e00, -4.9889598673223506e-01, -8.078288e-01],
    ],
    [
        [3.7093323688031938e4, -6.1268166e7, 8.9470447894309342e7, -1.4284976e8, -5.3189411e7],
        [-1.4904740635e-11, -2.7606602e-12, -1.0207526e-13, 2.11417981146e-11, -1.8651617e-11],
        [8.0991716709434225e-2, 1.1866037e-3, 3.1328975986e-1, 3.2906804287e-1, 1.9565850e-1],
        [2.2240033133381677e-10, 1.0684477e-10, 4.4161563e-11, 5.7999787078e-11, 2.39508891e-10],
        [-1.4838398846403220e-4, -2.0962864e-4, 3.3331037253e-4, 6.33592996957e-5, -1.14650e-4],
        [-8.2765527485552943e-5, -2.8492245e-5, 3.8301526296e-5, -4.9162130724e-5, 4.0286947e-5],
    ],
]


@pytest.mark.parametrize("rows", HEAVY_AND_LIGHT)
def test_the_lightest_row_counts(rows):
    assert gm.analyze(np.array(rows)).rank == len(rows[0])
    assert np.isfinite(gm.crlb_std(np.array(rows))).all()


@pytest.mark.parametrize("zeros", [False, True])
def test_exactly_dependent_rows_over_30_decades(zeros):
    rng = np.random.default_rng([1, int(zeros)])
    short = 0
    for _ in range(200):
        n, count = int(rng.integers(2, 8)), int(rng.integers(2, 11))
        rank = int(rng.integers(1, n + 1))
        base, mix = rng.integers(-9, 10, (rank, n)), rng.integers(-3, 4, (count, rank))
        if zeros:
            base *= rng.random(base.shape) < 0.5
            mix *= rng.random(mix.shape) < 0.5
        rows = (mix @ base).astype(float)
        rows *= powers(rng, rng.choice([0, 3, 10, 30]), (count, 1))
        rows *= powers(rng, rng.choice([0, 3, 12]), n)
        if not rows.any():
            continue
        answer = gm.analyze(rows)
        assert answer.rank == exact_rank(rows)
        assert np.isfinite(answer.crlb_std).tolist() == determined(rows)
        short += answer.rank < min(rows.shape)
    assert short > 60


def test_random_rows_over_30_decades_have_full_rank_and_their_bounds():
    rng = np.random.default_rng(2)
    for _ in range(100):
        n = int(rng.integers(2, 6))
        rows = rng.standard_normal((n, n)) * 10.0 ** rng.uniform(-15, 15, (n, 1))
        rows *= 10.0 ** rng.uniform(-6, 6, n)
        answer = gm.analyze(rows)
        assert answer.rank == n
        # Of as many rows as states: the lengths of the rows of the inverse.
        wanted = [float(sum(x * x for x in line)) ** 0.5 for line in inverse(rows)]
        np.testing.assert_allclose(answer.crlb_std, wanted, rtol=1e-9)


def inverse(matrix):
    """Return the inverse of a square matrix in fractions."""
    n = len(matrix)
    lines = [
        [Fraction(x) for x in row] + [Fraction(int(i == j)) for j in range(n)]
        for i, row in enumerate(matrix.tolist())
    ]
    for c in range(n):
        top = next(i for i in range(c, n) if lines[i][c])
        lines[c], lines[top] = lines[top], lines[c]
        lines[c] = [x / lines[c][c] for x in lines[c]]
        for i in range(n):
            if i != c:
                factor = lines[i][c]
                lines[i] = [x - factor * y for x, y in zip(lines[i], lines[c], strict=True)]
    return [line[n:] for line in lines]


def test_rows_dependent_but_for_rounding_stay_so_at_any_weight():
    rng = np.random.default_rng(3)
    for _ in range(300):
        n, count = int(rng.integers(2, 9)), int(rng.integers(2, 12))
        rank = int(rng.integers(1, n + 1))
        rows = rng.standard_normal((count, rank)) @ rng.standard_normal((rank, n))
        rows *= 10.0 ** rng.uniform(-15, 15, (count, 1)) * 10.0 ** rng.uniform(-6, 6, n)
        assert gm.analyze(rows).rank == min(count, rank)


def test_differences_of_nearly_equal_rows_have_the_rounding_of_these():
    rng = np.random.default_rng(4)
    for _ in range(200):
        n = int(rng.integers(2, 9))
        rank = int(rng.integers(1, n))
        base = rng.standard_normal((rank, n))
        near = base + 10.0 ** rng.uniform(-8, -1) * (rng.standard_normal((rank, rank)) @ base)
        rows = np.vstack([base, near, near - base]) * 10.0 ** rng.uniform(-6, 6, n)
        assert gm.analyze(rows).rank == rank


def test_a_state_that_moves_little_in_the_units_of_its_rows():
    # Only the second row has the last state, which moves as state 0 does, times 2^-5.
    rows = np.array(
        [[2.0**46, -(2.0**56), 2.0**51, 0.0], [-(2.0**-20), 0.0, -(2.0**-16), 2.0**-15]]
    )
    assert determined(rows) == [False] * 4
    assert np.isinf(gm.analyze(rows).crlb_std).all()
