//! One register of f64 lanes, written as a number: operators and the elementary
//! functions that kernels need, the same text on every vector path.
//!
//! Kernels that add up work on blocks of [`LANES`] samples whatever the width of
//! the registers, so that the order of their sums does not depend on the CPU.

use core::ops::{Add, Div, Mul, Neg, Sub};

use pulp::Simd;

/// Samples in a block.
pub const LANES: usize = 8;
/// One block of samples.
pub type Block = [f64; LANES];

/// A register of lanes.
#[derive(Clone, Copy, Debug)]
pub struct Lanes<S: Simd> {
    simd: S,
    value: S::f64s,
}

impl<S: Simd> Lanes<S> {
    /// How many registers make a block.
    pub const PARTS: usize = LANES / S::F64_LANES;

    /// The same number in all lanes.
    #[inline(always)]
    pub fn splat(simd: S, value: f64) -> Self {
        let value = simd.splat_f64s(value);
        Self { simd, value }
    }

    /// The part `part` of a block.
    #[inline(always)]
    pub fn load(simd: S, block: &Block, part: usize) -> Self {
        let value = S::as_simd_f64s(block).0[part];
        Self { simd, value }
    }

    /// Writes the part `part` of a block.
    #[inline(always)]
    pub fn store(self, block: &mut Block, part: usize) {
        S::as_mut_simd_f64s(block).0[part] = self.value;
    }

    /// self * a + b.
    #[inline(always)]
    pub fn mul_add(self, a: Self, b: Self) -> Self {
        let value = self.simd.mul_add_e_f64s(self.value, a.value, b.value);
        self.with(value)
    }

    /// b - self * a.
    #[inline(always)]
    pub fn mul_from(self, a: Self, b: Self) -> Self {
        let value = self
            .simd
            .negate_mul_add_e_f64s(self.value, a.value, b.value);
        self.with(value)
    }

    /// self times a number.
    #[inline(always)]
    pub fn times(self, factor: f64) -> Self {
        self * Self::splat(self.simd, factor)
    }

    /// Square root.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.with(self.simd.sqrt_f64s(self.value))
    }

    /// Magnitude.
    #[inline(always)]
    pub fn abs(self) -> Self {
        self.with(self.simd.abs_f64s(self.value))
    }

    /// This magnitude (self must not be negative) with the sign of `sign`.
    #[inline(always)]
    fn with_sign_of(self, sign: Self) -> Self {
        let bit = self.simd.and_f64s(sign.value, self.simd.splat_f64s(-0.0));
        self.with(self.simd.or_f64s(self.value, bit))
    }

    /// `yes` where self > other, `no` elsewhere.
    #[inline(always)]
    pub fn choose_above(self, other: Self, yes: Self, no: Self) -> Self {
        let mask = self.simd.greater_than_f64s(self.value, other.value);
        self.with(self.simd.select_f64s(mask, yes.value, no.value))
    }

    #[inline(always)]
    fn with(self, value: S::f64s) -> Self {
        Self {
            simd: self.simd,
            value,
        }
    }

    /// c[0] + c[1] x + ..., by Horner's rule.
    #[inline(always)]
    fn polynomial(self, coefficients: &[f64]) -> Self {
        let mut sum = Self::splat(self.simd, 0.0);
        for &c in coefficients.iter().rev() {
            sum = sum.mul_add(self, Self::splat(self.simd, c));
        }
        sum
    }

    /// The angle of the point (`x`, self) in (-pi, pi], within two units of
    /// rounding.
    ///
    /// # Algorithm
    /// The ratio is brought below tan(pi/8) by a turn of pi/4 or pi/2; there a
    /// polynomial (Chebyshev points, 3e-18) gives the arctangent.
    #[inline(always)]
    pub fn atan2(self, x: Self) -> Self {
        let constant = |value| Self::splat(self.simd, value);
        let zero = constant(0.0);
        let (y, w) = (self.abs(), x.abs());
        // Above 3/8 of a quarter turn: from the y axis; above 1/8: from the diagonal.
        let steep = y * constant(TAN_PI_8);
        let high = |yes, no| steep.choose_above(w, yes, no);
        let middle = |yes, no| y.choose_above(w * constant(TAN_PI_8), yes, no);
        let numerator = high(-w, middle(y - w, y));
        let denominator = high(y, middle(y + w, w));
        let base = high(
            constant(core::f64::consts::FRAC_PI_2),
            middle(constant(core::f64::consts::FRAC_PI_4), zero),
        );
        let ratio = numerator / denominator;
        let square = ratio * ratio;
        let angle = base + ratio * square.polynomial(&ATAN);
        let left = constant(core::f64::consts::PI) - angle;
        zero.choose_above(x, left, angle).with_sign_of(self)
    }

    /// Sine and cosine, within two units of rounding for |x| < 2^20.
    #[inline(always)]
    pub fn sin_cos(self) -> (Self, Self) {
        let simd = self.simd;
        let constant = |value| Self::splat(simd, value);
        // Adding 1.5 * 2^52 leaves the nearest integer in the low bits.
        let shifted = self.mul_add(constant(core::f64::consts::FRAC_2_PI), constant(ROUND));
        let turns = shifted - constant(ROUND);
        let rest = turns.mul_from(constant(HALF_PI[0]), self);
        let rest = turns.mul_from(constant(HALF_PI[1]), rest);
        let rest = turns.mul_from(constant(HALF_PI[2]), rest);
        let square = rest * rest;
        let sine = rest * square.polynomial(&SIN);
        let cosine = square.polynomial(&COS);
        // The quadrant: an odd one swaps the two, the second bit turns the sign
        // of the sine, its exclusive or with the first that of the cosine.
        let quadrant = simd.transmute_u64s_f64s(shifted.value);
        let (one, two) = (simd.splat_u64s(1), simd.splat_u64s(2));
        let odd = simd.equal_u64s(simd.and_u64s(quadrant, one), one);
        let swap = |yes: Self, no: Self| self.with(simd.select_f64s(odd, yes.value, no.value));
        let negate = |quadrant: S::u64s, value: Self| {
            let mask = simd.equal_u64s(simd.and_u64s(quadrant, two), two);
            self.with(simd.select_f64s(mask, (-value).value, value.value))
        };
        let next = simd.add_u64s(quadrant, one);
        (
            negate(quadrant, swap(cosine, sine)),
            negate(next, swap(sine, cosine)),
        )
    }
}

const TAN_PI_8: f64 = 0.414_213_562_373_095_03;
const ROUND: f64 = 6_755_399_441_055_744.0;
/// pi/2 in three parts, the first two of 33 bits, so that their products with a
/// small integer are exact.
const HALF_PI: [f64; 3] = [
    1.570_796_326_734_125_6,
    6.077_100_506_303_966e-11,
    2.022_266_248_795_950_6e-21,
];
/// atan(sqrt t) / sqrt t for t in [0, tan^2 pi/8].
#[allow(clippy::excessive_precision, clippy::unreadable_literal)]
const ATAN: [f64; 13] = [
    1.0,
    -0.33333333333333326,
    0.19999999999997012,
    -0.1428571428532936,
    0.11111111085301238,
    -0.0909090805829841,
    0.07692281083678901,
    -0.06666205023178091,
    0.058768317098427496,
    -0.05217297919655059,
    0.044994415067496046,
    -0.03338645225903317,
    0.01511237643149517,
];
/// sin(sqrt t) / sqrt t for t in [0, (pi/4)^2].
#[allow(clippy::excessive_precision, clippy::unreadable_literal)]
const SIN: [f64; 8] = [
    1.0,
    -0.16666666666666666,
    0.008333333333333321,
    -0.00019841269841253397,
    2.7557319213520538e-06,
    -2.5052104768288217e-08,
    1.6058351049303359e-10,
    -7.57802138320201e-13,
];
/// cos(sqrt t) for t in [0, (pi/4)^2].
#[allow(clippy::excessive_precision, clippy::unreadable_literal)]
const COS: [f64; 9] = [
    1.0,
    -0.5,
    0.041666666666666664,
    -0.001388888888888886,
    2.4801587301563073e-05,
    -2.7557319212648283e-07,
    2.0876753870748415e-09,
    -1.147024597889514e-11,
    4.736262392223979e-14,
];

impl<S: Simd> Add for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(self.simd.add_f64s(self.value, other.value))
    }
}

impl<S: Simd> Sub for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(self.simd.sub_f64s(self.value, other.value))
    }
}

impl<S: Simd> Mul for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(self.simd.mul_f64s(self.value, other.value))
    }
}

impl<S: Simd> Div for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.with(self.simd.div_f64s(self.value, other.value))
    }
}

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.with(self.simd.neg_f64s(self.value))
    }
}

/// The sum of a block, in an order of its own.
#[inline(always)]
pub fn total(x: &Block) -> f64 {
    ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]))
}

#[cfg(test)]
mod tests {
    use super::{Block, LANES, Lanes};
    use crate::batch::simd::Path;

    struct Functions<'a>(&'a Block, &'a Block, &'a mut [Block; 3]);

    impl pulp::WithSimd for Functions<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: pulp::Simd>(self, simd: S) {
            let Self(y, x, [angle, sine, cosine]) = self;
            for part in 0..Lanes::<S>::PARTS {
                let (y, x) = (Lanes::load(simd, y, part), Lanes::load(simd, x, part));
                y.atan2(x).store(angle, part);
                let (s, c) = y.sin_cos();
                s.store(sine, part);
                c.store(cosine, part);
            }
        }
    }

    #[test]
    fn elementary_functions_on_every_path() {
        let values: std::vec::Vec<f64> = (-400..=400)
            .map(|i| f64::from(i) * 0.013 + 1e-3)
            .chain([0.0, 1e-300, -1e-9, 1e5, -1e5, 1e6])
            .collect();
        for path in Path::available() {
            for pair in values.windows(2 * LANES) {
                let (y, x) = pair.split_at(LANES);
                let (Ok(y), Ok(x)) = (Block::try_from(y), Block::try_from(x)) else {
                    unreachable!()
                };
                let mut out = [[0.0; LANES]; 3];
                path.run(Functions(&y, &x, &mut out));
                for i in 0..LANES {
                    let angle = y[i].atan2(x[i]);
                    assert!((out[0][i] - angle).abs() <= 5e-16 * angle.abs(), "{path:?}");
                    assert!((out[1][i] - y[i].sin()).abs() <= 3e-16, "{path:?} {}", y[i]);
                    assert!((out[2][i] - y[i].cos()).abs() <= 3e-16, "{path:?} {}", y[i]);
                }
            }
        }
    }
}
