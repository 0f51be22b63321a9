/* What the machine can do at most, one thread: vector multiply-adds, sines and
 * cosines by the C library's vector functions, and bytes through memory. */
#include <math.h>
#include <stddef.h>

#if defined(__AVX512F__)
#define LANES 8
#elif defined(__AVX__)
#define LANES 4
#else
#define LANES 2
#endif
typedef double vec __attribute__((vector_size(8 * LANES)));

/* 16 chains hide the latency; returns lanes done. */
double fma_rate(long repeats, double *out) {
  vec a[16];
  for (int i = 0; i < 16; i++)
    for (int l = 0; l < LANES; l++) a[i][l] = 1.0 + i + l;
  vec x, y;
  for (int l = 0; l < LANES; l++) { x[l] = 0.999999; y[l] = 1e-9; }
  for (long r = 0; r < repeats; r++) {
#pragma GCC unroll 16
    for (int i = 0; i < 16; i++) a[i] = a[i] * x + y;
    __asm__ volatile("" : "+v"(x), "+v"(y));
  }
  vec sum = a[0];
  for (int i = 1; i < 16; i++) sum += a[i];
  *out = 0;
  for (int l = 0; l < LANES; l++) *out += sum[l];
  return 16.0 * LANES * (double)repeats;
}

/* Two loops: in one, gcc merges sin and cos of an angle into a scalar call. */
void sincos_rate(const double *angle, double *s, double *c, size_t n) {
  for (size_t i = 0; i < n; i++) s[i] = sin(angle[i]);
  for (size_t i = 0; i < n; i++) c[i] = cos(angle[i]);
}

/* Reads two arrays, writes one: 24 bytes an entry. */
void triad(double *a, const double *b, const double *c, size_t n) {
  for (size_t i = 0; i < n; i++) a[i] = b[i] + 3.0 * c[i];
}
