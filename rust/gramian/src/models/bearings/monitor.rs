//! Observability while the bearings arrive.
//!
//! [`Monitor`] keeps the triangular factor of all rows so far and eight moments
//! of the times, 220 bytes in `f32`, and no bearing. Everything follows from
//! these: rank, determinant, smallest singular value and bound as from all rows
//! at once, and a statistic for the test on noisy bearings.
//!
//! # The statistic
//! With `e_i` the residual of a relative motion c, `H_i c = r_i(c) sin e_i`. So
//! the smallest `|R c|^2` among motions of mean square range 1 is the sum of
//! `(e_i / sigma_i)^2` of the best fit, each weighted by `q_i`, the square of its
//! range. In standard time (mean 0, mean square 1) that is the square of the
//! smallest singular value of the factor; noise only adds a multiple of the unit
//! matrix there, so the fit has no bias. Where the range hardly changes all `q_i`
//! are 1 and the statistic is the chi-square of the batch test. Where it does, the
//! sum is no longer quite
//! chi-square: scale and degrees of freedom are set such that mean and variance
//! agree (Satterthwaite 1946), for which the moments of the times up to the
//! fourth are kept. Simulated unobservable tracks are then rejected at the level
//! (at 5 % between 4 % and 5 % of 60 bearings, down to 3 % of six, a passage at a
//! tenth of the largest range included), with less power than the batch test has
//! where ranges differ much: the near bearings, which say most, count least.
//!
//! # Rounding
//! The axes are turned to the first bearing and time is counted from the mean of
//! the instants, so that differences count. A row added to a sum of a million
//! others loses most of its digits in `f32`; rows are therefore summed in blocks of
//! about twice the square root of their number, and block by block. The rank's
//! tolerance grows where the times given are coarse: at 1e7 s an `f32` counts whole
//! seconds.

use super::Error;
use crate::bound::crlb_std;
use crate::chi_square;
use crate::scalar::{NumberError, Real, all_finite, hypot};
use crate::spectrum::{Spectrum, decompose, default_rtol};
use crate::square_root::SquareRootInformation;

/// Takes bearings one by one and says what they determine so far.
///
/// No allocation, no bearing kept; a push costs about 100 operations, an
/// [`answer`](Monitor::answer) some thousand.
///
/// In `f32`, count times from near the first bearing: a time of 1e6 s is only
/// known to 0.06 s.
///
/// # Source
/// Rows and determinant: Li & Sheng 2009, eq. (2) and Lemma 1. The statistic is ours, its
/// degrees of freedom are by Satterthwaite 1946.
///
/// ```
/// use gramian::bearings::Monitor;
/// let mut monitor = Monitor::<f32>::new();
/// for i in 0..20 {
///     let t = 20.0 * i as f32;
///     // A target at 10 km that crosses; the observer goes straight.
///     let bearing = (3.0 * t).atan2(10_000.0 - 6.0 * t);
///     monitor.push(t, bearing, 0.01, None).unwrap();
/// }
/// let answer = monitor.answer();
/// assert_eq!(answer.rank, 3);
/// assert!(answer.p_value > 0.99);
/// assert!(answer.crlb_std[1].is_infinite());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Monitor<T> {
    /// Of the rows in turned axes with time from `origin`.
    whole: Sums<T>,
    /// The same of the latest rows, not yet in `whole`.
    block: Sums<T>,
    /// The instant of the state, and the latest.
    first: T,
    last: T,
    origin: T,
    /// The first bearing: the axes are turned to it, so that differences count.
    turn: T,
    /// Whether bearings come with ranges; all must or none.
    ranged: bool,
}

/// What is kept of some bearings.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sums<T> {
    root: SquareRootInformation<T, 4>,
    /// Sums of `T^k / r^2`, k = 0..2, and of `T^k / r^4`, k = 0..4.
    second: [T; 3],
    fourth: [T; 5],
}

impl<T: Real> Sums<T> {
    fn new() -> Self {
        Self {
            root: SquareRootInformation::new(),
            second: [T::zero(); 3],
            fourth: [T::zero(); 5],
        }
    }

    fn merge(&mut self, other: &Self) {
        let count = self.root.count().saturating_add(other.root.count());
        for row in other.root.factor() {
            self.root.absorb(row);
        }
        self.root = self.root.with_count(count);
        for (to, &from) in self.second.iter_mut().zip(&other.second) {
            *to += from;
        }
        for (to, &from) in self.fourth.iter_mut().zip(&other.fourth) {
            *to += from;
        }
    }

    /// Counts time from an instant that is later by `shift`.
    fn shift(&mut self, shift: T) {
        let mut moved = SquareRootInformation::new();
        for row in self.root.factor() {
            // Still triangular: columns move by multiples of earlier ones.
            moved.absorb(&[
                row[0],
                row[1],
                row[2] - shift * row[0],
                row[3] - shift * row[1],
            ]);
        }
        self.root = moved.with_count(self.root.count());
        self.second = moments(&self.second, shift);
        self.fourth = moments(&self.fourth, shift);
    }
}

/// All that a [`Monitor`] keeps, as plain numbers.
///
/// ```
/// use gramian::bearings::Monitor;
/// let mut monitor = Monitor::<f64>::new();
/// monitor.push(0.0, 0.1, 0.01, None)?;
/// let mut again = Monitor::from_kept(&monitor.kept())?;
/// again.push(20.0, 0.2, 0.01, None)?;
/// assert_eq!(again.count(), 2);
/// # Ok::<(), gramian::bearings::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kept<T> {
    /// Of all rows, then of the latest: the triangular factor by rows and eight moments;
    /// then the first and the last time, the origin of time and the turn of the axes.
    pub numbers: [T; 40],
    /// How many rows each of the two has.
    pub counts: [u32; 2],
    /// Whether the bearings come with ranges.
    pub ranged: bool,
}

/// What the bearings so far say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer<T> {
    /// How many bearings there are.
    pub count: u32,
    /// Rank of the rows with unit columns, of 4.
    pub rank: usize,
    /// Determinant of the information (infinite or 0 where `T` cannot hold it).
    pub determinant: T,
    /// Its logarithm; minus infinity where it is 0.
    pub log_determinant: T,
    /// Smallest singular value of the rows with unit columns, at the first time.
    pub singular_value: T,
    /// Bounds on x0, y0, vx, vy at the first time; infinite where there is none.
    /// In metres with ranges, as parts of the range without.
    pub crlb_std: [T; 4],
    /// The statistic of the test; 0 below four bearings, and where the instants or
    /// the ranges differ by more than the numbers of this type can tell.
    pub statistic: T,
    /// Its degrees of freedom, m - 3 or somewhat less; 0 where there is no statistic.
    pub dof: T,
    /// The probability of a statistic as large where the track is unobservable; 1
    /// where there is no statistic.
    pub p_value: T,
    /// The relative motion (x, y, vx, vy) at the first time that fits best, at
    /// unit range there; 0 where there is no statistic.
    pub relative_motion: [T; 4],
}

impl<T: Real> Monitor<T> {
    /// A monitor that has seen nothing.
    pub fn new() -> Self {
        let zero = T::zero();
        Self {
            whole: Sums::new(),
            block: Sums::new(),
            first: zero,
            last: zero,
            origin: zero,
            turn: zero,
            ranged: false,
        }
    }

    /// Takes in a bearing, wrapped or not, later than all before. `distance` is
    /// that of the target as far as it is known; with it the information is
    /// Fisher's, without it the target is taken to be at unit range.
    ///
    /// # Units
    /// s, rad, rad, m.
    ///
    /// # Errors
    /// [`Error::Times`], [`Error::Sigma`], [`Error::Number`], [`Error::Distance`]
    /// for one that is not positive, [`Error::Mixed`] for one that only some
    /// bearings have; [`Error::Number`] also where the information or the sums
    /// overflow, or 1 over the fourth power of the distance
    /// falls below them. The bearing is not taken in then.
    pub fn push(
        &mut self,
        time: T,
        bearing: T,
        sigma: T,
        distance: Option<T>,
    ) -> Result<(), Error> {
        let index = self.count();
        self.check(index, time, bearing, sigma, distance)?;
        let before = *self;
        self.take_in(index, time, bearing, sigma, distance);
        if !self.is_sound() {
            *self = before;
            return Err(NumberError::Overflow {
                result: "information",
            }
            .into());
        }
        Ok(())
    }

    fn take_in(&mut self, index: u32, time: T, bearing: T, sigma: T, distance: Option<T>) {
        if index == 0 {
            (self.first, self.origin, self.turn) = (time, time, bearing);
            self.ranged = distance.is_some();
        } else if index >= 4 && index.is_power_of_two() {
            self.move_origin();
        } else if u64::from(self.block.root.count()).pow(2) >= 4 * u64::from(index) {
            self.end_block();
        }
        self.last = time;
        let range = distance.unwrap_or_else(T::one);
        let (sin, cos) = (bearing - self.turn).sin_cos();
        let t = time - self.origin;
        let weight = T::one() / (range * sigma);
        let (x, y) = (weight * cos, -(weight * sin));
        self.block.root.absorb(&[x, y, t * x, t * y]);
        let g = T::one() / (range * range);
        let (mut a, mut b) = (g, g * g);
        for k in 0..5 {
            if k < 3 {
                self.block.second[k] += a;
            }
            self.block.fourth[k] += b;
            a *= t;
            b *= t;
        }
    }

    /// Whether every sum is finite, and the factor so small that it stays so at the
    /// first time: what [`answer`](Self::answer) relies on.
    fn is_sound(&self) -> bool {
        let span = (self.last - self.first).max(T::one());
        let limit = T::MAX / T::of(128.0) / span;
        let most = T::MAX / T::of(4.0);
        // All are compared, without a branch: one that is too large is rare.
        let within = |numbers: &[T], most: T| {
            let held = |held: bool, x: &T| held & (x.abs() <= most);
            numbers.iter().fold(true, held)
        };
        let held = |sums: &Sums<T>| {
            within(sums.root.factor().as_flattened(), limit)
                & within(&sums.second, most)
                & within(&sums.fourth, most)
        };
        let squares = self.whole.fourth[0] + self.block.fourth[0];
        held(&self.whole) && held(&self.block) && (T::one() / squares).is_finite()
    }

    /// All that the monitor keeps, to store it and go on later: see
    /// [`from_kept`](Self::from_kept).
    pub fn kept(&self) -> Kept<T> {
        let mut numbers = [T::zero(); 40];
        let (sums, instants) = numbers.split_at_mut(36);
        for (to, from) in sums.chunks_exact_mut(18).zip([&self.whole, &self.block]) {
            let rows = from.root.factor().iter().enumerate();
            let upper = rows.flat_map(|(i, row)| row.iter().skip(i));
            let all = upper.chain(&from.second).chain(&from.fourth);
            for (to, &from) in to.iter_mut().zip(all) {
                *to = from;
            }
        }
        instants.copy_from_slice(&[self.first, self.last, self.origin, self.turn]);
        Kept {
            numbers,
            counts: [self.whole.root.count(), self.block.root.count()],
            ranged: self.ranged,
        }
    }

    /// The monitor that kept this, equal in every bit.
    ///
    /// # Errors
    /// [`NumberError::NotFinite`] for a number that is not finite,
    /// [`NumberError::Overflow`] for sums that no monitor keeps.
    pub fn from_kept(kept: &Kept<T>) -> Result<Self, Error> {
        for (index, value) in kept.numbers.iter().enumerate() {
            if !value.is_finite() {
                let (name, given) = ("kept", value.double());
                return Err(NumberError::NotFinite { name, index, given }.into());
            }
        }
        let mut monitor = Self::new();
        let (sums, instants) = kept.numbers.split_at(36);
        let parts = [&mut monitor.whole, &mut monitor.block];
        for ((to, from), &count) in parts
            .into_iter()
            .zip(sums.chunks_exact(18))
            .zip(&kept.counts)
        {
            let mut from = from.iter().copied();
            let mut factor = [[T::zero(); 4]; 4];
            for (i, row) in factor.iter_mut().enumerate() {
                for to in row.iter_mut().skip(i) {
                    *to = from.next().unwrap_or_else(T::zero);
                }
            }
            to.root = SquareRootInformation::of_factor(factor, count);
            for to in to.second.iter_mut().chain(&mut to.fourth) {
                *to = from.next().unwrap_or_else(T::zero);
            }
        }
        if let &[first, last, origin, turn] = instants {
            (monitor.first, monitor.last) = (first, last);
            (monitor.origin, monitor.turn) = (origin, turn);
        }
        monitor.ranged = kept.ranged;
        if monitor.count() > 0 && !monitor.is_sound() {
            let result = "information";
            return Err(NumberError::Overflow { result }.into());
        }
        Ok(monitor)
    }

    /// How many bearings were taken in.
    pub fn count(&self) -> u32 {
        let (whole, block) = (self.whole.root.count(), self.block.root.count());
        whole.saturating_add(block)
    }

    fn check(
        &self,
        index: u32,
        time: T,
        bearing: T,
        sigma: T,
        distance: Option<T>,
    ) -> Result<(), Error> {
        let index = usize::try_from(index).unwrap_or(usize::MAX);
        for (name, value) in [("times", time), ("bearings", bearing)] {
            if !value.is_finite() {
                let given = value.double();
                return Err(NumberError::NotFinite { name, index, given }.into());
            }
        }
        if !(sigma > T::zero() && sigma.is_finite()) {
            let given = sigma.double();
            return Err(Error::Sigma { index, given });
        }
        if let Some(distance) = distance
            && !(distance > T::zero() && distance.is_finite())
        {
            let given = distance.double();
            return Err(Error::Distance { index, given });
        }
        if index > 0 && !(time > self.last) {
            return Err(Error::Times {
                index,
                given: time.double(),
                before: self.last.double(),
            });
        }
        if index > 0 && distance.is_some() != self.ranged {
            return Err(Error::Mixed { index });
        }
        Ok(())
    }

    fn end_block(&mut self) {
        self.whole.merge(&self.block);
        self.block = Sums::new();
    }

    /// Counts time from the mean of the instants so far. Done each time their
    /// number doubles, this keeps T small, and with it the rounding.
    fn move_origin(&mut self) {
        self.end_block();
        let before = self.origin;
        self.origin += self.whole.second[1] / self.whole.second[0];
        // What it moved by, also where it is too large for the whole fraction.
        self.whole.shift(self.origin - before);
    }

    /// What the bearings so far say.
    pub fn answer(&self) -> Answer<T> {
        let count = self.count();
        let mut sums = self.whole;
        sums.merge(&self.block);
        let spectrum = self.spectrum(&sums.root);
        let log = (0..4).fold(T::zero(), |sum, i| {
            sum + sums.root.factor()[i][i].abs().ln()
        });
        let log_determinant = log + log;
        let mut answer = Answer {
            count,
            rank: spectrum.rank(),
            determinant: log_determinant.exp(),
            log_determinant,
            singular_value: spectrum.singular_values()[3],
            crlb_std: crlb_std(&spectrum),
            statistic: T::zero(),
            dof: T::zero(),
            p_value: T::one(),
            relative_motion: [T::zero(); 4],
        };
        // The product itself where it can be formed: no logarithm's rounding.
        let product = sums.root.root_determinant();
        let square = product * product;
        if square > T::zero() && square.is_finite() {
            answer.determinant = square;
        }
        if count >= 4 {
            let mut tested = answer;
            self.test(&sums, &mut tested);
            let numbers = [tested.statistic, tested.dof, tested.p_value];
            if all_finite(&numbers) && all_finite(&tested.relative_motion) {
                return tested;
            }
        }
        answer
    }

    /// The spectrum of the rows in given axes at the first time.
    fn spectrum(&self, of: &SquareRootInformation<T, 4>) -> Spectrum<T, 4> {
        let (sin, cos) = self.turn.sin_cos();
        let shift = self.origin - self.first;
        let mut root = SquareRootInformation::new();
        for row in of.factor() {
            let [x, y, vx, vy] = *row;
            let (vx, vy) = (vx + shift * x, vy + shift * y);
            root.absorb(&[
                cos * x + sin * y,
                cos * y - sin * x,
                cos * vx + sin * vy,
                cos * vy - sin * vx,
            ]);
        }
        // A row goes through about this many additions: in its block, and with it.
        let count = self.count();
        let additions = count.min(count.isqrt().saturating_mul(5) / 2);
        let additions = usize::try_from(additions).unwrap_or(usize::MAX);
        // The times given are only known to their last digit.
        let times = self.first.abs().max(self.last.abs()) / (self.last - self.first);
        let coarse = if times.is_finite() {
            T::EPSILON * times
        } else {
            T::zero()
        };
        Spectrum::within(&root, default_rtol::<T>(additions, 4) + coarse)
    }

    fn test(&self, sums: &Sums<T>, answer: &mut Answer<T>) {
        let m = T::of(f64::from(answer.count));
        let second = &sums.second;
        let mean = second[1] / second[0];
        let spread = (second[2] / second[0] - mean * mean).sqrt();
        if !(spread > T::zero()) {
            return;
        }
        let mut standard = [[T::zero(); 4]; 4];
        for (to, row) in standard.iter_mut().zip(sums.root.factor()) {
            *to = [
                row[0],
                row[1],
                (row[2] - mean * row[0]) / spread,
                (row[3] - mean * row[1]) / spread,
            ];
        }
        let ones = [T::one(); 4];
        let (mut s, mut v, mut work) = ([T::zero(); 4], [[T::zero(); 4]; 4], [[T::zero(); 4]; 4]);
        decompose(
            standard.as_flattened(),
            4,
            &ones,
            &mut s,
            v.as_flattened_mut(),
            work.as_flattened_mut(),
        );
        let c = v[3];
        // The motion with time from `origin`, |r|^2 = a + b T + d T^2 on average 1.
        let velocity = [c[2] / spread, c[3] / spread];
        let position = [c[0] - mean * velocity[0], c[1] - mean * velocity[1]];
        let two = T::one() + T::one();
        let a = position[0] * position[0] + position[1] * position[1];
        let b = two * (position[0] * velocity[0] + position[1] * velocity[1]);
        let d = velocity[0] * velocity[0] + velocity[1] * velocity[1];
        let [f0, f1, f2, f3, f4] = sums.fourth;
        let squares = a * a * f0
            + two * a * b * f1
            + (b * b + two * a * d) * f2
            + two * b * d * f3
            + d * d * f4;
        // The sums of q and of q^2.
        let total = second[0];
        let scale = squares / total;
        answer.statistic = s[3] * s[3] / scale;
        answer.dof = total / scale * (m - T::of(3.0)) / m;
        answer.p_value = chi_square::tail(answer.statistic, answer.dof);
        answer.relative_motion = self.motion(&position, &velocity);
    }

    /// A motion in turned axes from `origin` as one in given axes from the first
    /// time, at unit range and on the side of the first bearing.
    fn motion(&self, position: &[T; 2], velocity: &[T; 2]) -> [T; 4] {
        let back = self.first - self.origin;
        let at_first = [
            position[0] + back * velocity[0],
            position[1] + back * velocity[1],
        ];
        let range = hypot(at_first[0], at_first[1]);
        if !(range > T::zero()) {
            return [T::zero(); 4];
        }
        // In these axes the first bearing is due north.
        let unit = if at_first[1] < T::zero() {
            -range
        } else {
            range
        };
        let (sin, cos) = self.turn.sin_cos();
        let [x, y] = at_first.map(|p| p / unit);
        let [vx, vy] = velocity.map(|v| v / unit);
        [
            cos * x + sin * y,
            cos * y - sin * x,
            cos * vx + sin * vy,
            cos * vy - sin * vx,
        ]
    }
}

impl<T: Real> Default for Monitor<T> {
    fn default() -> Self {
        Self::new()
    }
}

/// Sums of T^k as sums of (T - shift)^k.
fn moments<T: Real, const N: usize>(sums: &[T; N], shift: T) -> [T; N] {
    // Repeated synthetic division: the binomial theorem without its numbers.
    let mut moved = *sums;
    for start in 1..N {
        for k in (start..N).rev() {
            moved[k] -= shift * moved[k - 1];
        }
    }
    moved
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::bearings::{discriminant_sum, observability_test};

    fn bearing(t: f64, turn: f64) -> f64 {
        // An observer at 5 m/s, north first; it turns at 500 s.
        let (before, after) = (t.min(500.0), (t - 500.0).max(0.0));
        let (east, north) = (
            5.0 * after * turn.sin(),
            5.0 * (before + after * turn.cos()),
        );
        (3.0 * t - east).atan2(10_000.0 - t - north)
    }

    #[test]
    fn a_monitor_that_was_kept_goes_on_alike() {
        let mut whole = Monitor::<f32>::new();
        for i in 0..200_u16 {
            let t = 20.0 * f32::from(i);
            let mut kept = Monitor::from_kept(&whole.kept()).unwrap();
            assert_eq!(kept, whole);
            let b = (3.0 * t).atan2(10_000.0 - 6.0 * t);
            whole.push(t, b, 0.01, None).unwrap();
            kept.push(t, b, 0.01, None).unwrap();
            assert_eq!(kept, whole);
        }
        let mut spoilt = whole.kept();
        spoilt.numbers[3] = f32::NAN;
        assert!(Monitor::from_kept(&spoilt).is_err());
        spoilt.numbers[3] = f32::MAX;
        assert!(Monitor::from_kept(&spoilt).is_err());
    }

    #[test]
    fn the_state_is_small() {
        assert_eq!(size_of::<Monitor<f32>>(), 220);
    }

    #[test]
    fn single_precision_agrees_with_double() {
        for turn in [0.0, 1.0] {
            let (mut single, mut double) = (Monitor::<f32>::new(), Monitor::<f64>::new());
            for i in 0..60 {
                // Noise of half a degree from a fixed sequence.
                let noise = 0.0087 * (f64::from(i * i) * 0.7).sin() * 1.4;
                let t = 20.0 * f64::from(i);
                let b = crate::scalar::wrapped(bearing(t, turn) + noise + 3.0);
                #[allow(clippy::cast_possible_truncation)]
                single.push(t as f32, b as f32, 0.0087, None).unwrap();
                double.push(t, b, 0.0087, None).unwrap();
            }
            let (s, d) = (single.answer(), double.answer());
            assert_eq!(s.rank, d.rank);
            assert!((f64::from(s.log_determinant) - d.log_determinant).abs() < 1e-3);
            assert!((f64::from(s.statistic) / d.statistic - 1.0).abs() < 1e-3);
            assert!((f64::from(s.p_value) - d.p_value).abs() < 1e-3);
            for k in 0..4 {
                assert!((f64::from(s.crlb_std[k]) / d.crlb_std[k] - 1.0).abs() < 1e-2);
            }
        }
    }

    #[test]
    fn in_single_precision_an_exact_straight_track_has_rank_three() {
        let mut monitor = Monitor::<f32>::new();
        for i in 0..60 {
            let t = 20.0 * f64::from(i);
            #[allow(clippy::cast_possible_truncation)]
            let b = bearing(t, 0.0) as f32;
            #[allow(clippy::cast_possible_truncation)]
            monitor.push(t as f32, b, 0.0087, None).unwrap();
        }
        assert_eq!(monitor.answer().rank, 3);
    }

    #[test]
    fn determinant_and_test_are_those_of_all_bearings() {
        let mut monitor = Monitor::<f64>::new();
        let (mut times, mut bearings) = ([0.0; 50], [0.0; 50]);
        for i in 0..50_u32 {
            let t = 1e5 + 20.0 * f64::from(i);
            let b = bearing(t - 1e5, 0.2) + 0.005 * (f64::from(i * i) * 0.7).sin();
            (times[i as usize], bearings[i as usize]) = (t, b);
            monitor.push(t, b, 0.01, None).unwrap();
            let m = i as usize + 1;
            if m < 4 {
                assert_eq!(monitor.answer().p_value, 1.0);
                continue;
            }
            let answer = monitor.answer();
            let det = discriminant_sum(&times[..m], &bearings[..m], None).unwrap() * 1e16;
            assert!((answer.determinant / det - 1.0).abs() < 1e-9, "{m}");
            let batch = observability_test(&times[..m], &bearings[..m], &[0.01]).unwrap();
            // The range halves, so the residuals are weighted from 2 to 0.5.
            assert!((answer.statistic - batch.statistic).abs() < 0.1 + 0.2 * batch.statistic);
            // Never more than m - 3 (Cauchy and Schwarz). While few bearings leave
            // the motion open, the one that fits may well come near and have less;
            // later it is seen to keep its range.
            let share = answer.dof / f64::from(i - 2);
            assert!(share <= 1.0 + 1e-9, "{m}: {share}");
            assert!(m < 40 || share > 0.9, "{m}: {share}");
        }
    }

    #[test]
    fn where_the_range_stays_the_statistic_is_that_of_the_batch_test() {
        let mut monitor = Monitor::<f64>::new();
        let (mut times, mut bearings) = ([0.0; 60], [0.0; 60]);
        for i in 0..60_u32 {
            let t = 20.0 * f64::from(i);
            let noise = 0.0007 * (f64::from(i * i) * 0.7).sin();
            let b = (3.0 * t - 1800.0).atan2(-10_000.0) + noise;
            (times[i as usize], bearings[i as usize]) = (t, b);
            monitor.push(t, b, 0.0005, None).unwrap();
        }
        let answer = monitor.answer();
        let batch = observability_test(&times, &bearings, &[0.0005]).unwrap();
        assert!((answer.statistic / batch.statistic - 1.0).abs() < 0.01);
        assert!((answer.dof / 57.0 - 1.0).abs() < 0.01);
        assert!((answer.p_value - batch.p_value).abs() < 0.03);
        for k in 0..4 {
            assert!((answer.relative_motion[k] - batch.relative_motion[k]).abs() < 1e-3);
        }
    }

    #[test]
    fn bad_bearings_are_refused_and_change_nothing() {
        let mut monitor = Monitor::<f64>::new();
        monitor.push(0.0, 0.1, 0.01, None).unwrap();
        let before = monitor;
        assert!(matches!(
            monitor.push(0.0, 0.1, 0.01, None),
            Err(Error::Times { index: 1, .. })
        ));
        assert!(matches!(
            monitor.push(1.0, 0.1, 0.0, None),
            Err(Error::Sigma { .. })
        ));
        assert!(matches!(
            monitor.push(1.0, f64::NAN, 0.1, None),
            Err(Error::Number(_))
        ));
        assert!(matches!(
            monitor.push(1.0, 0.1, 0.1, Some(-1.0)),
            Err(Error::Distance { .. })
        ));
        assert!(matches!(
            monitor.push(1.0, 0.1, 0.1, Some(5.0)),
            Err(Error::Mixed { index: 1 })
        ));
        assert_eq!(monitor, before);
    }
}
