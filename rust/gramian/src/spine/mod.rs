//! Everything that follows from the rows, whatever model made them: information,
//! triangular factor, spectrum, bound and the verdict.

#[cfg(feature = "alloc")]
mod balance;
#[cfg(feature = "std")]
pub mod batch_gram;
pub mod bound;
#[cfg(feature = "std")]
mod columns;
pub mod constrained;
pub mod information;
#[cfg(feature = "alloc")]
mod light_rows;
#[cfg(feature = "alloc")]
pub mod observability;
#[cfg(feature = "alloc")]
pub(crate) mod parts;
#[cfg(feature = "std")]
pub mod rounding;
pub mod rows;
pub mod spectrum;
pub mod square_root;
#[cfg(feature = "alloc")]
mod touch;
#[cfg(feature = "alloc")]
pub mod verdict;
