"""Which states a null direction moves: planted ones, exact in every digit."""

from fractions import Fraction

import numpy as np
import pytest

import gramian as gm

#: Powers of two, so that what is planted is exact.
PARTS = {1.0: 1.0, 1e-3: 2.0**-10, 1e-6: 2.0**-20, 1e-9: 2.0**-30, 1e-12: 2.0**-40, 0.0: 0.0}
#: What rows of numbers can tell, as a multiple of the rounding of a null vector's part: the
#: tolerance of ranks, 32 eps sqrt(K), and how far the scaled rows are from the best ones.
TELLS = 2e3


def planted(rng, part, *, graded, blocks=False):
    """Return integer rows of rank n - 1, times powers of two, their null vector and state j.

    State j has the part `part` in it, the others 0, 1 or 2. With `blocks` state j has rows of
    its own, and shares others with states that do not move.
    """
    n = int(rng.integers(4 if blocks else 3, 8))
    count = n + int(rng.integers(0, 8))
    rows = rng.integers(-255, 256, (count, n)).astype(float)
    null = rng.integers(0, 3, n) * rng.choice([-1.0, 1.0], n)
    j, pivot, third = rng.choice(n, 3, replace=False)
    null[j], null[pivot], null[third] = part, 1.0, 1.0
    if blocks:
        apart = rng.random(n) < 0.4
        apart[[pivot, third]], apart[j] = False, True
        null[apart & (np.arange(n) != j)] = 0.0
        alone = np.arange(count) < apart.sum() + 1
        rows[np.ix_(alone, ~apart)] = 0.0
        rows = np.vstack([rows, rng.integers(-255, 256, (n, n))])
    others = [k for k in range(n) if k != pivot]
    rows[:, pivot] = [
        float(-sum(Fraction(row[k]) * Fraction(null[k]) for k in others)) for row in rows
    ]
    assert not any(
        sum(Fraction(x) * Fraction(v) for x, v in zip(r, null, strict=True)) for r in rows
    )
    if graded:
        units = 2.0 ** rng.integers(-33, 34, n)
        rows = rows * 2.0 ** rng.integers(-33, 34, len(rows))[:, None] * units
        null = null / units
    return rows, null, int(j), int(pivot)


def solve(matrix, right):
    """Return the solution of linear equations in fractions, None for singular ones."""
    lines = [[*row, b] for row, b in zip(matrix, right, strict=True)]
    n = len(lines)
    for c in range(n):
        top = next((i for i in range(c, n) if lines[i][c]), None)
        if top is None:
            return None
        lines[c], lines[top] = lines[top], lines[c]
        lines[c] = [x / lines[c][c] for x in lines[c]]
        for i in range(n):
            if i != c and lines[i][c]:
                factor = lines[i][c]
                lines[i] = [x - factor * y for x, y in zip(lines[i], lines[c], strict=True)]
    return [line[n] for line in lines]


def exactly(rows, null, j, pivot):
    """Return the bound of state j without the pivot, and eps times what moves its part.

    That is the rounding of rows by which the null vector has no part of state j, or twice as
    much. None where the rank is less than n - 1.
    """
    left = [k for k in range(rows.shape[1]) if k != pivot]
    a = [[Fraction(x) for x in row] for row in rows[:, left].tolist()]
    information = [
        [sum(row[p] * row[q] for row in a) for q in range(len(left))] for p in range(len(left))
    ]
    by = solve(information, [Fraction(int(k == j)) for k in left])
    if by is None:
        return None
    total = Fraction(0)
    for row, line in zip(rows.tolist(), a, strict=True):
        lever = sum(x * y for x, y in zip(line, by, strict=True))
        total += abs(lever) * sum(
            abs(Fraction(x) * Fraction(v)) for x, v in zip(row, null, strict=True)
        )
    return float(by[left.index(j)]) ** 0.5, float(total) * np.finfo(float).eps


@pytest.mark.parametrize("graded", [False, True])
@pytest.mark.parametrize("part", PARTS)
def test_a_state_is_moved_by_its_part_however_small(part, graded):
    rng = np.random.default_rng([3, int(graded), list(PARTS).index(part)])
    seen = 0
    for _ in range(170):
        rows, null, j, pivot = planted(rng, PARTS[part], graded=graded)
        truth = exactly(rows, null, j, pivot)
        if truth is None:
            continue
        answer = gm.analyze(rows)
        assert answer.rank == rows.shape[1] - 1
        assert answer.status == "unobservable"
        moved = null != 0
        std, rounding = truth
        if part == 0:
            assert answer.crlb_std[j] == pytest.approx(std, rel=1e-6)
        elif abs(null[j]) > TELLS * rounding:
            assert np.isinf(answer.crlb_std[j])
            assert answer.null_space[j, 0] != 0
            seen += 1
        # One state alone is not moved.
        big = moved & (np.arange(len(null)) != j)
        if big.sum() > 1 or part:
            assert np.isinf(answer.crlb_std[pivot])
        np.testing.assert_array_equal(gm.crlb_std(rows), answer.crlb_std)
    assert seen > 140 or part in (0.0, 1e-12)


@pytest.mark.parametrize("graded", [False, True])
def test_states_apart_by_zeros_keep_their_bounds(graded):
    rng = np.random.default_rng([5, int(graded)])
    for _ in range(170):
        rows, null, j, pivot = planted(rng, 0.0, graded=graded, blocks=True)
        truth = exactly(rows, null, j, pivot)
        if truth is None:
            continue
        answer = gm.analyze(rows)
        assert answer.rank == rows.shape[1] - 1
        assert answer.crlb_std[j] == pytest.approx(truth[0], rel=1e-6)
        assert answer.undecided == ()


def test_a_batch_answers_as_each_alone():
    rng = np.random.default_rng(9)
    for part in PARTS.values():
        batch = []
        while len(batch) < 40:
            rows, *_ = planted(rng, part, graded=len(batch) % 2 == 1)
            if rows.shape[1] == 5:
                batch.append(np.vstack([rows, np.zeros((12 - len(rows), 5))]))
        alone = [gm.crlb_std(rows) for rows in batch]
        np.testing.assert_allclose(gm.crlb_std(np.array(batch)), alone, rtol=1e-9)


def test_rows_and_decoupled_states_of_rounded_numbers():
    """What is zero up to the rounding of dense rows is no part: 300 rotated problems."""
    rng = np.random.default_rng(13)
    for _ in range(300):
        n = int(rng.integers(3, 9))
        null = rng.standard_normal(n)
        j = int(rng.integers(n))
        null[j] = 0
        null /= np.linalg.norm(null)
        rows = rng.standard_normal((n + 5, n))
        rows -= np.outer(rows @ null, null)
        wanted = gm.analyze(np.vstack([rows, 1e3 * null])).crlb_std[j]
        answer = gm.analyze(rows)
        assert answer.rank == n - 1
        assert answer.crlb_std[j] == pytest.approx(wanted, rel=1e-9)
        assert answer.undecided == ()


def test_an_orbit_seen_almost_in_its_plane():
    """Ranges from a station near the plane: z moves with the plane's tilt, by 1e-10 of x."""
    tilt = 2.0**-33
    t = np.linspace(0, 1, 9)
    # In the plane x and y move together with the tilt of the third axis; a row sees x + y and
    # tilt times (x - z).
    rows = np.stack([np.cos(t), -np.cos(t) - tilt * np.sin(t), np.sin(t)], axis=1)
    # A null vector: (1, 1, tilt), exact up to rounding of 1e-16.
    answer = gm.analyze(rows, names=["x", "y", "z"])
    assert answer.rank == 2
    assert np.isinf(answer.crlb_std).all()
    assert "z" in answer.null_combinations[0]


def test_what_inaccurate_rows_leave_open_is_undecided():
    """Single precision: whether z moves with x and y by less than 1e-7 of them is not told."""
    rng = np.random.default_rng(1)
    dense = rng.standard_normal((8, 2))

    def h(s):
        u = np.array([s[0] - s[1], s[2]])
        return (dense @ np.sin(u)).astype(np.float32).astype(float)

    answer = gm.analyze(gm.from_function(h, [0.3, 0.2, 0.4], 1e-3, ["x", "y", "z"]))
    assert answer.rank == 2
    assert answer.undecided == ("z",)
    assert np.isinf(answer.crlb_std).all()
    assert "z  undecided" in answer.summary()
    assert np.isinf(answer.std_of("z"))
    # Known better, x leaves nothing open.
    assert np.isfinite(answer.knowing("x").crlb_std).all()


def test_zeros_leave_nothing_open():
    """The same where z has measurements of its own, which do not see x and y at all."""
    rng = np.random.default_rng(1)
    dense = rng.standard_normal((8, 2))

    def h(s):
        first = (dense @ np.sin([s[0] - s[1], s[2]])).astype(np.float32).astype(float)
        return np.append(first, 3 * s[2])

    answer = gm.analyze(gm.from_function(h, [0.3, 0.2, 0.4], 1e-3, ["x", "y", "z"]))
    assert answer.rank == 2
    assert answer.undecided == ()
    assert np.isfinite(answer.crlb_std[2])
