//! What no output shows, in the units of the user: the subspace, its modes, and which
//! further output would show it.
//!
//! ```
//! use gramian::linear::unobservable::Unobservable;
//! // Two equal oscillators of which the sum is measured.
//! let a = [0.0, 1.0, 0.0, 0.0, -4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -4.0, 0.0];
//! let found = Unobservable::new(&a, &[1.0, 0.0, 1.0, 0.0], 4, None)?;
//! assert_eq!(found.null_space().len(), 2);
//! assert!((found.modes()[0].eigenvalue[1] - 2.0).abs() < 1e-12);
//! // Either position, measured by itself, repairs it.
//! assert_eq!(found.left_by(&[1.0, 0.0, 0.0, 0.0])?, vec![0]);
//! # Ok::<(), gramian::linear::Error>(())
//! ```

use alloc::vec;
use alloc::vec::Vec;

use super::Error;
use super::analysis::{balance, reduced_null_space};
use super::pencil::{self, Pencil};
use super::scaling::{self, add};
use super::schur::root;
use super::staircase::Staircase;
use crate::numbers::algebra::dot_slices as dot;
use crate::scalar::{NumberError, all_finite, check_finite, check_length};
use crate::spectrum::check_rtol;

/// A mode that no output shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Real and imaginary part (not negative), per unit of time; of a discrete system, a
    /// factor per step. Zero where it is not told from zero.
    pub eigenvalue: [f64; 2],
    /// How wrong it may be by rounding.
    pub error: f64,
    /// Combinations of the states that it moves, in their units: each has a state with
    /// coefficient 1 that the others do not have.
    pub combinations: Vec<Vec<f64>>,
}

/// The unobservable subspace of a system, decided after balancing.
#[derive(Clone, Debug)]
pub struct Unobservable {
    n: usize,
    found: pencil::Unobservable,
    modes: Vec<Mode>,
    null_space: Vec<Vec<f64>>,
    states: Vec<f64>,
    time: f64,
    /// A in the subspace, balanced.
    restricted: Vec<f64>,
    /// States of which no output shows anything, not even beside others.
    blind: Vec<bool>,
}

impl Unobservable {
    /// Of A (n x n) and C (p x n). A singular value of the balanced pencil below `rtol` of
    /// its norm counts as zero; by default [`default_rtol`](super::default_rtol).
    ///
    /// # Errors
    /// [`Error::Number`] for lengths, numbers or a tolerance that do not fit;
    /// [`Error::Pencil`] where the eigenvalues are not found.
    pub fn new(a: &[f64], c: &[f64], n: usize, rtol: Option<f64>) -> Result<Self, Error> {
        let p = c.len().checked_div(n).unwrap_or(0);
        check_length("states", n, n.max(1))?;
        check_length("A", a.len(), n.saturating_mul(n))?;
        check_length("outputs", p, p.max(1))?;
        check_length("C", c.len(), p.saturating_mul(n))?;
        check_finite("A", a)?;
        check_finite("C", c)?;
        if let Some(rtol) = rtol {
            check_rtol(rtol)?;
        }
        let (mut a, mut c) = (a.to_vec(), c.to_vec());
        let scales = balance(&mut a, &mut c, n);
        scaling::check(&a, &c, n)?;
        let (states, time, center) = (scales.states, scales.time, scales.centers[0]);
        let found = decided(&a, &c, n, rtol, center * time)?;
        let touch = found.touch();
        let null_space = reduced_null_space(&found.kernel, &states, touch).0;
        let mut modes = Vec::new();
        // A is that close to one of which exactly this is not shown.
        let size = root(dot(&a, &a) + dot(&c, &c));
        let rounding = size * (64.0 * f64::EPSILON + 4.0 * found.rejected);
        for mode in pencil::modes(&a, n, &found.kernel, rounding)? {
            let error = mode.error / time + 4.0 * f64::EPSILON * center.abs();
            let told = |x: f64| if x.abs() <= error { 0.0 } else { x };
            modes.push(Mode {
                eigenvalue: [
                    told(mode.eigenvalue[0] / time + center),
                    told(mode.eigenvalue[1] / time),
                ],
                error,
                combinations: reduced_null_space(&mode.basis, &states, touch).0,
            });
        }
        if !(null_space.iter().all(|v| all_finite(v))
            && modes
                .iter()
                .flat_map(|m| &m.combinations)
                .all(|v| all_finite(v)))
        {
            return Err(NumberError::Overflow {
                result: "null space",
            }
            .into());
        }
        let restricted = pencil::restricted(&a, n, &found.kernel);
        let blind = (0..n)
            .map(|i| found.row_space.chunks_exact(n).all(|v| v[i].abs() <= touch))
            .collect();
        Ok(Self {
            n,
            found,
            modes,
            null_space,
            states,
            time,
            restricted,
            blind,
        })
    }

    /// How the subspace was decided.
    pub fn found(&self) -> &pencil::Unobservable {
        &self.found
    }

    /// The modes, the least damped first.
    pub fn modes(&self) -> &[Mode] {
        &self.modes
    }

    /// Basis of the subspace in physical units, reduced.
    pub fn null_space(&self) -> &[Vec<f64>] {
        &self.null_space
    }

    /// What a balanced state is multiplied by to give the physical one.
    pub fn state_scales(&self) -> &[f64] {
        &self.states
    }

    /// What the unit of time is multiplied by.
    pub fn time_scale(&self) -> f64 {
        self.time
    }

    /// Takes from rows (k x n, about the state) what rounding says of the subspace. The
    /// columns of states of which nothing is shown become exactly zero: the least that was
    /// left there would be all that is known of them, and count.
    pub fn project(&self, rows: &mut [f64]) {
        let n = self.n;
        for row in rows.chunks_exact_mut(n) {
            let mut balanced: Vec<f64> = row.iter().zip(&self.states).map(|(x, d)| x * d).collect();
            for v in self.found.kernel.chunks_exact(n) {
                let along = dot(v, &balanced);
                add(&mut balanced, -along, v);
            }
            for (((x, b), d), &blind) in row
                .iter_mut()
                .zip(balanced)
                .zip(&self.states)
                .zip(&self.blind)
            {
                *x = if blind { 0.0 } else { b / d };
            }
        }
    }

    /// How many combinations stay unobservable when one further output is measured, for
    /// each row of `outputs` (k x n).
    ///
    /// # Errors
    /// [`Error::Number`] for a length that does not fit or numbers that are not finite;
    /// [`Error::Pencil`].
    pub fn left_by(&self, outputs: &[f64]) -> Result<Vec<usize>, Error> {
        let n = self.n;
        let count = outputs.len() / n;
        check_length("outputs", outputs.len(), count * n)?;
        check_finite("outputs", outputs)?;
        let m = self.found.dimension();
        if m == 0 {
            return Ok(vec![0; count]);
        }
        let size = root(dot(&self.restricted, &self.restricted));
        let size = if size > 0.0 { size } else { 1.0 };
        let mut left = Vec::with_capacity(count);
        for row in outputs.chunks_exact(n) {
            let balanced: Vec<f64> = row.iter().zip(&self.states).map(|(x, d)| x * d).collect();
            let norm = root(dot(&balanced, &balanced));
            let factor = if norm > 0.0 { size / norm } else { 0.0 };
            let seen: Vec<f64> = self
                .found
                .kernel
                .chunks_exact(n)
                .map(|v| factor * dot(v, &balanced))
                .collect();
            let rtol = Some(self.found.rtol.max(super::default_rtol(n)));
            left.push(deflated(&self.restricted, &seen, m, rtol)?.dimension());
        }
        Ok(left)
    }
}

/// The unobservable subspace of a balanced system from the diagonal of which `center` was
/// taken. The tolerance, where none is given, is that for rounding; where it is not clear
/// whether a singular value is, what may be lost is counted.
pub(super) fn decided(
    a: &[f64],
    c: &[f64],
    n: usize,
    rtol: Option<f64>,
    center: f64,
) -> Result<pencil::Unobservable, Error> {
    let found = deflated(a, c, n, rtol)?;
    if rtol.is_some() {
        return Ok(found);
    }
    let size = root(dot(a, a) + dot(c, c)).max(f64::MIN_POSITIVE);
    // The entries of A are rounded as large as they came, center and all; where nothing is
    // left A was that multiple of the identity.
    let entries = if a.iter().all(|x| *x == 0.0) {
        0.0
    } else {
        16.0 * f64::EPSILON * center.abs() / size
    };
    let zero = found.rtol / 16.0;
    let clear = (16.0 * found.rtol).max(entries);
    if found.rejected <= zero && found.weakest >= clear.max(SUSPECT) {
        return Ok(found);
    }
    // Which directions to split off, a tolerance may choose badly where eigenvalues are
    // defective. So several do; what counts is whether their subspace, refined, is one.
    let mut best = found.clone();
    let mut known = Subspace {
        kernel: found.kernel.clone(),
        rest: found.row_space.clone(),
    };
    best.rejected = known.refine(a, c, n)? / size;
    if best.rejected > zero {
        known = Subspace::none(n);
        best.rejected = 0.0;
    }
    let mut possible = known.clone();
    for tolerance in [1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, found.rtol, zero] {
        let [rest, kernel] = by_steps(a, c, n, tolerance).0;
        let by_pencil = Pencil::new(a, c, n)?.unobservable(Some(tolerance))?;
        for (kernel, rest) in [(kernel, rest), (by_pencil.kernel, by_pencil.row_space)] {
            if kernel.len() > known.kernel.len() {
                let mut candidate = Subspace { kernel, rest };
                let left = candidate.refine(a, c, n)? / size;
                if left <= clear && candidate.kernel.len() > possible.kernel.len() {
                    possible = candidate.clone();
                }
                if left <= zero {
                    (known, best.rejected) = (candidate, left);
                }
            }
        }
    }
    best.weakest = f64::INFINITY;
    if !known.rest.is_empty() {
        let (inner, seen) = known.quotient(a, c, n);
        let left = Pencil::new(&inner, &seen, known.rest.len() / n)?;
        best.weakest = left.distance().distance / size;
    }
    best.kernel = known.kernel;
    best.row_space = known.rest;
    if best.weakest >= clear {
        return Ok(best);
    }
    let most = deflated(a, c, n, Some(clear.min(0.01)))?;
    best.undecided = true;
    if possible.kernel.len() > best.kernel.len() {
        (best.kernel, best.row_space) = (possible.kernel, possible.rest);
    }
    if most.kernel.len() > best.kernel.len() {
        (best.kernel, best.row_space) = (most.kernel, most.row_space);
    }
    Ok(best)
}

/// Nearer to an unobservable pair than this part of the norm, a decision is looked at again.
const SUSPECT: f64 = 1e-5;

/// Orthonormal rows that may span an unobservable subspace, and those of the complement.
#[derive(Clone)]
struct Subspace {
    kernel: Vec<f64>,
    rest: Vec<f64>,
}

impl Subspace {
    fn none(n: usize) -> Self {
        let mut rest = vec![0.0; n * n];
        for i in 0..n {
            rest[i * n + i] = 1.0;
        }
        Self {
            kernel: Vec::new(),
            rest,
        }
    }

    /// A and C of what is left.
    fn quotient(&self, a: &[f64], c: &[f64], n: usize) -> (Vec<f64>, Vec<f64>) {
        (
            pencil::restricted(a, n, &self.rest),
            times_rows(c, &self.rest, n),
        )
    }

    /// How far A leads out of the subspace, and C sees it: the change of both that would make
    /// it unobservable.
    fn leaves(&self, a: &[f64], c: &[f64], n: usize) -> f64 {
        let mut sum = 0.0;
        for v in self.kernel.chunks_exact(n) {
            let image: Vec<f64> = a.chunks_exact(n).map(|line| dot(line, v)).collect();
            sum += self
                .rest
                .chunks_exact(n)
                .map(|line| dot(line, &image) * dot(line, &image))
                .chain(c.chunks_exact(n).map(|line| dot(line, v) * dot(line, v)))
                .sum::<f64>();
        }
        root(sum)
    }

    /// Newton's iteration for the nearest invariant subspace that is not seen; returns what
    /// is left to it.
    fn refine(&mut self, a: &[f64], c: &[f64], n: usize) -> Result<f64, Error> {
        let mut left = self.leaves(a, c, n);
        if self.kernel.is_empty() || self.rest.is_empty() {
            return Ok(left);
        }
        for _ in 0..6 {
            let (inner, seen) = self.quotient(a, c, n);
            let out: Vec<f64> = {
                let images = times_rows(a, &self.kernel, n);
                // Q A V^T
                let m = self.kernel.len() / n;
                self.rest
                    .chunks_exact(n)
                    .flat_map(|line| {
                        let mut row = vec![0.0; m];
                        for (&x, image) in line.iter().zip(images.chunks_exact(m)) {
                            add(&mut row, x, image);
                        }
                        row
                    })
                    .collect()
            };
            let shown = times_rows(c, &self.kernel, n);
            let own = pencil::restricted(a, n, &self.kernel);
            let Some(x) = pencil::correction(&inner, &seen, &own, &out, &shown)? else {
                break;
            };
            let m = self.kernel.len() / n;
            let mut kernel = self.kernel.clone();
            for (line, x) in self.rest.chunks_exact(n).zip(x.chunks_exact(m)) {
                for (row, &x) in kernel.chunks_exact_mut(n).zip(x) {
                    add(row, x, line);
                }
            }
            let mut next = Self {
                kernel: Vec::with_capacity(kernel.len()),
                rest: Vec::with_capacity(self.rest.len()),
            };
            append_orthonormal(&kernel, n, &[], &mut next.kernel);
            append_orthonormal(&self.rest, n, &next.kernel, &mut next.rest);
            let now = next.leaves(a, c, n);
            if !(now < left) {
                break;
            }
            let done = now > 0.5 * left;
            (left, *self) = (now, next);
            if done {
                break;
            }
        }
        Ok(left)
    }
}

/// Rows made orthonormal, and orthogonal to those of `before`.
fn append_orthonormal(rows: &[f64], n: usize, before: &[f64], out: &mut Vec<f64>) {
    for row in rows.chunks_exact(n) {
        let mut v = row.to_vec();
        for _ in 0..2 {
            for known in before.chunks_exact(n).chain(out.chunks_exact(n)) {
                let along = dot(known, &v);
                add(&mut v, -along, known);
            }
            let size = root(dot(&v, &v));
            let factor = if size > 0.0 { 1.0 / size } else { 0.0 };
            for x in &mut v {
                *x *= factor;
            }
        }
        out.extend_from_slice(&v);
    }
}

/// M B^T for rows M (k x n) and B (m x n).
fn times_rows(rows: &[f64], basis: &[f64], n: usize) -> Vec<f64> {
    rows.chunks_exact(n)
        .flat_map(|line| basis.chunks_exact(n).map(move |v| dot(line, v)))
        .collect()
}

/// From so many states on what both ways found is not asked again.
const SMALL: usize = 40;

/// The unobservable subspace of a balanced system, by the pencil or by the staircase,
/// whichever finds more: a subspace that A does not lead out of and C does not see, but for
/// rounding, is one, however it was found. Each misses some: the staircase where a product
/// of its steps is small, the pencil where a long chain of generalised eigenvectors spreads
/// an eigenvalue. What is left is asked again.
pub(super) fn deflated(
    a: &[f64],
    c: &[f64],
    n: usize,
    rtol: Option<f64>,
) -> Result<pencil::Unobservable, Error> {
    let mut found = Pencil::new(a, c, n)?.unobservable(rtol)?;
    let rtol = found.rtol;
    let mut again = found.dimension() > 0 && n <= SMALL;
    let steps = accepted(by_steps(a, c, n, rtol), rtol);
    if steps[1].len() > found.kernel.len() {
        [found.row_space, found.kernel] = steps;
        again = true;
    }
    while again && !found.row_space.is_empty() {
        let rows = &found.row_space;
        let m = rows.len() / n;
        let inner = pencil::restricted(a, n, rows);
        let seen = times_rows(c, rows, n);
        let more = Pencil::new(&inner, &seen, m)?.unobservable(Some(rtol))?;
        let steps = accepted(by_steps(&inner, &seen, m, rtol), rtol);
        found.weakest = more.weakest;
        found.rejected = found.rejected.max(more.rejected);
        let [left, hidden] = if steps[1].len() > more.kernel.len() {
            steps
        } else {
            [more.row_space, more.kernel]
        };
        again = !hidden.is_empty();
        let hidden = lifted(&hidden, rows, n);
        let left = lifted(&left, rows, n);
        found.kernel.extend(hidden);
        found.row_space = left;
    }
    Ok(found)
}

/// Row space and kernel; no kernel where it leads out of itself, or is seen, by more than its
/// tolerance allows.
fn accepted((found, leaves): ([Vec<f64>; 2], f64), rtol: f64) -> [Vec<f64>; 2] {
    if leaves <= 4.0 * rtol {
        return found;
    }
    let [mut basis, kernel] = found;
    basis.extend(kernel);
    [basis, Vec::new()]
}

/// Row space and kernel by the staircase form, and how far A leads out of the kernel and C sees
/// it, over their norm.
fn by_steps(a: &[f64], c: &[f64], n: usize, rtol: f64) -> ([Vec<f64>; 2], f64) {
    let outputs = c.len() / n.max(1);
    let mut basis = vec![0.0; n * n];
    let mut ranks = vec![0; n];
    let mut rows = vec![0.0; n.max(outputs) * n];
    let (mut v, mut w) = (vec![0.0; n], vec![0.0; n]);
    let form = Staircase {
        n,
        stride: n,
        a,
        c,
        basis: &mut basis,
        rows: &mut rows,
    };
    form.reduce(rtol, &mut v, &mut w, &mut ranks);
    let rank = ranks.last().copied().unwrap_or(0);
    let kernel = basis.split_off(rank * n);
    let size = root(dot(a, a) + dot(c, c)).max(f64::MIN_POSITIVE);
    let found = Subspace {
        kernel,
        rest: basis,
    };
    let leaves = found.leaves(a, c, n) / size;
    ([found.rest, found.kernel], leaves)
}

/// Rows (k x m) in coordinates of the rows of a basis (m x n).
fn lifted(rows: &[f64], basis: &[f64], n: usize) -> Vec<f64> {
    let m = basis.len() / n.max(1);
    let mut out = vec![0.0; rows.len() / m.max(1) * n];
    for (row, out) in rows.chunks_exact(m.max(1)).zip(out.chunks_exact_mut(n)) {
        for (&factor, line) in row.iter().zip(basis.chunks_exact(n)) {
            add(out, factor, line);
        }
    }
    out
}

/// A and C centered and balanced: powers of two for states, outputs and time with which
/// their entries come as near to one as they can.
///
/// # Errors
/// [`Error::Number`] for lengths that do not fit, or squares that exceed the numbers.
pub fn balanced(a: &[f64], c: &[f64], n: usize) -> Result<(Vec<f64>, Vec<f64>), Error> {
    let p = c.len().checked_div(n).unwrap_or(0);
    check_length("A", a.len(), n.saturating_mul(n))?;
    check_length("C", c.len(), p.saturating_mul(n))?;
    let (mut a, mut c) = (a.to_vec(), c.to_vec());
    if n > 0 {
        balance(&mut a, &mut c, n);
    }
    scaling::check(&a, &c, n)?;
    Ok((a, c))
}
