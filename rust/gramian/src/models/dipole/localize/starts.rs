//! Where to start: the shape of a pass from its field alone.
//!
//! Seen in its own frame (along the way, towards the sensor at the closest
//! point, across both) a pass makes a field that is a sum of three functions,
//! s^k / (1 + s^2)^(5/2) with s = (t - tc) / tau. In any other frame it is nine
//! coefficients times these. So only the time tc of the closest point and the
//! time tau from there to 45 degrees need a search; the coefficients follow by
//! linear least squares, and from them, in closed form, the frame and the moment
//! for a closest distance of 1. The size comes from what is known.
//!
//! # Source
//! The three functions are Anderson's (1949).

use alloc::vec;
use alloc::vec::Vec;

use nalgebra::{Matrix3, Matrix4, Vector3};

use crate::batch::simd::Path;
use crate::dipole::MU0_OVER_4PI;

/// A pass at a closest distance of 1 m from the sensor: position at the first
/// time, velocity.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    pub position: [f64; 3],
    pub velocity: [f64; 3],
    /// For the size that the moment's size or components give; NaN where it is not told.
    pub moment: [f64; 3],
    /// Sum of squares that nine coefficients leave.
    pub misfit: f64,
}

impl Shape {
    /// Of one component alone the frame of the pass is not told: any will do for a start.
    fn of_the_times(tc: f64, tau: f64, misfit: f64) -> Self {
        Self {
            position: [-tc / tau, 1.0, 0.0],
            velocity: [1.0 / tau, 0.0, 0.0],
            moment: [f64::NAN; 3],
            misfit,
        }
    }
}

/// One sensor's samples, averaged to at most some hundred.
pub struct Trace {
    times: Vec<f64>,
    /// Root of the weight, and the weighted field of each axis.
    weights: Vec<f64>,
    field: [Vec<f64>; 3],
    constant: bool,
    components: usize,
}

/// More samples than this are averaged in groups.
pub const MOST: usize = 400;

impl Trace {
    /// `weights` are those of the fit, one for each of the three components, or of the first.
    pub fn new(
        times: &[f64],
        components: usize,
        field: impl Fn(usize, usize) -> f64,
        weights: impl Fn(usize, usize) -> f64,
        constant: bool,
    ) -> Self {
        let group = times.len().div_ceil(MOST);
        // An axis that is not measured at all counts for nothing.
        let used = [0, 1, 2]
            .map(|axis| axis < components && (0..times.len()).any(|k| weights(k, axis) > 0.0));
        let mut trace = Self {
            times: Vec::new(),
            weights: Vec::new(),
            field: [Vec::new(), Vec::new(), Vec::new()],
            constant,
            components,
        };
        for first in (0..times.len()).step_by(group) {
            let range = first..times.len().min(first + group);
            // A sample counts for the least of its weights.
            let weight = |k: usize| {
                let own = (0..3)
                    .filter(|&axis| used[axis])
                    .map(|axis| weights(k, axis));
                let least = own.fold(f64::INFINITY, f64::min);
                if least.is_finite() {
                    least * least
                } else {
                    0.0
                }
            };
            let total: f64 = range.clone().map(weight).sum();
            if !(total > 0.0) {
                continue;
            }
            let mean = |value: &dyn Fn(usize) -> f64| {
                range.clone().map(|k| weight(k) * value(k)).sum::<f64>() / total
            };
            let root = total.sqrt();
            trace.times.push(mean(&|k| times[k]));
            trace.weights.push(root);
            for axis in 0..3 {
                let value = if used[axis] {
                    mean(&|k| field(k, axis))
                } else {
                    0.0
                };
                trace.field[axis].push(root * value);
            }
        }
        trace
    }

    /// The most promising shapes, best first.
    pub fn shapes(&self, wanted: usize) -> Vec<Shape> {
        let (Some(&first), Some(&last)) = (self.times.first(), self.times.last()) else {
            return Vec::new();
        };
        let duration = last - first;
        // Up to four times as long is looked at.
        if !(duration > 0.0 && (4.0 * duration).is_finite()) {
            return Vec::new();
        }
        let spacing = duration / (self.times.len() - 1) as f64;
        let levels = levels(spacing, duration);
        let mut found: Vec<(f64, f64, f64)> = Vec::new();
        for &tau in &levels {
            let step = (0.5 * tau).min(duration / 8.0);
            let beyond = (2.5 * tau).min(1.5 * duration);
            let mut before: Option<[(f64, f64); 2]> = None;
            // By number, as a step may be lost in a time that counts from long ago.
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let steps = ((duration + 2.0 * beyond) / step) as usize;
            for index in 0..=steps {
                let tc = first - beyond + index as f64 * step;
                let misfit = self.misfit(tc, tau);
                // Local minima along the time of the closest point.
                match &mut before {
                    None => before = Some([(f64::INFINITY, tc), (misfit, tc)]),
                    Some([earlier, middle]) => {
                        if middle.0 <= earlier.0 && middle.0 < misfit {
                            found.push((middle.0, middle.1, tau));
                        }
                        *earlier = *middle;
                        *middle = (misfit, tc);
                    }
                }
            }
            if let Some([earlier, middle]) = before
                && middle.0 <= earlier.0
            {
                found.push((middle.0, middle.1, tau));
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Neighbours on the grid lead to the same answer.
        let mut kept: Vec<(f64, f64, f64)> = Vec::new();
        for candidate in found {
            let near = kept.iter().any(|k| {
                (candidate.1 - k.1).abs() < 0.5 * k.2 && (candidate.2 / k.2).ln().abs() < 0.5
            });
            if !near {
                kept.push(candidate);
            }
            if kept.len() == wanted {
                break;
            }
        }
        kept.iter()
            .filter_map(|&(misfit, tc, tau)| {
                let (_, coefficients) = self.fit(tc, tau)?;
                if self.components == 1 {
                    return Some(Shape::of_the_times(tc, tau, misfit));
                }
                shape(&coefficients, tc, tau, misfit)
            })
            .collect()
    }

    fn misfit(&self, tc: f64, tau: f64) -> f64 {
        self.fit(tc, tau)
            .map_or(f64::INFINITY, |(misfit, _)| misfit)
    }

    /// Sum of squares left, and the coefficients (3 axes x 3 functions).
    fn fit(&self, tc: f64, tau: f64) -> Option<(f64, Matrix3<f64>)> {
        let sums = Path::Best.run(Sums {
            trace: self,
            tc,
            tau,
        });
        let size = if self.constant { 4 } else { 3 };
        let mut gram = Matrix4::identity();
        let mut e = 0;
        for i in 0..4 {
            for j in 0..=i {
                if i < size {
                    gram[(i, j)] = sums[e];
                    gram[(j, i)] = sums[e];
                }
                e += 1;
            }
        }
        // Nearly dependent functions (a slow pass) are held by a grain of ridge.
        let scale = gram.diagonal().map(|x| x.max(f64::MIN_POSITIVE).sqrt());
        let scaled = Matrix4::from_fn(|i, j| {
            gram[(i, j)] / (scale[i] * scale[j]) + if i == j { 1e-12 } else { 0.0 }
        });
        let factor = scaled.cholesky()?;
        let mut misfit = 0.0;
        let mut coefficients = Matrix3::zeros();
        for axis in 0..3 {
            let rhs = nalgebra::Vector4::from_fn(|i, _| {
                if i < size {
                    sums[10 + 4 * axis + i] / scale[i]
                } else {
                    0.0
                }
            });
            let x = factor.solve(&rhs);
            misfit += (sums[22 + axis] - x.dot(&rhs)).max(0.0);
            for i in 0..3 {
                coefficients[(axis, i)] = x[i] / scale[i];
            }
        }
        Some((misfit, coefficients))
    }
}

fn levels(spacing: f64, duration: f64) -> Vec<f64> {
    let least = (0.5 * spacing).max(duration / 500.0);
    let mut levels = vec![least.max(f64::MIN_POSITIVE)];
    let mut tau = levels[0];
    while tau < 3.0 * duration {
        tau *= 1.5;
        levels.push(tau);
    }
    levels
}

/// Products of the three functions and a constant (10, lower triangle by rows),
/// of these with the field (3 x 4), squares of the field (3).
struct Sums<'a> {
    trace: &'a Trace,
    tc: f64,
    tau: f64,
}

impl pulp::WithSimd for Sums<'_> {
    type Output = [f64; 25];

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) -> [f64; 25] {
        const LANES: usize = 8;
        let mut sums = [[0.0_f64; LANES]; 25];
        let trace = self.trace;
        let rate = 1.0 / self.tau;
        let count = trace.times.len();
        let mut k = 0;
        while k < count {
            let lanes = LANES.min(count - k);
            let mut t = [0.0; LANES];
            let mut w = [0.0; LANES];
            let mut y = [[0.0; LANES]; 3];
            t[..lanes].copy_from_slice(&trace.times[k..k + lanes]);
            w[..lanes].copy_from_slice(&trace.weights[k..k + lanes]);
            for axis in 0..3 {
                y[axis][..lanes].copy_from_slice(&trace.field[axis][k..k + lanes]);
            }
            let mut f = [[0.0; LANES]; 4];
            for l in 0..LANES {
                let s = (t[l] - self.tc) * rate;
                let inverse = 1.0 / (1.0 + s * s);
                let g = w[l] * inverse * inverse * inverse.sqrt();
                f[0][l] = g;
                f[1][l] = s * g;
                f[2][l] = s * s * g;
                f[3][l] = w[l];
            }
            let mut e = 0;
            for i in 0..4 {
                for j in 0..=i {
                    for l in 0..LANES {
                        sums[e][l] += f[i][l] * f[j][l];
                    }
                    e += 1;
                }
            }
            for axis in 0..3 {
                for i in 0..4 {
                    for l in 0..LANES {
                        sums[10 + 4 * axis + i][l] += f[i][l] * y[axis][l];
                    }
                }
                for l in 0..LANES {
                    sums[22 + axis][l] += y[axis][l] * y[axis][l];
                }
            }
            k += LANES;
        }
        // A map of the array would be a call.
        let mut totals = [0.0; 25];
        for (total, lanes) in totals.iter_mut().zip(&sums) {
            *total = lanes.iter().sum();
        }
        totals
    }
}

/// The pass of closest distance 1 whose coefficients come nearest.
///
/// In its own frame the columns of the coefficients are (-m1, 2 m2, -m3),
/// (3 m2, 3 m1, 0) and (2 m1, -m2, -m3), times mu0 / 4 pi. The second and the
/// difference of the others lie in the plane of the pass; as complex numbers of
/// that plane, turned by phi, their product has the argument 2 phi. So phi is
/// found up to half a turn: the mirror image.
fn shape(c: &Matrix3<f64>, tc: f64, tau: f64, misfit: f64) -> Option<Shape> {
    let (c0, c1, c2) = (c.column(0), c.column(1), c.column(2));
    let difference: Vector3<f64> = (c2 - c0) / 3.0;
    let second: Vector3<f64> = c1 / 3.0;
    let sum: Vector3<f64> = c0 + c2;
    let up = (-second.cross(&difference)).try_normalize(0.0)?;
    let seed = if difference.norm() > second.norm() {
        difference
    } else {
        second.cross(&up)
    };
    let p = (seed - up * up.dot(&seed)).try_normalize(0.0)?;
    let q = up.cross(&p);
    let complex = |x: &Vector3<f64>| nalgebra::Complex::new(x.dot(&p), x.dot(&q));
    let i = nalgebra::Complex::new(0.0, 1.0);
    // e^(i phi) (m1 - i m2), twice; and e^(i phi) (m1 + i m2).
    let d = (complex(&difference) - i * complex(&second)) * 0.5;
    let a = complex(&sum);
    let phi = 0.5 * (a * d).arg();
    let back = nalgebra::Complex::from_polar(1.0, -phi);
    let mu = ((back * a) + (back * d).conj()) * 0.5;
    let along = p * phi.cos() + q * phi.sin();
    let out = q * phi.cos() - p * phi.sin();
    let moment = (along * mu.re + out * mu.im - up * (0.5 * up.dot(&sum))) / MU0_OVER_4PI;
    let start = out - along * (tc / tau);
    Some(Shape {
        position: start.into(),
        velocity: (along / tau).into(),
        moment: moment.into(),
        misfit,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::dipole::field;

    fn trace(position: [f64; 3], velocity: [f64; 3], moment: [f64; 3]) -> Trace {
        let times: Vec<f64> = (0..61).map(|k| 0.3 * f64::from(k)).collect();
        let samples: Vec<[f64; 3]> = times
            .iter()
            .map(|t| {
                let place = core::array::from_fn(|i| position[i] + t * velocity[i]);
                field(&place, &moment).unwrap()
            })
            .collect();
        Trace::new(&times, 3, |k, i| samples[k][i], |_, _| 1.0, false)
    }

    #[test]
    fn the_coefficients_of_a_pass_give_its_frame_and_moment() {
        // Closest, 1 m away, at 9 s.
        let velocity = [0.6, -0.3, 0.1];
        let out = Vector3::from(velocity)
            .cross(&Vector3::new(1.0, 2.0, 5.0))
            .normalize();
        let start: [f64; 3] = core::array::from_fn(|i| out[i] - 9.0 * velocity[i]);
        let moment = [3.0, -2.0, 7.0];
        let trace = trace(start, velocity, moment);
        let tau = 1.0 / Vector3::from(velocity).norm();
        let (misfit, coefficients) = trace.fit(9.0, tau).unwrap();
        let found = shape(&coefficients, 9.0, tau, misfit).unwrap();
        let size: f64 = trace.field.iter().flatten().map(|y| y * y).sum();
        assert!(misfit < 1e-10 * size);
        let side = if found.velocity[0] > 0.0 { 1.0 } else { -1.0 };
        for i in 0..3 {
            assert!((side * found.position[i] - start[i]).abs() < 1e-6);
            assert!((side * found.velocity[i] - velocity[i]).abs() < 1e-6);
            assert!((found.moment[i] - moment[i]).abs() < 1e-6);
        }
    }

    #[test]
    fn every_path_makes_the_same_sums() {
        let trace = trace([-6.0, 2.0, 1.0], [0.7, 0.1, 0.0], [3.0, -2.0, 7.0]);
        let sums = |path: Path| {
            path.run(Sums {
                trace: &trace,
                tc: 8.0,
                tau: 2.5,
            })
        };
        let wanted = sums(Path::Plain);
        for path in Path::available() {
            for (a, b) in sums(path).iter().zip(&wanted) {
                assert!((a - b).abs() <= 1e-13 * b.abs().max(1e-12));
            }
        }
    }
}
