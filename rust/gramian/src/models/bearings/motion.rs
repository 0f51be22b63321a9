//! Rows of targets that move as a polynomial in time, in the plane and in space.
//!
//! Order 0 is a target at rest, 1 constant velocity, 2 constant acceleration,
//! 3 constant jerk. The states are the derivatives at the first instant, order
//! by order: (x0, y0, vx, vy, ax, ay, jx, jy), in space (x0, y0, z0, vx, ..).
//! Order N takes 2 (N + 1) bearings at least, or N + 1 of azimuth and elevation
//! and as many numbers more as there are.

use super::Error;
use crate::scalar::{NumberError, Real, all_finite, check_finite, check_length, finite, hypot};

/// T^k / k!, what the k-th derivative adds to the place after `time`.
fn power<T: Real>(time: T, k: usize) -> T {
    (1..=k).fold(T::one(), |product, i| product * time / T::of(i as f64))
}

/// Where a target is after `time`: D coordinates of the `state`, D numbers for
/// each order.
///
/// # Errors
/// [`NumberError::Length`] for a state that is not made of D numbers for each order,
/// [`Error::Number`].
///
/// # Source
/// Taylor's theorem; order 1 is the motion of Li & Sheng 2009.
///
/// ```
/// use gramian::bearings::motion;
/// // At rest at first, with 2 m/s^2 to the east.
/// let place = motion::<f64, 2>(&[5.0, 7.0, 0.0, 0.0, 2.0, 0.0], 3.0).unwrap();
/// assert_eq!(place, [14.0, 7.0]);
/// ```
pub fn motion<T: Real, const D: usize>(state: &[T], time: T) -> Result<[T; D], Error> {
    check_orders::<D>("state", state.len())?;
    check_finite("state", state)?;
    check_finite("time", &[time])?;
    Ok(finite("position", moved_along(state, time))?)
}

/// [`motion`] without a check.
pub(crate) fn moved_along<T: Real, const D: usize>(state: &[T], time: T) -> [T; D] {
    let (orders, _) = state.as_chunks::<D>();
    let mut place = [T::zero(); D];
    for (k, derivative) in orders.iter().enumerate() {
        let factor = power(time, k);
        for i in 0..D {
            place[i] += factor * derivative[i];
        }
    }
    place
}

/// Refuses a number of states that is not D for each order.
fn check_orders<const D: usize>(array: &'static str, given: usize) -> Result<(), Error> {
    let wanted = given.next_multiple_of(const { if D == 0 { 1 } else { D } });
    Ok(check_length(array, given, wanted)?)
}

/// The whitened row of a bearing by the states of a target of any order, two for
/// each, into `out`: [`row`](super::row) is order 1.
///
/// # Errors
/// As [`row`](super::row), and [`NumberError::Length`] for an odd number of states.
///
/// # Source
/// Li & Sheng 2009, eq. (2), with the powers of time that the order adds.
pub fn motion_row<T: Real>(time: T, offset: [T; 2], sigma: T, out: &mut [T]) -> Result<(), Error> {
    check_orders::<2>("out", out.len())?;
    let row = super::row(T::zero(), offset[0], offset[1], sigma)?;
    spread(time, &[row[0], row[1]], out)
}

/// The whitened rows of azimuth (clockwise from north) and elevation (up from
/// the horizon) by the states of a target of any order, three for each.
///
/// `sigma` holds the deviations of azimuth and elevation.
///
/// # Errors
/// [`Error::Overhead`] where the target is straight above or below, so that no
/// azimuth exists; [`NumberError::Length`] for rows that do not have three numbers for
/// each order; otherwise as [`row`](super::row).
///
/// # Source
/// Derivatives of azimuth and elevation, ours; in the plane they are [`motion_row`].
pub fn azimuth_elevation_rows<T: Real>(
    time: T,
    offset: [T; 3],
    sigma: [T; 2],
    azimuth: &mut [T],
    elevation: &mut [T],
) -> Result<(), Error> {
    check_orders::<3>("azimuth", azimuth.len())?;
    check_orders::<3>("elevation", elevation.len())?;
    check_finite("offset", &offset)?;
    let [east, north, up] = offset;
    let level = hypot(east, north);
    let range = hypot(level, up);
    if range > T::zero() && !(level > T::zero()) {
        return Err(Error::Overhead { index: 0 });
    }
    let row = super::row(T::zero(), east, north, sigma[0])?;
    spread(time, &[row[0], row[1], T::zero()], azimuth)?;
    if !(sigma[1] > T::zero() && sigma[1].is_finite()) {
        return Err(Error::Sigma {
            index: 0,
            given: sigma[1].double(),
        });
    }
    let weight = T::one() / (range * sigma[1]);
    let along = up / range * weight;
    let row = [
        -(east / level) * along,
        -(north / level) * along,
        level / range * weight,
    ];
    spread(time, &row, elevation)
}

/// The row by the position at `time`, spread over the derivatives at the start.
fn spread<T: Real, const D: usize>(time: T, row: &[T; D], out: &mut [T]) -> Result<(), Error> {
    check_finite("time", &[time])?;
    for (k, part) in out.chunks_exact_mut(D).enumerate() {
        let factor = power(time, k);
        for (out, &value) in part.iter_mut().zip(row) {
            *out = factor * value;
        }
    }
    if all_finite(out) {
        Ok(())
    } else {
        Err(NumberError::Overflow { result: "row" }.into())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::{azimuth_elevation_rows, motion, motion_row};
    use crate::bearings::{Error, bearing, row};
    use crate::scalar::hypot;

    const STATE: [f64; 12] = [
        300.0, -900.0, 250.0, 3.0, 2.0, -1.5, 0.1, -0.2, 0.05, 1e-3, 2e-3, -3e-3,
    ];

    #[test]
    fn rows_are_the_differences_of_the_angles() {
        let time = 7.0;
        let step = 1e-4;
        // In the plane: the first two coordinates of each order.
        for order in 0..4 {
            let n = 2 * (order + 1);
            let state: [f64; 8] = core::array::from_fn(|i| STATE[3 * (i / 2) + i % 2]);
            let angle =
                |state: &[f64]| bearing([0.0; 2], motion::<f64, 2>(state, time).unwrap()).unwrap();
            let mut found = [0.0; 8];
            let place = motion::<f64, 2>(&state[..n], time).unwrap();
            assert_eq!(motion_row(time, place, 0.5, &mut found[..n]), Ok(()));
            for i in 0..n {
                let (mut above, mut below) = (state, state);
                above[i] += step;
                below[i] -= step;
                let slope = (angle(&above[..n]) - angle(&below[..n])) / (2.0 * step) / 0.5;
                assert!((found[i] - slope).abs() < 1e-7 * (1.0 + slope.abs()));
            }
            if order == 1 {
                assert_eq!(
                    found[..4],
                    row(time, place[0], place[1], 0.5).unwrap_or([0.0; 4])
                );
            }
        }
        for order in 0..4 {
            let n = 3 * (order + 1);
            let angles = |state: &[f64]| {
                let [x, y, z] = motion::<f64, 3>(state, time).unwrap();
                [x.atan2(y), z.atan2(hypot(x, y))]
            };
            let (mut azimuth, mut elevation) = ([0.0; 12], [0.0; 12]);
            let place = motion::<f64, 3>(&STATE[..n], time).unwrap();
            let rows = (&mut azimuth[..n], &mut elevation[..n]);
            let found = azimuth_elevation_rows(time, place, [0.5, 0.25], rows.0, rows.1);
            assert_eq!(found, Ok(()));
            for i in 0..n {
                let (mut above, mut below) = (STATE, STATE);
                above[i] += step;
                below[i] -= step;
                let (above, below) = (angles(&above[..n]), angles(&below[..n]));
                let slope: [f64; 2] = core::array::from_fn(|k| (above[k] - below[k]) / 2.0 / step);
                assert!((azimuth[i] - slope[0] / 0.5).abs() < 1e-7 * (1.0 + slope[0].abs()));
                assert!((elevation[i] - slope[1] / 0.25).abs() < 1e-7 * (1.0 + slope[1].abs()));
            }
        }
    }

    #[test]
    fn no_azimuth_overhead() {
        let (mut a, mut b) = ([0.0; 3], [0.0; 3]);
        let found = azimuth_elevation_rows(0.0, [0.0, 0.0, 9.0], [1.0; 2], &mut a, &mut b);
        assert_eq!(found, Err(Error::Overhead { index: 0 }));
        let found = azimuth_elevation_rows(0.0, [0.0; 3], [1.0; 2], &mut a, &mut b);
        assert_eq!(found, Err(Error::OnTarget { index: 0 }));
    }
}
