//! Trials of one scene side by side: a trial in each lane, the geometry of the carriers
//! shared.

use alloc::vec;
use alloc::vec::Vec;

use super::{Channel, Group, Kind, Moving, Parameter, Scene, Whitener};
use crate::batch::Items;
use crate::batch::lanes::{Block, Blocks, LANES, Lanes};
use crate::batch::simd::sin_cos_slice;
use crate::models::tracks::carrier::Carried;
use crate::models::tracks::motion::{
    Change, CoordinatedTurn, Instant, Legs, Motion, Polynomial, SteadyLegs, Turns, emitted,
};
use crate::models::tracks::scene::kernels::MOST;
use crate::models::tracks::sensors::{
    Bearing, ConeAngle, Course, Elevation, Frequency, Place, Range, RangeRate, Reading, Sensor,
    Sight, SignalStrength, Speed, gradient,
};
use crate::numbers::algebra::dot;
use crate::numbers::angle::wrapped;
use crate::numbers::lane::Lane;
use crate::solve::side_by_side::{PIECE, Rows, SideBySide};

/// Constant velocity, known when this is compiled.
pub(super) struct ConstantVelocity;

impl<const D: usize> Motion<D> for ConstantVelocity {
    #[inline(always)]
    fn states(&self) -> usize {
        2 * D
    }

    #[inline(always)]
    fn at<L: Lane>(&self, x: &[L], u: L, changes: &mut [Change<L, D>]) -> Instant<L, D> {
        Polynomial::CONSTANT_VELOCITY.at(x, u, changes)
    }

    #[inline(always)]
    fn component(&self, state: usize) -> Option<usize> {
        Motion::<D>::component(&Polynomial::CONSTANT_VELOCITY, state)
    }
}

/// Two legs with a turn at an unknown time, likewise.
struct TwoLegs;

impl<const D: usize> Motion<D> for TwoLegs {
    #[inline(always)]
    fn states(&self) -> usize {
        3 * D + 1
    }

    #[inline(always)]
    fn at<L: Lane>(&self, x: &[L], u: L, changes: &mut [Change<L, D>]) -> Instant<L, D> {
        let turns = Turns::Unknown(1);
        Legs { turns }.at(x, u, changes)
    }

    #[inline(always)]
    fn component(&self, state: usize) -> Option<usize> {
        let turns = Turns::Unknown(1);
        Motion::<D>::component(&Legs { turns }, state)
    }
}

/// Any kind of sensor, told apart at each sample.
#[derive(Clone, Copy)]
struct Any {
    kind: Kind,
    axis: usize,
}

impl<const D: usize> Sensor<D> for Any {
    #[inline(always)]
    fn read<L: Lane>(&self, sight: &Sight<L, D>, parameters: &[L; 2]) -> Reading<L, D> {
        match self.kind {
            Kind::Bearing => Bearing.read(sight, parameters),
            Kind::Elevation => Elevation.read(sight, parameters),
            Kind::Range => Range { factor: 1.0 }.read(sight, parameters),
            Kind::TimeDifference(speed) => {
                let factor = 1.0 / speed;
                Range { factor }.read(sight, parameters)
            }
            Kind::RangeRate => RangeRate.read(sight, parameters),
            Kind::Frequency(speed) | Kind::FrequencyDifference(speed) => {
                Frequency { speed }.read(sight, parameters)
            }
            Kind::ConeAngle => {
                let mut reading = ConeAngle.read(sight, parameters);
                // Along the axis it has no derivative.
                let (low, high) = (1e-8, core::f64::consts::PI - 1e-8);
                let value = reading.value;
                let none = value.splat(f64::NAN);
                let inside = value.select_greater(value.splat(low), value, none);
                reading.value = value.splat(high).select_greater(value, inside, none);
                reading
            }
            Kind::SignalStrength => SignalStrength.read(sight, parameters),
            Kind::Position => Place { axis: self.axis }.read(sight, parameters),
            Kind::Speed => Speed.read(sight, parameters),
            Kind::Course => Course.read(sight, parameters),
        }
    }
}

/// What the passes over some samples of one sensor have in common.
#[derive(Clone, Copy)]
struct Look<'a> {
    channel: &'a Channel,
    /// All states of the scene.
    x: &'a [Block],
    motion_states: usize,
    /// The column of each state, `usize::MAX` where it is known; empty where none is.
    columns: &'a [usize],
    /// States that are estimated.
    free: usize,
    /// Times after the reference time, and the first of the samples.
    times: &'a [f64],
    first: usize,
    count: usize,
    width: usize,
    /// Of these samples: measured, and one over the deviations, 0 where absent.
    measured: &'a [Block],
    weights: Weights<'a>,
    /// Sines and cosines of what is measured, where they are known.
    directions: Option<[&'a [Block]; 2]>,
}

/// One over the deviation of each number.
#[derive(Clone, Copy)]
enum Weights<'a> {
    /// The same in all lanes.
    Shared(&'a [f64]),
    /// Zero where a sample is absent.
    Each(&'a [Block]),
}

impl Look<'_> {
    #[inline(always)]
    fn state<S: pulp::Simd>(&self, simd: S, parameter: Parameter, part: usize) -> Lanes<S> {
        match parameter {
            Parameter::Fixed(value) => Lanes::splat(simd, value),
            Parameter::State(index) => Lanes::load(simd, &self.x[self.motion_states + index], part),
        }
    }

    /// Where the derivative by a parameter goes.
    #[inline(always)]
    fn column(&self, parameter: Parameter) -> Option<usize> {
        match parameter {
            Parameter::Fixed(_) => None,
            Parameter::State(index) => self.place(self.motion_states + index),
        }
    }

    #[inline(always)]
    fn place(&self, state: usize) -> Option<usize> {
        if self.columns.is_empty() {
            return Some(state);
        }
        let column = self.columns[state];
        (column != usize::MAX).then_some(column)
    }

    #[inline(always)]
    fn weight<S: pulp::Simd>(&self, simd: S, row: usize, part: usize) -> Lanes<S> {
        match self.weights {
            Weights::Shared(all) => Lanes::splat(simd, all[row]),
            Weights::Each(all) => Lanes::load(simd, &all[row], part),
        }
    }

    #[inline(always)]
    fn bias<S: pulp::Simd>(&self, simd: S, part: usize) -> Lanes<S> {
        let mut bias = Lanes::splat(simd, 0.0);
        for &(factor, parameter) in &self.channel.bias {
            bias = bias + Lane::times(self.state(simd, parameter, part), factor);
        }
        bias
    }

    /// Writes the derivatives by the sensor's bias.
    #[inline(always)]
    fn by_bias<S: pulp::Simd>(&self, weight: Lanes<S>, row: usize, part: usize, out: &mut [Block]) {
        for &(factor, parameter) in &self.channel.bias {
            if let Some(column) = self.column(parameter) {
                more(
                    Lane::times(weight, factor),
                    &mut out[column * PIECE + row],
                    part,
                );
            }
        }
    }
}

/// Adds to an entry.
#[inline(always)]
fn more<S: pulp::Simd>(x: Lanes<S>, entry: &mut Block, part: usize) {
    (x + x.load_like(entry, part)).store(entry, part);
}

/// Place of a carrier at a sample, less `shift` seconds of its motion; at rest at the
/// origin where there is none. And its velocity and axis.
#[inline(always)]
fn carried<L: Lane, const D: usize>(
    carrier: Option<&Carried>,
    sample: usize,
    shift: Option<L>,
    like: L,
) -> ([L; D], [L; D], [L; D]) {
    let zero = like.splat(0.0);
    let (mut place, mut velocity, mut axis) = ([zero; D], [zero; D], [zero; D]);
    if let Some(carrier) = carrier {
        let from = sample * D;
        for k in 0..D {
            place[k] = like.splat(carrier.place[from + k]);
            velocity[k] = like.splat(carrier.velocity[from + k]);
            axis[k] = like.splat(carrier.axis[from + k]);
        }
        if let Some(shift) = shift {
            for k in 0..D {
                place[k] = shift.negate_mul_add(velocity[k], place[k]);
            }
        }
    }
    (place, velocity, axis)
}

/// Bearings of a motion that is known when this is compiled, in one pass.
struct Bearings<'a, M, const D: usize> {
    look: Look<'a>,
    motion: M,
    out: &'a mut [Block],
}

impl<M: Motion<D>, const D: usize> pulp::WithSimd for Bearings<'_, M, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let look = self.look;
        let out = self.out;
        let states = self.motion.states();
        let zero = Lanes::splat(simd, 0.0);
        let carrier = look.channel.carrier.as_ref();
        let times = &look.times[look.first..][..look.count];
        let mut changes = [Change::zero(zero); 8];
        for part in 0..Lanes::<S>::PARTS {
            let mut x = [zero; 8];
            for k in 0..states {
                x[k] = Lanes::load(simd, &look.x[k], part);
            }
            let gain = Lanes::splat(simd, 1.0) + look.state(simd, look.channel.scale, part);
            let bias = look.bias(simd, part);
            let scale = look.column(look.channel.scale);
            for (row, &u) in times.iter().enumerate() {
                let now = self.motion.at(&x, Lanes::splat(simd, u), &mut changes);
                let mut offset = now.place;
                if let Some(carrier) = carrier {
                    let at = &carrier.place[(look.first + row) * D..][..D];
                    for k in 0..D {
                        offset[k] = offset[k] - Lanes::splat(simd, at[k]);
                    }
                }
                let weight = look.weight(simd, row, part);
                let (mut value, mut slope) = (zero, [zero; D]);
                let left = if let Some([sines, cosines]) = look.directions {
                    let [east, north] = [offset[0], offset[1]];
                    [slope[0], slope[1]] = gradient([east, north], Lanes::splat(simd, 1.0));
                    // Seen from the measured direction, the target is nearly ahead.
                    let sine = Lanes::load(simd, &sines[row], part);
                    let cosine = Lanes::load(simd, &cosines[row], part);
                    let across = Lane::negate_mul_add(cosine, east, sine * north);
                    across.atan2_ahead(Lane::mul_add(cosine, north, sine * east))
                } else {
                    let sight = Sight {
                        offset,
                        target: now.velocity,
                        carrier: offset,
                        axis: offset,
                    };
                    let reading = Bearing.read(&sight, &[zero; 2]);
                    (value, slope) = (reading.value, reading.by_place);
                    let read = Lane::mul_add(value, gain, bias);
                    wrapped(Lanes::load(simd, &look.measured[row], part) - read)
                };
                (left * weight).store(&mut out[look.free * PIECE + row], part);
                let steep = gain * weight;
                for k in 0..D {
                    slope[k] = slope[k] * steep;
                }
                let mut along = [zero; 8];
                for k in 0..states {
                    along[k] = match self.motion.component(k) {
                        Some(axis) => slope[axis] * changes[k].place[axis],
                        None => dot(&slope, &changes[k].place),
                    };
                }
                if look.columns.is_empty() {
                    for k in 0..states {
                        along[k].store(&mut out[k * PIECE + row], part);
                    }
                } else {
                    for k in 0..states {
                        if let Some(column) = look.place(k) {
                            along[k].store(&mut out[column * PIECE + row], part);
                        }
                    }
                }
                if let Some(column) = scale {
                    more(value * weight, &mut out[column * PIECE + row], part);
                }
                look.by_bias(weight, row, part, out);
            }
        }
    }
}

/// Blocks that [`Drive`] writes for a sample: place, velocity, and the changes of both by
/// each state of the motion and by the clock.
const fn driven(dimension: usize, states: usize) -> usize {
    2 * dimension * (states + 2)
}

/// Samples that [`Drive`] and [`See`] take at once.
const SOME: usize = 8;

/// Where the target is at some samples, whatever looks at it.
struct Drive<'a, M, const D: usize> {
    look: Look<'a>,
    motion: &'a M,
    out: &'a mut [Block],
}

impl<M: Motion<D>, const D: usize> pulp::WithSimd for Drive<'_, M, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let look = self.look;
        let channel = look.channel;
        let states = self.motion.states();
        let zero = Lanes::splat(simd, 0.0);
        for part in 0..Lanes::<S>::PARTS {
            let mut x = [zero; MOST];
            for k in 0..states {
                x[k] = Lanes::load(simd, &look.x[k], part);
            }
            let late = look.state(simd, channel.clock, part);
            let shift = channel.true_path.then_some(late);
            let mut changes = [Change::zero(zero); MOST];
            let samples = look.first..look.first + look.count;
            for (sample, out) in samples.zip(self.out.chunks_exact_mut(driven(D, states))) {
                let u = Lanes::splat(simd, look.times[sample]) - late;
                let carrier = channel.carrier.as_ref();
                let (at, velocity, _) = carried::<_, D>(carrier, sample, shift, zero);
                let mut own = [zero; D];
                if channel.true_path {
                    own = velocity;
                }
                let found = emitted(self.motion, &x, u, &at, &own, channel.delay, &mut changes);
                let (now, pace) = (found.instant, found.pace);
                for k in 0..D {
                    changes[states].place[k] = -(pace * now.velocity[k]);
                    changes[states].velocity[k] = -(pace * now.acceleration[k]);
                    now.place[k].store(&mut out[k], part);
                    now.velocity[k].store(&mut out[D + k], part);
                }
                for (change, out) in changes.iter().zip(out[2 * D..].chunks_exact_mut(2 * D)) {
                    for k in 0..D {
                        change.place[k].store(&mut out[k], part);
                        change.velocity[k].store(&mut out[D + k], part);
                    }
                }
            }
        }
    }
}

/// What a sensor sees of that, along one axis.
struct See<'a, const D: usize> {
    look: Look<'a>,
    axis: usize,
    moves: &'a [Block],
    out: &'a mut [Block],
}

impl<const D: usize> pulp::WithSimd for See<'_, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let look = self.look;
        let channel = look.channel;
        let out = self.out;
        let zero = Lanes::splat(simd, 0.0);
        let sensor = Any {
            kind: channel.kind,
            axis: self.axis,
        };
        let (scale, clock) = (look.column(channel.scale), look.column(channel.clock));
        let wraps = channel.kind.wraps();
        for part in 0..Lanes::<S>::PARTS {
            let parameters = [
                look.state(simd, channel.parameters[0], part),
                look.state(simd, channel.parameters[1], part),
            ];
            let gain = Lanes::splat(simd, 1.0) + look.state(simd, channel.scale, part);
            let bias = look.bias(simd, part);
            let late = look.state(simd, channel.clock, part);
            let shift = channel.true_path.then_some(late);
            let size = driven(D, look.motion_states);
            for (i, moves) in self.moves.chunks_exact(size).enumerate().take(look.count) {
                let sample = look.first + i;
                let row = i * look.width + self.axis;
                let (mut place, mut target) = ([zero; D], [zero; D]);
                for k in 0..D {
                    place[k] = Lanes::load(simd, &moves[k], part);
                    target[k] = Lanes::load(simd, &moves[D + k], part);
                }
                let mut found: Option<Reading<Lanes<S>, D>> = None;
                // How the reading changes where the carriers are seen earlier.
                let mut own = zero;
                for which in 0..2 {
                    let carrier = if which == 0 {
                        if channel.second.is_none() {
                            continue;
                        }
                        channel.second.as_ref()
                    } else {
                        channel.carrier.as_ref()
                    };
                    let (at, velocity, axis) = carried::<_, D>(carrier, sample, shift, zero);
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
                    let reading = sensor.read(&sight, &parameters);
                    own = dot(&reading.by_place, &velocity) - own;
                    found = Some(match found {
                        Some(other) => reading.less(&other),
                        None => reading,
                    });
                }
                let Some(reading) = found else { return };
                let weight = look.weight(simd, row, part);
                let value = Lane::mul_add(reading.value, gain, bias);
                let mut left = Lanes::load(simd, &look.measured[row], part) - value;
                if wraps {
                    left = wrapped(left);
                }
                (left * weight).store(&mut out[look.free * PIECE + row], part);
                let steep = gain * weight;
                let columns = moves[2 * D..].chunks_exact(2 * D);
                for (state, change) in columns.enumerate() {
                    let on_clock = state == look.motion_states;
                    let column = if on_clock { clock } else { look.place(state) };
                    let Some(column) = column else { continue };
                    let (mut by_place, mut by_velocity) = ([zero; D], [zero; D]);
                    for k in 0..D {
                        by_place[k] = Lanes::load(simd, &change[k], part);
                        by_velocity[k] = Lanes::load(simd, &change[D + k], part);
                    }
                    let mut along = reading.along(&by_place, &by_velocity);
                    if on_clock && channel.true_path {
                        along = along + own;
                    }
                    more(along * steep, &mut out[column * PIECE + row], part);
                }
                for k in 0..2 {
                    if let Some(column) = look.column(channel.parameters[k]) {
                        let by = reading.by_parameter[k] * steep;
                        more(by, &mut out[column * PIECE + row], part);
                    }
                }
                if let Some(column) = scale {
                    more(reading.value * weight, &mut out[column * PIECE + row], part);
                }
                look.by_bias(weight, row, part, out);
            }
        }
    }
}

/// Whether a sensor reads bearings as they are.
fn direct(channel: &Channel) -> bool {
    channel.kind == Kind::Bearing
        && channel.scale == Parameter::Fixed(0.0)
        && channel.bias.is_empty()
}

/// The trials of a scene as [`SideBySide`] takes them.
pub struct Trials<'a> {
    scene: &'a Scene,
    measurements: Items<'a>,
    /// Means and deviations of all states, infinite where nothing is known.
    mean: &'a [f64],
    sigma: &'a [f64],
    /// The free states, and the column of each; empty where all are free.
    free: Vec<usize>,
    columns: Vec<usize>,
    /// The state of all, known ones at their values.
    x: Vec<Block>,
    measured: Blocks,
    /// Sines and cosines of bearings that are [`direct`].
    directions: [Blocks; 2],
    /// Which numbers are there, and which lanes miss some.
    weights: Blocks,
    gaps: [bool; LANES],
    moves: Vec<Block>,
    values: Vec<f64>,
    rows: Vec<f64>,
}

impl<'a> Trials<'a> {
    /// `known` has the value of each state that is known, NaN elsewhere.
    pub fn new(
        scene: &'a Scene,
        measurements: Items<'a>,
        known: &[f64],
        mean: &'a [f64],
        sigma: &'a [f64],
    ) -> Self {
        let n = scene.states();
        let free: Vec<usize> = (0..n).filter(|&k| known[k].is_nan()).collect();
        let mut columns = Vec::new();
        if free.len() < n {
            columns.resize(n, usize::MAX);
            for (column, &state) in free.iter().enumerate() {
                columns[state] = column;
            }
        }
        let x = known
            .iter()
            .map(|&x| [if x.is_nan() { 0.0 } else { x }; LANES]);
        Self {
            scene,
            measurements,
            mean,
            sigma,
            columns,
            x: x.collect(),
            free,
            measured: Blocks::zeros(scene.measurements),
            directions: [
                Blocks::zeros(scene.measurements),
                Blocks::zeros(scene.measurements),
            ],
            weights: Blocks::zeros(scene.measurements),
            gaps: [false; LANES],
            moves: Vec::new(),
            values: Vec::new(),
            rows: Vec::new(),
        }
    }

    /// The free states.
    pub fn free(&self) -> &[usize] {
        &self.free
    }

    fn look<const D: usize>(
        &mut self,
        group: &Group,
        first: usize,
        count: usize,
        out: &mut [Block],
    ) {
        let scene = self.scene;
        let from = group.first + first * group.width;
        let to = from + count * group.width;
        let weights = match &group.whitener {
            Whitener::Weights(weights) if !self.gaps.contains(&true) => {
                Weights::Shared(&weights[from - group.first..to - group.first])
            }
            _ => Weights::Each(&self.weights[from..to]),
        };
        let channel = &group.channel;
        let plain = channel.kind == Kind::Bearing
            && channel.delay.is_none()
            && channel.clock == Parameter::Fixed(0.0)
            && matches!(
                scene.motion,
                Moving::Polynomial { order: 1 } | Moving::Legs(super::TurnTimes::Unknown(1))
            );
        // Columns that not every sensor has.
        let shared = if plain { scene.motion_states } else { 0 };
        for (column, &state) in out.chunks_mut(PIECE).zip(&self.free) {
            if state >= shared {
                column[..to - from].fill([0.0; LANES]);
            }
        }
        let [sines, cosines] = &self.directions;
        let look = Look {
            directions: direct(channel).then(|| [&sines[from..to], &cosines[from..to]]),
            channel,
            x: &self.x,
            motion_states: scene.motion_states,
            columns: &self.columns,
            free: self.free.len(),
            times: &group.instants,
            first,
            count,
            width: group.width,
            measured: &self.measured[from..to],
            weights,
        };
        match &scene.motion {
            Moving::Polynomial { .. } if plain => {
                let motion = ConstantVelocity;
                return scene.path.run(Bearings::<_, D> { look, motion, out });
            }
            Moving::Legs(_) if plain => {
                let motion = TwoLegs;
                return scene.path.run(Bearings::<_, D> { look, motion, out });
            }
            _ => {}
        }
        let size = driven(D, scene.motion_states);
        self.moves.resize(SOME * size, [0.0; LANES]);
        for start in (0..count).step_by(SOME) {
            let some = SOME.min(count - start);
            let (from, to) = (start * group.width, (start + some) * group.width);
            let look = Look {
                first: first + start,
                count: some,
                measured: &look.measured[from..to],
                weights: match weights {
                    Weights::Shared(all) => Weights::Shared(&all[from..to]),
                    Weights::Each(all) => Weights::Each(&all[from..to]),
                },
                ..look
            };
            with_motion!(&scene.motion, motion => scene.path.run(Drive::<_, D> {
                look,
                motion,
                out: &mut self.moves,
            }));
            for axis in 0..group.width {
                scene.path.run(See::<D> {
                    look,
                    axis,
                    moves: &self.moves,
                    out: &mut out[from..],
                });
            }
        }
    }

    /// A sensor whose noise ties samples together, lane by lane.
    fn tied(&mut self, group: &Group, rows: &mut Rows) {
        let scene = self.scene;
        let (n, wide) = (scene.states(), self.free.len() + 1);
        let count = group.count * group.width;
        let range = group.first..group.first + count;
        let mut all = vec![[0.0; LANES]; count * wide];
        self.values.resize(scene.measurements, 0.0);
        self.rows.resize(scene.measurements * n, 0.0);
        for lane in 0..LANES {
            let x: Vec<f64> = self.x.iter().map(|x| x[lane]).collect();
            self.rows[range.start * n..range.end * n].fill(0.0);
            if scene
                .predict_group(group, &x, &mut self.values, Some(&mut self.rows))
                .is_err()
            {
                for block in &mut all {
                    block[lane] = f64::NAN;
                }
                continue;
            }
            let present: Vec<bool> = self.weights[range.clone()]
                .iter()
                .map(|w| w[lane] > 0.0)
                .collect();
            let values = &mut self.values[range.clone()];
            for (value, z) in values.iter_mut().zip(&self.measured[range.clone()]) {
                *value = z[lane] - *value;
                if group.channel.kind.wraps() {
                    *value = wrapped(*value);
                }
            }
            let lines = &mut self.rows[range.start * n..range.end * n];
            let present = (!present.iter().all(|&p| p)).then_some(&present[..]);
            group.whitener.apply(group.width, values, lines, n, present);
            for i in 0..count {
                for (column, &state) in self.free.iter().enumerate() {
                    all[column * count + i][lane] = lines[i * n + state];
                }
                all[(wide - 1) * count + i][lane] = values[i];
            }
        }
        for first in (0..count).step_by(PIECE) {
            let some = PIECE.min(count - first);
            rows.add(some, true, |out| {
                for column in 0..wide {
                    out[column * PIECE..][..some]
                        .copy_from_slice(&all[column * count + first..][..some]);
                }
            });
        }
    }
}

impl SideBySide for Trials<'_> {
    fn states(&self) -> usize {
        self.free.len()
    }

    fn load(&mut self, lane: usize, problem: usize) {
        let scene = self.scene;
        let z = self.measurements.get(problem);
        self.gaps[lane] = z.iter().any(|z| z.is_nan());
        for (measured, &z) in self.measured.iter_mut().zip(z) {
            measured[lane] = if z.is_nan() { 0.0 } else { z };
        }
        for group in &scene.groups {
            let range = group.first..group.first + group.count * group.width;
            if direct(&group.channel) {
                let [sines, cosines] = &mut self.directions;
                self.values.resize(3 * group.count, 0.0);
                let (angles, out) = self.values.split_at_mut(group.count);
                let (sine, cosine) = out.split_at_mut(group.count);
                for (angle, measured) in angles.iter_mut().zip(&self.measured[range.clone()]) {
                    *angle = measured[lane];
                }
                sin_cos_slice(scene.path, angles, sine, cosine);
                for (to, sine) in sines[range.clone()].iter_mut().zip(sine) {
                    to[lane] = *sine;
                }
                for (to, cosine) in cosines[range.clone()].iter_mut().zip(cosine) {
                    to[lane] = *cosine;
                }
            }
            let (z, weights) = (&z[range.clone()], &mut self.weights[range]);
            for (i, (weight, z)) in weights.iter_mut().zip(z).enumerate() {
                let size = match &group.whitener {
                    Whitener::Weights(weights) => weights[i],
                    _ => 1.0,
                };
                weight[lane] = if z.is_nan() { 0.0 } else { size };
            }
            if let Whitener::Factor { size, .. } = &group.whitener {
                // A block of correlated numbers counts whole or not at all.
                for block in weights.chunks_mut(*size) {
                    if block.iter().any(|w| w[lane] == 0.0) {
                        for w in block {
                            w[lane] = 0.0;
                        }
                    }
                }
            }
        }
    }

    fn kinks(&self, state: usize) -> Vec<f64> {
        let scene = self.scene;
        let turns = match &scene.motion {
            Moving::Legs(turns) | Moving::SteadyLegs(turns) => turns.turns().unknown(),
            _ => 0,
        };
        let motion = scene.motion_states;
        if !(motion - turns..motion).contains(&self.free[state]) {
            return Vec::new();
        }
        // Where the turn meets a sample that is seen when it is emitted.
        let now = |group: &&Group| {
            group.channel.delay.is_none() && group.channel.clock == Parameter::Fixed(0.0)
        };
        let mut times: Vec<f64> = scene
            .groups
            .iter()
            .filter(now)
            .flat_map(|group| group.instants.iter().copied())
            .collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        times
    }

    fn linearize(&mut self, x: &[Block], rows: &mut Rows) {
        let scene = self.scene;
        for (&state, x) in self.free.iter().zip(x) {
            self.x[state] = *x;
        }
        for group in &scene.groups {
            if !matches!(group.whitener, Whitener::Weights(_)) {
                self.tied(group, rows);
                continue;
            }
            let most = PIECE / group.width;
            for first in (0..group.count).step_by(most) {
                let count = most.min(group.count - first);
                rows.add(count * group.width, true, |out| {
                    if scene.dimension == 2 {
                        self.look::<2>(group, first, count, out);
                    } else {
                        self.look::<3>(group, first, count, out);
                    }
                });
            }
        }
        let wide = self.free.len() + 1;
        for (column, &state) in self.free.iter().enumerate() {
            let (mean, sigma) = (self.mean[state], self.sigma[state]);
            if !sigma.is_finite() {
                continue;
            }
            rows.add(1, false, |out| {
                for k in 0..wide {
                    out[k * PIECE] = [0.0; LANES];
                }
                out[column * PIECE] = [1.0 / sigma; LANES];
                out[(wide - 1) * PIECE] = x[column].map(|x| (mean - x) / sigma);
            });
        }
    }
}
