"""Gramians and piecewise constant systems against independent results."""

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import scipy.signal

import gramian as gm

CV_A, CV_C = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0]])


def stable(seed, n=4, p=2):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n))
    return a - (np.linalg.eigvals(a).real.max() + 0.5) * np.eye(n), rng.normal(size=(p, n))


def test_infinite_window_of_stable_systems_is_that_of_scipy():
    for seed in range(5):
        a, c = stable(seed)
        found = gm.linear.gramian(a, c, window=200.0)
        assert np.allclose(found, scipy.linalg.solve_continuous_lyapunov(a.T, -c.T @ c), rtol=1e-9)
        phi = scipy.linalg.expm(0.1 * a)
        discrete = gm.linear.gramian(phi, c, window=400.0, dt=0.1)
        expected = scipy.linalg.solve_discrete_lyapunov(phi.T, c.T @ c)
        assert np.allclose(discrete, expected, rtol=1e-9)


def test_infinite_window_is_that_published_by_python_control():
    # Its tests of gram(sys, "o"), testGramWo and testGramWo2: 6 decimals printed.
    a = np.array([[1.0, -2.0], [3.0, -4.0]])
    c = np.array([[4.0, 5.0], [6.0, 7.0]])
    found = gm.linear.gramian(a, c, window=60.0)
    assert np.allclose(found, [[257.5, -94.5], [-94.5, 56.5]], rtol=1e-12)
    found = gm.linear.gramian(gm.linear.transition(a, 0.2), c, window=60.0, dt=0.2)
    expected = [[1305.369179, -440.046414], [-440.046414, 333.034844]]
    assert np.abs(found - expected).max() < 1e-6
    found = gm.linear.gramian(a, [[6.0, 8.0]], window=60.0)
    assert np.allclose(found, [[198, -72], [-72, 44]], rtol=1e-12)


@pytest.mark.parametrize("shift", [-2.0, 0.0, 1.0])
def test_finite_window_is_the_integral_to_ten_digits(shift):
    rng = np.random.default_rng(7)
    a, c = rng.normal(size=(4, 4)) + shift * np.eye(4), rng.normal(size=(2, 4))

    def integrand(t):
        e = c @ scipy.linalg.expm(a * t)
        return (e.T @ e).ravel()

    expected, _ = scipy.integrate.quad_vec(integrand, 0, 3.0, epsabs=0, epsrel=1e-13)
    found = gm.linear.gramian(a, c, window=3.0)
    assert np.abs(found.ravel() - expected).max() < 1e-10 * np.abs(expected).max()


def test_constant_velocity_which_control_refuses():
    found = gm.linear.gramian(CV_A, CV_C, window=3.0)
    assert np.allclose(found, [[3, 4.5], [4.5, 9]], rtol=1e-14)
    found = gm.linear.gramian([[1, 1], [0, 1]], CV_C, window=4.0, dt=1.0)
    assert found.tolist() == [[5, 10], [10, 30]]


def test_window_of_the_inertial_example_against_its_rows():
    sins = gm.inertial.static_base(0.6)
    rows = gm.linear.rows(sins, window=100.0, dt=1.0)
    phi = gm.linear.transition(sins.A, 1.0)
    j = gm.linear.gramian(phi, sins.C, window=100.0, dt=1.0, R=sins.noise**2)
    scale = np.outer(sins.prior, sins.prior)
    assert np.allclose(j * scale, rows.T @ rows * scale, rtol=1e-9, atol=1e-9)


def test_units_do_not_spoil_the_gramian():
    rng = np.random.default_rng(1)
    a, c = stable(3)
    one = gm.linear.gramian(a, c, window=2.0)
    for _ in range(10):
        d, time = 10.0 ** rng.uniform(-9, 9, 4), 10.0 ** rng.uniform(-6, 6)
        other = gm.linear.gramian(a * d / d[:, None] * time, c * d, window=2.0 / time)
        # In a unit of time the integral is in that unit.
        assert np.allclose(other / np.outer(d, d) * time, one, rtol=1e-9)


def test_process_noise_in_discrete_time_by_joint_covariance():
    rng = np.random.default_rng(4)
    phi, c = rng.normal(size=(3, 3)), rng.normal(size=(1, 3))
    root = rng.normal(size=(3, 3))
    q, r, steps = root @ root.T, 0.3, 6
    # y = O x0 + M w + v: the information is O^T cov^-1 O.
    powers = [np.linalg.matrix_power(phi, k) for k in range(steps)]
    o = np.vstack([c @ power for power in powers])
    m = np.zeros((steps, 3 * (steps - 1)))
    for k in range(steps):
        for i in range(k):
            m[k, 3 * i : 3 * i + 3] = (c @ powers[k - 1 - i])[0]
    covariance = m @ np.kron(np.eye(steps - 1), q) @ m.T + r * np.eye(steps)
    expected = o.T @ np.linalg.solve(covariance, o)
    found = gm.linear.gramian(phi, c, window=steps - 1.0, dt=1.0, R=r, Q=q)
    assert np.allclose(found, expected, rtol=1e-10)


def test_process_noise_in_continuous_time_by_the_riccati_equation():
    a, c = stable(2)
    q = np.diag([0.5, 0.0, 1.0, 0.2])

    def rate(_, j):
        j = j.reshape(4, 4)
        return (a.T @ j + j @ a + c.T @ c - j @ q @ j).ravel()

    solved = scipy.integrate.solve_ivp(rate, (0, 3.0), np.zeros(16), rtol=1e-11, atol=1e-13)
    found = gm.linear.gramian(a, c, window=3.0, Q=q)
    assert np.allclose(found.ravel(), solved.y[:, -1], rtol=1e-8, atol=1e-10)


def test_batches_of_gramians():
    a = np.stack([stable(k)[0] for k in range(6)])
    c = stable(0)[1]
    found = gm.linear.gramian(a, c, window=1.0)
    assert found.shape == (6, 4, 4)
    assert np.array_equal(found[4], gm.linear.gramian(a[4], c, window=1.0))


def test_transition_is_that_of_scipy():
    rng = np.random.default_rng(9)
    for size in (0.1, 1.0, 10.0):
        a = size * rng.normal(size=(5, 5))
        expected = scipy.linalg.expm(a)
        assert (
            np.abs(gm.linear.transition(a, 1.0) - expected).max() < 1e-11 * np.abs(expected).max()
        )


def test_piecewise_ranks_of_goshen_meskin():
    # A bias that only a change of the system tells from the state: y = x + b u.
    a = np.zeros((3, 3, 3))
    a[0, 0, 1] = a[1, 0, 1] = a[2, 0, 1] = 1.0
    a[1, 0, 2], a[2, 0, 2] = 1.0, 1.0
    c = np.array([[1.0, 0, 0]])
    found = gm.linear.piecewise(a, c, [1.0, 1.0, 1.0], ["x", "v", "b"])
    assert found.segment_ranks == (2, 2, 2)
    assert found.stripped_ranks == (2, 3, 3)
    assert found.total_ranks == (2, 3, 3)
    assert found.kernel_rests == (True, True, True)
    assert found.null_space.shape == (3, 0)
    assert np.linalg.matrix_rank(found.stripped_matrix()) == 3
    assert np.linalg.matrix_rank(found.rows(dt=0.1)) == 3


def test_piecewise_rows_are_taken_at_whole_multiples_of_the_step():
    """Whatever the segments are: short ones must not add samples."""
    rng = np.random.default_rng(5)
    a, c = 0.3 * rng.normal(size=(4, 3, 3)), rng.normal(size=(4, 2, 3))
    durations = np.array([1.3, 0.2, 0.25, 2.5])
    found = gm.linear.piecewise(a, c, durations).rows(dt=0.5, R=np.diag([4.0, 0.25]))
    ends = np.cumsum(durations)
    expected = []
    for time in 0.5 * np.arange(9):
        segment = min(int(np.searchsorted(ends, time, side="right")), 3)
        phi = np.eye(3)
        for j in range(segment):
            phi = scipy.linalg.expm(a[j] * durations[j]) @ phi
        begin = ends[segment] - durations[segment]
        phi = scipy.linalg.expm(a[segment] * (time - begin)) @ phi
        expected.append(np.diag([0.5, 2.0]) @ c[segment] @ phi)
    np.testing.assert_allclose(found, np.concatenate(expected), rtol=1e-12, atol=1e-12)


def test_stripped_rank_can_exceed_the_total_where_a_kernel_moves():
    # The first segment does not see x2 and moves it into x1's place unseen.
    a = np.zeros((2, 3, 3))
    a[0, 1, 2] = 1.0
    c = np.zeros((2, 1, 3))
    c[0, 0, 0], c[1, 0, 1] = 1.0, 1.0
    found = gm.linear.piecewise(a, c, [2.0, 1.0], ["x0", "x1", "x2"])
    assert found.kernel_rests[0] is False
    assert found.total_ranks == (1, 2)
    # What is not seen: x1 + 2 x2 is, at the beginning of the second segment.
    assert np.allclose(found.null_space.T, [[0, 1, -0.5]])


def test_piecewise_with_one_segment_is_levels():
    sins = gm.inertial.static_base(0.4)
    found = gm.linear.piecewise([sins.A], sins.C, [60.0], sins.names)
    assert found.total_ranks == (12,)
    assert np.allclose(found.null_space, gm.linear.levels(sins).null_space, rtol=1e-9, atol=1e-12)


BAD = [
    (lambda: gm.linear.gramian(CV_A, CV_C, window=0.0), "window = 0"),
    (lambda: gm.linear.gramian(CV_A, CV_C, window=1.0, dt=-1.0), "dt = -1"),
    (lambda: gm.linear.gramian(100 * np.eye(2), CV_C, window=100.0), "too long for a system"),
    (lambda: gm.linear.gramian(CV_A, CV_C, window=1.0, R=[[1, 2], [3, 4]]), "R has shape"),
    (lambda: gm.linear.gramian(CV_A, CV_C, window=1.0, Q=-np.eye(2)), "Q has a negative"),
    (lambda: gm.linear.gramian(CV_A, CV_C, window=1.0, Q=[[1, 2], [0, 1]]), "Q is not symmetric"),
    (lambda: gm.linear.gramian(CV_A, CV_C, window=1.0, Q=np.eye(3)), "Q has shape"),
    (lambda: gm.linear.rows(CV_A, CV_C, window=1.0, dt=0.1, time="often"), "time = 'often'"),
    (lambda: gm.linear.rows(100 * np.eye(2), CV_C, window=99.0, dt=1.0), "overflow float64"),
    (lambda: gm.linear.piecewise(CV_A, CV_C, [1.0]), r"A has shape \(2, 2\)"),
    (lambda: gm.linear.piecewise([CV_A], CV_C, [1.0, 2.0]), "durations has 2 entries"),
    (lambda: gm.linear.piecewise([CV_A], CV_C, [0.0]), r"durations\[0\] = 0 s: must be > 0"),
]


@pytest.mark.parametrize(("call", "message"), BAD)
def test_bad_input_is_named(call, message):
    with pytest.raises(gm.InputError, match=message):
        call()


def test_unequal_intervals_are_those_of_the_transitions():
    from scipy.linalg import expm

    rng = np.random.default_rng(5)
    a, c = rng.normal(size=(4, 4)), rng.normal(size=(2, 4))
    times = np.array([1.0, 1.25, 1.5, 2.7, 3.0])
    expected = np.concatenate([c @ expm(a * (t - 1.0)) for t in times])
    np.testing.assert_allclose(gm.linear.rows(a, c, times=times), expected, rtol=1e-11)
    whitened = np.concatenate([np.diag([0.5, 0.2]) @ c @ expm(a * (t - 1.0)) for t in times])
    found = gm.linear.gramian(a, c, times=times, R=[4.0, 25.0])
    np.testing.assert_allclose(found, whitened.T @ whitened, rtol=1e-10)
    # Equal intervals are a window.
    np.testing.assert_allclose(
        gm.linear.rows(a, c, times=[0.0, 0.5, 1.0]),
        gm.linear.rows(a, c, window=1.0, dt=0.5),
        rtol=1e-11,
    )
    answer = gm.analyze(
        gm.linear.problem(np.diag([-1.0, -1.0, -2.0]), [[1, 1, 1]], times=[0, 0.1, 3])
    )
    assert answer.null_combinations == ("x0 +1, x1 -1",)


def test_a_system_that_varies_has_the_rows_of_its_own_solution():
    from scipy.integrate import solve_ivp

    def a(t):
        return np.array([[0, 1, 0], [-1 - 0.5 * np.sin(t), -0.1, t], [0, 0, -0.2 * t]])

    def c(t):
        return np.array([[1.0, 0, np.cos(t)]])

    times = np.array([0.5, 0.6, 1.7, 4.0])
    phi = solve_ivp(
        lambda t, x: (a(t) @ x.reshape(3, 3)).ravel(), (0.5, 4.0), np.eye(3).ravel(),
        t_eval=times, rtol=1e-12, atol=1e-13, method="DOP853",
    ).y.T.reshape(-1, 3, 3)  # fmt: skip
    expected = np.concatenate([c(t) @ p for t, p in zip(times, phi, strict=True)])
    np.testing.assert_allclose(gm.linear.rows(a, c, times=times), expected, rtol=1e-9, atol=1e-10)

    # The integral, beside that of the Gramian's own differential equation.
    def rate(t, y):
        p = y[:9].reshape(3, 3)
        seen = c(t) @ p
        return np.concatenate([(a(t) @ p).ravel(), (seen.T @ seen).ravel()])

    end = solve_ivp(
        rate, (0, 4.0), np.concatenate([np.eye(3).ravel(), np.zeros(9)]), rtol=1e-11, atol=1e-12,
        method="DOP853",
    ).y[9:, -1]  # fmt: skip
    np.testing.assert_allclose(
        gm.linear.gramian(a, c, window=4.0), end.reshape(3, 3), rtol=1e-8, atol=1e-9
    )
    # A constant one is the Gramian there was.
    constant = gm.linear.gramian(lambda t: a(0.3), c(0.3), window=2.0)
    np.testing.assert_allclose(constant, gm.linear.gramian(a(0.3), c(0.3), window=2.0), rtol=1e-10)


@pytest.mark.parametrize("middle", [3.3, 5.0, 7.77])
@pytest.mark.parametrize("width", [0.3, 0.04, 0.005])
def test_a_burst_is_seen_or_told(middle, width):
    # x1 + x2 for a moment, x1 at other times.
    def smooth(t):
        return [[1.0, np.exp(-(((t - middle) / width) ** 2))]]

    def sharp(t):
        return [[1.0, 1.0 if abs(t - middle) < width else 0.0]]

    a = np.zeros((2, 2))
    area = width * np.sqrt(np.pi)
    expected = [[10.0, area], [area, area / np.sqrt(2)]]
    assert np.allclose(gm.linear.gramian(a, smooth, window=10.0), expected, rtol=1e-9)
    ends = [middle - width, middle + width]
    found = gm.linear.gramian(a, sharp, window=10.0, breakpoints=ends)
    assert np.allclose(found, [[10.0, 2 * width], [2 * width, 2 * width]], rtol=1e-11)
    with pytest.raises(gm.InputError, match=r"does not settle about t = .* breakpoints"):
        gm.linear.gramian(a, sharp, window=10.0)


def test_a_burst_of_the_dynamics_is_seen():
    # x2 runs only for a moment, and x1 with it.
    def a(t):
        return [[0.0, np.exp(-(((t - 3.3) / 0.02) ** 2))], [0.0, 0.0]]

    moved = 0.02 * np.sqrt(np.pi)
    found = gm.linear.gramian(a, [[1.0, 0.0]], window=10.0)
    assert np.isclose(found[0, 1], 6.7 * moved, rtol=1e-8)


def test_breakpoints_are_named_where_they_do_not_fit():
    a, c = np.zeros((1, 1)), lambda t: [[1.0]]
    with pytest.raises(gm.InputError, match=r"breakpoints\[1\] = 3.0: must be inside the window"):
        gm.linear.gramian(a, c, window=2.0, breakpoints=[1.0, 3.0])
    with pytest.raises(gm.InputError, match=r"breakpoints has shape \(1, 1\)"):
        gm.linear.gramian(a, c, window=2.0, breakpoints=[[1.0]])
    with pytest.raises(gm.InputError, match="breakpoints go with A"):
        gm.linear.gramian(a, [[1.0]], window=2.0, breakpoints=[1.0])
    with pytest.raises(gm.InputError, match="times goes without"):
        gm.linear.gramian(a, c, times=[1.0], breakpoints=[1.0])


def test_a_varying_system_tells_what_a_constant_one_hides():
    # x' = 0 with a row that turns: two states, each instant shows one combination.
    still = gm.linear.problem(np.zeros((2, 2)), [[1.0, 0]], times=[0.0, 0.5, 1.0])
    turning = gm.linear.problem(
        np.zeros((2, 2)), lambda t: [[np.cos(t), np.sin(t)]], times=[0.0, 0.5, 1.0]
    )
    assert gm.analyze(still).rank == 1
    assert gm.analyze(turning).rank == 2
    # Alike in all that varies: the difference stays hidden.
    both = gm.linear.problem(
        lambda t: -np.sin(t) * np.eye(2), [[1.0, 1.0]], times=np.linspace(0, 3, 7)
    )
    assert gm.analyze(both).null_combinations == ("x0 +1, x1 -1",)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"times": [1.0, 1.0]}, r"times\[1\] = 1.0: must be later"),
        ({"times": [0.0, np.nan]}, r"times\[1\].* = nan"),
        ({"times": []}, "times has shape"),
        ({"times": [0.0, 1.0], "window": 1.0}, "times"),
        ({}, "missing"),
    ],
)
@pytest.mark.parametrize("ask", [gm.linear.rows, gm.linear.gramian])
def test_times_that_cannot_be_used_are_named(ask, arguments, said):
    with pytest.raises(gm.InputError, match=said):
        ask(np.eye(2), [[1.0, 0.0]], **arguments)


def test_a_matrix_that_changes_its_shape_or_is_not_finite_is_named():
    with pytest.raises(gm.InputError, match=r"A\(t = .*\) has shape \(3, 3\): must be \(2, 2\)"):
        gm.linear.rows(lambda t: np.eye(2 if t < 0.3 else 3), [[1.0, 0]], times=[0, 1.0], rtol=1e-6)
    with pytest.raises(gm.InputError, match=r"A\(t = 0\)"):
        gm.linear.rows(lambda t: np.full((2, 2), np.nan), [[1.0, 0]], times=[0, 1.0])


def test_a_hidden_state_is_the_one_that_is_named():
    """Its column was rounding, 1e-74, and counted: position and speed were said to be lost."""
    a = [[0, 1, 0], [0, 0, 0], [0, 0, 0]]
    for window in (1.0, 100.0):
        problem = gm.linear.problem(a, [[1, 0, 0]], window=window, dt=0.1, names=["x", "v", "b"])
        assert not problem.rows[:, 2].any()
        answer = gm.analyze(problem)
        assert answer.null_combinations == ("b +1",)
        assert np.isfinite(answer.crlb_std[:2]).all()


@pytest.mark.parametrize("dt", [0.5, 1.0])
def test_samples_at_the_period_hide_the_speed(dt):
    a = [[0, 1], [-4 * np.pi**2, 0]]
    answer = gm.analyze(gm.linear.problem(a, [[1, 0]], window=10.0, dt=dt))
    assert (answer.status, answer.null_combinations) == ("unobservable", ("x1 +1",))
    between = gm.analyze(gm.linear.problem(a, [[1, 0]], window=10.0, dt=0.3))
    assert between.status == "observable"


def test_a_combination_that_turns_and_is_never_seen():
    def turn(t):
        return np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]])

    def a(t):
        return (turn(t + np.pi / 2) + turn(t) @ np.diag([-1.0, -2.0])) @ turn(t).T

    def c(t):
        return turn(t).T[:1]

    for window in (1.0, 5.0, 20.0):
        answer = gm.analyze(gm.linear.problem(a, c, window=window, dt=0.1))
        assert (answer.rank, answer.null_combinations) == (1, ("x1 +1",))


def test_a_discrete_object_is_taken_as_one():
    a, c = np.array([[0.5, 0.1], [0.0, 0.25]]), np.array([[1.0, 1.0]])
    sampled = scipy.signal.StateSpace(a, [[1.0], [1.0]], c, [[0.0]], dt=0.1)
    powers = np.vstack([c @ np.linalg.matrix_power(a, k) for k in range(11)])
    assert np.allclose(gm.linear.rows(sampled, window=1.0), powers)
    assert np.allclose(gm.linear.gramian(sampled, window=1.0), powers.T @ powers)
    assert np.allclose(gm.linear.problem(sampled, window=1.0).rows, powers)
    prior = gm.linear.degree(sampled, window=1.0, prior=[1.0, 1.0])
    assert np.allclose(
        prior.ratio,
        gm.linear.degree(a, c, window=1.0, dt=0.1, prior=[1.0, 1.0], time="discrete").ratio,
    )
    factor = gm.linear.gramian_factor(sampled)
    assert np.allclose(factor.T @ factor, scipy.linalg.solve_discrete_lyapunov(a.T, c.T @ c))
    assert np.allclose(
        gm.linear.hankel(sampled).values,
        gm.linear.hankel(a, [[1.0], [1.0]], c, time="discrete").values,
    )
    with pytest.raises(gm.InputError, match=r"dt = 0.2: the system is sampled every 0.1"):
        gm.linear.rows(sampled, window=1.0, dt=0.2)
    with pytest.raises(gm.InputError, match="is a discrete system"):
        gm.linear.split_gramian(sampled)


def test_rows_of_long_windows_are_those_of_each_sample():
    """Moved on a thousand at a time, and one by one where what is not seen overflows."""
    turn, shrink = 1e-3, 0.9999
    a = shrink * np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    seen = gm.linear.rows(a, [[1.0, 0.0]], window=4999.0, dt=1.0, time="discrete")
    k = np.arange(5000.0)
    wanted = shrink ** k[:, None] * np.stack([np.cos(k * turn), np.sin(k * turn)], axis=1)
    np.testing.assert_allclose(seen, wanted, rtol=0, atol=1e-12)
    unseen = gm.linear.rows(
        np.diag([0.5, 4.0]), [[1.0, 0.0]], window=1999.0, dt=1.0, time="discrete"
    )
    np.testing.assert_array_equal(unseen[:, 1], 0.0)
    np.testing.assert_array_equal(unseen[:1000, 0], 0.5 ** np.arange(1000))


def test_what_is_hidden_stays_apart_from_what_decays():
    """After 100 time constants rows of both look alike, to rounding, in mixed coordinates."""
    q = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    a = q @ np.diag([-1.0, 0.0, 0.0]) @ q.T
    c = [q[:, 2:].T, q[:, 1:2].T]
    found = gm.linear.piecewise([a, a], c, [100.0, 1.0])
    assert found.total_ranks == (1, 2)
    null = found.null_space[:, 0] / np.linalg.norm(found.null_space[:, 0])
    assert abs(null @ q[:, 0]) > 1 - 1e-12


def test_outputs_that_turn_by_a_little_from_segment_to_segment_show_all():
    """A null space is one: over many segments it was not (rank 16 for 18 on a circle)."""
    rng = np.random.default_rng(5)
    a = np.zeros((6, 6))
    a[:2, 2:4] = np.eye(2)
    a[2:4, 4:] = np.eye(2)
    angles = np.linspace(0, 0.5, 200)
    c = np.zeros((200, 1, 6))
    c[:, 0, 0], c[:, 0, 1] = np.cos(angles), np.sin(angles)
    found = gm.linear.piecewise([a] * 200, c, rng.uniform(0.5, 1.5, 200))
    assert found.segment_ranks == (3,) * 200
    assert found.total_ranks[0] == 3
    assert found.rank == 6
