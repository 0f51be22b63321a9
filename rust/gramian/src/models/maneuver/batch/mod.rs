//! Maneuvers over many trials: headings, paths, information along them, plans and
//! the closed loop.

pub mod closed_loop;
mod fisher;
mod headings;
mod paths;
pub mod plan;

pub use fisher::{Determinant, Sightings, fisher, fisher_det};
pub use headings::{headings, sides};
pub use paths::{Paths, path_size, trajectories};
