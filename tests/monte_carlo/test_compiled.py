"""Compiled measurement functions: the same answers as in Python, without the interpreter."""

import ctypes
import math
import pickle
import shutil
import subprocess

import numpy as np
import pytest

import gramian as gm

NUMBER = ctypes.POINTER(ctypes.c_double)
BEACONS = np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]])
NAMES, TRUTH = ["east", "north"], [-3.0, -40.0]
# The bearing of the last measurement is near the cut at 180 degrees.
SIGMA = np.array([1.0, 1.0, 1.0, 0.05])


def python(x):
    """Ranges to the beacons and the bearing of the first, from there."""
    return np.append(np.hypot(*(BEACONS - x).T), np.arctan2(x[0], x[1]))


def jacobian(x):
    """Its derivatives."""
    d = np.asarray(x) - BEACONS
    r2 = x[0] ** 2 + x[1] ** 2
    return np.vstack([d / np.hypot(*d.T)[:, None], [x[1] / r2, -x[0] / r2]])


def pointer(function, size):
    """Return a function of Python by its address, as C sees it."""

    @ctypes.CFUNCTYPE(None, NUMBER, NUMBER)
    def called(x, out):
        values = np.ravel(function(np.array([x[0], x[1]])))
        for i in range(size):
            out[i] = values[i]

    return called


H, J = pointer(python, 4), pointer(jacobian, 8)


def model(h=H, sigma=SIGMA, **options):
    """Return the model, of the compiled function by default."""
    count = None if h is python else 4
    return gm.from_function(h, TRUTH, sigma, NAMES, angles=[3], measurements=count, **options)


def test_values_and_rows_are_those_of_the_function():
    compiled, plain = model(), model(python)
    assert np.array_equal(compiled.h([7.0, 8.0]), python([7.0, 8.0]))
    assert np.array_equal(compiled.rows(), plain.rows())
    given = model(jacobian=J, method="given")
    assert np.allclose(given.rows(), plain.rows(), rtol=1e-9)
    z = compiled.simulate(seed=3)
    ours, theirs = (gm.estimate(m, z, prior={"north": (-40.0, 5.0)}) for m in (compiled, plain))
    assert np.allclose(ours.state, theirs.state, rtol=1e-9)


@pytest.mark.parametrize("prior", [None, {"north": (-40.0, 0.5)}])
@pytest.mark.parametrize("options", [{}, {"jacobian": J, "method": "given"}])
def test_trials_are_those_of_the_function_in_python(prior, options):
    def run(of):
        scene = gm.monte_carlo.Measurements(of, prior)
        return gm.monte_carlo.run(scene, 60, seed=2, table=True, progress=False)

    ours, theirs = run(model(**options)), run(model(python))
    bound = gm.crlb_std(gm.monte_carlo.Measurements(model(python), prior).problem())
    for name, deviation in zip(NAMES, bound, strict=True):
        off = ours.table[f"error_{name}"] - theirs.table[f"error_{name}"]
        assert np.abs(off).max() < 1e-6 * deviation
    assert np.allclose(ours.table["nees"], theirs.table["nees"], rtol=1e-5, atol=1e-9)


def test_a_missing_measurement_and_a_state_without_a_value():
    sigma = np.array([1.0, 1.0, 1.0, np.inf])
    ours, theirs = (
        gm.monte_carlo.run(model(h, sigma), 40, seed=2, table=True, progress=False)
        for h in (H, python)
    )
    assert np.allclose(ours.table["error_east"], theirs.table["error_east"], atol=1e-6)

    def edge(x):
        # On the threads of the extension numpy would warn.
        inside = x[0] + 4.0
        return np.append(python(x)[:3], math.sqrt(inside) if inside >= 0 else math.nan)

    half = model(pointer(edge, 4), [1.0, 1.0, 1.0, 1e3])
    result = gm.monte_carlo.run(half, 40, seed=2, progress=False)
    # Some of the estimates would be where there is no value.
    assert {f.kind for f in result.failures} == {"not_converged"}


def test_threads_and_chunks_change_no_bit():
    def run(**options):
        found = gm.monte_carlo.run(model(), 96, seed=5, table=True, progress=False, **options)
        return found.table

    one = run(workers=1)
    assert one.tobytes() == run(workers=2).tobytes()
    assert one.tobytes() == run(workers=2, chunk=16).tobytes()


def test_the_errors_are_as_large_as_the_bound():
    # Ten thousand calls back into Python are too many: a function of C is asked for.
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    result = gm.monte_carlo.run(model(in_c()), 20_000, seed=1, progress=False)
    assert not result.failures
    assert (np.abs(result.efficiency - 1) < 0.03).all()


def in_c():
    """Return the function compiled by gcc, as SciPy passes functions on, beacons as its data."""
    from scipy import LowLevelCallable

    text = """
    #include <math.h>
    void h(double *x, double *z, void *beacons) {
      const double *b = beacons;
      for (int i = 0; i < 3; i++) z[i] = hypot(b[2 * i] - x[0], b[2 * i + 1] - x[1]);
      z[3] = atan2(x[0], x[1]);
    }"""
    import tempfile
    from pathlib import Path

    folder = Path(tempfile.mkdtemp())
    (folder / "h.c").write_text(text)
    made = folder / "h.so"
    command = ["gcc", "-O2", "-shared", "-fPIC", str(folder / "h.c"), "-o", str(made), "-lm"]
    subprocess.run(command, check=True)
    function = ctypes.CDLL(str(made)).h
    shutil.rmtree(folder)
    function.restype, function.argtypes = None, [NUMBER, NUMBER, ctypes.c_void_p]
    beacons = (ctypes.c_double * 6)(*BEACONS.ravel())
    return LowLevelCallable(function, ctypes.cast(beacons, ctypes.c_void_p))


def test_numba():
    numba = pytest.importorskip("numba")
    beacons = BEACONS.copy()

    @numba.cfunc("void(CPointer(float64), CPointer(float64))")
    def h(x, z):
        for i in range(3):
            z[i] = math.hypot(beacons[i, 0] - x[0], beacons[i, 1] - x[1])
        z[3] = math.atan2(x[0], x[1])

    assert np.allclose(model(h).rows(), model(python).rows(), rtol=1e-12)

    @numba.cfunc("float64(float64)")
    def other(x):
        return x

    with pytest.raises(gm.InputError, match=r"h is declared as \(float64,\) -> float64: must be"):
        model(other)


def test_what_is_refused():
    undeclared = ctypes.CDLL(None).hypot
    for options, message in [
        ({"h": H, "count": None}, "measurements is missing: how many numbers"),
        ({"h": H, "count": 0}, "measurements = 0: must be"),
        ({"h": python, "count": 4}, "measurements goes with a compiled h only"),
        ({"h": H, "count": 4, "method": "complex"}, 'method = "complex" with a compiled h'),
        ({"h": H, "count": 4, "vectorized": True}, "vectorized = True with a compiled h"),
        ({"h": undeclared, "count": 4}, r"h is declared as argtypes = \[\]"),
    ]:
        h, count = options.pop("h"), options.pop("count")
        with pytest.raises(gm.InputError, match=message):
            gm.from_function(h, TRUTH, 1.0, NAMES, measurements=count, **options)
    null = ctypes.CFUNCTYPE(None, NUMBER, NUMBER)(0)
    with pytest.raises(gm.InputError, match="h is a null pointer"):
        model(null)
    with pytest.raises(gm.InputError, match="cannot be pickled"):
        pickle.dumps(model())
    # One without a way around the interpreter goes the other way.
    assert model(sigma=np.diag(SIGMA**2) + 1e-4).compiled is None
    assert model(jacobian=jacobian, method="given").compiled is None
