/* Maximum likelihood from bearings: the pseudo-linear start, then Gauss-Newton with
 * halved steps, on normal equations by Cholesky; trial by trial. */
#include <math.h>
#include <string.h>

static int solve(double a[4][4], double *b) {
  for (int j = 0; j < 4; j++) {
    for (int i = j; i < 4; i++) {
      double s = a[i][j];
      for (int k = 0; k < j; k++) s -= a[i][k] * a[j][k];
      if (i == j) {
        if (!(s > 0)) return 0;
        a[j][j] = sqrt(s);
      } else
        a[i][j] = s / a[j][j];
    }
  }
  for (int i = 0; i < 4; i++) {
    for (int k = 0; k < i; k++) b[i] -= a[i][k] * b[k];
    b[i] /= a[i][i];
  }
  for (int i = 3; i >= 0; i--) {
    for (int k = i + 1; k < 4; k++) b[i] -= a[k][i] * b[k];
    b[i] /= a[i][i];
  }
  return 1;
}

static void add(double a[4][4], double *b, const double *row, double value) {
  for (int i = 0; i < 4; i++) {
    for (int j = 0; j <= i; j++) a[i][j] += row[i] * row[j];
    b[i] += row[i] * value;
  }
}

static double cost(const double *x, const double *t, const double *z, const double *o, long m) {
  double sum = 0;
  for (long k = 0; k < m; k++) {
    const double e = z[k] - atan2(x[0] + t[k] * x[2] - o[2 * k], x[1] + t[k] * x[3] - o[2 * k + 1]);
    const double w = e - 2 * M_PI * rint(e / (2 * M_PI));
    sum += w * w;
  }
  return sum;
}

void localize(const double *t, const double *bearings, const double *o, long trials, long m,
              double *out) {
  for (long n = 0; n < trials; n++) {
    const double *z = bearings + n * m;
    double a[4][4] = {{0}}, b[4] = {0}, x[4];
    for (long k = 0; k < m; k++) {
      const double c = cos(z[k]), s = sin(z[k]), row[4] = {c, -s, t[k] * c, -t[k] * s};
      add(a, b, row, o[2 * k] * c - o[2 * k + 1] * s);
    }
    if (!solve(a, b)) memset(b, 0, sizeof b);
    memcpy(x, b, sizeof x);
    double now = cost(x, t, z, o, m);
    for (int iteration = 0; iteration < 50; iteration++) {
      memset(a, 0, sizeof a);
      memset(b, 0, sizeof b);
      for (long k = 0; k < m; k++) {
        const double dx = x[0] + t[k] * x[2] - o[2 * k], dy = x[1] + t[k] * x[3] - o[2 * k + 1];
        const double r2 = dx * dx + dy * dy, e = z[k] - atan2(dx, dy);
        const double row[4] = {dy / r2, -dx / r2, t[k] * dy / r2, -t[k] * dx / r2};
        add(a, b, row, e - 2 * M_PI * rint(e / (2 * M_PI)));
      }
      if (!solve(a, b)) break;
      double factor = 1, next[4], then = now;
      for (int half = 0; half < 20; half++, factor /= 2) {
        for (int i = 0; i < 4; i++) next[i] = x[i] + factor * b[i];
        then = cost(next, t, z, o, m);
        if (then <= now) break;
      }
      if (then > now) break;
      const double gain = now - then;
      memcpy(x, next, sizeof x);
      now = then;
      if (gain <= 1e-12 * now) break;
    }
    memcpy(out + 4 * n, x, sizeof x);
  }
}
