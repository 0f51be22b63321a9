//! Whether another pass fits a record as well as the one that was found.

use alloc::vec;
use alloc::vec::Vec;

use super::separable::{Fitter, Point};
use super::{Knowledge, Options};
use crate::dipole::measured::Measured;
use crate::numbers::algebra::{dot, dot_slices};
use crate::observability::Observability;
use crate::solve::other_solutions::{Found, Search, chance, other_solutions};
use crate::solve::{Model, gauss_newton};

/// What is said of an answer, the first of these that holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Status {
    /// Some combination of the states changes no number of the record.
    Unobservable,
    /// The last improvement did not end by itself.
    NotConverged,
    /// Another pass was found that fits as well: noise prefers the wrong one of the two in more
    /// than one of a hundred records.
    Ambiguous,
    /// The deviation of the closest range is more than a quarter of it.
    Weak,
    /// None of these.
    Determined,
    /// It was not asked.
    #[default]
    NotLooked,
}

/// Chance of the wrong pass from which an answer is ambiguous.
const CHANCE: f64 = 0.01;
/// Of the closest range, the deviation from which an answer is weak.
const WEAK: f64 = 0.25;
/// Beyond so many times the distance between heads differences of the field lose their digits.
const FAR: f64 = 1e3;
/// Rounds that a start is followed with the moment eliminated, and how much larger than that of
/// the answer chi2 may be then, so that it is followed to its end.
const ROUNDS: u32 = 40;
const NEAR: f64 = 40.0;
const FOLLOWED: u32 = 100;
/// Of chi2, 95 % on one side.
const RISE: f64 = 2.71;

/// A pass as a model's state, with the constants of the channels.
pub(super) fn modelled(
    fitter: &Fitter<'_>,
    point: &Point,
    knowledge: &Knowledge,
) -> (Measured, Vec<f64>) {
    let record = fitter.record();
    let state = point.state();
    let measured = Measured::new(
        record.times,
        &record.sensors,
        record.field,
        fitter.noise().clone(),
        record.offsets,
        *knowledge,
        &state,
    );
    let mut left = vec![0.0; record.field.len()];
    let levels = fitter.residuals(point, &mut left);
    let mut x = measured.coordinates(&state);
    let first = x.len() - measured.constants().len();
    for (place, &channel) in x[first..].iter_mut().zip(measured.constants()) {
        *place = levels[channel];
    }
    (measured, x)
}

/// Where steps of a model ended, as a point.
pub(super) fn ended(measured: &Measured, found: &gauss_newton::Solution) -> Point {
    let state = measured.expand(&found.x).0;
    Point {
        place: core::array::from_fn(|i| state[i]),
        moment: core::array::from_fn(|i| state[6 + i]),
        cost: if found.chi2.is_finite() {
            found.chi2
        } else {
            f64::INFINITY
        },
        iterations: found.iterations,
        converged: found.converged,
    }
}

/// Judges the best pass by the others: `mirror` of sensors of three components and one head, and
/// of the rest those that a search finds, the first of which takes its place. A better pass that
/// is met on the way becomes the best.
pub(super) fn judge(
    fitter: &mut Fitter<'_>,
    best: &mut Point,
    mirror: &mut Option<Point>,
    ends: &[Point],
    knowledge: &Knowledge,
    options: &Options<'_>,
) -> Status {
    let (mut measured, mut x) = modelled(fitter, best, knowledge);
    let mut others = Vec::new();
    if fitter.record().sensors.plain() {
        if let Some(mirror) = mirror {
            let mut image = measured.coordinates(&mirror.state());
            let first = image.len() - measured.constants().len();
            image[first..].copy_from_slice(&x[first..]);
            let mut apart = vec![0.0; measured.measurements()];
            if measured.difference(&x, &image, &mut apart).is_ok() {
                others.push(chance(dot_slices(&apart, &apart).sqrt()));
            }
        }
    } else {
        let found = searched(fitter, &measured, &x, ends, options);
        *mirror = found.others.first().map(|o| ended(&measured, &o.solution));
        others.extend(found.others.iter().map(|o| o.chance));
        if found.best.x != x {
            *best = ended(&measured, &found.best);
            (measured, x) = modelled(fitter, best, knowledge);
        }
    }
    let Some(deviation) = range_deviation(fitter, &measured, &x, options) else {
        return Status::Unobservable;
    };
    if !fitter.record().sensors.plain() && too_far(fitter, best, knowledge, options) {
        Status::Unobservable
    } else if !best.converged {
        Status::NotConverged
    } else if others.iter().any(|chance| *chance > CHANCE) {
        Status::Ambiguous
    } else if deviation > WEAK {
        Status::Weak
    } else {
        Status::Determined
    }
}

/// The other passes that fit, of those that `alike` names and where the first search ended.
fn searched(
    fitter: &mut Fitter<'_>,
    measured: &Measured,
    x: &[f64],
    ends: &[Point],
    options: &Options<'_>,
) -> Found {
    let steps = gauss_newton::Options {
        max_iterations: options.rounds.min(FOLLOWED),
        ..gauss_newton::Options::default()
    };
    let start = gauss_newton::minimize(measured, x, &[], steps);
    let mut from = measured.alike(&start.x);
    from.extend(ends.iter().map(|end| measured.coordinates(&end.state())));
    // With the moment eliminated most are soon seen to lead nowhere.
    let first = x.len() - measured.constants().len();
    from.retain_mut(|image| {
        let place = core::array::from_fn(|i| measured.expand(image).0[i]);
        let begun = fitter.evaluate(&place);
        let reached = fitter.refine(&begun, options.rounds.min(ROUNDS));
        let own = measured.coordinates(&reached.state());
        image[..first].copy_from_slice(&own[..first]);
        image[first..].copy_from_slice(&start.x[first..]);
        reached.cost < start.chi2 + NEAR
    });
    let search = Search {
        from,
        weakest: false,
        spread: None,
        starts: 0,
        seed: 0,
        options: steps,
    };
    other_solutions(measured, &start, &search)
}

/// The deviation of the range at the closest point, seen from the first sensor, as a share of
/// it; `None` where the rows have no full rank.
fn range_deviation(
    fitter: &Fitter<'_>,
    measured: &Measured,
    x: &[f64],
    options: &Options<'_>,
) -> Option<f64> {
    let (m, n) = (measured.measurements(), x.len());
    if n == 0 {
        return Some(0.0);
    }
    let there = fitter
        .noise()
        .factors()
        .iter()
        .filter(|f| **f > 0.0)
        .count();
    let level = options.sigma.is_some() || there + measured.priors() > n;
    let (mut residuals, mut rows) = (vec![0.0; m], vec![0.0; m * n]);
    measured
        .linearize(x, &mut residuals, Some(&mut rows))
        .ok()?;
    let seen = Observability::new(&rows, n, None).ok()?;
    if seen.rank() < n {
        return None;
    }
    let (state, columns) = measured.expand(x);
    let (range, by) = measured.closest(&state);
    let along: Vec<f64> = columns
        .iter()
        .map(|column| by.iter().zip(column).map(|(b, c)| b * c).sum())
        .collect();
    // As many numbers as states tell nothing of the noise.
    let unknown = if level { 1.0 } else { f64::INFINITY };
    seen.combination_std(&along)
        .ok()
        .map(|std| unknown * std / range)
}

/// Whether the pass fits as well at any larger size: several heads see it from so far that noise
/// hides the size, and the least squares lie at infinity.
fn too_far(
    fitter: &Fitter<'_>,
    best: &Point,
    knowledge: &Knowledge,
    options: &Options<'_>,
) -> bool {
    let sensors = &fitter.record().sensors;
    let heads: Vec<[f64; 3]> = (0..sensors.places.len())
        .flat_map(|s| sensors.heads(s).map(|head| head.place))
        .collect();
    let mut extent = 0.0_f64;
    for (a, b) in heads.iter().flat_map(|a| heads.iter().map(move |b| (a, b))) {
        let apart: [f64; 3] = core::array::from_fn(|i| a[i] - b[i]);
        extent = extent.max(dot(&apart, &apart).sqrt());
    }
    let (measured, _) = modelled(fitter, best, knowledge);
    let (reach, _) = measured.closest(&best.state());
    if !(extent > 0.0 && reach > FAR * extent) {
        return false;
    }
    // The field falls as the cube of the distance, a difference of it by one power more.
    let power = if sensors.baselines.is_empty() { 3 } else { 4 };
    let at_size = |size: f64| {
        let mut point = *best;
        point.place = point.place.map(|p| size * p);
        point.moment = point.moment.map(|m| size.powi(power) * m);
        let mut held = *knowledge;
        let speed = dot(
            &[3, 4, 5].map(|i| point.place[i]),
            &[3, 4, 5].map(|i| point.place[i]),
        );
        held.exact[super::SPEED] = Some(speed.sqrt());
        let (model, x) = modelled(fitter, &point, &held);
        let steps = gauss_newton::Options {
            max_iterations: options.rounds.min(100),
            ..gauss_newton::Options::default()
        };
        gauss_newton::minimize(&model, &x, &[], steps).chi2
    };
    let at = FAR * extent / reach;
    let (far, farther) = (at_size(at), at_size(10.0 * at));
    far.max(farther) < far.min(farther) + RISE
}

#[cfg(all(test, feature = "std"))]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::batch::Stream;
    use crate::dipole::localize::{Located, SPEED, localize};
    use crate::dipole::{Pass, Sensors};

    const PASS: [f64; 9] = [-10.0, -9.0, 5.0, 1.0, 0.8, 0.1, 10.0, 20.0, -10.0];
    const AMBIENT: [f64; 3] = [2e-5, 1e-6, 4.5e-5];

    fn located(places: &[[f64; 3]], ambient: Option<[f64; 3]>, known: &Knowledge) -> Located {
        let sensors = Sensors {
            places,
            baselines: &[],
            ambient,
        };
        let times: Vec<f64> = (0..21).map(f64::from).collect();
        let mut field = vec![0.0; times.len() * sensors.channels()];
        sensors
            .measure(&times, &Pass::of(&PASS), &mut field)
            .unwrap();
        let mut random = Stream::new(1, 0);
        for y in &mut field {
            *y += 1e-12 * random.normal();
        }
        let options = Options {
            sigma: Some(1e-12),
            others: true,
            ..Options::default()
        };
        localize(&times, &field, &sensors, known, &options).unwrap()
    }

    #[test]
    fn a_pass_reflected_in_the_plane_of_the_sensors_and_the_ambient_field_reads_the_same() {
        let free = Knowledge::default();
        let three = [[0.0; 3], [4.0, 0.0, 1.0], [0.0, 5.0, 2.0]];
        let two = located(&three[..2], Some(AMBIENT), &free);
        assert_eq!(two.status, Status::Ambiguous);
        let image = two.mirror.unwrap();
        assert!((image.cost - two.best.cost).abs() < 1e-6, "{image:?}");
        assert!((image.state[1] - two.best.state[1]).abs() > 1.0);
        let all = located(&three, Some(AMBIENT), &free);
        assert_eq!(all.status, Status::Determined);
    }

    #[test]
    fn one_sensor_of_three_components_is_judged_by_its_mirror_image() {
        let mut known = Knowledge::default();
        let status = |known: &Knowledge| located(&[[0.0; 3]], None, known).status;
        assert_eq!(status(&known), Status::Unobservable);
        known.exact[SPEED] = Some(1.65_f64.sqrt());
        assert_eq!(status(&known), Status::Ambiguous);
        known.prior[3] = Some((1.0, 0.01));
        assert_eq!(status(&known), Status::Determined);
    }
}
