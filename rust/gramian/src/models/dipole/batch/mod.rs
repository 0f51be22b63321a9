//! Dipole passes, trial by trial: fields, rows and Fisher information.

mod fisher;

pub use fisher::dipole_fisher;

use crate::batch::{Items, Stream, Threads};
use crate::dipole::localize::{self, Knowledge, Located, Options, localize};
use crate::dipole::{Error, Pass, Sensors, field, jacobian};
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

fn three(x: &[f64]) -> [f64; 3] {
    [x[0], x[1], x[2]]
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
