//! Coarse paths: of few legs, and round the target with changes of side.

use alloc::sync::Arc as Shared;
use alloc::vec;
use alloc::vec::Vec;
use core::f64::consts::TAU;

use super::super::descend::{Effort, Program};
use super::super::paths::Layout;
use super::draft::{index, packed, spread, steered, whole_counts};
use super::{ALIKE, Candidate, Search};
use crate::batch::Stream;

/// Changes that are tried on a path round the target.
const CHANGES: usize = 300;
/// Coarse paths that are refined, for each start.
const SPREAD: usize = 2;

impl Search {
    /// Goes downhill from a random path of few equal legs: where a path has few unknowns
    /// so many can be tried that the best of the basins is among them.
    pub(super) fn coarse(&mut self, round: usize, look: &mut dyn FnMut() -> bool) {
        let mut stream = Stream::new(self.options.seed ^ 0x5EED, 1 + round as u64);
        let moves = self.problem.moves;
        let legs = [6, 8, 10, 12, 15][round % 5].min(moves);
        let counts = whole_counts(&vec![1.0; legs], moves);
        let mut relaxed = self.problem.clone();
        for observer in &mut relaxed.observers {
            observer.max_turn = f64::INFINITY;
        }
        let headings: Vec<Vec<f64>> = relaxed
            .observers
            .iter()
            .map(|observer| {
                let ahead = self.aim_bearing(observer.start);
                let parts = 1 + index(&mut stream, legs.min(6));
                let mut ends: Vec<usize> = (1..parts).map(|_| index(&mut stream, legs)).collect();
                ends.sort_unstable();
                let mut heading = 0.0;
                let mut part = usize::MAX;
                (0..legs)
                    .map(|leg| {
                        let now = ends.iter().filter(|&&end| end <= leg).count();
                        if now != part {
                            part = now;
                            heading = if stream.uniform() < 0.5 {
                                TAU * stream.uniform()
                            } else {
                                ahead + 1.2 * stream.normal()
                            };
                        }
                        heading
                    })
                    .collect()
            })
            .collect();
        let mut program = Program::new(&relaxed, &*self.objective, counts.clone(), look);
        let mut x = packed(&program.layout, &headings);
        let ladder: &[f64] = if self.corners { &[8.0, 64.0] } else { &[512.0] };
        for &sharpness in ladder {
            x = program
                .descend(
                    &x,
                    Effort {
                        rounds: 4,
                        steps: 40,
                        sharpness,
                        tolerance: 1e-3,
                        warm: false,
                        patience: 2,
                    },
                )
                .x;
        }
        let (cost, broken) = program.judge(&x, f64::INFINITY);
        self.guessed += 1;
        if !cost.is_finite() {
            return;
        }
        let found = Candidate {
            family: "coarse",
            legs,
            counts,
            x,
            guess: cost,
            cost,
            broken,
            projected: f64::INFINITY,
            tried: 0,
        };
        self.keep_coarse(found);
    }

    pub(super) fn keep_coarse(&mut self, found: Candidate) {
        let alike = self
            .coarse
            .iter()
            .position(|other| (other.merit() - found.merit()).abs() < ALIKE);
        match alike {
            Some(index) if found.merit() < self.coarse[index].merit() => self.coarse[index] = found,
            Some(_) => return,
            None => self.coarse.push(found),
        }
        self.coarse.sort_by(|a, b| a.merit().total_cmp(&b.merit()));
        self.coarse.truncate(SPREAD * self.options.starts);
    }

    /// A path straight in, then round the target at the stand-off range, with the changes
    /// of side that make it best: the side is a choice for each step that no descent makes.
    pub(super) fn round(&mut self, number: usize, look: &mut dyn FnMut() -> bool) {
        let mut stream = Stream::new(self.options.seed ^ 0x51DE, 1 + number as u64);
        let moves = self.problem.moves;
        let observers = self.problem.observers.len();
        let problem = self.problem.clone();
        let objective = Shared::clone(&self.objective);
        let mut program = Program::new(&problem, &*objective, vec![1; moves], look);
        let mut best: Vec<Round> = (0..observers)
            .map(|_| {
                let mut round = Round {
                    offset: 0.4 * stream.normal(),
                    sides: vec![stream.uniform() < 0.5; moves],
                };
                for _ in 0..index(&mut stream, 6) {
                    let from = index(&mut stream, moves);
                    round.flip(from, moves);
                }
                round
            })
            .collect();
        let aim = problem.aim_at();
        let mut judge = |rounds: &[Round]| {
            let mut arrived = vec![false; observers];
            let starts: Vec<f64> = problem
                .observers
                .iter()
                .map(|observer| crate::bearings::sight(observer.start, [aim[0], aim[1]]))
                .collect();
            let x = steered(&problem, &program.layout, |observer, place| {
                arrived[observer] |= place.deflected;
                if arrived[observer] {
                    let side = if rounds[observer].sides[place.step] {
                        1e-3
                    } else {
                        -1e-3
                    };
                    // A circle stands where its target is at the end of the step.
                    let point = crate::bearings::moved(&aim, place.ends);
                    crate::bearings::sight(place.at, point) + side
                } else {
                    starts[observer] + rounds[observer].offset
                }
            });
            let (cost, broken) = program.judge(&x, f64::INFINITY);
            (
                cost + if broken > 1e-9 {
                    1.0 + 100.0 * broken
                } else {
                    0.0
                },
                cost,
                broken,
                x,
            )
        };
        let mut now = judge(&best);
        self.guessed += CHANGES;
        for _ in 0..CHANGES {
            let mut changed = best.clone();
            let one = index(&mut stream, observers);
            changed[one].change(&mut stream);
            let new = judge(&changed);
            if new.0 < now.0 {
                (best, now) = (changed, new);
            }
        }
        let (_, cost, broken, x) = now;
        if cost.is_finite() {
            self.keep_coarse(Candidate {
                family: "straight, then round",
                legs: 0,
                counts: vec![1; moves],
                x,
                guess: cost,
                cost,
                broken,
                projected: f64::INFINITY,
                tried: 0,
            });
        }
    }

    /// Hands the best coarse paths on, with a heading for every step.
    pub(super) fn spread_coarse(&mut self) {
        for mut path in core::mem::take(&mut self.coarse) {
            let layout = Layout::new(&self.problem, path.counts.clone());
            let fine = Layout::new(&self.problem, vec![1; self.problem.moves]);
            let wanted: Vec<Vec<f64>> = (0..self.problem.observers.len())
                .map(|o| spread(layout.headings(&path.x, o), &path.counts))
                .collect();
            let turns = self
                .problem
                .observers
                .iter()
                .any(|o| o.max_turn.is_finite());
            let mut x = if turns {
                steered(&self.problem, &fine, |o, place| wanted[o][place.step])
            } else {
                packed(&fine, &wanted)
            };
            for o in 0..wanted.len() {
                if let Some(shares) = layout.shares(&path.x, o) {
                    let first = fine.first(o) + fine.legs();
                    x[first..first + fine.legs()].copy_from_slice(&spread(shares, &path.counts));
                }
            }
            path.x = x;
            path.counts = fine.counts;
            path.cost = f64::INFINITY;
            self.guesses.push(path);
        }
    }
}

/// A path straight in and then round the target: how far off the line of sight it goes in,
/// and whether each step goes to the right once it is there.
#[derive(Clone, Debug)]
struct Round {
    offset: f64,
    sides: Vec<bool>,
}

impl Round {
    fn flip(&mut self, from: usize, to: usize) {
        for side in &mut self.sides[from..to] {
            *side = !*side;
        }
    }

    /// Changes the sides of some steps in a row, moves a change of side, or the way in.
    fn change(&mut self, stream: &mut Stream) {
        let moves = self.sides.len();
        let turns: Vec<usize> = (1..moves)
            .filter(|&step| self.sides[step] != self.sides[step - 1])
            .collect();
        let draw = stream.uniform();
        if draw < 0.15 {
            self.offset += 0.15 * stream.normal();
        } else if draw < 0.6 && !turns.is_empty() {
            let turn = turns[index(stream, turns.len())];
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let by = 1 + (4.0 * stream.normal().abs()) as usize;
            if stream.uniform() < 0.5 {
                self.flip(turn.saturating_sub(by), turn);
            } else {
                self.flip(turn, (turn + by).min(moves));
            }
        } else {
            let from = index(stream, moves);
            let to = if draw > 0.8 {
                moves
            } else {
                (from + 1 + index(stream, 1 + moves / 4)).min(moves)
            };
            self.flip(from, to);
        }
    }
}
