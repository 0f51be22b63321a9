"""Gramians over all time against SciPy, Hankel singular values against published ones."""

import numpy as np
import pytest
import scipy.linalg

import gramian as gm


def stable(seed, n, p):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n))
    return a - (np.linalg.eigvals(a).real.max() + 0.3) * np.eye(n), rng.normal(size=(p, n))


@pytest.mark.parametrize("n", [1, 4, 30])
def test_factors_are_those_of_the_lyapunov_equations(n):
    a, c = stable(n, n, 2)
    factor = gm.linear.gramian_factor(a, c)
    expected = scipy.linalg.solve_continuous_lyapunov(a.T, -c.T @ c)
    assert np.abs(factor.T @ factor - expected).max() < 1e-11 * np.abs(expected).max()
    phi = scipy.linalg.expm(0.2 * a)
    factor = gm.linear.gramian_factor(phi, c, time="discrete")
    expected = scipy.linalg.solve_discrete_lyapunov(phi.T, c.T @ c)
    assert np.abs(factor.T @ factor - expected).max() < 1e-11 * np.abs(expected).max()


def test_a_discount_makes_room_for_growth():
    a, c = stable(3, 4, 1)
    grows = a + 2.0 * np.eye(4)
    found = gm.linear.gramian_factor(grows, c, discount=4.0)
    assert np.allclose(found.T @ found, (f := gm.linear.gramian_factor(a, c)).T @ f, rtol=1e-10)
    with pytest.raises(gm.InputError, match="A is not stable"):
        gm.linear.gramian_factor(grows, c)
    with pytest.raises(gm.InputError, match="A is not stable"):
        gm.linear.gramian_factor([[0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0]])


def test_the_parts_of_an_unstable_system():
    rng = np.random.default_rng(5)
    t = rng.normal(size=(5, 5))
    a = t @ np.diag([-1.0, -2.0, -0.5, 1.0, 3.0]) @ np.linalg.inv(t)
    c = rng.normal(size=(2, 5))
    found = gm.linear.split_gramian(a, c)
    assert found.stable.shape == (5, 3)
    for basis, factor, sign in (
        (found.stable, found.stable_factor, 1),
        (found.antistable, found.antistable_factor, -1),
    ):
        inner = basis.T @ a @ basis
        assert np.abs(a @ basis - basis @ inner).max() < 1e-10
        seen = c @ basis
        expected = scipy.linalg.solve_continuous_lyapunov(sign * inner.T, -seen.T @ seen)
        assert np.allclose(factor.T @ factor, expected, rtol=1e-8)


def test_hankel_singular_values_of_moore():
    """Moore 1981, sec. V, example: 0.01594, 0.002724, 0.0001272, 0.000008006."""
    a = [[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [-150, -245, -113, -19]]
    found = gm.linear.hankel(a, [[0], [0], [0], [1]], [[4, 1, 0, 0]])
    printed = [1.594e-2, 2.724e-3, 1.272e-4, 8.006e-6]
    assert np.abs(found.values / printed - 1).max() < 5e-4
    assert found.order(1e-3) == 2
    assert "states: error below" in found.summary()


def test_small_hankel_singular_values_keep_their_digits():
    """Of a product form, known exactly: diag(s) balanced, mixed by a similarity."""
    s = 10.0 ** -np.arange(0, 7)
    b = np.sqrt(2 * np.outer(s, np.ones(1)) * s[:, None])
    # A balanced system with b = c^T: a_ij = -b_i b_j / (s_i + s_j).
    a = -(b @ b.T) / (s[:, None] + s)
    found = gm.linear.hankel(a, b, b.T)
    assert np.abs(found.values / s - 1).max() < 1e-6


def test_bad_input_is_named():
    with pytest.raises(gm.InputError, match="B has shape"):
        gm.linear.hankel([[-1.0]], [[1.0], [1.0]], [[1.0]])
    with pytest.raises(gm.InputError, match="discount = -1"):
        gm.linear.gramian_factor([[-1.0]], [[1.0]], discount=-1)
    with pytest.raises(gm.InputError, match="time = 'often'"):
        gm.linear.gramian_factor([[-1.0]], [[1.0]], time="often")
    with pytest.raises(gm.InputError, match="real part of an eigenvalue"):
        gm.linear.split_gramian([[0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0]])


def test_what_lasts_has_no_gramian_in_any_coordinates():
    """Rounding made a decay of 1e-17 of it, and a Gramian of 1e16, in half of all cases."""
    rng = np.random.default_rng(8)
    oscillator = scipy.linalg.block_diag([[0.0, 1.0], [-1.0, 0.0]], -2.0)
    for _ in range(20):
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        for a in (oscillator, np.diag([0.0, -1.0, -2.0])):
            with pytest.raises(gm.InputError, match="not stable"):
                gm.linear.gramian_factor(q @ a @ q.T, [[1.0, 1.0, 1.0]])
            with pytest.raises(gm.InputError, match="real part of an eigenvalue"):
                gm.linear.split_gramian(q @ a @ q.T, [[1.0, 1.0, 1.0]])
        step = scipy.linalg.expm(oscillator)
        with pytest.raises(gm.InputError, match="not stable"):
            gm.linear.gramian_factor(q @ step @ q.T, [[1.0, 1.0, 1.0]], time="discrete")
    # A slow decay is one, and what lasts unseen does no harm.
    slow = gm.linear.gramian_factor([[-1e-8]], [[1.0]])
    assert abs(slow[0, 0] ** 2 / 5e7 - 1) < 1e-9
    unseen = gm.linear.gramian_factor([[0.0, 0.0], [0.0, -1.0]], [[0.0, 1.0]])
    assert np.allclose(unseen.T @ unseen, [[0, 0], [0, 0.5]])


def test_no_order_keeps_the_error_below_nothing():
    found = gm.linear.hankel(np.diag([-1.0, -2.0]), np.ones((2, 1)), np.ones((1, 2)))
    assert found.order(0.0) == 2
    with pytest.raises(gm.InputError, match=r"error = -1\.0: must be >= 0"):
        found.order(-1.0)
