//! Scenes: rows against differences of values, noise, symmetries.

#![allow(clippy::unwrap_used)]

use alloc::vec;
use alloc::vec::Vec;

use super::departures::Departure;
use super::*;
use crate::tracks::carrier::Carrier;

fn zigzag(dimension: usize) -> Carrier {
    let times = [0.0, 100.0, 200.0, 300.0];
    let mut path = Vec::new();
    for (i, t) in times.iter().enumerate() {
        path.extend([5.0 * t, if i % 2 == 0 { 0.0 } else { 400.0 }]);
        if dimension == 3 {
            path.push(50.0);
        }
    }
    Carrier::along(dimension, &times, &path, None, None).unwrap()
}

/// Every kind of sensor, all with a bias and a clock that are unknown, and scale, tonal,
/// power and exponent.
fn everything(dimension: usize, motion: Moving, true_path: bool, delay: Option<f64>) -> Scene {
    let carrier = zigzag(dimension);
    let mut far = vec![3000.0, -2000.0];
    far.resize(dimension, 10.0);
    let other = Carrier::fixed(&far, None).unwrap();
    let kinds = [
        Kind::Bearing,
        Kind::Elevation,
        Kind::Range,
        Kind::RangeRate,
        Kind::Frequency(1500.0),
        Kind::TimeDifference(1500.0),
        Kind::FrequencyDifference(1500.0),
        Kind::ConeAngle,
        Kind::SignalStrength,
        Kind::Position,
        Kind::Speed,
        Kind::Course,
    ];
    let mut channels = Vec::new();
    for (k, kind) in kinds.into_iter().enumerate() {
        if kind == Kind::Elevation && dimension == 2 {
            continue;
        }
        let times: Vec<f64> = (0..5 + k)
            .map(|i| 20.0 + 15.0 * i as f64 + k as f64)
            .collect();
        let carried = carrier.at(&times).unwrap();
        let mut channel = Channel::new(kind, times.clone(), Some(carried), 0.01 * (k + 1) as f64);
        if kind.is_difference() {
            channel.second = Some(other.at(&times).unwrap());
        }
        if kind.is_own() {
            channel.carrier = None;
        }
        channel.parameters = match kind {
            Kind::SignalStrength => [Parameter::State(3), Parameter::State(4)],
            _ => [Parameter::State(5), Parameter::Fixed(0.0)],
        };
        channel.bias = vec![(1.0, Parameter::State(0)), (-0.5, Parameter::Fixed(0.01))];
        channel.scale = Parameter::State(1);
        channel.clock = Parameter::State(2);
        channel.true_path = true_path;
        if !kind.is_own() {
            channel.delay = delay;
        }
        channels.push(channel);
    }
    Scene::new(dimension, motion, 10.0, 6, channels).unwrap()
}

fn state(dimension: usize, motion: &Moving) -> Vec<f64> {
    let mut x = vec![4000.0, 6000.0];
    if dimension == 3 {
        x.push(900.0);
    }
    match motion {
        Moving::Polynomial { order } => {
            for k in 1..=*order {
                for axis in 0..dimension {
                    x.push([3.0, -2.0, 0.4][axis] * 0.01_f64.powf(k as f64 - 1.0));
                }
            }
        }
        Moving::Legs(_) => {
            for v in [3.0, -4.0, 5.0] {
                x.extend([v, 2.0]);
                if dimension == 3 {
                    x.push(0.1 * v);
                }
            }
        }
        Moving::SteadyLegs(_) => {
            x.extend([6.0, 0.3, 1.2, -0.5]);
            if dimension == 3 {
                x.push(0.2);
            }
        }
        Moving::CoordinatedTurn => {
            x.extend([6.0, 0.3, 0.004]);
            if dimension == 3 {
                x.push(0.2);
            }
        }
    }
    if matches!(
        motion,
        Moving::Legs(TurnTimes::Unknown(2)) | Moving::SteadyLegs(TurnTimes::Unknown(2))
    ) {
        x.extend([61.23, 97.31]);
    }
    // Bias, scale, clock, power, exponent, tonal.
    x.extend([0.02, 0.01, 0.7, 40.0, 2.2, 300.0]);
    x
}

fn motions() -> Vec<Moving> {
    vec![
        Moving::Polynomial { order: 0 },
        Moving::Polynomial { order: 1 },
        Moving::Polynomial { order: 3 },
        Moving::Legs(TurnTimes::Known(vec![61.23, 97.31])),
        Moving::Legs(TurnTimes::Unknown(2)),
        Moving::SteadyLegs(TurnTimes::Unknown(2)),
        Moving::CoordinatedTurn,
    ]
}

/// Whitened on the way or afterwards: the same bits, on every path.
#[test]
fn rows_are_whitened_on_the_way() {
    for dimension in [2, 3] {
        for motion in motions() {
            for (true_path, delay) in [(false, None), (true, Some(340.0))] {
                let scene = everything(dimension, motion.clone(), true_path, delay);
                let x = state(dimension, &motion);
                if scene.rows(&x).is_err() {
                    continue;
                }
                for path in Path::available() {
                    let scene = scene.clone().on(path);
                    let mut values = vec![0.0; scene.measurements()];
                    let mut wanted = vec![0.0; values.len() * scene.states()];
                    scene.predict(&x, &mut values, Some(&mut wanted)).unwrap();
                    scene.whiten(&mut values, Some(&mut wanted), None);
                    for group in &scene.groups {
                        let p = group.channel.detection[0];
                        let own = group.first..group.first + group.count * group.width;
                        for i in own.filter(|_| p < 1.0) {
                            for entry in &mut wanted[i * x.len()..][..x.len()] {
                                *entry *= p.sqrt();
                            }
                        }
                    }
                    assert_eq!(scene.rows(&x).unwrap(), wanted, "{motion:?} {path:?}");
                }
                let folded = |group: &&Group| !group.weights.is_empty();
                assert!(scene.groups.iter().filter(folded).count() > 5);
            }
        }
    }
}

/// Rows in one pass are those of the general passes to the last digits, whatever the number
/// of samples, and what has no reading is named as there.
#[test]
fn rows_in_one_pass_are_those_of_three() {
    let motion = Moving::Polynomial { order: 1 };
    let kinds = [
        Kind::Bearing,
        Kind::Elevation,
        Kind::Range,
        Kind::RangeRate,
        Kind::Frequency(1500.0),
    ];
    let mut taken = 0;
    for (dimension, count) in [(2, 1), (2, 8), (2, 13), (2, 16), (3, 7), (3, 19)] {
        let times: Vec<f64> = (0..count).map(|i| 7.0 * f64::from(i)).collect();
        let place = [100.0, -50.0, 20.0, 800.0, 300.0, 45.0];
        let [from, to] = [0, 3].map(|k| &place[k..k + dimension]);
        let way = Carrier::along(dimension, &[0.0, 200.0], &[from, to].concat(), None, None);
        let way = way.unwrap();
        let x = [1500.0, 3700.0, 240.0, 3.0, -4.0, 0.5];
        let x = [&x[..dimension], &x[3..3 + dimension], &[0.01, 300.0]].concat();
        for kind in kinds {
            if kind == Kind::Elevation && dimension == 2 {
                continue;
            }
            for others in 0..=2 {
                let mut channel =
                    Channel::new(kind, times.clone(), Some(way.at(&times).unwrap()), 0.3);
                channel.noise =
                    Noise::Sigma((0..count).map(|i| 0.1 + 0.05 * f64::from(i)).collect());
                channel.scale = Parameter::Fixed(0.02);
                channel.clock = Parameter::Fixed(1.5);
                channel.true_path = others == 1;
                if others > 0 {
                    channel.bias = vec![(2.0, Parameter::State(0))];
                }
                channel.parameters[0] = match others {
                    2 => Parameter::State(1),
                    _ => Parameter::Fixed(300.0),
                };
                let scene = Scene::new(dimension, motion.clone(), 0.0, others, vec![channel]);
                let scene = scene.unwrap();
                let x = &x[..2 * dimension + others];
                for path in Path::available() {
                    let scene = scene.clone().on(path);
                    let mut rows = vec![f64::NAN; scene.measurements() * x.len()];
                    if !scene.rows_in_one_pass(&scene.groups[0], x, &mut rows) {
                        continue;
                    }
                    taken += 1;
                    let mut values = vec![0.0; scene.measurements()];
                    let mut wanted = vec![0.0; rows.len()];
                    scene.predict(x, &mut values, Some(&mut wanted)).unwrap();
                    scene.whiten(&mut values, Some(&mut wanted), None);
                    for (k, (found, wanted)) in rows.iter().zip(&wanted).enumerate() {
                        let near = (found - wanted).abs() <= 1e-14 * wanted.abs();
                        assert!(near, "{kind:?} {path:?} {count} {k}: {found} {wanted}");
                    }
                    // On the carrier, and so far away that a square overflows.
                    let at = &scene.groups[0].channel.carrier.as_ref().unwrap().place[..dimension];
                    for place in [at, &[1e200; 3][..dimension]] {
                        let mut x = x.to_vec();
                        x[..dimension].copy_from_slice(place);
                        x[dimension..2 * dimension].fill(0.0);
                        let general = scene.predict(&x, &mut values, Some(&mut rows));
                        assert_eq!(scene.rows(&x).err(), general.err(), "{kind:?} {place:?}");
                    }
                }
            }
        }
    }
    assert_eq!(taken, Path::available().count() * (4 * 4 + 2 * 5) * 3);
}

#[test]
fn rows_are_derivatives_of_values() {
    for dimension in [2, 3] {
        for motion in motions() {
            for (true_path, delay) in [
                (false, None),
                (true, None),
                (true, Some(1500.0)),
                (false, Some(340.0)),
            ] {
                // At rest speed and course have no derivative.
                if motion == (Moving::Polynomial { order: 0 }) {
                    continue;
                }
                let scene = everything(dimension, motion.clone(), true_path, delay);
                let x = state(dimension, &motion);
                let n = scene.states();
                assert_eq!(x.len(), n);
                let mut rows = vec![0.0; n * scene.measurements()];
                let mut values = vec![0.0; scene.measurements()];
                scene.predict(&x, &mut values, Some(&mut rows)).unwrap();
                let mut kinks = 0;
                let unknown = matches!(
                    motion,
                    Moving::Legs(TurnTimes::Unknown(2)) | Moving::SteadyLegs(TurnTimes::Unknown(2))
                );
                let motion_states = scene.motion_states();
                for k in 0..n {
                    let turn = unknown && (motion_states - 2..motion_states).contains(&k);
                    let h = 1e-3
                        * if k < dimension {
                            100.0
                        } else {
                            x[k].abs().max(1e-2)
                        };
                    let at = |step: f64| {
                        let mut moved = x.clone();
                        moved[k] += step;
                        scene.values(&moved).unwrap()
                    };
                    // Fourth order differences.
                    let (a, b, c, d) = (at(-2.0 * h), at(-h), at(h), at(2.0 * h));
                    let top =
                        (0..values.len()).fold(0.0_f64, |top, i| top.max(rows[i * n + k].abs()));
                    for i in 0..values.len() {
                        let wanted = (a[i] - 8.0 * b[i] + 8.0 * c[i] - d[i]) / (12.0 * h);
                        // A sample at a turn has a kink there.
                        let (left, right) = ((b[i] - a[i]) / h, (d[i] - c[i]) / h);
                        let size = left.abs().max(right.abs());
                        if turn && (left - right).abs() > 1e-2 * size {
                            kinks += 1;
                            continue;
                        }
                        let rounding = 1e-12 * values[i].abs().max(1e-3) / h;
                        let error = (rows[i * n + k] - wanted).abs();
                        assert!(
                            error < 1e-7 * wanted.abs() + 1e-8 * top + rounding,
                            "{motion:?} {dimension} state {k} row {i}: {} not {wanted}",
                            rows[i * n + k]
                        );
                    }
                }
                assert!(kinks * 50 < rows.len(), "{kinks}");
            }
        }
    }
}

#[test]
fn every_path_agrees() {
    let motion = Moving::Legs(TurnTimes::Unknown(2));
    let x = state(3, &motion);
    let scene = everything(3, motion, true, Some(1500.0));
    let plain = scene.clone().on(Path::Plain).rows(&x).unwrap();
    for path in Path::available() {
        let rows = scene.clone().on(path).rows(&x).unwrap();
        for (a, b) in rows.iter().zip(&plain) {
            assert!(
                (a - b).abs() <= 1e-11 * (1.0 + b.abs()),
                "{path:?}: {a} {b}"
            );
        }
    }
}

/// Whitening by a full covariance, by its kind, and by the inverse say the same.
#[test]
fn correlated_noise() {
    let times: Vec<f64> = vec![0.0, 10.0, 25.0, 27.0];
    let coast = Carrier::fixed(&[0.0, 0.0], None)
        .unwrap()
        .at(&times)
        .unwrap();
    let (sigma, time) = (0.02, 30.0);
    let m = times.len();
    let mut matrix = vec![0.0; m * m];
    for i in 0..m {
        for j in 0..m {
            matrix[i * m + j] = sigma * sigma * (-(times[i] - times[j]).abs() / time).exp();
        }
    }
    let x = [2000.0, 5000.0, 3.0, -1.0];
    let scene = |noise: Noise, keep: &[usize]| {
        let pick: Vec<f64> = keep.iter().map(|&i| times[i]).collect();
        let mut channel = Channel::new(
            Kind::Bearing,
            pick.clone(),
            Some(
                Carrier::fixed(&[0.0, 0.0], None)
                    .unwrap()
                    .at(&pick)
                    .unwrap(),
            ),
            1.0,
        );
        channel.noise = noise;
        Scene::new(2, Moving::Polynomial { order: 1 }, 0.0, 0, vec![channel]).unwrap()
    };
    let gram = |rows: &[f64]| {
        let mut out = [0.0; 16];
        for row in rows.chunks_exact(4) {
            for i in 0..4 {
                for j in 0..4 {
                    out[4 * i + j] += row[i] * row[j];
                }
            }
        }
        out
    };
    let all = [0, 1, 2, 3];
    let markov = Noise::Correlated {
        sigma: vec![sigma],
        time,
    };
    let full = scene(
        Noise::Covariance {
            size: m,
            matrix: matrix.clone(),
        },
        &all,
    );
    let a = gram(&full.rows(&x).unwrap());
    let b = gram(&scene(markov.clone(), &all).rows(&x).unwrap());
    for (a, b) in a.iter().zip(&b) {
        assert!((a - b).abs() < 1e-9 * a.abs().max(1e-12), "{a} {b}");
    }
    // A missing sample leaves what the others would give alone.
    let scene_all = scene(markov.clone(), &all);
    let mut z = scene_all.values(&x).unwrap();
    z[1] = f64::NAN;
    let measured = Measured::new(&scene_all, &z, &[]).unwrap();
    let (mut e, mut rows) = (vec![0.0; 3], vec![0.0; 12]);
    assert_eq!(measured.measurements(), 3);
    measured.linearize(&x, &mut e, Some(&mut rows)).unwrap();
    let wanted = scene(markov, &[0, 2, 3]).rows(&x).unwrap();
    for (a, b) in rows.iter().zip(&wanted) {
        assert!((a - b).abs() < 1e-9 * b.abs().max(1e-9), "{a} {b}");
    }
    drop(coast);
    // Simulated noise has the covariance that was stated.
    let exact = full.values(&x).unwrap();
    let mut sum = vec![0.0; m * m];
    let trials = 4000;
    let mut out = vec![0.0; m];
    for trial in 0..trials {
        full.simulate(&exact, 3, trial, &mut out);
        for i in 0..m {
            for j in 0..m {
                sum[i * m + j] += (out[i] - exact[i]) * (out[j] - exact[j]) / trials as f64;
            }
        }
    }
    for (given, wanted) in sum.iter().zip(&matrix) {
        assert!((given - wanted).abs() < 0.1 * sigma * sigma);
    }
}

/// J^T J, column-major alike, and the squares of the residuals, of one trial by itself.
fn alone(scene: &Scene, z: &[f64], x: &[f64], known: &[Option<f64>]) -> (Vec<f64>, f64, Vec<f64>) {
    let measured = Measured::new(scene, z, known).unwrap();
    let (m, n) = (measured.measurements(), measured.states());
    let (mut residuals, mut rows) = (vec![0.0; m], vec![0.0; m * n]);
    let free: Vec<f64> = (0..x.len())
        .filter(|&k| known[k].is_none())
        .map(|k| x[k])
        .collect();
    measured
        .linearize(&free, &mut residuals, Some(&mut rows))
        .unwrap();
    let (mut gram, mut slope) = (vec![0.0; n * n], vec![0.0; n]);
    for (row, r) in rows.chunks_exact(n).zip(&residuals) {
        for i in 0..n {
            slope[i] += row[i] * r;
            for j in 0..n {
                gram[i * n + j] += row[i] * row[j];
            }
        }
    }
    (gram, residuals.iter().map(|r| r * r).sum(), slope)
}

/// A lane has the rows that [`Measured`] has: every motion and sensor, missing samples,
/// known states, noise that ties samples, on every path.
#[test]
fn trials_side_by_side_see_what_one_sees() {
    use crate::solve::side_by_side::minimize_all;
    for dimension in [2, 3] {
        for motion in motions() {
            if motion == (Moving::Polynomial { order: 0 }) {
                continue;
            }
            for (true_path, delay) in [(false, None), (true, Some(1500.0))] {
                let mut scene = everything(dimension, motion.clone(), true_path, delay);
                let mut channels: Vec<Channel> = scene.channels().map(|c| c.0.clone()).collect();
                if let Noise::Sigma(sigma) = &channels[2].noise {
                    let (sigma, time) = (sigma.clone(), 20.0);
                    channels[2].noise = Noise::Correlated { sigma, time };
                }
                // Bearings without a clock, which have a pass of their own.
                let mut plain = channels[0].clone();
                (plain.clock, plain.delay) = (Parameter::Fixed(0.0), None);
                channels.push(plain);
                scene = Scene::new(dimension, motion.clone(), 10.0, 6, channels).unwrap();
                let x = state(dimension, &motion);
                let (n, m) = (scene.states(), scene.measurements());
                let exact = scene.values(&x).unwrap();
                let mut z = Vec::new();
                let mut starts = Vec::new();
                for trial in 0..5 {
                    let mut out = vec![0.0; m];
                    scene.simulate(&exact, 1, trial, &mut out);
                    if trial == 3 {
                        for i in (0..m).step_by(4) {
                            out[i] = f64::NAN;
                        }
                    }
                    z.extend(out);
                    starts.push(x.iter().map(|x| x * (1.0 + 1e-3 * trial as f64)).collect());
                }
                for known in [None, Some(n - 5)] {
                    let mut given = vec![f64::NAN; n];
                    let mut held = vec![None; n];
                    if let Some(k) = known {
                        (given[k], held[k]) = (x[k], Some(x[k]));
                    }
                    let (mean, sigma) = (vec![0.0; n], vec![f64::INFINITY; n]);
                    for path in Path::available() {
                        let scene = scene.clone().on(path);
                        let items = crate::batch::Items::each(&z, m);
                        let mut all = trials::Trials::new(&scene, items, &given, &mean, &sigma);
                        let free = all.free().to_vec();
                        let some: Vec<Vec<f64>> = starts
                            .iter()
                            .map(|x: &Vec<f64>| free.iter().map(|&k| x[k]).collect())
                            .collect();
                        let jobs: Vec<(usize, &[f64])> =
                            some.iter().enumerate().map(|(i, x)| (i, &x[..])).collect();
                        let options = crate::solve::Options {
                            max_iterations: 0,
                            ..crate::solve::Options::default()
                        };
                        let found = minimize_all(&mut all, &jobs, options, path);
                        for (trial, found) in found.iter().enumerate() {
                            let z = &z[trial * m..][..m];
                            let mut whole = starts[trial].clone();
                            if let Some(k) = known {
                                whole[k] = x[k];
                            }
                            let (gram, chi2, _) = alone(&scene, z, &whole, &held);
                            let n = free.len();
                            assert!(
                                (found.chi2 - chi2).abs() < 1e-8 * chi2,
                                "{motion:?} {dimension} {trial}: {} {chi2}",
                                found.chi2
                            );
                            for i in 0..n {
                                for j in 0..n {
                                    let sum: f64 = (0..n)
                                        .map(|k| found.factor[k * n + i] * found.factor[k * n + j])
                                        .sum();
                                    let size = (gram[i * n + i] * gram[j * n + j]).sqrt();
                                    assert!(
                                        (sum - gram[i * n + j]).abs() <= 1e-9 * size,
                                        "{motion:?} {dimension} {trial} {i} {j}: {sum} {}",
                                        gram[i * n + j]
                                    );
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Estimates are at rest, and do not depend on the company they are made in.
#[test]
fn a_lane_does_not_depend_on_the_others() {
    use crate::solve::side_by_side::minimize_all;
    let times: Vec<f64> = (0..40).map(|i| 7.5 * f64::from(i)).collect();
    let seen = zigzag(2).at(&times).unwrap();
    for motion in [
        Moving::Polynomial { order: 1 },
        Moving::Legs(TurnTimes::Unknown(1)),
        Moving::CoordinatedTurn,
    ] {
        let bearings = Channel::new(Kind::Bearing, times.clone(), Some(seen.clone()), 0.003);
        let range = Channel::new(Kind::Range, times.clone(), Some(seen.clone()), 20.0);
        let scene = Scene::new(2, motion.clone(), 0.0, 0, vec![bearings, range]).unwrap();
        let x = match motion {
            Moving::Legs(_) => vec![2000.0, 3000.0, 3.0, -4.0, -2.0, 5.0, 148.0],
            Moving::CoordinatedTurn => vec![2000.0, 3000.0, 6.0, 0.5, 0.003],
            _ => vec![2000.0, 3000.0, 3.0, -4.0],
        };
        let (n, m, count) = (scene.states(), scene.measurements(), 21);
        let exact = scene.values(&x).unwrap();
        let mut z = vec![0.0; count * m];
        for (trial, z) in z.chunks_exact_mut(m).enumerate() {
            scene.simulate(&exact, 5, trial as u64, z);
            if trial % 3 == 1 {
                z[trial] = f64::NAN;
            }
        }
        let start: Vec<f64> = x.iter().map(|x| 1.05 * x).collect();
        let known = vec![f64::NAN; n];
        let mut sigma = vec![f64::INFINITY; n];
        sigma[2] = 3.0;
        for loss in [
            crate::solve::Loss::Squares,
            crate::solve::Loss::Huber(1.345),
        ] {
            let options = crate::solve::Options {
                loss,
                ..crate::solve::Options::default()
            };
            let items = crate::batch::Items::each(&z, m);
            let mut trials = trials::Trials::new(&scene, items, &known, &x, &sigma);
            let jobs: Vec<(usize, &[f64])> = (0..count).map(|i| (i, &start[..])).collect();
            let together = minimize_all(&mut trials, &jobs, options, Path::Best);
            assert!(together.iter().all(|one| one.converged));
            for (trial, found) in together.iter().enumerate() {
                let one = minimize_all(&mut trials, &[(trial, &start[..])], options, Path::Best);
                assert_eq!(one[0].x, found.x);
                assert_eq!(one[0].factor, found.factor);
                if loss != crate::solve::Loss::Squares || matches!(motion, Moving::Legs(_)) {
                    continue;
                }
                // The gradient, in deviations.
                let held = vec![None; n];
                let z = &z[trial * m..][..m];
                let (gram, _, mut slope) = alone(&scene, z, &found.x, &held);
                slope[2] += (x[2] - found.x[2]) / 9.0;
                for k in 0..n {
                    assert!(slope[k].abs() < 1e-4 * gram[k * n + k].sqrt(), "{slope:?}");
                }
            }
        }
    }
}

/// From starts of their own estimates reach the target: chi-square as it should be, the
/// state within some deviations.
#[test]
fn estimates_find_their_own_starts() {
    use super::estimate::{Layout, Options, Task, estimate};
    let times: Vec<f64> = (0..60).map(|i| 5.0 * f64::from(i)).collect();
    let seen = zigzag(2).at(&times).unwrap();
    let straight = vec![1500.0, 2500.0, 3.0, -4.0];
    let turned = vec![1500.0, 2500.0, 3.0, -4.0, -8.0, 6.0, 152.0];
    for (motion, x) in [
        (Moving::Polynomial { order: 1 }, straight),
        (Moving::Legs(TurnTimes::Unknown(1)), turned),
    ] {
        let bearings = Channel::new(Kind::Bearing, times.clone(), Some(seen.clone()), 0.002);
        let scene = Scene::new(2, motion, 0.0, 0, vec![bearings]).unwrap();
        let (n, m, count) = (scene.states(), scene.measurements(), 12);
        let exact = scene.values(&x).unwrap();
        let mut z = vec![0.0; count * m];
        for (trial, z) in z.chunks_exact_mut(m).enumerate() {
            scene.simulate(&exact, 7, trial as u64, z);
        }
        let task = Task {
            scene: &scene,
            known: &vec![f64::NAN; n],
            mean: &vec![0.0; n],
            sigma: &vec![f64::INFINITY; n],
            options: Options::default(),
        };
        let size = Layout { states: n }.size();
        let mut out = vec![0.0; count * size];
        let items = crate::batch::Items::each(&z, m);
        estimate(task, items, None, crate::batch::Threads::One, &mut out).unwrap();
        for out in out.chunks_exact(size) {
            let (state, covariance) = out.split_at(n);
            let chi2 = out[n * (n + 3)];
            assert!(chi2 < 110.0, "{chi2}");
            for k in 0..n {
                let off = (state[k] - x[k]).abs() / covariance[k * n + k].sqrt();
                assert!(off < 5.0, "state {k}: {off} deviations");
            }
        }
    }
}

#[test]
fn mirror_images_give_the_same_data() {
    let times: Vec<f64> = (0..12).map(|i| 25.0 * f64::from(i)).collect();
    let line = Carrier::along(2, &[0.0, 300.0], &[100.0, 50.0, 1000.0, 800.0], None, None).unwrap();
    for motion in motions() {
        let kinds = [Kind::ConeAngle, Kind::Range, Kind::Frequency(1500.0)];
        let channels = kinds
            .into_iter()
            .map(|kind| {
                let mut channel =
                    Channel::new(kind, times.clone(), Some(line.at(&times).unwrap()), 0.1);
                channel.parameters[0] = Parameter::Fixed(300.0);
                channel
            })
            .collect();
        let scene = Scene::new(2, motion.clone(), 0.0, 0, channels).unwrap();
        let x = &state(2, &motion)[..scene.states()];
        let mirror = scene.mirrored(x).unwrap();
        let (a, b) = (scene.values(x).unwrap(), scene.values(&mirror).unwrap());
        for (a, b) in a.iter().zip(&b) {
            assert!(
                (a - b).abs() < 1e-9 * (1.0 + a.abs()),
                "{motion:?}: {a} {b}"
            );
        }
    }
    let bent = everything(2, Moving::Polynomial { order: 1 }, false, None);
    assert_eq!(bent.mirrored(&[0.0; 10]), None);
}

#[test]
fn bad_input_is_named() {
    let times = vec![0.0, 1.0, 2.0];
    let coast = Carrier::fixed(&[0.0, 0.0], None)
        .unwrap()
        .at(&times)
        .unwrap();
    let cv = Moving::Polynomial { order: 1 };
    let make = |channel: Channel| {
        Scene::new(2, cv.clone(), 0.0, 0, vec![channel])
            .unwrap_err()
            .error
    };
    let base = Channel::new(Kind::Bearing, times.clone(), Some(coast), 0.01);
    let mut bad = base.clone();
    bad.kind = Kind::Elevation;
    assert!(matches!(make(bad), Error::Dimension { .. }));
    let mut bad = base.clone();
    bad.noise = Noise::Sigma(vec![0.01, -0.1, 0.01]);
    assert_eq!(
        make(bad),
        Error::Sigma {
            index: 1,
            given: -0.1
        }
    );
    let mut bad = base.clone();
    bad.noise = Noise::Sigma(vec![4.0]);
    assert!(matches!(make(bad), Error::SigmaAngle { .. }));
    let mut bad = base.clone();
    bad.noise = Noise::Covariance {
        size: 3,
        matrix: vec![1.0; 9],
    };
    assert_eq!(make(bad), Error::NotPositive { row: 1 });
    let mut bad = base.clone();
    bad.kind = Kind::ConeAngle;
    assert_eq!(make(bad), Error::NoHeading { index: 0 });
    let mut bad = base.clone();
    bad.detection = vec![0.0];
    assert!(matches!(make(bad), Error::Detection { .. }));
    let line = zigzag(2);
    assert!(matches!(line.at(&[301.0]), Err(Error::OutsidePath { .. })));
    // On the carrier there is no bearing; ahead of a towed array no derivative.
    let scene = Scene::new(2, cv.clone(), 0.0, 0, vec![base.clone()]).unwrap();
    let error = scene.rows(&[-1.0, 0.0, 1.0, 0.0]).unwrap_err().error;
    assert!(matches!(error, Error::NoReading { index: 1, .. }));
    let ahead = Carrier::fixed(&[0.0, 0.0], Some(0.0))
        .unwrap()
        .at(&times)
        .unwrap();
    let array = Channel::new(Kind::ConeAngle, times, Some(ahead), 0.01);
    let scene = Scene::new(2, cv, 0.0, 0, vec![array]).unwrap();
    let error = scene.rows(&[0.0, 500.0, 0.0, 1.0]).unwrap_err().error;
    assert!(matches!(error, Error::NoReading { index: 0, .. }));
}

/// Bearings, or range rates, of a carrier on a straight path of the same times.
fn straight(kind: Kind, offset: f64, since: f64) -> Scene {
    let times: Vec<f64> = (0..30).map(|i| since + 13.7 * f64::from(i)).collect();
    let path: Vec<f64> = times
        .iter()
        .flat_map(|t| [offset + 3.1 * (t - since), 4.3 * (t - since) - 2.0 * offset])
        .collect();
    let carrier = Carrier::along(2, &times, &path, None, None).unwrap();
    let channel = Channel::new(kind, times.clone(), Some(carrier.at(&times).unwrap()), 0.01);
    let cv = Moving::Polynomial { order: 1 };
    Scene::new(2, cv, since, 0, vec![channel]).unwrap()
}

#[test]
fn rounding_explains_what_straight_paths_leave() {
    use crate::spine::observability::Observability;
    for kind in [Kind::Bearing, Kind::RangeRate] {
        for offset in [0.0, 1e5, 1e7] {
            for since in [0.0, 1.7e9] {
                let scene = straight(kind, offset, since);
                // Far away, and so near that coordinates have few digits left.
                for (range, speed) in [(4000.0, 2.0), (1e-3, 1e-6), (1e-6, 1e-9)] {
                    let x = [
                        offset + range,
                        -2.0 * offset + 0.3 * range,
                        3.1 + speed,
                        4.3 - 2.0 * speed,
                    ];
                    let Ok(mut rows) = scene.rows(&x) else {
                        continue;
                    };
                    let noise = scene.rounding(&x);
                    let rtol = crate::spine::rounding::remove(&mut rows, 4, &noise);
                    let rank = Observability::new(&rows, 4, rtol).unwrap().rank();
                    assert!(rank < 4, "{kind:?} {offset} {since} {range}");
                }
            }
        }
    }
}

#[test]
fn rounding_is_small_beside_what_a_turn_shows() {
    let scene = everything(2, Moving::Polynomial { order: 1 }, true, None);
    let x = state(2, scene.motion());
    let rows = scene.rows(&x).unwrap();
    let noise = scene.rounding(&x);
    for (j, noise) in noise.iter().enumerate() {
        let size = rows[j..]
            .iter()
            .step_by(x.len())
            .fold(0.0_f64, |s, x| s.hypot(*x));
        // Places of some kilometres have their rounding at 1e-12 of the distance.
        assert!(*noise < 1e-12 * size, "{j}: {noise} of {size}");
    }
    // Ten thousand times as far from the origin, and as much more of it.
    let moved = |by: f64| {
        let carried = Carrier::fixed(&[by, 0.0], None)
            .unwrap()
            .at(&[0.0, 10.0])
            .unwrap();
        let channel = Channel::new(Kind::Bearing, vec![0.0, 10.0], Some(carried), 0.01);
        let at_rest = Moving::Polynomial { order: 0 };
        let scene = Scene::new(2, at_rest, 0.0, 0, vec![channel]).unwrap();
        scene.rounding(&[by + 1000.0, 1000.0])
    };
    let (near, far) = (moved(1e4), moved(1e8));
    assert!((5e3..2e4).contains(&(far[0] / near[0])), "{near:?} {far:?}");
}

/// Columns (m, width) of the whitened rows of a measured scene, from the state `first` on.
fn columns(scene: &Scene, x: &[f64], first: usize, width: usize) -> Vec<f64> {
    let measured = vec![0.0; scene.measurements()];
    let measured = Measured::new(scene, &measured, &[]).unwrap();
    let (m, n) = (measured.measurements(), measured.states());
    let mut rows = vec![0.0; m * n];
    measured
        .linearize(x, &mut vec![0.0; m], Some(&mut rows))
        .unwrap();
    let part = |row: &[f64]| row[first..first + width].to_vec();
    rows.chunks_exact(n).flat_map(part).collect()
}

#[test]
fn a_departure_of_the_motion_is_a_column_of_the_wider_motion() {
    for dimension in [2, 3] {
        for (true_path, delay) in [(false, None), (true, None), (true, Some(340.0))] {
            let scene = |motion| everything(dimension, motion, true_path, delay);
            let steady = Moving::Polynomial { order: 1 };
            let x = state(dimension, &steady);
            let (motion, nuisance) = x.split_at(2 * dimension);
            let plain = scene(steady);
            let zeros = vec![0.0; plain.measurements()];
            let measured = Measured::new(&plain, &zeros, &[]).unwrap();
            let found = measured.departures(&x, &[60.0]).unwrap();
            let of = |wanted: Departure| {
                let all = found.iter().filter(|(departure, _)| *departure == wanted);
                all.map(|(_, column)| column.clone()).next().unwrap()
            };
            let curved = [motion, &vec![0.0; dimension], nuisance].concat();
            let turned = [motion, &motion[dimension..], nuisance].concat();
            let legs = Moving::Legs(TurnTimes::Known(vec![60.0]));
            for (wider, x, departure) in [
                (Moving::Polynomial { order: 2 }, curved, Departure::Order(2)),
                (legs, turned, Departure::Turn(60.0)),
            ] {
                let wanted = columns(&scene(wider), &x, 2 * dimension, dimension);
                for (i, (a, b)) in of(departure).iter().zip(&wanted).enumerate() {
                    let close = (a - b).abs() <= 1e-9 * (1.0 + b.abs());
                    assert!(close, "{departure:?} {delay:?}, number {i}: {a} for {b}");
                }
            }
        }
    }
}

#[test]
fn a_departure_of_a_sensor_is_the_change_of_its_readings() {
    let carrier = zigzag(2);
    let times: Vec<f64> = (0..9).map(|i| 10.0 + 30.0 * f64::from(i)).collect();
    let channel = |kind| {
        let carried = (!Kind::is_own(kind)).then(|| carrier.at(&times).unwrap());
        Channel::new(kind, times.clone(), carried, 0.5)
    };
    let kinds = [Kind::Bearing, Kind::Range, Kind::RangeRate, Kind::Speed];
    let scene = |which: usize, change: &dyn Fn(&mut Channel)| {
        let mut channels: Vec<_> = kinds.iter().map(|&kind| channel(kind)).collect();
        change(&mut channels[which]);
        Scene::new(2, Moving::CoordinatedTurn, 0.0, 0, channels).unwrap()
    };
    let x = [3000.0, 4000.0, 7.0, 0.4, 2e-3];
    let plain = scene(0, &|_| {});
    let mut measured = vec![0.0; plain.measurements()];
    measured[4] = f64::NAN;
    let measured = Measured::new(&plain, &measured, &[]).unwrap();
    let found = measured.departures(&x, &[]).unwrap();
    let mut seen = [0; 4];
    for (departure, column) in &found {
        let (which, step): (usize, f64) = match *departure {
            Departure::Bias(sensor) | Departure::Scale(sensor) => (sensor, 1e-3),
            Departure::Clock(sensor) => (sensor, 1e-2),
            Departure::Order(_) | Departure::Turn(_) => continue,
        };
        seen[which] += 1;
        let at = |sign: f64| {
            let change = |channel: &mut Channel| {
                let value = Parameter::Fixed(sign * step);
                match departure {
                    Departure::Bias(_) => channel.bias.push((1.0, value)),
                    Departure::Scale(_) => channel.scale = value,
                    _ => (channel.clock, channel.true_path) = (value, true),
                }
            };
            scene(which, &change).values(&x).unwrap()
        };
        let mut wanted: Vec<f64> = at(1.0)
            .iter()
            .zip(&at(-1.0))
            .map(|(a, b)| (a - b) / (2.0 * step) / 0.5)
            .collect();
        wanted.remove(4);
        assert_eq!(column.len(), wanted.len());
        for (a, b) in column.iter().zip(&wanted) {
            assert!(
                (a - b).abs() <= 1e-6 * (1.0 + b.abs()),
                "{departure:?}: {a} for {b}"
            );
        }
    }
    assert_eq!(seen, [2, 3, 3, 3]);
}
