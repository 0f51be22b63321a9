//! Tracks: how things move, what sensors see, and what is unknown about the sensors.
//!
//! A target moves as a [`motion`]; carriers with known paths bear [`sensors`]; biases,
//! scales, clock offsets, tonals and powers are states beside those of the motion.
#![cfg_attr(
    feature = "std",
    doc = "[`Scene`](scene::Scene) puts them together and is a [`solve::Model`](crate::solve::Model), so that
estimate, fit, other solutions and regions follow."
)]
//!
//! # Source
//! The rows are those of each sensor by the chain rule; Li & Sheng 2009 and Xu et al.
//! 2009 for bearings, Zhu et al. 2013 for biases of radars.

#[cfg(feature = "std")]
pub mod carrier;
pub mod motion;
#[cfg(feature = "std")]
pub mod scene;
pub mod sensors;
pub mod stream;

use crate::scalar::NumberError;

/// What can be wrong with the input of this module.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// Times of a path that do not increase.
    #[error("path times[{index}] = {given} s: must be later than the one before, {before} s")]
    PathTimes {
        /// The first that is not later.
        index: usize,
        /// That time.
        given: f64,
        /// The one before.
        before: f64,
    },
    /// A time at which the carrier has no place.
    #[error("times[{index}] = {given} s: outside the carrier's path, {first} to {last} s")]
    OutsidePath {
        /// Which sample.
        index: usize,
        /// Its time.
        given: f64,
        /// Where the path begins.
        first: f64,
        /// Where it ends.
        last: f64,
    },
    /// Times that decrease where their order counts.
    #[error("times[{index}] = {given} s: must not be before the one before, {before} s")]
    Times {
        /// Which sample.
        index: usize,
        /// Its time.
        given: f64,
        /// The one before.
        before: f64,
    },
    /// Two samples at one time whose noise is correlated in time.
    #[error("times[{index}] = {given} s: twice, with noise that is correlated in time")]
    Repeated {
        /// Which sample.
        index: usize,
        /// Its time.
        given: f64,
    },
    /// A standard deviation that is not positive.
    #[error("sigma[{index}] = {given}: must be > 0 and finite")]
    Sigma {
        /// Which one.
        index: usize,
        /// The value given.
        given: f64,
    },
    /// A standard deviation of an angle above pi.
    #[error("sigma[{index}] = {given} rad: must be at most pi; are these degrees?")]
    SigmaAngle {
        /// Which one.
        index: usize,
        /// The value given.
        given: f64,
    },
    /// A correlation time that is not positive.
    #[error("correlation_time = {given} s: must be > 0 and finite")]
    CorrelationTime {
        /// The value given.
        given: f64,
    },
    /// A covariance matrix of another size.
    #[error(
        "covariance has {given} rows: must be square, for the {width} numbers of a sample or for \
         all {total}"
    )]
    CovarianceShape {
        /// Its size.
        given: usize,
        /// Numbers of a sample.
        width: usize,
        /// All numbers.
        total: usize,
    },
    /// A covariance matrix that is not symmetric.
    #[error(
        "covariance[{row}, {column}] = {given}, but [{column}, {row}] = {other}: must be equal"
    )]
    NotSymmetric {
        /// Row of the entry.
        row: usize,
        /// Its column.
        column: usize,
        /// The entry.
        given: f64,
        /// The one across the diagonal.
        other: f64,
    },
    /// A covariance matrix that is none.
    #[error("covariance is not positive definite: row {row} depends on those before it")]
    NotPositive {
        /// The first row that shows it.
        row: usize,
    },
    /// A sensor that is not for this number of dimensions.
    #[error("a sensor of {kind} needs 3 dimensions: the motion has {given}")]
    Dimension {
        /// The kind.
        kind: &'static str,
        /// Dimensions of the motion.
        given: usize,
    },
    /// A carrier in other dimensions than the motion.
    #[error("the carrier's path has {given} components: the motion has {wanted}")]
    CarrierDimension {
        /// Components of the path.
        given: usize,
        /// Dimensions of the motion.
        wanted: usize,
    },
    /// A sensor without the carrier that it needs.
    #[error("a sensor of {kind} needs {wanted}")]
    NoCarrier {
        /// The kind.
        kind: &'static str,
        /// What it needs.
        wanted: &'static str,
    },
    /// A towed array without a direction.
    #[error("times[{index}]: the carrier has no heading: it does not move, and none is given")]
    NoHeading {
        /// Which sample.
        index: usize,
    },
    /// A speed of the wave that is not positive.
    #[error("speed = {given} m/s: the speed of the wave must be > 0 and finite")]
    WaveSpeed {
        /// The value given.
        given: f64,
    },
    /// A detection probability outside [0, 1].
    #[error("detection[{index}] = {given}: must be above 0 and at most 1")]
    Detection {
        /// Which one.
        index: usize,
        /// The value given.
        given: f64,
    },
    /// A state at which a sensor reads nothing, or has no derivative.
    #[error("sample {index}: {reason}")]
    NoReading {
        /// Which sample.
        index: usize,
        /// Why.
        reason: &'static str,
    },
    /// More states than the motion of a scene may have.
    #[error("{given} states of the motion: at most {most} are possible")]
    TooManyStates {
        /// How many there are.
        given: usize,
        /// How many are possible.
        most: usize,
    },
    /// A number that is not finite, or an array that does not fit.
    #[error(transparent)]
    Number(#[from] NumberError),
}

#[cfg(test)]
mod tests;
