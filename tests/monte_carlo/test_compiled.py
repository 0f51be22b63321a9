"""Compiled measurement functions: the same answers as in Python, without the interpreter."""

import ctypes
import math
import os
import pickle
import runpy
import shutil
import signal
import subprocess
import tempfile
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import gramian as gm

NUMBER = ctypes.POINTER(ctypes.c_double)
BEACONS = np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]])
NAMES, TRUTH = ["east", "north"], [-3.0, -40.0]
# The bearing of the last measurement is near the cut at 180 degrees.
SIGMA = np.array([1.0, 1.0, 1.0, 0.05])
with_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")


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


@with_gcc
def test_the_errors_are_as_large_as_the_bound():
    # Ten thousand calls back into Python are too many: a function of C is asked for.
    result = gm.monte_carlo.run(model(in_c()), 20_000, seed=1, progress=False)
    assert not result.failures
    assert (np.abs(result.efficiency - 1) < 0.03).all()


def built(text):
    """Return what gcc makes of a text in C."""
    with tempfile.TemporaryDirectory() as folder:
        source, made = Path(folder, "of.c"), Path(folder, "of.so")
        source.write_text(f"#include <math.h>\n#include <stdlib.h>\n{text}")
        command = ["gcc", "-O2", "-shared", "-fPIC", str(source), "-o", str(made), "-lm"]
        subprocess.run(command, check=True)
        return ctypes.CDLL(str(made))


def in_c():
    """Return the function compiled by gcc, as SciPy passes functions on, beacons as its data."""
    from scipy import LowLevelCallable

    function = built("""
    void h(double *x, double *z, void *beacons) {
      const double *b = beacons;
      for (int i = 0; i < 3; i++) z[i] = hypot(b[2 * i] - x[0], b[2 * i + 1] - x[1]);
      z[3] = atan2(x[0], x[1]);
    }""").h
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
    with pytest.raises(gm.InputError, match=r"jacobian is declared as .* writes the derivatives"):
        model(jacobian=undeclared, method="given")
    # One without a way around the interpreter goes the other way.
    assert model(sigma=np.diag(SIGMA**2) + 1e-4).compiled is None
    assert model(jacobian=jacobian, method="given").compiled is None


ROWS = jacobian(TRUTH) / SIGMA[:, None]
GAIN = np.linalg.pinv(ROWS) / SIGMA
COVARIANCE = np.linalg.inv(ROWS.T @ ROWS)


def one_step(z):
    """A step of Gauss and Newton from the truth; none far from it."""
    off = z - python(TRUTH)
    off[3] -= 2 * math.pi * round(off[3] / (2 * math.pi))
    # Sums of Python's own, which are the same on any thread.
    step = [sum(float(a) * float(b) for a, b in zip(row, off, strict=True)) for row in GAIN]
    if step[0] > 1.0:
        return [math.nan, 0.0]
    return [TRUTH[0] + step[0], TRUTH[1] + step[1]]


def compiled(estimate, *, covariance=None, code=None):
    """Return an estimator of Python by its address, as C sees it."""
    kinds = [NUMBER] * (2 if covariance is None else 3)

    def called(z, x, *more):
        x[0], x[1] = estimate(np.array(z[:4]))
        if more:
            for place, number in enumerate(np.ravel(covariance)):
                more[0][place] = number
        return code(z) if code else None

    return ctypes.CFUNCTYPE(ctypes.c_int if code else None, *kinds)(called)


def run(estimator, of=None, trials=64, **options):
    """Return the run of an estimator."""
    scene = of or model(python)
    return gm.monte_carlo.run(scene, trials, 3, estimator, table=True, progress=False, **options)


@pytest.mark.parametrize("of", [model(python), model()])
def test_an_estimator_does_as_in_python(of):
    ours, theirs = run(compiled(one_step), of), run(one_step, of)
    assert ours.table.tobytes() == theirs.table.tobytes()
    assert [f.kind for f in ours.failures] == ["not finite"]
    assert ours.failures == theirs.failures
    claiming = compiled(one_step, covariance=2 * COVARIANCE)
    ours, theirs = run(claiming, of), run(lambda z: (one_step(z), 2 * COVARIANCE), of)
    assert ours.table.tobytes() == theirs.table.tobytes()
    assert ours.failures == theirs.failures


def test_an_estimator_says_that_it_has_none():
    def code(z):
        return 3 if z[0] > 41.0 else -7 if z[0] < 39.0 else 0

    result = run(compiled(lambda _: TRUTH, code=code))
    first = result.table["trial"][result.table["status"] == 3][0]
    kinds = {f.kind: f for f in result.failures}
    assert set(kinds) == {"returned 3", "returned no status"}
    assert kinds["returned 3"].first_trial == first
    assert kinds["returned no status"].gist == (
        "the estimator returned -7: must be 0 for success, or 1 to 32767"
    )
    assert kinds["returned 3"].count == (result.table["status"] == 3).sum()
    assert np.isnan(result.table["error_east"][result.table["status"] != 0]).all()
    assert set(result.table["error_east"][result.table["status"] == 0]) == {0.0}


def test_a_covariance_that_is_none():
    slanted = np.array([[1.0, 0.5], [0.0, 1.0]])
    for claim, kind in [
        (slanted, "covariance not symmetric (no NEES)"),
        (-COVARIANCE, "covariance not positive definite (no NEES)"),
        (np.full((2, 2), np.nan), "covariance not positive definite (no NEES)"),
    ]:
        ours = run(compiled(lambda _: TRUTH, covariance=claim))
        theirs = run(lambda _, claim=claim: (TRUTH, claim))
        assert [f.kind for f in ours.failures] == [kind]
        assert ours.failures == theirs.failures


SOURCE = """
static int compare(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}
int median(double *z, double *x, double *covariance, void *count) {
  int m = *(int *)count;
  qsort(z, m, sizeof(double), compare);
  x[0] = z[m / 2];
  covariance[0] = 1.5707963267948966 / m;
  return z[m - 1] > 3.5 ? 2 : 0;
}
void largest(double *z, double *out) {
  out[0] = z[0];
  for (int i = 1; i < 11; i++) if (z[i] > out[0]) out[0] = z[i];
  z[0] = -1.0;
}
void first(double *z, double *out) { out[0] = z[0]; }
void slow(double *z, double *x) {
  volatile double sum = 0.0;
  for (int i = 0; i < 2000000; i++) sum += i;
  x[0] = z[0];
}
"""


class Level(gm.monte_carlo.Experiment):
    """Eleven readings of a level of 0."""

    names = ("level",)
    truth = (0.0,)

    def simulate(self, seed, first, trials):
        return gm.monte_carlo.normals(seed, first, trials, 11)

    def problem(self):
        return gm.Problem(np.ones((11, 1)), self.names)


def python_median(z):
    """The same in Python."""
    if z.max() > 3.5:
        raise ValueError("too large")
    return [np.sort(z)[5]], [[math.pi / 2 / 11]]


@with_gcc
def test_c_works_in_its_own_copy_on_any_thread(tmp_path):
    from scipy import LowLevelCallable

    library, count = built(SOURCE), ctypes.c_int(11)
    library.median.restype = ctypes.c_int
    library.median.argtypes = [NUMBER, NUMBER, NUMBER, ctypes.c_void_p]
    for function in (library.largest, library.first):
        function.restype, function.argtypes = None, [NUMBER, NUMBER]
    median = LowLevelCallable(library.median, ctypes.cast(ctypes.byref(count), ctypes.c_void_p))
    # Both change what they are given.
    quantities = {"largest": library.largest, "first": library.first}

    def answer(trials=5000, **options):
        return run(median, Level(), trials, quantities=quantities, **options)

    found = answer()
    assert found.estimator == "median"
    assert [f.kind for f in found.failures] == ["returned 2"]
    theirs = run(
        python_median, Level(), 5000, quantities={"largest": np.max, "first": lambda z: z[0]}
    )
    for name in ("trial", "error_level", "nees", "largest", "first"):
        assert np.array_equal(found.table[name], theirs.table[name], equal_nan=True)
    assert found.failures[0].count == theirs.failures[0].count
    bits = found.table.tobytes()
    for options in [{"workers": 1}, {"workers": 2}, {"workers": 2, "chunk": 16}]:
        assert answer(**options).table.tobytes() == bits
    with ThreadPoolExecutor(2) as executor:
        assert answer(executor=executor).table.tobytes() == bits
    # Resumed, and refused for another function.
    answer(4000, resume=tmp_path / "run")
    longer = answer(resume=tmp_path / "run")
    assert longer.table.tobytes() == bits
    assert longer.simulated < 5000
    with pytest.raises(gm.InputError, match="estimator"):
        run(library.first, Level(), 5000, quantities=quantities, resume=tmp_path / "run")


@with_gcc
def test_ctrl_c_is_heard():
    library = built(SOURCE)
    library.slow.restype, library.slow.argtypes = None, [NUMBER, NUMBER]
    # What is imported at the first run is there before the signal.
    run(library.slow, Level(), 1)
    for workers in (1, 2):
        timer = threading.Timer(0.5, os.kill, [os.getpid(), signal.SIGINT])
        timer.start()
        # Half an hour of work.
        with pytest.raises(KeyboardInterrupt) as stopped:
            run(library.slow, Level(), 10**6, workers=workers)
        assert "of 1000000 trials" in stopped.value.__notes__[0]
        timer.join()


@pytest.mark.skipif(shutil.which("cc") is None, reason="cc is not installed")
def test_the_example(monkeypatch, capsys):
    example = Path(__file__).parents[2] / "examples" / "compiled_estimator.py"
    monkeypatch.setattr("sys.argv", [str(example), "20000"])
    runpy.run_path(str(example), run_name="__main__")
    told = capsys.readouterr().out
    assert told.startswith("REACHES THE BOUND")
    assert "20000 trials, seed 1, estimator gauss_newton" in told


def test_estimators_that_are_refused():
    wrong = ctypes.CFUNCTYPE(ctypes.c_double, NUMBER, NUMBER)(lambda z, x: 0.0)
    for estimator, message in [
        (wrong, r"estimator is declared as argtypes = \['LP_c_double', 'LP_c_double'\], "
         r"restype = c_double: must be void or int \(double \*, double \*\) or"),
        (ctypes.CDLL(None).hypot, r"estimator is declared as argtypes = \[\], restype = c_int"),
        (ctypes.CFUNCTYPE(None, NUMBER, NUMBER)(0), "estimator is a null pointer"),
    ]:  # fmt: skip
        with pytest.raises(gm.InputError, match=message):
            run(estimator)
    three = ctypes.CFUNCTYPE(None, NUMBER, NUMBER, NUMBER)(lambda z, x, c: None)
    with pytest.raises(gm.InputError, match=r"quantities\['peak'\] is declared as .* one number"):
        run(one_step, quantities={"peak": three})
    with (
        ProcessPoolExecutor(1) as executor,
        pytest.raises(gm.InputError, match="a compiled estimator or quantity has its address"),
    ):
        run(compiled(one_step), executor=executor)

    class Ragged(Level):
        def simulate(self, seed, first, trials):
            return [np.zeros(1 + i % 2) for i in range(trials)]

    with pytest.raises(gm.InputError, match="measurements cannot be read as an array of numbers"):
        run(compiled(one_step), Ragged())


def test_what_is_not_written_is_not_finite():
    nothing = ctypes.CFUNCTYPE(None, NUMBER, NUMBER)(lambda z, x: None)
    result = run(nothing, quantities={"none": nothing})
    assert {f.kind: f.count for f in result.failures} == {"not finite": 64, "none: not finite": 64}
    assert result.failures[1].gist == "the estimate is [nan nan]: must be finite"


def test_an_estimator_of_numba():
    numba = pytest.importorskip("numba")

    @numba.cfunc("int32(CPointer(float64), CPointer(float64), CPointer(float64))")
    def mean(z, x, covariance):
        x[0] = 0.0
        for i in range(11):
            x[0] += z[i] / 11
        covariance[0] = 1 / 11
        return 4 if z[0] > 2.5 else 0

    result = run(mean, Level(), 20_000)
    assert result.estimator == "mean"
    assert [f.kind for f in result.failures] == ["returned 4"]
    assert abs(result.efficiency[0] - 1) < 0.02

    @numba.cfunc("float64(CPointer(float64), CPointer(float64))")
    def other(z, x):
        return z[0]

    with pytest.raises(gm.InputError, match=r"estimator is declared as .* as numba.cfunc\("):
        run(other, Level())
