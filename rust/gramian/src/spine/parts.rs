//! What rows determine and what they do not: the root of the covariance and the null space,
//! from a factorisation with or without pivots.

use alloc::vec;
use alloc::vec::Vec;

use crate::numbers::algebra::dot_slices as dot;
use crate::scalar::Real;
use crate::spectrum;
use crate::square_root::{reflect, triangularize};

use super::light_rows;

/// Rows with columns of unit length, their errors, or none, what is known exactly, and what
/// the columns were multiplied by, or nothing.
#[derive(Clone, Copy)]
pub(super) struct Rows<'a, T> {
    pub a: &'a [T],
    pub errors: &'a [T],
    pub exact: &'a [T],
    pub n: usize,
    pub rtol: T,
    pub units: &'a [T],
}

/// What is determined and what is not, in some coordinates.
#[derive(Clone, Debug)]
pub(super) struct Parts<T> {
    /// Vectors w of length n with Cov = sum w w^T, one after the other.
    pub root: Vec<T>,
    /// Basis of what is not determined.
    pub null: Vec<T>,
    /// Singular values, of the rows at one size where light ones count; infinite for exact
    /// knowledge.
    pub values: Vec<T>,
    /// Logarithm of the root of the determinant of the information.
    pub log: T,
    /// Which vector of `root` is the longest axis.
    pub weakest: usize,
    /// Share in the null space above which no state is at rest, whichever it is.
    pub touch: T,
    /// Whether rows differ so much in size that some may be hidden by others.
    pub uneven: bool,
    pub rank: usize,
}

/// Singular values and right vectors of rows as they are weighted, with columns multiplied
/// by `scale`, and how many of them count.
#[derive(Clone, Copy)]
pub(super) struct First<'a, T> {
    pub scale: &'a [T],
    pub s: &'a [T],
    pub v: &'a [T],
    pub rank: usize,
}

impl<T: Real> First<'_, T> {
    /// What the spectrum alone says.
    pub(super) fn parts(&self, n: usize, rtol: T) -> Parts<T> {
        let &Self { scale, s, v, rank } = self;
        let of = |k: usize, size: T| {
            let each = v[k * n..(k + 1) * n].iter().zip(scale);
            each.map(move |(&x, &d)| x / size * d)
        };
        let log = s[..rank].iter().fold(T::zero(), |sum, x| sum + x.ln());
        Parts {
            root: (0..rank).flat_map(|k| of(k, s[k])).collect(),
            null: (rank..n).flat_map(|k| of(k, T::one())).collect(),
            values: s.to_vec(),
            log: scale.iter().fold(log, |sum, &d| sum - d.ln()),
            weakest: rank.saturating_sub(1),
            touch: spectrum::touch_tolerance(s, rank, rtol),
            uneven: false,
            rank,
        }
    }
}

/// What rows determine; nothing is known exactly.
pub(super) fn determined<T: Real>(rows: &Rows<'_, T>) -> Parts<T> {
    let &Rows { a, n, rtol, .. } = rows;
    let count = a.len() / n;
    let (mut scale, mut s) = (vec![T::one(); n], vec![T::zero(); n]);
    let (mut v, mut work) = (vec![T::zero(); n * n], vec![T::zero(); n * n]);
    let mut factor = sort_rows(a, n);
    factor.resize(count.max(n) * n, T::zero());
    triangularize(&mut factor, n, &mut work[..n]);
    factor.truncate(n * n);
    spectrum::unit_columns(&factor, n, &mut scale);
    spectrum::decompose(&factor, n, &scale, &mut s, &mut v, &mut work);
    let first = First {
        scale: &scale,
        s: &s,
        v: &v,
        // With a tolerance of next to nothing rounding counts too, but no more than the rows.
        rank: spectrum::rank(&s, rtol).min(count),
    };
    let mut parts = if first.rank < n {
        light_rows::parts(rows, &first, &|b| Some(light_rows::values(b, n)))
    } else if grade(a, n) > T::of(GRADED) {
        pivoted(a, n, rtol, n, &s).unwrap_or_else(|| first.parts(n, rtol))
    } else {
        first.parts(n, rtol)
    };
    parts.rank = n - parts.null.len() / n;
    parts
}

/// What rows determine where the combinations `exact` are known exactly: the null-space
/// method (Golub & Van Loan, section 6.2).
pub(super) fn with_exact<T: Real>(rows: &Rows<'_, T>) -> Parts<T> {
    let &Rows {
        a,
        errors,
        exact,
        n,
        rtol,
        ..
    } = rows;
    let mut unit = exact.to_vec();
    for row in unit.chunks_exact_mut(n) {
        let length = norm(row);
        if length > T::zero() {
            for x in row {
                *x /= length;
            }
        }
    }
    let count = unit.len() / n;
    unit.resize(count.max(n) * n, T::zero());
    let (mut s, mut v) = (vec![T::zero(); n], vec![T::zero(); n * n]);
    let (ones, mut work) = (vec![T::one(); n], vec![T::zero(); n * n]);
    triangularize(&mut unit, n, &mut work[..n]);
    spectrum::decompose(&unit[..n * n], n, &ones, &mut s, &mut v, &mut work);
    let known = spectrum::rank(&s, spectrum::default_rtol(count, n));
    let p = n - known;
    if p == 0 {
        return Parts {
            root: Vec::new(),
            null: Vec::new(),
            values: vec![T::INFINITY; n],
            log: T::INFINITY,
            weakest: 0,
            touch: T::EPSILON,
            uneven: false,
            rank: n,
        };
    }
    let clean = T::EPSILON * T::of(16.0);
    let open: Vec<Vec<T>> = (known..n)
        .map(|k| {
            let tidy = |&x: &T| if x.abs() <= clean { T::zero() } else { x };
            v[k * n..(k + 1) * n].iter().map(tidy).collect()
        })
        .collect();
    let mut rest = Vec::with_capacity(a.len() / n * p);
    let mut doubt = Vec::with_capacity(a.len() / n * p);
    for (k, row) in a.chunks_exact(n).enumerate() {
        let errors = errors.get(k * n..(k + 1) * n).unwrap_or_default();
        for vector in &open {
            let sum = dot(row, vector);
            let share = |row: &[T]| {
                let each = row.iter().zip(vector);
                each.fold(T::zero(), |sum, (&r, &c)| sum + (r * c).abs())
            };
            let rounding = T::EPSILON * T::of(8.0) * share(row);
            rest.push(if sum.abs() <= rounding {
                T::zero()
            } else {
                sum
            });
            // A row of which little is left has the rounding of what it was.
            doubt.push(share(errors) + T::EPSILON * share(row));
        }
    }
    let below = determined(&Rows {
        a: &rest,
        errors: &doubt,
        exact: &[],
        n: p,
        rtol,
        units: &[],
    });
    let lift = |y: &[T]| -> Vec<T> {
        let mut x = vec![T::zero(); n];
        for (vector, &y) in open.iter().zip(y) {
            for (x, &c) in x.iter_mut().zip(vector) {
                *x += y * c;
            }
        }
        x
    };
    let mut values = vec![T::INFINITY; known];
    values.extend_from_slice(&below.values);
    let null: Vec<T> = below.null.chunks_exact(p).flat_map(lift).collect();
    Parts {
        root: below.root.chunks_exact(p).flat_map(lift).collect(),
        rank: n - null.len() / n,
        null,
        values,
        log: T::INFINITY,
        weakest: below.weakest,
        touch: below.touch.max(clean),
        uneven: below.uneven,
    }
}

/// Rows of different weight: a factor found with rows sorted and columns pivoted, which
/// keeps the digits of every row. `None` where fewer than `rank` pivots are above the
/// rounding of their rows and columns.
///
/// # Source
/// Cox & Higham 1998, BIT 38; Powell & Reid 1969.
pub(super) fn pivoted<T: Real>(
    a: &[T],
    n: usize,
    rtol: T,
    rank: usize,
    s: &[T],
) -> Option<Parts<T>> {
    let mut r = sort_rows(a, n);
    let count = (r.len() / n).max(n);
    r.resize(count * n, T::zero());
    let mut work = vec![T::zero(); n];
    let mut order: Vec<usize> = (0..n).collect();
    let size = |row: &[T]| row.iter().fold(T::zero(), |m, x| m.max(x.abs()));
    let mut largest: Vec<T> = r.chunks_exact(n).map(size).collect();
    let mut lengths = column_norms(a, n);
    let rounding = T::EPSILON * T::of(16.0);
    for k in 0..rank {
        // Rounding of a row is that of its largest entry so far, of a column of its length.
        for (row, &most) in r.chunks_exact_mut(n).zip(&largest).skip(k) {
            for (x, &length) in row[k..].iter_mut().zip(&lengths[k..]) {
                if x.abs() <= rounding * most.min(length) {
                    *x = T::zero();
                }
            }
        }
        let left = column_norms(&r[k * n..], n);
        let mut best = k;
        for j in k..n {
            if left[j] > left[best] {
                best = j;
            }
        }
        if !(left[best] > T::zero()) {
            return None;
        }
        if best != k {
            order.swap(k, best);
            lengths.swap(k, best);
            for row in r.chunks_exact_mut(n) {
                row.swap(k, best);
            }
        }
        // The rows that are left, largest in this column first.
        let mut top = k;
        for i in k..count {
            if r[i * n + k].abs() > r[top * n + k].abs() {
                top = i;
            }
        }
        if top != k {
            largest.swap(k, top);
            for j in 0..n {
                r.swap(k * n + j, top * n + j);
            }
        }
        reflect(&mut r, n, k, k, &mut work);
        for (row, most) in r.chunks_exact(n).zip(&mut largest).skip(k) {
            *most = most.max(size(row));
        }
    }
    // R11 y = right side by substitution from the last, as a vector of all states.
    let solve = |mut right: Vec<T>| -> Vec<T> {
        for i in (0..rank).rev() {
            for j in i + 1..rank {
                right[i] = right[i] - r[i * n + j] * right[j];
            }
            right[i] /= r[i * n + i];
        }
        right
    };
    let mut root = vec![T::zero(); rank * n];
    for (k, axis) in root.chunks_exact_mut(n).enumerate() {
        let mut right = vec![T::zero(); rank];
        right[k] = T::one();
        for (i, x) in solve(right).into_iter().enumerate() {
            axis[order[i]] = x;
        }
    }
    let mut null = vec![T::zero(); (n - rank) * n];
    for (k, vector) in null.chunks_exact_mut(n).enumerate() {
        let right = (0..rank).map(|i| -r[i * n + rank + k]).collect();
        for (i, x) in solve(right).into_iter().enumerate() {
            vector[order[i]] = x;
        }
        vector[order[rank + k]] = T::one();
    }
    let length = |k: usize| norm(&root[k * n..(k + 1) * n]);
    let weakest = (0..rank)
        .max_by(|&i, &j| {
            length(i)
                .partial_cmp(&length(j))
                .unwrap_or(core::cmp::Ordering::Equal)
        })
        .unwrap_or(0);
    Some(Parts {
        root,
        null,
        touch: rtol.max(T::EPSILON.sqrt() * T::of(1e-2)).min(T::of(1e-2)),
        uneven: true,
        values: s.to_vec(),
        log: (0..rank).fold(T::zero(), |sum, i| sum + r[i * n + i].abs().ln()),
        weakest,
        rank,
    })
}

/// Rows that differ more in size lose digits in a factorisation without pivots.
pub(crate) const GRADED: f64 = 1e3;

/// Largest over smallest size of the rows that are not zero.
pub(crate) fn grade<T: Real>(a: &[T], n: usize) -> T {
    let (mut least, mut most) = (T::MAX, T::zero());
    for row in a.chunks_exact(n) {
        let size = row.iter().fold(T::zero(), |m, x| m.max(x.abs()));
        if size > T::zero() {
            least = least.min(size);
            most = most.max(size);
        }
    }
    if most > T::zero() {
        most / least
    } else {
        T::one()
    }
}

/// Rows by decreasing largest entry: reflections keep the digits of each then.
pub(super) fn sort_rows<T: Real>(a: &[T], n: usize) -> Vec<T> {
    let size = |i: usize| {
        a[i * n..(i + 1) * n]
            .iter()
            .fold(T::zero(), |m, x| m.max(x.abs()))
    };
    let count = a.len() / n;
    let sizes: Vec<T> = (0..count).map(size).collect();
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&i, &j| {
        sizes[j]
            .partial_cmp(&sizes[i])
            .unwrap_or(core::cmp::Ordering::Equal)
    });
    order
        .iter()
        .flat_map(|&i| a[i * n..(i + 1) * n].iter().copied())
        .collect()
}

pub(super) fn column_norms<T: Real>(rows: &[T], n: usize) -> Vec<T> {
    let mut largest = vec![T::zero(); n];
    for row in rows.chunks_exact(n) {
        for (l, x) in largest.iter_mut().zip(row) {
            *l = (*l).max(x.abs());
        }
    }
    let inverse: Vec<T> = largest
        .iter()
        .map(|&l| {
            let inverse = T::one() / l;
            if inverse.is_finite() {
                inverse
            } else {
                T::zero()
            }
        })
        .collect();
    let mut sums = vec![T::zero(); n];
    for row in rows.chunks_exact(n) {
        for ((s, &x), &d) in sums.iter_mut().zip(row).zip(&inverse) {
            let ratio = x * d;
            *s += ratio * ratio;
        }
    }
    sums.iter()
        .zip(&largest)
        .map(|(s, &l)| l * s.sqrt())
        .collect()
}

pub(super) fn norm<T: Real>(x: &[T]) -> T {
    let largest = x.iter().fold(T::zero(), |a, x| a.max(x.abs()));
    if !(largest > T::zero() && largest.is_finite()) {
        return largest;
    }
    let sum = x.iter().fold(T::zero(), |sum, &x| {
        let ratio = x / largest;
        sum + ratio * ratio
    });
    largest * sum.sqrt()
}

/// Makes vectors of length `n` orthonormal (modified Gram-Schmidt, twice).
pub(super) fn orthonormal<T: Real>(vectors: &mut [T], n: usize) {
    let count = vectors.len() / n;
    for k in 0..count {
        for _ in 0..2 {
            let (before, rest) = vectors.split_at_mut(k * n);
            let vector = &mut rest[..n];
            for other in before.chunks_exact(n) {
                let along = dot(other, vector);
                for (x, &o) in vector.iter_mut().zip(other) {
                    *x -= along * o;
                }
            }
            let length = norm(vector);
            if length > T::zero() {
                for x in vector.iter_mut() {
                    *x /= length;
                }
            }
        }
    }
}
