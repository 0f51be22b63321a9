//! Fisher information (with unit noise, the Gram matrix) as a fixed-size sum.
//!
//! Half the digits of the rows are lost in the sum. Take ranks, bounds and
//! determinants from [`SquareRootInformation`](crate::square_root::SquareRootInformation); keep this
//! for what needs the matrix itself.
//!
//! ```
//! use gramian::information::Information;
//! use gramian::rows::RowSink;
//!
//! let mut information = Information::<f64, 2>::new();
//! information.push(&[1.0, 0.0])?;
//! information.push(&[1.0, 1.0])?;
//! // What is left on the second state when nothing is known of the first.
//! let left = information.marginalize_others(&[1])?;
//! assert!((left.matrix()[(0, 0)] - 0.5).abs() < 1e-15);
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```

use nalgebra::SMatrix;

use crate::numbers::algebra::add_square;
use crate::rows::RowSink;
use crate::scalar::{NumberError, Real, check_finite};

/// J = sum of row^T row.
///
/// # Source
/// Xu et al. 2009, eq. (10), for any rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Information<T: Real, const N: usize> {
    matrix: SMatrix<T, N, N>,
}

impl<T: Real, const N: usize> Information<T, N> {
    /// No information.
    pub fn new() -> Self {
        Self {
            matrix: SMatrix::zeros(),
        }
    }

    /// The information matrix.
    pub fn matrix(&self) -> &SMatrix<T, N, N> {
        &self.matrix
    }

    /// Adds the information of independent measurements of the same states.
    ///
    /// # Errors
    /// [`Error::Number`] where the sum overflows; nothing is
    /// added then.
    pub fn add(&mut self, other: &Self) -> Result<(), Error> {
        Ok(self.replace(self.matrix + other.matrix)?)
    }

    /// Takes a matrix in place of the present one if it is finite.
    fn replace(&mut self, matrix: SMatrix<T, N, N>) -> Result<(), NumberError> {
        if !matrix.iter().all(nalgebra::ComplexField::is_finite) {
            return Err(OVERFLOW);
        }
        self.matrix = matrix;
        Ok(())
    }

    /// Adds what is known of state `index` beforehand: its standard deviation.
    ///
    /// # Errors
    /// [`Error::Index`] for a state that does not exist, [`Error::Sigma`] for a
    /// deviation that is not positive and finite, [`Error::Number`] where 1 over its
    /// square overflows.
    pub fn prior(&mut self, index: usize, sigma: T) -> Result<(), Error> {
        if index >= N {
            return Err(Error::Index { index, states: N });
        }
        if !(sigma > T::zero() && sigma.is_finite()) {
            return Err(Error::Sigma {
                index,
                given: sigma.double(),
            });
        }
        let mut matrix = self.matrix;
        matrix[(index, index)] += T::one() / (sigma * sigma);
        Ok(self.replace(matrix)?)
    }

    /// The information on the states in `keep` when all others are known.
    ///
    /// # Errors
    /// [`Error::Index`] for a state that does not exist or is named twice.
    pub fn fix_others<const M: usize>(
        &self,
        keep: &[usize; M],
    ) -> Result<Information<T, M>, Error> {
        check_indices::<M, N>(keep)?;
        Ok(Information {
            matrix: SMatrix::from_fn(|i, j| self.matrix[(keep[i], keep[j])]),
        })
    }

    /// The information on the states in `keep` when nothing is known of the
    /// others: the Schur complement.
    ///
    /// # Errors
    /// [`Error::Index`] as above; [`Error::Singular`] when the other states are
    /// not determined even with these known. (Eliminate on the rows then:
    /// `observability::marginal_rows`.) [`Error::Number`] where a
    /// product on the way overflows.
    ///
    /// # Source
    /// The Schur complement, by symmetric elimination with pivots: Golub & Van Loan,
    /// section 4.2.
    pub fn marginalize_others<const M: usize>(
        &self,
        keep: &[usize; M],
    ) -> Result<Information<T, M>, Error> {
        check_indices::<M, N>(keep)?;
        let mut work = self.matrix;
        // Symmetric elimination of one state after the other, largest pivot
        // (on the scale of its own diagonal entry) first.
        let mut left = [true; N];
        for &i in keep {
            left[i] = false;
        }
        let floor = T::EPSILON * T::of(N as f64);
        for _ in 0..N - M {
            let mut pivot = None;
            let mut best = floor;
            for i in (0..N).filter(|&i| left[i]) {
                let ratio = work[(i, i)] / self.matrix[(i, i)];
                if ratio > best {
                    best = ratio;
                    pivot = Some(i);
                }
            }
            let Some(p) = pivot else {
                let index = (0..N).find(|&i| left[i]).unwrap_or(0);
                return Err(Error::Singular { index });
            };
            left[p] = false;
            let row = work.row(p).clone_owned();
            for i in 0..N {
                let factor = work[(i, p)] / row[p];
                if i != p {
                    for j in 0..N {
                        work[(i, j)] -= factor * row[j];
                    }
                }
            }
            for i in 0..N {
                work[(i, p)] = T::zero();
                work[(p, i)] = T::zero();
            }
        }
        let half = T::of(0.5);
        let mut out = Information::new();
        out.replace(SMatrix::from_fn(|i, j| {
            half * work[(keep[i], keep[j])] + half * work[(keep[j], keep[i])]
        }))?;
        Ok(out)
    }
}

impl<T: Real, const N: usize> Default for Information<T, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real, const N: usize> RowSink<T, N> for Information<T, N> {
    fn push(&mut self, row: &[T; N]) -> Result<(), NumberError> {
        check_finite("row", row)?;
        let mut sum = self.matrix;
        add_square(row, T::one(), sum.as_mut_slice());
        self.replace(sum)
    }
}

const OVERFLOW: NumberError = NumberError::Overflow {
    result: "information",
};

fn check_indices<const M: usize, const N: usize>(keep: &[usize; M]) -> Result<(), Error> {
    for (position, &index) in keep.iter().enumerate() {
        if index >= N || keep[..position].contains(&index) {
            return Err(Error::Index { index, states: N });
        }
    }
    Ok(())
}

/// What can be wrong with a request to an [`Information`].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// No such state, or a state named twice.
    #[error("state index {index}: must be below {states} and named once")]
    Index {
        /// The index given.
        index: usize,
        /// The number of states there are.
        states: usize,
    },
    /// A standard deviation that is not positive and finite.
    #[error("sigma of state {index} = {given}: must be > 0 and finite")]
    Sigma {
        /// The state it was given for.
        index: usize,
        /// The value given.
        given: f64,
    },
    /// A state to be eliminated that is not determined.
    #[error(
        "state {index} cannot be eliminated: it is not determined even when the others are known"
    )]
    Singular {
        /// That state.
        index: usize,
    },
    /// A number that is not finite, or too large to go on with.
    #[error(transparent)]
    Number(#[from] NumberError),
}
