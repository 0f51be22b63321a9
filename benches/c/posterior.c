/* The posterior bound of 4 states, one row a step: covariance recursion, eight trials
 * side by side. rows (trials, steps, 4), out (trials, steps, 4); move, noise, prior (4, 4). */
#include <math.h>

enum { W = 8 };

void posterior(const double *rows, const double *move, const double *noise, const double *prior,
               long trials, long steps, double *out) {
  for (long first = 0; first < trials; first += W) {
    const long left = trials - first;
    double p[4][4][W], fp[4][4][W];
    for (int i = 0; i < 4; i++)
      for (int j = 0; j < 4; j++)
        for (int l = 0; l < W; l++) p[i][j][l] = prior[4 * i + j];
    for (long k = 0; k < steps; k++) {
      if (k) {
        for (int i = 0; i < 4; i++)
          for (int j = 0; j < 4; j++) {
            double s[W] = {0};
            for (int m = 0; m < 4; m++)
              for (int l = 0; l < W; l++) s[l] += move[4 * i + m] * p[m][j][l];
            for (int l = 0; l < W; l++) fp[i][j][l] = s[l];
          }
        for (int i = 0; i < 4; i++)
          for (int j = 0; j < 4; j++) {
            double s[W];
            for (int l = 0; l < W; l++) s[l] = noise[4 * i + j];
            for (int m = 0; m < 4; m++)
              for (int l = 0; l < W; l++) s[l] += fp[i][m][l] * move[4 * j + m];
            for (int l = 0; l < W; l++) p[i][j][l] = s[l];
          }
      }
      double h[4][W], ph[4][W], s[W];
      for (int l = 0; l < W; l++) {
        const double *row = rows + ((first + (l < left ? l : 0)) * steps + k) * 4;
        for (int i = 0; i < 4; i++) h[i][l] = row[i];
        s[l] = 1;
      }
      for (int i = 0; i < 4; i++) {
        for (int l = 0; l < W; l++) ph[i][l] = 0;
        for (int j = 0; j < 4; j++)
          for (int l = 0; l < W; l++) ph[i][l] += p[i][j][l] * h[j][l];
        for (int l = 0; l < W; l++) s[l] += ph[i][l] * h[i][l];
      }
      for (int l = 0; l < W; l++) s[l] = 1 / s[l];
      for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
          for (int l = 0; l < W; l++) p[i][j][l] -= ph[i][l] * ph[j][l] * s[l];
      double std[4][W];
      for (int i = 0; i < 4; i++)
        for (int l = 0; l < W; l++) std[i][l] = sqrt(p[i][i][l]);
      for (int l = 0; l < W && l < left; l++)
        for (int i = 0; i < 4; i++) out[((first + l) * steps + k) * 4 + i] = std[i][l];
    }
  }
}
