//! First guesses: laws, arcs and straight legs.

use alloc::sync::Arc as Shared;
use alloc::vec;
use alloc::vec::Vec;
use core::f64::consts::{PI, TAU};

use super::super::descend::Program;
use super::draft::{packed, spread, steered, whole_counts};
use super::{ALL, Candidate, Search};
use crate::batch::Stream;
use crate::maneuver::batch::plan::by_law;
use crate::maneuver::steer::Arc;
use crate::maneuver::{Law, Side};
use crate::scalar::hypot;

impl Search {
    /// Family `kind`: 0 laws and arcs (or all of a given number of legs), then paths of
    /// `kind` legs.
    pub(super) fn guess(&mut self, kind: usize, look: &mut dyn FnMut() -> bool) {
        if let Some(legs) = self.problem.legs {
            self.guess_legs(legs, look);
        } else if kind == 0 {
            self.guess_laws(look);
        } else if kind <= self.problem.moves {
            self.guess_legs(kind, look);
        }
        let key = |guess: &Candidate| guess.merit();
        self.guesses.sort_by(|a, b| key(a).total_cmp(&key(b)));
        self.guesses.truncate(400);
    }

    pub(super) fn aim_bearing(&self, from: [f64; 2]) -> f64 {
        let aim = self.problem.aim_at();
        (aim[0] - from[0]).atan2(aim[1] - from[1])
    }

    pub(super) fn offer(
        &mut self,
        program: &mut Program<'_>,
        family: &'static str,
        legs: usize,
        x: Vec<f64>,
    ) {
        let (cost, broken) = program.judge(&x, f64::INFINITY);
        self.guessed += 1;
        if cost.is_finite() {
            self.guesses.push(Candidate {
                family,
                legs,
                counts: program.layout.counts.clone(),
                x,
                guess: cost,
                cost,
                broken,
                projected: f64::INFINITY,
                tried: 0,
            });
        }
    }

    /// Paths of `legs` straight legs; with free headings they are turned aside from what
    /// they must not enter.
    pub(super) fn guess_legs(&mut self, legs: usize, look: &mut dyn FnMut() -> bool) {
        let problem = self.problem.clone();
        let objective = Shared::clone(&self.objective);
        let observers = problem.observers.len();
        let bearings: Vec<f64> = problem
            .observers
            .iter()
            .map(|observer| self.aim_bearing(observer.start))
            .collect();
        let grid: usize = match legs {
            1 => 36,
            2 => 24,
            3 => 12,
            _ => 0,
        };
        // Long paths are guessed more sparsely, and the first start takes none of free ones.
        let long = 1 + (problem.moves * problem.beliefs.len()) as u64 / 200;
        let [part, all] = if problem.legs.is_some() {
            [self.options.starts, ALL]
        } else {
            [self.options.starts.saturating_sub(1), ALL - 1]
        };
        let kept = 0x10000 * part.min(all) as u64 / (all as u64 * long);
        let splits = splits(problem.moves, legs, &mut self.stream);
        let each = if grid > 0 && observers == 1 {
            core::iter::repeat_n(grid, legs).product()
        } else {
            2400 / splits.len().max(1)
        };
        for counts in splits {
            let given = if problem.legs.is_some() {
                counts.clone()
            } else {
                vec![1; problem.moves]
            };
            let mut program = Program::new(&problem, &*objective, given, look);
            for number in 0..each {
                if program.stopped {
                    break;
                }
                if (number as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40 & 0xFFFF >= kept {
                    continue;
                }
                let mut wanted = Vec::with_capacity(observers);
                for bearing in &bearings {
                    let mut rest = number;
                    let headings: Vec<f64> = (0..legs)
                        .map(|_| {
                            if grid > 0 && observers == 1 {
                                let index = rest % grid;
                                rest /= grid;
                                bearing + TAU * (index as f64 + 0.37) / grid as f64
                            } else {
                                TAU * self.stream.uniform()
                            }
                        })
                        .collect();
                    wanted.push(headings);
                }
                let x = if problem.legs.is_some() {
                    packed(&program.layout, &wanted)
                } else {
                    let spread: Vec<Vec<f64>> = wanted
                        .iter()
                        .map(|headings| spread(headings, &counts))
                        .collect();
                    steered(&problem, &program.layout, |observer, place| {
                        spread[observer][place.step]
                    })
                };
                self.offer(&mut program, "straight legs", legs, x);
            }
        }
    }

    /// Laws to either side, and straight on then round the target.
    pub(super) fn guess_laws(&mut self, look: &mut dyn FnMut() -> bool) {
        let problem = self.problem.clone();
        let objective = Shared::clone(&self.objective);
        let aim = problem.aim_at();
        let moves = problem.moves;
        let mut program = Program::new(&problem, &*objective, vec![1; moves], look);
        let pick = |index: usize, observer: usize| {
            // Observers go to either side in turn, or all to one.
            let flip = index % 2 == 1;
            if (observer % 2 == 1) == flip {
                Side::Right
            } else {
                Side::Left
            }
        };
        for law in [
            Law::MaxDet,
            Law::HammelLiu,
            Law::BearingRate,
            Law::Circle,
            Law::Perpendicular,
        ] {
            for index in 0..4 {
                let x = steered(&problem, &program.layout, |observer, place| {
                    let side = pick(index + if index > 1 { observer } else { 0 }, observer);
                    let point = crate::bearings::moved(&aim, place.time);
                    let range = hypot(point[0] - place.at[0], point[1] - place.at[1]);
                    let bearing = crate::bearings::sight(place.at, point);
                    let length = problem.observers[observer].speed[1] * problem.dt;
                    by_law(law, side, bearing, range, length)
                });
                self.offer(&mut program, "law", 0, x);
            }
        }
        for share in [1.0, 0.95, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5, 0.35, 0.2] {
            for offset in 0..13 {
                let offset = PI * (0.02 + 0.08 * f64::from(offset)).powf(1.5);
                for index in 0..4 {
                    let mut arcs: Vec<_> = (0..problem.observers.len())
                        .map(|observer| {
                            let side = pick(index + if index > 1 { observer } else { 0 }, observer);
                            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
                            let turn_back = (share * moves as f64).round() as usize;
                            Arc {
                                offset,
                                side: side.sign::<f64>(),
                                turn_back,
                            }
                            .wanted(aim)
                        })
                        .collect();
                    let x = steered(&problem, &program.layout, |observer, place| {
                        arcs[observer](place)
                    });
                    self.offer(&mut program, "straight, then round", 0, x);
                    if problem.observers.len() == 1 && index == 1 {
                        break;
                    }
                }
            }
        }
    }

    /// Leaves the best guesses that differ: mirror images do not.
    pub(super) fn choose(&mut self) {
        let mut chosen: Vec<Candidate> = Vec::new();
        for guess in core::mem::take(&mut self.guesses) {
            let alike = |other: &Candidate| {
                (other.cost - guess.cost).abs() < 1e-4 * (1.0 + guess.cost.abs())
            };
            let same = chosen
                .iter()
                .filter(|other| other.family == guess.family && other.legs == guess.legs)
                .count();
            let most = if self.problem.legs.is_some() {
                self.options.starts
            } else {
                4
            };
            if same < most && !chosen.iter().any(alike) {
                chosen.push(guess);
            }
            if chosen.len() == self.options.starts {
                break;
            }
        }
        self.guesses = chosen;
    }
}

/// How many steps the legs of first guesses have.
fn splits(moves: usize, legs: usize, stream: &mut Stream) -> Vec<Vec<usize>> {
    let table: &[&[f64]] = match legs {
        1 => &[&[1.0]],
        2 => &[
            &[1.0, 1.0],
            &[1.0, 2.0],
            &[2.0, 1.0],
            &[1.0, 4.0],
            &[4.0, 1.0],
        ],
        3 => &[
            &[1.0, 1.0, 1.0],
            &[1.0, 2.0, 1.0],
            &[2.0, 1.0, 1.0],
            &[1.0, 1.0, 2.0],
            &[2.0, 2.0, 1.0],
            &[1.0, 2.0, 2.0],
        ],
        _ => &[],
    };
    let mut out: Vec<Vec<usize>> = table
        .iter()
        .map(|shares| whole_counts(shares, moves))
        .collect();
    if out.is_empty() {
        out.push(whole_counts(&vec![1.0; legs], moves));
        for _ in 0..11 {
            let shares: Vec<f64> = (0..legs).map(|_| 0.15 + stream.uniform()).collect();
            out.push(whole_counts(&shares, moves));
        }
    }
    out
}
