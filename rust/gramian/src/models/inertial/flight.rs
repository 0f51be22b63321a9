//! Flights put together from legs, as segments with a constant error model.

use super::earth::{Earth, check_place, gravity};
use super::error_model::{GravityGradient, Motion, rotation};
use super::{Error, add, transposed};
use crate::numbers::algebra::{cross, multiply};
use crate::scalar::{Real, check_finite, check_positive, finite};

/// Segments of one leg: more are a slip in its numbers, and hours of work.
pub const MOST_SEGMENTS: f64 = 10_000.0;

/// A part of a flight with constant rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg<T> {
    /// s.
    pub duration: T,
    /// By how much the heading changes over the leg, clockwise, rad.
    pub turn: T,
    /// By how much the speed along the heading changes, m/s.
    pub speed_change: T,
    /// Roll during the leg, right side down, rad.
    pub bank: T,
}

/// Where and how a flight begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start<T> {
    /// Geodetic, rad.
    pub latitude: T,
    /// rad.
    pub longitude: T,
    /// Above the ellipsoid, m; the flight is level.
    pub height: T,
    /// m/s.
    pub speed: T,
    /// Clockwise from north, rad.
    pub heading: T,
}

/// A part of a flight over which the error model is taken as constant: that of its middle.
#[derive(Clone, Copy, Debug)]
pub struct Segment<T> {
    /// The leg that it belongs to.
    pub leg: usize,
    /// s.
    pub duration: T,
    /// Its beginning, s.
    pub time: T,
    /// In its middle, rad.
    pub heading: T,
    /// In its middle, m/s.
    pub speed: T,
    /// rad.
    pub longitude: T,
    /// For [`error_model`](super::error_model()): the place, velocity and force of a
    /// vehicle that flies along its heading, without a lever arm.
    pub motion: Motion<T>,
}

/// The segments of a flight, level and along its heading, one after the other.
///
/// # Errors
/// Items are errors where a leg's numbers are not finite ([`Error::Leg`]), where it makes
/// too many segments, or where the flight comes to a pole.
///
/// ```
/// use gramian::inertial::{EARTH_RATE, Leg, Segments, Start};
/// let start = Start { latitude: 0.8, longitude: 0.0, height: 0.0, speed: 50.0, heading: 0.0 };
/// let turn = [Leg { duration: 30.0, turn: 1.5, speed_change: 0.0, bank: 0.0 }];
/// let segments = Segments::new(&turn, start, 5.0, 0.05, EARTH_RATE)?;
/// assert_eq!(segments.count(), 30);
/// # Ok::<(), gramian::inertial::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Segments<'a, T> {
    legs: &'a [Leg<T>],
    now: Start<T>,
    time: T,
    step: T,
    largest_turn: T,
    earth_rate: T,
    leg: usize,
    /// How many segments of the present leg are still to come, and all of them.
    left: usize,
    count: usize,
}

impl<'a, T: Real> Segments<'a, T> {
    /// Segments of at most `step` and `largest_turn` while turning or changing speed; a
    /// leg that does neither is one segment.
    ///
    /// # Units
    /// s, rad, rad/s.
    ///
    /// # Errors
    /// As [`check_place`]; [`Error::Number`] for a step or turn that is not positive.
    pub fn new(
        legs: &'a [Leg<T>],
        start: Start<T>,
        step: T,
        largest_turn: T,
        earth_rate: T,
    ) -> Result<Self, Error> {
        check_positive("step", step)?;
        check_positive("largest_turn", largest_turn)?;
        check_place(start.latitude, start.height)?;
        check_finite("longitude", &[start.longitude])?;
        check_finite("speed", &[start.speed])?;
        check_finite("heading", &[start.heading])?;
        check_finite("earth_rate", &[earth_rate])?;
        Ok(Self {
            legs,
            now: start,
            time: T::zero(),
            step,
            largest_turn,
            earth_rate,
            leg: 0,
            left: 0,
            count: 0,
        })
    }

    /// How many segments a leg makes.
    fn split(&self, leg: usize) -> Result<usize, Error> {
        let Leg {
            duration,
            turn,
            speed_change,
            bank,
        } = self.legs[leg];
        let wrong = |name, given: T, unit, allowed| Error::Leg {
            leg,
            name,
            given: given.double(),
            unit,
            allowed,
        };
        for (name, value) in [
            ("duration", duration),
            ("turn", turn),
            ("speed_change", speed_change),
            ("bank", bank),
        ] {
            if !value.is_finite() {
                return Err(wrong(name, value, "", "finite"));
            }
        }
        if !(duration > T::zero()) {
            return Err(wrong("duration", duration, " s", "> 0 and finite"));
        }
        if turn == T::zero() && speed_change == T::zero() {
            return Ok(1);
        }
        let pieces = (duration / self.step).max(turn.abs() / self.largest_turn);
        let segments = pieces.double();
        if !(segments <= MOST_SEGMENTS) {
            return Err(Error::Segments { leg, segments });
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        // A turn so slow that the quotient underflows is one segment too.
        Ok((pieces.ceil().double() as usize).max(1))
    }

    fn segment(&mut self) -> Result<Segment<T>, Error> {
        let leg = self.legs[self.leg];
        let half = T::of(0.5);
        let duration = leg.duration / T::of(self.count as f64);
        let (rate, push) = (leg.turn / leg.duration, leg.speed_change / leg.duration);
        let course = self.now.heading + rate * duration * half;
        let speed = self.now.speed + push * duration * half;
        let (sin, cos) = course.sin_cos();
        let o = T::zero();
        let (ahead, right) = ([cos, -sin, o], [-sin, -cos, o]);
        let velocity = ahead.map(|x| speed * x);
        let (latitude, height) = (self.now.latitude, self.now.height);
        let earth = Earth::new(latitude, height, self.earth_rate)?;
        let rotating = earth.rotation();
        let coriolis = add(add(rotating, rotating), earth.transport(velocity));
        let level = add(ahead.map(|x| push * x), right.map(|x| speed * rate * x));
        let weight = [o, o, gravity(latitude, height)?];
        let attitude = rotation(course, o, leg.bank)?;
        let force = add(add(level, cross(&coriolis, &velocity)), weight);
        let angular_rate = multiply(&transposed(&attitude), &[o, o, -rate]);
        for part in [velocity, force, angular_rate] {
            finite("segment", part)?;
        }
        finite("segment", [self.time, course, self.now.longitude])?;
        let made = Segment {
            leg: self.leg,
            duration,
            time: self.time,
            heading: course,
            speed,
            longitude: self.now.longitude,
            motion: Motion {
                latitude,
                height,
                velocity,
                specific_force: Some(force),
                attitude,
                angular_rate,
                lever_arm: [o; 3],
                odometer_arm: [o; 3],
                earth_rate: self.earth_rate,
                gravity_gradient: GravityGradient::Include,
            },
        };
        self.now.latitude += duration * (velocity[0] / earth.meridian);
        self.now.longitude += duration * (-velocity[1] / (earth.normal * earth.cos()));
        self.now.heading += rate * duration;
        self.now.speed += push * duration;
        self.time += duration;
        Ok(made)
    }
}

impl<T: Real> Iterator for Segments<'_, T> {
    type Item = Result<Segment<T>, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.leg >= self.legs.len() {
            return None;
        }
        if self.left == 0 {
            match self.split(self.leg) {
                Ok(count) => (self.left, self.count) = (count, count),
                Err(error) => {
                    self.leg = self.legs.len();
                    return Some(Err(error));
                }
            }
        }
        let segment = self.segment();
        self.left -= 1;
        if segment.is_err() {
            self.leg = self.legs.len();
        } else if self.left == 0 {
            self.leg += 1;
        }
        Some(segment)
    }
}
