//! The same sums over many trials: vectors by run-time dispatch, threads by the
//! size of the work.
//!
//! Arrays are contiguous with the trial as leading axis; an input that all
//! trials share is given once ([`Items::shared`]). Each trial is computed alone
//! and in the same order of operations on any number of threads, so results do
//! not depend on it.

mod bearings_discriminant;
mod bearings_gram;
pub mod bearings_localize;
mod bearings_log_det;
mod bearings_motion;
mod bearings_quadruple;
mod bearings_rows;
mod bearings_test;
mod bounds;
pub mod closed_loop;
mod dipole;
mod gram;
mod lanes;
mod linear;
mod maneuver;
mod maneuver_fisher;
mod maneuver_paths;
pub mod moments;
pub mod plan;
mod posterior;
mod random;
pub mod registration;
pub mod simd;
mod threads;
mod turn;
mod unit_factor;

pub use bearings_discriminant::{
    Method, Quadruples, cost as discriminant_cost, discriminant_sum, discriminants,
    fixed_target_sum,
};
pub use bearings_gram::{GRAM_SIZE, bearing_gram};
pub use bearings_log_det::bearing_log_det_trials;
pub use bearings_motion::{Motion, motion_rows};
pub use bearings_quadruple::{
    EXACT as EXACT_QUADRUPLES, Quadruple, best_quadruple, best_quadruples,
};
pub use bearings_rows::{Target, bearing_rows};
pub use bearings_test::{TEST_SIZE, observability_tests};
pub use bounds::crlb_std;
pub use dipole::{
    Passes, Simulated, TrialError, dipole_field, dipole_fisher, dipole_jacobian, dipole_localize,
    dipole_localize_trials, dipole_localized_size, dipole_measure, dipole_rows, localize_cost,
};
pub use gram::gram;
pub use linear::{
    Span, gramian_cost, linear_cost, linear_gramian, linear_levels, observability_matrix,
};
pub use maneuver::headings;
pub use maneuver_fisher::{Determinant, Sightings, fisher, fisher_det};
pub use maneuver_paths::{Paths, path_size, trajectories};
pub use posterior::{Recursion, posterior};
pub use random::{Stream, normals};
pub use threads::Threads;

/// One input of a batch: `size` numbers for each trial, or the same for all.
#[derive(Clone, Copy, Debug)]
pub struct Items<'a> {
    data: &'a [f64],
    size: usize,
    step: usize,
}

impl<'a> Items<'a> {
    /// `size` numbers for each trial, one trial after the other.
    pub fn each(data: &'a [f64], size: usize) -> Self {
        Self {
            data,
            size,
            step: size,
        }
    }

    /// The same numbers for every trial.
    pub fn shared(data: &'a [f64]) -> Self {
        Self {
            data,
            size: data.len(),
            step: 0,
        }
    }

    /// Whether all trials share this input.
    pub fn is_shared(&self) -> bool {
        self.step == 0
    }

    /// The same input counted from trial `first` on.
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
    pub fn get(&self, trial: usize) -> &'a [f64] {
        &self.data[trial * self.step..trial * self.step + self.size]
    }
}
