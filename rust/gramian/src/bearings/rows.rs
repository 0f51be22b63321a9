//! The rows of one target at constant velocity, and where it is.

use super::{Error, check_length};
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
        sink.push(&row)?;
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
