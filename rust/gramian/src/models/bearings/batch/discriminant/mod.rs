//! Sums and choices over all quadruples of bearings, at the speed of the vector
//! units.

mod kernel;

use alloc::vec;
use alloc::vec::Vec;
use core::convert::Infallible;
use core::ops::Range;

pub(super) use self::kernel::Scratch;
use self::kernel::{Factored, Maximum, Part, Sum, Tables};
use crate::batch::simd::Path;
use crate::batch::{Items, Threads};
use crate::bearings::{self, Form};
use crate::scalar::power_of_two;

/// The widest vector.
const WIDEST: usize = 8;
/// From this much work on one trial is shared among threads, nanoseconds.
pub(super) const SHARED: f64 = 4e5;

/// How a [`discriminant_sum`] is computed; all give the same number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Method {
    /// The sum of squares over all quadruples, O(m^4): the most accurate.
    #[default]
    Direct,
    /// The inner two sums as the norm of a 2 x 2 triangular factor, O(m^3):
    /// still a sum of squares.
    Factored,
    /// An orthogonal reduction of the rows, O(m).
    Qr,
}

/// Sums of `w_i w_j w_k w_l D^2` over all quadruples, one number for each trial:
/// the determinant of each trial's Gram matrix.
///
/// # Errors
/// As [`bearings::check_track`], with the trial.
pub fn discriminant_sum(
    times: Items<'_>,
    bearings: Items<'_>,
    weights: Option<Items<'_>>,
    method: Method,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, bearings::Error)> {
    let m = times.get(0).len();
    let cost = cost(m, method);
    if method == Method::Qr {
        return threads.over(out, 1, cost, |trial, out| {
            let weights = weights.map(|w| w.get(trial));
            out[0] = bearings::discriminant_sum_qr(times.get(trial), bearings.get(trial), weights)
                .map_err(|error| (trial, error))?;
            Ok(())
        });
    }
    let load = |sum: &mut Quadruples, trial: usize| {
        sum.load(
            times.get(trial),
            bearings.get(trial),
            weights.map(|w| w.get(trial)),
        )
        .map_err(|error| (trial, error))
    };
    if cost > SHARED {
        let mut sum = Quadruples::new(m, method, Path::Best);
        let mut parts = vec![0.0; sum.parts()];
        for (trial, out) in out.iter_mut().enumerate() {
            load(&mut sum, trial)?;
            sum.run(0..sum.parts(), threads, &mut parts);
            *out = sum.total(&parts);
        }
        return Ok(());
    }
    let scratch = || {
        let sum = Quadruples::new(m, method, Path::Best);
        let parts = vec![0.0; sum.parts()];
        (sum, parts)
    };
    threads.over_with(out, 1, cost, scratch, |(sum, parts), trial, out| {
        load(sum, trial)?;
        sum.run(0..sum.parts(), Threads::One, parts);
        out[0] = sum.total(parts);
        Ok(())
    })
}

/// D of four bearings, one number for each trial, the instants in any order.
///
/// # Errors
/// As [`bearings::discriminant`], with the trial.
pub fn discriminants(
    times: Items<'_>,
    bearings: Items<'_>,
    form: Form,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, bearings::Error)> {
    threads.over(out, 1, 60.0, |trial, out| {
        let (t, b) = (times.get(trial), bearings.get(trial));
        let four = |x: &[f64]| [x[0], x[1], x[2], x[3]];
        out[0] = bearings::discriminant(&four(t), &four(b), form).map_err(|e| (trial, e))?;
        Ok(())
    })
}

/// Sums of `w_i w_j sin^2(b_j - b_i)` over all pairs, one number for each trial:
/// the determinant for a target that does not move.
///
/// # Errors
/// As [`bearings::check_track`], with the trial.
pub fn fixed_target_sum(
    times: Items<'_>,
    bearings: Items<'_>,
    weights: Option<Items<'_>>,
    method: Method,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, bearings::Error)> {
    let m = times.get(0).len() as f64;
    let cost = match method {
        Method::Direct => 7.0 * m * m,
        Method::Factored | Method::Qr => 40.0 * m,
    };
    threads.over(out, 1, cost, |trial, out| {
        let (times, bearings) = (times.get(trial), bearings.get(trial));
        let weights = weights.map(|w| w.get(trial));
        let sum = match method {
            Method::Direct => bearings::fixed_target_sum(times, bearings, weights),
            Method::Factored | Method::Qr => {
                bearings::fixed_target_sum_qr(times, bearings, weights)
            }
        };
        out[0] = sum.map_err(|error| (trial, error))?;
        Ok(())
    })
}

/// Roughly what one trial of `m` bearings costs, nanoseconds.
pub fn cost(m: usize, method: Method) -> f64 {
    let m = m as f64;
    match method {
        Method::Direct => 0.08 * m.powi(4) / 24.0 + m * m,
        Method::Factored => 0.5 * m.powi(3) / 6.0 + m * m,
        Method::Qr => 40.0 * m,
    }
}

/// The sum over the quadruples of one trial in parts that can be computed
/// apart, in any order and on any thread: part j holds the quadruples whose
/// second instant is j.
#[derive(Clone, Debug)]
pub struct Quadruples {
    m: usize,
    stride: usize,
    method: Method,
    path: Path,
    /// Times over a power of two, the last one repeated to the stride.
    times: Vec<f64>,
    /// Bearings and roots of the weights, the same way.
    bearings: Vec<f64>,
    roots: Vec<f64>,
    /// Three tables of m rows, zero behind the last entry of each. In one piece,
    /// which the allocator keeps for the next call.
    tables: Vec<f64>,
    weights: Vec<f64>,
    unit: f64,
}

impl Quadruples {
    /// Room for a trial of `m` bearings.
    pub fn new(m: usize, method: Method, path: Path) -> Self {
        let stride = m.next_multiple_of(WIDEST) + WIDEST;
        Self {
            m,
            stride,
            method,
            path,
            times: vec![0.0; stride],
            bearings: vec![0.0; stride],
            roots: vec![0.0; stride],
            tables: vec![0.0; 3 * m * stride],
            weights: vec![1.0; m],
            unit: 1.0,
        }
    }

    /// Takes in the bearings of a trial.
    ///
    /// # Errors
    /// As [`bearings::check_track`], with four bearings at least.
    pub fn load(
        &mut self,
        times: &[f64],
        bearings: &[f64],
        weights: Option<&[f64]>,
    ) -> Result<(), bearings::Error> {
        bearings::check_track(times, bearings, weights, 4)?;
        let m = self.m;
        // Exact, and keeps all products far from overflow.
        self.unit = power_of_two(times[m - 1] - times[0]);
        for (scaled, &time) in self.times.iter_mut().zip(times) {
            *scaled = time / self.unit;
        }
        self.bearings[..m].copy_from_slice(bearings);
        match weights {
            Some(weights) => self.weights.copy_from_slice(weights),
            None => self.weights.fill(1.0),
        }
        for (root, weight) in self.roots.iter_mut().zip(&self.weights) {
            *root = weight.sqrt();
        }
        for row in [&mut self.times, &mut self.bearings, &mut self.roots] {
            let last = row[m - 1];
            row[m..].fill(last);
        }
        let (sines, rest) = self.tables.split_at_mut(m * self.stride);
        let (rates, inverse) = rest.split_at_mut(m * self.stride);
        self.path.run(Tables {
            m,
            times: &self.times,
            bearings: &self.bearings,
            roots: &self.roots,
            sines,
            rates,
            inverse,
        });
        Ok(())
    }

    /// Row a of a table.
    #[inline(always)]
    fn row(&self, table: usize, a: usize) -> &[f64] {
        &self.tables[(table * self.m + a) * self.stride..][..self.stride]
    }

    /// `sqrt(w_b) sin(b_b - b_a)` for all b.
    #[inline(always)]
    fn sines(&self, a: usize) -> &[f64] {
        self.row(0, a)
    }

    /// `sin(b_b - b_a) / tau_ab` for all b.
    #[inline(always)]
    fn rates(&self, a: usize) -> &[f64] {
        self.row(1, a)
    }

    /// Its inverse.
    #[inline(always)]
    fn inverse(&self, a: usize) -> &[f64] {
        self.row(2, a)
    }

    /// How many parts the sum has.
    pub fn parts(&self) -> usize {
        self.m
    }

    /// Computes the parts in `range` on as many threads as they are worth.
    pub fn run(&self, range: Range<usize>, threads: Threads, out: &mut [f64]) {
        // The heaviest part, so that tasks come out small and balance.
        let cost = 2.0 * cost(self.m, self.method) / self.m as f64;
        let scratch = || Scratch::new(self.stride);
        let each =
            |scratch: &mut Scratch, part: usize, out: &mut [f64]| -> Result<(), Infallible> {
                out[0] = self.part(range.start + part, scratch);
                Ok(())
            };
        let Ok(()) = threads.over_with(&mut out[..range.len()], 1, cost, scratch, each);
    }

    /// The sum of all parts, always in the same order.
    pub fn total(&self, parts: &[f64]) -> f64 {
        let sum: f64 = parts.iter().sum();
        let square = self.unit * self.unit;
        sum * square * square
    }

    /// The largest D^2 whose second instant is j, and its third instant.
    pub(super) fn largest(&self, j: usize, scratch: &mut Scratch) -> (f64, usize) {
        if j == 0 || j + 2 >= self.m {
            return (-1.0, 0);
        }
        let all = self;
        self.path.run(Maximum(Part { all, j, scratch }))
    }

    /// Space for one part.
    pub(super) fn scratch(&self) -> Scratch {
        Scratch::new(self.stride)
    }

    fn part(&self, j: usize, scratch: &mut Scratch) -> f64 {
        if j == 0 || j + 2 >= self.m {
            return 0.0;
        }
        let kernel = Part {
            all: self,
            j,
            scratch,
        };
        match self.method {
            Method::Direct => self.path.run(Sum(kernel)),
            Method::Factored | Method::Qr => self.path.run(Factored(kernel)),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(super) mod tests {
    use super::*;

    pub(in super::super) fn track(m: usize, turn: f64) -> (Vec<f64>, Vec<f64>) {
        let (mut east, mut north) = (0.0, 0.0);
        let mut bearings = vec![];
        for k in 0..m {
            let time = 20.0 * k as f64;
            bearings.push((3.0 * time - east).atan2(10_000.0 - time - north));
            let heading: f64 = if k < m / 2 { 0.0 } else { turn };
            east += 100.0 * heading.sin();
            north += 100.0 * heading.cos();
        }
        ((0..m).map(|k| 20.0 * k as f64).collect(), bearings)
    }

    pub(in super::super) fn close(given: f64, wanted: f64, tolerance: f64, what: &str) {
        assert!(
            (given - wanted).abs() <= tolerance * wanted.abs(),
            "{what}: {given} not {wanted}"
        );
    }

    #[test]
    fn every_method_and_path_gives_the_plain_sum() {
        for m in [4, 5, 7, 8, 9, 12, 13, 16, 17, 23, 40] {
            let (times, mut bearings) = track(m, 1.2);
            let weights: Vec<f64> = (0..m).map(|i| 0.5 + (i % 3) as f64).collect();
            // Equal bearings take the other way through the kernel.
            bearings[m - 1] = bearings[0];
            for weights in [None, Some(&weights[..])] {
                let wanted = bearings::discriminant_sum(&times, &bearings, weights).unwrap();
                for path in Path::available() {
                    for method in [Method::Direct, Method::Factored] {
                        let mut all = Quadruples::new(m, method, path);
                        all.load(&times, &bearings, weights).unwrap();
                        let mut parts = vec![0.0; all.parts()];
                        all.run(0..m, Threads::One, &mut parts);
                        let what = alloc::format!("m = {m} {path:?} {method:?}");
                        close(all.total(&parts), wanted, 1e-12, &what);
                    }
                }
                let qr = bearings::discriminant_sum_qr(&times, &bearings, weights).unwrap();
                close(qr, wanted, 1e-11, "QR");
            }
        }
    }

    #[test]
    fn the_sum_does_not_depend_on_the_threads() {
        let (times, bearings) = track(150, 0.7);
        let mut all = Quadruples::new(150, Method::Direct, Path::Best);
        all.load(&times, &bearings, None).unwrap();
        let (mut one, mut many) = (vec![0.0; 150], vec![0.0; 150]);
        all.run(0..150, Threads::One, &mut one);
        all.run(0..150, Threads::Auto, &mut many);
        assert_eq!(one, many);
    }
}
