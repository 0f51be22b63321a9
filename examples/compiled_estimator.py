"""Monte Carlo of a model and an estimator in C: no trial passes through the interpreter.

    python examples/compiled_estimator.py [trials]

Needs a C compiler (cc). With numba the same two functions can stay in Python: see
docs/howto/monte_carlo.md.
"""

import ctypes
import subprocess
import sys
import tempfile
from pathlib import Path

import gramian as gm

SOURCE = """
#include <math.h>

static const double beacons[4][2] = {{0, 0}, {100, 0}, {0, 100}, {100, 100}};

/* The state (n,), and where the measurements (m,) go. */
void ranges(double *x, double *z) {
  for (int i = 0; i < 4; i++) z[i] = hypot(x[0] - beacons[i][0], x[1] - beacons[i][1]);
}

/* The measurements of a trial, where the estimate goes, and its covariance (n, n). */
int gauss_newton(double *z, double *x, double *covariance) {
  x[0] = x[1] = 50;
  for (int step = 0; step < 20; step++) {
    double a = 0, b = 0, c = 0, east = 0, north = 0;
    for (int i = 0; i < 4; i++) {
      double dx = x[0] - beacons[i][0], dy = x[1] - beacons[i][1], r = hypot(dx, dy);
      a += dx * dx / (r * r), b += dx * dy / (r * r), c += dy * dy / (r * r);
      east += dx / r * (z[i] - r), north += dy / r * (z[i] - r);
    }
    double det = a * c - b * b;
    double to_east = (c * east - b * north) / det, to_north = (a * north - b * east) / det;
    x[0] += to_east, x[1] += to_north;
    if (hypot(to_east, to_north) < 1e-6) {
      covariance[0] = c / det, covariance[1] = covariance[2] = -b / det, covariance[3] = a / det;
      return 0;
    }
  }
  return 1; /* Counted as "returned 1". */
}
"""


def compiled(source):
    """Return the shared library of a text in C."""
    with tempfile.TemporaryDirectory() as folder:
        text, library = Path(folder, "own.c"), Path(folder, "own.so")
        text.write_text(source)
        command = ["cc", "-O2", "-shared", "-fPIC", str(text), "-o", str(library), "-lm"]
        subprocess.run(command, check=True)
        return ctypes.CDLL(str(library))


def main():
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    numbers, own = ctypes.POINTER(ctypes.c_double), compiled(SOURCE)
    own.ranges.argtypes, own.ranges.restype = [numbers, numbers], None
    own.gauss_newton.argtypes = [numbers, numbers, numbers]
    own.gauss_newton.restype = ctypes.c_int
    model = gm.from_function(own.ranges, [30.0, 40.0], 1.0, ["east", "north"], measurements=4)
    result = gm.monte_carlo.run(model, trials, seed=1, estimator=own.gauss_newton)
    print(result.summary())
    print(f"{result.trials / result.seconds:,.0f} trials a second")


if __name__ == "__main__":
    main()
