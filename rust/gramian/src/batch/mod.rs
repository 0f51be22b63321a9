//! The same sums over many trials: vectors by run-time dispatch, threads by the
//! size of the work.
//!
//! Arrays are contiguous with the trial as leading axis; an input that all
//! trials share is given once ([`Items::shared`]). Each trial is computed alone
//! and in the same order of operations on any number of threads, so results do
//! not depend on it.

pub mod element;
pub(crate) mod lanes;
pub mod moments;
mod random;
pub mod simd;
mod threads;
pub(crate) mod transpose;

pub use random::{Stream, normals};
pub use threads::Threads;
#[cfg(feature = "parallel")]
pub use threads::in_pool;

/// One input of a batch: `size` numbers for each trial, or the same for all.
#[derive(Clone, Copy, Debug)]
pub struct Items<'a, T = f64> {
    data: &'a [T],
    size: usize,
    step: usize,
}

impl<'a, T> Items<'a, T> {
    /// `size` numbers for each trial, one trial after the other.
    #[inline]
    pub fn each(data: &'a [T], size: usize) -> Self {
        Self {
            data,
            size,
            step: size,
        }
    }

    /// The same numbers for every trial.
    #[inline]
    pub fn shared(data: &'a [T]) -> Self {
        Self {
            data,
            size: data.len(),
            step: 0,
        }
    }

    /// Whether all trials share this input.
    #[inline]
    pub fn is_shared(&self) -> bool {
        self.step == 0
    }

    /// The same input counted from trial `first` on.
    #[inline]
    #[must_use]
    pub fn skip(self, first: usize) -> Self {
        Self {
            data: &self.data[first * self.step..],
            ..self
        }
    }

    /// How many numbers a trial has.
    #[inline]
    pub fn size(&self) -> usize {
        self.size
    }

    /// The numbers of one trial.
    #[inline]
    pub fn get(&self, trial: usize) -> &'a [T] {
        &self.data[trial * self.step..trial * self.step + self.size]
    }
}
