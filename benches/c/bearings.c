/* Bearings in C as one would write them for gcc -O3 -march=native, with and
 * without -ffast-math: the sum of squared discriminants over all quadruples, and
 * Gram matrices with their determinants. The compiler makes the vectors. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

double discriminant_sum(const double *t, const double *b, long m) {
  double *s = malloc(sizeof(double) * (size_t)(m * m));
  double *p = malloc(sizeof(double) * (size_t)m), *q = malloc(sizeof(double) * (size_t)m);
  for (long i = 0; i < m; i++)
    for (long j = 0; j < m; j++) s[i * m + j] = sin(b[j] - b[i]);
  double total = 0;
  for (long j = 1; j < m; j++)
    for (long k = j + 1; k < m - 1; k++) {
      long n = m - k - 1;
      for (long l = 0; l < n; l++) {
        p[l] = (t[k + 1 + l] - t[j]) * s[k * m + k + 1 + l];
        q[l] = (t[k + 1 + l] - t[k]) * s[j * m + k + 1 + l];
      }
      for (long i = 0; i < j; i++) {
        double a = (t[k] - t[i]) * s[i * m + j], c = (t[j] - t[i]) * s[i * m + k];
        double sum = 0;
        for (long l = 0; l < n; l++) {
          double d = a * p[l] - c * q[l];
          sum += d * d;
        }
        total += sum;
      }
    }
  free(s);
  free(p);
  free(q);
  return total;
}

/* Four of the first index at once, each with its own sum. */
double discriminant_sum_blocked(const double *t, const double *b, long m) {
  double *s = malloc(sizeof(double) * (size_t)(m * m));
  double *p = malloc(sizeof(double) * (size_t)m), *q = malloc(sizeof(double) * (size_t)m);
  for (long i = 0; i < m; i++)
    for (long j = 0; j < m; j++) s[i * m + j] = sin(b[j] - b[i]);
  double total = 0;
  for (long j = 1; j < m; j++)
    for (long k = j + 1; k < m - 1; k++) {
      long n = m - k - 1;
      for (long l = 0; l < n; l++) {
        p[l] = (t[k + 1 + l] - t[j]) * s[k * m + k + 1 + l];
        q[l] = (t[k + 1 + l] - t[k]) * s[j * m + k + 1 + l];
      }
      long i = 0;
      for (; i + 4 <= j; i += 4) {
        double a[4], c[4], s0 = 0, s1 = 0, s2 = 0, s3 = 0;
        for (int n4 = 0; n4 < 4; n4++) {
          a[n4] = (t[k] - t[i + n4]) * s[(i + n4) * m + j];
          c[n4] = (t[j] - t[i + n4]) * s[(i + n4) * m + k];
        }
        for (long l = 0; l < n; l++) {
          double d0 = a[0] * p[l] - c[0] * q[l], d1 = a[1] * p[l] - c[1] * q[l];
          double d2 = a[2] * p[l] - c[2] * q[l], d3 = a[3] * p[l] - c[3] * q[l];
          s0 += d0 * d0;
          s1 += d1 * d1;
          s2 += d2 * d2;
          s3 += d3 * d3;
        }
        total += (s0 + s1) + (s2 + s3);
      }
      for (; i < j; i++) {
        double a = (t[k] - t[i]) * s[i * m + j], c = (t[j] - t[i]) * s[i * m + k];
        for (long l = 0; l < n; l++) {
          double d = a * p[l] - c * q[l];
          total += d * d;
        }
      }
    }
  free(s);
  free(p);
  free(q);
  return total;
}

static double det4(double a[4][4]) {
  double det = 1;
  for (int k = 0; k < 4; k++) {
    det *= a[k][k];
    for (int i = k + 1; i < 4; i++) {
      double f = a[i][k] / a[k][k];
      for (int j = k + 1; j < 4; j++) a[i][j] -= f * a[k][j];
    }
  }
  return det;
}

/* Six sums of cos 2b and sin 2b beside those of the times. Sine and cosine in two
 * loops: in one, gcc merges them into a scalar call. */
void gram_det(const double *t, const double *b, long trials, long m, double *gram, double *det) {
  double *restrict c = malloc(3 * sizeof(double) * (size_t)m), *restrict s = c + m;
  double *restrict x = s + m, t0 = 0, t1 = 0, t2 = 0;
  for (long i = 0; i < m; i++) {
    x[i] = t[i] - t[0];
    t0 += 1;
    t1 += x[i];
    t2 += x[i] * x[i];
  }
  for (long n = 0; n < trials; n++) {
    const double *angle = b + n * m;
    for (long i = 0; i < m; i++) s[i] = sin(2 * angle[i]);
    for (long i = 0; i < m; i++) c[i] = cos(2 * angle[i]);
    double c0 = 0, c1 = 0, c2 = 0, s0 = 0, s1 = 0, s2 = 0;
    for (long i = 0; i < m; i++) {
      double u = c[i] * x[i], v = s[i] * x[i];
      c0 += c[i];
      s0 += s[i];
      c1 += u;
      s1 += v;
      c2 += u * x[i];
      s2 += v * x[i];
    }
    double k[3][3] = {{(t0 + c0) / 2, -s0 / 2, (t0 - c0) / 2},
                      {(t1 + c1) / 2, -s1 / 2, (t1 - c1) / 2},
                      {(t2 + c2) / 2, -s2 / 2, (t2 - c2) / 2}};
    double a[4][4] = {{k[0][0], k[0][1], k[1][0], k[1][1]},
                      {k[0][1], k[0][2], k[1][1], k[1][2]},
                      {k[1][0], k[1][1], k[2][0], k[2][1]},
                      {k[1][1], k[1][2], k[2][1], k[2][2]}};
    memcpy(gram + 16 * n, a, sizeof a);
    det[n] = det4(a);
  }
  free(c);
}

/* Fisher information on (x0, y0, vx, vy) of each target from bearings along a path, and
 * its determinant: nine sums. */
void track_fisher(const double *t, const double *path, const double *states, double sigma,
                  long trials, long m, double *fisher, double *det) {
  for (long n = 0; n < trials; n++) {
    const double *x = states + 4 * n;
    double k[3][3] = {{0}};
#pragma omp simd reduction(+ : k)
    for (long i = 0; i < m; i++) {
      const double u = t[i] - t[0];
      const double dx = x[0] + u * x[2] - path[2 * i], dy = x[1] + u * x[3] - path[2 * i + 1];
      const double w = 1 / ((dx * dx + dy * dy) * sigma), a = dy * w, b = -dx * w;
      const double v[3] = {a * a, a * b, b * b};
      for (int j = 0; j < 3; j++) {
        k[0][j] += v[j];
        k[1][j] += u * v[j];
        k[2][j] += u * u * v[j];
      }
    }
    double a[4][4];
    for (int i = 0; i < 2; i++)
      for (int j = 0; j < 2; j++) {
        a[i][j] = k[0][i + j];
        a[i][2 + j] = a[2 + j][i] = k[1][i + j];
        a[2 + i][2 + j] = k[2][i + j];
      }
    memcpy(fisher + 16 * n, a, sizeof a);
    det[n] = det4(a);
  }
}
