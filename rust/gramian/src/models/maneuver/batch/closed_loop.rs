//! Estimate, choose a heading, move, measure, and again: an observer that does
//! not know its target, over many trials.

use alloc::vec::Vec;
use core::convert::Infallible;

use super::plan::by_law;
use crate::batch::{Items, Threads};
use crate::bearings::{moved, sight};
use crate::maneuver::steer::{Limits, aside, way_out, within_turn};
use crate::maneuver::{Law, Side};
use crate::scalar::{hypot, wrapped};
use crate::solve::{Loss, Model, Options, minimize};
use crate::square_root::SquareRootInformation;

/// What is the same in all trials.
#[derive(Clone, Copy, Debug)]
pub struct Setting<'a> {
    /// Where the observer starts.
    pub start: [f64; 2],
    /// Time of one step.
    pub dt: f64,
    /// Length of one step.
    pub length: f64,
    /// Number of steps.
    pub steps: usize,
    /// Standard deviation of a bearing.
    pub sigma: f64,
    /// What is known of the range from the start, and its standard deviation.
    pub range: (f64, f64),
    /// Standard deviation of each component of the velocity, about zero, beforehand;
    /// `None` where the target is known to rest.
    pub speed: Option<f64>,
    /// Of the bearings of a sample, the one nearest to what is expected is taken if it is
    /// within so many standard deviations; infinite where there is no false one.
    pub gate: f64,
    /// Steps along the measured line of sight before the law begins.
    pub opening: usize,
    /// What to do when a bearing is lost.
    pub lost: LostBearing,
    /// No bearing closer than this to where the target is thought to be.
    pub standoff: f64,
    /// Discs (east, north, radius) that the path stays out of.
    pub keep_out: &'a [[f64; 3]],
    /// The largest turn between two steps; infinite for none.
    pub max_turn: f64,
}

/// What to do when a bearing is lost (Xu et al. 2009, section 4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LostBearing {
    /// Steer by the bearing that the estimate predicts.
    Predict,
    /// Hold the heading.
    Hold,
}

/// How headings are chosen.
#[derive(Clone, Copy, Debug)]
pub enum Guidance<'a> {
    /// By a law, from the bearing and the estimated range.
    Law(Law, Side),
    /// As planned (trials, steps), turned aside for a limit.
    Headings(Items<'a>),
}

/// What is true in each trial and what happens to its bearings, (trials, steps + 1) each.
#[derive(Clone, Copy, Debug)]
pub struct Happens<'a> {
    /// Where the target is at the start, and its velocity (x0, y0, vx, vy), of each trial;
    /// the observer knows neither.
    pub targets: Items<'a>,
    /// Standard normal noise.
    pub noise: Items<'a>,
    /// The bearing is lost where this is not zero, the first one never.
    pub lost: Items<'a>,
    /// A false bearing, rad, within a whole turn of zero; any larger number for none.
    pub alarms: Items<'a>,
}

/// Numbers written for each sample: position of the observer; estimate (x0, y0, vx, vy);
/// the root of the trace of the covariance that the estimator believes of the target's
/// present position; and twice the log of the ratio of the likelihood at the estimate to
/// that of the truth, what is known beforehand included.
pub const PER_SAMPLE: usize = 8;

/// Runs all trials.
pub fn closed_loop(
    setting: &Setting<'_>,
    guide: Guidance<'_>,
    happens: Happens<'_>,
    threads: Threads,
    out: &mut [f64],
) {
    if setting.speed.is_some() {
        all::<4>(setting, guide, happens, threads, out);
    } else {
        all::<2>(setting, guide, happens, threads, out);
    }
}

/// All trials with `N` unknown states of the target.
fn all<const N: usize>(
    setting: &Setting<'_>,
    guide: Guidance<'_>,
    happens: Happens<'_>,
    threads: Threads,
    out: &mut [f64],
) {
    let samples = setting.steps + 1;
    let cost = 25.0 * (N * samples * samples) as f64;
    let scratch = || Vec::with_capacity(samples);
    let each =
        |seen: &mut Vec<Sighting>, trial: usize, out: &mut [f64]| -> Result<(), Infallible> {
            seen.clear();
            let mut flight = Flight::<N> {
                setting,
                guide,
                planned: match guide {
                    Guidance::Headings(headings) => Some(headings.get(trial)),
                    Guidance::Law(..) => None,
                },
                target: core::array::from_fn(|i| happens.targets.get(trial)[i]),
                noise: happens.noise.get(trial),
                lost: happens.lost.get(trial),
                alarms: happens.alarms.get(trial),
                seen,
            };
            flight.fly(out.as_chunks_mut::<PER_SAMPLE>().0);
            Ok(())
        };
    let Ok(()) = threads.over_with(out, samples * PER_SAMPLE, cost, scratch, each);
}

/// A bearing, where and when it was taken.
#[derive(Clone, Copy, Debug)]
struct Sighting {
    at: [f64; 2],
    time: f64,
    bearing: f64,
}

/// One trial.
struct Flight<'a, const N: usize> {
    setting: &'a Setting<'a>,
    guide: Guidance<'a>,
    planned: Option<&'a [f64]>,
    target: [f64; 4],
    noise: &'a [f64],
    lost: &'a [f64],
    alarms: &'a [f64],
    seen: &'a mut Vec<Sighting>,
}

impl<const N: usize> Flight<'_, N> {
    fn fly(&mut self, out: &mut [[f64; PER_SAMPLE]]) {
        let setting = self.setting;
        let truth: [f64; N] = core::array::from_fn(|i| self.target[i]);
        let mut at = setting.start;
        let mut estimate = [0.0; N];
        let mut covariance = None;
        let mut before = None;
        for (sample, out) in out.iter_mut().enumerate() {
            let time = setting.dt * sample as f64;
            let measured = self.measure(sample, at, time, &estimate, covariance.as_ref());
            if let Some(bearing) = measured {
                self.seen.push(Sighting { at, time, bearing });
                if sample == 0 {
                    let (sin, cos) = bearing.sin_cos();
                    let range = setting.range.0;
                    estimate[0] = at[0] + range * sin;
                    estimate[1] = at[1] + range * cos;
                }
            }
            let chi2 = self.locate(&mut estimate);
            covariance = self.known().covariance(&estimate);
            let state: [f64; 4] = core::array::from_fn(|i| estimate.get(i).copied().unwrap_or(0.0));
            let surprise = (self.known().chi2(&truth) - chi2).max(0.0);
            let deviation = covariance
                .as_ref()
                .map_or(f64::INFINITY, |bound| spread(bound, time));
            let [x, y, u, v] = state;
            *out = [at[0], at[1], x, y, u, v, deviation, surprise];
            if sample == setting.steps {
                break;
            }
            let heading = self.heading(sample, at, time, measured, &state, before);
            before = Some(heading);
            let (sin, cos) = heading.sin_cos();
            at = [at[0] + setting.length * sin, at[1] + setting.length * cos];
        }
    }

    /// The bearing that is taken for the target's, if any is.
    fn measure(
        &self,
        sample: usize,
        at: [f64; 2],
        time: f64,
        estimate: &[f64; N],
        covariance: Option<&[[f64; N]; N]>,
    ) -> Option<f64> {
        let setting = self.setting;
        let whole = sight(at, moved(&self.target, time));
        let seen = (sample == 0 || self.lost[sample] == 0.0)
            .then(|| wrapped(whole + setting.sigma * self.noise[sample]));
        if sample == 0 || !setting.gate.is_finite() {
            return seen;
        }
        let alarm =
            Some(self.alarms[sample]).filter(|bearing| bearing.abs() <= core::f64::consts::TAU);
        let offset = offset_at(estimate, time, at);
        let row = row::<N>(offset, time, setting.sigma);
        // Of the innovation, in standard deviations of a bearing.
        let mut variance = 1.0;
        for i in 0..N {
            for j in 0..N {
                variance += row[i] * covariance?[i][j] * row[j];
            }
        }
        let expected = offset[0].atan2(offset[1]);
        let off = |bearing: f64| wrapped(bearing - expected).abs() / setting.sigma;
        seen.into_iter()
            .chain(alarm)
            .filter(|&bearing| off(bearing) <= setting.gate * variance.sqrt())
            .min_by(|&a, &b| off(a).total_cmp(&off(b)))
    }

    fn heading(
        &self,
        sample: usize,
        at: [f64; 2],
        time: f64,
        measured: Option<f64>,
        state: &[f64; 4],
        before: Option<f64>,
    ) -> f64 {
        let setting = self.setting;
        let there = moved(state, time);
        let sight = measured.unwrap_or_else(|| sight(at, there));
        let hold = (measured.is_none() && setting.lost == LostBearing::Hold)
            .then_some(before)
            .flatten();
        let wanted = match (self.guide, self.planned) {
            (Guidance::Law(..), _) if sample < setting.opening => sight,
            (Guidance::Law(..), _) if hold.is_some() => hold.unwrap_or(sight),
            (Guidance::Law(law, side), _) => {
                let range = hypot(there[0] - at[0], there[1] - at[1]);
                by_law(law, side, sight, range, setting.length)
            }
            (Guidance::Headings(_), planned) => planned
                .and_then(|p| p.get(sample))
                .copied()
                .unwrap_or(sight),
        };
        let limits = Limits {
            standoff: setting.standoff,
            targets: core::slice::from_ref(state),
            keep_out: setting.keep_out,
            max_turn: setting.max_turn,
        };
        let ends = time + setting.dt;
        aside(at, ends, setting.length, wanted, before, &limits).unwrap_or_else(|| {
            let away = way_out(at, ends, &limits).unwrap_or(wanted);
            within_turn(away, before, setting.max_turn)
        })
    }

    fn known(&self) -> Known<'_, N> {
        Known {
            setting: self.setting,
            seen: self.seen,
        }
    }

    /// Moves `estimate` to the most probable state given all bearings so far and what was
    /// known beforehand; returns chi2 there. From the estimate before two or three steps do.
    fn locate(&self, estimate: &mut [f64; N]) -> f64 {
        let found = minimize(&self.known(), estimate, &[], OPTIONS);
        if found.chi2.is_finite() {
            estimate.copy_from_slice(&found.x);
        }
        found.chi2
    }
}

/// Of the estimator: a step of a thousandth of a standard deviation is none.
const OPTIONS: Options = Options {
    max_iterations: 40,
    tolerance: 1e-3,
    loss: Loss::Squares,
    patience: 0,
    damping: 0.0,
    curved: false,
};

/// All bearings of a flight so far, and what was known beforehand.
struct Known<'a, const N: usize> {
    setting: &'a Setting<'a>,
    seen: &'a [Sighting],
}

impl<const N: usize> Known<'_, N> {
    /// Calls `each` with every whitened row and residual, those of the prior last.
    fn lines(&self, state: &[f64], mut each: impl FnMut([f64; N], f64)) {
        let setting = self.setting;
        for sighting in self.seen {
            let offset = offset_at(state, sighting.time, sighting.at);
            let expected = offset[0].atan2(offset[1]);
            let residual = wrapped(sighting.bearing - expected) / setting.sigma;
            each(row(offset, sighting.time, setting.sigma), residual);
        }
        let (x, y) = (state[0] - setting.start[0], state[1] - setting.start[1]);
        let range = hypot(x, y).max(f64::MIN_POSITIVE);
        let (mean, deviation) = setting.range;
        let mut line = [0.0; N];
        line[0] = x / range / deviation;
        line[1] = y / range / deviation;
        each(line, (mean - range) / deviation);
        if let Some(speed) = setting.speed {
            for i in 2..N {
                let mut line = [0.0; N];
                line[i] = 1.0 / speed;
                each(line, -state[i] / speed);
            }
        }
    }

    fn chi2(&self, state: &[f64; N]) -> f64 {
        let mut sum = 0.0;
        self.lines(state, |_, residual| sum += residual * residual);
        sum
    }

    /// The bound at a state; `None` while the state is not determined.
    fn covariance(&self, state: &[f64; N]) -> Option<[[f64; N]; N]> {
        let mut rows = Vec::with_capacity(self.measurements());
        self.lines(state, |row, _| rows.push(row));
        let mut root = SquareRootInformation::<f64, N>::new();
        for block in rows.chunks_mut(16) {
            root.absorb_all(block);
        }
        root.crlb()
    }
}

impl<const N: usize> Model for Known<'_, N> {
    type Error = Infallible;

    fn states(&self) -> usize {
        N
    }

    fn measurements(&self) -> usize {
        self.seen.len() + self.priors()
    }

    fn priors(&self) -> usize {
        if self.setting.speed.is_some() { 3 } else { 1 }
    }

    fn linearize(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        rows: Option<&mut [f64]>,
    ) -> Result<(), Infallible> {
        let mut out = residuals.iter_mut();
        let mut lines = rows.map(|rows| rows.chunks_exact_mut(N));
        self.lines(x, |row, residual| {
            if let Some(out) = out.next() {
                *out = residual;
            }
            if let Some(line) = lines.as_mut().and_then(Iterator::next) {
                line.copy_from_slice(&row);
            }
        });
        Ok(())
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), Infallible> {
        let mut there = alloc::vec![0.0; out.len()];
        self.linearize(a, out, None)?;
        self.linearize(b, &mut there, None)?;
        for (i, (out, there)) in out.iter_mut().zip(there).enumerate() {
            let change = *out - there;
            *out = if i < self.seen.len() {
                wrapped(change * self.setting.sigma) / self.setting.sigma
            } else {
                change
            };
        }
        Ok(())
    }
}

/// From an observer to the target of this state at a time.
fn offset_at(state: &[f64], time: f64, at: [f64; 2]) -> [f64; 2] {
    let along = |i: usize| state.get(i).map_or(0.0, |speed| time * speed);
    [state[0] + along(2) - at[0], state[1] + along(3) - at[1]]
}

/// The whitened row of a bearing.
fn row<const N: usize>(offset: [f64; 2], time: f64, sigma: f64) -> [f64; N] {
    let [a, b] = if offset == [0.0; 2] {
        [0.0; 2]
    } else {
        crate::bearings::gradient(offset, sigma)
    };
    let whole = [a, b, time * a, time * b];
    core::array::from_fn(|i| whole.get(i).copied().unwrap_or(0.0))
}

/// The root of the trace of the covariance of the position at a time.
fn spread<const N: usize>(covariance: &[[f64; N]; N], time: f64) -> f64 {
    let mut sum = 0.0;
    for axis in 0..2 {
        sum += covariance[axis][axis];
        if N == 4 {
            sum +=
                time * (2.0 * covariance[axis][axis + 2] + time * covariance[axis + 2][axis + 2]);
        }
    }
    sum.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TARGET: [f64; 4] = [0.0, 1000.0, 0.0, 0.0];
    const SETTING: Setting<'_> = Setting {
        start: [0.0, 0.0],
        dt: 1.0,
        length: 20.0,
        steps: 40,
        sigma: 0.01,
        range: (1500.0, 1000.0),
        speed: None,
        gate: f64::INFINITY,
        opening: 0,
        lost: LostBearing::Hold,
        standoff: 0.0,
        keep_out: &[],
        max_turn: f64::INFINITY,
    };

    #[test]
    fn without_noise_the_estimate_comes_to_the_target() {
        let mut out = [0.0; 41 * PER_SAMPLE];
        let zeros = [0.0; 41];
        closed_loop(
            &SETTING,
            Guidance::Law(Law::Circle, Side::Right),
            Happens {
                targets: Items::shared(&TARGET),
                noise: Items::shared(&zeros),
                lost: Items::shared(&zeros),
                alarms: Items::shared(&[f64::MAX; 41]),
            },
            Threads::One,
            &mut out,
        );
        let end = &out[40 * PER_SAMPLE..];
        // What is left is the pull of the range that was thought beforehand.
        assert!(hypot(end[2], end[3] - 1000.0) < 1.0);
        assert!(end[6] > 1.0 && end[6] < 100.0);
        // Once the range is known the path is the circle about the target.
        assert!((hypot(end[0], end[1] - 1000.0) - 1000.0).abs() < 30.0);
    }

    #[test]
    fn a_lost_bearing_holds_the_heading() {
        let mut out = [0.0; 41 * PER_SAMPLE];
        let mut lost = [0.0; 41];
        lost[10..20].fill(1.0);
        closed_loop(
            &SETTING,
            Guidance::Law(Law::MaxDet, Side::Left),
            Happens {
                targets: Items::shared(&TARGET),
                noise: Items::shared(&[0.3; 41]),
                lost: Items::shared(&lost),
                alarms: Items::shared(&[f64::MAX; 41]),
            },
            Threads::One,
            &mut out,
        );
        let (samples, _) = out.as_chunks::<PER_SAMPLE>();
        let move_at = |i: usize| {
            let (a, b) = (samples[i], samples[i + 1]);
            (b[0] - a[0]).atan2(b[1] - a[1])
        };
        for i in 10..20 {
            assert!((move_at(i) - move_at(9)).abs() < 1e-9);
        }
        assert!((move_at(20) - move_at(9)).abs() > 1e-3);
    }

    #[test]
    fn a_moving_target_is_found_among_false_alarms() {
        let target = [0.0, 400.0, -5.0, 5.0];
        let setting = Setting {
            steps: 60,
            sigma: 0.005,
            range: (500.0, 200.0),
            speed: Some(10.0),
            gate: 4.0,
            standoff: 100.0,
            ..SETTING
        };
        let mut out = [0.0; 61 * PER_SAMPLE];
        let zeros = [0.0; 61];
        // Every other bearing is lost and a false one is there instead.
        let lost: [f64; 61] = core::array::from_fn(|k| (k % 2) as f64);
        let alarms: [f64; 61] = core::array::from_fn(|k| {
            if k % 2 == 1 {
                2.0 + 0.01 * k as f64
            } else {
                f64::MAX
            }
        });
        closed_loop(
            &setting,
            Guidance::Law(Law::MaxDet, Side::Right),
            Happens {
                targets: Items::shared(&target),
                noise: Items::shared(&zeros),
                lost: Items::shared(&lost),
                alarms: Items::shared(&alarms),
            },
            Threads::One,
            &mut out,
        );
        let end = &out[60 * PER_SAMPLE..];
        for (found, truth) in end[2..6].iter().zip(target) {
            assert!((found - truth).abs() < 0.1 * end[6], "{found} {truth}");
        }
        assert!(end[7] < 0.1);
    }
}
