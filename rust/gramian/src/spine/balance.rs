//! Rows and columns of one size: neither the rank of rows nor which states their null space
//! moves depends on the weight of a row or on the unit of a state.

use alloc::vec;
use alloc::vec::Vec;

use super::observability::{GRADED, grade};
use crate::scalar::Real;

/// The largest entry.
pub(super) fn size<T: Real>(row: &[T]) -> T {
    row.iter().fold(T::zero(), |m, x| m.max(x.abs()))
}

/// 1 / x; 1 where that is not finite.
pub(super) fn inverse<T: Real>(x: T) -> T {
    let inverse = T::one() / x;
    if inverse.is_finite() {
        inverse
    } else {
        T::one()
    }
}

/// Powers of two for rows and columns that bring the entries near 1, in the mean of their
/// logarithms: an exact zero stays one, and what cancels does. `units` is what the columns
/// were multiplied by, or nothing.
///
/// # Source
/// Curtis & Reid 1972, "On the automatic scaling of matrices for Gaussian elimination",
/// J. Inst. Maths Applics 10.
pub(super) fn balance<T: Real>(a: &[T], n: usize, units: &[T]) -> (Vec<T>, Vec<T>) {
    let mut rows = vec![T::zero(); a.len() / n];
    let mut columns = vec![T::zero(); n];
    // An entry far below the largest of its row, in the units given too, may be rounding.
    let rounding = T::EPSILON * T::of(16.0);
    let given = |row: &[T]| -> Vec<T> {
        let each = row.iter().enumerate();
        each.map(|(j, &x)| units.get(j).map_or(x, |&d| x / d))
            .collect()
    };
    let entries: Vec<(usize, usize, T)> = a
        .chunks_exact(n)
        .enumerate()
        .flat_map(|(i, row)| {
            let given = given(row);
            let (least, least_given) = (size(row) * rounding, size(&given) * rounding);
            let seen = row.iter().zip(given).enumerate();
            seen.filter(move |(_, (x, y))| x.abs() > least || y.abs() > least_given)
                .filter(|(_, (x, _))| **x != T::zero())
                .map(move |(j, (x, _))| (i, j, x.abs().ln()))
        })
        .collect();
    let (mut by_row, mut by_column) = (vec![T::zero(); rows.len()], vec![T::zero(); n]);
    for &(i, j, _) in &entries {
        by_row[i] += T::one();
        by_column[j] += T::one();
    }
    for _ in 0..SWEEPS {
        rows.fill(T::zero());
        for &(i, j, log) in &entries {
            rows[i] -= (log + columns[j]) / by_row[i];
        }
        columns.fill(T::zero());
        for &(i, j, log) in &entries {
            columns[j] -= (log + rows[i]) / by_column[j];
        }
    }
    let power = |log: T| {
        let bits = (log / T::of(core::f64::consts::LN_2)).round().double();
        #[allow(clippy::cast_possible_truncation)] // At most as many as a number has.
        T::of(2.0).powi(bits as i32)
    };
    (
        rows.into_iter().map(power).collect(),
        columns.into_iter().map(power).collect(),
    )
}

/// Enough to be within a factor of a few of the best.
const SWEEPS: usize = 20;

/// Rows with their columns multiplied by `columns`.
pub(super) fn scaled<T: Real>(rows: &[T], columns: &[T]) -> Vec<T> {
    let n = columns.len();
    let each = |row: &[T]| -> Vec<T> { row.iter().zip(columns).map(|(&x, &d)| x * d).collect() };
    rows.chunks_exact(n).flat_map(each).collect()
}

/// Whether rows whose columns were multiplied by what brings the entries near 1, or these
/// columns, differ by so much in size that some may be hidden by others.
pub(super) fn is_uneven<T: Real>(rows: &[T], n: usize, columns: &[T]) -> bool {
    grade(rows, n) > T::of(GRADED) || grade(columns, 1) > T::of(GRADED)
}
