#![no_std]
#![deny(missing_docs)]
//! What a set of measurements can and cannot determine, how accurately, and
//! what to do about it.
//!
//! Every question is asked of one array: the whitened Jacobian **rows** A, one
//! line (d h / d x) / sigma for each measurement. J = A^T A is the Fisher
//! information. The states are observable iff rank A is their number; how well
//! is in the singular values; what to do is to add rows (a maneuver, a sensor,
//! a prior) or to drop columns (something known).
//!
//! ```
//! use gramian::{bearings, bound, spectrum::Spectrum, square_root::SquareRootInformation};
//!
//! // An observer on a straight line, a target at constant velocity.
//! let times = [0.0_f64, 60.0, 120.0, 180.0, 240.0];
//! let observer = times.map(|t| [0.0, 5.0 * t]);
//! let target = times.map(|t| bearings::position(&[2000.0, 8000.0, 3.0, -1.0], t).unwrap());
//! let mut root = SquareRootInformation::new();
//! bearings::push_rows(&times, &observer, &target, &[0.01], &mut root).unwrap();
//! let spectrum = Spectrum::new(&root);
//! assert_eq!(spectrum.rank(), 3);
//! assert!(bound::crlb_std(&spectrum)[0].is_infinite());
//! ```
//!
//! # Conventions
//! SI units and radians. x is east, y is north, bearings and azimuths are
//! clockwise from north. Matrices in slices are row-major.
//!
//! # Map
//! | module | what is in it |
//! |---|---|
//! | [`rows`] | [`RowSink`](rows::RowSink): models push rows, accumulators take them |
//! | [`square_root`], [`spectrum`], [`bound`] | the triangular factor row by row; rank, null space, bounds from it |
//! | [`information`] | the Fisher matrix itself, where it is wanted |
//! | [`bearings`] | rows, the discriminant, a test on noisy bearings, the streaming [`Monitor`](bearings::Monitor) |
//! | [`maneuver`] | heading laws, the best of a set of headings |
//! | [`posterior`] | the posterior bound, predict and update apart |
//! | [`dipole`] | field, Jacobians, running information of a magnetic dipole's pass |
//! | [`registration`] | biases of sensors that see the same targets, the running degree |
//! | [`linear`] | at which derivative a state of a linear system is seen |
//! | `observability` (`alloc`), `batch` (`std`), `dense` | run-time sizes; many trials; large matrices |
//!
//! # Features
//! | feature | gives | costs |
//! |---|---|---|
//! | `std` (default) | elementary functions of the platform, `batch` over many trials | the standard library |
//! | `libm` | elementary functions without `std` | a pure Rust libm |
//! | `alloc` | problems whose size is known at run time | an allocator |
//! | `parallel` | several threads in `batch` | rayon |
//! | `dense` | factorisations of large matrices | faer |
//!
//! One of `std` and `libm` must be on.

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!(
    "gramian needs elementary functions: turn on the feature `std`, or `libm` without std"
);

// Tests run on a computer that has both, whatever the crate is built without.
#[cfg(any(feature = "alloc", test))]
extern crate alloc;
#[cfg(any(feature = "std", test))]
extern crate std;

pub mod bearings;
pub mod bound;
pub mod chi_square;
pub mod dipole;
pub mod information;
mod lane;
pub mod linear;
pub mod maneuver;
pub mod posterior;
pub mod registration;
pub mod rows;
pub mod scalar;
pub mod spectrum;
pub mod square_root;

#[cfg(feature = "std")]
pub mod batch;
#[cfg(feature = "dense")]
pub mod dense;
#[cfg(feature = "alloc")]
pub mod observability;
