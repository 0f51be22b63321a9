//! What the sensors of a scene read at a state, not whitened, and the derivatives.

use alloc::vec::Vec;

use super::kernels::{Clock, Gathers, Moves, Sees, moves_size};
use super::trials::ConstantVelocity;
use super::{Group, InSensor, Kind, Moving, Parameter, Scene};
use crate::batch::lanes::{Block, LANES};
use crate::batch::simd::Path;
use crate::models::tracks::Error;
use crate::models::tracks::motion::{CoordinatedTurn, Legs, Polynomial, SteadyLegs};
use crate::models::tracks::sensors::{
    Bearing, ConeAngle, Course, Elevation, Frequency, Place, Range, RangeRate, Sensor,
    SignalStrength, Speed,
};

/// What the kernels write the whole of.
#[derive(Default)]
struct Scratch {
    moves: Vec<Block>,
    reads: Vec<Block>,
    lines: Vec<Block>,
}

std::thread_local! {
    /// Made once a thread.
    static SCRATCH: core::cell::RefCell<Scratch> = core::cell::RefCell::default();
}

/// At least so many blocks, with anything in them.
fn room(memory: &mut Vec<Block>, size: usize) -> &mut [Block] {
    if memory.len() < size {
        memory.resize(size, [0.0; LANES]);
    }
    &mut memory[..size]
}

/// Whether rows are whitened on the way where they can be: by one number for each sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rows {
    Plain,
    White,
}

impl Scene {
    /// What the sensors read at a state, and the derivatives row by row.
    pub(super) fn predict(
        &self,
        x: &[f64],
        values: &mut [f64],
        rows: Option<&mut [f64]>,
    ) -> Result<(), InSensor> {
        self.predict_as(x, values, rows, Rows::Plain)
    }

    /// The derivatives alone, whitened for the sensors that have [`weights`](Group::weights).
    pub(super) fn predict_white(&self, x: &[f64], rows: &mut [f64]) -> Result<(), InSensor> {
        self.predict_as(x, &mut [], Some(rows), Rows::White)
    }

    fn predict_as(
        &self,
        x: &[f64],
        values: &mut [f64],
        mut rows: Option<&mut [f64]>,
        how: Rows,
    ) -> Result<(), InSensor> {
        SCRATCH.with_borrow_mut(|scratch| {
            let mut before = None;
            for (sensor, group) in self.groups.iter().enumerate() {
                if let (Rows::White, Some(rows)) = (how, rows.as_deref_mut())
                    && self.rows_in_one_pass(group, x, rows)
                {
                    continue;
                }
                if !before.is_some_and(|before| group.moves_as(before)) {
                    self.moves(group, x, scratch);
                }
                before = Some(group);
                self.read(group, x, values, rows.as_deref_mut(), how, scratch)
                    .map_err(|error| InSensor { sensor, error })?;
            }
            Ok(())
        })
    }

    /// The same of one sensor.
    pub(super) fn predict_group(
        &self,
        group: &Group,
        x: &[f64],
        values: &mut [f64],
        rows: Option<&mut [f64]>,
    ) -> Result<(), Error> {
        SCRATCH.with_borrow_mut(|scratch| {
            self.moves(group, x, scratch);
            self.read(group, x, values, rows, Rows::Plain, scratch)
        })
    }

    pub(super) fn clock(&self, group: &Group, x: &[f64]) -> Clock {
        let channel = &group.channel;
        Clock {
            offset: self.value(x, channel.clock),
            true_path: channel.true_path,
            state: matches!(channel.clock, Parameter::State(_)),
        }
    }

    /// Derivatives of the kernels, but for those by the sensor's parameters.
    fn columns(&self, clock: Clock) -> usize {
        self.motion_states + usize::from(clock.state)
    }

    /// Where the target is at the samples of a sensor.
    fn moves(&self, group: &Group, x: &[f64], scratch: &mut Scratch) {
        let clock = self.clock(group, x);
        let size = group.times.len() * moves_size(self.dimension, self.columns(clock));
        let out = room(&mut scratch.moves, size);
        if self.dimension == 2 {
            self.moves_in::<2>(group, x, clock, out);
        } else {
            self.moves_in::<3>(group, x, clock, out);
        }
    }

    pub(super) fn moves_in<const D: usize>(
        &self,
        group: &Group,
        x: &[f64],
        clock: Clock,
        out: &mut [Block],
    ) {
        macro_rules! moves {
            ($motion:expr) => {
                self.path.run(Moves::<_, D> {
                    motion: $motion,
                    x: &x[..self.motion_states],
                    clock,
                    delay: group.channel.delay,
                    times: &group.times,
                    carrier: &group.carrier,
                    out,
                })
            };
        }
        if matches!(self.motion, Moving::Polynomial { order: 1 }) {
            moves!(&ConstantVelocity);
        } else {
            with_motion!(&self.motion, motion => moves!(motion));
        }
    }

    /// What a sensor reads of that.
    fn read(
        &self,
        group: &Group,
        x: &[f64],
        values: &mut [f64],
        mut rows: Option<&mut [f64]>,
        how: Rows,
        scratch: &mut Scratch,
    ) -> Result<(), Error> {
        let clock = self.clock(group, x);
        let columns = self.columns(clock);
        let blocks = group.times.len();
        let task = Task {
            path: self.path,
            group,
            parameters: group.channel.parameters.map(|p| self.value(x, p)),
            columns,
            // With a delay, what moves the target to one side is seen earlier or later.
            by_axes: match group.channel.delay {
                Some(_) => 0,
                None => self.by_axes,
            },
            clock,
            moves: &scratch.moves[..blocks * moves_size(self.dimension, columns)],
        };
        let reads = room(&mut scratch.reads, blocks * (columns + 3));
        let lines = &mut scratch.lines;
        for axis in 0..group.width {
            if self.dimension == 2 {
                task.sees::<2>(axis, reads);
            } else {
                task.sees::<3>(axis, reads);
            }
            self.collect(
                group,
                x,
                axis,
                columns,
                reads,
                values,
                rows.as_deref_mut(),
                how,
                lines,
            )?;
        }
        Ok(())
    }

    /// From blocks of readings to values and rows.
    #[allow(clippy::too_many_arguments)]
    fn collect(
        &self,
        group: &Group,
        x: &[f64],
        axis: usize,
        columns: usize,
        reads: &[Block],
        values: &mut [f64],
        rows: Option<&mut [f64]>,
        how: Rows,
        lines: &mut Vec<Block>,
    ) -> Result<(), Error> {
        let (n, moving) = (self.states(), self.motion_states);
        let channel = &group.channel;
        let bias = channel
            .bias
            .iter()
            .fold(0.0, |sum, &(factor, p)| sum + factor * self.value(x, p));
        let nuisance = |parameter| match parameter {
            Parameter::State(index) => Some(moving + index),
            Parameter::Fixed(_) => None,
        };
        let gain = 1.0 + self.value(x, channel.scale);
        // From a column of the readings to a state behind those of the motion.
        let [first, second] = channel.parameters;
        let others = [
            (channel.clock, columns, gain),
            (first, columns + 1, gain),
            (second, columns + 2, gain),
            (channel.scale, 0, 1.0),
        ]
        .map(|(parameter, column, factor)| Some((nuisance(parameter)?, column, factor)));
        let (lines, weighted) = room(lines, 2 * n).split_at_mut(n);
        lines.fill([0.0; LANES]);
        for &(factor, parameter) in &channel.bias {
            if let Some(state) = nuisance(parameter) {
                for entry in &mut lines[state] {
                    *entry += factor;
                }
            }
        }
        let failed = self.path.run(Gathers {
            reads,
            columns,
            moving,
            gain,
            bias,
            others,
            lines,
            weighted,
            weights: match how {
                Rows::Plain => &[],
                Rows::White => &group.weights,
            },
            cone: channel.kind == Kind::ConeAngle,
            count: group.count,
            width: group.width,
            values: values.get_mut(group.first + axis..).unwrap_or_default(),
            rows: rows.map(|rows| &mut rows[(group.first + axis) * n..]),
        });
        match failed {
            None => Ok(()),
            Some(index) => Err(Error::NoReading {
                index,
                reason: channel.kind.reason(),
            }),
        }
    }
}

/// What the passes over one sensor have in common.
pub(super) struct Task<'a> {
    pub path: Path,
    pub group: &'a Group,
    pub parameters: [f64; 2],
    pub columns: usize,
    pub by_axes: usize,
    pub clock: Clock,
    pub moves: &'a [Block],
}

impl Task<'_> {
    fn run<K: Sensor<D>, const D: usize>(&self, sensor: &K, out: &mut [Block]) {
        self.path.run(Sees::<K, D> {
            sensor,
            parameters: self.parameters,
            columns: self.columns,
            by_axes: self.by_axes,
            clock: self.clock,
            moves: self.moves,
            carrier: &self.group.carrier,
            second: self.group.second.as_deref(),
            out,
        });
    }

    pub fn sees<const D: usize>(&self, axis: usize, out: &mut [Block]) {
        match self.group.channel.kind {
            Kind::Bearing => self.run::<_, D>(&Bearing, out),
            Kind::Elevation => self.run::<_, D>(&Elevation, out),
            Kind::Range => self.run::<_, D>(&Range { factor: 1.0 }, out),
            Kind::TimeDifference(speed) => {
                let factor = 1.0 / speed;
                self.run::<_, D>(&Range { factor }, out);
            }
            Kind::RangeRate => self.run::<_, D>(&RangeRate, out),
            Kind::Frequency(speed) | Kind::FrequencyDifference(speed) => {
                self.run::<_, D>(&Frequency { speed }, out);
            }
            Kind::ConeAngle => self.run::<_, D>(&ConeAngle, out),
            Kind::SignalStrength => self.run::<_, D>(&SignalStrength, out),
            Kind::Position => self.run::<_, D>(&Place { axis }, out),
            Kind::Speed => self.run::<_, D>(&Speed, out),
            Kind::Course => self.run::<_, D>(&Course, out),
        }
    }
}
