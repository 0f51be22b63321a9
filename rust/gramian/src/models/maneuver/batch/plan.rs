//! Paths judged and made in numbers: the planner's objective over a set of
//! possible targets, how clear a path is of circles, and first guesses that keep the
//! limits.

use alloc::vec::Vec;
use core::convert::Infallible;

use crate::batch::{Items, Threads};
use crate::maneuver::plan::{self, Criterion, Error, Legs, Target};
use crate::maneuver::steer::{Arc, Limits, follow};
use crate::maneuver::{Law, Side, heading};
use crate::scalar::{NumberError, check_length, hypot};
use crate::square_root::SquareRootInformation;

/// The expectation of a criterion over possible targets, as a function of the
/// headings and step lengths of a path.
#[derive(Clone, Debug)]
pub struct Objective<const N: usize> {
    start: [f64; 2],
    dt: f64,
    counts: Vec<usize>,
    sigma: f64,
    scale: [f64; N],
    targets: Vec<Candidate<N>>,
}

/// One possible target of an [`Objective`].
#[derive(Clone, Copy, Debug)]
pub struct Candidate<const N: usize> {
    /// (x0, y0, vx, vy) at the start of the path.
    pub state: [f64; 4],
    /// Its probability, or any weight.
    pub weight: f64,
    /// What is to be made large or small; the same kind for all candidates.
    pub criterion: Criterion<f64, N>,
    /// The information there is before the path.
    pub prior: SquareRootInformation<f64, N>,
}

impl<const N: usize> Objective<N> {
    /// `counts` has the number of steps of each leg; `scale` what counts as one
    /// unit of each state.
    pub fn new(
        start: [f64; 2],
        dt: f64,
        counts: Vec<usize>,
        sigma: f64,
        scale: [f64; N],
        targets: Vec<Candidate<N>>,
    ) -> Self {
        Self {
            start,
            dt,
            counts,
            sigma,
            scale,
            targets,
        }
    }

    /// Number of legs.
    pub fn legs(&self) -> usize {
        self.counts.len()
    }

    /// Number of samples: one more than steps.
    pub fn samples(&self) -> usize {
        self.counts.iter().sum::<usize>() + 1
    }

    /// The value, and its derivatives by the headings and by the step lengths.
    ///
    /// # Errors
    /// A sample on a target; arrays that do not match.
    pub fn gradient(
        &self,
        headings: &[f64],
        lengths: &[f64],
        by_heading: &mut [f64],
        by_length: &mut [f64],
    ) -> Result<f64, Error> {
        by_heading.fill(0.0);
        by_length.fill(0.0);
        let legs = self.path(headings, lengths);
        let mut sum = 0.0;
        for candidate in &self.targets {
            let value = plan::gradient(
                &legs,
                &self.target(candidate),
                &candidate.criterion,
                candidate.weight,
                by_heading,
                by_length,
            )?;
            sum += candidate.weight * value;
        }
        Ok(sum)
    }

    /// Values (paths) of many paths; `headings` (paths, legs) and `lengths`
    /// (paths, legs). A path over a target has the worst value there is.
    pub fn values(
        &self,
        headings: Items<'_>,
        lengths: Items<'_>,
        threads: Threads,
        out: &mut [f64],
    ) {
        let cost = 100.0 * (self.samples() * self.targets.len()) as f64;
        let each = |path: usize, out: &mut [f64]| -> Result<(), Infallible> {
            let legs = self.path(headings.get(path), lengths.get(path));
            out[0] = 0.0;
            for candidate in &self.targets {
                let value = plan::value(&legs, &self.target(candidate), &candidate.criterion)
                    .unwrap_or(match candidate.criterion {
                        Criterion::LogDet => f64::NEG_INFINITY,
                        Criterion::SmallestEigenvalue { .. } => 0.0,
                        _ => f64::INFINITY,
                    });
                out[0] += candidate.weight * value;
            }
            Ok(())
        };
        let Ok(()) = threads.over(out, 1, cost, each);
    }

    /// The value after each sample of one path.
    ///
    /// # Errors
    /// As [`gradient`](Self::gradient).
    pub fn along(&self, headings: &[f64], lengths: &[f64], out: &mut [f64]) -> Result<(), Error> {
        let legs = self.path(headings, lengths);
        let mut one = alloc::vec![0.0; out.len()];
        out.fill(0.0);
        for candidate in &self.targets {
            plan::along(
                &legs,
                &self.target(candidate),
                &candidate.criterion,
                &mut one,
            )?;
            for (sum, value) in out.iter_mut().zip(&one) {
                *sum += candidate.weight * value;
            }
        }
        Ok(())
    }

    fn path<'a>(&'a self, headings: &'a [f64], lengths: &'a [f64]) -> Legs<'a, f64> {
        Legs {
            start: self.start,
            dt: self.dt,
            headings,
            lengths,
            counts: &self.counts,
        }
    }

    fn target<'a>(&self, candidate: &'a Candidate<N>) -> Target<'a, f64, N> {
        Target {
            state: candidate.state,
            sigma: self.sigma,
            prior: &candidate.prior,
            scale: self.scale,
        }
    }
}

/// How clear the steps of a path are of circles, with derivatives.
///
/// A clearance is (distance / radius)^2 - 1, at least zero outside: of the end of a
/// step, where a bearing is taken, or of the point of the step that is nearest.
#[derive(Clone, Debug)]
pub struct Clearance {
    start: [f64; 2],
    /// Of each step.
    legs: Vec<usize>,
    circles: Vec<Near>,
}

/// A circle that a step can come near.
#[derive(Clone, Copy, Debug)]
pub struct Near {
    /// Which step, from 0.
    pub step: usize,
    /// Its centre when the step ends.
    pub center: [f64; 2],
    /// Its radius.
    pub radius: f64,
    /// Whether the whole step is to stay clear, or its end alone.
    pub whole: bool,
}

/// Where a circle is nearest to its step.
struct Nearest {
    /// From the centre.
    away: [f64; 2],
    /// Which share of the step leads there.
    share: f64,
}

impl Clearance {
    /// `counts` has the number of steps of each leg; steps of circles are less than
    /// their sum.
    pub fn new(start: [f64; 2], counts: Vec<usize>, mut circles: Vec<Near>) -> Self {
        let mut legs = Vec::new();
        for (leg, count) in counts.into_iter().enumerate() {
            legs.extend(core::iter::repeat_n(leg, count));
        }
        circles.retain(|circle| circle.step < legs.len());
        Self {
            start,
            legs,
            circles,
        }
    }

    /// Number of circles.
    pub fn len(&self) -> usize {
        self.circles.len()
    }

    /// Whether there is nothing to keep clear of.
    pub fn is_empty(&self) -> bool {
        self.circles.is_empty()
    }

    /// Number of legs.
    pub fn legs(&self) -> usize {
        self.legs.last().map_or(0, |leg| leg + 1)
    }

    /// The clearance (circles) of a path with these headings and step lengths (legs).
    ///
    /// # Errors
    /// [`NumberError::Length`].
    pub fn values(
        &self,
        headings: &[f64],
        lengths: &[f64],
        out: &mut [f64],
    ) -> Result<(), NumberError> {
        self.check(headings, lengths)?;
        check_length("out", out.len(), self.len())?;
        let walk = self.walk(headings, lengths);
        for (circle, out) in self.circles.iter().zip(out) {
            let [x, y] = nearest(circle, &walk).away;
            *out = (x * x + y * y) / (circle.radius * circle.radius) - 1.0;
        }
        Ok(())
    }

    fn check(&self, headings: &[f64], lengths: &[f64]) -> Result<(), NumberError> {
        check_length("headings", headings.len(), self.legs())?;
        check_length("lengths", lengths.len(), self.legs())
    }

    /// Derivatives (circles, legs) of the values by the headings and by the lengths.
    ///
    /// # Errors
    /// [`NumberError::Length`].
    pub fn gradient(
        &self,
        headings: &[f64],
        lengths: &[f64],
        by_heading: &mut [f64],
        by_length: &mut [f64],
    ) -> Result<(), NumberError> {
        self.check(headings, lengths)?;
        let legs = self.legs();
        check_length("by_heading", by_heading.len(), self.len() * legs)?;
        check_length("by_length", by_length.len(), self.len() * legs)?;
        let walk = self.walk(headings, lengths);
        let directions: Vec<[f64; 2]> = headings
            .iter()
            .map(|heading| [heading.sin(), heading.cos()])
            .collect();
        by_heading.fill(0.0);
        by_length.fill(0.0);
        let legs = legs.max(1);
        let rows = by_heading
            .chunks_exact_mut(legs)
            .zip(by_length.chunks_exact_mut(legs));
        for (circle, (by_heading, by_length)) in self.circles.iter().zip(rows) {
            let Nearest { away, share } = nearest(circle, &walk);
            let factor = 2.0 / (circle.radius * circle.radius);
            let [x, y] = away.map(|part| part * factor);
            // A step moves its own point by its share and all later ones whole.
            for (step, &leg) in self.legs[..=circle.step].iter().enumerate() {
                let weight = if step == circle.step { share } else { 1.0 };
                let [sin, cos] = directions[leg];
                by_heading[leg] += weight * lengths[leg] * (x * cos - y * sin);
                by_length[leg] += weight * (x * sin + y * cos);
            }
        }
        Ok(())
    }

    /// The positions at the start and after each step.
    fn walk(&self, headings: &[f64], lengths: &[f64]) -> Vec<[f64; 2]> {
        let mut at = self.start;
        let mut walk = Vec::with_capacity(self.legs.len() + 1);
        walk.push(at);
        let mut last = None;
        let mut step = [0.0; 2];
        for &leg in &self.legs {
            if last != Some(leg) {
                let (sin, cos) = headings[leg].sin_cos();
                step = [lengths[leg] * sin, lengths[leg] * cos];
                last = Some(leg);
            }
            at = [at[0] + step[0], at[1] + step[1]];
            walk.push(at);
        }
        walk
    }
}

fn nearest(circle: &Near, walk: &[[f64; 2]]) -> Nearest {
    let [x, y] = circle.center;
    let end = walk[circle.step + 1];
    if !circle.whole {
        return Nearest {
            away: [end[0] - x, end[1] - y],
            share: 1.0,
        };
    }
    let begin = walk[circle.step];
    let step = [end[0] - begin[0], end[1] - begin[1]];
    let from = [begin[0] - x, begin[1] - y];
    let along = -(from[0] * step[0] + from[1] * step[1]);
    let square = (step[0] * step[0] + step[1] * step[1]).max(1e-300);
    let share = (along / square).clamp(0.0, 1.0);
    Nearest {
        away: [from[0] + share * step[0], from[1] + share * step[1]],
        share,
    }
}

/// What a path that is made step by step starts from and keeps to.
#[derive(Clone, Copy, Debug)]
pub struct Course<'a> {
    /// Where it starts.
    pub start: [f64; 2],
    /// Time of one step.
    pub dt: f64,
    /// Length of each step.
    pub lengths: &'a [f64],
    /// The heading before the start, if a turn from it counts.
    pub first: Option<f64>,
    /// The limits.
    pub limits: Limits<'a, f64>,
}

/// What a path that is made step by step wants.
#[derive(Clone, Copy, Debug)]
pub enum HeadingSource<'a> {
    /// These headings (paths, steps), turned aside where a limit wants it.
    Headings(Items<'a>),
    /// Guesses (paths, 3): offset, side and step of turning back of an arc.
    Arcs(Items<'a>, [f64; 4]),
    /// A law with the true bearing and range of (x0, y0, vx, vy).
    Law(Law, Side, [f64; 4]),
}

/// Makes paths that keep the limits of a course: `out` has, for each path, its
/// headings and the number of steps that broke a limit since no heading kept it.
pub fn steered(course: &Course<'_>, wish: HeadingSource<'_>, threads: Threads, out: &mut [f64]) {
    let steps = course.lengths.len();
    let circles = course.limits.targets.len() + course.limits.keep_out.len();
    let cost = (steps * (100 + 100 * circles)) as f64;
    let each = |path: usize, out: &mut [f64]| -> Result<(), Infallible> {
        let (headings, broken) = out.split_at_mut(steps);
        let Course {
            start,
            dt,
            lengths,
            first,
            ref limits,
        } = *course;
        broken[0] = match wish {
            HeadingSource::Headings(wanted) => {
                let wanted = wanted.get(path);
                let wanted = |place: &crate::maneuver::steer::Place<f64>| wanted[place.step];
                follow(start, dt, lengths, first, limits, wanted, headings)
            }
            HeadingSource::Arcs(arcs, aim) => {
                let arc = arcs.get(path);
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
                let turn_back = arc[2].max(0.0) as usize;
                let wanted = Arc {
                    offset: arc[0],
                    side: arc[1],
                    turn_back,
                }
                .wanted(aim);
                follow(start, dt, lengths, first, limits, wanted, headings)
            }
            HeadingSource::Law(law, side, aim) => {
                let wanted = |place: &crate::maneuver::steer::Place<f64>| {
                    let point = crate::bearings::moved(&aim, place.time);
                    let range = hypot(point[0] - place.at[0], point[1] - place.at[1]);
                    let bearing = crate::bearings::sight(place.at, point);
                    by_law(law, side, bearing, range, lengths[place.step])
                };
                follow(start, dt, lengths, first, limits, wanted, headings)
            }
        } as f64;
        Ok(())
    };
    let Ok(()) = threads.over(out, steps + 1, cost, each);
}

/// A law's heading; perpendicular where the law has none.
pub(super) fn by_law(law: Law, side: Side, bearing: f64, range: f64, length: f64) -> f64 {
    heading(bearing, range, length, law, side)
        .unwrap_or(bearing + side.sign::<f64>() * core::f64::consts::FRAC_PI_2)
}

/// A square root of the information in `rows` (of length N, row-major).
pub fn prior<const N: usize>(rows: &[f64]) -> SquareRootInformation<f64, N> {
    let mut root = SquareRootInformation::new();
    for row in rows.as_chunks::<N>().0 {
        root.absorb(row);
    }
    root
}

#[cfg(test)]
mod tests {
    use alloc::vec;

    use super::*;

    #[test]
    fn clearances_change_as_their_gradient_says() {
        let counts = vec![2, 1, 3];
        let near = |step, center, whole| Near {
            step,
            center,
            radius: 3.0,
            whole,
        };
        let clearance = Clearance::new(
            [0.5, -0.25],
            counts,
            vec![
                near(5, [3.0, 9.0], false),
                near(0, [0.0, 4.0], false),
                // Nearest within the step, at its end and at its beginning.
                near(2, [6.5, 2.5], true),
                near(3, [9.0, 30.0], true),
                near(4, [-3.0, -9.0], true),
            ],
        );
        let (headings, lengths) = ([0.3, 1.2, -0.4], [2.0, 3.0, 1.5]);
        let at = |headings: &[f64; 3], lengths: &[f64; 3]| {
            let mut out = [0.0; 5];
            assert_eq!(clearance.values(headings, lengths, &mut out), Ok(()));
            out
        };
        let (mut by_heading, mut by_length) = ([0.0; 15], [0.0; 15]);
        let done = clearance.gradient(&headings, &lengths, &mut by_heading, &mut by_length);
        assert_eq!(done, Ok(()));
        let short = clearance.values(&headings[..2], &lengths, &mut []);
        assert!(matches!(
            short,
            Err(NumberError::Length {
                given: 2,
                wanted: 3,
                ..
            })
        ));
        for leg in 0..3 {
            let h = 1e-6;
            let shifted = |values: [f64; 3], by: f64| {
                let mut values = values;
                values[leg] += by;
                values
            };
            let turned = [h, -h].map(|h| at(&shifted(headings, h), &lengths));
            let stretched = [h, -h].map(|h| at(&headings, &shifted(lengths, h)));
            for circle in 0..5 {
                let by = |pair: [[f64; 5]; 2]| (pair[0][circle] - pair[1][circle]) / (2.0 * h);
                let (a, b) = (by(turned), by_heading[3 * circle + leg]);
                assert!((a - b).abs() < 1e-8, "heading {leg} {circle}: {a} {b}");
                let (a, b) = (by(stretched), by_length[3 * circle + leg]);
                assert!((a - b).abs() < 1e-8, "length {leg} {circle}: {a} {b}");
            }
        }
        // Steps of legs after a circle do not move it.
        assert_eq!(by_heading[3 + 1..6], [0.0; 2]);
        // The first step goes from (0.5, -0.25) by 2 m at 0.3 rad.
        let end = [0.5 + 2.0 * 0.3_f64.sin(), -0.25 + 2.0 * 0.3_f64.cos()];
        let wanted = (end[0].powi(2) + (end[1] - 4.0).powi(2)) / 9.0 - 1.0;
        assert!((at(&headings, &lengths)[1] - wanted).abs() < 1e-15);
    }
}
