"""Trajectories and their transitions: exact solutions, differences, constraints, bad input."""

import itertools

import numpy as np
import pytest
import scipy.linalg

import gramian as gm


def pendulum(t, x):
    return np.array([x[1], -np.sin(x[0]) - 0.1 * x[1]])


def pendulum_jacobian(t, x):
    return [[0, 1], [-np.cos(x[0]), -0.1]]


def angle(t, x):
    return x[:1]


TIMES = np.array([0.0, 0.3, 1.0, 1.1, 2.5])


def test_linear_systems_are_those_of_the_exponential():
    rng = np.random.default_rng(1)
    a, c = rng.normal(size=(4, 4)), rng.normal(size=(2, 4))
    x0 = rng.normal(size=4)
    found = gm.dynamics.from_ode(lambda t, x: a @ x, lambda t, x: c @ x, x0, TIMES, sigma=0.5)
    for k, (before, after) in enumerate(itertools.pairwise(TIMES)):
        expected = scipy.linalg.expm(a * (after - before))
        assert np.abs(found.transitions[k] - expected).max() < 1e-9 * np.abs(expected).max()
    rows = np.concatenate([2 * c @ scipy.linalg.expm(a * t) for t in TIMES])
    assert np.abs(found.rows() - rows).max() < 1e-8 * np.abs(rows).max()
    later = np.concatenate([2 * c @ scipy.linalg.expm(a * (t - 1.0)) for t in TIMES[2:]])
    assert np.abs(found.rows(about=1.0) - later).max() < 1e-8 * np.abs(later).max()


@pytest.mark.parametrize("jacobian", ["auto", "complex", "differences", "given"])
def test_transitions_are_the_derivative_of_the_trajectory(jacobian):
    given = (pendulum_jacobian, lambda t, x: [[1, 0]]) if jacobian == "given" else jacobian

    def follow(x0):
        return gm.dynamics.from_ode(pendulum, angle, x0, TIMES, rtol=1e-12, jacobian=given)

    found = follow([1.0, 0.5])
    step = 1e-5
    for i, move in enumerate(step * np.eye(2)):
        ends = [follow(np.array([1.0, 0.5]) + s * move).states for s in (1, -1)]
        expected = (ends[0] - ends[1]) / (2 * step)
        phi = np.eye(2)
        for k, transition in enumerate(found.transitions):
            phi = transition @ phi
            assert np.abs(phi[:, i] - expected[k + 1]).max() < 1e-8


def test_code_that_is_not_analytic_is_found_out():
    def h(t, x):
        return [abs(x[0]) * x[1]]

    found = gm.dynamics.from_ode(lambda t, x: 0 * x, h, [-2.0, 3.0], [0.0, 1.0])
    assert np.abs(found.jacobians[0] - [[-3.0, 2.0]]).max() < 1e-9


def test_many_states_at_once_give_the_same():
    def many(t, x):
        return np.stack([x[1], -np.sin(x[0]) - 0.1 * x[1]])

    one = gm.dynamics.from_ode(pendulum, angle, [1.0, 0.5], TIMES)
    other = gm.dynamics.from_ode(many, lambda t, x: x[:1], [1.0, 0.5], TIMES, vectorized=True)
    # Steps may be shorter in one: both keep to 1e-9.
    assert np.allclose(one.transitions, other.transitions, rtol=1e-10, atol=1e-12)
    assert np.allclose(one.states, other.states, rtol=1e-10, atol=1e-12)


def lorenz(t, x):
    return np.array([10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]])


def van_der_pol(t, x):
    return np.array([x[1], 50 * (1 - x[0] ** 2) * x[1] - x[0]])


def kicked(t, x):
    # Jumps at samples.
    push = np.where((t > 0.3) & (t < 1.0), 40.0, 0.0)
    return np.array([x[1], -np.sin(x[0]) + push])


@pytest.mark.parametrize(
    ("f", "x0", "times"),
    [
        (lorenz, [1.0, 2.0, 20.0], np.linspace(0, 6, 400)),
        (van_der_pol, [2.0, 0.0], np.linspace(0, 60, 300)),
        (kicked, [0.1, 0.0], np.linspace(0, 2, 21)),
    ],
)
def test_many_intervals_at_once_are_those_one_by_one(f, x0, times):
    one = gm.dynamics.from_ode(f, angle, x0, times)
    other = gm.dynamics.from_ode(f, angle, x0, times, vectorized=True)
    size = np.abs(one.transitions).max(axis=(1, 2))[:, None, None]
    # Both follow to 1e-9 from one sample to the next, and errors grow along the way.
    assert np.abs((one.states - other.states) / np.abs(one.states).max(axis=0)).max() < 1e-5
    assert np.abs((one.transitions - other.transitions) / size).max() < 1e-5


def test_functions_may_refuse_what_only_a_guess_would_ask():
    def f(t, x):
        if (x < 0).any():
            raise ValueError("a tank has no negative level")
        return -np.sqrt(x) + 0.2

    times = np.linspace(0, 8, 60)

    def by(x):
        return -0.5 / np.sqrt(x).reshape(1, 1, *x.shape[1:])

    def ones(x):
        return np.ones((1, 1, *x.shape[1:]))

    one, other = (
        gm.dynamics.from_ode(
            f, angle, [4.0], times, vectorized=many,
            jacobian=(lambda t, x: by(x), lambda t, x: ones(x)),
        )
        for many in (False, True)
    )  # fmt: skip
    assert np.allclose(one.states, other.states, rtol=1e-9)


def test_an_interrupt_in_a_function_is_not_taken_for_a_guess_that_failed():
    calls = 0

    def f(t, x):
        nonlocal calls
        calls += 1
        if calls > 5:
            raise KeyboardInterrupt
        return -x

    with pytest.raises(KeyboardInterrupt):
        gm.dynamics.from_ode(f, angle, [4.0], np.linspace(0, 8, 60), vectorized=True)
    assert calls == 6


def test_a_map_is_followed_step_by_step():
    def logistic(t, x):
        return np.array([x[1] * x[0] * (1 - x[0]), x[1]])

    found = gm.dynamics.from_map(logistic, angle, [0.3, 3.1], np.arange(5.0), ["x", "r"])
    x = 0.3
    for k in range(4):
        assert np.allclose(found.transitions[k], [[3.1 * (1 - 2 * x), x * (1 - x)], [0, 1]])
        x = 3.1 * x * (1 - x)
    assert gm.analyze(found.problem()).rank == 2


def test_windows_are_the_analysis_of_their_rows():
    found = gm.dynamics.from_ode(
        pendulum, angle, [1.0, 0.5], np.linspace(0, 3, 13), ["angle", "rate"], sigma=0.01
    )
    windows = found.windows(1.0)
    assert windows.samples == 5
    for k in (0, 4, 8):
        rows = found.rows(found.times[k], found.times[k + 4])
        assert np.allclose(windows.std[k], gm.crlb_std(rows), rtol=1e-9)
    assert windows.to_pandas().shape == (9, 4)
    assert "all determined" in windows.summary()
    assert windows.plot() is not None


def test_a_maneuver_shows_the_range():
    """A bearing alone does not tell the range to a beacon until the vehicle turns."""

    def drive(t, x):
        return np.array([x[2], x[3], 0 * x[0], 0.5 * (t > 4) + 0 * x[0]])

    def bearing(t, x):
        return [np.arctan(x[0] / x[1])]

    names = ["x", "y", "vx", "vy"]
    times = np.arange(0, 10.5, 0.5)
    found = gm.dynamics.from_ode(drive, bearing, [3.0, 40.0, 2.0, 0.5], times, names, sigma=1e-3)
    windows = found.windows(3.0)
    assert windows.rank[0] == 3
    assert windows.null_combinations[0] == ("x +1, y +13.33, vx +0.6667, vy +0.1667",)
    assert windows.rank[-1] == 4
    assert np.isinf(windows.std[0]).all()
    assert np.isfinite(windows.std[-1]).all()


def test_a_unit_quaternion_is_told_apart_from_what_is_not_measured():
    rates = np.array([0.3, -0.2, 0.1])

    def turn(t, q):
        w, v = q[0], q[1:]
        return 0.5 * np.array([-(rates @ v), *(w * rates + np.cross(v, rates))])

    def north(t, q):
        w, x, y, z = q
        return np.array([w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)])

    times = np.linspace(0, 1, 5)
    still = gm.dynamics.from_ode(
        lambda t, q: 0 * q,
        north,
        [1.0, 0, 0, 0],
        times,
        ["w", "x", "y", "z"],
        tangent=gm.dynamics.unit_norm(range(4)),
    ).windows(1.0)
    # One direction seen: the turn about it is not, and the length of q is no question.
    assert (still.free, still.rank[0]) == (3, 2)
    assert still.null_combinations[0] == ("x +1",)
    assert still.std[0, 0] == 0
    q = np.array([0.5, 0.5, -0.5, 0.5])
    path = gm.dynamics.from_ode(turn, north, q, times)
    assert np.allclose(np.linalg.norm(path.states, axis=1), 1, atol=1e-9)


def test_the_empirical_gramian_becomes_the_information():
    rows = gm.dynamics.from_ode(pendulum, angle, [1.0, 0.5], TIMES, sigma=0.1).rows()
    errors = []
    for step in (0.1, 0.01):
        found = gm.dynamics.empirical_gramian(
            pendulum, angle, [1.0, 0.5], TIMES, step=step, sigma=0.1, rtol=1e-12
        )
        errors.append(np.abs(found - rows.T @ rows).max())
    assert errors[1] < 0.02 * errors[0]


def test_the_posterior_bound_along_a_trajectory_is_that_of_its_transitions():
    found = gm.dynamics.from_ode(pendulum, angle, [1.0, 0.5], TIMES, ["angle", "rate"], sigma=0.1)
    bound = found.posterior(np.zeros((2, 2)), {"rate": 1.0})
    phi = np.eye(2)
    information = np.diag([0.0, 1.0])
    for k in range(len(TIMES)):
        if k:
            phi = found.transitions[k - 1] @ phi
        row = 10 * found.jacobians[k] @ phi
        information = information + row.T @ row
    expected = phi @ np.linalg.inv(information) @ phi.T
    assert np.allclose(bound.std[-1], np.sqrt(np.diag(expected)), rtol=1e-9)


BAD = [
    ({"x0": [[1.0]]}, "x0 has shape"),
    ({"x0": [np.nan, 0.0]}, r"x0\[0\] = nan"),
    ({"times": [0.0]}, "times has shape"),
    ({"times": [0.0, 1.0, 1.0]}, r"times\[2\] = 1.0: must be later"),
    ({"names": ["a"]}, "names has 1 entries"),
    ({"names": ["a", "a"]}, "names has 2 entries"),
    ({"units": ["m"]}, "units has 1 entries"),
    ({"sigma": 0.0}, r"sigma\[0\] = 0.0: must be > 0"),
    ({"scale": [1.0, -1.0]}, r"scale\[1\] = -1.0"),
    ({"rtol": 0.0}, "rtol = 0.0"),
    ({"jacobian": "guess"}, "jacobian = 'guess'"),
    ({"vectorized": "yes"}, "vectorized = 'yes': must be True or False"),
    ({"f": lambda t, x: x[:1]}, "f returned shape"),
    ({"f": lambda t, x: x**2, "x0": [1.0, 1.0]}, "cannot be followed beyond t = 0.3"),
    ({"tangent": lambda x: np.eye(3)}, "tangent returned shape"),
    ({"jacobian": (lambda t, x: np.eye(3), "auto")}, "Jacobian of f returned shape"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_bad_input_is_named(change, message):
    options = {"f": pendulum, "h": angle, "x0": [1.0, 0.5], "times": TIMES} | change
    call = [options.pop(key) for key in ("f", "h", "x0", "times")]
    with pytest.raises(gm.InputError, match=message):
        gm.dynamics.from_ode(*call, **options)


def test_bad_windows_are_named():
    found = gm.dynamics.from_ode(pendulum, angle, [1.0, 0.5], TIMES)
    with pytest.raises(gm.InputError, match="width = 9"):
        found.windows(9.0)
    with pytest.raises(gm.InputError, match=r"about = 0\.5: must be one of the times"):
        found.rows(about=0.5)
    with pytest.raises(gm.InputError, match="no state is named 'z'"):
        found.posterior(np.zeros((2, 2)), {"z": 1.0})


def test_a_span_without_end_ends_with_the_steps_that_were_allowed():
    def swing(t, x):
        return np.array([x[1], -np.sin(x[0])])

    def angle(t, x):
        return x[:1]

    times = np.concatenate([np.linspace(0, 10, 5), [1e3, 3e9]])
    with pytest.raises(
        gm.InputError, match=r"max_steps = 2000: .* no farther than t = 10 of 3000000000"
    ):
        gm.dynamics.from_ode(swing, angle, [0.5, 0.0], times, max_steps=2000)
    with pytest.raises(gm.InputError, match="max_steps = 3000"):
        gm.dynamics.empirical_gramian(swing, angle, [0.5, 0.0], times, step=0.1, max_steps=3000)
    with pytest.raises(gm.InputError, match="max_steps = 0"):
        gm.dynamics.from_ode(swing, angle, [0.5, 0.0], [0, 1], max_steps=0)
    # What converges in that many is as it was.
    few = gm.dynamics.from_ode(swing, angle, [0.5, 0.0], times[:5], max_steps=2000)
    assert few == gm.dynamics.from_ode(swing, angle, [0.5, 0.0], times[:5])


SPAN = np.linspace(0, 10, 41)


def kepler(t, x):
    cube = (x[0] ** 2 + x[1] ** 2) ** 1.5
    return [x[2], x[3], -x[0] / cube, -x[1] / cube]


def invariants(t, x):
    energy = (x[2] ** 2 + x[3] ** 2) / 2 - 1 / (x[0] ** 2 + x[1] ** 2) ** 0.5
    return [energy, x[0] * x[3] - x[1] * x[2]]


INVARIANTS = {
    "pendulum": (
        lambda t, x: [x[1], -9 * np.sin(x[0])],
        lambda t, x: [x[1] ** 2 / 2 - 9 * np.cos(x[0])],
        [1.0, 0.5],
        1,
    ),
    "predator and prey": (
        lambda t, x: [x[0] * (1 - x[1]), x[1] * (x[0] - 1)],
        lambda t, x: [x[0] - np.log(x[0]) + x[1] - np.log(x[1])],
        [1.5, 0.5],
        1,
    ),
    "orbit": (kepler, invariants, [1.0, 0.0, 0.0, 1.2], 2),
}


@pytest.mark.parametrize("name", INVARIANTS)
def test_what_is_conserved_tells_no_more_as_time_goes_by(name):
    """The error of the integrator alone made all states observable, to 1e9."""
    f, h, x0, rank = INVARIANTS[name]
    path = gm.dynamics.from_ode(f, h, x0, SPAN)
    answer = gm.analyze(path.problem())
    assert answer.rank == rank
    assert answer.status in {"unobservable", "undecided"}
    assert set(path.windows(3.0).rank.tolist()) == {rank}


def test_stated_errors_of_rows_cover_the_true_ones():
    for f, h, x0, _ in INVARIANTS.values():
        rows, errors = gm.dynamics.from_ode(f, h, x0, SPAN, rtol=1e-7).rows_and_errors()
        exact = gm.dynamics.from_ode(f, h, x0, SPAN, rtol=1e-13).rows()
        assert (np.abs(rows - exact) <= errors + 1e-11).all()


def test_samples_at_half_the_period_hide_the_speed():
    def oscillator(t, x):
        return [x[1], -4 * np.pi**2 * x[0]]

    path = gm.dynamics.from_ode(oscillator, lambda t, x: [x[0]], [1.0, 1.0], np.arange(0, 5, 0.5))
    assert gm.analyze(path.problem()).null_combinations == ("x1 +1",)
    quarter = gm.dynamics.from_map(
        lambda t, x: [6e-17 * x[0] + x[1], -x[0] + 6e-17 * x[1]],
        lambda t, x: [x[0]],
        [1.0, 1.0],
        np.arange(0, 9),
    )
    assert gm.analyze(quarter.problem()).status == "observable"


def test_the_problem_knows_what_the_tangent_leaves_out():
    """The length of a quaternion is no combination that is not measured."""

    def spin(t, q):
        w = [0.1, 0.2 * np.cos(t), -0.3]
        return [
            -(w[0] * q[1] + w[1] * q[2] + w[2] * q[3]) / 2,
            (w[0] * q[0] + w[2] * q[2] - w[1] * q[3]) / 2,
            (w[1] * q[0] - w[2] * q[1] + w[0] * q[3]) / 2,
            (w[2] * q[0] + w[1] * q[1] - w[0] * q[2]) / 2,
        ]

    def down(t, q):
        size = q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2
        return [
            2 * (q[1] * q[3] - q[0] * q[2]) / size,
            2 * (q[2] * q[3] + q[0] * q[1]) / size,
            (q[0] ** 2 - q[1] ** 2 - q[2] ** 2 + q[3] ** 2) / size,
        ]

    start = np.array([1, 0.2, -0.1, 0.3]) / np.linalg.norm([1, 0.2, -0.1, 0.3])
    tangent = gm.dynamics.unit_norm([0, 1, 2, 3])
    path = gm.dynamics.from_ode(spin, down, start, SPAN, ["w", "x", "y", "z"], tangent=tangent)
    answer = gm.analyze(path.problem())
    # The heading alone is not told: a turn about the vertical.
    assert answer.nullity == 1
    assert path.windows(3.0).free - path.windows(3.0).rank[0] == 1
    assert abs(start @ answer.null_space[:, 0]) < 1e-9
    free = gm.dynamics.from_ode(spin, down, start, SPAN, ["w", "x", "y", "z"])
    assert gm.analyze(free.problem()).nullity == 2


def test_detail_far_from_zero_is_not_stepped_over():
    """A step made from the size of x, 5 km, gave -0.001 for -0.447."""

    def range_(t, x):
        return [np.hypot(x[0] - 5.3e6, 10.0)]

    path = gm.dynamics.from_ode(
        lambda t, x: [x[1], 0 * x[0]], range_, [5.3e6 + 5, -1.0], np.arange(0, 3, 0.25)
    )
    off = path.states[:, 0] - 5.3e6
    assert np.abs(path.jacobians[:, 0, 0] - off / np.hypot(off, 10.0)).max() < 1e-4
    with pytest.raises(
        gm.InputError, match=r"h\[0\] at t = 0 .* bends within the step: give scale"
    ):
        gm.dynamics.from_ode(
            lambda t, x: [x[1], 0 * x[0]],
            range_,
            [5.3e6 + 5, -1.0],
            np.arange(0, 3, 0.25),
            scale=[5.3e6, 1.0],
        )


def test_an_angle_that_wraps_is_an_error():
    def heading(t, x):
        return [np.arctan2(np.sin(x[0]), np.cos(x[0]))]

    with pytest.raises(gm.InputError, match=r"h\[0\] jumps .* sine and cosine"):
        gm.dynamics.from_ode(lambda t, x: [0 * x[0]], heading, [np.pi], [0.0, 1.0, 2.0])
