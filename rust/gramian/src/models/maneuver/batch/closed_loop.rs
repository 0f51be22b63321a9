//! Estimate, choose a heading, move, measure, and again: an observer that does
//! not know its target, over many trials.

use alloc::vec::Vec;
use core::convert::Infallible;

use super::plan::by_law;
use crate::batch::{Items, Threads};
use crate::bearings::sight;
use crate::maneuver::steer::{Limits, aside, way_out, within_turn};
use crate::maneuver::{Law, Side};
use crate::scalar::{hypot, wrapped};

/// What is the same in all trials.
#[derive(Clone, Copy, Debug)]
pub struct Setting<'a> {
    /// Where the target is; the observer does not know it.
    pub target: [f64; 2],
    /// Where the observer starts.
    pub start: [f64; 2],
    /// Length of one step.
    pub length: f64,
    /// Number of steps.
    pub steps: usize,
    /// Standard deviation of a bearing.
    pub sigma: f64,
    /// What is known of the range from the start, and its standard deviation.
    pub range: (f64, f64),
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

/// Numbers written for each sample: position, estimate, and the root of the
/// trace of the covariance that the estimator believes.
pub const PER_SAMPLE: usize = 5;

/// Runs all trials. `noise` (trials, steps + 1) is standard normal; a bearing is
/// lost where `lost` (trials, steps + 1) is not zero, the first one never.
pub fn closed_loop(
    setting: &Setting<'_>,
    guide: Guidance<'_>,
    noise: Items<'_>,
    lost: Items<'_>,
    threads: Threads,
    out: &mut [f64],
) {
    let samples = setting.steps + 1;
    let cost = 50.0 * (samples * samples) as f64;
    let scratch = || Vec::with_capacity(samples);
    let each =
        |seen: &mut Vec<Sighting>, trial: usize, out: &mut [f64]| -> Result<(), Infallible> {
            seen.clear();
            let planned = match guide {
                Guidance::Headings(headings) => Some(headings.get(trial)),
                Guidance::Law(..) => None,
            };
            run(
                setting,
                guide,
                planned,
                noise.get(trial),
                lost.get(trial),
                seen,
                out.as_chunks_mut::<PER_SAMPLE>().0,
            );
            Ok(())
        };
    let Ok(()) = threads.over_with(out, samples * PER_SAMPLE, cost, scratch, each);
}

/// A bearing and where it was taken.
#[derive(Clone, Copy, Debug)]
struct Sighting {
    at: [f64; 2],
    bearing: f64,
}

fn run(
    setting: &Setting<'_>,
    guide: Guidance<'_>,
    planned: Option<&[f64]>,
    noise: &[f64],
    lost: &[f64],
    seen: &mut Vec<Sighting>,
    out: &mut [[f64; PER_SAMPLE]],
) {
    let mut at = setting.start;
    let mut estimate = at;
    let mut before = None;
    for (sample, out) in out.iter_mut().enumerate() {
        let measured = (sample == 0 || lost[sample] == 0.0)
            .then(|| wrapped(sight(at, setting.target) + setting.sigma * noise[sample]));
        if let Some(bearing) = measured {
            seen.push(Sighting { at, bearing });
            if sample == 0 {
                let (sin, cos) = bearing.sin_cos();
                let range = setting.range.0;
                estimate = [at[0] + range * sin, at[1] + range * cos];
            }
        }
        let deviation = locate(setting, seen, &mut estimate);
        *out = [at[0], at[1], estimate[0], estimate[1], deviation];
        if sample == setting.steps {
            break;
        }
        let sight = measured.unwrap_or_else(|| sight(at, estimate));
        let hold = (measured.is_none() && setting.lost == LostBearing::Hold)
            .then_some(before)
            .flatten();
        let wanted = match (guide, planned) {
            (Guidance::Law(..), _) if sample < setting.opening => sight,
            (Guidance::Law(..), _) if hold.is_some() => hold.unwrap_or(sight),
            (Guidance::Law(law, side), _) => {
                let range = hypot(estimate[0] - at[0], estimate[1] - at[1]);
                by_law(law, side, sight, range, setting.length)
            }
            (Guidance::Headings(_), planned) => planned
                .and_then(|p| p.get(sample))
                .copied()
                .unwrap_or(sight),
        };
        let thought = [[estimate[0], estimate[1], 0.0, 0.0]];
        let limits = Limits {
            standoff: setting.standoff,
            targets: &thought,
            keep_out: setting.keep_out,
            max_turn: setting.max_turn,
        };
        let heading =
            aside(at, 0.0, setting.length, wanted, before, &limits).unwrap_or_else(|| {
                let away = way_out(at, 0.0, &limits).unwrap_or(wanted);
                within_turn(away, before, setting.max_turn)
            });
        before = Some(heading);
        let (sin, cos) = heading.sin_cos();
        at = [at[0] + setting.length * sin, at[1] + setting.length * cos];
    }
}

/// Moves `estimate` to the most probable position given all bearings so far and
/// the range known beforehand; returns the root of the trace of its covariance.
///
/// # Algorithm
/// Gauss-Newton with the damping of Levenberg and Marquardt, from the estimate
/// before, so that two or three iterations do.
fn locate(setting: &Setting<'_>, seen: &[Sighting], estimate: &mut [f64; 2]) -> f64 {
    let mut now = linearize(setting, seen, *estimate);
    let mut damping = 1e-6;
    for _ in 0..20 {
        let ([a, b, c], [u, v]) = (now.information, now.gradient);
        let (a_damped, c_damped) = (a * (1.0 + damping), c * (1.0 + damping));
        let determinant = a_damped * c_damped - b * b;
        if !(determinant > 0.0) {
            break;
        }
        let step = [
            (c_damped * u - b * v) / determinant,
            (a_damped * v - b * u) / determinant,
        ];
        let there = [estimate[0] + step[0], estimate[1] + step[1]];
        let next = linearize(setting, seen, there);
        if next.cost <= now.cost {
            *estimate = there;
            now = next;
            damping = (damping * 0.1).max(1e-12);
            if hypot(step[0], step[1]) < 1e-7 * setting.range.0 {
                break;
            }
        } else {
            damping = (damping * 10.0).max(1e-4);
            if damping > 1e8 {
                break;
            }
        }
    }
    let [a, b, c] = now.information;
    let determinant = a * c - b * b;
    if determinant > 0.0 {
        ((a + c) / determinant).sqrt()
    } else {
        f64::INFINITY
    }
}

/// The sum of squares at a position, half its gradient (downhill) and its
/// curvature (xx, xy, yy).
struct Linear {
    cost: f64,
    gradient: [f64; 2],
    information: [f64; 3],
}

fn linearize(setting: &Setting<'_>, seen: &[Sighting], position: [f64; 2]) -> Linear {
    let [px, py] = position;
    let (x, y) = (px - setting.start[0], py - setting.start[1]);
    let range = hypot(x, y).max(f64::MIN_POSITIVE);
    let (mean, deviation) = setting.range;
    let (u, v) = (x / range / deviation, y / range / deviation);
    let residual = (mean - range) / deviation;
    let mut cost = residual * residual;
    let mut gradient = [u * residual, v * residual];
    let mut information = [u * u, u * v, v * v];
    let weight = 1.0 / setting.sigma;
    for sighting in seen {
        let (x, y) = (px - sighting.at[0], py - sighting.at[1]);
        let [u, v] = if x == 0.0 && y == 0.0 {
            [0.0; 2]
        } else {
            crate::bearings::gradient([x, y], setting.sigma)
        };
        let residual = wrapped(sighting.bearing - x.atan2(y)) * weight;
        cost += residual * residual;
        gradient[0] += u * residual;
        gradient[1] += v * residual;
        information[0] += u * u;
        information[1] += u * v;
        information[2] += v * v;
    }
    Linear {
        cost,
        gradient,
        information,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTING: Setting<'_> = Setting {
        target: [0.0, 1000.0],
        start: [0.0, 0.0],
        length: 20.0,
        steps: 40,
        sigma: 0.01,
        range: (1500.0, 1000.0),
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
            Items::shared(&zeros),
            Items::shared(&zeros),
            Threads::One,
            &mut out,
        );
        let end = &out[40 * PER_SAMPLE..];
        // What is left is the pull of the range that was thought beforehand.
        assert!(hypot(end[2], end[3] - 1000.0) < 1.0);
        assert!(end[4] > 1.0 && end[4] < 100.0);
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
            Items::shared(&[0.3; 41]),
            Items::shared(&lost),
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
}
