//! The square-root information factor: R upper triangular with R^T R = J.
//!
//! Working on the rows by orthogonal transformations keeps all digits of the
//! data; forming J first would lose half of them. Streaming data enters row by
//! row through Givens rotations; a finished array of rows is reduced at once by
//! Householder reflections. Both give the same factor up to the sign of its rows.

use crate::rows::RowSink;
use crate::scalar::{Real, hypot};

/// The triangular factor of the information in all rows pushed so far.
///
/// No allocation; a push costs O(N^2) operations.
///
/// ```
/// use gramian::{rows::RowSink, square_root::SquareRoot};
/// let mut root = SquareRoot::<f64, 2>::new();
/// root.push(&[3.0, 1.0]);
/// root.push(&[4.0, 2.0]);
/// // R^T R is the sum of row^T row.
/// let r = root.factor();
/// assert!((r[0][0] * r[0][0] - 25.0).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SquareRoot<T, const N: usize> {
    factor: [[T; N]; N],
    count: u32,
}

impl<T: Real, const N: usize> SquareRoot<T, N> {
    /// The factor of no information.
    pub fn new() -> Self {
        Self {
            factor: [[T::zero(); N]; N],
            count: 0,
        }
    }

    /// The upper triangular factor, row by row.
    pub fn factor(&self) -> &[[T; N]; N] {
        &self.factor
    }

    /// How many rows were pushed (it saturates at `u32::MAX`).
    pub fn count(&self) -> u32 {
        self.count
    }

    /// The same factor with another count: of rows that were changed in place.
    pub(crate) fn with_count(mut self, count: u32) -> Self {
        self.count = count;
        self
    }

    /// Adds the information of another factor of the same states.
    pub fn merge(&mut self, other: &Self) {
        let count = self.count.saturating_add(other.count);
        for row in &other.factor {
            self.push(row);
        }
        self.count = count;
    }

    /// Multiplies all information so far by `factor`: a forgetting factor
    /// between 0 and 1 that lets old rows fade.
    pub fn scale_information(&mut self, factor: T) {
        let root = factor.abs().sqrt();
        for value in self.factor.as_flattened_mut() {
            *value *= root;
        }
    }

    /// |det R|, the square root of the determinant of the information.
    pub fn determinant(&self) -> T {
        (0..N).fold(T::one(), |product, i| product * self.factor[i][i].abs())
    }
}

impl<T: Real, const N: usize> Default for SquareRoot<T, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real, const N: usize> RowSink<T, N> for SquareRoot<T, N> {
    fn push(&mut self, row: &[T; N]) {
        let mut row = *row;
        rotate_in(self.factor.as_flattened_mut(), &mut row);
        self.count = self.count.saturating_add(1);
    }
}

/// Rotates one row into the n x n upper triangular factor `r` (row-major), with
/// n the length of `row`. What is left in `row` is zero.
///
/// # Source
/// Givens rotations, Golub & Van Loan, Matrix Computations, section 5.1.
pub fn rotate_in<T: Real>(r: &mut [T], row: &mut [T]) {
    let n = row.len();
    for k in 0..n {
        let b = row[k];
        if b == T::zero() {
            continue;
        }
        let a = r[k * n + k];
        let h = hypot(a, b);
        let (c, s) = (a / h, b / h);
        r[k * n + k] = h;
        row[k] = T::zero();
        for j in k + 1..n {
            let (x, y) = (r[k * n + j], row[j]);
            r[k * n + j] = c * x + s * y;
            row[j] = c * y - s * x;
        }
    }
}

/// Reduces `a` (rows of length `n`, row-major) to upper triangular form in
/// place: the factor ends in the first `n` rows, the rest is zero.
///
/// # Source
/// Householder reflections, Golub & Van Loan, section 5.2.
pub fn triangularize<T: Real>(a: &mut [T], n: usize, work: &mut [T]) {
    let rows = a.len().checked_div(n).unwrap_or(0);
    for k in 0..n.min(rows) {
        reflect(a, n, k, k, work);
    }
}

/// Reflects rows `top..`, zero in all columns before `column`, so that this
/// column vanishes below row `top`.
pub(crate) fn reflect<T: Real>(a: &mut [T], n: usize, top: usize, column: usize, work: &mut [T]) {
    let (head, tail) = a[top * n..].split_at_mut(n);
    let mut largest = head[column].abs();
    for row in tail.chunks_exact(n) {
        largest = largest.max(row[column].abs());
    }
    if largest == T::zero() {
        return;
    }
    // Scaled, so that units however large or small neither overflow nor vanish.
    let unit = T::one() / largest;
    if !unit.is_finite() {
        // Smaller than any normal number: nothing.
        return;
    }
    let mut sum = (head[column] * unit) * (head[column] * unit);
    for row in tail.chunks_exact(n) {
        let x = row[column] * unit;
        sum += x * x;
    }
    let norm = largest * sum.sqrt();
    let alpha = if head[column] > T::zero() {
        -norm
    } else {
        norm
    };
    let v0 = head[column] - alpha;
    // H = I - v v^T / beta, with v = (v0, tail column) and beta = -alpha v0.
    let beta = -alpha * v0;
    // Columns before `column` are zero in these rows already.
    let head = &mut head[column..];
    let work = &mut work[..head.len()];
    for (w, &x) in work.iter_mut().zip(&*head) {
        *w = v0 / beta * x;
    }
    for row in tail.chunks_exact(n) {
        let row = &row[column..];
        let v = row[0] / beta;
        for (w, &x) in work.iter_mut().zip(row) {
            *w += v * x;
        }
    }
    for (x, &w) in head.iter_mut().zip(&*work) {
        *x -= v0 * w;
    }
    head[0] = alpha;
    for row in tail.chunks_exact_mut(n) {
        let row = &mut row[column..];
        let v = row[0];
        for (x, &w) in row.iter_mut().zip(&*work) {
            *x -= v * w;
        }
        row[0] = T::zero();
    }
}

/// Eliminates the first `p` states from rows of length `n`: afterwards the rows
/// from the returned index on carry, in columns `p..`, exactly the information
/// that is left on the other states when nothing is known of the first `p`.
///
/// This is the Schur complement of the information, found without forming it.
/// Columns are pivoted and their rank decided on their own scale, so that
/// states which are not determined at all take no information with them.
pub fn eliminate<T: Real>(a: &mut [T], n: usize, p: usize, rtol: T, work: &mut [T]) -> usize {
    let rows = a.len().checked_div(n).unwrap_or(0);
    let norm_below = |a: &[T], j: usize, top: usize| {
        (top..rows).fold(T::zero(), |norm, i| hypot(norm, a[i * n + j]))
    };
    let (whole, rest) = work.split_at_mut(p);
    for j in 0..p {
        whole[j] = norm_below(a, j, 0);
    }
    let mut rank = 0;
    while rank < p.min(rows) {
        let mut best = (T::zero(), rank);
        for j in rank..p {
            if whole[j] > T::zero() {
                let left = norm_below(a, j, rank) / whole[j];
                if left > best.0 {
                    best = (left, j);
                }
            }
        }
        if best.0 <= rtol {
            break;
        }
        if best.1 != rank {
            for row in a.chunks_exact_mut(n) {
                row.swap(rank, best.1);
            }
            whole.swap(rank, best.1);
        }
        reflect(a, n, rank, rank, rest);
        rank += 1;
    }
    rank
}
