//! One register of lanes, written as a number: operators and the elementary
//! functions that kernels need, the same text on every vector path.
//!
//! Kernels that add up work on blocks of [`LANES`] samples whatever the width of
//! the registers, so that the order of their sums does not depend on the CPU.

use alloc::vec;
use alloc::vec::Vec;
use core::ops::{Add, Deref, DerefMut, Div, Mul, Neg, Sub};

use pulp::Simd;

use super::element::Element;
use super::simd;
use crate::numbers::lane::Lane;

/// Samples in a block.
pub const LANES: usize = 8;
/// One block of samples.
pub type Block = [f64; LANES];

/// Blocks that begin where a line of the cache does: a register that lies across two lines
/// takes twice the time.
#[derive(Debug)]
pub struct Blocks {
    numbers: Vec<f64>,
    first: usize,
}

impl Blocks {
    /// `count` blocks of zeros.
    pub fn zeros(count: usize) -> Self {
        let numbers = vec![0.0; LANES * (count + 1) - 1];
        // Any other place does as well, only slower.
        let first = numbers.as_ptr().align_offset(64).min(LANES - 1);
        Self { numbers, first }
    }
}

impl Deref for Blocks {
    type Target = [Block];
    #[inline]
    fn deref(&self) -> &[Block] {
        self.numbers[self.first..].as_chunks().0
    }
}

impl DerefMut for Blocks {
    #[inline]
    fn deref_mut(&mut self) -> &mut [Block] {
        self.numbers[self.first..].as_chunks_mut().0
    }
}

/// A register of lanes of numbers.
#[derive(Clone, Copy, Debug)]
pub struct Vector<S: Simd, T: Element> {
    simd: S,
    value: T::Register<S>,
}

/// A register of lanes of f64.
pub type Lanes<S> = Vector<S, f64>;

impl<S: Simd, T: Element> Vector<S, T> {
    /// A register as it is.
    #[inline(always)]
    pub fn new(simd: S, value: T::Register<S>) -> Self {
        Self { simd, value }
    }

    /// The register itself.
    #[inline(always)]
    pub fn register(self) -> T::Register<S> {
        self.value
    }

    /// The sum of the lanes.
    #[inline(always)]
    pub fn sum(self) -> T {
        T::lanes_sum(self.simd, self.value)
    }

    /// The same number in all lanes.
    #[inline(always)]
    pub fn splat(simd: S, value: T) -> Self {
        Self::new(simd, T::lanes_splat(simd, value))
    }

    #[inline(always)]
    fn with(self, value: T::Register<S>) -> Self {
        Self {
            simd: self.simd,
            value,
        }
    }
}

impl<S: Simd> Lanes<S> {
    /// How many registers make a block.
    pub const PARTS: usize = LANES / S::F64_LANES;

    /// The next lanes of a slice that holds at least as many.
    #[inline(always)]
    pub fn of(simd: S, from: &[f64]) -> Self {
        let value = S::as_simd_f64s(from).0[0];
        Self { simd, value }
    }

    /// Writes to the next lanes of a slice that holds at least as many.
    #[inline(always)]
    pub fn put(self, to: &mut [f64]) {
        S::as_mut_simd_f64s(to).0[0] = self.value;
    }

    /// 1 where self is above `low` and below `high`, 0 elsewhere.
    #[inline(always)]
    pub fn inside(self, low: f64, high: f64) -> Self {
        let simd = self.simd;
        let above = simd.greater_than_f64s(self.value, simd.splat_f64s(low));
        let below = simd.less_than_f64s(self.value, simd.splat_f64s(high));
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        self.with(simd.select_f64s(above, simd.select_f64s(below, one, zero), zero))
    }

    /// The same as [`Lane::atan2`], for less where all points lie within pi/8 of the x axis.
    #[inline(always)]
    pub fn atan2_ahead(self, x: Self) -> Self {
        self.with(simd::atan2_ahead(self.simd, self.value, x.value))
    }

    /// The least of the lanes.
    #[inline(always)]
    pub fn least(self) -> f64 {
        self.simd.reduce_min_f64s(self.value)
    }

    /// The part `part` of a block.
    #[inline(always)]
    pub fn load(simd: S, block: &Block, part: usize) -> Self {
        let value = S::as_simd_f64s(block).0[part];
        Self { simd, value }
    }

    /// The part `part` of a block, in lanes like these.
    #[inline(always)]
    pub fn load_like(self, block: &Block, part: usize) -> Self {
        Self::load(self.simd, block, part)
    }

    /// Writes the part `part` of a block.
    #[inline(always)]
    pub fn store(self, block: &mut Block, part: usize) {
        S::as_mut_simd_f64s(block).0[part] = self.value;
    }
}

impl<S: Simd, T: Element> Add for Vector<S, T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(T::lanes_add(self.simd, self.value, other.value))
    }
}

impl<S: Simd, T: Element> Sub for Vector<S, T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(T::lanes_sub(self.simd, self.value, other.value))
    }
}

impl<S: Simd, T: Element> Mul for Vector<S, T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(T::lanes_mul(self.simd, self.value, other.value))
    }
}

impl<S: Simd, T: Element> Div for Vector<S, T> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.with(T::lanes_div(self.simd, self.value, other.value))
    }
}

impl<S: Simd, T: Element> Neg for Vector<S, T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.with(T::lanes_neg(self.simd, self.value))
    }
}

impl<S: Simd, T: Element> Lane for Vector<S, T> {
    #[inline(always)]
    fn splat(self, value: f64) -> Self {
        Self::splat(self.simd, T::of(value))
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        self.with(T::lanes_mul_add(
            self.simd,
            self.value,
            factor.value,
            term.value,
        ))
    }
    #[inline(always)]
    fn negate_mul_add(self, factor: Self, term: Self) -> Self {
        self.with(T::lanes_negate_mul_add(
            self.simd,
            self.value,
            factor.value,
            term.value,
        ))
    }
    #[inline(always)]
    fn times(self, factor: f64) -> Self {
        self * Self::splat(self.simd, T::of(factor))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.with(T::lanes_abs(self.simd, self.value))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.with(T::lanes_min(self.simd, self.value, other.value))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.with(T::lanes_max(self.simd, self.value, other.value))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.with(T::lanes_sqrt(self.simd, self.value))
    }
    #[inline(always)]
    fn hypot(self, other: Self) -> Self {
        Lane::sqrt(Lane::mul_add(self, self, other * other))
    }
    #[inline(always)]
    fn inverted([x, y]: [Self; 2], scale: Self) -> [Self; 2] {
        let inverse = Lane::recip(Lane::mul_add(x, x, y * y) * scale);
        [x * inverse, y * inverse]
    }
    #[inline(always)]
    fn recip(self) -> Self {
        Self::splat(self.simd, T::one()) / self
    }
    #[inline(always)]
    fn recip_or_zero(self) -> Self {
        let simd = self.simd;
        let tiny = T::lanes_splat(simd, T::one() / T::MAX);
        let (zero, inverse) = (T::lanes_splat(simd, T::zero()), Lane::recip(self).value);
        self.with(T::lanes_select_at_most(
            simd, self.value, tiny, zero, inverse,
        ))
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sine, cosine) = T::lanes_sin_cos(self.simd, self.value);
        (self.with(sine), self.with(cosine))
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        self.with(T::lanes_atan2(self.simd, self.value, x.value))
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.with(T::lanes_ln(self.simd, self.value))
    }
    #[inline(always)]
    fn round(self) -> Self {
        // Adding 1.5 * 2^52 (2^22) leaves no digits behind the point.
        let shifter = Self::splat(self.simd, T::of(1.5) / T::EPSILON);
        self + shifter - shifter
    }
    #[inline(always)]
    fn remainder(self, divisor: Self) -> Self {
        self.with(T::lanes_remainder(self.simd, self.value, divisor.value))
    }
    #[inline(always)]
    fn select_greater(self, other: Self, yes: Self, no: Self) -> Self {
        let (a, b) = (self.value, other.value);
        self.with(T::lanes_select_greater(
            self.simd, a, b, yes.value, no.value,
        ))
    }
    #[inline(always)]
    fn any_greater(self, other: Self) -> bool {
        T::lanes_any_greater(self.simd, self.value, other.value)
    }
}

/// The sum of a block, in an order of its own.
#[inline(always)]
pub fn total(x: &Block) -> f64 {
    ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::simd::Path;
    use crate::numbers::angle::wrapped;

    /// Every function of a vector against that of a number, lane by lane.
    struct Functions<'a>(&'a [f64], &'a [f64]);

    impl pulp::WithSimd for Functions<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let near = |a: f64, b: f64| {
                a == b || a.is_nan() && b.is_nan() || (a - b).abs() <= 2.5 * f64::EPSILON * b.abs()
            };
            for &x in self.0 {
                for y in self.1.chunks_exact(LANES) {
                    let mut block = [0.0; LANES];
                    block.copy_from_slice(y);
                    for part in 0..Lanes::<S>::PARTS {
                        let (a, b) = (Lanes::splat(simd, x), Lanes::load(simd, &block, part));
                        let vectors = [
                            a.min(b),
                            a.max(b),
                            a.hypot(b),
                            a.atan2(b),
                            Lanes::inverted([b, a + b], b)[1],
                            b.round(),
                            b.abs(),
                            b.recip(),
                            a.select_greater(b, a + b, a - b),
                            b.abs().recip_or_zero(),
                            b.remainder(a),
                            wrapped(b),
                        ];
                        for (k, found) in vectors.into_iter().enumerate() {
                            let mut out = [0.0; LANES];
                            found.store(&mut out, part);
                            let lanes = part * S::F64_LANES..(part + 1) * S::F64_LANES;
                            for lane in lanes {
                                let b = block[lane];
                                let wanted = [
                                    Lane::min(x, b),
                                    Lane::max(x, b),
                                    Lane::hypot(x, b),
                                    Lane::atan2(x, b),
                                    Lane::inverted([b, x + b], b)[1],
                                    b.round(),
                                    b.abs(),
                                    b.recip(),
                                    x.select_greater(b, x + b, x - b),
                                    b.abs().recip_or_zero(),
                                    b.remainder(x),
                                    wrapped(b),
                                ][k];
                                assert!(
                                    near(out[lane], wanted),
                                    "{k}: {x} {b}: {} {wanted}",
                                    out[lane]
                                );
                            }
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn blocks_have_their_number_and_place() {
        for count in [0, 1, 2, 7, 64] {
            let mut blocks = Blocks::zeros(count);
            assert_eq!(blocks.len(), count);
            assert_eq!(blocks.as_ptr().align_offset(64), 0);
            blocks.fill([1.0; LANES]);
            assert!(blocks.iter().all(|block| *block == [1.0; LANES]));
        }
    }

    #[test]
    fn vectors_do_what_numbers_do() {
        let x = [0.0, -0.0, 1.0, -2.5, 3e5];
        let y = [
            1.0,
            -1.0,
            0.3,
            -7.25,
            1e-9,
            123_456.789,
            -3.0,
            1e9,
            0.0,
            -0.0,
            3.15,
            -3.2,
            1e4,
            -1e7,
            6.6,
            1e14,
        ];
        for path in Path::available() {
            path.run(Functions(&x, &y));
        }
    }
}
