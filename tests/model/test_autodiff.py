"""Functions written for JAX, PyTorch and CasADi: their Jacobians beside differences."""

import os
import subprocess
import sys

import numpy as np
import pytest

import gramian as gm

# JAX starts threads when it is imported, and processes forked after that may hang: its tests
# run in a process of their own.
ALONE = "GRAMIAN_TEST_JAX"

BEACONS = np.array([[0.0, 0.0, 10.0], [100.0, 0.0, 5.0], [40.0, 80.0, 0.0], [10.0, 60.0, 30.0]])
X = [30.0, 40.0, 2.0]
NAMES = ["east", "north", "up"]


def plain(x):
    return np.sqrt(((x - BEACONS) ** 2).sum(axis=1))


def in_jax():
    if ALONE not in os.environ:
        pytest.skip("in a process of its own: test_jax_in_a_process_of_its_own")
    jax = pytest.importorskip("jax", reason="needs jax")
    # Single precision is jax's default.
    jax.config.update("jax_enable_x64", True)
    return lambda x: jax.numpy.sqrt(((x - BEACONS) ** 2).sum(axis=1))


def in_torch():
    torch = pytest.importorskip("torch", reason="needs PyTorch, some GB: not installed by dev")
    return lambda x: torch.sqrt(((x - torch.tensor(BEACONS)) ** 2).sum(dim=1))


def in_casadi():
    casadi = pytest.importorskip("casadi", reason="needs CasADi")
    x = casadi.MX.sym("x", 3)
    ranges = [casadi.norm_2(x - casadi.DM(beacon)) for beacon in BEACONS]
    return casadi.Function("ranges", [x], [casadi.vertcat(*ranges)])


@pytest.mark.parametrize(
    ("method", "make"), [("jax", in_jax), ("torch", in_torch), ("casadi", in_casadi)]
)
class TestAutomaticDifferentiation:
    def test_the_jacobian_is_exact(self, method, make):
        model = gm.from_function(make(), X, 0.5, NAMES, method=method)
        offset = np.array(X) - BEACONS
        exact = offset / np.linalg.norm(offset, axis=1)[:, None]
        np.testing.assert_allclose(model.jacobian(), exact, rtol=1e-14)
        assert model.accuracy.method == method
        assert (np.abs(model.jacobian() - exact) <= model.accuracy.error + 1e-15).all()
        np.testing.assert_allclose(model.h(), plain(np.array(X)), rtol=1e-14)

    def test_estimates_and_bounds_are_those_of_differences(self, method, make):
        model = gm.from_function(make(), X, 0.5, NAMES, method=method)
        other = gm.from_function(plain, X, 0.5, NAMES)
        np.testing.assert_allclose(gm.crlb_std(model), gm.crlb_std(other), rtol=1e-8)
        z = other.simulate(seed=1)
        a, b = gm.estimate(model, z), gm.estimate(other, z)
        np.testing.assert_allclose(a.state, b.state, rtol=1e-7)
        assert a.status == b.status


def test_what_is_no_casadi_function():
    pytest.importorskip("casadi", reason="needs CasADi")
    with pytest.raises(gm.InputError, match=r"h is a function: must be a casadi\.Function"):
        gm.from_function(plain, X, 0.5, NAMES, method="casadi")


def test_single_precision_of_jax_is_in_the_accuracy():
    if ALONE not in os.environ:
        pytest.skip("in a process of its own: test_jax_in_a_process_of_its_own")
    jax = pytest.importorskip("jax", reason="needs jax")
    jax.config.update("jax_enable_x64", False)
    try:
        h = lambda x: jax.numpy.sqrt(((x - BEACONS) ** 2).sum(axis=1))  # noqa: E731
        model = gm.from_function(h, X, 0.5, NAMES, method="jax")
        offset = np.array(X) - BEACONS
        exact = offset / np.linalg.norm(offset, axis=1)[:, None]
        off = np.abs(model.jacobian() - exact)
        assert off.max() > 1e-9
        assert (off <= 3 * model.accuracy.error).all()
    finally:
        jax.config.update("jax_enable_x64", True)


def test_jax_in_a_process_of_its_own():
    if ALONE in os.environ:
        pytest.skip("this is that process")
    from importlib.util import find_spec

    if find_spec("jax") is None:
        pytest.skip("needs jax")
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-k",
        "jax",
        __file__,
    ]
    done = subprocess.run(
        command,
        check=False,
        env=os.environ | {ALONE: "1"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout
    assert "3 passed" in done.stdout
