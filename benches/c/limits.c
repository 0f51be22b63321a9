/* What the machine can do at most: vector multiply-adds, divisions, square roots,
 * sines and cosines, and bytes read. Compiled with -O3 -march=native
 * -fno-math-errno; not with -ffast-math, which would undo the rounding below. */
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
typedef double loose __attribute__((vector_size(8 * LANES), aligned(8)));
typedef long long bits __attribute__((vector_size(8 * LANES)));

static vec all(double x) {
  vec v;
  for (int l = 0; l < LANES; l++) v[l] = x;
  return v;
}

static double total(const vec *a, int n) {
  double sum = 0;
  for (int i = 0; i < n; i++)
    for (int l = 0; l < LANES; l++) sum += a[i][l];
  return sum;
}

/* 16 chains hide the latency; returns lanes done. */
double fma_rate(long repeats, double *out) {
  vec a[16];
  for (int i = 0; i < 16; i++) a[i] = all(1.0 + i);
  vec x = all(0.999999), y = all(1e-9);
  for (long r = 0; r < repeats; r++) {
#pragma GCC unroll 16
    for (int i = 0; i < 16; i++) a[i] = a[i] * x + y;
    __asm__ volatile("" : "+v"(x), "+v"(y));
  }
  *out = total(a, 16);
  return 16.0 * LANES * (double)repeats;
}

double divide_rate(long repeats, double *out) {
  vec a[8];
  for (int i = 0; i < 8; i++) a[i] = all(1.0 + i);
  vec x = all(3.7);
  for (long r = 0; r < repeats; r++) {
#pragma GCC unroll 8
    for (int i = 0; i < 8; i++) a[i] = x / a[i];
    __asm__ volatile("" : "+v"(x));
  }
  *out = total(a, 8);
  return 8.0 * LANES * (double)repeats;
}

double root_rate(long repeats, double *out) {
  double a[8 * LANES];
  for (int i = 0; i < 8 * LANES; i++) a[i] = 1.5 + i;
  for (long r = 0; r < repeats; r++) {
#pragma GCC unroll 64
    for (int i = 0; i < 8 * LANES; i++) a[i] = sqrt(a[i]);
    __asm__ volatile("" : : "r"(a) : "memory");
  }
  *out = a[0];
  return 8.0 * LANES * (double)repeats;
}

static vec choose(bits mask, vec yes, vec no) {
  return (vec)((mask & (bits)yes) | (~mask & (bits)no));
}

/* Sine and cosine of each angle from one reduction to an eighth of a turn and two
 * polynomials (Taylor's coefficients: of the right number, which is what costs). */
double sincos_rate(const double *angle, double *s, double *c, size_t n, long repeats) {
  for (long again = 0; again < repeats; again++) {
    for (size_t i = 0; i + LANES <= n; i += LANES) {
      const vec a = *(const loose *)(angle + i);
      const vec shift = all(6755399441055744.0);
      const vec shifted = a * all(0.6366197723675814) + shift;
      const vec q = shifted - shift;
      const vec r = (a - q * all(1.5707963267341256)) - q * all(6.077100506506192e-11);
      const vec z = r * r;
      vec p = z * all(1.6059043836821613e-10) + all(-2.505210838544172e-8);
      p = p * z + all(2.7557319223985893e-6);
      p = p * z + all(-1.984126984126984e-4);
      p = p * z + all(8.333333333333333e-3);
      p = p * z + all(-0.16666666666666666);
      const vec sine = (r * z) * p + r;
      vec k = z * all(-1.1470745597729725e-11) + all(2.08767569878681e-9);
      k = k * z + all(-2.755731922398589e-7);
      k = k * z + all(2.48015873015873e-5);
      k = k * z + all(-1.388888888888889e-3);
      k = k * z + all(4.1666666666666664e-2);
      const vec cosine = (z * z) * k + (z * all(-0.5) + all(1.0));
      const bits turns = (bits)shifted, odd = -(turns & 1);
      const bits s_sign = (turns & 2) << 62, c_sign = ((turns + 1) & 2) << 62;
      *(loose *)(s + i) = (vec)((bits)choose(odd, cosine, sine) ^ s_sign);
      *(loose *)(c + i) = (vec)((bits)choose(odd, sine, cosine) ^ c_sign);
    }
    __asm__ volatile("" : : "r"(s), "r"(c) : "memory");
  }
  return (double)(n / LANES * LANES) * (double)repeats;
}

/* Reads an array; returns bytes read. */
double read_rate(const double *a, size_t n, long repeats, double *out) {
  vec sum[8];
  for (int i = 0; i < 8; i++) sum[i] = all(0);
  for (long again = 0; again < repeats; again++) {
    for (size_t i = 0; i + 8 * LANES <= n; i += 8 * LANES)
#pragma GCC unroll 8
      for (int j = 0; j < 8; j++) sum[j] += *(const loose *)(a + i + j * LANES);
    __asm__ volatile("" : : "r"(a) : "memory");
  }
  *out = total(sum, 8);
  return 8.0 * (double)(n / (8 * LANES) * 8 * LANES) * (double)repeats;
}

/* Writes an array; returns bytes written. */
double write_rate(double *a, size_t n, long repeats, double *out) {
  for (long again = 0; again < repeats; again++) {
    vec value = all((double)again);
    for (size_t i = 0; i + 8 * LANES <= n; i += 8 * LANES)
#pragma GCC unroll 8
      for (int j = 0; j < 8; j++) *(loose *)(a + i + j * LANES) = value;
    __asm__ volatile("" : : "r"(a) : "memory");
  }
  *out = a[0];
  return 8.0 * (double)(n / (8 * LANES) * 8 * LANES) * (double)repeats;
}
