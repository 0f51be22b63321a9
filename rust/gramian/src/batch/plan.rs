//! Paths judged and made in numbers: the planner's objective over a set of
//! possible targets, first guesses that keep the limits, and the closed loop.

use alloc::vec::Vec;
use core::convert::Infallible;

use super::{Items, Threads};
use crate::maneuver::plan::{self, Criterion, Error, Legs, Target};
use crate::maneuver::steer::{Arc, Limits, follow};
use crate::maneuver::{Law, Side, heading};
use crate::scalar::hypot;
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
pub enum Wish<'a> {
    /// These headings (paths, steps), turned aside where a limit wants it.
    Headings(Items<'a>),
    /// Guesses (paths, 3): offset, side and step of turning back of an arc.
    Arcs(Items<'a>, [f64; 4]),
    /// A law with the true bearing and range of (x0, y0, vx, vy).
    Law(Law, Side, [f64; 4]),
}

/// Makes paths that keep the limits of a course: `out` has, for each path, its
/// headings and the number of steps that broke a limit since no heading kept it.
pub fn steered(course: &Course<'_>, wish: Wish<'_>, threads: Threads, out: &mut [f64]) {
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
            Wish::Headings(wanted) => {
                let wanted = wanted.get(path);
                let wanted = |place: &crate::maneuver::steer::Place<f64>| wanted[place.step];
                follow(start, dt, lengths, first, limits, wanted, headings)
            }
            Wish::Arcs(arcs, aim) => {
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
            Wish::Law(law, side, aim) => {
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
