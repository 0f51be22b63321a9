//! A moving magnetic dipole and the sensors that feel it.
//!
//! A dipole of constant moment m passes at constant velocity: it is at
//! r(t) = r0 + t v. A sensor at s measures the field of the dipole there, three
//! components or the total field. The state is (r0, v, m): metres, metres per
//! second, A m^2, nine numbers.
//!
//! One sensor alone never determines them: the field at the origin is the same
//! for (u r0, u v, u^3 m) with any u > 0, so (r0, v, 3 m) is a null vector of the
//! rows of every pass. It is also the same for the mirror image (-r0, -v, m),
//! which no information matrix can show. A negative u is no ambiguity: it turns
//! the sign of the field. A sensor of the total field alone cannot see a turn of
//! the whole pass about the ambient field either, a second null vector.
//!
//! # Source
//! Dai, Zhou & Shan 2020: field (2), moment (3)-(4), Jacobians (19)-(21), whose
//! factor mu0 / 4 pi the print drops; the scale family (28), printed there for
//! all u != 0.

mod accumulator;
#[cfg(feature = "std")]
pub mod batch;
#[cfg(feature = "std")]
pub mod description;
#[cfg(feature = "std")]
pub mod localize;
#[cfg(feature = "std")]
pub mod measured;
pub mod quadrupole;
#[cfg(feature = "std")]
pub mod record;
pub mod sensors;
pub mod tracker;

pub use accumulator::Accumulator;
pub use sensors::Sensors;

use crate::numbers::algebra::dot;
use crate::numbers::lane::Lane;
use crate::scalar::{NumberError, Real, all_finite, check_finite, finite};

/// The magnetic constant over 4 pi, in H/m: 1e-7 to nine digits (CODATA 2018
/// gives 1.00000000055e-7).
#[doc(alias = "mu0")]
pub const MU0_OVER_4PI: f64 = 1e-7;

/// The field at the sensor of a dipole at `position` from it, in tesla.
///
/// # Units
/// m, A m^2, T.
///
/// # Errors
/// [`Error::OnSensor`] where the dipole is on the sensor; [`Error::Number`] for what
/// is not finite, or a distance or field that overflows.
///
/// # Source
/// Dai et al. 2020, eq. (2).
///
/// ```
/// // On its axis, at 2 m, a dipole of 4 A m^2 makes 2e-7 * 4 / 8 T.
/// let h = gramian::dipole::field(&[2.0, 0.0, 0.0], &[4.0, 0.0, 0.0]).unwrap();
/// assert!((h[0] - 1e-7_f64).abs() < 1e-21);
/// ```
#[doc(alias = "h")]
#[inline]
pub fn field<T: Real>(position: &[T; 3], moment: &[T; 3]) -> Result<[T; 3], Error> {
    let (n, inverse) = direction(position)?;
    let three = T::of(3.0);
    let factor = T::of(MU0_OVER_4PI) * inverse * inverse * inverse;
    let along = three * dot(&n, moment);
    let field = [0, 1, 2].map(|i| factor * (along * n[i] - moment[i]));
    if all_finite(&field) {
        return Ok(field);
    }
    check_finite("moment", moment)?;
    Err(NumberError::Overflow { result: "field" }.into())
}

/// The derivatives of the field, both symmetric.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jacobian<T> {
    /// By the position of the dipole, in T/m.
    #[doc(alias = "J_r")]
    pub position: [[T; 3]; 3],
    /// By its moment, in T/(A m^2).
    #[doc(alias = "J_m")]
    pub moment: [[T; 3]; 3],
}

/// The derivatives of [`field`] by position and moment.
///
/// # Errors
/// As [`field`].
///
/// # Source
/// Dai et al. 2020, eqs. (20)-(21), times mu0 / 4 pi.
///
/// ```
/// let j = gramian::dipole::jacobian(&[1.0_f64, -2.0, 0.5], &[3.0, 1.0, 2.0]).unwrap();
/// // The field falls with the cube of the distance: J_r r = -3 h.
/// let h = gramian::dipole::field(&[1.0, -2.0, 0.5], &[3.0, 1.0, 2.0]).unwrap();
/// let radial = j.position[0][0] - 2.0 * j.position[0][1] + 0.5 * j.position[0][2];
/// assert!((radial + 3.0 * h[0]).abs() < 1e-21);
/// ```
#[inline]
pub fn jacobian<T: Real>(position: &[T; 3], moment: &[T; 3]) -> Result<Jacobian<T>, Error> {
    let (n, inverse) = direction(position)?;
    let cube = T::of(MU0_OVER_4PI) * inverse * inverse * inverse;
    let quartic = T::of(3.0) * cube * inverse;
    let along = dot(&n, moment);
    let mut out = Jacobian {
        position: [[T::zero(); 3]; 3],
        moment: [[T::zero(); 3]; 3],
    };
    for i in 0..3 {
        for j in 0..=i {
            let by_position = quartic * position_tensor(&n, moment, along, i, j);
            let by_moment = cube * moment_tensor(&n, i, j);
            out.position[i][j] = by_position;
            out.position[j][i] = by_position;
            out.moment[i][j] = by_moment;
            out.moment[j][i] = by_moment;
        }
    }
    if all_finite(out.position.as_flattened()) {
        return Ok(out);
    }
    check_finite("moment", moment)?;
    Err(NumberError::Overflow { result: "jacobian" }.into())
}

/// The moment in the sensor's frame of a body with a permanent moment and one
/// that the Earth's field induces: `R m_h + (V / mu0) h0`.
///
/// `attitude` takes the body's frame to the sensor's; `induced_volume` is the
/// body's volume times its effective susceptibility, in m^3; `earth_field` is in
/// tesla in the sensor's frame.
///
/// # Errors
/// [`Error::Number`].
///
/// # Source
/// Dai et al. 2020, eqs. (3)-(4).
#[doc(alias = "m_h")]
pub fn moment<T: Real>(
    permanent: &[T; 3],
    attitude: &[[T; 3]; 3],
    induced_volume: T,
    earth_field: &[T; 3],
) -> Result<[T; 3], Error> {
    check_finite("permanent", permanent)?;
    check_finite("attitude", attitude.as_flattened())?;
    check_finite("induced_volume", &[induced_volume])?;
    check_finite("earth_field", earth_field)?;
    let mu0 = T::of(4.0 * MU0_OVER_4PI) * T::pi();
    let moment =
        [0, 1, 2].map(|i| dot(&attitude[i], permanent) + induced_volume / mu0 * earth_field[i]);
    Ok(finite("moment", moment)?)
}

/// A dipole that passes at constant velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pass<T> {
    /// Where it is at the first time, m.
    #[doc(alias = "r0")]
    pub position: [T; 3],
    /// m/s.
    pub velocity: [T; 3],
    /// A m^2.
    pub moment: [T; 3],
}

impl<T: Real> Pass<T> {
    /// The pass of a state (r0, v, m).
    #[inline]
    pub fn of(state: &[T; 9]) -> Self {
        let [a, b, c, d, e, f, g, h, i] = *state;
        Self {
            position: [a, b, c],
            velocity: [d, e, f],
            moment: [g, h, i],
        }
    }

    /// The state (r0, v, m).
    pub fn state(&self) -> [T; 9] {
        let ([a, b, c], [d, e, f], [g, h, i]) = (self.position, self.velocity, self.moment);
        [a, b, c, d, e, f, g, h, i]
    }

    /// Where the dipole is after `time`, seen from `sensor`.
    ///
    /// # Errors
    /// [`Error::Number`].
    pub fn seen_from(&self, sensor: &[T; 3], time: T) -> Result<[T; 3], Error> {
        check_finite("position", &self.position)?;
        check_finite("velocity", &self.velocity)?;
        check_finite("sensor", sensor)?;
        check_finite("time", &[time])?;
        Ok(finite("position", self.offset(sensor, time))?)
    }

    /// [`seen_from`](Self::seen_from) without a check.
    #[inline]
    pub(crate) fn offset(&self, sensor: &[T; 3], time: T) -> [T; 3] {
        [0, 1, 2].map(|i| self.position[i] + time * self.velocity[i] - sensor[i])
    }

    /// The pass of another size that one vector sensor at the origin cannot tell
    /// from this one: (u r0, u v, u^3 m). The fields agree for `u` > 0.
    ///
    /// # Errors
    /// [`Error::Number`].
    ///
    /// # Source
    /// Dai et al. 2020, eq. (28), which holds for `u` > 0 only: below, the field changes sign.
    pub fn scaled(&self, u: T) -> Result<Self, Error> {
        check_finite("u", &[u])?;
        check_finite("pass", &self.state())?;
        let scaled = Self {
            position: self.position.map(|x| u * x),
            velocity: self.velocity.map(|x| u * x),
            moment: self.moment.map(|x| u * (u * (u * x))),
        };
        Ok(Self::of(&finite("pass", scaled.state())?))
    }

    /// The mirror image (-r0, -v, m), whose field at the origin is the same. Signs
    /// change, nothing is computed.
    ///
    /// # Source
    /// Ours: an ambiguity that no Fisher matrix shows, beside that of Dai et al. 2020, eq. (28).
    #[must_use]
    pub fn mirrored(&self) -> Self {
        Self {
            position: self.position.map(|x| -x),
            velocity: self.velocity.map(|x| -x),
            moment: self.moment,
        }
    }
}

/// Unit vector towards `position` and the inverse of its length.
#[inline]
fn direction<T: Real>(position: &[T; 3]) -> Result<([T; 3], T), Error> {
    let inverse = T::one() / dot(position, position).sqrt();
    if !(inverse > T::zero()) {
        check_finite("position", position)?;
        return Err(NumberError::Overflow { result: "distance" }.into());
    }
    // The derivatives fall with the fourth power: so close that this overflows is
    // on the sensor.
    let fourth = inverse * inverse * inverse * inverse;
    if !fourth.is_finite() {
        return Err(Error::OnSensor { index: 0 });
    }
    Ok((position.map(|x| x * inverse), inverse))
}

/// The field's derivative by the moment times r^3, 3 n n^T - 1, with `n` the unit vector
/// to the dipole.
#[inline(always)]
pub(crate) fn moment_tensor<L: Lane>(n: &[L; 3], i: usize, j: usize) -> L {
    let product = n[i].times(3.0) * n[j];
    if i == j {
        product - product.splat(1.0)
    } else {
        product
    }
}

/// The field's derivative by the position times r^4 / 3: n m^T + m n^T + (n . m) (1 - 5 n
/// n^T), with `along` = n . m.
#[inline(always)]
pub(crate) fn position_tensor<L: Lane>(n: &[L; 3], m: &[L; 3], along: L, i: usize, j: usize) -> L {
    let mixed = n[i].mul_add(m[j], m[i] * n[j]);
    let mixed = if i == j { along + mixed } else { mixed };
    (along.times(5.0) * n[i]).negate_mul_add(n[j], mixed)
}

/// What can be wrong with the input of this module.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// The dipole is on the sensor: no field exists.
    #[error(
        "sample {index}: the dipole is on the sensor, where its field is infinite; the distance \
         must be > 0"
    )]
    OnSensor {
        /// Which sample.
        index: usize,
    },
    /// A standard deviation that is not positive.
    #[error("sigma[{index}] = {given} T: must be > 0")]
    Sigma {
        /// Which.
        index: usize,
        /// The value given.
        given: f64,
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
            Self::OnSensor { index } | Self::Sigma { index, .. } => *index = sample,
            Self::Number(error) => *error = error.at(sample),
        }
        self
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::numbers::algebra::multiply;
    use crate::square_root::SquareRootInformation;
    use proptest::prelude::*;

    const SENSOR: Sensors<'_> = Sensors {
        places: &[[0.0; 3]],
        baselines: &[],
        ambient: None,
    };

    fn vector(size: f64) -> impl Strategy<Value = [f64; 3]> {
        [-size..size, -size..size, -size..size]
    }

    proptest! {
        #[test]
        fn the_jacobian_is_the_derivative(r in vector(20.0), m in vector(100.0)) {
            let size = dot(&r, &r).sqrt();
            prop_assume!(size > 0.5 && dot(&m, &m) > 1.0);
            let j = jacobian(&r, &m).unwrap();
            let step = 1e-4 * size;
            for k in 0..3 {
                let difference = |h: f64| {
                    let (mut up, mut down) = (r, r);
                    up[k] += h;
                    down[k] -= h;
                    let (a, b) = (field(&up, &m).unwrap(), field(&down, &m).unwrap());
                    [0, 1, 2].map(|i| (a[i] - b[i]) / (2.0 * h))
                };
                let (wide, narrow) = (difference(2.0 * step), difference(step));
                let norm = j.position.as_flattened().iter().fold(0.0_f64, |n, x| n.max(x.abs()));
                for i in 0..3 {
                    let fourth_order = (4.0 * narrow[i] - wide[i]) / 3.0;
                    prop_assert!((fourth_order - j.position[i][k]).abs() < 1e-8 * norm);
                }
            }
            // The field is linear in the moment.
            let (h, linear) = (field(&r, &m).unwrap(), multiply(&j.moment, &m));
            for i in 0..3 {
                prop_assert!((h[i] - linear[i]).abs() < 1e-14 * dot(&h, &h).sqrt());
            }
        }

        #[test]
        fn the_null_vector_is_r_v_and_three_m(
            r in vector(20.0), v in vector(3.0), m in vector(100.0)
        ) {
            let pass = Pass { position: r, velocity: v, moment: m };
            let times: [f64; 21] = core::array::from_fn(|k| k as f64);
            prop_assume!(times.iter().all(|&t| {
                let p = pass.offset(&[0.0; 3], t);
                dot(&p, &p) > 1e-4
            }));
            let mut rows = alloc::vec::Vec::<[f64; 9]>::new();
            SENSOR.push_rows(&times, &pass, &[1e-9], &mut rows).unwrap();
            let mut null = pass.state();
            for x in &mut null[6..] {
                *x *= 3.0;
            }
            for row in &rows {
                let (mut sum, mut size) = (0.0_f64, 0.0_f64);
                for i in 0..9 {
                    sum += row[i] * null[i];
                    size += (row[i] * null[i]).abs();
                }
                prop_assert!(sum.abs() <= 1e-14 * size);
            }
        }
    }

    #[test]
    fn the_family_and_the_mirror_have_the_same_field_and_minus_u_the_opposite_one() {
        let pass = Pass::of(&[-10.0, -10.0, 5.0, 1.0, 1.0, 0.2, 10.0, 20.0, 10.0]);
        let times: [f64; 21] = core::array::from_fn(|k| k as f64);
        let fields = |pass: &Pass<f64>| {
            let mut out = [0.0; 63];
            SENSOR.measure(&times, pass, &mut out).unwrap();
            out
        };
        let here = fields(&pass);
        for (other, sign) in [
            (pass.scaled(2.5).unwrap(), 1.0),
            (pass.mirrored(), 1.0),
            (pass.scaled(-2.5).unwrap(), -1.0),
        ] {
            for (a, b) in here.iter().zip(fields(&other)) {
                assert!((a - sign * b).abs() < 1e-14 * here[31].abs().max(a.abs()));
            }
        }
    }

    #[test]
    fn a_total_field_sensor_alone_cannot_see_a_turn_about_the_ambient_field_either() {
        let pass = Pass::of(&[-10.0, -7.0, 5.0, 1.0, 1.0, 0.1, 10.0, 20.0, 10.0]);
        let times: [f64; 30] = core::array::from_fn(|k| 0.7 * k as f64);
        let ambient = [2e-5, 0.0, 4.5e-5];
        let mut rows = alloc::vec::Vec::<[f64; 9]>::new();
        let sensor = Sensors {
            ambient: Some(ambient),
            ..SENSOR
        };
        sensor.push_rows(&times, &pass, &[1e-9], &mut rows).unwrap();
        let mut root = SquareRootInformation::new();
        let turned = |x: &[f64; 3]| {
            let b = ambient;
            [
                b[1] * x[2] - b[2] * x[1],
                b[2] * x[0] - b[0] * x[2],
                b[0] * x[1] - b[1] * x[0],
            ]
        };
        let turn = Pass {
            position: turned(&pass.position),
            velocity: turned(&pass.velocity),
            moment: turned(&pass.moment),
        };
        let (scale, turn) = (pass.state(), turn.state());
        for row in &rows {
            root.push(row).unwrap();
            for (null, three) in [(scale, 3.0), (turn, 1.0)] {
                let terms: [f64; 9] =
                    core::array::from_fn(|i| row[i] * null[i] * if i < 6 { 1.0 } else { three });
                let size: f64 = terms.iter().map(|x| x.abs()).sum();
                assert!(terms.iter().sum::<f64>().abs() < 1e-13 * size);
            }
        }
        assert_eq!(crate::spectrum::Spectrum::new(&root).rank(), 7);
    }

    #[test]
    fn a_dipole_on_the_sensor_is_an_error_with_its_sample() {
        let pass = Pass::of(&[-2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 2.0, 3.0]);
        let times = [0.0, 1.0, 2.0, 3.0];
        let mut out = [0.0; 12];
        let given = SENSOR.measure(&times, &pass, &mut out);
        assert_eq!(given, Err(Error::OnSensor { index: 2 }));
        assert!(field(&[1e-90_f64, 0.0, 0.0], &[1.0; 3]).is_err());
        assert!(field(&[f64::NAN, 0.0, 0.0], &[1.0; 3]).is_err());
    }

    #[test]
    fn induced_magnetisation_follows_the_earth_field() {
        let turn = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        let m = moment(
            &[2.0, 0.0, 1.0],
            &turn,
            0.5,
            &[0.0, 0.0, 4e-7 * core::f64::consts::PI],
        )
        .unwrap();
        for (given, wanted) in m.iter().zip([0.0, 2.0, 1.5]) {
            assert!((given - wanted).abs() < 1e-12);
        }
    }
}
