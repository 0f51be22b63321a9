//! While measurements arrive: the state, its square-root information, a running fit
//! test, and an alarm for a turn. No allocation; the time of a push does not grow.

use super::Error;
use super::motion::{Change, Motion};
use super::sensors::{Sensor, Sight};
use crate::numbers::angle::wrapped;
use crate::scalar::{NumberError, Real, all_finite, check_finite, check_positive, hypot};

/// One measurement, and the carrier when it was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample<T, const D: usize> {
    /// s after the reference time of the motion.
    pub time: T,
    /// What the sensor read.
    pub reading: T,
    /// Its standard deviation.
    pub sigma: T,
    /// Place of the carrier, m.
    pub place: [T; D],
    /// Its velocity, m/s.
    pub velocity: [T; D],
    /// The axis of an array, a unit vector.
    pub axis: [T; D],
}

/// What the measurements so far say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer<T, const N: usize> {
    /// The estimate.
    pub state: [T; N],
    /// Standard deviations, infinite where there are none.
    pub std: [T; N],
    /// How many measurements there are.
    pub count: u32,
    /// Sum of the squared innovations over their own variance: chi-square with `count`
    /// degrees of freedom where the motion is true.
    pub chi2: T,
    /// Probability of one as large.
    pub p_value: T,
    /// Whether the innovations have drifted: the target has turned.
    pub alarm: bool,
}

/// The estimator: an extended information filter of a constant state, on the
/// triangular factor of the information.
///
/// It begins with a prior of every state, since a step needs a place to be taken from.
/// Each innovation, over its own standard deviation, is one standard normal number where
/// the motion is true; the sum of their squares is the fit test, and the larger of two
/// cumulative sums the alarm.
///
/// # Source
/// Square-root information: Bierman 1977, chapter V. The alarm: Page 1954, Biometrika 41,
/// with reference value 1/2; at the default limit of 8 a false one comes once in some
/// 10 000 measurements.
///
/// ```
/// use gramian::tracks::motion::Polynomial;
/// use gramian::tracks::sensors::Range;
/// use gramian::tracks::stream::{Sample, Tracker};
/// // Ranges along a line, target at rest at 100 m.
/// let mut tracker = Tracker::new(&[80.0_f64, 0.1], &[50.0, 1.0])?;
/// for k in 0..20 {
///     let east = f64::from(k);
///     let sample = Sample {
///         time: east,
///         reading: (100.0 - east).abs(),
///         sigma: 0.5,
///         place: [east, 0.0],
///         velocity: [1.0, 0.0],
///         axis: [1.0, 0.0],
///     };
///     tracker.push(&Polynomial::FIXED, &Range { factor: 1.0 }, &[0.0; 2], &sample)?;
/// }
/// assert!((tracker.answer().state[0] - 100.0).abs() < 0.5);
/// assert!(!tracker.answer().alarm);
/// # Ok::<(), gramian::tracks::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracker<T, const N: usize> {
    state: [T; N],
    factor: [[T; N]; N],
    count: u32,
    chi2: T,
    drift: [T; 2],
    limit: T,
}

impl<T: Real, const N: usize> Tracker<T, N> {
    /// Begins at a state known to these standard deviations.
    ///
    /// # Errors
    /// [`Error::Number`] for what is not finite or a deviation that is not positive.
    pub fn new(state: &[T; N], sigma: &[T; N]) -> Result<Self, Error> {
        check_finite("state", state)?;
        let mut factor = [[T::zero(); N]; N];
        for (k, (row, &sigma)) in factor.iter_mut().zip(sigma).enumerate() {
            check_positive("sigma", sigma)?;
            row[k] = T::one() / sigma;
        }
        Ok(Self {
            state: *state,
            factor,
            count: 0,
            chi2: T::zero(),
            drift: [T::zero(); 2],
            limit: T::of(8.0),
        })
    }

    /// The same with another limit of the alarm, in standard deviations.
    #[must_use]
    pub fn with_limit(mut self, limit: T) -> Self {
        self.limit = limit;
        self
    }

    /// Takes in a measurement; gives its innovation over its standard deviation.
    ///
    /// # Errors
    /// [`Error::Number`] for what is not finite; [`Error::NoReading`] where the sensor
    /// reads nothing at the estimate. Nothing is taken in then.
    pub fn push<M: Motion<D>, S: Sensor<D>, const D: usize>(
        &mut self,
        motion: &M,
        sensor: &S,
        parameters: &[T; 2],
        sample: &Sample<T, D>,
    ) -> Result<T, Error> {
        check_finite("time", &[sample.time])?;
        check_finite("reading", &[sample.reading])?;
        check_positive("sigma", sample.sigma)?;
        check_finite("place", &sample.place)?;
        check_finite("velocity", &sample.velocity)?;
        if motion.states() != N {
            return Err(Error::Number(NumberError::Length {
                array: "state",
                given: N,
                wanted: motion.states(),
            }));
        }
        let mut changes = [Change::zero(sample.time); N];
        let now = motion.at(&self.state, sample.time, &mut changes);
        let mut offset = now.place;
        for (offset, place) in offset.iter_mut().zip(&sample.place) {
            *offset -= *place;
        }
        let sight = Sight {
            offset,
            target: now.velocity,
            carrier: sample.velocity,
            axis: sample.axis,
        };
        let reading = sensor.read(&sight, parameters);
        let mut row = [T::zero(); N];
        for (entry, change) in row.iter_mut().zip(&changes) {
            *entry = reading.along(&change.place, &change.velocity) / sample.sigma;
        }
        let mut off = sample.reading - reading.value;
        if S::WRAPS {
            off = wrapped(off);
        }
        off /= sample.sigma;
        if !all_finite(&row) || !off.is_finite() {
            return Err(Error::NoReading {
                index: self.count as usize,
                reason: "the sensor reads nothing at the estimate, or has no derivative there",
            });
        }
        // The row's length in units of the factor: its part of the innovation's variance.
        let mut along = row;
        for i in 0..N {
            let sum = (0..i).fold(along[i], |sum, k| sum - self.factor[k][i] * along[k]);
            along[i] = sum / self.factor[i][i];
        }
        let variance = along.iter().fold(T::one(), |sum, &x| sum + x * x);
        let innovation = off / variance.sqrt();
        let moved = self.rotate(row, off);
        for (state, step) in self.state.iter_mut().zip(&moved) {
            *state += *step;
        }
        self.count = self.count.saturating_add(1);
        self.chi2 += innovation * innovation;
        let half = T::of(0.5);
        self.drift[0] = (self.drift[0] + innovation - half).max(T::zero());
        self.drift[1] = (self.drift[1] - innovation - half).max(T::zero());
        Ok(innovation)
    }

    /// Rotates a row with its residual into the factor; gives the step of the state.
    fn rotate(&mut self, mut row: [T; N], mut residual: T) -> [T; N] {
        let mut along = [T::zero(); N];
        for k in 0..N {
            let (a, b) = (self.factor[k][k], row[k]);
            if b == T::zero() {
                continue;
            }
            let h = hypot(a, b);
            let (c, s) = (a / h, b / h);
            for j in k..N {
                let (x, y) = (self.factor[k][j], row[j]);
                self.factor[k][j] = c * x + s * y;
                row[j] = c * y - s * x;
            }
            let (x, y) = (along[k], residual);
            along[k] = c * x + s * y;
            residual = c * y - s * x;
        }
        for i in (0..N).rev() {
            let sum = (i + 1..N).fold(along[i], |sum, j| sum - self.factor[i][j] * along[j]);
            along[i] = sum / self.factor[i][i];
        }
        along
    }

    /// Multiplies all information by `keep`, in (0, 1], and takes the alarm back: what
    /// was known before a turn counts less.
    ///
    /// # Errors
    /// [`Error::Number`].
    pub fn forget(&mut self, keep: T) -> Result<(), Error> {
        if !(keep > T::zero() && keep <= T::one()) {
            return Err(Error::Number(NumberError::OutOfRange {
                name: "keep",
                given: keep.double(),
                allowed: "above 0 and at most 1",
            }));
        }
        let root = keep.sqrt();
        for value in self.factor.as_flattened_mut() {
            *value *= root;
        }
        self.drift = [T::zero(); 2];
        Ok(())
    }

    /// The estimate so far.
    pub fn state(&self) -> &[T; N] {
        &self.state
    }

    /// All that the measurements so far say.
    pub fn answer(&self) -> Answer<T, N> {
        let mut std = [T::zero(); N];
        // Columns of the inverse factor.
        for column in 0..N {
            let mut y = [T::zero(); N];
            y[column] = T::one() / self.factor[column][column];
            for i in (0..column).rev() {
                let sum = (i + 1..=column).fold(T::zero(), |sum, j| sum + self.factor[i][j] * y[j]);
                y[i] = -sum / self.factor[i][i];
            }
            for (std, y) in std.iter_mut().zip(&y) {
                *std = hypot(*std, *y);
            }
        }
        let dof = T::of(f64::from(self.count));
        Answer {
            state: self.state,
            std,
            count: self.count,
            chi2: self.chi2,
            p_value: crate::chi_square::tail(self.chi2, dof),
            alarm: self.drift[0] > self.limit || self.drift[1] > self.limit,
        }
    }
}

// The noise of these tests comes from the streams of `batch`.
#[cfg(all(test, feature = "std"))]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::tracks::motion::Polynomial;
    use crate::tracks::sensors::{Bearing, Range};

    /// A target that turns half-way, if at all: bearings and ranges of a coast.
    fn run(turned: f64, seed: u64) -> (Answer<f64, 4>, Option<u32>) {
        let mut stream = crate::batch::Stream::new(seed, 0);
        let mut tracker =
            Tracker::new(&[3000.0, 4000.0, 0.0, 0.0], &[1000.0, 1000.0, 10.0, 10.0]).unwrap();
        let (mut place, mut velocity) = ([3200.0_f64, 4300.0], [-4.0_f64, 2.0]);
        let mut alarm = None;
        for k in 0..200 {
            let time = 5.0 * f64::from(k);
            if k == 100 {
                let (s, c) = turned.sin_cos();
                velocity = [
                    c * velocity[0] + s * velocity[1],
                    c * velocity[1] - s * velocity[0],
                ];
            }
            let range = place[0].hypot(place[1]);
            let bearing = place[0].atan2(place[1]);
            let mut sample = Sample {
                time,
                reading: bearing + 0.01 * stream.normal(),
                sigma: 0.01,
                place: [0.0; 2],
                velocity: [0.0; 2],
                axis: [0.0; 2],
            };
            let motion = Polynomial::CONSTANT_VELOCITY;
            tracker.push(&motion, &Bearing, &[0.0; 2], &sample).unwrap();
            sample.reading = range + 20.0 * stream.normal();
            sample.sigma = 20.0;
            let ranging = Range { factor: 1.0 };
            tracker.push(&motion, &ranging, &[0.0; 2], &sample).unwrap();
            if alarm.is_none() && tracker.answer().alarm {
                alarm = Some(k);
            }
            for axis in 0..2 {
                place[axis] += 5.0 * velocity[axis];
            }
        }
        (tracker.answer(), alarm)
    }

    #[test]
    fn the_alarm_rings_at_a_turn_and_not_without() {
        let (mut false_alarms, mut seen, mut misfits) = (0, 0, 0);
        for seed in 0..40 {
            let (straight, alarm) = run(0.0, seed);
            false_alarms += u32::from(alarm.is_some());
            misfits += u32::from(straight.p_value < 0.05);
            for (k, truth) in [3200.0, 4300.0, -4.0, 2.0].into_iter().enumerate() {
                assert!((straight.state[k] - truth).abs() < 5.0 * straight.std[k]);
            }
            let (turned, alarm) = run(1.0, seed);
            seen += u32::from(alarm.is_some_and(|k| (100..160).contains(&k)));
            assert!(turned.p_value < 1e-3);
        }
        assert!(false_alarms <= 4, "{false_alarms}");
        assert!(misfits <= 6, "{misfits}");
        assert!(seen >= 36, "{seen}");
    }

    #[test]
    fn bad_input_leaves_it_as_it_was() {
        let mut tracker = Tracker::new(&[0.0_f32, 0.0], &[1.0, 1.0]).unwrap();
        let before = tracker;
        let sample = Sample {
            time: 0.0,
            reading: f32::NAN,
            sigma: 1.0,
            place: [5.0, 0.0],
            velocity: [0.0; 2],
            axis: [0.0; 2],
        };
        let fixed = Polynomial::FIXED;
        assert!(tracker.push(&fixed, &Bearing, &[0.0; 2], &sample).is_err());
        let on = Sample {
            reading: 0.0,
            place: [0.0; 2],
            ..sample
        };
        assert!(tracker.push(&fixed, &Bearing, &[0.0; 2], &on).is_err());
        assert_eq!(tracker, before);
        assert!(Tracker::new(&[0.0], &[0.0]).is_err());
        assert!(tracker.forget(0.0).is_err());
    }
}
