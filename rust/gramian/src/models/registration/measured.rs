//! Reports as a [`Model`] of the biases alone: each target is where it is likeliest.
//!
//! The position of a look is eliminated as for the rows, by reflections at its likeliest
//! place for the given biases, so that (N - 1) d residuals and rows are left of a look.
//! Sum of squares and gradient are those of biases and positions together.
//!
//! # Source
//! Golub & Pereyra 1973, in the form of Kaufman 1975.

use alloc::vec;
use alloc::vec::Vec;

use super::look::{eliminate, fill, unchecked_place, width};
use super::{Error, Layout};
use crate::solve::Model;

/// What else may be true: its kind, of which bias or sensor, and its whitened column.
pub type Alternative = (&'static str, usize, Vec<f64>);

/// Reports of looks, and the sensors that made them.
///
/// ```
/// use gramian::registration::{Layout, measured::Measured};
/// use gramian::solve::{self, Model};
/// // Exact reports of a target at (20 km, 30 km) and one at (30 km, 20 km).
/// let report = |x: f64, y: f64| [x.hypot(y), x.atan2(y)];
/// let looks = [[20e3, 30e3], [30e3, 20e3_f64], [-9e3, 41e3]];
/// let reports: Vec<f64> = looks
///     .iter()
///     .flat_map(|[x, y]| [report(*x, *y), report(x - 60e3, *y)].concat())
///     .collect();
/// let record = Measured {
///     layout: Layout::PAIR,
///     sensors: vec![0.0, 0.0, 60e3, 0.0],
///     sigma: vec![50.0, 2e-3, 50.0, 2e-3],
///     reports,
/// };
/// let found = solve::minimize(&record, &[10.0, 0.0, 0.0, 1e-3], &[], solve::Options::default());
/// assert!(found.converged && found.x.iter().all(|bias| bias.abs() < 1e-4));
/// ```
#[derive(Clone, Debug)]
pub struct Measured {
    /// How many sensors, and which biases.
    pub layout: Layout,
    /// Their places, d numbers each, m.
    pub sensors: Vec<f64>,
    /// Deviations, d numbers each.
    pub sigma: Vec<f64>,
    /// Reports (K, N, d).
    pub reports: Vec<f64>,
}

impl Measured {
    fn looks(&self) -> usize {
        self.reports.len() / (self.layout.sensors * self.layout.size()).max(1)
    }

    /// Calls `each` with every look, its reduced lines (position, biases, residual) and
    /// its likeliest place.
    fn over(
        &self,
        biases: &[f64],
        reports: &[f64],
        mut each: impl FnMut(usize, &[f64], &[f64]),
    ) -> Result<(), Error> {
        let layout = self.layout;
        let (d, count, c) = (layout.size(), layout.sensors, width(&layout));
        let per = layout.per_sensor();
        let mut lines = vec![0.0; count * d * c];
        let mut work = vec![0.0; c];
        for k in 0..self.looks() {
            let report = &reports[k * count * d..][..count * d];
            let mut place = [0.0; 3];
            let mut one = [0.0; 3];
            for s in 0..count {
                let sensor = &self.sensors[s * d..][..d];
                let bias = &biases[s * per..][..per];
                unchecked_place(&layout, sensor, bias, &report[s * d..][..d], &mut one);
                for i in 0..d {
                    place[i] += one[i] / count as f64;
                }
            }
            for _ in 0..30 {
                let given = Some(report);
                let (sensors, sigma) = (&self.sensors, &self.sigma);
                fill(
                    &layout,
                    sensors,
                    sigma,
                    biases,
                    &place[..d],
                    given,
                    &mut lines,
                )
                .map_err(|error| error.at(k))?;
                eliminate(&layout, &mut lines, &mut work);
                let mut step = [0.0; 3];
                let mut left = 0.0;
                for i in (0..d).rev() {
                    let line = &lines[i * c..][..c];
                    left += line[c - 1] * line[c - 1];
                    let later: f64 = (i + 1..d).map(|j| line[j] * step[j]).sum();
                    step[i] = (line[c - 1] - later) / line[i];
                }
                // A step of 1e-10 deviations is none.
                if left < 1e-20 {
                    break;
                }
                for i in 0..d {
                    place[i] += step[i];
                }
            }
            each(k, &lines, &place[..d]);
        }
        Ok(())
    }

    /// The likeliest places (K, d).
    ///
    /// # Errors
    /// Where a target would be on a sensor.
    pub fn positions(&self, biases: &[f64]) -> Result<Vec<f64>, Error> {
        let mut out = Vec::with_capacity(self.looks() * self.layout.size());
        self.over(biases, &self.reports, |_, _, place| {
            out.extend_from_slice(place);
        })?;
        Ok(out)
    }

    /// What else may be true, as whitened columns: a drift over the looks of each bias,
    /// and of each sensor a gain, if it is not among the biases.
    ///
    /// # Errors
    /// Where a target would be on a sensor.
    pub fn alternatives(&self, biases: &[f64]) -> Result<Vec<Alternative>, Error> {
        let (m, n, looks) = (self.measurements(), self.states(), self.looks());
        let mut rows = vec![0.0; m * n];
        self.linearize(biases, &mut vec![0.0; m], Some(&mut rows))?;
        let each = m / looks.max(1);
        let middle = 0.5 * (looks.max(1) - 1) as f64;
        let mut found: Vec<_> = (0..n)
            .map(|j| {
                let column = (0..m).map(|i| ((i / each) as f64 - middle) * rows[i * n + j]);
                ("drift", j, column.collect::<Vec<f64>>())
            })
            .collect();
        if self.layout.gain {
            return Ok(found);
        }
        let layout = Layout {
            gain: true,
            ..self.layout
        };
        let (per, more) = (self.layout.per_sensor(), layout.per_sensor());
        let d = layout.size();
        let mut wide = vec![0.0; layout.states()];
        for s in 0..layout.sensors {
            wide[s * more..][..d].copy_from_slice(&biases[s * per..][..d]);
            wide[s * more + d + 1..][..per - d].copy_from_slice(&biases[s * per + d..][..per - d]);
        }
        let record = Self {
            layout,
            ..self.clone()
        };
        let total = layout.states();
        let mut rows = vec![0.0; m * total];
        record.linearize(&wide, &mut vec![0.0; m], Some(&mut rows))?;
        for s in 0..layout.sensors {
            let at = s * more + d;
            let column = (0..m).map(|i| rows[i * total + at]).collect();
            found.push(("gain", s, column));
        }
        Ok(found)
    }
}

impl Model for Measured {
    type Error = Error;

    fn states(&self) -> usize {
        self.layout.states()
    }

    fn measurements(&self) -> usize {
        self.looks() * self.layout.rows()
    }

    fn channels(&self) -> usize {
        self.layout.rows()
    }

    fn linearize(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        mut rows: Option<&mut [f64]>,
    ) -> Result<(), Error> {
        let (d, n, c) = (self.layout.size(), x.len(), width(&self.layout));
        let mut at = 0;
        self.over(x, &self.reports, |_, lines, _| {
            for line in lines[d * c..].chunks_exact(c) {
                residuals[at] = line[c - 1];
                if let Some(rows) = rows.as_deref_mut() {
                    rows[at * n..][..n].copy_from_slice(&line[d..d + n]);
                }
                at += 1;
            }
        })
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), Error> {
        // The exact reports of `a`, as `b` would explain them.
        let layout = self.layout;
        let (d, per) = (layout.size(), layout.per_sensor());
        let mut exact = vec![0.0; self.reports.len()];
        let mut next = 0;
        for place in self.positions(a)?.chunks_exact(d) {
            for s in 0..layout.sensors {
                let (sensor, sigma) = (&self.sensors[s * d..][..d], &self.sigma[s * d..][..d]);
                let bias = &a[s * per..][..per];
                let seen = super::look::unchecked_linearise(&layout, sensor, sigma, bias, place)?;
                exact[next..next + d].copy_from_slice(&seen.measured[..d]);
                next += d;
            }
        }
        let record = Self {
            reports: exact,
            ..self.clone()
        };
        record.linearize(b, out, None)?;
        for out in out {
            *out = -*out;
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::batch::Stream;

    #[test]
    fn the_gradient_of_chi2_is_that_of_rows_and_residuals() {
        let mut random = Stream::new(3, 0);
        let layout = Layout::simple(super::super::Dimension::Plane, 3);
        let sensors = vec![0.0, 0.0, 60e3, 5e3, 20e3, -40e3];
        let mut reports = Vec::new();
        for _ in 0..6 {
            let (x, y) = (30e3 * random.normal(), 60e3 + 5e3 * random.normal());
            for s in sensors.chunks(2) {
                let (dx, dy) = (x - s[0], y - s[1]);
                reports.push(f64::hypot(dx, dy) + 50.0 * random.normal());
                reports.push(f64::atan2(dx, dy) + 2e-3 * random.normal());
            }
        }
        let record = Measured {
            layout,
            sensors,
            sigma: [50.0, 2e-3].repeat(3),
            reports,
        };
        let x = [100.0, 1e-3, -50.0, 2e-3, 0.0, -1e-3];
        let (m, n) = (record.measurements(), record.states());
        assert_eq!((m, n), (24, 6));
        let chi2 = |x: &[f64]| -> f64 {
            let mut r = vec![0.0; m];
            record.linearize(x, &mut r, None).unwrap();
            r.iter().map(|r| r * r).sum()
        };
        let (mut r, mut rows) = (vec![0.0; m], vec![0.0; m * n]);
        record.linearize(&x, &mut r, Some(&mut rows)).unwrap();
        for j in 0..n {
            let analytic: f64 = -2.0 * (0..m).map(|i| r[i] * rows[i * n + j]).sum::<f64>();
            let step = if j % 2 == 0 { 0.1 } else { 1e-6 };
            let mut moved = x;
            moved[j] += step;
            let plus = chi2(&moved);
            moved[j] -= 2.0 * step;
            let numeric = (plus - chi2(&moved)) / (2.0 * step);
            assert!((analytic - numeric).abs() < 1e-5 * (1.0 + numeric.abs()));
        }
        let mut difference = vec![1.0; m];
        record.difference(&x, &x, &mut difference).unwrap();
        assert!(difference.iter().all(|d| d.abs() < 1e-8));
        let alternatives = record.alternatives(&x).unwrap();
        assert_eq!(alternatives.len(), 9);
        assert!(alternatives.iter().all(|(_, _, c)| c.len() == m));
    }
}
