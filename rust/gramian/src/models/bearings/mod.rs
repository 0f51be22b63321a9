//! Bearings-only target motion.
//!
//! A target moves at constant velocity; an observer, anywhere, measures its
//! bearing. The state is (x0, y0, vx, vy): position at the first instant and
//! velocity, in metres and metres per second, x east, y north. Bearings are
//! clockwise from north, beta = atan2(x, y).
//!
//! # Source
//! Li & Sheng 2009 (the pseudo-linear rows, their eq. 3); Xu et al. 2009, eq. 9
//! (the rows of the nonlinear problem, weighted by 1 / (sigma r)).

#[cfg(feature = "std")]
pub mod batch;
mod discriminant;
#[cfg(feature = "std")]
mod frame;
#[cfg(feature = "std")]
mod measured;
mod monitor;
mod motion;
mod observability_test;
mod rows;

pub(crate) use crate::tracks::sensors::gradient;
#[cfg(feature = "std")]
pub(crate) use discriminant::middle;
pub use discriminant::{
    Form, check_track, discriminant, discriminant_sum, discriminant_sum_qr, fixed_target_sum,
    fixed_target_sum_qr,
};
#[cfg(feature = "std")]
pub use frame::{Frame, Whereabouts, frame};
#[cfg(feature = "std")]
pub use measured::Measured;
pub use monitor::{Answer, Kept, Monitor};
#[cfg(feature = "std")]
pub(crate) use motion::moved_along;
pub use motion::{azimuth_elevation_rows, motion, motion_row};
#[cfg(any(feature = "std", test))]
pub(crate) use rows::sight;
pub use rows::{bearing, position, push_rows, row};
pub(crate) use rows::{moved, unchecked_row};

#[cfg(feature = "std")]
pub(crate) use observability_test::{Clock, Residuals, SMALLEST, Sums, check_sigma, fit};
pub use observability_test::{Test, observability_test};

use crate::scalar::NumberError;

/// What can be wrong with the input of this module.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// The observer is on the target: no bearing exists.
    #[error("observer[{index}] is at the target's position: a bearing needs a range > 0")]
    OnTarget {
        /// Which sample.
        index: usize,
    },
    /// The target is straight above or below: no azimuth exists.
    #[error(
        "observer[{index}] is straight below or above the target: an azimuth needs a horizontal \
         range > 0"
    )]
    Overhead {
        /// Which sample.
        index: usize,
    },
    /// A standard deviation that is not positive.
    #[error("sigma[{index}] = {given} rad: must be > 0 and finite")]
    Sigma {
        /// Which sample.
        index: usize,
        /// The value given.
        given: f64,
    },
    /// A sine in the denominator of the cotangent form is zero.
    #[error(
        "bearings[{other}] is on the line of bearings[0]: the cotangent form (13) needs their \
         sine nonzero; take the form (15)"
    )]
    Cotangent {
        /// The bearing that points along the first one's line.
        other: usize,
    },
    /// Fewer bearings than the question needs.
    #[error("{given} bearings: at least {wanted} are needed")]
    TooFew {
        /// How many there are.
        given: usize,
        /// How many are needed at least.
        wanted: usize,
    },
    /// A weight that is negative.
    #[error("weights[{index}] = {given}: must be >= 0 and finite")]
    Weight {
        /// Which sample.
        index: usize,
        /// The value given.
        given: f64,
    },
    /// A distance that is not positive.
    #[error("distance[{index}] = {given} m: must be > 0 and finite")]
    Distance {
        /// Which sample.
        index: usize,
        /// The value given.
        given: f64,
    },
    /// A distance that only some bearings have.
    #[error("distance[{index}]: all bearings must come with a distance, or none")]
    Mixed {
        /// The first bearing that is not like those before.
        index: usize,
    },
    /// Times that do not increase.
    #[error("times[{index}] = {given} s: must be later than the one before, {before} s")]
    Times {
        /// The first time that is not later than the one before.
        index: usize,
        /// That time.
        given: f64,
        /// The one before.
        before: f64,
    },
    /// A number that is not finite, or too large to go on with.
    #[error(transparent)]
    Number(#[from] NumberError),
}

impl Error {
    /// The same error at another sample.
    #[must_use]
    pub fn at(mut self, sample: usize) -> Self {
        match &mut self {
            Self::OnTarget { index }
            | Self::Overhead { index }
            | Self::Sigma { index, .. }
            | Self::Distance { index, .. }
            | Self::Mixed { index }
            | Self::Times { index, .. }
            | Self::Weight { index, .. } => *index = sample,
            Self::Number(error) => *error = error.at(sample),
            Self::Cotangent { .. } | Self::TooFew { .. } => {}
        }
        self
    }
}
