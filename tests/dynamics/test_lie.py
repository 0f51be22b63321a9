"""Lie derivatives by jets: against the series of known solutions, symbols and ranks."""

import numpy as np
import pytest

import gramian as gm
from gramian.models.dynamics._jets import Jet


def pendulum(t, x):
    return np.array([x[1], -np.sin(x[0])])


def test_derivatives_of_a_pendulum_are_those_by_hand():
    a, w = 0.5, 0.2
    found = gm.dynamics.lie_derivatives(pendulum, lambda t, x: x[:1], [a, w], order=4)
    by_hand = [a, w, -np.sin(a), -w * np.cos(a), np.sin(a) * w**2 + np.sin(a) * np.cos(a)]
    np.testing.assert_allclose(found.values[:, 0], by_hand, rtol=1e-14)
    gradients = [[1, 0], [0, 1], [-np.cos(a), 0], [w * np.sin(a), -np.cos(a)],
                 [np.cos(a) * w**2 + np.cos(2 * a), 2 * w * np.sin(a)]]  # fmt: skip
    np.testing.assert_allclose(found.gradients[:, 0], gradients, rtol=1e-13, atol=1e-15)
    assert found.ranks == (1, 2, 2, 2, 2)
    assert found.observable


@pytest.mark.parametrize(
    "name",
    [
        "sin",
        "cos",
        "tan",
        "exp",
        "expm1",
        "log",
        "log1p",
        "sqrt",
        "square",
        "reciprocal",
        "sinh",
        "cosh",
        "tanh",
        "arcsin",
        "arccos",
        "arctan",
        "absolute",
    ],
)
def test_each_function_has_the_series_of_its_derivatives(name):
    function = getattr(np, name)
    # g(c + s t) with the derivatives of g from a contour (Cauchy), a and a step beside it.
    c, s = 0.4, 0.3
    angle = np.exp(2j * np.pi * np.arange(64) / 64)
    radius = 0.2
    circle = c + radius * angle
    samples = circle if name == "absolute" else function(circle)
    coefficients = (np.fft.fft(samples) / 64)[:6] / radius ** np.arange(6)
    series = np.zeros((6, 1), dtype=complex)
    series[:2, 0] = c + 1e-30j, s
    jet = function(Jet(series))
    np.testing.assert_allclose(
        jet.series[:, 0].real, coefficients.real * s ** np.arange(6), rtol=1e-9, atol=1e-12
    )
    # The derivative by c of the k-th coefficient is (k + 1) g_{k+1} s^k.
    slope = jet.series[:, 0].imag[:5] / 1e-30
    order = np.arange(5)
    np.testing.assert_allclose(
        slope, (order + 1) * coefficients.real[1:] * s**order, rtol=1e-9, atol=1e-12
    )


def test_arithmetic_of_arrays_powers_and_angles():
    rng = np.random.default_rng(3)
    m = rng.normal(size=(3, 3))

    def f(t, x):
        return m @ x + np.cos(t) * np.ones(3) / 3

    def h(t, x):
        return [
            np.arctan2(x[0], x[1]),
            x[2] ** 2.5 + 2.0 ** x[0],
            np.hypot(x[0], x[1]) / (1 + x[2]) ** -2,
        ]

    x0 = np.array([0.3, -0.4, 1.2])
    found = gm.dynamics.lie_derivatives(f, h, x0, order=3, time=0.7)
    path = lambda x, dt: x + 0 * dt  # noqa: E731

    def y(x, dt):
        from scipy.integrate import solve_ivp

        end = (
            solve_ivp(
                lambda t, x: m @ x + np.cos(t) / 3, (0.7, 0.7 + dt), x, rtol=1e-12, atol=1e-13
            ).y[:, -1]
            if dt
            else path(x, dt)
        )
        return np.array(h(0.7 + dt, end), dtype=float)

    np.testing.assert_allclose(found.values[0], y(x0, 0.0), rtol=1e-13)
    step = 1e-4
    rate = (y(x0, step) - y(x0, -step)) / (2 * step)
    np.testing.assert_allclose(found.values[1], rate, rtol=1e-6)
    for i in range(3):
        e = np.eye(3)[i] * 1e-5
        np.testing.assert_allclose(
            found.gradients[0][:, i], (y(x0 + e, 0.0) - y(x0 - e, 0.0)) / 2e-5, rtol=1e-8, atol=1e-9
        )
    # A Taylor polynomial of the output.
    series = found.values / np.array([1, 1, 2, 6])[:, None]
    dt = 0.002
    np.testing.assert_allclose(sum(series[k] * dt**k for k in range(4)), y(x0, dt), rtol=1e-7)


def test_ranks_and_what_is_not_seen():
    def drive(t, x):
        return [x[2], x[3], 0 * x[0], 0 * x[0]]

    names = ["x", "y", "vx", "vy"]
    bearing = gm.dynamics.lie_derivatives(
        drive, lambda t, x: [np.arctan2(x[0], x[1])], [3.0, 4, 1, 0], names, order=6
    )
    assert bearing.ranks[-1] == bearing.generic_ranks[-1] == 3
    # What a bearing never shows: all scaled alike.
    direction = bearing.null_space[:, 0]
    np.testing.assert_allclose(direction / direction[0] * 3, [3, 4, 1, 0], atol=1e-9)
    ranged = gm.dynamics.lie_derivatives(
        drive, lambda t, x: [np.hypot(x[0], x[1])], [3.0, 4, 1, 0], names, order=6
    )
    assert "RANK SHORT: rank 3 of 4" in ranged.summary()
    # Standing still, the speed of a camera gives no height; a little faster it does.
    still = gm.dynamics.lie_derivatives(
        lambda t, x: [0 * x[0] + 0.3, 0 * x[0]],
        lambda t, x: [x[0] ** 2 / x[1]],
        [0.0, 2.0],
        order=1,
    )
    assert still.ranks[-1] < still.generic_ranks[-1] == 2
    assert "at almost all points near by" in still.summary()


def test_linear_systems_have_the_ranks_of_their_observability_matrix():
    rng = np.random.default_rng(8)
    for n, hidden in ((4, 0), (5, 2), (6, 1)):
        a = rng.normal(size=(n, n))
        a[: n - hidden, n - hidden :] = 0
        c = np.r_[rng.normal(size=n - hidden), np.zeros(hidden)][None]
        t = np.linalg.qr(rng.normal(size=(n, n)))[0]
        a, c = t @ a @ t.T, c @ t.T
        found = gm.dynamics.lie_derivatives(
            lambda t, x, a=a: a @ x, lambda t, x, c=c: c @ x, rng.normal(size=n)
        )
        matrix = gm.linear.observability_matrix(a, c)
        np.testing.assert_allclose(found.gradients.reshape(-1, n), matrix, rtol=1e-9, atol=1e-9)
        assert n - found.ranks[-1] == hidden == gm.linear.unobservable(a, c).nullity


@pytest.mark.parametrize(
    ("f", "h", "x0", "said"),
    [
        (lambda t, x: [x[0] if x[0] > 0 else 0], lambda t, x: x, [1.0], "f takes no power series.*comparisons"),
        (lambda t, x: [float(x[0])], lambda t, x: x, [1.0], "f takes no power series"),
        (lambda t, x: [np.floor(x[0])], lambda t, x: x, [1.0], "numpy.floor has no power series"),
        (lambda t, x: [x[0], x[0]], lambda t, x: x, [1.0], "f returned 2 numbers: must be 1"),
        (lambda t, x: [np.log(x[0])], lambda t, x: x, [0.0], "what f returned.* -inf"),
        (lambda t, x: x, lambda t, x: [np.nan], [1.0], "what h returned"),
        (lambda t, x: x, lambda t, x: x, [np.nan], "x0"),
        (3, lambda t, x: x, [1.0], "f = 3"),
    ],
)  # fmt: skip
def test_what_has_no_derivatives_is_named(f, h, x0, said):
    with pytest.raises(gm.InputError, match=said):
        gm.dynamics.lie_derivatives(f, h, x0, order=2)
    with pytest.raises(gm.InputError, match="order = -1"):
        gm.dynamics.lie_derivatives(pendulum, lambda t, x: x, [0.1, 0.2], order=-1)
