//! Scenes: rows against differences of values, noise, symmetries.

#![allow(clippy::unwrap_used)]

use alloc::vec;
use alloc::vec::Vec;

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
