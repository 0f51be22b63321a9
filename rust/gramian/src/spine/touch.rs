//! Which states the null space moves.
//!
//! A null vector v is found from rows with errors, E: its part in state j is off by that of
//! A^+ E v, which is small where state j itself is well determined, however near
//! other directions are to being lost. So a part in state j counts when it is above
//! the accuracy of the rows times the deviation of state j, both in units of the rows.
//! No weight of a row changes its null space: the question is asked of rows of one size.
//!
//! # Source
//! Perturbation of the null space to first order: Stewart & Sun 1990, Matrix Perturbation
//! Theory, section V.2. What zeros prove beyond any accuracy: rows that do not see the
//! states that move determine the others, or do not.

use alloc::vec;
use alloc::vec::Vec;

use super::balance::{balance, inverse, size};
use super::parts::{
    GRADED, Parts, Rows, column_norms, determined, grade, norm, orthonormal, pivoted,
};
use crate::numbers::algebra::dot_slices as dot;
use crate::scalar::{Real, all_finite};
use crate::spectrum;

/// What is known of the part of each state in the null space.
#[derive(Clone, Debug)]
pub(super) struct Touch<T> {
    /// By how much that part may be off.
    pub error: Vec<T>,
    /// Whether the accuracy of the rows leaves open if a state moves at all.
    pub undecided: Vec<bool>,
}

/// Rows less accurate than this, relative to their size, leave it open whether a null vector
/// moves a state by less than their errors: a null vector is worth a look on the scale of
/// condition numbers, and a part of rounding times 1e8 is still far below any bound.
pub(super) const ACCURATE: f64 = 1e-8;

/// Decides which states the null space moves, and sets its other entries to zero.
pub(super) fn decide<T: Real>(rows: &Rows<'_, T>, parts: &mut Parts<T>) -> Touch<T> {
    let n = rows.n;
    orthonormal(&mut parts.null, n);
    let mut found = Touch {
        error: vec![T::zero(); n],
        undecided: vec![false; n],
    };
    if parts.null.is_empty() || parts.root.is_empty() {
        return found;
    }
    let even = Even::new(rows, parts);
    let (seen, root, null) = match &even {
        Some(even) => (even.rows(rows), &even.parts.root, even.parts.null.clone()),
        None => (
            Rows {
                exact: &[],
                ..*rows
            },
            &parts.root,
            parts.null.clone(),
        ),
    };
    let open = column_norms(&null, n);
    // Past a hundredth the estimate to first order says nothing.
    let most = if even.is_some() {
        T::of(1e-2)
    } else {
        parts.touch
    };
    let stated = errors(&seen, root, &null);
    let error: Vec<T> = stated.iter().map(|&error| error.min(most)).collect();
    let spread = column_norms(root, n);
    let moves: Vec<bool> = open.iter().zip(&error).map(|(o, e)| o > e).collect();
    let vague =
        |i: usize| !rows.errors.is_empty() && !moves[i] && stated[i] > spread[i] * T::of(ACCURATE);
    // Zeros decide where the size of a part is in doubt.
    let doubtful = |i: usize| vague(i) || (moves[i] && open[i] <= parts.touch);
    let proved = if (0..n).any(doubtful) {
        let certain: Vec<bool> = (0..n).map(|i| moves[i] && !doubtful(i)).collect();
        apart(&seen, &certain)
    } else {
        vec![false; n]
    };
    let mut null = null;
    for vector in null.chunks_exact_mut(n) {
        for (i, x) in vector.iter_mut().enumerate() {
            if !moves[i] || proved[i] {
                *x = T::zero();
            }
            if let Some(even) = &even {
                *x *= even.scale[i];
            }
        }
    }
    orthonormal(&mut null, n);
    let now = column_norms(&null, n);
    for i in 0..n {
        if proved[i] {
            continue;
        }
        if moves[i] {
            let share = (error[i] / open[i]).max(T::EPSILON * T::of(16.0));
            found.error[i] = now[i] * share;
        } else if vague(i) {
            found.undecided[i] = true;
            found.error[i] = stated[i];
        }
    }
    parts.null = null;
    found
}

/// By how much the part of each state in the null space may be off.
fn errors<T: Real>(rows: &Rows<'_, T>, root: &[T], null: &[T]) -> Vec<T> {
    let n = rows.n;
    let spread = column_norms(root, n);
    if rows.errors.is_empty() {
        return spread.iter().map(|&s| s * rows.rtol).collect();
    }
    // What the errors of each row make of the null vectors, at most.
    let open = column_norms(null, n);
    let each: Vec<T> = rows
        .errors
        .chunks_exact(n)
        .map(|errors| dot(errors, &open))
        .collect();
    let rounding = spectrum::default_rtol::<T>(rows.a.len() / n, n);
    (0..n)
        .map(|i| {
            // State i by the rows: its row of the pseudo-inverse is A Cov e_i.
            let mut by = vec![T::zero(); n];
            for axis in root.chunks_exact(n) {
                for (b, &w) in by.iter_mut().zip(axis) {
                    *b += w * axis[i];
                }
            }
            let terms: Vec<T> = rows
                .a
                .chunks_exact(n)
                .zip(&each)
                .map(|(row, &error)| dot(row, &by) * error)
                .collect();
            norm(&terms) * T::of(3.0) + spread[i] * rounding
        })
        .collect()
}

/// The same rows, all of one size, with what they determine and their null space.
struct Even<T> {
    a: Vec<T>,
    errors: Vec<T>,
    /// What the columns were multiplied by.
    scale: Vec<T>,
    parts: Parts<T>,
}

impl<T: Real> Even<T> {
    /// `None` where the rows are of about one size as they are, or where without their
    /// weights they do not show the same rank.
    fn new(rows: &Rows<'_, T>, parts: &Parts<T>) -> Option<Self> {
        let n = rows.n;
        if rows.exact.is_empty() && !parts.uneven && grade(rows.a, n) <= T::of(GRADED) {
            return None;
        }
        // All rows; or without those that were taken for rounding.
        Self::of(rows, parts, false).or_else(|| Self::of(rows, parts, true))
    }

    fn of(rows: &Rows<'_, T>, parts: &Parts<T>, cautious: bool) -> Option<Self> {
        let n = rows.n;
        let count = rows.exact.len() / n;
        let (mut a, mut errors) = (Vec::new(), Vec::new());
        let all = rows.exact.chunks_exact(n).chain(rows.a.chunks_exact(n));
        for (k, row) in all.enumerate() {
            let most = size(row);
            let along = |v: &[T]| dot(row, v).abs();
            let rest = parts.null.chunks_exact(n).map(along);
            let moved = rest.fold(T::zero(), T::max) > parts.touch * most * T::of(16.0);
            if most == T::zero() || (cautious && moved) {
                continue;
            }
            a.extend_from_slice(row);
            if !rows.errors.is_empty() {
                match k.checked_sub(count) {
                    None => errors.extend(core::iter::repeat_n(T::zero(), n)),
                    Some(k) => errors.extend_from_slice(&rows.errors[k * n..(k + 1) * n]),
                }
            }
        }
        let (by_row, mut scale) = balance(&a, n, rows.rtol, rows.units);
        for entries in [&mut a, &mut errors] {
            for (row, &r) in entries.chunks_exact_mut(n).zip(&by_row) {
                for (x, &d) in row.iter_mut().zip(&scale) {
                    *x *= r * d;
                }
            }
        }
        if !all_finite(&a) {
            return None;
        }
        let unit: Vec<T> = column_norms(&a, n).iter().map(|&x| inverse(x)).collect();
        for row in a.chunks_exact_mut(n).chain(errors.chunks_exact_mut(n)) {
            for (x, &d) in row.iter_mut().zip(&unit) {
                *x *= d;
            }
        }
        for (scale, &d) in scale.iter_mut().zip(&unit) {
            *scale *= d;
        }
        let mut parts = pivoted(&a, n, rows.rtol, parts.rank, &parts.values)?;
        orthonormal(&mut parts.null, n);
        let limit = rows.rtol * T::of(8.0);
        let same = a.chunks_exact(n).all(|row| {
            let along = parts.null.chunks_exact(n).map(|v| dot(row, v).abs());
            along.fold(T::zero(), T::max) <= limit * norm(row).max(T::one())
        });
        same.then_some(Self {
            a,
            errors,
            scale,
            parts,
        })
    }

    fn rows<'a>(&'a self, rows: &Rows<'a, T>) -> Rows<'a, T> {
        Rows {
            a: &self.a,
            errors: &self.errors,
            exact: &[],
            ..*rows
        }
    }
}

/// Which states rows determine whose entries are exactly zero in all states that move:
/// no part of a null vector in these, however small, fits such rows.
fn apart<T: Real>(rows: &Rows<'_, T>, moves: &[bool]) -> Vec<bool> {
    let n = rows.n;
    let mut moves = moves.to_vec();
    loop {
        let left: Vec<usize> = (0..n).filter(|&i| !moves[i]).collect();
        let m = left.len();
        let (mut a, mut errors) = (Vec::new(), Vec::new());
        for (k, row) in rows.a.chunks_exact(n).enumerate() {
            let off = rows.errors.get(k * n..(k + 1) * n);
            // A zero by differences has the error of a rounding.
            let accurate = size(row) * T::of(ACCURATE);
            let apart = (0..n).all(|i| {
                !moves[i] || (row[i] == T::zero() && off.is_none_or(|off| off[i] <= accurate))
            });
            if apart {
                a.extend(left.iter().map(|&i| row[i]));
                if let Some(off) = off {
                    errors.extend(left.iter().map(|&i| off[i]));
                }
            }
        }
        if m == 0 || a.is_empty() {
            return vec![false; n];
        }
        let mut parts = determined(&Rows {
            a: &a,
            errors: &errors,
            exact: &[],
            n: m,
            rtol: rows.rtol,
            units: &[],
        });
        orthonormal(&mut parts.null, m);
        let open = column_norms(&parts.null, m);
        let rounding = T::EPSILON * T::of(8.0 * m as f64);
        let mut more = false;
        for (&i, &open) in left.iter().zip(&open) {
            if open > rounding {
                moves[i] = true;
                more = true;
            }
        }
        if !more {
            return moves.iter().map(|m| !m).collect();
        }
    }
}
