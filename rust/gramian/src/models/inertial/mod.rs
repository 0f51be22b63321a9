//! Errors of a strapdown inertial navigator beside what aids it: a satellite receiver, an
//! odometer, knowing that it stands, a heading.
//!
//! Axes are north, west, up for navigation and forward, left, up for the body, so that a
//! level vehicle that heads north has both the same. States, in this order: tilt phi
//! (rad), velocity error (m/s), errors of latitude and longitude (rad) and height (m),
//! gyro bias (rad/s) and accelerometer bias (m/s^2) in body axes, and, where they are
//! estimated, those of [`Group`]: lever arms, scale factors, misalignments, sensitivity of
//! the gyros to acceleration. Errors are what the navigator says less what is.
//!
//! [`error_model`] gives the matrices of x' = A x, z = C x for [`linear`](crate::linear);
//! [`Segments`] splits a flight of legs into parts with constant matrices, [`Recorded`] one
//! given by samples of attitude and velocity, such as those of a [`Sway`]. [`Visual`] is a
//! camera beside a navigator, for [`dynamics`](crate::dynamics).

mod earth;
mod error_model;
mod flight;
mod recorded;
#[cfg(feature = "alloc")]
mod visual;

pub use earth::{EARTH_RATE, check_place, gravity, radii};
pub use error_model::{
    ErrorModel, GravityGradient, Group, Motion, Output, STATES, combinations_at_rest, error_model,
    rotation,
};
pub use flight::{Leg, MOST_SEGMENTS, Segment, Segments, Start};
pub use recorded::{Recorded, Sample, Sway};
#[cfg(feature = "alloc")]
pub use visual::{CORE, Unknown, Visual};

use crate::numbers::errors::Shown;
use crate::scalar::{NumberError, Real};

/// What can be wrong with the input of this module.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A latitude beyond the poles.
    #[error("latitude = {} rad: must be within -pi/2 and pi/2", Shown(*.given))]
    Latitude {
        /// The value given.
        given: f64,
    },
    /// A pole, where west and longitude do not exist.
    #[error("latitude = {} rad is a pole: west and longitude do not exist there (tan L)", Shown(*.given))]
    Pole {
        /// The value given.
        given: f64,
    },
    /// A height at which gravity is not expanded.
    #[error("height = {} m: must be {allowed}", Shown(*.given))]
    Height {
        /// The value given.
        given: f64,
        /// The values allowed, in words.
        allowed: &'static str,
    },
    /// A velocity that no vehicle has.
    #[error("velocity[{axis}] = {} m/s: must be below 1e9, which is beyond light", Shown(*.given))]
    Velocity {
        /// 0 north, 1 west, 2 up.
        axis: usize,
        /// The value given.
        given: f64,
    },
    /// An attitude that is not orthogonal.
    #[error("attitude is not a rotation: must be a (3, 3) orthogonal matrix")]
    Attitude,
    /// A forward axis that has no heading.
    #[error("attitude points the nose up or down: there is no heading to measure there")]
    Vertical,
    /// Samples of a recorded flight that are not one after the other.
    #[error("times[{index}] = {} s: must be later than the sample before it", Shown(*.given))]
    Times {
        /// Which sample.
        index: usize,
        /// Its time.
        given: f64,
    },
    /// A turn between two samples that could have been either way.
    #[error(
        "attitude turns by {:.3} rad between samples {index} and {}: must be below 3 rad, \
         sample more often", Shown(*.turn), .index + 1
    )]
    Turn {
        /// The sample before it.
        index: usize,
        /// By how much.
        turn: f64,
    },
    /// Too few samples for a flight.
    #[error("the flight has {samples} samples: must be 2 or more")]
    Samples {
        /// How many.
        samples: usize,
    },
    /// A number of a leg that is not finite, or a duration that is not positive.
    #[error("legs[{leg}].{name} = {}{unit}: must be {allowed}", Shown(*.given))]
    Leg {
        /// Which leg.
        leg: usize,
        /// The name of the number.
        name: &'static str,
        /// The value given.
        given: f64,
        /// Its unit, after a space.
        unit: &'static str,
        /// The values allowed, in words.
        allowed: &'static str,
    },
    /// A leg that would be split into too many segments.
    #[error(
        "legs[{leg}] makes {:.2} segments, more than {MOST_SEGMENTS}: a shorter leg, or \
         larger `step` and `largest_turn`",
        Shown(*.segments)
    )]
    Segments {
        /// Which leg.
        leg: usize,
        /// How many it would make.
        segments: f64,
    },
    /// A landmark that the camera cannot see.
    #[error("landmarks[{landmark}] is not in front of the camera at t = {} s", Shown(*.time))]
    Behind {
        /// Which landmark.
        landmark: usize,
        /// When, s.
        time: f64,
    },
    /// A number that is not finite or not positive, or a result that overflows.
    #[error(transparent)]
    Number(#[from] NumberError),
}

fn add<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    core::array::from_fn(|i| a[i] + b[i])
}

/// The matrix of a x.
fn cross_matrix<T: Real>(a: [T; 3]) -> [[T; 3]; 3] {
    let zero = T::zero();
    [
        [zero, -a[2], a[1]],
        [a[2], zero, -a[0]],
        [-a[1], a[0], zero],
    ]
}

fn product<T: Real>(a: &[[T; 3]; 3], b: &[[T; 3]; 3]) -> [[T; 3]; 3] {
    a.map(|row| core::array::from_fn(|j| row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]))
}

fn transposed<T: Real>(m: &[[T; 3]; 3]) -> [[T; 3]; 3] {
    core::array::from_fn(|i| core::array::from_fn(|j| m[j][i]))
}
