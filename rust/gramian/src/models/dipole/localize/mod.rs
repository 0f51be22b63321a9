//! Locating a passing dipole from the field it makes.
//!
//! [`localize`] finds position, velocity and moment from a recording and what is
//! known beforehand. It starts from the shape of the field (see `starts`), adds
//! turns of it at random, and improves the best by separable least squares (see
//! `separable`). It does not ask whether the answer is unique: that is a
//! question to the rows at the answer.
//!
//! ```
//! use gramian::dipole::localize::{Knowledge, Options, localize};
//! use gramian::dipole::{Pass, Sensors};
//! let pass = Pass::of(&[-10.0, -10.0, 5.0, 1.0, 1.0, 0.0, 10.0, 20.0, 10.0]);
//! let times: Vec<f64> = (0..21).map(f64::from).collect();
//! let mut field = vec![0.0; 63];
//! let sensors = Sensors::vector(&[[0.0; 3]]);
//! sensors.measure(&times, &pass, &mut field).unwrap();
//! // One sensor cannot tell the size; a known height does.
//! let mut known = Knowledge::default();
//! known.exact[2] = Some(5.0);
//! let options = Options { sigma: Some(1e-9), ..Options::default() };
//! let found = localize(&times, &field, &sensors, &known, &options).unwrap();
//! assert!((found.best.state[0] + 10.0).abs() < 1e-6);
//! ```

mod columns;
mod data;
mod knowledge;
mod others;
mod separable;
mod starts;

use alloc::vec;
use alloc::vec::Vec;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use data::Data;
pub(in crate::models::dipole) use data::{huber, robust_sigma};
pub use knowledge::{Contradiction, Knowledge, MOMENT, SPEED};
pub use others::Status;
use separable::{Fitter, Point};
use starts::Shape;

use super::Sensors;
use super::sensors::Head;
use crate::batch::Stream;
use crate::scalar::{NumberError, check_length};
use crate::solve::gauss_newton::{self, minimize};

/// What is done about a constant field in the record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Background {
    /// Nothing: it was removed.
    None,
    /// A constant is fitted to each channel.
    Fit,
}

/// How residuals count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// By their squares.
    Gaussian,
    /// By their squares up to 1.345 sigma, by their size beyond (Huber 1964).
    /// Spikes, single samples far from their neighbours, do not count at all.
    Huber,
}

/// Choices of [`localize`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options<'a> {
    /// What is done about a constant field.
    pub background: Background,
    /// How residuals count.
    pub loss: Loss,
    /// Standard deviation of each number of the field, T; estimated if `None`.
    pub sigma: Option<f64>,
    /// For numbers of different deviations that of each (K, S, components) over `sigma`,
    /// infinite for one that was not measured; empty where all have the same.
    pub levels: &'a [f64],
    /// The instant of the state; the first time if `None`.
    pub origin: Option<f64>,
    /// How many of the most promising starts are followed.
    pub starts: usize,
    /// Most rounds of the improvement of a start.
    pub rounds: u32,
    /// Of the noise of neighbouring samples of a channel, at the usual time between them.
    pub correlation: f64,
    /// Whether other passes that fit as well are looked for, and the answer is judged by them:
    /// for sensors of the total field and gradiometers many times the work.
    pub others: bool,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Self {
            background: Background::None,
            loss: Loss::Gaussian,
            sigma: None,
            levels: &[],
            origin: None,
            starts: 12,
            rounds: 200,
            correlation: 0.0,
            others: false,
        }
    }
}

/// One answer of [`localize`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// (r0, v, m).
    pub state: [f64; 9],
    /// Sum of squared residuals over sigma^2, priors included.
    pub cost: f64,
}

impl From<&Point> for Solution {
    fn from(point: &Point) -> Self {
        Self {
            state: point.state(),
            cost: point.cost,
        }
    }
}

/// The answer of [`localize`].
#[derive(Clone, Debug, PartialEq)]
pub struct Located {
    /// The best.
    pub best: Solution,
    /// The best near the mirror image of it, where knowledge allows one; of other sensors than
    /// of three components and one head, where [`Options::others`] asks for them, the best other
    /// pass that was found.
    pub mirror: Option<Solution>,
    /// Residuals (K, S, components), T.
    pub residuals: Vec<f64>,
    /// Background (S, components), T; of the total field beside the ambient one.
    pub background: Vec<f64>,
    /// Weights (K, S, components) between 0 and 1 that the loss gave; 0 where a number is missing.
    pub weights: Vec<f64>,
    /// What the weights are to be multiplied by, so that the curvature of the weighted squares
    /// is the inverse covariance of the estimate: 1 without a robust loss.
    pub efficiency: f64,
    /// The standard deviation used or estimated, T.
    pub sigma: f64,
    /// Whether the last improvement ended by itself.
    pub converged: bool,
    /// Rounds of the last improvement.
    pub iterations: u32,
    /// What is said of the answer, where it is asked ([`Options::others`]).
    pub status: Status,
}

/// Locates a dipole. `times` increase; `field` is (K, S, components) in tesla, NaN for a number
/// that is missing; positions are in the frame of `sensors`. The total field is searched by its
/// component along the ambient field, in which the moment is linear, and then fitted as it is.
///
/// # Errors
/// [`Error`] for knowledge that contradicts itself, and where no pass explains
/// the field (a field of zeros).
pub fn localize(
    times: &[f64],
    field: &[f64],
    sensors: &Sensors<'_>,
    knowledge: &Knowledge,
    options: &Options<'_>,
) -> Result<Located, Error> {
    knowledge.check().map_err(Error::Contradiction)?;
    check_length("times", times.len(), times.len().max(1))?;
    check_length("field", field.len(), times.len() * sensors.channels())?;
    if !sensors.baselines.is_empty() {
        check_length("baselines", sensors.baselines.len(), sensors.places.len())?;
    }
    if !options.levels.is_empty() {
        check_length("levels", options.levels.len(), field.len())?;
    }
    let data = Data::new(times, field, sensors, options);
    let thin = data.thinned();
    let shapes = data.shapes(options);
    let mut sigma = match options.sigma {
        Some(sigma) => sigma,
        None => data.first_sigma(&shapes),
    };
    let known_place: Option<Vec<f64>> = knowledge.exact[..6].iter().copied().collect();
    if (shapes.is_empty() && known_place.is_none()) || !(sigma > 0.0 && sigma.is_finite()) {
        return Err(Error::NoField);
    }
    let ends = ends(&thin, sigma, &shapes, sensors, knowledge, options)?;
    let mut fitter = Fitter::new(data.record(*sensors, options), knowledge);
    let mut weights = data.counts.clone();
    let mut residuals = vec![0.0; field.len()];
    // With all given, one round; otherwise until sigma and weights settle.
    let rounds = match (options.loss, options.sigma) {
        (Loss::Huber, _) => 30,
        (Loss::Gaussian, None) => 3,
        (Loss::Gaussian, Some(_)) => 1,
    };
    let mut offsets = Vec::new();
    let mut efficiency = 1.0;
    let mut best = ends[0];
    for round in 0..rounds {
        let before = best;
        fitter.set_noise(data.noise(weights.iter().map(|w| (w * efficiency).sqrt() / sigma)));
        best = if sensors.ambient.is_none() {
            let start = fitter.evaluate(&best.place);
            fitter.refine(&start, options.rounds)
        } else {
            let from = if round == 0 {
                &ends[..]
            } else {
                core::slice::from_ref(&before)
            };
            let ends = from
                .iter()
                .map(|end| exactly(&fitter, end, knowledge, options));
            ends.min_by(|a, b| a.cost.total_cmp(&b.cost))
                .unwrap_or(before)
        };
        offsets = fitter.residuals(&best, &mut residuals);
        let moved = (0..6)
            .map(|i| (best.place[i] - before.place[i]).abs() / (1e-300 + best.place[i].abs()))
            .fold(0.0, f64::max);
        if (round > 0 && moved < 1e-9) || round + 1 == rounds {
            break;
        }
        if options.sigma.is_none() {
            let found = data.sigma(&residuals, &offsets, knowledge, options);
            // Exact data have no noise to weigh by.
            sigma = found.max(1e-12 * sigma).max(f64::MIN_POSITIVE);
        }
        if options.loss == Loss::Huber {
            efficiency = data.huber(&residuals, sigma, knowledge, options, &mut weights);
        }
    }
    let mut mirror = mirrored(&mut fitter, &best, sensors, knowledge, options);
    if let Some(other) = &mut mirror
        && other.cost < best.cost * (1.0 - 1e-9)
    {
        core::mem::swap(other, &mut best);
        offsets = fitter.residuals(&best, &mut residuals);
    }
    let mut status = Status::NotLooked;
    if options.others {
        status = others::judge(
            &mut fitter,
            &mut best,
            &mut mirror,
            &ends,
            knowledge,
            options,
        );
        offsets = fitter.residuals(&best, &mut residuals);
    }
    drop(fitter);
    Ok(Located {
        best: Solution::from(&best),
        mirror: mirror.as_ref().map(Solution::from),
        residuals,
        background: offsets,
        weights,
        efficiency,
        sigma,
        converged: best.converged,
        iterations: best.iterations,
        status,
    })
}

/// Where the search on a thinned record ends, best first.
fn ends(
    thin: &Data,
    sigma: f64,
    shapes: &[(usize, Shape)],
    sensors: &Sensors<'_>,
    knowledge: &Knowledge,
    options: &Options<'_>,
) -> Result<Vec<Point>, Error> {
    let noise = || thin.noise(thin.counts.iter().map(|w| w.sqrt() / sigma));
    let mut fitter = Fitter::new(thin.record(*sensors, options), knowledge);
    fitter.set_noise(noise());
    let mut ends = search(&mut fitter, shapes, sensors, knowledge, options)?;
    if sensors.plain() {
        return Ok(ends);
    }
    // The moment of a shape is that at one sensor of three components. Elsewhere a known moment
    // does not tell sizes: they come from passes of any moment.
    if let Some(free) = knowledge.without_moment() {
        let mut other = Fitter::new(thin.record(*sensors, options), &free);
        other.set_noise(noise());
        let found = search(&mut other, shapes, sensors, &free, options)?;
        let images: Vec<Point> = found
            .iter()
            .filter_map(|end| mirrored(&mut other, end, sensors, &free, options))
            .collect();
        for end in found.iter().chain(&images) {
            let start = fitter.evaluate(&end.place);
            ends.push(fitter.refine(&start, options.rounds));
        }
        ends.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    }
    Ok(ends)
}

/// Improves a point by the total field itself, which is not linear in the moment.
fn exactly(
    fitter: &Fitter<'_>,
    point: &Point,
    knowledge: &Knowledge,
    options: &Options<'_>,
) -> Point {
    let (measured, x) = others::modelled(fitter, point, knowledge);
    let step = gauss_newton::Options {
        max_iterations: options.rounds,
        ..gauss_newton::Options::default()
    };
    others::ended(&measured, &minimize(&measured, &x, &[], step))
}

/// Follows the most promising starts and returns the best ends, best first.
fn search(
    fitter: &mut Fitter<'_>,
    shapes: &[(usize, Shape)],
    sensors: &Sensors<'_>,
    knowledge: &Knowledge,
    options: &Options<'_>,
) -> Result<Vec<Point>, Error> {
    let mut starts: Vec<Point> = Vec::new();
    let mut add = |fitter: &mut Fitter<'_>, sensor: &[f64; 3], shape: &Shape| {
        let mut shape = *shape;
        if shape.moment[0].is_nan() {
            let place = core::array::from_fn(|i| match i {
                0..3 => sensor[i] + shape.position[i],
                _ => shape.velocity[i - 3],
            });
            shape.moment = fitter.evaluate(&place).moment;
        }
        let shape = &shape;
        for (size, side) in sizes(shape, sensor, sensors, knowledge) {
            let mut place = [0.0; 6];
            for i in 0..3 {
                place[i] = sensor[i] + side * size * shape.position[i];
                place[3 + i] = side * size * shape.velocity[i];
            }
            knowledge.project(&mut place);
            let point = fitter.evaluate(&place);
            if point.cost.is_finite() {
                starts.push(point);
            }
        }
    };
    for (s, shape) in shapes {
        add(fitter, &sensors.places[*s], shape);
    }
    // The same passes turned at random: where the field says little of the frame.
    // One component tells nothing of it.
    let (first, turns) = if sensors.components() == 3 {
        (4, 1)
    } else {
        (8, 4)
    };
    for (index, (s, shape)) in shapes.iter().enumerate().take(first * sensors.places.len()) {
        let mut random = Stream::new(0, index as u64);
        for _ in 0..turns * options.starts {
            let turn = UnitQuaternion::from_quaternion(Quaternion::new(
                random.normal(),
                random.normal(),
                random.normal(),
                random.normal(),
            ));
            let turned = |x: &[f64; 3]| -> [f64; 3] { (turn * Vector3::from(*x)).into() };
            let other = Shape {
                position: turned(&shape.position),
                velocity: turned(&shape.velocity),
                moment: turned(&shape.moment),
                misfit: shape.misfit,
            };
            add(fitter, &sensors.places[*s], &other);
        }
    }
    if shapes.is_empty() {
        // Only where position and velocity are known, and the moment is left.
        let mut place = [0.0; 6];
        knowledge.project(&mut place);
        starts.push(fitter.evaluate(&place));
    }
    starts.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    // Where the shape of the field does not give the frame in closed form, what costs least at
    // first says less of where it leads.
    let followed = match (sensors.ambient, sensors.baselines) {
        (None, []) => 1,
        (Some(_), [_, ..]) => 30,
        _ => 10,
    };
    starts.truncate(followed * options.starts.max(1));
    let mut ends: Vec<Point> = starts
        .iter()
        .map(|start| fitter.refine(start, options.rounds.min(12)))
        .collect();
    ends.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    // What is linear is not what is measured, of the total field: more ends are worth a look.
    let kept = if sensors.plain() { 3 } else { 8 };
    let mut ends: Vec<Point> = ends
        .iter()
        .take(kept)
        .map(|end| fitter.refine(end, options.rounds.saturating_sub(12)))
        .collect();
    ends.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    if ends.is_empty() {
        Err(Error::NoField)
    } else {
        Ok(ends)
    }
}

/// Sizes (and sides: 1, or -1 for the mirror image) that knowledge suggests for
/// a pass at a closest distance of 1 from `sensor`.
fn sizes(
    shape: &Shape,
    sensor: &[f64; 3],
    sensors: &Sensors<'_>,
    knowledge: &Knowledge,
) -> Vec<(f64, f64)> {
    let known = |i: usize| knowledge.exact[i].or(knowledge.prior[i].map(|(mean, _)| mean));
    let length = |x: &[f64; 3]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    let mut out: Vec<(f64, f64)> = Vec::new();
    let mut push = |size: f64, sides: &[f64]| {
        if size.is_finite() && size > 0.0 {
            for &side in sides {
                let near = |o: &(f64, f64)| o.1 == side && (o.0 / size).ln().abs() < 0.02;
                if !out.iter().any(near) {
                    out.push((size, side));
                }
            }
        }
    };
    for i in 0..6 {
        let (own, from) = if i < 3 {
            (shape.position[i], sensor[i])
        } else {
            (shape.velocity[i - 3], 0.0)
        };
        if let Some(value) = known(i) {
            let size = (value - from) / own;
            push(size.abs(), &[size.signum()]);
        }
    }
    for i in 6..9 {
        if let Some(value) = known(i) {
            push((value / shape.moment[i - 6]).cbrt(), &[1.0, -1.0]);
        }
    }
    if let Some(value) = known(SPEED) {
        push(value / length(&shape.velocity), &[1.0, -1.0]);
    }
    if let Some(value) = known(MOMENT) {
        push((value / length(&shape.moment)).cbrt(), &[1.0, -1.0]);
    }
    let apart = |h: Head<f64>| length(&core::array::from_fn(|i| h.place[i] - sensor[i]));
    let baseline = (0..sensors.places.len())
        .flat_map(|s| sensors.heads(s))
        .map(apart)
        .fold(0.0, f64::max);
    if baseline > 0.0 {
        for k in 0..12 {
            push(
                baseline * 10.0_f64.powf(-1.0 + 0.3 * f64::from(k)),
                &[1.0, -1.0],
            );
        }
    }
    if out.is_empty() {
        // Nothing tells the size: any does, and the rows will say so.
        out.push((1.0, 1.0));
    }
    out
}

/// The best point near the mirror image, `None` where knowledge excludes it or
/// it is no other point.
fn mirrored(
    fitter: &mut Fitter<'_>,
    best: &Point,
    sensors: &Sensors<'_>,
    knowledge: &Knowledge,
    options: &Options<'_>,
) -> Option<Point> {
    let heads = || (0..sensors.places.len()).flat_map(|s| sensors.heads(s));
    let count = heads().count() as f64;
    let mut place = best.place;
    for i in 0..3 {
        let center: f64 = heads().map(|h| h.place[i]).sum::<f64>() / count;
        place[i] = 2.0 * center - place[i];
        place[3 + i] = -place[3 + i];
        if knowledge.exact[i].is_some_and(|x| x != center)
            || knowledge.exact[3 + i].is_some_and(|x| x != 0.0)
        {
            return None;
        }
    }
    knowledge.project(&mut place);
    let start = fitter.evaluate(&place);
    let end = if sensors.ambient.is_none() {
        fitter.refine(&start, options.rounds)
    } else {
        exactly(fitter, &start, knowledge, options)
    };
    let (mut apart, mut size, mut reach) = (0.0_f64, 0.0_f64, 0.0_f64);
    for i in 0..6 {
        apart += (end.place[i] - best.place[i]).powi(2);
        size += best.place[i].powi(2);
        reach += end.place[i].powi(2);
    }
    // Where nothing fits, the search flees to where the field vanishes.
    let near = reach < 1e4 * size;
    (end.cost.is_finite() && apart > 1e-6 * size && near).then_some(end)
}

/// What can be wrong with the input of [`localize`].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// Knowledge that contradicts itself.
    #[error(transparent)]
    Contradiction(Contradiction),
    /// Times or a field of the wrong length.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// A field in which there is nothing to locate.
    #[error("the field is constant: there is no pass in it to locate")]
    NoField,
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::dipole::Pass;

    const TABLE_1: [f64; 9] = [-10.0, -10.0, 5.0, 1.0, 1.0, 0.0, 10.0, 20.0, 10.0];

    fn record(state: &[f64; 9], sensors: &[[f64; 3]]) -> (Vec<f64>, Vec<f64>) {
        let times: Vec<f64> = (0..21).map(f64::from).collect();
        let mut field = vec![0.0; times.len() * 3 * sensors.len()];
        Sensors::vector(sensors)
            .measure(&times, &Pass::of(state), &mut field)
            .unwrap();
        (times, field)
    }

    fn known(pairs: &[(usize, f64)]) -> Knowledge {
        let mut knowledge = Knowledge::default();
        for &(index, value) in pairs {
            knowledge.exact[index] = Some(value);
        }
        knowledge
    }

    #[test]
    fn exact_data_give_the_exact_pass() {
        let sensors = Sensors::vector(&[[0.0; 3]]);
        let (times, field) = record(&TABLE_1, &[[0.0; 3]]);
        for knowledge in [
            known(&[(2, 5.0), (5, 0.0)]),
            known(&[(SPEED, 2.0_f64.sqrt())]),
            known(&[(MOMENT, 600.0_f64.sqrt())]),
            known(&[(2, 5.0), (MOMENT, 600.0_f64.sqrt())]),
        ] {
            let options = Options::default();
            let found = localize(&times, &field, &sensors, &knowledge, &options).unwrap();
            let mirror = found.mirror.map_or(found.best.state, |m| m.state);
            let far = |x: &[f64; 9]| {
                (0..9)
                    .map(|i| (x[i] - TABLE_1[i]).abs())
                    .fold(0.0, f64::max)
            };
            assert!(far(&found.best.state).min(far(&mirror)) < 1e-7);
            assert!(found.converged);
        }
    }

    #[test]
    fn exact_data_of_every_kind_of_sensor_give_the_exact_pass() {
        let places = [[0.0; 3], [4.0, 0.0, 1.0], [0.0, 5.0, 2.0]];
        let baselines = [[0.0, 0.0, 3.0], [2.0, 0.0, 0.0], [0.0, 2.0, 1.0]];
        let times: Vec<f64> = (0..21).map(f64::from).collect();
        // A few times the dipole's own field, and far larger.
        let (near, earth) = (Some([3e-8, -2e-8, 9e-8]), Some([2e-5, 1e-6, 4.5e-5]));
        for (count, gradient, ambient, knowledge) in [
            (1, true, None, known(&[])),
            (2, true, None, known(&[])),
            (1, true, None, known(&[(6, 10.0)])),
            (2, false, near, known(&[])),
            (3, false, near, known(&[])),
            (3, false, earth, known(&[])),
            (3, true, earth, known(&[(5, 0.0)])),
        ] {
            let sensors = Sensors {
                places: &places[..count],
                baselines: &baselines[..if gradient { count } else { 0 }],
                ambient,
            };
            let mut field = vec![0.0; times.len() * sensors.channels()];
            sensors
                .measure(&times, &Pass::of(&TABLE_1), &mut field)
                .unwrap();
            let sigma = Some(1e-15);
            let options = Options {
                sigma,
                ..Options::default()
            };
            let found = localize(&times, &field, &sensors, &knowledge, &options).unwrap();
            let mirror = found.mirror.map_or(found.best.state, |m| m.state);
            let far = |x: &[f64; 9]| {
                let all = (0..9).map(|i| (x[i] - TABLE_1[i]).abs());
                all.fold(0.0, f64::max)
            };
            let off = far(&found.best.state).min(far(&mirror));
            // Digits of the ambient field are lost in the reading.
            let limit = if ambient == earth { 1e-3 } else { 1e-6 };
            assert!(off < limit, "{count} {gradient} {ambient:?} {off}");
        }
    }

    #[test]
    fn the_moment_alone_may_be_unknown_even_from_one_sample() {
        let sensors = Sensors::vector(&[[0.0; 3]]);
        let (times, field) = record(&TABLE_1, &[[0.0; 3]]);
        let place: Vec<(usize, f64)> = (0..6).map(|i| (i, TABLE_1[i])).collect();
        let knowledge = known(&place);
        let options = Options::default();
        let found = localize(&times[..1], &field[..3], &sensors, &knowledge, &options).unwrap();
        for i in 6..9 {
            assert!((found.best.state[i] - TABLE_1[i]).abs() < 1e-9);
        }
    }

    #[test]
    fn errors_say_what_is_wrong() {
        let sensors = Sensors::vector(&[[0.0; 3]]);
        let (times, field) = record(&TABLE_1, &[[0.0; 3]]);
        let options = Options::default();
        let run = |field: &[f64], knowledge: &Knowledge| {
            localize(&times, field, &sensors, knowledge, &options)
        };
        let knowledge = known(&[(3, 2.0), (SPEED, 1.0)]);
        let text = alloc::format!("{}", run(&field, &knowledge).unwrap_err());
        assert!(text.contains("speed = 1 m/s contradicts"), "{text}");
        let knowledge = known(&[(SPEED, 1.0)]);
        assert_eq!(run(&[0.0; 63], &knowledge), Err(Error::NoField));
        let length = Error::Number(NumberError::Length {
            array: "field",
            given: 3,
            wanted: 63,
        });
        assert_eq!(run(&field[..3], &knowledge), Err(length));
    }
}
