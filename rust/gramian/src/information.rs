//! Fisher information (with unit noise, the Gram matrix) as a fixed-size sum.
//!
//! Half the digits of the rows are lost in the sum. Take ranks, bounds and
//! determinants from [`SquareRoot`](crate::square_root::SquareRoot); keep this
//! for what needs the matrix itself.

use nalgebra::SMatrix;

use crate::rows::RowSink;
use crate::scalar::Real;

/// J = sum of row^T row.
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
    pub fn add(&mut self, other: &Self) {
        self.matrix += other.matrix;
    }

    /// Adds what is known of state `index` beforehand: its standard deviation.
    ///
    /// # Errors
    /// [`Error::Index`] for a state that does not exist, [`Error::Sigma`] for a
    /// deviation that is not positive and finite.
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
        self.matrix[(index, index)] += T::one() / (sigma * sigma);
        Ok(())
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
    /// [`eliminate`](crate::square_root::eliminate).)
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
        Ok(Information {
            matrix: SMatrix::from_fn(|i, j| {
                half * (work[(keep[i], keep[j])] + work[(keep[j], keep[i])])
            }),
        })
    }
}

impl<T: Real, const N: usize> Default for Information<T, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real, const N: usize> RowSink<T, N> for Information<T, N> {
    fn push(&mut self, row: &[T; N]) {
        for i in 0..N {
            for j in 0..N {
                self.matrix[(i, j)] += row[i] * row[j];
            }
        }
    }
}

fn check_indices<const M: usize, const N: usize>(keep: &[usize; M]) -> Result<(), Error> {
    for (position, &index) in keep.iter().enumerate() {
        if index >= N || keep[..position].contains(&index) {
            return Err(Error::Index { index, states: N });
        }
    }
    Ok(())
}

/// What can be wrong with a request to an [`Information`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Error {
    /// No such state, or a state named twice.
    Index {
        /// The index given.
        index: usize,
        /// The number of states there are.
        states: usize,
    },
    /// A standard deviation that is not positive and finite.
    Sigma {
        /// The state it was given for.
        index: usize,
        /// The value given.
        given: f64,
    },
    /// A state to be eliminated that is not determined.
    Singular {
        /// That state.
        index: usize,
    },
}

impl core::fmt::Display for Error {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Index { index, states } => write!(
                f,
                "state index {index}: must be below {states} and named once"
            ),
            Self::Sigma { index, given } => write!(
                f,
                "sigma of state {index} = {given}: must be > 0 and finite"
            ),
            Self::Singular { index } => write!(
                f,
                "state {index} cannot be eliminated: it is not determined even when the others are known"
            ),
        }
    }
}

impl core::error::Error for Error {}
