//! From measurements to states: what every estimator shares.
//!
//! A model with its measurements is a [`Model`]: whitened residuals at a state and the
//! rows there. Estimate, fit, other solutions and regions follow from these two and are
//! written once, here.

/// A model together with its measurements, of a size known at run time.
///
/// All numbers are whitened: divided by their standard deviations, or multiplied by the
/// inverse Cholesky factor of their covariance. Angles are wrapped before that.
pub trait Model: Sync {
    /// What can be wrong at a state.
    type Error;

    /// Number n of states.
    fn states(&self) -> usize;

    /// Number m of whitened measurements, priors not included.
    fn measurements(&self) -> usize;

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

    /// Calls `found` with each other state that gives exactly the same data as `x`: a
    /// mirror image, for one.
    fn symmetries(&self, x: &[f64], found: &mut dyn FnMut(&[f64])) {
        let _ = (x, found);
    }
}
