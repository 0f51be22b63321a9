//! The square-root information factor: R upper triangular with R^T R = J.
//!
//! Working on the rows by orthogonal transformations keeps all digits of the
//! data; forming J first would lose half of them. Streaming data enters row by
//! row through Givens rotations; a finished array of rows is reduced at once by
//! Householder reflections. Both give the same factor up to the sign of its rows.

use crate::bound;
use crate::rows::RowSink;
use crate::scalar::{NumberError, Real, check_finite, hypot};
use crate::spectrum::Spectrum;

/// The triangular factor of the information in all rows pushed so far, and what
/// follows from it: rank, null directions, bound, determinant.
///
/// No allocation; a push costs O(N^2) operations, an answer O(N^3). The answers
/// are those of [`Spectrum`] at its default tolerance: who wants several of them
/// makes one spectrum and asks that.
///
/// Entries up to the largest number of the type over 2 N are held; information
/// beyond is refused, so that no answer overflows on its way.
///
/// # Source
/// Square-root information filtering: Bierman 1977, Factorization Methods for Discrete
/// Sequential Estimation, chapters IV and V; Givens rotations: Golub & Van Loan, Matrix
/// Computations, 5.1.
///
/// ```
/// use gramian::square_root::SquareRootInformation;
/// // A position and a velocity. At time t the position is measured: [1, t].
/// let mut information = SquareRootInformation::<f64, 2>::new();
/// information.push(&[1.0, 0.0])?;
/// assert_eq!(information.rank(), 1);
/// // The velocity is free, and nothing else.
/// assert_eq!(information.null_direction(0), Some([0.0, 1.0]));
/// assert_eq!(information.crlb_std(), [1.0, f64::INFINITY]);
///
/// // Another sensor's rows, reduced elsewhere.
/// let mut other = SquareRootInformation::new();
/// other.push(&[1.0, 2.0])?;
/// information.merge(&other)?;
/// assert_eq!(information.rank(), 2);
/// assert!((information.determinant() - 4.0).abs() < 1e-12);
///
/// // What is old counts half: each bound grows by sqrt 2.
/// let before = information.crlb_std();
/// information.forget(0.5)?;
/// assert!((information.crlb_std()[1] / before[1] - 2.0_f64.sqrt()).abs() < 1e-12);
/// # Ok::<(), gramian::scalar::NumberError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SquareRootInformation<T, const N: usize> {
    factor: [[T; N]; N],
    count: u32,
}

impl<T: Real, const N: usize> SquareRootInformation<T, N> {
    /// No information.
    pub fn new() -> Self {
        Self {
            factor: [[T::zero(); N]; N],
            count: 0,
        }
    }

    /// The upper triangular factor, row by row: R with R^T R the information. Its
    /// entries are finite.
    pub fn factor(&self) -> &[[T; N]; N] {
        &self.factor
    }

    /// How many rows were pushed (it saturates at `u32::MAX`).
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Takes in one whitened row.
    ///
    /// # Errors
    /// [`NumberError::NotFinite`] with the entry, [`NumberError::Overflow`] where
    /// the information overflows. The row is not taken in
    /// then.
    #[inline]
    pub fn push(&mut self, row: &[T; N]) -> Result<(), NumberError> {
        check_finite("row", row)?;
        let mut next = *self;
        next.absorb(row);
        if !(within::<T, N>(row) && next.is_sound()) {
            return Err(OVERFLOW);
        }
        *self = next;
        Ok(())
    }

    /// [`push`](Self::push) for rows that need no check, or for many of them with
    /// one check, [`is_sound`](Self::is_sound), at the end.
    #[inline]
    pub(crate) fn absorb(&mut self, row: &[T; N]) {
        let mut row = *row;
        rotate_in(self.factor.as_flattened_mut(), &mut row);
        self.count = self.count.saturating_add(1);
    }

    /// [`absorb`](Self::absorb) for several rows at once, which are overwritten: one square
    /// root for each column instead of one for each of its entries.
    #[cfg(feature = "std")]
    pub(crate) fn absorb_all(&mut self, rows: &mut [[T; N]]) {
        let count = u32::try_from(rows.len()).unwrap_or(u32::MAX);
        self.count = self.count.saturating_add(count);
        for k in 0..N {
            let squares = rows
                .iter()
                .fold(T::zero(), |sum, row| sum + row[k] * row[k]);
            let pivot = self.factor[k][k];
            let whole = squares + pivot * pivot;
            if whole == T::zero() && rows.iter().all(|row| row[k] == T::zero()) {
                continue;
            }
            if !is_safe_square(whole) {
                // Squares that overflow or vanish: rotations scale each pair.
                for row in rows.iter_mut() {
                    row[..k].fill(T::zero());
                    rotate_in(self.factor.as_flattened_mut(), row);
                }
                return;
            }
            let norm = whole.sqrt();
            let alpha = if pivot > T::zero() { -norm } else { norm };
            // H = I - v v^T / beta with v = (head, column), beta = -alpha head.
            let head = pivot - alpha;
            let inverse = T::one() / (-alpha * head);
            let line = &mut self.factor[k];
            line[k] = alpha;
            for j in k + 1..N {
                let mut sum = head * line[j];
                for row in rows.iter() {
                    sum += row[k] * row[j];
                }
                let share = sum * inverse;
                line[j] -= share * head;
                for row in rows.iter_mut() {
                    row[j] -= share * row[k];
                }
            }
        }
    }

    /// The factor, to be changed in place.
    #[cfg(feature = "std")]
    pub(crate) fn factor_mut(&mut self) -> &mut [[T; N]; N] {
        &mut self.factor
    }

    /// Whether no entry is so large that an answer could overflow, and none is NaN.
    /// Once unsound, a factor stays so whatever is absorbed.
    #[inline]
    pub(crate) fn is_sound(&self) -> bool {
        within::<T, N>(self.factor.as_flattened())
    }

    /// Hands on a factor that is sound.
    #[inline]
    pub(crate) fn sound(self) -> Result<Self, NumberError> {
        if self.is_sound() {
            Ok(self)
        } else {
            Err(OVERFLOW)
        }
    }

    /// A factor as it was read, its lower triangle zero; not checked.
    pub(crate) fn of_factor(factor: [[T; N]; N], count: u32) -> Self {
        Self { factor, count }
    }

    /// The same factor with another count: of rows that were changed in place.
    pub(crate) fn with_count(mut self, count: u32) -> Self {
        self.count = count;
        self
    }

    /// Adds the information of other, independent rows on the same states.
    ///
    /// # Errors
    /// [`NumberError::Overflow`] where the sum overflows;
    /// nothing is added then.
    pub fn merge(&mut self, other: &Self) -> Result<(), NumberError> {
        let mut sum = *self;
        for row in &other.factor {
            sum.absorb(row);
        }
        *self = sum
            .with_count(self.count.saturating_add(other.count))
            .sound()?;
        Ok(())
    }

    /// Multiplies all information so far by the forgetting factor `keep`, in
    /// [0, 1], so that old rows fade: called before each push, it lets a row that
    /// is k pushes old count `keep`^k. The bound of what is not measured again grows
    /// by 1 / sqrt(`keep`) each time. The count stays.
    ///
    /// # Errors
    /// [`NumberError::OutOfRange`].
    ///
    /// # Source
    /// Exponential weighting, Ljung 1999, System Identification, section 11.2.
    pub fn forget(&mut self, keep: T) -> Result<(), NumberError> {
        if !(keep >= T::zero() && keep <= T::one()) {
            return Err(NumberError::OutOfRange {
                name: "keep",
                given: keep.double(),
                allowed: "in [0, 1]",
            });
        }
        let root = keep.sqrt();
        for value in self.factor.as_flattened_mut() {
            *value *= root;
        }
        Ok(())
    }

    /// Rank, singular values and null space at the default tolerance.
    pub fn spectrum(&self) -> Spectrum<T, N> {
        Spectrum::new(self)
    }

    /// How many independent combinations of the states the rows determine.
    pub fn rank(&self) -> usize {
        self.spectrum().rank()
    }

    /// The `index`-th combination of the states that no row sees, in physical
    /// units and of no particular length; `None` from the nullity, N - rank, on.
    pub fn null_direction(&self, index: usize) -> Option<[T; N]> {
        self.spectrum().null_vector(index)
    }

    /// Standard deviation of each state at the Cramer-Rao bound; infinite where
    /// the rows do not determine it, or overflow.
    pub fn crlb_std(&self) -> [T; N] {
        bound::crlb_std(&self.spectrum())
    }

    /// The Cramer-Rao bound on the covariance; `None` where the rank is short, or
    /// an entry overflows.
    pub fn crlb(&self) -> Option<[[T; N]; N]> {
        bound::crlb(&self.spectrum())
    }

    /// The determinant of the information: 0 where it is singular or smaller,
    /// infinite where it overflows.
    /// [`log_determinant`](Self::log_determinant) has no such limits.
    #[doc(alias = "det")]
    pub fn determinant(&self) -> T {
        let root = self.root_determinant();
        root * root
    }

    /// The logarithm of the determinant; minus infinity where it is zero.
    pub fn log_determinant(&self) -> T {
        let log = (0..N).fold(T::zero(), |sum, i| sum + self.factor[i][i].abs().ln());
        log + log
    }

    /// |det R|, the square root of the determinant.
    pub fn root_determinant(&self) -> T {
        let mut plain = T::one();
        for i in 0..N {
            plain *= self.factor[i][i].abs();
        }
        if plain > T::zero() && plain.is_finite() {
            return plain;
        }
        // Out of range, at least on the way: factors that bring the product
        // nearer to 1 go first.
        let diagonal = |i: usize| self.factor[i][i].abs();
        if (0..N).any(|i| diagonal(i) == T::zero()) {
            return T::zero();
        }
        let one = T::one();
        let next = |from: usize, large: bool| (from..N).find(|&i| (diagonal(i) >= one) == large);
        let (mut large, mut small) = (next(0, true), next(0, false));
        let mut product = one;
        loop {
            let take_small = small.is_some() && (product >= one || large.is_none());
            let place = if take_small { small } else { large };
            let Some(i) = place else { return product };
            product *= diagonal(i);
            if take_small {
                small = next(i + 1, false);
            } else {
                large = next(i + 1, true);
            }
        }
    }
}

const OVERFLOW: NumberError = NumberError::Overflow {
    result: "information",
};

/// Whether a sum of squares has neither overflowed nor lost digits to what vanished.
#[cfg(feature = "std")]
pub(crate) fn is_safe_square<T: Real>(square: T) -> bool {
    let safe = T::one() / (T::MAX * T::EPSILON).sqrt();
    square > safe && square < T::one() / safe
}

/// Whether all numbers are so small that the column norms of a factor made of them,
/// and the sums of two such factors, are finite.
#[inline]
fn within<T: Real, const N: usize>(values: &[T]) -> bool {
    let limit = T::MAX / T::of(2.0 * N.max(1) as f64);
    values.iter().all(|x| x.abs() <= limit)
}

impl<T: Real, const N: usize> Default for SquareRootInformation<T, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real, const N: usize> RowSink<T, N> for SquareRootInformation<T, N> {
    #[inline]
    fn push(&mut self, row: &[T; N]) -> Result<(), NumberError> {
        Self::push(self, row)
    }
}

/// Rotates one row into the n x n upper triangular factor `r` (row-major), with
/// n the length of `row`. What is left in `row` is zero.
///
/// # Source
/// Givens rotations, Golub & Van Loan, Matrix Computations, section 5.1.
pub(crate) fn rotate_in<T: Real>(r: &mut [T], row: &mut [T]) {
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
#[cfg(feature = "alloc")]
pub(crate) fn triangularize<T: Real>(a: &mut [T], n: usize, work: &mut [T]) {
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
    let mut v0 = head[column] - alpha;
    // H = I - v v^T / beta, with v = (v0, tail column) and beta = -alpha v0.
    let mut beta = -alpha * v0;
    if beta <= T::one() / (T::MAX * T::EPSILON) {
        // The square of a tiny column vanishes: any multiple of v does as well, and the
        // column itself is overwritten below.
        head[column] *= unit;
        for row in tail.chunks_exact_mut(n) {
            row[column] *= unit;
        }
        v0 *= unit;
        beta = -(alpha * unit) * v0;
    }
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
#[cfg(feature = "alloc")]
pub(crate) fn eliminate<T: Real>(
    a: &mut [T],
    n: usize,
    p: usize,
    rtol: T,
    work: &mut [T],
) -> usize {
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use alloc::vec::Vec;
    use proptest::prelude::*;

    type Factor = SquareRootInformation<f64, 3>;

    fn of(rows: &[[f64; 3]]) -> Factor {
        let mut root = Factor::new();
        for row in rows {
            root.push(row).unwrap();
        }
        root
    }

    /// R^T R
    fn information(root: &Factor) -> [[f64; 3]; 3] {
        let r = root.factor();
        core::array::from_fn(|i| {
            core::array::from_fn(|j| (0..3).fold(0.0, |sum, k| sum + r[k][i] * r[k][j]))
        })
    }

    fn close(a: &Factor, b: &Factor, factor: f64) -> bool {
        let (a, b) = (information(a), information(b));
        let size = b.as_flattened().iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        (0..9).all(|k| {
            (a.as_flattened()[k] - factor * b.as_flattened()[k]).abs() <= 1e-13 * factor * size
        })
    }

    proptest! {
        #[test]
        fn merged_parts_are_the_whole_and_forgetting_is_a_weight(
            rows in prop::collection::vec([-9.0..9.0_f64, -9.0..9.0, -9.0..9.0], 2..20),
            keep in 0.01..1.0_f64,
        ) {
            let (first, second) = rows.split_at(rows.len() / 2);
            let (whole, mut part) = (of(&rows), of(first));
            part.merge(&of(second)).unwrap();
            prop_assert!(close(&part, &whole, 1.0));
            prop_assert_eq!(part.count(), whole.count());

            // Old rows first forgotten, then new ones: the old ones weigh `keep`.
            let mut fading = of(first);
            fading.forget(keep).unwrap();
            prop_assert!(close(&fading, &of(first), keep));
            fading.merge(&of(second)).unwrap();
            let root = keep.sqrt();
            let weighted: Vec<[f64; 3]> = first.iter().map(|row| row.map(|x| root * x))
                .chain(second.iter().copied()).collect();
            prop_assert!(close(&fading, &of(&weighted), 1.0));
        }
    }

    #[test]
    fn rank_null_direction_bound_and_determinant() {
        let root = of(&[[1.0, 2.0, 0.0], [0.0, 1.0, 1.0]]);
        assert_eq!(root.rank(), 2);
        let null = root.null_direction(0).unwrap();
        // (2, -1, 1) and nothing else.
        assert!((null[0] / null[2] - 2.0).abs() < 1e-14);
        assert!((null[1] / null[2] + 1.0).abs() < 1e-14);
        assert_eq!(root.null_direction(1), None);
        assert_eq!(root.null_direction(usize::MAX), None);
        assert_eq!(root.crlb_std(), [f64::INFINITY; 3]);
        assert_eq!(root.crlb(), None);
        assert_eq!(
            (root.determinant(), root.log_determinant()),
            (0.0, f64::NEG_INFINITY)
        );

        let root = of(&[[2.0, 0.0, 0.0], [3.0, 1.0, 0.0], [0.0, 0.0, 4.0]]);
        assert!((root.determinant() - 64.0).abs() < 1e-12);
        assert!((root.log_determinant() - 64.0_f64.ln()).abs() < 1e-13);
        let (std, crlb) = (root.crlb_std(), root.crlb().unwrap());
        for (i, wanted) in [0.25, 3.25, 0.0625].into_iter().enumerate() {
            assert!((crlb[i][i] - wanted).abs() < 1e-14 && (std[i].powi(2) - wanted).abs() < 1e-14);
        }
    }

    #[cfg(feature = "alloc")]
    #[test]
    fn a_column_whose_square_underflows_is_reflected() {
        let tiny = 1e-200;
        let mut a = [1.0, tiny, 1.0, -tiny, 1.0, tiny];
        triangularize(&mut a, 2, &mut [0.0; 2]);
        // det of the Gram matrix: 3 * 3 - 1, times tiny^2.
        let (first, second) = (a[0], a[3] / tiny);
        assert!(
            (first * first * second * second - 8.0_f64).abs() < 1e-14,
            "{a:?}"
        );
        assert_eq!(a[4..], [0.0, 0.0]);
    }

    #[test]
    fn determinants_beyond_the_numbers_on_the_way_only() {
        for (diagonal, wanted) in [
            ([1e200, 1e200, 1e-300], 1e100),
            ([1e-200, 1e-200, 1e300], 1e-100),
            ([1e-200, 1e-200, 1e-5], 0.0),
            ([1e200, 1e200, 0.0], 0.0),
            ([1e200, 1e200, 1e-5], f64::INFINITY),
        ] {
            let mut root = Factor::new();
            for (i, x) in diagonal.into_iter().enumerate() {
                let mut row = [0.0; 3];
                row[i] = x;
                root.push(&row).unwrap();
            }
            let found = root.root_determinant();
            assert!(
                found == wanted || (found / wanted - 1.0).abs() < 1e-12,
                "{found}"
            );
        }
    }

    #[test]
    fn what_cannot_be_held_is_refused_and_changes_nothing() {
        let mut root = of(&[[1.0, 2.0, 3.0]]);
        let before = root;
        assert_eq!(
            root.push(&[0.0, 0.0, f64::INFINITY]),
            Err(NumberError::NotFinite {
                name: "row",
                index: 2,
                given: f64::INFINITY
            })
        );
        assert!(root.push(&[0.0, f64::NAN, 0.0]).is_err());
        assert_eq!(root.push(&[1e308, 0.0, 0.0]), Err(OVERFLOW));
        assert!(root.forget(1.5).is_err() && root.forget(-0.1).is_err());
        assert!(root.forget(f64::NAN).is_err());
        assert_eq!(root, before);
        let mut large = of(&[[2e307, 2e307, 2e307]]);
        let other = large;
        assert_eq!(large.merge(&other), Ok(()));
        assert_eq!(large.merge(&other), Err(OVERFLOW));
        assert_eq!(large.count(), 2);
        // Whatever is held has an answer.
        assert!(large.crlb_std().iter().all(|x| !x.is_nan()));
        assert!(
            large
                .null_direction(0)
                .unwrap()
                .iter()
                .all(|x| x.is_finite())
        );
    }

    #[test]
    fn smaller_than_any_normal_number_is_nothing() {
        let mut root = of(&[[5e-324, 0.0, 0.0], [0.0, 1e-310, 0.0]]);
        assert_eq!(root.rank(), 0);
        root.push(&[0.0, 0.0, 1.0]).unwrap();
        assert_eq!(root.rank(), 1);
        assert_eq!(root.crlb_std(), [f64::INFINITY, f64::INFINITY, 1.0]);
    }
}
