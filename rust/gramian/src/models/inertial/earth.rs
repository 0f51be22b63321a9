//! The Earth under a navigator: ellipsoid, gravity, and how the axes turn over it.

use super::Error;
use crate::numbers::algebra::multiply;
use crate::scalar::{Real, check_finite, finite_one};

/// Rotation of the Earth, rad/s (WGS 84).
pub const EARTH_RATE: f64 = 7.292_115e-5;

// WGS 84: semi-major axis, flattening, and the constants of Somigliana's formula
// for gravity on the ellipsoid. NIMA TR8350.2, tables 3.1, 3.3 and 3.4.
const SEMI_MAJOR: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;
const ECCENTRICITY2: f64 = FLATTENING * (2.0 - FLATTENING);
const GRAVITY_EQUATOR: f64 = 9.780_325_335_9;
const SOMIGLIANA: f64 = 0.001_931_852_652_41;
/// omega^2 a^2 b / GM, for gravity above the ellipsoid.
const GRAVITY_RATIO: f64 = 0.003_449_786_506_84;

/// The radii of curvature in the meridian and across it.
///
/// # Units
/// rad, m.
///
/// # Errors
/// [`Error::Number`] for a latitude that is not finite.
///
/// ```
/// let (meridian, normal) = gramian::inertial::radii(0.0_f64)?;
/// assert_eq!((meridian.round(), normal.round()), (6335439.0, 6378137.0));
/// # Ok::<(), gramian::inertial::Error>(())
/// ```
pub fn radii<T: Real>(latitude: T) -> Result<(T, T), Error> {
    check_finite("latitude", &[latitude])?;
    Ok(curvature(latitude.sin()))
}

fn curvature<T: Real>(sin: T) -> (T, T) {
    let w = (T::one() - T::of(ECCENTRICITY2) * (sin * sin)).sqrt();
    let meridian = T::of(SEMI_MAJOR * (1.0 - ECCENTRICITY2)) / (w * w * w);
    (meridian, T::of(SEMI_MAJOR) / w)
}

/// Gravity, positive downwards, `height` above the ellipsoid.
///
/// # Units
/// rad, m, m/s^2.
///
/// # Errors
/// [`Error::Height`] at the radius of the Earth or beyond, [`Error::Number`].
///
/// # Source
/// Somigliana's formula; above the ellipsoid the second-order expansion of NIMA
/// TR8350.2, eq. (4-3).
///
/// ```
/// let g = gramian::inertial::gravity(core::f64::consts::FRAC_PI_4, 0.0)?;
/// assert!((g - 9.806198).abs() < 1e-6);
/// # Ok::<(), gramian::inertial::Error>(())
/// ```
pub fn gravity<T: Real>(latitude: T, height: T) -> Result<T, Error> {
    check_finite("latitude", &[latitude])?;
    check_finite("height", &[height])?;
    if !(height.abs() < T::of(SEMI_MAJOR)) {
        return Err(Error::Height {
            given: height.double(),
            allowed: "within the radius of the Earth",
        });
    }
    let sin = latitude.sin();
    let s = sin * sin;
    let (first, second) = free_air(s);
    let above = T::one() - first * height + second * (height * height);
    Ok(finite_one("gravity", on_ellipsoid(s) * above)?)
}

/// Somigliana's formula, of the sine of the latitude squared.
fn on_ellipsoid<T: Real>(s: T) -> T {
    let w = (T::one() - T::of(ECCENTRICITY2) * s).sqrt();
    T::of(GRAVITY_EQUATOR) * (T::one() + T::of(SOMIGLIANA) * s) / w
}

/// How gravity falls with height, relative to that on the ellipsoid: the factors of the
/// height and of its square.
fn free_air<T: Real>(s: T) -> (T, T) {
    let level = T::of(1.0 + FLATTENING + GRAVITY_RATIO);
    let first = T::of(2.0 / SEMI_MAJOR) * (level - T::of(2.0 * FLATTENING) * s);
    (first, T::of(3.0 / (SEMI_MAJOR * SEMI_MAJOR)))
}

/// Refuses a latitude beyond the poles or on one, and a height at which gravity is not
/// expanded.
///
/// # Errors
/// [`Error::Latitude`], [`Error::Pole`], [`Error::Height`], [`Error::Number`].
pub fn check_place<T: Real>(latitude: T, height: T) -> Result<(), Error> {
    check_finite("latitude", &[latitude])?;
    check_finite("height", &[height])?;
    let (pole, given) = (T::frac_pi_2(), latitude.double());
    if latitude.abs() > pole {
        return Err(Error::Latitude { given });
    }
    // Nearer than this, a millimetre, tan L has no digit left that means anything.
    if pole - latitude.abs() < T::of(1e-10) {
        return Err(Error::Pole { given });
    }
    // Gravity is expanded in the height over the radius: far out it means nothing.
    if !(height > T::of(-SEMI_MAJOR / 2.0) && height < T::of(SEMI_MAJOR)) {
        return Err(Error::Height {
            given: height.double(),
            allowed: "above the ellipsoid's core and below its radius",
        });
    }
    Ok(())
}

/// Rates of the navigation axes at one place, with their derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Earth<T> {
    rate: T,
    height: T,
    sin: T,
    cos: T,
    tan: T,
    /// Radii of curvature plus height, in the meridian and across it.
    pub(super) meridian: T,
    pub(super) normal: T,
    /// Their derivatives by latitude.
    meridian_by_latitude: T,
    normal_by_latitude: T,
}

impl<T: Real> Earth<T> {
    /// The Earth at a place, turning at `rate`.
    ///
    /// # Units
    /// rad, m, rad/s.
    ///
    /// # Errors
    /// As [`check_place`].
    pub(super) fn new(latitude: T, height: T, rate: T) -> Result<Self, Error> {
        check_place(latitude, height)?;
        check_finite("earth_rate", &[rate])?;
        let (sin, cos) = latitude.sin_cos();
        let (meridian, normal) = curvature(sin);
        let w2 = T::one() - T::of(ECCENTRICITY2) * (sin * sin);
        let slope = T::of(ECCENTRICITY2) * sin * cos / w2;
        Ok(Self {
            rate,
            height,
            sin,
            cos,
            tan: sin / cos,
            meridian: meridian + height,
            normal: normal + height,
            meridian_by_latitude: T::of(3.0) * meridian * slope,
            normal_by_latitude: normal * slope,
        })
    }

    /// Cosine of the latitude.
    pub(super) fn cos(&self) -> T {
        self.cos
    }

    /// The rate of the Earth in north, west, up.
    pub(super) fn rotation(&self) -> [T; 3] {
        [self.rate * self.cos, T::zero(), self.rate * self.sin]
    }

    /// Its derivative by latitude, longitude and height.
    pub(super) fn rotation_by_place(&self) -> [[T; 3]; 3] {
        let o = T::zero();
        [
            [-self.rate * self.sin, o, o],
            [o; 3],
            [self.rate * self.cos, o, o],
        ]
    }

    /// The rate at which the axes turn as they move over the Earth.
    pub(super) fn transport(&self, velocity: [T; 3]) -> [T; 3] {
        multiply(&self.transport_by_velocity(), &velocity)
    }

    /// Its derivative by the velocity.
    pub(super) fn transport_by_velocity(&self) -> [[T; 3]; 3] {
        let (o, one) = (T::zero(), T::one());
        [
            [o, -one / self.normal, o],
            [one / self.meridian, o, o],
            [o, -self.tan / self.normal, o],
        ]
    }

    /// Its derivative by latitude, longitude and height.
    pub(super) fn transport_by_place(&self, velocity: [T; 3]) -> [[T; 3]; 3] {
        let [north, west, _] = velocity;
        let (o, one) = (T::zero(), T::one());
        let (n2, m2) = (self.normal * self.normal, self.meridian * self.meridian);
        let bend = self.normal_by_latitude / n2;
        let tilt = one / (self.cos * self.cos) / self.normal - self.tan * bend;
        [
            [west * bend, o, west / n2],
            [-north * self.meridian_by_latitude / m2, o, -north / m2],
            [-west * tilt, o, west * self.tan / n2],
        ]
    }

    /// D with D arm (m, north, west, up) by what part the velocities north, west and up of a
    /// place that is an arm away exceed those here, for the same rates of latitude, longitude
    /// and height: the higher place goes round a larger circle.
    pub(super) fn faster_beside(&self) -> [[T; 3]; 3] {
        let (o, one, m) = (T::zero(), T::one(), self.meridian);
        let bend = self.normal_by_latitude / self.normal - self.tan;
        [
            [self.meridian_by_latitude / (m * m), o, one / m],
            [bend / m, o, one / self.normal],
            [o; 3],
        ]
    }

    /// The derivative of D arm by latitude, longitude and height.
    pub(super) fn faster_beside_by_place(&self, arm: [T; 3]) -> [[T; 3]; 3] {
        let (o, one, two, three) = (T::zero(), T::one(), T::of(2.0), T::of(3.0));
        let [north, _, up] = arm;
        let (n, m, h) = (self.normal, self.meridian, self.height);
        let (s2, c2) = (self.sin * self.sin, self.cos * self.cos);
        let e2 = T::of(ECCENTRICITY2);
        let w2 = one - e2 * s2;
        // Of the logarithm of the radius across the meridian, and its derivative.
        let slope = e2 * self.sin * self.cos / w2;
        let slope_by_latitude = e2 * ((c2 - s2) * w2 + two * e2 * s2 * c2) / (w2 * w2);
        let m_twice = three * (m - h) * (three * slope * slope + slope_by_latitude);
        let n_twice = (n - h) * (slope * slope + slope_by_latitude);
        let (m_once, first) = (self.meridian_by_latitude, self.normal_by_latitude / n);
        let bend = first - self.tan;
        let bend_by_latitude = n_twice / n - first * first - one / c2;
        [
            [
                (m_twice - two * m_once * m_once / m) * north / (m * m) - m_once * up / (m * m),
                o,
                -two * m_once * north / (m * m * m) - up / (m * m),
            ],
            [
                (bend_by_latitude - bend * m_once / m) * north / m - first * up / n,
                o,
                -(first / n + bend / m) * north / m - up / (n * n),
            ],
            [o; 3],
        ]
    }

    /// The derivative of gravity by latitude, longitude and height.
    pub(super) fn gravity_by_place(&self) -> [T; 3] {
        let (one, two) = (T::one(), T::of(2.0));
        let (s, ds) = (self.sin * self.sin, two * self.sin * self.cos);
        let w2 = one - T::of(ECCENTRICITY2) * s;
        let ground = on_ellipsoid(s);
        let growth =
            T::of(SOMIGLIANA) / (one + T::of(SOMIGLIANA) * s) + T::of(ECCENTRICITY2) / (two * w2);
        let (first, second) = free_air(s);
        let first_by_latitude = T::of(-4.0 * FLATTENING / SEMI_MAJOR) * ds;
        let h = self.height;
        let above = one - first * h + second * (h * h);
        [
            ground * ds * growth * above - ground * first_by_latitude * h,
            T::zero(),
            ground * (two * second * h - first),
        ]
    }

    /// The diagonal of the matrix from metres north, west, up to latitude, longitude and
    /// height, and its derivatives by latitude and by height.
    pub(super) fn place_per_metre(&self) -> [[T; 3]; 3] {
        let (o, one) = (T::zero(), T::one());
        let (n, m) = (self.normal, self.meridian);
        let across = n * self.cos;
        [
            [one / m, -one / across, one],
            [
                -self.meridian_by_latitude / (m * m),
                (self.normal_by_latitude / n - self.tan) / across,
                o,
            ],
            [-one / (m * m), one / (n * across), o],
        ]
    }
}
