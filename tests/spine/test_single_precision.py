"""Batches of float32: where single precision is right they are computed and returned in it."""

import numpy as np
import pytest

import gramian as gm

RNG = np.random.default_rng(11)
#: Half the distance from 1 to the next number of float32: what an operation rounds.
ROUNDING = 2.0**-24
TIMES = np.arange(40, dtype=np.float32) * np.float32(10.0)
PATHS = np.cumsum(RNG.normal(0.0, 40.0, (50, 40, 2)), axis=1).astype(np.float32)
FIXED = np.array([2000.0, 6000.0], np.float32)
MOVING = np.array([2000.0, 6000.0, 3.0, -1.0], np.float32)


def doubled(*arrays):
    return [np.asarray(a, float) for a in arrays]


def entries(found, wanted):
    """Return the largest error of an entry over the roots of its diagonal entries."""
    size = np.sqrt(np.diagonal(wanted, axis1=-2, axis2=-1))
    scale = size[..., :, None] * size[..., None, :]
    assert (found[scale == 0] == 0).all()
    return float((np.abs(found - wanted)[scale > 0] / scale[scale > 0]).max())


@pytest.mark.parametrize("n", [1, 2, 4, 9])
@pytest.mark.parametrize("count", [1, 15, 16, 17, 100])
@pytest.mark.parametrize("weighted", [False, True])
def test_a_gram_matrix_is_good_to_single_precision(n, count, weighted):
    rows = RNG.normal(size=(30, count, n)).astype(np.float32)
    weights = [RNG.uniform(0.1, 2.0, count).astype(np.float32)] * weighted
    found = gm.gram(rows, *weights)
    wanted = gm.gram(*doubled(rows, *weights))
    assert found.dtype == np.float32
    assert wanted.dtype == np.float64
    # Up to two products and `count` sums, each rounded.
    assert entries(found, wanted) < (count + 2) * ROUNDING


@pytest.mark.parametrize("m", [1, 7, 16, 17, 31, 32, 33, 40])
@pytest.mark.parametrize("state", [FIXED, MOVING], ids=["fixed", "moving"])
@pytest.mark.parametrize("levels", [False, True])
def test_information_of_bearings_is_good_to_single_precision(m, state, levels):
    sigma = RNG.uniform(0.005, 0.02, m).astype(np.float32) if levels else np.float32(0.0078125)
    sigma = np.asarray(sigma)
    times = [TIMES[:m]] if len(state) == 4 else []
    found = gm.maneuver.fisher(PATHS[:, :m], state, sigma, *times)
    wanted = gm.maneuver.fisher(*doubled(PATHS[:, :m], state, sigma, *times))
    assert found.dtype == np.float32
    # A row entry takes about ten operations, its square twice that and two products of time.
    assert 0 < entries(found, wanted) < (m + 25) * ROUNDING


def test_arrays_decide_and_numbers_and_lists_go_along():
    rows = RNG.normal(size=(5, 6, 4)).astype(np.float32)
    weights = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    single = gm.gram(rows, weights)
    assert single.dtype == np.float32
    assert (single == gm.gram(rows, np.array(weights, np.float32))).all()
    for other in (np.array(weights), np.arange(1, 7), np.arange(1, 7, dtype=np.float16)):
        double = gm.gram(rows, other)
        assert double.dtype == np.float64
        assert (double == gm.gram(rows.astype(float), np.array(weights))).all()
    assert gm.maneuver.fisher(PATHS, [2000.0, 6000.0], 0.01).dtype == np.float32
    assert gm.maneuver.fisher(PATHS, FIXED.astype(float), 0.01).dtype == np.float64
    assert gm.maneuver.fisher(PATHS, FIXED, np.full(40, 0.01)).dtype == np.float64


def test_a_layout_does_not_change_the_bits():
    rows = RNG.normal(size=(6, 50, 4)).astype(np.float32)
    wide = np.repeat(rows, 2, axis=0)[::2]
    assert not wide.flags.c_contiguous
    assert gm.gram(wide).tobytes() == gm.gram(rows).tobytes()
    assert gm.gram(wide).dtype == np.float32
    one_by_one = np.array([gm.gram(one) for one in rows])
    assert one_by_one.tobytes() == gm.gram(rows).tobytes()


def test_results_do_not_depend_on_threads():
    rows = RNG.normal(size=(20_000, 30, 4)).astype(np.float32)
    paths = np.repeat(PATHS, 400, axis=0)
    found = []
    before = gm.set_threads(1)
    try:
        for threads in (1, 2, 5):
            gm.set_threads(threads)
            both = gm.gram(rows), gm.maneuver.fisher(paths, FIXED, 0.01)
            found.append(b"".join(one.tobytes() for one in both))
    finally:
        gm.set_threads(before)
    assert len(set(found)) == 1


def test_an_array_for_the_results_has_their_type():
    rows = RNG.normal(size=(9, 50, 4)).astype(np.float32)
    out = np.zeros((9, 4, 4), np.float32)
    assert gm.gram(rows, out=out) is out
    assert out.tobytes() == gm.gram(rows).tobytes()
    with pytest.raises(gm.InputError, match=r"out is of float64, .* of float32, shape \(9, 4, 4\)"):
        gm.gram(rows, out=np.zeros((9, 4, 4)))
    out = np.zeros((50, 2, 2), np.float32)
    assert gm.maneuver.fisher(PATHS, FIXED, 0.01, out=out) is out


def test_a_result_over_its_own_rows():
    memory = RNG.normal(size=20_000 * 16).astype(np.float32)
    rows, out = memory.reshape(20_000, 4, 4), memory.reshape(20_000, 4, 4)
    wanted = gm.gram(rows.copy())
    assert gm.gram(rows, out=out).tobytes() == wanted.tobytes()


def test_what_is_wrong_is_named_as_in_double_precision():
    rows = np.ones((3, 20, 4), np.float32)
    rows[1, 7, 2] = np.nan
    with pytest.raises(gm.InputError, match=r"rows\[1, 7, 2\] = nan: must be finite"):
        gm.gram(rows)
    with pytest.raises(gm.InputError, match=r"weights\[1\] = -2: must be >= 0"):
        gm.gram(np.ones((2, 4), np.float32), [1.0, -2.0])
    with pytest.raises(gm.InputError, match=r"the Gram matrix overflows float32"):
        gm.gram(np.full((2, 4), 1e20, np.float32))
    assert np.isfinite(gm.gram(np.full((2, 4), 1e20))).all()
    path = PATHS.copy()
    path[3, 5, 1] = np.inf
    with pytest.raises(gm.InputError, match=r"path\[3, 5, 1\] = inf: must be finite"):
        gm.maneuver.fisher(path, FIXED, 0.01)
    path[3, 5] = FIXED
    with pytest.raises(gm.InputError, match=r"at batch index \[3\]: position 5 is the target"):
        gm.maneuver.fisher(path, FIXED, 0.01)
    with pytest.raises(gm.InputError, match=r"sigma\[0\] = 0 rad: must be > 0"):
        gm.maneuver.fisher(PATHS, FIXED, np.float32([0.0]))


def test_what_cancels_is_computed_in_double_precision():
    rows = RNG.normal(size=(4, 30, 4)).astype(np.float32)
    bearings = RNG.normal(size=(4, 30)).astype(np.float32)
    calls = [
        (gm.crlb_std, (rows,)),
        (gm.bearings.gram, (TIMES[:30], bearings)),
        (gm.bearings.discriminant_sum, (TIMES[:30], bearings)),
        (gm.maneuver.fisher_det, (PATHS, FIXED, np.full(1, 0.01, np.float32))),
        (gm.dipole.field, (np.float32([[1, 2, 3]]), np.float32([[1, 0, 0]]))),
    ]
    for call, arguments in calls:
        found = call(*arguments)
        assert found.dtype == np.float64
        assert found.tobytes() == call(*doubled(*arguments)).tobytes()
    matrix, det = gm.maneuver.fisher_and_det(PATHS, FIXED, 0.01)
    assert matrix.dtype == det.dtype == np.float64
