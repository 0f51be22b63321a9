//! From measurements to states: what every estimator shares.
//!
//! A model with its measurements is a [`Model`]: whitened residuals at a state and the
//! rows there. What follows from these two is written once, here:
//!
//! | module | what is in it |
//! |---|---|
//! | [`gauss_newton`] | the most likely state from one start, functions of it held |
//! | [`side_by_side`] | the same for many small problems at once, one in each lane |
//! | [`starts`] | where to start, many starts, clusters of what they reach |
//! | [`measured`] | a measurement function known by its values, and many records of it |
//! | [`noise`] | noise that is correlated in time: how to whiten it, how large it is |
//! | [`fit`] | does the model fit, what would explain that it does not |
//! | [`other_solutions`] | which other states fit as well |
//! | [`region`] | intervals and contours of the likelihood |
//! | [`unbounded`] | what to report where the likelihood grows towards infinity |
//! | [`trials`] | all of it for many simulated records |

use core::ops::Range;

#[cfg(feature = "std")]
pub mod fit;
#[cfg(feature = "std")]
pub mod gauss_newton;
#[cfg(feature = "std")]
pub mod knowledge;
#[cfg(feature = "std")]
pub mod measured;
#[cfg(feature = "std")]
pub mod noise;
#[cfg(feature = "std")]
pub mod other_solutions;
#[cfg(feature = "std")]
pub mod region;
#[cfg(feature = "std")]
pub mod side_by_side;
#[cfg(feature = "std")]
pub mod starts;
#[cfg(feature = "std")]
pub mod trials;
#[cfg(feature = "std")]
pub mod unbounded;

#[cfg(feature = "std")]
pub use gauss_newton::{Loss, Options, Solution, minimize};
#[cfg(feature = "std")]
pub use knowledge::{Held, WithPrior};

#[cfg(test)]
mod tests;

/// A model together with its measurements, of a size known at run time.
///
/// All numbers are whitened: divided by their standard deviations, or multiplied by the
/// inverse Cholesky factor of their covariance. Angles are wrapped before that.
pub trait Model: Sync {
    /// What can be wrong at a state.
    type Error;

    /// Number n of states.
    fn states(&self) -> usize;

    /// Number m of whitened measurements, and of what is known beforehand where that
    /// is part of the model.
    fn measurements(&self) -> usize;

    /// How many of these, the last ones, are no measurements but prior knowledge: no
    /// robust loss touches them, and they have no place in the order of time.
    fn priors(&self) -> usize {
        0
    }

    /// Which of the whitened numbers are exact, no measurements with noise: a state keeps to
    /// them, whatever the others say. Each is whitened by a deviation far below what the
    /// others tell, so that rows alone nearly say as much.
    fn exact(&self) -> Range<usize> {
        0..0
    }

    /// How many measurements are made at each time: neighbours in time, of one channel,
    /// are so many places apart.
    fn channels(&self) -> usize {
        1
    }

    /// Writes the residuals z - h(x), length m, and, where they are asked for, the
    /// rows dh/dx, row-major (m, n), all whitened.
    ///
    /// # Errors
    /// Where the model has no value or no derivative: at a sensor, outside its domain.
    fn linearize(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        rows: Option<&mut [f64]>,
    ) -> Result<(), Self::Error>;

    /// Writes the difference of the exact data of two states, h(b) - h(a), whitened,
    /// angles wrapped.
    ///
    /// # Errors
    /// As [`linearize`](Model::linearize).
    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), Self::Error>;

    /// Writes how far state `b` is from `a`, where a state may be written in several ways
    /// (an angle and the same with a whole turn) by the shortest way.
    fn change(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
            *out = b - a;
        }
    }

    /// The open interval in which state `k` is written beside `x`: of an angle half a turn
    /// either way, of a speed from zero. [`change`](Model::change) leads to states that are
    /// written so, and what is outside all the same is no other solution.
    fn extent(&self, x: &[f64], k: usize) -> (f64, f64) {
        let _ = (x, k);
        (f64::NEG_INFINITY, f64::INFINITY)
    }

    /// Moves a state to the nearest one that is possible, where the states lie on a surface:
    /// a quaternion to length one. The rows there are those along the surface, with one or
    /// more that tie the state to it.
    fn retract(&self, x: &mut [f64]) {
        let _ = x;
    }

    /// Writes how much of the length of each column of the rows is rounding of what they are
    /// computed from, coordinates and times: for
    /// [`rounding::remove`](crate::spine::rounding::remove). Whether there is any that ranks
    /// must be decided above.
    fn rounding(&self, x: &[f64], noise: &mut [f64]) -> bool {
        let _ = (x, noise);
        false
    }

    /// Calls `found` with each other state that gives the same data as `x`, or nearly so: a
    /// mirror image, for one. Each is followed to where chi2 is least.
    fn symmetries(&self, x: &[f64], found: &mut dyn FnMut(&[f64])) {
        let _ = (x, found);
    }
}

/// The methods of a [`Model`] that a wrapper leaves to the model inside, by name:
/// `forward_model!(this => this.model; states, measurements);`. One that is in no list has the
/// default of the trait, not the answer of the model inside.
#[doc(hidden)]
#[macro_export]
macro_rules! forward_model {
    ($this:ident => $inner:expr; $($method:ident),+ $(,)?) => {
        $($crate::forward_model!(@ $method $this $inner);)+
    };
    (@ states $this:ident $inner:expr) => {
        fn states(&self) -> usize {
            let $this = self;
            $inner.states()
        }
    };
    (@ measurements $this:ident $inner:expr) => {
        fn measurements(&self) -> usize {
            let $this = self;
            $inner.measurements()
        }
    };
    (@ priors $this:ident $inner:expr) => {
        fn priors(&self) -> usize {
            let $this = self;
            $inner.priors()
        }
    };
    (@ exact $this:ident $inner:expr) => {
        fn exact(&self) -> ::core::ops::Range<usize> {
            let $this = self;
            $inner.exact()
        }
    };
    (@ channels $this:ident $inner:expr) => {
        fn channels(&self) -> usize {
            let $this = self;
            $inner.channels()
        }
    };
    (@ linearize $this:ident $inner:expr) => {
        fn linearize(
            &self,
            x: &[f64],
            residuals: &mut [f64],
            rows: ::core::option::Option<&mut [f64]>,
        ) -> ::core::result::Result<(), Self::Error> {
            let $this = self;
            $inner.linearize(x, residuals, rows)
        }
    };
    (@ difference $this:ident $inner:expr) => {
        fn difference(
            &self,
            a: &[f64],
            b: &[f64],
            out: &mut [f64],
        ) -> ::core::result::Result<(), Self::Error> {
            let $this = self;
            $inner.difference(a, b, out)
        }
    };
    (@ change $this:ident $inner:expr) => {
        fn change(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
            let $this = self;
            $inner.change(a, b, out);
        }
    };
    (@ extent $this:ident $inner:expr) => {
        fn extent(&self, x: &[f64], k: usize) -> (f64, f64) {
            let $this = self;
            $inner.extent(x, k)
        }
    };
    (@ retract $this:ident $inner:expr) => {
        fn retract(&self, x: &mut [f64]) {
            let $this = self;
            $inner.retract(x);
        }
    };
    (@ rounding $this:ident $inner:expr) => {
        fn rounding(&self, x: &[f64], noise: &mut [f64]) -> bool {
            let $this = self;
            $inner.rounding(x, noise)
        }
    };
    (@ symmetries $this:ident $inner:expr) => {
        fn symmetries(&self, x: &[f64], found: &mut dyn FnMut(&[f64])) {
            let $this = self;
            $inner.symmetries(x, found);
        }
    };
}

/// A function of the states that can be held at a value.
pub trait Function {
    /// Its value at `x`, and its derivatives, one for each state.
    fn value(&self, x: &[f64], gradient: &mut [f64]) -> f64;

    /// The open interval of the values it can take.
    fn range(&self) -> (f64, f64) {
        (f64::NEG_INFINITY, f64::INFINITY)
    }

    /// Which state it is, where it is one alone.
    fn state(&self) -> Option<usize> {
        None
    }
}

/// c^T x: one state, or a combination of several.
#[derive(Clone, Debug, PartialEq)]
#[cfg(feature = "alloc")]
pub struct Combination(pub alloc::vec::Vec<f64>);

#[cfg(feature = "alloc")]
impl Function for Combination {
    fn value(&self, x: &[f64], gradient: &mut [f64]) -> f64 {
        gradient.copy_from_slice(&self.0);
        self.0.iter().zip(x).map(|(c, x)| c * x).sum()
    }

    fn state(&self) -> Option<usize> {
        let mut terms = (0..).zip(&self.0).filter(|(_, c)| **c != 0.0);
        let first = terms.next().filter(|(_, c)| **c == 1.0)?;
        terms.next().is_none().then_some(first.0)
    }
}

/// The distance of some states, coordinates of a place, from a point.
#[derive(Clone, Debug, PartialEq)]
#[cfg(feature = "std")]
pub struct Distance {
    /// Which states are the coordinates.
    pub states: alloc::vec::Vec<usize>,
    /// The point, a coordinate for each.
    pub from: alloc::vec::Vec<f64>,
}

#[cfg(feature = "std")]
impl Function for Distance {
    fn value(&self, x: &[f64], gradient: &mut [f64]) -> f64 {
        let offsets = self.states.iter().zip(&self.from).map(|(&k, o)| x[k] - o);
        let distance = offsets.clone().fold(0.0_f64, f64::hypot);
        gradient.fill(0.0);
        for (&k, offset) in self.states.iter().zip(offsets) {
            gradient[k] = offset / distance.max(f64::MIN_POSITIVE);
        }
        distance
    }

    fn range(&self) -> (f64, f64) {
        (0.0, f64::INFINITY)
    }
}
