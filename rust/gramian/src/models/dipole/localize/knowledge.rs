//! What is known of a pass beforehand, and the set of passes that it leaves.

use nalgebra::{DMatrix, DVector, Matrix3, SymmetricEigen, Vector3};

/// Index of the speed among the eleven quantities, after the nine states.
pub const SPEED: usize = 9;
/// Index of the magnitude of the moment.
pub const MOMENT: usize = 10;

/// Knowledge of the states (r0, v, m), of the speed and of the moment's size.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Knowledge {
    /// Known exactly: nine states, [`SPEED`], [`MOMENT`].
    pub exact: [Option<f64>; 11],
    /// Known to a standard deviation: (mean, sigma) of the same.
    pub prior: [Option<(f64, f64)>; 11],
}

impl Knowledge {
    /// What contradicts itself, if anything.
    ///
    /// # Errors
    /// [`Contradiction`].
    pub fn check(&self) -> Result<(), Contradiction> {
        for (whole, parts) in [(SPEED, 3..6), (MOMENT, 6..9)] {
            let fixed = parts.clone().filter_map(|i| self.exact[i]);
            let (count, squared) = (fixed.clone().count(), fixed.map(|x| x * x).sum::<f64>());
            if let Some(size) = self.exact[whole] {
                let rest = size * size - squared;
                if rest < -1e-9 * size * size || (count == 3 && rest > 1e-9 * size * size) {
                    return Err(Contradiction {
                        quantity: whole,
                        given: size,
                        parts: squared.sqrt(),
                    });
                }
            }
        }
        Ok(())
    }

    /// How many numbers are left to find.
    pub fn unknowns(&self) -> usize {
        9 - self.exact.iter().filter(|x| x.is_some()).count().min(9)
    }

    /// The same without what is known of the moment; `None` where nothing is.
    pub fn without_moment(&self) -> Option<Self> {
        let mut free = *self;
        for i in (6..9).chain([MOMENT]) {
            (free.exact[i], free.prior[i]) = (None, None);
        }
        (free != *self).then_some(free)
    }

    /// Whether (-r0, -v, m) would contradict an exactly known component.
    pub fn excludes_mirror(&self) -> bool {
        self.exact[..6].iter().flatten().any(|&x| x != 0.0)
    }

    /// Indices of the components in `range` that are not known exactly.
    fn free(&self, range: core::ops::Range<usize>) -> impl Iterator<Item = usize> + '_ {
        range.filter(|&i| self.exact[i].is_none())
    }

    /// What is left of a known size for the components of it that are free.
    fn free_size(&self, whole: usize, parts: core::ops::Range<usize>) -> Option<f64> {
        let fixed: f64 = parts.filter_map(|i| self.exact[i]).map(|x| x * x).sum();
        self.exact[whole].map(|size| (size * size - fixed).max(0.0).sqrt())
    }

    /// Moves position and velocity to the nearest that are allowed.
    pub fn project(&self, place: &mut [f64; 6]) {
        for i in 0..6 {
            if let Some(value) = self.exact[i] {
                place[i] = value;
            }
        }
        let Some(size) = self.free_size(SPEED, 3..6) else {
            return;
        };
        let length = self
            .free(3..6)
            .map(|i| place[i] * place[i])
            .sum::<f64>()
            .sqrt();
        let count = self.free(3..6).count().max(1) as f64;
        for i in self.free(3..6) {
            place[i] = if length > 0.0 {
                place[i] * (size / length)
            } else {
                size / count.sqrt()
            };
        }
    }

    /// Directions in which position and velocity may move: up to six columns.
    pub fn tangent(&self, place: &[f64; 6], out: &mut alloc::vec::Vec<[f64; 6]>) {
        out.clear();
        for i in self.free(0..3) {
            out.push(unit(i));
        }
        if self.exact[SPEED].is_none() {
            out.extend(self.free(3..6).map(unit));
            return;
        }
        let mut along = [0.0; 3];
        for i in self.free(3..6) {
            along[i - 3] = place[i];
        }
        let free: [bool; 3] = core::array::from_fn(|i| self.exact[3 + i].is_none());
        for [a, b, c] in across(&along, free) {
            out.push([0.0, 0.0, 0.0, a, b, c]);
        }
    }

    /// Directions in which the moment may move: up to three columns.
    pub fn moment_tangent(&self, moment: &[f64; 3], out: &mut alloc::vec::Vec<[f64; 3]>) {
        out.clear();
        let free: [bool; 3] = core::array::from_fn(|i| self.exact[6 + i].is_none());
        if self.exact[MOMENT].is_none() {
            for i in (0..3).filter(|&i| free[i]) {
                let mut axis = [0.0; 3];
                axis[i] = 1.0;
                out.push(axis);
            }
            return;
        }
        let along = core::array::from_fn(|i| if free[i] { moment[i] } else { 0.0 });
        out.extend(across(&along, free));
    }

    /// The moment of all allowed ones for which |R m - d| is smallest.
    pub fn solve_moment(&self, r: &Matrix3<f64>, d: &Vector3<f64>) -> Vector3<f64> {
        // The iterations of the decompositions below would not end on NaN.
        if !r.iter().chain(d.iter()).all(|x| x.is_finite()) {
            return Vector3::repeat(f64::NAN);
        }
        if self.exact[6..9].iter().all(Option::is_none) && self.exact[MOMENT].is_none() {
            let diagonal = r.diagonal().abs();
            if diagonal.min() > 1e-10 * diagonal.max()
                && let Some(solution) = r.solve_upper_triangular(d)
            {
                return solution;
            }
        }
        let mut moment = Vector3::zeros();
        let mut rest = *d;
        for i in 0..3 {
            if let Some(value) = self.exact[6 + i] {
                moment[i] = value;
                rest -= r.column(i) * value;
            }
        }
        let free: alloc::vec::Vec<usize> = self.free(6..9).map(|i| i - 6).collect();
        if free.is_empty() {
            return moment;
        }
        let a = DMatrix::from_fn(3, free.len(), |i, j| r[(i, free[j])]);
        let solution = match self.free_size(MOMENT, 6..9) {
            None => least_squares(&a, &rest),
            Some(size) => on_sphere(&a, &rest, size),
        };
        for (&i, &value) in free.iter().zip(solution.iter()) {
            moment[i] = value;
        }
        moment
    }
}

/// A known size that the known components of it do not allow.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "known {} = {given} {unit} contradicts its known components, which make {parts} {unit}",
    sized(*.quantity).0, unit = sized(*.quantity).1
)]
pub struct Contradiction {
    /// [`SPEED`] or [`MOMENT`].
    pub quantity: usize,
    /// The size given.
    pub given: f64,
    /// The size of the known components alone.
    pub parts: f64,
}

fn sized(quantity: usize) -> (&'static str, &'static str) {
    match quantity {
        SPEED => ("speed", "m/s"),
        _ => ("moment", "A m^2"),
    }
}

fn unit(i: usize) -> [f64; 6] {
    let mut axis = [0.0; 6];
    axis[i] = 1.0;
    axis
}

/// Unit vectors across `along`, within the free axes.
fn across(along: &[f64; 3], free: [bool; 3]) -> alloc::vec::Vec<[f64; 3]> {
    let mut basis: alloc::vec::Vec<Vector3<f64>> = alloc::vec::Vec::new();
    let first = Vector3::from(*along);
    let wanted = free.iter().filter(|&&x| x).count().saturating_sub(1);
    if first.norm() > 0.0 {
        basis.push(first.normalize());
    } else {
        return alloc::vec::Vec::new();
    }
    // The axes most across come first, so that nothing small is normalised.
    let mut axes: alloc::vec::Vec<usize> = (0..3).filter(|&i| free[i]).collect();
    axes.sort_by(|&i, &j| first[i].abs().total_cmp(&first[j].abs()));
    for i in axes.into_iter().take(wanted) {
        let mut axis = Vector3::zeros();
        axis[i] = 1.0;
        for b in &basis {
            axis -= b * b.dot(&axis);
        }
        basis.push(axis.normalize());
    }
    basis[1..].iter().map(|b| [b[0], b[1], b[2]]).collect()
}

/// Where columns are dependent, the shortest solution.
fn least_squares(a: &DMatrix<f64>, d: &Vector3<f64>) -> DVector<f64> {
    let svd = a.clone().svd(true, true);
    let top = svd.singular_values.max();
    let rhs = DVector::from_column_slice(d.as_slice());
    svd.solve(&rhs, 1e-13 * top)
        .unwrap_or_else(|_| DVector::zeros(a.ncols()))
}

/// min |A m - d| with |m| = size: (A^T A + l) m = A^T d with the multiplier l that
/// gives the size.
fn on_sphere(a: &DMatrix<f64>, d: &Vector3<f64>, size: f64) -> DVector<f64> {
    let rhs = DVector::from_column_slice(d.as_slice());
    let eigen = SymmetricEigen::new(a.transpose() * a);
    let g = eigen.eigenvectors.transpose() * (a.transpose() * rhs);
    let h = &eigen.eigenvalues;
    let lowest = h.imin();
    let top = h.amax().max(f64::MIN_POSITIVE);
    let length = |l: f64| -> f64 {
        (0..h.len())
            .map(|i| (g[i] / (h[i] + l)).powi(2))
            .sum::<f64>()
            .sqrt()
    };
    // The length falls from infinity at l = -h_min; where g has no part in that
    // direction, the direction itself fills up what is missing.
    let mut low = -h[lowest] + 1e-14 * top;
    let mut high = low + 1e-14 * top;
    while length(high) > size && high < 1e30 * top {
        high = -h[lowest] + 4.0 * (high + h[lowest]);
    }
    let short = length(low) < size;
    for _ in 0..200 {
        if short || high - low <= 1e-16 * (high.abs() + low.abs()) {
            break;
        }
        let middle = 0.5 * (low + high);
        if length(middle) > size {
            low = middle;
        } else {
            high = middle;
        }
    }
    let l = if short { low } else { 0.5 * (low + high) };
    let mut m = DVector::from_fn(h.len(), |i, _| g[i] / (h[i] + l));
    if short {
        let rest = size * size - m.norm_squared() + m[lowest] * m[lowest];
        m[lowest] = if m[lowest] < 0.0 { -1.0 } else { 1.0 } * rest.max(0.0).sqrt();
    }
    let m = eigen.eigenvectors * m;
    let norm = m.norm();
    if norm > 0.0 { m * (size / norm) } else { m }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_size_is_kept_and_no_neighbour_is_better() {
        let r = Matrix3::new(2.0, 0.3, -0.5, 0.0, 1.0, 0.2, 0.0, 0.0, 0.1);
        let d = Vector3::new(1.0, -2.0, 0.3);
        for size in [0.1, 1.0, 4.0, 100.0] {
            let mut knowledge = Knowledge::default();
            knowledge.exact[MOMENT] = Some(size);
            let m = knowledge.solve_moment(&r, &d);
            assert!((m.norm() - size).abs() < 1e-12 * size);
            let cost = |m: &Vector3<f64>| (r * m - d).norm_squared();
            for k in 0..60 {
                let angle = f64::from(k);
                let step = Vector3::new(angle.sin(), (2.3 * angle).cos(), (1.7 * angle).sin());
                let other = (m + 0.01 * size * step).normalize() * size;
                assert!(cost(&m) <= cost(&other) * (1.0 + 1e-12));
            }
        }
    }

    #[test]
    fn moves_keep_what_is_known() {
        let mut knowledge = Knowledge::default();
        knowledge.exact[1] = Some(4.0);
        knowledge.exact[5] = Some(0.6);
        knowledge.exact[SPEED] = Some(1.0);
        let mut place = [1.0, 2.0, 3.0, 3.0, 4.0, 5.0];
        knowledge.project(&mut place);
        assert_eq!(place[1], 4.0);
        assert!((place[3] - 0.48).abs() < 1e-15 && (place[4] - 0.64).abs() < 1e-15);
        let mut moves = alloc::vec::Vec::new();
        knowledge.tangent(&place, &mut moves);
        // x0, z0, and a turn of the velocity about z.
        assert_eq!(moves.len(), 3);
        let turn = moves[2];
        assert!((turn[3] * place[3] + turn[4] * place[4]).abs() < 1e-15);
        assert_eq!(turn[5], 0.0);
    }
}
