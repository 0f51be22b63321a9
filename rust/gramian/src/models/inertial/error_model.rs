//! The error model at one place and motion: constant coefficients.

use core::ops::Range;

use super::earth::{Earth, gravity};
use super::{Error, add, cross_matrix, product, transposed};
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
    /// From the navigator to the wheels of the odometer, in body axes, m.
    pub odometer_arm: [T; 3],
    /// Rotation of the Earth, rad/s; see [`EARTH_RATE`](super::EARTH_RATE).
    pub earth_rate: T,
    /// Whether gravity changes with the place.
    pub gravity_gradient: GravityGradient,
}

impl<T: Real> Motion<T> {
    /// At rest, level and heading north.
    pub fn at_rest(latitude: T, height: T, earth_rate: T) -> Self {
        let o = T::zero();
        Self {
            latitude,
            height,
            velocity: [o; 3],
            specific_force: None,
            attitude: unit(),
            angular_rate: [o; 3],
            lever_arm: [o; 3],
            odometer_arm: [o; 3],
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
        check_finite("odometer_arm", &self.odometer_arm)?;
        if let Some(force) = &self.specific_force {
            check_finite("specific_force", force)?;
        }
        check_rotation(&self.attitude)
    }
}

/// Refuses what is not orthogonal.
pub(super) fn check_rotation<T: Real>(matrix: &[[T; 3]; 3]) -> Result<(), Error> {
    let tolerance = T::of(1e-9).max(T::of(32.0) * T::EPSILON);
    for (i, a) in matrix.iter().enumerate() {
        for (j, b) in matrix.iter().enumerate() {
            let unit = if i == j { T::one() } else { T::zero() };
            let error = dot(a, b) - unit;
            if !(error.abs() <= tolerance) {
                return Err(Error::Attitude);
            }
        }
    }
    Ok(())
}

/// States of the full model; see [`Group`].
pub const STATES: usize = 51;

/// Columns of the states.
const TILT: usize = 0;
const VELOCITY: usize = 3;
const PLACE: usize = 6;
const GYRO: usize = 9;
const ACCELEROMETER: usize = 12;
const LEVER_ARM: usize = 15;
const GYRO_SCALE: usize = 18;
const GYRO_MISALIGNMENT: usize = 21;
const ACCELEROMETER_SCALE: usize = 27;
const ACCELEROMETER_MISALIGNMENT: usize = 30;
const G_SENSITIVITY: usize = 36;
const ODOMETER_SCALE: usize = 45;
const ODOMETER_MOUNTING: usize = 46;
const ODOMETER_ARM: usize = 48;

/// The off-diagonal entries of a sensor triad's matrix, in the order of their states:
/// the reading of the first axis by the quantity along the second. The first three are
/// the lower triangle.
const OFF_DIAGONAL: [(usize, usize); 6] = [(1, 0), (2, 0), (2, 1), (0, 1), (0, 2), (1, 2)];

/// States that belong together, in the order of their columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// Tilt, velocity, place, gyro and accelerometer bias: in every model.
    Core,
    /// Of the satellite antenna, in body axes, m.
    LeverArm,
    /// Relative.
    GyroScale,
    /// Readings of gyro L by the rate along F, U by F, U by L, F by L, F by U, L by U, rad.
    GyroMisalignment,
    /// Relative.
    AccelerometerScale,
    /// The lower triangle: L by F, U by F, U by L, rad. The body axes are then those of
    /// the accelerometers.
    AccelerometerNonorthogonality,
    /// All six, in the order of the gyros': the body axes are the vehicle's.
    AccelerometerMisalignment,
    /// Readings of the gyros by the specific force, by rows, rad/s per m/s^2.
    GSensitivity,
    /// Relative.
    OdometerScale,
    /// Of the wheels' axes against the body, about left and about up, rad.
    OdometerMounting,
    /// From the navigator to the wheels, in body axes, m.
    OdometerArm,
}

impl Group {
    /// The columns of its states in the full model.
    ///
    /// ```
    /// use gramian::inertial::Group;
    /// assert_eq!(Group::GyroScale.columns(), 18..21);
    /// ```
    #[must_use]
    pub fn columns(self) -> Range<usize> {
        let (first, count) = match self {
            Self::Core => (TILT, 15),
            Self::LeverArm => (LEVER_ARM, 3),
            Self::GyroScale => (GYRO_SCALE, 3),
            Self::GyroMisalignment => (GYRO_MISALIGNMENT, 6),
            Self::AccelerometerScale => (ACCELEROMETER_SCALE, 3),
            Self::AccelerometerNonorthogonality => (ACCELEROMETER_MISALIGNMENT, 3),
            Self::AccelerometerMisalignment => (ACCELEROMETER_MISALIGNMENT, 6),
            Self::GSensitivity => (G_SENSITIVITY, 9),
            Self::OdometerScale => (ODOMETER_SCALE, 1),
            Self::OdometerMounting => (ODOMETER_MOUNTING, 2),
            Self::OdometerArm => (ODOMETER_ARM, 3),
        };
        first..first + count
    }
}

/// What is measured beside the navigator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// Of the satellite antenna, north, west, up, m/s.
    Velocity,
    /// Of the satellite antenna: latitude and longitude, rad, height, m.
    Position,
    /// Forward speed of the wheels, m/s.
    Odometer,
    /// Speed of the wheels to the left and upwards, m/s: nearly zero on a road.
    SideSlip,
    /// Of the navigator itself, north, west, up, m/s: zero while it stands.
    ZeroVelocity,
    /// Of the body against the navigation axes, in body axes, rad/s: zero while it stands.
    ZeroAngularRate,
    /// Of the body's forward axis, clockwise from north, rad.
    Heading,
}

impl Output {
    /// How many numbers it is.
    #[must_use]
    pub fn len(self) -> usize {
        match self {
            Self::Odometer | Self::Heading => 1,
            Self::SideSlip => 2,
            _ => 3,
        }
    }

    /// Never.
    #[must_use]
    pub fn is_empty(self) -> bool {
        false
    }
}

/// One line of the full model.
type Line<T> = [T; STATES];

/// The full error model at one place and motion: x' = A x, of which all but the first nine
/// rows are zero, and what is seen of x.
///
/// A model of fewer states takes the columns of its [`Group`]s: states that are left out
/// are known.
#[derive(Clone, Copy, Debug)]
pub struct ErrorModel<T> {
    /// The first nine rows of A: rates of tilt, velocity and place by the states.
    pub a: [Line<T>; 9],
    /// One metre north, west, up in latitude (rad), longitude (rad) and height (m).
    pub per_metre: [T; 3],
    motion: Motion<T>,
    earth: Earth<T>,
    /// Of the angular rate against the navigation axes, in body axes.
    angular_rate: [Line<T>; 3],
    /// From metres to latitude, longitude and height, and its derivatives.
    places: [[T; 3]; 3],
}

/// Adds a block of three columns to three rows.
fn put<T: Real>(rows: &mut [Line<T>], column: usize, block: &[[T; 3]; 3]) {
    for (row, values) in rows.iter_mut().zip(block) {
        for (entry, &value) in row[column..column + 3].iter_mut().zip(values) {
            *entry += value;
        }
    }
}

/// Adds block times three lines to three rows.
fn put_product<T: Real>(rows: &mut [Line<T>], block: &[[T; 3]; 3], lines: &[Line<T>; 3]) {
    for (row, factors) in rows.iter_mut().zip(block) {
        for (&factor, line) in factors.iter().zip(lines) {
            for (entry, &value) in row.iter_mut().zip(line) {
                *entry += factor * value;
            }
        }
    }
}

/// Errors of the readings of a triad, in body axes, by its bias, scale factors and
/// misalignments.
fn triad<T: Real>(columns: [usize; 3], along: &[T; 3]) -> [Line<T>; 3] {
    let [bias, scale, misalignment] = columns;
    let mut lines = [[T::zero(); STATES]; 3];
    for axis in 0..3 {
        lines[axis][bias + axis] = T::one();
        lines[axis][scale + axis] = along[axis];
    }
    for (k, (reading, by)) in OFF_DIAGONAL.into_iter().enumerate() {
        lines[reading][misalignment + k] = along[by];
    }
    lines
}

fn negative<T: Real>(block: &[[T; 3]; 3]) -> [[T; 3]; 3] {
    block.map(|row| row.map(|x| -x))
}

fn sum<T: Real>(a: &[[T; 3]; 3], b: &[[T; 3]; 3]) -> [[T; 3]; 3] {
    core::array::from_fn(|i| add(a[i], b[i]))
}

/// A vector without components that are rounding beside its largest. Heading east, what is
/// left of the cosine of a right angle would be the weakest coupling of A, by which ranks of
/// segments are decided; headings summed over many segments carry more than one rounding.
fn without_rounding<T: Real>(vector: [T; 3]) -> [T; 3] {
    let largest = vector.iter().fold(T::zero(), |top, x| top.max(x.abs()));
    let rounding = largest * T::of(1e-12).max(T::of(32.0) * T::EPSILON);
    vector.map(|x| if x.abs() < rounding { T::zero() } else { x })
}

/// The error model of a navigator.
///
/// # Errors
/// As [`check_place`](super::check_place); [`Error::Attitude`], [`Error::Velocity`], [`Error::Number`].
///
/// # Source
/// The exact derivative of the mechanisation
/// v' = C f - (2 `w_ie` + `w_en`) x v + g, L' = `v_N` / (`R_M` + h),
/// lambda' = -`v_W` / ((`R_N` + h) cos L), h' = `v_U`, with the tilt phi of the computed axes,
/// C^ = (I - [phi x]) C, and readings (I + M) f + bias, (I + M) w + G f + bias. Titterton &
/// Weston, Strapdown Inertial Navigation Technology, ch. 3, 4 and 12; at rest Yang & Yin
/// 2012, eq. (13).
///
/// ```
/// use gramian::inertial::{EARTH_RATE, Motion, Output, error_model};
/// let model = error_model::<f64>(&Motion::at_rest(0.5, 0.0, EARTH_RATE))?;
/// // A tilt about west makes gravity look like an acceleration to the north.
/// let g = gramian::inertial::gravity(0.5, 0.0)?;
/// assert!((model.a[3][1] + g).abs() < 1e-12);
/// // The scale of the up accelerometer shows as an acceleration upwards.
/// assert!((model.a[5][29] - g).abs() < 1e-12);
/// assert_eq!(model.output(Output::Heading)?[0][2], 1.0);
/// # Ok::<(), gramian::inertial::Error>(())
/// ```
pub fn error_model<T: Real>(motion: &Motion<T>) -> Result<ErrorModel<T>, Error> {
    let earth = Earth::new(motion.latitude, motion.height, motion.earth_rate)?;
    motion.check()?;
    let o = T::zero();
    let motion = &Motion {
        attitude: motion.attitude.map(without_rounding),
        velocity: without_rounding(motion.velocity),
        angular_rate: without_rounding(motion.angular_rate),
        ..*motion
    };
    let (v, to_nav) = (motion.velocity, motion.attitude);
    let to_body = transposed(&to_nav);
    let (w_ie, w_en) = (earth.rotation(), earth.transport(v));
    let turning = add(w_ie, w_en);
    let w_in = cross_matrix(turning);
    let coriolis = add(add(w_ie, w_ie), w_en);
    let force = if let Some(force) = motion.specific_force {
        force
    } else {
        let weight = gravity(motion.latitude, motion.height)?;
        add(cross(&coriolis, &v), [o, o, weight])
    };
    let force = without_rounding(force);
    // The change of w_in with velocity and place.
    let by_velocity = earth.transport_by_velocity();
    let (rotation, transport) = (earth.rotation_by_place(), earth.transport_by_place(v));
    let by_place = sum(&rotation, &transport);
    let (cross_v, [metres, by_latitude, by_height]) = (cross_matrix(v), earth.place_per_metre());

    // What the sensors say too much, in body axes.
    let force_in_body = multiply(&to_body, &force);
    let rate_in_body = add(multiply(&to_body, &turning), motion.angular_rate);
    let columns = [
        ACCELEROMETER,
        ACCELEROMETER_SCALE,
        ACCELEROMETER_MISALIGNMENT,
    ];
    let accelerometers = triad(columns, &force_in_body);
    let mut gyros = triad([GYRO, GYRO_SCALE, GYRO_MISALIGNMENT], &rate_in_body);
    for (axis, line) in gyros.iter_mut().enumerate() {
        let first = G_SENSITIVITY + 3 * axis;
        line[first..first + 3].copy_from_slice(&force_in_body);
    }

    let mut a = [[o; STATES]; 9];
    let tilts = &mut a[TILT..TILT + 3];
    put(tilts, TILT, &negative(&w_in));
    put(tilts, VELOCITY, &by_velocity);
    put(tilts, PLACE, &by_place);
    put_product(tilts, &negative(&to_nav), &gyros);
    let speeds = &mut a[VELOCITY..VELOCITY + 3];
    put(speeds, TILT, &cross_matrix(force));
    put(speeds, VELOCITY, &negative(&cross_matrix(coriolis)));
    put(speeds, VELOCITY, &product(&cross_v, &by_velocity));
    put(
        speeds,
        PLACE,
        &product(&cross_v, &sum(&rotation, &by_place)),
    );
    put_product(speeds, &to_nav, &accelerometers);
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

    // w_nb is what the gyros say less what the navigator takes w_in to be, in body axes.
    let mut angular_rate = gyros;
    put(&mut angular_rate, TILT, &product(&to_body, &w_in));
    let to_body = negative(&to_body);
    put(
        &mut angular_rate,
        VELOCITY,
        &product(&to_body, &by_velocity),
    );
    put(&mut angular_rate, PLACE, &product(&to_body, &by_place));
    let per_metre = metres.map(nalgebra::ComplexField::abs);
    let parts = [a.as_flattened(), angular_rate.as_flattened(), &per_metre];
    if !parts.into_iter().all(all_finite) {
        return Err(OVERFLOW);
    }
    Ok(ErrorModel {
        a,
        per_metre,
        motion: *motion,
        earth,
        angular_rate,
        places: [metres, by_latitude, by_height],
    })
}

const OVERFLOW: Error = Error::Number(NumberError::Overflow {
    result: "error model",
});

impl<T: Real> ErrorModel<T> {
    /// What an output shows of the states: as many lines as it has numbers, the rest zero.
    ///
    /// # Errors
    /// [`Error::Vertical`] for the heading of a nose that points up or down;
    /// [`Error::Number`] where an entry overflows.
    pub fn output(&self, output: Output) -> Result<[Line<T>; 3], Error> {
        let lines = match output {
            Output::Velocity => self.antenna_velocity(),
            Output::Position => self.antenna_place(),
            Output::Odometer | Output::SideSlip => {
                let [forward, left, up] = self.wheel_speed();
                if output == Output::Odometer {
                    [forward, [T::zero(); STATES], [T::zero(); STATES]]
                } else {
                    [left, up, [T::zero(); STATES]]
                }
            }
            Output::ZeroVelocity => {
                let mut lines = [[T::zero(); STATES]; 3];
                put(&mut lines, VELOCITY, &unit());
                lines
            }
            Output::ZeroAngularRate => self.angular_rate,
            Output::Heading => self.heading()?,
        };
        if all_finite(lines.as_flattened()) {
            Ok(lines)
        } else {
            Err(OVERFLOW)
        }
    }

    /// Velocity of the antenna: that with which its place moves, v + C (`w_nb` x l) and what
    /// that exceeds by since the antenna is elsewhere on the Earth. Without it an arm would be
    /// seen in straight motion: a place that is higher and as fast as the one below comes behind.
    /// T is held, as all coefficients are.
    fn antenna_velocity(&self) -> [Line<T>; 3] {
        let (to_nav, v) = (&self.motion.attitude, self.motion.velocity);
        let arm = multiply(to_nav, &self.motion.lever_arm);
        let w_nb = multiply(to_nav, &self.motion.angular_rate);
        let of_each = |block: &[[T; 3]; 3]| -> [[T; 3]; 3] {
            core::array::from_fn(|i| block[i].map(|x| v[i] * x))
        };
        let faster = self.earth.faster_beside();
        let by_arm = of_each(&faster);
        let mut lines = [[T::zero(); STATES]; 3];
        put(&mut lines, VELOCITY, &unit());
        for (i, part) in multiply(&faster, &arm).into_iter().enumerate() {
            lines[i][VELOCITY + i] += part;
        }
        put(&mut lines, TILT, &cross_matrix(cross(&w_nb, &arm)));
        put(&mut lines, TILT, &product(&by_arm, &cross_matrix(arm)));
        let by_place = of_each(&self.earth.faster_beside_by_place(arm));
        put(&mut lines, PLACE, &by_place);
        let turned = product(&cross_matrix(arm), to_nav);
        put_product(&mut lines, &negative(&turned), &self.angular_rate);
        let by_arm = sum(&cross_matrix(w_nb), &by_arm);
        put(&mut lines, LEVER_ARM, &product(&by_arm, to_nav));
        lines
    }

    /// Its place, p + T C l with T from metres to latitude, longitude, height.
    fn antenna_place(&self) -> [Line<T>; 3] {
        let to_nav = &self.motion.attitude;
        let arm = multiply(to_nav, &self.motion.lever_arm);
        let [metres, by_latitude, by_height] = self.places;
        let scaled = |block: &[[T; 3]; 3]| -> [[T; 3]; 3] {
            core::array::from_fn(|i| block[i].map(|x| metres[i] * x))
        };
        let mut lines = [[T::zero(); STATES]; 3];
        put(&mut lines, PLACE, &unit());
        for i in 0..3 {
            lines[i][PLACE] += by_latitude[i] * arm[i];
            lines[i][PLACE + 2] += by_height[i] * arm[i];
        }
        put(&mut lines, TILT, &scaled(&cross_matrix(arm)));
        put(&mut lines, LEVER_ARM, &scaled(to_nav));
        lines
    }

    /// Velocity of the wheels in their own axes, (I - [mu x]) (C^T v + `w_nb` x l), forward
    /// times 1 + scale.
    fn wheel_speed(&self) -> [Line<T>; 3] {
        let motion = &self.motion;
        let to_body = transposed(&motion.attitude);
        let w_nb = motion.angular_rate;
        let u = add(
            multiply(&to_body, &motion.velocity),
            cross(&w_nb, &motion.odometer_arm),
        );
        let mut lines = [[T::zero(); STATES]; 3];
        put(&mut lines, VELOCITY, &to_body);
        let tilted = product(&to_body, &cross_matrix(motion.velocity));
        put(&mut lines, TILT, &negative(&tilted));
        let arm = negative(&cross_matrix(motion.odometer_arm));
        put_product(&mut lines, &arm, &self.angular_rate);
        put(&mut lines, ODOMETER_ARM, &cross_matrix(w_nb));
        for (line, by) in lines.iter_mut().zip(cross_matrix(u)) {
            line[ODOMETER_MOUNTING..ODOMETER_MOUNTING + 2].copy_from_slice(&by[1..]);
        }
        lines[0][ODOMETER_SCALE] = u[0];
        lines
    }

    /// Heading of the forward axis x, by its change x x phi.
    fn heading(&self) -> Result<[Line<T>; 3], Error> {
        let axis = self.motion.attitude.map(|row| row[0]);
        let level = axis[0] * axis[0] + axis[1] * axis[1];
        if !(level > T::of(1e-12)) {
            return Err(Error::Vertical);
        }
        let change = cross_matrix(axis);
        let mut lines = [[T::zero(); STATES]; 3];
        for k in 0..3 {
            lines[0][TILT + k] = (axis[1] * change[0][k] - axis[0] * change[1][k]) / level;
        }
        Ok(lines)
    }
}

fn unit<T: Real>() -> [[T; 3]; 3] {
    let (o, one) = (T::zero(), T::one());
    [[one, o, o], [o, one, o], [o, o, one]]
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
