//! From a path to the optimum near it: descent, polish, and turns moved by whole steps.

use alloc::vec;
use alloc::vec::Vec;

use super::super::descend::{Effort, Program};
use super::{Candidate, Search};

impl Search {
    pub(super) fn effort(&self, whole: bool) -> Effort {
        Effort {
            rounds: if whole { 14 } else { 5 },
            steps: if whole && self.corners {
                self.options.iterations.min(150)
            } else if whole {
                self.options.iterations
            } else {
                self.options.iterations.min(60)
            },
            sharpness: 512.0,
            tolerance: if whole { 1e-6 } else { 1e-4 },
            warm: false,
            patience: 2,
        }
    }

    pub(super) fn refine(
        &self,
        candidate: &Candidate,
        whole: bool,
        look: &mut dyn FnMut() -> bool,
    ) -> Candidate {
        self.descended(candidate, self.effort(whole), whole, look)
    }

    pub(super) fn descended(
        &self,
        candidate: &Candidate,
        effort: Effort,
        sharp: bool,
        look: &mut dyn FnMut() -> bool,
    ) -> Candidate {
        let mut program = Program::new(
            &self.problem,
            &*self.objective,
            candidate.counts.clone(),
            look,
        );
        let ladder: &[f64] = if !self.corners {
            &[512.0]
        } else if sharp {
            &[8.0, 32.0, 128.0, 512.0, 2048.0]
        } else {
            &[8.0, 64.0]
        };
        let mut best = candidate.clone();
        let mut x = candidate.x.clone();
        for &sharpness in ladder {
            let found = program.descend(
                &x,
                Effort {
                    sharpness,
                    ..effort
                },
            );
            x.clone_from(&found.x);
            let (cost, broken) = program.judge(&found.x, f64::INFINITY);
            let new = Candidate {
                x: found.x,
                cost,
                broken,
                projected: found.projected,
                ..candidate.clone()
            };
            if new.merit() <= best.merit() {
                best = new;
            }
            if program.stopped {
                break;
            }
        }
        if !best.projected.is_finite() {
            best.projected = program.projected_gradient(&best.x, 512.0);
        }
        best
    }

    pub(super) fn polish(
        &self,
        candidate: &Candidate,
        look: &mut dyn FnMut() -> bool,
    ) -> Candidate {
        // A search without restarts is to be quick, and goes on from where it is.
        let quick = self.options.restarts == 0;
        let effort = Effort {
            rounds: 30,
            steps: 4 * self.options.iterations,
            sharpness: 512.0,
            tolerance: 1e-7,
            warm: quick && candidate.projected < 0.1,
            patience: if quick { 2 } else { usize::MAX },
        };
        let mut found = self.descended(candidate, effort, true, look);
        // Many limits at once: on from where it came to, with what holds it there.
        for _ in 0..self.options.restarts.min(4) {
            if found.projected < 1e-3 || !look() {
                break;
            }
            let again = Effort {
                warm: true,
                ..effort
            };
            let before = found.projected;
            found = self.descended(&found, again, true, look);
            if found.projected > 0.5 * before {
                break;
            }
        }
        if self.problem.legs.is_some_and(|legs| legs > 1) {
            return self.exchange(found, look);
        }
        found
    }

    /// Moves the turns by whole steps as long as that makes the path better.
    pub(super) fn exchange(
        &self,
        candidate: Candidate,
        look: &mut dyn FnMut() -> bool,
    ) -> Candidate {
        let mut best = candidate;
        let mut shift = (self.problem.moves / 8).max(1);
        let mut going = true;
        while shift > 0 && going {
            let mut better = true;
            while better && going {
                better = false;
                for moves in shifts(best.counts.len(), shift) {
                    let Some(counts) = shifted(&best.counts, &moves) else {
                        continue;
                    };
                    let mut moved = best.clone();
                    moved.counts = counts;
                    moved.cost = f64::INFINITY;
                    let mut inner = || {
                        going = going && look();
                        going
                    };
                    let moved = self.refine(&moved, false, &mut inner);
                    if moved.merit() < best.merit() - 1e-8 {
                        best = moved;
                        better = true;
                    }
                }
            }
            shift /= 2;
        }
        self.refine(&best, true, look)
    }
}

/// Ways to move the turns between `legs` legs: one of them, or two that follow each other.
fn shifts(legs: usize, shift: usize) -> Vec<Vec<(usize, bool, usize)>> {
    let mut out = Vec::new();
    for turn in 0..legs - 1 {
        for later in [true, false] {
            out.push(vec![(turn, later, shift)]);
            if turn + 2 < legs {
                for next in [true, false] {
                    out.push(vec![(turn, later, shift), (turn + 1, next, shift)]);
                }
            }
        }
    }
    out
}

/// The counts after some turns came later or earlier; `None` where a leg has no step left.
fn shifted(counts: &[usize], moves: &[(usize, bool, usize)]) -> Option<Vec<usize>> {
    let mut ends: Vec<usize> = counts
        .iter()
        .scan(0, |sum, count| {
            *sum += count;
            Some(*sum)
        })
        .collect();
    for &(turn, later, by) in moves {
        ends[turn] = if later {
            ends[turn] + by
        } else {
            ends[turn].checked_sub(by)?
        };
    }
    let mut last = 0;
    let mut out = Vec::with_capacity(counts.len());
    for end in ends {
        if end <= last {
            return None;
        }
        out.push(end - last);
        last = end;
    }
    Some(out)
}
