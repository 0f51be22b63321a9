"""Modes of sparse systems, beside the dense answer and what symmetry says."""

import numpy as np
import pytest
from scipy.sparse import block_diag, csr_array, diags_array, eye_array, kron

import gramian as gm


def plate(side):
    """Heat in a square plate: -lambda(i) - lambda(j), twice unless i = j."""
    rod = diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(side, side))
    return csr_array(kron(rod, eye_array(side)) + kron(eye_array(side), rod))


def sensor(places, n):
    return csr_array((np.ones(len(places)), (range(len(places)), places)), shape=(len(places), n))


def test_equal_modes_of_a_plate_need_two_sensors():
    side = 25
    a = plate(side)
    one = gm.linear.modes(a, sensor([3 * side + 7], a.shape[0]), near=0.0, count=6)
    own = -4 * np.sin(np.pi * np.arange(1, side + 1) / (2 * (side + 1))) ** 2
    expected = np.unique(np.round(np.add.outer(own, own), 12))[::-1]
    np.testing.assert_allclose(one.eigenvalues, expected[: len(one.eigenvalues)], rtol=1e-9)
    # (1, 1), (1, 2) twice, (2, 2), (1, 3) twice.
    assert one.hidden_at.tolist()[:4] == [0, 1, 0, 1]
    mode = one.hidden[0]
    v = mode.combinations
    assert np.linalg.norm(a @ v - mode.eigenvalue.real * v) < 1e-10 * np.linalg.norm(v)
    assert abs(v[3 * side + 7]).max() < 1e-10 * np.linalg.norm(v)
    two = gm.linear.modes(a, sensor([3 * side + 7, 11 * side + 2], a.shape[0]), near=0.0, count=6)
    assert not two.hidden_at.any()
    assert "SHOWN" in two.summary()
    # The distances are the singular values themselves.
    for z, distance in zip(two.eigenvalues, two.distances, strict=True):
        stack = np.vstack(
            [
                a.toarray() - z.real * np.eye(side**2),
                sensor([3 * side + 7, 11 * side + 2], side**2).toarray(),
            ]
        )
        assert distance == pytest.approx(np.linalg.svd(stack, compute_uv=False)[-1], rel=1e-6)


def test_oscillators_whose_sum_is_measured_hide_their_difference():
    rng = np.random.default_rng(2)
    blocks = []
    for frequency in rng.uniform(0.5, 3.0, 60):
        blocks += 2 * [np.array([[0, 1], [-(frequency**2), -0.02]])]
    a = csr_array(block_diag(blocks))
    c = np.zeros((1, a.shape[0]))
    c[0, ::2] = 1.0
    # The first pair is told apart by its velocities.
    c[0, 1] = 0.5
    at = np.linalg.eigvals(blocks[8])[0]
    found = gm.linear.modes(a, c, near=at, count=4)
    dense = gm.linear.unobservable(a.toarray(), c)
    assert found.eigenvalues[0] == pytest.approx(complex(at.real, abs(at.imag)), rel=1e-9)
    assert found.hidden_at[0] == 2
    v = found.hidden[0].combinations
    inside = dense.null_space @ np.linalg.lstsq(dense.null_space, v)[0]
    np.testing.assert_allclose(inside, v, atol=1e-9)
    assert "oscillates" in found.hidden[0].motion
    assert found.to_dict()["hidden_at"][0] == 2


def test_a_system_of_other_packages_and_small_ones():
    control = pytest.importorskip("control", reason="python-control is not installed")
    a, c = np.diag([-1.0, -1.0, -3.0]), np.array([[1.0, 1.0, 1.0]])
    system = control.ss(a, np.zeros((3, 1)), c, 0)
    found = gm.linear.modes(system, near=-1.0, count=2)
    assert found.hidden_at.tolist() == [1]
    assert found.hidden[0].texts == ("x0 +1, x1 -1",)
    assert gm.linear.unobservable(csr_array(a), csr_array(c)).nullity == 1
    assert gm.linear.distance(csr_array(a), csr_array(c)).distance < 1e-14


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: gm.linear.modes(np.eye(3)[:2], np.eye(3)), "A has shape"),
        (lambda: gm.linear.modes(np.eye(3), np.eye(2)), "C has shape"),
        (lambda: gm.linear.modes(csr_array([[np.nan]]), [[1.0]]), "A has nan: must be finite"),
        (lambda: gm.linear.modes(np.eye(3), np.eye(3), near=np.inf), "near = inf: must be finite"),
        (lambda: gm.linear.modes(np.eye(3), np.eye(3), count=0), "count = 0"),
        (lambda: gm.linear.modes(np.eye(3), np.eye(3), names=["a"]), "names"),
        (lambda: gm.linear.unobservable(eye_array(4000, format="csr"), np.ones((1, 4000))), "A is sparse with 4000 columns.*modes"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(make, said):
    with pytest.raises(gm.InputError, match=said):
        make()
