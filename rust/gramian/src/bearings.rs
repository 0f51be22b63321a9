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

use crate::rows::RowSink;
use crate::scalar::Real;

/// One whitened row: the derivative of a bearing by (x0, y0, vx, vy), over sigma.
///
/// `east` and `north` are the target's position relative to the observer, `time`
/// is counted from the instant of the state.
///
/// # Units
/// m, s, rad.
///
/// # Errors
/// [`Error::OnTarget`] where both offsets are zero; [`Error::Sigma`] for a
/// standard deviation that is not positive.
///
/// ```
/// let row = gramian::bearings::row(10.0, 0.0, 1000.0, 0.01).unwrap();
/// // A target due north: moving east turns the bearing by 1 / range.
/// assert!((row[0] - 0.1_f64).abs() < 1e-15 && row[1].abs() < 1e-15);
/// assert!((row[2] - 1.0).abs() < 1e-14);
/// ```
#[inline]
pub fn row<T: Real>(time: T, east: T, north: T, sigma: T) -> Result<[T; 4], Error> {
    let range = crate::scalar::hypot(east, north);
    if !(range > T::zero()) {
        return Err(Error::OnTarget { index: 0 });
    }
    if !(sigma > T::zero()) {
        return Err(Error::Sigma {
            index: 0,
            given: sigma.double(),
        });
    }
    let weight = T::one() / (range * sigma);
    let (x, y) = (north / range * weight, -(east / range) * weight);
    Ok([x, y, time * x, time * y])
}

/// Pushes the rows of a whole track into `sink`.
///
/// `observer` and `target` hold one position per time; `sigma` one standard
/// deviation for all or one each. Time is counted from `times[0]`.
///
/// # Errors
/// [`Error::Length`] for arrays that do not match; otherwise as [`row`], with
/// the index.
pub fn push_rows<T: Real>(
    times: &[T],
    observer: &[[T; 2]],
    target: &[[T; 2]],
    sigma: &[T],
    sink: &mut impl RowSink<T, 4>,
) -> Result<(), Error> {
    check_length("observer", observer.len(), times.len())?;
    check_length("target", target.len(), times.len())?;
    if sigma.len() != 1 {
        check_length("sigma", sigma.len(), times.len())?;
    }
    for i in 0..times.len() {
        let s = if sigma.len() == 1 { sigma[0] } else { sigma[i] };
        let row = row(
            times[i] - times[0],
            target[i][0] - observer[i][0],
            target[i][1] - observer[i][1],
            s,
        )
        .map_err(|error| error.at(i))?;
        sink.push(&row);
    }
    Ok(())
}

/// The bearing of `target` from `observer`, clockwise from north.
#[inline]
pub fn bearing<T: Real>(observer: [T; 2], target: [T; 2]) -> T {
    (target[0] - observer[0]).atan2(target[1] - observer[1])
}

/// The position after `time` of a target in `state` (x0, y0, vx, vy).
#[inline]
pub fn position<T: Real>(state: &[T; 4], time: T) -> [T; 2] {
    [state[0] + time * state[2], state[1] + time * state[3]]
}

fn check_length(array: &'static str, given: usize, wanted: usize) -> Result<(), Error> {
    if given == wanted {
        Ok(())
    } else {
        Err(Error::Length {
            array,
            given,
            wanted,
        })
    }
}

/// What can be wrong with the input of this module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Error {
    /// The observer is on the target: no bearing exists.
    OnTarget {
        /// Which sample.
        index: usize,
    },
    /// A standard deviation that is not positive.
    Sigma {
        /// Which sample.
        index: usize,
        /// The value given.
        given: f64,
    },
    /// An array whose length does not match the times.
    Length {
        /// Its name.
        array: &'static str,
        /// Its length.
        given: usize,
        /// The number of times.
        wanted: usize,
    },
    /// Times that do not increase.
    Times {
        /// The first time that is not later than the one before.
        index: usize,
        /// That time.
        given: f64,
        /// The one before.
        before: f64,
    },
}

impl Error {
    /// The same error at another sample.
    #[must_use]
    pub fn at(mut self, sample: usize) -> Self {
        match &mut self {
            Self::OnTarget { index } | Self::Sigma { index, .. } | Self::Times { index, .. } => {
                *index = sample;
            }
            Self::Length { .. } => {}
        }
        self
    }
}

impl core::fmt::Display for Error {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::OnTarget { index } => write!(
                f,
                "observer[{index}] is at the target's position: a bearing needs a range > 0"
            ),
            Self::Sigma { index, given } => {
                write!(f, "sigma[{index}] = {given} rad: must be > 0 and finite")
            }
            Self::Length {
                array,
                given,
                wanted,
            } => write!(
                f,
                "{array} has {given} entries: must have {wanted}, one for each time"
            ),
            Self::Times {
                index,
                given,
                before,
            } => write!(
                f,
                "times[{index}] = {given} s: must be later than the one before, {before} s"
            ),
        }
    }
}

impl core::error::Error for Error {}
