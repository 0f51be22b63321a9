"""Functions as people write them, for one state: asked about many at once where they take it."""

import math
import random
import re

import numpy as np
import pytest

import gramian as gm

X0 = [0.8, -0.3, 1.2]
TIMES = np.linspace(0.0, 2.0, 41)
A = np.array([[-0.2, 1.0, 0.3], [-1.0, -0.1, 0.2], [0.1, -0.4, -0.3]])
BUFFER = np.zeros(3)


def plain(t, x):
    return np.array([x[1], -np.sin(x[0]), 0.1 * x[0] * x[2]])


def listed(t, x):
    return [x[1], -np.sin(x[0]), 0 * x[2]]


def constant(t, x):
    return [x[1], -np.sin(x[0]), 0.0]


def constant_array(t, x):
    return np.array([x[1], -np.sin(x[0]), 0.0])


def all_constant(t, x):
    return [1.0, 0, -0.5]


def product(t, x):
    return A @ x


def dotted(t, x):
    return np.dot(A, x)


def as_float(t, x):
    a, b, c = float(x[0]), float(x[1]), float(x[2])
    return [b, -a, 0.1 * c]


def branch(t, x):
    return [x[1], -x[0] if x[0] > 0.5 else -0.5 * x[0], x[2]]


def branch_on_time(t, x):
    return [x[1], -x[0] if t < 1.0 else -2 * x[0], x[2]]


def by_math(t, x):
    return [x[1], -math.sin(x[0]), math.cos(t) * x[2]]


def by_norm(t, x):
    return A @ x / np.linalg.norm(x)


def by_max(t, x):
    return -x / (1 + np.max(np.abs(x)))


def by_sum(t, x):
    return -x + 0.1 * x.sum()


def by_mean(t, x):
    return [x[1], -x[0], -0.2 * np.mean(x)]


def clipped(t, x):
    return np.clip(A @ x, -0.9, 0.9)


def chosen(t, x):
    return [x[1], np.where(x[0] > 0, -x[0], -2 * x[0]), -0.2 * x[2]]


def inner(t, x):
    return -x * (0.1 + np.dot(x, x))


def crossed(t, x):
    return np.cross([0.3, -0.2, 0.5], x)


def inverted(t, x):
    return np.linalg.inv(np.array([[2, x[0], 0], [0, 2, x[1]], [0, 0, 2 + x[2] ** 2]])) @ -x


def concatenated(t, x):
    return np.concatenate([x[1:], -x[:1]])


def stacked(t, x):
    return np.hstack([x[1], -x[0], 0.1 * x[2]])


def filled(t, x):
    out = np.zeros(3)
    out[0], out[1], out[2] = x[1], -x[0], 0.1 * x[2]
    return out


def filled_alike(t, x):
    out = np.zeros_like(x)
    out[0], out[1], out[2] = x[1], -x[0], 0.1 * x[2]
    return out


def kept(t, x):
    BUFFER[0], BUFFER[1], BUFFER[2] = x[1], -x[0], 0.1 * x[2]
    return BUFFER


def changed(t, x):
    """Changes what it was given."""
    x[0] *= -1
    x[2] *= 0.1
    return [x[1], x[0], x[2]]


def any_of_them(t, x):
    return np.array([x[1], -x[0], x[2] * (0.2 if (x[0] > 0.6).any() else -0.2)])


def all_of_them(t, x):
    """Reaches a threshold along the way, beyond what is tried at the beginning."""
    beyond = (x[0] - 4.0) ** 8 if (x[0] > 4.0).all() else 0 * x[0]
    return np.array([0 * x[0] + 3.0, -x[1], beyond - x[2]])


def all_of_a_map(t, x):
    return np.array([x[0] + 0.2, -x[1], x[2] * (0.2 if (x[0] > 4.0).all() else -0.2)])


def looped(t, x):
    return np.array([sum(A[i, j] * x[j] for j in range(3)) for i in range(3)])


def at_samples(t, x):
    pushes = np.sin(np.arange(500))
    return [x[1], -x[0] + pushes[int(t / 0.05)], -x[2]]


def single_precision(t, x):
    return np.asarray(A, dtype=np.float32).astype(float) @ x


def seen(t, x):
    return [x[0], x[1] * x[2]]


#: Of differential equations, whether many states are asked of them at once.
RATES = {
    plain: True,
    listed: True,
    constant: True,
    all_constant: True,
    product: True,
    dotted: True,
    concatenated: True,
    filled_alike: True,
    looped: True,
    changed: True,
    as_float: False,
    by_math: False,
    by_norm: False,
    by_sum: False,
    by_mean: False,
    inner: False,
    crossed: False,
    inverted: False,
    stacked: False,
    filled: False,
    kept: False,
    constant_array: False,
    # Seems to take many until its threshold is reached.
    all_of_them: False,
}
#: Likewise, of maps.
STEPS = {
    clipped: True,
    chosen: True,
    plain: True,
    branch: False,
    branch_on_time: False,
    by_max: False,
    any_of_them: False,
    at_samples: False,
    kept: False,
    all_of_a_map: False,
}


def same(one, other):
    for name in ("states", "outputs", "transitions", "jacobians"):
        a, b = getattr(one, name), getattr(other, name)
        assert np.abs(a - b).max() <= 1e-11 * np.abs(b).max(), name


@pytest.mark.parametrize("jacobian", ["auto", "differences"])
@pytest.mark.parametrize("f", RATES, ids=lambda f: f.__name__)
def test_rates_as_written_are_those_one_by_one(f, jacobian):
    one, found = (
        gm.dynamics.from_ode(f, seen, X0, TIMES, jacobian=jacobian, rtol=1e-12, vectorized=many)
        for many in (False, None)
    )
    assert one.vectorized == ()
    assert found.vectorized == (("f", "h") if RATES[f] else ("h",))
    same(found, one)


@pytest.mark.parametrize("f", STEPS, ids=lambda f: f.__name__)
def test_steps_as_written_are_those_one_by_one(f):
    one, found = (
        gm.dynamics.from_map(f, seen, X0, TIMES, scale=[1e-3] * 3, vectorized=many)
        for many in (False, None)
    )
    assert found.vectorized == (("f", "h") if STEPS[f] else ("h",))
    same(found, one)


def each(x):
    return x[0] * x[1]


@pytest.mark.parametrize(
    ("h", "many"),
    [
        (lambda t, x: x[0] * x[1], True),
        (lambda t, x: [x[0] * x[1]], True),
        (lambda t, x: (x[0], 1.0, each(x)), True),
        (lambda t, x: np.array([x[0], x[1]]), True),
        (lambda t, x: x[:2], True),
        (lambda t, x: [math.atan2(x[1], x[0])], False),
        (lambda t, x: [np.linalg.norm(x), x[1]], False),
        (lambda t, x: np.linalg.norm(x), False),
        (lambda t, x: x[0].item(), False),
        (lambda t, x: [float(f"{x[0]:.12f}"), x[1]], False),
        (lambda t, x: [x[0], x[1] if t > 0.7 else x[2]], False),
    ],
)
def test_outputs_as_written_are_those_one_by_one(h, many):
    one, found = (
        gm.dynamics.from_ode(plain, h, X0, TIMES, vectorized=vectorized)
        for vectorized in (False, None)
    )
    assert found.vectorized == (("f", "h") if many else ("f",))
    same(found, one)
    assert np.abs(found.jacobian_errors - one.jacobian_errors).max() < 1e-9


def pendulum(t, x):
    return [x[1], -np.sin(x[0])]


@pytest.mark.parametrize(
    ("jacobian", "many"),
    [
        (lambda t, x: [[0, 1], [-np.cos(x[0]), 0]], True),
        (lambda t, x: [[0 * x[0], 1 + 0 * x[0]], [-np.cos(x[0]), 0 * x[0]]], True),
        (lambda t, x: np.array([[0, 1], [-math.cos(x[0]), 0]]), False),
    ],
)
def test_jacobians_as_written_are_those_one_by_one(jacobian, many):
    by = (jacobian, lambda t, x: np.array([[1.0, 0.0]]))
    one, found = (
        gm.dynamics.from_ode(
            pendulum, lambda t, x: x[:1], [1.0, 0.5], TIMES, jacobian=by, vectorized=vectorized
        )
        for vectorized in (False, None)
    )
    names = ("f", "h", "the Jacobian of f", "the Jacobian of h")
    assert found.vectorized == tuple(name for name in names if many or name != names[2])
    # A transition may be of shorter steps in one.
    assert np.abs(found.transitions - one.transitions).max() < 1e-9
    assert np.abs(found.jacobians - one.jacobians).max() < 1e-9


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 6, 7, 11, 13, 30])
def test_no_number_of_states_hides_that_a_function_takes_one_only(size):
    """Of as many states as it has components, x * rates broadcasts along the wrong axis."""
    rates = -1.0 / (1.0 + np.arange(size))
    x0 = 1.0 + np.arange(size) % 3
    weights = np.cos(np.arange(size))

    def decay(t, x):
        return rates * x

    def total(t, x):
        return [weights @ x, x.sum()]

    found = gm.dynamics.from_ode(decay, total, x0, [0.0, 0.5, 1.0])
    one = gm.dynamics.from_ode(decay, total, x0, [0.0, 0.5, 1.0], vectorized=False)
    same(found, one)
    assert np.allclose(found.states[-1], x0 * np.exp(rates), rtol=1e-9)


def test_what_changes_from_call_to_call_is_not_asked_about_many():
    """A random force, by what was drawn before: of many states at once it would be one draw."""
    draws = random.Random(1)

    def f(t, x):
        return [x[1], -x[0] + draws.random()]

    with pytest.raises(gm.InputError, match=r"noise|cannot be followed|jumps"):
        gm.dynamics.from_ode(f, lambda t, x: x[:1], [1.0, 0.5], TIMES)
    calls = []

    def logged(t, x):
        calls.append(t)
        return [x[1], -x[0]]

    found = gm.dynamics.from_ode(logged, lambda t, x: x[:1], [1.0, 0.5], TIMES)
    assert found.vectorized == ("f", "h")
    assert len(calls) > 10


def test_states_that_a_function_refuses_do_not_tell_that_it_refuses_many():
    def draining(t, x):
        if (x < 0).any():
            raise ValueError("a tank has no negative level")
        return -0.1 * np.sqrt(x)

    found = gm.dynamics.from_ode(draining, lambda t, x: x, [4.0, 2.0], TIMES)
    assert found.vectorized == ("f", "h")
    assert np.allclose(found.states[-1], (np.sqrt([4.0, 2.0]) - 0.1) ** 2, rtol=1e-9)


def test_a_fault_is_told_as_of_one_state():
    def f(t, x):
        raise ValueError(f"no value at {np.shape(x)}")

    with pytest.raises(ValueError, match=re.escape("no value at (2,)")):
        gm.dynamics.from_ode(f, lambda t, x: x[:1], [1.0, 0.5], TIMES)
    with pytest.raises(gm.InputError, match=re.escape("f returned shape (3,): must be (2,)")):
        gm.dynamics.from_ode(lambda t, x: [0, 0, 0], lambda t, x: x[:1], [1.0, 0.5], TIMES)


def test_an_interrupt_ends_what_is_found_out():
    calls = 0

    def f(t, x):
        nonlocal calls
        calls += 1
        if calls > 8:
            raise KeyboardInterrupt
        return -x

    with pytest.raises(KeyboardInterrupt):
        gm.dynamics.from_ode(f, lambda t, x: x, [4.0], TIMES)
    assert calls == 9


def test_the_empirical_gramian_finds_it_out_too():
    options = {"step": 1e-3, "sigma": 0.1}
    found, one = (
        gm.dynamics.empirical_gramian(plain, seen, X0, TIMES, vectorized=many, **options)
        for many in (None, False)
    )
    assert np.allclose(found, one, rtol=1e-8)
