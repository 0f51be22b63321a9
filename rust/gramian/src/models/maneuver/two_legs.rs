//! Two legs against a distant target at constant velocity: where to turn, in closed form.
//!
//! When the range R is long against the track, the line of sight hardly turns. With t the
//! share of the time gone and u(t) the cross-range distance that observer and target have
//! moved against each other, a bearing's row for (cross-range, its rate, range, its rate) is
//! (1, t, -u / R, -t u / R) / (sigma R). On a straight leg u is linear in t, and the third
//! column is a combination of the first two: no range. After a turn at share tau it has a
//! corner, u = p t before it and p tau + q (t - tau) after, and the four columns are independent.
//!
//! # Source
//! Ours: the Gram matrix of 1, t, u, t u over 0 <= t <= 1, its determinant and its minor,
//! expanded.

use crate::scalar::{NumberError, Real, check_finite};

/// What two legs give, in units of the track: see [`two_leg_terms`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoLegTerms<T> {
    /// Determinant of the Gram matrix of 1, t, u, t u.
    pub determinant: T,
    /// The entry of its inverse that belongs to u: the variance of the range; infinite where
    /// the two legs have the same cross speed.
    pub range_variance: T,
}

/// The determinant and the variance of the range of two legs at cross speeds `first` and
/// `second` (observer less target, across the line of sight) with a turn at share `turn`.
///
/// With N bearings of deviation sigma over a time T the determinant of the information is
/// `determinant` (N / (sigma R)^2)^4 T^8 / R^4, and the variance of the range
/// `range_variance` sigma^2 R^4 / (N T^2), to the order of track over range and of 1 / N.
///
/// # Units
/// m/s, and shares of the time.
///
/// # Errors
/// [`NumberError`] for a turn outside [0, 1] and speeds that are not finite.
///
/// ```
/// use gramian::maneuver::two_leg_terms;
/// // Lead, then lag: with y = turn (1 - turn) the determinant is y^3 (20 y^3 - 15 y + 4) / 6480.
/// let y = 0.3_f64 * 0.7;
/// let terms = two_leg_terms(0.3, 1.0, -1.0).unwrap();
/// let closed = y.powi(3) * (20.0 * y.powi(3) - 15.0 * y + 4.0) / 6480.0;
/// assert!((terms.determinant / closed - 1.0).abs() < 1e-12);
/// ```
pub fn two_leg_terms<T: Real>(turn: T, first: T, second: T) -> Result<TwoLegTerms<T>, NumberError> {
    check_finite("first", &[first])?;
    check_finite("second", &[second])?;
    if !(turn >= T::zero() && turn <= T::one()) {
        return Err(NumberError::OutOfRange {
            name: "turn",
            given: turn.double(),
            allowed: "0 to 1",
        });
    }
    Ok(terms(turn, first, second))
}

/// [`two_leg_terms`] without a check.
fn terms<T: Real>(turn: T, p: T, q: T) -> TwoLegTerms<T> {
    let c = |x: f64| T::of(x);
    let x = turn;
    let x3 = x * x * x;
    let rest = T::one() - x;
    let y3 = x3 * rest * rest * rest;
    // Each a polynomial of the share in Horner's form.
    let pp = x3 * x * x * (c(9.0) - c(5.0) * x);
    let pq = x3 * (((c(10.0) * x - c(30.0)) * x + c(30.0)) * x - c(10.0));
    let qq = ((((c(21.0) - c(5.0) * x) * x - c(30.0)) * x + c(10.0)) * x + c(15.0)) * x;
    let qq = (qq - c(15.0)) * x + c(4.0);
    let determinant = y3 * (q - p) * (q - p) * (pp * p * p + pq * p * q + qq * q * q) / c(25_920.0);
    let m_pp = x3 * x * x * (((c(15.0) * x - c(30.0)) * x + c(20.0)) * x - c(6.0));
    let m_pq = ((c(60.0) - c(30.0) * x) * x - c(40.0)) * x + c(30.0);
    let m_pq = x3 * ((m_pq * x - c(30.0)) * x + c(10.0));
    let m_qq = ((c(15.0) * x - c(30.0)) * x + c(20.0)) * x - c(24.0);
    let m_qq = x3 * ((m_qq * x + c(30.0)) * x - c(10.0)) - T::one();
    let minor = -(m_pp * p * p + m_pq * p * q + m_qq * q * q) / c(2160.0);
    let range_variance = if determinant > T::zero() {
        minor / determinant
    } else {
        T::INFINITY
    };
    TwoLegTerms {
        determinant,
        range_variance,
    }
}

/// What two legs are best for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TwoLegGoal {
    /// The largest determinant of the information on all four states.
    Determinant,
    /// The least variance of the range at the first time.
    Range,
}

/// The best two legs: see [`best_two_legs`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoLegs<T> {
    /// The share of the time at which to turn.
    pub turn: T,
    /// Cross speed of the first leg over the observer's: 1 or -1, at a right angle to the
    /// line of sight.
    pub first: T,
    /// That of the second leg, to the other side.
    pub second: T,
    /// What they give, for an observer of speed 1.
    pub terms: TwoLegTerms<T>,
}

/// The best two legs of an observer of speed 1 against a distant target whose cross speed is
/// `cross` times the observer's, in (-1, 1).
///
/// For the determinant both legs are at right angles to the line of sight, lead then lag or
/// lag then lead. Against a target without cross speed it is largest for a turn at
/// y = turn (1 - turn) with 10 y^3 - 5 y + 1 = 0: 0.3322 or 0.6678, equally. For the range
/// the second leg is at a smaller angle: cross speed 0.69 and a turn at 0.707.
///
/// # Errors
/// [`NumberError`] for a cross speed outside (-1, 1): there the observer cannot lead.
///
/// ```
/// use gramian::maneuver::{TwoLegGoal, best_two_legs};
/// let best = best_two_legs(0.0_f64, TwoLegGoal::Determinant).unwrap();
/// let y = best.turn * (1.0 - best.turn);
/// assert!((10.0 * y.powi(3) - 5.0 * y + 1.0).abs() < 1e-7);
/// ```
pub fn best_two_legs<T: Real>(cross: T, goal: TwoLegGoal) -> Result<TwoLegs<T>, NumberError> {
    check_finite("cross", &[cross])?;
    if !(cross.abs() < T::one()) {
        return Err(NumberError::OutOfRange {
            name: "cross",
            given: cross.double(),
            allowed: "> -1 and < 1",
        });
    }
    // Half the digits: of equals the earlier turn, and the first leg to the right.
    let margin = T::one() + T::EPSILON.sqrt();
    let mut best: Option<(T, TwoLegs<T>)> = None;
    for first in [T::one(), -T::one()] {
        let at = |turn: T, second: T| terms(turn, first - cross, second - cross);
        let merit = |turn: T, second: T| match goal {
            TwoLegGoal::Determinant => at(turn, second).determinant,
            TwoLegGoal::Range => at(turn, second).range_variance.recip(),
        };
        let turn_for = |second: T| most(T::zero(), T::one(), |turn| merit(turn, second));
        let second = most(-T::one(), T::one(), |second| {
            merit(turn_for(second), second)
        });
        let turn = turn_for(second);
        let found = merit(turn, second);
        if best.is_none_or(|(most, _)| found > most * margin) {
            let terms = at(turn, second);
            let legs = TwoLegs {
                turn,
                first,
                second,
                terms,
            };
            best = Some((found, legs));
        }
    }
    best.map(|(_, legs)| legs).ok_or(NumberError::Overflow {
        result: "best turn",
    })
}

/// Where from `low` to `high` a smooth function is largest: a grid, then thirds about its
/// best point; of points that are equal to half the digits the first.
fn most<T: Real>(low: T, high: T, of: impl Fn(T) -> T) -> T {
    const CELLS: u32 = 24;
    let place = |k: u32| low + (high - low) * T::of(f64::from(k) / f64::from(CELLS));
    let margin = T::one() + T::EPSILON.sqrt();
    let mut best = (0, of(low));
    for k in 1..=CELLS {
        let value = of(place(k));
        if value > best.1 * margin {
            best = (k, value);
        }
    }
    let (mut from, mut to) = (
        place(best.0.saturating_sub(1)),
        place((best.0 + 1).min(CELLS)),
    );
    for _ in 0..45 {
        let third = (to - from) / T::of(3.0);
        if of(from + third) < of(to - third) {
            from += third;
        } else {
            to -= third;
        }
    }
    let middle = (from + to) * T::of(0.5);
    // An end of the interval is not reached by thirds.
    [low, high]
        .into_iter()
        .find(|&end| of(end) >= of(middle))
        .unwrap_or(middle)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// The Gram matrix by the midpoint rule, its determinant by elimination.
    fn by_sums(turn: f64, p: f64, q: f64) -> (f64, f64) {
        let n = 4000;
        let mut gram = nalgebra::Matrix4::<f64>::zeros();
        for k in 0..n {
            let t = (f64::from(k) + 0.5) / f64::from(n);
            let u = if t < turn {
                p * t
            } else {
                p * turn + q * (t - turn)
            };
            let row = nalgebra::Vector4::new(1.0, t, u, t * u);
            gram += row * row.transpose() / f64::from(n);
        }
        let inverse = gram.try_inverse().unwrap();
        (gram.determinant(), inverse[(2, 2)])
    }

    #[test]
    fn the_closed_form_is_the_gram_matrix() {
        for (turn, p, q) in [
            (0.3, 1.0, -1.0),
            (0.5, 1.0, 0.2),
            (0.8, -0.4, 1.3),
            (0.55, 0.1, 2.0),
        ] {
            let found = two_leg_terms(turn, p, q).unwrap();
            let (determinant, variance) = by_sums(turn, p, q);
            assert!(
                (found.determinant / determinant - 1.0).abs() < 1e-4,
                "{turn} {p} {q}"
            );
            assert!(
                (found.range_variance / variance - 1.0).abs() < 1e-4,
                "{turn} {p} {q}"
            );
        }
        assert!(
            two_leg_terms(0.5_f64, 1.0, 1.0)
                .unwrap()
                .range_variance
                .is_infinite()
        );
        assert!(two_leg_terms(1.5_f64, 1.0, -1.0).is_err());
    }

    #[test]
    fn no_other_pair_of_courses_and_turn_is_better() {
        for cross in [0.0, 0.3, -0.6] {
            for goal in [TwoLegGoal::Determinant, TwoLegGoal::Range] {
                let best = best_two_legs(cross, goal).unwrap();
                let merit = |terms: TwoLegTerms<f64>| match goal {
                    TwoLegGoal::Determinant => terms.determinant,
                    TwoLegGoal::Range => 1.0 / terms.range_variance,
                };
                let most = merit(best.terms);
                for turn in 1..50 {
                    for a in -10..=10 {
                        for b in -10..=10 {
                            let (a, b) = (f64::from(a) / 10.0, f64::from(b) / 10.0);
                            let turn = f64::from(turn) / 50.0;
                            let terms = two_leg_terms(turn, a - cross, b - cross).unwrap();
                            assert!(
                                merit(terms) <= most * (1.0 + 1e-12),
                                "{cross} {turn} {a} {b}"
                            );
                        }
                    }
                }
            }
        }
        assert!(best_two_legs(1.0_f64, TwoLegGoal::Range).is_err());
    }
}
