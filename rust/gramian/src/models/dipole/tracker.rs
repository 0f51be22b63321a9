//! While samples arrive: a dipole that maneuvers, and what is known of it. No allocation;
//! the time of a sample does not grow.

use super::{Error, field, jacobian};
use crate::chi_square;
use crate::posterior::Posterior;
use crate::scalar::{NumberError, Real, check_finite, check_positive};

/// How a dipole wanders between samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wander<T> {
    /// Spectral density of its acceleration, white in time, (m/s^2)^2/Hz: in a time t each
    /// component of the velocity gains a standard deviation of sqrt(acceleration t).
    pub acceleration: T,
    /// Of the changes of its moment, (A m^2)^2/s: in a time t each component gains
    /// sqrt(moment t), as where the body turns.
    pub moment: T,
}

/// One sample of a vector sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample<T> {
    /// s; not before that of the last sample.
    pub time: T,
    /// Where the sensor is, m.
    pub sensor: [T; 3],
    /// What it reads, the background taken off, T.
    pub field: [T; 3],
    /// Standard deviation of each component, T.
    pub sigma: T,
}

/// What the samples so far say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer<T> {
    /// Position, velocity and moment at the time of the last sample.
    pub state: [T; 9],
    /// Standard deviations in the local approximation.
    pub std: [T; 9],
    /// How many samples there are.
    pub count: u32,
    /// Sum of what each sample adds to the least squares: chi-square with three degrees of
    /// freedom a sample where the model is true.
    pub chi2: T,
    /// Probability of one as large.
    pub p_value: T,
}

/// An iterated square-root information filter of (r, v, m), the state at the time of the
/// last sample.
///
/// It begins with a prior of every state: one sensor alone cannot tell a small dipole near
/// by from a large one far away. Each sample is taken in at the state that fits it and all
/// that was known best, by damped Gauss-Newton steps. 400 bytes in single precision.
///
/// # Source
/// Square-root information filter: Bierman 1977, chapters V and VI; iteration as
/// Gauss-Newton steps: Bell & Cathey 1993.
///
/// ```
/// use gramian::dipole::tracker::{Sample, Tracker, Wander};
/// use gramian::dipole::field;
/// let (start, sigma) = ([-11.0, -9.0, 5.5, 0.8, 1.1, 0.0, 12.0, 18.0, 9.0], [2.0, 2.0, 1.0, 0.5, 0.5, 0.1, 5.0, 5.0, 5.0]);
/// let mut tracker = Tracker::new(0.0_f64, &start, &sigma)?;
/// let wander = Wander { acceleration: 1e-6, moment: 1e-6 };
/// for k in 0..41 {
///     let time = 0.5 * f64::from(k);
///     let place = [-10.0 + time, -10.0 + time, 5.0];
///     let field = field(&place, &[10.0, 20.0, 10.0])?;
///     tracker.push(&Sample { time, sensor: [0.0; 3], field, sigma: 1e-10 }, &wander)?;
/// }
/// let answer = tracker.answer();
/// assert!((answer.state[0] - 10.0).abs() < 3.0 * answer.std[0]);
/// # Ok::<(), gramian::dipole::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracker<T: Real> {
    time: T,
    state: [T; 9],
    known: Posterior<T, 9>,
    count: u32,
    chi2: T,
}

/// Steps of a sample at most.
const STEPS: usize = 12;

impl<T: Real> Tracker<T> {
    /// Begins at a state known to these standard deviations, all finite.
    ///
    /// # Errors
    /// [`Error::Number`] for what is not finite or a deviation that is not positive.
    pub fn new(time: T, state: &[T; 9], sigma: &[T; 9]) -> Result<Self, Error> {
        check_finite("sigma", sigma)?;
        Self::resumed(time, state, prior(sigma)?)
    }

    /// Begins at a state of which so much is known: where another one ended, for instance.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn resumed(time: T, state: &[T; 9], known: Posterior<T, 9>) -> Result<Self, Error> {
        check_finite("time", &[time])?;
        check_finite("state", state)?;
        Ok(Self {
            time,
            state: *state,
            known,
            count: 0,
            chi2: T::zero(),
        })
    }

    /// Moves on to a time without a sample.
    ///
    /// # Errors
    /// [`Error::Number`] for a time before that of the last sample, a density below zero, or
    /// what is not finite. The tracker stays as it was then.
    pub fn predict(&mut self, time: T, wander: &Wander<T>) -> Result<(), Error> {
        *self = self.moved(time, wander)?;
        Ok(())
    }

    fn moved(&self, time: T, wander: &Wander<T>) -> Result<Self, Error> {
        let step = later(self.time, time)?;
        let mut next = *self;
        next.time = time;
        for k in 0..3 {
            next.state[k] += step * self.state[k + 3];
        }
        if !next.state.iter().all(nalgebra::ComplexField::is_finite) {
            return Err(overflow("state"));
        }
        next.known = advanced(&self.known, step, wander)?;
        Ok(next)
    }

    /// Takes in a sample; gives what it adds to chi-square, three degrees of freedom.
    ///
    /// # Errors
    /// As [`predict`](Self::predict); [`Error::Number`] for a field that is not finite or a
    /// deviation that is not positive, or where the result overflows; [`Error::OnSensor`] where
    /// the dipole would be on the sensor. Nothing is taken in then.
    pub fn push(&mut self, sample: &Sample<T>, wander: &Wander<T>) -> Result<T, Error> {
        check_finite("sensor", &sample.sensor)?;
        check_finite("field", &sample.field)?;
        check_positive("sigma", sample.sigma)?;
        let mut next = self.moved(sample.time, wander)?;
        let before = next.state;
        let root = *next.known.root().factor();
        // What was known, at a state.
        let before_it = |state: &[T; 9]| -> T {
            (0..9).fold(T::zero(), |sum, i| {
                let off = (i..9).fold(T::zero(), |off, j| {
                    off + root[i][j] * (state[j] - before[j])
                });
                sum + off * off
            })
        };
        let mut state = before;
        let (mut rows, mut left) = sample.rows(&state)?;
        let mut cost = sum(&left);
        for _ in 0..STEPS {
            // The rest at the state before the sample, were the model linear.
            let mut rest = left;
            for (rest, row) in rest.iter_mut().zip(&rows) {
                for k in 0..9 {
                    *rest += row[k] * (state[k] - before[k]);
                }
            }
            let best = solve(&root, &rows, &rest);
            let mut share = T::one();
            let mut taken = false;
            let mut gain = T::zero();
            for _ in 0..10 {
                let mut trial = state;
                for k in 0..9 {
                    trial[k] += share * (before[k] + best[k] - state[k]);
                }
                if let Ok((r, l)) = sample.rows(&trial) {
                    let new = sum(&l) + before_it(&trial);
                    if new <= cost {
                        gain = cost - new;
                        (state, rows, left, cost, taken) = (trial, r, l, new, true);
                        break;
                    }
                }
                share *= T::of(0.5);
            }
            if !taken || gain <= T::of(1e-6) * (T::one() + cost) {
                break;
            }
        }
        for row in &rows {
            next.known.update(row)?;
        }
        next.state = state;
        next.count = next.count.saturating_add(1);
        next.chi2 += cost;
        if !(next.chi2.is_finite() && state.iter().all(nalgebra::ComplexField::is_finite)) {
            return Err(overflow("chi2"));
        }
        *self = next;
        Ok(cost)
    }

    /// The state at the time of the last sample.
    pub fn state(&self) -> &[T; 9] {
        &self.state
    }

    /// The root of the information on it.
    pub fn known(&self) -> &Posterior<T, 9> {
        &self.known
    }

    /// All that the samples so far say.
    pub fn answer(&self) -> Answer<T> {
        Answer {
            state: self.state,
            std: self.known.standard_deviations(),
            count: self.count,
            chi2: self.chi2,
            p_value: chi_square::tail(self.chi2, T::of(3.0 * f64::from(self.count))),
        }
    }
}

/// The posterior Cramer-Rao bound of such a filter, along one true course: its mean
/// information over courses is that of the bound.
///
/// # Source
/// Tichavsky, Muravchik & Nehorai 1998.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound<T: Real> {
    time: T,
    known: Posterior<T, 9>,
}

impl<T: Real> Bound<T> {
    /// Begins with these standard deviations, infinite where nothing is known.
    ///
    /// # Errors
    /// [`Error::Number`] for a time that is not finite or a deviation that is not positive.
    pub fn new(time: T, sigma: &[T; 9]) -> Result<Self, Error> {
        check_finite("time", &[time])?;
        Ok(Self::resumed(time, prior(sigma)?))
    }

    /// Goes on from where so much was known.
    pub fn resumed(time: T, known: Posterior<T, 9>) -> Self {
        Self { time, known }
    }

    /// What a sample tells where the true state is this one; what it reads does not matter.
    ///
    /// # Errors
    /// As [`Tracker::push`].
    pub fn push(
        &mut self,
        sample: &Sample<T>,
        truth: &[T; 9],
        wander: &Wander<T>,
    ) -> Result<(), Error> {
        check_finite("truth", truth)?;
        check_finite("sensor", &sample.sensor)?;
        check_positive("sigma", sample.sigma)?;
        let mut known = advanced(&self.known, later(self.time, sample.time)?, wander)?;
        for row in &sample.rows(truth)?.0 {
            known.update(row)?;
        }
        (self.time, self.known) = (sample.time, known);
        Ok(())
    }

    /// The root of the information.
    pub fn known(&self) -> &Posterior<T, 9> {
        &self.known
    }

    /// The bound on each state; infinite where it is not determined.
    pub fn std(&self) -> [T; 9] {
        self.known.standard_deviations()
    }
}

/// Independent knowledge of each state.
fn prior<T: Real>(sigma: &[T; 9]) -> Result<Posterior<T, 9>, Error> {
    let mut known = Posterior::unknown();
    for (k, &sigma) in sigma.iter().enumerate() {
        if !(sigma > T::zero()) {
            return Err(out_of_range("sigma", sigma, "above 0"));
        }
        let mut row = [T::zero(); 9];
        row[k] = T::one() / sigma;
        known.update(&row)?;
    }
    Ok(known)
}

/// The time from one sample to the next.
fn later<T: Real>(from: T, to: T) -> Result<T, Error> {
    check_finite("time", &[to])?;
    if to < from {
        return Err(out_of_range("time", to, "at least that of the last sample"));
    }
    if !(to - from).is_finite() {
        return Err(overflow("time since the last sample"));
    }
    Ok(to - from)
}

/// What is known a time `step` later.
fn advanced<T: Real>(
    known: &Posterior<T, 9>,
    step: T,
    wander: &Wander<T>,
) -> Result<Posterior<T, 9>, Error> {
    let densities = [wander.acceleration, wander.moment];
    for (name, given) in [("acceleration", densities[0]), ("moment", densities[1])] {
        if !(given >= T::zero() && given.is_finite()) {
            return Err(out_of_range(name, given, "at least 0 and finite"));
        }
    }
    let mut next = *known;
    if step == T::zero() {
        return Ok(next);
    }
    let mut inverse = [[T::zero(); 9]; 9];
    for (k, row) in inverse.iter_mut().enumerate() {
        row[k] = T::one();
        if k < 3 {
            row[k + 3] = -step;
        }
    }
    // The root of the covariance of an integrated white acceleration.
    let [a, m] = densities.map(|density| (density * step).sqrt());
    let (mut noise, mut count) = ([[T::zero(); 9]; 9], 0);
    if a > T::zero() {
        for k in 0..3 {
            noise[count][k] = a * step / T::of(3.0).sqrt();
            noise[count][k + 3] = a * T::of(0.75).sqrt();
            noise[count + 1][k + 3] = T::of(0.5) * a;
            count += 2;
        }
    }
    if m > T::zero() {
        for k in 6..9 {
            noise[count][k] = m;
            count += 1;
        }
    }
    next.predict(&inverse, &noise[..count])?;
    Ok(next)
}

impl<T: Real> Sample<T> {
    /// The whitened rows at a state, and what the field there leaves of the sample.
    fn rows(&self, state: &[T; 9]) -> Result<([[T; 9]; 3], [T; 3]), Error> {
        let place = [0, 1, 2].map(|i| state[i] - self.sensor[i]);
        let moment = [state[6], state[7], state[8]];
        let (h, j) = (field(&place, &moment)?, jacobian(&place, &moment)?);
        let mut rows = [[T::zero(); 9]; 3];
        let mut left = [T::zero(); 3];
        for i in 0..3 {
            left[i] = (self.field[i] - h[i]) / self.sigma;
            for k in 0..3 {
                rows[i][k] = j.position[i][k] / self.sigma;
                rows[i][k + 6] = j.moment[i][k] / self.sigma;
            }
        }
        Ok((rows, left))
    }
}

fn sum<T: Real>(left: &[T; 3]) -> T {
    left.iter().fold(T::zero(), |sum, &x| sum + x * x)
}

fn overflow(result: &'static str) -> Error {
    Error::Number(NumberError::Overflow { result })
}

fn out_of_range<T: Real>(name: &'static str, given: T, allowed: &'static str) -> Error {
    Error::Number(NumberError::OutOfRange {
        name,
        given: given.double(),
        allowed,
    })
}

/// The step from a state known by `root` to the best one with rows and their residuals.
fn solve<T: Real>(root: &[[T; 9]; 9], rows: &[[T; 9]; 3], left: &[T; 3]) -> [T; 9] {
    let mut factor = *root;
    let mut along = [T::zero(); 9];
    for (row, &rest) in rows.iter().zip(left) {
        let (mut row, mut rest) = (*row, rest);
        for k in 0..9 {
            let (a, b) = (factor[k][k], row[k]);
            if b == T::zero() {
                continue;
            }
            let h = crate::scalar::hypot(a, b);
            let (c, s) = (a / h, b / h);
            for j in k..9 {
                let (x, y) = (factor[k][j], row[j]);
                factor[k][j] = c * x + s * y;
                row[j] = c * y - s * x;
            }
            let (x, y) = (along[k], rest);
            along[k] = c * x + s * y;
            rest = c * y - s * x;
        }
    }
    for i in (0..9).rev() {
        let sum = (i + 1..9).fold(along[i], |sum, j| sum - factor[i][j] * along[j]);
        along[i] = sum / factor[i][i];
    }
    along
}

// The noise of these tests comes from the streams of `batch`.
#[cfg(all(test, feature = "std"))]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const TRUTH: [f64; 9] = [-10.0, -10.0, 5.0, 1.0, 1.0, 0.0, 10.0, 20.0, 10.0];
    const SIGMA: [f64; 9] = [0.5, 0.5, 0.3, 0.1, 0.1, 0.05, 1.5, 1.5, 1.5];
    const SENSORS: [[f64; 3]; 2] = [[0.0; 3], [3.0, 0.0, 0.0]];
    const WANDER: Wander<f64> = Wander {
        acceleration: 0.001,
        moment: 0.01,
    };

    /// A dipole that wanders as it is told to: the tracker at the end, and the true state.
    fn run<T: Real>(seed: u64, wander: f64) -> (Tracker<T>, [f64; 9]) {
        let mut stream = crate::batch::Stream::new(seed, 0);
        let mut truth = TRUTH;
        let start: [f64; 9] = core::array::from_fn(|k| truth[k] + SIGMA[k] * stream.normal());
        let mut tracker = Tracker::new(T::zero(), &start.map(T::of), &SIGMA.map(T::of)).unwrap();
        let told = Wander {
            acceleration: T::of(WANDER.acceleration),
            moment: T::of(WANDER.moment),
        };
        let step = 0.25_f64;
        for k in 0..80 {
            if k > 0 {
                let a = (wander * WANDER.acceleration * step).sqrt();
                let m = (wander * WANDER.moment * step).sqrt();
                for axis in 0..3 {
                    let (u, w) = (stream.normal(), stream.normal());
                    truth[axis] += step * truth[axis + 3] + a * step / 3.0_f64.sqrt() * u;
                    truth[axis + 3] += a * (0.75_f64.sqrt() * u + 0.5 * w);
                    truth[axis + 6] += m * stream.normal();
                }
            }
            for sensor in SENSORS {
                let place = [0, 1, 2].map(|i| truth[i] - sensor[i]);
                let h = field(&place, &[truth[6], truth[7], truth[8]]);
                let field = h.unwrap().map(|h| T::of(h + 1e-9 * stream.normal()));
                let sample = Sample {
                    time: T::of(step * f64::from(k)),
                    sensor: sensor.map(T::of),
                    field,
                    sigma: T::of(1e-9),
                };
                tracker.push(&sample, &told).unwrap();
            }
        }
        (tracker, truth)
    }

    #[test]
    fn its_deviations_and_its_chi_square_are_honest() {
        let (mut nees, mut chi2, trials) = (0.0, 0.0, 150_u32);
        for seed in 0..u64::from(trials) {
            let (tracker, truth) = run::<f64>(seed, 1.0);
            let off: [f64; 9] = core::array::from_fn(|k| truth[k] - tracker.state[k]);
            for row in tracker.known.root().factor() {
                nees += (0..9).map(|k| row[k] * off[k]).sum::<f64>().powi(2);
            }
            chi2 += tracker.chi2;
        }
        let (nees, chi2) = (nees / f64::from(trials), chi2 / f64::from(trials));
        // 9 and 480 with a deviation of 0.35 and 2.5 for a linear model.
        assert!((nees - 9.0).abs() < 2.5, "{nees}");
        assert!((chi2 - 480.0).abs() < 12.0, "{chi2}");
    }

    #[test]
    fn single_precision_follows() {
        let (double, _) = run::<f64>(3, 1.0);
        let (single, _) = run::<f32>(3, 1.0);
        let (double, single) = (double.answer(), single.answer());
        for k in 0..9 {
            let off = f64::from(single.state[k]) - double.state[k];
            assert!(off.abs() < 0.1 * double.std[k], "{k}: {off}");
        }
    }

    #[test]
    fn one_that_wanders_more_than_told_does_not_fit() {
        let mean: f64 = (0..8).map(|k| run::<f64>(k, 1000.0).0.chi2).sum::<f64>() / 8.0;
        // 480 with a deviation of 11 where it wanders as told.
        assert!(mean > 520.0, "{mean}");
    }

    #[test]
    fn bad_input_leaves_it_as_it_was() {
        let mut tracker = Tracker::new(0.0_f32, &TRUTH.map(f32::of), &[1.0; 9]).unwrap();
        let before = tracker;
        let wander = Wander {
            acceleration: 0.0_f32,
            moment: 0.0,
        };
        let sample = Sample {
            time: 1.0_f32,
            sensor: [0.0; 3],
            field: [1e-9; 3],
            sigma: 1e-9,
        };
        let bad = [
            Sample {
                time: -1.0,
                ..sample
            },
            Sample {
                time: f32::NAN,
                ..sample
            },
            Sample {
                field: [f32::INFINITY; 3],
                ..sample
            },
            Sample {
                sigma: 0.0,
                ..sample
            },
            Sample {
                time: 0.0,
                sensor: [-10.0, -10.0, 5.0],
                ..sample
            },
        ];
        for sample in &bad {
            assert!(tracker.push(sample, &wander).is_err());
        }
        let negative = Wander {
            acceleration: -1.0,
            ..wander
        };
        assert!(tracker.push(&sample, &negative).is_err());
        assert_eq!(tracker, before);
        assert!(Tracker::new(0.0, &[0.0; 9], &[0.0; 9]).is_err());
    }
}
