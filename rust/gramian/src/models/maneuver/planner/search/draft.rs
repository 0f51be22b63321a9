//! Paths as they are wished: headings and steps of legs, turned aside from what they must
//! not enter.

use alloc::vec;
use alloc::vec::Vec;

use super::super::Problem;
use super::super::paths::Layout;
use crate::batch::Stream;
use crate::maneuver::steer::{Limits, Place, follow};
use crate::scalar::wrapped;

/// A whole number below `most`.
pub(super) fn index(stream: &mut Stream, most: usize) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let drawn = (stream.uniform() * most as f64) as usize;
    drawn.min(most.saturating_sub(1))
}

/// Whole counts >= 1 of this sum, near to the shares.
pub(super) fn whole_counts(shares: &[f64], moves: usize) -> Vec<usize> {
    let total: f64 = shares.iter().sum();
    let legs = shares.len();
    let mut counts = Vec::with_capacity(legs);
    let (mut sum, mut last) = (0.0, 0);
    for (leg, share) in shares.iter().enumerate() {
        sum += share / total * moves as f64;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let end = (sum.round() as usize).clamp(last + 1, moves - (legs - 1 - leg));
        counts.push(end - last);
        last = end;
    }
    counts
}

/// The headings of legs as headings of steps.
pub(super) fn spread(headings: &[f64], counts: &[usize]) -> Vec<f64> {
    let mut out = Vec::new();
    for (&heading, &count) in headings.iter().zip(counts) {
        out.extend(core::iter::repeat_n(heading, count));
    }
    out
}

pub(super) fn packed(layout: &Layout, headings: &[Vec<f64>]) -> Vec<f64> {
    let mut x = vec![1.0; layout.unknowns()];
    for (observer, headings) in headings.iter().enumerate() {
        let first = layout.first(observer);
        x[first..first + headings.len()].copy_from_slice(headings);
    }
    x
}

/// Paths at full speed that go as `wanted` asks, turned aside from targets and discs.
pub(super) fn steered(
    problem: &Problem,
    layout: &Layout,
    mut wanted: impl FnMut(usize, &Place<f64>) -> f64,
) -> Vec<f64> {
    let targets: Vec<[f64; 4]> = problem
        .beliefs
        .iter()
        .flat_map(|belief| belief.targets.iter().copied())
        .collect();
    let mut all = Vec::with_capacity(problem.observers.len());
    for (index, observer) in problem.observers.iter().enumerate() {
        let limits = Limits {
            standoff: problem.standoff * (1.0 + 1e-9),
            targets: &targets,
            keep_out: &problem.discs,
            max_turn: observer.max_turn * (1.0 - 1e-9),
        };
        let lengths = vec![observer.speed[1] * problem.dt; problem.moves];
        let mut headings = vec![0.0; problem.moves];
        follow(
            observer.start,
            problem.dt,
            &lengths,
            observer.heading,
            &limits,
            |place| wanted(index, place),
            &mut headings,
        );
        // Without jumps of whole turns.
        let mut before = headings.first().copied().unwrap_or(0.0);
        for heading in &mut headings {
            *heading = before + wrapped(*heading - before);
            before = *heading;
        }
        all.push(headings);
    }
    packed(layout, &all)
}
