#![no_std]
#![deny(missing_docs)]
#![forbid(unsafe_code)]
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
//! While measurements arrive, [`bearings::Monitor`] and its like keep the triangular
//! factor and nothing else:
//!
//! ```
//! use gramian::bearings::Monitor;
//!
//! let mut monitor = Monitor::<f32>::new();
//! for i in 0..40 {
//!     // The observer goes north and turns east after 20 bearings.
//!     let (t, late) = (20.0 * i as f32, 20.0 * (i - 20).max(0) as f32);
//!     let bearing = (3.0 * t - 5.0 * late).atan2(10_000.0 - t - 5.0 * (t - late));
//!     monitor.push(t, bearing, 0.009, None)?;
//! }
//! assert_eq!(monitor.answer().rank, 4);
//! assert!(monitor.answer().p_value < 0.001);
//! # Ok::<(), gramian::bearings::Error>(())
//! ```
//!
//! # Conventions
//! Units are SI: metres, seconds, radians, tesla, ampere square metres. x is east, y is
//! north, z is up; bearings and azimuths are clockwise from north. Matrices in slices
//! are row-major. A bound that does not exist is `inf`. Nothing panics: what is wrong
//! comes back as an error that names the entry, its value and what was expected.
//!
//! Every function without `std` takes `f32` and `f64`. In `f32` count times from near the
//! first one and positions from a local origin, subtracted before the conversion: rounded
//! positions bend a straight track, and an unobservable one then looks observable. The
//! monitor keeps ranks and, to 1 %, bounds on tracks with turns down to one degree, over
//! millions of bearings. `docs/howto/embedded.md` of the repository has the measured errors,
//! and flash, stack and instructions on a microcontroller.
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
//! | [`tracks`] | any motion, any sensors, unknown biases; a streaming [`Tracker`](tracks::stream::Tracker) |
//! | [`inertial`] | the error model of a strapdown navigator: at rest, moving, along a flight |
//! | [`linear`] | at which derivative a state of a linear system is seen, and whether it is |
//! | [`dynamics`] (`alloc`) | rows along a trajectory of a nonlinear system |
//! | [`chi_square`], [`scalar`] | how likely a sum of squares is; the number types |
//! | [`observability`] (`alloc`) | the whole answer for a size known at run time |
//! | [`choose`] (`std`) | which measurements to add: greedy, exchange, relaxation with its gap |
//! | [`batch`] (`std`), [`large`] | many trials by vectors and threads; large matrices |
//!
//! # Features
//! | feature | gives | costs |
//! |---|---|---|
//! | `libm` | elementary functions without `std` | 9 crates, 18 s |
//! | `alloc` | problems whose size is known at run time: [`observability`], [`linear::analysis`], [`registration::estimate`] | an allocator, 1 s |
//! | `std` (default) | elementary functions of the platform, [`batch`] over many trials, [`dipole::localize`] | the standard library, 27 crates, 95 s |
//! | `parallel` | several threads in [`batch`] | 6 crates more (rayon), 7 s |
//! | `large` | dense problems above about 64 states, sparse ones of any size | 31 crates more (faer), 110 s |
//!
//! The seconds are of one core, for the crate and all it depends on, from nothing, in a
//! release build by rustc 1.95. Without `std` the monitor takes 18 kB of flash, 220 bytes
//! of memory and 1.5 kB of stack on a Cortex-M4F; the heading laws or the dipole 4 kB.
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

#[cfg(feature = "std")]
pub mod batch;
pub mod bounds;
#[cfg(feature = "std")]
pub mod choose;
#[cfg(feature = "large")]
pub mod large;
pub mod models;
pub mod numbers;
#[cfg(feature = "alloc")]
pub mod solve;
pub mod spine;

pub use bounds::posterior;
#[cfg(feature = "alloc")]
pub use models::dynamics;
pub use models::{bearings, dipole, inertial, linear, maneuver, registration, tracks};
pub use numbers::{chi_square, scalar};
#[cfg(feature = "alloc")]
pub use spine::observability;
#[cfg(feature = "std")]
pub use spine::rounding;
pub use spine::{bound, constrained, information, rows, spectrum, square_root};

/// The examples of the readme run as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub mod readme {}
