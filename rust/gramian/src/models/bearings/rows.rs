//! The rows of one target at constant velocity, and where it is.

use super::{Error, gradient};
use crate::numbers::algebra::advanced;
use crate::numbers::lane::Lane;
use crate::rows::RowSink;
use crate::scalar::{Real, check_finite, check_length, finite};

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
/// standard deviation that is not positive and finite; [`Error::Number`] for what
/// is not finite, or a row that overflows.
///
/// # Source
/// Xu et al. 2009, eq. (9); over the range and without sigma, the pseudo-linear row of
/// Li & Sheng 2009, eq. (2).
///
/// ```
/// let row = gramian::bearings::row(10.0, 0.0, 1000.0, 0.01).unwrap();
/// // A target due north: moving east turns the bearing by 1 / range.
/// assert!((row[0] - 0.1_f64).abs() < 1e-15 && row[1].abs() < 1e-15);
/// assert!((row[2] - 1.0).abs() < 1e-14);
/// ```
#[inline]
pub fn row<T: Real>(time: T, east: T, north: T, sigma: T) -> Result<[T; 4], Error> {
    for (name, value) in [("time", time), ("east", east), ("north", north)] {
        check_finite(name, &[value])?;
    }
    if sigma == T::INFINITY {
        return Err(wrong_sigma(sigma));
    }
    Ok(finite("row", unchecked_row(time, east, north, sigma)?)?)
}

/// [`row`] of finite numbers, not checked on the way out.
#[inline]
pub(crate) fn unchecked_row<T: Real>(
    time: T,
    east: T,
    north: T,
    sigma: T,
) -> Result<[T; 4], Error> {
    if east == T::zero() && north == T::zero() {
        return Err(Error::OnTarget { index: 0 });
    }
    if !(sigma > T::zero()) {
        return Err(wrong_sigma(sigma));
    }
    let [x, y] = gradient([east, north], sigma);
    Ok([x, y, time * x, time * y])
}

fn wrong_sigma<T: Real>(sigma: T) -> Error {
    Error::Sigma {
        index: 0,
        given: sigma.double(),
    }
}

/// Pushes the rows of a whole track into `sink`.
///
/// `observer` and `target` hold one position per time; `sigma` one standard
/// deviation for all or one each. Time is counted from `times[0]`.
///
/// # Errors
/// [`NumberError::Length`](crate::scalar::NumberError::Length) for arrays that do not match; otherwise as [`row`], with
/// the index.
///
/// # Source
/// As [`row`]; the information of these rows is Xu et al. 2009, eq. (10).
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
        check_finite("times", &times[i..=i]).map_err(|error| error.at(i))?;
        check_finite("observer", &observer[i]).map_err(|error| error.at(i))?;
        check_finite("target", &target[i]).map_err(|error| error.at(i))?;
        let s = if sigma.len() == 1 { sigma[0] } else { sigma[i] };
        let row = row(
            times[i] - times[0],
            target[i][0] - observer[i][0],
            target[i][1] - observer[i][1],
            s,
        )
        .map_err(|error| error.at(i))?;
        sink.push(&row)?;
    }
    Ok(())
}

/// The bearing of `target` from `observer`, clockwise from north, in (-pi, pi].
///
/// # Units
/// m, rad.
///
/// # Errors
/// [`Error::OnTarget`] where they are at the same place, [`Error::Number`].
///
/// ```
/// let east = gramian::bearings::bearing([1.0, 2.0], [6.0_f64, 2.0]).unwrap();
/// assert_eq!(east, core::f64::consts::FRAC_PI_2);
/// ```
pub fn bearing<T: Real>(observer: [T; 2], target: [T; 2]) -> Result<T, Error> {
    check_finite("observer", &observer)?;
    check_finite("target", &target)?;
    let offset = [target[0] - observer[0], target[1] - observer[1]];
    let [east, north] = finite("offset", offset)?;
    if east == T::zero() && north == T::zero() {
        return Err(Error::OnTarget { index: 0 });
    }
    Ok(Lane::atan2(east, north))
}

/// [`bearing`] without a check.
#[cfg(any(feature = "std", test))]
#[inline]
pub(crate) fn sight<T: Real>(observer: [T; 2], target: [T; 2]) -> T {
    Lane::atan2(target[0] - observer[0], target[1] - observer[1])
}

/// The position after `time` of a target in `state` (x0, y0, vx, vy).
///
/// # Units
/// m, m/s, s.
///
/// # Errors
/// [`Error::Number`].
///
/// ```
/// let place = gramian::bearings::position(&[100.0, 0.0, -2.0, 1.0], 30.0).unwrap();
/// assert_eq!(place, [40.0_f64, 30.0]);
/// ```
pub fn position<T: Real>(state: &[T; 4], time: T) -> Result<[T; 2], Error> {
    check_finite("state", state)?;
    check_finite("time", &[time])?;
    Ok(finite("position", moved(state, time))?)
}

/// [`position`] without a check.
#[inline]
pub(crate) fn moved<L: Lane>(state: &[L; 4], time: L) -> [L; 2] {
    advanced(&[state[0], state[1]], &[state[2], state[3]], time)
}
