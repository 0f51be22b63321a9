//! What rows determine of which, as they are weighted, some leave others to rounding.
//!
//! No weight of a row changes the rank: it is that of the rows at one size, of which none is
//! off by more than its share. Rows with errors of their own, and light ones that may be what
//! was left where heavier ones cancelled, are taken at the size at which their errors are
//! those of the others.
//!
//! # Source
//! Rows in the order of their size keep their digits in an orthogonal factorisation: Powell &
//! Reid 1969; Cox & Higham 1998, BIT 38. Hence each singular value of rows of one size is
//! that of rows which are off by rounding of their own.

use alloc::vec;
use alloc::vec::Vec;

use super::balance::{balance, inverse, is_uneven, scaled};
use super::parts::{First, GRADED, Parts, Rows, column_norms, grade, norm, pivoted, sort_rows};
use crate::scalar::{Real, all_finite};
use crate::spectrum;
use crate::square_root::triangularize;

/// Singular values of rows, descending; `None` where they are not found.
pub(super) type Values<'a, T> = dyn Fn(&[T]) -> Option<Vec<T>> + 'a;

/// What rows determine of which `first` does not show all directions.
pub(super) fn parts<T: Real>(
    rows: &Rows<'_, T>,
    first: &First<'_, T>,
    values: &Values<'_, T>,
) -> Parts<T> {
    let (n, rtol) = (rows.n, rows.rtol);
    if first.rank > 0 {
        let even = Even::new(rows);
        if even.uneven || grade(rows.a, n) > T::of(GRADED) {
            let s = even.values(rows, first, values);
            let rank = s.as_ref().map_or(0, |s| spectrum::rank(s, rtol));
            // Fewer where a pivot is rounding of its row.
            for rank in (first.rank..=rank.max(first.rank)).rev() {
                let s = s.as_deref().filter(|_| rank > first.rank);
                if let Some(parts) = even.parts(n, rtol, rank, s.unwrap_or(first.s)) {
                    return parts;
                }
            }
        }
    }
    first.parts(n, rtol)
}

/// Rows with their columns multiplied by `columns`, so that what `by_row` makes of them is of
/// one size.
struct Even<T> {
    a: Vec<T>,
    by_row: Vec<T>,
    columns: Vec<T>,
    /// Whether rows or columns differ by so much that some may be hidden by others.
    uneven: bool,
}

impl<T: Real> Even<T> {
    fn new(rows: &Rows<'_, T>) -> Self {
        let n = rows.n;
        let (mut by_row, mut columns) = balance(rows.a, n, rows.rtol, rows.units);
        let mut a = scaled(rows.a, &columns);
        if !all_finite(&a) || !all_finite(&by_row) {
            a = rows.a.to_vec();
            by_row.fill(T::one());
            columns.fill(T::one());
        }
        let uneven = is_uneven(&a, n, &columns);
        Self {
            a,
            by_row,
            columns,
            uneven,
        }
    }

    /// Singular values of the rows at one size; `None` where they say no more than `first`.
    fn values(
        &self,
        rows: &Rows<'_, T>,
        first: &First<'_, T>,
        values: &Values<'_, T>,
    ) -> Option<Vec<T>> {
        let (n, zero) = (rows.n, T::zero());
        let there = |row: &&[T]| row.iter().any(|&x| x != zero);
        if !self.uneven || self.a.chunks_exact(n).filter(there).count() <= first.rank {
            return None;
        }
        let mut b = self.a.clone();
        for (row, &r) in b.chunks_exact_mut(n).zip(&self.by_row) {
            for x in row {
                *x *= r;
            }
        }
        let unit: Vec<T> = column_norms(&b, n).iter().map(|&x| inverse(x)).collect();
        let mut b = scaled(&b, &unit);
        let each = self.columns.iter().zip(&unit);
        let columns: Vec<T> = each.map(|(&d, &u)| d * u).collect();
        let open = open(first, n, rows.rtol, &columns);
        let rounding = spectrum::default_rtol::<T>(rows.a.len() / n, n);
        let limit = rows.rtol.max(rounding);
        let cancelled = T::EPSILON.sqrt() * T::of(CANCELLED) * rounding / T::EPSILON;
        for (k, row) in b.chunks_exact_mut(n).enumerate() {
            let mut share = inverse(norm(row));
            let along = |off: &dyn Fn(usize) -> T| {
                let most = open.chunks_exact(n).fold(zero, |most: T, vector| {
                    let each = vector.iter().enumerate();
                    most.max(each.fold(zero, |sum, (i, &c)| sum + off(i) * c))
                });
                most * self.by_row[k] * share
            };
            // As rounding of columns of length 1 leaves it.
            let left = along(&|_| rounding);
            let mut doubt = if left <= cancelled { left } else { zero };
            if let Some(errors) = rows.errors.get(k * n..(k + 1) * n) {
                doubt = doubt.max(along(&|i| errors[i]) * T::of(3.0));
            }
            if doubt > limit {
                share *= limit / doubt;
            }
            for x in row {
                *x *= share;
            }
        }
        values(&b).filter(|s| all_finite(s))
    }

    /// What the rows determine with so many pivots.
    fn parts(&self, n: usize, rtol: T, rank: usize, s: &[T]) -> Option<Parts<T>> {
        let mut parts = pivoted(&self.a, n, rtol, rank, s)?;
        parts.root = scaled(&parts.root, &self.columns);
        parts.null = scaled(&parts.null, &self.columns);
        parts.log = self.columns.iter().fold(parts.log, |sum, &d| sum - d.ln());
        Some(parts)
    }
}

/// Light rows that cancelling of heavier ones would leave with an error above this times the
/// root of rounding have digits of their own: they were not made so.
const CANCELLED: f64 = 256.0;

/// The size of the parts of each direction that `first` leaves open, of unit length in states
/// multiplied by 1 / `columns`, times what takes errors of the rows there.
fn open<T: Real>(first: &First<'_, T>, n: usize, rtol: T, columns: &[T]) -> Vec<T> {
    let touch = spectrum::touch_tolerance(first.s, first.rank, rtol);
    let mut open = Vec::with_capacity((n - first.rank) * n);
    for vector in first.v[first.rank * n..].chunks_exact(n) {
        let each = vector.iter().zip(first.scale).zip(columns);
        // What is rounding of the vector moves nothing.
        let even: Vec<T> = each
            .map(|((&x, &d), &column)| {
                if x.abs() <= touch {
                    T::zero()
                } else {
                    (x * d / column).abs()
                }
            })
            .collect();
        let length = inverse(norm(&even));
        open.extend(even.iter().zip(columns).map(|(&x, &d)| x * length * d));
    }
    open
}

/// Singular values of rows of length `n`, descending.
pub(super) fn values<T: Real>(rows: &[T], n: usize) -> Vec<T> {
    let mut factor = sort_rows(rows, n);
    factor.resize((rows.len() / n).max(n) * n, T::zero());
    let (mut s, mut v) = (vec![T::zero(); n], vec![T::zero(); n * n]);
    let (ones, mut work) = (vec![T::one(); n], vec![T::zero(); n * n]);
    triangularize(&mut factor, n, &mut work[..n]);
    spectrum::decompose(&factor[..n * n], n, &ones, &mut s, &mut v, &mut work);
    s
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::observability::Observability;

    fn rank(rows: &[[f64; 3]], sizes: &[i32]) -> usize {
        let each = rows.iter().zip(sizes);
        let rows: alloc::vec::Vec<f64> = each
            .flat_map(|(row, &size)| row.map(|x| x * 2.0_f64.powi(size)))
            .collect();
        Observability::new(&rows, 3, None).unwrap().rank()
    }

    #[test]
    fn dependent_rows_show_no_more_at_any_weight() {
        // Twice the second and the third are the first.
        let rows = [[0.0, -1.0, 16.0], [2.0, 9.0, 16.0], [-4.0, -19.0, -16.0]];
        let sizes = [-60, -45, -40, -14, 0, 10, 33, 50];
        for a in sizes {
            for b in sizes {
                for c in sizes {
                    assert_eq!(rank(&rows, &[a, b, c]), 2, "{a} {b} {c}");
                }
            }
        }
    }

    #[test]
    fn a_light_row_that_sees_little_counts() {
        // Their determinant is -1e-8, and the lightest row sees the null vector of the
        // others, (1, -1, 0), by as much of its size.
        let rows = [[1.0, 1.0, 1.0], [1.0, 1.0, 2.0], [1.0, 1.0 + 1e-8, 4.0]];
        for sizes in [[30, -20, -70], [-70, 30, -20], [0, 0, -60], [0, -60, -60]] {
            assert_eq!(rank(&rows, &sizes), 3, "{sizes:?}");
        }
    }

    #[test]
    fn what_is_left_of_heavy_rows_shows_their_rounding() {
        // Of rank 1 but for rounding, which is 1e-8 of the difference.
        let heavy = [0.1, 0.7, 0.3];
        let other = heavy.map(|x| x * (1.0 + 1e-8 / 3.0));
        let left = [0, 1, 2].map(|i| other[i] - heavy[i]);
        assert_eq!(rank(&[heavy, other, left], &[0, 0, 0]), 1);
    }

    #[test]
    fn errors_of_a_row_count_for_its_own_size() {
        let light = 2.0_f64.powi(-60);
        let rows = [1.0, 1.0, light, 2.0 * light, light, 3.0 * light];
        let rank = |error: [f64; 2]| {
            let errors = [0.0, 0.0, error[0], error[0], error[1], error[1]];
            let found = Observability::inexact(&rows, &errors, &[], 2, None).unwrap();
            found.rank()
        };
        assert_eq!(rank([0.0, 0.0]), 2);
        assert_eq!(rank([0.01 * light, light]), 2);
        assert_eq!(rank([light, 0.01 * light]), 2);
        assert_eq!(rank([light, light]), 1);
    }

    #[test]
    fn what_is_rounding_by_the_tolerance_sets_no_weights() {
        // Ranges and azimuths of two sensors at targets between them: that the two ranges
        // are told apart is rounding of the positions.
        let mut rows = alloc::vec::Vec::new();
        for i in 0..60 {
            let t = 0.05 + 0.015 * f64::from(i);
            let off = 1e-12 * (1.0 + (7.0 * t).sin());
            rows.extend([7e-4, 2e-20, 7e-4, 0.0]);
            rows.extend([-off, 1e5 * t, off, 1e5 * (1.0 - t)]);
        }
        let found = Observability::new(&rows, 4, Some(2.4e-7)).unwrap();
        assert_eq!(found.rank(), 3);
        let std = found.crlb_std();
        let determined: alloc::vec::Vec<bool> = std.iter().map(|s| s.is_finite()).collect();
        assert_eq!(determined, [false, true, false, true]);
    }
}
