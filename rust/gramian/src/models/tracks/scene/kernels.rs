//! The two passes over the samples of a sensor, on vectors: where the target is at each,
//! and what the sensor reads of it.

use crate::batch::lanes::{Block, LANES, Lanes};
use crate::batch::transpose::{Turning, order};
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
    pub fn shift(self) -> f64 {
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
pub type Carried<S, const D: usize> = ([Lanes<S>; D], [Lanes<S>; D], [Lanes<S>; D]);

/// Place less `shift` seconds of motion, and velocity, of a carrier.
#[inline(always)]
pub fn carried<S: pulp::Simd, const D: usize>(
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
                for k in 0..D {
                    now.place[k].store(&mut out[k], part);
                    now.velocity[k].store(&mut out[D + k], part);
                }
                for state in 0..states {
                    let out = &mut out[2 * D * (1 + state)..][..2 * D];
                    for k in 0..D {
                        changes[state].place[k].store(&mut out[k], part);
                        changes[state].velocity[k].store(&mut out[D + k], part);
                    }
                }
                if self.clock.state {
                    // What the carriers move is added where they are seen from.
                    let out = &mut out[2 * D * (1 + states)..][..2 * D];
                    for k in 0..D {
                        (-(pace * now.velocity[k])).store(&mut out[k], part);
                        (-(pace * now.acceleration[k])).store(&mut out[D + k], part);
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
    /// So many of them, the first, change one axis after the other alone.
    pub by_axes: usize,
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
                let (moved, others) = moves[2 * D..].split_at(self.by_axes * 2 * D);
                let (first, last) = out[1..].split_at_mut(self.by_axes);
                for (columns, out) in moved.chunks_exact(2 * D * D).zip(first.chunks_exact_mut(D)) {
                    for k in 0..D {
                        let column = &columns[k * 2 * D..][..2 * D];
                        let place = Lanes::load(simd, &column[k], part);
                        let mut along = reading.by_place[k] * place;
                        if K::SEES_VELOCITY {
                            let velocity = Lanes::load(simd, &column[D + k], part);
                            along = Lane::mul_add(reading.by_velocity[k], velocity, along);
                        }
                        along.store(&mut out[k], part);
                    }
                }
                for (index, (column, out)) in
                    (self.by_axes..self.columns).zip(others.chunks_exact(2 * D).zip(last))
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
    pub lines: &'a [Block],
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

impl Gathers<'_> {
    /// The columns of the rows of a block; not finite where one of the readings is not.
    #[inline(always)]
    fn columns<S: pulp::Simd>(
        &mut self,
        simd: S,
        part: usize,
        reads: &[Block],
        weight: Lanes<S>,
    ) -> Lanes<S> {
        let gain = Lanes::splat(simd, self.gain);
        let mut sum = Lanes::load(simd, &reads[0], part);
        let (moved, others) = self.weighted.split_at_mut(self.moving);
        for (out, column) in moved.iter_mut().zip(&reads[1..]) {
            let column = Lanes::load(simd, column, part);
            sum = sum + column;
            // The sum turns a negative zero into zero.
            ((gain * column + sum.splat(0.0)) * weight).store(out, part);
        }
        let begun = &self.lines[self.moving..];
        for (state, (out, begun)) in others.iter_mut().zip(begun).enumerate() {
            let mut entry = Lanes::load(simd, begun, part);
            for &(other, column, factor) in self.others.iter().flatten() {
                if other == self.moving + state {
                    let factor = Lanes::splat(simd, factor);
                    entry = entry + factor * Lanes::load(simd, &reads[column], part);
                }
            }
            (entry * weight).store(out, part);
        }
        sum
    }

    /// The first sample that has no reading or no derivative.
    fn first_without(&self) -> Option<usize> {
        (0..self.count).find(|sample| {
            let reads = &self.reads[sample / LANES * (self.columns + 3)..];
            let lane = sample % LANES;
            let sum: f64 = reads[..=self.moving].iter().map(|read| read[lane]).sum();
            let end = core::f64::consts::PI - 1e-8;
            let value = reads[0][lane];
            !sum.is_finite() || (self.cone && !(value > 1e-8 && value < end))
        })
    }
}

impl pulp::WithSimd for Gathers<'_> {
    type Output = Option<usize>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, simd: S) -> Option<usize> {
        let n = self.lines.len();
        let step = self.width * n;
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let order = order(simd);
        // Not zero where one of all is not finite.
        let mut wrong = zero;
        for (block, reads) in self.reads.chunks_exact(self.columns + 3).enumerate() {
            let from = block * LANES;
            let count = LANES.min(self.count - from);
            for part in 0..Lanes::<S>::PARTS {
                let weight = match self.weights.get(block) {
                    Some(weights) => Lanes::load(simd, weights, part),
                    None => one,
                };
                let sum = self.columns(simd, part, reads, weight);
                wrong = Lane::mul_add(sum, zero, wrong);
            }
            if !self.values.is_empty() {
                let values = self.values[from * self.width..].chunks_mut(self.width);
                for (out, &value) in values.zip(&reads[0]).take(count) {
                    out[0] = value * self.gain + self.bias;
                }
            }
            if let Some(rows) = &mut self.rows {
                let (rows, lines) = (&mut rows[from * step..], &*self.weighted);
                let all = count == LANES && step == n;
                match n {
                    4 if all => whole::<S, 4>(simd, lines, &order, rows),
                    5 if all => whole::<S, 5>(simd, lines, &order, rows),
                    6 if all => whole::<S, 6>(simd, lines, &order, rows),
                    7 if all => whole::<S, 7>(simd, lines, &order, rows),
                    8 if all => whole::<S, 8>(simd, lines, &order, rows),
                    _ => turned(simd, lines, &order, count, step, rows),
                }
            }
        }
        if self.cone || wrong.sum() != 0.0 {
            return self.first_without();
        }
        None
    }
}

/// All lanes of `N` columns as rows that follow each other: as [`turned`], in less time.
#[inline(always)]
fn whole<S: pulp::Simd, const N: usize>(
    simd: S,
    columns: &[Block],
    order: &[usize; LANES],
    rows: &mut [f64],
) {
    let rows = rows.as_chunks_mut::<N>().0.first_chunk_mut::<LANES>();
    let (Some(rows), Some(columns)) = (rows, columns.first_chunk::<N>()) else {
        return;
    };
    let lanes = S::F64_LANES;
    let mut square = Turning::empty();
    for part in 0..Lanes::<S>::PARTS {
        let first = part * lanes;
        for i in 0..N / 4 {
            let Some(four) = columns[4 * i..].first_chunk() else {
                return;
            };
            square.fill(simd, four, part);
            for k in 0..lanes {
                let row = &mut rows[(first + order[k]) % LANES];
                row[4 * i..4 * i + 4].copy_from_slice(&square.rows()[k]);
            }
        }
        for k in N / 4 * 4..N {
            for lane in first..first + lanes {
                rows[lane % LANES][k] = columns[k][lane % LANES];
            }
        }
    }
}

/// The first `count` lanes of some columns as rows that begin every `step` numbers.
#[inline(always)]
fn turned<S: pulp::Simd>(
    simd: S,
    columns: &[Block],
    order: &[usize; LANES],
    count: usize,
    step: usize,
    rows: &mut [f64],
) {
    let lanes = S::F64_LANES;
    let (fours, rest) = columns.as_chunks::<4>();
    let mut square = Turning::empty();
    for part in 0..Lanes::<S>::PARTS {
        let first = part * lanes;
        for (i, four) in fours.iter().enumerate() {
            square.fill(simd, four, part);
            for (row, lane) in square.rows().iter().zip(order).take(lanes) {
                let at = (first + lane) * step + 4 * i;
                if first + lane < count {
                    rows[at..at + 4].copy_from_slice(row);
                }
            }
        }
        let from = 4 * fours.len();
        if let [column] = rest {
            for lane in first..(first + lanes).min(count) {
                rows[lane * step + from] = column[lane];
            }
        } else if !rest.is_empty() {
            let mut four = [rest[0]; 4];
            four[..rest.len()].copy_from_slice(rest);
            square.fill(simd, &four, part);
            for (row, lane) in square.rows().iter().zip(order).take(lanes) {
                let at = (first + lane) * step + from;
                if first + lane < count {
                    rows[at..at + rest.len()].copy_from_slice(&row[..rest.len()]);
                }
            }
        }
    }
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use alloc::vec;
    use alloc::vec::Vec;

    use super::*;
    use crate::batch::simd::Path;

    struct Turns<'a> {
        columns: &'a [Block],
        count: usize,
        step: usize,
        whole: bool,
        rows: &'a mut [f64],
    }

    impl pulp::WithSimd for Turns<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: pulp::Simd>(self, simd: S) {
            let order = order(simd);
            let (columns, rows) = (self.columns, self.rows);
            match columns.len() {
                4 if self.whole => whole::<S, 4>(simd, columns, &order, rows),
                5 if self.whole => whole::<S, 5>(simd, columns, &order, rows),
                7 if self.whole => whole::<S, 7>(simd, columns, &order, rows),
                _ => turned(simd, columns, &order, self.count, self.step, rows),
            }
        }
    }

    #[test]
    fn columns_become_rows_on_every_path() {
        for path in Path::available() {
            let shapes = |n| {
                [
                    (n, 8, 0, true),
                    (n, 8, 0, false),
                    (n, 5, 2, false),
                    (n, 1, 0, false),
                ]
            };
            for (n, count, gap, whole) in (1..10).flat_map(shapes) {
                let columns: Vec<Block> = (0..n)
                    .map(|k| core::array::from_fn(|lane| (10 * lane + k) as f64))
                    .collect();
                let step = n + gap;
                let mut rows = vec![-1.0; count * step];
                path.run(Turns {
                    columns: &columns,
                    count,
                    step,
                    whole,
                    rows: &mut rows,
                });
                for (at, found) in rows.into_iter().enumerate() {
                    let (lane, k) = (at / step, at % step);
                    let wanted = if k < n { (10 * lane + k) as f64 } else { -1.0 };
                    assert_eq!(found, wanted, "{path:?} {n} {count} {at}");
                }
            }
        }
    }
}
