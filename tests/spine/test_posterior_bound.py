"""The posterior bound: published and high-precision values, identities, bad input."""

import mpmath as mp
import numpy as np
import pytest

import gramian as gm

bounds = gm.bounds
INF = np.inf


def nearly_constant_velocity(q, dt=1.0):
    move = np.kron(np.eye(2), [[1.0, dt], [0.0, 1.0]])
    noise = q * np.kron(np.eye(2), [[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return move, noise


PLANE = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0]])


def exact(rows, move, noise, prior, digits=50):
    """Standard deviations by the covariance recursion in long arithmetic."""
    with mp.workdps(digits):
        n = move.shape[0]
        f, q, p = (mp.matrix(x.tolist()) for x in (move, noise, prior))
        out = []
        for k, some in enumerate(rows):
            if k:
                p = f * p * f.T + q
            for row in some:
                h = mp.matrix([row.tolist()])
                ph = p * h.T
                p = p - ph * ph.T / (1 + (h * ph)[0])
            out.append([float(mp.sqrt(p[i, i])) for i in range(n)])
        return np.array(out)


def test_published_nearly_constant_velocity():
    move, noise = nearly_constant_velocity(0.05)
    rows = [None] + 20 * [PLANE / 5**0.5]
    for form in ("covariance", "information"):
        bound = bounds.posterior(rows, move, noise, np.diag([5.0, 10, 5, 10]), form=form)
        place, speed = bound.rmse([0, 2]), bound.rmse([1, 3])
        assert place.shape == (21,)
        np.testing.assert_allclose(
            place[[0, 1, 20]], [3.16227766, 2.73899281, 1.89934607], atol=5e-9
        )
        np.testing.assert_allclose(speed[[0, 20]], [4.47213595, 0.63338613], atol=1e-8)


@pytest.mark.parametrize("form", ["covariance", "information"])
@pytest.mark.parametrize("q", [1e-6, 1e-12, 0.0, 1.0])
def test_small_process_noise_keeps_the_digits(form, q):
    move, noise = nearly_constant_velocity(q)
    rows = np.broadcast_to(PLANE / 5**0.5, (101, 2, 4))
    prior = np.diag([5.0, 10, 5, 10])
    bound = bounds.posterior(rows, move, noise, prior, form=form)
    wanted = exact(rows, move, noise, prior)
    assert np.abs(bound.std / wanted - 1).max() < 1e-12


@pytest.mark.parametrize("form", ["covariance", "information"])
def test_ill_conditioned_prior_and_noise(form):
    # A prior of a thousand kilometres and a sensor of a millimetre: 1e18 in variance.
    move, noise = nearly_constant_velocity(1e-6)
    rows = np.broadcast_to(PLANE * 1e3, (101, 2, 4))
    prior = np.diag([1e12, 1e6, 1e12, 1e6])
    bound = bounds.posterior(rows, move, noise, prior, form=form)
    wanted = exact(rows, move, noise, prior)
    assert np.abs(bound.std / wanted - 1).max() < 1e-12


@pytest.mark.parametrize("form", ["covariance", "information"])
def test_moving_bearing_sensor(form):
    move, noise = nearly_constant_velocity(1e-6, 10.0)
    t = np.arange(101) * 10.0
    observer = np.stack([3 * t, 200 * np.sin(t / 150)], axis=1)
    target = np.stack([2000 + 2 * t, 5000 - t], axis=1)
    gap = target - observer
    r2 = np.sum(gap**2, axis=1)
    h = np.stack([gap[:, 1], 0 * r2, -gap[:, 0], 0 * r2], axis=1) / r2[:, None] / 0.01
    prior = np.diag([1e6, 25.0, 1e6, 25.0])
    bound = bounds.posterior(h[:, None], move, noise, prior, form=form)
    wanted = exact(h[:, None], move, noise, prior)
    assert np.abs(bound.std / wanted - 1).max() < 1e-12


def test_nothing_known_at_the_start():
    move, noise = nearly_constant_velocity(0.1)
    rows = np.broadcast_to(PLANE, (6, 2, 4))
    bound = bounds.posterior(rows, move, noise, [INF] * 4)
    np.testing.assert_allclose(bound.std[0], [1, INF, 1, INF])
    assert np.isfinite(bound.std[1:]).all()
    vague = bounds.posterior(rows, move, noise, np.diag([1e24] * 4), form="covariance")
    np.testing.assert_allclose(bound.std[1:], vague.std[1:], rtol=1e-6)
    with pytest.raises(gm.UnobservableError, match=r"at \[0\]: state 1 is not determined"):
        _ = bounds.posterior(rows, move, noise, [INF] * 4, keep="all").covariance


def test_without_process_noise_it_is_the_static_bound():
    t = np.linspace(0.0, 300.0, 31)
    path = np.stack([5 * t, 100 * np.sin(t / 50)], axis=1)
    static = gm.bearings.rows(t, path, [2000.0, 4000.0, 3.0, -2.0], 0.01)
    # In the state at each time: x0 = x - T v.
    back = np.eye(4) + np.zeros((31, 1, 1))
    back[:, 0, 2] = back[:, 1, 3] = -t
    rows = static[:, None] @ back
    move = np.eye(4)
    move[0, 2] = move[1, 3] = 10.0
    bound = bounds.posterior(rows, move, np.zeros((4, 4)), [INF] * 4)
    now = np.linalg.inv(back[-1])
    wanted = np.sqrt(np.diag(now @ gm.crlb(static) @ now.T))
    np.testing.assert_allclose(bound.std[-1], wanted, rtol=1e-9)
    assert np.isinf(bound.std[0]).all()


def test_never_determined_states_stay_infinite():
    move, noise = nearly_constant_velocity(0.1)
    rows = np.broadcast_to(PLANE[:1], (50, 1, 4))
    bound = bounds.posterior(rows, move, noise, [INF] * 4)
    assert np.isfinite(bound.std[1:, :2]).all()
    assert np.isinf(bound.std[:, 2:]).all()


def random_problem(rng, n, steps, k, trials=()):
    move = np.eye(n) + 0.3 * rng.normal(size=(*trials, steps - 1, n, n))
    half = rng.normal(size=(*trials, steps - 1, n, n))
    noise = half @ np.swapaxes(half, -1, -2)
    rows = rng.normal(size=(*trials, steps, k, n))
    half = rng.normal(size=(*trials, n, n))
    return rows, move, noise, half @ np.swapaxes(half, -1, -2)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 6, 9])
def test_forms_and_textbook_agree(n):
    rng = np.random.default_rng(n)
    rows, move, noise, prior = random_problem(rng, n, 12, 3)
    p, wanted = prior, []
    for k in range(12):
        if k:
            p = move[k - 1] @ p @ move[k - 1].T + noise[k - 1]
        p = np.linalg.inv(np.linalg.inv(p) + rows[k].T @ rows[k])
        wanted.append(p)
    for form in ("covariance", "information"):
        bound = bounds.posterior(rows, move, noise, prior, form=form, keep="all")
        np.testing.assert_allclose(bound.covariance, wanted, rtol=1e-6, atol=1e-9)
        diagonal = np.diagonal(bound.covariance, axis1=-2, axis2=-1)
        np.testing.assert_allclose(bound.std**2, diagonal, rtol=1e-9)
        np.testing.assert_allclose(bound.last.covariance, wanted[-1], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("form", ["covariance", "information"])
@pytest.mark.parametrize("trials", [1, 5, 16, 37])
def test_batches_equal_single_trials(form, trials):
    rng = np.random.default_rng(trials)
    rows, move, noise, prior = random_problem(rng, 4, 20, 2, (trials,))
    batch = bounds.posterior(rows, move, noise, prior, form=form, keep="all")
    assert batch.std.shape == (trials, 20, 4)
    for i in {0, trials // 2, trials - 1}:
        one = bounds.posterior(rows[i], move[i], noise[i], prior[i], form=form, keep="all")
        np.testing.assert_array_equal(batch.std[i], one.std)
        np.testing.assert_array_equal(batch.roots[i], one.roots)


def test_any_number_of_threads_gives_the_same():
    rows, move, noise, prior = random_problem(np.random.default_rng(1), 4, 60, 1, (300,))
    before = gm.set_threads(1)
    one = bounds.posterior(rows, move, noise, prior).std
    gm.set_threads(4)
    four = bounds.posterior(rows, move, noise, prior).std
    gm.set_threads(before)
    np.testing.assert_array_equal(one, four)


@pytest.mark.parametrize("form", ["covariance", "information"])
def test_predict_and_update_apart_are_the_recursion(form):
    rows, move, noise, prior = random_problem(np.random.default_rng(2), 3, 8, 2)
    whole = bounds.posterior(rows, move, noise, prior, form=form)
    now = bounds.Posterior.of_prior(prior, form)
    for k in range(8):
        if k:
            now = now.predict(move[k - 1], noise[k - 1])
        now = now.update(rows[k])
        np.testing.assert_allclose(now.std, whole.std[k], rtol=1e-10)
    np.testing.assert_allclose(now.covariance, whole.last.covariance, rtol=1e-8)


def test_a_bound_goes_on_from_where_another_ended():
    rows, move, noise, prior = random_problem(np.random.default_rng(7), 4, 20, 1)
    whole = bounds.posterior(rows, move, noise, prior)
    first = bounds.posterior(rows[:9], move[:8], noise[:8], prior)
    moved = first.last.predict(move[8], noise[8])
    second = bounds.posterior(rows[9:], move[9:], noise[9:], moved)
    np.testing.assert_allclose(second.std, whole.std[9:], rtol=1e-10)


def test_varying_numbers_of_rows_and_detection():
    move, noise = nearly_constant_velocity(0.2)
    rng = np.random.default_rng(4)
    some = [rng.normal(size=(k, 4)) for k in (2, 0, 3, 1)]
    some[1] = None
    ragged = bounds.posterior(some, move, noise, [3.0] * 4)
    p = np.eye(4) * 9
    for k, rows in enumerate(some):
        if k:
            p = move @ p @ move.T + noise
        if rows is not None:
            p = np.linalg.inv(np.linalg.inv(p) + rows.T @ rows)
        np.testing.assert_allclose(ragged.std[k], np.sqrt(np.diag(p)), rtol=1e-9)
    rows = rng.normal(size=(5, 2, 4))
    seen = np.array([1.0, 0.0, 0.25, 0.9, 0.5])
    ours = bounds.posterior(rows, move, noise, [3.0] * 4, detection=seen)
    scaled = bounds.posterior(rows * np.sqrt(seen)[:, None, None], move, noise, [3.0] * 4)
    np.testing.assert_allclose(ours.std, scaled.std, rtol=1e-12)
    never = bounds.posterior(rows, move, noise, [3.0] * 4, detection=0.0)
    nothing = bounds.posterior([None] * 5, move, noise, [3.0] * 4)
    np.testing.assert_allclose(never.std, nothing.std, rtol=1e-12)


def test_expectation_over_trajectories_is_tichavskys():
    rng = np.random.default_rng(8)
    samples, steps, n = 40, 6, 3
    rows = rng.normal(size=(samples, steps, 2, n))
    moves = np.eye(n) + 0.2 * rng.normal(size=(samples, steps - 1, n, n))
    noise = np.diag([0.5, 0.1, 0.3])
    inverse = np.linalg.inv(noise)
    j = np.eye(n)
    wanted = []
    for k in range(steps):
        if k:
            f = moves[:, k - 1]
            d11 = np.mean(np.swapaxes(f, -1, -2) @ inverse @ f, axis=0)
            d12 = -np.mean(f, axis=0).T @ inverse
            j = inverse - d12.T @ np.linalg.inv(j + d11) @ d12
        h = rows[:, k]
        j = j + np.mean(np.swapaxes(h, -1, -2) @ h, axis=0)
        wanted.append(np.sqrt(np.diag(np.linalg.inv(j))))
    mean, spread = bounds.expected_transition(moves, noise)
    seen = bounds.expected_rows(rows)
    for form in ("covariance", "information"):
        ours = bounds.posterior(seen, mean, noise, [1.0] * n, spread=spread, form=form)
        np.testing.assert_allclose(ours.std, wanted, rtol=1e-10)


def test_cubature_points_have_the_moments():
    rng = np.random.default_rng(9)
    half = rng.normal(size=(3, 2))
    covariance = half @ half.T
    points, weights = bounds.cubature_points([1.0, -2.0, 3.0], covariance)
    np.testing.assert_allclose(weights @ points, [1, -2, 3], atol=1e-12)
    gaps = points - [1, -2, 3]
    np.testing.assert_allclose((weights[:, None] * gaps).T @ gaps, covariance, atol=1e-7)


def test_a_kalman_filter_reaches_the_bound():
    move, noise = nearly_constant_velocity(0.3)
    prior = np.diag([5.0, 10, 5, 10])
    bound = bounds.posterior([PLANE] * 10, move, noise, prior, keep="all")
    rng = np.random.default_rng(10)
    trials = 4000
    x = rng.multivariate_normal(np.zeros(4), prior, trials)
    guess = np.zeros((trials, 4))
    for k in range(10):
        if k:
            x = x @ move.T + rng.multivariate_normal(np.zeros(4), noise, trials)
            guess = guess @ move.T
        z = x @ PLANE.T + rng.normal(size=(trials, 2))
        gain = bound.covariance[k] @ PLANE.T
        guess = guess + (z - guess @ PLANE.T) @ gain.T
    rmse = np.sqrt(np.mean((x - guess) ** 2, axis=0))
    np.testing.assert_allclose(rmse, bound.std[-1], rtol=0.05)


def test_process_noise_of_few_sources_is_taken_whatever_its_rounding():
    """G G^T is singular but for rounding, of either sign; it comes back within that."""
    rng = np.random.default_rng(3)
    for _ in range(2000):
        n = int(rng.integers(2, 8))
        sources = rng.normal(size=(n, int(rng.integers(1, n)))) * 10.0 ** rng.uniform(-3, 3, (n, 1))
        noise = sources @ sources.T * 10.0 ** rng.uniform(-12, 3)
        # Known exactly before, not measured: what the noise adds is all there is.
        bound = gm.bounds.posterior(
            np.zeros((2, 1, n)), np.eye(n), noise, np.zeros((n, n)), keep="all"
        )
        size = np.sqrt(np.diag(noise))
        np.testing.assert_allclose(bound.std[-1], size, rtol=1e-13)
        root = bound.roots[-1] / size
        np.testing.assert_allclose(root.T @ root, noise / np.outer(size, size), atol=1e-13)


GOOD = {
    "rows": np.ones((3, 1, 2)),
    "transition": np.eye(2),
    "process_noise": np.eye(2),
    "prior": [1.0, 1.0],
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"prior": [1.0, -0.5]}, r"prior\[1\] = -0.5: must be >= 0"),
        ({"prior": [1.0, np.nan]}, r"prior\[1\] = nan: must be >= 0"),
        ({"prior": [[1.0, 0.0], [0.0, -1.0]]}, "prior: not positive semidefinite: state 1"),
        ({"prior": [[1.0, 0.5], [0.0, 1.0]]}, r"prior: entries \[0, 1\] and \[1, 0\] differ"),
        ({"prior": [1.0, INF], "form": "covariance"}, "needs a finite prior"),
        ({"prior": np.zeros((2, 2)), "form": "information"}, "prior is singular"),
        ({"process_noise": [[1.0, 2.0], [2.0, 1.0]]}, "process_noise: not positive semidef"),
        ({"process_noise": np.eye(3)}, "must be"),
        ({"transition": np.eye(3)}, r"transition has shape \(3, 3\)"),
        ({"transition": np.zeros((2, 2)), "form": "information"}, "transition has no inverse"),
        ({"transition": np.ones((5, 2, 2))}, "must be"),
        ({"rows": np.ones((3, 1, 3))}, r"rows has shape \(3, 1, 3\)"),
        ({"rows": np.full((3, 1, 2), np.nan)}, r"rows\[0, 0, 0\] = nan: must be finite"),
        ({"rows": []}, "rows has shape"),
        ({"rows": [None, np.ones((1, 3))]}, r"rows\[1\] has shape \(1, 3\)"),
        ({"detection": 1.5}, "detection = 1.5: must be in"),
        ({"detection": [1.0, -0.1, 1.0]}, r"detection\[1\] = -0.1"),
        ({"detection": [1.0, 0.5]}, "detection has shape"),
        ({"form": "sqrt"}, "form = 'sqrt'"),
        ({"keep": "some"}, "keep = 'some'"),
    ],
)
def test_bad_input_is_named(change, message):
    with pytest.raises(gm.InputError, match=message):
        bounds.posterior(**{**GOOD, **change})


def test_singular_transition_needs_the_covariance_form():
    # A bias that is drawn anew at every step.
    move = np.diag([1.0, 0.0])
    noise = np.diag([0.0, 4.0])
    rows = np.broadcast_to([[1.0, 1.0]], (50, 1, 2))
    bound = bounds.posterior(rows, move, noise, [1e3, 2.0])
    # The average of 50 measurements, each with variance 1 + 4.
    assert bound.std[-1, 0] == pytest.approx((1e-6 + 50 / 5) ** -0.5, rel=1e-12)


@pytest.mark.parametrize("weight", 10.0 ** np.arange(7, 17))
@pytest.mark.parametrize("prior", [INF, 1e3])
def test_a_row_far_heavier_than_the_others_costs_neither_rank_nor_digits(weight, prior):
    """In one factor of the information the others would vanish beside it (issue: 1e14)."""
    rows = np.array([[1.0, 0.3], [-0.2, 1.0], [weight, 1.7 * weight]])
    known = np.eye(2) / prior
    wanted = gm.analyze(np.vstack([known[known.any(axis=1)], rows])).crlb_std
    for order in ([0, 1, 2], [2, 0, 1], [0, 2, 1]):
        at = bounds.Posterior.of_prior([prior, prior], "information")
        for k in order:
            at = at.update(rows[[k]])
        np.testing.assert_allclose(at.std, wanted, rtol=1e-9)
    found = bounds.posterior(
        rows[:, None], np.eye(2), np.zeros((2, 2)), [prior, prior], form="information"
    )
    np.testing.assert_allclose(found.std[-1], wanted, rtol=1e-9)
    np.testing.assert_allclose(gm.crlb_std(np.vstack([known[known.any(axis=1)], rows])), wanted)


@pytest.mark.parametrize("prior", [INF, 1e3])
def test_heavy_rows_of_a_batch_cost_no_digits(prior):
    """Each trial by itself, in long arithmetic; the first row weighs from 1 to 1e15."""
    rng = np.random.default_rng(5)
    move, noise = nearly_constant_velocity(0.05)
    rows = rng.normal(size=(4, 5, 4, 4))
    rows[:, 2, 0] *= 10.0 ** np.array([0, 7, 12, 15])[:, None]
    known = np.full(4, prior)
    found = bounds.posterior(rows, move, noise, known, form="information", keep="all")
    flat = 1e12 if np.isinf(prior) else prior
    for trial, std in enumerate(found.std):
        wanted = exact(rows[trial], move, noise, flat**2 * np.eye(4))
        np.testing.assert_allclose(std, wanted, rtol=1e-9)
    np.testing.assert_allclose(found.last.std, found.std[:, -1], rtol=1e-12)


def test_a_prior_far_tighter_than_the_others_costs_no_digits():
    move, noise = nearly_constant_velocity(0.05)
    rows = [PLANE / 5**0.5] * 5
    for tight in 10.0 ** np.arange(-16, 0, 3):
        known = np.array([10.0, tight, 5.0, 10.0])
        wanted = exact(rows, move, noise, np.diag(known**2))
        found = bounds.posterior(rows, move, noise, known, form="information")
        np.testing.assert_allclose(found.std, wanted, rtol=1e-12)


def test_units_do_not_decide_whether_a_transition_has_an_inverse():
    move, noise = nearly_constant_velocity(0.05)
    units = np.array([1e-9, 1e4, 1e7, 1e-3])
    rows = np.broadcast_to(np.eye(4), (6, 4, 4))
    plain = bounds.posterior(rows, move, noise, [INF] * 4).std
    scaled = bounds.posterior(
        rows / units,
        units[:, None] * move / units,
        units[:, None] * noise * units,
        [INF] * 4,
    ).std
    np.testing.assert_allclose(scaled / units, plain, rtol=1e-12)


def test_heavy_rows_that_say_the_same_leave_no_rounding_behind():
    at = bounds.Posterior.of_prior([INF, INF])
    heavy = np.array([[1e14, 1.1e14], [1.3e14, 1.43e14], [3e14, 3.3e14]])
    for row in heavy:
        at = at.update([row])
        assert np.isinf(at.std).all()
    light = [[1.0, 0.0]]
    np.testing.assert_allclose(
        at.update(light).std, gm.crlb_std(np.vstack([heavy, light])), rtol=1e-6
    )


def test_heavy_rows_beside_nothing_known_are_refused_rather_than_spoilt():
    at = bounds.Posterior.of_prior([INF] * 3).update([[1e15, 1e15, 0], [1.0, 0, 0]])
    with pytest.raises(gm.InputError, match="rows so heavy that the others fade"):
        at.update([[0, 2.0, 0]])
    # At the same step nothing is lost.
    rows = [[1e15, 1e15, 0], [1.0, 0, 0], [0, 2.0, 0], [0, 0, 1]]
    found = bounds.Posterior.of_prior([INF] * 3).update(rows).std
    np.testing.assert_allclose(found, gm.crlb_std(rows), rtol=1e-9)


def test_exact_knowledge_before_and_on_the_way():
    """As the covariance recursion in long arithmetic; exact knowledge is a row without noise."""
    move, noise = nearly_constant_velocity(0.05)
    rows = [PLANE / 5**0.5] * 6
    known = np.diag([0.0, 10, 5, 10])
    wanted = exact(rows, move, noise, known)
    found = bounds.posterior(rows, move, noise, np.sqrt(np.diag(known)))
    np.testing.assert_allclose(found.std, wanted, rtol=1e-12, atol=1e-12)
    # At the third step the two velocities are the same.
    problem = gm.Problem(PLANE / 5**0.5, ["x", "vx", "y", "vy"])
    tied = problem.constrain([[0.0, 1, 0, -1]])
    mixed = [problem, problem, tied, problem]
    found = bounds.posterior(mixed, move, noise, dict.fromkeys(problem.names, 3.0))
    heavy = np.vstack([PLANE / 5**0.5, [0.0, 1e12, 0, -1e12]])
    wanted = exact([rows[0], rows[0], heavy, rows[0]], move, noise, 9 * np.eye(4))
    np.testing.assert_allclose(found.std, wanted, rtol=1e-9)
    assert found.std[2, 1] == pytest.approx(found.std[2, 3], rel=1e-12)
    with pytest.raises(gm.InputError, match="exact knowledge beside states of which"):
        bounds.posterior([problem, tied], move, noise, {"x": 0.0})
    with pytest.raises(gm.InputError, match="prior is singular"):
        bounds.posterior([problem, tied], move, noise, {"x": 0.0}, form="information")
