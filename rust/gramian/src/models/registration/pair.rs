//! Two sensors in the plane, in closed form.
//!
//! The difference of the places where the two reports put the target is free of its
//! position, with Jacobian `H = [u_A, v_A, -u_B, -v_B]` for the biases (range A,
//! azimuth A, range B, azimuth B), u the line of sight and v = r du/dtheta. The
//! two rows of H Sigma^(1/2) span a plane in the four whitened measurements, and
//! that plane is all that one look says. Here it is held by its six Pluecker
//! coordinates, the 2 x 2 minors. All of them come without a trigonometric
//! function, and projector, basis and determinants follow by sums of products
//! of them, without an inverse.

use super::Error;
use crate::numbers::lane::Lane;
#[cfg(any(feature = "alloc", test))]
use crate::scalar::wrapped;
use crate::scalar::{NumberError, Real, check_finite, finite_one, hypot};

/// What one look of two sensors says: a plane of the four whitened biases.
///
/// # Source
/// Zhu, Tang & He 2013, the track-independent model of two sensors (their eq. 1 to 12).
/// That each look is a projector of rank 2 is ours.
///
/// ```
/// use gramian::registration::pair::Plane;
/// let look = Plane::new([20e3, 30e3], [-40e3, 30e3], &[50.0, 1.7e-3], &[50.0, 1.7e-3]).unwrap();
/// let p = look.projector();
/// // Every look carries the same trace.
/// let trace: f64 = (0..4).map(|i| p[i][i]).sum();
/// assert!((trace - 2.0).abs() < 1e-14);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane<T> {
    /// The minors (0,1), (0,2), (0,3), (1,2), (1,3), (2,3) of H Sigma^(1/2).
    minors: [T; 6],
    /// Root of the sum of their squares: sqrt(det R), R = H Sigma H^T.
    size: T,
}

/// Products of two deviations, in the order of the minors.
#[inline(always)]
pub(crate) fn products<L: Lane>([ra, ta]: &[L; 2], [rb, tb]: &[L; 2]) -> [L; 6] {
    [
        *ra * *ta,
        *ra * *rb,
        *ra * *tb,
        *ta * *rb,
        *ta * *tb,
        *rb * *tb,
    ]
}

/// The six minors but for their signs, (-, -, +, -, -, -): from the ranges, and cross and
/// scalar product of the two lines of sight. With those of the offsets instead of unit
/// vectors all are `both` = `r1 r2` times as large, and no division is needed.
#[inline(always)]
pub(crate) fn minor_sizes<L: Lane>(
    scales: &[L; 6],
    [r1, r2]: [L; 2],
    both: L,
    cross: L,
    dot: L,
) -> [L; 6] {
    [
        scales[0] * (r1 * both),
        scales[1] * cross,
        scales[2] * (r2 * dot),
        scales[3] * (r1 * dot),
        scales[4] * r1 * (r2 * cross),
        scales[5] * (r2 * both),
    ]
}

impl<T: Real> Plane<T> {
    /// The plane of a target at offset `a` (east, north) from sensor A and `b`
    /// from sensor B. The deviations are of range (m) and azimuth (rad).
    ///
    /// # Errors
    /// [`Error::OnSensor`] where an offset is zero; [`Error::Sigma`];
    /// [`Error::Number`] for an offset that is not finite, or a product of offsets and
    /// deviations that overflows.
    #[inline]
    pub fn new(a: [T; 2], b: [T; 2], sigma_a: &[T; 2], sigma_b: &[T; 2]) -> Result<Self, Error> {
        let (ra, rb) = (hypot(a[0], a[1]), hypot(b[0], b[1]));
        for (sensor, range) in [ra, rb].into_iter().enumerate() {
            if !(range > T::zero()) {
                check_finite("offset", &[a, b][sensor])?;
                return Err(Error::OnSensor { look: 0, sensor });
            }
        }
        let zero = T::zero();
        let positive = sigma_a[0] > zero && sigma_a[1] > zero;
        if !(positive && sigma_b[0] > zero && sigma_b[1] > zero) {
            return Err(wrong_sigma([sigma_a, sigma_b]));
        }
        let ua = [a[0] / ra, a[1] / ra];
        let ub = [b[0] / rb, b[1] / rb];
        let cross = ua[0] * ub[1] - ua[1] * ub[0];
        let dot = ua[0] * ub[0] + ua[1] * ub[1];
        let scales = products(sigma_a, sigma_b);
        let [m0, m1, m2, m3, m4, m5] = minor_sizes(&scales, [ra, rb], T::one(), cross, dot);
        let minors = [-m0, -m1, m2, -m3, -m4, -m5];
        // By the largest, so that no unit whatever overflows or vanishes.
        let largest = minors.iter().fold(T::zero(), |top, m| top.max(m.abs()));
        let ratio = T::one() / largest;
        let sum = minors.iter().fold(T::zero(), |sum, &m| {
            let m = m * ratio;
            sum + m * m
        });
        let size = largest * sum.sqrt();
        // A minor that is NaN or infinite is in the sum, or is the ratio.
        if size.is_finite() {
            return Ok(Self { minors, size });
        }
        check_finite("offset", &a)?;
        check_finite("offset", &b)?;
        Err(wrong_sigma([sigma_a, sigma_b]))
    }

    /// The antisymmetric matrix of minors over its size: a quarter turn within
    /// the plane, zero across it.
    #[inline]
    fn turn(&self) -> [[T; 4]; 4] {
        let o = T::zero();
        let inverse = T::one() / self.size;
        let [a, b, c, d, e, f] = self.minors.map(|m| m * inverse);
        [[o, a, b, c], [-a, o, d, e], [-b, -d, o, f], [-c, -e, -f, o]]
    }

    /// S H^T R^-1 H S with S = Sigma^(1/2): the orthogonal projector on the plane.
    pub fn projector(&self) -> [[T; 4]; 4] {
        let m = self.turn();
        let mut p = [[T::zero(); 4]; 4];
        for i in 0..4 {
            for j in 0..=i {
                let sum = (0..4).fold(T::zero(), |sum, k| sum + m[i][k] * m[j][k]);
                p[i][j] = sum;
                p[j][i] = sum;
            }
        }
        p
    }

    /// Two orthonormal rows that span the plane: the look's rows on the biases,
    /// each in units of its measurement's deviation.
    pub fn basis(&self) -> [[T; 4]; 2] {
        let m = self.turn();
        let mut best = (T::zero(), 0);
        for (i, row) in m.iter().enumerate() {
            let norm = row.iter().fold(T::zero(), |sum, &x| sum + x * x);
            if norm > best.0 {
                best = (norm, i);
            }
        }
        let inverse = T::one() / best.0.sqrt();
        let first = m[best.1].map(|x| x * inverse);
        let second =
            core::array::from_fn(|i| (0..4).fold(T::zero(), |sum, k| sum + m[i][k] * first[k]));
        [first, second]
    }

    /// `det [H_1; H_2] Sigma^(1/2)`: with unit deviations, the determinant of the
    /// paper. Zero where two looks leave a combination of biases free.
    ///
    /// # Errors
    /// [`Error::Number`] where it overflows.
    ///
    /// # Source
    /// Zhu, Tang & He 2013: the determinant of two looks' rows, the paper's degree.
    pub fn determinant(&self, other: &Self) -> Result<T, Error> {
        Ok(finite_one("determinant", self.product(other))?)
    }

    /// [`determinant`](Self::determinant) without a check.
    #[inline]
    pub(crate) fn product(&self, other: &Self) -> T {
        let [a, b, c, d, e, f] = self.minors;
        let o = other.minors;
        (a * o[5] + f * o[0]) - (b * o[4] + e * o[1]) + (c * o[3] + d * o[2])
    }

    /// The product of the sines of the angles between the two planes, in [0, 1]:
    /// how far the second look has turned from the first.
    ///
    /// # Source
    /// Ours: the paper's determinant over sqrt(det R) of both looks, free of units.
    pub fn pair_degree(&self, other: &Self) -> T {
        let degree = (self.product(other) / self.size / other.size).abs();
        if degree.is_finite() {
            return degree;
        }
        // The product exceeds the numbers, the ratio does not.
        let unit = |plane: &Self| Self {
            minors: plane.minors.map(|m| m / plane.size),
            size: T::one(),
        };
        unit(self).product(&unit(other)).abs()
    }
}

/// The first deviation that is not positive and finite.
#[cold]
fn wrong_sigma<T: Real>(sigma: [&[T; 2]; 2]) -> Error {
    for (sensor, sigma) in sigma.into_iter().enumerate() {
        for (quantity, &value) in sigma.iter().enumerate() {
            if !(value > T::zero() && value.is_finite()) {
                return Error::Sigma {
                    sensor,
                    quantity,
                    given: value.double(),
                };
            }
        }
    }
    NumberError::Overflow { result: "plane" }.into()
}

/// What [`reduce`](super::look::reduce) does, for two sensors in the plane.
#[cfg(any(feature = "alloc", test))]
pub(crate) fn reduce<T: Real>(
    sensors: &[T],
    sigma: &[T],
    biases: &[T],
    target: &[T],
    report: Option<&[T]>,
    lines: &mut [[T; 7]],
) -> Result<T, Error> {
    let o = T::zero();
    let offset = |s: usize| [target[0] - sensors[2 * s], target[1] - sensors[2 * s + 1]];
    let offsets = [offset(0), offset(1)];
    let plane = Plane::new(
        offsets[0],
        offsets[1],
        &[sigma[0], sigma[1]],
        &[sigma[2], sigma[3]],
    )?;
    let weight = [sigma[0], sigma[1], sigma[2], sigma[3]].map(|s| T::one() / s);
    // The whitened derivatives by the position and the whitened residuals.
    let mut g = [[o; 2]; 4];
    let mut e = [o; 4];
    for s in 0..2 {
        let [x, y] = offsets[s];
        let range = hypot(x, y);
        let per = T::one() / range;
        let (ux, uy) = (x * per, y * per);
        g[2 * s] = [ux * weight[2 * s], uy * weight[2 * s]];
        let across = per * weight[2 * s + 1];
        g[2 * s + 1] = [uy * across, -ux * across];
        if let Some(report) = report {
            e[2 * s] = (report[2 * s] - range - biases[2 * s]) * weight[2 * s];
            let turn = report[2 * s + 1] - x.atan2(y) - biases[2 * s + 1];
            e[2 * s + 1] = wrapped(turn) * weight[2 * s + 1];
        }
    }
    let sum = |i: usize, j: usize| (0..4).fold(o, |sum, k| sum + g[k][i] * g[k][j]);
    let first = sum(0, 0).sqrt();
    let across = sum(0, 1) / first;
    let second = (sum(1, 1) - across * across).max(o).sqrt();
    let (per_first, per_second) = (T::one() / first, T::one() / second);
    let mut cost = o;
    lines[0] = [first, across, o, o, o, o, o];
    lines[1] = [o, second, o, o, o, o, o];
    for k in 0..4 {
        let upper = g[k][0] * per_first;
        let lower = (g[k][1] - across * upper) * per_second;
        lines[0][2 + k] = upper * weight[k];
        lines[1][2 + k] = lower * weight[k];
        lines[0][6] += upper * e[k];
        lines[1][6] += lower * e[k];
        cost += e[k] * e[k];
    }
    for (line, row) in lines[2..].iter_mut().zip(plane.basis()) {
        *line = [o; 7];
        for k in 0..4 {
            line[2 + k] = row[k] * weight[k];
            line[6] += row[k] * e[k];
        }
    }
    Ok(cost)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const SIGMA: [f64; 2] = [50.0, 0.1 * core::f64::consts::PI / 180.0];

    fn plane(x: f64, y: f64) -> Plane<f64> {
        Plane::new([x, y], [x - 60e3, y], &SIGMA, &SIGMA).unwrap()
    }

    #[test]
    fn the_projector_is_one() {
        for (x, y) in [(20e3, 30e3), (-5.0, 2e5), (59_999.0, 1.0), (3e4, 1e-3)] {
            let p = plane(x, y).projector();
            let rows = plane(x, y).basis();
            for i in 0..4 {
                for j in 0..4 {
                    let square: f64 = (0..4).map(|k| p[i][k] * p[k][j]).sum();
                    assert!((square - p[i][j]).abs() < 1e-14);
                    let sum = rows[0][i] * rows[0][j] + rows[1][i] * rows[1][j];
                    assert!((sum - p[i][j]).abs() < 1e-14);
                }
            }
        }
    }

    #[test]
    fn the_determinant_is_the_published_formula() {
        let unit = [1.0, 1.0];
        let at = |x: f64, y: f64| Plane::new([x, y], [x - 60e3, y], &unit, &unit).unwrap();
        let (one, two) = ((20e3_f64, 30e3_f64), (45e3_f64, 25e3_f64));
        let polar = |(x, y): (f64, f64)| {
            let (a, b) = (x.atan2(y), (x - 60e3).atan2(y));
            (x.hypot(y), (x - 60e3).hypot(y), a - b)
        };
        let ((a1, b1, g1), (a2, b2, g2)) = (polar(one), polar(two));
        let expected = (a1 * b2 + a2 * b1) * (1.0 - g1.cos() * g2.cos())
            - (a1 * b1 + a2 * b2) * g1.sin() * g2.sin();
        let det = at(one.0, one.1)
            .determinant(&at(two.0, two.1))
            .unwrap()
            .abs();
        assert!((det - 335_105_061.623_85).abs() < 1e-5, "{det}");
        assert!((det - expected.abs()).abs() < 1e-6 * det);
    }

    #[test]
    fn a_target_on_a_sensor_is_refused() {
        let error = Plane::new([60e3, 0.0], [0.0, 0.0], &SIGMA, &SIGMA);
        assert_eq!(error, Err(Error::OnSensor { look: 0, sensor: 1 }));
    }
}
