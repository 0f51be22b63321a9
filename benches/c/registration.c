/* Fisher information on the biases of two radars, ten sums over the looks as one
 * would write them by hand; the positions (looks, 2) of each track are not known and
 * eliminated by the 2 x 2 covariance of the look. `variance`: range and azimuth of
 * either sensor. */
#include <math.h>

void registration_fisher(const double *positions, const double *sensors, const double *variance,
                         long tracks, long looks, double *out) {
  const double ax = sensors[0], ay = sensors[1], bx = sensors[2], by = sensors[3];
  const double v0 = variance[0], v1 = variance[1], v2 = variance[2], v3 = variance[3];
  for (long n = 0; n < tracks; n++) {
    const double *p = positions + 2 * looks * n;
    double sum[10] = {0};
#pragma omp simd reduction(+ : sum[:10])
    for (long k = 0; k < looks; k++) {
      const double x1 = p[2 * k] - ax, y1 = p[2 * k + 1] - ay;
      const double x2 = p[2 * k] - bx, y2 = p[2 * k + 1] - by;
      const double i1 = 1 / sqrt(x1 * x1 + y1 * y1), i2 = 1 / sqrt(x2 * x2 + y2 * y2);
      const double h0[4] = {x1 * i1, y1, -x2 * i2, -y2};
      const double h1[4] = {y1 * i1, -x1, -y2 * i2, x2};
      const double a = v0 * h0[0] * h0[0] + v1 * h0[1] * h0[1] + v2 * h0[2] * h0[2] + v3 * h0[3] * h0[3];
      const double b = v0 * h0[0] * h1[0] + v1 * h0[1] * h1[1] + v2 * h0[2] * h1[2] + v3 * h0[3] * h1[3];
      const double d = v0 * h1[0] * h1[0] + v1 * h1[1] * h1[1] + v2 * h1[2] * h1[2] + v3 * h1[3] * h1[3];
      const double w = 1 / (a * d - b * b);
      double g0[4], g1[4];
      for (int i = 0; i < 4; i++) {
        g0[i] = w * (d * h0[i] - b * h1[i]);
        g1[i] = w * (a * h1[i] - b * h0[i]);
      }
      int at = 0;
#pragma GCC unroll 4
      for (int i = 0; i < 4; i++)
#pragma GCC unroll 4
        for (int j = i; j < 4; j++) sum[at++] += h0[i] * g0[j] + h1[i] * g1[j];
    }
    int at = 0;
    for (int i = 0; i < 4; i++)
      for (int j = i; j < 4; j++) out[16 * n + 4 * i + j] = out[16 * n + 4 * j + i] = sum[at++];
  }
}
