/* Fisher information of dipole passes: the 42 sums of the closed form, sample by
 * sample, as one would write them by hand. Compiled with -O3 -march=native
 * -ffast-math -fopenmp-simd, the loop over samples told to become vectors. */
#include <math.h>
#include <stddef.h>

static const double K = 1e-7;

void dipole_fisher(const double *r0, const double *v, const double *m, const double *times,
                   double sigma, size_t trials, size_t samples, double *out) {
  for (size_t b = 0; b < trials; b++) {
    const double *r = r0 + 3 * b, *w = v + 3 * b, *q = m + 3 * b;
    const double m0 = q[0], m1 = q[1], m2 = q[2], size = m0 * m0 + m1 * m1 + m2 * m2;
    double p0[6] = {0}, p1[6] = {0}, p2[6] = {0}, c0[9] = {0}, c1[9] = {0}, d[6] = {0};
#pragma omp simd reduction(+ : p0[:6], p1[:6], p2[:6], c0[:9], c1[:9], d[:6])
    for (size_t k = 0; k < samples; k++) {
      const double t = times[k] - times[0];
      const double x = r[0] + t * w[0], y = r[1] + t * w[1], z = r[2] + t * w[2];
      const double i2 = 1.0 / (x * x + y * y + z * z), i1 = sqrt(i2);
      const double n0 = x * i1, n1 = y * i1, n2 = z * i1;
      const double s = n0 * m0 + n1 * m1 + n2 * m2;
      const double cube = K * i1 * i2, quart = 3 * cube * i1;
      const double a = quart * quart, c = quart * cube, e = cube * cube;
      const double radial = size + 5 * s * s, ss = s * s, s2 = 2 * s;
      const double P[6] = {
          a * (ss - s2 * 2 * n0 * m0 + radial * n0 * n0 + m0 * m0),
          a * (ss - s2 * 2 * n1 * m1 + radial * n1 * n1 + m1 * m1),
          a * (ss - s2 * 2 * n2 * m2 + radial * n2 * n2 + m2 * m2),
          a * (radial * n1 * n0 + m1 * m0 - s2 * (n1 * m0 + m1 * n0)),
          a * (radial * n2 * n0 + m2 * m0 - s2 * (n2 * m0 + m2 * n0)),
          a * (radial * n2 * n1 + m2 * m1 - s2 * (n2 * m1 + m2 * n1))};
      const double C[9] = {
          c * (m0 * n0 - s - 4 * s * n0 * n0), c * (2 * m0 * n1 - n0 * m1 - 4 * s * n0 * n1),
          c * (2 * m0 * n2 - n0 * m2 - 4 * s * n0 * n2), c * (2 * m1 * n0 - n1 * m0 - 4 * s * n1 * n0),
          c * (m1 * n1 - s - 4 * s * n1 * n1), c * (2 * m1 * n2 - n1 * m2 - 4 * s * n1 * n2),
          c * (2 * m2 * n0 - n2 * m0 - 4 * s * n2 * n0), c * (2 * m2 * n1 - n2 * m1 - 4 * s * n2 * n1),
          c * (m2 * n2 - s - 4 * s * n2 * n2)};
      const double D[6] = {e * (3 * n0 * n0 + 1), e * (3 * n1 * n1 + 1), e * (3 * n2 * n2 + 1),
                           e * 3 * n1 * n0,       e * 3 * n2 * n0,       e * 3 * n2 * n1};
      for (int i = 0; i < 6; i++) {
        p0[i] += P[i];
        p1[i] += t * P[i];
        p2[i] += t * t * P[i];
        d[i] += D[i];
      }
      for (int i = 0; i < 9; i++) {
        c0[i] += C[i];
        c1[i] += t * C[i];
      }
    }
    const int row[6] = {0, 1, 2, 1, 2, 2}, column[6] = {0, 1, 2, 0, 0, 1};
    const double weight = 1.0 / (sigma * sigma);
    double *J = out + 81 * b;
#define PUT(i, j, value) (J[9 * (i) + (j)] = J[9 * (j) + (i)] = weight * (value))
    for (int k = 0; k < 6; k++) {
      const int i = row[k], j = column[k];
      PUT(i, j, p0[k]);
      PUT(i, 3 + j, p1[k]);
      PUT(j, 3 + i, p1[k]);
      PUT(3 + i, 3 + j, p2[k]);
      PUT(6 + i, 6 + j, d[k]);
    }
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++) {
        PUT(i, 6 + j, c0[3 * i + j]);
        PUT(3 + i, 6 + j, c1[3 * i + j]);
      }
  }
}
