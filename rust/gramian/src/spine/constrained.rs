//! Rows with noise, and combinations of the states that are known exactly.
//!
//! What is known exactly is no heavy row: it takes a state away. Beside a row of weight
//! 1e16 the others fade in one triangular factor; here each exact combination writes one
//! state by the others, and the rows see what is left. No digit is lost to a weight.

use crate::bound::{combination_std, crlb};
use crate::scalar::{NumberError, Real, check_finite, hypot};
use crate::square_root::SquareRootInformation;

/// A [`SquareRootInformation`] beside exact knowledge: sigma 0, an equality constraint, the
/// normal of a surface the state stays on.
///
/// No allocation; a push costs O(N^2) operations, a combination O(N^3). A combination that
/// was known exactly before says nothing new, and none can contradict another, since values
/// do not enter: only which combination is known.
///
/// # Source
/// Elimination by the largest entry, in the units of the rows: Lawson & Hanson 1974, Solving
/// Least Squares Problems, chapter 21.
///
/// ```
/// use gramian::constrained::ConstrainedInformation;
/// // The sum of two states is known, and one of them measured to 2.
/// let mut information = ConstrainedInformation::<f64, 2>::new();
/// information.know(&[1.0, 1.0])?;
/// assert_eq!(information.rank(), 1);
/// assert_eq!(information.null_direction(0), Some([-1.0, 1.0]));
/// information.push(&[0.5, 0.0])?;
/// assert_eq!(information.crlb_std(), [2.0, 2.0]);
/// # Ok::<(), gramian::scalar::NumberError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConstrainedInformation<T, const N: usize> {
    /// On the free states. A state written by others has a row of its own, of length one:
    /// it neither costs rank nor touches the rest.
    root: SquareRootInformation<T, N>,
    /// Each state by the free ones; the columns of the others are zero.
    states: [[T; N]; N],
    /// Which states are written by others.
    held: [bool; N],
}

impl<T: Real, const N: usize> ConstrainedInformation<T, N> {
    /// No information.
    #[must_use]
    pub fn new() -> Self {
        Self::from(SquareRootInformation::new())
    }

    /// Takes in one whitened row.
    ///
    /// # Errors
    /// As [`SquareRootInformation::push`]; the row is not taken in then.
    pub fn push(&mut self, row: &[T; N]) -> Result<(), NumberError> {
        check_finite("row", row)?;
        self.root.push(&self.seen(row))
    }

    /// Takes in a combination of the states that is known exactly, of any length.
    ///
    /// # Errors
    /// [`NumberError::NotFinite`] with the entry, [`NumberError::Overflow`] where the
    /// information on the others overflows. Nothing is taken in then.
    #[doc(alias = "constrain")]
    pub fn know(&mut self, combination: &[T; N]) -> Result<(), NumberError> {
        check_finite("combination", combination)?;
        let largest = combination.iter().fold(T::zero(), |l, c| l.max(c.abs()));
        let unit = T::one() / largest;
        if !unit.is_finite() {
            return Ok(());
        }
        let left = self.seen(&combination.map(|c| c * unit));
        let Some(pivot) = self.pivot(&left) else {
            return Ok(());
        };
        let mut by = left.map(|c| -c / left[pivot]);
        by[pivot] = T::zero();
        let mut next = *self;
        next.held[pivot] = true;
        for state in &mut next.states {
            *state = replaced(state, pivot, &by);
        }
        next.root = SquareRootInformation::new();
        for row in self.root.factor() {
            next.root.absorb(&replaced(row, pivot, &by));
        }
        let mut own = [T::zero(); N];
        own[pivot] = T::one();
        next.root.absorb(&own);
        next.root = next.root.with_count(self.root.count()).sound()?;
        check_finite("states", next.states.as_flattened()).map_err(|_| OVERFLOW)?;
        *self = next;
        Ok(())
    }

    /// How many independent combinations of the states are determined, by rows or exactly.
    pub fn rank(&self) -> usize {
        self.root.rank()
    }

    /// How many independent combinations are known exactly.
    pub fn exact(&self) -> usize {
        self.held.iter().filter(|&&held| held).count()
    }

    /// How many rows were pushed, exact combinations not counted.
    pub fn count(&self) -> u32 {
        self.root.count()
    }

    /// The `index`-th combination that neither rows nor exact knowledge see, in physical
    /// units; `None` from the nullity on.
    pub fn null_direction(&self, index: usize) -> Option<[T; N]> {
        let free = self.root.null_direction(index)?;
        Some(self.states.map(|by| sum(&by, &free)))
    }

    /// Standard deviation of each state at the Cramer-Rao bound: 0 for one that is known
    /// exactly, infinite for one that is not determined.
    ///
    /// # Source
    /// Gorman & Hero 1990, "Lower bounds for parametric estimation with constraints", IEEE
    /// Trans. Information Theory 36.
    pub fn crlb_std(&self) -> [T; N] {
        let spectrum = self.root.spectrum();
        self.states.map(|by| combination_std(&spectrum, &by))
    }

    /// The Cramer-Rao bound on the covariance, singular where something is known exactly;
    /// `None` where the rank is short, or an entry overflows.
    pub fn crlb(&self) -> Option<[[T; N]; N]> {
        let free = crlb(&self.root.spectrum())?;
        let half = free.map(|row| self.states.map(|by| sum(&by, &row)));
        let mut out = [[T::zero(); N]; N];
        for i in 0..N {
            for j in 0..=i {
                let value = (0..N).fold(T::zero(), |s, k| s + self.states[i][k] * half[k][j]);
                if !value.is_finite() {
                    return None;
                }
                out[i][j] = value;
                out[j][i] = value;
            }
        }
        Some(out)
    }

    /// The information on the free states, and a row of length one for each that is written
    /// by others.
    pub(crate) fn root(&self) -> &SquareRootInformation<T, N> {
        &self.root
    }

    /// The combinations that are known exactly: x - what it is written by.
    pub(crate) fn combinations(&self) -> impl Iterator<Item = [T; N]> + '_ {
        let held = (0..N).filter(|&p| self.held[p]);
        held.map(|p| {
            let mut row = self.states[p].map(|c| -c);
            row[p] += T::one();
            row
        })
    }

    /// Whether a state is written by others.
    pub(crate) fn is_held(&self, state: usize) -> bool {
        self.held[state]
    }

    /// What a row sees of the free states.
    fn seen(&self, row: &[T; N]) -> [T; N] {
        let mut out = [T::zero(); N];
        for (j, out) in out.iter_mut().enumerate() {
            *out = clean((0..N).map(|i| row[i] * self.states[i][j]), N);
        }
        out
    }

    /// The free state to write by the others: that with the largest part of a combination.
    fn pivot(&self, left: &[T; N]) -> Option<usize> {
        let factor = self.root.factor();
        let length = |j: usize| factor.iter().fold(T::zero(), |l, row| hypot(l, row[j]));
        // A state of which nothing is known yet has the unit of the widest of the others.
        let free = |j: &usize| !self.held[*j];
        let widest = (0..N).filter(free).fold(T::zero(), |widest, j| {
            let unit = T::one() / length(j);
            if unit.is_finite() {
                widest.max(unit)
            } else {
                widest
            }
        });
        let widest = if widest > T::zero() { widest } else { T::one() };
        let part = |j: usize| {
            let unit = T::one() / length(j);
            let unit = if unit.is_finite() { unit } else { widest };
            left[j].abs() * unit
        };
        let mut best = (T::zero(), None);
        for j in (0..N).filter(free) {
            if part(j) > best.0 {
                best = (part(j), Some(j));
            }
        }
        best.1
    }
}

impl<T: Real, const N: usize> Default for ConstrainedInformation<T, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real, const N: usize> From<SquareRootInformation<T, N>> for ConstrainedInformation<T, N> {
    fn from(root: SquareRootInformation<T, N>) -> Self {
        let mut states = [[T::zero(); N]; N];
        for (i, state) in states.iter_mut().enumerate() {
            state[i] = T::one();
        }
        Self {
            root,
            states,
            held: [false; N],
        }
    }
}

const OVERFLOW: NumberError = NumberError::Overflow {
    result: "information",
};

/// A sum of which only rounding is left is zero: what is known exactly is not seen again.
pub(crate) fn clean<T: Real>(terms: impl Iterator<Item = T>, count: usize) -> T {
    let (sum, size) = terms.fold((T::zero(), T::zero()), |(sum, size), x| {
        (sum + x, size + x.abs())
    });
    if sum.abs() <= T::EPSILON * T::of(4.0 * count as f64) * size {
        T::zero()
    } else {
        sum
    }
}

fn sum<T: Real, const N: usize>(a: &[T; N], b: &[T; N]) -> T {
    (0..N).fold(T::zero(), |s, k| s + a[k] * b[k])
}

/// A row in which one state is replaced by a combination of the others.
fn replaced<T: Real, const N: usize>(row: &[T; N], state: usize, by: &[T; N]) -> [T; N] {
    let mut out = *row;
    for (j, out) in out.iter_mut().enumerate() {
        *out = clean([row[j], row[state] * by[j]].into_iter(), 2);
    }
    out[state] = T::zero();
    out
}

#[cfg(all(test, feature = "alloc"))]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::observability::Observability;
    use alloc::vec::Vec;

    type Filter = ConstrainedInformation<f64, 4>;

    fn numbers(seed: &mut u64) -> [f64; 4] {
        [(); 4].map(|()| {
            *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (*seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        })
    }

    /// The null-space method on all rows at once, in units far apart.
    #[test]
    fn as_the_analysis_of_all_rows_whatever_the_order_and_the_units() {
        let mut seed = 5;
        for case in 0..200_u8 {
            let units = [1.0, 1e6, 1e-7, 1e3].map(|u: f64| u.powi(i32::from(case % 3) - 1));
            let in_units = |row: [f64; 4]| core::array::from_fn(|j| row[j] * units[j]);
            let rows: Vec<[f64; 4]> = (0..4).map(|_| in_units(numbers(&mut seed))).collect();
            let exact: Vec<[f64; 4]> = (0..case % 4)
                .map(|_| in_units(numbers(&mut seed)))
                .collect();
            let (all, known) = (rows.as_flattened(), exact.as_flattened());
            let wanted = Observability::constrained(all, known, 4, None)
                .unwrap()
                .crlb_std();
            for first in [0, 2, 4] {
                let mut filter = Filter::new();
                for row in &rows[..first] {
                    filter.push(row).unwrap();
                }
                for row in &exact {
                    filter.know(row).unwrap();
                    // Once more, and a multiple: nothing new.
                    filter.know(&row.map(|c| -3.0 * c)).unwrap();
                }
                for row in &rows[first..] {
                    filter.push(row).unwrap();
                }
                assert_eq!((filter.exact(), filter.count()), (exact.len(), 4));
                assert_eq!(filter.rank(), 4);
                for (found, wanted) in filter.crlb_std().iter().zip(&wanted) {
                    assert!((found / wanted - 1.0).abs() < 1e-9, "{found} {wanted}");
                }
                let crlb = filter.crlb().unwrap();
                for (i, wanted) in wanted.iter().enumerate() {
                    assert!((crlb[i][i].sqrt() / wanted - 1.0).abs() < 1e-9);
                }
                for c in &exact {
                    let along = |row: &[f64; 4]| -> f64 { (0..4).map(|j| row[j] * c[j]).sum() };
                    let size: f64 = (0..4).map(|j| (c[j] * wanted[j]).abs()).sum();
                    let variance: f64 = (0..4).map(|i| c[i] * along(&crlb[i])).sum();
                    assert!(variance.abs() < 1e-12 * size * size);
                }
            }
        }
    }

    #[test]
    fn what_is_known_exactly_is_not_seen_again() {
        let mut filter = Filter::new();
        filter.know(&[0.1, 0.3, 0.0, 0.0]).unwrap();
        filter.push(&[0.1, 0.3, 0.0, 0.0]).unwrap();
        filter.push(&[0.7, 2.1, 0.0, 1e-3]).unwrap();
        assert_eq!((filter.rank(), filter.exact()), (2, 1));
        assert_eq!(filter.crlb_std()[..3], [f64::INFINITY; 3]);
        assert!((filter.crlb_std()[3] - 1e3).abs() < 1e-9);
        assert_eq!(filter.crlb(), None);
        // The two unobservable directions leave the combination as it is.
        for k in 0..2 {
            let null = filter.null_direction(k).unwrap();
            assert!((0.1 * null[0] + 0.3 * null[1]).abs() < 1e-15);
        }
        assert_eq!(filter.null_direction(2), None);
        // All of it known: bounds of zero.
        for k in 0..4 {
            let mut unit = [0.0; 4];
            unit[k] = 2.0;
            filter.know(&unit).unwrap();
        }
        assert_eq!((filter.rank(), filter.exact()), (4, 4));
        assert_eq!(filter.crlb_std(), [0.0; 4]);
        assert_eq!(filter.crlb(), Some([[0.0; 4]; 4]));
    }

    #[test]
    fn bad_input_changes_nothing() {
        let mut filter = Filter::new();
        filter.push(&[1.0, 2.0, 3.0, 4.0]).unwrap();
        let before = filter;
        assert!(filter.know(&[0.0, f64::NAN, 0.0, 0.0]).is_err());
        assert!(filter.push(&[0.0, f64::INFINITY, 0.0, 0.0]).is_err());
        filter.know(&[0.0; 4]).unwrap();
        assert_eq!(filter, before);
    }
}
