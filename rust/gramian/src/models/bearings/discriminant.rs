//! The discriminant of four bearings, and the sums and choices made of it.
//!
//! D(1, 2, 3, 4) is the determinant of the four pseudo-linear rows
//! H = [cos b, -sin b, T cos b, -T sin b]. It changes sign under any swap and
//! vanishes when two instants coincide. The sum of D^2 over all quadruples is
//! the determinant of the Gram matrix (Cauchy-Binet; Lemma 1 of the source), so
//! a target at constant velocity is observable iff some D is not zero.
//!
//! Geometrically: every D vanishes iff one c = (x, y, vx, vy) satisfies
//! H c = 0 at all instants, that is tan b = (x + vx T) / (y + vy T). The
//! bearings are then those of a target that moves *on a straight line relative
//! to the observer*; c is that relative motion, and only its shape is seen,
//! not its size: the whole family k c, k > 0, gives the same bearings.
//!
//! # Source
//! Li & Sheng 2009. The printed (7) lost the factors T and T^2 in three blocks,
//! the printed (8) has index slips; Lemma 1 and (10)-(15) stand.

use super::Error;
use crate::scalar::{Real, check_finite, check_length, finite_one};
use crate::square_root::SquareRootInformation;

/// The form in which a discriminant is computed; all give the same number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Form {
    /// Eq. (15): two products of two sines. The fewest operations, the least
    /// rounding.
    #[default]
    Sines,
    /// Eq. (5): three products of three.
    Products,
    /// Eq. (13): by cotangents, where sin b12, sin b13 and sin b14 are not zero.
    Cotangents,
}

/// D of four bearings in the order given.
///
/// # Units
/// s, rad; the result is in s^2.
///
/// # Errors
/// [`Error::Cotangent`] for the cotangent form where a sine is zero,
/// [`Error::Number`].
///
/// # Source
/// Li & Sheng 2009, eq. (15), (5), (13).
///
/// ```
/// use gramian::bearings::{Form, discriminant};
/// let times = [0.0_f64, 1.0, 2.0, 3.0];
/// // tan b = T: a target that passes on a straight line.
/// let straight = times.map(f64::atan);
/// assert!(discriminant(&times, &straight, Form::Sines).unwrap().abs() < 1e-15);
/// ```
pub fn discriminant<T: Real>(times: &[T; 4], bearings: &[T; 4], form: Form) -> Result<T, Error> {
    check_finite("times", times)?;
    check_finite("bearings", bearings)?;
    let tau = |a: usize, b: usize| times[b - 1] - times[a - 1];
    let angle = |a: usize, b: usize| bearings[b - 1] - bearings[a - 1];
    let sin = |a: usize, b: usize| angle(a, b).sin();
    let cos = |a: usize, b: usize| angle(a, b).cos();
    let value = match form {
        Form::Sines => {
            tau(1, 3) * tau(2, 4) * sin(1, 2) * sin(3, 4)
                - tau(1, 2) * tau(3, 4) * sin(1, 3) * sin(2, 4)
        }
        Form::Products => {
            -tau(1, 2) * tau(3, 4) * sin(1, 4) * sin(1, 3) * cos(1, 2)
                + tau(1, 3) * tau(2, 4) * sin(1, 4) * cos(1, 3) * sin(1, 2)
                - tau(2, 3) * tau(1, 4) * cos(1, 4) * sin(1, 3) * sin(1, 2)
        }
        Form::Cotangents => {
            for other in 2..=4 {
                if sin(1, other) == T::zero() {
                    return Err(Error::Cotangent { other: other - 1 });
                }
            }
            let cot = |b: usize| cos(1, b) / sin(1, b);
            (-tau(1, 2) * tau(3, 4) * cot(2) + tau(1, 3) * tau(2, 4) * cot(3)
                - tau(2, 3) * tau(1, 4) * cot(4))
                * sin(1, 4)
                * sin(1, 3)
                * sin(1, 2)
        }
    };
    Ok(finite_one("discriminant", value)?)
}

/// Checks a track for the sums below: one bearing (and weight) for each time,
/// at least `least`, times increasing, weights not negative, all finite.
///
/// # Errors
/// [`NumberError::Length`](crate::scalar::NumberError::Length), [`Error::TooFew`], [`Error::Times`], [`Error::Weight`],
/// [`Error::Number`].
pub fn check_track<T: Real>(
    times: &[T],
    bearings: &[T],
    weights: Option<&[T]>,
    least: usize,
) -> Result<(), Error> {
    check_length("bearings", bearings.len(), times.len())?;
    if times.len() < least {
        return Err(Error::TooFew {
            given: times.len(),
            wanted: least,
        });
    }
    check_finite("times", times)?;
    check_finite("bearings", bearings)?;
    for i in 1..times.len() {
        if !(times[i] > times[i - 1]) {
            return Err(Error::Times {
                index: i,
                given: times[i].double(),
                before: times[i - 1].double(),
            });
        }
    }
    if let Some(weights) = weights {
        check_length("weights", weights.len(), times.len())?;
        if let Some(index) = weights
            .iter()
            .position(|&w| !(w >= T::zero() && w.is_finite()))
        {
            return Err(Error::Weight {
                index,
                given: weights[index].double(),
            });
        }
    }
    Ok(())
}

/// The name of the results below in errors.
const SUM: &str = "determinant";

/// The sum of D^2 (times `w_i w_j w_k w_l` if weighted) over i < j < k < l: the
/// determinant of the Gram matrix sum w H^T H, without its rounding.
///
/// O(m^4) and a sum of squares: the most accurate way there is. This is the
/// plain text of it; `batch::discriminant_sum` is the fast one.
///
/// # Errors
/// As [`check_track`], with four bearings at least; [`Error::Number`] also where the
/// sum overflows.
///
/// # Source
/// Li & Sheng 2009, Lemma 1.
pub fn discriminant_sum<T: Real>(
    times: &[T],
    bearings: &[T],
    weights: Option<&[T]>,
) -> Result<T, Error> {
    check_track(times, bearings, weights, 4)?;
    let m = times.len();
    let weight = |i: usize| weights.map_or(T::one(), |w| w[i]);
    let sin = |a: usize, b: usize| (bearings[b] - bearings[a]).sin();
    let mut sum = T::zero();
    for j in 1..m {
        for k in j + 1..m {
            let mut inner = T::zero();
            for l in k + 1..m {
                let p = (times[l] - times[j]) * sin(k, l);
                let q = (times[l] - times[k]) * sin(j, l);
                for i in 0..j {
                    let d = (times[k] - times[i]) * sin(i, j) * p
                        - (times[j] - times[i]) * sin(i, k) * q;
                    inner += weight(i) * weight(l) * d * d;
                }
            }
            sum += weight(j) * weight(k) * inner;
        }
    }
    Ok(finite_one(SUM, sum)?)
}

/// The same number from an orthogonal reduction of the rows, O(m): the product
/// of the squared diagonal of their triangular factor.
///
/// Times are centred and bearings counted from the middle one, which changes
/// nothing in exact arithmetic and keeps digits in this.
///
/// # Errors
/// As [`check_track`], with four bearings at least; [`Error::Number`] also where the
/// sum overflows.
///
/// # Source
/// Li & Sheng 2009, Lemma 1: det G is the square of the product of the diagonal.
pub fn discriminant_sum_qr<T: Real>(
    times: &[T],
    bearings: &[T],
    weights: Option<&[T]>,
) -> Result<T, Error> {
    check_track(times, bearings, weights, 4)?;
    let m = times.len();
    let (origin, half) = middle(times);
    let mut root = SquareRootInformation::<T, 4>::new();
    for i in 0..m {
        let w = weights.map_or(T::one(), |w| w[i].sqrt());
        let (s, c) = (bearings[i] - bearings[m / 2]).sin_cos();
        let time = (times[i] - origin) / half;
        // Columns in the order cos, T cos, sin, T sin: the large ones first.
        root.absorb(&[w * c, w * time * c, w * s, w * time * s]);
    }
    let d = root.root_determinant() * half * half;
    Ok(finite_one(SUM, d * d)?)
}

/// Sum of `w_i w_j sin^2(b_j - b_i)` over i < j: the determinant of the Gram
/// matrix of a target that does not move, for which two bearings suffice.
///
/// # Errors
/// As [`check_track`], with two bearings at least; [`Error::Number`] also where the
/// sum overflows.
///
/// # Source
/// Xu et al. 2009, eq. (14), with w = 1 / (sigma r)^2.
pub fn fixed_target_sum<T: Real>(
    times: &[T],
    bearings: &[T],
    weights: Option<&[T]>,
) -> Result<T, Error> {
    check_track(times, bearings, weights, 2)?;
    let weight = |i: usize| weights.map_or(T::one(), |w| w[i]);
    let mut sum = T::zero();
    for j in 1..times.len() {
        let mut inner = T::zero();
        for i in 0..j {
            let s = (bearings[j] - bearings[i]).sin();
            inner += weight(i) * s * s;
        }
        sum += weight(j) * inner;
    }
    Ok(finite_one(SUM, sum)?)
}

/// The same number as [`fixed_target_sum`] from the rows [cos b, -sin b], O(m).
///
/// # Errors
/// As [`check_track`], with two bearings at least; [`Error::Number`] also where the
/// sum overflows.
///
/// # Source
/// Xu et al. 2009, eq. (14), as the determinant of two columns.
pub fn fixed_target_sum_qr<T: Real>(
    times: &[T],
    bearings: &[T],
    weights: Option<&[T]>,
) -> Result<T, Error> {
    check_track(times, bearings, weights, 2)?;
    let mut root = SquareRootInformation::<T, 2>::new();
    for (i, &bearing) in bearings.iter().enumerate() {
        let w = weights.map_or(T::one(), |w| w[i].sqrt());
        let (s, c) = (bearing - bearings[bearings.len() / 2]).sin_cos();
        root.absorb(&[w * c, w * s]);
    }
    let d = root.root_determinant();
    Ok(finite_one(SUM, d * d)?)
}

/// The middle of a span of times and half its length.
pub(crate) fn middle<T: Real>(times: &[T]) -> (T, T) {
    let (first, last) = (times[0], times[times.len() - 1]);
    let half = (last - first) * T::of(0.5);
    (first + half, if half > T::zero() { half } else { T::one() })
}
