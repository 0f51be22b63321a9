//! Bounds over many trials.

mod crlb_std;
mod posterior;
mod unit_factor;

pub use crlb_std::crlb_std;
pub use posterior::{Recursion, posterior};
