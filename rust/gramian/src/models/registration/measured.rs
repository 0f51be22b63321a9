//! Reports as a [`Model`] of the biases alone: each target is where it is likeliest.
//!
//! The position of a look is eliminated as for the rows, by reflections at its likeliest
//! place for the given biases, so that (N - 1) d residuals and rows are left of a look.
//! Sum of squares and gradient are those of biases and positions together.
//!
//! Reports may be missing, positions may be known (a transponder's, say), and clocks may be
//! off: a stamp that is late by c seconds is of a target that was c v before. The path of a
//! platform is on the clock of its own sensor.
//!
//! # Source
//! Golub & Pereyra 1973, in the form of Kaufman 1975.

use alloc::vec;
use alloc::vec::Vec;
use core::f64::consts::PI;

use super::look::{unchecked_linearise, unchecked_place, write_line};
use super::{Error, Layout};
use crate::scalar::{NumberError, wrapped};
use crate::solve::Model;
use crate::square_root::reflect;

/// Biases of angles are within half a turn, and a little: beyond, the same come again.
const TURN: f64 = 3.5;

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
///     truth: None,
///     velocity: None,
/// };
/// let found = solve::minimize(&record, &[10.0, 0.0, 0.0, 1e-3], &[], solve::Options::default());
/// assert!(found.converged && found.x.iter().all(|bias| bias.abs() < 1e-4));
/// ```
#[derive(Clone, Debug)]
pub struct Measured {
    /// How many sensors, and which biases.
    pub layout: Layout,
    /// Their places, d numbers each, m; as many for each look on platforms that move.
    pub sensors: Vec<f64>,
    /// Deviations, d numbers each.
    pub sigma: Vec<f64>,
    /// Reports (K, N, d); NaN where one is missing.
    pub reports: Vec<f64>,
    /// Positions (K, d) that are reported without bias, NaN where none is, and their
    /// deviations (d), m.
    pub truth: Option<(Vec<f64>, Vec<f64>)>,
    /// Velocities (K, d) of the targets, m/s, where clocks may be off: each sensor's clock
    /// is then one more state after the biases; without truth all but the first, to which
    /// the others are compared.
    pub velocity: Option<Vec<f64>>,
}

/// One look with its position eliminated.
struct Look<'a> {
    /// Which.
    index: usize,
    /// The first d lines give the position, the others are free of it.
    lines: &'a [f64],
    place: [f64; 3],
}

impl Measured {
    fn looks(&self) -> usize {
        self.reports.len() / (self.layout.sensors * self.layout.size()).max(1)
    }

    /// How many clocks are states.
    pub fn clocks(&self) -> usize {
        match (&self.velocity, &self.truth) {
            (None, _) => 0,
            (Some(_), None) => self.layout.sensors.saturating_sub(1),
            (Some(_), Some(_)) => self.layout.sensors,
        }
    }

    /// The states that are the same after a whole turn: azimuths and headings.
    fn angles(&self) -> impl Iterator<Item = usize> + use<> {
        let (per, attitude) = (self.layout.per_sensor(), self.layout.attitude);
        (0..self.layout.sensors).flat_map(move |s| {
            let heading = attitude.then_some(s * per + per - 1);
            core::iter::once(s * per + 1).chain(heading)
        })
    }

    /// Width of a line: position, biases, clocks, residual.
    fn width(&self) -> usize {
        self.layout.size() + self.states() + 1
    }

    /// The state that is the clock of sensor `s`.
    fn clock(&self, s: usize) -> Option<usize> {
        let first = self.layout.sensors - self.clocks();
        (self.velocity.is_some() && s >= first).then(|| self.layout.states() + s - first)
    }

    /// The truth of look `k`.
    fn truth_of(&self, k: usize) -> Option<&[f64]> {
        let d = self.layout.size();
        let truth = &self.truth.as_ref()?.0[k * d..][..d];
        truth.iter().all(|x| x.is_finite()).then_some(truth)
    }

    /// How many lines look `k` has with its position eliminated; `None` where nothing
    /// places the target: there must be a whole report or a position.
    pub fn lines_of(&self, k: usize) -> Option<usize> {
        let d = self.layout.size();
        let reports = &self.reports[k * self.layout.sensors * d..][..self.layout.sensors * d];
        let truth = self.truth_of(k).map_or(0, <[f64]>::len);
        let placed = truth > 0
            || reports
                .chunks_exact(d)
                .any(|report| report.iter().all(|x| x.is_finite()));
        let given = reports.iter().filter(|x| x.is_finite()).count();
        placed.then(|| given + truth - d)
    }

    /// Calls `each` with every look, its position eliminated at its likeliest place.
    fn over(
        &self,
        x: &[f64],
        reports: &[f64],
        mut each: impl FnMut(Look<'_>),
    ) -> Result<(), Error> {
        let layout = self.layout;
        let (d, count, c) = (layout.size(), layout.sensors, self.width());
        let per = layout.per_sensor();
        if let Some(i) = self.angles().find(|&i| !(x[i].abs() <= TURN)) {
            return Err(NumberError::OutOfRange {
                name: "azimuth bias",
                given: x[i],
                allowed: "within 3.5 rad",
            }
            .into());
        }
        let mut lines = vec![0.0; (count + 1) * d * c];
        let mut work = vec![0.0; c];
        for k in 0..self.looks() {
            let Some(left) = self.lines_of(k) else {
                continue;
            };
            let size = (left + d) * c;
            let report = &reports[k * count * d..][..count * d];
            let velocity = self.velocity.as_deref().map(|v| &v[k * d..][..d]);
            let mut place = self.first_place(k, x, report);
            let sensors = layout.at_look(&self.sensors, k);
            for _ in 0..30 {
                let mut at = 0;
                for s in 0..count {
                    let own = s * d..(s + 1) * d;
                    let given = &report[own.clone()];
                    if given.iter().all(|x| x.is_nan()) {
                        continue;
                    }
                    let clock = self.clock(s);
                    let mut target = place;
                    if let (Some(clock), Some(velocity)) = (clock, velocity) {
                        for i in 0..d {
                            target[i] -= velocity[i] * x[clock];
                        }
                    }
                    let linear = unchecked_linearise(
                        &layout,
                        &sensors[own.clone()],
                        &self.sigma[own],
                        &x[s * per..][..per],
                        &target[..d],
                    )
                    .map_err(|error| error.on(s).at(k))?;
                    for (q, value) in given.iter().enumerate() {
                        if value.is_nan() {
                            continue;
                        }
                        let line = &mut lines[at..at + c];
                        let sigma = self.sigma[s * d + q];
                        write_line(&layout, s, q, &linear, Some(*value), sigma, line);
                        if let (Some(clock), Some(velocity)) = (clock, velocity) {
                            let along = linear.position[q].iter().zip(velocity);
                            line[d + clock] = -along.map(|(a, v)| a * v).sum::<f64>();
                        }
                        at += c;
                    }
                }
                if let (Some(truth), Some((_, sigma))) = (self.truth_of(k), &self.truth) {
                    for i in 0..d {
                        let line = &mut lines[at..at + c];
                        line.fill(0.0);
                        line[i] = 1.0 / sigma[i];
                        line[c - 1] = (truth[i] - place[i]) / sigma[i];
                        at += c;
                    }
                }
                let lines = &mut lines[..size];
                for j in 0..d {
                    reflect(lines, c, j, j, &mut work);
                }
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
            each(Look {
                index: k,
                lines: &lines[..size],
                place,
            });
        }
        Ok(())
    }

    /// Where to start with the position of look `k`: the truth, or the mean of the places
    /// that whole reports give.
    fn first_place(&self, k: usize, x: &[f64], report: &[f64]) -> [f64; 3] {
        let layout = self.layout;
        let (d, per) = (layout.size(), layout.per_sensor());
        let (mut place, mut one) = ([0.0; 3], [0.0; 3]);
        if let Some(truth) = self.truth_of(k) {
            place[..d].copy_from_slice(truth);
            return place;
        }
        let mut count = 0.0;
        for (s, report) in report.chunks_exact(d).enumerate() {
            if report.iter().any(|x| x.is_nan()) {
                continue;
            }
            let sensor = &layout.at_look(&self.sensors, k)[s * d..][..d];
            unchecked_place(&layout, sensor, &x[s * per..][..per], report, &mut one);
            for i in 0..d {
                place[i] += one[i];
            }
            count += 1.0;
        }
        place.map(|x| x / count)
    }

    /// The likeliest places (K, d); NaN where nothing places a target.
    ///
    /// # Errors
    /// Where a target would be on a sensor.
    pub fn positions(&self, x: &[f64]) -> Result<Vec<f64>, Error> {
        let d = self.layout.size();
        let mut out = vec![f64::NAN; self.looks() * d];
        self.over(x, &self.reports, |look| {
            out[look.index * d..][..d].copy_from_slice(&look.place[..d]);
        })?;
        Ok(out)
    }

    /// What else may be true, as whitened columns: a drift over the looks of each bias,
    /// and of each sensor a gain, if it is not among the biases. With `velocity` (K, d), the
    /// clock of each sensor, if it is not a state.
    ///
    /// # Errors
    /// Where a target would be on a sensor.
    pub fn alternatives(
        &self,
        x: &[f64],
        velocity: Option<&[f64]>,
    ) -> Result<Vec<Alternative>, Error> {
        let (m, n, states) = (self.measurements(), self.states(), self.layout.states());
        let mut rows = vec![0.0; m * n];
        self.linearize(x, &mut vec![0.0; m], Some(&mut rows))?;
        let middle = 0.5 * (self.looks().max(1) - 1) as f64;
        let time: Vec<f64> = (0..self.looks())
            .flat_map(|k| {
                let lines = self.lines_of(k).unwrap_or(0);
                core::iter::repeat_n(k as f64 - middle, lines)
            })
            .collect();
        let mut found: Vec<_> = (0..states)
            .map(|j| {
                let column = time.iter().enumerate().map(|(i, t)| t * rows[i * n + j]);
                ("drift", j, column.collect::<Vec<f64>>())
            })
            .collect();
        if !self.layout.gain {
            let layout = Layout {
                gain: true,
                ..self.layout
            };
            let record = Self {
                layout,
                ..self.clone()
            };
            let (per, more) = (self.layout.per_sensor(), layout.per_sensor());
            let d = layout.size();
            let mut wide = vec![0.0; record.states()];
            for s in 0..layout.sensors {
                wide[s * more..][..d].copy_from_slice(&x[s * per..][..d]);
                wide[s * more + d + 1..][..per - d].copy_from_slice(&x[s * per + d..][..per - d]);
            }
            wide[layout.states()..].copy_from_slice(&x[states..]);
            let at = |s| s * more + d;
            found.extend(record.columns(&wide, "gain", layout.sensors, at)?);
        }
        if let (None, Some(velocity)) = (&self.velocity, velocity) {
            let record = Self {
                velocity: Some(velocity.to_vec()),
                ..self.clone()
            };
            let mut wide = x.to_vec();
            wide.resize(record.states(), 0.0);
            let first = record.layout.sensors - record.clocks();
            let columns = record.columns(&wide, "clock", record.clocks(), |i| states + i)?;
            found.extend(columns.into_iter().map(|(kind, i, c)| (kind, i + first, c)));
        }
        Ok(found)
    }

    /// Columns of the rows by these states.
    fn columns(
        &self,
        x: &[f64],
        kind: &'static str,
        count: usize,
        at: impl Fn(usize) -> usize,
    ) -> Result<Vec<Alternative>, Error> {
        let (m, n) = (self.measurements(), self.states());
        let mut rows = vec![0.0; m * n];
        self.linearize(x, &mut vec![0.0; m], Some(&mut rows))?;
        let column = |i: usize| (0..m).map(|row| rows[row * n + at(i)]).collect();
        Ok((0..count).map(|i| (kind, i, column(i))).collect())
    }
}

impl Model for Measured {
    type Error = Error;

    fn states(&self) -> usize {
        self.layout.states() + self.clocks()
    }

    fn measurements(&self) -> usize {
        (0..self.looks()).filter_map(|k| self.lines_of(k)).sum()
    }

    fn channels(&self) -> usize {
        // Looks of different length are one sequence.
        let each = self.lines_of(0).unwrap_or(0);
        if each > 0 && (1..self.looks()).all(|k| self.lines_of(k) == Some(each)) {
            each
        } else {
            1
        }
    }

    fn linearize(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        mut rows: Option<&mut [f64]>,
    ) -> Result<(), Error> {
        let (d, n, c) = (self.layout.size(), x.len(), self.width());
        let mut at = 0;
        self.over(x, &self.reports, |look| {
            for line in look.lines[d * c..].chunks_exact(c) {
                residuals[at] = line[c - 1];
                if let Some(rows) = rows.as_deref_mut() {
                    rows[at * n..][..n].copy_from_slice(&line[d..d + n]);
                }
                at += 1;
            }
        })
    }

    fn change(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
            *out = b - a;
        }
        for i in self.angles() {
            out[i] = wrapped(out[i]);
        }
    }

    fn extent(&self, x: &[f64], k: usize) -> (f64, f64) {
        if self.angles().any(|angle| angle == k) {
            (x[k] - PI, x[k] + PI)
        } else {
            (f64::NEG_INFINITY, f64::INFINITY)
        }
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), Error> {
        // The exact reports of `a`, as `b` would explain them.
        let layout = self.layout;
        let (d, per) = (layout.size(), layout.per_sensor());
        let mut exact = self.reports.clone();
        let mut truth = self.truth.clone();
        for (k, place) in self.positions(a)?.chunks_exact(d).enumerate() {
            if let (Some((truth, _)), Some(_)) = (&mut truth, self.truth_of(k)) {
                truth[k * d..][..d].copy_from_slice(place);
            }
            let sensors = layout.at_look(&self.sensors, k);
            for s in 0..layout.sensors {
                let given = &mut exact[(k * layout.sensors + s) * d..][..d];
                if given.iter().all(|x| x.is_nan()) || place[0].is_nan() {
                    continue;
                }
                let mut target = place.to_vec();
                if let (Some(clock), Some(velocity)) = (self.clock(s), &self.velocity) {
                    for i in 0..d {
                        target[i] -= velocity[k * d + i] * a[clock];
                    }
                }
                let (sensor, sigma) = (&sensors[s * d..][..d], &self.sigma[s * d..][..d]);
                let bias = &a[s * per..][..per];
                let seen = unchecked_linearise(&layout, sensor, sigma, bias, &target)?;
                for (x, measured) in given.iter_mut().zip(seen.measured) {
                    if !x.is_nan() {
                        *x = measured;
                    }
                }
            }
        }
        let record = Self {
            reports: exact,
            truth,
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

    /// Looks with some reports missing, some positions known, and all clocks off.
    fn everything() -> Measured {
        let mut random = Stream::new(3, 0);
        let layout = Layout::simple(super::super::Dimension::Plane, 3);
        let sensors = vec![0.0, 0.0, 60e3, 5e3, 20e3, -40e3];
        let (mut reports, mut truth, mut velocity) = (vec![], vec![], vec![]);
        for k in 0..6 {
            let (x, y) = (30e3 * random.normal(), 60e3 + 5e3 * random.normal());
            for s in sensors.chunks(2) {
                let (dx, dy) = (x - s[0], y - s[1]);
                reports.push(f64::hypot(dx, dy) + 50.0 * random.normal());
                reports.push(f64::atan2(dx, dy) + 2e-3 * random.normal());
            }
            velocity.extend([200.0, 30.0 * f64::from(k)]);
            truth.extend([x + 20.0 * random.normal(), y]);
        }
        reports[1] = f64::NAN;
        reports[8..10].fill(f64::NAN);
        truth[4..8].fill(f64::NAN);
        Measured {
            layout,
            sensors,
            sigma: [50.0, 2e-3].repeat(3),
            reports,
            truth: Some((truth, vec![20.0, 30.0])),
            velocity: Some(velocity),
        }
    }

    #[test]
    fn the_gradient_of_chi2_is_that_of_rows_and_residuals() {
        let x = [100.0, 1e-3, -50.0, 2e-3, 0.0, -1e-3, 0.5, -0.3, 0.1];
        let step = |j: usize| match j {
            0 | 2 | 4 => 0.1,
            1 | 3 | 5 => 1e-6,
            _ => 1e-3,
        };
        let whole = everything();
        let plain = Measured {
            truth: None,
            velocity: None,
            ..everything()
        };
        let late = Measured {
            truth: None,
            ..everything()
        };
        for (record, states, lines) in [(whole, 9, 33 + 8 - 12), (late, 8, 33 - 12), (plain, 6, 21)]
        {
            let (m, n) = (record.measurements(), record.states());
            assert_eq!((m, n), (lines, states));
            let x = &x[..n];
            let chi2 = |x: &[f64]| -> f64 {
                let mut r = vec![0.0; m];
                record.linearize(x, &mut r, None).unwrap();
                r.iter().map(|r| r * r).sum()
            };
            let (mut r, mut rows) = (vec![0.0; m], vec![0.0; m * n]);
            record.linearize(x, &mut r, Some(&mut rows)).unwrap();
            for j in 0..n {
                let analytic: f64 = -2.0 * (0..m).map(|i| r[i] * rows[i * n + j]).sum::<f64>();
                let mut moved = x.to_vec();
                moved[j] += step(j);
                let plus = chi2(&moved);
                moved[j] -= 2.0 * step(j);
                let numeric = (plus - chi2(&moved)) / (2.0 * step(j));
                assert!((analytic - numeric).abs() < 1e-5 * (1.0 + numeric.abs()));
            }
            let mut difference = vec![1.0; m];
            record.difference(x, x, &mut difference).unwrap();
            assert!(difference.iter().all(|d| d.abs() < 1e-7));
            let alternatives = record.alternatives(x, None).unwrap();
            assert_eq!(alternatives.len(), 9);
            assert!(alternatives.iter().all(|(_, _, c)| c.len() == m));
        }
    }

    #[test]
    fn a_clock_is_an_alternative_until_it_is_a_state() {
        let late = Measured {
            truth: None,
            ..everything()
        };
        let plain = Measured {
            velocity: None,
            ..late.clone()
        };
        let x = [100.0, 1e-3, -50.0, 2e-3, 0.0, -1e-3, 0.0, 0.0];
        let found = plain
            .alternatives(&x[..6], late.velocity.as_deref())
            .unwrap();
        let (m, n) = (late.measurements(), late.states());
        let mut rows = vec![0.0; m * n];
        late.linearize(&x, &mut vec![0.0; m], Some(&mut rows))
            .unwrap();
        for (i, (kind, sensor, column)) in found[9..].iter().enumerate() {
            assert_eq!((*kind, *sensor), ("clock", i + 1));
            assert!((0..m).all(|row| (rows[row * n + 6 + i] - column[row]).abs() < 1e-9));
        }
    }
}
