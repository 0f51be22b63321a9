//! A measurement function that is known by its values, with its measurements: for functions
//! of the user's own, and for many simulated records of one.

use alloc::vec;
use alloc::vec::Vec;
use core::convert::Infallible;

use super::gauss_newton::{Options, minimize};
use super::{Model, WithPrior};
use crate::batch::{Items, Threads};
use crate::numbers::derivative::{self, at_known_steps, jacobian};

/// A measurement function z = h(x).
pub trait Measurement: Sync {
    /// Number n of states.
    fn states(&self) -> usize;

    /// Number m of measurements.
    fn measurements(&self) -> usize;

    /// Writes h(x), length m; NaN where it has no value.
    fn value(&self, x: &[f64], out: &mut [f64]);

    /// Writes the derivatives, row-major (m, n), and says so; `false` where only values are
    /// known, and the derivatives are found by differences.
    fn derivatives(&self, x: &[f64], out: &mut [f64]) -> bool {
        let _ = (x, out);
        false
    }
}

/// What belongs to a measurement function: its noise, its angles, and how it is differenced.
#[derive(Clone, Copy, Debug)]
pub struct Setting<'a> {
    /// One over the standard deviation of each measurement; 0 for a missing one.
    pub weight: &'a [f64],
    /// The period of each measurement, 0 for one that is no angle.
    pub period: &'a [f64],
    /// For each state a step that suits differences, [`derivative::Jacobian::step`] at a state
    /// near by; NaN where none is known. Where it does not serve it is searched for.
    pub step: &'a [f64],
    /// The noise of each value of h, as [`derivative::Options::noise`].
    pub noise: &'a [f64],
}

/// No value, or no derivative, at a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the function has no value, or no derivative, at a state")]
pub struct NoValue;

/// A measurement function with its measurements.
#[derive(Clone, Copy, Debug)]
pub struct Measured<'a, F: ?Sized> {
    /// The function.
    pub h: &'a F,
    /// Noise and angles.
    pub setting: Setting<'a>,
    /// The measurements; what is missing has weight 0 and may be NaN.
    pub z: &'a [f64],
}

impl<F: ?Sized> Measured<'_, F> {
    /// The whitened difference of two measurements `i`, angles to the nearest turn.
    fn off(&self, i: usize, to: f64, from: f64) -> f64 {
        let (weight, period) = (self.setting.weight[i], self.setting.period[i]);
        if weight == 0.0 {
            return 0.0;
        }
        let off = to - from;
        weight
            * if period > 0.0 {
                off - period * (off / period).round()
            } else {
                off
            }
    }
}

impl<F: Measurement + ?Sized> Measured<'_, F> {
    /// The derivatives by differences of known steps, if these are known and serve here.
    fn differences(&self, x: &[f64], rows: &mut [f64]) -> bool {
        let Setting {
            step,
            weight,
            period,
            ..
        } = self.setting;
        let known = step.iter().all(|&step| step > 0.0 && step.is_finite());
        let value = |x: &[f64], out: &mut [f64]| self.h.value(x, out);
        known && at_known_steps(x, step, weight, period, value, rows)
    }
}

impl<F: Measurement + ?Sized> Model for Measured<'_, F> {
    type Error = NoValue;

    fn states(&self) -> usize {
        self.h.states()
    }

    fn measurements(&self) -> usize {
        self.h.measurements()
    }

    fn linearize(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        rows: Option<&mut [f64]>,
    ) -> Result<(), NoValue> {
        let n = x.len();
        let mut at = vec![0.0; residuals.len()];
        self.h.value(x, &mut at);
        for (i, residual) in residuals.iter_mut().enumerate() {
            *residual = self.off(i, self.z[i], at[i]);
            if !residual.is_finite() {
                return Err(NoValue);
            }
        }
        let Some(rows) = rows else {
            return Ok(());
        };
        if !self.h.derivatives(x, rows) && !self.differences(x, rows) {
            let options = derivative::Options {
                scale: &vec![f64::NAN; n],
                weight: self.setting.weight,
                period: self.setting.period,
                noise: self.setting.noise,
                step: &vec![f64::NAN; n],
                pattern: None,
            };
            let evaluate = |points: &[f64], out: &mut [f64]| -> Result<(), Infallible> {
                for (point, out) in points.chunks_exact(n).zip(out.chunks_exact_mut(at.len())) {
                    self.h.value(point, out);
                }
                Ok(())
            };
            let found = jacobian(x, &at, &options, evaluate).map_err(|_| NoValue)?;
            rows.copy_from_slice(&found.values);
        }
        for (row, &weight) in rows.chunks_exact_mut(n).zip(self.setting.weight) {
            for entry in row.iter_mut() {
                // A missing measurement has no derivative that matters.
                *entry = if weight == 0.0 { 0.0 } else { *entry * weight };
            }
        }
        if rows.iter().all(|x| x.is_finite()) {
            Ok(())
        } else {
            Err(NoValue)
        }
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), NoValue> {
        let (mut from, mut to) = (vec![0.0; out.len()], vec![0.0; out.len()]);
        self.h.value(a, &mut from);
        self.h.value(b, &mut to);
        for (i, out) in out.iter_mut().enumerate() {
            *out = self.off(i, to[i], from[i]);
            if !out.is_finite() {
                return Err(NoValue);
            }
        }
        Ok(())
    }
}

/// Many records of one state, each answered by the most likely state.
pub struct Records<'a, F: ?Sized> {
    /// The function.
    pub h: &'a F,
    /// Noise and angles.
    pub setting: Setting<'a>,
    /// The true state, at which each search starts.
    pub truth: &'a [f64],
    /// Measurements (trials, m).
    pub z: Items<'a>,
    /// Prior knowledge: combinations (k, n) of the states.
    pub known: &'a [f64],
    /// Its means (trials, k).
    pub mean: Items<'a>,
    /// Its deviations (k,).
    pub sigma: &'a [f64],
}

impl<F: Measurement + ?Sized> Records<'_, F> {
    /// Numbers that [`run`](Self::run) writes for a trial.
    pub fn size(&self) -> usize {
        2 + self.truth.len()
    }

    /// Writes for each trial 0 for an answer, 1 where the state is not observable there, 2
    /// where the search did not converge; the squared error over the covariance at the
    /// estimate (NEES); and the error of each state. The numbers of a trial without an
    /// answer are NaN.
    pub fn run(&self, threads: Threads, cost: f64, out: &mut [f64]) {
        let options = Options {
            max_iterations: 100,
            ..Options::default()
        };
        let each = |trial: usize, out: &mut [f64]| -> Result<(), Infallible> {
            out.fill(f64::NAN);
            let measured = Measured {
                h: self.h,
                setting: self.setting,
                z: self.z.get(trial),
            };
            let model = WithPrior::new(measured, self.known, self.mean.get(trial), self.sigma);
            let found = minimize(&model, self.truth, &[], options);
            out[0] = match (found.converged, found.determined) {
                (true, true) => 0.0,
                (true, false) => 1.0,
                _ => 2.0,
            };
            if out[0] > 0.0 {
                return Ok(());
            }
            let (m, n) = (model.measurements(), self.truth.len());
            let (mut residuals, mut rows) = (vec![0.0; m], vec![0.0; m * n]);
            let there = model.linearize(&found.x, &mut residuals, Some(&mut rows));
            if there.is_err() {
                out[0] = 2.0;
                return Ok(());
            }
            let error: Vec<f64> = found.x.iter().zip(self.truth).map(|(x, t)| x - t).collect();
            out[1] = rows
                .chunks_exact(n)
                .map(|row| row.iter().zip(&error).map(|(a, e)| a * e).sum::<f64>())
                .map(|along| along * along)
                .sum();
            out[2..].copy_from_slice(&error);
            Ok(())
        };
        let Ok(()) = threads.over(out, self.size(), cost, each);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::batch::Stream;

    /// Ranges to three beacons, and the bearing of the first.
    struct Beacons {
        known: bool,
    }

    const PLACES: [[f64; 2]; 3] = [[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]];

    impl Measurement for Beacons {
        fn states(&self) -> usize {
            2
        }

        fn measurements(&self) -> usize {
            4
        }

        fn value(&self, x: &[f64], out: &mut [f64]) {
            for (out, [a, b]) in out.iter_mut().zip(PLACES) {
                *out = (x[0] - a).hypot(x[1] - b);
            }
            out[3] = x[0].atan2(x[1]);
        }

        fn derivatives(&self, x: &[f64], out: &mut [f64]) -> bool {
            if !self.known {
                return false;
            }
            for (out, [a, b]) in out.chunks_exact_mut(2).zip(PLACES) {
                let (x, y) = (x[0] - a, x[1] - b);
                let r = x.hypot(y);
                out.copy_from_slice(&[x / r, y / r]);
            }
            let r2 = x[0] * x[0] + x[1] * x[1];
            out[6..].copy_from_slice(&[x[1] / r2, -x[0] / r2]);
            true
        }
    }

    const SETTING: Setting<'_> = Setting {
        weight: &[1.0, 1.0, 1.0, 50.0],
        period: &[0.0, 0.0, 0.0, core::f64::consts::TAU],
        step: &[f64::NAN; 2],
        noise: &[f64::NAN; 4],
    };

    /// The rows at a state whose bearing is a whole turn off, which is nothing.
    fn rows(known: bool, step: &[f64; 2]) -> [f64; 8] {
        let x = [30.0, 40.0];
        let mut z = [0.0; 4];
        Beacons { known: true }.value(&x, &mut z);
        z[3] += core::f64::consts::TAU;
        let model = Measured {
            h: &Beacons { known },
            setting: Setting { step, ..SETTING },
            z: &z,
        };
        let (mut residuals, mut rows) = ([1.0; 4], [0.0; 8]);
        model
            .linearize(&x, &mut residuals, Some(&mut rows))
            .unwrap();
        assert!(residuals.iter().all(|r| r.abs() < 1e-12));
        rows
    }

    #[test]
    fn differences_give_the_rows_of_the_derivatives() {
        // Steps that are searched for, known ones, and such as are far too long.
        for step in [[f64::NAN; 2], [5.0; 2], [2000.0; 2]] {
            for (a, b) in rows(true, &step).iter().zip(rows(false, &step)) {
                assert!((a - b).abs() < 1e-7 * a.abs().max(1.0), "{a} {b}");
            }
        }
    }

    #[test]
    fn what_is_missing_tells_nothing() {
        let setting = Setting {
            weight: &[1.0, 1.0, 1.0, 0.0],
            ..SETTING
        };
        let model = Measured {
            h: &Beacons { known: true },
            setting,
            z: &[50.0, 80.0, 60.0, f64::NAN],
        };
        let (mut residuals, mut rows) = ([1.0; 4], [1.0; 8]);
        model
            .linearize(&[30.0, 40.0], &mut residuals, Some(&mut rows))
            .unwrap();
        assert_eq!((residuals[3], &rows[6..]), (0.0, &[0.0, 0.0][..]));
        // At a beacon a range has no derivative: no number, and no panic.
        let there = model.linearize(&[0.0, 0.0], &mut residuals, Some(&mut rows));
        assert_eq!(there, Err(NoValue));
    }

    #[test]
    fn the_squared_errors_are_as_many_as_the_states() {
        let truth = [30.0, 40.0];
        let (trials, h) = (4000, Beacons { known: false });
        let mut z = vec![0.0; 4 * trials];
        for (trial, z) in z.chunks_exact_mut(4).enumerate() {
            let mut stream = Stream::new(1, trial as u64);
            h.value(&truth, z);
            for (z, weight) in z.iter_mut().zip(SETTING.weight) {
                *z += stream.normal() / weight;
            }
        }
        let records = Records {
            h: &h,
            setting: SETTING,
            truth: &truth,
            z: Items::each(&z, 4),
            known: &[],
            mean: Items::shared(&[]),
            sigma: &[],
        };
        let mut out = vec![0.0; trials * records.size()];
        records.run(Threads::One, 1e4, &mut out);
        let mean = out.chunks_exact(4).map(|t| t[1]).sum::<f64>() / trials as f64;
        assert!(out.chunks_exact(4).all(|t| t[0] == 0.0));
        // chi2 of two degrees of freedom: its deviation is 2.
        assert!(
            (mean - 2.0).abs() < 4.0 * 2.0 / (trials as f64).sqrt(),
            "{mean}"
        );
        let mut again = vec![0.0; out.len()];
        records.run(Threads::Auto, 1e4, &mut again);
        assert_eq!(out, again);
    }
}
