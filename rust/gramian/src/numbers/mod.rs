//! Numbers and what is asked of them: the number types, their elementary
//! functions, vectors of them, angles, errors, and the chi-square distribution.

pub(crate) mod algebra;
pub mod angle;
pub mod chi_square;
#[cfg(feature = "std")]
pub mod derivative;
#[cfg(feature = "std")]
pub mod dual;
pub mod errors;
pub mod lane;
pub mod scalar;
#[cfg(feature = "alloc")]
pub mod words;
