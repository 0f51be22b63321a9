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


@pytest.mark.parametrize(("method", "make"), [("jax", in_jax), ("torch", in_torch)])
class TestWhatFunctionsReturn:
    """Lists of numbers and vectors, complex numbers, single precision inside."""

    def package(self, method):
        return __import__("jax").numpy if method == "jax" else __import__("torch")

    def test_lists_in_lists(self, method, make):
        make()
        h = lambda x: [x[0] * x[1], 0.1, [x[1:] ** 2, (x[2],)]]  # noqa: E731
        model = gm.from_function(h, [2.0, 3.0, 5.0], 1.0, NAMES, method=method)
        wanted = [[3, 2, 0], [0, 0, 0], [0, 6, 0], [0, 0, 10], [0, 0, 1]]
        np.testing.assert_allclose(model.jacobian(), wanted, rtol=1e-15)
        assert model.h()[1] == 0.1

    def test_complex_measurements_are_both_parts(self, method, make):
        make()
        exp = self.package(method).exp
        h = lambda x: x[:1] * exp(1j * x[1] * 2.0) * x[2:]  # noqa: E731
        model = gm.from_function(h, [2.0, 0.3, 5.0], 1.0, NAMES, method=method)
        plain = gm.from_function(
            lambda x: x[:1] * np.exp(2j * x[1]) * x[2:], [2.0, 0.3, 5.0], 1.0, NAMES
        )
        np.testing.assert_allclose(model.rows(), plain.rows(), rtol=1e-9, atol=1e-9)

    def test_single_precision_inside_is_in_the_accuracy(self, method, make):
        make()
        float32 = self.package(method).float32
        if method == "torch":
            beacons = self.package(method).tensor(BEACONS).float()
            h = lambda x: ((x.float() - beacons) ** 2).sum(dim=1).sqrt()  # noqa: E731
        else:
            beacons = self.package(method).asarray(BEACONS, dtype=float32)
            h = lambda x: ((x.astype(float32) - beacons) ** 2).sum(axis=1) ** 0.5  # noqa: E731
        model = gm.from_function(h, X, 0.5, NAMES, method=method)
        offset = np.array(X) - BEACONS
        off = np.abs(model.jacobian() - offset / np.linalg.norm(offset, axis=1)[:, None])
        assert off.max() > 1e-9
        assert (off <= 3 * model.accuracy.error).all()


class Tensor:
    """A stand-in for PyTorch's: what it takes and gives are tensors, and nothing else."""

    def __init__(self, values, slopes=None):
        self.values, self.slopes = np.asarray(values, dtype=float), slopes

    def detach(self):
        return Tensor(self.values)

    def cpu(self):
        return self

    def numpy(self):
        # PyTorch refuses where a gradient hangs on it.
        assert self.slopes is None, "Can't call numpy() on a Tensor that requires grad"
        return self.values

    def __getitem__(self, key):
        return Tensor(self.values[key], None if self.slopes is None else self.slopes[key])

    def __array__(self, *_, **__):
        raise TypeError("a tensor is no array")

    @property
    def ndim(self):
        return self.values.ndim

    def is_complex(self):
        return False

    def reshape(self, count):
        assert count == -1
        slopes = self.slopes
        return Tensor(
            self.values.ravel(),
            None if slopes is None else slopes.reshape(self.values.size, -1),
        )

    def product(self, other):
        assert isinstance(other, Tensor), "must be Tensor, not ndarray"
        return Tensor(
            self.values * other.values,
            None
            if self.slopes is None
            else self.slopes * other.values[..., None] + self.values[..., None] * other.slopes,
        )


@pytest.fixture
def torch_stand_in(monkeypatch):
    """The calls of PyTorch that the adapter makes, on dual numbers."""
    from types import SimpleNamespace

    def tensor(values, dtype):
        assert dtype == "float64"
        assert isinstance(values, np.ndarray)
        return Tensor(values.copy(), None)

    def cat(parts):
        assert all(isinstance(part, Tensor) for part in parts)
        slopes = [part.slopes for part in parts]
        values = np.concatenate([part.values for part in parts])
        return Tensor(values, None if slopes[0] is None else np.concatenate(slopes))

    def jacobian(h, x):
        return Tensor(h(Tensor(x.values, np.eye(x.values.size))).slopes)

    functional = SimpleNamespace(jacobian=jacobian)
    module = SimpleNamespace(
        tensor=tensor,
        cat=cat,
        Tensor=Tensor,
        float64="float64",
        autograd=SimpleNamespace(functional=functional),
    )
    monkeypatch.setitem(sys.modules, "torch", module)


@pytest.mark.usefixtures("torch_stand_in")
def test_a_function_of_torch_is_given_tensors_and_no_arrays():
    """Every call of h, for its value, differences, estimates and Jacobian."""
    h = lambda x: [x[0].product(x[1]), x[0].product(x[0]), x[1].product(x[1])]  # noqa: E731
    model = gm.from_function(h, [2.0, 3.0], 0.1, ["a", "b"], method="torch")
    np.testing.assert_allclose(model.h(), [6.0, 4.0, 9.0])
    np.testing.assert_allclose(model.jacobian(), [[3, 2], [4, 0], [0, 6]], rtol=1e-15)
    assert model.accuracy.method == "torch"
    found = gm.estimate(model, [6.1, 4.0, 9.1], start=[2.5, 2.5])
    assert abs(found.state - [2.0, 3.0]).max() < 0.1


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
    assert "6 passed" in done.stdout
