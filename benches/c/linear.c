/* Many linear systems x' = A x, y = C x: observability matrices, levels and Gramians;
 * and Gram matrices of rows. Plain loops that the compiler turns into vectors. */
#include <math.h>

/* [C; CA; ..; CA^(n-1)] of each system. */
void observability_matrix(const double *a, const double *c, long systems, long states,
                          long outputs, double *out) {
  const long n = states, p = outputs;
  for (long s = 0; s < systems; s++) {
    const double *A = a + s * n * n, *C = c + s * p * n;
    double *block = out + s * n * p * n;
    for (long i = 0; i < p * n; i++) block[i] = C[i];
    for (long power = 1; power < n; power++, block += p * n)
      for (long i = 0; i < p; i++) {
        const double *from = block + i * n;
        double *restrict to = block + (p + i) * n;
        for (long j = 0; j < n; j++) to[j] = 0;
        for (long k = 0; k < n; k++)
          for (long j = 0; j < n; j++) to[j] += from[k] * A[k * n + j];
      }
  }
}

enum { MOST = 32 }; /* states */

/* The part of `v` that the first `rank` directions leave, of length 1; 0 if nothing. */
static int new_direction(double q[MOST][MOST], long rank, double *v, long n, double tolerance) {
  double before = 0, after = 0;
  for (long j = 0; j < n; j++) before += v[j] * v[j];
  /* Twice is enough. */
  for (int again = 0; again < 2; again++)
    for (long k = 0; k < rank; k++) {
      double along = 0;
      for (long j = 0; j < n; j++) along += v[j] * q[k][j];
      for (long j = 0; j < n; j++) v[j] -= along * q[k][j];
    }
  for (long j = 0; j < n; j++) after += v[j] * v[j];
  if (!(after > tolerance * tolerance * before)) return 0;
  const double scale = 1 / sqrt(after);
  for (long j = 0; j < n; j++) q[rank][j] = scale * v[j];
  return 1;
}

/* The rank of each system and the level of each state: after how many derivatives the
 * outputs tell it, or inf. Only what a derivative adds goes through A again. */
void levels(const double *a, const double *c, long systems, long states, long outputs,
            double tolerance, double *rank_out, double *level) {
  const long n = states;
  double q[MOST][MOST], v[MOST];
  for (long s = 0; s < systems; s++) {
    const double *A = a + s * n * n, *C = c + s * outputs * n;
    double *of = level + s * n, left[MOST];
    for (long j = 0; j < n; j++) {
      of[j] = INFINITY;
      left[j] = 1;
    }
    long first = 0, rank = 0;
    for (long k = 0; k < n; k++) {
      const long last = rank, rows = k ? last - first : outputs;
      for (long i = 0; i < rows && rank < n; i++) {
        if (k) {
          for (long j = 0; j < n; j++) v[j] = 0;
          for (long l = 0; l < n; l++)
            for (long j = 0; j < n; j++) v[j] += q[first + i][l] * A[l * n + j];
        } else
          for (long j = 0; j < n; j++) v[j] = C[i * n + j];
        rank += new_direction(q, rank, v, n, tolerance);
      }
      for (long i = last; i < rank; i++)
        for (long j = 0; j < n; j++) left[j] -= q[i][j] * q[i][j];
      for (long j = 0; j < n; j++)
        if (of[j] > n && left[j] < tolerance) of[j] = (double)k;
      if (rank == last || rank == n) break;
      first = last;
    }
    rank_out[s] = (double)rank;
  }
}

/* Eight systems side by side, a lane each: no loop is as short as a small matrix. */
enum { W = 8, SQUARE = 16 * 16 };
typedef double lanes[W] __attribute__((aligned(8 * W)));

/* out = A B, or A^T B. */
static void product(const lanes *a, const lanes *b, long n, int transposed, lanes *restrict out) {
  const long row = transposed ? 1 : n, column = transposed ? n : 1;
  for (long i = 0; i < n; i++)
    for (long j = 0; j < n; j++) {
      double sum[W] = {0};
      for (long k = 0; k < n; k++)
        for (int l = 0; l < W; l++) sum[l] += a[i * row + k * column][l] * b[k * n + j][l];
      for (int l = 0; l < W; l++) out[i * n + j][l] = sum[l];
    }
}

static void copy(const lanes *from, long size, lanes *restrict to) {
  for (long i = 0; i < size; i++)
    for (int l = 0; l < W; l++) to[i][l] = from[i][l];
}

/* The window (w, phi) with (next_w, next_phi) after it. */
static void join(lanes *w, lanes *phi, const lanes *next_w, const lanes *next_phi, long n) {
  lanes half[SQUARE], made[SQUARE];
  product(next_w, phi, n, 0, half);
  product(phi, half, n, 1, made);
  for (long i = 0; i < n * n; i++)
    for (int l = 0; l < W; l++) w[i][l] += made[i][l];
  product(next_phi, phi, n, 0, made);
  copy(made, n * n, phi);
}

/* Sum over the samples k of (C A^k)^T C A^k, windows doubled. At most 16 states. */
void gramians(const double *a, const double *c, long systems, long states, long outputs,
              long samples, double *out) {
  const long n = states, size = n * n;
  lanes w[SQUARE], phi[SQUARE], all[SQUARE], through[SQUARE], was_w[SQUARE], was_phi[SQUARE];
  for (long first = 0; first < systems; first += W) {
    const long here = systems - first < W ? systems - first : W;
    for (int l = 0; l < W; l++) {
      const long s = first + (l < here ? l : 0);
      const double *C = c + s * outputs * n;
      for (long i = 0; i < n; i++)
        for (long j = 0; j < n; j++) {
          double sum = 0;
          for (long k = 0; k < outputs; k++) sum += C[k * n + i] * C[k * n + j];
          w[i * n + j][l] = sum;
          phi[i * n + j][l] = a[s * size + i * n + j];
        }
    }
    int begun = 0;
    for (long left = samples; left > 0; left /= 2) {
      if (left % 2 && begun) join(all, through, w, phi, n);
      if (left % 2 && !begun) {
        copy(w, size, all);
        copy(phi, size, through);
        begun = 1;
      }
      if (left == 1) break;
      copy(w, size, was_w);
      copy(phi, size, was_phi);
      join(w, phi, was_w, was_phi, n);
    }
    for (long l = 0; l < here; l++)
      for (long i = 0; i < size; i++) out[(first + l) * size + i] = all[i][l];
  }
}

/* Rows of four, four products at a time. */
void gram4(const double *rows, long trials, long samples, double *out) {
  for (long t = 0; t < trials; t++) {
    double sum[16] = {0};
    const double *r = rows + 4 * samples * t;
    for (long k = 0; k < samples; k++, r += 4)
      for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) sum[4 * i + j] += r[i] * r[j];
    for (int i = 0; i < 16; i++) out[16 * t + i] = sum[i];
  }
}
