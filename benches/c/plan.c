/* Minus log det of the Fisher information on a fixed target from the bearings along a
 * path, and its gradient by the headings. The observer starts at the origin and makes
 * steps of one length; `work` has room for 4 (steps + 1) numbers. Sine and cosine in
 * two loops: in one, gcc merges them into a scalar call. */
#include <math.h>

double minus_log_det(double *gradient, const double *heading, long steps, const double *target,
                     double step, double sigma, double *work) {
  const long m = steps + 1;
  double *restrict s = work, *restrict c = work + m, *restrict x = work + 2 * m,
                   *restrict y = work + 3 * m;
  for (long i = 0; i < steps; i++) s[i] = step * sin(heading[i]);
  for (long i = 0; i < steps; i++) c[i] = step * cos(heading[i]);
  x[0] = target[0];
  y[0] = target[1];
  for (long i = 0; i < steps; i++) {
    x[i + 1] = x[i] - s[i];
    y[i + 1] = y[i] - c[i];
  }
  double xx = 0, xy = 0, yy = 0;
#pragma omp simd reduction(+ : xx, xy, yy)
  for (long k = 0; k < m; k++) {
    const double w = 1 / (x[k] * x[k] + y[k] * y[k]), a = y[k] * w, b = -x[k] * w;
    xx += a * a;
    xy += a * b;
    yy += b * b;
  }
  const double det = xx * yy - xy * xy, pxx = yy / det, pxy = -xy / det, pyy = xx / det;
  /* The derivatives by the offsets take the offsets' place. */
#pragma omp simd
  for (long k = 0; k < m; k++) {
    const double w = 1 / (x[k] * x[k] + y[k] * y[k]), a = y[k] * w, b = -x[k] * w;
    const double u = pxx * a + pxy * b, v = pxy * a + pyy * b;
    const double both = 2 * w * (v * x[k] - u * y[k]);
    const double east = 2 * w * (x[k] * both - v), north = 2 * w * (y[k] * both + u);
    x[k] = east;
    y[k] = north;
  }
  /* A step moves all samples after it. */
  double east = 0, north = 0;
  for (long i = steps - 1; i >= 0; i--) {
    east += x[i + 1];
    north += y[i + 1];
    gradient[i] = east * c[i] - north * s[i];
  }
  return 4 * log(sigma) - log(det);
}
