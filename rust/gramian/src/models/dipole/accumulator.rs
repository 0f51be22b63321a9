//! The Fisher information of a pass as 42 running sums.

use super::Error;
use crate::numbers::algebra::dot;
use crate::numbers::lane::Lane;
use crate::scalar::{NumberError, Real, all_finite, check_finite, check_positive};

/// Fisher information (9 x 9) of (r0, v, m), sample by sample: no allocation,
/// 42 sums.
///
/// With the Jacobians R by position and M by moment it is made of blocks: sums
/// of `R^T R` times 1, t and t^2, of `R^T M` times 1 and t, and of `M^T M`. Where n
/// points to the dipole, s = n . m and k = mu0 / 4 pi:
///
/// ```text
/// R^T R = (3 k / r^4)^2 (s^2 I - 2 s (n m^T + m n^T) + (|m|^2 + 5 s^2) n n^T + m m^T)
/// R^T M = (3 k^2 / r^7) (-s I - n m^T + 2 m n^T - 4 s n n^T)
/// M^T M = (k / r^3)^2 (3 n n^T + I)
/// ```
///
/// Half the digits of the rows are lost in such sums: take ranks and bounds from
/// the rows ([`Sensors::push_rows`](super::Sensors::push_rows)).
///
/// # Source
/// Dai et al. 2020, eq. (18).
///
/// ```
/// use gramian::dipole::Accumulator;
/// let mut sums = Accumulator::new();
/// for k in 0..21 {
///     let t = f64::from(k);
///     sums.push(t, &[t - 10.0, t - 10.0, 5.0], &[10.0, 20.0, 10.0], 1e18).unwrap();
/// }
/// assert!((sums.matrix()[0][0] / 216.0769084077717 - 1.0).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accumulator<T> {
    pub(super) position: [[T; 6]; 3],
    pub(super) cross: [[T; 9]; 2],
    pub(super) moment: [T; 6],
}

/// Where the six different entries of a symmetric 3 x 3 matrix stand.
pub(crate) const SYMMETRIC: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (1, 0), (2, 0), (2, 1)];

impl<T: Real> Accumulator<T> {
    /// No information.
    pub fn new() -> Self {
        Self::filled(T::zero())
    }

    /// Adds one sample of a vector sensor: the dipole of moment `moment` is at
    /// `position` from it, `time` after the instant of the state. `weight` is
    /// 1 / sigma^2.
    ///
    /// # Errors
    /// [`Error::OnSensor`]; [`Error::Number`] for what is not finite, a weight that is
    /// not positive, or sums that overflow. The sample is not
    /// added then.
    #[inline]
    pub fn push(
        &mut self,
        time: T,
        position: &[T; 3],
        moment: &[T; 3],
        weight: T,
    ) -> Result<(), Error> {
        check_finite("time", &[time])?;
        check_finite("moment", moment)?;
        check_positive("weight", weight)?;
        let mut next = *self;
        next.add(time, position, moment, weight)?;
        *self = next.sound()?;
        Ok(())
    }

    /// The sums if all are finite.
    fn sound(self) -> Result<Self, NumberError> {
        if all_finite(self.position.as_flattened())
            && all_finite(self.cross.as_flattened())
            && all_finite(&self.moment)
        {
            return Ok(self);
        }
        Err(NumberError::Overflow {
            result: "information",
        })
    }

    #[inline]
    fn add(&mut self, time: T, position: &[T; 3], moment: &[T; 3], weight: T) -> Result<(), Error> {
        let (n, inverse) = super::direction(position)?;
        let m = moment;
        let (two, four, five) = (T::of(2.0), T::of(4.0), T::of(5.0));
        let cube = T::of(super::MU0_OVER_4PI) * inverse * inverse * inverse;
        let quartic = T::of(3.0) * cube * inverse;
        let s = dot(&n, m);
        let squared = s * s;
        let radial = dot(m, m) + five * squared;
        let by_position = weight * quartic * quartic;
        let by_both = weight * quartic * cube;
        let by_moment = weight * cube * cube;
        for (e, &(i, j)) in SYMMETRIC.iter().enumerate() {
            let one = if i == j { T::one() } else { T::zero() };
            let nn = n[i] * n[j];
            let value = by_position
                * (squared * one - two * s * (n[i] * m[j] + m[i] * n[j])
                    + radial * nn
                    + m[i] * m[j]);
            self.position[0][e] += value;
            self.position[1][e] += time * value;
            self.position[2][e] += time * time * value;
            self.moment[e] += by_moment * (T::of(3.0) * nn + one);
        }
        for i in 0..3 {
            for j in 0..3 {
                let one = if i == j { T::one() } else { T::zero() };
                let value =
                    by_both * (two * m[i] * n[j] - n[i] * m[j] - s * one - four * s * n[i] * n[j]);
                self.cross[0][3 * i + j] += value;
                self.cross[1][3 * i + j] += time * value;
            }
        }
        Ok(())
    }

    /// Adds the information of independent samples.
    ///
    /// # Errors
    /// [`Error::Number`] where the sums overflow; nothing is
    /// added then.
    pub fn merge(&mut self, other: &Self) -> Result<(), Error> {
        let mut sum = *self;
        let add = |a: &mut [T], b: &[T]| {
            for (x, &y) in a.iter_mut().zip(b) {
                *x += y;
            }
        };
        add(
            sum.position.as_flattened_mut(),
            other.position.as_flattened(),
        );
        add(sum.cross.as_flattened_mut(), other.cross.as_flattened());
        add(&mut sum.moment, &other.moment);
        *self = sum.sound()?;
        Ok(())
    }

    /// The information on (r0, v, m).
    pub fn matrix(&self) -> [[T; 9]; 9] {
        self.spread()
    }
}

impl<L: Lane> Accumulator<L> {
    /// All sums the same.
    #[inline(always)]
    pub(super) fn filled(value: L) -> Self {
        Self {
            position: [[value; 6]; 3],
            cross: [[value; 9]; 2],
            moment: [value; 6],
        }
    }

    /// [`matrix`](Self::matrix) of numbers or of lanes.
    #[inline(always)]
    pub(super) fn spread(&self) -> [[L; 9]; 9] {
        let mut out = [[self.moment[0]; 9]; 9];
        for (e, &(i, j)) in SYMMETRIC.iter().enumerate() {
            for (a, b) in [(i, j), (j, i)] {
                out[a][b] = self.position[0][e];
                out[a][3 + b] = self.position[1][e];
                out[3 + a][b] = self.position[1][e];
                out[3 + a][3 + b] = self.position[2][e];
                out[6 + a][6 + b] = self.moment[e];
            }
        }
        for i in 0..3 {
            for j in 0..3 {
                for (block, cross) in self.cross.iter().enumerate() {
                    out[3 * block + i][6 + j] = cross[3 * i + j];
                    out[6 + j][3 * block + i] = cross[3 * i + j];
                }
            }
        }
        out
    }
}

impl<T: Real> Default for Accumulator<T> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::{Pass, Sensors};
    use super::*;
    use crate::information::Information;

    #[test]
    fn the_sums_are_the_information_of_the_rows() {
        let pass = Pass::of(&[-8.0, 3.0, 2.0, 1.6, -0.1, 0.05, 40.0, -25.0, 80.0]);
        let times: [f64; 41] = core::array::from_fn(|k| 0.25 * k as f64);
        let sensors = [[0.0; 3], [0.3, -0.2, 0.1]];
        let mut rows = Information::<f64, 9>::new();
        Sensors::vector(&sensors)
            .push_rows(&times, &pass, &[1e-9], &mut rows)
            .unwrap();
        let mut sums = Accumulator::new();
        for sensor in &sensors {
            let mut one = Accumulator::new();
            for &t in &times {
                let place = pass.offset(sensor, t);
                one.push(t, &place, &pass.moment, 1e18).unwrap();
            }
            sums.merge(&one).unwrap();
        }
        let (a, b) = (sums.matrix(), rows.matrix());
        for i in 0..9 {
            for j in 0..9 {
                let size = (b[(i, i)] * b[(j, j)]).sqrt();
                assert!((a[i][j] - b[(i, j)]).abs() < 1e-13 * size, "{i} {j}");
            }
        }
    }
}
