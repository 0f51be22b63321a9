/* Observability matrices [C; CA; ..; CA^(n-1)] of many systems, and Gram matrices of
 * rows, each as three plain loops that the compiler turns into vectors. */

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
