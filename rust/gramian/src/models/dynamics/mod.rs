//! Nonlinear systems with dynamics: x' = f(t, x) or `x[k+1]` = f(k, x), y = h(t, x), given
//! as functions; rows about the state along a trajectory.
//!
//! The derivative of the trajectory is found beside it: each step of the integrator is
//! differentiated exactly (the variational equations, discretised as the state is), so
//! that the transitions are those of the numbers that were computed.

mod blocks;
mod trajectory;
mod windows;

pub use trajectory::{Disagreement, Failure, System, Trajectory, differences, integrate, iterate};
pub use windows::{Look, Path, Rows, windows};
