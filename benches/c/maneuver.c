/* Paths of the max_det law about a fixed target, with the information along them, and
 * the Fisher information along given paths. */
#include <math.h>

/* Out: det (trials, steps). */
void trajectories(const double *start, const double *target, double step, long trials, long steps,
                  double *positions, double *headings, double *det) {
  for (long n = 0; n < trials; n++) {
    double x = start[2 * n], y = start[2 * n + 1], xx = 0, xy = 0, yy = 0;
    for (long k = 0; k < steps; k++) {
      const double dx = target[0] - x, dy = target[1] - y, r2 = dx * dx + dy * dy;
      const double a = dy / r2, b = -dx / r2, r = sqrt(r2);
      xx += a * a;
      xy += a * b;
      yy += b * b;
      const double heading = atan2(dx, dy) + M_PI / 2 - 2 * atan(step / r);
      const long at = n * steps + k;
      positions[2 * at] = x;
      positions[2 * at + 1] = y;
      headings[at] = heading;
      det[at] = xx * yy - xy * xy;
      x += step * sin(heading);
      y += step * cos(heading);
    }
  }
}

void path_fisher(const double *positions, const double *target, long trials, long samples,
                 double *out) {
  for (long n = 0; n < trials; n++) {
    const double *p = positions + 2 * samples * n;
    double xx = 0, xy = 0, yy = 0;
#pragma omp simd reduction(+ : xx, xy, yy)
    for (long k = 0; k < samples; k++) {
      const double dx = target[0] - p[2 * k], dy = target[1] - p[2 * k + 1];
      const double w = 1 / (dx * dx + dy * dy), a = dy * w, b = -dx * w;
      xx += a * a;
      xy += a * b;
      yy += b * b;
    }
    out[4 * n] = xx;
    out[4 * n + 1] = out[4 * n + 2] = xy;
    out[4 * n + 3] = yy;
  }
}
