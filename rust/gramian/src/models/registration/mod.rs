//! Registration: the constant biases of sensors that see the same targets.
//!
//! Each of N sensors at known places measures range and azimuth (in space also
//! elevation) of a target: true value + constant bias + noise. Nothing is known
//! of where the target is. One *look* is one target seen by all sensors at one
//! instant. The target's position is eliminated from each look by an orthogonal
//! transformation, and what is left are (N - 1) d rows on the biases alone.
//!
//! [`look`] does so for any number of sensors, in the plane or in space, with
//! range gains and errors of sensor position and attitude as further biases.
//! [`pair`] has two sensors in the plane in closed form, and [`degree`] the
//! running degree of observability for a stream of looks.
//!
//! A sensor on a platform that moves has a place of its own for each look. Azimuths count
//! from north: those that count from the platform's heading have it added first, so that an
//! error of the heading is an azimuth bias.
//!
//! The biases of a sensor come in this order, those not in the [`Layout`] left
//! out: range, azimuth, elevation (in space), gain, east, north, up (in space),
//! tilt about east and about north (in space), heading.
//!
//! # Source
//! Zhu, Tang & He 2013 (the track-independent model, their eq. 1 to 12, for two
//! sensors); the elimination of any number of sensors' common target is ours.

#[cfg(feature = "std")]
pub mod batch;
pub mod degree;
#[cfg(feature = "alloc")]
pub mod estimate;
pub mod look;
#[cfg(feature = "std")]
pub mod measured;
pub mod pair;
pub(crate) mod report;

pub use report::report;

use crate::scalar::{NumberError, Real, check_finite, check_length};

/// The most biases that one sensor can have.
pub const MOST: usize = 10;

/// Whether targets move in a plane or in space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// East and north; range and azimuth.
    Plane,
    /// East, north and up; range, azimuth and elevation.
    Space,
}

/// How many sensors there are and which biases each of them has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Plane or space.
    pub dimension: Dimension,
    /// Number of sensors, two at least.
    pub sensors: usize,
    /// Ranges come out too long by a factor 1 + gain.
    pub gain: bool,
    /// The sensors' positions are not known exactly.
    pub position: bool,
    /// The sensors' axes are not known exactly: heading and, in space, tilts.
    pub attitude: bool,
}

impl Layout {
    /// Two sensors in the plane, each with a range and an azimuth bias.
    pub const PAIR: Self = Self::simple(Dimension::Plane, 2);

    /// A bias for each measured quantity and nothing else.
    pub const fn simple(dimension: Dimension, sensors: usize) -> Self {
        Self {
            dimension,
            sensors,
            gain: false,
            position: false,
            attitude: false,
        }
    }

    /// Number of coordinates, and of quantities that a sensor measures.
    #[inline]
    pub const fn size(&self) -> usize {
        match self.dimension {
            Dimension::Plane => 2,
            Dimension::Space => 3,
        }
    }

    /// Number of biases of one sensor.
    #[inline]
    pub const fn per_sensor(&self) -> usize {
        let d = self.size();
        let mut count = d;
        if self.gain {
            count += 1;
        }
        if self.position {
            count += d;
        }
        if self.attitude {
            count += 2 * d - 3;
        }
        count
    }

    /// Number of biases of all sensors.
    #[inline]
    pub const fn states(&self) -> usize {
        self.sensors.saturating_mul(self.per_sensor())
    }

    /// Number of rows that one look leaves on the biases.
    #[inline]
    pub const fn rows(&self) -> usize {
        self.sensors.saturating_sub(1).saturating_mul(self.size())
    }

    /// Checks what all looks share: at least two sensors at finite places, none on
    /// another, and deviations above zero.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn check<T: Real>(&self, sensors: &[T], sigma: &[T]) -> Result<(), Error> {
        self.check_finite_sensors(sensors, sigma)?;
        Ok(check_finite("sensors", sensors)?)
    }

    /// The places of the sensors at look `look`: `sensors` has N d numbers for all looks, or
    /// as many for each.
    pub(crate) fn at_look<'a, T>(&self, sensors: &'a [T], look: usize) -> &'a [T] {
        let size = self.sensors * self.size();
        if sensors.len() == size {
            sensors
        } else {
            &sensors[look * size..][..size]
        }
    }

    /// [`check`](Self::check) of sensors at finite places.
    fn check_finite_sensors<T: Real>(&self, sensors: &[T], sigma: &[T]) -> Result<(), Error> {
        let size = self.sensors.saturating_mul(self.size());
        check_length("sensors", sensors.len(), size)?;
        self.check_places(sensors, sigma, 1)
    }

    /// The same of sensors that may have a place of their own for each of `looks` looks, where
    /// none is on another all the time.
    pub(crate) fn check_places<T: Real>(
        &self,
        sensors: &[T],
        sigma: &[T],
        looks: usize,
    ) -> Result<(), Error> {
        let d = self.size();
        if self.sensors < 2 {
            return Err(Error::Sensors {
                given: self.sensors,
            });
        }
        let size = self.sensors.saturating_mul(d);
        check_length("sigma", sigma.len(), size)?;
        if sensors.len() != size {
            check_length("sensors", sensors.len(), size.saturating_mul(looks))?;
        }
        for second in 0..self.sensors {
            for first in 0..second {
                let mut places = sensors.chunks_exact(size);
                if places.all(|at| at[first * d..][..d] == at[second * d..][..d]) {
                    return Err(Error::Coincident { first, second });
                }
            }
        }
        for (i, &value) in sigma.iter().enumerate() {
            if !(value > T::zero() && value.is_finite()) {
                return Err(Error::Sigma {
                    sensor: i / d,
                    quantity: i % d,
                    given: value.double(),
                });
            }
        }
        Ok(())
    }
}

/// What can be wrong with the input of this module.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// Fewer than two sensors.
    #[error("sensors has {given} entries: registration wants 2 or more sensors")]
    Sensors {
        /// How many there are.
        given: usize,
    },
    /// Two sensors at one place.
    #[error("sensors[{second}] is at the place of sensors[{first}]: sensors must be apart")]
    Coincident {
        /// The first of them.
        first: usize,
        /// The other.
        second: usize,
    },
    /// A standard deviation that is not positive and finite.
    #[error(
        "sigma[{sensor}, {quantity}] ({}) = {given} {}: must be > 0 and finite",
        measured(*.quantity).0,
        measured(*.quantity).1
    )]
    Sigma {
        /// Whose.
        sensor: usize,
        /// Of what: 0 range, 1 azimuth, 2 elevation.
        quantity: usize,
        /// The value given.
        given: f64,
    },
    /// The target is on a sensor: no azimuth exists.
    #[error("the target of look {look} is on sensors[{sensor}]: an azimuth needs a range > 0")]
    OnSensor {
        /// Which look.
        look: usize,
        /// Which sensor.
        sensor: usize,
    },
    /// The target is straight above or below a sensor: no azimuth exists.
    #[error(
        "the target of look {look} is straight above or below sensors[{sensor}]: an azimuth \
         needs a horizontal distance > 0"
    )]
    Overhead {
        /// Which look.
        look: usize,
        /// Which sensor.
        sensor: usize,
    },
    /// A number that is not finite, or too large to go on with.
    #[error(transparent)]
    Number(#[from] NumberError),
}

/// The name and unit of a measured quantity.
fn measured(quantity: usize) -> (&'static str, &'static str) {
    match quantity {
        0 => ("range", "m"),
        1 => ("azimuth", "rad"),
        _ => ("elevation", "rad"),
    }
}

impl Error {
    /// The same error at another look.
    #[must_use]
    pub fn at(mut self, index: usize) -> Self {
        match &mut self {
            Self::OnSensor { look, .. } | Self::Overhead { look, .. } => *look = index,
            Self::Number(error) => *error = error.at(index),
            _ => {}
        }
        self
    }
}
