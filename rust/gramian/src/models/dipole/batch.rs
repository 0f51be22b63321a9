//! Dipole passes, trial by trial: fields, rows and Fisher information.

use pulp::Simd;

use crate::batch::simd::{Path, lane_sums};
use crate::batch::{Items, Stream, Threads};
use crate::dipole::localize::{self, Knowledge, Located, Options, localize};
use crate::dipole::{Error, MU0_OVER_4PI, Pass, Sensors, field, jacobian};
use crate::numbers::algebra::{advanced, dot};
use crate::rows::RowSink;
use crate::scalar::NumberError;

/// The passes of a batch and how they are measured.
#[derive(Clone, Copy, Debug)]
pub struct Passes<'a> {
    /// Position (3) at the first time, m.
    pub position: Items<'a>,
    /// Velocity (3), m/s.
    pub velocity: Items<'a>,
    /// Moment (3), A m^2.
    pub moment: Items<'a>,
    /// Times, increasing, s.
    pub times: Items<'a>,
    /// One standard deviation for all numbers, one for each sample or one for each number, T.
    pub sigma: Items<'a>,
    /// Places of the sensors (S, 3), m.
    pub sensors: Items<'a>,
    /// What the sensors measure: [`Sensors::baselines`] and [`Sensors::ambient`].
    pub baselines: &'a [[f64; 3]],
    /// See there.
    pub ambient: Option<[f64; 3]>,
    /// The five numbers of a [`quadrupole`](crate::dipole::quadrupole), A m^3, of bodies that have one.
    pub quadrupole: Option<Items<'a>>,
}

impl Passes<'_> {
    /// The same passes counted from trial `first` on.
    #[must_use]
    pub fn skip(self, first: usize) -> Self {
        Self {
            position: self.position.skip(first),
            velocity: self.velocity.skip(first),
            moment: self.moment.skip(first),
            times: self.times.skip(first),
            sigma: self.sigma.skip(first),
            sensors: self.sensors.skip(first),
            quadrupole: self.quadrupole.map(|items| items.skip(first)),
            ..self
        }
    }
}

/// Fields (trials, 3) of dipoles.
///
/// # Errors
/// As [`field`], with the trial.
pub fn dipole_field(
    position: Items<'_>,
    moment: Items<'_>,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    threads.over(out, 3, 10.0, |trial, out| {
        let h = field(&three(position.get(trial)), &three(moment.get(trial)));
        out.copy_from_slice(&h.map_err(|error| (trial, error))?);
        Ok(())
    })
}

/// Derivatives (trials, 2, 3, 3) of fields: by position, then by moment.
///
/// # Errors
/// As [`jacobian`], with the trial.
pub fn dipole_jacobian(
    position: Items<'_>,
    moment: Items<'_>,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    threads.over(out, 18, 20.0, |trial, out| {
        let j = jacobian(&three(position.get(trial)), &three(moment.get(trial)))
            .map_err(|error| (trial, error))?;
        out[..9].copy_from_slice(j.position.as_flattened());
        out[9..].copy_from_slice(j.moment.as_flattened());
        Ok(())
    })
}

impl Passes<'_> {
    /// How many numbers one sample of one sensor has.
    fn components(&self) -> usize {
        let sensors: Sensors<'_> = Sensors {
            places: &[],
            baselines: self.baselines,
            ambient: self.ambient,
        };
        sensors.components()
    }

    fn pass(&self, trial: usize) -> Pass<f64> {
        Pass {
            position: three(self.position.get(trial)),
            velocity: three(self.velocity.get(trial)),
            moment: three(self.moment.get(trial)),
        }
    }

    fn quadrupole(&self, trial: usize) -> Option<&[f64; 5]> {
        self.quadrupole.as_ref()?.get(trial).first_chunk()
    }

    fn sensors(&self, trial: usize) -> Sensors<'_> {
        Sensors {
            places: self.sensors.get(trial).as_chunks::<3>().0,
            baselines: self.baselines,
            ambient: self.ambient,
        }
    }
}

/// What the sensors measure (trials, K, S, components), without noise; `sigma` is
/// not used.
///
/// # Errors
/// As [`Sensors::measure`], with the trial.
pub fn dipole_measure(
    passes: &Passes<'_>,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let samples = passes.times.size() * passes.sensors.size() / 3;
    let size = samples * passes.components();
    threads.over(out, size, 10.0 * samples as f64, |trial, out| {
        let (sensors, times) = (passes.sensors(trial), passes.times.get(trial));
        let (pass, quadrupole) = (passes.pass(trial), passes.quadrupole(trial));
        let measured = sensors.measure_body(times, &pass, quadrupole, out);
        measured.map_err(|error| (trial, error))
    })
}

/// Whitened rows (trials, K * S * components, 9) of (r0, v, m), or (.., 14) with the five numbers
/// of a quadrupole.
///
/// # Errors
/// As [`Sensors::push_rows`], with the trial.
pub fn dipole_rows(
    passes: &Passes<'_>,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let samples = passes.times.size() * passes.sensors.size() / 3;
    let states = if passes.quadrupole.is_some() { 14 } else { 9 };
    let size = states * samples * passes.components();
    threads.over(out, size, 30.0 * samples as f64, |trial, out| {
        let (sensors, times) = (passes.sensors(trial), passes.times.get(trial));
        let (pass, sigma) = (passes.pass(trial), passes.sigma.get(trial));
        let pushed = match passes.quadrupole(trial) {
            None => sensors.push_rows(times, &pass, sigma, &mut writer(out)),
            Some(quadrupole) => {
                let sink = &mut writer(out);
                sensors.push_rows_with_quadrupole(times, &pass, quadrupole, sigma, sink)
            }
        };
        pushed.map_err(|error| (trial, error))
    })
}

/// Writes rows one after the other into a slice.
struct Writer<'a, const N: usize>(core::slice::IterMut<'a, [f64; N]>);

fn writer<const N: usize>(out: &mut [f64]) -> Writer<'_, N> {
    Writer(out.as_chunks_mut().0.iter_mut())
}

impl<const N: usize> RowSink<f64, N> for Writer<'_, N> {
    fn push(&mut self, row: &[f64; N]) -> Result<(), NumberError> {
        if let Some(place) = self.0.next() {
            *place = *row;
        }
        Ok(())
    }
}

/// Fisher information (trials, 9, 9) of (r0, v, m) from three-component sensors of one head;
/// `sigma` is one standard deviation or one for each sample.
///
/// # Errors
/// A dipole on a sensor, with the trial.
///
/// # Algorithm
/// All 42 sums of [`Accumulator`](crate::dipole::Accumulator) are, at constant
/// velocity, polynomials of the time over r^12: seven moments, the sums of
/// t^k / r^12 for k = 0 to 6, make them all. Times are counted from the sample
/// nearest to the sensor, so that the terms of r^2 and of the polynomials do not
/// cancel.
pub fn dipole_fisher(
    passes: &Passes<'_>,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let count = passes.times.size();
    let sensors = passes.sensors.size() / 3;
    let cost = (200.0 + count as f64) * sensors as f64;
    threads.over(out, 81, cost, |trial, out| {
        let times = passes.times.get(trial);
        let sigma = passes.sigma.get(trial);
        let pass = passes.pass(trial);
        let mut sum = [[0.0; 9]; 9];
        for sensor in passes.sensors.get(trial).chunks_exact(3) {
            let start = pass.offset(&three(sensor), 0.0);
            let near =
                Nearest::of(times, &start, &pass.velocity).map_err(|error| (trial, error))?;
            path.run(Added {
                times,
                sigma,
                near: &near,
                moment: &pass.moment,
                sum: &mut sum,
            });
        }
        out.copy_from_slice(sum.as_flattened());
        Ok(())
    })
}

fn three(x: &[f64]) -> [f64; 3] {
    [x[0], x[1], x[2]]
}

/// A pass seen from the sample nearest to the sensor, with the distance there
/// as unit of length.
struct Nearest {
    /// When, counted from the first time, and the same on the clock.
    time: f64,
    clock: f64,
    distance: f64,
    position: [f64; 3],
    velocity: [f64; 3],
    /// r^2 = 1 + linear t + square t^2.
    linear: f64,
    square: f64,
}

impl Nearest {
    fn of(times: &[f64], start: &[f64; 3], velocity: &[f64; 3]) -> Result<Self, Error> {
        let speed = dot(velocity, velocity);
        let closest = if speed > 0.0 {
            times[0] - dot(start, velocity) / speed
        } else {
            times[0]
        };
        let after = times.partition_point(|&t| t < closest).min(times.len() - 1);
        let before = after.saturating_sub(1);
        let index = if closest - times[before] < times[after] - closest {
            before
        } else {
            after
        };
        let time = times[index] - times[0];
        let place = advanced(start, velocity, time);
        let distance = dot(&place, &place).sqrt();
        let inverse = 1.0 / distance;
        // 1 / r^8 stands before the sums.
        if !(inverse > 0.0 && inverse < 1e38) {
            return Err(Error::OnSensor { index });
        }
        let (position, velocity) = (place.map(|x| x * inverse), velocity.map(|x| x * inverse));
        Ok(Self {
            time,
            clock: times[index],
            distance,
            linear: 2.0 * dot(&position, &velocity),
            square: dot(&velocity, &velocity),
            position,
            velocity,
        })
    }

    /// Adds the information that the moments `s` of the samples make.
    #[inline(always)]
    fn add_information(&self, m: &[f64; 3], s: &[f64; 7], out: &mut [[f64; 9]; 9]) {
        let (a, b) = (&self.position, &self.velocity);
        let range = [1.0, self.linear, self.square];
        let along = [dot(a, m), dot(b, m)];
        let size = dot(m, m);
        // Polynomials of time, named for their tensor in the formulas of
        // `Accumulator` times r^12.
        let fourth = multiply::<3, 3, 5>(&range, &range);
        let squared = multiply::<2, 2, 3>(&along, &along);
        let unit = multiply::<3, 3, 5>(&squared, &range);
        let mixed = multiply::<2, 3, 4>(&along, &range).map(|x| -2.0 * x);
        let radial: [f64; 3] = core::array::from_fn(|i| size * range[i] + 5.0 * squared[i]);
        let unit_cross = multiply::<2, 5, 6>(&along, &fourth);
        let sixth = multiply::<3, 5, 7>(&range, &fourth);

        let unit = sums::<5, 3>(&unit, s);
        let mixed = sums::<4, 4>(&mixed, s);
        let radial = sums::<3, 5>(&radial, s);
        let fourth = sums::<5, 3>(&fourth, s);
        let unit_cross = sums::<6, 2>(&unit_cross, s);
        let [sixth] = sums::<7, 1>(&sixth, s);

        let inverse = 1.0 / self.distance;
        let cube = MU0_OVER_4PI * inverse * inverse * inverse;
        let quartic = 3.0 * cube * inverse;
        let (by_position, by_both, by_moment) = (quartic * quartic, quartic * cube, cube * cube);
        let t = self.time;
        for i in 0..3 {
            for j in 0..3 {
                let one = if i == j { 1.0 } else { 0.0 };
                let aa = a[i] * a[j];
                let ab = a[i] * b[j] + b[i] * a[j];
                let bb = b[i] * b[j];
                if j <= i {
                    let am = a[i] * m[j] + m[i] * a[j];
                    let bm = b[i] * m[j] + m[i] * b[j];
                    let mm = m[i] * m[j];
                    let power = |p: usize| {
                        by_position
                            * (unit[p] * one
                                + mixed[p] * am
                                + mixed[p + 1] * bm
                                + radial[p] * aa
                                + radial[p + 1] * ab
                                + radial[p + 2] * bb
                                + fourth[p] * mm)
                    };
                    let powers = [power(0), power(1), power(2)];
                    let first = t * powers[0] + powers[1];
                    let second = t * first + t * powers[1] + powers[2];
                    let moments = by_moment
                        * (3.0 * (fourth[0] * aa + fourth[1] * ab + fourth[2] * bb) + sixth * one);
                    out[i][j] += powers[0];
                    out[3 + i][j] += first;
                    out[3 + i][3 + j] += second;
                    out[6 + i][6 + j] += moments;
                    if j < i {
                        out[j][i] += powers[0];
                        out[3 + j][i] += first;
                        out[3 + j][3 + i] += second;
                        out[6 + j][6 + i] += moments;
                        out[j][3 + i] += first;
                    }
                    out[i][3 + j] += first;
                }
                let am = 2.0 * m[i] * a[j] - a[i] * m[j];
                let bm = 2.0 * m[i] * b[j] - b[i] * m[j];
                let power = |p: usize| {
                    by_both
                        * (fourth[p] * am + fourth[p + 1] * bm - unit_cross[p] * one
                            + 2.0 * (mixed[p] * aa + mixed[p + 1] * ab + mixed[p + 2] * bb))
                };
                let (zeroth, first) = (power(0), t * power(0) + power(1));
                out[i][6 + j] += zeroth;
                out[6 + j][i] += zeroth;
                out[3 + i][6 + j] += first;
                out[6 + j][3 + i] += first;
            }
        }
    }
}

/// The product of two polynomials.
#[inline(always)]
fn multiply<const A: usize, const B: usize, const C: usize>(
    a: &[f64; A],
    b: &[f64; B],
) -> [f64; C] {
    let mut out = [0.0; C];
    for i in 0..A {
        for j in 0..B {
            out[i + j] += a[i] * b[j];
        }
    }
    out
}

/// The sums over all samples of t^p times a polynomial, for p below `P`.
#[inline(always)]
fn sums<const C: usize, const P: usize>(polynomial: &[f64; C], moments: &[f64; 7]) -> [f64; P] {
    core::array::from_fn(|p| (0..C).map(|k| polynomial[k] * moments[p + k]).sum())
}

/// Adds the information of one sensor; all of it on one vector path.
struct Added<'a> {
    times: &'a [f64],
    sigma: &'a [f64],
    near: &'a Nearest,
    moment: &'a [f64; 3],
    sum: &'a mut [[f64; 9]; 9],
}

impl pulp::WithSimd for Added<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let samples = Moments {
            times: self.times,
            sigma: self.sigma,
            near: self.near,
        };
        let moments = samples.with_simd(simd);
        self.near.add_information(self.moment, &moments, self.sum);
    }
}

/// Sums over samples of w t^k / r^12, k = 0..=6, with w = 1 / sigma^2.
struct Moments<'a> {
    times: &'a [f64],
    sigma: &'a [f64],
    near: &'a Nearest,
}

impl Moments<'_> {
    fn one(&self, k: usize, weight: f64) -> [f64; 7] {
        let t = self.times[k] - self.near.clock;
        let q = 1.0 / (1.0 + t * (self.near.linear + t * self.near.square));
        let mut term = weight * q * q * q * (q * q * q);
        core::array::from_fn(|_| {
            let value = term;
            term *= t;
            value
        })
    }
}

impl pulp::WithSimd for Moments<'_> {
    type Output = [f64; 7];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> [f64; 7] {
        let (times, rest) = S::as_simd_f64s(self.times);
        let (sigma, _) = S::as_simd_f64s(self.sigma);
        let common = self.sigma.len() == 1;
        let clock = simd.splat_f64s(self.near.clock);
        let linear = simd.splat_f64s(self.near.linear);
        let square = simd.splat_f64s(self.near.square);
        let one = simd.splat_f64s(1.0);
        let mut sums = [simd.splat_f64s(0.0); 7];
        for (k, &time) in times.iter().enumerate() {
            let t = simd.sub_f64s(time, clock);
            let squared = simd.mul_f64s(t, t);
            let slope = simd.mul_add_e_f64s(t, square, linear);
            let q = simd.div_f64s(one, simd.mul_add_e_f64s(t, slope, one));
            let cube = simd.mul_f64s(simd.mul_f64s(q, q), q);
            let mut w = simd.mul_f64s(cube, cube);
            if !common {
                w = simd.div_f64s(w, simd.mul_f64s(sigma[k], sigma[k]));
            }
            let w2 = simd.mul_f64s(w, squared);
            let w4 = simd.mul_f64s(w2, squared);
            sums[0] = simd.add_f64s(sums[0], w);
            sums[1] = simd.mul_add_e_f64s(w, t, sums[1]);
            sums[2] = simd.add_f64s(sums[2], w2);
            sums[3] = simd.mul_add_e_f64s(w2, t, sums[3]);
            sums[4] = simd.add_f64s(sums[4], w4);
            sums[5] = simd.mul_add_e_f64s(w4, t, sums[5]);
            sums[6] = simd.mul_add_e_f64s(w4, squared, sums[6]);
        }
        let mut out = lane_sums::<S, f64, _>(simd, &sums);
        let first = self.times.len() - rest.len();
        for k in first..self.times.len() {
            let weight = if common {
                1.0
            } else {
                1.0 / (self.sigma[k] * self.sigma[k])
            };
            for (sum, value) in out.iter_mut().zip(self.one(k, weight)) {
                *sum += value;
            }
        }
        if common {
            let weight = 1.0 / (self.sigma[0] * self.sigma[0]);
            out = out.map(|sum| weight * sum);
        }
        out
    }
}

/// How many numbers [`dipole_localize`] writes for a trial of `samples` times and
/// `channels` in all: two states, two costs, sigma, converged (1 or 0), rounds, efficiency, the
/// background, residuals and weights of each number.
pub fn dipole_localized_size(samples: usize, channels: usize) -> usize {
    25 + channels * (1 + 2 * samples)
}

/// Locates dipoles in fields (trials, K, S, components); see [`localize()`]. Where there is
/// no mirror image its state and cost are infinite.
///
/// # Errors
/// As [`localize()`], with the trial.
pub fn dipole_localize(
    times: Items<'_>,
    field: Items<'_>,
    sensors: &Sensors<'_>,
    knowledge: &Knowledge,
    options: &Options<'_>,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, localize::Error)> {
    let size = dipole_localized_size(times.size(), sensors.channels());
    threads.over(out, size, localize_cost(field.size()), |trial, out| {
        let (times, field) = (times.get(trial), field.get(trial));
        let located =
            localize(times, field, sensors, knowledge, options).map_err(|error| (trial, error))?;
        write(&located, out);
        Ok(())
    })
}

/// Nanoseconds that locating in a record of so many numbers takes, roughly.
pub fn localize_cost(numbers: usize) -> f64 {
    1e5 + 2e4 * numbers as f64
}

fn write(located: &Located, out: &mut [f64]) {
    let converged = if located.converged { 1.0 } else { 0.0 };
    let (mirror, cost) = located
        .mirror
        .map_or(([f64::INFINITY; 9], f64::INFINITY), |m| (m.state, m.cost));
    let head = [
        located.best.cost,
        cost,
        located.sigma,
        converged,
        f64::from(located.iterations),
        located.efficiency,
        f64::from(located.status as u8),
    ];
    let parts = [
        &located.best.state[..],
        &mirror,
        &head,
        &located.background,
        &located.residuals,
        &located.weights,
    ];
    for (place, value) in out.iter_mut().zip(parts.into_iter().flatten()) {
        *place = *value;
    }
}

/// Simulated passes of a Monte Carlo run, located as they are made.
#[derive(Clone, Copy, Debug)]
pub struct Simulated<'a> {
    /// Increasing, s.
    pub times: &'a [f64],
    /// The pass.
    pub pass: &'a Pass<f64>,
    /// The sensors.
    pub sensors: Sensors<'a>,
    /// Standard deviation of the noise of each number, T, to be multiplied by its
    /// [`level`](Options::levels).
    pub sigma: f64,
    /// Of the random numbers.
    pub seed: u64,
    /// Number of the first trial.
    pub first: u64,
}

/// Simulates and locates, one trial after the other: (trials, 12) with the state,
/// the cost, whether it converged and the place of the [`Status`](localize::Status). The noise of a trial is the first numbers of
/// its [`Stream`]. Of an answer and its mirror image that fit the same, the one
/// nearer to the truth is given.
///
/// # Errors
/// A dipole on a sensor (as trial 0), otherwise as [`localize()`] with the trial.
pub fn dipole_localize_trials(
    simulated: &Simulated<'_>,
    knowledge: &Knowledge,
    options: &Options<'_>,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, TrialError)> {
    let Simulated {
        times,
        pass,
        sensors,
        sigma,
        ..
    } = *simulated;
    let count = times.len() * sensors.channels();
    let mut exact = alloc::vec![0.0; count];
    let measured = sensors.measure(times, pass, &mut exact);
    measured.map_err(|error| (0, TrialError::Pass(error)))?;
    let truth = pass.state();
    let scratch = || exact.clone();
    threads.over_with(
        out,
        12,
        localize_cost(count),
        scratch,
        |field, trial, out| {
            let mut random = Stream::new(simulated.seed, simulated.first + trial as u64);
            for (i, (y, h)) in field.iter_mut().zip(&exact).enumerate() {
                // What was not measured is infinite here, and missing there.
                let level = options.levels.get(i).copied().unwrap_or(1.0);
                *y = h + sigma * level * random.normal();
            }
            let located = localize(times, field, &sensors, knowledge, options)
                .map_err(|error| (trial, TrialError::Localize(error)))?;
            let far = |state: &[f64; 9]| {
                let squares = state[..6]
                    .iter()
                    .zip(&truth)
                    .map(|(x, y)| (x - y) * (x - y));
                squares.sum::<f64>()
            };
            let chosen = match located.mirror {
                Some(mirror)
                    if mirror.cost <= located.best.cost * (1.0 + 1e-6)
                        && far(&mirror.state) < far(&located.best.state) =>
                {
                    mirror
                }
                _ => located.best,
            };
            out[..9].copy_from_slice(&chosen.state);
            out[9] = chosen.cost;
            out[10] = if located.converged { 1.0 } else { 0.0 };
            out[11] = f64::from(located.status as u8);
            Ok(())
        },
    )
}

/// What can be wrong in [`dipole_localize_trials`].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TrialError {
    /// The pass that was to be simulated.
    #[error(transparent)]
    Pass(Error),
    /// The search.
    #[error(transparent)]
    Localize(localize::Error),
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::cast_possible_truncation)]
mod tests {
    use super::*;
    use crate::batch::Stream;
    use crate::dipole::Accumulator;
    use alloc::vec::Vec;

    /// The sums sample by sample, as the accumulator takes them.
    fn plain(times: &[f64], pass: &Pass<f64>, sensors: &[f64], sigma: &[f64]) -> [[f64; 9]; 9] {
        let mut sums = Accumulator::new();
        for sensor in sensors.chunks_exact(3) {
            for (k, &t) in times.iter().enumerate() {
                let t = t - times[0];
                let s = sigma[if sigma.len() == 1 { 0 } else { k }];
                let place = pass.offset(&three(sensor), t);
                sums.push(t, &place, &pass.moment, 1.0 / (s * s)).unwrap();
            }
        }
        sums.matrix()
    }

    fn far(a: &[[f64; 9]; 9], b: &[f64]) -> f64 {
        let mut far = 0.0_f64;
        for i in 0..9 {
            for j in 0..9 {
                let size = (a[i][i] * a[j][j]).sqrt();
                far = far.max((a[i][j] - b[9 * i + j]).abs() / size);
            }
        }
        far
    }

    #[test]
    fn seven_moments_make_the_42_sums_on_every_path() {
        let mut worst = 0.0_f64;
        for trial in 0..400 {
            let mut random = Stream::new(3, trial);
            let count = 1 + (trial as usize * 7) % 60;
            let duration = 10.0_f64.powf(4.0 * random.uniform() - 1.0);
            let state: [f64; 9] = core::array::from_fn(|i| match i {
                0..3 => 20.0 * random.normal(),
                3..6 => 10.0_f64.powf(3.0 * random.uniform() - 2.0) * random.normal(),
                _ => 50.0 * random.normal(),
            });
            let pass = Pass::of(&state);
            let times: Vec<f64> = (0..count)
                .map(|k| 100.0 + duration * (k as f64 + 0.3 * random.uniform()) / count as f64)
                .collect();
            let sigma: Vec<f64> = if trial % 2 == 0 {
                alloc::vec![1e-9]
            } else {
                (0..count)
                    .map(|_| 1e-9 * (1.0 + random.uniform()))
                    .collect()
            };
            let sensors = [0.0, 0.0, 0.0, 0.5, -0.2, 0.1];
            let wanted = plain(&times, &pass, &sensors, &sigma);
            for path in Path::available() {
                let mut out = [0.0; 81];
                let passes = Passes {
                    position: Items::shared(&state[..3]),
                    velocity: Items::shared(&state[3..6]),
                    moment: Items::shared(&state[6..]),
                    times: Items::shared(&times),
                    sigma: Items::shared(&sigma),
                    sensors: Items::shared(&sensors),
                    baselines: &[],
                    ambient: None,
                    quadrupole: None,
                };
                dipole_fisher(&passes, Threads::One, path, &mut out).unwrap();
                worst = worst.max(far(&wanted, &out));
            }
        }
        assert!(worst < 1e-11, "{worst}");
    }

    #[test]
    fn a_radial_pass_between_samples_is_fine_and_a_sample_on_the_sensor_is_not() {
        let times = [0.0, 1.0, 2.0, 3.0];
        let run = |x: f64| {
            let mut out = [0.0; 81];
            let start = [x, 0.0, 0.0];
            let passes = Passes {
                position: Items::shared(&start),
                velocity: Items::shared(&[1.0, 0.0, 0.0]),
                moment: Items::shared(&[1.0, 2.0, 3.0]),
                times: Items::shared(&times),
                sigma: Items::shared(&[1.0]),
                sensors: Items::shared(&[0.0, 0.0, 0.0]),
                baselines: &[],
                ambient: None,
                quadrupole: None,
            };
            dipole_fisher(&passes, Threads::One, Path::Best, &mut out).map(|()| out)
        };
        let state = [-1.5, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 2.0, 3.0];
        let wanted = plain(&times, &Pass::of(&state), &[0.0; 3], &[1.0]);
        let given = far(&wanted, &run(-1.5).unwrap());
        assert!(given < 1e-13, "{given}");
        assert_eq!(run(-2.0), Err((0, Error::OnSensor { index: 2 })));
    }
}
