//! Problems of thousands to millions of states with a handful of entries in each row.
//!
//! [`Rows`] is the matrix as it is given (compressed rows); [`structure`] says what its
//! pattern alone decides; [`factor`] reduces it to triangular form by orthogonal
//! transformations; [`null_space`] finds what it does not determine and how clearly;
//! [`selected_inverse`] gives every bound at about the cost of the factorisation.
//!
//! # Source
//! Multifrontal QR: Davis, *Algorithm 915, `SuiteSparseQR`*, ACM TOMS 38 (2011). Selected
//! inversion: Takahashi, Fagan & Chin (1973); Erisman & Tinney, CACM 18 (1975). Block
//! inverse iteration with Rayleigh-Ritz: Golub & Van Loan, sections 8.2 and 10.4.

use alloc::vec;
use alloc::vec::Vec;

pub mod analysis;
pub mod factor;
pub mod graph;
pub mod null_space;
pub mod ordering;
pub mod selected_inverse;
pub mod structure;
pub mod symbolic;

pub use analysis::Sparse;

/// An integer that counts entries or names a column: what the two index types of
/// compressed matrices have in common.
pub trait Index: Copy + Send + Sync {
    /// As a place in memory; `None` for a negative number.
    fn place(self) -> Option<usize>;
}

impl Index for i32 {
    fn place(self) -> Option<usize> {
        usize::try_from(self).ok()
    }
}

impl Index for i64 {
    fn place(self) -> Option<usize> {
        usize::try_from(self).ok()
    }
}

impl Index for usize {
    fn place(self) -> Option<usize> {
        Some(self)
    }
}

#[allow(clippy::trivially_copy_pass_by_ref)] // As the messages have it.
fn gigabytes(bytes: &usize) -> f64 {
    *bytes as f64 / 1e9
}

/// What can be wrong with sparse rows, or with the attempt to reduce them.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SparseError {
    /// Starts of rows that are not increasing or do not end at the number of entries.
    #[error(
        "row {row} ends at entry {end}: row ends must not decrease, and the last must be the number of entries, {entries}"
    )]
    RowStart {
        /// The row.
        row: usize,
        /// Where it ends, by what was given.
        end: i128,
        /// How many entries there are.
        entries: usize,
    },
    /// A column that does not exist.
    #[error("row {row} has an entry in column {column}: must be from 0 to {}", columns - 1)]
    Column {
        /// The row.
        row: usize,
        /// The column given; negative where it was too large for its type.
        column: i128,
        /// How many there are.
        columns: usize,
    },
    /// Columns of a row that are not increasing.
    #[error(
        "row {row} has column {column} twice or out of order: sum duplicates and sort the columns first"
    )]
    Order {
        /// The row.
        row: usize,
        /// The column that does not follow the one before.
        column: usize,
    },
    /// A value that is NaN or infinite.
    #[error("rows[{row}, {column}] = {given}: must be finite")]
    NotFinite {
        /// The row.
        row: usize,
        /// The column.
        column: usize,
        /// The value.
        given: f64,
    },
    /// A column whose sum of squares overflows or vanishes.
    #[error(
        "column {column} has norm {norm:e}: squares leave the range of double precision; choose other units"
    )]
    Range {
        /// The column.
        column: usize,
        /// Its norm.
        norm: f64,
    },
    /// Memory that does not suffice.
    #[error(
        "the factor of {columns} columns would have {entries} entries and take {:.3} GB at its peak: {:.3} GB are available",
        gigabytes(.needed),
        gigabytes(.available)
    )]
    Memory {
        /// Columns of the matrix.
        columns: usize,
        /// Entries of the factor.
        entries: usize,
        /// What would be needed.
        needed: usize,
        /// What there is.
        available: usize,
    },
    /// Another array that would not fit in memory.
    #[error(
        "{what} would take {:.3} GB: {:.3} GB are available",
        gigabytes(.needed),
        gigabytes(.available)
    )]
    Size {
        /// What it is.
        what: &'static str,
        /// What would be needed.
        needed: usize,
        /// What there is.
        available: usize,
    },
    /// A vector whose length does not fit.
    #[error("{array} has {given} entries: must have {wanted}")]
    Length {
        /// Its name.
        array: &'static str,
        /// Its length.
        given: usize,
        /// The length that fits.
        wanted: usize,
    },
    /// An iteration that did not converge.
    #[error("the iteration for the null space did not converge")]
    NoConvergence,
    /// The caller asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// Asked now and then during long work; `true` stops it with [`SparseError::Interrupted`].
pub type Stop<'a> = dyn FnMut() -> bool + 'a;

/// A sparse matrix in compressed rows: entries `start[i]..start[i + 1]` of `column` and
/// `value` are row i. Borrowed: nothing is copied.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a, I> {
    columns: usize,
    start: &'a [I],
    column: &'a [I],
    value: &'a [f64],
}

impl<'a, I: Index> Rows<'a, I> {
    /// Takes a matrix with so many `columns` and checks it.
    ///
    /// # Errors
    /// [`SparseError`] for starts, columns or values that do not fit.
    pub fn new(
        columns: usize,
        start: &'a [I],
        column: &'a [I],
        value: &'a [f64],
    ) -> Result<Self, SparseError> {
        if column.len() != value.len() {
            return Err(SparseError::Length {
                array: "values",
                given: value.len(),
                wanted: column.len(),
            });
        }
        let mut before = match start.first().map(|s| s.place()) {
            Some(Some(0)) => 0,
            _ => {
                return Err(SparseError::RowStart {
                    row: 0,
                    end: -1,
                    entries: value.len(),
                });
            }
        };
        for (row, end) in start[1..].iter().enumerate() {
            let end = end.place().filter(|&e| e >= before && e <= value.len());
            let Some(end) = end else {
                return Err(SparseError::RowStart {
                    row,
                    end: start[row + 1].place().map_or(-1, |e| e as i128),
                    entries: value.len(),
                });
            };
            let mut last = None;
            for k in before..end {
                let place = column[k].place().filter(|&c| c < columns);
                let Some(place) = place else {
                    return Err(SparseError::Column {
                        row,
                        column: column[k].place().map_or(-1, |c| c as i128),
                        columns,
                    });
                };
                if last.is_some_and(|last| place <= last) {
                    return Err(SparseError::Order { row, column: place });
                }
                last = Some(place);
                if !value[k].is_finite() {
                    return Err(SparseError::NotFinite {
                        row,
                        column: place,
                        given: value[k],
                    });
                }
            }
            before = end;
        }
        if before != value.len() {
            return Err(SparseError::RowStart {
                row: start.len().saturating_sub(2),
                end: before as i128,
                entries: value.len(),
            });
        }
        Ok(Self {
            columns,
            start,
            column,
            value,
        })
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.start.len() - 1
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of stored entries.
    pub fn entries(&self) -> usize {
        self.value.len()
    }

    /// The entries of a row: columns, increasing, and values. Zeros that were stored are
    /// left out.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + use<'a, I> {
        // Checked in `new`: no index is negative.
        let from = self.start[row].place().unwrap_or(0);
        let to = self.start[row + 1].place().unwrap_or(0);
        let (column, value) = (&self.column[from..to], &self.value[from..to]);
        column
            .iter()
            .zip(value)
            .filter(|(_, value)| **value != 0.0)
            .map(|(column, value)| (column.place().unwrap_or(0), *value))
    }

    /// The norm of each column.
    ///
    /// # Errors
    /// [`SparseError::Range`] where a sum of squares overflows or vanishes.
    pub fn norms(&self) -> Result<Vec<f64>, SparseError> {
        let mut squares = vec![0.0; self.columns];
        let mut touched = vec![false; self.columns];
        for row in 0..self.len() {
            for (column, value) in self.row(row) {
                squares[column] += value * value;
                touched[column] = true;
            }
        }
        for (column, square) in squares.iter_mut().enumerate() {
            if touched[column] && !(*square > 1e-290 && *square < 1e290) {
                return Err(SparseError::Range {
                    column,
                    norm: square.sqrt(),
                });
            }
            *square = square.sqrt();
        }
        Ok(squares)
    }
}
