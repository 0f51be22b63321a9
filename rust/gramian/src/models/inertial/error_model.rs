//! The error model at one place and motion: constant coefficients.

use super::earth::{Earth, gravity};
use super::{Error, add, cross_matrix, product};
use crate::numbers::algebra::{cross, dot, multiply};
use crate::scalar::{NumberError, Real, all_finite, check_finite, finite};

/// The matrix from body axes (forward, left, up) to north, west, up.
///
/// Heading is clockwise from north, pitch nose up, roll right side down.
///
/// # Units
/// rad.
///
/// # Errors
/// [`Error::Number`] for an angle that is not finite.
///
/// ```
/// let east = gramian::inertial::rotation(core::f64::consts::FRAC_PI_2, 0.0, 0.0)?;
/// assert_eq!(east[1][0], -1.0);
/// # Ok::<(), gramian::inertial::Error>(())
/// ```
pub fn rotation<T: Real>(heading: T, pitch: T, roll: T) -> Result<[[T; 3]; 3], Error> {
    for (name, angle) in [("heading", heading), ("pitch", pitch), ("roll", roll)] {
        check_finite(name, &[angle])?;
    }
    let (o, one) = (T::zero(), T::one());
    // A turn clockwise seen from above is negative about "up"; nose up is
    // negative about "left".
    let (s, c) = heading.sin_cos();
    let about_up = [[c, s, o], [-s, c, o], [o, o, one]];
    let (s, c) = pitch.sin_cos();
    let about_left = [[c, o, -s], [o, one, o], [s, o, c]];
    let (s, c) = roll.sin_cos();
    let about_forward = [[one, o, o], [o, c, -s], [o, s, c]];
    Ok(product(&product(&about_up, &about_left), &about_forward))
}

/// Whether gravity changes with latitude and height in the model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GravityGradient {
    /// It does: the height channel diverges by itself, as a free navigator's does.
    #[default]
    Include,
    /// It is constant.
    Omit,
}

/// Where a navigator is and how it moves.
#[derive(Clone, Copy, Debug)]
pub struct Motion<T> {
    /// Geodetic, rad.
    pub latitude: T,
    /// Above the ellipsoid, m.
    pub height: T,
    /// North, west, up, m/s.
    pub velocity: [T; 3],
    /// North, west, up, m/s^2; `None` for that of constant velocity.
    pub specific_force: Option<[T; 3]>,
    /// From body to navigation axes; see [`rotation`].
    pub attitude: [[T; 3]; 3],
    /// Of the body against the navigation axes, in body axes, rad/s.
    pub angular_rate: [T; 3],
    /// From the navigator to the antenna, in body axes, m.
    pub lever_arm: [T; 3],
    /// Rotation of the Earth, rad/s; see [`EARTH_RATE`](super::EARTH_RATE).
    pub earth_rate: T,
    /// Whether gravity changes with the place.
    pub gravity_gradient: GravityGradient,
}

impl<T: Real> Motion<T> {
    /// At rest, level and heading north.
    pub fn at_rest(latitude: T, height: T, earth_rate: T) -> Self {
        let (o, one) = (T::zero(), T::one());
        Self {
            latitude,
            height,
            velocity: [o; 3],
            specific_force: None,
            attitude: [[one, o, o], [o, one, o], [o, o, one]],
            angular_rate: [o; 3],
            lever_arm: [o; 3],
            earth_rate,
            gravity_gradient: GravityGradient::Include,
        }
    }

    fn check(&self) -> Result<(), Error> {
        check_finite("velocity", &self.velocity)?;
        for (axis, &v) in self.velocity.iter().enumerate() {
            if !(v.abs() < T::of(1e9)) {
                let given = v.double();
                return Err(Error::Velocity { axis, given });
            }
        }
        check_finite("attitude", self.attitude.as_flattened())?;
        check_finite("angular_rate", &self.angular_rate)?;
        check_finite("lever_arm", &self.lever_arm)?;
        if let Some(force) = &self.specific_force {
            check_finite("specific_force", force)?;
        }
        let tolerance = T::of(1e-9).max(T::of(32.0) * T::EPSILON);
        for (i, a) in self.attitude.iter().enumerate() {
            for (j, b) in self.attitude.iter().enumerate() {
                let unit = if i == j { T::one() } else { T::zero() };
                let error = dot(a, b) - unit;
                if !(error.abs() <= tolerance) {
                    return Err(Error::Attitude);
                }
            }
        }
        Ok(())
    }
}

/// The matrices of x' = A x, z = C x: 15 states, or 18 with those of the lever arm.
#[derive(Clone, Copy, Debug)]
pub struct ErrorModel<T, const N: usize> {
    /// A.
    pub a: [[T; N]; N],
    /// C: velocity and place of the antenna by the states.
    pub c: [[T; N]; 6],
    /// One metre north, west, up in latitude (rad), longitude (rad) and height (m).
    pub per_metre: [T; 3],
}

/// Columns of the states.
const TILT: usize = 0;
const VELOCITY: usize = 3;
const PLACE: usize = 6;
const GYRO: usize = 9;
const ACCELEROMETER: usize = 12;
const LEVER_ARM: usize = 15;

/// Adds a block of three columns to three rows.
fn put<T: Real, const N: usize>(rows: &mut [[T; N]], column: usize, block: &[[T; 3]; 3]) {
    for (row, values) in rows.iter_mut().zip(block) {
        for (entry, &value) in row[column..column + 3].iter_mut().zip(values) {
            *entry += value;
        }
    }
}

fn negative<T: Real>(block: &[[T; 3]; 3]) -> [[T; 3]; 3] {
    block.map(|row| row.map(|x| -x))
}

fn sum<T: Real>(a: &[[T; 3]; 3], b: &[[T; 3]; 3]) -> [[T; 3]; 3] {
    core::array::from_fn(|i| add(a[i], b[i]))
}

/// The error model of a navigator beside a satellite receiver; `N` is 15, or 18 for the
/// errors of the lever arm as states.
///
/// # Errors
/// As [`check_place`](super::check_place); [`Error::Attitude`], [`Error::Velocity`], [`Error::Number`].
///
/// # Source
/// The exact derivative of the mechanisation
/// v' = C f - (2 `w_ie` + `w_en`) x v + g, L' = `v_N` / (`R_M` + h),
/// lambda' = -`v_W` / ((`R_N` + h) cos L), h' = `v_U`, with the tilt phi of the computed axes,
/// C^ = (I - [phi x]) C. Titterton & Weston, Strapdown Inertial Navigation Technology,
/// ch. 3 and 12; at rest Yang & Yin 2012, eq. (13).
///
/// ```
/// use gramian::inertial::{EARTH_RATE, Motion, error_model};
/// let model = error_model::<f64, 15>(&Motion::at_rest(0.5, 0.0, EARTH_RATE))?;
/// // A tilt about west makes gravity look like an acceleration to the north.
/// assert!((model.a[3][1] + gramian::inertial::gravity(0.5, 0.0)?).abs() < 1e-12);
/// # Ok::<(), gramian::inertial::Error>(())
/// ```
pub fn error_model<T: Real, const N: usize>(motion: &Motion<T>) -> Result<ErrorModel<T, N>, Error> {
    const { assert!(N == 15 || N == 18, "15 states, or 18 with the lever arm") }
    let earth = Earth::new(motion.latitude, motion.height, motion.earth_rate)?;
    motion.check()?;
    let (o, one) = (T::zero(), T::one());
    let unit = [[one, o, o], [o, one, o], [o, o, one]];
    let (v, to_nav) = (motion.velocity, motion.attitude);
    let (w_ie, w_en) = (earth.rotation(), earth.transport(v));
    let w_in = cross_matrix(add(w_ie, w_en));
    let coriolis = add(add(w_ie, w_ie), w_en);
    let force = if let Some(force) = motion.specific_force {
        force
    } else {
        let weight = gravity(motion.latitude, motion.height)?;
        add(cross(&coriolis, &v), [o, o, weight])
    };
    // The change of w_in with velocity and place.
    let by_velocity = earth.transport_by_velocity();
    let (rotation, transport) = (earth.rotation_by_place(), earth.transport_by_place(v));
    let by_place = sum(&rotation, &transport);
    let (cross_v, [metres, by_latitude, by_height]) = (cross_matrix(v), earth.place_per_metre());

    let mut a = [[o; N]; N];
    let tilts = &mut a[TILT..TILT + 3];
    put(tilts, TILT, &negative(&w_in));
    put(tilts, VELOCITY, &by_velocity);
    put(tilts, PLACE, &by_place);
    put(tilts, GYRO, &negative(&to_nav));
    let speeds = &mut a[VELOCITY..VELOCITY + 3];
    put(speeds, TILT, &cross_matrix(force));
    put(speeds, VELOCITY, &negative(&cross_matrix(coriolis)));
    put(speeds, VELOCITY, &product(&cross_v, &by_velocity));
    put(
        speeds,
        PLACE,
        &product(&cross_v, &sum(&rotation, &by_place)),
    );
    put(speeds, ACCELEROMETER, &to_nav);
    if motion.gravity_gradient == GravityGradient::Include {
        for (entry, change) in speeds[2][PLACE..].iter_mut().zip(earth.gravity_by_place()) {
            *entry -= change;
        }
    }
    for i in 0..3 {
        a[PLACE + i][VELOCITY + i] = metres[i];
        a[PLACE + i][PLACE] = by_latitude[i] * v[i];
        a[PLACE + i][PLACE + 2] = by_height[i] * v[i];
    }

    let arm = multiply(&to_nav, &motion.lever_arm);
    let w_nb = multiply(&to_nav, &motion.angular_rate);
    let cross_arm = cross_matrix(arm);
    let mut c = [[o; N]; 6];
    // Velocity of the antenna, v + C (w_nb x l); w_nb is what the gyros say less
    // what the navigator takes w_in to be.
    let (speeds, places) = c.split_at_mut(3);
    put(speeds, VELOCITY, &unit);
    put(speeds, VELOCITY, &product(&cross_arm, &by_velocity));
    put(speeds, TILT, &cross_matrix(cross(&w_nb, &arm)));
    put(speeds, TILT, &negative(&product(&cross_arm, &w_in)));
    put(speeds, GYRO, &negative(&product(&cross_arm, &to_nav)));
    put(speeds, PLACE, &product(&cross_arm, &by_place));
    // Its place, p + T C l with T from metres to latitude, longitude, height.
    let scaled = |block: &[[T; 3]; 3]| -> [[T; 3]; 3] {
        core::array::from_fn(|i| block[i].map(|x| metres[i] * x))
    };
    put(places, PLACE, &unit);
    for i in 0..3 {
        places[i][PLACE] += by_latitude[i] * arm[i];
        places[i][PLACE + 2] += by_height[i] * arm[i];
    }
    put(places, TILT, &scaled(&cross_arm));
    if N > LEVER_ARM {
        put(speeds, LEVER_ARM, &product(&cross_matrix(w_nb), &to_nav));
        put(places, LEVER_ARM, &scaled(&to_nav));
    }
    if !all_finite(a.as_flattened()) || !all_finite(c.as_flattened()) {
        return Err(NumberError::Overflow {
            result: "error model",
        }
        .into());
    }
    Ok(ErrorModel {
        a,
        c,
        per_metre: metres.map(nalgebra::ComplexField::abs),
    })
}

/// The combinations of states that a navigator at rest determines, each at level 1, 2 or
/// 3: `Delta_N` - g `phi_W`, `Delta_W` + g `phi_N`, `eps_N` - `w_U` `phi_W`,
/// `eps_W` + `w_U` `phi_N` - `w_N` `phi_U` and `eps_U` + `w_N` `phi_W`, as rows by the
/// 15 states.
///
/// # Errors
/// As [`check_place`](super::check_place).
///
/// # Source
/// Yang & Yin 2012, table 1.
pub fn combinations_at_rest<T: Real>(
    latitude: T,
    height: T,
    earth_rate: T,
) -> Result<[[T; 15]; 5], Error> {
    let earth = Earth::new(latitude, height, earth_rate)?;
    let (g, [north, _, up]) = (gravity(latitude, height)?, earth.rotation());
    let mut rows = [[T::zero(); 15]; 5];
    let biases = [ACCELEROMETER, ACCELEROMETER + 1, GYRO, GYRO + 1, GYRO + 2];
    for (row, bias) in rows.iter_mut().zip(biases) {
        row[bias] = T::one();
    }
    rows[0][TILT + 1] = -g;
    rows[1][TILT] = g;
    rows[2][TILT + 1] = -up;
    rows[3][TILT] = up;
    rows[3][TILT + 2] = -north;
    rows[4][TILT + 1] = north;
    for row in rows {
        finite("combination", row)?;
    }
    Ok(rows)
}
