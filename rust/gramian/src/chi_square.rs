//! The chi-square distribution: how likely a sum of squares is.

use crate::scalar::{NumberError, Real, check_finite, check_positive};

/// The probability that a chi-square variable of `dof` degrees of freedom, not
/// necessarily a whole number, exceeds `value`. 1 for a value not above 0.
///
/// # Errors
/// [`NumberError::NotFinite`] for `value`, [`NumberError::OutOfRange`] for `dof`
/// that is not positive and finite.
///
/// # Source
/// The regularised incomplete gamma function Q(dof/2, value/2) by its series and
/// its continued fraction, for many degrees of freedom by its uniform expansion:
/// NIST Digital Library of Mathematical Functions 8.7.1, 8.9.2 and 8.12.4.
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
    let half = T::of(0.5);
    let (a, x) = (dof * half, value * half);
    if !(x > T::zero()) || !(a > T::zero()) {
        return T::one();
    }
    if !x.is_finite() || !(T::one() / a).is_finite() {
        return T::zero();
    }
    // The logarithms of the front factor cancel ever more digits as a grows, while
    // what the expansion leaves out shrinks with 1 / a.
    let many = if T::EPSILON.double() > 1e-10 {
        100.0
    } else {
        1e5
    };
    if a > T::of(many) {
        return uniform(a, x);
    }
    // x^a exp(-x) / Gamma(a), in logarithms so that nothing overflows.
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    let one = T::one();
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

/// Q(a, x) for large a: the normal distribution in eta and its first correction.
fn uniform<T: Real>(a: T, x: T) -> T {
    let (one, two, half) = (T::one(), T::of(2.0), T::of(0.5));
    // (x - a) / a; half eta^2 = mu - ln(1 + mu), by its series where that cancels.
    let mu = (x - a) / a;
    let near = mu.abs() < T::of(0.05);
    let half_square = if near {
        let series = (2..16).rev().fold(T::zero(), |sum, k| {
            let sign = if k % 2 == 0 { one } else { -one };
            sum * mu + sign / T::of(f64::from(k))
        });
        mu * mu * series
    } else {
        mu - mu.ln_1p()
    };
    let size = (two * half_square).sqrt();
    let eta = if mu < T::zero() { -size } else { size };
    let exponent = a * half_square;
    // 1 / mu - 1 / eta.
    let correction = if near {
        let [c0, c1, c2, c3] =
            [-1.0 / 3.0, 1.0 / 12.0, -2.0 / 135.0, 1.0 / 864.0].map(|c: f64| T::of(c));
        let (c4, c5) = (T::of(1.0 / 2835.0), T::of(-139.0 / 777_600.0));
        c0 + eta * (c1 + eta * (c2 + eta * (c3 + eta * (c4 + eta * c5))))
    } else {
        one / mu - one / eta
    };
    // Half the complement of the error function of sqrt(exponent).
    let normal = half * tail(two * exponent, one);
    let normal = if eta < T::zero() {
        one - normal
    } else {
        normal
    };
    let density = (-exponent).exp() / (T::two_pi().sqrt() * a.sqrt());
    (normal + density * correction).clamp(T::zero(), one)
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
    let inverse = one / x;
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
    (x - T::of(0.5)) * x.ln() - x + T::of(0.918_938_533_204_672_7) + series * inverse - product.ln()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        // Computed with 30 digits.
        for (value, dof, wanted) in [
            (1.0, 1.0, 0.317_310_507_862_914_1),
            (57.0, 57.0, 0.475_085_947_998_135_36),
            (100.0, 57.0, 3.761_931_029_332_337_3e-4),
            (400.0, 57.0, 5.304_572_599_515_035e-53),
            (0.5, 10.0, 0.999_993_388_289_439),
            (1000.0, 1000.0, 0.494_052_853_829_239_64),
        ] {
            let given: f64 = survival(value, dof).unwrap();
            assert!(
                (given / wanted - 1.0).abs() < 1e-12,
                "{value} {dof}: {given} not {wanted}"
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
        assert!((survival(57.0_f32, 57.0).unwrap() - 0.475_085_9).abs() < 1e-4);
        assert!(survival(f64::NAN, 3.0).is_err());
        assert!(survival(1.0, 0.0_f64).is_err());
    }
}
