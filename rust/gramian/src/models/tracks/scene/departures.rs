//! Ways in which a scene may be wrong, as columns of derivatives by parameters that are zero
//! where it is right: what score tests need.

use alloc::vec;
use alloc::vec::Vec;

use super::kernels::{Clock, moves_size};
use super::predict::Task;
use super::{Error, Group, InSensor, Kind, Measured, Moving, Parameter, Scene};
use crate::batch::lanes::{Block, LANES};

/// A way in which a scene may be wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Departure {
    /// The place departs as this power of time, over its factorial: 1 for a target that was
    /// taken for one at rest and moves, 2 for one that accelerates. One parameter a dimension.
    Order(usize),
    /// The velocity changes at this time, s after the reference. One parameter a dimension.
    Turn(f64),
    /// A sensor's readings are all off by as much.
    Bias(usize),
    /// They are off in proportion.
    Scale(usize),
    /// Its stamps are off by as much, against the target and against its carrier's path.
    Clock(usize),
}

/// A [`Departure`] with its whitened columns (measurements, parameters), row by row.
pub type Column = (Departure, Vec<f64>);

/// What a unit of a departure does to place and velocity, at a time after the reference.
type Course<'a> = &'a dyn Fn(f64) -> (f64, f64);

impl Measured<'_> {
    /// The ways in which this scene may be wrong, at a state of those that are free, with
    /// their columns: the motion of the next order, a turn at each of `turns` (s after the
    /// reference), and of each sensor a bias, a scale and a clock that are no states.
    ///
    /// # Errors
    /// [`InSensor`] where a sensor reads nothing.
    pub fn departures(&self, free: &[f64], turns: &[f64]) -> Result<Vec<Column>, InSensor> {
        let (scene, x) = (&*self.scene, self.full(free));
        let d = scene.dimension;
        let mut found = Vec::new();
        let mut add = |departure, columns: &[f64], width: usize| {
            let mut kept = vec![0.0; self.count * width];
            self.compact(columns, &mut kept, |_| true, width);
            if kept.iter().any(|&value| value != 0.0) {
                found.push((departure, kept));
            }
        };
        let order = match scene.motion {
            Moving::Polynomial { order } => order + 1,
            _ => 2,
        };
        let power = |u: f64| {
            let below = (1..order).fold(1.0, |product, k| product * u / k as f64);
            (below * u / order as f64, below)
        };
        add(Departure::Order(order), &self.departing(&x, &power)?, d);
        for &turn in turns {
            let after = |u: f64| ((u - turn).max(0.0), f64::from(u8::from(u > turn)));
            add(Departure::Turn(turn), &self.departing(&x, &after)?, d);
        }
        self.of_sensors(&x, &mut add)?;
        Ok(found)
    }

    /// The columns of a departure of the motion, one for each dimension.
    fn departing(&self, x: &[f64], course: Course<'_>) -> Result<Vec<f64>, InSensor> {
        let scene = &*self.scene;
        let d = scene.dimension;
        let mut columns = vec![0.0; scene.measurements * d];
        for (sensor, group) in scene.groups.iter().enumerate() {
            let all = group.first..group.first + group.count * group.width;
            let own = &mut columns[all.start * d..all.end * d];
            if d == 2 {
                scene.departing_group::<2>(group, x, course, own)
            } else {
                scene.departing_group::<3>(group, x, course, own)
            }
            .map_err(|error| InSensor { sensor, error })?;
            let present = self.present.as_ref().map(|p| &p[all.clone()]);
            let mut values = vec![0.0; all.len()];
            group
                .whitener
                .apply(group.width, &mut values, own, d, present);
        }
        Ok(columns)
    }

    /// The columns of biases, scales and clocks that are no states: those of a scene in
    /// which they are.
    fn of_sensors(
        &self,
        x: &[f64],
        add: &mut impl FnMut(Departure, &[f64], usize),
    ) -> Result<(), InSensor> {
        let mut wide = (*self.scene).clone();
        let mut x = x.to_vec();
        let first = x.len();
        let mut named = Vec::new();
        let mut state = |departure, value, nuisances: &mut usize| {
            named.push(departure);
            x.push(value);
            *nuisances += 1;
            Parameter::State(*nuisances - 1)
        };
        for (sensor, group) in wide.groups.iter_mut().enumerate() {
            let channel = &mut group.channel;
            let fixed = |(_, p): &(f64, Parameter)| matches!(p, Parameter::Fixed(_));
            if channel.kind != Kind::Position && channel.bias.iter().all(fixed) {
                let added = state(Departure::Bias(sensor), 0.0, &mut wide.nuisances);
                channel.bias.push((1.0, added));
            }
            if let (Parameter::Fixed(value), Kind::Range | Kind::RangeRate | Kind::Speed) =
                (channel.scale, channel.kind)
            {
                channel.scale = state(Departure::Scale(sensor), value, &mut wide.nuisances);
            }
            if let Parameter::Fixed(value) = channel.clock {
                channel.clock = state(Departure::Clock(sensor), value, &mut wide.nuisances);
                // The stamps of a path come from elsewhere, unless the scene says how late both are.
                channel.true_path |= value == 0.0;
            }
        }
        let n = wide.states();
        let mut rows = vec![0.0; wide.measurements * n];
        wide.predict(&x, &mut vec![0.0; wide.measurements], Some(&mut rows))?;
        let mut values = vec![0.0; wide.measurements];
        wide.whiten(&mut values, Some(&mut rows), self.present.as_deref());
        for (k, departure) in named.into_iter().enumerate() {
            let column: Vec<f64> = rows.chunks_exact(n).map(|row| row[first + k]).collect();
            add(departure, &column, 1);
        }
        Ok(())
    }
}

impl Scene {
    /// Derivatives (numbers of the sensor, dimensions) of its readings, not whitened.
    fn departing_group<const D: usize>(
        &self,
        group: &Group,
        x: &[f64],
        course: Course<'_>,
        out: &mut [f64],
    ) -> Result<(), Error> {
        let channel = &group.channel;
        let clock = Clock {
            offset: self.value(x, channel.clock),
            true_path: channel.true_path,
            state: false,
        };
        let (size, narrow) = (moves_size(D, self.motion_states), moves_size(D, D));
        let blocks = group.times.len();
        let mut moves: Vec<Block> = vec![[0.0; LANES]; blocks * size];
        self.moves_in::<D>(group, x, clock, &mut moves);
        let mut departing: Vec<Block> = vec![[0.0; LANES]; blocks * narrow];
        let each = moves
            .chunks_exact(size)
            .zip(departing.chunks_exact_mut(narrow));
        for (block, (moves, departing)) in each.enumerate() {
            departing[..2 * D].copy_from_slice(&moves[..2 * D]);
            for lane in 0..LANES {
                let instant = group.times[block][lane] - clock.offset;
                let (earlier, unit, rate) = delayed::<D>(group, clock, moves, block, lane);
                let (place, velocity) = course(instant - earlier);
                for axis in 0..D {
                    let column = &mut departing[2 * D * (1 + axis)..][..2 * D];
                    // The wave that is received left earlier where the target is farther away;
                    // what it accelerated in that time is of second order.
                    let sooner = unit[axis] * place / rate;
                    for k in 0..D {
                        let own = if k == axis { place } else { 0.0 };
                        column[k][lane] = own - sooner * moves[D + k][lane];
                    }
                    column[D + axis][lane] = velocity;
                }
            }
        }
        let gain = 1.0 + self.value(x, channel.scale);
        let mut reads: Vec<Block> = vec![[0.0; LANES]; blocks * (D + 3)];
        for axis in 0..group.width {
            let task = Task {
                path: self.path,
                group,
                parameters: channel.parameters.map(|p| self.value(x, p)),
                columns: D,
                by_axes: 0,
                clock,
                moves: &departing,
            };
            task.sees::<D>(axis, &mut reads);
            for sample in 0..group.count {
                let reads = &reads[sample / LANES * (D + 3)..][1..=D];
                for (k, read) in reads.iter().enumerate() {
                    let value = gain * read[sample % LANES];
                    if !value.is_finite() {
                        return Err(Error::NoReading {
                            index: sample,
                            reason: channel.kind.reason(),
                        });
                    }
                    out[(sample * group.width + axis) * D + k] = value;
                }
            }
        }
        Ok(())
    }
}

/// How long the wave was under way, its direction, and the rate by which it opens: nothing
/// where it takes no time.
fn delayed<const D: usize>(
    group: &Group,
    clock: Clock,
    moves: &[Block],
    block: usize,
    lane: usize,
) -> (f64, [f64; D], f64) {
    let Some(speed) = group.channel.delay else {
        return (0.0, [0.0; D], 1.0);
    };
    let carrier = &group.carrier[block * 3 * D..][..3 * D];
    let shift = if clock.true_path { clock.offset } else { 0.0 };
    let offset: [f64; D] = core::array::from_fn(|k| {
        moves[k][lane] - (carrier[k][lane] - shift * carrier[D + k][lane])
    });
    let range = offset
        .iter()
        .fold(0.0, |sum, x| crate::scalar::hypot(sum, *x));
    if range == 0.0 {
        return (0.0, [0.0; D], 1.0);
    }
    let unit = offset.map(|x| x / range);
    let opening: f64 = (0..D).map(|k| unit[k] * moves[D + k][lane]).sum();
    (range / speed, unit, speed + opening)
}
