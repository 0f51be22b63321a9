//! Whether a state is shown at all: decided on the pencil [A - z I; C].
//!
//! The ladder of derivatives says *when* a combination becomes known; whether it ever
//! does, that ladder loses in rounding after some ten steps. (A, C) is unobservable iff
//! [A - z I; C] loses rank for some z. The smallest singular value of that pencil over
//! all complex z is the distance to the nearest unobservable pair, backward stable and
//! cheap: one Schur form, then O(n^2) for each z.
//!
//! The unobservable subspace is found by deflation: a direction v with (A - z I) v = 0
//! and C v = 0, but for rounding, is split off by an orthogonal change of the states, and
//! the rest is asked again. Each step is a change of A and C by that singular value, so
//! their number is the nullity of a system within rounding of the one given.
//!
//! # Source
//! Hautus 1969 (the test); Eising 1984, Between controllable and uncontrollable, Systems
//! and Control Letters 4 (the distance). The certificate is a cover by discs: the smallest
//! singular value changes by no more than z does.
//!
//! ```
//! use gramian::linear::pencil::Pencil;
//! // Two states decay alike and only their sum is measured.
//! let pencil = Pencil::new(&[-1.0, 0.0, 0.0, -1.0], &[1.0, 1.0], 2)?;
//! assert!(pencil.distance().distance < 1e-15);
//! assert_eq!(pencil.unobservable(None)?.dimension(), 1);
//! # Ok::<(), gramian::linear::pencil::Error>(())
//! ```

use alloc::collections::BinaryHeap;
use alloc::vec;
use alloc::vec::Vec;
use core::cmp::Ordering;

use super::schur::{C64, Matrix, NoConvergence, Rotation, Schur, abs, root, rotate};
use crate::scalar::{NumberError, check_finite, check_length};

/// What can be wrong with a pencil.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A number that is not finite, or too large to go on with.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// The eigenvalues were not found.
    #[error("the iteration for the eigenvalues of A did not converge: scale A")]
    NoConvergence,
}

impl From<NoConvergence> for Error {
    fn from(_: NoConvergence) -> Self {
        Self::NoConvergence
    }
}

/// Where a pencil comes nearest to losing rank.
#[derive(Clone, Debug, PartialEq)]
pub struct Distance {
    /// The smallest singular value of [A - z I; C] found, over all z.
    pub distance: f64,
    /// Real and imaginary part of the z where it is attained.
    pub z: [f64; 2],
    /// The state direction that is nearly not shown there: real and imaginary parts.
    pub direction: Vec<[f64; 2]>,
    /// How often the singular value was found.
    pub evaluations: usize,
}

/// A lower bound of the distance, proved.
#[derive(Clone, Debug, PartialEq)]
pub struct Certificate {
    /// The smallest value found.
    pub found: Distance,
    /// No pair nearer than this is unobservable.
    pub at_least: f64,
    /// Whether that reached what was asked for.
    pub complete: bool,
}

/// One cluster of eigenvalues that no output shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Real and imaginary part (not negative) of their mean.
    pub eigenvalue: [f64; 2],
    /// How wrong that may be by rounding.
    pub error: f64,
    /// Dimension of the real subspace: both members of a complex pair count.
    pub dimension: usize,
    /// Orthonormal basis of it, `dimension` rows.
    pub basis: Vec<f64>,
}

/// The largest A-invariant subspace in the kernel of C.
#[derive(Clone, Debug, PartialEq)]
pub struct Unobservable {
    /// Orthonormal rows that span it.
    pub kernel: Vec<f64>,
    /// Orthonormal rows that span its complement: the combinations that are determined.
    pub row_space: Vec<f64>,
    /// The largest singular value that counted as zero, over the norm of the pencil.
    pub rejected: f64,
    /// The smallest that did not, over the norm; infinite where none is left.
    pub weakest: f64,
    /// What was decided with, over the norm.
    pub rtol: f64,
    /// Whether a singular value was so near to the tolerance that another one would have
    /// found another dimension; this one is then the most it may be.
    pub undecided: bool,
    states: usize,
}

impl Unobservable {
    /// How many combinations no output shows.
    pub fn dimension(&self) -> usize {
        self.kernel.len() / self.states.max(1)
    }

    /// A component of a basis vector below this is rounding.
    pub(super) fn touch(&self) -> f64 {
        (4.0 * self.rtol / self.weakest.min(1.0)).clamp(4.0 * f64::EPSILON, 1e-2)
    }
}

/// A system in Schur coordinates.
#[derive(Clone, Debug)]
pub struct Pencil {
    form: Schur,
    /// C times the Schur vectors.
    c: Matrix,
    norm: f64,
    symmetric_part: Vec<f64>,
    skew_part: Vec<f64>,
    /// What A and C were divided by, a power of two: their squares are numbers then.
    unit: f64,
}

/// The smallest singular value at a point.
#[derive(Clone, Debug)]
struct Point {
    z: C64,
    sigma: f64,
    v: Vec<C64>,
    /// v^H (A - z) v: down the slope of sigma^2.
    slope: C64,
}

/// Scratch for points.
#[derive(Debug, Default)]
struct Space {
    r: Matrix,
    x_re: Vec<f64>,
    x_im: Vec<f64>,
    v_re: Vec<f64>,
    v_im: Vec<f64>,
    evaluations: usize,
}

impl Pencil {
    /// A (n x n) and C (p x n), row-major, in the scaling in which distances are meant.
    ///
    /// # Errors
    /// [`Error::Number`] for lengths that do not fit and numbers that are not finite or
    /// whose squares are not; [`Error::NoConvergence`].
    pub fn new(a: &[f64], c: &[f64], n: usize) -> Result<Self, Error> {
        let p = c.len().checked_div(n).unwrap_or(0);
        check_length("states", n, n.max(1))?;
        check_length("A", a.len(), n.saturating_mul(n))?;
        check_length("C", c.len(), p.saturating_mul(n))?;
        check_finite("A", a)?;
        check_finite("C", c)?;
        let largest = a.iter().chain(c).fold(0.0_f64, |top, x| top.max(x.abs()));
        let unit = power_of_two_near(largest);
        let scaled = |x: &[f64]| x.iter().map(|x| x / unit).collect::<Vec<f64>>();
        let (a, c) = (scaled(a), scaled(c));
        let norm = root(a.iter().chain(&c).map(|x| x * x).sum());
        if !(norm * unit).is_finite() {
            return Err(NumberError::Overflow {
                result: "norm of A and C",
            }
            .into());
        }
        let form = Schur::new(&a, n)?;
        let seen = compressed(&c, n);
        let c = product_with_vectors(&seen, &form.vectors);
        let part = |sign: f64| {
            (0..n * n)
                .map(|k| 0.5 * (a[k] + sign * a[k % n * n + k / n]))
                .collect()
        };
        let (symmetric_part, skew_part) = (part(1.0), part(-1.0));
        Ok(Self {
            form,
            c,
            norm,
            symmetric_part,
            skew_part,
            unit,
        })
    }

    /// The Frobenius norm of [A; C].
    pub fn norm(&self) -> f64 {
        self.norm * self.unit
    }

    /// Eigenvalues of A, real and imaginary parts.
    pub fn eigenvalues(&self) -> Vec<[f64; 2]> {
        (0..self.form.n())
            .map(|i| self.form.eigenvalue(i) * self.unit)
            .map(|z| [z.re, z.im])
            .collect()
    }

    /// The smallest singular value of [A - z I; C].
    pub fn sigma(&self, z: [f64; 2]) -> f64 {
        let mut space = Space::default();
        let z = C64::new(z[0] / self.unit, z[1] / self.unit);
        self.at(z, &mut space).sigma * self.unit
    }

    fn at(&self, z: C64, space: &mut Space) -> Point {
        point(
            &self.form.t,
            &self.c,
            self.form.n(),
            z,
            self.norm,
            40,
            space,
        )
    }

    /// The distance to the nearest unobservable pair, by descent from the eigenvalues of
    /// A and of its symmetric part and from a coarse grid. A local search: it finds an
    /// upper bound, in practice the distance; see [`certify`](Self::certify).
    pub fn distance(&self) -> Distance {
        let mut space = Space::default();
        let best = self.search(&mut space);
        self.report(&best, &space)
    }

    fn report(&self, best: &Point, space: &Space) -> Distance {
        let n = self.form.n();
        let mut direction = vec![C64::default(); n];
        for (k, &factor) in best.v.iter().enumerate() {
            for (i, x) in direction.iter_mut().enumerate() {
                *x += factor * self.form.vectors.get(k, i);
            }
        }
        Distance {
            distance: best.sigma * self.unit,
            z: [best.z.re * self.unit, best.z.im * self.unit],
            direction: direction.iter().map(|z| [z.re, z.im]).collect(),
            evaluations: space.evaluations,
        }
    }

    fn search(&self, space: &mut Space) -> Point {
        let n = self.form.n();
        if self.norm == 0.0 {
            // Nothing is seen, and every state is an eigenvector.
            let mut v = vec![C64::default(); n];
            v[0] = C64::new(1.0, 0.0);
            let (z, slope) = (C64::default(), C64::default());
            return Point {
                z,
                sigma: 0.0,
                v,
                slope,
            };
        }
        let mut starts: Vec<C64> = (0..n).map(|i| self.form.eigenvalue(i)).collect();
        if let Ok(symmetric) = Schur::new(&self.symmetric_part, n) {
            starts.extend((0..n).map(|i| symmetric.eigenvalue(i)));
        }
        let (mut low, mut high, mut top) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64);
        for z in &starts {
            (low, high) = (low.min(z.re), high.max(z.re));
            top = top.max(z.im.abs());
        }
        // The box around the field of values: that of a matrix far from normal reaches
        // far beyond its eigenvalues, and the nearest point may be there.
        if let Ok(skew) = Schur::new(&self.skew_part, n) {
            top = (0..n).fold(top, |top, i| top.max(skew.eigenvalue(i).im.abs()));
        }
        // The distance is the same at conjugate points: the upper half will do. A real
        // eigenvalue is above or below by its rounding.
        starts.retain(|z| z.im >= -1e-9 * self.norm);
        for z in &mut starts {
            z.im = z.im.abs();
        }
        for i in 0..10 {
            for j in 0..8 {
                let x = low + (high - low) * (f64::from(i) + 0.5) / 10.0;
                starts.push(C64::new(x, top * f64::from(j) / 7.0));
            }
        }
        let mut points: Vec<Point> = starts
            .into_iter()
            .map(|z| point(&self.form.t, &self.c, n, z, self.norm, 6, space))
            .collect();
        points.sort_by(|a, b| a.sigma.total_cmp(&b.sigma));
        let mut best = points[0].clone();
        for start in points.into_iter().take(24) {
            if best.sigma <= f64::EPSILON * self.norm {
                break;
            }
            let found = self.descend(start, 0.0, space);
            if found.sigma < best.sigma {
                best = found;
            }
        }
        best
    }

    /// Down to a local minimum by a quasi-Newton search in the plane. `enough`: stop
    /// where the value is below it, or where it is plain that it will not come there.
    fn descend(&self, start: Point, enough: f64, space: &mut Space) -> Point {
        let at = |z: C64, space: &mut Space| self.at(z, space);
        descend(start, enough, self.norm, at, space)
    }

    /// Proves that no unobservable pair is nearer than (1 - `slack`) of the distance
    /// found. The plane is covered by squares: where the value at a center exceeds the
    /// half diagonal by the bound, the square is done; else it is cut in four.
    ///
    /// # Errors
    /// [`Error::Number`] for a slack that is not between 0 and 1.
    pub fn certify(&self, slack: f64, most: usize) -> Result<Certificate, Error> {
        self.certify_until(slack, most, &mut |_| false)
    }

    /// The same; `stop` is asked now and then, with the number of evaluations, whether to
    /// end with what has been proved.
    ///
    /// # Errors
    /// As [`certify`](Self::certify).
    pub fn certify_until(
        &self,
        slack: f64,
        most: usize,
        stop: &mut dyn FnMut(usize) -> bool,
    ) -> Result<Certificate, Error> {
        if !(slack > 0.0 && slack < 1.0) {
            return Err(NumberError::OutOfRange {
                name: "slack",
                given: slack,
                allowed: "between 0 and 1",
            }
            .into());
        }
        let n = self.form.n();
        let mut space = Space::default();
        let mut best = self.search(&mut space);
        let middle = (0..n).map(|i| self.form.eigenvalue(i).re).sum::<f64>() / n as f64;
        // Outside this distance from the middle the value exceeds the best one.
        let reach = self.norm + middle.abs() * root(n as f64) + best.sigma;
        let rounding = 8.0 * n as f64 * f64::EPSILON * self.norm;
        let mut cells = BinaryHeap::new();
        for sign in [-0.5, 0.5] {
            let center = C64::new(middle + sign * reach, 0.5 * reach);
            cells.push(Cell {
                center,
                half: 0.5 * reach,
                lower: 0.0,
            });
        }
        let mut complete = false;
        let mut at_least = 0.0_f64;
        while let Some(cell) = cells.pop() {
            at_least = cell.lower;
            let wanted = (1.0 - slack) * best.sigma;
            if cell.lower >= wanted || best.sigma <= rounding {
                complete = true;
                break;
            }
            if space.evaluations >= most || (space.evaluations % 256 < 4 && stop(space.evaluations))
            {
                break;
            }
            let half = 0.5 * cell.half;
            for (sx, sy) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
                let center = cell.center + C64::new(sx * half, sy * half);
                let here = self.at(center, &mut space);
                let lower =
                    (here.sigma * (1.0 - 1e-6) - half * core::f64::consts::SQRT_2).max(cell.lower);
                if here.sigma < best.sigma {
                    best = self.descend(here, 0.0, &mut space);
                }
                cells.push(Cell {
                    center,
                    half,
                    lower,
                });
            }
        }
        at_least = at_least.min(best.sigma);
        Ok(Certificate {
            found: self.report(&best, &space),
            at_least: (at_least - rounding).max(0.0) * self.unit,
            complete,
        })
    }

    /// The unobservable subspace. A singular value below `rtol` of the norm counts as
    /// zero; by default
    /// [`default_rtol`](super::default_rtol).
    ///
    /// # Errors
    /// [`Error::NoConvergence`].
    pub fn unobservable(&self, rtol: Option<f64>) -> Result<Unobservable, Error> {
        let n = self.form.n();
        let rtol = rtol.unwrap_or_else(|| super::default_rtol(n));
        let mut left = Deflation {
            form: self.form.clone(),
            c: self.c.clone(),
            shown: vec![None; n],
            norm: self.norm,
            tolerance: rtol * self.norm,
            taken: Matrix::zeros(0, n),
            rejected: 0.0,
        };
        left.run()?;
        let mut basis = Vec::with_capacity(n * n);
        let dimension = left.taken.rows();
        real_span(&left.taken, dimension, n, &mut basis);
        real_span(&left.form.vectors, n - dimension, n, &mut basis);
        let row_space = basis.split_off(dimension * n);
        let norm = if self.norm > 0.0 { self.norm } else { 1.0 };
        let weakest = left
            .shown
            .iter()
            .flatten()
            .fold(f64::INFINITY, |low, &x| low.min(x));
        Ok(Unobservable {
            kernel: basis,
            row_space,
            rejected: left.rejected / norm,
            weakest: weakest / norm,
            rtol,
            undecided: false,
            states: n,
        })
    }
}

/// The modes of A (n x n) in the invariant subspace that the orthonormal rows of `kernel`
/// span, clusters of eigenvalues together: those that rounding alone may have put apart, as
/// it does those of a chain of generalised eigenvectors. `rounding` is how wrong A may be,
/// in its own units.
///
/// # Errors
/// [`Error::NoConvergence`].
pub fn modes(a: &[f64], n: usize, kernel: &[f64], rounding: f64) -> Result<Vec<Mode>, Error> {
    let m = kernel.len() / n.max(1);
    let restricted = restricted(a, n, kernel);
    let form = Schur::new(&restricted, m)?;
    let size = form.t.norm().max(f64::MIN_POSITIVE);
    let near = 1e-6 * size;
    // Single linkage, each value with its conjugate.
    let folded = |z: C64| C64::new(z.re, z.im.abs());
    let values: Vec<C64> = (0..m).map(|i| folded(form.eigenvalue(i))).collect();
    let apart: Vec<f64> = (0..m)
        .map(|i| 4.0 * rounding * condition(&form.t, i, rounding))
        .map(|error| error.clamp(0.5 * near, 1e-3 * size))
        .collect();
    let mut cluster: Vec<usize> = (0..m).collect();
    for i in 0..m {
        for j in 0..i {
            let (from, to) = (cluster[i].max(cluster[j]), cluster[i].min(cluster[j]));
            if from != to && abs(values[i] - values[j]) <= apart[i] + apart[j] {
                for x in &mut cluster {
                    if *x == from {
                        *x = to;
                    }
                }
            }
        }
    }
    let mut out = Vec::new();
    for label in 0..m {
        let members: Vec<bool> = cluster.iter().map(|&c| c == label).collect();
        let count = members.iter().filter(|x| **x).count();
        if count == 0 {
            continue;
        }
        let mean = (0..m)
            .filter(|&i| members[i])
            .fold(C64::default(), |sum, i| sum + values[i])
            / count as f64;
        let mut sorted = form.clone();
        let mut none = Matrix::zeros(0, m);
        for (place, i) in (0..m).filter(|&i| members[i]).enumerate() {
            for k in (place..i).rev() {
                sorted.exchange(k, &mut none);
            }
        }
        let mut local = Vec::new();
        real_span(&sorted.vectors, count, m, &mut local);
        let mut basis = vec![0.0; count * n];
        for (out, row) in basis.chunks_exact_mut(n).zip(local.chunks_exact(m)) {
            for (&factor, line) in row.iter().zip(kernel.chunks_exact(n)) {
                super::scaling::add(out, factor, line);
            }
        }
        // Both members of a pair count, and both of their means.
        let error = rounding * projector(&sorted.t, count);
        let alone = (0..m)
            .filter(|&i| members[i])
            .all(|i| form.eigenvalue(i).im.abs() <= 2.0 * apart[i]);
        let im = if alone || mean.im <= error {
            0.0
        } else {
            mean.im
        };
        out.push(Mode {
            eigenvalue: [mean.re, im],
            error,
            dimension: count,
            basis,
        });
    }
    out.sort_by(|a, b| {
        (b.eigenvalue[0].total_cmp(&a.eigenvalue[0]))
            .then(a.eigenvalue[1].total_cmp(&b.eigenvalue[1]))
    });
    Ok(out)
}

/// The condition of the eigenvalue at place i of a triangular matrix: by how much it changes
/// for each unit of change of the matrix. Eigenvalues nearer to each other than `tiny` count
/// as so far apart; where it exceeds 1e40 it is infinite.
fn condition(t: &Matrix, i: usize, tiny: f64) -> f64 {
    let m = t.columns;
    let z = t.get(i, i);
    let solve = |sum: C64, k: usize| {
        let below = z - t.get(k, k);
        sum / if abs(below) > tiny {
            below
        } else {
            C64::new(tiny.max(f64::MIN_POSITIVE), 0.0)
        }
    };
    // Right and left eigenvector, each 1 in place i; huge ones stay as they are.
    let (mut right, mut left) = (0.0, 0.0);
    let mut x = vec![C64::default(); m];
    x[i] = C64::new(1.0, 0.0);
    for k in (0..i).rev() {
        let sum = (k + 1..=i).fold(C64::default(), |sum, j| sum + t.get(k, j) * x[j]);
        x[k] = solve(sum, k);
        right += x[k].norm_sqr();
        if right > 1e40 {
            return f64::INFINITY;
        }
    }
    for k in i + 1..m {
        let sum = (i..k).fold(C64::default(), |sum, j| sum + x[j] * t.get(j, k));
        x[k] = solve(sum, k);
        left += x[k].norm_sqr();
        if left > 1e40 {
            return f64::INFINITY;
        }
    }
    root((1.0 + right) * (1.0 + left))
}

/// The norm of the projector on the invariant subspace of the first `count` eigenvalues of
/// a triangular matrix: by how much their mean changes for each unit of change of it.
fn projector(t: &Matrix, count: usize) -> f64 {
    let m = t.columns;
    let mut x = Matrix::zeros(count, m);
    let mut squared = 1.0;
    // T11 X - X T22 = T12, column by column.
    for j in count..m {
        for i in (0..count).rev() {
            let mut sum = t.get(i, j);
            for k in count..j {
                sum += x.get(i, k) * t.get(k, j);
            }
            for k in i + 1..count {
                sum -= t.get(i, k) * x.get(k, j);
            }
            let value = sum / (t.get(i, i) - t.get(j, j));
            squared += value.norm_sqr();
            x.set(i, j, value);
        }
    }
    // Where two clusters coincide nothing is known of their mean but what they are part of.
    if squared < 1e24 { root(squared) } else { 1e12 }
}

/// The power of two at or below a number; 1 for zero.
fn power_of_two_near(x: f64) -> f64 {
    let bits = x.to_bits() & 0x7ff0_0000_0000_0000;
    if bits == 0 {
        if x > 0.0 { f64::MIN_POSITIVE } else { 1.0 }
    } else {
        f64::from_bits(bits)
    }
}

/// V^T A V with the rows of `kernel` for the columns of V.
pub(super) fn restricted(a: &[f64], n: usize, kernel: &[f64]) -> Vec<f64> {
    let m = kernel.len() / n.max(1);
    let mut restricted = vec![0.0; m * m];
    let mut image = vec![0.0; n];
    for (j, v) in kernel.chunks_exact(n).enumerate() {
        for (x, row) in image.iter_mut().zip(a.chunks_exact(n)) {
            *x = crate::numbers::algebra::dot_slices(row, v);
        }
        for (i, w) in kernel.chunks_exact(n).enumerate() {
            restricted[i * m + j] = crate::numbers::algebra::dot_slices(w, &image);
        }
    }
    restricted
}

/// X (k x m) with a X - X own = -out and c X = -shown as nearly as can be, to first order the
/// step to an invariant subspace that is not seen: a (k x k), c (p x k), own (m x m), out
/// (k x m), shown (p x m). `None` where a step is not small.
pub(super) fn correction(
    a: &[f64],
    c: &[f64],
    own: &[f64],
    out: &[f64],
    shown: &[f64],
) -> Result<Option<Vec<f64>>, Error> {
    let m = order_of(own);
    let k = out.len() / m;
    let p = c.len() / k;
    let form = Schur::new(a, k)?;
    let seen = product_with_vectors(c, &form.vectors);
    let inner = Schur::new(own, m)?;
    // In the Schur vectors of both the columns come one after the other.
    let turned = |x: &[f64], rows: usize, j: usize| -> Vec<C64> {
        (0..rows)
            .map(|i| {
                (0..m).fold(C64::default(), |sum, l| {
                    sum - inner.vectors.get(j, l) * x[i * m + l]
                })
            })
            .collect()
    };
    let mut columns: Vec<Vec<C64>> = Vec::with_capacity(m);
    let mut r = Matrix::zeros(k, k);
    for j in 0..m {
        let plain = turned(out, k, j);
        // Q^H of it: the rows of `vectors` are the columns of Q.
        let mut right: Vec<C64> = (0..k)
            .map(|i| {
                (0..k).fold(C64::default(), |sum, l| {
                    sum + form.vectors.get(i, l).conj() * plain[l]
                })
            })
            .collect();
        for (before, column) in columns.iter().enumerate() {
            let factor = inner.t.get(before, j);
            for (x, &y) in right.iter_mut().zip(column) {
                *x += factor * y;
            }
        }
        let z = inner.eigenvalue(j);
        r.re.copy_from_slice(&form.t.re);
        r.im.copy_from_slice(&form.t.im);
        for i in 0..k {
            r.set(i, i, form.t.get(i, i) - z);
        }
        let more = turned(shown, p, j);
        for (o, &target) in more.iter().enumerate() {
            let mut target = target;
            let (mut x_re, mut x_im) = (
                seen.re[o * k..(o + 1) * k].to_vec(),
                seen.im[o * k..(o + 1) * k].to_vec(),
            );
            for i in 0..k {
                let x = C64::new(x_re[i], x_im[i]);
                if x.norm_sqr() == 0.0 {
                    continue;
                }
                let g = Rotation::onto_first(r.get(i, i), x);
                let row = i * k + i..(i + 1) * k;
                rotate(
                    &mut r.re[row.clone()],
                    &mut r.im[row],
                    &mut x_re[i..],
                    &mut x_im[i..],
                    g,
                );
                let (u, w) = (right[i], target);
                right[i] = u * g.c + g.s * w;
                target = w * g.c - g.s.conj() * u;
            }
        }
        let (mut re, mut im): (Vec<f64>, Vec<f64>) = right.iter().map(|z| (z.re, z.im)).unzip();
        if (0..k).any(|i| abs(r.get(i, i)) == 0.0) {
            return Ok(None);
        }
        solve(&r, &mut re, &mut im);
        columns.push(re.iter().zip(&im).map(|(&x, &y)| C64::new(x, y)).collect());
    }
    // X = Q Y U^H
    let mut x = vec![0.0; k * m];
    for (j, column) in columns.iter().enumerate() {
        for i in 0..k {
            let value = (0..k).fold(C64::default(), |sum, l| {
                sum + form.vectors.get(l, i) * column[l]
            });
            for l in 0..m {
                x[i * m + l] += (value * inner.vectors.get(j, l).conj()).re;
            }
        }
    }
    let size = x.iter().map(|x| x * x).sum::<f64>();
    Ok((size < 0.25).then_some(x))
}

/// The n of an n x n matrix.
fn order_of(square: &[f64]) -> usize {
    (0..=square.len())
        .find(|m| m * m >= square.len())
        .unwrap_or(0)
}

/// Orthonormal rows that span the invariant subspaces of the eigenvalues left and right
/// of the imaginary axis.
pub(super) fn halves(a: &[f64], n: usize) -> Result<[Vec<f64>; 2], Error> {
    let form = Schur::new(a, n)?;
    // An eigenvalue that is on the axis but for rounding belongs to neither.
    let axis = 64.0 * f64::EPSILON * form.t.norm();
    if (0..n).any(|i| form.eigenvalue(i).re.abs() <= axis) {
        return Err(NumberError::OutOfRange {
            name: "real part of an eigenvalue of A",
            given: 0.0,
            allowed: "different from 0 by more than rounding",
        }
        .into());
    }
    let half = |sign: f64| {
        let mut sorted = form.clone();
        let mut none = Matrix::zeros(0, n);
        let chosen: Vec<usize> = (0..n)
            .filter(|&i| sign * form.eigenvalue(i).re > 0.0)
            .collect();
        for (place, &i) in chosen.iter().enumerate() {
            for k in (place..i).rev() {
                sorted.exchange(k, &mut none);
            }
        }
        let mut basis = Vec::new();
        real_span(&sorted.vectors, chosen.len(), n, &mut basis);
        basis
    };
    let (stable, antistable) = (half(-1.0), half(1.0));
    Ok([stable, antistable])
}

/// A square yet to be looked at; the one with the lowest bound comes first.
#[derive(Debug)]
struct Cell {
    center: C64,
    half: f64,
    lower: f64,
}

impl PartialEq for Cell {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Cell {}

impl PartialOrd for Cell {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Cell {
    fn cmp(&self, other: &Self) -> Ordering {
        other
            .lower
            .total_cmp(&self.lower)
            .then(self.half.total_cmp(&other.half))
    }
}

/// The smallest singular value and its right vector of the stack of T - z (its leading
/// m x m part) and C (the first m columns), by inverse iteration on the triangular factor.
fn point(
    t: &Matrix,
    c: &Matrix,
    m: usize,
    z: C64,
    norm: f64,
    rounds: usize,
    space: &mut Space,
) -> Point {
    space.evaluations += 1;
    if space.r.columns != m || space.r.rows() != m {
        space.r = Matrix::zeros(m, m);
        space.x_re = vec![0.0; m];
        space.x_im = vec![0.0; m];
        space.v_re = vec![0.0; m];
        space.v_im = vec![0.0; m];
    }
    let Space {
        r,
        x_re,
        x_im,
        v_re,
        v_im,
        ..
    } = space;
    let n = t.columns;
    for i in 0..m {
        r.re[i * m + i..(i + 1) * m].copy_from_slice(&t.re[i * n + i..i * n + m]);
        r.im[i * m + i..(i + 1) * m].copy_from_slice(&t.im[i * n + i..i * n + m]);
        r.re[i * m + i] -= z.re;
        r.im[i * m + i] -= z.im;
    }
    for o in 0..c.rows() {
        x_re.copy_from_slice(&c.re[o * c.columns..o * c.columns + m]);
        x_im.copy_from_slice(&c.im[o * c.columns..o * c.columns + m]);
        for k in 0..m {
            let x = C64::new(x_re[k], x_im[k]);
            if x.norm_sqr() == 0.0 {
                continue;
            }
            let g = Rotation::onto_first(r.get(k, k), x);
            let row = k * m + k..(k + 1) * m;
            rotate(
                &mut r.re[row.clone()],
                &mut r.im[row],
                &mut x_re[k..],
                &mut x_im[k..],
                g,
            );
        }
    }
    let tiny = 1e-3 * f64::EPSILON * norm.max(f64::MIN_POSITIVE);
    for k in 0..m {
        if abs(r.get(k, k)) < tiny {
            r.set(k, k, C64::new(tiny, 0.0));
        }
    }
    // A start that no structure is orthogonal to.
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    for (a, b) in v_re.iter_mut().zip(v_im.iter_mut()) {
        for x in [a, b] {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            #[allow(clippy::cast_precision_loss)]
            let unit = (state >> 11) as f64 / (1_u64 << 53) as f64;
            *x = 0.5 + unit;
        }
    }
    let mut sigma = f64::INFINITY;
    for _ in 0..rounds {
        solve_adjoint(r, v_re, v_im);
        normalize(v_re, v_im);
        solve(r, v_re, v_im);
        // R v = y with |y| = 1 before: 1 / |v| is |R v| of the normalised one.
        let now = 1.0 / normalize(v_re, v_im);
        let settled = (sigma - now).abs() <= 1e-13 * now || now <= tiny;
        sigma = now;
        if settled {
            break;
        }
    }
    let v: Vec<C64> = v_re
        .iter()
        .zip(v_im.iter())
        .map(|(&re, &im)| C64::new(re, im))
        .collect();
    // From the pencil itself, not from its factor.
    let (mut squared, mut slope) = (0.0, C64::default());
    for i in 0..m {
        let row = i * n + i..i * n + m;
        let image = dot(&t.re[row.clone()], &t.im[row], &v_re[i..], &v_im[i..]) - z * v[i];
        squared += image.norm_sqr();
        slope += v[i].conj() * image;
    }
    for o in 0..c.rows() {
        let row = o * c.columns..o * c.columns + m;
        squared += dot(&c.re[row.clone()], &c.im[row], v_re, v_im).norm_sqr();
    }
    Point {
        z,
        sigma: root(squared),
        v,
        slope,
    }
}

/// b = R^-H b.
fn solve_adjoint(r: &Matrix, b_re: &mut [f64], b_im: &mut [f64]) {
    let m = r.columns;
    for i in 0..m {
        let y = C64::new(b_re[i], b_im[i]) / r.get(i, i).conj();
        (b_re[i], b_im[i]) = (y.re, y.im);
        let row = i * m + i + 1..(i + 1) * m;
        for (((re, im), &a), &b) in b_re[i + 1..]
            .iter_mut()
            .zip(&mut b_im[i + 1..])
            .zip(&r.re[row.clone()])
            .zip(&r.im[row])
        {
            // conj(a + i b) y
            *re -= a * y.re + b * y.im;
            *im -= a * y.im - b * y.re;
        }
    }
}

/// b = R^-1 b.
fn solve(r: &Matrix, b_re: &mut [f64], b_im: &mut [f64]) {
    let m = r.columns;
    for i in (0..m).rev() {
        let row = i * m + i + 1..(i + 1) * m;
        let sum = dot(
            &r.re[row.clone()],
            &r.im[row],
            &b_re[i + 1..],
            &b_im[i + 1..],
        );
        let x = (C64::new(b_re[i], b_im[i]) - sum) / r.get(i, i);
        (b_re[i], b_im[i]) = (x.re, x.im);
    }
}

/// Sum of the products, in four sums side by side.
fn dot(a_re: &[f64], a_im: &[f64], b_re: &[f64], b_im: &[f64]) -> C64 {
    const LANES: usize = 4;
    let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
    let (ar, ar_rest) = a_re.as_chunks::<LANES>();
    let (ai, ai_rest) = a_im.as_chunks::<LANES>();
    let (br, br_rest) = b_re.as_chunks::<LANES>();
    let (bi, bi_rest) = b_im.as_chunks::<LANES>();
    for (((a, b), c), d) in ar.iter().zip(ai).zip(br).zip(bi) {
        for k in 0..LANES {
            re[k] += a[k] * c[k] - b[k] * d[k];
            im[k] += a[k] * d[k] + b[k] * c[k];
        }
    }
    let mut sum = C64::new(re.iter().sum(), im.iter().sum());
    for (((a, b), c), d) in ar_rest.iter().zip(ai_rest).zip(br_rest).zip(bi_rest) {
        sum += C64::new(a * c - b * d, a * d + b * c);
    }
    sum
}

/// To length one; returns the length before.
fn normalize(re: &mut [f64], im: &mut [f64]) -> f64 {
    let sum: f64 = re.iter().zip(im.iter()).map(|(a, b)| a * a + b * b).sum();
    let norm = root(sum);
    let factor = 1.0 / norm;
    for x in re.iter_mut().chain(im.iter_mut()) {
        *x *= factor;
    }
    norm
}

/// Newton's steps towards a zero of sigma, which near one is the size of an analytic
/// function: of z where several eigenvalues meet its slope is tiny, and a search that does
/// not know where it goes stands still there.
fn towards_zero(
    start: Point,
    norm: f64,
    mut at: impl FnMut(C64, &mut Space) -> Point,
    space: &mut Space,
) -> Point {
    let floor = f64::EPSILON * norm;
    let mut best = start;
    for _ in 0..60 {
        let slope = abs(best.slope);
        if best.sigma <= floor || slope == 0.0 {
            break;
        }
        let mut step = best.slope * (best.sigma / slope) * (best.sigma / slope);
        if !(abs(step) <= norm) {
            break;
        }
        let mut next = at(best.z + step, space);
        for _ in 0..2 {
            if next.sigma < 0.75 * best.sigma {
                break;
            }
            step *= 0.25;
            next = at(best.z + step, space);
        }
        if !(next.sigma < 0.9 * best.sigma) {
            break;
        }
        best = next;
    }
    best
}

/// Quasi-Newton descent of sigma^2, whose gradient is -2 `slope`: a step by `slope` never
/// goes up, so it is what is taken where the model of second order fails.
fn descend(
    start: Point,
    enough: f64,
    norm: f64,
    mut at: impl FnMut(C64, &mut Space) -> Point,
    space: &mut Space,
) -> Point {
    let floor = f64::EPSILON * norm;
    let mut best = start;
    // The inverse of the second derivative, symmetric 2 x 2.
    let mut inverse = [0.5, 0.0, 0.5];
    let mut history = [f64::INFINITY; 4];
    for round in 0..60 {
        if best.sigma <= floor {
            break;
        }
        if best.sigma > enough && enough > 0.0 {
            // Four steps that do not halve it will not bring it to rounding.
            if best.sigma > 0.5 * history[round % 4] {
                break;
            }
            history[round % 4] = best.sigma;
        }
        let gradient = best.slope * -2.0;
        let step = C64::new(
            -(inverse[0] * gradient.re + inverse[1] * gradient.im),
            -(inverse[1] * gradient.re + inverse[2] * gradient.im),
        );
        let gain = abs(gradient) * abs(step);
        if gain <= 1e-13 * best.sigma * best.sigma {
            break;
        }
        let mut next = at(best.z + step, space);
        let mut shrink = step;
        for _ in 0..3 {
            if next.sigma < best.sigma {
                break;
            }
            shrink *= 0.25;
            next = at(best.z + shrink, space);
        }
        if !(next.sigma < best.sigma) {
            let plain = at(best.z + best.slope, space);
            inverse = [0.5, 0.0, 0.5];
            if !(plain.sigma < best.sigma * (1.0 - 1e-14)) {
                break;
            }
            best = plain;
            continue;
        }
        let s = next.z - best.z;
        let y = next.slope * -2.0 - gradient;
        let sy = s.re * y.re + s.im * y.im;
        if sy > 1e-12 * abs(s) * abs(y) {
            // BFGS: (I - s y^T / sy) H (I - y s^T / sy) + s s^T / sy
            let hy = C64::new(
                inverse[0] * y.re + inverse[1] * y.im,
                inverse[1] * y.re + inverse[2] * y.im,
            );
            let factor = (1.0 + (y.re * hy.re + y.im * hy.im) / sy) / sy;
            inverse[0] += factor * s.re * s.re - 2.0 * hy.re * s.re / sy;
            inverse[1] += factor * s.re * s.im - (hy.re * s.im + hy.im * s.re) / sy;
            inverse[2] += factor * s.im * s.im - 2.0 * hy.im * s.im / sy;
        }
        best = next;
    }
    best
}

/// A pencil of which unobservable directions are split off one after the other.
#[derive(Debug)]
struct Deflation {
    form: Schur,
    c: Matrix,
    /// For eigenvalues that are shown, the smallest singular value there.
    shown: Vec<Option<f64>>,
    norm: f64,
    tolerance: f64,
    taken: Matrix,
    rejected: f64,
}

impl Deflation {
    fn run(&mut self) -> Result<(), NoConvergence> {
        let mut space = Space::default();
        while let Some(i) = self.shown.iter().position(Option::is_none) {
            let z = self.form.eigenvalue(i);
            let mut found = self.at(z, 8, &mut space);
            // One that is below the tolerance but not rounding would leave a change of that
            // size behind, which what is split off next could not stand beside its own.
            if found.sigma > self.tolerance / 32.0 && found.sigma <= self.error_of(i) {
                found = self.nearby(found, &mut space);
            }
            if found.sigma > self.tolerance {
                self.shown[i] = Some(found.sigma);
                continue;
            }
            self.rejected = self.rejected.max(found.sigma);
            self.split_off(&found, &mut space)?;
            for i in 0..self.shown.len() {
                if abs(self.form.eigenvalue(i) - found.z) <= 1e-3 * self.norm {
                    self.shown[i] = None;
                }
            }
        }
        Ok(())
    }

    fn at(&self, z: C64, rounds: usize, space: &mut Space) -> Point {
        let m = self.form.n();
        point(&self.form.t, &self.c, m, z, self.norm, rounds, space)
    }

    /// How wrong the eigenvalue at place i may be: rounding times its condition. Where
    /// the singular value exceeds that, it is not zero near by, for it changes by no more
    /// than z does.
    fn error_of(&self, i: usize) -> f64 {
        let tiny = f64::EPSILON * self.norm;
        1e3 * self.form.n() as f64 * tiny * condition(&self.form.t, i, tiny)
    }

    /// An eigenvalue of a long chain is found with a large error; its neighbours' mean is
    /// better, and so is what descent finds.
    fn nearby(&self, start: Point, space: &mut Space) -> Point {
        let z = start.z;
        let mut best = start;
        for radius in [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1] {
            let close = |x: &C64| abs(*x - z) <= radius * self.norm;
            let (mut sum, mut count) = (C64::default(), 0_u32);
            for x in (0..self.form.n())
                .map(|k| self.form.eigenvalue(k))
                .filter(close)
            {
                sum += x;
                count += 1;
            }
            if count > 1 {
                let found = self.at(sum / f64::from(count), 8, space);
                if found.sigma < best.sigma {
                    best = found;
                }
            }
        }
        let at = |z: C64, space: &mut Space| self.at(z, 8, space);
        let best = towards_zero(best, self.norm, at, space);
        if best.sigma <= self.tolerance {
            return best;
        }
        descend(best, self.tolerance, self.norm, at, space)
    }

    fn bring_forward(&mut self, from: usize, to: usize) {
        for k in (to..from).rev() {
            self.form.exchange(k, &mut self.c);
            self.shown.swap(k, k + 1);
        }
    }

    /// Splits off the direction found. It lies in the invariant subspace of a few
    /// eigenvalues nearest to its z: these come first, as many as it takes.
    fn split_off(&mut self, found: &Point, space: &mut Space) -> Result<(), NoConvergence> {
        let m = self.form.n();
        // No more is given away than was found: what is left of a direction that is only
        // nearly right counts against those that come after it.
        let accept = (self.tolerance / 32.0).max(4.0 * found.sigma);
        let mut count = 0;
        let local = loop {
            let nearest = (count..m).min_by(|&i, &j| {
                let far = |k| (self.form.eigenvalue(k) - found.z).norm_sqr();
                far(i).total_cmp(&far(j))
            });
            if let Some(i) = nearest {
                self.bring_forward(i, count);
                count += 1;
            }
            if count == 1 {
                let seen: f64 = (0..self.c.rows())
                    .map(|o| self.c.get(o, 0).norm_sqr())
                    .sum();
                if m == 1 || root(seen) <= accept {
                    break None;
                }
                continue;
            }
            let here = point(&self.form.t, &self.c, count, found.z, self.norm, 8, space);
            if here.sigma <= accept || count == m {
                break Some(here);
            }
        };
        if let Some(local) = local {
            self.turn(local.v, count)?;
        }
        let n = self.form.vectors.columns;
        self.taken.re.extend_from_slice(&self.form.vectors.re[..n]);
        self.taken.im.extend_from_slice(&self.form.vectors.im[..n]);
        self.form.vectors.drop_first(true, false);
        self.form.t.drop_first(true, true);
        self.c.drop_first(false, true);
        self.shown.remove(0);
        Ok(())
    }

    /// Makes v, in the first `count` coordinates, the first axis, and the others
    /// triangular again.
    fn turn(&mut self, mut v: Vec<C64>, count: usize) -> Result<(), NoConvergence> {
        let outputs = self.c.rows();
        for k in (0..count - 1).rev() {
            let g = Rotation::onto_first(v[k], v[k + 1]);
            v[k] = v[k] * g.c + g.s * v[k + 1];
            self.form.t.rotate_rows(k, 0, g);
            self.form.t.rotate_columns(k, count, g);
            self.form.vectors.rotate_rows(k, 0, g.conj());
            self.c.rotate_columns(k, outputs, g);
        }
        let size = count - 1;
        let mut block = Matrix::zeros(size, size);
        for i in 0..size {
            for j in 0..size {
                block.set(i, j, self.form.t.get(i + 1, j + 1));
            }
        }
        let inner = Schur::of_complex(block)?;
        let t = &mut self.form.t;
        for i in 0..size {
            t.set(i + 1, 0, C64::default());
            for j in 0..size {
                t.set(i + 1, j + 1, inner.t.get(i, j));
            }
        }
        // Q^H from the left on the columns behind, Q from the right on what is above.
        mix_rows(t, 1, count, &inner.vectors, true);
        mix_columns(t, 1, 1, &inner.vectors);
        mix_rows(&mut self.form.vectors, 1, 0, &inner.vectors, false);
        mix_columns(&mut self.c, 1, outputs, &inner.vectors);
        self.shown[..count].fill(None);
        Ok(())
    }
}

/// Rows from `first` on, columns from `from` on: row i becomes the sum over k of
/// `q_ik` (or its conjugate) times row k.
fn mix_rows(x: &mut Matrix, first: usize, from: usize, q: &Matrix, conjugate: bool) {
    let (size, n) = (q.columns, x.columns);
    let old_re = x.re[first * n..(first + size) * n].to_vec();
    let old_im = x.im[first * n..(first + size) * n].to_vec();
    for i in 0..size {
        let row = (first + i) * n + from..(first + i + 1) * n;
        x.re[row.clone()].fill(0.0);
        x.im[row.clone()].fill(0.0);
        for k in 0..size {
            let z = q.get(i, k);
            let f = if conjugate { z.conj() } else { z };
            let source = k * n + from..(k + 1) * n;
            for (((re, im), &a), &b) in x.re[row.clone()]
                .iter_mut()
                .zip(&mut x.im[row.clone()])
                .zip(&old_re[source.clone()])
                .zip(&old_im[source])
            {
                *re += f.re * a - f.im * b;
                *im += f.re * b + f.im * a;
            }
        }
    }
}

/// Columns from `first` on of the first `rows` rows times Q, whose columns are the rows
/// of `q`.
fn mix_columns(x: &mut Matrix, first: usize, rows: usize, q: &Matrix) {
    let size = q.columns;
    let mut old = vec![C64::default(); size];
    for i in 0..rows {
        for (k, z) in old.iter_mut().enumerate() {
            *z = x.get(i, first + k);
        }
        for j in 0..size {
            let mut sum = C64::default();
            for (k, &z) in old.iter().enumerate() {
                sum += z * q.get(j, k);
            }
            x.set(i, first + j, sum);
        }
    }
}

/// Appends a real orthonormal basis of the span of the first `count` rows, which holds
/// the conjugate of each of its vectors, orthogonal to the rows that are there.
fn real_span(rows: &Matrix, count: usize, n: usize, basis: &mut Vec<f64>) {
    let mut parts: Vec<f64> = Vec::with_capacity(2 * count * n);
    parts.extend_from_slice(&rows.re[..count * n]);
    parts.extend_from_slice(&rows.im[..count * n]);
    let mut norms: Vec<f64> = parts
        .chunks_exact(n)
        .map(|x| crate::numbers::algebra::dot_slices(x, x))
        .collect();
    for _ in 0..count {
        let pick = (0..norms.len())
            .max_by(|&i, &j| norms[i].total_cmp(&norms[j]))
            .unwrap_or(0);
        let mut v = parts[pick * n..(pick + 1) * n].to_vec();
        for _ in 0..2 {
            for known in basis.chunks_exact(n) {
                let along = crate::numbers::algebra::dot_slices(known, &v);
                super::scaling::add(&mut v, -along, known);
            }
        }
        let size = root(crate::numbers::algebra::dot_slices(&v, &v));
        let factor = if size > 0.0 { 1.0 / size } else { 0.0 };
        for x in &mut v {
            *x *= factor;
        }
        for (row, norm) in parts.chunks_exact_mut(n).zip(&mut norms) {
            let along = crate::numbers::algebra::dot_slices(row, &v);
            super::scaling::add(row, -along, &v);
            *norm = crate::numbers::algebra::dot_slices(row, row);
        }
        norms[pick] = -1.0;
        basis.extend_from_slice(&v);
    }
}

/// C, or the triangular factor of it where it has more rows than columns.
fn compressed(c: &[f64], n: usize) -> Vec<f64> {
    if c.len() <= n * n {
        return c.to_vec();
    }
    let mut factor = vec![0.0; n * n];
    for row in c.chunks_exact(n) {
        let mut row = row.to_vec();
        crate::square_root::rotate_in(&mut factor, &mut row);
    }
    factor
}

/// C Q, with the columns of Q in rows.
fn product_with_vectors(c: &[f64], vectors: &Matrix) -> Matrix {
    let n = vectors.columns;
    let outputs = c.len() / n.max(1);
    let mut out = Matrix::zeros(outputs, n);
    for (o, row) in c.chunks_exact(n).enumerate() {
        for k in 0..n {
            out.re[o * n + k] =
                crate::numbers::algebra::dot_slices(row, &vectors.re[k * n..(k + 1) * n]);
            out.im[o * n + k] =
                crate::numbers::algebra::dot_slices(row, &vectors.im[k * n..(k + 1) * n]);
        }
    }
    out
}
