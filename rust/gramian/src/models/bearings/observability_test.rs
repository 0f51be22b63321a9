//! A test on noisy bearings: could this target be unobservable?
//!
//! With noise no discriminant is ever exactly zero. But where a track is
//! unobservable, its bearings follow tan b = (x + vx T) / (y + vy T) for some
//! relative motion (x, y, vx, vy), a family of three parameters since its size
//! does not matter. Fitted by weighted least squares, the sum of squared
//! residuals is then chi-square with m - 3 degrees of freedom; a larger one
//! rejects "unobservable". Neither range nor the target's state is needed.

use super::{Error, check_track};
use crate::chi_square;
use crate::numbers::algebra::{cholesky, cholesky_solve, dot};
use crate::scalar::{Real, check_length, finite, finite_one};

/// The answer of [`observability_test`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Test<T> {
    /// The weighted sum of squared residuals at the best fit.
    pub statistic: T,
    /// Its degrees of freedom, m - 3.
    pub dof: usize,
    /// The probability of a statistic as large where the track is unobservable.
    pub p_value: T,
    /// The relative motion (x, y, vx, vy) at the first time that fits best, at
    /// unit range there; its size is what bearings alone cannot tell.
    pub relative_motion: [T; 4],
}

/// Tests whether bearings could be those of an unobservable track.
///
/// `sigma` holds one standard deviation for all bearings or one each. Bearings
/// may be wrapped or not.
///
/// # Units
/// s, rad.
///
/// # Errors
/// [`Error::TooFew`] below four bearings, [`Error::Sigma`], and as
/// [`check_track`]; [`Error::Number`] also where the instants or the statistic
/// exceed what this type can tell apart.
///
/// # Source
/// Ours. The family fitted is where all discriminants vanish, Li & Sheng 2009, Theorem 1.
///
/// ```
/// let times = [0.0_f64, 20.0, 40.0, 60.0, 80.0, 100.0];
/// // On a straight line, with 0.1 degree of "noise" of alternating sign.
/// let mut bearings = times.map(|t| (t / 50.0).atan());
/// for (i, b) in bearings.iter_mut().enumerate() {
///     *b += if i % 2 == 0 { 0.0017 } else { -0.0017 };
/// }
/// let test = gramian::bearings::observability_test(&times, &bearings, &[0.0017]).unwrap();
/// assert_eq!(test.dof, 3);
/// assert!(test.p_value > 0.05);
/// ```
pub fn observability_test<T: Real>(
    times: &[T],
    bearings: &[T],
    sigma: &[T],
) -> Result<Test<T>, Error> {
    check_track(times, bearings, None, 4)?;
    check_sigma(sigma, times.len())?;
    let clock = Clock::of(times);
    let m = times.len();
    let track = Track {
        times,
        bearings,
        sigma,
        clock,
    };
    let mut gram = [T::zero(); 9];
    for i in 0..m {
        let (t, sin, cos, w) = track.point(i);
        for (k, product) in [cos * cos, -(sin * cos), sin * sin].into_iter().enumerate() {
            let mut value = w * product;
            for power in 0..3 {
                gram[3 * power + k] += value;
                value *= t;
            }
        }
    }
    let (_, sin, cos, _) = track.point(m / 2);
    let (motion, statistic, p_value) = fit(&gram, sin, cos, m - 3, &track);
    Ok(Test {
        statistic: finite_one("statistic", statistic)?,
        dof: m - 3,
        p_value: finite_one("p_value", p_value)?,
        relative_motion: finite("relative_motion", clock.at_first(&motion))?,
    })
}

/// The bearings of a track, seen from a motion. A trait, not a closure: its
/// methods must be inlined into the function that has the CPU features.
pub(crate) trait Residuals<T> {
    /// What the residuals of motion `c` sum up to.
    fn sums(&self, c: &[T; 4]) -> Sums<T>;
}

struct Track<'a, T> {
    times: &'a [T],
    bearings: &'a [T],
    sigma: &'a [T],
    clock: Clock<T>,
}

impl<T: Real> Track<'_, T> {
    /// Standard time, sine, cosine and weight of a bearing.
    fn point(&self, i: usize) -> (T, T, T, T) {
        let s = self.sigma[if self.sigma.len() == 1 { 0 } else { i }];
        let (sin, cos) = self.bearings[i].sin_cos();
        (self.clock.read(self.times[i]), sin, cos, T::one() / (s * s))
    }
}

impl<T: Real> Residuals<T> for Track<'_, T> {
    fn sums(&self, c: &[T; 4]) -> Sums<T> {
        let mut sums = Sums::zero();
        for i in 0..self.times.len() {
            let (t, sin, cos, w) = self.point(i);
            let (x, y) = (c[0] + t * c[2], c[1] + t * c[3]);
            let rr = (x * x + y * y).max(T::of(SMALLEST));
            let error = (sin * y - cos * x).atan2(sin * x + cos * y);
            let weight = w / rr;
            sums.add(weight * error, weight / rr, error * error * w, x, y, t);
        }
        sums
    }
}

/// Checks one standard deviation for all of `count` bearings, or one each.
pub(crate) fn check_sigma<T: Real>(sigma: &[T], count: usize) -> Result<(), Error> {
    if sigma.len() != 1 {
        check_length("sigma", sigma.len(), count)?;
    }
    match sigma
        .iter()
        .position(|&s| !(s > T::zero() && s.is_finite()))
    {
        None => Ok(()),
        Some(index) => Err(Error::Sigma {
            index,
            given: sigma[index].double(),
        }),
    }
}

/// A squared range below this part of its mean square counts as this.
pub(crate) const SMALLEST: f64 = 1e-12;

/// Times in standard form: mean 0, mean square 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clock<T> {
    first: T,
    mean: T,
    spread: T,
}

impl<T: Real> Clock<T> {
    #[inline(always)]
    pub(crate) fn of(times: &[T]) -> Self {
        let (count, first) = (T::of(times.len() as f64), times[0]);
        let mut sum = T::zero();
        for &t in times {
            sum += t - first;
        }
        let mean = sum / count;
        let mut squares = T::zero();
        for &t in times {
            let d = t - first - mean;
            squares += d * d;
        }
        Self {
            first,
            mean,
            spread: (squares / count).sqrt(),
        }
    }

    #[inline(always)]
    pub(crate) fn read(&self, time: T) -> T {
        (time - self.first - self.mean) / self.spread
    }

    /// A motion in standard time as one in seconds from the first time, at unit
    /// range there.
    pub(crate) fn at_first(&self, c: &[T; 4]) -> [T; 4] {
        let (vx, vy) = (c[2] / self.spread, c[3] / self.spread);
        let (x, y) = (c[0] - self.mean * vx, c[1] - self.mean * vy);
        let range = crate::scalar::hypot(x, y);
        let unit = if range > T::zero() {
            range
        } else {
            // Straight from the observer's own position.
            T::one()
        };
        [x / unit, y / unit, vx / unit, vy / unit]
    }
}

/// What a motion's residuals sum up to: chi-square, its gradient and the normal
/// equations.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sums<T> {
    /// Sum of w e^2.
    pub statistic: T,
    /// Sums of w e / r^2 times (y, -x) and times T (y, -x).
    pub gradient: [T; 4],
    /// Sums of w / r^4 times (y^2, -xy, x^2) and times T and T^2.
    pub normal: [T; 9],
}

impl<T: Real> Sums<T> {
    fn zero() -> Self {
        Self {
            statistic: T::zero(),
            gradient: [T::zero(); 4],
            normal: [T::zero(); 9],
        }
    }

    fn add(&mut self, slope: T, curve: T, square: T, x: T, y: T, t: T) {
        self.statistic += square;
        for (k, value) in [slope * y, -(slope * x)].into_iter().enumerate() {
            self.gradient[k] += value;
            self.gradient[k + 2] += value * t;
        }
        let products = [curve * y * y, -(curve * x * y), curve * x * x];
        for (k, mut value) in products.into_iter().enumerate() {
            for power in 0..3 {
                self.normal[3 * power + k] += value;
                value *= t;
            }
        }
    }
}

/// The full 4 x 4 matrix of nine sums of 2 x 2 products times 1, T, T^2.
#[inline(always)]
fn blocks<T: Real>(sums: &[T; 9]) -> [[T; 4]; 4] {
    let mut a = [[T::zero(); 4]; 4];
    for (row, column, power) in [(0, 0, 0), (0, 2, 1), (2, 0, 1), (2, 2, 2)] {
        let s = &sums[3 * power..3 * power + 3];
        a[row][column] = s[0];
        a[row][column + 1] = s[1];
        a[row + 1][column] = s[1];
        a[row + 1][column + 1] = s[2];
    }
    a
}

/// The motion that fits best, its statistic and p-value.
///
/// `gram` has the sums of w (cos^2, -sin cos, sin^2) times 1, T and T^2 in
/// standard time, (`sin`, `cos`) point to the middle bearing.
///
/// # Algorithm
/// In standard time the noise adds a multiple of the unit matrix to the Gram
/// matrix, so its smallest eigenvector is a start without bias (Taubin's
/// normalisation of an algebraic fit). From there Levenberg-Marquardt steps;
/// where their end is not believable, a second try from a motion straight along
/// the middle bearing, and the better of the two.
#[inline(always)]
pub(crate) fn fit<T: Real>(
    gram: &[T; 9],
    sin: T,
    cos: T,
    dof: usize,
    track: &impl Residuals<T>,
) -> ([T; 4], T, T) {
    let dof = T::of(dof as f64);
    let along = [sin, cos, T::zero(), T::zero()];
    let (mut best, mut statistic) = descend(smallest(&blocks(gram), &along), track);
    let mut p_value = chi_square::tail(statistic, dof);
    if p_value < T::of(0.2) {
        let (other, second) = descend(along, track);
        if second < statistic {
            (best, statistic) = (other, second);
            p_value = chi_square::tail(statistic, dof);
        }
    }
    (best, statistic, p_value)
}

/// An eigenvector near that of the smallest eigenvalue, by inverse iteration
/// from `start`, pointing the same way.
fn smallest<T: Real>(a: &[[T; 4]; 4], start: &[T; 4]) -> [T; 4] {
    let trace = a[0][0] + a[1][1] + a[2][2] + a[3][3];
    let mut shifted = *a;
    for (i, row) in shifted.iter_mut().enumerate() {
        row[i] += trace * T::EPSILON * T::of(16.0);
    }
    let Some(factor) = cholesky(&shifted) else {
        return *start;
    };
    let mut c = *start;
    for _ in 0..6 {
        c = unit(&cholesky_solve(&factor, &c));
    }
    c
}

fn unit<T: Real>(c: &[T; 4]) -> [T; 4] {
    let norm = (c[0] * c[0] + c[1] * c[1] + c[2] * c[2] + c[3] * c[3]).sqrt();
    if norm > T::zero() {
        c.map(|x| x / norm)
    } else {
        *c
    }
}

/// Levenberg-Marquardt steps on the sphere |c| = 1.
#[inline(always)]
fn descend<T: Real>(start: [T; 4], track: &impl Residuals<T>) -> ([T; 4], T) {
    let mut c = start;
    let mut now = track.sums(&c);
    let mut damping = T::EPSILON;
    for _ in 0..40 {
        let Some((step, gain)) = bounded_step(&c, &now, &mut damping) else {
            break;
        };
        // What is left to gain no longer matters to any p-value.
        if !(gain > T::of(1e-5) + now.statistic * T::of(1e-8)) {
            break;
        }
        let mut next = c;
        for i in 0..4 {
            next[i] += step[i];
        }
        let next = unit(&next);
        let then = track.sums(&next);
        if then.statistic < now.statistic {
            // As far as the quadratic model held, damp less.
            let held = (now.statistic - then.statistic) / gain;
            if held > T::of(0.75) {
                damping = (damping * T::of(0.01)).max(T::EPSILON);
            }
            (c, now) = (next, then);
        } else {
            damping = (damping * T::of(30.0)).max(T::of(1e-8));
        }
    }
    (c, now.statistic)
}

/// A damped Gauss-Newton step no longer than half the radius, and what it should
/// gain; `None` where no damping makes one.
#[inline(always)]
fn bounded_step<T: Real>(c: &[T; 4], now: &Sums<T>, damping: &mut T) -> Option<([T; 4], T)> {
    let mut a = blocks(&now.normal);
    let trace = a[0][0] + a[1][1] + a[2][2] + a[3][3];
    // The size of c does not matter: filling in its direction keeps steps off it.
    for i in 0..4 {
        for j in 0..4 {
            a[i][j] += trace * c[i] * c[j];
        }
    }
    while *damping < T::of(1e6) {
        let mut damped = a;
        for i in 0..4 {
            damped[i][i] += trace * *damping;
        }
        if let Some(factor) = cholesky(&damped) {
            let step = cholesky_solve(&factor, &now.gradient);
            if dot(&step, &step) <= T::of(0.25) {
                return Some((step, dot(&step, &now.gradient)));
            }
        }
        *damping = (*damping * T::of(10.0)).max(T::of(1e-10));
    }
    None
}
