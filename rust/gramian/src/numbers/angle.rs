//! Angles: one way to take whole turns off, one convention, (-pi, pi].

use core::f64::consts::{PI, TAU};

use super::errors::{NumberError, check_finite};
use super::lane::Lane;
use super::scalar::Real;

/// Past this many radians a product of turns has too few digits left.
const LARGE: f64 = 1e4;

/// The angle in (-pi, pi] that differs from `angle` by whole turns.
///
/// A large angle is taken as it is, though the number next to it may be turns away.
///
/// # Units
/// rad.
///
/// # Errors
/// [`NumberError::NotFinite`].
///
/// ```
/// # use gramian::scalar::wrap_angle;
/// # use core::f64::consts::{PI, TAU};
/// assert!((wrap_angle(6.0)? - (6.0 - TAU)).abs() < 1e-15);
/// assert_eq!(wrap_angle(-PI)?, PI);
/// # Ok::<(), gramian::scalar::NumberError>(())
/// ```
pub fn wrap_angle<T: Real>(angle: T) -> Result<T, NumberError> {
    check_finite("angle", &[angle])?;
    Ok(wrapped(angle))
}

/// [`wrap_angle`] of numbers known to be finite.
#[inline(always)]
pub(crate) fn wrapped<L: Lane>(angle: L) -> L {
    let (turn, half) = (angle.splat(TAU), angle.splat(PI));
    let (size, large) = (angle.abs(), angle.splat(LARGE));
    let mut near = angle;
    if size.any_greater(large) {
        // A remainder has no rounding, but takes its time.
        near = size.select_greater(large, angle.remainder(turn), angle);
    }
    let wrapped = near - turn * near.times(1.0 / TAU).round();
    // What rounding leaves just outside.
    let wrapped = wrapped.select_greater(half, wrapped - turn, wrapped);
    wrapped.select_greater(-half, wrapped, wrapped + turn)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{PI, TAU};

    use super::wrapped;

    #[test]
    fn half_turns_are_positive() {
        for turns in -40..40 {
            let angle = f64::from(2 * turns + 1) * PI;
            let found = wrapped(angle);
            assert!(found > -PI && found <= PI, "{angle}: {found}");
        }
        assert_eq!(wrapped(-PI), PI);
        assert_eq!(wrapped(PI), PI);
        assert_eq!(wrapped(-core::f32::consts::PI), core::f32::consts::PI);
    }

    #[test]
    fn any_size_keeps_its_sine() {
        for angle in [0.0, 3.0, -4.0, 9_999.0, 10_001.0, -1e9, 1e300_f64] {
            let found = wrapped(angle);
            assert!(found.abs() <= PI);
            let error = 1e-16 * angle.abs().min(1e4) + 1e-9 * f64::from(angle.abs() > 1e4) * 1e9;
            if angle.abs() <= 1e4 {
                assert!(
                    (found.sin() - angle.sin()).abs() <= error + 1e-15,
                    "{angle}"
                );
            } else {
                assert_eq!(wrapped(angle % TAU), found);
            }
        }
        assert!(wrapped(f64::NAN).is_nan());
    }
}
