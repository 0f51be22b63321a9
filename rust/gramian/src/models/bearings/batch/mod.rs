//! Bearings over many trials: sums by vectors, estimates and tests by threads.

pub(crate) mod discriminant;
mod gram;
pub mod localize;
mod log_det;
mod motion;
mod observability_test;
mod quadruple;
mod rows;

pub use discriminant::{
    Method, Quadruples, cost as discriminant_cost, discriminant_sum, discriminants,
    fixed_target_sum,
};
pub(crate) use gram::block_determinant;
pub use gram::{GRAM_SIZE, bearing_gram};
pub use log_det::bearing_log_det_trials;
pub use motion::{Motion, motion_rows};
pub use observability_test::{TEST_SIZE, observability_tests};
pub use quadruple::{EXACT as EXACT_QUADRUPLES, Quadruple, best_quadruple, best_quadruples};
pub use rows::{Target, bearing_rows};
