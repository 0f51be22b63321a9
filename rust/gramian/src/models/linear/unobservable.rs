//! What no output shows, in the units of the user: the subspace, its modes, and which
//! further output would show it.
//!
//! ```
//! use gramian::linear::unobservable::Unobservable;
//! // Two equal oscillators of which the sum is measured.
//! let a = [0.0, 1.0, 0.0, 0.0, -4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -4.0, 0.0];
//! let found = Unobservable::new(&a, &[1.0, 0.0, 1.0, 0.0], 4, None)?;
//! assert_eq!(found.null_space().len(), 2);
//! assert!((found.modes()[0].eigenvalue[1] - 2.0).abs() < 1e-12);
//! // Either position, measured by itself, repairs it.
//! assert_eq!(found.left_by(&[1.0, 0.0, 0.0, 0.0])?, vec![0]);
//! # Ok::<(), gramian::linear::Error>(())
//! ```

use alloc::vec;
use alloc::vec::Vec;

use super::Error;
use super::analysis::{balance, reduced_null_space};
use super::pencil::{self, Pencil};
use super::scaling::{self, add};
use super::schur::root;
use crate::numbers::algebra::dot_slices as dot;
use crate::scalar::{NumberError, all_finite, check_finite, check_length};
use crate::spectrum::check_rtol;

/// A mode that no output shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Real and imaginary part (not negative), per unit of time; of a discrete system, a
    /// factor per step.
    pub eigenvalue: [f64; 2],
    /// Combinations of the states that it moves, in their units: each has a state with
    /// coefficient 1 that the others do not have.
    pub combinations: Vec<Vec<f64>>,
}

/// The unobservable subspace of a system, decided after balancing.
#[derive(Clone, Debug)]
pub struct Unobservable {
    n: usize,
    found: pencil::Unobservable,
    modes: Vec<Mode>,
    null_space: Vec<Vec<f64>>,
    states: Vec<f64>,
    time: f64,
    /// A in the subspace, balanced.
    restricted: Vec<f64>,
}

impl Unobservable {
    /// Of A (n x n) and C (p x n). A singular value of the balanced pencil below `rtol` of
    /// its norm counts as zero; by default [`default_rtol`](super::default_rtol).
    ///
    /// # Errors
    /// [`Error::Number`] for lengths, numbers or a tolerance that do not fit;
    /// [`Error::Pencil`] where the eigenvalues are not found.
    pub fn new(a: &[f64], c: &[f64], n: usize, rtol: Option<f64>) -> Result<Self, Error> {
        let p = c.len().checked_div(n).unwrap_or(0);
        check_length("states", n, n.max(1))?;
        check_length("A", a.len(), n.saturating_mul(n))?;
        check_length("outputs", p, p.max(1))?;
        check_length("C", c.len(), p.saturating_mul(n))?;
        check_finite("A", a)?;
        check_finite("C", c)?;
        if let Some(rtol) = rtol {
            check_rtol(rtol)?;
        }
        let (mut a, mut c) = (a.to_vec(), c.to_vec());
        let scales = balance(&mut a, &mut c, n);
        scaling::check(&a, &c, n)?;
        let (states, time, center) = (scales.states, scales.time, scales.centers[0]);
        let found = Pencil::new(&a, &c, n)?.unobservable(rtol)?;
        let touch = found.touch();
        let null_space = reduced_null_space(&found.kernel, &states, touch).0;
        let mut modes = Vec::new();
        for mode in pencil::modes(&a, n, &found.kernel)? {
            modes.push(Mode {
                eigenvalue: [
                    mode.eigenvalue[0] / time + center,
                    mode.eigenvalue[1] / time,
                ],
                combinations: reduced_null_space(&mode.basis, &states, touch).0,
            });
        }
        if !(null_space.iter().all(|v| all_finite(v))
            && modes
                .iter()
                .flat_map(|m| &m.combinations)
                .all(|v| all_finite(v)))
        {
            return Err(NumberError::Overflow {
                result: "null space",
            }
            .into());
        }
        let restricted = pencil::restricted(&a, n, &found.kernel);
        Ok(Self {
            n,
            found,
            modes,
            null_space,
            states,
            time,
            restricted,
        })
    }

    /// How the subspace was decided.
    pub fn found(&self) -> &pencil::Unobservable {
        &self.found
    }

    /// The modes, the least damped first.
    pub fn modes(&self) -> &[Mode] {
        &self.modes
    }

    /// Basis of the subspace in physical units, reduced.
    pub fn null_space(&self) -> &[Vec<f64>] {
        &self.null_space
    }

    /// What a balanced state is multiplied by to give the physical one.
    pub fn state_scales(&self) -> &[f64] {
        &self.states
    }

    /// What the unit of time is multiplied by.
    pub fn time_scale(&self) -> f64 {
        self.time
    }

    /// Takes from rows (k x n, about the state) what rounding says of the subspace.
    pub fn project(&self, rows: &mut [f64]) {
        let n = self.n;
        for row in rows.chunks_exact_mut(n) {
            let mut balanced: Vec<f64> = row.iter().zip(&self.states).map(|(x, d)| x * d).collect();
            for v in self.found.kernel.chunks_exact(n) {
                let along = dot(v, &balanced);
                add(&mut balanced, -along, v);
            }
            for ((x, b), d) in row.iter_mut().zip(balanced).zip(&self.states) {
                *x = b / d;
            }
        }
    }

    /// How many combinations stay unobservable when one further output is measured, for
    /// each row of `outputs` (k x n).
    ///
    /// # Errors
    /// [`Error::Number`] for a length that does not fit or numbers that are not finite;
    /// [`Error::Pencil`].
    pub fn left_by(&self, outputs: &[f64]) -> Result<Vec<usize>, Error> {
        let n = self.n;
        let count = outputs.len() / n;
        check_length("outputs", outputs.len(), count * n)?;
        check_finite("outputs", outputs)?;
        let m = self.found.dimension();
        if m == 0 {
            return Ok(vec![0; count]);
        }
        let size = root(dot(&self.restricted, &self.restricted));
        let size = if size > 0.0 { size } else { 1.0 };
        let mut left = Vec::with_capacity(count);
        for row in outputs.chunks_exact(n) {
            let balanced: Vec<f64> = row.iter().zip(&self.states).map(|(x, d)| x * d).collect();
            let norm = root(dot(&balanced, &balanced));
            let factor = if norm > 0.0 { size / norm } else { 0.0 };
            let seen: Vec<f64> = self
                .found
                .kernel
                .chunks_exact(n)
                .map(|v| factor * dot(v, &balanced))
                .collect();
            let rtol = Some(self.found.rtol.max(super::default_rtol(n)));
            left.push(
                Pencil::new(&self.restricted, &seen, m)?
                    .unobservable(rtol)?
                    .dimension(),
            );
        }
        Ok(left)
    }
}

/// A and C centered and balanced: powers of two for states, outputs and time with which
/// their entries come as near to one as they can.
///
/// # Errors
/// [`Error::Number`] for lengths that do not fit, or squares that exceed the numbers.
pub fn balanced(a: &[f64], c: &[f64], n: usize) -> Result<(Vec<f64>, Vec<f64>), Error> {
    let p = c.len().checked_div(n).unwrap_or(0);
    check_length("A", a.len(), n.saturating_mul(n))?;
    check_length("C", c.len(), p.saturating_mul(n))?;
    let (mut a, mut c) = (a.to_vec(), c.to_vec());
    if n > 0 {
        balance(&mut a, &mut c, n);
    }
    scaling::check(&a, &c, n)?;
    Ok((a, c))
}
