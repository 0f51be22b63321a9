//! Rows and columns of one size: neither the rank of rows nor which states their null space
//! moves depends on the weight of a row or on the unit of a state.

use alloc::vec;
use alloc::vec::Vec;

use super::parts::{GRADED, grade};
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
/// logarithms: an exact zero stays one, and what cancels does. Entries that may be rounding,
/// or are below `rtol` of the largest of their row, do not count. `units` is what the columns
/// were multiplied by, or nothing.
///
/// # Source
/// Curtis & Reid 1972, "On the automatic scaling of matrices for Gaussian elimination",
/// J. Inst. Maths Applics 10.
pub(super) fn balance<T: Real>(a: &[T], n: usize, rtol: T, units: &[T]) -> (Vec<T>, Vec<T>) {
    let mut rows = vec![T::zero(); a.len() / n];
    let (mut columns, mut sums) = (vec![T::zero(); n], vec![T::zero(); n]);
    // An entry far below the largest of its row, in the units given too, may be rounding.
    let rounding = rtol.max(T::EPSILON * T::of(16.0));
    let mut entries: Vec<(usize, usize, T)> = Vec::with_capacity(a.len());
    for (i, row) in a.chunks_exact(n).enumerate() {
        let given = |j: usize, x: T| units.get(j).map_or(x, |&d| x / d).abs();
        let least = size(row) * rounding;
        // Mostly no entry is so small that the units given are asked.
        let mut least_given = None;
        for (j, &x) in row.iter().enumerate() {
            if x.abs() <= least {
                let least_given = *least_given.get_or_insert_with(|| {
                    let each = row.iter().enumerate();
                    each.fold(T::zero(), |m, (j, &x)| m.max(given(j, x))) * rounding
                });
                if x == T::zero() || given(j, x) <= least_given {
                    continue;
                }
            }
            entries.push((i, j, x.abs().ln()));
        }
    }
    let (mut by_row, mut by_column) = (vec![T::zero(); rows.len()], vec![T::zero(); n]);
    for &(i, j, _) in &entries {
        by_row[i] += T::one();
        by_column[j] += T::one();
    }
    for _ in 0..SWEEPS {
        rows.fill(T::zero());
        for &(i, j, log) in &entries {
            rows[i] -= log + columns[j];
        }
        for (row, &count) in rows.iter_mut().zip(&by_row) {
            *row /= count.max(T::one());
        }
        sums.fill(T::zero());
        for &(i, j, log) in &entries {
            sums[j] -= log + rows[i];
        }
        let mut moved = T::zero();
        for ((column, &sum), &count) in columns.iter_mut().zip(&sums).zip(&by_column) {
            let mean = sum / count.max(T::one());
            moved = moved.max((mean - *column).abs());
            *column = mean;
        }
        // Powers of two are coarser than this.
        if moved < T::of(0.1) {
            break;
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
