"""Rows of a user's own function: each value of the table, and errors that hold."""

import numpy as np
import pytest

import gramian as gm

DAY = 1.7e9  # s, time from an epoch far away


def rows_of(h, x, **options):
    names = [f"x{i}" for i in range(len(x))]
    return gm.from_function(h, x, 1.0, names, **options).rows()


def test_detail_of_ten_metres_at_5300_km():
    found = rows_of(lambda x: [np.hypot(x[0] - 5.3e6, 10.0)], [5.3e6 + 5])
    assert found[0, 0] == pytest.approx(5 / np.sqrt(125), rel=1e-8)


def test_degrees_as_metres():
    """Beacons of a few hundred metres in degrees and in metres: the same bounds."""
    radius = np.radians(1) * 6.371e6
    beacons = np.array([[0.0, 0.0], [300.0, 0.0], [0.0, 200.0]])
    at = np.array([120.0, 90.0])

    def ranges(p):
        return np.hypot(*(p - beacons).T)

    def in_degrees(q):
        return ranges((np.asarray(q) - [48.0, 11.0]) * radius)

    metres = gm.crlb_std(gm.from_function(ranges, at, 0.1, ["n", "e"]))
    degrees = gm.from_function(in_degrees, [48.0, 11.0] + at / radius, 0.1, ["lat", "lon"])
    np.testing.assert_allclose(gm.crlb_std(degrees) * radius, metres, rtol=1e-6)


def test_time_of_an_epoch():
    times = np.linspace(0, 6, 9)

    def from_origin(t0):
        return lambda x: x[0] * np.cos(times + (x[1] - t0))

    near = gm.from_function(from_origin(0.0), [2.0, 0.3], 0.1, ["a", "t"])
    far = gm.from_function(from_origin(DAY), [2.0, DAY + 0.3], 0.1, ["a", "t"])
    np.testing.assert_allclose(gm.crlb_std(far), gm.crlb_std(near), rtol=1e-5)


@pytest.mark.parametrize(
    ("h", "wanted"),
    [(lambda x: [np.arctan2(x[0], -1)], -1), (lambda x: [np.mod(x[0], 2 * np.pi)], 1)],
)
def test_an_angle_that_wraps_at_x(h, wanted):
    assert rows_of(h, [0.0], angles=[0])[0, 0] == pytest.approx(wanted, abs=1e-5)
    assert rows_of(h, [0.0], periods=2 * np.pi)[0, 0] == pytest.approx(wanted, abs=1e-5)
    with pytest.raises(gm.InputError, match=r"h\(x\)\[0\] jumps .* x0 .*angles=\[0\]"):
        rows_of(h, [0.0])


def test_a_kink_has_no_derivative():
    with pytest.raises(gm.InputError, match="kink where x0 = 0"):
        rows_of(lambda x: [abs(x[0])], [0.0])


@pytest.mark.parametrize(
    ("h", "x"),
    [
        (lambda x: [abs(x[0]), x[1]], [0.0, 2.0]),
        (lambda x: [max(x[0], 0.0), x[1]], [0.0, 2.0]),
        (lambda x: [np.clip(x[0], -1, 1), x[1]], [1.0, 2.0]),
        (lambda x: [min(x[0], x[1]), x[0] + x[1]], [2.0, 2.0]),
        (lambda x: [np.interp(x[0], [0, 1, 2, 3], [0, 1, 3, 7])], [2.0]),
        (lambda x: [abs(x[0] - 1e9)], [1e9]),
    ],
)
def test_a_kink_of_any_output_is_named(h, x):
    with pytest.raises(gm.InputError, match=r"h\(x\)\[0\] has a kink where x0 = "):
        rows_of(h, x)


def test_a_small_kink_beside_slopes_is_within_the_stated_error():
    model = gm.from_function(lambda x: [x[0] + 1e-3 * abs(x[1]), x[1]], [1.0, 0.0], 1.0, ["a", "b"])
    assert model.accuracy.error[0, 1] >= 1e-3


def test_flat_at_x_and_not_far_away():
    found = rows_of(lambda x: [np.clip(x[0], -1, 1), x[1]], [2.0, 2.0])
    np.testing.assert_allclose(found, [[0, 0], [0, 1]], atol=1e-10)


def test_rounding_alone_is_nothing():
    model = gm.from_function(
        lambda x: [(x[0] + 7.3) - x[0], ((x[0] - 21.9) + 14.6) - x[0], x[1]],
        [3.0, 2.0],
        1.0,
        ["a", "b"],
    )
    answer = gm.analyze(model)
    assert (answer.rank, answer.status) == (1, "unobservable")


def test_single_precision():
    """The product of two states, rounded to 24 bits."""
    factors = np.array([1.0, 2.0, 3.3], dtype=np.float32)
    model = gm.from_function(
        lambda x: np.float64(np.float32(x[0]) * np.float32(x[1]) * factors),
        [1.7, 2.9],
        1.0,
        ["a", "b"],
    )
    answer = gm.analyze(model)
    assert answer.rank == 1
    assert answer.status in {"unobservable", "undecided"}
    true = np.outer(factors, [2.9, 1.7])
    assert (np.abs(model.rows() - true) <= 3 * model.accuracy.error).all()


def test_printed_digits():
    model = gm.from_function(
        lambda x: np.round((x[0] + 2 * x[1]) * np.array([1.0, 2.0, 3.3]), 4),
        [1.7, 2.9],
        1.0,
        ["a", "b"],
    )
    answer = gm.analyze(model)
    assert answer.rank == 1
    assert answer.status in {"unobservable", "undecided"}


@pytest.mark.parametrize("digits", [1, 2, 3, 4, 6])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_printed_digits_are_the_noise_they_are(n, digits):
    """Few digits move in jumps: a step that meets one is no slope, however straight it looks."""
    rng = np.random.default_rng(17)
    names = ["a", "b", "c"][:n]
    useful = 0
    for _ in range(12):
        x, weights = rng.normal(size=n), rng.normal(size=(3, n))
        model = gm.from_function(
            lambda x, w=weights: np.round(2 * np.sin(w @ x), digits), x, 0.1, names
        )
        slope = 2 * np.cos(weights @ x)[:, None] * weights
        assert (np.abs(model.jacobian() - slope) <= 3 * model.accuracy.error).all()
        useful += bool((model.accuracy.error < 0.1 * np.abs(slope).max()).all())
    # Two digits leave little of a slope; six nearly all.
    assert useful >= {1: 0, 2: 0, 3: 4, 4: 6}.get(digits, 12)


def test_whole_numbers_and_constants_are_no_printed_digits():
    model = gm.from_function(
        lambda x: [x[0] + 2 * x[1], 5.0, x[0] - x[1]], [64.0, 3.0], 1.0, ["a", "b"]
    )
    np.testing.assert_allclose(model.jacobian(), [[1, 2], [0, 0], [1, -1]], atol=1e-12)
    assert model.accuracy.error.max() < 1e-10


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-8])
@pytest.mark.parametrize("method", ["RK45", "LSODA"])
def test_a_solver_with_adaptive_steps(rtol, method):
    """Two compartments: of volume and dose only the ratio can be found."""
    from scipy.integrate import solve_ivp

    def concentration(p):
        k12, k21, ke, volume, dose = p
        solution = solve_ivp(
            lambda _, a: [-(k12 + ke) * a[0] + k21 * a[1], k12 * a[0] - k21 * a[1]],
            (0, 8),
            [dose, 0],
            method=method,
            rtol=rtol,
            atol=1e-3 * rtol,
            t_eval=np.linspace(0.5, 8, 8),
        )
        return solution.y[0] / volume

    names = ["k12", "k21", "ke", "volume", "dose"]
    answer = gm.analyze(gm.from_function(concentration, [0.5, 0.3, 0.2, 5.0, 100.0], 0.01, names))
    assert answer.rank == 4
    assert answer.status in {"unobservable", "undecided"}


@pytest.mark.parametrize("offset", [0.0, 5e4, 5e6])
def test_cancellation_inside_h(offset):
    """Eight landmarks seen from a moving frame: yaw and the origin cannot be found."""
    rng = np.random.default_rng(1)
    landmarks = rng.uniform(-20, 20, (8, 3)) + offset
    path = rng.uniform(-5, 5, (4, 3)) + offset

    def seen(x):
        origin, yaw, points = x[:3], x[3], x[4:].reshape(8, 3)
        out = []
        for k, at in enumerate(path):
            c, s = np.cos(yaw + 0.3 * k), np.sin(yaw + 0.3 * k)
            turned = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
            # The carrier's own path is known in a frame of its own.
            c0, s0 = np.cos(yaw), np.sin(yaw)
            own = np.array([[c0, -s0, 0], [s0, c0, 0], [0, 0, 1]]) @ (at - offset)
            out.append(((points - (origin + own)) @ turned.T).ravel())
        return np.concatenate(out)

    x = np.concatenate([np.full(3, offset), [0.2], landmarks.ravel()])
    names = ["x", "y", "z", "yaw", *[f"l{i}" for i in range(24)]]
    answer = gm.analyze(gm.from_function(seen, x, 0.01, names))
    assert answer.nullity == 4


def test_complex_measurements():
    times = np.arange(5.0)
    model = gm.from_function(
        lambda x: x[0] * np.exp(1j * x[1] * (1 + times)), [2.0, 0.5], 0.1, ["a", "p"]
    )
    assert model.rows().shape == (10, 2)
    assert gm.analyze(model).rank == 2
    # Circular: half the variance in each part.
    assert model.rows()[0, 0] == pytest.approx(np.cos(0.5) * np.sqrt(2) / 0.1)
    hermitian = 0.01 * np.eye(5, dtype=complex)
    hermitian[0, 1], hermitian[1, 0] = 0.004j, -0.004j
    other = gm.from_function(
        lambda x: x[0] * np.exp(1j * x[1] * (1 + times)),
        [2.0, 0.5],
        hermitian,
        ["a", "p"],
    )
    jacobian = np.stack(
        [np.exp(1j * 0.5 * (1 + times)), 2j * (1 + times) * np.exp(1j * 0.5 * (1 + times))], axis=1
    )
    information = 2 * (jacobian.conj().T @ np.linalg.solve(hermitian, jacobian)).real
    np.testing.assert_allclose(gm.gram(other.rows()), information, rtol=1e-8)


class TestComplexStep:
    @pytest.mark.parametrize(
        "h",
        [
            lambda x: [np.linalg.norm(np.array([3e3, 4e3]) - x[:2]) + x[2]],
            lambda x: [abs(x[0]) * x[1], x[1], x[2]],
            lambda x: [np.real(x[0]) * x[1], x[1], x[2]],
        ],
    )
    def test_what_is_not_analytic_is_found(self, h):
        with pytest.raises(gm.InputError, match=r'not analytic.*method = "central"'):
            gm.from_function(h, [-10.0, 20.0, 3.0], 1.0, ["a", "b", "c"], method="complex")

    def test_differences_do_it(self):
        model = gm.from_function(lambda x: [abs(x[0]) * x[1], x[1]], [-10.0, 20.0], 1.0, ["a", "b"])
        assert gm.analyze(model).rank == 2


class TestGivenJacobian:
    @staticmethod
    def h(x):
        return np.array([x[0] + x[1] ** 2, 3 * x[0] + x[1]])

    @staticmethod
    def jacobian(x):
        return np.array([[1.0, 2 * x[1]], [3.0, 1.0]])

    def make(self, jacobian):
        return gm.from_function(
            self.h, [1.0, 2.0], 1.0, ["a", "b"], method="given", jacobian=jacobian
        )

    def test_right(self):
        np.testing.assert_allclose(self.make(self.jacobian).rows(), self.jacobian([1.0, 2.0]))

    @pytest.mark.parametrize(
        ("wrong", "word"),
        [
            (lambda self, x: self.jacobian(x).T, "transposed"),
            (lambda self, x: -self.jacobian(x), "sign"),
            (lambda self, x: np.degrees(self.jacobian(x)), "factor 0.01745"),
        ],
    )
    def test_wrong_is_named(self, wrong, word):
        with pytest.raises(gm.InputError, match=word):
            self.make(lambda x: wrong(self, x))


def test_few_evaluations_for_a_chain():
    calls = []

    def chain(x):
        calls.append(1)
        return np.concatenate([[x[0]], np.diff(x) ** 2 + x[1:]])

    n = 200
    x = np.random.default_rng(0).normal(size=n)
    names = [f"x{i}" for i in range(n)]
    pattern = np.eye(n, dtype=bool) | np.eye(n, k=-1, dtype=bool)
    local = gm.from_function(chain, x, 1.0, names, sparsity=pattern)
    assert len(calls) < 60
    assert local.accuracy.groups == 2
    calls.clear()
    found = gm.from_function(chain, x, 1.0, names, sparsity="find")
    assert len(calls) < 250
    jacobian = np.eye(n)
    step = 2 * np.diff(x)
    jacobian[np.arange(1, n), np.arange(1, n)] = 1 + step
    jacobian[np.arange(1, n), np.arange(n - 1)] = -step
    for model in (local, found):
        assert (np.abs(model.rows() - jacobian) <= 3 * model.accuracy.error).all()


def local_model(n, **options):
    """A chain whose links see two states each; its Jacobian."""
    calls = []

    def chain(x):
        calls.append(1)
        return np.concatenate([[x[0]], np.diff(x) + 0.1 * np.sin(x[1:]) * x[:-1]])

    x = np.random.default_rng(0).normal(size=n)
    jacobian = np.zeros((n, n))
    jacobian[0, 0] = 1
    i = np.arange(1, n)
    jacobian[i, i] = 1 + 0.1 * np.cos(x[1:]) * x[:-1]
    jacobian[i, i - 1] = -1 + 0.1 * np.sin(x[1:])
    names = [f"p{k // 2}.{'xy'[k % 2]}" for k in range(n)]
    return gm.from_function(chain, x, 0.1, names, **options), jacobian, calls


@pytest.mark.parametrize("given", ["find", "pattern", "sparse pattern"])
def test_a_thousand_states_with_local_rows_are_a_sparse_problem(given):
    from scipy.sparse import csr_array

    n = 1000
    pattern = np.eye(n, dtype=bool) | np.eye(n, k=-1, dtype=bool)
    sparsity = {"find": "find", "pattern": pattern, "sparse pattern": csr_array(pattern)}[given]
    model, jacobian, calls = local_model(n, sparsity=sparsity)
    assert len(calls) <= (200 if given == "find" else 40)
    problem = model.problem()
    assert isinstance(problem, gm.large.SparseProblem)
    assert problem.rows.nnz == 2 * n - 1
    np.testing.assert_allclose(problem.rows.toarray(), jacobian / 0.1, atol=1e-7)
    assert (np.abs(model.jacobian() - jacobian) <= 3 * model.accuracy.error).all()
    answer = gm.analyze(model)
    assert (answer.rank, answer.status) == (n, "observable")
    np.testing.assert_allclose(gm.crlb_std(model), gm.crlb_std(jacobian / 0.1), rtol=1e-6)
    # Asked elsewhere, and with one measurement missing.
    assert isinstance(model.problem(model.x + 0.01), gm.large.SparseProblem)
    sigma = np.full(n, 0.1)
    sigma[5] = np.inf
    fewer = local_model(n, sparsity=pattern)[0]
    fewer = gm.from_function(fewer.h, fewer.x, sigma, fewer.names, sparsity=pattern)
    assert fewer.problem().rows.shape == (n - 1, n)
    assert gm.analyze(fewer).nullity == 1


def test_where_rows_stay_dense():
    n = 120
    pattern = np.eye(n, dtype=bool) | np.eye(n, k=-1, dtype=bool)
    for options in (
        {},
        {"sparsity": np.ones((n, n))},
        {"sparsity": pattern, "row_sigma": 1e-9},
        {"sparsity": pattern, "tangent": np.eye(n)[:, 1:]},
    ):
        assert isinstance(local_model(n, **options)[0].problem().rows, np.ndarray)
    assert isinstance(local_model(60, sparsity="find")[0].problem().rows, np.ndarray)


def test_a_pattern_that_leaves_entries_out_is_refused():
    model, jacobian, _ = local_model(120)
    with pytest.raises(
        gm.InputError, match=r"leaves out 119 entries .* h\(x\)\[1\] depends on p0.x"
    ):
        gm.from_function(
            model.h,
            model.x,
            0.1,
            model.names,
            method="given",
            jacobian=lambda x: jacobian,
            sparsity=np.eye(120),
        )


def test_all_points_at_once():
    times = np.linspace(0, 4, 9)
    one = gm.from_function(lambda x: x[0] * np.sin(x[1] * times), [2.0, 0.7], 1.0, ["a", "w"])
    many = gm.from_function(
        lambda x: x[..., :1] * np.sin(x[..., 1:] * times),
        [2.0, 0.7],
        1.0,
        ["a", "w"],
        vectorized=True,
    )
    np.testing.assert_array_equal(one.rows(), many.rows())


def counted(h, x, sigma=0.1, **options):
    """A model, and the points at which its function was asked."""
    points = []

    def asked(state):
        points.append(state.tobytes())
        return h(state)

    names = [f"x{i}" for i in range(len(x))]
    with np.errstate(all="ignore"):
        return gm.from_function(asked, x, sigma, names, **options), points


def noisy(h, level):
    """With noise that is the same wherever the state is."""

    def out(x):
        bits = np.frombuffer(np.asarray(x).tobytes(), np.uint32)
        values = h(x)
        return values + level * np.random.default_rng(bits).standard_normal(values.shape)

    return out


#: Functions of W x, at x plus an offset.
KINDS = {
    "smooth": (np.sin, 0.0),
    "linear": (lambda u: u, 0.0),
    "polynomial": (lambda u: u**2 + 0.3 * u**3, 0.0),
    "fast": (lambda u: np.sin(300 * u), 0.0),
    "detail far from zero": (lambda u: np.hypot(u, 10.0), 1e6),
    "epoch": (np.sin, DAY),
    "offset": (lambda u: 1e6 + np.sin(u), 0.0),
    "noise 1e-12": (noisy(np.sin, 1e-12), 0.0),
    "noise 1e-7": (noisy(np.sin, 1e-7), 0.0),
    "noise 1e-4": (noisy(np.sin, 1e-4), 0.0),
    "single precision": (lambda u: np.float64(np.sin(np.float32(u))), 0.0),
    "two decimals": (lambda u: np.round(2 * np.sin(u), 2), 0.0),
    "four decimals": (lambda u: np.round(2 * np.sin(u), 4), 0.0),
    "cube": (lambda u: (u - np.floor(u)) ** 3, 0.0),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [1, 2, 3, 5, 20])
def test_at_most_18_evaluations_a_state_and_none_repeated(n, kind):
    """Six for a function without noise, twelve more where step or noise are looked for."""
    h, offset = KINDS[kind]
    for seed in range(4):
        rng = np.random.default_rng(seed)
        weights, x = rng.standard_normal((n + 2, n)), rng.standard_normal(n)
        model, points = counted(lambda s, w=weights: h(w @ (s - offset)), x + offset)
        assert len(points) == len(set(points)) == model.accuracy.evaluations
        assert len(points) <= 18 * n
        # What is asked of the model at its x asks nothing of the function again.
        model.jacobian(), model.rows(), gm.analyze(model), gm.crlb_std(model), model.h()
        assert len(points) == model.accuracy.evaluations


def test_random_functions_take_at_most_18_evaluations_a_state():
    from random_functions import smooth_function

    rng = np.random.default_rng(11)
    for _ in range(60):
        case = smooth_function(rng)
        model, points = counted(case.h, case.x, case.sigma)
        assert len(points) == len(set(points)) == model.accuracy.evaluations
        assert len(points) <= 18 * len(case.x)


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_noise_of_a_hundredth_of_the_first_change_is_noise(n):
    """It passed for detail that no step had resolved: errors of 1e13, and nothing decided."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        weights, x = rng.standard_normal((n + 2, n)), rng.uniform(1, 2, n)
        smooth = lambda s, w=weights: np.sin(w @ s)  # noqa: E731
        model, _ = counted(noisy(smooth, 1e-4), x)
        exact = np.cos(weights @ x)[:, None] * weights
        assert (np.abs(model.jacobian() - exact) <= 3 * model.accuracy.error).all()
        assert np.median(model.accuracy.error) < 0.1


@pytest.mark.parametrize("n", [1, 2, 3, 10, 40])
def test_a_smooth_function_takes_little_more_than_six_evaluations_a_state(n):
    weights = np.random.default_rng(n).standard_normal((n + 2, n))
    names = [f"x{i}" for i in range(n)]
    model = gm.from_function(lambda x: np.sin(weights @ x), np.full(n, 0.3), 0.1, names)
    assert model.accuracy.evaluations <= min(8 * n + 18 + 1, 18 * n)
    jacobian = np.cos(weights @ np.full(n, 0.3))[:, None] * weights
    assert (np.abs(model.jacobian() - jacobian) <= 3 * model.accuracy.error).all()
    assert model.accuracy.error.max() < 1e-7


def test_errors_hold_for_random_smooth_functions():
    """The error of each entry is at most three times the stated one (benches/bench_rows.py: 2000)."""
    from random_functions import smooth_function

    rng = np.random.default_rng(7)
    wrong = total = 0
    for _ in range(80):
        case = smooth_function(rng)
        with np.errstate(all="ignore"):
            model = gm.from_function(case.h, case.x, case.sigma, case.names)
        off = np.abs(model.jacobian() - case.jacobian)
        wrong += int((off > 3 * model.accuracy.error).sum())
        total += off.size
    assert wrong <= 0.002 * total


@pytest.mark.parametrize("noise", [0.0, 1e-12, 1e-7, 1e-4])
@pytest.mark.parametrize("states", [1, 2])
def test_errors_hold_for_few_states_near_zero(states, noise):
    """Few points tell the noise of one state alone: it may be larger than they show."""
    from random_functions import smooth_function

    rng = np.random.default_rng([31, states, int(noise * 1e12)])
    wrong = total = 0
    for _ in range(250):
        case = smooth_function(rng, states, noise)
        try:
            with np.errstate(all="ignore"):
                model = gm.from_function(case.h, case.x, case.sigma, case.names)
        except gm.InputError:
            # Noise of the size of the change, taken for a jump.
            assert noise == 1e-4
            continue
        assert model.accuracy.evaluations <= 18 * states
        off = np.abs(model.jacobian() - case.jacobian)
        wrong += int((off > 3 * model.accuracy.error).sum())
        total += off.size
    assert wrong <= 0.001 * total + 1


@pytest.mark.parametrize("value", [6.1e-17, 1.2e-16, -3e-16, 1e-15, 5e-324])
def test_a_zero_and_its_rounding_is_moved_as_a_zero(value):
    # The cosine of a right angle is no state that nothing sees.
    model = gm.from_function(lambda s: [s[0] + s[1], s[0] - s[1]], [1.0, value], 0.05, ["a", "b"])
    answer = gm.analyze(model)
    assert answer.status == "observable"
    np.testing.assert_allclose(answer.problem.all_rows, [[20, 20], [20, -20]], rtol=0.2)


def test_what_nothing_sees_is_still_not_seen():
    model = gm.from_function(lambda s: [s[0], 2 * s[0]], [1.0, 1.2e-16], 0.05, ["a", "b"])
    assert gm.analyze(model).null_combinations == ("b +1",)


ODD = {
    "sin(x)": (np.sin, 1.0),
    "sin(1000 x)": (lambda x: np.sin(1e3 * x), 1e3),
    "tanh(20 x)": (lambda x: np.tanh(20 * x), 20.0),
    "atan(x)": (np.arctan, 1.0),
    "x / (1 + x^2)": (lambda x: x / (1 + x * x), 1.0),
    "2 x + 1e6 x^3": (lambda x: 2 * x + 1e6 * x**3, 2.0),
    "3 x": (lambda x: 3 * x, 3.0),
}


@pytest.mark.parametrize("scale", [None, 1e-3, 1.0])
@pytest.mark.parametrize("name", ODD)
def test_an_odd_function_at_zero(name, scale):
    """Its even part is zero at any step, and tells nothing of how bent it is."""
    h, wanted = ODD[name]
    model = gm.from_function(
        lambda x: [h(x[0])], [0.0], 1.0, ["x"], scale=None if scale is None else [scale]
    )
    error = model.accuracy.error[0, 0]
    assert abs(model.rows()[0, 0] - wanted) <= 3 * error + 1e-15 * wanted
    assert error < 1e-7 * wanted


@pytest.mark.parametrize("name", ["tanh", "five tanh", "clip", "erf"])
@pytest.mark.parametrize("scale", [10.0, 100.0, 1e4])
def test_a_saturated_output_is_not_a_rounded_one(name, scale):
    """At every step it is a whole number, one of two or three: its slope may be any."""
    from scipy.special import erf

    h, wanted = {
        "tanh": (lambda x: np.tanh(20 * x), 20.0),
        "five tanh": (lambda x: 5 * np.tanh(20 * x), 100.0),
        "clip": (lambda x: np.clip(3 * x, -1, 2), 3.0),
        "erf": (lambda x: erf(50 * x), 100 / np.sqrt(np.pi)),
    }[name]
    model = gm.from_function(
        lambda x: [h(x[0]), x[1]], [0.0, 1.0], 1.0, ["x", "b"], scale=[scale, 1.0]
    )
    error = model.accuracy.error[0, 0]
    assert abs(model.rows()[0, 0] - wanted) <= 3 * error
    assert gm.analyze(model).status == ("undecided" if error > 1 else "observable")


@pytest.mark.parametrize("scale", [None, [1.0, 1.0], [100.0, 1.0]])
@pytest.mark.parametrize("x", [5.0, 50.0, 1e4, -1e3])
def test_far_in_saturation_the_other_states_are_known(x, scale):
    model = gm.from_function(
        lambda s: [np.clip(s[0], -1, 1), s[1]], [x, 2.0], 1.0, ["a", "b"], scale=scale
    )
    answer = gm.analyze(model)
    assert (answer.status, answer.null_combinations) == ("unobservable", ("a +1",))
    assert answer.crlb_std[1] == pytest.approx(1.0)


def test_a_root_at_zero_has_no_slope():
    """Its differences grow without limit as the step falls."""
    model = gm.from_function(
        lambda s: [np.sign(s[0]) * np.sqrt(abs(s[0])), s[1]], [0.0, 1.0], 1.0, ["a", "b"]
    )
    answer = gm.analyze(model)
    assert answer.status == "undecided"
    assert answer.crlb_std[1] == pytest.approx(1.0)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 100.0])
@pytest.mark.parametrize("slope", [0.0, 1.0])
@pytest.mark.parametrize("power", [1.5, 2.0, 2.5])
def test_a_law_whose_error_falls_slowly_with_the_step(power, slope, scale):
    """Drag at a standstill: v |v| has a slope of 0, which no difference shows."""
    model = gm.from_function(
        lambda x: [slope * x[0] + np.sign(x[0]) * np.abs(x[0]) ** power, x[1]],
        [0.0, 1.0],
        0.05,
        ["v", "b"],
        scale=[scale, scale],
    )
    error = model.accuracy.error[0, 0]
    assert abs(0.05 * model.rows()[0, 0] - slope) <= 3 * error
    if slope == 0.0:
        assert gm.analyze(model).status != "observable"


@pytest.mark.parametrize("x", [[293.15, 291.0, 350.0], [12.5, 0.1, -3.7]])
def test_linear_rows_with_few_decimals_are_not_rounded_ones(x):
    """Differences of states, which stand still where two states move alike."""
    weights = [0.4, 1.3, 0.2]
    model = gm.from_function(
        lambda p: [w * (p[i] - p[(i + 1) % 3]) for i, w in enumerate(weights)],
        x,
        0.05,
        ["T1", "T2", "T3"],
    )
    assert (model.accuracy.noise < 1e-9).all()
    assert gm.analyze(model).status == "unobservable"


@pytest.mark.parametrize(
    "h",
    [
        lambda x: [x[0] ** 3],
        lambda x: [x[0] * abs(x[0])],
        lambda x: [x[0] ** 5],
        lambda x: [x[0] ** 3 * np.cos(x[0])],
    ],
)
def test_slopes_that_go_to_zero_are_zero(h):
    """Straight at no step, but not noise: the error of x^3 at 0 was said to be 2e18."""
    for scale in (None, [1.0]):
        model = gm.from_function(h, [0.0], 1.0, ["x"], scale=scale)
        assert abs(model.jacobian()[0, 0]) <= model.accuracy.error[0, 0] < 1e-9
        assert gm.analyze(model).status == "unobservable"


def test_a_corner_at_zero_is_a_kink_and_no_jump():
    for h in (lambda x: [max(x[0], 0.0)], lambda x: [abs(x[0])], lambda x: [min(x[0], 3 * x[0])]):
        with pytest.raises(gm.InputError, match=r"h\(x\)\[0\] has a kink where x = 0"):
            gm.from_function(h, [0.0], 1.0, ["x"])


@pytest.mark.parametrize(
    ("h", "x"),
    [
        (lambda x: [np.tanh(x[0])], 20.0),
        (lambda x: [1 / (1 + np.exp(-x[0]))], 40.0),
        (lambda x: [np.interp(x[0], [0.0, 1.0, 2.0], [0.0, 3.0, 5.0])], 30.0),
    ],
)
def test_a_saturated_output_alone_has_no_nan(h, x):
    model = gm.from_function(h, [x], 1.0, ["x"])
    assert abs(model.jacobian()[0, 0]) < 1e-15
    assert gm.analyze(model).status in {"unobservable", "undecided"}


def test_the_mean_of_two_slopes_is_not_nothing():
    """At the edge of a clip the slope is 1 or 0: it was said to be unobservable."""
    model = gm.from_function(lambda x: [np.clip(x[0], -1, 1), x[1]], [1.0, 1.0], 1.0, ["a", "b"])
    assert gm.analyze(model).status == "undecided"


@pytest.mark.parametrize(
    "clocks",
    [[30.0, 100.0], [3e4, -5e3], [0.0, 0.0], [100.0, 0.0], [1e-3, 0.0], [0.0, 1e5]],
)
def test_a_second_bias_beside_the_clock_is_unobservable_without_a_scale(clocks):
    satellites = np.array(
        [
            [15e6, 1e6, 2.1e7],
            [-9e6, 1.2e7, 1.9e7],
            [2e6, -1.5e7, 2e7],
            [-1.2e7, -9e6, 2.0e7],
            [1e6, 2e6, 2.6e7],
        ]
    )

    def ranges(x):
        return np.linalg.norm(satellites - x[:3], axis=1) + x[3] + x[4]

    names = ["x", "y", "z", "clock", "bias"]
    answer = gm.analyze(gm.from_function(ranges, [1e3, 2e3, 6.37e6, *clocks], 3.0, names))
    assert answer.status == "unobservable"
    assert answer.null_combinations == ("clock +1, bias -1",)


@pytest.mark.parametrize("decimals", [2, 3])
def test_ranges_of_two_or_three_decimals_are_decided(decimals):
    def ranges(p):
        off = p - np.array([[0.0, 0.0], [1e5, 1e5], [2e5, 0.0]])
        return np.hypot(*off.T)

    x = [1.2e5, 5e4]
    rounded = gm.from_function(lambda p: np.round(ranges(p), decimals), x, 1.0, ["e", "n"])
    exact = gm.from_function(ranges, x, 1.0, ["e", "n"]).jacobian()
    assert gm.analyze(rounded).status == "observable"
    off = np.abs(rounded.jacobian() - exact)
    assert (off <= rounded.accuracy.error).all()
    assert off.max() < 1e-4


def test_one_deviation_of_zero_is_as_many():
    def h(x):
        return [x[0], x[0] + x[1]]

    one, each = (gm.from_function(h, [1.0, 2.0], sigma, ["a", "b"]) for sigma in (0.0, [0.0, 0.0]))
    assert np.array_equal(gm.analyze(one).crlb_std, gm.analyze(each).crlb_std)
    assert gm.analyze(one).status == "observable"
    with pytest.raises(gm.InputError, match=r"sigma = inf: must be > 0 \(0: exact\) and finite"):
        gm.from_function(h, [1.0, 2.0], np.inf, ["a", "b"])
