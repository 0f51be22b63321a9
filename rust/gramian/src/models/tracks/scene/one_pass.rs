//! Whitened rows in one pass, for the commonest scenes: a target at constant velocity, and
//! sensors that read one number a sample. [`predict`](super::predict) takes three passes for
//! any scene; the tests compare the two.

use super::kernels::{Clock, carried};
use super::{Group, Kind, Moving, Parameter, Scene};
use crate::batch::lanes::{Block, LANES, Lanes};
use crate::batch::transpose::{Turning, order};
use crate::models::tracks::sensors::{
    Bearing, Elevation, Frequency, Range, RangeRate, Sensor, Sight,
};
use crate::numbers::lane::Lane;

/// States of the sensors at most.
const OTHERS: usize = 2;

/// A column behind those of the motion: a number, and shares of the derivatives by the
/// sensor's two parameters.
#[derive(Clone, Copy, Default)]
struct Other {
    constant: f64,
    by_parameter: [f64; 2],
}

/// The rows of one sensor, of `N` states each: place, velocity, and those of the sensors.
struct OnePass<'a, K, const D: usize, const N: usize> {
    sensor: K,
    x: &'a [f64],
    parameters: [f64; 2],
    clock: Clock,
    gain: f64,
    others: [Other; OTHERS],
    group: &'a Group,
    rows: &'a mut [[f64; N]],
}

impl<K: Sensor<D>, const D: usize, const N: usize> pulp::WithSimd for OnePass<'_, K, D, N> {
    /// Whether every row is finite.
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> bool {
        let Self { group, rows, .. } = self;
        let of = |value| Lanes::splat(simd, value);
        let zero = of(0.0);
        let (mut start, mut pace) = ([zero; D], [zero; D]);
        for k in 0..D {
            (start[k], pace[k]) = (of(self.x[k]), of(self.x[D + k]));
        }
        let parameters = [of(self.parameters[0]), of(self.parameters[1])];
        let mut others = [[zero; 3]; OTHERS];
        for (lanes, other) in others.iter_mut().zip(&self.others) {
            *lanes = [
                of(other.constant),
                of(self.gain * other.by_parameter[0]),
                of(self.gain * other.by_parameter[1]),
            ];
        }
        let (gain, late) = (of(self.gain), of(self.clock.offset));
        let (shift, order) = (self.clock.shift(), order(simd));
        let mut wrong = zero;
        let (whole, last) = rows.as_chunks_mut::<LANES>();
        let mut rest = [[0.0; N]; LANES];
        let mut whole = whole.iter_mut();
        let blocks = group.times.iter().zip(group.carrier.chunks_exact(3 * D));
        for ((times, carrier), weights) in blocks.zip(&group.weights) {
            let rows = whole.next().unwrap_or(&mut rest);
            for part in 0..Lanes::<S>::PARTS {
                let u = Lanes::load(simd, times, part) - late;
                let (place, velocity, axis) = carried::<S, D>(simd, carrier, part, shift);
                let mut sight = Sight {
                    offset: place,
                    target: pace,
                    carrier: velocity,
                    axis,
                };
                for k in 0..D {
                    sight.offset[k] = Lane::mul_add(pace[k], u, start[k]) - place[k];
                }
                let reading = self.sensor.read(&sight, &parameters);
                let weight = Lanes::load(simd, weights, part);
                let steep = gain * weight;
                let mut columns = [zero; N];
                for k in 0..D {
                    columns[k] = reading.by_place[k] * steep;
                    columns[D + k] = columns[k] * u;
                    if K::SEES_VELOCITY {
                        let along = columns[D + k];
                        columns[D + k] = Lane::mul_add(reading.by_velocity[k], steep, along);
                    }
                }
                for state in 2 * D..N {
                    let [constant, first, second] = others[state - 2 * D];
                    let [one, two] = reading.by_parameter;
                    let along = Lane::mul_add(first, one, constant);
                    columns[state] = Lane::mul_add(second, two, along) * weight;
                }
                let mut sum = columns[0];
                for state in 1..N {
                    sum = sum + columns[state];
                }
                if !K::FINITE {
                    sum = sum + reading.value;
                }
                wrong = Lane::mul_add(sum, zero, wrong);
                write(simd, &columns, part, &order, rows);
            }
        }
        let count = last.len();
        last.copy_from_slice(&rest[..count]);
        wrong.sum() == 0.0
    }
}

/// The lanes of some columns to rows that follow each other.
#[inline(always)]
fn write<S: pulp::Simd, const N: usize>(
    simd: S,
    columns: &[Lanes<S>; N],
    part: usize,
    order: &[usize; LANES],
    rows: &mut [[f64; N]; LANES],
) {
    let lanes = S::F64_LANES;
    let mut square = Turning::empty();
    for (i, four) in columns.as_chunks::<4>().0.iter().enumerate() {
        square.take(simd, four);
        for lane in 0..lanes {
            let row = &mut rows[(part * lanes + order[lane]) % LANES];
            row[4 * i..4 * i + 4].copy_from_slice(&square.rows()[lane]);
        }
    }
    for state in N / 4 * 4..N {
        let mut column: Block = [0.0; LANES];
        columns[state].store(&mut column, 0);
        for lane in 0..lanes {
            rows[(part * lanes + lane) % LANES][state] = column[lane];
        }
    }
}

impl Scene {
    /// The whitened rows of a sensor, if it is one of those that take one pass and has a
    /// reading at every sample.
    pub(super) fn rows_in_one_pass(&self, group: &Group, x: &[f64], rows: &mut [f64]) -> bool {
        let channel = &group.channel;
        let is_state = |parameter| matches!(parameter, Parameter::State(_));
        if !matches!(self.motion, Moving::Polynomial { order: 1 })
            || group.weights.is_empty()
            || group.width != 1
            || group.second.is_some()
            || channel.delay.is_some()
            || is_state(channel.clock)
            || is_state(channel.scale)
        {
            return false;
        }
        let n = self.states();
        let rows = &mut rows[group.first * n..][..group.count * n];
        match (self.dimension, n) {
            (2, 4) => self.of_kind::<2, 4>(group, x, rows),
            (2, 5) => self.of_kind::<2, 5>(group, x, rows),
            (2, 6) => self.of_kind::<2, 6>(group, x, rows),
            (3, 6) => self.of_kind::<3, 6>(group, x, rows),
            (3, 7) => self.of_kind::<3, 7>(group, x, rows),
            (3, 8) => self.of_kind::<3, 8>(group, x, rows),
            _ => false,
        }
    }

    fn of_kind<const D: usize, const N: usize>(
        &self,
        group: &Group,
        x: &[f64],
        rows: &mut [f64],
    ) -> bool {
        match group.channel.kind {
            Kind::Bearing => self.of_sensor::<_, D, N>(Bearing, group, x, rows),
            Kind::Elevation => self.of_sensor::<_, D, N>(Elevation, group, x, rows),
            Kind::Range => self.of_sensor::<_, D, N>(Range { factor: 1.0 }, group, x, rows),
            Kind::RangeRate => self.of_sensor::<_, D, N>(RangeRate, group, x, rows),
            Kind::Frequency(speed) => {
                self.of_sensor::<_, D, N>(Frequency { speed }, group, x, rows)
            }
            _ => false,
        }
    }

    fn of_sensor<K: Sensor<D>, const D: usize, const N: usize>(
        &self,
        sensor: K,
        group: &Group,
        x: &[f64],
        rows: &mut [f64],
    ) -> bool {
        let channel = &group.channel;
        let mut others = [Other::default(); OTHERS];
        for &(factor, parameter) in &channel.bias {
            if let Parameter::State(index) = parameter {
                others[index].constant += factor;
            }
        }
        for (k, &parameter) in channel.parameters.iter().enumerate() {
            if let Parameter::State(index) = parameter {
                others[index].by_parameter[k] += 1.0;
            }
        }
        self.path.run(OnePass::<_, D, N> {
            sensor,
            x,
            parameters: channel.parameters.map(|p| self.value(x, p)),
            clock: self.clock(group, x),
            gain: 1.0 + self.value(x, channel.scale),
            others,
            group,
            rows: rows.as_chunks_mut().0,
        })
    }
}
