//! The one place where a vector path is chosen.
//!
//! A kernel is written once over [`pulp::Simd`] and runs as AVX-512, AVX2 + FMA,
//! NEON or plain scalars, whichever this CPU has. Tests run a kernel on every
//! path of the machine they are on ([`Path::available`]) and compare.

use super::element::{Element, MOST_LANES};

/// The vector paths a kernel can be run on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Path {
    /// The widest the CPU has.
    Best,
    /// 8 lanes of f64 (x86-64-v4).
    Avx512,
    /// 4 lanes of f64 with fused multiply-add (x86-64-v3).
    Avx2,
    /// One lane: the reference the others are tested against.
    Plain,
}

impl Path {
    /// The paths that this CPU can run, widest first, without `Best`.
    pub fn available() -> impl Iterator<Item = Self> {
        [Self::Avx512, Self::Avx2, Self::Plain]
            .into_iter()
            .filter(|path| path.is_available())
    }

    fn is_available(self) -> bool {
        match self {
            Self::Best | Self::Plain => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => pulp::x86::V4::try_new().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => pulp::x86::V3::try_new().is_some(),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => false,
        }
    }

    /// Runs a kernel on this path; on the best one where the CPU lacks it.
    #[inline]
    pub fn run<K: pulp::WithSimd>(self, kernel: K) -> K::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                if let Some(simd) = pulp::x86::V4::try_new() {
                    return pulp::Simd::vectorize(simd, kernel);
                }
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                if let Some(simd) = pulp::x86::V3::try_new() {
                    return pulp::Simd::vectorize(simd, kernel);
                }
            }
            Self::Plain => return kernel.with_simd(pulp::Scalar::new()),
            _ => {}
        }
        // WebAssembly has vectors or not when it is compiled, never by a look at the machine: a
        // page carries one path, half the size of two.
        #[cfg(target_arch = "wasm32")]
        return kernel.with_simd(pulp::Scalar::new());
        #[cfg(not(target_arch = "wasm32"))]
        pulp::Arch::new().dispatch(kernel)
    }
}

/// How far ahead of the numbers being read the next ones are prefetched, bytes: one page, since
/// the prefetcher of the processor stops at the end of a page.
const AHEAD: usize = 4096;

/// Prefetches what lies a page beyond `numbers`, where the processor has an instruction for it.
#[inline(always)]
pub fn prefetch<T>(numbers: &[T]) {
    #[cfg(target_arch = "x86_64")]
    if let Some(sse) = pulp::core_arch::x86::Sse::try_new() {
        let first = numbers.as_ptr().cast::<i8>().wrapping_add(AHEAD);
        for line in (0..size_of_val(numbers)).step_by(64) {
            sse._mm_prefetch::<{ core::arch::x86_64::_MM_HINT_T0 }>(first.wrapping_add(line));
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = numbers;
}

/// Beyond this many radians [`sin_cos`] takes lane by lane what the standard
/// library gives: two parts of pi/2 no longer reduce the angle exactly.
const LARGEST_REDUCED: f64 = 1e6;

// pi/2 in two parts. The first has 33 bits, so that a quadrant number below 2^20
// times it is exact, with or without fused multiply-add.
const HALF_PI: [f64; 2] = [1.570_796_326_734_125_6, 6.077_100_506_506_192e-11];

// (sin r / r - 1) / r^2, (cos r - 1 + r^2 / 2) / r^4 for |r| <= pi/4 and
// (atan q / q - 1) / q^2 for |q| <= tan(pi/8) as polynomials in the square,
// interpolated at Chebyshev nodes in 60 digits: errors below 2e-17.
const SIN: [f64; 6] = [
    -0.166_666_666_666_666_65,
    0.008_333_333_333_330_946,
    -0.000_198_412_698_367_549_7,
    2.755_731_610_068_303e-6,
    -2.505_113_145_542_795e-8,
    1.591_810_122_730_412e-10,
];
const COS: [f64; 6] = [
    0.041_666_666_666_666_664,
    -0.001_388_888_888_888_739_6,
    2.480_158_729_876_343_3e-5,
    -2.755_731_727_056_032_4e-7,
    2.087_614_602_468_974_7e-9,
    -1.138_261_486_856_432_5e-11,
];
const TAN_PI_8: f64 = 0.414_213_562_373_095_03;
const ATAN: [f64; 11] = [
    -0.333_333_333_333_333_3,
    0.199_999_999_999_955_2,
    -0.142_857_142_846_662_75,
    0.111_111_110_152_348_12,
    -0.090_909_045_772_482_96,
    0.076_921_831_704_848_5,
    -0.066_645_111_608_591_65,
    0.058_581_464_238_093_54,
    -0.050_854_367_132_677_14,
    0.039_231_282_023_743_306,
    -0.019_176_426_315_546_867,
];

#[inline(always)]
fn polynomial<S: pulp::Simd, const N: usize>(simd: S, c: &[f64; N], z: S::f64s) -> S::f64s {
    let mut sum = simd.splat_f64s(c[N - 1]);
    for &c in c[..N - 1].iter().rev() {
        sum = simd.mul_add_e_f64s(sum, z, simd.splat_f64s(c));
    }
    sum
}

/// The sum over the lanes of each vector.
///
/// By a loop: what is handed to `array::map` is compiled without the CPU features
/// of the path, and then every vector goes through memory and a call.
#[inline(always)]
pub fn lane_sums<S: pulp::Simd, T: Element, const N: usize>(
    simd: S,
    vectors: &[T::Register<S>; N],
) -> [T; N] {
    let mut sums = [T::zero(); N];
    for n in 0..N {
        sums[n] = T::lanes_sum(simd, vectors[n]);
    }
    sums
}

/// Two registers.
pub type Pair<S, T> = [<T as Element>::Register<S>; 2];

/// Vectors of pairs (x, y) that follow each other in memory, from a slice whose
/// length is even, and the numbers left over.
#[inline(always)]
pub fn pairs<S: pulp::Simd, T: Element>(flat: &[T]) -> (&[Pair<S, T>], &[T]) {
    let (vectors, _) = T::registers::<S>(flat);
    let (pairs, _) = vectors.as_chunks::<2>();
    (pairs, &flat[2 * T::lanes::<S>() * pairs.len()..])
}

/// The first numbers of the last pairs in `flat`, and the second ones, of whose numbers the
/// last `rest` are left over (fewer than two vectors take), and a vector that is 1 in the
/// lanes of those and 0 in the others, which hold other pairs of `flat`. The lanes are in an
/// order of their own, that of [`Element::lanes_of_pairs`].
#[inline(always)]
pub fn last_pairs<S: pulp::Simd, T: Element>(
    simd: S,
    flat: &[T],
    rest: usize,
) -> ([T::Register<S>; 2], T::Register<S>) {
    let width = 2 * T::lanes::<S>();
    let known = width - rest;
    let new = &T::NEW[2 * MOST_LANES - known..2 * MOST_LANES - known + width];
    let new = T::lanes_of_pairs(simd, pairs::<S, T>(new).0[0])[0];
    if flat.len() >= width {
        let last = pairs::<S, T>(&flat[flat.len() - width..]).0[0];
        return (T::lanes_of_pairs(simd, last), new);
    }
    let mut filled = [T::zero(); 2 * MOST_LANES];
    for pair in filled[..known].as_chunks_mut::<2>().0 {
        pair.copy_from_slice(&flat[..2]);
    }
    filled[known..width].copy_from_slice(flat);
    let filled = pairs::<S, T>(&filled[..width]).0[0];
    (T::lanes_of_pairs(simd, filled), new)
}

/// Sine and cosine of each lane, within 1.5 units in the last place.
///
/// A kernel calls this between its own vector operations; [`sin_cos_slice`] is
/// for whole arrays. NaN and infinity give NaN.
#[inline(always)]
pub fn sin_cos<S: pulp::Simd>(simd: S, angle: S::f64s) -> (S::f64s, S::f64s) {
    if any_large(simd, angle) {
        return by_lane(simd, angle);
    }
    let (sin, cos, bits) = reduced(simd, angle);
    let (zero, one, two) = (simd.splat_u64s(0), simd.splat_u64s(1), simd.splat_u64s(2));
    let even = simd.equal_u64s(simd.and_u64s(bits, one), zero);
    let (a, b) = (
        simd.select_f64s(even, sin, cos),
        simd.select_f64s(even, cos, sin),
    );
    let sin_positive = simd.equal_u64s(simd.and_u64s(bits, two), zero);
    let next = simd.add_u64s(bits, one);
    let cos_positive = simd.equal_u64s(simd.and_u64s(next, two), zero);
    (
        simd.select_f64s(sin_positive, a, simd.neg_f64s(a)),
        simd.select_f64s(cos_positive, b, simd.neg_f64s(b)),
    )
}

/// sin^2 and sin cos of each lane, for less than [`sin_cos`] takes: both repeat
/// after half a turn. sin^2 keeps all its digits where it is small.
#[inline(always)]
pub fn sin_products<S: pulp::Simd>(simd: S, angle: S::f64s) -> (S::f64s, S::f64s) {
    if any_large(simd, angle) {
        let (sin, cos) = by_lane(simd, angle);
        return (simd.mul_f64s(sin, sin), simd.mul_f64s(sin, cos));
    }
    let (sin, cos, bits) = reduced(simd, angle);
    let odd = simd.and_u64s(bits, simd.splat_u64s(1));
    let even = simd.equal_u64s(odd, simd.splat_u64s(0));
    let (square, product) = (simd.mul_f64s(sin, sin), simd.mul_f64s(sin, cos));
    (
        simd.select_f64s(even, square, simd.sub_f64s(simd.splat_f64s(1.0), square)),
        simd.select_f64s(even, product, simd.neg_f64s(product)),
    )
}

#[inline(always)]
fn any_large<S: pulp::Simd>(simd: S, angle: S::f64s) -> bool {
    let large = simd.greater_than_f64s(simd.abs_f64s(angle), simd.splat_f64s(LARGEST_REDUCED));
    simd.first_true_m64s(large) < S::F64_LANES
}

/// Sine and cosine of what is left of the angle beside a whole number of quarter
/// turns, and that number in the lowest bits.
#[inline(always)]
fn reduced<S: pulp::Simd>(simd: S, angle: S::f64s) -> (S::f64s, S::f64s, S::u64s) {
    // Adding 1.5 * 2^52 rounds to an integer that stands in the lowest bits.
    let shifter = simd.splat_f64s(6_755_399_441_055_744.0);
    let shifted = simd.mul_add_e_f64s(
        angle,
        simd.splat_f64s(core::f64::consts::FRAC_2_PI),
        shifter,
    );
    let quadrant = simd.sub_f64s(shifted, shifter);
    let mut r = angle;
    for part in HALF_PI {
        r = simd.negate_mul_add_e_f64s(quadrant, simd.splat_f64s(part), r);
    }
    let z = simd.mul_f64s(r, r);
    let sin = simd.mul_add_e_f64s(simd.mul_f64s(r, z), polynomial(simd, &SIN, z), r);
    let cos = simd.mul_add_e_f64s(
        simd.mul_f64s(z, z),
        polynomial(simd, &COS, z),
        simd.mul_add_e_f64s(z, simd.splat_f64s(-0.5), simd.splat_f64s(1.0)),
    );
    (sin, cos, simd.transmute_u64s_f64s(shifted))
}

/// The rare way: the widest vector has 8 lanes.
#[inline(never)]
fn by_lane<S: pulp::Simd>(simd: S, angle: S::f64s) -> (S::f64s, S::f64s) {
    let (mut sin, mut cos) = ([0.0; 8], [0.0; 8]);
    let mut angles = [0.0; 8];
    let lanes = S::F64_LANES.min(8);
    simd.partial_store_f64s(&mut angles[..lanes], angle);
    for lane in 0..lanes {
        (sin[lane], cos[lane]) = angles[lane].sin_cos();
    }
    (
        simd.partial_load_f64s(&sin[..lanes]),
        simd.partial_load_f64s(&cos[..lanes]),
    )
}

/// The angle of (x, y) against the x axis in (-pi, pi], lane by lane, within 2
/// units in the last place; 0 for (0, 0) whatever the signs.
#[inline(always)]
pub fn atan2<S: pulp::Simd>(simd: S, y: S::f64s, x: S::f64s) -> S::f64s {
    let zero = simd.splat_f64s(0.0);
    let (ax, ay) = (simd.abs_f64s(x), simd.abs_f64s(y));
    let steep = simd.greater_than_f64s(ay, ax);
    let (small, large) = (simd.min_f64s(ax, ay), simd.max_f64s(ax, ay));
    // Above tan(pi/8) turn by pi/4: atan q = pi/4 + atan((q - 1) / (q + 1)).
    let turned = simd.greater_than_f64s(small, simd.mul_f64s(simd.splat_f64s(TAN_PI_8), large));
    let over = simd.select_f64s(turned, simd.sub_f64s(small, large), small);
    let under = simd.select_f64s(turned, simd.add_f64s(small, large), large);
    let nothing = simd.equal_f64s(large, zero);
    let under = simd.select_f64s(nothing, simd.splat_f64s(1.0), under);
    let angle = small_atan(simd, simd.div_f64s(over, under));
    let quarter = simd.splat_f64s(core::f64::consts::FRAC_PI_4);
    let angle = simd.select_f64s(turned, simd.add_f64s(quarter, angle), angle);
    let half = simd.splat_f64s(core::f64::consts::FRAC_PI_2);
    let angle = simd.select_f64s(steep, simd.sub_f64s(half, angle), angle);
    let whole = simd.splat_f64s(core::f64::consts::PI);
    let behind = simd.less_than_f64s(x, zero);
    let angle = simd.select_f64s(behind, simd.sub_f64s(whole, angle), angle);
    simd.select_f64s(simd.less_than_f64s(y, zero), simd.neg_f64s(angle), angle)
}

/// The arc tangent of up to tan(pi/8).
#[inline(always)]
fn small_atan<S: pulp::Simd>(simd: S, q: S::f64s) -> S::f64s {
    let z = simd.mul_f64s(q, q);
    simd.mul_add_e_f64s(simd.mul_f64s(q, z), polynomial(simd, &ATAN, z), q)
}

/// The same as [`atan2`], for less where all points lie within pi/8 of the x axis.
#[inline(always)]
pub fn atan2_ahead<S: pulp::Simd>(simd: S, y: S::f64s, x: S::f64s) -> S::f64s {
    let end = simd.mul_f64s(simd.splat_f64s(TAN_PI_8), x);
    let beside = simd.greater_than_or_equal_f64s(simd.abs_f64s(y), end);
    if simd.first_true_m64s(beside) < S::F64_LANES {
        return atan2(simd, y, x);
    }
    small_atan(simd, simd.div_f64s(y, x))
}

/// Sines and cosines of an array on the given path; the three have one length.
pub fn sin_cos_slice(path: Path, angles: &[f64], sin: &mut [f64], cos: &mut [f64]) {
    path.run(SinCos { angles, sin, cos });
}

struct SinCos<'a> {
    angles: &'a [f64],
    sin: &'a mut [f64],
    cos: &'a mut [f64],
}

impl pulp::WithSimd for SinCos<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let (angles, rest) = S::as_simd_f64s(self.angles);
        let (sin, sin_rest) = S::as_mut_simd_f64s(self.sin);
        let (cos, cos_rest) = S::as_mut_simd_f64s(self.cos);
        for ((&angle, sin), cos) in angles.iter().zip(sin).zip(cos) {
            (*sin, *cos) = sin_cos(simd, angle);
        }
        if !rest.is_empty() {
            let (s, c) = sin_cos(simd, simd.partial_load_f64s(rest));
            simd.partial_store_f64s(sin_rest, s);
            simd.partial_store_f64s(cos_rest, c);
        }
    }
}

#[cfg(test)]
mod tests {
    use alloc::vec;
    use alloc::vec::Vec;

    use super::*;

    fn ulps(given: f64, wanted: f64) -> f64 {
        (given - wanted).abs() / (wanted.abs().max(f64::MIN_POSITIVE) * f64::EPSILON)
    }

    #[test]
    fn sine_and_cosine_on_every_path() {
        let mut angles: Vec<f64> = (-4000..4000).map(|k| f64::from(k) * 1.234_567e-3).collect();
        angles.extend((-60..60).map(|k| f64::from(k) * core::f64::consts::FRAC_PI_4));
        angles.extend([0.0, -0.0, 1e-300, 1e-9, 9.9e5, -9.9e5, 3e6, 1e22]);
        for path in Path::available() {
            let mut sin = vec![0.0; angles.len()];
            let mut cos = vec![0.0; angles.len()];
            sin_cos_slice(path, &angles, &mut sin, &mut cos);
            for (i, &angle) in angles.iter().enumerate() {
                let (s, c) = angle.sin_cos();
                // Near a multiple of pi/2 the reduced angle carries what two
                // parts of pi/2 leave.
                assert!(
                    ulps(sin[i], s) < 2.0 || (sin[i] - s).abs() < 1e-17,
                    "{path:?} sin {angle} = {} not {s}",
                    sin[i]
                );
                assert!(
                    ulps(cos[i], c) < 2.0 || (cos[i] - c).abs() < 1e-17,
                    "{path:?} cos {angle} = {} not {c}",
                    cos[i]
                );
            }
            let mut sin = [0.0; 3];
            let mut cos = [0.0; 3];
            let bad = [f64::NAN, f64::INFINITY, 1.0];
            sin_cos_slice(path, &bad, &mut sin, &mut cos);
            assert!(sin[0].is_nan() && cos[1].is_nan());
            assert!(ulps(sin[2], 1.0_f64.sin()) < 2.0);
        }
    }

    struct Atan2<'a>(&'a [f64], &'a [f64], &'a mut [f64], bool);

    impl pulp::WithSimd for Atan2<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: pulp::Simd>(self, simd: S) {
            let n = S::F64_LANES;
            for ((y, x), out) in self
                .0
                .chunks(n)
                .zip(self.1.chunks(n))
                .zip(self.2.chunks_mut(n))
            {
                let (y, x) = (simd.partial_load_f64s(y), simd.partial_load_f64s(x));
                let angle = if self.3 {
                    atan2_ahead(simd, y, x)
                } else {
                    atan2(simd, y, x)
                };
                simd.partial_store_f64s(out, angle);
            }
        }
    }

    #[test]
    fn arc_tangent_on_every_path() {
        let (mut y, mut x) = (vec![], vec![]);
        for k in 0..5000 {
            let angle = f64::from(k) * 0.001_257;
            let size = 10_f64.powi(k % 40 - 20);
            y.push(size * angle.sin());
            x.push(size * angle.cos());
        }
        for (a, b) in [
            (0.0, 0.0),
            (0.0, -1.0),
            (1.0, 0.0),
            (-1.0, 0.0),
            (1.0, 1.0),
            (-3.0, -3.0),
        ] {
            y.push(a);
            x.push(b);
        }
        for path in Path::available() {
            let mut out = vec![0.0; y.len()];
            path.run(Atan2(&y, &x, &mut out, false));
            for i in 0..y.len() {
                let wanted = y[i].atan2(x[i]);
                assert!(
                    ulps(out[i], wanted) < 2.5,
                    "{path:?} atan2({}, {}) = {} not {wanted}",
                    y[i],
                    x[i],
                    out[i]
                );
            }
            let mut ahead = vec![0.0; y.len()];
            path.run(Atan2(&y, &x, &mut ahead, true));
            assert_eq!(ahead, out, "{path:?}");
        }
    }
}
