//! The models: each makes rows, and brings what is special to it.

pub mod bearings;
pub mod dipole;
#[cfg(feature = "alloc")]
pub mod dynamics;
pub mod inertial;
pub mod linear;
pub mod maneuver;
pub mod registration;
pub mod tracks;
