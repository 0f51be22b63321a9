//! The chi-square distribution: how likely a sum of squares is.

use crate::scalar::{NumberError, Real, check_finite, check_positive};

/// The probability that a chi-square variable of `dof` degrees of freedom, not
/// necessarily a whole number, exceeds `value`. 1 for a value not above 0.
///
/// Relative to 1 the error is some 1e-14 in `f64` and 1e-6 in `f32` for any number
/// of degrees of freedom: nothing of their size is subtracted on the way.
///
/// # Errors
/// [`NumberError::NotFinite`] for `value`, [`NumberError::OutOfRange`] for `dof`
/// that is not positive and finite.
///
/// # Source
/// The regularised incomplete gamma function Q(dof/2, value/2), NIST Digital Library
/// of Mathematical Functions: its series 8.7.1 and its continued fraction 8.9.2, and
/// from 20 000 degrees of freedom on, where these grow long, Temme's uniform
/// expansion 8.12.4.
///
/// ```
/// // 5 % of one squared standard normal number lie above 1.96^2.
/// let p = gramian::chi_square::survival(3.841_458_820_694_124_f64, 1.0).unwrap();
/// assert!((p - 0.05).abs() < 1e-14);
/// ```
pub fn survival<T: Real>(value: T, dof: T) -> Result<T, NumberError> {
    check_finite("value", &[value])?;
    check_positive("dof", dof)?;
    Ok(tail(value, dof))
}

/// [`survival`] for numbers that need no check: 1 where `dof` is not above 0 or
/// one is NaN, 0 for an infinite value.
pub(crate) fn tail<T: Real>(value: T, dof: T) -> T {
    let (half, one) = (T::of(0.5), T::one());
    let (a, x) = (dof * half, value * half);
    if !(x > T::zero()) || !(a > T::zero()) {
        return one;
    }
    if !x.is_finite() || !(T::one() / a).is_finite() {
        return T::zero();
    }
    if a < T::of(1e4) {
        few(a, x)
    } else {
        uniform(a, x)
    }
}

/// The probability that a sum of squared standard normal numbers with these weights exceeds
/// `value`; weights that are not above 0 do not count. The error is some 1e-9 of the result.
///
/// # Source
/// The inverse of the moment generating function along a path through its saddle point (Rice
/// 1980, Distribution of quadratic forms in normal random variables: evaluation by numerical
/// integration), which is bent towards the values where the integrand falls off as a Gaussian.
#[cfg(feature = "std")]
pub(crate) fn weighted_tail(value: f64, weights: &[f64]) -> f64 {
    let most = weights.iter().fold(0.0_f64, |most, &w| most.max(w));
    let x = value / most;
    if !(x > 0.0) {
        return 1.0;
    }
    if !x.is_finite() {
        return 0.0;
    }
    let shares = || weights.iter().filter(|&&w| w > 0.0).map(|w| w / most);
    // The first three derivatives of the logarithm of exp(-x s) / (s prod sqrt(1 - 2 w s)).
    let slopes = |s: f64| -> [f64; 3] {
        let start = [-1.0 / s - x, 1.0 / (s * s), -2.0 / (s * s * s)];
        shares().fold(start, |[first, second, third], w| {
            let part = w / (1.0 - 2.0 * w * s);
            let square = part * part;
            [
                first + part,
                second + 2.0 * square,
                third + 8.0 * square * part,
            ]
        })
    };
    // The saddle point, between the poles.
    let (mut low, mut high, mut saddle) = (0.0, 0.5, 0.25);
    for _ in 0..200 {
        let [first, second, _] = slopes(saddle);
        if first > 0.0 {
            high = saddle;
        } else {
            low = saddle;
        }
        let newton = saddle - first / second;
        let inside = newton > low && newton < high;
        let next = if inside { newton } else { 0.5 * (low + high) };
        let settled = (next - saddle).abs() <= 1e-9 * saddle;
        saddle = next;
        if settled {
            break;
        }
    }
    let [_, second, third] = slopes(saddle);
    let width = 1.0 / second.sqrt();
    // The way down is steepest along this parabola; never straight, as sums fall slowly there.
    let bend = (third * width * width * width / 6.0).max(0.2);
    // Logarithm of the size of the integrand, and its angle.
    let at = |re: f64, im: f64| -> (f64, f64) {
        let start = (-x * re - re.hypot(im).ln(), -x * im - im.atan2(re));
        shares().fold(start, |(log, angle), w| {
            let (a, b) = (1.0 - 2.0 * w * re, -2.0 * w * im);
            (log - 0.5 * a.hypot(b).ln(), angle - 0.5 * b.atan2(a))
        })
    };
    let top = at(saddle, 0.0).0;
    // The trapezoidal rule is exact but for exp(-a / step) there.
    let (step, mut sum, mut k) = (0.25, 0.5, 0.0);
    loop {
        k += 1.0;
        let u = step * k;
        let (log, angle) = at(saddle + width * bend * u * u, width * u);
        // Times the direction of the path, (i + 2 bend u) / i.
        let (size, slope) = ((log - top).exp(), 2.0 * bend * u);
        sum += size * (angle.cos() + slope * angle.sin());
        if !(size * (1.0 + slope) > 1e-16) || k > 4000.0 {
            break;
        }
    }
    (top.exp() * width * step * sum / core::f64::consts::PI).clamp(0.0, 1.0)
}

/// The value that a chi-square variable of `dof` degrees of freedom exceeds with
/// probability `alpha`: the threshold of a test, and of a likelihood region.
///
/// # Errors
/// [`NumberError::OutOfRange`] for `alpha` outside (0, 1), or `dof` that is not positive
/// and finite.
///
/// # Algorithm
/// Bisection of [`survival`], to the last digits.
///
/// ```
/// let limit = gramian::chi_square::critical(0.05, 1.0)?;
/// assert!((limit - 3.841_458_820_694_124).abs() < 1e-13);
/// # Ok::<(), gramian::scalar::NumberError>(())
/// ```
pub fn critical(alpha: f64, dof: f64) -> Result<f64, NumberError> {
    check_positive("dof", dof)?;
    if !(alpha > 0.0 && alpha < 1.0) {
        return Err(NumberError::OutOfRange {
            name: "alpha",
            given: alpha,
            allowed: "between 0 and 1",
        });
    }
    let (mut low, mut high) = (0.0, dof + 10.0);
    while tail(high, dof) > alpha && high < 1e300 {
        low = high;
        high *= 2.0;
    }
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return Ok(high);
        }
        if tail(middle, dof) > alpha {
            low = middle;
        } else {
            high = middle;
        }
    }
}

/// How well a model fits: chi-square at its best, and how often noise alone leaves more.
///
/// ```
/// use gramian::chi_square::Goodness;
/// let found = Goodness::new(91.0, 37.0);
/// assert!(found.is_misfit(Goodness::ALPHA));
/// assert_eq!(found.words(), "chi2 = 91 for 37 degrees of freedom (p = 1.9e-06)");
/// // Without degrees of freedom nothing is tested.
/// assert!(!Goodness::new(0.0, 0.0).is_misfit(0.5));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goodness {
    /// The least sum of squared residuals over sigma^2, priors included.
    pub chi2: f64,
    /// Measurements that are there and priors, less free states.
    pub dof: f64,
    /// Probability of a larger chi-square where the model is true; NaN where there is none.
    pub p_value: f64,
}

impl Goodness {
    /// "misfit" below this probability, by default.
    pub const ALPHA: f64 = 0.001;

    /// Tests a sum of squares that is left with so many degrees of freedom.
    pub fn new(chi2: f64, dof: f64) -> Self {
        Self {
            chi2,
            dof,
            p_value: survival(chi2, dof).unwrap_or(f64::NAN),
        }
    }

    /// Whether the model does not fit, at a level of the test.
    pub fn is_misfit(self, alpha: f64) -> bool {
        self.p_value < alpha
    }

    /// That the model does not fit, in words; none where it may.
    #[cfg(feature = "alloc")]
    pub fn misfit(self, alpha: f64) -> Option<alloc::string::String> {
        self.is_misfit(alpha)
            .then(|| alloc::format!("{}: the model does not fit", self.words()))
    }

    /// The test in words.
    #[cfg(feature = "alloc")]
    pub fn words(self) -> alloc::string::String {
        use crate::numbers::words::brief;
        alloc::format!(
            "chi2 = {} for {} degrees of freedom (p = {})",
            brief(self.chi2, 4),
            self.dof,
            brief(self.p_value, 2)
        )
    }
}

/// The standard normal value that `p` of all lie below, to the last digits; infinite for 0
/// and 1.
///
/// # Source
/// Wichura 1988, Algorithm AS 241, Applied Statistics 37.
#[cfg(feature = "std")]
#[allow(clippy::excessive_precision)] // As printed.
pub(crate) fn normal_quantile(p: f64) -> f64 {
    let ratio = |r: f64, above: [f64; 8], below: [f64; 8]| {
        let sum = |terms: [f64; 8]| terms.into_iter().fold(0.0, |sum, c| sum * r + c);
        sum(above) / sum(below)
    };
    let off = p - 0.5;
    if off.abs() <= 0.425 {
        let above = [
            2_509.080_928_730_122_672_7,
            33_430.575_583_588_128_105,
            67_265.770_927_008_700_853,
            45_921.953_931_549_871_457,
            13_731.693_765_509_461_125,
            1_971.590_950_306_551_442_7,
            133.141_667_891_784_377_45,
            3.387_132_872_796_366_608,
        ];
        let below = [
            5_226.495_278_852_545_925,
            28_729.085_735_721_942_674,
            39_307.895_800_092_710_61,
            21_213.794_301_586_595_867,
            5_394.196_021_424_751_107_7,
            687.187_007_492_057_908_3,
            42.313_330_701_600_911_252,
            1.0,
        ];
        return off * ratio(0.180_625 - off * off, above, below);
    }
    let tail = p.min(1.0 - p);
    let r = (-tail.ln()).sqrt();
    let size = if !r.is_finite() {
        r
    } else if r <= 5.0 {
        let above = [
            7.745_450_142_783_414_076_4e-4,
            0.022_723_844_989_269_184_583_3,
            0.241_780_725_177_450_611_77,
            1.270_458_252_452_368_382_58,
            3.647_848_324_763_204_605_04,
            5.769_497_221_460_691_405_5,
            4.630_337_846_156_545_295_9,
            1.423_437_110_749_683_577_34,
        ];
        let below = [
            1.050_750_071_644_416_843_24e-9,
            5.475_938_084_995_344_946e-4,
            0.015_198_666_563_616_457_196_6,
            0.148_103_976_427_480_074_59,
            0.689_767_334_985_100_004_55,
            1.676_384_830_183_803_849_4,
            2.053_191_626_637_758_821_87,
            1.0,
        ];
        ratio(r - 1.6, above, below)
    } else {
        let above = [
            2.010_334_399_292_288_132_65e-7,
            2.711_555_568_743_487_578_15e-5,
            0.001_242_660_947_388_078_438_6,
            0.026_532_189_526_576_123_093,
            0.296_560_571_828_504_891_23,
            1.784_826_539_917_291_335_8,
            5.463_784_911_164_114_369_9,
            6.657_904_643_501_103_777_2,
        ];
        let below = [
            2.044_263_103_389_939_785_64e-15,
            1.421_511_758_316_445_888_7e-7,
            1.846_318_317_510_054_681_8e-5,
            7.868_691_311_456_132_591e-4,
            0.014_875_361_290_850_614_852_5,
            0.136_929_880_922_735_805_31,
            0.599_832_206_555_887_937_69,
            1.0,
        ];
        ratio(r - 5.0, above, below)
    };
    if off < 0.0 { -size } else { size }
}

/// Q(a, x) by its series, or by its continued fraction where x is large.
fn few<T: Real>(a: T, x: T) -> T {
    let (half, one) = (T::of(0.5), T::one());
    let front = front(a, x);
    if x < a + one {
        let (mut term, mut sum, mut n) = (one / a, one / a, a);
        while term > sum * T::EPSILON * half {
            n += one;
            term *= x / n;
            sum += term;
        }
        (one - front * sum).clamp(T::zero(), one)
    } else {
        // Lentz's evaluation of the continued fraction; all its terms keep away
        // from zero for x >= a + 1.
        let mut b = x + one - a;
        let (mut c, mut d) = (T::INFINITY, one / b);
        let (mut fraction, mut n) = (d, T::zero());
        // It takes a few times sqrt(a).
        while n < T::of(1e4) {
            n += one;
            let numerator = n * (a - n);
            b += one + one;
            d = one / (b + numerator * d);
            c = b + numerator / c;
            let change = c * d;
            fraction *= change;
            if (change - one).abs() <= T::EPSILON {
                break;
            }
        }
        (front * fraction).clamp(T::zero(), one)
    }
}

/// x^a exp(-x) / Gamma(a).
fn front<T: Real>(a: T, x: T) -> T {
    if a < T::of(10.0) {
        // In logarithms, so that nothing overflows.
        return (a * x.ln() - x - ln_gamma(a)).exp();
    }
    // With Stirling's series the large terms cancel in the formula, not in the sum.
    let exponent = a * excess((x - a) / a) + stirling(a);
    (a / T::two_pi()).sqrt() * (-exponent).exp()
}

/// u - ln(1 + u), to all digits also where u is small.
fn excess<T: Real>(u: T) -> T {
    if !(u.abs() < T::of(0.5)) {
        return u - u.ln_1p();
    }
    // ln(1 + u) = 2 atanh r, and u - 2 r = u r.
    let two = T::one() + T::one();
    let r = u / (two + u);
    let square = r * r;
    let (mut power, mut n, mut sum) = (square, T::one(), T::zero());
    loop {
        n += two;
        let term = power / n;
        sum += term;
        if !(term > sum * T::EPSILON) {
            break;
        }
        power *= square;
    }
    r * (u - two * sum)
}

/// Q(a, x) for large a: that of a normal variable, corrected to the order 1 / a^2.
fn uniform<T: Real>(a: T, x: T) -> T {
    let (half, one) = (T::of(0.5), T::one());
    let u = (x - a) / a;
    let exponent = a * excess(u);
    let density = (-exponent).exp();
    if !(density > T::zero()) {
        return if u > T::zero() { T::zero() } else { one };
    }
    let half_tail = if exponent > T::zero() {
        half * few(half, exponent)
    } else {
        half
    };
    let normal = if u > T::zero() {
        half_tail
    } else {
        one - half_tail
    };
    let size = (excess(u) + excess(u)).sqrt();
    let eta = if u > T::zero() { size } else { -size };
    let polynomial = |coefficients: &[f64]| {
        let terms = coefficients.iter().rev();
        terms.fold(T::zero(), |sum, &c| sum * eta + T::of(c))
    };
    let first = if size < T::of(0.05) {
        polynomial(&[
            -1.0 / 3.0,
            1.0 / 12.0,
            -2.0 / 135.0,
            1.0 / 864.0,
            1.0 / 2835.0,
            -139.0 / 777_600.0,
        ])
    } else {
        one / u - one / eta
    };
    let second = polynomial(&[-1.0 / 540.0, -1.0 / 288.0, 1.0 / 378.0, -77.0 / 77_760.0]);
    let third = T::of(25.0 / 6048.0);
    let series = first + (second + third / a) / a;
    let correction = density / (T::two_pi() * a).sqrt() * series;
    (normal + correction).clamp(T::zero(), one)
}

/// What is left of ln Gamma(x) beside (x - 1/2) ln x - x + ln(2 pi) / 2.
fn stirling<T: Real>(x: T) -> T {
    let inverse = T::one() / x;
    let square = inverse * inverse;
    let series = [
        -691.0 / 360_360.0,
        1.0 / 1188.0,
        -1.0 / 1680.0,
        1.0 / 1260.0,
        -1.0 / 360.0,
        1.0 / 12.0,
    ]
    .iter()
    .fold(T::zero(), |sum, &c| sum * square + T::of(c));
    series * inverse
}

/// ln Gamma(x) for x > 0.
///
/// # Source
/// Stirling's series (NIST DLMF 5.11.1) from x = 10 on, reached by recurrence.
fn ln_gamma<T: Real>(x: T) -> T {
    let one = T::one();
    let (mut x, mut product) = (x, one);
    while x < T::of(10.0) {
        product *= x;
        x += one;
    }
    (x - T::of(0.5)) * x.ln() - x + T::of(0.918_938_533_204_672_7) + stirling(x) - product.ln()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[cfg(feature = "std")]
    #[test]
    fn a_weighted_sum_of_squares_has_the_tail_of_its_parts() {
        // Of equal weights chi-square, whatever their size, and others that do not count.
        for dof in [1_usize, 2, 3, 6, 20] {
            for value in [0.01, 0.5, 2.0, 10.0, 25.0, 60.0, 500.0] {
                let mut weights = [0.0; 21];
                weights[..dof].fill(0.03);
                let (found, wanted) = (
                    weighted_tail(0.03 * value, &weights),
                    tail(value, dof as f64),
                );
                assert!(
                    (found / wanted - 1.0).abs() < 1e-9,
                    "{dof} {value} {found} {wanted}"
                );
            }
        }
        // Of pairs of equal weights the sum of exponentials, by partial fractions.
        for value in [0.3, 4.0, 30.0, 200.0] {
            let (a, b) = (1.0_f64, 0.2_f64);
            let wanted =
                (a * (-value / (2.0 * a)).exp() - b * (-value / (2.0 * b)).exp()) / (a - b);
            let found = weighted_tail(value, &[a, b, b, a]);
            assert!(
                (found / wanted - 1.0).abs() < 1e-9,
                "{value} {found} {wanted}"
            );
        }
        assert_eq!(weighted_tail(0.0, &[1.0, 0.5]), 1.0);
        assert_eq!(weighted_tail(f64::INFINITY, &[1.0, 0.5]), 0.0);
        assert_eq!(weighted_tail(f64::NAN, &[1.0]), 1.0);
    }

    #[cfg(feature = "std")]
    #[test]
    fn a_quantile_is_the_root_of_the_critical_value() {
        for p in [
            1e-300, 1e-20, 1e-9, 1e-3, 0.07, 0.075, 0.2, 0.499, 0.5, 0.7, 0.93, 0.999,
        ] {
            let wanted = critical((2.0 * f64::min(p, 1.0 - p)).min(1.0 - 1e-16), 1.0);
            let (wanted, found) = (wanted.unwrap().sqrt(), normal_quantile(p));
            assert!(
                (found.abs() - wanted).abs() < 2e-14 * wanted.max(1.0),
                "{p} {found}"
            );
            assert!(p == 0.5 || (found < 0.0) == (p < 0.5));
        }
        assert_eq!(normal_quantile(0.0), f64::NEG_INFINITY);
        assert_eq!(normal_quantile(1.0), f64::INFINITY);
    }

    #[test]
    fn known_values() {
        // Computed with 30 digits. A tail keeps fewer: its exponent is rounded too.
        for (value, dof, wanted) in [
            (1.0, 1.0, 0.317_310_507_862_914_1),
            (57.0, 57.0, 0.475_085_947_998_135_36),
            (100.0, 57.0, 3.761_931_029_332_337_3e-4),
            (400.0, 57.0, 5.304_572_599_515_035e-53),
            (0.5, 10.0, 0.999_993_388_289_439),
            (1000.0, 1000.0, 0.494_052_853_829_239_64),
            (390.0, 300.0, 3.536_113_417_677_132e-4),
            (8300.0, 8000.0, 9.438_573_702_676_664e-3),
            (7700.0, 8000.0, 0.991_729_021_749_708_7),
            (19_900.0, 20_000.0, 0.690_582_115_138_817_4),
            (20_000.0, 20_000.0, 0.498_670_191_660_044_8),
            (20_400.0, 20_000.0, 0.023_287_322_133_598_804),
            (21_000.0, 20_000.0, 4.275_872_455_059_647e-7),
            (24_000.0, 20_000.0, 3.327_202_492_345_161e-79),
            (99_000.0, 100_000.0, 0.987_521_684_361_917_2),
            (102_500.0, 100_000.0, 1.463_562_599_836_715e-8),
            (4_005_000.0, 4_000_000.0, 0.038_591_795_507_496_29),
        ] {
            let given: f64 = survival(value, dof).unwrap();
            assert!(
                (given / wanted - 1.0).abs() < 1e-12 - 1e-13 * wanted.ln(),
                "{value} {dof}: {given} not {wanted}"
            );
            // In single precision the arguments are exact, and so near to this.
            #[allow(clippy::cast_possible_truncation)]
            let single = survival(value as f32, dof as f32).unwrap().double();
            assert!(
                (single - wanted).abs() < 2e-6,
                "{value} {dof}: {single} not {wanted}"
            );
        }
        // Many degrees of freedom, up to where neighbouring numbers are turns apart.
        for (value, dof, wanted) in [
            (2.0e5, 2.0e5 + 1e-3, 0.499_580_108_673_284_2),
            (201_500.0, 2.0e5, 0.008_969_901_996_309_764),
            (240_000.0, 220_000.0, 8.278_758_809_421_963e-189),
            (995_000.0, 1e6, 0.999_800_672_140_364_2),
            (100_020_000.0, 1e8, 0.078_656_520_715_165_52),
            (1e12, 1e12, 0.499_999_811_936_805_5),
            (1e300, 1e300, 0.5),
            (1e300, 3.0, 0.0),
            (3.0, 1e300, 1.0),
        ] {
            let given: f64 = survival(value, dof).unwrap();
            assert!(
                (given - wanted).abs() <= 1e-8 * wanted,
                "{value} {dof}: {given} not {wanted}"
            );
        }
        assert_eq!(survival(-1.0_f64, 3.0), Ok(1.0));
        assert_eq!(tail(f64::INFINITY, 3.0), 0.0);
        assert!(survival(f64::NAN, 3.0).is_err());
        assert!(survival(1.0, 0.0_f64).is_err());
    }

    #[test]
    fn huge_numbers_come_to_an_end() {
        let sizes = [1e-30, 1.0, 3e7, 1e15, 1e30, 1e38, f64::INFINITY];
        for dof in sizes {
            for value in sizes {
                #[allow(clippy::cast_possible_truncation)]
                let single = tail(value as f32, dof as f32).double();
                for p in [tail(value, dof), single] {
                    assert!((0.0..=1.0).contains(&p), "{value} {dof}: {p}");
                }
            }
        }
    }
}
