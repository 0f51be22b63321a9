//! Disturbances of the best paths.

use alloc::vec::Vec;
use core::f64::consts::TAU;

use super::super::paths::Layout;
use super::Search;
use super::draft::{index, steered, whole_counts};
use crate::batch::Stream;

impl Search {
    /// Disturbs one of the best paths and refines it again.
    pub(super) fn disturb(&mut self, round: usize, look: &mut dyn FnMut() -> bool) {
        let mut stream = Stream::new(self.options.seed, 1 + round as u64);
        let pick = if stream.uniform() < 0.6 {
            0
        } else {
            index(&mut stream, self.pool.len().min(5))
        };
        let mut moved = self.pool[pick].clone();
        let layout = Layout::new(&self.problem, moved.counts.clone());
        let observer = index(&mut stream, self.problem.observers.len());
        let first = layout.first(observer);
        let legs = layout.legs();
        moved.family = "disturbed";
        moved.guess = f64::NAN;
        let headings = &mut moved.x[first..first + legs];
        let begin = index(&mut stream, legs);
        let end = begin + 1 + index(&mut stream, legs - begin);
        match index(&mut stream, 5) {
            0 => {
                // A part of the path turned.
                let turn = 0.7 * stream.normal();
                for heading in &mut headings[begin..end] {
                    *heading += turn;
                }
            }
            1 => {
                // All that follows mirrored about the line of sight.
                let mut tracks = Vec::new();
                layout.walk(&self.problem, &self.pool[pick].x, &mut tracks);
                let step: usize = moved.counts[..begin].iter().sum();
                let axis = self.aim_bearing(tracks[observer].at[step]);
                for heading in &mut headings[begin..] {
                    *heading = 2.0 * axis - *heading;
                }
            }
            2 => {
                // A part of the path straight, anywhere.
                let straight = TAU * stream.uniform();
                headings[begin..end].fill(straight);
            }
            3 => {
                // The end of another path.
                let other = &self.pool[index(&mut stream, self.pool.len())];
                if other.counts == moved.counts {
                    headings[begin..].copy_from_slice(&other.x[first + begin..first + legs]);
                }
            }
            _ => {
                for heading in headings.iter_mut() {
                    *heading += 0.3 * stream.normal();
                }
                if self.problem.legs.is_some() && legs > 1 {
                    moved.counts = disturbed_counts(&moved.counts, &mut stream);
                }
            }
        }
        if self.problem.legs.is_none() {
            let layout = Layout::new(&self.problem, moved.counts.clone());
            let wanted: Vec<Vec<f64>> = (0..self.problem.observers.len())
                .map(|o| layout.headings(&moved.x, o).to_vec())
                .collect();
            let steered = steered(&self.problem, &layout, |o, place| wanted[o][place.step]);
            // The speeds stay.
            for o in 0..wanted.len() {
                let first = layout.first(o);
                moved.x[first..first + legs].copy_from_slice(&steered[first..first + legs]);
            }
        }
        moved.cost = f64::INFINITY;
        moved.projected = f64::INFINITY;
        let mut found = self.refine(&moved, false, look);
        let best = self.pool[0].merit();
        let near = if self.problem.legs.is_some() || self.corners {
            0.15
        } else {
            0.02
        };
        if found.merit() < best + near {
            found = self.refine(&found, true, look);
            if self.problem.legs.is_some_and(|legs| legs > 1) {
                found = self.exchange(found, look);
            }
        }
        self.keep(found);
    }
}

fn disturbed_counts(counts: &[usize], stream: &mut Stream) -> Vec<usize> {
    let moves: usize = counts.iter().sum();
    let mut shares: Vec<f64> = counts.iter().map(|&count| count as f64).collect();
    for share in &mut shares {
        *share += 0.12 * moves as f64 * stream.normal();
        *share = share.max(1.0);
    }
    whole_counts(&shares, moves)
}
