//! Flights given by samples of attitude and velocity, as segments with a constant error
//! model.

use super::earth::{Earth, check_place, gravity};
use super::error_model::{GravityGradient, Motion, rotation};
use super::flight::Segment;
use super::{Error, add, product, transposed};
use crate::numbers::algebra::{cross, dot};
use crate::scalar::{Real, check_finite, check_positive, finite};

/// A turn between samples beyond this, rad, could have been the other way round.
const LARGEST_TURN: f64 = 3.0;

/// A moment of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample<T> {
    /// s.
    pub time: T,
    /// North, west, up, m/s.
    pub velocity: [T; 3],
    /// Heading, pitch and roll, rad; see [`rotation`].
    pub angles: [T; 3],
    /// The leg that begins or goes on here.
    pub leg: usize,
}

/// Oscillation of heading, pitch and roll: a vehicle moored, on its wheels in the wind, at
/// sea.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sway<T> {
    /// rad.
    pub amplitude: [T; 3],
    /// s.
    pub period: [T; 3],
    /// At time 0, rad.
    pub phase: [T; 3],
}

impl<T: Real> Sway<T> {
    /// Heading, pitch and roll, less their means, at a time.
    ///
    /// # Units
    /// s, rad.
    ///
    /// # Errors
    /// [`Error::Number`] for a number that is not finite or a period that is not positive.
    ///
    /// ```
    /// let sway = gramian::inertial::Sway {
    ///     amplitude: [0.1, 0.2, 0.3], period: [8.0; 3], phase: [0.0; 3],
    /// };
    /// assert_eq!(sway.at(2.0_f64)?, [0.1, 0.2, 0.3]);
    /// # Ok::<(), gramian::inertial::Error>(())
    /// ```
    pub fn at(&self, time: T) -> Result<[T; 3], Error> {
        check_finite("time", &[time])?;
        check_finite("amplitude", &self.amplitude)?;
        check_finite("phase", &self.phase)?;
        for period in self.period {
            check_positive("period", period)?;
        }
        let angles = core::array::from_fn(|i| {
            self.amplitude[i] * (T::two_pi() * (time / self.period[i]) + self.phase[i]).sin()
        });
        Ok(finite("sway", angles)?)
    }
}

/// The segments of a recorded flight, one after the other.
///
/// Over a segment the specific force and the angular rate are those that make the
/// velocity and the attitude at its end of those at its beginning; all else is that of its
/// middle. Between samples the place follows from the velocity.
///
/// # Errors
/// Items are errors where times do not grow, numbers are not finite, the attitude turns too
/// far between samples, or the flight comes to a pole.
///
/// ```
/// use gramian::inertial::{EARTH_RATE, Recorded, Sample};
/// let at = |time: f64| Sample {
///     time, velocity: [50.0, 0.0, 0.0], angles: [0.0, 0.0, 0.01 * time], leg: 0,
/// };
/// let samples: Vec<_> = (0..11).map(|k| at(f64::from(k))).collect();
/// let place = [0.8, 0.0, 0.0];
/// let segments = Recorded::new(&samples, place, 5.0, 0.1, EARTH_RATE)?;
/// let rolls: Vec<_> = segments.map(|s| s.map(|s| s.motion.angular_rate[0])).collect::<Result<_, _>>()?;
/// assert!(rolls.len() == 2 && (rolls[0] - 0.01).abs() < 1e-12);
/// # Ok::<(), gramian::inertial::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Recorded<'a, T> {
    samples: &'a [Sample<T>],
    /// Latitude, longitude, height.
    place: [T; 3],
    step: T,
    largest_turn: T,
    earth_rate: T,
    at: usize,
}

impl<'a, T: Real> Recorded<'a, T> {
    /// Segments of at most `step` and `largest_turn`, or one interval between samples where
    /// that is longer; none goes across the border of two legs. `place` is latitude,
    /// longitude and height at the beginning.
    ///
    /// # Units
    /// rad and m, s, rad, rad/s.
    ///
    /// # Errors
    /// As [`check_place`]; [`Error::Samples`]; [`Error::Number`] for a step or turn that is
    /// not positive.
    pub fn new(
        samples: &'a [Sample<T>],
        place: [T; 3],
        step: T,
        largest_turn: T,
        earth_rate: T,
    ) -> Result<Self, Error> {
        if samples.len() < 2 {
            return Err(Error::Samples {
                samples: samples.len(),
            });
        }
        check_positive("step", step)?;
        check_positive("largest_turn", largest_turn)?;
        check_place(place[0], place[2])?;
        check_finite("longitude", &place[1..2])?;
        check_finite("earth_rate", &[earth_rate])?;
        for sample in samples {
            check_finite("time", &[sample.time])?;
            check_finite("velocity", &sample.velocity)?;
            check_finite("angles", &sample.angles)?;
        }
        Ok(Self {
            samples,
            place,
            step,
            largest_turn,
            earth_rate,
            at: 0,
        })
    }

    /// Moves the place over the interval before sample `index`.
    fn move_to(&mut self, index: usize) -> Result<(), Error> {
        let (before, after) = (self.samples[index - 1], self.samples[index]);
        let dt = interval(self.samples, index)?;
        let [north, west, up] = mean(before.velocity, after.velocity);
        let earth = Earth::new(self.place[0], self.place[2], self.earth_rate)?;
        self.place[0] += dt * (north / earth.meridian);
        self.place[1] += dt * (-west / (earth.normal * earth.cos()));
        self.place[2] += dt * up;
        Ok(())
    }

    fn segment(&mut self) -> Result<Segment<T>, Error> {
        let first = self.at;
        let begin = self.samples[first];
        let [heading, pitch, roll] = begin.angles;
        let attitude = rotation(heading, pitch, roll)?;
        let (mut last, mut turned) = (first, [T::zero(); 3]);
        let start = self.place;
        for next in first + 1..self.samples.len() {
            let sample = self.samples[next];
            interval(self.samples, next)?;
            let vector = turn(&attitude, sample.angles, next - 1)?;
            let angle = dot(&vector, &vector).sqrt();
            let far = sample.time - begin.time > self.step * T::of(1.0 + 1e-9)
                || angle > self.largest_turn
                || self.samples[next - 1].leg != begin.leg;
            if far && next > first + 1 {
                break;
            }
            self.move_to(next)?;
            (last, turned) = (next, vector);
            if far {
                break;
            }
        }
        self.at = last;
        let (end, half) = (self.samples[last], T::of(0.5));
        let duration = end.time - begin.time;
        let velocity = mean(begin.velocity, end.velocity);
        let place: [T; 3] = core::array::from_fn(|i| half * (start[i] + self.place[i]));
        let (latitude, height) = (place[0], place[2]);
        let earth = Earth::new(latitude, height, self.earth_rate)?;
        let rotating = earth.rotation();
        let coriolis = add(add(rotating, rotating), earth.transport(velocity));
        let acceleration =
            core::array::from_fn(|i| (end.velocity[i] - begin.velocity[i]) / duration);
        let weight = [T::zero(), T::zero(), gravity(latitude, height)?];
        let force = add(add(acceleration, cross(&coriolis, &velocity)), weight);
        let angular_rate = turned.map(|x| x / duration);
        let speed = dot(&velocity, &velocity).sqrt();
        for part in [
            velocity,
            force,
            angular_rate,
            place,
            [speed, duration, T::zero()],
        ] {
            finite("segment", part)?;
        }
        let attitude = product(&attitude, &rotated(turned.map(|x| half * x)));
        let forward = attitude.map(|row| row[0]);
        Ok(Segment {
            leg: begin.leg,
            duration,
            time: begin.time,
            heading: (-forward[1]).atan2(forward[0]),
            speed,
            longitude: place[1],
            motion: Motion {
                latitude,
                height,
                velocity,
                specific_force: Some(force),
                attitude,
                angular_rate,
                lever_arm: [T::zero(); 3],
                odometer_arm: [T::zero(); 3],
                earth_rate: self.earth_rate,
                gravity_gradient: GravityGradient::Include,
            },
        })
    }
}

impl<T: Real> Iterator for Recorded<'_, T> {
    type Item = Result<Segment<T>, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.at + 1 >= self.samples.len() {
            return None;
        }
        let segment = self.segment();
        if segment.is_err() {
            self.at = self.samples.len();
        }
        Some(segment)
    }
}

/// The time between a sample and the one before it.
fn interval<T: Real>(samples: &[Sample<T>], index: usize) -> Result<T, Error> {
    let dt = samples[index].time - samples[index - 1].time;
    if dt > T::zero() && dt.is_finite() {
        Ok(dt)
    } else {
        let given = samples[index].time.double();
        Err(Error::Times { index, given })
    }
}

fn mean<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    add(a, b).map(|x| T::of(0.5) * x)
}

/// The rotation vector, in body axes, from an attitude to that of the angles.
fn turn<T: Real>(from: &[[T; 3]; 3], to: [T; 3], index: usize) -> Result<[T; 3], Error> {
    let [heading, pitch, roll] = to;
    let r = product(&transposed(from), &rotation(heading, pitch, roll)?);
    let half = T::of(0.5);
    let sine = [
        half * (r[2][1] - r[1][2]),
        half * (r[0][2] - r[2][0]),
        half * (r[1][0] - r[0][1]),
    ];
    let size = dot(&sine, &sine).sqrt();
    let angle = size.atan2(half * (r[0][0] + r[1][1] + r[2][2] - T::one()));
    if !(angle < T::of(LARGEST_TURN)) {
        let turn = angle.double();
        return Err(Error::Turn { index, turn });
    }
    let factor = if size > T::zero() {
        angle / size
    } else {
        T::one()
    };
    Ok(sine.map(|x| factor * x))
}

/// The rotation by a rotation vector.
fn rotated<T: Real>(vector: [T; 3]) -> [[T; 3]; 3] {
    let angle = dot(&vector, &vector).sqrt();
    let o = T::zero();
    let axis = if angle > o {
        vector.map(|x| x / angle)
    } else {
        [o; 3]
    };
    let (sin, cos) = angle.sin_cos();
    let k = super::cross_matrix(axis);
    let squared = product(&k, &k);
    core::array::from_fn(|i| {
        core::array::from_fn(|j| {
            let unit = if i == j { T::one() } else { o };
            unit + sin * k[i][j] + (T::one() - cos) * squared[i][j]
        })
    })
}
