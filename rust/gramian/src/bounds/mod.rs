//! Bounds beyond the Cramer-Rao bound of one set of rows.

#[cfg(feature = "std")]
pub mod batch;
pub mod posterior;
#[cfg(feature = "std")]
pub mod threshold;
