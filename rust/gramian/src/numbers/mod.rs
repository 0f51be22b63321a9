//! Numbers and what is asked of them: the number types, their elementary
//! functions, vectors of them, errors, and the chi-square distribution.

pub mod chi_square;
pub(crate) mod lane;
pub mod scalar;
