//! Paths: from headings and speeds to places, and derivatives back.

use alloc::vec;
use alloc::vec::Vec;

use super::Problem;
use crate::batch::simd::{Path, sin_cos_slice};

/// Headings whose sines are found at once.
const CHUNK: usize = 64;

/// The path of one observer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    /// Where each sample is taken.
    pub at: Vec<[f64; 2]>,
    /// Velocity over ground of each step, m/s.
    pub velocity: Vec<[f64; 2]>,
    /// (sin, cos) of the heading of each step.
    pub axis: Vec<[f64; 2]>,
}

impl Track {
    /// Place, velocity and axis at a sample: those of the step that leads there.
    #[inline]
    pub(super) fn sample(&self, sample: usize) -> ([f64; 2], [f64; 2], [f64; 2]) {
        let step = sample.saturating_sub(1);
        (self.at[sample], self.velocity[step], self.axis[step])
    }
}

/// Derivatives of a number by the path of one observer.
#[derive(Clone, Debug)]
pub(super) struct Pull {
    pub at: Vec<[f64; 2]>,
    pub velocity: Vec<[f64; 2]>,
    pub axis: Vec<[f64; 2]>,
}

impl Pull {
    pub fn new(moves: usize) -> Self {
        Self {
            at: vec![[0.0; 2]; moves + 1],
            velocity: vec![[0.0; 2]; moves],
            axis: vec![[0.0; 2]; moves],
        }
    }

    pub fn clear(&mut self) {
        for part in [&mut self.at, &mut self.velocity, &mut self.axis] {
            part.fill([0.0; 2]);
        }
    }

    /// Adds derivatives by offset of the target, velocity and axis at a sample.
    #[inline]
    pub fn add(&mut self, sample: usize, by: &[f64; 6]) {
        let step = sample.saturating_sub(1);
        for k in 0..2 {
            self.at[sample][k] -= by[k];
            self.velocity[step][k] += by[2 + k];
            self.axis[step][k] += by[4 + k];
        }
    }
}

/// How the unknowns of a path are laid out: for each observer its headings, one for each
/// leg, and where the speed is free the step length of each leg as a share of the longest.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Layout {
    /// Steps of each leg.
    pub counts: Vec<usize>,
    /// Whether the speed of each observer is free.
    pub free: Vec<bool>,
}

impl Layout {
    pub fn new(problem: &Problem, counts: Vec<usize>) -> Self {
        let free = problem
            .observers
            .iter()
            .map(|observer| observer.speed[0] < observer.speed[1])
            .collect();
        Self { counts, free }
    }

    pub fn legs(&self) -> usize {
        self.counts.len()
    }

    /// First unknown of an observer.
    pub fn first(&self, observer: usize) -> usize {
        self.free[..observer]
            .iter()
            .map(|&free| self.legs() * if free { 2 } else { 1 })
            .sum()
    }

    pub fn unknowns(&self) -> usize {
        self.first(self.free.len())
    }

    pub fn headings<'a>(&self, x: &'a [f64], observer: usize) -> &'a [f64] {
        let first = self.first(observer);
        &x[first..first + self.legs()]
    }

    /// Shares of the longest step; `None` where the speed is fixed.
    pub fn shares<'a>(&self, x: &'a [f64], observer: usize) -> Option<&'a [f64]> {
        let first = self.first(observer) + self.legs();
        self.free[observer].then(|| &x[first..first + self.legs()])
    }

    /// The paths, written over `tracks`.
    pub fn walk(&self, problem: &Problem, x: &[f64], tracks: &mut Vec<Track>) {
        tracks.resize_with(problem.observers.len(), Track::default);
        let moves = self.counts.iter().sum::<usize>();
        let (mut sines, mut cosines) = ([0.0; CHUNK], [0.0; CHUNK]);
        for (index, (observer, track)) in problem.observers.iter().zip(tracks).enumerate() {
            track.at.resize(moves + 1, [0.0; 2]);
            track.velocity.resize(moves, [0.0; 2]);
            track.axis.resize(moves, [0.0; 2]);
            let headings = self.headings(x, index);
            let shares = self.shares(x, index);
            let mut at = observer.start;
            track.at[0] = at;
            let mut places = track.at[1..]
                .iter_mut()
                .zip(&mut track.velocity)
                .zip(&mut track.axis);
            for (first, headings) in headings.chunks(CHUNK).enumerate() {
                let first = first * CHUNK;
                let legs = headings.len();
                sin_cos_slice(
                    Path::Best,
                    headings,
                    &mut sines[..legs],
                    &mut cosines[..legs],
                );
                for leg in 0..legs {
                    let (sin, cos) = (sines[leg], cosines[leg]);
                    let share = shares.map_or(1.0, |shares| shares[first + leg]);
                    let speed = observer.speed[1] * share;
                    let velocity = [
                        speed * sin + problem.current[0],
                        speed * cos + problem.current[1],
                    ];
                    let count = self.counts[first + leg];
                    for ((place, of_step), axis) in places.by_ref().take(count) {
                        at = [
                            at[0] + problem.dt * velocity[0],
                            at[1] + problem.dt * velocity[1],
                        ];
                        (*place, *of_step, *axis) = (at, velocity, [sin, cos]);
                    }
                }
            }
        }
    }

    /// Adds the derivatives by the unknowns; `tracks` are the paths walked from them.
    pub fn back(
        &self,
        problem: &Problem,
        x: &[f64],
        tracks: &[Track],
        pulls: &[Pull],
        gradient: &mut [f64],
    ) {
        for (index, (observer, pull)) in problem.observers.iter().zip(pulls).enumerate() {
            let first = self.first(index);
            let legs = self.legs();
            let free = self.free[index];
            let mut after = [0.0; 2];
            // From the last step on: a step moves all samples after it.
            let mut steps = pull.at[1..]
                .iter()
                .zip(&pull.velocity)
                .zip(pull.axis.iter().zip(&tracks[index].axis))
                .rev();
            for leg in (0..legs).rev() {
                let mut by_velocity = [0.0; 2];
                let mut by_axis = [0.0; 2];
                let mut axis = [0.0; 2];
                for ((at, velocity), (turn, of_step)) in steps.by_ref().take(self.counts[leg]) {
                    axis = *of_step;
                    for k in 0..2 {
                        after[k] += at[k];
                        by_velocity[k] += problem.dt * after[k] + velocity[k];
                        by_axis[k] += turn[k];
                    }
                }
                let [sin, cos] = axis;
                let share = if free { x[first + legs + leg] } else { 1.0 };
                let speed = observer.speed[1] * share;
                gradient[first + leg] += (speed * by_velocity[0] + by_axis[0]) * cos
                    - (speed * by_velocity[1] + by_axis[1]) * sin;
                if free {
                    gradient[first + legs + leg] +=
                        observer.speed[1] * (by_velocity[0] * sin + by_velocity[1] * cos);
                }
            }
        }
    }
}
