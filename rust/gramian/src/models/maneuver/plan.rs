//! How good a path is for locating a target, and how that changes with its
//! headings: the objective of the planner and its analytic gradient.
//!
//! The path starts at a point and is made of legs; a leg is some steps of one
//! length on one heading. A bearing is taken at the start and after each step.
//! The states are (x, y) of a fixed target, N = 2, or (x0, y0, vx, vy) of one at
//! constant velocity, N = 4.
//!
//! # Source
//! Information as in Xu et al. 2009, eqs. (9) and (10). The criteria are Kiefer's
//! family: D (log det), A (trace of the bound), E (smallest eigenvalue).
//!
//! ```
//! use gramian::maneuver::plan::{Criterion, Legs, Target, value};
//! use gramian::square_root::SquareRootInformation;
//! let target = Target {
//!     state: [0.0, 5000.0, 0.0, 0.0],
//!     sigma: 0.01,
//!     prior: &SquareRootInformation::<f64, 2>::new(),
//!     scale: [1.0, 1.0],
//! };
//! let along = |heading: f64| {
//!     let legs = Legs {
//!         start: [0.0, 0.0],
//!         dt: 20.0,
//!         headings: &[heading],
//!         lengths: &[100.0],
//!         counts: &[20],
//!     };
//!     value(&legs, &target, &Criterion::Trace).unwrap()
//! };
//! // Across the line of sight, not along it, where the range is never told.
//! assert!(along(1.5) < along(0.5));
//! assert_eq!(along(0.0), f64::INFINITY);
//! ```

use crate::bearings;
use crate::numbers::algebra::{dot, multiply};
use crate::scalar::{NumberError, Real, all_finite, check_finite, check_length, check_positive};
use crate::spectrum::{Spectrum, decompose, default_rtol};
use crate::square_root::SquareRootInformation;

/// What is to be made large or small.
///
/// # Source
/// Kiefer 1974, Annals of Statistics 2, the family of criteria; the information is Xu et
/// al. 2009, eqs. (9) and (10).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Criterion<T, const N: usize> {
    /// The logarithm of the determinant of the information: large is good.
    LogDet,
    /// The trace of the bound on the covariance of the scaled states: small is good.
    Trace,
    /// The smallest eigenvalue of the information on the scaled states: large is good.
    ///
    /// It has corners where two eigenvalues meet, which is where its best value
    /// often is. With a finite `sharpness` p the value is (sum of eigenvalue^-p)^(-1/p),
    /// smooth, and below the smallest eigenvalue by a factor N^(-1/p) at most;
    /// with an infinite one it is the eigenvalue itself.
    SmallestEigenvalue {
        /// p > 0.
        sharpness: T,
    },
    /// The bound on the variance of this combination of the states: small is good.
    Combination([T; N]),
}

/// A path of legs.
#[derive(Clone, Copy, Debug)]
pub struct Legs<'a, T> {
    /// Where the first bearing is taken.
    pub start: [T; 2],
    /// Time of one step.
    pub dt: T,
    /// Heading of each leg, clockwise from north.
    pub headings: &'a [T],
    /// Length of one step, for each leg.
    pub lengths: &'a [T],
    /// Number of steps of each leg.
    pub counts: &'a [usize],
}

/// A target and what is known and measured of it.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a, T, const N: usize> {
    /// (x0, y0, vx, vy) at the start of the path. A fixed target may move all the
    /// same when N = 2: then its motion is known and its position is not.
    pub state: [T; 4],
    /// Standard deviation of a bearing.
    pub sigma: T,
    /// The square root of the information there is before the path.
    pub prior: &'a SquareRootInformation<T, N>,
    /// What counts as one unit of each state, for the trace and the eigenvalue.
    pub scale: [T; N],
}

/// The value of a criterion for one target.
///
/// Where the path does not determine all states the value says so: log det is
/// negative infinity, the eigenvalue zero, a bound infinite.
///
/// The work grows with the number of steps.
///
/// # Errors
/// [`Error::OnTarget`] where a sample is on the target, [`NumberError::Length`] where the
/// arrays do not match, [`Error::Sigma`], and [`Error::Number`] for what is not
/// finite, a scale or sharpness that is not positive, and a value that
/// overflows.
pub fn value<T: Real, const N: usize>(
    legs: &Legs<'_, T>,
    target: &Target<'_, T, N>,
    criterion: &Criterion<T, N>,
) -> Result<T, Error> {
    check(legs, target, criterion)?;
    let (root, _) = accumulate(legs, target, |_, _| {})?;
    number(differentiate(&root, &target.scale, criterion).0)
}

/// The value after each sample: `out` has one entry more than there are steps.
///
/// # Errors
/// As [`value`].
pub fn along<T: Real, const N: usize>(
    legs: &Legs<'_, T>,
    target: &Target<'_, T, N>,
    criterion: &Criterion<T, N>,
    out: &mut [T],
) -> Result<(), Error> {
    check(legs, target, criterion)?;
    check_length("out", out.len(), legs.steps().saturating_add(1))?;
    accumulate(legs, target, |sample, root| {
        out[sample] = differentiate(root, &target.scale, criterion).0;
    })?;
    for &value in &*out {
        number(value)?;
    }
    Ok(())
}

/// The value, and `weight` times its derivatives by the heading and by the step
/// length of each leg added to `by_heading` and `by_length`. Nothing is added
/// where the value is not finite.
///
/// # Errors
/// As [`value`].
pub fn gradient<T: Real, const N: usize>(
    legs: &Legs<'_, T>,
    target: &Target<'_, T, N>,
    criterion: &Criterion<T, N>,
    weight: T,
    by_heading: &mut [T],
    by_length: &mut [T],
) -> Result<T, Error> {
    check(legs, target, criterion)?;
    check_finite("weight", &[weight])?;
    for (array, given) in [
        ("by_heading", by_heading.len()),
        ("by_length", by_length.len()),
    ] {
        check_length(array, given, legs.headings.len())?;
    }
    let (root, end) = accumulate(legs, target, |_, _| {})?;
    let (value, by_information) = differentiate(&root, &target.scale, criterion);
    if !number(value)?.is_finite() {
        return Ok(value);
    }
    // Backwards along the path: what moves with a step is every sample after it,
    // so the sum over those is at hand when the step is reached.
    let mut at = end;
    let mut sample = legs.steps();
    let mut pull = [T::zero(); 2];
    for leg in (0..legs.headings.len()).rev() {
        let (sin, cos) = legs.headings[leg].sin_cos();
        let length = legs.lengths[leg];
        for _ in 0..legs.counts[leg] {
            let here = by_position(at, sample, legs.dt, target, &by_information);
            pull[0] += here[0];
            pull[1] += here[1];
            by_heading[leg] += weight * length * (pull[0] * cos - pull[1] * sin);
            by_length[leg] += weight * (pull[0] * sin + pull[1] * cos);
            at = [at[0] - length * sin, at[1] - length * cos];
            sample -= 1;
        }
    }
    if all_finite(by_heading) && all_finite(by_length) {
        Ok(value)
    } else {
        Err(NumberError::Overflow { result: "gradient" }.into())
    }
}

/// Hands on a value that is a number: infinity says that there is no bound.
fn number<T: Real>(value: T) -> Result<T, Error> {
    // Compares with nothing if NaN.
    if value.partial_cmp(&T::zero()).is_some() {
        Ok(value)
    } else {
        Err(NumberError::Overflow { result: "value" }.into())
    }
}

/// Checks all that the samples have in common.
fn check<T: Real, const N: usize>(
    legs: &Legs<'_, T>,
    target: &Target<'_, T, N>,
    criterion: &Criterion<T, N>,
) -> Result<(), Error> {
    const {
        assert!(
            N == 2 || N == 4,
            "the states are (x, y) or (x0, y0, vx, vy)"
        );
    }
    legs.check()?;
    check_finite("state", &target.state)?;
    if target.sigma == T::INFINITY {
        return Err(Error::Sigma {
            given: target.sigma.double(),
        });
    }
    for scale in target.scale {
        check_positive("scale", scale)?;
    }
    match criterion {
        Criterion::Combination(combination) => check_finite("combination", combination)?,
        Criterion::SmallestEigenvalue { sharpness } if !(*sharpness > T::zero()) => {
            return Err(NumberError::OutOfRange {
                name: "sharpness",
                given: sharpness.double(),
                allowed: "> 0",
            }
            .into());
        }
        _ => {}
    }
    Ok(())
}

impl<T: Real> Legs<'_, T> {
    /// Number of steps of all legs.
    pub fn steps(&self) -> usize {
        self.counts
            .iter()
            .fold(0, |sum, &count| sum.saturating_add(count))
    }

    fn check(&self) -> Result<(), Error> {
        for (array, given) in [
            ("lengths", self.lengths.len()),
            ("counts", self.counts.len()),
        ] {
            check_length(array, given, self.headings.len())?;
        }
        check_finite("start", &self.start)?;
        check_finite("dt", &[self.dt])?;
        check_finite("headings", self.headings)?;
        check_finite("lengths", self.lengths)?;
        Ok(())
    }
}

fn time_of<T: Real>(sample: usize, dt: T) -> T {
    T::of(sample as f64) * dt
}

/// The row of one sample in scaled states.
#[inline]
fn row<T: Real, const N: usize>(
    at: [T; 2],
    sample: usize,
    dt: T,
    target: &Target<'_, T, N>,
) -> Result<[T; N], Error> {
    let time = time_of(sample, dt);
    let [x, y] = bearings::moved(&target.state, time);
    let row =
        bearings::unchecked_row(time, x - at[0], y - at[1], target.sigma).map_err(|error| {
            match error.at(sample) {
                bearings::Error::Sigma { given, .. } => Error::Sigma { given },
                bearings::Error::Number(error) => Error::Number(error),
                _ => Error::OnTarget { sample },
            }
        })?;
    Ok(core::array::from_fn(|i| row[i] * target.scale[i]))
}

/// Sums the information along the path; also returns where the path ends.
fn accumulate<T: Real, const N: usize>(
    legs: &Legs<'_, T>,
    target: &Target<'_, T, N>,
    mut each: impl FnMut(usize, &SquareRootInformation<T, N>),
) -> Result<(SquareRootInformation<T, N>, [T; 2]), Error> {
    let mut root = SquareRootInformation::new();
    for line in target.prior.factor() {
        root.absorb(&core::array::from_fn(|i| line[i] * target.scale[i]));
    }
    let mut at = legs.start;
    root.absorb(&row(at, 0, legs.dt, target)?);
    each(0, &root);
    let mut sample = 0;
    for leg in 0..legs.headings.len() {
        let (sin, cos) = legs.headings[leg].sin_cos();
        let length = legs.lengths[leg];
        for _ in 0..legs.counts[leg] {
            at = [at[0] + length * sin, at[1] + length * cos];
            sample += 1;
            root.absorb(&row(at, sample, legs.dt, target)?);
            each(sample, &root);
        }
    }
    Ok((root.sound()?, at))
}

/// The criterion and its derivative G by the information on the scaled states:
/// a change dJ changes the value by the trace of G dJ.
pub(super) fn differentiate<T: Real, const N: usize>(
    root: &SquareRootInformation<T, N>,
    scale: &[T; N],
    criterion: &Criterion<T, N>,
) -> (T, [[T; N]; N]) {
    let zero = [[T::zero(); N]; N];
    if let Criterion::SmallestEigenvalue { sharpness } = *criterion {
        return smallest_eigenvalue(root, sharpness);
    }
    let Some(bound) = regular_bound(root).or_else(|| bound_of_spectrum(root)) else {
        return match criterion {
            Criterion::LogDet => (-T::INFINITY, zero),
            _ => (T::INFINITY, zero),
        };
    };
    match criterion {
        Criterion::LogDet => {
            let log = (0..N).fold(T::zero(), |log, i| {
                log + (root.factor()[i][i].abs() / scale[i]).ln()
            });
            (log + log, bound)
        }
        Criterion::Combination(combination) => {
            let scaled: [T; N] = core::array::from_fn(|i| combination[i] * scale[i]);
            let through = multiply(&bound, &scaled);
            let variance = dot(&scaled, &through);
            let by = core::array::from_fn(|i| core::array::from_fn(|j| -through[i] * through[j]));
            (variance, by)
        }
        _ => {
            let trace = (0..N).fold(T::zero(), |sum, i| sum + bound[i][i]);
            let by = core::array::from_fn(|i| {
                let line = multiply(&bound, &bound[i]);
                core::array::from_fn(|j| -line[j])
            });
            (trace, by)
        }
    }
}

/// The bound R^-1 R^-T of a factor whose rank needs no decision: `None` where it might.
fn regular_bound<T: Real, const N: usize>(
    root: &SquareRootInformation<T, N>,
) -> Option<[[T; N]; N]> {
    let r = root.factor();
    let mut inverse = [[T::zero(); N]; N];
    for j in 0..N {
        inverse[j][j] = T::one() / r[j][j];
        for i in (0..j).rev() {
            let sum = (i + 1..=j).fold(T::zero(), |sum, k| sum + r[i][k] * inverse[k][j]);
            inverse[i][j] = -sum * inverse[i][i];
        }
    }
    let mut bound = [[T::zero(); N]; N];
    // n times this is the square of the condition (Frobenius) of R with columns of unit
    // length, which is not below the quotient of its singular values.
    let mut spread = T::zero();
    for i in 0..N {
        for j in i..N {
            let sum = (j..N).fold(T::zero(), |sum, k| sum + inverse[i][k] * inverse[j][k]);
            bound[i][j] = sum;
            bound[j][i] = sum;
        }
        let square = (0..=i).fold(T::zero(), |sum, k| sum + r[k][i] * r[k][i]);
        spread += square * bound[i][i];
    }
    let rows = usize::try_from(root.count()).unwrap_or(usize::MAX);
    let rtol: T = default_rtol(rows, N);
    // Also false for what is no number.
    let regular = T::of(4.0 * N as f64) * spread * rtol * rtol < T::one();
    regular.then_some(bound)
}

/// The bound P = D V S^-2 V^T D, from columns scaled to unit length by D; `None` where the
/// rank is short.
fn bound_of_spectrum<T: Real, const N: usize>(
    root: &SquareRootInformation<T, N>,
) -> Option<[[T; N]; N]> {
    let spectrum = Spectrum::new(root);
    if spectrum.rank() < N {
        return None;
    }
    let (s, v, unit) = (
        spectrum.singular_values(),
        spectrum.vectors(),
        spectrum.scale(),
    );
    Some(core::array::from_fn(|i| {
        core::array::from_fn(|j| {
            let sum = (0..N).fold(T::zero(), |sum, k| {
                sum + (v[k][i] / s[k]) * (v[k][j] / s[k])
            });
            sum * unit[i] * unit[j]
        })
    }))
}

fn smallest_eigenvalue<T: Real, const N: usize>(
    root: &SquareRootInformation<T, N>,
    sharpness: T,
) -> (T, [[T; N]; N]) {
    let mut s = [T::zero(); N];
    let mut v = [[T::zero(); N]; N];
    let mut work = [[T::zero(); N]; N];
    decompose(
        root.factor().as_flattened(),
        N,
        &[T::one(); N],
        &mut s,
        v.as_flattened_mut(),
        work.as_flattened_mut(),
    );
    let least = s[N - 1] * s[N - 1];
    if Spectrum::new(root).rank() < N || !(least > T::zero()) {
        return (T::zero(), [[T::zero(); N]; N]);
    }
    // Powers of (least / eigenvalue) <= 1: nothing overflows at any sharpness.
    let ratios: [T; N] = core::array::from_fn(|k| least / (s[k] * s[k]));
    let (value, weights): (T, [T; N]) = if sharpness.is_finite() {
        let sum = ratios
            .iter()
            .fold(T::zero(), |sum, &x| sum + x.powf(sharpness));
        let factor = sum.powf(-T::one() / sharpness);
        (
            least * factor,
            core::array::from_fn(|k| factor / sum * ratios[k].powf(sharpness + T::one())),
        )
    } else {
        (
            least,
            core::array::from_fn(|k| if k == N - 1 { T::one() } else { T::zero() }),
        )
    };
    let by = core::array::from_fn(|i| {
        core::array::from_fn(|j| {
            (0..N).fold(T::zero(), |sum, k| sum + weights[k] * v[k][i] * v[k][j])
        })
    });
    (value, by)
}

/// The derivative of the criterion by the position of one sample.
fn by_position<T: Real, const N: usize>(
    at: [T; 2],
    sample: usize,
    dt: T,
    target: &Target<'_, T, N>,
    by_information: &[[T; N]; N],
) -> [T; 2] {
    // The sample was on no target on the way out.
    let Ok(row) = row(at, sample, dt, target) else {
        return [T::zero(); 2];
    };
    let time = time_of(sample, dt);
    let [x, y] = bearings::moved(&target.state, time);
    let (x, y) = (x - at[0], y - at[1]);
    let squared = x * x + y * y;
    // 2 G h, folded to the two position entries of the unscaled row.
    let pull = multiply(by_information, &row);
    let fold = |axis: usize| {
        let twice = pull[axis] * target.scale[axis];
        let sum = if N > 2 {
            twice + time * pull[axis + 2] * target.scale[axis + 2]
        } else {
            twice
        };
        sum + sum
    };
    let (a, b) = (fold(0), fold(1));
    // h = (y, -x) / (r^2 sigma); the observer moves against the offset.
    let two = T::one() + T::one();
    let both = two * (a * y - b * x) / squared;
    let factor = T::one() / (squared * target.sigma);
    [(b + both * x) * factor, (both * y - a) * factor]
}

/// What can be wrong with a path that is to be judged.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A sample is on the target: no bearing exists there.
    #[error("sample {sample} of the path is on the target: a bearing needs a range > 0")]
    OnTarget {
        /// Which sample; 0 is the start.
        sample: usize,
    },
    /// A standard deviation that is not positive.
    #[error("sigma = {given} rad: must be > 0 and finite")]
    Sigma {
        /// The value given.
        given: f64,
    },
    /// A number that is not finite, or too large to go on with.
    #[error(transparent)]
    Number(#[from] NumberError),
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const HEADINGS: [f64; 6] = [0.3, 0.9, 1.4, 1.2, -0.4, 2.0];
    const LENGTHS: [f64; 6] = [20.0, 18.0, 20.0, 25.0, 20.0, 21.0];
    const COUNTS: [usize; 6] = [3, 1, 4, 2, 5, 1];

    fn legs<'a>(headings: &'a [f64], lengths: &'a [f64]) -> Legs<'a, f64> {
        Legs {
            start: [10.0, -5.0],
            dt: 1.5,
            headings,
            lengths,
            counts: &COUNTS,
        }
    }

    fn check<const N: usize>(scale: [f64; N], criterion: Criterion<f64, N>) {
        let mut prior = SquareRootInformation::new();
        prior
            .push(&core::array::from_fn(|i| 1e-3 / scale[i]))
            .unwrap();
        let target = Target {
            state: [60.0, 900.0, 3.0, -2.0],
            sigma: 0.03,
            prior: &prior,
            scale,
        };
        let mut exact = [[0.0; 6]; 2];
        let [by_heading, by_length] = &mut exact;
        let middle = gradient(
            &legs(&HEADINGS, &LENGTHS),
            &target,
            &criterion,
            1.0,
            by_heading,
            by_length,
        )
        .unwrap();
        assert_eq!(
            middle,
            value(&legs(&HEADINGS, &LENGTHS), &target, &criterion).unwrap()
        );
        for kind in 0..2 {
            let largest = exact[kind].iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            for i in 0..6 {
                let at = |step: f64| {
                    let (mut headings, mut lengths) = (HEADINGS, LENGTHS);
                    if kind == 0 {
                        headings[i] += step;
                    } else {
                        lengths[i] += 20.0 * step;
                    }
                    value(&legs(&headings, &lengths), &target, &criterion).unwrap()
                };
                // Fourth order, so that the step may be wide enough for rounding.
                let h = 2e-3;
                let near = (at(h) - at(-h)) / (2.0 * h);
                let far = (at(2.0 * h) - at(-2.0 * h)) / (4.0 * h);
                let change = (4.0 * near - far) / 3.0 / if kind == 0 { 1.0 } else { 20.0 };
                assert!(
                    (change - exact[kind][i]).abs() < 1e-7 * largest,
                    "{criterion:?} {kind} {i}: {change} {}",
                    exact[kind][i]
                );
            }
        }
    }

    fn check_all<const N: usize>(scale: [f64; N], combination: [f64; N]) {
        check(scale, Criterion::LogDet);
        check(scale, Criterion::Trace);
        check(scale, Criterion::SmallestEigenvalue { sharpness: 8.0 });
        let sharpness = f64::INFINITY;
        check(scale, Criterion::SmallestEigenvalue { sharpness });
        check(scale, Criterion::Combination(combination));
    }

    #[test]
    fn gradients_agree_with_differences() {
        check_all([1.0, 2.0], [0.6, 0.8]);
        check_all([1.0, 1.0, 0.05, 0.05], [0.1, 1.0, 3.0, -2.0]);
    }

    #[test]
    fn the_smooth_eigenvalue_is_below_the_sharp_one() {
        let prior = SquareRootInformation::new();
        let target = Target::<f64, 2> {
            state: [60.0, 900.0, 0.0, 0.0],
            sigma: 0.03,
            prior: &prior,
            scale: [1.0; 2],
        };
        let legs = legs(&HEADINGS, &LENGTHS);
        let at = |sharpness| {
            value(&legs, &target, &Criterion::SmallestEigenvalue { sharpness }).unwrap()
        };
        let sharp = at(f64::INFINITY);
        for p in [1.0, 4.0, 64.0, 1e4] {
            assert!(at(p) <= sharp && at(p) >= sharp * 0.5_f64.powf(1.0 / p));
        }
        // p = 1 is one over the trace of the bound.
        let trace = value(&legs, &target, &Criterion::Trace).unwrap();
        assert!((at(1.0) * trace - 1.0).abs() < 1e-12);
    }

    #[test]
    fn what_is_not_determined_has_no_bound() {
        let prior = SquareRootInformation::new();
        let target = Target::<f64, 4> {
            state: [60.0, 900.0, 3.0, -2.0],
            sigma: 0.03,
            prior: &prior,
            scale: [1.0; 4],
        };
        let straight = legs(&[0.7; 6], &[20.0; 6]);
        let at = |criterion| value(&straight, &target, &criterion).unwrap();
        assert_eq!(at(Criterion::LogDet), f64::NEG_INFINITY);
        assert_eq!(at(Criterion::Trace), f64::INFINITY);
        assert_eq!(
            at(Criterion::SmallestEigenvalue {
                sharpness: f64::INFINITY
            }),
            0.0
        );
        let mut gradient_out = [0.0; 6];
        let _ = gradient(
            &straight,
            &target,
            &Criterion::LogDet,
            1.0,
            &mut gradient_out,
            &mut [0.0; 6],
        );
        assert_eq!(gradient_out, [0.0; 6]);
    }
}
