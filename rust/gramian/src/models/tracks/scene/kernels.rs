//! The two passes over the samples of a sensor, on vectors: where the target is at each,
//! and what the sensor reads of it.

use crate::batch::lanes::{Block, LANES, Lanes};
use crate::models::tracks::motion::{Change, Motion, emitted};
use crate::models::tracks::sensors::{Reading, Sensor, Sight};
use crate::numbers::lane::Lane;

/// States of a motion at most.
pub const MOST: usize = 24;

/// The clock of a sensor: its stamps are `offset` late.
#[derive(Clone, Copy, Debug, Default)]
pub struct Clock {
    /// s.
    pub offset: f64,
    /// Whether the carrier's path has the true time, not the same stamps.
    pub true_path: bool,
    /// Whether the offset is a state.
    pub state: bool,
}

impl Clock {
    /// By how much the carrier's path is read earlier.
    fn shift(self) -> f64 {
        if self.true_path { self.offset } else { 0.0 }
    }
}

/// Blocks that [`Moves`] writes for each block of samples.
pub const fn moves_size(dimension: usize, columns: usize) -> usize {
    2 * dimension * (columns + 1)
}

/// Where the target is at each sample: for each block of samples place, velocity, and
/// then the changes of both by each state of the motion and by the clock offset.
pub struct Moves<'a, M, const D: usize> {
    pub motion: &'a M,
    pub x: &'a [f64],
    pub clock: Clock,
    /// Speed of the wave, where its delay counts.
    pub delay: Option<f64>,
    pub times: &'a [Block],
    pub carrier: &'a [Block],
    pub out: &'a mut [Block],
}

/// Place, velocity and axis of a carrier.
type Carried<S, const D: usize> = ([Lanes<S>; D], [Lanes<S>; D], [Lanes<S>; D]);

/// Place less `shift` seconds of motion, and velocity, of a carrier.
#[inline(always)]
fn carried<S: pulp::Simd, const D: usize>(
    simd: S,
    carrier: &[Block],
    part: usize,
    shift: f64,
) -> Carried<S, D> {
    let zero = Lanes::splat(simd, 0.0);
    let (mut place, mut velocity, mut axis) = ([zero; D], [zero; D], [zero; D]);
    let shift = Lanes::splat(simd, shift);
    for k in 0..D {
        velocity[k] = Lanes::load(simd, &carrier[D + k], part);
        let at = Lanes::load(simd, &carrier[k], part);
        place[k] = Lane::negate_mul_add(shift, velocity[k], at);
        axis[k] = Lanes::load(simd, &carrier[2 * D + k], part);
    }
    (place, velocity, axis)
}

impl<M: Motion<D>, const D: usize> pulp::WithSimd for Moves<'_, M, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let zero = Lanes::splat(simd, 0.0);
        let states = self.motion.states();
        let mut x = [zero; MOST];
        for (lane, &value) in x.iter_mut().zip(self.x).take(states) {
            *lane = Lanes::splat(simd, value);
        }
        let mut changes = [Change::zero(zero); MOST];
        let columns = states + usize::from(self.clock.state);
        let size = moves_size(D, columns);
        let offset = Lanes::splat(simd, self.clock.offset);
        let shift = self.clock.shift();
        let blocks = self.times.iter().zip(self.carrier.chunks_exact(3 * D));
        for ((times, carrier), out) in blocks.zip(self.out.chunks_exact_mut(size)) {
            for part in 0..Lanes::<S>::PARTS {
                let u = Lanes::load(simd, times, part) - offset;
                let (place, velocity, _) = carried::<S, D>(simd, carrier, part, shift);
                let mut own = [zero; D];
                if self.clock.true_path {
                    own = velocity;
                }
                let speed = self.delay;
                let out_of = emitted(self.motion, &x, u, &place, &own, speed, &mut changes);
                let (now, pace) = (out_of.instant, out_of.pace);
                if self.clock.state {
                    // What the carriers move is added where they are seen from.
                    for k in 0..D {
                        changes[states].place[k] = -(pace * now.velocity[k]);
                        changes[states].velocity[k] = -(pace * now.acceleration[k]);
                    }
                }
                for k in 0..D {
                    now.place[k].store(&mut out[k], part);
                    now.velocity[k].store(&mut out[D + k], part);
                }
                for (column, out) in changes.iter().zip(out[2 * D..].chunks_exact_mut(2 * D)) {
                    for k in 0..D {
                        column.place[k].store(&mut out[k], part);
                        column.velocity[k].store(&mut out[D + k], part);
                    }
                }
            }
        }
    }
}

/// What a sensor reads at each sample: for each block of samples the value, its
/// derivatives by each column of [`Moves`], and by the sensor's two parameters.
pub struct Sees<'a, K, const D: usize> {
    pub sensor: &'a K,
    pub parameters: [f64; 2],
    /// Columns of the moves.
    pub columns: usize,
    pub clock: Clock,
    pub moves: &'a [Block],
    pub carrier: &'a [Block],
    /// Where the reading of another carrier is taken off.
    pub second: Option<&'a [Block]>,
    pub out: &'a mut [Block],
}

impl<K: Sensor<D>, const D: usize> pulp::WithSimd for Sees<'_, K, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let zero = Lanes::splat(simd, 0.0);
        let parameters = [
            Lanes::splat(simd, self.parameters[0]),
            Lanes::splat(simd, self.parameters[1]),
        ];
        let size = moves_size(D, self.columns);
        let shift = self.clock.shift();
        let moves = self.moves.chunks_exact(size);
        let outs = self.out.chunks_exact_mut(self.columns + 3);
        for (block, (moves, out)) in moves.zip(outs).enumerate() {
            for part in 0..Lanes::<S>::PARTS {
                let (mut place, mut target) = ([zero; D], [zero; D]);
                for k in 0..D {
                    place[k] = Lanes::load(simd, &moves[k], part);
                    target[k] = Lanes::load(simd, &moves[D + k], part);
                }
                let mut found: Option<Reading<Lanes<S>, D>> = None;
                // How the reading changes where the carriers are seen earlier.
                let mut own = zero;
                for carrier in [self.second, Some(self.carrier)].into_iter().flatten() {
                    let carrier = &carrier[block * 3 * D..][..3 * D];
                    let (at, velocity, axis) = carried::<S, D>(simd, carrier, part, shift);
                    let mut offset = place;
                    for k in 0..D {
                        offset[k] = offset[k] - at[k];
                    }
                    let sight = Sight {
                        offset,
                        target,
                        carrier: velocity,
                        axis,
                    };
                    let reading = self.sensor.read(&sight, &parameters);
                    let mut its = zero;
                    for k in 0..D {
                        its = Lane::mul_add(reading.by_place[k], velocity[k], its);
                    }
                    own = its - own;
                    found = Some(match found {
                        Some(other) => reading.less(&other),
                        None => reading,
                    });
                }
                let Some(reading) = found else { return };
                reading.value.store(&mut out[0], part);
                for (index, (column, out)) in moves[2 * D..]
                    .chunks_exact(2 * D)
                    .zip(&mut out[1..=self.columns])
                    .enumerate()
                {
                    let (mut place, mut velocity) = ([zero; D], [zero; D]);
                    for k in 0..D {
                        place[k] = Lanes::load(simd, &column[k], part);
                        velocity[k] = Lanes::load(simd, &column[D + k], part);
                    }
                    let mut along = reading.along(&place, &velocity);
                    if self.clock.state && self.clock.true_path && index + 1 == self.columns {
                        along = along + own;
                    }
                    along.store(out, part);
                }
                for k in 0..2 {
                    reading.by_parameter[k].store(&mut out[self.columns + 1 + k], part);
                }
            }
        }
    }
}

/// From blocks of readings of one axis of a sensor to its values, not whitened, and rows:
/// the index of the first sample that has none is given back.
pub struct Gathers<'a> {
    /// As [`Sees`] writes them.
    pub reads: &'a [Block],
    pub columns: usize,
    /// States of the motion, the first of all.
    pub moving: usize,
    /// A reading is multiplied by `gain`, and then `bias` is added.
    pub gain: f64,
    pub bias: f64,
    /// State behind those of the motion, column of the readings, factor.
    pub others: [Option<(usize, usize, f64)>; 4],
    /// One block for each state: what the rows of all samples have there, or begin with.
    pub lines: &'a mut [Block],
    /// As many, to work with.
    pub weighted: &'a mut [Block],
    /// What the rows are multiplied by: a number for each sample, or nothing.
    pub weights: &'a [Block],
    /// Whether a reading of 0 or pi has no derivative.
    pub cone: bool,
    pub count: usize,
    /// From one sample to the next.
    pub width: usize,
    /// Empty where they are not wanted.
    pub values: &'a mut [f64],
    pub rows: Option<&'a mut [f64]>,
}

impl pulp::WithSimd for Gathers<'_> {
    type Output = Option<usize>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, simd: S) -> Option<usize> {
        let n = self.lines.len();
        let step = self.width * n;
        let gain = Lanes::splat(simd, self.gain);
        let touched = self
            .others
            .map(|other| other.map(|(state, _, _)| (state, self.lines[state])));
        for (block, reads) in self.reads.chunks_exact(self.columns + 3).enumerate() {
            let from = block * LANES;
            let count = LANES.min(self.count - from);
            // What is not finite stays so in a sum.
            let mut sums = [0.0; LANES];
            for part in 0..Lanes::<S>::PARTS {
                let mut sum = Lanes::load(simd, &reads[0], part);
                let moved = &reads[1..=self.moving];
                for (line, column) in self.lines.iter_mut().zip(moved) {
                    let column = Lanes::load(simd, column, part);
                    sum = sum + column;
                    // The sum turns a negative zero into zero.
                    (gain * column + sum.splat(0.0)).store(line, part);
                }
                sum.store(&mut sums, part);
                for (state, line) in touched.iter().flatten() {
                    Lanes::load(simd, line, part).store(&mut self.lines[*state], part);
                }
                for &(state, column, factor) in self.others.iter().flatten() {
                    let factor = Lanes::splat(simd, factor);
                    let entry = Lanes::load(simd, &self.lines[state], part);
                    let column = Lanes::load(simd, &reads[column], part);
                    (entry + factor * column).store(&mut self.lines[state], part);
                }
                if let Some(weights) = self.weights.get(block) {
                    let weight = Lanes::load(simd, weights, part);
                    for (line, out) in self.lines.iter().zip(&mut *self.weighted) {
                        (Lanes::load(simd, line, part) * weight).store(out, part);
                    }
                }
            }
            // One number tells of all, where none is on an axis and none is left over.
            let [a, b, c, d, e, f, g, h] = sums;
            let all = ((a + b) + (c + d)) + ((e + f) + (g + h));
            if self.cone || count < LANES || !all.is_finite() {
                for (lane, (sum, &value)) in sums.iter().zip(&reads[0]).enumerate().take(count) {
                    let end = core::f64::consts::PI - 1e-8;
                    if !sum.is_finite() || (self.cone && !(value > 1e-8 && value < end)) {
                        return Some(from + lane);
                    }
                }
            }
            if !self.values.is_empty() {
                let values = self.values[from * self.width..].chunks_mut(self.width);
                for (out, &value) in values.zip(&reads[0]).take(count) {
                    out[0] = value * self.gain + self.bias;
                }
            }
            let Some(rows) = &mut self.rows else { continue };
            let rows = &mut rows[from * step..];
            let lines = if self.weights.is_empty() {
                &*self.lines
            } else {
                &*self.weighted
            };
            match n {
                4 => turned::<4>(lines, count, step, rows),
                5 => turned::<5>(lines, count, step, rows),
                6 => turned::<6>(lines, count, step, rows),
                7 => turned::<7>(lines, count, step, rows),
                8 => turned::<8>(lines, count, step, rows),
                _ => {
                    for (lane, row) in rows.chunks_mut(step).enumerate().take(count) {
                        for (entry, line) in row.iter_mut().zip(lines) {
                            *entry = line[lane];
                        }
                    }
                }
            }
        }
        None
    }
}

/// The first `count` lanes of `N` columns as rows that begin every `step` numbers.
///
/// Out of line, for the instructions that every processor has: for the wide ones a compiler
/// makes loads under a mask of it, which wait for the stores before them.
#[inline(never)]
fn turned<const N: usize>(columns: &[Block], count: usize, step: usize, rows: &mut [f64]) {
    let Some(columns) = columns.first_chunk::<N>() else {
        return;
    };
    for (lane, row) in rows.chunks_mut(step).enumerate().take(count) {
        if let Some(row) = row.first_chunk_mut::<N>() {
            for k in 0..N {
                row[k] = columns[k][lane];
            }
        }
    }
}
