//! Bearings of a target that moves as a polynomial in time, as a [`Model`].

use alloc::vec::Vec;

use super::motion::moved_along;
use super::{Error, motion_row};
use crate::numbers::angle::wrapped;
use crate::solve::Model;

/// A recording: what was measured, when and from where.
///
/// The states are the derivatives of the target's place at the first time, two for each
/// order, as for [`motion`](super::motion()). There must be as many times as bearings and
/// places, and one deviation or as many.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Times since the first, s.
    pub times: Vec<f64>,
    /// Places of the observer (east, north), m.
    pub observer: Vec<[f64; 2]>,
    /// Bearings clockwise from north, rad.
    pub bearings: Vec<f64>,
    /// Standard deviations, rad: one, or one for each.
    pub sigma: Vec<f64>,
    /// 2, 4, 6 or 8.
    pub states: usize,
}

impl Measured {
    /// Offset of the target at sample `i`, and its deviation.
    fn offset(&self, i: usize, x: &[f64]) -> ([f64; 2], f64) {
        let place: [f64; 2] = moved_along(x, self.times[i]);
        let from = self.observer[i];
        let sigma = self.sigma[if self.sigma.len() == 1 { 0 } else { i }];
        ([place[0] - from[0], place[1] - from[1]], sigma)
    }
}

impl Model for Measured {
    type Error = Error;

    fn states(&self) -> usize {
        self.states
    }

    fn measurements(&self) -> usize {
        self.bearings.len()
    }

    fn linearize(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        mut rows: Option<&mut [f64]>,
    ) -> Result<(), Error> {
        let n = self.states;
        for i in 0..self.bearings.len() {
            let (offset, sigma) = self.offset(i, x);
            residuals[i] = wrapped(self.bearings[i] - offset[0].atan2(offset[1])) / sigma;
            if let Some(rows) = rows.as_deref_mut() {
                let row = &mut rows[i * n..][..n];
                motion_row(self.times[i], offset, sigma, row).map_err(|e| e.at(i))?;
            }
        }
        Ok(())
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), Error> {
        for (i, out) in out.iter_mut().enumerate().take(self.bearings.len()) {
            let ((p, sigma), (q, _)) = (self.offset(i, a), self.offset(i, b));
            *out = wrapped(q[0].atan2(q[1]) - p[0].atan2(p[1])) / sigma;
        }
        Ok(())
    }
}
