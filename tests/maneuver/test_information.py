"""Fisher information along a path: identities, the pairwise form, bad input."""

import mpmath as mp
import numpy as np
import pytest

import gramian as gm

man = gm.maneuver


def some_path(rng, m=37, batch=()):
    path = np.cumsum(rng.normal(scale=30, size=(*batch, m, 2)), axis=-2)
    return path, rng.uniform(0.001, 0.1, (*batch, m)), np.cumsum(rng.uniform(1, 9, m))


def test_fixed_target_equals_the_first_block_of_the_moving_one():
    path, sigma, times = some_path(np.random.default_rng(1))
    fixed = man.fisher(path, [900.0, 400.0], sigma)
    moving = man.fisher(path, [900.0, 400.0, 0.0, 0.0], sigma, times)
    np.testing.assert_allclose(moving[:2, :2], fixed, rtol=1e-12)


def test_moving_target_equals_the_bearing_rows():
    path, sigma, times = some_path(np.random.default_rng(2), m=150)
    state = [900.0, 400.0, 3.0, -2.0]
    rows = gm.bearings.rows(times, path, state, sigma)
    np.testing.assert_allclose(man.fisher(path, state, sigma, times), rows.T @ rows, rtol=1e-11)
    det = man.fisher_det(path, state, sigma, times)
    assert det == pytest.approx(np.prod(np.linalg.svd(rows)[1]) ** 2, rel=1e-10)


def test_matrix_and_determinant_in_one_pass():
    rng = np.random.default_rng(11)
    path, _, times = some_path(rng, m=50, batch=(3, 7))
    for target, when in (([900.0, 400.0], None), ([900.0, 400.0, 3.0, -2.0], times)):
        for sigma in (0.02, rng.uniform(0.01, 0.03, 50)):
            matrix, det = man.fisher_and_det(path, target, sigma, when)
            assert det.shape == (3, 7)
            np.testing.assert_array_equal(matrix, man.fisher(path, target, sigma, when))
            exact = man.fisher_det(path, target, sigma, when)
            np.testing.assert_allclose(det, exact, rtol=1e-9)
    with pytest.raises(gm.InputError, match=r"determinant.*overflow"):
        man.fisher_and_det(path, [900.0, 400.0], 1e-100)
    with pytest.raises(gm.InputError, match=r"path\[0, 2, 1\]"):
        man.fisher_and_det(np.array([[[0.0, 1.0], [5.0, 1.0], [3.0, np.nan]]]), [9.0, 9.0], 0.1)


def test_pairwise_form_equals_the_determinant():
    path, sigma, _ = some_path(np.random.default_rng(3), batch=(5, 4))
    target = [300.0, -900.0]
    pairs = man.fisher_det(path, target, sigma, method="pairs")
    root = man.fisher_det(path, target, sigma)
    assert pairs.shape == (5, 4)
    np.testing.assert_allclose(pairs, root, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.det(man.fisher(path, target, sigma)), root, rtol=1e-9)


def test_pairwise_form_against_its_formula():
    path, sigma, _ = some_path(np.random.default_rng(4), m=9)
    gap = np.array([300.0, -900.0]) - path
    b, r = np.arctan2(gap[:, 0], gap[:, 1]), np.hypot(gap[:, 0], gap[:, 1])
    wanted = sum(
        (np.sin(b[i] - b[j]) / (sigma[i] * sigma[j] * r[i] * r[j])) ** 2
        for i in range(9)
        for j in range(i)
    )
    got = man.fisher_det(path, [300.0, -900.0], sigma, method="pairs")
    assert got == pytest.approx(wanted, rel=1e-10)


@pytest.mark.parametrize("method", ["root", "pairs"])
def test_determinant_of_nearly_parallel_bearings_keeps_its_digits(method):
    # The information as a matrix would keep none: bearings within 1e-8 rad.
    path = np.stack([np.linspace(0.0, 1.0, 20), np.zeros(20)], axis=1)
    target = np.array([0.0, 1e8])
    with mp.workdps(40):
        sums = [mp.mpf(0)] * 3
        for x, y in path:
            dx, dy = mp.mpf(target[0]) - mp.mpf(x), mp.mpf(target[1]) - mp.mpf(y)
            r2 = dx**2 + dy**2
            sums = [sums[0] + (dy / r2) ** 2, sums[1] - dx * dy / r2**2, sums[2] + (dx / r2) ** 2]
        wanted = float(sums[0] * sums[2] - sums[1] ** 2)
    assert man.fisher_det(path, target, 1.0, method=method) == pytest.approx(wanted, rel=1e-7)


def test_information_adds_turns_and_scales():
    path, sigma, _ = some_path(np.random.default_rng(5))
    target = np.array([700.0, 200.0])
    whole = man.fisher(path, target, sigma)
    parts = man.fisher(path[:9], target, sigma[:9]) + man.fisher(path[9:], target, sigma[9:])
    np.testing.assert_allclose(parts, whole, rtol=1e-12)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    np.testing.assert_allclose(
        man.fisher(path @ turn.T, turn @ target, sigma), turn @ whole @ turn.T, rtol=1e-10
    )
    np.testing.assert_allclose(man.fisher(path * 1e3, target * 1e3, sigma), whole / 1e6, rtol=1e-12)
    np.testing.assert_allclose(man.fisher(path, target, 2 * sigma), whole / 4, rtol=1e-12)
    assert (np.linalg.eigvalsh(whole) > 0).all()


def test_trajectory_accumulates_the_same():
    path = man.trajectory([0.0, 1000.0], [0.0, 0.0], 20.0, 1.0, 120, sigma=0.02)
    for k in (1, 2, 64, 65, 120):
        part = path.path[:k]
        np.testing.assert_allclose(
            path.information[k - 1], man.fisher(part, [0, 1000], 0.02), rtol=1e-12, atol=1e-12
        )
        assert path.det[k - 1] == pytest.approx(
            man.fisher_det(part, [0, 1000], 0.02), rel=1e-12, abs=0
        )


def test_the_bound_is_that_of_the_problem():
    path = man.trajectory([0.0, 1000.0], [0.0, 0.0], 20.0, 1.0, 120, sigma=0.02)
    answer = gm.analyze(man.problem(path.path, [0, 1000], 0.02))
    np.testing.assert_allclose(path.crlb_std[-1], answer.crlb_std, rtol=1e-12)
    assert np.isinf(path.crlb_std[0]).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sigma": 0.0}, r"sigma\[0\] = 0 rad: must be > 0"),
        ({"sigma": [0.1, -0.1, 0.1]}, r"sigma\[1\] = -0.1 rad: must be > 0"),
        ({"sigma": [0.1, 0.1]}, r"sigma has shape \(2,\)"),
        ({"target": [5.0, 5.0]}, "position 1 is the target's"),
        ({"target": [[9.0, 9.0], [5.0, 5.0]]}, r"at batch index \[1\]: position 1"),
        ({"target": [5.0]}, r"target has shape \(1,\)"),
        ({"target": [9.0, 9.0, 1.0, 1.0]}, "a moving target needs times"),
        ({"times": [0.0, 1.0, 2.0]}, "a fixed one has none"),
        ({"target": [9.0, 9, 1, 1], "times": [0.0, 2.0, 1.0]}, r"times\[2\] = 1 s: must be later"),
        ({"path": np.zeros((0, 2))}, "must not be empty"),
        ({"path": [[0.0, np.nan]]}, r"path\[0, 1\] = nan: must be finite"),
    ],
)
def test_bad_input_is_named(change, message):
    good = {"path": [[0.0, 0.0], [5.0, 5.0], [0.0, 1.0]], "target": [9.0, 9.0], "sigma": 0.1}
    with pytest.raises(gm.InputError, match=message):
        man.fisher(**{**good, **change})
    with pytest.raises(gm.InputError, match=message):
        man.fisher_det(**{**good, **change})


def test_pairs_need_a_fixed_target():
    with pytest.raises(gm.InputError, match="for a fixed target"):
        man.fisher_det([[0, 0], [1, 0]], [9, 9, 1, 1], 0.1, [0, 1], method="pairs")
    with pytest.raises(gm.InputError, match="method = 'all'"):
        man.fisher_det([[0, 0], [1, 0]], [9, 9], 0.1, method="all")


@pytest.mark.parametrize("moving", [False, True])
def test_the_problem_is_that_of_tracks(moving):
    """A path and a target in the engine of tracks: the same rows, ranks, bounds and scales."""
    path, sigma, times = some_path(np.random.default_rng(7), m=60)
    target = [900.0, 400.0, 3.0, -2.0][: 4 if moving else 2]
    own = man.problem(path, target, sigma, times if moving else None)
    scene = man.scene(path, sigma, times, order=int(moving))
    theirs = gm.tracks.problem(scene, target)
    size = np.linalg.norm(own.rows, axis=0)
    assert np.abs((own.rows - theirs.rows) / size).max() < 1e-15
    np.testing.assert_allclose(gm.crlb_std(own), gm.crlb_std(theirs), rtol=1e-11)
    np.testing.assert_allclose(own.scale, theirs.scale, rtol=1e-12)
    assert own.units == theirs.units
    rows = gm.tracks.rows(scene, target)
    matrix = man.fisher(path, target, sigma, times if moving else None)
    scales = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    assert np.abs((rows.T @ rows - matrix) / scales).max() < 1e-14
    # By its last position the observer knows range and bearing of a fixed target.
    gap = np.array(target[:2]) - path[0 if moving else -1]
    step = 1e-3 * np.array(own.combinations["range"][:2]) * np.hypot(*gap) ** 0
    assert np.isclose(np.hypot(*(gap + step)) - np.hypot(*gap), 1e-3, rtol=1e-6)
    turn = own.combinations["bearing"][:2]
    assert np.isclose(turn @ [gap[1], -gap[0]], 1.0)


def test_a_planned_path_in_a_scene():
    """What the planner says of its path is what the scene says, whatever is measured."""
    sensors = [
        man.Sensing("bearing", 0.01, bias="compass"),
        man.Sensing("range", 30.0, detection=0.8),
    ]
    plan = man.plan(
        [800.0, 4e3, 2.0, -1.0], [0.0, 0.0], speed=5.0, dt=20.0, samples=20, sensors=sensors,
        starts=1, restarts=0, bound=False,
    )  # fmt: skip
    times = 20.0 * np.arange(20)
    scene = man.scene(plan.path, sensors, times, order=1)
    state = {"x0": 800.0, "y0": 4e3, "vx": 2.0, "vy": -1.0, "compass": 0.0}
    bounds = gm.crlb_std(gm.tracks.problem(scene, state))
    np.testing.assert_allclose(bounds, plan.crlb_std[0], rtol=1e-9)
    # And it can be measured and estimated along it.
    seen = gm.tracks.simulate(scene, state, seed=1)
    assert np.isnan(seen[20:]).any()
    assert not np.isnan(seen[:20]).any()
    found = gm.tracks.estimate_many(scene, gm.tracks.simulate(scene, state, trials=40, seed=1))
    error = (found.state - list(state.values())) / found.std
    assert (np.abs(error) < 5).all()
    # Two observers see the same target.
    both = man.scene(np.stack([plan.path, plan.path + 500.0]), 0.01, times, order=1)
    assert both.m == 40


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"path": [0.0, 0.0]}, r"path has shape \(2,\): must be \(m, 2\)"),
        ({"path": np.zeros((3, 3))}, r"path has shape \(3, 3\)"),
        ({"path": np.zeros((0, 2))}, r"path has shape \(0, 2\)"),
        ({"path": [[0.0, np.nan], [1.0, 1.0]]}, r"path\[0, 1\] = nan: must be finite"),
        ({"sensors": 0.0}, r"sigma\[0\] = 0: must be > 0"),
        ({"sensors": [0.1, 0.1, 0.1]}, "sigma"),
        ({"sensors": "bearing"}, "sigma"),
        ({"sensors": [man.Sensing("range", 3.0), 0.1]}, r"sensors\[1\] = 0.1: must be a Sensing"),
        ({"times": [0.0]}, r"times has shape \(1,\): must be \(2,\), as the path has"),
        ({"times": [1.0, 0.0]}, r"times\[1\] = 0 s: must be later"),
        ({"order": 2}, "order = 2: must be 0, a fixed target, or 1"),
    ],
)
def test_scenes_that_are_none(change, message):
    good = {"path": [[0.0, 0.0], [1.0, 1.0]], "sensors": 0.1}
    with pytest.raises(gm.InputError, match=message):
        man.scene(**(good | change))
